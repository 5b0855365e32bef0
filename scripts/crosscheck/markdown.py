"""Small pieces of Markdown."""

from collections.abc import Iterable

import numpy as np

from .agreement import Agreement


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table, first column to the left, the others to the right."""
    head = list(head)
    first, *rest = ["| " + " | ".join(str(cell) for cell in line) + " |\n" for line in [head, *rows]]
    return "".join([first, "|---" + "|---:" * (len(head) - 1) + "|\n", *rest]) + "\n"


def percent(share: float) -> str:
    """A share with two decimals."""
    return f"{100 * share:.2f} %" if np.isfinite(share) else "–"


def kappa(value: float) -> str:
    """Three decimals, or a dash where kappa says nothing."""
    return f"{value:.3f}" if np.isfinite(value) else "–"


def interval(a: Agreement) -> str:
    """Kappa with its interval."""
    return f"{kappa(a.kappa)} [{kappa(a.low)}, {kappa(a.high)}]"


def millimetres(value_m: float) -> str:
    """Metres as millimetres."""
    return f"{1e3 * value_m:.3f}" if np.isfinite(value_m) else "–"


def drifted(engine: str, moved_m: np.ndarray, turned_rad: np.ndarray) -> str:
    """How far objects (n,) moved and turned without the gripper."""
    moved, turned = (np.percentile(x, [50, 99, 100]) for x in (moved_m, np.degrees(turned_rad)))
    return (
        f"Half a second in {engine} without the gripper moves {len(moved_m):,} settled objects by {millimetres(moved[0])} mm (median), "
        f"{millimetres(moved[1])} mm (99 %), {millimetres(moved[2])} mm (most), and turns them by {turned[0]:.3f}°, "
        f"{turned[1]:.3f}°, {turned[2]:.3f}°.\n\n"
    )


AGREEMENT_HEAD = ["attempts", "disagree", "agreement", "κ [95 %]"]


def agreement_cells(a: Agreement) -> list[str]:
    """Cells for `AGREEMENT_HEAD`."""
    return [f"{a.count:,}", f"{a.disagreeing:,}", percent(a.share), interval(a)]
