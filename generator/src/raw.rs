//! The config file as it is written. Nothing after [`crate::Config`] sees these types.

use serde::Deserialize;
use simulator::Physics;

#[derive(Debug, Deserialize)]
pub(crate) struct RawConfig {
    pub seed: u64,
    pub shards: u64,
    pub attempts: u64,
    pub attempts_per_scene: u64,
    pub sampler: String,
    pub gripper: String,
    pub grid: RawGrid,
    pub objects: RawObjects,
    pub settle: RawSettle,
    pub views: RawViews,
    pub camera: RawCamera,
    pub tsdf: RawTsdf,
    pub physics: RawPhysics,
    pub procedure: schema::Procedure,
}

#[derive(Debug, Deserialize)]
pub(crate) struct RawGrid {
    pub resolution: u64,
    pub size_m: f32,
    pub table_z_m: f32,
}

#[derive(Debug, Deserialize)]
pub(crate) struct RawObjects {
    pub shapes: Vec<String>,
    pub counts: Vec<u64>,
    pub count_weights: Vec<f32>,
    pub size_m: Vec<f32>,
    pub density_kg_m3: Vec<f32>,
    pub friction: Vec<f32>,
    pub drop_height_m: f32,
    #[serde(default)]
    pub catalogue: Option<String>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct RawSettle {
    pub solver_iterations: u64,
    pub damping_1_s: f32,
    pub linear_speed_m_s_max: f32,
    pub angular_speed_rad_s_max: f32,
    pub rest_time_s: f32,
    pub time_s_max: f32,
    pub tries_max: u64,
}

#[derive(Debug, Deserialize)]
pub(crate) struct RawViews {
    pub counts: Vec<u64>,
    pub radius_sizes: Vec<f32>,
    pub polar_rad: Vec<f32>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct RawCamera {
    pub width_px: u64,
    pub height_px: u64,
    pub focal_px: f32,
}

#[derive(Debug, Deserialize)]
pub(crate) struct RawTsdf {
    pub truncation_voxels: f32,
}

#[derive(Debug, Deserialize)]
pub(crate) struct RawPhysics {
    pub step_rate_hz: f32,
    pub solver_iterations: u64,
    pub contact_frequency_hz: f32,
    pub gravity_m_s2: f32,
    pub table_friction: f32,
    pub shortcuts: bool,
}

impl From<RawPhysics> for Physics {
    fn from(raw: RawPhysics) -> Self {
        Self {
            step_rate_hz: raw.step_rate_hz,
            solver_iterations: raw.solver_iterations as usize,
            contact_frequency_hz: raw.contact_frequency_hz,
            gravity_m_s2: raw.gravity_m_s2,
            table_friction: raw.table_friction,
            shortcuts: raw.shortcuts,
        }
    }
}
