"""A scene as simulators take it: what moves, what stands still, the cameras, the gripper and the attempts. Lengths are
in metres, quaternions x, y, z, w; numbers keep the precision in which our physics has them."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Sequence, Union

import numpy as np
from numpy.typing import NDArray

from ... import _arrays, _native
from ...grippers import LENGTHS, Gripper
from ...scene import OUTCOMES

#: Half lengths of the table; its top is in the middle of the workspace.
TABLE_HALF_M = (1.5, 1.5, 0.5)
#: Density of a palm's box, in kg/m³, because a gripper's file has no mass for it.
PALM_DENSITY_KG_M3 = 1000.0
#: What single precision of the corners leaves off an inertia's diagonal, as a share of the trace; it would turn a
#: cylinder's axes by chance.
ROUNDING_SHARE = 1e-7
UNITS = "metres, kilograms, seconds, newtons, radians; poses: position x y z, then quaternion x y z w; "
UNITS += "target_from_source maps a source's coordinates to the target"
FRAMES = "workspace: z up; grasp: midway between the finger tips, +z the approach, +y the closing direction; "
FRAMES += "camera: x right, y down, z forward"

Single = np.float32
Singles = NDArray[np.float32]


def singles(*values: Any) -> Singles:
    return np.array(values, np.float32)


class Box(NamedTuple):
    """A box: its centre and half lengths, ``[3]`` each, in the frame of its body."""

    centre_m: Singles
    half_m: Singles


class Hull(NamedTuple):
    """A convex part: corners ``[N, 3]``, and the corners of each face by number, counter-clockwise from outside."""

    corners_m: Singles
    faces: list[list[int]]

    def triangles(self) -> NDArray[np.intp]:
        return np.array([[ring[0], ring[i], ring[i + 1]] for ring in self.faces for i in range(1, len(ring) - 1)])


Parts = dict[str, Union[Box, Hull]]


class Mass(NamedTuple):
    """Mass, its centre ``[3]`` in the body's frame, the inertia about it along the body's axes (xx, yy, zz, xy, xz, yz), the
    principal moments ``[3]``, and the rotation from their axes to the body's."""

    mass_kg: np.float32
    centre_m: Sequence[float]
    inertia_kg_m2: Sequence[float]
    moments_kg_m2: Sequence[float]
    axes: Sequence[float] = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Still:
    """What stands still: its friction, and its convex parts in the workspace by their names."""

    name: str
    friction: np.float32
    parts: Parts


@dataclass(frozen=True)
class Body(Still):
    """What moves: its parts in its own frame, its mass, and its pose ``[7]``."""

    mass: Mass
    pose: Singles


class World:
    """A scene of a dataset: ``plain``, the content of ``scene.json``; the ``objects``; the table and the container, if there is
    one, which stand ``still``; the ``gripper_parts``, palm and fingers in the grasp frame; the ``gripper``'s numbers, the way
    ``stroke_m`` of a finger and its force over its speed, ``damping``; half of the workspace's side, ``middle_m``; poses ``[7]`` of
    the ``cameras`` in OpenGL's axes (x right, y up, z backwards); and their ``lens``: width, height, fx, fy, cx, cy in pixels."""

    def __init__(self, dataset: _native.Dataset, info: dict[str, Any], scene_id: int) -> None:
        scene, simulation, self.rows = dataset.scene(scene_id)
        bodies, walls = dataset.hulls(scene_id)
        physics, grid = info["config"]["physics"], info["grid"]
        friction, table_z_m, self.middle_m = Single(physics["table_friction"]), Single(grid["table_z_m"]), Single(grid["size_m"] / 2)
        centre_m = singles(self.middle_m, self.middle_m, table_z_m - Single(TABLE_HALF_M[2]))
        self.still = [Still("table", friction, {"table": Box(centre_m, singles(*TABLE_HALF_M))})]
        if walls:
            self.still.append(Still("container", friction, _named("container", [_hull(wall) for wall in walls])))
        gripper = Gripper._of(simulation)
        rule = f"a scene's gripper must have fingers that slide alike to be exported, and {gripper.name} has jaws of its own"
        _arrays.must(not gripper.jaws, rule)
        self.gripper = {key: Single(getattr(gripper, key)) for key in LENGTHS}
        self.stroke_m = Single(self.gripper["opening_m_max"] / 2)
        self.damping = Single(self.gripper["finger_force_n"] / self.gripper["closing_speed_m_s"])
        self.gripper_parts = _gripper_parts(self.gripper, self.stroke_m)
        self.lens = dataset.intrinsics()
        self.cameras = [singles(*at, w, z, -y, -x) for *at, x, y, z, w in self.rows["workspace_from_camera"]]
        self.objects: list[Body] = []
        self.plain: dict[str, Any] = {"format": "graspmill-scene/1", "units": UNITS, "frames": FRAMES}
        self.plain |= {"dataset_id": dataset.id, "scene_id": scene_id, "gravity_m_s2": Single(physics["gravity_m_s2"])}
        self.plain |= {"table": {"z_m": table_z_m, "friction": friction}, "container": None, "objects": []}
        self.plain["cameras"] = [self._camera(number, pose) for number, pose in enumerate(self.rows["workspace_from_camera"])]
        self.plain |= {"hand": {"name": gripper.name, **self.gripper}, "attempts": self._attempts()}
        if scene.container is not None:
            kind, (x_m, y_m, *sizes), _ = scene.container
            lengths = dict(zip(("height_m", "thickness_m", "slope_rad"), singles(*sizes)))
            self.plain["container"] = {"kind": kind, "inner_m": singles(x_m, y_m), **lengths, "friction": friction}
        for number, (pose, hulls) in enumerate(zip(scene.poses(), bodies)):
            found = scene.object(number)
            assert found is not None
            shape, mass_kg, friction = found[0], Single(found[1]), Single(found[2])
            parts = [_hull(one) for one in hulls]
            name, extents_m, mass = f"object_{number}", singles(*shape.extents_m), _mass(parts, mass_kg)
            # A model may have a primitive's name.
            is_box = shape.name == "cuboid" and not info.get("models")
            named = _named(name, [Box(singles(0, 0, 0), extents_m / Single(2))] if is_box else parts)
            self.objects.append(Body(name, friction, named, mass, pose))
            about = {"name": name, "shape": shape.name, "extents_m": extents_m, "workspace_from_object": pose, "mass_kg": mass_kg}
            of_mass = {"friction": friction, "centre_of_mass_m": mass.centre_m, "inertia_kg_m2": mass.inertia_kg_m2}
            self.plain["objects"].append({**about, **of_mass})

    def field_of_view_rad(self) -> float:
        return 2.0 * math.atan(0.5 * self.lens[1] / self.lens[3])

    def hulls(self) -> dict[str, Hull]:
        parts = [entry for body in (*self.objects, *self.still) for entry in body.parts.items()]
        return {name: part for name, part in parts if isinstance(part, Hull)}

    def _camera(self, number: int, pose: Singles) -> dict[str, Any]:
        lens = dict(zip(("width_px", "height_px"), map(int, self.lens))) | dict(zip(("fx_px", "fy_px", "cx_px", "cy_px"), singles(*self.lens[2:])))
        return {"name": f"camera_{number}", "workspace_from_camera": pose, **lens, "vertical_field_of_view_rad": self.field_of_view_rad()}

    def _attempts(self) -> list[dict[str, Any]]:
        keys = ("attempt_id", "object", "workspace_from_grasp", "outcome", "width_m")
        rows = enumerate(zip(*(self.rows[key] for key in ("target", *keys[2:]))))
        told = ((number, f"object_{of}", pose, OUTCOMES[end], width if width == width else None) for number, (of, pose, end, width) in rows)
        return [dict(zip(keys, row)) for row in told]


def _hull(plain: tuple[list[list[float]], list[list[int]]]) -> Hull:
    return Hull(np.array(plain[0], np.float32), plain[1])


def _named(name: str, parts: Sequence[Box | Hull]) -> Parts:
    return {f"{name}_part_{number}": part for number, part in enumerate(parts)}


def _gripper_parts(gripper: dict[str, np.float32], stroke_m: np.float32) -> list[Body]:
    palm, finger = (
        singles(*(gripper[f"{part}_{side}_m"] for side in sides)) / Single(2)
        for part, sides in (("palm", ("width", "breadth", "length")), ("finger", ("width", "thickness", "length")))
    )
    palm_kg = np.cumprod(singles(8, *palm, PALM_DENSITY_KG_M3), dtype=np.float32)[-1]
    bodies = []
    for name, y_m, z_m, half_m, mass_kg in (
        ("palm", 0, -gripper["finger_length_m"] - palm[2], palm, palm_kg),
        ("left_finger", -(stroke_m + finger[1]), -finger[2], finger, gripper["finger_mass_kg"]),
        ("right_finger", stroke_m + finger[1], -finger[2], finger, gripper["finger_mass_kg"]),
    ):
        box, squares = Box(singles(0, y_m, z_m), half_m), (half_m * half_m).astype(float).tolist()
        # A third of the mass times the squares of the half lengths.
        moments = [float(mass_kg) / 3.0 * (sum(squares) - square) for square in squares]
        mass = Mass(mass_kg, box.centre_m.astype(float).tolist(), [*moments, 0.0, 0.0, 0.0], moments)
        bodies.append(Body(name, gripper["friction"], {name: box}, mass, singles(0, 0, 0, 0, 0, 0, 1)))
    return bodies


def _mass(parts: list[Hull], mass_kg: np.float32) -> Mass:
    """Of parts of one density. Parts that overlap count twice there, as in our physics."""
    # Volume, first and second moments of the tetrahedra between the triangles and the origin.
    integrals = np.zeros(13)
    for part in parts:
        a, b, c = np.moveaxis(part.corners_m.astype(float)[part.triangles()], 1, 0)
        x, y, z = (b[:, i] * c[:, j] - c[:, i] * b[:, j] for i, j in ((1, 2), (2, 0), (0, 1)))
        volumes, total = (a[:, :1] * x[:, None] + a[:, 1:2] * y[:, None] + a[:, 2:] * z[:, None]) / 6.0, a + b + c
        squares = _outer(total) + (_outer(a) + _outer(b) + _outer(c))
        rows = np.hstack([volumes, volumes * total / 4.0, volumes * squares / 20.0])
        integrals += np.cumsum(rows, axis=0)[-1]  # one after the other: every machine gives the same bits
    centre = integrals[1:4] / integrals[0]
    spread = integrals[4:].reshape(3, 3) / integrals[0] - np.outer(centre, centre)
    tensor = float(mass_kg) * (np.eye(3) * (spread[0, 0] + spread[1, 1] + spread[2, 2]) - spread)
    six = [float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return Mass(mass_kg, centre.tolist(), six, *_principal(tensor.tolist()))


def _outer(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return (rows[:, :, None] * rows[:, None, :]).reshape(-1, 9)


def _principal(m: list[list[float]]) -> tuple[list[float], Sequence[float]]:
    """The eigenvalues of a symmetric matrix and the rotation from its axes, by Jacobi's rotations, which are exact also where
    eigenvalues are equal. A diagonal matrix keeps its axes."""
    axes = np.eye(3).tolist()
    size = sum(abs(m[i][i]) for i in range(3))
    for p, q in 32 * ((0, 1), (0, 2), (1, 2)):
        if abs(m[p][q]) > ROUNDING_SHARE * size:
            ratio = (m[q][q] - m[p][p]) / (2.0 * m[p][q])
            tangent = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
            cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
            sine = cosine * tangent
            for row in (*m, *axes):
                row[p], row[q] = cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]
            m[p], m[q] = [cosine * a - sine * b for a, b in zip(m[p], m[q])], [sine * a + cosine * b for a, b in zip(m[p], m[q])]
    columns = np.array(axes)
    # An axis has no sign: the third one is that which makes the frame right-handed.
    columns[:, 2] = np.cross(columns[:, 0], columns[:, 1])
    return [m[i][i] for i in range(3)], _arrays.quaternions(columns[None])[0].astype(np.float32)
