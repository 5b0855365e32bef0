//! `graspmill` under the name `experiments`.

fn main() -> std::process::ExitCode {
    graspmill::main()
}
