#!/usr/bin/env python3
"""Writes the golden tensors for comparing trainer/ with PyTorch.

    python3 -m venv venv && venv/bin/pip install -r scripts/requirements-golden.txt
    venv/bin/python lab/golden_torch.py            # writes trainer/tests/golden/{linear,nearest}.safetensors

Made with torch 2.15.0, numpy and safetensors as pinned in requirements-golden.txt; about two minutes on two cores.

The network is VGN's ConvNet (networks.py), the loss VGN's (train_vgn.py), reimplemented here. Weights and grids are
not stored: both sides compute them from `noise`, an integer hash. The files contain the targets, and samples of the forward
outputs, losses, gradients and parameters after ten steps of Adam. trainer/tests/parity.rs reads them.
"""

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from golden_formula import LAYERS, noise
from safetensors.numpy import save_file

GRIDS = 3
ENTRIES = 64
STEPS = 10
WIDTH_WEIGHT = 0.01
LEARNING_RATE = 3e-4
# Corners, faces, edges, interior; in the order of their grids.
VOXELS = [
    (0, (0, 0, 0)), (0, (39, 39, 39)), (0, (0, 39, 0)), (0, (39, 0, 39)),
    (1, (0, 20, 13)), (1, (39, 7, 22)), (1, (18, 0, 39)), (1, (1, 38, 2)),
    (2, (20, 20, 20)), (2, (11, 26, 33)), (2, (25, 12, 9)), (2, (16, 37, 3)),
]
LABELS = [1, 0, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0]


def parameters() -> dict[str, torch.Tensor]:
    """Weights U(-b, b), b = sqrt(6 / fan_in), so that signals neither vanish nor explode; biases the same."""
    made = {}
    for number, (name, c_in, c_out, k, _) in enumerate(LAYERS):
        bound = np.sqrt(6.0 / (k**3 * c_in))
        for part, shape in (("weight", (c_out, c_in, k, k, k)), ("bias", (c_out,))):
            seed = 2 * number + (part == "bias")
            values = (2.0 * noise(int(np.prod(shape)), seed) - 1.0) * bound
            tensor = torch.from_numpy(values.astype(np.float32)).reshape(shape)
            made[f"{name}.{part}"] = tensor.requires_grad_()
    return made


def grid(number: int) -> np.ndarray:
    """A quarter of the voxels hold a value in [0, 1), the others 0."""
    value, there = noise(40**3, 100 + number), noise(40**3, 200 + number)
    return np.where(there < 0.25, value, 0.0).astype(np.float32).reshape(40, 40, 40)


def forward(p, x, mode):
    def conv(x, name, k, stride=1):
        return F.conv3d(x, p[f"{name}.weight"], p[f"{name}.bias"], stride=stride, padding=k // 2)

    def up(x, size):
        return F.interpolate(x, size, mode="trilinear", align_corners=False) if mode == "linear" else F.interpolate(x, size)

    for name, _, _, k, stride in LAYERS[:3]:
        x = F.relu(conv(x, name, k, stride))
    x = up(F.relu(conv(x, "decoder.conv1", 3)), 10)
    x = up(F.relu(conv(x, "decoder.conv2", 3)), 20)
    x = up(F.relu(conv(x, "decoder.conv3", 5)), 40)
    return torch.sigmoid(conv(x, "conv_qual", 5)), F.normalize(conv(x, "conv_rot", 5), dim=1), conv(x, "conv_width", 5)


def targets():
    rotation = 2.0 * noise(4 * len(VOXELS), 300).reshape(-1, 4) - 1.0
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    width = 2.0 + 8.0 * noise(len(VOXELS), 301)
    return rotation.astype(np.float32), width.astype(np.float32)


def half_turn(rotation):
    x, y, z, w = rotation.T
    return np.stack([y, -x, w, -z], axis=1)  # r * (0, 0, 1, 0)


def losses(p, grids, mode, rotation, width):
    quality_map, rotation_map, width_map = forward(p, grids, mode)
    g = torch.tensor([at for at, _ in VOXELS])
    i, j, k = torch.tensor([voxel for _, voxel in VOXELS]).T
    label = torch.tensor(LABELS, dtype=torch.float32)
    quality = F.binary_cross_entropy(quality_map[g, 0, i, j, k], label, reduction="none")
    predicted = rotation_map[g, :, i, j, k]
    apart = [1.0 - (predicted * torch.from_numpy(r)).sum(1).abs() for r in (rotation, half_turn(rotation))]
    turn = label * torch.min(*apart)
    squared = label * (width_map[g, 0, i, j, k] - torch.from_numpy(width)) ** 2
    return quality + turn + WIDTH_WEIGHT * squared, quality, turn, squared


def entries(tensor: torch.Tensor, seed: int) -> np.ndarray:
    flat = tensor.detach().reshape(-1)
    at = (noise(ENTRIES, seed) * flat.numel()).astype(np.int64)
    return flat[torch.from_numpy(at)].numpy().copy()


def golden(mode: str) -> dict[str, np.ndarray]:
    out = {}
    p = parameters()
    grids = torch.from_numpy(np.stack([grid(number) for number in range(GRIDS)]))[:, None]
    rotation, width = targets()
    out["targets.grid"] = np.array([at for at, _ in VOXELS], dtype=np.int64)
    out["targets.voxel"] = np.array([voxel for _, voxel in VOXELS], dtype=np.int64)
    out["targets.label"] = np.array(LABELS, dtype=np.int64)
    out["targets.rotation"], out["targets.width"] = rotation, width

    with torch.no_grad():
        for number, (name, volume) in enumerate(zip(("quality", "rotation", "width"), forward(p, grids, mode))):
            out[f"forward.{name}"] = entries(volume, 400 + number)
            out[f"forward.{name}.norm"] = np.array([volume.double().norm().item()], dtype=np.float32)

    optimiser = torch.optim.Adam(p.values(), lr=LEARNING_RATE)
    steps = []
    for step in range(STEPS):
        optimiser.zero_grad()
        parts = losses(p, grids, mode, rotation, width)
        loss = parts[0].mean()
        loss.backward()
        if step == 0:
            for name, values in zip(("total", "quality", "rotation", "width"), parts):
                out[f"loss.{name}"] = values.detach().numpy().copy()
            for number, (name, tensor) in enumerate(p.items()):
                out[f"gradient.{name}"] = entries(tensor.grad, 500 + number)
                out[f"gradient.{name}.norm"] = np.array([tensor.grad.double().norm().item()], dtype=np.float32)
        optimiser.step()
        steps.append(loss.item())
    out["adam.losses"] = np.array(steps, dtype=np.float32)
    for number, (name, tensor) in enumerate(p.items()):
        out[f"adam.{name}"] = entries(tensor, 600 + number)
        out[f"adam.{name}.norm"] = np.array([tensor.detach().double().norm().item()], dtype=np.float32)
    return out


def main():
    folder = Path(__file__).resolve().parent.parent / "trainer" / "tests" / "golden"
    folder.mkdir(parents=True, exist_ok=True)
    for mode in ("linear", "nearest"):
        tensors = golden(mode)
        save_file(tensors, folder / f"{mode}.safetensors", metadata={"torch": torch.__version__, "upsampling": mode})
        print(mode, "losses:", " ".join(f"{value:.4f}" for value in tensors["adam.losses"]))


if __name__ == "__main__":
    main()
