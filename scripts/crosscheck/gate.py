"""A reimplementation of the geometric gate, which decides the attempts that are blocked before the gripper closes.

The approach is straight along the grasp's z, so what a box of the gripper sweeps is a longer box. Boxes are grown by
the clearance and tested against the polyhedra of objects and container by separating axes, in double precision, all attempts on an object at
once. `separation` keeps the widest gap along any axis, so that grazing cases can be distinguished from clear ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .contract import Gripper, GripperBox, Procedure, Scene, lowest_z_m
from .hull import Hull
from .pose import Pose
from .solid import Solid

HOME = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
# A fixture is looked for this far above a grasp, in a column of this half width.
COVER_M, COVER_HALF_M = 0.5, 1e-3


@dataclass(frozen=True)
class GateResult:
    """The gate's result for one attempt. `margin_m`: distance from the nearest change of the result."""

    outcome: str | None
    hit: str | None
    margin_m: float


def separation(solid: Solid | Hull, rotations: np.ndarray, positions_m: np.ndarray, boxes: list[GripperBox]) -> np.ndarray:
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
    parts = gripper.open_gripper()
    pregrasp = [box.shifted(back).grown(gripper.clearance_m) for box in parts]
    approach = [box.swept(back).grown(gripper.clearance_m) for box in parts]
    boxes = pregrasp + approach
    objects = np.stack([_gaps(o.solid.convexes, o.workspace_from_object, poses, boxes) for o in scene.objects], axis=1)
    container, table = _gaps(scene.fixtures, HOME, poses, boxes), _table_gaps(poses, boxes, table_z_m)
    results = []
    for row, attempt in enumerate(scene.attempts):
        others = np.delete(objects[row], attempt.target, axis=0).min(axis=0, initial=np.inf)
        gaps = {"target": objects[row, attempt.target], "other": others, "container": container[row], "table": table[row]}
        results.append(_verdict(gaps))
    return results


def touches(fixtures: Sequence[Hull], poses: list[Pose], boxes: list[GripperBox]) -> bool:
    """Whether any of `boxes` in the frame of any of `poses` overlaps a fixture."""
    return bool((_gaps(fixtures, HOME, poses, boxes) <= 0).any())


def is_covered(fixtures: Sequence[Hull], workspace_from_grasp: Pose) -> bool:
    """Whether a fixture is straight above a grasp, as the board of a shelf."""
    column = GripperBox(np.zeros(3), np.full(3, COVER_HALF_M)).swept(np.array([0.0, 0.0, COVER_M]))
    return touches(fixtures, [Pose(workspace_from_grasp.position_m, HOME.quat_xyzw)], [column])


def _gaps(parts: Sequence[Solid | Hull], pose: Pose, grasps: list[Pose], boxes: list[GripperBox]) -> np.ndarray:
    """Gap (a, b) between the nearest of the parts, which are at `pose`, and every box; infinite without parts."""
    back = np.stack([grasp.rotation.T for grasp in grasps])
    apart = pose.position_m - np.stack([grasp.position_m for grasp in grasps])
    turned, placed = back @ pose.rotation, np.einsum("aij,aj->ai", back, apart)
    nearest = np.full((len(grasps), len(boxes)), np.inf)
    for part in parts:
        nearest = np.minimum(nearest, separation(part, turned, placed, boxes))
    return nearest


def _table_gaps(grasps: list[Pose], boxes: list[GripperBox], table_z_m: float) -> np.ndarray:
    """Height (a, b) of every box above the table."""
    return np.array([[lowest_z_m(box, grasp) - table_z_m for box in boxes] for grasp in grasps])


def _verdict(gaps: dict[str, np.ndarray]) -> GateResult:
    """`gaps` (2 x boxes,) by what may be hit, in order of precedence: of the boxes at pre-grasp, then of their sweeps."""
    half = len(gaps["target"]) // 2
    parts = slice(0, half), slice(half, None)
    pregrasp, approach = (min(gap[part].min() for gap in gaps.values()) for part in parts)
    if approach > 0:
        return GateResult(None, None, float(approach))
    part, outcome = (parts[0], "pregrasp_collision") if pregrasp <= 0 else (parts[1], "approach_collision")
    margin = float(-pregrasp if pregrasp <= 0 else min(pregrasp, -approach))
    return GateResult(outcome, next(name for name, gap in gaps.items() if gap[part].min() <= 0), margin)
