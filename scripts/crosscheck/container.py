"""What objects lie in, as convex parts, restated from docs/label.md and what the columns mean.

It stands in the middle of the workspace, its sides along the workspace's axes. Walls meet in mitres: a wall is the
profile of a vertical cut across it, drawn along its side and cut off at both ends along the diagonals.
"""

from dataclasses import dataclass
from math import tan

import numpy as np

from .hull import Hull, hull_of

KINDS = ("bin", "tray", "shelf")
# Axis across the wall, and the side of the middle that it is on.
LEFT, RIGHT, BACK, FRONT = (0, -1), (0, 1), (1, 1), (1, -1)


@dataclass(frozen=True)
class Container:
    """A container: `inner_m` (2,) is what its walls leave free along x and y at their upper edges."""

    kind: str
    inner_m: tuple[float, float]
    height_m: float
    thickness_m: float
    slope_rad: float

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"unknown container {self.kind!r}; known are {', '.join(KINDS)}")

    def parts(self, size_m: float, table_z_m: float) -> tuple[Hull, ...]:
        """Its parts in a workspace of side `size_m` whose table is at `table_z_m`."""
        lean_m = self.height_m * tan(self.slope_rad)
        # How far out of the inner outline, and how high above the table.
        wall = [(-lean_m, 0.0), (self.thickness_m - lean_m, 0.0), (self.thickness_m, self.height_m), (0.0, self.height_m)]
        sides = [LEFT, RIGHT, BACK] if self.kind == "shelf" else [LEFT, RIGHT, BACK, FRONT]
        parts = [self._wall(wall, *side) for side in sides]
        if self.kind == "shelf":
            parts.append(self._board())
        middle = np.array([size_m / 2, size_m / 2, table_z_m])
        return tuple(hull_of(part + middle) for part in parts)

    def _wall(self, profile: list[tuple[float, float]], axis: int, side: int) -> np.ndarray:
        """Corners (8, 3) from the middle of the floor."""
        corners = np.empty((2, len(profile), 3))
        for end, sign in enumerate((-1, 1)):
            for corner, (out_m, z_m) in enumerate(profile):
                corners[end, corner, axis] = side * (self.inner_m[axis] / 2 + out_m)
                corners[end, corner, 1 - axis] = sign * (self.inner_m[1 - axis] / 2 + out_m)
                corners[end, corner, 2] = z_m
        return corners.reshape(-1, 3)

    def _board(self) -> np.ndarray:
        """Corners (8, 3) of a board over the whole, on the walls."""
        x, y = (inner_m / 2 + self.thickness_m for inner_m in self.inner_m)
        low, high = self.height_m, self.height_m + self.thickness_m
        return np.array([[i * x, j * y, z] for i in (-1, 1) for j in (-1, 1) for z in (low, high)])
