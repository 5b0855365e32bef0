//! The program `experiments`: clears tables in simulation and counts.

fn main() -> std::process::ExitCode {
    program::run(experiments::commands::run)
}
