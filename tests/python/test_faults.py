"""After any fault that stops a writer, the next run of the same command makes the same dataset, byte for byte.

    python -m pytest -m long tests/python/test_faults.py    # at every step, and at more random times

Faults are injected into the programs as users run them. Tests that need missing tools (root, strace, faketime) are
skipped with a reason. GRASPMILL_FAULTS_REPORT=FILE receives a line of JSON for each kind of fault;
docs/reliability.md adds them up.
"""

import re
import resource
import shutil
import signal
import time

import pytest

import faults
from faults import CONFIG, INCOMPLETE, OK, READS, STATES, TRY_AGAIN
from faults import prepare, problems_of, record, run, step_of, traced
from programs import ROOT, files, ran

needs_strace = pytest.mark.skipif(bool(faults.why_no_strace()), reason=faults.why_no_strace())
SMALL = {"attempts_per_scene": 2, "resolution": 8}


def write_config(path, **settings):
    text = (ROOT / "configs/generate/demo.toml").read_text()
    for key, value in settings.items():
        text, count = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        assert count == 1, key
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return write_config(tmp_path_factory.mktemp("reference") / "small.toml", **SMALL)


@pytest.fixture(scope="module")
def two(config):
    """Two shards, for faults that are tried at every step."""
    return faults.Case(config.with_name("two"), config, 2, 4)


@pytest.fixture(scope="module")
def four(config):
    return faults.Case(config.with_name("four"), config, 4, 8)


@pytest.fixture(scope="module")
def many(config):
    """Sixteen shards, for faults that come at random times: most of the time something is being written."""
    return faults.Case(config.with_name("many"), config, 16, 32)


# --- At every system call.


@needs_strace
def test_killed_at_every_system_call(two, tmp_path, factor):
    first = faults.all_first_calls(two, tmp_path)
    # A file is created, written, flushed and renamed; without these calls nothing would have been tested.
    assert {"openat", "mkdir", "write", "fsync", "renameat2"} <= set(first["empty"]), first

    def check(folder, ended):
        problems = problems_of(ended, [-signal.SIGKILL], "the killed run")
        after = faults.verify(folder) if folder.exists() else CONFIG
        is_whole = set(two.difference(folder)) <= {"_SUCCESS is missing"}
        if after not in (INCOMPLETE, CONFIG) and not (after == OK and is_whole):
            problems.append(f"verify after the kill ended with {after}")
        return problems + two.lost(folder)

    items = [(state, call, "signal=KILL") for state in STATES for call in sorted(first[state].keys() - READS)]
    counts, problems = faults.at_every_call(two, first, items, check, factor, tmp_path)
    assert sum(counts.values()) >= (20 if factor == 1 else 60), counts
    record("SIGKILL at every system call that touches the dataset", sum(counts.values()), problems, points=counts)


# The n-th call of its kind fails instead, like a failing disk or a network file system without its server. `unlink` may
# leave a staging file.
ERRORS = {
    "fsync": ["EIO"], "mkdir": ["EIO"], "rename": ["EIO", "ESTALE"], "renameat2": ["EIO", "ESTALE", "EINVAL"],
    "linkat": ["EIO", "ESTALE", "EPERM", "EDQUOT"], "unlink": ["EIO"], "unlinkat": ["EIO"], "getdents64": ["EIO"], "statx": ["ESTALE"],
}  # fmt: skip
MAY_LEAVE = ("unlink", "unlinkat", "statx")


@needs_strace
@pytest.mark.parametrize("looks", [False, True], ids=["changes", "looks"])
def test_every_system_call_fails_once(two, tmp_path, looks, factor):
    """Those that change something, in every state; those that only look, where all shards are there to be looked at."""
    first = faults.all_first_calls(two, tmp_path)

    def check(folder, ended):
        problems = problems_of(ended, [OK, TRY_AGAIN], "the disturbed run")
        if ended.returncode == OK and not folder.name.startswith("empty"):
            problems += two.difference(folder)
        if folder.name.split("-")[-2] not in MAY_LEAVE:
            problems += [f"{name} is left" for name in faults.leftovers(folder)]
        return problems + two.lost(folder)

    items = [
        (state, call, f"error={error}")
        for state in STATES
        for call in sorted(first[state])
        if looks == (call in READS) and (factor > 1 or not looks or state == "written")
        for error in ERRORS.get(call, [])[:factor]
    ]
    counts, problems = faults.at_every_call(two, first, items, check, factor, tmp_path)
    assert sum(counts.values()) >= (10 if factor == 1 else 40), counts
    what = "looks at" if looks else "changes"
    record(f"every system call that {what} the dataset fails once", sum(counts.values()), problems, points=counts)


# As on some network mounts and on FAT.
NO_NEW_NAMES = {"renameat2": "EINVAL"}
NO_LINKS = {**NO_NEW_NAMES, "linkat": "EPERM"}


@needs_strace
@pytest.mark.parametrize("errors", [NO_NEW_NAMES, NO_LINKS], ids=" ".join)
def test_file_systems_without(two, tmp_path, errors):
    options = ["-e", f"trace={','.join(errors)}"]
    options += [word for call, error in errors.items() for word in ("-e", f"inject={call}:error={error}")]
    ended, calls = traced(two, tmp_path / "new", [], options, tmp_path / "log")
    assert all(any(call in line and "INJECTED" in line for line in calls) for call in errors), calls
    problems = problems_of(ended, [OK], "the run") + two.lost(tmp_path / "new")
    record(f"a file system without {', '.join(errors)}", 1, problems)


def test_nothing_is_removed_that_is_somebody_elses(tmp_path):
    for name in (".thesis.tex#0.tmp", "meta/.notes#1.tmp", "data.parquet"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine")
    before = files(tmp_path)
    ended = run("generator", "finalize", tmp_path)
    assert ended.returncode == CONFIG and ended.stderr and files(tmp_path) == before, ended


# --- What a cut of the power could take. This test checks the order of the calls instead.


@needs_strace
def test_files_are_on_the_disk_before_others_speak_of_them(two, tmp_path, factor):
    """After a successful run nothing remains to flush, even if an earlier run was killed before it flushed."""
    trace = ["-e", f"trace={','.join(faults.FLUSHES)}"]

    def work(state):
        problems, log = [], tmp_path / f"{state}.log"
        for points in range(1, 1000, step_of(factor)):
            folder, cache = prepare(two, state, tmp_path / f"{state}-{points}"), faults.Cache()
            kill = ["-e", f"inject=fsync:signal=KILL:when={points}"]
            ended, lines = traced(two, folder, [], [*trace, *kill], log)
            cache.replay(lines)
            if was_killed := ended.returncode != OK:
                ended, lines = traced(two, folder, [], trace, log)
                cache.replay(lines)
            found = problems_of(ended, [OK], "the next run") + cache.problems
            left = [name for name in sorted(cache.names | cache.bytes) if not faults.is_staging(name)]
            found += [f"{name} is not flushed" for name in left if str(folder) in name]
            problems += [f"killed at flush {points}, {state}: {problem}" for problem in found]
            if not was_killed:
                return points, problems

    results = faults.side_by_side(work, STATES)
    points, problems = sum(n for n, _ in results), [problem for _, found in results for problem in found]
    assert points > 20
    record("order of flushes, after a kill at every one", points, problems)


# --- At random times.


def stopped(case, folder, rng, signals, span):
    """Begins a run and stops it after random times in `span`; how it ended, None if it was done before."""
    writer = faults.start("generator", *case.command(folder))
    for number in signals:
        time.sleep(rng.uniform(0, span))
        writer.send_signal(number)
    ended = faults.end(writer)
    return None if ended.returncode == OK else ended


def stop_often(case, folder, rng, signals, times, check):
    """Stops runs until `times` were stopped, and takes shards away in between, so that there is always work."""
    problems, stops, left, span = [], 0, 0, case.seconds
    folder.mkdir()
    while stops < times:
        before, tables = files(folder), rng.random() < 0.5
        ended = stopped(case, folder, rng, signals(rng), span)
        found = case.half_written(folder)
        if ended is None:
            span *= 0.8  # the machine is faster than it was
            case.take_away(folder, range(case.shards), tables)
        else:
            stops += 1
            span *= 1.1
            left = max(left, len(faults.leftovers(folder)))
            found += check(folder, before, ended)
        problems += [f"stop {stops}: {problem}" for problem in found]
        if rng.random() < 0.3:
            case.take_away(folder, rng.sample(range(case.shards), 3), tables)
    return problems + case.lost(folder), left


def stop_in_two_folders(case, name, signals, times, check, tmp_path):
    work = [(tmp_path / f"{name}-{number}", faults.dice(f"{name} {number}")) for number in range(2)]
    results = faults.side_by_side(lambda item: stop_often(case, *item, signals, times // 2, check), work)
    return [problem for found, _ in results for problem in found], max(left for _, left in results)


def test_killed_at_random_times(many, tmp_path, factor):
    times = 8 * factor

    def check(folder, before, ended):
        return problems_of(ended, [-signal.SIGKILL], "the killed run")

    problems, left = stop_in_two_folders(many, "killed", lambda rng: [signal.SIGKILL], times, check, tmp_path)
    record("SIGKILL at random times, shards taken away in between", times, problems, staging_files_at_most=left)


ASK = [signal.SIGTERM, signal.SIGINT]


@pytest.mark.parametrize("count, name", [(1, "once"), (2, "twice")])
def test_asked_to_stop_at_random_times(many, tmp_path, count, name, factor):
    times, early = 6 * factor, []

    def check(folder, before, ended):
        if -ended.returncode in ASK:  # before the program listens for signals it has touched nothing
            early.append(ended)
            return [] if files(folder) == before else ["it died of the signal and had begun to write"]
        # The second signal ends it at once, like a kill.
        left = faults.leftovers(folder) if count == 1 else []
        return problems_of(ended, [TRY_AGAIN], "the stopped run") + [f"{name} is left" for name in left]

    problems, _ = stop_in_two_folders(many, name, lambda rng: rng.choices(ASK, k=count), times, check, tmp_path)
    assert len(early) < times, "nearly all signals came too early"
    record(f"SIGTERM or SIGINT at random times, {name}: code 75", times, problems, before_it_listened=len(early))


# --- No room, no permission, no descriptors.


def limited(kind, limit):
    return lambda: resource.setrlimit(kind, (limit, limit))


def stopped_by_the_system(case, folder, ended, codes=(TRY_AGAIN,)):
    found = problems_of(ended, [OK, *codes], "the stopped run") + case.half_written(folder)
    return found + [f"{name} is left" for name in faults.leftovers(folder)]


@pytest.mark.parametrize("unit, step", [("size", 4096), ("nr_inodes", 1)])
def test_the_disk_is_full(four, tmp_path, unit, step, factor):
    """A disk of one page, of two, …, until all fits; then of one file, of two, …; in a short run of a few sizes."""
    stops, problems, roomy = 0, [], "size=64m,nr_inodes=1000"
    with faults.disk(tmp_path / "disk", roomy) as remount:
        if remount is None:
            pytest.skip("cannot mount a small disk here (needs root)")
        for number in range(1, 1000, 2 * step_of(factor) - 1):
            remount(f"{roomy},{unit}={(number + 1) * step}")
            ended = four.generate(tmp_path / "disk/data")
            found = stopped_by_the_system(four, tmp_path / "disk/data", ended)
            if ended.returncode == OK and not found:
                break
            stops += 1
            remount(roomy)
            found += four.lost(tmp_path / "disk/data")
            problems += [f"{unit} {number * step}: {problem}" for problem in found]
            shutil.rmtree(tmp_path / "disk/data", ignore_errors=True)
    what = "bytes" if unit == "size" else "inodes"
    record(f"disk full, at every number of {what}", stops, problems)


def test_files_may_not_grow(four, tmp_path, factor):
    """RLIMIT_FSIZE: SIGXFSZ is ignored, so that the limit is an error like any other."""
    largest = max(map(len, four.whole.values()))
    limits = [0, 1, 1000, *range(2048, largest, 4096 * step_of(factor) // 2), largest - 1]
    problems = []
    for limit in limits:
        out = tmp_path / str(limit)
        ended = four.generate(out, preexec_fn=limited(resource.RLIMIT_FSIZE, limit))
        found = problems_of(ended, [TRY_AGAIN], "the limited run")
        found += stopped_by_the_system(four, out, ended) + four.lost(out)
        problems += [f"limit {limit}: {problem}" for problem in found]
    ended = four.generate(tmp_path / "room", preexec_fn=limited(resource.RLIMIT_FSIZE, largest))
    problems += problems_of(ended, [OK], "with just enough room") + four.lost(tmp_path / "room")
    record("file-size limit (RLIMIT_FSIZE)", len(limits), problems)


def test_too_few_file_descriptors(two, tmp_path, factor):
    problems, stops, unloaded = [], 0, 0
    for limit in range(3, 16) if factor > 1 else (*range(3, 8), 15):
        out = tmp_path / str(limit)
        ended = two.generate(out, preexec_fn=limited(resource.RLIMIT_NOFILE, limit))
        if "error while loading shared libraries" in ended.stderr:  # the system's words: the program did not begin
            unloaded += 1
            continue
        stops += ended.returncode != OK
        found = stopped_by_the_system(two, out, ended) if out.exists() else problems_of(ended, [OK, TRY_AGAIN], "it")
        problems += [f"limit {limit}: {problem}" for problem in found + two.lost(out)]
    assert unloaded < 3 and ended.returncode == OK, "15 are enough"
    record("too few file descriptors (RLIMIT_NOFILE 3 to 15)", stops, problems)


@pytest.mark.parametrize("state", [*STATES, "whole"])
def test_the_folder_is_read_only(two, tmp_path, state):
    with faults.disk(tmp_path / "disk", "size=64m") as remount:
        if remount is None:
            pytest.skip("cannot mount a disk here (needs root)")
        out = tmp_path / "disk/data"
        prepare(two, state, out)
        before = files(tmp_path / "disk")
        remount("ro")
        ended = two.generate(out)
        codes = [OK] if state == "whole" else [TRY_AGAIN, CONFIG]
        problems = problems_of(ended, codes, "the run on a read-only disk")
        problems += [] if files(tmp_path / "disk") == before else ["something changed"]
        remount("rw")
        record(f"read-only disk, {state}", 1, problems + two.lost(out), code=ended.returncode)


# --- Others at work on the same folder.


def test_four_writers_of_all_shards(many, tmp_path, factor):
    """Four concurrent runs of the same command, while other processes list missing shards and complete."""
    rounds, problems = factor, []
    for number in range(rounds):
        out = tmp_path / str(number)
        writers = [faults.start("generator", *many.command(out)) for _ in range(4)]
        others = 0
        while any(writer.poll() is None for writer in writers):
            if (out / "meta/info.json").exists():
                others += 1
                problems += problems_of(run("generator", "missing", out), [OK], "missing among writers")
                problems += problems_of(run("generator", "finalize", out), [OK, INCOMPLETE], "finalize among writers")
        for writer in writers:
            problems += problems_of(faults.end(writer), [OK], f"round {number}: a writer")
        problems += [f"round {number}: {problem}" for problem in many.lost(out)]
        assert others > 0
        shutil.rmtree(out)
    record("four writers of all shards at once, with missing and finalize among them", rounds, problems)


def test_writers_killed_among_writers(many, tmp_path, factor):
    rng, problems, kills, span = faults.dice("killed among writers"), [], 0, many.seconds
    while kills < 3 * factor:
        out = tmp_path / str(kills)
        survivor, *victims = [faults.start("generator", *many.command(out)) for _ in range(4)]
        for victim in victims:
            time.sleep(rng.uniform(0, span))
            victim.kill()
            killed = faults.end(victim).returncode == -signal.SIGKILL
            kills += killed
            span *= 1.1 if killed else 0.8  # a victim that was done before shows a machine faster than it was
        found = problems_of(faults.end(survivor), [OK], "the survivor") + many.difference(out) + many.lost(out)
        problems += [f"after {kills} kills: {problem}" for problem in found]
        shutil.rmtree(out)
    record("SIGKILL of writers among four", kills, problems)


@pytest.mark.parametrize("clock", ["2001-01-01 00:00:00", "2099-12-31 23:59:50"])
def test_another_clock(four, tmp_path, clock):
    if shutil.which("faketime") is None:
        pytest.skip("there is no faketime (Debian package faketime)")
    assert ran("faketime", clock, "date", "+%Y").stdout.strip() == clock[:4]
    ended = four.generate(tmp_path / "data", before=["faketime", clock])
    record(f"clock in {clock[:4]}", 1, problems_of(ended, [OK], "the run") + four.lost(tmp_path / "data"))


# --- Another dataset in the folder, and files that are gone. `shards/tests/it/damage.rs` has every damage.


def snapshot(folder):
    times = {str(path): path.stat().st_mtime_ns for path in folder.rglob("*")}
    return files(folder), times


def test_another_dataset_is_refused(two, tmp_path):
    finer = write_config(tmp_path / "finer.toml", **{**SMALL, "resolution": 9})
    wishes = [{"seed": 2}, {"shards": 1}, {"attempts": 6}, {"config": finer}, {"seed": 2, "shard-index": 1}]
    states, problems = ["whole", "begun", "written"], []
    for state in states:
        out = prepare(two, state, tmp_path / state)
        for wish in wishes:
            before = snapshot(out)
            found = problems_of(run("generator", *two.command(out, **wish)), [CONFIG], "the run")
            found += [] if snapshot(out) == before else ["something changed"]
            problems += [f"{wish} into {state}: {problem}" for problem in found]
        problems += two.lost(out)
    times = len(states) * len(wishes)
    record("another seed, number of shards or attempts, or config in the folder: code 78", times, problems)


def test_another_version_is_refused(two, tmp_path):
    out = prepare(two, "whole", tmp_path / "data")
    info = out / "meta/info.json"
    text, count = re.subn(r'("code_version": ")[^"]*', r"\g<1>0.0.1", info.read_text())
    assert count == 1
    info.write_text(text)
    before, ended = snapshot(out), two.generate(out)
    problems = problems_of(ended, [CONFIG], "the run") + ([] if snapshot(out) == before else ["something changed"])
    assert "code_version" in ended.stderr, ended
    record("another version in the same folder: code 78", 1, problems)


def test_files_that_were_deleted_are_made_again(four, tmp_path, factor):
    rng, problems = faults.dice("deleted"), []
    names = [name for name in four.whole if name != "meta/info.json"]
    cases = [[name] for name in names[:: step_of(factor)]] + [rng.sample(names, rng.randint(2, len(names))) for _ in range(2 * factor)]
    for number, gone in enumerate(cases):
        out = four.copy(tmp_path / str(number), without=gone)
        ended = four.generate(out)
        found = problems_of(ended, [OK], "the next run") + four.difference(out)
        problems += [f"without {gone}: {problem}" for problem in found]
        shutil.rmtree(out)
    record("files deleted from a whole dataset, the same command again", len(cases), problems)
