//! The command's behaviour on a terminal and in pipes.

use rotortwin_tests::columns::too_wide;
use rotortwin_tests::program::program;
use rotortwin_tests::python::client_environment;
use rotortwin_tests::scratch::{Scratch, repository, short_flight};
use rotortwin_tests::server::Server;
use std::io::PipeWriter;
use std::process::{Command, Output, Stdio};
use std::time::Instant;

/// The write end of a pipe whose read end is closed.
fn closed() -> PipeWriter {
    std::io::pipe().expect("the kernel gives pipes").1
}

fn command(scratch: &Scratch, words: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.args(words).current_dir(scratch.folder()).stdin(Stdio::null());
    command
}

fn words(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// `rotortwin … | true`
#[test]
fn regress_a_closed_pipe_ends_quietly() {
    let scratch = Scratch::new();
    let path = |name: &str| scratch.path(name).display().to_string();
    let config = |name: &str| repository().join("config").join(name).display().to_string();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    let (short, run) = (path("short.toml"), path("run"));
    let flown = command(&scratch, &["fly", &short, "--link", "in-process", "--out", &run])
        .output()
        .unwrap();
    assert!(flown.status.success(), "{}", words(&flown));
    let vehicle = config("vehicles/f550.toml");
    let campaign = config("campaigns/detector-ideal.toml");
    for args in [
        &["--help"][..],
        &["--version"],
        &["help", "fly"],
        &["campaign", "--help"],
        &["effects"],
        &["effects", "--json"],
        &["blind", "effects"],
        &["show", &run],
        &["show", &run, "--json"],
        &["replay", &run],
        &["check", &short],
        &["check", &short, "--json"],
        &["fly", &short],
        &["fly", &short, "--json"],
        &["log", "show", &run],
        &["log", "import", &run],
        &["compare", &run, "--model", &vehicle],
        &["compare", &run, "--model", &vehicle, "--json"],
        &["model", "import", &vehicle],
        &["model", "list"],
        &["model", "show", "f550"],
        &["model", "log", "f550"],
        &["campaign", &campaign, "--check"],
        &["campaign", &campaign, "--shards", "0..1"],
    ] {
        let output = command(&scratch, args)
            .stdout(closed())
            .output()
            .expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{args:?}: {said}");
        assert!(!said.contains("panicked"), "{args:?}: {said}");
    }
}

/// `rotortwin … 2>&1 >FILE | true`: a flight completes although nobody reads its progress, and bad input is still bad
/// input.
#[test]
fn regress_nobody_needs_to_read_the_standard_error() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    for link in ["in-process", "iceoryx2"] {
        let output = command(&scratch, &["fly", "short.toml", "--link", link, "--out", link])
            .env("ROTORTWIN_LOG", "debug")
            .stderr(closed())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", words(&output));
        assert!(scratch.path(link).join("summary.json").is_file(), "{}", words(&output));
    }
    for (args, code) in [
        (&["fly", "absent.toml"][..], 2),
        (&["--no-such-option"], 2),
        (
            &["sim", "short.toml", "--out", "x", "--link", "nothing", "--run-id", "1"],
            2,
        ),
        (
            &[
                "controller",
                "--link",
                "iceoryx2:closed",
                "--run-id",
                "1",
                "--join-timeout",
                "50",
            ],
            1,
        ),
    ] {
        let output = command(&scratch, args)
            .stderr(closed())
            .output()
            .expect("the program starts");
        assert_eq!(output.status.code(), Some(code), "{args:?}");
    }
}

/// Failed writes are not silently ignored.
#[test]
fn scenario_the_answer_does_not_fit_on_the_disk() {
    let scratch = Scratch::new();
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = command(&scratch, &["effects"])
        .stdout(full)
        .output()
        .expect("the program starts");
    let said = words(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("the standard output cannot be written: No space left on device"),
        "{said}"
    );
}

/// All commands below `words`, by what their help says.
fn all_commands(scratch: &Scratch, words: &[String], found: &mut Vec<Vec<String>>) {
    let args: Vec<&str> = words.iter().map(String::as_str).chain(["--help"]).collect();
    let help = command(scratch, &args).output().expect("the program starts");
    let text = String::from_utf8(help.stdout).expect("help is UTF-8");
    found.push(words.to_vec());
    let list = text.split_once("\nCommands:\n").map_or("", |(_, list)| list);
    for line in list.lines().take_while(|line| line.starts_with("  ")) {
        let name = line.strip_prefix("  ").filter(|line| !line.starts_with(' '));
        if let Some(name) = name
            .and_then(|line| line.split_whitespace().next())
            .filter(|name| *name != "help")
        {
            all_commands(scratch, &[words, &[name.to_owned()]].concat(), found);
        }
    }
}

/// Tables were 130 to 175 characters wide, help up to 200.
#[test]
fn regress_help_and_tables_fit_the_terminal() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    let config = |name: &str| repository().join("config").join(name).display().to_string();
    let vehicle = config("vehicles/f550.toml");
    let mut commands = Vec::new();
    all_commands(&scratch, &[], &mut commands);
    assert!(commands.len() > 50, "{commands:?}");
    let mut calls: Vec<Vec<String>> = commands
        .into_iter()
        .map(|words| words.into_iter().chain(["--help".to_owned()]).collect())
        .collect();
    let shown: [&[&str]; 10] = [
        &["effects"],
        &["effects", "show", "rotor-drag"],
        &["blind", "effects"],
        &["fly", "short.toml", "--link", "in-process", "--out", "run"],
        &["show", "run"],
        &["log", "show", "run"],
        &["fdi-log", "run", "--model", &vehicle, "--truth", "fault_label"],
        &["model", "import", &vehicle],
        &["model", "list"],
        &["compare", "run", "--model", &vehicle],
    ];
    calls.extend(
        shown
            .iter()
            .map(|words| words.iter().map(|word| (*word).to_owned()).collect()),
    );
    for width in [80, 120] {
        for words in &calls {
            let args: Vec<&str> = words.iter().map(String::as_str).collect();
            let output = command(&scratch, &args)
                .env("COLUMNS", width.to_string())
                .output()
                .unwrap();
            let text = String::from_utf8(output.stdout).expect("the output is UTF-8");
            assert_eq!(too_wide(&text, width), Vec::<&str>::new(), "{args:?} at {width}");
        }
        for left in ["run", "models"] {
            std::fs::remove_dir_all(scratch.path(left)).unwrap();
        }
    }
}

/// A thrust bench of a rotor that follows Eq. 19 up to some noise: duty, voltage, thrust.
fn bench() -> String {
    let mut text = "duty,voltage_v,thrust_n\n".to_owned();
    for voltage in [14.0, 15.0, 16.0] {
        for step in 1..=20 {
            let duty = f64::from(step) / 20.0;
            let noise = 0.01 * (7.0 * f64::from(step) + voltage).sin();
            text += &format!("{duty},{voltage},{:.4}\n", 0.03 * (duty * voltage).powi(2) + noise);
        }
    }
    text
}

/// A battery of 50 mΩ under currents that come and go: time, voltage, current.
fn discharge() -> String {
    let mut text = "time_s,voltage_v,current_a\n".to_owned();
    for row in 0..600 {
        let time = f64::from(row);
        let current = if (row / 20) % 2 == 0 { 8.0 } else { 20.0 };
        let noise = 0.004 * (7.3 * time).sin();
        text += &format!("{time},{:.4},{current}\n", 16.6 - 2e-4 * time - 0.05 * current + noise);
    }
    text
}

/// Thrust that follows steps of 2 and 4 N with 40 ms: time, thrust.
fn steps() -> String {
    let mut text = "time_s,thrust_n\n".to_owned();
    let mut thrust = 2.0;
    for row in 0..1200 {
        let time = f64::from(row) * 0.005;
        let wanted = if (row / 200) % 2 == 0 { 2.0 } else { 4.0 };
        thrust += (wanted - thrust) * 0.005 / 0.04;
        text += &format!("{time:.3},{:.4}\n", thrust + 0.004 * (9.1 * f64::from(row)).sin());
    }
    text
}

/// Commands whose lines `regress_help_and_tables_fit_the_terminal` tries.
const SHOWN: [&str; 6] = ["effects show", "blind effects", "fly", "show", "log show", "fdi-log"];

/// Commands about the jobs of a server.
const COLLECTIONS: [&str; 3] = ["runs", "campaigns", "blind-benches"];

/// What each of [`COLLECTIONS`] can be asked.
const OF_JOBS: [&str; 6] = ["list", "get", "events", "cancel", "fetch", "delete"];

/// Commands that `regress_answers_of_a_server_fit_the_terminal` and `regress_answers_to_queries_fit_the_terminal` try.
fn asked() -> Vec<String> {
    let of_jobs = COLLECTIONS.map(|collection| OF_JOBS.map(|word| format!("{collection} {word}")));
    let others = ["token create", "token list", "token revoke", "health", "query"].map(str::to_owned);
    of_jobs.into_iter().flatten().chain(others).collect()
}

/// Commands that are not tried at a width, and why.
const NOT_TRIED: [(&str, &str); 19] = [
    ("check", "prints a document"),
    ("completions", "prints a script"),
    ("man", "prints a page that man lays out"),
    ("job", "prints JSON"),
    ("blind generate", "prints nothing"),
    ("blind merge", "prints the score of `blind`"),
    ("train merge", "prints what `train` prints"),
    ("spin-test", "needs an autopilot"),
    ("board measure", "needs a board or QEMU"),
    ("board flash", "needs a board"),
    ("board boot-loader", "needs a board"),
    ("serve", "goes on until it is ended"),
    ("worker", "goes on until it is ended"),
    ("router", "goes on until it is ended"),
    ("fdi-service", "goes on until it is ended"),
    ("part", "started by Ray"),
    ("sim", "a process of a run"),
    ("controller", "a process of a run"),
    ("fdi", "a process of a run"),
];

/// One sentence was one line of up to 226 letters.
#[test]
fn regress_refusals_fit_the_terminal() {
    let scratch = Scratch::new();
    for (line, code) in [
        ("fly hoover", 2),
        ("fly none.toml", 2),
        ("fly hover --set duration_m=2", 2),
        ("fly hover --controller nothing", 2),
        ("compare none.ulg --model f550", 2),
        ("compare none.ulg --model f550x", 2),
        ("campaign detector-ideal --out s3://bucket/mine", 2),
        ("improve none.ulg --model f550", 2),
        ("campaign merge detector-ideal none --out whole", 2),
        ("model branch f550 windy", 2),
        ("query nothing --python none", 1),
        ("serve --executor dask", 2),
        ("--seed 3 fly hover", 2),
    ] {
        let words: Vec<&str> = line.split(' ').collect();
        for width in [80, 120] {
            let output = command(&scratch, &words)
                .env("COLUMNS", width.to_string())
                .output()
                .expect("the program starts");
            let text = self::words(&output);
            assert_eq!(output.status.code(), Some(code), "{line}: {text}");
            assert_eq!(too_wide(&text, width), Vec::<&str>::new(), "{line} at {width}");
        }
        // In a pipe a program reads it: one sentence is one line.
        let output = command(&scratch, &words)
            .env_remove("COLUMNS")
            .output()
            .expect("the program starts");
        assert_eq!(self::words(&output).lines().count(), 1, "{line}");
    }
}

/// A command that must succeed: none of its lines is wider than `width`, on either output; what it printed.
#[track_caller]
fn fits(scratch: &Scratch, words: &[&str], width: usize) -> String {
    let output = command(scratch, words)
        .env("COLUMNS", width.to_string())
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{words:?}: {}", self::words(&output));
    for text in [&output.stdout, &output.stderr] {
        let text = String::from_utf8_lossy(text);
        assert_eq!(too_wide(&text, width), Vec::<&str>::new(), "{words:?} at {width}");
    }
    String::from_utf8(output.stdout).expect("the output is UTF-8")
}

/// Jobs done by a server, what it says of them, its tokens.
#[test]
fn regress_answers_of_a_server_fit_the_terminal() {
    let scratch = Scratch::new();
    let data = scratch.path("data");
    let server = Server::start(&data);
    let (url, data) = (server.url(), data.display().to_string());
    let few = "name = 'a-few-of-them'\ndescription = 'asked'\nscenario = 'short-hover'\nseed = 5\nflights = 3\n\
               [[axis]]\nname = 'charge'\nkey = 'initial.state_of_charge'\nuniform = [0.5, 0.9]\n";
    scratch.write("few.toml", few);
    for width in [80, 120] {
        let of_server = |line: &str| {
            let words: Vec<&str> = line.split(' ').collect();
            fits(&scratch, &[&["--server", url.as_str()], &words[..]].concat(), width)
        };
        for line in [
            "fly short-hover",
            "campaign few.toml",
            "blind --preset singles --n 1 --duration-s 30",
        ] {
            let (name, _) = line.split_once(' ').expect("a command and its arguments");
            let said = of_server(&format!("{line} --out w{width}-{name}"));
            assert!(said.lines().count() > 5, "{line}: {said}");
        }
        for collection in COLLECTIONS {
            let listed = of_server(&format!("{collection} list"));
            let json: serde_json::Value =
                serde_json::from_str(&of_server(&format!("{collection} list --json --limit 1"))).expect("JSON");
            let id = json[0]["id"].as_str().unwrap_or_else(|| panic!("{json}")).to_owned();
            assert!(
                listed.contains(&id) && listed.contains("done"),
                "{collection}: {listed}"
            );
            // Documents, whose lines are as long as they are.
            for word in ["get", "events"] {
                let output = command(&scratch, &["--server", &url, collection, word, &id])
                    .env("COLUMNS", width.to_string())
                    .output()
                    .expect("the program starts");
                assert!(output.status.success(), "{collection} {word}: {}", words(&output));
                let text = String::from_utf8(output.stdout).expect("the output is UTF-8");
                let documents = serde_json::Deserializer::from_str(&text).into_iter::<serde_json::Value>();
                let documents = documents.collect::<Result<Vec<_>, _>>().expect("JSON");
                assert!(!documents.is_empty(), "{collection} {word}");
            }
            // What has ended cannot be canceled: a refusal.
            let refused = command(&scratch, &["--server", &url, collection, "cancel", &id])
                .env("COLUMNS", width.to_string())
                .output()
                .expect("the program starts");
            let said = words(&refused);
            assert_eq!(refused.status.code(), Some(2), "{collection} cancel: {said}");
            assert!(said.contains("has ended already"), "{said}");
            assert_eq!(
                too_wide(&said, width),
                Vec::<&str>::new(),
                "{collection} cancel at {width}"
            );
            let fetched = of_server(&format!("{collection} fetch {id} --out w{width}-fetched-{collection}"));
            assert!(fetched.contains("files in"), "{collection}: {fetched}");
            of_server(&format!("{collection} delete {id}"));
        }
    }
    // From the first token on every request requires one.
    for width in [80, 120] {
        let local = |line: &str| fits(&scratch, &line.split(' ').collect::<Vec<_>>(), width);
        // A token is never broken.
        let created = command(&scratch, &["token", "create", "night-shift", "--data", &data])
            .env("COLUMNS", width.to_string())
            .output()
            .expect("the program starts");
        let created = String::from_utf8(created.stdout).expect("the output is UTF-8");
        let token = created.trim_end();
        assert!(token.starts_with("rtw_") && !token.contains([' ', '\n']), "{created}");
        let listed = local(&format!("token list --data {data}"));
        let id = token.split('_').nth(1).expect("its public part");
        assert!(listed.contains(id) && listed.contains("night-shift"), "{listed}");
        local(&format!("token revoke {id} --data {data}"));
        let listed = local(&format!("token list --data {data}"));
        assert!(!listed.contains("valid"), "{listed}");
        local(&format!("health {url}/healthz"));
        let dead = command(&scratch, &["health", "http://127.0.0.1:9/healthz"])
            .env("COLUMNS", width.to_string())
            .output()
            .expect("the program starts");
        assert_eq!(dead.status.code(), Some(1), "{}", words(&dead));
        assert_eq!(too_wide(&words(&dead), width), Vec::<&str>::new(), "at {width}");
    }
}

/// Runs a program on a terminal until it has printed a text, or has ended: prints what it printed.
const ON_A_TERMINAL: &str = "\
import os, pty, sys
child, terminal = pty.fork()
if child == 0:
    os.execv(sys.argv[2], sys.argv[2:])
said = b''
while sys.argv[1].encode() not in said:
    try:
        said += os.read(terminal, 4096)
    except OSError:
        break
try:
    os.kill(child, 15)
except ProcessLookupError:
    pass
os.waitpid(child, 0)
sys.stdout.buffer.write(said)
";

/// With --json nothing was shown of a bench of faults; what was done before counted as work of now.
#[test]
fn regress_a_bench_of_faults_shows_its_progress() {
    let Some(programs) = client_environment() else { return };
    let scratch = Scratch::new();
    let bench = |until: &str| {
        let output = Command::new(programs.join("python"))
            .args(["-c", ON_A_TERMINAL, until])
            .arg(program())
            .args([
                "blind",
                "--preset",
                "faults",
                "--n",
                "1",
                "--seed",
                "3",
                "--duration-s",
                "60",
            ])
            .args(["--json", "--out", "faults"])
            .current_dir(scratch.folder())
            .output()
            .expect("Python starts");
        words(&output)
    };
    let begun = bench(" 1/14 ");
    assert!(
        begun.contains(" 0/14 ") && begun.contains("healthy → correct"),
        "{begun}"
    );
    let resumed = bench(" 2/14 ");
    assert!(resumed.contains(" 1/14 ") && !resumed.contains(" 0/14 "), "{resumed}");
}

#[test]
fn regress_answers_to_queries_fit_the_terminal() {
    let Some(programs) = client_environment() else { return };
    let python = programs.join("python").display().to_string();
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    let flown = command(&scratch, &["fly", "short.toml", "--link", "in-process", "--out", "run"])
        .output()
        .unwrap();
    assert!(flown.status.success(), "{}", words(&flown));
    for width in [80, 120] {
        // More columns than any terminal has room for; a column of words; a long name.
        for (sql, shown) in [
            ("SELECT * FROM telemetry LIMIT 2", "position_north_m"),
            (
                "SELECT time_s, duty_1 AS a_name_that_is_longer_than_what_it_names, 'words that go on for longer than the terminal is wide, and so have to be \
                 broken between two of them, twice' AS said FROM telemetry LIMIT 2",
                "a_name_that_is_longer",
            ),
        ] {
            let text = fits(&scratch, &["query", sql, "run", "--python", &python], width);
            assert!(text.contains(shown), "{text}");
        }
        let refused = command(
            &scratch,
            &[
                "query",
                "SELECT none_of_these FROM telemetry",
                "run",
                "--python",
                &python,
            ],
        )
        .env("COLUMNS", width.to_string())
        .output()
        .unwrap();
        let said = words(&refused);
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert_eq!(too_wide(&said, width), Vec::<&str>::new(), "at {width}");
    }
}

/// What commands print that compute for a while: the proposal of a next flight was one line of 134 letters, the models of a bench 104 wide, and
/// a campaign named its own copy in the user's cache.
#[test]
fn regress_results_fit_the_terminal() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    std::fs::write(scratch.path("bench.csv"), bench()).unwrap();
    std::fs::write(scratch.path("discharge.csv"), discharge()).unwrap();
    std::fs::write(scratch.path("steps.csv"), steps()).unwrap();
    std::fs::write(scratch.path("verdicts.csv"), "time_s,verdict\n4.75,0\n5.5,3\n").unwrap();
    let generate = "blind generate --effect rotor-drag --duration-s 60 --out log.parquet --truth truth.json";
    let fly = "fly short.toml --link in-process --out run";
    let own = "new vehicle own --from quad-x";
    for line in [generate, fly, own] {
        let words: Vec<&str> = line.split(' ').collect();
        let output = command(&scratch, &words).output().expect("the program starts");
        assert!(output.status.success(), "{line}: {}", self::words(&output));
    }
    let lines = [
        "replay run",
        "export run --format csv --out @run.csv",
        "log import run --out @logs",
        "log import run --out @quiet --quiet",
        "log map bench.csv",
        "log map bench.csv --out @mapping.toml",
        "log example --preset healthy --duration-s 20 --out @example",
        "vibration run --model f550",
        "compare run --model f550 --out @compared",
        "campaign detector-ideal --limit 32 --out @campaign",
        "campaign detector-ideal --check",
        "campaign wide-draw --check",
        "campaign merge detector-ideal @campaign --out @whole",
        "reproduce --table 1 --table 2 --table 3 --table 7 --seeds 1 --out @reproduced",
        "diagnose log.parquet --model f550",
        "improve log.parquet --model f550 --yes --truth truth.json --models @models --out @improved",
        "fleet add hexa-07 run --model f550 --fleet @fleet",
        "fleet show --fleet @fleet",
        "fleet show hexa-07 --fleet @fleet",
        "fleet acknowledge hexa-07 --rotor 3 --by Meyer --note worn-edge --fleet @fleet",
        "fleet reset hexa-07 --rotor 3 --by Meyer --note new-propeller --fleet @fleet",
        "model list --models @none",
        "model import f550 --models @own",
        "model add f550 rotor-drag drag_n_s_m=0.25±0.01 --note a-first-guess --models @own",
        "model show f550 --models @own",
        "model log f550 --models @own",
        "model diff f550@v0 f550 --models @own",
        "model branch f550@v1 windy --models @own",
        "model detectors short.toml --model f550 --flights 1 --models @own",
        "model export f550 --out @version.toml --models @own",
        "model undo f550 --models @own",
        "model list --models @own",
        "controllers short.toml --controller own --out @flown",
        "controllers --runs run @flown/1-own",
        "fit thrust bench.csv --map thrust=thrust_n:N --map command=duty --map voltage=voltage_v:V",
        "fit battery discharge.csv --map time=1:s --map voltage=2:V --map current=3:A",
        "fit lag steps.csv --map time=1:s --map thrust=2:N",
        "vehicle from-log log.parquet --mass 1.55 --arm 0.275 --held-out",
        "vehicle tolerances own.toml all=2% inertia=5% rotors=3% centre-of-mass=4mm",
        "next-flight --model f550 --between mass,air-density --models @models",
        "blind --preset singles --n 2 --duration-s 30 --out @bench",
        "effects plot rotor-drag",
        "list",
        "new scenario @mine --from hover",
        "config",
        "train --seeds 1 --out @classifier.json",
        "board list",
        "board info virtual",
        "board doctor virtual --duration-s 2",
        "conform virtual",
        "conform virtual --answer-within 0.0001",
        "features detector-ideal --limit 2 --out @windows.parquet",
        "judge run verdicts.csv --name @own",
    ];
    let asked = asked();
    let mut commands = Vec::new();
    all_commands(&scratch, &[], &mut commands);
    let untried: Vec<String> = commands
        .iter()
        .filter(|words| {
            !commands
                .iter()
                .any(|other| other.len() > words.len() && other.starts_with(words))
        })
        .map(|words| words.join(" "))
        .filter(|command| {
            let begins = |line: &&str| {
                line.strip_prefix(command.as_str())
                    .is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
            };
            !lines.iter().chain(&SHOWN).any(begins)
                && !asked.contains(command)
                && !NOT_TRIED
                    .iter()
                    .any(|(name, _)| command.split(' ').next() == Some(*name) || command == name)
        })
        .collect();
    assert_eq!(untried, Vec::<String>::new(), "neither tried nor excused");
    // What takes seconds to compute is printed in the narrow terminal alone.
    let long = [
        "reproduce",
        "improve",
        "vehicle",
        "blind",
        "train",
        "campaign detector-ideal --limit",
        "campaign merge",
        "next-flight",
    ];
    for width in [80, 120] {
        let shown = |line: &&str| width == 80 || !long.iter().any(|begin| line.starts_with(begin));
        for line in lines.into_iter().filter(shown) {
            let line = line.replace(" @", &format!(" w{width}-"));
            let words: Vec<&str> = line.split(' ').collect();
            let output = command(&scratch, &words)
                .env("COLUMNS", width.to_string())
                .output()
                .unwrap();
            // A part of a campaign, a controller that is too slow: both are visible in the exit code.
            let fails = ["campaign merge", "--answer-within"]
                .iter()
                .any(|failing| line.contains(failing));
            assert_eq!(output.status.success(), !fails, "{line}: {}", self::words(&output));
            let text = String::from_utf8(output.stdout).expect("the output is UTF-8");
            let aside = String::from_utf8(output.stderr).expect("the output is UTF-8");
            assert!(!text.trim().is_empty() || !aside.trim().is_empty(), "{line}");
            // Without --out a mapping is printed, which is a document.
            if line != "log map bench.csv" {
                assert_eq!(too_wide(&text, width), Vec::<&str>::new(), "{line} at {width}");
            }
            assert_eq!(too_wide(&aside, width), Vec::<&str>::new(), "{line} at {width}");
            // A ± in brackets did not state what it was: delays of a log, folds of a training.
            assert!(!text.contains("(± "), "{line}: {text}");
            // It is half of a 95 % interval, or the words say what else; either is told. Descriptions of documents say what they may.
            let whole = text.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(
                line == "list"
                    || !whole.contains('±')
                    || whole.contains("95 %")
                    || whole.contains("standard deviation"),
                "{line}: what is its ±? {text}"
            );
            if line.starts_with("campaign") && line.contains("--limit") {
                assert!(text.contains("rotortwin campaign detector-ideal"), "{text}");
                assert!(!text.contains("campaigns/detector-ideal.toml"), "{text}");
            }
        }
    }
}

/// `./run` on a machine that builds for minutes: how far it is, and how long it will take.
#[test]
fn val_a_build_tells_how_far_it_is() {
    let scratch = Scratch::new();
    let line = |log: &str, seconds: u32| {
        std::fs::write(scratch.path("build.log"), log).unwrap();
        let tool = repository().join("tools/build-progress.sh");
        let script = format!(". {} && build_progress build.log {seconds} 30 20", tool.display());
        let output = Command::new("bash")
            .args(["-c", &script])
            .current_dir(scratch.folder())
            .output()
            .expect("bash is there");
        assert!(output.status.success(), "{}", words(&output));
        words(&output)
    };
    let compiling =
        "   Compiling serde v1.0.0\n   Compiling rotortwin-wire v0.1.0 (/x)\n   Compiling rotortwin-twin v0.1.0 (/x)\n";
    assert_eq!(line("    Updating index\n", 3), "", "cargo has not counted yet");
    assert_eq!(
        line("    Building [>    ] 31/430: syn, quote     \r", 4),
        "  31 of 430 units: syn, quote\n"
    );
    // 200 of 400 units since the start, and one of 20 of ours, which count ten times: 209 of 580 in 120 s.
    let half = format!("{compiling}    Building [==>   ] 230/430: rotortwin-twin, zenoh   \r");
    assert_eq!(
        line(&half, 120),
        "  230 of 430 units, about 4 min left: rotortwin-twin, zenoh\n"
    );
    let late = format!("{half}    Building [=====>] 428/430: rotortwin-twin(bin)  \r");
    assert!(
        line(&late, 200).starts_with("  428 of 430 units, about "),
        "{}",
        line(&late, 200)
    );
}

#[test]
fn regress_a_usage_error_names_the_help_that_explains_it() {
    let scratch = Scratch::new();
    for (args, said) in [
        (&["fly", "x.toml", "--sed", "3"][..], "see 'rotortwin fly --help'"),
        (
            &["model", "add", "f550", "--colour"],
            "see 'rotortwin model add --help'",
        ),
        (&["model", "log"], "see 'rotortwin model log --help'"),
        (
            &["--seed", "3", "fly", "x.toml"],
            "put the options of a command after its name; see 'rotortwin --help'",
        ),
        (&["flew"], "see 'rotortwin --help'"),
        // For an invalid value clap does not state to which command it belongs: all of these named 'rotortwin --help'.
        (&["fly", "hoover"], "see 'rotortwin fly --help'"),
        (&["fly", "hover", "--seed", "x"], "see 'rotortwin fly --help'"),
        (
            &["--server", "http://bench:8400", "fly", "hover", "--pace", "fats"],
            "see 'rotortwin fly --help'",
        ),
        (
            &["campaign", "detector-ideal", "--jobs", "x"],
            "see 'rotortwin campaign --help'",
        ),
        (
            &["campaign", "merge", "no", "part"],
            "see 'rotortwin campaign merge --help'",
        ),
        (&["export", "run", "--format", "cvs"], "see 'rotortwin export --help'"),
        (&["serve", "--listen", "nonsense"], "see 'rotortwin serve --help'"),
        (&["list", "sceanrios"], "see 'rotortwin list --help'"),
        (&["blind", "--preset", "singels"], "see 'rotortwin blind --help'"),
        (
            &["fdi-log", "x.ulg", "--model", "f550", "--classifier", "none"],
            "see 'rotortwin fdi-log --help'",
        ),
        (
            &["model", "detectors", "hoover", "--model", "f550"],
            "see 'rotortwin model detectors --help'",
        ),
        (
            &["model", "--models", "add", "add", "f550", "mass", "--rotor", "x"],
            "see 'rotortwin model add --help'",
        ),
        (
            &["fleet", "--fleet", "x", "reset", "a", "--rotor", "x", "--by", "me"],
            "see 'rotortwin fleet reset --help'",
        ),
        (&["runs", "list", "--limit", "x"], "see 'rotortwin runs list --help'"),
        (
            &["token", "create", "ci", "--days", "never"],
            "see 'rotortwin token create --help'",
        ),
    ] {
        let output = command(&scratch, args).output().expect("the program starts");
        let text = words(&output);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(text.contains(said), "{args:?}: {text}");
        assert_eq!(text.lines().count(), 1, "{args:?}: {text}");
    }
}

/// `--server` after the command was an unexpected argument.
#[test]
fn regress_options_of_all_commands_may_stand_anywhere() {
    let scratch = Scratch::new();
    let nobody = "http://127.0.0.1:9";
    for args in [
        ["--server", nobody, "runs", "list"],
        ["runs", "list", "--server", nobody],
    ] {
        let text = words(&command(&scratch, &args).output().expect("the program starts"));
        assert!(text.contains("127.0.0.1:9") && !text.contains("unexpected"), "{text}");
    }
}

#[test]
fn scenario_a_key_is_set_on_the_command_line() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    let run = |out: &str, set: &[&str]| {
        let words = [&["fly", "short.toml", "--out", out, "--json"], set].concat();
        command(&scratch, &words).output().expect("the program starts")
    };
    for link in ["in-process", "iceoryx2"] {
        let output = run(
            link,
            &[
                "--link",
                link,
                "--set",
                "duration_s=5.5",
                "--set",
                "initial.state_of_charge=0.4",
            ],
        );
        assert!(output.status.success(), "{}", words(&output));
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(summary["steps"], 2200);
        let charge = summary["battery"]["state_of_charge_start"].as_f64().unwrap();
        assert!((charge - 0.4).abs() < 1e-9, "{charge}");
        let again = command(&scratch, &["replay", link])
            .output()
            .expect("the program starts");
        assert!(again.status.success(), "{}", words(&again));
    }
    let refused = run("none", &["--set", "duration_m=2"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(words(&refused).contains("duration_m"), "{}", words(&refused));
}

#[test]
fn scenario_completions_and_manual_pages() {
    let scratch = Scratch::new();
    for (shell, word) in [
        ("bash", "complete"),
        ("zsh", "#compdef rotortwin"),
        ("fish", "complete -c rotortwin"),
    ] {
        let output = command(&scratch, &["completions", shell])
            .output()
            .expect("the program starts");
        let text = words(&output);
        assert!(
            output.status.success()
                && text.contains(word)
                && text.contains("state_of_charge") | text.contains("step-timeout"),
            "{shell}"
        );
    }
    let page = words(
        &command(&scratch, &["man", "model", "add"])
            .output()
            .expect("the program starts"),
    );
    assert!(page.starts_with(".ie") || page.contains(".TH"), "{page}");
    assert!(page.contains("rotortwin\\-model\\-add"), "{page}");
    let page = words(
        &command(&scratch, &["man", "model"])
            .output()
            .expect("the program starts"),
    );
    assert!(page.contains("rotortwin model add f550 rotor"), "{page}");
    let written = command(&scratch, &["man", "--out", "pages"])
        .output()
        .expect("the program starts");
    assert!(written.status.success(), "{}", words(&written));
    for name in ["rotortwin.1", "rotortwin-fly.1", "rotortwin-model-add.1"] {
        assert!(scratch.path("pages").join(name).is_file(), "{name}");
    }
    let unknown = command(&scratch, &["man", "flew"])
        .output()
        .expect("the program starts");
    assert_eq!(unknown.status.code(), Some(2));
}

/// A second `compare --out` overwrote the first.
#[test]
fn regress_results_never_go_over_others_and_folders_are_tried_before_the_work() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    let vehicle = repository().join("config/vehicles/f550.toml").display().to_string();
    let flown = command(&scratch, &["fly", "short.toml", "--link", "in-process", "--out", "run"])
        .output()
        .unwrap();
    assert!(flown.status.success(), "{}", words(&flown));
    for what in ["compare", "diagnose"] {
        let call = |log: &str, out: &str| {
            command(&scratch, &[what, log, "--model", &vehicle, "--out", out])
                .output()
                .unwrap()
        };
        let first = call("run", what);
        assert!(first.status.success(), "{}", words(&first));
        let again = call("run", what);
        assert_eq!(again.status.code(), Some(2), "{}", words(&again));
        assert!(
            words(&again).contains(&format!("{what}: the folder is not empty")),
            "{}",
            words(&again)
        );
        let nowhere = call("run", "short.toml/below");
        assert_eq!(nowhere.status.code(), Some(2), "{}", words(&nowhere));
        // Bad input leaves nothing behind.
        assert_eq!(call("absent.ulg", "left").status.code(), Some(2));
        assert!(!scratch.path("left").exists());
    }
}

/// A thrust bench was fitted, a log judged, a manoeuvre searched for, before it was found that the result could not be written.
#[test]
fn regress_files_are_tried_before_the_work() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    std::fs::write(scratch.path("bench.csv"), bench()).unwrap();
    std::fs::create_dir(scratch.path("logs")).unwrap();
    std::fs::write(scratch.path("logs/log.parquet"), "mine").unwrap();
    let flown = command(&scratch, &["fly", "short.toml", "--link", "in-process", "--out", "run"])
        .output()
        .unwrap();
    assert!(flown.status.success(), "{}", words(&flown));
    let there = || -> Vec<_> {
        let mut names: Vec<_> = std::fs::read_dir(scratch.folder())
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        names.sort();
        names
    };
    let before = there();
    // What is there already must not be: `run`; what cannot be made: below a file.
    let nowhere = "short.toml/below";
    for (line, said) in [
        (format!("fit thrust bench.csv --map thrust=thrust_n:N --map command=duty --map voltage=voltage_v:V --report {nowhere}"), nowhere),
        ("fit thrust bench.csv --map thrust=thrust_n:N --map command=duty --map voltage=voltage_v:V --write none.toml --blade x".to_owned(), "none.toml: file not found"),
        (format!("fdi-log run --model f550 --series {nowhere}.csv"), nowhere),
        (format!("fdi-log run --model f550 --report {nowhere}"), nowhere),
        (format!("blind generate --duration-s 60 --out {nowhere}"), nowhere),
        (format!("blind generate --duration-s 60 --out log.parquet --truth {nowhere}"), nowhere),
        (format!("next-flight --model f550 --between mass,air-density --out {nowhere}"), nowhere),
        ("next-flight --model f550 --between mass,air-density --out short.toml".to_owned(), "short.toml: already exists"),
        (format!("improve run --model f550 --yes --models run/models --out {nowhere}"), nowhere),
        (format!("improve run --model f550 --yes --models run/models --final {nowhere}"), nowhere),
        ("improve run --model f550 --yes --models run/models --out run".to_owned(), "run: the folder is not empty"),
        (format!("vehicle from-log run --mass 1.55 --arm 0.275 --out {nowhere}.toml"), nowhere),
        ("vehicle from-log run --mass 1.55 --arm 0.275 --out short.toml".to_owned(), "short.toml already exists"),
        (format!("train --out {nowhere}"), "short.toml"),
        (format!("reproduce --table 6 --out {nowhere}"), nowhere),
        (format!("reproduce --table 6 --out run/new --save-classifier {nowhere}"), nowhere),
        ("reproduce --table 6 --out run".to_owned(), "run: the folder is not empty"),
        // Before any log is read: there is none.
        ("compare none.csv --model f550 --out run".to_owned(), "run: the folder is not empty"),
        ("diagnose none.csv --model f550 --out run".to_owned(), "run: the folder is not empty"),
        ("improve none.csv --model f550 --yes --models run/models --out run".to_owned(), "run: the folder is not empty"),
        ("log example --duration-s 600 --out logs".to_owned(), "logs/log.parquet: already exists"),
        (format!("export run --format csv --out {nowhere}"), nowhere),
        ("export run --format csv --out short.toml".to_owned(), "short.toml: already exists"),
    ] {
        let args: Vec<&str> = line.split(' ').collect();
        let begin = Instant::now();
        let output = command(&scratch, &args).output().expect("the program starts");
        let text = words(&output);
        assert_eq!(output.status.code(), Some(2), "{line}: {text}");
        assert!(text.contains(said), "{line}: {text}");
        assert_eq!(text.trim_end().lines().count(), 1, "{line}: {text}");
        println!("{line}: {:.2} s", begin.elapsed().as_secs_f64());
        assert_eq!(there(), before, "{line}");
    }
}

/// The reason was "an earlier write failed".
#[test]
fn regress_a_full_disk_is_named() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("short.toml"), short_flight()).unwrap();
    std::fs::create_dir(scratch.path("small")).unwrap();
    let mount = "mount -t tmpfs -o size=200k tmpfs small";
    let can = Command::new("unshare")
        .args(["--mount", "sh", "-c", mount])
        .current_dir(scratch.folder())
        .output();
    if !can.is_ok_and(|output| output.status.success()) {
        return rotortwin_tests::skip("no file systems can be mounted here: no full disk was tried");
    }
    for link in ["in-process", "iceoryx2"] {
        let line = format!(
            "{mount} && exec {} fly short.toml --link {link} --out small/run",
            program().display()
        );
        let output = Command::new("unshare")
            .args(["--mount", "sh", "-c", &line])
            .current_dir(scratch.folder())
            .output()
            .unwrap();
        let text = words(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(
            text.contains("the disk is full: ") && text.contains("/small has "),
            "{text}"
        );
    }
}
