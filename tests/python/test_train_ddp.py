"""`python/examples/train_ddp.py` under `torchrun`: two ranks compute what one process does, and a killed rank costs
nothing. Rendezvous and gloo are on loopback, at free ports."""

import os
import sys

import pytest

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
torch = pytest.importorskip("torch")

import graspmill.torch as gt  # noqa: E402
from programs import ROOT, at_seventh_step, ran  # noqa: E402

EXAMPLES = ROOT / "python" / "examples"
END_S = 240
WORDS = ["--network=judge", "--batch=32", "--epochs=2", "--checkpoint-steps=2"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """15 scenes of 60 attempts in 3 shards."""
    return graspmill.generate(tmp_path_factory.mktemp("ddp") / "ds", shards=3, attempts=900, seed=6)


def torchrun(folder, script, *words, restarts=0):
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2", f"--max-restarts={restarts}"]
    env = {**os.environ, "OMP_NUM_THREADS": "1", "TORCH_DISABLE_SHARE_RDZV_TCP_STORE": "1"}
    done = ran(*command, script, *words, cwd=folder, env=env, timeout=END_S, code=None)
    assert done.returncode == 0, done.stderr[-4000:]  # a rank that ends tells of it in a traceback
    return done


# Both networks' gradients, then a whole run of the example in the same group, and one that must be refused.
FIRST = """
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
train_ddp.train(train_ddp.arguments([*{words!r}, "--resume", "--out", "calm"]))
sys.argv[1:] = [*{words!r}, "--out", "calm"]
code = train_ddp.main()
train_ddp.leave(0 if code == graspmill.InputError.exit_code else 1)
"""


@pytest.fixture(scope="module")
def first(dataset, tmp_path_factory):
    """What two ranks computed and said, and the batches of which the gradients are."""
    folder = tmp_path_factory.mktemp("first")
    whole = {"batch": 10, "samples_per_scene": 8, "global_batch": True, "rank": 0, "world_size": 1}
    batches = {name: list(cls(dataset, **whole)) for name, cls in (("voxel", gt.GraspStream), ("judge", gt.GraspCropStream))}
    # An odd number, so that the ranks' shares differ; and a held grasp, without which rotations have no gradient.
    is_wanted = lambda batch: len(batch["label"]) % 2 == 1 and batch["label"].any()  # noqa: E731
    steps = {name: [is_wanted(batch) for batch in listed].index(True) for name, listed in batches.items()}
    script = folder / "first.py"
    location = dataset._native.location
    script.write_text(FIRST.format(examples=str(EXAMPLES), location=location, steps=steps, words=[location, *WORDS]))
    return folder, torchrun(folder, script), {name: listed[steps[name]] for name, listed in batches.items()}


def test_the_gradients_of_two_ranks_are_those_of_the_whole_batch(dataset, first):
    folder, _, batches = first
    found = torch.load(folder / "gradients.pt", weights_only=True)
    for name, make in (("voxel", gt.VoxelNetwork), ("judge", lambda: gt.Judge(dataset))):
        torch.manual_seed(3)
        net, batch = make(), batches[name]
        value = gt.judge_loss(net.at(batch), batch) if name == "judge" else gt.loss(*net.at(batch), batch)
        value.backward()
        for key, parameter in net.named_parameters():
            assert parameter.grad.abs().max() > 0, key
            apart = (found[name][key] - parameter.grad).abs().max()
            assert apart <= 1e-5 * parameter.grad.abs().max() + 1e-8, (name, key, apart)


# Rank 1 is killed once, at its seventh step; the checkpoint before is of the fourth or the sixth.
KILLED = 'if (os.environ["RANK"], os.environ["TORCHELASTIC_RESTART_COUNT"]) == ("1", "0"): os.kill(os.getpid(), signal.SIGKILL)'


def test_a_run_whose_rank_is_killed_ends_as_one_that_is_not(dataset, first, tmp_path):
    folder, calm, _ = first
    script = tmp_path / "killed.py"
    script.write_text(at_seventh_step(KILLED))
    torchrun(tmp_path, script, dataset._native.location, *WORDS, "--resume", "--out", "killed", restarts=1)
    weights = [gt.Judge.load(run / "weights.safetensors").state_dict() for run in (folder / "calm", tmp_path / "killed")]
    assert all(torch.equal(tensor, weights[1][name]) for name, tensor in weights[0].items())
    losses = [float(line.rsplit(": ", 1)[1]) for line in calm.stdout.splitlines() if line.startswith("epoch")]
    assert losses[-1] < losses[0]
    assert not [*folder.glob("*/*.tmp"), *tmp_path.glob("*/*.tmp")]
    assert "error: --out must be a new folder, or --resume be given: there is calm/last.pt" in calm.stderr
