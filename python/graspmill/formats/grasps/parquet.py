"""Sets of ``graspmill objects annotate``: ``NAME.parquet``, and ``NAME.json`` beside it (``docs/object-grasps.md``)."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import _arrays
from ...object_grasps import GRASPS_MAX, NUMBERS, stable_pose
from .._files import loaded_json, module
from ._parts import GripperFrame

WHAT = "Parquet"
#: Columns with one number a grasp, by our names.
COLUMNS = {name: name for name, shape in NUMBERS.items() if not shape and name not in ("score", "opening_m")}
COLUMNS["on_table_share"] = "free_on_table_share"


def read(path: str, _: GripperFrame) -> dict[str, Any]:
    beside = os.path.splitext(path)[0] + ".json"
    _arrays.must(os.path.isfile(beside), f"NAME.json must be beside NAME.parquet, got none: {beside}")
    info = _arrays.table("the file", loaded_json(beside))
    with open(path, "rb") as opened:
        # Threads of Arrow that are still about as a program ends may abort it.
        rows = module("pyarrow.parquet", "NAME.parquet").read_table(opened, use_threads=False, pre_buffer=False)
    # What is null is NaN.
    return of_columns({name: rows[name].to_numpy(zero_copy_only=False) for name in rows.column_names}, info)


def of_columns(columns: dict[str, Any], info: dict[str, Any]) -> dict[str, Any]:
    """The arguments of an ``ObjectGrasps`` of such a table, and of what is said beside it."""

    # Up to 0.3.0 there are no clearances, and the share of the repeats of grasps that held.
    columns = {"clearance_m": (), "pushed_m": (), "p_held": columns.get("robust_share", ()), **columns}

    def column(name: str) -> NDArray[Any]:
        return np.asarray(_arrays.entry(name, columns))

    thing = _arrays.table("object", _arrays.entry("object", info))
    poses = np.stack([column(name) for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")], axis=1)
    points = {
        key: np.stack([column(name.format(side, axis)) for side in ("left", "right") for axis in "xyz"], axis=1)
        for key, name in (("contacts_m", "{}_{}_m"), ("normals", "{}_normal_{}"))
    }
    stable = [stable_pose(one) for one in _arrays.listed("stable_poses", info.get("stable_poses", []))]
    _arrays.must((free := column("free_on_table")).dtype.kind in "iu", f"free_on_table must be whole numbers, got {free.dtype}")
    bits = free.astype(np.uint64)[:, None] >> np.arange(len(stable), dtype=np.uint64)
    return {
        **{key: str(_arrays.entry(f"object.{key}", thing)) for key in ("name", "file")},
        "scale_m": _arrays.entry("object.scale_m", thing),
        "object_from_grasp": _arrays.of_quaternions("poses", poses, GRASPS_MAX),
        "held": column("held"),
        **{key: np.array(column(key).tolist(), np.str_) for key in ("outcome", "source")},
        **{key: corners.reshape(-1, 2, 3) for key, corners in points.items()},
        **{ours: column(theirs) for ours, theirs in COLUMNS.items()},
        "is_free_on_table": (bits & np.uint64(1)).astype(bool),
        "stable_poses": stable,
        "base_to_tips_m": _arrays.number("base_to_tips_m", _arrays.entry("base_to_tips_m", info), 0.0, 10.0),
        "info": info,
    }
