"""The cross-check of datasets whose objects are models from meta/info.json, with the same bodies in both engines."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from attempts import DOWN, GRIPPER, PROCEDURE, TABLE, UPRIGHT

from crosscheck import dataset, engines
from crosscheck.attempt import Runner
from crosscheck.compound import Compound, compound_of
from crosscheck.contract import Attempt, Scene, SceneObject
from crosscheck.pose import Pose

# A T of two boxes, 60 mm wide and 60 mm high about the middle of its box; the stem is 20 mm thick.
BAR = [[x, y, z] for x in (-0.03, 0.03) for y in (-0.015, 0.015) for z in (0.01, 0.03)]
STEM = [[x, y, z] for x in (-0.01, 0.01) for y in (-0.015, 0.015) for z in (-0.03, 0.01)]
POSE = {"x_m": 0.15, "y_m": 0.15, "z_m": 0.08, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
OBJECT = {
    "scene_id": 0, "object_id": 0, "shape": "cuboid", "size_x_m": 0.06, "size_y_m": 0.03, "size_z_m": 0.06, "mass_kg": 0.1,
    "friction": 1.0, **POSE,
}  # fmt: skip
ATTEMPT = {
    "scene_id": 0, "attempt_id": 0, "object_id": 0, "shape": "cuboid", "rule": "model_normal", **POSE, "outcome": "held",
    "hit": None, "width_m": 0.03,
}  # fmt: skip


def written(folder: Path, version: int = 2, models: bool = True, **row: object) -> Path:
    """A dataset of one scene: a T that is called as a primitive is."""
    info = {
        "format_version": version, "seed": 1, "scene_count": 1, "grid": {"table_z_m": 0.05}, "gripper": asdict(GRIPPER),
        "procedure": vars(PROCEDURE),
        "config": {"physics": {"table_friction": 1.0, "gravity_m_s2": 9.81, "step_rate_hz": 240.0}},
        **({"models": [{"name": "cuboid", "parts": [{"corners_m": BAR}, {"corners_m": STEM}]}]} if models else {}),
    }  # fmt: skip
    for name in ("meta", "objects", "attempts"):
        (folder / name).mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    pq.write_table(pa.Table.from_pylist([{**OBJECT, **row}]), folder / "objects" / "a.parquet")
    pq.write_table(pa.Table.from_pylist([ATTEMPT]), folder / "attempts" / "a.parquet")
    return folder


def test_a_name_means_the_datasets_model_before_a_primitive(tmp_path):
    [scene] = dataset.read(written(tmp_path / "models"), None).scenes
    body = scene.objects[0].solid
    assert isinstance(body, Compound) and len(body.convexes) == 2
    assert body.volume_m3 == pytest.approx(0.06 * 0.03 * 0.02 + 0.02 * 0.03 * 0.04)
    [scene] = dataset.read(written(tmp_path / "primitives", version=1, models=False), None).scenes
    assert scene.objects[0].solid.volume_m3 == pytest.approx(0.06 * 0.03 * 0.06)


def test_rows_that_do_not_fit_the_models_are_refused(tmp_path):
    for name, row, expected in [("size", {"size_x_m": 0.07}, "its parts"), ("name", {"shape": "mug"}, "unknown shape 'mug'")]:
        with pytest.raises(dataset.DamagedDataset, match=expected):
            dataset.read(written(tmp_path / name, **row), None)
    with pytest.raises(dataset.DamagedDataset, match="this program reads 1 to 6"):
        dataset.read(written(tmp_path / "newer", version=7), None)


@pytest.mark.parametrize("name", engines.ENGINES)
def test_an_engine_has_the_model_where_it_is_and_holds_it(name):
    """The gripper comes from above: it closes on the bar, across its 30 mm or its 60 mm."""
    pytest.importorskip(name)
    engine = engines.make(name)
    body = compound_of("tee", [BAR, STEM])
    place = Pose(np.array([0.15, 0.15, 0.08]), UPRIGHT)
    ends = {}
    for case, quat, tip in [("along y", DOWN, 0.02), ("along x", np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]), 0.02)]:
        grasp = Pose(np.array([0.15, 0.15, 0.05 + 0.06 - tip]), quat)
        attempt = Attempt(0, 0, "tee", "model_normal", grasp, "held", None, 0.0)
        scene = Scene(0, [SceneObject(body, 0.1, 1.0, place)], [attempt])
        runner = Runner(engine, scene, GRIPPER, PROCEDURE, TABLE)
        engine.begin(None, None)
        np.testing.assert_allclose(engine.positions_m(), [place.position_m], atol=1e-5)
        ends[case] = runner.from_closing(attempt, grasp)
    engine.close()
    assert {case: end.outcome for case, end in ends.items()} == {"along y": "held", "along x": "held"}
    assert ends["along y"].width_m == pytest.approx(0.03, abs=2e-3)
    assert ends["along x"].width_m == pytest.approx(0.06, abs=2e-3)
