"""Faults of readers: a failed read is never taken for success, and a killed training leaves nothing for ever."""

import signal
from pathlib import Path

import pytest
from programs import DATASET, ROOT

import faults
from faults import DATA, OK, TRY_AGAIN, problems_of, record, run, step_of

needs_strace = pytest.mark.skipif(bool(faults.why_no_strace()), reason=faults.why_no_strace())
TABLES = [str(path.relative_to(DATASET)) for path in sorted(DATASET.glob("*/shard-00000-of-*.parquet"))]
RENAMES = "rename,renameat,renameat2"


@needs_strace
def test_a_read_that_fails_once_is_never_ok(tmp_path, factor):
    """`dataset verify` while the n-th read of a shard's table fails, in a long run for every n: it never says ok, and
    tells the error."""

    def work(name):
        path, problems, log = DATASET / name, [], tmp_path / f"{Path(name).parts[0]}.log"
        for number in range(1, 1000, step_of(factor)):
            fault = ["-P", path, "-e", "trace=read,pread64", "-e", f"inject=read,pread64:error=EIO:when={number}"]
            ended = run("graspmill", "dataset", "verify", DATASET, before=["strace", "-f", "-qq", "-o", log, *fault])
            if "INJECTED" not in log.read_text():
                assert ended.returncode == OK, ended
                return (number - 1) // step_of(factor), problems
            problems += problems_of(ended, [DATA, TRY_AGAIN], f"verify without read {number} of {name}")
            if "Input/output error" not in ended.stdout + ended.stderr:
                problems.append(f"verify without read {number} of {name} does not tell the system's error")
        raise AssertionError(f"{name} is still read after 1,000 faults")

    results = faults.side_by_side(work, TABLES)
    times = [count for count, _ in results]
    assert min(times) >= (1 if factor == 1 else 2), times
    problems = [problem for _, found in results for problem in found]
    record("a read of a table fails once under `dataset verify`: code 65 or 75", sum(times), problems)


@needs_strace
def test_a_killed_training_leaves_nothing_for_ever(tmp_path):
    """`trainer fit` killed as it renames its n-th file, for every n: the next one sweeps what is left."""
    folder, log, left = tmp_path / "run", tmp_path / "log", []
    quick = ["--config", ROOT / "configs/train/quick.toml", "--epochs", 1, "--resume"]
    fit = ["fit", "--data", DATASET, *quick, "--run", folder]
    for number in range(1, 100):
        kill = ["-e", f"trace={RENAMES}", "-e", f"inject={RENAMES}:signal=KILL:when={number}"]
        ended = run("trainer", *fit, before=["strace", "-f", "-qq", "-o", log, *kill])
        left.append(len(list(folder.glob(".*.tmp"))))
        if ended.returncode == OK:
            break
        assert ended.returncode == -signal.SIGKILL, ended
    assert len(left) >= 4 and left == [1] * (len(left) - 1) + [0], left
    record("SIGKILL at every file that `trainer fit` renames", len(left) - 1, [])
