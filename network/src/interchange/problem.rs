//! Errors in the bytes of a state dict.

use std::path::Path;

use program::{ExitCode, Failure};

use crate::checkpoint::of_another_network;

/// Why bytes are refused as the network's state dict.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Problem {
    /// Truncated or inconsistent.
    Damaged(String),
    /// Of another kind; the message says what to do.
    Unsupported(&'static str),
    /// A state dict of another network, with the differences.
    Architecture(Vec<String>),
}

impl Problem {
    /// The failure to read the weights in this file.
    pub(super) fn at(self, path: &Path) -> Failure {
        let shown = path.display();
        match self {
            Self::Damaged(problem) => Failure::new(ExitCode::Data, format!("damaged weights: {problem}: {shown}")),
            Self::Unsupported(problem) => {
                Failure::new(ExitCode::Config, format!("not a state dict that can be read: {problem}: {shown}"))
            }
            Self::Architecture(problems) => of_another_network(&problems, path),
        }
    }
}

/// Maximum length of a reported name. The network's longest has 21 bytes.
const NAME_LEN_MAX: usize = 256;

/// A name from a file made safe for messages: shortened, and without control characters.
pub(super) fn shown(name: &str) -> String {
    name.chars().take(NAME_LEN_MAX).flat_map(char::escape_debug).collect()
}
