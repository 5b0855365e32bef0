"""LeRobot's SO-101 takes a box off a table: one depth image, one grasp, joint targets; in MuJoCo, then with the arm.

    git clone --depth 1 https://github.com/TheRobotStudio/SO-ARM100 # or robotstudio_so101/so101.xml of MuJoCo Menagerie
    pip install mujoco && python so101_lerobot.py SO-ARM100/Simulation/SO101/so101_new_calib.xml [--seed 1]
    pip install "lerobot[feetech]" && python so101_lerobot.py … --port /dev/ttyACM0 --id my_follower    # moves the arm

The arm goes to MuJoCo's box, unless you put the image of plan_from_realsense.py in place of depth_image(). Five joints reach
few poses: grasps are offered that they reach, and 5 cm before them, within 5 mm and 10°. Collisions of the arm are not checked.

LeRobot's zero is the middle of the ranges that you recorded (wrist_roll: where you held it), the model's that of its own. Its
model/kinematics.py takes them for the same; here you look: the arm first goes to zeros and asks. Stay near the plug: the
part with --port was written from LeRobot 0.6.2's sources and has not moved an arm yet.
"""

import sys
import time

import graspmill
import mujoco
import numpy as np
from mujoco_loop import TABLE_Z_M, depth_image, shifted
from reachable import Arm

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")  # and LeRobot's motors
BASE_M, AWAY_RAD = np.array([-0.1, 0.15, TABLE_Z_M]), np.array([1.6, 0, 0, 0, 0, 0])  # in the workspace; aside
WEIGHTS = np.array([[1.0]] * 3 + [[0.03]] * 3)  # of what is missing to a pose: a radian is as bad as 30 mm
Way = list[tuple[np.ndarray, float]]  # six joints, in radians, and the seconds to them


class Cell:
    """The arm at a table with a box of 25 by 30 by 30 mm."""

    def __init__(self, path: str, seed: int, gripper: graspmill.Gripper) -> None:
        spec, rng, kinds, quaternion = mujoco.MjSpec.from_file(path), np.random.default_rng(seed), mujoco.mjtGeom, np.empty(4)
        mujoco.mju_mat2Quat(quaternion, gripper.flange_from_grasp[:3, :3].ravel())
        spec.body("gripper").add_body(name="grasp", pos=gripper.flange_from_grasp[:3, 3], quat=quaternion)
        spec.body("base").pos, spec.option.cone, spec.option.impratio = BASE_M, mujoco.mjtCone.mjCONE_ELLIPTIC, 10
        # The force in the gripper's file is at the tip, 82 mm from the joint.
        spec.actuator("gripper").forcerange = np.array([-0.082, 0.082]) * gripper.finger_force_n
        for geom in [*spec.body("gripper").geoms, *spec.body("moving_jaw_so101_v1").geoms]:
            if geom.classname.name == "collision" and geom.type == kinds.mjGEOM_MESH:
                geom.type = kinds.mjGEOM_SDF  # SO-ARM100's: their convex hulls would fill what is between the jaws
        self.arm = Arm(spec.compile(), "grasp")
        spec.worldbody.add_geom(type=kinds.mjGEOM_BOX, pos=[0.15, 0.15, TABLE_Z_M - 0.01], size=[0.5, 0.5, 0.01])
        at_m, quaternion = BASE_M + rng.uniform((0.19, -0.12, 0.02), (0.26, 0.12, 0.02)), rng.normal(size=4) * (1, 0, 0, 1)
        box = spec.worldbody.add_body(name="box", pos=at_m, quat=quaternion)
        box.add_freejoint()
        box.add_geom(type=kinds.mjGEOM_BOX, size=[0.0125, 0.015, 0.015], density=500, friction=[1, 0.01, 0.001], condim=4)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:6] = self.data.ctrl[:6] = AWAY_RAD
        self.run([(AWAY_RAD, 1.0)])

    def run(self, way: Way) -> None:
        for end_rad, seconds in way:
            for self.data.ctrl[:6] in np.linspace(self.data.ctrl[:6].copy(), end_rad, int(seconds / self.model.opt.timestep)):
                mujoco.mj_step(self.model, self.data)

    def solve(self, pose: np.ndarray, starts_rad: list[np.ndarray]) -> np.ndarray | None:
        """The joints that put the grasp frame there, by damped least squares; None if that stays too far off."""
        for joints_rad in starts_rad:
            for _ in range(40):
                (off,), (jacobian,) = self.arm.errors(joints_rad[None], pose[None])
                rows = WEIGHTS * jacobian
                step = np.linalg.solve(rows.T @ rows + 1e-5 * np.eye(6), rows.T @ (WEIGHTS[:, 0] * off))
                if np.abs(step).max() < 1e-3:
                    break
                joints_rad = np.clip(joints_rad + np.clip(step, -0.5, 0.5), self.arm.low, self.arm.high)
            if np.linalg.norm(off[:3]) < 0.005 and np.linalg.norm(off[3:]) < np.radians(10):
                return joints_rad
        return None

    def way(self, pose: np.ndarray, open_rad: float, shut_rad: float) -> Way:
        """Zeros, but turned to the box; before the grasp, at it, shut; up by 8 cm or less. Empty if the grasp is out of reach."""
        pan_rad = -np.arctan2(*(pose[:3, 3] - BASE_M)[1::-1])
        starts = [np.array([pan_rad, 0.0, 0.3, 1.2, roll_rad, 0.0]) for roll_rad in (0.0, -1.6, 1.6)]
        found: list[np.ndarray] = []
        for offset_m in (np.zeros(3), -0.05 * pose[:3, 2], *np.outer(np.linspace(0.01, 0.08, 8), (0.0, 0.0, 1.0))):
            if (joints_rad := self.solve(shifted(pose, offset_m), found[-1:] or starts)) is None:
                break
            found.append(joints_rad)
        if len(found) < 2:
            return []
        at, before, *up = found
        way = [(np.append(joints_rad[:5], open_rad), 2.0) for joints_rad in (before * (1, 0, 0, 0, 0, 0), before, at)]
        return way + [(np.append(joints_rad[:5], shut_rad), 1.0 if joints_rad is at else 0.3) for joints_rad in (at, *up)]


def action(joints_rad: np.ndarray, low_rad: float, high_rad: float) -> dict[str, float]:
    """LeRobot's (0.6.2: so_follower.py with use_degrees, motors_bus.py): degrees; of the gripper 0, shut, to 100, wide open."""
    values = [*np.degrees(joints_rad[:5]), np.interp(joints_rad[5], (low_rad, high_rad), (0.0, 100.0))]
    return {f"{name}.pos": round(float(value), 2) for name, value in zip(JOINTS, values)}


def send(robot, way: Way, low_rad: float, high_rad: float, question: str) -> None:
    input(f"{question} ENTER goes on, Ctrl-C ends. ")
    for joints_rad, seconds in way:
        start, end = robot.get_observation(), action(joints_rad, low_rad, high_rad)
        for share in np.linspace(0.0, 1.0, int(50 * seconds)):
            robot.send_action({name: start[name] + share * (end[name] - start[name]) for name in end})
            time.sleep(0.02)


def main() -> None:
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    words, gripper = dict(zip(sys.argv[2::2], sys.argv[3::2])), graspmill.Gripper.load("so_101")
    cell = Cell(sys.argv[1], int(words.get("--seed", 1)), gripper)
    camera = graspmill.Camera.look_at((0.2, 0.4, 0.5), (0.2, 0.15, TABLE_Z_M), width_px=320, height_px=240, focal_px=360.0)
    depth, planner = depth_image(cell.model, cell.data, camera), graspmill.Planner(gripper=gripper)
    plan = planner.plan(depth, camera, accept=lambda pose: len(cell.way(pose, 0.0, 0.0)) > 0)
    if not len(plan):
        sys.exit(plan.reason)
    way = cell.way(plan[0].workspace_from_grasp, plan.answer["grasps"][0]["joint_position"], gripper.joint[1])
    limits_rad, z_m = (cell.arm.low[5], cell.arm.high[5]), cell.data.body("box").xpos[2]
    print(*(action(joints_rad, *limits_rad) for joints_rad, _ in way), sep="\n")
    cell.run([*way, (way[-1][0], 0.5)])
    up_m = cell.data.body("box").xpos[2] - z_m
    print(f"{'lifted' if up_m > 0.03 else 'not lifted'}: the box is {1e3 * up_m:.0f} mm higher")
    if "--port" in words:
        from lerobot.robots.so_follower import SO101Follower, SO101FollowerConfig

        robot = SO101Follower(SO101FollowerConfig(port=words["--port"], id=words.get("--id")))
        robot.connect()
        send(robot, way[:1], *limits_rad, "The arm will go to the model's zeros, turned to the box.")
        send(robot, way[1:], *limits_rad, "Upper arm upright, forearm level, moving jaw above? The arm will grasp.")
        send(robot, [], *limits_rad, "The arm will go limp.")
        robot.disconnect()


if __name__ == "__main__":
    main()
