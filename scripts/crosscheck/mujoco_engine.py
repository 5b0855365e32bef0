"""MuJoCo as the third engine.

Set up for hard contacts: elliptic cones, friction as stiff as the normal direction, a slip-removing pass, and pairs with
the product of both frictions (MuJoCo would take the larger). The palm is a body of a ton on a slide along the retreat,
whose position and speed are written before every step.
"""

from dataclasses import dataclass
from itertools import combinations, product
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from .contract import GEAR_DAMPING_N_S_M, GEAR_STIFFNESS_N_M, Environment, Gripper, Scene
from .jaws import Jaw
from .pose import Pose

FINGERS = ("left", "right")
PALM_MASS_KG = 1000.0
# Of the arm on which a jaw goes along an arc, which has no mass in our physics.
ARM_MASS_SHARE = 1e-3
TABLE_HALF_M = (1.5, 1.5, 0.5)


@dataclass(frozen=True)
class MujocoOptions:
    """Settings that may matter. `contact_time_s` is the time constant of a contact's spring, at least two steps."""

    step_rate_hz: float = 480.0
    contact_time_s: float = 1 / 240
    impedance: float = 0.99
    friction_stiffness: float = 10.0
    noslip_iterations: int = 10


class Mujoco:
    """A MuJoCo world; see `crosscheck.attempt.Engine`."""

    name = "mujoco"

    def __init__(self, options: MujocoOptions = MujocoOptions()):
        self.options = options
        self.step_rate_hz = options.step_rate_hz

    def close(self) -> None:
        """Nothing to let go of."""

    def load(self, scene: Scene, gripper: Gripper, environment: Environment) -> None:
        """Compiles a scene and a gripper."""
        self._gripper, self._count = gripper, len(scene.objects)
        self._model = self._compiled(_model_xml(scene, gripper, environment, self.options))
        self._data = mujoco.MjData(self._model)
        model = self._model
        self._bodies = [model.body(f"object{i}").id for i in range(self._count)]
        self._geoms = [[model.geom(name).id for name in _parts(scene, i)] for i in range(self._count)]
        self._finger_geoms = [[model.geom(name).id for name in names] for names in _fingers(gripper).values()]
        self._gripper_geoms = [*sum(self._finger_geoms, []), model.geom("palm").id]
        self._table_geom = model.geom("table").id
        self._fixture_geoms = [model.geom(name).id for name in _fixtures(scene)]
        self._moving = [jaw.way_m > 0 for jaw in gripper.each_jaw]
        # How far a tip goes for each unit of its joint: the lever of a jaw that turns.
        self._levers = {name: jaw.lever_m or 1.0 for name, jaw in zip(FINGERS, gripper.each_jaw) if jaw.way_m}
        self._levers |= {f"{name}_back": -jaw.lever_m for name, jaw in zip(FINGERS, gripper.each_jaw) if jaw.goes_on_arc}
        self._slides = {name: model.joint(name).qposadr[0] for name in (*self._levers, "palm")}
        self._speeds = {name: model.joint(name).dofadr[0] for name in (*self._levers, "palm")}

    def _compiled(self, xml: str) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(xml)

    def begin(self, workspace_from_grasp: Pose | None, retreat: np.ndarray | None) -> None:
        """The scene as stored; a gripper that is not wanted is put out of the way."""
        mujoco.mj_resetData(self._model, self._data)
        pose = workspace_from_grasp or Pose(np.array([0.0, 0.0, 5.0]), np.array([0.0, 0.0, 0.0, 1.0]))
        self._model.jnt_axis[self._model.joint("palm").id] = pose.rotation.T @ (np.eye(3)[2] if retreat is None else retreat)
        self._distance_m = 0.0
        self.place(pose)
        self.hold_open(False)

    def place(self, workspace_from_grasp: Pose) -> None:
        """Moves the gripper's root."""
        root = self._model.body("root").id
        self._model.body_pos[root] = workspace_from_grasp.position_m
        self._model.body_quat[root] = np.roll(workspace_from_grasp.quat_xyzw, 1)
        mujoco.mj_kinematics(self._model, self._data)

    def hold_open(self, is_open: bool) -> None:
        """Fingers stand still, or close: full force when stopped, no force at full speed."""
        speed, force = self._gripper.closing_speed_m_s, self._gripper.finger_force_n
        self._actuate([0.0, 0.0] if is_open else [force, force], force / speed, force)
        # A finger whose speed is not the one wanted is at its force limit, where the implicit step leaves the damping
        # out: it would jump to many times its speed, stop, and jump again.
        for name, lever_m in self._levers.items():
            self._data.qvel[self._speeds[name]] = 0.0 if is_open else speed / lever_m

    def _actuate(self, forces_n: list[float], damping_n_s_m: float, limit_n: float) -> None:
        self._data.ctrl[:] = np.array(forces_n)[self._moving]
        self._model.actuator_biasprm[:, 2] = -damping_n_s_m
        self._model.actuator_forcerange[:] = (-limit_n, limit_n)

    def step(self) -> None:
        """One step; the palm ends at its commanded position."""
        data, rate = self._data, self.step_rate_hz
        now = data.qpos[self._slides["palm"]]
        data.qvel[self._speeds["palm"]] = (self._distance_m - now) * rate
        mujoco.mj_step(self._model, data)
        data.qpos[self._slides["palm"]] = self._distance_m

    def closed_m(self) -> tuple[float, float]:
        """How far the fingers have closed."""
        left, right = (self._levers[name] * float(self._data.qpos[self._slides[name]]) if name in self._levers else 0.0 for name in FINGERS)
        return left, right

    def _forces_n(self, asymmetry_m: float) -> list[float]:
        """Finger force and, of two jaws that move, gear spring."""
        left, right = self.closed_m()
        spring = GEAR_STIFFNESS_N_M * (left - right - asymmetry_m) / 2 if all(self._moving) else 0.0
        return [self._gripper.finger_force_n - spring, self._gripper.finger_force_n + spring]

    def press(self, asymmetry_at_contact_m: float) -> None:
        """Finger force and gear spring; the damper is the actuators' bias."""
        self._actuate(self._forces_n(asymmetry_at_contact_m), GEAR_DAMPING_N_S_M, 100 * self._gripper.finger_force_n)

    def move_to(self, distance_m: float) -> None:
        """Where the palm ends the next step."""
        self._distance_m = distance_m

    def positions_m(self) -> np.ndarray:
        """Origins of the objects' frames (n, 3)."""
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos[self._bodies].copy()

    def quats_xyzw(self) -> np.ndarray:
        """Orientations of the objects (n, 4)."""
        mujoco.mj_kinematics(self._model, self._data)
        return np.roll(self._data.xquat[self._bodies], -1, axis=1)

    def grips(self, target: int) -> bool:
        """Whether both fingers press on an object."""
        return all(any(self._normal_force_n(c) > 0 for c in self._contacts(finger, target)) for finger in self._finger_geoms)

    def _contacts(self, finger: list[int], target: int) -> list[int]:
        pairs = [{own, geom} for own in finger for geom in self._geoms[target]]
        return [c for c in range(self._data.ncon) if {*self._data.contact[c].geom} in pairs]

    def _normal_force_n(self, contact: int) -> float:
        force = np.zeros(6)
        mujoco.mj_contactForce(self._model, self._data, contact, force)
        return float(force[0])

    def nearest(self, target: int, reach_m: float) -> str | None:
        """What the gripper comes nearer to than `reach_m`, by MuJoCo's own distance query."""
        mujoco.mj_kinematics(self._model, self._data)
        others = [geom for i, geoms in enumerate(self._geoms) if i != target for geom in geoms]
        things = {"target": self._geoms[target], "other": others, "container": self._fixture_geoms, "table": [self._table_geom]}
        for name, geoms in things.items():
            if any(self._distance(part, geom, reach_m) <= reach_m for part in self._gripper_geoms for geom in geoms):
                return name
        return None

    def _distance(self, a: int, b: int, reach_m: float) -> float:
        return mujoco.mj_geomDistance(self._model, self._data, a, b, 2 * reach_m + 1e-3, None)


def _model_xml(scene: Scene, gripper: Gripper, environment: Environment, options: MujocoOptions) -> str:
    """The model; element and attribute names are MuJoCo's."""
    indices = range(len(scene.objects))
    parts = {i: _parts(scene, i) for i in indices}
    frictions = {name: scene.objects[i].friction for i in indices for name in parts[i]}
    fingers = sum(_fingers(gripper).values(), [])
    own = dict.fromkeys(("palm", *fingers), gripper.friction)
    among = [pair for i, j in combinations(indices, 2) for pair in product(parts[i], parts[j])]
    pairs = [(a, b, frictions[a] * frictions[b]) for a, b in among]
    pairs += [(a, b, frictions[a] * own[b]) for a in frictions for b in own]
    for fixed in ("table", *_fixtures(scene)):
        pairs += [(a, fixed, frictions[a] * environment.table_friction) for a in frictions]
        pairs += [(finger, fixed, gripper.friction * environment.table_friction) for finger in fingers]
    shapes = [shape for i in indices for shape in zip(parts[i], scene.objects[i].solid.convexes)]
    shapes += zip(_fixtures(scene), scene.fixtures)
    meshes = "".join(_tag("mesh", name=name, vertex=part.vertices_m.ravel()) for name, part in shapes)
    fixtures = "".join(_tag("geom", name=name, type="mesh", mesh=name) for name in _fixtures(scene))
    table = _tag("geom", name="table", type="box", size=TABLE_HALF_M, pos=(0, 0, environment.table_z_m - TABLE_HALF_M[2]))
    option = _tag(
        "option", timestep=1 / options.step_rate_hz, gravity=(0, 0, -environment.gravity_m_s2), cone="elliptic",
        integrator="implicitfast", impratio=options.friction_stiffness, noslip_iterations=options.noslip_iterations,
    )  # fmt: skip
    shared = {"solref": (options.contact_time_s, 1), "solimp": (options.impedance, options.impedance, 1e-4)}
    contacts = "".join(_tag("pair", geom1=a, geom2=b, condim=3, friction=(mu, mu, 0, 0, 0), **shared) for a, b, mu in pairs)
    drive = {"gainprm": 1, "biastype": "affine", "biasprm": (0, 0, -1), "forcelimited": "true", "forcerange": (-1, 1)}
    moving = [(name, jaw) for name, jaw in zip(FINGERS, gripper.each_jaw) if jaw.way_m]
    motors = "".join(_tag("general", joint=name, gear=jaw.lever_m or 1, **drive) for name, jaw in moving)
    # What goes along an arc without turning turns back by as much on its arm.
    backs = "".join(_tag("joint", joint1=f"{name}_back", joint2=name, polycoef=(0, -1, 0, 0, 0), **shared) for name, jaw in moving if jaw.goes_on_arc)
    bodies = "".join(_object_xml(i, scene) for i in indices)
    return (
        f"<mujoco><compiler angle='radian'/>{option}<default><geom contype='0' conaffinity='0'/></default><asset>{meshes}</asset>"
        f"<worldbody>{table}{fixtures}{bodies}{_gripper_xml(gripper)}</worldbody>"
        f"<contact>{contacts}</contact><equality>{backs}</equality><actuator>{motors}</actuator></mujoco>"
    )


def _parts(scene: Scene, index: int) -> list[str]:
    """Names of the shapes of an object's convex parts."""
    count = len(scene.objects[index].solid.convexes)
    return [f"object{index}"] if count == 1 else [f"object{index}part{part}" for part in range(count)]


def _fixtures(scene: Scene) -> list[str]:
    """Names of the shapes of the fixtures."""
    return [f"fixture{number}" for number in range(len(scene.fixtures))]


def _object_xml(index: int, scene: Scene) -> str:
    o, name = scene.objects[index], f"object{index}"
    inertia = o.solid.inertia_kg_m2(o.mass_kg)
    # A solid's axes are principal ones; a compound's tensor is given whole: xx, yy, zz, xy, xz, yz.
    moments = {"diaginertia": inertia} if inertia.ndim == 1 else {"fullinertia": inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]}
    inertial = _tag("inertial", pos=o.solid.centroid_m, mass=o.mass_kg, **moments)
    pose = o.workspace_from_object
    geoms = "".join(_tag("geom", name=part, type="mesh", mesh=part) for part in _parts(scene, index))
    inside = f"<freejoint/>{inertial}{geoms}"
    return _tag("body", inside, name=name, pos=pose.position_m, quat=np.roll(pose.quat_xyzw, 1))


def _fingers(gripper: Gripper) -> dict[str, list[str]]:
    """Names of the shapes of both jaws."""
    return {name: [name, *(f"{name}{i}" for i in range(1, len(jaw.boxes)))] for name, jaw in zip(FINGERS, gripper.each_jaw)}


def _gripper_xml(gripper: Gripper) -> str:
    jaws = zip(_fingers(gripper).items(), gripper.each_jaw)
    fingers = "".join(_jaw_xml(*name_and_geoms, jaw, gripper.finger_mass_kg) for name_and_geoms, jaw in jaws)
    box = gripper.palm()
    palm = _tag("geom", name="palm", type="box", size=box.half_m, pos=box.centre_m) + fingers
    return _tag("body", _body_xml("palm", box.centre_m, PALM_MASS_KG, palm, type="slide", axis=(0, 0, 1)), name="root")


def _body_xml(name: str, at_m: np.ndarray, mass_kg: float, inside: str, **joint: object) -> str:
    """A part of the gripper with its mass at a point, on a joint of its name if it has one."""
    held = _tag("joint", name=name, **joint) if joint else ""
    inertial = _tag("inertial", pos=at_m, mass=mass_kg, diaginertia=(mass_kg * 1e-3,) * 3)
    return _tag("body", held + inertial + inside, name=name, gravcomp=1)


def _jaw_xml(name: str, geoms: list[str], jaw: Jaw, mass_kg: float) -> str:
    """A jaw whose mass is at its tip."""
    place = jaw.open_from_given
    inside = "".join(
        _tag("geom", name=geom, type="box", size=box.half_m, pos=place.apply(box.centre_m), quat=np.roll(place.quat_xyzw, 1))
        for geom, box in zip(geoms, jaw.boxes)
    )  # fmt: skip
    joint = {"limited": "true", "range": (0, jaw.way_m / (jaw.lever_m or 1))}
    if not jaw.lever_m:
        return _body_xml(name, jaw.tip_m, mass_kg, inside, **({"type": "slide", "axis": jaw.slide_m, **joint} if jaw.way_m else {}))
    joint |= {"type": "hinge", "axis": jaw.turn_rad, "pos": jaw.pivot_m}
    if not jaw.goes_on_arc:
        return _body_xml(name, jaw.tip_m, mass_kg, inside, **joint)
    held = _body_xml(f"{name}_back", jaw.tip_m, mass_kg, inside, type="hinge", axis=jaw.turn_rad, pos=jaw.tip_m)
    return _body_xml(name, jaw.pivot_m, ARM_MASS_SHARE * mass_kg, held, **joint)


def _tag(kind: str, inside: str = "", **attributes: object) -> str:
    def text(value: object) -> str:
        if isinstance(value, str):
            return value
        return " ".join(f"{x:.12g}" for x in np.atleast_1d(value))

    shown = " ".join(f"{key}={quoteattr(text(value))}" for key, value in attributes.items())
    return f"<{kind} {shown}>{inside}</{kind}>"
