//! The program as a user runs it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_graspmill")).args(arguments).output().unwrap()
}

fn plan(arguments: &[&str]) -> Value {
    let output = run(&[&["plan", "--json"], arguments].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Runs and expects an exit code and words on stderr.
fn refused(arguments: &[&str], code: i32, words: &str) {
    let output = run(&[&["plan"], arguments].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
    assert!(said.contains(words), "{arguments:?}: {said}");
    assert!(output.stdout.is_empty() && !said.contains("panicked"), "{said}");
}

fn demo_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../planner/demo")
}

/// An array file of these values.
fn npy_of(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let axes: String = shape.iter().map(|axis| format!("{axis}, ")).collect();
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({axes}), }}");
    let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    [b"\x93NUMPY\x01\x00\x76\x00", format!("{header:<117}\n").as_bytes(), &data].concat()
}

/// The demo's views file with one text replaced, beside its images.
fn changed(folder: &Path, from: &str, to: &str) -> String {
    for entry in fs::read_dir(demo_folder()).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), folder.join(entry.file_name())).unwrap();
    }
    let path = folder.join("views.toml");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{from}");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_demo_is_planned_drawn_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (json, html) = (path("plan.json"), path("scene.html"));
    let output = run(&["plan", "--demo", "--out", &json, "--html", &html]);
    assert!(output.status.success() && output.stderr.is_empty());
    let summary = String::from_utf8(output.stdout).unwrap();
    assert!(summary.contains("rank  object  quality") && summary.contains("ms: fuse"), "{summary}");
    let written: Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    let views = demo_folder().join("views.toml");
    assert_eq!(written, plan(&["--views", views.to_str().unwrap(), "--threads", "1"]));
    assert_eq!(written["grasps"][0]["rank"], 1);
    assert!(fs::read_to_string(html).unwrap().contains("grasp 1: quality"));
}

#[test]
fn flags_count_more_than_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let views = changed(folder.path(), "[intrinsics]", "policy = \"vgn-random\"\nexplain = true\n\n[intrinsics]");
    assert_eq!(plan(&["--views", &views])["policy"], "vgn-random");
    let answer =
        plan(&["--views", &views, "--policy", "vgn-best", "--grasps", "1", "--base-from-workspace", "1,0,0,0,0,0,1"]);
    assert_eq!(answer["policy"], "vgn-best");
    assert_eq!(answer["grasps"].as_array().unwrap().len(), 1);
    assert!(!answer["dropped"].as_array().unwrap().is_empty());
    let x = |frame: &str| answer["grasps"][0][frame]["position_m"][0].as_f64().unwrap();
    assert!((x("base_from_grasp") - x("workspace_from_grasp") - 1.0).abs() < 1e-6);
}

#[test]
fn each_object_comes_first_once_and_the_summary_says_which_have_no_grasp() {
    let answer = plan(&["--demo", "--each"]);
    let objects = answer["objects"].as_array().unwrap();
    let held = objects.iter().filter(|object| object["grasp_count"] != 0).count();
    let firsts: std::collections::BTreeSet<_> =
        answer["grasps"].as_array().unwrap().iter().take(held).map(|grasp| grasp["object"].as_u64()).collect();
    assert!(held > 1 && firsts.len() == held, "{answer}");
    let all = run(&["plan", "--demo", "--keep-out", "0,0,1,9"]);
    let summary = String::from_utf8(all.stdout).unwrap();
    let told = summary.matches(" mm: no grasp candidate at it keeps the limits that were asked for").count();
    assert_eq!(told, objects.len(), "{summary}");
    refused(&["--demo", "--previous", "0,0,0,0,0,0,2"], 78, "previous");
}

#[test]
fn a_tsdf_and_a_cloud_are_planned_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("tsdf.npy"), npy_of(&[1, 40, 40, 40], &vec![0.0; 64_000])).unwrap();
    let empty = "empty scene: no surface was seen in the workspace";
    assert_eq!(plan(&["--tsdf", &path("tsdf.npy")])["reason"], empty);
    let told = run(&["plan", "--tsdf", &path("tsdf.npy")]);
    let (said, beside) = (String::from_utf8(told.stdout).unwrap(), String::from_utf8(told.stderr).unwrap());
    assert!(
        said.contains(&format!("no grasps: {empty}\n")) && said.lines().count() <= 5 && !said.contains('{'),
        "{said}"
    );
    assert_eq!((told.status.code(), beside.as_str()), (Some(0), ""));
    let quiet = run(&["plan", "--tsdf", &path("tsdf.npy"), "--json", "--quiet"]);
    assert!(quiet.stderr.is_empty() && serde_json::from_slice::<Value>(&quiet.stdout).is_ok());
    let table: Vec<f32> =
        (0..14_400).flat_map(|n| [(n / 120) as f32 * 0.0025, (n % 120) as f32 * 0.0025, 0.05]).collect();
    fs::write(path("cloud.npy"), npy_of(&[14_400, 3], &table)).unwrap();
    let answer = plan(&["--cloud", &path("cloud.npy"), "--eye", "0.15,-0.4,0.5"]);
    assert!((answer["plane"]["offset_m"].as_f64().unwrap() - 0.05).abs() < 1e-4);
    assert_eq!(answer["reason"], "no collision-free grasp candidate was found on the observed surface");
    let answer = plan(&["--cloud", &path("cloud.npy"), "--eye", "0.15,-0.4,0.5", "--config", "paper"]);
    assert!(answer["reason"].as_str().unwrap().starts_with("no grasp has a quality of 0.9 or more"), "{answer}");
}

#[test]
fn bad_input_is_named_with_its_place_and_code() {
    let folder = tempfile::tempdir().unwrap();
    let at = |from: &str, to: &str| changed(folder.path(), from, to);
    refused(&["--views", "nowhere.toml"], 78, "failed to read nowhere.toml: ");
    refused(&["--views", &at("fx_px = 540.0", "fx_px = 0.0")], 78, "fx_px");
    refused(&["--views", &at("depth-1.png", "depth-9.png")], 78, "depth-9.png");
    refused(&["--views", &at("position_m", "position")], 78, "workspace_from_camera");
    refused(&["--views", &at("depth_scale_m = 0.0001", "depth_scale_m = 1.0")], 78, "depth_scale_m");
    refused(&["--views", &at("height_px = 480", "height_px = 400")], 78, "height_px");
    let rigid = "{ position_m = [0.45000002, 0.15, 0.51961523]";
    let mirrored = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]] # ";
    refused(&["--views", &at(rigid, mirrored)], 78, "not a rigid transform");
    fs::write(folder.path().join("half.png"), &fs::read(demo_folder().join("depth-0.png")).unwrap()[..3000]).unwrap();
    refused(&["--views", &at("depth-0.png", "half.png")], 65, "views[0].depth");
    let nan = folder.path().join("nan.npy");
    fs::write(&nan, npy_of(&[480, 640], &[f32::NAN; 480 * 640])).unwrap();
    refused(&["--views", &at("depth-0.png", "nan.npy")], 78, "no pixel has a depth");
    fs::write(&nan, npy_of(&[40, 40, 40], &vec![f32::NAN; 64_000])).unwrap();
    refused(&["--tsdf", nan.to_str().unwrap()], 78, "tsdf");
    fs::write(&nan, npy_of(&[39, 40, 40], &vec![0.5; 62_400])).unwrap();
    refused(&["--tsdf", nan.to_str().unwrap()], 78, "[40, 40, 40]");
    refused(&["--demo", "--wrist", "0,0,0,2"], 78, "workspace_from_wrist");
    refused(&["--demo", "--wrist", "0,0,1"], 2, "4 numbers");
    refused(&["--demo", "--views", "x"], 2, "cannot be used with");
    refused(&[], 2, "required");
    refused(&["--demo", "--model", "nowhere.safetensors"], 78, "nowhere.safetensors");
    refused(&["--demo", "--config", "nowhere.toml"], 78, "nowhere.toml");
    refused(&["--demo", "--out", "/nowhere/plan.json"], 78, "/nowhere/plan.json");
    let [cloud, lens] = ["cloud.pcd", "camera.yaml"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    fs::write(&cloud, "VERSION 0.7\nFIELDS x y z\n").unwrap();
    refused(&["--cloud", &cloud], 65, "got a PLY or PCD file: the program of the Python package");
    fs::write(&lens, "k: [607.5, 0.0, 320.25, 0.0, 608.0, 241.0, 0.0, 0.0, 1.0]\n").unwrap();
    refused(&["--depth", "depth.png", "--intrinsics", &lens], 65, "the program of the Python package");
}

#[test]
fn a_gripper_is_told_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let output = run(&["gripper", "franka_hand", "--html", &path("gripper.html")]);
    assert!(output.status.success(), "{output:?}");
    let told = String::from_utf8(output.stdout).unwrap();
    for words in ["franka_hand\n", "finger_length_m", "46.0 mm", "closing_speed_m_s       0.05", "112.3 mm; quaternion"]
    {
        assert!(told.contains(words), "{words} is not in {told}");
    }
    let page = fs::read_to_string(path("gripper.html")).unwrap();
    for words in ["63.0 mm along x, 204.0 mm along y, 66.0 mm along z", "z: approach", "the flange", "palm_breadth_m"] {
        assert!(page.contains(words), "{words} is not in {page}");
    }
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/grippers/slim_jaw_50.toml");
    assert!(run(&["gripper", file.to_str().unwrap()]).status.success());
    let output = run(&["gripper", "three_fingers"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(78), "{said}");
    assert!(said.contains("must be a path that ends in .toml or one of parallel_jaw_80"), "{said}");
}

#[test]
fn a_hand_with_a_flange_gives_the_flanges_poses() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("plan.toml");
    let paper = include_str!("../../../configs/plan/paper.toml");
    assert!(paper.contains("\"parallel_jaw_80\""));
    // Without the check, which leaves no grasp of the demo.
    let text = paper.replace("\"parallel_jaw_80\"", "\"franka_hand\"").replace("check = true", "check = false");
    fs::write(&config, text).unwrap();
    let config = config.to_str().unwrap();
    let answer = plan(&["--demo", "--config", config, "--base-from-workspace", "0.4,-0.15,-0.05,0,0,0,1"]);
    let tips_m = answer["flange_from_grasp"]["position_m"][2].as_f64().unwrap();
    assert!((tips_m - 0.1123).abs() < 1e-6, "{answer}");
    let numbers = |pose: &Value, key: &str| -> Vec<f64> {
        pose[key].as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let first = &answer["grasps"][0];
    for [grasp, flange] in [["workspace_from_grasp", "workspace_from_flange"], ["base_from_grasp", "base_from_flange"]]
    {
        let [x, y, z, w] = numbers(&first[grasp], "quaternion_xyzw")[..] else { panic!("{first}") };
        let approach = [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)];
        let (tips, flange_at) = (numbers(&first[grasp], "position_m"), numbers(&first[flange], "position_m"));
        for axis in 0..3 {
            let expected_m = tips[axis] - 0.1123 * approach[axis];
            assert!((flange_at[axis] - expected_m).abs() < 1e-5, "{flange}: {first}");
        }
        // The gripper is turned by -45 degrees on the flange: the flange by 45 degrees about the approach.
        let (sin, cos) = (0.382_683_43, 0.923_879_53);
        let turned = [x * cos + y * sin, y * cos - x * sin, z * cos + w * sin, w * cos - z * sin];
        let got = numbers(&first[flange], "quaternion_xyzw");
        let cosine: f64 = turned.iter().zip(&got).map(|(a, b)| a * b).sum();
        assert!((cosine.abs() - 1.0).abs() < 1e-5, "{flange}: {turned:?} {got:?}");
    }
    let without = plan(&["--demo", "--config", "paper"]);
    assert!(without["flange_from_grasp"].is_null() && without["grasps"][0]["workspace_from_flange"].is_null());
}

#[test]
fn poses_given_in_a_usual_wrong_way_are_recognised() {
    let folder = tempfile::tempdir().unwrap();
    let views = changed(folder.path(), "workspace_from_camera", "workspace_from_camera");
    let text = fs::read_to_string(&views).unwrap();
    fs::write(&views, text.replace("workspace_from_camera", "camera_from_workspace")).unwrap();
    let answer = plan(&["--views", &views]);
    let words = "if camera_from_workspace were the inverse, workspace_from_camera: views[0], views[1], views[2]";
    let warnings = answer["warnings"].as_array().unwrap();
    assert!(warnings.iter().any(|warning| warning.as_str().unwrap().ends_with(words)), "{warnings:?}");
}
