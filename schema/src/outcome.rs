//! How an attempt ended. A failed grasp is data, never an error.

use serde::{Deserialize, Serialize};

/// The outcome of an executed grasp attempt; the first that applies, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The open hand at the pre-grasp pose comes within the clearance of something.
    PregraspCollision,
    /// The open hand, moving straight from pre-grasp to grasp, comes within the clearance of something.
    ApproachCollision,
    /// The jaws met: nothing between them.
    Empty,
    /// The object was lost while lifting or holding.
    Slipped,
    /// While closing or lifting, the hand or what it holds drove another object or the table.
    HitOther,
    /// The object moved with the hand and is still between both fingers.
    Held,
}

impl Outcome {
    /// Every outcome, in order.
    pub const ALL: [Self; 6] =
        [Self::PregraspCollision, Self::ApproachCollision, Self::Empty, Self::Slipped, Self::HitOther, Self::Held];

    /// The name in shards and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::PregraspCollision => "pregrasp_collision",
            Self::ApproachCollision => "approach_collision",
            Self::Empty => "empty",
            Self::HitOther => "hit_other",
            Self::Slipped => "slipped",
            Self::Held => "held",
        }
    }

    /// What it means, in a few words.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::PregraspCollision => "the open hand touches something before it approaches",
            Self::ApproachCollision => "the hand touches something on its straight way",
            Self::Empty => "the fingers met on nothing",
            Self::Slipped => "the object stayed behind, or fell",
            Self::HitOther => "another object, or the table, was pushed or lifted by more than is allowed",
            Self::Held => "lifted, and still between the fingers",
        }
    }

    /// The outcome with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|outcome| outcome.name() == name)
    }

    /// 1 for [`Outcome::Held`], 0 for everything else.
    #[must_use]
    pub fn label(self) -> u8 {
        u8::from(self == Self::Held)
    }
}

/// What the hand, or the object it held, ran into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HitKind {
    /// The object to be grasped.
    Target,
    /// Another object.
    Other,
    /// The table.
    Table,
}

impl HitKind {
    /// Every kind, in order.
    pub const ALL: [Self; 3] = [Self::Target, Self::Other, Self::Table];

    /// The name in shards and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Target => "target",
            Self::Other => "other",
            Self::Table => "table",
        }
    }

    /// The kind with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}
