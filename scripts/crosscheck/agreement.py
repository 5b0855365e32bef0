"""Agreement of two label series: share, Cohen's kappa, bootstrap interval, confusion tables."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

RESAMPLES = 2000


@dataclass(frozen=True)
class Agreement:
    """Agreement on `count` labels; `low` and `high` bound 95 % of kappa's bootstrap."""

    count: int
    disagreeing: int
    kappa: float
    low: float
    high: float

    @property
    def share(self) -> float:
        """Share of equal labels; NaN without any."""
        return 1 - self.disagreeing / self.count if self.count else float("nan")

    def as_json(self) -> dict:
        """For the JSON report."""
        values = {"share": self.share, "kappa": self.kappa, "kappa_low": self.low, "kappa_high": self.high}
        return {"count": self.count, "disagreeing": self.disagreeing, **finite(values)}


def finite(values: dict[str, float]) -> dict[str, float | None]:
    """Numbers as JSON has them: NaN becomes null."""
    return {key: value if np.isfinite(value) else None for key, value in values.items()}


def kappas(cells: np.ndarray) -> np.ndarray:
    """Cohen's kappa of 2 × 2 tables (..., 4) in the order (0,0), (0,1), (1,0), (1,1).

    NaN where chance alone would agree always (both series constant and equal): kappa says nothing there.
    """
    cells = np.asarray(cells, dtype=float)
    total = cells.sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        observed = (cells[..., 0] + cells[..., 3]) / total
        first, second = (cells[..., 2] + cells[..., 3]) / total, (cells[..., 1] + cells[..., 3]) / total
        chance = first * second + (1 - first) * (1 - second)
        return np.where(chance < 1, (observed - chance) / (1 - chance), np.nan)


def agreement(a: np.ndarray, b: np.ndarray, groups: np.ndarray, seed: int) -> Agreement:
    """Agreement of two label arrays (n,) of 0 and 1.

    The bootstrap draws whole groups (n,), the scenes: attempts of one scene are not independent.
    """
    a, b = np.asarray(a, dtype=int), np.asarray(b, dtype=int)
    if len(a) == 0:
        return Agreement(0, 0, *[float("nan")] * 3)
    _, group = np.unique(groups, return_inverse=True)
    cells = np.zeros((group.max() + 1, 4))
    np.add.at(cells, (group, 2 * a + b), 1)
    rng = np.random.default_rng(seed)
    weights = rng.multinomial(len(cells), np.full(len(cells), 1 / len(cells)), size=RESAMPLES)
    drawn = kappas(weights @ cells)
    drawn = drawn[np.isfinite(drawn)]
    low, high = np.percentile(drawn, [2.5, 97.5]) if len(drawn) else (np.nan, np.nan)
    return Agreement(len(a), int((a != b).sum()), float(kappas(cells.sum(axis=0))), float(low), float(high))


def confusion(ours: Sequence[str], theirs: Sequence[str], names: Sequence[str]) -> np.ndarray:
    """Counts (len(names), len(names)): ours down, theirs across."""
    counts = Counter(zip(ours, theirs))
    return np.array([[counts[a, b] for b in names] for a in names])
