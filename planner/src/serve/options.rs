//! What a caller sets: the command's arguments.

use std::net::{SocketAddr, ToSocketAddrs};
use std::time::Duration;

use clap::builder::TypedValueParser as _;
use clap::{Args, value_parser};
use program::{ExitCode, Failure};

/// [`ServeOptions::silence_max`].
pub(super) const SILENCE_MAX: Duration = Duration::from_secs(10);

/// Address and limits of the service.
#[derive(Debug, Clone, Args)]
pub struct ServeOptions {
    /// Address to listen on, or a name of one. There are no passwords: anyone who reaches it may use it
    #[arg(long, default_value = "127.0.0.1")]
    pub host: String,

    /// A name by which clients may call the service, besides localhost and addresses; may be repeated
    #[arg(long, value_name = "NAME")]
    pub allow_host: Vec<String>,

    /// Port; 0 for any that is free
    #[arg(long, default_value_t = 8040)]
    pub port: u16,

    /// Largest request
    #[arg(long = "body-mib-max", value_name = "MIB", default_value = "64")]
    #[arg(value_parser = value_parser!(u16).range(1..=1024).map(|mib| usize::from(mib) << 20))]
    pub body_bytes_max: usize,

    /// Seconds from a request to its answer, at most
    #[arg(long = "timeout-s", value_name = "S", default_value = "30")]
    #[arg(value_parser = value_parser!(u16).range(1..=3600).map(|s| Duration::from_secs(s.into())))]
    pub request_timeout: Duration,

    /// Plans made concurrently
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = value_parser!(u16).range(1..=1024))]
    pub concurrent: u16,

    /// Plans that may wait; further requests are refused
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = value_parser!(u16).range(0..=1024))]
    pub queue: u16,

    /// Maximum time from an answer to the next request's complete header
    #[arg(skip = SILENCE_MAX)]
    pub silence_max: Duration,
}

impl ServeOptions {
    /// The first address of the host.
    pub(super) fn address(&self) -> Result<SocketAddr, Failure> {
        let host = &self.host;
        let unknown = |reason: &str| {
            Failure::new(ExitCode::Config, format!("--host must be an address or its name, got {host}: {reason}"))
        };
        let mut found = (host.trim_start_matches('[').trim_end_matches(']'), self.port)
            .to_socket_addrs()
            .map_err(|e| unknown(&e.to_string()))?;
        found.next().ok_or_else(|| unknown("it has no address"))
    }
}
