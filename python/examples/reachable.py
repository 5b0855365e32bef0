"""Plans only grasps that an arm reaches: inverse kinematics of all candidates at once, from the arm's URDF.

    pip install mujoco && python reachable.py [ARM.urdf LINK]

MuJoCo reads the URDF and knows joints, limits and Jacobians; the rest is damped least squares in NumPy, for all grasps together. Any
solver of your own takes its place: `accept_batch` gets matrices [N, 4, 4] and returns [N] bool. Without a file the arm is the one below,
with the lengths of a Universal Robots UR5e. Collisions of the arm are not looked at.
"""

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import graspmill
import mujoco
import numpy as np

#: Where the arm stands, beside the table, with its x towards it; and where the gripper's tips are in its last link.
WORKSPACE_FROM_BASE = np.eye(4)
WORKSPACE_FROM_BASE[:3, 3] = -0.6, 0.15, 0.05
OFF_M_MAX, OFF_RAD_MAX = 0.002, 0.02


def joint(name: str, parent: str, child: str, xyz: str, rpy: str, axis: str = "0 0 1") -> str:
    return f"""<link name="{child}"/><joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
        <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="-3.1416" upper="3.1416"/></joint>"""


ARM = f"""<robot name="arm"><link name="base"/>
{joint("pan", "base", "shoulder", "0 0 0.1625", "0 0 0")}
{joint("lift", "shoulder", "upper", "0 0 0", "1.5708 0 0")}
{joint("elbow", "upper", "forearm", "-0.425 0 0", "0 0 0")}
{joint("wrist1", "forearm", "wrist1", "-0.3922 0 0.1333", "0 0 0")}
{joint("wrist2", "wrist1", "wrist2", "0 -0.0997 0", "1.5708 0 0")}
{joint("wrist3", "wrist2", "flange", "0 0.0996 0", "-1.5708 0 0")}</robot>"""


class Arm:
    """Finds joints for poses of a link, within the joints' limits."""

    def __init__(self, model: mujoco.MjModel, link: str) -> None:
        self.model, self.data, self.body = model, mujoco.MjData(model), model.body(link).id
        limits = model.jnt_range.copy()
        limits[model.jnt_limited == 0] = -np.pi, np.pi
        self.low, self.high = limits.T

    @classmethod
    def from_urdf(cls, urdf: str, link: str) -> "Arm":
        robot = ET.fromstring(urdf)
        for part in robot.findall("link"):  # its shapes are not needed, nor the files of their meshes
            for shape in [*part.findall("visual"), *part.findall("collision"), *part.findall("inertial")]:
                part.remove(shape)
        for old in robot.findall("mujoco"):
            robot.remove(old)
        options = ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler")
        options.attrib |= {"fusestatic": "false", "boundmass": "1", "boundinertia": "1"}
        return cls(mujoco.MjModel.from_xml_string(ET.tostring(robot, encoding="unicode")), link)

    def reaches(self, base_from_link: np.ndarray) -> np.ndarray:
        """Whether the joints can put the link at these poses, [N, 4, 4] -> [N] bool."""
        return np.isfinite(self.solve(base_from_link)).all(axis=1)

    def solve(self, base_from_link: np.ndarray, start: np.ndarray | None = None, starts: int = 20, steps: int = 40) -> np.ndarray:
        """The joints that put the link at these poses, [N, 4, 4] -> [N, joints]; NaN where none were found. They are sought from a
        start, if there is one, then from random joints."""
        found, rng = np.full((len(base_from_link), self.model.nq), np.nan), np.random.default_rng(0)
        for attempt in range(starts):
            left = np.flatnonzero(np.isnan(found[:, 0]))
            # The same start for all, so that what is found for one pose does not depend on the others.
            joints = np.tile(rng.uniform(self.low, self.high), (len(left), 1))
            if start is not None and not attempt:
                joints[:] = start
            for _ in range(steps):
                if not len(left):
                    break
                off, jacobian = self.errors(joints, base_from_link[left])
                done = (np.linalg.norm(off[:, :3], axis=1) < OFF_M_MAX) & (np.linalg.norm(off[:, 3:], axis=1) < OFF_RAD_MAX)
                found[left[done]] = joints[done]
                left, joints, off, jacobian = left[~done], joints[~done], off[~done], jacobian[~done]
                damped = jacobian @ jacobian.transpose(0, 2, 1) + 1e-4 * np.eye(6)
                step = (jacobian.transpose(0, 2, 1) @ np.linalg.solve(damped, off[:, :, None]))[:, :, 0]
                joints = np.clip(joints + np.clip(step, -0.5, 0.5), self.low, self.high)
        return found

    def errors(self, joints: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is missing to the poses, [N, 6] in metres and radians, and the Jacobians, [N, 6, joints]."""
        off, jacobian = np.empty((len(joints), 6)), np.empty((len(joints), 6, self.model.nv))
        for row, (angles, pose) in enumerate(zip(joints, poses)):
            self.data.qpos[:] = angles
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_jacBody(self.model, self.data, jacobian[row, :3], jacobian[row, 3:], self.body)
            off[row, :3] = pose[:3, 3] - self.data.xpos[self.body]
            turn = pose[:3, :3] @ self.data.xmat[self.body].reshape(3, 3).T
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, turn.ravel())
            mujoco.mju_quat2Vel(off[row, 3:], quaternion, 1.0)
        return off, jacobian


def main() -> None:
    urdf, link = (Path(sys.argv[1]).read_text(), sys.argv[2]) if len(sys.argv) > 2 else (ARM, "flange")
    arm, gripper = Arm.from_urdf(urdf, link), graspmill.Gripper.load("franka_hand")
    assert gripper.flange_from_grasp is not None
    grasp_from_flange = np.linalg.inv(gripper.flange_from_grasp)
    base_from_workspace = np.linalg.inv(WORKSPACE_FROM_BASE)

    def reachable(workspace_from_grasp: np.ndarray) -> np.ndarray:
        before = workspace_from_grasp.copy()  # the arm must also get to where the gripper approaches from
        before[:, :3, 3] -= 0.05 * before[:, :3, 2]
        there, here = (arm.reaches(base_from_workspace @ poses @ grasp_from_flange) for poses in (workspace_from_grasp, before))
        asked.append((len(there), int((there & here).sum())))
        return there & here

    asked: list[tuple[int, int]] = []
    boxes = [((0.04, 0.06, 0.05), (0.05, 0.15, 0.075)), ((0.03, 0.03, 0.10), (0.15, 0.22, 0.10)), ((0.05, 0.04, 0.04), (0.25, 0.15, 0.07))]
    scene = graspmill.Scene([graspmill.Object.cuboid(extents, (*at, 0, 0, 0, 1)) for extents, at in boxes])
    camera = graspmill.Camera.look_at((0.15, -0.2, 0.5))
    planner = graspmill.Planner(gripper=gripper)
    plan = planner.plan(scene.render(camera), camera, accept_batch=reachable, base_from_workspace=base_from_workspace)
    print(f"asked {len(asked)} times, about {sum(count for count, _ in asked)} grasps; {sum(count for _, count in asked)} are in reach")
    print(plan)
    flanges = np.stack([grasp.base_from_flange for grasp in plan if grasp.base_from_flange is not None])
    print(f"{arm.reaches(flanges).sum()} of {len(plan)} grasps are in reach of the arm")


if __name__ == "__main__":
    main()
