//! A vehicle from its logs, where the truth is known: vehicles drawn at random, flown by the independent simulator. The
//! identification sees the log, the mass and the arm, and no parameter.
//!
//! `VEHICLE_DRAWS=200 cargo test --release -p rotortwin-twin --test val_vehicle_from_log -- --nocapture` draws more;
//! `VEHICLE_FIRST_SEED=5000` draws other vehicles for the intervals: their floors were sized on seeds 0 to about 24.

#![expect(clippy::unwrap_used, reason = "a refusal where none is due fails the test")]

mod foreign_log;

use std::path::Path;

use foreign_log::foreign_log;
use nalgebra::Vector3;
use rotortwin_blind::catalogue::kind;
use rotortwin_blind::flight::FlightPlan;
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::random::Stream;
use rotortwin_blind::script::Script;
use rotortwin_blind::vehicle::{Rotor, Vehicle};
use rotortwin_plant::vehicle::model::SpinDirection;
use rotortwin_twin::bench_fit::Table;
use rotortwin_twin::identify::frames::FRAMES;
use rotortwin_twin::identify::{
    Bench, Identified, Request, Source, files, held_out, held_out_with, identify, identify_with,
};
use rotortwin_twin::log::{FlightLog, SourceKind};

/// A vehicle drawn at random about what its class defaults say, with the frame at `frame` of the table.
fn drawn(seed: u64, frame: usize) -> (Vehicle, f64) {
    let mut random = Stream::new(seed, "vehicle");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
    let mut vehicle = Vehicle::load(&path).unwrap();
    let arm = random.between(0.18, 0.40);
    vehicle.mass = random.between(0.8, 3.0);
    let inertia = |kappa: f64| kappa * vehicle.mass * arm * arm;
    let (jx, jy) = (inertia(random.between(0.14, 0.28)), inertia(random.between(0.16, 0.30)));
    vehicle.inertia = [jx, jy, random.between(0.87, 0.99) * (jx + jy)];
    vehicle.thrust_lag = random.between(0.025, 0.05);
    let ratio = random.between(0.011, 0.023);
    vehicle.rotors = FRAMES[frame]
        .places()
        .iter()
        .map(|place| Rotor {
            position: Vector3::new(arm * place.position[0], arm * place.position[1], 0.0),
            yaw_sign: if place.spin == SpinDirection::Ccw { 1.0 } else { -1.0 },
            moment_ratio: ratio,
        })
        .collect();
    // Eq. 19 through the hover: duty in percent, at 15.6 V.
    let hover = random.between(30.0, 42.0);
    let lift = vehicle.mass * 9.81 / vehicle.rotors.len() as f64;
    vehicle.blade_voltage_offset = random.between(3.0, 7.0);
    let (alpha, beta) = (random.between(0.2, 0.6), random.between(-0.35, 0.1));
    let per_volt = lift / (15.6 - vehicle.blade_voltage_offset);
    vehicle.blade = [
        per_volt * beta / hover.sqrt(),
        per_volt * (1.0 - alpha - beta) / hover,
        per_volt * alpha / (hover * hover),
        0.0,
    ];
    (vehicle, arm)
}

/// The log of a flight; `order` says which rotor drives output i.
fn flown(vehicle: &Vehicle, flight: &str, seconds: f64, seed: u64, order: &[usize]) -> FlightLog {
    tried(vehicle, flight, seconds, seed, order).unwrap()
}

/// c_L of the foreign simulator's rotors, N·s².
const THRUST_COEFFICIENT: f64 = 8.2e-6;

/// The same with rotors whose acceleration turns the vehicle: N = J_r Σ s_i Ω_i', J_r so that λ = J_r Ω_h/(2 c f_h).
fn with_reaction(
    vehicle: &Vehicle,
    flight: &str,
    (seconds, seed): (f64, u64),
    reaction_s: f64,
) -> Result<FlightLog, rotortwin_blind::error::BlindError> {
    let hover_n = vehicle.mass * 9.81 / vehicle.rotors.len() as f64;
    let speed = (hover_n / THRUST_COEFFICIENT).sqrt();
    let inertia = 2.0 * vehicle.rotors[0].moment_ratio * reaction_s * hover_n / speed;
    let script = Script::built_in(flight, seed).unwrap();
    let mut plan = FlightPlan::new(vehicle.clone(), script, seconds, seed);
    let mut reaction = Hidden::typical(kind("rotor-reaction").unwrap(), None);
    reaction.parameters = [("inertia_kg_m2".to_owned(), inertia)].into();
    plan.effects.push(reaction);
    let order: Vec<usize> = (0..vehicle.rotors.len()).collect();
    foreign_log(&format!("{flight} {seed}"), &plan, &order)
}

/// A waypoint flight of the F550 with a hidden effect of this size.
fn f550_with(effect: &str, parameter: &str, size: f64, seed: u64) -> (FlightLog, Request) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
    let vehicle = Vehicle::load(&path).unwrap();
    let script = Script::built_in("waypoint", seed).unwrap();
    let mut plan = FlightPlan::new(vehicle.clone(), script, 90.0, seed);
    let mut hidden = Hidden::typical(kind(effect).unwrap(), None);
    hidden.parameters = [(parameter.to_owned(), size)].into();
    plan.effects.push(hidden);
    let order: Vec<usize> = (0..6).collect();
    let log = foreign_log(&format!("{effect} {seed}"), &plan, &order).unwrap();
    (log, request(&vehicle, 0.275))
}

/// Drag of rotors acts across their axis, that of a body along all axes: climbs distinguish them.
#[test]
fn val_drag_across_the_axis_is_that_of_the_rotors() {
    for seed in [7, 8, 9] {
        let (log, request) = f550_with("rotor-drag", "drag_n_s_m", 0.25, seed);
        let found = identify(&[log], &request).unwrap();
        let (body, rotors) = (
            found.value("body.linear_drag_kg_s").unwrap(),
            found
                .value("rotors.drag_kg_s")
                .unwrap_or_else(|| panic!("seed {seed}: all axes alike")),
        );
        assert!((rotors.value - 0.25).abs() < 0.03, "seed {seed}: {rotors:?}");
        assert!(body.value < 0.03 && body.high < 0.1, "seed {seed}: {body:?}");
    }
}

#[test]
fn val_drag_along_all_axes_is_that_of_the_body() {
    for seed in [7, 8, 9] {
        let (log, request) = f550_with("linear-friction", "drag_kg_s", 0.25, seed);
        let found = identify(&[log], &request).unwrap();
        assert!(found.value("rotors.drag_kg_s").is_none(), "seed {seed}");
        let body = found.value("body.linear_drag_kg_s").unwrap();
        assert!((body.value - 0.25).abs() < 0.025, "seed {seed}: {body:?}");
    }
}

/// The same, where the pilot may lose a vehicle that is too lazy for the flight.
fn tried(
    vehicle: &Vehicle,
    flight: &str,
    seconds: f64,
    seed: u64,
    order: &[usize],
) -> Result<FlightLog, rotortwin_blind::error::BlindError> {
    let script = Script::built_in(flight, seed).unwrap();
    let plan = FlightPlan::new(vehicle.clone(), script, seconds, seed);
    foreign_log(&format!("{flight} {seed}"), &plan, order)
}

fn request(vehicle: &Vehicle, arm: f64) -> Request {
    Request {
        mass_kg: vehicle.mass,
        arm_m: arm,
        frame: None,
        trust_frame: false,
        capacity_ah: None,
        cells: None,
    }
}

fn draws(default: u64) -> u64 {
    setting("VEHICLE_DRAWS", default)
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// True if every output has the place and the spin of its rotor.
fn wired_right(found: &Identified, vehicle: &Vehicle, order: &[usize], arm: f64) -> bool {
    found.airframe.places.iter().zip(order).all(|(place, rotor)| {
        let rotor = &vehicle.rotors[*rotor];
        (place.position[0] * arm - rotor.position.x).abs() < 1e-6
            && (place.position[1] * arm - rotor.position.y).abs() < 1e-6
            && place.yaw_sign() == rotor.yaw_sign
    })
}

/// Frames of the drawn vehicles: all of the table.
fn all_frames() -> Vec<usize> {
    (0..FRAMES.len()).collect()
}

/// Those with pairs of rotors on one axis, or those without.
fn frames_of(coaxial: bool) -> Vec<usize> {
    let is_coaxial = |frame: &usize| {
        let places = FRAMES[*frame].places();
        (1..places.len()).any(|i| places[..i].iter().any(|other| other.position == places[i].position))
    };
    all_frames()
        .into_iter()
        .filter(|frame| is_coaxial(frame) == coaxial)
        .collect()
}

#[test]
fn val_values_lie_in_their_intervals_at_the_stated_rate() {
    let frames = frames_of(false);
    let keys = [
        "body.inertia_body_kg_m2[0]",
        "body.inertia_body_kg_m2[1]",
        "body.inertia_body_kg_m2[2]",
        "rotors.moment_ratio_m",
        "rotors.thrust_slope",
        "rotors.thrust_lag_s",
    ];
    let mut inside = vec![0_usize; keys.len()];
    let mut errors: Vec<Vec<f64>> = vec![Vec::new(); keys.len()];
    let mut curve_errors = Vec::new();
    let mut bounded = 0;
    let count = draws(16);
    let mut flights = 0;
    for seed in setting("VEHICLE_FIRST_SEED", 0).. {
        if flights == count {
            break;
        }
        let (vehicle, arm) = drawn(seed, frames[seed as usize % frames.len()]);
        let order: Vec<usize> = (0..vehicle.rotors.len()).collect();
        let Ok(log) = tried(&vehicle, "excitation", 45.0, seed, &order) else {
            continue;
        };
        flights += 1;
        // The order of the rotors is another test's.
        let told = Request {
            frame: Some(FRAMES[frames[seed as usize % frames.len()]].name.to_owned()),
            ..request(&vehicle, arm)
        };
        let found = identify(std::slice::from_ref(&log), &told).unwrap();
        files(&found, "drawn").documents().unwrap();
        assert!(
            wired_right(&found, &vehicle, &order, arm),
            "seed {seed}: {:?}",
            found.airframe
        );
        let hover = found.value("rotors.hover_duty").unwrap().value;
        let voltage = found.voltage_v();
        let thrust = |duty: f64| vehicle.static_thrust(duty, voltage);
        let truth = [
            vehicle.inertia[0],
            vehicle.inertia[1],
            vehicle.inertia[2],
            vehicle.rotors[0].moment_ratio,
            (thrust(1.001 * hover) / thrust(0.999 * hover)).ln() / (1.001_f64 / 0.999).ln(),
            vehicle.thrust_lag,
        ];
        // None of these rotors has an inertia: none is invented.
        let reaction = found.value("rotors.reaction_s").unwrap();
        assert!(
            reaction.value == 0.0 && reaction.low == 0.0,
            "seed {seed}: {reaction:?}"
        );
        bounded += usize::from(reaction.source == Source::Log);
        for (i, key) in keys.iter().enumerate() {
            let value = found.value(key).unwrap();
            inside[i] += usize::from((value.low..=value.high).contains(&truth[i]));
            errors[i].push((value.value / truth[i] - 1.0).abs());
            assert!(
                value.low > 0.0 && value.high / value.low < 6.0,
                "seed {seed}, {key}: {value:?}"
            );
        }
        // Over the duties that this flight holds nine tenths of its time.
        let mut flown: Vec<f64> = log.duties().iter().flat_map(|duty| duty.iter().copied()).collect();
        flown.sort_by(f64::total_cmp);
        let at = |share: f64| flown[(share * (flown.len() - 1) as f64) as usize];
        let worst = (0..=10)
            .map(|i| at(0.05) + (at(0.95) - at(0.05)) * f64::from(i) / 10.0)
            .map(|duty| (found.thrust_n(duty) / thrust(duty) - 1.0).abs())
            .fold(0.0, f64::max);
        curve_errors.push(worst);
    }
    let median = |values: &[f64]| {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    };
    for (i, key) in keys.iter().enumerate() {
        println!(
            "{key}: {} of {count} inside, median error {:.1} %",
            inside[i],
            100.0 * median(&errors[i])
        );
    }
    println!(
        "reaction of the rotors: none invented in {count}, bounded by the log in {bounded}, unknown in the others"
    );
    println!(
        "thrust curve: median of the worst error {:.1} %",
        100.0 * median(&curve_errors)
    );
    for (i, key) in keys.iter().enumerate() {
        // 95 % of 16 is 15.2; 11 or fewer have a probability of 0.1 % then, as 89 % of 200.
        let least = (0.95 * count as f64 - 2.8 * (0.95 * 0.05 * count as f64).sqrt()).floor() as usize;
        assert!(inside[i] >= least, "{key}: {} of {count}", inside[i]);
    }
    assert!(median(&curve_errors) < 0.03, "{curve_errors:?}");
    assert!(median(&errors[0]) < 0.10 && median(&errors[1]) < 0.10);
    assert!(median(&errors[5]) < 0.10);
}

#[test]
fn val_the_reaction_of_rotors_that_have_an_inertia_is_found_and_one_of_a_hover_is_unknown() {
    let frames = frames_of(false);
    let count = draws(8);
    let (mut flights, mut seen, mut inside, mut ratios) = (0, 0, 0, Vec::new());
    for seed in setting("VEHICLE_FIRST_SEED", 7000).. {
        if flights == count {
            break;
        }
        let frame = frames[seed as usize % frames.len()];
        let (vehicle, arm) = drawn(seed, frame);
        let truth = Stream::new(seed, "reaction").between(0.05, 0.15);
        let Ok(log) = with_reaction(&vehicle, "excitation", (45.0, seed), truth) else {
            continue;
        };
        flights += 1;
        let told = Request {
            frame: Some(FRAMES[frame].name.to_owned()),
            ..request(&vehicle, arm)
        };
        let found = identify(&[log], &told).unwrap();
        let value = found.value("rotors.reaction_s").unwrap();
        // A flight in which it does not show says so, and is not wrong.
        seen += usize::from(value.value > 0.0);
        inside += usize::from((value.low..=value.high).contains(&truth));
        if value.value > 0.0 {
            ratios.push(value.value / truth);
            let written = files(&found, "drawn").documents().unwrap();
            assert!((written.vehicle.rotors.reaction_s / value.value - 1.0).abs() < 1e-3);
        }
    }
    ratios.sort_by(f64::total_cmp);
    println!("reaction: {seen} of {count} seen, {inside} of {count} inside, value over truth {ratios:.3?}");
    let least = (0.95 * count as f64 - 2.8 * (0.95 * 0.05 * count as f64).sqrt()).floor() as usize;
    assert!(inside >= least, "{inside} of {count}");
    assert!(2 * seen >= count as usize, "{seen} of {count}");

    for reaction_s in [0.0, 0.1] {
        let (vehicle, arm) = drawn(7000, 0);
        let log = with_reaction(&vehicle, "hover", (40.0, 7000), reaction_s).unwrap();
        let told = Request {
            frame: Some(FRAMES[0].name.to_owned()),
            ..request(&vehicle, arm)
        };
        let found = identify(&[log], &told).unwrap();
        let value = found.value("rotors.reaction_s").unwrap();
        assert!(
            value.value == 0.0 && value.source == Source::Class && value.how.contains("unknown"),
            "{value:?}"
        );
        assert!((value.low..=value.high).contains(&reaction_s), "{value:?}");
    }
}

/// Orders of shuffled outputs that are found, and those that stay unknown; a wrong one fails.
fn shuffled(frames: &[usize], first_seed: u64, count: u64) -> (u64, u64) {
    let (mut right, mut unknown) = (0_u64, 0_u64);
    for seed in 0_u64.. {
        if right + unknown == count {
            break;
        }
        let (vehicle, arm) = drawn(first_seed + seed, frames[seed as usize % frames.len()]);
        let mut random = Stream::new(seed, "order");
        let mut order: Vec<usize> = (0..vehicle.rotors.len()).collect();
        for i in (1..order.len()).rev() {
            order.swap(i, (random.between(0.0, (i + 1) as f64) as usize).min(i));
        }
        let Ok(log) = tried(&vehicle, "excitation", 30.0, first_seed + seed, &order) else {
            continue;
        };
        match identify(&[log], &request(&vehicle, arm)) {
            Ok(found) => {
                assert!(
                    wired_right(&found, &vehicle, &order, arm),
                    "seed {seed}: {:?}",
                    found.airframe
                );
                right += 1;
            }
            Err(error) => {
                assert!(error.0.contains("motor order is unknown"), "{error}");
                unknown += 1;
            }
        }
    }
    println!("{right} right, {unknown} unknown, 0 wrong");
    (right, unknown)
}

#[test]
fn val_wirings_are_found_on_exciting_flights_and_never_wrong() {
    let frames = frames_of(false);
    let count = draws(frames.len() as u64);
    let (_, unknown) = shuffled(&frames, 1000, count);
    // "Unknown" is an honest answer, but one in sixteen is the most that an exciting flight may leave so.
    assert!(16 * unknown <= count, "{unknown} of {count} unknown");
}

/// Three counter-rotating pairs; of an X8 the motion is not searched for an order.
#[test]
fn val_wirings_of_coaxial_pairs_are_found_and_never_wrong() {
    let frames: Vec<usize> = frames_of(true)
        .into_iter()
        .filter(|frame| FRAMES[*frame].places().len() == 6)
        .collect();
    let count = draws(6);
    let (_, unknown) = shuffled(&frames, 1400, count);
    assert!(6 * unknown <= count, "{unknown} of {count} unknown");
}

/// An X8 whose frame is named: the values of a flight lie in their intervals as those of a flat frame do.
#[test]
fn val_a_coaxial_vehicle_of_a_named_frame_is_identified() {
    let frame = FRAMES.iter().position(|frame| frame.name == "octaquad-x").unwrap();
    let flight = |seed: u64| {
        let (vehicle, arm) = drawn(seed, frame);
        let order: Vec<usize> = (0..vehicle.rotors.len()).collect();
        let log = tried(&vehicle, "excitation", 45.0, seed, &order).ok()?;
        Some((vehicle, arm, log))
    };
    let (vehicle, arm, log) = (1500..).find_map(flight).unwrap();
    let told = |name: &str| Request {
        frame: Some(name.to_owned()),
        ..request(&vehicle, arm)
    };
    let found = identify(std::slice::from_ref(&log), &told("octaquad-x")).unwrap();
    for (axis, truth) in vehicle.inertia.iter().enumerate().take(2) {
        let value = found.value(&format!("body.inertia_body_kg_m2[{axis}]")).unwrap();
        assert!(
            value.source == Source::Log && (value.value / truth - 1.0).abs() < 0.1,
            "{value:?}"
        );
    }
    let documents = files(&found, "drawn").documents().unwrap();
    assert_eq!(documents.vehicle.rotor_count(), 8);
}

/// Radii of gyration about roll and pitch, over the arm, that are written with a source.
fn gyrations(found: &Identified, vehicle: &Vehicle, arm: f64) -> [(f64, Source); 2] {
    [0, 1].map(|axis| {
        let value = found.value(&format!("body.inertia_body_kg_m2[{axis}]")).unwrap();
        ((value.value / vehicle.mass).sqrt() / arm, value.source)
    })
}

#[test]
fn val_a_frame_that_the_motion_contradicts_is_refused_and_no_impossible_inertia_is_called_identified() {
    let (mut refused, mut accepted) = (0, 0);
    for frame in all_frames()
        .into_iter()
        .filter(|frame| FRAMES[*frame].places().len() < 8)
    {
        // The first vehicle of this frame that its pilot does not lose.
        let flight = |seed: u64| {
            let (vehicle, arm) = drawn(seed, frame);
            let order: Vec<usize> = (0..vehicle.rotors.len()).collect();
            let log = tried(&vehicle, "excitation", 30.0, seed, &order).ok()?;
            Some((vehicle, arm, order, log))
        };
        let (vehicle, arm, order, log) = (3000..).find_map(flight).unwrap();
        for other in FRAMES.iter() {
            let places = other.places();
            if places.len() != order.len() {
                continue;
            }
            let same = places == FRAMES[frame].places();
            let told = |trust_frame| Request {
                frame: Some(other.name.to_owned()),
                trust_frame,
                ..request(&vehicle, arm)
            };
            match identify(std::slice::from_ref(&log), &told(false)) {
                Ok(found) => {
                    assert!(same, "{} as {}: {:?}", FRAMES[frame].name, other.name, found.airframe);
                    accepted += 1;
                }
                Err(error) => {
                    let text = error.0;
                    assert!(!same, "{text}");
                    assert!(
                        text.contains("contradicts the motion") && text.contains("--trust-frame"),
                        "{text}"
                    );
                    refused += 1;
                    // Who insists gets no wrong number for it.
                    let found = identify(std::slice::from_ref(&log), &told(true)).unwrap();
                    assert!(found.airframe.how.contains("TRUSTED AGAINST THE MOTION"));
                    files(&found, "drawn").documents().unwrap();
                    for (gyration, source) in gyrations(&found, &vehicle, arm) {
                        assert!(
                            (0.2..=0.8).contains(&gyration) && source == Source::Class,
                            "{}: {gyration} {source:?}",
                            other.name
                        );
                    }
                }
            }
        }
    }
    println!("{refused} refused, {accepted} accepted");
    assert!(refused > accepted && accepted > 0);
}

#[test]
fn val_an_inertia_that_cannot_be_for_mass_and_arm_is_refused_with_its_reason() {
    let (vehicle, arm) = drawn(4000, 0);
    let log = flown(&vehicle, "excitation", 30.0, 4, &[0, 1, 2, 3]);
    let mut reasons = 0;
    for wrong in [12.0, 0.2, 0.15] {
        // J/(m l²) is proportional to 1/l.
        let found = match identify(std::slice::from_ref(&log), &request(&vehicle, wrong * arm)) {
            Ok(found) => found,
            // 2.5 kg on arms of 4 cm: no propeller carries that, whatever the inertia.
            Err(refusal) => {
                assert!(
                    wrong == 0.15 && refusal.0.contains("mass and arm"),
                    "{wrong}: {refusal}"
                );
                continue;
            }
        };
        for (gyration, source) in gyrations(&found, &vehicle, wrong * arm) {
            assert!(
                (0.2..=0.8).contains(&gyration) && source == Source::Class,
                "{wrong}: {gyration} {source:?}"
            );
        }
        let told = |note: &String| note.contains("inertia, roll") && note.contains("is impossible for");
        reasons += usize::from(found.notes.iter().any(told));
    }
    assert!(reasons > 0);
}

#[test]
fn val_a_hover_says_what_it_cannot_know() {
    for seed in 0..4 {
        let (vehicle, arm) = drawn(2000 + seed, 0);
        let order = [0, 1, 2, 3];
        let log = flown(&vehicle, "hover", 30.0, seed, &order);
        match identify(std::slice::from_ref(&log), &request(&vehicle, arm)) {
            Ok(found) => assert!(wired_right(&found, &vehicle, &order, arm), "{:?}", found.airframe),
            Err(error) => assert!(error.0.contains("motor order is unknown"), "{error}"),
        }
        let told = Request {
            frame: Some(FRAMES[0].name.to_owned()),
            ..request(&vehicle, arm)
        };
        let found = identify(&[log], &told).unwrap();
        let slope = found.value("rotors.thrust_slope").unwrap();
        assert_ne!(slope.source, Source::Log, "{slope:?}");
        assert!(slope.high - slope.low > 0.2, "{slope:?}");
        let drag = found.value("body.linear_drag_kg_s").unwrap();
        assert_eq!(drag.source, Source::Class);
        for axis in 0..2 {
            let inertia = found.value(&format!("body.inertia_body_kg_m2[{axis}]")).unwrap();
            assert!(
                (inertia.low..=inertia.high).contains(&vehicle.inertia[axis]),
                "{inertia:?} {}",
                vehicle.inertia[axis]
            );
        }
    }
}

/// Thrust of one rotor as a stand measures it: 1 % of noise, a sag of 6 % along the throttle, c with 2 %.
fn stand(vehicle: &Vehicle, seed: u64, stretch: f64) -> Table {
    let mut random = Stream::new(seed, "stand");
    let mut table = Table {
        name: "stand.csv".to_owned(),
        ..Table::default()
    };
    for k in 2..=20 {
        let duty = 0.05 * f64::from(k);
        let percent = 100.0 * duty;
        let voltage = 15.6 * (1.0 - 0.06 * duty * duty);
        let [a, b, c, d] = vehicle.blade;
        let per_volt = a * percent.sqrt() + percent * (b + percent * (c + percent * d));
        let thrust = (voltage - vehicle.blade_voltage_offset) * per_volt * random.between(0.99, 1.01);
        table.command.push(duty);
        table.voltage.push(voltage);
        table.thrust.push(stretch * thrust);
        table
            .torque
            .push(stretch * thrust * vehicle.rotors[0].moment_ratio * random.between(0.98, 1.02));
    }
    table
}

#[test]
fn val_a_bench_makes_a_hover_tell_the_thrust_curve_and_what_contradicts_the_flight_is_said() {
    let frame = FRAMES.iter().position(|frame| frame.name == "quad-x").unwrap();
    let order: Vec<usize> = (0..4).collect();
    let (mut without_worst, mut with_worst) = (Vec::new(), Vec::new());
    for seed in 40..44 {
        let (vehicle, arm) = drawn(seed, frame);
        let log = flown(&vehicle, "hover", 30.0, seed, &order);
        let told = Request {
            frame: Some("quad-x".to_owned()),
            ..request(&vehicle, arm)
        };
        let logs = std::slice::from_ref(&log);
        let bench = Bench::of_tables(&[stand(&vehicle, seed, 1.0)]).unwrap();
        let without = identify(logs, &told).unwrap();
        let with = identify_with(logs, &told, Some(&bench)).unwrap();
        // Thrust at duties that a hover never has, over that of the hover.
        let hover = without.value("rotors.hover_duty").unwrap().value;
        let truth = |duty: f64| {
            let percent = 100.0 * duty;
            let [a, b, c, d] = vehicle.blade;
            a * percent.sqrt() + percent * (b + percent * (c + percent * d))
        };
        let worst = |found: &Identified| {
            [0.6, 0.8, 1.3, 1.6, 2.0]
                .map(|z| {
                    (found.thrust_n(z * hover) / found.thrust_n(hover) * truth(hover) / truth(z * hover) - 1.0).abs()
                })
                .into_iter()
                .fold(0.0, f64::max)
        };
        without_worst.push(worst(&without));
        with_worst.push(worst(&with));
        let slope = with.value("rotors.thrust_slope").unwrap();
        assert_eq!(slope.source, Source::Bench);
        let true_slope = (truth(1.001 * hover) / truth(0.999 * hover)).ln() / (1.001_f64 / 0.999).ln();
        assert!(
            (slope.low..=slope.high).contains(&true_slope),
            "{seed}: {slope:?}, {true_slope}"
        );
        let ratio = with.value("rotors.moment_ratio_m").unwrap();
        let true_ratio = vehicle.rotors[0].moment_ratio;
        assert!(
            ratio.source == Source::Bench && (ratio.low..=ratio.high).contains(&true_ratio),
            "{seed}: {ratio:?}, {true_ratio}"
        );
        files(&with, "benched").documents().unwrap();
        // Twice the thrust: another rotor.
        let other = Bench::of_tables(&[stand(&vehicle, seed, 2.0)]).unwrap();
        let refused = identify_with(logs, &told, Some(&other)).unwrap();
        assert!(
            refused.notes.iter().any(|note| note.contains("It is not used")),
            "{:?}",
            refused.notes
        );
        assert_ne!(refused.value("rotors.thrust_slope").unwrap().source, Source::Bench);
    }
    println!(
        "worst error of the thrust curve beyond the hover: without {without_worst:.3?}, with the bench {with_worst:.3?}"
    );
    for (without, with) in without_worst.iter().zip(&with_worst) {
        assert!(with < without && *with < 0.06, "{without_worst:.3?} {with_worst:.3?}");
    }
}

#[test]
fn val_a_bench_makes_the_held_out_error_smaller_or_leaves_it() {
    let frame = FRAMES.iter().position(|frame| frame.name == "quad-x").unwrap();
    let order: Vec<usize> = (0..4).collect();
    let (vehicle, arm) = drawn(51, frame);
    let log = flown(&vehicle, "waypoint", 40.0, 51, &order);
    let told = Request {
        frame: Some("quad-x".to_owned()),
        ..request(&vehicle, arm)
    };
    let bench = Bench::of_tables(&[stand(&vehicle, 51, 1.0)]).unwrap();
    let without = held_out(&log, &told).unwrap();
    let with = held_out_with(&log, &told, Some(&bench)).unwrap();
    for (without, with) in without.scores.iter().zip(&with.scores) {
        println!(
            "{}: {:.4} without, {:.4} with the bench",
            without.channel, without.calibrated, with.calibrated
        );
        assert!(with.calibrated > without.calibrated - 0.005, "{without:?} {with:?}");
    }
    // A bench of a propeller whose thrust rises much faster: both are said, neither is mixed with the other.
    let mut steep = stand(&vehicle, 51, 1.0);
    let hover = vehicle.mass * 9.81 / 4.0;
    for thrust in &mut steep.thrust {
        *thrust = hover * (*thrust / hover).powf(1.6);
    }
    let logs = std::slice::from_ref(&log);
    let plain = identify(logs, &told).unwrap();
    let contradicted = identify_with(logs, &told, Some(&Bench::of_tables(&[steep]).unwrap())).unwrap();
    let said = contradicted
        .notes
        .iter()
        .any(|note| note.contains("deviations apart: not averaged"));
    assert!(said, "{:?}", contradicted.notes);
    assert_eq!(
        plain.value("rotors.thrust_slope"),
        contradicted.value("rotors.thrust_slope")
    );
}

#[test]
fn val_what_is_no_flight_or_out_of_range_is_refused_with_a_sentence() {
    let (vehicle, arm) = drawn(1, 0);
    let log = flown(&vehicle, "excitation", 12.0, 1, &[0, 1, 2, 3]);
    let refused = |log: &FlightLog, request: &Request| identify(std::slice::from_ref(log), request).unwrap_err().0;
    let good = request(&vehicle, arm);
    let heavy = Request {
        mass_kg: 1e4,
        ..good.clone()
    };
    assert!(refused(&log, &heavy).starts_with("mass: expected"));
    let strange = Request {
        frame: Some("quad-y".to_owned()),
        ..good.clone()
    };
    assert!(refused(&log, &strange).contains("expected one of quad-x"));
    let hexa = Request {
        frame: Some("hexa-x".to_owned()),
        ..good.clone()
    };
    assert!(refused(&log, &hexa).contains("has 6 rotors, 4 outputs move"));
    let mut still = log.clone();
    for output in 1..=4 {
        still
            .columns
            .insert(format!("duty_{output}"), vec![0.0; still.time_s.len()]);
    }
    assert!(refused(&still, &good).contains("no flight in this log"));
    let mut none = log;
    none.columns.retain(|name, _| !name.starts_with("duty"));
    assert!(refused(&none, &good).contains("the log has none"));
}

/// The frame of the table with this name.
fn named(name: &str) -> usize {
    FRAMES.iter().position(|frame| frame.name == name).unwrap()
}

/// A blackbox has no parameter of the frame; its motors are numbered by the mixer, and turn either way.
#[test]
fn val_a_blackbox_has_betaflights_order_and_the_motion_says_which_way_the_motors_turn() {
    for name in ["quad-betaflight-x", "quad-betaflight-x-reversed"] {
        let (vehicle, arm) = drawn(41, named(name));
        let mut log = flown(&vehicle, "waypoint", 40.0, 41, &[0, 1, 2, 3]);
        log.source.kind = SourceKind::Blackbox;
        let found = identify(std::slice::from_ref(&log), &request(&vehicle, arm)).unwrap();
        assert_eq!(found.airframe.name, name, "{}", found.airframe.how);
        assert!(wired_right(&found, &vehicle, &[0, 1, 2, 3], arm));
        // Eight seconds are too few: one of the two is taken, and that is said.
        let short = log.part(25.0, 33.0).unwrap();
        let found = identify(std::slice::from_ref(&short), &request(&vehicle, arm)).unwrap();
        assert!(
            found.airframe.name.starts_with("quad-betaflight-x"),
            "{}",
            found.airframe.name
        );
        assert!(
            found.airframe.how.contains("does not clearly show"),
            "{}",
            found.airframe.how
        );
    }
    // Motors that somebody has put in another order are not taken for Betaflight's.
    let (vehicle, arm) = drawn(41, named("quad-betaflight-x"));
    let mut log = flown(&vehicle, "waypoint", 40.0, 41, &[2, 0, 3, 1]);
    log.source.kind = SourceKind::Blackbox;
    let found = identify(std::slice::from_ref(&log), &request(&vehicle, arm)).unwrap();
    assert!(
        wired_right(&found, &vehicle, &[2, 0, 3, 1], arm),
        "{}",
        found.airframe.how
    );
}

/// Telemetry at 1 to 4 Hz "contradicted" the frame with correlations of 1.00.
#[test]
fn regress_rows_too_far_apart_tell_nothing_of_a_vehicle() {
    let (vehicle, arm) = drawn(42, named("quad-x"));
    let log = flown(&vehicle, "waypoint", 60.0, 42, &[0, 1, 2, 3]);
    let slow = log.resampled(2.0).unwrap();
    let refused = identify(std::slice::from_ref(&slow), &request(&vehicle, arm))
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("2.0 rows per second, expected at least 10"),
        "{refused}"
    );
}
