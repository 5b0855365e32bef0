//! The two networks: what a checkpoint can hold.

use program::{ExitCode, Failure};

use crate::judge::{self, Scope};
use crate::layers::{self, LayerShape, ParameterSlot, slots_of};
use crate::upsampling::Upsampling;

/// A network's kind, and what belongs to it besides its parameters.
#[derive(Debug, Clone, PartialEq)]
pub enum Architecture {
    /// The paper's network, which answers for every voxel; the decoder's upsampling mode.
    Voxel(Upsampling),
    /// The judge, which answers for a hand; what it was trained for.
    Judge(Box<Scope>),
}

impl Architecture {
    /// The layers, in the order of their parameters.
    #[must_use]
    pub fn layers(&self) -> &'static [LayerShape] {
        match self {
            Self::Voxel(_) => &layers::LAYERS,
            Self::Judge(_) => &judge::LAYERS,
        }
    }

    /// Every parameter with its position in the flat vector.
    #[must_use]
    pub fn slots(&self) -> Vec<ParameterSlot> {
        slots_of(self.layers())
    }

    /// Initial parameters.
    #[must_use]
    pub fn initial_vector(&self, seed: u64) -> Vec<f32> {
        match self {
            Self::Voxel(_) => layers::initial_vector(seed),
            Self::Judge(_) => judge::initial_vector(seed),
        }
    }

    /// The upsampling mode of the paper's network.
    ///
    /// # Errors
    /// If this is another network; `what` needs the paper's.
    pub fn upsampling(&self, what: &str) -> Result<Upsampling, Failure> {
        match self {
            Self::Voxel(upsampling) => Ok(*upsampling),
            Self::Judge(_) => Err(Failure::new(
                ExitCode::Config,
                format!(
                    "{what} needs the paper's network, which answers for voxels; the weights are those of a judge, which \
                     answers for hands"
                ),
            )),
        }
    }
}
