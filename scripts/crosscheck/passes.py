"""A pass: every attempt of the dataset executed once, by one engine in one mode."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from tqdm import tqdm

from . import gate
from .attempt import Engine, Runner
from .contract import Environment, Execution, Gripper, Procedure, Scene
from .dataset import Dataset
from .pose import angle_between_rad

DRIFT_TIME_S = 0.5

# Makes what executes the attempts of a scene, from what a Runner takes.
Runners = Callable[[Engine, Scene, Gripper, Procedure, Environment], Runner]


@dataclass(frozen=True)
class Pass:
    """Executions in the dataset's order, and how long the engine took."""

    name: str
    executions: list[Execution]
    seconds: float

    @property
    def labels(self) -> np.ndarray:
        """1 where the object was held (n,)."""
        return np.array([execution.outcome == "held" for execution in self.executions], dtype=int)


@dataclass(frozen=True)
class Drift:
    """How far each object of the dataset moved (n,) in metres, and turned (n,) in radians, untouched by the gripper."""

    moved_m: np.ndarray
    turned_rad: np.ndarray


def gate_pass(dataset: Dataset) -> list[gate.GateResult]:
    """The geometric gate's result for every attempt."""
    return [result for scene in dataset.scenes for result in _gate(dataset, scene)]


def _gate(dataset: Dataset, scene: Scene) -> list[gate.GateResult]:
    poses = [attempt.workspace_from_grasp for attempt in scene.attempts]
    return gate.judge(scene, poses, dataset.gripper_of(scene), dataset.procedure, dataset.environment.table_z_m)


def same_gate(name: str, dataset: Dataset, engine: Engine, runners: Runners = Runner) -> Pass:
    """The geometric gate first, physics from closing on."""
    executions, seconds = [], 0.0
    for scene in _shown(name, dataset):
        verdicts = _gate(dataset, scene)
        start = perf_counter()
        runner = runners(engine, scene, dataset.gripper_of(scene), dataset.procedure, dataset.environment)
        for attempt, verdict in zip(scene.attempts, verdicts):
            blocked = None if verdict.outcome is None else Execution(verdict.outcome, verdict.hit)
            executions.append(blocked or runner.from_closing(attempt, attempt.workspace_from_grasp))
        seconds += perf_counter() - start
    return Pass(name, executions, seconds)


def own_approach(name: str, dataset: Dataset, engine: Engine, runners: Runners = Runner) -> Pass:
    """Everything by the engine, pre-grasp and approach included."""
    executions, seconds = [], 0.0
    for scene in _shown(name, dataset):
        start = perf_counter()
        runner = runners(engine, scene, dataset.gripper_of(scene), dataset.procedure, dataset.environment)
        executions += [runner.own_approach(attempt, attempt.workspace_from_grasp) for attempt in scene.attempts]
        seconds += perf_counter() - start
    return Pass(name, executions, seconds)


def drift(dataset: Dataset, engine: Engine) -> Drift:
    """Lets every scene rest for half a second."""
    moved, turned = [], []
    for scene in _shown("drift", dataset):
        engine.load(scene, dataset.gripper_of(scene), dataset.environment)
        engine.begin(None, None)
        before, quats = engine.positions_m(), engine.quats_xyzw()
        for _ in range(round(DRIFT_TIME_S * engine.step_rate_hz)):
            engine.step()
        moved += np.linalg.norm(engine.positions_m() - before, axis=1).tolist()
        turned += [angle_between_rad(a, b) for a, b in zip(quats, engine.quats_xyzw())]
    return Drift(np.array(moved), np.array(turned))


def _shown(name: str, dataset: Dataset) -> tqdm:
    return tqdm(dataset.scenes, desc=name, unit="scene", smoothing=0.05, disable=None)
