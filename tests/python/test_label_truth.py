"""scripts/label_truth.py: its scores against closed forms and SciPy, the frames of others, and a page of made-up labels."""

import json
from itertools import product

import numpy as np
import pytest
from scipy.optimize import minimize

import label_truth
from crosscheck import passes
from crosscheck.pose import Pose, quat_from_vector
from crosscheck.scores import auc, auc_within, brier, gain, without_own_group

DOWN = np.array([1.0, 0.0, 0.0, 0.0])
# Where the made-up object stands on the board, turned about the vertical.
STANDS = Pose(np.array([0.3, -0.1, 0.02]), quat_from_vector(np.array([0.0, 0.0, 0.8])))
AXES = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


def numbers(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scores with ties, what happened, and three groups."""
    rng = np.random.default_rng(seed)
    score, groups = rng.integers(0, 12, 90) / 11, np.repeat(["a", "b", "c"], 30)
    return score, (rng.random(90) < 0.2 + 0.6 * score).astype(float), groups


def test_auc_is_the_share_of_pairs_in_the_right_order():
    score, truth, groups = numbers()
    pairs = [(a > b) + (a == b) / 2 for a, b in product(score[truth == 1], score[truth == 0])]
    assert auc(truth, score) == pytest.approx(np.mean(pairs), abs=1e-12)
    assert (auc(truth, truth), auc(truth, -truth), auc(truth, np.zeros(90))) == (1, 0, 0.5)
    assert np.isnan(auc(np.ones(4), np.arange(4)))
    own = [auc(truth[groups == one], score[groups == one]) for one in "abc"]
    assert auc_within(truth, score, groups) == pytest.approx(np.mean(own))
    # What tells groups apart says nothing within them; one without pairs does not count.
    assert auc_within(truth, np.unique(groups, return_inverse=True)[1], groups) == 0.5
    assert auc_within(np.append(truth, [1, 1]), np.append(score, [0, 0]), np.append(groups, ["d", "d"])) == pytest.approx(np.mean(own))


def test_brier_is_the_mean_square():
    assert brier(np.array([1.0, 0.0, 1.0]), np.array([1.0, 0.5, 0.25])) == pytest.approx((0 + 0.25 + 0.5625) / 3)
    truth = numbers()[1]
    assert brier(truth, np.full(90, truth.mean())) == pytest.approx(truth.mean() * (1 - truth.mean()))


def test_a_gain_is_of_the_same_draws():
    score, truth, groups = numbers()
    things = np.arange(90) % 10
    np.testing.assert_array_equal(gain(truth, score, score, groups, things, 1), 0)
    value, low, high = gain(truth, truth, score, groups, things, 1)
    assert value == pytest.approx(1 - auc_within(truth, score, groups)) and 0 < low < value < high


def test_nobody_learns_from_the_planner_that_is_judged():
    score, truth, groups = numbers()
    features = np.column_stack([score, np.random.default_rng(1).normal(3, 5, 90), np.ones(90)])
    found = without_own_group(features, truth, groups)
    scaled = (features - features.mean(axis=0)) / [*features.std(axis=0)[:2], 1]

    def loss(weights: np.ndarray) -> float:
        logit, seen = scaled[groups != "b"] @ weights[:3] + weights[3], truth[groups != "b"]
        return float(np.sum(np.logaddexp(0, logit) - seen * logit) + weights[:3] @ weights[:3] / 2)

    best = minimize(loss, np.zeros(4), tol=1e-10).x
    np.testing.assert_allclose(found[groups == "b"], 1 / (1 + np.exp(-scaled[groups == "b"] @ best[:3] - best[3])), atol=1e-4)
    other = without_own_group(features, np.where(groups == "b", 1 - truth, truth), groups)
    np.testing.assert_array_equal(other[groups == "b"], found[groups == "b"])
    assert np.abs(other - found)[groups != "b"].min() > 1e-3


def cube(path) -> None:
    """A cube of 40 mm as binary PLY."""
    corners = np.array(list(product((-0.02, 0.02), repeat=3)), dtype="<f4")
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([(3, face) for a, b, c, d in quads for face in ((a, b, c), (a, c, d))], dtype="u1, (3,)<i4")
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 8\n{axes}element face 12\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + corners.tobytes() + faces.tobytes())


# Planner, how far the grasp is beside the cube in metres, whether the robot held it.
ATTEMPTS = [
    ("panda-gpd", 0.0, 1), ("panda-gpd", 0.2, 0), ("panda-gpd", 0.0, 1),
    ("other", 0.2, 0), ("other", 0.2, 1), ("other", 0.0, 1), ("other", 0.2, 0),
]  # fmt: skip


@pytest.fixture
def truth(tmp_path):
    """Made-up truth: a cube of the robot's and one of ACRONYM's."""
    folder = tmp_path / "truth"
    (folder / "robot/meshes").mkdir(parents=True)
    (folder / "acronym").mkdir()
    cube(folder / "robot/meshes/cube.ply")
    cube(folder / "acronym/mug-cube.ply")
    columns = [f"board_from_{of}_{axis}" for of in ("hand", "object") for axis in AXES]
    lines = [",".join(["planner", "layout", "object", "mass_kg", *columns, "held"])]
    for planner, beside_m, held in ATTEMPTS:
        # The frame of this planner is 8.9 mm behind the tips.
        behind_m = 0.0089 if planner == "panda-gpd" else 0.0
        hand = STANDS.of(Pose(np.array([beside_m, 0, behind_m]), DOWN))
        values = [number for pose in (hand, STANDS) for number in (*pose.position_m, *pose.quat_xyzw)]
        lines.append(",".join(map(str, [planner, 0, "cube", 0.1, *values, held])))
    (folder / "robot/attempts.csv").write_text("\n".join(lines))
    hands = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (4, 1, 1))
    hands[:, :3, 3] = [[0, 0, 0.1122], [0.2, 0, 0.1122], [0, 0.005, 0.1122], [0.2, 0.01, 0.1122]]
    np.savez(folder / "acronym/mug-cube.npz", hand=hands, held=[1, 0, 1, 0])
    (folder / "acronym/objects.json").write_text(json.dumps([{"name": "mug-cube", "kind": "mug"}]))
    return folder


def test_the_frames_of_others_are_ours(truth):
    [robot], [acronym] = label_truth.of_robot(truth / "robot"), label_truth.of_acronym(truth / "acronym")
    beside = {(row["planner"], row["held"]) for row, pose in zip(robot.rows, robot.poses) if abs(pose.position_m[0]) > 0.1}
    assert beside == {("panda-gpd", "0"), ("other", "0"), ("other", "1")} and robot.held.sum() == 4
    for pose in (*robot.poses, *acronym.poses):
        np.testing.assert_allclose(pose.position_m[2], 0, atol=1e-9)
        np.testing.assert_allclose(pose.rotation[:, 2], [0, 0, -1], atol=1e-9)
    # ACRONYM's gripper closes along x, ours along y.
    np.testing.assert_allclose([abs(pose.rotation[:, 1]) for pose in acronym.poses], [[1, 0, 0]] * 4, atol=1e-9)
    assert [bool(held) for held in acronym.held] == [pose.position_m[0] < 0.1 for pose in acronym.poses]
    corners, triangles = label_truth.read_ply(robot.mesh)
    assert np.ptp(corners, axis=0) == pytest.approx([0.04] * 3) and triangles.shape == (12, 3) and triangles.max() == 7


def test_without_labels_of_others_it_says_so(tmp_path, capsys):
    assert label_truth.main([str(tmp_path)]) == 78
    assert f"{tmp_path} holds no labels of others: robot/attempts.csv is missing" in capsys.readouterr().err


def test_a_page_is_made_and_made_again_from_what_is_kept(truth, tmp_path, monkeypatch):
    pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
    text = label_truth.THINGS.read_text().split("\n[[object]]")
    two = tmp_path / "two.toml"
    two.write_text("\n[[object]]".join([text[0], text[1], text[7]]))
    monkeypatch.setattr(label_truth, "THINGS", two)
    words = [str(truth), "--grasps", "4", "--out", str(tmp_path / "out"), "--report", str(tmp_path / "page.md")]
    assert label_truth.main(words) == 0
    page = (tmp_path / "page.md").read_text()
    assert "Our label says how 85.7 % of 7 grasps of a real robot ended" in page
    assert "| robot | 7 | 0.857 | 0.720 [" in page and "| acronym | 4 | 1.000 | 1.000 [" in page and "| things | 8 |" in page
    assert "| panda-gpd | 0.667 | 0.667 |" in page and "| other | 0.500 | 0.250 |" in page and "| mug | 0.500 | 0.500 |" in page
    assert "| light |" in page and "| heavy |" in page and "| combination |" in page
    monkeypatch.setattr(passes, "same_gate", None)
    assert label_truth.main(words) == 0 and (tmp_path / "page.md").read_text() == page
