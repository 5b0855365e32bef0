"""Reads the folder of an experiment as a dataset of which each scene is one grasp: run.json, bodies.json, attempts.parquet
and objects.parquet, without our other code."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from .compound import Compound, compound_of
from .contract import OUTCOMES, Attempt, Environment, Gripper, Procedure, Scene
from .dataset import POSE, DamagedDataset, Dataset, NoDataset, alike, build, object_of, pose_of, read_json, read_rows

RUN, BODIES, ATTEMPTS, OBJECTS = "run.json", "bodies.json", "attempts.parquet", "objects.parquet"
COLUMNS = {
    ATTEMPTS: ["round", "trial", "target_id", "outcome", "hit", *POSE],
    OBJECTS: ["round", "trial", "object_id", "body", "size_x_m", "size_y_m", "size_z_m", "mass_kg", "friction", *POSE],
}


def is_one(folder: Path) -> bool:
    """Whether a folder holds anything of an experiment."""
    return any((folder / name).is_file() for name in (RUN, ATTEMPTS, OBJECTS))


def read(folder: Path, round_count: int | None) -> Dataset:
    """The grasps of the first `round_count` rounds (all if None) by rounds and trials; a scene has its round's number."""
    missing = [name for name in (RUN, ATTEMPTS, OBJECTS) if not (folder / name).is_file()]
    if missing:
        raise NoDataset(f"{folder} holds no experiment whose grasps can be executed again: {', '.join(missing)} missing")
    run = read_json(folder / RUN)
    if "container" in run:
        raise NoDataset(f"{folder / RUN}: its scenes have containers, whose walls this program does not build in other engines")
    try:
        physics = run["physics"]
        environment = Environment(float(run["table_z_m"]), float(physics["table_friction"]), float(physics["gravity_m_s2"]))
        gripper, procedure = build(Gripper, run["gripper"]), build(Procedure, run["procedure"])
        seed, rate = int(run["seeds"][0]), float(physics["step_rate_hz"])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise DamagedDataset(f"{folder / RUN}: {error!r}") from error
    compounds = _compounds(folder / BODIES)
    scenes = _scenes(folder, round_count, compounds)
    return Dataset(folder.resolve().name, seed, alike([gripper], "the cross-check of scenes"), procedure, environment, rate, scenes, len(scenes))


def _compounds(path: Path) -> dict[str, Compound]:
    """The compounds by name; none if there is no such file."""
    found = {}
    for name, body in (read_json(path) if path.exists() else {}).items():
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
    rows = read_rows(folder / table, COLUMNS[table], "round", round_count)
    if any(row["round"] is None or row["trial"] is None for row in rows):
        raise DamagedDataset(f"{folder / table}: a row without round or trial")
    return rows


def _scene(attempt: dict, rows: list[dict], compounds: dict[str, Compound]) -> Scene:
    numbers = [row["object_id"] for row in rows]
    if len(set(numbers)) < len(numbers):
        raise ValueError(f"object numbers repeat: {numbers}")
    if attempt["target_id"] not in numbers:
        raise ValueError(f"the grasp aims at object {attempt['target_id']} of {numbers}")
    if attempt["outcome"] not in OUTCOMES:
        raise ValueError(f"unknown outcome {attempt['outcome']!r}")
    objects = [object_of({**row, "shape": row["body"]}, compounds) for row in rows]
    target = numbers.index(attempt["target_id"])
    body, hit = rows[target]["body"], attempt["hit"] or None
    tried = Attempt(attempt["trial"], target, body, "planned", pose_of(attempt), attempt["outcome"], hit, float("nan"))
    return Scene(attempt["round"], objects, [tried])
