"""The node: a depth image or a cloud, and the camera's pose by TF, to ranked grasps. README.md lists what it offers."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from typing import Any, Callable

import rclpy
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from graspmill_interfaces.action import PlanGrasps
from graspmill_interfaces.msg import RankedGrasp, RankedGrasps
from rclpy.action import ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import ColorRGBA, Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from . import planning, sensing
from .planning import Answer, Ranked, View
from .sensing import RefusedError

#: Seconds between two warnings of plans at a rate.
WARN_EVERY_S = 5.0
#: Width of a marker's lines, in metres.
LINE_M = 0.003


@dataclass(frozen=True)
class Made:
    """A plan that was published."""

    header: Header
    answer: Answer
    rows: list[Ranked]
    reason: str


class PlannerNode(Node):
    """Plans on the newest image when it is asked, or at a rate."""

    def __init__(self) -> None:
        super().__init__("graspmill_planner")
        values = {name: self.declare_parameter(name, default).value for name, default in planning.DEFAULTS.items()}
        self.settings = planning.settings_of(values)
        self.ask = planning.service(self.settings) if self.settings.url else planning.in_process(self.settings)
        self.newest: dict[str, Any] = {}
        self.planned_s = -1.0
        self.planning = threading.Lock()
        self._listen()
        self._offer()

    def _listen(self) -> None:
        kinds = {"cloud": PointCloud2} if self.settings.use_cloud else {"depth": Image, "camera_info": CameraInfo}
        kinds |= {"mask": Image} if self.settings.use_mask else {}
        for topic, kind in kinds.items():
            self.create_subscription(kind, topic, self._keeper(topic), qos_profile_sensor_data)
        if self.settings.base_frame:
            import tf2_ros

            self.tf = tf2_ros.Buffer()
            self.tf_error = tf2_ros.TransformException
            self.listener = tf2_ros.TransformListener(self.tf, self)

    def _keeper(self, topic: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            self.newest[topic] = message

        return keep

    def _offer(self) -> None:
        self.poses = self.create_publisher(PoseArray, "grasps", 1)
        self.ranked = self.create_publisher(RankedGrasps, "ranked_grasps", 1)
        self.markers = self.create_publisher(MarkerArray, "markers", 1)
        apart = MutuallyExclusiveCallbackGroup()  # images and TF arrive while a plan is made
        self.create_service(Trigger, "plan_now", self._on_trigger, callback_group=apart)
        self.action = ActionServer(self, PlanGrasps, "plan_grasps", self._on_goal, callback_group=apart)
        try:
            from moveit_msgs.srv import GraspPlanning

            import graspmill  # noqa: F401
        except ImportError as error:
            self.get_logger().info(f"no plan_for_moveit: {error}")
        else:
            self.create_service(GraspPlanning, "plan_for_moveit", self._on_moveit, callback_group=apart)
        if self.settings.rate_hz > 0.0:
            self.create_timer(1.0 / self.settings.rate_hz, self._on_timer, callback_group=apart)

    # What was seen

    def _source(self) -> Any:
        """The newest image or cloud, if it is new enough."""
        topic = "cloud" if self.settings.use_cloud else "depth"
        if (source := self.newest.get(topic)) is None:
            raise RefusedError(f"a message on {self.resolve_topic_name(topic)} must have come, got none")
        age_s = 1e-9 * self.get_clock().now().nanoseconds - sensing.stamp_s(source.header.stamp)
        if 0.0 < self.settings.image_age_s_max < age_s:
            raise RefusedError(f"the newest {topic} must be at most {self.settings.image_age_s_max:g} s old, got {age_s:.1f} s")
        return source

    def _view(self, source: Any) -> View:
        view = self._cloud_view(source) if self.settings.use_cloud else self._depth_view(source)
        return replace(view, base_from_camera=self._pose(source.header)) if self.settings.base_frame else view

    def _cloud_view(self, cloud: Any) -> View:
        return View(points_m=sensing.points_m(cloud))

    def _depth_view(self, image: Any) -> View:
        if (info := self.newest.get("camera_info")) is None:
            raise RefusedError(f"a message on {self.resolve_topic_name('camera_info')} must have come, got none")
        depth = sensing.depth_m(image, self.settings.depth_unit_m)
        crop_px: Any = self.settings.crop_px
        mask = self._mask(image, depth) if self.settings.use_mask else None
        return View(sensing.cropped(depth, crop_px), sensing.intrinsics(info, depth), mask)

    def _mask(self, image: Any, depth: sensing.Floats) -> Any:
        if (mask := self.newest.get("mask")) is None:
            raise RefusedError(f"a message on {self.resolve_topic_name('mask')} must have come, got none")
        apart_s = abs(sensing.stamp_s(mask.header.stamp) - sensing.stamp_s(image.header.stamp))
        if 0.0 < self.settings.image_age_s_max < apart_s:
            raise RefusedError(f"the mask must be within {self.settings.image_age_s_max:g} s of the image, got {apart_s:.1f} s")
        return sensing.mask_of(mask, depth)

    def _pose(self, header: Any) -> list[float]:
        base, at_s = self.settings.base_frame, sensing.stamp_s(header.stamp)
        if at_s == 0.0:
            raise RefusedError("the image must have a stamp for the camera's pose, got 0")
        try:
            wait = Duration(seconds=self.settings.tf_wait_s)
            found = self.tf.lookup_transform(base, header.frame_id, Time.from_msg(header.stamp), timeout=wait)
        except self.tf_error as error:
            raise RefusedError(f"TF must have {header.frame_id} in {base} at the image's {at_s:.3f} s, got {error}") from error
        return sensing.base_from_camera(found, at_s, self.settings.tf_off_s_max)

    # Plans

    def plan(self, grasps_max: int = 0, said: Callable[[str], None] = lambda stage: None) -> Made:
        """Plans on the newest image and publishes the grasps.

        Raises:
            RefusedError: If there is no image, or no plan of it; the text says why.
        """
        with self.planning:
            said("reading")
            source = self._source()
            view = self._view(source)
            said("planning")
            answer = self.ask(view)
            rows = planning.ranked(answer, self.settings, grasps_max)
            frame = self.settings.base_frame or source.header.frame_id
            made = Made(Header(stamp=source.header.stamp, frame_id=frame), answer, rows, planning.reason(answer, rows))
            self.planned_s = sensing.stamp_s(source.header.stamp)
            self._publish(made)
            return made

    def _publish(self, made: Made) -> None:
        self.poses.publish(PoseArray(header=made.header, poses=[_pose(row) for row in made.rows]))
        self.ranked.publish(_ranked(made))
        self.markers.publish(MarkerArray(markers=[_marker(made)]))
        for warning in made.answer.get("warnings", []):
            self.get_logger().warning(str(warning), throttle_duration_sec=WARN_EVERY_S)

    def _on_timer(self) -> None:
        try:
            if sensing.stamp_s(self._source().header.stamp) != self.planned_s:
                self.plan()
        except RefusedError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=WARN_EVERY_S)

    def _on_trigger(self, request: Any, response: Any) -> Any:
        try:
            made = self.plan()
        except RefusedError as error:
            response.success, response.message = False, str(error)
        else:
            best = f"{len(made.rows)} grasps, the best {made.rows[0].quality:.3f}" if made.rows else made.reason
            response.success, response.message = bool(made.rows), best
        return response

    def _on_goal(self, goal: Any) -> Any:
        """A plan without grasps succeeds; without a plan the goal is aborted, and ``reason`` says why."""

        def said(stage: str) -> None:
            goal.publish_feedback(PlanGrasps.Feedback(stage=stage))

        try:
            made = self.plan(goal.request.grasps_max, said)
        except RefusedError as error:
            goal.abort()
            return PlanGrasps.Result(ranked=RankedGrasps(reason=str(error)))
        goal.succeed()
        return PlanGrasps.Result(ranked=_ranked(made))

    def _on_moveit(self, request: Any, response: Any) -> Any:
        from moveit_msgs.msg import Grasp, MoveItErrorCodes
        from rosidl_runtime_py import set_message_fields

        try:
            made = self.plan()
            told = planning.moveit_grasps(made.answer, made.rows, self.settings, made.header.frame_id)
        except RefusedError as error:
            self.get_logger().warning(str(error))
            response.error_code.val = MoveItErrorCodes.FAILURE
            return response
        for fields in told:
            grasp = Grasp()
            set_message_fields(grasp, fields)
            grasp.grasp_pose.header.stamp = made.header.stamp
            response.grasps.append(grasp)
        response.error_code.val = MoveItErrorCodes.SUCCESS if told else MoveItErrorCodes.PLANNING_FAILED
        return response


# Messages


def _pose(row: Ranked) -> Pose:
    x, y, z, *turn = row.pose
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(**dict(zip("xyzw", turn))))


def _ranked(made: Made) -> RankedGrasps:
    names = ("quality", "robustness", "width_m", "opening_m", "object")
    grasps = [RankedGrasp(pose=_pose(row), **{name: getattr(row, name) for name in names}) for row in made.rows]
    warnings = [str(one) for one in made.answer.get("warnings", [])]
    return RankedGrasps(header=made.header, grasps=grasps, reason=made.reason, warnings=warnings)


def _marker(made: Made) -> Marker:
    """Forks, from red to green with their quality; none deletes those of the last plan."""
    marker = Marker(header=made.header, ns="grasps", type=Marker.LINE_LIST, action=Marker.ADD if made.rows else Marker.DELETE)
    marker.scale.x, marker.pose.orientation.w = LINE_M, 1.0
    for row in made.rows:
        corners = planning.fork(row).reshape(-1, 3).tolist()
        marker.points += [Point(x=x, y=y, z=z) for x, y, z in corners]
        quality = min(max(row.quality, 0.0), 1.0)
        marker.colors += [ColorRGBA(r=1.0 - quality, g=quality, b=0.0, a=1.0)] * len(corners)
    return marker


def main() -> None:
    """Runs the node until it is interrupted; exits with 1 where a parameter is wrong."""
    rclpy.init()
    try:
        node = PlannerNode()
    except RefusedError as error:
        rclpy.shutdown()
        raise SystemExit(f"graspmill_planner: {error}") from error
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
