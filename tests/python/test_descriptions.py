"""Grippers from their descriptions: boxes of a URDF and an MJCF that are written here, whose sizes are known."""

import struct
import sys
import tomllib
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from grasp_sets import BOX_MESH, box_obj, graspmill, refused

pytest.importorskip("mujoco")

from graspmill.descriptions import from_description, main  # noqa: E402
from graspmill.grippers import lines  # noqa: E402
from programs import ran  # noqa: E402

FINGERS = ("left", "right")
#: Jaws of 10 x 8 x 40 mm, whose inner faces are 2 to 62 mm apart, on a palm of 40 x 120 x 60 mm.
URDF = """<robot name="gripper"><link name="base">{palm}</link>
<link name="left">{jaw}</link><link name="right">{jaw}</link>{more}
<joint name="drive" type="prismatic"><parent link="base"/><child link="left"/><origin xyz="0 0.005 0.06"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="0.03" effort="10" velocity="0.1"/></joint>
<joint name="follow" type="{kind}"><parent link="base"/><child link="right"/><origin xyz="0 -0.005 0.06"/><axis xyz="0 1 0"/>
  <limit lower="-0.03" upper="0.03" effort="10" velocity="0.1"/>{mimic}</joint></robot>"""
MIMIC = '<mimic joint="drive" multiplier="-1"/>'
PALM, JAW = np.array([0.04, 0.12, 0.06]), np.array([0.01, 0.008, 0.04])
#: A sphere around everything, and a link at a tip.
COARSE = """<link name="hull"><collision><geometry><sphere radius="0.08"/></geometry></collision></link>
<joint name="around" type="fixed"><parent link="base"/><child link="hull"/><origin xyz="0 0 0.04"/></joint>"""
TIP = '<link name="tip"/><joint name="at" type="fixed"><parent link="left"/><child link="tip"/></joint>'


def shape(size, at):
    xyz = " ".join(str(part) for part in at)
    return f'<collision><origin xyz="{xyz}"/><geometry><box size="{" ".join(map(str, size))}"/></geometry></collision>'


def mesh(name, at):
    return f'<collision><origin xyz="{" ".join(map(str, at))}"/><geometry><mesh filename="{name}"/></geometry></collision>'


def urdf(folder, palm=shape(PALM, (0, 0, 0.03)), jaw=shape(JAW, (0, 0, 0.02)), more="", mimic=MIMIC, kind="prismatic"):
    path = folder / "gripper.urdf"
    path.write_text(URDF.format(palm=palm, jaw=jaw, more=more, mimic=mimic, kind=kind))
    return path


def box_triangles(size):
    corners, faces = BOX_MESH
    return ((corners > 0) - 0.5) * size, faces


def stl(size):
    corners, faces = box_triangles(size)
    rows = b"".join(bytes(12) + corners[face].astype("<f4").tobytes() + bytes(2) for face in faces)
    return bytes(80) + struct.pack("<I", len(faces)) + rows


def collada(size):
    """In millimetres; it says that y is up, which no program for robots heeds."""
    corners, faces = box_triangles(1e3 * size)
    numbers = " ".join(f"{corner} 0" for face in faces for corner in face)
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset><unit meter="0.001"/><up_axis>Y_UP</up_axis></asset>
    <library_geometries><geometry id="g"><mesh><source id="s"><float_array>{" ".join(map(str, corners.ravel()))}</float_array></source>
    <vertices id="v"><input semantic="POSITION" source="#s"/></vertices><triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/>
    <input semantic="NORMAL" source="#s" offset="1"/><p>{numbers}</p></triangles></mesh></geometry></library_geometries>
    <library_visual_scenes><visual_scene id="w"><node><rotate>1 0 0 0</rotate><node><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>
    <instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes></COLLADA>"""


def sizes(boxes):
    fingers = [boxes.finger_length_m, boxes.finger_width_m, boxes.finger_thickness_m]
    return [*fingers, boxes.palm_length_m, boxes.palm_width_m, boxes.palm_breadth_m]


EXPECTED = [0.04, 0.01, 0.008, 0.06, 0.04, 0.12]


def test_a_urdf_opens_by_its_master_joint_and_its_boxes_are_its_shapes(tmp_path):
    boxes = from_description(urdf(tmp_path), FINGERS)
    # Axes at 5 mm and 30 mm of stroke, less half of the thickness, twice.
    assert np.isclose(boxes.opening_m_max, 2 * (0.005 + 0.03 - 0.004)) and np.isclose(boxes.opening_m_min, 0.002)
    assert np.allclose(sizes(boxes), EXPECTED, atol=6e-4)
    # +y is from the first finger to the second.
    assert np.allclose(boxes.flange_from_grasp, [[-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0.1], [0, 0, 0, 1]], atol=1e-6)
    assert np.allclose(from_description(boxes.path, FINGERS[::-1]).flange_from_grasp[:3, :3], np.eye(3), atol=1e-6)
    gripper = boxes.gripper("mine", finger_mass_kg=0.05, finger_force_n=20.0, closing_speed_m_s=0.1)
    box = graspmill.Object.cuboid((0.04, 0.04, 0.05), (0.15, 0.15, 0.075, 0, 0, 0, 1))
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[:3, 3] = 0.15, 0.15, 0.07
    assert graspmill.execute(graspmill.Scene([box]), down[None], gripper=gripper).held.all()


@pytest.mark.parametrize(("ending", "of"), [("stl", stl), ("obj", lambda size: box_obj(size, -size / 2)), ("dae", collada)])
def test_meshes_are_followed_also_those_of_packages(tmp_path, ending, of):
    (tmp_path / "my_gripper" / "meshes").mkdir(parents=True)
    (tmp_path / "my_gripper" / "urdf").mkdir()
    for name, size in (("palm", PALM), ("jaw", JAW)):
        data = of(size)
        (tmp_path / "my_gripper" / "meshes" / f"{name}.{ending}").write_bytes(data if isinstance(data, bytes) else data.encode())
    path = urdf(
        tmp_path / "my_gripper" / "urdf",
        palm=mesh(f"package://my_gripper/meshes/palm.{ending}", (0, 0, 0.03)),
        jaw=mesh(f"meshes/jaw.{ending}", (0, 0, 0.02)),  # which is in the folder above
        more=COARSE.replace("hull", "base_sc"),
    )
    boxes = from_description(path, FINGERS)
    assert boxes.notes == ("base_sc is left out, for base has the finer shapes",)
    assert np.allclose(sizes(boxes), EXPECTED, atol=6e-4) and np.isclose(boxes.opening_m_max, 0.062)


#: A four-bar finger would close on itself: here two links are tied by a point, and a motor opens the gripper.
MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="mount" pos="0 0 0.01"><geom type="box" size=".02 .06 .03" pos="0 0 .02"/>
  <body name="left" pos="0 0.009 0.05"><joint name="l" type="slide" axis="0 1 0" range="0 0.03" damping="1"/><geom type="box" size=".005 .004 .02" pos="0 0 .02" mass=".1"/></body>
  <body name="right" pos="0 -0.009 0.05"><joint name="r" type="slide" axis="0 -1 0" range="0 0.03" damping="1"/><geom type="box" size=".005 .004 .02" pos="0 0 .02" mass=".1"/>
  <geom type="sphere" size=".1" contype="0" conaffinity="0"/></body>
  <body name="bar" pos="0 0.009 0.05"><joint name="b" type="slide" axis="0 1 0" damping="1"/><geom type="box" size=".002 .002 .002" mass=".01" contype="0" conaffinity="0"/></body></body>
  </worldbody><equality><joint joint1="r" joint2="l"/>{tie}</equality><actuator><position joint="l" kp="100" ctrlrange="0 0.03"/></actuator></mujoco>"""


@pytest.mark.parametrize("tie", ['<joint joint1="b" joint2="l"/>', '<connect body1="bar" body2="left" anchor="0 0 0"/>'])
def test_a_model_of_mujoco_opens_by_its_joints_or_its_motors(tmp_path, tie):
    path = tmp_path / "gripper.xml"
    path.write_text(MJCF.format(tie=tie))
    boxes = from_description(path, FINGERS)
    assert abs(boxes.opening_m_max - 2 * (0.009 + 0.03 - 0.004)) < 0.0012 and abs(boxes.opening_m_min - 0.01) < 0.0012
    assert np.allclose(sizes(boxes), EXPECTED, atol=1.2e-3)
    assert np.allclose(boxes.flange_from_grasp[:3, 3], [0, 0, 0.1], atol=1e-3)
    assert np.allclose(from_description(path, FINGERS, flange="mount").flange_from_grasp[:3, 3], [0, 0, 0.09], atol=1e-3)


THIRD = f"""<link name="thumb">{shape(JAW, (0.03, 0, 0.02))}</link><joint name="third" type="prismatic"><parent link="base"/>
  <child link="thumb"/><origin xyz="0 0 0.06"/><axis xyz="1 0 0"/><limit lower="0" upper="0.01" effort="1" velocity="1"/></joint>"""


@pytest.mark.parametrize(("made", "fingers", "why"), [
    ({}, ("left", "thumb"), "no link is called 'thumb'; there are base, left, right"),
    ({}, ("left",), "fingers must be two links, got 1"),
    ({}, ("left", "right", "base"), "fingers must be two links, got 3"),
    ({}, ("left", "left"), "no joint moves left or left against the palm left"),
    ({"kind": "continuous", "mimic": ""}, FINGERS, "joint follow moves a finger, and so must have limits"),
    ({"more": COARSE}, FINGERS, "and hull reaches 20 mm beyond the tips"),
    ({"more": COARSE.replace("0.08", "0.05")}, FINGERS, "and hull reaches to 10 mm behind the tips"),
    ({"more": TIP}, ("tip", "right"), "it is carried by left, base, world"),
    ({"jaw": shape(("${width}", 1, 1), (0, 0, 0))}, FINGERS, "must be expanded by xacro before: xacro gripper.urdf > expanded.urdf"),
    ({"more": THIRD}, FINGERS, "a gripper must have two fingers, and thumb moves beside their tips"),
    ({"kind": "fixed", "mimic": ""}, ("right", "base"), "no joint moves right or base"),
    ({"mimic": '<mimic joint="nothing"/>'}, FINGERS, "joint follow mimics nothing"),
    ({"jaw": mesh("jaw.stl", (0, 0, 0))}, FINGERS, "the mesh of link left cannot be read"),
    ({"jaw": mesh("jaw.ply", (0, 0, 0))}, FINGERS, "must be STL, OBJ, MSH or DAE"),
    ({"jaw": ""}, FINGERS, "left must have a shape"),
    ({"jaw": "<what"}, FINGERS, "must be a URDF or an MJCF file, got"),
])  # fmt: skip
def test_what_is_no_gripper_is_named(tmp_path, made, fingers, why, capsys):
    path = urdf(tmp_path, **made)
    refused(why, lambda: from_description(path, fingers))
    assert main([str(path), "--fingers", ",".join(fingers)]) == 78
    assert why in capsys.readouterr().err


PROPELLER = f"""<link name="disc">{shape((0.02, 0.02, 0.002), (0, 0, 0))}</link>
  <joint name="propeller" type="continuous"><parent link="base"/><child link="disc"/><origin xyz="0 0 0.03"/><axis xyz="0 0 1"/></joint>"""
MOUNT = '<joint name="mount" type="fixed"><parent link="wrist"/><child link="base"/></joint>'
POST = f"""<link name="post">{shape((0.01, 0.01, 0.2), (0, 0, 0))}</link><joint name="at" type="fixed"><parent link="base"/>
  <child link="post"/><origin xyz="0.1 0 -0.04"/></joint>"""


@pytest.mark.parametrize(("more", "change", "without", "told"), [
    (PROPELLER, ("", ""), (), "no finger moves with joint propeller, which stays as the description has it"),
    (MOUNT, ("", ""), (), "joint mount is left out: there is no link wrist"),
    ("", ('lower="0" upper="0.03"', 'lower="0.03" upper="0"'), (), "lower limit, 0.03, above its upper one, 0: they are swapped"),
    (COARSE, ("", ""), ["hull"], None),
])  # fmt: skip
def test_what_is_beside_the_fingers_is_passed_over_and_said(tmp_path, more, change, without, told):
    path = urdf(tmp_path, more=more)
    path.write_text(path.read_text().replace(*change))
    boxes = from_description(path, FINGERS, without=without)
    assert np.allclose(sizes(boxes), EXPECTED, atol=6e-4) and np.isclose(boxes.opening_m_max, 0.062)
    assert [told in note for note in boxes.notes] == [True] if told else boxes.notes == ()


def test_what_boxes_do_not_have_is_said(tmp_path):
    """Jaws on slanted rails, whose tips come forwards by 0.2 of their way, and a palm with a post far beside it."""
    path = urdf(tmp_path, more=POST)
    for axis, slanted in (("0 1 0", "0 1 -0.2"), ("0 1 0\"", "0 1 0.2\"")):
        path.write_text(path.read_text().replace(axis, slanted, 1))
    boxes = from_description(path, FINGERS)
    assert [note.startswith("the boxes are") for note in boxes.notes] == [True] and boxes.joint == pytest.approx((0.03, -0.001), abs=1e-4)
    assert np.allclose([jaw["slide_m"] for jaw in boxes.jaws], [[0, 0.0304, 0.0061], [0, -0.0304, 0.0061]], atol=2e-4)
    assert from_description(path, FINGERS, without=["post"]).notes == ()


#: A palm that carries a plate of 8 mm, 20 mm beside the axis of a lever of 60 mm, whose other side is 4 mm from its
#: axis.
ONE_JAW = f"""<robot name="one"><link name="palm">{shape((0.06, 0.08, 0.06), (0, 0, 0.03))}{shape((0.025, 0.008, 0.07), (0, -0.024, 0.095))}</link>
<link name="jaw">{shape((0.025, 0.008, 0.07), (0, 0, 0.035))}</link><joint name="j" type="revolute"><parent link="palm"/><child link="jaw"/>
<origin xyz="0 0 0.06"/><axis xyz="-1 0 0"/><limit lower="-0.3" upper="1.6" effort="5" velocity="3"/></joint></robot>"""


@pytest.mark.parametrize("fingers", [("palm", "jaw"), ("jaw", "palm")])
def test_a_jaw_that_turns_beside_a_fixed_one_has_its_axis_and_boxes(tmp_path, fingers):
    path = tmp_path / "one.urdf"
    path.write_text(ONE_JAW)
    boxes = from_description(path, fingers)
    side = fingers.index("jaw")
    fixed, turns = boxes.jaws[1 - side], boxes.jaws[side]
    opened, closed = boxes.joint
    corner = 70 * np.array([np.sin(opened), np.cos(opened)]) + 4 * np.array([-np.cos(opened), np.sin(opened)])
    # The widest opening is where the tip is 10 mm behind the plate's, and the lever's corner meets it at the end.
    assert 59 < corner[1] < 62 and abs(1e3 * boxes.opening_m_max - (corner[0] + 20)) < 0.2 and opened < 1.6
    assert np.isclose(70 * np.sin(closed) - 4 * np.cos(closed), -20, atol=0.3)
    assert np.allclose(turns["turn_rad"], [(opened - closed) * (2 * side - 1), 0, 0], atol=1e-3)
    middle = (corner[0] - 20) / 2
    assert np.allclose(1e3 * turns["pivot_m"], [0, -middle * (2 * side - 1), -corner[1]], atol=0.2)
    assert len(fixed["boxes"]) == 1 and np.allclose(fixed["boxes"][0]["size_m"], [0.025, 0.008, 0.07], atol=1e-4)
    # As it is given the lever is nearly upright, and in its boxes.
    sizes_m = np.array([box["size_m"] for box in turns["boxes"]])
    every, inside = boxes.boxes(), boxes.triangles.reshape(-1, 1, 3)
    assert ((inside > every[:, 0] - 1e-5) & (inside < every[:, 1] + 1e-5)).all(axis=2).any(axis=1).all()
    assert sizes_m[:, 2].sum() > 0.069 and sizes_m[:, 1].max() < 0.0095 and "at 0." in boxes.notes[0]
    gripper = boxes.gripper("one", finger_mass_kg=0.05, finger_force_n=5.0, closing_speed_m_s=0.2)
    read = tomllib.loads("\n".join(lines(gripper, 6)))
    assert read["joint"] == pytest.approx({"open": opened, "closed": closed}, abs=1e-6) and len(read["jaws"][side]["boxes"]) == len(sizes_m)
    # It holds a thing beside its fixed jaw.
    box = graspmill.Object.cuboid((0.02, 0.03, 0.05), (0.15, 0.15, 0.075, 0, 0, 0, 1))
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[:3, 3] = 0.15, 0.15 + (1 - 2 * side) * (0.5 * boxes.opening_m_max - 0.018), 0.075
    assert graspmill.execute(graspmill.Scene([box]), down[None], gripper=gripper).held.all()


def test_a_jaw_that_slides_to_a_fixed_one_goes_the_whole_way(tmp_path):
    boxes = from_description(urdf(tmp_path, kind="fixed", mimic=""), FINGERS)
    assert np.isclose(boxes.opening_m_max, 0.032) and boxes.joint == pytest.approx((0.03, -0.002), abs=1e-4)
    assert np.allclose(boxes.jaws[0]["slide_m"], [0, 0.032, 0], atol=1e-5) and "slide_m" not in boxes.jaws[1]


def test_jaws_that_both_turn_or_travel_on_arcs_have_ways_of_their_own(tmp_path):
    """Two levers of 100 mm; and the same with tips that a second joint keeps upright."""
    lever = shape((0.01, 0.008, 0.1), (0, 0, 0.05))
    for upright in (False, True):
        parts = [f'<link name="base">{shape((0.04, 0.12, 0.06), (0, 0, 0.03))}</link>']
        for name, sign in (("right", -1), ("left", 1)):
            tip = f'{name}_lever' if upright else name
            parts.append(f'<link name="{tip}">{lever}</link><joint name="{name}_j" type="revolute"><parent link="base"/><child link="{tip}"/>'
                         f'<origin xyz="0 {0.004 * sign} 0.06"/><axis xyz="{-sign} 0 0"/><limit lower="0" upper="0.4"/>'
                         + ('<mimic joint="right_j"/>' if sign > 0 else "") + "</joint>")
            if upright:
                parts.append(f'<link name="{name}">{shape(JAW, (0, 0, 0.02))}</link><joint name="{name}_u" type="revolute"><parent link="{tip}"/>'
                             f'<child link="{name}"/><origin xyz="0 0 0.1"/><axis xyz="{sign} 0 0"/><limit lower="0" upper="0.4"/><mimic joint="right_j"/></joint>')
        path = tmp_path / "two.urdf"
        path.write_text(f'<robot name="two">{"".join(parts)}</robot>')
        boxes = from_description(path, ("right", "left"))
        ways = [[*jaw["turn_rad"], *jaw["pivot_m"]] for jaw in boxes.jaws]
        assert boxes.joint == pytest.approx((0.4, 0.0), abs=1e-3) and ["keeps_parallel" in jaw for jaw in boxes.jaws] == [upright] * 2
        opening = 2 * 0.1 * np.sin(0.4) + (0 if upright else 2 * (0.004 - 0.004 * np.cos(0.4)))
        assert abs(boxes.opening_m_max - opening) < 2e-4
        assert np.allclose(np.array(ways)[:, :3], [[-0.4, 0, 0], [0.4, 0, 0]], atol=2e-3)


def test_a_picture_has_the_shapes_within_the_boxes(tmp_path):
    boxes = from_description(urdf(tmp_path), FINGERS)
    for group, axis in zip(ET.fromstring(boxes.picture()).findall("{*}g"), (1, 0), strict=True):
        drawn = [[float(part.get(key)) for key in ("x", "y", "width", "height")] for part in group.findall("{*}rect")]
        low, high = np.min(drawn, axis=0)[:2], np.max([np.add(box[:2], box[2:]) for box in drawn], axis=0)
        points = np.array(" ".join(part.get("points") for part in group.findall("{*}polygon")).split(), float).reshape(-1, 2)
        assert np.allclose([points.min(axis=0), points.max(axis=0)], [low, high], atol=1) and len(drawn) == 3
        assert np.isclose(high[0] - low[0], 1e3 * [boxes.palm_width_m, boxes.palm_breadth_m][axis])


def test_a_gripper_that_never_opens_is_named(tmp_path):
    path = urdf(tmp_path)
    path.write_text(path.read_text().replace("0.005 0.06", "0.0041 0.06").replace("0.03\"", "0.00001\""))
    refused("left and right must open, and are 0.2 mm apart at best", lambda: from_description(path, FINGERS))


def test_the_command_writes_a_file(tmp_path):
    words = [sys.executable, "-m", "graspmill.descriptions", urdf(tmp_path, more=PROPELLER), "--fingers", "left,right", "--out", "mine.toml"]
    words += ["--without", "disc", "--picture", "mine.svg"]
    said = ran(*words, "--mass", "0.05", "--force", "20", "--speed", "0.1", cwd=tmp_path).stdout
    assert "opening_m_max           62.0 mm" in said and "no finger moves with joint propeller" in said and (tmp_path / "mine.svg").exists()
    read = tomllib.loads((tmp_path / "mine.toml").read_text())
    assert read["name"] == "mine" and np.isclose(read["opening_m_max"], 0.062) and read["finger_force_n"] == 20.0
    loaded = graspmill.Gripper.load(tmp_path / "mine.toml")
    assert np.isclose(loaded.finger_thickness_m, 0.008, atol=2e-4) and np.allclose(loaded.flange_from_grasp[:3, 3], [0, 0, 0.1], atol=1e-5)
    assert "--out needs --mass, --force and --speed" in ran(*words, cwd=tmp_path, code=78).stderr
