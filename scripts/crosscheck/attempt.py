"""One attempt in another engine, step by step as simulator/src/attempt.rs has it."""

from collections.abc import Callable
from math import ceil
from typing import Protocol

import numpy as np

from . import gate
from .contract import (
    STOPPED_SPEED_M_S,
    STOPPED_TIME_S,
    Attempt,
    Environment,
    Execution,
    Gripper,
    Procedure,
    Scene,
    lowest_z_m,
    retreat_direction,
    smoothstep,
    steps,
)
from .pose import Pose

# Speed of the simulated approach (mode "own approach").
APPROACH_SPEED_M_S = 0.1
# A retreating gripper is held against fixtures this often on its way.
WAY_STEP_M = 0.002


class Engine(Protocol):
    """A physics engine with a scene and a gripper. The palm follows commanded positions; forces act on the fingers."""

    name: str
    step_rate_hz: float

    def load(self, scene: Scene, gripper: Gripper, environment: Environment) -> None:
        """Takes a scene over; nothing moves yet."""

    def begin(self, workspace_from_grasp: Pose, retreat: np.ndarray) -> None:
        """The scene as stored, with the open gripper at a grasp; it will be able to move along `retreat` (3,)."""

    def place(self, workspace_from_grasp: Pose) -> None:
        """Puts the open gripper elsewhere, without touching anything."""

    def step(self) -> None:
        """Advances by one step; the fingers close until `press` is called first, unless `hold_open` was."""

    def hold_open(self, is_open: bool) -> None:
        """Keeps the fingers where they are while the gripper approaches."""

    def closed_m(self) -> tuple[float, float]:
        """How far the fingers (−y, +y) have closed."""

    def press(self, asymmetry_at_contact_m: float) -> None:
        """Presses with the finger force in the next step and keeps the fingers' asymmetry."""

    def move_to(self, distance_m: float) -> None:
        """Where the palm is to be at the end of the next step, along the retreat."""

    def positions_m(self) -> np.ndarray:
        """Origins of the objects (n, 3)."""

    def quats_xyzw(self) -> np.ndarray:
        """Orientations of the objects (n, 4)."""

    def grips(self, target: int) -> bool:
        """Whether both fingers press on an object."""

    def nearest(self, target: int, reach_m: float) -> str | None:
        """What the gripper comes nearer to than `reach_m`: target, other, container, table; None if nothing."""


class Runner:
    """Executes attempts of one loaded scene in an engine."""

    def __init__(self, engine: Engine, scene: Scene, gripper: Gripper, procedure: Procedure, environment: Environment):
        self._engine, self._scene = engine, scene
        self._gripper, self._procedure, self._environment = gripper, procedure, environment
        engine.load(scene, gripper, environment)

    def from_closing(self, attempt: Attempt, pose: Pose) -> Execution:
        """Puts the gripper at the grasp, closes, retreats, holds."""
        self._engine.begin(pose, self._retreat(pose))
        return self._close_and_lift(attempt, pose)

    def own_approach(self, attempt: Attempt, pose: Pose) -> Execution:
        """The same, after an approach that is simulated and judged by the engine's own distances."""
        procedure, engine, reach = self._procedure, self._engine, self._gripper.clearance_m
        approach = pose.rotation[:, 2]
        start = pose.moved(-approach * procedure.pregrasp_distance_m)
        engine.begin(start, self._retreat(pose))
        if hit := engine.nearest(attempt.target, reach):
            return Execution("pregrasp_collision", hit)
        count = steps(procedure.pregrasp_distance_m / APPROACH_SPEED_M_S, engine.step_rate_hz)
        engine.hold_open(True)
        for step in range(1, count + 1):
            engine.place(start.moved(approach * procedure.pregrasp_distance_m * step / count))
            engine.step()
            if hit := engine.nearest(attempt.target, reach):
                return Execution("approach_collision", hit)
        engine.hold_open(False)
        return self._close_and_lift(attempt, pose)

    def _close_and_lift(self, attempt: Attempt, pose: Pose) -> Execution:
        engine, procedure = self._engine, self._procedure
        before = engine.positions_m()
        width = self._close()
        if width <= procedure.empty_width_m:
            return Execution("empty", None, width)
        closed = engine.positions_m()
        pushed = self._pushed(attempt, pose, before, closed)
        held, travel = self._retreat_and_hold(attempt.target, pose, closed[attempt.target])
        if not held:
            return Execution("slipped", None, width, travel)
        width = self._width_m()
        hit = pushed or self._raised(attempt, before) or self._lifted_into_fixture(pose)
        return Execution("hit_other" if hit else "held", hit, width, travel)

    def _retreat(self, pose: Pose) -> np.ndarray:
        covered = gate.is_covered(self._scene.fixtures, pose)
        return retreat_direction(pose, self._procedure.retreat_cone_rad, covered)

    def _ways_m(self) -> list[np.ndarray]:
        """How each finger has moved (3,), in the frame of the grasp."""
        return [np.array([0.0, side * closed, 0.0]) for side, closed in zip((1, -1), self._engine.closed_m())]

    def _width_m(self) -> float:
        return self._gripper.gap_m(self._engine.closed_m())

    def _close(self, before_step: Callable[[], None] = lambda: None) -> float:
        """Closes until both fingers have stopped; returns the opening in metres."""
        engine, rate = self._engine, self._engine.step_rate_hz
        wanted, slow = steps(STOPPED_TIME_S, rate), STOPPED_SPEED_M_S / rate
        last, stopped = engine.closed_m(), 0
        for _ in range(steps(self._procedure.close_time_s_max, rate)):
            before_step()
            engine.step()
            now = engine.closed_m()
            stopped = stopped + 1 if all(abs(a - b) < slow for a, b in zip(now, last)) else 0
            last = now
            if stopped >= wanted or self._width_m() <= self._procedure.empty_width_m:
                break
        return self._width_m()

    def _retreat_and_hold(self, target: int, pose: Pose, start_m: np.ndarray) -> tuple[bool, float]:
        """Whether the target moved with the gripper and is still gripped, and how far it moved."""
        engine, procedure, rate = self._engine, self._procedure, self._engine.step_rate_hz
        distance = procedure.retreat_distance_m
        direction = self._retreat(pose)
        moving = steps(distance / procedure.retreat_speed_m_s, rate)
        left, right = engine.closed_m()
        for step in range(1, moving + steps(procedure.hold_time_s, rate) + 1):
            engine.press(left - right)
            engine.move_to(distance * smoothstep(step / moving))
            engine.step()
            if self._width_m() <= procedure.empty_width_m:
                return False, float((engine.positions_m()[target] - start_m) @ direction)
        travel = float((engine.positions_m()[target] - start_m) @ direction)
        return travel >= procedure.held_travel_share_min * distance and engine.grips(target), travel

    def _pushed(self, attempt: Attempt, pose: Pose, before: np.ndarray, after: np.ndarray) -> str | None:
        """What the closing gripper drove: another object; or what is within half the clearance of a finger's way."""
        moved = np.linalg.norm(after - before, axis=1)
        moved[attempt.target] = 0.0
        if (moved > self._procedure.other_push_m_max).any():
            return "other"
        near_m = self._gripper.clearance_m / 2
        fingers = list(zip(self._gripper.fingers(self._gripper.opening_m_max), self._ways_m()))
        if gate.touches(self._scene.fixtures, [pose], [box.swept(way).grown(near_m) for box, way in fingers]):
            return "container"
        low = [lowest_z_m(box.shifted(way), pose) < self._environment.table_z_m + near_m for box, way in fingers]
        return "table" if any(low) else None

    def _lifted_into_fixture(self, pose: Pose) -> str | None:
        """Whether the gripper, closed as it is, comes within half the clearance of a fixture along its retreat."""
        left, right = self._ways_m()
        ways, near_m = [left, right, np.zeros(3), left, right], self._gripper.clearance_m / 2
        boxes = [box.shifted(way).grown(near_m) for box, way in zip(self._gripper.open_gripper(), ways)]
        direction, distance = self._retreat(pose), self._procedure.retreat_distance_m
        along = [pose.moved(direction * d) for d in np.linspace(0, distance, ceil(distance / WAY_STEP_M) + 1)]
        return "container" if gate.touches(self._scene.fixtures, along, boxes) else None

    def _raised(self, attempt: Attempt, before: np.ndarray) -> str | None:
        raised = (self._engine.positions_m() - before)[:, 2]
        raised[attempt.target] = 0.0
        return "other" if (raised > self._procedure.other_lift_m_max).any() else None
