//! The attempt's procedure: the numbers of the label's contract that belong neither to the hand nor to the engine.

use serde::{Deserialize, Serialize};

/// How an attempt is executed and judged. Written to `meta/info.json`, read by whatever repeats the attempts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Procedure {
    /// The hand starts this far back along the approach.
    pub pregrasp_distance_m: f32,
    /// The hand is moved out by this much after closing.
    pub retreat_distance_m: f32,
    /// The hand retreats along −z of the grasp if its approach is within this angle of straight down, else straight up.
    pub retreat_cone_rad: f32,
    /// Speed of the retreat.
    pub retreat_speed_m_s: f32,
    /// Closing ends at the latest after this time.
    pub close_time_s_max: f32,
    /// The object is held still for this time after the retreat.
    pub hold_time_s: f32,
    /// Jaws closer than this have met: `empty`.
    pub empty_width_m: f32,
    /// Held objects have moved at least this share of the retreat along with the hand.
    pub held_travel_share_min: f32,
    /// Another object may be moved this far while the hand closes.
    pub other_push_m_max: f32,
    /// Another object may be raised this far while the hand lifts.
    pub other_lift_m_max: f32,
}
