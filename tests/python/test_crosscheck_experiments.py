"""The cross-check of experiments: hulls and compounds against closed forms, and a report that is known by hand."""

import json
from dataclasses import asdict
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from attempts import DOWN, GRIPPER, PROCEDURE, SOLIDS, TABLE, UPRIGHT, standing

from crosscheck import cli, gate
from crosscheck.attempt import Runner
from crosscheck.compound import Compound, box_of
from crosscheck.contract import Scene, SceneObject
from crosscheck.hull import hull_of
from crosscheck.pose import Pose, angle_between_rad, quat_from_vector
from crosscheck.solid import Solid

# Parts that need no engine are tested without it.
needs_pybullet = pytest.mark.skipif(find_spec("pybullet") is None, reason="pybullet is not installed")


def block(low: tuple, high: tuple) -> np.ndarray:
    """Corners (8, 3) of a cuboid, as single precision has them."""
    return np.array(list(product(*zip(low, high))), dtype=np.float32).astype(float)


# A stem of 40 mm between the fingers, on a foot wider than the open gripper: their hull has no grasp near the foot.
FOOT, STEM = block((-0.03, -0.06, -0.035), (0.03, 0.06, -0.025)), block((-0.015, -0.02, -0.025), (0.015, 0.02, 0.035))
STAND = Compound("stand", (hull_of(FOOT), hull_of(STEM)))
STAND_EXTENTS_M = (0.06, 0.12, 0.07)


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda s: s.kind)
def test_hulls_of_corners_are_the_solids_that_have_them(solid):
    turn = Pose(np.array([0.11, -0.02, 0.05]), quat_from_vector(np.array([0.4, -1.1, 0.7])))
    within = [solid.centroid_m, solid.vertices_m[:2].mean(axis=0), solid.vertices_m[0]]
    points = np.concatenate([within, solid.vertices_m])
    for pose in (Pose(np.zeros(3), UPRIGHT), turn):
        # What a file in single precision holds of it.
        hull = hull_of(pose.apply(points).astype(np.float32))
        assert len(hull.faces) == len(solid.normals) and len(hull.edges) <= len(solid.edges)
        normals = solid.normals @ pose.rotation.T
        assert (hull.normals @ normals.T).max(axis=1) == pytest.approx(np.ones(len(normals)), abs=1e-8)
        assert hull.volume_m3 == pytest.approx(solid.volume_m3, rel=1e-5)
        np.testing.assert_allclose(hull.centroid_m, pose.apply(solid.centroid_m), atol=1e-7)
        inertia = pose.rotation @ np.diag(solid.inertia_kg_m2(2.0)) @ pose.rotation.T
        np.testing.assert_allclose(Compound("one", (hull,)).inertia_kg_m2(2.0), inertia, atol=1e-5 * inertia.max())


@pytest.mark.parametrize(
    "points", [[], [[0, 0]] * 4, block((0, 0, 0), (1, 1, 0)), block((0, 0, 0), (1, 0, 0)), [[0, 0, float("nan")]] * 4]
)
def test_points_without_a_volume_have_no_hull(points):
    with pytest.raises(ValueError):
        hull_of(points)


# A part of a mesh that was imported, in units of 0.1 µm. Three of its corners are on a plane to 1e-6 of its size,
# or not, by the plane.
PART = np.array([
    [124949, -310909, -159425], [592639, -305603, 164741], [38978, -310909, 159410], [491654, -294959, 164741], [38978, -2702, 154111],
    [576673, -273702, 164741], [587278, -61135, 154111], [613908, 7973, -154126], [608547, -300265, -143496], [273776, -172725, -159425],
    [38978, 7942, -148587], [38978, 7942, -159425], [38978, -310909, -159425], [528831, -305603, -143496], [592639, -305603, 74370],
    [597942, -2702, 79701], [268415, 7942, -26535], [263112, 7942, -159425], [597942, 7942, -90315], [613908, 7973, -116906],
    [608547, -300265, -111575], [613908, -39878, -111607], [597942, -257752, 106292], [592639, -71779, 154111], [587278, -8009, 148812],
])


def test_a_part_whose_faces_are_almost_flat_has_a_hull_that_closes():
    hull = hull_of((PART * 1e-7).astype(np.float32))
    corners, edges = len(hull.vertices_m), sum(len(face) for face in hull.faces) / 2
    assert corners == len(PART) and corners - edges + len(hull.faces) == 2
    heights = hull.normals @ hull.vertices_m.T
    offsets = np.array([height[face].max() for height, face in zip(heights, hull.faces, strict=True)])
    assert (heights <= offsets[:, None] + 1e-7).all()


def test_a_dumb_bell_turns_as_parallel_axes_say():
    """Two cubes of side a, d from the middle: m a² / 6 about the line, m (a² / 6 + d²) about any axis across it."""
    side, arm, mass_kg = 0.02, 0.05, 0.4
    line = np.array([2.0, -1.0, 2.0]) / 3
    middle = np.array([0.01, 0.02, -0.03])
    cubes = [hull_of(block((-side / 2,) * 3, (side / 2,) * 3) + middle + sign * arm * line) for sign in (-1, 1)]
    bell = Compound("bell", tuple(cubes))
    assert bell.volume_m3 == pytest.approx(2 * side**3, rel=1e-5)
    moments, frame = bell.principal(mass_kg)
    thin = mass_kg * side**2 / 6
    np.testing.assert_allclose(moments, [thin, thin + mass_kg * arm**2, thin + mass_kg * arm**2], rtol=1e-5)
    np.testing.assert_allclose(frame.position_m, middle, atol=1e-8)
    assert abs(frame.rotation[:, 0] @ line) == pytest.approx(1.0)
    np.testing.assert_allclose(frame.rotation @ np.diag(moments) @ frame.rotation.T, bell.inertia_kg_m2(mass_kg), atol=1e-9)


def test_only_cuboids_are_taken_for_boxes():
    pose = Pose(np.array([0.1, 0.0, -0.02]), quat_from_vector(np.array([0.3, 0.2, -0.9])))
    half = np.array([0.01, 0.02, 0.03])
    at, found = box_of(hull_of(pose.apply(block(-half, half))))
    np.testing.assert_allclose(sorted(found), half, atol=1e-7)
    np.testing.assert_allclose(at.position_m, pose.position_m, atol=1e-7)
    corners = at.apply(block(-found, found))
    nearest = np.linalg.norm(corners[:, None] - pose.apply(block(-half, half)), axis=2).min(axis=1)
    assert nearest.max() < 1e-6
    top = block((-0.01, -0.02, 0.03), (0.01, 0.02, 0.03))
    leaning = np.concatenate([block((-0.01, -0.02, 0.0), (0.01, 0.02, 0.0)), top + [0.002, 0, 0]])
    tapered = np.concatenate([block((-0.01, -0.02, 0.0), (0.01, 0.02, 0.0)), top * [0.9, 0.9, 1]])
    assert [box_of(hull_of(points)) for points in (leaning, tapered, SOLIDS[2].vertices_m)] == [None] * 3


def test_a_finger_may_enter_what_is_between_the_parts():
    grasp = Pose(np.array([0.15, 0.15, 0.075]), DOWN)
    filled = Compound("filled", (hull_of(np.concatenate([FOOT, STEM])),))
    ends = {}
    for name, body, shift in (("open", STAND, 0), ("filled", filled, 0), ("stem", STAND, 0.0191), ("foot", STAND, -0.0141)):
        moved = grasp.moved(np.array([0, shift if name == "stem" else 0, shift if name == "foot" else 0]))
        [verdict] = gate.judge(standing(body, moved), [moved], GRIPPER, PROCEDURE, TABLE.table_z_m)
        ends[name] = (verdict.outcome, verdict.hit)
    hit = ("approach_collision", "target")
    # The jaws are 80 mm apart around 40 mm, and 15 mm above the foot; the clearance is 1 mm.
    assert ends == {"open": (None, None), "filled": hit, "stem": hit, "foot": hit}


@pytest.fixture
def engine():
    pytest.importorskip("pybullet")
    from crosscheck.compound_bullet import CompoundBullet

    made = CompoundBullet()
    yield made
    made.close()


def begun(engine, *things):
    engine.load(Scene(0, list(things), []), GRIPPER, TABLE)
    engine.begin(None, None)


def test_a_compound_stands_where_it_was_put(engine):
    pose = Pose(np.array([0.1, 0.2, 0.3]), quat_from_vector(np.array([0.5, -0.8, 1.9])))
    gamma = Compound("gamma", (hull_of(FOOT + [0.02, 0.01, 0.0]), hull_of(SOLIDS[3].vertices_m + [0, 0, 0.03])))
    begun(engine, SceneObject(gamma, 0.3, 1.0, pose), SceneObject(STAND, 0.2, 1.0, pose))
    np.testing.assert_allclose(engine.positions_m(), [pose.position_m] * 2, atol=1e-6)
    assert max(angle_between_rad(quat, pose.quat_xyzw) for quat in engine.quats_xyzw()) < 1e-5


def test_round_parts_have_no_margin_about_them(engine):
    """PyBullet's own margin of 1 mm would lift the body and hold the fingers apart."""
    cylinder = Solid("cylinder", (0.04, 0.04, 0.06))
    waist = np.where(cylinder.vertices_m[:, 2:] > 0, [1, 1, 0.3], [1, 1, 1]) * cylinder.vertices_m
    upper = np.where(cylinder.vertices_m[:, 2:] < 0, [1, 1, -0.3], [1, 1, 1]) * cylinder.vertices_m
    body, grasp = Compound("can", (hull_of(waist), hull_of(upper))), Pose(np.array([0.15, 0.15, 0.09]), DOWN)
    one = standing(body, grasp, at_m=(0.15, 0.15, 0.08))
    begun(engine, *one.objects)
    for _ in range(120):
        engine.step()
    np.testing.assert_allclose(engine.positions_m(), [[0.15, 0.15, 0.08]], atol=1e-4)
    ended = Runner(engine, one, GRIPPER, PROCEDURE, TABLE).from_closing(one.attempts[0], grasp)
    assert ended.outcome == "held" and ended.width_m == pytest.approx(0.04, abs=4e-4)


@pytest.mark.parametrize("arm_m, stands", [(0.040, True), (0.048, False)])
def test_what_is_heavy_on_one_side_topples(engine, arm_m, stands):
    """A foot 20 mm wide, an arm on top: the centre of mass is 8.3 or 11.2 mm from the foot's middle, which reaches 10 mm."""
    foot, arm = block((-0.01, -0.01, 0.0), (0.01, 0.01, 0.04)), block((-0.01, -0.01, 0.04), (arm_m, 0.01, 0.06))
    post = Compound("post", (hull_of(foot), hull_of(arm)))
    by_hand = (arm_m + 0.01) * (arm_m - 0.01) / 2 / (0.04 + arm_m + 0.01)
    assert post.centroid_m[0] == pytest.approx(by_hand, abs=1e-6) and (by_hand < 0.01) == stands
    begun(engine, SceneObject(post, 0.1, 1.0, Pose(np.array([0.15, 0.15, 0.05]), UPRIGHT)))
    for _ in range(240):
        engine.step()
    angle = angle_between_rad(engine.quats_xyzw()[0], UPRIGHT)
    assert angle < 0.01 if stands else angle > 0.5


def test_a_torque_turns_a_compound_as_its_moments_say(engine):
    """For one step, in free fall, about the vertical: torque over moment times time."""
    import pybullet

    begun(engine, SceneObject(STAND, 0.2, 1.0, Pose(np.array([0.15, 0.15, 2.0]), UPRIGHT)))
    [body], c = engine.bodies, engine.client
    pybullet.applyExternalTorque(body, -1, [0.0, 0.0, 0.01], pybullet.WORLD_FRAME, physicsClientId=c)
    engine.step()
    turning = pybullet.getBaseVelocity(body, physicsClientId=c)[1]
    # Foot and stem about their common vertical axis: m (x² + y²) / 12, by their volumes of 72,000 each.
    inertia = 0.1 * (0.06**2 + 0.12**2) / 12 + 0.1 * (0.03**2 + 0.04**2) / 12
    np.testing.assert_allclose(turning, [0, 0, 0.01 / inertia / 240], atol=1e-5)


@pytest.mark.parametrize("mass_kg, outcome", [(2.5, "held"), (4.8, "slipped")])
def test_two_fingers_of_20_n_hold_a_compound_as_coulomb_says(engine, mass_kg, outcome):
    """Two fingers hold 2 · 20 N; the lift adds 6 · 0.1 m / (0.5 s)² to gravity."""
    assert (2 * 20.0 > mass_kg * (9.81 + 2.4)) == (outcome == "held")
    grasp = Pose(np.array([0.15, 0.15, 0.075]), DOWN)
    one = standing(STAND, grasp, mass_kg)
    ended = Runner(engine, one, GRIPPER, PROCEDURE, TABLE).from_closing(one.attempts[0], grasp)
    assert ended.outcome == outcome and ended.width_m == pytest.approx(0.04, abs=3e-4)


CUBOID = {"body": "cuboid", "size_x_m": 0.04, "size_y_m": 0.04, "size_z_m": 0.06, "z_m": 0.08}
STANDING = {"body": "stand", **dict(zip(("size_x_m", "size_y_m", "size_z_m"), STAND_EXTENTS_M)), "z_m": 0.085}
# Round, trial, object, its mass, height of the grasp, its shift along y, our outcome, PyBullet's.
GRASPS = [
    (0, 0, CUBOID, 0.1, 0.080, 0.0, "held", "held"),
    (0, 1, CUBOID, 0.1, 0.160, 0.0, "empty", "empty"),
    (1, 0, CUBOID, 0.1, 0.080, 0.03, "held", "approach_collision"),
    (1, 1, STANDING, 0.1, 0.075, 0.0, "held", "held"),
    (2, 0, STANDING, 4.8, 0.075, 0.0, "slipped", "slipped"),
    (2, 1, CUBOID, 0.1, 0.080, 0.0, "slipped", "held"),
]


def experiment(folder: Path, attempts: list | None = None, objects: list | None = None) -> Path:
    """The folder of an experiment with these rows, or with those of `GRASPS`."""
    folder.mkdir()
    upright, down = (dict(zip(("qx", "qy", "qz", "qw"), quat.tolist())) for quat in (UPRIGHT, DOWN))
    stood, tried = [], []
    for number, trial, body, mass_kg, z_m, y_m, ours, _ in GRASPS:
        # Numbers of objects need not begin with 0: another one stood here, and a second stands aside.
        key = {"round": number, "trial": trial}
        here = {"mass_kg": mass_kg, "friction": 1.0, "x_m": 0.15, "y_m": 0.15, **upright}
        stood += [{**key, "object_id": 4, **here, **CUBOID, "mass_kg": 0.1, "x_m": 0.28}, {**key, "object_id": 2, **here, **body}]
        tried.append({**key, "target_id": 2, "outcome": ours, "hit": "", "x_m": 0.15, "y_m": 0.15 + y_m, "z_m": z_m, **down, "width_m": 0.04})
    # The order of rows does not matter.
    pq.write_table(pa.Table.from_pylist(tried[::-1] if attempts is None else attempts), folder / "attempts.parquet")
    pq.write_table(pa.Table.from_pylist(stood if objects is None else objects), folder / "objects.parquet")
    (folder / "bodies.json").write_text(json.dumps({"stand": {"parts": [{"vertices_m": p.tolist()} for p in (FOOT, STEM)]}}))
    physics = {"engine": "rapier3d", "step_rate_hz": 240.0, "gravity_m_s2": 9.81, "table_friction": 1.0}
    told = {"gripper": asdict(GRIPPER), "procedure": {**vars(PROCEDURE), "more": 1.0}}
    (folder / "run.json").write_text(json.dumps({"protocol": "test", "seeds": [7], "table_z_m": 0.05, "physics": physics, **told}))
    return folder


@needs_pybullet
def test_the_report_is_what_one_counts_by_hand(tmp_path, capsys):
    folder, files = experiment(tmp_path / "run"), [tmp_path / "out" / name for name in ("a.md", "a.json")]
    assert cli.main([str(folder), "--report", str(files[0]), "--json", str(files[1])]) == 0
    text, found = files[0].read_text(), json.loads(files[1].read_text())
    assert text.startswith(capsys.readouterr().out.rstrip())
    assert (found["scenes"], found["attempts"], found["gate_differences"], found["seed"]) == (6, 6, 1, 7)
    same = found["engines"]["pybullet"]["same_gate"]
    assert same["overall"]["disagreeing"] == 2 and same["overall"]["kappa"] == pytest.approx(1 / 3)
    assert same["outcome_share"] == pytest.approx(4 / 6)
    names, counts = same["confusion"]["outcomes"], np.array(same["confusion"]["ours_by_theirs"])
    cells = {(names[i], names[j]): int(counts[i, j]) for i, j in zip(*np.nonzero(counts))}
    assert cells == {
        ("held", "held"): 2, ("empty", "empty"): 1, ("held", "approach_collision"): 1, ("slipped", "slipped"): 1,
        ("slipped", "held"): 1,
    }  # fmt: skip
    closing = same["closing"]
    assert closing["count"] == 5 and closing["kappa"] == pytest.approx((0.8 - 0.48) / 0.52)
    bodies = {body: (part["count"], part["disagreeing"]) for body, part in same["by_shape"].items()}
    assert bodies == {"cuboid": (4, 2), "stand": (2, 0)}
    wrong = [row for row in found["disagreements"] if (row["ours"] == "held") != (row["pybullet same_gate"] == "held")]
    rows = [(row["scene_id"], row["attempt_id"], row["ours"], row["pybullet same_gate"]) for row in wrong]
    assert rows == [(number, trial, ours, theirs) for number, trial, *_, ours, theirs in GRASPS if (ours == "held") != (theirs == "held")]
    assert max(found["engines"]["pybullet"]["drift_m_p50_p99_max"]) < 5e-4


@needs_pybullet
def test_rounds_are_the_first(tmp_path, capsys):
    assert cli.main([str(experiment(tmp_path / "run")), "--scenes", "2"]) == 0
    assert "4 attempts in 4 of 4 scenes" in capsys.readouterr().out


def changed(name: str, **values: object):
    """Damage: these values in the first row of a table; a column is left out where the value is `...`."""

    def damage(folder: Path) -> None:
        table = pq.read_table(folder / name)
        rows = table.to_pylist()
        rows[0].update(values)
        gone = [key for key, value in values.items() if value is ...]
        kept = [{key: value for key, value in row.items() if key not in gone} for row in rows]
        pq.write_table(pa.Table.from_pylist(kept), folder / name)

    return damage


def emptied(name: str):
    return lambda folder: pq.write_table(pq.read_table(folder / name).slice(0, 0), folder / name)


def written(name: str, text: str):
    return lambda folder: (folder / name).write_text(text)


def gone(name: str):
    return lambda folder: (folder / name).unlink()


@pytest.mark.parametrize("damage, words", [
    *((gone(name), f"{name} missing") for name in ("run.json", "attempts.parquet", "objects.parquet")),
    (emptied("attempts.parquet"), "holds no grasps"),
    (emptied("objects.parquet"), "no objects of round 0, trial 0"),
    (written("attempts.parquet", "PAR1"), "attempts.parquet"),
    (written("run.json", "{"), "run.json"),
    (written("run.json", "{}"), "physics"),
    (written("bodies.json", "[]"), "an object is needed"),
    (written("bodies.json", '{"stand": {"parts": []}}'), "no parts"),
    (written("bodies.json", '{"stand": {"parts": [{"vertices_m": [[0, 0, 0]]}]}}'), "a hull needs"),
    (written("bodies.json", "{}"), "unknown shape 'stand'"),
    (changed("attempts.parquet", target_id=...), "no column target_id"),
    (changed("attempts.parquet", target_id=7), "aims at object 7"),
    (changed("attempts.parquet", outcome="won"), "unknown outcome 'won'"),
    (changed("attempts.parquet", qx=0.5), "no pose"),
    (changed("attempts.parquet", round=0, trial=0), "repeat a round and trial"),
    (changed("attempts.parquet", round=None), "without round or trial"),
    (changed("objects.parquet", object_id=2), "object numbers repeat"),
    (changed("objects.parquet", mass_kg=0.0), "mass 0.0 kg"),
    (changed("objects.parquet", body="stand"), "measures"),
    (changed("objects.parquet", size_x_m=None), "round 0, trial 0"),
])  # fmt: skip
def test_damage_is_told(tmp_path, capsys, damage, words):
    folder = experiment(tmp_path / "run")
    damage(folder)
    assert cli.main([str(folder)]) == (78 if words.endswith("missing") else 65)
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("flags", [["--scenes", "0"], ["--scenes", "many"], []])
def test_a_wrong_command_line_is_2(tmp_path, flags):
    with pytest.raises(SystemExit) as stopped:
        cli.main([*([str(tmp_path)] if flags else []), *flags])
    assert stopped.value.code == 2
