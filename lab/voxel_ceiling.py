#!/usr/bin/env python3
"""Computes the highest accuracy that any network with one quality per voxel can reach on a dataset.

    python lab/voxel_ceiling.py DATASET [--origin-behind-tips-mm MM …]

The network predicts per voxel, but a label also depends on the approach direction. Attempts that share a voxel of a scene
show how much. If a voxel's attempts hold with probability p, two of them disagree with probability 2 p (1 - p). Pairs of
attempts estimate this without bias if a voxel's attempts are drawn independently. The error of any prediction per voxel is at
least min(p, 1 - p), which lies between p (1 - p) and 2 p (1 - p). So the best accuracy on these attempts lies between 1 - d and
1 - d / 2, where d is the share of pairs that disagree. The interval of d is a bootstrap over scenes (1,000 draws).

Which attempts share a voxel depends on where the network has the origin of a grasp: midway between the finger tips (0), or so
far behind them, against the approach (network.origin_behind_tips_m of a recipe). The table has a row for each. Its last two
columns are the shares of pairs of held attempts of a voxel whose approach, and whose closing direction, differ by more than
30 degrees: a network with one orientation per voxel is wrong about one of the two.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import polars as pl

ORIGINS_MM = [0.0, 20.0, 35.0, 50.0, 70.0]
APART_COS = np.cos(np.radians(30))
AXES = ("approach", "closing")


def attempts_of(dataset: Path, behind_tips_m: float) -> pl.DataFrame:
    """One row per attempt whose origin is in the grid: scene_id, voxel (x, y, z), label, and the axes of its hand, [3] each."""
    grid = json.loads((dataset / "meta/info.json").read_text())["grid"]
    side = grid["size_m"] / grid["resolution"]
    columns = ["scene_id", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "label"]
    rows = pl.read_parquet(str(dataset / "attempts/*.parquet"), columns=columns)
    x, y, z, w = (rows[name].to_numpy().astype(float) for name in ("qx", "qy", "qz", "qw"))
    approach = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    closing = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=1)
    tips = rows.select("x_m", "y_m", "z_m").to_numpy().astype(float)
    voxel = np.floor((tips - behind_tips_m * approach) / side).astype(np.int32)
    table = rows.select("scene_id", "label").with_columns(
        *(pl.Series(axis, voxel[:, at]) for at, axis in enumerate("xyz")),
        *(pl.Series(name, axis, dtype=pl.Array(pl.Float64, 3)) for name, axis in zip(AXES, (approach, closing))),
    )
    return table.filter(*(pl.col(axis).is_between(0, grid["resolution"] - 1) for axis in "xyz"))


def voxels(attempts: pl.DataFrame) -> pl.DataFrame:
    """One row per voxel and scene: attempts `n`, held ones `k`."""
    return attempts.group_by("scene_id", *"xyz").agg(n=pl.len(), k=pl.col("label").sum().cast(pl.Int64))


def differing(attempts: pl.DataFrame) -> list[float]:
    """Of the pairs of held attempts of a voxel, the share whose approach, and whose closing direction, differ by over 30 degrees."""
    held = attempts.filter(pl.col("label") == 1).sort("scene_id", *"xyz").with_row_index("row")
    pairs = held.join(held.select("scene_id", *"xyz", "row"), on=["scene_id", *"xyz"]).filter(pl.col("row") < pl.col("row_right"))
    one, other = pairs["row"].to_numpy(), pairs["row_right"].to_numpy()
    shares = []
    for name in AXES:
        axis = held[name].to_numpy()
        cosines = (axis[one] * axis[other]).sum(axis=1)
        # A hand and the same hand turned by half a turn close along opposite directions.
        shares.append(float(np.mean((np.abs(cosines) if name == "closing" else cosines) < APART_COS)) if len(one) else float("nan"))
    return shares


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
    parser.add_argument("--origin-behind-tips-mm", type=float, nargs="+", default=ORIGINS_MM, metavar="MM")
    arguments = parser.parse_args()
    print("| origin behind the tips | attempts in the grid | of these, sharing a voxel | pairs that disagree (95 %) | always \"failure\" "
          "| best accuracy per voxel | approach; closing differ by > 30° |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for behind_mm in arguments.origin_behind_tips_mm:
        attempts = attempts_of(arguments.dataset, behind_mm / 1e3)
        found = ceiling(voxels(attempts))
        (low, high), (least, most) = found["disagreeing_pairs_95"], found["best_accuracy"]
        approach, closing = differing(attempts)
        print(f"| {behind_mm:g} mm | {found['attempts']} | {found['sharing_a_voxel']:.1%} | {found['disagreeing_pairs']:.1%} ({low:.1%} to {high:.1%}) "
              f"| {found['always_failure']:.1%} | {least:.3f} to {most:.3f} | {approach:.0%}; {closing:.0%} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
