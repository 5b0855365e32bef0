//! `meta/info.json`: the identity of a dataset, written before its first row. The dataset's id is the SHA-256 of its
//! bytes and is part of every marker, so shards of another config, seed or code version cannot be mixed in.

use std::ops::Range;
use std::slice;
use std::sync::Arc;

use schema::{FACETS, Grid, Gripper, Grippers, MODELS_MAX, Model, Procedure, gripper_of};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use settings::{Setting, faults_of, read_stored};

use crate::format::column::Form;
use crate::format::seal;

/// Everything that determines a dataset's bytes, with the file's keys in the file's order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatasetInfo {
    /// What the file is: [`Self::ABOUT`].
    pub about: String,
    /// Version of the format on disk: the lowest that describes the dataset, so that older programs can read it.
    pub format_version: u32,
    /// Version of the code that makes the rows; another version makes another dataset.
    pub code_version: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// Shards.
    pub shard_count: u32,
    /// Scenes: attempts divided by attempts per scene, rounded up.
    pub scene_count: u64,
    /// Attempts in all.
    pub attempt_count: u64,
    /// Attempts per scene; the last scene takes the remainder.
    pub attempts_per_scene: u32,
    /// The grid of the TSDFs.
    pub grid: Grid,
    /// The gripper; the first of several.
    pub gripper: Gripper,
    /// The attempt's procedure.
    pub procedure: Procedure,
    /// The units of all files: [`Self::UNITS`].
    pub units: String,
    /// The frames of all files: [`Self::FRAMES`].
    pub frames: Vec<String>,
    /// How round outlines are: [`Self::facets`].
    pub facets: String,
    /// The resolved config of the generator, in its own format. `Value` keeps keys sorted.
    pub config: Value,
    /// Its objects, if they are not primitives; `shape` in its rows is then a model's name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub models: Vec<Arc<Model>>,
    /// Its grippers if they are several, which take turns: scene i has number i modulo their count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grippers: Vec<Gripper>,
}

/// Maximum number of shards: their indices have five digits.
pub const SHARDS_MAX: u32 = 100_000;
/// Maximum resolution of a TSDF along a side.
pub const RESOLUTION_MAX: usize = 128;
/// The newest version of the format that this program reads.
const VERSION_MAX: u32 = 6;
/// Maximum number of attempts of a dataset.
pub const ATTEMPTS_MAX: u64 = 1_000_000_000_000;

impl DatasetInfo {
    // These texts are part of the file and so of every dataset's id: changing a word makes other datasets.
    /// What the file is.
    pub const ABOUT: &str = "A Graspmill dataset: simulated parallel-jaw grasp attempts on random stacked scenes. This file was written \
         before the first row; its SHA-256 is the dataset's id.";
    /// The units.
    pub const UNITS: &str =
        "SI: metres, kilograms, seconds, radians, newtons. A name carries its unit (width_m, tilt_rad).";
    /// The frames.
    pub const FRAMES: [&str; 6] = [
        "A transform is named target_from_source; quaternions are xyzw.",
        "workspace: a cube of side grid.size_m, origin at a lower corner, z up, table top at z = grid.table_z_m.",
        "grid: voxel (i, j, k) has its centre at (i + 1/2, j + 1/2, k + 1/2) * grid.size_m / grid.resolution; tsdf[x][y][z].",
        "camera: x right, y down, z forward; on a sphere about the middle of the workspace's floor, looking at it.",
        "object: origin at the centre of its bounding box. cuboid; cylinder: axis z; tri_prism: extruded along x, apex at +z; half_cylinder: extruded along x, flat face at -z.",
        "grasp: origin midway between the finger tips, +z approach, +y closing, x = y cross z; a half turn about z is the same grasp.",
    ];

    /// How round outlines are.
    #[must_use]
    pub fn facets() -> String {
        format!(
            "Round outlines have {FACETS} flat sides a full turn, in physics, in depth images and in collision tests."
        )
    }

    /// The scenes of a shard, distributed evenly: `s·N/S .. (s+1)·N/S`.
    ///
    /// # Panics
    /// If `shard` is not below [`Self::shard_count`].
    #[must_use]
    pub fn scenes_of(&self, shard: u32) -> Range<u64> {
        assert!(shard < self.shard_count, "shard {shard} of {}", self.shard_count);
        let edge = |s: u32| {
            let exact = u128::from(s) * u128::from(self.scene_count) / u128::from(self.shard_count);
            exact as u64 // at most scene_count
        };
        edge(shard)..edge(shard + 1)
    }

    /// The shard that holds a scene, or `None` if there is no such scene.
    #[must_use]
    pub fn shard_of(&self, scene_id: u64) -> Option<u32> {
        if scene_id >= self.scene_count {
            return None;
        }
        let guess = u128::from(scene_id) * u128::from(self.shard_count) / u128::from(self.scene_count);
        let guess = guess as u32; // below shard_count
        (guess..self.shard_count).find(|shard| self.scenes_of(*shard).contains(&scene_id))
    }

    /// Attempts of a scene: [`Self::attempts_per_scene`], the last scene takes the remainder.
    #[must_use]
    pub fn attempts_of_scene(&self, scene_id: u64) -> u32 {
        let left = self.attempt_count - self.attempts_before(scene_id);
        left.min(u64::from(self.attempts_per_scene)) as u32 // at most a u32
    }

    /// Attempts of all scenes before one.
    pub(crate) fn attempts_before(&self, scene_id: u64) -> u64 {
        scene_id.saturating_mul(u64::from(self.attempts_per_scene)).min(self.attempt_count)
    }

    /// Its grippers.
    #[must_use]
    pub fn grippers(&self) -> &[Gripper] {
        if self.grippers.is_empty() { slice::from_ref(&self.gripper) } else { &self.grippers }
    }

    /// The gripper of a scene.
    #[must_use]
    pub fn gripper_of(&self, scene_id: u64) -> &Gripper {
        gripper_of(self.grippers(), scene_id)
    }

    /// How far the widest of its grippers opens.
    #[must_use]
    pub fn opening_m_max(&self) -> f32 {
        self.grippers().iter().map(|gripper| gripper.opening_m_max).fold(0.0, f32::max)
    }

    /// What its tables' columns depend on.
    #[must_use]
    pub fn form(&self) -> Form {
        Form {
            resolution: self.grid.resolution,
            has_grippers: !self.grippers.is_empty(),
            has_containers: self.config.get("container").is_some(),
            has_repeats: self.config.get("robustness").is_some(),
        }
    }

    /// The lowest version that describes it. A version has what those before it have not, which they would fail to read
    /// or misinterpret.
    #[must_use]
    pub fn version(&self) -> u32 {
        let Form { has_grippers, has_containers, has_repeats, .. } = self.form();
        let (has_models, has_meshes) = (!self.models.is_empty(), self.models.iter().any(|model| model.mesh.is_some()));
        let needed = [(has_meshes, 6), (has_repeats, 5), (has_containers, 4), (has_grippers, 3), (has_models, 2)];
        needed.into_iter().find(|(is_needed, _)| *is_needed).map_or(1, |(_, version)| version)
    }

    /// Whether attempts of some scenes were repeated.
    #[must_use]
    pub fn repeats_some(&self) -> bool {
        let share = self.config.get("robustness").and_then(|robustness| robustness.get("share"));
        share.and_then(Value::as_f64).is_some_and(|share| share > 0.0)
    }

    /// The values out of range, one message each.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        let mut problems = faults_of(&self.gripper, "gripper");
        for (number, gripper) in self.grippers.iter().enumerate() {
            problems.extend(faults_of(gripper, &format!("grippers.{number}")));
        }
        problems.extend(self.grippers_problem().map(|problem| format!("grippers {problem}")));
        problems.extend(faults_of(&self.procedure, "procedure"));
        let Grid { resolution, size_m, table_z_m } = self.grid;
        let (attempts, shards, models) = (self.attempt_count, self.shard_count, &self.models);
        let scenes = attempts.div_ceil(u64::from(self.attempts_per_scene.max(1)));
        let version = self.version();
        let up_to = |name: &str, got: u64, most: u64| {
            ((1..=most).contains(&got), format!("{name} must be between 1 and {most}, got {got}"))
        };
        let rules = [
            up_to("grid.resolution", resolution as u64, RESOLUTION_MAX as u64),
            (size_m > 0.0 && size_m <= 10.0, format!("grid.size_m must be above 0 and at most 10, got {size_m}")),
            (
                (0.0..=size_m).contains(&table_z_m),
                format!("grid.table_z_m must be between 0 and {size_m}, got {table_z_m}"),
            ),
            up_to("shard_count", shards.into(), SHARDS_MAX.into()),
            (
                u64::from(shards) <= self.scene_count,
                format!("shard_count must be at most the scene count {}, got {shards}", self.scene_count),
            ),
            up_to("attempt_count", attempts, ATTEMPTS_MAX),
            up_to("attempts_per_scene", self.attempts_per_scene.into(), 100_000),
            (
                scenes == self.scene_count,
                format!(
                    "scene_count must be attempt_count / attempts_per_scene rounded up, {scenes}, got {}",
                    self.scene_count
                ),
            ),
            (models.len() <= MODELS_MAX, format!("models must be at most {MODELS_MAX}, got {}", models.len())),
            (
                self.format_version == version,
                format!(
                    "format_version must be {version}, the lowest that describes the dataset, got {}",
                    self.format_version
                ),
            ),
        ];
        problems.extend(rules.into_iter().filter_map(|(holds, problem)| (!holds).then_some(problem)));
        for (place, model) in models.iter().enumerate() {
            if models[..place].iter().any(|other| other.name == model.name) {
                problems.push(format!("there is another model {}", model.name));
            }
        }
        problems.extend(models.iter().flat_map(|model| model.problems()));
        problems
    }

    /// What is wrong with its grippers as a whole.
    fn grippers_problem(&self) -> Option<String> {
        let first = self.grippers.first()?;
        if self.grippers.len() == 1 {
            return Some("must be left out for a single gripper".to_owned());
        }
        let differs = (*first != self.gripper).then(|| "must begin with gripper".to_owned());
        differs.or_else(|| Grippers::problem(&self.grippers))
    }

    /// A section of the stored config, such as `camera`; `None` if it is not there whole and within its ranges. Whether
    /// the rest of the config can be is known to the generator.
    #[must_use]
    pub fn section<T: Setting<Limits = ()>>(&self, name: &str) -> Option<T> {
        read_stored(self.config.get(name)?, name).ok()
    }

    /// The text of `meta/info.json`: the same bytes for the same info on every machine.
    #[must_use]
    pub fn to_json(&self) -> String {
        seal::pretty(self)
    }

    /// The info in a `meta/info.json`.
    ///
    /// # Errors
    /// What is wrong, if the text is not such a file, has an unknown version, or contains invalid values.
    pub fn from_json(text: impl AsRef<[u8]>) -> Result<Self, String> {
        let foreign = |e| format!("not a dataset's info: {e}");
        let HeadJson { format_version: got } = serde_json::from_slice(text.as_ref()).map_err(foreign)?;
        if !(1..=VERSION_MAX).contains(&got) {
            let hint = if got > 0 { "read it with a newer graspmill" } else { "no graspmill wrote that" };
            return Err(format!("format_version must be between 1 and {VERSION_MAX}, got {got}; {hint}"));
        }
        let info: Self = serde_json::from_slice(text.as_ref()).map_err(foreign)?;
        let problems = info.problems();
        if problems.is_empty() { Ok(info) } else { Err(problems.join("; ")) }
    }

    /// The id of a dataset that is begun with this info: SHA-256 of [`Self::to_json`], in hex. For an existing dataset
    /// use [`crate::Dataset::id`], because numbers of a parsed info may differ in their last digit.
    #[must_use]
    pub fn dataset_id(&self) -> String {
        seal::sha256_hex(self.to_json().as_bytes())
    }
}

/// Only the version, so that a newer file is refused for its version and not for its new keys.
#[derive(Deserialize)]
struct HeadJson {
    format_version: u32,
}

#[cfg(test)]
mod tests {
    use schema::CameraParams;

    use super::*;
    use crate::synthetic;

    #[test]
    fn json_leads_back_and_is_the_same_twice() {
        let info = synthetic::info(7, 3, 100, 12);
        let text = info.to_json();
        assert_eq!(DatasetInfo::from_json(&text).unwrap(), info);
        assert_eq!(DatasetInfo::from_json(&text).unwrap().to_json(), text);
        assert!(text.contains("\"size_m\": 0.3,"), "{text}");
    }

    #[test]
    fn stored_settings_are_held_to_a_configs_ranges() {
        let mut info = synthetic::info(7, 3, 100, 12);
        info.procedure.retreat_distance_m = 1e6;
        info.gripper.friction = -1.0;
        let told = DatasetInfo::from_json(info.to_json()).unwrap_err().to_string();
        assert_eq!(
            told.split("; ").collect::<Vec<_>>(),
            [
                "gripper.friction must be between 0 and 5, got -1",
                "procedure.retreat_distance_m must be between 0.01 and 1, got 1000000",
            ]
        );
    }

    #[test]
    fn a_share_of_none_of_the_scenes_repeats_nothing() {
        let repeats = |config: Value| {
            let info = DatasetInfo { config, ..synthetic::info(7, 3, 100, 12) };
            [info.form().has_repeats, info.repeats_some()]
        };
        let share = |share: f64| repeats(serde_json::json!({ "robustness": { "share": share } }));
        assert_eq!([repeats(serde_json::json!({})), share(0.0), share(0.1)], [[false; 2], [true, false], [true; 2]]);
    }

    #[test]
    fn settings_of_another_version_are_readable_and_not_taken_for_whole() {
        let mut info = synthetic::info(7, 3, 100, 12);
        info.config = serde_json::json!({ "camera": { "width_px": 640, "lens": "wide" }, "kind": null });
        let read = DatasetInfo::from_json(info.to_json()).unwrap();
        assert_eq!(read.section::<CameraParams>("camera"), None);
        let camera = |width_px: u32| serde_json::json!({ "width_px": width_px, "height_px": 480, "focal_px": 540.0 });
        info.config = serde_json::json!({ "camera": camera(640), "settle": camera(1_000_000) });
        let expected = CameraParams { width_px: 640, height_px: 480, focal_px: 540.0 };
        assert_eq!(info.section("camera"), Some(expected));
        assert_eq!(info.section::<CameraParams>("settle"), None, "a million pixels are out of range");
    }

    #[test]
    fn scenes_and_attempts_are_shared_out_exactly() {
        for (shards, attempts, per_scene) in [(1, 1, 60), (3, 100, 12), (64, 200_000, 60), (7, 61, 6)] {
            let info = synthetic::info(0, shards, attempts, per_scene);
            let mut next = 0;
            for shard in 0..shards {
                let scenes = info.scenes_of(shard);
                assert_eq!(scenes.start, next);
                assert!(!scenes.is_empty(), "shard {shard} of {shards} is empty");
                for scene in scenes.clone() {
                    assert_eq!(info.shard_of(scene), Some(shard));
                }
                next = scenes.end;
            }
            assert_eq!(next, info.scene_count);
            assert_eq!(info.shard_of(next), None);
            let sum: u64 = (0..info.scene_count).map(|s| u64::from(info.attempts_of_scene(s))).sum();
            assert_eq!(sum, attempts);
        }
    }

    #[test]
    fn every_problem_is_named() {
        let mut info = synthetic::info(0, 3, 100, 12);
        info.shard_count = 40;
        info.grid.resolution = 400;
        info.gripper.friction = -1.0;
        let message = DatasetInfo::from_json(info.to_json()).unwrap_err().to_string();
        for part in ["shard_count must be at most the scene count 9, got 40", "grid.resolution must be", "friction"] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_newer_file_is_refused_by_its_version_not_its_keys() {
        let told = |version: u32| {
            DatasetInfo::from_json(format!("{{\"format_version\": {version}, \"brand_new\": true}}")).unwrap_err()
        };
        assert_eq!(told(7), "format_version must be between 1 and 6, got 7; read it with a newer graspmill");
        assert_eq!(told(0), "format_version must be between 1 and 6, got 0; no graspmill wrote that");
    }
}
