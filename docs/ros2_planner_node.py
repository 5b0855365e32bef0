"""ROS 2 example: depth image + camera info -> `graspmill serve` -> grasps in the camera's frame as a PoseArray, best first."""
import base64, io, json, urllib.request  # noqa: E401
import numpy, rclpy, tf2_ros  # noqa: E401
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image

class PlannerNode(Node):
    def __init__(self):
        super().__init__("graspmill_planner")
        self.url = self.declare_parameter("url", "http://127.0.0.1:8040/v1/plan").value
        self.base = self.declare_parameter("base_frame", "").value  # its z is up; without it, the camera is upright
        self.info, self.tf = None, tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.tf, self)
        self.grasps = self.create_publisher(PoseArray, "grasps", 1)
        self.create_subscription(CameraInfo, "camera_info", lambda info: setattr(self, "info", info), 1)
        self.create_subscription(Image, "depth", lambda image: self.info and self.on_depth(image, self.info.k), 1)

    def on_depth(self, image, k):  # of a rectified image: 16UC1 in millimetres or 32FC1 in metres, rows maybe padded
        kind = numpy.dtype((">" if image.is_bigendian else "<") + {"16UC1": "u2", "32FC1": "f4"}[image.encoding])
        size, strides = (image.height, image.width), (image.step, kind.itemsize)
        numpy.save(npy := io.BytesIO(), numpy.ndarray(size, kind, bytes(image.data), 0, strides))
        depth = {"data": base64.b64encode(npy.getvalue()).decode()}
        ask = {"views": [{"depth": depth, "intrinsics": [float(n) for n in k], "workspace_from_camera": "table"}]}
        try:
            if self.base:
                stamp, frame = Time.from_msg(image.header.stamp), image.header.frame_id
                p, q = (t := self.tf.lookup_transform(self.base, frame, stamp).transform).translation, t.rotation
                ask["base_from_camera"] = {"position_m": [p.x, p.y, p.z], "quaternion_xyzw": [q.x, q.y, q.z, q.w]}
            request = urllib.request.Request(self.url, json.dumps(ask).encode(), {"Content-Type": "application/json"})
            plan = json.load(urllib.request.urlopen(request, timeout=10))
        except (OSError, tf2_ros.TransformException) as error:
            return self.get_logger().warning(f"no plan: {error}")
        out, found = PoseArray(header=image.header), [grasp["camera_from_grasp"] for grasp in plan["grasps"]]
        pairs = [(dict(zip("xyz", f["position_m"])), dict(zip("xyzw", f["quaternion_xyzw"]))) for f in found]
        out.poses = [Pose(position=Point(**p), orientation=Quaternion(**q)) for p, q in pairs]
        self.grasps.publish(out)

if __name__ == "__main__": rclpy.init(); rclpy.spin(PlannerNode())  # noqa: E701, E702
