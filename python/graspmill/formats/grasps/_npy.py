"""Arrays of NumPy's files."""

from __future__ import annotations

import tokenize
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...object_grasps import GRASPS_MAX

#: What NumPy raises for a damaged array; its header is a Python expression.
BROKEN = (ValueError, EOFError, OSError, SyntaxError, tokenize.TokenError)


def array(name: str, file: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array of a ``.npy``, whose shape ``[N, *shape]`` is checked before memory is taken for it."""
    version = np.lib.format.read_magic(file)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    found, _, dtype = header(file)
    if found[1:] != shape or not found or found[0] > GRASPS_MAX or dtype.kind not in "fiu":
        wanted = f"numbers of the shape [{', '.join(['N', *map(str, shape)])}], N at most {GRASPS_MAX}"
        raise InputError(f"{name} must be {wanted}, got {dtype} {list(found)}")
    file.seek(0)
    return np.asarray(np.lib.format.read_array(file, allow_pickle=False))
