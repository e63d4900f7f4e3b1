//! Writes a synthetic run, to inspect a run folder without a simulator: `cargo run --example sample_run -- FOLDER
//! [done|failed|empty]`.

use rotortwin_store::summary::{Failure, RealTime, ScenarioRecord, Status};
use rotortwin_store::{RunFolder, SpoolHeader, SpoolWriter, Summary, finalise};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

#[path = "../tests/synthetic/mod.rs"]
#[expect(unreachable_pub, reason = "shared with the unit tests of the library")]
mod synthetic;

/// Number of rows generated before they are written.
const BLOCK: usize = 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let path = PathBuf::from(args.next().ok_or("name a folder")?);
    let kind = args.next().unwrap_or_else(|| "done".to_owned());
    let steps = match kind.as_str() {
        "failed" => 21_234,
        "empty" => 0,
        _ => 36_000,
    };
    let folder = RunFolder::create(&path)?;
    let header = SpoolHeader {
        rotor_count: synthetic::ROTORS,
        step_ns: synthetic::STEP_NS,
        conditions: BTreeMap::from([(1, "blade b".into()), (2, "blade c".into()), (3, "blade d".into())]),
        sensor_faults: Vec::new(),
        ..SpoolHeader::default()
    };
    let mut spool = SpoolWriter::create(&folder.spool_path(), &header)?;
    let mut took = Duration::ZERO;
    for first in (0..steps).step_by(BLOCK) {
        // Generated up front, so that the clock measures the spool only, and a few at a time, as in a run.
        let rows: Vec<_> = (first..steps.min(first + BLOCK as u64)).map(synthetic::row).collect();
        let start = Instant::now();
        for row in &rows {
            spool.push(row)?;
        }
        took += start.elapsed();
    }
    let start = Instant::now();
    spool.finish()?;
    took += start.elapsed();
    println!("spool: {:.0} ns per row", took.as_nanos() as f64 / steps.max(1) as f64);

    let mut summary = Summary {
        run_hash: "5f1d0c9a7e3b2846".into(),
        model_hash: "9c0e47d2b1a65f38".into(),
        program_version: "rotortwin 0.1.0".into(),
        scenario: ScenarioRecord {
            name: "Reference flight of the paper".into(),
            path: "config/scenarios/reference-flight.toml".into(),
            vehicle: "DJI F550 hexarotor X".into(),
            text: "# made up\nname = \"reference flight\"\nduration_s = 90.0\n\n[battery]\nstate_of_charge = 0.9\n"
                .into(),
        },
        seed: 42,
        link: "iceoryx2".into(),
        pace: "fast".into(),
        started_at: "2025-11-21T08:00:00Z".into(),
        wall_s: 0.82,
        ..Summary::default()
    };
    if kind != "done" {
        summary.status = Status::Failed;
        summary.pace = "real-time".into();
        summary.real_time = Some(RealTime {
            period_ms: 2.5,
            jitter_us_p50: 11.2,
            jitter_us_p99: 74.0,
            jitter_us_max: 912.5,
            deadline_misses: 3,
            ..RealTime::default()
        });
        summary.failure = Some(Failure {
            peer: "controller".into(),
            step: steps,
            silence_ms: 812,
            lost: true,
            sentence: format!(
                "the controller (pid 4711) did not answer step {steps}: silent for 812 ms; its process has ended"
            ),
        });
    }
    let start = Instant::now();
    let outputs = finalise(&folder, summary)?;
    println!("finalise: {:.2} s", start.elapsed().as_secs_f64());
    for file in [
        outputs.telemetry,
        outputs.mcap,
        Some(outputs.report),
        Some(outputs.summary_file),
    ]
    .into_iter()
    .flatten()
    {
        println!(
            "{}: {:.2} MB",
            file.display(),
            std::fs::metadata(&file)?.len() as f64 / 1e6
        );
    }
    Ok(())
}
