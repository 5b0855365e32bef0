#!/usr/bin/env python3
"""Times a training step in PyTorch and in Graspmill, in one run.

    cargo build --release -p trainer --features flex    # with Burn, to compare
    python3 -m venv venv && venv/bin/pip install -r scripts/requirements-golden.txt
    venv/bin/python scripts/bench_training.py target/release/trainer [target/debug/trainer]

PyTorch runs three kinds of steps: as in VGN's train_vgn.py (the whole volume with one supervised voxel), the same with
channels-last memory, and a step on the receptive field of the supervised voxel (the whole encoder; decoder and heads on
gathered patches). Network, batch, loss and optimiser are the same; the data are noise.
"""

import argparse
import json
import os
import subprocess
import time

import torch
import torch.nn.functional as F
from golden_torch import parameters

BATCH = 48


def volume_step(p, grids, voxels, label):
    """One step of the dense network; seconds."""

    def conv(x, name, k, stride=1):
        return F.conv3d(x, p[f"{name}.weight"], p[f"{name}.bias"], stride=stride, padding=k // 2)

    def up(x, size):
        return F.interpolate(x, size, mode="trilinear", align_corners=False)

    start = time.perf_counter()
    x = grids
    for name, k in (("encoder.conv1", 5), ("encoder.conv2", 3), ("encoder.conv3", 3)):
        x = F.relu(conv(x, name, k, 2))
    x = up(F.relu(conv(x, "decoder.conv1", 3)), 10)
    x = up(F.relu(conv(x, "decoder.conv2", 3)), 20)
    x = up(F.relu(conv(x, "decoder.conv3", 5)), 40)
    at = (torch.arange(len(grids)), slice(None), *voxels.T)
    out = [conv(x, name, 5)[at] for name in ("conv_qual", "conv_rot", "conv_width")]
    return finish(p, out, label, start)


def finish(p, out, label, start):
    """Loss, gradient and Adam on the heads' outputs."""
    quality, rotation, width = out
    loss = F.binary_cross_entropy_with_logits(quality[:, 0], label)
    loss = loss + (label * (1 - F.normalize(rotation, dim=1)[:, 0].abs()) + 0.01 * label * (width[:, 0] - 5) ** 2).mean()
    loss.backward()
    p["optimiser"].step()
    p["optimiser"].zero_grad()
    return time.perf_counter() - start


def window(first, size, n):
    """Rows of the doubling matrix of an axis with n coarse positions; those outside are zero (B, size, n)."""
    fine = first[:, None] + torch.arange(size)
    source = (fine / 2 - 0.25).clamp(0, n - 1)
    low = source.floor().long()
    share = source - low
    eye = torch.eye(n)
    rows = eye[low] * (1 - share)[..., None] + eye[(low + 1).clamp(max=n - 1)] * share[..., None]
    return rows * ((fine >= 0) & (fine < 2 * n))[..., None]


def patch_step(p, grids, voxels, label):
    """One step on receptive fields; seconds. The coarse positions of a patch begin where its fine ones require."""
    start = time.perf_counter()
    x = grids
    for name, k in (("encoder.conv1", 5), ("encoder.conv2", 3), ("encoder.conv3", 3)):
        x = F.relu(F.conv3d(x, p[f"{name}.weight"], p[f"{name}.bias"], stride=2, padding=k // 2))
    x = F.relu(F.conv3d(x, p["decoder.conv1.weight"], p["decoder.conv1.bias"], padding=1))
    heads = voxels - 2
    conv3_out = torch.div(heads - 1, 2, rounding_mode="floor")
    conv3_in = conv3_out - 2
    conv2_out = torch.div(conv3_in - 1, 2, rounding_mode="floor")
    conv2_in = conv2_out - 1
    stages = [
        (conv2_in, 8, torch.zeros_like(voxels), 5, 5, "decoder.conv2"),
        (conv3_in, 8, conv2_out, 6, 10, "decoder.conv3"),
        (heads, 5, conv3_out, 4, 20, None),
    ]
    for fine, size, coarse, width, n, name in stages:
        matrices = []
        for axis in range(3):
            rows = window(fine[:, axis], size, n)
            columns = coarse[:, axis, None] + torch.arange(width)
            inside = (columns >= 0) & (columns < n)
            taken = rows.gather(2, columns.clamp(0, n - 1)[:, None].expand(-1, size, -1))
            matrices.append(taken * inside[:, None])
        x = torch.einsum("bcxyz,bix,bjy,bkz->bcijk", x, *matrices)
        if name:
            x = F.relu(F.conv3d(x, p[f"{name}.weight"], p[f"{name}.bias"]))
    out = [F.conv3d(x, p[f"{name}.weight"], p[f"{name}.bias"]).flatten(1) for name in ("conv_qual", "conv_rot", "conv_width")]
    return finish(p, out, label, start)


def with_layout(layout):
    """Fresh parameters, weights laid out so, and their optimiser."""
    p = {}
    for name, value in parameters().items():
        p[name] = (value.detach().contiguous(memory_format=layout) if value.dim() == 5 else value.detach()).requires_grad_()
    p["optimiser"] = torch.optim.Adam(list(p.values()), lr=3e-4)
    return p


def median(times):
    return sorted(times)[len(times) // 2]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trainer", nargs="+", help="trainer programs, such as one of each profile")
    parser.add_argument("--times", type=int, default=3, help="dense steps of each kind [default: 3]")
    args = parser.parse_args()
    torch.manual_seed(0)
    p = with_layout(torch.contiguous_format)
    grids, voxels = torch.rand(BATCH, 1, 40, 40, 40), torch.randint(0, 40, (BATCH, 3))
    label = (torch.arange(BATCH) % 4 == 0).float()
    threads = os.cpu_count()

    def timed(count, step, p=p):
        step(p, grids, voxels, label)
        return median([step(p, grids, voxels, label) for _ in range(count)])

    torch.set_num_threads(1)
    rows = [("PyTorch, receptive field, 1 thread", timed(7, patch_step))]
    torch.set_num_threads(threads)
    rows.append((f"PyTorch, receptive field, {threads} threads", timed(7, patch_step)))
    rows.append((f"PyTorch, dense, {threads} threads", timed(args.times, volume_step)))
    rows.append((f"PyTorch, dense, channels last, {threads} threads", timed(args.times, volume_step, with_layout(torch.channels_last_3d))))
    dense_s = rows[-2][1]
    shares = []
    for trainer in args.trainer:
        done = subprocess.run([trainer, "bench", "--json"], capture_output=True, text=True, check=True)
        ours = json.loads(done.stdout)
        name = f"Graspmill, {ours['profile']} build"
        rows.append((f"{name}, {ours['threads']} threads", ours["step_s"]))
        if ours["matmul_mac_per_s"] is None:
            shares.append(f"{name}: Burn is not built in (cargo feature flex), so there is no rate to compare with.")
            continue
        rows.append((f"{name}, by automatic differentiation", ours["step_by_graph_s"]))
        rate, step = ours["matmul_mac_per_s"] / 1e9, ours["step_mac"] / ours["step_s"] / 1e9
        shares.append(f"{name}: {step:.1f} GMAC/s, {100 * step / rate:.0f} % of Burn's products of matrices, {rate:.1f} GMAC/s.")
    print(f"torch {torch.__version__}, batch of {BATCH}, every sample of another scene\n")
    print("| training step | ms | times PyTorch's dense step |\n|---|---:|---:|")
    for name, seconds in rows:
        print(f"| {name} | {1e3 * seconds:.0f} | {dense_s / seconds:.1f} |")
    print("\n" + "\n".join(shares))


if __name__ == "__main__":
    main()
