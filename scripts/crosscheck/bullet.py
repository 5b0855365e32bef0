"""PyBullet as the second engine.

Several defaults must be changed to simulate the same world. Hulls are 1 mm larger than their vertices on every side (the
collision margin). Bodies are damped. A gripper that is moved by resetting its pose has no velocity and exerts no friction. With
the default 50 solver iterations, fingers sink up to a centimetre into light objects. Here hulls are
shrunk by a margin of 0.1 mm that Bullet adds again, cuboids are Bullet's boxes (two hulls share too few contact points for
a flat face to slide without tilting), damping is 0, iterations are 200, and the palm is the link of a prismatic joint
along the retreat, driven with unlimited force.

The gear between the fingers is a force on Bullet's joints, so it is integrated explicitly: light fingers with a light body
between them would oscillate at 240 Hz and drop it. For them the time step is halved until the gear is stable.
"""

from dataclasses import dataclass

import numpy as np
import pybullet

from .compound import box_of
from .contract import GEAR_DAMPING_N_S_M, GEAR_STIFFNESS_N_M, Environment, Gripper, Scene, SceneObject
from .dataset import alike
from .hull import Hull
from .pose import Pose
from .solid import Solid

PALM, LEFT, RIGHT = 0, 1, 2
# Palm and its drive: so heavy and strong that nothing it meets moves it.
PALM_MASS_KG = 10.0
PALM_FORCE_N = 1e5
TABLE_HALF_M = (1.5, 1.5, 0.5)
NO_TURN = [0.0, 0.0, 0.0, 1.0]
# How near to the limit of its stability the gear may be: fingers of 60 g, at 240 Hz, are at 0.84.
STABLE_SHARE = 0.9


@dataclass(frozen=True)
class BulletOptions:
    """Settings that may matter."""

    step_rate_hz: float = 240.0
    solver_iterations: int = 200
    margin_m: float = 1e-4


def stable_rate_hz(rate_hz: float, finger_mass_kg: float) -> float:
    """The given step rate, doubled until the gear is stable: semi-implicit Euler steps are while k dt² + 2 d dt < 4 m."""

    def load_kg(rate: float) -> float:
        return (GEAR_STIFFNESS_N_M / rate + 2 * GEAR_DAMPING_N_S_M) / (4 * rate)

    while load_kg(rate_hz) > STABLE_SHARE * finger_mass_kg:
        rate_hz *= 2
    return rate_hz


class Bullet:
    """A PyBullet world in DIRECT mode; see `crosscheck.attempt.Engine`."""

    name = "pybullet"
    # Of the gripper's root, 0 for one that is fixed.
    root_mass_kg = 0.0

    def __init__(self, options: BulletOptions = BulletOptions()):
        self.options = options
        self.step_rate_hz = options.step_rate_hz
        self.client = pybullet.connect(pybullet.DIRECT)

    def close(self) -> None:
        """Lets the world go."""
        pybullet.disconnect(physicsClientId=self.client)

    def load(self, scene: Scene, gripper: Gripper, environment: Environment) -> None:
        """Takes a scene over."""
        alike([gripper], self.name)
        self._scene, self._gripper, self._environment = scene, gripper, environment
        self.step_rate_hz = stable_rate_hz(self.options.step_rate_hz, gripper.finger_mass_kg)
        self._centroids = [o.solid.centroid_m for o in scene.objects]

    def begin(self, workspace_from_grasp: Pose | None, retreat: np.ndarray | None) -> None:
        """A fresh world, built from the stored rows; without a gripper if there is no pose."""
        c = self.client
        pybullet.resetSimulation(physicsClientId=c)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=1 / self.step_rate_hz, numSolverIterations=self.options.solver_iterations, physicsClientId=c)
        pybullet.setGravity(0, 0, -self._environment.gravity_m_s2, physicsClientId=c)
        self._table = self._add_table()
        self._fixtures = [self._add_fixture(part) for part in self._scene.fixtures]
        self.bodies = [self._add_object(one) for one in self._scene.objects]
        self._gripper_id = None
        if workspace_from_grasp is not None:
            self._add_gripper(workspace_from_grasp, retreat)

    def _add_table(self) -> int:
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=TABLE_HALF_M, physicsClientId=self.client)
        centre = [0, 0, self._environment.table_z_m - TABLE_HALF_M[2]]
        table = pybullet.createMultiBody(0, shape, basePosition=centre, physicsClientId=self.client)
        self._surface(table, -1, self._environment.table_friction)
        return table

    def _add_fixture(self, part: Hull) -> int:
        shape, at = self._part(part)
        fixture = pybullet.createMultiBody(0, shape, basePosition=at.position_m, baseOrientation=at.quat_xyzw, physicsClientId=self.client)
        self._surface(fixture, -1, self._environment.table_friction)
        return fixture

    def _part(self, part: Hull) -> tuple[int, Pose]:
        """A part's shape, and the frame that it is in: Bullet's box for a cuboid, else a hull, as for solids."""
        c, margin = self.client, self.options.margin_m
        box = box_of(part)
        if box:
            at, half = box
            shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=c)
        else:
            at = Pose(part.centroid_m, np.array(NO_TURN))
            corners = part.shrunk(margin) - at.position_m
            shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=corners.tolist(), physicsClientId=c)
        # Only of a base can the margin be changed; bodies share their shapes.
        carrier = pybullet.createMultiBody(0, shape, physicsClientId=c)
        pybullet.changeDynamics(carrier, -1, collisionMargin=margin, physicsClientId=c)
        pybullet.removeBody(carrier, physicsClientId=c)
        return shape, at

    def _surface(self, body: int, link: int, friction: float, **more: object) -> None:
        pybullet.changeDynamics(
            body, link, lateralFriction=friction, rollingFriction=0, spinningFriction=0, restitution=0,
            linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=self.client, **more,
        )  # fmt: skip

    def _add_object(self, scene_object: SceneObject) -> int:
        c, solid, pose = self.client, scene_object.solid, scene_object.workspace_from_object
        hull = self._shape(solid)
        body = pybullet.createMultiBody(
            scene_object.mass_kg, hull, basePosition=pose.apply(solid.centroid_m), baseOrientation=pose.quat_xyzw,
            physicsClientId=c,
        )  # fmt: skip
        inertia = solid.inertia_kg_m2(scene_object.mass_kg)
        self._surface(body, -1, scene_object.friction, collisionMargin=self.options.margin_m, localInertiaDiagonal=inertia)
        return body

    def _shape(self, solid: Solid) -> int:
        """Bullet's box for a cuboid, else the hull of the solid's corners, shrunk by the margin that Bullet adds."""
        if solid.kind == "cuboid":
            half = np.array(solid.extents_m) / 2
            return pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        corners = solid.shrunk(self.options.margin_m) - solid.centroid_m
        return pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=corners.tolist(), physicsClientId=self.client)

    def _add_gripper(self, workspace_from_grasp: Pose, retreat: np.ndarray) -> None:
        c, gripper, pose = self.client, self._gripper, workspace_from_grasp
        boxes = [gripper.palm(), *gripper.fingers(gripper.opening_m_max)]
        shapes = [pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=box.half_m, physicsClientId=c) for box in boxes]
        centres = [box.centre_m for box in boxes]
        # Link frames sit at the boxes' centres; the fingers' are given from the palm's.
        frames = [centres[0], centres[1] - centres[0], centres[2] - centres[0]]
        self._gripper_id = pybullet.createMultiBody(
            self.root_mass_kg, basePosition=pose.position_m, baseOrientation=pose.quat_xyzw,
            linkMasses=[PALM_MASS_KG, gripper.finger_mass_kg, gripper.finger_mass_kg],
            linkCollisionShapeIndices=shapes, linkVisualShapeIndices=[-1] * 3,
            linkPositions=frames, linkOrientations=[NO_TURN] * 3,
            linkInertialFramePositions=[[0, 0, 0]] * 3, linkInertialFrameOrientations=[NO_TURN] * 3,
            linkParentIndices=[0, 1, 1], linkJointTypes=[pybullet.JOINT_PRISMATIC] * 3,
            linkJointAxis=[pose.rotation.T @ retreat, [0, 1, 0], [0, -1, 0]], physicsClientId=c,
        )  # fmt: skip
        self._surface(self._gripper_id, PALM, gripper.friction)
        for finger in (LEFT, RIGHT):
            self._surface(self._gripper_id, finger, gripper.friction, jointLowerLimit=0.0, jointUpperLimit=gripper.opening_m_max / 2)
        # The gripper is held by a robot that makes up for the fingers' weight.
        self._lift = (pose.rotation.T @ [0, 0, gripper.finger_mass_kg * self._environment.gravity_m_s2]).tolist()
        self._drive_palm(0.0)
        self._drive_fingers(gripper.closing_speed_m_s, gripper.finger_force_n)

    def _drive_palm(self, velocity_m_s: float) -> None:
        pybullet.setJointMotorControl2(
            self._gripper_id, PALM, pybullet.VELOCITY_CONTROL, targetVelocity=velocity_m_s, force=PALM_FORCE_N,
            physicsClientId=self.client,
        )  # fmt: skip

    def _drive_fingers(self, velocity_m_s: float, force_n: float) -> None:
        for finger in (LEFT, RIGHT):
            pybullet.setJointMotorControl2(
                self._gripper_id, finger, pybullet.VELOCITY_CONTROL, targetVelocity=velocity_m_s, force=force_n,
                physicsClientId=self.client,
            )  # fmt: skip

    def place(self, workspace_from_grasp: Pose) -> None:
        """Puts the gripper's root elsewhere."""
        pybullet.resetBasePositionAndOrientation(self._gripper_id, workspace_from_grasp.position_m, workspace_from_grasp.quat_xyzw, physicsClientId=self.client)

    def hold_open(self, is_open: bool) -> None:
        """Fingers stand still, or close."""
        self._drive_fingers(0.0 if is_open else self._gripper.closing_speed_m_s, self._gripper.finger_force_n)

    def step(self) -> None:
        """One step."""
        if self._gripper_id is not None:
            for finger in (LEFT, RIGHT):
                pybullet.applyExternalForce(self._gripper_id, finger, self._lift, [0, 0, 0], pybullet.LINK_FRAME, physicsClientId=self.client)
        pybullet.stepSimulation(physicsClientId=self.client)

    def closed_m(self) -> tuple[float, float]:
        """How far the fingers have closed."""
        left, right = pybullet.getJointStates(self._gripper_id, [LEFT, RIGHT], physicsClientId=self.client)
        return left[0], right[0]

    def press(self, asymmetry_at_contact_m: float) -> None:
        """Finger force, gear spring and damper, as forces on the joints."""
        left, right = pybullet.getJointStates(self._gripper_id, [LEFT, RIGHT], physicsClientId=self.client)
        spring = GEAR_STIFFNESS_N_M * (left[0] - right[0] - asymmetry_at_contact_m) / 2
        for finger, state, sign in ((LEFT, left, 1.0), (RIGHT, right, -1.0)):
            force = self._gripper.finger_force_n - sign * spring - GEAR_DAMPING_N_S_M * state[1]
            pybullet.setJointMotorControl2(self._gripper_id, finger, pybullet.VELOCITY_CONTROL, force=0, physicsClientId=self.client)
            pybullet.setJointMotorControl2(self._gripper_id, finger, pybullet.TORQUE_CONTROL, force=force, physicsClientId=self.client)

    def move_to(self, distance_m: float) -> None:
        """The speed that brings the palm there in one step."""
        now = pybullet.getJointState(self._gripper_id, PALM, physicsClientId=self.client)[0]
        self._drive_palm((distance_m - now) * self.step_rate_hz)

    def positions_m(self) -> np.ndarray:
        """Origins of the objects' frames (n, 3)."""
        poses = [self._pose(body) for body in self.bodies]
        return np.stack([pose.apply(-centroid) for pose, centroid in zip(poses, self._centroids)])

    def quats_xyzw(self) -> np.ndarray:
        """Orientations of the objects (n, 4)."""
        return np.stack([self._pose(body).quat_xyzw for body in self.bodies])

    def _pose(self, body: int) -> Pose:
        position, quat = pybullet.getBasePositionAndOrientation(body, physicsClientId=self.client)
        return Pose(np.array(position), np.array(quat))

    def grips(self, target: int) -> bool:
        """Whether both fingers press on an object."""
        body = self.bodies[target]
        return all(
            any(point[9] > 0 for point in pybullet.getContactPoints(body, self._gripper_id, linkIndexB=finger, physicsClientId=self.client))
            for finger in (LEFT, RIGHT)
        )  # fmt: skip

    def nearest(self, target: int, reach_m: float) -> str | None:
        """What the gripper comes nearer to than `reach_m`, by Bullet's own distance query."""
        others = [body for i, body in enumerate(self.bodies) if i != target]
        things = {"target": [self.bodies[target]], "other": others, "container": self._fixtures, "table": [self._table]}
        for name, bodies in things.items():
            for body in bodies:
                points = pybullet.getClosestPoints(self._gripper_id, body, reach_m, physicsClientId=self.client)
                if any(point[8] <= reach_m for point in points):
                    return name
        return None
