"""`graspmill.torch.Judge`: the answers of the native judge, and files that both read."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from grasp_sets import graspmill, refused
torch = pytest.importorskip("torch")

import graspmill.torch as gt  # noqa: E402

MODELS = Path(__file__).parents[2] / "models"
JUDGES = [("judge", "parallel_jaw_80"), ("judge-any-jaw", "wsg_50")]


def asked(judge, tsdf, poses, gripper):
    """``[4, N]``: the probability of ``held`` in each mirror image."""
    crops = graspmill.grasp_crops(tsdf, poses, gripper=gripper, views=6)
    answers = []
    for axes in ((), (0,), (1,), (0, 1)):
        crop, context, features = crops.crop, crops.context, crops.features.copy()
        crop, context = (np.flip(seen, [1 + axis for axis in axes]) for seen in (crop, context))
        features[:, list(axes)] *= -1
        seen = [torch.from_numpy(np.moveaxis(part, 4, 1).copy()) for part in (crop, context)]
        batch = {"crop": seen[0], "context": seen[1], "features": torch.from_numpy(features)}
        with torch.no_grad():
            answers.append(judge.outcomes(batch)[:, graspmill.OUTCOMES.index("held")].numpy())
    return np.array(answers)


def planned(path, tsdf, gripper):
    plan = graspmill.Planner(model=path, gripper=gripper).plan_tsdf(tsdf, grasps_max=6)
    return plan, {key: value for key, value in json.loads(plan.to_json()).items() if key != "model"}


@pytest.mark.parametrize(("name", "gripper"), JUDGES)
def test_a_judge_answers_as_the_native_one_and_goes_both_ways(name, gripper, tsdf, tmp_path):
    path = MODELS / f"{name}.safetensors"
    judge = gt.Judge.load(path)
    plan, answer = planned(path, tsdf, gripper)
    expected = np.array([grasp.quality for grasp in plan])
    assert len(expected) >= 5
    # Of its six best grasps the planner takes the mean over the mirror images, of which the half turn is one.
    apart = np.abs(asked(judge, tsdf, plan.workspace_from_grasp, gripper).mean(axis=0) - expected)
    assert apart.max() < 1e-5, apart
    judge.save(tmp_path / "saved.safetensors")
    assert planned(tmp_path / "saved.safetensors", tsdf, gripper)[1] == answer
    again = gt.Judge.load(tmp_path / "saved.safetensors")
    assert (again.trained_for, again.dataset_id, again.config) == (judge.trained_for, judge.dataset_id, judge.config)
    assert all(torch.equal(tensor, again.state_dict()[key]) for key, tensor in judge.state_dict().items())


def test_a_judge_of_a_dataset_is_trained_for_its_grippers(tsdf, tmp_path):
    gripper = graspmill.Gripper.load("wsg_50")
    dataset = graspmill.generate(tmp_path / "ds", shards=1, attempts=120, gripper="wsg_50", seed=3)
    judge = gt.Judge(dataset)
    assert judge.trained_for["gripper"]["opening_m_max"] == pytest.approx(gripper.opening_m_max)
    assert judge.dataset_id == dataset.id and "hands" not in judge.trained_for
    batch = next(iter(gt.GraspCropStream(dataset, "all", batch=64, shuffle=False)))
    optimiser = torch.optim.Adam(judge.parameters(), lr=1e-3)
    values = []
    for _ in range(6):
        values.append(gt.judge_loss(judge.at(batch), batch))
        optimiser.zero_grad()
        values[-1].backward()
        optimiser.step()
    assert values[-1] < values[0]
    judge.save(tmp_path / "judge.safetensors")
    graspmill.Planner(model=tmp_path / "judge.safetensors", gripper="wsg_50").plan_tsdf(tsdf)
    refused("the judge was trained for the gripper wsg_50", lambda: graspmill.Planner(model=tmp_path / "judge.safetensors", gripper="parallel_jaw_80"))


def test_several_grippers_are_a_range_of_each_number():
    grippers = [{"name": f"gripper_{n}", "opening_m_max": 0.05 + 0.01 * n, "friction": 1.0} for n in range(3)]
    info = {"gripper": grippers[0], "grippers": grippers, "procedure": {"pregrasp_distance_m": 0.05}, "grid": {"resolution": 40}}
    scope = graspmill._judge._scope(info, True)
    assert scope["gripper"] == grippers[0] and scope["hands"] == [[0.05, 0.07], [1.0, 1.0]]


def test_robustness_is_one_output_more(tmp_path):
    trained_for = gt.Judge.load(MODELS / "judge.safetensors").trained_for
    judge = gt.Judge({**trained_for, "robustness": True})
    batch = {"crop": torch.zeros(2, 4, 8, 20, 28), "context": torch.zeros(2, 3, 12, 8, 8), "features": torch.zeros(2, 16)}
    assert judge.at(batch).shape == (2, 7) and judge.outcomes(batch).shape == (2, 6)
    judge.save(tmp_path / "judge.safetensors")
    assert gt.Judge.load(tmp_path / "judge.safetensors").at(batch).shape == (2, 7)
    plan = graspmill.Planner(model=tmp_path / "judge.safetensors").plan_tsdf(np.zeros((40, 40, 40)))
    assert len(plan) == 0


def rewritten(source, target, change=lambda header: None, drop=()):
    """A copy of a safetensors file with another header, or without some tensors."""
    from safetensors.numpy import load_file, save_file

    raw = source.read_bytes()
    [length] = struct.unpack("<Q", raw[:8])
    stored = json.loads(json.loads(raw[8 : 8 + length])["__metadata__"]["graspmill"])
    change(stored)
    tensors = {name: values for name, values in load_file(source).items() if name not in drop}
    save_file(tensors, target, {"graspmill": json.dumps(stored)})


def test_a_bit_that_flipped_in_what_pytorch_wrote_is_noticed(tmp_path):
    path = tmp_path / "net.safetensors"
    for network in (gt.Judge.load(MODELS / "judge.safetensors"), gt.VoxelNetwork()):
        network.save(path)
        type(network).load(path)
        raw = bytearray(path.read_bytes())
        raw[len(raw) // 2] ^= 1
        path.write_bytes(raw)
        with pytest.raises(graspmill.DataError, match="file_sha256 of its header must be"):
            type(network).load(path)


def test_what_is_no_judge_is_refused_and_named(tmp_path):
    judge, bad = MODELS / "judge.safetensors", tmp_path / "bad.safetensors"
    refused("architecture must be 'hand-judge-1', a judge's, got 'vgn-conv-40'", lambda: gt.Judge.load(MODELS / "paper-200k.safetensors"))
    refused("no checkpoint here", lambda: gt.Judge.load(tmp_path / "none.safetensors"))
    bad.write_bytes(judge.read_bytes()[:5_000])
    with pytest.raises(graspmill.DataError, match="damaged checkpoint"):
        gt.Judge.load(bad)
    rewritten(judge, bad, drop=["conv2.bias"])
    refused("conv2.bias is missing", lambda: gt.Judge.load(bad))
    rewritten(judge, bad, lambda stored: stored.update(format_version=2))
    with pytest.raises(graspmill.DataError, match="checkpoint format must be 1, got 2"):
        gt.Judge.load(bad)
    refused("trained_for must be a dataset or have grid, gripper, pregrasp_distance_m", lambda: gt.Judge({"gripper": {}}))
    diverged = gt.Judge.load(judge)
    with torch.no_grad():
        diverged.head1.bias[0] = float("nan")
    with pytest.raises(graspmill.DataError, match="head1.bias must be finite, got 1 values"):
        diverged.save(bad)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.safetensors"]
