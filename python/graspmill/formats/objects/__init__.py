"""Descriptions of bodies as objects: all shapes that collide as one mesh, with all joints at zero, and the mass.

A format is a module with ``parts``, the meshes that a description names, and ``read``, which gives triangles,
``[N, 3, 3]`` in metres, and the mass in kilograms, or ``None`` where there is none.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Iterable, Iterator

from ..._robots import mujoco_module, stl
from ...errors import InputError
from . import mjcf, urdf

FORMATS: dict[str, Any] = {".urdf": urdf, ".xml": mjcf}
#: What is no model of MuJoCo may also be called .xml.
_MODEL = re.compile(rb"<mujoco[\s>]")


def is_description(path: str) -> bool:
    """Whether a file's name is a description's."""
    return Path(path).suffix.lower() in FORMATS


@contextmanager
def described(places: Iterable[str]) -> Iterator[str | None]:
    """Reads the descriptions among some files and in folders.

    Args:
        places: Files and folders; what is neither, is left out.

    Yields:
        The path of a file for the native import (``generator/src/import/described.rs``), or ``None`` without descriptions.
    """
    files = {os.path.realpath(file): file for place in places for file in _descriptions(place)}
    if not files:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="graspmill-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = {real: _described(Path(file), Path(folder) / f"{number}.stl") for number, (real, file) in enumerate(files.items())}
        listed = Path(folder) / "described.json"
        listed.write_text(json.dumps(table))
        yield str(listed)


def run_native(words: list[str]) -> int:
    """Runs the native command of these words, for which the descriptions among them, and in folders, are read; returns
    its exit code."""
    from ... import _native

    with described(word for word in words[2:] if not word.startswith("-")) as listed:
        more = [] if listed is None else ["--described", listed]
        return _native.run_program(["graspmill", *words[:2], *more, *words[2:]])


def _descriptions(place: str) -> Iterator[str]:
    if os.path.isfile(place) and is_description(place):
        yield place
    seen = set()
    for folder, inner, names in os.walk(place, followlinks=True):
        if (real := os.path.realpath(folder)) in seen:
            inner.clear()
            continue
        seen.add(real)
        for path in (Path(folder) / name for name in names if is_description(name)):
            if path.suffix.lower() == ".urdf" or _MODEL.search(path.read_bytes()):
                yield str(path)


def _described(file: Path, mesh: Path) -> dict[str, Any]:
    """What becomes of a description; its triangles go to a file."""
    made: dict[str, Any] = {"mesh": str(mesh), "mass_kg": None, "parts": [], "refused": None}
    form = FORMATS[file.suffix.lower()]
    try:
        mujoco_module()
    except InputError as error:
        return made | {"refused": [f"{error}: {file}", False]}
    try:
        made["parts"] = [os.path.realpath(part) for part in form.parts(file)]
        triangles, mass_kg = form.read(file)
        mesh.write_bytes(stl(triangles))
        return made | {"mass_kg": mass_kg}
    except Exception as error:  # whatever a library says of one file, the others go on
        what = " ".join(str(error).split())
        return made | {"refused": [f"it cannot be read: {what}" + f": {file}" * (str(file) not in what), True]}
