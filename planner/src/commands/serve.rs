//! `planner serve`: plans over HTTP.

use crate::serve::{ServeOptions, serve};
use clap::Args;
use program::{Context, ExitCode, Failure, print, print_error, stop_on_signals};

use super::NetworkArguments;

/// Plan grasps over HTTP
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: ServeOptions,

    #[command(flatten)]
    network: NetworkArguments,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let planner = arguments.network.planner()?;
    let on_first = || print_error("stopping after the plans under way; a second signal stops at once");
    let stop = stop_on_signals(on_first).context("failed to listen for signals")?;
    serve(planner, &arguments.options, &stop, &|address| {
        if !address.ip().is_loopback() {
            print_error(
                "warning: not a loopback address, and there are no passwords: anyone who reaches it may use it",
            );
        }
        // A standard output that cannot be written is no reason not to serve.
        let _ = print(format_args!("listening on http://{address}\n"));
    })?;
    Ok(ExitCode::Ok)
}
