//! The program `shards`: looks at datasets, exports them, changes nothing in them.

fn main() -> std::process::ExitCode {
    program::run(shards::commands::run)
}
