//! What a judge learns from.

use schema::{Outcome, Pose};

/// A sample of a judge.
pub(super) type Sample = crate::batch::Sample<JudgeSample>;
pub(super) type Found = crate::results::Found<JudgeSample>;

/// What a judge is asked, and how the attempt ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JudgeSample {
    /// Which of the grippers it is.
    pub crop: u32,
    /// The grasp.
    pub workspace_from_grasp: Pose,
    /// Number of views from which the scene's TSDF was made.
    pub views: u8,
    /// Whether gripper and scene are mirrored in the grasp's x and y.
    pub mirrored: [bool; 2],
    /// How the attempt ended.
    pub outcome: Outcome,
    /// Of its repeats the share that held, where there were some.
    pub robustness: Option<f32>,
    /// Whether the gripper hits the table, so that nothing is asked.
    pub hits_table: bool,
}
