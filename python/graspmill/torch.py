"""Datasets, the paper's network and the judge for PyTorch (``pip install graspmill[torch]``): the trainer's samples and split."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
from typing import Any, Generic, Iterator, Literal, Mapping, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _native
from ._order import Block, Drawn, Numbers, Order
from .crops import cut
from .dataset import Dataset
from .errors import InputError
from .scene import OUTCOMES

try:
    import torch
    import torch.distributed
    from torch import Tensor
    from torch.utils.data._utils.collate import default_collate_fn_map
except ImportError as error:  # pragma: no cover
    raise ImportError("graspmill.torch needs PyTorch: pip install graspmill[torch]") from error

from ._batches import Batch, GraspCropBatch
from ._judge import Judge, judge_loss
from ._voxel_network import ORIGIN_BEHIND_TIPS_M, VoxelNetwork, behind_tips_m, loss

__all__ = ["Batch", "GraspCropBatch", "GraspCropStream", "GraspStream", "Judge", "VoxelNetwork", "judge_loss", "loss"]

Split = Literal["train", "test", "test-attempts", "test-scenes", "all"]

#: Numbers of the sets in the split, by their names.
_SETS = {"train": 1, "test-attempts": 2, "test-scenes": 3}


class _Made(dict[str, Tensor]):
    """A batch, of which a DataLoader can make no larger one."""


def _refuse(*_: Any, **__: Any) -> Any:
    raise InputError("batch_size must be None, for a stream gives batches: DataLoader(stream, batch_size=None)")


default_collate_fn_map[_Made] = _refuse

_B = TypeVar("_B", Batch, GraspCropBatch)
#: A scene's grid, the rows of its block, and the row of each of its attempts.
_Kept = tuple[NDArray[np.float32], dict[str, NDArray[Any]], dict[int, int]]


class _Samples:
    """The samples of a split, by scene: voxels, or crops of grasps."""

    def __init__(
        self, path: str | os.PathLike[str] | Dataset, split: Split, by: Literal["attempt", "scene"], test_share: float,
        other_share: float, seed: int, has_crops: bool, origin_behind_tips_m: float | None,
    ) -> None:  # fmt: skip
        self.has_crops = has_crops
        _arrays.must(not has_crops or origin_behind_tips_m is None, "crops are cut at the grasp itself: origin_behind_tips_m must be left out")
        self.origin_behind_tips_m = behind_tips_m(ORIGIN_BEHIND_TIPS_M if origin_behind_tips_m is None else origin_behind_tips_m)
        self._crops: _native.Crops | None = None
        self.dataset = path if isinstance(path, Dataset) else Dataset(path)
        _arrays.one_of("by", by, ("attempt", "scene"))
        _arrays.one_of("split", split, ("train", "test", "test-attempts", "test-scenes", "all"))
        shares = [_arrays.number(name, value, 1e-9, 0.45) for name, value in (("test_share", test_share), ("other_share", other_share))]
        native = self.dataset._native
        seed = _arrays.whole("seed", seed, 0, 2**63 - 1)
        self.marks: NDArray[np.uint8] = native.split(seed, by, shares, has_crops, self.origin_behind_tips_m)
        self.wanted = self.marks > 0 if split == "all" else self.marks == _SETS[f"test-{by}s" if split == "test" else split]
        info = self.dataset.info
        self.per_scene, self.side = int(info["attempts_per_scene"]), int(info["grid"]["resolution"])
        self.voxel_m = info["grid"]["size_m"] / self.side

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_crops": None}

    def __len__(self) -> int:
        return int(self.wanted.sum())

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

    def batch(self, grids: NDArray[np.float32], scene: NDArray[np.intp], rows: dict[str, NDArray[Any]], mirrored: NDArray[np.uint32]) -> dict[str, Tensor]:
        """Rows in the scenes' grids as a batch. Crops are mirrored in x (1), y (2), both (3) or not (0)."""
        if self.has_crops:
            self._crops = self._crops or self.dataset._native.crops()
            numbers = np.stack([scene.astype(np.uint32), rows["gripper"], rows["views"], mirrored], axis=1)
            seen = cut(self._crops, grids, rows["pose"], numbers)
            arrays: dict[str, NDArray[Any]] = {name: np.moveaxis(getattr(seen, name), 4, 1) for name in ("crop", "context")}
            arrays |= {"features": seen.features, "outcome": rows["outcome"], "label": rows["label"], "hits_table": seen.hits_table}
        else:
            arrays = {"tsdf": grids, "scene": scene.astype(np.int64), "rotation": rows["pose"][:, 3:].copy()}
            arrays |= {name: rows[name] for name in ("voxel", "label", "width")}
        return {name: torch.from_numpy(array) for name, array in arrays.items()}


class _Stream(torch.utils.data.IterableDataset[_B], Generic[_B]):
    """Batches in a shuffled or the stored order: give it to ``DataLoader(stream, batch_size=None, num_workers=…)``. ``sample_count`` is
    the number of samples in the split, of all ranks.

    Each worker reads blocks of 64 scenes in an order of the seed, the epoch and the number of workers, and shuffles them in a buffer.

    **Several ranks.** Where ``torch.distributed`` is initialised, or with ``rank`` and ``world_size``, an epoch has every sample
    once over all ranks, and every rank has the same number of steps: batches differ by a sample or so, and their ``share`` says how
    much a rank's mean loss counts. Each rank reads its own shards or scenes, and all must have the same number of workers. With
    ``global_batch`` the batches are the same for every number of ranks and workers.

    Args:
        path: A dataset, or its folder or URL (for workers and a URL: ``multiprocessing_context="spawn"``).
        split: ``"train"``, ``"test"`` (the test set that ``by`` selects), ``"test-attempts"``, ``"test-scenes"`` or ``"all"``.
        batch: Number of samples in a batch; of several ranks, in that of a rank.
        samples_per_scene: The most samples of a scene that stay together and share its grid; by default 8, or ``batch`` if smaller.
        buffer_scenes: Number of such groups that are shuffled with each other.
        by: Whether the test set is of single attempts, as in the paper, or of whole scenes.
        test_share: Share of all samples in that test set, and ``other_share`` in the other one.
        seed: Seed of the split (1 in the trainer's recipes) and of the order.
        origin_behind_tips_m: From a grasp's origin, whose voxel it belongs to, to the finger tips; by default 0.05, as in recipes.
        rank: The number of this rank, from 0, of ``world_size``; by default as ``torch.distributed`` has them, if initialised.
        global_batch: Whether ``batch`` is that of all ranks together, who take a slice each. Ranks then read scenes of all shards.

    Raises InputError if a rank would have no sample at a step."""

    _has_crops: bool

    def __init__(
        self, path: str | os.PathLike[str] | Dataset, split: Split = "train", *, batch: int = 48,
        samples_per_scene: int | None = None, buffer_scenes: int = 512, shuffle: bool = True,
        by: Literal["attempt", "scene"] = "attempt", test_share: float = 0.1, other_share: float = 0.03, seed: int = 1,
        origin_behind_tips_m: float | None = None, rank: int | None = None, world_size: int | None = None,
        global_batch: bool = False,
    ) -> None:  # fmt: skip
        self._samples = _Samples(path, split, by, test_share, other_share, seed, self._has_crops, origin_behind_tips_m)
        self.sample_count = len(self._samples)
        self.batch = _arrays.whole("batch", batch, 1, 1_000_000)
        together = min(8, self.batch) if samples_per_scene is None else samples_per_scene
        self.samples_per_scene = _arrays.whole("samples_per_scene", together, 1, self.batch)
        self.buffer_scenes = _arrays.whole("buffer_scenes", buffer_scenes, 1, 1_000_000)
        self.shuffle, self.global_batch = _arrays.flag("shuffle", shuffle), _arrays.flag("global_batch", global_batch)
        self.seed = seed
        self._owner: int | None = None  # the process that shares where a pass begins with its workers, in memory
        self._is_kept = False  # by a worker that has begun a pass
        self._begin(0, 0, None)
        place = _place(rank, world_size)
        self.rank, self.world_size = place or (0, 1)
        self._is_one_of_several = place is not None or self.global_batch

    @property
    def _order(self) -> Order:
        native, samples = self._samples.dataset._native, self._samples
        # The last scene may have fewer attempts than the others.
        missing = -len(samples.wanted) % samples.per_scene
        wanted = np.pad(samples.wanted, (0, missing)).reshape(-1, samples.per_scene)
        return Order(
            [native.scenes_of(shard) for shard in range(samples.dataset.shard_count)], wanted, self.batch,
            together=self.samples_per_scene, buffer=self.buffer_scenes, shuffle=self.shuffle,
            is_mirrored=self._has_crops and self.shuffle, seed=self.seed, rank=self.rank, ranks=self.world_size,
            is_even=self._is_one_of_several, is_shared=self.global_batch,
        )  # fmt: skip

    def set_epoch(self, epoch: int, step: int = 0) -> None:
        """Sets the epoch, from 0, and the step at which it begins; each epoch has another order."""
        self._begin(_arrays.whole("epoch", epoch, 0, 2**31), _arrays.whole("step", step, 0, 2**31), None)

    def _begin(self, epoch: int, step: int, workers: int | None) -> None:
        """Sets where the next pass begins, also for workers that were started before (``persistent_workers``)."""
        self.epoch, self.step, self._workers = epoch, step, workers
        if self._owner != os.getpid():  # a copy of the stream in another process goes its own way
            place = torch.empty(3, dtype=torch.int64)
            self._owner, self._shared = os.getpid(), place.share_memory_()  # type: ignore[no-untyped-call]
        self._shared.copy_(torch.tensor([epoch, step, -1 if workers is None else workers]))

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        # A copy that is no worker's has memory of its own.
        self._owner = self._owner if self._shared.is_shared() else None

    def steps(self, workers: int = 0) -> int:
        """Number of steps of the epoch with so many workers; it is the same on every rank."""
        workers = _arrays.whole("workers", workers, 0, 1024)
        return len(self._order.turns(self.epoch, max(workers, 1))[0].size)

    def state_dict(self, step: int, workers: int = 0) -> dict[str, Any]:
        """Where the stream is after so many steps of its epoch, numbers and texts, for a checkpoint. ``step`` counts the batches
        that were used; a DataLoader with this ``num_workers`` has read more."""
        place = {"step": _arrays.whole("step", step, 0, 2**31), "workers": _arrays.whole("workers", workers, 0, 1024)}
        return {"epoch": self.epoch, **place, **self._identity()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Goes on where a stream was: the next pass begins after the steps that were done, and reads no others. Between
        epochs, and with ``global_batch``, the numbers of ranks and workers may be others than before. Raises InputError
        if the state is of another stream: it names the difference."""
        own = {**self._identity(), "epoch": 0, "step": 0, "workers": 0}
        if not isinstance(state, Mapping) or set(state) != set(own):
            raise InputError(f"state must be that of state_dict, with {', '.join(sorted(own))}, got {_arrays.shown(state)}")
        for name, value in self._identity().items():
            if (had := state[name]) != value and (name != "ranks" or state["step"]):
                raise InputError(f"state must be of the same order: {name} must be {_arrays.shown(value)}, got {_arrays.shown(had)}")
        self.set_epoch(state["epoch"], state["step"])
        self._begin(self.epoch, self.step, None if self.global_batch else _arrays.whole("workers", state["workers"], 0, 1024))

    def _identity(self) -> dict[str, Any]:
        """What decides the order besides the epoch, the step and the workers."""
        names = ("batch", "samples_per_scene", "buffer_scenes", "shuffle", "seed", "global_batch")
        ranks = 0 if self.global_batch else self.world_size
        samples = hashlib.sha256(np.packbits(self._samples.wanted).tobytes()).hexdigest()
        own = {"dataset": self._samples.dataset.id, "samples": samples, "ranks": ranks, "is_even": self._is_one_of_several}
        return {**own, **{name: getattr(self, name) for name in names}}

    def __iter__(self) -> Iterator[_B]:
        worker = torch.utils.data.get_worker_info()
        number, count = (0, 1) if worker is None else (worker.id, worker.num_workers)
        if self._is_kept:
            # A worker's second pass: what it knows is from when it was started.
            parent = multiprocessing.parent_process()
            is_theirs = parent is not None and parent.pid == self._owner
            _arrays.must(is_theirs, "persistent_workers needs a call of set_epoch before the first pass, in the process that has the DataLoader")
            self.epoch, self.step, workers = self._shared.tolist()
            self._workers = None if workers < 0 else workers
        self._is_kept = worker is not None
        if self._workers is not None and max(self._workers, 1) != count and self.step:
            raise InputError(f"num_workers must be {self._workers}, that of the state, to go on within an epoch, got {count}")
        order, now = self._order, (self.epoch, self.step, number, count)
        return self._filled(order, order.taken(*now), order.left(*now))

    def _filled(self, order: Order, taken: Iterator[Drawn], left: Numbers) -> Iterator[_B]:
        """Batches of what was drawn, given how much is left to come of each scene."""
        kept: dict[int, _Kept] = {}
        for drawn in taken:
            held = []
            for scene, attempts in drawn.parts:
                if scene not in kept:
                    kept.update(self._read(order.block_of(scene), left))
                grid, rows, row_of = kept[scene]
                held.append((grid, rows, np.array([row_of[attempt] for attempt in attempts.tolist()])))
                left[scene] -= len(attempts)
                if not left[scene]:
                    del kept[scene]
            yield self._together(held, drawn)

    def _read(self, block: Block, left: Numbers) -> dict[int, _Kept]:
        due = [scene for scene in block[1] if left[scene]]
        grids, where, rows = self._samples.read(block[0], due)
        # Copies, for a view would keep the whole block.
        kept: dict[int, _Kept] = {scene: (grids[place].copy(), rows, {}) for place, scene in enumerate(due)}
        for (place, attempt), row in where.items():
            kept[due[place]][2][attempt] = row
        return kept

    def _together(self, held: list[tuple[NDArray[np.float32], dict[str, NDArray[Any]], NDArray[np.intp]]], drawn: Drawn) -> _B:
        rows = {name: np.concatenate([rows[name][chosen] for _, rows, chosen in held]) for name in held[0][1]}
        scene = np.repeat(np.arange(len(held)), [len(chosen) for *_, chosen in held])
        batch = _Made(self._samples.batch(np.stack([grid for grid, *_ in held]), scene, rows, drawn.mirrored))
        if self._is_one_of_several:
            batch["share"] = torch.tensor([drawn.share], dtype=torch.float32)
        return cast(_B, batch)


def _place(rank: int | None, world_size: int | None) -> tuple[int, int] | None:
    """Number of this rank and number of ranks: those given, or those of ``torch.distributed``, or none."""
    if rank is None and world_size is None:
        is_there = torch.distributed.is_available() and torch.distributed.is_initialized()
        return (torch.distributed.get_rank(), torch.distributed.get_world_size()) if is_there else None
    _arrays.must(None not in (rank, world_size), f"rank and world_size must be given together, got {rank} and {world_size}")
    ranks = _arrays.whole("world_size", world_size, 1, 65_536)
    return _arrays.whole("rank", rank, 0, ranks - 1), ranks


class GraspStream(_Stream[Batch]):
    __doc__ = _Stream.__doc__
    _has_crops = False


class GraspCropStream(_Stream[GraspCropBatch]):
    """Batches of crops of grasps, as a judge sees them: a :class:`GraspStream` that, if it shuffles, mirrors them."""

    _has_crops = True
