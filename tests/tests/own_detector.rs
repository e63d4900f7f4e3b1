//! `rotortwin judge`: a detector of the user's own in a run that was flown, under its own name, next to ours.

use rotortwin_tests::columns::too_wide;
use rotortwin_tests::program::{Call, Ended, PATIENCE, number, program};
use rotortwin_tests::python::environment;
use rotortwin_tests::scratch::{Scratch, repository};
use serde_json::Value;
use std::process::Command;

const FAULT: &str = "fault=[{time_s=12.0,rotor=3,thrust_loss_percent=10.0}]";

fn call(scratch: &Scratch, words: &[&str], code: i32) -> Ended {
    Call::new(scratch, words.iter().map(|word| (*word).to_owned()))
        .run()
        .expect_code(code)
}

/// 16 s of a scenario with the fault.
fn fly(scratch: &Scratch, scenario: &str, out: &str) {
    let words = [
        "fly",
        scenario,
        "--link",
        "in-process",
        "--set",
        "duration_s=16.0",
        "--set",
        FAULT,
        "--out",
        out,
    ];
    call(scratch, &words, 0);
}

#[test]
fn scenario_a_table_of_verdicts_becomes_a_detector_of_the_run() {
    let scratch = Scratch::new();
    fly(&scratch, "hover", "run");
    // Healthy from 5 s on; a wrong rotor for half a second, then the right one 0.5 s after the damage.
    scratch.write("verdicts.csv", "time_s, verdict\n5.0, 0\n8.0, 2\n8.5, 0\n12.5, 3\n");
    let judge = ["judge", "run", "verdicts.csv", "--name", "slow one"];
    let said = call(&scratch, &judge, 0).stdout;
    let row = |text: &str| -> Vec<String> {
        let lines = text.lines().filter(|line| line.contains("slow one"));
        lines
            .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "))
            .collect()
    };
    // 112 windows end from 5 s to 12 s, 8 of them in the wrong half second; 56 in the last 3.5 s of 64.
    assert_eq!(
        row(&said),
        ["slow one healthy 92.9 % – 1", "slow one rotor 3 87.5 % 0.562 s –"],
        "{said}"
    );
    assert_eq!(row(&call(&scratch, &["show", "run"], 0).stdout), row(&said));

    let summary: Value = serde_json::from_str(&call(&scratch, &["show", "run", "--json"], 0).stdout).unwrap();
    // Every run has the second look.
    let [second, own] = summary["own_detectors"]
        .as_array()
        .map(Vec::as_slice)
        .unwrap_or_default()
    else {
        panic!("{summary}");
    };
    assert_eq!(second["name"], "Second look");
    assert_eq!(
        (own["name"].as_str(), own["column"].as_str()),
        (Some("slow one"), Some("verdict_own_slow_one"))
    );
    assert_eq!(own["scores"][0]["not_ready"], 80);
    let again = call(&scratch, &["replay", "run"], 0).stdout;
    assert!(again.contains("same"), "{again}");

    call(&scratch, &["export", "run", "--format", "csv", "--out", "run.csv"], 0);
    let csv = std::fs::read_to_string(scratch.path("run.csv")).unwrap();
    assert!(
        csv.lines()
            .next()
            .is_some_and(|header| header.ends_with("verdict_own_slow_one"))
    );
    for width in [80, 120] {
        let output = Command::new(program())
            .args(["show", "run"])
            .env("COLUMNS", width.to_string())
            .current_dir(scratch.folder())
            .output()
            .expect("the program starts");
        let text = String::from_utf8(output.stdout).expect("the output is UTF-8");
        assert!(text.contains("slow one"), "{text}");
        assert_eq!(too_wide(&text, width), Vec::<&str>::new(), "at {width}");
    }
}

#[test]
fn scenario_verdicts_that_cannot_be_are_refused_with_their_place() {
    let scratch = Scratch::new();
    call(
        &scratch,
        &[
            "fly",
            "hover",
            "--link",
            "in-process",
            "--set",
            "duration_s=1.0",
            "--out",
            "run",
        ],
        0,
    );
    let before = std::fs::read(scratch.path("run/summary.json")).unwrap();
    for (table, name, words) in [
        (
            "time,verdict\n1,0\n",
            "mine",
            "verdicts.csv: there is no column `time_s`",
        ),
        (
            "time_s,verdict\n0.5,three\n",
            "mine",
            "verdicts.csv: row 1, `verdict`: expected a whole number, got 'three'",
        ),
        (
            "time_s,verdict\n0.5,0\n0.25,0\n",
            "mine",
            "verdicts.csv: time 2 is 0.25 s, after 0.5 s",
        ),
        ("time_s,verdict\n", "mine", "verdicts.csv: there is no verdict"),
        (
            "time_s,verdict\n0.5,7\n",
            "mine",
            "at 0.5 s 'mine' says 7; expected 0, a rotor from 1 to 6",
        ),
        (
            "time_s,verdict\n0.5,0\n",
            "Neural network",
            "'Neural network' is a detector of this program",
        ),
    ] {
        scratch.write("verdicts.csv", table);
        let said = call(&scratch, &["judge", "run", "verdicts.csv", "--name", name], 2)
            .stderr
            .join("\n");
        assert!(said.contains(words), "{said}");
    }
    let said = call(&scratch, &["judge", "elsewhere", "verdicts.csv", "--name", "mine"], 2)
        .stderr
        .join("\n");
    assert!(said.contains("elsewhere"), "{said}");
    assert_eq!(
        std::fs::read(scratch.path("run/summary.json")).unwrap(),
        before,
        "nothing was changed"
    );
}

/// An FDI engine in Python in the place of ours, over zenoh, started with the values that the run prints.
#[test]
fn scenario_the_python_example_judges_a_flight_over_zenoh() {
    let Some(programs) = environment("python-zenoh", &["eclipse-zenoh>=1.10,<2", "protobuf>=5"]) else {
        return;
    };
    let scratch = Scratch::new();
    // A calibration of few windows is none: it is refused before the flight.
    for (name, setting, code, says) in [
        ("damaged", FAULT, 0, "6400 steps judged, at the end: rotor 3"),
        ("healthy", "fault=[]", 0, "6400 steps judged, at the end: healthy"),
        (
            "short",
            "fdi.window_samples=250",
            1,
            "refused to judge: expected a calibration of at least 16 windows, got 13",
        ),
    ] {
        let words = [
            "fly",
            "hover",
            "--link",
            "zenoh",
            "--external",
            "fdi",
            "--set",
            "duration_s=16.0",
            "--set",
            setting,
            "--out",
            name,
        ];
        let mut run = Call::new(&scratch, words).start();
        let line = run.line(|line| line.starts_with("  rotortwin fdi "));
        let after = |before: &str| {
            let (_, rest) = line.split_once(before).expect("it is printed");
            rest.split(' ').next().expect("a word").to_owned()
        };
        let example = Command::new(programs.join("python"))
            .arg(repository().join("examples/python_detector.py"))
            .args([after("zenoh:connect="), after("--run-id ")])
            .output()
            .expect("python starts");
        let said = [example.stdout, example.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
        let said = said.concat();
        assert!(said.contains(says), "{name}: {said}");
        assert_eq!(example.status.success(), code == 0, "{name}: {said}");
        let ended = run.end(PATIENCE).expect_code(code);
        if code != 0 {
            let printed = ended.stdout + &ended.stderr.concat();
            assert!(
                printed.contains("expected a calibration of at least 16 windows"),
                "{printed}"
            );
            continue;
        }
        let summary: Value = serde_json::from_str(&call(&scratch, &["show", name, "--json"], 0).stdout).expect("JSON");
        let healthy = "/intervals/0/scores/sequential";
        assert!(
            number(&summary, &format!("{healthy}/false_alarm_events")).abs() < 0.5,
            "{name}: {summary}"
        );
        if name == "damaged" {
            let found = "/intervals/1/scores/sequential";
            assert!((number(&summary, &format!("{found}/verdict_at_end")) - 3.0).abs() < 0.5);
            assert!(
                number(&summary, &format!("{found}/isolated_after_s")) < 1.0,
                "{summary}"
            );
        }
    }
}

const OVER_TIME: &str = "improved network over time";

/// Those beside the second look, which every run has.
fn own_detectors(scratch: &Scratch, run: &str) -> Vec<Value> {
    let summary: Value = serde_json::from_str(&call(scratch, &["show", run, "--json"], 0).stdout).expect("JSON");
    let mut all = summary["own_detectors"].as_array().cloned().unwrap_or_default();
    assert!(all.iter().any(|one| one["name"] == "Second look"), "{all:?}");
    all.retain(|one| one["name"] != "Second look");
    all
}

/// A run with the paper's network also has the improved one over time; another run gets it on request.
#[test]
fn scenario_the_improved_network_over_time_stands_beside_the_papers() {
    let scratch = Scratch::new();
    fly(&scratch, "reference-flight", "with");
    let own = own_detectors(&scratch, "with");
    assert_eq!(own.len(), 1, "{own:?}");
    assert_eq!(own[0]["name"], OVER_TIME);
    let found = &own[0]["scores"][1];
    assert_eq!(
        (
            found["verdict_at_end"].as_i64(),
            &own[0]["scores"][0]["false_alarm_events"]
        ),
        (Some(3), &Value::from(0))
    );
    assert!(
        found["isolated_after_s"].as_f64().is_some_and(|delay_s| delay_s < 2.0),
        "{found}"
    );
    let again = call(&scratch, &["replay", "with"], 0).stdout;
    assert!(again.contains("same"), "{again}");

    fly(&scratch, "hover", "without");
    assert!(own_detectors(&scratch, "without").is_empty());
    let refused = call(&scratch, &["judge", "without", "--classifier", "f550-paper"], 2)
        .stderr
        .join(" ");
    assert!(refused.contains("does not calibrate itself"), "{refused}");
    let said = call(&scratch, &["judge", "without", "--classifier", "f550-improved"], 0).stdout;
    assert!(said.contains(OVER_TIME), "{said}");
    assert_eq!(own_detectors(&scratch, "without")[0]["scores"][1]["verdict_at_end"], 3);
}

/// The inputs of a network as a table; and a training with custom settings.
#[test]
fn scenario_windows_to_train_on_and_hyperparameters() {
    let scratch = Scratch::new();
    let features = [
        "features",
        "detector-realistic",
        "--method",
        "improved",
        "--limit",
        "2",
        "--out",
        "windows.parquet",
        "--json",
    ];
    let written: Value = serde_json::from_str(&call(&scratch, &features, 0).stdout).unwrap();
    // 90 s are 1440 windows of 62.5 ms.
    assert_eq!(
        (&written["flights"], &written["windows"]),
        (&Value::from(2), &Value::from(2880))
    );
    assert!(scratch.path("windows.parquet").is_file());

    let train = [
        "train",
        "--seeds",
        "1",
        "--epochs",
        "1",
        "--hidden",
        "6",
        "--batch",
        "128",
        "--seed",
        "9",
        "--out",
        "small.json",
    ];
    call(&scratch, &train, 0);
    let text = std::fs::read_to_string(scratch.path("small.json")).unwrap();
    let classifier: Value = serde_json::from_str(&text).unwrap();
    let training = classifier["provenance"]["training"].as_str().unwrap();
    assert!(
        training.contains("1 epochs, batches of 128, 6 hidden neurons"),
        "{training}"
    );
    let command = classifier["provenance"]["command"].as_str().unwrap();
    assert!(
        command.contains("--epochs 1 --hidden 6 --batch 128 --seed 9"),
        "{command}"
    );
    for (option, value, sentence) in [
        ("--hidden", "19", "expected 1 to 18"),
        ("--momentum", "1", "below 1"),
        ("--learning-rate", "-1", "above 0"),
    ] {
        let option = format!("{option}={value}");
        let refused = call(&scratch, &["train", &option, "--out", "none.json"], 2)
            .stderr
            .join(" ");
        assert!(refused.contains(sentence), "{refused}");
    }
}
