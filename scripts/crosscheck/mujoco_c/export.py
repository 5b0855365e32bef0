"""Writes the models and the closing attempts of a dataset for grasp.c.

    PYTHONPATH=scripts python scripts/crosscheck/mujoco_c/export.py DATASET OUT [--rate HZ] [--primitives]

OUT/<scene>.mjb is the model that crosscheck/mujoco_engine.py builds; OUT/attempts.txt has everything else. Only the pose
of the hand's root and the axis of the palm's slide depend on the attempt; the Python writes both into the compiled model
(body_pos, body_quat, jnt_axis), and so does grasp.c.

--primitives: cuboids are boxes and the table is a plane, the same shapes in a form whose contacts MuJoCo finds faster.
"""

import argparse
import re
from pathlib import Path

import mujoco
import numpy as np
from crosscheck import dataset, mujoco_engine
from crosscheck.contract import BLOCKED, retreat_direction


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rate", type=float, default=480.0)
    parser.add_argument("--primitives", action="store_true")
    args = parser.parse_args()
    data = dataset.read(args.dataset, None)
    args.out.mkdir(parents=True, exist_ok=True)
    options = mujoco_engine.MujocoOptions(step_rate_hz=args.rate, contact_time_s=2 / args.rate)
    [g], p, e = data.grippers, data.procedure, data.environment  # of a dataset with one hand
    total = sum(len(scene.attempts) for scene in data.scenes)
    numbers = [g.opening_m_max, g.finger_force_n, g.closing_speed_m_s, g.clearance_m, p.retreat_distance_m,
               p.retreat_speed_m_s, p.close_time_s_max, p.hold_time_s, p.empty_width_m, p.held_travel_share_min,
               p.other_push_m_max, p.other_lift_m_max, e.table_z_m]  # fmt: skip
    lines = [f"{total} " + " ".join(f"{x:.17g}" for x in numbers)]
    for scene in data.scenes:
        closing = [a for a in scene.attempts if a.outcome not in BLOCKED]
        if not closing:
            continue
        xml = mujoco_engine._model_xml(scene, g, e, options)
        if args.primitives:
            xml = with_primitives(xml, scene, e.table_z_m)
        mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(xml), str(args.out / f"{scene.scene_id}.mjb"), None)
        lines.append(f"scene {scene.scene_id} {len(scene.objects)} {len(closing)}")
        for a in closing:
            pose = a.workspace_from_grasp
            retreat = retreat_direction(pose, p.retreat_cone_rad)
            axis = pose.rotation.T @ retreat
            values = [*pose.position_m, *np.roll(pose.quat_xyzw, 1), *axis, *retreat]
            lines.append(f"{a.attempt_id} {a.target} {a.outcome} " + " ".join(f"{x:.17g}" for x in values))
    (args.out / "attempts.txt").write_text("\n".join(lines) + "\n")
    print(f"{len(lines)} lines, {total} attempts")


def with_primitives(xml: str, scene, table_z_m: float) -> str:
    """The same scene with boxes for cuboids and a plane for the table."""
    xml, count = re.subn(r'<geom name="table"[^>]*?>', f'<geom name="table" type="plane" size="1.5 1.5 0.5" pos="0 0 {table_z_m:.12g}">', xml)
    assert count == 1
    for i, o in enumerate(scene.objects):
        if getattr(o.solid, "kind", None) == "cuboid":
            size = " ".join(f"{x / 2:.12g}" for x in o.solid.extents_m)
            xml, count = re.subn(rf'<geom name="object{i}"[^>]*?>', f'<geom name="object{i}" type="box" size="{size}">', xml)
            assert count == 1
            xml, count = re.subn(rf'<mesh name="object{i}"[^>]*?></mesh>', "", xml)
            assert count == 1
    return xml


if __name__ == "__main__":
    main()
