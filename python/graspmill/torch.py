"""Datasets, the paper's network and the judge for PyTorch.

Needs ``pip install graspmill[torch]``. The samples and the split are those of ``graspmill fit``.
"""

from __future__ import annotations

import json
import os
import re
from bisect import bisect_right
from typing import TYPE_CHECKING, Any, Generic, Iterator, Literal, TypedDict, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _native
from ._renamed import renamed
from .crops import cut
from .dataset import Dataset
from .errors import InputError
from .scene import OUTCOMES

try:
    import torch
    import torch.nn.functional as F
    from torch import Tensor, nn
except ImportError as error:  # pragma: no cover
    raise ImportError("graspmill.torch needs PyTorch: pip install graspmill[torch]") from error

from ._judge import Judge, judge_loss

__all__ = [
    "Batch",
    "GraspCropBatch",
    "GraspCropDataset",
    "GraspCropStream",
    "GraspDataset",
    "GraspStream",
    "Judge",
    "VoxelNetwork",
    "judge_loss",
    "loss",
]

Split = Literal["train", "test", "test-attempts", "test-scenes", "all"]

#: Numbers of the sets in the split, by their names.
_SETS = {"train": 1, "test-attempts": 2, "test-scenes": 3}


class Batch(TypedDict):
    """``B`` samples of ``S`` scenes, each with one grid.

    ``tsdf`` is ``[S, 1, 40, 40, 40]``. The others have ``B`` entries: ``scene`` (index into ``tsdf``), ``voxel``
    ``[B, 3]`` (x, y, z), ``label`` (1 if the attempt held), ``rotation`` ``[B, 4]`` (quaternion x, y, z, w), ``width``
    (opening in voxels; 0 unless the attempt held).
    """

    tsdf: Tensor
    scene: Tensor
    voxel: Tensor
    label: Tensor
    rotation: Tensor
    width: Tensor


class GraspCropBatch(TypedDict):
    """``B`` grasps as a judge sees them (:func:`graspmill.grasp_crops`).

    ``crop`` ``[B, 4, 8, 20, 28]``, ``context`` ``[B, 3, 12, 8, 8]``, ``features`` ``[B, 16]``, ``outcome`` (index into
    ``graspmill.OUTCOMES``), ``label`` (1 if the attempt held), ``hits_table`` (bool: the grasp fails for certain, so
    the judge need not be asked; the training set has no such grasps).
    """

    crop: Tensor
    context: Tensor
    features: Tensor
    outcome: Tensor
    label: Tensor
    hits_table: Tensor


class _Renamed(dict[str, Tensor]):
    """A batch that still has the old names of its entries."""

    def __missing__(self, name: str) -> Tensor:
        return cast(Tensor, renamed(name, self, "GraspCropBatch", KeyError))


_B = TypeVar("_B", Batch, GraspCropBatch)


#: Origin of a grasp in the shipped recipes: between the roots of the fingers.
ORIGIN_BEHIND_TIPS_M = 0.05


def _behind_tips_m(value: float) -> float:
    return _arrays.number("origin_behind_tips_m", value, 0.0, 0.3)


class _Samples:
    """The samples of a split, by scene: voxels, or crops of grasps."""

    def __init__(
        self,
        path: str | os.PathLike[str] | Dataset,
        split: Split,
        by: Literal["attempt", "scene"],
        test_share: float,
        other_share: float,
        seed: int,
        has_crops: bool,
        origin_behind_tips_m: float | None,
    ) -> None:
        self.has_crops = has_crops
        if has_crops and origin_behind_tips_m is not None:
            raise InputError("crops are cut at the grasp itself: origin_behind_tips_m must be left out")
        self.origin_behind_tips_m = _behind_tips_m(ORIGIN_BEHIND_TIPS_M if origin_behind_tips_m is None else origin_behind_tips_m)
        self._crops: _native.Crops | None = None
        self.dataset = path if isinstance(path, Dataset) else Dataset(path)
        if by not in ("attempt", "scene"):
            raise InputError(f"by must be 'attempt' or 'scene', got {_arrays.shown(by)}")
        shares = [_arrays.number(name, value, 1e-9, 0.45) for name, value in (("test_share", test_share), ("other_share", other_share))]
        native = self.dataset._native
        seed = _arrays.whole("seed", seed, 0, 2**63 - 1)
        self.marks: NDArray[np.uint8] = native.split(seed, by, shares, has_crops, self.origin_behind_tips_m)
        name = f"test-{by}s" if split == "test" else split
        if not isinstance(split, str) or name not in {*_SETS, "all"}:
            raise InputError(f"split must be one of train, test, test-attempts, test-scenes, all, got {_arrays.shown(split)}")
        self.wanted = self.marks > 0 if name == "all" else self.marks == _SETS[name]
        info = self.dataset.info
        self.per_scene = int(info["attempts_per_scene"])
        self.voxel_m = info["grid"]["size_m"] / info["grid"]["resolution"]
        self.side = int(info["grid"]["resolution"])

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_crops": None}

    def __len__(self) -> int:
        return int(self.wanted.sum())

    def of_scene(self, scene: int) -> NDArray[np.intp]:
        """The attempts of a scene that are in the split."""
        start = scene * self.per_scene
        return np.nonzero(self.wanted[start : start + self.per_scene])[0]

    def read(self, shard: int, scenes: list[int]) -> tuple[NDArray[np.float32], dict[tuple[int, int], int], dict[str, NDArray[Any]]]:
        """Grids of scenes of a shard, which ascend; the row of each (index of its scene, attempt); the rows."""
        grids, poses, width, numbers = self.dataset._native.samples(shard, scenes, self.has_crops, self.origin_behind_tips_m)
        held = numbers[:, 2] == OUTCOMES.index("held")
        rows = {"label": held.astype(np.float32), "pose": poses, "outcome": numbers[:, 2].astype(np.int64)}
        if self.has_crops:
            rows |= {"gripper": numbers[:, 3], "views": numbers[:, 4]}
        else:
            known = held & np.isfinite(width)
            rows["voxel"] = np.floor(poses[:, :3] / np.float32(self.voxel_m)).astype(np.int64)
            rows["width"] = np.where(known, width / np.float32(self.voxel_m), np.float32(0.0)).astype(np.float32)
        where = {(int(place), int(attempt)): row for row, (place, attempt, *_) in enumerate(numbers)}
        return grids.reshape(len(scenes), 1, self.side, self.side, self.side), where, rows

    def batch(
        self, grids: NDArray[np.float32], scene: NDArray[np.intp], rows: dict[str, NDArray[Any]], mirrored: NDArray[np.uint32]
    ) -> dict[str, Tensor]:
        """Rows in the scenes' grids as a batch. Crops are mirrored in x (1), y (2), both (3) or not (0)."""
        if self.has_crops:
            self._crops = self._crops or self.dataset._native.crops()
            numbers = np.stack([scene.astype(np.uint32), rows["gripper"], rows["views"], mirrored], axis=1)
            seen = cut(self._crops, grids, rows["pose"], numbers)
            arrays: dict[str, NDArray[Any]] = {
                "crop": np.moveaxis(seen.crop, 4, 1),
                "context": np.moveaxis(seen.context, 4, 1),
                "features": seen.features,
                "outcome": rows["outcome"],
                "label": rows["label"],
                "hits_table": seen.hits_table,
            }
        else:
            arrays = {"tsdf": grids, "scene": scene.astype(np.int64), "rotation": rows["pose"][:, 3:].copy()}
            arrays |= {name: rows[name] for name in ("voxel", "label", "width")}
        return _Renamed({name: torch.from_numpy(array) for name, array in arrays.items()})


class _Items(torch.utils.data.Dataset[dict[str, Tensor]]):
    """Samples one by one."""

    _has_crops: bool

    def __init__(
        self,
        path: str | os.PathLike[str] | Dataset,
        split: Split = "train",
        *,
        by: Literal["attempt", "scene"] = "attempt",
        test_share: float = 0.1,
        other_share: float = 0.03,
        seed: int = 1,
        origin_behind_tips_m: float | None = None,
    ) -> None:
        self._samples = _Samples(path, split, by, test_share, other_share, seed, self._has_crops, origin_behind_tips_m)
        self._places = np.nonzero(self._samples.wanted)[0]

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        if not -len(self) <= index < len(self):
            raise IndexError(index)
        scene, attempt = divmod(int(self._places[index]), self._samples.per_scene)
        dataset = self._samples.dataset
        shard = bisect_right(range(dataset.shard_count), scene, key=lambda shard: dataset._native.scenes_of(shard)[1])
        grids, where, rows = self._samples.read(shard, [scene])
        row = where[0, attempt]
        one = {name: values[row : row + 1] for name, values in rows.items()}
        batch = self._samples.batch(grids, np.zeros(1, np.intp), one, np.zeros(1, np.uint32))
        return _Renamed({name: values[0] for name, values in batch.items() if name != "scene"})


class GraspDataset(_Items):
    """Samples by index: ``tsdf`` ``[1, 40, 40, 40]``, ``voxel`` ``[3]``, ``label``, ``rotation`` ``[4]``, ``width``.

    Each item decodes a scene. :class:`GraspStream` decodes a scene once for several samples and is many times faster.

    Args:
        path: A dataset, or its folder or URL.
        split: ``"train"``, ``"test"`` (the test set that ``by`` selects), ``"test-attempts"``, ``"test-scenes"`` or
            ``"all"``.
        by: Whether the test set is of single attempts, as in the paper, or of whole scenes.
        test_share: Share of all samples in that test set.
        other_share: Share of all samples in the other test set.
        seed: Seed of the split; 1 in the trainer's recipes.
        origin_behind_tips_m: Distance of the origin of a grasp behind the finger tips, against the approach; it decides
            which voxel a grasp belongs to (``network.origin_behind_tips_m`` of a recipe). By default 0.05, as in the
            shipped recipes.
    """

    _has_crops = False


class GraspCropDataset(_Items):
    """Crops of grasps by index: the entries of :class:`GraspCropBatch` without ``B``, never mirrored.

    The arguments are those of :class:`GraspDataset`.
    """

    _has_crops = True


class _Stream(torch.utils.data.IterableDataset[_B], Generic[_B]):
    """Batches in a shuffled order: give it to ``DataLoader(stream, batch_size=None, num_workers=…)``.

    Each worker reads blocks of scenes in a seeded order and shuffles scenes in a buffer. The order depends on the seed,
    the epoch and the number of workers alone. A worker holds at most ``buffer_scenes`` grids of a quarter of a megabyte
    and a block of 64 scenes. Further arguments are those of :class:`GraspDataset`; the seed is also the order's.

    Args:
        path: A dataset, or its folder or URL (for workers and a URL: ``multiprocessing_context="spawn"``).
        split: See :class:`GraspDataset`.
        batch: Number of samples in a batch.
        samples_per_scene: The largest number of samples of a scene that stay together and share its grid; by default 8,
            or ``batch`` if that is smaller.
        buffer_scenes: Number of such groups that are shuffled with each other.
        shuffle: Whether the order is shuffled; otherwise it is the stored one.
    """

    #: Scenes that are read together.
    BLOCK = 64
    _has_crops: bool

    def __init__(
        self,
        path: str | os.PathLike[str] | Dataset,
        split: Split = "train",
        *,
        batch: int = 48,
        samples_per_scene: int | None = None,
        buffer_scenes: int = 512,
        shuffle: bool = True,
        by: Literal["attempt", "scene"] = "attempt",
        test_share: float = 0.1,
        other_share: float = 0.03,
        seed: int = 1,
        origin_behind_tips_m: float | None = None,
    ) -> None:
        self._samples = _Samples(path, split, by, test_share, other_share, seed, self._has_crops, origin_behind_tips_m)
        self.batch = _arrays.whole("batch", batch, 1, 1_000_000)
        together = min(8, self.batch) if samples_per_scene is None else samples_per_scene
        self.samples_per_scene = _arrays.whole("samples_per_scene", together, 1, self.batch)
        self.buffer_scenes = _arrays.whole("buffer_scenes", buffer_scenes, 1, 1_000_000)
        self.shuffle, self.seed, self.epoch = _arrays.flag("shuffle", shuffle), seed, 0

    def set_epoch(self, epoch: int) -> None:
        """Sets the epoch, from 0; each epoch has another order."""
        self.epoch = _arrays.whole("epoch", epoch, 0, 2**31)

    @property
    def sample_count(self) -> int:
        """Number of samples in the split."""
        return len(self._samples)

    def __iter__(self) -> Iterator[_B]:
        worker = torch.utils.data.get_worker_info()
        number, count = (0, 1) if worker is None else (worker.id, worker.num_workers)
        order = np.random.default_rng([self.seed, self.epoch])
        blocks: list[tuple[int, range]] = []
        for shard in range(self._samples.dataset.shard_count):
            first, end = self._samples.dataset._native.scenes_of(shard)
            blocks.extend((shard, range(at, min(at + self.BLOCK, end))) for at in range(first, end, self.BLOCK))
        if self.shuffle:
            order.shuffle(blocks)
        own = np.random.default_rng([self.seed, self.epoch, number])
        yield from self._joined(self._parts(blocks[number::count], own), own)

    def _parts(self, blocks: list[tuple[int, range]], own: np.random.Generator) -> Iterator[tuple[Any, Any, Any]]:
        """Grids, each with a group of its rows."""
        waiting: list[tuple[Any, Any, Any]] = []
        for shard, scenes in blocks:
            wanted = [scene for scene in scenes if len(self._samples.of_scene(scene))]
            if not wanted:
                continue
            grids, where, rows = self._samples.read(shard, wanted)
            for place, scene in enumerate(wanted):
                grid = grids[place].copy()  # a view would keep the whole block
                attempts = self._samples.of_scene(scene)
                if self.shuffle:
                    own.shuffle(attempts)
                own_rows = np.array([where[place, int(attempt)] for attempt in attempts])
                for at in range(0, len(own_rows), self.samples_per_scene):
                    waiting.append((grid, rows, own_rows[at : at + self.samples_per_scene]))
            while len(waiting) > self.buffer_scenes:
                yield waiting.pop(int(own.integers(len(waiting))) if self.shuffle else 0)
        while waiting:
            yield waiting.pop(int(own.integers(len(waiting))) if self.shuffle else 0)

    def _joined(self, parts: Iterator[tuple[Any, Any, Any]], own: np.random.Generator) -> Iterator[_B]:
        """Groups of samples as batches; the last may be smaller."""
        held: list[tuple[Any, Any, Any]] = []
        size = 0
        for grid, rows, chosen in parts:
            while size + len(chosen) >= self.batch:
                room = self.batch - size
                held.append((grid, rows, chosen[:room]))
                yield self._together(held, own)
                held, size, chosen = [], 0, chosen[room:]
            if len(chosen):
                held.append((grid, rows, chosen))
                size += len(chosen)
        if held:
            yield self._together(held, own)

    def _together(self, held: list[tuple[Any, Any, Any]], own: np.random.Generator) -> _B:
        rows = {name: np.concatenate([rows[name][chosen] for _, rows, chosen in held]) for name in held[0][1]}
        scene = np.repeat(np.arange(len(held)), [len(chosen) for *_, chosen in held])
        count = len(scene)
        is_mirrored = self._has_crops and self.shuffle
        mirrored = own.integers(0, 4, count, dtype=np.uint32) if is_mirrored else np.zeros(count, np.uint32)
        return cast(_B, self._samples.batch(np.stack([grid for grid, *_ in held]), scene, rows, mirrored))


class GraspStream(_Stream[Batch]):
    __doc__ = _Stream.__doc__
    _has_crops = False


class GraspCropStream(_Stream[GraspCropBatch]):
    """Batches of crops of grasps, as a judge sees them. A shuffled stream mirrors them at random, as the trainer does.

    The arguments are those of :class:`GraspStream`.
    """

    _has_crops = True


class VoxelNetwork(nn.Module):
    """The paper's network, which is VGN's: it predicts a quality, an orientation and an opening for every voxel.

    :meth:`load` reads the weights of ``graspmill weights export --format safetensors``; ``graspmill weights import``
    reads those of :meth:`save`.

    Args:
        upsampling: ``"linear"`` (trilinear, as in the shipped configs) or ``"nearest"``.
        origin_behind_tips_m: Distance of the origin of a grasp behind the finger tips, against the approach. Train the
            network on a :class:`GraspStream` with the same value.
        voxel_offset: Position of that origin in its voxel along each axis: 0.5, the middle, for networks trained with
            this package; 0 for VGN's weights.
    """

    def __init__(
        self,
        upsampling: Literal["linear", "nearest"] = "linear",
        *,
        origin_behind_tips_m: float = ORIGIN_BEHIND_TIPS_M,
        voxel_offset: float = 0.5,
    ) -> None:
        super().__init__()
        if upsampling not in ("linear", "nearest"):
            raise InputError(f"upsampling must be 'linear' or 'nearest', got {_arrays.shown(upsampling)}")
        self.upsampling = upsampling
        self.origin_behind_tips_m = _behind_tips_m(origin_behind_tips_m)
        self.voxel_offset = _arrays.number("voxel_offset", voxel_offset, 0.0, 1.0)

        def conv(c_in: int, c_out: int, k: int, stride: int = 1) -> nn.Conv3d:
            return nn.Conv3d(c_in, c_out, k, stride, k // 2)

        self.encoder = nn.ModuleDict({"conv1": conv(1, 16, 5, 2), "conv2": conv(16, 32, 3, 2), "conv3": conv(32, 64, 3, 2)})
        self.decoder = nn.ModuleDict({"conv1": conv(64, 64, 3), "conv2": conv(64, 32, 3), "conv3": conv(32, 16, 5)})
        self.conv_qual, self.conv_rot, self.conv_width = conv(16, 1, 5), conv(16, 4, 5), conv(16, 1, 5)

    def features(self, tsdf: Tensor) -> Tensor:
        """``[B, 1, 40, 40, 40]`` to ``[B, 16, 40, 40, 40]``."""
        x = tsdf
        for layer in self.encoder.values():
            x = F.relu(layer(x))
        for layer, size in zip(self.decoder.values(), (10, 20, 40)):
            x = F.relu(layer(x))
            x = F.interpolate(x, size, mode="trilinear", align_corners=False) if self.upsampling == "linear" else F.interpolate(x, size)
        return x

    def forward(self, tsdf: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """From TSDFs in VGN's values, ``[B, 1, 40, 40, 40]``, to quality (0 to 1, ``[B, 1, …]``), rotation (unit
        quaternion x, y, z, w, ``[B, 4, …]``) and width (voxels, ``[B, 1, …]``)."""
        x = self.features(tsdf)
        return torch.sigmoid(self.conv_qual(x)), F.normalize(self.conv_rot(x), dim=1), self.conv_width(x)

    def at(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """Quality ``[B]``, rotation ``[B, 4]`` and width ``[B]`` at the voxels of a batch."""
        i, j, k = batch["voxel"].T
        quality, rotation, width = self(batch["tsdf"])
        at = batch["scene"]
        return quality[at, 0, i, j, k], rotation[at, :, i, j, k], width[at, 0, i, j, k]

    @classmethod
    def load(cls, path: str | os.PathLike[str], upsampling: Literal["linear", "nearest"] | None = None) -> VoxelNetwork:
        """The network with the weights, the upsampling and the origin of a file.

        Args:
            path: A safetensors file of ``graspmill weights export`` or of :meth:`save`; or a state dict of
                ``torch.save``, alone or under ``"state_dict"``, ``"model_state_dict"`` or ``"model"``. That has neither
                upsampling nor origin, so VGN's are used: nearest upsampling, and the origin 50 mm behind the finger
                tips, in the lower corner of its voxel.
            upsampling: The upsampling, in place of the file's.
        """
        stated: dict[str, Any] = {}
        with open(path, "rb") as file:
            first = file.read(9)
        if first[8:] != b"{":  # safetensors: the length of a JSON header, and the header
            tensors = _state_dict(torch.load(os.fspath(path), map_location="cpu", weights_only=True))
            stated = {"upsampling": "nearest", "origin_behind_tips_m": 0.05, "voxel_offset": 0.0}
        else:
            from safetensors import safe_open

            with safe_open(os.fspath(path), "pt") as weights:
                stated = weights.metadata() or {}
                # Our checkpoints state an origin only if it is not midway between the tips.
                stated = {"origin_behind_tips_m": 0.0, **json.loads(stated["graspmill"])} if "graspmill" in stated else stated
                tensors = {name: weights.get_tensor(name) for name in weights.keys() if not name.startswith("adam.")}
        origin = {name: float(stated[name]) for name in ("origin_behind_tips_m", "voxel_offset") if name in stated}
        net = cls(upsampling or stated.get("upsampling", "linear"), **origin)
        net.load_state_dict(tensors, strict=True)
        return net

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the weights for ``graspmill weights import``."""
        from safetensors.torch import save_file

        names = ("upsampling", "origin_behind_tips_m", "voxel_offset")
        stated = {name: str(getattr(self, name)) for name in names}
        save_file({name: tensor.contiguous() for name, tensor in self.state_dict().items()}, os.fspath(path), stated)


def _state_dict(saved: Any) -> dict[str, Tensor]:
    """The tensors of a saved state dict, without the name prefixes of wrappers."""
    for name in ("state_dict", "model_state_dict", "model"):
        saved = saved.get(name, saved) if isinstance(saved, dict) else saved
    if not isinstance(saved, dict):
        raise InputError(f"the file must hold a state dict, it holds {_arrays.shown(type(saved).__name__)}")
    return {re.sub(r"^(module\.|_orig_mod\.)+", "", str(name)): tensor for name, tensor in saved.items()}


def loss(quality: Tensor, rotation: Tensor, width: Tensor, batch: Batch) -> Tensor:
    """The paper's loss (Eq. 1 to 5), a scalar: the cross-entropy of the quality and, for held grasps, the distance of
    the orientation to the grasp or its half turn, whichever is nearer, plus 0.01 times the squared error of the opening
    in voxels."""
    label, target = batch["label"], batch["rotation"]
    x, y, z, w = target.unbind(1)
    turned = torch.stack([y, -x, w, -z], dim=1)
    apart = torch.minimum(*(1.0 - (rotation * one).sum(1).abs() for one in (target, turned)))
    terms = F.binary_cross_entropy(quality, label, reduction="none") + label * apart + 0.01 * label * (width - batch["width"]) ** 2
    return terms.mean()


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        return renamed(name, globals(), __name__)
