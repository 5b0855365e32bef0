//! The planner's settings as a file. Private `Raw…` types are what TOML holds; [`Config`] is what the rest sees. All problems
//! are reported at once, each with its key.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use perception::{ClusterLaw, PlaneLaw};
use schema::{Gripper, keys_unlike};
use serde::Deserialize;

use crate::refine::RefinementLaw;

/// The settings that come with the program, and the reference for what keys there are.
pub const PAPER: &str = include_str!("../../configs/plan/paper.toml");

/// Checked settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Seed of what is drawn.
    pub seed: u64,
    /// The hand.
    pub gripper: Gripper,
    /// From the network's volumes to detections.
    pub detection: DetectionLaw,
    /// The surface cloud.
    pub cloud: CloudLaw,
    /// What counts as the table.
    pub plane: PlaneLaw,
    /// What counts as an object.
    pub clusters: ClusterLaw,
    /// In which order grasps are given.
    pub ranking: RankingLaw,
    /// Which ways of the hand are free.
    pub collision: CollisionLaw,
    /// How hands are turned and shifted.
    pub refinement: RefinementLaw,
}

/// How the surface becomes points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudLaw {
    /// Voxels along a side of the grid that depth images are fused on for it, beside the network's.
    pub resolution: usize,
    /// Distance between its points.
    pub pitch_m: f32,
    /// Whether each depth image is first scaled so that the table lies where the workspace has it.
    pub scale_to_table: bool,
}

/// VGN's constants (its `detection.py`: `process`, `select`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectionLaw {
    /// Width of the Gaussian that smooths the quality.
    pub gaussian_sigma_voxels: f32,
    /// On which side of the seen surface a grasp's origin lies.
    pub surface_side: Side,
    /// How many steps beyond what was seen of that side it may lie.
    pub surface_steps_max: usize,
    /// Smallest width.
    pub width_voxels_min: f32,
    /// Largest width.
    pub width_voxels_max: f32,
    /// ε.
    pub quality_min: f32,
    /// Side of the cube in which only the best is kept.
    pub suppression_window_voxels: usize,
    /// Place of a grasp in its voxel, along each axis.
    pub voxel_offset: f32,
    /// How far behind the finger tips, along the approach, the network has a grasp's origin: 0 in our datasets, a finger's length in VGN's.
    pub origin_behind_tips_m: f32,
}

/// A side of the seen surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// In front: where VGN's grasps have their origin, between the roots of the fingers.
    Front,
    /// Behind: where the paper's have theirs, between the tips.
    Behind,
    /// Either.
    Both,
}

impl Side {
    const ALL: [Self; 3] = [Self::Front, Self::Behind, Self::Both];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Behind => "behind",
            Self::Both => "both",
        }
    }
}

/// How grasps are ranked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankingLaw {
    /// By what.
    pub policy: Policy,
    /// λ of Eq. 8 for x, y and z.
    pub weights: [f32; 3],
    /// Farthest that a grasp may be from the object it belongs to.
    pub object_distance_m_max: f32,
    /// What becomes of grasps that belong to no object.
    pub without_object: WithoutObject,
}

/// An order of grasps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Policy {
    /// Objects top-down, in each by Eq. 8.
    Paper,
    /// By chance, as VGN's simulation picks.
    VgnRandom,
    /// By quality.
    VgnBest,
    /// By how flat the fingers would lie, times quality; needs the refinement.
    Flattest,
}

/// What becomes of grasps that belong to no object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WithoutObject {
    /// They come after all others, by quality.
    Last,
    /// They are dropped.
    Drop,
}

/// When a hand's way is not free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionLaw {
    /// Whether to look at all.
    pub check: bool,
    /// How long the straight way is.
    pub pregrasp_distance_m: f32,
    /// How much wider than the hand and its clearance the way must be: clouds are smoother than what they show.
    pub margin_m: f32,
    /// Points that may be in the way.
    pub points_max: usize,
}

/// Why settings are refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("failed to read the configuration: {source}: {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not TOML.
    #[error("not TOML: {message}: {}", .path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What the parser said.
        message: String,
    },
    /// Keys that are unknown, missing or out of range, all of them.
    #[error("{} problem{} in the configuration {}:\n  {}", .problems.len(), if .problems.len() == 1 { "" } else { "s" }, .path.display(), .problems.join("\n  "))]
    Invalid {
        /// The file.
        path: PathBuf,
        /// One message a problem, beginning with the key's path.
        problems: Vec<String>,
    },
}

impl Policy {
    /// Every policy.
    pub const ALL: [Self; 4] = [Self::Paper, Self::VgnRandom, Self::VgnBest, Self::Flattest];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::VgnRandom => "vgn-random",
            Self::VgnBest => "vgn-best",
            Self::Flattest => "flattest",
        }
    }
}

impl FromStr for Policy {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let names = || Self::ALL.map(Self::name).join(", ");
        let found = Self::ALL.into_iter().find(|policy| policy.name() == name);
        found.ok_or_else(|| format!("policy must be one of {}, got {name}", names()))
    }
}

#[derive(Deserialize)]
struct Raw {
    seed: u64,
    gripper: String,
    detection: RawDetection,
    cloud: RawCloud,
    plane: RawPlane,
    clusters: RawClusters,
    ranking: RawRanking,
    collision: RawCollision,
    refinement: RawRefinement,
}

#[derive(Deserialize)]
struct RawDetection {
    gaussian_sigma_voxels: f32,
    surface_side: String,
    surface_steps_max: usize,
    width_voxels_min: f32,
    width_voxels_max: f32,
    quality_min: f32,
    suppression_window_voxels: usize,
    voxel_offset: f32,
    origin_behind_tips_m: f32,
}

#[derive(Deserialize)]
struct RawCloud {
    resolution: usize,
    pitch_m: f32,
    scale_to_table: bool,
}

#[derive(Deserialize)]
struct RawPlane {
    threshold_m: f32,
    iterations: usize,
    refits_max: usize,
    tilt_rad_max: f32,
    share_min: f32,
}

#[derive(Deserialize)]
struct RawClusters {
    radius_m: f32,
    points_min: usize,
    cluster_points_min: usize,
}

#[derive(Deserialize)]
struct RawRanking {
    policy: String,
    weights: Vec<f32>,
    object_distance_m_max: f32,
    without_object: String,
}

#[derive(Deserialize)]
struct RawCollision {
    check: bool,
    pregrasp_distance_m: f32,
    margin_m: f32,
    points_max: usize,
}

#[derive(Deserialize)]
struct RawRefinement {
    turns: usize,
    tilts: usize,
    tilt_rad: f32,
    depths: usize,
    depth_m: f32,
    flat_m: f32,
    normal_rad_max: f32,
    outlines: bool,
    arm_m: f32,
    points_min: usize,
}

impl Config {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ConfigError`]; [`ConfigError::Invalid`] names every unknown, missing and out-of-range key.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// The settings that come with the program ([`PAPER`]).
    ///
    /// # Errors
    /// None, as a test says; the type is that of [`Config::read`].
    pub fn built_in() -> Result<Self, ConfigError> {
        Self::parse(PAPER, Path::new("configs/plan/paper.toml"))
    }

    /// Checks the text of a file; `path` is for messages and for a gripper's path.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let syntax = |e: toml::de::Error| ConfigError::Syntax { path: path.to_owned(), message: e.to_string() };
        let invalid = |problems| ConfigError::Invalid { path: path.to_owned(), problems };
        let (table, reference): (toml::Table, toml::Table) =
            (text.parse().map_err(syntax)?, PAPER.parse().map_err(syntax)?);
        let problems = keys_unlike(&table, &reference);
        if !problems.is_empty() {
            return Err(invalid(problems));
        }
        let negative = negative_counts(&table, &reference, "");
        if !negative.is_empty() {
            return Err(invalid(negative));
        }
        let raw: Raw = table.try_into().map_err(|e: toml::de::Error| invalid(vec![e.message().to_owned()]))?;
        checked(raw, path.parent()).map_err(invalid)
    }
}

/// Whole numbers below 0: there is no key for which one would do.
fn negative_counts(table: &toml::Table, reference: &toml::Table, prefix: &str) -> Vec<String> {
    let problem = |(key, value): (&String, &toml::Value)| match (value, reference.get(key)) {
        (toml::Value::Table(inner), Some(toml::Value::Table(expected))) => {
            negative_counts(inner, expected, &format!("{prefix}{key}."))
        }
        (toml::Value::Integer(got), Some(toml::Value::Integer(_))) if *got < 0 => {
            vec![format!("{prefix}{key} must be at least 0, got {got}")]
        }
        _ => Vec::new(),
    };
    table.iter().flat_map(problem).collect()
}

fn checked(raw: Raw, folder: Option<&Path>) -> Result<Config, Vec<String>> {
    let mut problems = out_of_range(&raw);
    let mut noted = |result: Result<(), String>| problems.extend(result.err());
    let (mut policy, mut without_object, mut gripper) = (Policy::Paper, WithoutObject::Last, None);
    noted(raw.ranking.policy.parse().map(|found| policy = found).map_err(|e| format!("ranking.{e}")));
    let mut side = Side::Behind;
    noted(match Side::ALL.into_iter().find(|side| side.name() == raw.detection.surface_side) {
        Some(found) => {
            side = found;
            Ok(())
        }
        None => {
            let names = Side::ALL.map(Side::name).join(", ");
            Err(format!("detection.surface_side must be one of {names}, got {}", raw.detection.surface_side))
        }
    });
    noted(match raw.ranking.without_object.as_str() {
        "last" => Ok(()),
        "drop" => {
            without_object = WithoutObject::Drop;
            Ok(())
        }
        other => Err(format!("ranking.without_object must be last or drop, got {other}")),
    });
    noted(read_gripper(&raw.gripper, folder).map(|found| gripper = Some(found)));
    let weights: Option<[f32; 3]> = raw.ranking.weights.as_slice().try_into().ok();
    let legal =
        |weights: &[f32; 3]| weights.iter().all(|w| (0.0..=1e3).contains(w)) && weights.iter().any(|w| *w > 0.0);
    noted(if weights.as_ref().is_some_and(legal) {
        Ok(())
    } else {
        let got = &raw.ranking.weights;
        Err(format!("ranking.weights must be three numbers between 0 and 1000, not all 0, got {got:?}"))
    });
    match (problems.is_empty(), gripper, weights) {
        (true, Some(gripper), Some(weights)) => {
            Ok(put_together(&raw, gripper, Words { policy, side, weights, without_object }))
        }
        _ => Err(problems),
    }
}

/// What the file says in words, understood.
struct Words {
    policy: Policy,
    side: Side,
    weights: [f32; 3],
    without_object: WithoutObject,
}

fn put_together(raw: &Raw, gripper: Gripper, words: Words) -> Config {
    let Raw { seed, detection, cloud, plane, clusters, ranking, collision, refinement, .. } = raw;
    Config {
        seed: *seed,
        gripper,
        detection: DetectionLaw {
            gaussian_sigma_voxels: detection.gaussian_sigma_voxels,
            surface_side: words.side,
            surface_steps_max: detection.surface_steps_max,
            width_voxels_min: detection.width_voxels_min,
            width_voxels_max: detection.width_voxels_max,
            quality_min: detection.quality_min,
            suppression_window_voxels: detection.suppression_window_voxels,
            voxel_offset: detection.voxel_offset,
            origin_behind_tips_m: detection.origin_behind_tips_m,
        },
        cloud: CloudLaw { resolution: cloud.resolution, pitch_m: cloud.pitch_m, scale_to_table: cloud.scale_to_table },
        plane: PlaneLaw {
            threshold_m: plane.threshold_m,
            iterations: plane.iterations,
            refits_max: plane.refits_max,
            tilt_rad_max: plane.tilt_rad_max,
            share_min: plane.share_min,
        },
        clusters: ClusterLaw {
            radius_m: clusters.radius_m,
            points_min: clusters.points_min,
            cluster_points_min: clusters.cluster_points_min,
        },
        ranking: RankingLaw {
            policy: words.policy,
            weights: words.weights,
            object_distance_m_max: ranking.object_distance_m_max,
            without_object: words.without_object,
        },
        collision: CollisionLaw {
            check: collision.check,
            pregrasp_distance_m: collision.pregrasp_distance_m,
            margin_m: collision.margin_m,
            points_max: collision.points_max,
        },
        refinement: RefinementLaw {
            turns: refinement.turns,
            tilts: refinement.tilts,
            tilt_rad: refinement.tilt_rad,
            depths: refinement.depths,
            depth_m: refinement.depth_m,
            flat_m: refinement.flat_m,
            normal_rad_max: refinement.normal_rad_max,
            outlines: refinement.outlines,
            arm_m: refinement.arm_m,
            points_min: refinement.points_min,
        },
    }
}

fn out_of_range(raw: &Raw) -> Vec<String> {
    let Raw { detection: d, cloud, plane, clusters, ranking, collision, .. } = raw;
    let reals = [
        ("detection.gaussian_sigma_voxels", d.gaussian_sigma_voxels, 0.0, 10.0),
        ("detection.width_voxels_min", d.width_voxels_min, 0.0, 100.0),
        ("detection.width_voxels_max", d.width_voxels_max, d.width_voxels_min, 100.0),
        ("detection.quality_min", d.quality_min, 1e-6, 1.0),
        ("detection.voxel_offset", d.voxel_offset, 0.0, 1.0),
        ("detection.origin_behind_tips_m", d.origin_behind_tips_m, 0.0, 0.3),
        ("cloud.pitch_m", cloud.pitch_m, 5e-4, 0.1),
        ("plane.threshold_m", plane.threshold_m, 1e-4, 0.1),
        ("plane.tilt_rad_max", plane.tilt_rad_max, 0.0, 1.57),
        ("plane.share_min", plane.share_min, 0.0, 1.0),
        ("clusters.radius_m", clusters.radius_m, 1e-4, 0.2),
        ("ranking.object_distance_m_max", ranking.object_distance_m_max, 0.0, 10.0),
        ("collision.pregrasp_distance_m", collision.pregrasp_distance_m, 0.0, 1.0),
        ("collision.margin_m", collision.margin_m, 0.0, 0.05),
        ("refinement.tilt_rad", raw.refinement.tilt_rad, 0.0, 1.2),
        ("refinement.depth_m", raw.refinement.depth_m, 1e-4, 0.1),
        ("refinement.flat_m", raw.refinement.flat_m, 1e-4, 0.05),
        ("refinement.normal_rad_max", raw.refinement.normal_rad_max, 0.0, 1.5),
        ("refinement.arm_m", raw.refinement.arm_m, 1e-3, 10.0),
    ];
    let wholes = [
        ("cloud.resolution", cloud.resolution, 8, 200),
        ("detection.surface_steps_max", d.surface_steps_max, 0, 100),
        ("detection.suppression_window_voxels", d.suppression_window_voxels, 1, 40),
        ("plane.iterations", plane.iterations, 1, 100_000),
        ("plane.refits_max", plane.refits_max, 0, 1_000),
        ("clusters.points_min", clusters.points_min, 1, 1_000_000),
        ("clusters.cluster_points_min", clusters.cluster_points_min, 1, 10_000_000),
        ("collision.points_max", collision.points_max, 0, 1_000_000),
        ("refinement.turns", raw.refinement.turns, 0, 180),
        ("refinement.tilts", raw.refinement.tilts, 0, 24),
        ("refinement.depths", raw.refinement.depths, 1, 50),
        ("refinement.points_min", raw.refinement.points_min, 1, 10_000),
    ];
    let told = |key: &str, low: &dyn std::fmt::Display, high: &dyn std::fmt::Display, got: &dyn std::fmt::Display| {
        format!("{key} must be between {low} and {high}, got {got}")
    };
    let real = reals.iter().filter(|(_, value, low, high)| !(low..=high).contains(&value));
    let whole = wholes.iter().filter(|(_, value, low, high)| !(low..=high).contains(&value));
    real.map(|(key, value, low, high)| told(key, low, high, value))
        .chain(whole.map(|(key, value, low, high)| told(key, low, high, value)))
        .collect()
}

fn read_gripper(name: &str, folder: Option<&Path>) -> Result<Gripper, String> {
    Gripper::named(name, |file| {
        let path = folder.unwrap_or(Path::new("")).join(file);
        std::fs::read_to_string(&path).map_err(|e| format!("failed to read the gripper: {e}: {}", path.display()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(text: &str) -> Vec<String> {
        match Config::parse(text, Path::new("test.toml")) {
            Err(ConfigError::Invalid { problems, .. }) => problems,
            other => panic!("expected problems, got {other:?}"),
        }
    }

    #[test]
    fn the_built_in_settings_are_the_papers() {
        let config = Config::built_in().unwrap();
        assert_eq!(config.plane, PlaneLaw::PAPER);
        assert_eq!(config.clusters, ClusterLaw::PAPER);
        assert_eq!(config.ranking.weights, [0.45, 0.45, 0.1]);
        assert_eq!(config.ranking.policy, Policy::Paper);
        assert_eq!(config.detection.quality_min, 0.9);
        assert_eq!(config.gripper.opening_m_max, 0.08);
    }

    #[test]
    fn the_refined_settings_are_sound() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/plan/refined.toml");
        let refined = Config::read(&path).unwrap();
        assert!(refined.refinement.turns > 0 && refined.collision.check);
        assert_eq!(refined.ranking.policy, Policy::Flattest);
        assert_eq!(Config::built_in().unwrap().refinement.turns, 0);
    }

    #[test]
    fn all_that_is_wrong_is_told_at_once() {
        let bad = PAPER
            .replace("quality_min = 0.9", "quality_min = 1.5")
            .replace("policy = \"paper\"", "policy = \"best\"")
            .replace("weights = [0.45, 0.45, 0.1]", "weights = [0.5, nan]")
            .replace("without_object = \"last\"", "without_object = \"first\"")
            .replace("gripper = \"parallel_jaw_80\"", "gripper = \"three_fingers\"");
        let problems = problems(&bad);
        assert_eq!(problems.len(), 5, "{problems:?}");
        assert_eq!(problems[0], "detection.quality_min must be between 0.000001 and 1, got 1.5");
        assert_eq!(problems[1], "ranking.policy must be one of paper, vgn-random, vgn-best, flattest, got best");
        assert!(problems[3].starts_with("gripper must be a path"), "{problems:?}");
    }

    #[test]
    fn unknown_missing_and_misfit_keys_are_told() {
        let unknown = problems(&PAPER.replace("[cloud]", "[cloud]\nsize = 3"));
        assert_eq!(unknown, ["cloud.size is no key of this file"]);
        let missing = problems(&PAPER.replace("pitch_m = 0.0025", ""));
        assert!(missing[0].starts_with("cloud.pitch_m is missing"), "{missing:?}");
        let negative = problems(&PAPER.replace("points_max = 5", "points_max = -5"));
        assert_eq!(negative, ["collision.points_max must be at least 0, got -5"]);
        let side = problems(&PAPER.replace("surface_side = \"behind\"", "surface_side = \"left\""));
        assert_eq!(side, ["detection.surface_side must be one of front, behind, both, got left"]);
        assert_eq!(problems(&PAPER.replace("width_voxels_max = 9.33", "width_voxels_max = 1.0")).len(), 1);
    }
}
