"""What a camera's messages hold, as arrays. Messages are taken by their fields, so this module imports no ROS."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Numbers = NDArray[np.float64]

#: Encodings of depth images, and what a pixel is: whole units (of a parameter, by default millimetres) or metres.
DEPTHS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
#: Encodings of masks.
MASKS = {"mono8": "u1", "8UC1": "u1"}
#: ``sensor_msgs/PointField``: the number of FLOAT32.
FLOAT32 = 7
#: How far the length of a quaternion may be from 1.
LENGTH_OFF_MAX = 1e-3


class RefusedError(ValueError):
    """A message, a parameter or an answer that no plan can be made of; the text names the rule and the value."""


def stamp_s(stamp: Any) -> float:
    """Seconds of a ``builtin_interfaces/Time``."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _pixels(image: Any, kinds: dict[str, str], what: str) -> NDArray[Any]:
    """The pixels ``[height, width]`` of a ``sensor_msgs/Image``, whose rows may be padded."""
    if image.encoding not in kinds:
        raise RefusedError(f"{what} must be encoded as {', '.join(kinds)}, got {image.encoding!r}")
    kind = np.dtype((">" if image.is_bigendian else "<") + kinds[image.encoding])
    height, width, step = int(image.height), int(image.width), int(image.step)
    if height < 1 or width < 1 or step < width * kind.itemsize:
        size = f"{width} x {height} pixels in rows of {step} bytes"
        raise RefusedError(f"{what} must have pixels, and rows of {kind.itemsize} bytes each or more, got {size}")
    data = np.frombuffer(image.data, np.uint8)
    if len(data) < (height - 1) * step + width * kind.itemsize:
        raise RefusedError(f"{what} must have {height} rows of {step} bytes, got {len(data)} bytes")
    return np.ndarray((height, width), kind, data, 0, (step, kind.itemsize))


def depth_m(image: Any, unit_m: float = 0.001) -> Floats:
    """A depth image ``[height, width]`` in metres along the camera's z, 0 where nothing was seen.

    Args:
        image: A ``sensor_msgs/Image``: 16UC1 or mono16 in units, 32FC1 in metres.
        unit_m: Metres of a unit.
    """
    pixels = _pixels(image, DEPTHS, "the depth image")
    metres = pixels.astype(np.float64) * (unit_m if pixels.dtype.kind == "u" else 1.0)
    return np.where(np.isfinite(metres) & (metres > 0.0), metres, 0.0).astype(np.float32)


def mask_of(image: Any, depth: Floats) -> NDArray[np.bool_]:
    """A mask ``[height, width]`` of the depth image's size, true where the image is not 0."""
    pixels = _pixels(image, MASKS, "the mask")
    if pixels.shape != depth.shape:
        (height, width), (rows, columns) = depth.shape, pixels.shape
        raise RefusedError(f"the mask must have the depth image's size, {width} x {height}, got {columns} x {rows}")
    shown: NDArray[np.bool_] = pixels != 0
    return shown


def intrinsics(info: Any, depth: Floats) -> list[float]:
    """fx, fy, cx, cy in pixels of a ``sensor_msgs/CameraInfo``: of ``p`` if the lens is distorted, for the image is
    rectified, else of ``k``."""
    height, width = depth.shape
    if (info.width, info.height) != (0, 0) and (info.width, info.height) != (width, height):
        raise RefusedError(f"camera_info must be of the depth image's size, {width} x {height}, got {info.width} x {info.height}")
    k, p = [float(one) for one in info.k], [float(one) for one in info.p]
    is_distorted = any(float(one) != 0.0 for one in info.d)
    rows = [p[0], p[5], p[2], p[6]] if is_distorted and len(p) == 12 and p[0] > 0.0 else [k[0], k[4], k[2], k[5]]
    if not (np.isfinite(rows).all() and rows[0] > 0.0 and rows[1] > 0.0):
        raise RefusedError(f"camera_info must be of a calibrated camera, whose k has focal lengths, got k = {k}")
    return rows


def cropped(depth: Floats, crop_px: tuple[int, int, int, int]) -> Floats:
    """The image with what is outside columns x0 to x1 and rows y0 to y1 as not seen; four zeros keep all."""
    if not any(crop_px):
        return depth
    x0, y0, x1, y1 = crop_px
    height, width = depth.shape
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise RefusedError(f"crop_px must be x0, y0, x1, y1 within {width} x {height}, got {list(crop_px)}")
    kept = np.zeros_like(depth)
    kept[y0:y1, x0:x1] = depth[y0:y1, x0:x1]
    return kept


def points_m(cloud: Any) -> Floats:
    """The points ``[N, 3]`` in metres of a ``sensor_msgs/PointCloud2``, without those that are not finite."""
    fields = {one.name: one for one in cloud.fields}
    if any(name not in fields or (fields[name].datatype, fields[name].count) != (FLOAT32, 1) for name in "xyz"):
        raise RefusedError(f"the cloud must have x, y and z as FLOAT32, got the fields {', '.join(fields)}")
    kind = (">" if cloud.is_bigendian else "<") + "f4"
    offsets = [int(fields[name].offset) for name in "xyz"]
    height, width, data = int(cloud.height), int(cloud.width), np.frombuffer(cloud.data, np.uint8)
    least = (height - 1) * cloud.row_step + (width - 1) * cloud.point_step + max(offsets) + 4
    if height < 1 or width < 1 or min(offsets) < 0 or cloud.point_step < max(offsets) + 4:
        raise RefusedError(f"the cloud must have points, got {width} x {height} of {cloud.point_step} bytes")
    if cloud.row_step < width * cloud.point_step or len(data) < least:
        raise RefusedError(f"the cloud must have {height} rows of {cloud.row_step} bytes, got {len(data)} bytes")
    steps = (cloud.row_step, cloud.point_step)
    axes = [np.ndarray((height, width), kind, data, offset, steps) for offset in offsets]
    points = np.stack(axes, axis=2).reshape(-1, 3).astype(np.float32)
    return points[np.isfinite(points).all(axis=1)]


# Poses


def base_from_camera(found: Any, at_s: float, off_s_max: float) -> list[float]:
    """The camera in the base, seven numbers x, y, z and the quaternion x, y, z, w, of a ``TransformStamped``.

    Args:
        found: The transform that was looked up at the image's stamp. A static one may have the stamp 0.
        at_s: The image's stamp.
        off_s_max: How far apart the two may be.
    """
    of_s = stamp_s(found.header.stamp)
    if of_s != 0.0 and abs(of_s - at_s) > off_s_max:
        raise RefusedError(f"the camera's pose must be within {off_s_max:g} s of the image, got one {abs(of_s - at_s):.3f} s apart")
    place, turn = found.transform.translation, found.transform.rotation
    pose = [float(one) for one in (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)]
    length = float(np.linalg.norm(pose[3:]))
    if not np.isfinite(pose).all() or abs(length - 1.0) > LENGTH_OFF_MAX:
        raise RefusedError(f"the camera's pose must be finite with a quaternion of length 1, got {pose}")
    return pose[:3] + [one / length for one in pose[3:]]


def matrix(pose: list[float]) -> Numbers:
    """The matrix ``[4, 4]`` of seven numbers x, y, z and the unit quaternion x, y, z, w."""
    x, y, z, w = pose[3:]
    made = np.eye(4)
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    made[:3, 3] = pose[:3]
    return made
