"""Cameras: intrinsics, pose and conventions of axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from .errors import InputError

#: The cameras of OpenGL and Blender look along −z with y up; ours, and the optical frames of OpenCV and ROS, look along
#: +z with y down.
_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
_SIZE_PX_MAX = 16_384
_FOCAL_PX_MAX = 1e6

Convention = Literal["opencv", "opengl"]


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole depth camera in the workspace.

    Args:
        width_px: Pixels in a row; ``height_px`` is the number of rows.
        fx_px: Focal length along u, in pixels; ``fy_px`` is along v.
        cx_px: Principal point, u, and ``cy_px``, v; pixel centres are whole numbers.
        workspace_from_camera: Its pose, ``[4, 4]``, ``[7]`` or ``[3]``; if ``None``, a plan finds the table.
        convention: The axes of that pose: ``"opencv"`` (x right, y down, z forward) or ``"opengl"`` (x right, y up, z back).
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    workspace_from_camera: NDArray[np.float64] | None = None
    convention: Convention = "opencv"

    def __post_init__(self) -> None:
        own = vars(self)
        own |= {name: _arrays.whole(name, own[name], 1, _SIZE_PX_MAX) for name in ("width_px", "height_px")}
        own |= {name: _arrays.number(name, own[name], 1e-3, _FOCAL_PX_MAX) for name in ("fx_px", "fy_px")}
        own |= {name: _arrays.number(name, own[name], -_FOCAL_PX_MAX, _FOCAL_PX_MAX) for name in ("cx_px", "cy_px")}
        _arrays.one_of("convention", self.convention, ("opencv", "opengl"))
        if self.workspace_from_camera is None:
            return
        rows = _arrays.pose("workspace_from_camera", self.workspace_from_camera)
        given = np.asarray(self.workspace_from_camera)
        matrix = given.astype(np.float64) if given.shape == (4, 4) else _arrays.matrices([rows])[0]
        own |= {"workspace_from_camera": matrix @ _OPENGL if self.convention == "opengl" else matrix, "convention": "opencv"}

    @classmethod
    def from_K(cls, K: ArrayLike, shape: tuple[int, int], workspace_from_camera: ArrayLike | None = None, *, convention: Convention = "opencv") -> Camera:
        """A camera from an intrinsic matrix, as OpenCV and ROS have it.

        Args:
            K: ``[3, 3]``, ``[9]`` row by row, or ``[3, 4]`` with a last column of 0; fx, fy, cx, cy in pixels, and no skew.
            shape: Height and width of the images: ``depth.shape``.
        """
        given = _arrays.given("K", K)
        given = given.reshape(3, 3) if given.shape == (9,) else given
        columns = 4 if given.shape == (3, 4) else 3
        matrix = _arrays.floats("K", given, (3, columns), ", [3, 4] or [9]").astype(np.float64)
        (fx, fy), (cx, cy) = np.diag(matrix)[:2], matrix[:2, 2]
        if np.abs(matrix - [[fx, 0, cx, 0][:columns], [0, fy, cy, 0][:columns], [0, 0, 1, 0][:columns]]).max() > 1e-6:
            raise InputError(f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {matrix.tolist()}")
        with _arrays.read_as("shape must be (height, width)", shape):
            height, width = shape
        return cls(width, height, fx, fy, cx, cy, workspace_from_camera, convention)  # type: ignore[arg-type]

    @classmethod
    def look_at(
        cls, eye_m: ArrayLike, target_m: ArrayLike = (0.15, 0.15, 0.05), *, width_px: int = 640, height_px: int = 480, focal_px: float = 540.0
    ) -> Camera:
        """An upright camera at one point that looks at another, by default with the shipped configs' intrinsics.

        Args:
            eye_m: Its position, ``[3]`` in the workspace, in metres.
            target_m: The point that it looks at, ``[3]``; by default the middle of the table.
        """
        eye, target = (_arrays.floats(name, value, (3,)).astype(np.float64) for name, value in (("eye_m", eye_m), ("target_m", target_m)))
        forward = target - eye
        _arrays.must(np.linalg.norm(forward) >= 1e-6, "eye_m must not be target_m")
        forward /= np.linalg.norm(forward)
        up = np.array([0.0, 1.0, 0.0]) if abs(forward[2]) > 1.0 - 1e-9 else np.array([0.0, 0.0, 1.0])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(forward, right), forward, eye
        width, height = _arrays.whole("width_px", width_px, 1, _SIZE_PX_MAX), _arrays.whole("height_px", height_px, 1, _SIZE_PX_MAX)
        return cls(width, height, focal_px, focal_px, width / 2.0, height / 2.0, pose)

    def _intrinsics(self) -> list[float]:
        return [float(self.width_px), float(self.height_px), self.fx_px, self.fy_px, self.cx_px, self.cy_px]

    def _pose(self) -> list[float]:
        if self.workspace_from_camera is None:
            raise InputError("workspace_from_camera must be given, got None: only a plan finds the table without it")
        return _arrays.pose("workspace_from_camera", self.workspace_from_camera)
