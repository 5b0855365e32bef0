//! The training step on the host, forwards and backwards by hand.
//!
//! It computes what an automatic differentiation of [`crate::step::predict`] does, in the same matrix products; but rows are
//! gathered by copying runs of memory instead of by lists of indices, scattered back by adding the same runs, and doubled
//! by the two taps that a doubling has instead of by matrices. The loss stays where it is defined, in [`crate::loss`],
//! and gives the gradient at the heads. Tests hold both ways, and PyTorch, against each other.

mod cube;
mod doubling;
mod pass;

pub(crate) use pass::part_gradient;
