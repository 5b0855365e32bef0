//! `graspmill objects annotate`, run as a user runs it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

use super::{check_fails, check_ok, files, workshop};

/// A box of 40 × 60 × 50 mm whose corner is the origin, in millimetres; a plate that no gripper spans; a catalogue.
fn objects() -> TempDir {
    let dir = workshop("");
    for (name, [x, y, z]) in [("brick", [40, 60, 50]), ("slab", [300, 300, 300])] {
        let corner = |c: usize| [x * (c & 1), y * (c >> 1 & 1), z * (c >> 2 & 1)];
        let corners: String = (0..8).map(corner).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        let faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
        fs::write(dir.path().join(format!("{name}.obj")), corners + faces).unwrap();
    }
    fs::write(dir.path().join("broken.obj"), "v 0 0 0\n").unwrap();
    dir
}

fn annotate(dir: &TempDir, words: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_graspmill"));
    command.current_dir(dir.path()).args(["objects", "annotate", "--grasps", "40", "--drops", "8"]).args(words);
    command.output().unwrap()
}

fn info(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn grasps_of_a_mesh_are_in_its_own_frame_and_the_same_bytes_again() {
    let dir = objects();
    let words = ["brick.obj", "--scale", "0.001", "--pages"];
    let said = check_ok(&annotate(&dir, &[&words[..], &["--out", "a"]].concat()));
    assert!(said.contains("brick") && said.contains("40 grasps of 1 object"), "{said}");
    check_ok(&annotate(&dir, &[&words[..], &["--out", "b", "--threads", "1"]].concat()));
    let [a, b] = ["a", "b"].map(|folder| files(&dir.path().join(folder)));
    assert_eq!(a, b);
    let names: Vec<String> =
        a.iter().map(|(path, _)| path.file_name().unwrap().to_string_lossy().into_owned()).collect();
    for name in ["brick.parquet", "brick.json", "object-brick.html"] {
        assert!(names.contains(&name.to_owned()), "{names:?}");
    }
    let brick = info(&dir.path().join("a/brick.json"));
    // The mesh's corner is the origin, not its middle.
    let centre = brick["object"]["centre_of_mass_m"].as_array().unwrap();
    for (at, expected) in centre.iter().zip([0.02, 0.03, 0.025]) {
        assert!((at.as_f64().unwrap() - expected).abs() < 1e-4, "{centre:?}");
    }
    let held = brick["outcomes"]["held"].as_u64().unwrap();
    assert!(held > 10 && brick["coverage"].as_f64().unwrap() > 0.5, "{brick}");
    assert!(!brick["stable_poses"].as_array().unwrap().is_empty());
    let p_held = brick["p_held"].as_f64().unwrap();
    assert!((0.1..0.95).contains(&p_held) && brick["pushed"].is_u64(), "{p_held} {brick}");
    assert!(said.contains("pushed") && said.contains("P(held)"), "{said}");
}

#[test]
fn only_the_best_grasps_are_kept_where_that_is_asked_for() {
    let dir = objects();
    let best = |most: &str, out: &str| annotate(&dir, &["brick.obj", "--scale", "0.001", "--best", most, "--out", out]);
    let said = check_ok(&best("5", "few"));
    assert!(said.contains("5 grasps of 1 object, 5 held") && !said.contains("instead of"), "{said}");
    let few = info(&dir.path().join("few/brick.json"));
    assert!(
        few["grasps"] == 5 && few["outcomes"]["held"] == 5 && few["settings"]["params"]["margins"] == true,
        "{few}"
    );
    // The coverage is that of the forty that were drawn.
    assert!(few["coverage"].as_f64().unwrap() > 0.5, "{few}");
    let said = check_ok(&best("1000", "all"));
    assert!(said.contains("grasps instead of 1000: no more of those that hold are apart"), "{said}");
    check_fails(&best("6", "few"), 78, &["settings.params.best (5 there, 6 asked for)"]);
    check_fails(&best("0", "none"), 2, &["--best"]);
}

#[test]
fn a_run_goes_on_with_what_is_missing_and_other_settings_are_refused() {
    let dir = objects();
    check_ok(&annotate(&dir, &["brick.obj", "--scale", "0.001", "--out", "grasps"]));
    let folder = dir.path().join("grasps");
    let before = files(&folder);
    fs::remove_file(folder.join("brick.parquet")).unwrap();
    check_ok(&annotate(&dir, &["brick.obj", "--scale", "0.001", "--out", "grasps"]));
    assert_eq!(files(&folder), before);
    // Pages are made of what is stored, so that they can be asked for later, or for a folder.
    check_ok(&annotate(&dir, &["brick.obj", "--scale", "0.001", "--out", "grasps", "--pages"]));
    let before = files(&folder);
    let pages = files(&folder.join("pages"));
    let browse = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_graspmill"));
        command.current_dir(dir.path()).args(["dataset", "browse", "grasps", "--out"]).args(words).output().unwrap()
    };
    assert!(check_ok(&browse(&["shown"])).contains("index.html"));
    let texts =
        |pages: Vec<(std::path::PathBuf, Vec<u8>)>| pages.into_iter().map(|(_, bytes)| bytes).collect::<Vec<_>>();
    assert_eq!(texts(files(&dir.path().join("shown"))), texts(pages));
    let read = |name: &str| fs::read_to_string(dir.path().join("shown").join(name)).unwrap();
    assert!(read("index.html").contains("object-brick.html") && read("scenes.js").contains("\"shelf\":\"objects\""));
    let page = read("object-brick.html");
    assert_eq!(page.matches("<script id=\"replay-").count(), 40, "{page}");
    assert!(page.contains("href=\"#attempt=7\"") && !page.contains("report.html"), "{page}");
    check_fails(&browse(&["more", "--scene", "1"]), 78, &["below 1"]);
    check_fails(
        &annotate(&dir, &["brick.obj", "--scale", "0.001", "--out", "grasps", "--seed", "2"]),
        78,
        &["other settings", "settings.params.seed (1 there, 2 asked for)", "brick.json"],
    );
    // All objects are asked before the first is begun.
    let both = ["slab.obj", "brick.obj", "--scale", "0.001", "--out", "grasps", "--test", "tug"];
    let refused = [r#"settings.params.test ("turn" there, "tug" asked for)"#, "brick.json"];
    check_fails(&annotate(&dir, &both), 78, &refused);
    // A mesh of another form, or one that only says more.
    let mesh = fs::read_to_string(dir.path().join("brick.obj")).unwrap();
    for other in [mesh.replace("60", "50"), format!("{mesh}# by hand\n")] {
        fs::write(dir.path().join("brick.obj"), other).unwrap();
        let again = annotate(&dir, &["brick.obj", "--scale", "0.001", "--out", "grasps"]);
        check_fails(&again, 78, &["settings.file_sha256 (", "brick.json"]);
    }
    let about = fs::read(folder.join("brick.json")).unwrap();
    fs::write(folder.join("brick.json"), "{}").unwrap();
    check_fails(&annotate(&dir, &["brick.obj", "--out", "grasps"]), 78, &["settings (nothing there"]);
    fs::write(folder.join("brick.json"), about).unwrap();
    assert_eq!(files(&folder), before);
    // Before a mesh is read and cut.
    fs::write(dir.path().join("brick.obj"), "").unwrap();
    let other = annotate(&dir, &["brick.obj", "--out", "grasps", "--seed", "2"]);
    check_fails(&other, 78, &["settings.params.seed (1 there, 2 asked for)", "brick.json"]);
}

/// A state that a run does not leave: one file of another run, or empty, cut, linked or gone. Gone is also what a kill
/// between the two files leaves.
/// What is done to a file, and how.
type Damage<'a> = (&'static str, &'a dyn Fn(&Path));

#[test]
fn files_that_are_not_as_a_run_left_them_are_made_again() {
    let dir = objects();
    let run = |seed: &str, out: &str| {
        let output = annotate(&dir, &["brick.obj", "--scale", "0.001", "--seed", seed, "--out", out]);
        check_ok(&output);
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    for (seed, out) in [("2", "other"), ("1", "grasps"), ("1", "grasps")] {
        let said = run(seed, out);
        assert!(!said.contains("made again"), "{said}");
    }
    let folder = dir.path().join("grasps");
    let before = files(&folder);
    let whole = |path: &Path| fs::read(path).unwrap();
    let other = whole(&dir.path().join("other/brick.parquet"));
    let elsewhere = dir.path().join("elsewhere");
    let damages: [Damage<'_>; 5] = [
        ("empty", &|path| fs::write(path, "").unwrap()),
        ("cut", &|path| fs::write(path, &whole(path)[..whole(path).len() / 2]).unwrap()),
        ("gone", &|path| fs::remove_file(path).unwrap()),
        ("linked", &|path| {
            fs::rename(path, &elsewhere).unwrap();
            std::os::unix::fs::symlink(&elsewhere, path).unwrap();
        }),
        ("of another run", &|path| fs::write(path, &other).unwrap()),
    ];
    for name in ["brick.parquet", "brick.json"] {
        let path = folder.join(name);
        for (what, damage) in damages {
            damage(&path);
            let said = run("1", "grasps");
            assert!(said.contains("made again") && said.contains(name), "{what}: {said}");
            assert!(fs::symlink_metadata(&path).unwrap().is_file() && files(&folder) == before, "{what}: {name}");
        }
    }
}

#[test]
fn what_cannot_be_grasped_or_read_is_listed_and_the_rest_goes_on() {
    let dir = objects();
    let words = ["brick.obj", "slab.obj", "broken.obj", "--scale", "0.001", "--shares", "1,0,0", "--out", "grasps"];
    let output = annotate(&dir, &words);
    assert_eq!(output.status.code(), Some(66), "{output:?}");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("slab: 0 grasps instead of 40") && !said.contains("left out: "), "{said}");
    assert_eq!(String::from_utf8_lossy(&output.stderr).matches("left out: ").count(), 1, "{output:?}");
    assert!(info(&dir.path().join("grasps/slab.json"))["coverage"].is_null());
    check_fails(&annotate(&dir, &["broken.obj", "--out", "more"]), 65, &["broken.obj"]);
    check_fails(&annotate(&dir, &["brick.obj", "--gripper", "claw", "--out", "more"]), 78, &["claw"]);
    check_fails(&annotate(&dir, &["brick.obj", "--shares", "0,0,0", "--out", "more"]), 2, &["not all 0"]);
    let catalogue = "[[object]]\nname = \"a/b\"\nmass_kg = 0.1\nfriction = 1.0\nsource = \"\"\n[[object.part]]\n\
                     shape = \"cuboid\"\nsize_m = [0.04, 0.04, 0.04]\nat_m = [0.0, 0.0, 0.0]\nturn_deg = [0.0, 0.0, 0.0]\n";
    fs::write(dir.path().join("names.toml"), catalogue).unwrap();
    check_fails(&annotate(&dir, &["names.toml", "--out", "more"]), 78, &["a/b", "names.toml"]);
}

#[test]
fn grasps_of_a_file_are_labelled_again_as_before() {
    let dir = objects();
    let brick = ["brick.obj", "--scale", "0.001"];
    check_ok(&annotate(&dir, &[&brick[..], &["--out", "drawn"]].concat()));
    let program = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_graspmill"));
        command.current_dir(dir.path()).args(["objects", "annotate", "--drops", "0"]).args(words).output().unwrap()
    };
    let relabel = |file: &str, out: &str| program(&[&brick[..], &["--relabel", file, "--out", out]].concat());
    let drawn = info(&dir.path().join("drawn/brick.json"));
    let said = check_ok(&relabel("drawn/brick.parquet", "again"));
    let again = info(&dir.path().join("again/brick.json"));
    assert_eq!([&again["grasps"], &again["outcomes"]["held"]], [&drawn["grasps"], &drawn["outcomes"]["held"]]);
    assert!(!said.contains("between the open fingers"), "{said}");
    // The same once more; the labels of another file are others.
    check_ok(&relabel("drawn/brick.parquet", "again"));
    check_ok(&annotate(&dir, &[&brick[..], &["--seed", "2", "--out", "others"]].concat()));
    check_fails(&relabel("others/brick.parquet", "again"), 78, &["other settings"]);
    // In centimetres the box is ten times as large, and told so again.
    let larger = ["brick.obj", "--scale", "0.01", "--relabel", "drawn/brick.parquet", "--out", "larger"];
    for _ in 0..2 {
        let said = check_ok(&program(&larger));
        assert!(said.contains("brick: the object lies between the open fingers in "), "{said}");
        assert!(said.contains("if a unit of the mesh is 1 mm"), "{said}");
    }
    for name in ["gone.parquet", "gone.h5", "gone.txt"] {
        check_fails(&relabel(name, "more"), 78, &["failed to read", name]);
    }
    for (name, code, said) in [("a.parquet", 65, "whole Parquet"), ("a.h5", 78, "Python package")] {
        fs::write(dir.path().join(name), "no").unwrap();
        check_fails(&relabel(name, "more"), code, &[said, name]);
    }
    let words = ["slab.obj", "brick.obj", "--relabel", "drawn/brick.parquet", "--out", "more"];
    check_fails(&program(&words), 78, &["one object"]);
    check_fails(&program(&["brick.obj", "--format", "graspgen", "--out", "more"]), 2, &["Python package"]);
}
