"""The agreement of an engine with itself, which agreement between engines cannot be expected to exceed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import engines
from .agreement import Agreement
from .compare import Rows, compare_passes
from .dataset import Dataset
from .passes import Pass, displaced, same_gate

JITTERS_M = (1e-4, 5e-4)


@dataclass(frozen=True)
class Ceiling:
    """An engine against itself under one change; `flipped` (n,): whose label the change turns."""

    change: str
    overall: Agreement
    closing: Agreement
    sunk_m_p99: float
    flipped: np.ndarray


def measure(dataset: Dataset, rows: Rows, name: str, rate: float, base: Pass, seed: int) -> list[Ceiling]:
    """The engine's pass `base`, stepped at `rate` Hz, against passes with displaced grasps and other settings."""
    changes = [(f"grasps displaced by {1e3 * j:g} mm", {}, displaced(j, seed)) for j in JITTERS_M]
    changes += [(change, options, None) for change, options in engines.variants(name, rate)]
    found = []
    for change, options, jitter in changes:
        engine = engines.make(name, **options)
        other = same_gate(change, dataset, engine, jitter)
        engine.close()
        sunk = [e.sunk_m for e in other.executions if np.isfinite(e.sunk_m)]
        deep = float(np.percentile(sunk, 99)) if sunk else float("nan")
        found.append(Ceiling(change, *compare_passes(rows, base, other, seed), deep, base.labels != other.labels))
    return found
