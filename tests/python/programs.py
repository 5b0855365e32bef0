"""The built programs, for tests that run them as a user does."""

import os
from pathlib import Path

import pytest


def program(name: str) -> str:
    """Path of a program; the test is skipped if no path is configured."""
    folder = os.environ.get("GRASPMILL_PROGRAMS")
    if not folder:
        pytest.skip("GRASPMILL_PROGRAMS must name the folder of the built programs")
    return str(Path(folder).resolve() / name)
