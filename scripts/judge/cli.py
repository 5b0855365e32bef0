"""The command line."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from crosscheck import engines, passes
from crosscheck.cli import command, guarded, positive, write

from . import experiment
from .report import as_json, markdown, report_of

EPILOG = """\
examples:
  python scripts/judge_pybullet.py runs/pile --rounds 20
  python scripts/judge_pybullet.py runs/pile --report runs/pile/judge.md --json runs/pile/judge.json

exit codes:
   0  done (whatever the agreement)
   2  wrong command line
  65  the experiment's files are damaged, or hold no grasps
  78  no experiment there, or one without run.json and objects.parquet, or PyBullet is not installed
"""


def main(arguments: list[str] | None = None) -> int:
    """Judges an experiment; gives the exit code."""
    args = _parser().parse_args(arguments)

    def work() -> None:
        tried = experiment.read(args.experiment, args.rounds)
        engine = engines.make("pybullet")
        theirs, drift = passes.same_gate("pybullet", tried.data, engine), passes.drift(tried.data, engine)
        about = engines.describe(engine)  # its settings depend on the gripper
        engine.close()
        report = report_of(tried, theirs, drift, about, command("judge_pybullet", arguments))
        text = markdown(report)
        write({args.report: text, args.json: json.dumps(as_json(report), indent=1) + "\n"})
        print(text, end="")

    return guarded("judge_pybullet", work)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="judge_pybullet.py", description="Execute the grasps of an experiment again in PyBullet, and compare how they end.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("experiment", type=Path, metavar="DIR", help="folder of `graspmill experiment run CONFIG --out DIR`")
    parser.add_argument("--rounds", type=positive, metavar="N", help="only the first N rounds [default: all]")
    parser.add_argument("--report", type=Path, metavar="F.md", help="also write the report here")
    parser.add_argument("--json", type=Path, metavar="F.json", help="write everything as JSON")
    return parser
