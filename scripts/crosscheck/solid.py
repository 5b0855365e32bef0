"""The four primitive shapes as convex polyhedra, restated from the format's own words (meta/info.json, `frames`, `facets`).

Every solid is a convex polygon pushed along an axis. Round outlines have 24 flat sides a full turn. The object frame's
origin is the centre of the bounding box.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .hull import Convex

FACETS = 24
SHAPES = ("cuboid", "cylinder", "tri_prism", "half_cylinder")


@dataclass(frozen=True)
class Solid(Convex):
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

    @cached_property
    def vertices_m(self) -> np.ndarray:
        """Corners (2 n, 3): the lower end's, then the upper end's."""
        count, axis = len(self.outline_m), 2 if self.kind == "cylinder" else 0
        along = np.repeat([-1.0, 1.0], count) * self.extents_m[axis] / 2
        return np.insert(np.tile(self.outline_m, (2, 1)), axis, along, axis=1)

    @cached_property
    def faces(self) -> tuple[np.ndarray, ...]:
        """The sides, then both ends."""
        lower = np.arange(len(self.outline_m))
        upper = lower + len(lower)
        sides = np.stack([lower, np.roll(lower, -1), np.roll(upper, -1), upper], axis=1)
        return (*sides, lower[::-1], upper)

    def inertia_kg_m2(self, mass_kg: float) -> np.ndarray:
        """Principal moments (3,) about the centroid, along the object's axes, of the uniform solid."""
        second = np.diag(self.second_moments_m5) / self.volume_m3
        return mass_kg * (second.sum() - second)
