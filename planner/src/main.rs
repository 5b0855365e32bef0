//! The program `planner`: plans grasps from what a robot sees.

fn main() -> std::process::ExitCode {
    program::run(planner::commands::run)
}
