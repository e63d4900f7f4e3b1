//! Verdicts of the detectors on flight logs, and their score where the truth is known.
//!
//! * [`judged`]: a log with its results, as in JSON and pages.
//! * [`score`]: the verdicts against the truth.
//! * [`truth`]: the true damage.

pub mod judged;
pub mod score;
pub mod truth;

use crate::failure::Failure;
use judged::{AgainstHealthy, JudgedLog};
use rotortwin_fdi_session::Learnt;
use rotortwin_jobs::LogVerdict;
use rotortwin_scenario::Detectors;
use rotortwin_twin::LEAST_BASELINE;
use rotortwin_twin::baseline;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::flight_picture::FlightPicture;
use rotortwin_twin::identify::read_for;
use rotortwin_twin::log::{FlightLog, ReadOptions};
use rotortwin_twin::model::{ModelStore, ModelVersion};
use rotortwin_twin::over_time::OverTime;
use rotortwin_verdicts::detectors::DetectorChoice;
use rotortwin_verdicts::log::{judge_after, learn};
use std::path::{Path, PathBuf};
use truth::TruthSource;

/// Runs the detectors on every log.
///
/// # Errors
/// The model, a log or its truth cannot be used: one sentence. A log that lacks channels is none: see [`JudgedLog::refusal`].
pub fn judge(job: &LogVerdict) -> Result<Vec<JudgedLog>, Failure> {
    judge_all(job).map_err(Failure::Input)
}

fn judge_all(job: &LogVerdict) -> Result<Vec<JudgedLog>, String> {
    let choice = DetectorChoice {
        store: &ModelStore::new(&job.models),
        model: &job.model,
        classifier: job.classifier.as_deref(),
        settings: &job.settings,
    };
    let (detectors, note) = choice.detectors()?;
    let rotor_count = detectors.vehicle().rotor_count();
    let source = job
        .truth
        .as_ref()
        .map(|truth| TruthSource::read(truth, rotor_count))
        .transpose()?;
    let options = ReadOptions {
        most_cells: job.most_cells,
        ..ReadOptions::default()
    };
    let read_all = |paths: &[PathBuf]| -> Result<Vec<FlightLog>, String> {
        let read = |path: &PathBuf| read_for(path, &options, &detectors.vehicle().vehicle);
        paths.iter().map(read).collect()
    };
    let healthy = read_all(&job.healthy)?;
    let (learnt, learnt_notes) = learnt_from(&healthy, &detectors)?;
    let model = ModelVersion::first(detectors.vehicle().vehicle.name.as_str(), detectors.vehicle().clone());
    // The score counts windows.
    let every_window = job.windows || source.is_some();
    let judged = |path: &PathBuf| {
        let log = read_for(path, &options, &detectors.vehicle().vehicle)?;
        let truth = source
            .as_ref()
            .map(|source| source.of(&log, whole(path), rotor_count))
            .transpose()?;
        let mut report = judge_after(&log, &detectors, learnt.as_ref(), every_window)
            .map_err(|refusal| format!("{}: {refusal}", path.display()))?;
        // Within a flight, damage before the calibration counts as healthy: only other flights reveal it.
        let against = against_healthy(&log, &healthy, &model);
        let sentence = against.as_ref().map(|against| against.sentence.clone());
        report.notes.splice(0..0, sentence);
        report.notes.extend(learnt_notes.clone());
        report.notes.extend(note.clone());
        report.flight = job.flight.then(|| FlightPicture::of(&log));
        let over_time = job.over_time.then(|| {
            let believed = NamedModel {
                label: report.detectors.vehicle.clone(),
                version: model.clone(),
            };
            OverTime::of(std::slice::from_ref(&log), &[believed])
        });
        let score = truth.as_ref().map(|truth| score::score_of(&report, truth));
        if !job.windows {
            report.windows = Vec::new();
        }
        Ok(JudgedLog {
            file: path.display().to_string(),
            against,
            report,
            over_time,
            score,
            truth,
        })
    };
    job.logs.iter().map(judged).collect()
}

/// The commanded thrust of the rotors of a flight compared with healthy flights, if there are enough of those.
fn against_healthy(log: &FlightLog, healthy: &[FlightLog], model: &ModelVersion) -> Option<AgainstHealthy> {
    if healthy.len() < LEAST_BASELINE {
        return None;
    }
    Some(match baseline::trim(std::slice::from_ref(log), healthy, model) {
        Ok(trim) => AgainstHealthy::of(&trim),
        Err(reason) => AgainstHealthy::not_compared(reason),
    })
}

/// What healthy flights say of the vehicle, and the notes about that; nothing where there are none.
fn learnt_from(logs: &[FlightLog], detectors: &Detectors) -> Result<(Option<Learnt>, Vec<String>), String> {
    if logs.is_empty() {
        return Ok((None, Vec::new()));
    }
    let (learnt, mut notes) = learn(logs, detectors).map_err(|refusal| format!("--healthy: {refusal}"))?;
    let inertia = learnt.inertia();
    notes.insert(
        0,
        format!(
            "the detectors have learnt the vehicle from healthy flights ({}, {:.0} s in the air); inertia about roll, pitch, yaw: {:.2}, {:.2}, {:.2} of \
             the model's",
            learnt.flights, learnt.seconds, inertia[0], inertia[1], inertia[2]
        ),
    );
    Ok((Some(learnt), notes))
}

/// `LOG` of `LOG@35:65`.
fn whole(path: &Path) -> &Path {
    let part = path
        .to_str()
        .and_then(|text| text.rsplit_once('@'))
        .filter(|_| !path.exists());
    part.map_or(path, |(log, _)| Path::new(log))
}
