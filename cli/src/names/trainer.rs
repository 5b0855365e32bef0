//! `graspmill` under the name `trainer`.

fn main() -> std::process::ExitCode {
    graspmill::main()
}
