"""The Python package as it is installed: the label oracle, scenes, datasets, plans, pages, the programs, and what is refused."""

import functools
import http.server
import json
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from grasp_sets import BOX_MESH, BOXED as scene, CAMERA, DOWN, graspmill, points_of, refused
from programs import DATASET, packaged, planned_view  # noqa: E402

CENTRE = (0.15, 0.15, 0.075, 0, 0, 0, 1)


@pytest.fixture(scope="module")
def dataset():
    return graspmill.Dataset(DATASET)


def test_it_is_the_installed_wheel_and_not_the_source_tree():
    assert "site-packages" in graspmill.__file__


def test_stored_attempts_end_bit_for_bit_as_stored_on_any_number_of_threads(dataset):
    names = ("outcome", "width_m", "hit", "hit_object", "target")
    for stored in dataset:
        for threads in (None, 1, 3):
            target = stored.outcomes.target
            now = graspmill.execute(stored.scene, stored.workspace_from_grasp, targets=target, threads=threads)
            for name in names:
                old, new = getattr(stored.outcomes, name), getattr(now, name)
                assert old.dtype == new.dtype and old.tobytes() == new.tobytes(), name


def test_a_box_between_the_fingers_is_held_and_one_turned_away_is_not():
    turned = DOWN.copy()
    turned[:3, :2] = DOWN[:3, :2] @ [[0, -1], [1, 0]]
    beside, high, low = np.tile(DOWN, (3, 1, 1))
    beside[0, 3], high[2, 3], low[:3, 3] = 0.25, 0.16, (0.25, 0.15, 0.045)
    told = graspmill.execute(scene, [DOWN, turned, beside, high])
    assert told.held[:2].all() and told.names[2:] == ["empty", "empty"]
    # Along y it is 60 mm wide, along x 40.
    assert np.allclose(told.width_m[:2], [0.06, 0.04], atol=1e-3)
    assert graspmill.HITS[graspmill.execute(scene, [low]).hit[0]] == "table"


def test_matrices_and_quaternions_are_the_same_poses():
    rng = np.random.default_rng(1)
    rotations = np.linalg.qr(rng.normal(size=(200, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    matrices = np.tile(np.eye(4), (200, 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotations, rng.uniform(0.0, 0.3, (200, 3))
    rows = graspmill._arrays.poses("x", matrices)
    assert np.abs(graspmill._arrays.matrices(rows) - matrices).max() < 1e-6
    axes = np.array([np.diag(signs) for signs in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])], dtype=float)
    assert np.allclose(np.abs(graspmill._arrays.quaternions(axes)), np.eye(4)[[3, 0, 1, 2]])


def test_another_gripper_and_other_settings_decide():
    # It opens 50 mm, the box is 60 mm wide.
    assert graspmill.execute(scene, [DOWN], gripper="slim_jaw_50").names == ["approach_collision"]
    slippery = graspmill.Scene([graspmill.Object.cuboid((0.04, 0.06, 0.05), CENTRE, mass_kg=5.0, friction=0.1)])
    assert graspmill.execute(slippery, [DOWN]).names == ["slipped"]
    for engine in ("stepper", "rapier"):
        assert graspmill.execute(scene, [DOWN], settings={"physics.engine": engine}).held[0]


def test_a_mesh_rests_where_it_falls_and_is_held():
    box = graspmill.Object.mesh(BOX_MESH, (0.13, 0.125, 0.055), name="box")
    assert np.allclose(box.extents_m, [0.04, 0.05, 0.06]) and np.isclose(box.mass_kg, 0.06, rtol=1e-3)
    scene = graspmill.Scene([box]).settle()
    rest = scene.objects[0].workspace_from_object
    assert np.allclose(rest[:3, 3], [0.15, 0.15, 0.08], atol=1e-3) and np.allclose(rest[:3, :3], np.eye(3), atol=1e-3)
    grasp = DOWN.copy()
    grasp[2, 3] = 0.08
    assert graspmill.execute(scene, [grasp]).held[0]
    assert len(graspmill.Scene([box]).settle(drop=True)) == 1


@pytest.mark.filterwarnings("ignore:.*leave its surface")
def test_cameras_see_the_mesh_and_not_its_parts():
    down, turn = (angle.ravel() for angle in np.meshgrid(np.linspace(0, np.pi, 49), np.linspace(0, 2 * np.pi, 97), indexing="ij"))
    corners = 0.03 * np.stack([np.sin(down) * np.cos(turn), np.sin(down) * np.sin(turn), np.cos(down)], axis=1)
    first = (97 * np.arange(48)[:, None] + np.arange(96)).reshape(-1, 1)
    faces = np.concatenate([first + [0, 97, 98], first + [0, 98, 1]])
    ball = graspmill.Object.mesh((corners, faces), (0.15, 0.15, 0.1), corners_max=8, tolerance_m=0.01)
    camera = graspmill.Camera.look_at((0.15, 0.15, 0.6))

    def beside_the_ball_m(image):
        """How far what is seen above the table is from the surface of the ball."""
        pose = camera.workspace_from_camera
        seen = points_of(image) @ pose[:3, :3].T + pose[:3, 3]
        return np.abs(np.linalg.norm(seen[seen[:, 2] > 0.06] - (0.15, 0.15, 0.1), axis=1) - 0.03)

    image = graspmill.Scene([ball]).render(camera)
    off_m = beside_the_ball_m(image)
    assert len(off_m) > 2000 and off_m.max() < 1e-4
    assert np.array_equal(graspmill.Scene([pickle.loads(pickle.dumps(ball))]).render(camera), image)
    hull = graspmill.Object.mesh((corners, faces), (0.15, 0.15, 0.1), corners_max=8, parts_max=1)
    assert beside_the_ball_m(graspmill.Scene([hull]).render(camera)).max() > 1e-3


def test_depth_images_and_tsdf_are_those_of_the_generator(dataset):
    camera = graspmill.Camera.look_at((0.15, 0.15, 0.6))
    depth = scene.render(camera)
    assert depth.dtype == np.float32 and depth.shape == (480, 640)
    assert np.isclose(depth[240, 320], 0.5, atol=1e-4) and np.isclose(depth[5, 5], 0.55, atol=1e-4)
    stored = dataset[0]
    assert np.abs(stored.scene.tsdf(stored.cameras) - stored.tsdf).max() < 1e-3
    images = stored.depth_images()
    assert len(images) == len(stored.cameras)
    assert all(np.allclose(image, stored.scene.render(camera), atol=1e-5) for image, camera in zip(images, stored.cameras))


def test_depth_images_have_the_noise_of_the_datasets_sensor(tmp_path):
    config = Path(__file__).parents[2] / "configs/generate/judge.toml"
    settings = {"sensor.noise": ["d435"], "sensor.noise_weights": [1.0], "shares.judged": 0.0, "shares.proposals": 0.4, "view_kinds": []}
    dataset = graspmill.generate(tmp_path / "data", config, shards=1, attempts=60, seed=31, settings=settings)
    stored = dataset[0]
    images = stored.depth_images()
    assert all(np.array_equal(image, again) for image, again in zip(images, stored.depth_images()))
    for image, camera in zip(images, stored.cameras):
        off_m = np.abs(image - stored.scene.render(camera))[image > 0]
        assert 0 < np.median(off_m) < 0.01
    tsdf = graspmill.tsdf(images, stored.cameras, resolution=64, size_m=0.48)
    assert np.abs(tsdf - stored.tsdf).mean() < 0.05


def test_cameras_of_opengl_look_the_other_way():
    ours = graspmill.Camera.look_at((0.1, -0.3, 0.5))
    theirs = ours.workspace_from_camera @ np.diag([1, -1, -1, 1])
    same = graspmill.Camera(640, 480, 540.0, 540.0, 320.0, 240.0, theirs, convention="opengl")
    assert np.allclose(same.workspace_from_camera, ours.workspace_from_camera)


def test_a_plan_is_the_programs_plan_and_its_grasps_hold(planner, tmp_path):
    camera, depth = CAMERA, scene.render(CAMERA)
    plan = planner.plan(depth, camera, explain=True)
    assert len(plan) > 5 and plan[0].quality > 0.9 and plan.reason is None
    assert graspmill.execute(scene, plan.workspace_from_grasp).held.mean() > 0.8
    assert planned_view(tmp_path, depth, camera, "--explain") == json.loads(plan.to_json())
    avoided = planner.plan(depth, camera, avoid=plan.workspace_from_grasp[:1])
    assert np.linalg.norm(avoided[0].workspace_from_grasp[:3, 3] - plan[0].workspace_from_grasp[:3, 3]) > 1e-6
    assert "<canvas" in plan.page().html and plan.cloud().shape[1] == 3
    labels = plan.labels()
    assert len(labels) == len(plan.cloud()) and labels.min() == -2
    assert [np.sum(labels == number) for number in range(labels.max() + 1)] == [thing["point_count"] for thing in plan.answer["objects"]]
    empty = planner.plan_tsdf(np.zeros((40, 40, 40)))
    assert not len(empty) and empty.reason and empty.workspace_from_grasp.shape == (0, 4, 4)
    turned = planner.plan_cloud(plan.cloud(), eyes_m=[(0.15, -0.2, 0.5)], base_from_workspace=np.eye(4))
    assert np.allclose(turned[0].base_from_grasp, turned[0].workspace_from_grasp, atol=1e-6)


def test_threads_share_a_planner(planner, dataset):
    stored = dataset[1]
    want = planner.plan_tsdf(stored.tsdf).to_json()
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda _: planner.plan_tsdf(stored.tsdf).to_json(), range(4))) == [want] * 4


def test_tables_are_arrow_streams(dataset):
    polars, pyarrow = pytest.importorskip("polars"), pytest.importorskip("pyarrow")
    attempts, scenes = polars.DataFrame(dataset.attempts()), polars.DataFrame(dataset.scenes(grids=True))
    assert len(attempts) == dataset.attempt_count == 600 and attempts["label"].sum() == dataset.positive_count
    assert len(scenes) == dataset.scene_count and "tsdf" in scenes.columns
    assert "tsdf" not in pyarrow.table(dataset.scenes()).column_names
    direct = polars.read_parquet(f"{dataset._native.location}/attempts/*.parquet")
    assert attempts.equals(direct)
    assert len(pyarrow.table(dataset.attempts(range(1, 2)))) == 300


def test_a_dataset_goes_on_where_it_was_stopped_and_is_that_of_the_program(tmp_path):
    calls = []

    def interrupt(done, total, held):
        calls.append((done, total, held))
        if len(calls) == 2:
            raise KeyboardInterrupt

    settings = {"objects.counts": [2, 3], "objects.count_weights": [1.0, 1.0]}
    arguments = {"shards": 2, "attempts": 3_000, "seed": 3, "settings": settings}
    with pytest.raises(KeyboardInterrupt):
        graspmill.generate(tmp_path / "a", progress=interrupt, **arguments)
    with pytest.raises(graspmill.IncompleteError):
        graspmill.Dataset(tmp_path / "a")
    made = graspmill.generate(tmp_path / "a", **arguments)
    assert made.verify() == []
    sets = ["--set", "objects.counts=[2, 3]", "--set", "objects.count_weights=[1.0, 1.0]"]
    packaged("generate", "--shards", 2, "--attempts", 3_000, "--seed", 3, "--out", tmp_path / "b", *sets)
    for file in sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*.parquet")):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_pages_show_in_notebooks(dataset, planner):
    stored = dataset[2]
    for page in (dataset.page(), stored.page(), stored.replay(1)):
        assert page._repr_html_().startswith("<iframe") and page.html.lstrip().lower().startswith("<!doctype html>")
    assert planner.plan_tsdf(stored.tsdf)._repr_html_().startswith("<iframe")
    assert dataset.report()["labels"]["attempts"] == 600


def test_the_program_is_there_under_all_its_names(tmp_path):
    def said(*words, code=0):
        done = subprocess.run([Path(sys.executable).with_name("graspmill"), *words], capture_output=True, text=True)
        assert done.returncode == code, done
        return done.stdout

    commands = said("--help")
    for command in ("generate", "dataset", "fit", "plan", "experiment"):
        assert f"\n  {command} " in commands
    assert "Usage: graspmill plan" in said("plan", "--help")
    said("dataset", "browse", DATASET, "--scenes", "1", "--out", tmp_path / "pages")
    assert list((tmp_path / "pages").glob("scene-*.html"))
    for words, code in (((), 2), (("grinder",), 2), (("dataset", "verify", tmp_path), 78)):
        said(*words, code=code)


def in_a_child(work):
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=lambda: queue.put(work()))
    child.start()
    told = queue.get(timeout=60)
    child.join(60)
    assert child.exitcode == 0
    return told


def test_what_shares_work_does_so_in_a_forked_process_too(dataset):
    camera, stored, pyarrow = graspmill.Camera.look_at((0.15, 0.15, 0.6)), dataset[3], pytest.importorskip("pyarrow")

    def done():
        depth = scene.render(camera)
        plans = [graspmill.Planner(config).plan(depth, camera).to_json() for config in ("judge", "paper", "vgn")]
        crops = graspmill.grasp_crops(stored.tsdf, stored.workspace_from_grasp)
        held = graspmill.execute(stored.scene, stored.workspace_from_grasp).held.sum()
        rows = len(pyarrow.table(graspmill.Dataset(DATASET).attempts()))
        return plans, len(stored.replay(0).html), graspmill.tsdf([depth], [camera]).sum(), crops.crop.sum(), held, rows

    # First in the parent, whose threads the child does not have.
    assert done() == in_a_child(done)


def test_many_calls_keep_no_memory():
    def resident_mb():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    def calls(count):
        for _ in range(count):
            graspmill.execute(scene, [DOWN], threads=1)

    calls(500)
    before = resident_mb()
    calls(4_000)
    assert resident_mb() - before < 2.0


def test_wrong_arguments_are_named_with_rule_and_value(planner, dataset):
    box, camera = graspmill.Object.cuboid, graspmill.Camera.look_at((0.15, 0.15, 0.6))
    depth = scene.render(camera)
    reflection, scaled, nothing = np.diag([1.0, 1.0, -1.0, 1.0]), 2 * np.eye(4), np.full((1, 7), np.nan)
    refused(r"grasps must have the shape .*got \[3, 1\]", lambda: graspmill.execute(scene, np.zeros((3, 1))))
    refused("grasps must be rigid.*reflection", lambda: graspmill.execute(scene, [reflection]))
    refused("grasps must be rigid.*got 3 in pose 0", lambda: graspmill.execute(scene, [scaled]))
    refused("grasps must be finite", lambda: graspmill.execute(scene, nothing))
    refused("dtype <U1", lambda: graspmill.execute(scene, [["a"] * 7]))
    refused("length 1", lambda: graspmill.execute(scene, np.zeros((1, 7))))
    refused("targets .*below the number of objects, 1", lambda: graspmill.execute(scene, [DOWN], targets=[3]))
    refused("targets .*shape", lambda: graspmill.execute(scene, [DOWN], targets=[0, 0]))
    refused("threads must be between 1", lambda: graspmill.execute(scene, [DOWN], threads=0))
    refused("gripper must be .*got claw", lambda: graspmill.execute(scene, [DOWN], gripper="claw"))
    refused("no key physics.glue", lambda: graspmill.execute(scene, [DOWN], settings={"physics.glue": 1}))
    refused("number, a string", lambda: graspmill.execute(scene, [DOWN], settings={"physics.engine": object()}))
    refused("no objects", lambda: graspmill.execute(graspmill.Scene([]), [DOWN]))
    refused("scene must be", lambda: graspmill.execute("scene", [DOWN]))
    refused("are its lengths in metres", lambda: box((40, 60, 50), CENTRE))
    refused("gripper must be a graspmill.Gripper, a name or a path", lambda: graspmill.execute(scene, [DOWN], gripper=3))
    refused("settings must be a dict", lambda: graspmill.execute(scene, [DOWN], settings=[1]))
    refused("threads must be a whole number", lambda: graspmill.execute(scene, [DOWN], threads=np.array([1, 2])))
    refused("mass_kg must be a number", lambda: box((0.1, 0.1, 0.1), CENTRE, mass_kg=10**400))
    refused("objects must be a list", lambda: graspmill.Scene(scene.objects[0]))
    refused("config must be a path", lambda: graspmill.Planner(b"judge"))
    refused("must be a path or a name", lambda: graspmill.Dataset(3))
    refused("progress must be", lambda: graspmill.generate("/tmp/never", progress=1))
    refused("mass_kg must be between", lambda: box((0.1, 0.1, 0.1), CENTRE, mass_kg=-1))
    refused("shape must be one of", lambda: graspmill.Object.solid("sphere", (0.1, 0.1, 0.1), CENTRE))
    refused("extents", lambda: box((0.1, 0.1, -0.1), CENTRE))
    refused("objects must be", lambda: graspmill.Scene([1]))
    refused("faces", lambda: graspmill.Object.mesh((np.zeros((3, 3)), [[0, 1, 7]]), CENTRE))
    refused("mesh", lambda: graspmill.Object.mesh((np.zeros((3, 3)), [[0, 1, 2]]), CENTRE))
    refused("within 100 m of their origin, got 10000", lambda: graspmill.Object.mesh((BOX_MESH[0] + 1e4, BOX_MESH[1]), CENTRE))
    refused("float dtype.*divide", lambda: planner.plan((1000 * depth).astype(np.uint16), camera))
    refused("shape .height, width.", lambda: planner.plan(depth.T, camera))
    refused("as many cameras", lambda: planner.plan([depth, depth], [camera]))
    refused(r"shape \[N, 3\].*transposed", lambda: planner.plan_cloud(np.zeros((3, 100))))
    refused("between 0 and 1", lambda: planner.plan_tsdf(np.full((40, 40, 40), 2.0)))
    refused("expected one of.*: policy", lambda: planner.plan(depth, camera, policy="random"))
    refused("grasps_max must be between 1", lambda: planner.plan(depth, camera, grasps_max=0))
    refused("workspace_from_camera must be a pose", lambda: graspmill.Camera(640, 480, 1.0, 1.0, 0.0, 0.0, [[1], [1, 2]]))
    refused("convention", lambda: graspmill.Camera(640, 480, 1.0, 1.0, 0.0, 0.0, np.eye(4), convention="ros"))
    refused("trained for|failed to read", lambda: graspmill.Planner("nowhere.toml"))
    refused("scene_id must be between 0 and 9", lambda: dataset.scene(10))
    refused("shards must be a range", lambda: dataset.attempts(range(5)))
    refused("no dataset here", lambda: graspmill.Dataset("/nowhere/at/all"))
    refused("shards must be", lambda: graspmill.generate("/tmp/never", shards=0))


def test_importing_it_is_quick_and_needs_numpy_alone():
    code = "import sys, graspmill; print([m for m in ('torch', 'pyarrow', 'pandas', 'polars', 'tqdm') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def two_boxes():
    left, right = ((x, 0.15, 0.075, 0, 0, 0, 1) for x in (0.09, 0.21))
    scene = graspmill.Scene([graspmill.Object.cuboid((0.04, 0.05, 0.05), pose) for pose in (left, right)])
    return scene, CAMERA, scene.render(CAMERA)


def test_a_target_is_the_object_at_a_point_or_what_a_mask_shows(planner):
    scene, camera, depth = two_boxes()
    alone = graspmill.Scene(scene.objects[:1]).render(camera)
    mask = (np.abs(alone - depth) < 1e-5) & (np.abs(alone - graspmill.Scene([]).render(camera)) > 1e-4)
    assert 100 < mask.sum() < 20_000
    both = planner.plan(depth, camera)
    assert {int(target) for target in graspmill.execute(scene, both.workspace_from_grasp).target} == {0, 1}
    for limits in ({"target_m": (0.09, 0.15, 0.09)}, {"mask": mask}, {"mask": mask.astype(np.uint8) * 255}):
        plan = planner.plan(depth, camera, **limits)
        outcomes = graspmill.execute(scene, plan.workspace_from_grasp)
        assert len(plan) > 3 and set(outcomes.target) == {0} and outcomes.held.mean() > 0.7, limits.keys()
    nothing = planner.plan(depth, camera, target_m=(0.15, 0.02, 0.1))
    assert not len(nothing) and "by target" in nothing.reason
    assert not len(planner.plan(depth, camera, mask=np.zeros_like(mask)))


@pytest.mark.parametrize("config", ["judge", "paper"])
def test_limits_of_the_grippers_way_are_kept(config):
    """`planner/src/limits.rs` has what each refuses, and how that is told."""
    planner, (scene, camera, depth) = graspmill.Planner(config), two_boxes()
    poses = planner.plan(depth, camera).workspace_from_grasp
    for limits, keeps in (
        ({"approach": ((0, 0, -2), 0.3)}, lambda pose: np.arccos(-pose[2, 2]) <= 0.3 + 1e-4),
        ({"avoid_objects": [(*poses[0][:3, 3], 0.05)]}, lambda pose: np.linalg.norm(pose[:3, 3] - poses[0][:3, 3]) >= 0.05 - 1e-6),
        ({"reach": ((0, 0, 0), (0.15, 0.3, 0.3))}, lambda pose: pose[0, 3] <= 0.15),
        ({"keep_out": [(0, 1, 0, 0.05), (0, -1, 0, -0.25)]}, lambda pose: 0.05 <= pose[1, 3] <= 0.25),
    ):
        kept = planner.plan(depth, camera, **limits).workspace_from_grasp
        assert len(kept) and all(map(keeps, kept)), limits
        assert not all(map(keeps, poses)) or "keep_out" in limits
    assert not len(planner.plan(depth, camera, approach=((0, 0, 1), 0.1)))


def test_a_function_says_which_grasps_will_do(planner):
    camera, image, asked = CAMERA, scene.render(CAMERA), []

    def accept(workspace_from_grasp):
        asked.append(workspace_from_grasp)
        return workspace_from_grasp[2, 2] < -0.95  # from above

    plan = planner.plan(image, camera, accept=accept)
    assert len(plan) > 3 and (plan.workspace_from_grasp[:, 2, 2] < -0.95).all()
    # It is asked about the very poses that are offered, not about their half turns.
    assert all(any(np.allclose(pose, one, atol=1e-6) for one in asked) for pose in plan.workspace_from_grasp)
    assert len(asked) > 100 and all(pose.shape == (4, 4) and abs(np.linalg.det(pose[:3, :3]) - 1.0) < 1e-5 for pose in asked)
    everything = planner.plan(image, camera)
    assert planner.plan(image, camera, accept=lambda _: True).to_json() == everything.to_json()
    assert "by accept" in planner.plan(image, camera, accept=lambda _: False).reason
    for limit, match in ((lambda _: 1 / 0, "division"), (lambda pose: pose["x"], "indices")):
        with pytest.raises((ZeroDivisionError, IndexError), match=match):
            planner.plan(image, camera, accept=limit)
    for value in (None, 1, "yes", [True]):
        with pytest.raises(TypeError, match="accept must return True or False, got "):
            planner.plan(image, camera, accept=lambda _: value)
    refused("accept must be a function", lambda: planner.plan(image, camera, accept=3))
    # All of a search at once gives the same plan, in few calls.
    counts = []

    def batch(poses):
        counts.append(len(poses))
        return poses[:, 2, 2] < -0.95

    assert planner.plan(image, camera, accept_batch=batch).to_json() == plan.to_json()
    assert sum(counts) == len(asked) and len(counts) < 20
    for wrong, match in ((lambda poses: poses, "must be bool"), (lambda poses: [True], "must be bool"), (3, "a function of poses")):
        refused(match, lambda: planner.plan(image, camera, accept_batch=wrong))
    refused("must not both be given", lambda: planner.plan(image, camera, accept=accept, accept_batch=batch))
    # It may use the package itself, from two threads at once.
    held = lambda pose: bool(graspmill.execute(scene, pose[None]).held[0])  # noqa: E731
    with ThreadPoolExecutor(2) as pool:
        plans = list(pool.map(lambda _: planner.plan(image, camera, accept=held), range(2)))
    assert all(graspmill.execute(scene, plan.workspace_from_grasp).held.all() for plan in plans)


def test_limits_are_the_programs(planner, tmp_path):
    scene, camera, depth = two_boxes()
    mask = np.zeros(depth.shape, bool)
    mask[:, :320] = True
    np.save(tmp_path / "mask.npy", mask)
    words = ["--approach", "0,0,-1,0.4", "--keep-out", "0,1,0,0.03", "--reach", "0,0,0,0.3,0.3,0.3"]
    limits = {"approach": ((0, 0, -1), 0.4), "keep_out": [(0, 1, 0, 0.03)], "reach": np.array([[0, 0, 0], [0.3] * 3])}
    ours = planner.plan(depth, camera, mask=mask, **limits)
    assert planned_view(tmp_path, depth, camera, *words, mask="mask.npy") == json.loads(ours.to_json()) and len(ours)


def test_wrong_limits_are_refused(planner):
    scene, camera, depth = two_boxes()
    refused("as many masks", lambda: planner.plan([depth], [camera], mask=[]))
    refused("mask 0 must be bool or uint8", lambda: planner.plan(depth, camera, mask=depth))
    refused("must not both", lambda: planner.plan(depth, camera, mask=depth > 0, target_m=(0, 0, 0)))
    refused("approach must be", lambda: planner.plan(depth, camera, approach=1.0))
    refused("approach.angle_rad_max must be between", lambda: planner.plan(depth, camera, approach=((0, 0, -1), 4.0)))
    refused(r"keep_out\[0\] must be a direction", lambda: planner.plan(depth, camera, keep_out=[(0, 0, 0, 1)]))
    refused("keep_out must have the shape", lambda: planner.plan(depth, camera, keep_out=[(0, 0, 1)]))
    refused("reach.high_m must be at least low_m", lambda: planner.plan(depth, camera, reach=((1, 1, 1), (0, 0, 0))))


def test_a_stored_scene_keeps_its_gripper_and_laws_when_a_setting_is_given(tmp_path):
    settings = {"gripper": "franka_hand", "procedure.pregrasp_distance_m": 0.03, "physics.engine": "rapier"}
    dataset = graspmill.generate(tmp_path / "ds", attempts=60, shards=1, seed=3, settings=settings)
    stored = dataset[0]

    def ends(**more):
        return graspmill.execute(stored.scene, stored.workspace_from_grasp, targets=stored.outcomes.target, **more)

    hold = {"procedure.hold_time_s": 0.26}
    kept, told = ends(settings=hold), ends(settings={**settings, **hold})
    assert kept.outcome.tobytes() == told.outcome.tobytes() and kept.width_m.tobytes() == told.width_m.tobytes()
    assert ends(gripper="franka_hand").outcome.tobytes() == stored.outcomes.outcome.tobytes()
    assert (ends(gripper="slim_jaw_50").outcome != stored.outcomes.outcome).any()
    assert len(stored.scene.settle()) == len(stored.scene)


def test_empty_lists_are_none_of_a_thing(planner):
    assert len(graspmill.execute(scene, [])) == 0 and len(graspmill.execute(scene, [], targets=[])) == 0
    camera, depth = CAMERA, scene.render(CAMERA)
    assert planner.plan(depth, camera, avoid=[], keep_out=[]).to_json() == planner.plan(depth, camera).to_json()
    assert planner.plan_cloud([]).reason


def test_planes_of_any_length_are_half_spaces(planner):
    scene, camera, depth = two_boxes()
    one, two = (planner.plan(depth, camera, keep_out=[[0, 0, k, 0.06 * k]]).to_json() for k in (1, 2))
    assert one == two


def test_things_are_equal_to_themselves_alone():
    cameras = [graspmill.Camera.look_at((0.15, y, 0.5)) for y in (-0.2, 0.5)]
    assert cameras[0] == cameras[0] != cameras[1] and len(set(cameras)) == 2
    boxes = [graspmill.Object.cuboid((0.04, 0.06, 0.05), (x, 0.15, 0.075, 0, 0, 0, 1)) for x in (0.1, 0.2)]
    assert boxes[0] != boxes[1] and boxes.index(boxes[1]) == 1


def test_a_dataset_of_a_relative_path_stays_where_it_is_and_can_be_sent_away(dataset, monkeypatch):
    monkeypatch.chdir(DATASET.parent)
    relative = graspmill.Dataset(DATASET.name)
    monkeypatch.chdir("/")
    again = pickle.loads(pickle.dumps(relative))
    assert relative[0].scene_id == 0 and again.id == dataset.id and len(again) == len(dataset)


def test_no_more_threads_than_cores_are_started():
    for threads in range(2, 200):
        graspmill.execute(scene, [DOWN], threads=threads)
    cores = len(os.sched_getaffinity(0))
    assert len(os.listdir("/proc/self/task")) < 40 + cores * cores


def test_a_forked_child_lets_go_of_a_stores_dataset():
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=DATASET)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    url = f"http://127.0.0.1:{server.server_address[1]}"
    inherited = graspmill.Dataset(url)
    assert inherited[0].scene_id == 0

    def child():
        refused("opened again", lambda: inherited.scene(0))
        del inherited._native
        return graspmill.Dataset(url)[0].scene_id

    assert in_a_child(child) == 0
    server.shutdown()
