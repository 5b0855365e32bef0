//! Reading over HTTP from a server with configurable faults.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use program::ExitCode;
use shards::{Dataset, Location, layout, verify};

use crate::sample;

/// What the server does to a file's bytes.
#[derive(Clone, Copy, PartialEq)]
enum Mood {
    /// Sends the file.
    Good,
    /// Answers 503 twice, then sends the file.
    BusyTwice,
    /// Sends half of it and closes the connection, each time.
    Cut,
    /// Sends half of it, and then nothing.
    Dying,
    /// Answers 403.
    Refusing,
    /// Does not answer.
    Silent,
}

/// A web server for a folder, with a fault for names that contain a text.
struct Server {
    url: String,
    stop: Arc<AtomicBool>,
}

impl Server {
    fn new(root: &Path, mood: Mood, about: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/a%20set", listener.local_addr().unwrap());
        let stop = Arc::new(AtomicBool::new(false));
        let (root, stopped, asked) = (root.to_owned(), Arc::clone(&stop), Arc::new(AtomicU32::new(0)));
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                if stopped.load(Ordering::Relaxed) {
                    return;
                }
                let (root, asked) = (root.clone(), Arc::clone(&asked));
                let stopped = Arc::clone(&stopped);
                std::thread::spawn(move || serve(stream.unwrap(), &root, mood, about, &asked, &stopped));
            }
        });
        Self { url, stop }
    }

    fn location(&self) -> Location {
        Location::parse(&self.url).unwrap()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let address = self.url.trim_start_matches("http://").trim_end_matches("/a%20set");
        drop(TcpStream::connect(address)); // wakes it
    }
}

fn serve(mut stream: TcpStream, root: &Path, mood: Mood, about: &str, asked: &AtomicU32, stopped: &AtomicBool) {
    let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
    let request = lines.next().unwrap().unwrap();
    lines.by_ref().find(|line| line.as_ref().is_ok_and(String::is_empty));
    let name = request.split(' ').nth(1).unwrap().trim_start_matches("/a%20set/");
    let mood = if name.contains(about) { mood } else { Mood::Good };
    let mut say = |status: &str, length: usize, body: &[u8]| {
        let head = format!("HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n");
        let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body));
    };
    let Ok(bytes) = std::fs::read(root.join(name)) else { return say("404 Not Found", 0, b"") };
    match mood {
        Mood::BusyTwice if asked.fetch_add(1, Ordering::Relaxed) < 2 => say("503 Slow Down", 0, b""),
        Mood::Good | Mood::BusyTwice => say("200 OK", bytes.len(), &bytes),
        Mood::Dying => {
            stopped.store(true, Ordering::Relaxed);
            say("200 OK", bytes.len(), &bytes[..bytes.len() / 2]);
        }
        Mood::Cut => say("200 OK", bytes.len(), &bytes[..bytes.len() / 2]),
        Mood::Refusing => say("403 Forbidden", 0, b""),
        Mood::Silent => std::thread::sleep(Duration::from_secs(120)),
    }
}

struct Place {
    dir: tempfile::TempDir,
}

const FILE: &str = "scenes/shard-00001-of-00002.parquet";

impl Place {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        sample::write(dir.path(), &sample::info(3));
        Self { dir }
    }

    fn file(&self) -> PathBuf {
        self.dir.path().join(FILE)
    }
}

fn program(server: &Server, command: &str) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_graspmill"));
    program.args(["dataset", command, &server.url]).env("HTTP_READ_TIMEOUT", "300 ms");
    program.output().unwrap()
}

#[test]
fn a_dataset_reads_the_same_from_far_away() {
    let place = Place::new();
    for mood in [Mood::Good, Mood::BusyTwice] {
        let server = Server::new(place.dir.path(), mood, FILE);
        let (near, far) = (Dataset::open(place.dir.path()).unwrap(), Dataset::open(server.location()).unwrap());
        assert_eq!(far.info(), near.info());
        assert_eq!(far.location().to_string(), server.url);
        for shard in 0..2 {
            let rows = |dataset: &Dataset| dataset.rows(shard, true).unwrap().map(Result::unwrap).collect::<Vec<_>>();
            assert_eq!(rows(&far), rows(&near));
        }
        assert_eq!(far.read_scene(7).unwrap(), near.read_scene(7).unwrap());
        assert!(verify(server.location(), |_| ()).unwrap().is_ok());
    }
}

#[test]
fn damage_is_65_and_named() {
    let place = Place::new();
    let whole = std::fs::read(place.file()).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    let server = Server::new(place.dir.path(), Mood::Good, "");
    let cases = [(Some(flipped), "sha256 must be"), (Some(whole[..99].to_vec()), "got 99"), (None, "is missing")];
    for (bytes, part) in cases {
        match bytes {
            Some(bytes) => std::fs::write(place.file(), bytes).unwrap(),
            None => std::fs::remove_file(place.file()).unwrap(),
        }
        let dataset = Dataset::open(server.location()).unwrap();
        let error = dataset.rows(1, true).map(drop).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Data, "{error}");
        let told = error.to_string();
        assert!(told.contains("shard 1") && told.contains(part) && told.ends_with(FILE), "{told}");
        let output = program(&server, "verify");
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.code() == Some(65) && told.contains(part) && told.contains(FILE), "{told}");
    }
}

#[test]
fn trouble_ends_in_time_and_says_whether_to_try_again() {
    let place = &Place::new();
    // Half a minute of retries each, so all at once.
    std::thread::scope(|scope| {
        for (mood, code, part) in [
            (Mood::Refusing, 78, "wrong credentials, or no right"),
            (Mood::Cut, 75, "failed to fetch a file"),
            (Mood::Dying, 75, "failed to fetch a file"),
            (Mood::Silent, 75, "failed to fetch a file"),
        ] {
            scope.spawn(move || {
                let server = Server::new(place.dir.path(), mood, FILE);
                let began = Instant::now();
                let output = program(&server, "verify");
                let told = String::from_utf8_lossy(&output.stderr).into_owned();
                assert_eq!(output.status.code(), Some(code), "{told}");
                assert!(told.contains(part) && told.contains(FILE), "{told}");
                assert!(began.elapsed() < Duration::from_secs(60), "{:?}", began.elapsed());
            });
        }
    });
}

#[test]
fn where_nothing_is_that_is_told() {
    let place = Place::new();
    let server = Server::new(place.dir.path(), Mood::Good, "");
    std::fs::remove_file(place.dir.path().join(layout::MANIFEST)).unwrap();
    assert_eq!(Dataset::open(server.location()).unwrap_err().exit_code(), ExitCode::Incomplete);
    std::fs::remove_file(place.dir.path().join(layout::INFO)).unwrap();
    assert_eq!(Dataset::open(server.location()).unwrap_err().exit_code(), ExitCode::Config);
    let nobody = Server { url: "http://127.0.0.1:9/a%20set".to_owned(), stop: Arc::default() };
    let output = program(&nobody, "report");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(75), "{told}");
    assert!(told.contains("127.0.0.1:9/a%20set/meta/info.json"), "{told}");
}
