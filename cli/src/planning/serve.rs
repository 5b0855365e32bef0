//! `graspmill serve`: plans over HTTP.

use std::time::Duration;

use clap::{Args, value_parser};
use planner::serve::{GraspFrame, ServeOptions, serve};
use program::{Context, ExitCode, Failure, print, print_error, stop_on_signals};

use super::NetworkArguments;
use crate::parse::one_of;

/// Plan grasps over HTTP
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// Address to listen on, or a name of one. There are no passwords: anyone who reaches it may use it
    #[arg(long, default_value = "127.0.0.1")]
    host: String,

    /// A name by which clients may call the service, besides localhost and addresses; may be repeated
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,

    /// Port; 0 for any that is free
    #[arg(long, default_value_t = 8040)]
    port: u16,

    /// Largest request
    #[arg(long, value_name = "MIB", default_value_t = 64, value_parser = value_parser!(u16).range(1..=1024))]
    body_mib_max: u16,

    /// Seconds from a request to its answer, at most
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = value_parser!(u16).range(1..=3600))]
    timeout_s: u16,

    /// Plans made concurrently
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = value_parser!(u16).range(1..=1024))]
    concurrent: u16,

    /// Plans that may wait; further requests are refused
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = value_parser!(u16).range(0..=1024))]
    queue: u16,

    /// Axes of the grasps of /predict: dexgraspnet2 (x approaches, y closes), graspgenx (z approaches, x closes) or
    /// tcp_z_approach (z approaches, y closes); their origin is between the finger tips
    #[arg(long, value_name = "NAME", default_value = "dexgraspnet2", value_parser = one_of!(GraspFrame))]
    grasp_frame: GraspFrame,

    #[command(flatten)]
    network: NetworkArguments,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let planner = arguments.network.planner()?;
    let options = ServeOptions {
        host: arguments.host.clone(),
        allow_host: arguments.allow_host.clone(),
        port: arguments.port,
        body_bytes_max: usize::from(arguments.body_mib_max) << 20,
        request_timeout: Duration::from_secs(arguments.timeout_s.into()),
        concurrent: arguments.concurrent,
        queue: arguments.queue,
        silence_max: Duration::from_secs(10),
        grasp_frame: arguments.grasp_frame,
    };
    let on_first = || print_error("stopping after the plans under way; a second signal stops at once");
    let stop = stop_on_signals(on_first).context("failed to listen for signals")?;
    serve(planner, &options, &stop, &|address| {
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
