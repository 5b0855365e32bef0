"""ACRONYM's HDF5."""

import math
from typing import Any

import numpy as np

from ... import _arrays
from ...errors import InputError
from ...object_grasps import GRASPS_MAX, Numbers, ObjectGrasps, labels
from .._files import module
from ._parts import GripperFrame, about, from_base, gripper_name, labelled, opening_m, part, to_base, word

WHAT = "ACRONYM's HDF5"
#: From the origin of its frame to the tips, in metres: 0.11217 in its marker, 0.11225 in its mesh of the gripper.
BASE_TO_TIPS_M = 0.1122
#: Of an array: 16 numbers a grasp.
BYTES_MAX = 16 * 8 * GRASPS_MAX
FLEX = "grasps/qualities/flex/"
MOTIONS = {
    "closing_moved_m": "object_motion_during_closing_linear",
    "closing_turned_rad": "object_motion_during_closing_angular",
    "test_moved_m": "object_motion_during_shaking_linear",
    "test_turned_rad": "object_motion_during_shaking_angular",
}
#: Keys of an object in ``NAME.json``, ACRONYM's names for them, and their shapes.
SOLID: dict[str, tuple[str, tuple[int, ...]]] = {"mass_kg": ("mass", ()), "friction": ("friction", ())}
SOLID |= {"density_kg_m3": ("density", ()), "volume_m3": ("volume", ())}
SOLID |= {"centre_of_mass_m": ("com", (3,)), "inertia_kg_m2": ("inertia", (3, 3))}


def _products_negated(inertia: Numbers) -> Numbers:
    """ACRONYM's products of inertia have the opposite sign of the tensor's: +∫xy for −∫xy."""
    return 2.0 * np.diag(np.diag(inertia)) - inertia


def _bytes(array: Any) -> int:
    """The memory that an array takes, or a chunk of it, which is read as a whole."""
    return int(array.dtype.itemsize * max(array.size, math.prod(array.chunks or ())))


def read(path: str, given: GripperFrame) -> dict[str, Any]:
    h5py = module("h5py", "a file of ACRONYM")

    def value(key: str, shape: tuple[int, ...] | None = None, has_gaps: bool = False) -> Any:
        found: Any = file
        for name in map(str.encode, key.split("/")):
            if not found.id.links.exists(name):
                return None
            # A link would be followed into other files of this machine.
            is_own = found.id.links.get_info(name).type == h5py.h5l.TYPE_HARD
            _arrays.must(is_own, f"{key} must be in the file itself, got a link")
            found = found[name]
        if not isinstance(found, h5py.Dataset) or found.size is None or _bytes(found) > BYTES_MAX:
            raise InputError(f"{key} must be an array of at most {GRASPS_MAX} grasps, got {_arrays.shown(found)}")
        _arrays.must(not (found.external or found.is_virtual), f"{key} must be in the file itself, got an array of another file")
        return found[()] if shape is None else _arrays.numbers(key, found[()], shape, has_gaps=has_gaps)

    with h5py.File(path, "r") as file:
        transforms = value("grasps/transforms")
        if transforms is None:
            _arrays.entry("grasps/transforms", dict.fromkeys(file))
        base_m = given.known_m(BASE_TO_TIPS_M, "ACRONYM")
        bases = _arrays.rigid("grasps/transforms", transforms, GRASPS_MAX)
        held = value(FLEX + "object_in_gripper")
        motions = {ours: value(FLEX + theirs, (len(bases),), True) for ours, theirs in MOTIONS.items()}
        solid = {ours: value(f"object/{theirs}", shape) for ours, (theirs, shape) in SOLID.items()}
        scale_m, opening = value("object/scale", ()), value("gripper/configuration", (1,))
        mesh, kind = value("object/file"), value("gripper/type")
    _arrays.must(mesh is not None and scale_m is not None, f"object/{'file' if mesh is None else 'scale'} must be in the file, got none")
    if solid["inertia_kg_m2"] is not None:
        solid["inertia_kg_m2"] = _products_negated(solid["inertia_kg_m2"])
    known = {key: one.tolist() for key, one in solid.items() if one is not None}
    opening_m_max = None if opening is None else 2.0 * float(opening[0])
    gripper = {"name": None if kind is None else word("gripper/type", kind), "opening_m_max": opening_m_max}
    return {
        "file": word("object/file", mesh),
        "scale_m": float(scale_m),
        "object_from_grasp": from_base(bases, base_m, given.closing_axis or "x"),
        "held": None if held is None else labels(FLEX + "object_in_gripper", held, len(bases)),
        "base_to_tips_m": base_m,
        "info": about("acronym", {**gripper, **given.gripper}, **known),
        **{key: one for key, one in motions.items() if one is not None},
    }


def write(grasps: ObjectGrasps, path: str, given: GripperFrame) -> None:
    """Motions during the test are ACRONYM's only if the test was a shake; what is not known is left out."""
    h5py = module("h5py", "a file of ACRONYM")
    base_m = given.known_m(BASE_TO_TIPS_M, "ACRONYM")
    held, thing, open_m = labelled(grasps, "ACRONYM"), part(grasps, "object"), opening_m(grasps)
    is_shake = grasps.info.get("test", "shake") == "shake"
    values: dict[str, Any] = {"grasps/transforms": to_base(grasps.object_from_grasp, base_m, given.closing_axis or "x")}
    values |= {FLEX + "object_in_gripper": held.astype(np.int64), "object/scale": np.float64(grasps.scale_m)}
    for ours, theirs in MOTIONS.items():
        if not np.isnan(getattr(grasps, ours)).all() and (is_shake or ours.startswith("closing")):
            values[FLEX + theirs] = getattr(grasps, ours)
    for ours, (theirs, shape) in SOLID.items():
        if ours in thing:
            number = _arrays.numbers(f"info.object.{ours}", thing[ours], shape)
            values[f"object/{theirs}"] = _products_negated(number) if shape == (3, 3) else number
    if open_m is not None:
        values["gripper/configuration"] = np.array([0.5 * open_m])
    with h5py.File(path, "w") as file:
        for key, number in values.items():
            options = {"compression": "gzip", "compression_opts": 4} if np.ndim(number) and np.size(number) else {}
            file.create_dataset(key, data=number, **options)
        for key, text in (("object/file", grasps.file), ("gripper/type", gripper_name(grasps))):
            file.create_dataset(key, data=text, dtype=h5py.string_dtype())
