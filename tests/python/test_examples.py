"""The examples of python/examples, run as a user runs them, with the wheel that is installed."""

import json
import os
import re
import sys

import pytest

import notebooks
from programs import ROOT, packaged, ran

graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
EXAMPLES = ROOT / "python" / "examples"


def run(folder, name, *words):
    return ran(sys.executable, EXAMPLES / name, *words, cwd=folder).stdout


def test_a_first_dataset(tmp_path):
    said = run(tmp_path, "first_dataset.py", "first")
    assert "Dataset(" in said and "1 positive to" in said
    assert all((tmp_path / "first" / page).stat().st_size > 10_000 for page in ("attempt.html", "report.html"))


def test_labels_for_grasps_of_ones_own(tmp_path):
    said = run(tmp_path, "label_your_grasps.py")
    assert said.count("held=") == 3


def test_training_in_pytorch(tmp_path):
    pytest.importorskip("torch")
    graspmill.generate(tmp_path / "ds", shards=1, attempts=120, seed=2)  # one scene to train on, and one that is unseen
    said = run(tmp_path, "train_in_pytorch.py", "ds", "2")
    first, second = map(float, re.findall(r", step 0: ([0-9.]+)", said))
    assert second < first and said.count("accuracy on unseen scenes") == 2
    packaged("evaluate", "--model", "paper.safetensors", "--data", "ds", "--split", "all", cwd=tmp_path)


def test_a_plan_from_a_realsense_frame(tmp_path):
    said = run(tmp_path, "plan_from_realsense.py")
    assert said.count("in the camera's frame") == said.count("flange in the workspace") == 3
    assert said.count("grasps, the best") == 2 and said.count(") []\n") == 2, "a warning"
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("overlay.png", "plan.html"))


def test_mujoco_lifts_what_was_planned(tmp_path):
    pytest.importorskip("mujoco")
    assert "0 of 4 objects left" in run(tmp_path, "mujoco_loop.py", "2")


def test_an_arm_reaches_what_was_planned_for_it(tmp_path):
    pytest.importorskip("mujoco")
    said = run(tmp_path, "reachable.py")
    asked, reached = map(int, re.search(r"about (\d+) grasps; (\d+) are in reach", said).groups())
    in_reach, planned = map(int, re.search(r"(\d+) of (\d+) grasps are in reach", said).groups())
    assert 0 < reached < asked and in_reach == planned > 3


def test_the_arm_of_menagerie_is_the_users(tmp_path):
    pytest.importorskip("mujoco")
    assert "git clone" in ran(sys.executable, EXAMPLES / "mujoco_arm.py", cwd=tmp_path, code=1).stderr
    model = os.environ.get("GRASPMILL_MENAGERIE")  # its folder; nothing is fetched here
    if model:
        assert "0 of 4 objects left" in run(tmp_path, "mujoco_arm.py", f"{model}/franka_emika_panda/panda.xml")


def test_the_so101_is_the_users(tmp_path):
    pytest.importorskip("mujoco")
    assert "git clone" in ran(sys.executable, EXAMPLES / "so101_lerobot.py", cwd=tmp_path, code=1).stderr
    if model := os.environ.get("GRASPMILL_SO101"):  # its MJCF; nothing is fetched here
        assert "\nlifted: " in run(tmp_path, "so101_lerobot.py", model)


@pytest.mark.parametrize("name", notebooks.MADE)
def test_a_notebook_is_its_example_and_was_executed(name):
    stored = json.loads((notebooks.NOTEBOOKS / f"{name}.ipynb").read_text())
    code = [(cell["cell_type"], "".join(cell["source"])) for cell in stored["cells"]]
    assert code == notebooks.cells(name), "python scripts/notebooks.py renews it"
    outputs = [output for cell in stored["cells"] for output in cell.get("outputs", [])]
    assert outputs and not any(output["output_type"] == "error" for output in outputs)


def test_a_planner_for_known_objects(tmp_path):
    said = run(tmp_path, "known_objects.py")
    assert said.count("covered") == 3 and "best free grasps held in the heap" in said
