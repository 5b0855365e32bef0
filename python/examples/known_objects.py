"""A planner for objects that you know: their grasps are made once, and a plan is a choice among those that are free.

    python known_objects.py

Your detector gives the objects' poses; here the simulation does. Grasps are tried alone first, then in the heap.
"""

import graspmill
import numpy as np


def at(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


GRIPPER = "franka_hand"
SHAPES = {
    "box": lambda pose: graspmill.Object.cuboid((0.05, 0.04, 0.08), pose),
    "can": lambda pose: graspmill.Object.solid("cylinder", (0.05, 0.05, 0.06), pose),
    "wedge": lambda pose: graspmill.Object.solid("tri_prism", (0.06, 0.05, 0.05), pose),
}

# Once for each object: grasps that hold whichever way is down, with the strongest pull that each bears.
known = {
    name: graspmill.annotate(make(np.eye(4)), gripper=GRIPPER, grasps=400, held_only=True, test="turn", margins=True, repeats=0, seed=1)
    for name, make in SHAPES.items()
}
for name, grasps in known.items():
    print(f"{name}: {len(grasps)} grasps, of the surface {grasps.info['coverage']:.0%} covered")

held = tried = 0
for seed in range(4):
    rng = np.random.default_rng(seed)
    turns = rng.permutation([0.2, 1.4, 2.9])
    names = list(SHAPES)
    things = [SHAPES[name](at(0.12 + 0.03 * number, 0.15 + 0.02 * np.sin(turn), 0.2)) for number, (name, turn) in enumerate(zip(names, turns))]
    scene = graspmill.Scene(things).settle(drop=True)
    for thing, name in zip(scene.objects, (one.name for one in scene.objects)):
        set_of = known[{"cuboid": "box", "cylinder": "can", "tri_prism": "wedge"}[name]]
        # Pose of the object times the grasp in the object's frame: the grasp in the workspace.
        grasps = thing.workspace_from_object @ set_of.object_from_grasp
        order = np.argsort(-set_of.tug_max_g)
        outcomes = graspmill.execute(scene, grasps[order], gripper=GRIPPER)
        # The robot would ask its collision checker which are free; the executions' gate says the same.
        collides = np.isin(outcomes.outcome, [graspmill.OUTCOMES.index(f"{way}_collision") for way in ("pregrasp", "approach")])
        free = np.flatnonzero(~collides)
        if len(free):
            tried, held = tried + 1, held + int(outcomes.held[free[0]])
print(f"{held} of {tried} best free grasps held in the heap")
assert held > 0.7 * tried
