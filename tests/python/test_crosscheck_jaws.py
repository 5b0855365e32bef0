"""Jaws that go each in its own way in MuJoCo, against the closed forms of simulator/tests/jaws.rs."""

from dataclasses import replace

import numpy as np
import pytest
from attempts import GRIPPER, PROCEDURE, UPRIGHT

from crosscheck import dataset, engines, objects
from crosscheck.compound import compound_of
from crosscheck.contract import Attempt, Scene, SceneObject
from crosscheck.floating import FloatingRunner
from crosscheck.pose import Pose

FINGER = {"centre_m": [0, 0.005, -0.02], "size_m": [0.02, 0.01, 0.0554]}
TURNS = {"turn_rad": [0.761, 0, 0], "pivot_m": [0, 0, -0.1], "boxes_at": 0.5, "boxes": [FINGER]}
ONE_SLIDES, ONE_TURNS = [{}, {"slide_m": [0, -0.08, 0]}], [{}, TURNS]
ON_ARCS = [{"turn_rad": [turn, 0, 0], "pivot_m": [0, 0, -0.0693], "keeps_parallel": True} for turn in (-0.52, 0.52)]
LEVER_M = np.hypot(0.1, 0.04)


@pytest.mark.parametrize("jaws, extents_m, grasp_m, share", [
    (ONE_SLIDES, (0.04, 0.04, 0.02), (0, 0.018, 0.015), 1.0),
    # N l = F L, where the end of the block that is farther from the axis is pressed.
    (ONE_TURNS, (0.04, 0.04, 0.008), (0, 0.0185, 0.01), LEVER_M / 0.094), (ONE_TURNS, (0.04, 0.04, 0.008), (0, 0.0185, 0.035), LEVER_M / 0.069),
    # Along the tangent of the arc; across it the jaw is stiff.
    (ON_ARCS, (0.03, 0.06, 0.02), (0, 0, 0.005), 1 / np.cos(np.arcsin(0.03 / 0.08))),
])  # fmt: skip
def test_a_jaw_closes_on_a_block_and_presses_as_its_way_has_it(jaws, extents_m, grasp_m, share):
    corners = np.stack(np.meshgrid(*[(-side / 2, side / 2) for side in extents_m]), axis=-1).reshape(-1, 3)
    grasp = Pose(np.array(grasp_m), UPRIGHT)
    attempt = Attempt(0, 0, "block", "given", grasp, "held", None, 0.04)
    scene = Scene(0, [SceneObject(compound_of("block", [corners]), 0.1, 1.0, objects.AT_ORIGIN)], [attempt])
    engine, gripper = engines.make_floating("mujoco", False), replace(GRIPPER, jaws=jaws)
    ended = FloatingRunner("turn", engine, scene, gripper, PROCEDURE, objects.NOWHERE).from_closing(attempt, grasp)
    assert ended.outcome == "held" and ended.width_m == pytest.approx(extents_m[1], abs=6e-4)
    assert gripper.gap_m(engine.closed_m()) == pytest.approx(extents_m[1], abs=6e-4)
    engine.pull(np.zeros(3))
    for _ in range(500):
        engine.press(0.0)
        engine.step()
    forces_n = [sum(map(engine._normal_force_n, engine._contacts(jaw, 0))) for jaw in engine._finger_geoms]
    assert forces_n == pytest.approx([GRIPPER.finger_force_n * share] * 2, rel=0.01)


def test_a_turned_box_is_covered_and_jaws_are_refused_where_they_are_not_known():
    gripper = replace(GRIPPER, jaws=ONE_TURNS)
    jaw, boxes = gripper.each_jaw[1], gripper.open_gripper()
    assert len(boxes) == 1 + 14 + 1 and gripper.gap_m([0, jaw.way_m]) < 1e-3 and gripper.gap_m([0, 0]) == 0.08
    assert gripper.gap_m([0, jaw.way_m / 2]) == pytest.approx(0.04, abs=1e-4)
    spots = np.random.default_rng(1).uniform(-1, 1, (200, 3)) * jaw.boxes[0].half_m + jaw.boxes[0].centre_m
    apart_m = [np.abs(jaw.open_from_given.apply(spots) - box.centre_m) - box.half_m for box in boxes]
    assert (np.max(apart_m, axis=2).min(axis=0) < 1e-9).all()
    with pytest.raises(dataset.NoDataset, match="pybullet takes fingers that slide alike, and jaw has jaws of its own"):
        engines.make_floating("pybullet", False).load(Scene(0, [], []), gripper, objects.NOWHERE)
