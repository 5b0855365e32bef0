"""Reads the folder of an experiment: run.json, bodies.json, attempts.parquet and objects.parquet, without our other code."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.dataset as pads
from crosscheck.compound import Compound, body_of, compound_of
from crosscheck.contract import OUTCOMES, Attempt, Environment, Gripper, Procedure, Scene, SceneObject
from crosscheck.dataset import POSE, DamagedDataset, Dataset, NoDataset, build, pose_of

RUN, BODIES, ATTEMPTS, OBJECTS = "run.json", "bodies.json", "attempts.parquet", "objects.parquet"
# What this program calls a column, and its name in the file.
COLUMNS = {
    ATTEMPTS: {"round": "round", "trial": "trial", "target": "target_id", "outcome": "outcome", **{name: name for name in POSE}},
    OBJECTS: {
        "round": "round", "trial": "trial", "object": "object_id", "body": "body",
        "size_x_m": "size_x_m", "size_y_m": "size_y_m", "size_z_m": "size_z_m",
        "mass_kg": "mass_kg", "friction": "friction", **{name: name for name in POSE},
    },
}  # fmt: skip


@dataclass(frozen=True)
class Experiment:
    """The grasps to execute again. `data` has one scene a grasp, in the order of rounds and trials, numbered by its round."""

    name: str
    protocol: str
    seeds: list[int]
    data: Dataset


def read(folder: Path, round_count: int | None) -> Experiment:
    """The experiment's first `round_count` rounds (all if None)."""
    missing = [name for name in (RUN, ATTEMPTS, OBJECTS) if not (folder / name).is_file()]
    if missing:
        raise NoDataset(f"{folder} holds no experiment whose grasps can be executed again: {', '.join(missing)} missing")
    run = _json(folder / RUN)
    if "container" in run:
        raise NoDataset(f"{folder / RUN}: its scenes have containers, whose walls this program does not build in other engines")
    try:
        physics = run["physics"]
        environment = Environment(
            float(run["table_z_m"]), float(physics["table_friction"]), float(physics["gravity_m_s2"])
        )
        gripper, procedure = build(Gripper, run["gripper"]), build(Procedure, run["procedure"])
        protocol, seed, rate = str(run["protocol"]), int(run["seeds"][0]), float(physics["step_rate_hz"])
        seeds = [int(seed) for seed in run["seeds"]]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise DamagedDataset(f"{folder / RUN}: {error!r}") from error
    compounds = _compounds(folder / BODIES)
    scenes = _scenes(folder, round_count, compounds)
    name = folder.resolve().name
    return Experiment(name, protocol, seeds, Dataset(name, seed, [gripper], procedure, environment, rate, scenes, len(scenes)))


def _json(path: Path) -> dict:
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise DamagedDataset(f"{path}: {error}") from error
    if not isinstance(value, dict):
        raise DamagedDataset(f"{path}: an object is needed")
    return value


def _compounds(path: Path) -> dict[str, Compound]:
    """The compounds by name; none if there is no such file."""
    found = {}
    for name, body in (_json(path) if path.exists() else {}).items():
        try:
            found[name] = compound_of(name, [part["vertices_m"] for part in body["parts"]])
        except (KeyError, TypeError, ValueError) as error:
            raise DamagedDataset(f"{path}: {name}: {error!r}") from error
    return found


def _scenes(folder: Path, round_count: int | None, compounds: dict[str, Compound]) -> list[Scene]:
    standing = defaultdict(list)
    for row in _rows(folder, OBJECTS, round_count):
        standing[row["round"], row["trial"]].append(row)
    rows = _rows(folder, ATTEMPTS, round_count)
    attempts = {(row["round"], row["trial"]): row for row in rows}
    if not attempts:
        raise DamagedDataset(f"{folder / ATTEMPTS} holds no grasps" + ("" if round_count is None else " of these rounds"))
    if len(attempts) < len(rows):
        raise DamagedDataset(f"{folder / ATTEMPTS}: {len(rows) - len(attempts)} rows repeat a round and trial")
    scenes = []
    for key in sorted(attempts):
        if key not in standing:
            raise DamagedDataset(f"{folder / OBJECTS}: no objects of round {key[0]}, trial {key[1]}")
        try:
            scenes.append(_scene(attempts[key], standing[key], compounds))
        except (ValueError, TypeError) as error:
            raise DamagedDataset(f"round {key[0]}, trial {key[1]}: {error}") from error
    return scenes


def _rows(folder: Path, table: str, round_count: int | None) -> list[dict]:
    """A table's rows, by our names of the columns."""
    names = COLUMNS[table]
    try:
        source = pads.dataset(folder / table, format="parquet")
        if missing := [name for name in names.values() if name not in source.schema.names]:
            raise DamagedDataset(f"{folder / table} has no column {', '.join(missing)}")
        chosen = None if round_count is None else pads.field(names["round"]) < round_count
        rows = source.to_table(columns={ours: pads.field(name) for ours, name in names.items()}, filter=chosen).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise DamagedDataset(f"{folder / table}: {error}") from error
    if any(row["round"] is None or row["trial"] is None for row in rows):
        raise DamagedDataset(f"{folder / table}: a row without round or trial")
    return rows


def _scene(attempt: dict, rows: list[dict], compounds: dict[str, Compound]) -> Scene:
    numbers = [row["object"] for row in rows]
    if len(set(numbers)) < len(numbers):
        raise ValueError(f"object numbers repeat: {numbers}")
    if attempt["target"] not in numbers:
        raise ValueError(f"the grasp aims at object {attempt['target']} of {numbers}")
    if attempt["outcome"] not in OUTCOMES:
        raise ValueError(f"unknown outcome {attempt['outcome']!r}")
    objects = [_object(row, compounds) for row in rows]
    target = numbers.index(attempt["target"])
    tried = Attempt(
        attempt["trial"], target, rows[target]["body"], "", pose_of(attempt), attempt["outcome"], None, float("nan")
    )
    return Scene(attempt["round"], objects, [tried])


def _object(row: dict, compounds: dict[str, Compound]) -> SceneObject:
    extents = (row["size_x_m"], row["size_y_m"], row["size_z_m"])
    if not (row["mass_kg"] > 0 and row["friction"] >= 0):
        raise ValueError(f"mass {row['mass_kg']} kg, friction {row['friction']}")
    body = body_of(row["body"], extents, compounds)
    return SceneObject(body, row["mass_kg"], row["friction"], pose_of(row))
