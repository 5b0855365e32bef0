//! The program `graspmill`.

fn main() -> std::process::ExitCode {
    graspmill::main()
}
