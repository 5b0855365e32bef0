"""A pass: every attempt of the dataset executed once, by one engine in one mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from tqdm import tqdm

from . import gate
from .attempt import Engine, Runner
from .contract import Attempt, Environment, Execution, Gripper, Procedure, Scene
from .dataset import Dataset
from .pose import Pose, angle_between_rad

DRIFT_TIME_S = 0.5

Jitter = Callable[[Attempt, Scene], Pose]
# Makes what executes the attempts of a scene, from what a Runner takes.
Runners = Callable[[Engine, Scene, Gripper, Procedure, Environment], Runner]


@dataclass(frozen=True)
class Pass:
    """Executions in the dataset's order, and how long the engine took for those that it simulated."""

    name: str
    executions: list[Execution]
    simulated: int
    seconds: float

    @property
    def labels(self) -> np.ndarray:
        """1 where the object was held (n,)."""
        return np.array([execution.outcome == "held" for execution in self.executions], dtype=int)


@dataclass(frozen=True)
class Drift:
    """How far each object of the dataset moved (n,) in metres, and turned (n,) in radians, without contact with the hand."""

    moved_m: np.ndarray
    turned_rad: np.ndarray


def gate_pass(dataset: Dataset) -> list[gate.GateResult]:
    """The geometric gate's result for every attempt."""
    results = []
    for scene in dataset.scenes:
        results += _gate(dataset, scene, [attempt.workspace_from_grasp for attempt in scene.attempts])
    return results


def _gate(dataset: Dataset, scene: Scene, poses: list[Pose]) -> list[gate.GateResult]:
    return gate.judge(scene, poses, dataset.hand_of(scene), dataset.procedure, dataset.environment.table_z_m)


def same_gate(
    name: str, dataset: Dataset, engine: Engine, jitter: Jitter | None = None, runners: Runners = Runner
) -> Pass:
    """The geometric gate first, physics from closing on; grasps are displaced by `jitter`."""
    executions, simulated, seconds = [], 0, 0.0
    for scene in _shown(name, dataset):
        poses = [jitter(a, scene) if jitter else a.workspace_from_grasp for a in scene.attempts]
        verdicts = _gate(dataset, scene, poses)
        start = perf_counter()
        runner = runners(engine, scene, dataset.hand_of(scene), dataset.procedure, dataset.environment)
        for attempt, pose, verdict in zip(scene.attempts, poses, verdicts):
            if verdict.outcome is None:
                executions.append(runner.from_closing(attempt, pose))
                simulated += 1
            else:
                executions.append(Execution(verdict.outcome, verdict.hit))
        seconds += perf_counter() - start
    return Pass(name, executions, simulated, seconds)


def own_approach(name: str, dataset: Dataset, engine: Engine, runners: Runners = Runner) -> Pass:
    """Everything by the engine, pre-grasp and approach included."""
    executions, seconds = [], 0.0
    for scene in _shown(name, dataset):
        start = perf_counter()
        runner = runners(engine, scene, dataset.hand_of(scene), dataset.procedure, dataset.environment)
        executions += [runner.own_approach(attempt, attempt.workspace_from_grasp) for attempt in scene.attempts]
        seconds += perf_counter() - start
    return Pass(name, executions, len(executions), seconds)


def drift(dataset: Dataset, engine: Engine) -> Drift:
    """Lets every scene rest for half a second."""
    moved, turned = [], []
    for scene in _shown("drift", dataset):
        one = scene_drift(dataset, scene, engine)
        moved += list(one.moved_m)
        turned += list(one.turned_rad)
    return Drift(np.array(moved), np.array(turned))


def scene_drift(dataset: Dataset, scene: Scene, engine: Engine) -> Drift:
    """Lets one scene rest for half a second."""
    engine.load(scene, dataset.hand_of(scene), dataset.environment)
    engine.begin(None, None)
    before, quats = engine.positions_m(), engine.quats_xyzw()
    for _ in range(round(DRIFT_TIME_S * engine.step_rate_hz)):
        engine.step()
    moved = np.linalg.norm(engine.positions_m() - before, axis=1)
    return Drift(moved, np.array([angle_between_rad(a, b) for a, b in zip(quats, engine.quats_xyzw())]))


def displaced(distance_m: float, seed: int) -> Jitter:
    """Grasps moved by exactly `distance_m` in a random direction, the same for the same attempt."""

    def jitter(attempt: Attempt, scene: Scene) -> Pose:
        direction = np.random.default_rng([seed, scene.scene_id, attempt.attempt_id]).normal(size=3)
        return attempt.workspace_from_grasp.moved(distance_m * direction / np.linalg.norm(direction))

    return jitter


def _shown(name: str, dataset: Dataset) -> tqdm:
    return tqdm(dataset.scenes, desc=name, unit="scene", smoothing=0.05, disable=None)
