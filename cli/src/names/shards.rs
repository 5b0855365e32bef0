//! `graspmill` under the name `shards`.

fn main() -> std::process::ExitCode {
    graspmill::main()
}
