"""The network of voxels in PyTorch, with the paper's head and the head by closing direction, and their losses."""

from __future__ import annotations

import json
import os
import re
from typing import Any, Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from . import _arrays, _native
from ._batches import Batch, conv
from ._checkpoint import HEADER, save_checkpoint

#: Closing directions that a network with ``head="closings"`` tells apart, over half a turn.
TURNS = 15
#: Origin of a grasp in the shipped recipes: between the roots of the fingers.
ORIGIN_BEHIND_TIPS_M = 0.05


def behind_tips_m(value: float) -> float:
    return _arrays.number("origin_behind_tips_m", value, 0.0, 0.3)


class VoxelNetwork(nn.Module):
    """The paper's network, which is VGN's: it predicts a quality, an orientation and an opening for every voxel.

    With ``head="closings"`` it answers by closing direction (:meth:`heads`), of which :meth:`forward` gives the one at which most
    grasps hold. :meth:`load` reads every checkpoint of such a network, and :meth:`save` writes one for the programs.

    Args:
        upsampling: ``"linear"`` (trilinear, as in the shipped configs) or ``"nearest"``.
        head: ``"quaternion"``, the paper's, or ``"closings"`` (``network.head`` of a recipe).
        origin_behind_tips_m: From a grasp's origin to the finger tips: that of the :class:`GraspStream` on which it is trained.
        voxel_offset: Where that origin is in its voxel along each axis: 0.5 for networks trained with this package, 0 for VGN's.
    """

    def __init__(
        self, upsampling: Literal["linear", "nearest"] = "linear", *, head: Literal["quaternion", "closings"] = "quaternion",
        origin_behind_tips_m: float = ORIGIN_BEHIND_TIPS_M, voxel_offset: float = 0.5,
    ) -> None:  # fmt: skip
        super().__init__()
        _arrays.one_of("head", head, ("quaternion", "closings"))
        _arrays.one_of("upsampling", upsampling, ("linear", "nearest"))
        self.head, self.upsampling = head, upsampling
        self.origin_behind_tips_m = behind_tips_m(origin_behind_tips_m)
        self.voxel_offset = _arrays.number("voxel_offset", voxel_offset, 0.0, 1.0)

        self.encoder = nn.ModuleDict({"conv1": conv(1, 16, 5, 2), "conv2": conv(16, 32, 3, 2), "conv3": conv(32, 64, 3, 2)})
        self.decoder = nn.ModuleDict({"conv1": conv(64, 64, 3), "conv2": conv(64, 32, 3), "conv3": conv(32, 16, 5)})
        if head == "quaternion":
            self.conv_qual, self.conv_rot, self.conv_width = conv(16, 1, 5), conv(16, 4, 5), conv(16, 1, 5)
        else:
            self.conv_qual, self.conv_approach, self.conv_turn = conv(16, 3, 5), conv(16, 3, 5), conv(16, TURNS, 5)
            self.conv_width, self.conv_tips = conv(16, 3, 5), conv(16, 3, 5)

    def features(self, tsdf: Tensor) -> Tensor:
        """``[B, 1, 40, 40, 40]`` to ``[B, 16, 40, 40, 40]``."""
        x = tsdf
        for layer in self.encoder.values():
            x = F.relu(layer(x))
        for layer, size in zip(self.decoder.values(), (10, 20, 40)):
            x = F.relu(layer(x))
            x = F.interpolate(x, size, mode="trilinear", align_corners=False) if self.upsampling == "linear" else F.interpolate(x, size)
        return x

    def forward(self, tsdf: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """From TSDFs in VGN's values, ``[B, 1, 40, 40, 40]``, to quality ``[B, 1, …]``, rotation ``[B, 4, …]`` and width in voxels."""
        if self.head == "closings":
            return _best_closing(self.heads(tsdf))
        x = self.features(tsdf)
        return torch.sigmoid(self.conv_qual(x)), F.normalize(self.conv_rot(x), dim=1), self.conv_width(x)

    def heads(self, tsdf: Tensor) -> dict[str, Tensor]:
        """The answers by closing direction, each ``[B, channels, 40, 40, 40]``: ``quality_logit`` and ``width`` (voxels) are a, b, c of
        a + b cos 2t + c sin 2t at turn t; ``approach`` is a unit vector; the softmax of ``turn_logits`` says how likely each of 15 turns
        over half a turn holds; ``tips`` is the point between the finger tips from the middle of the voxel, in voxels."""
        _arrays.must(self.head == "closings", "the network has the paper's head: heads are those of head='closings'")
        x = self.features(tsdf)
        names = ("quality_logit", "approach", "turn_logits", "width", "tips")
        layers = (self.conv_qual, self.conv_approach, self.conv_turn, self.conv_width, self.conv_tips)
        heads = {name: layer(x) for name, layer in zip(names, layers)}
        return {**heads, "approach": F.normalize(heads["approach"], dim=1)}

    def at(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """Quality ``[B]``, rotation ``[B, 4]`` and width ``[B]`` at the voxels of a batch."""
        i, j, k = batch["voxel"].T
        quality, rotation, width = self(batch["tsdf"])
        at = batch["scene"]
        return quality[at, 0, i, j, k], rotation[at, :, i, j, k], width[at, 0, i, j, k]

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> VoxelNetwork:
        """The network of a checkpoint, or of a state dict of VGN's network, as safetensors or of ``torch.save``, alone or under
        ``"state_dict"``, ``"model_state_dict"`` or ``"model"``, with VGN's upsampling (nearest) and origin (50 mm behind the tips,
        in the lower corner of its voxel). Raises DataError if a checkpoint is damaged."""
        stated: dict[str, Any] = {"upsampling": "nearest", "origin_behind_tips_m": 0.05, "voxel_offset": 0.0}
        with open(path, "rb") as file:
            first = file.read(9)
        if first[8:] != b"{":  # safetensors: the length of a JSON header, and the header
            saved = torch.load(os.fspath(path), map_location="cpu", weights_only=True)
        else:
            from safetensors import safe_open

            with safe_open(os.fspath(path), "pt") as weights:
                said = weights.metadata() or {}
                if HEADER in said:
                    _native.check_checkpoint(os.fspath(path))  # refuses what is not whole
                # Our checkpoints state an origin only if it is not midway between the tips.
                midway = {"origin_behind_tips_m": 0.0, "voxel_offset": 0.5}
                stated |= {**midway, **json.loads(said[HEADER])} if HEADER in said else said
                saved = {name: weights.get_tensor(name) for name in weights.keys() if not name.startswith("adam.")}
        tensors = _state_dict(saved)
        origin = {name: float(stated[name]) for name in ("origin_behind_tips_m", "voxel_offset")}
        head: Literal["quaternion", "closings"] = "closings" if "conv_turn.weight" in tensors else "quaternion"
        net = cls(stated["upsampling"], head=head, **origin)
        net.load_state_dict(tensors, strict=True)
        return net

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a checkpoint, whole or not at all. Raises DataError if a weight is not finite: it diverged."""
        own = {name: getattr(self, name) for name in ("upsampling", "origin_behind_tips_m", "voxel_offset")}
        save_checkpoint(self, path, "closings-conv-40" if self.head == "closings" else "vgn-conv-40", own)


def _state_dict(saved: Any) -> dict[str, Tensor]:
    for name in ("state_dict", "model_state_dict", "model"):
        saved = saved.get(name, saved) if isinstance(saved, dict) else saved
    _arrays.must(isinstance(saved, dict), f"the file must hold a state dict, it holds {_arrays.shown(type(saved).__name__)}")
    return {re.sub(r"^(module\.|_orig_mod\.)+", "", str(name)): tensor for name, tensor in saved.items()}


def loss(quality: Tensor, rotation: Tensor, width: Tensor, batch: Batch) -> Tensor:
    """The paper's loss (Eq. 1 to 5), a scalar: the cross-entropy of the quality and, for held grasps, the distance of the
    orientation to the grasp or its half turn, whichever is nearer, plus 0.01 times the squared error of the opening in voxels."""
    label, target = batch["label"], batch["rotation"]
    x, y, z, w = target.unbind(1)
    turned = torch.stack([y, -x, w, -z], dim=1)
    apart = torch.minimum(*(1.0 - (rotation * one).sum(1).abs() for one in (target, turned)))
    terms = F.binary_cross_entropy(quality, label, reduction="none") + label * apart + 0.01 * label * (width - batch["width"]) ** 2
    return terms.mean()


def _unturned(approach: Tensor) -> Tensor:
    """The orientation with an approach ``[B, 3, …]`` that the shortest rotation makes of the one from straight above."""
    x, y, z = approach.unbind(1)
    return F.normalize(torch.stack([1 - z, torch.zeros_like(z), x, -y], dim=1), dim=1)


def _at_turn(factors: Tensor, turn: Tensor) -> Tensor:
    """a + b cos 2t + c sin 2t of ``[B, 3, …]`` and ``[B, …]``."""
    return factors[:, 0] + factors[:, 1] * torch.cos(2 * turn) + factors[:, 2] * torch.sin(2 * turn)


def _best_closing(heads: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """Of the peaks of the closing directions the one with the highest product of quality and share."""
    shares = F.softmax(heads["turn_logits"], dim=1)
    before, after = shares.roll(1, 1), shares.roll(-1, 1)
    share = before + shares + after
    numbers = torch.arange(TURNS, device=shares.device).view(1, -1, *[1] * (shares.dim() - 2))
    turns = (numbers + (after - before) / share) * (torch.pi / TURNS)
    logits = torch.stack([_at_turn(heads["quality_logit"], turn) for turn in turns.unbind(1)], dim=1)
    is_peak = (shares >= before) & (shares >= after)
    best = torch.where(is_peak, share * torch.sigmoid(logits), -1.0).argmax(1, keepdim=True)
    turn = turns.gather(1, best)[:, 0]
    x, _, z, w = _unturned(heads["approach"]).unbind(1)
    cos, sin = torch.cos(0.5 * turn), torch.sin(0.5 * turn)
    rotation = torch.stack([x * cos, -x * sin, z * cos + w * sin, w * cos - z * sin], dim=1)
    return torch.sigmoid(logits.gather(1, best)), rotation, _at_turn(heads["width"], turn)[:, None]
