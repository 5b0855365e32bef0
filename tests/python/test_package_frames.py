"""Frames and widths from Python: mistakes are named as by the command, the table is found, and widths are measured."""

import io
import json

import numpy as np
import pytest
from PIL import Image

from grasp_sets import BOX, BOXED, CAMERA as RIGHT, graspmill, points_of, refused
from programs import planned, planned_view  # noqa: E402

K = [[540.0, 0.0, 320.0], [0.0, 540.0, 240.0], [0.0, 0.0, 1.0]]
SHAPE = (480, 640)
POSE = RIGHT.workspace_from_camera
DEPTH = BOXED.render(RIGHT)
PLANNER = graspmill.Planner()


def shifted(x, y, z):
    moved = np.eye(4)
    moved[:3, 3] = x, y, z
    return moved


OPENGL = "it would be seen there if workspace_from_camera were in OpenGL's camera axes, y up and z backwards: views[0]"
#: The pose, a camera matrix, and what a warning has; none for no warning. `planner/src/plausible.rs` has every mistake.
MISTAKES = {
    "none": (POSE, K, None),
    "OpenGL": (POSE @ np.diag([1.0, -1.0, -1.0, 1.0]), K, OPENGL),
    "another size": (POSE, [1080.0, 0, 640, 0, 1080.0, 480, 0, 0, 1], "intrinsics those of another size?: views[0]"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_a_frame_is_named_as_by_the_command(tmp_path, name):
    pose, matrix, expected = MISTAKES[name]
    camera = graspmill.Camera.from_K(matrix, SHAPE, pose)
    plan = PLANNER.plan(DEPTH, camera)
    assert planned_view(tmp_path, DEPTH, camera)["warnings"] == plan.warnings
    assert any(expected in said for said in plan.warnings) if expected else plan.warnings == []


def test_a_pose_in_millimetres_is_named(tmp_path):
    """The command refuses so large a pose before it is tried."""
    far = graspmill.Camera.from_K(K, SHAPE, shifted(*(999 * POSE[:3, 3])) @ POSE)
    plan = PLANNER.plan(DEPTH, far)
    assert len(plan) == 0 and "if workspace_from_camera were in millimetres: views[0]" in plan.warnings[0]
    assert "are these millimetres?: views[0].workspace_from_camera" in planned_view(tmp_path, DEPTH, far, code=78)


@pytest.mark.parametrize(
    "scale, expected", [(1e3, "the median depth must be between 0.02 and 20 m, got .* m: are these millimetres\\?"), (0.0, "no pixel has a depth")]
)
def test_depths_that_cannot_be_are_refused_as_by_the_command(tmp_path, scale, expected):
    depth = (scale * DEPTH).astype(np.float32)
    with pytest.raises(graspmill.InputError, match=expected) as error:
        PLANNER.plan(depth, RIGHT)
    assert str(error.value).removesuffix(": depth image 0") in planned_view(tmp_path, depth, RIGHT, code=78)


def test_few_depths_are_told_for_the_image_that_has_them(tmp_path):
    sparse = np.where(np.arange(640) % 20 == 0, DEPTH, 0.0)
    few = "only 5.0 % of the pixels have a depth"
    assert PLANNER.plan([DEPTH, sparse], [RIGHT, RIGHT]).warnings == [f"{few}: depth image 1"]
    assert f"{few}: views[0].depth" in planned_view(tmp_path, sparse, RIGHT)["warnings"]


def test_a_png_in_tenths_of_a_millimetre_is_named_as_by_the_command(tmp_path):
    """As a RealSense D405 writes it, without depth_scale_m."""
    tenths = np.rint(DEPTH * 1e4).astype(np.uint16)
    Image.fromarray(tenths).save(tmp_path / "depth.png")
    plan = PLANNER.plan(tenths.astype(np.float32) * np.float32(1e-3), RIGHT)
    said = planned_view(tmp_path, DEPTH, RIGHT, depth="depth.png")["warnings"]
    assert said == plan.warnings and "if the depths were 0.1" in said[0]
    assert planned_view(tmp_path, DEPTH, RIGHT, depth="depth.png", depth_scale_m=1e-4)["warnings"] == []


THINGS = [
    BOX,
    graspmill.Object.solid("cylinder", (0.05, 0.05, 0.09), (0.24, 0.2, 0.095)),
    graspmill.Object.cuboid((0.05, 0.08, 0.03), (0.05, 0.22, 0.065, 0, 0, 0.6, 0.8)),
]
SCENE = graspmill.Scene(THINGS)
EYES = ((0.15, -0.3, 0.5), (0.5, 0.3, 0.45), (0.15, 0.1, 0.7))


def seen_from(eye_m, scene=SCENE):
    """A depth image, its camera without a pose, and the pose."""
    camera = graspmill.Camera.look_at(eye_m, (0.15, 0.15, 0.06))
    return scene.render(camera), graspmill.Camera.from_K(K, SHAPE), camera.workspace_from_camera


def must_hold(plan, pose, scene=SCENE, best=5):
    """The workspace has the true table at its height, up is up, and the best grasps hold, executed where the camera's frame truly is."""
    found_from_true = plan.workspace_from_camera @ np.linalg.inv(pose)
    assert np.degrees(np.arccos(min(1.0, found_from_true[2, 2]))) < 0.2
    assert abs((found_from_true @ [0.15, 0.15, 0.05, 1.0])[2] - 0.05) < 1e-3
    assert len(plan) >= best, plan
    for grasp in plan:
        between = np.linalg.inv(plan.workspace_from_camera) @ grasp.workspace_from_grasp
        assert np.allclose(grasp.camera_from_grasp, between, atol=2e-6)
    truly = np.array([pose @ grasp.camera_from_grasp for grasp in plan[:best]])
    assert graspmill.execute(scene, truly).held.all()


@pytest.mark.parametrize("eye_m", EYES)
def test_the_table_is_found_without_a_pose(eye_m):
    depth, camera, pose = seen_from(eye_m)
    plan = PLANNER.plan(depth, camera)
    must_hold(plan, pose)
    assert plan.warnings == [] and plan.answer["table"]["sureness"] > 0.5
    best = plan.answer["table"]["candidates"][0]
    assert best["structure_m"] is None and best["residual_m"] < 1e-3 and np.allclose(best["normal"], pose[2, :3], atol=4e-3)
    # With the pose there is no table to be found, and the same frames are given.
    placed = PLANNER.plan(depth, graspmill.Camera.from_K(K, SHAPE, pose))
    assert placed.answer["table"] is None and np.allclose(placed.workspace_from_camera, pose, atol=1e-6)
    must_hold(placed, pose)


def test_the_command_finds_the_same_table(tmp_path):
    depth, camera, _ = seen_from(EYES[0])
    np.save(tmp_path / "depth.npy", depth)
    (tmp_path / "camera.json").write_text(json.dumps({"fx_px": 540.0, "fy_px": 540.0, "cx_px": 320.0, "cy_px": 240.0}))
    assert planned("--depth", tmp_path / "depth.npy", "--intrinsics", tmp_path / "camera.json") == PLANNER.plan(depth, camera).answer


def test_other_cameras_stand_in_the_frame_of_the_first():
    (first, camera, pose), (second, _, other) = (seen_from(eye_m, BOXED) for eye_m in ((0.15, -0.3, 0.4), (0.15, 0.6, 0.4)))
    beside = graspmill.Camera.from_K(K, SHAPE, np.linalg.inv(pose) @ other)
    one, both = PLANNER.plan(first, camera), PLANNER.plan([first, second], [camera, beside])
    for plan in (one, both):
        must_hold(plan, pose, BOXED)
        assert plan.warnings == []
    # The far side of the box, which only the second sees.
    true_from_found = [pose @ np.linalg.inv(plan.workspace_from_camera) for plan in (one, both)]
    clouds = [plan.cloud() @ turn[:3, :3].T + turn[:3, 3] for plan, turn in zip((one, both), true_from_found)]
    far = [np.sum((abs(cloud[:, 1] - 0.18) < 0.004) & (cloud[:, 2] > 0.06) & (cloud[:, 2] < 0.09)) for cloud in clouds]
    assert far[0] == 0 and far[1] > 50, far
    refused("workspace_from_camera must be given, got None", lambda: PLANNER.plan([first, second], [camera, camera]))


def test_a_cloud_in_its_cameras_frame_is_enough(tmp_path):
    depth, _, pose = seen_from(EYES[0])
    points = points_of(depth)
    plan = PLANNER.plan_cloud(points, workspace_from_cloud="table")
    must_hold(plan, pose)
    assert plan.warnings == [] and plan.answer["table"]["sureness"] > 0.5
    np.save(tmp_path / "cloud.npy", points)
    assert planned("--cloud", tmp_path / "cloud.npy", "--workspace-from-cloud", "table") == plan.answer
    # With a pose it is a cloud in the workspace, seen from where the camera is.
    placed = PLANNER.plan_cloud(points, workspace_from_cloud=pose)
    moved = (points @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
    same = PLANNER.plan_cloud(moved, eyes_m=[pose[:3, 3]])
    assert placed.answer["region"] == same.answer["region"] and placed[0].camera_from_grasp is None
    centroids = [[thing["centroid_m"] for thing in one.answer["objects"]] for one in (placed, same)]
    assert np.allclose(*centroids, atol=2e-3) and len(centroids[0]) == 3
    assert graspmill.execute(SCENE, placed.workspace_from_grasp[:5]).held.all()


#: The workspace in the frame of a robot's base that stands level with the table, turned and elsewhere.
BASE = shifted(0.4, -0.2, 0.1) @ np.array([[0.6, -0.8, 0, 0], [0.8, 0.6, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def rolled():
    """What a camera that is rolled by a quarter turn sees, the camera without a pose, and the pose."""
    quarter = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    pose = graspmill.Camera.look_at(EYES[0], (0.15, 0.15, 0.06)).workspace_from_camera @ quarter
    return SCENE.render(graspmill.Camera.from_K(K, SHAPE, pose)), graspmill.Camera.from_K(K, SHAPE), pose


def test_gravity_finds_the_table_of_a_camera_that_is_rolled():
    depth, camera, pose = rolled()
    down = -pose[2, :3]
    for plan in (
        PLANNER.plan(depth, camera, down=9.81 * down),
        PLANNER.plan_cloud(points_of(depth), workspace_from_cloud="table", down=down),
    ):
        must_hold(plan, pose)
    refused("no table was found", lambda: PLANNER.plan(depth, camera, down=-down))


def test_a_camera_that_is_calibrated_to_the_base_gives_gravity_and_the_bases_frame(tmp_path):
    depth, camera, pose = rolled()
    base = BASE @ pose
    plan = PLANNER.plan(depth, camera, base_from_camera=base)
    must_hold(plan, pose)
    cloud = PLANNER.plan_cloud(points_of(depth), workspace_from_cloud="table", base_from_camera=base)
    for grasp in [*plan, *cloud]:
        assert np.allclose(grasp.base_from_grasp, base @ grasp.camera_from_grasp, atol=5e-6)
    refused("no table was found", lambda: PLANNER.plan(depth, camera, base_from_camera=base, down=pose[2, :3]))
    np.save(tmp_path / "depth.npy", depth)
    np.savetxt(tmp_path / "K.txt", K)
    at = ",".join(repr(part) for part in graspmill.Camera.from_K(K, SHAPE, base)._pose())
    said = planned("--depth", tmp_path / "depth.npy", "--intrinsics", tmp_path / "K.txt", f"--base-from-camera={at}")["grasps"]
    assert len(said) == len(plan) and said[0]["camera_from_grasp"] == plan.answer["grasps"][0]["camera_from_grasp"]
    assert np.allclose(said[0]["base_from_grasp"]["position_m"], plan[0].base_from_grasp[:3, 3], atol=5e-6)


def test_a_mistake_is_named_where_the_table_is_found_too():
    depth, camera, pose = seen_from(EYES[0])
    points = points_of(depth)
    for planned in (
        lambda base: PLANNER.plan(depth, camera, base_from_camera=base),
        lambda base: PLANNER.plan_cloud(points, workspace_from_cloud="table", base_from_camera=base),
    ):
        assert planned(BASE @ pose).warnings == []
        refused("if base_from_camera were the inverse, camera_from_base", lambda: planned(np.linalg.inv(BASE @ pose)))
    placed = PLANNER.plan_cloud(points, workspace_from_cloud=np.linalg.inv(pose))
    assert "if workspace_from_cloud were the inverse, cloud_from_workspace" in placed.warnings[0], placed.warnings


def test_an_object_alone_is_planned_afloat():
    depth, _, pose = seen_from(EYES[0], BOXED)
    points = points_of(depth)
    thing = points[(points @ pose[:3, :3].T + pose[:3, 3])[:, 2] > 0.055]
    plan = PLANNER.plan_cloud(thing, workspace_from_cloud="table")
    assert plan.answer["table"] is None and "one object and no table under it" in plan.warnings[0], plan.warnings
    centred = thing - thing.mean(axis=0)
    aside = lambda: PLANNER.plan_cloud(points, object_m=centred, workspace_from_cloud="table")
    refused("none of the object's points lies in the scene", aside)


def test_what_contradicts_itself_is_refused():
    depth, camera, pose = seen_from(EYES[0])
    points, tsdf = points_of(depth), BOXED.tsdf([RIGHT])
    goes_with = "down goes with a table that is to be found"
    for expected, call in (
        ("base_from_workspace must not be given", lambda: PLANNER.plan(depth, camera, base_from_workspace=np.eye(4))),
        ("base_from_workspace must not be given", lambda: PLANNER.plan_cloud(points, workspace_from_cloud="table", base_from_workspace=np.eye(4))),
        (goes_with, lambda: PLANNER.plan(DEPTH, RIGHT, down=(0, 0, 1))),
        (goes_with, lambda: PLANNER.plan_cloud(points, down=(0, 0, 1))),
        (goes_with, lambda: PLANNER.plan_cloud(points, workspace_from_cloud=pose, down=(0, 0, 1))),
        (goes_with, lambda: PLANNER.plan_tsdf(tsdf, down=(0, 0, 1))),
        ("base_from_camera goes with a table that is to be found", lambda: PLANNER.plan(DEPTH, RIGHT, base_from_camera=np.eye(4))),
        ("workspace_from_cloud", lambda: PLANNER.plan_cloud(points, workspace_from_cloud="floor")),
        ("down", lambda: PLANNER.plan(depth, camera, down=(0, 1))),
        ("no table was found", lambda: PLANNER.plan_cloud(np.zeros((0, 3)), workspace_from_cloud="table")),
        ("only a plan finds the table", lambda: SCENE.render(camera)),
        ("only a plan finds the table", lambda: graspmill.tsdf([depth], [camera])),
    ):
        refused(expected, call)


GRIPPER = graspmill.Gripper.load("franka_hand")
FRANKA = graspmill.Planner(gripper=GRIPPER)


def between_fingers(depth, pose, grasp):
    """How far apart what the image shows between the open fingers is, along the closing direction; 0 for little."""
    points = points_of(depth) @ pose[:3, :3].T + pose[:3, 3]
    points = points[points[:, 2] > 0.058]
    x, y, z = ((points - grasp.workspace_from_grasp[:3, 3]) @ grasp.workspace_from_grasp[:3, :3]).T
    along = y[(abs(x) < GRIPPER.finger_width_m / 2) & (abs(y) < GRIPPER.opening_m_max / 2) & (z < 0) & (z > -GRIPPER.finger_length_m)]
    return float(np.diff(np.percentile(along, [2, 98]))[0]) if len(along) >= 20 else 0.0


def many(seed):
    """Boxes of any turn and a cylinder, seen by a camera without a pose."""
    rng, things = np.random.default_rng(seed), []
    for number, (x, y) in enumerate(((0.08, 0.08), (0.22, 0.09), (0.10, 0.22), (0.23, 0.23))):
        (wide, deep), high, turn = rng.uniform(0.03, 0.065, 2), rng.uniform(0.04, 0.1), rng.uniform(0, np.pi)
        pose = (x, y, 0.05 + high / 2, 0, 0, np.sin(turn / 2), np.cos(turn / 2))
        cylinder = number == 3
        size = (wide, wide, high) if cylinder else (wide, deep, high)
        things.append(graspmill.Object.solid("cylinder", size, pose) if cylinder else graspmill.Object.cuboid(size, pose))
    scene, around = graspmill.Scene(things), rng.uniform(0, 2 * np.pi)
    return scene, *seen_from((0.15 + 0.45 * np.cos(around), 0.15 + 0.45 * np.sin(around), 0.5), scene)


def test_widths_are_never_narrower_than_what_is_seen_and_grippers_open_wide_enough():
    told, errors, opened = 0, [], []
    for seed in range(4):
        scene, depth, camera, pose = many(seed)
        plan = FRANKA.plan(depth, camera)
        best = plan[:12]
        outcomes = graspmill.execute(scene, np.array([pose @ grasp.camera_from_grasp for grasp in best]), gripper=GRIPPER)
        for grasp, held, width_m in zip(best, outcomes.held, outcomes.width_m):
            if grasp.width_m is not None:
                told += 1
                assert grasp.width_m > between_fingers(depth, plan.workspace_from_camera, grasp) - 0.005
                errors += [abs(grasp.width_m - width_m)] if held else []
            if held and grasp.opening_m < GRIPPER.opening_m_max:
                numbers = {name: value for name, value in vars(GRIPPER).items() if not name.startswith("_")}
                less = graspmill.Gripper(**{**numbers, "opening_m_max": grasp.opening_m})
                opened.append(graspmill.execute(scene, (pose @ grasp.camera_from_grasp)[None], gripper=less).held[0])
    print(f"{told} told, median error {1e3 * np.median(errors):.1f} mm, {np.mean(opened):.3f} of {len(opened)} hold when opened so far")
    assert told > 30 and np.median(errors) < 0.004, (told, np.median(errors))
    assert len(opened) > 25 and np.mean(opened) >= 0.95, (len(opened), np.mean(opened))


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def test_an_overlay_is_drawn_into_the_image_of_the_first_camera():
    """`report/src/overlay.rs` has what is drawn, and where."""
    depth, camera, pose = seen_from(EYES[0])
    plan, grey = PLANNER.plan(depth, camera), np.full((*SHAPE, 3), 90, np.uint8)
    drawn = plan.overlay(grey)
    changed = abs(pixels(drawn) - 90).max(axis=2) > 30
    # Around the tips of the best grasp.
    x, y, z = plan[0].camera_from_grasp[:3, 3]
    u, v = round(540.0 * x / z + 320.0), round(540.0 * y / z + 240.0)
    assert changed[v - 40 : v + 41, u - 40 : u + 41].any() and changed.mean() < 0.3, (u, v)
    # An image with alpha is as good, and without one the depth is drawn in grey.
    assert plan.overlay(np.dstack([grey, grey[:, :, :1]])) == drawn
    assert pixels(plan.overlay()).shape == (*SHAPE, 3) and pixels(plan.overlay()).std() > 5
    placed = PLANNER.plan(depth, graspmill.Camera.from_K(K, SHAPE, pose)).overlay(grey)
    assert pixels(placed).shape == (*SHAPE, 3)


def test_an_overlay_goes_with_an_image_of_the_camera():
    depth, camera, _ = seen_from(EYES[0])
    plan = PLANNER.plan(depth, camera)
    for image in (np.zeros(SHAPE, np.uint8), np.zeros((*SHAPE, 3)), np.zeros((*SHAPE, 2), np.uint8), np.zeros((0, 0, 3), np.uint8), "image.png"):
        refused("image must be", lambda: plan.overlay(image))
    refused("640 x 480", lambda: plan.overlay(np.zeros((480, 600, 3), np.uint8)))
    assert pixels(plan.overlay(np.zeros((240, 320, 3), np.uint8))).shape == (240, 320, 3)
    cloud = PLANNER.plan_cloud(points_of(depth), workspace_from_cloud="table")
    refused("without a camera", lambda: cloud.overlay(np.zeros((*SHAPE, 3), np.uint8)))
