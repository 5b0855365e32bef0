"""Files of plans for robots, read back by the rules of each format: a vector by hand, random plans, what is refused."""

import json

import numpy as np
import pytest
from grasp_sets import ABOVE, BOXED, CAMERA, graspmill, refused

Plan = graspmill.Plan
#: The flange of a Franka robot is turned by 45 degrees against its gripper, and 112.3 mm behind the tips.
FLANGE = {"position_m": [0.0, 0.0, 0.1123], "quaternion_xyzw": [0.0, 0.0, -np.sin(np.pi / 8), np.cos(np.pi / 8)]}
HALF = np.sqrt(0.5)
FLANGE_MATRIX = np.array([[HALF, HALF, 0, 0], [-HALF, HALF, 0, 0], [0, 0, 1, 0.1123], [0, 0, 0, 1.0]])
DOWN = {"position_m": [0.01, 0.02, 0.03], "quaternion_xyzw": [0.0, 1.0, 0.0, 0.0]}

# The fields of the messages: a type, or a list of one.
VECTOR = dict.fromkeys("xyz", float)
HEADER = {"frame_id": str}
POINT = dict.fromkeys(("positions", "velocities", "accelerations", "effort"), [float])
POSTURE = {"header": HEADER, "joint_names": [str], "points": [POINT]}
WAY = {"direction": {"header": HEADER, "vector": VECTOR}, "desired_distance": float, "min_distance": float}
GRASP = {"id": str, "grasp_pose": {"header": HEADER, "pose": {"position": VECTOR, "orientation": VECTOR | {"w": float}}}}
GRASP |= dict.fromkeys(("pre_grasp_posture", "grasp_posture"), POSTURE) | dict.fromkeys(("grasp_quality", "max_contact_force"), float)
GRASP |= {**dict.fromkeys(("pre_grasp_approach", "post_grasp_retreat", "post_place_retreat"), WAY), "allowed_touch_objects": [str]}


def row(workspace=DOWN, **more):
    values = {"workspace_from_grasp": workspace, "width_m": 0.05, "opening_m": 0.066, "quality": 0.9, "object": 0}
    values |= {"width_seen_share": 1.0, "robustness": None}
    values |= dict.fromkeys(("camera_from_grasp", "base_from_grasp", "workspace_from_flange", "base_from_flange"))
    return values | more


def plan_of(rows, **more):
    answer = {"format": "graspmill-plan/3", "gripper": "franka_hand", "flange_from_grasp": FLANGE, "grasps": rows}
    return Plan.from_json(json.dumps(answer | {"workspace_from_camera": None, "reason": None, "warnings": []} | more))


def random_plan(count=20, seed=7):
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(2, count, 4))
    turns /= np.linalg.norm(turns, axis=2, keepdims=True)
    places = rng.uniform(-0.5, 0.5, (2, count, 3))
    poses = [[{"position_m": p.tolist(), "quaternion_xyzw": q.tolist()} for p, q in zip(*one)] for one in zip(places, turns)]
    return plan_of([
        row(here, camera_from_grasp=seen, width_m=None if number % 4 == 0 else 0.01 + 0.002 * number, quality=0.99 - 0.01 * number)
        for number, (here, seen) in enumerate(zip(*poses))
    ])  # fmt: skip


def assert_message(value, fields, where="grasp"):
    """Fails unless every field is the message's, and of its type."""
    if isinstance(fields, list):
        assert isinstance(value, list), where
        for one in value:
            assert_message(one, fields[0], where)
    elif isinstance(fields, dict):
        assert value.keys() <= fields.keys(), f"{where} has no {value.keys() - fields.keys()}"
        for key, one in value.items():
            assert_message(one, fields[key], f"{where}.{key}")
    else:
        assert type(value) is fields, where


def pose_of(value):
    place, turn = value["position"], value["orientation"]
    return graspmill._arrays.matrices([[place[axis] for axis in "xyz"] + [turn[axis] for axis in "xyzw"]])[0]


def loaded(path):
    return pytest.importorskip("yaml", reason="yaml is not installed").safe_load(path.read_text())


# One grasp from straight above, by hand.


def test_isaac_grasps_pose_is_the_base_of_the_gripper(tmp_path):
    told = loaded(plan_of([row()]).save(tmp_path / "grasps.yaml", frame_id="table"))
    assert (told["format"], told["format_version"], told["object_frame"], told["gripper_frame"]) == ("isaac_grasp", 1.0, "table", "franka_hand")
    assert "object_file" not in told
    [grasp] = told["grasps"].values()
    assert grasp["position"] == [0.01, 0.02, 0.1423] and grasp["orientation"] == {"w": 0.0, "xyz": [0.0, 1.0, 0.0]}
    assert grasp["confidence"] == 0.9
    assert (grasp["cspace_position"], grasp["pregrasp_cspace_position"]) == ({"panda_finger_joint1": 0.025}, {"panda_finger_joint1": 0.033})


def test_moveits_pose_is_that_of_the_flange(tmp_path):
    path = plan_of([row()]).save(tmp_path / "grasps.yaml", "moveit", frame_id="table", gripper="franka_hand")
    [grasp] = loaded(path)["grasps"]
    assert_message(grasp, GRASP)
    assert (grasp["id"], grasp["grasp_quality"], grasp["grasp_pose"]["header"]) == ("grasp_0", 0.9, {"frame_id": "table"})
    pose = grasp["grasp_pose"]["pose"]
    # A gripper's numbers are in single precision.
    assert pose["position"] == pytest.approx({"x": 0.01, "y": 0.02, "z": 0.1423}, abs=2e-9)
    np.testing.assert_allclose(pose_of(pose)[:3, :3], [[-HALF, HALF, 0], [HALF, HALF, 0], [0, 0, -1]], atol=1e-6)
    joints = ["panda_finger_joint1", "panda_finger_joint2"]
    assert grasp["pre_grasp_posture"] == {"joint_names": joints, "points": [{"positions": [0.033, 0.033]}]}
    assert grasp["grasp_posture"] == {"joint_names": joints, "points": [{"positions": [0.025, 0.025], "effort": [30.0, 30.0]}]}
    ways = {"pre_grasp_approach": (-1.0, 0.05), "post_grasp_retreat": (1.0, 0.1)}
    for key, (z, far_m) in ways.items():
        direction = {"header": {"frame_id": "table"}, "vector": {"x": 0.0, "y": 0.0, "z": z}}
        assert grasp[key] == {"direction": direction, "desired_distance": far_m, "min_distance": far_m / 2}
    assert not grasp.keys() & {"post_place_retreat", "max_contact_force", "allowed_touch_objects"}


def test_a_gripper_from_the_side_goes_straight_up():
    side = {"position_m": [0.0, 0.0, 0.1], "quaternion_xyzw": [0.0, HALF, 0.0, HALF]}  # approaches along +x
    flipped = {"position_m": [0.0, 0.0, 0.5], "quaternion_xyzw": [0.0, HALF, 0.0, HALF]}
    [grasp] = plan_of([row(side)]).moveit_grasps()
    assert grasp["post_grasp_retreat"]["direction"]["vector"] == {"x": 0.0, "y": 0.0, "z": 1.0}
    # In a camera that looks straight down, with its y towards the workspace's −y, up is −z.
    seen = {"position_m": [0.0, 0.0, 0.4], "quaternion_xyzw": [HALF, 0.0, HALF, 0.0]}
    [grasp] = plan_of([row(flipped, camera_from_grasp=seen)]).moveit_grasps()
    assert grasp["pre_grasp_approach"]["direction"]["vector"] == pytest.approx({"x": 1.0, "y": 0.0, "z": 0.0}, abs=1e-6)
    assert grasp["post_grasp_retreat"]["direction"]["vector"] == pytest.approx({"x": 0.0, "y": 0.0, "z": -1.0}, abs=1e-6)


# Plans of many grasps.


@pytest.mark.parametrize("frame", ["camera", "workspace"])
def test_every_format_has_the_poses_of_the_plan(tmp_path, frame):
    plan = random_plan()
    want = np.stack([getattr(grasp, f"{frame}_from_grasp") for grasp in plan])
    isaac = loaded(plan.save(tmp_path / "grasps.yaml", frame=frame))["grasps"]
    assert list(isaac) == [f"grasp_{number}" for number in range(len(plan))]
    bases = [[*one["position"], *one["orientation"]["xyz"], one["orientation"]["w"]] for one in isaac.values()]
    bases = graspmill._arrays.matrices(bases)
    np.testing.assert_allclose(bases[:, :3, :3], want[:, :3, :3], atol=1e-7)
    np.testing.assert_allclose(bases[:, :3, 3] + 0.1123 * bases[:, :3, 2], want[:, :3, 3], atol=1e-7)
    rows = np.load(plan.save(tmp_path / "grasps.npy", frame=frame))
    turned = rows[:, 4:13].reshape(-1, 3, 3)
    assert rows.shape == (len(plan), 17) and rows.dtype == np.float64
    # As wide as the gripper opens, 20 mm high, the tips 20 mm from the centre.
    numbers = [[one.quality, one.opening_m, 0.02, 0.02, -1] for one in plan]
    np.testing.assert_allclose(rows[:, [0, 1, 2, 3, 16]], numbers, atol=1e-12)
    np.testing.assert_allclose(turned[:, :, [0, 1]], want[:, :3, [2, 1]], atol=1e-12)
    np.testing.assert_allclose(rows[:, 13:16] + rows[:, 3:4] * turned[:, :, 0], want[:, :3, 3], atol=1e-12)
    told = loaded(plan.save(tmp_path / "moveit.yaml", "moveit", frame=frame))["grasps"]
    flanges = np.stack([pose_of(one["grasp_pose"]["pose"]) for one in told])
    np.testing.assert_allclose(flanges @ FLANGE_MATRIX, want, atol=1e-7)
    for one, grasp in zip(told, plan):
        assert_message(one, GRASP)
        assert one["grasp_pose"]["header"]["frame_id"] == frame and one["grasp_quality"] == grasp.quality
    assert plan.moveit_grasps(frame=frame) == told


def test_a_width_that_was_not_seen_is_left_out(tmp_path):
    plan = random_plan()
    unseen = [grasp.width_m is None for grasp in plan]
    isaac = loaded(plan.save(tmp_path / "grasps.yaml"))["grasps"].values()
    assert ["cspace_position" not in one for one in isaac] == unseen == ["grasp_posture" not in one for one in plan.moveit_grasps()]
    assert all("pregrasp_cspace_position" in one for one in isaac)


def test_the_frame_is_the_robots_base_where_it_is_known(tmp_path):
    shifted = DOWN | {"position_m": [1.0, 2.0, 3.0]}
    plan = plan_of([row(base_from_grasp=shifted, camera_from_grasp=DOWN)])
    assert plan.moveit_grasps()[0]["grasp_pose"]["header"]["frame_id"] == "base"
    assert np.load(plan.save(tmp_path / "grasps.npy"))[0, 13:16].tolist() == [1.0, 2.0, 3.02]


def test_a_plan_without_grasps_is_a_file_without_grasps(tmp_path):
    plan = plan_of([], reason="nothing was seen")
    assert loaded(plan.save(tmp_path / "grasps.yaml"))["grasps"] == {}
    assert np.load(plan.save(tmp_path / "grasps.npy")).shape == (0, 17)
    assert loaded(plan.save(tmp_path / "moveit.yaml", "moveit")) == {"grasps": []}
    assert plan.moveit_grasps() == [] and plan.reason == "nothing was seen"


def test_small_numbers_stay_numbers_in_yaml(tmp_path):
    plan = plan_of([row(DOWN | {"position_m": [1e-7, -2e-9, 0.1]})])
    for form in ("isaac_grasp", "moveit"):
        told = loaded(plan.save(tmp_path / "small.yaml", form))
        grasp = told["grasps"]["grasp_0"]["position"] if form == "isaac_grasp" else told["grasps"][0]["grasp_pose"]["pose"]["position"].values()
        assert all(type(one) is float for one in grasp)


# Other grippers.


def test_joints_of_other_grippers_are_named_by_the_caller():
    plan = plan_of([row()], gripper="my_gripper")
    assert not plan.moveit_grasps()[0].keys() & {"pre_grasp_posture", "grasp_posture"}
    posture = plan.moveit_grasps(joints={"left": 0.5, "right": -0.5})[0]["grasp_posture"]
    assert posture == {"joint_names": ["left", "right"], "points": [{"positions": [0.025, -0.025]}]}


def test_a_gripper_without_a_flange_needs_the_distance_to_its_tips(tmp_path):
    plan = plan_of([row()], gripper="my_gripper", flange_from_grasp=None)
    refused("base_to_tips_m or a gripper with flange_from_grasp must be given", plan.moveit_grasps)
    refused("base_to_tips_m or gripper must be given", lambda: plan.save(tmp_path / "grasps.yaml"))
    refused("closing_axis goes with base_to_tips_m", lambda: plan.moveit_grasps(closing_axis="x", gripper="franka_hand"))
    assert list(tmp_path.iterdir()) == [], "what was refused leaves no file"
    for axis, columns in (("y", ABOVE[:3, :3]), ("x", np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]))):
        pose = pose_of(plan.moveit_grasps(base_to_tips_m=0.2, closing_axis=axis)[0]["grasp_pose"]["pose"])
        np.testing.assert_allclose(pose[:3, :3], columns, atol=1e-9)
        np.testing.assert_allclose(pose[:3, 3], [0.01, 0.02, 0.23], atol=1e-9)
    assert loaded(plan.save(tmp_path / "grasps.yaml", base_to_tips_m=0.2))["grasps"]["grasp_0"]["position"] == [0.01, 0.02, 0.23]


# What is refused.


def test_wrong_arguments_are_named(tmp_path):
    plan = plan_of([row()])
    refused("frame must be one that the plan knows, workspace, got 'camera'", lambda: plan.save(tmp_path / "a.npy", frame="camera"))
    refused("frame must be one that the plan knows", lambda: plan.moveit_grasps(frame="world"))
    refused("path must end with .yaml or .npy", lambda: plan.save(tmp_path / "grasps.txt"))
    refused("format must be one of isaac_grasp, graspnet, moveit, got 'acronym'", lambda: plan.save(tmp_path / "a.h5", "acronym"))
    refused("path must be a file in a folder that exists", lambda: plan.save(tmp_path / "nowhere" / "a.yaml", "moveit"))
    refused("joints must be names with metres", lambda: plan.moveit_grasps(joints=["left"]))
    with pytest.raises(TypeError, match="unexpected keyword argument 'frames'"):
        plan.moveit_grasps(frames="camera")


@pytest.mark.parametrize(("text", "match"), [
    ("[1, 2", "text must be the JSON of a plan"),
    (b"\xff", "text must be the JSON of a plan"),
    ("[]", "format must be graspmill-plan/3"),
    ('{"format": "graspmill-plan/9", "grasps": []}', "format must be graspmill-plan/3, got 'graspmill-plan/9'"),
    ('{"format": "graspmill-plan/3", "gripper": "a"}', "text must be the JSON of a plan"),
    ('{"format": "graspmill-plan/3", "gripper": "a", "grasps": [{}]}', "text must be the JSON of a plan"),
    ('{"format": "graspmill-plan/3", "gripper": "a", "grasps": 7}', "text must be the JSON of a plan"),
])  # fmt: skip
def test_other_texts_are_not_plans(text, match):
    refused(match, lambda: Plan.from_json(text))


def test_a_grasp_says_what_speaks_against_it():
    assert [grasp.doubt for grasp in plan_of([row(), row(doubt="cut_by_border")])] == [None, "cut_by_border"]


def test_a_plan_comes_back_from_its_json(tmp_path):
    plan = graspmill.Planner(gripper="franka_hand").plan(BOXED.render(CAMERA), CAMERA, grasps_max=3)
    again = Plan.from_json(plan.to_json())
    assert again.to_json() == plan.to_json() and len(again) == len(plan) == 3
    np.testing.assert_array_equal(again.workspace_from_grasp, plan.workspace_from_grasp)
    assert again.moveit_grasps() == plan.moveit_grasps() and plan.moveit_grasps()[0]["grasp_pose"]["header"] == {"frame_id": "camera"}
    refused("the plan .* has no page", again.page)
    refused("the plan .* has no page, overlay or labels", again.labels)
