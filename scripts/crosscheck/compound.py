"""A rigid body of several convex parts, used like a `Solid`."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from .hull import Hull, hull_of
from .pose import Pose
from .solid import Solid

# A row's bounding box may differ from the parts' by this; both are rounded to single precision.
EXTENTS_TOLERANCE_M = 1e-5


@dataclass(frozen=True)
class Compound:
    """Parts in the object's frame. They do not overlap; together they have one uniform density."""

    kind: str
    convexes: tuple[Hull, ...]

    @cached_property
    def extents_m(self) -> np.ndarray:
        """Size (3,) of the bounding box along the object's axes."""
        return np.ptp(np.concatenate([part.vertices_m for part in self.convexes]), axis=0)

    @cached_property
    def volume_m3(self) -> float:
        """Volume of all parts."""
        return sum(part.volume_m3 for part in self.convexes)

    @cached_property
    def centroid_m(self) -> np.ndarray:
        """Centre of mass (3,) in the object's frame."""
        return sum(part.volume_m3 * part.centroid_m for part in self.convexes) / self.volume_m3

    def inertia_kg_m2(self, mass_kg: float) -> np.ndarray:
        """Inertia tensor (3, 3) about the centre of mass, along the object's axes: the parts' by parallel axes."""
        second = np.zeros((3, 3))
        for part in self.convexes:
            arm = part.centroid_m - self.centroid_m
            second += part.second_moments_m5 + part.volume_m3 * np.outer(arm, arm)
        return mass_kg / self.volume_m3 * (np.trace(second) * np.eye(3) - second)

    def principal(self, mass_kg: float) -> tuple[np.ndarray, Pose]:
        """Principal moments (3,), and the frame at the centre of mass whose axes are theirs, in the object's."""
        moments, axes = np.linalg.eigh(self.inertia_kg_m2(mass_kg))
        if np.linalg.det(axes) < 0:
            axes[:, 0] = -axes[:, 0]
        return moments, Pose(self.centroid_m, quat_of(axes))


def compound_of(name: str, parts: list) -> Compound:
    """A compound of hulls, from each part's corners (n, 3); raises ValueError if one has none."""
    if not parts:
        raise ValueError("no parts")
    return Compound(name, tuple(hull_of(corners) for corners in parts))


def body_of(name: str, extents_m: tuple[float, float, float], compounds: dict[str, Compound]) -> Solid | Compound:
    """The body that a row names: a compound, else a primitive; raises ValueError if it is neither or has another size."""
    # A compound may have a primitive's name: what the compounds' list has is a compound.
    body = compounds.get(name)
    if body is None:
        # The error for an unknown name lists the primitives.
        return Solid(name, extents_m)
    if not np.allclose(body.extents_m, extents_m, rtol=0, atol=EXTENTS_TOLERANCE_M):
        raise ValueError(f"{name} measures {extents_m} m, its parts {body.extents_m.round(6).tolist()} m")
    return body


def box_of(part: Hull) -> tuple[Pose, np.ndarray] | None:
    """Centre and axes of a part that is a cuboid, in the object's frame, and its half sides (3,); None if it is none."""
    normals, corners = part.normals, part.vertices_m
    if len(normals) != 6 or len(corners) != 8:
        return None
    x = normals[0]
    y = normals[np.argmin(np.abs(normals @ x))]
    axes = np.stack([x, y, np.cross(x, y)], axis=1)
    along = np.abs(normals @ axes)
    if not np.isclose(along.max(axis=1), 1, atol=1e-6).all() or abs(x @ y) > 1e-4:
        return None
    low, high = (corners @ axes).min(axis=0), (corners @ axes).max(axis=0)
    return Pose(axes @ (low + high) / 2, quat_of(axes)), (high - low) / 2


def quat_of(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,), xyzw, of a rotation matrix (3, 3)."""
    # Of the matrix of all products of the quaternion's components, four times over, take the row of the largest.
    r, trace = rotation, np.trace(rotation)
    products = np.empty((4, 4))
    products[:3, :3] = r + r.T + (1 - trace) * np.eye(3)
    products[3, :3] = products[:3, 3] = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    products[3, 3] = 1 + trace
    row = products[np.argmax(np.diag(products))]
    return row / np.linalg.norm(row)
