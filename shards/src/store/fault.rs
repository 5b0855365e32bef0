//! Faults for tests: the n-th operation on a disk or an object store fails, or kills the program.

use std::io;

/// Lets tests fail an operation. Outside of tests there is none.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fault {
    #[cfg(test)]
    plan: Option<std::sync::Arc<plan::Plan>>,
}

impl Fault {
    /// Asked before an operation.
    #[cfg_attr(not(test), expect(clippy::unused_self, clippy::unnecessary_wraps, reason = "tests have a plan"))]
    pub(crate) fn check(&self) -> io::Result<()> {
        #[cfg(test)]
        if let Some(plan) = &self.plan {
            return plan.before();
        }
        Ok(())
    }

    /// Asked after an operation whose answer can get lost.
    #[cfg_attr(not(test), expect(clippy::unused_self, clippy::unnecessary_wraps, reason = "tests have a plan"))]
    pub(crate) fn check_answer(&self) -> io::Result<()> {
        #[cfg(test)]
        if let Some(plan) = &self.plan {
            return plan.after();
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) use plan::Kind;

#[cfg(test)]
mod plan {
    use std::io;
    use std::process::Command;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// What happens when no operation is left to pass.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub(crate) enum Kind {
        /// This one and all after it fail, and do nothing.
        Fail,
        /// This one is done and its answer is lost; those after it pass.
        LoseAnswer,
        /// The program is killed before this one.
        Kill,
    }

    #[derive(Debug)]
    pub(super) struct Plan {
        begun: AtomicU64,
        passing: u64,
        kind: Kind,
    }

    impl super::Fault {
        /// Lets `passing` operations pass.
        pub(crate) fn after(passing: u64, kind: Kind) -> Self {
            Self { plan: Some(Arc::new(Plan { begun: AtomicU64::new(0), passing, kind })) }
        }
    }

    impl Plan {
        pub(super) fn before(&self) -> io::Result<()> {
            if self.begun.fetch_add(1, Ordering::Relaxed) < self.passing {
                return Ok(());
            }
            match self.kind {
                Kind::Fail => Err(io::ErrorKind::StorageFull.into()),
                Kind::LoseAnswer => Ok(()),
                Kind::Kill => {
                    // As the system does it, so that nothing is cleaned up.
                    Command::new("kill").args(["-9", &std::process::id().to_string()]).status()?;
                    Err(io::ErrorKind::Interrupted.into())
                }
            }
        }

        pub(super) fn after(&self) -> io::Result<()> {
            let is_this_one = self.begun.load(Ordering::Relaxed) == self.passing + 1;
            match self.kind {
                Kind::LoseAnswer if is_this_one => Err(io::ErrorKind::ConnectionReset.into()),
                _ => Ok(()),
            }
        }
    }
}
