"""A dataset opens in common readers without our code; all expectations come from its own manifest and info."""

import json
import os
import re

os.environ["HF_HUB_OFFLINE"] = "1"  # before datasets is imported: no test may use the network

import datasets
import duckdb
import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.dataset as pads
import pyarrow.parquet as pq
import pytest
from programs import DATASET, ROOT
from huggingface_hub import DatasetCard

TABLES = ["attempts", "scenes", "objects"]
SNIPPETS = ROOT / "docs" / "reading.md"
INFO = json.loads((DATASET / "meta/info.json").read_text())
MANIFEST = json.loads((DATASET / "meta/manifest.json").read_text())
TOTALS = MANIFEST["totals"]
ROWS = {"attempts": TOTALS["labels"]["attempts"], "scenes": TOTALS["scenes"], "objects": TOTALS["objects"]}
SIDE = INFO["grid"]["resolution"]


def glob(table):
    return str(DATASET / table / "*.parquet")


@pytest.fixture(scope="module")
def hugging_face(tmp_path_factory):
    cache = str(tmp_path_factory.mktemp("cache"))
    return {table: datasets.load_dataset(str(DATASET), table, split="train", cache_dir=cache) for table in TABLES}


@pytest.mark.parametrize("table", TABLES)
def test_every_reader_counts_the_same_rows(table, hugging_face):
    assert pads.dataset(DATASET / table, format="parquet").count_rows() == ROWS[table]
    assert duckdb.sql(f"SELECT count(*) FROM '{glob(table)}'").fetchall()[0][0] == ROWS[table]
    assert pl.scan_parquet(glob(table)).select(pl.len()).collect().item() == ROWS[table]
    assert hugging_face[table].num_rows == ROWS[table]


LABELS = {0: ROWS["attempts"] - TOTALS["labels"]["positives"], 1: TOTALS["labels"]["positives"]}


@pytest.mark.parametrize(("column", "totals", "kind"), [("label", LABELS, pl.UInt8), ("outcome", TOTALS["outcomes"], pl.String)])
def test_labels_and_the_names_of_outcomes_are_counted_the_same_in_every_reader(column, totals, kind, hugging_face):
    expected = {value: count for value, count in totals.items() if count}
    counts = pads.dataset(DATASET / "attempts", format="parquet").to_table()[column].value_counts().to_pylist()
    assert {row["values"]: row["counts"] for row in counts} == expected
    assert dict(duckdb.sql(f"SELECT {column}, count(*) FROM '{glob('attempts')}' GROUP BY {column}").fetchall()) == expected
    assert dict(pl.scan_parquet(glob("attempts")).group_by(pl.col(column).cast(kind)).len().collect().iter_rows()) == expected
    values, counts = np.unique(hugging_face["attempts"][column], return_counts=True)
    assert dict(zip(values.tolist(), counts.tolist())) == expected


def test_column_types_of_attempts(hugging_face):
    names = "dictionary<values=string, indices=int32, ordered=0>"
    expected = {  # column: in pyarrow, in DuckDB, in polars, in datasets
        "scene_id": ("int64", "BIGINT", pl.Int64, "int64"),
        "attempt_id": ("int32", "INTEGER", pl.Int32, "int32"),
        "rule": (names, "VARCHAR", pl.Categorical, "string"),
        "outcome": (names, "VARCHAR", pl.Categorical, "string"),
        "hit": (names, "VARCHAR", pl.Categorical, "string"),
        "hit_object_id": ("int32", "INTEGER", pl.Int32, "int32"),
        "width_m": ("float", "FLOAT", pl.Float32, "float32"),
        "qw": ("float", "FLOAT", pl.Float32, "float32"),
        "label": ("uint8", "UTINYINT", pl.UInt8, "uint8"),
    }
    arrow = pads.dataset(DATASET / "attempts", format="parquet").schema
    duck = {row[0]: row[1] for row in duckdb.sql(f"DESCRIBE SELECT * FROM '{glob('attempts')}'").fetchall()}
    polars = pl.scan_parquet(glob("attempts")).collect_schema()
    features = hugging_face["attempts"].features
    found = {name: (str(arrow.field(name).type), duck[name], polars[name], features[name].dtype) for name in expected}
    assert found == expected


def test_the_grid_has_its_shape_in_every_reader(hugging_face):
    schema = pq.read_schema(next((DATASET / "scenes").glob("*.parquet")))
    nested, shape = schema.field("tsdf").type, []
    while pa.types.is_fixed_size_list(nested):
        shape.append(nested.list_size)
        nested = nested.value_type
    assert shape == [SIDE] * 3 and nested == pa.float32()
    assert pl.scan_parquet(glob("scenes")).collect_schema()["tsdf"] == pl.Array(pl.Float32, (SIDE, SIDE, SIDE))

    table = pads.dataset(DATASET / "scenes", format="parquet").to_table(filter=pads.field("scene_id") == 0)
    by_arrow = np.array(table["tsdf"][0].as_py(), dtype=np.float32)
    assert by_arrow.shape == (SIDE, SIDE, SIDE)
    assert ((by_arrow == 0) | ((by_arrow > 0.0099) & (by_arrow < 0.9901))).all() and (by_arrow > 0).any()
    row = duckdb.sql(f"SELECT tsdf FROM '{glob('scenes')}' WHERE scene_id = 0").fetchall()[0]
    np.testing.assert_array_equal(np.array(row[0], dtype=np.float32), by_arrow)
    frame = pl.scan_parquet(glob("scenes")).filter(pl.col("scene_id") == 0).collect()
    np.testing.assert_array_equal(frame["tsdf"].to_numpy()[0], by_arrow)
    by_datasets = hugging_face["scenes"].with_format("numpy")[0]
    assert by_datasets["scene_id"] == 0
    np.testing.assert_array_equal(by_datasets["tsdf"], by_arrow)


def test_keys_lead_from_table_to_table():
    attempts, objects = f"FROM '{glob('attempts')}' a", f"'{glob('objects')}' o USING (scene_id, object_id)"
    for query, most in (
        (f"count(*) {attempts} ANTI JOIN {objects}", 0),
        (f"count(*) {attempts} JOIN {objects} WHERE a.shape != o.shape OR a.label != (a.outcome = 'held')::INT", 0),
        (f"max(abs(qx*qx + qy*qy + qz*qz + qw*qw - 1)) {attempts}", 1e-3),
    ):
        assert duckdb.sql(f"SELECT {query}").fetchall()[0][0] <= most, query


def test_columns_say_what_they_mean():
    for table in TABLES:
        for field in pq.read_schema(next((DATASET / table).glob("*.parquet"))):
            assert field.metadata[b"description"], field.name


def test_the_hub_reads_the_cards_metadata_and_offers_attempts_first():
    assert datasets.get_dataset_default_config_name(str(DATASET)) == "attempts"
    assert sorted(datasets.get_dataset_config_names(str(DATASET))) == sorted(TABLES)
    data = DatasetCard.load(DATASET / "README.md").data
    assert data.license, "unknown, until its owner names one"
    assert data.task_categories == ["robotics"]
    assert len(data.size_categories) == 1
    assert [config["config_name"] for config in data.configs] == TABLES


def snippets(dataset=DATASET):
    """The page's Python, with a dataset of these tests: what needs PyTorch, and the rest."""
    blocks = re.findall(r"^```python\n(.*?)^```", SNIPPETS.read_text(), flags=re.MULTILINE | re.DOTALL)
    with_torch = [block for block in blocks if "import torch" in block]
    code = "\n".join(block for block in blocks if block not in with_torch)
    code, count = re.subn(r'^dataset = ".*"$', f"dataset = {str(dataset)!r}", code, flags=re.MULTILINE)
    assert count == 1, "the page names its dataset once"
    return code, "\n".join(with_torch)


def test_the_snippets_work(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path)
    code, with_torch = snippets()
    names = {"__name__": "snippets"}
    exec(compile(code, str(SNIPPETS), "exec"), names)
    printed = capsys.readouterr().out
    assert f"({SIDE}, {SIDE}, {SIDE}) grid," in printed
    assert f"{ROWS['attempts']} attempts," in printed
    compile(with_torch, str(SNIPPETS), "exec")
    check_samples(names)


def check_samples(names):
    """The page's samples, from the tables in another way."""
    scenes = pl.read_parquet(glob("scenes"), columns=["scene_id", "tsdf"])
    grids = dict(zip(scenes["scene_id"], scenes["tsdf"].to_numpy()))
    rows = duckdb.sql(f"SELECT scene_id, x_m, y_m, z_m, qw, label FROM '{glob('attempts')}'").fetchall()
    rows = [row for row in rows if row[0] in set(names["scene_ids"].tolist())]
    size_m = INFO["grid"]["size_m"]
    inside = [row for row in rows if all(0 <= at < size_m for at in row[1:4])]
    samples, chosen = names["Samples"], [*names["train"], *names["test"]]
    assert len(chosen) == len(inside) and len(rows) == len(names["attempts"])
    found = []
    for number, row in enumerate(chosen):
        tsdf, voxel, quaternion, label = samples(chosen)[number]
        scene = names["attempts"]["scene_id"][int(row)]
        assert tsdf.shape == (1, SIDE, SIDE, SIDE) and tsdf.dtype == np.float32
        np.testing.assert_array_equal(tsdf[0], grids[scene])
        at_m = names["attempts"].select("x_m", "y_m", "z_m").row(int(row))
        assert all(0 <= at / size_m * SIDE - index < 1 + 1e-4 for at, index in zip(at_m, voxel)), (at_m, voxel)
        found.append((scene, *at_m, float(quaternion[3]), float(label)))
    assert sorted(found) == sorted(tuple(map(float, row)) for row in inside)
    scenes_of = [{names["attempts"]["scene_id"][int(row)] for row in names[part]} for part in ("train", "test")]
    assert scenes_of[0] and scenes_of[1] and not scenes_of[0] & scenes_of[1]


def test_the_snippet_for_pytorch_works(tmp_path, monkeypatch, capsys):
    pytest.importorskip("torch", reason="PyTorch is not installed, its packages take 3 GB: scripts/requirements-golden.txt has it")
    graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path)
    graspmill.generate(tmp_path / "ds", shards=1, attempts=240, seed=2)
    exec(compile("\n".join(snippets(tmp_path / "ds")), str(SNIPPETS), "exec"), {"__name__": "snippets"})
    loss = capsys.readouterr().out.rsplit("loss of the last batch: ", 1)[1]
    assert 0.0 < float(loss) < 10.0
