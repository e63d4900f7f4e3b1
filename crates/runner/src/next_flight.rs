//! The manoeuvre that would distinguish two effects, determined by simulated flights.

use crate::destination;
use crate::failure::Failure;
use crate::grid::Grid;
use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::sample::Sample;
use rotortwin_flight::setup::run_setup;
use rotortwin_jobs::NextFlight as Job;
use rotortwin_plant::STEP_NS;
use rotortwin_plant::effects::{Catalogue, EffectInstance};
use rotortwin_scenario::Scenario;
use rotortwin_store::telemetry::SENSED;
use rotortwin_twin::diagnose::{Diagnosis, Verdict, in_sentence};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::store::Found;
use rotortwin_twin::model::{ModelEffect, ModelStore, ModelVersion, Provenance};
use rotortwin_twin::next_flight::{
    MANOEUVRES, Manoeuvre, Proposal, Rival, Sensitivity, companions, propose as weigh, scenario_text,
};
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Proposals for the next flight, with their text form.
#[derive(Debug)]
pub struct Proposed {
    /// Manoeuvres, best first.
    pub proposals: Vec<Proposal>,
    /// Human-readable.
    pub text: String,
    /// Vehicle file written with the scenario, if any.
    pub vehicle: Option<String>,
}

/// Finds the manoeuvre that would distinguish two effects; the best is also written as a scenario if the job names a file.
///
/// # Errors
/// The model or an effect cannot be used, or the file cannot be written.
pub fn propose(job: &Job) -> Result<Proposed, Failure> {
    let found = ModelStore::new(&job.models).find(&job.model)?;
    between(job, &found).map_err(Failure::Input)
}

fn between(job: &Job, found: &Found) -> Result<Proposed, String> {
    let catalogue = catalogue_of(&found.version)?;
    let [a, b] = Rival::pair(&job.between, &found.version, &catalogue)?;
    let scenario = job.out.as_deref().map(ScenarioFiles::beside);
    if let Some(files) = &scenario {
        files.can_be_written()?;
    }
    let proposals = proposals(&found.version, &a, &b, &catalogue)?;
    let text = format!("{}\n{}\n", table(&proposals, &a, &b), advice(&proposals, &a, &b));
    let vehicle = match (scenario, proposals.first()) {
        (Some(files), Some(best)) => {
            files.write(best, found, job.seed)?;
            Some(files.vehicle)
        }
        _ => None,
    };
    Ok(Proposed {
        proposals,
        text,
        vehicle,
    })
}

/// As printed.
pub fn json(proposals: &[Proposal]) -> String {
    serde_json::to_string_pretty(proposals).expect("text and numbers are JSON")
}

/// The effects available to a model.
///
/// # Errors
/// One of its own cannot be used: names the key and the reason.
pub fn catalogue_of(model: &ModelVersion) -> Result<Catalogue, String> {
    model
        .catalogue()
        .map_err(|refusal| format!("model {}, key `{}`: {}", model.name, refusal.key, refusal.reason))
}

/// Manoeuvres for a pair, best first: each simulated with the current model.
fn proposals(model: &ModelVersion, a: &Rival, b: &Rival, catalogue: &Catalogue) -> Result<Vec<Proposal>, String> {
    let model = with_companions(model, a, b, catalogue);
    let sensitivities = sensitivities(&model, catalogue);
    if sensitivities.iter().all(Option::is_none) {
        return Err(format!("{}: this vehicle cannot fly any of the manoeuvres", model.name));
    }
    weigh(&sensitivities, a, b)
}

/// The model with the preconditions of a pair of effects.
pub fn with_companions(model: &ModelVersion, a: &Rival, b: &Rival, catalogue: &Catalogue) -> ModelVersion {
    let companions = companions([a, b], model, catalogue);
    if companions.is_empty() {
        return model.clone();
    }
    let effects = companions.into_iter().map(|instance| ModelEffect {
        effect: instance.effect,
        rotor: instance.rotor,
        onset_s: None,
        parameters: instance.parameters,
        deviations: BTreeMap::new(),
        provenance: Provenance::by_hand(),
    });
    model.with_effects(effects, "what the pair needs to act")
}

/// Information from each manoeuvre about each effect; none where it cannot be flown.
pub fn sensitivities(model: &ModelVersion, catalogue: &Catalogue) -> Vec<Option<Sensitivity>> {
    MANOEUVRES
        .iter()
        .map(|manoeuvre| {
            let log = fly(manoeuvre, model, &[], 1).ok()?;
            Sensitivity::new(&log, model, catalogue).ok()
        })
        .collect()
}

/// Advice, as a sentence.
fn advice(proposals: &[Proposal], a: &Rival, b: &Rival) -> String {
    /// The diagnosis's threshold.
    const ENOUGH: f64 = 10.0;
    let (a, b) = (a.label(), b.label());
    match proposals.first() {
        None => format!("No manoeuvre that can be flown would distinguish {a} from {b}."),
        Some(best) if best.between() < ENOUGH => format!(
            "No manoeuvre of the library distinguishes {a} from {b} at their typical sizes: at best ln BF {:.1} ({}).",
            best.between(),
            best.manoeuvre
        ),
        Some(best) => format!(
            "Fly {} ({}, {:.0} s): expected ln BF {:.0} if it is {a}, {:.0} if it is {b}.",
            best.manoeuvre, best.description, best.duration_s, best.first.against_other, best.second.against_other
        ),
    }
}

/// What to fly next if a diagnosis is undecided; `None` otherwise.
pub(crate) fn after(diagnosis: &Diagnosis, model: &ModelVersion) -> Option<String> {
    if !matches!(diagnosis.verdict, Verdict::CannotTell { .. }) {
        return None;
    }
    let best = diagnosis.effects.first()?;
    let other = best.also_compatible.first()?;
    let a = Rival {
        effect: best.instance.effect.clone(),
        rotor: best.instance.rotor,
    };
    let b = Rival {
        effect: other.effect.clone(),
        rotor: other.rotor,
    };
    let advice = match catalogue_of(model).and_then(|catalogue| proposals(model, &a, &b, &catalogue)) {
        Ok(proposals) => advice(&proposals, &a, &b),
        Err(sentence) => sentence,
    };
    Some(format!(
        "{advice} 'rotortwin next-flight --between {},{} --out FILE' writes it as a scenario.",
        a.label(),
        b.label()
    ))
}

fn table(proposals: &[Proposal], a: &Rival, b: &Rival) -> Grid {
    let mut table = Grid::new([
        "manoeuvre".to_owned(),
        "s".to_owned(),
        format!("{} is true", a.label()),
        "strongest rival".to_owned(),
        format!("{} is true", b.label()),
        "strongest rival".to_owned(),
    ])
    .numbers([1, 2, 4]);
    for p in proposals {
        table.add_row([
            p.manoeuvre.clone(),
            format!("{:.0}", p.duration_s),
            format!("{:.1}", p.first.against_other),
            format!("{:.1} {}", p.first.against_all, in_sentence(&p.first.strongest_rival)),
            format!("{:.1}", p.second.against_other),
            format!("{:.1} {}", p.second.against_all, in_sentence(&p.second.strongest_rival)),
        ]);
    }
    table
}

/// Files of a proposal: a scenario, and beside it the vehicle and blades that it flies, so that the three can be taken anywhere.
struct ScenarioFiles<'a> {
    scenario: &'a Path,
    vehicle: String,
    blades: String,
}

impl<'a> ScenarioFiles<'a> {
    fn beside(scenario: &'a Path) -> Self {
        let stem = scenario
            .file_stem()
            .map_or_else(|| "scenario".into(), |stem| stem.to_string_lossy());
        Self {
            scenario,
            vehicle: format!("{stem}-vehicle.toml"),
            blades: format!("{stem}-blades.toml"),
        }
    }

    /// Looked at before the work: none of them exists, and all can be written.
    fn can_be_written(&self) -> Result<(), String> {
        [&self.vehicle, &self.blades]
            .map(|name| self.scenario.with_file_name(name))
            .iter()
            .map(PathBuf::as_path)
            .chain([self.scenario])
            .try_for_each(destination::new_file)
    }

    fn write(&self, best: &Proposal, found: &Found, seed: u64) -> Result<(), String> {
        let manoeuvre = MANOEUVRES
            .iter()
            .find(|m| m.name == best.manoeuvre)
            .expect("a proposal names a manoeuvre of the list");
        let create = |path: &Path, text: &str| -> Result<(), String> {
            std::fs::File::create_new(path)
                .and_then(|mut file| file.write_all(text.as_bytes()))
                .map_err(|error| format!("{}: cannot be written: {error}", path.display()))
        };
        let text = |value: Result<String, toml::ser::Error>| value.map_err(|error| error.to_string());
        let beside = |name: &str| self.scenario.with_file_name(name);
        let mut vehicle = found.version.vehicle.clone();
        vehicle.rotors.blades.clone_from(&self.blades);
        create(&beside(&self.vehicle), &text(toml::to_string(&vehicle))?)?;
        create(&beside(&self.blades), &text(toml::to_string(&found.version.blades))?)?;
        create(self.scenario, &scenario_text(manoeuvre, &self.vehicle, seed))
    }
}

/// One flight in this process, as a log.
///
/// # Errors
/// It cannot be flown.
pub fn fly(
    manoeuvre: &Manoeuvre,
    model: &ModelVersion,
    hidden: &[EffectInstance],
    seed: u64,
) -> Result<FlightLog, String> {
    let scenario = manoeuvre.scenario(model, hidden, seed)?;
    record(&scenario, seed, manoeuvre)
}

fn record(scenario: &Scenario, seed: u64, manoeuvre: &Manoeuvre) -> Result<FlightLog, String> {
    let mut simulation = scenario.simulation(seed).map_err(|error| error.to_string())?;
    simulation.record_accelerometer(&scenario.document().sensors, seed);
    let rotors = simulation.rotor_count();
    let setup = run_setup(scenario, &simulation, 1);
    let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
    let mut recorder = Recorder::new(rotors, manoeuvre.ground_down_m());
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut recorder);
    if let FlightEnd::Failed(failure) = outcome.end {
        return Err(format!("{}: {}", manoeuvre.name, failure.sentence));
    }
    FlightLog::from_columns(manoeuvre.name, recorder.time_s, recorder.columns).map_err(|error| error.to_string())
}

/// Canonical columns of a flight, in memory.
struct Recorder {
    time_s: Vec<f64>,
    columns: Vec<(String, Vec<f64>)>,
    rotors: usize,
    ground_down_m: Option<f64>,
}

impl Recorder {
    fn new(rotors: usize, ground_down_m: Option<f64>) -> Self {
        let mut names: Vec<String> = SENSED.map(str::to_owned).to_vec();
        names.extend((1..=rotors).map(|rotor| format!("duty_{rotor}")));
        names.extend(ground_down_m.map(|_| "height_above_ground_m".to_owned()));
        Self {
            time_s: Vec::new(),
            columns: names.into_iter().map(|name| (name, Vec::new())).collect(),
            rotors,
            ground_down_m,
        }
    }
}

impl FlightObserver for Recorder {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        let s = &sample.sensors;
        let accel = sample.specific_force_m_s2.unwrap_or([f32::NAN; 3]);
        self.time_s.push((s.stamp.step * STEP_NS) as f64 * 1e-9);
        let mut values: Vec<f64> = [
            s.position_ned_m,
            s.velocity_ned_m_s,
            s.attitude_rad,
            s.body_rates_rad_s,
            accel,
        ]
        .iter()
        .flatten()
        .map(|v| f64::from(*v))
        .collect();
        values.push(f64::from(s.battery_voltage_v));
        values.extend(sample.command.duty[..self.rotors].iter().map(|d| f64::from(*d)));
        values.extend(self.ground_down_m.map(|down| down - f64::from(s.position_ned_m[2])));
        for ((_, column), value) in self.columns.iter_mut().zip(values) {
            column.push(value);
        }
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }
}
