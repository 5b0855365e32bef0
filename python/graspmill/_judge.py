"""The judge in PyTorch, and its files: those of the trainer, bit by bit."""

from __future__ import annotations

import json
import math
import os
from typing import Any, Mapping, cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from . import _arrays, _native
from ._batches import GraspCropBatch, conv
from ._checkpoint import HEADER, RECIPE, UNKNOWN, save_checkpoint
from .crops import FEATURES
from .dataset import Dataset
from .errors import InputError
from .scene import OUTCOMES

_ARCHITECTURE = "hand-judge-1"
#: Values before the head: 16 channels of 2 · 5 · 7 positions of the crop and of 3 · 2 · 2 of the context.
_SEEN, _SEEN_CONTEXT = 16 * 70, 16 * 12


class Judge(nn.Module):
    """The judge (``docs/judge.md``): it is asked about a grasp and answers how the attempt would end.

    :meth:`load` reads ``models/judge.safetensors`` and every judge of ``graspmill fit``; what :meth:`save` writes is such
    a file, for ``graspmill plan --model``, ``graspmill evaluate`` and :class:`graspmill.Planner`.

    Args:
        trained_for: What it is trained for: a :class:`graspmill.Dataset`, or the entry of that name of another judge.

    Attributes:
        trained_for: The gripper (of several the range of each number), the approach in metres, and the grid.
        dataset_id: SHA-256 of the dataset of its training, if that is known; ``config`` is its recipe, as TOML.
    """

    def __init__(self, trained_for: Dataset | Mapping[str, Any]) -> None:
        super().__init__()
        is_dataset = isinstance(trained_for, Dataset)
        self.trained_for: dict[str, Any] = _scope(trained_for.info if isinstance(trained_for, Dataset) else trained_for, is_dataset)
        self.dataset_id: str = trained_for.id if isinstance(trained_for, Dataset) else UNKNOWN
        self.config: str = RECIPE

        self.conv1, self.conv2, self.conv3, self.reduce = conv(4, 16, 3, 2), conv(16, 32, 3, 2), conv(32, 32, 3), conv(32, 16, 1)
        self.wide1, self.wide2 = conv(3, 16, 3, 2), conv(16, 16, 3, 2)
        self.head1 = conv(_SEEN + _SEEN_CONTEXT + FEATURES, 128, 1)
        self.head2, self.head3 = conv(128, 64, 1), conv(64, len(OUTCOMES), 1)
        self.robustness: nn.Conv3d | None = conv(64, 1, 1) if self.trained_for.get("robustness") else None
        for layer in self.modules():
            if isinstance(layer, nn.Conv3d):  # He et al., 2015, as the trainer begins
                bound = math.sqrt(6.0 / layer.weight[0].numel())
                nn.init.uniform_(layer.weight, -bound, bound)
                nn.init.zeros_(layer.bias)  # type: ignore[arg-type]

    def forward(self, crop: Tensor, context: Tensor, features: Tensor) -> Tensor:
        """From what :class:`GraspCropBatch` has of ``B`` grasps to logits ``[B, 6]`` of ``graspmill.OUTCOMES``, and as a
        seventh that of the robustness if it has one."""
        x = F.relu(self.conv3(F.relu(self.conv2(F.relu(self.conv1(crop))))))
        wide = self.wide2(F.relu(self.wide1(context)))
        # Channels fastest, as the trainer has them.
        x, wide = (part.permute(0, 2, 3, 4, 1) for part in (x, wide))
        row = torch.cat([_product(self.reduce, x).flatten(1), wide.flatten(1), features], dim=1)
        hidden = F.relu(_product(self.head2, F.relu(_product(self.head1, row))))
        heads = [self.head3] if self.robustness is None else [self.head3, self.robustness]
        return torch.cat([_product(head, hidden) for head in heads], dim=1)

    def at(self, batch: GraspCropBatch) -> Tensor:
        """Logits of the grasps of a batch, as :meth:`forward` gives them."""
        return cast(Tensor, self(batch["crop"], batch["context"], batch["features"]))

    def outcomes(self, batch: GraspCropBatch) -> Tensor:
        """Probabilities of ``graspmill.OUTCOMES``, ``[B, 6]``, last ``held``, for what ``hits_table`` does not fail."""
        return self.at(batch)[:, : len(OUTCOMES)].softmax(dim=1)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Judge:
        """The judge of a checkpoint: ``best.safetensors`` or ``last.safetensors`` of a run, or a file of :meth:`save`.
        Raises InputError if the file has the weights of another network; DataError if it is damaged."""
        from safetensors import safe_open

        path = _arrays.path("path", path)
        _native.check_checkpoint(path)  # refuses what is not whole
        with safe_open(path, "pt") as file:
            header = json.loads(file.metadata()[HEADER])
            if (kind := header["architecture"]) != _ARCHITECTURE:
                raise InputError(f"architecture must be {_ARCHITECTURE!r}, a judge's, got {_arrays.shown(kind)}: {path}")
            tensors = {name: file.get_tensor(name) for name in file.keys() if not name.startswith("adam.")}
        judge = cls(header["trained_for"])
        judge.load_state_dict(tensors, strict=True)
        judge.dataset_id, judge.config = header["dataset_id"], header["config"]
        return judge

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a checkpoint, whole or not at all. Raises DataError if a weight is not finite: it diverged."""
        save_checkpoint(self, path, _ARCHITECTURE, {"trained_for": self.trained_for}, self.dataset_id, self.config)


def judge_loss(logits: Tensor, batch: GraspCropBatch) -> Tensor:
    """The trainer's loss of a judge, a scalar: the mean cross-entropy of the first six logits of each grasp."""
    return F.cross_entropy(logits[:, : len(OUTCOMES)], batch["outcome"])


def _product(layer: nn.Conv3d, x: Tensor) -> Tensor:
    """A convolution of 1³ as a product of ``[…, c_in]``."""
    return F.linear(x, layer.weight.flatten(1), layer.bias)


def _scope(given: Mapping[str, Any], is_dataset: bool) -> dict[str, Any]:
    """What a judge is trained for, as checkpoints state it (``Scope`` of ``network/src/judge.rs``)."""
    if not is_dataset:
        needed = {"gripper", "grid", "pregrasp_distance_m"}
        if not isinstance(given, Mapping) or not needed <= set(given):
            raise InputError(f"trained_for must be a dataset or have {', '.join(sorted(needed))}, got {_arrays.shown(given)}")
        return dict(given)
    grippers = given.get("grippers") or [given["gripper"]]
    # Where a gripper is mounted decides no label, and judges see grippers of three boxes.
    grippers = [{key: one[key] for key in one if key not in ("flange_from_grasp", "finger_tip", "jaws")} for one in grippers]
    spans = [[pick(one[name] for one in grippers) for pick in (min, max)] for name in grippers[0] if name != "name"]
    several = {"hands": spans} if any(low != high for low, high in spans) else {}
    way = {"pregrasp_distance_m": given["procedure"]["pregrasp_distance_m"], "grid": given["grid"]}
    return {"gripper": grippers[0], **several, **way}

