"""Scores of numbers that rank grasps, or say how likely they hold, against what became of the grasps."""

import numpy as np

from .agreement import RESAMPLES


def auc(truth: np.ndarray, score: np.ndarray) -> float:
    """Of all pairs of a grasp that held (n,) and one that did not, the share in which the first has the larger score; equal
    ones count half. NaN without pairs."""
    _, place, counts = np.unique(score, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[place]
    held = int(truth.sum())
    pairs = held * (len(truth) - held)
    return float((ranks @ truth - held * (held + 1) / 2) / pairs) if pairs else float("nan")


def brier(truth: np.ndarray, probability: np.ndarray) -> float:
    """The mean square of what a probability (n,) is off by; NaN without grasps."""
    return float(np.mean((truth - probability) ** 2)) if len(truth) else float("nan")


def auc_within(truth: np.ndarray, score: np.ndarray, groups: np.ndarray) -> float:
    """The mean of the AUCs of the groups (n,), weighted by their grasps: what a score knows beside the group."""
    own = [groups == group for group in np.unique(groups)]
    values, counts = np.array([auc(truth[one], score[one]) for one in own]), np.array([one.sum() for one in own])
    counts = counts * np.isfinite(values)
    return float(np.nan_to_num(values) @ counts / counts.sum()) if counts.any() else float("nan")


def gain(truth: np.ndarray, better: np.ndarray, score: np.ndarray, groups: np.ndarray, drawn: np.ndarray, seed: int) -> np.ndarray:
    """How much larger the AUC of `better` within the groups (n,) is than that of `score`, and the bounds of 95 % of a bootstrap
    that draws whole objects, named by `drawn` (n,)."""
    rows = [np.flatnonzero(drawn == name) for name in np.unique(drawn)]
    draws = np.random.default_rng(seed).integers(len(rows), size=(RESAMPLES, len(rows)))
    picked = [np.arange(len(truth)), *(np.concatenate([rows[number] for number in draw]) for draw in draws)]
    found = [auc_within(truth[one], better[one], groups[one]) - auc_within(truth[one], score[one], groups[one]) for one in picked]
    return np.array([found[0], *np.nanpercentile(found[1:], [2.5, 97.5])])


def without_own_group(features: np.ndarray, truth: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """P(held) (n,) by a logistic regression on features (n, k) that saw what became of all groups (n,) but the grasp's own. To be
    ranked within groups only: where a group that often holds is missing, the constant is too low for it. A ridge of 1 on
    standardised features keeps the weights of few grasps finite."""
    spread = features.std(axis=0)
    inputs = np.column_stack([(features - features.mean(axis=0)) / np.where(spread > 0, spread, 1), np.ones(len(truth))])
    found, ridge = np.empty(len(truth)), np.diag([*[1.0] * features.shape[1], 0.0])
    for group in np.unique(groups):
        own, weights = groups == group, np.zeros(len(ridge))
        seen = inputs[~own]
        for _ in range(50):  # Newton's method
            share = 1 / (1 + np.exp(-seen @ weights))
            slope = seen.T @ (truth[~own] - share) - ridge @ weights
            weights = weights + np.linalg.solve((seen.T * (share * (1 - share))) @ seen + ridge, slope)
        found[own] = 1 / (1 + np.exp(-inputs[own] @ weights))
    return found
