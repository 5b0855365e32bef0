"""Networks for ONNX runtimes: the dense network of voxels with the sigmoid, or the judge with the softmax, with the
names of the checkpoint's parameters. Opset 13 and IR version 7 are read by all since ONNX 1.8 (November 2020)."""

import json
import os
from pathlib import Path
from typing import Any, Iterable

import numpy as np
from numpy.typing import NDArray

from ... import _arrays, _native
from .._files import module, number, outside, write as write_file

SIDE = 40
#: Squared lengths are at least this, so that a vector of zeros is not divided by zero.
NORM_SQUARED_MIN = 1e-24
#: Layers that halve a grid; all others keep its size.
HALVING = {"encoder.conv1", "encoder.conv2", "encoder.conv3", "conv1", "conv2", "wide1", "wide2"}
#: How a decoder doubles its grids: half-pixel centres clamped at the ends, or each value eight times.
DOUBLING = {
    "linear": {"mode": "linear", "coordinate_transformation_mode": "half_pixel"},
    "nearest": {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"},
}
VOXEL, CLOSINGS, JUDGE = "vgn-conv-40", "closings-conv-40", "hand-judge-1"
#: Outputs and their channels.
OUTPUTS = {VOXEL: {"quality": 1, "rotation": 4, "width": 1}, CLOSINGS: {"quality_logit": 3, "approach": 3, "turns": 15, "width": 3, "tips": 3}}
DOCS = {
    VOXEL: (
        "Volumetric grasp network. In: tsdf [batch, 1, 40, 40, 40] (x, y, z), truncated distances in VGN's values, (d + 1) / 2, 0 where "
        "nothing was seen. Out, for every voxel: quality [batch, 1, ...], the chance that a grasp there holds; rotation [batch, 4, ...], "
        "the gripper's in the workspace as a unit quaternion x, y, z, w; width [batch, 1, ...], the opening in voxels."
    ),
    CLOSINGS: (
        "Volumetric grasp network with a head by closing direction. In: tsdf as of the paper's network. Out, for every voxel: approach "
        "[batch, 3, ...], a unit vector; turns [batch, 15, ...], how likely it holds closed along each of 15 directions over half a turn "
        "about the approach; quality_logit and width (voxels), each [batch, 3, ...] as a, b, c of a + b cos 2t + c sin 2t at turn t; tips "
        "[batch, 3, ...], the point between the finger tips from the voxel's middle, in voxels. graspmill.torch has the decoder."
    ),
    JUDGE: (
        "A judge of grasps. In: crop [batch, 4, 8, 20, 28], surroundings [batch, 3, 12, 8, 8] and facts [batch, 16], as scripts/judge_onnx.py "
        "computes them. Out: outcomes [batch, 6], the probabilities of pregrasp_collision, approach_collision, empty, slipped, hit_other and "
        "held; and where it learned from repeated attempts robustness [batch, 1], the share of a held grasp's repeats that hold."
    ),
}


class _Graph:
    """The nodes of a network of these parameters, each named as its output, and its constants."""

    def __init__(self, helper: Any, parameters: dict[str, NDArray[Any]]) -> None:
        self._helper, self._parameters = helper, parameters
        self.nodes: list[Any] = []

    def node(self, operator: str, inputs: Iterable[str], output: str, **attributes: Any) -> str:
        self.nodes.append(self._helper.make_node(operator, list(inputs), [output], output, **attributes))
        return output

    def convolution(self, layer: str, x: str, output: str) -> str:
        side = self._parameters[f"{layer}.weight"].shape[2]
        shape = {"kernel_shape": [side] * 3, "pads": [side // 2] * 6, "strides": [1 + (layer in HALVING)] * 3}
        return self.node("Conv", [x, f"{layer}.weight", f"{layer}.bias"], output, **shape)

    def activated(self, layer: str, x: str) -> str:
        return self.node("Relu", [self.convolution(layer, x, f"{layer}.conv")], f"{layer}.relu")

    def normalised(self, layer: str, x: str, output: str) -> None:
        raw = self.convolution(layer, x, f"{output}.raw")
        squared = self.node("ReduceSumSquare", [raw], f"{output}.norm_squared", axes=[1], keepdims=1)
        held = self.node("Max", [squared, "norm_squared_min"], f"{output}.norm_squared_held")
        self.node("Div", [raw, self.node("Sqrt", [held], f"{output}.norm")], output)

    def voxels(self, kind: str, upsampling: str) -> None:
        x = "tsdf"
        for part in ("encoder", "decoder"):
            for layer in (f"{part}.conv1", f"{part}.conv2", f"{part}.conv3"):
                x = self.activated(layer, x)
                if part == "decoder":  # the omitted input is a region for cropping
                    x = self.node("Resize", [x, "", "doubling.scales"], f"{layer}.doubled", **DOUBLING[upsampling])
        if kind == VOXEL:
            self.node("Sigmoid", [self.convolution("conv_qual", x, "quality.logit")], "quality")
            self.normalised("conv_rot", x, "rotation")
        else:
            self.convolution("conv_qual", x, "quality_logit")
            self.normalised("conv_approach", x, "approach")
            self.node("Softmax", [self.convolution("conv_turn", x, "turns.logit")], "turns", axis=1)
            self.convolution("conv_tips", x, "tips")
        self.convolution("conv_width", x, "width")

    def judge(self) -> None:
        rows = []
        for x, layers, last in (("crop", ("conv1", "conv2", "conv3"), "reduce"), ("surroundings", ("wide1",), "wide2")):
            name = x
            for layer in layers:
                x = self.activated(layer, x)
            turned = self.node("Transpose", [self.convolution(last, x, f"{name}.seen")], f"{name}.last", perm=[0, 2, 3, 4, 1])
            rows.append(self.node("Flatten", [turned], f"{name}.row", axis=1))
        row = self.node("Concat", [*rows, "facts"], "row", axis=1)
        x = self.activated("head2", self.activated("head1", self.node("Reshape", [row, "row.shape"], "row.shaped")))
        logits = self.node("Flatten", [self.convolution("head3", x, "logits.shaped")], "logits", axis=1)
        self.node("Softmax", [logits], "outcomes", axis=1)
        if "robustness.weight" in self._parameters:
            logit = self.node("Flatten", [self.convolution("robustness", x, "robustness.shaped")], "robustness.logit", axis=1)
            self.node("Sigmoid", [logit], "robustness")


def write(checkpoint: str, out: str, force: bool = False) -> None:
    """Writes a checkpoint's network, with ``force`` also in place of a file. Equal checkpoints give equal bytes."""
    onnx = module("onnx", "the format onnx", "onnx")
    _native.check_checkpoint(checkpoint)
    helper = onnx.helper
    with module("safetensors", "the format onnx", "onnx").safe_open(checkpoint, "np") as file:
        header: dict[str, Any] = json.loads(file.metadata()["graspmill"])
        parameters = {name: file.get_tensor(name) for name in sorted(file.keys()) if not name.startswith("adam.")}
    _arrays.must(force or not os.path.lexists(out), f"there is a file already: --force replaces it: {out}")
    kind, progress = header["architecture"], header["progress"]
    graph = _Graph(helper, parameters)
    facts = {"architecture": kind, "dataset_id": header["dataset_id"], "config": header["config"]}
    facts |= {"epoch": str(progress["epoch"]), "step": str(progress["step"])}
    if kind == JUDGE:
        graph.judge()
        facts["trained_for"] = json.dumps(header["trained_for"], separators=(",", ":"), ensure_ascii=False)
        inputs = {"crop": [4, 8, 20, 28], "surroundings": [3, 12, 8, 8], "facts": [16]}
        outputs = {"outcomes": [6], **({"robustness": [1]} if "robustness.weight" in parameters else {})}
        constants: dict[str, NDArray[Any]] = {"row.shape": np.array([0, -1, 1, 1, 1])}
    else:
        graph.voxels(kind, header["upsampling"])
        facts["upsampling"] = header["upsampling"]
        for key, otherwise in (("origin_behind_tips_m", 0.0), ("voxel_offset", 0.5)):
            facts[key] = number(np.float32(header.get(key, otherwise)))
        inputs = {"tsdf": [1, SIDE, SIDE, SIDE]}
        outputs = {name: [channels, SIDE, SIDE, SIDE] for name, channels in OUTPUTS[kind].items()}
        constants = {"doubling.scales": np.array([1, 1, 2, 2, 2], np.float32), "norm_squared_min": np.array([NORM_SQUARED_MIN], np.float32)}

    def tensors(shapes: dict[str, list[int]]) -> list[Any]:
        return [helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["batch", *shape]) for name, shape in shapes.items()]

    values = [onnx.numpy_helper.from_array(array, name) for name, array in {**parameters, **constants}.items()]
    network = helper.make_graph(graph.nodes, kind, tensors(inputs), tensors(outputs), values)
    versions = {"opset_imports": [helper.make_opsetid("", 13)], "ir_version": 7}
    made_by = {"producer_name": "graspmill trainer", "producer_version": _native.__version__}
    model = helper.make_model(network, **versions, **made_by, doc_string=DOCS[kind])
    helper.set_model_props(model, dict(sorted(facts.items())))
    with outside(Path(out)):
        write_file(Path(out), model.SerializeToString(deterministic=True))
