"""What a judge sees of hands, for networks of others."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from .errors import InputError
from .scene import _laws

#: Points of a crop along x, y and z of the grasp, and the values of each: distance, observed share, height over the
#: table, distance to the hand.
CROP = (8, 20, 28, 4)
#: Points of the surroundings, and the values of each: the same without the last.
SURROUNDINGS = (12, 8, 8, 3)
#: Numbers that are known of a hand besides.
FACTS = 16
_SIDE_MAX = 128


@dataclass(frozen=True, eq=False)
class HandCrops:
    """Hands as a judge sees them.

    Attributes:
        crop: ``[N, 8, 20, 28, 4]`` float32: points along x, y, z of the grasp frame, in a box about what the open hand sweeps.
        surroundings: ``[N, 12, 8, 8, 3]`` float32: a wider, coarser box about the tips.
        facts: ``[N, 16]`` float32: where up is for the hand, the height of its tips, the number of views, the hand's dimensions.
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
    gripper: str | os.PathLike[str] | None = None,
    views: int = 6,
) -> HandCrops:
    """What the judge sees of hands in a scene (``docs/judge.md``): the TSDF resampled in each hand's frame.

    Args:
        tsdf: ``[n, n, n]`` (x, y, z) in VGN's values, 0 to 1, in voxels of 7.5 mm: of :func:`graspmill.tsdf` or a stored scene.
        workspace_from_grasp: Poses, ``[N, 4, 4]`` or ``[N, 7]``.
        gripper: A built-in hand or the path of a hand's file; by default ``parallel_jaw_80``.
        views: How many cameras saw the scene, 1 to 32.

    Raises:
        InputError: If an argument has another shape or is no pose.
    """
    side = np.shape(tsdf)[0] if np.ndim(tsdf) == 3 else 40
    if not 8 <= side <= _SIDE_MAX:
        raise InputError(f"tsdf must have 8 to {_SIDE_MAX} voxels along a side, got {side}")
    values = _arrays.floats("tsdf", tsdf, (side, side, side), " (x, y, z)")
    poses = _arrays.poses("workspace_from_grasp", workspace_from_grasp)
    rows = np.zeros((len(poses), 4), np.uint32)
    rows[:, 2] = _arrays.whole("views", views, 1, 32)
    seen = _native.Crops(_laws(gripper, None), side)
    (crop, surroundings, facts), hits = seen.see(values.ravel(), poses, rows)
    count = len(poses)
    return HandCrops(crop.reshape(count, *CROP), surroundings.reshape(count, *SURROUNDINGS), facts.reshape(count, FACTS), hits)
