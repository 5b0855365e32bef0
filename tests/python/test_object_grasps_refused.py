"""Damaged files of grasps, wrong arrays and wrong arguments: each is refused with the rule, the value and the path."""

import io
import json
import sys
import zipfile

import numpy as np
import pytest
from programs import changed
from grasp_sets import ABOVE, ALIASES, ENDINGS, ObjectGrasps, again, many, one_above, read_grasps, refused


def test_damaged_graspgen_files_are_refused(tmp_path):
    path = many(3).save(tmp_path / "set.json")
    whole, bad = json.loads(path.read_text()), np.eye(4).tolist()
    for match, *change in (
        ("object must be in the file.*set.json", "object"), ("grasps.transforms must be in the file", "grasps.transforms"),
        ("grasps.object_in_gripper must be in", "grasps.object_in_gripper"), ("object.scale must be a number", "object.scale", None),
        ("object.file must be a text", "object.file", 3), (r"shape \[N, 4, 4\]", "grasps.transforms", [bad[:3]] * 3),
        ("rows of several lengths", "grasps.transforms", [bad, bad[:2]]),
        ("must be finite", "grasps.transforms", np.full((3, 4, 4), np.nan).tolist()),
        ("reflection", "grasps.transforms", [np.diag([1, 1, -1, 1.0]).tolist()] * 3), (r"shape \[3\]", "grasps.object_in_gripper", [True]),
        ("true or false", "grasps.object_in_gripper", [0.5, 1, 2]), ("gripper.depth must be between", "gripper.depth", -1),
        ("base_to_tips_m or gripper must be given", "gripper.depth"), ("grasps must be a mapping", "grasps", []),
    ):  # fmt: skip
        path.write_text(json.dumps(changed(whole, *change)))
        refused(match, lambda: read_grasps(path))
    path.write_text("[1]")
    refused("the file must be a mapping", lambda: read_grasps(path))
    for text in ("", "{", "[" * 100_000, "\x00\xff"):
        path.write_text(text)
        refused("the file must be JSON", lambda: read_grasps(path))


def test_damaged_isaac_grasp_files_are_refused(tmp_path):
    yaml = pytest.importorskip("yaml")
    path = many(2).save(tmp_path / "set.yaml")
    whole, grasp = yaml.safe_load(path.read_text()), "grasps.grasp_1"
    for match, *change in (
        ("format must be isaac_grasp, got 'other'", "format", "other"), ("grasps must be in the file", "grasps"),
        ("grasps must be a mapping", "grasps", None), ("grasp_1.position must be in", f"{grasp}.position"),
        ("grasp_1.position must be 3 numbers", f"{grasp}.position", [1.0]),
        ("grasp_1.position must be between -1000 and 1000, got nan", f"{grasp}.position", [1.0, float("nan"), 0.0]),
        ("orientation.xyz must be in", f"{grasp}.orientation.xyz"), ("quaternions of length 1", f"{grasp}.orientation.w", 3e-1),
        ("confidence must be a number", f"{grasp}.confidence", "high"),
        ("cspace_position must be a mapping", f"{grasp}.cspace_position", [1]), ("approach_axis must be 2", "approach_axis", 0),
    ):  # fmt: skip
        path.write_text(yaml.safe_dump(changed(whole, *change)))
        refused(match, lambda: again(path, "isaac_grasp"))
    for text in ("{", "a: [", "x: !!python/object/apply:os.system [ls]", "\x00"):
        path.write_text(text)
        refused("the file must be YAML", lambda: again(path, "isaac_grasp"))
    path.write_text(f"{ALIASES}format: *-8\n")
    refused("the file must be YAML without aliases.*set.yaml", lambda: again(path, "isaac_grasp"))


def test_damaged_arrays_are_refused(tmp_path):
    good = np.load(many(3).save(tmp_path / "good.npy"))
    wrong = {r"shape \[N, 17\]": good[:, :16], r"shape \[N, 17\], N": good[0], "must be numbers": good.astype(object), "must be rigid": good * 2}
    for number, (match, array) in enumerate({**wrong, "must be finite": np.where(np.arange(17) == 2, np.nan, good)}.items()):
        np.save(tmp_path / f"{number}.npy", array)
        refused(match, lambda: read_grasps(tmp_path / f"{number}.npy"))
    buffer = io.BytesIO()
    np.save(buffer, good)
    unclosed = buffer.getvalue().replace(b"(2, 17)", b"(2, 17[")
    for bad in (b"", b"\x93NUMPY", buffer.getvalue()[:-9], buffer.getvalue()[:60], unclosed):
        (tmp_path / "bad.npy").write_bytes(bad)
        refused("must be an .npy of NumPy", lambda: read_grasps(tmp_path / "bad.npy"))
    huge = buffer.getvalue().replace(b"(2, 17)", b"(9999999999, 17)")[:128]
    (tmp_path / "huge.npy").write_bytes(huge)
    refused("N at most 1000000|must be an .npy", lambda: read_grasps(tmp_path / "huge.npy"))
    (tmp_path / "head.npy").write_bytes(head := b"\x93NUMPY\x02\x00" + (2**31).to_bytes(4, "little"))
    with zipfile.ZipFile(tmp_path / "head.npz", "w") as file:
        file.writestr("transforms.npy", head)
    for name in ("head.npy", "head.npz"):
        refused(rf"must be an .npy of version 1.0, got \(2, 0\).*{name}", lambda: read_grasps(tmp_path / name))
    np.savez(tmp_path / "other.npz", poses=np.eye(4)[None])
    refused("with the array transforms", lambda: read_grasps(tmp_path / "other.npz"))
    np.savez(tmp_path / "flat.npz", transforms=np.eye(4))
    refused(r"shape \[N, 4, 4\]", lambda: read_grasps(tmp_path / "flat.npz"))
    whole = many(3).save(tmp_path / "good.npz").read_bytes()
    for bad in (b"", whole[:-30], whole[:60] + b"\xff" * 20 + whole[80:]):
        (tmp_path / "bad.npz").write_bytes(bad)
        refused("must be an .npz", lambda: read_grasps(tmp_path / "bad.npz"))


def test_damaged_acronym_files_are_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    flex = "grasps/qualities/flex/"
    for number, (match, key, value) in enumerate([
        ("grasps/transforms must be in the file", "grasps/transforms", None),
        ("object/file must be in the file", "object/file", None),
        ("object/scale must be in the file", "object/scale", None),
        (r"shape \[N, 4, 4\]", "grasps/transforms", np.eye(4)),
        ("must be finite", "grasps/transforms", np.full((3, 4, 4), np.nan)),
        (r"shape \[3\]", flex + "object_in_gripper", [1]),
        ("true or false", flex + "object_in_gripper", [1, 2, 3]),
        (r"shape \[3\]", flex + "object_motion_during_closing_linear", [0.1]),
        ("object/scale must be numbers", "object/scale", "big"),
        ("object/file must be a text", "object/file", 3),
        ("object/com must be finite", "object/com", [np.inf, 0, 0]),
        ("scale_m must be between", "object/scale", 0.0),
    ]):  # fmt: skip
        path = many(3).save(tmp_path / f"{number}.h5")
        with h5py.File(path, "a") as file:
            del file[key]
            if value is not None:
                file[key] = value
        refused(match, lambda: read_grasps(path))
    with h5py.File(tmp_path / "group.h5", "w") as file:
        file.create_group("grasps/transforms")
    refused("must be an array", lambda: read_grasps(tmp_path / "group.h5"))
    with h5py.File(tmp_path / "large.h5", "w") as file:
        file.create_dataset("grasps/transforms", (3, 4, 4), "f4", maxshape=(None, 4, 4), chunks=(2**24, 4, 4))
    refused("must be an array of at most", lambda: read_grasps(tmp_path / "large.h5"))
    whole = path.read_bytes()
    for bad in (b"", b"no HDF5", whole[:900]):
        (tmp_path / "bad.h5").write_bytes(bad)
        refused("must be ACRONYM's HDF5|must be in the file", lambda: read_grasps(tmp_path / "bad.h5"))


def test_hdf5_is_not_followed_into_other_files(tmp_path):
    h5py = pytest.importorskip("h5py")
    other, key = str(many(3).save(tmp_path / "other.h5")), "grasps/transforms"
    virtual = h5py.VirtualLayout((3, 4, 4), "f8")
    virtual[:] = h5py.VirtualSource(other, key, (3, 4, 4))
    ways = {
        "link": lambda file: file.__setitem__(key, h5py.ExternalLink(other, key)),
        "group": lambda file: file.__setitem__("grasps", h5py.ExternalLink(other, "grasps")),
        "soft": lambda file: file.update({"elsewhere": h5py.ExternalLink(other, "grasps"), "grasps": h5py.SoftLink("/elsewhere")}),
        "raw": lambda file: file.create_dataset(key, (3, 4, 4), "f4", external=[(other, 0, 192)]),
        "virtual": lambda file: file.create_virtual_dataset(key, virtual),
    }
    for name, way in ways.items():
        path = many(3).save(tmp_path / f"{name}.h5")
        with h5py.File(path, "a") as file:
            del file["grasps"]
            way(file)
        refused(f"must be in the file itself.*{name}.h5", lambda: read_grasps(path))


def test_paths_and_arguments_are_checked(tmp_path, monkeypatch):
    refused("path must be a file, got .*nowhere.h5", lambda: read_grasps(tmp_path / "nowhere.h5"))
    (tmp_path / "folder.npy").mkdir()
    refused("path must be a file", lambda: read_grasps(tmp_path / "folder.npy"))
    refused("path must end with one of", lambda: read_grasps(tmp_path / "grasps.txt"))
    refused("format must be one of", lambda: read_grasps(tmp_path / "grasps.h5", "vgn"))
    refused("path must be a path", lambda: read_grasps(3))
    refused("base_to_tips_m must be between", lambda: read_grasps(tmp_path / "grasps.h5", base_to_tips_m=-1))
    refused("gripper must be", lambda: read_grasps(tmp_path / "grasps.h5", gripper=3))
    refused("folder that exists", lambda: one_above().save(tmp_path / "no" / "set.json"))
    refused("path must be a file in a folder", lambda: one_above().save(tmp_path / "folder.npy"))
    refused("base_to_tips_m or gripper", lambda: one_above(base_to_tips_m=None).save(tmp_path / "set.json"))
    refused("NAME.json must be beside", lambda: ObjectGrasps.load(many(2).save(tmp_path / "set.parquet", "graspnet")))
    for form, package in (("acronym", "h5py"), ("isaac_grasp", "yaml"), ("parquet", "pyarrow.parquet")):
        path = tmp_path / f"set.{ENDINGS.get(form, form)}"
        path.write_text("")
        path.with_suffix(".json").write_text("{}")
        with monkeypatch.context() as hidden:
            hidden.setitem(sys.modules, package, None)
            told = "pyyaml" if package == "yaml" else package.split(".")[0]
            refused(rf"needs {told}: pip install graspmill\[grasps\]", lambda: read_grasps(path, base_to_tips_m=0.1))


def test_an_existing_file_stays_if_the_new_one_cannot_be_written(tmp_path):
    path = one_above().save(tmp_path / "set.json")
    before = path.read_bytes()
    refused("held must be known", lambda: one_above(held=None).save(path))
    assert path.read_bytes() == before and [one.name for one in tmp_path.iterdir()] == ["set.json"]


def test_sets_of_wrong_arrays_are_refused():
    refused(r"held must have the shape \[1\]", lambda: one_above(held=[True, False]))
    refused(r"contacts_m must be numbers of the shape \[1, 2, 3\]", lambda: one_above(contacts_m=np.zeros((1, 3))))
    refused("width_m must be finite, or NaN", lambda: one_above(width_m=[np.inf]))
    refused("outcome must be 1 words", lambda: one_above(outcome=[1]))
    refused("is_free_on_table must be bool", lambda: one_above(is_free_on_table=[[True]]))
    refused("rigid", lambda: ObjectGrasps("x", 2 * np.eye(4)[None]))
    far = np.eye(4) + 5e3 * np.eye(4, k=3)
    refused("positions in metres", lambda: ObjectGrasps("x", far[None]))
    refused("info must be a mapping", lambda: one_above(info=[1]))
    refused("info.gripper must be a mapping", lambda: one_above(info={"gripper": 3}).save("never.json"))
    refused("which must be of the 1 grasps", lambda: one_above().subset([3]))
    refused("which must be bool or whole numbers", lambda: one_above().subset([0.5]))
    assert len(one_above().subset([])) == 0 and len(one_above().subset([0, 0])) == 2
    assert np.isnan(ObjectGrasps("x", ABOVE[None]).contacts_m).all() and len(ObjectGrasps("x", [])) == 0


def test_a_damaged_set_of_the_program_is_refused(tmp_path):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    info = {"object": {"name": "a", "file": "a.obj", "scale_m": 1.0}, "gripper": {}, "stable_poses": []}
    path = tmp_path / "a.parquet"
    for match, bytes_, told in (
        ("must be Parquet", b"no parquet", info),
        ("x_m must be in the file", None, info),
        ("object must be in the file", None, {}),
    ):
        parquet.write_table(arrow.table({"held": [1]}), path)
        if bytes_ is not None:
            path.write_bytes(bytes_)
        path.with_suffix(".json").write_text(json.dumps(told))
        refused(match, lambda: ObjectGrasps.load(path))
