"""Grippers from the descriptions of their makers: boxes around the collision geometry of a URDF or MJCF (needs MuJoCo).

    python -m graspmill.descriptions gripper.urdf --fingers left_finger,right_finger
    python -m graspmill.descriptions gripper.urdf --fingers left,right --out gripper.toml --force 40 --speed 0.05 --mass 0.06
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass, replace
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
#: A finger that turns by more than this has boxes of its own. Its tip is where it comes first to the other one,
#: closed; of what comes there together what is nearest to its end, by this slope. Open, it may be so far behind the
#: other one.
TURN_RAD, SLOPE, BEHIND_M = 0.05, 0.02, 0.010
#: Tips that move more than this beside a straight way along y have ways of their own, and those that leave a line by
#: more go along arcs.
BESIDE_M, BOW_M = 0.002, 0.001
#: A jaw is cut into slices along z, which become so few boxes; those that together are no larger than by this share
#: become one.
SLICE_M, JAW_BOXES, JOINED = 0.002, 6, 0.01
#: Places of the joints that are looked at.
SHARES = 129
#: The thinnest box that a file may have.
THIN_M = 0.0005


@dataclass(frozen=True, eq=False)
class GripperBoxes:
    """The boxes of a gripper around the geometry of a description, open. Lengths that are not listed are :class:`Gripper`'s.

    Attributes:
        opening_m_min: Distance of the inner faces with the joints at their other limit.
        flange_from_grasp: ``[4, 4]``, the grasp frame in the frame of the link ``flange``; ``None`` if it is not known.
        triangles: The shapes in the boxes, ``[N, 3, 3]`` in the grasp frame; those of a jaw that turns as its boxes are given.
        jaws: The jaws as a file has them where one stands still or turns, or the tips move along z; otherwise none.
        joint: What the joint of such jaws is at when they are open and closed, if there is but one.
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
    jaws: tuple[dict[str, Any], ...]
    joint: tuple[float, float] | None
    notes: tuple[str, ...]

    def gripper(self, name: str, **others: Any) -> Gripper:
        """The gripper, with what a description does not tell: ``finger_mass_kg``, ``finger_force_n``, ``closing_speed_m_s`` and,
        unless they are its defaults, ``friction`` and ``clearance_m`` of :class:`Gripper`."""
        told: dict[str, Any] = {key: getattr(self, key) for key in (*LENGTHS[:7], "flange_from_grasp", "jaws", "joint")}
        return Gripper(name=name, **told, **others)

    def boxes(self) -> Floats:
        """All boxes by their corners, ``[N, 2, 3]`` in the grasp frame; those of a jaw that turns as they are given."""
        length, middle = self.finger_length_m, (self.opening_m_max + self.finger_thickness_m) / 2
        size = [self.finger_width_m, self.finger_thickness_m, length]
        fingers = [{"centre_m": [0, sign * middle, -length / 2], "size_m": size} for sign in (-1, 1)]
        own = [box for jaw in self.jaws for box in jaw.get("boxes", ())] or fingers
        palm = {"centre_m": [0, 0, -length - self.palm_length_m / 2], "size_m": [self.palm_width_m, self.palm_breadth_m, self.palm_length_m]}
        centres, sizes = (np.array([box[key] for box in (*own, palm)]) for key in ("centre_m", "size_m"))
        return np.stack([centres - sizes / 2, centres + sizes / 2], axis=1)

    def picture(self) -> str:
        """An SVG of the shapes and the boxes, in millimetres: seen along x and along y, with z down."""
        boxes, right = 1e3 * self.boxes(), 0.0
        drawn = "<style>polygon{fill:#999;stroke:#999;stroke-width:.5}rect{fill:none;stroke:#c00;stroke-width:.5}</style>"
        for axis in (1, 0):
            drawn += f'<g transform="translate({right - boxes[..., axis].min() + 10:.1f})">'
            for shape in np.unique((1e3 * self.triangles[..., [axis, 2]]).round().astype(int), axis=0):
                drawn += f'<polygon points="{" ".join(map(str, shape.ravel()))}"/>'
            for low, high in boxes[..., [axis, 2]]:
                drawn += '<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>'.format(*low, *(high - low))
            drawn, right = drawn + "</g>", right + np.ptp(boxes[..., axis]) + 20
        frame = f'viewBox="0 {boxes[..., 2].min() - 10:.1f} {right:.1f} {np.ptp(boxes[..., 2]) + 20:.1f}" width="{4 * right:.0f}"'
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


def _along(direction: Floats) -> Floats:
    nearest = int(np.abs(direction).argmax())
    return np.asarray(np.eye(3)[nearest] * np.sign(direction[nearest]))


def _around(points: Floats) -> Floats:
    # The lower and the upper corner of the box around points.
    points = points.reshape(-1, 3)
    return np.array([points.min(axis=0), points.max(axis=0)])


def _vector(turn: Floats) -> Floats:
    # A rotation as its axis times its angle.
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = float(np.linalg.norm(axis))
    return np.asarray(axis * (np.arctan2(sine, np.trace(turn) - 1) / max(sine, 1e-12)))


class _Hand:
    # The parts of a gripper while its joints go from where it is closed (0) to where its tips are furthest apart (1),
    # in the grasp frame: z, the approach, is from the palm to the tips, and y the way of the second finger against
    # the first.
    def __init__(self, gripper: GripperModel) -> None:
        self.gripper, self.frame, self.states = gripper, np.eye(4), np.array(gripper.corners())
        ends = [gripper.shapes(state) for state in self.states]
        still = [shape for shape, geom in zip(ends[0], gripper.geoms) if not gripper.moves(gripper.model.geom_bodyid[geom])]
        palm = _around(np.concatenate(still)).mean(axis=0) if still else np.zeros(3)
        # Points of what stands still, and of each jaw what moves furthest, and of that what is furthest from the palm.
        near = np.concatenate([part for shape in still for part in (*shape.swapaxes(0, 1), shape.mean(axis=1))] or [palm[None]])
        first, last = ({side: self.of(ends[end], side).reshape(-1, 3) for side in gripper.moving} for end in (0, -1))
        far = {}
        for side, points in first.items():
            moved = np.linalg.norm(last[side] - points, axis=1)
            away = np.where(moved > moved.max() - PAD_M, np.linalg.norm(points - palm, axis=1), -np.inf)
            far[side] = away > away.max() - PAD_M

        def tips(shapes: list[Floats]) -> list[Floats]:
            return [_around(self.of(shapes, side).reshape(-1, 3)[far[side]]).mean(axis=0) for side in gripper.moving]

        apart = [float(np.linalg.norm((other or near) - one, axis=1).min()) for one, *other in map(tips, ends)]
        closed, opened = int(np.argmin(apart)), int(np.argmax(apart))
        self.states = self.states[[closed, opened]] if gripper.free else self.states[:: 1 if closed < opened else -1]
        before, after = (np.array(tips(gripper.shapes(self.at(share)))) for share in (0.0, 0.05))
        y = _along(np.sum([(2 * side - 1) * way for side, way in zip(gripper.moving, after - before)], axis=0))
        towards = _around(before).mean(axis=0) - palm
        z = _along(towards - y * (y @ towards))
        self.frame[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
        turns = (np.linalg.norm(_vector(self.moved(side, 1.0, 0.0)[:3, :3])) for side in gripper.moving)
        self.is_turning = len(gripper.moving) == 1 or max(turns) > TURN_RAD
        self.fixed = next((side for side in (0, 1) if side not in gripper.moving), None)
        # Of each jaw what comes first to the other one, closed: near its tip, and the nearer that the better.
        sides = [self.side(self.shapes(0.0), side) for side in (0, 1)]
        cuts = [_cut(side, float(side[..., 2].max()) - PAD_M).reshape(-1, 3) for side in sides]
        self.tips = [cut[np.nanargmax((1 - 2 * side) * cut[:, 1] + SLOPE * cut[:, 2])] for side, cut in enumerate(cuts)]
        across = np.concatenate(cuts)[:, 0]
        self.middle = (np.nanmax(across) + np.nanmin(across)) / 2

    def of(self, shapes: list[Floats], *sides: int | None) -> Floats:
        return np.concatenate([shape for shape, side in zip(shapes, self.gripper.sides) if side in sides] or [np.empty((0, 3, 3))])

    def at(self, share: float) -> Floats:
        rows = np.linspace(0, 1, len(self.states))
        return np.array([np.interp(share, rows, column) for column in self.states.T])

    def shapes(self, share: float) -> list[Floats]:
        return [(shape - self.frame[:3, 3]) @ self.frame[:3, :3] for shape in self.gripper.shapes(self.at(share))]

    def side(self, shapes: list[Floats], side: int) -> Floats:
        return self.of(shapes, *((side,) if side in self.gripper.moving else (side, None)))

    def moved(self, side: int, start: float, end: float) -> Floats:
        # How a finger moves between two places, in the grasp frame.
        before, after = (self.gripper.pose(self.at(share), self.gripper.fingers[side]) for share in (start, end))
        return np.asarray(np.linalg.inv(self.frame) @ after @ np.linalg.inv(before) @ self.frame)

    def opening(self, share: float) -> tuple[float, Floats]:
        # The distance of the tips, and the middle between them.
        low, high = (_placed(self.moved(side, 0.0, share), tip) for side, tip in enumerate(self.tips))
        middle = np.array([self.middle, (low[1] + high[1]) / 2, min(low[2], high[2])])
        return float(high[1] - low[1]) if abs(high[2] - low[2]) <= BEHIND_M else -np.inf, middle

    def widest(self) -> tuple[float, float, float]:
        # Where the jaws are furthest apart, how far, and how far at least. The origin goes there.
        found = {float(share): self.opening(share) for share in np.linspace(0, 1, SHARES)}
        best = max(found, key=lambda share: (round(found[share][0], 6), share))
        opening, origin = found[best]
        if not self.is_turning:
            both = self.of(self.shapes(best), 0, 1)
            origin[[0, 2]] = (both[..., 0].max() + both[..., 0].min()) / 2, both[..., 2].max()
        self.frame[:3, 3] = self.frame[:3, :3] @ origin
        return best, opening, min((one for one, _ in found.values() if np.isfinite(one)), default=0.0)


def _placed(pose: Floats, point: Floats) -> Floats:
    return np.asarray(pose[:3, :3] @ point + pose[:3, 3])


def _way(tip: Floats, half: Floats, whole: Floats) -> dict[str, Any]:
    # A jaw's way, from how it is moved after half of it and after all.
    turn, middle, end = _vector(whole[:3, :3]), _placed(half, tip) - tip, _placed(whole, tip) - tip
    if np.linalg.norm(turn) > TURN_RAD:
        return {"turn_rad": turn, "pivot_m": np.linalg.lstsq(np.eye(3) - whole[:3, :3], whole[:3, 3], rcond=1e-6)[0]}
    line = end / max(float(np.linalg.norm(end)), 1e-12)
    along = middle @ line
    across = middle - line * along
    if (bow := float(np.linalg.norm(across))) < BOW_M:
        return {"slide_m": end}
    # The circle through the three: its centre is on the middle line of two of them.
    up = (along * (along - np.linalg.norm(end)) + bow**2) / (2 * bow)
    angle = 2 * np.arctan2(np.linalg.norm(end) / 2, -up)
    return {"turn_rad": np.cross(across / bow, line) * angle, "pivot_m": tip + end / 2 + across / bow * up, "keeps_parallel": True}


def _moved(way: dict[str, Any], points: Floats, share: float) -> Floats:
    # Where points are after a share of a way.
    if "turn_rad" not in way:
        return np.asarray(points + share * way.get("slide_m", np.zeros(3)))
    half = share * np.linalg.norm(way["turn_rad"]) / 2
    pose = [0, 0, 0, *(share * way["turn_rad"] * np.sinc(half / np.pi) / 2), np.cos(half)]
    return np.asarray((points - way["pivot_m"]) @ _arrays.matrices([pose])[0, :3, :3].T + way["pivot_m"])


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
    hand = _Hand(gripper)
    best, opening, least = hand.widest()
    rule = f"the jaws {fingers[0]} and {fingers[1]} must open, and are {1e3 * opening:.1f} mm apart at best"
    _arrays.must(opening >= 0.001, f"{rule}: {gripper.path}")
    local = hand.shapes(best)
    _must_be_free(hand, local, opening)
    tips = np.array([[0.0, side * opening / 2, 0.0] for side in (-1, 1)])
    ways, share = _ways(hand, best, tips)
    if hand.is_turning:
        *sizes, everything = _of_jaws(hand, local, opening, ways)
    else:
        everything = np.concatenate(local)
        length = _finger_length(everything, opening)
        sizes = [length, *_boxes(everything, opening, length)]
    joint, where = None, ""
    if ways and len(gripper.free) == 1:
        opened, closed = (float(hand.at(at)[gripper.model.jnt_qposadr[gripper.free[0]]]) for at in (best, 0.0))
        joint = (opened, opened + share * (closed - opened))
        where = f" where joint {gripper.model.joint(gripper.free[0]).name} is at {opened:.3f}"
    if ways and best < 1:
        gripper.notes.append(f"the widest opening is taken{where}: beyond, tips come nearer, or one is {1e3 * BEHIND_M:.0f} mm behind")
    if ways and least > BESIDE_M:
        gripper.notes.append(f"within their limits the jaws come no nearer than {1e3 * least:.1f} mm; in the file they close")
    # Outwards to tenths of a millimetre.
    tenths = zip(LENGTHS, (round(value * 1e4, 2) for value in (opening, *sizes)))
    told: dict[str, Any] = {key: float((np.floor if key == "opening_m_max" else np.ceil)(value) / 1e4) for key, value in tenths}
    is_known = gripper.flange is not None or not any(gripper.model.body_jntnum[body] for body in gripper.way(gripper.root))
    told["flange_from_grasp"] = np.linalg.inv(gripper.pose(hand.at(best), gripper.flange or 0)) @ hand.frame if is_known else None
    told |= {"opening_m_min": max(0.0, least), "triangles": everything, "jaws": tuple(ways), "joint": joint}
    boxes = GripperBoxes(path=gripper.path, **told, notes=())
    volume = _volume(boxes.boxes()) / (8 * gripper.model.geom_aabb[gripper.geoms, 3:].prod(axis=1).sum())
    if volume > 2:
        gripper.notes.append(f"the boxes are {volume:.1f} times as large as boxes around each shape: look at them (--picture)")
    return replace(boxes, notes=tuple(gripper.notes))


def _ways(hand: _Hand, best: float, tips: Floats) -> tuple[list[dict[str, Any]], float]:
    # The jaws' ways until their tips meet, none if that is straight along y, and what share that is of their ways to
    # where the joints close them.
    ways: list[dict[str, Any]] = [{}, {}]
    shares = np.linspace(0, 3, 301)
    for side in hand.gripper.moving:
        tip, half, whole = tips[side], hand.moved(side, best, best / 2), hand.moved(side, best, 0.0)
        ways[side] = way = _way(tip, half, whole)
        off = min(float(np.linalg.norm(_moved(way, tip, share) - _placed(half, tip))) for share in shares[:101])
        if off > BESIDE_M:
            name = hand.gripper.name(hand.gripper.fingers[side])
            hand.gripper.notes.append(f"on its way {name} is up to {1e3 * off:.0f} mm beside where it is; open and closed it is right")
    beside = max(float(np.abs(_moved(way, tip, 1.0) - tip)[[0, 2]].max()) for way, tip in zip(ways, tips))
    if not hand.is_turning and beside <= BESIDE_M:
        return [], 1.0
    left = np.array([np.diff([_moved(way, tip, share)[1] for way, tip in zip(ways, tips)])[0] for share in shares])
    at = int(np.argmax(left <= 0))
    _arrays.must(at, f"the jaws must close, and come no nearer than {1e3 * left[100]:.1f} mm on their ways: {hand.gripper.path}")
    share = float(np.interp(0, left[[at, at - 1]], shares[[at, at - 1]]))
    return [way | {key: share * way[key] for key in ("slide_m", "turn_rad") if key in way} for way in ways], share


def _room(rest: Floats, fixed: int | None, opening: float) -> float:
    # How far forwards what is no jaw reaches; of what carries a fixed one, where it is not behind that.
    sign, level = 1 if fixed == 0 else -1, -np.inf if fixed is None else -opening / 4
    return float(np.nanmax(_cut(rest[..., [0, 2, 1]] * [1, 1, sign], level)[..., 1], initial=-np.inf))


def _of_jaws(hand: _Hand, local: list[Floats], opening: float, ways: list[dict[str, Any]]) -> list[Any]:
    # Adds the boxes of jaws to their ways. The lengths of the fingers and the palm, and what is in the boxes.
    fixed, rest = hand.fixed, hand.of(local, hand.fixed, None)
    length = float(np.floor(1e4 * min(-_room(rest, fixed, opening), -rest[..., 2].min(initial=0.0) - 0.001)) / 1e4)
    _arrays.must(length >= PAD_M, f"fingers must be longer than {1e3 * PAD_M:.0f} mm, and nothing is behind them: {hand.gripper.path}")
    shown, ends = [rest], []
    for side, way in enumerate(ways):
        own, start = hand.side(local, side), ROUNDING_M - length if side == fixed else -np.inf
        turns = "turn_rad" in way and "keeps_parallel" not in way
        posed = [(at, _moved(way, own, at) if at else own) for at in (np.linspace(0, 1, 9) if turns else [0.0])]
        tried = [(_sliced(shape, start), shape, at) for at, shape in posed]
        boxes, shape, way["boxes_at"] = min(tried, key=lambda one: _volume(one[0]))
        way["boxes"] = [{"centre_m": box.mean(axis=0), "size_m": np.maximum(box[1] - box[0], THIN_M)} for box in boxes]
        shown += [] if side == fixed else [shape]
        ends.append(np.ptp(boxes[boxes[:, 1, 2].argmax()], axis=0)[:2])
    back = np.nanmax(np.abs(_cut(rest * [1, 1, -1], length)), axis=(0, 1))
    return [length, *np.max(ends, axis=0), back[2] - length, 2 * back[0], 2 * back[1], np.concatenate(shown)]


def _volume(boxes: Floats) -> float:
    return float((boxes[..., 1, :] - boxes[..., 0, :]).prod(axis=-1).sum())


def _sliced(triangles: Floats, start: float) -> Floats:
    # A few boxes, [N, 2, 3], that together hold what is beyond a height: slices, of which those are joined that cost
    # least.
    low, high = max(start, float(triangles[..., 2].min())), float(triangles[..., 2].max())
    edges = np.linspace(low, high, max(2, int((high - low) / SLICE_M) + 1))
    cuts, boxes = [_cut(triangles, z) for z in edges], []
    for at, top in enumerate(edges[1:]):
        points = np.concatenate([cuts[at].reshape(-1, 3), cuts[at + 1][:, 3:].reshape(-1, 3)])
        if len(points := points[points[:, 2] <= top + ROUNDING_M]):
            boxes.append(_around(points))
    while len(boxes) > 1:
        joined = [_around(np.array(pair)) for pair in zip(boxes, boxes[1:])]
        more = [_volume(both) - _volume(one) - _volume(two) for both, one, two in zip(joined, boxes, boxes[1:])]
        at = int(np.argmin(more))
        if len(boxes) <= JAW_BOXES and more[at] > JOINED * _volume(np.array(boxes)):
            break
        boxes[at : at + 2] = [joined[at]]
    return np.array(boxes)


def _must_be_free(hand: _Hand, local: list[Floats], opening: float) -> None:
    # Refuses what has no box: more fingers, and what reaches between the tips or beyond them.
    gripper = hand.gripper
    own = {body for finger in gripper.fingers for body in gripper.way(finger)}
    for geom, side, shape in zip(gripper.geoms, gripper.sides, local):
        body, near, reach = int(gripper.model.geom_bodyid[geom]), _near(_cut(shape, -PAD_M)), float(shape[..., 2].max())
        name = gripper.name(body)
        if side is None and reach > -PAD_M and body not in own and gripper.moves(body):
            raise InputError(f"a gripper must have two fingers, and {name} moves beside their tips, too: {gripper.path}")
        is_between = near < opening / 2 - BETWEEN_M or (side is None and reach > BETWEEN_M)
        if hand.is_turning:
            is_between = side not in gripper.moving and (reach := _room(shape, hand.fixed, opening)) > -PAD_M
        if is_between:
            where = f"{name} reaches {f'{1e3 * reach:.0f} mm beyond' if reach > 0 else f'to {-1e3 * reach:.0f} mm behind'} the tips"
            rule = f"the jaws must be free of other parts over {1e3 * PAD_M:.0f} mm from the tips, and {where}: {gripper.path}"
            raise InputError(f"{rule}. If its shapes are coarse ones around those of others, leave it out: --without {name}")


def _boxes(everything: Floats, opening: float, length: float) -> list[float]:
    # Of fingers of a length the width and the thickness, and of the palm behind them the lengths along z, x and y.
    cuts = _cut(everything, ROUNDING_M - length), _cut(everything * [1, 1, -1], length)
    front, back = (np.nanmax(np.abs(cut), axis=(0, 1)) for cut in cuts)
    return [2 * front[0], front[1] - opening / 2, back[2] - length, 2 * back[0], 2 * back[1]]


def _finger_length(everything: Floats, opening: float) -> float:
    deepest, best = -float(everything[..., 2].min()), (np.inf, 0.0)
    for length in np.arange(PAD_M, deepest, STEP_M):
        if _near(_cut(everything, ROUNDING_M - length)) < opening / 2 - BETWEEN_M:
            break
        width, thickness, _, palm_width, palm_breadth = _boxes(everything, opening, length)
        behind = 0.5 ** (length / HALF_M)
        best = min(best, (2 * width * thickness * (1 - behind) + palm_width * palm_breadth * behind, float(length)))
    _arrays.must(best[1], f"fingers must be longer than {1e3 * PAD_M:.0f} mm, and nothing is behind them")
    return best[1]


def _said(boxes: GripperBoxes) -> str:
    flange = boxes.flange_from_grasp
    rows = [f"{key:<20}{1e3 * getattr(boxes, key):>8.1f} mm" for key in ("opening_m_min", *LENGTHS[:7])]
    rows.append(f"flange_from_grasp   {'not known: give --flange' if flange is None else (1e3 * flange[:3, 3]).round(1).tolist()}")
    return "\n".join([*rows, *boxes.notes])


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
