"""The ROS 2 node of docs/, with mocks of the ROS modules that it uses.

    python -m pytest tests/python/test_ros2_node.py   # GRASPMILL_PLANNER=path/to/planner, or target/debug/planner
"""

import json
import socket
import struct
import sys
import tomllib
import types
import zlib

import numpy as np
import pytest

from planner_service import DEMO, ROOT, file_of, npy, running

NODE = ROOT / "docs" / "ros2_planner_node.py"


class Message(types.SimpleNamespace):
    """A message with these fields; missing nested messages are created, as in ROS."""

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
    """Runs the node on one depth image; returns what it published. A transform is that of its base frame."""
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
            given = {"url": f"http://127.0.0.1:{service.port}/v1/plan", "base_frame": "base" if transform else value}
            return types.SimpleNamespace(value=given[name])

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
    assert asked == ([("base", "camera_depth_optical_frame", ("time of", {"sec": 3}))] if transform else [])
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
def service(tmp_path_factory):
    with running(tmp_path_factory.mktemp("ros")) as service:
        yield service


@pytest.mark.parametrize("base", [False, True], ids=["upright", "base"])
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1", "32FC1 big-endian"])
def test_the_ros_node_publishes_what_the_service_answers(service, encoding, base, one_demo_view, monkeypatch):
    depth_m, lens, pose = one_demo_view
    name = encoding.split()[0]
    if name == "16UC1":
        depth = np.rint(depth_m * 1000).astype("<u2")
    else:
        depth = depth_m.astype(">f4" if "big" in encoding else "<f4")
    request = {"views": [{"depth": file_of(npy(depth)), "intrinsics": lens, "workspace_from_camera": "table"}]}
    status, _, body = service.plan(request | ({"base_from_camera": pose} if base else {}))
    assert status == 200, body
    transform = (pose["position_m"], pose["quaternion_xyzw"]) if base else None
    [array], warnings = ros(depth, name, lens, transform, service, monkeypatch)
    assert warnings == [] and array.header.frame_id == "camera_depth_optical_frame" and array.header.stamp == {"sec": 3}
    expected = [grasp["camera_from_grasp"] for grasp in json.loads(body)["grasps"]]
    assert expected, "nothing was planned, so nothing is compared"
    published = [(list(vars(pose.position).values()), list(vars(pose.orientation).values())) for pose in array.poses]
    assert published == [(pose["position_m"], pose["quaternion_xyzw"]) for pose in expected]


def test_the_ros_node_goes_on_without_a_service(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        gone = types.SimpleNamespace(port=nobody.getsockname()[1])
    depth = np.full((4, 5), 0.5, np.float32)
    info = {"fx_px": 5.0, "fy_px": 5.0, "cx_px": 2.0, "cy_px": 1.5}
    published, warnings = ros(depth, "32FC1", info, None, gone, monkeypatch)
    assert published == [] and len(warnings) == 1 and warnings[0].startswith("no plan: ")


def test_the_ros_node_is_short():
    assert len(NODE.read_text().splitlines()) <= 40
