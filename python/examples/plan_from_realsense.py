"""Grasps from a RealSense camera, or from a frame of one that lies beside this file.

    python plan_from_realsense.py            # the recorded frame
    python plan_from_realsense.py --live     # a camera: pip install pyrealsense2

The frame was not taken by a camera: it is a simulated scene with the noise of our model of a D435 (realsense/README.md).
"""

import json
import sys
from pathlib import Path

import graspmill
import numpy as np

HERE = Path(__file__).parent / "realsense"


def recorded() -> tuple[np.ndarray, dict[str, float]]:
    """A frame as the camera gives it: 16-bit depths in units of 1 mm, and the lens."""
    return np.load(HERE / "depth.npz")["depth"], json.loads((HERE / "intrinsics.json").read_text())


def live() -> tuple[np.ndarray, dict[str, float]]:
    """A frame of the first camera that is connected."""
    import pyrealsense2 as rs

    pipeline, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
    profile = pipeline.start(config)
    for _ in range(30):  # exposure settles
        frames = pipeline.wait_for_frames()
    frame = frames.get_depth_frame()
    lens = frame.profile.as_video_stream_profile().get_intrinsics()
    scale_m = profile.get_device().first_depth_sensor().get_depth_scale()
    depth = np.asanyarray(frame.get_data()).copy()
    pipeline.stop()
    return depth, {"fx": lens.fx, "fy": lens.fy, "ppx": lens.ppx, "ppy": lens.ppy, "depth_scale_m": scale_m}


depth, lens = live() if "--live" in sys.argv else recorded()
# Where the camera is: from your calibration, such as a marker on the table. The workspace is a cube of 0.30 m whose
# floor is 50 mm below the table's top.
workspace_from_camera = np.array(json.loads((HERE / "workspace_from_camera.json").read_text()))

height, width = depth.shape
camera = graspmill.Camera(width, height, lens["fx"], lens["fy"], lens["ppx"], lens["ppy"], workspace_from_camera)
planner = graspmill.Planner(gripper="franka_hand")
plan = planner.plan(depth.astype(np.float32) * lens["depth_scale_m"], camera, check_collisions=True, approach=((0, 0, -1), 1.0))
print(plan, plan.warnings)
for grasp in plan[:3]:
    print(f"quality {grasp.quality:.3f}, opening {1e3 * grasp.width_m:.0f} mm, flange in the workspace:")
    print(np.round(grasp.workspace_from_flange, 3))
Path("plan.png").write_bytes(plan.picture("RealSense"))
