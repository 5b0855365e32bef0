//! Datasets of formats 1, 4 and 5, as the first versions wrote them. Every later version must read them, and must make
//! the same bytes of the same rows until the format's version says otherwise.

use std::path::{Path, PathBuf};

use schema::{Container, ContainerKind};
use shards::{Dataset, Draft, verify};

use crate::sample;

/// The id of the dataset in `tests/data/format-1`, and so the digest of its info.
const GOLDEN_ID: &str = "968dc1dab7446a90ed9c1d05dd6c11797e6a75bc473826ca5bcb7cd2cac93f4b";

fn golden(format: u32) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/format-{format}"))
}

#[test]
fn a_dataset_of_format_1_is_read() {
    let verified = verify(&golden(1), |_| ()).unwrap();
    assert!(verified.is_ok(), "{:?}", verified.problems);
    let dataset = Dataset::open(&golden(1)).unwrap();
    assert_eq!(dataset.info().format_version, 1);
    assert_eq!(dataset.manifest().dataset_id, GOLDEN_ID);
    let scene = dataset.read_scene(3).unwrap();
    assert_eq!((scene.scene.scene_id, scene.attempts.len()), (3, 4));
    insta::assert_debug_snapshot!("golden_attempt", scene.attempts[1]);
    insta::assert_debug_snapshot!("golden_object", scene.objects[0]);
}

#[test]
fn a_dataset_of_format_4_is_read() {
    let verified = verify(&golden(4), |_| ()).unwrap();
    assert!(verified.is_ok(), "{:?}", verified.problems);
    let dataset = Dataset::open(&golden(4)).unwrap();
    assert_eq!(dataset.info().format_version, 4);
    let container = |scene| dataset.read_scene(scene).unwrap().scene.container;
    assert_eq!(container(0), Some(Container::of_sizes(ContainerKind::Bin, [0.27, 0.25, 0.03, 0.004, 0.1])));
    assert_eq!(container(3), None);
}

#[test]
fn a_dataset_of_format_5_is_read() {
    let verified = verify(&golden(5), |_| ()).unwrap();
    assert!(verified.is_ok(), "{:?}", verified.problems);
    let dataset = Dataset::open(&golden(5)).unwrap();
    assert_eq!(dataset.info().format_version, 5);
    let attempts = |scene| dataset.read_scene(scene).unwrap().attempts;
    let all: Vec<_> = (0..dataset.info().scene_count).flat_map(attempts).collect();
    assert!(all.iter().all(|attempt| attempt.robustness == (attempt.label() == 1).then_some(0.5)));
    assert!(all.iter().any(|attempt| attempt.robustness.is_some()));
}

#[test]
fn the_rows_of_a_format_make_its_bytes() {
    for format in [1, 4, 5] {
        makes_its_bytes(&golden(format));
    }
}

fn makes_its_bytes(golden: &Path) {
    let dataset = Dataset::open(golden).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let info = dataset.info();
    let draft = Draft::begin(dir.path(), info).unwrap();
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).unwrap();
        for scene in info.scenes_of(shard) {
            writer.push(&dataset.read_scene(scene).unwrap()).unwrap();
        }
        writer.commit().unwrap();
    }
    draft.finalize().unwrap();
    let data = |dir: &Path| sample::files(dir).into_iter().filter(|(path, _)| path != Path::new("README.md"));
    for (made, golden) in data(dir.path()).zip(data(golden)) {
        assert_eq!(made.0, golden.0);
        assert!(made.1 == golden.1, "{} differs", made.0.display());
    }
}

#[test]
#[ignore = "run by hand, once a format"]
fn writes_the_golden_dataset() {
    let mut info = sample::sized(1, 2, 18, 4);
    info.grid.resolution = 6;
    info.config["container"] = serde_json::json!([{"kind": "bin", "share": 0.75}]);
    info.config["robustness"] = serde_json::json!({"share": 1.0});
    info.format_version = info.version();
    let folder = golden(info.format_version);
    assert!(!folder.exists(), "samples of earlier formats are kept: name a new folder");
    sample::write(&folder, &info);
}
