//! Compares the network with PyTorch; with the feature `flex` also the host's kernels with Burn's, and the
//! receptive-field step with the dense network.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![cfg_attr(feature = "flex", expect(clippy::print_stdout, reason = "a test tells what it measured"))]

#[cfg(feature = "flex")]
mod dense;
#[cfg(feature = "flex")]
mod devices;
mod formula;
mod parity;
#[cfg(feature = "flex")]
mod plain;
#[cfg(feature = "flex")]
mod receptive_field;
