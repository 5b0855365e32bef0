"""Labelled grasps of an object alone (``docs/object-grasps.md``)."""

from __future__ import annotations

import json
import os
from typing import Any, Callable

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays, _native
from .errors import InputError
from .grippers import GripperLike
from .object_grasps import ObjectGrasps, stable_pose
from .scene import OUTCOMES, Object, _simulation

#: Sources of grasps, by their numbers.
SOURCES: tuple[str, ...] = tuple(_native.Annotation.sources())


def annotate(
    object: Object | str | os.PathLike[str],
    *,
    gripper: GripperLike | None = None,
    grasps: int = 2_000,
    given: ArrayLike | None = None,
    held_only: bool = False,
    test: str = "lift",
    shares: tuple[float, float, float] = (0.8, 0.1, 0.1),
    margins: bool = False,
    repeats: int = 0,
    drops: int = 100,
    scale: float | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> ObjectGrasps:
    """Draws grasps over the whole surface of an object that floats, executes each, and says how it ended.

    Equal arguments give equal grasps, those of ``graspmill objects annotate``.

    Args:
        object: An object, whose pose does not matter; or the path of a mesh, a URDF or an MJCF (which
            need MuJoCo: ``pip install graspmill[descriptions]``) or a catalogue of one object.
        gripper: A :class:`Gripper`, the name of a built-in one, or the path of a file; ``parallel_jaw_80`` by default.
        grasps: Number of grasps; with ``held_only`` of those that hold.
        given: Grasps of somebody else to be labelled instead, ``object_from_grasp``, ``[N, 4, 4]`` or ``[N, 7]``.
        held_only: Whether to go on until so many hold, and to keep only those.
        test: What the object must bear: ``lift``, ``turn``, ``tug`` or ``shake``.
        shares: Shares of antipodal, normal and displaced grasps.
        margins: Whether to measure the smallest friction and the strongest pull of each that holds.
        repeats: Number of moved repeats of each that holds.
        drops: Drops that find the object's stable poses.
        scale: Metres per unit of a mesh; by default guessed from its size.
        seed: Seed of every draw.
        threads: Number of threads, by default one per core.
        progress: Is told how many grasps there are; an exception that it raises stops the work.

    Returns:
        The grasps, in the frame of the mesh's file, or of the :class:`Object`: the middle of its bounding box.

    Raises:
        InputError: If an argument is wrong, or the file cannot be used.
    """
    from .formats import objects

    body = path = meters = None
    if isinstance(object, Object):
        body = (object._body, object.mass_kg, object.friction)
        if scale is not None:
            raise InputError("scale goes with a file")
    else:
        meters = None if scale is None else _arrays.number("scale", scale, 1e-9, 1e6)
        path = os.path.abspath(_arrays.path("object", object))
    parts = [_arrays.number("shares", share, 0.0, 1.0) for share in _arrays.floats("shares", shares, (3,))]
    if not sum(parts):
        raise InputError("shares must not all be 0")
    params = (
        _arrays.whole("grasps", grasps, 1, 1_000_000),
        _arrays.flag("held_only", held_only),
        parts,
        _arrays.text("test", test),
        _arrays.flag("margins", margins),
        _arrays.whole("repeats", repeats, 0, 1_000),
        _arrays.whole("drops", drops, 0, 10_000),
        _arrays.whole("seed", seed, 0, 2**63 - 1),
    )
    poses = None if given is None else _arrays.poses("given", given)
    count = 0 if threads is None else _arrays.whole("threads", threads, 1, 1024)
    if not (progress is None or callable(progress)):
        raise InputError(f"progress must be a function, got {_arrays.shown(progress)}")
    with objects.described([] if path is None else [path]) as described:
        file = None if path is None else (path, meters, described)
        work = _native.Annotation(body, file, _simulation(gripper, None), params, poses, count)
        while not work.has_ended():
            if progress is not None:
                progress(work.made)
    return _set(work)


def _set(work: _native.Annotation) -> ObjectGrasps:
    info: dict[str, Any] = json.loads(work.info())
    numbers = work.numbers().astype(np.float64)
    sources, outcomes = work.words()
    stable = [stable_pose(one) for one in info["stable_poses"]]
    weights = np.array([probability for probability, _ in stable])
    free = work.free_on_table()
    shares = free @ weights / weights.sum() if weights.sum() > 0 else np.full(len(numbers), np.nan)
    width, left, right, left_normal, right_normal, rest = np.split(numbers, [1, 4, 7, 10, 13], axis=1)
    return ObjectGrasps(
        name=info["object"]["name"],
        file=info["object"]["file"],
        scale_m=info["object"]["scale_m"],
        object_from_grasp=_arrays.matrices(work.poses()),
        outcome=np.array(OUTCOMES)[outcomes],
        held=outcomes == OUTCOMES.index("held"),
        source=np.array(SOURCES)[sources],
        width_m=width[:, 0],
        contacts_m=np.stack([left, right], axis=1),
        normals=np.stack([left_normal, right_normal], axis=1),
        closing_moved_m=rest[:, 0],
        closing_turned_rad=rest[:, 1],
        test_moved_m=rest[:, 2],
        test_turned_rad=rest[:, 3],
        friction_min=rest[:, 4],
        tug_max_g=rest[:, 5],
        robust_share=rest[:, 6],
        on_table_share=shares,
        is_free_on_table=free,
        stable_poses=stable,
        base_to_tips_m=info["base_to_tips_m"],
        info=info,
    )
