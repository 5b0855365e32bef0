"""Descriptions of bodies as objects: all shapes that collide as one mesh, with all joints at zero, and the mass. A
format is a function of a file and of a list, to which it adds the meshes that the file names. It gives triangles, ``[N,
3, 3]`` in metres, and the mass in kilograms, or ``None`` where there is none."""

import json
import os
import re
import tempfile
import warnings
import xml.etree.ElementTree as ET
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Iterable, Iterator

import numpy as np

from .. import _arrays, _native
from .._robots import Floats, mesh_file, mujoco_module, root_of, stl, surface_of, urdf_model
from ..errors import InputError

#: Most elements of a model, with those that ``replicate`` makes: MuJoCo needs minutes for more, and cannot be stopped.
ELEMENTS_MAX = 10_000
#: What is no model of MuJoCo may also be called .xml.
_MODEL = re.compile(rb"<mujoco[\s>]")


def urdf(path: Path, parts: list[Path]) -> tuple[Floats, float | None]:
    # The collision shapes of all links, of a link without any its visual ones, and the sum of the links' masses.
    robot = root_of(path)
    parts += [mesh_file(mesh.get("filename", ""), path.parent) for mesh in robot.iter("mesh")]
    masses = [float(mass.get("value", "")) for mass in robot.iterfind("link/inertial/mass")]
    if wrong := [mass for mass in masses if not 0 <= mass < np.inf]:
        raise InputError(f"the mass of a link must be 0 or more, got {wrong[0]}")
    model, _, _ = urdf_model(path, robot)
    return surface_of(model, range(model.ngeom)), sum(masses) or None


def mjcf(path: Path, parts: list[Path]) -> tuple[Floats, float | None]:
    # The shapes of all bodies that collide (if none does, all), and MuJoCo's mass; of the world, an object's
    # surroundings, only if there are no bodies.
    with suppress(ET.ParseError):  # MuJoCo says what is wrong
        _arrays.must((count := _count(ET.parse(path).getroot())) <= ELEMENTS_MAX, f"a model has at most {ELEMENTS_MAX} elements, got {count}")
    mujoco = mujoco_module()
    spec = mujoco.MjSpec.from_file(str(path))
    names = [Path(mesh.file).name if spec.strippath else mesh.file for mesh in spec.meshes if mesh.file]
    parts += [path.parent / spec.meshdir / name for name in names]
    spec.compiler.fusestatic = False  # bodies would become a part of the world
    if len(spec.bodies) == 1:
        whole = mujoco.MjSpec()
        whole.attach(spec, frame=whole.worldbody.add_body().add_frame(), prefix="object/")
        spec = whole
    model = spec.compile()
    is_plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    own = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] and not is_plane[geom]]
    colliding = [geom for geom in own if model.geom_contype[geom] | model.geom_conaffinity[geom]]
    return surface_of(model, colliding or own), float(model.body_mass[1:].sum()) or None


def _count(element: ET.Element) -> int:
    times = int(element.get("count", "1")) if element.tag == "replicate" else 1
    return times * (1 + sum(map(_count, element)))


FORMATS = {".urdf": urdf, ".xml": mjcf}


@contextmanager
def described(places: Iterable[str]) -> Iterator[str | None]:
    # Reads the descriptions among files and in folders. Gives the path of a file for the native import
    # (``generator/src/import/described.rs``), or ``None`` without descriptions.
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
    with described(word for word in words[2:] if not word.startswith("-")) as listed:
        more = [] if listed is None else ["--described", listed]
        return _native.run_program(["graspmill", *words[:2], *more, *words[2:]])


def _descriptions(place: str) -> Iterator[str]:
    if os.path.isfile(place) and Path(place).suffix.lower() in FORMATS:
        yield place
    seen = set()
    for folder, inner, names in os.walk(place, followlinks=True):
        if (real := os.path.realpath(folder)) in seen:
            inner.clear()
            continue
        seen.add(real)
        for path in (Path(folder, name) for name in names if Path(name).suffix.lower() in FORMATS):
            if path.suffix.lower() == ".urdf" or _MODEL.search(path.read_bytes()):
                yield str(path)


def _described(file: Path, mesh: Path) -> dict[str, Any]:
    made: dict[str, Any] = {"mesh": str(mesh), "mass_kg": None, "parts": [], "refused": None}
    parts: list[Path] = []
    try:
        mujoco_module()
    except InputError as error:
        return made | {"refused": [f"{error}: {file}", False]}
    try:
        triangles, made["mass_kg"] = FORMATS[file.suffix.lower()](file, parts)
        mesh.write_bytes(stl(triangles))
    except Exception as error:  # whatever a library says of one file, the others go on
        what = " ".join(str(error).split())
        made["refused"] = [f"it cannot be read: {what}" + f": {file}" * (str(file) not in what), True]
    return made | {"parts": [os.path.realpath(part) for part in parts]}
