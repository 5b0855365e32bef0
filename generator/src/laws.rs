//! What a dataset says of the config that made it: its identity, and the laws that its rows were drawn from.

use serde_json::{Value, json};
use shards::{DatasetInfo, FormatVersion};
use simulator::Physics;

use crate::config::Config;
use crate::raw::RawPhysics;

/// The engine, as datasets name it.
const ENGINE: &str = "rapier3d 0.36.1";

impl Config {
    /// What goes to `meta/info.json`: the dataset's identity.
    #[must_use]
    pub fn dataset_info(&self) -> DatasetInfo {
        DatasetInfo {
            format_version: if self.models.is_empty() { FormatVersion::CURRENT } else { FormatVersion::MODELS },
            code_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            shard_count: self.shard_count,
            scene_count: self.attempt_count.div_ceil(u64::from(self.attempts_per_scene)),
            attempt_count: self.attempt_count,
            attempts_per_scene: self.attempts_per_scene,
            grid: self.grid,
            gripper: self.gripper.clone(),
            procedure: self.procedure,
            config: self.laws(),
            models: self.models.stored().to_vec(),
        }
    }

    fn object_law(&self) -> Value {
        let objects = &self.objects;
        let counts: Vec<usize> = objects.counts.iter().map(|(count, _)| *count).collect();
        let count_weights: Vec<f32> = objects.counts.iter().map(|(_, weight)| *weight).collect();
        if !self.models.is_empty() {
            let names: Vec<&str> = self.models.stored().iter().map(|model| model.name.as_str()).collect();
            return json!({
                "models": names,
                "counts": counts,
                "count_weights": count_weights,
                "drop_height_m": objects.drop_height_m,
            });
        }
        json!({
            "shapes": objects.shapes.iter().map(|s| s.name()).collect::<Vec<_>>(),
            "counts": counts,
            "count_weights": count_weights,
            "size_m": objects.size_m,
            "density_kg_m3": objects.density_kg_m3,
            "friction": objects.friction,
            "drop_height_m": objects.drop_height_m,
        })
    }

    /// The laws that rows are drawn from and the engine's settings: what [`DatasetInfo`] has no field for.
    fn laws(&self) -> Value {
        let views = &self.views;
        json!({
            "sampler": self.sampler.name(),
            "objects": self.object_law(),
            "settle": {
                "solver_iterations": self.settle.solver_iterations,
                "damping_1_s": self.settle.damping_1_s,
                "linear_speed_m_s_max": self.settle.linear_speed_m_s_max,
                "angular_speed_rad_s_max": self.settle.angular_speed_rad_s_max,
                "rest_time_s": self.settle.rest_time_s,
                "time_s_max": self.settle.time_s_max,
                "tries_max": self.tries_max,
            },
            "views": {
                "counts": [views.count_min, views.count_max],
                "radius_sizes": [views.radius_sizes_min, views.radius_sizes_max],
                "polar_rad": [views.polar_rad_min, views.polar_rad_max],
            },
            "camera": {
                "width_px": self.intrinsics.width_px,
                "height_px": self.intrinsics.height_px,
                "focal_px": self.intrinsics.fx_px,
            },
            "tsdf": { "truncation_voxels": self.truncation_voxels },
            "physics": {
                "engine": ENGINE,
                "step_rate_hz": self.physics.step_rate_hz,
                "solver_iterations": self.physics.solver_iterations,
                "contact_frequency_hz": self.physics.contact_frequency_hz,
                "gravity_m_s2": self.physics.gravity_m_s2,
                "table_friction": self.physics.table_friction,
                "shortcuts": self.physics.shortcuts,
            },
        })
    }
}

/// What settings of the engine may be.
pub(crate) const STEP_RATE_HZ: [f32; 2] = [30.0, 10_000.0];
pub(crate) const SOLVER_ITERATIONS: [u64; 2] = [1, 1_000];
pub(crate) const CONTACT_FREQUENCY_HZ: [f32; 2] = [1.0, 100_000.0];
pub(crate) const GRAVITY_M_S2: [f32; 2] = [0.1, 100.0];
pub(crate) const TABLE_FRICTION: [f32; 2] = [0.0, 5.0];

/// The engine's settings from a dataset's laws, as [`Config::dataset_info`] writes them.
pub(crate) fn physics_of(laws: &Value) -> Result<Physics, String> {
    let physics = &laws["physics"];
    if physics["engine"] != ENGINE {
        return Err(format!("the engine must be {ENGINE:?}, got {}", physics["engine"]));
    }
    let raw = serde_json::from_value::<RawPhysics>(physics.clone()).map_err(|e| e.to_string())?;
    // A stranger's file: with other numbers an attempt would never end.
    let ranges = [
        ("step_rate_hz", raw.step_rate_hz, STEP_RATE_HZ),
        ("contact_frequency_hz", raw.contact_frequency_hz, CONTACT_FREQUENCY_HZ),
        ("gravity_m_s2", raw.gravity_m_s2, GRAVITY_M_S2),
        ("table_friction", raw.table_friction, TABLE_FRICTION),
        ("solver_iterations", raw.solver_iterations as f32, SOLVER_ITERATIONS.map(|n| n as f32)),
    ];
    match ranges.into_iter().find(|(_, value, [low, high])| !(low..=high).contains(&value)) {
        Some((key, value, [low, high])) => Err(format!("physics.{key} must be between {low} and {high}, got {value}")),
        None => Ok(Physics::from(raw)),
    }
}
