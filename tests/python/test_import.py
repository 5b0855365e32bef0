"""Imported objects against other readers: a model of MuJoCo against MuJoCo, a binary glTF against its matrices."""

import json
import re
import struct
import subprocess
from pathlib import Path

import mujoco
import numpy as np
import pytest
from programs import program

MODEL = """
<mujoco>
  <compiler meshdir="parts"/>
  <default>
    <default class="visual"><geom contype="0" conaffinity="0"/></default>
    <default class="wall"><geom type="box" size="0.01 0.02 0.03"/><default class="thin"><geom pos="0 0 0.05"/></default></default>
  </default>
  <asset>
    <mesh file="wedge.obj" scale="0.001 0.001 0.002"/>
    <mesh name="mirrored" file="wedge.obj" scale="-0.001 0.001 0.001"/>
    <mesh name="shown" file="wedge.obj"/>
    <mesh name="own" file="wedge.msh" scale="0.0012 0.001 0.001"/>
  </asset>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <geom type="sphere" size="5"/>
    <body pos="0.1 0 0.2" euler="10 20 30" childclass="wall">
      <geom class="visual" type="mesh" mesh="shown"/>
      <geom mass="0.05"/>
      <geom class="thin" quat="0.8 0.1 0.2 0.3" mass="0.02"/>
      <body pos="0.05 0.01 0" axisangle="1 1 0 40">
        <inertial mass="0.2" pos="0 0 0" diaginertia="0.001 0.001 0.001"/>
        <geom type="mesh" mesh="wedge" pos="0.01 0.02 0.03"/>
        <geom type="mesh" mesh="mirrored" euler="0 90 0"/>
        <geom type="cylinder" size="0.01 0.02" pos="0 0.03 0"/>
        <geom type="capsule" size="0.01 0.02" pos="0 -0.03 0"/>
        <geom type="cylinder" size="0.004" fromto="0.01 0.02 0 0.08 -0.06 0.05"/>
        <geom type="capsule" size="0.003" fromto="0 0 0 -0.05 0.03 -0.08"/>
        <geom size="0.002" fromto="0 0.01 0 0.02 0.09 0.03"/>
        <geom type="mesh" mesh="own" pos="-0.06 0 0.02" euler="30 0 40"/>
        <geom type="ellipsoid" size="0.01 0.02 0.03" pos="0 0 -0.05"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
WEDGE = np.array([[0, 0, 0], [30, 0, 0], [0, 20, 0], [0, 0, 10]], dtype=np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.uint16)


def imported(folder: Path, *more: object) -> dict:
    """The one object of a folder."""
    command = [program("generator"), "import-objects", folder, "--out", folder / "x.toml", "--json", "--drops", 0, *more]
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    objects = json.loads(ended.stdout)["objects"]
    assert len(objects) == 1, objects
    return objects[0]


def points_of(model: mujoco.MjModel) -> np.ndarray:
    """Where the colliding geoms of bodies end, by MuJoCo: corners of meshes and boxes, dense points of what is round."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    spiral = np.random.default_rng(1).normal(size=(200_000, 3))
    spiral /= np.linalg.norm(spiral, axis=1)[:, None]
    points = []
    for geom in range(model.ngeom):
        size, kind = model.geom_size[geom], model.geom_type[geom]
        if model.geom_bodyid[geom] == 0 or not model.geom_contype[geom]:
            continue
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            own = model.mesh_vert[first : first + count]
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            own = size * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, 8).T
        elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            own = size[0] * spiral + [0, 0, 1] * np.sign(spiral[:, 2:]) * size[1]
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            ends = spiral[:, :2] / np.linalg.norm(spiral[:, :2], axis=1)[:, None]
            own = np.column_stack([size[0] * ends, np.sign(spiral[:, 2]) * size[1]])
        else:
            own = size * spiral
        points.append(own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(points)


# Round shapes have flat sides here, with corners on their surface.
@pytest.mark.parametrize(("round_shapes", "near_m"), [("cylinder|capsule|ellipsoid", 1e-6), ("nothing", 6e-4)])
def test_a_model_of_mujoco_is_where_mujoco_has_it(tmp_path, round_shapes, near_m):
    model = "\n".join(line for line in MODEL.splitlines() if not re.search(f'type="({round_shapes})"', line))
    (tmp_path / "parts").mkdir()
    lines = [*("v {} {} {}".format(*corner) for corner in WEDGE), *("f {} {} {}".format(*(face + 1)) for face in FACES)]
    (tmp_path / "parts" / "wedge.obj").write_text("\n".join(lines))
    (tmp_path / "parts" / "wedge.msh").write_bytes(msh())
    (tmp_path / "model.xml").write_text(model)
    (tmp_path / "package.xml").write_text("<package/>")  # of a robot's software, no model
    body = imported(tmp_path)
    points = points_of(mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml")))
    extents_m = np.ptp(points, axis=0)
    assert np.abs(body["extents_m"] - extents_m).max() < near_m, (body["extents_m"], extents_m)
    assert body["mass_kg"] == pytest.approx(0.05 + 0.02 + 0.2)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("quat=", "zaxis="), "zaxis of geom is not followed"),
        (('mesh="mirrored"', 'mesh="nothing"'), "there is no mesh nothing"),
        (('size="0.01 0.02" pos="0 0.03 0"', 'size="0.01" pos="0 0.03 0"'), "a cylinder must have its sizes"),
        (('"mirrored" file="wedge.obj"', '"mirrored" file="gone.obj"'), "gone.obj"),
        (("<worldbody>", '<include file="a.xml"/><worldbody>'), "include is not followed"),
        (("</mujoco>", ""), "it must have an element mujoco, with its end"),
    ],
)
def test_what_a_model_says_wrongly_is_named(tmp_path, wrong, message):
    file = tmp_path / "model.xml"
    assert wrong[0] in MODEL
    file.write_text(MODEL.replace(*wrong))
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "wedge.msh").write_bytes(msh())
    (tmp_path / "parts" / "wedge.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    command = [program("generator"), "import-objects", file, "--out", tmp_path / "x.toml"]
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert ended.returncode in (65, 78) and message in ended.stderr, ended


def msh() -> bytes:
    """The wedge in MuJoCo's own format, with normals and texture coordinates that nobody reads."""
    counts = np.array([4, 4, 4, 4], dtype=np.int32)
    normals = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
    parts = [counts, WEDGE, normals, np.zeros((4, 2), dtype=np.float32), FACES.astype(np.int32)]
    return b"".join(part.tobytes() for part in parts)


@pytest.mark.parametrize("change", [lambda b: b[:-4], lambda b: b + b"abcd", lambda b: b[:9], lambda b: b"\xff" * 4 + b[4:]])
def test_a_damaged_mesh_of_mujoco_is_refused(tmp_path, change):
    file = tmp_path / "wedge.msh"
    file.write_bytes(change(msh()))
    command = [program("generator"), "import-objects", file, "--out", tmp_path / "x.toml"]
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert ended.returncode == 65 and "not a whole MSH file" in ended.stderr, ended


def glb(document: dict, blob: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def scene(**accessor: int) -> tuple[dict, bytes]:
    """A wedge in a node that is turned, stretched and moved, in a node that mirrors it."""
    corners, faces = (WEDGE / 1000).tobytes(), FACES.tobytes()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"scale": [-1, 1, 2], "children": [1]},
            {"mesh": 0, "rotation": [0, 0, 0.6, 0.8], "translation": [0.1, 0.2, 0.3], "scale": [2, 1, 1]},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(corners) + len(faces)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(corners)},
            {"buffer": 0, "byteOffset": len(corners), "byteLength": len(faces)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [0.03, 0.02, 0.01], **accessor},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
    }
    return document, corners + faces


def test_a_binary_gltf_is_where_its_nodes_place_it(tmp_path):
    (tmp_path / "wedge.glb").write_bytes(glb(*scene()))
    body = imported(tmp_path, "--scale", 1)
    cos, sin = 0.8**2 - 0.6**2, 2 * 0.6 * 0.8
    turned = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) * [2, 1, 1]
    points = (WEDGE / 1000 @ turned.T + [0.1, 0.2, 0.3]) * [-1, 1, 2]
    assert body["is_watertight"]
    assert body["extents_m"] == pytest.approx(np.ptp(points, axis=0), rel=1e-5)
    assert body["volume_m3"] == pytest.approx(0.03 * 0.02 * 0.01 / 6 * 4, rel=1e-5)
    assert not any("inside out" in warning for warning in body["warnings"])


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda document: document["accessors"][0].update(count=5), "accessor 0 must lie within its view"),
        (lambda document: document["accessors"][1].update(byteOffset=4), "accessor 1 must lie within its view"),
        (lambda document: document["bufferViews"][1].update(byteLength=1000), "must lie within"),
        (lambda document: document["buffers"][0].update(uri="a.bin"), "its buffer 0 must be in the file"),
        (lambda document: document.update(extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco_mesh_compression"),
        (lambda document: document.update(scenes=[], scene=None), ""),
        (lambda document: document["nodes"][1].update(children=[0]), ""),
    ],
)
def test_a_damaged_binary_gltf_is_refused(tmp_path, break_it, message):
    document, blob = scene()
    break_it(document)
    file = tmp_path / "wedge.glb"
    file.write_bytes(glb(document, blob))
    command = [program("generator"), "import-objects", file, "--out", tmp_path / "x.toml"]
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert ended.returncode == 65 and message in ended.stderr and "panic" not in ended.stderr, ended


def test_no_byte_of_a_binary_gltf_ends_it_badly(tmp_path):
    whole, file, dice = glb(*scene()), tmp_path / "wedge.glb", np.random.default_rng(4)
    for _ in range(60):
        damaged = bytearray(whole)
        for place in dice.integers(len(whole), size=3):
            damaged[place] = dice.integers(256)
        file.write_bytes(damaged[: dice.integers(len(whole) // 2, len(whole) + 1)])
        command = [program("generator"), "import-objects", file, "--out", tmp_path / "x.toml", "--force", "--drops", "0"]
        ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        assert ended.returncode in (0, 65, 78) and "panic" not in ended.stderr, ended
