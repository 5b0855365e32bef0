"""Reads `graspmill dataset export` like VGN's `dataset.py` and GIGA's `dataset_voxel.py`, with only numpy and csv, and
compares it with the dataset's rows. The originals were run, too."""

import csv
import fcntl
import json
import resource
import shutil
from itertools import groupby

import numpy as np
import pyarrow.dataset as pads
import pytest
from programs import DATASET, ROOT, commanded, files, packaged

from crosscheck.pose import rotation_of
from grasp_sets import graspmill, refused  # before the modules of the package, of which there may be none
from graspmill import formats

INFO = json.loads((DATASET / "meta/info.json").read_text())
SIDE, SIZE_M = INFO["grid"]["resolution"], INFO["grid"]["size_m"]
VOXEL_M = SIZE_M / SIDE
OPENING_M, FINGER_M = INFO["gripper"]["opening_m_max"], INFO["gripper"]["finger_length_m"]


def export(dataset, form, out, *more, code=0, by=commanded, **how):
    return by("dataset", "export", dataset, "--format", form, "--out", out, *more, code=code, **how)


def exported(out, form="vgn", dataset=DATASET):
    export(dataset, form, out)
    return json.loads((out / "export.json").read_text())


@pytest.fixture(scope="module")
def points(tmp_path_factory):
    """A dataset by VGN's sampler: six yaws about each point, some near the workspace's faces."""
    folder = tmp_path_factory.mktemp("points") / "ds"
    graspmill.generate(folder, ROOT / "configs/generate/vgn.toml", shards=1, attempts=600, seed=3)
    return folder


def table(name, dataset=DATASET):
    rows = pads.dataset(dataset / name, format="parquet").to_table().to_pylist()
    return sorted(rows, key=lambda row: (row["scene_id"], row.get("attempt_id", row.get("object_id", 0))))


@pytest.fixture(scope="module")
def vgn(tmp_path_factory):
    out = tmp_path_factory.mktemp("vgn") / "out"
    return out, exported(out)


def roots_m(row):
    approach = rotation_of(np.array([row[part] for part in ("qx", "qy", "qz", "qw")]))[:, 2]
    return np.array([row["x_m"], row["y_m"], row["z_m"]]) - FINGER_M * approach


def samples(rows):
    """An attempt by a rule is a sample; those along the normal of one point are one together."""

    def point(row):
        own = row["attempt_id"] if row["approach_axis"] != "normal" else (row["x_m"], row["y_m"], row["z_m"])
        return row["scene_id"], own

    return [list(group) for _, group in groupby(rows, point)]


class Loader:
    """VGN's: positions in voxels, rounded; a quaternion and its half turn; the grid from a file named by the row."""

    def __init__(self, root):
        self.root = root
        with open(root / "grasps.csv", newline="") as file:
            self.rows = list(csv.DictReader(file))

    def __len__(self):
        return len(self.rows)

    def grid(self, number):
        with np.load(self.root / "scenes" / (self.rows[number]["scene_id"] + ".npz")) as file:
            return file["grid"]

    def target(self, number):
        row = self.rows[number]
        position = np.array([row[axis] for axis in "ijk"], dtype=np.single)
        x, y, z, w = turned = np.array([row[part] for part in ("qx", "qy", "qz", "qw")], dtype=np.single)
        half_turn = np.array([y, -x, w, -z])  # after a half turn about its own z
        return (int(row["label"]), np.stack([turned, half_turn]), np.single(row["width"])), np.round(position).astype(int)


def middle(group):
    """The middle of the widest run of yaws that held, by trying every start; the first attempt if none held."""
    held = [row["outcome"] == "held" for row in group]
    runs = {at: next((n for n in range(len(held)) if not held[(at + n) % len(held)]), len(held)) for at in range(len(held)) if held[at]}
    start = max(runs, key=lambda at: (runs[at], -at), default=0)
    return group[(start + (runs.get(start, 1) - 1) // 2) % len(held)]


@pytest.mark.parametrize("sampler", ["rules", "points"])
def test_vgns_samples_are_the_attempts(sampler, request, tmp_path):
    dataset = DATASET if sampler == "rules" else request.getfixturevalue("points")
    out, told, attempts = tmp_path / "out", exported(tmp_path / "out", dataset=dataset), table("attempts", dataset)
    assert sampler == "rules" or len(samples(attempts)) == len(attempts) / 6
    loader = Loader(out)
    found = iter(range(len(loader)))
    left_out = count = 0
    for group in samples(attempts):
        origin_m = roots_m(group[0])
        edge_m = min(origin_m.min(), SIZE_M - origin_m.max()) - max(0.02, VOXEL_M)
        if edge_m < -1e-6:
            left_out += 1
            continue
        if edge_m < 1e-6:
            pytest.skip("a grasp on the very edge: which side it falls is a matter of rounding")
        number = next(found)
        # VGN's voxel is the one with the nearest lower corner; the voxel of the point is that one or the previous.
        (label, rotations, width), index = loader.target(number)
        voxels = origin_m / VOXEL_M
        assert np.abs(voxels - index).max() <= 0.5 + 1e-4
        assert set((index - np.floor(voxels).astype(int)).tolist()) <= {0, 1}
        assert index.min() >= 1 and index.max() <= SIDE - 1
        assert label == max(member["label"] for member in group)
        member = middle(group)
        np.testing.assert_allclose(rotations[0], [member["qx"], member["qy"], member["qz"], member["qw"]], atol=1e-6)
        assert np.isclose(width * VOXEL_M, member["width_m"] if label else OPENING_M, atol=1e-6)
        assert abs(np.linalg.norm(rotations[1]) - 1) < 1e-3
        assert loader.rows[number]["scene_id"] == f"scene-{group[0]['scene_id']:09}"
        count += 1
    assert next(found, None) is None
    assert count > 0
    counts = told["counts"]
    assert (counts["grasps"], counts["left_out"], counts["attempts"]) == (count, left_out, len(attempts))


def test_vgns_grids_are_the_scenes(vgn):
    (out, told), grids = vgn, {row["scene_id"]: np.array(row["tsdf"], dtype=np.float32) for row in table("scenes")}
    loader = Loader(out)
    first = {row["scene_id"]: number for number, row in reversed(list(enumerate(loader.rows)))}
    files = sorted((out / "scenes").iterdir())
    assert len(files) == told["counts"]["scenes"] > 0
    for path in files:
        with np.load(path) as file:
            assert file.files == ["grid"]
        grid = loader.grid(first[path.stem])
        assert (grid.shape, grid.dtype) == ((1, SIDE, SIDE, SIDE), np.float32)
        np.testing.assert_array_equal(grid[0], grids[int(path.stem.removeprefix("scene-"))])
    assert {path.stem for path in files} == set(first)


def test_gigas_rows_are_vgns_in_metres(vgn):
    out, _ = vgn
    setup = json.loads((out / "raw/setup.json").read_text())
    assert setup["size"] == SIZE_M
    assert (setup["max_opening_width"], setup["finger_depth"]) == (OPENING_M, FINGER_M)
    assert len(setup["intrinsic"]["K"]) == 9
    with open(out / "raw/grasps.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["scene_id", "qx", "qy", "qz", "qw", "x", "y", "z", "width", "label"]
    voxels = Loader(out).rows
    assert len(rows) == len(voxels)
    for metre, voxel in zip(rows, voxels):
        for lengths in (("x", "i"), ("y", "j"), ("z", "k"), ("width", "width")):
            assert np.isclose(float(metre[lengths[0]]), float(voxel[lengths[1]]) * VOXEL_M, atol=1e-6)
        for same in ("scene_id", "qx", "qy", "qz", "qw", "label"):
            assert metre[same] == voxel[same]


@pytest.mark.parametrize("form", ["vgn", "mjcf"])
def test_the_same_bytes_each_time_and_a_stopped_export_goes_on(form, tmp_path, vgn):
    dataset, one, two = graspmill.Dataset(DATASET), tmp_path / "one", tmp_path / "two"
    told = exported(one, form)
    left = files(one)
    assert exported(one, form) == told and files(one) == left, "a complete one is left as it is"
    assert not [name for name in left if name.endswith((".part", ".lock"))]
    if form == "vgn":
        assert left == files(vgn[0])

    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        formats.export(dataset, form, str(two), done=stop)
    assert (two / "export-begun.json").exists() and not (two / "export.json").exists()
    begun = export(DATASET, "urdf" if form == "mjcf" else "mjcf", two, code=78)
    assert f"it holds an export as {form} of dataset {dataset.id}" in begun.stderr
    # As if it had been killed in a write, too.
    (two / "export.json.part").write_text("half")
    (two / "scene-000000004.part").mkdir()
    (two / "scene-000000004.part/left.xml").write_text("half")
    if form != "mjcf":
        shutil.rmtree(two / "scene-000000004.part")
    scenes = []
    assert formats.export(dataset, form, str(two), done=scenes.append) == told
    assert sum(scenes) == dataset.scene_count and files(two) == left


def test_ctrl_c_ends_the_program_so_that_it_is_run_again(monkeypatch, tmp_path):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(formats, "export", stopped)
    assert "the same command continues" in export(DATASET, "vgn", tmp_path, code=75).stderr


def test_what_cannot_be_is_refused_and_nothing_of_others_is_touched(vgn, points, tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged/export.json").write_text("{}")
    for dataset, form, out, more, code, told in [
        (DATASET, "vgn", tmp_path, (), 78, 'it holds "damaged", which is no export'),
        (DATASET, "vgn", tmp_path / "damaged", (), 78, "what it says about its export is damaged"),
        (DATASET, "vgn", tmp_path / "thesis.tex", (), 78, "must go to a folder, got a file"),
        (DATASET, "vgn", tmp_path / "thesis.tex/out", (), 78, "failed to write to"),
        (DATASET, "vgn", "s3://bucket/out", (), 78, "the export must go to a folder on a disk, got s3://bucket/out"),
        (DATASET, "vgn", DATASET, (), 78, "which is no export"),
        (points, "vgn", vgn[0], (), 78, "it holds an export as vgn of dataset"),
        (tmp_path, "vgn", tmp_path / "new", (), 78, ""),
        (DATASET, "vgn", tmp_path / "new", ("--scenes", "3"), 78, "scenes may be selected of mjcf, urdf and usda, got vgn"),
        (DATASET, "mjcf", tmp_path / "new", ("--scenes", "3-10000"), 78, "scenes must be below the number of scenes"),
        (DATASET, "mjcf", tmp_path / "new", ("--scenes", "9-3"), 78, "must be ranges that are not empty, got `9-3`"),
        (DATASET, "mjcf", tmp_path / "new", ("--scenes=-3",), 78, "such as 0-9,17, got `-3`"),
        (DATASET, "hdf5", tmp_path / "new", (), 2, "hdf5"),
    ]:
        done = export(dataset, form, out, *more, code=code)
        assert told in done.stderr and not done.stdout, (out, done)
    assert not (tmp_path / "new").exists()
    assert files(tmp_path) == {"thesis.tex": b"mine", "damaged/export.json": b"{}"}


def test_datasets_that_do_not_fit_vgn_are_refused(tmp_path):
    refused("grids of 40\\^3 voxels, the dataset has 64\\^3", lambda: formats.vgn.check({"grid": {"resolution": 64}}))
    several = {"grid": {"resolution": 40}, "gripper": {}, "grippers": [{}, {}]}
    refused("VGN's format has one gripper, the dataset has 2", lambda: formats.vgn.check(several))


@pytest.mark.parametrize("form", ["vgn", "mjcf"])
def test_a_damaged_dataset_is_not_exported_as_whole(form, tmp_path):
    shutil.copytree(DATASET, tmp_path / "ds")
    path = max((tmp_path / "ds/scenes").iterdir())
    damaged = bytearray(path.read_bytes())
    damaged[100] ^= 1
    path.write_bytes(damaged)
    assert export(tmp_path / "ds", form, tmp_path / "out", code=65).stderr.startswith("error: ")
    assert not any((tmp_path / "out" / name).exists() for name in ("export.json", "grasps.csv"))


def test_a_full_disk_and_another_writer_are_reasons_to_try_again(tmp_path):
    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    full = export(DATASET, "vgn", tmp_path / "out", preexec_fn=limited, code=75, by=packaged)
    assert "failed to write to" in full.stderr
    with open(tmp_path / "out/.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "another process writes in this folder" in export(DATASET, "vgn", tmp_path / "out", code=75).stderr
    exported(tmp_path / "out")


def test_the_program_says_how_much_it_wrote(tmp_path):
    done = export(DATASET, "mjcf", tmp_path / "out", "--scenes", "8, 1-2,2-3", by=packaged)
    told = json.loads((tmp_path / "out/export.json").read_text())
    assert (told["origin"]["scenes"], told["counts"]["scenes"]) == ("1-3,8", 4)
    assert sorted(path.name[-1] for path in (tmp_path / "out").glob("scene-*")) == ["1", "2", "3", "8"]
    assert done.stderr == "", "no progress without a terminal"
    counts = {key: f"{count:,}" for key, count in told["counts"].items()}
    assert done.stdout == f"{counts['grasps']} grasps ({counts['positives']} positive) in 4 scenes: {tmp_path / 'out'}\n"
    help_ = export(DATASET, "mjcf", tmp_path, "--help").stdout
    assert "Examples:" in help_ and "GIGA" in help_ and "{vgn,mjcf,urdf,usda}" in help_
