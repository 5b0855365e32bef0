"""`planner serve` with well-behaved clients. test_planner_attacks.py has the hostile ones.

    python -m pytest tests/python/test_planner_service.py   # GRASPMILL_PLANNER=path/to/planner, or target/debug/planner
"""

import base64
import json
import re
import socket
import subprocess
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from planner_service import DEMO, JSON, PLANNER, ROOT
from planner_service import check_error, demo_request, file_of, matrix, metrics, npy, png, running, seen

PATHS = {"/v1/plan", "/v1/model", "/predict", "/config", "/version", "/healthz", "/readyz", "/metrics", "/openapi.json"}


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
    assert model["config"] == tomllib.loads((ROOT / "configs" / "plan" / "judge.toml").read_text())


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
    assert status == 422 and b"must be one of judge, paper, vgn, got best: config" in answer


def test_base64_may_be_wrapped_and_intrinsics_a_list(service):
    """As `base64 depth.png` prints the bytes, and ROS's k."""
    plain = demo_request()
    view = plain["views"][0]
    lens = view.pop("intrinsics", None) or plain["intrinsics"]
    k = [lens["fx_px"], 0.0, lens["cx_px"], 0.0, lens["fy_px"], lens["cy_px"], 0.0, 0.0, 1.0]
    wrapped = base64.encodebytes(base64.b64decode(view["depth"]["data"])).decode()
    assert wrapped.count("\n") > 10
    bodies = []
    for given in ({"intrinsics": lens}, {"intrinsics": k, "depth": {"data": wrapped}}):
        status, _, body = service.plan({"views": [view | given]})
        assert status == 200 and json.loads(body)["grasps"], body
        bodies.append(body)
    assert bodies[0] == bodies[1]
    told = check_error(*service.plan({"views": [view | {"intrinsics": [640, 480, *k[:1], k[4], k[2], k[5]]}]}))
    assert told == "intrinsics must be { fx_px, fy_px, cx_px, cy_px } or a camera matrix, got a list of 6: views[0].intrinsics"


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
    """The schema with unknown keys forbidden."""
    if isinstance(value, list):
        return [strict(inner) for inner in value]
    if not isinstance(value, dict):
        return value
    more = {"additionalProperties": False} if "properties" in value else {}
    return more | {key: strict(inner) for key, inner in value.items()}


def test_answers_are_what_the_description_says(service):
    described = json.loads(service.ask("GET", "/openapi.json")[2])

    def check(answer, path, method, status, answered=200):
        """Validates an answer; returns the schema's name."""
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
    assert explained["workspace_from_camera"] and not explained["table"]
    assert all(grasp["camera_from_grasp"] and grasp["opening_m"] > 0.0 for grasp in plain["grasps"])
    found = planned(on_table(demo_request()))
    assert found["table"]["candidates"] and found["grasps"] and found["workspace_from_camera"] != plain["workspace_from_camera"]
    assert planned({"views": [seen()]})["reason"]
    assert planned({"tsdf": file_of(npy(np.zeros((40, 40, 40), np.float32)))})["plane"] is None
    status, _, body = service.ask("GET", "/v1/model")
    assert check(json.loads(body), "/v1/model", "get", 200, status) == "ModelAnswer"
    for request, status in [(b"[", 400), ({}, 422)]:
        answered, _, body = service.plan(request)
        assert check(json.loads(body), "/v1/plan", "post", status, answered) == "ErrorAnswer"
    # The check itself can fail.
    for wrong in (plain | {"more": 1}, {key: plain[key] for key in plain if key != "region"}):
        with pytest.raises(AssertionError):
            check(wrong, "/v1/plan", "post", 200)


def on_table(request):
    """The same views, of which the first has no pose, and the others have theirs in its frame."""
    places = [matrix(view["workspace_from_camera"]) for view in request["views"]]
    views = [{key: view[key] for key in view if key != "workspace_from_camera"} for view in request["views"]]
    views[0]["workspace_from_camera"] = "table"
    for view, place in zip(views[1:], places[1:]):
        view["first_from_camera"] = (np.linalg.inv(places[0]) @ place).tolist()
    return request | {"views": views}


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


def test_a_png_in_millimetres_is_planned_like_an_array_in_metres(service):
    depth_m = np.full((48, 64), 0.55, np.float32)
    depth_m[10:30, 20:40] = 0.5
    images = npy(depth_m), png(np.rint(depth_m * 1000).astype(np.uint16))
    first, second = (service.plan({"views": [seen() | {"depth": file_of(image)}]}) for image in images)
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
