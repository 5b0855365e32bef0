"""Sets of grasps and their files, for tests of ``graspmill.object_grasps``."""

import numpy as np
import pytest

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
ObjectGrasps, read_grasps, InputError = graspmill.ObjectGrasps, graspmill.read_grasps, graspmill.InputError

ENDINGS = {form: ending[1:] for ending, form in reversed(graspmill.formats.grasps.ENDINGS.items()) if form != "parquet"}
NEEDS = {"acronym": "h5py", "isaac_grasp": "yaml"}
FORMATS = list(ENDINGS)
#: From straight above at (0.01, 0.02, 0.03) m, closing along y: x = y × z.
ABOVE = np.array([[-1, 0, 0, 0.01], [0, 1, 0, 0.02], [0, 0, -1, 0.03], [0, 0, 0, 1.0]])
BASE_M = 0.1123
FRANKA = {"name": "franka_hand", "opening_m_max": 0.08, "finger_width_m": 0.021}
#: A box on the table, a camera that sees it, and a grasp of it from straight above.
BOX = graspmill.Object.cuboid((0.04, 0.06, 0.05), (0.15, 0.15, 0.075))
BOXED, CAMERA = graspmill.Scene([BOX]), graspmill.Camera.look_at((0.15, -0.2, 0.5))
DOWN = np.array([[1, 0, 0, 0.15], [0, -1, 0, 0.15], [0, 0, -1, 0.06], [0, 0, 0, 1]], dtype=float)


#: The corners and triangles of a box of 40 x 50 x 60 mm whose lowest corner is the origin.
BOX_MESH = (
    np.array([[x, y, z] for x in (0, 0.04) for y in (0, 0.05) for z in (0, 0.06)]),
    np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]),
)


def box_obj(size, corner=(0, 0, 0)):
    """The OBJ of a box, whose lowest corner is there."""
    corners = [[low + length * (number >> axis & 1) for axis, (low, length) in enumerate(zip(corner, size))] for number in range(8)]
    faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
    return "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + faces


#: A YAML of 700 bytes, at whose end an alias stands for 9 ** 9 numbers.
ALIASES = "a: &-0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(f"b{n}: &-{n} [{', '.join([f'*-{n - 1}'] * 9)}]\n" for n in range(1, 9))


def needs(*forms):
    """Skips a test where a package for one of these formats is not installed."""
    for package in filter(None, map(NEEDS.get, forms)):
        pytest.importorskip(package, reason=f"{package} is not installed: scripts/requirements.txt has it")


def one_above(**more):
    values = {"held": [True], "width_m": [0.05], "base_to_tips_m": BASE_M, "info": {"gripper": FRANKA}, **more}
    return ObjectGrasps("mug", ABOVE[None], file="meshes/mug.obj", scale_m=0.001, **values)


def many(count=50, seed=4):
    """A set of random grasps of which everything is known, in double precision."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    poses[:, :3, 2] *= np.linalg.det(poses[:, :3, :3])[:, None]
    poses[:, :3, 3] = rng.uniform(-0.1, 0.1, (count, 3))
    held = np.arange(count) % 3 > 0
    known = {"contacts_m": np.where(held[:, None, None], rng.normal(size=(count, 2, 3)), np.nan)}
    known |= {"width_m": np.where(held, rng.uniform(0.001, 0.08, count), np.nan), "closing_moved_m": rng.uniform(0, 0.01, count)}
    known |= {"closing_turned_rad": rng.uniform(0, 1, count), "test_moved_m": np.where(held, rng.uniform(0, 0.01, count), np.nan)}
    known |= {"test_turned_rad": rng.uniform(0, 1, count), "friction_min": np.where(held, rng.uniform(0.1, 1, count), np.nan)}
    inertia = [[3e-5, -1e-6, 2e-6], [-1e-6, 4e-5, 3e-6], [2e-6, 3e-6, 5e-5]]
    solid = {"mass_kg": 0.03, "friction": 0.8, "density_kg_m3": 150.0, "volume_m3": 2e-4, "inertia_kg_m2": inertia}
    info = {"object": {**solid, "centre_of_mass_m": [0.0, 0.01, 0.02]}, "gripper": FRANKA, "test": "shake"}
    known |= {"held": held, "p_held": np.arange(count) % 13 / 12, "base_to_tips_m": BASE_M, "info": info}
    return ObjectGrasps("set", poses, file="meshes/a mug.obj", scale_m=0.25, **known)


def saved(grasps, tmp_path, form, **options):
    needs(form)
    return grasps.save(tmp_path / f"set.{ENDINGS[form]}", **options)


def again(path, form, **options):
    return read_grasps(path, **({"base_to_tips_m": BASE_M} if form == "isaac_grasp" else {}), **options)


def keys_of(batch):
    """What tells samples of a batch of `graspmill.torch.GraspStream` apart."""
    rows = zip(batch["voxel"].tolist(), batch["rotation"].tolist(), batch["label"].tolist())
    return [(*voxel, *rotation, label) for voxel, rotation, label in rows]


def points_of(depth_m):
    """What an image of 640 x 480 pixels shows, in its camera's frame: [N, 3], in metres."""
    v, u = np.nonzero(depth_m)
    z = depth_m[v, u]
    return np.stack([(u - 320.0) / 540.0 * z, (v - 240.0) / 540.0 * z, z], axis=1).astype(np.float32)


def refused(match, call):
    with pytest.raises(InputError, match=match) as told:
        call()
    assert isinstance(told.value, ValueError) and told.value.exit_code == 78
