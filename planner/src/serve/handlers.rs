//! The endpoints. Plans run on separate threads, so health and metrics answer while all of them are busy.
//!
//! A request takes its slot before its body is read, which bounds the memory of waiting requests.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use axum::Json;
use axum::body::Bytes;
use axum::extract::{FromRequest, Request, State};
use axum::http::{HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::fault::{Detailed, Fault, is_json, json_header};
use super::metrics::MEDIA_TYPE;
use super::model::ModelAnswer;
use super::predict::{ConfigAnswer, PredictAnswer, PredictInput, VersionAnswer};
use super::{PlanBytes, Shared, Work};
use crate::input::RequestInput;
use crate::plan::Plan;

const SERVER_TIMING: HeaderName = HeaderName::from_static("server-timing");

/// Ranked grasps for an observation. An empty list is an answer, too: `reason` says why.
#[utoipa::path(
    post,
    path = "/v1/plan",
    request_body = RequestInput,
    responses(
        (status = 200, description = "The plan", body = Plan, headers(
            ("Server-Timing" = String, description = "time of each stage, in milliseconds")
        )),
        (status = 400, description = "The body is not JSON, or is incomplete", body = Fault),
        (status = 413, description = "The body is too large", body = Fault),
        (status = 415, description = "The content type is not JSON", body = Fault),
        (status = 422, description = "The JSON is not a request, or a value is wrong", body = Fault),
        (status = 500, description = "A defect of the planner", body = Fault),
        (status = 503, description = "Too many requests are waiting, or the service is stopping", body = Fault, headers(
            ("Retry-After" = u32, description = "time until a retry, in seconds")
        )),
        (status = 504, description = "Not done in time", body = Fault)
    )
)]
pub(super) async fn plan(State(shared): State<Arc<Shared>>, request: Request) -> Result<Response, Fault> {
    answer(shared, request, |work| &work.plan).await
}

/// Ranked grasps of one object, for clients of GraspGen-X's and DexGraspNet 2's servers.
#[utoipa::path(
    post,
    path = "/predict",
    request_body = PredictInput,
    responses(
        (status = 200, description = "The grasps, the best first", body = PredictAnswer),
        (status = 400, description = "An array's type, base64, length or shape is wrong", body = Detailed),
        (status = 413, description = "Too many points, or too large a body", body = Detailed),
        (status = 415, description = "The content type is not JSON", body = Detailed),
        (status = 422, description = "Not a request, too few points, or no table under them", body = Detailed),
        (status = 500, description = "A defect of the planner", body = Detailed),
        (status = 503, description = "Too many requests are waiting, or the service is stopping", body = Detailed),
        (status = 504, description = "Not done in time", body = Detailed)
    )
)]
pub(super) async fn predict(State(shared): State<Arc<Shared>>, request: Request) -> Response {
    answer(shared, request, |work| &work.predict).await.unwrap_or_else(Fault::detailed)
}

/// The answer of a worker to a request's body.
async fn answer(shared: Arc<Shared>, request: Request, worker: fn(&Work) -> &PlanBytes) -> Result<Response, Fault> {
    if !is_json(request.headers()) {
        return Err(Fault::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "the content type must be application/json"));
    }
    let place = Arc::clone(&shared.places).try_acquire_owned().map_err(|_| shared.turned_away())?;
    let body = Bytes::from_request(request, &()).await.map_err(|rejection| match rejection.status() {
        StatusCode::PAYLOAD_TOO_LARGE => Fault::of_layer(StatusCode::PAYLOAD_TOO_LARGE, &shared.options),
        _ => Fault::new(StatusCode::BAD_REQUEST, "the body is incomplete"),
    })?;
    let turn = Arc::clone(&shared.turns).acquire_owned().await.map_err(|_| stopping())?;
    let working = Arc::clone(&shared);
    let work = move || -> Result<Response, Fault> {
        // Kept until the plan ends, even if its request is gone.
        let _held = (place, turn);
        let started = Instant::now();
        let planned = worker(&working.work)(&body)?;
        working.metrics.planned(started.elapsed().as_secs_f64(), planned.grasp_count);
        Ok((json_header(), [(SERVER_TIMING, planned.server_timing)], planned.body).into_response())
    };
    match tokio::task::spawn_blocking(work).await {
        Ok(answer) => answer,
        Err(error) if error.is_panic() => {
            tracing::error!("a plan panicked; the service continues");
            Err(Fault::internal())
        }
        Err(_) => Err(stopping()),
    }
}

fn stopping() -> Fault {
    Fault::new(StatusCode::SERVICE_UNAVAILABLE, "the service is stopping")
}

/// The network and settings of the service.
#[utoipa::path(get, path = "/v1/model", responses((status = 200, description = "The planner", body = ModelAnswer)))]
pub(super) async fn model(State(shared): State<Arc<Shared>>) -> Response {
    (json_header(), shared.work.model_json.clone()).into_response()
}

/// What a client of `/predict` must know: the hand, its frame and the limits.
#[utoipa::path(get, path = "/config", responses((status = 200, description = "The hand and the limits", body = ConfigAnswer)))]
pub(super) async fn config(State(shared): State<Arc<Shared>>) -> Response {
    (json_header(), shared.work.config_json.clone()).into_response()
}

/// Versions of the server and of the contract of `/predict`.
#[utoipa::path(get, path = "/version", responses((status = 200, description = "The versions", body = VersionAnswer)))]
pub(super) async fn version() -> Json<VersionAnswer> {
    Json(VersionAnswer::NOW)
}

/// Whether the process runs.
#[utoipa::path(get, path = "/healthz", responses((status = 200, description = "ok", body = String)))]
pub(super) async fn healthz() -> &'static str {
    "ok"
}

/// Whether the service accepts requests. The model is loaded before it listens, so only a stopping service is not
/// ready.
#[utoipa::path(
    get,
    path = "/readyz",
    responses(
        (status = 200, description = "ready", body = String),
        (status = 503, description = "The service is stopping", body = Fault)
    )
)]
pub(super) async fn readyz(State(shared): State<Arc<Shared>>) -> Result<&'static str, Fault> {
    if shared.stopping.load(Ordering::Relaxed) { Err(stopping()) } else { Ok("ready") }
}

/// Counters and histograms for Prometheus.
#[utoipa::path(
    get,
    path = "/metrics",
    responses((status = 200, description = "OpenMetrics text", body = String, content_type = "application/openmetrics-text"))
)]
pub(super) async fn metrics(State(shared): State<Arc<Shared>>) -> Result<Response, Fault> {
    let text = shared.metrics.text().map_err(|_| Fault::internal())?;
    Ok(([(header::CONTENT_TYPE, MEDIA_TYPE)], text).into_response())
}
