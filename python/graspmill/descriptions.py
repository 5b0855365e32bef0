"""Grippers from the descriptions of their makers: boxes around the collision geometry of a URDF or MJCF (needs MuJoCo).

    python -m graspmill.descriptions gripper.urdf --fingers left_finger,right_finger
    python -m graspmill.descriptions gripper.urdf --fingers left,right --out gripper.toml --force 40 --speed 0.05 --mass 0.06
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Sequence

import numpy as np

from . import _arrays, _native
from ._robots import Floats, GripperModel
from .errors import GraspmillError, InputError
from .grippers import LENGTHS, Gripper, lines

__all__ = ["GripperBoxes", "from_description"]

#: The last part of a finger, of which the jaws' distance is measured.
PAD_M = 0.015
#: Where fingers end and the palm begins is a choice. The boxes have the least volume, of which each part counts half as
#: much for so much more behind the tips: there are fewer things that it could hit.
HALF_M = 0.010
#: Nothing reaches further into the room between the fingers.
BETWEEN_M = 0.0005
STEP_M = 0.0005
#: What begins where the fingers end is behind them.
ROUNDING_M = 1e-6


@dataclass(frozen=True, eq=False)
class GripperBoxes:
    """The three boxes of a gripper around the geometry of a description, open. Lengths that are not listed are those of
    :class:`Gripper`.

    Attributes:
        opening_m_min: Distance of the inner faces with the joints at their other limit.
        flange_from_grasp: ``[4, 4]``, the grasp frame in the frame of the link ``flange``; ``None`` if it is not known.
        triangles: The shapes in the boxes, ``[N, 3, 3]`` in the grasp frame.
        notes: What was mended or left out, and what the boxes do not have.
    """

    path: Path
    opening_m_max: float
    opening_m_min: float
    finger_length_m: float
    finger_width_m: float
    finger_thickness_m: float
    palm_length_m: float
    palm_width_m: float
    palm_breadth_m: float
    flange_from_grasp: Floats | None
    triangles: Floats
    notes: tuple[str, ...]

    def gripper(self, name: str, **others: Any) -> Gripper:
        """The gripper, with what a description does not tell: ``finger_mass_kg``, ``finger_force_n``, ``closing_speed_m_s`` and,
        unless they are its defaults, ``friction`` and ``clearance_m`` of :class:`Gripper`."""
        lengths: dict[str, Any] = {key: getattr(self, key) for key in LENGTHS[:7]}
        return Gripper(name=name, flange_from_grasp=self.flange_from_grasp, **lengths, **others)

    def picture(self) -> str:
        """An SVG of the shapes and the boxes, in millimetres: seen along x and along y, with z down."""
        length, thickness, width, half = self.finger_length_m, self.finger_thickness_m, self.finger_width_m, self.opening_m_max / 2
        top, palms = -length - self.palm_length_m, {1: self.palm_breadth_m, 0: self.palm_width_m}
        boxes = [(1, at, -length, thickness, length) for at in (half, -half - thickness)] + [(0, -width / 2, -length, width, length)]
        boxes += [(axis, -palm / 2, top, palm, self.palm_length_m) for axis, palm in palms.items()]
        drawn, right = "<style>polygon{fill:#999;stroke:#999;stroke-width:.5}rect{fill:none;stroke:#c00;stroke-width:.5}</style>", 0.0
        for axis, palm in palms.items():
            drawn += f'<g transform="translate({right + 500 * palm + 10:.1f})">'
            for shape in np.unique((1e3 * self.triangles[..., [axis, 2]]).round().astype(int), axis=0):
                drawn += f'<polygon points="{" ".join(map(str, shape.ravel()))}"/>'
            for box in (np.multiply(1e3, box) for seen, *box in boxes if seen == axis):
                drawn += '<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>'.format(*box)
            drawn, right = drawn + "</g>", right + 1e3 * palm + 20
        frame = f'viewBox="0 {1e3 * top - 10:.1f} {right:.1f} {20 - 1e3 * top:.1f}" width="{4 * right:.0f}"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {frame}>{drawn}</svg>\n'


def _cut(triangles: Floats, z: float) -> Floats:
    # Of each triangle that reaches above a height the corners of what is above it, [N, 6, 3]; NaN for fewer corners.
    above = triangles[:, :, 2] >= z
    triangles, above = triangles[above.any(axis=1)], above[above.any(axis=1)]
    ends, crosses = np.roll(triangles, -1, axis=1), above != np.roll(above, -1, axis=1)
    share = np.divide(z - triangles[..., 2], ends[..., 2] - triangles[..., 2], where=crosses, out=np.full(crosses.shape, np.nan))
    return np.concatenate([np.where(above[..., None], triangles, np.nan), triangles + (ends - triangles) * share[..., None]], axis=1)


def _near(cut: Floats) -> float:
    # How near to the middle between the jaws it comes; below 0 where it is on both sides.
    return float(np.maximum(np.nanmin(cut[..., 1], axis=1), -np.nanmax(cut[..., 1], axis=1)).min(initial=np.inf))


def _along(axes: Floats, direction: Floats) -> Floats:
    nearest = int(np.abs(axes.T @ direction).argmax())
    return np.asarray(axes[:, nearest] * np.sign(axes[:, nearest] @ direction))


def _middle(triangles: Floats) -> Floats:
    points = triangles.reshape(-1, 3)
    return np.asarray((points.max(axis=0) + points.min(axis=0)) / 2)


def _frame(gripper: GripperModel, shapes: list[Floats]) -> tuple[Floats, Floats]:
    # The grasp frame in the world: a rotation, whose columns are its axes, and the origin between the tips.
    axes = gripper.data.xmat[gripper.palm].reshape(3, 3)
    sides = [np.concatenate([shape for shape, of in zip(shapes, gripper.sides) if of == side]) for side in (0, 1)]
    still = [shape for shape, geom in zip(shapes, gripper.geoms) if not gripper.moves(gripper.model.geom_bodyid[geom])]
    palm = _middle(np.concatenate(still)) if still else gripper.data.xpos[gripper.root]
    y = _along(axes, _middle(sides[1]) - _middle(sides[0]))
    towards = (_middle(sides[0]) + _middle(sides[1])) / 2 - palm
    z = _along(axes, towards - y * (y @ towards))
    x = np.cross(y, z)
    turn = np.stack([x, y, z], axis=1)
    local = [side.reshape(-1, 3) @ turn for side in sides]
    both = np.concatenate(local)
    tip = min(side[:, 2].max() for side in local)
    near = [side[side[:, 2] > tip - PAD_M] for side in local]
    first, second = sorted(near, key=lambda side: float(side[:, 1].mean()))
    origin = np.array([(both[:, 0].max() + both[:, 0].min()) / 2, (first[:, 1].max() + second[:, 1].min()) / 2, both[:, 2].max()])
    return turn, turn @ origin


def _opening(gripper: GripperModel, shapes: list[Floats]) -> tuple[float, float]:
    # The distance of the jaws, and where their tips are along z, from the palm.
    turn, origin = _frame(gripper, shapes)
    inner = []
    for side in (0, 1):
        y = _cut(np.concatenate([(shape - origin) @ turn for shape, of in zip(shapes, gripper.sides) if of == side]), -PAD_M)[..., 1]
        if not len(y):  # one finger is far behind the other
            return -np.inf, 0.0
        inner.append(float(np.nanmin(y * np.sign(np.nanmean(y)))))
    return 2 * min(inner), float(turn[:, 2] @ (origin - gripper.data.xpos[gripper.palm]))


def from_description(
    path: str | os.PathLike[str], fingers: Sequence[str], *, flange: str | None = None, without: Sequence[str] = ()
) -> GripperBoxes:
    """Fits the three boxes of a gripper around the collision geometry of a description, with the jaws opened as far as its joints
    allow. Nothing of the geometry is outside the boxes. Where no shape collides, all count.

    Args:
        path: A URDF (its name ends in .urdf; expand xacro files before) or an MJCF file, of the gripper or of a whole robot.
        fingers: The names of the two links, or bodies, that touch the object; +y of the grasp frame is from the first to the second.
        flange: The link whose frame is the robot's flange. By default the description's origin, if the gripper stands fixed there.
        without: Links whose shapes do not count, such as coarse ones around the gripper.

    Raises InputError if MuJoCo is missing, or the description has no such gripper; the message names the link, joint or file.
    """
    count = 1 if isinstance(fingers, str) else len(fingers)
    _arrays.must(count == 2, f"fingers must be two links, got {count}: graspmill has parallel jaws only")
    gripper = GripperModel(Path(_arrays.path("path", path)), (fingers[0], fingers[1]), flange, without)
    states = gripper.states()
    found = [_opening(gripper, gripper.shapes(state)) for state in states]
    opening, depth = best = max(found, key=lambda one: one[0])
    rule = f"the jaws {fingers[0]} and {fingers[1]} must open, and are {1e3 * opening:.1f} mm apart at best"
    _arrays.must(opening >= 0.001, f"{rule}: {gripper.path}")
    shapes = gripper.shapes(states[found.index(best)])
    turn, origin = _frame(gripper, shapes)
    local = [(shape - origin) @ turn for shape in shapes]
    _must_be_free(gripper, local, opening)
    everything = np.concatenate(local)
    length = _finger_length(everything, opening)
    (width, thickness), palm = _boxes(everything, opening, length)
    sizes = dict(zip(LENGTHS, (opening, length, width, thickness, *palm)))
    # Outwards to tenths of a millimetre.
    outwards: dict[str, Any] = {key: float((np.floor if key == "opening_m_max" else np.ceil)(round(value * 1e4, 2)) / 1e4) for key, value in sizes.items()}
    least = min(one for one in found if np.isfinite(one[0]))
    if abs(moved := least[1] - depth) > 0.001:
        way = f"{1e3 * abs(moved):.0f} mm {'forwards' if moved > 0 else 'back'}"
        gripper.notes.append(f"as the jaws close, their tips move {way} along z: no key has that; z = 0 is at the open tips")
    share = (2 * length * width * thickness + np.prod(palm)) / (8 * gripper.model.geom_aabb[gripper.geoms, 3:].prod(axis=1).sum())
    if share > 2:
        gripper.notes.append(f"the boxes are {share:.1f} times as large as boxes around each shape: look at them (--picture)")
    rest: dict[str, Any] = {"opening_m_min": max(0.0, least[0]), "flange_from_grasp": _flange(gripper, turn, origin)}
    return GripperBoxes(path=gripper.path, **outwards, **rest, triangles=everything, notes=tuple(gripper.notes))


def _must_be_free(gripper: GripperModel, local: list[Floats], opening: float) -> None:
    # Refuses what has no box: more fingers, and what reaches between the tips or beyond them.
    own = {body for finger in gripper.fingers for body in gripper.way(finger)}
    for geom, side, shape in zip(gripper.geoms, gripper.sides, local):
        body, near, reach = int(gripper.model.geom_bodyid[geom]), _near(_cut(shape, -PAD_M)), float(shape[..., 2].max())
        name = gripper.name(body)
        if side is None and reach > -PAD_M and body not in own and gripper.moves(body):
            raise InputError(f"a gripper must have two fingers, and {name} moves beside their tips, too: {gripper.path}")
        if near < opening / 2 - BETWEEN_M or (side is None and reach > BETWEEN_M):
            where = f"{name} reaches {f'{1e3 * reach:.0f} mm beyond' if reach > 0 else f'to {-1e3 * reach:.0f} mm behind'} the tips"
            rule = f"the jaws must be free of other parts over {1e3 * PAD_M:.0f} mm from the tips, and {where}: {gripper.path}"
            raise InputError(f"{rule}. If its shapes are coarse ones around those of others, leave it out: --without {name}")


def _boxes(everything: Floats, opening: float, length: float) -> tuple[tuple[float, float], tuple[float, float, float]]:
    # Of fingers of a length the width and the thickness, and of the palm behind them the lengths along z, x and y.
    cuts = _cut(everything, ROUNDING_M - length), _cut(everything * [1, 1, -1], length)
    front, back = (np.nanmax(np.abs(cut), axis=(0, 1)) for cut in cuts)
    return (2 * front[0], front[1] - opening / 2), (back[2] - length, 2 * back[0], 2 * back[1])


def _finger_length(everything: Floats, opening: float) -> float:
    deepest, best = -float(everything[..., 2].min()), (np.inf, 0.0)
    for length in np.arange(PAD_M, deepest, STEP_M):
        if _near(_cut(everything, ROUNDING_M - length)) < opening / 2 - BETWEEN_M:
            break
        (width, thickness), (_, palm_width, palm_breadth) = _boxes(everything, opening, length)
        behind = 0.5 ** (length / HALF_M)
        best = min(best, (2 * width * thickness * (1 - behind) + palm_width * palm_breadth * behind, float(length)))
    _arrays.must(best[1], f"fingers must be longer than {1e3 * PAD_M:.0f} mm, and nothing is behind them")
    return best[1]


def _flange(gripper: GripperModel, turn: Floats, origin: Floats) -> Floats | None:
    world_from_grasp = np.eye(4)
    world_from_grasp[:3, :3], world_from_grasp[:3, 3] = turn, origin
    world_from_flange = np.eye(4)
    if gripper.flange is not None:
        world_from_flange[:3, :3], world_from_flange[:3, 3] = gripper.data.xmat[gripper.flange].reshape(3, 3), gripper.data.xpos[gripper.flange]
    elif any(gripper.model.body_jntnum[body] for body in gripper.way(gripper.root)):
        return None
    return np.linalg.inv(world_from_flange) @ world_from_grasp


def _said(boxes: GripperBoxes) -> str:
    flange = boxes.flange_from_grasp
    rows = [f"{key:<20}{1e3 * getattr(boxes, key):>8.1f} mm" for key in ("opening_m_min", *LENGTHS[:7])]
    rows.append(f"flange_from_grasp   {'not known: give --flange' if flange is None else (1e3 * flange[:3, 3]).round(1).tolist()}")
    return "\n".join([*rows, *boxes.notes])


def __getattr__(name: str) -> Any:
    """The former name of :class:`GripperBoxes`, for one more version."""
    if name != "HandBoxes":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn("HandBoxes is GripperBoxes now", DeprecationWarning, stacklevel=2)
    return GripperBoxes


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="graspmill.descriptions", description="Fits a gripper's boxes to a URDF or MJCF.")
    parser.add_argument("path", help="the description: a URDF (.urdf) or an MJCF file")
    parser.add_argument("--fingers", required=True, metavar="LINK,LINK", help="the two links that touch the object")
    parser.add_argument("--flange", metavar="LINK", help="the link whose frame is the robot's flange")
    parser.add_argument("--without", default=[], type=lambda links: links.split(","), metavar="LINK,LINK", help="links that do not count")
    parser.add_argument("--picture", metavar="SVG", help="draw the shapes and the boxes")
    parser.add_argument("--out", metavar="TOML", help="write a gripper file; needs --mass, --force and --speed")
    for name, what in (("mass", "kg that move with a finger"), ("force", "newtons of one finger"), ("speed", "metres per second of one finger")):
        parser.add_argument(f"--{name}", type=float, help=what)
    given = parser.parse_args(words)
    try:
        boxes = from_description(given.path, given.fingers.split(","), flange=given.flange, without=given.without)
        print(_said(boxes))
        if given.picture:
            _native.publish(given.picture, boxes.picture())
        if given.out:
            if None in (given.mass, given.force, given.speed):
                raise InputError("--out needs --mass, --force and --speed, which no description tells")
            name = Path(given.out).stem
            gripper = boxes.gripper(name, finger_mass_kg=given.mass, finger_force_n=given.force, closing_speed_m_s=given.speed)
            head = f"# Boxes around the collision geometry of {boxes.path.name}. Compare them with the real gripper."
            _native.publish(given.out, "\n".join([head, *lines(gripper, 6), ""]))
    except GraspmillError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
