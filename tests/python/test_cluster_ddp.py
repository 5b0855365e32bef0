"""scripts/cluster/train_ddp.sbatch on a real Slurm, and kubernetes-train-ddp.yaml against schemas and what it starts.

    python -m pytest tests/python/test_cluster_ddp.py

No network but loopback; without Slurm or PyTorch the tests that need them are skipped with a reason.
"""

import argparse
import copy
import re
import shlex
import sys
from pathlib import Path

import pytest
import slurm
import yaml
from test_kubernetes import VERSIONS, changed, container, job_problems, mounts_of, place_problems, pod, schema_problems, variables_of

ROOT = Path(__file__).parents[2]
CLUSTER = ROOT / "scripts/cluster"
EXAMPLE = ROOT / "python/examples/train_ddp.py"
SERVICE, JOB = yaml.safe_load_all((CLUSTER / "kubernetes-train-ddp.yaml").read_text())
LAUNCHER = {"--nnodes", "--nproc-per-node", "--rdzv-backend", "--rdzv-endpoint", "--rdzv-id", "--max-restarts"}
END_S = 120


def options(args):
    """The launcher's options, the script, and the script's words."""
    script = next(place for place, word in enumerate(args) if not word.startswith("--"))
    return dict(word.split("=", 1) for word in args[:script]), args[script], args[script + 1 :]


def flags_of_the_example():
    return set(re.findall(r'add_argument\("(--[a-z-]+)"', EXAMPLE.read_text()))


def meeting_problems(service, job):
    """The pods find each other: names, ports and numbers agree."""
    launcher, _, words = options(container(job)["args"])
    spec, name = job["spec"], job["metadata"]["name"]
    port = service["spec"]["ports"][0]["port"]
    wanted = {
        "--rdzv-endpoint": f"{name}-0.{pod(job).get('subdomain')}:{port}",
        "--nnodes": str(spec["completions"]),
        "--rdzv-backend": "c10d",
        "the Service": pod(job).get("subdomain"),
        "the Service's selector": {"batch.kubernetes.io/job-name": name},
        "clusterIP": "None",
        "publishNotReadyAddresses": True,
        "parallelism": spec["completions"],
    }
    own = service["spec"]
    found = {
        **launcher,
        "the Service": service["metadata"]["name"],
        "the Service's selector": own["selector"],
        **{key: own.get(key) for key in ("clusterIP", "publishNotReadyAddresses")},
        "parallelism": spec.get("parallelism"),
    }
    problems = [f"{key} must be {value}, got {found.get(key)}" for key, value in wanted.items() if found.get(key) != value]
    problems += [f"{flag} is no option of the launcher that is used here" for flag in launcher if flag not in LAUNCHER]
    flags = [word.split("=")[0] for word in words if word.startswith("--")]
    problems += [f"{flag} is no flag of train_ddp.py" for flag in flags if flag not in flags_of_the_example()]
    return problems + [f"{flag} must be given" for flag in ("--out", "--resume") if flag not in flags]


def run_problems(job):
    """What training needs besides."""
    mounts, problems = mounts_of(job), place_problems(job, ("TMPDIR", "HOME"))
    if variables_of(job).get("TORCH_DISABLE_SHARE_RDZV_TCP_STORE") != "1":
        problems.append("TORCH_DISABLE_SHARE_RDZV_TCP_STORE must be 1: else old addresses are found")
    if mounts.get("/dev/shm", {}).get("emptyDir", {}).get("medium") != "Memory":
        problems.append("/dev/shm must be an emptyDir in memory: workers pass batches through it")
    run = next((Path(word.split("=")[1]) for word in container(job)["args"] if word.startswith("--out=")), Path())
    if "persistentVolumeClaim" not in mounts.get(str(run.parent), {}):
        problems.append(f"--out must lie in a volume that stays, got {run}")
    return problems


def problems(service, job, versions=VERSIONS):
    found = schema_problems(service, versions) + schema_problems(job, versions)
    return found or job_problems(job) + meeting_problems(service, job) + run_problems(job)


def test_the_manifest_is_right():
    assert problems(SERVICE, JOB) == []


POD = "spec.template.spec"
BOX = f"{POD}.containers.0"


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        ("spec.paralelism", 2, "paralelism"),
        ("spec.parallelism", 1, "parallelism must be 2"),
        ("spec.completions", 3, "--nnodes must be 3"),
        ("spec.completionMode", "NonIndexed", "in an Indexed Job only"),
        ("spec.maxFailedIndexes", 3, "at most completions"),
        (f"{POD}.subdomain", "train", "--rdzv-endpoint must be train-ddp-0.train:29400"),
        (f"{POD}.volumes.1", None, "/dev/shm must be"),
        (f"{POD}.volumes.2", {"name": "runs", "emptyDir": {"sizeLimit": "1Gi"}}, "a volume that stays"),
        (f"{BOX}.args.3", "--rdzv-endpoint=train-ddp:29400", "--rdzv-endpoint must be"),
        (f"{BOX}.args.5", "--max-restart=20", "--max-restart is no option"),
        (f"{BOX}.args.9", "--epoch=10", "--epoch is no flag"),
        (f"{BOX}.args.10", None, "--resume must be given"),
        (f"{BOX}.image", "registry.example/graspmill-torch", "fixed tag"),
        (f"{BOX}.env.2.value", "/root", "HOME must be"),
        (f"{BOX}.env.3", None, "TORCH_DISABLE_SHARE_RDZV_TCP_STORE must be 1"),
    ],
)
def test_a_broken_manifest_is_refused(path, value, text):
    found = problems(SERVICE, changed(JOB, path, value), VERSIONS[:1])
    assert any(text in problem for problem in found), found


def test_a_service_that_finds_no_pod_is_refused():
    service = copy.deepcopy(SERVICE)
    service["spec"]["selector"] = {"job-name": "train"}
    assert any("selector must be" in problem for problem in problems(service, JOB, VERSIONS[:1]))


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
WAITING = """
import os, sys, time
sys.path.insert(0, {examples!r})
import train_ddp

forward, steps = train_ddp.Step.forward, []


def waiting(self, batch):
    steps.append(None)
    if "SLURM_RESTART_COUNT" not in os.environ and len(steps) == 7:
        open(f"waiting-{{os.environ['RANK']}}", "w").close()
        time.sleep({seconds})
    return forward(self, batch)


train_ddp.Step.forward = waiting
sys.exit(train_ddp.main())
"""


def file_of(path, text):
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.mark.long
@pytest.mark.skipif(slurm.available() != "", reason=slurm.available())
def test_a_job_of_two_nodes_goes_on_after_its_time_limit(tmp_path):
    graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
    pytest.importorskip("torch")
    graspmill.generate(tmp_path / "grasps", shards=2, attempts=720, seed=6)
    script = file_of(tmp_path / "waiting.py", WAITING.format(examples=str(EXAMPLE.parent), seconds=END_S))
    # Both nodes are this machine, whose name may have no address.
    program = f'exec {sys.executable} -m torch.distributed.run --local-addr 127.0.0.1 "$@"'
    torchrun = file_of(tmp_path / "torchrun", f"#!/bin/sh\n{program}\n")
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
