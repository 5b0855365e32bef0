"""`POST /predict` with a client written from the contract of GraspGen-X's and DexGraspNet 2's servers (version 0.1.0)."""

import base64
import json

import numpy as np
import pytest

from planner_service import JSON, demo_request, demo_view, file_of, matrix, npy, running

GRASP = {"translation", "rotation_quat", "rotation_matrix", "score", "gripper_width", "joint_angles", "joint_names", "approach_axis"}
GRASP |= {"object_id"}
# A turn about a tilted axis and a shift: a frame that no camera has.
TURN = matrix({"position_m": [0.3, -1.2, 0.7], "quaternion_xyzw": [0.5, -0.5, 0.1, 0.7]})


@pytest.fixture(scope="module")
def scene(service):
    """The first camera's cloud of the demo in its optical frame: one object, the rest, and the camera's pose."""
    depth, lens, pose = demo_view()
    v, u = np.nonzero(depth)
    z = depth[v, u].astype(float)
    camera = np.column_stack([(u + 0.5 - lens["cx_px"]) * z / lens["fx_px"], (v + 0.5 - lens["cy_px"]) * z / lens["fy_px"], z])
    workspace_from_camera = matrix(pose)
    workspace = camera @ workspace_from_camera[:3, :3].T + workspace_from_camera[:3, 3]
    status, _, plan = service.plan(demo_request())
    assert status == 200
    centroid = np.array(json.loads(plan)["objects"][0]["centroid_m"])
    is_object = (workspace[:, 2] > 0.056) & (np.linalg.norm(workspace[:, :2] - centroid[:2], axis=1) < 0.045)
    assert is_object.sum() > 500
    return camera[is_object], camera[~is_object], workspace_from_camera


def encoded(array):
    return {"dtype": str(array.dtype), "shape": list(array.shape), "data_b64": base64.b64encode(array.tobytes()).decode("ascii")}


def predicted(service, request):
    status, _, body = service.ask("POST", "/predict", json.dumps(request).encode(), JSON)
    return status, json.loads(body)


def asked(scene, dtype=np.float32, **more):
    point_cloud, scene_points, _ = scene
    return {"point_cloud": encoded(point_cloud.astype(dtype)), "scene_points": encoded(scene_points.astype(dtype))} | more


def test_an_answer_has_what_the_contract_names(service, scene):
    status, answer = predicted(service, asked(scene, category_sampling=True, unknown_key=7))
    assert status == 200, answer
    grasps, meta = answer["grasps"], answer["meta"]
    config = json.loads(service.ask("GET", "/config")[2])
    assert 1 <= len(grasps) <= config["default_num_grasps"] == 20
    scores = [grasp["score"] for grasp in grasps]
    assert scores == sorted(scores, reverse=True) and all(0 <= score <= 1 for score in scores)
    for grasp in grasps:
        assert set(grasp) == GRASP and grasp["object_id"] == 1 and grasp["joint_angles"] is None
        rotation = np.array(grasp["rotation_matrix"])
        x, y, z, w = grasp["rotation_quat"]
        same = matrix({"position_m": [0, 0, 0], "quaternion_xyzw": [x, y, z, w]})[:3, :3]
        assert w >= 0 and np.allclose(same, rotation, atol=1e-5) and np.isclose(np.linalg.det(rotation), 1)
        assert np.allclose(rotation @ config["approach_axis_local"], grasp["approach_axis"], atol=1e-5)
        assert grasp["gripper_width"] is None or 0 < grasp["gripper_width"] <= config["gripper_max_width"]
        # The tips are at the object, which the gripper comes to from the camera's side of the table.
        assert np.linalg.norm(scene[0] - grasp["translation"], axis=1).min() < 0.045
    assert config["approach_axis_local"] == [1, 0, 0] and config["jaw_axis_local"] == [0, 1, 0]
    assert config["fingertip_depth"] == config["tcp_offset"] == 0
    assert meta["frame_id"] == "unchanged_from_input" and meta["category_sampling"] is True
    assert [meta["num_input_points"], meta["num_scene_points"]] == [len(scene[0]), len(scene[1])]
    assert json.loads(service.ask("GET", "/version")[2])["api_version"] == meta["api_version"] == "0.1.0"


def test_limits_of_count_and_score_are_kept(service, scene):
    grasps = predicted(service, asked(scene))[1]["grasps"]
    few = predicted(service, asked(scene, num_grasps=2))[1]["grasps"]
    assert few == grasps[:2]
    least = grasps[len(grasps) // 2]["score"]
    assert predicted(service, asked(scene, min_score=least))[1]["grasps"] == [g for g in grasps if g["score"] >= least]
    none = predicted(service, asked(scene, min_score=1.1))
    assert none[0] == 200 and none[1]["grasps"] == []


def test_float64_says_the_same_and_so_does_an_equal_request(service, scene):
    first, second = (predicted(service, asked(scene))[1] for _ in range(2))
    assert first["grasps"] == second["grasps"] and first["meta"]["request_id"] == second["meta"]["request_id"]
    point_cloud, scene_points = (part.astype(np.float32).astype(np.float64) for part in scene[:2])
    double = {"point_cloud": encoded(point_cloud), "scene_points": encoded(scene_points)}
    assert predicted(service, double)[1]["grasps"] == first["grasps"]


def test_it_is_the_plan_of_the_same_clouds(service, scene):
    cloud, thing = (npy(part.astype(np.float32)) for part in (scene[1], scene[0]))
    request = {"cloud": file_of(cloud), "object": file_of(thing), "workspace_from_cloud": "table"}
    status, _, plan = service.plan(request)
    assert status == 200, plan
    plan = json.loads(plan)
    ours = sorted(plan["grasps"], key=lambda grasp: -grasp["quality"])[:20]
    theirs = predicted(service, asked(scene))[1]["grasps"]
    assert len(ours) == len(theirs) > 0
    for own, grasp in zip(ours, theirs, strict=True):
        pose = matrix(own["camera_from_grasp"])
        assert np.allclose(pose[:3, 3], grasp["translation"], atol=1e-6)
        assert np.isclose(own["quality"], grasp["score"]) and own["width_m"] == grasp["gripper_width"]
        # x of the contract's frame approaches and y closes; z and y do of ours.
        axes = np.column_stack([pose[:3, 2], pose[:3, 1], -pose[:3, 0]])
        assert np.allclose(axes, grasp["rotation_matrix"], atol=1e-5)


def test_clouds_in_another_frame_need_gravity_and_the_camera(service, scene):
    point_cloud, scene_points, workspace_from_camera = scene
    place = lambda points: points @ TURN[:3, :3].T + TURN[:3, 3]
    down = TURN[:3, :3] @ workspace_from_camera[:3, :3].T @ [0, 0, -2.0]
    moved = (place(point_cloud), place(scene_points), None)
    status, answer = predicted(service, asked(moved, np.float64, down=list(down), eye_m=list(TURN[:3, 3])))
    assert status == 200 and answer["grasps"], answer
    for grasp in answer["grasps"]:
        assert np.linalg.norm(moved[0] - grasp["translation"], axis=1).min() < 0.045
        # No gripper comes from below the table.
        assert np.dot(grasp["approach_axis"], down) > 0


def test_frames_of_other_servers_are_the_same_grasps(service, scene, tmp_path):
    own = predicted(service, asked(scene))[1]["grasps"]
    # In the axes of each frame: approach, closing.
    frames = {"graspgenx": ([0, 0, 1], [1, 0, 0]), "tcp_z_approach": ([0, 0, 1], [0, 1, 0])}
    for name, (approach, jaw) in frames.items():
        (tmp_path / name).mkdir()
        with running(tmp_path / name, "--grasp-frame", name) as other:
            config = json.loads(other.ask("GET", "/config")[2])
            assert (config["approach_axis_local"], config["jaw_axis_local"]) == (approach, jaw)
            for mine, grasp in zip(own, predicted(other, asked(scene))[1]["grasps"], strict=True):
                rotation, same = np.array(grasp["rotation_matrix"]), np.array(mine["rotation_matrix"])
                assert grasp["translation"] == mine["translation"]
                assert np.allclose(rotation @ approach, same[:, 0], atol=1e-5)
                assert np.allclose(rotation @ jaw, same[:, 1], atol=1e-5)


def test_an_object_alone_floats_where_its_cloud_has_it(service, scene):
    """As clients of GraspGen send it, about its middle or not."""
    for points in (scene[0], scene[0] - scene[0].mean(axis=0)):
        status, answer = predicted(service, {"point_cloud": encoded(points.astype(np.float32))})
        assert status == 200 and "one object and no table under it" in answer["meta"]["warnings"][0], answer
        for grasp in answer["grasps"]:
            assert np.linalg.norm(points - grasp["translation"], axis=1).min() < 0.045


def test_what_is_wrong_is_named_in_the_contracts_words(service, scene):
    few, bad = np.zeros((3, 3), np.float32), np.full((64, 3), np.nan, np.float32)
    good = encoded(scene[0].astype(np.float32))
    cases = [
        ({"point_cloud": {**good, "dtype": "int32"}}, 400, "bad_dtype", "point_cloud"),
        ({"point_cloud": {**good, "data_b64": "?"}}, 400, "bad_base64", "point_cloud"),
        ({"point_cloud": {**good, "shape": [1, 3]}}, 400, "shape_dtype_mismatch", "point_cloud"),
        ({"point_cloud": {**good, "shape": [2**40, 2**40]}}, 400, "shape_dtype_mismatch", "point_cloud"),
        ({"point_cloud": encoded(few.reshape(1, 9))}, 400, "bad_shape", "[1, 9]"),
        ({"point_cloud": encoded(few[:0])}, 422, "invalid_geometry", ""),
        ({"point_cloud": encoded(few)}, 422, "invalid_geometry", "at least 32 points, got 3"),
        ({"point_cloud": encoded(bad)}, 422, "invalid_geometry", "must be finite"),
        ({"point_cloud": good, "scene_points": encoded(bad)}, 422, "invalid_geometry", "scene_points[0]"),
        (asked((scene[0] - scene[0].mean(axis=0), scene[1], None)), 422, "invalid_geometry", "none of the object's points lies in the scene"),
        (asked(scene, down=[0, 0, 0]), 422, "invalid_geometry", "down"),
        (asked((scene[0] + 1e4, scene[1] + 1e4, None), np.float64, eye_m=[1e4] * 3), 422, "invalid_geometry", "within 100 m of the origin"),
        (asked(scene, eye_m=[1e4] * 3), 422, "invalid_geometry", "got [10000, 10000, 10000]: point_cloud, eye_m"),
        (asked(scene, num_grasps=0), 422, "invalid_request", "1 or more, got 0: num_grasps"),
        (asked(scene, num_grasps="many"), 422, "invalid_request", "num_grasps"),
        ({}, 422, "invalid_request", "missing field `point_cloud`"),
        ({"point_cloud": encoded(np.zeros((1_000_001, 3), np.float32))}, 413, "payload_too_large", "1000000"),
    ]
    for request, wanted, word, text in cases:
        status, answer = predicted(service, request)
        detail = answer["detail"]
        assert (status, detail["error"]) == (wanted, word) and text in detail["message"], answer
    for body, headers, wanted in [(b"{", JSON, 422), (b"{}", {}, 415)]:
        status, _, answer = service.ask("POST", "/predict", body, headers)
        assert status == wanted and json.loads(answer)["detail"]["error"] == "invalid_request", answer
    status, _, answer = service.ask("GET", "/predict")
    assert status == 405 and "Allow" in json.loads(answer)["detail"]["message"]
