//! One TCP connection between rank 0 and another: frames of a length and so many bytes, and limits to every wait.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Longest frame: a checkpoint with moments (4 MB) and a run's metrics fit many times.
const FRAME_MAX: u64 = 1 << 28;
/// Between two looks for who is not there yet.
const PAUSE: Duration = Duration::from_millis(20);

/// A connection.
#[derive(Debug)]
pub(super) struct Link {
    stream: TcpStream,
}

/// Longest single attempt to connect; there are more of them until the deadline.
const CONNECT_WAIT: Duration = Duration::from_secs(5);

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

    /// The connection that waits at a listener; after a pause `None`, if there is none.
    pub(super) fn accept(listener: &TcpListener, timeout: Duration) -> io::Result<Option<Self>> {
        listener.set_nonblocking(true)?;
        match listener.accept() {
            Ok((stream, _)) => Self::new(stream, timeout).map(Some),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => {
                std::thread::sleep(PAUSE);
                Ok(None)
            }
            Err(e) => Err(e),
        }
    }

    /// A connection to an address where somebody may only begin to listen: one attempt, and a pause if it fails.
    pub(super) fn connect(address: &str, timeout: Duration) -> io::Result<Self> {
        let nowhere = || io::Error::new(io::ErrorKind::NotFound, "the name has no address");
        let mut stream = Err(nowhere());
        for at in address.to_socket_addrs()? {
            stream = TcpStream::connect_timeout(&at, timeout.min(CONNECT_WAIT));
            if stream.is_ok() {
                break;
            }
        }
        if stream.is_err() {
            std::thread::sleep(PAUSE);
        }
        Self::new(stream?, timeout)
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
