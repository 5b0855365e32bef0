//! The program `generator`: writes grasp datasets.

fn main() -> std::process::ExitCode {
    program::run(generator::commands::run)
}
