"""The four primitive shapes as convex polyhedra, restated from the format's own words (meta/info.json, `frames`, `facets`).

Every solid is a convex polygon pushed along an axis. Round outlines have 24 flat sides a full turn. The object frame's
origin is the centre of the bounding box.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

FACETS = 24
SHAPES = ("cuboid", "cylinder", "tri_prism", "half_cylinder")


@dataclass(frozen=True)
class Solid:
    """A shape by kind and bounding box: `extents_m` (3,), full lengths along the object's axes."""

    kind: str
    extents_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        if self.kind not in SHAPES:
            raise ValueError(f"unknown shape {self.kind!r}; known are {', '.join(SHAPES)}")
        x, y, z = self.extents_m
        if not all(np.isfinite(e) and e > 0 for e in self.extents_m):
            raise ValueError(f"extents must be finite and above 0 m, got {self.extents_m}")
        round_pair = {"cylinder": (x, y), "half_cylinder": (y, 2 * z)}.get(self.kind)
        if round_pair and not np.isclose(*round_pair, rtol=2e-5):
            raise ValueError(f"a {self.kind} must have a circular outline, got extents {self.extents_m}")

    @cached_property
    def outline_m(self) -> np.ndarray:
        """The polygon (n, 2), counter-clockwise: (x, y) of a cylinder, (y, z) of every other shape."""
        x, y, z = (e / 2 for e in self.extents_m)
        if self.kind == "cuboid":
            return np.array([[-y, -z], [y, -z], [y, z], [-y, z]])
        if self.kind == "tri_prism":
            return np.array([[-y, -z], [y, -z], [0, z]])
        if self.kind == "cylinder":
            turn = 2 * np.pi * np.arange(FACETS) / FACETS
            return np.stack([x * np.cos(turn), y * np.sin(turn)], axis=1)
        turn = np.pi * np.arange(FACETS // 2 + 1) / (FACETS // 2)
        return np.stack([y * np.cos(turn), 2 * z * np.sin(turn) - z], axis=1)

    @property
    def convexes(self) -> list[Solid]:
        """The convex parts that the gate tests: the solid itself."""
        return [self]

    @property
    def half_length_m(self) -> float:
        """Half the length along the extrusion axis (z of a cylinder, x of every other shape)."""
        return self.extents_m[2 if self.kind == "cylinder" else 0] / 2

    def lift(self, outline: np.ndarray, along: float) -> np.ndarray:
        """Points (n, 2) of the outline's plane as points (n, 3) of the object frame, `along` the extrusion axis."""
        column = np.full(len(outline), along)
        columns = [outline[:, 0], outline[:, 1], column] if self.kind == "cylinder" else [column, *outline.T]
        return np.stack(columns, axis=1)

    @cached_property
    def vertices_m(self) -> np.ndarray:
        """Corners (2 n, 3): the lower end's, then the upper end's."""
        return np.concatenate([self.lift(self.outline_m, sign * self.half_length_m) for sign in (-1, 1)])

    @cached_property
    def axis(self) -> np.ndarray:
        """Unit vector (3,) of the extrusion."""
        return np.array([0.0, 0.0, 1.0]) if self.kind == "cylinder" else np.array([1.0, 0.0, 0.0])

    @cached_property
    def edges(self) -> np.ndarray:
        """Unit directions (n + 1, 3) of the edges: round the outline, then along the extrusion."""
        sides = np.roll(self.outline_m, -1, axis=0) - self.outline_m
        sides = self.lift(sides / np.linalg.norm(sides, axis=1, keepdims=True), 0.0)
        return np.concatenate([sides, self.axis[None]])

    @cached_property
    def normals(self) -> np.ndarray:
        """Outward unit normals (n + 2, 3): of the sides, then of the two ends."""
        sides = np.roll(self.outline_m, -1, axis=0) - self.outline_m
        outward = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
        outward = self.lift(outward / np.linalg.norm(outward, axis=1, keepdims=True), 0.0)
        return np.concatenate([outward, -self.axis[None], self.axis[None]])

    @cached_property
    def volume_m3(self) -> float:
        """Volume of the polyhedron."""
        return self._area_moments[0] * 2 * self.half_length_m

    @cached_property
    def centroid_m(self) -> np.ndarray:
        """Centre of mass (3,) of the uniform solid in the object frame."""
        return self.lift(self._area_moments[1][None], 0.0)[0]

    def inertia_kg_m2(self, mass_kg: float) -> np.ndarray:
        """Principal moments (3,) about the centroid, along the object's axes, of the uniform solid."""
        _, _, (uu, vv) = self._area_moments
        ll = (2 * self.half_length_m) ** 2 / 12
        second = [uu, vv, ll] if self.kind == "cylinder" else [ll, uu, vv]
        return mass_kg * (sum(second) - np.array(second))

    @cached_property
    def _area_moments(self) -> tuple[float, np.ndarray, tuple[float, float]]:
        """Area, centroid (2,) and central second moments per area of the outline (Green's theorem).

        The outlines are mirrored about one axis, so the product of inertia is zero.
        """
        a, b = self.outline_m, np.roll(self.outline_m, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
        area = cross.sum() / 2
        centroid = ((a + b) * cross[:, None]).sum(axis=0) / (6 * area)
        second = ((a * a + a * b + b * b) * cross[:, None]).sum(axis=0) / (12 * area) - centroid**2
        return float(area), centroid, (float(second[0]), float(second[1]))
