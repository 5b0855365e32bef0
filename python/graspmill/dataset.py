"""Datasets: generated, read and shown."""

from __future__ import annotations

import copyreg
import json
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Callable, Iterator, Mapping, cast

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _native
from .cameras import Camera
from .errors import InputError
from .grippers import GripperLike
from .pages import Page
from .scene import Outcomes, Scene, _pairs

#: Called with the numbers of attempts that are done, of all attempts, and of positive ones from this call.
Progress = Callable[[int, int, int], None]


def _location(path: str | os.PathLike[str]) -> str:
    text = _arrays.path("the dataset", path)
    return text if "://" in text else os.path.abspath(text)


# What holds an open dataset opens it again in another process.
copyreg.pickle(_native.Dataset, lambda opened: (_native.Dataset, (_location(opened.location),)))


def generate(
    out: str | os.PathLike[str], config: str | os.PathLike[str] | None = "paper", *, gripper: GripperLike | None = None,
    shards: int | None = None, attempts: int | None = None, seed: int | None = None,
    policy: str | os.PathLike[str] | None = None, settings: Mapping[str, Any] | None = None, rejected_max: float = 0.1,
    threads: int | None = None, progress: Progress | None = None,
) -> Dataset:  # fmt: skip
    """Generates a dataset in a folder or at a URL, or continues it, with the bytes of ``graspmill generate``.

    Args:
        config: ``"paper"``, which comes with the package, or the path of a config.
        gripper: A :class:`Gripper`, the name of a built-in one, or the path of a file, in place of the config's.
        shards: Number of shards, like ``attempts`` and ``seed`` in place of the config's.
        policy: Weights of a judge, whose best grasps are executed, too.
        settings: Other keys of the config, such as ``{"objects.size_m": [0.02, 0.1]}``.
        rejected_max: The share of scenes that may be discarded because objects do not come to rest.
        threads: Number of threads, by default one per core; it never changes the bytes.
        progress: A function of the attempts that are done, of all, and of the positive ones; an exception that it raises stops the work.

    Raises InputError if the config is wrong, or the folder holds another dataset; OutsideError if the disk or the store fails, and
    KeyboardInterrupt after Ctrl-C: complete shards are kept, and the same call continues.
    """
    where, limits = _location(out), {"shards": shards, "attempts": attempts, "seed": seed}
    shards, attempts, seed = (None if value is None else _arrays.whole(name, value, 0, 2**63 - 1) for name, value in limits.items())
    count, share = _arrays.threads(threads), _arrays.number("rejected_max", rejected_max, 0.0, 1.0)
    files = (("config", None if config == "paper" else config), ("policy", policy))
    paths = [None if path is None else os.path.abspath(_arrays.path(name, path)) for name, path in files]
    _arrays.must(progress is None or callable(progress), "progress must be a function", progress)
    work, has_ended = _native.Generation(where, paths[0], shards, attempts, seed, paths[1], _pairs(gripper, settings), share, count), False
    try:
        while not has_ended:
            has_ended = work.has_ended()
            if progress is not None:
                progress(*work.counts)
    except BaseException:
        work.stop()
        raise
    return Dataset(where)


class Table:
    """The rows of a table, read as often as it is asked for: an Arrow stream (``__arrow_c_stream__``) for ``polars.DataFrame(table)``,
    ``pyarrow.table(table)`` and, of that, ``to_pandas()``."""

    def __init__(self, dataset: _native.Dataset, name: str, shards: range, grids: bool) -> None:
        self._dataset, self.name, self._shards, self._grids = dataset, name, shards, grids

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self._dataset.stream(self.name, self._shards.start, self._shards.stop, self._grids)


@dataclass(frozen=True, eq=False)
class StoredScene:
    """A scene of a dataset, the ``cameras`` that saw it, the ``outcomes`` of its attempts and ``rules`` that drew them.

    Attributes:
        scene: Its objects at rest. :func:`graspmill.execute` uses the simulation of the dataset for it.
        tsdf: ``[resolution] * 3`` float32 (x, y, z) in VGN's values: (tsdf + 1) / 2 where observed, else 0.
        workspace_from_grasp: ``[N, 7]`` float32, the poses of its attempts: position in metres, quaternion x, y, z, w.
    """

    scene_id: int
    scene: Scene
    cameras: list[Camera]
    tsdf: NDArray[np.float32]
    workspace_from_grasp: NDArray[np.float32]
    outcomes: Outcomes
    rules: list[str]
    _dataset: _native.Dataset

    def depth_images(self) -> list[NDArray[np.float32]]:
        """What each camera saw, ``[height, width]``, in metres along its z, 0 where it saw nothing: the images that the
        TSDF was made of, with the noise of the dataset's sensor. ``scene.render(camera)`` has none."""
        return self._dataset.depth_images(self.scene_id)

    def replay(self, attempt_id: int) -> Page:
        """A page with an animation of an attempt, which is executed again."""
        number = _arrays.whole("attempt_id", attempt_id, 0, max(len(self.outcomes) - 1, 0))
        return Page(self._dataset.replay_page(self.scene_id, number))

    def export(self, folder: str | os.PathLike[str], format: str = "mjcf") -> None:
        """Writes the scene as ``graspmill dataset export`` does (``docs/exporting.md``): ``"mjcf"`` for MuJoCo,
        ``"urdf"`` for PyBullet and others, ``"usda"`` for Isaac Sim and others. It replaces files of the same names."""
        from .formats.scenes import export_scene, outside

        where = Path(_arrays.path("folder", folder))
        with outside(where):
            export_scene(self._dataset, json.loads(self._dataset.info()), self.scene_id, _arrays.text("format", format), where)

    def page(self) -> Page:
        """A page with the scene in 3-D: its surface, its cameras and every attempt."""
        return Page(self._dataset.scene_page(self.scene_id))

    def _repr_html_(self) -> str:
        return self.page()._repr_html_()


class Dataset:
    """A complete dataset in a folder or at a URL (``s3://``, ``gs://``, ``az://``, ``https://``), whose rows are read on request.
    Raises InputError if there is none, IncompleteError if shards are missing, DataError if it is visibly damaged.

    Attributes:
        id: SHA-256 of its ``meta/info.json``; copies of a dataset have the same id.
        shard_count: Number of shards, like ``scene_count``, ``attempt_count`` and, of attempts with label 1, ``positive_count``.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._native = _native.Dataset(_location(path))
        self.id, (self.shard_count, self.scene_count, self.attempt_count, self.positive_count) = self._native.id, self._native.counts

    def __reduce__(self) -> tuple[type[Dataset], tuple[str]]:
        return type(self), (_location(self._native.location),)

    def __repr__(self) -> str:
        counts = f"{self.attempt_count:,} attempts, {self.positive_count:,} held, {self.scene_count:,} scenes"
        return f"Dataset({self._native.location!r}: {counts})"

    @property
    def info(self) -> dict[str, Any]:
        """Its ``meta/info.json``, which has the whole configuration."""
        return cast("dict[str, Any]", json.loads(self._native.info()))

    def __len__(self) -> int:
        return self.scene_count

    def scene(self, scene_id: int) -> StoredScene:
        """A scene with its attempts, by its number from 0."""
        number = _arrays.whole("scene_id", scene_id, 0, self.scene_count - 1)
        scene, rows = Scene._of((self._native, number))
        width, height, fx, fy, cx, cy = self._native.intrinsics()
        cameras = [Camera(int(width), int(height), fx, fy, cx, cy, pose) for pose in rows["workspace_from_camera"]]
        outcomes = Outcomes(*(rows[one.name] for one in fields(Outcomes)))
        poses = rows["workspace_from_grasp"]
        return StoredScene(number, scene, cameras, rows["tsdf"], poses, outcomes, rows["rule"], self._native)

    def __getitem__(self, scene_id: int) -> StoredScene:
        number = _arrays.whole("scene_id", scene_id, -(2**63), 2**63 - 1)
        if not -self.scene_count <= number < self.scene_count:
            raise IndexError(scene_id)  # ends a for loop over the scenes
        return self.scene(number % self.scene_count)

    def __iter__(self) -> Iterator[StoredScene]:
        return (self.scene(number) for number in range(self.scene_count))

    def attempts(self, shards: range | None = None) -> Table:
        """The table of attempts (``graspmill manual markdown tables``) of some shards, or of all."""
        return self._table("attempts", shards, False)

    def objects(self, shards: range | None = None) -> Table:
        """The table of objects."""
        return self._table("objects", shards, False)

    def scenes(self, shards: range | None = None, *, grids: bool = False) -> Table:
        """The table of scenes. With ``grids`` it has their TSDFs, which are nearly all of its bytes."""
        return self._table("scenes", shards, grids)

    def _table(self, name: str, shards: range | None, grids: bool) -> Table:
        wanted = range(self.shard_count) if shards is None else shards
        if not isinstance(wanted, range) or wanted.step != 1 or not 0 <= wanted.start <= wanted.stop <= self.shard_count:
            raise InputError(f"shards must be a range within range({self.shard_count}), got {_arrays.shown(shards)}")
        return Table(self._native, name, wanted, grids)

    def verify(self) -> list[str]:
        """Reads and checks everything. Returns the problems, or an empty list."""
        return self._native.verify()

    def report(self) -> dict[str, Any]:
        """Statistics, as ``graspmill dataset report --json`` has them."""
        return cast("dict[str, Any]", json.loads(self._native.report(False)))

    def page(self) -> Page:
        """The statistics as a page with figures."""
        return Page(self._native.report(True))

    def _repr_html_(self) -> str:
        return self.page()._repr_html_()

