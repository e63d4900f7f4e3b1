//! The flights of one vehicle over time: which rotor loses thrust, how fast, and which propeller to inspect.
//!
//! ```text
//! log ─┬▶ twin::baseline::rotor_loads: commanded thrust of each rotor ─┐
//!      └▶ log::judge: losses within the flight ────────────────────────┴▶ journal (one file per vehicle) ─▶ trend ─▶ FleetView
//! ```
//! The detectors assume the vehicle to be healthy while they calibrate, so a propeller that wears a little in every flight is healthy in
//! each. Here flights are compared with each other by the mean commanded thrust of each rotor, in which a loss shows whenever it occurred
//! ([`trend`]). Losses detected within a flight are reported as well.
//!
//! * [`journal`]: file format and updates.
//! * [`trend`]: the statistics.
//! * [`view`]: the combined result, with a status for each rotor: ok, inspect, acknowledged.

pub mod journal;
pub mod trend;
pub mod view;

use crate::log::{LogReport, judge};
use crate::view::VerdictKind;
use journal::{FlightEntry, LossEntry, VehicleEntry};
use rotortwin_scenario::Detectors;
use rotortwin_twin::baseline::rotor_loads;
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

/// A verdict below this probability does not require an inspection.
const SURE: f32 = 0.95;

/// Journal entries of a flight and its vehicle.
///
/// # Errors
/// The message contains the log's name: it cannot be compared with the model, or the detectors cannot evaluate it.
pub fn measure(
    name: &str,
    model: (&str, &ModelVersion),
    log: &FlightLog,
    detectors: &Detectors,
    date: Option<String>,
) -> Result<(VehicleEntry, FlightEntry), String> {
    let loads = rotor_loads(log, model.1).map_err(|error| error.to_string())?;
    let report = judge(log, detectors, false).map_err(|refusal| format!("{}: {refusal}", log.name))?;
    if let Some(lack) = report.lacks.iter().find(|lack| lack.prevents_verdicts) {
        return Err(format!(
            "{}: the log lacks {}, which rules out {}",
            log.name,
            lack.columns.join(", "),
            lack.rules_out
        ));
    }
    let (losses, suspects) = found_within(&report);
    let smallest = report.final_window.as_ref().map(|window| &window.smallest_loss);
    let flight = FlightEntry {
        log: log.source.path.display().to_string(),
        log_hash: log.source.content_hash.clone(),
        date,
        added: journal::now(),
        air_s: loads.seconds,
        asked: loads.asked,
        deviation: loads.deviation,
        losses,
        suspects,
        judged_s: report.decided_s,
        smallest_loss: smallest.map_or_else(Vec::new, |all| all.iter().map(|x| f64::from(*x)).collect()),
    };
    Ok((
        VehicleEntry {
            name: name.to_owned(),
            model: model.0.to_owned(),
            model_hash: model.1.hash(),
            signatures: loads.signatures,
        },
        flight,
    ))
}

/// Losses named at the end of a stretch, the largest of each rotor, and the suspect rotors of other faults.
fn found_within(report: &LogReport) -> (Vec<LossEntry>, Vec<usize>) {
    let mut losses: Vec<LossEntry> = Vec::new();
    let mut suspects: Vec<usize> = Vec::new();
    for stretch in &report.stretches {
        let said = &stretch.sequential;
        if said.probability < SURE {
            continue;
        }
        if matches!(said.verdict.verdict, VerdictKind::Ambiguous | VerdictKind::Unknown) {
            suspects.extend(said.suspect_rotors.iter().map(|rotor| *rotor as usize));
        }
        for loss in &said.thrust_loss {
            let entry = LossEntry {
                rotor: loss.rotor as usize,
                share: f64::from(loss.share),
                low: f64::from(loss.share_low),
                high: f64::from(loss.share_high),
                probability: f64::from(said.probability),
            };
            match losses.iter_mut().find(|known| known.rotor == entry.rotor) {
                Some(known) if known.share < entry.share => *known = entry,
                Some(_) => {}
                None => losses.push(entry),
            }
        }
    }
    suspects.sort_unstable();
    suspects.dedup();
    (losses, suspects)
}
