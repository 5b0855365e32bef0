"""scripts/view_rrd.py on made-up views: the recordings can be read back."""

import json
import sys

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
