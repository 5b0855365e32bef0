"""Batches of samples, and a layer."""

from typing import TypedDict

from torch import Tensor, nn


def conv(c_in: int, c_out: int, k: int, stride: int = 1) -> nn.Conv3d:
    return nn.Conv3d(c_in, c_out, k, stride, k // 2)


class _Shared(TypedDict, total=False):
    share: Tensor


class Batch(_Shared):
    """``B`` samples of ``S`` scenes, each with one grid.

    ``tsdf`` is ``[S, 1, 40, 40, 40]``. The others have ``B`` entries: ``scene`` (index into ``tsdf``), ``voxel``
    ``[B, 3]`` (x, y, z), ``label`` (1 if the attempt held), ``rotation`` ``[B, 4]`` (quaternion x, y, z, w), ``width``
    (opening in voxels; 0 unless the attempt held). A stream of one of several ranks adds ``share`` ``[1]``: times it, a
    rank's mean loss counts for its samples, so that the mean over the ranks is that over all samples of the step.
    """

    tsdf: Tensor
    scene: Tensor
    voxel: Tensor
    label: Tensor
    rotation: Tensor
    width: Tensor


class GraspCropBatch(_Shared):
    """``B`` grasps as a judge sees them (:func:`graspmill.grasp_crops`).

    ``crop`` ``[B, 4, 8, 20, 28]``, ``context`` ``[B, 3, 12, 8, 8]``, ``features`` ``[B, 16]``, ``outcome`` (index into
    ``graspmill.OUTCOMES``), ``label`` (1 if the attempt held), ``hits_table`` (bool: the grasp fails for certain, so
    the judge need not be asked; the training set has no such grasps), and ``share`` as in :class:`Batch`.
    """

    crop: Tensor
    context: Tensor
    features: Tensor
    outcome: Tensor
    label: Tensor
    hits_table: Tensor
