//! `rotortwin next-flight`: the manoeuvre that would distinguish two effects, and its validation.

use crate::output;
use clap::Parser;
use rotortwin_campaign::study::intervals::wilson;
use rotortwin_plant::effects::Catalogue;
use rotortwin_runner::next_flight::{self, catalogue_of, fly, sensitivities, with_companions};
use rotortwin_twin::diagnose::{Options, Verdict, diagnose};
use rotortwin_twin::model::{ModelStore, ModelVersion};
use rotortwin_twin::next_flight::{MANOEUVRES, Manoeuvre, Rival, Sensitivity, propose};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin next-flight`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Current model: MODEL, MODEL@BRANCH, MODEL@v2, or a version or vehicle file
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
    /// Fly the proposal for each of the catalogue's confusable pairs, with either effect hidden, and count correct answers
    #[arg(long, conflicts_with = "between")]
    validate: bool,
    /// Seed of the flights
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON, nothing else
    #[arg(long)]
    json: bool,
}

impl Args {
    fn job(&self) -> Result<rotortwin_jobs::NextFlight, String> {
        let between =
            self.between.clone().try_into().map_err(|given: Vec<String>| {
                format!("--between: expected two effects, A,B, got {}", given.join(","))
            })?;
        Ok(rotortwin_jobs::NextFlight {
            model: self.model.clone(),
            models: self.models.clone(),
            between,
            out: self.out.clone(),
            seed: self.seed,
        })
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    if args.validate {
        let found = match ModelStore::new(&args.models).find(&args.model) {
            Ok(found) => found,
            Err(error) => return output::told(&error.into()),
        };
        return match validate(args, &found.version) {
            Ok(()) => ExitCode::SUCCESS,
            Err(sentence) => output::bad_input(sentence),
        };
    }
    let job = match args.job() {
        Ok(job) => job,
        Err(sentence) => return output::bad_input(sentence),
    };
    let done = match next_flight::propose(&job) {
        Ok(done) => done,
        Err(failure) => return output::told(&failure),
    };
    if args.json {
        println!("{}", next_flight::json(&done.proposals));
        return ExitCode::SUCCESS;
    }
    print!("{}", output::fitted(&done.text));
    if let (Some(path), Some(vehicle)) = (&args.out, &done.vehicle) {
        output::say(format!("Written      {}, vehicle {vehicle}", path.display()));
        println!("Fly it with  rotortwin fly {}", path.display());
    }
    ExitCode::SUCCESS
}

/// Pairs that flights confuse, for validation: one of each group of effects declared to be confused with each other.
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
        let [low, high] = wilson(right as f64, n as f64).unwrap_or([0.0, 1.0]);
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

/// Names in the diagnosis of a manoeuvre with a hidden effect, and its verdict.
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
        Verdict::FlightsDiffer { .. } => "flights differ",
        Verdict::LogFault { .. } => "log fault",
        Verdict::NothingTestable => "nothing testable",
    };
    Ok((named, verdict))
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
