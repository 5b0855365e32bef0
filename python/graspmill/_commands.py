"""Commands of the program that read or write formats of others, wholly or before the native half goes on."""

from __future__ import annotations

import argparse
import sys
from typing import Callable

from .errors import GraspmillError

_OBJECTS = (["objects", "import"], ["objects", "annotate"])


def run(words: list[str]) -> int | None:
    """Runs the command that the words name; returns its exit code, or ``None`` if it is the native half's alone."""
    is_help = bool({"-h", "--help"} & set(words))
    if words[:2] == ["weights", "export"] and not is_help and {"onnx", "--format=onnx"} & set(words):
        return ended(lambda: _export_onnx(words[2:]), "stopped")
    if words[:2] in _OBJECTS and not is_help:
        from .formats.objects import run_native

        return ended(lambda: run_native(words), "stopped")
    if "plan" in words[:2] and not is_help:
        from .formats import captures

        return ended(lambda: captures.run_native(words), "stopped")
    return None


def ended(work: Callable[[], int], stopped: str = "stopped; the same command continues", before: str = "") -> int:
    """The exit code of a command's work; what ends it otherwise is said, after what ends a line of progress."""
    try:
        return work()
    except KeyboardInterrupt:
        why, code = stopped, 75
    except GraspmillError as error:
        why, code = str(error), error.exit_code
    print(f"{before}error: {why}", file=sys.stderr)
    return code


def _export_onnx(words: list[str]) -> int:
    from .formats.weights import onnx

    parser = argparse.ArgumentParser("graspmill weights export", allow_abbrev=False)
    parser.add_argument("checkpoint")
    parser.add_argument("--format", required=True, choices=["onnx"])
    parser.add_argument("--out", required=True)
    parser.add_argument("--force", action="store_true")
    given = parser.parse_args(words)
    print(f"{onnx.write(given.checkpoint, given.out, given.force)}\nwritten     {given.out}")
    return 0
