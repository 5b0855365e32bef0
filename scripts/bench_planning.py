#!/usr/bin/env python3
"""Compares the time of a plan with that of other implementations of its parts, in one run, and compares the detections.

    cargo build --release
    target/release/generator --shards 1 --attempts 2400 --seed 7 --out scenes
    target/release/generator depth scenes --scene 3 --views 6 --out six
    python3 -m venv venv && venv/bin/pip install -r scripts/requirements-golden.txt pyarrow open3d
    venv/bin/python scripts/bench_planning.py target/release/planner --views six/views.toml --dataset scenes

PyTorch evaluates the paper's network with two threads, scipy finds the detections as VGN's published code does, and Open3D, if
installed, fuses the same depth images as VGN does. With --dataset every scene is planned in both ways, in front of surfaces,
where both networks have their origins, with the weights of models/. The detected voxels must be equal, except where qualities differ from the threshold or
from each other only by rounding.
"""

import argparse
import json
import statistics
import subprocess
import tempfile
import time
import tomllib
from pathlib import Path

import numpy as np
import torch
from golden_planning import process, select
from golden_torch import forward
from safetensors.torch import load_file

ROOT = Path(__file__).parents[1]
SIZE_M, RESOLUTION = 0.3, 40


def timed(work, rounds):
    """Median of milliseconds, after one round that is not counted."""
    work()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def matrix(pose):
    if isinstance(pose, list):
        return np.array(pose)
    x, y, z, w = np.array(pose["quaternion_xyzw"]) / np.linalg.norm(pose["quaternion_xyzw"])
    made = np.eye(4)
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    made[:3, 3] = pose["position_m"]
    return made


def open3d_ms(views, rounds):
    """Open3D's TSDF of the views, as VGN's TSDFVolume makes it."""
    try:
        import open3d
    except ImportError:
        return None
    request = tomllib.loads(views.read_text())
    lens = request["intrinsics"]
    lens = open3d.camera.PinholeCameraIntrinsic(
        lens["width_px"], lens["height_px"], lens["fx_px"], lens["fy_px"], lens["cx_px"], lens["cy_px"]
    )
    seen = []
    for view in request["views"]:
        depth = np.asarray(open3d.io.read_image(str(views.parent / view["depth"]))) * np.float32(view["depth_scale_m"])
        grey = open3d.geometry.Image(np.zeros_like(depth))
        image = open3d.geometry.RGBDImage.create_from_color_and_depth(
            grey, open3d.geometry.Image(depth.astype(np.float32)), depth_scale=1.0, depth_trunc=2.0, convert_rgb_to_intensity=False
        )
        seen.append((image, np.linalg.inv(matrix(view["workspace_from_camera"]))))

    def fuse():
        volume = open3d.pipelines.integration.UniformTSDFVolume(
            length=SIZE_M,
            resolution=RESOLUTION,
            sdf_trunc=4 * SIZE_M / RESOLUTION,
            color_type=open3d.pipelines.integration.TSDFVolumeColorType.NoColor,
        )
        for image, extrinsic in seen:
            volume.integrate(image, lens, extrinsic)

    return timed(fuse, rounds)


def grids(dataset):
    import pyarrow.parquet as parquet

    for path in sorted((dataset / "scenes").glob("*.parquet")):
        for row in parquet.read_table(path, columns=["tsdf"])["tsdf"]:
            yield np.array(row.as_py(), dtype=np.float32)


def both_ways(planner, weights, dataset):
    """Scenes, detections there, detections here, scenes that differ."""
    scenes = theirs = ours = 0
    different = []
    with tempfile.TemporaryDirectory() as folder:
        for scene, grid in enumerate(grids(dataset)):
            quality, _, width = (out.numpy()[0] for out in forward(weights, torch.from_numpy(grid)[None, None], "linear"))
            *_, good = process(quality[0], grid, width[0])
            wanted = {tuple(int(x) for x in voxel) for voxel in select(good)}
            path = Path(folder) / "tsdf.npy"
            np.save(path, grid)
            command = [planner, "plan", "--tsdf", path, "--config", "paper", "--policy", "vgn-best", "--json", "--quiet"]
            plan = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            got = {tuple(grasp["voxel"]) for grasp in plan["grasps"]}
            scenes, theirs, ours = scenes + 1, theirs + len(wanted), ours + len(got)
            if got != wanted:
                different.append((scene, sorted(wanted - got), sorted(got - wanted)))
    return scenes, theirs, ours, different


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("planner", type=Path)
    parser.add_argument("--views", type=Path, required=True)
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--turns", type=int, default=3)
    args = parser.parse_args()
    torch.set_num_threads(2)
    torch.set_grad_enabled(False)
    weights = {name: value for name, value in load_file(ROOT / "models" / "paper-200k.safetensors").items()}
    random = np.random.default_rng(1)
    grid = torch.from_numpy(np.where(random.random((1, 1, 40, 40, 40)) < 0.3, random.random((1, 1, 40, 40, 40)), 0).astype(np.float32))
    quality, _, width = (out.numpy()[0, 0] for out in forward(weights, grid, "linear"))
    tsdf = grid.numpy()[0, 0]

    def detect():
        *_, good = process(quality, tsdf, width)
        select(good)

    rows = {}
    # In turns, so that other load on the machine affects all of them equally.
    for _ in range(args.turns):
        rows.setdefault("PyTorch's forward pass, 2 threads", []).append(timed(lambda: forward(weights, grid, "linear"), args.rounds))
        rows.setdefault("scipy's detections", []).append(timed(detect, args.rounds))
        others = open3d_ms(args.views, args.rounds)
        if others is not None:
            rows.setdefault("Open3D's TSDF", []).append(others)
        for threads in (2, 1):
            command = [args.planner, "bench", "--config", "paper", "--json", "--plans", str(args.rounds), "--threads", str(threads), "--views", args.views]
            report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            rows.setdefault(f"our TSDF, {threads} threads", []).append(report["tsdf"]["median_ms"])
            fuse_ms = next(stage["median_ms"] for stage in report["stages"] if stage["stage"] == "fuse")
            rows.setdefault(f"our plan, TSDF to ranked grasps, {threads} threads", []).append(report["plan"]["median_ms"] - fuse_ms)
    print(f"medians of {args.rounds} rounds, ms, in {args.turns} turns:")
    for name, times in rows.items():
        print(f"  {name:<44}" + "".join(f"{ms:9.2f}" for ms in times))
    if args.dataset:
        scenes, theirs, ours, different = both_ways(args.planner, weights, args.dataset)
        print(f"{scenes} scenes: {theirs} detections by PyTorch and scipy, {ours} by the planner, {len(different)} scenes differ")
        for scene, missing, extra in different:
            print(f"  scene {scene}: only theirs {missing}, only ours {extra}")


if __name__ == "__main__":
    main()
