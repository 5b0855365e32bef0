//! What an experiment writes down: one row a round, one row an attempt.

use schema::{Outcome, Pose, ShapeKind};

/// How a round ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ending {
    /// No object was left.
    Cleared,
    /// The planner gave no grasp.
    NoGrasp,
    /// Too many attempts in a row failed.
    Failures,
    /// The round's attempts were used up.
    AttemptsMax,
    /// The objects would not come to rest again.
    Unsettled,
}

impl Ending {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Cleared, Self::NoGrasp, Self::Failures, Self::AttemptsMax, Self::Unsettled];

    /// Its name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cleared => "cleared",
            Self::NoGrasp => "no_grasp",
            Self::Failures => "failures",
            Self::AttemptsMax => "attempts_max",
            Self::Unsettled => "unsettled",
        }
    }
}

/// A round: one scene, cleared as far as it goes.
#[derive(Debug, Clone, PartialEq)]
pub struct RoundRecord {
    /// Number of the round; with the experiment's seed it names the scene.
    pub round: u64,
    /// Objects at the beginning.
    pub object_count: u32,
    /// Objects that were held and taken away.
    pub removed_count: u32,
    /// Objects that left the workspace without being held.
    pub lost_count: u32,
    /// Grasps that were executed.
    pub attempt_count: u32,
    /// How it ended.
    pub ending: Ending,
}

/// An executed grasp.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialRecord {
    /// The round.
    pub round: u64,
    /// Number within the round, from 0.
    pub trial: u32,
    /// Objects on the table before it.
    pub object_count: u32,
    /// Grasps that the plan gave.
    pub planned_count: u32,
    /// The one of them that was executed: the first that was not tried on the same scene.
    pub workspace_from_grasp: Pose,
    /// Its predicted width.
    pub width_m: f32,
    /// Its quality.
    pub quality: f32,
    /// Eq. 8's ρ, if it belongs to a cluster.
    pub rho_m: Option<f32>,
    /// Shape of the object nearest to the grasp, which was to be held.
    pub shape: ShapeKind,
    /// How it ended.
    pub outcome: Outcome,
    /// Rendering and fusing the views.
    pub observe_ms: f32,
    /// TSDF to ranked grasps.
    pub plan_ms: f32,
}
