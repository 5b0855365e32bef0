//! The names by which the service may be called.
//!
//! A page of another site can let its own name resolve to the loopback address (DNS rebinding); a browser then sends
//! that page's requests here. They still carry the site's name in `Host`, so a name must be known. Addresses cannot be
//! rebound.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode, Uri, Version, header};
use axum::middleware::Next;
use axum::response::Response;

use super::Shared;
use super::fault::Fault;
use super::options::ServeOptions;

/// Answers requests that name the service, and refuses others.
pub(super) async fn must_be_known(
    State(shared): State<Arc<Shared>>,
    request: Request,
    next: Next,
) -> Result<Response, Fault> {
    let ServeOptions { host, allow_host, .. } = &shared.options;
    let allowed: Vec<&str> = allow_host.iter().chain([host]).map(String::as_str).collect();
    check(request.version(), request.uri(), request.headers(), &allowed)?;
    Ok(next.run(request).await)
}

fn check(version: Version, uri: &Uri, headers: &HeaderMap, allowed: &[&str]) -> Result<(), Fault> {
    let refused = |text: String| Err(Fault::new(StatusCode::BAD_REQUEST, text));
    let mut hosts = headers.get_all(header::HOST).iter();
    let authority = match (hosts.next(), hosts.next()) {
        (None, _) if version <= Version::HTTP_10 => return Ok(()),
        (Some(host), None) => host.to_str().ok().and_then(|host| host.parse::<Authority>().ok()),
        (None, _) => return refused("the header Host is missing".to_owned()),
        (Some(_), Some(_)) => return refused("there must be one header Host".to_owned()),
    };
    // A request may name the service in its first line, too, which then counts.
    let Some(authority) = uri.authority().or(authority.as_ref()) else {
        return refused("the header Host must be a name or an address".to_owned());
    };
    let name = authority.host().trim_end_matches('.');
    let is_address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>().is_ok();
    let is_known = |known: &str| known.trim_end_matches('.').eq_ignore_ascii_case(name);
    if is_address || is_known("localhost") || allowed.iter().any(|known| is_known(known)) {
        return Ok(());
    }
    let shown: String = name.chars().take(100).collect();
    Err(Fault::new(
        StatusCode::MISDIRECTED_REQUEST,
        format!("the service is not called {shown}: use localhost or its address, or start it with --allow-host"),
    ))
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;
    use axum::response::IntoResponse as _;

    use super::*;

    fn status(uri: &str, hosts: &[&str]) -> Option<u16> {
        let hosts = hosts.iter().map(|host| (header::HOST, HeaderValue::from_str(host).unwrap()));
        let mut headers = HeaderMap::new();
        for (name, host) in hosts {
            headers.append(name, host);
        }
        let allowed = ["Robot.local"];
        check(Version::HTTP_11, &uri.parse().unwrap(), &headers, &allowed)
            .err()
            .map(|fault| fault.into_response().status().as_u16())
    }

    #[test]
    fn names_of_loopback_addresses_and_allowed_names_are_known() {
        for host in
            ["localhost", "LOCALHOST:8040", "localhost.", "127.0.0.1:8040", "[::1]:8040", "10.0.0.7", "robot.LOCAL:1"]
        {
            assert_eq!(status("/", &[host]), None, "{host}");
        }
        assert_eq!(status("http://localhost/", &["evil.example"]), None, "the first line counts");
    }

    #[test]
    fn other_names_are_refused_and_so_is_none() {
        for host in
            ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "robot.local.evil.example:8040"]
        {
            assert_eq!(status("/", &[host]), Some(421), "{host}");
        }
        assert_eq!(status("http://evil.example/", &["localhost"]), Some(421));
        assert_eq!(status("/", &[]), Some(400));
        assert_eq!(status("/", &["localhost", "localhost"]), Some(400));
        assert_eq!(status("/", &["a b"]), Some(400));
    }

    #[test]
    fn clients_of_http_1_0_may_name_nothing() {
        assert!(check(Version::HTTP_10, &"/".parse().unwrap(), &HeaderMap::new(), &[]).is_ok());
    }
}
