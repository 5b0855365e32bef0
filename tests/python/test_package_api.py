"""What editors, type checkers and users of other packages expect of the package."""

import ast
import contextlib
import copy
import inspect
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

from grasp_sets import BOX_MESH, BOXED, CAMERA, graspmill, refused
from programs import ran

EVERY_OPTION = """
import numpy as np
import graspmill
from graspmill import Gripper, Plan, Planner, PlanOptions

def reachable(workspace_from_grasp: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> bool:
    return bool(workspace_from_grasp[2, 3] > 0.06)

camera = graspmill.Camera.from_K(np.array([[540.0, 0.0, 320.0], [0.0, 540.0, 240.0], [0.0, 0.0, 1.0]]), (480, 640), np.eye(4))
planner = Planner("judge", gripper=Gripper.load("franka_hand"))
plan: Plan = planner.plan(
    np.zeros((480, 640)), camera, workspace_size_m=0.3, base_from_workspace=(0.0, 0.0, 0.0), workspace_from_wrist=(0.0, 0.0, 0.0, 1.0),
    policy="paper", check_collisions=True, grasps_max=5, each=True, explain=True, previous=np.eye(4), avoid=np.empty((0, 7)), avoid_objects=[(0.1, 0.1, 0.1, 0.05)], target_m=(0.1, 0.1, 0.1),
    approach=((0.0, 0.0, -1.0), 0.5), keep_out=[[0.0, 1.0, 0.0, 0.05]], reach=[[0.0, 0.0, 0.0], [0.3, 0.3, 0.3]], accept=reachable,
    accept_batch=lambda poses: poses[:, 2, 3] > 0.06)
options: PlanOptions = {"grasps_max": 3}
again = planner.plan_cloud(np.zeros((1, 3)), **options)
cloud = planner.plan_cloud(np.zeros((1, 3)), workspace_from_cloud="table", down=(0.0, 0.0, 1.0), base_from_camera=np.eye(4))
found = planner.plan(np.zeros((480, 640)), graspmill.Camera.from_K(np.eye(3), (480, 640)))
picture: bytes = found.overlay(np.zeros((480, 640, 3), np.uint8))
width_m: float | None = plan[0].width_m
opening_m: float = plan[0].opening_m
best: float = plan[0].quality
some: list[graspmill.Grasp] = again[:2]
dataset = graspmill.generate("grasps", gripper="wsg_50", shards=1)
cleared: graspmill.ExperimentResults = graspmill.experiment("runs/mine", planner=lambda look: planner.plan(look.depths, look.cameras))
cleared = graspmill.experiment("runs/none", planner=lambda look: (look.failed, [0.5]), name="none", progress=print)
"""


@pytest.fixture(scope="module")
def mypy(tmp_path_factory):
    """Runs mypy; what it found out about NumPy is kept from one run to the next. PyTorch takes it minutes to read."""
    pytest.importorskip("mypy")
    cache = tmp_path_factory.mktemp("mypy")
    (cache / "mypy.ini").write_text("[mypy]\n[mypy-torch.*]\nfollow_imports = skip\nfollow_imports_for_stubs = True\n")
    without = ["--config-file", cache / "mypy.ini", "--allow-subclassing-any", "--no-warn-unused-ignores", "--no-warn-return-any"]

    def check(*words, has_torch=False, cwd="/"):
        command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", cache, *([] if has_torch else without), *words]
        return ran(*command, code=None, cwd=cwd)

    return check


def test_types_hold_and_the_stubs_are_those_of_the_module(mypy, factor):
    if factor > 1:
        pytest.importorskip("torch")  # graspmill.torch is checked with its types, too
    checked = mypy("-p", "graspmill", has_torch=factor > 1)
    assert checked.returncode == 0, checked.stdout
    if factor > 1:
        ran(sys.executable, "-m", "mypy.stubtest", "graspmill._native", "--ignore-disjoint-bases", cwd="/")


def test_the_stubs_name_what_the_module_has():
    def compare(nodes, owner):
        named = {getattr(node, "name", None) or getattr(getattr(node, "target", None), "id", "_"): node for node in nodes}
        stubs = {name: node for name, node in named.items() if not name.startswith("_")}
        assert stubs.keys() == {name for name in vars(owner) if not name.startswith("_")}, owner
        for name, node in stubs.items():
            if isinstance(node, ast.ClassDef):
                compare(node.body, getattr(owner, name))
            elif isinstance(node, ast.FunctionDef):
                with contextlib.suppress(ValueError):  # what inspect knows no signature of
                    found = list(inspect.signature(getattr(owner, name)).parameters)
                    assert [one.arg for one in node.args.args + node.args.kwonlyargs] == found, name

    compare(ast.parse(Path(graspmill.__file__).with_name("_native.pyi").read_text()).body, graspmill._native)


def test_a_script_with_every_option_passes_the_type_checker_and_a_wrong_one_does_not(tmp_path, mypy):
    assert all(f"{name}=" in EVERY_OPTION for name in graspmill.PlanOptions.__annotations__)

    scripts = {
        "right.py": EVERY_OPTION,
        "wrong_name.py": EVERY_OPTION.replace("grasps_max=5", "grasp_max=5"),
        "wrong_value.py": EVERY_OPTION.replace('policy="paper"', 'policy="best"'),
    }
    for name, text in scripts.items():
        (tmp_path / name).write_text(text)
    checked = mypy(*scripts, cwd=tmp_path)
    problems = {name: [line for line in checked.stdout.splitlines() if line.startswith(name)] for name in scripts}
    assert problems["right.py"] == [] and checked.returncode == 1, checked.stdout
    assert 'unexpected keyword argument "grasp_max"' in "".join(problems["wrong_name.py"]).lower()
    assert "policy" in "".join(problems["wrong_value.py"])


def test_unknown_options_are_refused():
    with pytest.raises(TypeError, match="grasp_max"):
        graspmill.Planner().plan_cloud(np.zeros((1, 3)), grasp_max=3)


def test_a_gripper_is_its_numbers():
    for name in graspmill.Gripper.names():
        one = graspmill.Gripper.load(name)
        assert one.name == name and 0.0 < one.opening_m_max < 0.5 and len(one.jaws) == (2 if name == "so_101" else 0)
        again = pickle.loads(pickle.dumps(one))
        assert again.opening_m_max == one.opening_m_max and np.array_equal(again.flange_from_grasp, one.flange_from_grasp)
    numbers = {key: value for key, value in vars(graspmill.Gripper.load("wsg_50")).items() if key not in ("name", "flange_from_grasp")}
    own = graspmill.Gripper(name="own", flange_from_grasp=(0.0, 0.0, 0.1), **numbers)
    assert own.flange_from_grasp.shape == (4, 4) and own.flange_from_grasp[2, 3] == pytest.approx(0.1)
    refused("gripper.opening_m_max must be between 0.005 and 0.5, got 0.9", lambda: graspmill.Gripper(**{**numbers, "name": "own", "opening_m_max": 0.9}))
    refused("three_fingers", lambda: graspmill.Gripper.load("three_fingers"))


def test_a_gripper_has_other_jaws_as_its_file_has_them(tmp_path):
    numbers = {key: value for key, value in vars(graspmill.Gripper.load("parallel_jaw_80")).items() if key not in ("name", "closing_speed_m_s")}
    told = {"name": "own", "closing_speed_m_s": 0.1, "jaws": ({}, {"slide_m": np.array([0, -0.08, 0])}), "joint": (0.08, 0)}
    slides = graspmill.Gripper(**{**numbers, **told})
    (tmp_path / "own.toml").write_text("\n".join(graspmill.grippers.lines(slides)))
    read = graspmill.Gripper.load(tmp_path / "own.toml")
    assert [jaw["slide_m"] for jaw in read.jaws] == [[0, 0, 0], [0, -0.08, 0]] and not read.jaws[0]["keeps_parallel"] and read.joint == (0.08, 0)
    refused("jaws must be two mappings, by the keys", lambda: graspmill.Gripper(**{**numbers, **told, "jaws": 5}))
    scene = graspmill.generate(tmp_path / "ds", gripper=read, shards=1, attempts=6, seed=5).scene(0)
    refused("own has jaws of its own", lambda: scene.export(tmp_path / "scene"))


def test_a_gripper_of_numbers_does_what_the_built_in_one_does(tmp_path):
    box = graspmill.Object.cuboid((0.04, 0.06, 0.05), (0.15, 0.15, 0.075), mass_kg=0.05)
    scene = graspmill.Scene([box])
    loaded = graspmill.Gripper.load("wsg_50")
    plans = [graspmill.Planner(gripper=gripper).plan_tsdf(scene.tsdf([CAMERA])) for gripper in ("wsg_50", loaded)]
    assert len(plans[0]) and plans[0].answer["grasps"] == plans[1].answer["grasps"]
    outcomes = [graspmill.execute(scene, plans[0].workspace_from_grasp, gripper=gripper) for gripper in ("wsg_50", loaded)]
    assert outcomes[0].held.any() and np.array_equal(outcomes[0].width_m, outcomes[1].width_m, equal_nan=True)
    dataset = graspmill.generate(tmp_path / "ds", gripper=loaded, shards=1, attempts=60, seed=3)
    same = graspmill.generate(tmp_path / "same", settings={"gripper": "wsg_50"}, shards=1, attempts=60, seed=3)
    assert dataset.id == same.id


def test_cameras_by_matrix_and_translation():
    matrix = [[600.0, 0.0, 310.0], [0.0, 610.0, 250.0], [0.0, 0.0, 1.0]]
    camera = graspmill.Camera.from_K(matrix, np.zeros((480, 640)).shape, (0.1, 0.2, 0.5))
    assert (camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (640, 480, 600, 610, 310, 250)
    assert np.allclose(camera.workspace_from_camera, [[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    for same in (np.ravel(matrix), np.ravel(matrix).tolist(), np.hstack([matrix, np.zeros((3, 1))])):
        assert graspmill.Camera.from_K(same, (480, 640), (0.1, 0.2, 0.5))._intrinsics() == camera._intrinsics()
    for other in (np.eye(3) + 0.5, np.eye(3, 4) + np.eye(3, 4, 3), np.transpose(matrix), np.zeros(9)):
        refused(r"K must be \[\[fx", lambda: graspmill.Camera.from_K(other, (480, 640), (0, 0, 0)))
    for other in (np.ones(6), np.eye(4), np.ones(12)):
        refused(r"K must have the shape \[3, 3\], \[3, 4\] or \[9\], got", lambda: graspmill.Camera.from_K(other, (480, 640), (0, 0, 0)))
    refused("shape must be", lambda: graspmill.Camera.from_K(matrix, 480, (0, 0, 0)))


def again(value):
    return pickle.loads(pickle.dumps(value))


def content(value):
    parts = {name: part for name, part in vars(value).items() if not name.startswith("_")}
    return {name: (part.shape, part.tobytes()) if isinstance(part, np.ndarray) else part for name, part in parts.items()}


def test_cameras_grasps_and_plans_can_be_sent_to_another_process():
    camera, scene, gripper = CAMERA, BOXED, graspmill.Gripper.load("franka_hand")
    planner = graspmill.Planner(gripper=gripper)
    plan = planner.plan(scene.render(camera), camera)
    outcomes = graspmill.execute(scene, plan.workspace_from_grasp[:3])
    crops = graspmill.grasp_crops(scene.tsdf([camera]), plan.workspace_from_grasp[:1], gripper=gripper)
    for one in (camera, plan[0], gripper, outcomes, crops, graspmill.Page("<p>")):
        assert content(again(one)) == content(one) == content(copy.deepcopy(one)), one
    for same in (again(plan), copy.deepcopy(plan)):
        assert same.to_json() == plan.to_json() and same.timings_ms == plan.timings_ms and repr(same) == repr(plan)
        assert np.array_equal(same.cloud(), plan.cloud()) and content(same[0]) == content(plan[0])
    assert copy.deepcopy(plan).page() and again(plan)._repr_html_() is None
    for draw in (again(plan).page, again(plan).overlay):
        refused("pickled", draw)
    assert copy.deepcopy(planner) is planner


def test_objects_and_scenes_can_be_sent_to_another_process(tmp_path):
    mesh = graspmill.Object.mesh(BOX_MESH, (0.13, 0.125, 0.055), name="box")
    objects = [mesh, graspmill.Object.solid("cylinder", (0.04, 0.04, 0.05), (0.2, 0.2, 0.075))]
    for one in objects:
        same = again(one)
        assert content(same) == content(one) and same.name == one.name and np.allclose(same.extents_m, one.extents_m, atol=1e-6)
        assert [part.shape for part in same.parts()] == [part.shape for part in one.parts()] and copy.deepcopy(one) is one
    stored = graspmill.generate(tmp_path / "ds", attempts=60, shards=1, seed=3, settings={"physics.engine": "rapier"})[0]
    for scene in (graspmill.Scene(objects, table_z_m=0.04), stored.scene, stored.scene.settle()):
        same, grasps = again(scene), stored.workspace_from_grasp
        assert repr(same) == repr(scene) and same.table_z_m == scene.table_z_m
        assert content(graspmill.execute(same, grasps[:9]))["outcome"] == content(graspmill.execute(scene, grasps[:9]))["outcome"]
    for same in (again(stored), copy.deepcopy(stored)):
        assert np.array_equal(same.tsdf, stored.tsdf) and content(same.outcomes) == content(stored.outcomes)
        assert same.replay(0).html == stored.replay(0).html
    table, pyarrow = graspmill.Dataset(tmp_path / "ds").attempts(), pytest.importorskip("pyarrow")
    assert pyarrow.table(again(table)).equals(pyarrow.table(table))


def test_what_does_not_change_is_its_own_copy():
    assert copy.copy(BOXED) is BOXED and copy.deepcopy({"of": BOXED.objects[0]})["of"].name == "cuboid"
    with pytest.raises(TypeError):
        graspmill.Object(1.0)
    with pytest.raises(TypeError):
        graspmill.Plan(1)
