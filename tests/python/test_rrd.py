"""scripts/view_rrd.py and scripts/plan_rrd.py on made-up views and plans: the recordings can be read back."""

import json
import sys

import numpy as np
import pyarrow as pa
import pytest
from programs import ROOT, ran

pytest.importorskip("rerun", reason="rerun-sdk is not installed: pip install rerun-sdk==0.36.3")
from rerun.experimental import RrdReader  # noqa: E402

# A pyramid on a square: four triangles and a face of four corners.
CORNERS_M = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]]
FACES = [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


def body(label, poses, kind="object"):
    return {"class": kind, "label": label, "corners_m": CORNERS_M, "faces": FACES, "poses": poses}


def made_up_view(frames=3):
    moving = [[0.1 * k, 0, 0, 0, 0, 0, 1] for k in range(frames)] or [[0, 0, 0, 0, 0, 0, 1]]
    return {
        "format": "graspmill-view/1",
        "title": "made up",
        "bodies": [body("stands", [[0.3, 0.2, 0.1, 0, 0, 1, 0]], "table"), body("moves", moving, "target")],
        "lines": [{"class": "held", "label": "attempt 3", "points_m": [[0, 0, 0], [0, 0, 1], [0, 1, 1]], "frames": None}],
        "points": [
            {"class": "surface", "label": "", "points_m": [[0, 0, 0.5], [0, 0, 0.6]], "frames": None},
            {"class": "contact", "label": "left finger and object 0: 20 N", "points_m": [[0, 0, 1]], "frames": [0, 0] if frames else None},
        ],
        "frames": [{"time_s": 0.25 * k} for k in range(frames)],
        "events": [{"frame": 0, "kind": "phase", "text": "close"}, {"frame": max(frames - 1, 0), "kind": "held", "text": "held, 4 mm"}],
        "facts": [{"key": "seed", "value": "42"}],
        "hidden": [],
    }


def recorded(folder, name, *words):
    """What a script records: rows by entity and column, in the order of recording; times in nanoseconds."""
    ran(sys.executable, ROOT / "scripts" / f"{name}_rrd.py", *words, "--out", "made.rrd", cwd=folder, timeout=120)
    found = {}
    for chunk in RrdReader(folder / "made.rrd").stream():
        columns, batch = found.setdefault(chunk.entity_path, {}), chunk.to_record_batch()
        for column_name, column in zip(batch.schema.names, batch.columns):
            rows = column.cast(pa.int64()) if pa.types.is_temporal(column.type) else column
            columns.setdefault(column_name, []).extend(rows.to_pylist())
    return found


def refused(folder, name, *words):
    return ran(sys.executable, ROOT / "scripts" / f"{name}_rrd.py", *words, "--out", "made.rrd", cwd=folder, code=1).stderr


def viewed(folder, view):
    (folder / "view.json").write_text(json.dumps(view))
    return recorded(folder, "view", "view.json")


def test_a_replay_can_be_read_back(tmp_path):
    found = viewed(tmp_path, made_up_view())
    stands, moves = found["/workspace/table/000"], found["/workspace/target/001"]
    # One triangle for a triangle, two for a face of four corners; corners are not shared between faces.
    assert len(moves["Mesh3D:triangle_indices"][0]) == 6 and len(moves["Mesh3D:vertex_positions"][0]) == 16
    down = moves["Mesh3D:vertex_normals"][0][0]
    assert down == pytest.approx([0, 0, -1]), "the base looks down"
    assert stands["Transform3D:translation"][0][0] == pytest.approx([0.3, 0.2, 0.1])
    assert stands["Transform3D:quaternion"][0][0] == pytest.approx([0, 0, 1, 0])
    places = [row[0] for row in moves["Transform3D:translation"] if row]
    assert places == [pytest.approx([0.1 * k, 0, 0]) for k in range(3)]
    times_s = [1e-9 * time for time in moves["time"] if time is not None]
    assert times_s == pytest.approx([0, 0.25, 0.5])
    assert found["/workspace/held/000"]["LineStrips3D:labels"][0] == ["attempt 3"]
    assert len(found["/workspace/surface/000"]["Points3D:positions"][0]) == 2
    contact = found["/workspace/contact/001"]
    assert contact["Points3D:labels"][0] == ["left finger and object 0: 20 N"]
    assert any(name.startswith("Clear") for name in contact), "it goes when its frame is over"
    assert [row[0] for row in found["/events"]["TextLog:text"]] == ["close", "held, 4 mm"]
    assert "| seed | 42 |" in found["/facts"]["TextDocument:text"][0][0]


def test_a_scene_at_rest_needs_no_timeline(tmp_path):
    found = viewed(tmp_path, made_up_view(frames=0))
    assert {"/workspace/table/000", "/workspace/target/001", "/workspace/contact/001", "/events"} <= found.keys()
    assert not any("time" in columns for columns in found.values())


def test_what_is_no_view_is_refused(tmp_path):
    for view in ["no JSON", "[]", json.dumps({**made_up_view(), "format": "graspmill-plan/1"})]:
        (tmp_path / "view.json").write_text(view)
        assert "view.json" in refused(tmp_path, "view", "view.json")


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
        "dropped": [{**common, "why": "collision", "detail": "hits", "workspace_from_grasp": pose(0.2, 0.2, 0.1), "quality": 0.9}],
    }


def written(folder, plan, points=3):
    """The words for a plan with a cloud of so many points."""
    cloud = np.zeros((points, 4))
    cloud[:, 0], cloud[:, 3] = np.linspace(0, 0.3, points), np.arange(points) % 14 - 2
    np.save(folder / "cloud.npy", cloud)
    (folder / "plan.json").write_text(json.dumps(plan))
    return "plan.json", "--cloud", "cloud.npy"


def planned(folder, plan, points=3):
    return recorded(folder, "plan", *written(folder, plan, points))


def test_a_plan_can_be_read_back(tmp_path):
    found = planned(tmp_path, made_up_plan(), 500)
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
    found = planned(tmp_path, plan)
    assert found["/workspace/box"]["Boxes3D:centers"][0][0] == pytest.approx([0.15] * 3)
    assert found["/workspace/grasps/001/hand"]["Boxes3D:centers"][0][0] == pytest.approx([0, -0.025, -0.025])


def test_a_plan_without_grasps_is_a_recording_too(tmp_path):
    assert "/notes" in planned(tmp_path, made_up_plan() | {"grasps": [], "objects": [], "dropped": [], "reason": "nothing was seen"}, 0)


def test_the_gripper_is_the_plans(tmp_path):
    boxes = planned(tmp_path, made_up_plan() | {"gripper": "slim_jaw_50"})["/workspace/grasps/001/hand"]
    assert boxes["Boxes3D:centers"][0][0] == pytest.approx([0, -0.0275, -0.035])
    assert boxes["Boxes3D:half_sizes"][0][0] == pytest.approx([0.005, 0.0025, 0.035])


def test_what_is_no_plan_or_no_cloud_is_refused(tmp_path):
    words = written(tmp_path, made_up_plan() | {"gripper": "three_fingers"})
    assert "none of franka_hand, parallel_jaw_80" in refused(tmp_path, "plan", *words)
    refused(tmp_path, "plan", *written(tmp_path, made_up_plan() | {"format": "else"}))
    words, cloud = written(tmp_path, made_up_plan()), tmp_path / "cloud.npy"
    for bad in (cloud.read_bytes()[:-1], b"ply\n"):
        cloud.write_bytes(bad)
        refused(tmp_path, "plan", *words)
