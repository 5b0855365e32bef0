//! Faults for tests: the n-th operation on a disk or an object store fails, or kills the program.

use std::io;

/// Injects a fault in tests. Outside of tests it does nothing.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fault {
    #[cfg(test)]
    plan: Option<std::sync::Arc<plan::Plan>>,
}

impl Fault {
    /// Called before an operation.
    #[cfg_attr(not(test), expect(clippy::unused_self, clippy::unnecessary_wraps, reason = "tests have a plan"))]
    pub(crate) fn check(&self) -> io::Result<()> {
        #[cfg(test)]
        if let Some(plan) = &self.plan {
            return plan.before();
        }
        Ok(())
    }

    /// Called after an operation whose answer can be lost.
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

    /// The kind of fault after the passing operations.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub(crate) enum Kind {
        /// This operation and all later ones fail without effect.
        Fail,
        /// This operation is done but its answer is lost; later ones pass.
        LoseAnswer,
        /// The program is killed before this operation.
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
                    // Like the system, so that nothing is cleaned up.
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
