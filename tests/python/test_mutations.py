"""Hostile datasets against every program that reads one: none crashes, hangs, or takes more memory than it may.

    GRASPMILL_MUTATIONS=200 python -m pytest -s -m long tests/python/test_mutations.py    # 2,000 mutants

Every checksum, size, id and seal of a mutant is right, so only the programs' own checks stand between its contents and
the code that computes. GRASPMILL_MUTATIONS_SEED chooses other mutants; a failure prints what was changed.
"""

import concurrent.futures
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
from collections import Counter

import pytest
from mutations import CARD, INFO, LAST, MANIFEST, Mutant
from programs import DATASET, PACKAGE, QUICK, ROOT, files, program, run

COUNT = int(os.environ.get("GRASPMILL_MUTATIONS", 6))  # in a short run
SEED = int(os.environ.get("GRASPMILL_MUTATIONS_SEED", 1))
TIME_S = 20
MEMORY_BYTES = 2 << 30
CODES = {0, 65, 69, 75, 78}  # 75: a special file cannot be read
TEXT = {ord(letter) for letter in "\n\t"}
COMMANDS = [
    "graspmill dataset verify {data}", "graspmill dataset report {data}", "graspmill dataset report {data} --html {out}/report.html",
    "graspmill dataset browse {data} --scene 2 --scene 7 --no-replays --out {out}/pages", "generator repeat {data}",
    "generator replay {data} --attempt 7/3", "generator missing {data}", "generator finalize {data}",
    "trainer fit --data {data} --config {quick} --epochs 1 --run {out}/run",
]  # fmt: skip
#: A mutant meets one of them.
EXPORTS = [f"graspmill dataset export {{data}} --out {{out}}/export --format {form}" for form in ("vgn", "mjcf --scenes 6")]


# Starts a program and writes its exit code and its peak memory in KiB. A program started from here would count the
# memory of this process, which has PyTorch in it.
WATCH = """
import os, resource, sys
code = os.spawnvp(os.P_WAIT, sys.argv[2], sys.argv[2:])
with open(sys.argv[1], "w") as told:
    told.write(f"{code} {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss}")
"""


def words_of(line, **places):
    """A line's command; the package's program has the exports."""
    name, *words = (word.format(**places) for word in line.split())
    return [*(PACKAGE if "export" in words else [program(name)]), *words]


def ended(command, log):
    """Runs a program to its end; returns its exit code, its peak memory in bytes, and what it printed."""
    told = log.with_suffix(".code")
    with log.open("wb") as out:
        watch = [sys.executable, "-I", "-S", "-c", WATCH, told, *command]
        process = subprocess.Popen(watch, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True)
        try:
            process.wait(TIME_S)
            code, memory_kib = map(int, told.read_text().split())
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            code, memory_kib = -signal.SIGKILL, 0
    return code, memory_kib * 1024, log.read_bytes()


def faults(code, memory, printed):
    text = printed.decode(errors="replace")
    if code not in CODES:
        yield f"ended with {code}"
    if memory > MEMORY_BYTES:
        yield f"took {memory >> 20} MiB"
    if "panicked" in text or "Traceback" in text:
        yield "panicked"
    control = {letter for letter in text if (ord(letter) < 32 and ord(letter) not in TEXT) or 127 <= ord(letter) < 160}
    if control:
        yield f"printed {sorted(control)}"


def check(number, folder):
    """What is wrong with the programs' behaviour on one mutant, and how they ended."""
    rng, here = random.Random(f"{SEED} {number}"), folder / str(number)
    here.mkdir()
    mutant = Mutant(DATASET, here / "data")
    what, problems, codes = mutant.change(rng), [], Counter()
    for line in [*COMMANDS, EXPORTS[number % len(EXPORTS)]]:
        out = here / "out"
        out.mkdir()
        code, memory, printed = ended(words_of(line, data=here / "data", out=out, quick=QUICK), here / "log")
        codes[code] += 1
        problems += [f"mutant {number} ({what!a}): {line} {fault}: {printed[-300:]!r}" for fault in faults(code, memory, printed)]
        shutil.rmtree(out)
    shutil.rmtree(here)
    return problems, codes


def test_hostile_datasets_are_refused_or_read_in_bounds(tmp_path, factor):
    problems, codes = [], Counter()
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for found, ends in pool.map(lambda number: check(number, tmp_path), range(COUNT * factor)):
            problems += found
            codes += ends
            for problem in found:
                print(problem, flush=True)
    print(f"seed {SEED}: {COUNT * factor} mutants, {codes.total()} runs, exit codes {dict(sorted(codes.items()))}")
    assert codes[0] and codes[65], codes
    assert not problems, "\n".join(problems)


def test_a_mutant_that_is_only_mended_is_the_dataset(tmp_path):
    mutant = Mutant(DATASET, tmp_path / "data")
    mutant.mend()
    assert files(mutant.folder) == files(DATASET)


def test_stored_physics_is_held_to_its_ranges(tmp_path):
    """`shards/src/format/info.rs` has the gripper and the procedure."""
    mutant = Mutant(DATASET, tmp_path / "data")
    text, count = re.subn(r'("step_rate_hz": )[0-9.]+', r"\g<1>1e9", (mutant.folder / INFO).read_text())
    (mutant.folder / INFO).write_text(text)
    mutant.mend()
    code, memory, printed = ended(words_of("generator repeat {data}", data=mutant.folder), tmp_path / "log")
    assert count and code == 65 and memory < MEMORY_BYTES and b"step_rate_hz must be between" in printed, printed


def test_memory_does_not_follow_the_rows(tmp_path):
    """Two million attempts in one table: columns decoded whole would take more than twice this limit."""
    small = ["--shards", 1, "--attempts", 1_000, "--set", "attempts_per_scene=50"]
    run("generator", "--config", ROOT / "configs/generate/demo.toml", *small, "--out", tmp_path / "small", code=0)
    mutant = Mutant(tmp_path / "small", tmp_path / "data")
    mutant.many_attempts(2_000)
    limit = lambda: resource.setrlimit(resource.RLIMIT_DATA, (160 << 20, 160 << 20))
    ended = run("graspmill", "dataset", "verify", mutant.folder, preexec_fn=limit, timeout=TIME_S, code=0)
    assert "2000000 attempts" in ended.stdout, ended


SPECIAL = [INFO, MANIFEST, CARD, LAST, "meta/shards/00001.json", "objects/shard-00000-of-00002.parquet"]
KINDS = ["fifo", "zero", "sparse", "loop"]
#: All pairs in a long run; in a short one each file once, and each kind.
REPLACED = [
    pytest.param(name, kind, marks=[] if a % 4 == b else pytest.mark.long)
    for a, name in enumerate(SPECIAL)
    for b, kind in enumerate(KINDS)
]


@pytest.mark.parametrize(("name", "kind"), REPLACED)
def test_special_files_neither_block_nor_fill_the_memory(tmp_path, name, kind):
    mutant = Mutant(DATASET, tmp_path / "data")
    mutant.replace(name, kind)
    for command in ("verify", "finalize", "missing", "report"):
        line = f"graspmill dataset {command} {{data}}"
        code, memory, printed = ended(words_of(line, data=tmp_path / "data"), tmp_path / "log")
        assert code in {0, 65, 69, 78} and memory < 1 << 30, (line, code, memory, printed)
