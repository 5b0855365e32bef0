"""MolmoSpaces' .npz."""

import zipfile
from typing import Any

import numpy as np

from ... import _arrays
from ...object_grasps import GRASPS_MAX, ObjectGrasps
from ._parts import GripperFrame, about, array, good

WHAT = "an .npz with the array transforms"


def read(path: str, given: GripperFrame) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``. The file has no labels: its grasps held a test of theirs."""
    with zipfile.ZipFile(path) as files, files.open("transforms.npy") as file:
        poses = _arrays.rigid("transforms", array("transforms", file, (4, 4)), GRASPS_MAX)
    return {"object_from_grasp": poses, "base_to_tips_m": given.base_to_tips_m, "info": about("molmospaces", given.gripper)}


def write(grasps: ObjectGrasps, path: str, given: GripperFrame) -> None:
    with open(path, "wb") as file:
        np.savez_compressed(file, transforms=good(grasps).object_from_grasp)
