//! What a dataset says of the config that made it: its identity, and the settings that its rows were drawn by.

use program::{Exit, ExitCode};
use schema::Physics;
use serde_json::{Value, json};
use shards::{DatasetInfo, FormatVersion, ReadError};
use simulator::ModelError;

use crate::config::{Config, OF_PRIMITIVES};

/// The engine, as datasets name it.
const ENGINE: &str = "rapier3d 0.36.1";

impl Config {
    /// What goes to `meta/info.json`: the dataset's identity.
    #[must_use]
    pub fn dataset_info(&self) -> DatasetInfo {
        DatasetInfo {
            format_version: if self.objects.catalogue.is_empty() {
                FormatVersion::CURRENT
            } else {
                FormatVersion::MODELS
            },
            code_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            shard_count: self.shards,
            scene_count: self.attempts.div_ceil(u64::from(self.attempts_per_scene)),
            attempt_count: self.attempts,
            attempts_per_scene: self.attempts_per_scene,
            grid: self.grid,
            gripper: self.gripper.clone(),
            procedure: self.procedure,
            config: self.stored(),
            models: self.objects.catalogue.stored().to_vec(),
        }
    }

    /// What [`DatasetInfo`] has no field for.
    fn stored(&self) -> Value {
        let mut stored = json!({
            "sampler": self.sampler,
            "objects": self.objects,
            "settle": self.settle,
            "views": self.views,
            "camera": self.camera,
            "tsdf": self.tsdf,
            "physics": self.physics,
        });
        stored["physics"]["engine"] = json!(ENGINE);
        if let Some(objects) = stored["objects"].as_object_mut() {
            let models = objects.remove("catalogue");
            if !self.objects.catalogue.is_empty() {
                objects.retain(|key, _| !OF_PRIMITIVES.contains(&key.as_str()));
                objects.extend(models.map(|names| ("models".to_owned(), names)));
            }
        }
        stored
    }
}

/// The engine's settings from a dataset's config, as [`Config::dataset_info`] writes them.
pub(crate) fn physics_of(config: &Value) -> Result<Physics, DatasetError> {
    let mut physics = config["physics"].clone();
    let engine = physics.as_object_mut().and_then(|physics| physics.remove("engine")).unwrap_or_default();
    if engine != ENGINE {
        return Err(DatasetError::Physics(format!("the engine must be {ENGINE:?}, got {engine}")));
    }
    settings::read_stored(&physics, "physics").map_err(|faults| DatasetError::Physics(faults.join("; ")))
}

/// Why a dataset's scenes cannot be made again from their rows.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The dataset cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The dataset does not say how the engine was run.
    #[error("meta/info.json has no engine settings that this program knows: {0}")]
    Physics(String),
    /// The dataset does not say what its camera was.
    #[error("meta/info.json has no camera")]
    Camera,
    /// A model of the dataset is no body.
    #[error("meta/info.json: {0}")]
    Model(#[from] ModelError),
    /// The target of an attempt is not in its scene.
    #[error("attempt {attempt_id} of scene {scene_id} has a target that is not among the scene's objects")]
    NoTarget {
        /// The scene.
        scene_id: u64,
        /// The attempt.
        attempt_id: u32,
    },
}

impl Exit for DatasetError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Read(error) => error.exit_code(),
            Self::Physics(_) | Self::Camera | Self::Model(_) | Self::NoTarget { .. } => ExitCode::Data,
        }
    }
}
