"""Files of grasps that other projects read: ACRONYM, GraspGen, isaac_grasp, MolmoSpaces and GraspNet.

A reader returns the arguments of an ``ObjectGrasps``; a writer writes one. Readers and writers refuse what is wrong
with an ``InputError`` without the path, which the caller adds.
"""

from __future__ import annotations

import importlib
import json
import os
import tokenize
import warnings
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Literal, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from ._grasp_frames import (
    ACRONYM_BASE_TO_TIPS_M,
    GRASPNET_DEPTH_M,
    GRASPS_MAX,
    Axis,
    Numbers,
    from_base,
    from_graspnet,
    rigid,
    to_base,
    to_graspnet,
)
from .errors import InputError, OutsideError

if TYPE_CHECKING:
    from .object_grasps import ObjectGrasps

Format = Literal["acronym", "graspgen", "isaac_grasp", "molmospaces", "graspnet"]

#: GraspNet's height of a hand whose fingers' width is not known, in metres, as in its labels.
GRASPNET_HEIGHT_M = 0.02
#: GraspNet's score is this less the smallest friction coefficient.
GRASPNET_SCORE = 1.1
#: Hands with the driven joint below, whose value is half the distance between the fingers.
PANDA_NAMES = ("franka_hand", "panda", "panda_hand")
PANDA_JOINT = "panda_finger_joint1"
#: Ending of a file's name, and its format.
FORMATS: dict[str, Format] = {
    ".h5": "acronym",
    ".hdf5": "acronym",
    ".json": "graspgen",
    ".yaml": "isaac_grasp",
    ".yml": "isaac_grasp",
    ".npz": "molmospaces",
    ".npy": "graspnet",
}


@dataclass(frozen=True)
class Hand:
    """What the caller says of the hand; the rest is taken from the file, or from the set that is written.

    Attributes:
        base_to_tips_m: From the base of the hand to its tips, along the approach, in metres.
        closing_axis: Which axis of the base frame is the closing direction.
        gripper: Its name and lengths, as in ``NAME.json``.
    """

    base_to_tips_m: float | None = None
    closing_axis: Axis | None = None
    gripper: dict[str, Any] = field(default_factory=dict)


def module(name: str, what: str) -> Any:
    """A package that is not required, when it is needed."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        pip = {"yaml": "pyyaml"}.get(name, name.partition(".")[0])
        raise InputError(f"{what} needs {pip}: pip install graspmill[grasps]") from error


def whole_file(file: str, write: Callable[[str], object]) -> Path:
    """Writes a file beside its place and moves it there, so that an old one stays until the new one is whole.

    Raises:
        InputError: If the folder is missing or may not be written, or of what is written.
        OutsideError: If the disk fails.
    """
    folder, name = os.path.split(file)
    if not os.path.isdir(folder or ".") or os.path.isdir(file):
        raise InputError(f"path must be a file in a folder that exists, got {file}")
    part = os.path.join(folder, f".{name}.{os.getpid()}.part")
    try:
        write(part)
        os.replace(part, file)
    except InputError as error:
        raise InputError(f"{error}: {file}") from error
    except PermissionError as error:
        raise InputError(f"path must be a file that may be written, got {error}") from error
    except OSError as error:
        raise OutsideError(f"failed to write {file}: {error}") from error
    finally:
        if os.path.exists(part):
            os.unlink(part)
    return Path(file)


# Parts of files


def loaded_json(path: str) -> Any:
    """What a JSON file holds."""
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the file must be JSON, got {error}") from error


def table(name: str, value: object) -> dict[Any, Any]:
    """A mapping of a file."""
    if not isinstance(value, dict):
        raise InputError(f"{name} must be a mapping, got {_arrays.shown(value)}")
    return value


def entry(name: str, value: Mapping[Any, Any]) -> Any:
    """A value that a mapping must have; ``name`` ends with its key, after a dot."""
    key = name.rpartition(".")[2]
    if key not in value:
        raise InputError(f"{name} must be in the file, got the keys {_arrays.shown(list(value)[:8])}")
    return value[key]


def word(name: str, value: object) -> str:
    """A text of a file, which HDF5 gives as bytes."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    if not isinstance(value, str):
        raise InputError(f"{name} must be a text, got {_arrays.shown(value)}")
    return _arrays.text(name, value)


def numbers(name: str, value: ArrayLike, shape: tuple[int, ...], *, has_gaps: bool = False) -> Numbers:
    """Numbers of this shape as float64, finite unless some may be missing (NaN)."""
    array = _arrays.given(name, value)
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be numbers of the shape {list(shape)}, got {array.dtype} {list(array.shape)}")
    array = np.array(array, np.float64)
    if np.isinf(array).any() or (not has_gaps and np.isnan(array).any()):
        raise InputError(f"{name} must be finite, got {_arrays.shown(array.tolist())}")
    return array


def labels(name: str, value: ArrayLike, count: int) -> NDArray[np.bool_]:
    """Labels ``[N]``, true or false or 1 or 0."""
    array = _arrays.given(name, value)
    if array.shape == (0,):
        array = np.empty(0, bool)
    if array.shape != (count,):
        raise InputError(f"{name} must have the shape [{count}], one a grasp, got {list(array.shape)}")
    if array.dtype.kind not in "biuf" or not np.isin(array, (0, 1)).all():
        raise InputError(f"{name} must be true or false, or 1 or 0, got {_arrays.shown(array.tolist()[:8])}")
    return array.astype(bool)


def _stem(path: str) -> str:
    name = os.path.splitext(os.path.basename(path))[0]
    ends = [end for end in (*(f".{one}" for one in FORMATS.values()), ".grasps") if name.endswith(end)]
    return name[: -len(ends[0])] if ends else name


def _known_m(hand: Hand, of_file: float | None, what: str) -> float:
    """From the hand's base to its tips, of the caller or else of the file."""
    known_m = hand.base_to_tips_m if hand.base_to_tips_m is not None else of_file
    if known_m is None:
        raise InputError(f"base_to_tips_m or gripper must be given: {what} does not say where the tips of the hand are")
    return known_m


def _info(of: str, gripper: Mapping[str, Any], **thing: Any) -> dict[str, Any]:
    """What is known besides the grasps, with the keys of ``NAME.json``."""
    known = {key: value for key, value in gripper.items() if value is not None}
    return {"format": of, "object": thing, "gripper": known}


def _labelled(grasps: ObjectGrasps, what: str) -> NDArray[np.bool_]:
    if grasps.held is None:
        raise InputError(f"held must be known for {what}, got None: dataclasses.replace(grasps, held=…) states it")
    return grasps.held


def _part(grasps: ObjectGrasps, name: str) -> dict[str, Any]:
    return table(f"info.{name}", grasps.info.get(name, {}))


def _opening_m(grasps: ObjectGrasps) -> float | None:
    opening_m = _part(grasps, "gripper").get("opening_m_max")
    return None if opening_m is None else _arrays.number("info.gripper.opening_m_max", opening_m, 0.0, 10.0)


def _hand_name(grasps: ObjectGrasps) -> str:
    return _arrays.text("info.gripper.name", _part(grasps, "gripper").get("name", ""))


# ACRONYM

_FLEX = "grasps/qualities/flex/"
_MOTIONS = {
    "closing_moved_m": "object_motion_during_closing_linear",
    "closing_turned_rad": "object_motion_during_closing_angular",
    "test_moved_m": "object_motion_during_shaking_linear",
    "test_turned_rad": "object_motion_during_shaking_angular",
}
#: Keys of an object in ``NAME.json``, ACRONYM's names for them, and their shapes.
_SOLID = {
    "mass_kg": ("mass", ()),
    "friction": ("friction", ()),
    "density_kg_m3": ("density", ()),
    "volume_m3": ("volume", ()),
    "centre_of_mass_m": ("com", (3,)),
    "inertia_kg_m2": ("inertia", (3, 3)),
}


def _products_negated(inertia: Numbers) -> Numbers:
    """ACRONYM's products of inertia have the opposite sign of the tensor's: +∫xy for −∫xy."""
    return 2.0 * np.diag(np.diag(inertia)) - inertia


def read_acronym(path: str, hand: Hand) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``."""
    h5py = module("h5py", "a file of ACRONYM")

    def value(key: str, shape: tuple[int, ...] | None = None, has_gaps: bool = False) -> Any:
        found = file.get(key)
        if found is None:
            return None
        if not isinstance(found, h5py.Dataset) or found.size is None or found.size > 16 * GRASPS_MAX:
            raise InputError(f"{key} must be an array of at most {GRASPS_MAX} grasps, got {_arrays.shown(found)}")
        return found[()] if shape is None else numbers(key, found[()], shape, has_gaps=has_gaps)

    try:
        with h5py.File(path, "r") as file:
            entry("grasps/transforms", {"grasps/transforms": 0} if "grasps/transforms" in file else dict.fromkeys(file))
            base_m = _known_m(hand, ACRONYM_BASE_TO_TIPS_M, "ACRONYM")
            poses = from_base(rigid("grasps/transforms", value("grasps/transforms")), base_m, hand.closing_axis or "x")
            held = value(_FLEX + "object_in_gripper")
            motions = {ours: value(_FLEX + theirs, (len(poses),), True) for ours, theirs in _MOTIONS.items()}
            solid = {ours: value(f"object/{theirs}", shape) for ours, (theirs, shape) in _SOLID.items()}
            scale_m, opening = value("object/scale", ()), value("gripper/configuration", (1,))
            mesh, kind = value("object/file"), value("gripper/type")
    except InputError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"the file must be ACRONYM's HDF5, got {error}") from error
    if mesh is None or scale_m is None:
        raise InputError(f"object/{'file' if mesh is None else 'scale'} must be in the file, got none")
    if solid["inertia_kg_m2"] is not None:
        solid["inertia_kg_m2"] = _products_negated(solid["inertia_kg_m2"])
    known = {key: one.tolist() for key, one in solid.items() if one is not None}
    gripper = {
        "name": None if kind is None else word("gripper/type", kind),
        "opening_m_max": None if opening is None else 2.0 * float(opening[0]),
    }
    return {
        "name": _stem(path),
        "file": word("object/file", mesh),
        "scale_m": float(scale_m),
        "object_from_grasp": poses,
        "held": None if held is None else labels(_FLEX + "object_in_gripper", held, len(poses)),
        "base_to_tips_m": base_m,
        "info": _info("acronym", {**gripper, **hand.gripper}, **known),
        **{key: one for key, one in motions.items() if one is not None},
    }


def write_acronym(grasps: ObjectGrasps, path: str, hand: Hand) -> None:
    """Motions during the test are ACRONYM's only if the test was a shake; what is not known is left out."""
    h5py = module("h5py", "a file of ACRONYM")
    base_m = _known_m(hand, ACRONYM_BASE_TO_TIPS_M, "ACRONYM")
    held, thing = _labelled(grasps, "ACRONYM"), _part(grasps, "object")
    is_shake = grasps.info.get("test", "shake") == "shake"
    opening_m = _opening_m(grasps)
    values: dict[str, Any] = {
        "grasps/transforms": to_base(grasps.object_from_grasp, base_m, hand.closing_axis or "x"),
        _FLEX + "object_in_gripper": held.astype(np.int64),
        "object/scale": np.float64(grasps.scale_m),
    }
    for ours, theirs in _MOTIONS.items():
        if not np.isnan(getattr(grasps, ours)).all() and (is_shake or ours.startswith("closing")):
            values[_FLEX + theirs] = getattr(grasps, ours)
    for ours, (theirs, shape) in _SOLID.items():
        if ours in thing:
            number = numbers(f"info.object.{ours}", thing[ours], shape)
            values[f"object/{theirs}"] = _products_negated(number) if shape == (3, 3) else number
    if opening_m is not None:
        values["gripper/configuration"] = np.array([0.5 * opening_m])
    with h5py.File(path, "w") as file:
        for key, number in values.items():
            options = {"compression": "gzip", "compression_opts": 4} if np.ndim(number) and np.size(number) else {}
            file.create_dataset(key, data=number, **options)
        for key, text in (("object/file", grasps.file), ("gripper/type", _hand_name(grasps))):
            file.create_dataset(key, data=text, dtype=h5py.string_dtype())


# GraspGen


def read_graspgen(path: str, hand: Hand) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``."""
    data = table("the file", loaded_json(path))
    thing, grasps = table("object", entry("object", data)), table("grasps", entry("grasps", data))
    gripper = table("gripper", data.get("gripper", {}))
    depth_m = gripper.get("depth")
    depth_m = None if depth_m is None else _arrays.number("gripper.depth", depth_m, 0.0, 10.0)
    base_m = _known_m(hand, depth_m, "the file")
    bases = rigid("grasps.transforms", entry("grasps.transforms", grasps))
    held = entry("grasps.object_in_gripper", grasps)
    known = {"name": gripper.get("name"), "opening_m_max": gripper.get("width")}
    contacts = grasps.get("contacts_m")  # ours
    return {
        "name": _stem(path),
        "file": word("object.file", entry("object.file", thing)),
        "scale_m": _arrays.number("object.scale", entry("object.scale", thing), 0.0, 1e9),
        "object_from_grasp": from_base(bases, base_m, hand.closing_axis or "x"),
        "held": labels("grasps.object_in_gripper", held, len(bases)),
        "base_to_tips_m": base_m,
        "info": _info("graspgen", {**known, **hand.gripper}),
        **({} if contacts is None else {"contacts_m": _contacts("grasps.contacts_m", contacts, len(bases))}),
    }


def _contacts(name: str, value: object, count: int) -> Numbers:
    """Points ``[N, 2, 3]``, NaN for null."""
    pairs = value if isinstance(value, list) else []
    if len(pairs) != count or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        raise InputError(f"{name} must be {count} pairs of points or null, got {_arrays.shown(value)}")
    points = [[[np.nan] * 3 if point is None else point for point in pair] for pair in pairs]
    return numbers(name, points, (count, 2, 3), has_gaps=True) if count else np.empty((0, 2, 3))


def write_graspgen(grasps: ObjectGrasps, path: str, hand: Hand) -> None:
    """As ``graspmill objects annotate --format graspgen``."""
    base_m = _known_m(hand, grasps.base_to_tips_m, "the set")
    gripper = {"name": _hand_name(grasps), "width": _opening_m(grasps), "depth": base_m}
    contacts = [[None if np.isnan(at).any() else at.tolist() for at in pair] for pair in grasps.contacts_m]
    value = {
        "object": {"file": grasps.file, "scale": grasps.scale_m},
        "gripper": {key: one for key, one in gripper.items() if one is not None},
        "grasps": {
            "transforms": to_base(grasps.object_from_grasp, base_m, hand.closing_axis or "x").tolist(),
            # GraspGen indexes with them: booleans select, numbers would not.
            "object_in_gripper": _labelled(grasps, "GraspGen").tolist(),
            "contacts_m": contacts,
        },
    }
    with open(path, "w", encoding="utf-8") as file:
        json.dump(value, file, ensure_ascii=False, allow_nan=False)
        file.write("\n")


# isaac_grasp


def _numbers(name: str, value: object, count: int) -> list[float]:
    if not isinstance(value, list) or len(value) != count:
        raise InputError(f"{name} must be {count} numbers, got {_arrays.shown(value)}")
    return [_arrays.number(name, one, -_arrays.FAR_M_MAX, _arrays.FAR_M_MAX) for one in value]


def _isaac_row(name: str, value: object) -> tuple[list[float], float, float, float]:
    """Pose ``[7]`` of the base, confidence, distance between the closed fingers and between the open ones, or NaN."""
    grasp = table(name, value)
    turned = table(f"{name}.orientation", entry(f"{name}.orientation", grasp))
    w, xyz = (entry(f"{name}.orientation.{key}", turned) for key in ("w", "xyz"))
    pose = _numbers(f"{name}.position", entry(f"{name}.position", grasp), 3)
    pose += _numbers(f"{name}.orientation.xyz", xyz, 3) + [_arrays.number(f"{name}.orientation.w", w, -2.0, 2.0)]
    length = float(np.linalg.norm(pose[3:]))
    if abs(length - 1.0) > _arrays.RIGID_OFF_MAX:
        rule = f"must have the length 1 within {_arrays.RIGID_OFF_MAX:g}"
        raise InputError(f"{name}.orientation {rule}, got {length:.4g}")
    confidence = _arrays.number(f"{name}.confidence", grasp.get("confidence", 1.0), 0.0, 1.0)
    widths_m = []
    for key in ("cspace_position", "pregrasp_cspace_position"):
        joints = table(f"{name}.{key}", grasp.get(key) or {})
        joint_m = joints.get(PANDA_JOINT)
        widths_m.append(np.nan if joint_m is None else 2.0 * _arrays.number(f"{name}.{key}", joint_m, -1.0, 1.0))
    return pose, confidence, widths_m[0], widths_m[1]


def read_isaac_grasp(path: str, hand: Hand) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``."""
    yaml = module("yaml", "isaac_grasp")
    try:
        with open(path, "rb") as file:
            loaded = yaml.load(file, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"the file must be YAML, got {str(error)[:200]}") from error
    data = table("the file", loaded)
    if data.get("format") != "isaac_grasp":
        raise InputError(f"format must be isaac_grasp, got {_arrays.shown(data.get('format'))}")
    if str(data.get("format_version")) not in ("1.0", "1"):
        version = _arrays.shown(data.get("format_version"))
        warnings.warn(f"format_version is {version}, and is read as 1.0: {path}", stacklevel=4)
    if data.get("approach_axis", 2) != 2:  # GraspDataGen's
        raise InputError(f"approach_axis must be 2 (z), got {_arrays.shown(data['approach_axis'])}")
    base_m = _known_m(hand, None, "isaac_grasp")
    grasps = table("grasps", entry("grasps", data))
    if len(grasps) > GRASPS_MAX:
        raise InputError(f"grasps must be at most {GRASPS_MAX}, got {len(grasps)}")
    rows = [_isaac_row(f"grasps.{str(key)[:60]}", value) for key, value in grasps.items()]
    poses, confidences, widths_m, openings_m = zip(*rows) if rows else ([], [], [], [])
    bases = _arrays.matrices(np.reshape(np.array(poses, np.float64), (-1, 7)))
    score = np.array(confidences, np.float64)
    # The editor writes 0 for what escaped, 0.5 for what was lost later, 1 for what was kept. Others are a network's.
    held = score == 1.0 if np.isin(score, (0.0, 0.5, 1.0)).all() else None
    frame = data.get("gripper_frame", data.get("gripper_frame_link"))
    open_m = [one for one in openings_m if not np.isnan(one)]
    gripper = {
        "name": None if frame is None else word("gripper_frame", frame),
        "opening_m_max": max(open_m) if open_m else None,
    }
    name = data.get("object_frame")
    return {
        "name": name if isinstance(name, str) and name and "/" not in name else _stem(path),
        "file": word("object_file", data.get("object_file", "")),
        "scale_m": _arrays.number("object_scale", data.get("object_scale", 1.0), 0.0, 1e9),
        "object_from_grasp": from_base(bases, base_m, hand.closing_axis or "y"),
        "held": held,
        "score": score,
        "width_m": np.array(widths_m, np.float64),
        "opening_m": np.array(openings_m, np.float64),
        "base_to_tips_m": base_m,
        "info": _info("isaac_grasp", {**gripper, **hand.gripper}),
    }


def write_isaac_grasp(grasps: ObjectGrasps, path: str, hand: Hand) -> None:
    """As ``graspmill objects annotate --format isaac_grasp``. Of sets without labels the score is the confidence."""
    base_m = _known_m(hand, grasps.base_to_tips_m, "the set")
    bases = to_base(grasps.object_from_grasp, base_m, hand.closing_axis or "y")
    confidences = grasps.score if grasps.held is None else grasps.held.astype(np.float64)
    if len(grasps) and not ((confidences >= 0.0) & (confidences <= 1.0)).all():
        rule = "held, or a score from 0 to 1, must be known for isaac_grasp"
        raise InputError(f"{rule}, got neither: dataclasses.replace(grasps, held=…) states it")
    name, opening_m = _hand_name(grasps), _opening_m(grasps)
    lines = ["format: isaac_grasp", "format_version: 1.0"]
    frames = {"object_frame": grasps.name, "gripper_frame": name, "object_file": grasps.file}
    lines += [f"{key}: {json.dumps(text, ensure_ascii=False)}" for key, text in frames.items() if text]
    lines += [f"object_scale: {grasps.scale_m:.10f}", "grasps:" if len(grasps) else "grasps: {}"]
    # Numbers have a fixed number of decimals: YAML 1.1 takes 1e-5 for a word.
    for number, (base, turned) in enumerate(zip(bases, _arrays.quaternions(bases[:, :3, :3]))):
        x, y, z, w = (f"{one:.8f}" for one in turned)
        lines += [
            f"  grasp_{number}:",
            f"    confidence: {_shortest(confidences[number])}",
            f"    position: [{', '.join(f'{one:.7f}' for one in base[:3, 3])}]",
            f"    orientation: {{w: {w}, xyz: [{x}, {y}, {z}]}}",
        ]
        width_m, own_m = grasps.width_m[number], grasps.opening_m[number]
        open_m = opening_m if np.isnan(own_m) else own_m
        if name in PANDA_NAMES and open_m is not None:
            if not np.isnan(width_m):
                lines.append(f"    cspace_position: {{{PANDA_JOINT}: {0.5 * width_m:.6f}}}")
            lines.append(f"    pregrasp_cspace_position: {{{PANDA_JOINT}: {0.5 * open_m:.6f}}}")
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")


def _shortest(confidence: float) -> str:
    """With one decimal if that says all, as labels do."""
    return f"{confidence:.1f}" if round(confidence, 1) == confidence else f"{confidence:.8f}"


# MolmoSpaces and GraspNet

#: What NumPy raises for a damaged array; its header is a Python expression.
_BROKEN = (ValueError, EOFError, OSError, SyntaxError, tokenize.TokenError)


def _good(grasps: ObjectGrasps) -> ObjectGrasps:
    """The grasps that held; all of a set without labels."""
    return grasps if grasps.held is None else grasps.subset(grasps.held)


def _array(name: str, file: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array of a ``.npy``, whose shape ``[N, *shape]`` is checked before memory is taken for it."""
    version = np.lib.format.read_magic(file)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    found, _, dtype = header(file)
    if found[1:] != shape or not found or found[0] > GRASPS_MAX or dtype.kind not in "fiu":
        wanted = f"numbers of the shape [{', '.join(['N', *map(str, shape)])}], N at most {GRASPS_MAX}"
        raise InputError(f"{name} must be {wanted}, got {dtype} {list(found)}")
    file.seek(0)
    return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def read_molmospaces(path: str, hand: Hand) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``. The file has no labels: its grasps held a test of theirs."""
    try:
        with zipfile.ZipFile(path) as files, files.open("transforms.npy") as file:
            poses = rigid("transforms", _array("transforms", file, (4, 4)))
    except InputError:
        raise
    except (*_BROKEN, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"the file must be an .npz with the array transforms, got {error}") from error
    return {
        "name": _stem(path),
        "object_from_grasp": poses,
        "base_to_tips_m": hand.base_to_tips_m,
        "info": _info("molmospaces", hand.gripper),
    }


def write_molmospaces(grasps: ObjectGrasps, path: str, hand: Hand) -> None:
    """As ``graspmill objects annotate --format molmospaces``: only grasps that held."""
    with open(path, "wb") as file:
        np.savez_compressed(file, transforms=_good(grasps).object_from_grasp)


def read_graspnet(path: str, hand: Hand) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps``. Poses keep the frame of the file, which is a camera's for scenes."""
    try:
        with open(path, "rb") as file:
            rows = np.asarray(_array("the array", file, (17,)), np.float64)
    except InputError:
        raise
    except _BROKEN as error:
        raise InputError(f"the file must be an .npy of NumPy, got {error}") from error
    if not np.isfinite(rows).all():
        raise InputError(f"the array must be finite, got {int((~np.isfinite(rows)).sum())} values that are not")
    heights_m = np.unique(rows[:, 2])
    height_m = float(heights_m[0]) if len(heights_m) == 1 else None
    return {
        "name": _stem(path),
        "object_from_grasp": rigid("the rotations", from_graspnet(rows)),
        "score": rows[:, 0],
        "width_m": np.where(rows[:, 1] > 0.0, rows[:, 1], np.nan),
        "base_to_tips_m": hand.base_to_tips_m,
        "info": _info("graspnet", {"finger_width_m": height_m, **hand.gripper}),
    }


def write_graspnet(grasps: ObjectGrasps, path: str, hand: Hand) -> None:
    """As ``graspmill objects annotate --format graspnet``: only grasps that held. Where nothing was measured, the score
    is the set's, or else 1; where even its own friction is too small, 0."""
    good = _good(grasps)
    rows = np.zeros((len(good), 17))
    other = np.where(np.isnan(good.score) | (grasps.held is not None), 1.0, good.score)
    other = np.where(np.isnan(good.tug_max_g), other, 0.0)
    rows[:, 0] = np.where(np.isnan(good.friction_min), other, np.maximum(GRASPNET_SCORE - good.friction_min, 0.0))
    rows[:, 1] = np.nan_to_num(good.width_m)
    width_m = _part(grasps, "gripper").get("finger_width_m", GRASPNET_HEIGHT_M)
    rows[:, 2] = _arrays.number("info.gripper.finger_width_m", width_m, 0.0, 10.0)
    rows[:, 3] = GRASPNET_DEPTH_M
    rotations, rows[:, 13:16] = to_graspnet(good.object_from_grasp)
    rows[:, 4:13] = rotations.reshape(-1, 9)
    rows[:, 16] = -1.0
    with open(path, "wb") as file:
        np.save(file, rows)


READERS: dict[Format, Callable[[str, Hand], dict[str, Any]]] = {
    "acronym": read_acronym,
    "graspgen": read_graspgen,
    "isaac_grasp": read_isaac_grasp,
    "molmospaces": read_molmospaces,
    "graspnet": read_graspnet,
}
WRITERS: dict[Format, Callable[[ObjectGrasps, str, Hand], None]] = {
    "acronym": write_acronym,
    "graspgen": write_graspgen,
    "isaac_grasp": write_isaac_grasp,
    "molmospaces": write_molmospaces,
    "graspnet": write_graspnet,
}
