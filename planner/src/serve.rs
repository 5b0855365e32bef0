//! The planner over HTTP, for robot stacks without Rust: `POST /v1/plan` takes the input of `planner plan` and returns
//! its output.
//!
//! No client may stop or exhaust the service: bodies, waiting requests, connections and times are limited, and a panic
//! costs one answer. The service has neither TLS nor authentication and belongs on loopback.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::{ConnectInfo, DefaultBodyLimit, Request, State};
use axum::http::StatusCode;
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;
use axum::routing::{get, post};
use program::{Exit, ExitCode};
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, oneshot};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

use self::connection::{Gate, Traffic};
use self::fault::Fault;
use self::metrics::Metrics;
use self::planning::Planned;
use crate::Planner;

mod connection;
mod fault;
mod handlers;
mod host;
mod metrics;
mod model;
mod openapi;
mod options;
mod planning;
#[cfg(test)]
mod tests;

pub use self::options::ServeOptions;

/// Maximum number of open connections; further ones wait in the system's queue.
const CONNECTIONS_MAX: usize = 256;
/// Maximum silence of a connection between requests, and maximum time for a request's header.
const SILENCE_MAX: Duration = Duration::from_secs(10);
/// Interval at which the service checks whether it should stop.
const GLANCE: Duration = Duration::from_millis(100);
/// Time beyond the limit of a request that a stopping service gives clients to read their answers.
const FAREWELL: Duration = Duration::from_secs(2);

/// Why the service failed.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address is in use, or does not belong to this machine.
    #[error("failed to listen: {source}: {address}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The threads cannot be started.
    #[error("failed to start the service's threads: {source}")]
    Threads {
        /// What the system said.
        source: io::Error,
    },
    /// The loop that accepts connections ended.
    #[error("the service ended without a stop signal")]
    Ended,
}

impl Exit for ServeError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Listen { source, .. } if source.kind() != io::ErrorKind::AddrInUse => ExitCode::Config,
            Self::Listen { .. } | Self::Threads { .. } => ExitCode::TryAgain,
            Self::Ended => ExitCode::Internal,
        }
    }
}

type PlanBytes = dyn Fn(&[u8]) -> Result<Planned, Fault> + Send + Sync;

/// State shared by the handlers.
struct Shared {
    plan: Box<PlanBytes>,
    model_json: String,
    options: ServeOptions,
    metrics: Metrics,
    stopping: AtomicBool,
    /// Plans in progress and waiting.
    places: Arc<Semaphore>,
    /// Plans in progress.
    turns: Arc<Semaphore>,
}

impl Shared {
    fn new(plan: Box<PlanBytes>, model_json: String, options: &ServeOptions) -> Arc<Self> {
        let turns = options.concurrent_max.clamp(1, 1 << 16);
        Arc::new(Self {
            plan,
            model_json,
            options: options.clone(),
            metrics: Metrics::new(),
            stopping: AtomicBool::new(false),
            places: Arc::new(Semaphore::new(turns + options.queue_max.min(1 << 16))),
            turns: Arc::new(Semaphore::new(turns)),
        })
    }

    fn plan_and_count(&self, body: &[u8]) -> Result<Planned, Fault> {
        let started = Instant::now();
        let planned = (self.plan)(body)?;
        self.metrics.planned(started.elapsed().as_secs_f64(), planned.grasp_count);
        Ok(planned)
    }

    fn turned_away(&self) -> Fault {
        self.metrics.rejected.inc();
        Fault::new(StatusCode::SERVICE_UNAVAILABLE, "too many plans are waiting")
    }
}

/// Serves until `stop` is set; then finishes the requests in progress and returns. `on_listening` receives the address.
///
/// # Errors
/// [`ServeError`], before it listens.
pub fn serve(
    planner: Planner,
    options: &ServeOptions,
    stop: &AtomicBool,
    on_listening: &dyn Fn(SocketAddr),
) -> Result<(), ServeError> {
    // Strings and finite numbers always serialize.
    let model_json = serde_json::to_string(&model::ModelAnswer::new(&planner)).unwrap_or_default();
    let plan = Box::new(move |body: &[u8]| planning::plan_bytes(&planner, body));
    serve_shared(&Shared::new(plan, model_json, options), SILENCE_MAX, stop, on_listening)
}

fn routes(shared: &Arc<Shared>) -> Router {
    let options = &shared.options;
    Router::new()
        .route("/v1/plan", post(handlers::plan))
        .route("/v1/model", get(handlers::model))
        .route("/healthz", get(handlers::healthz))
        .route("/readyz", get(handlers::readyz))
        .route("/metrics", get(handlers::metrics))
        .route("/openapi.json", get(openapi::openapi))
        // From the inside out. axum's own limit of 2 MB is off; the limit of the next layer applies.
        .layer(DefaultBodyLimit::disable())
        .layer(RequestBodyLimitLayer::new(options.body_bytes_max))
        .layer(TimeoutLayer::with_status_code(StatusCode::GATEWAY_TIMEOUT, options.request_timeout))
        .layer(CatchPanicLayer::custom(fault::of_panic))
        .layer(from_fn_with_state(Arc::clone(shared), host::must_be_known))
        .layer(from_fn_with_state(Arc::clone(shared), observe))
        .with_state(Arc::clone(shared))
}

/// Wraps every request: counts it, logs it, and converts errors to JSON.
async fn observe(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let started = Instant::now();
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let traffic = request.extensions().get::<ConnectInfo<Traffic>>().map(|ConnectInfo(traffic)| traffic.clone());
    let _under_way = UnderWay::new(Arc::clone(&shared), traffic.clone());
    let response = fault::as_json(next.run(request).await, &shared.options);
    let status = response.status();
    if let Some(traffic) = traffic {
        traffic.set_linger(!status.is_success());
    }
    shared.metrics.answered(&path, status);
    let ms = started.elapsed().as_secs_f64() * 1e3;
    tracing::info!(method = cut(method.as_str()), path = cut(&path), status = status.as_u16(), ms, "answered");
    response
}

/// The beginning of a possibly long text, for the log.
fn cut(text: &str) -> &str {
    &text[..text.floor_char_boundary(100)]
}

/// Counts a request while it exists, even if its client disconnects before the answer.
struct UnderWay {
    shared: Arc<Shared>,
    traffic: Option<Traffic>,
}

impl UnderWay {
    fn new(shared: Arc<Shared>, traffic: Option<Traffic>) -> Self {
        shared.metrics.in_flight.inc();
        if let Some(traffic) = &traffic {
            traffic.began();
        }
        Self { shared, traffic }
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.shared.metrics.in_flight.dec();
        if let Some(traffic) = &self.traffic {
            traffic.ended();
        }
    }
}

fn serve_shared(
    shared: &Arc<Shared>,
    silence_max: Duration,
    stop: &AtomicBool,
    on_listening: &dyn Fn(SocketAddr),
) -> Result<(), ServeError> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name("serve")
        .enable_all()
        .build()
        .map_err(|source| ServeError::Threads { source })?;
    let ended = runtime.block_on(listen(shared, silence_max, stop, on_listening));
    // Plans that outlive their request are not awaited.
    runtime.shutdown_background();
    ended
}

async fn listen(
    shared: &Arc<Shared>,
    silence_max: Duration,
    stop: &AtomicBool,
    on_listening: &dyn Fn(SocketAddr),
) -> Result<(), ServeError> {
    let options = &shared.options;
    let refused = |source| ServeError::Listen { address: options.address, source };
    let listener = TcpListener::bind(options.address).await.map_err(refused)?;
    on_listening(listener.local_addr().map_err(refused)?);
    let (stop_server, stopped) = oneshot::channel::<()>();
    let service = routes(shared).into_make_service_with_connect_info::<Traffic>();
    let server = axum::serve(Gate::new(listener, CONNECTIONS_MAX, silence_max), service)
        // An error means that the receiver is gone, which has the same effect.
        .with_graceful_shutdown(async move { stopped.await.unwrap_or_default() });
    let mut server = tokio::spawn(server.into_future());
    while !stop.load(Ordering::Relaxed) {
        if server.is_finished() {
            return Err(ServeError::Ended);
        }
        tokio::time::sleep(GLANCE).await;
    }
    shared.stopping.store(true, Ordering::Relaxed);
    // The receiver is gone if the server has just ended by itself, which needs no action.
    let _ = stop_server.send(());
    let patience = options.request_timeout.saturating_add(FAREWELL);
    if tokio::time::timeout(patience, &mut server).await.is_err() {
        tracing::warn!("some clients did not read their answers in time");
    }
    Ok(())
}
