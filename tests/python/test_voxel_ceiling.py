"""lab/voxel_ceiling.py on tables with a known ceiling."""

from itertools import combinations

import numpy as np
import polars as pl
import pytest

from voxel_ceiling import ceiling  # noqa: E402


def test_pairs_are_counted_as_by_hand():
    voxels = [(0, [1, 0, 0]), (0, [1]), (1, [1, 1]), (1, [0, 1, 1, 0])]
    table = pl.DataFrame({"scene_id": [s for s, _ in voxels], "n": [len(v) for _, v in voxels], "k": [sum(v) for _, v in voxels]})
    shared = [labels for _, labels in voxels if len(labels) > 1]
    per_voxel = [np.mean([a != b for a, b in combinations(labels, 2)]) for labels in shared]
    by_hand = np.average(per_voxel, weights=[len(labels) for labels in shared])
    found = ceiling(table, draws=10)
    assert found["disagreeing_pairs"] == pytest.approx(by_hand)
    assert found["sharing_a_voxel"] == pytest.approx(9 / 10)


@pytest.mark.parametrize("shape", [0.2, 1.0, 5.0])
def test_the_best_accuracy_lies_between_the_bounds(shape):
    random = np.random.default_rng(3)
    p = random.beta(shape, shape, size=40_000)
    n = random.integers(2, 5, size=p.size)
    table = pl.DataFrame({"scene_id": np.arange(p.size) // 20, "n": n, "k": random.binomial(n, p)})
    best = np.average(np.maximum(p, 1 - p), weights=n)
    low, high = ceiling(table, draws=20)["best_accuracy"]
    assert low - 0.005 < best < high + 0.005
