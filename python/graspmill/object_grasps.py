"""Grasps of one object that floats: sets of ``graspmill objects annotate``, and files of others."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, Mapping, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from ._grasp_files import FORMATS, READERS, WRITERS, Format, Hand, entry, labels, loaded_json, module, numbers, table, whole_file
from ._grasp_frames import Axis, Numbers, of_quaternions, rigid
from .errors import InputError
from .grippers import Gripper, GripperLike

#: Numbers of each grasp, and their shapes; NaN where unknown.
_NUMBERS: dict[str, tuple[int, ...]] = {
    "width_m": (),
    "contacts_m": (2, 3),
    "normals": (2, 3),
    "closing_moved_m": (),
    "closing_turned_rad": (),
    "test_moved_m": (),
    "test_turned_rad": (),
    "friction_min": (),
    "tug_max_g": (),
    "robust_share": (),
    "on_table_share": (),
    "score": (),
    "opening_m": (),
}
#: Columns of a Parquet file with one number a grasp, by our names.
_COLUMNS = {name: name for name, shape in _NUMBERS.items() if not shape and name not in ("score", "opening_m")}
_COLUMNS["on_table_share"] = "free_on_table_share"

#: Numbers of a gripper.
_LENGTHS = tuple(one.name for one in fields(Gripper) if one.name not in ("name", "flange_from_grasp"))


def _unknown() -> Numbers:
    return np.empty(0)


def _no_words() -> NDArray[np.str_]:
    return np.empty(0, np.str_)


def _no_flags() -> NDArray[np.bool_]:
    return np.empty((0, 0), np.bool_)


@dataclass(frozen=True, eq=False)
class ObjectGrasps:
    """``N`` grasps of an object, in the frame of the object's file: its axes and origin, scaled to metres.

    Arrays that are not given are unknown: NaN in every entry. :func:`dataclasses.replace` makes a set with other
    values.

    Args:
        name: The object's name.
        object_from_grasp: ``[N, 4, 4]`` float64, the grasp frame in the object's: +z approach, +y closing direction,
            origin midway between the tips, in metres.
        held: ``[N]`` bool, whether the object bore the test in the hand; ``None`` where a file has no labels.
        outcome: ``[N]``, names of ``graspmill.OUTCOMES``; ``None`` where a file has none.
        file: The mesh that the object was read from.
        scale_m: Metres per unit of that file.
        source: ``[N]``, how each was drawn: ``antipodal``, ``normal``, ``displaced``, or ``given`` by others.
        width_m: ``[N]`` metres between the fingers after closing.
        contacts_m: ``[N, 2, 3]``, where the left (−y) and the right finger press, in the object's frame.
        normals: ``[N, 2, 3]``, the object's outward normals there.
        closing_moved_m: ``[N]``, how far the centre of mass moved while the hand closed. ACRONYM's number seems to be
            that of the origin of the object's frame.
        closing_turned_rad: ``[N]``, how far the object turned then.
        test_moved_m: ``[N]``, how far it was moved in the hand at the end of the test; of several loads the largest.
        test_turned_rad: ``[N]``, how far it was turned then.
        friction_min: ``[N]``, the smallest friction coefficient at which the hand bears its weight in six directions.
        tug_max_g: ``[N]``, the strongest pull that it bears in six directions, in g.
        robust_share: ``[N]``, the share of its repeats, with errors of the pose, that held.
        on_table_share: ``[N]``, the share of the drops in whose stable poses the hand stays off the table.
        score: ``[N]``, the number of a file by others: isaac_grasp's confidence, GraspNet's score.
        is_free_on_table: ``[N, P]`` bool, whether the hand stays off the table in each of ``P`` stable poses.
        stable_poses: How the object rests: for each pose its probability and ``table_from_object`` ``[4, 4]``. The
            table frame has z up, its top at 0.
        base_to_tips_m: From the hand's base to its tips, along the approach; ``None`` if it is not known.
        info: What else is known: the object, the hand, the test, the settings (``NAME.json``).
        opening_m: ``[N]``, metres between the fingers before closing, where each grasp has its own.

    Raises:
        InputError: If an array has a wrong shape, or a pose is not rigid; the message names it.
    """

    name: str
    object_from_grasp: NDArray[np.float64]
    held: NDArray[np.bool_] | None = None
    outcome: NDArray[np.str_] | None = None
    file: str = ""
    scale_m: float = 1.0
    source: NDArray[np.str_] = field(default_factory=_no_words)
    width_m: NDArray[np.float64] = field(default_factory=_unknown)
    contacts_m: NDArray[np.float64] = field(default_factory=_unknown)
    normals: NDArray[np.float64] = field(default_factory=_unknown)
    closing_moved_m: NDArray[np.float64] = field(default_factory=_unknown)
    closing_turned_rad: NDArray[np.float64] = field(default_factory=_unknown)
    test_moved_m: NDArray[np.float64] = field(default_factory=_unknown)
    test_turned_rad: NDArray[np.float64] = field(default_factory=_unknown)
    friction_min: NDArray[np.float64] = field(default_factory=_unknown)
    tug_max_g: NDArray[np.float64] = field(default_factory=_unknown)
    robust_share: NDArray[np.float64] = field(default_factory=_unknown)
    on_table_share: NDArray[np.float64] = field(default_factory=_unknown)
    score: NDArray[np.float64] = field(default_factory=_unknown)
    is_free_on_table: NDArray[np.bool_] = field(default_factory=_no_flags)
    stable_poses: list[tuple[float, NDArray[np.float64]]] = field(default_factory=list)
    base_to_tips_m: float | None = None
    info: dict[str, Any] = field(default_factory=dict)
    opening_m: NDArray[np.float64] = field(default_factory=_unknown)

    def __post_init__(self) -> None:
        def put(key: str, value: object) -> None:
            object.__setattr__(self, key, value)

        put("name", _arrays.text("name", self.name))
        put("file", _arrays.text("file", self.file))
        put("scale_m", _arrays.number("scale_m", self.scale_m, 1e-9, 1e9))
        poses = rigid("object_from_grasp", self.object_from_grasp)
        put("object_from_grasp", poses)
        if self.held is not None:
            put("held", labels("held", self.held, len(poses)))
        if self.outcome is not None:
            put("outcome", _words("outcome", self.outcome, len(poses)))
        source = np.full(len(poses), "given") if np.size(self.source) == 0 else self.source
        put("source", _words("source", source, len(poses)))
        for key, shape in _NUMBERS.items():
            put(key, _known(key, getattr(self, key), (len(poses), *shape)))
        stable = [(float(share), rigid("stable_poses", [pose])[0]) for share, pose in self.stable_poses]
        put("stable_poses", stable)
        free = _arrays.given("is_free_on_table", self.is_free_on_table)
        free = np.zeros((len(poses), len(stable)), bool) if free.size == 0 else free
        if free.shape != (len(poses), len(stable)) or free.dtype.kind != "b":
            rule = f"must be bool of the shape {[len(poses), len(stable)]}, grasps and stable poses"
            raise InputError(f"is_free_on_table {rule}, got {free.dtype} {list(free.shape)}")
        put("is_free_on_table", free)
        if self.base_to_tips_m is not None:
            put("base_to_tips_m", _arrays.number("base_to_tips_m", self.base_to_tips_m, 0.0, 10.0))
        put("info", table("info", self.info))

    def __len__(self) -> int:
        return len(self.object_from_grasp)

    def __repr__(self) -> str:
        held = "no labels" if self.held is None else f"{int(self.held.sum()):,} held"
        return f"ObjectGrasps({self.name!r}: {len(self):,} grasps, {held})"

    def subset(self, which: ArrayLike) -> ObjectGrasps:
        """Some of the grasps, such as ``grasps.subset(grasps.held)``.

        Args:
            which: ``[N]`` bool, or numbers of grasps.

        Raises:
            InputError: If it is neither, or a number is too large.
        """
        chosen = _arrays.given("which", which)
        chosen = chosen.astype(np.intp) if chosen.size == 0 and chosen.dtype.kind == "f" else chosen
        if chosen.ndim != 1 or chosen.dtype.kind not in "biu":
            raise InputError(f"which must be bool or whole numbers in one row, got {chosen.dtype} {list(chosen.shape)}")
        try:
            rows = np.arange(len(self))[chosen]
        except IndexError as error:
            raise InputError(f"which must be of the {len(self)} grasps, got {error}") from error
        per_grasp = ("object_from_grasp", "source", "is_free_on_table", "held", "outcome", *_NUMBERS)
        values: dict[str, Any] = {key: getattr(self, key) for key in per_grasp}
        values = {key: None if value is None else value[rows] for key, value in values.items()}
        return replace(self, **values)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> ObjectGrasps:
        """A set of ``graspmill objects annotate``. Needs pyarrow: ``pip install graspmill[grasps]``.

        Args:
            path: Its ``NAME.parquet``; ``NAME.json`` must be beside it.

        Raises:
            InputError: If a file is missing, damaged, or of something else.
        """
        file = _arrays.path("path", path)
        beside = os.path.splitext(file)[0] + ".json"
        for one, rule in ((file, "path must be a file"), (beside, "NAME.json must be beside NAME.parquet")):
            if not os.path.isfile(one):
                raise InputError(f"{rule}, got none: {one}")
        try:
            columns, info = _columns(file), table("the file", loaded_json(beside))
            return cls(**_of_columns(columns, info))
        except OSError as error:
            raise InputError(f"path must be a file that can be read, got {error}") from error
        except InputError as error:
            raise InputError(f"{error}: {file}") from error

    def save(
        self,
        path: str | os.PathLike[str],
        format: Format | None = None,
        *,
        base_to_tips_m: float | None = None,
        gripper: GripperLike | None = None,
        closing_axis: Axis | None = None,
    ) -> Path:
        """Writes a file for other projects, as ``graspmill objects annotate --format`` does. An existing file stays
        until it is replaced by the whole one. ``docs/exporting.md`` has the frames.

        Args:
            path: The file.
            format: ``"acronym"`` (needs h5py), ``"graspgen"``, ``"isaac_grasp"``, ``"molmospaces"`` or ``"graspnet"``;
                by default that of the path's ending: .h5, .json, .yaml, .npz or .npy.
            base_to_tips_m: From the hand's base to its tips, in place of the set's; for ACRONYM 0.1122 m.
            gripper: The hand, whose distance is used.
            closing_axis: The base frame's axis along which the hand closes: by default ``"x"`` for ACRONYM and
                GraspGen, ``"y"`` for isaac_grasp.

        Returns:
            The path.

        Raises:
            InputError: If the set has no labels and the format needs them, or the distance is not known.
            OutsideError: If the disk fails.
        """
        file = _arrays.path("path", path)
        chosen = _format(file, format)
        hand = _hand(base_to_tips_m, gripper, closing_axis)
        return whole_file(file, lambda part: WRITERS[chosen](self, part, hand))


def read_grasps(
    path: str | os.PathLike[str],
    format: Format | Literal["parquet"] | None = None,
    base_to_tips_m: float | None = None,
    gripper: GripperLike | None = None,
    closing_axis: Axis | None = None,
) -> ObjectGrasps:
    """Grasps of a file by others, in our frame. ``docs/exporting.md`` has their frames.

    Args:
        path: The file.
        format: ``"acronym"`` (needs h5py), ``"graspgen"``, ``"isaac_grasp"`` (needs PyYAML), ``"molmospaces"``,
            ``"graspnet"``, or ``"parquet"`` for :meth:`ObjectGrasps.load`; by default that of the path's ending: .h5,
            .json, .yaml, .npz, .npy or .parquet.
        base_to_tips_m: From the origin of the file's frame to the tips of the hand, along the approach. By default
            0.1122 m for ACRONYM and ``gripper.depth`` of the file for GraspGen. isaac_grasp has no such number: give
            it, or ``gripper``. MolmoSpaces and GraspNet do not need it.
        gripper: The hand: its distance is z of ``flange_from_grasp``, or else the length of finger and palm.
        closing_axis: The axis of the file's frame along which the hand closes: by default ``"x"`` for ACRONYM and
            GraspGen, ``"y"`` for isaac_grasp, whose files have the axes of their hand's link.

    Returns:
        The set. What the file does not say is NaN or ``None``.

    Raises:
        InputError: If the file is damaged or of something else, or the distance is not known.
    """
    file = _arrays.path("path", path)
    if format == "parquet" or (format is None and file.endswith(".parquet")):
        return ObjectGrasps.load(file)
    chosen, hand = _format(file, format), _hand(base_to_tips_m, gripper, closing_axis)
    if not os.path.isfile(file):
        raise InputError(f"path must be a file, got {file}")
    try:
        return ObjectGrasps(**READERS[chosen](file, hand))
    except OSError as error:
        raise InputError(f"path must be a file that can be read, got {error}") from error
    except InputError as error:
        raise InputError(f"{error}: {file}") from error


def _format(path: str, format: str | None) -> Format:
    chosen = FORMATS.get(os.path.splitext(path)[1].lower()) if format is None else format
    if chosen not in READERS:
        names = ", ".join(READERS)
        what = f"path must end with one of {', '.join(FORMATS)}, or format be given" if format is None else ""
        raise InputError(f"{what or f'format must be one of {names}'}, got {_arrays.shown(format or path)}")
    return chosen


def _hand(base_to_tips_m: float | None, gripper: GripperLike | None, closing_axis: str | None) -> Hand:
    """What the caller says of the hand, checked."""
    if closing_axis not in (None, "x", "y"):
        raise InputError(f"closing_axis must be x or y, got {_arrays.shown(closing_axis)}")
    given_m = None
    if base_to_tips_m is not None:
        given_m = _arrays.number("base_to_tips_m", base_to_tips_m, 0.0, 10.0)
    if gripper is None:
        return Hand(given_m, cast("Axis | None", closing_axis))
    known = gripper if isinstance(gripper, Gripper) else Gripper.load(gripper)
    about = {key: getattr(known, key) for key in ("name", *_LENGTHS)}
    given_m = _gripper_base_to_tips_m(known) if given_m is None else given_m
    return Hand(given_m, cast("Axis | None", closing_axis), about)


def _gripper_base_to_tips_m(gripper: Gripper) -> float:
    """From the hand's base to its tips: the flange's distance if it is known, else palm and fingers."""
    if gripper.flange_from_grasp is None:
        return gripper.finger_length_m + gripper.palm_length_m
    return _arrays.number("flange_from_grasp z", gripper.flange_from_grasp[2, 3], 0.0, 10.0)


def _known(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Numbers:
    """Numbers of this shape, NaN where unknown; an empty array is all unknown."""
    array = _arrays.given(name, value)
    if array.size == 0:
        return np.full(shape, np.nan)
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be numbers of the shape {list(shape)}, got {array.dtype} {list(array.shape)}")
    array = np.array(array, np.float64)
    if np.isinf(array).any():
        raise InputError(f"{name} must be finite, or NaN where unknown, got {int(np.isinf(array).sum())} infinities")
    return array


def _words(name: str, value: ArrayLike, count: int) -> NDArray[np.str_]:
    array = _arrays.given(name, value)
    array = np.empty(0, np.str_) if array.shape == (0,) else array
    if array.shape != (count,) or array.dtype.kind not in "UT":
        raise InputError(f"{name} must be {count} words, one a grasp, got {array.dtype} {list(array.shape)}")
    return array.astype(np.str_)


def _columns(file: str) -> dict[str, Any]:
    """Columns of a Parquet file as arrays; null is NaN."""
    parquet = module("pyarrow.parquet", "NAME.parquet")
    arrow = module("pyarrow", "NAME.parquet")
    try:
        with open(file, "rb") as opened:
            read = parquet.read_table(opened)
        return {name: read[name].to_numpy(zero_copy_only=False) for name in read.column_names}
    except (arrow.ArrowException, ValueError) as error:
        raise InputError(f"the file must be Parquet, got {error}") from error


def _of_columns(columns: Mapping[str, Any], info: dict[str, Any]) -> dict[str, Any]:
    """The arguments of a set: of its Parquet columns, and its ``NAME.json``."""

    def column(name: str) -> NDArray[Any]:
        return cast("NDArray[Any]", entry(name, columns))

    def words(name: str) -> NDArray[np.str_]:
        return np.array(column(name).tolist(), np.str_)

    thing = table("object", entry("object", info))
    poses = np.stack([column(name) for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")], axis=1)
    points = {
        key: np.stack([column(name.format(side, axis)) for side in ("left", "right") for axis in "xyz"], axis=1)
        for key, name in (("contacts_m", "{}_{}_m"), ("normals", "{}_normal_{}"))
    }
    stable = [stable_pose(one) for one in _arrays.listed("stable_poses", info.get("stable_poses", []))]
    if (free := column("free_on_table")).dtype.kind not in "iu":
        raise InputError(f"free_on_table must be whole numbers, got {free.dtype}")
    bits = free.astype(np.uint64)[:, None] >> np.arange(len(stable), dtype=np.uint64)
    return {
        "name": str(entry("object.name", thing)),
        "file": str(entry("object.file", thing)),
        "scale_m": entry("object.scale_m", thing),
        "object_from_grasp": of_quaternions("poses", poses),
        "held": column("held"),
        "outcome": words("outcome"),
        "source": words("source"),
        **{key: rows.reshape(-1, 2, 3) for key, rows in points.items()},
        **{ours: column(theirs) for ours, theirs in _COLUMNS.items()},
        "is_free_on_table": (bits & np.uint64(1)).astype(bool),
        "stable_poses": stable,
        "base_to_tips_m": _arrays.number("base_to_tips_m", entry("base_to_tips_m", info), 0.0, 10.0),
        "info": info,
    }


def stable_pose(value: object) -> tuple[float, Numbers]:
    """A stable pose of ``NAME.json``: its probability, and ``table_from_object``."""
    pose = table("stable_poses", value)
    position_m = numbers("stable_poses.position_m", entry("stable_poses.position_m", pose), (3,))
    turned = numbers("stable_poses.quaternion_xyzw", entry("stable_poses.quaternion_xyzw", pose), (4,))
    share = _arrays.number("stable_poses.probability", entry("stable_poses.probability", pose), 0.0, 1.0)
    return share, of_quaternions("stable_poses", [[*position_m, *turned]])[0]
