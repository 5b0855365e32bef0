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

    /// What it is, in messages.
    #[must_use]
    pub const fn description(&self) -> &'static str {
        match self {
            Self::Voxel(_) => "the paper's network, which answers for voxels",
            Self::Judge(_) => "a judge, which answers for hands",
        }
    }

    /// The upsampling mode of the paper's network.
    ///
    /// # Errors
    /// If this is another network; `what` needs the paper's.
    pub fn upsampling(&self, what: &str) -> Result<Upsampling, Failure> {
        match self {
            Self::Voxel(upsampling) => Ok(*upsampling),
            Self::Judge(_) => Err(self.misplaced(what, "the paper's network, which answers for voxels")),
        }
    }

    /// What a judge was trained for.
    ///
    /// # Errors
    /// If this is no judge; `what` needs one.
    pub fn scope(&self, what: &str) -> Result<&Scope, Failure> {
        match self {
            Self::Judge(scope) => Ok(scope),
            Self::Voxel(_) => Err(self.misplaced(what, "a judge, which answers for hands")),
        }
    }

    fn misplaced(&self, what: &str, needed: &str) -> Failure {
        Failure::new(
            ExitCode::Config,
            format!("{what} needs {needed}; the weights are those of {}", self.description()),
        )
    }
}
