"""Names of earlier versions: they work for one more version, with a warning."""

from __future__ import annotations

import warnings
from typing import Any, Mapping

#: Old names, and what they are now.
RENAMED = {
    "Error": "GraspmillError",
    "HandBatch": "GraspCropBatch",
    "HandCrops": "GraspCrops",
    "HandDataset": "GraspCropDataset",
    "HandStream": "GraspCropStream",
    "facts": "features",
    "hand_crops": "grasp_crops",
    "surroundings": "context",
}


def renamed(old: str, found: Mapping[str, Any], owner: str, error: type[Exception] = AttributeError) -> Any:
    """The value of an old name, with a warning; ``error`` for all other names."""
    new = RENAMED.get(old, "")
    if new not in found:
        raise error(f"{owner} has no {old!r}")
    warnings.warn(f"{owner}.{old} is now {owner}.{new}", DeprecationWarning, stacklevel=3)
    return found[new]
