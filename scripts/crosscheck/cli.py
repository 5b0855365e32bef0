"""The command line."""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

from . import dataset, engines, experiment, passes
from .compare import Rows, compare, compare_gate, compare_passes, rows_of
from .report import EngineReport, Report, as_json, markdown, summary

OK, DATA, CONFIG = 0, 65, 78

EPILOG = """\
examples:
  python scripts/crosscheck.py data/grasps --scenes 50
  python scripts/crosscheck.py data/grasps --engine all --report runs/parity.md --json runs/parity.json
  python scripts/crosscheck.py runs/pile --scenes 20

exit codes:
   0  done (whatever the agreement)
   2  wrong command line
  65  the dataset or the experiment is damaged or of an unknown version
  78  neither of them is there, or an engine's package is not installed
"""


def main(arguments: list[str] | None = None) -> int:
    """Runs the cross-check; gives the exit code."""
    args = _parser().parse_args(arguments)

    def work() -> None:
        reader = experiment if experiment.is_one(args.dataset) else dataset
        data = reader.read(args.dataset, args.scenes)
        names = list(engines.ENGINES) if args.engine == "all" else [args.engine]
        report = run(data, names, args.seed, command("crosscheck", arguments))
        write({args.report: markdown(report), args.json: json.dumps(as_json(report), indent=1) + "\n"})
        print(summary(report))

    return guarded("crosscheck", work)


def guarded(program: str, work: Callable[[], None]) -> int:
    """Works; gives the exit code, and says what is wrong."""
    try:
        work()
        return OK
    except dataset.DamagedDataset as error:
        code, why = DATA, str(error)
    except dataset.NoDataset as error:
        code, why = CONFIG, str(error)
    except ModuleNotFoundError as error:
        code, why = CONFIG, f"{error}; pip install -r scripts/requirements.txt"
    print(f"{program}: {why}", file=sys.stderr)
    return code


def write(files: dict[Path | None, str]) -> None:
    """Writes those files that are asked for."""
    for path, content in files.items():
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)


def command(program: str, arguments: list[str] | None) -> str:
    """The command line, for a report."""
    return " ".join([f"python scripts/{program}.py", *(sys.argv[1:] if arguments is None else arguments)])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="crosscheck.py",
        description="Repeat the grasp attempts of a dataset or an experiment in another physics engine and compare the labels.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("dataset", type=Path, help="its folder, or that of `graspmill experiment run CONFIG --out DIR`")
    parser.add_argument("--scenes", type=positive, metavar="N", help="only the first N scenes, of an experiment rounds [default: all]")
    parser.add_argument("--engine", choices=[*engines.ENGINES, "all"], default="pybullet", help="[default: pybullet]")
    parser.add_argument("--report", type=Path, metavar="F.md", help="write a report")
    parser.add_argument("--json", type=Path, metavar="F.json", help="write everything as JSON")
    parser.add_argument("--seed", type=int, default=1, help="of the bootstrap [default: 1]")
    return parser


def positive(text: str) -> int:
    """A whole number above 0, for argparse."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def run(data: dataset.Dataset, names: list[str], seed: int, said: str = "") -> Report:
    """All passes of all engines, compared."""
    rows = rows_of(data)
    report = Report(said, data, rows, compare_gate(rows, passes.gate_pass(data)), {})
    for name in names:
        report.engines[name] = _examine(data, rows, name, seed)
    if len(names) > 1:
        _add_third(report, rows, seed)
    return report


def _examine(data: dataset.Dataset, rows: Rows, name: str, seed: int) -> EngineReport:
    engine = engines.make(name)
    drift = passes.drift(data, engine)
    same = passes.same_gate(f"{name}, same gate", data, engine)
    own = passes.own_approach(f"{name}, own approach", data, engine)
    described = engines.describe(engine)
    engine.close()
    return EngineReport(described, same, own, compare(rows, same, seed), compare(rows, own, seed), drift)


def _add_third(report: Report, rows: Rows, seed: int) -> None:
    for name, found in report.engines.items():
        report.third.append((f"ours, {name}", found.same.overall, found.same.closing))
    for a, b in combinations(report.engines, 2):
        both = compare_passes(rows, report.engines[a].same_gate, report.engines[b].same_gate, seed)
        report.third.append((f"{a}, {b}", *both))
    series = {"ours": rows.labels, **{name: found.same_gate.labels for name, found in report.engines.items()}}
    patterns = Counter(zip(*(labels.tolist() for labels in series.values())))
    for pattern, count in sorted(patterns.items()):
        report.patterns[", ".join(f"{name} {label}" for name, label in zip(series, pattern))] = count
