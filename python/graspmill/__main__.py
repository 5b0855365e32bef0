"""The program: ``graspmill plan …``, or ``python -m graspmill plan …``. The export of datasets and files of others' grasps
are Python's, all else native."""

from __future__ import annotations

import argparse
import sys

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
    from graspmill import _annotate_command, _native

    if _annotate_command.is_ours(sys.argv[1:]):
        return _annotate_command.run(sys.argv[3:])
    return _native.run_program(["graspmill", *sys.argv[1:]])


def _export(words: list[str]) -> int:
    from graspmill import Dataset, GraspmillError, formats

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

    try:
        counts = formats.export(Dataset(given.dataset), given.format, given.out, given.scenes, done)["counts"]
        told = {key: f"{count:,}" for key, count in counts.items()}
        print("\r" * is_seen + f"{told['grasps']} grasps ({told['positives']} positive) in {told['scenes']} scenes: {given.out}")
        if counts["left_out"]:
            print(f"left out: {told['left_out']} grasps outside the grid or near its faces, {told['scenes_left_out']} scenes without others")
        return 0
    except KeyboardInterrupt:
        why, code = "stopped; the same command continues", 75
    except GraspmillError as error:
        why, code = str(error), error.exit_code
    print(f"error: {why}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
