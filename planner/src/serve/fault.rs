//! The service's error answers: a status and `{"error": "…", "status": 422}`, for every source of errors; of `/predict`
//! `{"detail": {"error": "…", "message": "…"}}`.
//!
//! The router and the layers in front of the handlers answer with plain text or without a body; [`as_json`] converts
//! those answers to the same layout.

use axum::Json;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::options::ServeOptions;

/// An error answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fault {
    status: StatusCode,
    /// The error: rule, value, limit, place.
    error: String,
    /// Its word in the contract of `/predict`.
    code: Option<&'static str>,
}

impl Fault {
    pub(super) fn new(status: StatusCode, error: impl Into<String>) -> Self {
        Self { status, error: error.into(), code: None }
    }

    /// The same with its word in the contract of `/predict`.
    pub(super) fn coded(status: StatusCode, code: &'static str, error: impl Into<String>) -> Self {
        Self { code: Some(code), ..Self::new(status, error) }
    }

    /// As `/predict` tells it.
    pub(super) fn detailed(self) -> Response {
        let of_status = match self.status.as_u16() {
            413 => "payload_too_large",
            503 => "not_ready",
            504 => "timeout",
            500..=599 => "internal_error",
            _ => "invalid_request",
        };
        let code = self.code.unwrap_or(of_status);
        told(self.status, json!({ "detail": { "error": code, "message": self.error } }))
    }

    /// A defect of the planner. The log has the details.
    pub(super) fn internal() -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "a defect of the planner; its log has the details")
    }

    /// The error of a layer, or of a request that exceeds its limits.
    pub(super) fn of_layer(status: StatusCode, options: &ServeOptions) -> Self {
        let error = match status {
            StatusCode::NOT_FOUND => "no such path".to_owned(),
            StatusCode::METHOD_NOT_ALLOWED => "no such method for this path: the header Allow lists them".to_owned(),
            StatusCode::PAYLOAD_TOO_LARGE => format!("the body must have at most {} bytes", options.body_bytes_max),
            StatusCode::GATEWAY_TIMEOUT => format!("no answer within {} s", options.request_timeout.as_secs_f64()),
            // A handler panicked.
            StatusCode::INTERNAL_SERVER_ERROR => return Self::internal(),
            other => other.canonical_reason().unwrap_or("error").to_ascii_lowercase(),
        };
        Self::new(status, error)
    }
}

impl IntoResponse for Fault {
    fn into_response(self) -> Response {
        told(self.status, json!({ "error": self.error, "status": self.status.as_u16() }))
    }
}

fn told(status: StatusCode, body: Value) -> Response {
    let retry = (status == StatusCode::SERVICE_UNAVAILABLE).then_some([(header::RETRY_AFTER, "1")]);
    (status, retry, Json(body)).into_response()
}

/// The content-type header of a JSON body.
pub(super) fn json_header() -> [(header::HeaderName, &'static str); 1] {
    [(header::CONTENT_TYPE, "application/json")]
}

/// Whether the headers announce JSON: `application/json` or `…+json`, with or without parameters.
pub(super) fn is_json(headers: &HeaderMap) -> bool {
    let Some(Ok(given)) = headers.get(header::CONTENT_TYPE).map(HeaderValue::to_str) else { return false };
    let kind = given.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    kind == "application/json" || (kind.starts_with("application/") && kind.ends_with("+json"))
}

/// Adds a JSON body to an error response without one, in the layout of `/predict` if it is of that.
pub(super) fn as_json(response: Response, options: &ServeOptions, is_detailed: bool) -> Response {
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) || is_json(response.headers()) {
        return response;
    }
    let fault = Fault::of_layer(status, options);
    let allow = response.headers().get(header::ALLOW).map(|methods| [(header::ALLOW, methods.clone())]);
    (allow, if is_detailed { fault.detailed() } else { fault.into_response() }).into_response()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::serve::GraspFrame;

    fn options() -> ServeOptions {
        ServeOptions {
            host: "127.0.0.1".to_owned(),
            allow_host: Vec::new(),
            port: 0,
            body_bytes_max: 7,
            request_timeout: Duration::from_millis(1500),
            concurrent: 1,
            queue: 0,
            silence_max: Duration::from_secs(10),
            grasp_frame: GraspFrame::DexGraspNet2,
        }
    }

    fn headers(content_type: &str) -> HeaderMap {
        HeaderMap::from_iter([(header::CONTENT_TYPE, HeaderValue::from_str(content_type).unwrap())])
    }

    #[test]
    fn json_is_recognised_by_its_type_whatever_its_parameters() {
        for kind in ["application/json", "Application/JSON; charset=utf-8", "application/geo+json"] {
            assert!(is_json(&headers(kind)), "{kind}");
        }
        for kind in ["text/plain", "application/jsonp", "text/x+json", "application/x-www-form-urlencoded", ""] {
            assert!(!is_json(&headers(kind)), "{kind}");
        }
        assert!(!is_json(&HeaderMap::new()));
    }

    #[test]
    fn plain_errors_become_json_and_keep_what_a_client_needs() {
        let plain = (StatusCode::METHOD_NOT_ALLOWED, [(header::ALLOW, "GET,HEAD")], "no").into_response();
        let answer = as_json(plain, &options(), false);
        assert_eq!(answer.status(), StatusCode::METHOD_NOT_ALLOWED);
        assert_eq!(answer.headers()[header::ALLOW], "GET,HEAD");
        assert!(is_json(answer.headers()));
    }

    #[test]
    fn answers_and_json_errors_are_left_alone() {
        let fine = (StatusCode::OK, "ok").into_response();
        assert!(!is_json(as_json(fine, &options(), false).headers()));
        let ours = (StatusCode::IM_A_TEAPOT, json_header(), "{}").into_response();
        assert_eq!(as_json(ours, &options(), false).headers().len(), 1);
    }

    #[test]
    fn the_limits_numbers_are_in_the_messages() {
        let message = |status| Fault::of_layer(status, &options()).error;
        assert_eq!(message(StatusCode::PAYLOAD_TOO_LARGE), "the body must have at most 7 bytes");
        assert_eq!(message(StatusCode::GATEWAY_TIMEOUT), "no answer within 1.5 s");
    }

    #[test]
    fn who_is_turned_away_learns_when_to_come_back() {
        let response = Fault::new(StatusCode::SERVICE_UNAVAILABLE, "full").into_response();
        assert_eq!(response.headers()[header::RETRY_AFTER], "1");
    }
}
