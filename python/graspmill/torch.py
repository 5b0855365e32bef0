"""For PyTorch: datasets that read shards, and the paper's network.

Needs ``pip install graspmill[torch]``. What is trained on is what ``graspmill fit`` trains on: the same samples, the same split.
"""

from __future__ import annotations

import json
import os
import re
from typing import Any, Generic, Iterator, Literal, TypedDict, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _native
from .dataset import Dataset
from .errors import InputError
from .hands import CROP, FACTS, SURROUNDINGS
from .scene import OUTCOMES

try:
    import torch
    import torch.nn.functional as F
    from torch import Tensor, nn
except ImportError as error:  # pragma: no cover
    raise ImportError("graspmill.torch needs PyTorch: pip install graspmill[torch]") from error

Split = Literal["train", "test", "test-attempts", "test-scenes", "all"]

#: Numbers of the sets in the split, by their names.
_SETS = {"train": 1, "test-attempts": 2, "test-scenes": 3}


class Batch(TypedDict):
    """Samples of some scenes; each scene's grid is there once.

    ``tsdf`` is ``[S, 1, 40, 40, 40]``; of the others each has ``B`` entries: ``scene`` (index into ``tsdf``), ``voxel`` ``[B, 3]`` (x, y,
    z), ``label`` (1 if the attempt held), ``rotation`` ``[B, 4]`` (quaternion x, y, z, w), ``width`` (opening in voxels; 0 unless held).
    """

    tsdf: Tensor
    scene: Tensor
    voxel: Tensor
    label: Tensor
    rotation: Tensor
    width: Tensor


class HandBatch(TypedDict):
    """Hands as a judge sees them (:func:`graspmill.hand_crops`), ``B`` of them.

    ``crop`` ``[B, 4, 8, 20, 28]``, ``surroundings`` ``[B, 3, 12, 8, 8]``, ``facts`` ``[B, 16]``, ``outcome`` (index into
    ``graspmill.OUTCOMES``), ``label`` (1 if the attempt held), ``hits_table`` (bool: it fails for certain, and there is nothing to ask; none of
    these is in the training set).
    """

    crop: Tensor
    surroundings: Tensor
    facts: Tensor
    outcome: Tensor
    label: Tensor
    hits_table: Tensor


_B = TypeVar("_B", Batch, HandBatch)


#: Where the shipped recipes have the origin of a grasp: between the roots of the fingers.
ORIGIN_BEHIND_TIPS_M = 0.05


def _behind_tips_m(value: float) -> float:
    return _arrays.number("origin_behind_tips_m", value, 0.0, 0.3)


class _Samples:
    """The samples of a split, by scene: of voxels, or of hands."""

    def __init__(
        self,
        path: str | os.PathLike[str] | Dataset,
        split: Split,
        by: Literal["attempt", "scene"],
        test_share: float,
        other_share: float,
        seed: int,
        of_hands: bool,
        origin_behind_tips_m: float | None,
    ) -> None:
        self.of_hands = of_hands
        if of_hands and origin_behind_tips_m is not None:
            raise InputError("a judge is asked about a grasp as it is: origin_behind_tips_m must be left out")
        self.origin_behind_tips_m = _behind_tips_m(ORIGIN_BEHIND_TIPS_M if origin_behind_tips_m is None else origin_behind_tips_m)
        self._crops: _native.Crops | None = None
        self.dataset = path if isinstance(path, Dataset) else Dataset(path)
        if by not in ("attempt", "scene"):
            raise InputError(f"by must be 'attempt' or 'scene', got {_arrays.shown(by)}")
        shares = [_arrays.number(name, value, 1e-9, 0.45) for name, value in (("test_share", test_share), ("other_share", other_share))]
        native = self.dataset._native
        self.marks: NDArray[np.uint8] = native.split(_arrays.whole("seed", seed, 0, 2**63 - 1), by, shares, of_hands, self.origin_behind_tips_m)
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
        """The attempts of a scene that are wanted."""
        start = scene * self.per_scene
        return np.nonzero(self.wanted[start : start + self.per_scene])[0]

    def read(self, shard: int, scenes: list[int]) -> tuple[NDArray[np.float32], dict[tuple[int, int], int], dict[str, NDArray[Any]]]:
        """Grids of scenes of a shard, ascending; the row of each (place of its scene, attempt); the rows."""
        grids, poses, width, numbers = self.dataset._native.samples(shard, scenes, self.of_hands, self.origin_behind_tips_m)
        held = numbers[:, 2] == OUTCOMES.index("held")
        rows = {"label": held.astype(np.float32), "pose": poses, "outcome": numbers[:, 2].astype(np.int64)}
        if self.of_hands:
            rows |= {"hand": numbers[:, 3], "views": numbers[:, 4]}
        else:
            known = held & np.isfinite(width)
            rows["voxel"] = np.floor(poses[:, :3] / np.float32(self.voxel_m)).astype(np.int64)
            rows["width"] = np.where(known, width / np.float32(self.voxel_m), np.float32(0.0)).astype(np.float32)
        where = {(int(place), int(attempt)): row for row, (place, attempt, *_) in enumerate(numbers)}
        return grids.reshape(len(scenes), 1, self.side, self.side, self.side), where, rows

    def voxels(self, grids: NDArray[np.float32], scene: NDArray[np.intp], rows: dict[str, NDArray[Any]]) -> Batch:
        """Rows as samples of voxels of the scenes' grids."""
        return Batch(
            tsdf=torch.from_numpy(grids),
            scene=torch.from_numpy(scene.astype(np.int64)),
            voxel=torch.from_numpy(rows["voxel"]),
            label=torch.from_numpy(rows["label"]),
            rotation=torch.from_numpy(rows["pose"][:, 3:].copy()),
            width=torch.from_numpy(rows["width"]),
        )

    def hands(
        self, grids: NDArray[np.float32], scene: NDArray[np.intp], rows: dict[str, NDArray[Any]], mirrored: NDArray[np.uint32]
    ) -> HandBatch:
        """Rows as hands in the scenes' grids, mirrored in x (1), y (2), both (3) or not (0)."""
        if self._crops is None:
            self._crops = self.dataset._native.crops()
        numbers = np.stack([scene.astype(np.uint32), rows["hand"], rows["views"], mirrored], axis=1)
        (crop, surroundings, facts), hits_table = self._crops.see(grids.ravel(), rows["pose"], numbers)
        count = len(numbers)
        return HandBatch(
            crop=torch.from_numpy(crop.reshape(count, *CROP)).permute(0, 4, 1, 2, 3),
            surroundings=torch.from_numpy(surroundings.reshape(count, *SURROUNDINGS)).permute(0, 4, 1, 2, 3),
            facts=torch.from_numpy(facts.reshape(count, FACTS)),
            outcome=torch.from_numpy(rows["outcome"]),
            label=torch.from_numpy(rows["label"]),
            hits_table=torch.from_numpy(hits_table),
        )


class _Items(torch.utils.data.Dataset[dict[str, Tensor]]):
    """Samples one by one."""

    _of_hands: bool

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
        self._samples = _Samples(path, split, by, test_share, other_share, seed, self._of_hands, origin_behind_tips_m)
        self._places = np.nonzero(self._samples.wanted)[0]

    def __len__(self) -> int:
        return len(self._places)

    def _row(self, index: int) -> tuple[NDArray[np.float32], dict[str, NDArray[Any]]]:
        if not -len(self) <= index < len(self):
            raise IndexError(index)
        scene, attempt = divmod(int(self._places[index]), self._samples.per_scene)
        grids, where, rows = self._samples.read(_shard_of(self._samples.dataset, scene), [scene])
        row = where[0, attempt]
        return grids, {name: values[row : row + 1] for name, values in rows.items()}


class GraspDataset(_Items):
    """Samples one by one, at random places: a grid ``tsdf`` ``[1, 40, 40, 40]``, ``voxel`` ``[3]``, ``label``, ``rotation`` ``[4]``, ``width``.

    Each item decodes a scene; :class:`GraspStream` decodes a scene once for several samples and is many times faster.

    Args:
        path: A dataset, its folder or URL.
        split: ``"train"``, ``"test"`` (the set that ``by`` names), ``"test-attempts"``, ``"test-scenes"`` or ``"all"``.
        by: Whether single attempts are *the* test set, as the paper does, or whole scenes.
        test_share: Share of all samples in that test set.
        other_share: Share in the other one.
        seed: Seed of the split; the trainer's recipes have 1.
        origin_behind_tips_m: Where the network has the origin of a grasp, and so which voxel answers for it: so far behind the finger tips,
            against the approach (``network.origin_behind_tips_m`` of a recipe); 0.05, as the shipped recipes, if left out.
    """

    _of_hands = False

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        grids, row = self._row(index)
        batch = self._samples.voxels(grids, np.zeros(1, np.intp), row)
        return {"tsdf": batch["tsdf"][0], **{name: batch[name][0] for name in ("voxel", "label", "rotation", "width")}}


class HandDataset(_Items):
    """Hands one by one, as a judge sees them in the dataset's grids: the entries of :class:`HandBatch` without ``B``. None is mirrored.

    Args: those of :class:`GraspDataset`.
    """

    _of_hands = True

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        grids, row = self._row(index)
        batch = self._samples.hands(grids, np.zeros(1, np.intp), row, np.zeros(1, np.uint32))
        return {name: values[0] for name, values in batch.items()}  # type: ignore[index]


def _shard_of(dataset: Dataset, scene: int) -> int:
    low, high = 0, dataset.shard_count - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if dataset._native.scenes_of(middle)[1] <= scene else (low, middle)
    return low


class _Stream(torch.utils.data.IterableDataset[_B], Generic[_B]):
    """Batches in a shuffled order: give it to ``DataLoader(stream, batch_size=None, num_workers=…)``.

    A seeded order of blocks of scenes, read one after the other by each worker; scenes are shuffled within a buffer. The order is a pure
    function of the seed, the epoch and the number of workers. A worker holds at most ``buffer_scenes`` grids, a quarter of a megabyte each, and a
    block of 64 scenes.

    Args:
        path: A dataset, its folder or URL (of a URL with workers: ``multiprocessing_context="spawn"``).
        split: See :class:`GraspDataset`.
        batch: Samples in a batch.
        samples_per_scene: Most samples of a scene that stay together and share its grid; by default 8, or the batch if that is smaller.
        buffer_scenes: How many such groups are shuffled with each other.
        shuffle: Whether the order is shuffled; otherwise as stored.
        by, test_share, other_share, seed, origin_behind_tips_m: See :class:`GraspDataset`; the seed is also that of the order.
    """

    #: Scenes that are read together.
    BLOCK = 64
    _of_hands: bool

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
        self._samples = _Samples(path, split, by, test_share, other_share, seed, self._of_hands, origin_behind_tips_m)
        self.batch = _arrays.whole("batch", batch, 1, 1_000_000)
        together = min(8, self.batch) if samples_per_scene is None else samples_per_scene
        self.samples_per_scene = _arrays.whole("samples_per_scene", together, 1, self.batch)
        self.buffer_scenes = _arrays.whole("buffer_scenes", buffer_scenes, 1, 1_000_000)
        self.shuffle, self.seed, self.epoch = bool(shuffle), seed, 0

    def set_epoch(self, epoch: int) -> None:
        """The epoch, from 0: each has another order."""
        self.epoch = _arrays.whole("epoch", epoch, 0, 2**31)

    @property
    def sample_count(self) -> int:
        """Samples of the split."""
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
        """Each scene's grid with some of its rows."""
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
        """Parts of scenes as batches; the last may be smaller."""
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
        return self._batch(np.stack([grid for grid, *_ in held]), scene, rows, own)

    def _batch(self, grids: NDArray[np.float32], scene: NDArray[np.intp], rows: dict[str, NDArray[Any]], own: np.random.Generator) -> _B:
        raise NotImplementedError


class GraspStream(_Stream[Batch]):
    __doc__ = _Stream.__doc__
    _of_hands = False

    def _batch(self, grids: NDArray[np.float32], scene: NDArray[np.intp], rows: dict[str, NDArray[Any]], own: np.random.Generator) -> Batch:
        return self._samples.voxels(grids, scene, rows)


class HandStream(_Stream[HandBatch]):
    """The same for hands, as a judge sees them (:class:`HandBatch`); a shuffled stream mirrors them at random, as the trainer does.

    Args: those of :class:`GraspStream`.
    """

    _of_hands = True

    def _batch(
        self, grids: NDArray[np.float32], scene: NDArray[np.intp], rows: dict[str, NDArray[Any]], own: np.random.Generator
    ) -> HandBatch:
        count = len(rows["label"])
        mirrored = own.integers(0, 4, count, dtype=np.uint32) if self.shuffle else np.zeros(count, np.uint32)
        return self._samples.hands(grids, scene, rows, mirrored)


class VoxelNetwork(nn.Module):
    """The paper's network, which is VGN's: for every voxel a quality, an orientation and an opening.

    ``load_state_dict(..., strict=True)`` takes the tensors of ``graspmill weights export --format safetensors`` (:meth:`load`), and
    ``graspmill weights import`` takes a saved state dict (:meth:`save`).

    Args:
        upsampling: ``"linear"`` (trilinear, the shipped configs) or ``"nearest"``.
        origin_behind_tips_m: Where it has the origin of a grasp: so far behind the finger tips, against the approach. Train it on a
            :class:`GraspStream` with the same.
        voxel_offset: Place of that origin in its voxel along each axis: 0.5, the middle, for networks trained here; 0 for VGN's weights.
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
        """From TSDFs in VGN's values, ``[B, 1, 40, 40, 40]``, to quality (0 to 1, ``[B, 1, …]``), rotation (unit quaternion x, y, z, w,
        ``[B, 4, …]``) and width (voxels, ``[B, 1, …]``)."""
        x = self.features(tsdf)
        return torch.sigmoid(self.conv_qual(x)), F.normalize(self.conv_rot(x), dim=1), self.conv_width(x)

    def at(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """Quality ``[B]``, rotation ``[B, 4]`` and width ``[B]`` at a batch's voxels."""
        i, j, k = batch["voxel"].T
        quality, rotation, width = self(batch["tsdf"])
        at = batch["scene"]
        return quality[at, 0, i, j, k], rotation[at, :, i, j, k], width[at, 0, i, j, k]

    @classmethod
    def load(cls, path: str | os.PathLike[str], upsampling: Literal["linear", "nearest"] | None = None) -> VoxelNetwork:
        """The network with the weights of a file, and with the upsampling and the origin that the file names.

        Args:
            path: A safetensors file, of ``graspmill weights export`` or of :meth:`save`; or a state dict of ``torch.save``, alone or under
                ``"state_dict"``, ``"model_state_dict"`` or ``"model"``, which names nothing and so is taken as VGN's: nearest upsampling,
                the origin 50 mm behind the tips in its voxel's lower corner.
            upsampling: In place of what the file names.
        """
        said: dict[str, Any] = {}
        with open(path, "rb") as file:
            first = file.read(9)
        if first[8:] != b"{":  # safetensors: the length of a JSON header, and the header
            tensors = _state_dict(torch.load(os.fspath(path), map_location="cpu", weights_only=True))
            said = {"upsampling": "nearest", "origin_behind_tips_m": 0.05, "voxel_offset": 0.0}
        else:
            from safetensors import safe_open

            with safe_open(os.fspath(path), "pt") as weights:
                said = weights.metadata() or {}
                # Our checkpoints name an origin that is not midway between the tips.
                said = {"origin_behind_tips_m": 0.0, **json.loads(said["graspmill"])} if "graspmill" in said else said
                tensors = {name: weights.get_tensor(name) for name in weights.keys() if not name.startswith("adam.")}
        origin = {name: float(said[name]) for name in ("origin_behind_tips_m", "voxel_offset") if name in said}
        net = cls(upsampling or said.get("upsampling", "linear"), **origin)
        net.load_state_dict(tensors, strict=True)
        return net

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the weights for ``graspmill weights import``."""
        from safetensors.torch import save_file

        names = ("upsampling", "origin_behind_tips_m", "voxel_offset")
        said = {name: str(getattr(self, name)) for name in names}
        save_file({name: tensor.contiguous() for name, tensor in self.state_dict().items()}, os.fspath(path), said)


def _state_dict(saved: Any) -> dict[str, Tensor]:
    """The tensors of a saved state dict, without the prefixes of wrappers."""
    for name in ("state_dict", "model_state_dict", "model"):
        saved = saved.get(name, saved) if isinstance(saved, dict) else saved
    if not isinstance(saved, dict):
        raise InputError(f"the file must hold a state dict, it holds {_arrays.shown(type(saved).__name__)}")
    return {re.sub(r"^(module\.|_orig_mod\.)+", "", str(name)): tensor for name, tensor in saved.items()}


def loss(quality: Tensor, rotation: Tensor, width: Tensor, batch: Batch) -> Tensor:
    """The paper's loss (Eq. 1 to 5), a number: cross-entropy of quality; of held grasps the distance of the orientation to the grasp or its
    half turn, whichever is nearer, and 0.01 times the squared difference of the opening in voxels."""
    label, target = batch["label"], batch["rotation"]
    x, y, z, w = target.unbind(1)
    turned = torch.stack([y, -x, w, -z], dim=1)
    apart = torch.minimum(*(1.0 - (rotation * one).sum(1).abs() for one in (target, turned)))
    terms = F.binary_cross_entropy(quality, label, reduction="none") + label * apart + 0.01 * label * (width - batch["width"]) ** 2
    return terms.mean()
