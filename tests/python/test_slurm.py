"""scripts/cluster on a real Slurm on loopback (slurm.py): after any kills, datasets and training end the same."""

import contextlib
import os
import random
import signal
import time
from collections import Counter
from pathlib import Path

import pytest
from programs import DATASET, PROGRAMS, QUICK, ROOT, assert_same, executable, metrics, run
import slurm

SEED = int(os.environ.get("GRASPMILL_CHAOS_SEED", random.randrange(1_000_000)))
SCRIPTS = ROOT / "scripts/cluster"
DEMO = ROOT / "configs/generate/demo.toml"

CHAOS_S = 240  # all rounds
ROUND_S = 40  # tasks that are not over by then are left to the next round
PROGRAM_S = 90

pytestmark = pytest.mark.skipif(slurm.available() != "", reason=slurm.available())


@pytest.fixture(scope="module")
def calm():
    """A cluster of which no node is lost."""
    with slurm.cluster(nodes=2, cpus=2) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def training():
    """As `calm`, where Slurm starts no job again by itself."""
    with slurm.cluster(nodes=3, cpus=1, requeue_exit=None) as cluster:
        yield cluster


def generate_at_once(out, *size):
    run("generator", "--config", DEMO, *size, "--out", out, code=0)


def missing(out, *more):
    return run("generator", "missing", out, *more, code=0).stdout.strip()


def generate(cluster, out, array, shards, *size, **more):
    """Submits the script as a user does, but for the little that these nodes have."""
    script = ["--cpus-per-task=1", f"--array={array}", SCRIPTS / "generate.sbatch", *size]
    settings = {"OUT": out, "SHARDS": shards, "CONFIG": DEMO, "GRASPMILL": PROGRAMS / "graspmill", **more}
    return cluster.submit(*script, cwd=out.parent, **settings)


def train(cluster, folder, *options, **settings):
    script = ["--cpus-per-task=1", SCRIPTS / "train.sbatch", *options]
    return cluster.submit(*script, cwd=folder, **{"DATA": DATASET, "CONFIG": QUICK, "RUN": folder / "run", **settings})


def log_of(folder, job="*"):
    """The output of a job, or of all jobs, so far: every task and every start."""
    return "".join(path.read_text() for path in sorted(folder.glob(f"*-{job}[._]*")))


def starts(folder, job="*"):
    return log_of(folder, job).count(", node n")


SUSPENDED = "T"


class Chaos:
    def __init__(self, cluster, work_s, kills, stops, losses, silent_s):
        """Processes killed or asked to stop, and nodes lost for so long, over about the undisturbed run time."""
        self.cluster, self.silent_s = cluster, silent_s
        self.dice = random.Random(SEED)
        self.all = ["kill"] * kills + ["stop"] * stops + ["lose"] * losses
        self.kills, self.left = kills, self.dice.sample(self.all, len(self.all))
        self.every_s = work_s / len(self.left)
        self.dealt = Counter()
        self.lost = {}  # nodes, and when their tasks go on

    def was_enough(self):
        return 2 * self.dealt["kill"] >= self.kills and self.dealt["wake"] >= 1

    def run(self, job):
        """Injects faults until the job is over; cancels what Slurm has not finished in time."""
        ends = time.monotonic() + ROUND_S
        while not self.cluster.is_over(job) and time.monotonic() < ends:
            time.sleep(self.dice.expovariate(1 / self.every_s))
            self.strike()
            self.heal(time.monotonic())
        self.cluster.call("scancel", job, check=False)

    def strike(self):
        self.left = self.left or self.dice.sample(self.all, len(self.all))  # until there were enough
        blow = self.left[-1]
        if self.lose_node() if blow == "lose" else self.hit_generator(blow):
            self.dealt[self.left.pop()] += 1

    def hit_generator(self, blow):
        """Whether a process was there to suspend."""
        known = [pid for name in self.cluster.nodes if name not in self.lost for pid in self.tasks(name)]
        if not known:
            return False
        pid = self.dice.choice(known)
        slurm.send(pid, signal.SIGSTOP)
        while slurm.state_of(pid) in "RSD":
            time.sleep(0.001)
        was_alive = slurm.state_of(pid) == SUSPENDED
        slurm.send(pid, signal.SIGKILL if blow == "kill" else signal.SIGTERM)
        slurm.send(pid, signal.SIGCONT)
        return was_alive

    def lose_node(self):
        """Suspends a busy node. Slurm restarts its tasks elsewhere, and then the old ones continue: shards have two writers."""
        busy = [name for name in self.cluster.nodes if name not in self.lost and self.tasks(name)]
        if not busy:
            return False
        name = self.dice.choice(busy)
        self.cluster.kill_node(name)
        for pid in self.tasks(name):
            slurm.send(pid, signal.SIGSTOP)
        self.cluster.call("scontrol", "update", f"NodeName={name}", "State=DOWN", "Reason=lost")
        self.lost[name] = time.monotonic() + self.dice.uniform(*self.silent_s)
        return True

    def tasks(self, node):
        return self.cluster.processes("graspmill", SLURMD_NODENAME=node)

    def heal(self, now):
        """Whether all nodes are back. A node returns when its old tasks have ended, because Slurm would end them."""
        for name in [name for name, back in self.lost.items() if back <= now]:
            for pid in self.tasks(name):
                self.dealt["wake"] += slurm.state_of(pid) == SUSPENDED
                slurm.send(pid, signal.SIGCONT)
            if not self.tasks(name):
                del self.lost[name]
                self.cluster.start_node(name)
        return not self.lost


def test_a_dataset_outlives_the_loss_of_processes_and_nodes(tmp_path, factor):
    print(f"\nGRASPMILL_CHAOS_SEED={SEED}")
    # A shard of 1,200 attempts takes one to four seconds of a core; 5 s after a loss Slurm starts its tasks elsewhere.
    shards, attempts, faults = (16, 1_200, (20, 4, 4, (6, 12))) if factor > 1 else (8, 600, (4, 1, 1, (6, 7)))
    outs, size = [], ["--attempts", shards * attempts]
    began = time.monotonic()
    generate_at_once(tmp_path / "at_once", "--shards", shards, *size)
    work_s = time.monotonic() - began
    rounds = 0
    with slurm.cluster(nodes=4, cpus=2) as cluster:
        chaos = Chaos(cluster, work_s, *faults)
        # Where the machine is faster than it just was, a dataset is done before enough faults: then one more, with
        # faults at twice the rate.
        while not (chaos.was_enough() and rounds > len(outs)) and time.monotonic() < began + CHAOS_S:
            outs.append(tmp_path / f"grasps-{len(outs)}")
            array = f"0-{shards - 1}"
            while array and time.monotonic() < began + CHAOS_S:
                chaos.run(generate(cluster, outs[-1], array, shards, *size))
                array, rounds = missing(outs[-1]), rounds + 1
            chaos.every_s /= 2
        cluster.until(lambda: chaos.heal(float("inf")), PROGRAM_S, "lost tasks do not end")
    for out in outs:
        run("generator", "finalize", out, code=0)
    begun, made = starts(tmp_path), log_of(tmp_path).count("attempts/s")
    seconds = f"{time.monotonic() - began:.0f} s, undisturbed {work_s:.0f} s"
    print(f"{dict(chaos.dealt)}: {len(outs)} datasets, {begun} starts, {made} ends, {rounds} rounds, {seconds}")
    assert chaos.was_enough() and begun > shards * len(outs) and rounds > len(outs)
    for out in outs:
        assert_same(out, tmp_path / "at_once")


def test_few_tasks_make_many_shards(calm, tmp_path):
    out, size = tmp_path / "grasps", ["--attempts", 480]
    more = {"TASKS": 3, "OPTIONS": " ".join(map(str, size))}
    calm.wait(generate(calm, out, 1, 8, **more), seconds=60)
    assert (missing(out), missing(out, "--tasks", 3)) == ("0,2-3,5-6", "0,2")
    job = generate(calm, out, missing(out, "--tasks", 3), 8, **more)
    last = calm.submit(f"--dependency=afterany:{job}", "--wrap", f"{PROGRAMS / 'generator'} finalize {out}", cwd=tmp_path)
    calm.wait(last, seconds=60)
    assert set(calm.states(last).values()) == {"COMPLETED"}, log_of(tmp_path, job)
    assert missing(out, "--tasks", 3) == ""
    job = generate(calm, out, missing(out, "--tasks", 3), 8, **more)
    calm.wait(job, seconds=60)
    assert set(calm.states(job).values()) == {"COMPLETED"} and "no shard was missing" in log_of(tmp_path, job), log_of(tmp_path, job)
    generate_at_once(tmp_path / "at_once", "--shards", 8, *size)
    assert_same(out, tmp_path / "at_once")


def test_a_program_that_the_nodes_do_not_have_is_named(calm, tmp_path):
    job = generate(calm, tmp_path / "grasps", 0, 1, GRASPMILL="no-such-program")
    calm.wait(job, seconds=60)
    assert set(calm.states(job).values()) == {"FAILED"}
    assert "error: no-such-program is no program on node" in log_of(tmp_path, job)


def warn(cluster, job):
    """Like --signal before the time limit: only the script receives the signal."""
    cluster.call("scancel", "--signal=TERM", "--batch", job)


def test_a_task_stops_before_its_time_limit_and_starts_again(calm, tmp_path):
    job = generate(calm, tmp_path / "grasps", 0, 1, "--attempts", 20_000)
    calm.until((tmp_path / "grasps/meta/info.json").exists, PROGRAM_S, "the generator does not begin")
    warn(calm, f"{job}_0")
    calm.until(lambda: starts(tmp_path, job) == 2, PROGRAM_S, "the task does not start again")
    said = log_of(tmp_path, job)
    calm.call("scancel", job)
    assert said.count("stopping: abandoning the scenes under way") == 1


def requeue(cluster, job):
    cluster.call("scontrol", "requeue", job)


def preempt(cluster, _):
    everywhere = ["--partition=urgent", "--exclusive", f"--nodes={len(cluster.nodes)}"]
    cluster.submit(*everywhere, "--wrap=true", cwd=cluster.folder)


def interrupt(cluster, job, how):
    """Suspends the trainer until the stop signal, so that a fast trainer cannot end earlier."""
    (trainer,) = cluster.processes("graspmill")
    slurm.send(trainer, signal.SIGSTOP)
    how(cluster, job)
    cluster.until(lambda: is_told(trainer), PROGRAM_S, "no signal to stop reached the trainer")
    slurm.send(trainer, signal.SIGCONT)
    cluster.until(lambda: not slurm.is_alive(trainer), PROGRAM_S, "the trainer does not stop")


def is_told(pid):
    """Whether a SIGTERM is pending or has ended it."""
    with contextlib.suppress(OSError):
        rows = dict(row.split(":", 1) for row in Path(f"/proc/{pid}/status").read_text().splitlines())
        return not slurm.is_alive(pid) or int(rows["ShdPnd"], 16) >> (signal.SIGTERM - 1) & 1 == 1
    return True


def test_training_goes_on_after_requeue_preemption_and_time_limit(training, tmp_path, factor):
    """Slurm preempts by a requeue of its own, so one of the two is enough where time matters."""
    made, undisturbed, cluster = tmp_path / "run", tmp_path / "undisturbed", training
    ways = [preempt, warn] if factor == 1 else [requeue, preempt, warn]
    count, epochs = len(ways), 2 * len(ways)
    job = train(cluster, tmp_path, "--epochs", epochs, GRASPMILL=PROGRAMS / "graspmill")
    for start, how in enumerate(ways, 1):
        done = len(metrics(made))
        cluster.until(lambda: len(metrics(made)) > done, PROGRAM_S, f"start {start} makes no epoch")
        assert starts(tmp_path, job) == start
        interrupt(cluster, job, how)
    cluster.wait(job, seconds=PROGRAM_S)
    log = log_of(tmp_path, job)
    assert cluster.states(job) == {job: "COMPLETED"}, log
    assert (log.count("stopped by a signal"), log.count("resumed "), starts(tmp_path, job)) == (count, count, count + 1), log
    run("trainer", "fit", "--data", DATASET, "--config", QUICK, "--epochs", epochs, "--run", undisturbed, code=0)
    assert len(metrics(undisturbed)) == epochs and metrics(made) == metrics(undisturbed)
    for name in ("best.safetensors", "last.safetensors"):
        assert (made / name).read_bytes() == (undisturbed / name).read_bytes(), name


STUB = """#!/bin/bash
[[ $CODE ]] && exit "$CODE"
trap "sleep 1; exit 75" TERM
echo waiting
sleep 20 &
wait
"""


def test_training_is_not_started_for_ever(training, tmp_path):
    trainer = executable(tmp_path / "stub", STUB)
    damaged = train(training, tmp_path, GRASPMILL=trainer, CODE=65)
    in_trouble = train(training, tmp_path, GRASPMILL=trainer, CODE=75, RESTARTS_MAX=1)
    cancelled = train(training, tmp_path, GRASPMILL=trainer, CODE="")
    training.until(lambda: "waiting" in log_of(tmp_path, cancelled), PROGRAM_S, "no trainer")
    training.call("scancel", cancelled)
    expected = {damaged: (1, "FAILED"), in_trouble: (2, "FAILED"), cancelled: (1, "CANCELLED")}
    for job in expected:
        training.wait(job, seconds=60)
    assert {job: (starts(tmp_path, job), training.states(job)[job]) for job in expected} == expected
