"""``graspmill objects annotate`` with files of others: the native command labels grasps, Python reads and writes them."""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

from ._arrays import quaternions
from ._commands import ended
from .errors import InputError
from .formats import grasps as grasp_files
from .formats._files import module
from .formats.objects import run_native
from .object_grasps import ObjectGrasps

#: Exit codes after which the sets are there: all, or those of the inputs that could be used.
WHOLE = (0, 66)
#: Formats whose files say how many metres a unit of the mesh is.
WITH_SCALE = ("acronym", "graspgen", "isaac_grasp")
#: A format, and what ends the name of its file: the first of its endings.
ENDINGS: dict[str, str] = {
    form: next(f".{form}{ending}" for ending, of in grasp_files.ENDINGS.items() if of == form) for form in grasp_files.WRITTEN
}


def is_ours(words: list[str]) -> bool:
    """Whether a command has one of the options that the native command leaves to Python."""
    return words[:2] == ["objects", "annotate"] and any(word.split("=")[0] in ("--format", "--relabel") for word in words)


def run(words: list[str]) -> int:
    """Runs ``graspmill objects annotate`` with these words after it; returns its exit code."""
    parser = argparse.ArgumentParser("graspmill objects annotate", add_help=False, allow_abbrev=False)
    for option in ("--format", "--relabel", "--out"):
        parser.add_argument(option)
    parser.add_argument("--gripper", default="parallel_jaw_80")
    given, rest = parser.parse_known_args(words)
    native = ["objects", "annotate", *rest, "--gripper", given.gripper]
    native += [] if given.out is None else ["--out", given.out]

    def work() -> int:
        nonlocal native
        formats = _formats(given.format)
        with tempfile.TemporaryDirectory() as folder:
            if given.relabel is not None:
                native += _neutral(given.relabel, given.gripper, folder, has_scale=any(word.split("=")[0] == "--scale" for word in rest))
            code = run_native(native)
        if code in WHOLE and given.out is not None:
            _convert(Path(given.out), formats)
        return code

    return ended(work)


def _formats(names: str | None) -> list[str]:
    formats = [] if names is None else [name for name in names.split(",") if name != "parquet"]
    for name in formats:
        if name not in ENDINGS:
            raise InputError(f"--format must be some of {', '.join(ENDINGS)}, got {name}")
        # Known before the work rather than after it.
        module("h5py" if name == "acronym" else "pyarrow.parquet", "--format")
    return formats


def _neutral(file: str, gripper: str, folder: str, *, has_scale: bool) -> list[str]:
    """The native command's words for the grasps of a file, which it reads from a table in a folder."""
    if file.endswith(".parquet"):
        return ["--relabel", file]
    try:
        grasps = grasp_files.read(file)
    except InputError:
        # The file may not say where the hand's tips are.
        grasps = grasp_files.read(file, gripper=gripper)
    arrow, parquet = module("pyarrow", "--relabel"), module("pyarrow.parquet", "--relabel")
    turned = quaternions(grasps.object_from_grasp[:, :3, :3])
    numbers = [*grasps.object_from_grasp[:, :3, 3].T, *turned.T]
    columns = {name: arrow.array(column, arrow.float32()) for name, column in zip(("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"), numbers)}
    if grasps.held is not None:
        columns["held"] = arrow.array(grasps.held.astype("uint64"))
    table = os.path.join(folder, "given.parquet")
    parquet.write_table(arrow.table(columns), table, compression="zstd")
    scale = [] if has_scale or grasps.info["format"] not in WITH_SCALE else ["--scale", repr(grasps.scale_m)]
    return ["--relabel", table, *scale]


def _convert(out: Path, formats: list[str]) -> None:
    """Writes the sets of a folder in these forms, unless an earlier run did."""
    for about in sorted(out.glob("*.json")):
        table = about.with_suffix(".parquet")
        missing = [out / f"{about.stem}{ENDINGS[name]}" for name in formats]
        missing = [file for file in missing if not file.exists() or file.stat().st_mtime < about.stat().st_mtime]
        if table.exists() and missing:
            grasps = ObjectGrasps.load(table)
            for file in missing:
                grasps.save(file)
