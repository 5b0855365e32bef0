//! The only file that talks to a network: object stores, read. Asynchronous inside, plain calls outside.
//!
//! Nothing hangs: connecting takes at most 5 s, a silence 20 s, a request is tried again at most 8 times and not after
//! 60 s, and a file must come at 50 kB/s. Nothing is held: a file goes to a scratch file piece by piece.

use std::collections::BTreeMap;
use std::fs::File;
use std::future::Future;
use std::io::{self, Seek, Write};
use std::sync::Arc;
use std::time::Duration;

use futures_util::StreamExt;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::path::Path;
use object_store::{
    BackoffConfig, ClientConfigKey, ClientOptions, Error, ObjectStore, ObjectStoreExt, ObjectStoreScheme, RetryConfig,
};
use sha2::{Digest, Sha256};
use tokio::runtime::{Builder, Runtime};
use url::{Position, Url};

use crate::Location;
use crate::store::{Listing, META_BYTES_MAX, StoreError};

/// Longest silence of a server, while connecting and after.
const CONNECT: Duration = Duration::from_secs(5);
const SILENCE: Duration = Duration::from_secs(20);
/// Most times that a request is repeated, and until when.
const RETRIES_MAX: usize = 8;
const RETRY_UNTIL: Duration = Duration::from_secs(60);
/// What any request may take, and the slowest that a file may come.
const REQUEST: Duration = Duration::from_secs(120);
const BYTES_PER_S_MIN: u64 = 50_000;
/// Largest file that is fetched.
const FETCH_BYTES_MAX: u64 = 8 << 30;
/// Threads that move bytes between sockets and memory.
const NETWORK_THREADS: usize = 2;

/// A dataset's place in an object store. Writing to one belongs here too, when there is any.
pub(crate) struct Remote {
    url: Url,
    prefix: Path,
    store: Arc<dyn ObjectStore>,
    /// Whether the store tells what lies below a prefix; web servers do not.
    lists: bool,
    runtime: Runtime,
}

impl std::fmt::Debug for Remote {
    /// Without the store, which knows credentials.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Remote({})", self.url)
    }
}

/// What came of fetching a file.
#[derive(Debug)]
pub(crate) enum Fetched {
    /// All of it, at its beginning, and its SHA-256 in hex.
    Whole(File, String),
    /// There is none.
    Missing,
    /// It has another size, this one, and was left there.
    OtherSize(u64),
}

impl Remote {
    /// Gets ready to read; asks nobody yet.
    pub(crate) fn open(url: &Url) -> Result<Self, StoreError> {
        let failed = |source| StoreError { action: "use the object store", at: place(url), source };
        // Nobody was asked yet, so whatever is wrong stays wrong.
        let wrong = |e| failed(io::Error::new(io::ErrorKind::InvalidInput, explain(&e).to_string()));
        let (store, prefix, lists) = connect(url).map_err(wrong)?;
        Self::new(url, store, prefix, lists)
    }

    /// Reads from this store.
    pub(crate) fn new(url: &Url, store: Arc<dyn ObjectStore>, prefix: Path, lists: bool) -> Result<Self, StoreError> {
        let runtime = Builder::new_multi_thread().worker_threads(NETWORK_THREADS).enable_all().build();
        let failed = |source| StoreError { action: "start threads for", at: place(url), source };
        Ok(Self { url: url.clone(), prefix, store, lists, runtime: runtime.map_err(failed)? })
    }

    pub(crate) fn location(&self, name: &str) -> Location {
        place(&self.url).join(name)
    }

    /// The bytes of a small file, `None` if there is none.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let failed = |source| StoreError { action: "read a file", at: self.location(name), source };
        let path = self.path(name);
        let read = async {
            let found = match self.store.get(&path).await {
                Err(error) if is_absent(&error) => return Ok(None),
                found => found.map_err(|e| explain(&e))?,
            };
            if found.meta.size > META_BYTES_MAX {
                return Err(too_large(found.meta.size, META_BYTES_MAX));
            }
            Ok(Some(found.bytes().await.map_err(|e| explain(&e))?.to_vec()))
        };
        self.within(REQUEST, read).map_err(failed)
    }

    /// What lies in a folder; `None` where that cannot be asked.
    pub(crate) fn list(&self, folder: &str) -> Result<Option<Listing>, StoreError> {
        if !self.lists {
            return Ok(None);
        }
        let failed = |source| StoreError { action: "list a folder", at: self.location(folder), source };
        let path = self.path(folder);
        let listed = self.within(REQUEST, async {
            match self.store.list_with_delimiter(Some(&path)).await {
                Err(Error::PermissionDenied { .. } | Error::NotImplemented { .. }) => Ok(None),
                listed => listed.map(Some).map_err(|e| explain(&e)),
            }
        });
        let name = |path: &Path| path.filename().unwrap_or_default().to_owned();
        Ok(listed.map_err(failed)?.map(|listed| {
            // Some tools put an empty object in place of the folder itself.
            let files = listed.objects.iter().filter(|object| object.location != path);
            let files = files.map(|object| (name(&object.location), Some(object.size)));
            let folders = listed.common_prefixes.iter().map(|folder| (name(folder), None));
            files.chain(folders).collect::<BTreeMap<_, _>>()
        }))
    }

    /// Fetches a file that should have this size.
    pub(crate) fn fetch(&self, name: &str, bytes: u64) -> Result<Fetched, StoreError> {
        let failed = |source| StoreError { action: "fetch a file", at: self.location(name), source };
        let scratch = |source| StoreError {
            action: "keep a fetched file among temporary files",
            at: Location::Path(std::env::temp_dir()),
            source,
        };
        if bytes > FETCH_BYTES_MAX {
            return Err(failed(too_large(bytes, FETCH_BYTES_MAX)));
        }
        let mut file = tempfile::tempfile().map_err(scratch)?;
        let (path, mut hash) = (self.path(name), Sha256::new());
        let fetch = async {
            let found = match self.store.get(&path).await {
                Err(error) if is_absent(&error) => return Ok(Ok(Fetched::Missing)),
                found => found.map_err(|e| explain(&e))?,
            };
            if found.meta.size != bytes {
                return Ok(Ok(Fetched::OtherSize(found.meta.size)));
            }
            let (mut pieces, mut got) = (found.into_stream(), 0);
            while let Some(piece) = pieces.next().await {
                let piece = piece.map_err(|e| explain(&e))?;
                got += piece.len() as u64;
                hash.update(&piece);
                if let Err(e) = file.write_all(&piece) {
                    return Ok(Err(e)); // the disk's fault, not the store's
                }
            }
            if got != bytes {
                return Ok(Ok(Fetched::OtherSize(got)));
            }
            let sha256 = crate::seal::hex(&hash.finalize());
            Ok(file.rewind().map(|()| Fetched::Whole(file, sha256)))
        };
        self.within(REQUEST + Duration::from_secs(bytes / BYTES_PER_S_MIN), fetch).map_err(failed)?.map_err(scratch)
    }

    fn path(&self, name: &str) -> Path {
        name.split('/').fold(self.prefix.clone(), |path, part| path.join(part))
    }

    /// Waits for something, but not for ever.
    fn within<T>(&self, limit: Duration, work: impl Future<Output = io::Result<T>>) -> io::Result<T> {
        self.runtime.block_on(async {
            let late = |_| io::Error::new(io::ErrorKind::TimedOut, format!("not done after {} s", limit.as_secs()));
            tokio::time::timeout(limit, work).await.map_err(late)?
        })
    }
}

fn place(url: &Url) -> Location {
    Location::Url(Box::new(url.clone()))
}

/// The store behind a URL, the path in it, and whether it lists. Settings come from the environment.
fn connect(url: &Url) -> Result<(Arc<dyn ObjectStore>, Path, bool), Error> {
    // reqwest is built without a choice of its own; whoever chose before us is welcome.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let (scheme, prefix) = ObjectStoreScheme::parse(url)?;
    let retry = RetryConfig {
        backoff: BackoffConfig { max_backoff: CONNECT, ..BackoffConfig::default() },
        max_retries: RETRIES_MAX,
        retry_timeout: RETRY_UNTIL,
    };
    let store: Arc<dyn ObjectStore> = match scheme {
        ObjectStoreScheme::AmazonS3 => {
            let builder = AmazonS3Builder::from_env().with_url(url.as_str()).with_retry(retry);
            Arc::new(builder.with_client_options(options("AWS_")).build()?)
        }
        ObjectStoreScheme::GoogleCloudStorage => {
            let builder = GoogleCloudStorageBuilder::from_env().with_url(url.as_str()).with_retry(retry);
            Arc::new(builder.with_client_options(options("GOOGLE_")).build()?)
        }
        ObjectStoreScheme::MicrosoftAzure => {
            let builder = MicrosoftAzureBuilder::from_env().with_url(url.as_str()).with_retry(retry);
            Arc::new(builder.with_client_options(options("AZURE_")).build()?)
        }
        _ => {
            let builder = HttpBuilder::new().with_url(&url[..Position::BeforePath]).with_retry(retry);
            let options = options("HTTP_").with_allow_http(url.scheme() == "http");
            return Ok((Arc::new(builder.with_client_options(options).build()?), prefix, false));
        }
    };
    Ok((store, prefix, true))
}

/// How to talk, with what the environment says instead, such as `AWS_ALLOW_HTTP` or `AWS_READ_TIMEOUT`.
fn options(prefix: &str) -> ClientOptions {
    let options = ClientOptions::new()
        .with_connect_timeout(CONNECT)
        .with_read_timeout(SILENCE)
        .with_timeout_disabled()
        .with_user_agent(object_store::HeaderValue::from_static(concat!("graspmill/", env!("CARGO_PKG_VERSION"))));
    let variables = std::env::vars_os().filter_map(|(key, value)| {
        let key = key.to_str()?.strip_prefix(prefix)?.to_ascii_lowercase();
        Some((key.parse::<ClientConfigKey>().ok()?, value.into_string().ok()?))
    });
    variables.fold(options, |options, (key, value)| options.with_config(key, value))
}

/// No such object; a bucket that is not there is another matter.
fn is_absent(error: &Error) -> bool {
    matches!(error, Error::NotFound { .. }) && !error.to_string().contains("NoSuchBucket")
}

fn too_large(bytes: u64, limit: u64) -> io::Error {
    io::Error::new(io::ErrorKind::FileTooLarge, format!("at most {limit} bytes are read at once, got {bytes}"))
}

/// What a store said, whether trying again may help ([`StoreError::exit_code`] looks at the kind), and what to do.
fn explain(error: &Error) -> io::Error {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(inner) = cause {
        if !text.contains(&inner.to_string()) {
            text = format!("{text}: {inner}");
        }
        cause = inner.source();
    }
    let is = |part: &str| text.contains(part);
    let (kind, advice) = if is("169.254.169.254") || is("metadata.google.internal") {
        (
            io::ErrorKind::InvalidInput,
            "no credentials, neither in the environment nor from this machine's metadata service; for a bucket that \
             everyone may read set AWS_SKIP_SIGNATURE=true or GOOGLE_SKIP_SIGNATURE=true or AZURE_SKIP_SIGNATURE=true",
        )
    } else if is("No CA certificates") {
        (io::ErrorKind::InvalidInput, "install this system's ca-certificates, or set SSL_CERT_FILE")
    } else if is("URL scheme is not allowed") {
        (io::ErrorKind::InvalidInput, "to talk to it without TLS set AWS_ALLOW_HTTP=true")
    } else if matches!(error, Error::PermissionDenied { .. } | Error::Unauthenticated { .. }) {
        (io::ErrorKind::PermissionDenied, "the store refused: wrong credentials, or no right to read there")
    } else if is("NoSuchBucket") {
        (io::ErrorKind::InvalidInput, "there is no such bucket")
    } else if (is("non-2xx status code: 4") && !is("status code: 429") && !is("status code: 408"))
        || is("incorrectly configured region")
        || !matches!(error, Error::Generic { .. })
    {
        (io::ErrorKind::InvalidInput, "the store cannot do this")
    } else {
        return io::Error::other(text);
    };
    io::Error::new(kind, format!("{advice} ({text})"))
}

#[cfg(test)]
mod tests {
    use std::path::Path as FilePath;

    use object_store::memory::InMemory;

    use super::*;
    use crate::source::Source;
    use crate::{Dataset, ExitCode, ReadError, ShardWriter, begin_dataset, finalize, synthetic};

    /// A bucket with a dataset of 2 shards under a prefix.
    fn bucket() -> (Arc<InMemory>, Vec<schema::AttemptRecord>) {
        let dir = tempfile::tempdir().unwrap();
        let mut info = synthetic::info(5, 2, 40, 8);
        info.grid.resolution = 4;
        begin_dataset(dir.path(), &info).unwrap();
        for shard in 0..2 {
            let mut writer = ShardWriter::create(dir.path(), &info, shard).unwrap();
            for scene in info.scenes_of(shard) {
                writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
            }
            writer.commit().unwrap();
        }
        finalize(dir.path()).unwrap();
        let store = Arc::new(InMemory::new());
        let runtime = Builder::new_current_thread().build().unwrap();
        upload(dir.path(), dir.path(), &mut |name, bytes| {
            let path = Path::from(format!("sets/one/{name}"));
            runtime.block_on(store.put(&path, bytes.into())).unwrap();
        });
        (store, Dataset::open(dir.path()).unwrap().read_attempts(1).unwrap())
    }

    fn upload(root: &FilePath, folder: &FilePath, put: &mut dyn FnMut(&str, Vec<u8>)) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                upload(root, &path, put);
            } else {
                put(path.strip_prefix(root).unwrap().to_str().unwrap(), std::fs::read(&path).unwrap());
            }
        }
    }

    fn open(store: &Arc<InMemory>, prefix: &str) -> Result<Dataset, ReadError> {
        let url = Url::parse(&format!("s3://bucket/{prefix}")).unwrap();
        let remote = Remote::new(&url, Arc::clone(store) as _, Path::from(prefix), true)?;
        let dataset = Dataset::of_source(Source::Remote(remote), &place(&url))?;
        dataset.look_at_sizes()?;
        Ok(dataset)
    }

    const FILE: &str = "attempts/shard-00001-of-00002.parquet";

    #[test]
    fn what_is_in_a_bucket_is_read() {
        let (store, attempts) = bucket();
        let dataset = open(&store, "sets/one").unwrap();
        assert_eq!(dataset.read_attempts(1).unwrap(), attempts);
        assert_eq!(dataset.list(crate::Table::Scenes).unwrap().unwrap().len(), 2);
        assert_eq!(open(&store, "sets/two").unwrap_err().exit_code(), ExitCode::Config);
    }

    #[test]
    fn sizes_are_seen_when_it_is_opened_and_checksums_when_it_is_read() {
        let (store, _) = bucket();
        let path = Path::from(format!("sets/one/{FILE}"));
        let runtime = Builder::new_current_thread().build().unwrap();
        let put = |bytes: Vec<u8>| runtime.block_on(store.put(&path, bytes.into())).map(drop).unwrap();
        let whole = runtime.block_on(async { store.get(&path).await.unwrap().bytes().await.unwrap().to_vec() });
        let mut flipped = whole.clone();
        flipped[20] ^= 4;
        put(flipped);
        let told = open(&store, "sets/one").unwrap().read_attempts(1).unwrap_err();
        let (code, told) = (told.exit_code(), told.to_string());
        assert!(
            code == ExitCode::Data && told.starts_with("shard 1: sha256 must be ") && told.ends_with(FILE),
            "{told}"
        );
        put(whole[..9].to_vec());
        let told = open(&store, "sets/one").unwrap_err().to_string();
        assert!(told.starts_with("shard 1: size must be ") && told.ends_with(FILE), "{told}");
        runtime.block_on(store.delete(&path)).unwrap();
        let told = open(&store, "sets/one").unwrap_err().to_string();
        assert!(told.starts_with("shard 1: the file is missing: ") && told.ends_with(FILE), "{told}");
    }

    #[test]
    fn what_to_do_about_an_error_is_told() {
        let said = |text: &str| explain(&Error::Generic { store: "S3", source: text.to_owned().into() });
        for (text, kind, part) in [
            ("Error performing PUT http://169.254.169.254/latest/api/token", io::ErrorKind::InvalidInput, "AWS_SKIP"),
            ("Server returned non-2xx status code: 400 Bad Request", io::ErrorKind::InvalidInput, "cannot do this"),
            ("Server returned non-2xx status code: 429 Too Many Requests", io::ErrorKind::Other, "429"),
            ("Server returned non-2xx status code: 408 Request Timeout", io::ErrorKind::Other, "408"),
            ("Server returned non-2xx status code: 503 Slow Down", io::ErrorKind::Other, "503"),
            ("connection refused", io::ErrorKind::Other, "connection refused"),
        ] {
            let error = said(text);
            assert!(error.kind() == kind && error.to_string().contains(part), "{error}");
        }
    }
}
