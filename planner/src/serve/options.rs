//! What a caller sets: address and limits.

use std::net::{SocketAddr, ToSocketAddrs};
use std::time::Duration;

use program::{ExitCode, Failure};

/// Address and limits of the service.
#[derive(Debug, Clone)]
pub struct ServeOptions {
    /// Address to listen on, or a name of one. There are no passwords: anyone who reaches it may use it.
    pub host: String,
    /// Names by which clients may call the service, besides localhost and addresses.
    pub allow_host: Vec<String>,
    /// Port; 0 for any that is free.
    pub port: u16,
    /// Largest request.
    pub body_bytes_max: usize,
    /// Maximum time from a request to its answer.
    pub request_timeout: Duration,
    /// Plans made concurrently.
    pub concurrent: u16,
    /// Plans that may wait; further requests are refused.
    pub queue: u16,
    /// Maximum time from an answer to the next request's complete header.
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
