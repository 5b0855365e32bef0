//! What a caller sets.

use std::net::SocketAddr;
use std::time::Duration;

/// Address and limits of the service.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServeOptions {
    /// Address and port; port 0 selects a free port.
    pub address: SocketAddr,
    /// Names by which clients may call the service, besides `localhost` and addresses.
    pub allowed_hosts: Vec<String>,
    /// Maximum size of a body.
    pub body_bytes_max: usize,
    /// Maximum time from a request's header to its answer.
    pub request_timeout: Duration,
    /// Maximum number of concurrent plans; at least one.
    pub concurrent_max: usize,
    /// Maximum number of waiting plans.
    pub queue_max: usize,
}
