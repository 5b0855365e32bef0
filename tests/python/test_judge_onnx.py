"""A judge in ONNX, given what scripts/judge_onnx.py computes, says what `graspmill plan` says."""

import json
import sys

import numpy as np
import pytest
from programs import ROOT, packaged, ran

from judge_onnx import OUTCOMES, Judge, grasps_of, rotation  # noqa: E402

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
# A TSDF does not say from how many views it was made; the planner then assumes six.
VIEWS = 6


@pytest.fixture(scope="module")
def folder(tmp_path_factory, tsdf):
    place = tmp_path_factory.mktemp("judge")
    packaged("weights", "export", ROOT / "models/judge.safetensors", "--format", "onnx", "--out", place / "judge.onnx")
    np.save(place / "scene.npy", tsdf)
    packaged("plan", "--tsdf", place / "scene.npy", "--explain", "--quiet", "--out", place / "plan.json")
    return place


def test_the_judge_in_onnx_says_what_the_planner_says(folder, tsdf):
    plan = json.loads((folder / "plan.json").read_text())
    judge = Judge(folder / "judge.onnx")
    grasps = grasps_of(folder / "plan.json")
    assert len(grasps) > 10
    # The planner turns a grasp by half a turn if that suits the wrist better; it judged the other.
    turned = [(position, [y, -x, w, -z]) for position, (x, y, z, w) in grasps]
    # Its best grasps it judged in all four mirror images, the others as they are.
    mirrored = [(False, False), (True, False), (False, True), (True, True)]
    each = np.stack([[judge.outcomes(tsdf, poses, VIEWS, by) for by in mirrored] for poses in (grasps, turned)])
    np.testing.assert_allclose(each.sum(axis=-1), 1, atol=1e-5)
    held = each[..., OUTCOMES.index("held")]
    expected = np.array([grasp["quality"] for grasp in plan["grasps"]])
    means, singles = held.mean(axis=1), held[:, 0]
    apart_mean, apart_single = (np.abs(values - expected).min(axis=0) for values in (means, singles))
    assert np.minimum(apart_mean, apart_single).max() < 2e-4, (apart_mean, apart_single)
    # The half turn is the grasp mirrored in both, so the mean is the same for the two, and only the mean.
    assert np.abs(means[0] - means[1]).max() < 2e-4
    assert np.abs(singles[0] - singles[1]).max() > 1e-3
    # Six grasps are asked about in all images; another, asked about once, may come before the last of them.
    assert (apart_mean[:10] < 2e-4).sum() >= 6 and apart_mean[:3].max() < 2e-4, apart_mean


def test_the_packages_crops_are_those_of_the_script(folder, tsdf):
    """Its numbers are of the same points and features; `test_package_torch.py` has what the trainer sees."""
    judge, grasps = Judge(folder / "judge.onnx"), grasps_of(folder / "plan.json")[:12]
    poses = [[*position_m, *turn] for position_m, turn in grasps]
    seen, lower = (graspmill.grasp_crops(tsdf, poses, views=3, table_z_m=table_z_m) for table_z_m in (0.05, 0.02))
    for number, (position_m, turn) in enumerate(grasps):
        pose = np.asarray(position_m), rotation(turn)
        np.testing.assert_allclose(seen.features[number], judge.facts(*pose, 3), atol=1e-5)
        for crop, expected in ((seen.crop, judge.crop(tsdf, *pose)), (seen.context, judge.surroundings(tsdf, *pose))):
            off = np.abs(np.moveaxis(crop[number], -1, 0) - expected)
            assert off[0][expected[1] > 0.05].max() < 1e-4 and off[1:].max() < 1e-4
    np.testing.assert_allclose(lower.features[:, 3] - seen.features[:, 3], 0.3, atol=1e-5)


def test_an_export_says_what_it_was_trained_for(folder):
    judge = Judge(folder / "judge.onnx")
    assert judge.gripper["name"] == "parallel_jaw_80"
    assert judge.grid == {"resolution": 40, "size_m": 0.3, "table_z_m": 0.05}
    shapes = {put.name: put.shape for put in (*judge.session.get_inputs(), *judge.session.get_outputs())}
    expected = {"crop": [4, 8, 20, 28], "surroundings": [3, 12, 8, 8], "facts": [16], "outcomes": [6]}
    assert shapes == {name: ["batch", *shape] for name, shape in expected.items()}


def test_the_script_prints_the_outcomes(folder):
    names = ("judge.onnx", "scene.npy", "plan.json")
    lines = ran(sys.executable, ROOT / "scripts/judge_onnx.py", *names, cwd=folder).stdout.splitlines()
    assert lines[0].split() == ["grasp", *OUTCOMES] and len(lines) > 10
