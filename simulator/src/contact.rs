//! What presses on what.

use schema::Vec3;

/// A body that can touch another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactBody {
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
    /// A fixture of the scene.
    Container,
}

/// Two bodies that press on each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Which.
    pub between: [ContactBody; 2],
    /// The contact points that carry load, in metres; a watcher gets them in the workspace.
    pub points_m: Vec<Vec3>,
    /// Force in the last step, in newtons.
    pub force_n: f32,
}
