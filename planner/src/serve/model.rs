//! The description of the running planner: `GET /v1/model`.

use serde::Serialize;
use serde_json::{Value, json};
use utoipa::ToSchema;

use crate::Planner;
use crate::answer::GridAnswer;
use crate::config::{Config, WithoutObject};

/// The planner behind the service.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(crate) struct ModelAnswer {
    /// The program's version.
    version: &'static str,
    /// SHA-256 of the network's weights file.
    model: String,
    /// The default order of grasps: `paper`, `vgn-random` or `vgn-best`.
    policy: &'static str,
    /// The gripper's name.
    gripper: String,
    /// The workspace.
    grid: GridAnswer,
    /// The settings, with the keys of `configs/plan/*.toml`.
    #[schema(value_type = Object)]
    config: Value,
}

impl ModelAnswer {
    pub(super) fn new(planner: &Planner) -> Self {
        let (grid, config) = (planner.grid(), planner.config());
        Self {
            version: env!("CARGO_PKG_VERSION"),
            model: planner.model_id().to_owned(),
            policy: config.ranking.policy.name(),
            gripper: planner.gripper().name.clone(),
            grid: GridAnswer::new(grid),
            config: settings(config),
        }
    }
}

fn settings(config: &Config) -> Value {
    let Config { seed, gripper, detection: d, cloud, plane, clusters, ranking, collision, refinement } = config;
    let without_object = match ranking.without_object {
        WithoutObject::Last => "last",
        WithoutObject::Drop => "drop",
    };
    json!({
        "seed": seed,
        "gripper": gripper.name,
        "detection": {
            "gaussian_sigma_voxels": decimal(d.gaussian_sigma_voxels),
            "surface_side": d.surface_side.name(),
            "surface_steps_max": d.surface_steps_max,
            "width_voxels_min": decimal(d.width_voxels_min),
            "width_voxels_max": decimal(d.width_voxels_max),
            "quality_min": decimal(d.quality_min),
            "suppression_window_voxels": d.suppression_window_voxels,
            "voxel_offset": decimal(d.voxel_offset),
            "origin_behind_tips_m": decimal(d.origin_behind_tips_m),
        },
        "cloud": { "resolution": cloud.resolution, "pitch_m": decimal(cloud.pitch_m), "scale_to_table": cloud.scale_to_table },
        "plane": {
            "threshold_m": decimal(plane.threshold_m),
            "iterations": plane.iterations,
            "refits_max": plane.refits_max,
            "tilt_rad_max": decimal(plane.tilt_rad_max),
            "share_min": decimal(plane.share_min),
        },
        "clusters": {
            "radius_m": decimal(clusters.radius_m),
            "points_min": clusters.points_min,
            "cluster_points_min": clusters.cluster_points_min,
        },
        "ranking": {
            "policy": ranking.policy.name(),
            "weights": ranking.weights.map(decimal),
            "object_distance_m_max": decimal(ranking.object_distance_m_max),
            "without_object": without_object,
        },
        "refinement": {
            "turns": refinement.turns,
            "tilts": refinement.tilts,
            "tilt_rad": decimal(refinement.tilt_rad),
            "depths": refinement.depths,
            "depth_m": decimal(refinement.depth_m),
            "flat_m": decimal(refinement.flat_m),
            "normal_rad_max": decimal(refinement.normal_rad_max),
            "outlines": refinement.outlines,
            "arm_m": decimal(refinement.arm_m),
            "points_min": refinement.points_min,
        },
        "collision": {
            "check": collision.check,
            "pregrasp_distance_m": decimal(collision.pregrasp_distance_m),
            "margin_m": decimal(collision.margin_m),
            "points_max": collision.points_max,
        },
    })
}

/// The shortest decimal of a number: 0.45, not 0.44999998807907104.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::PAPER;

    #[test]
    fn settings_are_told_as_they_stand_in_the_file() {
        let file: toml::Table = PAPER.parse().unwrap();
        assert_eq!(settings(&Config::built_in().unwrap()), serde_json::to_value(file).unwrap());
    }
}
