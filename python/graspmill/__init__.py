"""Graspmill: robot-grasp datasets in physics simulation, and the networks that learn from them.

>>> import graspmill
>>> scene = graspmill.Scene([graspmill.Object.cuboid((0.04, 0.06, 0.05), (0.15, 0.15, 0.075, 0, 0, 0, 1))])
>>> camera = graspmill.Camera.look_at((0.15, -0.2, 0.5))
>>> plan = graspmill.Planner().plan(scene.render(camera), camera)
>>> graspmill.execute(scene, plan.workspace_from_grasp)  # doctest: +SKIP
Outcomes(held=27)

``docs/python.md`` is the guide. ``graspmill.torch`` has datasets and the paper's network for PyTorch.
"""

from importlib.metadata import version as _version

from .cameras import Camera
from .dataset import Dataset, StoredScene, Table, generate
from .errors import DataError, GraspmillError, IncompleteError, InputError, InternalError, OutsideError
from .grippers import Gripper
from .hands import HandCrops, hand_crops
from .pages import Page
from .planner import Grasp, Plan, Planner, PlanOptions
from .scene import HITS, OUTCOMES, Object, Outcomes, Scene, execute, tsdf

__version__ = _version("graspmill")


def __getattr__(name: str) -> object:
    if name == "Error":
        import warnings

        warnings.warn("graspmill.Error is now graspmill.GraspmillError", DeprecationWarning, stacklevel=2)
        return GraspmillError
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "HITS",
    "OUTCOMES",
    "Camera",
    "DataError",
    "Dataset",
    "Grasp",
    "GraspmillError",
    "Gripper",
    "HandCrops",
    "IncompleteError",
    "InputError",
    "InternalError",
    "Object",
    "Outcomes",
    "OutsideError",
    "Page",
    "Plan",
    "PlanOptions",
    "Planner",
    "Scene",
    "StoredScene",
    "Table",
    "execute",
    "generate",
    "hand_crops",
    "tsdf",
]
