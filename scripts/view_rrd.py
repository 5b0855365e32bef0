#!/usr/bin/env python3
"""Makes a Rerun recording of a replay for the Rerun viewer.

    graspmill dataset replay grasps --attempt 17/3 --json --out attempt.json
    python scripts/view_rrd.py attempt.json --out attempt.rrd
    rerun attempt.rrd

Needs rerun-sdk==0.36.3 (in scripts/requirements.txt). Bodies are meshes that move on the timeline `time`; lines and points appear
and disappear on it. Events are in the text log, other facts in a document. Green means held, vermilion failed.

This is a script because the crate `rerun` 0.36.3 with only its feature `sdk` resolves to 487 packages. 162 of them are not in the
workspace, among them a second arrow (58 beside 60) and clients for gRPC and analytics. Users of recordings have the viewer, and
this package contains it.
"""

import argparse
import hashlib
import json
import sys
from pathlib import Path

import numpy as np
import rerun as rr

FORMAT = "graspmill-view/1"
TIMELINE = "time"
GREEN, VERMILION, GREY = (0, 158, 115), (213, 94, 0), (120, 130, 140)
# Colours of the page's script (report/src/viewer.js); other outcomes are grey.
COLOURS = {
    "object": (186, 196, 205),
    "target": (86, 180, 233),
    "hit": (230, 159, 0),
    "gripper": (92, 102, 112),
    "held": GREEN,
    "slipped": VERMILION,
    "hit_other": VERMILION,
    "empty": VERMILION,
    "approach_collision": VERMILION,
    "pregrasp_collision": VERMILION,
    "contact": (240, 228, 66),
    "surface": (0, 114, 178),
    "table": (200, 204, 208),
    "container": (160, 164, 168, 90),
}
RADII_M = {"contact": 0.002, "surface": 0.0012}
LEVELS = {"phase": "INFO", "note": "DEBUG", "held": "INFO", "failed": "WARN"}


def triangles(body: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners, normals and triangles of flat faces: each face has its own corners, so that edges stay sharp."""
    corners, places, normals, found = np.array(body["corners_m"]), [], [], []
    for face in body["faces"]:
        a, b, c = corners[face[:3]]
        normal = np.cross(b - a, c - b)
        first = len(places)
        places += [corners[corner] for corner in face]
        normals += [normal / np.linalg.norm(normal)] * len(face)
        found += [[first, first + k, first + k + 1] for k in range(1, len(face) - 1)]
    return np.array(places), np.array(normals), np.array(found)


def log_body(recording: rr.RecordingStream, entity: str, body: dict, times_s: list[float]) -> None:
    places, normals, found = triangles(body)
    colour = COLOURS.get(body["class"], GREY)
    mesh = rr.Mesh3D(vertex_positions=places, vertex_normals=normals, triangle_indices=found, albedo_factor=colour)
    recording.log(entity, mesh, static=True)
    poses = np.array(body["poses"])
    if len(poses) == 1:
        place = rr.Transform3D(translation=poses[0, :3], quaternion=rr.Quaternion(xyzw=poses[0, 3:]))
        recording.log(entity, place, static=True)
        return
    moves = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, 3:])
    recording.send_columns(entity, indexes=[rr.TimeColumn(TIMELINE, duration=times_s)], columns=moves)


def log_when(recording: rr.RecordingStream, entity: str, thing, frames: list[int] | None, times_s: list[float]) -> None:
    """Logs an entity from the first to the last of `frames`, or for the whole recording."""
    if frames is None:
        recording.log(entity, thing, static=True)
        return
    first, last = frames
    recording.set_time(TIMELINE, duration=times_s[first])
    recording.log(entity, thing)
    if last + 1 < len(times_s):
        recording.set_time(TIMELINE, duration=times_s[last + 1])
        recording.log(entity, rr.Clear(recursive=False))
    recording.reset_time()


def record(view: dict, recording_id: str, out: Path) -> None:
    """Writes the recording."""
    recording = rr.RecordingStream("graspmill_view", recording_id=recording_id, send_properties=False)
    recording.save(out)
    times_s = [frame["time_s"] for frame in view["frames"]]
    recording.log("workspace", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for number, body in enumerate(view["bodies"]):
        log_body(recording, f"workspace/{body['class']}/{number:03}", body, times_s)
    for number, line in enumerate(view["lines"]):
        strip = rr.LineStrips3D([line["points_m"]], colors=[COLOURS.get(line["class"], GREY)], labels=[line["label"]], show_labels=False)
        log_when(recording, f"workspace/{line['class']}/{number:03}", strip, line["frames"], times_s)
    for number, points in enumerate(view["points"]):
        radius = RADII_M.get(points["class"], 0.0015)
        labels = [points["label"]] if points["class"] == "contact" else None
        cloud = rr.Points3D(
            points["points_m"], colors=COLOURS.get(points["class"], GREY), radii=radius, labels=labels, show_labels=False
        )
        log_when(recording, f"workspace/{points['class']}/{number:03}", cloud, points["frames"], times_s)
    for event in view["events"]:
        if times_s:
            recording.set_time(TIMELINE, duration=times_s[event["frame"]])
        recording.log("events", rr.TextLog(event["text"], level=LEVELS[event["kind"]]), static=not times_s)
    recording.reset_time()
    facts = "\n".join(f"| {fact['key']} | {fact['value']} |" for fact in view["facts"])
    text = f"# {view['title']}\n\n| | |\n|---|---|\n{facts}\n"
    recording.log("facts", rr.TextDocument(text, media_type="text/markdown"), static=True)
    recording.flush()
    recording.disconnect()


def read_view(path: Path) -> dict:
    try:
        view = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise SystemExit(f"{path}: no view: {error}") from error
    if not isinstance(view, dict) or view.get("format") != FORMAT:
        raise SystemExit(f"{path}: format must be {FORMAT}, got {view.get('format') if isinstance(view, dict) else view!r}")
    return view


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("view", type=Path, help="what `graspmill dataset replay --json` wrote")
    parser.add_argument("--out", type=Path, required=True, help="the recording (.rrd)")
    args = parser.parse_args()
    view = read_view(args.view)
    # The viewer merges recordings with the same id.
    record(view, hashlib.sha256(args.view.read_bytes()).hexdigest(), args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
