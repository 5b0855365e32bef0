"""`graspmill experiment run --planner URL`: anyone's planner behind the contract of /predict, also one that misbehaves.
The program is that of the package; the static one says so."""

import base64
import json
import threading
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from programs import PACKAGE, ROOT, commanded, program, ran, rounds_of

GONE, BROKEN, SLOW = object(), object(), object()
DOWN = {"translation": [0, 0, 0], "rotation_matrix": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], "score": 0.5, "gripper_width": None}


@contextmanager
def planner(answer, config=None):
    """A server whose `/predict` is `answer(request)`: bytes, a status with bytes and an address, None for silence, GONE for its
    end. `/config` may be a function, too."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_):
            pass

        def say(self, status, data, location=None):
            self.send_response(status)
            if location is not None:
                self.send_header("Location", location)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def do_GET(self):
            if config is SLOW:
                self.wfile.write(b"HTTP/1.1 200 OK\r\n")
                with suppress(OSError):
                    while not done.wait(0.1):
                        self.wfile.write(b"a")
            elif callable(config):
                self.say(*config())
            elif config is None or self.path != "/config":
                self.say(404, b"")
            else:
                self.say(200, config if isinstance(config, bytes) else json.dumps(config).encode())

        def do_POST(self):
            asked.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            said = answer(asked[-1])
            if said is None:
                done.wait(60)
            elif said is GONE:
                server.shutdown()
                server.server_close()
            elif said is BROKEN:
                self.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\n{")
            else:
                self.say(*(said if isinstance(said, tuple) else (200, said)))

    done, server = threading.Event(), ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()  # its end waits for a poll
    try:
        yield f"http://127.0.0.1:{server.server_port}/predict", asked
    finally:
        done.set()
        server.shutdown()
        server.server_close()


def run(out, *args, rounds=1, code=0, by=None):
    """How the command ends in this process, or as a program of its own."""
    common = "--rounds", rounds, "--seed", 31, "--threads", 1, "--set", "objects.count=2", "--set", "noise.kind=d435"
    words = "experiment", "run", ROOT / "configs/experiment/giga-pile.toml", *common, *args, "--out", out
    return commanded(*words, code=code) if by is None else ran(*by, *words, code=code, timeout=300)


def points(array):
    assert array["dtype"] == "float32"
    return np.frombuffer(base64.b64decode(array["data_b64"], validate=True), "<f4").reshape(array["shape"])


def grasps(*grasps):
    return json.dumps({"grasps": grasps, "meta": {}}).encode()


def test_a_planner_is_told_each_object_and_the_rest(tmp_path):
    # Straight down at the object's middle, tips 30 mm below its top: what the contract's own axes are for.
    def answer(request):
        thing = points(request["point_cloud"])
        return grasps(DOWN | {"translation": [*thing[:, :2].mean(axis=0).tolist(), float(thing[:, 2].max()) + 0.07]})

    with planner(answer, {"fingertip_depth": 0.1}) as (url, asked):
        run(tmp_path / "run", "--planner", url)
    first = asked[:2]
    clouds = [points(request["point_cloud"]) for request in first]
    for request, cloud, other in zip(first, clouds, clouds[::-1], strict=True):
        rest = points(request["scene_points"])
        assert len(cloud) >= 128 and len(cloud) + len(rest) <= 65_536
        # An object stands on the table, whose points are of the rest, as are those of the other object.
        assert 0.04 < np.median(rest[:, 2]) < 0.06 and np.median(cloud[:, 2]) > 0.055
        gap = np.linalg.norm(rest[None] - other[::50, None], axis=2).min(axis=1)
        assert np.median(gap) < 0.004
        assert np.allclose(request["down"], [0, 0, -1]) and request["eye_m"][2] > 0.2
    (played,) = rounds_of(tmp_path / "run")
    attempt = played["trials"][0]
    pose = attempt["workspace_from_grasp"]
    # The tips are 0.1 m along the approach from where the answer was.
    tops = [cloud[:, 2].max() for cloud in clouds]
    assert min(abs(pose["position_m"][2] - (top - 0.03)) for top in tops) < 1e-4
    x, y, z, w = pose["quaternion_xyzw"]
    assert np.isclose(1 - 2 * (x * x + y * y), -1, atol=1e-5), "z of our grasp goes down"
    assert attempt["quality"] == 0.5 and attempt["planned_count"] == 2


def test_what_a_planner_does_ends_the_round_and_not_the_run(tmp_path):
    answers = [
        ((500, b'{"detail": {"error": "internal_error"}}'), "status 500: {"), (b"nonsense", "an answer must be the contract's"),
        (b'{"grasps": 7}', "an answer must be the contract's"),
        (grasps(DOWN | {"rotation_matrix": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}), "must have a rotation"),
        (grasps(DOWN | {"rotation_matrix": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]}), "must have a rotation"),
        (grasps(DOWN | {"translation": ["0", 0, 0]}), "an answer must be the contract's"),
        (b"[" * 100_000, "an answer must be the contract's"), (grasps(DOWN | {"score": 1e39}), "finite in single precision"),
        (grasps(DOWN | {"gripper_width": float("inf")}), "finite in single precision"), (b" " * ((64 << 20) + 1), "at most 67108864 bytes"),
        ((307, b"elsewhere"), "status 307: elsewhere"), ((404, b"where"), "status 404, is the address that of /predict?: where"),
        ((308, b"there", "http://127.0.0.1:1/predict"), "status 308, moved to http://127.0.0.1:1/predict: give that address: there"),
        (BROKEN, "IncompleteRead"), (None, "no answer in time"),
    ]  # fmt: skip
    given = iter(answers)
    with planner(lambda _: next(given)[0], {"fingertip_depth": 0.1}) as (url, _):
        told = run(tmp_path / "run", "--planner", url, "--planner-timeout-s", "1", rounds=len(answers)).stdout
    for round, (answer, why) in zip(rounds_of(tmp_path / "run"), answers, strict=True):
        assert round["ending"] == "no_answer" and why in round["no_answer"], (answer, round)
    why = f"{len(answers)} of {len(answers)} rounds ended because the planner gave no answer"
    assert why in told and why in (tmp_path / "run" / "report.html").read_text()
    with planner(lambda _: grasps(DOWN | {"translation": [3e38, 3e38, 3e38]}), {"fingertip_depth": 0.1}) as (url, _):
        run(tmp_path / "far", "--planner", url)
    assert "within 1000" in rounds_of(tmp_path / "far")[0]["no_answer"]


def test_a_planner_that_says_a_byte_now_and_then_is_too_late(tmp_path):
    with planner(None, SLOW) as (url, _):
        assert "no answer in time" in run(tmp_path / "run", "--planner", url, "--planner-timeout-s", "1", code=75).stderr


@pytest.mark.parametrize("now", [GONE, (502, b"no upstream"), (404, b"no tunnel")])
def test_a_run_whose_planner_is_gone_ends_and_its_rounds_are_played_when_it_is_back(tmp_path, now):
    def answer(_):
        return grasps() if len(asked) <= 2 else now

    def config():  # a proxy takes connections as before
        return (200, b'{"fingertip_depth": 0.1}') if len(asked) <= 2 else now

    with planner(answer, config) as (url, asked):
        said = run(tmp_path / "run", "--planner", url, rounds=3, code=75).stderr
    why = "server cannot be reached: " if now is GONE else f"server does not say what it is: status {now[0]}"
    assert said.splitlines()[-1].startswith(f"error: --planner {url}: the {why}"), said
    assert [round["ending"] for round in rounds_of(tmp_path / "run")] == ["no_grasp"]
    with planner(lambda _: grasps(), {"fingertip_depth": 0.1}) as (url, asked):
        run(tmp_path / "run", "--planner", url, rounds=3)
    assert len(asked) == 4 and [round["ending"] for round in rounds_of(tmp_path / "run")] == ["no_grasp"] * 3


def test_the_static_program_says_who_asks(tmp_path):
    said = run(tmp_path / "run", "--planner", "http://127.0.0.1:1/predict", code=2, by=[program("graspmill")]).stderr
    assert "the program of the Python package asks" in said


def test_what_is_not_known_of_a_planner_is_asked_for(tmp_path):
    for number, (config, why) in enumerate((
        (None, "does not say where the finger tips are (fingertip_depth): give --tip-depth"),
        ({"fingertip_depth": 1e30, "min_points": 0}, "fingertip_depth must be between -1 and 1, got 1e+30"),
        ({"fingertip_depth": 0.1, "approach_axis_local": [1, 1, 0]}, "unit axes at right angles"),
        ({"fingertip_depth": 0.1, "min_points": 1e30}, "min_points must be between 0 and 32768, got 1e+30"),
        (b"<html>", "/config must be JSON"),
    )):  # fmt: skip
        with planner(lambda _: grasps(), config) as (url, _):
            assert why in run(tmp_path / f"refused-{number}", "--planner", url, code=78).stderr
            if number < 2:
                run(tmp_path / f"known-{number}", "--planner", url, "--tip-depth", "0.1")
    for other in ("ftp://here", "here"):
        assert "must be an address" in run(tmp_path / "a", "--planner", other, code=78).stderr
    # The server is gone: nothing was begun.
    assert "the server cannot be reached" in run(tmp_path / "b", "--planner", url, code=75).stderr
    assert "required" in run(tmp_path / "c", "--tip-depth", "0.1", code=2, by=PACKAGE).stderr


def test_what_another_planner_does_not_heed_is_refused_or_said(tmp_path):
    for key in ("plan.detection.quality_min=0.1", "plan.ranking.policy=vgn-best", "model=mine.safetensors"):
        said = run(tmp_path / "a", "--planner", "http://127.0.0.1:1/predict", "--set", key, code=78).stderr
        assert f"{key.partition('=')[0]} must be left out where another planner plans" in said
    for name, config, told in (
        ("b", {"hand": "wide_hand", "gripper_max_width": 0.14}, "'wide_hand', which opens 0.14 m"),
        ("c", {"backend": "graspmill", "gripper": "franka_hand", "gripper_max_width": 0.08}, "'franka_hand', which opens 0.08 m"),
        ("d", {"gripper": "franka_panda", "gripper_max_width": 0.08}, None),
    ):
        with planner(lambda _: grasps(), config | {"fingertip_depth": 0.1}) as (url, _):
            said = run(tmp_path / name, "--planner", url).stderr
        wanted = f"warning: --planner {url}: it plans for the gripper {told}, but --set plan.gripper is parallel_jaw_80"
        assert (wanted in said) == (told is not None) and ("warning" in said) == (told is not None), said
        report = json.loads((tmp_path / name / "report.json").read_text())
        assert f"# Planned by {url} for the gripper " in report["about"]["config"]
        assert "quality_min" not in report["about"]["config"] and report["about"]["planner"].startswith(url)


def test_our_own_service_is_a_planner_and_a_run_goes_on(service, tmp_path):
    url = ("--planner", f"http://127.0.0.1:{service.port}/predict")
    run(tmp_path / "whole", *url, rounds=2, by=PACKAGE)
    run(tmp_path / "parts", *url, rounds=1)
    run(tmp_path / "parts", *url, rounds=2)
    told = run(tmp_path / "parts", *url, "--tip-depth", "0.01", rounds=2, code=78).stderr
    assert "holds" in told, told
    whole, parts = ((tmp_path / name / "report.json").read_text() for name in ("whole", "parts"))
    results = [json.loads(text)["results"] for text in (whole, parts)]
    for result in results:
        [result.pop(key) for key in [key for key in result if "ms" in key]]
    assert results[0]["endings"] == results[1]["endings"]
    assert sum(len(round["trials"]) for round in rounds_of(tmp_path / "whole")) >= 4
    held = sum(trial["outcome"] == "held" for round in rounds_of(tmp_path / "whole") for trial in round["trials"])
    assert held >= 3
