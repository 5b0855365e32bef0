#!/usr/bin/env python3
"""Times the planners of VGN and GIGA against ours, from the same depth images to ranked grasps on the same cores.

    python -W ignore lab/peer_planners.py --giga DIR --vgn DIR [--out JSON]

DIR are checkouts of github.com/UT-Austin-RPL/GIGA (c7a98b4) and github.com/ethz-asl/vgn (branch corl2020, d7af062); their code is
imported, not changed. Needs a release build of the package (`pip install .`; that of scripts/test.sh is slower), torch, safetensors,
open3d or open3d-cpu, numpy<1.25 and scipy<1.13: VGN assigns arrays of one number to voxels, at which newer NumPy warns, or fails.

Images: the first look at each scene of configs/experiment/giga-pile.toml, one noisy side view of five objects. A plan of theirs is a
new TSDFVolume, `integrate`, and a call of the planner, all by their code, with the arguments of their experiments (for GIGA --best
--force, out_th 0.1). GIGA's finer volume for point clouds is left out, because its planner never reads it. They time `integrate` and
what follows `get_grid`, but not `get_grid` itself: that is the column "on their clock".

Weights: VGN's own (models/vgn.safetensors has the same numbers). GIGA's are not in its repository. Without --giga-weights FILE its
network has random ones, which take the same arithmetic. What is done after it depends on how many grasps are left: constants in giga()
scale and shift the quality (before the sigmoid) such that they are about as many as VGN's, and make the openings valid.

What stands in for modules that planning never calls: vgn.vis (ROS) of VGN; torchvision, trimesh, vgn.utils.visual, vgn.utils.implicit,
and ConvONets' config, data, training and generation of GIGA. Where torch-scatter is missing, its mean is computed by the same calls of torch.

Each planner has a process. They take turns in an order that changes, after a pause in which the last one's threads fall asleep: --row
images in a row, of which the first is planned once before, uncounted. With --row 1 all plans begin cold, after 0.2 to 0.5 s of others.
"""

import argparse
import importlib.util
import json
import multiprocessing
import os
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import graspmill
import numpy as np
import torch
from graspmill.torch import VoxelNetwork

ROOT = Path(__file__).resolve().parents[1]
PAUSE_S, WARM_UP = 0.05, 3
COLUMNS = ("on their clock", "integrate", "get_grid", "network", "select", "grasps")


def looks(count: int, seed: int) -> list:
    """Depth image and camera of the first look at each scene. No grasps are an answer, which ends the round."""

    def planner(look):
        seen.append((look.depths[0], look.cameras[0]))
        return np.zeros((0, 7)), np.zeros(0)

    seen = []
    with tempfile.TemporaryDirectory() as folder:
        graspmill.experiment(folder, ROOT / "configs/experiment/giga-pile.toml", planner=planner, rounds=count, seed=seed)
    return seen


def ours(config: str, cores: int):
    def plan(depth, camera):
        began = time.perf_counter()
        grasps = planner.plan(depth, camera)
        return {"total": time.perf_counter() - began, "grasps": len(grasps)}

    planner = graspmill.Planner(config, threads=cores)
    return plan


def theirs(planner, module):
    """Plans of VGN or GIGA, whose `vgn` is imported; the call of the network in their module is timed, too."""
    from vgn.perception import CameraIntrinsic, TSDFVolume
    from vgn.utils.transform import Transform

    def timed(*arguments):
        nonlocal network
        began = time.perf_counter()
        answer = predict(*arguments)
        network = time.perf_counter() - began
        return answer

    def plan(depth, camera):
        lens = CameraIntrinsic(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
        camera_from_workspace = Transform.from_matrix(np.linalg.inv(camera.workspace_from_camera))
        began = time.perf_counter()
        tsdf = TSDFVolume(0.3, 40)
        tsdf.integrate(depth, lens, camera_from_workspace)
        integrate = time.perf_counter() - began
        grasps, _, clock = planner(SimpleNamespace(tsdf=tsdf))
        total = time.perf_counter() - began
        parts = (integrate + clock, integrate, total - integrate - clock, network, clock - network, len(grasps))
        return {"total": total, **dict(zip(COLUMNS, parts))}

    predict, network, module.predict = module.predict, 0.0, timed
    return plan


def vgn(checkout: Path):
    sys.path.insert(0, str(checkout / "src"))
    sys.modules["vgn.vis"] = MagicMock()
    from vgn import detection

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "vgn_conv.pth"
        torch.save(VoxelNetwork.load(ROOT / "models/vgn.safetensors").state_dict(), file)
        return theirs(detection.VGN(file), detection)


def giga(checkout: Path, weights: Path | None):
    def scatter_mean(source, index, out):
        out.scatter_add_(-1, index.expand_as(source), source)
        count = torch.zeros_like(out[:, :1]).scatter_add_(-1, index, torch.ones_like(source[:, :1]))
        return out.true_divide_(count.clamp_(min=1))

    sys.path.insert(0, str(checkout / "src"))
    unused = ("config", "data", "conv_onet.training", "conv_onet.generation")
    for name in ("torchvision", "trimesh", "vgn.utils.visual", "vgn.utils.implicit", *(f"vgn.ConvONets.{name}" for name in unused)):
        sys.modules[name] = MagicMock()
    if importlib.util.find_spec("torch_scatter") is None:
        sys.modules["torch_scatter"] = MagicMock(scatter_mean=scatter_mean)
    from vgn import detection_implicit, networks

    with tempfile.TemporaryDirectory() as folder, torch.no_grad():
        file = weights or Path(folder) / "giga.pt"
        if weights is None:
            torch.manual_seed(1)
            net = networks.get_network("giga")
            quality, opening = net.decoder_qual.fc_out, net.decoder_width.fc_out
            for part, value in ((quality.weight, 93.0 * quality.weight), (quality.bias, 18.9), (opening.weight, 0.0), (opening.bias, 0.1)):
                part[...] = value
            torch.save(net.state_dict(), file)
        planner = detection_implicit.VGNImplicit(file, "giga", best=True, force_detection=True, out_th=0.1)
    return theirs(planner, detection_implicit)


def work(make, cores: int, seen: list, pipe) -> None:
    """A planner's process: plans from the images whose numbers it is sent."""
    torch.set_num_threads(cores)
    os.dup2(2, 1)  # what they print
    plan = make()
    for look in seen[:WARM_UP]:
        plan(*look)
    pipe.send(None)
    while (number := pipe.recv()) is not None:
        pipe.send(plan(*seen[number]))


def race(makers: dict, cores: int, seen: list, row: int) -> dict[str, list[dict]]:
    """What each planner took for each image, of which it is given so many in a row."""
    context, pipes, names = multiprocessing.get_context("spawn"), {}, list(makers)
    for name, make in makers.items():
        pipes[name], far = context.Pipe()
        context.Process(target=work, args=(make, cores, seen, far), daemon=True).start()
        pipes[name].recv()
    plans = {name: [] for name in makers}
    for turn, start in enumerate(range(0, len(seen), row)):
        first = turn % len(names)
        for name in names[first:] + names[:first]:
            time.sleep(PAUSE_S)
            numbers = list(range(start, min(start + row, len(seen))))
            for place, number in enumerate(numbers[:1] + numbers if row > 1 else numbers):
                pipes[name].send(number)
                took = pipes[name].recv()
                plans[name] += [took] if row == 1 or place else []
    for name in names:
        pipes[name].send(None)
    return plans


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    numbers = (("plans", int, 60), ("row", int, 10), ("seed", int, 9981))
    for name, kind, default in (("giga-weights", Path, None), ("out", Path, None), *numbers):
        parser.add_argument(f"--{name}", type=kind, default=default)
    for name in ("--giga", "--vgn"):
        parser.add_argument(name, type=Path, required=True)
    given = parser.parse_args()
    all_cores, load, found = sorted(os.sched_getaffinity(0)), os.getloadavg(), {}
    seen = looks(given.plans, given.seed)
    print(f"load before {load[0]:.2f}; medians in ms\n\n| planner | cores | all (nine of ten) | times ours | {' | '.join(COLUMNS)} |")
    print(f"|---|{'---:|' * (3 + len(COLUMNS))}")
    for cores in sorted({min(2, len(all_cores)), 1}, reverse=True):
        os.sched_setaffinity(0, all_cores[:cores])
        os.environ["OMP_NUM_THREADS"] = str(cores)  # of Open3D
        makers = {"ours, judge": partial(ours, "judge", cores), "ours, VGN's network": partial(ours, "vgn", cores)}
        makers |= {"VGN": partial(vgn, given.vgn), "GIGA": partial(giga, given.giga, given.giga_weights)}
        found[cores], than = race(makers, cores, seen, given.row), None
        for name, plans in found[cores].items():
            values = {key: np.array([plan[key] for plan in plans]) * (1 if key == "grasps" else 1e3) for key in plans[0]}
            cells = [f"{np.median(values[key]):.{0 if key == 'grasps' else 1}f}" if key in values else "" for key in COLUMNS]
            median, most = np.quantile(values["total"], (0.5, 0.9))
            than = than or median
            print(f"| {name} | {cores} | {median:.1f} ({most:.1f}) | {median / than:.1f} | {' | '.join(cells)} |", flush=True)
    if given.out:
        facts = {"seed": given.seed, "loads": (load, os.getloadavg()), "giga weights": "given" if given.giga_weights else "random"}
        given.out.write_text(json.dumps({**facts, "plans by cores": found}, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
