//! The network in training, whichever of the two it is.

use network::judge::Crop;
use network::{Architecture, VoxelParams};
use schema::Gripper;

use crate::batch::Batch;
use crate::config::Targets;
use crate::data::Seen;
use crate::device::Device;
use crate::loss::SampleResult;
use crate::step::StepResult;
use crate::{judge, step};

/// A network in training.
#[derive(Debug)]
pub enum Model {
    /// The paper's, on a device.
    Voxel(VoxelParams),
    /// A judge, and how it sees each hand.
    Judge(Vec<Crop>),
}

impl Model {
    /// The network of a checkpoint for these hands.
    #[must_use]
    pub fn of<'a>(architecture: &Architecture, hands: impl Iterator<Item = &'a Gripper>) -> Self {
        match architecture {
            Architecture::Voxel(params) => Self::Voxel(*params),
            Architecture::Judge(scope) => {
                Self::Judge(hands.map(|hand| Crop::new(hand, scope.pregrasp_distance_m, &scope.grid)).collect())
            }
        }
    }

    /// How a judge sees each hand.
    #[must_use]
    pub fn crops(&self) -> Option<&[Crop]> {
        match self {
            Self::Voxel(_) => None,
            Self::Judge(crops) => Some(crops),
        }
    }

    /// How it sees grasps; a network of voxels with these targets.
    #[must_use]
    pub fn seen(&self, targets: Targets) -> Seen<'_> {
        match self {
            Self::Voxel(params) => Seen::Voxels { origin: params.origin, targets },
            Self::Judge(crops) => Seen::Hands(crops),
        }
    }

    /// Loss and gradient of a batch; a judge's are computed on the host.
    #[must_use]
    pub fn step(&self, vector: &[f32], batch: &Batch, device: &Device) -> StepResult {
        match self {
            Self::Voxel(params) => step::step(vector, batch, params.upsampling, device),
            Self::Judge(crops) => judge::step(vector, batch, crops),
        }
    }

    /// Losses and predictions of a batch, without a gradient.
    #[must_use]
    pub fn evaluate(&self, vector: &[f32], batch: &Batch, device: &Device) -> Vec<SampleResult> {
        match self {
            Self::Voxel(params) => step::evaluate(vector, batch, params.upsampling, device),
            Self::Judge(crops) => judge::evaluate(vector, batch, crops),
        }
    }
}
