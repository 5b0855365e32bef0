"""The report as Markdown and as JSON."""

from dataclasses import dataclass, field

import numpy as np

from .agreement import Agreement, finite
from .compare import Comparison, Rows
from .contract import OUTCOMES
from .dataset import Dataset
from .markdown import AGREEMENT_HEAD, agreement_cells, drifted, interval, millimetres, percent, table
from .passes import Drift, Pass


@dataclass
class EngineReport:
    """The results of one engine."""

    about: dict
    same_gate: Pass
    own_approach: Pass
    same: Comparison
    own: Comparison
    drift: Drift


@dataclass
class Report:
    """All results."""

    command: str
    dataset: Dataset
    rows: Rows
    gate_differences: list[int]
    engines: dict[str, EngineReport]
    third: list[tuple[str, Agreement, Agreement]] = field(default_factory=list)
    patterns: dict[str, int] = field(default_factory=dict)


def markdown(report: Report) -> str:
    """The report for people."""
    parts = [summary(report)]
    for name, found in report.engines.items():
        parts.append(_engine(name, found))
    if report.third:
        parts.append(_third(report))
    parts.append(_disagreements(report))
    return "".join(parts)


def summary(report: Report) -> str:
    """What was compared, how far it agrees, and how fast it was."""
    dataset, ours, rows = report.dataset, report.rows, []
    for name, found in report.engines.items():
        for mode, c in (("same gate", found.same), ("own approach", found.own)):
            rows.append([f"{name}, {mode}", *agreement_cells(c.overall), percent(c.outcome_share), f"{c.attempts_per_s:,.0f}"])
            rows.append([f"{name}, {mode}, closing phase", *agreement_cells(c.closing), "", ""])
    note = (
        "*Same gate*: pre-grasp and approach are judged by the geometric gate, physics begins with closing. *Own approach*: the "
        "engine simulates the approach and judges it by its own distances, with the gripper's clearance. *Closing phase*: attempts "
        "that reach it in both. Attempts a second are on one core.\n\n"
    )
    return (
        f"# Cross-check of {dataset.name}\n\n    {report.command}\n\n"
        f"{len(ours.attempts):,} attempts in {len(dataset.scenes):,} of {dataset.scene_count:,} scenes, seed {dataset.seed}; "
        f"{int(ours.labels.sum()):,} held. The label is 1 for `held`; κ is Cohen's, its interval from a bootstrap over scenes.\n\n"
        f"**The gate, written again**: {len(report.gate_differences):,} of {len(ours.attempts):,} attempts are stopped, "
        "passed or attributed otherwise than stored.\n\n## Agreement\n\n"
        + note + table(["", *AGREEMENT_HEAD, "same outcome", "attempts/s"], rows)
    )  # fmt: skip


def _engine(name: str, found: EngineReport) -> str:
    about, drift = found.about, found.drift
    settings = ", ".join(f"{key} {value:g}" for key, value in about["settings"].items())
    parts = [f"## {name} {about['version']}\n\n{settings}.\n\n"]
    if len(drift.moved_m):
        parts.append(drifted(name, drift.moved_m, drift.turned_rad))
    parts.append(_widths(found))
    for mode, c in (("same gate", found.same), ("own approach", found.own)):
        parts.append(_mode(mode, c))
    return "".join(parts)


def _widths(found: EngineReport) -> str:
    head = ["opening where both held, theirs − ours [mm]", "attempts", "mean", "median abs", "90 % abs", "99 % abs"]
    lines = []
    for mode, c in (("same gate", found.same), ("own approach", found.own)):
        w = c.width
        values = (w.mean_m, w.median_abs_m, w.p90_abs_m, w.p99_abs_m)
        lines.append([mode, f"{w.count:,}", *(millimetres(v) for v in values)])
    return table(head, lines)


def _mode(mode: str, c: Comparison) -> str:
    parts = [f"### {mode}\n\n", "Ours down, theirs across:\n\n"]
    parts.append(table(["", *OUTCOMES], [[name, *line] for name, line in zip(OUTCOMES, c.confusion.tolist())]))
    for title, groups in (
        ("by shape", c.by_shape), ("by rule", c.by_rule), ("by approach angle from the vertical", c.by_angle),
        ("closing phase by shape", c.closing_by_shape),
    ):  # fmt: skip
        parts.append(table([title, *AGREEMENT_HEAD], [[key, *agreement_cells(a)] for key, a in groups.items()]))
    return "".join(parts)


def _third(report: Report) -> str:
    lines = [[pair, percent(a.share), interval(a), percent(c.share), interval(c)] for pair, a, c in report.third]
    head = ["same gate", "agreement", "κ [95 %]", "closing agreement", "closing κ [95 %]"]
    counts = [[pattern, f"{count:,}"] for pattern, count in report.patterns.items()]
    return "## Two against one\n\n" + table(head, lines) + table(["labels, same gate", "attempts"], counts)


def _disagreements(report: Report) -> str:
    names = list(report.engines)
    differing = [i for i, label in enumerate(report.rows.labels) if any(report.engines[name].same_gate.labels[i] != label for name in names)]
    head = ["scene/attempt", "rule", "from vertical", "ours", *names, "opening ours [mm]"]
    lines = []
    for i in differing:
        attempt = report.rows.attempts[i]
        key = f"{report.rows.scenes[i]}/{attempt.attempt_id}"
        theirs = [report.engines[name].same_gate.executions[i].outcome for name in names]
        angle = f"{np.degrees(attempt.approach_angle_rad):.0f}°"
        lines.append([key, attempt.rule, angle, attempt.outcome, *theirs, millimetres(attempt.width_m)])
    return f"## Attempts whose labels differ, same gate ({len(differing):,})\n\n" + table(head, lines)


def as_json(report: Report) -> dict:
    """The report for programs."""
    return {
        "command": report.command,
        "dataset": report.dataset.name,
        "seed": report.dataset.seed,
        "scenes": len(report.dataset.scenes),
        "attempts": len(report.rows.attempts),
        "held": int(report.rows.labels.sum()),
        "gate_differences": len(report.gate_differences),
        "engines": {name: _engine_json(found) for name, found in report.engines.items()},
        "pairs": {pair: {"overall": a.as_json(), "closing": c.as_json()} for pair, a, c in report.third},
        "patterns": report.patterns,
        "disagreements": _disagreement_json(report),
    }


def _engine_json(found: EngineReport) -> dict:
    drift = np.percentile(found.drift.moved_m, [50, 99, 100]).tolist() if len(found.drift.moved_m) else None
    return {**found.about, "drift_m_p50_p99_max": drift, "same_gate": _comparison_json(found.same), "own_approach": _comparison_json(found.own)}


def _comparison_json(c: Comparison) -> dict:
    groups = {"by_shape": c.by_shape, "by_rule": c.by_rule, "by_angle": c.by_angle, "closing_by_shape": c.closing_by_shape}
    return {
        "overall": c.overall.as_json(),
        "closing": c.closing.as_json(),
        "outcome_share": c.outcome_share,
        "confusion": {"outcomes": list(OUTCOMES), "ours_by_theirs": c.confusion.tolist()},
        **{key: {name: a.as_json() for name, a in group.items()} for key, group in groups.items()},
        "width_error": finite(vars(c.width)),
        "attempts_per_s": c.attempts_per_s,
    }


def _disagreement_json(report: Report) -> list[dict]:
    found = []
    for i, label in enumerate(report.rows.labels):
        modes = {
            f"{name} {mode}": one.executions[i]
            for name, engine in report.engines.items()
            for mode, one in (("same_gate", engine.same_gate), ("own_approach", engine.own_approach))
        }
        if all((e.outcome == "held") == label for e in modes.values()):
            continue
        attempt = report.rows.attempts[i]
        where = {"scene_id": int(report.rows.scenes[i]), "attempt_id": attempt.attempt_id, "rule": attempt.rule}
        found.append({**where, "ours": attempt.outcome, **{mode: e.outcome for mode, e in modes.items()}})
    return found
