"""Reads the output of `shards export` like other projects' loaders and compares it with the dataset's rows.

    GRASPMILL_DATASET=path/to/dataset python -m pytest tests/python/test_exports.py

The program is GRASPMILL_SHARDS, or target/debug/shards.

The loaders here work like VGN's `dataset.py` and GIGA's `dataset_voxel.py`, with only numpy and csv. The originals were run, too.
"""

import csv
import io
import json
import os
import subprocess
from itertools import groupby
from pathlib import Path

import numpy as np
import pyarrow.dataset as pads
import pyarrow.parquet as pq
import pytest

ROOT = Path(__file__).parents[2]
SHARDS = Path(os.environ.get("GRASPMILL_SHARDS", ROOT / "target" / "debug" / "shards")).resolve()
if "GRASPMILL_DATASET" not in os.environ:
    pytest.exit("set GRASPMILL_DATASET to the folder of a dataset", returncode=4)
DATASET = Path(os.environ["GRASPMILL_DATASET"]).resolve()
INFO = json.loads((DATASET / "meta/info.json").read_text())
SIDE, SIZE_M = INFO["grid"]["resolution"], INFO["grid"]["size_m"]
VOXEL_M = SIZE_M / SIDE
OPENING_M, FINGER_M = INFO["gripper"]["opening_m_max"], INFO["gripper"]["finger_length_m"]


def shards(*args):
    if not SHARDS.exists():
        pytest.fail(f"no shards at {SHARDS}: cargo build, or set GRASPMILL_SHARDS")
    return subprocess.run([str(word) for word in (SHARDS, *args)], capture_output=True, text=True, check=False)


def exported(out, form="vgn"):
    done = shards("export", DATASET, "--format", form, "--out", out)
    assert done.returncode == 0, done.stderr
    return json.loads((out / "export.json").read_text())


def table(name, columns=None):
    rows = pads.dataset(DATASET / name, format="parquet").to_table(columns=columns).to_pylist()
    return sorted(rows, key=lambda row: (row["scene_id"], row.get("attempt_id", row.get("object_id", 0))))


@pytest.fixture(scope="module")
def attempts():
    return table("attempts")


@pytest.fixture(scope="module")
def grids():
    rows = pads.dataset(DATASET / "scenes", format="parquet").to_table(columns=["scene_id", "tsdf"]).to_pylist()
    return {row["scene_id"]: np.array(row["tsdf"], dtype=np.float32) for row in rows}


@pytest.fixture(scope="module")
def vgn(tmp_path_factory):
    out = tmp_path_factory.mktemp("vgn") / "out"
    return out, exported(out)


def approach(row):
    """The grasp's z axis in the workspace."""
    x, y, z, w = (row[part] for part in ("qx", "qy", "qz", "qw"))
    return np.array([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)])


def roots_m(row):
    return np.array([row["x_m"], row["y_m"], row["z_m"]]) - FINGER_M * approach(row)


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


def test_vgns_samples_are_the_attempts(vgn, attempts):
    out, told = vgn
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
        member = next(m for m in group if np.allclose(rotations[0], [m["qx"], m["qy"], m["qz"], m["qw"]], atol=1e-6))
        assert np.isclose(width * VOXEL_M, member["width_m"] if label else OPENING_M, atol=1e-6)
        assert abs(np.linalg.norm(rotations[1]) - 1) < 1e-3
        assert loader.rows[number]["scene_id"] == f"scene-{group[0]['scene_id']:09}"
        count += 1
    assert next(found, None) is None
    assert count > 0
    counts = told["counts"]
    assert (counts["grasps"], counts["left_out"], counts["attempts"]) == (count, left_out, len(attempts))


def test_vgns_grids_are_the_scenes(vgn, grids):
    out, told = vgn
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


def test_plain_tables_have_encodings_that_every_reader_knows_and_the_same_values(tmp_path):
    told = exported(tmp_path / "plain", "parquet")
    known = {"PLAIN", "RLE", "PLAIN_DICTIONARY", "RLE_DICTIONARY", "BIT_PACKED"}
    for name in ("attempts", "scenes", "objects"):
        files = sorted((DATASET / name).glob("*.parquet"))
        copies = [tmp_path / "plain" / name / path.name for path in files]
        assert sorted((tmp_path / "plain" / name).iterdir()) == copies
        for path, copy in zip(files, copies):
            encodings = [encodings_of(one) for one in (path, copy)]
            assert "BYTE_STREAM_SPLIT" in encodings[0] and encodings[1] <= known, encodings
            before, after = pq.read_table(path), pq.read_table(copy)
            assert after.schema.equals(before.schema, check_metadata=True) and after.equals(before), path
        # A reader that does not know a footer's order of floats ignores their statistics, as this pyarrow, or fails, as
        # old polars.
        shown = [column_of(one, "x_m").statistics.has_min_max for one in (files[0], copies[0]) if name != "scenes"]
        assert shown in ([], [False, True], [True, True]), name
    assert told["counts"]["attempts"] == pads.dataset(DATASET / "attempts", format="parquet").count_rows()
    assert json.loads((tmp_path / "plain/meta/info.json").read_text())["grid"] == INFO["grid"]


def column_of(path, name):
    meta = pq.read_metadata(path)
    return next(one for one in map(meta.row_group(0).column, range(meta.num_columns)) if one.path_in_schema == name)


def encodings_of(path):
    meta = pq.read_metadata(path)
    chunks = [meta.row_group(group).column(column) for group in range(meta.num_row_groups) for column in range(meta.num_columns)]
    assert {chunk.compression for chunk in chunks} == {"ZSTD"}
    return {encoding for chunk in chunks for encoding in chunk.encodings}


def test_the_same_dataset_gives_the_same_bytes(vgn, tmp_path):
    first = vgn[0]
    exported(tmp_path / "again")

    def files(root):
        return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}

    assert files(first) == files(tmp_path / "again")


def test_a_folder_of_others_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    done = shards("export", DATASET, "--format", "vgn", "--out", tmp_path)
    assert done.returncode == 78 and "thesis.tex" in done.stderr, done
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
