"""GraspGen's JSON."""

import json
from typing import Any

import numpy as np

from ... import _arrays
from ...object_grasps import GRASPS_MAX, ObjectGrasps, labels
from .._files import loaded_json
from ._parts import GripperFrame, about, from_base, gripper_name, labelled, opening_m, to_base, word

WHAT = "JSON"
#: From the base to the tips of its own grippers, in metres, by its meshes: its ``depth`` ends between the pads. A depth
#: that is further off is another's, such as 0 for an origin at the tips.
TIPS_M = {"franka_panda": 0.1122, "robotiq_2f_140": 0.212}
#: GraspGen's frame, in which a gripper closes along x, in that of the poses: a matrix, or position and quaternion.
OFFSET = "transform_offset_from_asset_to_graspgen_convention"


def read(path: str, given: GripperFrame) -> dict[str, Any]:
    data = _arrays.table("the file", loaded_json(path))
    thing, grasps = _arrays.table("object", _arrays.entry("object", data)), _arrays.table("grasps", _arrays.entry("grasps", data))
    gripper = _arrays.table("gripper", data.get("gripper", {}))
    depth_m = None if gripper.get("depth") is None else _arrays.number("gripper.depth", gripper["depth"], 0.0, 10.0)
    tips_m = TIPS_M.get(str(gripper.get("name")), depth_m)
    base_m = given.known_m(tips_m if depth_m is None or abs((tips_m or 0.0) - depth_m) < 0.02 else depth_m, "the file")
    flat = np.hstack([*(gripper.get(OFFSET) or np.eye(4))])
    offset = _arrays.pose(f"gripper.{OFFSET}", flat.reshape(4, 4) if flat.size == 16 else flat)
    bases = _arrays.rigid("grasps.transforms", _arrays.entry("grasps.transforms", grasps), GRASPS_MAX) @ _arrays.matrices([offset])
    return {
        "file": word("object.file", _arrays.entry("object.file", thing)),
        "scale_m": _arrays.number("object.scale", _arrays.entry("object.scale", thing), 0.0, 1e9),
        "object_from_grasp": from_base(bases, base_m, given.closing_axis or "x"),
        "held": labels("grasps.object_in_gripper", _arrays.entry("grasps.object_in_gripper", grasps), len(bases)),
        "base_to_tips_m": base_m,
        "info": about("graspgen", {"name": gripper.get("name"), "opening_m_max": gripper.get("width"), **given.gripper}),
    }


def write(grasps: ObjectGrasps, path: str, given: GripperFrame) -> None:
    base_m = given.known_m(grasps.base_to_tips_m, "the set")
    gripper = {"name": gripper_name(grasps), "width": opening_m(grasps), "depth": base_m}
    value = {
        "object": {"file": grasps.file, "scale": grasps.scale_m},
        "gripper": {key: one for key, one in gripper.items() if one is not None},
        "grasps": {
            "transforms": to_base(grasps.object_from_grasp, base_m, given.closing_axis or "x").tolist(),
            # GraspGen indexes with them: booleans select, numbers would not.
            "object_in_gripper": labelled(grasps, "GraspGen").tolist(),
            "confidence": [None if np.isnan(share) else share for share in grasps.p_held.tolist()],
            "contacts_m": [[None if np.isnan(at).any() else at.tolist() for at in pair] for pair in grasps.contacts_m],
        },
    }
    with open(path, "w", encoding="utf-8") as file:
        json.dump(value, file, ensure_ascii=False, allow_nan=False)
        file.write("\n")
