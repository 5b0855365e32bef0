"""PyBullet for a floating object: the gripper's root is so heavy that nothing moves it but the speed that is written.

Of the points of a hard contact PyBullet loads one alone: an object then turns between two fingers at 11 to 46 % of the
pull of Coulomb's law. Fingers with a stiffness load all. A hull's points may lie within its face, which costs up to 30 %.
"""

import numpy as np
import pybullet

from .bullet import LEFT, RIGHT
from .compound_bullet import CompoundBullet
from .contract import GEAR_DAMPING_N_S_M, GEAR_STIFFNESS_N_M
from .pose import Pose, conjugate, product, vector_from_quat

ROOT_INERTIA_KG_M2 = (1e3, 1e3, 1e3)


class FloatingBullet(CompoundBullet):
    """A PyBullet world with one object; see `crosscheck.floating.FloatingEngine`."""

    root_mass_kg = 1e3

    def begin(self, workspace_from_grasp: Pose | None, retreat: np.ndarray | None) -> None:
        """A fresh world."""
        self._force_n = np.zeros(3)
        super().begin(workspace_from_grasp, retreat)

    def _add_gripper(self, workspace_from_grasp: Pose, retreat: np.ndarray) -> None:
        super()._add_gripper(workspace_from_grasp, retreat)
        pybullet.changeDynamics(self._gripper_id, -1, localInertiaDiagonal=ROOT_INERTIA_KG_M2, physicsClientId=self.client)
        if self._environment.finger_depth_m:
            stiffness_n_m = self._environment.point_stiffness_n_m(self._gripper)
            damping_n_s_m = 2 * np.sqrt(stiffness_n_m * self._gripper.finger_mass_kg / 4)
            for finger in (LEFT, RIGHT):
                pybullet.changeDynamics(self._gripper_id, finger, contactStiffness=stiffness_n_m, contactDamping=damping_n_s_m, physicsClientId=self.client)
        self._there = workspace_from_grasp

    def place(self, workspace_from_grasp: Pose) -> None:
        """Puts the gripper's root elsewhere."""
        super().place(workspace_from_grasp)
        self._there = workspace_from_grasp

    def tie(self, asymmetry_m: float) -> None:
        """Motors as while the fingers close, whose forces are those of `press`."""
        left, right = pybullet.getJointStates(self._gripper_id, [LEFT, RIGHT], physicsClientId=self.client)
        spring = GEAR_STIFFNESS_N_M * (left[0] - right[0] - asymmetry_m) / 2
        for finger, state, sign in ((LEFT, left, 1.0), (RIGHT, right, -1.0)):
            force = self._gripper.finger_force_n - sign * spring - GEAR_DAMPING_N_S_M * state[1]
            pybullet.setJointMotorControl2(
                self._gripper_id, finger, pybullet.VELOCITY_CONTROL, force=max(force, 0.0),
                targetVelocity=self._gripper.closing_speed_m_s, physicsClientId=self.client,
            )  # fmt: skip

    def slow(self, share: float) -> None:
        """Leaves the object this share of its speed."""
        linear, angular = pybullet.getBaseVelocity(self.bodies[0], physicsClientId=self.client)
        pybullet.resetBaseVelocity(self.bodies[0], share * np.array(linear), share * np.array(angular), physicsClientId=self.client)

    def pull(self, acceleration_m_s2: np.ndarray) -> None:
        """Accelerates the object."""
        self._force_n = self._scene.objects[0].mass_kg * acceleration_m_s2

    def carry(self, workspace_from_grasp: Pose) -> None:
        """Where the gripper is to be at the end of the next step."""
        self._there = workspace_from_grasp

    def centre_m(self) -> np.ndarray:
        """The object's centre of mass."""
        return np.array(pybullet.getBasePositionAndOrientation(self.bodies[0], physicsClientId=self.client)[0])

    def step(self) -> None:
        """One step."""
        c, there = self.client, self._there
        base = pybullet.getBasePositionAndOrientation(self._gripper_id, physicsClientId=c)
        at_m, quat = (np.array(part) for part in base)
        turn_rad = vector_from_quat(product(there.quat_xyzw, conjugate(quat)))
        pybullet.resetBaseVelocity(self._gripper_id, (there.position_m - at_m) * self.step_rate_hz, turn_rad * self.step_rate_hz, physicsClientId=c)
        pybullet.applyExternalForce(self.bodies[0], -1, self._force_n, self.centre_m(), pybullet.WORLD_FRAME, physicsClientId=c)
        super().step()

    def save(self) -> int:
        """The state of everything that moves."""
        return pybullet.saveState(physicsClientId=self.client)

    def restore(self, state: int) -> None:
        """Goes back to a saved state."""
        pybullet.restoreState(state, physicsClientId=self.client)
