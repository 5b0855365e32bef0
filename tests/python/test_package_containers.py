"""Scenes in bins, on trays and in shelves: what the package makes of their rows is what was generated."""

import pickle
from pathlib import Path

import pytest

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")

JUDGE = Path(__file__).parents[2] / "configs/generate/judge.toml"


def test_a_stored_scene_keeps_its_container(tmp_path):
    settings = {"attempts_per_scene": 20}
    dataset = graspmill.generate(tmp_path / "ds", JUDGE, shards=1, attempts=160, seed=3, settings=settings)
    assert dataset.verify() == [] and "container" in graspmill.HITS
    hits, walls = 0, 0
    for stored in dataset:
        camera, scene = stored.cameras[0], stored.scene
        seen = scene.render(camera)
        bare = graspmill.Scene(scene.objects, table_z_m=scene.table_z_m).render(camera)
        walls += bool((seen != bare).any())
        assert (pickle.loads(pickle.dumps(scene)).render(camera) == seen).all()
        # Objects at rest stay where they are but for fractions of a millimetre, and walls are there still.
        assert (abs(scene.settle().render(camera) - seen) > 0.002).mean() < 0.01
        again = graspmill.execute(pickle.loads(pickle.dumps(scene)), stored.workspace_from_grasp, targets=stored.outcomes.target)
        assert (again.outcome == stored.outcomes.outcome).all() and (again.hit == stored.outcomes.hit).all()
        hits += int((again.hit == graspmill.HITS.index("container")).sum())
    assert walls >= 4 and hits > 10
