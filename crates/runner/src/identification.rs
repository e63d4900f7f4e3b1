//! Identification of a user's own vehicle from flight logs, mass and arm.

use crate::destination::{self, write_text};
use crate::failure::Failure;
use crate::grid::Grid;
use crate::logs::read_logs;
use crate::text::significant;
use rotortwin_jobs::Identification as Job;
use rotortwin_page::Report;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::identify::{
    Bench, Estimate, Files, HeldOut, Identification, Identified, Request, Source, files, frame_contradiction,
    held_out_with, identify_with,
};
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::over_time::OverTime;
use std::path::{Path, PathBuf};

/// Identifies a vehicle, and writes its files if requested by the job.
///
/// # Errors
/// A log cannot be used, the files exist already, or they cannot be written.
pub fn identify(job: &Job) -> Result<Found, Failure> {
    let found = find(job).map_err(Failure::Input)?;
    if let Some((_, paths)) = &found.targets {
        let report = found.report();
        let texts = [
            &found.texts.vehicle,
            &found.texts.blades,
            &found.texts.intervals,
            &report,
        ];
        for (path, text) in paths.iter().zip(texts) {
            write_text(path, text).map_err(|sentence| Failure::writing(path, sentence))?;
        }
    }
    Ok(found)
}

/// A vehicle, its prediction accuracy, and its files.
pub struct Found {
    vehicle: Identified,
    scores: Vec<HeldOut>,
    texts: Files,
    /// Plot data of the logs for the report; only if it is written.
    over_time: Option<OverTime>,
    /// Name and paths of the files, if written.
    targets: Option<(String, [PathBuf; 4])>,
}

fn find(job: &Job) -> Result<Found, String> {
    let targets = job.out.as_deref().map(targets).transpose()?;
    let logs = read_logs(&job.logs).map_err(|failure| failure.to_string())?;
    let request = Request {
        mass_kg: job.mass_kg,
        arm_m: job.arm_m,
        frame: job.frame.clone(),
        trust_frame: job.trust_frame,
        capacity_ah: job.capacity_ah,
        cells: job.cells,
    };
    let bench = match job.bench.as_slice() {
        [] => None,
        files => Some(Bench::read(files).map_err(|error| error.to_string())?),
    };
    let mut vehicle = identify_with(&logs, &request, bench.as_ref()).map_err(|error| error.to_string())?;
    let mut scores = Vec::new();
    for log in logs.iter().filter(|_| job.held_out) {
        let score = match vehicle.held_out.clone() {
            Some(score) => Ok(score),
            None => held_out_with(log, &request, bench.as_ref()),
        };
        match score {
            Ok(score) => scores.push(score),
            // A flight too short for two halves still gave a vehicle.
            Err(refusal) => vehicle.notes.push(format!("not judged on its halves: {refusal}")),
        }
    }
    let name = targets.as_ref().map_or("vehicle", |(name, _)| name.as_str());
    let texts = files(&vehicle, name);
    let documents = texts
        .documents()
        .map_err(|reason| format!("the identified vehicle is not valid, so nothing was written: {reason}"))?;
    let version = ModelVersion::first(name, documents);
    let against = |log| frame_contradiction(log, &version.vehicle, &vehicle.airframe);
    if let Some(contradiction) = logs.iter().filter(|_| !job.trust_frame).find_map(against) {
        return Err(contradiction);
    }
    let over_time = targets.is_some().then(|| {
        let identified = NamedModel {
            label: name.to_owned(),
            version,
        };
        OverTime::of(&logs, &[identified])
    });
    Ok(Found {
        vehicle,
        scores,
        texts,
        over_time,
        targets,
    })
}

impl Found {
    /// The same on a page.
    fn report(&self) -> String {
        let name = self.targets.as_ref().map_or("vehicle", |(name, _)| name.as_str());
        let data = serde_json::json!({
            "name": name, "identified": self.vehicle, "held_out": self.scores, "over_time": self.over_time,
            "vehicle": self.texts.vehicle, "blades": self.texts.blades,
        });
        let page = Report {
            kind: "identification",
            title: &format!("Vehicle {name} from {}", self.vehicle.logs.join(", ")),
            summary: &self.text(),
            program: rotortwin_twin::model::TOOL,
            data: &data,
        };
        page.render().expect("text and numbers are JSON")
    }

    /// As printed.
    pub fn json(&self) -> serde_json::Value {
        let written: Vec<String> = self
            .targets
            .iter()
            .flat_map(|(_, paths)| paths.iter().map(|path| path.display().to_string()))
            .collect();
        let found = Identification {
            identified: &self.vehicle,
            held_out: &self.scores,
            written,
            vehicle: &self.texts.vehicle,
            blades: &self.texts.blades,
        };
        serde_json::to_value(found).expect("text and numbers are JSON")
    }

    /// Human-readable.
    pub fn text(&self) -> String {
        let mut text = vehicle_text(&self.vehicle);
        for scores in &self.scores {
            text.push_str(&scores_text(scores));
        }
        text.push_str(&match &self.targets {
            Some((_, [vehicle, ..])) => format!(
                "\nWritten: {0} with its blades, intervals and report. Next:\n  rotortwin compare LOG --model {0}\n",
                vehicle.display()
            ),
            None => "\nNothing was written; --out NAME.toml writes the vehicle.\n".to_owned(),
        });
        text
    }
}

/// Name and paths of the files; none may exist.
fn targets(out: &Path) -> Result<(String, [PathBuf; 4]), String> {
    let name = out
        .file_name()
        .and_then(|name| name.to_str())
        .and_then(|name| name.strip_suffix(".toml"))
        .filter(|name| !name.is_empty())
        .ok_or_else(|| format!("--out {}: expected a name that ends in .toml", out.display()))?;
    let paths = ["toml", "blades.toml", "intervals.toml", "report.html"]
        .map(|ending| out.with_file_name(format!("{name}.{ending}")));
    for path in &paths {
        if path.exists() {
            return Err(format!("{} already exists; nothing was written", path.display()));
        }
        destination::writable_file(path)?;
    }
    Ok((name.to_owned(), paths))
}

/// Four digits, in the shorter notation.
fn number(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else if !(1e-3..1e5).contains(&value.abs()) {
        format!("{value:.3e}")
    } else {
        let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
        format!("{value:.digits$}")
    }
}

fn vehicle_text(found: &Identified) -> String {
    let mut text = String::new();
    let mut line = |content: String| {
        text.push_str(&content);
        text.push('\n');
    };
    line(format!(
        "{}: {} rotors on outputs {}; {} ({}: {})",
        found.logs.join(", "),
        found.airframe.places.len(),
        found
            .outputs
            .iter()
            .map(usize::to_string)
            .collect::<Vec<_>>()
            .join(", "),
        found.airframe.name,
        found.airframe.source.words(),
        found.airframe.how
    ));
    let parts: Vec<String> = found
        .airborne
        .iter()
        .take(8)
        .map(|part| format!("{:.1}–{:.1} s", part.start_s, part.end_s))
        .collect();
    let more = found.airborne.len().saturating_sub(parts.len());
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    line(format!(
        "In the air: {}{more}. Class for defaults: {}.\n",
        parts.join(", "),
        found.class.name
    ));
    let mut table = Grid::new(["quantity", "value", "95 % interval", "unit", "from"]).numbers(1..3);
    for value in &found.values {
        table.add_row([
            value.name.clone(),
            number(value.value),
            interval(value),
            value.unit.to_owned(),
            value.source.words().to_owned(),
        ]);
    }
    line(format!(
        "{table}\nHow each value was found: see --json, or the comments in the file written by --out."
    ));
    let mut seen = Vec::new();
    for value in &found.values {
        if matches!(value.source, Source::Class | Source::LogAndClass) && !value.better.is_empty() {
            let line = format!("  {}: {}", value.name, value.better);
            if !seen.contains(&line) {
                seen.push(line);
            }
        }
    }
    if !seen.is_empty() {
        line(format!("\nWhat would make it better:\n{}", seen.join("\n")));
    }
    let slow: Vec<String> = found
        .sensors
        .iter()
        .filter(|rate| rate.source_hz < 0.7 * rate.rows_hz)
        .map(|rate| {
            // One of the outputs represents all: they are logged together.
            let is_output = rate.column.starts_with("duty_");
            let name = if is_output {
                "motor outputs"
            } else {
                rate.column.as_str()
            };
            format!("{name} {:.1} Hz", rate.source_hz)
        })
        .collect();
    if let (Some(first), false) = (found.sensors.first(), slow.is_empty()) {
        line(format!(
            "\nSlower than the rows ({:.0} Hz): {}",
            first.rows_hz,
            slow.join(", ")
        ));
    }
    for note in &found.notes {
        line(format!("Note  {note}"));
    }
    text
}

fn interval(value: &Estimate) -> String {
    if value.low < value.high {
        format!("{} to {}", number(value.low), number(value.high))
    } else {
        String::new()
    }
}

fn scores_text(scores: &HeldOut) -> String {
    let mut table = Grid::new(["channel", "band, Hz", "R², class default", "R², calibrated"]).numbers_from(2);
    for score in &scores.scores {
        table.add_row([
            score.channel.to_owned(),
            format!(
                "{} to {}",
                significant(score.band.low_hz),
                significant(score.band.high_hz)
            ),
            format!("{:.2}", score.class_default),
            format!("{:.2}", score.calibrated),
        ]);
    }
    format!(
        "\nHeld out: {}, {:.0} s in the air; each half predicted with the values from the other half\n{table}\n\
         Gains of the second half over the first: roll {:.2}, pitch {:.2} (1: both halves agree on the vehicle)\n",
        scores.log, scores.seconds, scores.gain_ratio[0], scores.gain_ratio[1]
    )
}
