"""ROS 2 example: depth image + camera info + TF -> `graspmill serve` -> ranked grasps as a PoseArray, best first."""
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
        self.frame = self.declare_parameter("workspace_frame", "workspace").value
        self.info, self.tf = None, tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.tf, self)
        self.grasps = self.create_publisher(PoseArray, "grasps", 1)
        self.create_subscription(CameraInfo, "camera_info", lambda info: setattr(self, "info", info), 1)
        self.create_subscription(Image, "depth", lambda image: self.info and self.on_depth(image, self.info.k), 1)

    def on_depth(self, image, k):  # of a rectified image: 16UC1 in millimetres or 32FC1 in metres, rows maybe padded
        kind = numpy.dtype((">" if image.is_bigendian else "<") + {"16UC1": "u2", "32FC1": "f4"}[image.encoding])
        size, strides = (image.height, image.width), (image.step, kind.itemsize)
        numpy.save(npy := io.BytesIO(), numpy.ndarray(size, kind, bytes(image.data), 0, strides))
        try:
            t = self.tf.lookup_transform(self.frame, image.header.frame_id, Time.from_msg(image.header.stamp)).transform
            p, q = t.translation, t.rotation
            view = {"depth": {"data": base64.b64encode(npy.getvalue()).decode()},
                    "intrinsics": {"fx_px": k[0], "fy_px": k[4], "cx_px": k[2], "cy_px": k[5]},
                    "workspace_from_camera": {"position_m": [p.x, p.y, p.z], "quaternion_xyzw": [q.x, q.y, q.z, q.w]}}
            body, kind = json.dumps({"views": [view]}).encode(), {"Content-Type": "application/json"}
            plan = json.load(urllib.request.urlopen(urllib.request.Request(self.url, body, kind), timeout=10))
        except (OSError, tf2_ros.TransformException) as error:
            return self.get_logger().warning(f"no plan: {error}")
        out, found = PoseArray(), [grasp["workspace_from_grasp"] for grasp in plan["grasps"]]
        out.header.stamp, out.header.frame_id = image.header.stamp, self.frame
        pairs = [(dict(zip("xyz", f["position_m"])), dict(zip("xyzw", f["quaternion_xyzw"]))) for f in found]
        out.poses = [Pose(position=Point(**p), orientation=Quaternion(**q)) for p, q in pairs]
        self.grasps.publish(out)

if __name__ == "__main__": rclpy.init(); rclpy.spin(PlannerNode())  # noqa: E701, E702
