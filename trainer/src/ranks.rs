//! Data-parallel training: several processes, each with its share of every batch, end with the bits of one process.
//!
//! Every rank reads the dataset, cuts each batch into the same parts ([`crate::batch::Batch::parts`]) and does a run of
//! them. Rank 0 sends the sum over its parts to rank 1, which adds its own in order and sends the sum back, and so on
//! through the ranks; then rank 0 sends everyone the whole. So gradients are added in the order of parts, as one process
//! does, and neither the number of ranks nor which is faster changes a bit. Only rank 0 writes the run's folder; what it
//! would resume from, it sends to all when they join.
//!
//! [`Place`] says who a process is, by flags or by its launcher's variables; [`Team`] does the talking, over TCP. Every
//! wait has a limit: a rank that is lost or late ends them all, and the run is resumed with any number of ranks. Nothing
//! is encrypted and nobody is asked who he is: use networks that you trust. `docs/data-parallel.md` says why these are not
//! Burn's own collectives.

mod link;
mod place;
mod team;

pub use place::{Flags, Place, PlaceError};
pub use team::Team;

use shards::ExitCode;

/// Why ranks cannot begin or go on together.
#[derive(Debug, thiserror::Error)]
pub enum RanksError {
    /// Rank 0 cannot listen at its address.
    #[error("rank 0 failed to listen: {source}: {address}")]
    Listen {
        /// Where.
        address: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not all came in time.
    #[error("{missing} of {ranks} ranks did not join within {seconds} s: {address}")]
    Absent {
        /// How many did not.
        missing: usize,
        /// How many there should be.
        ranks: usize,
        /// The limit.
        seconds: u64,
        /// Where they were awaited.
        address: String,
    },
    /// Rank 0 cannot be reached.
    #[error("failed to reach rank 0 within {seconds} s: {source}: {address}")]
    Unreached {
        /// Where.
        address: String,
        /// The limit.
        seconds: u64,
        /// What the system said last.
        source: std::io::Error,
    },
    /// A signal came first.
    #[error("stopped by a signal while waiting for the other ranks")]
    Stopped,
    /// A rank does something else.
    #[error("rank {rank} cannot take part: {why}")]
    Unlike {
        /// Which.
        rank: usize,
        /// What differs.
        why: String,
    },
    /// A rank died, or took too long.
    #[error("lost rank {rank}: {source}; --resume goes on from the last checkpoint")]
    Lost {
        /// Which.
        rank: usize,
        /// What the system said.
        source: std::io::Error,
    },
}

impl RanksError {
    /// The code to end with.
    #[must_use]
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Unlike { .. } => ExitCode::Config,
            Self::Listen { .. } | Self::Absent { .. } | Self::Unreached { .. } | Self::Stopped | Self::Lost { .. } => {
                ExitCode::TryAgain
            }
        }
    }
}
