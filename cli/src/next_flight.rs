//! `rotortwin next-flight`: the manoeuvre that would tell two effects apart, and the proof that it does.

use crate::grid::Grid;
use crate::output;
use crate::versions::store_failed;
use clap::Parser;
use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::sample::Sample;
use rotortwin_flight::setup::run_setup;
use rotortwin_plant::STEP_NS;
use rotortwin_plant::effects::{Catalogue, EffectInstance};
use rotortwin_scenario::Scenario;
use rotortwin_twin::diagnose::{Diagnosis, Options, Verdict, diagnose};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::store::Found;
use rotortwin_twin::model::{ModelEffect, ModelStore, ModelVersion, Provenance};
use rotortwin_twin::next_flight::{
    MANOEUVRES, Manoeuvre, Proposal, Rival, Sensitivity, companions, propose, scenario_text,
};
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin next-flight`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Model as it stands: MODEL, MODEL@BRANCH, MODEL@v2, or a version or vehicle file
    #[arg(long, value_name = "MODEL")]
    model: String,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    models: PathBuf,
    /// The two effects, such as mass,air-density or rotor-thrust-scale#3,centre-of-mass
    #[arg(
        long,
        value_name = "A,B",
        value_delimiter = ',',
        num_args = 1,
        required_unless_present = "validate"
    )]
    between: Vec<String>,
    /// Write the best manoeuvre as a scenario for 'rotortwin fly'; must not exist
    #[arg(long, value_name = "FILE", conflicts_with = "validate")]
    out: Option<PathBuf>,
    /// Fly the proposal for each of the catalogue's confusable pairs, with either effect hidden, and count right answers
    #[arg(long, conflicts_with = "between")]
    validate: bool,
    /// Seed of the flights
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON, nothing else
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    let found = match ModelStore::new(&args.models).find(&args.model) {
        Ok(found) => found,
        Err(error) => return store_failed(&error),
    };
    let done = if args.validate {
        validate(args, &found.version)
    } else {
        between(args, &found)
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => output::bad_input(sentence),
    }
}

fn catalogue_of(model: &ModelVersion) -> Result<Catalogue, String> {
    model
        .catalogue()
        .map_err(|refusal| format!("model {}, key `{}`: {}", model.name, refusal.key, refusal.reason))
}

fn between(args: &Args, found: &Found) -> Result<(), String> {
    let catalogue = catalogue_of(&found.version)?;
    let [a, b] = args.between.as_slice() else {
        return Err(format!(
            "--between: expected two effects, A,B, got {}",
            args.between.join(",")
        ));
    };
    let [a, b] = [Rival::parse(a, &catalogue)?, Rival::parse(b, &catalogue)?];
    if a == b {
        return Err(format!(
            "--between: expected two different effects, got {} twice",
            a.label()
        ));
    }
    let proposals = proposals(&found.version, &a, &b, &catalogue)?;
    if args.json {
        println!(
            "{}",
            serde_json::to_string_pretty(&proposals).expect("text and numbers are JSON")
        );
    } else {
        println!("{}", table(&proposals, &a, &b));
        println!("{}", advice(&proposals, &a, &b));
    }
    if let (Some(path), Some(best)) = (&args.out, proposals.first()) {
        let vehicle = write_scenario(path, best, found, args)?;
        if !args.json {
            println!("Written      {}, vehicle {vehicle}", path.display());
            println!("Fly it with  rotortwin fly {}", path.display());
        }
    }
    Ok(())
}

/// Manoeuvres for a pair, best first: each flown in the simulator with the model as it stands.
pub(crate) fn proposals(
    model: &ModelVersion,
    a: &Rival,
    b: &Rival,
    catalogue: &Catalogue,
) -> Result<Vec<Proposal>, String> {
    let model = with_companions(model, a, b, catalogue);
    let sensitivities = sensitivities(&model, catalogue);
    if sensitivities.iter().all(Option::is_none) {
        return Err(format!("{}: this vehicle cannot fly any of the manoeuvres", model.name));
    }
    propose(&sensitivities, a, b)
}

fn with_companions(model: &ModelVersion, a: &Rival, b: &Rival, catalogue: &Catalogue) -> ModelVersion {
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

fn sensitivities(model: &ModelVersion, catalogue: &Catalogue) -> Vec<Option<Sensitivity>> {
    MANOEUVRES
        .iter()
        .map(|manoeuvre| {
            let log = fly(manoeuvre, model, &[], 1).ok()?;
            Sensitivity::new(&log, model, catalogue).ok()
        })
        .collect()
}

/// What a person should do, in a sentence.
pub(crate) fn advice(proposals: &[Proposal], a: &Rival, b: &Rival) -> String {
    /// The diagnosis's threshold.
    const ENOUGH: f64 = 10.0;
    let (a, b) = (a.label(), b.label());
    match proposals.first() {
        None => format!("No manoeuvre can be flown that would tell {a} from {b}."),
        Some(best) if best.between() < ENOUGH => format!(
            "No manoeuvre of the library tells {a} from {b} at their ordinary sizes: at best ln BF {:.1} ({}).",
            best.between(),
            best.manoeuvre
        ),
        Some(best) => format!(
            "Fly {} ({}, {:.0} s): expected ln BF {:.0} if it is {a}, {:.0} if it is {b}.",
            best.manoeuvre, best.description, best.duration_s, best.first.against_other, best.second.against_other
        ),
    }
}

/// What to fly next where a diagnosis cannot tell; nothing where it can.
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
            format!("{:.1} {}", p.first.against_all, p.first.strongest_rival.to_lowercase()),
            format!("{:.1}", p.second.against_other),
            format!(
                "{:.1} {}",
                p.second.against_all,
                p.second.strongest_rival.to_lowercase()
            ),
        ]);
    }
    table
}

/// Writes the scenario, and the vehicle beside it if the model is not a vehicle file. The vehicle's path.
fn write_scenario(path: &Path, best: &Proposal, found: &Found, args: &Args) -> Result<String, String> {
    let fail = |path: &Path, error: std::io::Error| format!("{}: cannot be written: {error}", path.display());
    let manoeuvre = MANOEUVRES
        .iter()
        .find(|m| m.name == best.manoeuvre)
        .expect("a proposal names a manoeuvre of the list");
    let create = |path: &Path, text: &str| -> Result<(), String> {
        use std::io::Write as _;
        std::fs::File::create_new(path)
            .and_then(|mut file| file.write_all(text.as_bytes()))
            .map_err(|error| fail(path, error))
    };
    let given = Path::new(&args.model);
    let vehicle = if given.is_file() && found.version.effect.is_empty() {
        given
            .canonicalize()
            .map_err(|error| fail(given, error))?
            .display()
            .to_string()
    } else {
        let stem = path
            .file_stem()
            .map_or_else(|| "scenario".into(), |s| s.to_string_lossy());
        let (vehicle_name, blades_name) = (format!("{stem}-vehicle.toml"), format!("{stem}-blades.toml"));
        let mut vehicle = found.version.vehicle.clone();
        vehicle.rotors.blades.clone_from(&blades_name);
        let text = |value: Result<String, toml::ser::Error>| value.map_err(|error| error.to_string());
        create(&path.with_file_name(&vehicle_name), &text(toml::to_string(&vehicle))?)?;
        create(
            &path.with_file_name(&blades_name),
            &text(toml::to_string(&found.version.blades))?,
        )?;
        vehicle_name
    };
    create(path, &scenario_text(manoeuvre, &vehicle, args.seed))?;
    Ok(vehicle)
}

/// One flight in this process, as a log.
fn fly(manoeuvre: &Manoeuvre, model: &ModelVersion, hidden: &[EffectInstance], seed: u64) -> Result<FlightLog, String> {
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
        let mut names: Vec<String> = [
            "position_north_m",
            "position_east_m",
            "position_down_m",
            "velocity_north_m_s",
            "velocity_east_m_s",
            "velocity_down_m_s",
            "roll_rad",
            "pitch_rad",
            "yaw_rad",
            "roll_rate_rad_s",
            "pitch_rate_rad_s",
            "yaw_rate_rad_s",
            "accel_x_m_s2",
            "accel_y_m_s2",
            "accel_z_m_s2",
            "battery_voltage_v",
        ]
        .map(str::to_owned)
        .to_vec();
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

/// Pairs that flights mix up, which the validation flies: one of each group of effects that are declared to be confused with each other.
const VALIDATED: &[(&str, &str)] = &[
    ("rotor-drag", "quadratic-drag"),
    ("rotor-drag", "linear-friction"),
    ("quadratic-drag", "linear-friction"),
    ("axial-inflow", "rotational-damping"),
    ("axial-inflow", "linear-friction"),
    ("translational-lift", "axial-inflow"),
    ("flapping-moment", "rotor-interference"),
    ("centre-of-mass", "rotor-interference"),
    ("rotational-damping", "command-delay"),
    ("motor-time-constant", "command-delay"),
    ("motor-time-constant", "lag-asymmetry"),
    ("command-delay", "imu-latency"),
    ("imu-latency", "attitude-latency"),
    ("velocity-latency", "position-latency"),
    ("inertia-yaw", "moment-ratio"),
    ("inertia-yaw", "rotor-reaction"),
    ("inertia-roll", "gyro-scale"),
    ("gyroscopic-torque", "inertia-product-xy"),
    ("mass", "air-density"),
    ("mass", "accelerometer-scale"),
    ("mass", "dead-zone"),
    ("ground-effect", "mass"),
    ("air-density", "dead-zone"),
    ("accelerometer-bias", "level-offset"),
    ("accelerometer-bias", "vibration-rectification"),
    ("internal-resistance", "battery-rc"),
    ("internal-resistance", "battery-capacity"),
    ("imu-misalignment", "level-offset"),
    ("imu-lever-arm", "centre-of-mass"),
    ("rotor-thrust-scale#1", "centre-of-mass"),
    ("rotor-tilt-tangential#1", "moment-ratio"),
    ("slung-load", "mass"),
];

/// One validation flight.
#[derive(serde::Serialize)]
struct Proof {
    hidden: String,
    rival: String,
    manoeuvre: String,
    expected: f64,
    named: Vec<String>,
    verdict: &'static str,
    right: bool,
}

fn validate(args: &Args, model: &ModelVersion) -> Result<(), String> {
    let catalogue = catalogue_of(model)?;
    let mut known: BTreeMap<String, Vec<Option<Sensitivity>>> = BTreeMap::new();
    let mut proofs = Vec::new();
    for (a, b) in VALIDATED {
        let [a, b] = [Rival::parse(a, &catalogue)?, Rival::parse(b, &catalogue)?];
        let model = with_companions(model, &a, &b, &catalogue);
        let sensitivities = known
            .entry(model.hash())
            .or_insert_with(|| sensitivities(&model, &catalogue));
        let proposals = propose(sensitivities, &a, &b)?;
        let Some(best) = proposals.first() else { continue };
        let manoeuvre = MANOEUVRES
            .iter()
            .find(|m| m.name == best.manoeuvre)
            .expect("a proposal names a manoeuvre of the list");
        for (truth, rival, evidence) in [(&a, &b, &best.first), (&b, &a, &best.second)] {
            let seed = args.seed + 1000 + proofs.len() as u64;
            let proof = prove(manoeuvre, &model, truth, seed, &catalogue)?;
            let (named, verdict) = proof;
            let right = verdict != "agrees" && named == [truth.label()];
            if !args.json {
                println!(
                    "{:32} {:32} {:14} expected {:8.1}  {} {}",
                    truth.label(),
                    rival.label(),
                    manoeuvre.name,
                    evidence.worth(),
                    if right { "right" } else { "WRONG" },
                    if right {
                        String::new()
                    } else {
                        format!("{verdict}: {}", named.join(", "))
                    }
                );
            }
            proofs.push(Proof {
                hidden: truth.label(),
                rival: rival.label(),
                manoeuvre: manoeuvre.name.to_owned(),
                expected: evidence.worth(),
                named,
                verdict,
                right,
            });
        }
    }
    if args.json {
        println!(
            "{}",
            serde_json::to_string_pretty(&proofs).expect("text and numbers are JSON")
        );
        return Ok(());
    }
    let share = |list: &[&Proof]| {
        let (right, n) = (list.iter().filter(|p| p.right).count(), list.len());
        let [low, high] = wilson(right, n);
        format!(
            "{right} of {n} right: {:.1} % [{:.1}, {:.1}]",
            100.0 * right as f64 / n.max(1) as f64,
            100.0 * low,
            100.0 * high
        )
    };
    let all: Vec<&Proof> = proofs.iter().collect();
    let promised: Vec<&Proof> = proofs.iter().filter(|p| p.expected >= 10.0).collect();
    println!("\nAll flights                      {}", share(&all));
    println!("Expected ln BF of 10 or more     {}", share(&promised));
    Ok(())
}

/// Names of a diagnosis of a manoeuvre with a hidden effect, and its verdict.
fn prove(
    manoeuvre: &Manoeuvre,
    model: &ModelVersion,
    truth: &Rival,
    seed: u64,
    catalogue: &Catalogue,
) -> Result<(Vec<String>, &'static str), String> {
    let log = match fly(manoeuvre, model, &[truth.typical(catalogue)?], seed) {
        Ok(log) => log,
        Err(_) => return Ok((Vec::new(), "cannot be flown")),
    };
    let diagnosis = diagnose(&[log], model, &Options::default()).map_err(|error| error.to_string())?;
    let named = diagnosis
        .effects
        .iter()
        .chain(&diagnosis.sensor_or_timing)
        .map(|f| {
            let rival = Rival {
                effect: f.instance.effect.clone(),
                rotor: f.instance.rotor,
            };
            rival.label()
        })
        .collect();
    let verdict = match diagnosis.verdict {
        Verdict::Agrees => "agrees",
        Verdict::Missing { .. } => "missing",
        Verdict::CannotTell { .. } => "cannot tell",
        Verdict::PartlyMissing { .. } => "missing, in part",
        Verdict::CalibrateFirst { .. } => "calibrate first",
        Verdict::OutsideCatalogue => "outside of the catalogue",
        Verdict::LogFault { .. } => "log fault",
        Verdict::NothingTestable => "nothing testable",
    };
    Ok((named, verdict))
}

/// Wilson's 95 % interval.
fn wilson(right: usize, n: usize) -> [f64; 2] {
    if n == 0 {
        return [0.0, 1.0];
    }
    let (n, z) = (n as f64, 1.959_964);
    let p = right as f64 / n;
    let centre = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [(centre - half).max(0.0), (centre + half).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_every_validated_pair_is_of_the_catalogue() {
        let catalogue = Catalogue::built_in();
        assert!(VALIDATED.len() >= 20);
        for (a, b) in VALIDATED {
            let pair = [a, b].map(|text| Rival::parse(text, &catalogue).unwrap());
            for rival in &pair {
                rival.typical(&catalogue).unwrap().check(&catalogue, 6).unwrap();
            }
            assert_ne!(pair[0], pair[1]);
        }
    }
}
