//! Real logs of unknown vehicles, with mass and arm alone: `strangers_log LOG:MASS_KG:ARM_M …`. Prints two tables in
//! Markdown.
//!
//! The first is that of `rotortwin vehicle from-log --held-out`: each half of a flight predicted with the result of the
//! other half, compared with the class default. The second shows what effects add: a vehicle from the first half,
//! improved on that half, and R² of the second half, which neither has seen, as means over 0.1 s (0 to 5 Hz).

use std::error::Error;
use std::path::Path;

use rotortwin_twin::compare::{NamedModel, compare};
use rotortwin_twin::diagnose::Options;
use rotortwin_twin::identify::{Identified, Request, files, held_out, identify};
use rotortwin_twin::improve::{Unasked, improve};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::predict::NAMES;

/// Length of the means, s.
const MEAN_S: f64 = 0.1;
/// What an identification cuts off at both ends of a flight, s.
const ENDS_S: f64 = 3.0;
/// Channels of the second table.
const CHANNELS: [&str; 6] = ["fx", "fy", "fz", "mx", "my", "mz"];

fn main() -> Result<(), Box<dyn Error>> {
    let mut flights = Vec::new();
    for argument in std::env::args().skip(1) {
        let parts: Vec<&str> = argument.rsplitn(3, ':').collect();
        let [arm, mass, log] = parts.as_slice() else {
            return Err(format!("expected LOG:MASS_KG:ARM_M, got `{argument}`").into());
        };
        let request = Request {
            mass_kg: mass.parse()?,
            arm_m: arm.parse()?,
            frame: None,
            trust_frame: false,
            capacity_ah: None,
            cells: None,
        };
        flights.push((Path::new(log).to_owned(), request));
    }
    println!("| log | channel | band, Hz | class default | calibrated |\n|---|---|---|---|---|");
    let mut second = Vec::new();
    for (path, request) in &flights {
        let read = FlightLog::read(path).map_err(|refusal| refusal.to_string());
        let found = read.and_then(|log| {
            halves(&log, request);
            let found = identify(std::slice::from_ref(&log), request).map_err(|refusal| refusal.to_string())?;
            Ok((log, found))
        });
        match found {
            Ok((log, found)) => second.push((log, request, found)),
            Err(refusal) => println!("| `{}` | refused: {refusal} | | | |", path.display()),
        }
    }
    println!(
        "\n| log | effects added on the first half | channel of the second half | calibrated | with effects |\n|---|---|---|---|---|"
    );
    for (log, request, found) in &second {
        if let Err(refusal) = with_effects(log, request, found) {
            println!("| `{}` | refused: {refusal} | | | |", log.name);
        }
    }
    Ok(())
}

/// Rows of the first table.
fn halves(log: &FlightLog, request: &Request) {
    let Ok(found) = held_out(log, request) else { return };
    for score in &found.scores {
        println!(
            "| `{}` | {} | {} to {} | {:.2} | {:.2} |",
            log.name, score.channel, score.band.low_hz, score.band.high_hz, score.class_default, score.calibrated
        );
    }
    let [roll, pitch] = found.gain_ratio;
    println!(
        "| `{}` | gains, second half over first: roll, pitch | | | {roll:.2}, {pitch:.2} |",
        log.name
    );
}

/// The middle of the time in the air.
fn middle(found: &Identified) -> f64 {
    let flown: f64 = found.airborne.iter().map(|part| part.end_s - part.start_s).sum();
    let mut left = 0.5 * flown;
    for part in &found.airborne {
        if left <= part.end_s - part.start_s {
            return part.start_s + left;
        }
        left -= part.end_s - part.start_s;
    }
    0.0
}

/// Rows of the second table.
fn with_effects(log: &FlightLog, request: &Request, found: &Identified) -> Result<(), Box<dyn Error>> {
    let (Some(first), Some(last)) = (found.airborne.first(), found.airborne.last()) else {
        return Err("nothing in the air".into());
    };
    let middle = middle(found);
    let own = identify(&[log.slice(first.start_s - ENDS_S, middle + ENDS_S)], request)?;
    let folder = tempfile::tempdir()?;
    let texts = files(&own, "own");
    for (name, text) in [
        ("own.toml", &texts.vehicle),
        ("own.blades.toml", &texts.blades),
        ("own.intervals.toml", &texts.intervals),
    ] {
        std::fs::write(folder.path().join(name), text)?;
    }
    let model = NamedModel {
        label: "calibrated".to_owned(),
        version: ModelVersion::load(folder.path().join("own.toml"))?,
    };
    let (early, late) = (log.slice(first.start_s, middle), log.slice(middle, last.end_s));
    let request = rotortwin_twin::improve::Request {
        model: &model,
        fitted: std::slice::from_ref(&early),
        held_out: &[],
        oracle: None,
    };
    let improved = improve(&request, &Options::default(), &mut Unasked::default())?;
    eprintln!("{}: {}", log.name, improved.reason);
    let added: Vec<String> = improved.rows.iter().filter_map(|row| row.added.clone()).collect();
    let added = if added.is_empty() {
        "none".to_owned()
    } else {
        added.join(", ")
    };
    let both = [
        model,
        NamedModel {
            label: "with effects".to_owned(),
            version: improved.model,
        },
    ];
    let (_, series) = compare(std::slice::from_ref(&late), &both)?;
    let Some(series) = series.first() else { return Ok(()) };
    let step_s = (series.time_s[series.time_s.len() - 1] - series.time_s[0]) / (series.time_s.len() - 1) as f64;
    let rows = (MEAN_S / step_s).round().max(1.0) as usize;
    for name in CHANNELS {
        let channel = NAMES.iter().position(|known| *known == name).ok_or("a channel")?;
        let scores: Vec<Option<f64>> = series
            .models
            .iter()
            .map(|model| {
                r_squared(
                    &series.measured[channel],
                    &model.raw[channel],
                    &model.mask[channel],
                    rows,
                )
            })
            .collect();
        if let [Some(before), Some(after)] = scores.as_slice() {
            println!("| `{}` | {added} | {name} | {before:.2} | {after:.2} |", log.name);
        }
    }
    Ok(())
}

/// 1 − Σ r²/Σ (m − m̄)² of means over `rows` rows; `None` where there are too few.
fn r_squared(measured: &[f64], residual: &[f64], mask: &[bool], rows: usize) -> Option<f64> {
    let mut pairs = Vec::new();
    for start in (0..mask.len().min(residual.len()).min(measured.len())).step_by(rows) {
        let range = start..start + rows;
        if range.end > mask.len() || !mask[range.clone()].iter().all(|counts| *counts) {
            continue;
        }
        let mean = |x: &[f64]| x[range.clone()].iter().sum::<f64>() / rows as f64;
        pairs.push((mean(measured), mean(residual)));
    }
    pairs.retain(|(m, r)| m.is_finite() && r.is_finite());
    if pairs.len() < 20 {
        return None;
    }
    let mean = pairs.iter().map(|(m, _)| m).sum::<f64>() / pairs.len() as f64;
    let total: f64 = pairs.iter().map(|(m, _)| (m - mean) * (m - mean)).sum();
    let left: f64 = pairs.iter().map(|(_, r)| r * r).sum();
    Some(1.0 - left / total)
}
