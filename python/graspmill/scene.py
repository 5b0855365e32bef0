"""Scenes and the label oracle, which executes grasps in physics. The workspace is a cube with its origin at a lower
corner and z up. A grasp's origin is midway between the finger tips; +z is its approach, +y its closing direction."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass, field
from typing import Any, Iterable, Mapping, Sequence, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native, grippers
from .cameras import Camera
from .errors import InputError
from .grippers import GripperLike

#: The outcomes of an attempt, by their numbers; the label is 1 for the last, ``held``.
OUTCOMES: tuple[str, ...] = tuple(_native.Dataset.names()[0])
#: What the gripper may hit, by its number; -1 is nothing.
HITS: tuple[str, ...] = tuple(_native.Dataset.names()[1])

#: Longest object, in metres.
EXTENT_M_MAX = 2.0
#: Farthest corner of a mesh from its origin along an axis, in metres: single precision has steps of 8 µm there.
FAR_M_MAX = 100.0
#: Parts that leave a mesh's surface by more than this are warned of, in metres.
OFF_M = 0.002
#: Density of objects whose mass is not given, in kg/m³: the middle of the range of ``paper.toml``.
DENSITY_KG_M3 = 500.0
#: Truncation of a TSDF, in voxels, as in the shipped configs.
TRUNCATION_VOXELS = 4.0
_SETTINGS_HELP = "`graspmill manual markdown settings` lists the keys"


_Self = TypeVar("_Self")


class Immutable:
    """An object that never changes is its own copy."""

    def __copy__(self: _Self) -> _Self:
        return self

    def __deepcopy__(self: _Self, _: Any) -> _Self:
        return self


@dataclass(frozen=True, eq=False, init=False)
class Object(Immutable):
    """An object: a shape with mass and friction, at a pose. Make one with :meth:`cuboid`, :meth:`solid` or :meth:`mesh`.

    Attributes:
        name: The shape's name, or the mesh's.
        extents_m: Full lengths of the bounding box along its axes, ``[3]``.
        friction: Coulomb coefficient; a contact multiplies it by that of the gripper or the table.
        workspace_from_object: Its pose, ``[4, 4]``. The origin of its frame is the centre of its bounding box.
    """

    name: str
    extents_m: NDArray[np.float64]
    mass_kg: float
    friction: float
    workspace_from_object: NDArray[np.float64]
    _body: _native.Body = field(repr=False)
    _pose: tuple[float, ...] = field(repr=False)

    @classmethod
    def _of(cls, body: _native.Body, pose: ArrayLike, mass_kg: float | None, friction: float) -> Object:
        if not 1e-3 <= (size_m := max(body.extents_m)) <= EXTENT_M_MAX:
            raise InputError(f"the object must be 0.001 to {EXTENT_M_MAX:g} m long, got {size_m:g}: are its lengths in metres?")
        # What is thin is light, but not weightless.
        mass = max(DENSITY_KG_M3 * body.volume_m3, 1e-6) if mass_kg is None else mass_kg
        mass = _arrays.number("mass_kg", mass, 1e-6, 1e3)
        return cls._wrap(body, mass, _arrays.number("friction", friction, 0.0, 10.0), tuple(_arrays.pose("pose", pose)))

    @classmethod
    def _wrap(cls, body: _native.Body, mass_kg: float, friction: float, pose: tuple[float, ...]) -> Object:
        made = cls.__new__(cls)
        vars(made).update(name=body.name, extents_m=np.array(body.extents_m, np.float64), mass_kg=mass_kg, friction=friction)
        vars(made).update(workspace_from_object=_arrays.matrices([pose])[0], _body=body, _pose=pose)
        return made

    @classmethod
    def solid(cls, shape: str, extents_m: ArrayLike, pose: ArrayLike, *, mass_kg: float | None = None, friction: float = 1.0) -> Object:
        """A primitive shape: ``cuboid``, ``cylinder``, ``tri_prism`` or ``half_cylinder``.

        Args:
            extents_m: Full lengths along its axes, ``[3]``.
            pose: ``workspace_from_object``, ``[4, 4]``, ``[7]`` or ``[3]``.
            mass_kg: Mass; by default that of a density of 500 kg/m³. ``friction`` is a Coulomb coefficient.
        """
        extents = [float(part) for part in _arrays.floats("extents_m", extents_m, (3,))]
        return cls._of(_native.Body.solid(_arrays.text("shape", shape), extents), pose, mass_kg, friction)

    @classmethod
    def cuboid(cls, extents_m: ArrayLike, pose: ArrayLike, *, mass_kg: float | None = None, friction: float = 1.0) -> Object:
        """A box; see :meth:`solid`."""
        return cls.solid("cuboid", extents_m, pose, mass_kg=mass_kg, friction=friction)

    @classmethod
    def mesh(
        cls, mesh: Any, pose: ArrayLike, *, name: str = "mesh", mass_kg: float | None = None, friction: float = 1.0,
        parts_max: int = 1024, corners_max: int = 32, tolerance_m: float = 0.0008,
    ) -> Object:  # fmt: skip
        """A triangle mesh, which cameras see, and its convex parts, which physics uses. Mass and friction are as for :meth:`solid`.

        Args:
            mesh: ``(vertices, faces)`` of shapes ``[V, 3]`` (metres) and ``[F, 3]``, or what has them, as a ``trimesh.Trimesh``.
            pose: ``workspace_from_mesh``: the pose of the mesh's own frame.
            parts_max: Most convex parts, 1 to 1024 (1: its hull, also for cameras), and ``corners_max`` corners of each, 8 to 256.
            tolerance_m: The mesh is cut until its parts leave its surface by no more than this; of 2 mm it is warned.
        """
        with _arrays.read_as("mesh must be (vertices, faces), or have these attributes", type(mesh)):
            vertices, faces = (mesh.vertices, mesh.faces) if hasattr(mesh, "vertices") else mesh
        corners = _arrays.floats("mesh vertices", vertices, (None, 3))
        if len(corners) and (size_m := float(np.ptp(corners, axis=0).max())) > EXTENT_M_MAX:
            raise InputError(f"mesh vertices must be within {EXTENT_M_MAX:g} m of each other, got {size_m:g}: are they in metres?")
        far_m = float(np.abs(corners).max(initial=0.0))
        _arrays.must(far_m <= FAR_M_MAX, f"mesh vertices must be within {FAR_M_MAX:g} m of their origin, got {far_m:g}: move them there")
        triangles = _arrays.numbered("mesh faces", faces, (None, 3), len(corners), "vertices")
        _arrays.must(len(triangles), "mesh faces must not be empty")
        limits = _arrays.whole("parts_max", parts_max, 1, 1024), _arrays.whole("corners_max", corners_max, 8, 256)
        tolerance_m = _arrays.number("tolerance_m", tolerance_m, 0.000_05, 0.01)
        body = _native.Body.mesh(_arrays.text("name", name) or "mesh", corners, triangles, *limits, tolerance_m)
        if body.off_m > OFF_M:
            warnings.warn(f"{name}: its parts leave its surface by up to {1e3 * body.off_m:.1f} mm: more parts_max or corners_max", stacklevel=2)
        workspace_from_mesh = _arrays.matrices([_arrays.pose("pose", pose)])[0]
        centre = np.eye(4)
        centre[:3, 3] = body.centre_m
        return cls._of(body, workspace_from_mesh @ centre, mass_kg, friction)

    def parts(self) -> list[NDArray[np.float32]]:
        """The corners of each convex part, ``[N, 3]`` in the object's frame, in metres, as physics uses them."""
        return self._body.parts()


@dataclass(frozen=True)
class Container(Immutable):
    """What objects lie in: it stands on the table in the middle of the workspace, its sides along x and y, and never moves.

    Attributes:
        kind: ``bin`` and ``tray`` have four walls; a ``shelf`` has a back at +y, two sides and a board over them.
        inner_m: Lengths along x and y between the walls' upper edges, ``(x, y)``.
        height_m: Height of the walls above the table, which lean outwards by ``slope_rad``; a shelf's board is on them.
        workspace_size_m: Side of the workspace, into which it must fit.
    """

    kind: str
    inner_m: tuple[float, float]
    height_m: float
    thickness_m: float = 0.004
    slope_rad: float = 0.0
    workspace_size_m: float = 0.30

    @classmethod
    def _of(cls, plain: tuple[str, Sequence[float], float]) -> Container:
        x_m, y_m, *others = map(_arrays.shortest, (*plain[1], plain[2]))
        return cls(plain[0], (x_m, y_m), *others)

    def _plain(self) -> tuple[str, list[float], float]:
        lengths = [*_arrays.floats("inner_m", self.inner_m, (2,)), self.height_m, self.thickness_m, self.slope_rad]
        sizes = [float(part) for part in _arrays.floats("container", lengths, (5,))]
        return _arrays.text("kind", self.kind), sizes, _arrays.number("workspace_size_m", self.workspace_size_m, 0.05, 5.0)


class Scene(Immutable):
    """Objects at their poses on a table, or in a container on it; :meth:`settle` lets them come to rest. ``table_z_m`` is the height
    of the table's top in the workspace, in metres; 0.05 in the shipped configs."""

    def __init__(self, objects: Iterable[Object], *, table_z_m: float = 0.05, container: Container | None = None) -> None:
        _arrays.must(container is None or isinstance(container, Container), "container must be a graspmill.Container", container)
        given = _arrays.listed("objects", objects)
        for number, one in enumerate(given):
            _arrays.must(isinstance(one, Object), f"objects must be graspmill.Object; number {number} is not", one)
        bodies, masses, frictions, rows = ([getattr(one, name) for one in given] for name in ("_body", "mass_kg", "friction", "_pose"))
        poses, height_m = np.array(rows, np.float32).reshape(len(given), 7), _arrays.number("table_z_m", table_z_m, -1.0, 1.0)
        self._native = _native.Scene(bodies, masses, frictions, poses, height_m, None if container is None else container._plain())
        self._simulation: _native.Simulation | None = None
        #: The scene of a dataset that it is, or was before it settled again.
        self._stored: tuple[_native.Dataset, int] | None = None

    def _with(self, scene: _native.Scene) -> Scene:
        made = Scene.__new__(Scene)
        vars(made).update(vars(self), _native=scene)
        return made

    @classmethod
    def _of(cls, stored: tuple[_native.Dataset, int]) -> tuple[Scene, dict[str, Any]]:
        made = cls.__new__(cls)
        made._native, made._simulation, rows = stored[0].scene(stored[1])
        made._stored = stored
        return made, rows

    @classmethod
    def _again(cls, objects: list[Object], table_z_m: float, container: Container | None, stored: tuple[_native.Dataset, int] | None) -> Scene:
        """What pickle makes: the simulation of a stored scene is read from its dataset."""
        made = cls(objects, table_z_m=table_z_m, container=container)
        return made if stored is None else cls._of(stored)[0]._with(made._native)

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene._again, (self.objects, self.table_z_m, self.container, self._stored)

    def __len__(self) -> int:
        return len(self._native)

    def __repr__(self) -> str:
        return f"Scene([{', '.join(one.name for one in self.objects)}])"

    @property
    def objects(self) -> list[Object]:
        """The objects, with their poses."""
        found = map(self._native.object, range(len(self)))
        return [Object._wrap(*one, tuple(pose)) for one, pose in zip(found, self._native.poses().tolist()) if one]

    @property
    def table_z_m(self) -> float:
        """Height of the table's top, in metres."""
        return self._native.table_z_m

    @property
    def container(self) -> Container | None:
        """What the objects lie in; ``None`` on the bare table."""
        plain = self._native.container
        return None if plain is None else Container._of(plain)

    def settle(self, *, drop: bool = False, settings: Mapping[str, Any] | None = None) -> Scene:
        """The scene at rest, after simulation. Objects that leave the workspace are removed; those that overlap at first may stay so.

        Args:
            drop: Whether they fall one after the other into a box around the workspace, as in generated piles, or all at once.
            settings: Keys of a generator's config, such as ``{"settle.time_s_max": 8.0}``.

        Raises DataError if they do not come to rest, or are thrown apart."""
        return self._with(self._native.settle(self._simulation_with(None, settings), _arrays.flag("drop", drop)))

    def _simulation_with(self, gripper: GripperLike | None, settings: Mapping[str, Any] | None) -> _native.Simulation:
        """The simulation of a stored scene, or the paper's, with another gripper and other settings."""
        if self._simulation is None:
            return _simulation(gripper, settings)
        pairs = _pairs(gripper, settings)
        return self._simulation.adjusted(pairs) if pairs else self._simulation

    def render(self, camera: Camera) -> NDArray[np.float32]:
        """The depth image of a camera, ``[height, width]``, in metres along its z; 0 where it sees nothing."""
        _arrays.must(isinstance(camera, Camera), "camera must be a graspmill.Camera", camera)
        return self._native.render(camera._intrinsics(), camera._pose())

    def tsdf(self, cameras: Sequence[Camera], *, resolution: int = 40, size_m: float = 0.30) -> NDArray[np.float32]:
        """The TSDF of the scene as cameras see it, ``[resolution] * 3`` (x, y, z) in VGN's values: (tsdf + 1) / 2 where
        it was observed, else 0; the surface is at 0.5."""
        cameras = [cameras] if isinstance(cameras, Camera) else _arrays.listed("cameras", cameras)
        return tsdf([self.render(camera) for camera in cameras], cameras, resolution=resolution, size_m=size_m)


def tsdf(depths: Sequence[ArrayLike], cameras: Sequence[Camera], *, resolution: int = 40, size_m: float = 0.30) -> NDArray[np.float32]:
    """Fuses depth images into a TSDF in VGN's values, ``[resolution] * 3`` (x, y, z), float32.

    Args:
        depths: Images, ``[height, width]`` each, in metres, of the ``cameras``; 0 or NaN where nothing was seen.
        resolution: Voxels along a side, 2 to 256, of a workspace of ``size_m`` metres.
    """
    images, cameras = _images(depths, cameras)
    lenses, poses = [camera._intrinsics() for camera in cameras], [camera._pose() for camera in cameras]
    side, size_m = _arrays.whole("resolution", resolution, 2, 256), _arrays.number("size_m", size_m, 0.01, 10.0)
    return _native.fuse(images, lenses, poses, side, size_m, TRUNCATION_VOXELS).reshape(side, side, side)


def _images(depths: Sequence[ArrayLike], cameras: Sequence[Camera]) -> tuple[list[NDArray[np.float32]], list[Camera]]:
    """Depth images that fit their cameras; what is not finite and positive becomes 0."""
    depths, cameras = _arrays.listed("depth images", depths), _arrays.listed("cameras", cameras)
    _arrays.must(len(depths) == len(cameras), f"there must be as many cameras as depth images, {len(depths)}, got {len(cameras)}")
    _arrays.must(1 <= len(cameras) <= 32, f"there must be 1 to 32 depth images, got {len(cameras)}")
    images = []
    for number, (depth, camera) in enumerate(zip(depths, cameras)):
        _arrays.must(isinstance(camera, Camera), f"camera {number} must be a graspmill.Camera", camera)
        array = _arrays.given(f"depth image {number}", depth)
        if array.dtype.kind != "f":
            hint = "; divide a 16-bit image in millimetres by 1000" if array.dtype.kind in "iu" else ""
            raise InputError(f"depth image {number} must have a float dtype, in metres, got {array.dtype}{hint}")
        if list(array.shape) != (shape := [camera.height_px, camera.width_px]):
            raise InputError(f"depth image {number} must have its camera's shape [height, width], {shape}, got {list(array.shape)}")
        with np.errstate(invalid="ignore", over="ignore"):
            single = array.astype(np.float32)
            images.append(np.ascontiguousarray(np.where(np.isfinite(single) & (single > 0.0), single, np.float32(0.0))))
    return images, cameras


@dataclass(frozen=True, eq=False)
class Outcomes:
    """The outcomes of attempts.

    Attributes:
        outcome: ``[N]`` uint8, numbers of :data:`OUTCOMES`.
        width_m: ``[N]`` float32, the opening between the fingers at the end; NaN where they never closed.
        hit: ``[N]`` int8, what was hit, a number of :data:`HITS`, and ``hit_object``, int32, which object; -1 for none.
        target: ``[N]`` uint32, the object that each grasp was meant to hold.
    """

    outcome: NDArray[np.uint8]
    width_m: NDArray[np.float32]
    hit: NDArray[np.int8]
    hit_object: NDArray[np.int32]
    target: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.outcome)

    @property
    def held(self) -> NDArray[np.bool_]:
        """``[N]`` bool: the label."""
        return np.equal(self.outcome, OUTCOMES.index("held"))

    @property
    def names(self) -> list[str]:
        """Names of the outcomes."""
        return [OUTCOMES[number] for number in self.outcome]

    def __repr__(self) -> str:
        counts = {name: int((self.outcome == number).sum()) for number, name in enumerate(OUTCOMES)}
        return "Outcomes(" + ", ".join(f"{name}={count}" for name, count in counts.items() if count) + ")"


def execute(
    scene: Scene, grasps: ArrayLike, *, gripper: GripperLike | None = None, targets: ArrayLike | None = None,
    settings: Mapping[str, Any] | None = None, threads: int | None = None,
) -> Outcomes:  # fmt: skip
    """Executes grasps in physics, each in a fresh copy of a scene at rest: the label oracle, in their order.

    The open gripper appears 50 mm behind the grasp, approaches in a straight line, closes, retreats and holds; ``docs/label.md`` is
    the contract. The same arguments give the same bits on any number of threads.

    Args:
        grasps: ``workspace_from_grasp``, matrices ``[N, 4, 4]`` or positions and quaternions ``[N, 7]``.
        gripper: A :class:`Gripper`, a built-in one's name or a file's path; by default the stored scene's, else ``parallel_jaw_80``.
        targets: ``[N]``, the object that each grasp is for; by default the one nearest to the finger tips.
        settings: Keys of a generator's config, ``{"procedure.hold_time_s": 1.0}``; others are the stored scene's, else the paper's.
        threads: Number of threads, by default one per core; 1 is the caller's own thread.
    """
    _arrays.must(isinstance(scene, Scene), "scene must be a graspmill.Scene", scene)
    rows = _arrays.poses("grasps", grasps)
    simulation = scene._simulation_with(gripper, settings)
    chosen = None if targets is None else _arrays.numbered("targets", targets, (len(rows),), len(scene), "objects")
    return Outcomes(*_native.execute(scene._native, rows, chosen, simulation, _arrays.threads(threads)))


def _simulation(gripper: GripperLike | None, settings: Mapping[str, Any] | None) -> _native.Simulation:
    return _native.Simulation(None, _pairs(gripper, settings))


def _pairs(gripper: GripperLike | None, settings: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    return setting_pairs(settings) + ([] if gripper is None else [("gripper", grippers.setting(gripper))])


def setting_pairs(settings: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """Settings as ``--set`` of the programs takes them: keys, and values in TOML."""
    pairs = []
    _arrays.must(settings is None or isinstance(settings, Mapping), f"settings must be a dict ({_SETTINGS_HELP})", settings)
    for key, value in (settings or {}).items():
        _arrays.must(isinstance(key, str), f"settings must have strings as keys ({_SETTINGS_HELP})", key)
        with _arrays.read_as(f"settings[{key!r}] must be a number, a string, a bool or a list of them", value):
            value = value.item() if isinstance(value, np.generic) else value
            is_gripper = isinstance(value, grippers.Gripper)
            toml = grippers.setting(value) if is_gripper else json.dumps(value, allow_nan=False, ensure_ascii=False)
        pairs.append((_arrays.text("settings", key), _arrays.text(f"settings[{key!r}]", toml)))
    return pairs
