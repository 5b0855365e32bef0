"""Workspaces of other sizes: from Python, from the command line, for judges; networks of voxels have their own."""

import functools

import numpy as np
import pytest

from grasp_sets import graspmill, refused
from programs import packaged, planned

#: Four boxes and a cylinder on a table of 0.45 m; but for the first all are beyond 0.3 m.
PLACES = ((0.10, 0.10), (0.36, 0.10), (0.10, 0.36), (0.36, 0.36), (0.37, 0.23))


def boxes(shift=(0.0, 0.0), places=PLACES):
    things = []
    for number, (x, y) in enumerate(places):
        size = (0.035, 0.045 + 0.005 * number, 0.05)
        pose = (x + shift[0], y + shift[1], 0.075, 0, 0, 0, 1)
        things.append(graspmill.Object.solid("cylinder", (0.05, 0.05, 0.05), pose) if number == 4 else graspmill.Object.cuboid(size, pose))
    return graspmill.Scene(things)


def seen(scene, middle):
    eyes = [(middle + 0.35 * np.cos(turn), middle + 0.35 * np.sin(turn), 0.6) for turn in (0.3, 2.4, 4.5)]
    cameras = [graspmill.Camera.look_at(eye, (middle, middle, 0.05)) for eye in eyes]
    return [scene.render(camera) for camera in cameras], cameras


@functools.cache
def wide():
    scene = boxes()
    return scene, *seen(scene, 0.225)


def held_near(scene, plan):
    """How many grasps near each thing hold, and the share of all that hold."""
    held, tips = graspmill.execute(scene, plan.workspace_from_grasp).held, plan.workspace_from_grasp[:, :2, 3]
    return [int(held[np.linalg.norm(tips - place, axis=1) < 0.05].sum()) for place in np.array(PLACES)], held.mean()


def test_networks_of_voxels_look_at_their_own_workspace():
    _, depths, cameras = wide()
    planner = graspmill.Planner("vgn")
    small = planner.plan(depths, cameras, workspace_size_m=0.3)
    assert small.workspace_from_grasp[:, :2, 3].max() < 0.3 + 0.001
    assert small.answer["region"] == {"low_m": [0, 0, 0], "high_m": pytest.approx([0.3] * 3), "table_z_m": pytest.approx(0.05)}
    for size_m in (0.2, 0.45):
        refused("must be 0.3 for the network vgn", lambda: planner.plan(depths, cameras, workspace_size_m=size_m))


@pytest.mark.parametrize("size_m", [None, 0.45])
def test_a_judge_grasps_all_that_is_seen(size_m):
    scene, depths, cameras = wide()
    plan = graspmill.Planner().plan(depths, cameras, workspace_size_m=size_m, check_collisions=True)
    near, share = held_near(scene, plan)
    assert min(near) > 0 and share > 0.9, (near, share)
    region = plan.answer["region"]
    assert region["table_z_m"] == pytest.approx(0.05) and region["low_m"][2] == pytest.approx(0.0)
    # The field reaches 0.1 m beyond all things, in whole voxels and cells.
    assert max(region["low_m"][:2]) < 0.1 and 0.45 < min(region["high_m"][:2]) <= max(region["high_m"][:2]) < 0.53


@pytest.mark.parametrize("size_m", [0.2, 0.3])
def test_a_judge_grasps_nothing_beyond_a_workspace_that_is_asked_for(size_m):
    scene, depths, cameras = wide()
    plan = graspmill.Planner().plan(depths, cameras, workspace_size_m=size_m)
    near, share = held_near(scene, plan)
    assert near[0] > 5 and near[1:] == [0] * 4 and share > 0.8, (near, share)
    assert plan.workspace_from_grasp[:, :2, 3].max() < size_m + 0.001
    # What stands there is seen all the same, because a gripper may touch it.
    assert min(plan.answer["region"]["high_m"][:2]) > 0.36


def test_a_judge_looks_as_far_as_robots_reach():
    """0.6 m from the middle of the network's workspace, and no further."""
    places = ((-0.40, 0.10), (0.70, 0.10), (0.15, 0.80))
    scene = boxes(places=places)
    cameras = [graspmill.Camera.look_at(eye, (0.15, 0.15, 0.05), focal_px=300.0) for eye in ((0.15, -0.6, 0.9), (0.15, 0.9, 1.2))]
    plan = graspmill.Planner().plan([scene.render(camera) for camera in cameras], cameras)
    near = [int((np.linalg.norm(plan.workspace_from_grasp[:, :2, 3] - place, axis=1) < 0.06).sum()) for place in np.array(places)]
    assert min(near[:2]) > 0 and near[2] == 0, near
    assert graspmill.execute(scene, plan.workspace_from_grasp[:5]).held.all()


@pytest.mark.parametrize("size_m", [None, 1.2])
def test_a_scene_in_a_corner_is_planned_as_in_a_workspace_of_its_own(size_m):
    """Shifted by whole voxels, grasps about it hold as they do in the middle."""
    places = ((0.10, 0.10), (0.20, 0.12), (0.12, 0.20))
    planner = graspmill.Planner()
    here, there = boxes(places=places), boxes((0.15, 0.15), places)
    depths, cameras = seen(here, 0.15)
    large_depths, large_cameras = seen(there, 0.30)
    assert all(np.abs(a - b).max() < 1e-5 for a, b in zip(depths, large_depths))
    small = planner.plan(depths, cameras)
    large = planner.plan(large_depths, large_cameras, workspace_size_m=size_m)
    assert abs(small[0].quality - large[0].quality) < 0.03 and len(large) > 0.5 * len(small)
    for scene, plan in ((here, small), (there, large)):
        assert graspmill.execute(scene, plan.workspace_from_grasp[:10]).held.all()


def test_the_command_line_plans_the_same(tmp_path):
    _, depths, cameras = wide()
    tsdf = graspmill.tsdf(depths, cameras, resolution=60, size_m=0.45)
    plan = graspmill.Planner().plan_tsdf(tsdf, workspace_size_m=0.45)
    assert len(plan) and plan.answer["region"]["high_m"] == pytest.approx([0.45] * 3)
    np.save(tmp_path / "grid.npy", tsdf)
    assert planned("--tsdf", tmp_path / "grid.npy", "--workspace-size", "0.45") == plan.answer


def test_sizes_that_cannot_be_are_refused():
    planner, grid = graspmill.Planner(), np.full((40, 40, 40), 0.6, np.float32)
    for size in (0.19, 1.21, float("nan"), "large"):
        refused("workspace_size_m must be", lambda: planner.plan_tsdf(grid, workspace_size_m=size))
    refused(r"tsdf must have shape \(60, 60, 60\)|tsdf must .*60", lambda: planner.plan_tsdf(grid, workspace_size_m=0.45))
    done = packaged("plan", "--demo", "--workspace-size", "1.3", code=78)
    assert "must be between 0.2 and 1.2, got 1.3: workspace_size_m" in done.stderr
