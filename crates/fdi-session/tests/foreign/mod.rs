//! Flights of the independent generator, and a session's verdicts on them.

use rotortwin_blind::bench::faults::{Class, FaultCase, FaultRow, draw_cases, score};
use rotortwin_blind::flight::Row;
use rotortwin_fdi_session::{Chunk, FdiSession, Sample, Window};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};
use serde_json::json;

pub(crate) const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml");

pub(crate) fn cases_of(class: Class, n: usize, seed: u64, duration_s: f64) -> Vec<FaultCase> {
    let cases = draw_cases(n, seed, duration_s, &[(VEHICLE.to_owned(), 6)]);
    cases.into_iter().filter(|case| case.class == class).collect()
}

pub(crate) fn windows_of(rows: &[Row]) -> Vec<Window> {
    fed(
        &mut FdiSession::new(*detectors().config(), 1).expect("a good configuration"),
        rows,
    )
}

pub(crate) fn scored(case: &FaultCase, windows: &[Window]) -> FaultRow {
    let views: Vec<_> = windows.iter().map(view).collect();
    let report = json!({ "log": { "start_s": 0.0 }, "judged_rate_hz": 400.0, "detectors": { "window_samples": 25 }, "windows": views });
    score(case, &report.to_string()).expect("scored")
}

pub(crate) fn sample(row: &Row) -> Sample {
    let numbers = |v: [f64; 3]| v.map(|x| x as f32);
    let mut duty = [0.0; MAX_ROTORS];
    for (to, from) in duty.iter_mut().zip(&row.duties) {
        *to = (*from as f32).clamp(0.0, 1.0);
    }
    Sample {
        position_ned_m: numbers(row.position.into()),
        velocity_ned_m_s: numbers(row.velocity.into()),
        attitude_rad: numbers(row.euler.into()),
        body_rates_rad_s: numbers(row.rates.into()),
        duty,
        battery_voltage_v: row.voltage as f32,
        time_s: None,
    }
}

/// As `fdi-log --windows` writes it.
pub(crate) fn view(window: &Window) -> serde_json::Value {
    let report = &window.report;
    let code = if window.obstacle.is_some() {
        -4
    } else {
        report.sequential
    };
    let rotors = match code {
        1..100 => vec![code],
        100.. => vec![code / 100, code % 100],
        _ => vec![],
    };
    let losses = rotors.iter().zip([report.thrust_loss, report.second_thrust_loss]);
    let losses = losses
        .map(|(rotor, loss)| json!({ "rotor": rotor, "share_low": loss.share_low, "share_high": loss.share_high }));
    let sets = report.hypothesis_rotors.iter().take(report.hypothesis_count as usize);
    let sets = sets.map(|mask| {
        (1..=16)
            .filter(|rotor| mask >> (rotor - 1) & 1 == 1)
            .collect::<Vec<u32>>()
    });
    let time_s = report.stamp.sim_time_ns as f64 * 1e-9;
    let load = window.load.map(|load| {
        json!({
            "time_s": time_s - load.since_s,
            "named_s": time_s - load.since_s + load.named_after_s,
            "mass_kg": { "low": load.mass_kg.low, "high": load.mass_kg.high },
        })
    });
    json!({
        "smallest_loss": window.smallest_loss,
        "load": load,
        "time_s": time_s,
        "sequential": {
            "code": code,
            "probability": report.sequential_probability,
            "thrust_loss": losses.collect::<Vec<_>>(),
            "hypotheses": sets.collect::<Vec<_>>(),
        },
    })
}

pub(crate) fn detectors() -> Detectors {
    let documents = VehicleDocuments::load(VEHICLE).expect("shipped");
    Detectors::new(documents, &DetectorSettings::default(), None).expect("a good configuration")
}

pub(crate) fn fed(session: &mut FdiSession, rows: &[Row]) -> Vec<Window> {
    let mut windows = Vec::new();
    for (part, rows) in rows.chunks(1000).enumerate() {
        let chunk = Chunk {
            first_step: 1000 * part as u64,
            after_gap: false,
            samples: rows.iter().map(sample).collect(),
        };
        windows.extend(session.feed(&chunk).expect("taken").windows);
    }
    windows
}

pub(crate) fn seconds(window: &Window) -> f64 {
    window.report.stamp.sim_time_ns as f64 * 1e-9
}
