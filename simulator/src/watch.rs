//! Looking on while an attempt is executed.
//!
//! A watcher is shown every step and told what the attempt goes by; it cannot change anything, so what is watched ends
//! as what is not. Without one, a step costs a look at an empty pointer more.

use rapier3d::prelude::{ColliderHandle, RigidBodyHandle};
use schema::{Pose, Vec3};

use crate::attempt::{AttemptWorld, Execution};
use crate::engine::World;
use crate::hand::Hand;

/// Who looks on.
pub trait Watcher {
    /// After every simulated step.
    fn step(&mut self, moment: &Moment<'_>);

    /// When something happens; always in the order in which it does. What happens before the first step has no moment.
    fn event(&mut self, event: AttemptEvent, moment: Option<&Moment<'_>>);
}

/// What the hand is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// It closes.
    Close,
    /// It moves out with its catch.
    Retreat,
    /// It stands still and holds.
    Hold,
    /// It goes on for those who look on: the attempt is over.
    After,
}

/// Something that an attempt goes by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AttemptEvent {
    /// Nothing lies between the jaws: by the shortcut, their closing is not simulated.
    NothingBetween {
        /// Steps until they meet.
        steps: usize,
    },
    /// Nothing is near the fingers for so many steps: by the shortcut, these are not simulated.
    ClosedFreely {
        /// Steps that are left out.
        steps: usize,
    },
    /// Both fingers stand still.
    FingersStopped {
        /// Opening in metres.
        width_m: f32,
    },
    /// The fingers have closed for as long as they may.
    ClosingTimeOver {
        /// Opening in metres.
        width_m: f32,
    },
    /// The jaws have met while closing.
    JawsMet {
        /// Opening in metres.
        width_m: f32,
    },
    /// While the hand closed, another object was moved by more than it may be.
    Pushed {
        /// Which.
        object_id: usize,
        /// How far, in metres.
        moved_m: f32,
    },
    /// The closing fingers came too near the table.
    NearTable,
    /// The target rides along, all else rests and the rest of the way is free: by the shortcut, the lift ends here.
    RidesAlong {
        /// What is left of the way, in metres.
        rest_m: f32,
    },
    /// The jaws have met while lifting or holding.
    JawsMetLifting {
        /// Opening in metres.
        width_m: f32,
    },
    /// At the end of the hold the target has not come along far enough.
    LeftBehind {
        /// How far it came along, in metres.
        travel_m: f32,
        /// How far it should have come at least, in metres.
        travel_m_min: f32,
    },
    /// At the end of the hold the target has come along, but not both fingers press on it.
    NotGripped,
    /// At the end of the hold the target has come along and both fingers press on it.
    Gripped {
        /// How far it came along, in metres.
        travel_m: f32,
    },
    /// While the hand lifted, another object was raised by more than it may be.
    Raised {
        /// Which.
        object_id: usize,
        /// How far, in metres.
        raised_m: f32,
    },
    /// The attempt is over. Steps that follow are only shown.
    Decided(Execution),
}

/// Something that touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Toucher {
    /// The finger at −y of the grasp.
    LeftFinger,
    /// The finger at +y of the grasp.
    RightFinger,
    /// The palm.
    Palm,
    /// An object, by its number.
    Object(usize),
    /// The table.
    Table,
}

/// Two things that press on each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Which.
    pub between: [Toucher; 2],
    /// Where, in the workspace, in metres: the points that carry.
    pub points_m: Vec<Vec3>,
    /// How hard in the last step, in newtons.
    pub force_n: f32,
}

/// An attempt at a moment.
pub struct Moment<'r> {
    pub(crate) phase: Phase,
    pub(crate) steps: usize,
    pub(crate) setup: &'r AttemptWorld<'r>,
    pub(crate) world: &'r World,
    pub(crate) hand: &'r Hand,
    pub(crate) bodies: &'r [RigidBodyHandle],
    pub(crate) workspace_from_grasp: Pose,
}

impl std::fmt::Debug for Moment<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Moment").field("phase", &self.phase).field("steps", &self.steps).finish_non_exhaustive()
    }
}

impl Moment<'_> {
    /// What the hand is doing.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Steps since the open hand was at the grasp, those that were left out included.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Where the objects are in the workspace.
    #[must_use]
    pub fn objects(&self) -> Vec<Pose> {
        self.bodies.iter().map(|body| self.workspace_from_grasp * self.world.pose(*body)).collect()
    }

    /// Where the boxes of [`schema::Gripper::open_hand`] are: the poses, in the workspace, of the frame in which they
    /// are given.
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

    /// What presses on the hand or on an object.
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
