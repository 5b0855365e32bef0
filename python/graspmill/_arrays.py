"""Checks of arguments: every message names the argument, the rule and the value."""

from __future__ import annotations

import math
import operator
import os
from typing import Any, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError

#: How far from a rotation a matrix may be: the largest entry of RᵀR − 1.
RIGID_OFF_MAX = 1e-3
#: Matrices that are further from it are replaced by the nearest rotation where that matters: those of half precision.
EXACT_OFF_MAX = 1e-6
#: Largest distance from the origin, in metres, that physics takes.
FAR_M_MAX = 1e3

Floats = NDArray[np.float32]


def shown(value: object) -> str:
    """A value, short enough for a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def given(name: str, value: ArrayLike, what: str = "an array of numbers") -> NDArray[Any]:
    """What was given, as an array."""
    try:
        array = None if _is_masked(value) else np.asarray(value)
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        told = "rows of several lengths" if "inhomogeneous" in str(error) else f"{shown(value)} ({error})"
        raise InputError(f"{name} must be {what}, got {told}") from error
    if array is None:
        raise InputError(f"{name} must be {what} without a mask, which would be lost: fill what is masked, as with .filled(nan)")
    return array


def _is_masked(value: object) -> bool:
    """Whether it is, or contains, one of NumPy's masked arrays."""
    return isinstance(value, np.ma.MaskedArray) or (isinstance(value, (list, tuple)) and any(map(_is_masked, value)))


def listed(name: str, value: Any) -> list[Any]:
    """A list of what was given, such as images."""
    try:
        return list(value)
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        raise InputError(f"{name} must be a list, got {shown(value)}") from error


def floats(name: str, value: ArrayLike, shape: Sequence[int | None], what: str = "") -> Floats:
    """An array of finite numbers of this shape (``None``: any length), as float32 in C order.

    Args:
        name: The argument's name.
        value: What was given.
        shape: The wanted shape.
        what: What the shape means, for the message.
    """
    array = given(name, value)
    if array.shape == (0,) and len(shape) > 1 and shape[0] is None:
        array = np.empty([0 if want is None else want for want in shape])
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be an array of numbers, got one of dtype {array.dtype}")
    if not _fits(array.shape, shape):
        wanted = ", ".join("N" if want is None else str(want) for want in shape)
        turned = " (is it transposed?)" if _fits(array.shape[::-1], shape) else ""
        raise InputError(f"{name} must have the shape [{wanted}]{what}, got {list(array.shape)}{turned}")
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(array, dtype=np.float32)
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite in single precision, got {int((~np.isfinite(array)).sum())} values that are not")
    return array


def _fits(got: Sequence[int], shape: Sequence[int | None]) -> bool:
    return len(got) == len(shape) and all(want is None or want == have for want, have in zip(shape, got))


def path(name: str, value: Any) -> str:
    """A path, or a name, as text."""
    try:
        given = os.fspath(value)
    except TypeError as error:
        raise InputError(f"{name} must be a path or a name, got {shown(value)}") from error
    if not isinstance(given, str) or not given or "\0" in given:
        raise InputError(f"{name} must be a path or a name in text, got {shown(value)}")
    return text(name, given)


def text(name: str, value: object) -> str:
    """A text that can be written in UTF-8."""
    given = str(value)
    try:
        given.encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{name} must be text in UTF-8, got {shown(value)}") from error
    return given


def vgn_values(name: str, values: Floats) -> None:
    """Refuses a TSDF that is not in VGN's values."""
    if values.size and not 0.0 <= float(values.min()) <= float(values.max()) <= 1.0:
        raise InputError(f"{name} must be between 0 and 1 (VGN's values), got {values.min():g} to {values.max():g}")


def number(name: str, value: Any, low: float, high: float) -> float:
    """A number between two limits, included."""
    try:
        given = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be a number, got {shown(value)}") from error
    if not (math.isfinite(given) and low <= given <= high):
        raise InputError(f"{name} must be between {low:g} and {high:g}, got {given:g}")
    return given


def flag(name: str, value: Any) -> bool:
    """Whether something is so: True or False, as Python sees it."""
    try:
        return bool(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be True or False, got {shown(value)}") from error


def whole(name: str, value: Any, low: int, high: int) -> int:
    """A whole number between two limits, included."""
    try:
        given = operator.index(value)
    except TypeError as error:
        raise InputError(f"{name} must be a whole number, got {shown(value)}") from error
    if isinstance(value, bool):
        raise InputError(f"{name} must be a whole number, got {value}")
    if not low <= given <= high:
        raise InputError(f"{name} must be between {low} and {high}, got {given}")
    return given


def table(name: str, value: object) -> dict[Any, Any]:
    """A mapping of a file."""
    if not isinstance(value, dict):
        raise InputError(f"{name} must be a mapping, got {shown(value)}")
    return value


def entry(name: str, value: Mapping[Any, Any]) -> Any:
    """A value that a mapping must have; ``name`` ends with its key, after a dot."""
    key = name.rpartition(".")[2]
    if key not in value:
        raise InputError(f"{name} must be in the file, got the keys {shown(list(value)[:8])}")
    return value[key]


def numbers(name: str, value: ArrayLike, shape: tuple[int, ...], *, has_gaps: bool = False) -> NDArray[np.float64]:
    """Numbers of this shape as float64, finite unless some may be missing (NaN)."""
    array = given(name, value)
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be numbers of the shape {list(shape)}, got {array.dtype} {list(array.shape)}")
    array = np.array(array, np.float64)
    if np.isinf(array).any() or (not has_gaps and np.isnan(array).any()):
        rule = "finite, or NaN where unknown" if has_gaps else "finite"
        raise InputError(f"{name} must be {rule}, got {shown(array.tolist())}")
    return array


def poses(name: str, value: ArrayLike) -> Floats:
    """Rigid transforms as ``[N, 7]``: position in metres, then quaternion x, y, z, w.

    Takes ``[N, 7]``, whose unit quaternions keep their bits, or matrices ``[N, 4, 4]``.
    """
    array = given(name, value)
    if array.shape == (0,):
        return np.empty((0, 7), np.float32)
    if array.ndim == 3 and array.shape[1:] == (4, 4) and array.dtype.kind in "fiu":
        exact = array.astype(np.float64)
        _off(name, exact)
        rows = np.concatenate([exact[:, :3, 3], quaternions(exact[:, :3, :3])], axis=1).astype(np.float32)
    elif (array.ndim == 2 and array.shape[1] == 7) or array.dtype.kind not in "fiu":
        rows = floats(name, array, (None, 7))
        _check_lengths(name, rows)
    else:
        raise InputError(
            f"{name} must have the shape [N, 4, 4] (matrices) or [N, 7] (x, y, z, qx, qy, qz, qw), got {list(array.shape)}"
        )
    _check_near(name, rows[:, :3])
    return rows


def rigid(name: str, value: ArrayLike, count_max: int) -> NDArray[np.float64]:
    """Rigid transforms ``[N, 4, 4]`` in double precision, of matrices that may be rough; ``[0]`` is none."""
    array = given(name, value)
    if array.shape == (0,):
        return np.empty((0, 4, 4))
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be an array of numbers, got one of dtype {array.dtype}")
    if array.ndim != 3 or array.shape[1:] != (4, 4) or len(array) > count_max:
        raise InputError(f"{name} must have the shape [N, 4, 4], N at most {count_max}, got {list(array.shape)}")
    exact = np.array(array, np.float64)
    rough = _off(name, exact) > EXACT_OFF_MAX
    _check_near(name, exact[:, :3, 3])
    left, _, right = np.linalg.svd(exact[rough, :3, :3])
    exact[rough, :3, :3] = left @ right
    exact[:, 3] = [0.0, 0.0, 0.0, 1.0]
    return exact


def of_quaternions(name: str, rows: ArrayLike, count_max: int) -> NDArray[np.float64]:
    """Rigid transforms ``[N, 4, 4]`` in double precision, of positions and unit quaternions x, y, z, w ``[N, 7]``."""
    array = given(name, rows)
    if array.ndim != 2 or array.shape[1] != 7 or array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be numbers of the shape [N, 7], got {array.dtype} {list(array.shape)}")
    _check_lengths(name, array)
    return rigid(name, matrices(array), count_max)


def pose(name: str, value: ArrayLike) -> list[float]:
    """One rigid transform as seven numbers: of a matrix ``[4, 4]``, seven numbers, or a translation ``[3]`` alone."""
    array = given(name, value, "a pose")
    if array.shape == (3,) and array.dtype.kind in "fiu":
        array = np.concatenate([array, [0.0, 0.0, 0.0, 1.0]])
    if array.shape not in ((4, 4), (7,)):
        raise InputError(f"{name} must have the shape [4, 4], [7] or [3], got {list(array.shape)}")
    return [float(part) for part in poses(name, array[None])[0]]


def _off(name: str, transforms: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each of ``[N, 4, 4]`` is from a rigid transform; refuses what is further than ``RIGID_OFF_MAX``."""
    if not np.isfinite(transforms).all():
        raise InputError(f"{name} must be finite, got {int((~np.isfinite(transforms)).sum())} values that are not")
    rotations = transforms[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):  # numbers that are far too large are refused below
        off = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(axis=(1, 2))
        off = np.maximum(off, np.abs(transforms[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1))
        off = np.where(np.linalg.det(rotations) > 0.0, off, np.inf)
    if not (off <= RIGID_OFF_MAX).all():
        worst = int(off.argmax())
        told = "a reflection" if np.isinf(off[worst]) else f"{off[worst]:.3g}"
        rule = "rigid (a rotation and a translation, last row 0 0 0 1)"
        raise InputError(f"{name} must be {rule} within {RIGID_OFF_MAX:g}, got {told} in pose {worst}")
    return off


def _check_lengths(name: str, rows: NDArray[Any]) -> None:
    """Refuses poses ``[N, 7]`` whose quaternions have another length than 1."""
    lengths = np.linalg.norm(rows[:, 3:].astype(np.float64), axis=1)
    if not (is_one := np.abs(lengths - 1.0) <= RIGID_OFF_MAX).all():
        worst = int(is_one.argmin())
        raise InputError(f"{name} must have quaternions of length 1 within {RIGID_OFF_MAX:g}, got {lengths[worst]:.4g} in pose {worst}")


def _check_near(name: str, positions_m: NDArray[Any]) -> None:
    if (far := np.abs(positions_m).max(initial=0.0)) > FAR_M_MAX:
        raise InputError(f"{name} must be positions in metres within {FAR_M_MAX:g}, got {far:g}")


def quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions x, y, z, w, ``[N, 4]``, of rotations ``[N, 3, 3]`` (Shepperd's choice of the largest)."""
    m = rotations
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    squares = np.stack([m[:, 0, 0], m[:, 1, 1], m[:, 2, 2], trace], axis=1)
    out = np.empty((len(m), 4))
    for largest in range(4):
        rows = np.nonzero(squares.argmax(axis=1) == largest)[0]
        a = m[rows]
        if largest == 3:
            parts = [a[:, 2, 1] - a[:, 1, 2], a[:, 0, 2] - a[:, 2, 0], a[:, 1, 0] - a[:, 0, 1], 1.0 + trace[rows]]
        else:
            i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
            parts = [None] * 4  # type: ignore[list-item]
            parts[i] = 1.0 + a[:, i, i] - a[:, j, j] - a[:, k, k]
            parts[j] = a[:, j, i] + a[:, i, j]
            parts[k] = a[:, k, i] + a[:, i, k]
            parts[3] = a[:, k, j] - a[:, j, k]
        out[rows] = np.stack(parts, axis=1)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return out


def matrices(rows: ArrayLike) -> NDArray[np.float64]:
    """Matrices ``[N, 4, 4]`` of poses ``[N, 7]``."""
    rows = np.asarray(rows, dtype=np.float64)
    x, y, z, w = (rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)).T
    out = np.zeros((len(rows), 4, 4))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    out[:, :3, 3] = rows[:, :3]
    out[:, 3, 3] = 1.0
    return out
