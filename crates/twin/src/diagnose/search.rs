//! The search: a list of passes over a state, as docs/diagnose.md describes them.

use rotortwin_plant::effects::{Catalogue, EffectInstance, Requirement};

use super::considered::holds;
use super::passes::Pass;
use super::passes::charge::ChargeSearch;
use super::passes::coverage::Coverage;
use super::passes::elimination::BackwardElimination;
use super::passes::estimates::Estimates;
use super::passes::goodness::GoodnessOfFit;
use super::passes::gusts::GustCovariance;
use super::passes::held_out::HeldOutCheck;
use super::passes::nuisances::NuisanceFit;
use super::passes::onset::OnsetTest;
use super::passes::reconsideration::Reconsideration;
use super::passes::selection::ForwardSelection;
use super::passes::verdict::FinalVerdict;
use super::passes::wiring::WiringTest;
use super::result::{DiagnosedModel, Diagnosis, Goodness, Timing, Verdict};
use super::state::State;
use super::{Options, THRESHOLD, THRESHOLD_AT_REST, remainder, words};
use crate::estimation::candidates::Library;
use crate::estimation::columns::LogState;
use crate::estimation::problem::Problem;
use crate::model::ConstantInterval;
use crate::predict::{CHANNELS, Nuisances, PredictError, Predictor};

/// Speed and rate (root mean square about the mean) below which a flight counts as at rest.
const REST_SPEED_M_S: f64 = 0.3;
const REST_RATE_RAD_S: f64 = 0.08;

/// The passes in their order, each with the share of the search that is behind it when it begins.
const PASSES: [(f64, &dyn Pass); 13] = [
    (0.02, &NuisanceFit),
    (0.04, &WiringTest),
    (0.05, &ForwardSelection),
    (0.90, &Reconsideration),
    (0.92, &OnsetTest),
    (0.93, &ChargeSearch),
    (0.94, &BackwardElimination),
    (0.95, &GoodnessOfFit),
    (0.96, &GustCovariance),
    (0.97, &Estimates),
    (0.98, &HeldOutCheck),
    (0.985, &Coverage),
    (0.99, &FinalVerdict),
];

pub(crate) fn search(
    predictors: Vec<Predictor>,
    catalogue: &Catalogue,
    model: &[EffectInstance],
    constants: &[ConstantInterval],
    options: &Options<'_>,
    began_s: f64,
) -> Result<Diagnosis, PredictError> {
    let testable = predictors.iter().any(|p| (0..CHANNELS).any(|c| p.has(c)));
    let mut state = begin(predictors, catalogue, (model, constants), options, began_s);
    if testable {
        for (share, pass) in PASSES {
            state.progress(&pass.name().to_lowercase(), share);
            if !(pass.searches() && state.time_is_up()) {
                pass.run(&mut state)?;
            }
        }
    } else {
        Coverage.run(&mut state)?;
    }
    let mut diagnosis = state.diagnosis;
    if !diagnosis.goodness.unexplained.is_empty() {
        diagnosis.remainder = remainder::describe(&state.problem, &diagnosis)?;
    }
    diagnosis.stopped_at_s = state.stopped.then_some(options.time_limit_s);
    words::render(&mut diagnosis);
    Ok(diagnosis)
}

/// The state before the first pass: the library without the effects of the model, nothing named.
fn begin<'a>(
    predictors: Vec<Predictor>,
    catalogue: &Catalogue,
    (model, constants): (&[EffectInstance], &[ConstantInterval]),
    options: &'a Options<'a>,
    began_s: f64,
) -> State<'a> {
    let rotors = predictors[0].series().rotors;
    let mut library = Library::new(catalogue, rotors, &predictors[0].vehicle_size());
    // What the model has already is not looked for; its clutter stays as that of the others.
    library.retain(|c| model.iter().all(|m| m.effect != c.declaration.id || m.rotor != c.rotor));
    // A wind that all flights share is one of each.
    let winds = predictors.iter().any(Predictor::has_own_wind);
    library.retain(|c| !winds || !c.declaration.search.is_steady_wind);
    // Without a measured voltage Eq. 19 uses that of the model's battery: an effect that acts through it would only be a level or a drift of
    // the thrust. An airspeed or a position that nothing tells would be taken as none. Samples of a command that are further apart than its
    // lag answer before they are commanded, as they are interpolated: that would be named as too short a lag.
    for requirement in [
        Requirement::BatteryVoltage,
        Requirement::AirVelocity,
        Requirement::Position,
        Requirement::FrequentCommand,
    ] {
        let held = predictors.iter().any(|p| holds(p, requirement));
        library.retain(|c| held || !c.declaration.search.requires.contains(&requirement));
    }
    library.take_priors(constants);
    let guessed = library.guessed();
    library.retain(|c| {
        !c.declaration
            .search
            .unless_guessed
            .iter()
            .any(|id| guessed.contains(id))
    });
    library.tighten(|one| {
        predictors[0]
            .effect_set(&Nuisances::default(), std::slice::from_ref(one))
            .is_ok()
    });
    let threshold = if predictors.iter().all(at_rest) {
        THRESHOLD_AT_REST
    } else {
        THRESHOLD
    };
    let diagnosis = Diagnosis {
        assumed: words::assumed(&library),
        model: DiagnosedModel::default(),
        verdict: Verdict::NothingTestable,
        sentence: String::new(),
        effects: Vec::new(),
        sensor_or_timing: Vec::new(),
        calibrate: Vec::new(),
        ranking: Vec::new(),
        not_testable: Vec::new(),
        not_considered: Vec::new(),
        detectable: Vec::new(),
        goodness: Goodness {
            explained_share: None,
            channels: Vec::new(),
            unexplained: Vec::new(),
        },
        remainder: Vec::new(),
        held_out: Vec::new(),
        proposal: None,
        trim: None,
        winds: Vec::new(),
        apart: Vec::new(),
        stopped_at_s: None,
        logs: predictors.iter().map(|p| p.name.clone()).collect(),
        notes: predictors
            .iter()
            .flat_map(|p| p.notes().into_iter().map(|note| format!("{}: {note}", p.name)))
            .collect(),
        threshold,
        timing: Timing::default(),
    };
    let logs: Vec<LogState> = predictors.into_iter().map(LogState::new).collect();
    State {
        problem: Problem {
            weights: vec![[1.0; CHANNELS]; logs.len()],
            library,
            logs,
            linear: Vec::new(),
            active: Vec::new(),
        },
        named: Vec::new(),
        left: 0.0,
        unseen_gain: 0.0,
        plain: Vec::new(),
        compared: Vec::new(),
        before: Vec::new(),
        weather: None,
        has_intervals: constants.iter().any(|constant| constant.high > constant.low),
        doubts: Vec::new(),
        threshold,
        options,
        began_s,
        looked_s: began_s,
        longest_s: 0.0,
        stopped: false,
        diagnosis,
    }
}

/// True for a flight that hardly moves.
fn at_rest(predictor: &Predictor) -> bool {
    let series = predictor.series();
    let spread = |x: &[rotortwin_plant::Vector3]| {
        let count = x.len() as f64;
        (0..3)
            .map(|i| {
                let mean = x.iter().map(|v| v[i]).sum::<f64>() / count;
                x.iter().map(|v| (v[i] - mean) * (v[i] - mean)).sum::<f64>() / count
            })
            .sum::<f64>()
            .sqrt()
    };
    spread(&series.smooth.velocity) < REST_SPEED_M_S && spread(&series.smooth.rates) < REST_RATE_RAD_S
}

#[cfg(test)]
#[expect(unreachable_pub, reason = "public in the crate that the file is of")]
#[path = "../../../../tests/src/skip.rs"]
mod skip;

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use rotortwin_blind::flight::{FlightPlan, Row, fly};
    use rotortwin_blind::hidden::Hidden;
    use rotortwin_blind::script::Script;
    use rotortwin_blind::vehicle::Vehicle;

    use super::*;
    use crate::compare::{NamedModel, compare};
    use crate::diagnose::strategies::onset;
    use crate::log::FlightLog;
    use crate::model::ModelVersion;

    fn vehicle_file(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../config/vehicles/{name}.toml"))
    }

    /// A flight of the foreign simulator with something hidden.
    fn simulated(flight: &str, hidden: &str) -> FlightLog {
        let vehicle = Vehicle::load(&vehicle_file("f550")).unwrap();
        let plan = FlightPlan {
            effects: vec![Hidden::parse(hidden).unwrap()],
            ..FlightPlan::new(vehicle, Script::built_in(flight, 5).unwrap(), 20.0, 5)
        };
        let (rows, _) = fly(&plan).unwrap();
        let of = |value: &dyn Fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
        let mut columns = vec![("battery_voltage_v".to_owned(), of(&|r| r.voltage))];
        for (axis, names) in [
            ["velocity_north_m_s", "roll_rad", "roll_rate_rad_s", "accel_x_m_s2"],
            ["velocity_east_m_s", "pitch_rad", "pitch_rate_rad_s", "accel_y_m_s2"],
            ["velocity_down_m_s", "yaw_rad", "yaw_rate_rad_s", "accel_z_m_s2"],
        ]
        .into_iter()
        .enumerate()
        {
            let series = [
                of(&|r| r.velocity[axis]),
                of(&|r| r.euler[axis]),
                of(&|r| r.rates[axis]),
                of(&|r| r.accel[axis]),
            ];
            columns.extend(names.map(str::to_owned).into_iter().zip(series));
        }
        columns.extend((0..6).map(|rotor| (format!("duty_{}", rotor + 1), of(&|r| r.duties[rotor]))));
        FlightLog::from_columns(hidden, of(&|r| r.time), columns).unwrap()
    }

    /// A log of the development data, if they are there.
    fn shared(path: &str) -> Option<FlightLog> {
        let folder = std::env::var_os("ROTORTWIN_SHARED").map_or_else(
            || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
            PathBuf::from,
        );
        let file = folder.join(path);
        if !file.exists() {
            skip::skip(&format!("{path} is not beside the repository (ROTORTWIN_SHARED)"));
            return None;
        }
        Some(FlightLog::read(&file).unwrap())
    }

    /// Fitted to a log before all else, and shown by a comparison: biases (N) and initial charge.
    fn both(log: &FlightLog, model: &ModelVersion) -> [(Vec<f64>, f64); 2] {
        let catalogue = model.catalogue().unwrap();
        let predictor = Predictor::new(&model.documents(), &model.instances(), &catalogue, log).unwrap();
        let options = Options::default();
        let instances = model.instances();
        let mut state = begin(
            vec![predictor],
            &catalogue,
            (&instances, &model.constant),
            &options,
            0.0,
        );
        NuisanceFit.run(&mut state).unwrap();
        let fitted = &state.problem.logs[0];
        let charge = fitted.predictor.initial_charge() + fitted.nuisances.charge;
        let diagnosed = (
            fitted.nuisances.rotor_bias_n[..model.documents().vehicle.rotor_count()].to_vec(),
            charge,
        );
        let named = NamedModel {
            label: "m".to_owned(),
            version: model.clone(),
        };
        let (comparison, _) = compare(std::slice::from_ref(log), &[named]).unwrap();
        let shown = &comparison.logs[0].models[0].nuisances;
        [diagnosed, (shown.rotor_bias_n.clone(), shown.charge_at_start)]
    }

    #[test]
    fn val_comparison_and_diagnosis_of_a_flight_start_from_the_same_nuisances() {
        let f550 = ModelVersion::load(vehicle_file("f550")).unwrap();
        let crazyflie = ModelVersion::load(vehicle_file("crazyflie-lee")).unwrap();
        let logs = [
            // A wrong mass pushes the biases against their bound.
            (Some(simulated("waypoint", "mass:share=0.1")), &f550),
            (Some(simulated("excitation", "rotor-drag")), &f550),
            (shared("data/hidden_effect/log05.parquet"), &f550),
            (shared("data/real/crazyswarm2_slung_load/logs/log184"), &crazyflie),
        ];
        for (log, model) in logs.into_iter().filter_map(|(log, model)| Some((log?, model))) {
            let [diagnosed, compared] = both(&log, model);
            assert_eq!(diagnosed, compared, "{}", log.name);
            assert!(
                diagnosed.0.iter().any(|bias| *bias != 0.0) && diagnosed.1 > 0.0,
                "{diagnosed:?}"
            );
        }
    }

    #[test]
    fn val_no_bias_goes_beyond_what_real_rotors_have() {
        let f550 = ModelVersion::load(vehicle_file("f550")).unwrap();
        let [(biases, _), _] = both(&simulated("waypoint", "mass:share=0.1"), &f550);
        let body = f550.documents().vehicle.body;
        let most = 0.006 * body.mass_kg * body.gravity_m_s2 / 6.0;
        // All rotors are required to give 10 % of the weight more, and none gives more than its bound.
        assert!(
            biases.iter().all(|bias| bias.abs() <= most * (1.0 + 1e-9)),
            "{biases:?}"
        );
        assert!(biases.iter().any(|bias| bias.abs() > 0.99 * most), "{biases:?}");
    }

    #[test]
    fn regress_without_a_voltage_nothing_is_looked_for_that_acts_through_it_alone() {
        let f550 = ModelVersion::load(vehicle_file("f550")).unwrap();
        let catalogue = f550.catalogue().unwrap();
        let options = Options::default();
        let mut log = simulated("waypoint", "mass:share=0.1");
        for held in [true, false] {
            if !held {
                log.columns.remove("battery_voltage_v").unwrap();
            }
            let predictor = Predictor::new(&f550.documents(), &[], &catalogue, &log).unwrap();
            let state = begin(vec![predictor], &catalogue, (&[], &f550.constant), &options, 0.0);
            let place = |id: &str| {
                let mut all = state.problem.library.candidates.iter();
                all.position(|candidate| candidate.declaration.id == id)
            };
            assert_eq!(place("voltage-exponent").is_some(), held);
            // A thrust that falls because of an unlogged supply looks like a weight that sets in.
            let gain = onset::least_gain(&state.problem, place("mass").unwrap());
            assert_eq!(gain.is_finite(), held, "{gain}");
        }
    }

    /// The numbered list of docs/diagnose.md: name and file of each entry.
    fn documented() -> Vec<(String, String)> {
        let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/diagnose.md");
        let text = std::fs::read_to_string(page).unwrap();
        let (_, section) = text.split_once("## The passes").expect("the section of the passes");
        let (section, _) = section.split_once("\n## ").expect("a section after it");
        let entry = |line: &str| -> Option<(String, String)> {
            let (number, rest) = line.split_once(". **")?;
            number.parse::<usize>().ok()?;
            let (name, rest) = rest.split_once("**")?;
            let (_, rest) = rest.split_once("](")?;
            let (link, _) = rest.split_once(')')?;
            Some((name.to_owned(), link.to_owned()))
        };
        section.lines().filter_map(entry).collect()
    }

    #[test]
    fn val_the_page_lists_the_passes_in_their_order() {
        let listed = documented();
        let names: Vec<&str> = listed.iter().map(|(name, _)| name.as_str()).collect();
        let passes: Vec<&str> = PASSES.iter().map(|(_, pass)| pass.name()).collect();
        assert_eq!(names, passes);
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        for (name, link) in &listed {
            let source = std::fs::read_to_string(docs.join(link)).unwrap_or_else(|error| panic!("{link}: {error}"));
            assert!(
                source.contains(&format!("\"{name}\"")),
                "{link} is not the file of: {name}"
            );
        }
    }

    #[test]
    fn val_the_share_of_the_search_rises_from_pass_to_pass() {
        assert!(PASSES.windows(2).all(|two| two[0].0 < two[1].0));
    }
}
