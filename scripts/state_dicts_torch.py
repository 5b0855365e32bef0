#!/usr/bin/env python3
"""Writes state dicts with torch.save for testing `trainer import` against PyTorch.

    python3 -m venv venv && venv/bin/pip install -r scripts/requirements-golden.txt
    venv/bin/python scripts/state_dicts_torch.py       # writes network/tests/state_dicts/*.pth

Made with torch 2.15.0. To keep the files small, all tensors of a file are strided windows of few storages, which contain
`noise` (golden_torch.py): value [i, j, ...] of tensor number t is number `OFFSET * t + i * strides[0] + ...` of its storage.
trainer/tests/network/state_dicts.rs computes the same values. The keys of storages in legacy.pth are addresses, so that file
differs each time.
"""

from collections import OrderedDict
from pathlib import Path

import numpy as np
import torch
from golden_formula import LAYERS, noise

NUMBERS = 2048
OFFSET = 11
STRIDES = {"weight": (13, 5, 3, 2, 1), "bias": (29,)}


def storage(seed: int, dtype: torch.dtype) -> torch.Tensor:
    """2048 numbers in [-0.5, 0.5); all of them float32 numbers before they are converted."""
    return torch.from_numpy((noise(NUMBERS, seed) - 0.5).astype(np.float32)).to(dtype)


def state_dict(weights: torch.Tensor, biases: torch.Tensor) -> OrderedDict:
    made = OrderedDict()
    for number, (name, c_in, c_out, k, _) in enumerate(LAYERS):
        for part, source, shape in (("weight", weights, (c_out, c_in, k, k, k)), ("bias", biases, (c_out,))):
            at = OFFSET * (2 * number + (part == "bias"))
            made[f"{name}.{part}"] = source.as_strided(shape, STRIDES[part], at)
    made._metadata = OrderedDict({"": {"version": 1}})  # as Module.state_dict has it
    return made


def main():
    folder = Path(__file__).resolve().parent.parent / "network" / "tests" / "state_dicts"
    folder.mkdir(parents=True, exist_ok=True)
    shared = storage(700, torch.float32)
    plain = state_dict(shared, shared)
    torch.save(plain, folder / "zip.pth")
    torch.save(plain, folder / "legacy.pth", _use_new_zipfile_serialization=False)

    # A training script's: DataParallel's names, parameters, an optimiser; float64 and float16; a newer pickle.
    mixed = state_dict(storage(701, torch.float64), storage(702, torch.float16))
    parallel = {f"module.{name}": torch.nn.Parameter(tensor) for name, tensor in mixed.items()}
    step = torch.tensor(7, dtype=torch.int64)
    optimiser = {"state": {0: {"step": step, "exp_avg": torch.zeros(3)}}, "param_groups": [{"lr": 3e-4, "params": [0]}]}
    nested = {"epoch": 7, "state_dict": parallel, "optimizer": optimiser, "best": True, "name": "VGN"}
    torch.save(nested, folder / "nested.pth", pickle_protocol=4)

    # Must be refused: a model with its class, whose code the pickle names.
    torch.save(torch.nn.Conv3d(1, 1, 1), folder / "whole_model.pth")
    for path in sorted(folder.iterdir()):
        print(path.name, path.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
