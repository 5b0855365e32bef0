//! The products that the network consists of, on memory as it lies.
//!
//! Nothing is gathered: a convolution reads its inputs where they lie ([`tile`], [`conv`]), and a doubling takes the two taps
//! that it has instead of a matrix.

pub(crate) mod conv;
pub(crate) mod doubling;
pub(crate) mod folded;
pub(crate) mod parameters;
pub(crate) mod tile;
