"""MJCF: the shapes of all bodies that collide (if none does, all), and MuJoCo's mass.

Shapes of the world are an object's surroundings, unless the model has no bodies.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..._robots import Floats, mujoco_module, surface_of
from ...errors import InputError

#: Most elements of a model, with those that ``replicate`` makes: MuJoCo needs minutes for more, and cannot be stopped.
ELEMENTS_MAX = 10_000


def _count(element: ET.Element) -> int:
    times = int(element.get("count", "1")) if element.tag == "replicate" else 1
    return times * (1 + sum(map(_count, element)))


def _spec(path: Path) -> Any:
    with suppress(ET.ParseError):  # MuJoCo says what is wrong
        if (count := _count(ET.parse(path).getroot())) > ELEMENTS_MAX:
            raise InputError(f"a model has at most {ELEMENTS_MAX} elements, got {count}")
    return mujoco_module().MjSpec.from_file(str(path))


def parts(path: Path) -> list[Path]:
    """The meshes that it names."""
    spec = _spec(path)
    names = [Path(mesh.file).name if spec.strippath else mesh.file for mesh in spec.meshes if mesh.file]
    return [path.parent / spec.meshdir / name for name in names]


def read(path: Path) -> tuple[Floats, float | None]:
    """Its triangles and its mass."""
    mujoco, spec = mujoco_module(), _spec(path)
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
