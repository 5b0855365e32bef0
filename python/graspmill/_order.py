"""Which samples a process takes in an epoch, and in which order: a function of seeds and counts alone, which reads no
grid. A process is a worker of a rank. Ranks have runs of scenes of their own, or share every batch. Both orders can
begin at any step, because what comes before it is drawn and left out."""

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from typing import Iterable, Iterator, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _arrays

#: Scenes that are read together.
BLOCK = 64

#: A scene, and some of its attempts.
Part = tuple[int, NDArray[np.intp]]
#: A shard, and scenes of it that follow each other.
Block = tuple[int, range]
Numbers = NDArray[np.int64]


class Drawn(NamedTuple):
    # A batch by its numbers: its parts, how each sample is mirrored, and the factor of its mean loss
    # (:meth:`Order.taken`).
    parts: list[Part]
    mirrored: NDArray[np.uint32]
    share: float


class Turns(NamedTuple):
    # The steps of a rank, each with the worker that makes it and the size of its batch.
    worker: Numbers
    size: Numbers


@dataclass(frozen=True, eq=False)
class Order:
    scenes: list[tuple[int, int]]  # first scene and end of each shard
    wanted: NDArray[np.bool_]  # [scenes, attempts]: what is in the split
    batch: int  # samples in a batch
    together: int  # the largest number of samples of a scene that stay together
    buffer: int  # such groups that are shuffled with each other
    shuffle: bool
    is_mirrored: bool  # samples at random
    seed: int
    rank: int
    ranks: int
    is_even: bool  # the batches of an epoch differ by at most one sample; otherwise the last one is smaller
    is_shared: bool  # a batch is that of all ranks, of which each takes its share

    @cached_property
    def counts(self) -> Numbers:
        return np.asarray(self.wanted.sum(axis=1, dtype=np.int64))

    @property
    def runs(self) -> int:
        return 1 if self.is_shared else self.ranks

    def block_of(self, scene: int) -> Block:
        shard = bisect_right(self.scenes, scene, key=lambda ends: ends[1])
        first, end = self.scenes[shard]
        at = first + (scene - first) // BLOCK * BLOCK
        return shard, range(at, min(at + BLOCK, end))

    def blocks(self, epoch: int, run: int) -> list[Block]:
        # The blocks of a run of scenes in the epoch's order. Runs have as many samples each, up to those of a scene.
        samples = np.concatenate([[0], np.cumsum(self.counts)])
        low, high = (int(np.searchsorted(samples, -(-int(samples[-1]) * at // self.runs))) for at in (run, run + 1))
        high = len(self.counts) if run + 1 == self.runs else high
        blocks: list[Block] = []
        for shard, (first, end) in enumerate(self.scenes):
            cut = (range(max(at, low), min(at + BLOCK, end, high)) for at in range(first, end, BLOCK))
            blocks.extend((shard, scenes) for scenes in cut if scenes)
        if self.shuffle:
            self._dice(epoch, run).shuffle(blocks)
        return blocks

    def turns(self, epoch: int, workers: int) -> list[Turns]:
        # The steps of the ranks, or those of all together where they share batches. Each has samples of every rank.
        counts = [self._worker_counts(epoch, run, workers) for run in range(self.runs)]
        least = [-(-one // self.batch) for one in counts]
        if self.is_shared:
            sizes = even(int(self.counts.sum()), int(-(-self.counts.sum() // self.batch)))
            self._check(len(sizes), int(sizes.min(initial=self.ranks)), self.ranks)
            return [Turns(np.arange(len(sizes)) % workers, sizes)]
        steps = max(int(one.sum()) for one in least)
        self._check(steps, min(int(one.sum()) for one in counts), steps)
        return [self._turns(own, made, steps) for own, made in zip(counts, least)]

    def taken(self, epoch: int, start: int, worker: int, workers: int) -> Iterator[Drawn]:
        # The batches of one of this rank's workers from a step on. The mean of the ranks' mean losses is that over all
        # of a step's samples if each is multiplied by the rank's share: its samples times the ranks, over all samples.
        turns = self.turns(epoch, workers)
        own = turns[self.rank % self.runs]
        steps = len(own.size)
        _arrays.must(start <= steps, f"step must be between 0 and {steps}, the steps of the epoch, got {start}")
        if self.is_shared:
            mine = (np.arange(steps) >= start) & ((np.arange(steps) - start) % workers == worker)
            drawn = self._batches(self.blocks(epoch, 0), self._dice(epoch, 0, 0), own.size)
            yield from (self._slice(*batch) for batch, is_mine in zip(drawn, mine) if is_mine)
            return
        # A DataLoader begins with its worker 0, which goes on where the next worker in turn was stopped.
        role = (int(own.worker[start]) + worker) % workers if start < steps else worker
        at = np.flatnonzero(own.worker == role)
        whole = np.sum([one.size for one in turns], axis=0)
        drawn = self._batches(self.blocks(epoch, self.rank)[role::workers], self._dice(epoch, self.rank, role), own.size[at])
        for step, (parts, mirrored) in zip(at, drawn):
            if step >= start:
                yield Drawn(parts, mirrored, float(own.size[step] * self.ranks / whole[step]))

    def left(self, epoch: int, start: int, worker: int, workers: int) -> Numbers:
        # ``[scenes]``: how many samples of each scene :meth:`taken` gives.
        left = np.zeros(len(self.counts), np.int64)
        if start == 0 and not self.is_shared:
            for _, scenes in self.blocks(epoch, self.rank)[worker::workers]:
                left[scenes.start : scenes.stop] = self.counts[scenes.start : scenes.stop]
            return left
        for drawn in self.taken(epoch, start, worker, workers):
            for scene, attempts in drawn.parts:
                left[scene] += len(attempts)
        return left

    def _dice(self, epoch: int, run: int, worker: int | None = None) -> np.random.Generator:
        own = [] if worker is None else [worker]
        return np.random.default_rng([self.seed, epoch, *(own if self.runs == 1 else [worker or 0, run])])

    def _check(self, steps: int, got: int, least: int) -> None:
        where = "a batch" if self.is_shared else "a rank"
        rule = f"every rank must have a sample at each of the {steps} steps: {where} must have at least {least} samples"
        _arrays.must(not steps or got >= least, f"{rule}, got {got}: use a larger batch or fewer ranks")

    def _worker_counts(self, epoch: int, run: int, workers: int) -> Numbers:
        blocks = self.blocks(epoch, run)
        ends = np.concatenate([[0], np.cumsum(self.counts)])
        own = [sum(int(ends[one.stop] - ends[one.start]) for _, one in blocks[worker::workers]) for worker in range(workers)]
        return np.array(own)

    def _turns(self, counts: Numbers, made: Numbers, steps: int) -> Turns:
        made = made.copy()
        while self.is_even and made.sum() < steps:
            made[int((counts / np.maximum(made, 1)).argmax())] += 1
        sizes = [even(count, batches) if self.is_even else full(count, self.batch) for count, batches in zip(counts, made)]
        worker, turn = np.repeat(np.arange(len(made)), made), np.concatenate([np.arange(batches) for batches in made])
        in_turn = np.lexsort((worker, turn))
        return Turns(worker[in_turn], np.concatenate(sizes)[in_turn])

    def _slice(self, parts: list[Part], mirrored: NDArray[np.uint32]) -> Drawn:
        size = len(mirrored)
        low, high = (size * at // self.ranks for at in (self.rank, self.rank + 1))
        own, at = [], 0
        for scene, attempts in parts:
            some = attempts[max(low - at, 0) : max(high - at, 0)]
            at += len(attempts)
            if len(some):
                own.append((scene, some))
        return Drawn(own, mirrored[low:high], (high - low) * self.ranks / size)

    def _batches(self, blocks: list[Block], dice: np.random.Generator, sizes: Iterable[int]) -> Iterator[tuple[list[Part], NDArray[np.uint32]]]:
        remaining = iter(sizes)
        size = room = int(next(remaining, 0))
        held: list[Part] = []
        for scene, attempts in self._groups(blocks, dice):
            while room and len(attempts) >= room:
                held.append((scene, attempts[:room]))
                yield held, dice.integers(0, 4, size, dtype=np.uint32) if self.is_mirrored else np.zeros(size, np.uint32)
                held, attempts = [], attempts[room:]
                size = room = int(next(remaining, 0))
            if len(attempts):
                held.append((scene, attempts))
                room -= len(attempts)

    def _groups(self, blocks: list[Block], dice: np.random.Generator) -> Iterator[Part]:
        waiting: list[Part] = []
        for _, scenes in blocks:
            for scene in scenes:
                attempts = np.flatnonzero(self.wanted[scene])
                if self.shuffle:
                    dice.shuffle(attempts)
                waiting.extend((scene, attempts[at : at + self.together]) for at in range(0, len(attempts), self.together))
            while len(waiting) > self.buffer:
                yield waiting.pop(int(dice.integers(len(waiting))) if self.shuffle else 0)
        while waiting:
            yield waiting.pop(int(dice.integers(len(waiting))) if self.shuffle else 0)


def even(count: int, parts: int) -> Numbers:
    # A number as a sum of so many that differ by at most one.
    return np.diff(np.arange(parts + 1) * int(count) // max(parts, 1))


def full(count: int, batch: int) -> Numbers:
    # A number as a sum of batches, of which the last may be smaller.
    return np.diff(np.append(np.arange(0, int(count), batch), count)) if count else np.zeros(0, np.int64)
