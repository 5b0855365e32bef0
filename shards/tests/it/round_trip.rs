//! Written rows are read back unchanged, and the same rows give the same bytes.

use crate::sample;

use proptest::prelude::*;
use shards::{Dataset, DatasetInfo};

fn read_back(dir: &std::path::Path, info: &DatasetInfo) {
    let dataset = Dataset::open(dir).unwrap();
    assert_eq!(dataset.info(), info);
    for shard in 0..info.shard_count {
        let written = sample::rows(info, shard);
        assert!(dataset.rows(shard, true).unwrap().map(Result::unwrap).eq(written.iter().cloned()));
        let heads: Vec<_> = dataset.rows(shard, false).unwrap().map(|rows| rows.unwrap().scene).collect();
        let scenes = written.iter().map(|rows| &rows.scene);
        assert!(heads.iter().map(|s| (&s.views, s.object_count)).eq(scenes.map(|s| (&s.views, s.object_count))));
        assert!(heads.iter().all(|s| s.tsdf.is_empty()));
        for rows in written {
            assert_eq!(dataset.read_scene(rows.scene.scene_id).unwrap(), rows);
        }
    }
    assert!(dataset.rows(info.shard_count, false).is_err());
    assert!(dataset.read_scene(info.scene_count).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_row_comes_back_as_it_was(seed: u64, shards in 1_u32..4, attempts in 40_u64..120, per_scene in 1_u32..13) {
        let dir = tempfile::tempdir().unwrap();
        let mut info = sample::sized(seed, 1, attempts, per_scene);
        info.shard_count = shards.min(info.scene_count as u32);
        info.grid.resolution = 4;
        sample::write(dir.path(), &info);
        read_back(dir.path(), &info);
    }
}

#[test]
fn a_shard_of_several_row_groups_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let mut info = sample::sized(5, 1, 2 * 600 - 1, 2);
    info.grid.resolution = 2;
    sample::write(dir.path(), &info);
    read_back(dir.path(), &info);
}

#[test]
fn a_dataset_is_named_by_its_infos_bytes_whatever_its_numbers_become_when_they_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let mut info = sample::info(11);
    info.config = (1..1000_u16).map(|i| f64::from(f32::from(i) / 1000.0)).collect();
    sample::write(dir.path(), &info);
    let dataset = Dataset::open(dir.path()).unwrap();
    assert_eq!(dataset.id(), info.dataset_id());
    let read = dataset.info().dataset_id();
    assert_ne!(dataset.id(), read, "serde_json reads exactly; `Dataset::has_id` is not needed for new datasets");
    assert!(dataset.has_id(dataset.id()) && dataset.has_id(&read) && !dataset.has_id("another"));
}

#[test]
fn the_same_rows_make_the_same_bytes() {
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let info = sample::info(11);
    sample::write(one.path(), &info);
    let draft = shards::Draft::begin(two.path(), &info).unwrap();
    for shard in (0..info.shard_count).rev() {
        sample::write_shard(&draft, shard);
        sample::write_shard(&draft, shard); // once more, over itself
    }
    draft.finalize().unwrap();
    draft.finalize().unwrap();
    assert_eq!(sample::files(one.path()), sample::files(two.path()));
}
