//! Limits on connections: on their number, and on the silence of each.
//!
//! `axum::serve` has no time limit for a request's header. Therefore the stream has its own: between requests,
//! including the header, it fails after `silence_max`; during a request the request's own limit applies. After an early
//! error answer the stream continues to read for a moment: closing with unread bytes makes the system send a reset, and
//! the client would lose the answer.

use std::io::{self, IoSlice};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep, sleep};

/// How long a connection is still read after an error answer, so that the client receives it.
const LINGER: Duration = Duration::from_secs(1);

/// State shared by a connection and its requests.
#[derive(Debug, Clone, Default)]
pub(super) struct Traffic(Arc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    under_way: AtomicUsize,
    answered: AtomicU64,
    linger: AtomicBool,
}

impl Traffic {
    /// The header of a request has been read.
    pub(super) fn began(&self) {
        self.0.under_way.fetch_add(1, Ordering::AcqRel);
    }

    /// A request is answered or abandoned.
    pub(super) fn ended(&self) {
        self.0.answered.fetch_add(1, Ordering::AcqRel);
        self.0.under_way.fetch_sub(1, Ordering::AcqRel);
    }

    /// Whether the last answer may have been sent before the request was completely read.
    pub(super) fn set_linger(&self, linger: bool) {
        self.0.linger.store(linger, Ordering::Release);
    }
}

impl Connected<IncomingStream<'_, Gate>> for Traffic {
    fn connect_info(stream: IncomingStream<'_, Gate>) -> Self {
        stream.io().traffic.clone()
    }
}

/// A listener with a limited number of connections; further ones wait in the system's queue.
#[derive(Debug)]
pub(super) struct Gate {
    listener: TcpListener,
    places: Arc<Semaphore>,
    silence_max: Duration,
}

impl Gate {
    pub(super) fn new(listener: TcpListener, connections_max: usize, silence_max: Duration) -> Self {
        Self { listener, places: Arc::new(Semaphore::new(connections_max)), silence_max }
    }
}

impl Listener for Gate {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        // The semaphore is never closed, so a slot always becomes free.
        let place = Arc::clone(&self.places).acquire_owned().await.ok();
        let (stream, address) = Listener::accept(&mut self.listener).await;
        // Without no-delay, small answers may wait 40 ms; a failure to set it is no reason to refuse the connection.
        let _ = stream.set_nodelay(true);
        (Connection::new(stream, place, self.silence_max), address)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A stream with time limits.
#[derive(Debug)]
pub(super) struct Connection {
    stream: TcpStream,
    traffic: Traffic,
    silence_max: Duration,
    /// Deadline of the next header; later, the end of lingering.
    deadline: Pin<Box<Sleep>>,
    /// Number of answered requests when `deadline` was set.
    deadline_set_at: u64,
    /// Deadline for the client to read more of the answer.
    write_deadline: Option<Pin<Box<Sleep>>>,
    closing: bool,
    _place: Option<OwnedSemaphorePermit>,
}

impl Connection {
    fn new(stream: TcpStream, place: Option<OwnedSemaphorePermit>, silence_max: Duration) -> Self {
        Self {
            stream,
            traffic: Traffic::default(),
            silence_max,
            deadline: Box::pin(sleep(silence_max)),
            deadline_set_at: 0,
            write_deadline: None,
            closing: false,
            _place: place,
        }
    }

    /// Whether the client has been silent for too long.
    fn is_overdue(&mut self, context: &mut Context<'_>) -> bool {
        if self.traffic.0.under_way.load(Ordering::Acquire) > 0 {
            return false;
        }
        let answered = self.traffic.0.answered.load(Ordering::Acquire);
        if answered != self.deadline_set_at {
            self.deadline_set_at = answered;
            self.deadline.as_mut().reset(Instant::now() + self.silence_max);
        }
        self.deadline.as_mut().poll(context).is_ready()
    }

    /// `polled`, or an error if the client reads nothing for too long.
    fn in_time<T>(&mut self, polled: Poll<io::Result<T>>, context: &mut Context<'_>) -> Poll<io::Result<T>> {
        if polled.is_ready() {
            self.write_deadline = None;
            return polled;
        }
        let silence_max = self.silence_max;
        let deadline = self.write_deadline.get_or_insert_with(|| Box::pin(sleep(silence_max)));
        ready!(deadline.as_mut().poll(context));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }

    /// Reads and discards until the client closes, too, or [`LINGER`] is over.
    fn poll_linger(&mut self, context: &mut Context<'_>) -> Poll<()> {
        let mut forgotten = [0_u8; 4096];
        loop {
            if self.deadline.as_mut().poll(context).is_ready() {
                return Poll::Ready(());
            }
            let mut buffer = ReadBuf::new(&mut forgotten);
            match ready!(Pin::new(&mut self.stream).poll_read(context, &mut buffer)) {
                Ok(()) if !buffer.filled().is_empty() => {}
                _ => return Poll::Ready(()),
            }
        }
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.is_overdue(context) {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.in_time(polled, context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        pieces: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write_vectored(context, pieces);
        self.in_time(polled, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        if !self.closing {
            ready!(Pin::new(&mut self.stream).poll_shutdown(context))?;
            self.closing = true;
            self.deadline.as_mut().reset(Instant::now() + LINGER);
        }
        if self.traffic.0.linger.load(Ordering::Acquire) {
            ready!(self.poll_linger(context));
        }
        Poll::Ready(Ok(()))
    }
}
