"""The label's contract: the gripper, the procedure, the outcomes. Numbers come from the dataset's meta/info.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, cos

import numpy as np

from .compound import Compound
from .hull import Hull
from .jaws import GripperBox, Jaw
from .pose import Pose
from .solid import Solid

OUTCOMES = ("pregrasp_collision", "approach_collision", "empty", "slipped", "hit_other", "held")
BLOCKED = OUTCOMES[:2]

# Fingers slower than this stand still, if they have for this long.
STOPPED_SPEED_M_S = 0.002
STOPPED_TIME_S = 0.025
# The gear that ties the fingers to each other while they press.
GEAR_STIFFNESS_N_M = 2_000.0
GEAR_DAMPING_N_S_M = 20.0
# Under a board the gripper rises by this share of its way out.
RISE = 0.2


@dataclass(frozen=True)
class Gripper:
    """A palm with two fingers of a box, or of two if they have thinner tips, or with two other jaws; fields as in the gripper file."""

    name: str
    opening_m_max: float
    finger_length_m: float
    finger_width_m: float
    finger_thickness_m: float
    palm_length_m: float
    palm_width_m: float
    palm_breadth_m: float
    finger_mass_kg: float
    finger_force_n: float
    closing_speed_m_s: float
    friction: float
    clearance_m: float
    finger_tip: dict[str, float] | None = None
    jaws: Sequence[dict] = ()

    @cached_property
    def each_jaw(self) -> list[Jaw]:
        """The jaw at −y, then the one at +y."""
        tips_m = [np.array([0.0, side * self.opening_m_max / 2, 0.0]) for side in (-1, 1)]
        abouts = self.jaws or [{"slide_m": -tip_m} for tip_m in tips_m]
        return [Jaw.of(*one) for one in zip(abouts, tips_m, self.fingers(self.opening_m_max))]

    def reach_m(self, closed_m: Sequence[float]) -> list[float]:
        """How far each tip has come along y, inwards, when it has come so far on its way."""
        if not self.jaws:
            return [*closed_m]
        poses = [jaw.pose(way_m).apply(jaw.tip_m) - jaw.tip_m for jaw, way_m in zip(self.each_jaw, closed_m)]
        return [float(poses[0][1]), -float(poses[1][1])]

    def gap_m(self, closed_m: Sequence[float]) -> float:
        """The opening between tips that have come so far on their ways."""
        return max(self.opening_m_max - sum(self.reach_m(closed_m)), 0.0)

    def fingers(self, width_m: float) -> tuple[GripperBox, GripperBox]:
        """The finger at −y, then the one at +y, as thick as their tips, inner faces `width_m` apart."""
        return self._fingers(width_m, self.finger_tip["thickness_m"] if self.finger_tip else self.finger_thickness_m, 0.0)

    def _fingers(self, width_m: float, thickness_m: float, tip_m: float) -> tuple[GripperBox, GripperBox]:
        half = np.array([self.finger_width_m, thickness_m, self.finger_length_m - tip_m]) / 2
        left, right = (np.array([0.0, side * (width_m / 2 + half[1]), -half[2] - tip_m]) for side in (-1, 1))
        return GripperBox(left, half), GripperBox(right, half)

    def palm(self) -> GripperBox:
        """The palm, behind the fingers."""
        half = np.array([self.palm_width_m, self.palm_breadth_m, self.palm_length_m]) / 2
        return GripperBox(np.array([0.0, 0.0, -self.finger_length_m - half[2]]), half)

    def open_gripper(self) -> list[GripperBox]:
        """Both jaws and the palm, wide open, and the fingers behind their tips where they are thicker there."""
        jaws = self.each_jaw
        boxes = [part for jaw in jaws for box in jaw.boxes for part in box.covered(jaw.open_from_given)] + [self.palm()]
        if self.finger_tip:
            behind = self._fingers(self.opening_m_max, self.finger_thickness_m, self.finger_tip["length_m"])
            fingers = [(jaw, box) for jaw, box, about in zip(jaws, behind, self.jaws or ({}, {})) if not about.get("boxes")]
            boxes += [part for jaw, box in fingers for part in box.covered(jaw.open_from_given)]
        return boxes


@dataclass(frozen=True)
class Procedure:
    """How an attempt is executed and judged; fields as in meta/info.json."""

    pregrasp_distance_m: float
    retreat_distance_m: float
    retreat_cone_rad: float
    retreat_speed_m_s: float
    close_time_s_max: float
    hold_time_s: float
    empty_width_m: float
    held_travel_share_min: float
    other_push_m_max: float
    other_lift_m_max: float


@dataclass(frozen=True)
class Environment:
    """What surrounds the objects. `finger_depth_m`: how deep a finger sinks into a face that it presses with its force; 0
    if it is as hard as the engine's options have it."""

    table_z_m: float
    table_friction: float
    gravity_m_s2: float
    finger_depth_m: float = 0.0

    def point_stiffness_n_m(self, gripper: Gripper) -> float:
        """Of each of the four points of such a contact."""
        return gripper.finger_force_n / (4 * self.finger_depth_m)


@dataclass(frozen=True)
class SceneObject:
    """An object at rest."""

    solid: Solid | Compound
    mass_kg: float
    friction: float
    workspace_from_object: Pose


@dataclass(frozen=True)
class Attempt:
    """A stored attempt. `width_m` is NaN where the gripper never closed."""

    attempt_id: int
    target: int
    shape: str
    rule: str
    workspace_from_grasp: Pose
    outcome: str
    hit: str | None
    width_m: float

    @property
    def approach_angle_rad(self) -> float:
        """Angle of the approach axis from straight down."""
        return float(np.arccos(np.clip(-self.workspace_from_grasp.rotation[2, 2], -1.0, 1.0)))


@dataclass(frozen=True)
class Scene:
    """Objects on a table, and the attempts on them. `fixtures`: convex parts in the workspace that never move."""

    scene_id: int
    objects: list[SceneObject]
    attempts: list[Attempt]
    fixtures: Sequence[Hull] = ()


@dataclass(frozen=True)
class Execution:
    """How an attempt ended. `hit` is target, other, container or table; `width_m` is NaN if the gripper never closed.

    `travel_m`: how far the target came along the retreat.
    """

    outcome: str
    hit: str | None = None
    width_m: float = float("nan")
    travel_m: float = float("nan")


def steps(time_s: float, step_rate_hz: float) -> int:
    """Steps that last at least `time_s` (a thousandth of a step is forgiven: the file holds single precision)."""
    return ceil(time_s * step_rate_hz - 1e-3)


def smoothstep(share: float) -> float:
    """From 0 to 1 without a jolt at either end."""
    share = min(share, 1.0)
    return share * share * (3 - 2 * share)


def retreat_direction(workspace_from_grasp: Pose, cone_rad: float, is_covered: bool = False) -> np.ndarray:
    """Unit vector (3,): back along the approach if that is within `cone_rad` of straight down, else up; where the grasp
    `is_covered`, as under a board, back and a little up."""
    back, up = -workspace_from_grasp.rotation[:, 2], np.array([0.0, 0.0, 1.0])
    if back[2] >= cos(cone_rad):
        return back
    out = back + RISE * up
    return out / np.linalg.norm(out) if is_covered else up


def lowest_z_m(box: GripperBox, workspace_from_grasp: Pose) -> float:
    """Height of a gripper box's lowest corner."""
    centre = workspace_from_grasp.apply(box.centre_m)
    return float(centre[2] - np.abs(workspace_from_grasp.rotation[2]) @ box.half_m)
