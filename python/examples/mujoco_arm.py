"""Clears a table in MuJoCo with a Franka arm of MuJoCo Menagerie: plans what the arm reaches, moves it there, grasps and lifts.

    git clone --depth 1 https://github.com/google-deepmind/mujoco_menagerie
    pip install mujoco && python mujoco_arm.py mujoco_menagerie/franka_emika_panda/panda.xml [SEED]

The gripper's frame comes from the model (graspmill.descriptions), the planner's gripper is `franka_hand`, the arm's
kinematics are those of reachable.py. Ways between the poses are straight in the joints, and not checked against
collisions.
"""

import sys

import graspmill
import mujoco
import numpy as np
from graspmill.descriptions import from_description
from mujoco_loop import OBJECTS, TABLE_Z_M, depth_image, shifted
from reachable import Arm

BASE_M, OPEN, SHUT = (-0.4, 0.15, TABLE_Z_M), 255.0, 0.0
FINGERS = ("left_finger", "right_finger")


def scene(path: str, seed: int) -> tuple[mujoco.MjModel, mujoco.MjModel, np.ndarray]:
    """The arm at a table with boxes and cylinders, the arm alone, both with their base at its place; and its home."""
    alone, both = (mujoco.MjSpec.from_file(path) for _ in range(2))
    home = np.array(both.keys[0].qpos)
    for spec in (alone, both):
        spec.body("link0").pos = BASE_M
        for key in list(spec.keys):
            spec.delete(key)
    rng, kinds = np.random.default_rng(seed), mujoco.mjtGeom
    both.worldbody.add_geom(type=kinds.mjGEOM_BOX, pos=[0.25, 0.15, TABLE_Z_M - 0.01], size=[0.5, 0.5, 0.01])
    for number in range(OBJECTS):
        thing = both.worldbody.add_body(name=f"thing{number}", pos=[0.09 + 0.12 * (number % 2), 0.09 + 0.12 * (number // 2), 0.1])
        thing.add_freejoint()
        kind, size = (kinds.mjGEOM_BOX, 3) if number % 2 else (kinds.mjGEOM_CYLINDER, 2)
        thing.add_geom(type=kind, size=[*rng.uniform(0.015, 0.03, size), 0.0][:3], density=500, friction=[1, 0.01, 0.001], condim=4)
    return both.compile(), alone.compile(), home


class Cell:
    """The simulated arm: where its joints go, and the gripper."""

    def __init__(self, path: str, seed: int) -> None:
        self.model, alone, self.home = scene(path, seed)
        self.data, self.arm = mujoco.MjData(self.model), Arm(alone, "hand")
        self.joints = len(self.home) - 2  # without the fingers
        self.data.qpos[: len(self.home)] = self.home
        gripper = from_description(path, FINGERS, flange="hand")
        assert gripper.flange_from_grasp is not None
        self.grasp_from_flange = np.linalg.inv(gripper.flange_from_grasp)
        self.run(self.home, self.home, OPEN, 1.0)

    def run(self, start: np.ndarray, end: np.ndarray, fingers: float, seconds: float) -> None:
        """From joints to joints, with the fingers' actuator so."""
        steps = int(seconds / self.model.opt.timestep)
        for step in range(steps):
            share = (step + 1) / steps
            self.data.ctrl[: self.joints] = (start + (end - start) * share)[: self.joints]
            self.data.ctrl[self.joints] = fingers
            mujoco.mj_step(self.model, self.data)

    def straight(self, start: np.ndarray, poses: list[np.ndarray], fingers: float) -> np.ndarray:
        """Along poses of the grasp that are near to each other; the last joints."""
        for pose in poses:
            (end,) = self.arm.solve(pose[None] @ self.grasp_from_flange, start, starts=1)
            if np.isnan(end).any():
                break
            self.run(start, end, fingers, 0.1)
            start = end
        return start

    def reachable(self, workspace_from_grasp: np.ndarray) -> np.ndarray:
        """Whether the arm gets to where the gripper approaches from, and to the grasp."""
        before = workspace_from_grasp.copy()
        before[:, :3, 3] -= 0.08 * before[:, :3, 2]
        there, here = (self.arm.reaches(poses @ self.grasp_from_flange) for poses in (before, workspace_from_grasp))
        return there & here

    def grasp(self, pose: np.ndarray) -> list[int]:
        """Grasps and lifts; which things came along."""
        ways = [shifted(pose, -back * pose[:3, 2]) for back in np.linspace(0.08, 0.0, 9)]
        (before,) = self.arm.solve(ways[0][None] @ self.grasp_from_flange, self.home)
        self.run(self.home, before, OPEN, 1.5)
        self.run(before, before, OPEN, 0.5)
        at = self.straight(before, ways[1:], OPEN)
        self.run(at, at, SHUT, 1.0)
        heights = self.heights()
        at = self.straight(at, [shifted(pose, np.array([0.0, 0.0, up])) for up in np.linspace(0.01, 0.15, 15)], SHUT)
        self.run(at, at, SHUT, 0.5)
        lifted = [number for number in range(OBJECTS) if self.heights()[number] > heights[number] + 0.1]
        for number in lifted:  # put aside
            first = self.model.joint(self.model.body(f"thing{number}").jntadr[0]).qposadr[0]
            self.data.qpos[first : first + 3] = 2.0 + number, 0.0, 0.5
        self.run(at, self.home, OPEN, 1.5)
        return lifted

    def heights(self) -> list[float]:
        return [float(self.data.body(f"thing{number}").xpos[2]) for number in range(OBJECTS)]


def main() -> int:
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    cell = Cell(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    camera = graspmill.Camera.look_at((0.15, 0.6, 0.5), width_px=320, height_px=240, focal_px=270.0)
    planner, left, failed, held = graspmill.Planner(gripper="franka_hand"), set(range(OBJECTS)), [], 0
    for attempt in range(2 * OBJECTS):
        depth = depth_image(cell.model, cell.data, camera)
        plan = planner.plan(depth, camera, avoid=failed, accept_batch=cell.reachable, reach=((-0.05, -0.05, 0.0), (0.35, 0.35, 0.4)))
        if not left or not len(plan):
            break
        lifted = cell.grasp(plan[0].workspace_from_grasp)
        print(f"attempt {attempt + 1}: quality {plan[0].quality:.3f}, lifted {lifted or 'nothing'}")
        left -= set(lifted)
        held += bool(lifted)
        failed = [] if lifted else [*failed, plan[0].workspace_from_grasp]
    print(f"{held} grasps held, {len(left)} of {OBJECTS} objects left")
    return len(left)


if __name__ == "__main__" and main():
    sys.exit("not all were lifted")
