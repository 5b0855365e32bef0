//! What every command does alike: it starts, reports errors, reacts to signals, publishes files, prints numbers, and
//! ends with a documented exit code.
//!
//! A `main` calls [`run`] with a command. Whatever a command returns with `?` must implement [`Exit`], so an error
//! without an exit code does not compile:
//!
//! ```compile_fail
//! fn command(text: &str) -> Result<program::ExitCode, program::Failure> {
//!     let _: u8 = text.parse()?; // `ParseIntError` has no exit code
//!     Ok(program::ExitCode::Ok)
//! }
//! ```
//!
//! Of our crates this one depends on `settings` alone, whose error reaches every `main`.

#[cfg(not(fuzzing))] // fuzzers measure memory with their own
mod allocator;
mod exit;
mod folder;
mod output;
mod publish;
mod read;
mod signals;
mod start;
pub mod text;

pub use exit::{Context, Exit, ExitCode, Failure};
pub use folder::FolderLock;
pub use output::{command_line, differences, json, print, print_error, write};
pub use publish::{is_temporary, publish};
pub use read::{create, names_in, open, open_as, read, unread};
pub use signals::stop_on_signals;
pub use start::{run, start_threads, thread_pool};
pub use text::error_chain;
