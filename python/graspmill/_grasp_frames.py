"""Frames of grasps: ours, and those of files by others (``docs/exporting.md``).

A *base frame* has its origin at the base of the hand, +z along the approach, and +x or +y along the closing direction.
Our grasp frame has +z along the approach, +y along the closing direction, and its origin midway between the tips.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from .errors import InputError

Axis = Literal["x", "y"]
Numbers = NDArray[np.float64]

#: From the origin of ACRONYM's frame to the tips, in metres: 0.11217 in its marker, 0.11225 in its mesh of the hand.
ACRONYM_BASE_TO_TIPS_M = 0.1122
#: GraspNet's centre lies this far behind the tips in the files that are written, in metres.
GRASPNET_DEPTH_M = 0.02
#: Most grasps of a set, as for ``graspmill objects annotate``.
GRASPS_MAX = 1_000_000
#: Matrices that are further from a rotation (the largest entry of RᵀR − 1) are replaced by the nearest rotation.
EXACT_OFF_MAX = 1e-6


def rigid(name: str, value: ArrayLike) -> Numbers:
    """Rigid transforms ``[N, 4, 4]`` as float64, checked; ``[0]`` is none."""
    array = _arrays.given(name, value)
    if array.shape == (0,):
        return np.empty((0, 4, 4))
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be an array of numbers, got one of dtype {array.dtype}")
    if array.ndim != 3 or array.shape[1:] != (4, 4) or len(array) > GRASPS_MAX:
        raise InputError(f"{name} must have the shape [N, 4, 4], N at most {GRASPS_MAX}, got {list(array.shape)}")
    poses = np.array(array, np.float64)
    if not np.isfinite(poses).all():
        raise InputError(f"{name} must be finite, got {int((~np.isfinite(poses)).sum())} values that are not")
    if not len(poses):
        return poses
    if (far := np.abs(poses[:, :3, 3]).max()) > _arrays.FAR_M_MAX:
        raise InputError(f"{name} must be positions in metres within {_arrays.FAR_M_MAX:g}, got {far:g}")
    turned = poses[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):  # numbers that are far too large are refused below
        off = np.abs(turned.transpose(0, 2, 1) @ turned - np.eye(3)).max(axis=(1, 2))
        off = np.maximum(off, np.abs(poses[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1))
        off = np.where(np.linalg.det(turned) > 0.0, off, np.inf)
    if not off.max() <= _arrays.RIGID_OFF_MAX:
        worst = int(off.argmax())
        told = "a reflection" if np.isinf(off[worst]) else f"{off[worst]:.3g}"
        rule = "rigid (a rotation and a translation, last row 0 0 0 1)"
        raise InputError(f"{name} must be {rule} within {_arrays.RIGID_OFF_MAX:g}, got {told} in pose {worst}")
    rough = off > EXACT_OFF_MAX  # half-precision files
    left, _, right = np.linalg.svd(turned[rough])
    turned[rough] = left @ right
    poses[:, 3] = [0.0, 0.0, 0.0, 1.0]
    return poses


def from_base(object_from_base: Numbers, base_to_tips_m: float, closing_axis: Axis) -> Numbers:
    """``object_from_grasp`` ``[N, 4, 4]`` of poses of the hand's base."""
    grasps = object_from_base.copy()
    if closing_axis == "x":  # our y = their x, our x = their −y
        grasps[:, :3, 0], grasps[:, :3, 1] = -object_from_base[:, :3, 1], object_from_base[:, :3, 0]
    grasps[:, :3, 3] += base_to_tips_m * object_from_base[:, :3, 2]
    return grasps


def to_base(object_from_grasp: Numbers, base_to_tips_m: float, closing_axis: Axis) -> Numbers:
    """Poses ``[N, 4, 4]`` of the hand's base."""
    bases = object_from_grasp.copy()
    if closing_axis == "x":  # their x = our y, their y = our −x
        bases[:, :3, 0], bases[:, :3, 1] = object_from_grasp[:, :3, 1], -object_from_grasp[:, :3, 0]
    bases[:, :3, 3] -= base_to_tips_m * object_from_grasp[:, :3, 2]
    return bases


def from_graspnet(rows: Numbers) -> Numbers:
    """``object_from_grasp`` ``[N, 4, 4]`` of GraspNet's rows ``[N, 17]``: +x approach, +y closing, tips at +depth."""
    grasps = np.tile(np.eye(4), (len(rows), 1, 1))
    theirs = rows[:, 4:13].reshape(-1, 3, 3)
    grasps[:, :3, 0], grasps[:, :3, 1], grasps[:, :3, 2] = -theirs[:, :, 2], theirs[:, :, 1], theirs[:, :, 0]
    grasps[:, :3, 3] = rows[:, 13:16] + rows[:, 3:4] * theirs[:, :, 0]
    return grasps


def to_graspnet(object_from_grasp: Numbers) -> tuple[Numbers, Numbers]:
    """GraspNet's rotations ``[N, 3, 3]`` and centres ``[N, 3]`` in metres; the tips are at ``GRASPNET_DEPTH_M``."""
    x, y, z = (object_from_grasp[:, :3, axis] for axis in range(3))
    # Theirs: x = our z, y = our y, z = our −x.
    return np.stack([z, y, -x], axis=2), object_from_grasp[:, :3, 3] - GRASPNET_DEPTH_M * z


def of_quaternions(name: str, rows: ArrayLike) -> Numbers:
    """Rigid transforms ``[N, 4, 4]`` of positions and unit quaternions x, y, z, w ``[N, 7]``, checked."""
    array = _arrays.given(name, rows)
    if array.ndim != 2 or array.shape[1] != 7 or array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be numbers of the shape [N, 7], got {array.dtype} {list(array.shape)}")
    lengths = np.linalg.norm(array[:, 3:].astype(np.float64), axis=1)
    if not (off := np.abs(lengths - 1.0) <= _arrays.RIGID_OFF_MAX).all():
        worst = int(off.argmin())
        rule = f"must have quaternions of length 1 within {_arrays.RIGID_OFF_MAX:g}"
        raise InputError(f"{name} {rule}, got {lengths[worst]:.4g} in pose {worst}")
    return rigid(name, _arrays.matrices(array))
