//! Spans over OTLP: the test's collector receives them from real servers and workers.

use opentelemetry_proto::tonic::collector::trace::v1::ExportTraceServiceRequest;
use opentelemetry_proto::tonic::common::v1::any_value::Value as Any;
use opentelemetry_proto::tonic::common::v1::{AnyValue, KeyValue};
use prost::Message as _;
use rotortwin_tests::postgres::Postgres;
use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{PATIENCE, program};
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::server::{Server, Worker};
use serde_json::json;
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::Command;
use std::sync::{Arc, Mutex};

/// The example of W3C Trace Context: trace, span, sampled.
const TRACE: &str = "4bf92f3577b34da6a3ce929d0e0e4736";
const PARENT: &str = "00f067aa0ba902b7";

fn traceparent() -> String {
    format!("00-{TRACE}-{PARENT}-01")
}

/// A span, as text.
#[derive(Debug, Clone)]
struct Span {
    name: String,
    trace: String,
    id: String,
    parent: String,
    failed: bool,
    service: String,
    attributes: BTreeMap<String, String>,
}

impl Span {
    fn says(&self, key: &str, value: &str) -> bool {
        self.attributes.get(key).is_some_and(|text| text == value)
    }
}

/// Accepts `POST /v1/traces`, protobuf.
struct Collector {
    address: String,
    spans: Arc<Mutex<Vec<Span>>>,
}

impl Collector {
    fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port is free");
        let address = listener.local_addr().expect("it has one").to_string();
        let spans = Arc::new(Mutex::new(Vec::new()));
        let taken = Arc::clone(&spans);
        std::thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                let taken = Arc::clone(&taken);
                std::thread::spawn(move || take_all(stream, &taken));
            }
        });
        Self { address, spans }
    }

    fn endpoint(&self) -> String {
        format!("http://{}", self.address)
    }

    fn spans(&self) -> Vec<Span> {
        self.spans.lock().expect("no panic holds it").clone()
    }

    /// Waits for a span.
    fn one(&self, what: &str, is_it: impl Fn(&Span) -> bool) -> Span {
        let mut found = None;
        wait_until(PATIENCE, || {
            found = self.spans().into_iter().find(|span| is_it(span));
            found.is_some()
        })
        .unwrap_or_else(|| panic!("no span of {what}: {:#?}", self.spans()));
        found.expect("it was found")
    }
}

fn take_all(stream: TcpStream, spans: &Mutex<Vec<Span>>) {
    let mut reader = BufReader::new(stream);
    loop {
        let mut head = Vec::new();
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line).is_ok_and(|read| read > 0) {
                if line.trim().is_empty() {
                    break;
                }
                head.push(line.trim().to_owned());
            } else {
                return;
            }
        }
        assert_eq!(head.first().map(String::as_str), Some("POST /v1/traces HTTP/1.1"));
        let header = |name: &str| {
            head.iter()
                .filter_map(|line| line.split_once(':'))
                .find(|(key, _)| key.eq_ignore_ascii_case(name))
                .map(|(_, value)| value.trim().to_owned())
        };
        assert_eq!(header("content-type").as_deref(), Some("application/x-protobuf"));
        let length = header("content-length")
            .and_then(|text| text.parse().ok())
            .expect("a length");
        let mut body = vec![0; length];
        reader.read_exact(&mut body).expect("the body");
        let request = ExportTraceServiceRequest::decode(&body[..]).expect("OTLP");
        spans.lock().expect("no panic holds it").extend(decoded(&request));
        reader
            .get_mut()
            .write_all(b"HTTP/1.1 200 OK\r\ncontent-type: application/x-protobuf\r\ncontent-length: 0\r\n\r\n")
            .expect("an answer");
    }
}

fn decoded(request: &ExportTraceServiceRequest) -> Vec<Span> {
    let mut spans = Vec::new();
    for of_process in &request.resource_spans {
        let resource = of_process.resource.as_ref().expect("a resource");
        let service = texts(&resource.attributes).remove("service.name").expect("a service");
        for span in of_process.scope_spans.iter().flat_map(|scope| &scope.spans) {
            spans.push(Span {
                name: span.name.clone(),
                trace: hex(&span.trace_id),
                id: hex(&span.span_id),
                parent: hex(&span.parent_span_id),
                // STATUS_CODE_ERROR
                failed: span.status.as_ref().is_some_and(|status| status.code == 2),
                service: service.clone(),
                attributes: texts(&span.attributes),
            });
        }
    }
    spans
}

fn texts(attributes: &[KeyValue]) -> BTreeMap<String, String> {
    let text = |value: &Option<AnyValue>| match value.as_ref().and_then(|value| value.value.as_ref()) {
        Some(Any::StringValue(text)) => text.clone(),
        Some(Any::IntValue(number)) => number.to_string(),
        other => format!("{other:?}"),
    };
    attributes
        .iter()
        .map(|attribute| (attribute.key.clone(), text(&attribute.value)))
        .collect()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A flight of 1 s.
fn flight() -> String {
    json!({ "scenario": "short-hover", "set": ["duration_s=1"], "link": "in-process" }).to_string()
}

#[test]
fn scenario_a_trace_goes_from_the_client_to_the_attempt() {
    let scratch = Scratch::new();
    let collector = Collector::start();
    let environment = [
        ("OTEL_EXPORTER_OTLP_ENDPOINT", collector.endpoint()),
        ("OTEL_BSP_SCHEDULE_DELAY", "50".to_owned()),
    ];
    let environment = environment.each_ref().map(|(name, value)| (*name, value.as_str()));
    let mut server = Server::start_in(&environment, "127.0.0.1:0", &scratch.path("data"), &["--workers", "1"]);
    let headers = [("traceparent", traceparent()), ("x-request-id", "night-17".to_owned())];
    let headers = headers.each_ref().map(|(name, value)| (*name, value.as_str()));
    let answer = server.ask("POST", "/api/v1/runs", &headers, &flight());
    assert_eq!(answer.status, 202, "{}", String::from_utf8_lossy(&answer.body));
    let id = answer.json()["id"].as_str().expect("an id").to_owned();
    let run = server.ended(&id);
    assert_eq!(run["status"], "done", "{run}");

    let request = collector.one("the request", |span| span.name == "POST /api/v1/runs");
    assert_eq!(
        (request.trace.as_str(), request.parent.as_str()),
        (TRACE, PARENT),
        "{request:?}"
    );
    assert_eq!(request.service, "rotortwin");
    for (key, value) in [
        ("http.request.method", "POST"),
        ("http.route", "/api/v1/runs"),
        ("http.response.status_code", "202"),
        ("http.request.header.x-request-id", "night-17"),
    ] {
        assert!(request.says(key, value), "{key}: {request:?}");
    }
    let attempt = collector.one("the attempt", |span| span.says("rotortwin.job.id", &id));
    assert_eq!(
        (attempt.trace.as_str(), &attempt.parent),
        (TRACE, &request.id),
        "{attempt:?}"
    );
    for (key, value) in [
        ("rotortwin.job.kind", "run"),
        ("rotortwin.job.attempt", "1"),
        ("rotortwin.tenant", "local"),
        ("rotortwin.worker", run["worker"].as_str().expect("a worker")),
        ("rotortwin.outcome", "done"),
    ] {
        assert!(attempt.says(key, value), "{key}: {attempt:?}");
    }
    assert!(!attempt.failed, "{attempt:?}");

    // Queued spans are sent before the server ends; without a client's trace they start their own.
    assert_eq!(server.ask("GET", "/api/v1/nothing", &[], "").status, 404);
    assert_eq!(server.stop(), Some(0));
    let lost = collector.one("the unknown address", |span| span.says("url.path", "/api/v1/nothing"));
    assert_eq!((lost.name.as_str(), lost.parent.as_str()), ("GET", ""), "{lost:?}");
    assert_ne!(lost.trace, TRACE);
}

#[test]
fn scenario_a_trace_crosses_to_another_worker() {
    let scratch = Scratch::new();
    let Some(postgres) = Postgres::start(scratch.folder()) else {
        return;
    };
    let collector = Collector::start();
    let artifacts = scratch.path("artifacts").display().to_string();
    let url = postgres.url();
    let shared = ["--database-url", &url, "--artifacts", &artifacts, "--workers"];
    let of = |service: &'static str| {
        [
            (
                "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT",
                format!("{}/v1/traces", collector.endpoint()),
            ),
            ("OTEL_BSP_SCHEDULE_DELAY", "50".to_owned()),
            ("OTEL_SERVICE_NAME", service.to_owned()),
        ]
    };
    let (here, there) = (of("bench-server"), of("bench-worker"));
    let here = here.each_ref().map(|(name, value)| (*name, value.as_str()));
    let there = there.each_ref().map(|(name, value)| (*name, value.as_str()));
    let server = Server::start_in(
        &here,
        "127.0.0.1:0",
        &scratch.path("here"),
        &[&shared[..], &["0"]].concat(),
    );
    let _worker = Worker::start_in(&there, &scratch.path("there"), &[&shared[..], &["1"]].concat());
    let parent = traceparent();
    let answer = server.ask("POST", "/api/v1/runs", &[("traceparent", &parent)], &flight());
    let id = answer.json()["id"].as_str().expect("an id").to_owned();
    assert_eq!(server.ended(&id)["status"], "done");
    let request = collector.one("the request", |span| span.name == "POST /api/v1/runs");
    let attempt = collector.one("the attempt", |span| span.says("rotortwin.job.id", &id));
    assert_eq!(
        (request.service.as_str(), attempt.service.as_str()),
        ("bench-server", "bench-worker")
    );
    assert_eq!(
        (attempt.trace.as_str(), &attempt.parent),
        (TRACE, &request.id),
        "{attempt:?}"
    );
}

#[test]
fn scenario_a_collector_that_is_away_or_deaf_holds_up_nothing() {
    // The first address is closed; the second accepts connections and never answers.
    let away = TcpListener::bind("127.0.0.1:0")
        .and_then(|listener| listener.local_addr())
        .expect("a port");
    let deaf = TcpListener::bind("127.0.0.1:0").expect("a port");
    for address in [away, deaf.local_addr().expect("it has one")] {
        let scratch = Scratch::new();
        let endpoint = format!("http://{address}");
        let environment = [
            ("OTEL_EXPORTER_OTLP_ENDPOINT", endpoint.as_str()),
            ("OTEL_BSP_SCHEDULE_DELAY", "50"),
        ];
        let mut server = Server::start_in(&environment, "127.0.0.1:0", &scratch.path("data"), &["--workers", "1"]);
        let answer = server.ask("POST", "/api/v1/runs", &[], &flight());
        assert_eq!(answer.status, 202);
        let id = answer.json()["id"].as_str().expect("an id").to_owned();
        assert_eq!(server.ended(&id)["status"], "done");
        assert_eq!(server.stop(), Some(0));
    }
}

#[test]
fn scenario_a_setting_that_cannot_be_met_is_refused() {
    let scratch = Scratch::new();
    for (name, value, words) in [
        ("OTEL_EXPORTER_OTLP_PROTOCOL", "grpc", "expected http/protobuf"),
        (
            "OTEL_EXPORTER_OTLP_ENDPOINT",
            "no address",
            "expected an address such as",
        ),
    ] {
        let output = Command::new(program())
            .args(["serve", "--listen", "127.0.0.1:0", "--data"])
            .arg(scratch.path("data"))
            .current_dir(rotortwin_tests::scratch::repository())
            .env("OTEL_EXPORTER_OTLP_ENDPOINT", "http://127.0.0.1:4318")
            .env(name, value)
            .output()
            .expect("it starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(words) && told.contains(value), "{told}");
    }
    assert!(!scratch.path("data").exists(), "a refused start writes nothing");
}
