//! What a judge learns from.

use schema::{Outcome, Pose};

use crate::results;

/// A sample of a judge.
pub(super) type Sample = crate::batch::Sample<JudgeSample>;
pub(super) type SampleResult = results::SampleResult<JudgeAnswer>;
pub(super) type StepResult = results::StepResult<JudgeAnswer>;
pub(super) type Found = results::Found<JudgeSample, JudgeAnswer>;

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

/// What only a judge predicts, where the attempt was repeated: the share of its repeats that are expected to hold, and
/// the true one.
pub type JudgeAnswer = Option<[f32; 2]>;
