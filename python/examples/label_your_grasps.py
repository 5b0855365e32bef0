"""Physics labels for grasps of your own sampler.

    python label_your_grasps.py

The sampler here draws grasps from above at random. Replace it with yours, which must return poses [N, 4, 4].
"""

import time

import graspmill
import numpy as np


def sampler(count: int, seed: int) -> np.ndarray:
    """Grasps from above, anywhere over the table, turned at random about the vertical."""
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(0.0, np.pi, count)
    poses = np.zeros((count, 4, 4))
    poses[:, 0, 0], poses[:, 0, 1] = np.cos(yaw), np.sin(yaw)
    poses[:, 1, 0], poses[:, 1, 1] = np.sin(yaw), -np.cos(yaw)
    poses[:, 2, 2] = -1.0
    poses[:, :3, 3] = rng.uniform([0.05, 0.05, 0.055], [0.25, 0.25, 0.12], (count, 3))
    poses[:, 3, 3] = 1.0
    return poses


def at(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


scene = graspmill.Scene(
    [
        graspmill.Object.cuboid((0.05, 0.04, 0.08), at(0.10, 0.12, 0.20)),
        graspmill.Object.solid("cylinder", (0.05, 0.05, 0.06), at(0.20, 0.18, 0.20)),
        graspmill.Object.solid("half_cylinder", (0.09, 0.05, 0.025), at(0.15, 0.15, 0.20)),
    ]
).settle(drop=True)
print(scene)

grasps = sampler(20_000, seed=1)
for gripper in ("parallel_jaw_80", "franka_hand", "robotiq_2f_85"):
    began = time.perf_counter()
    outcomes = graspmill.execute(scene, grasps, gripper=gripper)
    print(f"{gripper}: {outcomes} at {len(grasps) / (time.perf_counter() - began):,.0f}/s")

# What of the held ones is best centred, say: outcomes are arrays like the grasps.
held = grasps[outcomes.held]
print("held:", held.shape, "openings:", np.round(outcomes.width_m[outcomes.held][:5], 4))
