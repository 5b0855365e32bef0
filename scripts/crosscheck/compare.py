"""Compares a pass with the stored outcomes, or with another pass."""

from dataclasses import dataclass

import numpy as np

from .agreement import Agreement, agreement, confusion
from .contract import BLOCKED, OUTCOMES, Attempt
from .dataset import Dataset
from .gate import GateResult
from .passes import Pass

ANGLES_DEG = (0, 15, 30, 45, 60, 90, 180)


@dataclass(frozen=True)
class Rows:
    """The dataset's attempts in a row: `scenes` (n,), `attempts` (n), our `outcomes` (n)."""

    scenes: np.ndarray
    attempts: list[Attempt]
    outcomes: list[str]

    @property
    def labels(self) -> np.ndarray:
        """Our labels (n,)."""
        return np.array([outcome == "held" for outcome in self.outcomes], dtype=int)


@dataclass(frozen=True)
class WidthError:
    """Their opening minus ours where both held: count, and percentiles in metres."""

    count: int
    mean_m: float
    median_abs_m: float
    p90_abs_m: float
    p99_abs_m: float


@dataclass(frozen=True)
class Comparison:
    """All results for one mode of one engine."""

    overall: Agreement
    outcome_share: float
    closing: Agreement
    confusion: np.ndarray
    by_shape: dict[str, Agreement]
    by_rule: dict[str, Agreement]
    by_angle: dict[str, Agreement]
    closing_by_shape: dict[str, Agreement]
    width: WidthError
    attempts_per_s: float


def rows_of(dataset: Dataset) -> Rows:
    """The dataset's attempts in a row."""
    attempts = [attempt for scene in dataset.scenes for attempt in scene.attempts]
    scenes = np.array([scene.scene_id for scene in dataset.scenes for _ in scene.attempts])
    return Rows(scenes, attempts, [attempt.outcome for attempt in attempts])


def compare(rows: Rows, theirs: Pass, seed: int) -> Comparison:
    """Our stored outcomes against a pass."""
    outcomes = [execution.outcome for execution in theirs.executions]
    closing = reaches_closing(rows.outcomes) & reaches_closing(outcomes)

    def on(chosen: np.ndarray) -> Agreement:
        return agreement(rows.labels[chosen], theirs.labels[chosen], rows.scenes[chosen], seed)

    def by(keys: list[str], among: np.ndarray) -> dict[str, Agreement]:
        keys_array = np.array(keys)
        return {key: on((keys_array == key) & among) for key in dict.fromkeys(sorted(keys))}

    everything = np.ones(len(outcomes), dtype=bool)
    shapes = [a.shape for a in rows.attempts]
    return Comparison(
        overall=on(everything),
        outcome_share=float(np.mean([a == b for a, b in zip(rows.outcomes, outcomes)])),
        closing=on(closing),
        confusion=confusion(rows.outcomes, outcomes, OUTCOMES),
        by_shape=by(shapes, everything),
        by_rule=by([a.rule for a in rows.attempts], everything),
        by_angle=by([_angle_bin(a) for a in rows.attempts], everything),
        closing_by_shape=by(shapes, closing),
        width=_width_error(rows, theirs),
        attempts_per_s=len(outcomes) / theirs.seconds,
    )


def compare_passes(rows: Rows, a: Pass, b: Pass, seed: int) -> tuple[Agreement, Agreement]:
    """Two passes against each other: overall, and among attempts that reach closing in both."""
    closing = reaches_closing([e.outcome for e in a.executions]) & reaches_closing([e.outcome for e in b.executions])
    return (agreement(a.labels, b.labels, rows.scenes, seed), agreement(a.labels[closing], b.labels[closing], rows.scenes[closing], seed))


def compare_gate(rows: Rows, gate: list[GateResult]) -> list[int]:
    """Attempts for which the stored gate result and this implementation differ, including what was hit."""
    stored = [(a.outcome, a.hit) if a.outcome in BLOCKED else (None, None) for a in rows.attempts]
    return [i for i, (a, b) in enumerate(zip(stored, gate)) if a != (b.outcome, b.hit)]


def reaches_closing(outcomes: list[str]) -> np.ndarray:
    """Which outcomes (n,) come after the approach."""
    return np.array([outcome not in BLOCKED for outcome in outcomes])


def _angle_bin(attempt: Attempt) -> str:
    degrees = np.degrees(attempt.approach_angle_rad)
    upper = next((high for high in ANGLES_DEG[1:] if degrees < high), ANGLES_DEG[-1])
    return f"{ANGLES_DEG[ANGLES_DEG.index(upper) - 1]:02d}–{upper:02d}°"


def _width_error(rows: Rows, theirs: Pass) -> WidthError:
    pairs = zip(rows.attempts, theirs.executions)
    error = np.array([e.width_m - a.width_m for a, e in pairs if a.outcome == e.outcome == "held"])
    if len(error) == 0:
        return WidthError(0, *[float("nan")] * 4)
    return WidthError(len(error), float(error.mean()), *(float(v) for v in np.percentile(abs(error), [50, 90, 99])))
