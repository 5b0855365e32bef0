"""Under GRASPMILL_NO_SKIPS=1 a skipped test fails, unless its reason names one of GRASPMILL_MISSING: what scripts/test.sh
could not install, or may not do on this machine."""

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


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    return judged((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    return judged((yield))
