//! Observing an attempt while it is executed.
//!
//! A watcher receives every step and every decision. It cannot change anything, so a watched attempt ends like an
//! unwatched one. Without a watcher a step costs one additional null check.

use schema::Pose;

use crate::attempt::Execution;
use crate::bodies::AttemptEngine;

/// An observer of an attempt.
pub trait Watcher {
    /// Called after every simulated step.
    fn step(&mut self, moment: &Moment<'_>);

    /// Called for every event, in order. Events before the first step have no moment.
    fn event(&mut self, event: AttemptEvent, moment: Option<&Moment<'_>>);
}

/// The phase of the attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The fingers close.
    Close,
    /// The gripper moves away with the target.
    Retreat,
    /// The gripper rests and holds.
    Hold,
    /// A floating object is pulled or shaken.
    Bear,
    /// The attempt is over; further steps are only shown to the watcher.
    After,
}

/// A decision or event of an attempt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AttemptEvent {
    /// Nothing is near the fingers for some steps, perhaps until they meet, so the shortcut skips these.
    ClosedFreely {
        /// Skipped steps.
        steps: usize,
    },
    /// Both fingers have stopped.
    FingersStopped {
        /// Opening in metres.
        width_m: f32,
    },
    /// The time limit of closing is reached.
    ClosingTimeOver {
        /// Opening in metres.
        width_m: f32,
    },
    /// The jaws have met.
    JawsMet {
        /// Opening in metres.
        width_m: f32,
    },
    /// Closing or lifting moved another object by more than the limit.
    Pushed {
        /// Which.
        object_id: usize,
        /// How far, in metres.
        moved_m: f32,
    },
    /// The closing fingers came too near the table.
    NearTable,
    /// The closing or retreating gripper came too near a fixture.
    NearContainer,
    /// The target moves with the gripper, everything else rests, and the way is free, so the shortcut ends the lift
    /// here.
    RidesAlong {
        /// Remaining distance, in metres.
        rest_m: f32,
    },
    /// At the end of the hold the target has not moved far enough with the gripper.
    LeftBehind {
        /// Distance that it moved, in metres.
        travel_m: f32,
        /// Required minimum, in metres.
        travel_m_min: f32,
    },
    /// At the end of the hold the target has moved far enough, but not both fingers press on it.
    NotGripped,
    /// At the end of the hold the target has moved far enough, and both fingers press on it.
    Gripped {
        /// Distance that it moved, in metres.
        travel_m: f32,
    },
    /// The attempt is over. Further steps are only shown.
    Decided(Execution),
}

/// The state of an attempt after a step.
pub struct Moment<'r> {
    /// The phase of the attempt.
    pub phase: Phase,
    /// Steps since the open gripper was at the grasp, including skipped steps.
    pub steps: usize,
    pub(crate) engine: &'r dyn AttemptEngine,
    pub(crate) object_count: usize,
    pub(crate) workspace_from_grasp: Pose,
}

impl Moment<'_> {
    /// Poses of the objects in the workspace.
    #[must_use]
    pub fn objects(&self) -> Vec<Pose> {
        (0..self.object_count).map(|id| self.workspace_from_grasp * self.engine.pose(id)).collect()
    }

    /// Workspace poses of the left jaw, the right jaw and the palm ([`schema::Gripper::parts`]): each maps the open
    /// gripper's frame to where that part is now.
    #[must_use]
    pub fn gripper(&self) -> [Pose; 3] {
        self.engine.gripper_poses().map(|pose| self.workspace_from_grasp * pose)
    }
}
