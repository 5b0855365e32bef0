//! The program `trainer`: trains the volumetric grasp network.

fn main() -> std::process::ExitCode {
    program::run(trainer::commands::run)
}
