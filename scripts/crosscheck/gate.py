"""A reimplementation of the geometric gate, which decides the attempts that are blocked before the hand closes.

The approach is straight along the grasp's z, so what a box of the hand sweeps is a longer box. Boxes are grown by the
clearance and tested against the objects' polyhedra by separating axes, in double precision, all attempts on an object at
once. `separation` keeps the widest gap along any axis, so that grazing cases can be distinguished from clear ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .contract import Gripper, HandBox, Procedure, Scene
from .pose import Pose
from .solid import Solid


@dataclass(frozen=True)
class GateResult:
    """The gate's result for one attempt. `margin_m`: distance from the nearest change of the result."""

    outcome: str | None
    hit: str | None
    margin_m: float


def separation(solid: Solid, rotations: np.ndarray, positions_m: np.ndarray, boxes: list[HandBox]) -> np.ndarray:
    """Widest gap (a, b) in metres between a solid and each of b boxes, for a poses of the solid in the boxes' frame.

    `rotations` (a, 3, 3) and `positions_m` (a, 3) are grasp_from_object. Negative: overlap, by its least depth.
    """
    corners = np.einsum("aij,vj->avi", rotations, solid.vertices_m) + positions_m[:, None]
    normals = np.einsum("aij,nj->ani", rotations, solid.normals)
    edges = np.einsum("aij,ej->aei", rotations, solid.edges)
    axes = np.concatenate([np.broadcast_to(np.eye(3), (len(rotations), 3, 3)), normals, _products(edges)], axis=1)
    along = np.einsum("avi,aki->avk", corners, axes)
    low, high = along.min(axis=1)[..., None], along.max(axis=1)[..., None]
    centre = np.einsum("aki,bi->akb", axes, np.stack([box.centre_m for box in boxes]))
    reach = np.einsum("aki,bi->akb", np.abs(axes), np.stack([box.half_m for box in boxes]))
    return (np.maximum(low - centre, centre - high) - reach).max(axis=1)


def _products(edges: np.ndarray) -> np.ndarray:
    """Unit products (a, 3 e, 3) of the box's edges with a solid's (a, e, 3); parallel pairs give the box's own x."""
    crossed = np.cross(np.eye(3)[None, :, None, :], edges[:, None, :, :]).reshape(len(edges), -1, 3)
    length = np.linalg.norm(crossed, axis=2, keepdims=True)
    parallel = length < 1e-4
    return np.where(parallel, np.array([1.0, 0.0, 0.0]), crossed / np.where(parallel, 1.0, length))


def judge(scene: Scene, poses: list[Pose], gripper: Gripper, procedure: Procedure, table_z_m: float) -> list[GateResult]:
    """The gate's results for the scene's attempts, whose grasps are at `poses`."""
    back = np.array([0.0, 0.0, -procedure.pregrasp_distance_m])
    hand = gripper.open_hand()
    pregrasp = [box.shifted(back).grown(gripper.clearance_m) for box in hand]
    approach = [box.swept_back(procedure.pregrasp_distance_m).grown(gripper.clearance_m) for box in hand]
    rotations = np.stack([pose.rotation for pose in poses])
    origins = np.stack([pose.position_m for pose in poses])
    gaps = np.stack([_object_gaps(o, rotations, origins, pregrasp + approach) for o in scene.objects], axis=1)
    table = _table_gaps(rotations, origins, pregrasp + approach, table_z_m)
    return [
        _verdict(gaps[row], table[row], attempt.target) for row, attempt in enumerate(scene.attempts)
    ]


def _object_gaps(scene_object, rotations: np.ndarray, origins: np.ndarray, boxes: list[HandBox]) -> np.ndarray:
    pose = scene_object.workspace_from_object
    back = np.swapaxes(rotations, 1, 2)
    turned, placed = back @ pose.rotation, np.einsum("aij,aj->ai", back, pose.position_m - origins)
    return np.min([separation(part, turned, placed, boxes) for part in scene_object.solid.convexes], axis=0)


def _table_gaps(rotations: np.ndarray, origins: np.ndarray, boxes: list[HandBox], table_z_m: float) -> np.ndarray:
    """Height (a, b) of every box above the table."""
    centre = np.einsum("ai,bi->ab", rotations[:, 2], np.stack([box.centre_m for box in boxes])) + origins[:, 2:]
    reach = np.einsum("ai,bi->ab", np.abs(rotations[:, 2]), np.stack([box.half_m for box in boxes]))
    return centre - reach - table_z_m


def _verdict(gaps: np.ndarray, table: np.ndarray, target: int) -> GateResult:
    """`gaps` (objects, 6) and `table` (6,): the first three boxes are the hand at pre-grasp, the others its sweep."""
    half = len(table) // 2
    nearest = [min(gaps[:, part].min(), table[part].min()) for part in (slice(0, half), slice(half, None))]
    pregrasp, approach = nearest
    if approach > 0:
        return GateResult(None, None, float(approach))
    part, outcome = (slice(0, half), "pregrasp_collision") if pregrasp <= 0 else (slice(half, None), "approach_collision")
    margin = float(-pregrasp if pregrasp <= 0 else min(pregrasp, -approach))
    return GateResult(outcome, _first_hit(gaps[:, part], target), margin)


def _first_hit(gaps: np.ndarray, target: int) -> str:
    touched = gaps.min(axis=1) <= 0
    if touched[target]:
        return "target"
    return "other" if touched.any() else "table"
