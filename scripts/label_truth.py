#!/usr/bin/env python3
"""How true labels are: ours, MuJoCo's and PyBullet's beside a robot's grasps and FleX's. Writes docs/results/label-truth.md.

    python scripts/label_truth.py [TRUTH] [--grasps N] [--out DIR] [--report F.md]

TRUTH has `robot` (attempts.csv, meshes) and `acronym` (objects.json, NAME.npz, NAME.ply). What was made is kept in --out: the
same command continues. Needs the Python package and scripts/requirements.txt.
"""

import argparse
import csv
import hashlib
import json
import subprocess
import sys
import tomllib
from collections import defaultdict, namedtuple
from dataclasses import replace
from functools import partial
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from crosscheck import engines, objects, passes
from crosscheck.agreement import Agreement, agreement
from crosscheck.cli import command, guarded, positive, write
from crosscheck.compound import quat_of
from crosscheck.contract import BLOCKED
from crosscheck.dataset import POSE, NoDataset, pose_of
from crosscheck.floating import FloatingRunner
from crosscheck.markdown import interval, kappa, table
from crosscheck.pose import Pose, conjugate, rotation_of
from crosscheck.scores import auc, auc_within, brier, gain, without_own_group
from judge_onnx import Judge
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[1]
SEED = 1
NAMES = {"ours": "ours", "p_held": "`p_held`", "pybullet": "PyBullet", "mujoco": "MuJoCo"}
# The Panda's gripper made both collections. `p_held` is the share of the repeats; a shake takes ten times as long as a
# lift.
TESTS = {
    "robot": "--test lift --friction 0.8 --scale 1 --repeats 20",
    "acronym": "--test shake --friction 1 --density 150 --scale 1 --repeats 4",
    "things": "--test lift --repeats 20",
}
# How far the tips are in front of the frame of a planner's grasps, and of ACRONYM's, whose gripper closes along x; ours
# closes along y.
ROBOT_TIPS_M, ACRONYM_TIPS_M = {"panda-dexnet": 0.0089, "panda-gpd": 0.0089}, 0.1122
ACRONYM_FROM_GRASP = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
THINGS, PAGE = (ROOT / "scripts/crosscheck" / name for name in ("things.toml", "label-truth.md"))
# Where one image is taken from, beside the middle of the board, and its noise.
EYE_M, NOISE_M = [-0.45, 0.0, 0.55], 0.0015
# An object's grasps: poses in its frame, whether they held (n,), the group of each, and the file's row of each.
Given = namedtuple("Given", "name groups mesh poses held rows", defaults=(None, (), None, ()))


def main(arguments: list[str] | None = None) -> int:
    """Makes the page; gives the exit code."""
    parser = argparse.ArgumentParser(prog="label_truth.py", description=__doc__.split("\n")[0])
    parser.add_argument("truth", type=Path, nargs="?", default=Path("../shared/truth"), help="[default: ../shared/truth]")
    whose = "of each of ACRONYM's objects and of things in other engines [default: 24]"
    parser.add_argument("--grasps", type=positive, default=24, metavar="N", help=whose)
    parser.add_argument("--out", type=Path, default=Path("runs/truth"), metavar="DIR", help="[default: runs/truth]")
    parser.add_argument("--report", type=Path, default=ROOT / "docs/results/label-truth.md", metavar="F.md")
    args = parser.parse_args(arguments)

    def work() -> None:
        for name in ("robot/attempts.csv", "acronym/objects.json"):
            if not (args.truth / name).is_file():
                raise NoDataset(f"{args.truth} holds no labels of others: {name} is missing")
        names = [one["name"] for one in tomllib.loads(THINGS.read_text())["object"]]
        things = [Given(name, [name.split("_")[0]] * args.grasps) for name in names]
        given = {"robot": of_robot(args.truth / "robot"), "acronym": of_acronym(args.truth / "acronym"), "things": things}
        found = {name: labels(args.out, name, some, args.grasps) for name, some in given.items()}
        found["robot"] |= asked(args.out, given["robot"])
        write({args.report: page(found, command("label_truth", arguments))})

    return guarded("label_truth", work)


def of_robot(folder: Path) -> list[Given]:
    """The robot's attempts, by object; groups are planners."""
    with open(folder / "attempts.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    given = []
    for name in sorted({row["object"] for row in rows}):
        own, poses = [row for row in rows if row["object"] == name], []
        for row in own:
            hand, stands = board_pose(row, "hand"), board_pose(row, "object")
            tips, turn = hand.moved(hand.rotation[:, 2] * ROBOT_TIPS_M.get(row["planner"], 0)), conjugate(stands.quat_xyzw)
            poses.append(Pose(-rotation_of(turn) @ stands.position_m, turn).of(tips))
        held = np.array([float(row["held"]) for row in own])
        given.append(Given(name, [row["planner"] for row in own], folder / f"meshes/{name}.ply", poses, held, own))
    return given


def board_pose(row: dict, of: str) -> Pose:
    """Where the hand or the object is on the robot's board."""
    return pose_of({axis: row[f"board_from_{of}_{axis}"] for axis in POSE})


def of_acronym(folder: Path) -> list[Given]:
    """ACRONYM's grasps, by object; groups are kinds of objects. The order is drawn, so that the first ones are a sample."""
    given = []
    for about in json.loads((folder / "objects.json").read_text()):
        data = np.load(folder / f"{about['name']}.npz")
        order = np.random.default_rng(SEED).permutation(len(data["held"]))
        hands, held = data["hand"][order].astype(float), (data["held"][order] > 0).astype(float)
        poses = [Pose(m[:3, 3] + ACRONYM_TIPS_M * m[:3, 2], quat_of(m[:3, :3] @ ACRONYM_FROM_GRASP)) for m in hands]
        # The name as that of a set of grasps.
        name = about["name"]
        given.append(Given(name, [about["kind"]] * len(held), folder / f"{about['name']}.ply", poses, held))
    return given


def graspmill(*words: object) -> None:
    """Runs a command of the Python package's program, and ends with what it said if it fails."""
    done = subprocess.run([sys.executable, "-m", "graspmill", *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"graspmill {' '.join(map(str, words))}: {done.returncode}: {done.stderr[-2000:]}")


def labels(out: Path, name: str, given: list[Given], grasps: int) -> dict[str, np.ndarray]:
    """What is known of a set's grasps, (n,) each; 1 is held, NaN unknown. The truth of things is MuJoCo's."""
    folder, asked_of = out / (f"things-{grasps}" if name == "things" else name), out / "asked.parquet"
    folder.mkdir(parents=True, exist_ok=True)
    options = f"--gripper franka_hand --drops 0 {TESTS[name]}".split()
    annotate = partial(graspmill, "objects", "annotate", *options, "--out", folder)
    if name == "things":
        annotate(THINGS, "--grasps", grasps)
    for one in tqdm([one for one in given if one.mesh], desc=f"{name}, ours"):
        numbers = np.array([[*pose.position_m, *pose.quat_xyzw] for pose in one.poses], dtype=np.float32)
        pq.write_table(pa.table({**dict(zip(POSE, numbers.T)), "held": one.held.astype(np.uint64)}), asked_of, compression="zstd")
        annotate(one.mesh, "--relabel", asked_of, *(["--mass", one.rows[0]["mass_kg"]] if one.rows else []))
    # Other engines take a second or so for a grasp: of ACRONYM's objects they see every third.
    theirs, columns = executed(folder, None if name == "robot" else grasps, 3 if name == "acronym" else 1), defaultdict(list)
    for one in given:
        rows = pq.read_table(folder / f"{one.name}.parquet")
        unknown = np.full(rows.num_rows, np.nan)
        tried = {engine: theirs.get((engine, one.name), []) for engine in engines.ENGINES}
        tried = {engine: np.append(held, unknown[len(held) :]) for engine, held in tried.items()}
        own = {"object": [one.name] * len(unknown), "group": one.groups[: len(unknown)], "outcome": rows["outcome"].to_pylist()}
        own |= {**tried, "truth": tried["mujoco"] if one.held is None else one.held, "ours": rows["held"].to_numpy().astype(float)}
        own["p_held"] = rows["p_held"].to_numpy().astype(float) if "p_held" in rows.column_names else unknown
        for key, values in own.items():
            columns[key].append(values)
    return {key: np.concatenate(parts) for key, parts in columns.items()}


def executed(folder: Path, grasps: int | None, every: int) -> dict[tuple[str, str], list[bool]]:
    """Whether the first grasps of objects hold, by engine and object. Kept beside the set, with the digest of the table."""
    (data, test), found = objects.read(folder, None, grasps), {}
    for name in engines.ENGINES:
        engine = engines.make_floating(name, is_fast=False)
        for scene in data.scenes[::every]:
            thing = scene.objects[0].solid.kind
            digest = hashlib.sha256((folder / f"{thing}.parquet").read_bytes()).hexdigest()
            kept = folder / f"{thing}.{name}-{grasps or 'all'}"
            lines = kept.read_text().split() if kept.is_file() else []
            if lines[:1] != [digest] or len(lines) != len(scene.attempts) + 1:
                one = passes.same_gate(f"{thing}, {name}", replace(data, scenes=[scene]), engine, partial(FloatingRunner, test))
                lines = [digest, *(execution.outcome for execution in one.executions)]
                write({kept: "\n".join(lines)})
            found[name, thing] = [line == "held" for line in lines[1:]]
        engine.close()
    return found


def asked(out: Path, given: list[Given]) -> dict[str, np.ndarray]:
    """The judge's P(held) of the robot's grasps (n,), also if nothing is touched; the axis' distance to the centre of mass, < 0."""
    import graspmill as package

    model = ROOT / "models/judge-any-jaw.safetensors"
    graspmill("weights", "export", model, "--format", "onnx", "--out", out / "judge.onnx", "--force")
    judge = Judge(str(out / "judge.onnx"), tomllib.loads((ROOT / "configs/grippers/franka_hand.toml").read_text()))
    size_m, table_z_m, columns = judge.grid["size_m"], judge.grid["table_z_m"], defaultdict(list)
    middle_m = np.array([size_m / 2, size_m / 2, table_z_m])
    camera = package.Camera.look_at([size_m / 2, size_m / 2, 0] + np.array(EYE_M), middle_m)
    for one in tqdm(given, desc="robot, the judge"):
        mesh, said, layouts = read_ply(one.mesh), np.empty((len(one.rows), 6)), np.array([row["layout"] for row in one.rows])
        for layout in np.unique(layouts):
            chosen = np.flatnonzero(layouts == layout)
            stands = board_pose(one.rows[chosen[0]], "object")
            stands = stands.moved(middle_m - stands.apply((mesh[0].min(axis=0) + mesh[0].max(axis=0)) / 2) * [1, 1, 0])
            thing = package.Object.mesh(mesh, [*stands.position_m, *stands.quat_xyzw])
            depth = package.Scene([thing], table_z_m=table_z_m).render(camera)
            depth = np.where(depth > 0, depth + np.random.default_rng(SEED).normal(0, NOISE_M, depth.shape), 0).astype(np.float32)
            seen = package.tsdf([depth], [camera], resolution=judge.grid["resolution"], size_m=size_m)
            grasps = [(grasp.position_m, grasp.quat_xyzw) for grasp in (stands.of(one.poses[number]) for number in chosen)]
            said[chosen] = np.mean([judge.outcomes(seen, grasps, 1, sides) for sides in product((False, True), repeat=2)], axis=0)
        centre_m = np.array(json.loads((out / f"robot/{one.name}.json").read_text())["object"]["centre_of_mass_m"])
        columns["judge"].append(said[:, 5])
        columns["untouched"].append(said[:, 5] / np.maximum(1 - said[:, 0] - said[:, 1], 1e-3))
        columns["axis"].append([-np.linalg.norm(((centre_m - pose.position_m) @ pose.rotation)[:2]) for pose in one.poses])
    return {key: np.concatenate(parts) for key, parts in columns.items()}


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 3) in metres and triangles (m, 3) of a binary PLY that has nothing else."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    count, triangle = dict(line.split()[1:] for line in head.splitlines() if line.startswith(b"element")), "u1, (3,)<i4"
    corners = np.frombuffer(body, "<f4", 3 * int(count[b"vertex"])).reshape(-1, 3)
    return corners.astype(float), np.frombuffer(body, triangle, int(count[b"face"]), corners.nbytes)["f1"]


def page(found: dict[str, dict[str, np.ndarray]], said: str) -> str:
    """The page of results."""
    rows, robot, rates, wholes = defaultdict(list), found["robot"], {}, {}
    for name, one in found.items():
        everything, sampled = np.isfinite(one["truth"]), np.isfinite(one["mujoco"])
        known, wholes[name] = everything & np.isfinite(one["p_held"]), agreed(one, "truth", "ours", everything)
        numbers = [score(one["truth"][known], one["p_held"][known]) for score in (auc, brier)]
        pairs = [agreed(one, *pair, sampled).kappa for pair in combinations(("truth", "ours", *engines.ENGINES), 2)]
        cells = [name, f"{wholes[name].count:,}", kappa(wholes[name].share), interval(wholes[name]), *map(kappa, numbers)]
        rows["labels"].append([*cells, f"{sampled.sum():,}", *map(kappa, pairs)])
        groups = [one["group"] == group for group in np.unique(one["group"])]
        rates[name] = np.array([[mean(one[key][own]) for key in ("truth", *NAMES)] for own in groups])
        for own, shares in zip(groups, rates[name]):
            rows["groups"].append([one["group"][own][0], *map(kappa, [*shares, agreed(one, "truth", "ours", own).kappa])])
    pairs = [", ".join(pair) for pair in combinations(("truth", "ours", "PyBullet", "MuJoCo"), 2)]
    tables = {
        "labels": table(["set", "grasps", "agree", "κ [95 %]", "AUC", "Brier", "sample", *pairs], rows["labels"]),
        "groups": table(["held", "truth", *NAMES.values(), "κ"], rows["groups"]),
        "judge": table(["score", "AUC", "within planners", "there the combination is better by [95 %]"], of_judge(robot)),
    }
    pushed, along = robot["truth"][np.isin(robot["outcome"], BLOCKED)], np.corrcoef(rates["robot"].T)[0]
    pearson = ", ".join(f"{name} {kappa(one)}" for name, one in zip(NAMES.values(), along[1:]))
    numbers = {"share": 100 * wholes["robot"].share, "count": wholes["robot"].count, "kappas": rows["labels"][0][-6:-3]}
    return PAGE.read_text().format(**numbers, **tables, pushed=100 * mean(pushed), pearson=pearson, command=said)


def mean(values: np.ndarray) -> float:
    """The mean of what is known."""
    return float(np.mean(known)) if len(known := values[np.isfinite(values)]) else float("nan")


def agreed(one: dict, first: str, second: str, some: np.ndarray) -> Agreement:
    """How far two agree on those of some grasps that both know."""
    some = some & np.isfinite(one[first]) & np.isfinite(one[second])
    return agreement(one[first][some], one[second][some], one["object"][some], SEED)


def of_judge(robot: dict) -> list[list[str]]:
    """The rows of what ranks the robot's grasps, and last a combination of what is known, where all of it is."""
    names = {"ours": "our label", "p_held": "`p_held`", "judge": "the judge", "untouched": "the judge, if nothing is touched"}
    names = {key: name for key, name in {**names, "axis": "axis near the centre of mass"}.items() if np.isfinite(robot[key]).any()}
    # Probabilities as log-odds.
    odds = {key: np.clip(robot[key], 0.01, 0.99) for key in ("p_held", "untouched") if key in names}
    parts = np.column_stack([*(np.log(p / (1 - p)) for p in odds.values()), robot["axis"]])
    known = np.isfinite(parts).all(axis=1)
    truth, planners, things = (robot[key][known] for key in ("truth", "group", "object"))
    together, rows = without_own_group(parts[known], truth, planners), []
    for key, name in names.items():
        better = "{:.3f} [{:.3f}, {:.3f}]".format(*gain(truth, together, robot[key][known], planners, things, SEED))
        own = [one[np.isfinite(robot[key])] for one in (robot["truth"], robot[key], robot["group"])]
        rows.append([name, kappa(auc(*own[:2])), kappa(auc_within(*own)), better])
    return [*rows, ["combination", "–", kappa(auc_within(truth, together, planners)), ""]]


if __name__ == "__main__":
    sys.exit(main())
