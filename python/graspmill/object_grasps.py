"""Grasps of one object that floats: sets of ``graspmill objects annotate``, and files of others."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from .errors import InputError
from .grippers import GripperLike

Format = Literal["acronym", "graspgen", "isaac_grasp", "molmospaces", "graspnet"]
Axis = Literal["x", "y"]
Numbers = NDArray[np.float64]

#: Most grasps of a set, as for ``graspmill objects annotate``.
GRASPS_MAX = 1_000_000
#: The best grasps have tips that are further apart than this, or axes that are further turned than by 30 degrees.
APART_M, APART_COS = 0.02, 0.75**0.5
#: Numbers of each grasp, and their shapes; NaN where unknown.
NUMBERS: dict[str, tuple[int, ...]] = {"width_m": (), "contacts_m": (2, 3), "normals": (2, 3)}
NUMBERS |= dict.fromkeys(("closing_moved_m", "closing_turned_rad", "test_moved_m", "test_turned_rad", "friction_min", "tug_max_g"), ())
NUMBERS |= dict.fromkeys(("p_held", "clearance_m", "pushed_m", "on_table_share", "score", "opening_m"), ())


def _unknown() -> Numbers:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class ObjectGrasps:
    """``N`` grasps of an object, in the frame of the object's file: its axes and origin, scaled to metres.

    Arrays that are not given are unknown: NaN in every entry. :func:`dataclasses.replace` makes a set with other values.

    Args:
        object_from_grasp: ``[N, 4, 4]``: +z approach, +y closing direction, origin midway between the tips, in metres.
        held: ``[N]`` bool, whether the object bore the test in the gripper; ``None`` where a file has no labels.
        outcome: ``[N]``, names of ``graspmill.OUTCOMES``; ``None`` where a file has none.
        file: The mesh that the object was read from; ``scale_m`` is metres per unit of that file.
        source: ``[N]``, how each was drawn: ``antipodal``, ``normal``, ``displaced``, or ``given`` by others.
        width_m: ``[N]`` metres between the fingers after closing.
        contacts_m: ``[N, 2, 3]``, where the left (−y) and the right finger press, and ``normals``, the object's outward ones there.
        closing_moved_m: ``[N]``, how far the centre of mass moved (ACRONYM's may be the frame's origin) while the gripper closed, and
            ``closing_turned_rad``, how far the object turned.
        test_moved_m: ``[N]``, how far the test moved it in the gripper, and ``test_turned_rad``, turned it; the most of several loads.
        friction_min: ``[N]``, the smallest friction coefficient at which the grip bears its weight in six directions.
        tug_max_g: ``[N]``, the strongest pull that it bears in six directions, in g.
        p_held: ``[N]``, the share of its repeats, with errors of pose, friction, mass and force, that held.
        clearance_m: ``[N]``, how near the open gripper comes to the object, there and on its straight way: by so much its boxes could
            grow before they touch; below 0 how deep they are in it. Between -0.02 and 0.02.
        pushed_m: ``[N]``, how far the object was pushed aside where the open gripper would touch it by little; NaN if it was not.
        on_table_share: ``[N]``, the share of the drops in whose stable poses the gripper stays off the table.
        score: ``[N]``, the number of a file by others: isaac_grasp's confidence, GraspNet's score.
        is_free_on_table: ``[N, P]`` bool, whether the gripper stays off the table in each of ``P`` stable poses.
        stable_poses: How the object rests: probabilities and ``table_from_object`` ``[4, 4]``, z up from the table's top.
        base_to_tips_m: From the gripper's base to its tips, along the approach; ``None`` if it is not known.
        info: What else is known: the object, the gripper, the test, the settings (``NAME.json``).
        opening_m: ``[N]``, metres between the fingers before closing, where each grasp has its own.
    """

    name: str
    object_from_grasp: NDArray[np.float64]
    held: NDArray[np.bool_] | None = None
    outcome: NDArray[np.str_] | None = None
    file: str = ""
    scale_m: float = 1.0
    source: NDArray[np.str_] = field(default_factory=lambda: np.empty(0, np.str_))
    width_m: NDArray[np.float64] = field(default_factory=_unknown)
    contacts_m: NDArray[np.float64] = field(default_factory=_unknown)
    normals: NDArray[np.float64] = field(default_factory=_unknown)
    closing_moved_m: NDArray[np.float64] = field(default_factory=_unknown)
    closing_turned_rad: NDArray[np.float64] = field(default_factory=_unknown)
    test_moved_m: NDArray[np.float64] = field(default_factory=_unknown)
    test_turned_rad: NDArray[np.float64] = field(default_factory=_unknown)
    friction_min: NDArray[np.float64] = field(default_factory=_unknown)
    tug_max_g: NDArray[np.float64] = field(default_factory=_unknown)
    p_held: NDArray[np.float64] = field(default_factory=_unknown)
    clearance_m: NDArray[np.float64] = field(default_factory=_unknown)
    pushed_m: NDArray[np.float64] = field(default_factory=_unknown)
    on_table_share: NDArray[np.float64] = field(default_factory=_unknown)
    score: NDArray[np.float64] = field(default_factory=_unknown)
    is_free_on_table: NDArray[np.bool_] = field(default_factory=lambda: np.empty((0, 0), np.bool_))
    stable_poses: list[tuple[float, NDArray[np.float64]]] = field(default_factory=list)
    base_to_tips_m: float | None = None
    info: dict[str, Any] = field(default_factory=dict)
    opening_m: NDArray[np.float64] = field(default_factory=_unknown)

    def __post_init__(self) -> None:
        own = vars(self)
        own |= {key: _arrays.text(key, own[key]) for key in ("name", "file")}
        own["scale_m"] = _arrays.number("scale_m", self.scale_m, 1e-9, 1e9)
        own["object_from_grasp"] = _arrays.rigid("object_from_grasp", self.object_from_grasp, GRASPS_MAX)
        count, tips_m = len(self), self.base_to_tips_m
        own["held"] = None if self.held is None else labels("held", self.held, count)
        own["outcome"] = None if self.outcome is None else _words("outcome", self.outcome, count)
        own["source"] = _words("source", np.full(count, "given") if np.size(self.source) == 0 else self.source, count)
        own |= {key: _known(key, own[key], (count, *shape)) for key, shape in NUMBERS.items()}
        own["stable_poses"] = [(float(share), _arrays.rigid("stable_poses", [pose], 1)[0]) for share, pose in self.stable_poses]
        free, wanted = _arrays.given("is_free_on_table", self.is_free_on_table), (count, len(self.stable_poses))
        own["is_free_on_table"] = free = np.zeros(wanted, bool) if free.size == 0 else free
        rule = f"is_free_on_table must be bool of the shape {list(wanted)}, grasps and stable poses, got {_arrays.kind(free)}"
        _arrays.must(free.shape == wanted and free.dtype.kind == "b", rule)
        own["base_to_tips_m"] = None if tips_m is None else _arrays.number("base_to_tips_m", tips_m, 0.0, 10.0)
        _arrays.table("info", self.info)

    def __len__(self) -> int:
        return len(self.object_from_grasp)

    def __repr__(self) -> str:
        held = "no labels" if self.held is None else f"{int(self.held.sum()):,} held"
        return f"ObjectGrasps({self.name!r}: {len(self):,} grasps, {held})"

    def subset(self, which: ArrayLike) -> ObjectGrasps:
        """Some of the grasps, such as ``grasps.subset(grasps.held)``: ``which`` is ``[N]`` bool, or numbers of grasps."""
        chosen = _arrays.given("which", which)
        chosen = chosen.astype(np.intp) if chosen.size == 0 and chosen.dtype.kind == "f" else chosen
        is_fit = chosen.ndim == 1 and chosen.dtype.kind in "biu"
        _arrays.must(is_fit, f"which must be bool or whole numbers in one row, got {_arrays.kind(chosen)}")
        try:
            rows = np.arange(len(self))[chosen]
        except IndexError as error:
            raise InputError(f"which must be of the {len(self)} grasps, got {error}") from error
        per_grasp = ("object_from_grasp", "source", "is_free_on_table", "held", "outcome", *NUMBERS)
        values: dict[str, Any] = {key: getattr(self, key) for key in per_grasp}
        values = {key: None if value is None else value[rows] for key, value in values.items()}
        return replace(self, **values)

    def best(self, n: int) -> ObjectGrasps:
        """The strongest grasps that held, at most ``n`` and strongest first, of which none is within 20 mm and 30° of a
        stronger one (half turns are equal), as ``graspmill objects annotate --best`` keeps them: by ``tug_max_g`` times
        ``p_held`` times ``score``, as far as they are known. Where ``held`` is ``None``, all grasps count."""
        count = _arrays.whole("n", n, 1, GRASPS_MAX)
        likely = _factor(self.p_held)
        left = np.lexsort((-likely, -_factor(self.tug_max_g) * likely * _factor(self.score)))
        left = left if self.held is None else left[self.held[left]]
        best: list[int] = []
        while len(left) and len(best) < count:
            best.append(int(left[0]))
            others = self.object_from_grasp[left]
            left = left[1:][~_arrays.are_alike(others[0], others[1:], APART_M, APART_COS)]
        return self.subset(best)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> ObjectGrasps:
        """A set of ``graspmill objects annotate``: its ``NAME.parquet``, with ``NAME.json`` beside it
        (``graspmill[grasps]``). Raises InputError if a file is missing, damaged, or of something else."""
        from .formats import grasps

        return grasps.read(path, "parquet")

    def save(
        self, path: str | os.PathLike[str], format: Format | None = None, *, base_to_tips_m: float | None = None,
        gripper: GripperLike | None = None, closing_axis: Axis | None = None,
    ) -> Path:  # fmt: skip
        """Writes a file for other projects, as ``graspmill objects annotate --format`` does, and returns its path.
        Arguments are those of :func:`graspmill.read_grasps`, without Parquet; ``base_to_tips_m`` is by default the
        set's, for ACRONYM 0.1122 m. Raises InputError if the format needs labels or the distance and has none."""
        from .formats import grasps

        return grasps.write(self, path, format, base_to_tips_m, gripper, closing_axis)


def _factor(numbers: Numbers) -> Numbers:
    """The numbers; those that are not known are 0, and 1 if none is."""
    is_known = ~np.isnan(numbers)
    return np.where(is_known, numbers, 0.0 if is_known.any() else 1.0)


def labels(name: str, value: ArrayLike, count: int) -> NDArray[np.bool_]:
    if (array := _arrays.given(name, value)).shape != (count,):
        raise InputError(f"{name} must have the shape [{count}], one a grasp, got {list(array.shape)}")
    is_fit = array.dtype.kind in "biuf" and np.isin(array, (0, 1)).all()
    _arrays.must(is_fit, f"{name} must be true or false, or 1 or 0", array[:8].tolist())
    return array.astype(bool)


def _known(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Numbers:
    """Numbers of this shape, NaN where unknown; an empty array is all unknown."""
    array = _arrays.given(name, value)
    return _arrays.numbers(name, array, shape, has_gaps=True) if array.size else np.full(shape, np.nan)


def _words(name: str, value: ArrayLike, count: int) -> NDArray[np.str_]:
    array = _arrays.given(name, value)
    is_fit = array.shape == (count,) and (not count or array.dtype.kind in "UT")
    _arrays.must(is_fit, f"{name} must be {count} words, one a grasp, got {_arrays.kind(array)}")
    return array.astype(np.str_)


def stable_pose(value: object) -> tuple[float, Numbers]:
    """A stable pose of ``NAME.json``: its probability, and ``table_from_object``."""
    pose = _arrays.table("stable_poses", value)
    share, *parts = (_arrays.entry(f"stable_poses.{key}", pose) for key in ("probability", "position_m", "quaternion_xyzw"))
    position_m = _arrays.numbers("stable_poses.position_m", parts[0], (3,))
    turned = _arrays.numbers("stable_poses.quaternion_xyzw", parts[1], (4,))
    [table_from_object] = _arrays.of_quaternions("stable_poses", [[*position_m, *turned]], 1)
    return _arrays.number("stable_poses.probability", share, 0.0, 1.0), table_from_object
