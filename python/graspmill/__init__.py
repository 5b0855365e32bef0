"""Graspmill: robot-grasp datasets in physics simulation, and the networks that learn from them.

>>> import graspmill
>>> scene = graspmill.Scene([graspmill.Object.cuboid((0.04, 0.06, 0.05), (0.15, 0.15, 0.075, 0, 0, 0, 1))])
>>> camera = graspmill.Camera.look_at((0.15, -0.2, 0.5))
>>> plan = graspmill.Planner().plan(scene.render(camera), camera)
>>> graspmill.execute(scene, plan.workspace_from_grasp)  # doctest: +SKIP
Outcomes(held=27)

``docs/python.md`` is the guide. ``graspmill.torch`` has datasets and the paper's network for PyTorch.
"""

import atexit as _atexit

from . import _native
from ._native import __version__
from .annotation import annotate
from .cameras import Camera
from .crops import GraspCrops, grasp_crops
from .dataset import Dataset, StoredScene, Table, generate
from .errors import DataError, GraspmillError, IncompleteError, InputError, InternalError, OutsideError
from .experiments import ExperimentResults, Look, experiment
from .formats.grasps import read as read_grasps
from .grippers import Gripper
from .object_grasps import ObjectGrasps
from .pages import Page
from .planner import Planner, PlanOptions
from .plans import Grasp, Plan, PlanFileOptions
from .scene import HITS, OUTCOMES, Container, Object, Outcomes, Scene, execute, tsdf

# Threads that still work then must not come back to an interpreter that ends.
_atexit.register(_native.end)

__all__ = [
    "HITS", "OUTCOMES", "Camera", "Container", "DataError", "Dataset", "ExperimentResults", "Grasp", "GraspCrops",
    "GraspmillError", "Gripper", "IncompleteError", "InputError", "InternalError", "Look", "Object",
    "ObjectGrasps", "Outcomes", "OutsideError", "Page", "Plan", "PlanFileOptions", "PlanOptions", "Planner", "Scene",
    "StoredScene", "Table", "annotate", "execute", "experiment", "generate", "grasp_crops", "read_grasps", "tsdf",
]  # fmt: skip
