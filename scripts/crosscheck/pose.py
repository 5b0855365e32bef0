"""Rigid transforms. Quaternions are xyzw, lengths in metres, names read target_from_source."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Pose:
    """Where a source frame stands in a target frame: `position_m` (3,), unit `quat_xyzw` (4,)."""

    position_m: np.ndarray
    quat_xyzw: np.ndarray

    @cached_property
    def rotation(self) -> np.ndarray:
        """Rotation matrix (3, 3); its columns are the source's axes."""
        return rotation_of(self.quat_xyzw)

    def apply(self, points_m: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the source frame, in the target frame."""
        return points_m @ self.rotation.T + self.position_m

    def of(self, inner: Pose) -> Pose:
        """A pose in the source frame, in the target frame."""
        return Pose(self.apply(inner.position_m), product(self.quat_xyzw, inner.quat_xyzw))

    def moved(self, offset_m: np.ndarray) -> Pose:
        """The same orientation, shifted by `offset_m` (3,) in the target frame."""
        return Pose(self.position_m + offset_m, self.quat_xyzw)

    def turned(self, rotation_vector_rad: np.ndarray) -> Pose:
        """Turned about its own origin by a rotation vector (3,) of the target frame."""
        return Pose(self.position_m, product(quat_from_vector(rotation_vector_rad), self.quat_xyzw))


def rotation_of(quat_xyzw: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    x, y, z, w = np.moveaxis(np.asarray(quat_xyzw, dtype=float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of two quaternions (4,): first `b`, then `a`."""
    # Written out: for vectors this short, np.cross takes most of the time of a step.
    (x, y, z, w), (i, j, k, r) = a, b
    return np.array([
        w * i + r * x + y * k - z * j,
        w * j + r * y + z * i - x * k,
        w * k + r * z + x * j - y * i,
        w * r - x * i - y * j - z * k,
    ])  # fmt: skip


def quat_from_vector(rotation_vector_rad: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) of a rotation vector (3,)."""
    angle = float(np.linalg.norm(rotation_vector_rad))
    if angle < 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    return np.append(rotation_vector_rad / angle * np.sin(angle / 2), np.cos(angle / 2))


def conjugate(quat_xyzw: np.ndarray) -> np.ndarray:
    """The inverse of a unit quaternion (4,)."""
    return quat_xyzw * np.array([-1.0, -1.0, -1.0, 1.0])


def vector_from_quat(quat_xyzw: np.ndarray) -> np.ndarray:
    """Rotation vector (3,), of at most half a turn, of a unit quaternion (4,)."""
    quat = quat_xyzw if quat_xyzw[3] >= 0 else -quat_xyzw
    sine = float(np.linalg.norm(quat[:3]))
    return quat[:3] * (2 * np.arctan2(sine, quat[3]) / sine if sine > 1e-12 else 2.0)


def angle_between_rad(a_xyzw: np.ndarray, b_xyzw: np.ndarray) -> float:
    """Angle of the rotation that leads from one unit quaternion (4,) to another."""
    return float(2 * np.arccos(np.clip(abs(np.dot(a_xyzw, b_xyzw)), 0.0, 1.0)))
