"""Every object gets its grasp, and from image to image the best grasp stays where it was."""

import numpy as np
import pytest

from grasp_sets import CAMERA, graspmill

#: Boxes by their places and sides: three that the gripper can span, of which one is small, and one that it cannot.
SIDES_M = [(0.04, 0.06, 0.05), (0.03, 0.03, 0.03), (0.05, 0.05, 0.08), (0.13, 0.13, 0.1)]
PLACES_M = [(0.07, 0.07), (0.23, 0.08), (0.07, 0.23), (0.22, 0.22)]


def boxes(places=PLACES_M, sides=SIDES_M):
    poses = [(*place, 0.05 + 0.5 * side[2], 0, 0, 0, 1) for place, side in zip(places, sides)]
    return graspmill.Scene([graspmill.Object.cuboid(side, pose) for side, pose in zip(sides, poses)])


def objects_at(plan, places):
    """The plan's object at each place, by the nearest centroid."""
    centroids = np.array([thing["centroid_m"][:2] for thing in plan.answer["objects"]])
    return [int(np.linalg.norm(centroids - place, axis=1).argmin()) for place in places]


@pytest.mark.parametrize("options", [{}, {"each": True}], ids=["best first", "each first"])
def test_what_can_be_held_has_a_grasp_that_holds_and_what_cannot_says_why(planner, options):
    """`planner/tests/it/judged.rs` counts the grasps of each object."""
    scene = boxes()
    plan = planner.plan(scene.render(CAMERA), CAMERA, **options)
    told = graspmill.execute(scene, plan.workspace_from_grasp)
    assert {0, 1, 2} <= {int(target) for target in told.target[told.held]}
    *spanned, wide = objects_at(plan, PLACES_M)
    thing = plan.answer["objects"][wide]
    assert (thing["grasp_count"], thing["quality_best"]) == (0, None) and thing["reason"].startswith("no grasp")
    assert not options or {grasp.object for grasp in plan[:3]} == set(spanned)


def test_a_targets_neighbours_say_that_they_were_not_asked_for(planner):
    plan = planner.plan(boxes().render(CAMERA), CAMERA, target_m=(*PLACES_M[0], 0.09))
    wanted, *others = objects_at(plan, PLACES_M)
    things = plan.answer["objects"]
    of_objects = [grasp["object"] for grasp in plan.answer["grasps"]]
    assert set(of_objects) <= {wanted, None} and things[wanted]["base_centroid_m"] is None
    assert things[wanted]["grasp_count"] == of_objects.count(wanted) > len(plan) / 2
    reason = "no grasp candidate at it keeps the limits that were asked for"
    assert all(things[other]["reason"] == reason for other in others)


def moved(one, other):
    """Whether two grasps are more than 10 mm or 15° apart, half turns about the approach aside."""
    angles = []
    for turn in (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
        cosine = 0.5 * (np.trace(one[:3, :3].T @ other[:3, :3] @ turn) - 1.0)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return np.linalg.norm(one[:3, 3] - other[:3, 3]) > 0.01 or min(angles) > 15.0


def best_of_noisy(planner, count, steady):
    """The best grasp of each of some noisy images of a scene that stands still, and how many moved."""
    rng, clean = np.random.default_rng(3), boxes().render(CAMERA)
    bests, previous = [], None
    for _ in range(count):
        noisy = (clean + rng.normal(0.0, 0.001, clean.shape)).astype(np.float32)
        best = planner.plan(noisy, CAMERA, grasps_max=1, previous=previous)[0].workspace_from_grasp
        previous = best if steady else None
        bests.append(best)
    return bests, sum(moved(one, other) for one, other in zip(bests, bests[1:]))


def test_the_best_grasp_stays_from_image_to_image(planner, factor):
    count = 30 * factor
    bests, moves = best_of_noisy(planner, count, steady=True)
    assert moves <= 0.05 * count
    assert best_of_noisy(planner, 10, steady=False)[1] > 1, "without a previous one it would stay, too"
    held = graspmill.execute(boxes(), bests).held
    assert held.mean() > 0.9


def test_the_best_grasp_goes_where_its_object_went(planner):
    before, after = [(0.07, 0.07)], [(0.2, 0.2)]
    one = planner.plan(boxes(before).render(CAMERA), CAMERA)[0].workspace_from_grasp
    scene = boxes(after)
    two = planner.plan(scene.render(CAMERA), CAMERA, previous=one)[0].workspace_from_grasp
    assert moved(one, two) and graspmill.execute(scene, [two]).held[0]


def test_a_previous_grasp_is_in_the_cameras_frame_where_the_table_is_found(planner):
    bare = graspmill.Camera(640, 480, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
    depth = boxes().render(CAMERA)
    plan = planner.plan(depth, bare)
    chosen = [grasp for grasp in plan if grasp.quality > plan[0].quality - 0.01][-1]
    again = planner.plan(depth, bare, previous=chosen.camera_from_grasp)[0]
    assert not moved(again.camera_from_grasp, chosen.camera_from_grasp)
