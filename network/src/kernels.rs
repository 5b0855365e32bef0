//! The network's kernels on the host, which work in place.
//!
//! Nothing is gathered: a convolution reads its inputs in place ([`tile`], [`conv`]), and a doubling uses its two taps
//! instead of a matrix.

pub(crate) mod conv;
pub(crate) mod doubling;
pub(crate) mod folded;
pub(crate) mod parameters;
pub(crate) mod tile;
