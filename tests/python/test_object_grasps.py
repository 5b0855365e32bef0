"""Grasps of objects in files of others: frames by hand, round trips, the program's files, what their readers ask."""

import dataclasses
import json

import numpy as np
import pytest
from grasp_sets import ABOVE, BASE_M, ENDINGS, FORMATS, ObjectGrasps, again, box_obj, graspmill, many
from grasp_sets import one_above, read_grasps, refused, saved
from programs import packaged

# Where a gripper is that comes from straight above, by hand.


def test_acronyms_frame_is_the_base_of_the_gripper_with_x_closing(tmp_path):
    path = saved(one_above(), tmp_path, "acronym")
    with pytest.importorskip("h5py").File(path) as file:
        told = file["grasps/transforms"][()]
    # 112.2 mm above the tips; its x is our y, its y our −x.
    np.testing.assert_allclose(told, [[[0, 1, 0, 0.01], [1, 0, 0, 0.02], [0, 0, -1, 0.1422], [0, 0, 0, 1]]], atol=1e-12)


def test_graspgens_frame_is_the_base_of_the_gripper_with_x_closing(tmp_path):
    told = json.loads(saved(one_above(), tmp_path, "graspgen").read_text())
    assert told["object"] == {"file": "meshes/mug.obj", "scale": 0.001} and told["grasps"]["object_in_gripper"] == [True]
    want = [[[0, 1, 0, 0.01], [1, 0, 0, 0.02], [0, 0, -1, 0.1423], [0, 0, 0, 1]]]
    np.testing.assert_allclose(told["grasps"]["transforms"], want, atol=1e-12)
    assert told["gripper"] == {"name": "franka_hand", "width": 0.08, "depth": BASE_M}


def test_isaac_grasps_frame_is_the_base_of_the_gripper_with_y_closing(tmp_path):
    path = saved(one_above(), tmp_path, "isaac_grasp")
    told = pytest.importorskip("yaml").safe_load(path.read_text())
    grasp = told["grasps"]["grasp_0"]
    assert (told["format"], float(told["format_version"])) == ("isaac_grasp", 1.0)
    assert grasp["position"] == [0.01, 0.02, 0.1423] and grasp["confidence"] == 1.0
    assert (grasp["orientation"]["w"], np.abs(grasp["orientation"]["xyz"]).tolist()) == (0.0, [0.0, 1.0, 0.0])
    assert grasp["cspace_position"] == {"panda_finger_joint1": 0.025}
    assert grasp["pregrasp_cspace_position"] == {"panda_finger_joint1": 0.04}


def test_molmospaces_frame_is_ours(tmp_path):
    with np.load(saved(one_above(), tmp_path, "molmospaces")) as file:
        np.testing.assert_array_equal(file["transforms"], ABOVE[None])
        assert file.files == ["transforms"] and file["transforms"].dtype == np.float64
        assert np.lib.format.read_magic(file.zip.open("transforms.npy")) == (1, 0)  # it reads the header by itself


def test_graspnets_centre_is_20_mm_behind_the_tips_with_x_approach(tmp_path):
    told = np.load(saved(one_above(friction_min=[0.3]), tmp_path, "graspnet"))
    want = [0.8, 0.05, 0.021, 0.02, 0, 0, 1, 0, 1, 0, -1, 0, 0, 0.01, 0.02, 0.05, -1]
    np.testing.assert_allclose(told, [want], atol=1e-12)
    assert told.dtype == np.float64


def test_files_that_close_along_the_other_axis(tmp_path):
    usual = saved(one_above(), tmp_path, "graspgen")
    turned = read_grasps(usual, closing_axis="y")
    # Without a quarter turn: its own y, which was our −x, is the closing direction.
    np.testing.assert_allclose(turned.object_from_grasp[0, :3, 1], -ABOVE[:3, 0], atol=1e-12)
    other = turned.save(tmp_path / "other.json", closing_axis="y")
    bases = [json.loads(path.read_text())["grasps"]["transforms"] for path in (usual, other)]
    assert bases[0] == bases[1]
    refused("closing_axis must be 'x' or 'y', got 'z'", lambda: read_grasps(usual, closing_axis="z"))


@pytest.mark.parametrize("shape", ["parts", "flat", "matrix"])
def test_a_graspgen_file_says_how_its_gripper_is_turned(tmp_path, shape):
    # Of GraspDataGen's franka_panda, which closes along y: x of GraspGen's frame is y of the file's.
    turned = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    offset = {"parts": [[0.0, 0.0, 0.0], [0.0, 0.0, 0.7071, 0.7071]], "flat": sum(turned, []), "matrix": turned}[shape]
    path = saved(one_above(), tmp_path, "graspgen", closing_axis="y")
    told = json.loads(path.read_text())
    told["gripper"]["transform_offset_from_asset_to_graspgen_convention"] = offset
    path.write_text(json.dumps(told))
    np.testing.assert_allclose(read_grasps(path).object_from_grasp, [ABOVE], atol=1e-6)
    told["gripper"]["transform_offset_from_asset_to_graspgen_convention"] = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    path.write_text(json.dumps(told))
    refused("transform_offset_from_asset_to_graspgen_convention must have the shape", lambda: read_grasps(path))


def test_the_tips_of_graspgens_own_grippers_are_those_of_its_meshes(tmp_path):
    path = saved(one_above(), tmp_path, "graspgen")
    told = json.loads(path.read_text())
    known = ("franka_panda", 0.10527314, 0.1122), ("franka_panda", None, 0.1122), ("robotiq_2f_140", 0.195, 0.212), ("rg6", 0.2, 0.2), ("franka_panda", 0.0, 0.0)
    for name, depth_m, tips_m in known:
        told["gripper"] = {"name": name, "depth": depth_m}
        path.write_text(json.dumps(told))
        grasps = read_grasps(path)
        assert grasps.base_to_tips_m == tips_m
        np.testing.assert_allclose(grasps.object_from_grasp[0, :3, 3], [0.01, 0.02, 0.03 + BASE_M - tips_m], atol=1e-12)


# Round trips.


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("count", [50, 1, 0])
def test_what_is_written_is_read(tmp_path, form, count):
    grasps = many(count)
    told = again(saved(grasps, tmp_path, form), form)
    is_good_only = form in ("molmospaces", "graspnet")
    want = grasps.subset(grasps.held) if is_good_only else grasps
    off_max = 2e-7 if form == "isaac_grasp" else 1e-12  # decimals
    np.testing.assert_allclose(told.object_from_grasp, want.object_from_grasp, atol=off_max)
    assert len(told) == len(want) and (told.source == "given").all() and told.outcome is None
    if is_good_only:
        assert told.held is None and (told.file, told.scale_m) == ("", 1.0)
    else:
        np.testing.assert_array_equal(told.held, want.held)
        assert (told.file, told.scale_m, told.info["gripper"]["name"]) == (want.file, want.scale_m, "franka_hand")
    if form in ("isaac_grasp", "graspnet"):
        np.testing.assert_allclose(told.width_m, want.width_m, atol=2e-6)
    if form == "graspnet":
        np.testing.assert_allclose(told.score, 1.1 - want.friction_min, atol=1e-12)
    if form == "acronym":
        for name in ("closing_moved_m", "closing_turned_rad", "test_moved_m", "test_turned_rad"):
            np.testing.assert_array_equal(getattr(told, name), getattr(want, name))
        assert told.info["object"] == want.info["object"]


@pytest.mark.parametrize("form", FORMATS)
def test_what_is_read_is_written_again(tmp_path, form):
    once = again(saved(many(), tmp_path, form), form)
    twice = again(once.save(tmp_path / f"twice.{ENDINGS[form]}"), form)
    for one in dataclasses.fields(once):
        if one.name not in ("name", "info", "stable_poses"):
            old, new = getattr(once, one.name), getattr(twice, one.name)
            if isinstance(old, np.ndarray) and old.dtype.kind == "f":
                np.testing.assert_allclose(new, old, atol=2e-7, err_msg=one.name)
            else:
                np.testing.assert_array_equal(new, old, err_msg=one.name)
    assert twice.info == once.info


# What the program writes.


@pytest.fixture(scope="module", params=["franka_hand", "parallel_jaw_80"])
def annotated(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    (folder / "box.obj").write_text(box_obj((0.04, 0.06, 0.05), (-0.02, -0.03, -0.025)))
    words = ["--gripper", request.param, "--grasps", "80", "--drops", "10", "--scale", "1", "--margins", "--repeats", "2"]
    for out, more in (("grasps", []), ("best", ["--best", "7"])):
        packaged("objects", "annotate", "box.obj", *words, *more, "--out", out, cwd=folder)
    return folder / "grasps", request.param


def test_a_set_of_the_program_is_its_parquet(annotated):
    parquet = pytest.importorskip("pyarrow.parquet")
    folder, gripper = annotated
    grasps, rows = ObjectGrasps.load(folder / "box.parquet"), parquet.read_table(folder / "box.parquet").to_pylist()
    info = json.loads((folder / "box.json").read_text())
    assert len(grasps) == len(rows) == 80 and grasps.info == info
    assert info["outcomes"]["held"] == grasps.held.sum() > 12
    assert (grasps.name, grasps.file, grasps.scale_m) == ("box", "box.obj", 1.0)
    assert grasps.base_to_tips_m == pytest.approx({"franka_hand": 0.1123, "parallel_jaw_80": 0.09}[gripper])
    assert set(grasps.outcome) <= set(graspmill.OUTCOMES) and set(grasps.source) <= {"antipodal", "normal", "displaced"}
    np.testing.assert_array_equal(grasps.held, grasps.outcome == "held")
    number = {None: np.nan}
    for at, row in enumerate(rows):
        assert np.allclose(grasps.object_from_grasp[at, :3, 3], [row["x_m"], row["y_m"], row["z_m"]])
        for ours in ("width_m", "closing_moved_m", "test_turned_rad", "friction_min", "tug_max_g", "p_held", "clearance_m", "pushed_m"):
            assert np.array_equal(getattr(grasps, ours)[at], number.get(row[ours], row[ours]), equal_nan=True), ours
        right = [row[f"right_{axis}_m"] for axis in "xyz"]
        assert np.array_equal(grasps.contacts_m[at, 1], [number.get(one, one) for one in right], equal_nan=True)
        assert grasps.normals[at, 0, 2] == row["left_normal_z"] or row["left_normal_z"] is None
    assert np.isfinite(grasps.p_held).all() and (np.isnan(grasps.width_m) <= (grasps.clearance_m < 0.0011)).all()
    shares = np.array([share for share, _ in grasps.stable_poses])
    np.testing.assert_allclose(grasps.is_free_on_table @ shares / shares.sum(), grasps.on_table_share, atol=1e-6)
    for _, table_from_object in grasps.stable_poses:  # the box lies on the table
        corners = np.array([[x, y, z, 1] for x in (-0.02, 0.02) for y in (-0.03, 0.03) for z in (-0.025, 0.025)])
        assert abs((corners @ table_from_object.T)[:, 2].min()) < 1e-3
    # A gripper that holds the box touches its surface with both fingers, on its two sides of the closing direction.
    turned, origins_m = grasps.object_from_grasp[:, :3, :3], grasps.object_from_grasp[:, None, :3, 3]
    contacts = np.einsum("nji,nsj->nsi", turned, grasps.contacts_m - origins_m)
    assert (contacts[grasps.held, 0, 1] < contacts[grasps.held, 1, 1]).mean() > 0.95


def test_tables_of_earlier_versions_are_read(annotated, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(annotated[0] / "box.parquet")
    names = ["robust_share" if name == "p_held" else name for name in table.column_names]
    parquet.write_table(table.rename_columns(names).drop_columns(["clearance_m", "pushed_m"]), tmp_path / "box.parquet")
    (tmp_path / "box.json").write_bytes((annotated[0] / "box.json").read_bytes())
    older, grasps = (ObjectGrasps.load(folder / "box.parquet") for folder in (tmp_path, annotated[0]))
    np.testing.assert_array_equal(older.p_held, grasps.p_held)
    assert np.isnan(older.clearance_m).all() and np.isnan(older.pushed_m).all() and np.isfinite(grasps.clearance_m).all()


# What the readers of others ask.


def test_acronym_tools_reads_a_file(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(saved(many(), tmp_path, "acronym"), "r") as data:
        assert data["object/file"][()].decode("utf-8") == "meshes/a mug.obj" and data["object/scale"][()] == 0.25
        transforms = np.array(data["grasps/transforms"])
        success = np.array(data["grasps/qualities/flex/object_in_gripper"])
        assert (transforms.shape, transforms.dtype) == ((50, 4, 4), np.float64) and (success.dtype, set(success.tolist())) == (np.int64, {0, 1})
        assert data["gripper/type"][()].decode() == "franka_hand"
        assert data["gripper/configuration"][()].tolist() == [0.04]
        # Its products of inertia have the other sign.
        inertia = data["object/inertia"][()]
        np.testing.assert_array_equal(np.diag(inertia), [3e-5, 4e-5, 5e-5])
        assert (inertia[0, 1], inertia[0, 2], inertia[1, 2]) == (1e-6, -2e-6, -3e-6)
        assert all(one.attrs.keys() == set() for one in data.values())


def test_acronyms_unknown_datasets_are_left_out(tmp_path):
    h5py = pytest.importorskip("h5py")
    lifted = dataclasses.replace(many(), info={"test": "lift"}, closing_moved_m=np.full(50, np.nan))
    with h5py.File(saved(lifted, tmp_path, "acronym"), "r") as data:
        # The motion during another test is not that during a shake.
        assert set(data["grasps/qualities/flex"]) == {"object_in_gripper", "object_motion_during_closing_angular"}
        assert set(data["object"]) == {"file", "scale"} and set(data["gripper"]) == {"type"}


# Files that others wrote.


def test_a_file_of_graspdatagen(tmp_path):
    pytest.importorskip("yaml")
    (tmp_path / "mug.yaml").write_text(
        """
format: isaac_grasp
format_version: "1.0"
created_with: grasp_sim
object_file: mug.obj
object_scale: 0.5
gripper_file: bots/franka_panda.usd
gripper_frame_link: panda_hand
open_limit: upper
finger_colliders: [panda_rightfinger, panda_leftfinger]
base_length: 0.1
approach_axis: 2
bite_point: [0.0, 0.0, 0.1]
grasps:
  a:
    confidence: 1.0
    position: [0.01, 0.02, 0.1423]
    orientation: {w: 0.0, xyz: [0.0, "1.0", 1e-9]}
    bite_point: [0.0, 0.0, 0.1]
    cspace_position: {panda_finger_joint1: 0.02, panda_finger_joint2: 0.02}
    pregrasp_cspace_position: {panda_finger_joint1: 0.04}
    pregrasp_position: [0.0, 0.0, 0.0]
    pregrasp_orientation: {w: 1.0, xyz: [0.0, 0.0, 0.0]}
  b: {confidence: 0.0, position: [0.0, 0.0, 0.0], orientation: {w: 1.0, xyz: [0.0, 0.0, 0.0]}}
"""
    )
    grasps = read_grasps(tmp_path / "mug.yaml", gripper="franka_hand")
    np.testing.assert_allclose(grasps.object_from_grasp[0], ABOVE, atol=1e-7)
    assert grasps.held.tolist() == [True, False]
    assert (grasps.file, grasps.scale_m, grasps.name) == ("mug.obj", 0.5, "mug")
    np.testing.assert_array_equal(grasps.width_m, [0.04, np.nan])
    refused("base_to_tips_m or gripper must be given", lambda: read_grasps(tmp_path / "mug.yaml"))
    # Of a gripper that closes along x, bite points of the open fingers lie off the approach there.
    text = (tmp_path / "mug.yaml").read_text().replace("bite_point: [0.0, 0.0, 0.1]", "bite_point: [-0.03, 0.0, 0.1]")
    (tmp_path / "mug.yaml").write_text(text)
    other = read_grasps(tmp_path / "mug.yaml", gripper="franka_hand")
    np.testing.assert_allclose(other.object_from_grasp[0, :3, 1], grasps.object_from_grasp[0, :3, 0], atol=1e-7)
    again_y = read_grasps(tmp_path / "mug.yaml", gripper="franka_hand", closing_axis="y")
    np.testing.assert_array_equal(again_y.object_from_grasp, grasps.object_from_grasp)


def test_confidences_of_a_network_are_no_labels(tmp_path):
    pytest.importorskip("yaml")
    text = one_above().save(tmp_path / "a.yaml").read_text()
    (tmp_path / "b.yaml").write_text(text.replace("confidence: 1.0", "confidence: 0.73"))
    grasps = read_grasps(tmp_path / "b.yaml", base_to_tips_m=BASE_M)
    assert grasps.held is None and grasps.score.tolist() == [0.73]
    assert repr(grasps) == "ObjectGrasps('mug': 1 grasps, no labels)"
    assert "confidence: 0.73" in grasps.save(tmp_path / "c.yaml").read_text()
    refused("held must be known for GraspGen", lambda: grasps.save(tmp_path / "c.json"))
    (tmp_path / "d.yaml").write_text(text.replace("format_version: 1.0", "format_version: 2.0"))
    with pytest.warns(UserWarning, match="2.0"):
        read_grasps(tmp_path / "d.yaml", base_to_tips_m=BASE_M)


def test_p_held_is_the_confidence_beside_the_label(tmp_path):
    grasps = one_above(p_held=[0.25])
    assert json.loads(saved(grasps, tmp_path, "graspgen").read_text())["grasps"]["confidence"] == [0.25]
    assert np.load(saved(grasps, tmp_path, "graspnet"))[0, 0] == 0.25
    told = again(saved(grasps, tmp_path, "isaac_grasp"), "isaac_grasp")
    assert (told.held.tolist(), told.score.tolist(), told.p_held.tolist()) == ([True], [0.25], [0.25])


def test_half_precision_is_read_as_rotations(tmp_path):
    grasps = many()
    np.savez_compressed(tmp_path / "grasps.npz", transforms=grasps.object_from_grasp.astype(np.float16))
    told = read_grasps(tmp_path / "grasps.npz").object_from_grasp
    np.testing.assert_allclose(told, grasps.object_from_grasp, atol=2e-3)
    products = told[:, :3, :3] @ told[:, :3, :3].transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)


def test_graspnets_depth_is_that_of_each_row(tmp_path):
    rows = np.tile([0.5, 0.06, 0.02, 0.04, 0, 0, 1, 0, 1, 0, -1, 0, 0, 0.01, 0.02, 0.07, 5.0], (2, 1))
    rows[1, 3], rows[1, 15] = 0.01, 0.04
    np.save(tmp_path / "g.npy", rows)
    np.testing.assert_allclose(read_grasps(tmp_path / "g.npy").object_from_grasp, [ABOVE, ABOVE], atol=1e-12)


# The strongest that are apart.


def placed(*grasps):
    """Poses at a height in metres, turned in degrees about the gripper's approach and closing direction."""
    poses = np.tile(ABOVE, (len(grasps), 1, 1))
    for pose, (height_m, *turns_deg) in zip(poses, grasps):
        (a, b), (c, d) = np.cos(np.radians(turns_deg)), np.sin(np.radians(turns_deg))
        pose[:3, :3] @= np.array([[a, -c, 0], [c, a, 0], [0, 0, 1]]) @ np.array([[b, 0, d], [0, 1, 0], [-d, 0, b]])
        pose[2, 3] = height_m
    return poses


def test_the_best_are_the_strongest_that_held_and_are_apart():
    poses = placed((0.0, 0, 0), (0.019, 180, 0), (0.021, 0, 0), (0.0, 0, 29), (0.0, 31, 0), (0.019, 0, 180), (0.2, 0, 0))
    many = ObjectGrasps("set", poses, held=[1, 1, 1, 1, 1, 1, 0], tug_max_g=[3, 2, 1, 2, 4, 5, 9])
    # The second is near the first, but for a half turn; the third further away, the fourth turned less, the last lost.
    assert many.best(9).tug_max_g.tolist() == [5, 4, 3, 1]
    assert many.best(2).tug_max_g.tolist() == [5, 4] and len(many.subset([6]).best(1)) == 0
    # How likely each holds counts as much; where that is not known of some, they are last.
    assert dataclasses.replace(many, p_held=[1, 1, 1, 1, 0.7, 0.5, 1]).best(9).tug_max_g.tolist() == [3, 4, 5, 1]
    assert dataclasses.replace(many, p_held=[np.nan, np.nan, 0.1, *[np.nan] * 4]).best(1).tug_max_g.tolist() == [1]
    # Sets of others with nothing but scores, or nothing at all.
    far = ObjectGrasps("set", placed(*((0.1 * number, 0, 0) for number in range(4))), score=[0.1, np.nan, 0.9, 0.5])
    assert far.best(9).score.tolist()[:3] == [0.9, 0.5, 0.1] and len(far.best(9)) == 4
    nothing = dataclasses.replace(far, score=np.empty(0))
    np.testing.assert_array_equal(nothing.best(2).object_from_grasp, far.object_from_grasp[:2])
    for wrong in (0, 1.5, True):
        refused("n must be", lambda: nothing.best(wrong))


def test_the_programs_best_are_those_of_the_whole_set(annotated):
    few, whole = (ObjectGrasps.load(annotated[0].parent / name / "box.parquet") for name in ("best", "grasps"))
    assert len(few) == 7 and few.held.all()
    np.testing.assert_array_equal(few.object_from_grasp, whole.best(7).object_from_grasp)
