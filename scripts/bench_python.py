#!/usr/bin/env python3
"""Measures the Python package that is installed, and prints a table for docs/results.

    pip install graspmill-….whl torch && python scripts/bench_python.py [--scratch DIR]

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
    row("`execute`, 60 grasps a call; `generator repeat` on the same attempts, without its start", rates)

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
    from graspmill.torch import GraspStream

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
        lens = dict(zip(("fx_px", "fy_px", "cx_px", "cy_px"), stored.cameras[0].lens()[2:]))
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scratch", type=Path)
    arguments = parser.parse_args()
    scratch = arguments.scratch or Path(tempfile.mkdtemp())
    dataset = graspmill.generate(None, scratch / "bench", shards=4, attempts=12_000, seed=7501)
    print("| what | measured |\n|---|---:|")
    imports()
    oracle(dataset)
    plans(dataset, scratch)
    loader(dataset)
    return 0


if __name__ == "__main__":
    sys.exit(main())
