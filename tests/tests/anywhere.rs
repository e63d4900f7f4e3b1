//! The program far from its source: documents are found by name, and the user's own take precedence over the built-in
//! ones.

use rotortwin_tests::program::program;
use rotortwin_tests::scratch::Scratch;
use serde_json::Value;
use std::process::{Command, Output};

/// In the test's folder, which is also its home, so that nothing of this machine is seen.
fn call(scratch: &Scratch, words: &[&str]) -> Output {
    Command::new(program())
        .args(words)
        .current_dir(scratch.folder())
        .env("HOME", scratch.folder())
        .env_remove("XDG_CACHE_HOME")
        .env_remove("XDG_CONFIG_HOME")
        .env("ROTORTWIN_CONFIG", scratch.path("own"))
        .output()
        .expect("the program starts")
}

fn done(scratch: &Scratch, words: &[&str]) -> String {
    let ended = call(scratch, words);
    let said = String::from_utf8_lossy(&ended.stdout).into_owned();
    assert!(
        ended.status.success(),
        "{words:?}: {said}{}",
        String::from_utf8_lossy(&ended.stderr)
    );
    said
}

fn refused(scratch: &Scratch, words: &[&str]) -> String {
    let ended = call(scratch, words);
    assert_eq!(ended.status.code(), Some(2), "{words:?}");
    String::from_utf8_lossy(&ended.stderr).into_owned()
}

#[test]
fn scenario_a_flight_by_name_in_an_empty_folder() {
    let scratch = Scratch::new();
    done(
        &scratch,
        &["fly", "short-hover", "--link", "in-process", "--out", "flown"],
    );
    done(&scratch, &["replay", "flown"]);
    done(&scratch, &["check", "reference-flight"]);
    done(&scratch, &["compare", "flown", "--model", "f550"]);
    done(&scratch, &["campaign", "octo-lag", "--check"]);
    done(
        &scratch,
        &["blind", "generate", "--duration-s", "2", "--out", "log.parquet"],
    );
    // It is shorter than a calibration, and says so.
    let told = refused(
        &scratch,
        &["fdi-log", "flown", "--model", "f550", "--classifier", "f550-paper"],
    );
    assert!(told.contains("flown: nothing could be judged in 5.0 s"), "{told}");
}

#[test]
fn scenario_a_copy_of_ones_own_goes_first() {
    let scratch = Scratch::new();
    let said = done(&scratch, &["new", "scenario", "mine", "--from", "short-hover"]);
    assert!(said.contains("rotortwin fly mine.toml"), "{said}");
    done(
        &scratch,
        &["fly", "mine.toml", "--link", "in-process", "--out", "flown"],
    );
    let text = std::fs::read_to_string(scratch.path("mine.toml")).unwrap();
    assert!(text.contains("vehicle = \"f550\""), "{text}");
    // Nothing is overwritten.
    assert!(
        refused(&scratch, &["new", "scenario", "mine", "--from", "hover"]).contains("mine.toml: cannot be written")
    );
    assert_eq!(std::fs::read_to_string(scratch.path("mine.toml")).unwrap(), text);

    std::fs::create_dir_all(scratch.path("own/scenarios")).unwrap();
    std::fs::write(scratch.path("own/scenarios/hover.toml"), &text).unwrap();
    let list: Value = serde_json::from_str(&done(&scratch, &["list", "scenarios", "--json"])).unwrap();
    let of = |name: &str| {
        list.as_array()
            .unwrap()
            .iter()
            .find(|entry| entry["name"] == name)
            .unwrap()
            .clone()
    };
    assert_eq!(of("hover")["shipped"], false);
    assert_eq!(of("reference-flight")["shipped"], true);
    assert!(done(&scratch, &["check", "hover"]).contains("name = \"mine\""));
    assert!(done(&scratch, &["config"]).contains(&scratch.path("own").display().to_string()));
}

#[test]
fn scenario_a_misspelt_name_is_answered_with_the_nearest() {
    let scratch = Scratch::new();
    for (words, nearest) in [
        (&["fly", "referense-flight"][..], "did you mean 'reference-flight'?"),
        (&["campaign", "detector-idael"], "did you mean 'detector-ideal'?"),
        (
            &["compare", "no.log", "--model", "f505"],
            "did you mean the vehicle 'f550'?",
        ),
        (&["new", "vehicle", "mine", "--from", "quad"], "did you mean 'quad-x'?"),
        (
            &["new", "scenario", "a b", "--from", "hover"],
            "expected a name of 1 to 64 letters",
        ),
    ] {
        let said = refused(&scratch, words);
        assert!(said.contains(nearest), "{words:?}: {said}");
    }
}

#[test]
fn scenario_a_misspelt_path_is_answered_with_the_nearest() {
    let scratch = Scratch::new();
    std::fs::create_dir_all(scratch.path("logs")).unwrap();
    std::fs::create_dir_all(scratch.path("runs/hover-1")).unwrap();
    done(&scratch, &["new", "scenario", "mine", "--from", "short-hover"]);
    done(&scratch, &["new", "vehicle", "frame", "--from", "f550"]);
    done(&scratch, &["new", "campaign", "night", "--from", "octo-lag"]);
    for file in ["logs/flight.ulg", "truth.csv", "runs/hover-1/summary.json"] {
        std::fs::write(scratch.path(file), "").unwrap();
    }
    for (line, meant) in [
        // Scenarios, campaigns, vehicles, models.
        ("fly mien.toml", "file 'mine.toml'"),
        ("check minee.toml", "file 'mine.toml'"),
        ("campaign nihgt.toml", "file 'night.toml'"),
        ("compare logs/flight.ulg --model fraem.toml", "file 'frame.toml'"),
        ("fly mine.toml --model fraem.toml", "file 'frame.toml'"),
        ("model import fraem.toml", "file 'frame.toml'"),
        // Logs, and tables next to them.
        ("compare logs/fligth.ulg --model f550", "file 'logs/flight.ulg'"),
        ("compare logs/fligth.ulg@1:2 --model f550", "file 'logs/flight.ulg'"),
        ("diagnose lgos/flight.ulg --model f550", "file 'logs/flight.ulg'"),
        ("improve logs/fligth.ulg --model f550 --yes", "file 'logs/flight.ulg'"),
        ("log show logs/fligth.ulg", "file 'logs/flight.ulg'"),
        ("log import logs/fligth.ulg", "file 'logs/flight.ulg'"),
        ("fdi-log logs/fligth.ulg --model f550", "file 'logs/flight.ulg'"),
        ("vibration logs/fligth.ulg", "file 'logs/flight.ulg'"),
        ("fleet add a logs/fligth.ulg --model f550", "file 'logs/flight.ulg'"),
        (
            "vehicle from-log logs/fligth.ulg --mass 1 --arm 0.2",
            "file 'logs/flight.ulg'",
        ),
        ("fit thrust turth.csv --map thrust=2:kg", "file 'truth.csv'"),
        // Folders of runs.
        ("replay runs/hovr-1", "folder 'runs/hover-1'"),
        ("show rusn/hover-1", "folder 'runs/hover-1'"),
        ("export runs/hover1 --format csv --out x.csv", "folder 'runs/hover-1'"),
        ("controllers --runs runs/hovr-1 runs/hover-1", "folder 'runs/hover-1'"),
        ("campaign merge octo-lag lgos --out whole", "folder 'logs'"),
        // A file here with the requested name.
        ("fly mine", "file 'mine.toml'"),
        ("check mine", "file 'mine.toml'"),
        ("campaign night", "file 'night.toml'"),
        ("compare logs/flight.ulg --model frame", "file 'frame.toml'"),
    ] {
        let words: Vec<&str> = line.split(' ').collect();
        let said = refused(&scratch, &words);
        assert!(said.contains(&format!("did you mean the {meant}?")), "{line}: {said}");
    }
    // Nothing is near, and an error in an existing file names no other.
    for line in [
        "fly xyz.toml",
        "show zzzzzz",
        "compare logs/flight.ulg --model f550",
        "fly truth.csv",
    ] {
        let words: Vec<&str> = line.split(' ').collect();
        let said = refused(&scratch, &words);
        assert!(!said.contains("did you mean"), "{line}: {said}");
    }
}
