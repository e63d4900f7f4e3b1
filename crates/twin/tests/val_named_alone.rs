//! Effects hidden by the independent simulator: named alone, with values whose intervals contain the truth; their
//! neighbours keep their own names; and where a flight does not distinguish two, the answer has both.
//!
//! `./test` flies one case of each, and two of the neighbours, as a diagnosis takes 4 s: after a change of the twin,
//! `NAMED_CASES=4 cargo test --release -p rotortwin-twin --test val_named_alone -- --nocapture` flies all of them, and
//! `NAMED_CASES=24 NAMED_FIRST_SEED=900 …` more.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

use std::path::{Path, PathBuf};

use rotortwin_blind::flight::{FlightPlan, fly};
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::log_file;
use rotortwin_blind::script::{Script, Segment};
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_twin::compare::NamedModel;
use rotortwin_twin::diagnose::{Diagnosis, Finding, Options, Verdict, diagnose};
use rotortwin_twin::estimation::parameters::FittedParameter;
use rotortwin_twin::improve::{End, Request, Unasked, from_diagnosis, improve};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

fn f550() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml")
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

fn first_seed() -> u64 {
    setting("NAMED_FIRST_SEED", 7120)
}

fn flown(script: Script, duration_s: f64, seed: u64, effects: &[&str]) -> FlightLog {
    let vehicle = Vehicle::load(&f550()).unwrap();
    let plan = FlightPlan {
        effects: effects.iter().map(|text| Hidden::parse(text).unwrap()).collect(),
        ..FlightPlan::new(vehicle, script, duration_s, seed)
    };
    let (rows, _) = fly(&plan).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flown.parquet");
    log_file::write(&path, &rows).unwrap();
    FlightLog::read(&path).unwrap()
}

fn said(script: Script, duration_s: f64, seed: u64, effects: &[&str]) -> Diagnosis {
    let name = script.name.clone();
    let log = flown(script, duration_s, seed, effects);
    let model = ModelVersion::load(f550()).unwrap();
    let found = diagnose(&[log], &model, &Options::default()).unwrap();
    println!("{name} {seed} {effects:?}: {}", found.sentence);
    found
}

/// In motion, excitation and waypoints in turn.
fn in_motion(case: u64, seed: u64, effects: &[&str]) -> Diagnosis {
    let script = Script::built_in(["excitation", "waypoint"][(case % 2) as usize], seed).unwrap();
    said(script, 60.0, seed, effects)
}

fn all(found: &Diagnosis) -> impl Iterator<Item = &Finding> {
    found.effects.iter().chain(&found.sensor_or_timing)
}

fn named(found: &Diagnosis) -> Vec<&str> {
    let mut ids: Vec<&str> = all(found).map(|f| f.instance.effect.as_str()).collect();
    ids.sort_unstable();
    ids
}

/// Named, or reported as an alternative of a named effect.
fn tells(found: &Diagnosis, id: &str) -> bool {
    let rivals = || all(found).flat_map(|f| &f.also_compatible);
    named(found).contains(&id) || rivals().any(|rival| rival.effect == id)
}

/// Exactly `effects` are named, and the intervals of the sizes of each contain the hidden values. Half an interval more
/// is not a failure, as one parameter in twenty is outside; the number inside is counted.
fn check(found: &Diagnosis, effects: &[&str], (held, sizes): (&mut u64, &mut u64)) {
    let hidden: Vec<Hidden> = effects.iter().map(|text| Hidden::parse(text).unwrap()).collect();
    let mut expected: Vec<&str> = hidden.iter().map(|h| h.id.as_str()).collect();
    expected.sort_unstable();
    assert_eq!(named(found), expected, "{}", found.sentence);
    for one in &hidden {
        let finding = all(found).find(|f| f.instance.effect == one.id).unwrap();
        for (name, truth) in &one.parameters {
            let parameter = finding.parameters.iter().find(|p| p.name == *name).unwrap();
            let off = (parameter.value - truth).abs();
            println!(
                "  {} {name}: {} ± {} of {truth}",
                one.id, parameter.value, parameter.interval_95
            );
            let half = parameter.interval_95;
            assert!(off < 1.5 * half, "{name} {off}: {}", found.sentence);
            *held += u64::from(off < half);
            *sizes += 1;
        }
    }
}

/// Cases of effects that change from case to case, the first if no other number is asked for, each checked; nearly all intervals hold the truth.
fn named_alone(cases: &[&[&str]], seed: u64) {
    let (mut held, mut sizes) = (0, 0);
    for case in 0..setting("NAMED_CASES", 1) {
        let effects = cases[(case % cases.len() as u64) as usize];
        let found = in_motion(case, seed + case, effects);
        check(&found, effects, (&mut held, &mut sizes));
    }
    println!("{held} of {sizes} within the interval");
    // One of a few may be outside: of four, one is in a fifth of all runs.
    let outside = sizes - held;
    assert!(outside <= (sizes / 10).max(1), "{held} of {sizes} within the interval");
}

/// Each of these is named itself, and nothing else; the first two if no number of cases is asked for.
fn keep_their_names(neighbours: &[&str], seed: u64) {
    let asked = setting("NAMED_CASES", 2) as usize;
    for (case, effect) in (0..).zip(neighbours).take(asked) {
        let effects: Vec<&str> = [*effect].into_iter().filter(|text| !text.is_empty()).collect();
        let found = in_motion(case, seed + case, &effects);
        let expected: Vec<&str> = effects.iter().filter_map(|text| text.split(':').next()).collect();
        assert_eq!(named(&found), expected, "{}", found.sentence);
    }
}

#[test]
fn val_mass_that_leaves_is_named_with_its_rate() {
    named_alone(
        &[
            &["mass-loss:rate_kg_s=0.0025"],
            &["mass-loss:rate_kg_s=0.0018"],
            &["mass-loss:rate_kg_s=0.004"],
            &["mass-loss:rate_kg_s=0.001"],
        ],
        first_seed(),
    );
}

#[test]
fn val_mass_that_begins_to_leave_in_flight_is_named_with_its_onset() {
    for case in 0..setting("NAMED_CASES", 1).min(2) {
        let seed = first_seed() + 40 + case;
        // Half a second of another onset would be 1.3 % of the rate, four of its intervals.
        let found = in_motion(case, seed, &["mass-loss:rate_kg_s=0.004,onset_s=24"]);
        assert_eq!(named(&found), ["mass-loss"], "{}", found.sentence);
        let finding = all(&found).next().unwrap();
        let rate = &finding.parameters[0];
        assert!(
            (rate.value - 0.004).abs() < 1.5 * rate.interval_95,
            "{}",
            found.sentence
        );
        let onset = finding.instance.onset_s.unwrap();
        assert!((onset - 24.0).abs() < 0.25, "{onset}: {}", found.sentence);
    }
}

/// Dated one lag of the rotors late, such a version was called "not in the catalogue", and one size was off by 15 of its intervals.
#[test]
fn regress_a_blade_that_breaks_is_dated_before_the_lag_and_explains_the_flight() {
    let asked = setting("NAMED_CASES", 1) as usize;
    for (case, share) in (0..).zip([-0.06, -0.11]).take(asked) {
        let seed = first_seed() + 44 + case;
        let effect = format!("rotor-thrust-scale:rotor=2,share={share},onset_s=24.4");
        let found = in_motion(case, seed, &[&effect]);
        assert_eq!(named(&found), ["rotor-thrust-scale"], "{}", found.sentence);
        assert!(found.goodness.unexplained.is_empty(), "{}", found.sentence);
        let finding = all(&found).next().unwrap();
        let onset = finding.instance.onset_s.unwrap();
        assert!((onset - 24.4).abs() < 0.01, "{onset}: {}", found.sentence);
        let size = &finding.parameters[0];
        assert!(
            (size.value - share).abs() < 1.5 * size.interval_95,
            "{}",
            found.sentence
        );
    }
}

#[test]
fn val_what_looks_like_mass_that_leaves_keeps_its_name() {
    keep_their_names(
        &[
            "mass:share=-0.08",
            "voltage-exponent:exponent=-0.4",
            "battery-capacity:share=-0.2",
        ],
        first_seed() + 60,
    );
}

#[test]
fn val_in_a_hover_a_law_of_the_voltage_is_never_mass_that_leaves_and_nothing_else() {
    for (case, effect) in (0..).zip(["mass-loss:rate_kg_s=0.002", "voltage-exponent:exponent=-0.5"]) {
        let seed = first_seed() + 80 + case;
        let found = said(Script::built_in("hover", seed).unwrap(), 60.0, seed, &[effect]);
        let id = effect.split(':').next().unwrap();
        // A discharge of a minute may be too small to show; whatever is named instead must not exclude the truth.
        assert!(named(&found).is_empty() || tells(&found, id), "{}", found.sentence);
        assert!(id != "mass-loss" || tells(&found, id), "{}", found.sentence);
    }
}

/// On waypoint flights up to 0.1: of stronger fields most answers are "not wholly in the catalogue" (docs/blind-bench.md).
#[test]
fn val_a_heading_that_errs_with_the_current_is_named_with_its_field() {
    named_alone(
        &[
            &["current-heading:forward_share=0.12,right_share=-0.1"],
            // On this flight the current goes to 7.7 times that of hover: twice the field would turn the heading round.
            &["current-heading:forward_share=-0.06,right_share=0.03"],
            &["current-heading:forward_share=0.05,right_share=0.2"],
            &["current-heading:forward_share=0.1,right_share=0.1"],
        ],
        first_seed() + 100,
    );
}

#[test]
fn val_what_looks_like_a_heading_that_errs_with_the_current_keeps_its_name() {
    keep_their_names(
        &[
            "heading-offset:offset_rad=0.08",
            "gyro-scale:share=0.02",
            "attitude-latency:delay_s=0.012",
        ],
        first_seed() + 140,
    );
}

/// The yaw torque of a tangential tilt is that of another ratio; only its force distinguishes them.
#[test]
fn val_a_rotor_with_a_drag_of_its_own_is_named_and_no_tilt_of_it() {
    named_alone(
        &[
            &["rotor-moment-ratio:rotor=2,share=0.15"],
            &["rotor-moment-ratio:rotor=5,share=-0.2"],
            &["rotor-moment-ratio:rotor=1,share=0.25"],
            &["rotor-moment-ratio:rotor=4,share=-0.25"],
        ],
        first_seed() + 300,
    );
}

#[test]
fn val_what_looks_like_a_drag_of_one_rotor_keeps_its_name() {
    keep_their_names(
        &[
            "rotor-tilt-tangential:rotor=2,angle_rad=0.02",
            "rotor-tilt-tangential:rotor=5,angle_rad=-0.035",
            "moment-ratio:share=0.15",
            "reversed-spin:rotor=3,share=1",
        ],
        first_seed() + 320,
    );
}

/// Without accelerometer and velocity only the yaw torque is left, which is the same for both.
#[test]
fn val_without_a_force_a_ratio_and_a_tilt_of_one_rotor_are_not_told_apart() {
    for (case, effect) in (0..).zip([
        "rotor-moment-ratio:rotor=2,share=0.18",
        "rotor-tilt-tangential:rotor=3,angle_rad=0.012",
    ]) {
        let seed = first_seed() + 340 + case;
        let mut log = flown(Script::built_in("excitation", seed).unwrap(), 60.0, seed, &[effect]);
        let shows_force = |name: &str| {
            ["accel_", "velocity_", "position_"]
                .iter()
                .any(|start| name.starts_with(start))
        };
        log.columns.retain(|name, _| !shows_force(name));
        let model = ModelVersion::load(f550()).unwrap();
        let found = diagnose(&[log], &model, &Options::default()).unwrap();
        println!("{effect} without forces: {}", found.sentence);
        for id in ["rotor-moment-ratio", "rotor-tilt-tangential"] {
            assert!(tells(&found, id), "{id}: {}", found.sentence);
        }
    }
}

/// A healthy vehicle whose motors and propellers differ by what is usual, and a damaged blade.
#[test]
fn val_a_usual_or_a_positive_deviation_of_a_rotor_is_not_called_damage() {
    for (case, share, is_said, is_not) in [
        (0, -0.012, "of one batch differ by", "damaged"),
        (1, 0.06, "no damage", "damaged"),
        (2, -0.08, "a damaged or worn blade", "no damage"),
        (3, -0.015, "of one batch differ by", "damaged"),
    ] {
        let effect = format!("rotor-thrust-scale:rotor=3,share={share}");
        let found = in_motion(case, first_seed() + 360 + case, &[&effect]);
        assert_eq!(named(&found), ["rotor-thrust-scale"], "{}", found.sentence);
        assert!(
            found.sentence.contains(is_said) && !found.sentence.contains(is_not),
            "{}",
            found.sentence
        );
    }
    // What sets in is no matter of manufacture.
    let effect = "rotor-thrust-scale:rotor=3,share=-0.015,onset_s=30";
    let found = in_motion(0, first_seed() + 364, &[effect]);
    assert!(found.sentence.contains("a damaged or worn blade"), "{}", found.sentence);
}

const DRAG: &str = "rotor-drag:drag_n_s_m=0.25";

#[test]
fn val_a_drag_that_differs_sideways_is_named_with_its_size() {
    named_alone(
        &[
            &[DRAG, "drag-anisotropy:share=0.4"],
            &[DRAG, "drag-anisotropy:share=-0.4"],
            &["linear-friction:drag_kg_s=0.2", "drag-anisotropy:share=0.3"],
            &[DRAG, "drag-anisotropy:share=-0.6"],
        ],
        first_seed() + 200,
    );
}

#[test]
fn val_an_even_drag_is_not_called_uneven() {
    keep_their_names(
        &[
            DRAG,
            "linear-friction:drag_kg_s=0.2",
            "quadratic-drag:drag_kg_m=0.03",
            "",
        ],
        first_seed() + 240,
    );
}

#[test]
fn val_one_way_alone_is_a_drag_of_another_size() {
    let leg = |north_m: f64| Segment::Go {
        duration_s: 5.0,
        north_m,
        east_m: 0.0,
        height_m: 3.0,
        yaw_rad: Some(0.0),
    };
    let script = Script {
        name: "to and fro".to_owned(),
        start_height_m: 3.0,
        start_north_m: 0.0,
        smoothing_rad_s: 8.0,
        segment: [12.0, 0.0].repeat(6).into_iter().map(leg).collect(),
    };
    let found = said(script, 60.0, first_seed() + 280, &[DRAG, "drag-anisotropy:share=0.4"]);
    assert_eq!(named(&found), ["rotor-drag"], "{}", found.sentence);
    // Forward it is 0.25 (1 + 0.2).
    assert!(
        (all(&found).next().unwrap().parameters[0].value - 0.3).abs() < 0.01,
        "{}",
        found.sentence
    );
}

/// Flights outdoors have a wind each.
#[test]
fn val_flights_in_winds_of_their_own_are_told_together() {
    let drag = "rotor-drag:drag_n_s_m=0.25";
    let winds = ["wind:north_m_s=3,east_m_s=1", "wind:north_m_s=-2,east_m_s=2"];
    let told = |winds: [&str; 2], model: &ModelVersion| {
        let seeds = [first_seed() + 90, first_seed() + 91];
        let logs: Vec<FlightLog> = winds
            .iter()
            .zip(seeds)
            .map(|(wind, seed)| flown(Script::built_in("waypoint", seed).unwrap(), 24.0, seed, &[drag, wind]))
            .collect();
        let found = diagnose(&logs, model, &Options::default()).unwrap();
        println!("{}", found.sentence);
        found
    };
    let holds = |parameters: &[FittedParameter], text: &str| {
        for (name, truth) in &Hidden::parse(text).unwrap().parameters {
            let parameter = parameters.iter().find(|p| p.name == *name).unwrap();
            let off = (parameter.value - truth).abs();
            assert!(off < 1.5 * parameter.interval_95, "{text}: {parameter:?}");
        }
    };
    let model = ModelVersion::load(f550()).unwrap();
    let found = told(winds, &model);
    assert_eq!(named(&found), ["rotor-drag"], "{}", found.sentence);
    assert!(matches!(found.verdict, Verdict::Missing { .. }), "{}", found.sentence);
    assert_eq!(found.model.hash, model.hash());
    holds(&found.effects[0].parameters, drag);
    assert_eq!(found.winds.len(), 2);
    for (one, wind) in found.winds.iter().zip(winds) {
        holds(&one.parameters, wind);
    }
    // The winds alone, once the model has the drag.
    let json = serde_json::to_value(&found).unwrap();
    let effects = from_diagnosis::effects(&json, &[]).unwrap();
    let dragging = model.with_effects(effects, "");
    let of_winds = told(winds, &dragging);
    assert!(of_winds.effects.is_empty(), "{}", of_winds.sentence);
    let effects = vec!["wind".to_owned()];
    assert_eq!(of_winds.verdict, Verdict::Missing { effects }, "{}", of_winds.sentence);
    // One wind for both is an effect like any other.
    let found = told([winds[0]; 2], &model);
    assert!(found.winds.is_empty(), "{}", found.sentence);
    assert_eq!(named(&found), ["rotor-drag", "wind"], "{}", found.sentence);
    assert!(matches!(found.verdict, Verdict::Missing { .. }), "{}", found.sentence);
}

/// Legs without a turn.
fn straight() -> Script {
    let leg = |[north_m, east_m]: [f64; 2]| Segment::Go {
        duration_s: 5.0,
        north_m,
        east_m,
        height_m: 3.0,
        yaw_rad: Some(0.0),
    };
    let corners = [[12.0, 0.0], [12.0, 9.0], [0.0, 9.0], [0.0, 0.0]];
    Script {
        name: "without a turn".to_owned(),
        start_height_m: 3.0,
        start_north_m: 0.0,
        smoothing_rad_s: 8.0,
        segment: corners.into_iter().map(leg).collect(),
    }
}

/// Accelerometers that are off by something else in each flight are no winds; and a wind that a flight without a turn shows may be a sensor.
#[test]
fn val_sensors_that_differ_between_flights_are_not_taken_for_winds() {
    let model = ModelVersion::load(f550()).unwrap();
    let told = |hidden: [&str; 2]| {
        let logs: Vec<FlightLog> = (hidden.iter().zip(first_seed() + 110..))
            .map(|(hidden, seed)| flown(straight(), 20.0, seed, &["rotor-drag:drag_n_s_m=0.25", hidden]))
            .collect();
        let found = diagnose(&logs, &model, &Options::default()).unwrap();
        println!("{}", found.sentence);
        found
    };
    let biases = [
        "accelerometer-bias:x_m_s2=0.15,y_m_s2=-0.05",
        "accelerometer-bias:x_m_s2=-0.1,y_m_s2=0.12",
    ];
    assert!(told(biases).winds.is_empty());
    let found = told(["wind:north_m_s=3,east_m_s=1", "wind:north_m_s=-2,east_m_s=2"]);
    assert_eq!(named(&found), ["rotor-drag"], "{}", found.sentence);
    assert!(found.winds.len() == 2 && found.winds.iter().all(|wind| !wind.distinguished));
    assert!(found.sentence.contains("turns too little"), "{}", found.sentence);
    assert!(!found.sentence.contains("compatible: none"), "{}", found.sentence);
}

/// The loop by itself: errors of a flight that no fit has seen, in a wind that no other flight has, fall to noise.
#[test]
fn val_improve_learns_the_vehicle_from_flights_in_winds_of_their_own() {
    let drag = "rotor-drag:drag_n_s_m=0.25";
    // The first and the last differ little: the drag that comes with the wind of the first takes more from the errors of the last than that adds.
    let winds = [
        "wind:north_m_s=1,east_m_s=1",
        "wind:north_m_s=-2,east_m_s=2",
        "wind:north_m_s=0.2,east_m_s=0.4",
    ];
    let logs: Vec<FlightLog> = (winds.iter().zip(first_seed() + 95..))
        .map(|(wind, seed)| flown(Script::built_in("waypoint", seed).unwrap(), 24.0, seed, &[drag, wind]))
        .collect();
    let model = NamedModel {
        label: "f550".to_owned(),
        version: ModelVersion::load(f550()).unwrap(),
    };
    // The wind of one fitted flight is that flight's, too.
    for fitted in [2, 1] {
        let request = Request {
            model: &model,
            fitted: &logs[..fitted],
            held_out: &logs[2..],
            oracle: None,
        };
        let improved = improve(&request, &Options::default(), &mut Unasked::default()).unwrap();
        println!("{:?}: {}", improved.end, improved.reason);
        assert_eq!(improved.end, End::Agrees, "{}", improved.reason);
        let ids: Vec<&str> = improved.model.effect.iter().map(|one| one.effect.as_str()).collect();
        assert_eq!(ids, ["rotor-drag"], "{fitted} fitted");
        assert!(improved.model.wind_of_each_flight);
        let unseen = improved.last().logs.last().unwrap();
        assert!(unseen.held_out && unseen.agrees, "{fitted} fitted");
        let force = unseen.error_of("force").unwrap();
        assert!(force.error < 1.1 * force.noise, "{force:?}");
    }
}

/// Flights between which something changed: each is told what it has.
#[test]
fn val_flights_that_differ_are_told_apart() {
    let model = ModelVersion::load(f550()).unwrap();
    let told = |hidden: &[&[&str]]| {
        let logs: Vec<FlightLog> = (hidden.iter().zip(first_seed() + 130..))
            .map(|(hidden, seed)| flown(Script::built_in("excitation", seed).unwrap(), 20.0, seed, hidden))
            .collect();
        let found = diagnose(&logs, &model, &Options::default()).unwrap();
        println!("{}", found.sentence);
        found
    };
    let share = |one: &Finding| one.parameters[0].value;
    let [small, large] = [
        "rotor-thrust-scale:rotor=3,share=-0.04",
        "rotor-thrust-scale:rotor=3,share=-0.1",
    ];
    // A propeller breaks after the second flight.
    let found = told(&[&[], &[], &[large]]);
    assert_eq!(
        found.verdict,
        Verdict::FlightsDiffer { changed: true },
        "{}",
        found.sentence
    );
    assert!(found.effects.is_empty() && found.held_out.is_empty() && found.proposal.is_none());
    let [healthy, damaged] = found.apart.as_slice() else {
        panic!("{}", found.sentence)
    };
    assert_eq!((healthy.logs.len(), &healthy.verdict), (2, &Verdict::Agrees));
    let [one] = damaged.effects.as_slice() else {
        panic!("{}", found.sentence)
    };
    assert_eq!(
        (one.instance.effect.as_str(), one.instance.rotor),
        ("rotor-thrust-scale", Some(3))
    );
    assert!(
        (share(one) + 0.1).abs() < 1.5 * one.parameters[0].interval_95,
        "{}",
        found.sentence
    );
    // It wears.
    let found = told(&[&[small], &[large]]);
    assert_eq!(
        found.verdict,
        Verdict::FlightsDiffer { changed: true },
        "{}",
        found.sentence
    );
    let shares: Vec<f64> = found.apart.iter().map(|one| share(&one.effects[0])).collect();
    assert!(
        matches!(*shares.as_slice(), [first, second] if (first + 0.04).abs() < 0.01 && (second + 0.1).abs() < 0.01),
        "{}",
        found.sentence
    );
    // What all of them have, and the catalogue has not, is no change; also if each flight alone is too short to show it.
    let found = told(&[&["thrust-fade"], &["thrust-fade"]]);
    assert!(found.apart.is_empty(), "{}", found.sentence);
}
