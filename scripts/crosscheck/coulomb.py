"""Compares stored outcomes with a closed form for the slipping of a straight lift.

    /path/to/generator --config scripts/crosscheck/coulomb.toml --out data/coulomb
    PYTHONPATH=scripts python -m crosscheck.coulomb data/coulomb [--engine pybullet|mujoco]

Two fingers of force F hold a body of mass m by friction with at most 2 μ F, which accelerates it upwards by at most
c = 2 μ F / m − g. The gripper rises by d in the time T along a smoothstep, with the initial acceleration A = 6 d / T². If c < A the body
lags, from the start until the gripper has slowed down to its speed, by

    lag = d · k³,    k = 1 − c / A

in all (k < 1; for c < 0 it falls out). It is held if the lag is less than the finger tips' overlap with it and than what
`held_travel_share_min` leaves. This needs a grasp from above through the centre of mass; others are excluded.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import dataset, engines
from .attempt import Engine, Runner
from .contract import Attempt, Environment, Gripper, Procedure, Scene, retreat_direction

TILT_RAD_MAX = np.radians(4)
OFFSET_M_MAX = 0.0015
# Near the limit: what the lift asks for at first, over what friction gives.
LOAD_RANGE = (0.8, 1.2)


@dataclass(frozen=True)
class Lift:
    """A straight lift: its `load` at the start, the closed form's lag and outcome."""

    load: float
    lag_m: float
    outcome: str


def lag_m(mass_kg: float, friction: float, force_n: float, procedure: Procedure, gravity_m_s2: float) -> float:
    """How far a body falls behind the gripper; infinite if it falls out."""
    distance, time = procedure.retreat_distance_m, procedure.retreat_distance_m / procedure.retreat_speed_m_s
    wanted = 6 * distance / time**2
    given = 2 * friction * force_n / mass_kg - gravity_m_s2
    if given < 0:
        return float("inf")
    return distance * max(0.0, 1 - given / wanted) ** 3


def predict(scene: Scene, attempt: Attempt, gripper: Gripper, procedure: Procedure, env: Environment) -> Lift | None:
    """The closed form's prediction; None if the grasp is not straight from above through the centre of a cuboid."""
    thing, pose = scene.objects[attempt.target], attempt.workspace_from_grasp
    offset = pose.rotation.T @ (thing.workspace_from_object.position_m - pose.position_m)
    if attempt.shape != "cuboid" or attempt.approach_angle_rad > TILT_RAD_MAX or abs(offset[0]) > OFFSET_M_MAX:
        return None
    along = np.abs(pose.rotation[:, 2] @ thing.workspace_from_object.rotation)
    overlap = along @ np.array(thing.solid.extents_m) / 2 - offset[2]
    friction = thing.friction * gripper.friction
    lag = lag_m(thing.mass_kg, friction, gripper.finger_force_n, procedure, env.gravity_m_s2)
    limit = min(overlap, (1 - procedure.held_travel_share_min) * procedure.retreat_distance_m)
    time = procedure.retreat_distance_m / procedure.retreat_speed_m_s
    needed = thing.mass_kg * (env.gravity_m_s2 + 6 * procedure.retreat_distance_m / time**2)
    assert retreat_direction(pose, procedure.retreat_cone_rad)[2] > 0.99
    return Lift(needed / (2 * friction * gripper.finger_force_n), lag, "held" if lag < limit else "slipped")


def compare(data: dataset.Dataset, engine: Engine | None) -> list[tuple[Lift, str]]:
    """Straight lifts near the limit, with their outcome: as stored, or repeated by an engine."""
    pairs = []
    for scene in data.scenes:
        runner = Runner(engine, scene, data.gripper_of(scene), data.procedure, data.environment) if engine else None
        for attempt in scene.attempts:
            lift = predict(scene, attempt, data.gripper_of(scene), data.procedure, data.environment)
            if lift is None or attempt.outcome not in ("held", "slipped") or not LOAD_RANGE[0] < lift.load < LOAD_RANGE[1]:
                continue
            found = runner.from_closing(attempt, attempt.workspace_from_grasp).outcome if runner else attempt.outcome
            pairs.append((lift, found))
    return pairs


def main() -> int:
    """Prints the agreement of a dataset, or of an engine that repeats it, with the closed form."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--engine", choices=engines.ENGINES)
    args = parser.parse_args()
    pairs = compare(dataset.read(args.dataset, None), engines.make(args.engine) if args.engine else None)
    wrong = [(lift, found) for lift, found in pairs if lift.outcome != found]
    print(f"{len(pairs)} straight lifts with a load of {LOAD_RANGE[0]} to {LOAD_RANGE[1]}: {len(pairs) - len(wrong)} as Coulomb says")
    for lift, found in sorted(wrong, key=lambda pair: pair[0].load):
        print(f"  load {lift.load:.3f}, lag {1e3 * lift.lag_m:5.1f} mm: {found}, should be {lift.outcome}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
