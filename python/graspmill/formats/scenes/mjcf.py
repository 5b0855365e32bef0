"""Scenes for MuJoCo.

``scene.xml`` is a model: ``mujoco.MjModel.from_xml_path("scene.xml")``. ``hand.xml`` is the gripper, in its grasp frame;
velocities of its two actuators close it.

Two bodies have the product of their frictions in our physics, in MuJoCo the larger of the two. So the pairs of a
scene's bodies are listed with their products; what a user adds meets them by MuJoCo's own rule. Contacts are as hard as
in the cross-check (``scripts/crosscheck/mujoco_engine.py``): with MuJoCo's soft default objects creep.
"""

import math
from itertools import product
from typing import Any

from .._files import joined, number
from ._world import Body, Box, Single, Still, World

#: The time constant of a contact must be at least twice the length of a step.
HARD = 'condim="3" solref="0.004 1" solimp="0.99 0.99 0.0001"'
#: Colours of objects, in turn.
COLOURS = ("0.8 0.35 0.3", "0.3 0.55 0.8", "0.4 0.7 0.4", "0.85 0.65 0.3", "0.6 0.45 0.75", "0.5 0.7 0.7")


def files(world: World) -> dict[str, str]:
    return {"scene.xml": "\n".join(_scene(world)), "hand.xml": "\n".join(_gripper(world))}


def _placed(pose: Any) -> str:
    x, y, z, w = pose[3:]
    return f'pos="{joined(pose[:3])}" quat="{joined((w, x, y, z))}"'


def _box(box: Any) -> str:
    return f'type="box" pos="{joined(box.centre_m)}" size="{joined(box.half_m)}"'


def _scene(world: World) -> list[str]:
    (table, *containers), (width, height, *_) = world.still, map(int, world.lens)
    middle, friction = number(world.middle_m), number(table.friction)
    lines = [
        f'<mujoco model="scene-{world.plain["scene_id"]:09}">',
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option timestep="0.002" gravity="0 0 {number(-world.plain["gravity_m_s2"])}" cone="elliptic" integrator="implicitfast" '
        'impratio="10" noslip_iterations="10"/>',
        f'  <visual><global offwidth="{width}" offheight="{height}"/></visual>',
        f"  <default>\n    <geom {HARD}/>\n    <pair {HARD}/>\n  </default>\n  <asset>",
        *(f'    <mesh name="{name}" vertex="{joined(hull.corners_m.flat)}"/>' for name, hull in world.hulls().items()),
        f'  </asset>\n  <worldbody>\n    <light pos="{middle} {middle} 2" dir="0 0 -1" directional="true"/>',
        f'    <geom name="table" {_box(table.parts["table"])} friction="{friction}" rgba="0.75 0.75 0.72 1"/>',
    ]
    for name in (name for container in containers for name in container.parts):
        lines.append(f'    <geom name="{name}" type="mesh" mesh="{name}" friction="{friction}" rgba="0.6 0.65 0.7 1"/>')
    angle = number(math.degrees(world.field_of_view_rad()))
    for camera, pose in enumerate(world.cameras):
        lines.append(f'    <camera name="camera_{camera}" {_placed(pose)} fovy="{angle}" resolution="{width} {height}"/>')
    for body, colour in zip(world.objects, COLOURS * len(world.objects)):
        lines += _body(body, f'friction="{number(body.friction)}" rgba="{colour} 1"')
    lines.append("  </worldbody>\n  <contact>")
    for place, body in enumerate(world.objects):
        still = Still("still", table.friction, {name: part for one in world.still for name, part in one.parts.items()})
        for other in (still, *world.objects[place + 1 :]):
            both = number(Single(body.friction * other.friction))
            for one, two in product(body.parts, other.parts):
                lines.append(f'    <pair geom1="{one}" geom2="{two}" friction="{both} {both}"/>')
    return [*lines, "  </contact>\n</mujoco>\n"]


def _body(body: Body, look: str) -> list[str]:
    centre, inertia = joined(body.mass.centre_m), joined(body.mass.inertia_kg_m2)
    lines = [f'    <body name="{body.name}" {_placed(body.pose)}>\n      <freejoint name="{body.name}"/>']
    lines.append(f'      <inertial pos="{centre}" mass="{number(body.mass.mass_kg)}" fullinertia="{inertia}"/>')
    for name, part in body.parts.items():
        shape = f'type="box" size="{joined(part.half_m)}"' if isinstance(part, Box) else f'type="mesh" mesh="{name}"'
        lines.append(f'      <geom name="{name}" {shape} {look}/>')
    return [*lines, "    </body>"]


def _gripper(world: World) -> list[str]:
    """A palm with two fingers that slide, in the grasp frame. A finger's motor has its full force at rest and none at its
    speed, as in our physics. A limit of the force would be reached at rest, and MuJoCo's implicit step leaves the damping
    out where it is: a finger would jump to many times its speed."""
    palm, left, right = (
        f'<geom name="{body.name}" {_box(body.parts[body.name])} mass="{number(body.mass.mass_kg)}" friction="{number(body.friction)}"/>'
        for body in world.gripper_parts
    )
    lines = [
        '<mujoco model="hand">\n  <compiler autolimits="true"/>\n  <option integrator="implicitfast"/>\n  <worldbody>',
        f'    <body name="hand">\n      <site name="grasp" size="0.002"/>\n      {palm}',
    ]
    for name, geom, inwards in (("left_finger", left, 1), ("right_finger", right, -1)):
        joint = f'<joint name="{name}" type="slide" axis="0 {inwards} 0" range="0 {number(world.stroke_m)}"/>'
        lines.append(f'      <body name="{name}" gravcomp="1">\n        {joint}\n        {geom}\n      </body>')
    lines.append("    </body>\n  </worldbody>\n  <contact>")
    for one, other in (("hand", "left_finger"), ("hand", "right_finger"), ("left_finger", "right_finger")):
        lines.append(f'    <exclude body1="{one}" body2="{other}"/>')
    lines.append("  </contact>\n  <actuator>")
    damping, speed = number(world.damping), number(world.gripper["closing_speed_m_s"])
    for name in ("left_finger", "right_finger"):
        lines.append(f'    <velocity name="{name}" joint="{name}" kv="{damping}" ctrlrange="-{speed} {speed}"/>')
    return [*lines, "  </actuator>\n</mujoco>\n"]
