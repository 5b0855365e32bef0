"""Reads a dataset: meta/info.json and the Parquet shards, with pyarrow and nothing of the generator's."""

import json
from collections import defaultdict
from dataclasses import MISSING, dataclass, fields
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.dataset as pads

from .compound import Compound, body_of, compound_of
from .container import Container
from .contract import OUTCOMES, Attempt, Environment, Gripper, Procedure, Scene, SceneObject
from .hull import Hull
from .pose import Pose

FORMAT_VERSIONS = (1, 2, 3, 4, 5, 6)
POSE = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
OBJECT_COLUMNS = ["scene_id", "object_id", "shape", "size_x_m", "size_y_m", "size_z_m", "mass_kg", "friction", *POSE]
ATTEMPT_COLUMNS = ["scene_id", "attempt_id", "object_id", "shape", "rule", *POSE, "outcome", "hit", "width_m"]
CONTAINER_SIZES = [f"container_{name}" for name in ("x_m", "y_m", "height_m", "thickness_m", "slope_rad")]


class NoDataset(Exception):
    """There is no dataset here, or this program does not support it."""


class DamagedDataset(Exception):
    """The dataset's files contradict each other or cannot be read."""


@dataclass(frozen=True)
class Dataset:
    """The scenes to repeat, and how attempts were executed."""

    name: str
    seed: int
    grippers: list[Gripper]
    procedure: Procedure
    environment: Environment
    step_rate_hz: float
    scenes: list[Scene]
    scene_count: int

    def gripper_of(self, scene: Scene) -> Gripper:
        """Several grippers take turns."""
        return self.grippers[scene.scene_id % len(self.grippers)]


def read(folder: Path, scene_count: int | None) -> Dataset:
    """The dataset's first `scene_count` scenes (all if None)."""
    info = _read_info(folder)
    try:
        physics = info["config"]["physics"]
        environment = Environment(info["grid"]["table_z_m"], physics["table_friction"], physics["gravity_m_s2"])
        grippers = [build(Gripper, one) for one in info.get("grippers", [info["gripper"]])]
        procedure = build(Procedure, info["procedure"])
        models = {m["name"]: compound_of(m["name"], [p["corners_m"] for p in m["parts"]]) for m in info.get("models", [])}
        total, seed, rate = int(info["scene_count"]), int(info["seed"]), float(physics["step_rate_hz"])
        # Only containers need it.
        size_m = float(info["grid"]["size_m"]) if "container" in info["config"] else None
    except (KeyError, TypeError, ValueError) as error:
        raise DamagedDataset(f"meta/info.json: {error!r}") from error
    count = total if scene_count is None else min(scene_count, total)
    fixtures = {} if size_m is None else _read_fixtures(folder, count, size_m, environment.table_z_m)
    scenes = _read_scenes(folder, count, models, fixtures)
    return Dataset(folder.resolve().name, seed, alike(grippers, "the cross-check of scenes"), procedure, environment, rate, scenes, total)


def alike(grippers: list[Gripper], who: str) -> list[Gripper]:
    """Grippers whose fingers slide alike; raises NoDataset if `who` does not know one."""
    if named := [gripper.name for gripper in grippers if gripper.jaws]:
        raise NoDataset(f"{who} takes fingers that slide alike, and {named[0]} has jaws of its own: mujoco takes them, for objects that float")
    return grippers


def _read_info(folder: Path) -> dict:
    path = folder / "meta" / "info.json"
    if not path.is_file():
        raise NoDataset(f"{folder} holds no dataset: {path} is missing")
    info = read_json(path)
    version = info.get("format_version")
    if version not in FORMAT_VERSIONS:
        raise DamagedDataset(f"{path}: format version {version}, this program reads {FORMAT_VERSIONS[0]} to {FORMAT_VERSIONS[-1]}")
    return info


def read_json(path: Path) -> dict:
    """The object in a file of JSON."""
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise DamagedDataset(f"{path}: {error}") from error
    if not isinstance(value, dict):
        raise DamagedDataset(f"{path}: an object is needed")
    return value


def build(kind: type, values: dict):
    """A dataclass from the keys that it names; a missing key without a default is an error, a new one is not."""
    named = (field.name for field in fields(kind) if field.default is MISSING or field.name in values)
    return kind(**{name: values[name] for name in named})


def _read_fixtures(folder: Path, count: int, size_m: float, table_z_m: float) -> dict[int, tuple[Hull, ...]]:
    """The parts of the containers, by scene; none for the bare table."""
    fixtures = {}
    for row in read_rows(folder / "scenes", ["scene_id", "container", *CONTAINER_SIZES], "scene_id", count):
        if row["container"] is None:
            continue
        try:
            x_m, y_m, *rest = (float(row[name]) for name in CONTAINER_SIZES)
            fixtures[row["scene_id"]] = Container(row["container"], (x_m, y_m), *rest).parts(size_m, table_z_m)
        except (ValueError, TypeError) as error:
            raise DamagedDataset(f"scene {row['scene_id']}: container: {error}") from error
    return fixtures


def _read_scenes(folder: Path, count: int, models: dict[str, Compound], fixtures: dict[int, tuple[Hull, ...]]) -> list[Scene]:
    objects, attempts = defaultdict(list), defaultdict(list)
    for row in read_rows(folder / "objects", OBJECT_COLUMNS, "scene_id", count):
        objects[row["scene_id"]].append(row)
    for row in read_rows(folder / "attempts", ATTEMPT_COLUMNS, "scene_id", count):
        attempts[row["scene_id"]].append(row)
    missing = [scene for scene in range(count) if scene not in objects or scene not in attempts]
    if missing:
        raise DamagedDataset(f"{len(missing)} of {count} scenes have no objects or no attempts, first {missing[0]}")
    return [_scene(scene, objects[scene], attempts[scene], models, fixtures.get(scene, ())) for scene in range(count)]


def read_rows(path: Path, columns: list[str], key: str, below: int | None) -> list[dict]:
    """The rows of a table; unless it is None, those of which a number is `below` this one."""
    try:
        source = pads.dataset(path, format="parquet")
        if missing := [name for name in columns if name not in source.schema.names]:
            raise DamagedDataset(f"{path} has no column {', '.join(missing)}")
        return source.to_table(columns=columns, filter=None if below is None else pads.field(key) < below).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise DamagedDataset(f"{path}: {error}") from error


def _scene(scene_id: int, objects: list[dict], attempts: list[dict], models: dict[str, Compound], fixtures: tuple[Hull, ...]) -> Scene:
    try:
        objects = sorted(objects, key=lambda row: row["object_id"])
        if [row["object_id"] for row in objects] != list(range(len(objects))):
            raise ValueError("object ids are not 0, 1, …")
        made = [object_of(row, models) for row in objects]
        tried = [_attempt(row, len(made)) for row in sorted(attempts, key=lambda row: row["attempt_id"])]
    except (ValueError, TypeError) as error:
        raise DamagedDataset(f"scene {scene_id}: {error}") from error
    return Scene(scene_id, made, tried, fixtures)


def pose_of(row: dict) -> Pose:
    """A row's pose, its columns named as in `POSE`; raises ValueError if that is none."""
    position = np.array([row[key] for key in POSE[:3]], dtype=float)
    quat = np.array([row[key] for key in POSE[3:]], dtype=float)
    length = np.linalg.norm(quat)
    if not np.isfinite(position).all() or not abs(length - 1) < 1e-3:
        raise ValueError(f"no pose: {position} {quat}")
    return Pose(position, quat / length)


def object_of(row: dict, models: dict[str, Compound]) -> SceneObject:
    """A row's object; raises ValueError if that is none."""
    solid = body_of(row["shape"], (row["size_x_m"], row["size_y_m"], row["size_z_m"]), models)
    if not (row["mass_kg"] > 0 and row["friction"] >= 0):
        raise ValueError(f"mass {row['mass_kg']} kg, friction {row['friction']}")
    return SceneObject(solid, row["mass_kg"], row["friction"], pose_of(row))


def _attempt(row: dict, object_count: int) -> Attempt:
    if row["outcome"] not in OUTCOMES:
        raise ValueError(f"unknown outcome {row['outcome']!r}")
    if not 0 <= row["object_id"] < object_count:
        raise ValueError(f"attempt {row['attempt_id']} aims at object {row['object_id']} of {object_count}")
    width = float("nan") if row["width_m"] is None else row["width_m"]
    return Attempt(row["attempt_id"], row["object_id"], row["shape"], row["rule"], pose_of(row), row["outcome"], row["hit"], width)
