//! The network on the host: the training step, forwards and backwards by hand, and the dense network.
//!
//! It computes what [`crate::step::predict`] and its automatic differentiation do. But nothing is gathered: a convolution
//! reads its inputs where they lie ([`tile`], [`conv`]), and a doubling takes the two taps that it has instead of a matrix.
//! The loss stays where it is defined, in [`crate::loss`], and gives the gradient at the heads. Tests hold all ways, and
//! PyTorch, against each other.

mod conv;
mod dense;
mod doubling;
mod folded;
mod parameters;
mod pass;
mod tile;

pub use dense::{DenseGrids, DenseNetwork};
pub(crate) use pass::Host;
