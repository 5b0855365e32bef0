"""A scene is a folder, which needs no other file. Objects are at rest, with the convex parts, masses and frictions of the
simulation that made the labels. ``scene.json`` has poses, masses, frictions, inertias, cameras, the gripper and the
attempts with their outcomes, as plain numbers.
"""

# A format is a module with ``files``, the texts of a scene's files by their names.

import json
import os
import shutil
from pathlib import Path
from typing import Any, Callable

from ... import _arrays, _native
from ...scene import OUTCOMES
from .._files import as_json, outside as outside, part, write as write_file
from . import mjcf, urdf, usda
from ._world import World

FORMATS = {"mjcf": mjcf, "urdf": urdf, "usda": usda}


def export_scene(dataset: _native.Dataset, info: dict[str, Any], scene_id: int, form: str, folder: Path) -> dict[str, Any]:
    _arrays.must(form in FORMATS, f"format must be one of {', '.join(FORMATS)}, got {json.dumps(form)}")
    _arrays.must(not folder.is_file(), f"the scene must go to a folder, got a file: {folder}")
    world = World(dataset, info, scene_id)
    for name, text in {**FORMATS[form].files(world), "scene.json": as_json(world.plain) + "\n"}.items():
        write_file(folder / name, text)
    return world.rows


def write(dataset: _native.Dataset, info: dict[str, Any], form: str, scenes: list[int], folder: Path, done: Callable[[int], None]) -> dict[str, int]:
    counts = dict.fromkeys(("attempts", "positives", "scenes"), 0)
    for scene_id in scenes:
        path = folder / f"scene-{scene_id:09}"
        if path.is_dir():
            rows = dataset.scene(scene_id)[2]
        else:
            shutil.rmtree(part(path), ignore_errors=True)
            rows = export_scene(dataset, info, scene_id, form, part(path))
            os.rename(part(path), path)
        counts["attempts"] += len(rows["outcome"])
        counts["positives"] += int((rows["outcome"] == OUTCOMES.index("held")).sum())
        counts["scenes"] += 1
        done(1)
    return {**counts, "grasps": counts["attempts"]}
