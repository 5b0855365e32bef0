"""Reads a set of grasps of floating objects as a dataset of which each scene is one object, at its own origin."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from .compound import compound_of
from .contract import BLOCKED, OUTCOMES, Attempt, Environment, Gripper, Procedure, Scene, SceneObject
from .dataset import DamagedDataset, Dataset, NoDataset, build, pose_of
from .floating import loads
from .pose import Pose

# There is neither gravity nor a table; the engines need one, so it is far below.
NOWHERE = Environment(table_z_m=-10.0, table_friction=1.0, gravity_m_s2=0.0)
AT_ORIGIN = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
# Centres of mass are rounded to single precision, and so are the corners of thin parts.
CENTRE_TOLERANCE_M = 5e-5


def read(folder: Path, object_count: int | None, grasp_count: int | None) -> tuple[Dataset, str]:
    """The first grasps of a set's first objects (all if None), and the name of its test."""
    files = sorted(path for path in folder.glob("*.json") if path.with_suffix(".parquet").is_file())
    if not files:
        raise NoDataset(f"{folder} holds no set of grasps: there is no NAME.json with a NAME.parquet")
    tests, grippers, procedures, scenes = set(), [], [], []
    for number, path in enumerate(files[:object_count]):
        try:
            about = json.loads(path.read_text())
            tests.add(about["test"])
            grippers.append(build(Gripper, about["gripper"]))
            loads(about["test"], grippers[-1])  # raises for a test that is unknown here
            procedures.append(build(Procedure, about["settings"]["procedure"]))
            physics = about["settings"]["physics"]
            rate = float(physics["step_rate_hz"])
            environment = replace(NOWHERE, finger_depth_m=float(physics.get("finger_depth_m_max", 0.0)))
            seed = int(about["settings"]["params"]["seed"])
            rows = pq.read_table(path.with_suffix(".parquet")).to_pylist()
            # Their gates do not push objects aside.
            rows = [row for row in rows if row.get("pushed_m") is None][:grasp_count]
            name = about["object"]["name"]
            scenes.append(Scene(number, [_object(about["object"])], [_grasp(row, name) for row in rows]))
        except (OSError, KeyError, TypeError, ValueError, pa.ArrowException) as error:
            raise DamagedDataset(f"{path}: {error!r}") from error
    if len(tests) > 1 or any(procedure != procedures[0] for procedure in procedures):
        raise DamagedDataset(f"{folder}: objects were not tested alike: {', '.join(sorted(tests))}")
    data = Dataset(folder.resolve().name, seed, grippers, procedures[0], environment, rate, scenes, len(files))
    return data, tests.pop()


def _object(about: dict) -> SceneObject:
    body = compound_of(about["name"], about["parts_m"])
    if not np.allclose(body.centroid_m, about["centre_of_mass_m"], rtol=0, atol=CENTRE_TOLERANCE_M):
        raise ValueError(f"the centre of mass is not that of the parts, {body.centroid_m.round(6).tolist()}")
    return SceneObject(body, float(about["mass_kg"]), float(about["friction"]), AT_ORIGIN)


def _grasp(row: dict, name: str) -> Attempt:
    if row["outcome"] not in OUTCOMES:
        raise ValueError(f"unknown outcome {row['outcome']!r}")
    hit = "target" if row["outcome"] in BLOCKED else None
    width_m = float("nan") if row["width_m"] is None else row["width_m"]
    return Attempt(row["grasp_id"], 0, name, row["source"], pose_of(row), row["outcome"], hit, width_m)
