"""Pictures of attempts, by PyBullet's software renderer: hand open at the grasp, hand closed, end of the hold."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pybullet

from .attempt import Runner
from .bullet import Bullet
from .compound import Compound
from .compound_bullet import CompoundBullet
from .contract import Attempt, HandBox, Scene
from .dataset import Dataset
from .hull import Hull
from .solid import Solid

WIDTH_PX, HEIGHT_PX = 320, 280
TARGET, OTHER, HAND, TABLE = (0.9, 0.45, 0.1, 1), (0.6, 0.6, 0.65, 1), (0.15, 0.35, 0.75, 1), (0.85, 0.85, 0.8, 1)
WALL = (0.75, 0.7, 0.6, 1)


def draw(dataset: Dataset, scene: Scene, attempt: Attempt, path: Path) -> None:
    """Executes an attempt in PyBullet and writes its three stages side by side as a PNG."""
    engine = CompoundBullet()
    runner = Runner(engine, scene, dataset.hand_of(scene), dataset.procedure, dataset.environment)
    panels: list[np.ndarray] = []
    runner.from_closing(attempt, attempt.workspace_from_grasp, lambda stage: panels.append(_panel(engine, scene, attempt)))
    engine.close()
    missing = [np.full_like(panels[0], 255)] * (3 - len(panels))
    path.write_bytes(png(np.concatenate([*panels, *missing], axis=1)))


def _panel(engine: Bullet, scene: Scene, attempt: Attempt) -> np.ndarray:
    """A picture (height, width, 3) of the engine's world as it stands, drawn in a world of its own."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        parts = [(o.solid, p, q) for o, p, q in zip(scene.objects, engine.positions_m(), engine.quats_xyzw())]
        for i, (solid, position, quat) in enumerate(parts):
            colour = TARGET if i == attempt.target else OTHER
            for corners, faces in _surfaces(solid):
                _add(client, _mesh(client, corners, faces, colour), position, quat)
        for box, position, quat in engine.hand_boxes():
            _add(client, _box(client, box.half_m, HAND), position, quat)
        for part in scene.fixtures:
            # What is between eye and grasp would hide it.
            if (part.centroid_m - attempt.workspace_from_grasp.position_m) @ _towards_eye(attempt) < 0:
                for corners, faces in _surfaces(part):
                    _add(client, _mesh(client, corners, faces, WALL), [0, 0, 0], [0, 0, 0, 1])
        half = np.array([0.25, 0.25, 0.005])
        _add(client, _box(client, half, TABLE), [0.15, 0.15, engine.table_z_m - half[2]], [0, 0, 0, 1])
        return _photograph(client, attempt)
    finally:
        pybullet.disconnect(physicsClientId=client)


def _surfaces(solid: Solid | Compound | Hull) -> list[tuple[np.ndarray, list[tuple[int, int, int]]]]:
    """Corners (n, 3) and triangles of every convex part."""
    if isinstance(solid, Compound):
        return [surface for part in solid.convexes for surface in _surfaces(part)]
    if isinstance(solid, Hull):
        return [(solid.vertices_m, [(f[0], f[i], f[i + 1]) for f in solid.faces for i in range(1, len(f) - 1)])]
    n = len(solid.outline_m)
    ends = [f for i in range(1, n - 1) for f in ((0, i + 1, i), (n, n + i, n + i + 1))]
    sides = [f for i in range(n) for j in [(i + 1) % n] for f in ((i, j, n + j), (i, n + j, n + i))]
    return [(solid.vertices_m, ends + sides)]


def _mesh(client: int, corners: np.ndarray, triangles: list[tuple[int, int, int]], colour: tuple) -> int:
    # Every triangle has its own corners and normal, both ways round: flat shading.
    faces = [f for face in triangles for f in (face, face[::-1])]
    points = corners[np.array(faces)].reshape(-1, 3)
    normals = np.repeat([_normal(corners[list(f)]) for f in faces], 3, axis=0)
    return pybullet.createVisualShape(
        pybullet.GEOM_MESH, vertices=points.tolist(), indices=list(range(len(points))), normals=normals.tolist(),
        rgbaColor=colour, physicsClientId=client,
    )  # fmt: skip


def _normal(triangle: np.ndarray) -> np.ndarray:
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return normal / np.linalg.norm(normal)


def _box(client: int, half_m: np.ndarray, colour: tuple) -> int:
    return pybullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=half_m, rgbaColor=colour, physicsClientId=client)


def _add(client: int, visual: int, position: np.ndarray, quat: np.ndarray) -> None:
    pybullet.createMultiBody(
        0, baseVisualShapeIndex=visual, basePosition=position, baseOrientation=quat, physicsClientId=client
    )


def _towards_eye(attempt: Attempt) -> np.ndarray:
    """From the grasp to the camera (3,)."""
    pose = attempt.workspace_from_grasp
    side = pose.rotation[:, 0] * (1 if pose.rotation[1, 0] < 0 else -1)
    level = np.array([side[0], side[1], 0.0]) if np.hypot(*side[:2]) > 0.2 else np.array([0.0, -1.0, 0.0])
    return 0.30 * level / np.linalg.norm(level) + [0, 0, 0.14]


def _photograph(client: int, attempt: Attempt) -> np.ndarray:
    grasp_m = attempt.workspace_from_grasp.position_m
    eye = grasp_m + _towards_eye(attempt)
    view = pybullet.computeViewMatrix(eye.tolist(), (grasp_m + [0, 0, 0.02]).tolist(), [0, 0, 1])
    lens = pybullet.computeProjectionMatrixFOV(45, WIDTH_PX / HEIGHT_PX, 0.01, 2)
    pixels = pybullet.getCameraImage(
        WIDTH_PX, HEIGHT_PX, view, lens, renderer=pybullet.ER_TINY_RENDERER, shadow=0, physicsClientId=client
    )[2]
    return np.asarray(pixels, dtype=np.uint8).reshape(HEIGHT_PX, WIDTH_PX, 4)[..., :3]


def png(pixels: np.ndarray) -> bytes:
    """The bytes of a PNG of (height, width, 3) 8-bit pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = pixels.shape
    lines = b"".join(b"\0" + line.tobytes() for line in np.ascontiguousarray(pixels))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines, 9)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body
