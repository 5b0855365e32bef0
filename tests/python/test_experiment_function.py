"""`graspmill.experiment(planner=function)`: our rounds, anyone's grasps, also those of a function that misbehaves."""

import json
import os
import signal
import threading
from functools import partial

import numpy as np
import pytest

from grasp_sets import graspmill, refused
from programs import ROOT, rounds_of

COMMON = {"objects.count": 2, "noise.kind": "d435"}
GIGA = ROOT / "configs" / "experiment" / "giga-pile.toml"


def run(out, planner=None, rounds=1, settings=None, **options):
    return graspmill.experiment(
        out, GIGA, planner=planner, rounds=rounds, seed=31, threads=2, settings=COMMON | (settings or {}), **options
    )


def attempts_of(out):
    timeless = [[{k: v for k, v in attempt.items() if not k.endswith("_ms")} for attempt in r["trials"]] for r in rounds_of(out)]
    return timeless, [r["ending"] for r in rounds_of(out)]


def from_above(look):
    """Straight down at each object's middle, tips 30 mm below its top."""
    poses, scores = [], []
    for points in look.clouds()[0]:
        if len(points):
            pose = np.diag([1.0, -1.0, -1.0, 1.0])
            pose[:3, 3] = [*points[:, :2].mean(axis=0), max(points[:, 2].max() - 0.03, 0.055)]
            poses.append(pose)
            scores.append(len(points))
    return np.array(poses), scores


@pytest.mark.parametrize("frames", ["given", "found"])
def test_our_planner_as_a_function_equals_the_one_in_the_process(tmp_path, frames):
    planner = graspmill.Planner("judge")

    def ours(look):
        return planner.plan(look.depths, look.cameras, avoid=look.failed, workspace_size_m=look.workspace_size_m)

    ours_in = run(tmp_path / "inside", rounds=2, settings={"frames": frames})
    as_function = run(tmp_path / "function", ours, rounds=2, settings={"frames": frames})
    (inside, ends), (function, ends_of_function) = attempts_of(tmp_path / "inside"), attempts_of(tmp_path / "function")
    assert ends == ends_of_function and [len(r) for r in inside] == [len(r) for r in function]
    for one, other in zip(sum(inside, []), sum(function, []), strict=True):
        assert one["outcome"] == other["outcome"] and one["planned_count"] == other["planned_count"]
        assert np.isclose(one["quality"], other["quality"], atol=1e-4) and np.isclose(one["width_m"], other["width_m"], atol=1e-4)
        positions = [attempt["workspace_from_grasp"]["position_m"] for attempt in (one, other)]
        assert np.allclose(*positions, atol=1e-4)
    assert ours_in.results["held"] == as_function.results["held"] >= 1


def test_a_function_is_shown_what_lies_there(tmp_path):
    looks, told = [], []

    def planner(look):
        looks.append(look)
        return from_above(look)

    results = run(tmp_path / "run", planner, progress=lambda *counts: told.append(counts))
    first = looks[0]
    assert first.depths[0].shape == first.objects[0].shape == (480, 640) and first.depths[0].dtype == np.float32
    assert first.object_count == 2 and first.gripper.name == graspmill.Planner().gripper
    assert np.allclose(first.down, [0, 0, -1]) and first.failed.shape == (0, 4, 4)
    things, rest = first.clouds()
    assert len(things) == 2 and all(len(points) > 100 for points in things)
    assert all(np.median(points[:, 2]) > 0.052 for points in things) and 0.04 < np.median(rest[:, 2]) < 0.06
    attempt = rounds_of(tmp_path / "run")[0]["trials"][0]
    assert attempt["quality"] == max(len(points) for points in things) and attempt["planned_count"] == 2
    # A grasp that failed is told, for the protocol has it so.
    assert all(len(after.failed) <= 2 for after in looks[1:])
    assert told[-1][:2] == (1, 1) and results.folder == tmp_path / "run"
    assert {"report.html", "report.json", "rounds.parquet", "attempts.parquet"} <= {f.name for f in results.folder.iterdir()}
    assert "function-" in (tmp_path / "run" / "report.html").read_text() and "<html" in results.page().html


def test_in_the_first_cameras_frame_down_and_points_are_too(tmp_path):
    def planner(look):
        assert look.cameras[0].workspace_from_camera is None
        things, rest = look.clouds()
        # The table is a plane across gravity.
        heights = rest @ -look.down
        assert np.percentile(heights, 90) - np.percentile(heights, 10) < 0.03 and things[0][:, 2].min() > 0.1
        return np.empty((0, 4, 4)), []

    run(tmp_path / "run", planner, settings={"frames": "found"})
    assert rounds_of(tmp_path / "run")[0]["ending"] == "no_grasp"


class Wordless(Exception):
    def __str__(self):
        raise LookupError("no words")


def raising(error):
    def planner(_):
        raise error

    return planner


def test_what_a_function_does_ends_the_round_and_not_the_run(tmp_path):
    ways = [
        (raising(RuntimeError("out of coffee")), "RuntimeError: out of coffee (test_experiment_function.py, line "),
        (raising(Wordless()), "Wordless: its text raised LookupError (test_experiment_function.py, line "),
        (raising(RuntimeError("file \udcff is gone")), "RuntimeError: file ? is gone (test_experiment_function.py, line "),
        (lambda _: None, "must be a Plan, or poses and scores, got None"),
        (lambda _: [np.eye(4)], "must be a Plan, or poses and scores"),
        (lambda _: (np.eye(4)[None], [np.nan]), "scores"),
        (lambda _: (np.eye(4)[None], [1.0, 2.0]), "the scores that planner returns must have the shape [1]"),
        (lambda _: (2 * np.eye(4)[None], [1.0]), "the poses that planner returns must be rigid"),
        (lambda _: (np.full((1, 4, 4), np.inf), [1.0]), "the poses that planner returns must be finite"),
        (lambda _: (np.eye(4)[None], [1.0], [np.nan]), "the widths that planner returns must be finite"),
    ]
    given = iter(ways)
    run(tmp_path / "run", lambda look: next(given)[0](look), rounds=len(ways))
    played = rounds_of(tmp_path / "run")
    assert [r["ending"] for r in played] == ["no_answer"] * len(ways)
    told = [r["no_answer"] for r in played]
    # Rounds are played side by side, and so are asked in any order.
    assert all(any(why in one for one in told) for _, why in ways), told
    assert f"{len(ways)} of {len(ways)} rounds ended because the planner gave no answer" in (tmp_path / "run" / "report.html").read_text()


def test_a_plan_that_is_too_far_to_be_written_down_ends_the_round(tmp_path):
    pose = {"position_m": [3e38, -3e38, 3e38], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}
    unknown = ("object", "rho_m", "width_m", "width_seen_share", "robustness", "base_from_grasp", "workspace_from_flange", "base_from_flange")
    row = {"workspace_from_grasp": pose, "camera_from_grasp": pose, "opening_m": 0.08, "quality": 0.9, **dict.fromkeys(unknown)}
    plan = graspmill.Plan.from_json(json.dumps({"format": "graspmill-plan/3", "gripper": "parallel_jaw_80", "grasps": [row]}))
    # The first camera's frame is turned: there the numbers are finite, in the workspace they are not.
    run(tmp_path / "run", lambda _: plan, settings={"frames": "found"}, name="mine")
    assert "within 1000 m" in rounds_of(tmp_path / "run")[0]["no_answer"]
    run(tmp_path / "run", lambda _: ([], []), rounds=2, settings={"frames": "found"}, name="mine")
    assert [r["ending"] for r in rounds_of(tmp_path / "run")] == ["no_answer", "no_grasp"]


def test_what_is_outside_ends_the_run(tmp_path):
    with pytest.raises(graspmill.OutsideError, match="switched off"):
        run(tmp_path / "run", raising(graspmill.OutsideError("the robot is switched off")), name="mine")
    assert rounds_of(tmp_path / "run") == []
    run(tmp_path / "run", lambda look: (*from_above(look), [0.02] * len(from_above(look)[1])), name="mine")
    assert all(np.isclose(attempt["width_m"], 0.02) for attempt in rounds_of(tmp_path / "run")[0]["trials"])


def test_ctrl_c_in_the_function_keeps_the_rounds_and_the_run_goes_on(tmp_path):
    asked = []

    def stopped(look):
        asked.append(look)
        if len(rounds_of(tmp_path / "parts")) >= 1:
            raise KeyboardInterrupt
        return from_above(look)

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "parts", stopped, rounds=4, name="mine")
    kept = rounds_of(tmp_path / "parts")
    assert 1 <= len(kept) < 4 and all(r["ending"] != "no_answer" for r in kept)
    assert not (tmp_path / "parts" / "report.json").exists()
    run(tmp_path / "parts", from_above, rounds=4, name="mine")
    run(tmp_path / "whole", from_above, rounds=4)
    assert attempts_of(tmp_path / "parts") == attempts_of(tmp_path / "whole")
    refused("holds", lambda: run(tmp_path / "parts", from_above, rounds=4, name="another"))


def test_ctrl_c_stops_our_own_planner_too(tmp_path, request):
    # In a job that a shell starts in the background Ctrl-C is ignored, also by Python.
    request.addfinalizer(partial(signal.signal, signal.SIGINT, signal.signal(signal.SIGINT, signal.default_int_handler)))
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        graspmill.experiment(tmp_path / "run", rounds=500, threads=1)
    # The lock is free, and what was played is kept.
    assert len(rounds_of(tmp_path / "run")) < 500


def test_bad_arguments_are_named(tmp_path):
    for options, why in [
        ({"planner": 7}, "planner must be a function"),
        ({"name": "mine"}, "name goes with planner"),
        ({"rounds": 0}, "rounds must be between 1"),
        ({"settings": {"objects.cuont": 2}}, "cuont"),
        ({"planner": print, "settings": {"plan.ranking.policy": "vgn-best"}}, "plan.ranking.policy must be left out where another planner"),
        ({"config": tmp_path / "none.toml"}, "none.toml"),
        ({"progress": 3}, "progress must be"),
    ]:
        refused(why, lambda: graspmill.experiment(tmp_path / "run", **options))
    assert not (tmp_path / "run" / "journal.jsonl").exists()
