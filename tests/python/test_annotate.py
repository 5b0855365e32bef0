"""Labelled grasps of objects from Python: the same as the program's, and labels for grasps of others."""

import json
import os
from types import SimpleNamespace

import numpy as np
import pytest

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
pytest.importorskip("pyarrow")
from grasp_sets import BOX_MESH, ENDINGS, FORMATS, box_obj, needs  # noqa: E402
from programs import packaged  # noqa: E402

BOX = graspmill.Object.cuboid((0.04, 0.06, 0.05), (0, 0, 0))


def brick(folder):
    """A box of 40 x 60 x 50 mm whose corner is the origin, in millimetres."""
    path = folder / "brick.obj"
    path.write_text(box_obj((40, 60, 50)))
    return path


def test_grasps_are_those_of_the_program(tmp_path):
    mesh = brick(tmp_path)
    settings = {"grasps": 60, "test": "turn", "margins": True, "repeats": 2, "drops": 10, "seed": 7}
    told = []
    made = graspmill.annotate(mesh, gripper="franka_hand", scale=0.001, threads=2, progress=told.append, **settings)
    words = [str(word) for key, value in settings.items() for word in (f"--{key}", value) if value is not True]
    packaged("objects", "annotate", mesh, "--scale", "0.001", "--gripper", "franka_hand", "--margins", *words, "--out", tmp_path / "out")
    stored = graspmill.ObjectGrasps.load(tmp_path / "out" / "brick.parquet")
    assert len(made) == len(stored) == 60
    for name in ("object_from_grasp", "width_m", "contacts_m", "normals", "closing_moved_m", "test_turned_rad", "friction_min", "tug_max_g", "p_held"):
        np.testing.assert_allclose(getattr(made, name), getattr(stored, name), atol=1e-6, err_msg=name)
    for name in ("outcome", "source", "held", "is_free_on_table"):
        assert np.array_equal(getattr(made, name), getattr(stored, name)), name
    np.testing.assert_allclose(made.on_table_share, stored.on_table_share, atol=1e-6)
    assert made.base_to_tips_m == pytest.approx(0.1123) == stored.base_to_tips_m
    assert [pose for pose, _ in made.stable_poses] == pytest.approx([pose for pose, _ in stored.stable_poses])
    # The mesh's corner is the origin: contacts are on its sides, 0 and the lengths.
    points = made.contacts_m[made.held].reshape(-1, 3)
    off = np.abs(np.stack([points, points - (0.04, 0.06, 0.05)])).min(axis=(0, 2))
    assert np.isfinite(points).all() and off.max() < 1e-4


@pytest.mark.parametrize("mesh", [BOX_MESH, SimpleNamespace(vertices=BOX_MESH[0], faces=BOX_MESH[1])], ids=["arrays", "trimesh"])
def test_a_mesh_is_annotated_as_an_object_of_it_but_in_its_own_frame(mesh):
    made = graspmill.annotate(mesh, grasps=40, drops=10)
    thing = graspmill.annotate(graspmill.Object.mesh(mesh, (1, 2, 3)), grasps=40, drops=10)
    assert np.array_equal(made.outcome, thing.outcome) and made.held.sum() > 5
    centre_m = np.array([0.02, 0.025, 0.03])  # the mesh's corner is its origin, the middle is that of the object
    moved_m = made.object_from_grasp[:, :3, 3] - thing.object_from_grasp[:, :3, 3]
    np.testing.assert_allclose(moved_m, np.tile(centre_m, (40, 1)), atol=1e-6)
    np.testing.assert_allclose((made.contacts_m - thing.contacts_m - centre_m)[made.held], 0.0, atol=1e-6)
    np.testing.assert_allclose(made.info["object"]["centre_of_mass_m"], centre_m, atol=1e-5)
    assert made.info["object"]["mass_kg"] == thing.info["object"]["mass_kg"] == pytest.approx(0.06, rel=1e-3)


def test_a_description_is_annotated_as_what_it_describes(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "parts").mkdir()
    brick(tmp_path / "parts")
    shape = '<geometry><mesh filename="parts/brick.obj" scale="0.001 0.001 0.001"/></geometry>'
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="a"><link name="b"><inertial><mass value="0.2"/></inertial><visual>{shape}</visual></link></robot>')
    made = graspmill.annotate(path, grasps=30, drops=0)
    assert (made.name, made.file, made.info["object"]["mass_kg"]) == ("robot", str(path), pytest.approx(0.2))
    points = made.contacts_m[made.held].reshape(-1, 3)
    assert len(points) and np.abs(np.stack([points, points - (0.04, 0.06, 0.05)])).min(axis=(0, 2)).max() < 1e-4


def test_grasps_of_others_are_labelled(tmp_path):
    above, beside, through, touching = poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (4, 1, 1))
    poses[:, :2, 3] = (0, 0), (0.2, 0), (0, 0.025), (0, 0.0113)  # at last 1.3 mm of the box are where a finger comes
    labels = graspmill.annotate(BOX, given=[above, beside, through], drops=0, margins=True)
    for touch_m, outcome, pushed_m in ((0.003, "held", 0.0025), (0.0, "approach_collision", np.nan)):
        told = graspmill.annotate(BOX, given=[touching], drops=0, touch_m=touch_m)
        np.testing.assert_allclose([told.pushed_m, told.clearance_m], [[pushed_m], [-0.0013]], atol=1e-4)
        assert list(told.outcome) == [outcome] and np.isfinite(told.p_held).all()
    assert list(labels.outcome) == ["held", "empty", "approach_collision"] and set(labels.source) == {"given"}
    assert labels.width_m[0] == pytest.approx(0.06, abs=1e-3) and np.isnan(labels.width_m[2])
    assert labels.tug_max_g[0] > 1 and np.isnan(labels.tug_max_g[1:]).all() and np.isnan(labels.on_table_share).all()
    path = labels.save(tmp_path / "box.npz", "molmospaces")
    again = graspmill.annotate(BOX, given=graspmill.read_grasps(path).object_from_grasp, drops=0)
    assert list(again.outcome) == ["held"]


def annotated(folder, *words):
    words = ("objects", "annotate", folder / "brick.obj", "--gripper", "franka_hand", "--drops", "0", *words)
    return packaged(*words, cwd=folder).stdout


@pytest.fixture(scope="module")
def drawn_files(tmp_path_factory):
    """The folder of a brick, with a set of its grasps in every format."""
    needs(*FORMATS)
    folder = brick(tmp_path_factory.mktemp("drawn")).parent
    annotated(folder, "--grasps", "60", "--scale", "0.001", "--format", ",".join(FORMATS), "--out", "drawn")
    return folder


@pytest.mark.parametrize("form", [*FORMATS, "parquet"])
def test_files_of_others_are_labelled_by_the_program(drawn_files, form):
    file = drawn_files / "drawn" / (f"brick.{form}.{ENDINGS[form]}" if form in ENDINGS else "brick.parquet")
    # Three say how long a unit of the mesh is.
    scale = [] if form in ("acronym", "graspgen", "isaac_grasp") else ["--scale", "0.001"]
    for _ in range(2 if form == "graspgen" else 1):  # the same once more
        assert "between the open fingers" not in annotated(drawn_files, "--relabel", file, *scale, "--out", form)
    drawn, again = (graspmill.ObjectGrasps.load(drawn_files / folder / "brick.parquet") for folder in ("drawn", form))
    if form in ("molmospaces", "graspnet"):  # without labels, and only what held
        drawn = drawn.subset(drawn.held)
    np.testing.assert_allclose(again.object_from_grasp, drawn.object_from_grasp, atol=2e-6)
    assert again.scale_m == pytest.approx(0.001) and (again.held == drawn.held).mean() > 0.95


def test_a_file_of_others_that_is_empty_or_a_link_is_written_again(tmp_path):
    words = (brick(tmp_path).parent, "--scale", "0.001", "--grasps", "20", "--format", "graspgen", "--out", "out")
    annotated(*words)
    file, elsewhere = tmp_path / "out" / "brick.graspgen.json", tmp_path / "elsewhere.json"
    whole = file.read_bytes()
    file.write_bytes(b"")
    annotated(*words)
    assert file.read_bytes() == whole
    os.replace(file, elsewhere)
    file.symlink_to(elsewhere)
    annotated(*words)
    assert file.read_bytes() == whole and not file.is_symlink()


def test_what_is_wrong_with_a_frame_or_a_unit_is_told(drawn_files):
    told = json.loads((drawn_files / "drawn" / "brick.graspgen.json").read_text())
    far = np.array(told["grasps"]["transforms"])
    far[:, :3, 3] *= 1e3
    for name, part, key, value, why in (
        ("base", "gripper", "depth", 0.0, "if their origin is the gripper's base"),
        ("large", "object", "scale", 0.01, "if a unit of the mesh is 1 mm"),
        ("far", "grasps", "transforms", far.tolist(), "if their positions are in millimetres"),
    ):
        (drawn_files / f"{name}.json").write_text(json.dumps({**told, part: {**told[part], key: value}}))
        said = annotated(drawn_files, "--relabel", f"{name}.json", "--out", name)
        assert "warning: brick: the object lies between the open fingers in " in said and why in said
    poses = graspmill.ObjectGrasps.load(drawn_files / "drawn" / "brick.parquet").object_from_grasp
    poses[:, :3, 3] *= 1e3
    with pytest.warns(UserWarning, match="of 60 grasps, but in .* if their positions are in millimetres"):
        graspmill.annotate(drawn_files / "brick.obj", gripper="franka_hand", scale=0.001, drops=0, given=poses)


def test_what_the_program_cannot_write_or_read_is_named(tmp_path):
    mesh = brick(tmp_path)
    (tmp_path / "a.npz").write_text("no")
    for words, said in (
        (["--format", "graspgen,stl"], "--format must be some of acronym, graspgen"),
        (["--relabel", tmp_path / "a.npz"], "transforms"),
        (["--relabel", tmp_path / "gone.json"], "gone.json"),
        (["--relabel", tmp_path / "gone.parquet"], "gone.parquet"),
        (["--relabel", tmp_path / f"{'long' * 20}.txt"], f"{'long' * 20}.txt"),
        (["--relabel", tmp_path / "a.txt"], "must end with one of"),
    ):
        assert said in packaged("objects", "annotate", mesh, *words, "--out", tmp_path / "out", code=78).stderr


def test_only_what_holds_is_kept_where_that_is_asked_for():
    held = graspmill.annotate(BOX, grasps=50, held_only=True, drops=0, shares=(1, 0, 0))
    assert len(held) == 50 and held.held.all()


def test_what_is_wrong_is_named(tmp_path):
    for expected, call in (
        ("grasps", lambda: graspmill.annotate(BOX, grasps=0)),
        ("test must be one of lift, turn, tug, shake", lambda: graspmill.annotate(BOX, test="drop")),
        ("shares must not all be 0", lambda: graspmill.annotate(BOX, shares=(0, 0, 0))),
        ("touch_m must be", lambda: graspmill.annotate(BOX, touch_m=0.1)),
        ("scale goes with a file", lambda: graspmill.annotate(BOX, scale=1.0)),
        ("scale goes with a file", lambda: graspmill.annotate(BOX_MESH, scale=1.0)), ("mesh must be", lambda: graspmill.annotate(7)),
        ("metres", lambda: graspmill.annotate((1000.0 * BOX_MESH[0], BOX_MESH[1]))),
        ("given", lambda: graspmill.annotate(BOX, given=np.zeros((2, 4, 4)))), ("claw", lambda: graspmill.annotate(BOX, gripper="claw")),
        ("gone.obj", lambda: graspmill.annotate(tmp_path / "gone.obj")),
        ("progress must be a function", lambda: graspmill.annotate(BOX, progress=7)),
    ):  # fmt: skip
        with pytest.raises((graspmill.InputError, graspmill.OutsideError, graspmill.DataError), match=expected):
            call()

    def stop(_):
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        graspmill.annotate(BOX, grasps=1_000_000, drops=0, progress=stop)
