//! ULog as this project writes it, read by this project's import, compared with the run's Parquet file.
#![expect(clippy::unwrap_used, reason = "a test that cannot write or read its run has failed")]

use rotortwin_store::export::{ExportFormat, export_to};
use rotortwin_store::files::TELEMETRY_FILE;
use rotortwin_store::{RunFolder, SpoolHeader, SpoolWriter, Summary, finalise};
use rotortwin_twin::log::FlightLog;
use std::path::{Path, PathBuf};

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
        let mut row = synthetic::row(step);
        // The made-up flight has none; any numbers do.
        row.specific_force_m_s2 = row.velocity_ned_m_s.map(|value| value - 9.8);
        spool.push(&row).unwrap();
    }
    spool.finish().unwrap();
    let mut summary = Summary::default();
    summary.scenario.vehicle = "made up".to_owned();
    finalise(&run, summary).unwrap();
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
