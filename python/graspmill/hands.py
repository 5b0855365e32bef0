"""What a judge sees of hands, for networks of others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from .errors import InputError
from .grippers import GripperLike
from .scene import _simulation

#: Points of a crop along x, y and z of the grasp, and the values of each: distance, observed share, height over the
#: table, distance to the hand.
CROP = (8, 20, 28, 4)
#: Points of the surroundings, and the values of each: the same without the last.
SURROUNDINGS = (12, 8, 8, 3)
#: Numbers that are known of a hand besides.
FACTS = 16
#: Most hands of a call: 8 GB.
HANDS_MAX = 100_000
_SIDE_MAX = 128


@dataclass(frozen=True, eq=False)
class HandCrops:
    """Hands as a judge sees them; 81 kB each.

    Attributes:
        crop: ``[N, 8, 20, 28, 4]`` float32: points along x, y, z of the grasp frame, in a box about what the open hand sweeps. Of each the
            mean of the observed distances about it (in truncations, −1 to 1; 0 where nothing was observed), the share of them that was
            observed, the height over the table, and the distance to the swept hand (these two in units of 30 mm, −1 to 1).
        surroundings: ``[N, 12, 8, 8, 3]`` float32: a wider, coarser box about the tips; the first three of these values.
        facts: ``[N, 16]`` float32: where up is for the hand (a unit vector in the grasp frame), the height of its tips over the table (in
            units of 0.1 m), the number of views over 6, then in units of 0.1 m the opening, the fingers' length, width and thickness, the
            palm's length, width and breadth, and the distance of the approach; the friction, the force over 20 N less 1, and a 0.
        hits_table: ``[N]`` bool: the hand hits the table on its way, so that there is nothing to ask.
    """

    crop: NDArray[np.float32]
    surroundings: NDArray[np.float32]
    facts: NDArray[np.float32]
    hits_table: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.crop)


def hand_crops(
    tsdf: ArrayLike,
    workspace_from_grasp: ArrayLike,
    *,
    gripper: GripperLike | None = None,
    views: int = 6,
    voxel_size_m: float = 0.0075,
    table_z_m: float = 0.05,
) -> HandCrops:
    """What the judge sees of hands in a scene (``docs/judge.md``): the TSDF resampled in each hand's frame.

    Args:
        tsdf: ``[n, n, n]`` (x, y, z) in VGN's values, 0 to 1: of :func:`graspmill.tsdf` or a stored scene; n is 8 to 128.
        workspace_from_grasp: Poses, ``[N, 4, 4]`` or ``[N, 7]``, at most 100000.
        gripper: A :class:`Gripper`, a built-in one's name, or a file's path; by default ``parallel_jaw_80``.
        views: How many cameras saw the scene, 1 to 32.
        voxel_size_m: Side of a voxel; the shipped judges were trained with 7.5 mm.
        table_z_m: Height of the table's top.

    Raises:
        InputError: If an argument has another shape or is no pose.
    """
    values = _arrays.floats("tsdf", tsdf, (None, None, None), " (x, y, z)")
    side = len(values)
    if not 8 <= side <= _SIDE_MAX or values.shape != (side, side, side):
        raise InputError(f"tsdf must be a cube of 8 to {_SIDE_MAX} voxels along a side, got {list(values.shape)}")
    _arrays.vgn_values("tsdf", values)
    poses = _arrays.poses("workspace_from_grasp", workspace_from_grasp)
    if len(poses) > HANDS_MAX:
        raise InputError(f"workspace_from_grasp must be at most {HANDS_MAX} hands, got {len(poses)}")
    rows = np.zeros((len(poses), 4), np.uint32)
    rows[:, 2] = _arrays.whole("views", views, 1, 32)
    voxel_m, table_m = _arrays.number("voxel_size_m", voxel_size_m, 1e-4, 1.0), _arrays.number("table_z_m", table_z_m, -1.0, 1.0)
    seen = _native.Crops(_simulation(gripper, None), side, side * voxel_m, table_m)
    (crop, surroundings, facts), hits = seen.see(values.ravel(), poses, rows)
    count = len(poses)
    return HandCrops(crop.reshape(count, *CROP), surroundings.reshape(count, *SURROUNDINGS), facts.reshape(count, FACTS), hits)
