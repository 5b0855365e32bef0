//! The training recipe, each key as the type that training computes with.
//!
//! What goes beyond the paper (`network.head`, `[augmentation]`, `training.schedule`, `training.positive_weight`,
//! `training.average_decay`, `training.patience_epochs`) may be left out and then is off: recipes and checkpoints from
//! before these keys stay good.

use std::path::Path;

use serde::ser::SerializeStruct as _;
use serde::{Deserialize, Serialize, Serializer};
use settings::{Document, Reader, above, settings, words};

use crate::schedule::Schedule;
use crate::voxel::augmentation::Augmentation;
use network::head::Head;
use network::upsampling::Upsampling;
use network::{BEHIND_TIPS_M_MAX, GraspOrigin, Kind, VoxelParams};

/// The paper's recipe, the default.
pub const PAPER: &str = include_str!("../../configs/train/paper.toml");
/// A judge's recipe.
pub const JUDGE: &str = include_str!("../../configs/train/judge.toml");

settings! {
    /// A recipe.
    #[derive(Debug, Clone, PartialEq, Serialize)]
    pub struct Config {
        /// Seed of the split, the order of samples and the initial weights.
        pub seed: u64 where 0..=i64::MAX.unsigned_abs(),
        /// The network.
        pub network: NetworkParams,
        /// The steps.
        pub training: TrainingParams,
        /// How training scenes are turned and shifted.
        pub augmentation: Augmentation; or Augmentation::OFF,
        /// Which samples test.
        pub split: SplitConfig,
        /// When the state is saved.
        pub checkpoint: CheckpointParams,
    }
    check Config::fits_the_network
}

settings! {
    /// What the recipe decides of the network.
    #[derive(Debug, Clone, PartialEq)]
    pub struct NetworkParams {
        /// Which network.
        pub kind: Kind; or Kind::Voxel,
        /// What a network of voxels answers: the paper's orientation, or a hand by closing direction.
        pub head: Head; or Head::Quaternion,
        /// How the decoder of the paper's network doubles its grids.
        pub upsampling: Upsampling; or Upsampling::Linear,
        /// Where the paper's network has the origin of a grasp: so far behind the finger tips, against the approach. 0
        /// is midway between the tips, the fingers' length midway between their roots, as VGN has it.
        pub origin_behind_tips_m: f32 where 0.0..=BEHIND_TIPS_M_MAX; or 0.0,
        /// SHA-256 of the checkpoint whose weights training begins with (--from).
        pub from: Option<String>; or None,
    }
}

impl NetworkParams {
    /// What belongs to the paper's network besides its parameters.
    #[must_use]
    pub const fn voxel(&self) -> VoxelParams {
        let Self { head, upsampling, .. } = *self;
        VoxelParams { head, upsampling, origin: GraspOrigin::behind_tips(self.origin_behind_tips_m) }
    }
}

impl Serialize for NetworkParams {
    /// The keys that matter for the kind. That of the paper's network goes without saying, so its recipes stay as they
    /// were before there was another.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut table = serializer.serialize_struct("network", 1)?;
        match self.kind {
            Kind::Voxel => {
                if self.head != Head::Quaternion {
                    table.serialize_field("head", &self.head)?;
                }
                table.serialize_field("upsampling", &self.upsampling)?;
                table.serialize_field("origin_behind_tips_m", &self.origin_behind_tips_m)?;
            }
            Kind::Judge => table.serialize_field("kind", &self.kind)?,
        }
        if let Some(from) = &self.from {
            table.serialize_field("from", from)?;
        }
        table.end()
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
        /// How much more a held attempt's quality loss counts than a failed one's; 1 is the paper's.
        pub positive_weight: f64 where above(0.0, 1000.0); or 1.0,
        /// Share of the running mean of the weights that stays in a step; the mean is tested and saved. 0 for none, the
        /// paper's.
        #[serde(skip_serializing_if = "is_zero")]
        pub average_decay: f64 where 0.0..=0.99999; or 0.0,
        /// Epochs without a better test accuracy after which training ends; 0 for never.
        pub patience_epochs: u32 where 0..=10_000; or 0,
        /// Samples of one scene that stay together in the order of an epoch: 1 is a plain shuffle; more share the
        /// encoder's work and make batches less mixed.
        pub samples_per_scene: usize where 1..=4096,
        /// Scenes in memory, 256 kB each. Among so many an epoch is shuffled fully; of more it is a shuffle in a window
        /// of so many.
        pub shuffle_scenes: usize where 1..=1_000_000; or 4096,
        /// What a voxel is to answer of several attempts that have their origin in it.
        pub targets: Targets; or Targets::Attempt,
        /// Which closing directions are right where an attempt held.
        pub closings: Closing; or Closing::Attempt,
    }
}

/// What is not stored, so that runs from before it can be resumed.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

words! {
    /// What the paper's network is to answer of several attempts with their origin in one voxel.
    pub enum Targets {
        /// How each of them ended: the paper.
        Attempt = "attempt",
        /// Whether any of them held; they are one sample, the first that held or else the first.
        Voxel = "voxel",
    }
}

words! {
    /// The closing directions that are right at the voxel of an attempt that held.
    pub enum Closing {
        /// That of the attempt, in either direction: Eq. 3.
        Attempt = "attempt",
        /// Every one by which its object can be gripped from there: across either pair of a box's sides, if both fit
        /// between the fingers; any way about the axis of a cylinder.
        Object = "object",
    }
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
    #[derive(Deserialize)]
    #[serde(rename_all = "lowercase")]
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

    /// The voxel network's keys do not apply to a judge. Its checkpoints have them, with the values of keys left out.
    fn fits_the_network(&self, reader: &mut Reader<'_>) {
        let (network, training) = (&self.network, &self.training);
        let as_left_out = [
            ("network.head", network.head == Head::Quaternion),
            ("network.upsampling", network.upsampling == Upsampling::Linear),
            ("network.origin_behind_tips_m", network.origin_behind_tips_m == 0.0),
            ("training.positive_weight", training.positive_weight == 1.0),
            ("training.targets", training.targets == Targets::Attempt),
            ("training.closings", training.closings == Closing::Attempt),
            ("augmentation", self.augmentation == Augmentation::OFF),
        ];
        for (key, _) in as_left_out.into_iter().filter(|(_, holds)| network.kind == Kind::Judge && !holds) {
            reader.within(key, |reader| reader.fault("does not apply to a judge"));
        }
    }

    /// The recipe as TOML, every key written out.
    #[must_use]
    pub fn to_toml(&self) -> String {
        // Settings are numbers, words and tables of them, which always have a TOML form.
        toml::to_string(self).unwrap_or_default()
    }
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
        paper.network.origin_behind_tips_m = 0.0;
        paper.training.samples_per_scene = 1;
        paper.training.average_decay = 0.0;
        assert_eq!(config, paper);
        assert_eq!(config.augmentation, Augmentation::OFF);
        let TrainingParams { schedule, positive_weight, patience_epochs, .. } = config.training;
        assert_eq!((schedule, positive_weight, patience_epochs), (Schedule::Constant, 1.0, 0));
    }

    #[test]
    fn what_goes_beyond_the_paper_is_checked_too() {
        let text = OLD.replace(
            "[split]",
            "schedule = \"linear\"\npositive_weight = 0.0\npatience_epochs = -1\n\
                   [augmentation]\nquarter_turns = 1\nshift_z_voxels_max = 40\nflips = true\n[split]",
        );
        let Err(settings::Error::Invalid { faults: problems, .. }) = Config::parse(&text, Path::new("x")) else {
            panic!("must be refused");
        };
        let all = problems.join("\n");
        for problem in [
            "training.schedule must be one of constant, cosine, got linear",
            "training.positive_weight must be above 0 and at most 1000, got 0",
            "training.patience_epochs must be between 0 and 10000, got -1",
            "augmentation.quarter_turns must be true or false, got 1",
            "augmentation.shift_z_voxels_max must be between 0 and 39, got 40",
            "augmentation.flips is an unknown key",
        ] {
            assert!(all.contains(problem), "{problem} is not in\n{all}");
        }
        assert_eq!(problems.len(), 6, "{all}");
    }

    #[test]
    fn keys_of_the_voxel_network_do_not_apply_to_a_judge_unless_they_change_nothing() {
        let parse = |text: &str| Config::parse(text, Path::new("judge.toml"));
        let judge = parse(JUDGE).unwrap();
        assert_eq!(parse(&judge.to_toml()).unwrap(), judge);
        let text = JUDGE.replace(
            "[training]",
            "upsampling = \"nearest\"\norigin_behind_tips_m = 0.05\n[training]\n\
                     positive_weight = 2.0\ntargets = \"voxel\"\nclosings = \"object\"",
        ) + "[augmentation]\nquarter_turns = true\n";
        let Err(settings::Error::Invalid { faults, .. }) = parse(&text) else { panic!("must be refused") };
        let keys = ["network.upsampling", "network.origin_behind_tips_m", "training.positive_weight"];
        let keys = keys.into_iter().chain(["training.targets", "training.closings", "augmentation"]);
        assert_eq!(faults, keys.map(|key| format!("{key} does not apply to a judge")).collect::<Vec<_>>());
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
            "seed must be between 0 and 9223372036854775807, got -1",
            "speed is an unknown key, did you mean seed?",
            "network.upsampling must be one of linear, nearest, got cubic",
            "training.epochs must be between 1 and 10000, got 0",
            "training.batch must be a whole number, got \"many\"",
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
