"""scripts/cluster/train_ddp.sbatch on a real Slurm; kubernetes-train-ddp.yaml against schemas and what it starts."""

import argparse
import re
import shlex
import sys
from pathlib import Path

import pytest
import slurm
import yaml
from programs import ROOT, at_seventh_step, changed, executable
from test_kubernetes import VERSIONS, container, job_problems, mounts_of, place_problems, pod, schema_problems, variables_of, wrong

CLUSTER = ROOT / "scripts/cluster"
EXAMPLE = ROOT / "python/examples/train_ddp.py"
SERVICE, JOB = yaml.safe_load_all((CLUSTER / "kubernetes-train-ddp.yaml").read_text())
LAUNCHER = {"--nnodes", "--nproc-per-node", "--rdzv-backend", "--rdzv-endpoint", "--rdzv-id", "--max-restarts"}
END_S = 120


def options(args):
    """The launcher's options, the script, and the script's words."""
    script = next(place for place, word in enumerate(args) if not word.startswith("--"))
    return dict(word.split("=", 1) for word in args[:script]), args[script], args[script + 1 :]


def meeting_problems(service, job):
    """The pods find each other: names, ports and numbers agree."""
    launcher, _, words = options(container(job)["args"])
    spec, own, name = job["spec"], service["spec"], job["metadata"]["name"]
    flags = {word.split("=")[0] for word in words if word.startswith("--")}
    known = set(re.findall(r'add_argument\("(--[a-z-]+)"', EXAMPLE.read_text()))
    return wrong({
        "--rdzv-endpoint": launcher["--rdzv-endpoint"] == f"{name}-0.{pod(job)['subdomain']}:{own['ports'][0]['port']}",
        "--nnodes": launcher["--nnodes"] == str(spec["completions"]) == str(spec["parallelism"]),
        "--rdzv-backend": launcher["--rdzv-backend"] == "c10d",
        "subdomain": service["metadata"]["name"] == pod(job)["subdomain"],
        "selector": own["selector"] == {"batch.kubernetes.io/job-name": name},
        "every pod has a name": (own["clusterIP"], own["publishNotReadyAddresses"]) == ("None", True),
        "options of the launcher": launcher.keys() <= LAUNCHER,
        "flags of train_ddp.py": {"--out", "--resume"} <= flags <= known,
    })  # fmt: skip


def run_problems(job):
    mounts = mounts_of(job)
    run = next((Path(word.split("=")[1]) for word in container(job)["args"] if word.startswith("--out=")), Path())
    return place_problems(job, ("TMPDIR", "HOME")) + wrong({
        "TORCH_DISABLE_SHARE_RDZV_TCP_STORE must be 1": variables_of(job).get("TORCH_DISABLE_SHARE_RDZV_TCP_STORE") == "1",
        "workers pass batches through /dev/shm": mounts.get("/dev/shm", {}).get("emptyDir", {}).get("medium") == "Memory",
        "--out must lie in a volume that stays": "persistentVolumeClaim" in mounts.get(str(run.parent), {}),
    })  # fmt: skip


def problems(service, job, versions=VERSIONS):
    found = schema_problems(service, versions) + schema_problems(job, versions)
    return found or job_problems(job) + meeting_problems(service, job) + run_problems(job)


def test_the_manifest_is_right_and_a_broken_one_is_refused():
    assert problems(SERVICE, JOB) == []
    pod, box = "spec.template.spec", "spec.template.spec.containers.0"
    for path, value, text in [
        ("spec.paralelism", 2, "paralelism"), ("spec.completions", 3, "--nnodes"), (f"{pod}.subdomain", "train", "--rdzv-endpoint"),
        (f"{pod}.volumes.1", ..., "/dev/shm"),
        (f"{pod}.volumes.2", {"name": "runs", "emptyDir": {"sizeLimit": "1Gi"}}, "a volume that stays"),
        (f"{box}.args.5", "--max-restart=20", "options of the launcher"), (f"{box}.args.10", ..., "flags of train_ddp.py"),
        (f"{box}.env.2.value", "/root", "HOME must be"),
    ]:  # fmt: skip
        found = problems(SERVICE, changed(JOB, path, value), VERSIONS[:1])
        assert any(text in problem for problem in found), (path, found)
    assert "selector" in problems(changed(SERVICE, "spec.selector", {"job-name": "train"}), JOB, VERSIONS[:1])


def test_torchrun_takes_the_options_of_the_files():
    pytest.importorskip("torch")
    from torch.distributed.run import get_args_parser

    args = container(JOB)["args"]
    script = (CLUSTER / "train_ddp.sbatch").read_text()
    line = re.search(r"\"\$\{TORCHRUN:-torchrun\}\" (.*?)\"\$\{SCRIPT", script, re.DOTALL)[1].replace("\\\n", " ")
    line = re.sub(r"\$\{?[a-zA-Z_]+\}?", "2", line)
    for words in (args, [*shlex.split(line), *args[6:]]):
        parsed: argparse.Namespace = get_args_parser().parse_args(words)
        assert (parsed.nnodes, parsed.rdzv_backend, parsed.training_script) == ("2", "c10d", "/app/train_ddp.py")
        assert parsed.training_script_args == args[7:]


# The first start waits at its seventh step until it is ended; the checkpoint before is of the sixth.
WAITING = f"""if "SLURM_RESTART_COUNT" not in os.environ: open("waiting-" + os.environ["RANK"], "w").close(), time.sleep({END_S})"""


@pytest.mark.long
@pytest.mark.skipif(slurm.available() != "", reason=slurm.available())
def test_a_job_of_two_nodes_goes_on_after_its_time_limit(tmp_path):
    graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
    pytest.importorskip("torch")
    graspmill.generate(tmp_path / "grasps", shards=2, attempts=720, seed=6)
    script = executable(tmp_path / "waiting.py", at_seventh_step(WAITING))
    # Both nodes are this machine, whose name may have no address.
    program = f'exec {sys.executable} -m torch.distributed.run --local-addr 127.0.0.1 "$@"'
    torchrun = executable(tmp_path / "torchrun", f"#!/bin/sh\n{program}\n")
    settings = {"DATA": tmp_path / "grasps", "RUN": tmp_path / "run", "SCRIPT": script, "TORCHRUN": torchrun, "HEAD": "127.0.0.1"}
    words = ["--network=judge", "--batch=24", "--epochs=2", "--checkpoint-steps=2"]
    with slurm.cluster(nodes=2, cpus=1, requeue_exit=None) as cluster:
        settings["PORT"] = slurm.free_ports(1)
        small = ["--cpus-per-task=1", "--mem=1G"]
        job = cluster.submit(*small, CLUSTER / "train_ddp.sbatch", *words, cwd=tmp_path, **settings)
        log = tmp_path / f"train-ddp-{job}.log"
        cluster.until(lambda: len(list(tmp_path.glob("waiting-*"))) == 2 or cluster.is_over(job), END_S, "no seventh step")
        assert not cluster.is_over(job), log.read_text()
        cluster.call("scancel", "--signal=TERM", "--batch", job)
        cluster.until(lambda: "start 2, node" in log.read_text(), END_S, "the job does not start again")
        cluster.wait(job, seconds=END_S)
        assert cluster.states(job) == {job: "COMPLETED"}, log.read_text()
    said = log.read_text()
    steps = int(re.search(r"epoch 2, step (\d+) of \1:", said)[1])
    epoch, done = map(int, re.search(r"resumed at epoch (\d+), after (\d+) steps", said).groups())
    assert (epoch - 1) * steps + done == 6 and (tmp_path / "run/weights.safetensors").exists()
