"""GraspNet's rows of 17 numbers: +x is the approach, +y the closing direction, the tips lie at +depth."""

from typing import Any

import numpy as np

from ... import _arrays
from ...object_grasps import GRASPS_MAX, ObjectGrasps
from ._parts import GripperFrame, about, array, good, part

WHAT = "an .npy of NumPy"
#: Its centre lies this far behind the tips in the files that are written, in metres.
DEPTH_M = 0.02
#: Its height of a gripper whose fingers' width is not known, in metres, as in its labels.
HEIGHT_M = 0.02
#: Its score is this less the smallest friction coefficient.
SCORE = 1.1


def read(path: str, given: GripperFrame) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``. Poses keep the frame of the file, which is a camera's for scenes."""
    with open(path, "rb") as file:
        rows = np.asarray(array("the array", file, (17,)), np.float64)
    _arrays.must(np.isfinite(rows).all(), f"the array must be finite, got {int((~np.isfinite(rows)).sum())} values that are not")
    grasps, theirs = np.tile(np.eye(4), (len(rows), 1, 1)), rows[:, 4:13].reshape(-1, 3, 3)
    # Our x = their −z, our y = their y, our z = their x.
    grasps[:, :3, :3] = np.stack([-theirs[:, :, 2], theirs[:, :, 1], theirs[:, :, 0]], axis=2)
    grasps[:, :3, 3] = rows[:, 13:16] + rows[:, 3:4] * theirs[:, :, 0]
    heights_m = np.unique(rows[:, 2])
    height_m = float(heights_m[0]) if len(heights_m) == 1 else None
    return {
        "object_from_grasp": _arrays.rigid("the rotations", grasps, GRASPS_MAX),
        "score": rows[:, 0],
        "width_m": np.where(rows[:, 1] > 0.0, rows[:, 1], np.nan),
        "base_to_tips_m": given.base_to_tips_m,
        "info": about("graspnet", {"finger_width_m": height_m, **given.gripper}),
    }


def write(grasps: ObjectGrasps, path: str, given: GripperFrame) -> None:
    """Only grasps that held. Without a friction the score is ``p_held``, the set's or 1; 0 if none sufficed."""
    kept = good(grasps)
    rows = np.zeros((len(kept), 17))
    other = np.where(np.isnan(kept.score) | (grasps.held is not None), 1.0, kept.score)
    other = np.where(np.isnan(kept.p_held), other, kept.p_held)
    other = np.where(np.isnan(kept.tug_max_g), other, 0.0)
    rows[:, 0] = np.where(np.isnan(kept.friction_min), other, np.maximum(SCORE - kept.friction_min, 0.0))
    rows[:, 1] = np.nan_to_num(kept.width_m)
    width_m = part(grasps, "gripper").get("finger_width_m", HEIGHT_M)
    rows[:, 2] = _arrays.number("info.gripper.finger_width_m", width_m, 0.0, 10.0)
    rows[:, 3] = DEPTH_M
    x, y, z = (kept.object_from_grasp[:, :3, axis] for axis in range(3))
    rows[:, 4:13] = np.stack([z, y, -x], axis=2).reshape(-1, 9)
    rows[:, 13:16] = kept.object_from_grasp[:, :3, 3] - DEPTH_M * z
    rows[:, 16] = -1.0
    with open(path, "wb") as file:
        np.save(file, rows)
