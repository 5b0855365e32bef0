"""Any value in any argument of the package is answered or refused, and the process goes on."""

import numpy as np
import pytest

from grasp_sets import BOX, BOXED as SCENE, DOWN, graspmill

hypothesis = pytest.importorskip("hypothesis")
from hypothesis import strategies as st  # noqa: E402
from hypothesis.extra import numpy as arrays  # noqa: E402

TETRAHEDRON = ([[0, 0, 0], [0.04, 0, 0], [0, 0.04, 0], [0, 0, 0.04]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
CAMERA = graspmill.Camera.look_at((0.15, -0.2, 0.5), width_px=64, height_px=48, focal_px=54)
BARE = graspmill.Camera.from_K([[54, 0, 32], [0, 54, 24], [0, 0, 1]], (48, 64))
DEPTH = SCENE.render(CAMERA)
TSDF = SCENE.tsdf([CAMERA])
CLOUD = np.random.default_rng(1).uniform(0.1, 0.2, (60, 3))
SEEN = (CLOUD - CAMERA.workspace_from_camera[:3, 3]) @ CAMERA.workspace_from_camera[:3, :3]
PLANNER = graspmill.Planner(threads=1)

dtypes = st.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.complex64, np.bool_, "S3", "U3", "datetime64[s]"])
shapes = st.lists(st.integers(0, 8), max_size=4).map(tuple) | st.sampled_from([(3, 3), (4, 4), (1, 7), (2, 4, 4), (48, 64), (40, 40, 40)])
plain = st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.integers(-3, 300) | st.floats() | st.text(max_size=8) | st.binary(max_size=8)
odd = st.sampled_from([b"\xff", "\ud800", "\0", object(), int, np.ma.masked, np.float64("nan"), BOX, SCENE, CAMERA, CLOUD, TSDF, DEPTH, len, 1j])
array = st.tuples(dtypes, shapes).flatmap(lambda of: arrays.arrays(*of))
flat = plain | odd | array
anything = flat | st.lists(flat, max_size=4) | st.tuples(flat, flat) | st.dictionaries(st.text(max_size=4), flat, max_size=2)

OPTIONS = {
    "workspace_size_m": 0.3, "base_from_workspace": np.eye(4), "workspace_from_wrist": DOWN, "policy": "paper", "check_collisions": True,
    "grasps_max": 3, "each": True, "explain": True, "previous": DOWN,
    "avoid": DOWN, "avoid_objects": [[0.1, 0.1, 0.1, 0.03]], "target_m": (0.15, 0.15, 0.08), "approach": ((0, 0, -1), 0.5),
    "keep_out": [[0, 0, 1, 0.04]], "reach": [[0, 0, 0], [0.3, 0.3, 0.3]], "accept": None, "accept_batch": None,
}  # fmt: skip
#: Where the table is found, its place in the base is known by the camera's.
FOUND = {**OPTIONS, "base_from_workspace": None, "base_from_camera": DOWN, "down": (0.0, 0.7, 0.7)}
CALLS = {
    "Camera": (graspmill.Camera, {"width_px": 64, "height_px": 48, "fx_px": 54.0, "fy_px": 54.0, "cx_px": 32.0, "cy_px": 24.0, "workspace_from_camera": DOWN, "convention": "opencv"}),
    "from_K": (graspmill.Camera.from_K, {"K": np.diag([54.0, 54, 1]), "shape": (48, 64), "workspace_from_camera": DOWN, "convention": "opengl"}),
    "look_at": (graspmill.Camera.look_at, {"eye_m": (0.1, 0.2, 0.5), "target_m": (0.15, 0.15, 0.05), "width_px": 64, "height_px": 48, "focal_px": 54.0}),
    "cuboid": (graspmill.Object.cuboid, {"extents_m": (0.04, 0.04, 0.04), "pose": DOWN, "mass_kg": 0.1, "friction": 0.5}),
    "solid": (graspmill.Object.solid, {"shape": "cylinder", "extents_m": (0.04, 0.04, 0.04), "pose": DOWN, "mass_kg": 0.1, "friction": 0.5}),
    "mesh": (graspmill.Object.mesh, {"mesh": TETRAHEDRON, "pose": DOWN, "name": "m", "mass_kg": 0.1, "friction": 0.5, "parts_max": 2, "corners_max": 8}),
    "Scene": (graspmill.Scene, {"objects": [BOX], "table_z_m": 0.05}),
    "render": (SCENE.render, {"camera": CAMERA}),
    "tsdf": (SCENE.tsdf, {"cameras": [CAMERA], "resolution": 8, "size_m": 0.3}),
    "settle": (SCENE.settle, {"drop": False, "settings": {}}),
    "execute": (graspmill.execute, {"scene": SCENE, "grasps": DOWN, "gripper": None, "targets": [0], "settings": {}, "threads": 1}),
    "plan": (PLANNER.plan, {"depths": DEPTH, "cameras": CAMERA, "mask": None, **OPTIONS}),
    "plan_without_pose": (PLANNER.plan, {"depths": DEPTH, "cameras": BARE, "mask": None, **FOUND}),
    "plan_cloud": (PLANNER.plan_cloud, {"points_m": CLOUD, "eyes_m": [[0.1, 0.1, 0.5]], **OPTIONS}),
    "plan_cloud_of_a_camera": (PLANNER.plan_cloud, {"points_m": SEEN, "eyes_m": None, "workspace_from_cloud": "table", **FOUND}),
    "overlay": (PLANNER.plan(DEPTH, CAMERA).overlay, {"image": np.zeros((48, 64, 3), np.uint8)}),
    "plan_tsdf": (PLANNER.plan_tsdf, {"tsdf": TSDF, **OPTIONS}),
    "grasp_crops": (graspmill.grasp_crops, {"tsdf": TSDF, "workspace_from_grasp": DOWN, "gripper": None, "views": 6, "voxel_size_m": 0.0075, "table_z_m": 0.05}),
    "Planner": (graspmill.Planner, {"config": "judge", "model": None, "gripper": "franka_hand", "threads": 1}),
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_any_value_of_an_argument_is_answered_or_refused(name, factor):
    function, arguments = CALLS[name]

    @hypothesis.settings(max_examples=10 * factor, deadline=None, database=None, suppress_health_check=list(hypothesis.HealthCheck))
    @hypothesis.given(st.sampled_from(sorted(arguments)), anything)
    def ask(key, value):
        try:
            function(**{**arguments, key: value})
        except graspmill.InternalError:
            raise
        except graspmill.GraspmillError:
            pass

    ask()
