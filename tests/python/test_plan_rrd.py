"""scripts/plan_rrd.py on a synthetic plan: the recording can be read back."""

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun", reason="rerun-sdk is not installed: pip install rerun-sdk==0.36.3")
from rerun.experimental import RrdReader  # noqa: E402

SCRIPT = Path(__file__).parents[2] / "scripts/plan_rrd.py"


def pose(*position_m):
    return {"position_m": position_m, "quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]}


def made_up_plan():
    common = {"base_from_grasp": None, "width_m": 0.04, "opening_m": 0.05, "voxel": [1, 2, 3]}
    return {
        "format": "graspmill-plan/3",
        "model": "0" * 64,
        "policy": "paper",
        "gripper": "parallel_jaw_80",
        "region": {"low_m": [-0.1, 0.0, 0.0], "high_m": [0.5, 0.4, 0.3], "table_z_m": 0.05},
        "grasps": [
            {**common, "rank": 1, "workspace_from_grasp": pose(0.1, 0.1, 0.1), "quality": 0.98, "object": 0, "rho_m": 0.012},
            {**common, "rank": 2, "workspace_from_grasp": pose(0.2, 0.1, 0.1), "quality": 0.93, "object": None, "rho_m": None, "width_m": None},
        ],
        "reason": None,
        "warnings": ["made up"],
        "objects": [{"centroid_m": [0.1, 0.1, 0.08], "point_count": 600}],
        "plane": None,
        "funnel": {},
        "dropped": [
            {**common, "why": "collision", "detail": "hits", "workspace_from_grasp": pose(0.2, 0.2, 0.1), "quality": 0.9}
        ],
    }


def cloud(count):
    points = np.zeros((count, 4))
    points[:, 0], points[:, 3] = np.linspace(0, 0.3, count), np.arange(count) % 14 - 2
    file = io.BytesIO()
    np.save(file, points)
    return file.getvalue()


def run(folder, plan, cloud):
    (folder / "plan.json").write_text(json.dumps(plan))
    (folder / "cloud.npy").write_bytes(cloud)
    command = [sys.executable, SCRIPT, "plan.json", "--cloud", "cloud.npy", "--out", "plan.rrd"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


def recorded(path):
    """Rows by entity and column."""
    found = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        found.setdefault(chunk.entity_path, {}).update(batch.to_pydict())
    return found


def test_a_plan_can_be_read_back(tmp_path):
    done = run(tmp_path, made_up_plan(), cloud(500))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "plan.rrd").read_bytes().startswith(b"RRF2")
    found = recorded(tmp_path / "plan.rrd")
    grasps = [f"/workspace/grasps/{rank:03}{part}" for rank in (1, 2) for part in ("", "/hand", "/approach")]
    places = [f"/workspace/{name}" for name in ("box", "cloud", "centroids", "dropped")]
    assert {*grasps, *places, "/notes"} <= found.keys()
    points = found["/workspace/cloud"]["Points3D:positions"][0]
    assert len(points) == 500 and points[-1] == pytest.approx([0.3, 0, 0])
    labels = found["/workspace/grasps/001/hand"]["Boxes3D:labels"][0]
    assert labels[-1] == "1: q 0.980, rho 12.0 mm"
    for rank in (1, 2):
        fingers = found[f"/workspace/grasps/{rank:03}/hand"]["Boxes3D:centers"][0][:2]
        assert fingers == [pytest.approx([0, side * 0.03, -0.025]) for side in (-1, 1)]
    assert found["/workspace/box"]["Boxes3D:centers"][0][0] == pytest.approx([0.2, 0.2, 0.15])
    assert found["/workspace/box"]["Boxes3D:half_sizes"][0][0] == pytest.approx([0.3, 0.2, 0.15])


@pytest.mark.parametrize("version", [1, 2])
def test_plans_of_earlier_versions_can_be_read(tmp_path, version):
    plan = made_up_plan() | {"format": f"graspmill-plan/{version}", "grid": {"size_m": 0.3, "resolution": 40, "table_z_m": 0.05}}
    del plan["region"], plan["grasps"][1], plan["grasps"][0]["opening_m"]
    done = run(tmp_path, plan, cloud(5))
    assert done.returncode == 0, done.stderr
    found = recorded(tmp_path / "plan.rrd")
    assert found["/workspace/box"]["Boxes3D:centers"][0][0] == pytest.approx([0.15] * 3)
    assert found["/workspace/grasps/001/hand"]["Boxes3D:centers"][0][0] == pytest.approx([0, -0.025, -0.025])


def test_a_plan_without_grasps_is_a_recording_too(tmp_path):
    plan = {**made_up_plan(), "grasps": [], "objects": [], "dropped": [], "reason": "nothing was seen"}
    done = run(tmp_path, plan, cloud(0))
    assert done.returncode == 0, done.stderr
    assert "/notes" in recorded(tmp_path / "plan.rrd")


def test_the_hand_is_the_plans(tmp_path):
    done = run(tmp_path, {**made_up_plan(), "gripper": "slim_jaw_50"}, cloud(3))
    assert done.returncode == 0, done.stderr
    boxes = recorded(tmp_path / "plan.rrd")["/workspace/grasps/001/hand"]
    assert boxes["Boxes3D:centers"][0][0] == pytest.approx([0, -0.0275, -0.035])
    assert boxes["Boxes3D:half_sizes"][0][0] == pytest.approx([0.005, 0.0025, 0.035])
    done = run(tmp_path, {**made_up_plan(), "gripper": "three_fingers"}, cloud(3))
    assert done.returncode == 1 and "none of franka_hand, parallel_jaw_80" in done.stderr and "Traceback" not in done.stderr


def test_what_is_no_plan_or_no_cloud_is_refused(tmp_path):
    for plan, bad in [({**made_up_plan(), "format": "else"}, cloud(3)), (made_up_plan(), b"ply\n"), (made_up_plan(), cloud(3)[:-1])]:
        done = run(tmp_path, plan, bad)
        assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
