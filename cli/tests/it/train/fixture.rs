//! Small learnable datasets: boxes on a table seen from above; a grasp holds where there is a box below.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::AtomicBool;

use program::Failure;
use schema::{Outcome, Purpose, SceneRows, Stream, Vec3};
use shards::{DatasetInfo, Draft, Finalized};
use trainer::config::Config;
use trainer::device::Device;
use trainer::events::Event;
use trainer::fit::{Ending, Job};

use crate::synthetic;

const N: usize = 40;
const TABLE_VOXELS: f32 = 6.0;

/// Writes a dataset and gives its info.
pub(crate) fn write_dataset(dir: &Path, seed: u64, shards: u32, scenes: u64, attempts_per_scene: u32) -> DatasetInfo {
    let info = synthetic::info(seed, shards, scenes * u64::from(attempts_per_scene), attempts_per_scene);
    write_dataset_of(dir, &info);
    info
}

/// Writes the dataset of an info.
pub(crate) fn write_dataset_of(dir: &Path, info: &DatasetInfo) {
    let draft = Draft::begin(dir, info).unwrap();
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).unwrap();
        for scene in info.scenes_of(shard) {
            writer.push(&scene_rows(scene, info)).unwrap();
        }
        writer.commit().unwrap();
    }
    assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
}

fn scene_rows(scene: u64, info: &DatasetInfo) -> SceneRows {
    let mut coarse = info.clone();
    coarse.grid.resolution = 2; // the rows are wanted, not the slow grid
    let mut rows = synthetic::scene_rows(scene, info.seed, &coarse);
    let mut draw = Stream::new(info.seed, scene, Purpose::Drops, 99);
    let boxes: Vec<[usize; 5]> = (0..2)
        .map(|_| [4 + draw.index(18), 4 + draw.index(18), 9 + draw.index(6), 9 + draw.index(6), 4 + draw.index(8)])
        .collect();
    let below = |x: usize, y: usize| {
        let over = boxes.iter().filter(|b| (b[0]..b[0] + b[2]).contains(&x) && (b[1]..b[1] + b[3]).contains(&y));
        over.map(|b| b[4]).max()
    };
    rows.scene.tsdf = (0..N * N * N)
        .map(|at| {
            let (x, y, z) = (at / (N * N), at / N % N, at % N);
            let top = TABLE_VOXELS + below(x, y).unwrap_or(0) as f32;
            let distance = (z as f32 + 0.5 - top) / 4.0;
            if distance.abs() < 0.98 { 0.5 * (distance + 1.0) } else { 0.0 }
        })
        .collect();
    for attempt in &mut rows.attempts {
        let [x, y] = if draw.unit() < 0.4 {
            let b = boxes[draw.index(boxes.len())];
            [b[0] + draw.index(b[2]), b[1] + draw.index(b[3])]
        } else {
            [draw.index(N), draw.index(N)]
        };
        let z = 8 + draw.index(10);
        attempt.workspace_from_grasp.translation =
            (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * info.grid.voxel_size_m();
        attempt.hit = None;
        attempt.hit_object_id = None;
        (attempt.outcome, attempt.width_m) = match below(x, y) {
            Some(_) => (Outcome::Held, Some(0.03)),
            None => (Outcome::Empty, Some(0.0)),
        };
    }
    rows
}

/// Trains on the host.
pub(crate) fn fit(
    data: &Path,
    config: &Config,
    run: &Path,
    resume: bool,
    stop: &AtomicBool,
    observe: &(dyn Fn(Event<'_>) + Sync),
) -> Result<Ending, Failure> {
    let job = Job { data: &[data.into()], config, run, from: None, resume, device: &Device::Host };
    trainer::fit::fit(&job, stop, observe)
}

/// Runs the program.
pub(crate) fn trainer(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer")).args(args).output().unwrap()
}

/// Runs the program and checks its exit code and that its standard error holds some texts.
pub(crate) fn check_fails(args: &[&str], code: i32, texts: &[&str]) {
    let output = trainer(args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
    for text in texts {
        assert!(stderr.contains(text), "{args:?}: {text:?} is not in {stderr:?}");
    }
}

/// A recipe that trains fast: `epochs` epochs of batches of `batch`, six samples of a scene together.
pub(crate) fn write_config(dir: &Path, epochs: u32, batch: u32) -> PathBuf {
    let text = format!(
        "seed = 3\n[network]\nupsampling = \"nearest\"\n[training]\nepochs = {epochs}\nbatch = {batch}\n\
         learning_rate = 1e-3\nsamples_per_scene = 6\n[split]\nby = \"attempt\"\ntest_share = 0.1\nother_share = 0.1\n\
         [checkpoint]\nevery_steps = 0\n"
    );
    let path = dir.join("config.toml");
    std::fs::write(&path, text).unwrap();
    path
}
