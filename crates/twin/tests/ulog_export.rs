//! ULog as this project writes it, read by this project's import and by PX4's own reader (`pyulog`), held against the run's Parquet file.
#![expect(clippy::unwrap_used, reason = "a test that cannot write or read its run has failed")]

use rotortwin_store::export::{ExportFormat, export_to};
use rotortwin_store::run_folder::TELEMETRY_FILE;
use rotortwin_store::{RunFolder, SpoolHeader, SpoolWriter, Summary, finalise};
use rotortwin_twin::log::FlightLog;
use std::path::{Path, PathBuf};
use std::process::Command;

#[expect(unreachable_pub, reason = "public in the crate that the file is of")]
#[path = "../../../tests/src/skip.rs"]
mod skip;
#[expect(unreachable_pub, reason = "shared with the tests of the crate that the file is of")]
#[path = "../../store/tests/synthetic/mod.rs"]
mod synthetic;

const ROWS: u64 = 2000;
/// Half a step of single precision at 1 rad: a quaternion of floats carries angles so well.
const ANGLE_TOLERANCE_RAD: f64 = 3e-7;

/// A made-up run as Parquet and as ULog.
fn exported(folder: &Path) -> (PathBuf, PathBuf) {
    let run = RunFolder::create(&folder.join("run")).unwrap();
    let header = SpoolHeader {
        rotor_count: synthetic::ROTORS,
        step_ns: synthetic::STEP_NS,
        ..SpoolHeader::default()
    };
    let mut spool = SpoolWriter::create(&run.spool_path(), &header).unwrap();
    // Across the onset of the fault at 45 s.
    for step in 17_000..17_000 + ROWS {
        spool.push(&synthetic::row(step)).unwrap();
    }
    spool.finish().unwrap();
    let mut summary = Summary::default();
    summary.scenario.vehicle = "made up".to_owned();
    finalise(&run, summary, &[]).unwrap();
    let ulog = folder.join("run.ulg");
    export_to(run.path(), ExportFormat::Ulog, &ulog).unwrap();
    (run.path().join(TELEMETRY_FILE), ulog)
}

#[test]
fn val_a_run_exported_as_ulog_is_imported_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (parquet, ulog) = exported(folder.path());
    let (before, after) = (FlightLog::read(&parquet).unwrap(), FlightLog::read(&ulog).unwrap());
    assert_eq!(after.time_s.len() as u64, ROWS);
    // The import of a ULog counts from its first sample.
    let shift = before.time_s[0] - after.time_s[0];
    let apart = |(a, b): (&f64, &f64)| (a - b - shift).abs() > 1e-9;
    assert!(!before.time_s.iter().zip(&after.time_s).any(apart));
    assert_eq!(after.rotor_count(), synthetic::ROTORS);
    let mut compared = 0;
    for (name, values) in &after.columns {
        let Some(written) = before.column(name) else { continue };
        let tolerance = match name.as_str() {
            "roll_rad" | "pitch_rad" | "yaw_rad" => ANGLE_TOLERANCE_RAD,
            // Double precision in Parquet, single in PX4's topic.
            "battery_current_a" => 3e-6,
            _ => 0.0,
        };
        for (row, (a, b)) in values.iter().zip(written).enumerate() {
            assert!(
                (a - b).abs() <= tolerance || a.is_nan() && b.is_nan(),
                "{name} row {row}: {a} {b}"
            );
        }
        compared += 1;
    }
    // Position, velocity, attitude, rates, acceleration, duties, battery, reference with yaw.
    assert_eq!(
        compared,
        3 * 5 + synthetic::ROTORS + 2 + 4,
        "{:?}",
        after.columns.keys()
    );
}

/// Prints what PX4's reader finds: samples and first time of each topic, facts, lines, and some values.
const READ_WITH_PYULOG: &str = r"
import json, sys
from pyulog import ULog
log = ULog(sys.argv[1])
topics = {t.name: {key: [float(v) for v in values[:3]] for key, values in t.data.items()} for t in log.data_list}
print(json.dumps({
    'corrupt': log.file_corruption, 'start_us': int(log.start_timestamp), 'last_us': int(log.last_timestamp),
    'rows': {t.name: len(t.data['timestamp']) for t in log.data_list}, 'topics': topics,
    'facts': log.msg_info_dict, 'lines': [m.message for m in log.logged_messages]}))
";

#[test]
fn val_px4s_own_reader_reads_the_ulog() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let python = root.join("target/pyulog/bin/python");
    if !python.is_file() {
        return skip::skip("ULog read by pyulog: it is not there (tools/pyulog.sh)");
    }
    let folder = tempfile::tempdir().unwrap();
    let (_, ulog) = exported(folder.path());
    let output = Command::new(python)
        .args(["-c", READ_WITH_PYULOG])
        .arg(&ulog)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(read["corrupt"], false);
    assert_eq!(read["last_us"].as_f64(), Some((17_000 + ROWS - 1) as f64 * 2500.0));
    let rows = read["rows"].as_object().unwrap();
    assert_eq!(rows.len(), 13, "{rows:?}");
    assert!(rows.values().all(|count| count.as_u64() == Some(ROWS)), "{rows:?}");
    assert_eq!(read["facts"]["sys_name"], "rotortwin");
    assert_eq!(read["facts"]["rotortwin_vehicle"], "made up");
    let lines = read["lines"].to_string();
    assert!(
        lines.contains("truth: no rotor is faulty") && lines.contains("truth: rotor 3 is faulty"),
        "{lines}"
    );
    for at in 0..3 {
        let row = synthetic::row(17_000 + at as u64);
        let value = |topic: &str, field: &str| read["topics"][topic][field][at].as_f64().unwrap();
        assert_eq!(value("sensor_combined", "timestamp"), row.sim_time_ns as f64 / 1e3);
        assert_eq!(
            value("sensor_combined", "gyro_rad[2]"),
            f64::from(row.body_rates_rad_s[2])
        );
        assert_eq!(value("vehicle_local_position", "z"), f64::from(row.position_ned_m[2]));
        assert_eq!(value("actuator_motors", "control[5]"), f64::from(row.duty[5]));
        assert_eq!(value("rotortwin_truth", "thrust_n[2]"), row.truth.thrust_n[2]);
        assert_eq!(
            value("rotortwin_fdi", "residual_yaw_nms[4]"),
            f64::from(row.residuals_nms[4][2])
        );
        assert_eq!(value("rotortwin_fdi", "verdict_sequential"), f64::from(row.sequential));
    }
}
