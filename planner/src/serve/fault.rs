//! The service's error answers: a status and `{"error": "…", "status": 422}`, for every source of errors.
//!
//! The router and the layers in front of the handlers answer with plain text or without a body; [`as_json`] converts
//! those answers to the same layout.

use std::any::Any;
use std::time::Duration;

use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

/// The body of every error.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub(crate) struct ErrorAnswer {
    /// The error: rule, value, limit, place.
    pub(crate) error: String,
    /// The status of the response.
    pub(crate) status: u16,
}

/// An error answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(super) status: StatusCode,
    pub(super) told: String,
}

impl Fault {
    pub(super) fn new(status: StatusCode, told: impl Into<String>) -> Self {
        Self { status, told: told.into() }
    }

    /// A defect of the planner. The log has the details.
    pub(super) fn internal() -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "a defect of the planner; its log has the details")
    }
}

impl IntoResponse for Fault {
    fn into_response(self) -> Response {
        let answer = ErrorAnswer { error: self.told, status: self.status.as_u16() };
        // A string and a number always serialize.
        let body = serde_json::to_vec(&answer).unwrap_or_default();
        let mut response = (self.status, json_header(), body).into_response();
        if self.status == StatusCode::SERVICE_UNAVAILABLE {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
        }
        response
    }
}

/// The content-type header of a JSON body.
pub(super) fn json_header() -> [(header::HeaderName, &'static str); 1] {
    [(header::CONTENT_TYPE, "application/json")]
}

/// Whether the headers announce JSON: `application/json` or `…+json`, with or without parameters.
pub(super) fn is_json(headers: &HeaderMap) -> bool {
    let Some(Ok(told)) = headers.get(header::CONTENT_TYPE).map(HeaderValue::to_str) else { return false };
    let kind = told.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
    kind == "application/json" || (kind.starts_with("application/") && kind.ends_with("+json"))
}

/// The values in the layers' error messages.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) body_bytes_max: usize,
    pub(super) request_timeout: Duration,
}

impl Limits {
    /// The error of a layer.
    pub(super) fn fault(&self, status: StatusCode) -> Fault {
        Fault::new(status, self.told(status))
    }

    fn told(&self, status: StatusCode) -> String {
        match status {
            StatusCode::NOT_FOUND => "no such path: /openapi.json lists them".to_owned(),
            StatusCode::METHOD_NOT_ALLOWED => "no such method for this path: the header Allow lists them".to_owned(),
            StatusCode::PAYLOAD_TOO_LARGE => format!("the body must have at most {} bytes", self.body_bytes_max),
            StatusCode::GATEWAY_TIMEOUT => format!("no answer within {} s", self.request_timeout.as_secs_f64()),
            other => other.canonical_reason().unwrap_or("error").to_ascii_lowercase(),
        }
    }
}

/// Adds a JSON body to an error response without one.
pub(super) fn as_json(response: Response, limits: &Limits) -> Response {
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) || is_json(response.headers()) {
        return response;
    }
    let mut told = limits.fault(status).into_response();
    for name in [header::ALLOW, header::RETRY_AFTER] {
        if let Some(value) = response.headers().get(&name) {
            told.headers_mut().insert(name, value.clone());
        }
    }
    told
}

/// The answer after a panic in a handler. (The panic hook printed its message to stderr.)
pub(super) fn of_panic(_panic: Box<dyn Any + Send + 'static>) -> Response {
    Fault::internal().into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits() -> Limits {
        Limits { body_bytes_max: 7, request_timeout: Duration::from_millis(1500) }
    }

    fn headers(content_type: &str) -> HeaderMap {
        HeaderMap::from_iter([(header::CONTENT_TYPE, HeaderValue::from_str(content_type).unwrap())])
    }

    #[test]
    fn json_is_recognised_by_its_type_whatever_its_parameters() {
        for told in ["application/json", "Application/JSON; charset=utf-8", "application/geo+json"] {
            assert!(is_json(&headers(told)), "{told}");
        }
        for told in ["text/plain", "application/jsonp", "text/x+json", "application/x-www-form-urlencoded", ""] {
            assert!(!is_json(&headers(told)), "{told}");
        }
        assert!(!is_json(&HeaderMap::new()));
    }

    #[test]
    fn plain_errors_become_json_and_keep_what_a_client_needs() {
        let plain = (StatusCode::METHOD_NOT_ALLOWED, [(header::ALLOW, "GET,HEAD")], "no").into_response();
        let told = as_json(plain, &limits());
        assert_eq!(told.status(), StatusCode::METHOD_NOT_ALLOWED);
        assert_eq!(told.headers()[header::ALLOW], "GET,HEAD");
        assert!(is_json(told.headers()));
    }

    #[test]
    fn answers_and_json_errors_are_left_alone() {
        let fine = (StatusCode::OK, "ok").into_response();
        assert!(!is_json(as_json(fine, &limits()).headers()));
        let ours = (StatusCode::IM_A_TEAPOT, json_header(), "{}").into_response();
        assert_eq!(as_json(ours, &limits()).headers().len(), 1);
    }

    #[test]
    fn limits_are_told_with_their_numbers() {
        assert_eq!(limits().told(StatusCode::PAYLOAD_TOO_LARGE), "the body must have at most 7 bytes");
        assert_eq!(limits().told(StatusCode::GATEWAY_TIMEOUT), "no answer within 1.5 s");
    }

    #[test]
    fn who_is_turned_away_learns_when_to_come_back() {
        let response = Fault::new(StatusCode::SERVICE_UNAVAILABLE, "full").into_response();
        assert_eq!(response.headers()[header::RETRY_AFTER], "1");
    }
}
