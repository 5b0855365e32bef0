"""Helpers of test_faults.py: runs programs under faults and reports what a dataset lost. "Lost" means any difference
from an undisturbed run: a file, a byte, an exit code, a remaining staging file."""

import concurrent.futures
import contextlib
import json
import os
import random
import re
import shutil
import subprocess
import time
from collections import Counter
from pathlib import Path

from programs import PROGRAMS, files, ran

SEED = int(os.environ.get("GRASPMILL_FAULTS_SEED", 1))
HANG_S = 60  # a longer run counts as hanging
OK, USAGE, DATA, INCOMPLETE, TRY_AGAIN, CONFIG = 0, 2, 65, 69, 75, 78
PROBLEMS_SHOWN = 20
CARD = "README.md"
LAST = ("meta/manifest.json", "_SUCCESS")  # they state that everything else exists


def dice(name):
    """Random numbers of one test, the same in every run with the same seed."""
    print(f"seed {SEED} for {name} (GRASPMILL_FAULTS_SEED)")
    return random.Random(f"{SEED} {name}")


def environment():
    """The environment without a scheduler's variables for the shard index."""
    schedulers = ("SLURM_", "JOB_COMPLETION_", "AWS_BATCH_", "SHARD_INDEX")
    return {key: value for key, value in os.environ.items() if not key.startswith(schedulers)}


def run(program, *args, before=(), **more):
    """Runs a program to its end; `before` is a wrapper command, such as strace with its options."""
    return ran(*before, PROGRAMS / program, *args, code=None, timeout=HANG_S, env=environment(), **more)


def start(program, *args):
    command = [PROGRAMS / program, *map(str, args)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment())


def end(process):
    out, err = process.communicate(timeout=HANG_S)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def side_by_side(work, items):
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(work, items))


def is_staging(name):
    name = Path(name).name
    return name.startswith(".") and "#" in name and name.endswith(".tmp")


def leftovers(folder):
    return [name for name in files(folder) if is_staging(name)]


class Case:
    """A command that makes a dataset, and the dataset of its undisturbed run."""

    def __init__(self, folder, config, shards, attempts, seed=1):
        self.folder, self.shards = folder, shards
        self.options = {"config": config, "shards": shards, "attempts": attempts, "seed": seed, "threads": 1}
        began = time.monotonic()
        ended = self.generate(folder)
        self.seconds = time.monotonic() - began
        assert ended.returncode == OK, ended
        self.whole = files(folder)
        assert verify(folder) == OK and not leftovers(folder)

    def command(self, out, **other):
        """The generator's arguments; `other` options replace the case's own."""
        return [word for key, value in {**self.options, "out": out, **other}.items() for word in (f"--{key}", value)]

    def generate(self, out, *more, **how):
        return run("generator", *self.command(out), *more, **how)

    def half_written(self, folder):
        """Files that readers may open and that are not as they should be, and files that say that others are there
        which are not. What is not there yet is fine."""
        found = {name: data for name, data in files(folder).items() if not is_staging(name)}
        problems = [f"{name} is not whole" for name, data in found.items() if self.whole.get(name) != data]
        promised = {name: self.files_of(shard) for shard in range(self.shards) for name in self.files_of(shard)[-1:]}
        promised |= {name: list(self.whole) for name in LAST if name in self.whole}
        for name, others in promised.items():
            missing = [other for other in others if other not in found and other not in LAST]
            if name in found and missing:
                problems.append(f"{name} is there and {missing} are not")
        return problems

    def lost(self, folder):
        """Completes a dataset after a fault; returns the differences from the undisturbed run."""
        half, ended = self.half_written(folder), self.generate(folder)
        problems = half + problems_of(ended, [OK], "the next run") + self.difference(folder)
        return problems + [f"{name} is left" for name in leftovers(folder)]

    def difference(self, folder):
        """The differences from the undisturbed run, except staging files."""
        found = {name for name in files(folder) if not is_staging(name)}
        problems = [f"{name} is missing" for name in self.whole if name not in found] + self.half_written(folder)
        # Without anything else there they are the bytes that were verified and swept at first.
        if problems or leftovers(folder):
            problems += [f"verify ended with {verified}"] if (verified := verify(folder)) != OK else []
        return problems

    def copy(self, folder, without=()):
        shutil.copytree(self.folder, folder)
        for name in without:
            (folder / name).unlink()
        return folder

    def last_files(self):
        """The files that are written when all shards exist."""
        return [name for name in self.whole if name in (CARD, *LAST)]

    def files_of(self, shard):
        """The files of a shard, its marker last."""
        tables = [name for name in self.whole if f"-{shard:05}-of-" in name]
        return [*tables, f"meta/shards/{shard:05}.json"]

    def take_away(self, folder, shards, tables):
        """Uncommits shards: removes their markers, and optionally their tables."""
        names = [*reversed(self.last_files())]
        for shard in shards:
            *data, marker = self.files_of(shard)
            names += [marker, *data] if tables else [marker]
        for name in names:
            (folder / name).unlink(missing_ok=True)


def verify(folder):
    ended = run("graspmill", "dataset", "verify", folder)
    assert "panicked" not in ended.stderr, ended
    return ended.returncode


def problems_of(ended, codes, who):
    """Checks that a program ended with one of these codes, with a message if it failed, and without a panic."""
    said = ended.stderr.strip()[-300:]
    problems = [] if ended.returncode in codes else [f"{who} ended with {ended.returncode}: {said}"]
    if "panicked" in ended.stderr:
        problems.append(f"{who} panicked: {said}")
    if ended.returncode > 0 and not said and not ended.stdout.strip():
        problems.append(f"{who} ended with {ended.returncode} and said nothing")
    return problems


def record(fault, times, problems, **details):
    """Prints and records how often a fault was tried and what was lost; fails if anything was lost."""
    line = {"fault": fault, "times": times, "lost": len(problems), **details}
    print(json.dumps(line))
    if path := os.environ.get("GRASPMILL_FAULTS_REPORT"):
        with open(path, "a") as report:
            report.write(json.dumps(line) + "\n")
    shown = "\n".join(problems[:PROBLEMS_SHOWN])
    assert times > 0 and not problems, f"{fault}: {len(problems)} problems in {times} tries (seed {SEED})\n{shown}"


@contextlib.contextmanager
def disk(folder, options):
    """A small separate disk; yields a function that changes its options, or None if mounting is not allowed."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o"]
    try:
        mounted = subprocess.run([*mount, options, "tmpfs", folder], capture_output=True).returncode == 0
    except FileNotFoundError:
        mounted = False
    try:
        yield (lambda new: subprocess.run([*mount, f"remount,{new}", "tmpfs", folder], check=True)) if mounted else None
    finally:
        if mounted:
            subprocess.run(["umount", folder], check=True)


def why_no_strace():
    """Why strace cannot be used here; nothing if it can."""
    if shutil.which("strace") is None:
        return "there is no strace (Debian package strace)"
    inject = ["-qq", "-f", "-o", "/dev/null", "-e", "trace=getpid", "-e", "inject=getppid:retval=1"]
    tried = subprocess.run(["strace", *inject, "true"], capture_output=True, text=True)
    return "" if tried.returncode == 0 else f"strace cannot be used here: {tried.stderr.strip()[-200:]}"


# --- Injected into system calls.

# They do not change the disk, so a kill at them needs no test.
READS = {
    *("access", "close", "execve", "faccessat2", "fcntl", "fstat", "getdents64", "ioctl", "lseek", "newfstatat"),
    *("pread64", "read", "readlink", "statfs", "statx"),
}
# strace counts the calls of each thread by itself, so the n-th is that of the thread that comes to it first. Three
# states of the folder let every thread be the first: nothing there; begun, without shards; all shards, not completed.
STATES = {"empty": ["--shard-index", 0], "begun": [], "written": []}


def prepare(case, state, folder):
    if state == "whole":
        case.copy(folder)
    elif state == "begun":
        case.copy(folder, without=[name for name in case.whole if name != "meta/info.json"])
    elif state == "written":
        case.copy(folder, without=case.last_files())
    return folder


def traced(case, folder, more, options, log):
    ended = case.generate(folder, *more, before=["strace", "-f", "-y", "-qq", "-o", log, *options])
    return ended, log.read_text().splitlines()


def first_calls(case, state, tmp_path):
    """The system calls with which a run accesses its folder; for each, the index in its thread of the first that does."""
    folder, options = prepare(case, state, tmp_path / f"trace-{state}"), ["-e", "trace=%file,%desc"]
    ended, lines = traced(case, folder, STATES[state], options, tmp_path / f"log-{state}")
    assert ended.returncode == OK, ended
    counts, first = Counter(), {}
    for line in lines:
        if begun := re.match(r"(\d+) +(\w+)\(", line):
            thread, call = begun.groups()
            counts[thread, call] += 1
            if str(folder) in line:
                first[call] = min(counts[thread, call], first.get(call, counts[thread, call]))
    return first


def all_first_calls(case, tmp_path):
    return dict(zip(STATES, side_by_side(lambda state: first_calls(case, state, tmp_path), STATES)))


def inject(case, state, call, first, what, step, tmp_path):
    """Injects a fault into the n-th call, for n = first, first + step, … until a run passes undisturbed; yields those
    that touched the folder: it, what was done, and how the run ended."""
    for number in range(first, 1000, step):
        folder = prepare(case, state, tmp_path / f"{state}-{call}-{number}")
        options = ["-e", f"trace={call}", "-e", f"inject={call}:{what}:when={number}"]
        ended, calls = traced(case, folder, STATES[state], options, tmp_path / "log")
        injected = [line for line in calls if "INJECTED" in line]
        if ended.returncode == OK and not injected:
            return
        if ended.returncode < 0:  # killed: at the last call that was not answered, or while being loaded
            injected = [line for line in calls if line.rstrip().endswith(("<unfinished ...>", "= ?"))] or calls
        if any(str(folder) in line for line in injected):
            yield folder, f"{call}:{what} number {number}, {state}", ended
        shutil.rmtree(folder, ignore_errors=True)
    raise AssertionError(f"{call}: still disturbed after 1,000 runs")


def step_of(factor):
    """Of what can be tried at each step: every fourth, or all in a long run."""
    return 4 if factor == 1 else 1


def at_every_call(case, first, items, check, factor, tmp_path):
    """Injects faults `(state, call, what)`; how often each touched the folder, and what `check` found."""

    def work(item):
        state, call, what = item
        own = tmp_path / f"{state}-{call}-{re.sub('[^A-Za-z]', '-', what)}"
        own.mkdir()
        points, problems = 0, []
        for folder, where, ended in inject(case, state, call, first[state][call], what, step_of(factor), own):
            points += 1
            problems += [f"{where}: {problem}" for problem in check(folder, ended)]
        return points, problems

    results = side_by_side(work, items)
    counts = {" ".join(item): points for item, (points, _) in zip(items, results) if points}
    return counts, [problem for _, found in results for problem in found]


# --- The effect of a power cut.

FLUSHES = ["write", "pwrite64", "fsync", "fdatasync", "mkdir", "link", "linkat", "rename", "renameat", "renameat2"]


def done(lines):
    """The completed calls of a trace, in the order of their ends, one per line."""
    begun = {}
    for line in lines:
        thread, call = line.split(maxsplit=1)
        if call.endswith("<unfinished ...>"):
            begun[thread] = call.removesuffix("<unfinished ...>")
            continue
        if resumed := re.match(r"<\.\.\. \w+ resumed>(.*)", call):
            call = begun.pop(thread, "") + resumed[1]
        if re.search(r"\) += \d+", call):
            yield call


class Cache:
    """Data that are not on the disk yet: files with unflushed bytes, and names in unflushed folders."""

    def __init__(self):
        self.bytes, self.names, self.problems = set(), set(), []

    def take(self, call):
        name, paths = call.split("(")[0], re.findall(r'"(/[^"]*)"', call)
        opened = re.match(r"\w+\(\d+<([^>]*)>", call)
        if name.startswith(("write", "pwrite")):
            self.bytes.add(opened[1])
        elif name in ("fsync", "fdatasync"):
            self.bytes.discard(opened[1])
            self.names = {path for path in self.names if str(Path(path).parent) != opened[1]}
        elif name == "mkdir":
            self.names.add(paths[0])
        else:
            self.publish(*paths)

    def publish(self, staging, path):
        if staging in self.bytes:
            self.problems.append(f"{path} has its name before its bytes")
        if shard := re.search(r"/meta/shards/(\d{5})\.json$", path):  # it states that its tables exist
            promised = [name for name in self.names if f"-{shard[1]}-of-" in name or Path(name).suffix == ""]
        else:
            promised = self.names if path.endswith(LAST) else []
        self.problems += [f"{path} may be there without {name}" for name in sorted(promised)]
        self.names.add(path)

    def replay(self, lines):
        for call in done(lines):
            self.take(call)
