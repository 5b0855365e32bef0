"""A real Ray of two nodes on loopback: after the loss of one, a dataset and the streams of a training are the same."""

import hashlib
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest
import slurm
from programs import ROOT, assert_same, executable, program, run, until

ray = pytest.importorskip("ray", reason="there is no ray (pip install ray)")
from ray.cluster_utils import Cluster  # noqa: E402

PAGE = (ROOT / "docs/cluster.md").read_text()
MAKE, READ = re.findall(r"```python\n(.*?)```", PAGE.partition("\n## Ray\n")[2].partition("\n## ")[0], re.DOTALL)
FIRST, SECOND = "127.0.0.2", "127.0.0.3"  # 127.0.0.1 would become an address of the machine
SHARDS = 6
SIZE = ["--config", ROOT / "configs/generate/demo.toml", "--attempts", SHARDS * 60]
END_S = 120

# Else a lost node is noticed after a quarter of a minute.
NOTICING = {"health_check_initial_delay_ms": 0, "health_check_period_ms": 250, "health_check_failure_threshold": 4}

# What the nodes have as graspmill: each makes a shard, then the second node hangs, and the first one waits for that.
HANGING = """#!/bin/sh
[ "$1" = generate ] || exec {program} "$@"
cd {folder}
echo "on $SECOND" >>starts
if [ "$(grep -cx "on $SECOND" starts)" -gt 1 ]; then
    [ -z "$SECOND" ] || {{ touch hanging; exec sleep {end_s}; }}
    while [ ! -e hanging ]; do sleep 0.05; done
fi
exec {program} "$@" {size}
"""


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A cluster whose first node, its head, stays; and the folder where the nodes' graspmill tells of its starts."""
    bin, size = tmp_path_factory.mktemp("bin"), " ".join(map(str, SIZE))
    executable(bin / "graspmill", HANGING.format(folder=bin, program=program("graspmill"), end_s=END_S, size=size))
    # Not pytest's folder: a socket's path has at most 107 bytes.
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="ray-") as folder:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")  # it would tell its makers
        patch.setenv("PATH", f"{bin}:{os.environ['PATH']}")
        patch.setenv("RAY_TMPDIR", folder)
        node = {"node_ip_address": FIRST, "num_cpus": 1, "include_dashboard": False}
        cluster = Cluster(initialize_head=True, head_node_args={**node, "_system_config": NOTICING})
        yield cluster, bin
        cluster.shutdown()


def add_second(cluster):
    """A node, and a word that the environment of its processes has."""
    word = f"{os.getpid()}-{time.monotonic_ns()}"
    return cluster.add_node(node_ip_address=SECOND, num_cpus=1, env_vars={"SECOND": word}), word


def lose(cluster, node, word):
    """As if its power failed: none of its processes is left."""
    for pid in slurm.processes(SECOND=word):
        slurm.send(pid, signal.SIGKILL)
    cluster.remove_node(node, allow_graceful=False)


def test_a_dataset_outlives_the_loss_of_a_node(first, tmp_path):
    """The page's own program, with fewer shards."""
    cluster, bin = first
    second = add_second(cluster)
    assert MAKE.count("64") == 2
    begin = f"import ray\nray.init({cluster.address!r}, _node_ip_address={FIRST!r})\nOUT = {str(tmp_path / 'out')!r}\n"
    (tmp_path / "make.py").write_text(begin + MAKE.replace("64", str(SHARDS)))
    with (tmp_path / "said").open("w") as said:
        driver = subprocess.Popen([sys.executable, tmp_path / "make.py"], stdout=said, stderr=said)
    hangs = lambda: (bin / "hanging").exists() or driver.poll() is not None
    until(hangs, END_S, "the second node comes to no second shard")
    lose(cluster, *second)
    assert driver.wait(END_S) == 0, (tmp_path / "said").read_text()
    assert len((bin / "starts").read_text().splitlines()) == SHARDS + 1
    run("generator", *SIZE, "--shards", SHARDS, "--out", tmp_path / "at_once", code=0)
    assert_same(tmp_path / "out", tmp_path / "at_once")


# The nodes' processes need not import this file.
ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])


def digest(batch):
    return hashlib.sha256(b"".join(np.asarray(batch[name]).tobytes() for name in sorted(batch))).hexdigest()


@pytest.fixture
def driver(first):
    """This process, as one that gives a cluster its tasks."""
    cluster, _ = first
    ray.init(cluster.address, _node_ip_address=FIRST, log_to_driver=False)
    yield cluster
    ray.shutdown()


def test_streams_outlive_the_loss_of_a_node(driver, dataset, tmp_path):
    """Each rank goes on at its own checkpoint; Ray Data reads the same batches, and the tables."""
    pytest.importorskip("torch")
    from graspmill.torch import GraspStream

    second = add_second(driver)

    @ray.remote(num_cpus=1, max_retries=2, scheduling_strategy="SPREAD")
    def epoch(rank):
        """Where the last start began, and every batch; all starts wait at the fifth step until a node is lost."""
        stream, kept, made = GraspStream(dataset, rank=rank, world_size=2), tmp_path / f"{rank}.pickle", []
        if kept.exists():
            state, made = pickle.loads(kept.read_bytes())
            stream.load_state_dict(state)
        begun = stream.step
        for step, batch in enumerate(stream, begun + 1):
            made.append(digest(batch))
            (tmp_path / f"{rank}.tmp").write_bytes(pickle.dumps((stream.state_dict(step), made)))
            (tmp_path / f"{rank}.tmp").replace(kept)
            if step == 5:
                (tmp_path / f"waiting-{rank}").touch()
                while not (tmp_path / "lost").exists():
                    time.sleep(0.05)
        return begun, made

    ranks = [epoch.remote(rank) for rank in range(2)]
    is_waiting = lambda: len(list(tmp_path.glob("waiting-*"))) == 2
    until(is_waiting, END_S, "the ranks do not come to their fifth step")
    lose(driver, *second)
    (tmp_path / "lost").touch()
    begun, made = zip(*ray.get(ranks, timeout=END_S))
    streams = [GraspStream(dataset, rank=rank, world_size=2) for rank in range(2)]
    wanted = [[digest(batch) for batch in stream] for stream in streams]
    assert sorted(begun) == [0, 5] and list(made) == wanted and min(map(len, wanted)) > 5

    read = {"__name__": "__main__", "ray": ray, "OUT": dataset._native.location}
    exec(READ, read)
    assert sorted(map(digest, read["batches"].iter_rows())) == sorted(sum(wanted, []))
    assert sum(row["label"] for row in read["attempts"].iter_rows()) == dataset.positive_count
