"""The command line for sets of grasps of floating objects."""

import argparse
import json
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from . import dataset, engines, objects, passes
from .agreement import Agreement, agreement
from .cli import guarded, positive, write
from .compare import Rows, compare_gate, reaches_closing, rows_of
from .contract import Scene
from .floating import FloatingRunner
from .markdown import AGREEMENT_HEAD, agreement_cells, kappa, percent, table
from .passes import Pass

GATES = ("same", "own")

EPILOG = """\
examples:
  graspmill objects annotate objects.toml --test turn --grasps 300 --touch 0 --repeats 0 --out grasps
  python scripts/crosscheck_objects.py grasps --engine all
  python scripts/crosscheck_objects.py grasps --engine mujoco --gate both --objects 5 --report runs/grasps.md

exit codes:
   0  done (whatever the agreement)
   2  wrong command line
  65  the set is damaged, or its objects were not tested alike
  78  no set there, or an engine's package is not installed
"""


@dataclass
class Report:
    """All results: a pass by its name, which says engine and gate."""

    data: dataset.Dataset
    test: str
    rows: Rows
    gate_differences: int
    passes: dict[str, Pass] = field(default_factory=dict)


@dataclass(frozen=True)
class Line:
    """Agreement on some grasps: on all, and on those on which the gripper closed in both."""

    name: str
    overall: Agreement
    closing: Agreement
    disagreements: list[tuple[tuple[str, str], int]]


def main(arguments: list[str] | None = None) -> int:
    """Runs the cross-check; gives the exit code."""
    args = _parser().parse_args(arguments)

    def work() -> None:
        names = list(engines.ENGINES) if args.engine == "all" else [args.engine]
        gates = list(GATES) if args.gate == "both" else [args.gate]
        report = run(objects.read(args.set, args.objects, args.grasps), names, gates, args.fast)
        text = markdown(report, args.seed)
        print(text)
        write({args.report: text, args.json: json.dumps(as_json(report, args.seed), indent=1) + "\n"})

    return guarded("crosscheck_objects", work)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="crosscheck_objects.py",
        description="Repeat labelled grasps of floating objects in another physics engine and compare the labels.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("set", type=Path, help="folder that `graspmill objects annotate` wrote")
    parser.add_argument("--objects", type=positive, metavar="N", help="only the first N objects [default: all]")
    parser.add_argument("--grasps", type=positive, metavar="N", help="only the first N grasps of each [default: all]")
    parser.add_argument("--engine", choices=[*engines.ENGINES, "all"], default="pybullet", help="[default: pybullet]")
    parser.add_argument(
        "--gate", choices=[*GATES, "both"], default="same",
        help="who judges the approach: the geometric gate, or the engine by its own distances [default: same]",
    )  # fmt: skip
    parser.add_argument(
        "--fast", action="store_true",
        help="steps, and contacts of hard fingers, as for scenes: several times faster, but these cut thin parts",
    )  # fmt: skip
    parser.add_argument("--report", type=Path, metavar="F.md", help="also write the tables here")
    parser.add_argument("--json", type=Path, metavar="F.json", help="write them, and each disagreement, as JSON")
    parser.add_argument("--seed", type=int, default=1, help="of the bootstrap [default: 1]")
    return parser


def run(labelled: tuple[dataset.Dataset, str], names: list[str], gates: list[str], is_fast: bool) -> Report:
    """All passes of all engines over a set and its test."""
    data, test = labelled
    rows = rows_of(data)
    report = Report(data, test, rows, len(compare_gate(rows, passes.gate_pass(data))))
    runners = partial(FloatingRunner, test)
    for name in names:
        engine = engines.make_floating(name, is_fast)
        for gate in gates:
            title = f"{name}, {gate} gate"
            execute = passes.same_gate if gate == "same" else passes.own_approach
            report.passes[title] = execute(title, data, engine, runners=runners)
        engine.close()
    return report


def lines(report: Report, theirs: Pass, seed: int) -> list[Line]:
    """Each object, then the convex ones, those of several parts, and all."""
    scenes = report.data.scenes
    convex = [scene for scene in scenes if _part_count(scene) == 1]
    several = [scene for scene in scenes if _part_count(scene) > 1]
    groups = [(_name(scene), [scene]) for scene in scenes]
    groups += [("**convex objects**", convex), ("**objects of several parts**", several), ("**all**", scenes)]
    return [_line(report, theirs, seed, name, some) for name, some in groups if some]


def _line(report: Report, theirs: Pass, seed: int, name: str, scenes: list[Scene]) -> Line:
    rows, outcomes = report.rows, [execution.outcome for execution in theirs.executions]
    chosen = np.isin(rows.scenes, [scene.scene_id for scene in scenes])
    closing = chosen & reaches_closing(rows.outcomes) & reaches_closing(outcomes)
    # Grasps of one object are not independent; within one there is nothing else to draw.
    drawn = rows.scenes if len(scenes) > 1 else np.arange(len(outcomes))

    def on(some: np.ndarray) -> Agreement:
        return agreement(rows.labels[some], theirs.labels[some], drawn[some], seed)

    differing = np.flatnonzero(chosen & (rows.labels != theirs.labels)).tolist()
    counts = Counter((rows.outcomes[i], outcomes[i]) for i in differing)
    return Line(name, on(chosen), on(closing), counts.most_common(2))


def _name(scene: Scene) -> str:
    return scene.objects[0].solid.kind


def _part_count(scene: Scene) -> int:
    return len(scene.objects[0].solid.convexes)


def markdown(report: Report, seed: int) -> str:
    """The tables for people."""
    data, rows = report.data, report.rows
    parts = [
        f"# Cross-check of {data.name}\n\n",
        f"{len(rows.attempts):,} grasps of {len(data.scenes):,} of {data.scene_count:,} objects, test `{report.test}`; "
        f"{int(rows.labels.sum()):,} held. The label is 1 for `held`; κ is Cohen's, its interval from a bootstrap over "
        "grasps for one object, over objects for several. *Closed*: grasps on which the gripper closes in both.\n\n",
        f"**The gate, written again**: {report.gate_differences:,} grasps are stopped or passed otherwise than "
        "stored.\n\n",
    ]
    for title, theirs in report.passes.items():
        cells = []
        for line in lines(report, theirs, seed):
            said = ", ".join(f"{ours} – {other} {count:,}" for (ours, other), count in line.disagreements)
            closing = [percent(line.closing.share), kappa(line.closing.kappa)]
            cells.append([line.name, *agreement_cells(line.overall), *closing, said])
        head = ["object", "grasps", *AGREEMENT_HEAD[1:], "closed", "κ", "commonest: ours – theirs"]
        parts.append(f"## {title}\n\n" + table(head, cells))
    if len(report.passes) > 1:
        parts.append("## Engines with each other\n\n" + table(["", *AGREEMENT_HEAD], _among(report, seed)))
    return "".join(parts)


def _among(report: Report, seed: int) -> list[list[str]]:
    """What can be expected of an engine: how far others agree."""
    pairs = combinations(report.passes.items(), 2)
    return [
        [f"{a}; {b}", *agreement_cells(agreement(first.labels, second.labels, report.rows.scenes, seed))]
        for (a, first), (b, second) in pairs
        if a.split(", ")[1] == b.split(", ")[1]
    ]


def as_json(report: Report, seed: int) -> dict:
    """Everything for programs."""
    rows, found = report.rows, {}
    for title, theirs in report.passes.items():
        pairs = zip(rows.attempts, theirs.executions)
        found[title] = {
            "agreement": {line.name.strip("*"): {"overall": line.overall.as_json(), "closing": line.closing.as_json()} for line in lines(report, theirs, seed)},
            "disagreements": [
                {
                    "object": ours.shape,
                    "grasp_id": ours.attempt_id,
                    "ours": ours.outcome,
                    "theirs": other.outcome,
                    "their_motion_m": other.travel_m if np.isfinite(other.travel_m) else None,
                }
                for ours, other in pairs
                if (ours.outcome == "held") != (other.outcome == "held")
            ],
            "grasps_per_s": len(theirs.executions) / theirs.seconds,
        }
    about = {"set": report.data.name, "test": report.test, "gate_differences": report.gate_differences}
    return {**about, "passes": found}
