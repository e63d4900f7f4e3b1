//! The command's behaviour on a terminal and in pipes.

use rotortwin_tests::program::program;
use rotortwin_tests::scratch::{Scratch, repository, short_flight};
use std::io::PipeWriter;
use std::process::{Command, Output, Stdio};

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

/// Lines wider than `width`, except for unbreakable words such as paths.
fn too_wide(text: &str, width: usize) -> Vec<&str> {
    let breakable = |line: &&str| {
        let widest = line
            .split_whitespace()
            .map(|word| word.chars().count())
            .max()
            .unwrap_or(0);
        widest + 20 < width
    };
    text.lines()
        .filter(|line| line.chars().count() > width)
        .filter(breakable)
        .collect()
}

/// All subcommands of `words`, according to their help.
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
            "options of a command stand after it; see 'rotortwin --help'",
        ),
        (&["flew"], "see 'rotortwin --help'"),
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
