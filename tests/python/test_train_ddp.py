"""`python/examples/train_ddp.py` under `torchrun`: two ranks compute what one process does, and a killed rank costs nothing.

Rendezvous and gloo are on loopback, at free ports.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
torch = pytest.importorskip("torch")

import graspmill.torch as gt  # noqa: E402

EXAMPLES = Path(__file__).parents[2] / "python" / "examples"
END_S = 240


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """15 scenes of 60 attempts in 3 shards."""
    return graspmill.generate(tmp_path_factory.mktemp("ddp") / "ds", shards=3, attempts=900, seed=6)


def torchrun(folder, script, *words, restarts=0):
    """Runs a script as two ranks with one thread each."""
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2", f"--max-restarts={restarts}"]
    env = {**os.environ, "OMP_NUM_THREADS": "1", "TORCH_DISABLE_SHARE_RDZV_TCP_STORE": "1"}
    done = subprocess.run([*command, script, *map(str, words)], cwd=folder, env=env, capture_output=True, text=True, timeout=END_S)
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout


GRADIENTS = """
import os, sys
sys.path.insert(0, {examples!r})
import graspmill, torch
import torch.distributed as dist
import train_ddp
from graspmill.torch import GraspCropStream, GraspStream, Judge, VoxelNetwork

train_ddp.begin()
dataset, found = graspmill.Dataset({location!r}), {{}}
for name, cls, make in (("voxel", GraspStream, VoxelNetwork), ("judge", GraspCropStream, lambda: Judge(dataset))):
    stream = cls(dataset, batch=10, samples_per_scene=8, global_batch=True)
    assert (stream.rank, stream.world_size) == (int(os.environ["RANK"]), 2)
    torch.manual_seed(3)
    net = make()
    step = torch.nn.parallel.DistributedDataParallel(train_ddp.Step(net))
    stream.set_epoch(0, {steps!r}[name])
    step(next(iter(stream))).backward()
    found[name] = {{key: value.grad for key, value in net.named_parameters()}}
if dist.get_rank() == 0:
    torch.save(found, "gradients.pt")
dist.destroy_process_group()
train_ddp.leave(0)
"""


def test_the_gradients_of_two_ranks_are_those_of_the_whole_batch(dataset, tmp_path):
    nets = {"voxel": (gt.GraspStream, gt.VoxelNetwork), "judge": (gt.GraspCropStream, lambda: gt.Judge(dataset))}
    whole = {"batch": 10, "samples_per_scene": 8, "global_batch": True, "rank": 0, "world_size": 1}
    batches = {name: list(cls(dataset, **whole)) for name, (cls, _) in nets.items()}
    # An odd number, so that the ranks' shares differ; and a held grasp, without which rotations have no gradient.
    is_wanted = lambda batch: len(batch["label"]) % 2 == 1 and batch["label"].any()  # noqa: E731
    steps = {name: [is_wanted(batch) for batch in listed].index(True) for name, listed in batches.items()}
    script = tmp_path / "gradients.py"
    script.write_text(GRADIENTS.format(examples=str(EXAMPLES), location=dataset._native.location, steps=steps))
    torchrun(tmp_path, script)
    found = torch.load(tmp_path / "gradients.pt", weights_only=True)
    for name, (_, make) in nets.items():
        torch.manual_seed(3)
        net, batch = make(), batches[name][steps[name]]
        value = gt.judge_loss(net.at(batch), batch) if name == "judge" else gt.loss(*net.at(batch), batch)
        value.backward()
        for key, parameter in net.named_parameters():
            assert parameter.grad.abs().max() > 0, key
            apart = (found[name][key] - parameter.grad).abs().max()
            assert apart <= 1e-5 * parameter.grad.abs().max() + 1e-8, (name, key, apart)


# Rank 1 is killed once, at its seventh step; the checkpoint before is of the fourth or the sixth.
KILLED = """
import os, signal, sys
sys.path.insert(0, {examples!r})
import train_ddp

forward, steps = train_ddp.Step.forward, []


def killed(self, batch):
    steps.append(None)
    if (os.environ["RANK"], os.environ["TORCHELASTIC_RESTART_COUNT"], len(steps)) == ("1", "0", 7):
        os.kill(os.getpid(), signal.SIGKILL)
    return forward(self, batch)


train_ddp.Step.forward = killed
train_ddp.leave(train_ddp.main())
"""


def test_a_run_whose_rank_is_killed_ends_as_one_that_is_not(dataset, tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(KILLED.format(examples=str(EXAMPLES)))
    words = [dataset._native.location, "--network=judge", "--batch=32", "--epochs=2", "--checkpoint-steps=2", "--resume", "--out"]
    calm = torchrun(tmp_path, EXAMPLES / "train_ddp.py", *words, "calm")
    torchrun(tmp_path, script, *words, "killed", restarts=1)
    weights = [gt.Judge.load(tmp_path / run / "weights.safetensors").state_dict() for run in ("calm", "killed")]
    assert all(torch.equal(tensor, weights[1][name]) for name, tensor in weights[0].items())
    losses = [float(line.rsplit(": ", 1)[1]) for line in calm.splitlines() if line.startswith("epoch")]
    assert losses[-1] < losses[0]
    assert not list(tmp_path.glob("*/*.tmp"))
    again = [sys.executable, EXAMPLES / "train_ddp.py", *words[:-2], "--out", "calm"]
    refused = subprocess.run(list(map(str, again)), cwd=tmp_path, capture_output=True, text=True, timeout=END_S)
    assert refused.returncode == graspmill.InputError.exit_code
    assert refused.stderr.splitlines()[-1] == "error: --out must be a new folder, or --resume be given: there is calm/last.pt"
