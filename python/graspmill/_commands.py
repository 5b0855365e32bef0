"""Commands that meet formats or planners of others: all of them, or what comes before the native half."""

import argparse
import os
import shlex
import signal
import sys
import tempfile
from pathlib import Path
from typing import Callable

from . import _arrays, _native, formats
from .dataset import Dataset
from .errors import GraspmillError, InputError
from .experiments import check_keys, play
from .formats import captures
from .formats import grasps as grasp_files
from .formats._files import module
from .formats.objects import run_native
from .grippers import Gripper
from .object_grasps import ObjectGrasps


def run(words: list[str]) -> int | None:
    """Runs the command that the words name; returns its exit code, or ``None`` if it is the native half's alone."""
    given = {*words, *(word.partition("=")[0] for word in words)}
    for names, needed, command in COMMANDS:
        is_ours = needed is None or (not {"-h", "--help"} & given and bool(not needed or needed & given))
        if is_ours and any(words[: len(name.split())] == name.split() for name in names):
            return ended(lambda: command(words))
    return None


def ended(work: Callable[[], int]) -> int:
    """The exit code of a command's work; what ends it otherwise is said in place of the progress."""
    try:
        return work()
    except KeyboardInterrupt:
        why, code = "stopped; the same command continues", 75
    except GraspmillError as error:
        why, code = str(error), error.exit_code
    _progress("")
    print(f"error: {why}", file=sys.stderr)
    return code


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


EXPORT = "Write the dataset as the files that VGN's and GIGA's code trains on, or its scenes for simulators."
EXAMPLES = """Examples:
  graspmill dataset export grasps --format vgn --out grasps-vgn
  graspmill dataset export s3://bucket/grasps --format vgn --out grasps-vgn
  graspmill dataset export grasps --format mjcf --scenes 0-9,17 --out grasps-mujoco    a folder a scene

An interrupted export continues when it is run again. docs/exporting.md describes the files and how to read them."""


def _export(words: list[str]) -> int:
    kind = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("graspmill dataset export", None, EXPORT, EXAMPLES, formatter_class=kind, allow_abbrev=False)
    parser.add_argument("dataset", metavar="DATASET", help="the dataset's folder or URL")
    simulators = "scenes for MuJoCo (mjcf), for PyBullet and others (urdf), for Isaac Sim and others (usda)"
    what = f"what VGN and GIGA read, or {simulators}"
    parser.add_argument("--format", required=True, choices=formats.FORMATS, help=what)
    parser.add_argument("--scenes", metavar="N,FIRST-LAST", help="only these scenes, such as 0-9,17; of mjcf, urdf and usda")
    where = "a new or an empty folder, or that of the same export, interrupted: it continues there"
    parser.add_argument("--out", required=True, help=where)
    given, ready = parser.parse_args(words[2:]), 0

    def done(scenes: int) -> None:
        nonlocal ready
        ready += scenes
        _progress(f"{ready:,} scenes")

    chosen = None if given.scenes is None else formats.selected(given.scenes)
    counts = formats.export(Dataset(given.dataset), given.format, given.out, chosen, done)["counts"]
    told = {key: f"{count:,}" for key, count in counts.items()}
    _progress("")
    print(f"{told['grasps']} grasps ({told['positives']} positive) in {told['scenes']} scenes: {given.out}")
    if counts["left_out"]:
        print(f"left out: {told['left_out']} grasps outside the grid or near its faces, {told['scenes_left_out']} scenes without others")
    return 0


def _experiment(words: list[str]) -> int:
    from ._served import ServedPlanner

    parser = argparse.ArgumentParser("graspmill experiment run", add_help=False, allow_abbrev=False)
    parser.add_argument("config", type=Path)
    parser.add_argument("--out", required=True, type=Path)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--planner", required=True)
    parser.add_argument("--planner-timeout-s", default=60, type=int)
    parser.add_argument("--threads", default=os.cpu_count() or 1, type=int)
    for option, kind in (("--rounds", int), ("--seed", int), ("--tip-depth", float)):
        parser.add_argument(option, type=kind)
    given = parser.parse_args(words[2:])
    pairs = [(key.strip(), value.strip()) for key, _, value in (pair.partition("=") for pair in given.set)]
    pairs += [] if given.rounds is None else [("rounds", str(given.rounds))]
    pairs += [] if given.seed is None else [("seeds", f"[{given.seed}]")]
    check_keys(pairs)
    threads = _arrays.whole("--threads", given.threads, 1, 1024)
    # A job that ends its time is stopped by this signal.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    planner = ServedPlanner(given.planner, given.planner_timeout_s, given.tip_depth)
    command = shlex.join(["graspmill", *words])
    work = _native.Experiment(given.out, given.config, pairs, (planner.id, planner.who), command, threads)
    if doubt := planner.doubt(Gripper._of(work.gripper())):
        print(f"warning: {doubt}", file=sys.stderr)
    in_short = play(work, planner, lambda done, total, held: _progress(f"{done:,} of {total:,} rounds, {held:,} grasps held"))
    _progress("")
    print(f"{given.out / 'report.html'}  failures and how it was run; also report.json and tables as Parquet\n\n{in_short}", end="")
    return 0


def _export_onnx(words: list[str]) -> int:
    from .formats.weights import onnx

    what = "Write a network of voxels, or a judge, for ONNX runtimes; its description in the file says what goes in and comes out."
    parser = argparse.ArgumentParser("graspmill weights export", description=what, allow_abbrev=False)
    parser.add_argument("checkpoint", metavar="CHECKPOINT", help="such as RUN/best.safetensors")
    parser.add_argument("--format", required=True, choices=["onnx"], help="what to write")
    parser.add_argument("--out", required=True, help="the file to write")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    given = parser.parse_args(words[2:])
    onnx.write(given.checkpoint, given.out, given.force)
    print(f"written     {given.out}")
    return 0


#: Formats of grasps whose files say how many metres a unit of the mesh is.
WITH_SCALE = ("acronym", "graspgen", "isaac_grasp")
#: What ends the name of a file: the format, and the first of its endings.
ENDINGS = {form: next(f".{form}{ending}" for ending, of in grasp_files.ENDINGS.items() if of == form) for form in grasp_files.WRITTEN}


def _annotate(words: list[str]) -> int:
    """``graspmill objects annotate`` with files of others: the native command labels grasps, Python reads and writes them."""
    parser = argparse.ArgumentParser("graspmill objects annotate", add_help=False, allow_abbrev=False)
    for option in ("--format", "--relabel", "--out", "--scale"):
        parser.add_argument(option)
    parser.add_argument("--gripper", default="parallel_jaw_80")
    given, native = parser.parse_known_args(words)
    chosen = [name for name in (given.format or "parquet").split(",") if name != "parquet"]
    for name in chosen:
        _arrays.must(name in ENDINGS, f"--format must be some of {', '.join(ENDINGS)}, got {name}")
        # Known before the work rather than after it.
        module("h5py" if name == "acronym" else "pyarrow.parquet", "--format")
    with tempfile.TemporaryDirectory() as folder:
        if given.relabel is not None:
            table, scale = _neutral(given.relabel, given.gripper, folder)
            native += ["--relabel", table]
            given.scale = scale if given.scale is None else given.scale
        for option in ("gripper", "out", "scale"):
            native += [] if getattr(given, option) is None else [f"--{option}", getattr(given, option)]
        code = run_native(native)
    if given.out is None or code not in (0, 66):  # the sets are there, all or those of the inputs that could be used
        return code
    for about in filter(Path.is_file, sorted(Path(given.out).glob("*.json"))):
        grasps, since = about.with_suffix(".parquet"), about.stat().st_mtime
        missing = [about.with_name(about.stem + ENDINGS[name]) for name in chosen]
        missing = [file for file in missing if file.is_symlink() or not (file.is_file() and file.stat().st_size and file.stat().st_mtime >= since)]
        if missing and grasps.exists():
            made = ObjectGrasps.load(grasps)
            for file in missing:
                made.save(file)
    return code


def _neutral(file: str, gripper: str, folder: str) -> tuple[str, str | None]:
    """A table in a folder with the grasps of a file, as the native command reads them, and the file's scale, if it has one."""
    if file.endswith(".parquet"):
        return file, None
    try:
        grasps = grasp_files.read(file)
    except InputError:
        # The file may not say where the gripper's tips are.
        grasps = grasp_files.read(file, gripper=gripper)
    arrow, parquet = module("pyarrow", "--relabel"), module("pyarrow.parquet", "--relabel")
    numbers = [*grasps.object_from_grasp[:, :3, 3].T, *_arrays.quaternions(grasps.object_from_grasp[:, :3, :3]).T]
    columns = {name: arrow.array(column, arrow.float32()) for name, column in zip(("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"), numbers)}
    table = os.path.join(folder, "given.parquet")
    parquet.write_table(arrow.table(columns), table, compression="zstd")
    return table, repr(grasps.scale_m) if grasps.info["format"] in WITH_SCALE else None


#: Commands by their words and by those of earlier versions; the options of which one must be given, where a command is
#: not wholly ours; and what does it. The first that fits does it.
COMMANDS: list[tuple[tuple[str, ...], set[str] | None, Callable[[list[str]], int]]] = [
    (("dataset export",), None, _export),
    (("experiment run",), {"--planner"}, _experiment),
    (("weights export", "trainer export"), None, _export_onnx),
    (("objects annotate",), {"--format", "--relabel"}, _annotate),
    (("objects import", "objects annotate"), set(), run_native),
    (("plan",), {"--cloud", "--object", "--intrinsics"}, captures.run_native),
]
