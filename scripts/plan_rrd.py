#!/usr/bin/env python3
"""Makes a Rerun recording of a plan for the Rerun viewer.

    >>> plan = graspmill.Planner().plan(depth, camera)
    >>> pathlib.Path("plan.json").write_text(plan.to_json())
    >>> numpy.save("cloud.npy", numpy.column_stack([plan.cloud(), plan.labels()]))

    python scripts/plan_rrd.py plan.json --cloud cloud.npy --out plan.rrd
    rerun plan.rrd

Needs rerun-sdk==0.36.3 (in scripts/requirements.txt). The recording shows the cloud by its labels, the objects' centroids,
the workspace, and the gripper at each grasp (green is the best, the others fade to grey; labels give rank, quality and
rho). If the plan lists dropped candidates, they are shown, too: vermilion for collisions, grey for other reasons.
"""

import argparse
import hashlib
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import rerun as rr

GRIPPERS = Path(__file__).parents[1] / "configs/grippers"
#: What is read. Before version 3 the box was a cube, `grid`, and grasps had only a width; the first of version 1 had
#: `told` in place of `detail`.
FORMATS = tuple(f"graspmill-plan/{version}" for version in (3, 2, 1))
BEST, COLLISION, GREY, INK = (0, 158, 115), (213, 94, 0), (120, 120, 120), (34, 34, 34)
#: Colours of Okabe and Ito (2008), then darker ones.
OBJECTS = [(86, 180, 233), (204, 121, 167), (240, 228, 66), (230, 159, 0), (0, 114, 178)]
OBJECTS += [(56, 118, 153), (134, 79, 110), (158, 150, 43), (151, 104, 0), (0, 75, 117)]
TABLE, NOISE = (226, 226, 226), (150, 150, 150)


def read_cloud(path: Path) -> np.ndarray:
    """Rows of x, y, z and label."""
    try:
        cloud = np.load(path)
    except (OSError, ValueError, EOFError) as error:
        raise SystemExit(f"{path}: not an NPY file: {error}") from error
    if not isinstance(cloud, np.ndarray) or cloud.ndim != 2 or cloud.shape[1] != 4:
        raise SystemExit(f"{path}: must have the columns x, y, z and label")
    return cloud


def gripper_boxes(gripper: dict, opening_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres and half lengths (3, 3) of the fingers and the palm in the grasp frame."""
    finger = np.array([gripper[f"finger_{part}_m"] for part in ("width", "thickness", "length")]) / 2
    palm = np.array([gripper[f"palm_{part}_m"] for part in ("width", "breadth", "length")]) / 2
    sideways = opening_m / 2 + finger[1]
    behind = -gripper["finger_length_m"] - palm[2]
    centres = [[0, -sideways, -finger[2]], [0, sideways, -finger[2]], [0, 0, behind]]
    return np.array(centres), np.array([finger, finger, palm])


def grasp_label(grasp: dict) -> str:
    rho = "" if grasp["rho_m"] is None else f", rho {1000 * grasp['rho_m']:.1f} mm"
    return f"{grasp['rank']}: q {grasp['quality']:.3f}{rho}"


def log_grasps(recording: rr.RecordingStream, grasps: list[dict], gripper: dict) -> None:
    for place, grasp in enumerate(grasps):
        entity = f"workspace/grasps/{grasp['rank']:03}"
        pose = grasp["workspace_from_grasp"]
        quaternion = rr.Quaternion(xyzw=pose["quaternion_xyzw"])
        recording.log(entity, rr.Transform3D(translation=pose["position_m"], quaternion=quaternion), static=True)
        colour = BEST if place == 0 else [60 + 105 * place // len(grasps)] * 3
        centres, halves = gripper_boxes(gripper, grasp["opening_m"] if "opening_m" in grasp else grasp["width_m"])
        labels = ["", "", grasp_label(grasp)]
        boxes = rr.Boxes3D(centers=centres, half_sizes=halves, colors=[colour] * 3, labels=labels, show_labels=place < 5)
        recording.log(f"{entity}/hand", boxes, static=True)
        stem = -gripper["finger_length_m"] - 1.5 * gripper["palm_length_m"]
        arrow = rr.Arrows3D(origins=[[0, 0, stem]], vectors=[[0, 0, -stem]], colors=[colour])
        recording.log(f"{entity}/approach", arrow, static=True)


def log_dropped(recording: rr.RecordingStream, dropped: list[dict]) -> None:
    places = [candidate["workspace_from_grasp"]["position_m"] for candidate in dropped]
    colours = [COLLISION if candidate["why"] == "collision" else GREY for candidate in dropped]
    points = rr.Points3D(places, colors=colours, radii=0.0015, labels=[c.get("detail", c.get("told")) for c in dropped], show_labels=False)
    recording.log("workspace/dropped", points, static=True)


def record(plan: dict, cloud: np.ndarray, gripper: dict, recording_id: str, out: Path) -> None:
    """Writes the recording."""
    recording = rr.RecordingStream("graspmill_plan", recording_id=recording_id, send_properties=False)
    recording.save(out)
    recording.log("workspace", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    region = plan.get("region") or {"low_m": [0.0] * 3, "high_m": [plan["grid"]["size_m"]] * 3}
    low, high = np.array(region["low_m"]), np.array(region["high_m"])
    box = rr.Boxes3D(centers=[(low + high) / 2], half_sizes=[(high - low) / 2], colors=[GREY])
    recording.log("workspace/box", box, static=True)
    colours = [OBJECTS[label % len(OBJECTS)] if label >= 0 else (TABLE, NOISE)[label + 2] for label in cloud[:, 3].astype(int)]
    recording.log("workspace/cloud", rr.Points3D(cloud[:, :3], colors=colours, radii=0.00125), static=True)
    centroids = [thing["centroid_m"] for thing in plan["objects"]]
    names = [f"object {number}" for number in range(len(centroids))]
    recording.log("workspace/centroids", rr.Points3D(centroids, colors=[INK], radii=0.004, labels=names), static=True)
    log_grasps(recording, plan["grasps"], gripper)
    if plan.get("dropped"):
        log_dropped(recording, plan["dropped"])
    notes = [note for note in [plan["reason"], *plan["warnings"]] if note]
    if notes:
        recording.log("notes", rr.TextDocument("\n\n".join(notes)), static=True)
    recording.flush()
    recording.disconnect()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", type=Path, help="the plan as JSON")
    parser.add_argument("--cloud", type=Path, required=True, help="its cloud with labels (NPY)")
    parser.add_argument("--out", type=Path, required=True, help="the recording (.rrd)")
    parser.add_argument("--gripper", type=Path, help="the gripper's file, if it is not among configs/grippers")
    args = parser.parse_args()
    plan = json.loads(args.plan.read_text())
    if plan.get("format") not in FORMATS:
        raise SystemExit(f"{args.plan}: format must be {' or '.join(FORMATS)}, got {plan.get('format')}")
    built_in = {path.stem: path for path in GRIPPERS.glob("*.toml")}
    file = args.gripper or built_in.get(plan["gripper"])
    if file is None:
        raise SystemExit(f"the plan is for {plan['gripper']}, none of {', '.join(sorted(built_in))}: --gripper")
    gripper = tomllib.loads(file.read_text())
    if plan["gripper"] != gripper["name"]:
        raise SystemExit(f"the plan is for {plan['gripper']}, the gripper is {gripper['name']}: --gripper")
    # The viewer merges recordings with the same id.
    recording_id = hashlib.sha256(args.plan.read_bytes() + args.cloud.read_bytes()).hexdigest()
    record(plan, read_cloud(args.cloud), gripper, recording_id, args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
