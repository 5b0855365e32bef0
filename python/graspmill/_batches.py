"""Batches of samples, and a layer."""

from typing import TypedDict

from torch import Tensor, nn


def conv(c_in: int, c_out: int, k: int, stride: int = 1) -> nn.Conv3d:
    return nn.Conv3d(c_in, c_out, k, stride, k // 2)


class _Shared(TypedDict, total=False):
    share: Tensor


class Batch(_Shared):
    """``B`` samples of ``S`` scenes: ``tsdf`` ``[S, 1, 40, 40, 40]``, and ``B`` times ``scene`` (index into it),
    ``voxel`` (x, y, z), ``label`` (1 if the attempt held), ``rotation`` (quaternion x, y, z, w) and ``width`` (opening
    in voxels; 0 unless it held). One of several ranks adds ``share`` ``[1]``: its mean loss counts times that, so that
    the mean over the ranks is the mean over all samples of the step."""

    tsdf: Tensor
    scene: Tensor
    voxel: Tensor
    label: Tensor
    rotation: Tensor
    width: Tensor


class GraspCropBatch(_Shared):
    """``B`` grasps as a judge sees them (:func:`graspmill.grasp_crops`): ``crop`` ``[B, 4, 8, 20, 28]``, ``context``
    ``[B, 3, 12, 8, 8]``, ``features`` ``[B, 16]``, ``outcome`` (index into ``graspmill.OUTCOMES``), ``label`` (1 if the
    attempt held), ``hits_table`` (bool: it fails for certain; never in training), and ``share`` as in :class:`Batch`."""

    crop: Tensor
    context: Tensor
    features: Tensor
    outcome: Tensor
    label: Tensor
    hits_table: Tensor
