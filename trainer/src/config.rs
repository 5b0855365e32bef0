//! The training recipe, each key as the type that training computes with.
//!
//! The keys of a method stand in the tables that both methods have; of the other method they are unknown.
//!
//! What goes beyond the paper (`network.head`, `[augmentation]`, `training.schedule`, `training.positive_weight`,
//! `training.average_decay`) may be left out and then is off: recipes and checkpoints from before these keys stay good.

use std::path::Path;

use serde::Serialize;
use settings::{Document, Reader, Row, Setting, Value, above, rows_of, settings, words};
use toml::Table;

use crate::schedule::Schedule;
use crate::voxel::augmentation::Augmentation;
use network::head::Head;
use network::upsampling::Upsampling;
use network::{BEHIND_TIPS_M_MAX, GraspOrigin, Kind, VoxelParams};

/// The paper's recipe, the default.
pub const PAPER: &str = include_str!("../../configs/train/paper.toml");
/// A judge's recipe.
pub const JUDGE: &str = include_str!("../../configs/train/judge.toml");

/// A recipe. The keys of a method stand in the tables that both methods have.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Seed of the split, the order of samples and the initial weights.
    pub seed: u64,
    /// SHA-256 of the checkpoint whose weights training begins with.
    pub from: Option<String>,
    /// The network, with what only its method has.
    pub method: Method,
    /// The steps.
    pub training: TrainingParams,
    /// Which samples test.
    pub split: SplitConfig,
    /// When the state is saved.
    pub checkpoint: CheckpointParams,
}

/// A network, with the keys that only its method has.
#[derive(Debug, Clone, PartialEq)]
pub enum Method {
    /// The paper's network, or one that differs in its head.
    Voxel(VoxelConfig),
    /// A judge.
    Judge,
}

settings! {
    /// What both methods have.
    struct Common {
        /// Seed of the split, the order of samples and the initial weights.
        seed: u64 where 0..=i64::MAX.unsigned_abs(),
        /// The network.
        network: NetworkParams,
        /// The steps.
        training: TrainingParams,
        /// Which samples test.
        split: SplitConfig,
        /// When the state is saved.
        checkpoint: CheckpointParams,
    }
}

settings! {
    /// What both methods have of the network.
    struct NetworkParams {
        /// Which network. The keys after `checkpoint.every_steps` are those of `voxel` alone.
        kind: Kind; or Kind::Voxel,
        /// SHA-256 of the checkpoint whose weights training begins with (--from).
        from: Option<String>; or None,
    }
}

settings! {
    /// What only the voxel network has, by tables.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct VoxelConfig {
        /// The network.
        pub network: VoxelNetwork,
        /// What a sample is.
        pub training: VoxelTraining,
        /// How training scenes are turned and shifted.
        pub augmentation: Augmentation; or Augmentation::OFF,
    }
}

settings! {
    /// What belongs to the voxel network besides its parameters.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct VoxelNetwork {
        /// What a network of voxels answers: the paper's orientation, or a grasp by closing direction.
        #[serde(skip_serializing_if = "is_quaternion")]
        pub head: Head; or Head::Quaternion,
        /// How the decoder of the paper's network doubles its grids.
        pub upsampling: Upsampling; or Upsampling::Linear,
        /// Where the paper's network has the origin of a grasp: so far behind the finger tips, against the approach. 0
        /// is midway between the tips, the fingers' length midway between their roots, as VGN has it.
        pub origin_behind_tips_m: f32 where 0.0..=BEHIND_TIPS_M_MAX; or 0.0,
    }
}

/// What is not stored, so that runs from before it can be resumed.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_quaternion(head: &Head) -> bool {
    *head == Head::Quaternion
}

impl VoxelNetwork {
    /// As an architecture has it.
    #[must_use]
    pub const fn params(&self) -> VoxelParams {
        let Self { head, upsampling, origin_behind_tips_m } = *self;
        VoxelParams { head, upsampling, origin: GraspOrigin::behind_tips(origin_behind_tips_m) }
    }
}

settings! {
    /// What a sample of the voxel network is.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct VoxelTraining {
        /// How much more a held attempt's quality loss counts than a failed one's; 1 is the paper's.
        pub positive_weight: f64 where above(0.0, 1000.0); or 1.0,
    }
}

settings! {
    /// How weights are changed.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct TrainingParams {
        /// Passes over the training samples.
        pub epochs: u32 where 1..=10_000,
        /// Samples a step.
        pub batch: usize where 1..=4096,
        /// Adam's step size; the first step's where the schedule changes it.
        pub learning_rate: f64 where above(0.0, 1.0),
        /// How the step size changes.
        pub schedule: Schedule; or Schedule::Constant,
        /// Share of the running mean of the weights that stays in a step; the mean is tested and saved. 0 for none, the
        /// paper's.
        #[serde(skip_serializing_if = "is_default")]
        pub average_decay: f64 where 0.0..=0.99999; or 0.0,
        /// Samples of one scene that stay together in the order of an epoch: 1 is a plain shuffle; more share the
        /// encoder's work and make batches less mixed.
        pub samples_per_scene: usize where 1..=4096,
        /// Scenes in memory, 256 kB each. Among so many an epoch is shuffled fully; of more it is a shuffle in a window
        /// of so many.
        pub shuffle_scenes: usize where 1..=1_000_000; or 4096,
    }
}

/// What is not stored, so that runs from before it can be resumed.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

settings! {
    /// Which samples are held out, and how. Both kinds always are, so that one training run yields both accuracies.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct SplitConfig {
        /// The test set whose accuracy is *the* accuracy, and chooses the best checkpoint.
        pub by: SplitBy,
        /// Share of all samples in that test set.
        pub test_share: f64 where above(0.0, 0.45),
        /// Share of all samples in the other one.
        pub other_share: f64 where above(0.0, 0.45),
    }
}

words! {
    /// A way to hold out samples.
    pub enum SplitBy {
        /// Single attempts, as the paper does: the network has seen the same grid with other attempts.
        Attempt = "attempt",
        /// Whole scenes: nothing leaks.
        Scene = "scene",
    }
}

settings! {
    /// When the state is saved.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct CheckpointParams {
        /// Steps between checkpoints within an epoch; 0 for one at the end of each epoch only.
        pub every_steps: u32 where 0..=1_000_000,
    }
}

impl Config {
    /// The recipe of a file, or the paper's.
    ///
    /// # Errors
    /// [`settings::Error`] with every unknown, missing and out-of-range key.
    pub fn load(path: Option<&Path>) -> Result<Self, settings::Error> {
        Document::load(path, [PAPER, "configs/train/paper.toml"])?.read()
    }

    /// Checks the text of a recipe; `path` is for messages.
    ///
    /// # Errors
    /// As [`Config::load`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, settings::Error> {
        Document::parse(text, path)?.read()
    }

    /// The recipe as TOML, every key of its method written out.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let Self { seed, from, method, training, split, checkpoint } = self;
        let from = from.as_ref().map(|from| format!("from = {}\n", Value::from(from.as_str()))).unwrap_or_default();
        // The voxel network's kind goes without saying, so its recipes stay as they were before there was another.
        let [network, own, augmentation] = match method {
            Method::Voxel(VoxelConfig { network, training, augmentation }) => {
                [text(network), text(training), format!("\n[augmentation]\n{}", text(augmentation))]
            }
            Method::Judge => ["kind = \"judge\"\n".to_owned(), String::new(), String::new()],
        };
        let [training, split, checkpoint] = [text(training), text(split), text(checkpoint)];
        format!(
            "seed = {seed}\n\n[network]\n{network}{from}\n[training]\n{training}{own}{augmentation}\n[split]\n{split}\n\
             [checkpoint]\n{checkpoint}"
        )
    }
}

/// Keys of `[training]` in files of 0.3.0 that chose between what is gone and what is left.
const GONE: [(&str, &str); 3] = [("targets", "\"attempt\""), ("closings", "\"attempt\""), ("patience_epochs", "0")];

/// A table's keys as TOML.
fn text(table: &impl Serialize) -> String {
    toml::to_string(table).unwrap_or_default() // numbers and words always have a TOML form
}

impl Setting for Config {
    type Limits = ();

    fn kind((): &()) -> String {
        Common::kind(&())
    }

    fn read(value: &Value, (): &(), reader: &mut Reader<'_>) -> Option<Self> {
        let mut common = value.as_table().cloned().unwrap_or_default();
        if let Some(training) = common.get_mut("training").and_then(Value::as_table_mut) {
            training.retain(|key, value| !GONE.contains(&(key, value.to_string().as_str())));
        }
        let kind = common.get("network").and_then(|network| network.get("kind"));
        let method = if kind.and_then(Value::as_str) == Some(Kind::Judge.name()) {
            // Files of judges from before 0.4.0 have keys of the voxel network, each with its default.
            let is_default =
                |row: &Row, value: &Value| row.default.as_deref() == Some(value.to_string().trim_end_matches(".0"));
            take(&mut common, is_default);
            common.retain(|_, value| *value != Value::Table(Table::new()));
            Some(Method::Judge)
        } else {
            let augmentation = common.remove("augmentation");
            let mut own = take(&mut common, |_, _| true);
            own.extend(augmentation.map(|table| ("augmentation".to_owned(), table)));
            VoxelConfig::read(&Value::Table(own), &(), reader).map(Method::Voxel)
        };
        let common = Common::read(&Value::Table(common), &(), reader);
        let Common { seed, network, training, split, checkpoint } = common?;
        Some(Self { seed, from: network.from, method: method?, training, split, checkpoint })
    }

    fn add_rows(prefix: &str, _: Option<&Self>, rows: &mut Vec<Row>) -> bool {
        Common::add_rows(prefix, None, rows) && VoxelConfig::add_rows(prefix, None, rows)
    }
}

/// Takes the keys of the voxel network out of a recipe, those that are meant.
fn take(recipe: &mut Table, is_meant: impl Fn(&Row, &Value) -> bool) -> Table {
    let mut taken = Table::new();
    for row in rows_of::<VoxelConfig>() {
        let Some((name, key)) = row.key.split_once('.') else { continue };
        let own = taken.entry(name).or_insert_with(|| Table::new().into()).as_table_mut();
        let (Some(own), Some(Value::Table(table))) = (own, recipe.get_mut(name)) else { continue };
        if table.get(key).is_some_and(|value| is_meant(&row, value)) {
            own.extend(table.remove_entry(key));
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;
    const GOOD: &str = PAPER;

    #[test]
    fn the_papers_recipe_is_read_and_comes_back_from_its_own_toml() {
        let config = Config::parse(GOOD, Path::new("paper.toml")).unwrap();
        assert_eq!((config.training.epochs, config.training.batch, config.training.learning_rate), (30, 48, 3e-4));
        assert_eq!(config.split.by, SplitBy::Attempt);
        assert_eq!(Config::parse(&config.to_toml(), Path::new("again")).unwrap(), config);
    }

    /// A recipe, and a checkpoint's, from before the keys that may be left out.
    const OLD: &str = "seed = 1\n\n[network]\nupsampling = \"linear\"\n\n[training]\nepochs = 30\nbatch = 48\n\
                       learning_rate = 0.0003\nsamples_per_scene = 1\n\n[split]\nby = \"attempt\"\ntest_share = 0.1\n\
                       other_share = 0.03\n\n[checkpoint]\nevery_steps = 500\n";

    #[test]
    fn what_goes_beyond_the_paper_may_be_left_out_and_is_off() {
        let config = Config::parse(OLD, Path::new("old.toml")).unwrap();
        let mut paper = Config::parse(GOOD, Path::new("paper.toml")).unwrap();
        let Method::Voxel(own) = &mut paper.method else { panic!("a judge") };
        own.network.origin_behind_tips_m = 0.0;
        assert_eq!((own.augmentation, own.training.positive_weight), (Augmentation::OFF, 1.0));
        paper.training.samples_per_scene = 1;
        paper.training.average_decay = 0.0;
        assert_eq!(config, paper);
        assert_eq!(config.training.schedule, Schedule::Constant);
    }

    #[test]
    fn keys_that_are_gone_may_say_what_is_left() {
        let parse = |key: &str| Config::parse(&OLD.replace("\n[split]", &format!("{key}\n[split]")), Path::new("x"));
        let old = Config::parse(OLD, Path::new("old.toml")).unwrap();
        for (key, value) in GONE {
            assert_eq!(parse(&format!("{key} = {value}\n")).unwrap(), old, "{key}");
            let told = parse(&format!("{key} = 7\n")).unwrap_err().to_string();
            assert!(told.contains(&format!("training.{key} is an unknown key")), "{told}");
        }
    }

    #[test]
    fn what_goes_beyond_the_paper_is_checked_too() {
        let text = OLD.replace(
            "[split]",
            "schedule = \"linear\"\npositive_weight = 0.0\naverage_decay = 1\n\
                   [augmentation]\nquarter_turns = 1\nshift_z_voxels_max = 40\nflips = true\n[split]",
        );
        let Err(settings::Error::Invalid { faults: problems, .. }) = Config::parse(&text, Path::new("x")) else {
            panic!("must be refused");
        };
        let all = problems.join("\n");
        for problem in [
            "training.schedule must be one of constant, cosine, got linear",
            "training.positive_weight must be above 0 and at most 1000, got 0",
            "training.average_decay must be between 0 and 0.99999, got 1",
            "augmentation.quarter_turns must be true or false, got 1",
            "augmentation.shift_z_voxels_max must be between 0 and 39, got 40",
            "augmentation.flips is an unknown key",
        ] {
            assert!(all.contains(problem), "{problem} is not in\n{all}");
        }
        assert_eq!(problems.len(), 6, "{all}");
    }

    #[test]
    fn a_judge_has_no_keys_of_the_voxel_network() {
        let parse = |text: &str| Config::parse(text, Path::new("judge.toml"));
        let judge = parse(JUDGE).unwrap();
        assert_eq!(judge.method, Method::Judge);
        assert_eq!(parse(&judge.to_toml()).unwrap(), judge);
        let text = JUDGE.replace(
            "[training]",
            "upsampling = \"nearest\"\norigin_behind_tips_m = 0.05\n[training]\n\
                     positive_weight = 2.0\ntargets = \"voxel\"\nclosings = \"object\"",
        ) + "[augmentation]\nquarter_turns = true\n";
        let Err(settings::Error::Invalid { faults, .. }) = parse(&text) else { panic!("must be refused") };
        let keys = ["augmentation", "network.origin_behind_tips_m", "network.upsampling", "training.closings"];
        let keys = keys.into_iter().chain(["training.positive_weight", "training.targets"]);
        assert_eq!(faults, keys.map(|key| format!("{key} is an unknown key")).collect::<Vec<_>>());
        // As checkpoints of judges have them.
        let text = JUDGE.replace(
            "[training]",
            "upsampling = \"linear\"\n[training]\npositive_weight = 1.0\ntargets = \"attempt\"\nclosings = \"attempt\"",
        ) + "[augmentation]\nquarter_turns = false\nshift_z_voxels_max = 0\n";
        assert_eq!(parse(&text).unwrap(), judge);
    }

    #[test]
    fn every_problem_is_told_at_once_with_its_key() {
        let text = "seed = -1\nspeed = 3\n[network]\nupsampling = \"cubic\"\n[training]\nepochs = 0\nbatch = \"many\"\n\
                    learning_rate = 0.0\n[training.deep]\nx = 1\n[split]\nby = \"day\"\ntest_share = 0.9\nother_share = 0.1\n\
                    [checkpoint]\nevery_steps = 10\n";
        let Err(settings::Error::Invalid { faults: problems, .. }) = Config::parse(text, Path::new("x")) else {
            panic!("must be refused");
        };
        let all = problems.join("\n");
        for key in [
            "seed must be a whole number between 0 and 9223372036854775807, got -1",
            "speed is an unknown key, did you mean seed?",
            "network.upsampling must be one of linear, nearest, got cubic",
            "training.epochs must be between 1 and 10000, got 0",
            "training.batch must be a whole number between 1 and 4096, got \"many\"",
            "training.learning_rate must be above 0 and at most 1, got 0",
            "training.samples_per_scene is missing",
            "training.deep is an unknown key",
            "split.by must be one of attempt, scene, got day",
            "split.test_share must be above 0 and at most 0.45, got 0.9",
        ] {
            assert!(all.contains(key), "{key} is not in\n{all}");
        }
        assert_eq!(problems.len(), 10, "{all}");
    }

    #[test]
    fn what_is_not_toml_is_said_to_be_none() {
        assert!(matches!(Config::parse("seed = = 1", Path::new("x")), Err(settings::Error::Syntax { .. })));
    }
}
