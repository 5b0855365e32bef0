//! One TCP connection between rank 0 and another: frames of a length and so many bytes, and limits to every wait.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// Longest frame: a checkpoint with moments (4 MB) and a run's metrics fit many times.
const FRAME_MAX: u64 = 1 << 28;
/// Between two looks for who is not there yet.
const PAUSE: Duration = Duration::from_millis(20);

/// A connection.
#[derive(Debug)]
pub(super) struct Link {
    stream: TcpStream,
}

impl Link {
    fn new(stream: TcpStream, timeout: Duration) -> io::Result<Self> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        let link = Self { stream };
        link.set_timeout(timeout)?;
        Ok(link)
    }

    /// Changes the longest wait for the other side.
    pub(super) fn set_timeout(&self, timeout: Duration) -> io::Result<()> {
        self.stream.set_read_timeout(Some(timeout))?;
        self.stream.set_write_timeout(Some(timeout))
    }

    /// The next connection to a listener before a deadline; `None` after it.
    pub(super) fn accept(listener: &TcpListener, deadline: Instant, timeout: Duration) -> io::Result<Option<Self>> {
        listener.set_nonblocking(true)?;
        loop {
            match listener.accept() {
                Ok((stream, _)) => return Self::new(stream, timeout).map(Some),
                Err(e) if e.kind() == io::ErrorKind::WouldBlock && Instant::now() < deadline => {
                    std::thread::sleep(PAUSE);
                }
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(e) => return Err(e),
            }
        }
    }

    /// A connection to an address where somebody may only begin to listen.
    pub(super) fn connect(address: &str, timeout: Duration) -> io::Result<Self> {
        let deadline = Instant::now() + timeout;
        loop {
            let attempt = address.to_socket_addrs().and_then(|mut found| {
                let nowhere = || io::Error::new(io::ErrorKind::NotFound, "the name has no address");
                TcpStream::connect_timeout(&found.next().ok_or_else(nowhere)?, timeout)
            });
            match attempt {
                Ok(stream) => return Self::new(stream, timeout),
                Err(e) if Instant::now() >= deadline => return Err(e),
                Err(_) => std::thread::sleep(PAUSE),
            }
        }
    }

    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let length = (bytes.len() as u64).to_le_bytes();
        self.stream.write_all(&length).and_then(|()| self.stream.write_all(bytes)).map_err(plainly)
    }

    pub(super) fn receive(&mut self) -> io::Result<Vec<u8>> {
        let mut length = [0; 8];
        self.stream.read_exact(&mut length).map_err(plainly)?;
        let length = u64::from_le_bytes(length);
        if length > FRAME_MAX {
            return Err(io::Error::new(io::ErrorKind::InvalidData, format!("a frame of {length} bytes")));
        }
        let mut bytes = vec![0; length as usize];
        self.stream.read_exact(&mut bytes).map_err(plainly)?;
        Ok(bytes)
    }
}

/// What happened to the other side, in its own words.
fn plainly(error: io::Error) -> io::Error {
    let text = match error.kind() {
        io::ErrorKind::UnexpectedEof | io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe => {
            "it closed the connection"
        }
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => "it took too long",
        _ => return error,
    };
    io::Error::new(error.kind(), text)
}
