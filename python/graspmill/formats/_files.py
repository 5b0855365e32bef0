"""Numbers as text, and files that are whole once they have their name."""

import importlib
import json
import os
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Iterable, Iterator

import numpy as np

from .. import _arrays
from ..errors import GraspmillError, InputError, OutsideError


def number(value: Any) -> str:
    """The shortest decimal of a number in its own precision, without an exponent: ``0.1`` of ``float32(0.1)``."""
    return str(value) if isinstance(value, (int, np.integer)) else np.format_float_positional(value, trim="-")


def joined(values: Iterable[Any], between: str = " ") -> str:
    return between.join(map(number, values))


def as_json(value: Any, line: str = "\n") -> str:
    """Indented JSON, whose numbers of single precision are the shortest that are the same in single precision."""
    inner = line + "  "
    if isinstance(value, dict):
        items = [f"{json.dumps(key)}: {as_json(one, inner)}" for key, one in value.items()]
    elif isinstance(value, (list, tuple, np.ndarray)):
        items = [as_json(one, inner) for one in value]
    elif isinstance(value, (float, np.floating)):
        least = 1e-6 if isinstance(value, np.float32) else 1e-5
        if value and abs(float(value)) < least:
            return np.format_float_scientific(value, trim="-", exp_digits=1)
        return np.format_float_positional(value, trim="0")
    else:
        return json.dumps(value, ensure_ascii=False)
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return opening + inner + f",{inner}".join(items) + line + closing if items else opening + closing


def part(path: Path) -> Path:
    """The name of a file or a folder until it is whole; what was killed begins it anew."""
    return path.with_name(f"{path.name}.part")


def finish(path: Path) -> None:
    with open(part(path), "rb+") as file:
        os.fsync(file.fileno())
    os.replace(part(path), path)


def write(path: Path, content: str | bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part(path).write_bytes(content.encode() if isinstance(content, str) else content)
    finish(path)


@contextmanager
def whole(file: str) -> Iterator[str]:
    """The path where a file is to be written: it is moved to its place, where an old one stays until the new one is whole."""
    folder, name = os.path.split(file)
    _arrays.must(os.path.isdir(folder or ".") and not os.path.isdir(file), f"path must be a file in a folder that exists, got {file}")
    beside = Path(folder, f".{name}.{os.getpid()}.part")
    try:
        with outside(Path(file)):
            yield str(beside)
            os.replace(beside, file)
    finally:
        beside.unlink(missing_ok=True)


def module(name: str, what: str, extra: str = "grasps") -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        pip = {"yaml": "pyyaml"}.get(name, name.partition(".")[0])
        raise InputError(f"{what} needs {pip}: pip install graspmill[{extra}]") from error


def yaml_for(text: bytes, what: str) -> tuple[Any, Any]:
    """PyYAML and its fastest safe loader. Aliases are refused: with them 700 bytes are more than any memory holds."""
    yaml = module("yaml", what)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    has_aliases = b"*" in text and any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, loader))
    _arrays.must(not has_aliases, "the file must be YAML without aliases (*name)")
    return yaml, loader


def loaded_json(path: str) -> Any:
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the file must be JSON, got {error}") from error


@contextmanager
def outside(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if isinstance(error, GraspmillError):
            raise
        is_wrong = isinstance(error, (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError))
        raise (InputError if is_wrong else OutsideError)(f"failed to write to {path}: {error}") from error
