//! Exit codes of all programs, with which a scheduler distinguishes "run it again" from "do not run it again".

use std::error::Error;
use std::fmt::{self, Display};
use std::io::{self, ErrorKind};

use crate::error_chain;

/// A documented exit code, shared by all binaries. Slurm's `RequeueExit`, Kubernetes' `podFailurePolicy` and shell
/// scripts can act on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ExitCode {
    /// Done, or nothing left to do.
    Ok = 0,
    /// A defect of the program.
    Internal = 1,
    /// The command line is wrong.
    Usage = 2,
    /// Data are damaged, of an unknown version, or came out differently from an earlier run. Do not retry.
    Data = 65,
    /// Done in part: some inputs could not be used and are listed. Running again will not help.
    Partial = 66,
    /// The dataset is not complete yet: run the missing shards.
    Incomplete = 69,
    /// The outside world failed (disk full, out of memory, I/O error) or a signal stopped the program. Run it again.
    TryAgain = 75,
    /// The configuration is wrong, the folder holds something else, or there is no right or no place to read or write.
    /// Running again will not help.
    Config = 78,
}

impl ExitCode {
    /// The table of codes as text, for `--help`.
    pub const HELP: &str = "\
Exit codes:
   0  done
   1  internal error
   2  wrong command line
  65  data damaged, of an unknown version, or not reproduced
  66  done in part: some inputs could not be used, and are listed
  69  dataset incomplete
  75  I/O trouble, out of memory, or stopped by a signal: run again
  78  wrong configuration, no such folder, no permission, or the folder holds something else";

    /// The number that the process returns.
    #[must_use]
    pub fn code(self) -> u8 {
        self as u8
    }
}

impl From<ExitCode> for std::process::ExitCode {
    fn from(code: ExitCode) -> Self {
        Self::from(code.code())
    }
}

/// An error that knows how a program ends because of it. Implementations match on all variants, so that a new one needs
/// its code.
pub trait Exit: Error + 'static {
    /// The code with which a program should end.
    fn exit_code(&self) -> ExitCode;
}

/// The system's number for too many symbolic links.
const ELOOP: i32 = if cfg!(target_os = "linux") { 40 } else { 62 };

impl Exit for io::Error {
    /// [`ExitCode::TryAgain`]: the outside world failed. [`ExitCode::Config`] where the path itself is wrong: nothing
    /// is there, or a folder is gone; a right is missing; a loop of links, a name that is too long, a folder or a
    /// special file in the place of a file, a file in that of a folder. [`ExitCode::Data`] for a file that is too
    /// large.
    fn exit_code(&self) -> ExitCode {
        match self.kind() {
            ErrorKind::NotFound
            | ErrorKind::PermissionDenied
            | ErrorKind::InvalidFilename
            | ErrorKind::AlreadyExists
            | ErrorKind::IsADirectory
            | ErrorKind::NotADirectory => ExitCode::Config,
            // The system's own EINVAL is another matter.
            ErrorKind::InvalidInput if self.raw_os_error().is_none() => ExitCode::Config,
            ErrorKind::InvalidData => ExitCode::Data,
            _ if self.raw_os_error() == Some(ELOOP) => ExitCode::Config,
            _ => ExitCode::TryAgain,
        }
    }
}

impl Exit for settings::Error {
    /// [`ExitCode::Config`].
    fn exit_code(&self) -> ExitCode {
        ExitCode::Config
    }
}

/// Why a command failed: the message for the user and the exit code. Made from any error that implements [`Exit`].
#[derive(Debug, Clone)]
pub struct Failure {
    text: String,
    code: ExitCode,
}

impl Failure {
    /// A failure without a library error.
    pub fn new(code: ExitCode, text: impl Into<String>) -> Self {
        Self { text: text.into(), code }
    }

    /// The code with which the program ends.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        self.code
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Error for Failure {}

impl<E: Exit> From<E> for Failure {
    fn from(error: E) -> Self {
        Self { text: error_chain(&error), code: error.exit_code() }
    }
}

/// Adds what a command was doing when it failed. The exit code does not change.
pub trait Context<T> {
    /// Puts `text` before the error's message.
    ///
    /// # Errors
    /// The failure, with its context.
    fn context(self, text: impl Display) -> Result<T, Failure>;
}

impl<T, E: Into<Failure>> Context<T> for Result<T, E> {
    fn context(self, text: impl Display) -> Result<T, Failure> {
        self.map_err(|error| {
            let Failure { text: cause, code } = error.into();
            Failure { text: format!("{text}: {cause}"), code }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_of_the_help_has_its_meaning() {
        let codes = ExitCode::HELP.lines().skip(1).map(|line| line[..4].trim().parse::<u8>().unwrap());
        let codes: Vec<u8> = codes.collect();
        use ExitCode::{Config, Data, Incomplete, Internal, Ok, Partial, TryAgain, Usage};
        assert_eq!(codes, [Ok, Internal, Usage, Data, Partial, Incomplete, TryAgain, Config].map(ExitCode::code));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_path_that_cannot_be_is_no_reason_to_try_again() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["loop", &"n".repeat(256), &"n/".repeat(2500), "file/below", ".", "gone/x"]
            .map(|name| folder.path().join(name));
        std::os::unix::fs::symlink("loop", &paths[0]).unwrap();
        std::fs::write(folder.path().join("file"), b"").unwrap();
        for path in paths {
            let error = crate::read(&path, 10).unwrap_err();
            assert_eq!(error.exit_code(), ExitCode::Config, "{error}: {}", path.display());
        }
        let codes = [1, 2, 13, 5, 28, 30, 116].map(|number| io::Error::from_raw_os_error(number).exit_code());
        let (config, again) = ([ExitCode::Config; 3], [ExitCode::TryAgain; 4]);
        assert_eq!(codes.split_at(3), (&config[..], &again[..]), "EPERM, ENOENT, EACCES; EIO, ENOSPC, EROFS, ESTALE");
    }

    #[test]
    fn context_keeps_the_exit_code_and_the_cause() {
        let full = || io::Error::new(io::ErrorKind::StorageFull, "no space");
        let failure = Err::<(), _>(full()).context("failed to write a.md").unwrap_err();
        assert_eq!(
            (failure.to_string().as_str(), failure.exit_code()),
            ("failed to write a.md: no space", ExitCode::TryAgain)
        );
        let wrong = Failure::new(ExitCode::Config, "shards must be at least 1");
        let failure = Err::<(), _>(wrong).context("a.toml").unwrap_err();
        assert_eq!(
            (failure.to_string().as_str(), failure.exit_code()),
            ("a.toml: shards must be at least 1", ExitCode::Config)
        );
    }
}
