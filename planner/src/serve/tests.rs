//! The service over real sockets, with a mock planner that follows commands in the body.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::mpsc;
use std::thread::JoinHandle;

use super::*;

struct Running {
    address: SocketAddr,
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<(), Failure>>,
}

impl Running {
    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap().unwrap();
    }

    fn ask(&self, request: &str) -> String {
        exchange(self.address, request.as_bytes())
    }

    fn plan(&self, body: &str) -> String {
        self.ask(&plan_request(body))
    }
}

fn options() -> ServeOptions {
    ServeOptions {
        host: "127.0.0.1".to_owned(),
        allow_host: Vec::new(),
        port: 0,
        body_bytes_max: 1000,
        request_timeout: Duration::from_secs(20),
        concurrent: 1,
        queue: 0,
        silence_max: Duration::from_secs(10),
        grasp_frame: GraspFrame::DexGraspNet2,
    }
}

fn silent_for(ms: u64) -> ServeOptions {
    ServeOptions { silence_max: Duration::from_millis(ms), ..options() }
}

fn work(plan: impl Fn(&[u8]) -> Result<Planned, Fault> + Clone + Send + Sync + 'static) -> Work {
    let predict = Box::new(plan.clone());
    Work { plan: Box::new(plan), predict, model: Value::Null, config: Value::Null }
}

/// Bodies are commands: `panic`, `refuse`, `wait` (until `go`); anything else is planned.
fn start(options: ServeOptions, go: &Arc<AtomicBool>) -> Running {
    let go = Arc::clone(go);
    let plan = move |body: &[u8]| match body {
        b"panic" => panic!("as ordered"),
        b"refuse" => Err(Fault::new(StatusCode::UNPROCESSABLE_ENTITY, "refused as ordered")),
        other => {
            while other == b"wait" && !go.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(2));
            }
            Ok(Planned { body: b"{\"grasps\":[]}".to_vec(), server_timing: "parse;dur=1.00".to_owned() })
        }
    };
    let shared = Shared::new(work(plan), &options);
    let stop = Arc::new(AtomicBool::new(false));
    let (sender, receiver) = mpsc::channel();
    let (theirs, until) = (Arc::clone(&shared), Arc::clone(&stop));
    let thread = std::thread::spawn(move || {
        let on_listening = |address| sender.send(address).unwrap();
        serve_shared(&theirs, &until, &on_listening)
    });
    Running { address: receiver.recv().unwrap(), shared, stop, thread }
}

fn started() -> Running {
    start(options(), &Arc::default())
}

fn plan_request(body: &str) -> String {
    format!(
        "POST /v1/plan HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\n\r\n{body}",
        body.len()
    )
}

fn get_request(path: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
}

fn exchange(address: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream.write_all(request).unwrap();
    answer_of(stream)
}

fn answer_of(mut stream: TcpStream) -> String {
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[track_caller]
fn assert_error(answer: &str, status: u16, text: &str) {
    assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{answer}");
    assert!(answer.to_lowercase().contains("content-type: application/json"), "{answer}");
    let body: serde_json::Value = serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap();
    assert_eq!(body["status"], status, "{answer}");
    assert!(body["error"].as_str().unwrap().contains(text), "{answer}");
}

fn until(condition: impl Fn() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < Duration::from_secs(20), "it never came to be");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_plan_is_answered_and_timed() {
    let service = started();
    let answer = service.plan("anything");
    assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
    assert!(answer.contains("server-timing: parse;dur=1.00"), "{answer}");
    assert!(answer.ends_with("{\"grasps\":[]}"), "{answer}");
    service.end();
}

#[test]
fn every_error_is_json() {
    let service = started();
    assert_error(&service.plan("refuse"), 422, "refused as ordered");
    assert_error(&service.ask(&get_request("/nowhere")), 404, "no such path");
    let wrong_method = service.ask(&get_request("/v1/plan"));
    assert_error(&wrong_method, 405, "Allow");
    assert!(wrong_method.to_lowercase().contains("allow: post"), "{wrong_method}");
    let wrong_type = service.ask(&plan_request("{}").replace("application/json", "text/plain"));
    assert_error(&wrong_type, 415, "application/json");
    let packed = service.ask(&plan_request("{}").replace("\r\n\r\n", "\r\nContent-Encoding: gzip\r\n\r\n"));
    assert_error(&packed, 415, "must not be compressed, got the content-encoding gzip");
    service.end();
}

#[test]
fn bodies_have_a_limit_with_and_without_a_length() {
    let service = started();
    let body = "x".repeat(1001);
    assert_error(&service.plan(&body), 413, "at most 1000 bytes");
    let head = plan_request("").replace("Content-Length: 0", "Transfer-Encoding: chunked");
    assert_error(&service.ask(&format!("{head}3e9\r\n{body}\r\n0\r\n\r\n")), 413, "at most 1000 bytes");
    assert!(service.plan(&body[..1000]).starts_with("HTTP/1.1 200"));
    service.end();
}

#[test]
fn who_sends_far_too_much_still_reads_why() {
    let service = started();
    // More than the sockets' buffers hold, so that the answer arrives while the client still writes.
    let body = "x".repeat(8_000_000);
    assert_error(&service.plan(&body), 413, "at most 1000 bytes");
    service.end();
}

#[test]
fn a_panic_costs_one_answer() {
    let service = started();
    for _ in 0..3 {
        assert_error(&service.plan("panic"), 500, "a defect");
        assert!(service.plan("fine").starts_with("HTTP/1.1 200"));
    }
    service.end();
}

#[test]
fn who_finds_no_place_is_turned_away_while_health_answers() {
    let go = Arc::new(AtomicBool::new(false));
    let service = start(options(), &go);
    let address = service.address;
    let waiting = std::thread::spawn(move || exchange(address, plan_request("wait").as_bytes()));
    until(|| service.shared.turns.available_permits() == 0);
    let refused = service.plan("anything");
    assert_error(&refused, 503, "too many");
    assert!(refused.to_lowercase().contains("retry-after: 1"), "{refused}");
    assert!(service.ask(&get_request("/healthz")).ends_with("ok"));
    go.store(true, Ordering::Relaxed);
    assert!(waiting.join().unwrap().starts_with("HTTP/1.1 200"));
    service.end();
}

#[test]
fn who_closes_the_half_that_was_written_still_reads_the_answer() {
    let go = Arc::new(AtomicBool::new(false));
    let service = start(options(), &go);
    let mut stream = TcpStream::connect(service.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream.write_all(plan_request("wait").as_bytes()).unwrap();
    stream.shutdown(Shutdown::Write).unwrap();
    until(|| service.shared.turns.available_permits() == 0);
    go.store(true, Ordering::Relaxed);
    let answer = answer_of(stream);
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    service.end();
}

#[test]
fn a_plan_that_takes_too_long_is_504_and_keeps_its_place_until_it_ends() {
    let go = Arc::new(AtomicBool::new(false));
    let hasty = ServeOptions { request_timeout: Duration::from_millis(200), ..options() };
    let service = start(hasty, &go);
    assert_error(&service.plan("wait"), 504, "no answer within 0.2 s");
    assert_error(&service.plan("anything"), 503, "too many");
    go.store(true, Ordering::Relaxed);
    until(|| service.shared.places.available_permits() == 1);
    assert!(service.plan("anything").starts_with("HTTP/1.1 200"));
    service.end();
}

#[test]
fn a_body_that_never_ends_is_504() {
    let hasty = ServeOptions { request_timeout: Duration::from_millis(200), ..options() };
    let service = start(hasty, &Arc::default());
    let unfinished = plan_request("{}").replace("Content-Length: 2", "Content-Length: 900");
    assert_error(&service.ask(&unfinished), 504, "no answer within 0.2 s");
    until(|| service.shared.places.available_permits() == 1);
    service.end();
}

#[test]
fn the_silent_and_the_trickling_are_hung_up_on() {
    let service = start(silent_for(300), &Arc::default());
    let silent = TcpStream::connect(service.address).unwrap();
    let mut trickling = TcpStream::connect(service.address).unwrap();
    let started = Instant::now();
    trickling.write_all(b"GET /healthz HTTP/1.1\r\n").unwrap();
    // The write fails some time after the other side has closed.
    while trickling.write_all(b"a: b\r\n").is_ok() {
        assert!(started.elapsed() < Duration::from_secs(20), "the service must limit the time of a header");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(started.elapsed() >= Duration::from_millis(300));
    silent.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    assert_eq!(answer_of(silent), "");
    service.end();
}

#[test]
fn a_connection_serves_again_and_again() {
    let service = start(silent_for(500), &Arc::default());
    let mut stream = TcpStream::connect(service.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let mut answer = [0; 4096];
    // Longer in total than the allowed silence.
    for _ in 0..4 {
        stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        let length = stream.read(&mut answer).unwrap();
        assert!(answer[..length].ends_with(b"ok"), "{}", String::from_utf8_lossy(&answer[..length]));
        std::thread::sleep(Duration::from_millis(250));
    }
    drop(stream);
    service.end();
}

#[test]
fn a_service_that_stops_answers_what_is_under_way() {
    let go = Arc::new(AtomicBool::new(false));
    let service = start(options(), &go);
    let address = service.address;
    let waiting = std::thread::spawn(move || exchange(address, plan_request("wait").as_bytes()));
    until(|| service.shared.turns.available_permits() == 0);
    service.stop.store(true, Ordering::Relaxed);
    until(|| service.shared.stopping.load(Ordering::Relaxed));
    until(|| TcpStream::connect(address).is_err());
    go.store(true, Ordering::Relaxed);
    assert!(waiting.join().unwrap().starts_with("HTTP/1.1 200"));
    service.end();
}

#[test]
fn a_service_that_stops_is_not_ready() {
    let service = started();
    assert!(service.ask(&get_request("/readyz")).ends_with("ready"));
    service.shared.stopping.store(true, Ordering::Relaxed);
    assert_error(&service.ask(&get_request("/readyz")), 503, "stopping");
    service.end();
}

#[test]
fn a_taken_address_is_an_error() {
    let service = started();
    let taken = ServeOptions { port: service.address.port(), ..options() };
    let shared = Shared::new(work(|_: &[u8]| Err(Fault::internal())), &taken);
    let error = serve_shared(&shared, &AtomicBool::new(false), &|_| ()).unwrap_err();
    assert!(error.to_string().starts_with("failed to listen: "), "{error}");
    assert_eq!(error.exit_code(), ExitCode::TryAgain);
    service.end();
}
