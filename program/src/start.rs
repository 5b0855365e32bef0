//! How every program starts and ends.

use std::env;
use std::ffi::OsString;
use std::io::{self, IsTerminal};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{self, Command};
use std::sync::OnceLock;

use clap::Parser;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;

use crate::signals::writes_fail_at_the_file_size_limit;
use crate::{Context, ExitCode, Failure, print_error};

/// Parses the command line, starts logging, runs the command, prints its error if there is one, and returns its exit
/// code. Call it once, as all of `main`. A panic, which prints where it happened, ends with [`ExitCode::Internal`].
///
/// Log lines go to standard error. `GRASPMILL_LOG` selects them, in the syntax of `tracing_subscriber::EnvFilter`; by
/// default warnings and errors are shown.
pub fn run<Arguments: Parser>(command: impl FnOnce(Arguments) -> Result<ExitCode, Failure>) -> process::ExitCode {
    run_to_code(command).into()
}

/// [`run`] for a process that is not the program itself: see [`embed`].
pub fn run_to_code<Arguments: Parser>(command: impl FnOnce(Arguments) -> Result<ExitCode, Failure>) -> ExitCode {
    let arguments = Arguments::parse_from(words());
    start_logging();
    if let Err(error) = writes_fail_at_the_file_size_limit() {
        tracing::warn!(%error, "a write beyond the file-size limit will end this program");
    }
    let ended = catch_unwind(AssertUnwindSafe(|| command(arguments)));
    let ended =
        ended.unwrap_or_else(|_| Err(Failure::new(ExitCode::Internal, "a defect of this program; please report it")));
    ended.unwrap_or_else(|failure| {
        print_error(&format!("error: {failure}"));
        failure.exit_code()
    })
}

/// Words of a process that holds all programs, such as an interpreter.
#[derive(Debug)]
struct Embedded {
    words: Vec<OsString>,
    starter: Vec<OsString>,
}

static EMBEDDED: OnceLock<Embedded> = OnceLock::new();

/// Declares that this process hosts all programs. `words` replaces the command line; its first word names the program
/// in its help. `starter` is the command that starts any of them, followed by a program's name and its arguments. Only
/// the first call counts.
pub fn embed(words: Vec<OsString>, starter: Vec<OsString>) {
    // A process is one program.
    let _ = EMBEDDED.set(Embedded { words, starter });
}

/// The words of the command line, the program's own name first.
pub(crate) fn words() -> Vec<OsString> {
    EMBEDDED.get().map_or_else(|| env::args_os().collect(), |embedded| embedded.words.clone())
}

/// A command that starts another of our programs: the one that lies beside this one.
///
/// # Errors
/// If there is none.
pub fn start_beside(name: &str) -> Result<Command, Failure> {
    if let Some(Embedded { starter, .. }) = EMBEDDED.get()
        && let [first, rest @ ..] = starter.as_slice()
    {
        let mut command = Command::new(first);
        command.args(rest).arg(name);
        return Ok(command);
    }
    let own = env::current_exe().context("failed to find this program's folder")?;
    let path = own.with_file_name(format!("{name}{}", env::consts::EXE_SUFFIX));
    if path.is_file() {
        return Ok(Command::new(path));
    }
    let why = format!("the program {} is not there; it must lie beside this one", path.display());
    Err(Failure::new(ExitCode::Config, why))
}

fn start_logging() {
    let filter = EnvFilter::builder().with_default_directive(LevelFilter::WARN.into()).with_env_var("GRASPMILL_LOG");
    tracing_subscriber::fmt()
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .with_env_filter(filter.from_env_lossy())
        .init();
}

/// Starts the threads that share parallel work, one per core unless `threads` says otherwise. Call it at most once,
/// before that work begins.
///
/// # Errors
/// [`ExitCode::TryAgain`] if the system refuses, or parallel work has begun.
pub fn start_threads(threads: Option<u16>) -> Result<(), Failure> {
    ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0).into()).build_global().map_err(|e| not_started(&e))
}

/// A number of threads apart from those.
///
/// # Errors
/// [`ExitCode::TryAgain`] if the system refuses.
pub fn thread_pool(threads: usize) -> Result<ThreadPool, Failure> {
    ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| not_started(&e))
}

fn not_started(error: &ThreadPoolBuildError) -> Failure {
    Failure::new(ExitCode::TryAgain, format!("failed to start the threads: {error}"))
}
