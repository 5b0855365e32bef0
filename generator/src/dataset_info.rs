//! What a dataset says of the config that made it: its identity, and the settings that its rows were drawn by.

use program::{ExitCode, Failure};
use schema::{Engine, Physics};
use serde_json::{Value, json};
use shards::DatasetInfo;
use simulator::Body;

use crate::config::{Config, OF_PRIMITIVES, RuleClosing, Sampler};
use crate::robustness::RobustnessParams;

/// The engine, as datasets name it: with its version, because other versions give other labels.
const fn stored_name(engine: Engine) -> &'static str {
    match engine {
        Engine::Rapier => "rapier3d 0.36.1",
        Engine::Stepper => "stepper 1",
    }
}

impl Config {
    /// What goes to `meta/info.json`: the dataset's identity.
    #[must_use]
    pub fn dataset_info(&self) -> DatasetInfo {
        let mut info = DatasetInfo {
            about: DatasetInfo::ABOUT.to_owned(),
            format_version: 1, // see below
            code_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            shard_count: self.shards,
            scene_count: self.attempts.div_ceil(u64::from(self.attempts_per_scene)),
            attempt_count: self.attempts,
            attempts_per_scene: self.attempts_per_scene,
            grid: self.grid,
            gripper: self.gripper.of_scene(0).clone(),
            procedure: self.procedure,
            units: DatasetInfo::UNITS.to_owned(),
            frames: DatasetInfo::FRAMES.map(str::to_owned).to_vec(),
            facets: DatasetInfo::facets(),
            config: self.stored(),
            models: self.objects.catalogue.stored().to_vec(),
            grippers: if self.gripper.only().is_some() { Vec::new() } else { self.gripper.all().to_vec() },
        };
        info.format_version = info.version();
        info
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
        stored["physics"]["engine"] = json!(stored_name(self.physics.engine));
        // Keys that others do not have, so that those keep their identity.
        let own = [
            ("shares", (self.sampler == Sampler::Mixed).then(|| json!(self.shares))),
            ("policy", self.policy.as_ref().map(|policy| json!(policy))),
            ("packed", self.packed.map(|packed| json!(packed))),
            ("rule_closing", (self.rule_closing != RuleClosing::Drawn).then(|| json!(self.rule_closing))),
            ("spanned_share", (self.spanned_share > 0.0).then(|| json!(self.spanned_share))),
            ("view_kinds", (!self.view_kinds.is_empty()).then(|| json!(self.view_kinds))),
            ("container", (!self.container.is_empty()).then(|| json!(self.container))),
            ("robustness", self.robustness.as_ref().map(|robustness| json!(robustness))),
            ("sensor", self.sensor.as_ref().map(|sensor| json!(sensor))),
        ];
        for (key, value) in own.into_iter().filter_map(|(key, value)| Some((key, value?))) {
            stored[key] = value;
        }
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
///
/// # Errors
/// [`ExitCode::Data`] if they are not of an engine that this program has.
pub fn physics_of(config: &Value) -> Result<Physics, Failure> {
    let unknown = |why: String| info_lacks(&format!(" has no engine settings that this program knows: {why}"));
    let mut physics = config["physics"].clone();
    let known = Engine::ALL.into_iter().find(|engine| physics["engine"] == stored_name(*engine));
    let Some(engine) = known else {
        let names = Engine::ALL.map(|engine| format!("{:?}", stored_name(engine))).join(" or ");
        return Err(unknown(format!("the engine must be {names}, got {}", physics["engine"])));
    };
    physics["engine"] = json!(engine);
    settings::read_stored(&physics, "config.physics").map_err(|faults| unknown(faults.join("; ")))
}

/// How the attempts of a dataset were repeated, if they were.
///
/// # Errors
/// [`ExitCode::Data`] if its config does not say it.
pub(crate) fn robustness_of(info: &DatasetInfo) -> Result<Option<RobustnessParams>, Failure> {
    let Some(stored) = info.config.get("robustness") else { return Ok(None) };
    let read = settings::read_stored(stored, "config.robustness");
    read.map(Some).map_err(|faults| info_lacks(&format!(": {}", faults.join("; "))))
}

/// The bodies of a dataset's models, in their order.
///
/// # Errors
/// [`ExitCode::Data`] if a model is not one.
pub fn bodies_of(info: &DatasetInfo) -> Result<Vec<Body>, Failure> {
    simulator::bodies_of(&info.models).map_err(|error| info_lacks(&format!(": {error}")))
}

/// What is wrong with `meta/info.json`.
pub(crate) fn info_lacks(what: &str) -> Failure {
    Failure::new(ExitCode::Data, format!("meta/info.json{what}"))
}
