//! The planner over HTTP, for robot stacks without Rust: `POST /v1/plan` takes the input of `graspmill plan` and
//! returns its output; `POST /predict` takes an object's cloud and answers as other grasp servers do.
//!
//! No client may stop or exhaust the service: bodies, waiting requests, connections and times are limited, and a panic
//! costs one answer. The service has neither TLS nor authentication and belongs on loopback.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::StatusCode;
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;
use axum::routing::{get, post};
use axum::serve::Listener;
use axum::{Json, Router};
use program::{Context as _, ExitCode, Failure};
use serde_json::Value;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio::time::timeout;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

use self::connection::converse;
use self::fault::Fault;
use self::planning::Planned;
use crate::Planner;
use crate::timing::ms_since;

mod connection;
mod fault;
mod handlers;
mod host;
mod model;
mod options;
mod planning;
mod predict;
#[cfg(test)]
mod tests;

pub use self::options::{GraspFrame, ServeOptions};

/// Maximum number of open connections; further ones wait in the system's queue.
const CONNECTIONS_MAX: u32 = 256;
/// Interval at which the service checks whether it should stop.
const GLANCE: Duration = Duration::from_millis(100);
/// Time beyond the limit of a request that a stopping service gives clients to read their answers.
const FAREWELL: Duration = Duration::from_secs(2);

type PlanBytes = dyn Fn(&[u8]) -> Result<Planned, Fault> + Send + Sync;

/// What the planner answers.
struct Work {
    /// Bodies of `/v1/plan`.
    plan: Box<PlanBytes>,
    /// Bodies of `/predict`.
    predict: Box<PlanBytes>,
    /// Bodies of `/v1/model` and `/config`.
    model: Value,
    config: Value,
}

/// State shared by the handlers.
struct Shared {
    work: Work,
    options: ServeOptions,
    stopping: AtomicBool,
    /// Plans in progress and waiting.
    places: Arc<Semaphore>,
    /// Plans in progress.
    turns: Arc<Semaphore>,
}

impl Shared {
    fn new(work: Work, options: &ServeOptions) -> Arc<Self> {
        let turns = usize::from(options.concurrent);
        Arc::new(Self {
            work,
            options: options.clone(),
            stopping: AtomicBool::new(false),
            places: Arc::new(Semaphore::new(turns + usize::from(options.queue))),
            turns: Arc::new(Semaphore::new(turns)),
        })
    }
}

/// Serves until `stop` is set; then finishes the requests in progress and returns. `on_listening` receives the address.
///
/// # Errors
/// If it cannot listen.
pub fn serve(
    planner: Planner,
    options: &ServeOptions,
    stop: &AtomicBool,
    on_listening: &dyn Fn(SocketAddr),
) -> Result<(), Failure> {
    let (model, config) = (model::answer(&planner), predict::config(&planner, options.grasp_frame));
    let planner = Arc::new(planner);
    let (same, frame) = (Arc::clone(&planner), options.grasp_frame);
    let work = Work {
        plan: Box::new(move |body| planning::plan_bytes(&planner, body)),
        predict: Box::new(move |body| predict::predict_bytes(&same, frame, body)),
        model,
        config,
    };
    serve_shared(&Shared::new(work, options), stop, on_listening)
}

fn routes(shared: &Arc<Shared>) -> Router {
    let Shared { options, work, .. } = &**shared;
    Router::new()
        .route("/v1/plan", post(handlers::plan))
        .route("/v1/model", get(Json(work.model.clone())))
        .route("/predict", post(handlers::predict))
        .route("/config", get(Json(work.config.clone())))
        .route("/version", get(Json(predict::version())))
        .route("/healthz", get("ok"))
        .route("/readyz", get(handlers::readyz))
        // From the inside out. axum's own limit of 2 MB is off; the limit of the next layer applies.
        .layer(DefaultBodyLimit::disable())
        .layer(RequestBodyLimitLayer::new(options.body_bytes_max))
        .layer(TimeoutLayer::with_status_code(StatusCode::GATEWAY_TIMEOUT, options.request_timeout))
        .layer(CatchPanicLayer::new())
        .layer(from_fn_with_state(Arc::clone(shared), host::must_be_known))
        .layer(from_fn_with_state(Arc::clone(shared), observe))
        .with_state(Arc::clone(shared))
}

/// Wraps every request: logs it, and converts errors to JSON.
async fn observe(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let started = Instant::now();
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let response = fault::as_json(next.run(request).await, &shared.options, path == "/predict");
    let status = response.status();
    let ms = ms_since(started);
    tracing::info!(method = cut(method.as_str()), path = cut(&path), status = status.as_u16(), ms, "answered");
    response
}

/// The beginning of a possibly long text, for the log.
fn cut(text: &str) -> &str {
    &text[..text.floor_char_boundary(100)]
}

fn serve_shared(shared: &Arc<Shared>, stop: &AtomicBool, on_listening: &dyn Fn(SocketAddr)) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name("serve")
        .enable_all()
        .build()
        .context("failed to start the service's threads")?;
    let ended = runtime.block_on(listen(shared, stop, on_listening));
    // Plans that outlive their request are not awaited.
    runtime.shutdown_background();
    ended
}

async fn listen(shared: &Arc<Shared>, stop: &AtomicBool, on_listening: &dyn Fn(SocketAddr)) -> Result<(), Failure> {
    let options = &shared.options;
    let ServeOptions { host, port, .. } = options;
    let refused = |error: io::Error| {
        let is_in_use = error.kind() == io::ErrorKind::AddrInUse;
        let code = if is_in_use { ExitCode::TryAgain } else { ExitCode::Config };
        Failure::new(code, format!("failed to listen: {error}: {host}, port {port}"))
    };
    let address = (host.trim_start_matches('[').trim_end_matches(']'), *port);
    let mut listener = TcpListener::bind(address).await.map_err(refused)?;
    on_listening(listener.local_addr().map_err(refused)?);
    let (routes, places) = (routes(shared), Arc::new(Semaphore::new(CONNECTIONS_MAX as usize)));
    let (running, stopped) = watch::channel(());
    while !stop.load(Ordering::Relaxed) {
        let accepted = timeout(GLANCE, async {
            let place = Arc::clone(&places).acquire_owned().await;
            (Listener::accept(&mut listener).await.0, place)
        });
        let Ok((stream, place)) = accepted.await else { continue };
        let conversation = converse(stream, routes.clone(), options.silence_max, stopped.clone());
        tokio::spawn(async move {
            conversation.await;
            drop(place);
        });
    }
    shared.stopping.store(true, Ordering::Relaxed);
    drop((listener, running));
    let patience = options.request_timeout.saturating_add(FAREWELL);
    if timeout(patience, places.acquire_many(CONNECTIONS_MAX)).await.is_err() {
        tracing::warn!("some clients did not read their answers in time");
    }
    Ok(())
}
