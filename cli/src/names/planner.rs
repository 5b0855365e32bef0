//! `graspmill` under the name `planner`.

fn main() -> std::process::ExitCode {
    graspmill::main()
}
