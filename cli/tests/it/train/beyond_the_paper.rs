//! What goes beyond the paper's recipe: off changes nothing, on resumes to the bit, and recipes from before it stay
//! good.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::fixture::{check_fails, fit, trainer, write_config, write_dataset};
use super::resume::{check_same_run, metrics};
use burn_dataset::Dataset as _;
use network::VoxelParams;
use network::head::Head;
use network::upsampling::Upsampling;
use shards::Dataset;
use trainer::batch::{Sample, SampleId};
use trainer::config::Config;
use trainer::data::{GraspDataset, SplitBits};
use trainer::device::Device;
use trainer::events::Event;
use trainer::fit::Ending;
use trainer::voxel::Voxel;

struct Place {
    dir: tempfile::TempDir,
    data: PathBuf,
    config: PathBuf,
}

impl Place {
    fn new(epochs: u32, training: &str, augmentation: &str) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let data = dir.path().join("data");
        write_dataset(&data, 5, 2, 10, 12);
        let config = write_config(dir.path(), epochs, 24);
        let text = fs::read_to_string(&config).unwrap();
        let text = text.replace("[split]", &format!("{training}\n{augmentation}\n[split]"));
        fs::write(&config, text).unwrap();
        Self { dir, data, config }
    }

    fn run(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn config(&self) -> Config {
        Config::load(Some(&self.config)).unwrap()
    }

    fn fit(&self, config: &Config, run: &Path) -> Ending {
        fit(&self.data, config, run, true, &AtomicBool::new(false), &|_| {}).unwrap()
    }

    fn args<'a>(&'a self, run: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
        let [data, config, run] = [&self.data, &self.config, run].map(|path| path.to_str().unwrap());
        [&["fit", "--data", data, "--config", config, "--run", run][..], more].concat()
    }
}

const AUGMENTED: &str = "[augmentation]\nquarter_turns = true\nmirrors = true\nshift_z_voxels_max = 3\n";

#[test]
fn all_of_it_resumes_to_the_bit() {
    let place = Place::new(2, "schedule = \"cosine\"\npositive_weight = 2.5\naverage_decay = 0.9", AUGMENTED);
    let by_closing = fs::read_to_string(&place.config).unwrap().replace("[network]", "[network]\nhead = \"closings\"");
    fs::write(&place.config, by_closing).unwrap();
    let (config, whole, cut) = (place.config(), place.run("whole"), place.run("cut"));
    assert_eq!(place.fit(&config, &whole), Ending::Done);
    for steps in [1, 3, 2] {
        let (stop, seen) = (AtomicBool::new(false), AtomicUsize::new(0));
        let ending = fit(&place.data, &config, &cut, true, &stop, &|event| {
            if matches!(event, Event::Step { .. }) && seen.fetch_add(1, Ordering::Relaxed) + 1 == steps {
                stop.store(true, Ordering::Relaxed);
            }
        });
        assert_eq!(ending.unwrap(), Ending::Stopped);
    }
    assert_eq!(place.fit(&config, &cut), Ending::Done);
    check_same_run(&whole, &cut);
    // 8 steps in all; the last of an epoch is its fourth.
    let cosines = [0.382_683_432_365_090, -0.923_879_532_511_287]; // of 3/8 and 7/8 of π
    for (line, cosine) in metrics(&whole).iter().zip(cosines) {
        let expected = 0.5e-3 * (1.0 + cosine);
        assert!((line["learning_rate"].as_f64().unwrap() - expected).abs() < 1e-12, "{line}");
    }
}

#[test]
fn each_part_changes_training_and_off_is_left_out() {
    let weights = |training: &str, augmentation: &str| {
        let place = Place::new(1, training, augmentation);
        let run = place.run("run");
        assert_eq!(place.fit(&place.config(), &run), Ending::Done);
        let tests = metrics(&run)[0]["test_scenes"]["loss"].clone();
        (fs::read(run.join("last.safetensors")).unwrap(), tests)
    };
    let left_out = weights("", "");
    let off = weights(
        "schedule = \"constant\"\npositive_weight = 1.0\npatience_epochs = 0",
        "average_decay = 0\n[augmentation]\nquarter_turns = false\nmirrors = false\nshift_z_voxels_max = 0\n",
    );
    assert!(left_out == off);
    let turned = weights("", "[augmentation]\nquarter_turns = true\n");
    let shifted = weights("", "[augmentation]\nshift_z_voxels_max = 4\n");
    let weighted = weights("positive_weight = 3", "");
    let cosine = weights("schedule = \"cosine\"", "");
    let mirrored = weights("", "[augmentation]\nmirrors = true\n");
    let averaged = weights("average_decay = 0.9", "");
    let all = [off, turned, shifted, weighted, cosine, mirrored, averaged];
    for (number, one) in all.iter().enumerate() {
        assert!(all[..number].iter().all(|other| other.1 != one.1), "{number}");
    }
}

/// A run's folder and checkpoints in the format before these keys existed.
#[test]
fn a_run_begun_before_these_keys_goes_on_and_is_evaluated() {
    let place = Place::new(1, "", "");
    let run = place.run("run");
    assert_eq!(place.fit(&place.config(), &run), Ending::Done);
    let new = place.config().to_toml();
    let old: String = new
        .lines()
        .filter(|line| {
            let key = line.split(' ').next().unwrap();
            !["schedule", "positive_weight", "shuffle_scenes", "[augmentation]", "quarter_turns", "shift_z_voxels_max"]
                .contains(&key)
        })
        .flat_map(|line| [line, "\n"])
        .collect();
    assert_eq!(Config::parse(&old, Path::new("old")).unwrap(), place.config());
    fs::write(run.join("config.toml"), &old).unwrap();
    for name in ["last.safetensors", "best.safetensors"] {
        let path = run.join(name);
        let bytes = fs::read(&path).unwrap();
        let end = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let mut header: serde_json::Value = serde_json::from_slice(&bytes[8..end]).unwrap();
        let own = &mut header["__metadata__"]["graspmill"];
        let mut inner: serde_json::Value = serde_json::from_str(own.as_str().unwrap()).unwrap();
        assert_eq!(inner["config"], serde_json::Value::String(new.clone()));
        inner["config"] = serde_json::Value::String(old.clone());
        inner.as_object_mut().unwrap().remove("file_sha256");
        *own = serde_json::Value::String(inner.to_string());
        let mut header = header.to_string().into_bytes();
        header.resize(header.len().next_multiple_of(8), b' ');
        let length = (header.len() as u64).to_le_bytes();
        fs::write(&path, [&length[..], &header, &bytes[end..]].concat()).unwrap();
    }
    let metrics_before = metrics(&run);
    let output = trainer(&place.args(&run, &["--resume", "--epochs", "2"]));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(metrics(&run)[0], metrics_before[0]);
    let [text, data] = [&run, &place.data].map(|path| path.to_str().unwrap());
    let output = trainer(&["evaluate", "--run", text, "--data", data]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // The result equals that of a new run.
    let whole = place.run("whole");
    let mut config = place.config();
    config.training.epochs = 2;
    assert_eq!(place.fit(&config, &whole), Ending::Done);
    check_same_but_best(&whole, &run);
}

/// The best weights may be of an epoch that ran under another number of epochs, and say so.
fn check_same_but_best(a: &Path, b: &Path) {
    assert_eq!(metrics(a), metrics(b));
    for file in ["last.safetensors", "config.toml"] {
        assert!(fs::read(a.join(file)).unwrap() == fs::read(b.join(file)).unwrap(), "{file} differs");
    }
}

#[test]
fn other_epochs_under_a_cosine_are_78() {
    let place = Place::new(1, "schedule = \"cosine\"", "");
    let run = place.run("run");
    assert_eq!(place.fit(&place.config(), &run), Ending::Done);
    let texts = ["training.epochs (1 there, 2 asked for); a cosine schedule depends on training.epochs"];
    check_fails(&place.args(&run, &["--resume", "--epochs", "2"]), 78, &texts);
    assert!(trainer(&place.args(&run, &["--resume"])).status.success());
}

fn count_samples(marks: &[SplitBits]) -> usize {
    let of = |marks: &SplitBits| {
        marks.scenes().flat_map(|scene| marks.of_scene(scene)).filter(|(_, mark)| *mark > 0).count()
    };
    marks.iter().map(of).sum()
}

#[test]
fn several_datasets_are_trained_on_as_one_and_their_order_is_part_of_the_run() {
    let place = Place::new(1, "", "");
    let (run, more) = (place.run("run"), place.run("more"));
    write_dataset(&more, 6, 1, 5, 12);
    let more = more.to_str().unwrap();
    let data = place.data.to_str().unwrap();
    let output = trainer(&place.args(&run, &["--data", more]));
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(told.contains("120 attempts in 10 scenes") && told.contains("60 attempts in 5 scenes"), "{told}");
    let epoch = &metrics(&run)[0];
    let samples = |set: &str| epoch[set]["samples"].as_u64().unwrap();
    assert_eq!(samples("train") + samples("test_attempts") + samples("test_scenes"), 180);
    let datasets = [data, more].map(|at| Dataset::open(Path::new(at)).unwrap());
    let survey = |datasets| {
        let params = VoxelParams::at_tips(Upsampling::Linear);
        let method = Voxel::new(params, Device::Host);
        GraspDataset::survey(datasets, method, &AtomicBool::new(false), &|| {}).unwrap()
    };
    let (all, second) = (survey(&datasets), survey(&datasets[1..]));
    assert_eq!((all.len(), second.len(), count_samples(&all.marks)), (15, 5, 180));
    for scene in 0..5 {
        let [together, alone] = [all.get(10 + scene).unwrap(), second.get(scene).unwrap()];
        assert_eq!((&together.grid, together.number), (&alone.grid, alone.number + 10));
        assert_eq!((together.first_attempt, alone.first_attempt), (120 + 12 * scene as u64, 12 * scene as u64));
        for (together, alone) in together.samples.iter().zip(&alone.samples) {
            let id = SampleId { scene: alone.id.scene + 10, ..alone.id };
            assert_eq!(*together, Sample { id, ..*alone });
        }
    }
    let config = place.config.to_str().unwrap();
    check_fails(
        &["fit", "--data", more, "--data", data, "--config", config, "--run", run.to_str().unwrap(), "--resume"],
        78,
        &["begun on another dataset"],
    );
    let run = run.to_str().unwrap();
    check_fails(&["evaluate", "--run", run, "--data", more, "--split", "all"], 78, &["several datasets", "among them"]);
    check_fails(&place.args(&place.run("twice"), &["--data", data]), 78, &["given twice"]);
}

/// VGN's six yaws at a point are one sample of a network with one orientation a voxel, and six of one that is asked by
/// closing direction.
#[test]
fn each_yaw_is_a_sample_of_a_head_by_closing() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/generate/vgn.toml");
    let words = ["--attempts", "120", "--shards", "1"];
    let made = Command::new(env!("CARGO_BIN_EXE_generator"))
        .args(["--config", config.to_str().unwrap(), "--out", data.to_str().unwrap()])
        .args(words)
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let datasets = [Dataset::open(&data).unwrap()];
    let [points, yaws] = [Head::Quaternion, Head::Closings].map(|head| {
        let params = VoxelParams { head, ..VoxelParams::at_tips(Upsampling::Linear) };
        let method = Voxel::new(params, Device::Host);
        count_samples(&GraspDataset::survey(&datasets, method, &AtomicBool::new(false), &|| {}).unwrap().marks)
    });
    assert!(points > 0 && yaws == 6 * points, "{points} points, {yaws} yaws");
}
