//! `rotortwin fdi-log` on flights with a ground in them, a flip, and parts of a log: what is judged, what is not, and why.

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use rotortwin_tests::program::{Call, Ended, Link};
use rotortwin_tests::scratch::{Scratch, repository};
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Take-off, a square and a landing in 75 s; the take-off is asked for at 8 s.
fn from_the_ground(scratch: &Scratch, name: &str, fault: Option<toml::Value>) -> PathBuf {
    let config = repository().join("config");
    let text = std::fs::read_to_string(config.join("scenarios/takeoff-and-land.toml")).expect("it is shipped");
    let mut table: toml::Table = toml::from_str(&text).expect("TOML");
    let vehicle = config.join("vehicles/f550-skids.toml").display().to_string();
    table.insert("vehicle".into(), vehicle.into());
    table.insert("name".into(), name.into());
    table.insert("duration_s".into(), 75.0.into());
    table["trajectory"]
        .as_table_mut()
        .expect("a table")
        .insert("interval_s".into(), 8.0.into());
    if let Some(fault) = fault {
        table.insert("fault".into(), toml::Value::Array(vec![fault]));
    }
    let scenario = scratch.write(&format!("{name}.toml"), toml::to_string(&table).expect("TOML"));
    let ended = Call::fly(scratch, Link::InProcess, &scenario, name)
        .run()
        .expect_code(0);
    ended.out().to_path_buf()
}

fn judged(scratch: &Scratch, words: &[&str], model: &str) -> Value {
    let mut call: Vec<OsString> = vec!["fdi-log".into()];
    call.extend(words.iter().map(OsString::from));
    let ended = Call::new(scratch, call)
        .with(["--json", "--model", model])
        .run()
        .expect_code(0);
    serde_json::from_str(&ended.stdout).expect("JSON")
}

/// A line of the error output has these words.
fn says(ended: &Ended, words: &str) {
    assert!(
        ended.stderr.iter().any(|line| line.contains(words)),
        "{:?}",
        ended.stderr
    );
}

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("expected a number, got {value}"))
}

/// Reasons for what was not judged, in the order of time.
fn reasons(report: &Value) -> Vec<&str> {
    let list = report["not_judged"].as_array().expect("a list");
    list.iter().filter_map(|time| time["reason"].as_str()).collect()
}

/// What was judged and what was not make up the log.
fn nothing_is_left_out(report: &Value) {
    let list = report["not_judged"].as_array().expect("a list");
    let not_judged: f64 = list
        .iter()
        .map(|time| number(&time["to_s"]) - number(&time["from_s"]))
        .sum();
    let all = number(&report["decided_s"]) + not_judged;
    // A window of 62.5 ms may be cut by each end.
    let whole = number(&report["log"]["duration_s"]);
    assert!(
        (all - whole).abs() < 0.07 * (2 + list.len()) as f64,
        "{all} of {whole} s: {report}"
    );
}

fn path(path: &Path) -> &str {
    path.to_str().expect("plain letters")
}

#[test]
fn scenario_a_flight_from_the_ground_is_judged_in_the_air_alone() {
    let scratch = Scratch::new();
    let run = from_the_ground(&scratch, "healthy", None);
    // Until it lands: a touch-down that the thrust follows slowly is not told from flight at once (docs/detector.md).
    let report = judged(&scratch, &[&format!("{}@0:50", path(&run))], "f550-skids");
    let sequential = &report["counts"][2];
    assert_eq!(sequential["alarms"], 0, "{report}");
    assert!(number(&report["decided_s"]) > 20.0, "{report}");
    assert_eq!(report["stretches"].as_array().map(Vec::len), Some(1), "{report}");
    let reasons = reasons(&report);
    // The session needs 0.7 s to see that it stands.
    assert_eq!(reasons, ["calibration", "on_ground", "take_off", "calibration"]);
    nothing_is_left_out(&report);
}

#[test]
fn scenario_a_loss_in_the_air_is_found_after_a_start_on_the_ground() {
    const ONSET_S: f64 = 38.0;
    const LOSS: f64 = 0.07;
    let scratch = Scratch::new();
    let mut fault = toml::Table::new();
    fault.insert("time_s".into(), ONSET_S.into());
    fault.insert("rotor".into(), 2.into());
    fault.insert("thrust_loss_percent".into(), (100.0 * LOSS).into());
    let run = from_the_ground(&scratch, "faulty", Some(fault.into()));
    let report = judged(&scratch, &[&format!("{}@0:50", path(&run))], "f550-skids");
    let first = number(&report["counts"][2]["first_alarm_s"]);
    assert!((ONSET_S..ONSET_S + 2.0).contains(&first), "{report}");
    let last = &report["final_window"]["sequential"];
    assert_eq!(last["rotors"], serde_json::json!([2]), "{report}");
    let loss = &last["thrust_loss"][0];
    assert!(
        number(&loss["share_low"]) < LOSS && LOSS < number(&loss["share_high"]),
        "{loss}"
    );
    // The same of a part that begins in the air.
    let part = judged(&scratch, &[&format!("{}@20:50", path(&run))], "f550-skids");
    assert_eq!(
        part["final_window"]["sequential"]["rotors"],
        serde_json::json!([2]),
        "{part}"
    );
}

const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// Numbers of all rows of a run's telemetry.
fn rows(run: &Path) -> Vec<BTreeMap<String, f64>> {
    let file = std::fs::File::open(run.join("telemetry.parquet")).expect("it was written");
    let reader = SerializedFileReader::new(file).expect("Parquet");
    let number = |field: &Field| match field {
        Field::Double(value) => Some(*value),
        Field::Float(value) => Some(f64::from(*value)),
        _ => None,
    };
    reader
        .get_row_iter(None)
        .expect("rows")
        .map(|row| {
            let row = row.expect("a row");
            let columns = row.get_column_iter();
            columns
                .filter_map(|(name, field)| Some((name.clone(), number(field)?)))
                .collect()
        })
        .collect()
}

/// Columns that the detectors need beside the voltage.
fn needed() -> Vec<String> {
    let mut names = vec!["time_s".to_owned()];
    for (quantity, axes) in [
        ("velocity_X_m_s", ["north", "east", "down"]),
        ("X_rad", AXES),
        ("X_rate_rad_s", AXES),
    ] {
        names.extend(axes.map(|axis| quantity.replace('X', axis)));
    }
    names.extend((1..=6).map(|rotor| format!("duty_{rotor}")));
    names
}

/// These columns of rows, as CSV.
fn csv(names: &[String], rows: impl IntoIterator<Item = BTreeMap<String, f64>>) -> String {
    let mut out = names.join(",") + "\n";
    for row in rows {
        let cells: Vec<String> = names.iter().map(|name| row[name].to_string()).collect();
        out += &(cells.join(",") + "\n");
    }
    out
}

/// A hover in the middle of which attitude and rates make a roll of 360° in 0.8 s that no duty asks for.
fn with_a_flip(scratch: &Scratch) -> PathBuf {
    const FROM_S: f64 = 25.0;
    const LASTS_S: f64 = 0.8;
    let config = repository().join("config");
    let scenario = config.join("scenarios/hover.toml");
    let ended = Call::fly(scratch, Link::InProcess, &scenario, "hover")
        .with(["--set", "duration_s=50"])
        .run()
        .expect_code(0);
    let mut names = needed();
    names.push("battery_voltage_v".to_owned());
    let mut flight = rows(ended.out());
    for row in &mut flight {
        let share = (row["time_s"] - FROM_S) / LASTS_S;
        if (0.0..1.0).contains(&share) {
            // Of least jerk.
            let turn = TAU * share.powi(3) * (10.0 - 15.0 * share + 6.0 * share * share);
            let turn = if turn > PI { turn - TAU } else { turn };
            *row.get_mut("roll_rad").expect("a column") += turn;
            *row.get_mut("roll_rate_rad_s").expect("a column") +=
                TAU / LASTS_S * 30.0 * (share * (1.0 - share)).powi(2);
        }
    }
    scratch.write("flip.csv", csv(&names, flight))
}

#[test]
fn scenario_a_log_without_a_voltage_is_judged_by_what_is_left() {
    const ONSET_S: f64 = 38.0;
    const LOSS: f64 = 0.10;
    let scratch = Scratch::new();
    let fault = format!(
        "fault=[{{time_s={ONSET_S:.1}, rotor=5, thrust_loss_percent={:.1}}}]",
        100.0 * LOSS
    );
    let flown = Call::fly(&scratch, Link::InProcess, Path::new("hover"), "flown")
        .with(["--set", "duration_s=55.0", "--set", &fault])
        .run()
        .expect_code(0);
    let run = flown.out().to_path_buf();
    let flight: Vec<_> = rows(&run).into_iter().filter(|row| row["time_s"] < 50.0).collect();
    let true_voltage = flight[8000]["battery_voltage_v"];
    let log = scratch.write("quiet.csv", csv(&needed(), flight));
    let report = judged(&scratch, &[path(&log)], "f550");
    let lack = &report["lacks"][0];
    assert_eq!(lack["columns"], serde_json::json!(["battery_voltage_v"]), "{report}");
    assert_eq!(lack["prevents_verdicts"], false, "{report}");
    let said = lack["rules_out"].as_str().expect("words");
    assert!(said.starts_with("what all rotors lose together"), "{said}");
    // Worked out of the duties it is that of the battery, to what a start without drag and lag leaves.
    let voltage: f64 = said
        .split_once("battery: ")
        .and_then(|(_, rest)| rest.split_once(" V"))
        .and_then(|(number, _)| number.parse().ok())
        .expect("a voltage");
    assert!(
        (voltage - true_voltage).abs() < 0.3,
        "{voltage} V, it was {true_voltage} V"
    );
    let first = number(&report["counts"][2]["first_alarm_s"]);
    assert!((ONSET_S..ONSET_S + 2.0).contains(&first), "{report}");
    let last = &report["final_window"]["sequential"];
    assert_eq!(last["rotors"], serde_json::json!([5]), "{report}");
    let loss = &last["thrust_loss"][0];
    assert!(
        number(&loss["share_low"]) < LOSS && LOSS < number(&loss["share_high"]),
        "{loss}"
    );
    // A vehicle three times as heavy cannot have flown it: no verdict, and why.
    let heavy = std::fs::read_to_string(repository().join("config/vehicles/f550.toml"))
        .expect("it is shipped")
        .replace("mass_kg = 1.55 ", "mass_kg = 4.65 ")
        .replace(
            "../blades/",
            &format!("{}/", repository().join("config/blades").display()),
        );
    let heavy = scratch.write("heavy.toml", heavy);
    let refused = Call::new(&scratch, ["fdi-log".into(), log.into_os_string()])
        .with(["--model", path(&heavy)])
        .run()
        .expect_code(2);
    says(&refused, "a full battery would carry ");
}

#[test]
fn scenario_a_flip_is_no_fault() {
    let scratch = Scratch::new();
    let log = with_a_flip(&scratch);
    let report = judged(&scratch, &[path(&log)], "f550");
    assert_eq!(report["counts"][2]["alarms"], 0, "{report}");
    assert!(reasons(&report).contains(&"upset"), "{report}");
    // Before it and, after a calibration, behind it.
    assert_eq!(report["stretches"].as_array().map(Vec::len), Some(2), "{report}");
    assert!(number(&report["decided_s"]) > 20.0, "{report}");
    nothing_is_left_out(&report);
    let text = Call::new(&scratch, ["fdi-log".into(), log.into_os_string()])
        .with(["--model", "f550"])
        .run()
        .expect_code(0);
    assert!(text.stdout.contains("cannot judge: upset"), "{}", text.stdout);
}

#[test]
fn scenario_verdicts_are_scored_against_the_truth() {
    const ONSET_S: f64 = 20.0;
    const LOSS: f64 = 0.10;
    let scratch = Scratch::new();
    let flown = |name: &str, fault: &str| {
        Call::fly(&scratch, Link::InProcess, Path::new("hover"), name)
            .with(["--set", "duration_s=30.0", "--set", fault])
            .run()
            .expect_code(0)
            .out()
            .to_path_buf()
    };
    let damaged = flown(
        "damaged",
        &format!(
            "fault=[{{time_s={ONSET_S:.1}, rotor=5, thrust_loss_percent={:.1}}}]",
            100.0 * LOSS
        ),
    );
    let healthy = flown("healthy", "fault=[]");
    let truth = scratch.write(
        "truth.csv",
        format!("log,time_s,rotor,loss\ndamaged,{ONSET_S},5,{LOSS}\nhealthy,0,0,\n"),
    );
    let series = scratch.path("series.csv");
    let logs = [path(&damaged), path(&healthy)];
    // By a side file, and by the labels of the runs: the same score, but for the sizes, which labels do not have.
    let by_file = judged(
        &scratch,
        &[logs[0], logs[1], "--truth", path(&truth), "--series", path(&series)],
        "f550",
    );
    let by_column = judged(&scratch, &[logs[0], logs[1], "--truth", "fault_label"], "f550");
    for (file, column) in [(&by_file[0], &by_column[0]), (&by_file[1], &by_column[1])] {
        for (one, other) in (0..3).map(|i| (&file["score"]["detectors"][i], &column["score"]["detectors"][i])) {
            for count in [
                "windows",
                "right",
                "confusion",
                "isolated_after_steps",
                "settled_after_steps",
            ] {
                assert_eq!(one[count], other[count], "{count}");
            }
        }
    }
    let labels_alone = &by_column[0]["score"];
    assert_eq!(labels_alone["inside_of"], 0);
    assert_eq!(labels_alone["detectors"][2]["by_severity"], serde_json::json!([]));
    let score = &by_file[0]["score"];
    assert_eq!(score["onset_s"], ONSET_S, "{score}");
    let sequential = &score["detectors"][2];
    let isolated_s = 0.0025 * number(&sequential["isolated_after_steps"]);
    assert!((0.0..1.0).contains(&isolated_s), "{sequential}");
    assert!(
        sequential["settled_after_steps"].is_u64() && sequential["wrong_rotor"] == 0,
        "{sequential}"
    );
    assert!(number(&score["inside_of"]) > 50.0, "{score}");
    assert!(number(&score["inside"]) > 0.8 * number(&score["inside_of"]), "{score}");
    let calm = &by_file[1]["score"]["detectors"][2];
    assert_eq!(
        (&calm["false_alarm_events"], &calm["isolated_after_steps"]),
        (&0.into(), &Value::Null)
    );
    assert_eq!(calm["right"], calm["windows"]);

    // The series has every window of both logs, and gives the same count.
    let text = std::fs::read_to_string(&series).expect("it was written");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().expect("a header");
    let place = |name: &str| header.iter().position(|column| *column == name).expect("a column");
    let (log, verdict, label, loss) = (place("log"), place("sequential"), place("truth"), place("true_loss_5"));
    let rows: Vec<_> = lines.collect();
    let right = rows
        .iter()
        .filter(|row| row[log] == logs[0] && row[verdict] == row[label])
        .count();
    assert_eq!(right as u64, sequential["right"].as_u64().expect("a count"));
    assert_eq!(rows.last().expect("rows")[loss], "0");
    assert!(rows.iter().any(|row| row[loss] == "0.1" && row[log] == logs[0]));

    // In words; and what is no truth.
    let table = Call::new(
        &scratch,
        ["fdi-log", logs[0], "--truth", "fault_label", "--model", "f550"].map(OsString::from),
    )
    .run()
    .expect_code(0);
    assert!(
        table.stdout.contains("Against the truth, sequential detector"),
        "{}",
        table.stdout
    );
    let refused = Call::new(
        &scratch,
        ["fdi-log", logs[0], "--truth", "label", "--model", "f550"].map(OsString::from),
    )
    .run()
    .expect_code(2);
    says(&refused, "no column `label` with the truth");
}
