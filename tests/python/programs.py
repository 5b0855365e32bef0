"""The programs, for tests that run them as a user does, and the dataset that was made for the tests."""

import contextlib
import copy
import functools
import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
#: Of the debug build, where nothing else is said.
PROGRAMS = Path(os.environ.get("GRASPMILL_PROGRAMS", ROOT / "target/debug")).resolve()
DATASET = Path(os.environ["GRASPMILL_DATASET"]).resolve()  # conftest.py says so if there is none
QUICK = ROOT / "configs/train/quick.toml"
#: The program of the Python package.
PACKAGE = [sys.executable, "-m", "graspmill"]


def program(name: str) -> str:
    return str(PROGRAMS / name)


def ran(*words: object, code: int | None = 0, **more: object) -> subprocess.CompletedProcess[str]:
    """What a command said; it must end with this code, if there is one."""
    done = subprocess.run([*map(str, words)], **{"capture_output": True, "text": True, **more})
    if code is not None:
        assert done.returncode == code and "Traceback" not in done.stderr, f"{words}: {done.returncode}: {done.stdout}{done.stderr[-4000:]}"
    return done


def run(name: str, *words: object, code: int | None = None, **more: object) -> subprocess.CompletedProcess[str]:
    """How a built program ended, and what it said."""
    return ran(program(name), *words, code=code, **{"timeout": 120, **more})


def packaged(*words: object, code: int = 0, **more: object) -> subprocess.CompletedProcess[str]:
    return ran(*PACKAGE, *words, code=code, **more)


def commanded(*words: object, code: int = 0) -> subprocess.CompletedProcess[str]:
    """As `packaged`, in this process, for a command that Python does wholly: a start takes longer than the command."""
    from graspmill import _commands

    out, err, handler = io.StringIO(), io.StringIO(), signal.getsignal(signal.SIGTERM)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            ended = _commands.run([*map(str, words)])
        except SystemExit as error:  # of argparse
            ended = error.code
        finally:
            signal.signal(signal.SIGTERM, handler)
    assert ended == code, f"{words}: {ended}: {out.getvalue()}{err.getvalue()[-4000:]}"
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def planned(*words: object, code: int = 0, **more: object) -> dict | str:
    """The plan with which the command answers, or what it says of an error."""
    done = packaged("plan", "--json", "--quiet", *words, code=code, **more)
    return done.stderr if code else json.loads(done.stdout)


def planned_view(folder: Path, depth_m: np.ndarray, camera: object, *words: object, code: int = 0, **view: object) -> dict | str:
    np.save(folder / "depth.npy", depth_m.astype(np.float32))
    at, lens = camera._pose(), {name: getattr(camera, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")}
    view = {"depth": "depth.npy", "workspace_from_camera": {"position_m": at[:3], "quaternion_xyzw": at[3:]}, **view}
    (folder / "views.json").write_text(json.dumps({"views": [view], "intrinsics": lens}))
    return planned("--views", folder / "views.json", *words, code=code)


def executable(path: Path, text: str) -> Path:
    path.write_text(text)
    path.chmod(0o755)
    return path


def at_seventh_step(action: str) -> str:
    """`python/examples/train_ddp.py` with a statement more before its seventh step."""
    return f"""
import os, signal, sys, time
sys.path.insert(0, {str(ROOT / "python" / "examples")!r})
import train_ddp

forward, steps = train_ddp.Step.forward, []


def watched(self, batch):
    steps.append(None)
    if len(steps) == 7:
        {action}
    return forward(self, batch)


train_ddp.Step.forward = watched
train_ddp.leave(train_ddp.main())
"""


def files(folder: Path) -> dict[str, bytes]:
    """Every file by name, with its bytes."""
    paths = [path for path in sorted(Path(folder).rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def assert_same(made: Path, wanted: Path) -> None:
    """Fails with the names of the files that are not the same in both folders."""
    made, wanted = files(made), files(wanted)
    assert {name for name in made.keys() | wanted.keys() if made.get(name) != wanted.get(name)} == set()


def until(is_so: Callable, seconds: float, complaint: str, told: Callable[[], str] = str, every_s: float = 0.2) -> None:
    """Waits; after so many seconds it fails with the complaint and what else is told."""
    ends = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < ends, f"{complaint}\n{told()}"
        time.sleep(every_s)


def changed(value: object, path: str, new: object = ...) -> object:
    """A copy of what JSON may hold, with another value at a path such as `a.0.b`; without it, if there is none."""
    value = copy.deepcopy(value)
    *parents, last = [int(part) if part.isdigit() else part for part in path.split(".")]
    inner = functools.reduce(lambda inner, part: inner[part], parents, value)
    if new is ...:
        del inner[last]
    else:
        inner[last] = new
    return value


def rounds_of(folder: Path) -> list[dict]:
    """What the journal of an experiment has of rounds that are over, in their order."""
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    return sorted((line for line in lines if "ending" in line), key=lambda line: line["round"])


def metrics(folder: Path) -> list[dict]:
    """The epochs of a training's folder so far, without their times."""
    path = folder / "metrics.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    return [{key: value for key, value in line.items() if key != "seconds"} for line in lines]
