"""Fixtures for the tests of the cross-check and of the judge: a gripper and its procedure, a table, two orientations."""

import numpy as np

from crosscheck import engines
from crosscheck.attempt import Runner
from crosscheck.contract import Attempt, Environment, Execution, Gripper, Procedure, Scene, SceneObject
from crosscheck.pose import Pose
from crosscheck.solid import Solid

SOLIDS = [
    Solid("cuboid", (0.03, 0.05, 0.07)),
    Solid("cylinder", (0.04, 0.04, 0.09)),
    Solid("tri_prism", (0.08, 0.05, 0.04)),
    Solid("half_cylinder", (0.08, 0.06, 0.03)),
]
GRIPPER = Gripper("jaw", 0.08, 0.05, 0.02, 0.01, 0.04, 0.04, 0.12, 0.1, 20.0, 0.05, 1.0, 0.001)
PROCEDURE = Procedure(0.05, 0.10, 1.0471976, 0.2, 1.0, 0.25, 0.002, 0.5, 0.01, 0.01)
TABLE = Environment(table_z_m=0.05, table_friction=1.0, gravity_m_s2=9.81)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
DOWN = np.array([1.0, 0.0, 0.0, 0.0])  # half a turn about x: the approach points down


def standing(body, grasp, mass_kg=0.1, friction=1.0, at_m=(0.15, 0.15, 0.085), fixtures=(), beside_m=None) -> Scene:
    """A body in the middle of the table, perhaps another one beside it, and a grasp of the first."""
    places = [np.array(at_m), *([] if beside_m is None else [np.array(at_m) + [0, beside_m, 0]])]
    things = [SceneObject(body, mass_kg, friction, Pose(place, UPRIGHT)) for place in places]
    return Scene(0, things, [Attempt(0, 0, body.kind, "", grasp, "held", None, float("nan"))], fixtures)


def closed(name: str, one: Scene, gripper: Gripper = GRIPPER) -> Execution:
    """How the first attempt of a scene ends in an engine, from closing on."""
    engine, attempt = engines.make(name), one.attempts[0]
    ended = Runner(engine, one, gripper, PROCEDURE, TABLE).from_closing(attempt, attempt.workspace_from_grasp)
    engine.close()
    return ended
