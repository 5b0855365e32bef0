"""The cluster files match their schemas and this program, and pods make the same dataset as one process.

    python -m pytest tests/python/test_kubernetes.py

No cluster is needed: the manifests are checked with Kubernetes' own schemas (kubernetes-validate) and with the additional
checks of an API server. Then the generator runs like the pods of an Indexed Job.
"""

import copy
import json
import os
import re
import shutil
import subprocess
import tomllib

import kubernetes_validate
import pytest
from programs import PROGRAMS, ROOT, files
import yaml
from kubernetes_validate.utils import all_versions

CLUSTER = ROOT / "scripts/cluster"
SHARDS, ATTEMPTS = 6, 720
END_S = 120  # the generator's time to end
VERSIONS = sorted({tuple(map(int, version.split("."))) for version in all_versions()})[-5:]
CODES = {
    name: int(code)
    for name, code in re.findall(r"^    (\w+) = (\d+),$", (ROOT / "program/src/exit.rs").read_text(), re.MULTILINE)
}
NEVER_AGAIN = {CODES["Usage"], CODES["Data"], CODES["Config"]}
QUANTITY = re.compile(r"\d+(\.\d+)?(m|[kMGTPE]|[KMGTPE]i)?")


def generator(*args, env=None):
    command = [PROGRAMS / "generator", *map(str, args)]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=END_S)


def manifest(name):
    return yaml.safe_load((CLUSTER / name).read_text())


JOBS = {name: manifest(name) for name in ("kubernetes.yaml", "kubernetes-finalize.yaml")}


# Manifests compared with the schemas, the checks of an API server, and this program.


def schema_problems(job, versions):
    problems = []
    for version in versions:
        try:
            kubernetes_validate.validate(job, ".".join(map(str, version)), strict=True)
        except kubernetes_validate.ValidationError as error:
            problems.append(f"{error.version}: {error.message}")
    return problems


def pod(job):
    return job["spec"]["template"]["spec"]


def container(job):
    return pod(job)["containers"][0]


def one_of(what, value, known):
    return [] if value in known else [f"{what} must be one of {known}, got {value}"]


def job_problems(job):
    """The checks of the API server that schemas do not contain."""
    spec = job["spec"]
    problems = one_of("completionMode", spec.get("completionMode", "NonIndexed"), ["Indexed", "NonIndexed"])
    problems += one_of("restartPolicy", pod(job).get("restartPolicy"), ["Never"])
    problems += one_of("podReplacementPolicy", spec.get("podReplacementPolicy", "Failed"), ["Failed"])
    per_index = [key for key in ("backoffLimitPerIndex", "maxFailedIndexes") if key in spec]
    if spec.get("completionMode") == "Indexed":
        if not 1 <= spec.get("completions", 0) <= 100_000:
            problems.append("completions must be between 1 and 100000")
        if "backoffLimitPerIndex" not in spec:
            problems.append("backoffLimitPerIndex must be set: without it all shards share their retries")
        if spec.get("maxFailedIndexes", 0) > spec.get("completions", 0):
            problems.append("maxFailedIndexes must be at most completions")
    elif per_index:
        problems.append(f"{', '.join(per_index)} must stand in an Indexed Job only")
    return problems + [problem for rule in spec["podFailurePolicy"]["rules"] for problem in rule_problems(job, rule)]


def rule_problems(job, rule):
    problems = one_of("action", rule.get("action"), ["Ignore", "FailIndex", "FailJob", "Count"])
    if rule.get("action") == "FailIndex" and "backoffLimitPerIndex" not in job["spec"]:
        problems.append("FailIndex must have a backoffLimitPerIndex")
    if ("onExitCodes" in rule) == ("onPodConditions" in rule):
        problems.append("a rule must have either onExitCodes or onPodConditions")
    if "onExitCodes" in rule:
        codes = rule["onExitCodes"]
        values = codes.get("values", [])
        problems += one_of("operator", codes.get("operator"), ["In", "NotIn"])
        names = [one["name"] for one in pod(job)["containers"]]
        problems += one_of("containerName", codes.get("containerName"), names)
        problems += [problem for value in values for problem in one_of("values", value, sorted(CODES.values()))]
        if not values or values != sorted(set(values)) or 0 in values:
            problems.append(f"values must be ordered, each once and none of them 0, got {values}")
    return problems


def exit_code_problems(job):
    """Transient faults are retried, permanent ones are not, and a lost node costs no retry."""
    rules = job["spec"]["podFailurePolicy"]["rules"]
    first = [(rules[0]["action"], [one["type"] for one in rules[0].get("onPodConditions", [])])] if rules else []
    problems = [] if first == [("Ignore", ["DisruptionTarget"])] else ["the first rule must ignore DisruptionTarget"]
    ended = {value for rule in rules for value in rule.get("onExitCodes", {}).get("values", [])}
    wanted = NEVER_AGAIN | ({CODES["Incomplete"]} if "finalize" in container(job)["args"] else set())
    if ended != wanted:
        problems.append(f"exit codes that end a shard or the Job must be {sorted(wanted)}, got {sorted(ended)}")
    indexes = [rule["onExitCodes"]["values"] for rule in rules if rule.get("action") == "FailIndex"]
    if job["spec"].get("completionMode") == "Indexed" and indexes != [[CODES["Data"]]]:
        problems.append(f"FailIndex must be for exit code {CODES['Data']} alone, got {indexes}")
    return problems


def place_problems(job, temporary=("TMPDIR",)):
    """The pod may write where it must, and nowhere else; what it is called and how large it is can be read."""
    security = {**pod(job).get("securityContext", {}), **container(job).get("securityContext", {})}
    wanted = {"runAsNonRoot": True, "readOnlyRootFilesystem": True, "allowPrivilegeEscalation": False}
    problems = [f"{key} must be {value}" for key, value in wanted.items() if security.get(key) is not value]
    variables, folders = variables_of(job), mounts_of(job)
    unmounted = [name for name in temporary if "emptyDir" not in folders.get(variables.get(name), {})]
    problems += [f"{name} must be an emptyDir that is mounted there" for name in unmounted]
    if re.search(r":(?!latest$)[\w.-]+$", container(job)["image"]) is None:
        problems.append(f"image must have a fixed tag, got {container(job)['image']}")
    quantities = [size for kind in container(job)["resources"].values() for size in kind.values()]
    quantities += [volume.get("emptyDir", {}).get("sizeLimit", "1Gi") for volume in pod(job).get("volumes", [])]
    return problems + [f"{one} is no quantity" for one in quantities if not QUANTITY.fullmatch(str(one))]


def variables_of(job):
    return {one["name"]: one.get("value") for one in container(job).get("env", [])}


def mounts_of(job):
    """What is mounted, by its folder."""
    volumes = {volume["name"]: volume for volume in pod(job).get("volumes", [])}
    return {one["mountPath"]: volumes.get(one["name"], {}) for one in container(job).get("volumeMounts", [])}


def pod_problems(job):
    problems, sizes = place_problems(job), container(job)["resources"]
    if pod(job).get("securityContext", {}).get("runAsUser", 0) == 0:
        problems.append("runAsUser must be a user, not root")
    if pod(job).get("nodeSelector") != {"kubernetes.io/arch": "amd64"}:
        problems.append("nodeSelector must keep shards on one kind of processor")
    if {"cpu", "memory"} - sizes.get("requests", {}).keys() or "memory" not in sizes.get("limits", {}):
        problems.append("resources must request cpu and memory, and limit memory")
    return problems


def argument_problems(job):
    args, pods = container(job)["args"], job["spec"].get("completions")
    problems = [] if container(job).get("command") == ["generator"] else ["command must be generator"]
    if not args[0].startswith("-"):
        return problems + unknown_flags(args[:1], args)
    problems += unknown_flags([], args)
    problems += one_of("--threads", option(args, "--threads"), [container(job)["resources"]["requests"].get("cpu")])
    if "--task" in args:
        problems += one_of("--task", option(args, "--task"), [f"$(JOB_COMPLETION_INDEX)/{pods}"])
    elif "--shard-index" not in args:
        problems += one_of("--shards", option(args, "--shards"), [str(pods)])
    return problems


def option(args, flag):
    return args[args.index(flag) + 1] if flag in args[:-1] else None


def unknown_flags(words, args):
    known = set(re.findall(r"--[a-z][a-z-]*", generator(*words, "--help").stdout))
    return [f"{flag} is no flag of generator" for flag in args if flag.startswith("--") and flag not in known]


def problems(job, versions=VERSIONS):
    found = schema_problems(job, versions)
    # A manifest with the wrong structure cannot be checked further.
    checks = [] if found else [job_problems, exit_code_problems, pod_problems, argument_problems]
    return found + [problem for check in checks for problem in check(job)]


def changed(value, path, new):
    """A copy with another value at a path such as `a.0.b`; without it, if the new one is None."""
    value = copy.deepcopy(value)
    *parents, last = [int(part) if part.isdigit() else part for part in path.split(".")]
    inner = value
    for part in parents:
        inner = inner[part]
    if new is None:
        del inner[last]
    else:
        inner[last] = new
    return value


@pytest.mark.parametrize("name", JOBS)
def test_the_manifests_are_right(name):
    assert len(VERSIONS) == 5 and VERSIONS[0] >= (1, 29)
    assert problems(JOBS[name]) == []


RULES = "spec.podFailurePolicy.rules"
POD = "spec.template.spec"
BOX = f"{POD}.containers.0"
BROKEN = [
    # Refused by the schemas.
    ("spec.backoffLimitPerIndx", 3, "backoffLimitPerIndx"),
    ("spec.completions", "64", "is not of type"),
    (f"{RULES}.0.onPodConditions.0.status", None, "status"),
    (f"{BOX}.image_", "x", "image_"),
    # Refused by the API server.
    ("spec.completionMode", "Indexd", "completionMode"),
    ("spec.completionMode", "NonIndexed", "in an Indexed Job only"),
    ("spec.completions", 0, "completions must be between"),
    ("spec.completions", 100_001, "completions must be between"),
    ("spec.maxFailedIndexes", 65, "at most completions"),
    ("spec.backoffLimitPerIndex", None, "FailIndex must have"),
    ("spec.podReplacementPolicy", "TerminatingOrFailed", "podReplacementPolicy"),
    (f"{POD}.restartPolicy", "OnFailure", "restartPolicy"),
    (f"{RULES}.1.action", "FailShard", "action"),
    (f"{RULES}.1.onExitCodes.operator", "Is", "operator"),
    (f"{RULES}.1.onExitCodes.containerName", "main", "containerName"),
    (f"{RULES}.1.onExitCodes.values", [], "ordered"),
    (f"{RULES}.2.onExitCodes.values", [78, 2], "ordered"),
    (f"{RULES}.2.onExitCodes", None, "either onExitCodes"),
    (f"{BOX}.resources.limits.memory", "2GiBy", "no quantity"),
    (f"{POD}.volumes.0.emptyDir.sizeLimit", "1 Gi", "no quantity"),
    # Right for Kubernetes, wrong for this program.
    (f"{RULES}.1.onExitCodes.values", [67], "values must be one of"),
    (f"{RULES}.1.onExitCodes.values", [65, 75], "must be [2, 65, 78], got [2, 65, 75, 78]"),
    (f"{RULES}.2.onExitCodes.values", [78], "must be [2, 65, 78], got [65, 78]"),
    (f"{RULES}.1.action", "FailJob", "FailIndex must be for"),
    (f"{RULES}.0", None, "ignore DisruptionTarget"),
    (f"{POD}.securityContext.runAsUser", 0, "not root"),
    (f"{BOX}.securityContext.readOnlyRootFilesystem", False, "readOnlyRootFilesystem"),
    (f"{BOX}.env.1.value", "/tmp", "TMPDIR"),
    (f"{POD}.volumes.0.name", "scratch2", "TMPDIR"),
    (f"{POD}.nodeSelector", None, "nodeSelector"),
    (f"{BOX}.image", "registry.example:5000/graspmill", "fixed tag"),
    (f"{BOX}.image", "registry.example/graspmill:latest", "fixed tag"),
    (f"{BOX}.resources.limits.memory", None, "limit memory"),
    (f"{BOX}.args.0", "--shard", "--shard is no flag"),
    (f"{BOX}.args.1", "65", "--shards must be"),
    ("spec.completions", 63, "--shards must be"),
    (f"{BOX}.args.2", "--task", "--task must be one of ['$(JOB_COMPLETION_INDEX)/64']"),
    (f"{BOX}.args.3", "8", "--threads must be"),
    (f"{BOX}.command", None, "command"),
]


@pytest.mark.parametrize(("path", "value", "text"), BROKEN, ids=[f"{path}={value}" for path, value, _ in BROKEN])
def test_broken_manifests_are_refused(path, value, text):
    found = problems(changed(JOBS["kubernetes.yaml"], path, value), VERSIONS[:1])
    assert any(text in problem for problem in found), found


def test_a_pod_may_make_several_shards():
    job = changed(JOBS["kubernetes.yaml"], "spec.completions", 16)
    container(job)["args"] += ["--task", "$(JOB_COMPLETION_INDEX)/16"]
    assert problems(job) == []


def test_the_finaliser_runs_where_the_shards_are_made():
    make, complete = (copy.deepcopy(job) for job in JOBS.values())
    assert option(container(make)["args"], "--out") == container(complete)["args"][-1]
    assert container(complete)["args"][0] == "finalize"
    for job in (make, complete):
        del container(job)["args"], container(job)["resources"]
    assert pod(make) == pod(complete)


def test_what_is_missing_is_made_by_the_command_of_the_docs(tmp_path):
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / "docs/cluster.md").read_text(), re.DOTALL)
    [block] = [block for block in blocks if "generate-missing" in block]
    tools = {"kubectl": 'cat > "$OLDPWD/applied.yaml"', "graspmill": "echo 1-2,10,13"}
    for name, body in tools.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{body}\n")
        (tmp_path / name).chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    script = f"cd {tmp_path} && cd {ROOT} && set -euo pipefail && {block}"
    subprocess.run(["bash", "-c", script], env=environment, check=True, timeout=END_S)
    job = yaml.safe_load((tmp_path / "applied.yaml").read_text())
    assert (job["metadata"]["name"], job["spec"]["completions"]) == ("generate-missing", 1)
    assert option(container(job)["args"], "--shard-index") == "1-2,10,13"
    assert problems(job) == []


# The pods' work, without Kubernetes: nothing is in the environment but the index.


def pod_command(out):
    """The Job's own arguments, for a small dataset in a folder."""
    args = list(container(JOBS["kubernetes.yaml"])["args"])
    args[args.index("--shards") + 1] = str(SHARDS)
    args[args.index("--out") + 1] = str(out)
    return [*args, "--attempts", str(ATTEMPTS)]


def run_pod(out, index):
    return generator(*pod_command(out), env={"JOB_COMPLETION_INDEX": str(index)})


def test_pods_make_the_dataset_that_one_process_makes(tmp_path):
    alone, pods = tmp_path / "alone", tmp_path / "pods"
    assert generator(*pod_command(alone), env={}).returncode == CODES["Ok"]
    assert generator("missing", pods).returncode == CODES["Config"]
    for index in (4, 1, 5, 1, 0):
        ended = run_pod(pods, index)
        assert ended.returncode == CODES["Ok"], ended.stderr
    listed = generator("missing", pods)
    assert (listed.returncode, listed.stdout.strip()) == (CODES["Ok"], "2-3")
    early = generator("finalize", pods)
    assert early.returncode == CODES["Incomplete"] and "2-3" in early.stdout + early.stderr, early
    for index in (2, 3):
        assert run_pod(pods, index).returncode == CODES["Ok"]
    assert generator("missing", pods).stdout.strip() == ""
    assert generator("finalize", pods).returncode == CODES["Ok"]
    assert generator("gc", pods).returncode == CODES["Ok"]
    assert files(pods) == files(alone)


def test_a_pod_that_is_set_up_wrongly_ends_the_job(tmp_path):
    policy = JOBS["kubernetes.yaml"]["spec"]["podFailurePolicy"]["rules"]
    [fatal] = [rule["onExitCodes"]["values"] for rule in policy if rule["action"] == "FailJob"]
    out = tmp_path / "out"
    assert generator(*pod_command(out), "--sharts", env={"JOB_COMPLETION_INDEX": "0"}).returncode in fatal
    assert run_pod(out, SHARDS).returncode in fatal, "there is no such shard"


# The image.


def instructions(text):
    """A Containerfile's instructions, continued lines joined: FROM, COPY and so on, each with its words."""
    lines = re.sub(r"\\\n", " ", text).splitlines()
    return [(line.split()[0], line.split()[1:]) for line in lines if line.strip() and not line.startswith("#")]


def copied(text, folder):
    """Copies what the first stage copies into a folder; lists missing sources."""
    absent = []
    first_stage = text.split("\nFROM ")[1]  # before it, there are comments
    for sources, target in [(rest[:-1], rest[-1]) for word, rest in instructions(first_stage) if word == "COPY"]:
        for source in map(ROOT.joinpath, sources):
            if source.is_dir():
                shutil.copytree(source, folder / target, dirs_exist_ok=True)
            elif source.is_file() and target.endswith("/"):
                (folder / target).mkdir(exist_ok=True)
                shutil.copy(source, folder / target)
            else:
                absent.append(f"{source.relative_to(ROOT)} cannot be copied to {target}")
    return absent


def absent_sources(folder):
    """What cargo would miss in the folder: members, and files that sources include."""
    manifest = folder / "Cargo.toml"
    members = tomllib.loads(manifest.read_text())["workspace"]["members"] if manifest.exists() else []
    wanted = [folder / "Cargo.toml", folder / "Cargo.lock", *(folder / member / "Cargo.toml" for member in members)]
    for source in folder.glob("*/src/**/*.rs"):
        included = re.findall(r'include_(?:str|bytes)!\("([^"]+)"\)', source.read_text())
        wanted += [source.parent / path for path in included]
    return [f"{path.resolve().relative_to(folder)} is not copied" for path in wanted if not path.exists()]


def image_problems(text, folder):
    found = copied(text, folder) + absent_sources(folder)
    lines = [(word, " ".join(rest)) for word, rest in instructions(text)]
    rust = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["rust-version"]
    if not any(word == "FROM" and f"/rust:{rust}-" in rest for word, rest in lines):
        found.append(f"the builder must have Rust {rust}")
    if ("RUN", "cargo build --locked --release --bins") not in lines:
        found.append("cargo must build --locked --release --bins")
    service = [rest for word, rest in lines if word == "RUN" and "--no-default-features --bin graspmill" in rest]
    if not any("--locked" in rest and "+crt-static" in rest and rest.endswith("/planner") for rest in service):
        found.append("the service's program must be static, built --locked, and lie in /planner")
    if lines[-1][0] != "CMD" or ("ENTRYPOINT", '["/planner"]') not in lines:
        found.append("the last image must be the service")
    [workdir] = [rest for word, rest in lines if word == "WORKDIR"]
    programs = ["graspmill", "generator"]
    wanted = " ".join(f"{workdir}/target/release/{program}" for program in programs)
    if ("COPY", f"--from=programs {wanted} /usr/local/bin/") not in lines:
        found.append(f"the image must have {', '.join(programs)}, from {workdir}/target/release")
    user = pod(JOBS["kubernetes.yaml"])["securityContext"]["runAsUser"]
    if lines.count(("USER", f"{user}:{user}")) != 2:
        found.append(f"the user must be {user}, as in the manifests")
    return found


def test_the_image_is_made_of_what_is_there(tmp_path):
    assert image_problems((ROOT / "Containerfile").read_text(), tmp_path) == []


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("COPY configs configs\n", "", "configs/generate/paper.toml is not copied"),
        ("COPY shards shards\n", "", "shards/Cargo.toml is not copied"),
        ("COPY tests tests\n", "COPY test tests\n", "test cannot be copied"),
        (" Cargo.lock", "", "Cargo.lock is not copied"),
        ("rust:1.", "rust:0.", "must have Rust"),
        (" --locked", "", "--locked"),
        ("release/generator", "release/generate", "the image must have"),
        ("USER 65532:65532\n", "", "the user must be"),
        ("+crt-static", "-crt-static", "must be static"),
        ('ENTRYPOINT ["/planner"]\n', "", "must be the service"),
    ],
)
def test_a_broken_image_is_refused(tmp_path, old, new, problem):
    text = (ROOT / "Containerfile").read_text()
    assert old in text
    found = image_problems(text.replace(old, new), tmp_path)
    assert any(problem in one for one in found), found


# AWS Batch.


def batch_problems(definition):
    command, strategy = definition["containerProperties"]["command"], definition["retryStrategy"]
    found = [] if command[0] == "generator" else ["the command must be generator"]
    found += unknown_flags([], command[1:])
    references = {word.removeprefix("Ref::") for word in command if word.startswith("Ref::")}
    if references != definition["parameters"].keys():
        found.append(f"parameters must be {sorted(references)}, got {sorted(definition['parameters'])}")
    actions = {int(rule["onExitCode"]): rule["action"] for rule in strategy["evaluateOnExit"]}
    ends = NEVER_AGAIN | {CODES["Incomplete"]}
    wanted = {CODES["TryAgain"]: "RETRY", **dict.fromkeys(ends, "EXIT")}
    if actions != wanted or len(strategy["evaluateOnExit"]) > 5 or not 2 <= strategy["attempts"] <= 10:
        found.append(f"retryStrategy must have 2 to 10 attempts and at most 5 rules, {wanted}")
    return found


def test_the_batch_job_is_right_and_a_broken_one_is_refused():
    definition = json.loads((CLUSTER / "aws-batch.json").read_text())
    assert batch_problems(definition) == []
    for path, value, text in [
        ("retryStrategy.evaluateOnExit.0.action", "EXIT", "retryStrategy"),
        ("retryStrategy.evaluateOnExit.1.onExitCode", "66", "retryStrategy"),
        ("retryStrategy.attempts", 11, "retryStrategy"),
        ("containerProperties.command.1", "--shard", "--shard is no flag"),
        ("parameters.out", None, "parameters"),
    ]:
        found = batch_problems(changed(definition, path, value))
        assert any(text in problem for problem in found), (path, found)
