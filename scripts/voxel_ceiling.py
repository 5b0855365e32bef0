#!/usr/bin/env python3
"""Computes the highest accuracy that any network with one quality per voxel can reach on a dataset.

    python scripts/voxel_ceiling.py DATASET

The network predicts per voxel, but a label also depends on the approach direction. Attempts that share a voxel of a scene
show how much. If a voxel's attempts hold with probability p, two of them disagree with probability 2 p (1 - p). Pairs of
attempts estimate this without bias if a voxel's attempts are drawn independently. The error of any prediction per voxel is at
least min(p, 1 - p), which lies between p (1 - p) and 2 p (1 - p). So the best accuracy on these attempts lies between 1 - d and
1 - d / 2, where d is the share of pairs that disagree. The interval of d is a bootstrap over scenes (1,000 draws).
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import polars as pl


def voxels(dataset: Path) -> pl.DataFrame:
    """One row per voxel and scene: attempts `n`, held ones `k`. Grasps outside the grid are dropped."""
    grid = json.loads((dataset / "meta/info.json").read_text())["grid"]
    side = grid["size_m"] / grid["resolution"]
    attempts = pl.read_parquet(str(dataset / "attempts/*.parquet"), columns=["scene_id", "x_m", "y_m", "z_m", "label"])
    places = [(pl.col(f"{axis}_m") / side).floor().cast(pl.Int32).alias(axis) for axis in "xyz"]
    inside = [pl.col(axis).is_between(0, grid["resolution"] - 1) for axis in "xyz"]
    attempts = attempts.with_columns(places).filter(*inside)
    return attempts.group_by("scene_id", *"xyz").agg(n=pl.len(), k=pl.col("label").sum().cast(pl.Int64))


def ceiling(table: pl.DataFrame, draws: int = 1000) -> dict:
    """The ceiling from attempts that share a voxel; voxels are weighted by their attempts."""
    shared = table.filter(pl.col("n") > 1)
    n, k = (shared[name].to_numpy().astype(float) for name in "nk")
    disagreeing = n * 2 * k * (n - k) / (n * (n - 1))  # attempts, times the share of their voxel's pairs that disagree
    sums = pl.DataFrame({"scene": shared["scene_id"], "n": n, "d": disagreeing}).group_by("scene").sum().sort("scene")
    per_scene = sums.select("n", "d").to_numpy()
    if not len(per_scene):
        raise SystemExit("no two attempts share a voxel of a scene: nothing can be said")
    random = np.random.default_rng(0)
    drawn = np.array([per_scene[random.integers(len(per_scene), size=len(per_scene))].sum(axis=0) for _ in range(draws)])
    share = disagreeing.sum() / n.sum()
    return {
        "attempts": int(table["n"].sum()),
        "sharing_a_voxel": float(n.sum() / table["n"].sum()),
        "always_failure": float(1 - k.sum() / n.sum()),
        "disagreeing_pairs": float(share),
        "disagreeing_pairs_95": [float(q) for q in np.quantile(drawn[:, 1] / drawn[:, 0], [0.025, 0.975])],
        "best_accuracy": [float(1 - share), float(1 - share / 2)],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    found = ceiling(voxels(parser.parse_args().dataset))
    low, high = found["disagreeing_pairs_95"]
    print(f"attempts in the grid           {found['attempts']}")
    print(f"of these, sharing a voxel      {found['sharing_a_voxel']:.1%}; on them always \"failure\" is right in {found['always_failure']:.1%}")
    print(f"pairs of a voxel that disagree {found['disagreeing_pairs']:.1%} (95 %: {low:.1%} to {high:.1%})")
    print("best accuracy per voxel        between {:.1%} and {:.1%}".format(*found["best_accuracy"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
