//! A judge of several grippers: trained on data of all, asked about those between them, refused elsewhere.

use std::fs;
use std::path::Path;

use network::Architecture;
use network::checkpoint::read;
use schema::{Gripper, Grippers};
use shards::DatasetInfo;

use super::fixture::{check_fails, trainer, write_config, write_dataset_of};
use crate::synthetic;

fn opening(info: &DatasetInfo, opening_m_max: f32) -> Gripper {
    Gripper { name: format!("opens_{opening_m_max}"), opening_m_max, ..info.gripper.clone() }
}

fn write(folder: &Path, openings_m: &[f32]) -> String {
    let mut info = synthetic::info(5, 2, 120, 12);
    let grippers: Vec<Gripper> = openings_m.iter().map(|opening_m| opening(&info, *opening_m)).collect();
    info.gripper = grippers[0].clone();
    if grippers.len() > 1 {
        assert_eq!(Grippers::problem(&grippers), None);
        (info.grippers, info.format_version) = (grippers, 3);
    }
    write_dataset_of(folder, &info);
    folder.to_str().unwrap().to_owned()
}

#[test]
fn a_judge_learns_from_many_grippers_and_answers_for_those_between_them() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let [two, wide, between, beyond] =
        [("two", &[0.08, 0.1][..]), ("wide", &[0.12]), ("between", &[0.11]), ("beyond", &[0.13])]
            .map(|(name, openings_m)| write(&path(name), openings_m));
    let voxel = write_config(dir.path(), 1, 24);
    let judge = path("judge.toml");
    let text = fs::read_to_string(&voxel).unwrap();
    fs::write(&judge, text.replace("upsampling = \"nearest\"", "kind = \"judge\"")).unwrap();
    let folder = path("run");
    let [voxel, judge, run] = [&voxel, &judge, &folder].map(|path| path.to_str().unwrap());
    let output = trainer(&["fit", "--data", &two, "--data", &wide, "--config", judge, "--run", run]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let weights = path("run/last.safetensors");
    let Architecture::Judge(scope) = read(&weights).unwrap().architecture else { panic!("not a judge") };
    assert_eq!(scope.grippers.unwrap()[0], [0.08, 0.12]);
    let weights = weights.to_str().unwrap();
    let evaluate = |data: &str| trainer(&["evaluate", "--model", weights, "--data", data, "--split", "all"]);
    assert!(evaluate(&between).status.success());
    check_fails(
        &["evaluate", "--model", weights, "--data", &beyond, "--split", "all"],
        78,
        &["not for opens_0.13 as it is given: opening_m_max must be 0.08 to 0.12, got 0.13"],
    );
    // The paper's network has no input for a gripper.
    let other = path("other");
    check_fails(
        &["fit", "--data", &two, "--config", voxel, "--run", other.to_str().unwrap()],
        78,
        &["the voxel network has no gripper input"],
    );
}
