//! Attacks on a server without tokens: web pages in its user's browser, files, slow connections, other users.

use rotortwin_tests::process::{Process, wait_until};
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::server::Server;
use rotortwin_tests::websocket::WebSocket;
use rustix::process::Signal;
use std::collections::BTreeSet;
use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

const HOVER: &str = r#"{"scenario":"short-hover","link":"in-process"}"#;

/// Sends a request as a browser does; returns the status, and the raw head and body.
fn browse(server: &Server, line: &str, headers: &[(&str, &str)], body: &str) -> (u16, String) {
    let mut stream = server.connect();
    let mut text = format!("{line} HTTP/1.1\r\nconnection: close\r\n");
    for (name, value) in headers {
        text += &format!("{name}: {value}\r\n");
    }
    if !body.is_empty() {
        text += &format!("content-length: {}\r\n", body.len());
    }
    stream
        .write_all(format!("{text}\r\n{body}").as_bytes())
        .expect("it is taken");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let status = answer.split(' ').nth(1).and_then(|code| code.parse().ok());
    (status.expect("a status"), answer)
}

#[test]
fn scenario_a_page_of_another_name_is_told_nothing() {
    let scratch = Scratch::new();
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("data"),
        &["--workers", "0", "--allow-host", "bench.example"],
    );
    let port = server.address().rsplit(':').next().expect("a port").to_owned();
    // An attacker's host name that resolves to this host (DNS rebinding): to the browser the two are one site.
    for host in [
        "evil.example",
        "evil.example:8400",
        "127.0.0.1.evil.example",
        "10.1.2.3",
    ] {
        let origin = format!("http://{host}");
        let headers = [("host", host), ("origin", &origin), ("sec-fetch-site", "same-origin")];
        let (status, answer) = browse(&server, "GET /api/v1/runs", &headers, "");
        assert_eq!(status, 421, "{host}: {answer}");
        assert!(
            answer.contains("--allow-host") && answer.contains("application/problem+json"),
            "{answer}"
        );
        let mut headers = headers.to_vec();
        headers.push(("content-type", "application/json"));
        assert_eq!(browse(&server, "POST /api/v1/runs", &headers, HOVER).0, 421, "{host}");
    }
    let (status, _) = browse(
        &server,
        "GET http://evil.example/api/v1/runs",
        &[("host", "localhost")],
        "",
    );
    assert_eq!(status, 421, "the address in the request line counts");
    for host in [
        server.address(),
        &format!("localhost:{port}"),
        "LocalHost",
        "bench.example",
        "[::1]:1",
    ] {
        assert_eq!(
            browse(&server, "GET /api/v1/runs", &[("host", host)], "").0,
            200,
            "{host}"
        );
    }
    assert_eq!(
        browse(&server, "GET /healthz", &[("host", "10.1.2.3")], "").0,
        200,
        "a probe"
    );
    assert_eq!(
        server.get("/api/v1/runs")["items"].as_array().map(Vec::len),
        Some(0),
        "nothing was submitted"
    );
}

#[test]
fn scenario_pages_of_other_origins_change_nothing() {
    let scratch = Scratch::new();
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("data"),
        &["--workers", "0", "--cors-origin", "https://lab.example"],
    );
    let host = server.address();
    let own = format!("http://{host}");
    let run = server.submit(&serde_json::json!({ "scenario": "short-hover" }));
    let session = server
        .ask("POST", "/api/v1/fdi/sessions", &[], r#"{"vehicle":"f550"}"#)
        .json();
    let session = session["session"]["id"].as_str().expect("an id").to_owned();

    let posts = [
        ("POST /api/v1/runs".to_owned(), HOVER),
        (format!("POST /api/v1/runs/{run}/cancel"), ""),
        (format!("DELETE /api/v1/fdi/sessions/{session}"), ""),
    ];
    let strangers: [&[(&str, &str)]; 5] = [
        &[("origin", "http://evil.example")],
        &[("origin", "null")],
        &[("origin", "http://localhost:3000"), ("sec-fetch-site", "same-site")],
        &[("sec-fetch-site", "cross-site")],
        &[("origin", "http://evil.example"), ("sec-fetch-site", "cross-site")],
    ];
    for (line, body) in &posts {
        for stranger in strangers {
            let mut headers = vec![("host", host), ("content-type", "application/json")];
            headers.extend_from_slice(stranger);
            let (status, answer) = browse(&server, line, &headers, body);
            assert_eq!(status, 403, "{line} {stranger:?}: {answer}");
            assert!(answer.contains("/problems/foreign-page"), "{answer}");
        }
    }
    // A form's content types need no preflight: no page needs to ask first.
    for kind in [Some("text/plain"), Some("application/x-www-form-urlencoded"), None] {
        for path in [
            "/api/v1/runs",
            "/api/v1/logs?name=a.csv",
            "/api/v1/fdi/reports?vehicle=f550",
        ] {
            let mut headers = vec![("host", host)];
            headers.extend(kind.map(|kind| ("content-type", kind)));
            let (status, answer) = browse(&server, &format!("POST {path}"), &headers, HOVER);
            assert_eq!(status, 415, "{path} {kind:?}: {answer}");
        }
    }
    let json = [("content-type", "application/json")];
    let toml = server.ask("PUT", "/api/v1/vehicles/mine", &json, "name = \"x\"");
    assert_eq!(toml.status, 415, "a document says that it is TOML");

    for path in [
        format!("/api/v1/runs/{run}/live"),
        format!("/api/v1/fdi/sessions/{session}/stream"),
    ] {
        let foreign = WebSocket::open_from(&server, &path, &[("origin", "http://evil.example")]);
        assert_eq!(foreign.map_err(|(status, _)| status).err(), Some(403), "{path}");
        assert!(
            WebSocket::open_from(&server, &path, &[("origin", &own)]).is_ok(),
            "{path}: its own pages"
        );
        assert!(
            WebSocket::open_from(&server, &path, &[("origin", "https://lab.example")]).is_ok(),
            "{path}: a named one"
        );
        assert!(WebSocket::open(&server, &path).is_ok(), "{path}: a program");
    }
    for origin in [own.as_str(), "https://lab.example"] {
        let headers = [("host", host), ("origin", origin), ("content-type", "application/json")];
        assert_eq!(browse(&server, "POST /api/v1/runs", &headers, HOVER).0, 202, "{origin}");
    }
    assert_eq!(server.get("/api/v1/runs")["items"].as_array().map(Vec::len), Some(3));
    assert_eq!(
        server.get(&format!("/api/v1/runs/{run}"))["status"],
        "queued",
        "nobody canceled it"
    );
}

#[test]
fn scenario_every_answer_says_what_a_page_may_do() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let id = server.submit(&serde_json::from_str(HOVER).expect("JSON"));
    assert_eq!(server.ended(&id)["status"], "done");
    let header = |path: &str, name: &str| {
        let answer = server.ask("GET", path, &[], "");
        let line = answer
            .headers
            .lines()
            .find_map(|line| line.split_once(": ").filter(|(key, _)| key.eq_ignore_ascii_case(name)));
        line.map_or(String::new(), |(_, value)| value.to_owned())
    };
    let report = format!("/api/v1/runs/{id}/artifacts/report.html");
    for path in ["/", "/api/v1/runs", "/api/v1/docs/", "/nowhere", "/healthz", &report] {
        assert_eq!(header(path, "x-content-type-options"), "nosniff", "{path}");
        assert_eq!(header(path, "referrer-policy"), "same-origin", "{path}");
        assert_eq!(header(path, "cross-origin-resource-policy"), "same-origin", "{path}");
        let policy = header(path, "content-security-policy");
        let script = policy
            .split("; ")
            .find(|part| part.starts_with("script-src"))
            .unwrap_or_default()
            .to_owned();
        if path == report {
            assert!(
                policy.starts_with("sandbox allow-scripts") && !policy.contains("allow-same-origin"),
                "{policy}"
            );
            assert!(
                policy.contains("default-src 'none'") && policy.contains("frame-ancestors 'self'"),
                "{policy}"
            );
        } else {
            assert_eq!(script, "script-src 'self'", "{path}: {policy}");
            assert!(
                policy.contains("frame-ancestors 'none'") && policy.contains("base-uri 'none'"),
                "{path}: {policy}"
            );
        }
    }
    // What these pages need is allowed: no inline scripts, and everything they load is from this server.
    for path in ["/", "/api/v1/docs/"] {
        let page = server.ask("GET", path, &[], "");
        let text = String::from_utf8_lossy(&page.body).to_lowercase();
        assert_eq!(page.status, 200, "{path}");
        for tag in text.split("<script").skip(1) {
            let head = tag.split('>').next().unwrap_or_default();
            assert!(
                head.contains("src=\"./") || head.contains("src=\"/"),
                "{path}: a script inside: {head}"
            );
        }
        for handler in [" onclick=", " onload=", "javascript:"] {
            assert!(!text.contains(handler), "{path}: {handler}");
        }
    }
    for file in ["swagger-ui-bundle.js", "swagger-initializer.js", "swagger-ui.css"] {
        assert_eq!(
            server.ask("GET", &format!("/api/v1/docs/{file}"), &[], "").status,
            200,
            "{file}"
        );
    }
}

/// Peak memory of a process, bytes.
fn peak_memory(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it lives");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes: u64 = line
        .and_then(|line| line.trim().trim_end_matches(" kB").parse().ok())
        .expect("the kernel counts it");
    kilobytes << 10
}

const BINARY: &[(&str, &str)] = &[("content-type", "application/octet-stream")];

#[test]
fn scenario_a_small_file_does_not_take_all_memory() {
    let scratch = Scratch::new();
    let server = Server::start(&scratch.path("data"));
    let columns = format!("time_s{}\n0\n", ",x".repeat(15_000_000));
    let mut subscriptions = b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".to_vec();
    let mut message = |kind: u8, payload: &[u8]| {
        subscriptions.extend(u16::try_from(payload.len()).expect("short").to_le_bytes());
        subscriptions.push(kind);
        subscriptions.extend(payload);
    };
    let fields: String = (0..200).map(|field| format!("float value_{field};")).collect();
    message(b'F', format!("many:uint64_t timestamp;{fields}").as_bytes());
    for number in 0..1_400_000_u32 {
        let [low, high, ..] = number.to_le_bytes();
        message(b'A', &[&[0, low, high], b"many".as_slice()].concat());
    }
    for file in [columns.as_bytes(), &subscriptions] {
        let answer = server.ask_bytes("POST", "/api/v1/fdi/reports?vehicle=f550", BINARY, file);
        let text = String::from_utf8_lossy(&answer.body).into_owned();
        assert_ne!(answer.status, 200, "{text}");
        assert!(
            answer.status < 500 && text.contains("more than"),
            "{} {text}",
            answer.status
        );
    }
    let peak = peak_memory(server.process().pid) >> 20;
    assert!(peak < 600, "the server took {peak} MB");
}

#[test]
fn scenario_a_job_has_only_so_much_memory() {
    let scratch = Scratch::new();
    let server = Server::start_at(
        "127.0.0.1:0",
        &scratch.path("data"),
        &["--workers", "1", "--job-memory", "128"],
    );
    // 160 MB of numbers in 40 MB of text.
    let names: Vec<String> = (0..1000).map(|column| format!("c{column}")).collect();
    let row = format!("0{}\n", ",0".repeat(1000));
    let file = format!("time_s,{}\n{}", names.join(","), row.repeat(20_000));
    let answer = server.ask_bytes("POST", "/api/v1/logs?name=large.csv", BINARY, file.as_bytes());
    assert_eq!(answer.status, 202, "{}", answer.json());
    let job = server.ended_in("logs", answer.json()["id"].as_str().expect("an id"));
    assert_eq!(
        (&job["status"], &job["attempts"]),
        (&"failed".into(), &1.into()),
        "{job}"
    );
    let error = job["error"].as_str().unwrap_or_default();
    assert!(error.contains("--job-memory"), "{error}");
    // The same to be judged immediately: its process fails, not the server.
    let answer = server.ask_bytes("POST", "/api/v1/fdi/reports?vehicle=f550", BINARY, file.as_bytes());
    let detail = answer.json()["detail"].as_str().unwrap_or_default().to_owned();
    assert_eq!(answer.status, 422, "{detail}");
    assert!(detail.contains("--job-memory"), "{detail}");
    let peak = peak_memory(server.process().pid) >> 20;
    assert!(peak < 300, "the server took {peak} MB");
    let id = server.submit(&serde_json::from_str(HOVER).expect("JSON"));
    assert_eq!(server.ended(&id)["status"], "done", "a flight needs less");
}

/// Unfinished heads that are open at the same time.
const HALF_HEADS: usize = 900;
/// The time-outs of docs/server.md: of a head (or the pause before the next one), between two pieces of a body, of an unread response.
const HEAD: Duration = Duration::from_secs(15);
const BODY_PAUSE: Duration = Duration::from_secs(30);
const UNREAD: Duration = Duration::from_secs(60);
/// How much later a connection may be closed.
const LATE: Duration = Duration::from_secs(10);
/// Longest wait of another client for its answer, on a busy machine.
const SERVED: Duration = Duration::from_secs(15);

/// A client that does not go on.
struct Stalled {
    what: &'static str,
    stream: TcpStream,
    /// The server's and its own.
    ports: (u16, u16),
    since: Instant,
    limit: Duration,
    held: Option<Duration>,
}

impl Stalled {
    fn new(server: &Server, what: &'static str, limit: Duration, words: &[u8]) -> Self {
        let mut stream = server.connect();
        stream.write_all(words).expect("it is taken");
        let ports = [stream.peer_addr(), stream.local_addr()].map(|end| end.expect("it is connected").port());
        Self {
            what,
            stream,
            ports: ports.into(),
            since: Instant::now(),
            limit,
            held: None,
        }
    }

    /// Notes when the server has closed its end. A client whose buffers are full is not told, so the kernel is asked.
    fn look(&mut self, open: &BTreeSet<(u16, u16)>) {
        if self.held.is_none() && !open.contains(&self.ports) {
            self.held = Some(self.since.elapsed());
        }
    }
}

/// The server's and the client's port of every connection over IPv4 that neither end has closed.
fn open_connections() -> BTreeSet<(u16, u16)> {
    const ESTABLISHED: &str = "01";
    let table = std::fs::read_to_string("/proc/net/tcp").expect("the kernel tells");
    let port = |address: &str| u16::from_str_radix(address.rsplit(':').next()?, 16).ok();
    let rows = table.lines().skip(1).filter_map(|row| {
        let mut columns = row.split_ascii_whitespace().skip(1);
        let (own, other) = (port(columns.next()?)?, port(columns.next()?)?);
        (columns.next()? == ESTABLISHED).then_some((own, other))
    });
    rows.collect()
}

/// All kinds of slow clients side by side, each closed in its own time, while a client that is slow but goes on is waited for, and one that
/// is not slow is served.
#[test]
fn scenario_half_a_request_does_not_wait_for_ever() {
    const FILE: &[u8] = b"time_s";
    let scratch = Scratch::new();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &["--workers", "0"]);
    let upload = |length: usize, begin: &[u8]| {
        let head = format!(
            "POST /api/v1/logs?name=a.csv HTTP/1.1\r\nhost: localhost\r\ncontent-type: text/csv\r\ncontent-length: {length}\r\n\r\n"
        );
        [head.as_bytes(), begin].concat()
    };
    // 40 MB of responses: more than the buffers of both ends hold.
    let unread = b"GET /api/v1/docs/swagger-ui-bundle.js HTTP/1.1\r\nhost: localhost\r\n\r\n".repeat(30);
    let mut stalled = vec![
        Stalled::new(&server, "half an upload", BODY_PAUSE, &upload(1000, FILE)),
        Stalled::new(&server, "an unread download", UNREAD, &unread),
        Stalled::new(
            &server,
            "an idle connection",
            HEAD,
            b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n",
        ),
    ];
    // A byte each 8 s: more than the time of a pause in all.
    let mut going_on = server.connect();
    going_on.write_all(&upload(FILE.len(), b"")).expect("it is taken");
    let mut rest = FILE.iter();
    let mut next = Instant::now() + Duration::from_secs(8);
    stalled.extend((0..HALF_HEADS).map(|_| Stalled::new(&server, "half a head", HEAD, b"GET / HTTP/1.1\r\nhost: loc")));
    let open = open_connections();
    stalled.iter_mut().for_each(|client| client.look(&open));
    let held = stalled.iter().filter(|client| client.held.is_none()).count();
    assert_eq!(held, stalled.len(), "all of them are open at the same time");

    let begun = Instant::now();
    let (mut served, mut slowest) = (0, Duration::ZERO);
    while stalled.iter().any(|client| client.held.is_none()) && begun.elapsed() < UNREAD + LATE {
        let asked = Instant::now();
        assert_eq!(server.ask("GET", "/api/v1/runs", &[], "").status, 200);
        served += 1;
        slowest = slowest.max(asked.elapsed());
        if Instant::now() >= next
            && let Some(byte) = rest.next()
        {
            going_on.write_all(&[*byte]).expect("it is taken");
            next += Duration::from_secs(8);
        }
        let open = open_connections();
        stalled.iter_mut().for_each(|client| client.look(&open));
        std::thread::sleep(Duration::from_millis(200));
    }
    println!("{served} answers to another client, the slowest after {slowest:?}");
    assert!(slowest < SERVED, "another client waited for {slowest:?}");
    for client in &stalled {
        let (what, limit) = (client.what, client.limit);
        let held = client
            .held
            .unwrap_or_else(|| panic!("{what} is still open after {:?}", client.since.elapsed()));
        // It is the pause that counts: the connection is older than that.
        assert!(
            held + Duration::from_secs(1) >= limit && held <= limit + LATE,
            "{what} was closed after {held:?}"
        );
    }
    let answer = |stream: &mut TcpStream| {
        let mut said = Vec::new();
        stream.read_to_end(&mut said).expect("an answer, and the end");
        String::from_utf8_lossy(&said).into_owned()
    };
    let said = answer(&mut stalled[0].stream);
    assert!(
        said.starts_with("HTTP/1.1 400 ") && said.contains("arrived incomplete"),
        "{said}"
    );
    going_on.shutdown(Shutdown::Write).expect("it is open");
    let said = answer(&mut going_on);
    assert!(said.starts_with("HTTP/1.1 202 "), "{said}");
}

#[test]
fn scenario_a_head_that_is_too_large_is_refused_with_the_reason() {
    let scratch = Scratch::new();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &["--workers", "0"]);
    let path = |bytes: usize| format!("/api/v1/runs?name={}", "a".repeat(bytes));
    let names: Vec<String> = (0..600).map(|number| format!("x-{number}")).collect();
    let many = |count: usize| {
        names[..count]
            .iter()
            .map(|name| (name.as_str(), "1"))
            .collect::<Vec<_>>()
    };
    let large = "a".repeat(65 << 10);
    for (path, headers, status, kind, detail) in [
        (
            path(33 << 10),
            vec![],
            414,
            "uri-too-long",
            "path and query have 33810 bytes",
        ),
        (path(60 << 10), vec![], 414, "uri-too-long", "expected at most 32768"),
        (path(1), many(101), 431, "headers-too-large", "expected at most 100"),
        (path(1), many(400), 431, "headers-too-large", "expected at most 100"),
        (
            path(1),
            vec![("x-large", &*large)],
            431,
            "headers-too-large",
            "expected at most 65536",
        ),
    ] {
        let answer = server.ask("GET", &path, &headers, "");
        let said = String::from_utf8_lossy(&answer.body).into_owned();
        assert_eq!(answer.status, status, "{said}");
        let head = answer.headers.to_ascii_lowercase();
        assert!(head.contains("content-type: application/problem+json"), "{head}");
        assert!(head.contains("content-security-policy: "), "{head}");
        let problem = answer.json();
        assert_eq!(problem["status"], status, "{said}");
        assert_eq!(problem["type"], format!("/problems/{kind}"), "{said}");
        assert!(
            problem["detail"].as_str().is_some_and(|text| text.contains(detail)),
            "{said}"
        );
    }
    // What fits is taken.
    assert_eq!(server.ask("GET", &path(30 << 10), &many(99), "").status, 200);
    // Beyond what the parser takes there is a status, and the server goes on.
    assert_eq!(server.ask("GET", &path(70_000), &[], "").status, 414);
    assert_eq!(server.ask("GET", &path(1), &many(600), "").status, 431);
    assert_eq!(server.ask("GET", "/healthz", &[], "").status, 200);
}

/// Campaigns whose few lines mean much: a process of its own takes the harm, and others are served meanwhile.
#[test]
fn scenario_a_campaign_takes_neither_memory_nor_time_of_the_server() {
    let scratch = Scratch::new();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &["--workers", "0"]);
    let campaign = |rest: &str| {
        let text = format!("name = \"x\"\ndescription = \"d\"\nscenario = \"../scenarios/short-hover.toml\"\n{rest}");
        serde_json::json!({ "text": text }).to_string()
    };
    // 200 million settings in 15 kB.
    let keys: Vec<String> = (0..2000).map(|number| format!("\"k{number}\"")).collect();
    let keys = format!(
        "[[axis]]\nname = \"a\"\nrange = [0, 99999]\nkeys = [{}]\n",
        keys.join(",")
    );
    let grid = ["a", "b", "c"].map(|name| format!("[[axis]]\nname = \"{name}\"\nrange = [0, 99999]\nkey = \"seed\"\n"));
    for (rest, status, words) in [
        (&*keys, 422, "256 MB of memory allowed; expected fewer keys or values"),
        (&*format!("x = {}", "[".repeat(250_000)), 422, "recurs"),
        (&*format!("x = {}", "{ a = ".repeat(40_000)), 422, "recurs"),
        (&*format!("set.{}a = 1", "a.".repeat(120_000)), 422, "recurs"),
        ("flights = 1000000000000000000", 422, "expected 1 to 100000000"),
        (&*grid.concat(), 422, "expected at most 100000000 flights"),
        (
            &*format!("x = \"{}\"", "a".repeat(256 << 10)),
            413,
            "expected a campaign of at most 262144",
        ),
    ] {
        let answer = server.ask("POST", "/api/v1/campaigns", &[], &campaign(rest));
        let said = String::from_utf8_lossy(&answer.body).into_owned();
        assert_eq!(answer.status, status, "{rest:.60}: {said}");
        let detail = answer.json()["detail"].as_str().unwrap_or_default().to_owned();
        assert!(
            detail.contains(words) && !detail.contains("temporary-library"),
            "{rest:.60}: {detail}"
        );
    }

    // 32,500 flights are tried, which takes many seconds. The process ends with its caller.
    let values: Vec<String> = (0..1000).map(|number| format!("0.{}", 5000 + number)).collect();
    let axes = (0..32).map(|number| {
        let key = "initial.state_of_charge";
        format!(
            "[[axis]]\nname = \"a{number}\"\npick = \"any\"\nkey = \"{key}\"\nvalues = [{}]\n",
            values.join(",")
        )
    });
    let caller = server.send(
        "POST",
        "/api/v1/campaigns",
        &[],
        &campaign(&format!("flights = 500\n{}", axes.collect::<String>())),
    );
    let mut checks = Vec::new();
    wait_until(Duration::from_secs(20), || {
        checks = Process::children(server.process().pid);
        checks.retain(|(_, words)| words.windows(2).any(|two| two == QUESTION));
        !checks.is_empty()
    })
    .expect("a process of its own");
    for path in ["/healthz", "/api/v1/campaigns", "/api/v1/runs", "/readyz"] {
        let asked = Instant::now();
        assert_eq!(server.ask("GET", path, &[], "").status, 200, "{path}");
        assert!(asked.elapsed() < SERVED, "{path}: {:?}", asked.elapsed());
    }
    let (check, _) = &checks[0];
    assert!(check.is_alive(), "the others were not served after it, but meanwhile");
    drop(caller);
    wait_until(Duration::from_secs(20), || !check.is_alive()).expect("it ends with its caller");

    let answer = server.ask("POST", "/api/v1/campaigns", &[], &campaign("flights = 2"));
    assert_eq!(answer.status, 202, "{}", answer.json());
    let peak = peak_memory(server.process().pid) >> 20;
    assert!(peak < 300, "the server took {peak} MB");
    let left = std::fs::read_dir(scratch.path("data")).expect("readable").flatten();
    let left: Vec<_> = left.map(|entry| entry.file_name()).collect();
    assert!(
        !left
            .iter()
            .any(|name| name.to_string_lossy().starts_with("temporary-library")),
        "{left:?}"
    );
}

/// How a process is started that answers a question, which it reads from its standard input.
const QUESTION: [&str; 2] = ["job", "-"];

/// A campaign with many values to try: reading it takes seconds.
fn slow_to_read() -> String {
    let values: Vec<String> = (0..1000).map(|number| format!("0.{}", 5000 + number)).collect();
    let axes = (0..6).map(|number| {
        format!(
            "[[axis]]\nname = \"a{number}\"\npick = \"any\"\nkey = \"initial.state_of_charge\"\nvalues = [{}]\n",
            values.join(",")
        )
    });
    let head = "name = \"x\"\ndescription = \"d\"\nscenario = \"../scenarios/short-hover.toml\"\nflights = 50\n";
    format!("{head}{}", axes.collect::<String>())
}

/// What was accepted once is read again for the run of one of its flights: by a process with the same limits.
#[test]
fn scenario_a_flight_of_a_campaign_is_planned_in_a_process_of_its_own() {
    let scratch = Scratch::new();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &["--workers", "0"]);
    let id = server.submit_to("campaigns", &serde_json::json!({ "text": slow_to_read() }));
    let path = format!("/api/v1/campaigns/{id}/flights");
    let caller = server.send("POST", &format!("{path}/7/run"), &[], "");
    let mut planning = None;
    wait_until(Duration::from_secs(20), || {
        let mut children = Process::children(server.process().pid).into_iter();
        planning = children.find(|(_, words)| words.windows(2).any(|two| two == QUESTION));
        planning.is_some()
    })
    .expect("a process of its own");
    let (planning, _) = planning.expect("found");
    let mut limits = String::new();
    wait_until(Duration::from_secs(5), || {
        limits = std::fs::read_to_string(format!("/proc/{}/limits", planning.pid)).unwrap_or_default();
        let limit = limits.lines().find(|line| line.starts_with("Max data size"));
        limit.is_some_and(|line| line.contains("256000000"))
    })
    .unwrap_or_else(|| panic!("it may take more memory than 256 MB: {limits}"));
    let asked = Instant::now();
    assert_eq!(server.ask("GET", "/healthz", &[], "").status, 200);
    assert!(asked.elapsed() < SERVED, "{:?}", asked.elapsed());
    drop(caller);
    wait_until(Duration::from_secs(20), || !planning.is_alive()).expect("it ends with its caller");

    let run = server.ask("POST", &format!("{path}/7/run"), &[], "");
    assert_eq!(run.status, 202, "{}", run.json());
    assert_eq!(run.json()["parent"], id, "{}", run.json());
    let beyond = server.ask("POST", &format!("{path}/50/run"), &[], "");
    let detail = beyond.json()["detail"].as_str().unwrap_or_default().to_owned();
    assert_eq!(
        (beyond.status, detail.contains("expected 0 to 49")),
        (404, true),
        "{detail}"
    );
    let left = std::fs::read_dir(scratch.path("data")).expect("readable").flatten();
    let left: Vec<_> = left.map(|entry| entry.file_name()).collect();
    let temporary = left
        .iter()
        .find(|name| name.to_string_lossy().starts_with("temporary-library"));
    assert_eq!(temporary, None);
}

/// A document of short lines: reading it takes much memory and time for its size.
fn lines(bytes: usize, line: impl Fn(usize) -> String) -> String {
    let mut text = String::new();
    for number in 0.. {
        if text.len() >= bytes {
            break;
        }
        text += &line(number);
    }
    text
}

/// Requests with documents that are refused, each as (method, path, content type, body).
fn full_of_mistakes() -> Vec<(&'static str, &'static str, &'static str, String)> {
    let read = |path: &str| std::fs::read_to_string(repository().join("config").join(path)).expect("it is there");
    let (hover, vehicle) = (read("scenarios/short-hover.toml"), read("vehicles/f550.toml"));
    let text = |text: String| serde_json::json!({ "text": text }).to_string();
    let tables = |bytes| lines(bytes, |number| format!("[a{number}]\n"));
    let keys = |bytes| lines(bytes, |number| format!("k{number} = 1\n"));
    let faults = lines(900_000, |_| {
        "[[fault]]\ntime_s = 1.0\nrotor = 1\nblade = \"none\"\n".to_owned()
    });
    // Each table repeats the long key above it, wherever such a document is written.
    let (long, inner) = (
        "k".repeat(50_000),
        lines(50_000, |number| format!("a{number} = {{}}, ")),
    );
    let unfolded = format!("{long} = {{ {inner} z = 1 }}");
    // A key of a quarter of a million parts, for those who take it apart.
    let dots = format!("\"{}\" = 1\n", "a.".repeat(250_000));
    let (json, toml) = ("application/json", "application/toml");
    vec![
        ("POST", "/api/v1/runs", json, text(format!("{hover}\n{}", tables(190_000)))),
        ("POST", "/api/v1/runs", json, text(format!("{}{hover}", keys(900_000)))),
        ("POST", "/api/v1/runs", json, text(format!("{hover}\n{faults}"))),
        ("POST", "/api/v1/runs", json, text(format!("{dots}{hover}"))),
        ("POST", "/api/v1/runs", json, text(format!("{hover}\n{}", tables(1_500_000)))),
        ("POST", "/api/v1/runs", json, text(format!("seed = \"x\"\nz.{unfolded}\n"))),
        (
            "POST",
            "/api/v1/runs",
            json,
            serde_json::json!({ "scenario": "short-hover", "set": [unfolded] }).to_string(),
        ),
        (
            "POST",
            "/api/v1/runs",
            json,
            serde_json::json!({ "scenario": "short-hover", "set": [format!("a{} = 1", ".a".repeat(900_000))] }).to_string(),
        ),
        ("POST", "/api/v1/scenarios/validate", json, text(format!("{hover}\n{}", tables(850_000)))),
        ("PUT", "/api/v1/vehicles/mine", toml, format!("{vehicle}\n{}", tables(250_000))),
        (
            "POST",
            "/api/v1/fdi/sessions",
            json,
            serde_json::json!({ "vehicle_text": format!("{vehicle}\n{}", tables(850_000)) }).to_string(),
        ),
        (
            "POST",
            "/api/v1/models",
            json,
            serde_json::json!({ "name": "mine", "model": { "version": tables(850_000) } }).to_string(),
        ),
        (
            "POST",
            "/api/v1/blind-benches",
            json,
            serde_json::json!({ "n": 1, "vehicles": [{ "vehicle": "mine", "text": format!("[rotors]\n[z]\n{unfolded}"), "blades": "x = 1" }] })
                .to_string(),
        ),
    ]
}

/// Documents are read by the server itself: each with bounds, and never on the threads that answer.
#[test]
fn scenario_documents_full_of_mistakes_delay_nobody_else() {
    /// Longer than others may wait because of them.
    const DELAY: Duration = Duration::from_secs(5);
    /// Longest wait for the refusals, which have to wait for each other.
    const PATIENCE: Duration = Duration::from_secs(300);
    let scratch = Scratch::new();
    let server = Server::start_at("127.0.0.1:0", &scratch.path("data"), &["--workers", "0"]);
    let asked = || {
        let begun = Instant::now();
        assert_eq!(server.ask("GET", "/healthz", &[], "").status, 200);
        begun.elapsed()
    };
    let before = (0..10).map(|_| asked()).max().expect("ten");

    // At least as many at the same time as there are threads that answer.
    let requests = full_of_mistakes();
    let copies = 1 + std::thread::available_parallelism().map_or(1, usize::from) / requests.len();
    let mut slowest = Duration::ZERO;
    std::thread::scope(|scope| {
        let refused = |(method, path, kind, body): &(&str, &str, &str, String)| {
            let mut stream = server.send(method, path, &[("content-type", kind)], body);
            stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
            let mut answer = Vec::new();
            stream.read_to_end(&mut answer).expect("an answer");
            String::from_utf8_lossy(&answer).into_owned()
        };
        let callers: Vec<_> = std::iter::repeat_n(&requests, copies)
            .flatten()
            .map(|request| (request, scope.spawn(move || refused(request))))
            .collect();
        while callers.iter().any(|(_, caller)| !caller.is_finished()) {
            slowest = slowest.max(asked());
            std::thread::sleep(Duration::from_millis(50));
        }
        for ((_, path, _, body), caller) in callers {
            let answer = caller.join().expect("no panic");
            let told = format!("{path} {body:.60}: {answer:.400}");
            let is_refused = ["HTTP/1.0 422", "HTTP/1.0 200"]
                .iter()
                .any(|status| answer.starts_with(status));
            assert!(is_refused, "{told}");
            assert!(
                answer.starts_with("HTTP/1.0 422") || path.ends_with("/validate"),
                "{told}"
            );
        }
    });
    assert!(slowest < before + DELAY, "{slowest:?} meanwhile, {before:?} before");
    let peak = peak_memory(server.process().pid) >> 20;
    assert!(peak < 600, "the server took {peak} MB");
    assert_eq!(server.get("/api/v1/runs")["items"].as_array().map(Vec::len), Some(0));
    let id = server.ask("POST", "/api/v1/runs", &[], HOVER);
    assert_eq!(id.status, 202, "{}", id.json());
}

#[test]
fn scenario_slow_clients_do_not_hold_up_the_end() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let mut server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    let slow = |server: &Server| {
        let half_head = b"GET / HTTP/1.1\r\nhost: loc".to_vec();
        let half_upload = b"POST /api/v1/logs?name=a.csv HTTP/1.1\r\nhost: localhost\r\ncontent-type: text/csv\r\n\
             content-length: 1000\r\n\r\ntime_s"
            .to_vec();
        // 40 MB of responses that are never read.
        let unread = b"GET /api/v1/docs/swagger-ui-bundle.js HTTP/1.1\r\nhost: localhost\r\n\r\n".repeat(30);
        [half_head, half_upload, unread].map(|words| {
            let mut stream = server.connect();
            stream.write_all(&words).expect("it is taken");
            stream
        })
    };
    let open = slow(&server);
    std::thread::sleep(Duration::from_millis(500));
    let begun = Instant::now();
    assert_eq!(server.stop(), Some(0));
    assert!(begun.elapsed() < Duration::from_secs(15), "{:?}", begun.elapsed());
    drop(open);

    // The folder is free, and a second signal ends the server immediately.
    let mut server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    let open = slow(&server);
    std::thread::sleep(Duration::from_millis(500));
    let begun = Instant::now();
    server.process().signal(Signal::TERM);
    std::thread::sleep(Duration::from_millis(300));
    assert!(server.process().is_alive(), "clients have a while to go on");
    assert_eq!(server.stop(), Some(1), "the second signal");
    assert!(begun.elapsed() < Duration::from_secs(3), "{:?}", begun.elapsed());
    drop(open);
    let server = Server::start_at("127.0.0.1:0", &data, &["--workers", "0"]);
    assert_eq!(server.ask("GET", "/readyz", &[], "").status, 200);
}

#[test]
fn scenario_what_the_server_keeps_is_for_its_user_alone() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let secrets = [
        ("AWS_SECRET_ACCESS_KEY", "secret-of-a-bucket"),
        ("ROTORTWIN_TOKEN", "secret-of-a-user"),
    ];
    let server = Server::start_in(&secrets, "127.0.0.1:0", &data, &["--workers", "1"]);
    let mode = |path: &Path| std::fs::metadata(path).expect("it is there").permissions().mode() & 0o777;
    assert_eq!(mode(&data), 0o700);
    // As it writes it itself: a file that was there before is for the user alone as well.
    let alive = data.join("alive");
    wait_until(Duration::from_secs(20), || alive.exists()).expect("it shows that it lives");
    std::fs::set_permissions(&alive, std::fs::Permissions::from_mode(0o644)).expect("it is ours");
    wait_until(Duration::from_secs(20), || mode(&alive) == 0o600).expect("not for others");

    let id = server.submit(&serde_json::json!({ "scenario": "short-hover", "pace": "real-time" }));
    let mut seen = 0;
    wait_until(Duration::from_secs(20), || {
        let children = Process::children(server.process().pid);
        let flights = children
            .iter()
            .filter(|(_, words)| words.get(1).is_some_and(|word| word == "job"));
        for (process, _) in flights {
            // A process that has just ended has none.
            let environment = std::fs::read(format!("/proc/{}/environ", process.pid)).unwrap_or_default();
            let text = String::from_utf8_lossy(&environment).into_owned();
            assert!(!text.contains("secret-of-a-"), "{text}");
            seen += usize::from(text.contains("PATH="));
        }
        seen > 0
    })
    .expect("a flight is seen");
    assert_eq!(server.ended(&id)["status"], "done");
    let entries = std::fs::read_dir(&data)
        .expect("readable")
        .flatten()
        .map(|entry| entry.path());
    let open: Vec<_> = entries.filter(|path| path.is_file() && mode(path) != 0o600).collect();
    assert!(open.is_empty(), "not for the user alone: {open:?}");
}

/// Rows of docs/threat-model.md: each names a test file, and functions in it that are tests.
#[test]
fn val_the_threat_model_names_tests_that_are_there() {
    let root = repository();
    let page = std::fs::read_to_string(root.join("docs/threat-model.md")).expect("it is there");
    let rows = page.lines().filter(|line| line.starts_with("| ")).skip(1);
    let mut named = 0;
    for row in rows {
        let tests = row
            .trim_end_matches(['|', ' '])
            .rsplit(" | ")
            .next()
            .unwrap_or_default();
        let mut source = String::new();
        let before = named;
        for word in tests.split('`').skip(1).step_by(2) {
            if word.starts_with("scenario_") || word.starts_with("val_") {
                let is_test = ["#[test]\nfn ", "#[tokio::test]\n    async fn "]
                    .iter()
                    .any(|start| source.contains(&format!("{start}{word}(")));
                assert!(is_test, "{word} is no test: {row}");
                named += 1;
            } else {
                let file = match word {
                    "rotortwin-api" => root.join("services/api/src/artifacts.rs"),
                    name => root.join(format!("tests/tests/{name}.rs")),
                };
                source = std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
            }
        }
        assert!(named > before, "no test: {row}");
    }
    assert!(named > 20, "{named} tests");
}
