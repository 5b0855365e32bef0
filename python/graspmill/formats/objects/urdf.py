"""URDF: the collision shapes of all links, of a link without any its visual ones, and the sum of the links' masses."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from ..._robots import Floats, mesh_file, surface_of, urdf_model
from ...errors import InputError


def parts(path: Path) -> list[Path]:
    """The meshes that it names."""
    return [mesh_file(mesh.get("filename", ""), path.parent) for mesh in ET.parse(path).getroot().iter("mesh")]


def read(path: Path) -> tuple[Floats, float | None]:
    """Its triangles and its mass."""
    masses = [float(mass.get("value", "")) for mass in ET.parse(path).getroot().iterfind("link/inertial/mass")]
    if wrong := [mass for mass in masses if not 0 <= mass < np.inf]:
        raise InputError(f"the mass of a link must be 0 or more, got {wrong[0]}")
    model, _ = urdf_model(path)
    return surface_of(model, range(model.ngeom)), sum(masses) or None
