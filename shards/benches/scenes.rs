//! Measures writing and reading a shard of 64 scenes. `cargo bench -p shards`.

use std::path::Path;

use schema::SceneRows;
use shards::{Dataset, DatasetInfo, Draft};

#[path = "../../tests/support/synthetic.rs"]
mod synthetic;

fn main() {
    divan::main();
}

fn rows() -> (DatasetInfo, Vec<SceneRows>) {
    let info = synthetic::info(7, 1, 64 * 60, 60);
    let scenes = info.scenes_of(0).map(|scene_id| synthetic::scene_rows(scene_id, info.seed, &info)).collect();
    (info, scenes)
}

fn write(dir: &Path, info: &DatasetInfo, scenes: &[SceneRows]) {
    let draft = Draft::begin(dir, info).expect("an empty folder");
    let mut writer = draft.shard(0).expect("a shard");
    for rows in scenes {
        writer.push(rows).expect("sound rows");
    }
    writer.commit().expect("a whole shard");
}

#[divan::bench(sample_count = 10, sample_size = 1)]
fn write_a_shard(bencher: divan::Bencher<'_, '_>) {
    let (info, scenes) = rows();
    let folder = || tempfile::tempdir().expect("a temporary folder");
    bencher.with_inputs(folder).bench_local_values(|dir| {
        write(dir.path(), &info, &scenes);
        dir
    });
}

#[divan::bench(sample_count = 10, sample_size = 1)]
fn read_a_shard(bencher: divan::Bencher<'_, '_>) {
    let (info, scenes) = rows();
    let dir = tempfile::tempdir().expect("a temporary folder");
    write(dir.path(), &info, &scenes);
    Draft::open(dir.path()).expect("a draft").finalize().expect("a complete dataset");
    bencher.bench_local(|| {
        let dataset = Dataset::open(dir.path()).expect("a dataset");
        dataset.rows(0, true).expect("a shard").map(|rows| rows.expect("a scene").scene.tsdf.len()).sum::<usize>()
    });
}
