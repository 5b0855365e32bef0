//! The settings of a dataset besides gripper, grid and procedure: engine, settling, views, camera and TSDF. They are
//! the sections of a config and are stored in `meta/info.json`.

use core::f32::consts::{FRAC_PI_2, FRAC_PI_4};

use serde::Serialize;
use settings::{Reader, settings, words};

use crate::Intrinsics;

words! {
    /// What simulates piles and attempts.
    pub enum Engine {
        /// Our own, made for them.
        Stepper = "stepper",
        /// The reference.
        Rapier = "rapier",
    }
}

settings! {
    /// How the engine is run. Stored with every dataset.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct Physics {
        /// What simulates piles and attempts.
        pub engine: Engine; or Engine::Rapier,
        /// Steps a second.
        pub step_rate_hz: f32 where 30.0..=10_000.0,
        /// Solver iterations a step.
        pub solver_iterations: usize where 1..=1_000,
        /// Natural frequency of the contact springs, in Hz, for dynamic and static contacts alike.
        pub contact_frequency_hz: f32 where 1.0..=100_000.0,
        /// How deep a finger may sink into an object at the finger force, in metres: objects too light for that get
        /// more inertia, but no weight. 0, as in datasets that do not say: as deep as it does.
        pub finger_depth_m_max: f32 where 0.0..=0.01; or 0.0,
        /// Gravity, downwards, in m/s².
        pub gravity_m_s2: f32 where 0.1..=100.0,
        /// Friction coefficient of table and walls.
        pub table_friction: f32 where 0.0..=5.0,
        /// Whether an attempt leaves out what decides nothing: `simulator::AttemptWorld::execute`.
        pub shortcuts: bool,
    }
}

impl Physics {
    /// The settings of the shipped configs: labels as those of [`Self::FAITHFUL`], as far as other engines can tell, at
    /// a fraction of the time.
    pub const STANDARD: Self = Self { solver_iterations: 4, shortcuts: true, ..Self::FAITHFUL };

    /// The settings whose labels another engine confirms; every attempt is simulated from its beginning to its end.
    pub const FAITHFUL: Self = Self {
        engine: Engine::Stepper,
        step_rate_hz: 240.0,
        solver_iterations: 8,
        contact_frequency_hz: 480.0,
        finger_depth_m_max: 0.000_1,
        gravity_m_s2: 9.81,
        table_friction: 1.0,
        shortcuts: false,
    };

    /// Length of a step, in seconds.
    #[must_use]
    pub fn dt_s(&self) -> f32 {
        1.0 / self.step_rate_hz
    }

    /// Steps that last at least `time_s`.
    #[must_use]
    pub fn steps(&self, time_s: f32) -> usize {
        (time_s * self.step_rate_hz).ceil() as usize
    }
}

settings! {
    /// When a pile counts as resting.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct SettleParams {
        /// Solver iterations per step, instead of `physics.solver_iterations`: with 4, one pile of rapier's in ten
        /// never rests.
        pub solver_iterations: usize where 1..=1_000,
        /// Damping rate of linear and angular velocity (1/s). It models rolling resistance, without which a cylinder on
        /// its side never stops. It applies only while settling; attempts are undamped.
        pub damping_1_s: f32 where 0.0..=20.0,
        /// Maximum speed of a resting object.
        pub linear_speed_m_s_max: f32 where 1e-4..=1.0,
        /// Maximum angular speed of a resting object.
        pub angular_speed_rad_s_max: f32 where 1e-3..=10.0,
        /// How long both must hold.
        pub rest_time_s: f32 where 0.01..=10.0,
        /// The scene is rejected if an object does not rest by then.
        pub time_s_max: f32 where 0.01..=60.0,
        /// Maximum number of scenes that are drawn until one rests.
        pub tries_max: u32 where 1..=10_000,
    }
    check SettleParams::time_suffices
}

impl SettleParams {
    /// The settings of the shipped configs.
    pub const STANDARD: Self = Self {
        solver_iterations: 4,
        damping_1_s: 2.0,
        linear_speed_m_s_max: 0.005,
        angular_speed_rad_s_max: 0.05,
        rest_time_s: 0.1,
        time_s_max: 4.0,
        tries_max: 100,
    };

    fn time_suffices(&self, reader: &mut Reader<'_>) {
        let (got, least) = (self.time_s_max, self.rest_time_s);
        reader.must("time_s_max", got >= least, || format!("must be between {least} and 60, got {got}"));
    }
}

settings! {
    /// The distribution of a scene's views: number, distance and obliqueness. The azimuth is always U(0, 2π).
    ///
    /// The camera must stay outside the workspace and above its floor: from radius 1 on, no corner of the cube is
    /// behind it.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct ViewParams {
        /// Fewest and most views of a scene; the count is uniform.
        pub counts: [usize; 2] where 1..=100,
        /// Shortest and longest distance from the middle of the floor, in sides of the workspace; the distance is
        /// uniform.
        pub radius_sizes: [f32; 2] where 1.0..=100.0,
        /// Smallest and largest angle from the vertical; the angle is uniform.
        pub polar_rad: [f32; 2] where 0.0..=FRAC_PI_2,
    }
}

impl ViewParams {
    /// VGN's (`generate_data.py`): 1 to 6 views, radius U(1.6, 2.4) sides, polar angle U(0, π/4).
    pub const VGN: Self = Self { counts: [1, 6], radius_sizes: [1.6, 2.4], polar_rad: [0.0, FRAC_PI_4] };
}

settings! {
    /// The lens of the depth cameras; the principal point is the image's middle.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct CameraParams {
        /// Pixels in a row.
        pub width_px: usize where 16..=4096,
        /// Rows.
        pub height_px: usize where 16..=4096,
        /// Focal length.
        pub focal_px: f32 where 10.0..=10_000.0,
    }
}

impl CameraParams {
    /// The lens.
    #[must_use]
    pub fn intrinsics(&self) -> Intrinsics {
        let Self { width_px, height_px, focal_px } = *self;
        let (cx_px, cy_px) = (0.5 * width_px as f32, 0.5 * height_px as f32);
        Intrinsics { width_px, height_px, fx_px: focal_px, fy_px: focal_px, cx_px, cy_px }
    }
}

settings! {
    /// How views become a TSDF.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct TsdfParams {
        /// Distances are cut off at this many voxels.
        pub truncation_voxels: f32 where 1.0..=20.0,
    }
}

#[cfg(test)]
mod tests {
    use settings::faults_of;

    use super::*;

    #[test]
    fn views_that_cannot_be_name_every_fault() {
        assert_eq!(faults_of(&ViewParams::VGN, "views"), [""; 0]);
        let params = ViewParams { counts: [0, 3], radius_sizes: [2.0, 1.5], polar_rad: [-0.125, f32::NAN] };
        assert_eq!(
            faults_of(&params, "views"),
            [
                "views.counts must be a range [low, high] within [1, 100], got [0, 3]",
                "views.radius_sizes must be a range [low, high] within [1, 100], got [2.0, 1.5]",
                "views.polar_rad must be a range [low, high] within [0, 1.5707964], got [-0.125, nan]",
            ]
        );
    }

    #[test]
    fn shipped_settings_are_in_range_and_a_pile_has_time_to_rest() {
        assert_eq!([faults_of(&Physics::STANDARD, "a"), faults_of(&Physics::FAITHFUL, "b")].concat(), [""; 0]);
        assert_eq!(faults_of(&SettleParams::STANDARD, "settle"), [""; 0]);
        let hasty = SettleParams { time_s_max: 0.05, ..SettleParams::STANDARD };
        assert_eq!(faults_of(&hasty, "settle"), ["settle.time_s_max must be between 0.1 and 60, got 0.05"]);
    }
}
