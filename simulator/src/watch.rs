//! Observing an attempt while it is executed.
//!
//! A watcher receives every step and every decision. It cannot change anything, so a watched attempt ends like an
//! unwatched one. Without a watcher a step costs one additional null check.

use rapier3d::prelude::{ColliderHandle, RigidBodyHandle};
use schema::{Pose, Vec3};

use crate::attempt::{AttemptWorld, Execution};
use crate::engine::World;
use crate::hand::Hand;

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
    /// The hand moves away with the target.
    Retreat,
    /// The hand rests and holds.
    Hold,
    /// The attempt is over; further steps are only shown to the watcher.
    After,
}

/// A decision or event of an attempt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AttemptEvent {
    /// Nothing is between the jaws, so the shortcut skips the closing.
    NothingBetween {
        /// Steps until they meet.
        steps: usize,
    },
    /// Nothing is near the fingers for some steps, so the shortcut skips these.
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
    /// The jaws have met while closing.
    JawsMet {
        /// Opening in metres.
        width_m: f32,
    },
    /// Closing moved another object by more than the limit.
    Pushed {
        /// Which.
        object_id: usize,
        /// How far, in metres.
        moved_m: f32,
    },
    /// The closing fingers came too near the table.
    NearTable,
    /// The target moves with the hand, everything else rests, and the way is free, so the shortcut ends the lift here.
    RidesAlong {
        /// Remaining distance, in metres.
        rest_m: f32,
    },
    /// The jaws have met while lifting or holding.
    JawsMetLifting {
        /// Opening in metres.
        width_m: f32,
    },
    /// At the end of the hold the target has not moved far enough with the hand.
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
    /// The lift raised another object by more than the limit.
    Raised {
        /// Which.
        object_id: usize,
        /// How far, in metres.
        raised_m: f32,
    },
    /// The attempt is over. Further steps are only shown.
    Decided(Execution),
}

/// A body that can touch another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Toucher {
    /// The finger at −y of the grasp.
    LeftFinger,
    /// The finger at +y of the grasp.
    RightFinger,
    /// The palm.
    Palm,
    /// An object, by its index.
    Object(usize),
    /// The table.
    Table,
}

/// Two bodies that press on each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Which.
    pub between: [Toucher; 2],
    /// The contact points that carry load, in the workspace, in metres.
    pub points_m: Vec<Vec3>,
    /// Force in the last step, in newtons.
    pub force_n: f32,
}

/// The state of an attempt after a step.
pub struct Moment<'r> {
    /// The phase of the attempt.
    pub phase: Phase,
    /// Steps since the open hand was at the grasp, including skipped steps.
    pub steps: usize,
    pub(crate) setup: &'r AttemptWorld<'r>,
    pub(crate) world: &'r World,
    pub(crate) hand: &'r Hand,
    pub(crate) bodies: &'r [RigidBodyHandle],
    pub(crate) workspace_from_grasp: Pose,
}

impl Moment<'_> {
    /// Poses of the objects in the workspace.
    #[must_use]
    pub fn objects(&self) -> Vec<Pose> {
        self.bodies.iter().map(|body| self.workspace_from_grasp * self.world.pose(*body)).collect()
    }

    /// Workspace poses of the boxes of [`schema::Gripper::open_hand`]: each maps the open hand's frame to where that
    /// box is now.
    #[must_use]
    pub fn hand(&self) -> [Pose; 3] {
        let boxes = self.hand.boxes(self.world, self.setup.gripper);
        boxes.map(|(_, moved_m)| self.workspace_from_grasp * Pose::from_translation(moved_m))
    }

    /// Opening in metres.
    #[must_use]
    pub fn width_m(&self) -> f32 {
        self.hand.width_m(self.world)
    }

    /// All contacts on the hand or on an object.
    #[must_use]
    pub fn contacts(&self) -> Vec<Contact> {
        let known = |contact: crate::engine::Pressing| Contact {
            between: contact.colliders.map(|collider| self.toucher(collider)),
            points_m: contact.points_m.iter().map(|p| self.workspace_from_grasp.transform_point(*p)).collect(),
            force_n: contact.force_n,
        };
        self.world.pressing().into_iter().map(known).collect()
    }

    fn toucher(&self, collider: ColliderHandle) -> Toucher {
        let [left, right, palm] = self.hand.colliders();
        if let Some(id) = self.bodies.iter().position(|body| self.world.bodies[*body].colliders().contains(&collider)) {
            return Toucher::Object(id);
        }
        match collider {
            _ if collider == left => Toucher::LeftFinger,
            _ if collider == right => Toucher::RightFinger,
            _ if collider == palm => Toucher::Palm,
            _ => Toucher::Table,
        }
    }
}
