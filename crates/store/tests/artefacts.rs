//! Output files of a run, read back with the readers of their formats.
#![expect(clippy::unwrap_used, reason = "a test that cannot write or read its run has failed")]

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use prost_reflect::{DescriptorPool, DynamicMessage, Value};
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;
use rotortwin_store::files::{MCAP_FILE, REPORT_FILE, SUMMARY_FILE, TELEMETRY_FILE};
use rotortwin_store::streams::Topic;
use rotortwin_store::summary::{Failure, Status};
use rotortwin_store::{
    Kind, Outputs, RunFolder, SpoolHeader, SpoolWriter, Summary, TelemetryRow, finalise, load_summary,
    telemetry_columns,
};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

#[expect(unreachable_pub, reason = "shared with the unit tests of the library")]
mod synthetic;

/// A report must stay small enough to e-mail.
const REPORT_LIMIT_BYTES: usize = 4_000_000;

fn header(rotor_count: usize) -> SpoolHeader {
    SpoolHeader {
        rotor_count,
        step_ns: synthetic::STEP_NS,
        conditions: BTreeMap::from([(1, "blade b".into()), (2, "blade c".into()), (3, "blade d".into())]),
        sensor_faults: vec!["GNSS dropout".into()],
        rotor_positions_body_m: (0..rotor_count)
            .map(|i| [0.25 * (i as f64).cos(), 0.25 * (i as f64).sin(), -0.05])
            .collect(),
        hover_thrust_n: 2.5,
        dropped_loads: Vec::new(),
    }
}

fn facts() -> Summary {
    let mut summary = Summary {
        run_hash: "0123456789abcdef".into(),
        model_hash: "fedcba9876543210".into(),
        program_version: "rotortwin 0.1.0".into(),
        seed: 42,
        link: "iceoryx2".into(),
        pace: "fast".into(),
        wall_s: 0.5,
        ..Summary::default()
    };
    summary.scenario.name = "made-up flight".into();
    summary.scenario.text = "duration_s = 90.0\n".into();
    summary
}

/// Runs `rows` through spool and `finalise` in `path`.
fn fly(path: &Path, rotor_count: usize, rows: impl Iterator<Item = TelemetryRow>, summary: Summary) -> Outputs {
    let folder = RunFolder::create(path).unwrap();
    let mut spool = SpoolWriter::create(&folder.spool_path(), &header(rotor_count)).unwrap();
    for row in rows {
        spool.push(&row).unwrap();
    }
    spool.finish().unwrap();
    finalise(&folder, summary).unwrap()
}

fn names(path: &Path) -> BTreeSet<String> {
    std::fs::read_dir(path)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect()
}

#[test]
fn val_parquet_holds_every_value_of_every_step() {
    let folder = tempfile::tempdir().unwrap();
    let outputs = fly(folder.path(), synthetic::ROTORS, (0..400).map(synthetic::row), facts());
    let reader = SerializedFileReader::new(std::fs::File::open(outputs.telemetry.unwrap()).unwrap()).unwrap();
    let columns = telemetry_columns(synthetic::ROTORS);
    let mut expected = vec![0.0; columns.len()];
    let mut rows = 0;
    for (step, row) in reader.get_row_iter(None).unwrap().enumerate() {
        let row = row.unwrap();
        synthetic::row(step as u64).fill(synthetic::ROTORS, &mut expected);
        for (at, (name, field)) in row.get_column_iter().enumerate() {
            assert_eq!(*name, columns[at].name);
            let value = match (columns[at].kind, field) {
                (Kind::F64, Field::Double(value)) => *value,
                (Kind::F32, Field::Float(value)) => f64::from(*value),
                (Kind::I32, Field::Int(value)) => f64::from(*value),
                (Kind::U64, Field::ULong(value)) => *value as f64,
                other => panic!("{name}: {other:?}"),
            };
            assert_eq!(value.to_bits(), expected[at].to_bits(), "{name} of step {step}");
        }
        rows += 1;
    }
    assert_eq!(rows, 400);

    let metadata = reader.metadata().file_metadata().key_value_metadata().unwrap();
    let value = |key: &str| {
        metadata
            .iter()
            .find(|entry| entry.key == key)
            .unwrap()
            .value
            .clone()
            .unwrap()
    };
    assert_eq!(value("rotortwin.run_hash"), "0123456789abcdef");
    assert_eq!(value("rotortwin.seed"), "42");
    assert_eq!(value("rotortwin.scenario_text"), "duration_s = 90.0\n");
    let units: serde_json::Value = serde_json::from_str(&value("rotortwin.columns")).unwrap();
    assert_eq!(units["residual_1_arm_nms"]["unit"], "N m s");
    let conditions: serde_json::Value = serde_json::from_str(&value("rotortwin.conditions")).unwrap();
    assert_eq!(conditions["2"], "blade c");
}

#[test]
fn val_parquet_of_a_long_flight_has_several_row_groups() {
    let folder = tempfile::tempdir().unwrap();
    let outputs = fly(folder.path(), 4, (0..66_000).map(synthetic::row), facts());
    let reader = SerializedFileReader::new(std::fs::File::open(outputs.telemetry.unwrap()).unwrap()).unwrap();
    assert_eq!(reader.metadata().num_row_groups(), 2);
    assert_eq!(reader.metadata().file_metadata().num_rows(), 66_000);
    assert_eq!(outputs.summary.steps, 66_000);
}

/// The value at a path of field names and list indices.
fn value_at(message: &DynamicMessage, path: &str) -> f64 {
    let (name, rest) = path.split_once('.').unwrap_or((path, ""));
    let value = message
        .get_field_by_name(name)
        .unwrap_or_else(|| panic!("no field {name}"))
        .into_owned();
    let number = |value: &Value| match value {
        Value::F32(value) => f64::from(*value),
        Value::F64(value) => *value,
        Value::I32(value) => f64::from(*value),
        Value::U32(value) => f64::from(*value),
        Value::Bool(value) => f64::from(u8::from(*value)),
        other => panic!("{path}: {other:?}"),
    };
    match &value {
        Value::Message(inner) => value_at(inner, rest),
        Value::List(list) => {
            let (place, rest) = rest.split_once('.').unwrap_or((rest, ""));
            match &list[place.parse::<usize>().unwrap()] {
                Value::Message(inner) => value_at(inner, rest),
                value => number(value),
            }
        }
        value => number(value),
    }
}

/// Decodes a message with the descriptor embedded in the file.
fn decoded(message: &mcap::Message<'_>) -> DynamicMessage {
    let schema = message.channel.schema.as_ref().unwrap();
    assert_eq!(
        (schema.encoding.as_str(), message.channel.message_encoding.as_str()),
        ("protobuf", "protobuf"),
        "one encoding for all"
    );
    let pool = DescriptorPool::decode(&schema.data[..]).unwrap();
    let kind = pool
        .get_message_by_name(&schema.name)
        .unwrap_or_else(|| panic!("no message {}", schema.name));
    DynamicMessage::decode(kind, &message.data[..]).unwrap()
}

#[test]
fn val_mcap_messages_are_those_of_the_proto_files() {
    let folder = tempfile::tempdir().unwrap();
    // Every field has a distinct value, so that a wrong tag or column shows.
    let mut row = synthetic::row(20_009);
    row.step = 0;
    row.sim_time_ns = 0;
    row.truth.wind_ned_m_s = [1.0, 2.0, 3.0];
    row.wrench_residual = [0.1, 0.2, 0.3, 0.4];
    row.network = 2;
    row.t_test = -1;
    row.sequential = 3;
    row.sequential_probability = 0.75;
    row.thrust_loss = [0.125, 0.0625, 0.25, 0.5, 0.375, 0.625];
    row.second_thrust_loss = [0.75, 0.6875, 0.875, 0.03125, 0.015625, 0.046875];
    row.suspect_rotors = 6;
    row.hypothesis_count = 9;
    row.saturated_rotors = 5;
    row.sensor_faults = 1;
    row.window_end = true;
    let outputs = fly(folder.path(), synthetic::ROTORS, std::iter::once(row), facts());
    let bytes = std::fs::read(outputs.mcap.unwrap()).unwrap();

    let mut messages = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert_eq!(message.log_time, 0);
        let decoded = decoded(&message);
        assert_eq!(decoded.unknown_fields().count(), 0, "{}", message.channel.topic);
        messages.insert(message.channel.topic.clone(), decoded);
    }
    let f = f64::from;
    let single = |value: f64| f64::from(value as f32);
    for (topic, path, expected) in [
        ("/nav", "position_ned_m.east", f(row.position_ned_m[1])),
        ("/nav", "velocity_ned_m_s.north", f(row.velocity_ned_m_s[0])),
        ("/nav", "attitude.yaw_rad", f(row.attitude_rad[2])),
        ("/nav", "body_rates_rad_s.right", f(row.body_rates_rad_s[1])),
        ("/reference", "position_ned_m.down", f(row.reference_position_ned_m[2])),
        (
            "/reference",
            "velocity_ned_m_s.east",
            f(row.reference_velocity_ned_m_s[1]),
        ),
        ("/reference", "yaw_rad", f(row.reference_yaw_rad)),
        (
            "/reference",
            "attitude_setpoint.roll_rad",
            f(row.attitude_setpoint_rad[0]),
        ),
        ("/command", "duty.5", f(row.duty[5])),
        ("/command", "saturated_rotors", 5.0),
        ("/truth", "position_ned_m.north", single(row.truth.position_ned_m[0])),
        ("/truth", "velocity_ned_m_s.down", single(row.truth.velocity_ned_m_s[2])),
        ("/truth", "attitude.pitch_rad", single(row.truth.attitude_rad[1])),
        (
            "/truth",
            "body_rates_rad_s.forward",
            single(row.truth.body_rates_rad_s[0]),
        ),
        ("/truth", "thrust_n.2", single(row.truth.thrust_n[2])),
        ("/truth", "wind_ned_m_s.east", 2.0),
        ("/truth", "fault_label", 3.0),
        ("/truth", "faulty_rotors", 4.0),
        ("/truth", "rotor_condition.2", 1.0),
        ("/truth", "sensor_faults", 1.0),
        ("/battery", "voltage_v", f(row.battery_voltage_v)),
        ("/battery", "current_a", single(row.battery_current_a)),
        ("/battery", "true_voltage_v", single(row.truth.battery_voltage_v)),
        (
            "/battery",
            "open_circuit_voltage_v",
            single(row.truth.open_circuit_voltage_v),
        ),
        ("/battery", "state_of_charge", single(row.truth.state_of_charge)),
        ("/fdi", "residual_arm_nms.0", f(row.residuals_nms[0][0])),
        ("/fdi", "residual_lever_nms.2", f(row.residuals_nms[2][1])),
        ("/fdi", "residual_yaw_nms.5", f(row.residuals_nms[5][2])),
        ("/fdi", "wrench_residual.3", f(row.wrench_residual[3])),
        ("/fdi", "verdict_t_test", -1.0),
        ("/fdi", "verdict_network", 2.0),
        ("/fdi", "verdict_sequential", 3.0),
        ("/fdi", "sequential_probability", 0.75),
        ("/fdi", "thrust_loss_n", 0.125),
        ("/fdi", "thrust_loss_low_n", 0.0625),
        ("/fdi", "thrust_loss_high_n", 0.25),
        ("/fdi", "thrust_loss_share", 0.5),
        ("/fdi", "thrust_loss_share_low", 0.375),
        ("/fdi", "thrust_loss_share_high", 0.625),
        ("/fdi", "second_thrust_loss_n", 0.75),
        ("/fdi", "second_thrust_loss_low_n", 0.6875),
        ("/fdi", "second_thrust_loss_high_n", 0.875),
        ("/fdi", "second_thrust_loss_share", 0.03125),
        ("/fdi", "second_thrust_loss_share_low", 0.015625),
        ("/fdi", "second_thrust_loss_share_high", 0.046875),
        ("/fdi", "suspect_rotors", 6.0),
        ("/fdi", "hypothesis_count", 9.0),
        ("/fdi", "window_end", 1.0),
    ] {
        assert_eq!(value_at(&messages[topic], path), expected, "{topic} {path}");
    }
}

#[test]
fn val_mcap_has_every_step_and_logs_the_faults() {
    let folder = tempfile::tempdir().unwrap();
    let mut summary = facts();
    summary.status = Status::Failed;
    summary.failure = Some(Failure {
        peer: "fdi".into(),
        sentence: "the FDI engine fell silent".into(),
        ..Failure::default()
    });
    // From 44.5 s to 45.5 s: the fault begins at 45 s, the sequential detector follows at 45.2 s.
    let rows = (17_800..18_200).map(synthetic::row);
    let outputs = fly(folder.path(), synthetic::ROTORS, rows, summary);
    let bytes = std::fs::read(outputs.mcap.unwrap()).unwrap();
    let file = mcap::Summary::read(&bytes).unwrap().unwrap();
    let counts = &file.stats.as_ref().unwrap().channel_message_counts;
    let channels: BTreeMap<_, _> = file.channels.iter().collect();
    for (id, channel) in channels {
        let expected = match channel.topic.as_str() {
            "/tf" => 2 * 40,
            "/pose" | "/reference_pose" => 40,
            "/scene" => 20,
            "/trail" => 2,
            "/log" => 4,
            _ => 400,
        };
        assert_eq!(counts[id], expected, "{}", channel.topic);
    }
    assert_eq!(file.channels.len(), 12);
    let log: Vec<(u64, String)> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| message.unwrap())
        .filter(|message| message.channel.topic == "/log")
        .map(|message| {
            let line = decoded(&message);
            let text = line.get_field_by_name("message").unwrap();
            (message.log_time, text.as_str().unwrap().to_owned())
        })
        .collect();
    assert_eq!(
        log,
        [
            (44_500_000_000, "healthy".to_owned()),
            (45_000_000_000, "rotor 3: blade b".to_owned()),
            (45_200_000_000, "rotor 3".to_owned()),
            (45_497_500_000, "the FDI engine fell silent".to_owned()),
        ]
    );
}

#[test]
fn val_transform_keeps_the_direction_of_the_nose() {
    // Yaw 90° (east) and pitch up: in north-west-up the nose points to −west and up.
    let folder = tempfile::tempdir().unwrap();
    let mut row = TelemetryRow::default();
    row.truth.attitude_rad = [0.3, 0.2, std::f64::consts::FRAC_PI_2];
    row.truth.position_ned_m = [1.0, 2.0, 3.0];
    let outputs = fly(folder.path(), 4, std::iter::once(row), facts());
    let bytes = std::fs::read(outputs.mcap.unwrap()).unwrap();
    let transform = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| message.unwrap())
        .find(|message| message.channel.topic == "/tf")
        .unwrap();
    let transform = decoded(&transform);
    let number = |object: &str, name: &str| value_at(&transform, &format!("{object}.{name}"));
    let [w, x, y, z] = ["w", "x", "y", "z"].map(|name| number("rotation", name));
    // First and second column of the rotation matrix: nose (forward) and left wing.
    let nose = [
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y + w * z),
        2.0 * (x * z - w * y),
    ];
    let left = [
        2.0 * (x * y - w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z + w * x),
    ];
    const TOLERANCE: f64 = 1e-12;
    let close = |value: f64, expected: f64| (value - expected).abs() < TOLERANCE;
    assert!(
        close(nose[0], 0.0) && close(nose[1], -(0.2f64.cos())) && close(nose[2], 0.2f64.sin()),
        "{nose:?}"
    );
    // Roll to the right lifts the left wing.
    assert!(close(left[2], 0.2f64.cos() * 0.3f64.sin()), "{left:?}");
    assert_eq!(
        ["x", "y", "z"].map(|name| number("translation", name)),
        [1.0, -2.0, -3.0]
    );
}

/// According to the definition of Foxglove's primitives: a cylinder is centred at its pose, an arrow points along its pose's x
/// axis.
#[test]
fn val_scene_shows_rotors_thrust_and_fault_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let mut row = synthetic::row(20_009);
    (row.step, row.sim_time_ns) = (0, 0);
    row.truth.thrust_n[2] = 1.25;
    row.sequential = 3;
    row.suspect_rotors = 0b100;
    let outputs = fly(folder.path(), synthetic::ROTORS, std::iter::once(row), facts());
    let bytes = std::fs::read(outputs.mcap.unwrap()).unwrap();
    let find = |topic: &str| {
        let mut messages = mcap::MessageStream::new(&bytes)
            .unwrap()
            .map(|message| message.unwrap());
        decoded(&messages.find(|message| message.channel.topic == topic).unwrap())
    };
    let scene = find("/scene");
    let at = |path: String| value_at(&scene, &format!("entities.0.{path}"));
    const TOLERANCE: f64 = 1e-12;
    let close = |value: f64, expected: f64| (value - expected).abs() < TOLERANCE;
    let made = header(synthetic::ROTORS);
    for (rotor, [forward, right, down]) in made.rotor_positions_body_m.iter().enumerate() {
        for drawn in ["cylinders", "arrows"] {
            let place = ["x", "y", "z"].map(|axis| at(format!("{drawn}.{rotor}.pose.position.{axis}")));
            assert_eq!(place, [*forward, -right, -down], "{drawn} {rotor}: forward, left, up");
        }
        let [w, x, y, z] = ["w", "x", "y", "z"].map(|name| at(format!("arrows.{rotor}.pose.orientation.{name}")));
        let along = [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + w * z),
            2.0 * (x * z - w * y),
        ];
        assert!(
            close(along[0], 0.0) && close(along[1], 0.0) && close(along[2], 1.0),
            "up: {along:?}"
        );
        let length = at(format!("arrows.{rotor}.shaft_length")) + at(format!("arrows.{rotor}.head_length"));
        let expected = 0.25 * row.truth.thrust_n[rotor] / made.hover_thrust_n;
        assert!(close(length, expected), "an arm at hover: {length} {expected}");
        let red = |drawn: &str| at(format!("{drawn}.{rotor}.color.r"));
        assert_eq!(red("cylinders") > 0.8, rotor == 2, "the faulty one is red");
        assert_eq!(red("arrows") > 0.8, rotor == 2, "the suspected one is orange");
    }
    let (pose, transform) = (find("/pose"), find("/tf"));
    for axis in ["x", "y", "z"] {
        assert_eq!(
            value_at(&pose, &format!("pose.position.{axis}")),
            value_at(&transform, &format!("translation.{axis}"))
        );
    }
}

/// The data embedded in a report.
fn inside(page: &str) -> serde_json::Value {
    let (_, rest) = page.split_once("id=\"report\">").unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn scenario_full_flight_leaves_a_complete_folder() {
    let base = tempfile::tempdir().unwrap();
    let path = base.path().join("runs/one");
    let outputs = fly(&path, synthetic::ROTORS, (0..36_000).map(synthetic::row), facts());
    let expected = [TELEMETRY_FILE, MCAP_FILE, SUMMARY_FILE, REPORT_FILE, "figures"].map(str::to_owned);
    assert_eq!(names(&path), BTreeSet::from(expected));
    assert_eq!(names(&path.join("figures")).len(), 6);

    let summary = load_summary(&path).unwrap();
    assert_eq!(summary, outputs.summary);
    assert_eq!(
        (summary.run.as_str(), summary.steps, summary.simulated_s),
        ("one", 36_000, 90.0)
    );
    assert_eq!(summary.steps_per_s, 72_000.0);
    let starts: Vec<f64> = summary.intervals.iter().map(|interval| interval.start_s).collect();
    assert_eq!(starts, [0.0, 45.0, 60.0, 75.0]);
    assert_eq!(summary.intervals[3].description, "rotor 3: blade d");
    assert!(
        summary.intervals[1..]
            .iter()
            .all(|interval| interval.scores.sequential.isolated_after_s.unwrap() <= 0.25)
    );
    // The synthetic residual 3 does not react to the fault of rotor 3, residual 1 does.
    let means = &summary.intervals[3].residual_means_nms;
    assert!(means[0][0] < -0.05 && means[2][0].abs() < 0.01);

    let report = std::fs::read_to_string(&outputs.report).unwrap();
    assert!(report.len() < REPORT_LIMIT_BYTES, "{} bytes", report.len());
    for text in [
        "made-up flight",
        "0123456789abcdef",
        "<noscript>",
        "rotor 3: blade c",
        "no network loaded",
        "Permission is hereby granted, free of charge",
        "duration_s = 90.0",
    ] {
        assert!(report.contains(text), "{text} is missing");
    }
    // Embedded is what the server would return: channels on one time axis, without losing any spike.
    let inside = inside(&report);
    assert_eq!(
        (&inside["kind"], &inside["data"]["summary"]["steps"]),
        (&"run".into(), &36_000.into())
    );
    let data = inside["data"]["telemetry"]["data"].as_object().unwrap();
    let rows = data["time_s"].as_array().unwrap().len();
    assert!((800..=1600).contains(&rows), "{rows}");
    for channel in [
        "duty_1",
        "residual_6_yaw_nms",
        "verdict_sequential",
        "reference_down_m",
        "thrust_loss_share_high",
    ] {
        assert_eq!(data[channel].as_array().unwrap().len(), rows, "{channel}");
    }
    assert_eq!(inside["data"]["normal"]["panels"].as_array().unwrap().len(), 2);
    for figure in &outputs.figures {
        let svg = std::fs::read_to_string(figure).unwrap();
        assert!(
            svg.starts_with("<svg") && svg.ends_with("</svg>\n") && !svg.contains("NaN"),
            "{}",
            figure.display()
        );
    }
}

#[test]
fn scenario_failed_run_is_told_with_the_rows_it_has() {
    for rows in [0, 1, 3, 4_500] {
        let folder = tempfile::tempdir().unwrap();
        let mut summary = facts();
        summary.status = Status::Failed;
        summary.failure = Some(Failure {
            peer: "controller".into(),
            step: rows,
            silence_ms: 900,
            lost: true,
            sentence: "the controller <pid 7> was silent for 900 ms".into(),
        });
        let outputs = fly(folder.path(), synthetic::ROTORS, (0..rows).map(synthetic::row), summary);
        assert_eq!(load_summary(folder.path()).unwrap().steps, rows);
        let report = std::fs::read_to_string(&outputs.report).unwrap();
        assert!(report.contains("the controller &lt;pid 7&gt; was silent for 900 ms"));
        assert_eq!(inside(&report)["data"]["telemetry"].is_null(), rows == 0);
        let file = std::fs::File::open(outputs.telemetry.unwrap()).unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        assert_eq!(reader.metadata().file_metadata().num_rows(), rows as i64);
        assert!(
            mcap::Summary::read(&std::fs::read(outputs.mcap.unwrap()).unwrap())
                .unwrap()
                .is_some()
        );
    }
}

#[test]
fn scenario_run_that_failed_before_its_spool_has_summary_and_report() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunFolder::create(folder.path()).unwrap();
    let outputs = finalise(
        &run,
        Summary {
            status: Status::Failed,
            ..facts()
        },
    )
    .unwrap();
    assert!(outputs.telemetry.is_none() && outputs.mcap.is_none() && outputs.figures.is_empty());
    assert_eq!(
        names(folder.path()),
        BTreeSet::from([SUMMARY_FILE, REPORT_FILE].map(str::to_owned))
    );
}

#[test]
fn scenario_flight_that_diverged_is_still_told() {
    let folder = tempfile::tempdir().unwrap();
    let rows = (0..4_500).map(|step| {
        let mut row = synthetic::row(step);
        if step > 2_000 {
            row.truth.position_ned_m = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
            row.residuals_nms[0] = [f32::NAN; 3];
        }
        row
    });
    fly(folder.path(), synthetic::ROTORS, rows, facts());
    let summary = load_summary(folder.path()).unwrap();
    assert!(!summary.tracking.unwrap().position_rms_m.is_finite());
    assert_eq!(summary.steps, 4_500);
}

#[test]
fn val_report_of_the_largest_vehicle_stays_small() {
    let folder = tempfile::tempdir().unwrap();
    let rows = (0..12_000).map(|step| TelemetryRow {
        step,
        sim_time_ns: step * synthetic::STEP_NS,
        network: NOT_READY,
        // Worst case for the verdict tracks: a different verdict at every step.
        t_test: (step % 17) as i32,
        window_end: true,
        ..TelemetryRow::default()
    });
    let outputs = fly(folder.path(), 16, rows, facts());
    let length = std::fs::metadata(outputs.report).unwrap().len() as usize;
    assert!(length < REPORT_LIMIT_BYTES, "{length} bytes");
}

/// Everything drawn by the shipped Foxglove and Lichtblick layout is in the streams: topics, and fields of their messages.
#[test]
fn val_layout_names_topics_and_fields_that_there_are() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/foxglove/rotortwin.json");
    let layout: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let topics: BTreeMap<&str, Topic> = Topic::ALL.into_iter().map(|topic| (topic.name(), topic)).collect();
    let panels = layout["configById"].as_object().unwrap();
    let (mut fields, mut shown) = (0, BTreeSet::new());
    for (name, panel) in panels {
        for path in panel["paths"].as_array().into_iter().flatten() {
            let path = path["value"].as_str().unwrap();
            let (topic, rest) = path.split_once('.').unwrap();
            let topic = topics.get(topic).unwrap_or_else(|| panic!("{name}: {path}"));
            let (message, descriptors) = topic.schema();
            let pool = DescriptorPool::decode(descriptors).unwrap();
            let mut kind = pool.get_message_by_name(message);
            for step in rest.split('.') {
                let step = step.split('[').next().unwrap();
                let field = kind.as_ref().and_then(|kind| kind.get_field_by_name(step));
                let field = field.unwrap_or_else(|| panic!("{name}: {path}: no {step}"));
                kind = field.kind().as_message().cloned();
            }
            assert!(kind.is_none(), "{name}: {path} is no number");
            fields += 1;
        }
        let listed = panel["topics"]
            .as_object()
            .into_iter()
            .flat_map(|topics| topics.keys().map(String::as_str));
        for topic in listed.chain(panel["topicToRender"].as_str()) {
            assert!(topics.contains_key(topic), "{name}: {topic}");
            shown.insert(topic);
        }
    }
    assert!(
        fields > 10 && shown.contains("/scene") && shown.contains("/log"),
        "{fields} {shown:?}"
    );
    // Each slot of the layout has a panel.
    let mut places = vec![&layout["layout"]];
    while let Some(place) = places.pop() {
        match place.as_str() {
            Some(panel) => assert!(panels.contains_key(panel), "{panel}"),
            None => places.extend([&place["first"], &place["second"]]),
        }
    }
}
