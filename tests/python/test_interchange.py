"""Opens checkpoints in onnxruntime (through `graspmill weights export`) and safetensors; reads what PyTorch wrote.
Weights, grids and expected outputs come from lab/golden_torch.py, so PyTorch's values are known without PyTorch."""

import json

import numpy as np
import onnxruntime
import pytest
from programs import ROOT, commanded
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from golden_formula import LAYERS, noise  # noqa: E402

native = pytest.importorskip("graspmill._native", reason="the wheel is not installed: scripts/test.sh builds it")
GOLDEN = ROOT / "trainer" / "tests" / "golden"
MODES = ["linear", "nearest"]
OUTPUTS = {"quality": 1, "rotation": 4, "width": 1}


def weights():
    """golden_torch.py's weights under VGN's names."""
    made = {}
    for number, (name, c_in, c_out, k, _) in enumerate(LAYERS):
        bound = np.sqrt(6.0 / (k**3 * c_in))
        for part, shape in (("weight", (c_out, c_in, k, k, k)), ("bias", (c_out,))):
            values = (2.0 * noise(int(np.prod(shape)), 2 * number + (part == "bias")) - 1.0) * bound
            made[f"{name}.{part}"] = values.astype(np.float32).reshape(shape)
    return made


def grids():
    values = [np.where(noise(40**3, 200 + n) < 0.25, noise(40**3, 100 + n), 0.0) for n in range(3)]
    return np.stack(values).astype(np.float32).reshape(3, 1, 40, 40, 40)


def checkpoint(path, upsampling, tensors):
    confusion = dict.fromkeys(("true_positive", "false_positive", "true_negative", "false_negative"), 0)
    progress = {"epoch": 0, "batch": 0, "step": 0, "confusion": confusion, "sums_bits": [0] * 4, "best_accuracy_bits": None}
    header = {"format_version": 1, "architecture": "vgn-conv-40", "upsampling": upsampling, "dataset_id": "unknown", "config": ""}
    header |= {"progress": progress, "adam_steps": 0, "made_by": "a test"}
    save_file(tensors, path, {"graspmill": json.dumps(header)})
    return path


def export(*words, code=0):
    return commanded("weights", "export", *words, code=code)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("interchange")
    save_file(weights(), place / "weights.safetensors")
    for mode in MODES:
        export(checkpoint(place / f"{mode}.safetensors", mode, weights()), "--format", "onnx", "--out", place / f"{mode}.onnx")
    return place


def session(path):
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


@pytest.mark.parametrize("mode", MODES)
def test_onnxruntime_gives_what_pytorch_gives(folder, mode):
    golden = load_file(GOLDEN / f"{mode}.safetensors")
    volumes = session(folder / f"{mode}.onnx").run(list(OUTPUTS), {"tsdf": grids()})
    for number, (name, volume) in enumerate(zip(OUTPUTS, volumes)):
        flat, expected = volume.reshape(-1), golden[f"forward.{name}"]
        at = (noise(len(expected), 400 + number) * flat.size).astype(np.int64)
        print(f"{mode} {name}: max |difference| {np.abs(flat[at] - expected).max():.2e}")
        np.testing.assert_allclose(flat[at], expected, rtol=0, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(flat.astype(np.float64)), golden[f"forward.{name}.norm"][0], rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(volumes[1], axis=1), 1.0, atol=1e-5)
    assert 0.0 <= volumes[0].min() and volumes[0].max() <= 1.0


@pytest.mark.parametrize("mode", MODES)
def test_an_onnx_model_says_what_it_takes_and_where_it_comes_from(folder, mode):
    model = session(folder / f"{mode}.onnx")
    [tsdf] = model.get_inputs()
    assert (tsdf.name, tsdf.type, tsdf.shape) == ("tsdf", "tensor(float)", ["batch", 1, 40, 40, 40])
    shapes = {output.name: output.shape for output in model.get_outputs()}
    assert shapes == {name: ["batch", channels, 40, 40, 40] for name, channels in OUTPUTS.items()}
    properties = model.get_modelmeta().custom_metadata_map
    assert properties["upsampling"] == mode and properties["dataset_id"].startswith("unknown")
    one, three = (model.run(None, {"tsdf": grids()[:count]}) for count in (1, 3))
    for alone, together in zip(one, three):
        np.testing.assert_allclose(alone[0], together[0], rtol=0, atol=1e-5)


def test_an_export_is_the_same_again_and_replaces_a_file_only_if_it_shall(folder, tmp_path):
    words = (folder / "linear.safetensors", "--format=onnx", "--out", tmp_path / "deeper/net.onnx")
    assert "net.onnx" in export(*words).stdout
    assert (tmp_path / "deeper/net.onnx").read_bytes() == (folder / "linear.onnx").read_bytes()
    for file, code, message in (
        (words[0], 78, "there is a file already"),
        (tmp_path / "none", 78, "no checkpoint here"),
        (folder / "weights.safetensors", 65, "not a checkpoint"),
    ):
        assert message in export(file, *words[1:], code=code).stderr
    export(*words, "--force")


def test_a_zero_rotation_is_not_divided_by_zero(folder, tmp_path):
    dead = {name: np.zeros_like(values) for name, values in weights().items()}
    export(checkpoint(tmp_path / "dead", "nearest", dead), "--format", "onnx", "--out", tmp_path / "dead.onnx")
    quality, rotation, width = session(tmp_path / "dead.onnx").run(list(OUTPUTS), {"tsdf": grids()[:1]})
    assert (quality == 0.5).all() and (rotation == 0.0).all() and (width == 0.0).all()


# From here on with PyTorch.


@pytest.fixture
def torch():
    return pytest.importorskip("torch", reason="PyTorch is not installed: scripts/requirements-golden.txt has it")


@pytest.mark.parametrize(("zipped", "wrapped"), [(True, True), (False, False)])
def test_what_pytorch_saves_comes_back_bit_by_bit(tmp_path, zipped, wrapped, torch):
    graspmill = pytest.importorskip("graspmill.torch")
    state = {name: torch.from_numpy(values) for name, values in weights().items()}
    saved = {"epoch": 7, "state_dict": {f"module._orig_mod.{name}": tensor for name, tensor in state.items()}} if wrapped else state
    torch.save(saved, tmp_path / "net.pth", _use_new_zipfile_serialization=zipped)
    graspmill.VoxelNetwork.load(tmp_path / "net.pth").save(tmp_path / "net.safetensors")
    native.check_checkpoint(tmp_path / "net.safetensors")
    with safe_open(tmp_path / "net.safetensors", "numpy") as file:
        header = json.loads(file.metadata()["graspmill"])
        read = {name: file.get_tensor(name) for name in file.keys()}
    assert [header[name] for name in ("upsampling", "origin_behind_tips_m", "voxel_offset")] == ["nearest", 0.05, 0.0]
    assert read.keys() == state.keys()
    for name, tensor in state.items():
        np.testing.assert_array_equal(read[name].view(np.uint32), tensor.numpy().view(np.uint32), err_msg=name)


def test_a_state_dict_in_safetensors_is_vgns_unless_it_says_something_else(tmp_path, torch):
    graspmill = pytest.importorskip("graspmill.torch")
    halves = {f"module.{name}": values.astype(np.float16) for name, values in weights().items()}
    for said, upsampling in (({"format": "pt"}, "nearest"), ({"upsampling": "linear", "voxel_offset": "0.5"}, "linear")):
        save_file(halves, tmp_path / "net.safetensors", said)
        net = graspmill.VoxelNetwork.load(tmp_path / "net.safetensors")
        assert (net.upsampling, net.origin_behind_tips_m) == (upsampling, 0.05)
        assert net.voxel_offset == (0.0 if upsampling == "nearest" else 0.5)
        for name, tensor in net.state_dict().items():
            np.testing.assert_array_equal(tensor.numpy(), halves[f"module.{name}"].astype(np.float32), err_msg=name)
