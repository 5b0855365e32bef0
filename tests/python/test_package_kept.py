"""A scene that is kept from image to image, as a wrist's camera sees it."""

import graspmill
import numpy as np
import pytest

PLANNER = graspmill.Planner(threads=1)
SCENE = graspmill.Scene(
    [
        graspmill.Object.cuboid((0.06, 0.04, 0.05), (0.1, 0.12, 0.075)),
        graspmill.Object.solid("cylinder", (0.05, 0.05, 0.09), (0.24, 0.2, 0.095)),
        graspmill.Object.cuboid((0.05, 0.08, 0.03), (0.05, 0.22, 0.065, 0, 0, 0.6, 0.8)),
    ]
)
#: A way of a fifth of a turn about the scene: more images than are kept.
TURNS = np.linspace(0.0, 0.4 * np.pi, 10)
CAMERAS = [graspmill.Camera.look_at((0.15 + 0.35 * np.cos(turn), 0.15 + 0.35 * np.sin(turn), 0.4)) for turn in TURNS]
IMAGES = [SCENE.render(camera) for camera in CAMERAS]


def placed(camera, pose):
    """The same lens elsewhere."""
    return graspmill.Camera(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, pose)


def holds(pose):
    return graspmill.execute(SCENE, np.asarray(pose)[None]).held.all()


def test_images_that_come_one_by_one_give_grasps_that_hold():
    kept = PLANNER.observe(IMAGES[0], CAMERAS[0])
    first = kept.plan()
    for image, camera in zip(IMAGES[1:], CAMERAS[1:]):
        plan = kept.observe(image, camera).plan()
        best = plan[0]
        assert best.quality > 0.9 and holds(best.workspace_from_grasp)
        seen = np.linalg.inv(camera.workspace_from_camera) @ best.workspace_from_grasp
        assert np.allclose(best.camera_from_grasp, seen, atol=1e-5), "the camera is the last one"
    assert plan.answer["funnel"]["judged"] * 2 <= first.answer["funnel"]["judged"]


def test_the_table_is_found_once_and_later_cameras_are_in_the_first_ones_frame():
    pose = CAMERAS[0].workspace_from_camera
    kept = PLANNER.observe(IMAGES[0], placed(CAMERAS[0], None))
    first = kept.plan()
    for image, camera in zip(IMAGES[1:3], CAMERAS[1:3]):
        kept.observe(image, placed(camera, np.linalg.inv(pose) @ camera.workspace_from_camera))
    last = kept.plan(down=np.linalg.inv(pose)[:3, :3] @ [0, 0, -1])
    assert first.answer["table"] == last.answer["table"]
    assert holds(CAMERAS[2].workspace_from_camera @ last[0].camera_from_grasp)


def test_a_scene_is_not_used_while_it_is_planned_and_asks_its_caller():
    kept = PLANNER.observe(IMAGES[0], CAMERAS[0])
    asked = []

    def accept(poses):
        asked.append(len(poses))
        with pytest.raises(graspmill.InputError, match="while it is being planned"):
            kept.observe(IMAGES[1], CAMERAS[1])
        return poses[:, 2, 2] < -0.8

    plan = kept.plan(accept_batch=accept)
    assert sum(asked) > 100 and len(plan) and all(one.workspace_from_grasp[2, 2] < -0.8 for one in plan)
    with pytest.raises(graspmill.InputError, match="must be given"):
        kept.observe(IMAGES[1], placed(CAMERAS[1], None))
    with pytest.raises(graspmill.InputError, match="graspmill.Camera"):
        kept.observe(IMAGES[1], None)
    with pytest.raises(graspmill.InputError, match="no pixel|depth"):
        kept.observe(np.zeros_like(IMAGES[1]), CAMERAS[1])
    with pytest.raises(ZeroDivisionError):
        kept.plan(accept=lambda pose: 1 / 0)
    assert len(kept.observe(IMAGES[1], CAMERAS[1]).plan())
