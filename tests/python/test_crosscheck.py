"""The cross-check's own parts against known answers, and a small cross-check of the dataset at GRASPMILL_DATASET."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from programs import DATASET
from attempts import DOWN, GRIPPER, PROCEDURE, SOLIDS, TABLE, closed, standing

from crosscheck import cli, coulomb, dataset, engines, gate
from crosscheck.agreement import agreement, confusion, kappas
from crosscheck.attempt import Runner
from crosscheck.bullet import stable_rate_hz
from crosscheck.contract import GripperBox, Scene, retreat_direction, smoothstep, steps
from crosscheck.coulomb import lag_m
from crosscheck.hull import hull_of
from crosscheck.pose import Pose, quat_from_vector
from crosscheck.solid import FACETS, Solid


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda s: s.kind)
def test_corners_span_the_extents_and_lie_within_every_face(solid):
    corners = solid.vertices_m
    np.testing.assert_allclose(np.ptp(corners, axis=0), solid.extents_m, atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0) + corners.min(axis=0), 0, atol=1e-12)
    offsets = (solid.normals @ corners.T).max(axis=1)
    inside = solid.normals @ corners.T <= offsets[:, None] + 1e-12
    on_face = solid.normals @ corners.T >= offsets[:, None] - 1e-12
    assert inside.all() and (on_face.sum(axis=0) >= 3).all()


def test_volumes_centroids_and_inertias_are_the_textbooks():
    cuboid, cylinder, prism, half = SOLIDS
    turn = 2 * np.pi / FACETS
    polygon = FACETS / 2 * np.sin(turn)  # area over radius squared
    volumes = [0.03 * 0.05 * 0.07, polygon * 0.02**2 * 0.09, 0.08 * 0.05 * 0.04 / 2, polygon / 2 * 0.03**2 * 0.08]
    np.testing.assert_allclose([s.volume_m3 for s in SOLIDS], volumes, rtol=1e-12)
    np.testing.assert_allclose(prism.centroid_m, [0, 0, -0.04 / 6], atol=1e-15)
    assert half.centroid_m[2] == pytest.approx(4 * 0.03 / (3 * np.pi) - 0.015, abs=2e-4)  # of the true half disc
    np.testing.assert_allclose(cuboid.inertia_kg_m2(12.0), [0.05**2 + 0.07**2, 0.03**2 + 0.07**2, 0.03**2 + 0.05**2])
    about_axis = 0.02**2 * (2 + np.cos(turn)) / 6  # of a regular polygon, over mass
    across = about_axis / 2 + 0.09**2 / 12
    np.testing.assert_allclose(cylinder.inertia_kg_m2(1.0), [across, across, about_axis], rtol=1e-12)
    np.testing.assert_allclose(prism.inertia_kg_m2(36.0)[0], 2 * 0.04**2 + 1.5 * 0.05**2, rtol=1e-12)


@pytest.mark.parametrize("kind, extents", [("cylinder", (0.04, 0.05, 0.1)), ("cube", (1, 1, 1)), ("cuboid", (0, 1, 1))])
def test_impossible_solids_are_refused(kind, extents):
    with pytest.raises(ValueError):
        Solid(kind, extents)


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda s: s.kind)
def test_shrinking_moves_every_face_by_the_margin(solid):
    for body in (solid, hull_of(solid.vertices_m)):
        moved = (body.normals @ body.vertices_m.T).max(axis=1) - (body.normals @ body.shrunk(1e-3).T).max(axis=1)
        np.testing.assert_allclose(moved, 1e-3, atol=1e-9)


def gap(solid: Solid, rotation_vector: list, position: list, half: list) -> float:
    pose = Pose(np.array(position, dtype=float), quat_from_vector(np.array(rotation_vector, dtype=float)))
    box = GripperBox(np.zeros(3), np.array(half, dtype=float))
    return float(gate.separation(solid, pose.rotation[None], pose.position_m[None], [box])[0, 0])


def test_separations_of_boxes_are_exact():
    cube = Solid("cuboid", (0.02, 0.02, 0.02))
    assert gap(cube, [0, 0, 0], [0.05, 0, 0], [0.01] * 3) == pytest.approx(0.03)
    assert gap(cube, [0, 0, 0], [0.015, 0.001, 0], [0.01] * 3) == pytest.approx(-0.005)
    # A corner towards the box: half the diagonal instead of half the side.
    assert gap(cube, [0, 0, np.pi / 4], [0.05, 0, 0], [0.01] * 3) == pytest.approx(0.04 - 0.01 * np.sqrt(2))
    # Two edges that cross at a right angle: only the product of the edges parts them.
    turned = [np.pi / 4, 0, 0]
    edge = gap(cube, turned, [0, 0.0, 0.0142 + 0.0142], [0.01] * 3)
    assert edge == pytest.approx(0.0284 - 0.01 - 0.01 * np.sqrt(2))


def test_separations_of_rounds_are_those_of_their_facets():
    cylinder = Solid("cylinder", (0.04, 0.04, 0.06))
    assert gap(cylinder, [0, 0, 0], [0.05, 0, 0], [0.01] * 3) == pytest.approx(0.02)  # a corner of the outline
    flat = 0.02 * np.cos(np.pi / FACETS)
    assert gap(cylinder, [0, 0, np.pi / FACETS], [0.05, 0, 0], [0.01] * 3) == pytest.approx(0.04 - flat)
    assert gap(cylinder, [0, 0, 0], [0, 0, 0.05], [0.01] * 3) == pytest.approx(0.01)


def scene(height_m: float, mass_kg: float = 0.1, friction: float = 1.0, tip_m: float = 0.0) -> Scene:
    """A cuboid of 40 mm x 40 mm standing in the middle, and a grasp from above, tips `tip_m` below its top."""
    grasp = Pose(np.array([0.15, 0.15, 0.05 + height_m - tip_m]), DOWN)
    return standing(Solid("cuboid", (0.04, 0.04, height_m)), grasp, mass_kg, friction, (0.15, 0.15, 0.05 + height_m / 2))


def judged(tip_m: float, height_m: float = 0.06, shift: tuple = (0, 0, 0), turn: tuple = (0, 0, 0)) -> gate.GateResult:
    one = scene(height_m, tip_m=tip_m)
    pose = one.attempts[0].workspace_from_grasp.moved(np.array(shift)).turned(np.array(turn))
    return gate.judge(one, [pose], GRIPPER, PROCEDURE, TABLE.table_z_m)[0]


def test_the_gate_tells_what_is_hit_first_and_by_how_much():
    assert judged(0.03).outcome is None
    # The jaws are 80 mm apart, the cuboid 40 mm wide, the clearance 1 mm.
    assert judged(0.03, shift=(0, 0.0189, 0)).outcome is None
    touching = judged(0.03, shift=(0, 0.0191, 0))
    assert (touching.outcome, touching.hit) == ("approach_collision", "target")
    assert touching.margin_m == pytest.approx(1e-4, abs=1e-9)
    # The palm, 50 mm behind the tips, meets the top.
    assert judged(0.0489).outcome is None
    assert (judged(0.0491).outcome, judged(0.0491).hit) == ("approach_collision", "target")
    # Tips nearer to the table than the clearance, at the end of the way.
    assert judged(0.0489, height_m=0.05).outcome is None
    low = judged(0.0491, height_m=0.05)
    assert low.outcome == "approach_collision"
    # Grasping from below starts under the table.
    assert judged(0.03, turn=(np.pi, 0, 0)).outcome == "pregrasp_collision"


def test_kappa_of_known_tables():
    assert kappas([15, 10, 5, 20]) == pytest.approx(0.4)  # Cohen's coefficient in every textbook
    assert kappas([10, 0, 0, 5]) == pytest.approx(1.0)
    assert kappas([25, 25, 25, 25]) == pytest.approx(0.0)
    assert np.isnan(kappas([7, 0, 0, 0]))


def test_the_bootstrap_draws_whole_scenes():
    rng = np.random.default_rng(0)
    a = rng.integers(0, 2, 600)
    b = np.where(rng.random(600) < 0.1, 1 - a, a)
    scattered = agreement(a, b, np.arange(600), seed=1)
    assert scattered.disagreeing == int((a != b).sum()) and scattered.share == pytest.approx(1 - (a != b).mean())
    assert scattered.low < scattered.kappa < scattered.high
    # Ten copies of the same scenes tell no more than one.
    copies = agreement(np.tile(a, 10), np.tile(b, 10), np.tile(np.arange(600), 10), seed=1)
    assert copies.high - copies.low == pytest.approx(scattered.high - scattered.low, rel=1e-6)
    assert agreement(a, a, np.arange(600), seed=1).low == 1.0
    assert confusion(["held", "empty"], ["held", "held"], ["empty", "held"]).tolist() == [[0, 1], [0, 1]]


def test_steps_smoothstep_and_retreat():
    assert [steps(t, 240.0) for t in (float(np.float32(0.1)) / float(np.float32(0.2)), 0.25, 1.0, 0.001)] == [120, 60, 240, 1]
    assert [smoothstep(s) for s in (0.0, 0.5, 1.0, 2.0)] == [0.0, 0.5, 1.0, 1.0]
    tilted = [Pose(np.zeros(3), DOWN).turned(np.array([0, angle, 0])) for angle in (0.0, 1.04, 1.06)]
    along = [retreat_direction(pose, PROCEDURE.retreat_cone_rad) @ -pose.rotation[:, 2] for pose in tilted]
    np.testing.assert_allclose(along, [1, 1, np.cos(1.06)], atol=1e-12)


@pytest.mark.parametrize("name", engines.ENGINES)
@pytest.mark.parametrize(
    "mass_kg, friction, finger_kg, outcome",
    [(2.5, 1.0, 0.1, "held"), (4.8, 1.0, 0.1, "slipped"), (2.5, 0.5, 0.1, "slipped"), (0.02, 1.0, 0.03, "held")],
)
def test_two_fingers_of_20_n_hold_what_coulomb_says(name, mass_kg, friction, finger_kg, outcome):
    """Two fingers hold 2 · 20 N · friction; the lift adds 6 · 0.1 m / (0.5 s)² to gravity."""
    assert (2 * 20.0 * friction > mass_kg * (9.81 + 2.4)) == (outcome == "held")
    ended = closed(name, scene(0.06, mass_kg, friction, tip_m=0.03), replace(GRIPPER, finger_mass_kg=finger_kg))
    assert ended.outcome == outcome
    assert ended.width_m == pytest.approx(0.04, abs=3e-4)


def test_steps_are_halved_for_fingers_too_light_for_an_explicit_gear():
    assert [stable_rate_hz(240.0, mass_kg) for mass_kg in (0.1, 0.06, 0.03, 0.005)] == [240, 240, 480, 3840]
    for mass_kg in (0.005, 0.01, 0.03, 0.06, 0.1):
        dt = 1 / stable_rate_hz(240.0, mass_kg)
        step = np.array([[1, dt], [0, 1]]) @ np.array([[1, 0], [-dt * 2000 / mass_kg, 1 - dt * 20 / mass_kg]])
        assert np.abs(np.linalg.eigvals(step)).max() < 1


def test_the_closed_form_of_sliding_is_its_integral():
    time, mass_kg = np.linspace(0, 0.5, 100_001), 3.6
    palm = 0.1 * (3 * (time / 0.5) ** 2 - 2 * (time / 0.5) ** 3)
    body = np.minimum(palm, 0.5 * (40.0 / mass_kg - 9.81) * time**2)
    caught = int(np.argmax(np.gradient(palm, time)[1:] < (40.0 / mass_kg - 9.81) * time[1:]))
    lag = lag_m(mass_kg, 1.0, 20.0, PROCEDURE, 9.81)
    assert lag == pytest.approx((palm - body)[caught], abs=1e-5) and 0.009 < lag < 0.010
    assert lag_m(3.2, 1.0, 20.0, PROCEDURE, 9.81) == 0.0 and np.isinf(lag_m(4.1, 1.0, 20.0, PROCEDURE, 9.81))


@pytest.mark.parametrize("name, tolerance_m", [("mujoco", 0.001), ("pybullet", 0.005)])
def test_a_body_that_is_too_heavy_slides_as_far_as_the_closed_form_says(name, tolerance_m):
    ended = closed(name, scene(0.06, 3.6, tip_m=0.03))
    assert 0.1 - ended.travel_m == pytest.approx(lag_m(3.6, 1.0, 20.0, PROCEDURE, 9.81), abs=tolerance_m)


@pytest.mark.parametrize("name", engines.ENGINES)
@pytest.mark.parametrize("gripper", [GRIPPER, replace(GRIPPER, finger_mass_kg=0.038, finger_force_n=30.0, closing_speed_m_s=0.03)])
def test_an_engines_own_approach_stops_at_the_clearance(name, gripper):
    """Fingers that are light for their force stand as still as others on the way."""
    engine, one = engines.make(name), scene(0.06, 0.1, tip_m=0.03)
    runner, grasp = Runner(engine, one, gripper, PROCEDURE, TABLE), one.attempts[0].workspace_from_grasp
    cases = {0.0: "held", 0.018: "held", 0.0196: "approach_collision"}
    found = {shift: runner.own_approach(one.attempts[0], grasp.moved(np.array([0, shift, 0]))) for shift in cases}
    engine.close()
    assert {shift: ended.outcome for shift, ended in found.items()} == cases
    assert found[0.0196].hit == "target"


def test_a_wrong_folder_and_damaged_files_have_their_exit_codes(tmp_path):
    assert cli.main([str(tmp_path)]) == 78
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text("{")
    assert cli.main([str(tmp_path)]) == 65


@pytest.fixture(scope="module")
def small() -> dataset.Dataset:
    """The dataset's first scenes, with 60 attempts each."""
    data = dataset.read(DATASET, 10)
    return replace(data, scenes=[replace(one, attempts=one.attempts[:60]) for one in data.scenes])


@pytest.mark.parametrize("name", engines.ENGINES)
def test_another_engine_gives_the_same_labels(small, name, capsys, factor):
    """Floors: see docs/label-parity.md for how they were chosen."""
    report = cli.run(replace(small, scenes=small.scenes[: 3 * factor]), [name], seed=1)
    found = report.engines[name]
    with capsys.disabled():
        print(f"\n{name}: same gate {found.same.overall}, closing {found.same.closing}, own {found.own.overall}")
    assert len(report.gate_differences) <= 1, "grazing within rounding at most"
    assert found.same.overall.share >= 0.998 and found.same.overall.kappa >= 0.99
    assert found.same.closing.share >= 0.99
    assert found.own.overall.share >= 0.987 and found.own.overall.kappa >= 0.95
    assert found.same.width.median_abs_m < 2.5e-4
    assert np.median(found.drift.moved_m) < 1e-4


def test_stored_lifts_near_the_friction_limit_end_as_coulomb_says():
    """28 of 44 did while fingers were dragged by what they held."""
    folder = os.environ.get("GRASPMILL_COULOMB")
    if not folder:
        pytest.skip("GRASPMILL_COULOMB is not set: a dataset of scripts/crosscheck/coulomb.toml")
    pairs = coulomb.compare(dataset.read(Path(folder), None), None)
    right = sum(lift.outcome == found for lift, found in pairs)
    assert len(pairs) >= 30 and {found for _, found in pairs} == {"held", "slipped"}
    assert right >= 0.9 * len(pairs), f"{right} of {len(pairs)}"


def test_the_report_holds_both_modes(tmp_path, capsys):
    files = {end: tmp_path / f"report.{end}" for end in ("md", "json")}
    assert cli.main([str(DATASET), "--scenes", "1", "--engine", "mujoco", f"--report={files['md']}", f"--json={files['json']}"]) == 0
    text, found = files["md"].read_text(), json.loads(files["json"].read_text())
    assert "mujoco, same gate |" in text and "mujoco, own approach |" in text and text.startswith(capsys.readouterr().out.rstrip())
    assert found["engines"]["mujoco"]["same_gate"]["overall"]["count"] == found["attempts"] > 20
