"""Checkpoints of networks in PyTorch, as the trainer writes them (``network/src/checkpoint/header.rs``)."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any, Mapping

from torch import nn

from . import _arrays
from .errors import DataError
from .formats._files import write

#: Key and version of the header.
HEADER, FORMAT_VERSION = "graspmill", 1
#: What stands in place of a file's digest while that is taken.
BLANK = "0" * 64
#: Id of a dataset that nobody stated, and what takes the place of a recipe.
UNKNOWN, RECIPE = "unknown (imported weights)", "# Trained with PyTorch.\n"
_NO_PROGRESS: dict[str, Any] = dict.fromkeys(("epoch", "batch", "step"), 0)
_NO_PROGRESS["confusion"] = dict.fromkeys(("true_positive", "false_positive", "true_negative", "false_negative"), 0)
_NO_PROGRESS |= {"sums_bits": [0, 0, 0, 0], "best_accuracy_bits": None}


def save_checkpoint(
    net: nn.Module, path: str | os.PathLike[str], architecture: str, own: Mapping[str, Any], dataset_id: str = UNKNOWN, config: str = RECIPE
) -> None:
    from safetensors.torch import save

    path = _arrays.path("path", path)
    tensors = {name: tensor.detach().cpu().float().contiguous() for name, tensor in net.state_dict().items()}
    for name, tensor in tensors.items():
        if off := int((~tensor.isfinite()).sum()):
            raise DataError(f"{name} must be finite, got {off} values that are not: the training diverged")
    header = {"file_sha256": BLANK, "format_version": FORMAT_VERSION, "architecture": architecture, **own}
    header |= {"dataset_id": dataset_id, "config": config, "progress": _NO_PROGRESS, "adam_steps": 0, "made_by": "graspmill.torch"}
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False)
    file = save(tensors, {HEADER: text})
    write(Path(path), file.replace(BLANK.encode(), hashlib.sha256(file).hexdigest().encode(), 1))
