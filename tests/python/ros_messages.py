"""Stubs of the ROS modules that the node imports, with the fields and types of their messages."""

import re
import types
from pathlib import Path

INTERFACES = Path(__file__).parents[2] / "ros2" / "graspmill_interfaces"


class Message:
    """A message with these fields, which hold values of their types, as rclpy's do; nested messages are made."""

    kinds = {}

    def __init__(self, **values):
        for name, kind in self.kinds.items():
            setattr(self, name, values.pop(name) if name in values else kind())
        assert not values, f"{type(self).__name__} has no {values.keys()}"

    def __setattr__(self, name, value):
        assert name in self.kinds, f"{type(self).__name__} has no {name}"
        kind = self.kinds[name]
        assert isinstance(value, kind) and not (kind is int and isinstance(value, bool)), f"{type(self).__name__}.{name}: {value!r}"
        super().__setattr__(name, value)


def message(title, /, **kinds):
    return type(title, (Message,), {"kinds": kinds})


Time = message("Time", sec=int, nanosec=int)
Header = message("Header", stamp=Time, frame_id=str)
Point, Vector3 = (message(name, **dict.fromkeys("xyz", float)) for name in ("Point", "Vector3"))
Quaternion = message("Quaternion", **dict.fromkeys("xyzw", float))
Pose = message("Pose", position=Point, orientation=Quaternion)
PoseArray = message("PoseArray", header=Header, poses=list)
Transform = message("Transform", translation=Vector3, rotation=Quaternion)
TransformStamped = message("TransformStamped", header=Header, child_frame_id=str, transform=Transform)
Image = message("Image", header=Header, height=int, width=int, encoding=str, is_bigendian=int, step=int, data=bytes)
CameraInfo = message("CameraInfo", header=Header, height=int, width=int, d=list, k=list, r=list, p=list)
PointField = message("PointField", name=str, offset=int, datatype=int, count=int)
PointCloud2 = message(
    "PointCloud2", header=Header, height=int, width=int, fields=list, is_bigendian=bool, point_step=int, row_step=int, data=bytes
)
ColorRGBA = message("ColorRGBA", **dict.fromkeys("rgba", float))
Marker = message("Marker", header=Header, ns=str, type=int, action=int, pose=Pose, scale=Vector3, points=list, colors=list)
Marker.LINE_LIST, Marker.ADD, Marker.DELETE = 5, 0, 2
MarkerArray = message("MarkerArray", markers=list)
Answered = message("Trigger_Response", success=bool, message=str)
ErrorCodes = message("MoveItErrorCodes", val=int)
ErrorCodes.SUCCESS, ErrorCodes.FAILURE, ErrorCodes.PLANNING_FAILED = 1, 99999, -1
Stamped = message("PoseStamped", header=Header, pose=Pose)
MoveItGrasp = message("Grasp", id=str, grasp_pose=Stamped, grasp_quality=float)
Grasps = message("GraspPlanning_Response", grasps=list, error_code=ErrorCodes)

_TYPES = {"float64": float, "int32": int, "uint32": int, "string": str, "geometry_msgs/Pose": Pose, "std_msgs/Header": Header}


def interface(name, text, known):
    """The message of a definition of ``graspmill_interfaces``."""
    rows = [line.split("#")[0].split() for line in text.splitlines()]
    return message(name, **{field: list if kind.endswith("[]") else known[kind] for kind, field in filter(None, rows)})


def interfaces():
    known, made = dict(_TYPES), {}
    for name in ("RankedGrasp", "RankedGrasps"):
        made[name] = known[f"graspmill_interfaces/{name}"] = interface(name, (INTERFACES / "msg" / f"{name}.msg").read_text(), known)
    parts = re.split(r"^---$", (INTERFACES / "action/PlanGrasps.action").read_text(), flags=re.MULTILINE)
    kinds = {part: interface(part, text, known) for part, text in zip(("Goal", "Result", "Feedback"), parts, strict=True)}
    return made | {"PlanGrasps": types.SimpleNamespace(**kinds)}


class TransformException(Exception):
    """What tf2_ros raises."""


class Robot:
    """What surrounds the node: its parameters, its time, TF; and what it offers, publishes and logs."""

    def __init__(self, **parameters):
        self.parameters, self.now_s, self.transform = parameters, 100.0, None
        self.subscriptions, self.published, self.services, self.timers, self.logged, self.asked = {}, {}, {}, [], [], []

    def send(self, topic, value):
        kind, callback = self.subscriptions[topic]
        assert isinstance(value, kind)
        callback(value)

    def call(self, name, response):
        return self.services[name](None, response)

    def plan(self):
        return self.call("plan_now", Answered())

    def modules(self, moveit=False):
        robot, made, space = self, interfaces(), types.SimpleNamespace

        class Node:
            def __init__(self, name):
                self.name = name

            def declare_parameter(self, name, value):
                given = robot.parameters.get(name, value)
                assert type(given) is type(value), f"{name} is a {type(value).__name__}, got {given!r}"
                return space(value=given)

            def create_publisher(self, kind, topic, depth):
                robot.published[topic] = []

                def publish(value):
                    assert type(value) is kind, topic
                    robot.published[topic].append(value)

                return space(publish=publish)

            def create_subscription(self, kind, topic, callback, qos):
                robot.subscriptions[topic] = (kind, callback)

            def create_service(self, kind, name, callback, callback_group):
                robot.services[name] = callback

            def create_timer(self, period_s, callback, callback_group):
                robot.timers.append((period_s, callback))

            def resolve_topic_name(self, topic):
                return f"/{topic}"

            def get_clock(self):
                return space(now=lambda: space(nanoseconds=round(robot.now_s * 1e9)))

            def get_logger(self):
                return space(info=lambda text: None, warning=lambda text, throttle_duration_sec=0.0: robot.logged.append(text))

        class Buffer:
            def lookup_transform(self, target, source, at, timeout):
                robot.asked.append((target, source, at, timeout))
                if isinstance(robot.transform, Exception):
                    raise robot.transform
                return robot.transform

        def action_server(node, kind, name, callback, callback_group):
            robot.services[name] = callback

        modules = {
            "rclpy": space(),
            "rclpy.action": space(ActionServer=action_server),
            "rclpy.callback_groups": space(MutuallyExclusiveCallbackGroup=object),
            "rclpy.duration": space(Duration=lambda seconds: seconds),
            "rclpy.executors": space(ExternalShutdownException=Exception, MultiThreadedExecutor=None),
            "rclpy.node": space(Node=Node),
            "rclpy.qos": space(qos_profile_sensor_data=None),
            "rclpy.time": space(Time=space(from_msg=lambda stamp: stamp.sec + 1e-9 * stamp.nanosec)),
            "tf2_ros": space(Buffer=Buffer, TransformListener=lambda buffer, node: None, TransformException=TransformException),
            "rosidl_runtime_py": space(set_message_fields=set_fields),
        }
        groups = {
            "geometry_msgs.msg": (Point, Pose, PoseArray, Quaternion),
            "sensor_msgs.msg": (CameraInfo, Image, PointCloud2),
            "std_msgs.msg": (ColorRGBA, Header),
            "visualization_msgs.msg": (Marker, MarkerArray),
        }
        modules |= {name: space(**{kind.__name__: kind for kind in kinds}) for name, kinds in groups.items()}
        modules["std_srvs.srv"] = space(Trigger=object)
        modules["graspmill_interfaces.msg"] = modules["graspmill_interfaces.action"] = space(**made)
        if moveit:
            modules["moveit_msgs.srv"] = space(GraspPlanning=object)
            modules["moveit_msgs.msg"] = space(Grasp=MoveItGrasp, MoveItErrorCodes=ErrorCodes)
        tops = {name.partition(".")[0] for name in modules}
        none = {} if moveit else {"moveit_msgs": None, "moveit_msgs.srv": None}  # None: the import fails
        return {name: types.ModuleType(name) for name in tops} | modules | none


def set_fields(message, values):
    """As rosidl_runtime_py's; the fields of a Grasp that the stub lacks are passed over."""
    for name, value in values.items():
        if isinstance(value, dict) and name in message.kinds:
            set_fields(getattr(message, name), value)
        elif name in message.kinds:
            setattr(message, name, value)
