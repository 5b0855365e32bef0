"""Convex bodies: from points by Qhull, whose triangles are put together where they lie on a plane."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

POINTS_MAX = 256
# Points within this share of the hull's size are on a plane; coordinates are rounded to single precision.
# Where a face is neither clearly flat nor clearly bent at the first, the next tells its triangles apart.
PLANE_TOLERANCES = (1e-6, 1e-7, 1e-8)


class Convex:
    """A convex polyhedron: corners (n, 3) and its faces' corners by number, counter-clockwise seen from outside."""

    vertices_m: np.ndarray
    faces: tuple[np.ndarray, ...]

    @cached_property
    def normals(self) -> np.ndarray:
        """Outward unit normals (f, 3)."""
        areas = np.array([_area_vector(self.vertices_m[face]) for face in self.faces])
        return areas / np.linalg.norm(areas, axis=1, keepdims=True)

    @cached_property
    def edges(self) -> np.ndarray:
        """Unit directions (e, 3) of the edges, parallel ones once."""
        rings = [self.vertices_m[face] for face in self.faces]
        sides = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
        return _distinct(sides / np.linalg.norm(sides, axis=1, keepdims=True))

    @cached_property
    def volume_m3(self) -> float:
        """Volume, by the divergence theorem."""
        return float(self._tetrahedra[1].sum())

    @cached_property
    def centroid_m(self) -> np.ndarray:
        """Centre of mass (3,) of the uniform solid."""
        corners, volumes = self._tetrahedra
        return volumes @ corners.mean(axis=1) / self.volume_m3

    @cached_property
    def second_moments_m5(self) -> np.ndarray:
        """Integral (3, 3) of the products of a point's coordinates over the solid, from its centroid."""
        corners, volumes = self._tetrahedra
        corners = corners - self.centroid_m
        total = corners.sum(axis=1)
        products = np.einsum("tci,tcj->tij", corners, corners) + np.einsum("ti,tj->tij", total, total)
        return np.einsum("t,tij->ij", volumes, products) / 20

    @cached_property
    def _tetrahedra(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (t, 4, 3) and volumes (t,) of tetrahedra from the corners' middle to the triangles of the faces."""
        triangles = np.array([[f[0], f[i], f[i + 1]] for f in self.faces for i in range(1, len(f) - 1)])
        middle = np.broadcast_to(self.vertices_m.mean(axis=0), (len(triangles), 1, 3))
        corners = np.concatenate([middle, self.vertices_m[triangles]], axis=1)
        return corners, np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6

    @cached_property
    def _meeting(self) -> np.ndarray:
        """Which faces meet at which corner (n, f)."""
        return np.array([[number in face for face in self.faces] for number in range(len(self.vertices_m))])

    def shrunk(self, margin_m: float) -> np.ndarray:
        """Corners (n, 3) whose faces lie `margin_m` further in; only nearly so where more than three faces meet."""
        moved = []
        for corner, meeting in zip(self.vertices_m, self._meeting):
            normals = self.normals[meeting]
            moved.append(corner + np.linalg.lstsq(normals, np.full(len(normals), -margin_m), rcond=1e-3)[0])
        return np.array(moved)


@dataclass(frozen=True)
class Hull(Convex):
    """The hull of some points."""

    vertices_m: np.ndarray
    faces: tuple[np.ndarray, ...]


def hull_of(points_m: Iterable[Iterable[float]]) -> Hull:
    """The hull of points (n, 3); raises ValueError if they span no volume. Points within the hull are left out."""
    points = np.array(points_m, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not 4 <= len(points) <= POINTS_MAX or not np.isfinite(points).all():
        raise ValueError(f"a hull needs 4 to {POINTS_MAX} finite points of 3 coordinates, got an array of shape {points.shape}")
    size = np.ptp(points, axis=0).max() + np.abs(points).max()
    points = _apart(points, PLANE_TOLERANCES[0] * size)
    for share in PLANE_TOLERANCES:
        faces = _faces(points, share * size)
        areas = np.array([_area_vector(points[face]) for face in faces]).reshape(-1, 3)
        if len(faces) >= 4 and np.linalg.norm(areas.sum(axis=0)) <= 1e-3 * np.linalg.norm(areas, axis=1).sum():
            used = np.unique(np.concatenate(faces))
            return Hull(points[used], tuple(np.searchsorted(used, face) for face in faces))
    # Faces that are nearly in one plane merge badly; the triangles close.
    faces = [triple[_turning(points[triple], normal)] for normal, _, triple in _supporting_planes(points, 0.0)]
    if len(faces) < 4:
        raise ValueError("the points span no volume")
    used = np.unique(np.concatenate(faces))
    return Hull(points[used], tuple(np.searchsorted(used, face) for face in faces))


def _faces(points: np.ndarray, tolerance: float) -> list[np.ndarray]:
    """The corners of each face, by number and counter-clockwise seen from outside."""
    faces: list[np.ndarray] = []
    for normal, offset, triple in _supporting_planes(points, tolerance):
        if any(np.isin(triple, face).all() for face in faces):
            continue
        on_plane = np.flatnonzero(np.abs(points @ normal - offset) <= tolerance)
        faces.append(on_plane[_turning(points[on_plane], normal)])
    return faces


def _supporting_planes(points: np.ndarray, tolerance: float) -> list[tuple[np.ndarray, float, np.ndarray]]:
    """Outward normal, offset and three points of the planes of Qhull's triangles; the largest triangles first, for theirs
    are the most exact."""
    try:
        triples = ConvexHull(points).simplices
    except QhullError as error:
        raise ValueError("the points span no volume") from error
    a, b, c = (points[triples[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - a, c - b)], axis=0)
    # Three points in a row lie on no particular plane.
    kept = np.flatnonzero(area > 10 * tolerance * longest)
    normals = cross[kept] / area[kept, None]
    offsets = np.einsum("ti,ti->t", normals, a[kept])
    inwards = (normals @ points.mean(axis=0) > offsets)[:, None]
    normals, offsets = np.where(inwards, -normals, normals), np.where(inwards[:, 0], -offsets, offsets)
    return [(normals[i], offsets[i], triples[kept[i]]) for i in np.argsort(-area[kept], kind="stable")]


def _turning(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The order (n,) of a face's corners, counter-clockwise about its normal."""
    middle = corners.mean(axis=0)
    across = corners[np.argmax(np.linalg.norm(corners - middle, axis=1))] - middle
    angle = np.arctan2((corners - middle) @ np.cross(normal, across), (corners - middle) @ across)
    return np.argsort(angle, kind="stable")


def _area_vector(corners: np.ndarray) -> np.ndarray:
    """Area times normal (3,) of a polygon (n, 3)."""
    arms = corners - corners[0]
    return np.cross(arms[:-1], arms[1:]).sum(axis=0) / 2


def _apart(points: np.ndarray, tolerance: float) -> np.ndarray:
    """The points without those that repeat an earlier one."""
    kept: list[np.ndarray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > tolerance for other in kept):
            kept.append(point)
    return np.array(kept)


def _distinct(directions: np.ndarray) -> np.ndarray:
    """Unit directions without repetitions and opposites."""
    kept = np.empty((0, 3))
    for direction in directions:
        if (np.linalg.norm(np.cross(direction, kept), axis=1) > 1e-4).all():
            kept = np.vstack([kept, direction])
    return kept
