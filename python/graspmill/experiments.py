"""Experiments: tables cleared in simulation, by our planner or by a function of the user."""

from __future__ import annotations

import json
import os
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterable, Mapping, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from .cameras import Camera
from .dataset import Progress
from .errors import OutsideError
from .grippers import Gripper
from .pages import Page
from .plans import Plan
from .scene import setting_pairs

#: What a function that plans returns: a plan, or poses and scores, and widths if it knows them.
Planned = Union[Plan, "tuple[ArrayLike, ArrayLike]", "tuple[ArrayLike, ArrayLike, ArrayLike]"]


@dataclass(frozen=True, eq=False)
class Look:
    """What a planner is shown of a scene. Poses, points and directions are in the workspace, or, of an experiment with
    ``frames = "found"``, in the frame of the first camera, which then has no pose.

    Attributes:
        depths: Of each camera the depth image, ``[height, width]`` float32 in metres along its z; 0 or NaN where nothing was seen.
        cameras: The cameras, as :meth:`Planner.plan` takes them.
        objects: Of each camera the object that each pixel shows in truth, ``[height, width]`` int32; −1 for none.
        object_count: Number of objects on the table; some may be hidden.
        failed: ``[N, 4, 4]``, grasps that failed on this scene, if the experiment tells them (``stop.avoid_failed``).
        down: The direction of gravity, ``[3]``.
        gripper: The gripper that will execute the grasp.
        workspace_size_m: Side of the workspace for :meth:`Planner.plan`; ``None`` for its default.
    """

    depths: list[NDArray[np.float32]]
    cameras: list[Camera]
    objects: list[NDArray[np.int32]]
    object_count: int
    failed: NDArray[np.float64]
    down: NDArray[np.float64]
    gripper: Gripper
    workspace_size_m: float | None

    @classmethod
    def _of(cls, seen: _native.Seen, gripper: Gripper) -> Look:
        cameras: list[Camera] = []
        for (width, height, fx, fy, cx, cy), pose in seen.cameras():
            is_known = cameras or not seen.finds_table
            cameras.append(Camera(int(width), int(height), fx, fy, cx, cy, np.asarray(pose) if is_known else None))
        failed, down = _arrays.matrices(seen.failed()), np.asarray(seen.down, np.float64)
        return cls(seen.depths(), cameras, seen.objects(), seen.object_count, failed, down, gripper, seen.workspace_size_m)

    def clouds(self) -> tuple[list[NDArray[np.float32]], NDArray[np.float32]]:
        """The points that all cameras saw, in metres: of each object ``[N, 3]``, and of everything else ``[M, 3]``."""
        points, shown = [], []
        for depth, camera, objects in zip(self.depths, self.cameras, self.objects):
            v, u = np.nonzero(np.isfinite(depth) & (depth > 0))
            z = depth[v, u].astype(np.float64)
            rays = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones(len(u))], axis=1)
            pose = np.eye(4) if camera.workspace_from_camera is None else camera.workspace_from_camera
            points.append(((rays * z[:, None]) @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32))
            shown.append(objects[v, u])
        cloud, of = np.concatenate(points), np.concatenate(shown)
        return [cloud[of == number] for number in range(self.object_count)], cloud[of < 0]


@dataclass(frozen=True, eq=False)
class ExperimentResults:
    """The results of an experiment: counts, and rates with intervals; its ``folder`` has more."""

    folder: Path
    results: dict[str, Any]

    def page(self) -> Page:
        """Rates with their intervals, and failures, as ``graspmill experiment report`` writes it."""
        return Page(_native.experiment_page(self.folder))

    def __repr__(self) -> str:
        told = "{protocol}: {held} of {attempts} grasps held, {removed} of {objects} objects removed"
        return f"ExperimentResults({told.format(**self.results)})"


def experiment(
    out: str | os.PathLike[str], config: str | os.PathLike[str] = "pile", *,
    planner: Callable[[Look], Planned] | None = None, name: str | None = None, rounds: int | None = None,
    seed: int | None = None, settings: Mapping[str, Any] | None = None, threads: int | None = None,
    progress: Progress | None = None,
) -> ExperimentResults:  # fmt: skip
    """Clears tables in simulation and counts, or continues that, in a folder: ``graspmill experiment run``.

    Args:
        config: ``"pile"`` or the path of an experiment's file (``configs/experiment``).
        planner: A function of a :class:`Look` that returns a :class:`Plan`, or a tuple of grasps in the frame of the look: poses
            ``[N, 4, 4]`` or ``[N, 7]``, scores ``[N]`` and, if it knows them, widths ``[N]`` of what is held, in metres. The grasp
            with the highest score is executed; of a plan the first. By default our planner.
        name: What tells its results from those of another: a folder continues with the same name only. By default the function's.
        rounds: Rounds of a seed, and ``seed`` the only seed of the scenes, in place of the config's.
        settings: Other keys of the experiment, ``{"noise.kind": "d435"}``, and of our planner, ``{"plan.gripper": "franka_hand"}``;
            where a function plans, of these the gripper's alone.
        threads: Rounds at once, by default one per core; it changes times, not results.
        progress: A function of the rounds that are done, of all, and of the grasps that held; an exception that it raises stops the work.

    Raises InputError if the config is wrong, or the folder holds another experiment; DataError if its journal was damaged. After
    OutsideError (the disk fails, or the function raises it) and KeyboardInterrupt the same call continues with the next rounds.

    The function runs on the caller's thread, for one scene at a time. If it raises an ``Exception`` or returns anything else, the
    **round** is over (``no_answer``, with the reason in ``journal.jsonl``), not the run. No grasps are an answer.
    """
    _arrays.must(planner is not None or name is None, "name goes with planner: our own has a name")
    more = ({} if rounds is None else {"rounds": rounds}) | ({} if seed is None else {"seeds": [seed]})
    pairs = setting_pairs(settings) + setting_pairs(more)
    if planner is not None:
        _arrays.must(callable(planner), "planner must be a function of a graspmill.Look", planner)
        own = f"{getattr(planner, '__module__', '')}.{getattr(planner, '__qualname__', type(planner).__qualname__)}"
        name = own if name is None else _arrays.text("name", name)
        check_keys(pairs)
    folder = Path(os.path.abspath(_arrays.path("out", out)))
    file = None if config == "pile" else os.path.abspath(_arrays.path("config", config))
    count = (os.cpu_count() or 1) if threads is None else _arrays.whole("threads", threads, 1, 1024)
    command = f"graspmill.experiment({str(out)!r}, {str(config)!r}{f', planner={name}' if name else ''})"
    _arrays.must(progress is None or callable(progress), "progress must be a function", progress)
    who = None if name is None else (f"function-{name}", f"the function {name}")
    play(_native.Experiment(folder, file, pairs, who, command, count), planner, progress)
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    return ExperimentResults(folder, report["results"])


def play(work: _native.Experiment, planner: Callable[[Look], Planned] | None, tell: Progress | None) -> str:
    """Plays the rounds that are missing; their rates in a few lines."""
    gripper = Gripper._of(work.gripper())
    try:
        while (in_short := work.in_short) is None:
            seen = work.soon()
            if seen is not None and planner is not None:
                _answer(work, planner, Look._of(seen, gripper))
            if tell is not None:
                tell(*work.counts)
    except BaseException:
        work.stop()
        raise
    return in_short


def check_keys(pairs: Iterable[tuple[str, str]]) -> None:
    """Refuses settings of our planner where another one plans, which they do not change: the gripper alone executes."""
    for key, _ in pairs:
        is_ours = key == "model" or (key.startswith("plan.") and key.split(".")[1] != "gripper")
        _arrays.must(not is_ours, f"{key} must be left out where another planner plans: of our planner's settings plan.gripper alone counts")


class NoAnswer(Exception):
    """A planner elsewhere gave no answer; why, in words that need no place in the code."""


def _answer(work: _native.Experiment, planner: Callable[[Look], Planned], look: Look) -> None:
    try:
        work.answer(_offers(planner(look), look))
    except OutsideError:
        raise
    except Exception as error:  # whatever it is, it is the function's answer
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"({os.path.basename(last.filename)}, line {last.lineno})"
        told = _text(error) if isinstance(error, NoAnswer) else f"{type(error).__name__}: {_text(error)} {where}"
        work.fail(told.encode(errors="replace").decode())


def _text(error: Exception) -> str:
    """What an exception says. Its text is made by code of the function's, too."""
    try:
        return str(error)
    except Exception as worse:
        return f"its text raised {type(worse).__name__}"


def _offers(planned: Any, look: Look) -> list[tuple[list[float], float, float | None, float | None]]:
    if isinstance(planned, Plan):
        return list(_of_plan(planned.answer["grasps"], look))
    _arrays.must(isinstance(planned, tuple) and len(planned) in (2, 3), "what planner returns must be a Plan, or poses and scores", planned)
    poses = _arrays.poses("the poses that planner returns", planned[0])
    scores = _arrays.floats("the scores that planner returns", planned[1], (len(poses),))
    known = _arrays.floats("the widths that planner returns", planned[2], (len(poses),)).tolist() if planned[2:] else [None] * len(poses)
    order = np.argsort(-scores, kind="stable")
    return [([float(part) for part in poses[number]], float(scores[number]), known[number], None) for number in order]


def _of_plan(rows: Iterable[dict[str, Any]], look: Look) -> Iterable[tuple[list[float], float, float | None, float | None]]:
    # A plan that found the table has a workspace of its own.
    frame = "camera_from_grasp" if look.cameras[0].workspace_from_camera is None else "workspace_from_grasp"
    for row in rows:
        pose = row[frame]
        _arrays.must(pose is not None, "a plan must have the poses in the first camera's frame: plan from its image")
        width = row["opening_m"] if row["width_m"] is None else row["width_m"]
        yield [*pose["position_m"], *pose["quaternion_xyzw"]], row["quality"], width, row["rho_m"]
