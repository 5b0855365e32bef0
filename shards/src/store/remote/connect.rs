//! The store of a URL, its client settings, and the meaning of its errors.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::path::Path;
use object_store::{BackoffConfig, ClientConfigKey, ClientOptions, Error, ObjectStore, ObjectStoreScheme, RetryConfig};
use url::{Position, Url};

/// Maximum silence of a server, while connecting and afterwards.
const CONNECT: Duration = Duration::from_secs(5);
const SILENCE: Duration = Duration::from_secs(20);
/// Time limit for retries: long enough for a server to restart, and more than [`SILENCE`], otherwise one silence would
/// end them. Pauses are drawn from a tenth of a second to [`CONNECT`], mostly short ones: a number of retries would
/// say little about the time, so [`RETRIES_MAX`] is never reached first.
const RETRY: Duration = Duration::from_secs(30);
const RETRIES_MAX: usize = 1_000;

/// How long to wait for a silent server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Patience {
    /// A short time.
    Reader,
    /// As long as an object takes to upload.
    Writer,
}

/// A store, whether it lists, and a path in it.
type Place = (Arc<dyn ObjectStore>, bool, Path);

/// The store and the path of a URL. Settings come from the environment.
pub(super) fn connect(url: &Url, patience: Patience) -> Result<Place, Error> {
    // reqwest is built without a default TLS provider; an already installed one is fine.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let (scheme, prefix) = ObjectStoreScheme::parse(url)?;
    let backoff = BackoffConfig { max_backoff: CONNECT, ..BackoffConfig::default() };
    let retry = RetryConfig { backoff, max_retries: RETRIES_MAX, retry_timeout: RETRY };
    let store: Arc<dyn ObjectStore> = match scheme {
        ObjectStoreScheme::AmazonS3 => {
            let builder = AmazonS3Builder::from_env().with_url(url.as_str()).with_retry(retry);
            Arc::new(builder.with_client_options(options("AWS_", patience)).build()?)
        }
        ObjectStoreScheme::GoogleCloudStorage => {
            let builder = GoogleCloudStorageBuilder::from_env().with_url(url.as_str()).with_retry(retry);
            Arc::new(builder.with_client_options(options("GOOGLE_", patience)).build()?)
        }
        ObjectStoreScheme::MicrosoftAzure => {
            let builder = MicrosoftAzureBuilder::from_env().with_url(url.as_str()).with_retry(retry);
            Arc::new(builder.with_client_options(options("AZURE_", patience)).build()?)
        }
        _ => {
            let builder = HttpBuilder::new().with_url(&url[..Position::BeforePath]).with_retry(retry);
            let options = options("HTTP_", patience).with_allow_http(url.scheme() == "http");
            return Ok((Arc::new(builder.with_client_options(options).build()?), false, prefix));
        }
    };
    Ok((store, true, prefix))
}

/// Client options, overridden by the environment, such as `AWS_ALLOW_HTTP` or `AWS_READ_TIMEOUT`.
fn options(prefix: &str, patience: Patience) -> ClientOptions {
    let options = match patience {
        Patience::Reader => ClientOptions::new().with_read_timeout(SILENCE),
        // The server is silent during an upload, so the limit applies to the whole request.
        Patience::Writer => ClientOptions::new(),
    };
    let options = options
        .with_connect_timeout(CONNECT)
        .with_timeout_disabled()
        .with_user_agent(object_store::HeaderValue::from_static(concat!("graspmill/", env!("CARGO_PKG_VERSION"))));
    let variables = std::env::vars_os().filter_map(|(key, value)| {
        let key = key.to_str()?.strip_prefix(prefix)?.to_ascii_lowercase();
        Some((key.parse::<ClientConfigKey>().ok()?, value.into_string().ok()?))
    });
    variables.fold(options, |options, (key, value)| options.with_config(key, value))
}

/// Whether the object does not exist; a missing bucket is a different error.
pub(super) fn is_absent(error: &Error) -> bool {
    matches!(error, Error::NotFound { .. }) && !error.to_string().contains("NoSuchBucket")
}

/// Whether access is denied. Listings give their status only as text.
pub(super) fn is_refused(error: &Error) -> bool {
    matches!(error, Error::PermissionDenied { .. } | Error::Unauthenticated { .. })
        || matches!(status(&error.to_string()), Some((401 | 403, _)))
}

/// The status of a server's answer, and its text. The first status in the message is the server's; its text and names
/// of objects may contain the same words.
fn status(text: &str) -> Option<(u16, &str)> {
    let (_, rest) = text.split_once("status code: ")?;
    Some((rest.get(..3)?.parse().ok()?, rest))
}

/// Whether the server cannot be reached.
pub(super) fn is_unreachable(error: &Error) -> bool {
    program::text::error_chain(error).contains("client error (Connect)")
}

pub(super) fn too_large(bytes: u64, limit: u64) -> io::Error {
    io::Error::new(io::ErrorKind::FileTooLarge, format!("at most {limit} bytes are read at once, got {bytes}"))
}

/// A store's error with its kind, which decides whether a retry may help ([`crate::store::error`]), and with advice.
pub(super) fn explain(error: &Error) -> io::Error {
    let text = program::text::error_chain(error);
    let is = |part: &str| text.contains(part);
    let (status, said) = status(&text).unwrap_or((0, ""));
    let passes = match status {
        400..=499 => {
            let words =
                ["RequestTimeout", "IncompleteBody", "OperationAborted", "ConditionalRequestConflict", "SlowDown"];
            matches!(status, 408 | 409 | 429) || words.into_iter().any(|word| said.contains(word))
        }
        501 => false,
        _ => status >= 500,
    };
    let (kind, advice) = if passes || matches!(error, Error::AlreadyExists { .. } | Error::Precondition { .. }) {
        return io::Error::other(text);
    } else if is("169.254.169.254") || is("metadata.google.internal") {
        (
            io::ErrorKind::InvalidInput,
            "no credentials, neither in the environment nor from this machine's metadata service; for a bucket that \
             everyone may read set AWS_SKIP_SIGNATURE=true or GOOGLE_SKIP_SIGNATURE=true or AZURE_SKIP_SIGNATURE=true",
        )
    } else if is("No CA certificates") {
        (io::ErrorKind::InvalidInput, "install this system's ca-certificates, or set SSL_CERT_FILE")
    } else if is("URL scheme is not allowed") {
        (io::ErrorKind::InvalidInput, "to talk to it without TLS set AWS_ALLOW_HTTP=true")
    } else if is_refused(error) {
        (io::ErrorKind::PermissionDenied, "the store refused: wrong credentials, or no right to do this there")
    } else if is("NoSuchBucket") {
        (io::ErrorKind::InvalidInput, "there is no such bucket")
    } else if status >= 400 || is("incorrectly configured region") || !matches!(error, Error::Generic { .. }) {
        (io::ErrorKind::InvalidInput, "the store cannot do this")
    } else {
        return io::Error::other(text);
    };
    io::Error::new(kind, format!("{advice} ({text})"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_to_do_about_an_error_is_told() {
        let said = |text: &str| explain(&Error::Generic { store: "S3", source: text.to_owned().into() });
        for (text, kind, part) in [
            ("Error performing PUT http://169.254.169.254/latest/api/token", io::ErrorKind::InvalidInput, "AWS_SKIP"),
            ("Server returned non-2xx status code: 400 Bad Request", io::ErrorKind::InvalidInput, "cannot do this"),
            ("Server returned non-2xx status code: 429 Too Many Requests", io::ErrorKind::Other, "429"),
            ("Server returned non-2xx status code: 408 Request Timeout", io::ErrorKind::Other, "408"),
            ("Server returned non-2xx status code: 503 Slow Down", io::ErrorKind::Other, "503"),
            ("connection refused", io::ErrorKind::Other, "connection refused"),
            ("status code: 400 Bad Request: RequestTimeout", io::ErrorKind::Other, "RequestTimeout"),
            ("status code: 409 Conflict: ConditionalRequestConflict", io::ErrorKind::Other, "409"),
            ("status code: 403 Forbidden", io::ErrorKind::PermissionDenied, "wrong credentials"),
            ("SlowDown/x: status code: 403 Forbidden", io::ErrorKind::PermissionDenied, "wrong credentials"),
            ("status code: 500 Internal: status code: 403, request id", io::ErrorKind::Other, "500"),
            ("status code: 501 Not Implemented", io::ErrorKind::InvalidInput, "cannot do this"),
        ] {
            let error = said(text);
            assert!(error.kind() == kind && error.to_string().contains(part), "{error}");
        }
    }
}
