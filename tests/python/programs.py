"""The built programs, for tests that run them as a user does, and the dataset that was made for the tests."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Of the debug build, where nothing else is said.
PROGRAMS = Path(os.environ.get("GRASPMILL_PROGRAMS", ROOT / "target/debug")).resolve()
DATASET = Path(os.environ["GRASPMILL_DATASET"]).resolve()  # conftest.py says so if there is none


def program(name: str) -> str:
    """Path of a program."""
    return str(PROGRAMS / name)


def files(folder: Path) -> dict[str, bytes]:
    """Every file by name, with its bytes."""
    paths = [path for path in sorted(Path(folder).rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
