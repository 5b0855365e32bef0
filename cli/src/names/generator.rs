//! `graspmill` under the name `generator`.

fn main() -> std::process::ExitCode {
    graspmill::main()
}
