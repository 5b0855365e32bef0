"""The program: ``graspmill plan …``, or ``python -m graspmill plan …``. What meets files and programs of others is Python's,
all else native."""

from __future__ import annotations

import argparse
import sys
from typing import Callable

EXPORT = "Write the dataset as the files that VGN's and GIGA's code trains on, as Parquet for old readers, or its scenes for simulators."
EXAMPLES = """Examples:
  graspmill dataset export grasps --format vgn --out grasps-vgn
  graspmill dataset export s3://bucket/grasps --format vgn --out grasps-vgn
  graspmill dataset export grasps --format parquet --out grasps-plain    for old polars and fastparquet
  graspmill dataset export grasps --format mjcf --scenes 0-9,17 --out grasps-mujoco    a folder a scene

An interrupted export continues when it is run again. docs/exporting.md describes the files and how to read them."""


def main() -> int:
    """Runs the command that the arguments name; returns its exit code."""
    if sys.argv[1:3] == ["dataset", "export"]:
        return _export(sys.argv[3:])
    if sys.argv[1:3] == ["experiment", "run"] and _asks_another(sys.argv[3:]):
        return _experiment(sys.argv[3:])
    from graspmill import _annotate_command, _commands, _native

    if _annotate_command.is_ours(sys.argv[1:]):
        return _annotate_command.run(sys.argv[3:])
    code = _commands.run(sys.argv[1:])
    return code if code is not None else _native.run_program(["graspmill", *sys.argv[1:]])


def _export(words: list[str]) -> int:
    from graspmill import Dataset, GraspmillError, formats
    from graspmill._commands import ended

    def scenes(text: str) -> list[range]:
        try:
            return formats.selected(text)
        except GraspmillError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    kind = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("graspmill dataset export", None, EXPORT, EXAMPLES, formatter_class=kind, allow_abbrev=False)
    parser.add_argument("dataset", metavar="DATASET", help="the dataset's folder or URL")
    simulators = "scenes for MuJoCo (mjcf), for PyBullet and others (urdf), for Isaac Sim and others (usda)"
    what = f"what VGN and GIGA read; Parquet in the plain encoding; or {simulators}"
    parser.add_argument("--format", required=True, choices=formats.FORMATS, help=what)
    parser.add_argument("--scenes", metavar="N,FIRST-LAST", type=scenes, help="only these scenes, such as 0-9,17; of mjcf, urdf and usda")
    where = "a new or an empty folder, or that of the same export, interrupted: it continues there"
    parser.add_argument("--out", required=True, help=where)
    given, ready, is_seen = parser.parse_args(words), 0, sys.stderr.isatty()

    def done(scenes: int) -> None:
        nonlocal ready
        ready += scenes
        if is_seen:
            print(f"\r{ready:,} scenes", end="", file=sys.stderr, flush=True)

    def work() -> int:
        counts = formats.export(Dataset(given.dataset), given.format, given.out, given.scenes, done)["counts"]
        told = {key: f"{count:,}" for key, count in counts.items()}
        print("\r" * is_seen + f"{told['grasps']} grasps ({told['positives']} positive) in {told['scenes']} scenes: {given.out}")
        if counts["left_out"]:
            print(f"left out: {told['left_out']} grasps outside the grid or near its faces, {told['scenes_left_out']} scenes without others")
        return 0

    return ended(work)


def _asks_another(words: list[str]) -> bool:
    """Whether an experiment is to ask the planner of others; the native program has the help."""
    return any(word.partition("=")[0] == "--planner" for word in words) and not {"-h", "--help"} & {*words}


def _experiment(words: list[str]) -> int:
    import os
    import shlex
    import signal
    from pathlib import Path

    from graspmill import _native
    from graspmill._commands import ended
    from graspmill._served import ServedPlanner
    from graspmill.experiments import play

    def between(kind: type[int] | type[float], low: float, high: float) -> Callable[[str], float]:
        def read(text: str) -> float:
            if not low <= (value := kind(text)) <= high:
                raise argparse.ArgumentTypeError(f"must be between {low} and {high}, got {text}")
            return value

        return read

    def pair(text: str) -> tuple[str, str]:
        key, sign, value = text.partition("=")
        if not sign:
            raise argparse.ArgumentTypeError(f"must be KEY=VALUE, got {text}")
        return key.strip(), value.strip()

    parser = argparse.ArgumentParser("graspmill experiment run", add_help=False, allow_abbrev=False)
    parser.add_argument("config", type=Path)
    parser.add_argument("--out", required=True, type=Path)
    parser.add_argument("--set", action="append", default=[], type=pair)
    parser.add_argument("--rounds", type=between(int, 1, 1_000_000))
    parser.add_argument("--seed", type=between(int, 0, 2**64 - 1))
    parser.add_argument("--planner", required=True)
    parser.add_argument("--tip-depth", type=between(float, -1, 1))
    parser.add_argument("--planner-timeout-s", default=60, type=between(int, 1, 3600))
    parser.add_argument("--threads", default=os.cpu_count() or 1, type=between(int, 1, 1024))
    given, is_seen = parser.parse_args(words), sys.stderr.isatty()
    pairs = [*given.set, *([("rounds", str(given.rounds))] * bool(given.rounds))]
    pairs += [("seeds", f"[{given.seed}]")] * (given.seed is not None)

    def told(done: int, total: int, held: int) -> None:
        if is_seen:
            print(f"\r{done:,} of {total:,} rounds, {held:,} grasps held", end="", file=sys.stderr, flush=True)

    # A job that ends its time is stopped by this signal.
    signal.signal(signal.SIGTERM, signal.default_int_handler)

    def work() -> int:
        planner = ServedPlanner(given.planner, given.planner_timeout_s, given.tip_depth)
        command = shlex.join(["graspmill", *sys.argv[1:]])
        in_short = play(_native.Experiment(given.out, given.config, pairs, planner.id, command, given.threads), planner, told)
        page = given.out / "report.html"
        print("\r" * is_seen + f"{page}  failures and how it was run; also report.json and tables as Parquet\n\n{in_short}", end="")
        return 0

    return ended(work, before="\n" * is_seen)


if __name__ == "__main__":
    sys.exit(main())
