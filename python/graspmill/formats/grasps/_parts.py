"""Parts of files of grasps, and the frames of grippers. A *base frame* has its origin at the base of the gripper, +z
along the approach, and +x or +y along the closing direction. Our grasp frame has +z along the approach, +y along the
closing direction, and its origin midway between the tips."""

from dataclasses import dataclass, field
from typing import Any, Mapping

import numpy as np
from numpy.typing import NDArray

from ... import _arrays
from ...errors import InputError
from ...object_grasps import GRASPS_MAX, Axis, Numbers, ObjectGrasps

#: Grippers with the driven joint below, whose value is half the distance between the fingers.
PANDA_NAMES = ("franka_hand", "panda", "panda_hand")
PANDA_JOINT = "panda_finger_joint1"


@dataclass(frozen=True)
class GripperFrame:
    """What the caller says of the gripper: from its base to its tips, the axis of its base along which it closes, its name
    and lengths as in ``NAME.json``. The rest is taken from the file, or from the set that is written."""

    base_to_tips_m: float | None = None
    closing_axis: Axis | None = None
    gripper: dict[str, Any] = field(default_factory=dict)

    def known_m(self, otherwise_m: float | None, what: str) -> float:
        known_m = otherwise_m if self.base_to_tips_m is None else self.base_to_tips_m
        if known_m is None:
            raise InputError(f"base_to_tips_m or gripper must be given: {what} does not say where the tips of the gripper are")
        return known_m


def from_base(object_from_base: Numbers, base_to_tips_m: float, closing_axis: Axis) -> Numbers:
    """``object_from_grasp`` ``[N, 4, 4]`` of poses of the gripper's base."""
    grasps = object_from_base.copy()
    if closing_axis == "x":  # our y = their x, our x = their −y
        grasps[:, :3, 0], grasps[:, :3, 1] = -object_from_base[:, :3, 1], object_from_base[:, :3, 0]
    grasps[:, :3, 3] += base_to_tips_m * object_from_base[:, :3, 2]
    return grasps


def to_base(object_from_grasp: Numbers, base_to_tips_m: float, closing_axis: Axis) -> Numbers:
    bases = object_from_grasp.copy()
    if closing_axis == "x":  # their x = our y, their y = our −x
        bases[:, :3, 0], bases[:, :3, 1] = object_from_grasp[:, :3, 1], -object_from_grasp[:, :3, 0]
    bases[:, :3, 3] -= base_to_tips_m * object_from_grasp[:, :3, 2]
    return bases


def word(name: str, value: object) -> str:
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    _arrays.must(isinstance(value, str), f"{name} must be a text", value)
    return _arrays.text(name, value)


def about(of: str, gripper: Mapping[str, Any], **thing: Any) -> dict[str, Any]:
    known = {key: value for key, value in gripper.items() if value is not None}
    return {"format": of, "object": thing, "gripper": known}


def labelled(grasps: ObjectGrasps, what: str) -> NDArray[np.bool_]:
    if grasps.held is None:
        raise InputError(f"held must be known for {what}, got None: dataclasses.replace(grasps, held=…) states it")
    return grasps.held


def good(grasps: ObjectGrasps) -> ObjectGrasps:
    """The grasps that held; all of a set without labels."""
    return grasps if grasps.held is None else grasps.subset(grasps.held)


def part(grasps: ObjectGrasps, name: str) -> dict[str, Any]:
    return _arrays.table(f"info.{name}", grasps.info.get(name, {}))


def array(name: str, file: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array of a ``.npy``, whose shape ``[N, *shape]`` is checked before memory is taken for it."""
    version = np.lib.format.read_magic(file)
    # Heads of later versions have up to 4 GiB. Plain numbers need none.
    _arrays.must(version == (1, 0), f"{name} must be an .npy of version 1.0", version)
    found, _, dtype = np.lib.format.read_array_header_1_0(file)
    if found[1:] != shape or not found or found[0] > GRASPS_MAX or dtype.kind not in "fiu":
        wanted = f"numbers of the shape [{', '.join(['N', *map(str, shape)])}], N at most {GRASPS_MAX}"
        raise InputError(f"{name} must be {wanted}, got {dtype} {list(found)}")
    file.seek(0)
    return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def opening_m(grasps: ObjectGrasps) -> float | None:
    known_m = part(grasps, "gripper").get("opening_m_max")
    return None if known_m is None else _arrays.number("info.gripper.opening_m_max", known_m, 0.0, 10.0)


def gripper_name(grasps: ObjectGrasps) -> str:
    return _arrays.text("info.gripper.name", part(grasps, "gripper").get("name", ""))
