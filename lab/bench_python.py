#!/usr/bin/env python3
"""Measures the Python package that is installed, and prints a table for docs/results.

    pip install graspmill-….whl torch && python lab/bench_python.py [--scratch DIR]

Makes 12,000 attempts of the paper's config in a scratch folder. On cores without other work it takes about three minutes.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

import graspmill
import numpy as np

GRASPMILL = [sys.executable, "-m", "graspmill"]


def seconds(work, times: int = 1) -> float:
    """The shortest of some runs."""
    spent = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        spent.append(time.perf_counter() - began)
    return min(spent)


def row(what: str, value: str) -> None:
    print(f"| {what} | {value} |", flush=True)


def imports() -> None:
    code = "import time, numpy; b = time.perf_counter(); import graspmill; print(time.perf_counter() - b)"
    spent = min(float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in range(7))
    row("`import graspmill`, beside NumPy's", f"{1e3 * spent:.0f} ms")


def oracle(dataset) -> None:
    scenes = [(stored.scene, stored.workspace_from_grasp, stored.outcomes.target) for stored in dataset]

    def all_scenes(threads=None):
        for scene, grasps, targets in scenes:
            graspmill.execute(scene, grasps, targets=targets, threads=threads)

    ours = dataset.attempt_count / seconds(all_scenes, 5)
    repeat = [*GRASPMILL, "generator", "repeat", dataset._native.location]
    start = seconds(lambda: subprocess.run([*repeat, "--scenes", "1"], check=True, capture_output=True), 3)
    whole = seconds(lambda: subprocess.run(repeat, check=True, capture_output=True), 5)
    theirs = dataset.attempt_count / (whole - start)
    rates = f"{ours:,.0f}/s; {theirs:,.0f}/s; {100 * ours / theirs:.0f} %"
    row("`execute`, 60 grasps a call; `graspmill dataset repeat` on the same attempts, without its start", rates)

    one = seconds(lambda: all_scenes(1), 3)

    def two():
        threads = [threading.Thread(target=all_scenes, args=(1,)) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    row("two Python threads with `threads=1` each, over one", f"{2 * one / seconds(two, 3):.2f} times as many")
    scene, grasps, _ = scenes[0]
    grasp, before = grasps[:1], resident_mb()
    calls = 1_000_000

    def call():
        for _ in range(calls):
            graspmill.execute(scene, grasp, threads=1)

    spent = seconds(call)
    row(f"{calls:,} calls with one grasp: memory before and after", f"{before:.0f} and {resident_mb():.0f} MB; {1e6 * spent / calls:.0f} µs a call")


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def loader(dataset) -> None:
    import torch
    from graspmill.torch import GraspStream, GraspCropStream

    for workers in (0, 2):
        crops = GraspCropStream(dataset, "train", batch=256)
        loaded = torch.utils.data.DataLoader(crops, batch_size=None, num_workers=workers)
        spent = seconds(lambda: sum(len(batch["label"]) for batch in loaded), 3)
        row(f"`GraspCropStream`, {workers} workers", f"{crops.sample_count / spent:,.0f} grasps/s")
    for samples_per_scene in (8, 60):
        for workers in (0, 2):
            stream = GraspStream(dataset, "train", batch=240, samples_per_scene=samples_per_scene)
            batches = torch.utils.data.DataLoader(stream, batch_size=None, num_workers=workers)

            def epoch():
                count = sum(len(batch["label"]) for batch in batches)
                assert count == stream.sample_count

            rate = stream.sample_count / seconds(epoch, 3)
            row(f"`DataLoader`, at most {samples_per_scene} samples of a scene together, {workers} workers", f"{rate:,.0f} samples/s")


def plans(dataset, scratch: Path) -> None:
    planner, stored = graspmill.Planner(), dataset[0]
    images = [stored.scene.render(camera) for camera in stored.cameras]
    spent = [seconds(lambda: planner.plan(images, stored.cameras)) for _ in range(30)]
    row(f"a plan from {len(images)} images in this process, median of 30", f"{1e3 * float(np.median(spent)):.1f} ms")
    port = 18_040
    served = subprocess.Popen([*GRASPMILL, "planner", "serve", "--port", str(port)], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        import base64
        import io

        def encoded(image):
            file = io.BytesIO()
            np.save(file, image)
            return {"data": base64.b64encode(file.getvalue()).decode()}

        views = [
            {"depth": encoded(image), "workspace_from_camera": camera.workspace_from_camera.tolist()}
            for image, camera in zip(images, stored.cameras)
        ]
        lens = dict(zip(("fx_px", "fy_px", "cx_px", "cy_px"), stored.cameras[0]._intrinsics()[2:]))
        body = json.dumps({"views": views, "intrinsics": lens}).encode()
        request = urllib.request.Request(f"http://127.0.0.1:{port}/v1/plan", body, {"Content-Type": "application/json"})

        def ask():
            with urllib.request.urlopen(request, timeout=30) as answer:
                return answer.read()

        for _ in range(100):
            try:
                ask()
                break
            except urllib.error.URLError:
                time.sleep(0.1)
        spent = [seconds(ask) for _ in range(30)]
        row(f"the same over HTTP, images as NPY in base64 ({len(body) / 1e6:.1f} MB)", f"{1e3 * float(np.median(spent)):.1f} ms")
    finally:
        served.terminate()
        served.wait()


def workspaces() -> None:
    """Five objects on every 0.3 m square, seen from three sides; of each scene the hand that the planner has first."""
    planner, turns = graspmill.Planner(), (0.3, 2.4, 4.5)
    for side in (0.30, 0.45, 0.60):
        rng, held, spent = np.random.default_rng(7502), [], []
        for _ in range(100):
            scene = scattered(rng, side)
            middle, away = 0.5 * side, 0.8 * side
            eyes = [(middle + away * np.cos(turn), middle + away * np.sin(turn), 0.05 + 1.2 * side) for turn in turns]
            cameras = [graspmill.Camera.look_at(eye, (middle, middle, 0.05), focal_px=480.0) for eye in eyes]
            images = [scene.render(camera) for camera in cameras]
            began = time.perf_counter()
            plan = planner.plan(images, cameras, workspace_size_m=side)
            spent.append(time.perf_counter() - began)
            held.append(len(plan) > 0 and bool(graspmill.execute(scene, plan.workspace_from_grasp[:1]).held[0]))
        row(f"a workspace of {side:.2f} m, 100 scenes: the first hand held; median of a plan", f"{sum(held)}; {1e3 * np.median(spent):.0f} ms")


def scattered(rng: np.random.Generator, side: float) -> graspmill.Scene:
    """Primitive shapes that stand apart from each other."""
    kinds = ("cuboid", "cylinder", "tri_prism", "half_cylinder")
    line = np.arange(0.06, side - 0.05, 0.09)
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    places = rng.permutation(places)[: round(5 * (side / 0.3) ** 2)] + rng.uniform(-0.01, 0.01, 2)
    things = []
    for x, y in places:
        size, yaw, kind = rng.uniform(0.03, 0.06, 3), rng.uniform(0.0, 2.0 * np.pi), kinds[rng.integers(len(kinds))]
        if kind == "cylinder":
            size[1] = size[0]
        if kind == "half_cylinder":
            size[2] = 0.5 * size[1]
        pose = (x, y, 0.0505 + 0.5 * size[2], 0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw))
        things.append(graspmill.Object.solid(kind, size, pose))
    return graspmill.Scene(things)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scratch", type=Path)
    arguments = parser.parse_args()
    scratch = arguments.scratch or Path(tempfile.mkdtemp())
    dataset = graspmill.generate(scratch / "bench", shards=4, attempts=12_000, seed=7501)
    print("| what | measured |\n|---|---:|")
    imports()
    oracle(dataset)
    plans(dataset, scratch)
    workspaces()
    loader(dataset)
    return 0


if __name__ == "__main__":
    sys.exit(main())
