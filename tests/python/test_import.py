"""Imported objects against other readers: a model of MuJoCo against MuJoCo, a binary glTF against its matrices."""

import json
import re
import struct
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
from programs import packaged  # noqa: E402

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
    <mesh name="shown" file="wedge.obj" scale="0.001 0.001 0.001"/>
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
        <geom type="cylinder" size="0.01 0.02 0" pos="0 0.03 0"/>
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
    (only,) = all_imported(folder, *more).values()
    return only


def all_imported(folder: Path, *more: object) -> dict[str, dict]:
    told = packaged("objects", "import", folder, "--out", folder / "x.toml", "--json", *more).stdout
    return {body["name"]: body for body in json.loads(told)["objects"]}


def refused(folder: Path, ending: str, cases: list[tuple], written: Callable) -> None:
    """Each case, a change and a message, is left out with its file and the message; one file is right."""
    (folder / "right.obj").write_text(corner_obj())
    files = [folder / f"{number}{ending}" for number in range(len(cases))]
    for file, (change, _) in zip(files, cases):
        file.write_bytes(written(change))
    words = ["objects", "import", folder / "right.obj", *files, "--out", folder / "x.toml", "--json", "--scale", 1]
    left_out = json.loads(packaged(*words, code=66).stdout)["left_out"]
    assert [Path(one["file"]) for one in left_out] == files
    for file, (_, message), one in zip(files, cases, left_out):
        assert str(file) in one["reason"] and message in one["reason"], (message, one)


def placed(folder: Path) -> None:
    """The wedge as the models name it."""
    (folder / "parts").mkdir()
    lines = [*("v {} {} {}".format(*corner) for corner in WEDGE), *("f {} {} {}".format(*(face + 1)) for face in FACES)]
    (folder / "parts" / "wedge.obj").write_text("\n".join(lines))
    (folder / "parts" / "wedge.msh").write_bytes(msh())


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
            own = (size[0] if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size) * spiral
        points.append(own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(points)


# Round shapes have flat sides here, with corners on their surface.
@pytest.mark.parametrize(("round_shapes", "near_m"), [("cylinder|capsule|ellipsoid", 1e-6), ("nothing", 6e-4)])
def test_a_model_of_mujoco_is_where_mujoco_has_it(tmp_path, round_shapes, near_m):
    model = "\n".join(line for line in MODEL.splitlines() if not re.search(f'type="({round_shapes})"', line))
    placed(tmp_path)
    (tmp_path / "model.xml").write_text(model)
    (tmp_path / "package.xml").write_text("<package/>")  # of a robot's software, no model
    body = imported(tmp_path)
    theirs = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    points = points_of(theirs)
    extents_m = np.ptp(points, axis=0)
    assert np.abs(body["extents_m"] - extents_m).max() < near_m, (body["extents_m"], extents_m)
    assert body["mass_kg"] == pytest.approx(theirs.body_mass[1:].sum(), rel=1e-6)


ROBOT = """<?xml version="1.0"?><robot name="two"><!-- links -->
<link name="base"><inertial><mass value="0.2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  <visual><geometry><box size="9 9 9"/></geometry></visual>
  <collision><geometry><mesh filename="package://parts/corner.obj" scale="1 1 -1"/></geometry></collision></link>
<link name="plate"><inertial><mass value="0.1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  <visual><origin rpy="0 0 1.5707963267948966"/><geometry><box size="0.02 0.04 0.01"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="plate"/><origin xyz="0.09 0.01 -0.005"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def test_a_urdf_is_one_body_of_its_links(tmp_path):
    """An L, mirrored, and a plate of 40 x 20 x 10 mm beside it, which is turned by a quarter."""
    (tmp_path / "urdf/parts").mkdir(parents=True)
    (tmp_path / "urdf/parts/corner.obj").write_text(corner_obj())
    (tmp_path / "urdf/parts/two.urdf").write_text(ROBOT)
    body = imported(tmp_path / "urdf")
    assert (body["name"], body["mass_kg"]) == ("two", pytest.approx(0.3)) and body["file"].endswith("urdf/parts/two.urdf")
    assert body["extents_m"] == pytest.approx([0.11, 0.06, 0.04], rel=1e-5) and body["is_watertight"]
    assert body["volume_m3"] == pytest.approx((0.06 * 0.02 + 0.02 * 0.04) * 0.04 + 0.04 * 0.02 * 0.01, rel=1e-5)
    assert body["middle_m"] == pytest.approx([0.055, 0.03, -0.02], abs=1e-6)
    # Half as large, with the same mass; then with a density, which makes one.
    body = imported(tmp_path / "urdf", "--scale", 0.5, "--friction", 0.3, "--force")
    assert body["extents_m"] == pytest.approx([0.055, 0.03, 0.02], rel=1e-5)
    assert (body["mass_kg"], body["friction"]) == (pytest.approx(0.3), pytest.approx(0.3))
    assert imported(tmp_path / "urdf", "--density", 500, "--force")["mass_kg"] == pytest.approx(500 * 8.8e-5, rel=1e-4)


def test_what_a_urdf_says_wrongly_leaves_it_out_and_the_others_go_on(tmp_path):
    cases = [
        (("</robot>", ""), "no element found"),
        (('size="0.02 0.04 0.01"', 'size="0.02 0.04"'), "size"),
        (('mass value="0.1"', 'mass value="-0.1"'), "the mass of a link must be 0 or more, got -0.1"),
        (("corner.obj", "gone.obj"), "gone.obj"),
        (("<robot", "<robots"), "mismatched tag"),
    ]
    (tmp_path / "corner.obj").write_text(corner_obj())
    refused(tmp_path, ".urdf", cases, lambda wrong: ROBOT.replace(*wrong).encode())


CORNER = [(0, 0), (0.06, 0), (0.06, 0.02), (0.02, 0.02), (0.02, 0.06), (0, 0.06)]


def corner_obj() -> str:
    """An L of 60 x 60 x 40 mm, 20 mm thick: closed, not convex."""
    lines = [f"v {x} {y} {z}" for z in (0, 0.04) for x, y in CORNER]
    for second in range(2, 6):
        lines += [f"f 1 {second + 1} {second}", f"f 7 {second + 6} {second + 7}"]
    lines += [f"f {a + 1} {(a + 1) % 6 + 1} {(a + 1) % 6 + 7} {a + 7}" for a in range(6)]
    return "\n".join(lines)


def test_the_inertia_of_a_model_is_mujocos(tmp_path):
    """Boxes of one density that do not overlap, in frames and copies: also volume, centre and inertia are the same."""
    dice = np.random.default_rng(46)
    turn = lambda: 'euler="{:.3f} {:.3f} {:.3f}"'.format(*dice.uniform(-180, 180, 3))  # noqa: E731
    for number in range(20):
        geoms = "".join(
            f'<frame pos="{0.06 * place:.2f} 0 0"><geom type="box" size="{x:.4f} {y:.4f} {z:.4f}" {turn()}/></frame>'
            for place, (x, y, z) in enumerate(dice.uniform(0.005, 0.017, (3, 3)))
        )
        text = f'<replicate count="2" offset="0 0.2 0.01" euler="0 0 30">{geoms}</replicate>'
        body = f'<worldbody><body pos="0.05 -0.02 0.1" {turn()}>{text}</body></worldbody>'
        model = f'<mujoco><default><geom density="700"/></default>{body}</mujoco>'
        (tmp_path / f"m{number}.xml").write_text(model)
    for name, body in all_imported(tmp_path).items():
        theirs = mujoco.MjModel.from_xml_path(str(tmp_path / f"{name}.xml"))
        data = mujoco.MjData(theirs)
        mujoco.mj_forward(theirs, data)
        assert body["mass_kg"] == pytest.approx(theirs.body_mass[1], rel=1e-5)
        assert body["volume_m3"] == pytest.approx(theirs.body_mass[1] / 700, rel=1e-5)
        assert body["inertia_kg_m2"] == pytest.approx(sorted(theirs.body_inertia[1]), rel=1e-4)
        assert body["centre_of_mass_m"] == pytest.approx(list(data.xipos[1]), abs=1e-6)


def test_what_a_model_says_wrongly_is_named(tmp_path):
    cases = [
        (("quat=", "shellinertia="), "Element 'geom'"),
        (('mesh="mirrored"', 'mesh="nothing"'), "mesh 'nothing' not found"),
        (('"mirrored" file="wedge.obj"', '"mirrored" file="gone.obj"'), "gone.obj"),
        (("<worldbody>", '<include file="3.xml"/><worldbody>'), "3.xml"),  # itself
        (("<mujoco>", "<mujocoinclude>"), "mujocoinclude"),
        (("<geom mass", '<replicate count="100000"><geom size="0.01 0.01 0.01"/></replicate><geom mass'), "at most 10000 elements"),
        (("</mujoco>", ""), "XML"),
    ]
    placed(tmp_path)

    def written(wrong):
        assert wrong[0] in MODEL
        text = MODEL.replace(*wrong)
        return (text.replace("</mujoco>", "</mujocoinclude>") if "<mujocoinclude>" in text else text).encode()

    refused(tmp_path, ".xml", cases, written)


def msh() -> bytes:
    """The wedge in MuJoCo's own format, with normals and texture coordinates that nobody reads."""
    counts = np.array([4, 4, 4, 4], dtype=np.int32)
    normals = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
    parts = [counts, WEDGE, normals, np.zeros((4, 2), dtype=np.float32), FACES.astype(np.int32)]
    return b"".join(part.tobytes() for part in parts)


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


def compress(document: dict) -> None:
    """As an exporter with Draco writes it: the accessors have no bytes of their own."""
    document.update(extensionsRequired=["KHR_draco_mesh_compression"])
    for accessor in document["accessors"]:
        del accessor["bufferView"]


def repeat(document: dict, times: int) -> None:
    """Many nodes on one mesh with many corners, given by an accessor without a stride."""
    document["nodes"] = [{"mesh": 0} for _ in range(times)]
    document["scenes"] = [{"nodes": list(range(times))}]
    document["meshes"] = [{"primitives": document["meshes"][0]["primitives"] * 1000}]


def test_a_damaged_binary_gltf_is_refused(tmp_path):
    cases = [
        (lambda document: document["accessors"][0].update(count=5), "accessor 0 must lie within its view"),
        (lambda document: document["accessors"][1].update(byteOffset=4), "accessor 1 must lie within its view"),
        (lambda document: document["bufferViews"][1].update(byteLength=1000), "must lie within"),
        (lambda document: document["buffers"][0].update(uri="a.bin"), "its buffers must be in the file"),
        (compress, "it requires KHR_draco_mesh_compression"),
        (lambda document: document["accessors"][1].update(componentType=5126, count=6), "whole numbers"),
        (lambda document: document["accessors"][0].update(componentType=5123), "three floats"),
        (lambda document: document["accessors"][0].update(type="VEC2"), "three floats"),
        (lambda document: document["meshes"][0]["primitives"][0].update(indices=7), ""),
        (lambda document: document["meshes"][0]["primitives"][0].update(attributes={}), "POSITION"),
        (lambda document: document.update(scenes=[], scene=None), ""),
        (lambda document: document["nodes"][1].update(children=[0]), "a tree"),
        (lambda document: document.update(nodes=[{"children": [i + 1, i + 1]} for i in range(60)] + [{"mesh": 0}]), "a tree"),
        (lambda document: document.update(scenes=[{"nodes": [0, 0]}]), "a tree"),
        (lambda document: repeat(document, 1000), "at most 1000000 triangles"),
    ]

    def written(break_it):
        document, blob = scene()
        break_it(document)
        return glb(document, blob)

    refused(tmp_path, ".glb", cases, written)
    packaged("objects", "import", tmp_path / "0.glb", "--out", tmp_path / "y.toml", code=65)
