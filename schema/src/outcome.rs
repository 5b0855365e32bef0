//! How an attempt ended. A failed grasp is data, never an error.

use serde::{Deserialize, Serialize};
use settings::words;

words! {
    /// The outcome of an executed grasp attempt; the first that applies, in this order.
    #[derive(PartialOrd, Ord, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Outcome {
        /// The open gripper at the pre-grasp pose comes within the clearance of something.
        PregraspCollision = "pregrasp_collision",
        /// The open gripper, moving straight from pre-grasp to grasp, comes within the clearance of something.
        ApproachCollision = "approach_collision",
        /// The jaws met: nothing between them.
        Empty = "empty",
        /// The object was lost while lifting or holding.
        Slipped = "slipped",
        /// While closing or lifting, the gripper or what it holds drove another object, or ran into the table or the
        /// container.
        HitOther = "hit_other",
        /// The object moved with the gripper and is still between both fingers.
        Held = "held",
    }
}

impl Outcome {
    /// What it means, in a few words.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::PregraspCollision => "the open gripper touches something before it approaches",
            Self::ApproachCollision => "the gripper touches something on its straight way",
            Self::Empty => "the fingers met on nothing",
            Self::Slipped => "the object stayed behind, or fell",
            Self::HitOther => {
                "another object was pushed or lifted by more than is allowed, or the table or a wall was touched"
            }
            Self::Held => "lifted, and still between the fingers",
        }
    }

    /// 1 for [`Outcome::Held`], 0 for everything else.
    #[must_use]
    pub fn label(self) -> u8 {
        u8::from(self == Self::Held)
    }
}

words! {
    /// What the gripper, or the object it held, ran into.
    #[derive(PartialOrd, Ord, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum HitKind {
        /// The object to be grasped.
        Target = "target",
        /// Another object.
        Other = "other",
        /// The table.
        Table = "table",
        /// The container in which the objects lie.
        Container = "container",
    }
}

words! {
    /// Kinds of events.
    #[derive(Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum EventKind {
        /// A phase begins and lasts until the next.
        Phase = "phase",
        /// A note.
        Note = "note",
        /// The decision that a grasp holds.
        Held = "held",
        /// The decision that it does not hold.
        Failed = "failed",
    }
}

/// Something that happened in a recorded attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// The frame.
    pub frame: usize,
    /// Its kind.
    pub kind: EventKind,
    /// Its text.
    pub text: String,
}
