//! Datasets of several grippers: their rows name the gripper, and each scene's rows are held to its own.

use std::fs;

use arrow::cast::AsArray as _;
use arrow::types::Int32Type;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use schema::Gripper;
use shards::{Dataset, DatasetInfo, Draft, Finalized, verify};

use crate::synthetic;

fn info() -> DatasetInfo {
    let mut info = synthetic::info(3, 2, 580, 60);
    info.grid.resolution = 8;
    let named = |name: &str, opening_m_max| Gripper { name: name.to_owned(), opening_m_max, ..info.gripper.clone() };
    info.grippers = vec![info.gripper.clone(), named("wide", 0.12), named("wider", 0.2)];
    info.format_version = 3;
    info
}

#[test]
fn a_scene_has_the_gripper_whose_turn_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let info = info();
    let draft = Draft::begin(dir.path(), &info).unwrap();
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).unwrap();
        for scene in info.scenes_of(shard) {
            writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
        }
        writer.commit().unwrap();
    }
    assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
    assert!(verify(dir.path(), |_| ()).unwrap().is_ok());
    let dataset = Dataset::open(dir.path()).unwrap();
    assert_eq!(dataset.info(), &info);
    assert_eq!(dataset.read_scene(4).unwrap(), synthetic::scene_rows(4, info.seed, &info));
    // As any reader of Parquet sees it.
    let file = fs::File::open(dir.path().join("scenes/shard-00001-of-00002.parquet")).unwrap();
    let batches = ParquetRecordBatchReaderBuilder::try_new(file).unwrap().build().unwrap();
    let mut scene = info.scenes_of(1).start;
    for batch in batches {
        let batch = batch.unwrap();
        let names = batch.column_by_name("gripper").unwrap().as_dictionary::<Int32Type>();
        let values = names.values().as_string::<i32>();
        for key in names.keys() {
            assert_eq!(values.value(key.unwrap() as usize), info.gripper_of(scene).name);
            scene += 1;
        }
    }
    assert_eq!(scene, info.scene_count);
}

#[test]
fn a_width_is_held_to_the_scenes_own_gripper() {
    let dir = tempfile::tempdir().unwrap();
    let info = info();
    let writer = || Draft::begin(dir.path(), &info).unwrap().shard(0).unwrap();
    let with_width = |scene: u64, width_m: f32| {
        let mut rows = synthetic::scene_rows(scene, info.seed, &info);
        rows.attempts.iter_mut().for_each(|attempt| attempt.width_m = attempt.width_m.map(|_| width_m));
        rows
    };
    let mut shard = writer();
    let refused = shard.push(&with_width(0, 0.15)).unwrap_err().to_string();
    assert!(refused.contains("width_m must be between -0.002 and 0.08"), "{refused}");
    for scene in 0..2 {
        shard.push(&with_width(scene, 0.05)).unwrap();
    }
    shard.push(&with_width(2, 0.15)).unwrap();
}

#[test]
fn grippers_that_cannot_be_are_refused() {
    type Case = (fn(&mut DatasetInfo), &'static str);
    let cases: [Case; 5] = [
        (|info| info.format_version = 1, "format_version must be 3, the lowest that"),
        (
            |info| info.grippers[1].name = "wider".to_owned(),
            "grippers must be grippers of different names, got two of wider",
        ),
        (|info| info.grippers.truncate(1), "grippers must be left out for a single gripper"),
        (|info| info.grippers.swap(0, 1), "grippers must begin with gripper"),
        (|info| info.grippers[2].friction = -1.0, "grippers.2.friction must be between 0 and 5, got -1"),
    ];
    for (change, expected) in cases {
        let mut info = info();
        change(&mut info);
        let told = DatasetInfo::from_json(info.to_json()).unwrap_err();
        assert!(told.contains(expected), "{expected:?} is not in {told:?}");
    }
}
