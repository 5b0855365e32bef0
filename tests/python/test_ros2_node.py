"""The ROS 2 package, with stubs of the ROS modules that it imports."""

import base64
import importlib
import io
import json
import socket
import sys
import tomllib
import types
from xml.etree import ElementTree

import numpy as np
import pytest

import ros_messages as ros
from planner_service import ROOT, demo_view, file_of, npy

PACKAGE = ROOT / "ros2" / "graspmill_ros"
sys.path.insert(0, str(PACKAGE))
from graspmill_ros import planning, sensing  # noqa: E402

POSE = {"position_m": [0.1, 0.2, 0.5], "quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]}


# Messages of a camera, and a node with a planner that answers what the test says


def stamped(at_s=99.9, frame_id="optical"):
    return ros.Header(stamp=ros.Time(sec=int(at_s), nanosec=round(at_s % 1 * 1e9)), frame_id=frame_id)


def image(depth, encoding="32FC1", pad=6, **more):
    """An image whose rows are padded, as some drivers do."""
    rows = b"".join(row.tobytes() + b"\xab" * pad for row in depth)
    height, width = depth.shape
    values = {"header": stamped(), "height": height, "width": width, "encoding": encoding, "step": width * depth.itemsize + pad}
    return ros.Image(**(values | {"data": rows, "is_bigendian": int(depth.dtype.byteorder == ">")} | more))


def info(depth, lens, **more):
    fx, fy, cx, cy = (lens[f"{name}_px"] for name in ("fx", "fy", "cx", "cy"))
    k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    return ros.CameraInfo(**({"header": stamped(), "height": depth.shape[0], "width": depth.shape[1], "k": k} | more))


def row(number=0, **more):
    values = {"camera_from_grasp": POSE, "base_from_grasp": None, "workspace_from_grasp": POSE, "quality": 0.9 - 0.1 * number}
    values |= {"width_m": 0.05, "robustness": None, "opening_m": 0.066, "object": None, "width_seen_share": 1.0}
    return values | dict.fromkeys(("workspace_from_flange", "base_from_flange")) | more


def answer(*rows, **more):
    told = {"format": "graspmill-plan/3", "gripper": "franka_hand", "flange_from_grasp": POSE, "workspace_from_camera": None}
    return told | {"grasps": list(rows), "reason": None, "warnings": []} | more


LENS = {"fx_px": 5.0, "fy_px": 5.0, "cx_px": 2.0, "cy_px": 1.5}
DEPTH = np.full((4, 5), 0.5, "<f4")


@pytest.fixture
def start(monkeypatch):
    """Starts a node in a robot with these parameters; its planner answers ``told`` and keeps what it was asked."""

    def started(told=None, moveit=False, **parameters):
        robot = ros.Robot(**parameters)
        for name, module in robot.modules(moveit).items():
            monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.delitem(sys.modules, "graspmill_ros.node", raising=False)
        robot.views, robot.node = [], importlib.import_module("graspmill_ros.node").PlannerNode()
        if told is not None:
            robot.node.ask = lambda view: robot.views.append(view) or told
        return robot

    return started


def sees(robot, depth=DEPTH, lens=LENS, **more):
    robot.send("camera_info", info(depth, lens))
    robot.send("depth", image(depth, **more))


def refused(match, call):
    with pytest.raises(sensing.RefusedError, match=match):
        call()


def pose_of(pose):
    return list(vars(pose.position).values()), list(vars(pose.orientation).values())


# What messages hold


@pytest.mark.parametrize("kind", ["<u2", ">u2", "<f4", ">f4"])
@pytest.mark.parametrize("pad", [0, 3, 6])
def test_depths_of_every_encoding_are_metres(kind, pad):
    depth = np.array([[0, 500, 1234], [65535, 1, 2]], kind)
    unit_m = 0.001 if kind.endswith("u2") else 1.0
    told = sensing.depth_m(image(depth, "16UC1" if kind.endswith("u2") else "32FC1", pad))
    np.testing.assert_array_equal(told, (depth.astype(np.float64) * unit_m).astype(np.float32))
    assert told.dtype == np.float32


def test_what_was_not_seen_is_zero():
    depth = np.array([[np.nan, np.inf, -1.0, 0.0, 0.7]], "<f4")
    np.testing.assert_array_equal(sensing.depth_m(image(depth)), np.array([[0, 0, 0, 0, 0.7]], np.float32))
    tenths = np.array([[5000]], "<u2")
    assert sensing.depth_m(image(tenths, "16UC1"), 0.0001) == np.float32(0.5)
    # The last row may lack its padding.
    np.testing.assert_array_equal(sensing.depth_m(image(DEPTH, data=image(DEPTH).data[:-6])), DEPTH)


def test_wrong_images_are_refused():
    refused("must be encoded as 16UC1, mono16, 32FC1, got 'rgb8'", lambda: sensing.depth_m(image(DEPTH, "rgb8")))
    refused("must have 4 rows of 26 bytes, got 97 bytes", lambda: sensing.depth_m(image(DEPTH, data=image(DEPTH).data[:-7])))
    refused("rows of 4 bytes each or more, got 5 x 4 pixels in rows of 19", lambda: sensing.depth_m(image(DEPTH, step=19)))
    refused("must have pixels", lambda: sensing.depth_m(image(DEPTH, height=0)))


def test_a_mask_has_the_images_size():
    mask = np.zeros((4, 5), np.uint8)
    mask[1, 2] = 255
    told = sensing.mask_of(image(mask, "mono8", 1), DEPTH)
    assert told.dtype == bool and np.argwhere(told).tolist() == [[1, 2]]
    refused("the mask must have the depth image's size, 5 x 4, got 4 x 5", lambda: sensing.mask_of(image(mask.T.copy(), "mono8"), DEPTH))
    refused("the mask must be encoded as mono8, 8UC1, got 'bgr8'", lambda: sensing.mask_of(image(mask, "bgr8"), DEPTH))


def test_intrinsics_are_those_of_the_rectified_image():
    assert sensing.intrinsics(info(DEPTH, LENS), DEPTH) == [5.0, 5.0, 2.0, 1.5]
    p = [4.0, 0.0, 2.1, 0.0, 0.0, 4.5, 1.4, 0.0, 0.0, 0.0, 1.0, 0.0]
    assert sensing.intrinsics(info(DEPTH, LENS, p=p), DEPTH) == [5.0, 5.0, 2.0, 1.5]
    assert sensing.intrinsics(info(DEPTH, LENS, p=p, d=[0.1, 0.0, 0.0, 0.0, 0.0]), DEPTH) == [4.0, 4.5, 2.1, 1.4]
    assert sensing.intrinsics(info(DEPTH, LENS, height=0, width=0), DEPTH)[0] == 5.0
    refused("a calibrated camera, whose k has focal lengths", lambda: sensing.intrinsics(info(DEPTH, LENS, k=[0.0] * 9), DEPTH))
    refused("the depth image's size, 5 x 4, got 10 x 8", lambda: sensing.intrinsics(info(DEPTH, LENS, width=10, height=8), DEPTH))


@pytest.mark.parametrize("is_big", [False, True])
def test_clouds_are_points_that_are_finite(is_big):
    points = np.array([[[1, 2, 3], [4, np.nan, 6]], [[7, 8, 9], [np.inf, 1, 2]]], ">f4" if is_big else "<f4")
    step, row_step = 20, 44
    at = {"names": [*"xyz"], "formats": [points.dtype] * 3, "offsets": [8, 4, 16], "itemsize": step}
    rows = np.zeros((2, 2), np.dtype(at))
    rows["x"], rows["y"], rows["z"] = np.moveaxis(points, 2, 0)
    data = b"".join(row.tobytes() + bytes(row_step - 2 * step) for row in rows)
    names = zip("xyz", (8, 4, 16))
    fields = [ros.PointField(name=name, offset=offset, datatype=7, count=1) for name, offset in names]
    values = {"height": 2, "width": 2, "fields": fields, "is_bigendian": is_big, "point_step": step, "row_step": row_step}
    cloud = ros.PointCloud2(**values, data=bytes(data))
    assert sensing.points_m(cloud).tolist() == [[1, 2, 3], [7, 8, 9]]
    refused("must have 2 rows of 44 bytes, got 60 bytes", lambda: sensing.points_m(ros.PointCloud2(**values, data=bytes(60))))
    without = values | {"fields": fields[:2]}
    refused("must have x, y and z as FLOAT32, got the fields x, y", lambda: sensing.points_m(ros.PointCloud2(**without, data=bytes(data))))


def transform(position, turn, at_s=99.9):
    moved = ros.Transform(translation=ros.Vector3(**dict(zip("xyz", position))), rotation=ros.Quaternion(**dict(zip("xyzw", turn))))
    return ros.TransformStamped(header=stamped(at_s, "base"), transform=moved)


def test_a_pose_is_that_of_its_image():
    still = transform([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0005], at_s=0.0)
    assert sensing.base_from_camera(still, 99.9, 0.05) == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0], "a static one has no stamp"
    late = transform([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0], at_s=98.9)
    refused("must be within 0.05 s of the image, got one 1.000 s apart", lambda: sensing.base_from_camera(late, 99.9, 0.05))
    for turn in ([0.0, 0.0, 0.0, 0.0], [0.0, 0.0, np.nan, 1.0]):
        refused("a quaternion of length 1", lambda turn=turn: sensing.base_from_camera(transform([0.0] * 3, turn), 99.9, 0.05))


def test_a_matrix_turns_as_its_quaternion():
    half = np.sqrt(0.5)
    told = sensing.matrix([1.0, 2.0, 3.0, 0.0, 0.0, half, half])  # a quarter turn about z
    np.testing.assert_allclose(told, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-15)


# Parameters and rows


def test_the_shipped_parameters_are_the_defaults():
    yaml = pytest.importorskip("yaml", reason="yaml is not installed")
    shipped = yaml.safe_load((PACKAGE / "config/params.yaml").read_text())
    assert shipped == {"graspmill_planner": {"ros__parameters": planning.DEFAULTS}}
    assert [type(one) for one in shipped["graspmill_planner"]["ros__parameters"].values()] == [type(one) for one in planning.DEFAULTS.values()]


def test_the_packages_have_the_projects_version_and_all_their_files():
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    for name in ("graspmill_interfaces", "graspmill_ros"):
        assert ElementTree.parse(PACKAGE.parent / name / "package.xml").findtext("version") == version, name
    setup = (PACKAGE / "setup.py").read_text()
    assert f'version="{version}"' in setup
    named = [PACKAGE / path for path in ("package.xml", "launch/planner.launch.py", "config/params.yaml", "resource/graspmill_ros")]
    assert all(path.exists() and path.name in setup.replace("{NAME}", "graspmill_ros") for path in named)


@pytest.mark.parametrize("parameters", [{"use_mask": True}, {"use_cloud": True}], ids=["depth", "cloud"])
def test_the_launch_file_maps_every_topic_that_the_node_takes(start, monkeypatch, parameters):
    robot, started_with = start(answer(), **parameters), []
    same = types.SimpleNamespace(
        LaunchDescription=list,
        DeclareLaunchArgument=lambda name, default_value: name,
        LaunchConfiguration=lambda name: name,
        Node=lambda **given: started_with.append(given),
        get_package_share_directory=lambda name: str(PACKAGE),
    )
    names = "ament_index_python ament_index_python.packages launch launch.actions launch.substitutions launch_ros launch_ros.actions"
    for name in names.split():
        monkeypatch.setitem(sys.modules, name, same)
    scope = {"__name__": "planner.launch"}
    exec((PACKAGE / "launch/planner.launch.py").read_text(), scope)  # noqa: S102
    *arguments, _ = scope["generate_launch_description"]()
    mapped = dict(started_with[0]["remappings"])
    assert robot.subscriptions.keys() <= mapped.keys() and arguments == [*mapped, "params"]
    assert started_with[0]["executable"] == "planner" and '"planner = {NAME}.node:main"' in (PACKAGE / "setup.py").read_text().replace('f"', '"')


def test_wrong_parameters_are_all_named():
    values = planning.DEFAULTS | {"url": "localhost", "grasps_max": 0, "crop_px": [1, 2], "use_cloud": True, "use_mask": True}
    for text in ("url must begin with http", "grasps_max must be at least 1, got 0", "crop_px must be 4 numbers, got 2", "got use_cloud"):
        refused(text, lambda: planning.settings_of(values))
    region = planning.DEFAULTS | {"region_m": [0.0, 0.0, 0.0, 1.0, 0.0, 1.0]}
    refused("region_m must be a lower and an upper corner", lambda: planning.settings_of(region))


def test_a_crop_is_what_counts_as_seen():
    kept = sensing.cropped(DEPTH, (1, 0, 3, 2))
    assert kept[0:2, 1:3].all() and np.count_nonzero(kept) == 4 and DEPTH.all()
    refused("crop_px must be x0, y0, x1, y1 within 5 x 4, got", lambda: sensing.cropped(DEPTH, (0, 0, 6, 4)))


def test_grasps_outside_the_region_are_passed_over():
    far = POSE | {"position_m": [0.9, 0.2, 0.5]}
    told = answer(row(0, camera_from_grasp=far), row(1), row(2))
    settings = planning.settings_of(planning.DEFAULTS | {"region_m": [0.0, 0.0, 0.0, 0.5, 0.5, 0.5]})
    assert [one.number for one in planning.ranked(told, settings)] == [1, 2]
    assert [one.number for one in planning.ranked(told, settings, 1)] == [1]
    nothing = answer(row(0, camera_from_grasp=far))
    assert planning.reason(nothing, planning.ranked(nothing, settings)) == "none of 1 grasps is within region_m"
    refused("the plan's grasps must have camera_from_grasp", lambda: planning.ranked(answer({"quality": 1}), settings))


def test_a_fork_has_its_tips_as_far_apart_as_the_gripper_opens():
    [one] = planning.ranked(answer(row()), planning.Settings())
    lines = planning.fork(one)  # the gripper is turned by a half turn about x: z down, y back
    np.testing.assert_allclose(lines[:2, 0], [[0.1, 0.233, 0.5], [0.1, 0.167, 0.5]], atol=1e-12)
    np.testing.assert_allclose(lines[3], [[0.1, 0.2, 0.54], [0.1, 0.2, 0.58]], atol=1e-12)


# The node


def test_a_plan_becomes_messages(start):
    robot = start(answer(row(0, object=3), row(1, width_m=None, robustness=0.7), warnings=["a border"]))
    sees(robot)
    told = robot.plan()
    assert (told.success, told.message) == (True, "2 grasps, the best 0.900")
    [poses], [ranked], [markers] = (robot.published[name] for name in ("grasps", "ranked_grasps", "markers"))
    for header in (poses.header, ranked.header, markers.markers[0].header):
        assert (header.frame_id, header.stamp.sec, header.stamp.nanosec) == ("optical", 99, 900000000)
    assert [pose_of(pose) for pose in poses.poses] == [(POSE["position_m"], POSE["quaternion_xyzw"])] * 2
    first, second = ranked.grasps
    assert (first.quality, first.width_m, first.opening_m, first.object) == (0.9, 0.05, 0.066, 3) and np.isnan(first.robustness)
    assert (second.quality, second.robustness, second.object) == (0.8, 0.7, -1) and np.isnan(second.width_m)
    assert robot.logged == ranked.warnings == ["a border"] and ranked.reason == ""
    marker = markers.markers[0]
    assert len(marker.points) == len(marker.colors) == 16 and marker.type == ros.Marker.LINE_LIST


def test_no_grasp_is_an_answer(start):
    robot = start(answer(reason="no grasp has a quality of 0.5 or more"))
    sees(robot)
    told = robot.plan()
    assert not told.success and told.message == "no grasp has a quality of 0.5 or more"
    assert robot.published["grasps"][0].poses == [] and robot.published["ranked_grasps"][0].reason == told.message
    assert robot.published["markers"][0].markers[0].action == ros.Marker.DELETE


class Goal:
    def __init__(self, grasps_max=0):
        self.request, self.states, self.stages = types.SimpleNamespace(grasps_max=grasps_max), [], []
        self.succeed, self.abort = (lambda name=name: self.states.append(name) for name in ("succeed", "abort"))

    def publish_feedback(self, feedback):
        self.stages.append(feedback.stage)


def test_the_action_has_the_grasps_as_its_result(start):
    robot = start(answer(row(0), row(1), row(2)))
    act = robot.services["plan_grasps"]
    result = act(goal := Goal())
    assert goal.states == ["abort"] and result.ranked.reason == "a message on /depth must have come, got none"
    sees(robot)
    result = act(goal := Goal(2))
    assert goal.states == ["succeed"] and goal.stages == ["reading", "planning"]
    assert [one.quality for one in result.ranked.grasps] == [0.9, 0.8]


def test_moveit_gets_grasps_where_it_is_installed(start):
    pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
    robot = start(answer(row(0), row(1)), moveit=True)
    assert robot.call("plan_for_moveit", ros.Grasps()).error_code.val == ros.ErrorCodes.FAILURE
    sees(robot)
    told = robot.call("plan_for_moveit", ros.Grasps())
    assert told.error_code.val == ros.ErrorCodes.SUCCESS and [one.id for one in told.grasps] == ["grasp_0", "grasp_1"]
    header = told.grasps[0].grasp_pose.header
    assert (header.frame_id, header.stamp.sec, told.grasps[0].grasp_quality) == ("optical", 99, 0.9)
    assert "plan_for_moveit" not in start(answer()).services


def test_a_rate_plans_on_new_images_only(start):
    robot = start(answer(row()), rate_hz=4.0)
    [(period_s, tick)] = robot.timers
    tick()
    assert period_s == 0.25 and robot.logged == ["a message on /depth must have come, got none"]
    sees(robot)
    tick()
    tick()
    assert len(robot.views) == 1
    sees(robot, header=stamped(99.95))
    tick()
    assert len(robot.views) == 2


def test_the_cameras_pose_is_that_at_the_stamp(start):
    robot = start(answer(row(base_from_grasp=POSE | {"position_m": [0.6, 0.0, 0.1]})), base_frame="base")
    robot.transform = transform([1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0])
    sees(robot)
    assert robot.plan().success
    assert robot.asked == [("base", "optical", pytest.approx(99.9), 0.2)]
    assert robot.views[0].base_from_camera == [1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]
    [poses] = robot.published["grasps"]
    assert poses.header.frame_id == "base" and pose_of(poses.poses[0])[0] == [0.6, 0.0, 0.1]


@pytest.mark.parametrize(("change", "match"), [
    ({"transform": ros.TransformException("extrapolation into the future")}, "TF must have optical in base at the image's 99.900 s, got extrap"),
    ({"transform": transform([0.0] * 3, [0.0, 0.0, 0.0, 1.0], at_s=95.0)}, "must be within 0.05 s of the image, got one 4.900 s apart"),
    ({"now_s": 105.0}, "the newest depth must be at most 1 s old, got 5.1 s"),
])  # fmt: skip
def test_old_images_and_poses_are_refused_and_the_node_goes_on(start, change, match):
    robot = start(answer(row(base_from_grasp=POSE)), base_frame="base")
    fresh = {"transform": transform([0.0] * 3, [0.0, 0.0, 0.0, 1.0]), "now_s": 100.0}
    sees(robot)
    for name, value in (fresh | change).items():
        setattr(robot, name, value)
    told = robot.plan()
    assert not told.success and match in told.message and robot.published["grasps"] == []
    for name, value in fresh.items():
        setattr(robot, name, value)
    assert robot.plan().success


def test_an_image_without_a_stamp_has_no_pose(start):
    robot = start(answer(), base_frame="base", image_age_s_max=0.0)
    sees(robot, header=stamped(0.0))
    assert robot.plan().message == "the image must have a stamp for the camera's pose, got 0"


def test_a_mask_goes_with_its_image(start):
    robot = start(answer(row()), use_mask=True)
    sees(robot)
    assert robot.plan().message == "a message on /mask must have come, got none"
    mask = np.eye(4, 5, dtype=np.uint8)
    robot.send("mask", image(mask, "mono8", header=stamped(95.0)))
    assert "the mask must be within 1 s of the image, got 4.9 s" in robot.plan().message
    robot.send("mask", image(mask[:3], "mono8"))
    assert "got 5 x 3" in robot.plan().message
    robot.send("mask", image(mask, "mono8"))
    assert robot.plan().success
    np.testing.assert_array_equal(robot.views[0].mask, mask != 0)
    data = base64.b64decode(planning.request(robot.views[0])["views"][0]["mask"]["data"])
    np.testing.assert_array_equal(np.load(io.BytesIO(data)), mask != 0)
    assert planning.request(robot.views[0], each=True)["each"] is True and "each" not in planning.request(robot.views[0])


# The planner


def test_a_planner_that_is_away_is_named_and_the_node_goes_on(start):
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        port = nobody.getsockname()[1]
    robot = start(url=f"http://127.0.0.1:{port}")
    sees(robot)
    told = robot.plan()
    assert not told.success and told.message.startswith(f"the planner at http://127.0.0.1:{port}/v1/plan must answer (graspmill serve starts one)")
    robot.node.ask = lambda view: answer(row())
    assert robot.plan().success


def test_planning_in_this_process(start):
    from grasp_sets import BOXED, CAMERA as camera, graspmill

    depth = BOXED.render(camera)
    want = graspmill.Planner().plan(depth, graspmill.Camera(640, 480, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px))
    robot = start(url="", grasps_max=5)
    sees(robot, depth, vars(camera))
    assert robot.plan().success
    rows = want.answer["grasps"][:5]
    assert [pose_of(pose)[0] for pose in robot.published["grasps"][0].poses] == [row["camera_from_grasp"]["position_m"] for row in rows]
    refused("the planner cannot be made: ", lambda: planning.in_process(planning.Settings(url="", config="nothing")))


@pytest.mark.parametrize("base", [False, True], ids=["upright", "base"])
def test_the_node_publishes_what_the_service_answers(service, base, start):
    depth_m, lens, pose = demo_view()
    request = {"views": [{"depth": file_of(npy(depth_m)), "intrinsics": lens, "workspace_from_camera": "table"}]}
    status, _, body = service.plan(request | ({"base_from_camera": pose} if base else {}))
    assert status == 200, body
    robot = start(url=f"http://127.0.0.1:{service.port}", base_frame="base" if base else "", grasps_max=10_000)
    robot.transform = transform(pose["position_m"], pose["quaternion_xyzw"])
    sees(robot, depth_m, lens)
    assert robot.plan().success
    expected = [grasp["base_from_grasp" if base else "camera_from_grasp"] for grasp in json.loads(body)["grasps"]]
    assert expected, "nothing was planned, so nothing is compared"
    [array] = robot.published["grasps"]
    assert [pose_of(pose) for pose in array.poses] == [(pose["position_m"], pose["quaternion_xyzw"]) for pose in expected]


def test_what_the_service_refuses_is_told(service):
    ask = planning.service(planning.Settings(url=f"http://127.0.0.1:{service.port}/v1/plan"))
    refused("answered 422: .*intrinsics", lambda: ask(planning.View(DEPTH, [-1.0, 5.0, 2.0, 1.5])))
    other = planning.service(planning.Settings(url=f"http://127.0.0.1:{service.port}", gripper="franka_hand"))
    view = planning.View(np.full((48, 64), 0.55, np.float32), [80.0, 80.0, 31.5, 23.5])
    refused("must plan for franka_hand, got parallel_jaw_80", lambda: other(view))
