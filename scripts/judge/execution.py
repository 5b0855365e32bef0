"""Executes an experiment's grasps in PyBullet, optionally in several processes, each grasp in a fresh world."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from crosscheck import gate
from crosscheck.attempt import Engine, Runner
from crosscheck.contract import Execution, Scene
from crosscheck.dataset import Dataset
from crosscheck.passes import Drift, scene_drift
from tqdm import tqdm


@dataclass(frozen=True)
class Judged:
    """The outcome of each grasp in PyBullet, and the motion of all objects without contact with the hand."""

    executions: list[Execution]
    drift: Drift


def judge(data: Dataset, jobs: int) -> Judged:
    """Executes the grasp of every scene; the result does not depend on `jobs`."""
    found = list(tqdm(_all(data, jobs), total=len(data.scenes), desc="pybullet", unit="grasp", smoothing=0.05, disable=None))
    drifts = [drift for _, drift in found]
    moved, turned = (np.concatenate([getattr(d, name) for d in drifts]) for name in ("moved_m", "turned_rad"))
    return Judged([execution for execution, _ in found], Drift(moved, turned))


def execute(data: Dataset, scene: Scene, engine: Engine) -> Execution:
    """Executes the scene's only grasp: the geometric gate first, then physics from closing on, as in the cross-check."""
    [attempt] = scene.attempts
    pose = attempt.workspace_from_grasp
    [verdict] = gate.judge(scene, [pose], data.hand_of(scene), data.procedure, data.environment.table_z_m)
    if verdict.outcome is not None:
        return Execution(verdict.outcome, verdict.hit)
    return Runner(engine, scene, data.hand_of(scene), data.procedure, data.environment).from_closing(attempt, pose)


class _Worker:
    """One process's world."""

    def __init__(self, data: Dataset):
        # PyBullet is imported only when it is needed.
        from crosscheck.compound_bullet import CompoundBullet

        self.data, self.engine = data, CompoundBullet()

    def result(self, number: int) -> tuple[Execution, Drift]:
        scene = self.data.scenes[number]
        return execute(self.data, scene, self.engine), scene_drift(self.data, scene, self.engine)


def _all(data: Dataset, jobs: int) -> Iterator[tuple[Execution, Drift]]:
    if jobs == 1:
        worker = _Worker(data)
        yield from map(worker.result, range(len(data.scenes)))
        worker.engine.close()
        return
    with ProcessPoolExecutor(jobs, get_context("spawn"), _begin, (data,)) as pool:
        yield from pool.map(_result, range(len(data.scenes)), chunksize=4)


_worker: _Worker | None = None


def _begin(data: Dataset) -> None:
    global _worker
    _worker = _Worker(data)


def _result(number: int) -> tuple[Execution, Drift]:
    return _worker.result(number)
