//! How every program of the workspace ends, so that a scheduler can tell "run it again" from "run it never again".

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
    /// The dataset is not complete yet: run the missing shards.
    Incomplete = 69,
    /// The outside world failed (disk full, I/O error) or a signal stopped the program. Run it again.
    TryAgain = 75,
    /// The configuration is wrong, or the folder holds something else. Running again will not help.
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
  69  dataset incomplete
  75  I/O trouble or stopped by a signal: run again
  78  wrong configuration, or the folder holds something else";

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
