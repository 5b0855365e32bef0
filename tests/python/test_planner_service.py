"""`graspmill serve` with well-behaved clients. test_planner_attacks.py has the hostile ones."""

import json
import re
import tomllib

import numpy as np

from mutations import leaves
from planner_service import DEMO, JSON, ROOT, check_error, demo_request, matrix, running
from programs import run


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


def test_every_key_of_an_answer_is_described(service):
    page = (ROOT / "docs" / "plan-format.md").read_text()
    base = {"position_m": [1.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}
    explained = json.loads(service.plan(demo_request() | {"explain": True, "base_from_workspace": base})[2])
    found = json.loads(service.plan(on_table(demo_request()))[2])
    assert explained["dropped"] and explained["grasps"][0]["base_from_grasp"] and not explained["table"]
    assert found["table"]["candidates"] and found["grasps"]
    keys = {path[-1] for path in leaves([explained, found]) if isinstance(path[-1], str)}
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
    printed = run("graspmill", "plan", "--json", "--views", DEMO / "views.toml", code=0)
    status, headers, body = service.plan(demo_request())
    assert status == 200, body
    answer = json.loads(body)
    assert answer == json.loads(printed.stdout)
    assert answer["grasps"] and answer["reason"] is None and answer["format"] == "graspmill-plan/3"
    assert re.fullmatch(r"parse;dur=[0-9.]+(, [\w-]+;dur=[0-9.]+)+", headers["server-timing"])
    assert service.plan(demo_request())[2] == body


def test_a_taken_port_is_told_and_sigterm_ends_it_with_0(service, tmp_path):
    done = run("graspmill", "serve", "--port", service.port)
    assert done.returncode == 75 and "failed to listen" in done.stderr and done.stdout == "", done
    with running(tmp_path) as other:
        status, headers, told = other.ask("POST", "/v1/plan", b" " * (65 << 20), JSON)
        assert status == 413 and check_error(status, headers, told)
        assert other.end() == 0
