//! Exports: content of the files, equal bytes each time, no overwriting, and no half-written results.

use core::f32::consts::PI;
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::Path;

use inspect::{ExportFormat, Exported, export};
use program::{ExitCode, Failure};
use schema::{AttemptRecord, Vec3, samples_of};
use shards::{Dataset, DatasetInfo, Draft, Location};

use crate::{sample, synthetic};

fn small(seed: u64) -> DatasetInfo {
    synthetic::info(seed, 2, 58, 6) // 10 scenes on VGN's grid
}

fn written(info: &DatasetInfo) -> (tempfile::TempDir, Dataset) {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), info);
    let dataset = Dataset::open(dir.path()).unwrap();
    (dir, dataset)
}

/// As [`written`], but some grasps lie near the workspace's faces, all of scene 3 do, and scene 5 is one point with its
/// yaws.
fn written_with_edges(info: &DatasetInfo) -> (tempfile::TempDir, Dataset) {
    let dir = tempfile::tempdir().unwrap();
    let draft = Draft::begin(dir.path(), info).unwrap();
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).unwrap();
        for mut rows in sample::rows(info, shard) {
            let first = rows.attempts[0].clone();
            for attempt in &mut rows.attempts {
                if attempt.scene_id == 3 || attempt.attempt_id % 5 == 4 {
                    attempt.workspace_from_grasp.translation.x = 0.295;
                } else if attempt.scene_id == 5 {
                    let attempt_id = attempt.attempt_id;
                    *attempt = AttemptRecord { attempt_id, closing: None, ..first.clone() };
                    attempt.rule.approach = schema::Approach::Normal;
                    attempt.turn_rad = PI * attempt.attempt_id as f32 / 6.0;
                    attempt.workspace_from_grasp.translation = Vec3::new(0.15, 0.14, 0.1);
                }
            }
            writer.push(&rows).unwrap();
        }
        writer.commit().unwrap();
    }
    draft.finalize().unwrap();
    let dataset = Dataset::open(dir.path()).unwrap();
    (dir, dataset)
}

fn exported(dataset: &Dataset, out: &Path) -> Result<Exported, Failure> {
    export(dataset, ExportFormat::Vgn, None, &Location::Path(out.to_owned()), |_| ())
}

/// An array of a `.npy`: its header and its bytes.
fn npy(bytes: &[u8]) -> (String, &[u8]) {
    assert_eq!(bytes[..8], *b"\x93NUMPY\x01\x00");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    (String::from_utf8(bytes[10..10 + length].to_vec()).unwrap(), &bytes[10 + length..])
}

fn f32s(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

type Rows = Vec<BTreeMap<String, String>>;

fn table(path: &Path) -> Rows {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(Result::unwrap).collect()
}

fn real(row: &BTreeMap<String, String>, name: &str) -> f32 {
    row[name].parse().unwrap()
}

#[test]
fn vgns_rows_are_the_grasps_that_lie_inside() {
    let info = small(3);
    let (_dir, dataset) = written_with_edges(&info);
    let out = tempfile::tempdir().unwrap();
    let told = exported(&dataset, out.path()).unwrap();
    let (voxels, metres) = (table(&out.path().join("grasps.csv")), table(&out.path().join("raw/grasps.csv")));
    assert_eq!(voxels.len() as u64, told.counts.grasps);
    assert_eq!(metres.len(), voxels.len());

    let attempts: Vec<_> = (0..2).flat_map(|shard| dataset.read_attempts(shard).unwrap()).collect();
    let samples = samples_of(&attempts);
    assert_eq!(told.counts.left_out + told.counts.grasps, samples.len() as u64);
    let mut rows = voxels.iter().zip(&metres);
    let mut left_out = 0;
    for sample in &samples {
        // The fingers of this hand are 50 mm long and the grid's voxels 7.5 mm.
        let pose = &sample.workspace_from_grasp;
        let roots_m = pose.translation - pose.rotation * Vec3::new(0.0, 0.0, 0.05);
        if roots_m.to_array().iter().any(|x| !(0.02..=0.28).contains(x)) {
            left_out += 1;
            continue;
        }
        let (voxel, metre) = rows.next().unwrap();
        assert_eq!(voxel["scene_id"], format!("scene-{:09}", sample.scene_id));
        for (at, m) in [("i", "x"), ("j", "y"), ("k", "z")].iter().zip(roots_m.to_array()) {
            assert!((real(voxel, at.0) - m / 0.0075).abs() < 1e-4, "{voxel:?}");
            assert!((real(metre, at.1) - m).abs() < 1e-6, "{metre:?}");
        }
        let rotation = ["qx", "qy", "qz", "qw"].map(|part| real(voxel, part));
        assert_eq!(rotation, pose.rotation.to_array());
        assert_eq!(voxel["label"], sample.label().to_string());
        let width_m = if sample.label() == 1 { sample.width_m.unwrap() } else { 0.08 };
        assert!((real(voxel, "width") - width_m / 0.0075).abs() < 1e-4, "{voxel:?}");
        assert_eq!(real(metre, "width"), width_m);
    }
    assert!(rows.next().is_none());
    assert_eq!(told.counts.left_out, left_out);
    assert!(left_out > 0 && told.counts.positives > 0, "{told:?}");
    assert_eq!((told.counts.scenes, told.counts.scenes_left_out), (9, 1));
    assert!(samples.len() < attempts.len(), "scene 5 has one point and six yaws");
}

#[test]
fn vgns_scenes_are_the_grids() {
    let info = small(4);
    let (_dir, dataset) = written(&info);
    let out = tempfile::tempdir().unwrap();
    let told = exported(&dataset, out.path()).unwrap();
    let named: std::collections::BTreeSet<String> =
        table(&out.path().join("grasps.csv")).iter().map(|row| row["scene_id"].clone()).collect();
    assert_eq!(told.counts.scenes, named.len() as u64);
    assert_eq!(fs::read_dir(out.path().join("scenes")).unwrap().count(), named.len());
    for scene in (0..2).flat_map(|shard| dataset.scenes(shard).unwrap()) {
        let scene = scene.unwrap();
        let name = format!("scene-{:09}", scene.scene_id);
        if !named.contains(&name) {
            continue;
        }
        let file = fs::File::open(out.path().join(format!("scenes/{name}.npz"))).unwrap();
        let mut bytes = Vec::new();
        zip::ZipArchive::new(file).unwrap().by_name("grid.npy").unwrap().read_to_end(&mut bytes).unwrap();
        let (header, data) = npy(&bytes);
        assert!(header.contains("'<f4'") && header.contains("(1, 40, 40, 40,)"), "{header}");
        assert_eq!(f32s(data), scene.tsdf);
    }
    let setup = fs::read_to_string(out.path().join("raw/setup.json")).unwrap();
    assert!(setup.contains("\"size\": 0.3,") && setup.contains("\"finger_depth\": 0.05"), "{setup}");
}

#[test]
fn the_same_dataset_gives_the_same_bytes_and_a_stopped_export_goes_on() {
    let (_dir, dataset) = written(&small(6));
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let told = exported(&dataset, one.path()).unwrap();
    exported(&dataset, two.path()).unwrap();
    let files = sample::files(one.path());
    assert_eq!(files, sample::files(two.path()));
    let names: Vec<&str> = files.iter().filter_map(|(path, _)| path.to_str()).filter(|n| !n.ends_with("npz")).collect();
    assert_eq!(names, ["README.md", "export.json", "grasps.csv", "raw/grasps.csv", "raw/setup.json"]);
    assert_eq!(exported(&dataset, one.path()).unwrap(), told, "a complete one is left as it is");

    // As if it had been killed in its first write.
    let first = tempfile::tempdir().unwrap();
    fs::write(first.path().join(".a1B2c3.tmp"), "half").unwrap();
    exported(&dataset, first.path()).unwrap();
    assert_eq!(files, sample::files(first.path()));

    // As if it had been killed in the middle: some files are there, some half written under other names.
    let origin = serde_json::to_vec_pretty(&told.origin).unwrap();
    fs::write(two.path().join("export-begun.json"), origin).unwrap();
    for name in ["export.json", "README.md", "grasps.csv", "scenes/scene-000000003.npz"] {
        fs::remove_file(two.path().join(name)).unwrap();
    }
    for name in ["grasps.part", "scenes/.a1B2c3.tmp", ".lock"] {
        fs::write(two.path().join(name), "half").unwrap();
    }
    let mut scenes = 0;
    let out = Location::Path(two.path().to_owned());
    assert_eq!(export(&dataset, ExportFormat::Vgn, None, &out, |more| scenes += more).unwrap(), told);
    assert_eq!(scenes, dataset.info().scene_count);
    assert_eq!(files, sample::files(two.path()));
}

#[test]
fn plain_tables_are_the_same_bytes_each_time_and_a_stopped_export_goes_on() {
    let (_dir, dataset) = written(&sample::info(6)); // any grid will do
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let plain = |out: &Path| export(&dataset, ExportFormat::Parquet, None, &Location::Path(out.to_owned()), |_| ());
    let told = plain(one.path()).unwrap();
    plain(two.path()).unwrap();
    let files = sample::files(one.path());
    assert_eq!(files, sample::files(two.path()));
    let names: Vec<&str> = files.iter().filter_map(|(path, _)| path.to_str()).collect();
    let tables = ["attempts", "objects", "scenes"].map(|table| [0, 1].map(|shard| layout_name(table, shard)));
    let tables: Vec<&str> = tables.iter().flatten().map(String::as_str).collect();
    assert_eq!(names, [&["README.md"], &tables[..2], &["export.json", "meta/info.json"], &tables[2..]].concat());
    let info = dataset.info();
    assert_eq!((told.counts.grasps, told.counts.scenes), (info.attempt_count, info.scene_count));
    assert_eq!(Dataset::open(one.path()).unwrap_err().exit_code(), ExitCode::Incomplete, "it is not the dataset");

    let origin = serde_json::to_vec_pretty(&told.origin).unwrap();
    fs::write(two.path().join("export-begun.json"), origin).unwrap();
    fs::remove_file(two.path().join("export.json")).unwrap();
    let half = two.path().join(tables[3]);
    fs::rename(&half, half.with_extension("part")).unwrap();
    assert_eq!(plain(two.path()).unwrap(), told);
    assert_eq!(files, sample::files(two.path()));
}

fn layout_name(table: &str, shard: u32) -> String {
    format!("{table}/shard-{shard:05}-of-00002.parquet")
}

#[test]
fn nothing_of_others_is_touched() {
    let (dir, dataset) = written(&small(7));
    let (_other_dir, other) = written(&small(8));
    let code = |result: Result<Exported, Failure>, part: &str| {
        let error = result.unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
        assert_eq!(error.exit_code(), ExitCode::Config);
    };
    let before = sample::files(dir.path());
    code(exported(&dataset, dir.path()), "it holds \"README.md\", which is no export");
    assert_eq!(sample::files(dir.path()), before);

    let out = tempfile::tempdir().unwrap();
    exported(&dataset, out.path()).unwrap();
    code(exported(&other, out.path()), "it holds an export as vgn of dataset");
    fs::write(out.path().join("export.json"), "{}").unwrap();
    code(exported(&dataset, out.path()), "is damaged");
    code(exported(&dataset, &out.path().join("README.md")), "must go to a folder, got a file");
    let url = Location::parse("s3://bucket/out").unwrap();
    code(export(&dataset, ExportFormat::Vgn, None, &url, |_| ()), "a folder on a disk");
    let (_coarse_dir, coarse) = written(&sample::info(9));
    code(exported(&coarse, &out.path().join("new")), "grids of 40^3 voxels, the dataset has 8^3");
    assert!(!out.path().join("new").exists());
}

#[test]
fn a_damaged_dataset_is_not_exported_as_whole() {
    let (dir, dataset) = written(&small(10));
    let file = dir.path().join("scenes/shard-00001-of-00002.parquet");
    let mut bytes = fs::read(&file).unwrap();
    bytes[100] ^= 1;
    fs::write(&file, bytes).unwrap();
    let out = tempfile::tempdir().unwrap();
    let error = exported(&dataset, out.path()).unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Data, "{error}");
    assert!(!out.path().join("export.json").exists() && !out.path().join("grasps.csv").exists());
}
