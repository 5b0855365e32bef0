"""Labelled grasps of an object alone (``docs/object-grasps.md``)."""

from __future__ import annotations

import json
import os
import warnings
from typing import Any, Callable

from numpy.typing import ArrayLike

from . import _arrays, _native
from .grippers import GripperLike
from .object_grasps import ObjectGrasps
from .scene import Object, _simulation


def annotate(
    object: Object | str | os.PathLike[str] | Any, *, gripper: GripperLike | None = None, grasps: int = 2_000,
    given: ArrayLike | None = None, held_only: bool = False, test: str = "turn",
    shares: tuple[float, float, float] = (0.8, 0.1, 0.1), touch_m: float = 0.003, margins: bool = False, repeats: int = 4,
    drops: int = 100, scale: float | None = None, seed: int = 1, threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> ObjectGrasps:  # fmt: skip
    """Draws grasps over the whole surface of an object that floats, executes each, and says how it ended: in the frame of the
    mesh, or of the :class:`Object`. Equal arguments give equal grasps, those of ``graspmill objects annotate``.

    Args:
        object: An object at any pose, a mesh as for :meth:`Object.mesh`, or the path of a mesh, a URDF, an MJCF or a catalogue of one.
        gripper: A :class:`Gripper`, the name of a built-in one, or the path of a file; ``parallel_jaw_80`` by default.
        grasps: Number of grasps, drawn by ``seed``; with ``held_only`` only those that hold count and are kept.
        given: Grasps of somebody else to be labelled instead, ``object_from_grasp``, ``[N, 4, 4]`` or ``[N, 7]``.
        test: What the object must bear: ``lift``, ``turn``, ``tug`` or ``shake``.
        shares: Shares of antipodal, normal and displaced grasps.
        touch_m: An object that the open gripper would touch on its way is pushed aside, at most so far; 0 for a collision.
        margins: Whether to measure the smallest friction and the strongest pull of each that holds.
        repeats: Most repeats of each, with errors of pose, friction, mass and force: two where all end alike.
        drops: Number of drops that find the object's stable poses.
        scale: Metres per unit of a mesh; by default guessed from its size.
        progress: Is told how many grasps there are; an exception that it raises stops the work.

    Warns of what was guessed of a file or is unusual about it: ``info["object"]["warnings"]``. Raises InputError for what is wrong.
    """
    from .formats import objects
    from .formats.grasps import parquet

    path = os.path.abspath(_arrays.path("object", object)) if isinstance(object, (str, os.PathLike)) else None
    _arrays.must(path is not None or scale is None, "scale goes with a file")
    thing: Any = object if path is not None or isinstance(object, Object) else Object.mesh(object, (0, 0, 0))
    body = (thing._body, thing.mass_kg, thing.friction, [0.0] * 3 if thing is object else thing._body.centre_m) if path is None else None
    scale = None if scale is None else _arrays.number("scale", scale, 1e-9, 1e6)
    parts = [_arrays.number("shares", share, 0.0, 1.0) for share in _arrays.floats("shares", shares, (3,))]
    _arrays.must(sum(parts), "shares must not all be 0")
    count, seed = _arrays.whole("grasps", grasps, 1, 1_000_000), _arrays.whole("seed", seed, 0, 2**63 - 1)
    repeats, drops = _arrays.whole("repeats", repeats, 0, 1_000), _arrays.whole("drops", drops, 0, 10_000)
    held_only, margins = _arrays.flag("held_only", held_only), _arrays.flag("margins", margins)
    touch_m = _arrays.number("touch_m", touch_m, 0.0, 0.02)
    params = (count, held_only, parts, _arrays.text("test", test), touch_m, margins, repeats, drops, seed)
    poses = None if given is None else _arrays.poses("given", given)
    _arrays.must(progress is None or callable(progress), "progress must be a function", progress)
    with objects.described([] if path is None else [path]) as described:
        file = None if path is None else (path, scale, described)
        work = _native.Annotation(body, file, _simulation(gripper, None), params, poses, _arrays.threads(threads))
        while not work.has_ended():
            if progress is not None:
                progress(work.made)
    info = json.loads(work.info())
    for text in info["object"]["warnings"]:
        warnings.warn(f"{info['object']['name']}: {text}", stacklevel=2)
    return ObjectGrasps(**parquet.of_columns(work.columns(), info))
