"""PyBullet for scenes with bodies of several parts as well.

Such a body is a base without a shape, which has the whole mass, and one massless link fixed to it for each part: PyBullet makes a
shape of corners for a link, but no shape of several hulls. The base is at the centre of mass and along the principal axes.
PyBullet changes the collision margin of bases only, but bodies share their shapes: each part's shape is first used as the base
of a separate body, where its margin is set.
"""

import numpy as np
import pybullet

from .bullet import NO_TURN, Bullet
from .compound import Compound
from .contract import SceneObject
from .pose import Pose, conjugate, product


class CompoundBullet(Bullet):
    """A PyBullet world whose scenes may hold compounds; see `crosscheck.attempt.Engine`."""

    def begin(self, workspace_from_grasp: Pose | None, retreat: np.ndarray | None) -> None:
        """A fresh world."""
        # Orientation of a compound's base in the object's frame, by body.
        self._turns: dict[int, np.ndarray] = {}
        super().begin(workspace_from_grasp, retreat)

    def _add_object(self, scene_object: SceneObject) -> int:
        if not isinstance(scene_object.solid, Compound):
            return super()._add_object(scene_object)
        c, compound, pose = self.client, scene_object.solid, scene_object.workspace_from_object
        moments, base = compound.principal(scene_object.mass_kg)
        parts = [self._part(part) for part in compound.convexes]
        count = len(parts)
        back = conjugate(base.quat_xyzw)
        body = pybullet.createMultiBody(
            scene_object.mass_kg, -1,
            basePosition=pose.apply(base.position_m), baseOrientation=product(pose.quat_xyzw, base.quat_xyzw),
            linkMasses=[0.0] * count, linkCollisionShapeIndices=[shape for shape, _ in parts],
            linkVisualShapeIndices=[-1] * count,
            linkPositions=[(at.position_m - base.position_m) @ base.rotation for _, at in parts],
            linkOrientations=[product(back, at.quat_xyzw) for _, at in parts],
            linkInertialFramePositions=[[0, 0, 0]] * count, linkInertialFrameOrientations=[NO_TURN] * count,
            linkParentIndices=[0] * count, linkJointTypes=[pybullet.JOINT_FIXED] * count,
            linkJointAxis=[[0, 0, 1]] * count, physicsClientId=c,
        )  # fmt: skip
        self._surface(body, -1, scene_object.friction, localInertiaDiagonal=moments)
        for link in range(count):
            self._surface(body, link, scene_object.friction)
        self._turns[body] = base.quat_xyzw
        return body

    def _pose(self, body: int) -> Pose:
        """Where an object's centre of mass is, and how its frame is turned."""
        pose = super()._pose(body)
        turn = self._turns.get(body)
        return pose if turn is None else Pose(pose.position_m, product(pose.quat_xyzw, conjugate(turn)))
