"""Files of grasps: ACRONYM, GraspGen, isaac_grasp, MolmoSpaces and GraspNet, and our own Parquet
(``docs/exporting.md``). A format is a file with ``read``, which gives the arguments of an ``ObjectGrasps`` of a file
that is ``WHAT`` and refuses what is wrong without the path, and ``write``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal

from ... import _arrays
from ...errors import InputError
from ...grippers import LENGTHS, GripperLike, loaded
from ...object_grasps import Axis, Format, ObjectGrasps
from .._files import whole
from . import acronym, graspgen, graspnet, isaac_grasp, molmospaces, parquet
from ._parts import GripperFrame

#: Formats that are written, and all that are read.
WRITTEN: dict[str, Any] = {"acronym": acronym, "graspgen": graspgen, "isaac_grasp": isaac_grasp}
WRITTEN |= {"molmospaces": molmospaces, "graspnet": graspnet}
FORMATS: dict[str, Any] = {**WRITTEN, "parquet": parquet}
#: Ending of a file's name, and its format.
ENDINGS = {".h5": "acronym", ".hdf5": "acronym", ".json": "graspgen", ".yaml": "isaac_grasp", ".yml": "isaac_grasp"}
ENDINGS |= {".npz": "molmospaces", ".npy": "graspnet", ".parquet": "parquet"}


def read(
    path: str | os.PathLike[str], format: Format | Literal["parquet"] | None = None, base_to_tips_m: float | None = None,
    gripper: GripperLike | None = None, closing_axis: Axis | None = None,
) -> ObjectGrasps:  # fmt: skip
    """Grasps of a file by others, in our frame (``docs/exporting.md``); what the file does not say is NaN or ``None``.

    Args:
        format: ``"acronym"`` (.h5, needs h5py), ``"graspgen"`` (.json), ``"isaac_grasp"`` (.yaml, needs PyYAML), ``"molmospaces"``
            (.npz), ``"graspnet"`` (.npy) or ``"parquet"`` (:meth:`ObjectGrasps.load`); by default that of the path's ending.
        base_to_tips_m: From the origin of the file's frame to the tips of the gripper, along the approach. By default 0.1122 m for
            ACRONYM, for GraspGen ``gripper.depth`` of the file, or by its meshes. isaac_grasp has none: give it, or ``gripper``.
        gripper: The gripper: its distance is z of ``flange_from_grasp``, or else the length of finger and palm.
        closing_axis: Along which axis of the file's frame it closes: ``"x"``, for isaac_grasp ``"y"`` or by its bite points.

    Raises InputError if the file is damaged or of something else, or the distance is not known."""
    file = _arrays.path("path", path)
    chosen, given = _format(file, format, FORMATS), _given(base_to_tips_m, gripper, closing_axis)
    _arrays.must(os.path.isfile(file), f"path must be a file, got {file}")
    try:
        return ObjectGrasps(**{"name": _stem(file), **chosen.read(file, given)})
    except MemoryError:
        raise
    except Exception as error:  # whatever a library says of a damaged file
        why = str(error) if isinstance(error, InputError) else f"the file must be {chosen.WHAT}, got {str(error)[:200]}"
        raise InputError(f"{why}: {file}") from error


def write(
    grasps: ObjectGrasps, path: str | os.PathLike[str], format: Format | None = None, base_to_tips_m: float | None = None,
    gripper: GripperLike | None = None, closing_axis: Axis | None = None,
) -> Path:  # fmt: skip
    file = _arrays.path("path", path)
    chosen, given = _format(file, format, WRITTEN), _given(base_to_tips_m, gripper, closing_axis)
    with whole(file) as part:
        chosen.write(grasps, part, given)
    return Path(file)


def _format(path: str, format: str | None, known: dict[str, Any]) -> Any:
    chosen = ENDINGS.get(os.path.splitext(path)[1].lower()) if format is None else format
    if chosen in known:
        return known[chosen]
    endings = ", ".join(ending for ending, one in ENDINGS.items() if one in known)
    rule = f"format must be one of {', '.join(known)}" if format else f"path must end with one of {endings}, or format be given"
    raise InputError(f"{rule}, got {_arrays.shown(format) if format else path}")


def _stem(path: str) -> str:
    """The object's name by that of the file, without ``.FORMAT``."""
    name, form = os.path.splitext(os.path.splitext(os.path.basename(path))[0])
    return name if form[1:] in (*WRITTEN, "grasps") else name + form


def _given(base_to_tips_m: float | None, gripper: GripperLike | None, closing_axis: Axis | None) -> GripperFrame:
    _arrays.one_of("closing_axis", closing_axis, (None, "x", "y"))
    given_m = None if base_to_tips_m is None else _arrays.number("base_to_tips_m", base_to_tips_m, 0.0, 10.0)
    if gripper is None:
        return GripperFrame(given_m, closing_axis)
    known = loaded(gripper)
    if given_m is None:
        flange, palm_m = known.flange_from_grasp, known.finger_length_m + known.palm_length_m
        given_m = palm_m if flange is None else _arrays.number("flange_from_grasp z", flange[2, 3], 0.0, 10.0)
    return GripperFrame(given_m, closing_axis, {key: getattr(known, key) for key in ("name", *LENGTHS)})
