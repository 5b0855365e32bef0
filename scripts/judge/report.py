"""Compares the results of two engines for the same grasps: numbers, Markdown, JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from crosscheck.agreement import RESAMPLES, Agreement, agreement, confusion, finite
from crosscheck.compare import Rows, reaches_closing, rows_of
from crosscheck.contract import BLOCKED, OUTCOMES
from crosscheck.markdown import AGREEMENT_HEAD, agreement_cells, drifted, percent, table
from crosscheck.passes import Drift, Pass

from .experiment import Experiment

# Of the bootstrap, so that the same folder gives the same report.
SEED = 1
LABELS = ("not held", "held")
SHARES_HEAD = ["held, ours [95 %]", "held, PyBullet [95 %]", "PyBullet − ours [95 %]"]
PART_HEAD = ["grasps", *SHARES_HEAD, *AGREEMENT_HEAD[1:], "same outcome"]


@dataclass(frozen=True)
class Rate:
    """A share and the bounds of 95 % of its bootstrap; NaN without any grasps."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Part:
    """Results for a subset of the grasps. `difference` is PyBullet's success rate minus ours, on the same draws of rounds."""

    attempts: int
    ours: Rate
    theirs: Rate
    difference: Rate
    labels: Agreement
    same_outcome: float
    confusion: np.ndarray

    @property
    def held(self) -> np.ndarray:
        """Counts (2, 2): ours down, theirs across, not held before held."""
        held = OUTCOMES.index("held")
        both, ours, theirs = self.confusion[held, held], self.confusion[held].sum(), self.confusion[:, held].sum()
        return np.array([[self.attempts - ours - theirs + both, theirs - both], [ours - both, both]])


@dataclass(frozen=True)
class Report:
    """All results. `closing`: grasps that reach closing in both engines."""

    command: str
    experiment: Experiment
    engine: dict
    rows: Rows
    drift: Drift
    theirs: list[str]
    overall: Part
    closing: Part
    by_body: dict[str, Part]

    @property
    def gate_differences(self) -> int:
        """Grasps for which the two gates, which involve no physics, differ."""
        pairs = zip(self.rows.outcomes, self.theirs)
        return sum(a != b and (a in BLOCKED or b in BLOCKED) for a, b in pairs)


def report_of(experiment: Experiment, judged: Pass, drift: Drift, engine: dict, command: str) -> Report:
    """Compares the stored outcomes with PyBullet's."""
    rows, theirs = rows_of(experiment.data), [execution.outcome for execution in judged.executions]

    def part(chosen: np.ndarray) -> Part:
        picked = np.flatnonzero(chosen)
        return part_of([rows.outcomes[i] for i in picked], [theirs[i] for i in picked], rows.scenes[picked], rows.scenes)

    bodies = np.array([attempt.shape for attempt in rows.attempts])
    return Report(
        command, experiment, engine, rows, drift, theirs,
        overall=part(np.ones(len(theirs), dtype=bool)),
        closing=part(reaches_closing(rows.outcomes) & reaches_closing(theirs)),
        by_body={body: part(bodies == body) for body in sorted(set(bodies.tolist()))},
    )  # fmt: skip


def part_of(ours: Sequence[str], theirs: Sequence[str], rounds: np.ndarray, all_rounds: np.ndarray) -> Part:
    """Compares outcomes of grasps whose rounds are `rounds` (n,); `all_rounds` are those that the bootstrap draws from."""
    held = np.array([[a == "held", b == "held"] for a, b in zip(ours, theirs)], dtype=int).reshape(-1, 2)
    same = float(np.mean([a == b for a, b in zip(ours, theirs)])) if len(held) else float("nan")
    return Part(
        len(held), *rates(held, rounds, all_rounds), agreement(held[:, 0], held[:, 1], rounds, SEED), same,
        confusion(ours, theirs, OUTCOMES),
    )  # fmt: skip


def rates(held: np.ndarray, rounds: np.ndarray, all_rounds: np.ndarray) -> tuple[Rate, Rate, Rate]:
    """Shares of `held` (n, 2) in its columns, and of the second less the first, with intervals over rounds.

    Whole rounds are drawn with replacement, as many as there are. Fewer than two rounds contain no information about
    their variance; the interval is then the whole range of a share or a difference.
    """
    names = np.unique(all_rounds)
    sums = np.zeros((len(names), 3))
    np.add.at(sums, np.searchsorted(names, rounds), np.column_stack([held, np.ones(len(held))]))
    if not len(held):
        return (Rate(*[float("nan")] * 3),) * 3
    values = _shares(sums.sum(axis=0))
    if (sums[:, 2] > 0).sum() < 2:
        bounds = np.array([[0.0, 0.0, -1.0], [1.0, 1.0, 1.0]])
    else:
        weights = np.random.default_rng(SEED).multinomial(len(names), np.full(len(names), 1 / len(names)), size=RESAMPLES)
        drawn = weights @ sums
        bounds = np.percentile(_shares(drawn[drawn[:, 2] > 0]), [2.5, 97.5], axis=0)
    ours, theirs, difference = (Rate(*map(float, column)) for column in np.vstack([values, bounds]).T)
    return ours, theirs, difference


def _shares(sums: np.ndarray) -> np.ndarray:
    """First, second and second less first (..., 3) of sums (..., 3) over their third."""
    first, second = sums[..., 0] / sums[..., 2], sums[..., 1] / sums[..., 2]
    return np.stack([first, second, second - first], axis=-1)


def markdown(report: Report) -> str:
    """The report for people."""
    experiment, about = report.experiment, report.engine
    settings = ", ".join(f"{key} {value:g}" for key, value in about["settings"].items())
    rounds = len(np.unique(report.rows.scenes))
    return "".join([
        f"# {experiment.name} judged by PyBullet\n\n    {report.command}\n\n",
        f"Protocol `{experiment.protocol}`, seed {', '.join(map(str, experiment.seeds))}: {report.overall.attempts:,} executed grasps of {rounds:,} "
        "rounds, each executed again on the scene on which it was planned. The geometric gate is written again; physics begins with "
        "closing. Intervals hold 95 % of a bootstrap that draws rounds; rounds without a grasp are not among them. κ is Cohen's.\n\n",
        f"pybullet {about['version']}: {settings}.\n\n",
        _summary(report),
        drifted("PyBullet", "objects of these scenes", report.drift.moved_m, report.drift.turned_rad),
        _part("All grasps", report.overall),
        _part("Grasps that reach closing in both", report.closing),
        _by_body(report),
        _differing(report),
    ])  # fmt: skip


def _summary(report: Report) -> str:
    lines = [["all", *_cells(report.overall)], ["closing phase", *_cells(report.closing)]]
    return table(["", *PART_HEAD], lines) + f"The gates differ on {report.gate_differences:,} grasps.\n\n"


def _cells(part: Part) -> list[str]:
    shares = [_rate(part.ours), _rate(part.theirs), _rate(part.difference)]
    return [f"{part.attempts:,}", *shares, *agreement_cells(part.labels)[1:], percent(part.same_outcome)]


def _rate(rate: Rate) -> str:
    return f"{percent(rate.value)} [{percent(rate.low)}, {percent(rate.high)}]"


def _part(title: str, part: Part) -> str:
    return (
        f"## {title}\n\nOurs down, PyBullet's across:\n\n"
        + table(["", *LABELS], [[name, *line] for name, line in zip(LABELS, part.held.tolist())])
        + table(["", *OUTCOMES], [[name, *line] for name, line in zip(OUTCOMES, part.confusion.tolist())])
    )


def _by_body(report: Report) -> str:
    return "## By body\n\n" + table(["target", *PART_HEAD], [[body, *_cells(part)] for body, part in report.by_body.items()])


def _differing(report: Report) -> str:
    lines = [
        [f"{round_number}/{attempt.attempt_id}", attempt.shape, ours, theirs]
        for round_number, attempt, ours, theirs in _pairs(report)
        if (ours == "held") != (theirs == "held")
    ]
    text = f"## Grasps that only one of them holds ({len(lines):,})\n\n"
    return text + (table(["round/trial", "target", "ours", "PyBullet"], lines) if lines else "")


def _pairs(report: Report) -> list[tuple]:
    return list(zip(report.rows.scenes.tolist(), report.rows.attempts, report.rows.outcomes, report.theirs))


def as_json(report: Report) -> dict:
    """The report for programs; NaN becomes null."""
    return {
        "command": report.command,
        "experiment": report.experiment.name,
        "protocol": report.experiment.protocol,
        "seeds": report.experiment.seeds,
        "rounds": len(np.unique(report.rows.scenes)),
        "engine": report.engine,
        "gate_differences": report.gate_differences,
        "drift_m_p50_p99_max": np.percentile(report.drift.moved_m, [50, 99, 100]).tolist(),
        "overall": _part_json(report.overall),
        "closing": _part_json(report.closing),
        "by_body": {body: _part_json(part) for body, part in report.by_body.items()},
        "attempts": [
            {"round": number, "trial": attempt.attempt_id, "body": attempt.shape, "ours": ours, "pybullet": theirs}
            for number, attempt, ours, theirs in _pairs(report)
        ],
    }


def _part_json(part: Part) -> dict:
    return {
        "attempts": part.attempts,
        "success_rate_ours": finite(vars(part.ours)),
        "success_rate_pybullet": finite(vars(part.theirs)),
        "difference": finite(vars(part.difference)),
        "labels": part.labels.as_json(),
        **finite({"outcome_share": part.same_outcome}),
        "held_ours_by_pybullet": part.held.tolist(),
        "confusion": {"outcomes": list(OUTCOMES), "ours_by_pybullet": part.confusion.tolist()},
    }
