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
depth_m = depth.astype(np.float32) * lens["depth_scale_m"]
K = [[lens["fx"], 0, lens["ppx"]], [0, lens["fy"], lens["ppy"]], [0, 0, 1]]
planner = graspmill.Planner(gripper="franka_hand")

# A depth image and its lens are enough: the table is found, and grasps are in the camera's frame.
plan = planner.plan(depth_m, graspmill.Camera.from_K(K, depth.shape))
print(plan, plan.warnings)
for grasp in plan[:3]:
    print(f"quality {grasp.quality:.3f}, open to {1e3 * grasp.opening_m:.0f} mm, in the camera's frame:")
    print(np.round(grasp.camera_from_grasp, 3))
Path("overlay.png").write_bytes(plan.overlay())

# Where the camera is: from your calibration, such as a marker on the table. Then grasps are in your workspace, too,
# whose table is 50 mm high, and may be limited there: these come from above, within 1 radian.
workspace_from_camera = np.array(json.loads((HERE / "workspace_from_camera.json").read_text()))
camera = graspmill.Camera.from_K(K, depth.shape, workspace_from_camera)
plan = planner.plan(depth_m, camera, check_collisions=True, approach=((0, 0, -1), 1.0))
print(plan, plan.warnings)
for grasp in plan[:3]:
    print(f"quality {grasp.quality:.3f}, open to {1e3 * grasp.opening_m:.0f} mm, flange in the workspace:")
    print(np.round(grasp.workspace_from_flange, 3))
plan.page("RealSense").save("plan.html")
