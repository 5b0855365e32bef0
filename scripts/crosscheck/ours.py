"""The time of Graspmill for the same attempts of the same scenes, measured like that of the other engines."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter


class GeneratorFailed(Exception):
    """The generator could not execute the attempts again, or they did not end as stored."""


@dataclass(frozen=True)
class Clocked:
    """Attempts executed again on one thread, start of the program and reading of the rows included."""

    attempts: int
    seconds: float

    @property
    def attempts_per_s(self) -> float:
        """Attempts a second on one core."""
        return self.attempts / self.seconds


def clocked(generator: Path, dataset: Path, scenes: int, attempts: int) -> Clocked:
    """Times `graspmill dataset repeat`; raises GeneratorFailed unless every attempt ends as stored."""
    # Resolved, for a bare name would be looked up in PATH.
    command = [generator.resolve(), "repeat", dataset, "--scenes", str(scenes), "--threads", "1"]
    start = perf_counter()
    try:
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    except OSError as error:
        raise GeneratorFailed(f"failed to run the generator: {error}") from error
    seconds = perf_counter() - start
    if done.returncode != 0:
        raise GeneratorFailed(f"the generator ended with {done.returncode}: {done.stdout}{done.stderr}".strip())
    return Clocked(attempts, seconds)
