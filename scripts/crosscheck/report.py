"""The report as Markdown and as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .agreement import Agreement
from .ceiling import Ceiling
from .compare import Comparison, Rows
from .contract import OUTCOMES
from .dataset import Dataset
from .markdown import AGREEMENT_HEAD, agreement_cells, drifted, interval, kappa, millimetres, percent, table
from .ours import Clocked
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
    ceiling: list[Ceiling] = field(default_factory=list)


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
    ours: Clocked | None = None


def markdown(report: Report) -> str:
    """The report for people."""
    dataset, rows = report.dataset, report.rows
    parts = [
        f"# Cross-check of {dataset.name}\n\n    {report.command}\n\n",
        f"{len(rows.attempts):,} attempts in {len(dataset.scenes):,} of {dataset.scene_count:,} scenes, seed {dataset.seed}; "
        f"{int(rows.labels.sum()):,} held. The label is 1 for `held`; κ is Cohen's, its interval from a bootstrap over scenes.\n\n",
        f"**The gate, written again**: {len(report.gate_differences):,} of {len(rows.attempts):,} attempts are stopped, "
        "passed or attributed otherwise than stored.\n\n",
        "## Agreement\n\n",
        _summary(report),
        _speed(report),
    ]
    for name, found in report.engines.items():
        parts.append(_engine(name, found))
    if report.third:
        parts.append(_third(report))
    parts.append(_disagreements(report))
    return "".join(parts)


def _summary(report: Report) -> str:
    rows = []
    for name, found in report.engines.items():
        for mode, c in (("same gate", found.same), ("own approach", found.own)):
            rows.append([f"{name}, {mode}", *agreement_cells(c.overall), percent(c.outcome_share)])
            rows.append([f"{name}, {mode}, closing phase", *agreement_cells(c.closing), ""])
    note = (
        "*Same gate*: pre-grasp and approach are judged by the geometric gate, physics begins with closing. *Own approach*: the "
        "engine simulates the approach and judges it by its own distances, with the gripper's clearance. *Closing phase*: attempts "
        "that reach it in both.\n\n"
    )
    return note + table(["", *AGREEMENT_HEAD, "same outcome"], rows)


def _speed(report: Report) -> str:
    """Attempts a second on one core, and how many times faster ours are."""
    if not report.ours:
        return ""
    ours = report.ours.attempts_per_s
    rows = [["ours, program start and reading included", f"{ours:,.0f}", ""]]
    for name, found in report.engines.items():
        for mode, c in (("its own approach", found.own), ("the geometric gate", found.same)):
            rows.append([f"{name}, {mode}", f"{c.attempts_per_s:,.0f}", f"{ours / c.attempts_per_s:.1f}"])
    return "## Speed, one core\n\n" + table(["the same attempts", "attempts/s", "ours is faster, times"], rows)


def _engine(name: str, found: EngineReport) -> str:
    about, drift = found.about, found.drift
    settings = ", ".join(f"{key} {value:g}" for key, value in about["settings"].items())
    parts = [f"## {name} {about['version']}\n\n{settings}.\n\n"]
    parts.append(
        f"Speed, one core: {found.same.attempts_per_s:,.0f} attempts/s with the geometric gate ({found.same.simulated_per_s:,.0f} "
        f"simulated/s), {found.own.attempts_per_s:,.0f} attempts/s with its own approach.\n\n"
    )
    if len(drift.moved_m):
        parts.append(drifted(name, "settled objects", drift.moved_m, drift.turned_rad))
    parts.append(_widths(found))
    for mode, c in (("same gate", found.same), ("own approach", found.own)):
        parts.append(_mode(mode, c))
    if found.ceiling:
        parts.append(f"### {name} against itself (same gate)\n\n")
        head = ["change", "agreement", "κ [95 %]", "closing agreement", "closing κ [95 %]", "fingers sink, 99 % [mm]"]
        lines = [
            [c.change, percent(c.overall.share), interval(c.overall), percent(c.closing.share), interval(c.closing),
             millimetres(c.sunk_m_p99)]
            for c in found.ceiling
        ]  # fmt: skip
        parts.append(table(head, lines))
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
    differing = [
        i for i, label in enumerate(report.rows.labels)
        if any(report.engines[name].same_gate.labels[i] != label for name in names)
    ]  # fmt: skip
    head = ["scene/attempt", "rule", "from vertical", "ours", *names, "opening ours [mm]"]
    flips = {name: _flips(report.engines[name]) for name in names if report.engines[name].ceiling}
    head += [f"changes that flip {name}" for name in flips]
    lines = []
    for i in differing:
        attempt = report.rows.attempts[i]
        key = f"{report.rows.scenes[i]}/{attempt.attempt_id}"
        theirs = [report.engines[name].same_gate.executions[i].outcome for name in names]
        angle = f"{np.degrees(attempt.approach_angle_rad):.0f}°"
        turned = [f"{count[i]} of {len(report.engines[name].ceiling)}" for name, count in flips.items()]
        lines.append([key, attempt.rule, angle, attempt.outcome, *theirs, millimetres(attempt.width_m), *turned])
    return f"## Attempts whose labels differ, same gate ({len(differing):,})\n\n" + _flip_summary(report) + table(head, lines)


def _flips(found: EngineReport) -> np.ndarray:
    """How many changes turn each label (n,) of an engine against itself."""
    return np.sum([c.flipped for c in found.ceiling], axis=0)


def _flip_summary(report: Report) -> str:
    lines = []
    for name, found in report.engines.items():
        if not found.ceiling:
            continue
        differ, unsure = found.same_gate.labels != report.rows.labels, _flips(found) > 0
        lines.append(
            f"Of the {int(differ.sum()):,} attempts on which {name} differs from us, it differs from itself under one of the "
            f"{len(found.ceiling)} changes above on {int((differ & unsure).sum()):,}; of the other {int((~differ).sum()):,}, on "
            f"{int((~differ & unsure).sum()):,}.\n\n"
        )
    return "".join(lines)


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
        "ours_attempts_per_s": report.ours.attempts_per_s if report.ours else None,
        "engines": {name: _engine_json(found) for name, found in report.engines.items()},
        "pairs": {pair: {"overall": a.as_json(), "closing": c.as_json()} for pair, a, c in report.third},
        "patterns": report.patterns,
        "disagreements": _disagreement_json(report),
    }


def _engine_json(found: EngineReport) -> dict:
    drift = np.percentile(found.drift.moved_m, [50, 99, 100]).tolist() if len(found.drift.moved_m) else None
    return {
        **found.about,
        "drift_m_p50_p99_max": drift,
        "same_gate": _comparison_json(found.same),
        "own_approach": _comparison_json(found.own),
        "ceiling": [
            {"change": c.change, "overall": c.overall.as_json(), "closing": c.closing.as_json(), "sunk_m_p99": _finite(c.sunk_m_p99),
             "flipped": int(c.flipped.sum())}
            for c in found.ceiling
        ],
    }  # fmt: skip


def _comparison_json(c: Comparison) -> dict:
    groups = {"by_shape": c.by_shape, "by_rule": c.by_rule, "by_angle": c.by_angle, "closing_by_shape": c.closing_by_shape}
    return {
        "overall": c.overall.as_json(),
        "closing": c.closing.as_json(),
        "outcome_share": c.outcome_share,
        "confusion": {"outcomes": list(OUTCOMES), "ours_by_theirs": c.confusion.tolist()},
        **{key: {name: a.as_json() for name, a in group.items()} for key, group in groups.items()},
        "width_error": {key: _finite(value) for key, value in vars(c.width).items()},
        "sunk_m_p50_p99": np.percentile(c.sunk_m, [50, 99]).tolist() if len(c.sunk_m) else None,
        "attempts_per_s": c.attempts_per_s,
        "simulated_per_s": c.simulated_per_s,
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
        flips = {
            f"{name} changes": [c.change for c in engine.ceiling if c.flipped[i]]
            for name, engine in report.engines.items() if engine.ceiling
        }  # fmt: skip
        found.append({**where, **flips, "ours": attempt.outcome, **{mode: e.outcome for mode, e in modes.items()}})
    return found


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def terminal(report: Report) -> str:
    """A few lines for the terminal; agreement of labels, kappa, speed."""
    lines = [f"gate               {len(report.gate_differences):,} of {len(report.rows.attempts):,} differ from what is stored"]
    for name, found in report.engines.items():
        for mode, c in (("same gate", found.same), ("own approach", found.own)):
            for part, a in (("", c.overall), (" closing", c.closing)):
                lines.append(
                    f"{name + ' ' + mode + part:<32} agreement {percent(a.share):>9}  κ {kappa(a.kappa)} "
                    f"[{kappa(a.low)}, {kappa(a.high)}]  {a.disagreeing:,} of {a.count:,} differ"
                )
        lines.append(
            f"{name:<32} {found.same.attempts_per_s:,.0f} attempts/s with our gate, "
            f"{found.own.attempts_per_s:,.0f} attempts/s with its own approach, one core"
        )
    if report.ours:
        lines.append(f"{'ours':<32} {report.ours.attempts_per_s:,.0f} attempts/s, one core, start and reading included")
    return "\n".join(lines)
