"""Boxes of which grippers are made, and jaws that go each in its own way, as schema/src/jaw.rs has them: fixed, along a
line, along an arc, or turning about an axis. How far a jaw has closed is said by the way of its tip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .pose import Pose, conjugate

UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
# For the gate a box that is turned is covered by slices of at most this.
SLICE_M = 0.004


@dataclass(frozen=True)
class GripperBox:
    """A box of the gripper along the grasp frame's axes: `centre_m` (3,), `half_m` (3,)."""

    centre_m: np.ndarray
    half_m: np.ndarray

    def swept(self, way_m: np.ndarray) -> GripperBox:
        """What the box passes on a straight way (3,) along one of the axes."""
        return GripperBox(self.centre_m + way_m / 2, self.half_m + np.abs(way_m) / 2)

    def shifted(self, offset_m: np.ndarray) -> GripperBox:
        """The box moved by `offset_m` (3,)."""
        return GripperBox(self.centre_m + offset_m, self.half_m)

    def grown(self, margin_m: float) -> GripperBox:
        """The box larger by `margin_m` on every side."""
        return GripperBox(self.centre_m, self.half_m + margin_m)

    def covered(self, pose: Pose) -> list[GripperBox]:
        """Boxes along the axes that cover the box at a pose: slices across its longest side where it is turned."""
        if np.array_equal(pose.quat_xyzw, UPRIGHT):
            return [self.shifted(pose.position_m)]
        longest = int(np.argmax(self.half_m))
        # In single precision, which decides where a side is a multiple of a slice.
        count = int(np.ceil(np.float32(2 * self.half_m[longest]) / np.float32(SLICE_M)))
        along = np.eye(3)[longest]
        half_m = self.half_m * (1 - along * (1 - 1 / count))
        starts = self.centre_m + (2 * np.arange(count)[:, None] + 1 - count) * half_m * along
        return [GripperBox(centre_m, np.abs(pose.rotation) @ half_m) for centre_m in pose.apply(starts)]


@dataclass(frozen=True)
class Jaw:
    """One jaw: its tip (3,) at the widest opening, the boxes as they are given, and the keys of the gripper's file."""

    tip_m: np.ndarray
    boxes: list[GripperBox]
    slide_m: np.ndarray
    turn_rad: np.ndarray
    pivot_m: np.ndarray
    keeps_parallel: bool
    boxes_at: float

    @classmethod
    def of(cls, about: dict, tip_m: np.ndarray, finger: GripperBox) -> Jaw:
        """A jaw as a gripper's file has it; without boxes of its own it is a finger."""
        slide_m, turn_rad, pivot_m = (np.array(about.get(key, (0, 0, 0)), dtype=float) for key in ("slide_m", "turn_rad", "pivot_m"))
        boxes = [GripperBox(np.array(box["centre_m"]), np.array(box["size_m"]) / 2) for box in about.get("boxes", ())]
        keeps_parallel = bool(about.get("keeps_parallel", False))
        # A finger that does not turn is as it is at the widest opening.
        at = about.get("boxes_at", 0.0) if boxes or (turn_rad.any() and not keeps_parallel) else 0.0
        return cls(tip_m, boxes or [finger], slide_m, turn_rad, pivot_m, keeps_parallel, at)

    @cached_property
    def lever_m(self) -> float:
        """The tip's distance from the axis about which the jaw turns; 0 if it does not."""
        turn_rad = np.linalg.norm(self.turn_rad)
        return float(np.linalg.norm(np.cross(self.turn_rad, self.tip_m - self.pivot_m)) / turn_rad) if turn_rad else 0.0

    @cached_property
    def way_m(self) -> float:
        """Of the tip, until the gripper is closed; 0 if the jaw is fixed."""
        return float(np.linalg.norm(self.slide_m) + np.linalg.norm(self.turn_rad) * self.lever_m)

    @property
    def goes_on_arc(self) -> bool:
        """Whether it goes along an arc without turning."""
        return self.keeps_parallel and self.lever_m > 0

    def pose(self, closed_m: float) -> Pose:
        """From the gripper at its widest opening to one whose tip has come so far."""
        share = closed_m / self.way_m if closed_m else 0.0
        turned = Pose(self.slide_m * share, UPRIGHT).turned(self.turn_rad * share)
        if self.keeps_parallel:
            return Pose(self.slide_m * share + turned.rotation @ (self.tip_m - self.pivot_m) - self.tip_m + self.pivot_m, UPRIGHT)
        return turned.moved(self.pivot_m - turned.rotation @ self.pivot_m)

    @cached_property
    def open_from_given(self) -> Pose:
        """From the boxes as they are given to where they are at the widest opening."""
        given = self.pose(self.boxes_at * self.way_m)
        back = Pose(np.zeros(3), conjugate(given.quat_xyzw))
        return back.moved(-(back.rotation @ given.position_m))
