//! The planner's settings, each key as the type that the planner computes with.

use std::path::Path;

use network::Kind;
use perception::{ClusterParams, PlaneParams};
use schema::Gripper;
use serde::{Deserialize, Serialize};
use settings::{Document, Reader, settings, words};

/// The settings that come with the program, in the order of [`BuiltIn::ALL`].
const TEXTS: [&str; BuiltIn::ALL.len()] = [
    include_str!("../../configs/plan/judge.toml"),
    include_str!("../../configs/plan/paper.toml"),
    include_str!("../../configs/plan/vgn.toml"),
];

words! {
    /// A way to plan that comes with the program, with its weights.
    pub enum BuiltIn {
        /// A judge answers for grasp candidates: the default.
        Judge = "judge",
        /// The paper's network and its ranking.
        Paper = "paper",
        /// VGN's published network and its selection.
        Vgn = "vgn",
    }
}

impl BuiltIn {
    /// The settings' text.
    #[must_use]
    pub const fn text(self) -> &'static str {
        TEXTS[self as usize]
    }

    /// The settings.
    ///
    /// # Errors
    /// Never, as a test shows; the type is that of [`Config::load`].
    pub fn config(self) -> Result<Config, settings::Error> {
        Config::load(Some(Path::new(self.name())))
    }

    /// Its network's kind.
    #[must_use]
    pub const fn network_kind(self) -> Kind {
        match self {
            Self::Judge => Kind::Judge,
            Self::Paper | Self::Vgn => Kind::Voxel,
        }
    }
}

settings! {
    /// All settings.
    #[derive(Debug, Clone, PartialEq, Serialize)]
    pub struct Config {
        /// Seed of what is drawn.
        pub seed: u64,
        /// The gripper.
        pub gripper: Gripper; by Gripper::read_named as
            "a gripper's name, a path that ends in .toml, or what such a file has",
        /// The network: which kind it must be, and which weights are used if no others are given.
        pub network: BuiltIn; or BuiltIn::Paper,
        /// From the network's volumes to detections.
        pub detection: DetectionParams,
        /// The surface cloud.
        pub cloud: CloudParams,
        /// What counts as the table.
        pub plane: PlaneParams,
        /// What counts as an object.
        pub clusters: ClusterParams,
        /// In which order grasps are given.
        pub ranking: RankingParams,
        /// Collision check of the approach.
        pub collision: CollisionParams,
        /// Which grasp candidates a judge is asked about.
        pub judge: JudgeParams; or JudgeParams::STANDARD,
    }
}

/// How far robots reach on their tables, in metres.
const REACH_M: [f32; 3] = [1.2, 1.2, 0.5];

settings! {
    /// How a judge is asked; for networks that answer for grasp candidates.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct JudgeParams {
        /// Number of grasp candidates that are proposed.
        pub proposals: usize where 1..=100_000,
        /// Of these the judge is asked about so many, which a quick look finds likeliest to hold; about all where it is
        /// left out.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub asked: Option<usize> where 1..=100_000; or None,
        /// Of grasps whose tips are nearer to each other than this, only the best is kept.
        pub apart_m: f32 where 0.0..=0.3,
        /// Grasp candidates touch what was seen in a box of these sides on the table, in metres: x, y and the height.
        /// Its middle is that of the network's workspace.
        pub reach_m: [f32; 3] where 0.1..=3.0; or REACH_M,
    }
}

impl JudgeParams {
    /// What a config without `[judge]` has.
    pub const STANDARD: Self = Self { proposals: 256, asked: None, apart_m: 0.01, reach_m: REACH_M };
}

settings! {
    /// How the surface becomes points.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct CloudParams {
        /// Voxels along 0.3 m of the grid that depth images are fused on for it, beside the network's; the
        /// grasp candidates of a judge are fitted to it, too.
        pub resolution: usize where 8..=200,
        /// Distance between its points.
        pub pitch_m: f32 where 5e-4..=0.1,
        /// Whether each depth image is first scaled so that the table lies where the workspace has it.
        pub scale_to_table: bool,
    }
}

settings! {
    /// VGN's constants (its `detection.py`: `process`, `select`).
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct DetectionParams {
        /// Width of the Gaussian that smooths the quality.
        pub gaussian_sigma_voxels: f32 where 0.0..=10.0,
        /// How many steps beyond what was seen of its side of the surface a grasp's origin may lie.
        pub surface_steps_max: usize where 0..=100,
        /// Smallest width.
        pub width_voxels_min: f32 where 0.0..=100.0,
        /// Largest width.
        pub width_voxels_max: f32 where 0.0..=100.0,
        /// ε.
        pub quality_min: f32 where 1e-6..=1.0,
        /// Side of the cube in which only the best is kept.
        pub suppression_window_voxels: usize where 1..=40,
        /// What decides the closing direction.
        pub closing: ClosingBy,
    }
    check DetectionParams::widths_agree
}

impl DetectionParams {
    fn widths_agree(&self, reader: &mut Reader<'_>) {
        let (least, got) = (self.width_voxels_min, self.width_voxels_max);
        reader.must("width_voxels_max", least <= got, || format!("must be between {least} and 100, got {got}"));
    }
}

words! {
    /// What decides the closing direction of a detection's grasp.
    pub enum ClosingBy {
        /// The network.
        Predicted = "predicted",
    }
}

settings! {
    /// How grasps are ranked.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct RankingParams {
        /// By what.
        pub policy: Policy,
        /// λ of Eq. 8 for x, y and z; not all 0.
        pub weights: [f32; 3] where 0.0..=1000.0,
        /// Farthest that a grasp may be from the object it belongs to.
        pub object_distance_m_max: f32 where 0.0..=10.0,
        /// What becomes of grasps that belong to no object.
        pub without_object: WithoutObject; or WithoutObject::Last,
    }
    check RankingParams::weighs_something
}

impl RankingParams {
    fn weighs_something(&self, reader: &mut Reader<'_>) {
        reader.must("weights", self.weights.iter().any(|weight| *weight > 0.0), || "must not all be 0");
    }
}

words! {
    /// An order of grasps.
    #[derive(Deserialize)]
    #[serde(rename_all = "kebab-case")]
    pub enum Policy {
        /// Objects top-down, in each by Eq. 8.
        Paper = "paper",
        /// By chance, as VGN's simulation picks.
        VgnRandom = "vgn-random",
        /// By quality.
        VgnBest = "vgn-best",
    }
}

words! {
    /// What becomes of grasps that belong to no object.
    pub enum WithoutObject {
        /// They come after all others, by quality.
        Last = "last",
    }
}

settings! {
    /// When a gripper's way is not free.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct CollisionParams {
        /// Whether to look at all.
        pub check: bool,
        /// How long the straight way is.
        pub pregrasp_distance_m: f32 where 0.0..=1.0,
        /// How much wider than the gripper and its clearance the way must be: clouds are smoother than what they
        /// show.
        pub margin_m: f32 where 0.0..=0.05,
        /// Points that may be in the way.
        pub points_max: usize where 0..=1_000_000,
        /// Whether the gripper keeps off the walls of a bin, a tray or a shelf, if such walls are found: it closes on
        /// none and touches none on its way in and out.
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        pub walls: bool; or false,
    }
}

impl Config {
    /// Reads a file, or settings that come with the program: those with this name ([`BuiltIn`]), or the default.
    ///
    /// # Errors
    /// [`settings::Error`] with every unknown, missing and out-of-range key.
    pub fn load(path: Option<&Path>) -> Result<Self, settings::Error> {
        Self::document(path)?.read()
    }

    /// What [`Config::load`] reads, for overrides.
    ///
    /// # Errors
    /// [`settings::Error`] if the file cannot be read or is not TOML.
    pub fn document(path: Option<&Path>) -> Result<Document, settings::Error> {
        let named = path.map_or(Some(BuiltIn::Judge), |path| BuiltIn::from_name(path.to_str()?));
        match named {
            Some(named) => {
                Document::parse(named.text(), &Path::new("configs/plan").join(format!("{}.toml", named.name())))
            }
            None => Document::load(path, ["", ""]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(text: &str) -> Vec<String> {
        match Document::parse(text, Path::new("test.toml")).unwrap().read::<Config>() {
            Err(settings::Error::Invalid { faults, .. }) => faults,
            other => panic!("expected problems, got {other:?}"),
        }
    }

    #[test]
    fn the_built_in_settings_are_the_papers() {
        let config = BuiltIn::Paper.config().unwrap();
        assert_eq!(config.plane, PlaneParams::PAPER);
        assert_eq!(config.clusters, ClusterParams::PAPER);
        assert_eq!(config.ranking.weights, [0.45, 0.45, 0.1]);
        assert_eq!(config.ranking.policy, Policy::Paper);
        assert_eq!(config.detection.quality_min, 0.9);
        assert_eq!(config.gripper.opening_m_max, 0.08);
    }

    #[test]
    fn without_a_file_the_settings_are_the_judges() {
        assert_eq!(Config::load(None).unwrap(), BuiltIn::Judge.config().unwrap());
    }

    #[test]
    fn all_that_is_wrong_is_reported_at_once() {
        let bad = BuiltIn::Paper
            .text()
            .replace("quality_min = 0.9", "quality_min = 1.5")
            .replace("policy = \"paper\"", "policy = \"best\"")
            .replace("weights = [0.45, 0.45, 0.1]", "weights = [0.5, nan]")
            .replace("object_distance_m_max = 0.03", "object_distance_m_max = 0.03\nwithout_object = \"drop\"")
            .replace("gripper = \"parallel_jaw_80\"", "gripper = \"three_fingers\"");
        let problems = problems(&bad);
        assert_eq!(problems.len(), 5, "{problems:?}");
        assert!(problems[0].starts_with("gripper must be a path"), "{problems:?}");
        assert_eq!(
            problems[1..],
            [
                "detection.quality_min must be between 0.000001 and 1, got 1.5",
                "ranking.policy must be one of paper, vgn-random, vgn-best, got best",
                "ranking.weights must be three values, each a number between 0 and 1000, got [0.5, nan]",
                "ranking.without_object must be one of last, got drop",
            ]
        );
    }

    #[test]
    fn unknown_missing_and_misfit_keys_are_reported() {
        let unknown = problems(&BuiltIn::Paper.text().replace("[cloud]", "[cloud]\nsize = 3"));
        assert_eq!(unknown, ["cloud.size is an unknown key"]);
        let missing = problems(&BuiltIn::Paper.text().replace("pitch_m = 0.0025", ""));
        assert!(missing[0].starts_with("cloud.pitch_m is missing"), "{missing:?}");
        let negative = problems(&BuiltIn::Paper.text().replace("points_max = 5", "points_max = -5"));
        assert_eq!(negative, ["collision.points_max must be a whole number between 0 and 1000000, got -5"]);
        let closing = problems(&BuiltIn::Paper.text().replace("closing = \"predicted\"", "closing = \"left\""));
        assert_eq!(closing, ["detection.closing must be one of predicted, got left"]);
        assert_eq!(
            problems(&BuiltIn::Paper.text().replace("width_voxels_max = 9.33", "width_voxels_max = 1.0")).len(),
            1
        );
        let weightless = problems(&BuiltIn::Paper.text().replace("weights = [0.45, 0.45, 0.1]", "weights = [0, 0, 0]"));
        assert_eq!(weightless, ["ranking.weights must not all be 0"]);
    }
}
