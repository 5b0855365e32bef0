//! The attempt's procedure: the numbers of the label's contract that belong neither to the gripper nor to the engine.

use serde::{Deserialize, Serialize};
use settings::settings;

settings! {
    /// How an attempt is executed and judged. Written to `meta/info.json`, read by whatever repeats the attempts.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Procedure {
        /// The gripper starts this far back along the approach.
        pub pregrasp_distance_m: f32 where 0.0..=0.5,
        /// The gripper is moved out by this much after closing.
        pub retreat_distance_m: f32 where 0.01..=1.0,
        /// The gripper retreats along −z of the grasp if its approach is within this angle of straight down, else
        /// straight up; under a shelf's board along −z and a fifth as much upwards.
        pub retreat_cone_rad: f32 where 0.0..=core::f32::consts::PI,
        /// Speed of the retreat.
        pub retreat_speed_m_s: f32 where 0.01..=2.0,
        /// Closing ends at the latest after this time.
        pub close_time_s_max: f32 where 0.1..=20.0,
        /// The object is held still for this time after the retreat.
        pub hold_time_s: f32 where 0.0..=60.0,
        /// Jaws closer than this have met: `empty`.
        pub empty_width_m: f32 where 0.0..=0.05,
        /// Held objects have moved at least this share of the retreat along with the gripper.
        pub held_travel_share_min: f32 where 0.0..=1.0,
        /// Another object may be moved this far while the gripper closes.
        pub other_push_m_max: f32 where 0.0..=1.0,
        /// Another object may be raised this far while the gripper lifts.
        pub other_lift_m_max: f32 where 0.0..=1.0,
    }
}

impl Procedure {
    /// The procedure of `configs/generate/paper.toml`.
    pub const PAPER: Self = Self {
        pregrasp_distance_m: 0.05,
        retreat_distance_m: 0.10,
        retreat_cone_rad: core::f32::consts::FRAC_PI_3,
        retreat_speed_m_s: 0.2,
        close_time_s_max: 1.0,
        hold_time_s: 0.25,
        empty_width_m: 0.002,
        held_travel_share_min: 0.5,
        other_push_m_max: 0.01,
        other_lift_m_max: 0.01,
    };
}
