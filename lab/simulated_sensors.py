#!/usr/bin/env python3
"""Renders scenes from where real captures were taken and spoils them, for scripts/sensor_statistics.py.

    cargo build -p graspmill-perception --example spoil_depth
    python lab/simulated_sensors.py REAL OUT [--spoil target/debug/examples/spoil_depth] [--scenes 3]

Boxes and cylinders stand where the capture's camera looked at its table. Needs the package `graspmill`.
"""
import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import graspmill

TABLE_Z_M, FAR_M = 0.05, 1.7
#: The kind of noise and, as in the captures, how many things of which size, and how far they stand from the middle.
KINDS = {"mosd": ("kinect", 2, (0.08, 0.28), 0.10), "d435": ("d435_real", 7, (0.02, 0.13), 0.20)}


def camera_of(row):
    """The capture's camera; the workspace's z is the table's normal, its middle where the camera looks."""
    fx, fy, cx, cy = row["fx_fy_cx_cy"]
    width_px, height_px = row["size"]
    z = np.array(row["table_normal"]) / np.linalg.norm(row["table_normal"])
    x = np.cross([0, 1, 0], z) if abs(z[0]) > 0.9 else np.array([1.0, 0, 0]) - z[0] * z
    x /= np.linalg.norm(x)
    looked_at = np.array([0, 0, -row["table_offset_m"] / z[2]])
    pose = np.eye(4)
    pose[:3, :3] = [x, np.cross(z, x), z]
    pose[:3, 3] = np.array([0.15, 0.15, TABLE_Z_M]) - pose[:3, :3] @ looked_at
    return graspmill.Camera(width_px, height_px, fx, fy, cx, cy, workspace_from_camera=pose)


def things(count, size_m, aside_m, draw):
    """Boxes and cylinders that stand on the table apart from each other."""
    placed = []
    while len(placed) < count:
        width_m, depth_m, height_m = draw.uniform(*size_m, 3)
        middle = np.array([0.15, 0.15]) + draw.uniform(-aside_m, aside_m, 2)
        turned = draw.uniform(0, np.pi)
        reach = 0.5 * np.hypot(width_m, depth_m)
        if any(np.linalg.norm(middle - other) < reach + other_reach for other, other_reach, _ in placed):
            # A large one may leave no room: again, a little smaller.
            placed.clear()
            size_m = (size_m[0], max(size_m[1] * 0.995, size_m[0]))
            continue
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]
        pose[:3, 3] = [*middle, TABLE_Z_M + 0.5 * height_m]
        shape = "cuboid" if draw.random() < 0.6 else "cylinder"
        extents = [width_m, depth_m if shape == "cuboid" else width_m, height_m]
        placed.append((middle, reach, graspmill.Object.solid(shape, extents, pose)))
    return [thing for _, _, thing in placed]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("real", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--spoil", type=Path, default=Path("target/debug/examples/spoil_depth"))
    parser.add_argument("--scenes", type=int, default=3, help="for each capture; tenfold for the one of a D435")
    parser.add_argument("--noise", help="this kind of noise for all")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    rows, number = [], 0
    for row in json.loads((asked.real / "captures.json").read_text()):
        family = row["name"].split("-")[0]
        if family not in KINDS:
            continue
        kind, count, size_m, aside_m = KINDS[family]
        for _ in range(asked.scenes if family == "mosd" else 10 * asked.scenes):
            number += 1
            camera = camera_of(row)
            objects = things(count, size_m, aside_m, np.random.default_rng(number))
            depth_m = graspmill.Scene(objects, table_z_m=TABLE_Z_M).render(camera)
            depth_m[depth_m > FAR_M] = 0
            words = [asked.noise or kind, camera.fx_px, camera.width_px, camera.height_px, number]
            command = [asked.spoil, *map(str, words)]
            spoiled = subprocess.run(command, input=depth_m.tobytes(), stdout=subprocess.PIPE, check=True).stdout
            tenths_mm = np.round(np.frombuffer(spoiled, np.float32).reshape(depth_m.shape) * 1e4).astype(np.uint16)
            name = f"{kind}-{number:03}"
            Image.fromarray(tenths_mm).save(asked.out / f"{name}-depth.png")
            # Things are bright, so that their outlines are found as those in the captures' colour.
            v, u = np.mgrid[: camera.height_px, : camera.width_px]
            x, y = (u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px
            rays = np.dstack([x, y, np.ones(depth_m.shape)])
            above = depth_m * (rays @ np.array(row["table_normal"])) + row["table_offset_m"] > 0.002
            Image.fromarray(np.where(above, 220, 60).astype(np.uint8)).save(asked.out / f"{name}-color.jpg", quality=95)
            rows.append(row | {"name": name, "sensor": kind.removesuffix("_real")})
    (asked.out / "captures.json").write_text(json.dumps(rows, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
