"""Files of plans for robots: isaac_grasp, GraspNet, and the fields of ``moveit_msgs/Grasp`` (``docs/exporting.md``)."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Mapping

import numpy as np

from .. import _arrays
from ..errors import InputError
from ..grippers import loaded
from ..object_grasps import Numbers, ObjectGrasps
from ..plans import Frame, Plan, PlanFileFormat, PlanFileOptions
from . import grasps
from ._files import module, whole
from .grasps._parts import PANDA_NAMES, to_base

#: Ending of a file's name, and its format.
ENDINGS: dict[str, PlanFileFormat] = {".yaml": "isaac_grasp", ".yml": "isaac_grasp", ".npy": "graspnet"}
#: Frames of the poses, the first that is known by default.
FRAMES: tuple[Frame, ...] = ("base", "camera", "workspace")
#: Half of a way must be possible, as half of the retreat decides whether an attempt held.
LEAST_SHARE = 0.5
#: An attempt's gripper goes back along its approach if that is within this angle of straight down, else straight up.
RETREAT_CONE_RAD = np.pi / 3.0
#: Joints of a Franka Hand: each has half of the distance between the fingers.
PANDA_JOINTS = {"panda_finger_joint1": 0.5, "panda_finger_joint2": 0.5}
#: The gripper of an attempt comes and goes as far (``docs/label.md``).
APPROACH_M, RETREAT_M = 0.05, 0.1
#: The options that are not given.
DEFAULTS: dict[str, Any] = dict.fromkeys(PlanFileOptions.__annotations__)

#: All options, by their names; their values are checked where they are used.
Told = Mapping[str, Any]


def _told(options: PlanFileOptions) -> Told:
    if unknown := [name for name in options if name not in DEFAULTS]:
        raise TypeError(f"unexpected keyword argument {unknown[0]!r}: a plan's file has {', '.join(DEFAULTS)}")
    return {**DEFAULTS, **options}


def _frame(plan: Plan, told: Told) -> tuple[str, Numbers]:
    """The name of the frame in files, and the poses of the grasps in it, ``[N, 4, 4]``."""
    known = [one for one in FRAMES if all(row[f"{one}_from_grasp"] is not None for row in plan.answer["grasps"])]
    frame = told["frame"] or (known[0] if len(plan) else "workspace")
    _arrays.must(frame in known, f"frame must be one that the plan knows, {' or '.join(known)}", frame)
    poses = [getattr(grasp, f"{frame}_from_grasp") for grasp in plan.grasps]
    name = _arrays.text("frame_id", frame if told["frame_id"] is None else told["frame_id"])
    return name, np.stack(poses) if poses else np.empty((0, 4, 4))


def _flange_from_grasp(plan: Plan, told: Told) -> Numbers | None:
    """The grasp frame in the frame of the robot's flange ``[4, 4]``, of the caller or else of the plan."""
    if told["gripper"] is not None:
        return loaded(told["gripper"]).flange_from_grasp
    if (pose := plan.answer.get("flange_from_grasp")) is None:
        return None
    return np.asarray(_arrays.of_quaternions("flange_from_grasp", [[*pose["position_m"], *pose["quaternion_xyzw"]]], 1)[0])


def _set(plan: Plan, told: Told) -> ObjectGrasps:
    """The grasps as a set without labels, whose score is the quality; what was not seen is NaN."""
    (name, poses), flange = _frame(plan, told), _flange_from_grasp(plan, told)
    known: dict[str, Any] = {"base_to_tips_m": None if flange is None else float(flange[2, 3]), "score": plan.qualities}
    known["width_m"] = np.array([grasp.width_m for grasp in plan.grasps], np.float64)  # None is NaN
    known["opening_m"] = np.array([grasp.opening_m for grasp in plan.grasps])
    return ObjectGrasps(name, poses, info={"gripper": {"name": plan.answer["gripper"]}}, **known)


def save(plan: Plan, path: str | os.PathLike[str], format: PlanFileFormat | None, options: PlanFileOptions) -> Path:
    file, told = _arrays.path("path", path), _told(options)
    chosen = ENDINGS.get(os.path.splitext(file)[1].lower()) if format is None else format
    if chosen == "moveit":
        rows = moveit_grasps(plan, options)
        yaml = module("yaml", "a file for moveit")
        text = yaml.safe_dump({"grasps": rows}, sort_keys=False, default_flow_style=None, allow_unicode=True, width=120)
        with whole(file) as part:
            Path(part).write_text(text, encoding="utf-8")
        return Path(file)
    if chosen not in ("isaac_grasp", "graspnet"):
        rule = "format must be one of isaac_grasp, graspnet, moveit" if format else "path must end with .yaml or .npy, or format be given"
        raise InputError(f"{rule}, got {_arrays.shown(format or file)}")
    found = _set(plan, told)
    if chosen == "graspnet":  # its width is how far to open before the gripper comes
        found = replace(found, width_m=found.opening_m)
    return grasps.write(found, file, chosen, told["base_to_tips_m"], told["gripper"], told["closing_axis"])


def moveit_grasps(plan: Plan, options: PlanFileOptions) -> list[dict[str, Any]]:
    told = _told(options)
    name, poses = _frame(plan, told)
    links = _links(plan, told, poses)
    joints, force_n = _joints(plan, told), None if told["gripper"] is None else loaded(told["gripper"]).finger_force_n
    ups = [pose @ np.linalg.inv(one.workspace_from_grasp) for pose, one in zip(poses, plan.grasps)]
    rows = []
    for number, (grasp, pose, link, up) in enumerate(zip(plan.grasps, poses, links, ups)):
        row: dict[str, Any] = {"id": f"grasp_{number}", "pre_grasp_posture": _posture(joints, grasp.opening_m)}
        row["grasp_posture"] = None if grasp.width_m is None else _posture(joints, grasp.width_m, force_n)
        row["grasp_pose"] = {"header": {"frame_id": name}, "pose": _pose(link)}
        row["grasp_quality"] = float(grasp.quality)
        row["pre_grasp_approach"] = _way(name, pose[:3, 2], APPROACH_M)
        row["post_grasp_retreat"] = _way(name, _retreat(pose[:3, 2], up[:3, 2]), RETREAT_M)
        rows.append({key: value for key, value in row.items() if value is not None})
    return rows


def _links(plan: Plan, told: Told, poses: Numbers) -> Numbers:
    """Poses ``[N, 4, 4]`` of the robot's last link, on which the gripper is mounted."""
    axis, tips_m = told["closing_axis"], told["base_to_tips_m"]
    _arrays.one_of("closing_axis", axis, (None, "x", "y"))
    if tips_m is not None:
        return to_base(poses, _arrays.number("base_to_tips_m", tips_m, 0.0, 10.0), axis or "y")
    _arrays.must(axis is None, "closing_axis goes with base_to_tips_m for moveit, got no base_to_tips_m")
    if (link_from_grasp := _flange_from_grasp(plan, told)) is None:
        raise InputError("base_to_tips_m or a gripper with flange_from_grasp must be given for moveit, got neither")
    return poses @ np.linalg.inv(link_from_grasp)


def _joints(plan: Plan, told: Told) -> dict[str, float]:
    """Names of the fingers' joints, and metres of each for a metre between the fingers."""
    joints = told["joints"]
    if joints is None:
        return PANDA_JOINTS if plan.answer["gripper"] in PANDA_NAMES else {}
    _arrays.must(isinstance(joints, Mapping), "joints must be names with metres for each metre of opening", joints)
    return {_arrays.text("joints", name): _arrays.number(f"joints.{name}", to, -1e3, 1e3) for name, to in joints.items()}


def _posture(joints: Mapping[str, float], apart_m: float, force_n: float | None = None) -> dict[str, Any] | None:
    """A ``trajectory_msgs/JointTrajectory`` of one point, or ``None`` of a gripper whose joints are not known."""
    if not joints:
        return None
    point = {"positions": [_rounded(each * apart_m) for each in joints.values()]}
    effort = {} if force_n is None else {"effort": [float(force_n)] * len(joints)}
    return {"joint_names": list(joints), "points": [point | effort]}


def _retreat(approach: Numbers, up: Numbers) -> Numbers:
    return -approach if -approach @ up >= np.cos(RETREAT_CONE_RAD) else up


def _way(frame_id: str, along: Numbers, far_m: float) -> dict[str, Any]:
    direction = {"header": {"frame_id": frame_id}, "vector": _named("xyz", along)}
    return {"direction": direction, "desired_distance": far_m, "min_distance": LEAST_SHARE * far_m}


def _pose(matrix: Numbers) -> dict[str, Any]:
    turned = _arrays.quaternions(matrix[None, :3, :3])[0]
    return {"position": _named("xyz", matrix[:3, 3]), "orientation": _named("xyzw", turned)}


def _named(names: str, values: Numbers) -> dict[str, float]:
    return {name: _rounded(value) for name, value in zip(names, values)}


def _rounded(value: float) -> float:
    """To a nanometre, and never −0."""
    return round(float(value), 9) + 0.0
