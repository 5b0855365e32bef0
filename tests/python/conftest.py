"""Under GRASPMILL_NO_SKIPS=1 a skipped test fails, unless its reason names one of GRASPMILL_MISSING: what scripts/test.sh
could not install, or may not do on this machine."""

import os

import pytest

NO_SKIPS = os.environ.get("GRASPMILL_NO_SKIPS") == "1"
MISSING = os.environ.get("GRASPMILL_MISSING", "").split()


def judged(report):
    if NO_SKIPS and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2]
        if not any(name in reason.lower() for name in MISSING):
            report.outcome, report.longrepr = "failed", f"{reason}\nGRASPMILL_NO_SKIPS does not allow this skip"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    return judged((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    return judged((yield))
