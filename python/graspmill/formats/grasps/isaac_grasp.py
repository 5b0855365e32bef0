"""isaac_grasp's YAML: of Isaac Sim's editor, and of GraspDataGen."""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ... import _arrays
from ...errors import InputError
from ...object_grasps import GRASPS_MAX, ObjectGrasps
from .._files import yaml_for
from ._parts import PANDA_JOINT, PANDA_NAMES, GripperFrame, about, from_base, gripper_name, opening_m, to_base, word

WHAT = "YAML"


def _three(name: str, value: object) -> list[float]:
    _arrays.must(isinstance(value, list) and len(value) == 3, f"{name} must be 3 numbers", value)
    # YAML reads 1e-9 as a word.
    return [_arrays.number(name, one, -_arrays.FAR_M_MAX, _arrays.FAR_M_MAX) for one in _arrays.listed(name, value)]


def _row(name: str, value: object) -> tuple[list[float], float, float, float]:
    """Pose ``[7]`` of the base, confidence, distance between the closed fingers and between the open ones, or NaN."""
    grasp = _arrays.table(name, value)
    turned = _arrays.table(f"{name}.orientation", _arrays.entry(f"{name}.orientation", grasp))
    w, xyz = (_arrays.entry(f"{name}.orientation.{key}", turned) for key in ("w", "xyz"))
    position = _three(f"{name}.position", _arrays.entry(f"{name}.position", grasp))
    pose = [*position, *_three(f"{name}.orientation.xyz", xyz), _arrays.number(f"{name}.orientation.w", w, -2.0, 2.0)]
    confidence = _arrays.number(f"{name}.confidence", grasp.get("confidence", 1.0), 0.0, 1.0)

    def width_m(key: str) -> float:
        joint_m = _arrays.table(f"{name}.{key}", grasp.get(key) or {}).get(PANDA_JOINT)
        return np.nan if joint_m is None else 2.0 * _arrays.number(f"{name}.{key}", joint_m, -1.0, 1.0)

    return pose, confidence, width_m("cspace_position"), width_m("pregrasp_cspace_position")


def read(path: str, given: GripperFrame) -> dict[str, Any]:
    text = Path(path).read_bytes()
    yaml, loader = yaml_for(text, "isaac_grasp")
    data = _arrays.table("the file", yaml.load(text, loader))
    _arrays.must(data.get("format") == "isaac_grasp", "format must be isaac_grasp", data.get("format"))
    if str(version := data.get("format_version")) not in ("1.0", "1"):
        warnings.warn(f"format_version is {_arrays.shown(version)}, and is read as 1.0: {path}", stacklevel=3)
    if data.get("approach_axis", 2) != 2:  # GraspDataGen's
        raise InputError(f"approach_axis must be 2 (z), got {_arrays.shown(data['approach_axis'])}")
    base_m = given.known_m(None, "isaac_grasp")
    grasps = _arrays.table("grasps", _arrays.entry("grasps", data))
    _arrays.must(len(grasps) <= GRASPS_MAX, f"grasps must be at most {GRASPS_MAX}, got {len(grasps)}")
    rows = [_row(f"grasps.{str(key)[:60]}", value) for key, value in grasps.items()]
    poses, confidences, widths_m, openings_m = zip(*rows) if rows else ([], [], [], [])
    bases = _arrays.of_quaternions("grasps", np.reshape(np.array(poses, np.float64), (-1, 7)), GRASPS_MAX)
    # GraspDataGen's bite points lie on a finger, off the approach along the closing direction alone.
    points = [_three(key, grasp[key]) for grasp in grasps.values() for key in ("bite_point", "pregrasp_bite_point") if key in grasp]
    x_m, y_m, _ = np.abs(np.reshape(points, (-1, 3))).sum(axis=0)
    score, opening = np.array(confidences, np.float64), np.array(openings_m, np.float64)
    # Ours say both. The editor writes 0 for what escaped, 0.5 for what was lost later, 1 for what was kept; others are
    # of a network.
    told = [grasp.get("held") for grasp in grasps.values()]
    is_ours = all(isinstance(one, bool) for one in told)
    held = np.array(told, bool) if is_ours else score == 1.0 if np.isin(score, (0.0, 0.5, 1.0)).all() else None
    frame = data.get("gripper_frame", data.get("gripper_frame_link"))
    opening_m_max = None if np.isnan(opening).all() else float(np.nanmax(opening))
    gripper = {"name": None if frame is None else word("gripper_frame", frame), "opening_m_max": opening_m_max}
    name = data.get("object_frame")
    return {
        **({"name": name} if isinstance(name, str) and name and "/" not in name else {}),
        "file": word("object_file", data.get("object_file", "")),
        "scale_m": _arrays.number("object_scale", data.get("object_scale", 1.0), 0.0, 1e9),
        "object_from_grasp": from_base(bases, base_m, given.closing_axis or ("x" if x_m > y_m else "y")),
        "held": held,
        **({"p_held": score} if is_ours else {}),
        "score": score,
        "width_m": np.array(widths_m, np.float64),
        "opening_m": opening,
        "base_to_tips_m": base_m,
        "info": about("isaac_grasp", {**gripper, **given.gripper}),
    }


def write(grasps: ObjectGrasps, path: str, given: GripperFrame) -> None:
    """The confidence is ``p_held``, or else 1 for held; of sets without labels the score."""
    bases = to_base(grasps.object_from_grasp, given.known_m(grasps.base_to_tips_m, "the set"), given.closing_axis or "y")
    confidences = grasps.score if grasps.held is None else grasps.held.astype(np.float64)
    held = None if np.isnan(grasps.p_held).all() else grasps.held
    if held is not None:
        confidences = np.where(np.isnan(grasps.p_held), confidences, grasps.p_held)
    if not ((confidences >= 0.0) & (confidences <= 1.0)).all():
        rule = "held, or a score from 0 to 1, must be known for isaac_grasp"
        raise InputError(f"{rule}, got neither: dataclasses.replace(grasps, held=…) states it")
    name, widest_m = gripper_name(grasps), opening_m(grasps)
    frames = {"object_frame": grasps.name, "gripper_frame": name, "object_file": grasps.file}
    told = [f"{key}: {json.dumps(text, ensure_ascii=False)}" for key, text in frames.items() if text]
    lines = ["format: isaac_grasp", "format_version: 1.0", *told, f"object_scale: {grasps.scale_m:.10f}", "grasps:" if len(grasps) else "grasps: {}"]
    # Numbers have a fixed number of decimals: YAML 1.1 takes 1e-5 for a word.
    for number, (base, turned) in enumerate(zip(bases, _arrays.quaternions(bases[:, :3, :3]))):
        x, y, z, w = (f"{one:.8f}" for one in turned)
        lines += [
            f"  grasp_{number}:",
            # With one decimal if that says all, as labels do.
            f"    confidence: {confidences[number]:.{1 if round(confidences[number], 1) == confidences[number] else 8}f}",
            *([] if held is None else [f"    held: {str(held[number]).lower()}"]),
            f"    position: [{', '.join(f'{one:.7f}' for one in base[:3, 3])}]",
            f"    orientation: {{w: {w}, xyz: [{x}, {y}, {z}]}}",
        ]
        width_m, own_m = grasps.width_m[number], grasps.opening_m[number]
        open_m = widest_m if np.isnan(own_m) else own_m
        if name in PANDA_NAMES and open_m is not None:
            if not np.isnan(width_m):
                lines.append(f"    cspace_position: {{{PANDA_JOINT}: {0.5 * width_m:.6f}}}")
            lines.append(f"    pregrasp_cspace_position: {{{PANDA_JOINT}: {0.5 * open_m:.6f}}}")
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
