//! The program `shards`: looks at datasets, exports them, changes nothing in them.

mod commands;

fn main() -> std::process::ExitCode {
    program::run(commands::run)
}
