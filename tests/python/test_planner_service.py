"""`planner serve` as a robot's programs, and worse clients, meet it.

    python -m pytest tests/python/test_planner_service.py   # GRASPMILL_PLANNER=path/to/planner, or target/debug/planner
"""

import base64
import http.client
import io
import json
import os
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import tomllib
import types
import zlib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

ROOT = Path(__file__).parents[2]
PLANNER = Path(os.environ.get("GRASPMILL_PLANNER", ROOT / "target" / "debug" / "planner")).resolve()
DEMO = ROOT / "planner" / "demo"
NODE = ROOT / "docs" / "ros2_planner_node.py"
PATHS = {"/v1/plan", "/v1/model", "/healthz", "/readyz", "/metrics", "/openapi.json"}
JSON = {"Content-Type": "application/json"}


class Service:
    """A running `planner serve`."""

    def __init__(self, folder, *args):
        if not PLANNER.exists():
            pytest.fail(f"no planner at {PLANNER}: cargo build, or set GRASPMILL_PLANNER")
        self.log = folder / "log.txt"
        command = [str(word) for word in (PLANNER, "serve", "--port", "0", *args)]
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        line = self.process.stdout.readline()
        found = re.fullmatch(r"listening on http://127\.0\.0\.1:(\d+)\n", line)
        assert found, f"{line!r}: {self.log.read_text()}"
        self.port = int(found[1])

    def ask(self, method, path, body=None, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, dict((name.lower(), value) for name, value in answer.getheaders()), answer.read()
        finally:
            connection.close()

    def plan(self, request):
        body = request if isinstance(request, bytes) else json.dumps(request).encode()
        return self.ask("POST", "/v1/plan", body, JSON)

    def raw(self, data, wait_s=20.0):
        """All that comes back when these bytes are sent; nothing if the connection is closed without an answer."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=wait_s) as stream:
            try:
                stream.sendall(data)
                stream.shutdown(socket.SHUT_WR)
            except OSError:
                pass
            return read_all(stream)

    def memory_kb(self, name):
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(rf"^{name}:\s+(\d+) kB", status, re.MULTILINE)[1])

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(30)
        self.process.stdout.close()
        return code


def read_all(stream):
    got = b""
    try:
        while piece := stream.recv(65536):
            got += piece
    except ConnectionError:
        pass
    return got


@contextmanager
def running(folder, *args):
    service = Service(folder, *args)
    try:
        yield service
    finally:
        if service.process.poll() is None:
            service.process.kill()
            service.process.wait()
        service.process.stdout.close()


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    with running(tmp_path_factory.mktemp("service")) as service:
        yield service


def demo_request():
    """planner/demo/views.toml with the images in place of their paths."""
    request = tomllib.loads((DEMO / "views.toml").read_text())
    for view in request["views"]:
        view["depth"] = file_of((DEMO / view["depth"]).read_bytes())
    return request


def file_of(data):
    return {"data": base64.b64encode(data).decode()}


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def png(array):
    """A grey PNG of 16 bits."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = array.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in array)
    head = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def exr(array):
    """An EXR of one channel, uncompressed; float32, or uint32 for whole numbers."""

    def attribute(name, kind, value):
        return f"{name}\0{kind}\0".encode() + struct.pack("<I", len(value)) + value

    height, width = array.shape
    sample = 0 if array.dtype == np.uint32 else 2
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = b"\x76\x2f\x31\x01\x02\0\0\0" + b"".join([
        attribute("channels", "chlist", b"Z\0" + struct.pack("<iB3xii", sample, 0, 1, 1) + b"\0"),
        attribute("compression", "compression", b"\0"),
        attribute("dataWindow", "box2i", window),
        attribute("displayWindow", "box2i", window),
        attribute("lineOrder", "lineOrder", b"\0"),
        attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
        attribute("screenWindowWidth", "float", struct.pack("<f", 1.0)),
    ]) + b"\0"  # fmt: skip
    rows = array.astype(array.dtype.newbyteorder("<"))
    lines = [struct.pack("<iI", y, 4 * width) + row.tobytes() for y, row in enumerate(rows)]
    first = len(head) + 8 * height
    places = (first + y * len(lines[0]) for y in range(height))
    return head + b"".join(struct.pack("<Q", place) for place in places) + b"".join(lines)


def seen(depth_m=None, width=64, height=48):
    """A camera 0.6 m above the workspace's middle that looks down on a bare table at 0.05 m."""
    depth_m = np.full((height, width), 0.55, np.float32) if depth_m is None else depth_m
    height, width = depth_m.shape[:2]
    return {
        "depth": file_of(npy(depth_m)),
        "intrinsics": {"fx_px": 80.0, "fy_px": 80.0, "cx_px": (width - 1) / 2, "cy_px": (height - 1) / 2},
        "workspace_from_camera": {"position_m": [0.15, 0.15, 0.6], "quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]},
    }


def check_error(status, headers, body):
    assert 400 <= status < 600 and status != 500, (status, body)
    told = json.loads(body)
    assert headers["content-type"] == "application/json"
    assert told.keys() == {"error", "status"} and told["status"] == status and told["error"], told
    return told["error"]


def test_health_readiness_and_model(service):
    assert service.ask("GET", "/healthz")[::2] == (200, b"ok")
    assert service.ask("GET", "/readyz")[0] == 200
    status, headers, body = service.ask("GET", "/v1/model")
    model = json.loads(body)
    assert status == 200 and headers["content-type"] == "application/json"
    assert re.fullmatch(r"[0-9a-f]{64}", model["model"])
    assert model["grid"]["resolution"] == 40 and model["gripper"] == "parallel_jaw_80"
    assert model["config"] == tomllib.loads((ROOT / "configs" / "plan" / "paper.toml").read_text())


def references(value):
    if isinstance(value, dict):
        yield from ([value["$ref"]] if "$ref" in value else [])
        for inner in value.values():
            yield from references(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from references(inner)


def test_the_description_is_whole(service):
    described = json.loads(service.ask("GET", "/openapi.json")[2])
    assert described["openapi"].startswith("3.1")
    assert described["paths"].keys() == PATHS
    found = set(references(described))
    assert "#/components/schemas/Answer" in found
    for reference in found:
        inner = described
        for key in reference.removeprefix("#/").split("/"):
            inner = inner[key]
        assert isinstance(inner, dict) and inner, reference
    answers = described["paths"]["/v1/plan"]["post"]["responses"]
    assert {"200", "400", "413", "415", "422", "500", "503", "504"} <= answers.keys()


def strict(value):
    """A schema in which a key that it does not name is wrong."""
    if isinstance(value, list):
        return [strict(inner) for inner in value]
    if not isinstance(value, dict):
        return value
    more = {"additionalProperties": False} if "properties" in value else {}
    return more | {key: strict(inner) for key, inner in value.items()}


def test_answers_are_what_the_description_says(service):
    described = json.loads(service.ask("GET", "/openapi.json")[2])

    def check(answer, path, method, status, answered=200):
        """The schema's name, against which this answer was held."""
        assert answered == status, answer
        content = described["paths"][path][method]["responses"][str(status)]["content"]["application/json"]
        # The references in it begin at the root, where the components are put.
        whole = strict({"components": described["components"]} | content["schema"])
        Draft202012Validator.check_schema(whole)
        found = [f"{error.json_path}: {error.message}" for error in Draft202012Validator(whole).iter_errors(answer)]
        assert not found, found
        return content["schema"]["$ref"].rpartition("/")[2]

    def planned(request):
        status, _, body = service.plan(request)
        answer = json.loads(body)
        assert check(answer, "/v1/plan", "post", 200, status) == "Answer"
        return answer

    base = {"position_m": [1.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}
    plain, explained = planned(demo_request()), planned(demo_request() | {"explain": True, "base_from_workspace": base})
    assert plain["grasps"] and plain["objects"] and plain["plane"]
    assert explained["dropped"] and explained["grasps"][0]["base_from_grasp"]
    assert planned({"views": [seen()]})["reason"]
    assert planned({"tsdf": file_of(npy(np.zeros((40, 40, 40), np.float32)))})["plane"] is None
    status, _, body = service.ask("GET", "/v1/model")
    assert check(json.loads(body), "/v1/model", "get", 200, status) == "ModelAnswer"
    for request, status in [(b"[", 400), ({}, 422)]:
        answered, _, body = service.plan(request)
        assert check(json.loads(body), "/v1/plan", "post", status, answered) == "ErrorAnswer"
    # The check itself can fail.
    for wrong in (plain | {"more": 1}, {key: plain[key] for key in plain if key != "grid"}):
        with pytest.raises(AssertionError):
            check(wrong, "/v1/plan", "post", 200)


def metrics(service):
    status, headers, body = service.ask("GET", "/metrics")
    assert status == 200 and headers["content-type"].startswith("application/openmetrics-text")
    lines = body.decode().splitlines()
    assert lines[-1] == "# EOF"
    values = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z_]+(\{[^{}]*\})? -?[0-9.e+-]+", line) for line in values), lines
    return {line.rpartition(" ")[0]: float(line.rpartition(" ")[2]) for line in values}


def test_metrics_count_what_happens(service):
    planned, lost = 'planner_requests_total{endpoint="/v1/plan",status="200"}', "planner_plan_duration_seconds_count"
    before = metrics(service)
    assert service.plan({"views": [seen()]})[0] == 200
    assert service.ask("GET", "/nowhere")[0] == 404
    after = metrics(service)
    assert after[planned] - before.get(planned, 0) == 1
    assert after[lost] - before[lost] == 1
    assert after["planner_empty_plans_total"] - before["planner_empty_plans_total"] == 1
    assert after['planner_requests_total{endpoint="other",status="404"}'] >= 1


def test_it_plans_what_the_command_plans_each_time_with_the_same_bytes(service):
    command = [PLANNER, "plan", "--views", DEMO / "views.toml"]
    printed = subprocess.run(command, capture_output=True, check=False)
    assert printed.returncode == 0, printed.stderr
    status, headers, body = service.plan(demo_request())
    assert status == 200, body
    answer = json.loads(body)
    assert answer == json.loads(printed.stdout)
    assert answer["grasps"] and answer["reason"] is None and answer["format"] == "graspmill-plan/1"
    assert re.fullmatch(r"parse;dur=[0-9.]+(, [\w-]+;dur=[0-9.]+)+", headers["server-timing"])
    assert service.plan(demo_request())[2] == body


def test_nothing_to_grasp_is_an_answer(service):
    status, _, body = service.plan({"views": [seen()]})
    answer = json.loads(body)
    assert status == 200 and answer["grasps"] == [] and answer["reason"], answer


def test_an_exr_is_planned_like_an_array(service):
    view = seen()
    depth_m = np.full((48, 64), 0.55, np.float32)
    depth_m[10:30, 20:40] = 0.5
    planned = []
    for image in (npy(depth_m), exr(depth_m)):
        status, _, body = service.plan({"views": [view | {"depth": file_of(image)}]})
        assert status == 200, body
        planned.append(body)
    assert planned[0] == planned[1]
    # Whole numbers are millimetres in both.
    depth_mm = np.rint(depth_m * 1000)
    images = exr(depth_mm.astype(np.uint32)), png(depth_mm.astype(np.uint16))
    first, second = (service.plan({"views": [view | {"depth": file_of(image)}]}) for image in images)
    assert first[0] == 200 and first[2] == second[2], (first, second)


def test_errors_have_their_statuses(service):
    good = json.dumps({"views": [seen()]}).encode()
    table = [
        (404, "GET", "/nowhere", None, {}),
        (404, "POST", "/v1/plan/", good, JSON),
        (405, "GET", "/v1/plan", None, {}),
        (405, "DELETE", "/healthz", None, {}),
        (415, "POST", "/v1/plan", good, {}),
        (415, "POST", "/v1/plan", good, {"Content-Type": "text/plain"}),
        (400, "POST", "/v1/plan", good[:-1], JSON),
        (400, "POST", "/v1/plan", b"", JSON),
        (400, "POST", "/v1/plan", b'{"policy": "\xff"}', JSON),
        *((422, "POST", "/v1/plan", body, JSON) for body in (b"[]", b"7", b"{}", b'{"views": []}')),
        (413, "POST", "/v1/plan", b" " * (65 << 20), JSON),
        (422, "POST", "/v1/plan", good.replace(b'"fx_px": 80.0', b'"fx_px": 0.0'), JSON),
    ]
    for expected, method, path, body, headers in table:
        status, answered, told = service.ask(method, path, body, headers)
        assert status == expected, (method, path, headers, status, told[:300])
        check_error(status, answered, told)
        assert status != 405 or answered["allow"], answered


def test_many_at_once_are_planned_or_turned_away(service):
    body = json.dumps({"views": [seen()]}).encode()
    with ThreadPoolExecutor(50) as pool:
        answers = list(pool.map(lambda _: service.plan(body), range(50)))
    statuses = Counter(status for status, _, _ in answers)
    assert statuses[200] >= 1 and set(statuses) <= {200, 503}, statuses
    assert len({told for status, _, told in answers if status == 200}) == 1
    for status, headers, told in answers:
        if status == 503:
            check_error(status, headers, told)
            assert headers["retry-after"] == "1"


def test_sigterm_ends_it_with_0_after_the_answer_under_way(tmp_path):
    with running(tmp_path) as service, ThreadPoolExecutor(1) as pool:
        body = json.dumps({"views": [seen()] * 32}).encode()
        idle = socket.create_connection(("127.0.0.1", service.port))
        under_way = pool.submit(service.plan, body)
        # It counts as under way once its head is read.
        while metrics(service)["planner_requests_in_flight"] < 2 and not under_way.done():
            pass
        assert service.end() == 0
        assert under_way.result()[0] == 200
        idle.close()


def test_a_taken_port_is_told(service):
    command = [str(PLANNER), "serve", "--port", str(service.port)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 75 and "failed to listen" in done.stderr, done
    assert done.stdout == ""


# From here on: clients that mean no good, or know no better. Each way gives the bytes of a body, and whether it must be
# refused; what is only changed by chance (a flipped bit) may also be planned.


def places(value, at=()):
    """Every place in a request, as paths of keys and indices."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*at, key)
        yield from places(inner, (*at, key))


def changed(request, at, value):
    copy = json.loads(json.dumps(request))
    inner = copy
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return copy


def cloud_bytes(chance):
    points = np.array([[chance.random() * 0.3 for _ in range(3)] for _ in range(50)], "<f4")
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points)
    three = "property float x\nproperty float y\nproperty float z\n"
    ply = f"ply\nformat ascii 1.0\nelement vertex 50\n{three}end_header\n{rows}".encode()
    binary = f"ply\nformat binary_little_endian 1.0\nelement vertex 50\n{three}end_header\n".encode() + points.tobytes()
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 50\nHEIGHT 1\nPOINTS 50\n"
    pcd = f"{head}DATA binary\n".encode() + points.tobytes()
    return chance.choice([ply, binary, pcd, npy(points)])


def image_bytes(chance):
    depth = np.full((48, 64), 0.55, np.float32)
    return chance.choice([npy(depth), png((depth * 1000).astype(np.uint16)), exr(depth)])


def random_bytes(chance):
    return chance.randbytes(chance.randrange(2000)), True


def cut_json(chance):
    body = json.dumps({"views": [seen()]}).encode()
    return body[: chance.randrange(len(body))], True


def flipped_json(chance):
    body = bytearray(json.dumps({"views": [seen()]}).encode())
    for _ in range(chance.randrange(1, 20)):
        body[chance.randrange(len(body))] = chance.randrange(256)
    return bytes(body), False


def wrong_type(chance):
    request = {"views": [seen()]}
    at = chance.choice(list(places(request)))
    value = chance.choice([True, "x", "", {"a": 1}, [[]], {}, [None]])
    return json.dumps(changed(request, at, value)).encode(), True


def odd_number(chance):
    request = {"views": [seen()]}
    numbers = [at for at in places(request) if at[-1] in ("fx_px", "fy_px") or at[-2:-1] == ("quaternion_xyzw",)]
    number = chance.choice(["1e999", "-1e999", "NaN", "Infinity", "-1e308", "9" * 400, "1e308", "0x1", "1.", "+1", "-"])
    text = json.dumps(changed(request, chance.choice(numbers), "@@"))
    return text.replace('"@@"', number).encode(), True


def deep(chance):
    opening, depth = chance.choice(["[", '{"views":', '[{"a":']), chance.choice([100, 10_000, 500_000])
    return opening.encode() * depth, True


def deep_inside(chance):
    at = chance.choice(list(places({"views": [seen()]})))
    text = json.dumps(changed({"views": [seen()]}, at, "@@"))
    depth = chance.choice([50, 5_000, 200_000])
    return text.replace('"@@"', "[" * depth + "]" * depth).encode(), True


def junk_image(chance):
    junk = "".join(chr(chance.randrange(32, 127)) for _ in range(chance.randrange(300)))
    return json.dumps({"views": [seen() | {"depth": {"data": junk}}]}).encode(), True


def cut_image(chance):
    whole = image_bytes(chance)
    cut = file_of(whole[: chance.randrange(len(whole) * 9 // 10)])
    return json.dumps({"views": [seen() | {"depth": cut}]}).encode(), True


def flipped_image(chance):
    data = bytearray(image_bytes(chance))
    for _ in range(chance.randrange(1, 8)):
        data[chance.randrange(min(len(data), 200))] = chance.randrange(256)
    return json.dumps({"views": [seen() | {"depth": file_of(bytes(data))}]}).encode(), False


def flipped_exr(chance):
    """In its header, its table of places, the heads of its lines, or its pixels."""
    data = bytearray(exr(np.full((12, 16), 0.55, np.float32)))
    for _ in range(chance.randrange(1, 8)):
        data[chance.randrange(len(data))] = chance.choice([0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)])
    view = seen(width=16, height=12) | {"depth": file_of(bytes(data))}
    return json.dumps({"views": [view]}).encode(), False


def cut_cloud(chance):
    whole = cloud_bytes(chance)
    cut = file_of(whole[: chance.randrange(len(whole) * 9 // 10)])
    return json.dumps({"cloud": cut}).encode(), True


def flipped_cloud(chance):
    data = bytearray(cloud_bytes(chance))
    for _ in range(chance.randrange(1, 8)):
        data[chance.randrange(min(len(data), 200))] = chance.randrange(256)
    return json.dumps({"cloud": file_of(bytes(data))}).encode(), False


def wrong_shape(chance):
    shape = chance.choice([(0, 5), (5, 0), (7,), (2, 3, 4), (1, 1, 1, 1), (5000, 2), ()])
    key, value = chance.choice([("depth", "view"), ("cloud", None), ("tsdf", None)])
    data = file_of(npy(np.full(shape, 0.5, np.float32)))
    request = {"views": [seen() | {key: data}]} if value else {key: data}
    is_cloud = key == "cloud" and shape in [(0, 5), (2, 3, 4)]
    return json.dumps(request).encode(), not is_cloud


def absurd_depth(chance):
    value = chance.choice([np.nan, np.inf, -np.inf, 1e30, -1.0, 0.0, 1e-30])
    depth = np.full((48, 64), value, np.float32)
    depth[: chance.randrange(20)] = 0.55
    return json.dumps({"views": [seen(depth)]}).encode(), False


def huge_promise(chance):
    """A header that promises far more than there is."""
    side = chance.choice([4096, 100_000, 2**31 - 1])
    head = struct.pack(">IIBBBBB", side, side, 16, 0, 0, 0, 0)
    checked = b"IHDR" + head
    image = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + checked + struct.pack(">I", zlib.crc32(checked))
    told = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({side}, {side}), }}".ljust(117).encode() + b"\n"
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(told)) + told
    return json.dumps({"views": [seen() | {"depth": file_of(chance.choice([image, array]))}]}).encode(), True


def not_rigid(chance):
    columns = np.eye(4)
    kind = chance.randrange(5)
    if kind == 0:
        columns[0, 0] = -1.0  # a reflection
    elif kind == 1:
        columns[:3, :3] *= chance.uniform(1.01, 100.0)
    elif kind == 2:
        columns[0, 1] = chance.uniform(0.1, 5.0)  # a shear
    elif kind == 3:
        columns[3] = [0.0, 0.0, chance.uniform(0.1, 1.0), 1.0]
    else:
        columns[:3, :3] = 0.0
    return json.dumps({"views": [seen() | {"workspace_from_camera": columns.tolist()}]}).encode(), True


def no_unit_quaternion(chance):
    quaternion = chance.choice([[0, 0, 0, 0], [1, 1, 1, 1], [1, 0, 0], []])
    pose = {"position_m": [0.0, 0.0, 0.5], "quaternion_xyzw": quaternion}
    return json.dumps({"views": [seen() | {"workspace_from_camera": pose}]}).encode(), True


def bad_lens(chance):
    lens = dict(seen()["intrinsics"])
    if chance.random() < 0.5:
        lens[chance.choice(["fx_px", "fy_px"])] = chance.choice([0.0, -80.0, 1e30, -1e-30])
    else:
        lens |= {"width_px": chance.choice([63, 0, -1, 1.5, 2**40])}
    return json.dumps({"views": [seen() | {"intrinsics": lens}]}).encode(), True


def unknown_or_missing_key(chance):
    request = {"views": [seen()]}
    at = chance.choice([at for at in places(request) if isinstance(at[-1], str)])
    inner = request
    for key in at[:-1]:
        inner = inner[key]
    if chance.random() < 0.5:
        del inner[at[-1]]
    else:
        inner["".join(chance.choices("abcdefghij_", k=12))] = 1
    return json.dumps(request).encode(), True


def wrong_number_of_views(chance):
    return json.dumps({"views": [seen(width=4, height=4)] * chance.choice([0, 33, 100])}).encode(), True


def several_sources(chance):
    second = chance.choice(["cloud", "tsdf"])
    request = {"views": [seen()], second: file_of(npy(np.zeros((5, 3), np.float32)))}
    return json.dumps(request).encode(), True


BODIES = [
    random_bytes, cut_json, flipped_json, wrong_type, odd_number, deep, deep_inside, junk_image, cut_image,
    flipped_image, flipped_exr, cut_cloud, flipped_cloud, wrong_shape, absurd_depth, huge_promise, not_rigid,
    no_unit_quaternion, bad_lens, unknown_or_missing_key, wrong_number_of_views, several_sources,
]  # fmt: skip


def broken_http(chance):
    """Bytes that are not quite HTTP."""
    body = json.dumps({"views": [seen(width=4, height=4)]}).encode()
    head = b"POST /v1/plan HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Type: application/json\r\n"
    chunked = head + b"Transfer-Encoding: chunked\r\n\r\n"
    return chance.choice([
        head + b"\r\n" + body,
        head + b"Content-Length: -1\r\n\r\n" + body,
        head + b"Content-Length: 99999999999999999999\r\n\r\n" + body,
        head + b"Content-Length: 10\r\nContent-Length: 20\r\n\r\n" + body,
        head + b"Content-Length: %d\r\n\r\n" % (len(body) + 50) + body,
        head + b"Content-Length: 70000000\r\n\r\n" + body,
        chunked + b"zz\r\n" + body,
        chunked + b"ffffffffffffffffff\r\n" + body,
        chunked + b"10\r\n" + body,
        chunked + chance.randbytes(200),
        b"POST /v1/plan HTTP/9.9\r\n\r\n",
        b"POST\r\n\r\n",
        b"GET " + b"/" * 70_000 + b" HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"".join(b"h%d: x\r\n" % n for n in range(200)) + b"\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\na: " + b"b" * 500_000 + b"\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\nHost: x\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + chance.randbytes(100),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + chance.randbytes(100),
        b"\0" * 300,
        b"",
        chance.randbytes(500),
    ])  # fmt: skip


def check_raw(got):
    """A whole answer 4xx/5xx, but not 500, or nothing. What cannot be parsed as HTTP is refused without a body."""
    if not got.startswith(b"HTTP/"):
        assert not got or not got.isascii() or b"HTTP" not in got, got[:200]
        return "closed"
    head, _, body = got.partition(b"\r\n\r\n")
    status = int(head.split(b" ")[1])
    assert 400 <= status < 600 and status != 500, got[:300]
    if body:
        assert json.loads(body)["status"] == status
    return status


def leave_early(service, chance):
    """Sends part of a request and goes away, with or without a reset."""
    body = json.dumps({"views": [seen()]}).encode()
    head = b"POST /v1/plan HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n"
    request = head % len(body) + body
    with socket.create_connection(("127.0.0.1", service.port), timeout=20) as stream:
        stream.sendall(request[: chance.randrange(len(request) + 1)])
        if chance.random() < 0.5:
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


@contextmanager
def slow_heads(service, count):
    """Connections that never get their head done; all must be hung up on in the end."""
    streams = [socket.create_connection(("127.0.0.1", service.port), timeout=30) for _ in range(count)]
    for number, stream in enumerate(streams):
        stream.sendall(b"POST /v1/plan HTTP/1.1\r\nHost: x\r\n"[: number + 1])
    done = threading.Event()

    def trickle():
        while not done.wait(1.0):
            for stream in streams[::2]:
                try:
                    stream.sendall(b"X")
                except OSError:
                    pass

    thread = threading.Thread(target=trickle)
    thread.start()
    try:
        yield
        # Half of them go on trickling until they are closed, so no silence ends them.
        for stream in streams:
            check_raw(read_all(stream))
    finally:
        done.set()
        thread.join()
        for stream in streams:
            stream.close()


def test_a_thousand_malformed_requests_and_it_plans_as_before(service):
    good = demo_request()
    before = service.plan(good)[2]
    assert json.loads(before)["grasps"]
    chance = random.Random(7)
    statuses = Counter()
    with slow_heads(service, 20):
        for number in range(800):
            way = BODIES[number % len(BODIES)]
            body, must_be_refused = way(chance)
            status, headers, told = service.plan(body)
            statuses[status] += 1
            if status == 200:
                assert not must_be_refused, (way.__name__, body[:2000])
                json.loads(told)
            else:
                assert status in (400, 422), (way.__name__, status, told[:300])
                check_error(status, headers, told)
        for _ in range(120):
            statuses[f"raw {check_raw(service.raw(broken_http(chance)))}"] += 1
        for _ in range(80):
            leave_early(service, chance)
        with ThreadPoolExecutor(50) as pool:
            bodies = [chance.choice(BODIES)(chance)[0] for _ in range(50)]
            for status, headers, told in pool.map(service.plan, bodies):
                statuses[status] += 1
                if status != 200:
                    check_error(status, headers, told)
    print(f"answers: {dict(statuses)}; VmHWM {service.memory_kb('VmHWM')} kB, VmRSS {service.memory_kb('VmRSS')} kB")
    # Neither all turned away at the door, nor a planner that never refuses.
    assert statuses[422] > 200 and statuses[400] > 50, statuses
    assert service.process.poll() is None, service.log.read_text()[-3000:]
    assert service.plan(good)[2] == before
    assert service.memory_kb("VmHWM") < 2_000_000
    until = time.monotonic() + 10
    while metrics(service)["planner_requests_in_flight"] != 1:
        assert time.monotonic() < until, "requests of clients that are gone are still counted as under way"
        time.sleep(0.1)
    assert "panicked" not in service.log.read_text()


def test_long_lists_cost_no_memory(tmp_path):
    """Lists of which each entry would take more memory than the bytes that ask for it."""

    def many(before, entry, after):
        return before + (entry + b",") * (18_000_000 // (len(entry) + 1)) + entry + after

    attacks = {
        "under an unknown key": (many(b'{"x":[', b"0", b"]}"), ": x"),
        "empty eyes": (many(b'{"eyes_m":[', b"[]", b"]}"), ": eyes_m[0]"),
        "many eyes": (many(b'{"eyes_m":[', b"[0,0,1]", b"]}"), "at most 32 entries, got 2250001: eyes_m"),
        "a long eye": (many(b'{"eyes_m":[[', b"0", b"]]}"), "got 9000001: eyes_m[0]"),
        "many views": (many(b'{"views":[', b'{"depth":""}', b"]}"), ": views"),
        "a long matrix": (many(b'{"base_from_workspace":[', b"[0,0,0,0]", b"]}"), ": base_from_workspace"),
        "a long quaternion": (many(b'{"workspace_from_wrist":{"quaternion_xyzw":[', b"0", b"]}}"), ".quaternion_xyzw"),
        "no object": (many(b"[", b"0", b"]"), ""),
        "deep": (b"[" * 10_000_000 + b"]" * 10_000_000, ""),
        "a long key": (b'{"' + b"x" * 18_000_000 + b'":0}', "unknown field"),
    }
    with running(tmp_path) as service:
        for name, (body, place) in attacks.items():
            status, headers, told = service.plan(body)
            assert status == 422, (name, status, told[:300])
            assert place in check_error(status, headers, told) and len(told) < 2000, (name, told[:600])
        with ThreadPoolExecutor(8) as pool:
            answers = list(pool.map(service.plan, (body for body, _ in attacks.values())))
        assert {status for status, _, _ in answers} == {422}
        print(f"VmHWM {service.memory_kb('VmHWM')} kB")
        assert service.memory_kb("VmHWM") < 1_000_000
        assert service.plan({"views": [seen()]})[0] == 200


# The ROS 2 node of docs/, with as much of ROS as it uses.


class Message(types.SimpleNamespace):
    """A message with these fields; messages inside are made when they are missing, as ROS does."""

    fields = {}

    def __init__(self, **values):
        unknown = values.keys() - self.fields.keys()
        assert not unknown, f"{type(self).__name__} has no {unknown}"
        super().__init__(**{name: values.get(name, make()) for name, make in self.fields.items()})

    def __setattr__(self, name, value):
        assert name in self.fields, f"{type(self).__name__} has no {name}"
        super().__setattr__(name, value)


def message(name, **fields):
    return type(name, (Message,), {"fields": fields})


def ros(depth, encoding, info, transform, service, monkeypatch):
    """The node in a world of one depth image; what it published."""
    number = dict.fromkeys("xyz", float)
    point, quaternion = message("Point", **number), message("Quaternion", **number, w=float)
    vector = message("Vector3", **number)
    header = message("Header", stamp=dict, frame_id=str)
    pose = message("Pose", position=point, orientation=quaternion)
    image_type = message(
        "Image", header=header, height=int, width=int, encoding=str, is_bigendian=int, step=int, data=bytes
    )
    info_type = message("CameraInfo", header=header, height=int, width=int, k=list)
    rigid = message("Transform", translation=vector, rotation=quaternion)
    subscriptions, published, warnings, asked = {}, [], [], []

    class Node:
        def __init__(self, name):
            self.name = name

        def declare_parameter(self, name, value):
            assert name in ("url", "workspace_frame")
            return types.SimpleNamespace(value=f"http://127.0.0.1:{service.port}/v1/plan" if name == "url" else value)

        def create_publisher(self, kind, topic, depth):
            assert (kind.__name__, topic) == ("PoseArray", "grasps") and depth >= 1
            return types.SimpleNamespace(publish=published.append)

        def create_subscription(self, kind, topic, callback, depth):
            subscriptions[topic] = (kind.__name__, callback)

        def get_logger(self):
            return types.SimpleNamespace(warning=warnings.append)

    class Buffer:
        def lookup_transform(self, target, source, at):
            asked.append((target, source, at))
            position, rotation = transform
            found = rigid(
                translation=vector(**dict(zip("xyz", position))), rotation=quaternion(**dict(zip("xyzw", rotation)))
            )
            return message("TransformStamped", header=header, transform=rigid)(transform=found)

    modules = {
        "rclpy": types.ModuleType("rclpy"),
        "rclpy.node": types.SimpleNamespace(Node=Node),
        "rclpy.time": types.SimpleNamespace(Time=types.SimpleNamespace(from_msg=lambda stamp: ("time of", stamp))),
        "geometry_msgs": types.ModuleType("geometry_msgs"),
        "geometry_msgs.msg": types.SimpleNamespace(
            Point=point, Quaternion=quaternion, Pose=pose, PoseArray=message("PoseArray", header=header, poses=list)
        ),
        "sensor_msgs": types.ModuleType("sensor_msgs"),
        "sensor_msgs.msg": types.SimpleNamespace(Image=image_type, CameraInfo=info_type),
        "tf2_ros": types.SimpleNamespace(
            Buffer=Buffer, TransformListener=lambda buffer, node: None, TransformException=type("E", (Exception,), {})
        ),
    }
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    scope = {"__name__": "ros2_planner_node"}
    exec(compile(NODE.read_text(), str(NODE), "exec"), scope)  # noqa: S102
    scope["PlannerNode"]()
    (info_kind, on_info), (image_kind, on_image) = subscriptions["camera_info"], subscriptions["depth"]
    assert (info_kind, image_kind) == ("CameraInfo", "Image")

    # Rows are padded, as some drivers do.
    pad = 6
    rows = b"".join(row.tobytes() + b"\xab" * pad for row in depth)
    height, width = depth.shape
    told = header(stamp={"sec": 3}, frame_id="camera_depth_optical_frame")
    image = image_type(
        header=told, height=height, width=width, encoding=encoding, step=width * depth.itemsize + pad, data=rows,
        is_bigendian=int(depth.dtype.byteorder == ">"),
    )  # fmt: skip
    on_image(image)
    assert not published, "without camera info there is nothing to ask"
    k = [info["fx_px"], 0.0, info["cx_px"], 0.0, info["fy_px"], info["cy_px"], 0.0, 0.0, 1.0]
    on_info(info_type(header=told, height=height, width=width, k=k))
    on_image(image)
    assert asked == [("workspace", "camera_depth_optical_frame", ("time of", {"sec": 3}))]
    return published, warnings


def png_values(data):
    """The values of a grey PNG of 16 bits."""
    width, height = struct.unpack(">II", data[16:24])
    packed, at = b"", 8
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        packed += data[at + 8 : at + 8 + length] if kind == b"IDAT" else b""
        at += 12 + length
    lines = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 2 * width)
    above, rows = [0] * (2 * width), []
    for line in lines:
        how, row = line[0], line[1:].tolist()
        for n, up in enumerate(above):
            left, corner = (row[n - 2], above[n - 2]) if n >= 2 else (0, 0)
            toward = left + up - corner
            nearest = min((left, up, corner), key=lambda value: abs(toward - value))
            row[n] = (row[n] + (0, left, up, (left + up) // 2, nearest)[how]) & 255
        rows.append(bytes(row))
        above = row
    return np.frombuffer(b"".join(rows), ">u2").reshape(height, width)


@pytest.fixture(scope="module")
def one_demo_view():
    """The first view of the demo: depth in metres, lens, pose."""
    request = tomllib.loads((DEMO / "views.toml").read_text())
    view = request["views"][0]
    depth_m = png_values((DEMO / view["depth"]).read_bytes()) * np.float32(view["depth_scale_m"])
    return depth_m.astype(np.float32), view.get("intrinsics", request.get("intrinsics")), view["workspace_from_camera"]


@pytest.fixture(scope="module")
def lenient(tmp_path_factory):
    """A service that gives grasps for one view, too: one shows too little for the settings that people use."""
    folder = tmp_path_factory.mktemp("lenient")
    settings, count = re.subn(
        r"^quality_min = .*$", "quality_min = 0.5", (ROOT / "configs/plan/paper.toml").read_text(), flags=re.MULTILINE
    )
    assert count == 1
    (folder / "plan.toml").write_text(settings)
    with running(folder, "--config", folder / "plan.toml") as service:
        yield service


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1", "32FC1 big-endian"])
def test_the_ros_node_publishes_what_the_service_answers(lenient, encoding, one_demo_view, monkeypatch):
    depth_m, lens, pose = one_demo_view
    name = encoding.split()[0]
    if name == "16UC1":
        depth = np.rint(depth_m * 1000).astype("<u2")
    else:
        depth = depth_m.astype(">f4" if "big" in encoding else "<f4")
    view = {"depth": file_of(npy(depth)), "intrinsics": lens, "workspace_from_camera": pose}
    status, _, body = lenient.plan({"views": [view]})
    assert status == 200, body
    transform = (pose["position_m"], pose["quaternion_xyzw"])
    [array], warnings = ros(depth, name, lens, transform, lenient, monkeypatch)
    assert warnings == [] and array.header.frame_id == "workspace" and array.header.stamp == {"sec": 3}
    expected = [grasp["workspace_from_grasp"] for grasp in json.loads(body)["grasps"]]
    assert expected, "nothing was planned, so nothing is compared"
    published = [(list(vars(pose.position).values()), list(vars(pose.orientation).values())) for pose in array.poses]
    assert published == [(pose["position_m"], pose["quaternion_xyzw"]) for pose in expected]


def test_the_ros_node_goes_on_without_a_service(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        gone = types.SimpleNamespace(port=nobody.getsockname()[1])
    depth = np.full((4, 5), 0.5, np.float32)
    info = {"fx_px": 5.0, "fy_px": 5.0, "cx_px": 2.0, "cy_px": 1.5}
    published, warnings = ros(depth, "32FC1", info, ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]), gone, monkeypatch)
    assert published == [] and len(warnings) == 1 and warnings[0].startswith("no plan: ")


def test_the_ros_node_is_short():
    assert len(NODE.read_text().splitlines()) <= 40
