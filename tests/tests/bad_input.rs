//! Bad input of every kind: exit code 2, one sentence that names the thing and what was expected, nothing written.

use rotortwin_tests::disk::Disk;
use rotortwin_tests::program::{Call, Ended, Link, PATIENCE};
use rotortwin_tests::scratch::{Scratch, hover, repository, shipped_scenario, short_flight};
use std::ffi::OsString;
use std::net::TcpListener;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};

/// Checks the answer to bad input: exit code 2, nothing on standard output, and one sentence on standard error with all `words`.
#[track_caller]
fn assert_refused(what: &str, ended: &Ended, words: &[&str]) {
    let printed = ended.stderr.join("\n");
    assert_eq!(ended.code, Some(2), "{what}: {printed}");
    assert_eq!(ended.stdout, "", "{what}");
    assert_eq!(ended.stderr.len(), 1, "{what}: one sentence is expected:\n{printed}");
    assert!(printed.starts_with("rotortwin: "), "{what}: {printed}");
    for word in words {
        assert!(printed.contains(word), "{what}: {word:?} is not in: {printed}");
    }
}

/// Calls the program and checks its answer, and that it leaves nothing behind.
#[track_caller]
fn refuses(scratch: &Scratch, what: &str, call: Call, words: &[&str]) {
    let before = scratch.listing();
    assert_refused(what, &call.run(), words);
    assert_eq!(scratch.listing(), before, "{what}: something was written");
    assert!(scratch.shared_memory().is_empty(), "{what}: shared memory is left");
}

/// `fly` and `check` refuse a scenario with the same sentence.
#[track_caller]
fn refuses_scenario(what: &str, scratch: &Scratch, path: &Path, words: &[&str]) {
    refuses(
        scratch,
        what,
        Call::new(scratch, [OsString::from("check"), path.into()]),
        words,
    );
    for link in [Link::InProcess, Link::Iceoryx2] {
        refuses(scratch, what, Call::fly(scratch, link, path, "out"), words);
    }
    // Without --out the run folder would be created under runs/ in the current folder.
    refuses(
        scratch,
        what,
        Call::new(scratch, [OsString::from("fly"), path.into()]),
        words,
    );
}

#[test]
fn scenario_documents_that_cannot_be_flown() {
    let fault = |lines: &str| hover("bad", 2.0, &format!("[[fault]]\n{lines}\n"));
    let replaced = |from: &str, to: &str| {
        let text = hover("bad", 2.0, "");
        assert!(text.contains(from), "{from} stands in the scenario");
        text.replace(from, to)
    };
    let table: &[(&str, String, &[&str])] = &[
        (
            "unknown key",
            replaced("duration_s", "colour = 3\nduration_s"),
            &["line 4", "`colour`", "unknown key"],
        ),
        (
            "unknown section",
            hover("bad", 2.0, "[weather]\n"),
            &["line 8", "weather`", "unknown key"],
        ),
        (
            "wrong unit",
            replaced("duration_s", "duration_ms"),
            &["line 4", "`duration_ms`", "expected `duration_s`"],
        ),
        ("missing key", replaced("name = 'bad'\n", ""), &["`name`", "missing"]),
        (
            "wrong type",
            replaced("2.0", "'two'"),
            &["line 4", "`duration_s`", "expected a number"],
        ),
        (
            "out of range",
            replaced("2.0", "-2.0"),
            &["`duration_s`", "expected a number from 0.0025 to 86400 s, got -2"],
        ),
        (
            "not a number",
            replaced("2.0", "nan"),
            &["`duration_s`", "expected a number", "got NaN"],
        ),
        (
            "infinite",
            replaced("-5.0]", "-inf]"),
            &["`trajectory.position_ned_m[2]`", "got -inf"],
        ),
        (
            "not TOML",
            replaced("[trajectory]", "[trajectory"),
            &["line 5", "expected valid TOML"],
        ),
        (
            "same key twice",
            replaced("duration_s", "name = 'again'\nduration_s"),
            &["line 4", "duplicate key"],
        ),
        (
            "missing vehicle",
            replaced("f550.toml", "f551.toml"),
            &["`vehicle`", "f551.toml", "found none"],
        ),
        (
            "vehicle is a folder",
            replaced("vehicles/f550.toml", "vehicles"),
            &["`vehicle`", "expected the path of a TOML file"],
        ),
        (
            "rotor 7 of 6",
            fault("time_s = 1.0\nrotor = 7\nblade = 'b'"),
            &["`fault[0].rotor`", "from 1 to 6, got 7"],
        ),
        (
            "rotor 0",
            fault("time_s = 1.0\nrotor = 0\nblade = 'b'"),
            &["`fault[0].rotor`", "from 1 to 6, got 0"],
        ),
        (
            "unknown blade",
            fault("time_s = 1.0\nrotor = 1\nblade = 'q'"),
            &["`fault[0].blade`", "expected one of", "got q"],
        ),
        (
            "same blade",
            fault("time_s = 1.0\nrotor = 1\nblade = 'a'"),
            &["`fault[0].blade`", "cannot have an effect"],
        ),
        (
            "fault too late",
            fault("time_s = 2.0\nrotor = 1\nblade = 'b'"),
            &["`fault[0].time_s`", "cannot have an effect"],
        ),
        (
            "loss above 100 %",
            fault("time_s = 1.0\nrotor = 1\nthrust_loss_percent = 101"),
            &["`fault[0].thrust_loss_percent`"],
        ),
        (
            "wind, no drag",
            hover("bad", 2.0, "[wind]\nmean_ned_m_s = [5, 0, 0]\n"),
            &["`wind`", "cannot have an effect"],
        ),
    ];
    for (what, text, words) in table {
        let scratch = Scratch::new();
        let path = scratch.write("bad.toml", text);
        let words: Vec<&str> = ["bad.toml"].iter().chain(*words).copied().collect();
        refuses_scenario(what, &scratch, &path, &words);
    }
}

/// How a shipped document is spoilt.
enum Spoilt {
    /// The first text, once, becomes the second.
    Replaced(&'static str, &'static str),
    /// Lines with any of these texts are left out.
    Without(&'static [&'static str]),
}

impl Spoilt {
    #[track_caller]
    fn apply(&self, text: &str) -> String {
        let spoilt = match self {
            Self::Replaced(from, to) => text.replacen(from, to, 1),
            Self::Without(words) => {
                let kept = text
                    .lines()
                    .filter(|line| !words.iter().any(|word| line.contains(word)));
                kept.map(|line| format!("{line}\n")).collect()
            }
        };
        assert_ne!(spoilt, text, "there is something to spoil");
        spoilt
    }
}

#[test]
fn scenario_vehicles_that_cannot_be_flown() {
    use Spoilt::{Replaced, Without};
    let third = "[-0.30, 0.20, 0.0]";
    let table: &[(&str, &str, Spoilt, &[&str])] = &[
        (
            "wrong unit",
            "f550",
            Replaced("mass_kg", "mass_g"),
            &["f550.toml", "`body.mass_g`", "expected `mass_kg`"],
        ),
        (
            "out of range",
            "f550",
            Replaced("= 1.55", "= 1550.0"),
            &["f550.toml", "`body.mass_kg`", "0.02 to 200", "got 1550"],
        ),
        (
            "not a number",
            "f550",
            Replaced("= 1.55", "= nan"),
            &["f550.toml", "`body.mass_kg`", "got NaN"],
        ),
        (
            "too heavy",
            "f550",
            Replaced("= 1.55", "= 15.5"),
            &["bad.toml", "`vehicle`", "cannot hover"],
        ),
        (
            "missing blades",
            "f550",
            Replaced("t9545", "t9546"),
            &["f550.toml", "`rotors.blades`", "t9546.toml"],
        ),
        (
            "a rotor twice",
            "hexa-h",
            Replaced("number = 2", "number = 3"),
            &["hexa-h.toml", "rotor 3 is given twice"],
        ),
        (
            "coaxial",
            "hexa-h",
            Replaced(third, "[0.30, 0.20, -0.1]"),
            &["hexa-h.toml", "rotors 1 and 3 are coaxial and turn the same way"],
        ),
        (
            "same position",
            "hexa-h",
            Replaced(third, "[0.30, 0.20, 0.0]"),
            &["hexa-h.toml", "rotors 1 and 3 are coaxial and turn the same way"],
        ),
        (
            "three rotors",
            "hexa-h",
            Without(&["number = 4", "number = 5", "number = 6"]),
            &["hexa-h.toml", "`rotors.layout.rotor`", "4 to 16 rotors, got 3"],
        ),
    ];
    for (what, vehicle, spoilt, words) in table {
        let scratch = Scratch::new();
        for file in ["vehicles/f550.toml", "vehicles/hexa-h.toml", "blades/t9545.toml"] {
            let text = std::fs::read_to_string(repository().join("config").join(file)).expect("it is shipped");
            scratch.write(
                file,
                if file.contains(vehicle) {
                    spoilt.apply(&text)
                } else {
                    text
                },
            );
        }
        let text = hover("bad", 2.0, "");
        let line = text
            .lines()
            .find(|line| line.starts_with("vehicle"))
            .expect("it names a vehicle")
            .to_owned();
        let path = scratch.write(
            "bad.toml",
            text.replace(&line, &format!("vehicle = 'vehicles/{vehicle}.toml'")),
        );
        refuses_scenario(what, &scratch, &path, words);
    }
}

#[test]
fn scenario_files_that_are_no_documents() {
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path("folder.toml")).expect("a folder can be made");
    scratch.write("binary.toml", [0xff, 0xfe, 0x00]);
    scratch.write("empty.toml", "");
    scratch.write("huge.toml", "# nothing\n".repeat(200_000));
    std::os::unix::fs::symlink("loop.toml", scratch.path("loop.toml")).expect("a link can be made");
    for (name, words) in [
        ("none.toml", ["none.toml", "file not found"]),
        ("folder.toml", ["folder.toml", "not a regular file"]),
        ("binary.toml", ["binary.toml", "expected UTF-8"]),
        ("empty.toml", ["empty.toml", "`name`"]),
        ("huge.toml", ["huge.toml", "at most 1048576 bytes"]),
        ("loop.toml", ["loop.toml", ""]),
        ("empty.toml/below.toml", ["empty.toml/below.toml", ""]),
    ] {
        refuses_scenario(name, &scratch, &scratch.path(name), &words);
    }
    // An endless file must not be read to its end.
    refuses(
        &scratch,
        "device",
        Call::new(&scratch, ["fly", "/dev/zero"]),
        &["/dev/zero", "not a regular file"],
    );
    let strange = PathBuf::from(OsString::from_vec(b"n\xffne.toml".to_vec()));
    refuses(
        &scratch,
        "name",
        Call::new(&scratch, [OsString::from("fly"), strange.into()]),
        &["file not found"],
    );
}

/// Unusual but valid paths: not UTF-8, or looking like an option.
#[test]
fn scenario_strange_paths_are_no_bad_input() {
    for name in [
        b"n\xffme.toml".to_vec(),
        b"-name.toml".to_vec(),
        b"two words.toml".to_vec(),
    ] {
        let scratch = Scratch::new();
        let name = OsString::from_vec(name);
        std::fs::write(scratch.folder().join(&name), short_flight()).expect("files can be written here");
        let mut out = OsString::from("out of ");
        out.push(&name);
        let args = [
            "fly".into(),
            "--domain".into(),
            scratch.domain().into(),
            "--out".into(),
            out.clone(),
            "--".into(),
            name,
        ];
        Call::new(&scratch, args).run().expect_code(0);
        assert!(scratch.folder().join(&out).join("summary.json").is_file());
    }
}

#[test]
fn scenario_wrong_arguments() {
    let scenario = shipped_scenario("short-hover");
    let scenario = scenario.to_str().expect("the repository has a plain path");
    let table: &[(&[&str], &[&str])] = &[
        (&["fly"], &["SCENARIO", "required"]),
        (&["flie", scenario], &["'flie'", "unrecognized"]),
        (&["fly", scenario, "--colour"], &["'--colour'", "unexpected argument"]),
        (&["fly", scenario, "--seed", "-1"], &["'-1'", ""]),
        (
            &["fly", scenario, "--seed=-1"],
            &["--seed", "'-1'", "whole number from 0 to 18446744073709551615"],
        ),
        (
            &["fly", scenario, "--seed", "1.5"],
            &["--seed", "'1.5'", "whole number from 0"],
        ),
        (
            &["fly", scenario, "--seed", "18446744073709551616"],
            &["--seed", "whole number from 0"],
        ),
        (
            &["fly", scenario, "--link", "udp"],
            &["--link", "'udp'", "in-process, iceoryx2, zenoh"],
        ),
        (
            &["fly", scenario, "--pace", "slow"],
            &["--pace", "'slow'", "fast, real-time"],
        ),
        (
            &["fly", scenario, "--step-timeout", "0"],
            &["--step-timeout", "from 1 to 3600000"],
        ),
        (
            &["fly", scenario, "--fdi-window", "257"],
            &["--fdi-window", "from 0 to 256"],
        ),
        (&["fly", scenario, "--cpu", "1000"], &["CPU 1000"]),
        (
            &["fly", scenario, "--cpu", "1000", "--link", "in-process"],
            &["CPU 1000"],
        ),
        (
            &["fly", scenario, "--external", "plant"],
            &["--external", "'plant'", "controller, fdi"],
        ),
        (
            &["fly", scenario, "--external", "fdi", "--link", "in-process"],
            &["--external", "expected --link"],
        ),
        (&["fly", scenario, "--domain", "a/b"], &["--domain", "letters, digits"]),
        (
            &["fly", scenario, "--domain", "a", "--link", "zenoh"],
            &["--domain", "--link iceoryx2"],
        ),
        (
            &["fly", scenario, "--listen", "tcp/127.0.0.1:7447"],
            &["--listen", "--link zenoh", "iceoryx2"],
        ),
        (
            &[
                "fly",
                scenario,
                "--connect",
                "tcp/127.0.0.1:7447",
                "--link",
                "in-process",
            ],
            &["--connect", "--link zenoh"],
        ),
        (
            &["fly", scenario, "--link", "zenoh", "--listen", "127.0.0.1:7447"],
            &["--listen", "tcp/HOST:PORT"],
        ),
        (
            &["fly", scenario, "--link", "zenoh", "--listen", "udp/127.0.0.1:7447"],
            &["--listen", "tcp/HOST:PORT"],
        ),
        (
            &["fly", scenario, "--link", "zenoh", "--listen", "tcp/127.0.0.1:70000"],
            &["--listen", "tcp/HOST:PORT"],
        ),
        // From the block reserved for documentation (RFC 5737): not an address of this host.
        (
            &["fly", scenario, "--link", "zenoh", "--listen", "tcp/192.0.2.1:7447"],
            &["--listen", "tcp/192.0.2.1:7447"],
        ),
        (
            &["fly", scenario, "--link", "zenoh", "--connect", "tcp/no host:1"],
            &["--connect", "tcp/no host:1"],
        ),
        (&["check"], &["SCENARIO", "required"]),
        (&["replay"], &["RUN", "required"]),
        (&["show", "none"], &["none", "no run here"]),
        (&["replay", "none"], &["none", "no run here"]),
        (
            &["sim", scenario, "--out", "out", "--link", "tcp", "--run-id", "1"],
            &["--link", "'tcp'", "expected iceoryx2"],
        ),
        (
            &["sim", scenario, "--out", "out", "--link", "iceoryx2", "--run-id", "0"],
            &["--run-id", "hexadecimal"],
        ),
        (
            &["controller", "--link", "iceoryx2", "--run-id", "xyz"],
            &["--run-id", "hexadecimal"],
        ),
    ];
    for (args, words) in table {
        let scratch = Scratch::new();
        refuses(&scratch, &args.join(" "), Call::new(&scratch, *args), words);
    }
    // Without any argument the help comes with the sentence.
    let scratch = Scratch::new();
    let nothing = Call::new(&scratch, [] as [&str; 0]).run().expect_code(2);
    assert!(
        nothing.stderr[0].starts_with("rotortwin: expected a command"),
        "{:?}",
        nothing.stderr
    );
    assert!(
        nothing.stderr.iter().any(|line| line.trim_start().starts_with("fly ")),
        "{:?}",
        nothing.stderr
    );
    assert!(
        Call::new(&scratch, ["--help"])
            .run()
            .expect_code(0)
            .stdout
            .contains("Usage: rotortwin")
    );
    assert!(
        Call::new(&scratch, ["--version"])
            .run()
            .expect_code(0)
            .stdout
            .starts_with("rotortwin ")
    );
}

/// Nothing answers, or another program listens: detected before anything is written.
#[test]
fn scenario_endpoints_that_do_not_work() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port is free");
    let endpoint = format!("tcp/{}", taken.local_addr().expect("it is bound"));
    let fly =
        |option: &str, endpoint: &str| Call::fly(&scratch, Link::Zenoh, &scenario, "out").with([option, endpoint]);
    refuses(
        &scratch,
        "port in use",
        fly("--listen", &endpoint),
        &["--listen", &endpoint, "in use", "expected"],
    );
    drop(taken);
    // A reserved port: a port that was just released may be in use again by now.
    let endpoint = "tcp/127.0.0.1:1".to_owned();
    refuses(
        &scratch,
        "nobody there",
        fly("--connect", &endpoint),
        &["--connect", &endpoint, "no response", "expected"],
    );

    // The processes on their own. The peers wait for a while: the plant may be about to start.
    let link = format!("zenoh:connect={endpoint}");
    let by_hand = |name: &'static str, extra: &[&str]| {
        (
            name,
            Call::new(
                &scratch,
                [name, "--link", &link, "--run-id", "1", "--join-timeout", "1000"],
            )
            .with(extra)
            .start(),
        )
    };
    let before = scratch.listing();
    let scenario = scenario.to_str().expect("a plain path");
    let started = [
        by_hand("sim", &["--out", "out", scenario]),
        by_hand("controller", &[]),
        by_hand("fdi", &[]),
    ];
    for (name, run) in started {
        let ended = run.end(PATIENCE).expect_code(2);
        assert_eq!(
            (ended.stderr.len(), ended.stdout.as_str()),
            (1, ""),
            "{name}: {:?}",
            ended.stderr
        );
        let sentence = &ended.stderr[0];
        assert!(sentence.starts_with(&format!("rotortwin-{name}: ")), "{sentence}");
        assert!(
            sentence.contains(&endpoint) && sentence.contains("no response"),
            "{sentence}"
        );
    }
    assert_eq!(scratch.listing(), before, "something was written");
}

/// Run folders that must not or cannot be written.
#[test]
fn scenario_run_folders_that_cannot_be_used() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    scratch.write("full/notes.txt", "mine");
    scratch.write("file", "mine");
    let fly = |link: Link, out: &str| Call::fly(&scratch, link, &scenario, out);
    for link in [Link::InProcess, Link::Iceoryx2] {
        refuses(&scratch, "not empty", fly(link, "full"), &["full", "not empty"]);
        refuses(&scratch, "a file", fly(link, "file"), &["file", "not a folder"]);
        refuses(
            &scratch,
            "below a file",
            fly(link, "file/run"),
            &["file/run", "not a folder"],
        );
        refuses(
            &scratch,
            "no such place",
            fly(link, "/proc/rotortwin/run"),
            &["/proc/rotortwin/run", "cannot create"],
        );
    }
    assert_eq!(
        std::fs::read_to_string(scratch.path("full/notes.txt")).ok().as_deref(),
        Some("mine")
    );
    unwritable_folders(&scratch, &scenario);

    // An existing empty folder is fine, and stays if the run cannot start.
    std::fs::create_dir(scratch.path("empty")).expect("a folder can be made");
    refuses(
        &scratch,
        "bad CPU",
        fly(Link::Iceoryx2, "empty").with(["--cpu", "1000"]),
        &["CPU"],
    );
    fly(Link::Iceoryx2, "empty").run().expect_code(0);
}

/// A folder owned by another user. Root may write anywhere, so the program is then run as another user.
fn unwritable_folders(scratch: &Scratch, scenario: &Path) {
    use std::os::unix::fs::PermissionsExt as _;
    const NOBODY: u32 = 65534;
    let is_root = rustix::process::getuid().is_root();
    let permit = |path: &Path, mode: u32| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("our own files can be changed");
    };
    permit(scratch.folder(), 0o755);
    std::fs::create_dir(scratch.path("readable")).expect("a folder can be made");
    permit(&scratch.path("readable"), 0o555);
    let user = |call: Call| if is_root { call.as_user(NOBODY) } else { call };
    if user(Call::new(scratch, ["check".as_ref(), scenario.as_os_str()]))
        .run()
        .code
        != Some(0)
    {
        rotortwin_tests::skip("unwritable run folders: the program cannot be run as another user than root here");
        return;
    }
    for link in [Link::InProcess, Link::Iceoryx2] {
        for (out, words) in [("readable", "cannot write"), ("readable/new", "cannot create")] {
            refuses(
                scratch,
                out,
                user(Call::fly(scratch, link, scenario, out)),
                &[out, words, "denied"],
            );
        }
    }
}

/// Run folders that cannot be shown or replayed.
#[test]
fn scenario_runs_that_cannot_be_read() {
    let scratch = Scratch::new();
    let scenario = scratch.write("short.toml", short_flight());
    let flown = Call::fly(&scratch, Link::InProcess, &scenario, "flown")
        .run()
        .expect_code(0);
    let summary = std::fs::read_to_string(flown.out().join("summary.json")).expect("it was written");
    let version = "\"schema_version\": 1,";
    assert!(
        summary.contains(version) && summary.contains("\"status\": \"done\""),
        "{summary:.200}"
    );
    scratch.write("cut/summary.json", &summary[..summary.len() / 2]);
    scratch.write(
        "later/summary.json",
        summary.replace(version, "\"schema_version\": 99,"),
    );
    scratch.write(
        "failed/summary.json",
        summary.replace("\"status\": \"done\"", "\"status\": \"failed\""),
    );
    scratch.write(
        "spoilt/summary.json",
        summary.replace("kind = \\\"hover\\\"", "kind = \\\"hoover\\\""),
    );
    std::fs::create_dir(scratch.path("empty")).expect("a folder can be made");
    for (command, name, words) in [
        ("show", "empty", ["empty", "summary.json"]),
        ("show", "cut", ["cut/summary.json", "not a summary"]),
        ("show", "later", ["later/summary.json", "format 99"]),
        ("replay", "empty", ["empty", "summary.json"]),
        ("replay", "cut", ["cut/summary.json", "not a summary"]),
        ("replay", "failed", ["failed", "only a run that is done"]),
        ("replay", "spoilt", ["spoilt, the recorded scenario", "trajectory.kind"]),
    ] {
        refuses(
            &scratch,
            &format!("{command} {name}"),
            Call::new(&scratch, [command, name]),
            &words,
        );
    }
}

#[test]
fn scenario_a_refused_version_of_a_model_begins_nothing() {
    let scratch = Scratch::new();
    let vehicle = repository().join("config/vehicles/f550.toml");
    let models = scratch.path("models");
    let add = |rest: &[&str]| {
        let fixed = ["model".into(), "add".into(), vehicle.clone().into_os_string()];
        Call::new(&scratch, fixed)
            .with(rest.iter().map(OsString::from))
            .with(["--models".into(), models.clone().into_os_string()])
    };
    refuses(
        &scratch,
        "a file that is not there",
        add(&["--from", "none.json"]),
        &["none.json", "readable"],
    );
    refuses(
        &scratch,
        "a parameter of no effect",
        add(&["mass", "shape=0.1"]),
        &["shape"],
    );
    assert!(!models.exists(), "a refused version has left {}", models.display());
    add(&["mass", "share=0.1"]).run().expect_code(0);
    assert!(models.join("f550").is_dir());
}

/// Files that the program did not write are not opened: a summary that is a pipe must not block it.
#[test]
fn scenario_nothing_waits_for_a_pipe() {
    let scratch = Scratch::new();
    let made = std::process::Command::new("mkfifo")
        .arg(scratch.path("pipe.toml"))
        .status();
    if !made.is_ok_and(|status| status.success()) {
        rotortwin_tests::skip("reading a pipe as a scenario: no mkfifo here");
        return;
    }
    let ended = Call::new(&scratch, ["fly", "pipe.toml"]).start().end(PATIENCE);
    assert_refused("pipe", &ended, &["pipe.toml", "not a regular file"]);
}

/// The user did nothing wrong: exit code 1 from every command, as from `fly`.
#[test]
fn scenario_a_full_disk_is_no_bad_input() {
    let scratch = Scratch::new();
    let Some(disk) = Disk::new(scratch.path("full"), "24m") else {
        return;
    };
    std::fs::write(scratch.path("short.toml"), hover("short", 3.0, "")).expect("written");
    let axis = "[[axis]]\nname = 'charge'\nkey = 'initial.state_of_charge'\nvalues = [0.9, 1.0]\n";
    let campaign =
        format!("name = 'tiny'\ndescription = 'four flights'\nscenario = 'short.toml'\nseed = 1\nrepeats = 2\n{axis}");
    std::fs::write(scratch.path("tiny.toml"), campaign).expect("written");
    std::fs::write(scratch.path("said.csv"), "time_s,verdict\n0,0\n").expect("written");
    let run = |words: &str| Call::new(&scratch, words.split(' ')).run();
    run("fly short.toml --link in-process --out full/run").expect_code(0);
    run("export full/run --format csv --out flight.csv").expect_code(0);
    assert!(disk.fill(), "nobody writes");
    for words in [
        "fly short.toml --link in-process --out full/again",
        "judge full/run said.csv --name mine",
        "log import flight.csv --out full/logs",
        "log import flight.csv --out full",
        "export full/run --format ulog --out full/run.ulg",
        "blind generate --effect rotor-drag --flight waypoint --seed 7 --out full/flight.parquet",
        "campaign tiny.toml --out full/campaign",
        "compare flight.csv --model f550 --out full/comparison",
        "fdi-log flight.csv --model f550 --report full/page.html",
    ] {
        let ended = run(words);
        let printed = ended.stderr.join("\n");
        assert_eq!(ended.code, Some(1), "{words}: {printed}");
        let said = printed.replace('\n', " ");
        let is_named =
            said.matches("the disk is full: ").count() == 1 && said.contains(&*disk.path().to_string_lossy());
        assert!(is_named && printed.starts_with("rotortwin: "), "{words}: {printed}");
        assert!(
            !scratch.path("full/flight.parquet").exists(),
            "{words}: half of a log is left"
        );
    }
    // Once there is room again, the same commands work: nothing of the log is left, and the campaign goes on.
    assert!(disk.resize("24m"));
    run("log import flight.csv --out full/logs").expect_code(0);
    run("log import flight.csv --out full").expect_code(0);
    run("campaign tiny.toml --out full/campaign").expect_code(0);
}
