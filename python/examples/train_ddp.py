"""A network in PyTorch, trained by several processes: on one machine, or on many.

    torchrun --nproc-per-node 2 train_ddp.py DATASET --out runs/ddp --epochs 10
    export TORCH_DISABLE_SHARE_RDZV_TCP_STORE=1
    torchrun --nproc-per-node 2 --max-restarts 3 train_ddp.py DATASET --out runs/ddp --epochs 10 --resume

Each process reads its own scenes. Rank 0 writes a checkpoint every few steps; with --resume a run goes on at its checkpoint,
and ends as if it had never stopped. Without the variable, processes that torchrun starts again may find the addresses of the
old ones (PyTorch's issue 135712). docs/cluster.md has the commands for Slurm and Kubernetes.
"""

import argparse
import os
import sys
from pathlib import Path
from typing import Any, NoReturn

import graspmill
import torch
import torch.distributed as dist
from graspmill.torch import GraspCropStream, GraspStream, Judge, VoxelNetwork, judge_loss, loss
from torch.nn.parallel import DistributedDataParallel


class Step(torch.nn.Module):
    """The loss of a batch. It contains the network because DDP adds up gradients of what runs in its own ``forward`` alone."""

    def __init__(self, net: Judge | VoxelNetwork) -> None:
        super().__init__()
        self.net = net

    def forward(self, batch: Any) -> Any:
        net = self.net
        value = judge_loss(net.at(batch), batch) if isinstance(net, Judge) else loss(*net.at(batch), batch)
        return value * batch["share"].squeeze()  # the mean over the ranks is then that over all samples


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", help="folder that all processes see, or URL")
    parser.add_argument("--out", type=Path, required=True, help="folder of the checkpoint, which rank 0 reads and writes")
    parser.add_argument("--network", choices=["voxel", "judge"], default="voxel", help="the paper's network, or a judge [voxel]")
    parser.add_argument("--epochs", type=int, default=1, help="epochs of the whole run [1]")
    parser.add_argument("--batch", type=int, default=48, help="samples of a process in a step [48]")
    parser.add_argument("--global-batch", action="store_true", help="--batch is that of all processes: same batches for any number")
    parser.add_argument("--learning-rate", type=float, default=3e-4, help="of Adam [3e-4]")
    parser.add_argument("--workers", type=int, default=0, help="DataLoader workers of a process [0]")
    parser.add_argument("--seed", type=int, default=1, help="of the first weights [1]")
    parser.add_argument("--checkpoint-steps", type=int, default=100, help="steps between checkpoints [100]")
    parser.add_argument("--resume", action="store_true", help="go on at the checkpoint, if there is one")
    return parser.parse_args(words)


def begin() -> torch.device:
    """Joins the processes that torchrun started, and gives this one its device; without torchrun it is alone."""
    is_gpu = torch.cuda.is_available()
    if dist.is_initialized():
        pass  # by Ray Train
    elif "RANK" in os.environ:
        dist.init_process_group("nccl" if is_gpu else "gloo")
    else:
        dist.init_process_group("gloo", init_method="tcp://localhost:0", rank=0, world_size=1)
    device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0"))) if is_gpu else torch.device("cpu")
    if is_gpu:
        torch.cuda.set_device(device)
    return device


def save(path: Path, state: dict[str, Any]) -> None:
    """Writes the checkpoint by rank 0, so that it is the old one or the new one whenever the process is killed."""
    if dist.get_rank() == 0:
        beside = path.with_suffix(".tmp")
        with beside.open("wb") as file:
            torch.save(state, file)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)


def stored(path: Path, resume: bool) -> dict[str, Any] | None:
    """The checkpoint, which rank 0 reads for all. They agree on an error, too, so that none waits for the others."""
    found: list[Any] = [None, None]
    if dist.get_rank() == 0:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not resume:
            found[1] = f"--out must be a new folder, or --resume be given: there is {path}"
        elif path.exists():
            found[0] = torch.load(path, map_location="cpu", weights_only=True)
    dist.broadcast_object_list(found, src=0)
    if found[1]:
        raise graspmill.InputError(found[1])
    state: dict[str, Any] | None = found[0]
    return state


def tell(text: str) -> None:
    """Prints a line, once for all processes."""
    if dist.get_rank() == 0:
        print(text, flush=True)


def train(options: argparse.Namespace) -> None:
    device = begin()
    torch.manual_seed(options.seed)
    dataset = graspmill.Dataset(options.dataset)
    common: dict[str, Any] = {"batch": options.batch, "global_batch": options.global_batch}
    net: Judge | VoxelNetwork
    stream: GraspCropStream | GraspStream
    if options.network == "judge":
        net, stream = Judge(dataset), GraspCropStream(dataset, by="scene", test_share=0.05, other_share=0.02, **common)
    else:
        net, stream = VoxelNetwork(), GraspStream(dataset, **common)
    model = DistributedDataParallel(Step(net.to(device)))
    optimiser = torch.optim.Adam(net.parameters(), lr=options.learning_rate)
    path = options.out / "last.pt"
    if state := stored(path, options.resume):
        net.load_state_dict(state["net"])
        optimiser.load_state_dict(state["optimiser"])
        stream.load_state_dict(state["stream"])
        tell(f"resumed at epoch {stream.epoch + 1}, after {stream.step} steps")

    def keep(step: int) -> None:
        parts = {"net": net.state_dict(), "optimiser": optimiser.state_dict()}
        save(path, {**parts, "stream": stream.state_dict(step, options.workers)})

    loader = torch.utils.data.DataLoader(stream, batch_size=None, num_workers=options.workers)
    for epoch in range(stream.epoch, options.epochs):
        steps = stream.steps(options.workers)
        for step, batch in enumerate(loader, start=stream.step + 1):
            value = model({name: values.to(device) for name, values in batch.items()})
            optimiser.zero_grad()
            value.backward()
            optimiser.step()
            if step % 10 == 0 or step == steps:
                told = value.detach() / dist.get_world_size()
                dist.all_reduce(told)
                tell(f"epoch {epoch + 1}, step {step} of {steps}: {told.item():.4f}")
            if step % options.checkpoint_steps == 0 and step < steps:
                keep(step)
        stream.set_epoch(epoch + 1)
        keep(0)
    if dist.get_rank() == 0:
        net.cpu().save(options.out / "weights.safetensors")
    dist.barrier()  # who started the processes may end them when the first one ends


def main() -> int:
    try:
        train(arguments())
    except graspmill.GraspmillError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    finally:
        if dist.is_initialized():
            dist.destroy_process_group()
    return 0


def leave(code: int) -> NoReturn:
    """Ends the process without the interpreter's own end, in which threads of gloo, which the group leaves, may abort it."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    leave(main())
