"""Planning in this process: from depth images, a cloud or a TSDF to ranked grasps."""

from __future__ import annotations

import json
import math
import os
from typing import TYPE_CHECKING, Any, Callable, Literal, Sequence, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from .cameras import Camera
from .grippers import GripperLike
from .plans import Plan
from .scene import Immutable, _images, _simulation

if TYPE_CHECKING:
    from typing_extensions import Unpack

class PlanOptions(TypedDict, total=False):
    """Options of a plan. Points, poses and directions are in the workspace.

    Attributes:
        workspace_size_m: Side of a judge's workspace, 0.2 to 1.2; by default all within its reach. Networks of voxels have 0.3.
        down: The direction of gravity ``[3]`` in the first camera's or the cloud's frame; by default it stands upright and looks down.
        base_from_camera: ``[4, 4]``, ``[7]`` or ``[3]``, the first camera or the cloud's, where the table is found: grasps are also
            given in the robot's base, and gravity is along its -z unless ``down`` is given.
        base_from_workspace: ``[4, 4]``, ``[7]`` or ``[3]``: grasps are also given in the robot's base.
        workspace_from_wrist: Quaternion ``[4]``: of a grasp and its half turn, the plan has the one nearer to it.
        policy: How grasps are ranked.
        check_collisions: Whether grasps are dropped if the gripper would hit the cloud on its way.
        grasps_max: The largest number of grasps, 1 to 10000.
        each: Whether the best grasp of each object comes first, then the others. ``answer["objects"]`` says which have none, and why.
        explain: Whether ``answer`` has the dropped candidates, with reasons.
        previous: The best grasp of the last plan, as in ``avoid``: of grasps about as good as the best the nearest to it comes first.
        avoid: Poses ``[N, 4, 4]`` or ``[N, 7]`` of grasps that failed.
        avoid_objects: ``[N, 4]``: points and radii where no tips may be; as ``avoid`` in the first camera's frame if the table is found.
        target_m: ``[3]``: only the object at this point is grasped.
        approach: A direction ``[3]`` and the largest angle from it, in radians.
        keep_out: ``[N, 4]``: planes that the open gripper must not cross: normals to the allowed side, and offsets in metres.
        reach: The lower and upper corner of a box for the finger tips, ``[2, 3]``.
        accept: A function of ``workspace_from_grasp``, ``[4, 4]``: whether the grasp can be used, such as whether your arm reaches it.
        accept_batch: The same for many grasps at once: a function of ``[N, 4, 4]`` that returns ``[N]`` bool, in place of ``accept``.

    Both are called on the thread that plans, which raises what they raise: for every candidate before a judge is asked (until 256
    are accepted or ten calls of ``accept_batch`` found no more, and again up to three times if few are good), or for the grasps
    that another network found. Ctrl-C ends such a plan at once, and another when it is made.
    """

    workspace_size_m: float | None
    down: ArrayLike | None
    base_from_camera: ArrayLike | None
    base_from_workspace: ArrayLike | None
    workspace_from_wrist: ArrayLike | None
    policy: Literal["paper", "vgn-random", "vgn-best"] | None
    check_collisions: bool | None
    grasps_max: int | None
    each: bool
    explain: bool
    previous: ArrayLike | None
    avoid: ArrayLike | None
    avoid_objects: ArrayLike | None
    target_m: ArrayLike | None
    approach: tuple[ArrayLike, float] | None
    keep_out: ArrayLike | None
    reach: ArrayLike | None
    accept: Callable[[NDArray[np.float64]], bool] | None
    accept_batch: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None


#: The first camera in its own frame.
_HERE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


def _request(options: PlanOptions, finds_table: bool = False, **more: Any) -> dict[str, Any]:
    """The options of a plan, and more of a request, in its JSON, which the native half checks, and the user's functions."""
    known = PlanOptions.__annotations__
    if unknown := [name for name in options if name not in known]:
        raise TypeError(f"unexpected keyword argument {unknown[0]!r}: a plan has {', '.join(known)}")
    given = {name: value for name, value in options.items() if value is not None}
    functions = {name: given.pop(name, None) for name in ("accept", "accept_batch")}
    for name, function in functions.items():
        what = "poses" if name == "accept_batch" else "a pose"
        _arrays.must(function is None or callable(function), f"{name} must be a function of {what}", function)
    _arrays.must(None in functions.values(), "accept and accept_batch must not both be given")
    text = json.dumps({name: _encoded(name, value) for name, value in given.items()} | more)
    return {"options": text, "finds_table": finds_table, "is_asked": any(one is not None for one in functions.values()), **functions}


def _planned(begin: Callable[..., _native.Plan | _native.Planning], *observation: Any) -> Plan:
    """A plan of an observation, with a request at its end. The user's functions are called here, on the caller's thread."""
    planning = begin(*observation)
    if isinstance(planning, _native.Plan):
        return Plan._of(planning)
    try:
        step = planning.next(None)
        while not isinstance(step, _native.Plan):
            step = planning.next(_accepted(_arrays.matrices(step), **observation[-1]))
    finally:
        planning.leave()
    return Plan._of(step)


class Planner(Immutable):
    """A network with its settings, ready to plan. Planning does not change it, so threads may share it.

    Args:
        config: ``"judge"``, ``"paper"`` or ``"vgn"``, which come with the package, or the path of a settings file.
        model: The file of a network, in place of the one in the settings.
        gripper: A :class:`Gripper`, a built-in one's name or a file's path; by default the one in the settings.
        threads: Number of threads, by default one per core; it never changes the plan.

    Attributes:
        gripper: Name of the gripper. ``model_id`` is the SHA-256 of the network's file, ``size_m`` the side of the workspace.

    Raises InputError if a file does not hold a network or settings, or the network was not trained for the gripper.
    """

    def __init__(
        self, config: str | os.PathLike[str] = "judge", *, model: str | os.PathLike[str] | None = None,
        gripper: GripperLike | None = None, threads: int | None = None,
    ) -> None:  # fmt: skip
        simulation = None if gripper is None else _simulation(gripper, None)
        weights = None if model is None else _arrays.path("model", model)
        self._native = _native.Planner(_arrays.path("config", config), weights, simulation, _arrays.threads(threads))
        self.gripper, self.model_id, self.size_m = self._native.gripper_name, self._native.model_id, self._native.grid(None)[0]

    def __repr__(self) -> str:
        return f"Planner(model {self.model_id[:12]}, gripper {self.gripper})"

    def plan(
        self, depths: Sequence[ArrayLike] | ArrayLike, cameras: Sequence[Camera] | Camera, *,
        mask: Sequence[ArrayLike | None] | ArrayLike | None = None, **options: Unpack[PlanOptions],
    ) -> Plan:  # fmt: skip
        """Plans from depth images, with :class:`PlanOptions`.

        Args:
            depths: One image or several, ``[height, width]`` float, in metres along z; 0 or NaN where nothing was seen.
            cameras: Of each image. If the first has no pose, the table is found; the others' poses are in its frame.
            mask: For each image a mask of the target, ``[height, width]`` bool or uint8, or ``None``.
        """
        if isinstance(cameras, Camera):
            cameras, depths = [cameras], [depths]  # type: ignore[assignment]
            mask = None if mask is None else [mask]  # type: ignore[assignment]
        images, given = _images(depths, cameras)  # type: ignore[arg-type]
        intrinsics, finds_table = [camera._intrinsics() for camera in given], given[0].workspace_from_camera is None
        poses = [_HERE if finds_table and not number else camera._pose() for number, camera in enumerate(given)]
        masks = None if mask is None else _masks(_arrays.listed("mask", mask), images)
        _arrays.must(masks is None or options.get("target_m") is None, "mask and target_m must not both be given")
        return _planned(self._native.plan_views, images, intrinsics, poses, masks, _request(options, finds_table))

    def plan_cloud(
        self, points_m: ArrayLike, *, object_m: ArrayLike | None = None, eyes_m: ArrayLike | None = None,
        workspace_from_cloud: ArrayLike | Literal["table"] | None = None, **options: Unpack[PlanOptions],
    ) -> Plan:  # fmt: skip
        """Plans from a point cloud, with :class:`PlanOptions`.

        Args:
            points_m: ``[N, 3]`` in metres; points outside the workspace are dropped.
            object_m: ``[M, 3]``, the points of what to grasp, which the cloud may have, too; by default it is anything.
            eyes_m: ``[M, 3]``, the sensors in the cloud's frame; by default above, in another frame its origin.
            workspace_from_cloud: The cloud's frame in the workspace, ``[4, 4]``, ``[7]`` or ``[3]``; by default the same. Or
                ``"table"``: the cloud is in its camera's optical frame, the table is found, and the workspace put on it.
        """
        points = _arrays.floats("points_m", points_m, (None, 3), " (x, y, z)")
        eyes = np.empty((0, 3), np.float32) if eyes_m is None else _arrays.floats("eyes_m", eyes_m, (None, 3))
        _arrays.must(len(eyes) <= 32, f"eyes_m must be at most 32, got {len(eyes)}")
        thing = np.empty((0, 3), np.float32)
        if object_m is not None:
            _arrays.must(options.get("target_m") is None, "object_m and target_m must not both be given")
            thing = _arrays.floats("object_m", object_m, (None, 3), " (x, y, z)")
            _arrays.must(len(thing), "object_m must have a point, got none")
        finds_table = isinstance(workspace_from_cloud, str) and workspace_from_cloud == "table"
        placed: dict[str, Any] = {}
        if workspace_from_cloud is not None and not finds_table:
            parts = _arrays.pose("workspace_from_cloud", workspace_from_cloud)
            placed, pose = {"workspace_from_cloud": _parts(parts)}, _arrays.matrices([parts])[0]
            eyes = eyes if len(eyes) else np.zeros((1, 3), np.float32)
            turn, at_m = pose[:3, :3].T, pose[:3, 3]
            points, eyes, thing = ((part @ turn + at_m).astype(np.float32) for part in (points, eyes, thing))
        return _planned(self._native.plan_cloud, points, eyes, thing, _request(options, finds_table, **placed))

    def plan_tsdf(self, tsdf: ArrayLike, **options: Unpack[PlanOptions]) -> Plan:
        """Plans from a TSDF, with :class:`PlanOptions`: ``[40, 40, 40]`` (x, y, z) in VGN's values, 0 to 1: (tsdf + 1) / 2 where
        observed, else 0. A workspace of another size has as many voxels of 7.5 mm as fit its side."""
        request = _request(options)
        side = self._native.grid(request)[1]
        values = _arrays.floats("tsdf", tsdf, (side, side, side), " (x, y, z)")
        _arrays.vgn_values("tsdf", values)
        return _planned(self._native.plan_tsdf, values.ravel(), request)


def _accepted(poses: NDArray[np.float64], accept: Any, accept_batch: Any, **_: Any) -> list[bool]:
    told = [accept(pose) for pose in poses] if accept_batch is None else accept_batch(poses)
    array = _arrays.given(f"what accept{'_batch' * (accept is None)} returns", told)
    is_fit = array.dtype.kind == "b" and array.shape == (len(poses),)
    if not is_fit and accept is not None:
        raise TypeError(f"accept must return True or False, got {_arrays.shown(told)}")
    _arrays.must(is_fit, f"what accept_batch returns must be bool [{len(poses)}], got {_arrays.kind(array)}")
    return [bool(one) for one in array]


#: The shapes of those options that are arrays.
_SHAPES = {"down": (3,), "target_m": (3,), "workspace_from_wrist": (4,), "avoid_objects": (None, 4), "keep_out": (None, 4), "reach": (2, 3)}


def _encoded(name: str, value: Any) -> Any:
    """An option as a request has it. Only what is no such option in JSON is refused here."""
    if name in ("base_from_camera", "base_from_workspace", "previous"):
        return _parts(_arrays.pose(name, value))
    if name == "avoid":
        return [_parts(pose) for pose in _arrays.poses(name, value).tolist()]
    if name == "approach":
        with _arrays.read_as("approach must be a direction and an angle in radians, such as ((0, 0, -1), 0.5)", value):
            direction, angle = value
        vector = _arrays.floats("approach direction", direction, (3,)).tolist()
        return {"direction": vector, "angle_rad_max": _arrays.number("approach angle", angle, -math.inf, math.inf)}
    if name in _SHAPES:
        numbers = _arrays.floats(name, value, _SHAPES[name]).tolist()
        if name == "reach":
            return dict(zip(("low_m", "high_m"), numbers))
        return {"quaternion_xyzw": numbers} if name == "workspace_from_wrist" else numbers
    if name in ("check_collisions", "each", "explain", "policy"):
        return _arrays.text(name, value) if name == "policy" else _arrays.flag(name, value)
    if name == "grasps_max":
        return _arrays.whole(name, value, -(2**63), 2**63)
    return _arrays.number(name, value, -math.inf, math.inf)


def _parts(pose: list[float]) -> dict[str, list[float]]:
    return {"position_m": pose[:3], "quaternion_xyzw": pose[3:]}


def _masks(masks: list[Any], images: list[NDArray[np.float32]]) -> list[NDArray[np.bool_] | None]:
    _arrays.must(len(masks) == len(images), f"there must be as many masks as depth images, {len(images)}, got {len(masks)}")
    _arrays.must(any(mask is not None for mask in masks), "at least one image must have a mask, got none")
    fitting = [None if mask is None else _arrays.given(f"mask {number}", mask) for number, mask in enumerate(masks)]
    for number, (array, image) in enumerate(zip(fitting, images)):
        is_fit = array is None or (array.dtype.kind in "bu" and array.shape == image.shape)
        _arrays.must(is_fit, f"mask {number} must be bool or uint8 of its image's shape, {list(image.shape)}, got {_arrays.kind(np.asarray(array))}")
    return [None if array is None else np.ascontiguousarray(array != 0) for array in fitting]
