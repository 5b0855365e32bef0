//! Why an input is refused. Damaged bytes (exit code 65) are distinguished from values that break a rule (78).

use std::path::PathBuf;

use program::{Exit, ExitCode};

/// Why an input is refused. Messages contain the place: a key's path, a file, or both.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// The request is not JSON, or not TOML.
    #[error("{0}")]
    Syntax(String),
    /// Bytes are not of the expected format, or end too early.
    #[error("{0}")]
    Damaged(String),
    /// A key, a shape or a value breaks a rule.
    #[error("{0}")]
    Value(String),
    /// A file cannot be read.
    #[error("failed to read {}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Exit for InputError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Syntax(_) | Self::Value(_) => ExitCode::Config,
            Self::Damaged(_) => ExitCode::Data,
            Self::Io { source, .. } => source.exit_code(),
        }
    }
}

impl InputError {
    /// Whether the request could not be parsed: 400 over HTTP, while a refused value is 422.
    #[must_use]
    pub fn is_syntax(&self) -> bool {
        matches!(self, Self::Syntax(_))
    }

    /// Adds the place of the error; errors that already name a file are unchanged.
    #[must_use]
    pub fn at(self, place: &str) -> Self {
        match self {
            Self::Syntax(message) => Self::Syntax(format!("{message}: {place}")),
            Self::Damaged(message) => Self::Damaged(format!("{message}: {place}")),
            Self::Value(message) => Self::Value(format!("{message}: {place}")),
            named => named,
        }
    }
}

/// Refuses a key, a shape or a value.
pub(crate) fn refuse<T>(what: impl Into<String>) -> Result<T, InputError> {
    Err(InputError::Value(what.into()))
}

/// Outside text made safe to print: without control characters and shortened.
pub(crate) fn shown(text: &str) -> String {
    const CHARS_MAX: usize = 240;
    let short: String = text.chars().take(CHARS_MAX).flat_map(char::escape_debug).collect();
    if text.chars().nth(CHARS_MAX).is_some() { format!("{short}…") } else { short }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_its_code() {
        let io = InputError::Io { path: "a".into(), source: std::io::Error::other("disk on fire") };
        assert_eq!(io.exit_code(), ExitCode::TryAgain);
        assert!(!io.is_syntax());
        assert_eq!(io.to_string(), "failed to read a: disk on fire");
        assert_eq!(InputError::Damaged(String::new()).exit_code(), ExitCode::Data);
        assert_eq!(InputError::Value(String::new()).exit_code(), ExitCode::Config);
        assert!(InputError::Syntax(String::new()).is_syntax());
    }

    #[test]
    fn texts_from_outside_are_cut_and_escaped() {
        assert_eq!(shown("a\u{1b}[31m\n"), "a\\u{1b}[31m\\n");
        assert_eq!(shown(&"x".repeat(1000)).chars().count(), 241);
    }
}
