"""MolmoSpaces' .npz."""

from __future__ import annotations

import zipfile
from typing import Any

import numpy as np

from ... import _arrays
from ...object_grasps import GRASPS_MAX, ObjectGrasps
from ._parts import Hand, about, array, good

WHAT = "an .npz with the array transforms"


def read(path: str, hand: Hand) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``. The file has no labels: its grasps held a test of theirs."""
    with zipfile.ZipFile(path) as files, files.open("transforms.npy") as file:
        poses = _arrays.rigid("transforms", array("transforms", file, (4, 4)), GRASPS_MAX)
    return {"object_from_grasp": poses, "base_to_tips_m": hand.base_to_tips_m, "info": about("molmospaces", hand.gripper)}


def write(grasps: ObjectGrasps, path: str, hand: Hand) -> None:
    """As ``graspmill objects annotate --format molmospaces``: only grasps that held."""
    with open(path, "wb") as file:
        np.savez_compressed(file, transforms=good(grasps).object_from_grasp)
