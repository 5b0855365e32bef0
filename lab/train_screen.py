#!/usr/bin/env python3
"""Trains models/screen.safetensors: the quick look that chooses the hands about which a judge is asked.

    pip install WHEEL torch && python lab/train_screen.py DATASET… --out models/screen.safetensors

The datasets are those of `graspmill pipeline any_jaw` (docs/judge.md): hands of many grippers with their outcomes. The
network sees distance and observed share at a few points of what the judge sees (network/src/judge/screen.rs has the same
places), and predicts whether a hand holds.
"""

import argparse
import time

import numpy as np
import torch
import torch.nn.functional as F
from graspmill import OUTCOMES
from graspmill.torch import GraspCropStream
from safetensors.torch import save_file
from torch import nn

#: Places of the points along x, y and z of the crop, and of its context.
POINTS = [0, 2, 5, 7], [1, 5, 9, 10, 14, 18], [3, 7, 11, 15, 17, 19, 21, 23, 25, 27]
CONTEXT_POINTS = [1, 4, 7, 10], [1, 3, 4, 6], [1, 3, 4, 6]
HELD = OUTCOMES.index("held")
BATCH, LEARNING_RATE = 1024, 2e-3


def seen(boxes: torch.Tensor, places: tuple[list[int], list[int], list[int]]) -> torch.Tensor:
    """Distance and share at some places of ``[B, C, X, Y, Z]``, as ``[B, 2 · points]``: x slowest, values fastest."""
    x, y, z = (torch.tensor(along) for along in places)
    return boxes[:, :2, x[:, None, None], y[:, None], z].permute(0, 2, 3, 4, 1).flatten(1)


def rows(folders: list[str], split: str, most: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Inputs ``[N, 624]`` in half precision, and whether the hands held; at most so many of each dataset."""
    inputs, labels = [], []
    for folder in folders:
        count, began = 0, time.time()
        for batch in GraspCropStream(folder, split, batch=256, by="scene", test_share=0.05, other_share=0.02):
            is_open = ~batch["hits_table"]
            row = [seen(batch["crop"], POINTS), seen(batch["context"], CONTEXT_POINTS), batch["features"]]
            inputs.append(torch.cat(row, 1)[is_open].half())
            labels.append((batch["outcome"] == HELD)[is_open].float())
            count += len(labels[-1])
            if count >= most:
                break
        print(f"{folder}: {count} hands of {split} in {time.time() - began:.0f} s", flush=True)
    return torch.cat(inputs), torch.cat(labels)


def average_precision(score: np.ndarray, label: np.ndarray) -> float:
    label = label[np.argsort(-score)]
    return float((label * np.cumsum(label) / np.arange(1, len(label) + 1)).sum() / label.sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+")
    parser.add_argument("--out", required=True)
    parser.add_argument("--hands", type=int, default=300_000, help="at most so many of each dataset")
    parser.add_argument("--epochs", type=int, default=8)
    arguments = parser.parse_args()
    torch.manual_seed(1)
    inputs, labels = rows(arguments.datasets, "train", arguments.hands)
    tests = [(folder, *rows([folder], "test-scenes", 20_000)) for folder in arguments.datasets]
    net = nn.Sequential(nn.Linear(inputs.shape[1], 64), nn.ReLU(), nn.Linear(64, 32), nn.ReLU(), nn.Linear(32, 1))
    adam = torch.optim.Adam(net.parameters(), LEARNING_RATE)
    steps = len(inputs) // BATCH
    rate = torch.optim.lr_scheduler.CosineAnnealingLR(adam, arguments.epochs * steps)
    for epoch in range(arguments.epochs):
        order = torch.randperm(len(inputs))
        for step in range(steps):
            taken = order[step * BATCH :][:BATCH]
            loss = F.binary_cross_entropy_with_logits(net(inputs[taken].float())[:, 0], labels[taken])
            adam.zero_grad()
            loss.backward()
            adam.step()
            rate.step()
        with torch.no_grad():
            scored = [(folder, net(rows.float())[:, 0].numpy(), held.numpy()) for folder, rows, held in tests]
        told = (f"{average_precision(score, held):.4f} of {folder}" for folder, score, held in scored)
        print(f"epoch {epoch + 1}: average precision in unseen scenes {', '.join(told)}", flush=True)
    layers = {"screen1": net[0], "screen2": net[2], "screen3": net[4]}
    weights = {f"{name}.weight": layer.weight.data[:, :, None, None, None].contiguous() for name, layer in layers.items()}
    save_file({**weights, **{f"{name}.bias": layer.bias.data.contiguous() for name, layer in layers.items()}}, arguments.out)


if __name__ == "__main__":
    main()
