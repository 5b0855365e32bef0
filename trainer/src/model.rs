//! The network in training, whichever of the two it is.

use network::Architecture;
use network::judge::Crop;
use network::upsampling::Upsampling;

use crate::batch::Batch;
use crate::data::Seen;
use crate::device::Device;
use crate::loss::SampleResult;
use crate::step::StepResult;
use crate::{judge, step};

/// A network in training.
#[derive(Debug)]
pub enum Model {
    /// The paper's, on a device.
    Voxel(Upsampling),
    /// A judge, and how it sees hands.
    Judge(Box<Crop>),
}

impl Model {
    /// The network of a checkpoint.
    #[must_use]
    pub fn of(architecture: &Architecture) -> Self {
        match architecture {
            Architecture::Voxel(upsampling) => Self::Voxel(*upsampling),
            Architecture::Judge(scope) => Self::Judge(Box::new(Crop::new(scope))),
        }
    }

    /// How a judge sees hands.
    #[must_use]
    pub fn crop(&self) -> Option<&Crop> {
        match self {
            Self::Voxel(_) => None,
            Self::Judge(crop) => Some(crop),
        }
    }

    /// How it sees grasps; voxels with their grasps at `voxel_offset`.
    #[must_use]
    pub fn seen(&self, voxel_offset: f32) -> Seen<'_> {
        self.crop().map_or(Seen::Voxels { offset: voxel_offset }, Seen::Hands)
    }

    /// Loss and gradient of a batch; a judge's are computed on the host.
    #[must_use]
    pub fn step(&self, vector: &[f32], batch: &Batch, device: &Device) -> StepResult {
        match self {
            Self::Voxel(mode) => step::step(vector, batch, *mode, device),
            Self::Judge(crop) => judge::step(vector, batch, crop),
        }
    }

    /// Losses and predictions of a batch, without a gradient.
    #[must_use]
    pub fn evaluate(&self, vector: &[f32], batch: &Batch, device: &Device) -> Vec<SampleResult> {
        match self {
            Self::Voxel(mode) => step::evaluate(vector, batch, *mode, device),
            Self::Judge(crop) => judge::evaluate(vector, batch, crop),
        }
    }
}
