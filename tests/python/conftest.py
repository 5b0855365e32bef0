"""Under GRASPMILL_NO_SKIPS=1 a skipped test fails, unless its reason names one of GRASPMILL_MISSING: what scripts/test.sh
could not install, or may not do on this machine."""

import math
import os
import sys
from pathlib import Path

import pytest

if "GRASPMILL_DATASET" not in os.environ:
    pytest.exit("set GRASPMILL_DATASET to the folder of a dataset, as scripts/test.sh does", returncode=4)
sys.path += [str(Path(__file__).parents[2] / folder) for folder in ("scripts", "lab")]  # what the tests import

NO_SKIPS = os.environ.get("GRASPMILL_NO_SKIPS") == "1"
MISSING = os.environ.get("GRASPMILL_MISSING", "").split()


def judged(report):
    if NO_SKIPS and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2]
        if not any(name in reason.lower() for name in MISSING):
            report.outcome, report.longrepr = "failed", f"{reason}\nGRASPMILL_NO_SKIPS does not allow this skip"
    return report


@pytest.fixture(params=[1, pytest.param(10, marks=pytest.mark.long, id="long")])
def factor(request):
    """How much of everything a test tries: a little in every run, ten times as much with the marker `long`."""
    return request.param


def generated(tmp_path_factory, *words, **settings):
    graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
    return graspmill.generate(tmp_path_factory.mktemp("generated") / "ds", *words, **settings)


@pytest.fixture(scope="session")
def walled(tmp_path_factory):
    """32 scenes of 40 attempts, four of ten in bins, on trays and in shelves."""
    config = Path(__file__).parents[2] / "configs/generate/judge.toml"
    return generated(tmp_path_factory, config, shards=1, attempts=1_280, seed=3, settings={"attempts_per_scene": 40})


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """25 scenes of 60 attempts by the paper's rules, in 3 shards."""
    return generated(tmp_path_factory, shards=3, attempts=1_500, seed=6)


@pytest.fixture(scope="session")
def planner():
    return pytest.importorskip("graspmill").Planner()


@pytest.fixture(scope="session")
def tsdf():
    """That of a box and a cylinder on the table, which a ring of six cameras sees."""
    from grasp_sets import graspmill

    box = graspmill.Object.cuboid((0.04, 0.06, 0.05), (0.10, 0.12, 0.075))
    can = graspmill.Object.solid("cylinder", (0.05, 0.05, 0.07), (0.20, 0.18, 0.085))
    turns = [number * math.pi / 3 for number in range(6)]
    eyes = [(0.15 + 0.3 * math.cos(turn), 0.15 + 0.3 * math.sin(turn), 0.5) for turn in turns]
    return graspmill.Scene([box, can]).tsdf([graspmill.Camera.look_at(eye) for eye in eyes])


@pytest.fixture(scope="session")
def service(tmp_path_factory):
    """A `graspmill serve` for clients that behave."""
    from planner_service import running

    with running(tmp_path_factory.mktemp("service")) as service:
        yield service


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    return judged((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    return judged((yield))
