//! What is wrong with the bytes of a state dict.

/// Why bytes are not the network's state dict.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Problem {
    /// Cut off, or contradicting itself.
    Damaged(String),
    /// Whole, but nothing that is read here; says what to do instead.
    Unsupported(String),
    /// A state dict of another network: what differs.
    Architecture(Vec<String>),
}

/// Longest name that is kept or told. The network's longest has 21 bytes.
pub(super) const NAME_LEN_MAX: usize = 256;

pub(super) fn damaged<T>(what: impl Into<String>) -> Result<T, Problem> {
    Err(Problem::Damaged(what.into()))
}

pub(super) fn unsupported<T>(what: impl Into<String>) -> Result<T, Problem> {
    Err(Problem::Unsupported(what.into()))
}

/// A name from a file as a message may show it: short, and without control characters.
pub(super) fn shown(name: &str) -> String {
    name.chars().take(NAME_LEN_MAX).flat_map(char::escape_debug).collect()
}
