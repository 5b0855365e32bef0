"""What cameras and other programs save, as ``graspmill plan`` reads it: clouds of PLY and PCD as NPY, and intrinsics of ROS,
RealSense, Open3D and OpenCV under our keys. What is read is a content, and where a cloud was seen from, if that is known."""

import io
import json
import os
import re
import tempfile
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _arrays, _native
from ..cameras import Camera
from ..errors import DataError, InputError
from ._files import yaml_for

_ORDERS = {"ascii": "", "binary": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_PLY = dict(zip("char uchar short ushort int uint float double".split(), "i1 u1 i2 u2 i4 u4 f4 f8".split()))
_MATRICES = ("k", "K", "camera_matrix", "intrinsic_matrix", "cam_K")


def run_native(words: list[str]) -> int:
    """Runs the native ``plan`` of these words, for which such files among them are read; returns its exit code."""
    words = [part for word in words for part in re.split("(?<=^--cloud)=|(?<=^--object)=|(?<=^--intrinsics)=", word, maxsplit=1)]
    with tempfile.TemporaryDirectory(prefix="graspmill-") as folder:
        for at, (option, path) in enumerate(zip(words, words[1:]), 1):
            read = {"--cloud": cloud, "--object": cloud, "--intrinsics": lens}.get(option)
            if read and os.path.isfile(path) and os.access(path, os.R_OK) and (found := read(path)):
                words[at] = os.path.join(tempfile.mkdtemp(dir=folder), os.path.basename(path))
                Path(words[at]).write_bytes(found[0])
                if option == "--cloud" and found[1] and not any(word.startswith("--eye") for word in words):
                    words.append(f"--eye={','.join(map(str, found[1]))}")
        return _native.run_program(["graspmill", *words])


def cloud(path: str) -> tuple[bytes, list[float]] | None:
    """A PLY or PCD file as NPY, ``[N, 3]``; ``None`` for other files. A damaged one is a :class:`DataError`."""
    data = Path(path).read_bytes()
    read = _ply if data.startswith((b"ply\n", b"ply\r")) else _pcd
    if read is _pcd and not data.startswith((b"# .PCD", b"VERSION", b"FIELDS")):
        if path.lower().endswith((".ply", ".pcd")):
            raise DataError(f"neither a PLY nor a PCD file: {path}")
        return None
    try:
        points, eye_m = read(data)
    except Exception as error:  # whatever NumPy says
        what = f"{error} is missing or unknown" if isinstance(error, KeyError) else error
        raise DataError(f"not a whole {read.__name__[1:].upper()} file: {str(what)[:300]}: {path}") from error
    np.save(file := io.BytesIO(), points)
    return file.getvalue(), eye_m


def _ply(data: bytes) -> tuple[NDArray[np.float64], list[float]]:
    head, body = re.split(rb"^end_header\s*?\n", data, maxsplit=1, flags=re.M)
    form, vertex, *_ = re.split(r"^element\s", head.decode("ascii"), flags=re.M)
    name, count, *_ = vertex.split()
    if name != "vertex":
        raise ValueError(f"its first element must be `vertex`, got `{name}`")
    columns = [words for words in map(str.split, vertex.splitlines()) if words[:1] == ["property"]]
    fields = [(words[-1], np.dtype(_PLY.get(words[1], words[1])).str[1:], 1) for words in columns]
    return _points(body, int(count), fields, _ORDERS[form.partition("format ")[2].split()[0]]), []


def _pcd(data: bytes) -> tuple[NDArray[np.float64], list[float]]:
    head, form, body = re.split(rb"^DATA\s+(\w+)\s*?\n", data, maxsplit=1, flags=re.M)
    keys = {words[0]: words[1:] for line in head.decode("ascii").splitlines() if (words := line.split())}
    counts = keys.get("COUNT") or ["1"] * len(keys["FIELDS"])
    columns = zip(keys["FIELDS"], keys["TYPE"], keys["SIZE"], counts, strict=True)
    fields = [(name, kind.lower() + size, int(times)) for name, kind, size, times in columns]
    eye_m = [float(word) for word in keys.get("VIEWPOINT", [])[:3]]
    return _points(body, int(keys["POINTS"][0]), fields, _ORDERS[form.decode()]), eye_m if any(eye_m) else []


def _points(body: bytes, count: int, fields: list[tuple[str, str, int]], order: str) -> NDArray[np.float64]:
    floats = {name: at for at, (name, kind, times) in enumerate(fields) if kind in ("f4", "f8") and times == 1}
    if not {*"xyz"} <= floats.keys():
        raise ValueError("its points must have x, y and z, floats of 4 or 8 bytes")
    if not order and count:
        columns = [sum(times for *_, times in fields[: floats[axis]]) for axis in "xyz"]
        return np.loadtxt(islice(io.BytesIO(body), count), usecols=columns, comments=None).reshape(count, 3)
    rows = np.frombuffer(body, [(str(at), order + kind, (times,)) for at, (_, kind, times) in enumerate(fields)], count)
    return np.stack([rows[str(floats[axis])].reshape(count) for axis in "xyz"], axis=1).astype(np.float64)


def lens(path: str) -> tuple[bytes, list[float]] | None:
    """Intrinsics of another program as JSON; ``None`` for what the native half reads, or refuses."""
    text = Path(path).read_bytes().decode("utf-8-sig", "replace")
    try:
        if not isinstance(root := _loaded(text), dict):
            return None
        for place in ("", "depth", "depth_intrinsics", "intrinsics", "intrinsic"):
            keys = root.get(place) if place else root
            if isinstance(keys, dict) and {"fx_px", "fx", *_MATRICES} & keys.keys():
                return None if "fx_px" in keys else (json.dumps(_ours(keys), allow_nan=False).encode(), [])
        raise InputError(f"intrinsics must have fx or one of {', '.join(_MATRICES)}, got the keys {', '.join(map(str, root))}")
    except Exception as error:  # whatever a library says
        raise InputError(f"not intrinsics: {' '.join(str(error).split())[:500]}: {path}") from error


def _loaded(text: str) -> Any:
    if "PPX:" in text:  # of rs-enumerate-devices
        _arrays.must(text.count("PPX:") == 1, f"intrinsics must be of one RealSense profile, got {text.count('PPX:')}: keep one")
        return {key.lower(): value.split() for key, value in re.findall(r"^\s*(\w+):(.*)$", text, re.M)}
    if text.lstrip().startswith("{"):
        return json.loads(text)
    # What is long, or has aliases, may be without end as YAML.
    if len(text) > 1 << 20 or not re.search(r"^[ -]*\w+:(\s|$)", text, re.M) or re.search(r"[-:,\[]\s*\*\w", text):
        return None
    plain = re.sub("^%.*|!!opencv-matrix", "", text, flags=re.M).encode()
    yaml, loader = yaml_for(plain, "a file of intrinsics in YAML")
    return next(filter(None, yaml.load_all(plain, loader)), None)  # of several messages the first is taken


def _ours(keys: dict[str, Any]) -> dict[str, Any]:
    def numbers(*names: str) -> list[float]:
        value: Any = next((keys[name] for name in names if name in keys), [])
        return [*map(float, np.array(value.get("data") if isinstance(value, dict) else value, float).ravel())]

    matrix = numbers(*_MATRICES)
    if "fx" in keys:
        matrix = [*numbers("fx"), 0, *numbers("ppx", "cx"), 0, *numbers("fy"), *numbers("ppy", "cy"), 0, 0, 1]
    elif "intrinsic_matrix" in keys and len(matrix) == 9 and any(matrix[6:8]):
        matrix = matrix[::3] + matrix[1::3] + matrix[2::3]  # Open3D has columns
    camera = Camera.from_K(np.reshape(matrix, (3, 4)) if len(matrix) == 12 else matrix, (1, 1))
    ours = {name: getattr(camera, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")}
    sides = {"width_px": numbers("width", "image_width"), "height_px": numbers("height", "image_height")}
    ours |= {name: int(side[0]) for name, side in sides.items() if side}
    return ours | {"distortion_coefficients": numbers("d", "D", "distortion_coefficients", "coeffs")}
