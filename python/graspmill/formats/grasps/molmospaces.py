"""MolmoSpaces' .npz."""

from __future__ import annotations

import zipfile
import zlib
from typing import Any

import numpy as np

from ... import _arrays
from ...errors import InputError
from ...object_grasps import GRASPS_MAX, ObjectGrasps
from . import _npy
from ._parts import Hand, about, good, stem


def read(path: str, hand: Hand) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``. The file has no labels: its grasps held a test of theirs."""
    try:
        with zipfile.ZipFile(path) as files, files.open("transforms.npy") as file:
            poses = _arrays.rigid("transforms", _npy.array("transforms", file, (4, 4)), GRASPS_MAX)
    except InputError:
        raise
    except (*_npy.BROKEN, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"the file must be an .npz with the array transforms, got {error}") from error
    info = about("molmospaces", hand.gripper)
    return {"name": stem(path), "object_from_grasp": poses, "base_to_tips_m": hand.base_to_tips_m, "info": info}


def write(grasps: ObjectGrasps, path: str, hand: Hand) -> None:
    """As ``graspmill objects annotate --format molmospaces``: only grasps that held."""
    with open(path, "wb") as file:
        np.savez_compressed(file, transforms=good(grasps).object_from_grasp)
