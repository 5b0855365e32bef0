"""Judges grasps without Graspmill: a judge exported to ONNX, asked through onnxruntime and NumPy.

    graspmill weights export models/judge.safetensors --format onnx --out judge.onnx
    python scripts/judge_onnx.py judge.onnx scene.npy plan.json --views 6

`scene.npy` is a TSDF in VGN's values, [40, 40, 40] or [1, 40, 40, 40]; `plan.json` has the grasps, as `graspmill plan`
or `[{"position_m": [x, y, z], "quaternion_xyzw": [x, y, z, w]}, …]` gives them: poses in the workspace, +z the approach,
+y the closing direction, the origin midway between the tips. Prints the probability of each outcome.

This file is also the definition of what the network is given (`Judge.crop`, `Judge.surroundings`, `Judge.facts`), as plain as it can be
written; docs/judge.md explains it.
"""

import argparse
import json
import sys
import tomllib
from pathlib import Path

import numpy as np

OUTCOMES = ["pregrasp_collision", "approach_collision", "empty", "slipped", "hit_other", "held"]
BOX = (8, 20, 28)  # points along x, y, z of the grasp frame
CLIP_M = 0.03
BEYOND_M = 0.02
WIDE_BOX = (12, 8, 8)  # points of the surroundings …
WIDE_M = np.array([0.088, 0.06, 0.06])  # … and how far they reach from the tips


def rotation(quaternion_xyzw):
    """The matrix of a unit quaternion."""
    x, y, z, w = np.asarray(quaternion_xyzw, dtype=np.float64)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def gripper_boxes(gripper):
    """Two fingers and the palm of the open gripper in the grasp frame: (centre, half side) each, in metres."""
    gap, length = 0.5 * gripper["opening_m_max"], gripper["finger_length_m"]
    thick, wide = gripper["finger_thickness_m"], gripper["finger_width_m"]
    half_finger = np.array([wide, thick, length]) / 2
    fingers = [(np.array([0, side * (gap + thick / 2), -length / 2]), half_finger) for side in (-1, 1)]
    palm = np.array([gripper["palm_width_m"], gripper["palm_breadth_m"], gripper["palm_length_m"]]) / 2
    return [*fingers, (np.array([0, 0, -length - palm[2]]), palm)]


def lattice(low, high, count):
    """[x, y, z, 3]: so many points along each axis, the corners included."""
    axes = [np.linspace(low[axis], high[axis], count[axis]) for axis in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


class Judge:
    """A judge and the gripper and grid that it was trained for."""

    def __init__(self, path, gripper=None):
        import onnxruntime

        self.session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        scope = json.loads(self.session.get_modelmeta().custom_metadata_map["trained_for"])
        if gripper is None and "hands" in scope:
            raise SystemExit("the judge was trained for many grippers: give yours with --gripper")
        self.gripper, self.grid = gripper or scope["gripper"], scope["grid"]
        self.way_m = scope["pregrasp_distance_m"]
        # What the gripper sweeps from its pre-grasp pose: each box, longer towards −z.
        back = np.array([0, 0, self.way_m / 2])
        self.swept = [(centre - back, half + back) for centre, half in gripper_boxes(self.gripper)]
        low = np.min([centre - half for centre, half in self.swept], axis=0)
        high = np.max([centre + half for centre, half in self.swept], axis=0) + [0, 0, BEYOND_M]
        self.points_m = lattice(low, high, BOX)
        self.wide_m = lattice(-WIDE_M, WIDE_M, WIDE_BOX)
        self.to_gripper_m = np.min([self.distance_m(centre, half) for centre, half in self.swept], axis=0)

    def distance_m(self, centre, half):
        """Signed distance of the points to a box."""
        off = np.abs(self.points_m - centre) - half
        return np.linalg.norm(np.maximum(off, 0), axis=-1) + np.minimum(off.max(axis=-1), 0)

    def seen(self, tsdf, points_m, position_m, turn):
        """Three values a point: mean of the observed distances, observed share, height over the table."""
        side = self.grid["size_m"] / self.grid["resolution"]
        at_m = points_m @ turn.T + position_m
        padded = np.pad(tsdf, 1)  # nobody observed what lies around the grid
        place = np.clip(at_m / side + 0.5, 0, padded.shape[0] - 1 - 1e-3)
        low = place.astype(int)
        part = place - low
        share, total = np.zeros(at_m.shape[:3]), np.zeros(at_m.shape[:3])
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, part, 1 - part), axis=-1)
            value = padded[tuple((low + corner)[..., axis] for axis in range(3))]
            share += weight * (value > 0)
            total += weight * value
        known = share > 1e-3
        mean = np.where(known, 2 * total / np.where(known, share, 1) - 1, 0)
        height = np.clip((at_m[..., 2] - self.grid["table_z_m"]) / CLIP_M, -1, 1)
        return np.stack([mean, np.where(known, share, 0), height])

    def crop(self, tsdf, position_m, turn):
        """[4, 8, 20, 28]: what is seen where the gripper sweeps, and the distance to what it sweeps."""
        distance = np.clip(self.to_gripper_m / CLIP_M, -1, 1)
        return np.concatenate([self.seen(tsdf, self.points_m, position_m, turn), distance[None]])

    def surroundings(self, tsdf, position_m, turn):
        """[3, 12, 8, 8]: what is seen about the tips, wider and coarser."""
        return self.seen(tsdf, self.wide_m, position_m, turn)

    def facts(self, position_m, turn, views):
        """[16]: where up is for the gripper, the height of its tips, the number of views, its dimensions."""
        lengths = [
            "opening_m_max",
            "finger_length_m",
            "finger_width_m",
            "finger_thickness_m",
            "palm_length_m",
            "palm_width_m",
            "palm_breadth_m",
        ]
        height_m = position_m[2] - self.grid["table_z_m"]
        own = [*(self.gripper[key] / 0.1 for key in lengths), self.way_m / 0.1]
        own += [self.gripper["friction"], self.gripper["finger_force_n"] / 20 - 1]
        known = [*turn[2], height_m / 0.1, views / 6, *own]
        return np.pad(known, (0, 16 - len(known)))

    def outcomes(self, tsdf, grasps, views, mirrored=(False, False)):
        """[grasps, 6]: the probabilities of the outcomes of grasps, given as (position, quaternion).

        Gripper and scene may be mirrored in the grasp's x and y. The planner takes the mean over the four for its best
        grasps.
        """
        poses = [(np.asarray(position, dtype=np.float64), rotation(turn)) for position, turn in grasps]
        crops = np.array([self.crop(tsdf, *pose) for pose in poses], dtype=np.float32)
        wide = np.array([self.surroundings(tsdf, *pose) for pose in poses], dtype=np.float32)
        facts = np.array([self.facts(*pose, views) for pose in poses], dtype=np.float32)
        for axis in np.flatnonzero(mirrored):
            crops, wide = (np.flip(seen, axis=2 + axis) for seen in (crops, wide))
            facts[:, axis] *= -1
        inputs = {"crop": np.ascontiguousarray(crops), "surroundings": np.ascontiguousarray(wide), "facts": facts}
        return self.session.run(["outcomes"], inputs)[0]


def grasps_of(path):
    """The grasps in a file, as (position, quaternion)."""
    with open(path, encoding="utf-8") as file:
        listed = json.load(file)
    if isinstance(listed, dict):
        listed = [grasp["workspace_from_grasp"] for grasp in listed["grasps"]]
    return [(pose["position_m"], pose["quaternion_xyzw"]) for pose in listed]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("judge", help="a judge in ONNX")
    parser.add_argument("tsdf", help="NPY file of the scene's TSDF")
    parser.add_argument("grasps", help="JSON file of grasps, or a plan")
    parser.add_argument("--views", type=int, default=6, help="number of views from which the TSDF was made")
    parser.add_argument("--gripper", help="the gripper's file, for a judge of many grippers")
    arguments = parser.parse_args()
    gripper = arguments.gripper and tomllib.loads(Path(arguments.gripper).read_text(encoding="utf-8"))
    judge = Judge(arguments.judge, gripper)
    tsdf = np.load(arguments.tsdf).reshape([judge.grid["resolution"]] * 3)
    grasps = grasps_of(arguments.grasps)
    if not grasps:
        sys.exit("no grasps: " + arguments.grasps)
    print("  ".join(["grasp", *OUTCOMES]))
    for number, row in enumerate(judge.outcomes(tsdf, grasps, arguments.views)):
        print(f"{number:5}  " + "  ".join(f"{value:{len(name)}.3f}" for name, value in zip(OUTCOMES, row)))


if __name__ == "__main__":
    main()
