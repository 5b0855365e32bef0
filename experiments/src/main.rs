//! The program `experiments`: clears tables in simulation and counts.

mod commands;

fn main() -> std::process::ExitCode {
    program::run(commands::run)
}
