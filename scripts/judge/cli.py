"""The command line."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from crosscheck import engines
from crosscheck.cli import CONFIG, DATA, OK, positive
from crosscheck.dataset import Dataset

from . import execution, experiment
from .report import as_json, markdown, report_of

EPILOG = """\
examples:
  python scripts/judge_pybullet.py runs/pile --rounds 20
  python scripts/judge_pybullet.py runs/pile --jobs 8 --report runs/pile/judge.md --json runs/pile/judge.json

exit codes:
   0  done (whatever the agreement)
   2  wrong command line
  65  the experiment's files are damaged, or hold no grasps
  78  no experiment there, or one without run.json and objects.parquet, or PyBullet is not installed
"""


def main(arguments: list[str] | None = None) -> int:
    """Judges an experiment; gives the exit code."""
    args = _parser().parse_args(arguments)
    try:
        tried = experiment.read(args.experiment, args.rounds)
        engine = _engine(tried.data)
    except experiment.NoExperiment as error:
        return _fail(CONFIG, str(error))
    except experiment.DamagedExperiment as error:
        return _fail(DATA, str(error))
    except ModuleNotFoundError as error:
        return _fail(CONFIG, f"{error}; pip install -r scripts/requirements.txt")
    report = report_of(tried, execution.judge(tried.data, args.jobs), engine, _command(arguments))
    text = markdown(report)
    for path, content in ((args.report, text), (args.json, json.dumps(as_json(report), indent=1) + "\n")):
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
    print(text, end="")
    return OK


def _engine(data: Dataset) -> dict:
    """What judges: the settings depend on the hand."""
    engine = engines.make("pybullet")
    engine.load(data.scenes[0], data.hand_of(data.scenes[0]), data.environment)
    described = engines.describe(engine)
    engine.close()
    return described


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="judge_pybullet.py", description="Execute the grasps of an experiment again in PyBullet, and compare how they end.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("experiment", type=Path, metavar="DIR", help="folder of `graspmill experiment run CONFIG --out DIR`")
    parser.add_argument("--rounds", type=positive, metavar="N", help="only the first N rounds [default: all]")
    parser.add_argument("--jobs", type=positive, default=1, metavar="N", help="processes; changes nothing but the time [default: 1]")
    parser.add_argument("--report", type=Path, metavar="F.md", help="also write the report here")
    parser.add_argument("--json", type=Path, metavar="F.json", help="write everything as JSON")
    return parser


def _command(arguments: list[str] | None) -> str:
    return " ".join(["python scripts/judge_pybullet.py", *(sys.argv[1:] if arguments is None else arguments)])


def _fail(code: int, message: str) -> int:
    print(f"judge_pybullet: {message}", file=sys.stderr)
    return code
