//! The program `planner`: plans grasps from what a robot sees.

mod commands;

fn main() -> std::process::ExitCode {
    program::run(commands::run)
}
