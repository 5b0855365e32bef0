"""MuJoCo for a floating object: the gripper's root is free, and its pose and speed are written in every step."""

import mujoco
import numpy as np

from .contract import Environment, Gripper, Scene
from .mujoco_engine import PALM_MASS_KG, Mujoco
from .pose import Pose, conjugate, product, vector_from_quat

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
# The time constant of the springs between elastic fingers and an object.
SOFT_TIME_S = 1 / 240


class FloatingMujoco(Mujoco):
    """A MuJoCo world with one object; see `crosscheck.floating.FloatingEngine`."""

    def load(self, scene: Scene, gripper: Gripper, environment: Environment) -> None:
        """Compiles a scene and a gripper, whose fingers sink in as deep as the environment says."""
        super().load(scene, gripper, environment)
        if environment.finger_depth_m:
            # Of a spring (t, 1) with the impedance d the stiffness is 1 / ((1 - d) A t²), where A is the sum of the
            # bodies' inverse masses as the model has them.
            model, stiffness_n_m = self._model, environment.point_stiffness_n_m(gripper)
            for finger in self._finger_geoms:
                own = model.geom_bodyid[[self._geoms[0][0], finger[0]]]
                soft = 1 / (stiffness_n_m * model.body_invweight0[own, 0].sum() * SOFT_TIME_S**2)
                pairs = np.isin(model.pair_geom1, finger) | np.isin(model.pair_geom2, finger)
                model.pair_solref[pairs, 0] = SOFT_TIME_S
                model.pair_solimp[pairs, :2] = np.clip(1 - soft, 0.1, 0.9999)

    def _compiled(self, xml: str) -> mujoco.MjModel:
        spec = mujoco.MjSpec.from_string(xml)
        root = spec.body("root")
        root.mass, root.inertia, root.explicitinertial = PALM_MASS_KG, [PALM_MASS_KG] * 3, True
        root.add_freejoint(name="root")
        model = spec.compile()
        self._root = slice(*(model.joint("root").qposadr[0] + np.array([0, 7])))
        self._root_speed = slice(*(model.joint("root").dofadr[0] + np.array([0, 6])))
        self._mass_kg = model.body("object0").mass[0]
        return model

    def place(self, workspace_from_grasp: Pose) -> None:
        """Moves the gripper's root."""
        self._there = workspace_from_grasp
        self._data.qvel[self._root_speed] = 0
        self._put()
        mujoco.mj_kinematics(self._model, self._data)

    def _put(self) -> None:
        there = self._there
        self._data.qpos[self._root] = [*there.position_m, there.quat_xyzw[3], *there.quat_xyzw[:3]]

    def tie(self, asymmetry_m: float) -> None:
        """Finger force less what the fingers' speed takes, as while they close, and gear spring."""
        force = self._gripper.finger_force_n
        self._actuate(self._forces_n(asymmetry_m), force / self._gripper.closing_speed_m_s, 100 * force)

    def pull(self, acceleration_m_s2: np.ndarray) -> None:
        """Accelerates the object."""
        self._data.xfrc_applied[self._bodies[0], :3] = self._mass_kg * acceleration_m_s2

    def slow(self, share: float) -> None:
        """Leaves the object this share of its speed."""
        first = self._model.body_dofadr[self._bodies[0]]
        self._data.qvel[first : first + 6] *= share

    def carry(self, workspace_from_grasp: Pose) -> None:
        """Where the gripper is to be at the end of the next step."""
        self._there = workspace_from_grasp

    def centre_m(self) -> np.ndarray:
        """The object's centre of mass."""
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xipos[self._bodies[0]].copy()

    def step(self) -> None:
        """One step; the gripper ends at its commanded pose."""
        now, there, rate = self._data.qpos[self._root], self._there, self.step_rate_hz
        # Of a free joint the way is the workspace's, the turn the body's own.
        way_m = there.position_m - now[:3]
        turn_rad = vector_from_quat(product(conjugate(now[[4, 5, 6, 3]]), there.quat_xyzw))
        self._data.qvel[self._root_speed] = np.concatenate([way_m, turn_rad]) * rate
        super().step()
        self._put()

    def save(self) -> np.ndarray:
        """The state of everything that moves."""
        state = np.empty(mujoco.mj_stateSize(self._model, STATE))
        mujoco.mj_getState(self._model, self._data, state, STATE)
        return state

    def restore(self, state: np.ndarray) -> None:
        """Goes back to a saved state."""
        mujoco.mj_setState(self._model, self._data, state, STATE)
        mujoco.mj_kinematics(self._model, self._data)
