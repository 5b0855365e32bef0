//! One connection: how long its client may be silent, and how it ends.
//!
//! axum has no limit for the time of a request's header, nor for that in which an answer is read. Here one rule limits
//! both: when no request is under way, the header of the next one must be complete within `silence_max`. (During a
//! request the request's own limit applies.) After the last answer the connection is read for another moment: closing
//! with unread bytes makes the system send a reset, and the client would lose the answer. A client that closes its half
//! of the connection after its request still reads the answer, so it is planned for.

use std::pin::{Pin, pin};
use std::time::Duration;

use axum::Router;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use tokio::io::{copy, sink};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::timeout;

/// How long a connection is still read after its last answer, so that the client receives it.
const LINGER: Duration = Duration::from_secs(1);

/// Answers a client until it leaves or is silent for too long; once the sender of `stopped` is gone, until the request
/// under way is answered.
pub(super) async fn converse(
    stream: TcpStream,
    routes: Router,
    silence_max: Duration,
    mut stopped: watch::Receiver<()>,
) {
    // Without no-delay, small answers may wait 40 ms; a failure to set it is no reason to refuse the connection.
    let _ = stream.set_nodelay(true);
    let (busy, mut is_busy) = watch::channel(false);
    let (busy, routes) = (&busy, &TowerToHyperService::new(routes));
    let answer = service_fn(move |request: Request<Incoming>| async move {
        busy.send_replace(true);
        let answer = routes.call(request).await;
        busy.send_replace(false);
        answer
    });
    let mut connection = http1::Builder::new().half_close(true).serve_connection(TokioIo::new(stream), answer);
    let mut silence = pin!(async {
        while is_busy.wait_for(|busy| !busy).await.is_ok() && timeout(silence_max, is_busy.changed()).await.is_ok() {}
    });
    let mut is_stopping = false;
    loop {
        tokio::select! {
            _ = &mut connection => break,
            () = &mut silence => return,
            _ = stopped.changed(), if !is_stopping => is_stopping = true,
        }
        Pin::new(&mut connection).graceful_shutdown();
    }
    let mut stream = connection.into_parts().io.into_inner();
    // The client may have gone, or may not go in time; both end the connection.
    let _ = timeout(LINGER, copy(&mut stream, &mut sink())).await;
}
