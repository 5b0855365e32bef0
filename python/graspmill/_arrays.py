"""Checks of arguments: every message names the argument, the rule and the value."""

import math
import operator
import os
from contextlib import contextmanager
from typing import Any, Iterator, Mapping, Sequence

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
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def kind(array: NDArray[Any]) -> str:
    return f"{array.dtype} {list(array.shape)}"


def must(is_so: object, rule: str, *given: object) -> None:
    # Refuses what breaks a rule, and shows what was given instead.
    if not is_so:
        raise InputError(f"{rule}, got {shown(given[0])}" if given else rule)


@contextmanager
def read_as(rule: str, value: object) -> Iterator[None]:
    # Refuses what cannot be read as a rule has it.
    try:
        yield
    except (TypeError, ValueError, OverflowError, RuntimeError, BufferError) as error:
        raise InputError(f"{rule}, got {shown(value)}") from error


def given(name: str, value: ArrayLike, what: str = "an array of numbers") -> NDArray[Any]:
    try:
        array = None if _is_masked(value) else np.asarray(value)
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        told = "rows of several lengths" if "inhomogeneous" in str(error) else f"{shown(value)} ({error})"
        raise InputError(f"{name} must be {what}, got {told}") from error
    if array is None:
        raise InputError(f"{name} must be {what} without a mask, which would be lost: fill what is masked, as with .filled(nan)")
    return array


def _is_masked(value: object) -> bool:
    return isinstance(value, np.ma.MaskedArray) or (isinstance(value, (list, tuple)) and any(map(_is_masked, value)))


def listed(name: str, value: Any) -> list[Any]:
    with read_as(f"{name} must be a list", value):
        return list(value)


def floats(name: str, value: ArrayLike, shape: Sequence[int | None], what: str = "") -> Floats:
    # An array of finite numbers of this shape (``None``: any length), as float32 in C order; ``what`` the shape means.
    array = given(name, value)
    if array.shape == (0,) and len(shape) > 1 and shape[0] is None:
        array = np.empty([0 if want is None else want for want in shape])
    must(array.dtype.kind in "fiu", f"{name} must be an array of numbers, got one of dtype {array.dtype}")
    if not _fits(array.shape, shape):
        wanted = ", ".join("N" if want is None else str(want) for want in shape)
        turned = " (is it transposed?)" if _fits(array.shape[::-1], shape) else ""
        raise InputError(f"{name} must have the shape [{wanted}]{what}, got {list(array.shape)}{turned}")
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(array, dtype=np.float32)
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite in single precision, got {int((~np.isfinite(array)).sum())} values that are not")
    return array


def numbered(name: str, value: ArrayLike, shape: Sequence[int | None], end: int, what: str) -> NDArray[np.uint32]:
    array = given(name, value)
    array = array.astype(np.uint32) if array.shape == (0,) else array
    wanted = ", ".join("N" if want is None else str(want) for want in shape)
    is_fit = array.dtype.kind in "iu" and _fits(array.shape, shape)
    must(is_fit, f"{name} must be whole numbers of shape [{wanted}], got {kind(array)}")
    if array.size and not 0 <= array.min() <= array.max() < end:
        raise InputError(f"{name} must be from 0 to below the number of {what}, {end}, got {array.min()} to {array.max()}")
    return np.ascontiguousarray(array, dtype=np.uint32)


def _fits(got: Sequence[int], shape: Sequence[int | None]) -> bool:
    return len(got) == len(shape) and all(want is None or want == have for want, have in zip(shape, got))


def path(name: str, value: Any) -> str:
    with read_as(f"{name} must be a path or a name", value):
        given = os.fspath(value)
    must(isinstance(given, str) and given and "\0" not in given, f"{name} must be a path or a name in text", value)
    return text(name, given)


def text(name: str, value: object) -> str:
    given = str(value)
    with read_as(f"{name} must be text in UTF-8", value):
        given.encode()
    return given


def vgn_values(name: str, values: Floats) -> None:
    if values.size and not 0.0 <= float(values.min()) <= float(values.max()) <= 1.0:
        raise InputError(f"{name} must be between 0 and 1 (VGN's values), got {values.min():g} to {values.max():g}")


def number(name: str, value: Any, low: float, high: float) -> float:
    with read_as(f"{name} must be a number", value):
        given = float(value)
    must(math.isfinite(given) and low <= given <= high, f"{name} must be between {low:g} and {high:g}, got {given:g}")
    return given


def shortest(value: float) -> float:
    # The shortest decimal that is the same in single precision, as files have it: 0.2, not 0.20000000298.
    return float(str(np.float32(value)))


def flag(name: str, value: Any) -> bool:
    with read_as(f"{name} must be True or False", value):
        return bool(value)


def whole(name: str, value: Any, low: int, high: int) -> int:
    must(not isinstance(value, bool), f"{name} must be a whole number", value)
    with read_as(f"{name} must be a whole number", value):
        given = operator.index(value)
    must(low <= given <= high, f"{name} must be between {low} and {high}, got {given}")
    return given


def threads(value: Any) -> int:
    return 0 if value is None else whole("threads", value, 1, 1024)


def one_of(name: str, value: Any, known: Sequence[str | None]) -> None:
    if not (value is None or isinstance(value, str)) or value not in known:
        words = [repr(one) for one in known if one]
        raise InputError(f"{name} must be {', '.join(words[:-1])} or {words[-1]}, got {shown(value)}")


def table(name: str, value: object) -> dict[Any, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{name} must be a mapping, got {shown(value)}")
    return value


def entry(name: str, value: Mapping[Any, Any]) -> Any:
    # A value that a mapping must have; ``name`` ends with its key, after a dot.
    key = name.rpartition(".")[2]
    must(key in value, f"{name} must be in the file, got the keys {shown(list(value)[:8])}")
    return value[key]


def numbers(name: str, value: ArrayLike, shape: tuple[int, ...], *, has_gaps: bool = False) -> NDArray[np.float64]:
    # Numbers of this shape as float64, finite unless some may be missing (NaN).
    array = given(name, value)
    is_fit = array.shape == shape and array.dtype.kind in "fiu"
    must(is_fit, f"{name} must be numbers of the shape {list(shape)}, got {kind(array)}")
    array = np.array(array, np.float64)
    if np.isinf(array).any() or (not has_gaps and np.isnan(array).any()):
        rule = "finite, or NaN where unknown" if has_gaps else "finite"
        raise InputError(f"{name} must be {rule}, got {shown(array.tolist())}")
    return array


def poses(name: str, value: ArrayLike) -> Floats:
    # Rigid transforms as ``[N, 7]``, position and unit quaternion x, y, z, w: given so, or as ``[N, 4, 4]``.
    array = given(name, value)
    if array.shape == (0,):
        return np.empty((0, 7), np.float32)
    if array.dtype.kind in "fiu" and _fits(array.shape, (None, 4, 4)):
        exact = array.astype(np.float64)
        _off(name, exact)
        rows = np.concatenate([exact[:, :3, 3], quaternions(exact[:, :3, :3])], axis=1).astype(np.float32)
    elif (array.ndim == 2 and array.shape[1] == 7) or array.dtype.kind not in "fiu":
        rows = floats(name, array, (None, 7))
        _check_lengths(name, rows)
    else:
        rule = "have the shape [N, 4, 4] (matrices) or [N, 7] (x, y, z, qx, qy, qz, qw)"
        raise InputError(f"{name} must {rule}, got {list(array.shape)}")
    _check_near(name, rows[:, :3])
    return rows


def rigid(name: str, value: ArrayLike, count_max: int) -> NDArray[np.float64]:
    # Rigid transforms ``[N, 4, 4]`` in double precision, of matrices that may be rough; ``[0]`` is none.
    array = given(name, value)
    if array.shape == (0,):
        return np.empty((0, 4, 4))
    must(array.dtype.kind in "fiu", f"{name} must be an array of numbers, got one of dtype {array.dtype}")
    is_fit = _fits(array.shape, (None, 4, 4)) and len(array) <= count_max
    must(is_fit, f"{name} must have the shape [N, 4, 4], N at most {count_max}, got {list(array.shape)}")
    exact = np.array(array, np.float64)
    rough = _off(name, exact) > EXACT_OFF_MAX
    _check_near(name, exact[:, :3, 3])
    left, _, right = np.linalg.svd(exact[rough, :3, :3])
    exact[rough, :3, :3] = left @ right
    exact[:, 3] = [0.0, 0.0, 0.0, 1.0]
    return exact


def of_quaternions(name: str, rows: ArrayLike, count_max: int) -> NDArray[np.float64]:
    # Rigid transforms ``[N, 4, 4]`` in double precision, of positions and unit quaternions x, y, z, w ``[N, 7]``.
    array = given(name, rows)
    is_fit = array.dtype.kind in "fiu" and _fits(array.shape, (None, 7))
    must(is_fit, f"{name} must be numbers of the shape [N, 7], got {kind(array)}")
    _check_lengths(name, array)
    return rigid(name, matrices(array), count_max)


def pose(name: str, value: ArrayLike) -> list[float]:
    # One rigid transform as seven numbers: of a matrix ``[4, 4]``, seven numbers, or a translation ``[3]`` alone.
    array = given(name, value, "a pose")
    if array.shape == (3,) and array.dtype.kind in "fiu":
        array = np.concatenate([array, [0.0, 0.0, 0.0, 1.0]])
    must(array.shape in ((4, 4), (7,)), f"{name} must have the shape [4, 4], [7] or [3], got {list(array.shape)}")
    return [float(part) for part in poses(name, array[None])[0]]


def _off(name: str, transforms: NDArray[np.float64]) -> NDArray[np.float64]:
    # How far each of ``[N, 4, 4]`` is from a rigid transform; refuses what is further than ``RIGID_OFF_MAX``.
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
    lengths = np.linalg.norm(rows[:, 3:].astype(np.float64), axis=1)
    if not (is_one := np.abs(lengths - 1.0) <= RIGID_OFF_MAX).all():
        worst = int(is_one.argmin())
        raise InputError(f"{name} must have quaternions of length 1 within {RIGID_OFF_MAX:g}, got {lengths[worst]:.4g} in pose {worst}")


def _check_near(name: str, positions_m: NDArray[Any]) -> None:
    must((far := np.abs(positions_m).max(initial=0.0)) <= FAR_M_MAX, f"{name} must be positions in metres within {FAR_M_MAX:g}, got {far:g}")


def are_alike(pose: NDArray[np.float64], others: NDArray[np.float64], apart_m: float, apart_cos: float) -> NDArray[np.bool_]:
    # Which of ``[N, 4, 4]`` are within a distance of a pose and turned by no more than an angle of this cosine, but for
    # half a turn.
    turns = others[:, :3, :3].transpose(0, 2, 1) @ pose[:3, :3]
    cosines = (np.abs(turns[:, 0, 0] + turns[:, 1, 1]) + turns[:, 2, 2] - 1) / 2
    is_near = np.linalg.norm(others[:, :3, 3] - pose[:3, 3], axis=1) <= apart_m
    return np.asarray(is_near & (cosines >= apart_cos))


def quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    # Unit quaternions x, y, z, w, ``[N, 4]``, of rotations ``[N, 3, 3]`` (Shepperd's choice of the largest).
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotations.transpose(1, 2, 0)
    trace = xx + yy + zz
    by_largest = [
        [1.0 + xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, 1.0 + yy - zz - xx, yz + zy, xz - zx],
        [xz + zx, yz + zy, 1.0 + zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, 1.0 + trace],
    ]
    out = np.array(by_largest)[np.stack([xx, yy, zz, trace]).argmax(axis=0), :, np.arange(len(rotations))]
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def matrices(rows: ArrayLike) -> NDArray[np.float64]:
    # Matrices ``[N, 4, 4]`` of poses ``[N, 7]``.
    rows = np.asarray(rows, dtype=np.float64)
    x, y, z, w = (rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)).T
    out = np.zeros((len(rows), 4, 4))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    out[:, :3, 3] = rows[:, :3]
    out[:, 3, 3] = 1.0
    return out
