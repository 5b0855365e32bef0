"""Planning in this process: from depth images, a cloud or a TSDF to ranked grasps."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cached_property
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any, Callable, Literal, Sequence, TypedDict, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from .cameras import Camera
from .errors import InputError
from .grippers import GripperLike
from .scene import _images, _simulation

if TYPE_CHECKING:
    from typing_extensions import Unpack

#: Most hands that a plan can be told to avoid.
AVOID_MAX = 256
#: Most planes that keep a hand out.
KEEP_OUT_MAX = 64
#: Smallest and largest side of a workspace, in metres.
WORKSPACE_M = (0.2, 0.6)
#: Settings and networks that come with the package.
BUILT_IN = ("judge", "paper", "vgn")


@dataclass(frozen=True, eq=False)
class Grasp:
    """A ranked grasp.

    Attributes:
        workspace_from_grasp: ``[4, 4]``; +z is the approach, +y the closing direction, the origin midway between the finger tips.
        width_m: Distance between the fingers' inner faces when holding.
        quality: The probability that it holds (a judge's), or the network's smoothed quality; 0 to 1.
        object: Index into the plan's objects, or ``None``.
        base_from_grasp: ``[4, 4]`` in the robot's base, if ``base_from_workspace`` was given.
        workspace_from_flange: ``[4, 4]``, if the hand's file says where the flange is.
        base_from_flange: ``[4, 4]``, if both are known.
    """

    workspace_from_grasp: NDArray[np.float64]
    width_m: float
    quality: float
    object: int | None
    base_from_grasp: NDArray[np.float64] | None = None
    workspace_from_flange: NDArray[np.float64] | None = None
    base_from_flange: NDArray[np.float64] | None = None

    @property
    def score(self) -> float:
        """``quality`` under the name that GraspNet and GPD give it."""
        return self.quality


class PlanOptions(TypedDict, total=False):
    """What a plan may be told besides what was seen; all in the workspace.

    Attributes:
        workspace_size_m: The workspace's side, 0.2 to 0.6, rounded up to whole voxels; 0.3 by default.
        base_from_workspace: ``[4, 4]``, ``[7]`` or ``[3]``: grasps are given in the robot's base, too.
        workspace_from_wrist: Quaternion ``[4]``: of a grasp and its half turn the nearer one is given.
        policy: How grasps are ranked.
        check_collisions: Drop grasps whose gripper would hit the cloud on its way.
        grasps_max: 1 to 10000.
        explain: Dropped candidates with reasons in ``answer``.
        avoid: Poses ``[N, 4, 4]`` or ``[N, 7]`` of grasps that failed.
        target_m: ``[3]``: only the object at this point.
        approach: A direction ``[3]`` and the largest angle from it, in radians.
        keep_out: ``[N, 4]``: planes that the open gripper does not cross, a normal that points to where it may be and an offset in metres.
        reach: The lower and upper corner of a box for the tips, ``[2, 3]``.
        accept: A function of ``workspace_from_grasp``, ``[4, 4]``, that says whether it will do, such as whether your arm reaches it; what
            it raises, the plan raises.

    ``accept`` is called for one grasp after the other, on a thread of the planner's own. A judge's planner calls it for every candidate,
    before the judge is asked: for 512, for four times as many where few will do, and for more in a larger workspace. The other networks'
    planners call it for what they have found. Ctrl-C is heard when the plan ends.
    """

    workspace_size_m: float | None
    base_from_workspace: ArrayLike | None
    workspace_from_wrist: ArrayLike | None
    policy: Literal["paper", "vgn-random", "vgn-best"] | None
    check_collisions: bool | None
    grasps_max: int | None
    explain: bool
    avoid: ArrayLike | None
    target_m: ArrayLike | None
    approach: tuple[ArrayLike, float] | None
    keep_out: ArrayLike | None
    reach: ArrayLike | None
    accept: Callable[[NDArray[np.float64]], bool] | None


class Plan(Sequence[Grasp]):
    """Ranked grasps, best first; a sequence of :class:`Grasp`. Without one, ``reason`` says why."""

    _answered: _native.Plan
    _text: str

    @classmethod
    def _of(cls, native: _native.Plan) -> Plan:
        made = cls.__new__(cls)
        made._answered, made._text = native, native.json()
        return made

    @cached_property
    def answer(self) -> dict[str, Any]:
        """Everything, as the command's and the service's JSON has it (``docs/planning.md``)."""
        answer: dict[str, Any] = json.loads(self._text)
        return answer

    def to_json(self) -> str:
        """The JSON that the command and the service answer."""
        return self._text

    @cached_property
    def grasps(self) -> list[Grasp]:
        """The grasps, best first."""
        frames = ("base_from_grasp", "workspace_from_flange", "base_from_flange")
        return [
            Grasp(
                _matrix(row["workspace_from_grasp"]),
                row["width_m"],
                row["quality"],
                row["object"],
                **{name: None if row[name] is None else _matrix(row[name]) for name in frames},
            )
            for row in self.answer["grasps"]
        ]

    def __len__(self) -> int:
        return len(self.answer["grasps"])

    @overload
    def __getitem__(self, place: int) -> Grasp: ...
    @overload
    def __getitem__(self, place: slice) -> list[Grasp]: ...
    def __getitem__(self, place: int | slice) -> Grasp | list[Grasp]:
        return self.grasps[place]

    @property
    def workspace_from_grasp(self) -> NDArray[np.float64]:
        """All grasps, ``[N, 4, 4]``: what :func:`graspmill.execute` takes."""
        return np.stack([grasp.workspace_from_grasp for grasp in self.grasps]) if len(self) else np.empty((0, 4, 4))

    @property
    def qualities(self) -> NDArray[np.float64]:
        """Their qualities, ``[N]``."""
        return np.array([grasp.quality for grasp in self.grasps])

    @property
    def scores(self) -> NDArray[np.float64]:
        """``qualities`` under the name that GraspNet and GPD give them."""
        return self.qualities

    @property
    def reason(self) -> str | None:
        """Why there are no grasps; ``None`` if there are."""
        reason: str | None = self.answer["reason"]
        return reason

    @property
    def warnings(self) -> list[str]:
        """Warnings."""
        warnings: list[str] = self.answer["warnings"]
        return warnings

    @property
    def timings_ms(self) -> dict[str, float]:
        """Milliseconds of its stages."""
        return dict(self._answered.timings_ms)

    def cloud(self) -> NDArray[np.float32]:
        """The seen surface, ``[N, 3]`` in the workspace, in metres."""
        return self._answered.cloud().reshape(-1, 3)

    def picture(self, title: str = "") -> bytes:
        """A picture of the scene and its grasps, as a PNG."""
        return self._answered.picture(str(title))

    def _repr_png_(self) -> bytes:
        return self.picture()

    def __repr__(self) -> str:
        if not len(self):
            return f"Plan(no grasps: {self.reason})"
        return f"Plan({len(self)} grasps, the best {self.grasps[0].quality:.3f})"


def _matrix(pose: dict[str, list[float]]) -> NDArray[np.float64]:
    matrix: NDArray[np.float64] = _arrays.matrices([[*pose["position_m"], *pose["quaternion_xyzw"]]])[0]
    return matrix


def _checked(
    *,
    workspace_size_m: float | None = None,
    base_from_workspace: ArrayLike | None = None,
    workspace_from_wrist: ArrayLike | None = None,
    policy: str | None = None,
    check_collisions: bool | None = None,
    grasps_max: int | None = None,
    explain: bool = False,
    avoid: ArrayLike | None = None,
    target_m: ArrayLike | None = None,
    approach: tuple[ArrayLike, float] | None = None,
    keep_out: ArrayLike | None = None,
    reach: ArrayLike | None = None,
    accept: Callable[[NDArray[np.float64]], bool] | None = None,
) -> dict[str, Any]:
    """The options of a plan, checked, for the native half."""
    wrist = None
    if workspace_from_wrist is not None:
        wrist = [float(part) for part in _arrays.floats("workspace_from_wrist", workspace_from_wrist, (4,))]
        length = float(np.linalg.norm(wrist))
        if abs(length - 1.0) > _arrays.RIGID_OFF_MAX:
            raise InputError(f"workspace_from_wrist must have length 1 within {_arrays.RIGID_OFF_MAX:g}, got {length:.4g}")
    hands = np.empty((0, 7), np.float32) if avoid is None else _arrays.poses("avoid", avoid)
    if len(hands) > AVOID_MAX:
        raise InputError(f"avoid must be at most {AVOID_MAX} hands, got {len(hands)}")
    return {
        "workspace_size_m": None if workspace_size_m is None else _arrays.number("workspace_size_m", workspace_size_m, *WORKSPACE_M),
        "base_from_workspace": None if base_from_workspace is None else _arrays.pose("base_from_workspace", base_from_workspace),
        "workspace_from_wrist": wrist,
        "policy": None if policy is None else str(policy),
        "check_collisions": None if check_collisions is None else bool(check_collisions),
        "grasps_max": None if grasps_max is None else _arrays.whole("grasps_max", grasps_max, 1, 10_000),
        "explain": bool(explain),
        "avoid": [[float(part) for part in row] for row in hands],
        "target_m": None if target_m is None else _numbers(_arrays.floats("target_m", target_m, (3,))),
        "approach": None if approach is None else _cone(approach),
        "keep_out": [] if keep_out is None else _planes(keep_out),
        "reach": None if reach is None else _box(reach),
        "accept": None if accept is None else _accepting(accept),
    }


_Method = TypeVar("_Method", bound=Callable[..., Plan])


def _with_options(method: _Method) -> _Method:
    """Names the options in the signature, for ``help`` and for editors that look at run time."""
    own = [one for one in signature(method).parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
    of_options = signature(_checked).parameters.values()
    method.__signature__ = signature(method).replace(parameters=[*own, *of_options])  # type: ignore[attr-defined]
    return method


class Planner:
    """A network and settings, ready to plan. It may be shared by threads; a plan does not change it.

    Args:
        config: ``"judge"``, ``"paper"`` or ``"vgn"``, which come with the package, or the path of a planner's settings.
        model: A network's file, in place of the settings' own.
        gripper: A :class:`Gripper`, a built-in one's name, such as ``"franka_hand"``, or a file's path; by default the settings' own.
        threads: By default one per core; never changes the plan.

    Raises:
        InputError: If a file is no network or no settings, or the network was not trained for the gripper.
    """

    def __init__(
        self,
        config: str | os.PathLike[str] = "judge",
        *,
        model: str | os.PathLike[str] | None = None,
        gripper: GripperLike | None = None,
        threads: int | None = None,
    ) -> None:
        hand = None if gripper is None else _simulation(gripper, None)
        count = 0 if threads is None else _arrays.whole("threads", threads, 1, 1024)
        weights = None if model is None else _arrays.path("model", model)
        self._native = _native.Planner(_arrays.path("config", config), weights, hand, count)

    @property
    def gripper(self) -> str:
        """The hand's name."""
        return self._native.gripper_name

    @property
    def model_id(self) -> str:
        """SHA-256 of the network's file."""
        return self._native.model_id

    @property
    def size_m(self) -> float:
        """Side of the workspace, in metres."""
        return self._native.grid(None)[0]

    def __repr__(self) -> str:
        return f"Planner(model {self.model_id[:12]}, gripper {self.gripper})"

    @_with_options
    def plan(
        self,
        depths: Sequence[ArrayLike] | ArrayLike,
        cameras: Sequence[Camera] | Camera,
        *,
        mask: Sequence[ArrayLike | None] | ArrayLike | None = None,
        **options: Unpack[PlanOptions],
    ) -> Plan:
        """Plans from depth images.

        Args:
            depths: One image or several, ``[height, width]`` each, float, in metres along the camera's z; 0 or NaN where nothing was seen.
            cameras: Their cameras, as many.
            mask: What to grasp: for each image a mask, ``[height, width]`` of bool or uint8, not 0 where the target is, or ``None``.
            **options: See :class:`PlanOptions`.
        """
        if isinstance(cameras, Camera):
            cameras, depths = [cameras], [np.asarray(depths)]
            mask = None if mask is None else [np.asarray(mask)]
        images, given = _images(list(depths), list(cameras))  # type: ignore[arg-type]
        lenses, places = [camera._lens() for camera in given], [camera._seven() for camera in given]
        masks = None if mask is None else _masks(list(mask), images)  # type: ignore[arg-type]
        if masks is not None and options.get("target_m") is not None:
            raise InputError("mask and target_m must not both be given")
        return Plan._of(self._native.plan_views(images, lenses, places, masks, _checked(**options)))

    @_with_options
    def plan_cloud(self, points_m: ArrayLike, *, eyes_m: ArrayLike | None = None, **options: Unpack[PlanOptions]) -> Plan:
        """Plans from a point cloud.

        Args:
            points_m: ``[N, 3]`` in the workspace, in metres; points outside are dropped.
            eyes_m: ``[M, 3]``, where the sensors were; by default straight above.
            **options: See :class:`PlanOptions`.
        """
        points = _arrays.floats("points_m", points_m, (None, 3), " (x, y, z)")
        eyes = np.empty((0, 3), np.float32) if eyes_m is None else _arrays.floats("eyes_m", eyes_m, (None, 3))
        if len(eyes) > 32:
            raise InputError(f"eyes_m must be at most 32, got {len(eyes)}")
        return Plan._of(self._native.plan_cloud(points, eyes, _checked(**options)))

    @_with_options
    def plan_tsdf(self, tsdf: ArrayLike, **options: Unpack[PlanOptions]) -> Plan:
        """Plans from a TSDF.

        Args:
            tsdf: ``[40, 40, 40]`` (x, y, z) in VGN's values, 0 to 1: (tsdf + 1) / 2 where observed, else 0. Of another workspace as many
                voxels of 7.5 mm as its side takes.
            **options: See :class:`PlanOptions`.
        """
        checked = _checked(**options)
        side = self._native.grid(checked["workspace_size_m"])[1]
        values = _arrays.floats("tsdf", tsdf, (side, side, side), " (x, y, z)")
        _arrays.vgn_values("tsdf", values)
        return Plan._of(self._native.plan_tsdf(values.ravel(), checked))


def _accepting(accept: Callable[[NDArray[np.float64]], bool]) -> Callable[[list[float]], bool]:
    if not callable(accept):
        raise InputError(f"accept must be a function of a pose, got {_arrays.shown(accept)}")
    return lambda seven: bool(accept(_arrays.matrices([seven])[0]))


def _numbers(array: _arrays.Floats) -> list[float]:
    return [float(part) for part in array]


def _cone(approach: Any) -> tuple[list[float], float]:
    try:
        direction, angle = approach
    except (TypeError, ValueError) as error:
        raise InputError("approach must be a direction and an angle in radians, such as ((0, 0, -1), 0.5)") from error
    vector = _arrays.floats("approach direction", direction, (3,))
    if np.linalg.norm(vector) < 1e-6:
        raise InputError("approach must have a direction, got zeros")
    return _numbers(vector), _arrays.number("approach angle", angle, 0.0, float(np.pi))


def _planes(keep_out: ArrayLike) -> list[list[float]]:
    planes = _arrays.floats("keep_out", keep_out, (None, 4), " (nx, ny, nz, offset)")
    if len(planes) > KEEP_OUT_MAX:
        raise InputError(f"keep_out must be at most {KEEP_OUT_MAX} planes, got {len(planes)}")
    if len(planes) and np.linalg.norm(planes[:, :3], axis=1).min() < 1e-6:
        raise InputError("keep_out must have normals, got zeros")
    return [_numbers(plane) for plane in planes]


def _box(reach: ArrayLike) -> list[list[float]]:
    corners = _arrays.floats("reach", reach, (2, 3))
    if (corners[0] > corners[1]).any():
        raise InputError(f"reach must be a lower and an upper corner, got {corners[0].tolist()} and {corners[1].tolist()}")
    return [_numbers(corner) for corner in corners]


def _masks(masks: list[Any], images: list[NDArray[np.float32]]) -> list[NDArray[np.bool_] | None]:
    """Masks that fit their images."""
    if len(masks) != len(images):
        raise InputError(f"there must be as many masks as depth images, {len(images)}, got {len(masks)}")
    fitting: list[NDArray[np.bool_] | None] = []
    for number, (mask, image) in enumerate(zip(masks, images)):
        if mask is None:
            fitting.append(None)
            continue
        array = np.asarray(mask)
        if array.dtype.kind not in "bu" or array.shape != image.shape:
            raise InputError(
                f"mask {number} must be bool or uint8 of its image's shape, {list(image.shape)}, got {array.dtype} {list(array.shape)}"
            )
        fitting.append(np.ascontiguousarray(array != 0))
    if not any(mask is not None for mask in fitting):
        raise InputError("at least one image must have a mask, got none")
    return fitting
