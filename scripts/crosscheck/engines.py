"""The engines by name. An engine's package is imported only when it is asked for."""

from importlib.metadata import version

from .attempt import Engine
from .floating import FloatingEngine

ENGINES = ("pybullet", "mujoco")
# MuJoCo's options for contacts much stiffer than those for scenes.
STIFF = {"step_rate_hz": 2000.0, "contact_time_s": 1e-3, "impedance": 0.999}


def make(name: str, **options: object) -> Engine:
    """An engine; `options` are fields of its options."""
    if name == "pybullet":
        from .bullet import BulletOptions
        from .compound_bullet import CompoundBullet

        return CompoundBullet(BulletOptions(**options))
    from .mujoco_engine import Mujoco, MujocoOptions

    return Mujoco(MujocoOptions(**options))


def make_floating(name: str, is_fast: bool) -> FloatingEngine:
    """An engine for objects that float. Its settings for scenes are fast; but then fingers go through thin parts."""
    if name == "pybullet":
        from .bullet import BulletOptions
        from .floating_bullet import FloatingBullet

        return FloatingBullet(BulletOptions() if is_fast else BulletOptions(step_rate_hz=960.0))
    from .floating_mujoco import FloatingMujoco
    from .mujoco_engine import MujocoOptions

    return FloatingMujoco(MujocoOptions() if is_fast else MujocoOptions(**STIFF))


def describe(engine: Engine) -> dict:
    """Engine, version and settings, for the report; the step rate is that of the gripper that was loaded last."""
    name, settings = engine.name, {**vars(engine.options), "step_rate_hz": engine.step_rate_hz}
    return {"engine": name, "version": version(name), "settings": settings}
