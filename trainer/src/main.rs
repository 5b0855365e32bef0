//! The program `trainer`: trains the volumetric grasp network.

mod commands;

fn main() -> std::process::ExitCode {
    program::run(commands::run)
}
