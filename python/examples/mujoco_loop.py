"""Clears a table in MuJoCo: its scene, its depth to our planner, its physics moves the gripper.

    pip install mujoco && python mujoco_loop.py [SEED]

Nothing here knows our simulator: the planner sees a depth image, and the gripper is a MuJoCo model with
the dimensions of parallel_jaw_80.
"""

import sys

import graspmill
import mujoco
import numpy as np

TABLE_Z_M, OBJECTS = 0.05, 4
# In the grasp frame: z approach, y closing, origin between the tips (configs/grippers/parallel_jaw_80.toml).
GRIPPER = """
<body name="hand" pos="0.15 0.9 0.6" quat="0 1 0 0" gravcomp="1">
  <freejoint name="hand"/>
  <geom type="box" pos="0 0 -0.07" size="0.02 0.06 0.02" mass="0.5"/>
  <body name="left" gravcomp="1"><joint name="left" type="slide" axis="0 1 0" range="0 0.04" damping="20"/>
    <geom type="box" pos="0 -0.045 -0.025" size="0.01 0.005 0.025" mass="0.1" friction="1 0.01 0.001" condim="4"/></body>
  <body name="right" gravcomp="1"><joint name="right" type="slide" axis="0 -1 0" range="0 0.04" damping="20"/>
    <geom type="box" pos="0 0.045 -0.025" size="0.01 0.005 0.025" mass="0.1" friction="1 0.01 0.001" condim="4"/></body>
</body>
<body name="aim" mocap="true" pos="0.15 0.9 0.6" quat="0 1 0 0"/>
"""


def model(seed: int) -> mujoco.MjModel:
    """A table, boxes and cylinders that will fall on it, and the gripper, which is welded to a point that is moved."""
    rng = np.random.default_rng(seed)
    things = ""
    for number in range(OBJECTS):
        x, y = 0.09 + 0.12 * (number % 2), 0.09 + 0.12 * (number // 2)
        kind, size = (("box", rng.uniform(0.015, 0.03, 3)) if number % 2 else ("cylinder", rng.uniform(0.015, 0.03, 2)))
        text = " ".join(f"{part:.4f}" for part in size)
        things += f'<body name="thing{number}" pos="{x} {y} 0.12"><freejoint/>'
        things += f'<geom type="{kind}" size="{text}" density="500" friction="1 0.01 0.001" condim="4"/></body>'
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.002" cone="elliptic" impratio="10"/>
        <worldbody><geom type="box" pos="0.15 0.15 {TABLE_Z_M - 0.01}" size="0.5 0.5 0.01"/>{things}{GRIPPER}</worldbody>
        <equality><weld body1="aim" body2="hand" solref="0.01 1"/></equality>
        <actuator><motor joint="left" ctrlrange="-20 20"/><motor joint="right" ctrlrange="-20 20"/></actuator></mujoco>"""
    )


def depth_image(m: mujoco.MjModel, d: mujoco.MjData, camera: graspmill.Camera) -> np.ndarray:
    """The camera's depth image, ray by ray, so that no graphics are needed."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    rays = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones(u.shape)], axis=-1)
    pose = camera.workspace_from_camera
    rays = rays.reshape(-1, 3) @ pose[:3, :3].T
    hit, distance = np.empty(len(rays), np.int32), np.empty(len(rays))
    mujoco.mj_multiRay(m, d, pose[:3, 3], rays.reshape(-1), None, True, -1, hit, distance, None, len(rays), 10.0)
    # Rays are as long as their z is 1, so a distance in rays is a depth in metres.
    return np.where(hit >= 0, distance, 0.0).reshape(u.shape)


def move(m: mujoco.MjModel, d: mujoco.MjData, start: np.ndarray, end: np.ndarray, seconds: float, force_n: float) -> None:
    """Moves the gripper in a straight line, its fingers pressing with a force (negative opens)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, start[:3, :3].ravel())
    steps = int(seconds / m.opt.timestep)
    for step in range(steps):
        d.mocap_pos[0] = start[:3, 3] + (end[:3, 3] - start[:3, 3]) * (step + 1) / steps
        d.mocap_quat[0] = quaternion
        d.ctrl[:] = force_n
        mujoco.mj_step(m, d)


def put(m: mujoco.MjModel, d: mujoco.MjData, pose: np.ndarray) -> None:
    """Puts the open gripper somewhere at once."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, pose[:3, :3].ravel())
    at = m.joint("hand").qposadr[0]
    d.qpos[at : at + 3], d.qpos[at + 3 : at + 7] = pose[:3, 3], quaternion
    d.joint("left").qpos[0] = d.joint("right").qpos[0] = 0.0
    d.qvel[m.joint("hand").dofadr[0] :] = 0.0
    d.mocap_pos[0], d.mocap_quat[0] = pose[:3, 3], quaternion
    mujoco.mj_forward(m, d)


def shifted(pose: np.ndarray, offset_m: np.ndarray) -> np.ndarray:
    moved = pose.copy()
    moved[:3, 3] += offset_m
    return moved


def main() -> int:
    m = model(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
    d = mujoco.MjData(m)
    park = np.diag([1.0, -1.0, -1.0, 1.0])
    park[:3, 3] = 0.15, 0.9, 0.6
    for _ in range(500):
        mujoco.mj_step(m, d)
    camera = graspmill.Camera.look_at((0.15, -0.2, 0.5), width_px=320, height_px=240, focal_px=270.0)
    planner, left, held, failed = graspmill.Planner(), set(range(OBJECTS)), 0, []
    for attempt in range(2 * OBJECTS):
        plan = planner.plan(depth_image(m, d, camera), camera, avoid=failed)
        if not left or not len(plan):
            break
        grasp = plan[0].workspace_from_grasp
        back = shifted(grasp, -0.05 * grasp[:3, 2])
        put(m, d, back)
        move(m, d, back, grasp, 0.5, -5.0)
        move(m, d, grasp, grasp, 0.5, 10.0)
        before = {number: d.body(f"thing{number}").xpos[2] for number in left}
        up = shifted(grasp, np.array([0.0, 0.0, 0.15]))
        move(m, d, grasp, up, 1.0, 10.0)
        move(m, d, up, up, 0.3, 10.0)
        lifted = [number for number in left if d.body(f"thing{number}").xpos[2] > before[number] + 0.1]
        print(f"attempt {attempt + 1}: quality {plan[0].quality:.3f}, lifted {lifted or 'nothing'}")
        put(m, d, park)
        for number in lifted:  # put aside
            at = m.joint(m.body(f"thing{number}").jntadr[0]).qposadr[0]
            d.qpos[at : at + 3] = 2.0 + number, 0.0, 0.5
            left.discard(number)
        held += bool(lifted)
        failed = [] if lifted else [*failed, grasp]
        move(m, d, park, park, 0.5, -5.0)
    print(f"{held} grasps held, {len(left)} of {OBJECTS} objects left")
    return len(left)


if __name__ == "__main__" and main():
    sys.exit("not all were lifted")
