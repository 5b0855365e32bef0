"""`graspmill serve` with well-behaved clients. test_planner_attacks.py has the hostile ones.

    python -m pytest tests/python/test_planner_service.py
"""

import json
import re
import socket
import subprocess
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from planner_service import DEMO, JSON, PLANNER, ROOT
from planner_service import check_error, demo_request, matrix, read_all, running, seen


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    with running(tmp_path_factory.mktemp("service")) as service:
        yield service


def test_health_readiness_and_model(service):
    assert service.ask("GET", "/healthz")[::2] == (200, b"ok")
    assert service.ask("GET", "/readyz")[0] == 200
    status, headers, body = service.ask("GET", "/v1/model")
    model = json.loads(body)
    assert status == 200 and headers["content-type"] == "application/json"
    assert re.fullmatch(r"[0-9a-f]{64}", model["model"])
    assert model["grid"]["resolution"] == 40 and model["gripper"] == "parallel_jaw_80"
    shipped = tomllib.loads((ROOT / "configs" / "plan" / "judge.toml").read_text())
    shipped["detection"]["closing"], shipped["ranking"]["without_object"] = "predicted", "last"  # their only words
    assert model["config"] == shipped


def test_a_request_may_name_settings_that_come_with_the_planner(service):
    own = json.loads(service.ask("GET", "/v1/model")[2])["model"]
    models = {}
    for name in ("judge", "paper", "vgn"):
        body = json.dumps(demo_request() | {"config": name}).encode()
        status, _, answer = service.ask("POST", "/v1/plan", body, JSON)
        assert status == 200, answer
        models[name] = json.loads(answer)["model"]
    assert models["judge"] == own and len(set(models.values())) == 3
    body = json.dumps(demo_request() | {"config": "best"}).encode()
    status, _, answer = service.ask("POST", "/v1/plan", body, JSON)
    assert status == 422 and b"expected one of `judge`, `paper`, `vgn`: config" in answer


def keys_of(value):
    """Every key of a JSON value, at any depth."""
    if isinstance(value, dict):
        yield from value
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else []
    for one in inner:
        yield from keys_of(one)


def test_every_key_of_an_answer_is_described(service):
    page = (ROOT / "docs" / "plan-format.md").read_text()
    base = {"position_m": [1.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}
    explained = json.loads(service.plan(demo_request() | {"explain": True, "base_from_workspace": base})[2])
    found = json.loads(service.plan(on_table(demo_request()))[2])
    assert explained["dropped"] and explained["grasps"][0]["base_from_grasp"] and not explained["table"]
    assert found["table"]["candidates"] and found["grasps"]
    keys = set(keys_of(explained)) | set(keys_of(found))
    undescribed = sorted(key for key in keys if not re.search(rf"\b{key}\b", page))
    assert len(keys) > 40 and not undescribed


def on_table(request):
    """The same views, of which the first has no pose, and the others have theirs in its frame."""
    places = [matrix(view["workspace_from_camera"]) for view in request["views"]]
    views = [{key: view[key] for key in view if key != "workspace_from_camera"} for view in request["views"]]
    views[0]["workspace_from_camera"] = "table"
    for view, place in zip(views[1:], places[1:]):
        view["first_from_camera"] = (np.linalg.inv(places[0]) @ place).tolist()
    return request | {"views": views}


def test_it_plans_what_the_command_plans_each_time_with_the_same_bytes(service):
    command = [PLANNER, "plan", "--json", "--views", DEMO / "views.toml"]
    printed = subprocess.run(command, capture_output=True, check=False)
    assert printed.returncode == 0, printed.stderr
    status, headers, body = service.plan(demo_request())
    assert status == 200, body
    answer = json.loads(body)
    assert answer == json.loads(printed.stdout)
    assert answer["grasps"] and answer["reason"] is None and answer["format"] == "graspmill-plan/3"
    assert re.fullmatch(r"parse;dur=[0-9.]+(, [\w-]+;dur=[0-9.]+)+", headers["server-timing"])
    assert service.plan(demo_request())[2] == body


def test_nothing_to_grasp_is_an_answer(service):
    status, _, body = service.plan({"views": [seen()]})
    answer = json.loads(body)
    assert status == 200 and answer["grasps"] == [] and answer["reason"], answer


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


def test_sigterm_ends_it_with_0_after_the_answer_under_way(tmp_path):
    with running(tmp_path) as service:
        body = json.dumps({"views": [seen()] * 32}).encode()
        idle = socket.create_connection(("127.0.0.1", service.port))
        under_way = socket.create_connection(("127.0.0.1", service.port), timeout=30)
        head = f"POST /v1/plan HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {len(body)}"
        under_way.sendall(f"{head}\r\nExpect: 100-continue\r\nConnection: close\r\n\r\n".encode())
        # It asks for the body, so the request is under way.
        assert under_way.recv(25).startswith(b"HTTP/1.1 100 Continue")
        with ThreadPoolExecutor(1) as pool:
            ended = pool.submit(service.end)
            with pytest.raises(ConnectionError):  # it has begun to stop: nobody listens
                while True:
                    socket.create_connection(("127.0.0.1", service.port), timeout=30).close()
                    time.sleep(0.05)  # a storm of connections would take all its places
            under_way.sendall(body)
            answer = read_all(under_way)
            assert ended.result() == 0
        assert answer.lstrip().startswith(b"HTTP/1.1 200 OK"), answer[:300]
        idle.close()


def test_a_taken_port_is_told(service):
    command = [str(PLANNER), "serve", "--port", str(service.port)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 75 and "failed to listen" in done.stderr, done
    assert done.stdout == ""
