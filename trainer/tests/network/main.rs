//! Compares the network with PyTorch, and the receptive-field step with the dense network.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking, and tells what it measured")]

mod dense;
mod devices;
mod formula;
mod parity;
mod plain;
mod receptive_field;
