"""Grippers: built-in ones, those in files, and your own."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields
from typing import Any, Mapping, Sequence, Union

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _native

#: What functions accept as a gripper.
GripperLike = Union["Gripper", str, "os.PathLike[str]"]


@dataclass(frozen=True, eq=False)
class Gripper:
    """A parallel-jaw gripper, as boxes: two fingers and a palm (``docs/own-gripper.md``). Lengths are along the axes of the grasp
    frame: z is the approach, y the closing direction. The fingers reach from z = −``finger_length_m`` to z = 0.

    Args:
        opening_m_max: Distance between the fingers' inner faces when open.
        finger_length_m: Finger length along z; ``finger_width_m`` is along x, ``finger_thickness_m`` along y.
        palm_length_m: Palm length along z; ``palm_width_m`` is along x, ``palm_breadth_m`` along y.
        finger_mass_kg: Mass of a finger; ``finger_force_n`` and ``closing_speed_m_s`` are its closing force and speed.
        friction: Friction coefficient of the fingers and the palm.
        clearance_m: The approaching gripper counts as colliding with anything nearer than this.
        flange_from_grasp: The grasp frame in the flange's, ``[4, 4]``, ``[7]`` or ``[3]``; plans then have both poses.
        finger_tip: Thickness and length of the part of the fingers at their tips that is thinner, if there is one.
        jaws: Of other jaws the one at −y and the one at +y, by the keys of a gripper's file (``docs/gripper-file.md``, other jaws).
        joint: What its driver says at the widest opening and closed; plans then have ``joint_position``.
    """

    name: str
    opening_m_max: float
    finger_length_m: float
    finger_width_m: float
    finger_thickness_m: float
    palm_length_m: float
    palm_width_m: float
    palm_breadth_m: float
    finger_mass_kg: float
    finger_force_n: float
    closing_speed_m_s: float
    friction: float = 1.0
    clearance_m: float = 0.001
    flange_from_grasp: NDArray[np.float64] | None = None
    finger_tip: tuple[float, float] | None = None
    jaws: Sequence[Mapping[str, Any]] = ()
    joint: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.flange_from_grasp is not None:
            vars(self)["flange_from_grasp"] = _arrays.matrices([_arrays.pose("flange_from_grasp", self.flange_from_grasp)])[0]
        # The native half checks the limits.
        _native.Simulation(None, [("gripper", setting(self))])

    @staticmethod
    def names() -> tuple[str, ...]:
        """Names of the built-in grippers."""
        return tuple(_native.Simulation.gripper_names())

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Gripper:
        """A built-in gripper, such as ``"franka_hand"``, or the one in a file, whose path ends in ``.toml``."""
        return cls._of(_native.Simulation(None, [("gripper", setting(name))]))

    @classmethod
    def _of(cls, read: _native.Simulation) -> Gripper:
        told: dict[str, Any] = {"flange_from_grasp": read.flange_from_grasp, **json.loads(read.gripper)}
        told["finger_tip"] = tuple(told.get("finger_tip", {}).values()) or None
        told["joint"] = read.joint and tuple(map(_arrays.shortest, read.joint))
        return cls(**told)


#: Numbers of a gripper, and what is two of them, by their keys.
LENGTHS = tuple(one.name for one in fields(Gripper) if one.type == "float")
PAIRS = {"finger_tip": ("thickness_m", "length_m"), "joint": ("open", "closed")}


def loaded(gripper: GripperLike) -> Gripper:
    return gripper if isinstance(gripper, Gripper) else Gripper.load(gripper)


def setting(gripper: GripperLike) -> str:
    """A gripper as a value of a settings file, in TOML."""
    if not isinstance(gripper, Gripper):
        with _arrays.read_as("gripper must be a graspmill.Gripper, a name or a path", gripper):
            name = _arrays.path("gripper", gripper)
        return json.dumps(os.path.abspath(name) if name.endswith(".toml") else name, ensure_ascii=False)
    return f"{{ {', '.join(lines(gripper))} }}"


def lines(gripper: Gripper, decimals: int | None = None) -> list[str]:
    """The keys and values of a gripper's file, with so many decimals of what is no length."""
    parts = [f"name = {json.dumps(_arrays.text('name', gripper.name), ensure_ascii=False)}"]
    parts += [f"{key} = {_arrays.number(key, getattr(gripper, key), 0.0, 1e3)!r}" for key in LENGTHS]
    pairs = {key: getattr(gripper, key) for key in PAIRS}
    told: dict[str, Any] = {key: dict(zip(PAIRS[key], _arrays.numbers(key, pair, (2,)))) for key, pair in pairs.items() if pair is not None}
    if gripper.flange_from_grasp is not None:
        pose = _arrays.pose("flange_from_grasp", gripper.flange_from_grasp)
        told["flange_from_grasp"] = {"position_m": pose[:3], "quaternion_xyzw": pose[3:]}
    with _arrays.read_as("jaws must be two mappings, by the keys of a gripper's file", gripper.jaws):
        told |= {"jaws": gripper.jaws} if len(gripper.jaws) else {}
        return parts + [f"{key} = {_toml(value, decimals)}" for key, value in told.items()]


def _toml(value: Any, decimals: int | None) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_toml(part, decimals)}' for key, part in value.items())} }}"
    parts = value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
    if not isinstance(parts, (list, tuple)):
        return json.dumps(parts if decimals is None or isinstance(parts, bool) else round(parts, decimals) + 0.0, allow_nan=False)
    between = ",\n    " if any(isinstance(part, Mapping) for part in parts) else ", "
    return f"[{between.join(_toml(part, decimals) for part in parts)}]"
