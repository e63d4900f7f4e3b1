//! zenoh with certificates, users and access control: members of a run fly as usual, others can neither read nor change anything.

use rotortwin_tests::certificates::certificates;
use rotortwin_tests::program::{Call, Link, PATIENCE, Run, text};
use rotortwin_tests::scratch::{Scratch, short_flight};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use zenoh::Wait as _;

/// A well-known run id: strangers must be kept out even if they know it.
const RUN: &str = "00000000000000ab";

/// Short, so that a rejection takes a second; an accepted process connects within milliseconds.
const CONNECT_MS: &str = "1000";

fn endpoint(protocol: &str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port is free");
    let port = listener.local_addr().expect("it is bound").port();
    format!("{protocol}/127.0.0.1:{port}")
}

/// A file of credentials for the owner of the certificate `name`.
fn config(scratch: &Scratch, certificates: &Path, name: &str, more: &str) -> PathBuf {
    let folder = certificates.display();
    let text = format!(
        "[tls]\nca = '{folder}/ca.pem'\ncertificate = '{folder}/{name}.pem'\nprivate_key = '{folder}/{name}-key.pem'\n{more}"
    );
    scratch.write(&format!("{name}.toml"), text)
}

/// A process of a run started by hand.
fn peer(scratch: &Scratch, who: &str, endpoint: &str, config: Option<&Path>) -> Run {
    start(scratch, who, endpoint, config, "30000")
}

/// The same without valid credentials.
fn stranger(scratch: &Scratch, who: &str, endpoint: &str, config: Option<&Path>) -> Run {
    start(scratch, who, endpoint, config, CONNECT_MS)
}

fn start(scratch: &Scratch, who: &str, endpoint: &str, config: Option<&Path>, join_ms: &str) -> Run {
    let config = config.map_or_else(String::new, |file| format!(",config={}", file.display()));
    let link = format!("zenoh:connect={endpoint}{config}");
    Call::new(
        scratch,
        [who, "--link", &link, "--run-id", RUN, "--join-timeout", join_ms],
    )
    .start()
}

/// The plant of the run [`RUN`], with the command that users start it with.
fn plant(scratch: &Scratch, scenario: &Path, link: &str, out: &str) -> Run {
    let out = scratch.path(out);
    let mut args: Vec<String> = [
        "sim",
        "--run-id",
        RUN,
        "--join-timeout",
        "60000",
        "--link",
        link,
        "--out",
    ]
    .map(str::to_owned)
    .to_vec();
    args.extend([out.display().to_string(), scenario.display().to_string()]);
    Call::new(scratch, args).start()
}

fn hash_of(scratch: &Scratch, out: &str) -> String {
    let summary = rotortwin_tests::program::read_json(&scratch.path(out).join("summary.json"));
    assert_eq!(text(&summary, "/status"), "done", "{summary}");
    text(&summary, "/run_hash").to_owned()
}

fn in_process_hash(scratch: &Scratch, scenario: &Path) -> String {
    Call::fly(scratch, Link::InProcess, scenario, "in-process")
        .run()
        .expect_code(0)
        .run_hash()
}

/// `fly` gives the three processes one credentials file; the flight is the same.
#[test]
fn scenario_credentials_change_no_bit() {
    let scratch = Scratch::new();
    let Some(folder) = certificates(&scratch, "pki", &["bench,127.0.0.1"]) else {
        return;
    };
    let scenario = scratch.write("short.toml", short_flight());
    let expected = in_process_hash(&scratch, &scenario);
    scratch.write("users", "bench: a long password\n");
    scratch.write("bench.password", "a long password\n");
    let login = "[login]\nuser = 'bench'\npassword_file = 'bench.password'\n[listen]\nusers_file = 'users'\n";
    let mutual = config(&scratch, &folder, "bench", "");
    for (name, file) in [
        ("with-certificates", mutual),
        ("with-users", scratch.write("users.toml", login)),
        ("with-both", config(&scratch, &folder, "bench", login)),
    ] {
        let call =
            Call::fly(&scratch, Link::Zenoh, &scenario, name).with(["--zenoh-config".into(), file.into_os_string()]);
        assert_eq!(call.run().expect_code(0).run_hash(), expected, "{name}");
    }
}

/// A peer with no certificate, a foreign one, or a wrong password is told so; the run keeps waiting and flies with the right peers.
#[test]
fn scenario_strangers_are_not_let_in() {
    let scratch = Scratch::new();
    let Some(folder) = certificates(&scratch, "pki", &["plant,127.0.0.1", "controller", "fdi"]) else {
        return;
    };
    let Some(foreign) = certificates(&scratch, "foreign", &["controller"]) else {
        return;
    };
    let scenario = scratch.write("short.toml", short_flight());
    let expected = in_process_hash(&scratch, &scenario);
    scratch.write("users", "plant:p\ncontroller:c\nfdi:f\n");
    for (file, password) in [("c", "c\n"), ("f", "f\n"), ("wrong", "guessed-password\n")] {
        scratch.write(file, password);
    }
    let login = |user: &str, file: &str| format!("[login]\nuser = '{user}'\npassword_file = '{file}'\n");
    let listen = "[listen]\nusers_file = 'users'\n[[listen.allow]]\ncertificates = ['controller']\nusers = ['controller']\n\
                  roles = ['controller']\n[[listen.allow]]\ncertificates = ['fdi']\nusers = ['fdi']\nroles = ['fdi']\n";
    let endpoint = endpoint("tls");
    let plant_config = config(&scratch, &folder, "plant", listen);
    let link = format!("zenoh:listen={endpoint},config={}", plant_config.display());
    let flight = plant(&scratch, &scenario, &link, "strangers");
    // It listens once it has answered.
    std::thread::sleep(std::time::Duration::from_millis(500));
    let ca_only = scratch.write("ca-only.toml", format!("[tls]\nca = '{}/ca.pem'\n", folder.display()));
    let no_user = config(&scratch, &folder, "controller", "");
    let no_user = scratch.write("no-user.toml", std::fs::read(no_user).expect("it was written"));
    let forged = config(&scratch, &foreign, "controller", &login("controller", "c"));
    let forged = scratch.write(
        "forged.toml",
        std::fs::read_to_string(forged).expect("it was written").replace(
            &format!("{}/ca.pem", foreign.display()),
            &format!("{}/ca.pem", folder.display()),
        ),
    );
    let other_ca = config(&scratch, &foreign, "controller", &login("controller", "c"));
    let other_ca = scratch.write("other-ca.toml", std::fs::read(other_ca).expect("it was written"));
    let guessed = config(&scratch, &folder, "controller", &login("controller", "wrong"));
    let guessed = scratch.write("guessed.toml", std::fs::read(guessed).expect("it was written"));
    let in_plain = endpoint.replacen("tls/", "tcp/", 1);
    for (name, endpoint, config, words) in [
        (
            "in plain",
            &in_plain,
            None,
            &["no certificate and no user", "config=FILE"][..],
        ),
        (
            "without a certificate",
            &endpoint,
            Some(&ca_only),
            &["shows no certificate and no user"],
        ),
        (
            "without a user",
            &endpoint,
            Some(&no_user),
            &["shows the certificate", "no user"],
        ),
        (
            "with a forged certificate",
            &endpoint,
            Some(&forged),
            &["shows the certificate", "foreign/controller.pem"],
        ),
        (
            "believing in another authority",
            &endpoint,
            Some(&other_ca),
            &["trusts", "foreign/ca.pem"],
        ),
        (
            "with a guessed password",
            &endpoint,
            Some(&guessed),
            &["the user \"controller\" with a password"],
        ),
    ] {
        let ended = stranger(&scratch, "controller", endpoint, config.map(PathBuf::as_path))
            .end(PATIENCE)
            .expect_code(2);
        let said = ended.stderr.concat();
        for word in words.iter().chain(&["connecting to", "rejects"]) {
            assert!(said.contains(word), "{name}: {word:?} is not in: {said}");
        }
        assert!(!said.contains("guessed-password"), "{said}");
    }
    // A certificate is valid for its own role only: the FDI engine's is not accepted from a controller.
    let fdi_config = config(&scratch, &folder, "fdi", &login("fdi", "f"));
    let ended = stranger(&scratch, "controller", &endpoint, Some(&fdi_config))
        .end(PATIENCE)
        .expect_code(1);
    assert!(
        ended.stderr.concat().contains("the plant did not"),
        "{:?}",
        ended.stderr
    );
    let controller_config = config(&scratch, &folder, "controller", &login("controller", "c"));
    let controller = peer(&scratch, "controller", &endpoint, Some(&controller_config));
    let fdi = peer(&scratch, "fdi", &endpoint, Some(&fdi_config));
    controller.end(PATIENCE).expect_code(0);
    fdi.end(PATIENCE).expect_code(0);
    flight.end(PATIENCE).expect_code(0);
    assert_eq!(hash_of(&scratch, "strangers"), expected);
}

/// Not one of our messages.
const NONSENSE: [u8; 40] = [0xff; 40];

/// What a zenoh session outside the run can do.
struct Spy {
    session: zenoh::Session,
    heard: Arc<AtomicU64>,
}

impl Spy {
    /// Opens a session with the certificate `name`; an error message if it is rejected.
    fn open(endpoint: &str, certificates: Option<(&Path, &str)>) -> Result<Self, String> {
        let mut config = zenoh::Config::default();
        let mut set =
            |key: &str, value: String| config.insert_json5(key, &value).expect("the setting is one of zenoh's");
        set("mode", "\"client\"".to_owned());
        set("connect/endpoints", format!("[{endpoint:?}]"));
        set("connect/timeout_ms", CONNECT_MS.to_owned());
        set("connect/exit_on_failure", "true".to_owned());
        set("scouting/multicast/enabled", "false".to_owned());
        if let Some((folder, name)) = certificates {
            let file = |name: &str| format!("{:?}", folder.join(name).display().to_string());
            set("transport/link/tls/root_ca_certificate", file("ca.pem"));
            set("transport/link/tls/enable_mtls", "true".to_owned());
            set("transport/link/tls/connect_certificate", file(&format!("{name}.pem")));
            set(
                "transport/link/tls/connect_private_key",
                file(&format!("{name}-key.pem")),
            );
        }
        let session = zenoh::open(config).wait().map_err(|error| error.to_string())?;
        let heard = Arc::new(AtomicU64::new(0));
        Ok(Self { session, heard })
    }

    /// Counts messages received on the topics that carry the flight.
    fn listen(&self, space: &str) {
        for key in [
            format!("{space}/v1/{RUN}/sensors"),
            format!("{space}/v1/{RUN}/command"),
            format!("{space}/v1/{RUN}/setup/controller"),
            format!("{space}/v1/*/sensors"),
            "**".to_owned(),
        ] {
            let heard = Arc::clone(&self.heard);
            self.session
                .declare_subscriber(key)
                .callback(move |sample| {
                    // A session hears itself as well.
                    let bytes = sample.payload().to_bytes();
                    if !bytes.is_empty() && bytes.as_ref() != NONSENSE {
                        heard.fetch_add(1, Ordering::Relaxed);
                    }
                })
                .background()
                .wait()
                .expect("asking is free");
        }
    }

    /// Sends messages that would end or spoil the run if accepted, until the flight is over.
    fn disturb(&self, space: &str, mut is_over: impl FnMut() -> bool) {
        let token = self
            .session
            .liveliness()
            .declare_token(format!("{space}/v1/{RUN}/alive/controller"));
        let token = token.wait().expect("saying so is free");
        let mut token = Some(token);
        while !is_over() {
            for topic in ["command", "sensors", "steps", "setup/controller", "finish"] {
                let key = format!("{space}/v1/{RUN}/{topic}");
                self.session
                    .put(key.as_str(), NONSENSE)
                    .wait()
                    .expect("saying so is free");
                self.session.delete(key.as_str()).wait().expect("saying so is free");
            }
            // As if the controller had died.
            drop(token.take());
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
    }
}

/// A peer accepted for another role cannot read the flight or speak for others; without access control the same session reads it and
/// ends it.
#[test]
fn scenario_a_peer_speaks_for_itself_only() {
    let scratch = Scratch::new();
    let Some(folder) = certificates(&scratch, "pki", &["plant,127.0.0.1", "controller", "fdi", "spy"]) else {
        return;
    };
    let scenario = scratch.write("short.toml", short_flight());
    let expected = in_process_hash(&scratch, &scenario);
    let listen = "[[listen.allow]]\ncertificates = ['controller']\nroles = ['controller']\n\
                  [[listen.allow]]\ncertificates = ['fdi']\nroles = ['fdi']\n\
                  [[listen.allow]]\ncertificates = ['spy']\nspace = 'elsewhere'\n";
    let plant_config = config(&scratch, &folder, "plant", listen);
    let controller_config = config(&scratch, &folder, "controller", "");
    let fdi_config = config(&scratch, &folder, "fdi", "");
    for intruder in ["fdi", "spy"] {
        let endpoint = endpoint("tls");
        let link = format!("zenoh:listen={endpoint},config={}", plant_config.display());
        let mut flight = plant(&scratch, &scenario, &link, intruder);
        let spy = loop {
            // Until the plant is listening.
            if let Ok(spy) = Spy::open(&endpoint, Some((&folder, intruder))) {
                break spy;
            }
            assert!(!flight.has_ended(), "the plant waits for its peers");
        };
        assert!(
            Spy::open(&endpoint, None).is_err(),
            "a session without a certificate was opened"
        );
        spy.listen("rotortwin");
        let controller = peer(&scratch, "controller", &endpoint, Some(&controller_config));
        let fdi = peer(&scratch, "fdi", &endpoint, Some(&fdi_config));
        spy.disturb("rotortwin", || flight.has_ended());
        for run in [controller, fdi, flight] {
            run.end(PATIENCE).expect_code(0);
        }
        assert_eq!(hash_of(&scratch, intruder), expected, "{intruder}");
        // The FDI engine's certificate may receive liveliness, its configuration and the steps, and requested none of these.
        assert_eq!(spy.heard.load(Ordering::Relaxed), 0, "{intruder} heard of the flight");
    }
    // Without access control the spy does succeed.
    let endpoint = endpoint("tcp");
    let mut flight = plant(&scratch, &scenario, &format!("zenoh:listen={endpoint}"), "open");
    let spy = loop {
        if let Ok(spy) = Spy::open(&endpoint, None) {
            break spy;
        }
        assert!(!flight.has_ended(), "the plant waits for its peers");
    };
    spy.listen("rotortwin");
    let peers = ["controller", "fdi"].map(|who| peer(&scratch, who, &endpoint, None));
    spy.disturb("rotortwin", || flight.has_ended());
    drop(peers);
    flight.end(PATIENCE).expect_code(1);
    assert!(spy.heard.load(Ordering::Relaxed) > 0, "an open run can be heard");
}

/// At a router a space belongs to a tenant: another tenant with a valid certificate can neither read nor change anything.
#[test]
fn scenario_a_router_keeps_spaces_apart() {
    let scratch = Scratch::new();
    let Some(folder) = certificates(&scratch, "pki", &["router,127.0.0.1", "bench-1", "bench-2"]) else {
        return;
    };
    let scenario = scratch.write("short.toml", short_flight());
    let expected = in_process_hash(&scratch, &scenario);
    let router_config = config(
        &scratch,
        &folder,
        "router",
        "[[listen.allow]]\ncertificates = ['bench-1']\nspace = 'one'\n[[listen.allow]]\ncertificates = ['bench-2']\nspace = 'two'\n",
    );
    let endpoint = endpoint("tls");
    let file = router_config.display().to_string();
    let router = Call::new(&scratch, ["router", "--listen", &endpoint, "--zenoh-config", &file]).start();
    let spy = loop {
        if let Ok(spy) = Spy::open(&endpoint, Some((&folder, "bench-2"))) {
            break spy;
        }
        assert!(router.supervisor().is_alive(), "the router routes");
    };
    spy.listen("one");
    let space = std::fs::read_to_string(config(&scratch, &folder, "bench-1", "")).expect("it was written");
    let bench = scratch.write("bench-1.toml", format!("space = 'one'\n{space}"));
    let link = format!("zenoh:connect={endpoint},config={}", bench.display());
    let mut flight = plant(&scratch, &scenario, &link, "router");
    let peers = ["controller", "fdi"].map(|who| peer(&scratch, who, &endpoint, Some(&bench)));
    spy.disturb("one", || flight.has_ended());
    for run in peers.into_iter().chain([flight]) {
        run.end(PATIENCE).expect_code(0);
    }
    assert_eq!(hash_of(&scratch, "router"), expected);
    assert_eq!(spy.heard.load(Ordering::Relaxed), 0);
    // In the other tenant's space the router would carry nothing of ours.
    let lost = scratch.write("bench-1-lost.toml", format!("space = 'two'\n{space}"));
    let link = format!("zenoh:connect={endpoint},config={}", lost.display());
    let args = [
        "controller",
        "--link",
        &link,
        "--run-id",
        RUN,
        "--join-timeout",
        CONNECT_MS,
    ];
    let ended = Call::new(&scratch, args).run().expect_code(1);
    assert!(
        ended.stderr.concat().contains("the plant did not"),
        "{:?}",
        ended.stderr
    );
    router.supervisor().signal(rustix::process::Signal::TERM);
    router.end(PATIENCE).expect_code(0);
}
