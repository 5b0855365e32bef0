"""Plans: ranked grasps, and their files for robots."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Mapping, Sequence, TypedDict, cast, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from .errors import InputError
from .grippers import GripperLike
from .pages import Page
from .scene import Immutable

if TYPE_CHECKING:
    from typing_extensions import Unpack

#: Of the JSON of a plan.
FORMAT = "graspmill-plan/3"

PlanFileFormat = Literal["isaac_grasp", "graspnet", "moveit"]
Frame = Literal["base", "camera", "workspace"]


class PlanFileOptions(TypedDict, total=False):
    """Options of a plan's file.

    Attributes:
        frame: The frame of the poses: ``"base"``, ``"camera"`` or ``"workspace"``; by default the first that the plan knows.
        frame_id: The name of that frame in the file, such as that of a TF frame; by default ``frame``. GraspNet has none.
        gripper: The gripper, where the plan's has no ``flange_from_grasp``; of moveit also the force of its fingers.
        base_to_tips_m: From the base of the gripper, or moveit's parent link, to its tips. GraspNet does not need it.
        closing_axis: Along which axis of the base the gripper closes, by default ``"y"``; of moveit it goes with ``base_to_tips_m``.
        joints: Of moveit: the fingers' joints, and how far each moves for a metre between them; by default of a Franka Hand alone.
    """

    frame: Frame | None
    frame_id: str | None
    gripper: GripperLike | None
    base_to_tips_m: float | None
    closing_axis: Literal["x", "y"] | None
    joints: Mapping[str, float] | None

@dataclass(frozen=True, eq=False)
class Grasp:
    """A ranked grasp.

    Attributes:
        workspace_from_grasp: ``[4, 4]``; +z is the approach, +y the closing direction, the origin midway between the finger tips.
        width_m: Distance between the fingers when holding, as seen or as a network answers; ``None`` where an end was not seen.
        opening_m: How far to open the gripper: for what is between the fingers and some room, or all the way.
        quality: A judge's probability that the grasp holds, or the network's smoothed quality; 0 to 1.
        object: Index into the plan's objects, or ``None``.
        camera_from_grasp: ``[4, 4]`` in the optical frame of the first camera, or of a cloud's camera if the table was found.
        width_seen_share: Share of the ends of what is between the fingers that were seen; ``None`` if nothing was measured.
        robustness: If it holds, the share of repeats (heavier, smoother, moved) that a judge expects to hold; ``None`` if not learned.
        base_from_grasp: ``[4, 4]`` in the robot's base, if that was given, by ``base_from_workspace`` or ``base_from_camera``.
        workspace_from_flange: ``[4, 4]``, if the gripper has a ``flange_from_grasp``; ``base_from_flange``, if both are known.
        doubt: Why it comes last: ``"no_depth"``, ``"bent_table"`` or ``"cut_by_border"``; ``None`` of most.
    """

    workspace_from_grasp: NDArray[np.float64]
    width_m: float | None
    opening_m: float
    quality: float
    object: int | None
    camera_from_grasp: NDArray[np.float64] | None = None
    width_seen_share: float | None = None
    robustness: float | None = None
    base_from_grasp: NDArray[np.float64] | None = None
    workspace_from_flange: NDArray[np.float64] | None = None
    base_from_flange: NDArray[np.float64] | None = None
    doubt: str | None = None


class Plan(Immutable, Sequence[Grasp]):
    """Ranked grasps, best first: a sequence of :class:`Grasp`. ``reason`` says why it is empty, ``timings_ms`` how long stages took."""

    _text: str
    timings_ms: dict[str, float]
    _cloud: NDArray[np.float32]
    #: For pages and images; a plan that was pickled has none.
    _drawn: _native.Plan | None = None

    @classmethod
    def _of(cls, native: _native.Plan) -> Plan:
        made = cls.__new__(cls)
        made._drawn, made._text, made.timings_ms = native, native.json(), dict(native.timings_ms)
        made._cloud = native.cloud().reshape(-1, 3)
        return made

    @property
    def _source(self) -> _native.Plan:
        if self._drawn is None:
            raise InputError("the plan was pickled or read, and so has no page, overlay or labels: make them in the process that made it")
        return self._drawn

    def __getstate__(self) -> dict[str, Any]:
        return {name: vars(self)[name] for name in ("_text", "timings_ms", "_cloud")}

    @cached_property
    def answer(self) -> dict[str, Any]:
        """The whole plan, as the JSON of the command and the service has it (``docs/planning.md``)."""
        return cast("dict[str, Any]", json.loads(self._text))

    @classmethod
    def from_json(cls, text: str | bytes) -> Plan:
        """The plan of a JSON with which the command or the service answered: without a cloud, a page and times."""
        with _arrays.read_as("text must be the JSON of a plan", text):
            answer = json.loads(text)
        told = answer.get("format") if isinstance(answer, dict) else answer
        _arrays.must(told == FORMAT and isinstance(answer, dict), f"format must be {FORMAT}", told)
        made = cls.__new__(cls)
        made._text, made.timings_ms = text if isinstance(text, str) else text.decode(), {}
        made._cloud = np.empty((0, 3), np.float32)
        try:
            poses, scored = made.workspace_from_grasp, made.qualities
            is_whole = bool(np.isfinite(poses).all() and np.isfinite(scored).all() and answer["gripper"])
        except (LookupError, TypeError, ValueError) as error:
            raise InputError(f"text must be the JSON of a plan, got a grasp without {error}") from error
        _arrays.must(is_whole, "text must be the JSON of a plan, got poses or qualities that are not finite")
        return made

    def to_json(self) -> str:
        """The JSON with which the command and the service answer."""
        return self._text

    @cached_property
    def grasps(self) -> list[Grasp]:
        """The grasps, best first."""

        def value(row: dict[str, Any], name: str) -> Any:
            if name == "doubt":
                return row.get(name)
            return _matrix(row[name]) if "_from_" in name and row[name] is not None else row[name]

        return [Grasp(**{one.name: value(row, one.name) for one in fields(Grasp)}) for row in self.answer["grasps"]]

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
        """The poses of all grasps, ``[N, 4, 4]``, as :func:`graspmill.execute` takes them."""
        return np.stack([grasp.workspace_from_grasp for grasp in self.grasps]) if len(self) else np.empty((0, 4, 4))

    @property
    def qualities(self) -> NDArray[np.float64]:
        """The qualities of all grasps, ``[N]``."""
        return np.array([grasp.quality for grasp in self.grasps])

    @property
    def reason(self) -> str | None:
        """Why there are no grasps; ``None`` if there are."""
        return cast("str | None", self.answer["reason"])

    @property
    def warnings(self) -> list[str]:
        """What else is to be known."""
        return cast("list[str]", self.answer["warnings"])

    @property
    def workspace_from_camera(self) -> NDArray[np.float64] | None:
        """The first camera in the workspace, ``[4, 4]``, as it was given or found; ``None`` without one."""
        pose = self.answer["workspace_from_camera"]
        return None if pose is None else _matrix(pose)

    def overlay(self, image: ArrayLike | None = None) -> bytes:
        """The best grasps in the image of the first camera, as a PNG: in ``[height, width, 3]`` uint8 of red, green and
        blue, or by default in the depth image in grey. A plan that was pickled cannot be drawn."""
        if image is None:
            return self._source.overlay(None)
        pixels = _arrays.given("image", image)
        is_image = pixels.dtype == np.uint8 and pixels.ndim == 3 and pixels.shape[2] >= 3 and 0 not in pixels.shape
        _arrays.must(is_image, f"image must be uint8 [height, width, 3], got {_arrays.kind(pixels)}")
        return self._source.overlay(np.ascontiguousarray(pixels[:, :, :3]))

    def cloud(self) -> NDArray[np.float32]:
        """The observed surface, ``[N, 3]`` in the workspace, in metres."""
        return self._cloud.copy()

    def labels(self) -> NDArray[np.int32]:
        """What each point of :meth:`cloud` is of, ``[N]``: an object's index, −1 for noise, −2 for the table; not of a pickled plan."""
        return self._source.labels()

    def page(self, title: str = "") -> Page:
        """The scene and its grasps as a page, to be turned about. A plan that was pickled cannot be shown."""
        return Page(self._source.page(_arrays.text("title", title)))

    def save(self, path: str | os.PathLike[str], format: PlanFileFormat | None = None, **options: Unpack[PlanFileOptions]) -> Path:
        """Writes a file for robots, with :class:`PlanFileOptions`, and returns its path. An old one stays until the new one is whole.

        Args:
            format: ``"isaac_grasp"`` (by default for .yaml), ``"graspnet"`` (.npy), or ``"moveit"`` (needs PyYAML): the messages of
                :meth:`moveit_grasps` in a list ``grasps``. ``docs/exporting.md`` has the frames.

        Raises InputError if the plan does not know the frame, or where the base of the gripper is; OutsideError if the disk fails.
        """
        from .formats import plans

        return plans.save(self, path, format, options)

    def moveit_grasps(self, **options: Unpack[PlanFileOptions]) -> list[dict[str, Any]]:
        """The grasps with the fields of ``moveit_msgs/Grasp``, best first, with :class:`PlanFileOptions`. Without known
        joints or a width they have no posture. Raises InputError if the frame or the robot's last link is not known."""
        from .formats import plans

        return plans.moveit_grasps(self, options)

    def _repr_html_(self) -> str | None:
        return None if self._drawn is None else self.page()._repr_html_()

    def __repr__(self) -> str:
        return f"Plan({len(self)} grasps, the best {self.grasps[0].quality:.3f})" if len(self) else f"Plan(no grasps: {self.reason})"


def _matrix(pose: dict[str, list[float]]) -> NDArray[np.float64]:
    return np.asarray(_arrays.matrices([[*pose["position_m"], *pose["quaternion_xyzw"]]])[0])
