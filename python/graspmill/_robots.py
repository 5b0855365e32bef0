"""Descriptions of robots, URDF and MJCF, by MuJoCo: which link carries which, how joints move them, and their shapes."""

import itertools
import re
import struct
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from . import _arrays
from .errors import InputError

Floats = NDArray[np.float64]

#: Independent joints of a gripper, each of which is tried at both of its limits.
JOINTS_MAX = 8
#: Seconds for which the actuators of a linkage hold it at an end.
DRIVEN_S = 3.0
#: So many of their ways are looked at.
DRIVEN_STATES = 13
#: Flat sides of what is round, as in the simulation (``FACETS`` of ``schema/src/solid.rs``).
SIDES = 24


def mujoco_module() -> Any:
    try:
        import mujoco  # type: ignore[import-untyped, import-not-found, unused-ignore]
    except ImportError as error:
        raise InputError("a description needs MuJoCo: pip install graspmill[descriptions]") from error
    return mujoco


def mesh_file(name: str, folder: Path) -> Path:
    # The file that a URDF names. It is looked for in the folders above, too, as packages are.
    inside = Path(name.removeprefix("file://").removeprefix("package://"))
    ways = [inside, Path(*inside.parts[1:])] if name.startswith("package://") else [inside]
    places = [above / way for above in [folder, *folder.resolve().parents] for way in ways]
    return next((place for place in places if place.is_file()), folder / ways[-1])


def root_of(path: Path) -> ET.Element:
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise InputError(f"{path} must be a URDF or an MJCF file, got {error}") from error
    is_xacro = any("xacro}" in one.tag or "${" in " ".join(one.attrib.values()) for one in root.iter()) or path.suffix == ".xacro"
    _arrays.must(not is_xacro, f"{path} must be expanded by xacro before: xacro {path.name} > expanded.urdf")
    _arrays.must(root.tag in ("robot", "mujoco"), f"{path} must be a URDF (robot) or an MJCF file (mujoco), got {root.tag}")
    return root


def urdf_model(path: Path, robot: ET.Element) -> tuple[Any, dict[str, tuple[str, float, float]], list[str]]:
    # A model of a URDF's collision shapes, its mimic joints (master, factor and offset), and what was mended.
    for old in robot.findall("mujoco"):
        robot.remove(old)
    options = ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler")
    options.attrib |= {"fusestatic": "false", "boundmass": "1e-3", "boundinertia": "1e-6", "strippath": "false"}
    assets: dict[str, bytes] = {}
    for link in robot.findall("link"):
        other = "collision" if link.find("collision") is None else "visual"
        for shape in [*link.findall("inertial"), *link.findall(other)]:
            link.remove(shape)
        for shape in link.findall("visual"):
            shape.tag = "collision"
        for mesh in link.iter("mesh"):
            file = mesh_file(mesh.get("filename", ""), path.parent)
            ending = file.suffix.lower()
            if ending not in (".stl", ".obj", ".msh", ".dae"):
                raise InputError(f"the mesh of link {link.get('name')} must be STL, OBJ, MSH or DAE: {file}")
            try:
                data = file.read_bytes()
                if ending == ".dae":
                    data = stl(_collada(data))
                elif ending == ".stl" and b"endfacet" in data.lower():  # text, which MuJoCo does not read
                    data = stl(np.array(re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data, re.I), float).reshape(-1, 3, 3))
            except (OSError, ET.ParseError, KeyError, ValueError) as error:
                raise InputError(f"the mesh of link {link.get('name')} cannot be read: {file}: {error}") from error
            mesh.set("filename", name := f"{len(assets)}{'.stl' if ending == '.dae' else ending}")
            assets[name] = data
    mimics, notes = _joints(robot)
    return _compiled(path, ET.tostring(robot, encoding="unicode"), assets), mimics, notes


def _joints(robot: ET.Element) -> tuple[dict[str, tuple[str, float, float]], list[str]]:
    # Takes the mimics from the joints, mends what MuJoCo refuses, and says what it mended.
    links, mimics, notes = {link.get("name") for link in robot.findall("link")}, {}, []
    for joint in robot.findall("joint"):
        name, ends = joint.get("name", ""), [of.get("link") for kind in ("parent", "child") for of in joint.findall(kind)]
        if missing := [end for end in ends if end not in links]:  # a part of a robot
            notes.append(f"joint {name} is left out: there is no link {missing[0]}")
            robot.remove(joint)
        for again in joint.findall("limit")[1:]:  # ROS reads the first one
            joint.remove(again)
        for limit in joint.findall("limit"):
            lower, upper = (_arrays.number(f"joint {name} {end}", limit.get(end, "0"), -1e9, 1e9) for end in ("lower", "upper"))
            if lower > upper:
                notes.append(f"joint {name} has its lower limit, {lower:g}, above its upper one, {upper:g}: they are swapped")
                limit.attrib |= {"lower": str(upper), "upper": str(lower)}
        if (mimic := joint.find("mimic")) is not None:
            parts = (("multiplier", "1"), ("offset", "0"))
            factor, offset = (_arrays.number(f"joint {name} {key}", mimic.get(key, of), -1e9, 1e9) for key, of in parts)
            mimics[name] = (mimic.get("joint", ""), factor, offset)
            joint.remove(mimic)
    return mimics, notes


def _collada(data: bytes) -> Floats:
    # The triangles of a COLLADA file, [N, 3, 3] in metres. As RViz, Gazebo and MoveIt do, ``up_axis`` is ignored.
    root = ET.fromstring(data)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    by_id = {element.get("id"): element for element in root.iter() if element.get("id")}

    def of(reference: str | None) -> ET.Element:
        return by_id[(reference or "").removeprefix("#")]

    def text(element: ET.Element | None) -> list[str]:
        return [] if element is None or element.text is None else element.text.split()

    def corners(mesh: ET.Element) -> Floats:
        found = []
        if other := [part.tag for part in mesh if part.tag in ("polygons", "trifans", "tristrips")]:
            raise ValueError(f"it has {other[0]}; make them triangles")
        for kind in ("triangles", "polylist"):
            for part in mesh.findall(kind):
                inputs = {one.get("semantic"): one for one in part.findall("input")}
                vertices = of(inputs["VERTEX"].get("source"))
                source = of(next(one for one in vertices.findall("input") if one.get("semantic") == "POSITION").get("source"))
                points = np.array(text(source.find("float_array")), float).reshape(-1, 3)
                stride = 1 + max(int(one.get("offset", "0")) for one in part.findall("input"))
                numbers = np.array(text(part.find("p")), int).reshape(-1, stride)[:, int(inputs["VERTEX"].get("offset", "0"))]
                sizes = np.array(text(part.find("vcount")), int) if kind == "polylist" else np.full(len(numbers) // 3, 3)
                starts = np.cumsum(sizes) - sizes
                fans = [(start, start + at, start + at + 1) for start, size in zip(starts, sizes) for at in range(1, size - 1)]
                found.append(points[numbers[np.array(fans, int).reshape(-1, 3)]])
        return np.concatenate(found) if found else np.empty((0, 3, 3))

    def placed(node: ET.Element, above: Floats) -> list[Floats]:
        here = above
        for step in (step for step in node if step.tag in ("matrix", "translate", "scale", "rotate")):
            values, move = np.array(text(step), float), np.eye(4)
            if step.tag == "matrix":
                move = values.reshape(4, 4)
            elif step.tag == "translate":
                move[:3, 3] = values
            elif step.tag == "scale":
                move[:3, :3] = np.diag(values)
            else:
                half = np.radians(values[3]) / 2
                move = _arrays.matrices([[0, 0, 0, *(values[:3] / np.linalg.norm(values[:3]) * np.sin(half)), np.cos(half)]])[0]
            here = here @ move
        meshes = [of(one.get("url")).find("mesh") for one in node.findall("instance_geometry")]
        own = [corners(mesh) @ here[:3, :3].T + here[:3, 3] for mesh in meshes if mesh is not None]
        inner = node.findall("node") + [of(one.get("url")) for one in node.findall("instance_node")]
        return own + [part for child in inner for part in placed(child, here)]

    unit = root.find("asset/unit")
    whole = np.eye(4) * (1.0 if unit is None else float(unit.get("meter", "1")))
    parts = [part for scene in root.iter("visual_scene") for node in scene.findall("node") for part in placed(node, whole)]
    if not parts:
        raise ValueError("it must have a scene with triangles")
    return np.concatenate(parts)


def stl(triangles: Floats) -> bytes:
    rows = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    rows["corners"] = triangles
    return bytes(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def _compiled(path: Path, text: str | None, assets: dict[str, bytes] | None) -> Any:
    mujoco = mujoco_module()
    try:
        spec = mujoco.MjSpec.from_file(str(path)) if text is None else mujoco.MjSpec.from_string(text, assets=assets)
        for mesh in spec.meshes:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # also of thin ones
        return spec.compile()
    except (ValueError, OSError) as error:
        raise InputError(f"{path} cannot be read: {error}") from error


class GripperModel:
    def __init__(self, path: Path, fingers: tuple[str, str], flange: str | None, without: Sequence[str] = ()) -> None:
        self.mujoco, self.path, root = mujoco_module(), path, root_of(path)
        self.model, self.mimics, self.notes = urdf_model(path, root) if root.tag == "robot" else (_compiled(path, None, None), {}, [])
        self.data = self.mujoco.MjData(self.model)
        self.mujoco.mj_kinematics(self.model, self.data)
        self.fingers, self.flange = [self.body(name) for name in fingers], None if flange is None else self.body(flange)
        ways = [self.way(body) for body in self.fingers]
        self.root = self.palm = next(body for body in ways[0] if body in ways[1])
        while self.root and self.model.body_parentid[self.root] and not self.model.body_jntnum[self.root]:
            self.root = int(self.model.body_parentid[self.root])
        bodies = [body for body in range(self.model.nbody) if self.root in self.way(body)]
        self.joints = [joint for joint in range(self.model.njnt) if self.model.jnt_bodyid[joint] in bodies and self.model.jnt_bodyid[joint] != self.root]
        # The fingers that move; the other one is fixed.
        self.moving = [side for side in (0, 1) if self.moves(self.fingers[side])]
        _arrays.must(self.moving, f"no joint moves {' or '.join(fingers)} against the palm {self.name(self.root)}: {path}")
        left_out = self._left_out(without)
        self.geoms = [geom for geom in range(self.model.ngeom) if self.model.geom_bodyid[geom] in set(bodies) - left_out]
        colliding = [geom for geom in self.geoms if self.model.geom_contype[geom] | self.model.geom_conaffinity[geom]]
        self.geoms = colliding or self.geoms
        carriers = [self.way(self.model.geom_bodyid[geom]) for geom in self.geoms]
        # Of each shape the finger that it belongs to: what its link carries; a fixed one may carry the other.
        order = sorted((0, 1), key=lambda side: side not in self.moving)
        self.sides = [next((side for side in order if self.fingers[side] in way), None) for way in carriers]
        for name, way, side in zip(fingers, ways, (0, 1)):
            others = ", ".join(map(self.name, way[1:]))
            _arrays.must(side in self.sides, f"{name} must have a shape, and none of its links has (it is carried by {others}): {path}")

    def body(self, name: str) -> int:
        names = [self.name(body) for body in range(self.model.nbody)]
        _arrays.must(name in names, f"no link is called {_arrays.shown(name)}; there are {', '.join(names[1:]) or 'none'}: {self.path}")
        return names.index(name)

    def _left_out(self, without: Sequence[str]) -> set[int]:
        # The links whose shapes do not count: those named, and Franka's coarse ones, which protect it from itself.
        meshes = {self.name(body) for body in self.model.geom_bodyid[self.model.geom_type == self.mujoco.mjtGeom.mjGEOM_MESH]}
        coarse = [name for name in map(self.name, range(self.model.nbody)) if name.endswith("_sc") and name[:-3] in meshes]
        self.notes += [f"{name} is left out, for {name[:-3]} has the finer shapes" for name in coarse]
        return {self.body(name) for name in [*without, *coarse]}

    def name(self, body: int) -> str:
        return str(self.model.body(body).name)

    def way(self, body: int) -> list[int]:
        return [body, *self.way(int(self.model.body_parentid[body]))] if body else [body]

    def moves(self, body: int) -> bool:
        return any(self.model.jnt_bodyid[joint] in self.way(body) for joint in self.joints)

    def corners(self) -> list[Floats]:
        # Positions of all joints at the limits of those that move the fingers; of a linkage on the way between them.
        model, kinds = self.model, self.mujoco.mjtEq
        states, equal = [], {}
        self.free: list[int] = []
        if {int(kinds.mjEQ_CONNECT), int(kinds.mjEQ_WELD)} & {int(kind) for kind in model.eq_type}:
            return self._driven()
        for number in range(model.neq):
            if model.eq_type[number] == kinds.mjEQ_JOINT and model.eq_obj2id[number] >= 0:
                equal[int(model.eq_obj1id[number])] = (int(model.eq_obj2id[number]), model.eq_data[number, :5])
        for name, (leader, factor, offset) in self.mimics.items():
            try:
                equal[int(model.joint(name).id)] = (int(model.joint(leader).id), np.array([offset, factor, 0, 0, 0]))
            except KeyError as error:
                raise InputError(f"joint {name} mimics {leader}, which is no joint that moves: {self.path}") from error
        carriers = [body for finger in self.fingers for body in self.way(finger)]
        moving = [joint for joint in self.joints if model.jnt_bodyid[joint] in carriers]
        for joint in moving:  # and the joints that they mimic
            moving += [equal[joint][0]] if joint in equal and equal[joint][0] not in moving else []
        free = [joint for joint in self.joints if joint not in equal]
        rule = f"a gripper must have 1 to {JOINTS_MAX} joints that mimic no other, got {len(free)}: {self.path}"
        _arrays.must(0 < len(free) <= JOINTS_MAX, rule)
        if beside := [model.joint(joint).name for joint in free if joint not in moving]:
            self.notes.append(f"no finger moves with joint {', '.join(beside)}, which stays as the description has it")
        self.free = free = [joint for joint in sorted(moving) if joint not in equal]
        for joint in free:
            _arrays.must(model.jnt_limited[joint], f"joint {model.joint(joint).name} moves a finger, and so must have limits: {self.path}")
        for ends in itertools.product((0, 1), repeat=len(free)):
            state = self.data.qpos.copy()
            for one, end in zip(free, ends):
                state[model.jnt_qposadr[one]] = model.jnt_range[one, end]
            for _ in equal:  # a mimic may mimic a mimic
                for follower, (master, factors) in equal.items():
                    state[model.jnt_qposadr[follower]] = np.polynomial.Polynomial(factors)(state[model.jnt_qposadr[master]])
            states.append(state)
        return states

    def _driven(self) -> list[Floats]:
        # The joints of a linkage that closes on itself: where its actuators bring it, without gravity or contacts.
        model, states, data = self.model, [], self.mujoco.MjData(self.model)
        model.opt.gravity[:] = 0.0
        model.opt.disableflags |= int(self.mujoco.mjtDisableBit.mjDSBL_CONTACT)
        limited = model.actuator_ctrllimited.astype(bool)
        for share in np.linspace(0, 1, DRIVEN_STATES):
            data.ctrl[limited] = model.actuator_ctrlrange[limited] @ [1 - share, share]
            self.mujoco.mj_step(model, data, int((DRIVEN_S if share in (0, 1) else DRIVEN_S / 6) / model.opt.timestep))
            states.append(data.qpos.copy())
        return states

    def _palm(self, state: Floats) -> tuple[Floats, Floats]:
        self.data.qpos[:] = state
        self.mujoco.mj_kinematics(self.model, self.data)
        return self.data.xmat[self.palm].reshape(3, 3), self.data.xpos[self.palm]

    def shapes(self, state: Floats) -> list[Floats]:
        # In the frame of the palm.
        turn, at = self._palm(state)
        return [(triangles_of(self.model, self.data, geom) - at) @ turn for geom in self.geoms]

    def pose(self, state: Floats, body: int) -> Floats:
        (turn, at), pose = self._palm(state), np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn.T @ self.data.xmat[body].reshape(3, 3), (self.data.xpos[body] - at) @ turn
        return pose


def surface_of(model: Any, geoms: Iterable[int]) -> Floats:
    # The triangles of some shapes, [N, 3, 3], with the joints as the description has them.
    mujoco = mujoco_module()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    parts = [triangles_of(model, data, geom, SIDES) for geom in geoms]
    _arrays.must(parts, "it must have a shape")
    return np.concatenate(parts)


def triangles_of(model: Any, data: Any, geom: int, sides: int = 4) -> Floats:
    # The triangles of a shape, [N, 3, 3], in the world. What is round has so many flat sides; of 4 it is the box around
    # it.
    kinds = mujoco_module().mjtGeom
    kind, size = kinds(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        corners = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        own = corners[model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]]
    elif kind == kinds.mjGEOM_BOX:
        own = _box(size)
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        size = size if kind == kinds.mjGEOM_ELLIPSOID else size[[0, 0, 0]]
        own = _box(size) if sides == 4 else _turned(*_ball(1.0, 0.0, sides), sides) * size
    elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        (radius, half), is_capsule = size[:2], kind == kinds.mjGEOM_CAPSULE
        ends = np.array([0, radius, radius, 0]), np.array([-half, -half, half, half])
        radii, heights = _ball(radius, half, sides) if is_capsule else ends
        own = _box(np.array([radius, radius, half + radius * is_capsule])) if sides == 4 else _turned(radii, heights, sides)
    else:
        raise InputError(f"a shape must be a mesh, box, cylinder, sphere, capsule or ellipsoid, got {kind.name}")
    return np.asarray(own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])


def _ball(radius: float, half: float, sides: int) -> tuple[Floats, Floats]:
    # Radii and heights of a ball's rings, its halves apart along z: a capsule.
    up = np.linspace(0, np.pi / 2, sides // 4 + 1)
    across, height = radius * np.cos(up).round(12), radius * np.sin(up) + half
    return np.append(across[::-1], across), np.append(-height[::-1], height)


def _turned(radii: Floats, heights: Floats, sides: int) -> Floats:
    # The triangles of rings about z, from the lowest to the highest.
    angles = np.arange(sides) * (2 * np.pi / sides)
    round_z = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1).round(12)
    rings = radii[:, None, None] * round_z + heights[:, None, None] * np.array([0, 0, 1])
    low, high = rings[:-1], rings[1:]
    low_next, high_next = (np.roll(some, -1, axis=1) for some in (low, high))
    triangles = np.stack([low, low_next, high_next, low, high_next, high], axis=2).reshape(-1, 3, 3)
    a, b, c = triangles.transpose(1, 0, 2)
    return np.asarray(triangles[np.cross(b - a, c - a).any(axis=1)])


def _box(half: Floats) -> Floats:
    corners = np.array(list(itertools.product(*[(-x, x) for x in half])))
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return np.asarray(corners[np.array([[a, b, c] for a, b, c, _ in sides] + [[a, c, d] for a, _, c, d in sides])])
