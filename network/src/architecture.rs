//! The two networks: what a checkpoint can hold.

use program::{ExitCode, Failure};
use settings::words;

use crate::judge::{self, Scope};
use crate::layers::{self, LayerShape, ParameterSlot, slots_of};
use crate::upsampling::Upsampling;

words! {
    /// A network, by what it answers for.
    pub enum Kind {
        /// Voxels: the paper's.
        Voxel = "voxel",
        /// Hands: the judge.
        Judge = "judge",
    }
}

impl Kind {
    /// What it is called in messages.
    #[must_use]
    pub const fn told(self) -> &'static str {
        match self {
            Self::Voxel => "the paper's network, which answers for voxels",
            Self::Judge => "a judge, which answers for hands",
        }
    }

    /// The error where weights of this kind are given for what needs those of another.
    #[must_use]
    pub fn refused(self, what: &str, needed: Self) -> Failure {
        let text = format!("{what} needs {}; the weights are those of {}", needed.told(), self.told());
        Failure::new(ExitCode::Config, text)
    }
}

/// A network's kind, and what belongs to it besides its parameters.
#[derive(Debug, Clone, PartialEq)]
pub enum Architecture {
    /// The paper's network, which answers for every voxel; the decoder's upsampling mode.
    Voxel(Upsampling),
    /// The judge, which answers for a hand; what it was trained for.
    Judge(Box<Scope>),
}

impl Architecture {
    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Voxel(_) => Kind::Voxel,
            Self::Judge(_) => Kind::Judge,
        }
    }

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
            Self::Judge(_) => Err(self.kind().refused(what, Kind::Voxel)),
        }
    }

    /// What a judge answers for.
    ///
    /// # Errors
    /// If this is the paper's network; `what` needs a judge.
    pub fn scope(&self, what: &str) -> Result<&Scope, Failure> {
        match self {
            Self::Judge(scope) => Ok(scope),
            Self::Voxel(_) => Err(self.kind().refused(what, Kind::Judge)),
        }
    }
}
