"""Real captures without poses: the table, and the best grasps against the sensors' own points.

    GRASPMILL_REAL=folder python -m pytest tests/python/test_real.py

The folder has captures.json and depth images in units of 0.1 mm; docs/results/real.md says where they come from."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")

FOLDER = os.environ.get("GRASPMILL_REAL")
pytestmark = pytest.mark.skipif(not FOLDER, reason="GRASPMILL_REAL must name the folder of the real captures")

BEST = 5
#: The way on which a gripper comes, and what belongs to the table, in metres.
WAY_M, TABLE_M = 0.05, 0.008
#: Pixels that may be noise in the gripper, and fewest of what it closes on.
NOISE_PX, HELD_PX = 15, 20
#: A mug and a bowl, whose rims are thinner than this.
HOLLOW, RIM_M = ("rs-blue-mug", "rs-green-bowl"), 0.02
#: The only warnings that are right of these captures.
RIGHT = ("the border of the image cuts things within reach", "only ")


class Capture:
    """A capture, and its points above the table in the camera's frame."""

    def __init__(self, row):
        self.name = row["name"]
        self.plane = np.array([*row["table_normal"], row["table_offset_m"]]) / np.linalg.norm(row["table_normal"])
        self.depth_m = np.asarray(Image.open(Path(FOLDER) / f"{self.name}-depth.png")).astype(np.float32) * np.float32(1e-4)
        fx, fy, cx, cy = row["fx_fy_cx_cy"]
        self.camera = graspmill.Camera.from_K([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], self.depth_m.shape)
        z = self.depth_m.astype(float)
        v, u = np.indices(z.shape)
        points = np.stack([(u - cx) * z / fx, (v - cy) * z / fy, z], axis=-1)
        things = (z > 0.05) & (z < 2.5) & (points @ self.plane[:3] + self.plane[3] > TABLE_M)
        labels = Path(FOLDER) / f"{self.name}-label.png"
        self.points_m = points[things]
        self.labels = np.asarray(Image.open(labels))[things] if labels.exists() else np.zeros(len(self.points_m))

    def has_table(self, plan):
        """Whether the workspace stands on its table, within 3 mm and 1 degree."""
        up, height_m = plan.workspace_from_camera[2, :3], plan.workspace_from_camera[2, 3] - plan.answer["region"]["table_z_m"]
        middle_m = np.median(self.points_m, axis=0)
        on_table_m = middle_m - self.plane[:3] * (self.plane[:3] @ middle_m + self.plane[3])
        return up @ self.plane[:3] > np.cos(np.radians(1.0)) and abs(up @ on_table_m + height_m) < 0.003

    def judge(self, grasp, gripper):
        """Whether a grasp is clean, and both ends of what is seen between its fingers, from its middle."""
        x, y, z = (np.linalg.inv(grasp.camera_from_grasp) @ np.c_[self.points_m, np.ones(len(self.points_m))].T)[:3]
        beside, half_m = abs(x) < gripper.finger_width_m / 2, gripper.opening_m_max / 2
        in_fingers = beside & (abs(y) > half_m) & (abs(y) < half_m + gripper.finger_thickness_m) & (z < 0) & (z > -gripper.finger_length_m - WAY_M)
        in_palm = (abs(x) < gripper.palm_width_m / 2) & (abs(y) < gripper.palm_breadth_m / 2) & (z < -gripper.finger_length_m)
        in_palm &= z > -gripper.finger_length_m - gripper.palm_length_m - WAY_M
        held = beside & (abs(y) < half_m) & (z < 0) & (z > -gripper.finger_length_m)
        objects = np.unique(self.labels[held & (self.labels >= 2)])
        is_clean = (in_fingers | in_palm).sum() <= NOISE_PX and held.sum() >= HELD_PX and len(objects) <= 1
        low_m, high_m = np.percentile(y[held], [2, 98]) if held.sum() >= HELD_PX else (0.0, 0.0)
        return is_clean, (low_m, high_m)


def test_the_best_grasps_of_real_captures_are_clean():
    captures = [Capture(row) for row in json.loads((Path(FOLDER) / "captures.json").read_text())]
    gripper = graspmill.Gripper.load("franka_hand")
    planner = graspmill.Planner(gripper=gripper)
    tables, offered, widths, off_rim_m, wrong = 0, [], [], [], []
    for capture in captures:
        plan = planner.plan(capture.depth_m, capture.camera)
        tables += capture.has_table(plan)
        wrong += [f"{capture.name}: {said}" for said in plan.warnings if not said.startswith(RIGHT)]
        for rank, grasp in enumerate(plan[:BEST], 1):
            is_clean, (low_m, high_m) = capture.judge(grasp, gripper)
            offered.append((is_clean, f"{capture.name} {rank}"))
            widths.append((grasp.width_m, high_m - low_m, f"{capture.name} {rank}"))
            if capture.name in HOLLOW and 0 < high_m - low_m < RIM_M:
                off_rim_m.append(abs(low_m + high_m) / 2)
    told = [(width_m > seen_m - 0.005, name) for width_m, seen_m, name in widths if width_m is not None]
    unclean, narrow = ([name for is_right, name in rows if not is_right] for rows in (offered, told))
    print(f"{tables} tables, {len(offered)} offered, not clean {unclean}, {len(told)} widths told, too narrow {narrow}")
    print(f"{len(off_rim_m)} grasps of rims, beside their middle by a median of {1e3 * np.median(off_rim_m):.1f} mm")
    assert tables == len(captures) == 25
    assert len(off_rim_m) >= BEST and np.median(off_rim_m) <= 0.005, off_rim_m
    assert not wrong
    assert len(offered) >= 0.95 * BEST * len(captures) and len(unclean) <= 0.02 * len(offered), unclean
    assert len(told) >= 0.7 * len(offered) and len(narrow) <= 0.02 * len(told), narrow
