"""One grasp of a floating object in another engine, as simulator/src/floating.rs has it.

There a shaken gripper is a frame that accelerates; here the gripper is moved, so that one checks the other.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .attempt import Engine, Runner
from .contract import Attempt, Environment, Execution, Gripper, Procedure, Scene, smoothstep, steps
from .pose import Pose, rotation_of

G_M_S2 = 9.80665
# A pull comes up to its strength in this time.
RISE_S = 0.025
# An object is lost if its centre of mass moves further against the fingers, or it turns further; a lift lets it swing.
MOST = {"lift": (0.05, np.pi)}
MOST_ELSE = (0.01, 0.349)
# An object rests under a pull if in so long it moves and turns by less than this.
REST_TIME_S, REST_M, REST_RAD = 0.025, 2e-5, 3e-4
# While jaws that are not alike close the object is slowed at this rate, as on a table.
CLOSING_DAMPING_1_S = 50.0
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


class FloatingEngine(Engine, Protocol):
    """An engine whose gripper can be carried anywhere, and whose object can be pulled."""

    def tie(self, asymmetry_m: float) -> None:
        """As `press`, for fingers that are closing: neither gets faster than the gripper closes."""

    def slow(self, share: float) -> None:
        """Leaves the object this share of its speed."""

    def pull(self, acceleration_m_s2: np.ndarray) -> None:
        """Accelerates the object by so much (3,) from the next step on; the gripper is not affected."""

    def carry(self, workspace_from_grasp: Pose) -> None:
        """Where the gripper is to be at the end of the next step, and to stay; it has the speed of its way."""

    def centre_m(self) -> np.ndarray:
        """The object's centre of mass (3,)."""

    def save(self) -> object:
        """The state of everything that moves."""

    def restore(self, state: object) -> None:
        """Goes back to a saved state."""


@dataclass(frozen=True)
class Load:
    """What a closed gripper is put to: how the object is pulled at a time, and where the gripper is, if it moves.

    Both in the frame of the grasp."""

    time_s: float
    pull_m_s2: Callable[[float], np.ndarray]
    gripper_pose: Callable[[float], Pose] | None = None


def _angle_rad(a: np.ndarray, b: np.ndarray) -> float:
    """Of the rotation that leads from one rotation (3, 3) to another."""
    return float(np.arccos(np.clip((np.trace(a.T @ b) - 1) / 2, -1, 1)))


def pull(direction: list[float], time_s: float) -> Load:
    """A steady pull of 1 g for `time_s` after it came up."""
    acceleration = G_M_S2 * np.array(direction) / np.linalg.norm(direction)
    return Load(RISE_S + time_s, lambda now_s: acceleration * smoothstep(now_s / RISE_S))


def shake(way_m: np.ndarray, turn_rad: np.ndarray, pivot_m: np.ndarray, rate_hz: float, cycles: float) -> Load:
    """The gripper goes to and fro along a way, then it turns to and fro about a pivot."""
    half_s = cycles / rate_hz

    def gripper_pose(now_s: float) -> Pose:
        swings_s = now_s if now_s < half_s else now_s - half_s
        share = (1 - np.cos(2 * np.pi * rate_hz * swings_s)) / 2
        if now_s < half_s:
            return Pose(share * way_m, UPRIGHT)
        turned = Pose(np.zeros(3), UPRIGHT).turned(share * turn_rad)
        return turned.moved(pivot_m - turned.apply(pivot_m))

    return Load(2 * half_s, lambda now_s: np.zeros(3), gripper_pose)


def loads(test: str, gripper: Gripper) -> list[Load]:
    """What a test puts a grip to, one after the other; raises ValueError if it is unknown."""
    if test == "lift":
        return [pull([0, 0, 1], 0.25)]
    if test == "turn":
        return [pull(list(sign * axis), 0.25) for axis in np.eye(3) for sign in (1, -1)]
    if test == "tug":
        return [pull([x, y, 1], 0.5) for x, y in ((0, 0), (2, 0), (-2, 0), (0, 2), (0, -2))]
    if test == "shake":
        base_m = gripper.finger_length_m + gripper.palm_length_m
        z = np.array([0.0, 0.0, 1.0])
        return [shake(0.08 * z, np.array([0.0, 1.0, 0.0]), -base_m * z, rate_hz=2.0, cycles=2.0)]
    raise ValueError(f"unknown test {test!r}")


class FloatingRunner(Runner):
    """Executes grasps of one floating object in an engine."""

    def __init__(self, test: str, engine: FloatingEngine, scene: Scene, gripper: Gripper, procedure: Procedure, environment: Environment):
        super().__init__(engine, scene, gripper, procedure, environment)
        self._floating, self._loads, self._most = engine, loads(test, gripper), MOST.get(test, MOST_ELSE)

    def _close_and_lift(self, attempt: Attempt, pose: Pose) -> Execution:
        self._asymmetry_m: float | None = None
        width_m = self._close(self._steady)
        if width_m <= self._procedure.empty_width_m:
            return Execution("empty", None, width_m)
        if self._asymmetry_m is None:
            left, right = self._engine.closed_m()
            self._asymmetry_m = left - right
        closed, most_m = self._floating.save(), 0.0
        for load in self._loads:
            self._floating.restore(closed)
            is_held, moved_m = self._bears(load, pose)
            most_m = max(most_m, moved_m)
            if not is_held:
                return Execution("slipped", None, width_m, most_m)
        return Execution("held", None, width_m, most_m)

    def _steady(self) -> None:
        """Slows what jaws that are not alike push; fingers that both press are tied as in a lift: between them it would drift on."""
        if self._gripper.jaws:
            self._floating.slow(1 / (1 + CLOSING_DAMPING_1_S / self._engine.step_rate_hz))
        if self._asymmetry_m is None and self._engine.grips(0):
            left, right = self._engine.closed_m()
            self._asymmetry_m = left - right
        if self._asymmetry_m is not None:
            self._floating.tie(self._asymmetry_m)

    def _bears(self, load: Load, pose: Pose) -> tuple[bool, float]:
        """Whether the object stays in the gripper, and how far it moved in it."""
        engine, rate, moved_m = self._floating, self._engine.step_rate_hz, 0.0
        there, start_m, start = pose, self._centre_m(pose), self._turn(pose)
        last_m, last, asked = start_m, start, steps(REST_TIME_S, rate)
        for step in range(steps(load.time_s, rate)):
            engine.press(self._asymmetry_m)
            engine.pull(pose.rotation @ load.pull_m_s2((step + 0.5) / rate))
            if load.gripper_pose is not None:
                there = pose.of(load.gripper_pose((step + 1) / rate))
                engine.carry(there)
            engine.step()
            now_m, now = self._centre_m(there), self._turn(there)
            moved_m, turned_rad = float(np.linalg.norm(now_m - start_m)), _angle_rad(now, start)
            is_lost = moved_m > self._most[0] or turned_rad > self._most[1]
            if is_lost or self._width_m() <= self._procedure.empty_width_m:
                return False, moved_m
            if load.gripper_pose is None and step >= 2 * asked and step % asked == 0:
                # What slides or tips under a steady pull gets faster: what rests will not start.
                if np.linalg.norm(now_m - last_m) < REST_M and _angle_rad(now, last) < REST_RAD and engine.grips(0):
                    break
                last_m, last = now_m, now
        return engine.grips(0), moved_m

    def _turn(self, grasp: Pose) -> np.ndarray:
        """The object's rotation in the grasp frame (3, 3)."""
        return grasp.rotation.T @ rotation_of(self._engine.quats_xyzw()[0])

    def _centre_m(self, grasp: Pose) -> np.ndarray:
        """The centre of mass against the point between the fingers, in the grasp frame (3,)."""
        left, right = self._gripper.reach_m(self._engine.closed_m())
        middle_m = np.array([0.0, (left - right) / 2, 0.0])
        return (self._floating.centre_m() - grasp.position_m) @ grasp.rotation - middle_m
