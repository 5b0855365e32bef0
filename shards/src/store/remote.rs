//! Object stores and web servers: the only network client of the workspace. Asynchronous inside, blocking calls
//! outside.
//!
//! Every operation has a time limit: 5 s for connecting, 20 s for silence while reading, 40 s for an answer (three
//! times). A reader's request is retried up to 24 times within 60 s, a writer's within 30 s, and files must transfer at
//! 50 kB/s or more. Files are downloaded in pieces to a scratch file and uploaded in one piece, so that an object is
//! complete or absent.

mod connect;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::future::Future;
use std::io::{self, Seek, Write};
use std::sync::Arc;
use std::time::Duration;

use futures_util::{Stream, StreamExt};
use object_store::path::Path;
use object_store::{Error, GetResult, ObjectMeta, ObjectStore, ObjectStoreExt, PutMode, PutPayload};
use program::Failure;
use sha2::{Digest, Sha256};
use tokio::runtime::{Builder, Runtime};
use url::Url;

use crate::store::error::failed;
use crate::store::fault::Fault;
use crate::store::{Listing, META_BYTES_MAX};
use crate::{Location, SHARDS_MAX};
pub(crate) use connect::Patience;
use connect::{connect, explain, is_absent, is_refused, is_unreachable, too_large};

/// Time limit of any request, and minimum transfer rate of a file.
const REQUEST: Duration = Duration::from_secs(120);
const BYTES_PER_S_MIN: u64 = 50_000;
/// Maximum size of a fetched file.
const FETCH_BYTES_MAX: u64 = 8 << 30;
/// Maximum size of an uploaded object. Stores accept 5 GB in one piece.
pub(crate) const OBJECT_BYTES_MAX: u64 = 4 << 30;
/// Time limit of an answer before a retry, the number of tries, and the limit for a listing of a whole dataset.
const ANSWER: Duration = Duration::from_secs(40);
const ASKS_MAX: u32 = 3;
const LISTING: Duration = Duration::from_secs(300);
/// Most objects in a listing, more than a dataset has. A store that invents names or repeats itself would never end.
const LISTED_MAX: usize = 5 * SHARDS_MAX as usize;
/// Number of uploads of an object if the answer is lost or the store is busy, and the pause between them.
const PUTS_MAX: u32 = 3;
const PUT_PAUSE: Duration = Duration::from_millis(250);
/// How long to wait for another writer that uploads the same object.
const CONFLICT: Duration = Duration::from_secs(30);
/// Number of concurrent requests for small files.
const READS_AT_ONCE: usize = 64;
/// Threads for network transfers.
const NETWORK_THREADS: usize = 2;

/// A dataset's location in an object store.
pub(crate) struct Remote {
    url: Url,
    prefix: Path,
    store: Arc<dyn ObjectStore>,
    /// Whether the store supports listing; web servers do not.
    lists: bool,
    runtime: Runtime,
    fault: Fault,
}

impl std::fmt::Debug for Remote {
    /// Omits the store, which contains credentials.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Remote({})", self.url)
    }
}

/// A file that was fetched, complete and rewound, and its SHA-256 in hex; or the size that it has instead, `None` if
/// there is none.
pub(crate) type Fetched = Result<(File, String), Option<u64>>;

impl Remote {
    /// Prepares a connection without any request.
    pub(crate) fn open(url: &Url, patience: Patience) -> Result<Self, Failure> {
        let failed = |source| failed("use the object store", place(url))(source);
        // There was no request yet, so any error is permanent.
        let wrong = |e| failed(io::Error::new(io::ErrorKind::InvalidInput, explain(&e).to_string()));
        let (store, lists, prefix) = connect(url, patience).map_err(wrong)?;
        if patience == Patience::Writer && !lists {
            let text = "a web server takes no datasets: give a folder or an s3://, gs:// or az:// URL";
            return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, text)));
        }
        Self::new(url, store, lists, prefix)
    }

    /// Reads from this store.
    pub(crate) fn new(url: &Url, store: Arc<dyn ObjectStore>, lists: bool, prefix: Path) -> Result<Self, Failure> {
        let runtime = Builder::new_multi_thread().worker_threads(NETWORK_THREADS).enable_all().build();
        let runtime = runtime.map_err(failed("start threads for", place(url)))?;
        Ok(Self { url: url.clone(), prefix, store, lists, runtime, fault: Fault::default() })
    }

    #[cfg(test)]
    fn with_fault(self, fault: Fault) -> Self {
        Self { fault, ..self }
    }

    pub(crate) fn location(&self, name: &str) -> Location {
        if name.is_empty() { place(&self.url) } else { place(&self.url).join(name) }
    }

    /// The bytes of a small file, `None` if there is none.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, Failure> {
        self.runtime.block_on(self.small(name))
    }

    /// Reads small files concurrently and passes each on, in order.
    pub(crate) fn read_each(
        &self,
        names: impl Iterator<Item = String>,
        mut take: impl FnMut(Option<Vec<u8>>),
    ) -> Result<(), Failure> {
        let read = |name: String| async move { self.small(&name).await };
        self.runtime.block_on(async {
            let mut files = futures_util::stream::iter(names).map(read).buffered(READS_AT_ONCE);
            while let Some(file) = files.next().await {
                take(file?);
            }
            Ok(())
        })
    }

    async fn small(&self, name: &str) -> Result<Option<Vec<u8>>, Failure> {
        let read = async {
            let Some(found) = self.get(name).await? else { return Ok(None) };
            let bytes = found.meta.size;
            if bytes > META_BYTES_MAX {
                return Err(too_large(bytes, META_BYTES_MAX));
            }
            let body = async { found.bytes().await.map_err(|e| explain(&e)) };
            Ok(Some(within(time_for(bytes), body).await?.to_vec()))
        };
        read.await.map_err(failed("read a file", self.location(name)))
    }

    async fn get(&self, name: &str) -> io::Result<Option<GetResult>> {
        let path = self.path(name);
        answer(|| self.store.get(&path)).await
    }

    /// The size of a file in bytes, `None` if there is none.
    pub(crate) fn size(&self, name: &str) -> Result<Option<u64>, Failure> {
        self.runtime.block_on(self.head(name)).map_err(failed("look at a file", self.location(name)))
    }

    async fn head(&self, name: &str) -> io::Result<Option<u64>> {
        let path = self.path(name);
        Ok(answer(|| self.store.head(&path)).await?.map(|meta| meta.size))
    }

    /// The listing of a folder; `None` if listing is not supported.
    pub(crate) fn list(&self, folder: &str) -> Result<Option<Listing>, Failure> {
        if !self.lists {
            return Ok(None);
        }
        let path = if folder.is_empty() { self.prefix.clone() } else { self.path(folder) };
        let listed = self.runtime.block_on(within(LISTING, listed(self.store.list(Some(&path)), &path)));
        listed.map_err(failed("list a folder", self.location(folder)))
    }

    /// Fetches a file with an expected size.
    pub(crate) fn fetch(&self, name: &str, bytes: u64) -> Result<Fetched, Failure> {
        let at_store = failed("fetch a file", self.location(name));
        let scratch = || failed("keep a fetched file among temporary files", Location::Path(std::env::temp_dir()));
        if bytes > FETCH_BYTES_MAX {
            return Err(at_store(too_large(bytes, FETCH_BYTES_MAX)));
        }
        let mut file = tempfile::tempfile().map_err(scratch())?;
        let mut hash = Sha256::new();
        let fetch = async {
            let Some(found) = self.get(name).await? else { return Ok(Ok(Err(None))) };
            if found.meta.size != bytes {
                return Ok(Ok(Err(Some(found.meta.size))));
            }
            let (mut pieces, mut got) = (found.into_stream(), 0);
            while let Some(piece) = pieces.next().await {
                let piece = piece.map_err(|e| explain(&e))?;
                got += piece.len() as u64;
                hash.update(&piece);
                if let Err(e) = file.write_all(&piece) {
                    return Ok(Err(e)); // an error of the disk, not of the store
                }
            }
            if got != bytes {
                return Ok(Ok(Err(Some(got))));
            }
            let sha256 = crate::format::seal::hex(&hash.finalize());
            Ok(file.rewind().map(|()| Ok((file, sha256))))
        };
        self.runtime.block_on(within(time_for(bytes), fetch)).map_err(at_store)?.map_err(scratch())
    }

    /// Uploads an object and replaces an existing one.
    pub(crate) fn put(&self, name: &str, bytes: Vec<u8>) -> Result<(), Failure> {
        let put = self.put_again(name, bytes.into(), PutMode::Overwrite);
        self.runtime.block_on(put).map(drop).map_err(failed("write a file", self.location(name)))
    }

    /// Uploads an object unless it exists; returns whether it did.
    pub(crate) fn put_new(&self, name: &str, bytes: Vec<u8>) -> Result<bool, Failure> {
        let put = self.put_again(name, bytes.into(), PutMode::Create);
        self.runtime.block_on(put).map_err(failed("publish a file", self.location(name)))
    }

    /// Uploads an object, with retries if the answer is lost or the store is busy. Afterwards the object exists.
    /// Returns whether it was uploaded and did not exist before.
    async fn put_again(&self, name: &str, payload: PutPayload, mode: PutMode) -> io::Result<bool> {
        let limit = time_for(payload.content_length() as u64);
        let (mut puts, mut pause, mut waited) = (1, PUT_PAUSE, Duration::ZERO);
        loop {
            let error = match tokio::time::timeout(limit, self.put_once(name, payload.clone(), mode.clone())).await {
                Ok(Ok(())) => return Ok(true),
                // Some stores also answer this while another writer uploads the object, which may still fail.
                Ok(Err(error @ Error::AlreadyExists { .. })) => match self.head(name).await? {
                    Some(_) if mode == PutMode::Create => return Ok(false),
                    _ if waited < CONFLICT => {
                        tokio::time::sleep(pause).await;
                        (waited, pause) = (waited + pause, 2 * pause);
                        continue;
                    }
                    _ => explain(&error),
                },
                // Nobody was there for as long as the client tries, which was long.
                Ok(Err(error)) if is_unreachable(&error) => return Err(explain(&error)),
                Ok(Err(error)) => explain(&error),
                Err(_) => late(limit),
            };
            if puts >= PUTS_MAX || matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::PermissionDenied)
            {
                return Err(error);
            }
            puts += 1;
            tokio::time::sleep(PUT_PAUSE).await;
        }
    }

    async fn put_once(&self, name: &str, payload: PutPayload, mode: PutMode) -> Result<(), Error> {
        let planned = |e: io::Error| Error::Generic { store: "test", source: Box::new(e) };
        self.fault.check().map_err(planned)?;
        self.store.put_opts(&self.path(name), payload, mode.into()).await?;
        self.fault.check_answer().map_err(planned)
    }

    fn path(&self, name: &str) -> Path {
        name.split('/').fold(self.prefix.clone(), |path, part| path.join(part))
    }
}

fn place(url: &Url) -> Location {
    Location::Url(Box::new(url.clone()))
}

/// The time limit for transferring a number of bytes.
fn time_for(bytes: u64) -> Duration {
    REQUEST + Duration::from_secs(bytes / BYTES_PER_S_MIN)
}

/// Waits with a time limit.
async fn within<T>(limit: Duration, work: impl Future<Output = io::Result<T>>) -> io::Result<T> {
    tokio::time::timeout(limit, work).await.map_err(|_| late(limit))?
}

/// Names and sizes of the files in a folder, and its folders, from all objects below it; `None` if the store refuses to
/// list.
async fn listed(
    mut objects: impl Stream<Item = Result<ObjectMeta, Error>> + Unpin,
    folder: &Path,
) -> io::Result<Option<Listing>> {
    let mut listing = Listing::new();
    for _ in 0..=LISTED_MAX {
        let object = match objects.next().await {
            None => return Ok(Some(listing)),
            Some(Err(error)) if is_refused(&error) || matches!(error, Error::NotImplemented { .. }) => return Ok(None),
            Some(object) => object.map_err(|e| explain(&e))?,
        };
        let mut parts = object.location.prefix_match(folder).into_iter().flatten();
        if let Some(name) = parts.next() {
            listing.insert(name.as_ref().to_owned(), parts.next().is_none().then_some(object.size));
        }
    }
    let text = format!("the store's listing repeats itself, or has more than {LISTED_MAX} names");
    Err(io::Error::new(io::ErrorKind::InvalidInput, text))
}

/// The answer to a request about an object, `None` if there is none; asked again where no answer comes.
async fn answer<T, F: Future<Output = Result<T, Error>>>(ask: impl Fn() -> F) -> io::Result<Option<T>> {
    for _ in 0..ASKS_MAX {
        match tokio::time::timeout(ANSWER, ask()).await {
            Ok(Err(error)) if is_absent(&error) => return Ok(None),
            Ok(found) => return found.map(Some).map_err(|e| explain(&e)),
            Err(_) => {}
        }
    }
    Err(late(ANSWER))
}

fn late(limit: Duration) -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, format!("not done after {} s", limit.as_secs()))
}
