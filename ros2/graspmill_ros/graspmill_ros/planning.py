"""Parameters, the planner (``graspmill serve`` or in this process), and its grasps for messages. Imports no ROS."""

from __future__ import annotations

import base64
import http.client
import io
import json
import urllib.error
import urllib.request
from dataclasses import dataclass, fields
from typing import Any, Callable

import numpy as np
from numpy.typing import NDArray

from .sensing import Floats, Numbers, RefusedError, matrix

Answer = dict[str, Any]
#: How long the fingers of a marker are, in metres.
MARKER_FINGER_M = 0.04


@dataclass(frozen=True)
class Settings:
    """The node's parameters; ``config/params.yaml`` describes them."""

    url: str = "http://127.0.0.1:8040"
    config: str = "judge"
    gripper: str = ""
    base_frame: str = ""
    use_mask: bool = False
    use_cloud: bool = False
    crop_px: tuple[int, ...] = (0, 0, 0, 0)
    region_m: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    grasps_max: int = 20
    each: bool = False
    rate_hz: float = 0.0
    depth_unit_m: float = 0.001
    image_age_s_max: float = 1.0
    tf_wait_s: float = 0.2
    tf_off_s_max: float = 0.05
    answer_wait_s: float = 10.0

    def __post_init__(self) -> None:
        own = vars(self)
        faults = [f"{name} must be at least {low:g}, got {own[name]}" for name, low in _LEAST.items() if own[name] < low]
        if not self.grasps_max <= 10_000:
            faults.append(f"grasps_max must be at most 10000, got {self.grasps_max}")
        counts = {name: len(own[name]) for name in _COUNTS}
        faults += [f"{name} must be {_COUNTS[name]} numbers, got {got}" for name, got in counts.items() if got != _COUNTS[name]]
        if not faults and any(self.region_m) and not (np.array(self.region_m[:3]) < self.region_m[3:]).all():
            faults.append(f"region_m must be a lower and an upper corner, got {list(self.region_m)}")
        if self.use_cloud and (self.use_mask or any(self.crop_px)):
            faults.append("use_mask and crop_px go with depth images, got use_cloud")
        if self.url and not self.url.startswith(("http://", "https://")):
            faults.append(f"url must begin with http:// or https://, or be empty, got {self.url!r}")
        if faults:
            raise RefusedError("; ".join(faults))


_LEAST = {
    "grasps_max": 1,
    "rate_hz": 0.0,
    "depth_unit_m": 1e-6,
    "image_age_s_max": 0.0,
    "tf_wait_s": 0.0,
    "tf_off_s_max": 0.0,
    "answer_wait_s": 0.1,
}
_COUNTS = {"crop_px": 4, "region_m": 6}
#: Names of the parameters and their defaults, for ``declare_parameter``.
DEFAULTS = {one.name: list(one.default) if isinstance(one.default, tuple) else one.default for one in fields(Settings)}


def settings_of(values: dict[str, Any]) -> Settings:
    """The parameters, checked; all faults are reported at once."""
    given: dict[str, Any] = {key: tuple(one) if isinstance(DEFAULTS[key], list) else one for key, one in values.items()}
    return Settings(**given)


@dataclass(frozen=True)
class View:
    """A depth image ``[height, width]`` in metres with its lens, or a cloud ``[N, 3]`` in its camera's optical frame."""

    depth_m: Floats | None = None
    intrinsics: list[float] | None = None
    mask: NDArray[np.bool_] | None = None
    points_m: Floats | None = None
    base_from_camera: list[float] | None = None


@dataclass(frozen=True)
class Ranked:
    """A grasp for messages: its number in the plan, and its pose ``[7]`` in the frame of the message. ``width_m`` and
    ``robustness`` are NaN and ``object`` is -1 where they are not known."""

    number: int
    pose: list[float]
    quality: float
    robustness: float
    width_m: float
    opening_m: float
    object: int


def _file(array: NDArray[Any]) -> dict[str, str]:
    np.save(npy := io.BytesIO(), array)
    return {"data": base64.b64encode(npy.getvalue()).decode()}


def request(view: View, each: bool = False) -> dict[str, Any]:
    """The body of ``POST /v1/plan``; the table is found."""
    asked: dict[str, Any] = {"each": True} if each else {}
    if view.depth_m is None:
        asked |= {"cloud": _file(np.asarray(view.points_m)), "workspace_from_cloud": "table"}
    else:
        fx, fy, cx, cy = view.intrinsics or []
        lens = {"fx_px": fx, "fy_px": fy, "cx_px": cx, "cy_px": cy}
        mask = {} if view.mask is None else {"mask": _file(view.mask)}
        asked["views"] = [{"depth": _file(view.depth_m), "intrinsics": lens, "workspace_from_camera": "table"} | mask]
    if view.base_from_camera is not None:
        asked["base_from_camera"] = {"position_m": view.base_from_camera[:3], "quaternion_xyzw": view.base_from_camera[3:]}
    return asked


def service(settings: Settings) -> Callable[[View], Answer]:
    """A planner at a URL, ``graspmill serve``, with that service's settings and gripper."""
    url = settings.url.rstrip("/").removesuffix("/v1/plan") + "/v1/plan"

    def plan(view: View) -> Answer:
        body = json.dumps(request(view, settings.each)).encode()
        asked = urllib.request.Request(url, body, {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(asked, timeout=settings.answer_wait_s) as reply:
                answer = json.load(reply)
        except urllib.error.HTTPError as error:
            raise RefusedError(f"the planner at {url} answered {error.code}: {_reason(error)}") from error
        except (OSError, http.client.HTTPException) as error:
            raise RefusedError(f"the planner at {url} must answer (graspmill serve starts one), got {error}") from error
        except ValueError as error:
            raise RefusedError(f"the planner at {url} must answer with JSON, got {error}") from error
        if not isinstance(answer, dict) or not isinstance(answer.get("grasps"), list):
            raise RefusedError(f"the planner at {url} must answer with a plan, got {str(answer)[:60]}")
        if settings.gripper not in ("", answer.get("gripper")):
            raise RefusedError(f"the planner at {url} must plan for {settings.gripper}, got {answer.get('gripper')}: graspmill serve --gripper")
        return answer

    return plan


def _reason(error: urllib.error.HTTPError) -> str:
    """What the service says of an error, or what HTTP calls it."""
    try:
        return str(json.load(error)["error"])
    except (OSError, http.client.HTTPException, ValueError, KeyError, TypeError):
        return str(error.reason)


def in_process(settings: Settings) -> Callable[[View], Answer]:
    """A planner of the package ``graspmill`` in this process."""
    try:
        import graspmill
    except ImportError as error:
        raise RefusedError(f"url must be given, or the package graspmill be installed: {error}") from error
    try:
        planner = graspmill.Planner(settings.config, gripper=settings.gripper or None)
    except graspmill.GraspmillError as error:
        raise RefusedError(f"the planner cannot be made: {error}") from error

    def plan(view: View) -> Answer:
        options: dict[str, Any] = {"each": settings.each, "base_from_camera": view.base_from_camera}
        try:
            if view.depth_m is None:
                points = np.asarray(view.points_m)
                made = planner.plan_cloud(points, workspace_from_cloud="table", **options)
            else:
                height, width = view.depth_m.shape
                fx, fy, cx, cy = view.intrinsics or []
                camera = graspmill.Camera(width, height, fx, fy, cx, cy)
                made = planner.plan(view.depth_m, camera, mask=view.mask, **options)
        except graspmill.GraspmillError as error:
            raise RefusedError(f"no plan: {error}") from error
        return dict(made.answer)

    return plan


def ranked(answer: Answer, settings: Settings, grasps_max: int = 0) -> list[Ranked]:
    """The grasps of a plan in the base's frame, or else the camera's, best first, with their tips in the region.

    Args:
        answer: The plan's JSON.
        settings: The parameters.
        grasps_max: At most so many; 0 leaves it to the parameter.
    """
    key = "base_from_grasp" if settings.base_frame else "camera_from_grasp"
    found = []
    try:
        for number, row in enumerate(answer["grasps"]):
            pose = [float(one) for one in (*row[key]["position_m"], *row[key]["quaternion_xyzw"])]
            known = {name: np.nan if row[name] is None else float(row[name]) for name in ("robustness", "width_m")}
            thing = -1 if row["object"] is None else int(row["object"])
            found.append(Ranked(number, pose, float(row["quality"]), opening_m=float(row["opening_m"]), object=thing, **known))
    except (LookupError, TypeError, ValueError) as error:
        raise RefusedError(f"the plan's grasps must have {key} and numbers, got {error!r}: versions differ?") from error
    inside = [one for one in found if _is_inside(one.pose[:3], settings.region_m)]
    return inside[: min(grasps_max or settings.grasps_max, settings.grasps_max)]


def _is_inside(at_m: list[float], region_m: tuple[float, ...]) -> bool:
    return not any(region_m) or all(low <= at <= high for low, at, high in zip(region_m[:3], at_m, region_m[3:]))


def reason(answer: Answer, rows: list[Ranked]) -> str:
    """Why there are no grasps; empty if there are some."""
    if rows:
        return ""
    count = len(answer["grasps"])
    return f"none of {count} grasps is within region_m" if count else str(answer.get("reason") or "no grasp was found")


def moveit_grasps(answer: Answer, rows: list[Ranked], settings: Settings, frame_id: str) -> list[dict[str, Any]]:
    """The ranked grasps with the fields of ``moveit_msgs/Grasp``; needs the package ``graspmill``."""
    import graspmill

    try:
        plan = graspmill.Plan.from_json(json.dumps(answer))
        told = plan.moveit_grasps(frame="base" if settings.base_frame else "camera", frame_id=frame_id)
    except graspmill.GraspmillError as error:
        raise RefusedError(f"no grasps for MoveIt: {error}") from error
    return [told[row.number] for row in rows]


def fork(row: Ranked) -> Numbers:
    """A marker's lines ``[4, 2, 3]`` in metres: the fingers, what joins them, and the stem from where the hand comes."""
    half_m, back_m = 0.5 * row.opening_m, -MARKER_FINGER_M
    left, right = (0.0, -half_m), (0.0, half_m)
    corners = [(*left, 0.0), (*left, back_m), (*right, 0.0), (*right, back_m), (*left, back_m), (*right, back_m)]
    corners += [(0.0, 0.0, back_m), (0.0, 0.0, 2.0 * back_m)]
    pose = matrix(row.pose)
    lines: Numbers = (np.array(corners) @ pose[:3, :3].T + pose[:3, 3]).reshape(4, 2, 3)
    return lines
