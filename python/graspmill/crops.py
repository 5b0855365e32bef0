"""Grasps as a judge sees them, for networks of your own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from .grippers import GripperLike
from .scene import _simulation

#: Points of a crop along x, y and z of the grasp, and their values: distance, observed share, height above the table,
#: distance to the gripper.
CROP = (8, 20, 28, 4)
#: Points of the context, and their values: the same without the last.
CONTEXT = (12, 8, 8, 3)
#: Length of the feature vector of a grasp.
FEATURES = 16
#: The largest number of grasps in a call: 8 GB.
GRASPS_MAX = 100_000
_SIDE_MAX = 128


@dataclass(frozen=True, eq=False)
class GraspCrops:
    """Grasps as a judge sees them; 81 kB each.

    Attributes:
        crop: ``[N, 8, 20, 28, 4]`` float32: points along x, y, z of the grasp frame, in a box around what the open gripper sweeps.
            A point has the mean of the observed distances around it (in truncations, −1 to 1; 0 where nothing was observed), their
            observed share, the height above the table, and the distance to the swept gripper (both in units of 30 mm, −1 to 1).
        context: ``[N, 12, 8, 8, 3]`` float32: the first three of these values in a wider, coarser box around the tips.
        features: ``[N, 16]`` float32: the upward direction (a unit vector in the grasp frame), the height of the tips above the
            table in units of 0.1 m, the number of views divided by 6; in units of 0.1 m the opening, the fingers' length, width and
            thickness, the palm's length, width and breadth, and the approach; the friction, the force / 20 N − 1, and a 0.
        hits_table: ``[N]`` bool: the gripper hits the table on its way, so the judge need not be asked.
    """

    crop: NDArray[np.float32]
    context: NDArray[np.float32]
    features: NDArray[np.float32]
    hits_table: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.crop)


def grasp_crops(
    tsdf: ArrayLike, workspace_from_grasp: ArrayLike, *, gripper: GripperLike | None = None, views: int = 6,
    voxel_size_m: float = 0.0075, table_z_m: float = 0.05,
) -> GraspCrops:  # fmt: skip
    """Resamples a TSDF in the frame of each grasp: the input of a judge (``docs/judge.md``).

    Args:
        tsdf: ``[n, n, n]`` (x, y, z) in VGN's values, 0 to 1, of :func:`tsdf` or a stored scene; n is 8 to 128.
        workspace_from_grasp: Poses, ``[N, 4, 4]`` or ``[N, 7]``, at most 100000.
        gripper: A :class:`Gripper`, the name of a built-in one, or the path of a file; by default ``parallel_jaw_80``.
        views: The number of cameras that saw the scene, 1 to 32.
        voxel_size_m: Side of a voxel; the shipped judges were trained with 7.5 mm. ``table_z_m`` is the height of the table's top.
    """
    values = _arrays.floats("tsdf", tsdf, (None, None, None), " (x, y, z)")
    side, shape = len(values), list(values.shape)
    _arrays.must(8 <= side <= _SIDE_MAX and shape == [side] * 3, f"tsdf must be a cube of 8 to {_SIDE_MAX} voxels along a side, got {shape}")
    _arrays.vgn_values("tsdf", values)
    poses = _arrays.poses("workspace_from_grasp", workspace_from_grasp)
    _arrays.must(len(poses) <= GRASPS_MAX, f"workspace_from_grasp must be at most {GRASPS_MAX} grasps, got {len(poses)}")
    rows = np.zeros((len(poses), 4), np.uint32)
    rows[:, 2] = _arrays.whole("views", views, 1, 32)
    voxel_m, table_m = _arrays.number("voxel_size_m", voxel_size_m, 1e-4, 1.0), _arrays.number("table_z_m", table_z_m, -1.0, 1.0)
    return cut(_native.Crops(_simulation(gripper, None), side, side * voxel_m, table_m), values, poses, rows)


def cut(crops: _native.Crops, grids: _arrays.Floats, poses: _arrays.Floats, rows: NDArray[np.uint32]) -> GraspCrops:
    """Crops of poses ``[N, 7]``. ``rows`` ``[N, 4]`` has grid, gripper, number of views and mirroring."""
    (crop, context, features), hits_table = crops.see(grids.ravel(), poses, rows)
    count = len(poses)
    return GraspCrops(crop.reshape(count, *CROP), context.reshape(count, *CONTEXT), features.reshape(count, FEATURES), hits_table)
