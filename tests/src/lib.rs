//! The workspace's own tests: the binaries run as a user runs them, and the fences between the crates.
