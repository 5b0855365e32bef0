"""The cluster files match their schemas (kubernetes-validate), what an API server asks beyond them, and this program;
no cluster is needed. `cli/tests/it/generate/cluster.rs` has what the pods make."""

import copy
import functools
import json
import os
import re
import tomllib
from pathlib import Path

import kubernetes_validate
import pytest
from programs import ROOT, changed, executable, ran, run
import yaml
from kubernetes_validate.utils import all_versions

CLUSTER = ROOT / "scripts/cluster"
END_S = 120
VERSIONS = sorted({tuple(map(int, version.split("."))) for version in all_versions()})[-5:]
CODES = {name: int(code) for name, code in re.findall(r"^    (\w+) = (\d+),$", (ROOT / "program/src/exit.rs").read_text(), re.MULTILINE)}
NEVER_AGAIN = {CODES["Usage"], CODES["Data"], CODES["Config"]}
JOBS = {name: yaml.safe_load((CLUSTER / name).read_text()) for name in ("kubernetes.yaml", "kubernetes-finalize.yaml")}


def pod(job):
    return job["spec"]["template"]["spec"]


def container(job):
    return pod(job)["containers"][0]


def variables_of(job):
    return {one["name"]: one.get("value") for one in container(job).get("env", [])}


def mounts_of(job):
    volumes = {volume["name"]: volume for volume in pod(job).get("volumes", [])}
    return {one["mountPath"]: volumes.get(one["name"], {}) for one in container(job).get("volumeMounts", [])}


def option(args, flag):
    return args[args.index(flag) + 1] if flag in args[:-1] else None


@functools.cache
def flags_of(*words):
    return set(re.findall(r"--[a-z][a-z-]*", run("graspmill", *words, "--help").stdout))


def wrong(rules):
    return [rule for rule, holds in rules.items() if not holds]


def schema_problems(job, versions):
    problems = []
    for version in versions:
        try:
            kubernetes_validate.validate(job, ".".join(map(str, version)), strict=True)
        except kubernetes_validate.ValidationError as error:
            problems.append(f"{error.version}: {error.message}")
    return problems


def job_problems(job):
    """What an API server asks and schemas do not contain."""
    spec, rules = job["spec"], job["spec"]["podFailurePolicy"]["rules"]
    is_indexed, codes = spec.get("completionMode") == "Indexed", [rule["onExitCodes"] for rule in rules if "onExitCodes" in rule]
    return wrong({
        "completionMode": spec.get("completionMode", "NonIndexed") in ("Indexed", "NonIndexed"),
        "restartPolicy must be Never": pod(job).get("restartPolicy") == "Never",
        "podReplacementPolicy must be Failed": spec.get("podReplacementPolicy", "Failed") == "Failed",
        "completions must be between 1 and 100000": not is_indexed or 1 <= spec.get("completions", 0) <= 100_000,
        "limits per index stand in an Indexed Job only": is_indexed == ("backoffLimitPerIndex" in spec) and (is_indexed or "maxFailedIndexes" not in spec),
        "maxFailedIndexes must be at most completions": spec.get("maxFailedIndexes", 0) <= spec.get("completions", 0),
        "the first rule must ignore DisruptionTarget": "DisruptionTarget" in str(rules[0]) and rules[0]["action"] == "Ignore",
        "action": all(rule["action"] in ("Ignore", "FailIndex", "FailJob", "Count") for rule in rules),
        "a rule has either onExitCodes or onPodConditions": all(("onExitCodes" in rule) != ("onPodConditions" in rule) for rule in rules),
        "operator": all(one["operator"] in ("In", "NotIn") for one in codes),
        "containerName": all(one.get("containerName") == container(job)["name"] for one in codes),
        "values must be ordered, each once": all(one["values"] and one["values"] == sorted(set(one["values"])) for one in codes),
        "values must be exit codes": all({*one["values"]} <= {*CODES.values()} - {0} for one in codes),
    })  # fmt: skip


def place_problems(job, temporary=("TMPDIR",)):
    """The pod may write where it must, and nowhere else; what it is called and how large it is can be read."""
    security = {**pod(job).get("securityContext", {}), **container(job).get("securityContext", {})}
    sizes = [size for kind in container(job)["resources"].values() for size in kind.values()]
    sizes += [volume.get("emptyDir", {}).get("sizeLimit", "1Gi") for volume in pod(job).get("volumes", [])]
    rules = {f"{name} must be an emptyDir that is mounted there": "emptyDir" in mounts_of(job).get(variables_of(job).get(name), {}) for name in temporary}
    return wrong(rules | {
        "runAsUser must be a user, not root": security.get("runAsUser", 0) != 0 and security.get("runAsNonRoot") is True,
        "readOnlyRootFilesystem": security.get("readOnlyRootFilesystem") is True and security.get("allowPrivilegeEscalation") is False,
        "image must have a fixed tag": re.search(r":(?!latest$)[\w.-]+$", container(job)["image"]),
        "no quantity": all(re.fullmatch(r"\d+(\.\d+)?(m|[kMGTPE]|[KMGTPE]i)?", str(size)) for size in sizes),
    })  # fmt: skip


def program_problems(job):
    """Transient faults are retried, permanent ones are not; flags and sizes are the program's."""
    rules, args, sizes = job["spec"]["podFailurePolicy"]["rules"], container(job)["args"], container(job)["resources"]
    ended = {value for rule in rules for value in rule.get("onExitCodes", {}).get("values", [])}
    indexes = [rule["onExitCodes"]["values"] for rule in rules if rule.get("action") == "FailIndex"]
    is_making, pods, task = args[0] == "generate", job["spec"].get("completions"), option(args, "--task")
    shards = task == f"$(JOB_COMPLETION_INDEX)/{pods}" if task else "--shard-index" in args or option(args, "--shards") == str(pods)
    return wrong({
        "exit codes that end a shard or the Job": ended == NEVER_AGAIN | ({CODES["Incomplete"]} if "finalize" in args else set()),
        "FailIndex must be for damage alone": indexes == ([[CODES["Data"]]] if job["spec"].get("completionMode") == "Indexed" else []),
        "shards must be on one kind of processor": pod(job).get("nodeSelector") == {"kubernetes.io/arch": "amd64"},
        "requests and limits": {"cpu", "memory"} <= sizes.get("requests", {}).keys() and "memory" in sizes.get("limits", {}),
        "command must be graspmill": container(job).get("command") == ["graspmill"],
        "flags": {word for word in args if word.startswith("--")} <= flags_of(*args[: 1 if is_making else 2]),
        "--threads must be the cores": not is_making or option(args, "--threads") == sizes["requests"].get("cpu"),
        "--shards, --task must be completions": not is_making or shards,
    })  # fmt: skip


def problems(job, versions=VERSIONS):
    # A manifest with the wrong structure cannot be checked further.
    return schema_problems(job, versions) or job_problems(job) + place_problems(job) + program_problems(job)


@pytest.mark.parametrize("name", JOBS)
def test_the_manifests_are_right(name):
    assert len(VERSIONS) == 5 and VERSIONS[0] >= (1, 29)
    assert problems(JOBS[name]) == []


RULES = "spec.podFailurePolicy.rules"
POD = "spec.template.spec"
BOX = f"{POD}.containers.0"


def test_broken_manifests_are_refused():
    for path, value, text in [
        ("spec.backoffLimitPerIndx", 3, "backoffLimitPerIndx"), ("spec.completions", "64", "is not of type"),
        ("spec.completionMode", "NonIndexed", "in an Indexed Job only"), ("spec.completions", 100_001, "completions must be between"),
        ("spec.maxFailedIndexes", 65, "at most completions"), (f"{RULES}.1.onExitCodes.containerName", "main", "containerName"),
        (f"{RULES}.2.onExitCodes.values", [78, 2], "ordered"), (f"{RULES}.1.onExitCodes.values", [65, 75], "exit codes that end"),
        (f"{RULES}.1.action", "FailJob", "FailIndex must be for"), (f"{RULES}.0", ..., "ignore DisruptionTarget"),
        (f"{POD}.volumes.0.emptyDir.sizeLimit", "1 Gi", "no quantity"), (f"{POD}.securityContext.runAsUser", 0, "not root"),
        (f"{BOX}.env.1.value", "/tmp", "TMPDIR"), (f"{BOX}.image", "registry.example:5000/graspmill", "fixed tag"),
        (f"{BOX}.args.1", "--shard", "flags"), (f"{BOX}.args.4", "8", "--threads must be"),
        ("spec.completions", 63, "--shards, --task must be completions"),
    ]:  # fmt: skip
        found = problems(changed(JOBS["kubernetes.yaml"], path, value), VERSIONS[:1])
        assert any(text in problem for problem in found), (path, value, found)


def test_a_pod_may_make_several_shards():
    job = changed(JOBS["kubernetes.yaml"], "spec.completions", 16)
    container(job)["args"] += ["--task", "$(JOB_COMPLETION_INDEX)/16"]
    assert problems(job) == []


def test_the_finaliser_runs_where_the_shards_are_made():
    make, complete = (copy.deepcopy(job) for job in JOBS.values())
    assert option(container(make)["args"], "--out") == container(complete)["args"][-1]
    assert container(complete)["args"][:2] == ["dataset", "finalize"]
    for job in (make, complete):
        del container(job)["args"], container(job)["resources"]
    assert pod(make) == pod(complete)


def test_what_is_missing_is_made_by_the_command_of_the_docs(tmp_path):
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / "docs/cluster.md").read_text(), re.DOTALL)
    [block] = [block for block in blocks if "generate-missing" in block]
    tools = {"kubectl": 'cat > "$OLDPWD/applied.yaml"', "graspmill": "echo 1-2,10,13"}
    for name, body in tools.items():
        executable(tmp_path / name, f"#!/bin/sh\n{body}\n")
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    script = f"cd {tmp_path} && cd {ROOT} && set -euo pipefail && {block}"
    ran("bash", "-c", script, env=environment, timeout=END_S)
    job = yaml.safe_load((tmp_path / "applied.yaml").read_text())
    assert (job["metadata"]["name"], job["spec"]["completions"]) == ("generate-missing", 1)
    assert option(container(job)["args"], "--shard-index") == "1-2,10,13"
    assert problems(job) == []


def started(name, index, out, *more):
    """What a pod's own command line does without a cluster. Nothing is in its environment but its index."""
    program, *words = [*container(JOBS[name])["command"], *container(JOBS[name])["args"]]
    words[words.index(option(container(JOBS["kubernetes.yaml"])["args"], "--out"))] = out
    if "--shards" in words:
        words[words.index("--shards") + 1] = "2"
    return run(program, *words, *more, env={"JOB_COMPLETION_INDEX": str(index)}, code=CODES["Ok"])


def test_the_pods_commands_make_a_dataset(tmp_path):
    """`cli/tests/it/generate/cluster.rs` compares it with that of one process, and has the codes of what goes wrong."""
    for index in (0, 1):
        started("kubernetes.yaml", index, tmp_path / "out", "--attempts", 120)
    assert "complete" in started("kubernetes-finalize.yaml", "", tmp_path / "out").stdout


# The image.


def instructions(text):
    """A Containerfile's instructions, continued lines joined: FROM, COPY and so on, each with its words."""
    lines = re.sub(r"\\\n", " ", text).splitlines()
    return [(line.split()[0], line.split()[1:]) for line in lines if line.strip() and not line.startswith("#")]


def copy_problems(text):
    """What the first stage cannot copy, and what cargo would miss then: members, and files that sources include."""
    copied, problems = [], []
    first_stage = text.split("\nFROM ")[1]  # before it, there are comments
    for *sources, target in (rest for word, rest in instructions(first_stage) if word == "COPY"):
        for source in map(ROOT.joinpath, sources):
            place = source.parent if source.is_file() and target.endswith("/") else source
            if source.exists() and ROOT / target == place:
                copied.append(source)
            else:
                problems.append(f"{source.relative_to(ROOT)} cannot be copied to {target}")
    members = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["members"]
    wanted = [ROOT / "Cargo.toml", ROOT / "Cargo.lock", *(ROOT / member / "Cargo.toml" for member in members)]
    for source in ROOT.glob("*/src/**/*.rs"):
        included = re.findall(r'include_(?:str|bytes)!\("([^"]+)"\)', source.read_text())
        wanted += [Path(os.path.normpath(source.parent / path)) for path in included]
    missing = [path for path in wanted if not any(path.is_relative_to(one) for one in copied)]
    return problems + [f"{path.relative_to(ROOT)} is not copied" for path in missing]


def image_problems(text):
    lines = [(word, " ".join(rest)) for word, rest in instructions(text)]
    rust = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["rust-version"]
    service = [rest for word, rest in lines if word == "RUN" and "--no-default-features --bin graspmill" in rest]
    [workdir] = [rest for word, rest in lines if word == "WORKDIR"]
    programs = " ".join(f"{workdir}/target/release/{program}" for program in ("graspmill", "generator"))
    user = pod(JOBS["kubernetes.yaml"])["securityContext"]["runAsUser"]
    return wrong({
        "the builder must have Rust of Cargo.toml": any(word == "FROM" and f"/rust:{rust}-" in rest for word, rest in lines),
        "cargo must build --locked": ("RUN", "cargo build --locked --release --bins") in lines,
        "the service's program must be static": any("--locked" in one and "+crt-static" in one and one.endswith("/planner") for one in service),
        "the last image must be the service": lines[-1][0] == "CMD" and ("ENTRYPOINT", '["/planner"]') in lines,
        "the image must have the programs": ("COPY", f"--from=programs {programs} /usr/local/bin/") in lines,
        "the user must be the manifests'": lines.count(("USER", f"{user}:{user}")) == 2,
    })  # fmt: skip


def test_the_image_is_made_of_what_is_there():
    text = (ROOT / "Containerfile").read_text()
    assert image_problems(text) + copy_problems(text) == []
    for old, new, problem in (
        ("rust:1.", "rust:0.", "must have Rust"),
        ("release/generator", "release/generate", "the image must have"),
        ("USER 65532:65532\n", "", "the user must be"),
        ("+crt-static", "-crt-static", "must be static"),
        ("COPY configs configs\n", "", "configs/generate/paper.toml is not copied"),
        ("COPY shards shards\n", "", "shards/Cargo.toml is not copied"),
        ("COPY tests tests\n", "COPY test tests\n", "test cannot be copied"),
    ):
        broken = text.replace(old, new)
        assert any(problem in one for one in image_problems(broken) + copy_problems(broken)), problem


# AWS Batch.


def batch_problems(definition):
    command, strategy = definition["containerProperties"]["command"], definition["retryStrategy"]
    actions = {int(rule["onExitCode"]): rule["action"] for rule in strategy["evaluateOnExit"]}
    references = {word.removeprefix("Ref::") for word in command if word.startswith("Ref::")}
    return wrong({
        "the command must be graspmill generate": command[:2] == ["graspmill", "generate"],
        "flags": {word for word in command if word.startswith("--")} <= flags_of("generate"),
        "parameters": references == definition["parameters"].keys(),
        "retryStrategy": actions == {CODES["TryAgain"]: "RETRY", **dict.fromkeys(NEVER_AGAIN | {CODES["Incomplete"]}, "EXIT")}
        and len(strategy["evaluateOnExit"]) <= 5 and 2 <= strategy["attempts"] <= 10,
    })  # fmt: skip


def test_the_batch_job_is_right_and_a_broken_one_is_refused():
    definition = json.loads((CLUSTER / "aws-batch.json").read_text())
    assert batch_problems(definition) == []
    for path, value, text in [
        ("retryStrategy.evaluateOnExit.1.onExitCode", "66", "retryStrategy"),
        ("retryStrategy.attempts", 11, "retryStrategy"),
        ("containerProperties.command.2", "--shard", "flags"),
        ("parameters.out", ..., "parameters"),
    ]:
        assert text in batch_problems(changed(definition, path, value)), path
