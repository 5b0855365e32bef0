#!/usr/bin/env python3
"""How much data, and of what, a judge needs: one training for each answer, tried on unseen scenes and in the closed loop.

    python lab/data_curve.py OUT [--programs DIR] [--figure FILE.svg] [--only NAME…] [--small]

Each row of STUDIES differs from the first in one thing. For each, attempts are executed (seed 7401), a judge is trained (8 epochs,
seed 1), evaluated on three datasets of unseen scenes (seed 7402), and clears 100 piles seen from six sides and 100 seen by one noisy
camera at the side (seed 7403). Finished parts are not repeated; interrupted ones go on. Writes OUT/data-curve.json and prints a
table; the figure needs matplotlib. All takes about two hours on two cores; --small (a tenth of the attempts, two epochs, ten rounds)
tries the script in some minutes.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ATTEMPTS = 200_000
EPOCHS = 8
ROUNDS = 100
TEST_ATTEMPTS = 20_000
# configs/generate/judge.toml's shares, without a judge's choices (which are proposals without a policy).
SHARES = {"rules": 0.3, "normals": 0.15, "proposals": 0.4, "displaced": 0.15}


def without(source: str) -> list[str]:
    """Settings of a dataset without a source, the others in their proportions."""
    left = {name: share for name, share in SHARES.items() if name != source}
    total = sum(left.values())
    shares = {name: round(left.get(name, 0.0) / total, 9) for name in SHARES}
    shares[max(left, key=left.get)] += 1.0 - sum(shares.values())  # they must make 1
    return [f"shares.{name}={share!r}" for name, share in {**shares, "judged": 0.0}.items()]


# Name, figure, label on its axis, attempts, settings of the generator.
STUDIES = [
    ("base", "attempts", "200,000", ATTEMPTS, []),
    ("attempts-20k", "attempts", "20,000", ATTEMPTS // 10, []),
    ("attempts-2m", "attempts", "2,000,000", ATTEMPTS * 10, []),
    ("scene-12", "attempts a scene", "12", ATTEMPTS, ["attempts_per_scene=12"]),
    ("scene-240", "attempts a scene", "240", ATTEMPTS, ["attempts_per_scene=240"]),
    ("no-rules", "left out", "rules", ATTEMPTS, without("rules")),
    ("no-normals", "left out", "normals", ATTEMPTS, without("normals")),
    ("no-proposals", "left out", "proposals", ATTEMPTS, without("proposals")),
    ("no-displaced", "left out", "displaced", ATTEMPTS, without("displaced")),
    ("clean", "images", "clean", ATTEMPTS, ["sensor.noise_weights=[1.0, 0.0, 0.0, 0.0]"]),
    ("noisy", "images", "noisy", ATTEMPTS, ["sensor.noise_weights=[0.0, 1.0, 1.5, 2.5]"]),
    ("hands", "hands", "many", ATTEMPTS, ["gripper=any_jaw"]),
]
# What the first training is called in each figure, and where it stands among the others.
BASE = {
    "attempts": ("200,000", 1),
    "attempts a scene": ("60", 1),
    "left out": ("nothing", 0),
    "images": ("both", 1),
    "hands": ("one", 0),
}
TESTS = {
    "mixture": ("judge", []),
    "normals": ("vgn", []),
    "everyday": ("everyday", []),
}
LOOPS = {
    "six": ("pile", []),
    "side": ("giga-pile", []),
}


def run(*command: object) -> None:
    """Runs a program quietly; its messages appear if it fails."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"exit code {done.returncode}: {' '.join(words)}\n{done.stderr[-2000:]}")


def pairs(settings: list[str]) -> list[str]:
    return [word for setting in settings for word in ("--set", setting)]


def study(out: Path, programs: Path, name: str, attempts: int, settings: list[str], size: "Size") -> dict:
    """Makes one judge and returns its results."""
    data, judge = out / f"data-{name}", out / f"judge-{name}"
    weights = judge / "best.safetensors"
    if not (judge / "done").exists():
        generate = ROOT / "configs/generate/judge.toml"
        shards = max(1, min(64, attempts // 6000))
        run(programs / "generator", "--config", generate, "--attempts", attempts, "--shards", shards, "--seed", 7401,
            "--out", data, *pairs(settings))
        train = ROOT / "configs/train/judge.toml"
        run(programs / "trainer", "fit", "--resume", "--config", train, "--epochs", size.epochs, "--data", data, "--run", judge)
        (judge / "done").touch()
    results: dict = {"attempts": attempts}
    for test in TESTS:
        report = out / f"{test}-{name}"
        path = report / "evaluation.json"
        if not path.exists():
            run(programs / "trainer", "evaluate", "--model", weights, "--data", out / f"test-{test}", "--split", "all",
                "--report", report)
        hands = json.loads(path.read_text())["hands"]
        results[test] = {"value": hands["table_free"]["average_precision"], "95": hands["average_precision_95_by_scene"]}
    for loop, (config, more) in LOOPS.items():
        folder = out / f"{loop}-{name}"
        path = folder / "report.json"
        if not path.exists():
            run(programs / "experiments", "run", ROOT / f"configs/experiment/{config}.toml", "--out", folder, "--seed", 7403,
                "--rounds", size.rounds, "--set", f"model={weights}", *pairs(more))
        rates = json.loads(path.read_text())["results"]["rates"]
        for rate, key in (("held", "success_rate"), ("cleared", "cleared_share")):
            value = rates[key]
            results[f"{loop}-{rate}"] = {"value": value["value"], "95": [value["low"], value["high"]]}
    return results


class Size:
    """How much of everything."""

    def __init__(self, small: bool) -> None:
        self.share = 10 if small else 1
        self.epochs = 2 if small else EPOCHS
        self.rounds = 10 if small else ROUNDS


def table(results: dict) -> str:
    """All results in Markdown: average precision, then grasps that held and objects cleared, in per cent."""
    heads = ["", "mixture", "normals", "everyday", "six views: held", "cleared", "one noisy side view: held", "cleared"]
    keys = ["mixture", "normals", "everyday", "six-held", "six-cleared", "side-held", "side-cleared"]
    rows = [heads, ["---"] + ["---:"] * (len(heads) - 1)]
    for name, result in results.items():
        cells = []
        for key in keys:
            value, (low, high) = result[key]["value"], result[key]["95"]
            cells.append(f"{value:.3f} ({low:.3f} to {high:.3f})" if key in TESTS
                         else f"{100 * value:.1f} ({100 * low:.1f} to {100 * high:.1f})")
        rows.append([name, *cells])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def draw(results: dict, path: Path) -> None:
    """One column of panels for each question: average precision above, the closed loop below."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "graspmill", "font.size": 9})
    import matplotlib.pyplot as plt

    widths = [3, 3, 5, 3, 2]
    figure, axes = plt.subplots(2, len(BASE), figsize=(13, 5.4), sharey="row", width_ratios=widths, layout="constrained")
    series = [
        [("mixture", "as trained", "#0072b2"), ("normals", "VGN's normals", "#d55e00"), ("everyday", "everyday objects", "#009e73")],
        [("six-held", "six clean views: held", "#0072b2"), ("six-cleared", "cleared", "#56b4e9"),
         ("side-held", "one noisy side view: held", "#d55e00"), ("side-cleared", "cleared", "#e69f00")],
    ]
    for column, (question, (label, place)) in enumerate(BASE.items()):
        points = [(of_label, results[name]) for name, of, of_label, *_ in STUDIES[1:] if of == question and name in results]
        if "base" in results:
            points.insert(place, (label, results["base"]))
        for row, lines in enumerate(series):
            ax = axes[row][column]
            for number, (key, text, colour) in enumerate(lines):
                scale = 1 if row == 0 else 100
                xs = [x + 0.12 * (number - (len(lines) - 1) / 2) for x in range(len(points))]
                ys = [scale * result[key]["value"] for _, result in points]
                bars = [[abs(y - scale * result[key]["95"][end]) for y, (_, result) in zip(ys, points)] for end in (0, 1)]
                ax.errorbar(xs, ys, yerr=bars, fmt="o", color=colour, markersize=4, capsize=2, label=text)
            ax.set_xticks(range(len(points)), [of_label for of_label, _ in points], fontsize=8)
            ax.set_xlim(-0.5, max(len(points) - 0.5, 0.5))
            ax.grid(axis="y", alpha=0.3)
        axes[1][column].set_xlabel(question)
    axes[0][0].set_ylabel("average precision")
    axes[1][0].set_ylabel("per cent")
    for row in range(2):
        axes[row][-1].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False)
    figure.savefig(path, metadata={"Date": None})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--programs", type=Path, default=ROOT / "target/release")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--small", action="store_true")
    arguments = parser.parse_args()
    size = Size(arguments.small)
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    for test, (config, settings) in TESTS.items():
        run(arguments.programs / "generator", "--config", ROOT / f"configs/generate/{config}.toml", "--attempts",
            TEST_ATTEMPTS // size.share, "--shards", 4, "--seed", 7402, "--out", out / f"test-{test}", *pairs(settings))
    results = {}
    for name, _, _, attempts, settings in STUDIES:
        if arguments.only and name not in arguments.only:
            continue
        print(name, file=sys.stderr, flush=True)
        results[name] = study(out, arguments.programs, name, attempts // size.share, settings, size)
        (out / "data-curve.json").write_text(json.dumps(results, indent=2) + "\n")
    print(table(results))
    if arguments.figure:
        draw(results, arguments.figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
