"""Scenes for PyBullet and others: URDF, one robot a body, and the meshes of their hulls as OBJ.

``table.urdf`` and ``container.urdf`` are in the workspace's frame and stand still. URDF has no place for poses:
``object_N.urdf`` goes to the pose ``workspace_from_object`` of ``scene.json``, ``hand.urdf`` to a
``workspace_from_grasp``. ``contact`` is not of URDF's standard: Bullet reads the friction there, others ignore it.
"""

from .._files import joined, number
from ._world import Body, Box, Hull, Still, World

#: Of what stands still: without it Bullet assumes a kilogram, and warns.
STILL = '    <inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>\n'


def files(world: World) -> dict[str, str]:
    palm, *fingers = world.gripper_parts
    gripper, stroke = _link(palm, "hand"), number(world.stroke_m)
    force, speed = (number(world.gripper[key]) for key in ("finger_force_n", "closing_speed_m_s"))
    for finger, inwards in zip(fingers, (1, -1)):
        gripper += f"""{_link(finger, finger.name)}  <joint name="{finger.name}" type="prismatic">
    <parent link="hand"/>
    <child link="{finger.name}"/>
    <axis xyz="0 {inwards} 0"/>
    <limit lower="0" upper="{stroke}" effort="{force}" velocity="{speed}"/>
  </joint>
"""
    robots = {body.name: _link(body, body.name) for body in (*world.still, *world.objects)} | {"hand": gripper}
    texts = {f"{name}.urdf": f'<?xml version="1.0"?>\n<robot name="{name}">\n{links}</robot>\n' for name, links in robots.items()}
    return texts | {f"meshes/{name}.obj": _obj(hull) for name, hull in world.hulls().items()}


def _link(body: Still, name: str) -> str:
    inertial, shapes = STILL, ""
    if isinstance(body, Body):
        xx, yy, zz, xy, xz, yz = map(number, body.mass.inertia_kg_m2)
        inertial = f"""    <inertial>
      <origin xyz="{joined(body.mass.centre_m)}"/>
      <mass value="{number(body.mass.mass_kg)}"/>
      <inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>
    </inertial>
"""
    for part_name, part in body.parts.items():
        at, geometry = "0 0 0", f'<mesh filename="meshes/{part_name}.obj"/>'
        if isinstance(part, Box):
            at, geometry = joined(part.centre_m), f'<box size="{joined(part.half_m + part.half_m)}"/>'
        for kind in ("visual", "collision"):
            shapes += f'    <{kind}><origin xyz="{at}"/><geometry>{geometry}</geometry></{kind}>\n'
    contact = f'    <contact><lateral_friction value="{number(body.friction)}"/></contact>\n'
    return f'  <link name="{name}">\n{contact}{inertial}{shapes}  </link>\n'


def _obj(hull: Hull) -> str:
    corners = [f"v {joined(corner)}\n" for corner in hull.corners_m]
    return "".join(corners + [f"f {joined(triangle)}\n" for triangle in hull.triangles() + 1])
