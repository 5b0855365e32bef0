//! The endpoints. Plans run on separate threads, so health answers while all of them are busy.
//!
//! A request takes its slot before its body is read, which bounds the memory of waiting requests.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use axum::body::Bytes;
use axum::extract::{FromRequest, Request, State};
use axum::http::header::CONTENT_ENCODING;
use axum::http::{HeaderName, StatusCode};
use axum::response::{IntoResponse, Response};

use super::fault::{Fault, is_json, json_header};
use super::{PlanBytes, Shared, Work, cut};

const SERVER_TIMING: HeaderName = HeaderName::from_static("server-timing");

/// Ranked grasps for an observation. An empty list is an answer, too: `reason` says why.
pub(super) async fn plan(State(shared): State<Arc<Shared>>, request: Request) -> Result<Response, Fault> {
    answer(shared, request, |work| &work.plan).await
}

/// Ranked grasps of one object, for clients of GraspGen-X's and DexGraspNet 2's servers.
pub(super) async fn predict(State(shared): State<Arc<Shared>>, request: Request) -> Response {
    answer(shared, request, |work| &work.predict).await.unwrap_or_else(Fault::detailed)
}

/// The answer of a worker to a request's body.
async fn answer(shared: Arc<Shared>, request: Request, worker: fn(&Work) -> &PlanBytes) -> Result<Response, Fault> {
    if !is_json(request.headers()) {
        return Err(Fault::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "the content type must be application/json"));
    }
    let coding = request.headers().get(CONTENT_ENCODING).map_or("identity", |coding| coding.to_str().unwrap_or("?"));
    if !coding.eq_ignore_ascii_case("identity") {
        let message = format!("the body must not be compressed, got the content-encoding {}", cut(coding));
        return Err(Fault::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, message));
    }
    let place =
        Arc::clone(&shared.places).try_acquire_owned().map_err(|_| unavailable("too many plans are waiting"))?;
    let body = Bytes::from_request(request, &()).await.map_err(|rejection| match rejection.status() {
        StatusCode::PAYLOAD_TOO_LARGE => Fault::of_layer(StatusCode::PAYLOAD_TOO_LARGE, &shared.options),
        _ => Fault::new(StatusCode::BAD_REQUEST, "the body is incomplete"),
    })?;
    let turn = Arc::clone(&shared.turns).acquire_owned().await.map_err(|_| unavailable(STOPPING))?;
    let work = move || -> Result<Response, Fault> {
        // Held until the plan ends, even if its request is gone.
        let _held = (place, turn);
        let planned = worker(&shared.work)(&body)?;
        Ok((json_header(), [(SERVER_TIMING, planned.server_timing)], planned.body).into_response())
    };
    tokio::task::spawn_blocking(work).await.unwrap_or_else(|_| {
        tracing::error!("a plan panicked; the service continues");
        Err(Fault::internal())
    })
}

const STOPPING: &str = "the service is stopping";

fn unavailable(why: &str) -> Fault {
    Fault::new(StatusCode::SERVICE_UNAVAILABLE, why)
}

/// Whether the service accepts requests. The model is loaded before it listens, so only a stopping service is not
/// ready.
pub(super) async fn readyz(State(shared): State<Arc<Shared>>) -> Result<&'static str, Fault> {
    if shared.stopping.load(Ordering::Relaxed) { Err(unavailable(STOPPING)) } else { Ok("ready") }
}
