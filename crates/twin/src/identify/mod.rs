//! A vehicle from flight logs, mass and arm.
//!
//! ```text
//! FlightLog ─▶ outputs, airborne parts (grid) ─▶ frame (parameters, or every wiring tried) ─▶ thrust curve, lag, gains (fit)
//!                                                                      yaw ─ drag ─ voltage ─ battery ─ sensors ─▶ Identified
//! Identified ─▶ vehicle, blades, intervals (write) · R² on data that no fit has seen (held_out)
//! ```
//! Each value has a 95 % interval, its source, and what would improve it. What the flight cannot determine stays a
//! class default with a wide interval and is marked as such. Mass and arm are never estimated: an IMU measures thrust
//! over mass and torque over inertia, so every scale follows from what was entered.
//!
//! Limits: equal rotors, even where one is in the wake of another (coaxial frames); one thrust curve; differences
//! between rotors and the centre of mass are left to [`crate::compare`], which fits them to each log; how evenly the
//! flights were carried bounds them.

mod actuator;
mod agreement;
mod airframe;
mod balance;
mod bench;
mod class;
mod curve;
mod estimate;
mod excitation;
mod filters;
mod findings;
mod fit;
pub mod frames;
mod grid;
mod held_out;
mod observer;
mod order;
mod plausible;
mod slow;
mod slow_outputs;
mod wiring;
mod write;
mod yaw;

use serde::Serialize;
use std::fmt::Display;
use std::ops::RangeInclusive;

pub use crate::model::constants::Source;
pub use airframe::{Airframe, known_rotor_places};
pub use bench::Bench;
pub use class::Class;
pub use estimate::Estimate;
pub use filters::Band;
pub use held_out::{HeldOut, Score, held_out, held_out_with};
pub use order::{frame_contradiction, in_the_order_of, read_for, same_rotor_order};
pub use wiring::Wiring;
pub use write::{Files, files};

use crate::log::{FlightLog, SensorRate};
use balance::Balance;
use curve::Curve;
use excitation::Excitation;
use frames::Place;
use grid::Grid;
use held_out::Halves;

/// Why no vehicle comes out of a log: one sentence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct IdentifyError(pub String);

/// Masses of vehicles, kg.
pub const MASS_KG: RangeInclusive<f64> = 0.02..=200.0;
/// Distances from the centre to the farthest rotor, m.
pub const ARM_M: RangeInclusive<f64> = 0.02..=5.0;
/// Capacities of batteries, A h.
pub const CAPACITY_AH: RangeInclusive<f64> = 0.05..=1000.0;
/// Cells of batteries in series.
pub const CELLS: RangeInclusive<u32> = 1..=24;

/// What no log holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Mass including battery, kg.
    pub mass_kg: f64,
    /// Distance from the centre to the farthest rotor, m.
    pub arm_m: f64,
    /// Frame by name ([`frames::FRAMES`]) instead of the log's.
    pub frame: Option<String>,
    /// The stated frame is taken even where the motion contradicts it.
    pub trust_frame: bool,
    /// Capacity of the battery, Ah, where it is known.
    pub capacity_ah: Option<f64>,
    /// Cells in series, where they are known.
    pub cells: Option<u32>,
}

impl Request {
    fn check(&self) -> Result<(), IdentifyError> {
        within("mass", Some(self.mass_kg), &MASS_KG, " kg")?;
        within("arm", Some(self.arm_m), &ARM_M, " m")?;
        within("capacity", self.capacity_ah, &CAPACITY_AH, " A h")?;
        within("cells", self.cells, &CELLS, "")
    }
}

/// Checks a value that was given.
fn within<T: PartialOrd + Display>(
    name: &str,
    value: Option<T>,
    range: &RangeInclusive<T>,
    unit: &str,
) -> Result<(), IdentifyError> {
    match value.filter(|value| !range.contains(value)) {
        None => Ok(()),
        Some(value) => Err(IdentifyError(format!(
            "{name}: expected {} to {}{unit}, got {value}",
            range.start(),
            range.end()
        ))),
    }
}

/// Numbers that the vehicle document is written from; intervals are in [`Identified::values`].
#[derive(Debug, Clone)]
pub(crate) struct Numbers {
    pub(crate) curve: Curve,
    pub(crate) lag_s: f64,
    pub(crate) inertia: [f64; 3],
    pub(crate) moment_ratio: f64,
    pub(crate) reaction_s: f64,
    /// Of the body, along all axes, kg/s.
    pub(crate) drag: f64,
    /// Of the rotors, across their axis, kg/s.
    pub(crate) rotor_drag: f64,
    pub(crate) voltage: f64,
    pub(crate) voltage_slope: f64,
    pub(crate) cells: u32,
    pub(crate) capacity: f64,
    pub(crate) resistance: f64,
    pub(crate) power_coefficient: f64,
}

/// A part of a log.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = IdentifiedPart)]
pub struct Part {
    /// Log that it is of.
    pub log: String,
    /// s, on the log's time.
    pub start_s: f64,
    /// s.
    pub end_s: f64,
}

/// A vehicle as far as the logs determine it.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct Identified {
    /// Names of the logs.
    pub logs: Vec<String>,
    /// Size class of the defaults.
    pub class: Class,
    /// Outputs of the log that drive rotors, from 1.
    pub outputs: Vec<usize>,
    /// Rotor positions, and where they come from.
    pub airframe: Airframe,
    /// Parts of the logs that were used.
    pub airborne: Vec<Part>,
    /// Every value with its interval.
    pub values: Vec<Estimate>,
    /// Rates and noise of the streams.
    pub sensors: Vec<SensorRate>,
    /// Notes.
    pub notes: Vec<String>,
    /// How well each half predicts the other, where it is one log and long enough: the estimates need it anyhow.
    #[serde(skip)]
    pub held_out: Option<HeldOut>,
    #[serde(skip)]
    pub(crate) numbers: Numbers,
    #[serde(skip)]
    pub(crate) request: Request,
}

/// Result of an identification: each value with its 95 % interval and source, and the documents of the vehicle.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Identification<'a> {
    /// Its values.
    pub identified: &'a Identified,
    /// How well each half of a flight predicts the other.
    pub held_out: &'a [HeldOut],
    /// Files, if the job wrote any.
    pub written: Vec<String>,
    /// Vehicle document (TOML).
    pub vehicle: &'a str,
    /// Blade document (TOML) that the vehicle document names.
    pub blades: &'a str,
}

impl Identified {
    /// By its key.
    pub fn value(&self, key: &str) -> Option<&Estimate> {
        self.values.iter().find(|value| value.key == key)
    }

    /// Thrust of one rotor over the duty, N, at the mean voltage of the flight.
    pub fn thrust_n(&self, duty: f64) -> f64 {
        self.request.mass_kg * self.numbers.curve.hover * self.numbers.curve.shape(duty)
    }

    /// Voltage that [`Self::thrust_n`] holds at, V.
    pub fn voltage_v(&self) -> f64 {
        self.numbers.voltage
    }
}

/// Identifies a vehicle from its logs.
///
/// # Errors
/// Nothing in them is a flight, motor outputs are missing, the motor order is not known, or the request is out of range.
pub fn identify(logs: &[FlightLog], request: &Request) -> Result<Identified, IdentifyError> {
    identify_with(logs, request, None)
}

/// The same with a thrust bench of one of the rotors.
///
/// # Errors
/// As [`identify`].
pub fn identify_with(
    logs: &[FlightLog],
    request: &Request,
    bench: Option<&Bench>,
) -> Result<Identified, IdentifyError> {
    request.check()?;
    let class = Class::of(request.mass_kg, request.arm_m);
    let (grids, airframe) = prepare(logs, request, &class)?;
    if let Some(refusal) = plausible::refusal(request, airframe.places.len()) {
        return Err(IdentifyError(refusal));
    }
    estimate_all(logs, &grids, airframe, request, (class, bench))
}

/// Grids of all logs with their rotors picked out, and the frame.
pub(crate) fn prepare(
    logs: &[FlightLog],
    request: &Request,
    class: &Class,
) -> Result<(Vec<Grid>, Airframe), IdentifyError> {
    let first = logs
        .first()
        .ok_or_else(|| IdentifyError("expected at least one log".to_owned()))?;
    let outputs = airframe::rotor_outputs(first).map_err(IdentifyError)?;
    let grids = logs
        .iter()
        .map(|log| {
            let these = airframe::rotor_outputs(log)?;
            if let Some(why) = log.flight_parts(None).no_flight() {
                return Err(format!("{}: expected a flight, found none: {why}", log.name));
            }
            if these.len() != outputs.len() {
                return Err(format!(
                    "{}: expected {} rotors as in {}, found {}",
                    log.name,
                    outputs.len(),
                    first.name,
                    these.len()
                ));
            }
            Grid::new(log, &these)
        })
        .collect::<Result<Vec<_>, _>>()
        .map_err(IdentifyError)?;
    let airframe = airframe::find(first, &grids, request, class).map_err(IdentifyError)?;
    Ok((grids, airframe))
}

fn estimate_all(
    logs: &[FlightLog],
    grids: &[Grid],
    airframe: Airframe,
    request: &Request,
    (class, given_bench): (Class, Option<&Bench>),
) -> Result<Identified, IdentifyError> {
    let places = &airframe.places;
    let excitation = Excitation::of(grids);
    let problem = |voltage_slope| fit::Problem {
        grids,
        places: Some(places),
        class,
        voltage_slope,
        bench: None,
    };
    let mut fitted = fit::fit(&problem(class::VOLTAGE_SLOPE), request.arm_m);
    let has_voltage = grids.iter().all(|grid| grid.voltage.is_some());
    let mut voltage_slope = (class::VOLTAGE_SLOPE, class::VOLTAGE_SLOPE_DEVIATION, Source::Class);
    if has_voltage {
        voltage_slope = slow::voltage_slope(grids, &fitted.curve);
        if (voltage_slope.0 - class::VOLTAGE_SLOPE).abs() > 0.1 {
            fitted = fit::fit(&problem(voltage_slope.0), request.arm_m);
        }
    }
    let mut notes: Vec<String> = grids.iter().flat_map(|grid| grid.notes.clone()).collect();
    let bench = given_bench.and_then(|bench| {
        notes.extend(bench.notes.iter().map(|note| format!("bench {note}")));
        bench::consult(bench, &fitted, (&class, request.mass_kg), excitation.lift, &mut notes)
    });
    if let Some(about) = &bench {
        if let Some(of_the_bench) = about.exponent {
            let of_the_flight = (voltage_slope.0, voltage_slope.1);
            match (voltage_slope.2 == Source::Log, bench::together(of_the_flight, of_the_bench)) {
                (true, Some((slope, deviation))) => voltage_slope = (slope, deviation, Source::Log),
                (true, None) => notes.push(format!(
                    "d ln thrust/d ln voltage is {:.2} on the bench and {:.2} in the air, more than three deviations apart: not averaged, the flight's is taken",
                    of_the_bench.0, of_the_flight.0
                )),
                (false, _) => voltage_slope = (of_the_bench.0, of_the_bench.1, Source::Class),
            }
        }
        fitted = fit::fit(
            &fit::Problem {
                bench: about.prior(),
                ..problem(voltage_slope.0)
            },
            request.arm_m,
        );
    }
    let mut impossible_slope = None;
    if bench.is_none() {
        (fitted, impossible_slope) = fit::with_a_possible_slope(&problem(voltage_slope.0), request.arm_m, fitted);
    }
    notes.extend(slow::unlike(grids, &fitted.curve));
    let yaw = yaw::fit(grids, places, &fitted);
    let flights: Vec<(fit::Fitted, Excitation)> = match grids {
        [_] => Vec::new(),
        _ => grids
            .iter()
            .map(|grid| {
                let only = std::slice::from_ref(grid);
                let problem = fit::Problem {
                    grids: only,
                    bench: bench.as_ref().and_then(bench::About::prior),
                    ..problem(voltage_slope.0)
                };
                (fit::fit(&problem, request.arm_m), Excitation::of(only))
            })
            .collect(),
    };
    let halves = Halves::of(grids, places, &class, request, given_bench);
    if grids.iter().all(|grid| grid.rates.is_some() && grid.accel[2].is_some()) {
        notes.extend(excitation.note());
    }
    if grids.iter().any(|grid| grid.accel_from_estimator) {
        notes.push(
            "the vertical force is made from the estimator's acceleration: there is no accelerometer in the log"
                .to_owned(),
        );
    }
    let rotors = places.len();
    let slow_outputs = slow_outputs::Slow::slowest(grids.iter().filter_map(|grid| grid.slow_outputs));
    // Torques computed with a frame that is not the vehicle's say nothing, nor do outputs that miss most of them.
    let torques_are_known = !airframe.against_the_motion && slow_outputs.is_none();
    let balance = torques_are_known
        .then(|| Balance::of(grids, places, &fitted.curve))
        .flatten();
    let (numbers, values) = findings::Findings {
        request,
        class,
        grids,
        logs,
        fitted: &fitted,
        yaw,
        halves: halves.as_ref(),
        flights: &flights,
        voltage_slope,
        has_voltage,
        rotors,
        balance,
        against_the_motion: airframe.against_the_motion,
        excitation,
        slow_outputs: slow_outputs.is_some(),
        bench: bench.as_ref(),
        impossible_slope,
    }
    .values(&mut notes);
    if let Some(slow) = slow_outputs {
        slow.tell(&mut notes);
    }
    if let Some(doubt) = plausible::doubt(request, rotors, numbers.cells) {
        notes.insert(0, doubt);
    }
    let held_out = match (grids, &halves) {
        ([only], Some(halves)) => Some(halves.held_out(&only.name, only.airborne_s())),
        _ => None,
    };
    Ok(Identified {
        held_out,
        logs: logs.iter().map(|log| log.name.clone()).collect(),
        class,
        outputs: match logs.first() {
            Some(log) if !log.report.rotor_outputs.is_empty() => log.report.rotor_outputs.clone(),
            _ => grids[0].outputs.clone(),
        },
        airborne: grids
            .iter()
            .flat_map(|grid| {
                grid.airborne.iter().map(|part| Part {
                    log: grid.name.clone(),
                    start_s: grid.start_s + part.start as f64 * grid.step_s,
                    end_s: grid.start_s + part.end as f64 * grid.step_s,
                })
            })
            .collect(),
        airframe,
        values,
        sensors: logs.iter().take(1).flat_map(FlightLog::source_rates).collect(),
        notes,
        numbers,
        request: request.clone(),
    })
}

/// Levers in units of the arm, and their mean square, which convert a gain and a mass into an inertia.
pub(crate) fn lever_unit(places: &[Place]) -> f64 {
    places
        .iter()
        .map(|place| place.position[0].hypot(place.position[1]))
        .fold(0.0, f64::max)
}
