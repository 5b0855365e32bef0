//! The program `generator`: writes grasp datasets.

mod commands;

fn main() -> std::process::ExitCode {
    program::run(commands::run)
}
