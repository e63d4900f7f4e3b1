//! R² on held-out data: each half of the flight predicted with the result of the other half, compared with the class
//! default.

use serde::Serialize;

use super::actuator::lagged;
use super::bench::{self, Bench};
use super::class::{self, Class};
use super::curve::Curve;
use super::excitation::Excitation;
use super::filters::Band;
use super::fit::{self, Fitted, Series};
use super::frames::Place;
use super::grid::Grid;
use super::plausible::{has_possible_gyration, has_possible_moment};
use super::yaw::{self, Yaw, derivative};
use super::{IdentifyError, Request, prepare, slow};
use crate::log::FlightLog;

/// One channel.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = HeldOutScore)]
pub struct Score {
    /// In words.
    pub channel: &'static str,
    /// Where measurement and prediction are compared.
    pub band: Band,
    /// R² of the class default, with the hover level of the log.
    pub class_default: f64,
    /// R² of the vehicle fitted to the other half.
    pub calibrated: f64,
}

/// Scores of one log.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = HeldOutScores)]
pub struct HeldOut {
    /// Log.
    pub log: String,
    /// Seconds in the air, both halves.
    pub seconds: f64,
    /// By channel.
    pub scores: Vec<Score>,
    /// Gain fitted to the second half over that of the first: roll, pitch. Near 1 if both halves agree on the
    /// vehicle.
    pub gain_ratio: [f64; 2],
}

/// A model in the units of the fit.
struct Model {
    curve: Curve,
    lag_s: f64,
    delay_s: f64,
    gain: [f64; 2],
    yaw_gain: f64,
    reaction_s: f64,
    /// Fall of the thrust with the time.
    fall: Option<slow::Fall>,
}

/// Residual power and power of a channel.
#[derive(Default, Clone, Copy)]
struct Sum {
    residual: f64,
    measured: f64,
    mean: f64,
    count: f64,
}

impl Sum {
    fn add(&mut self, measured: &[f64], predicted: &[f64], settle: usize) {
        for k in settle..measured.len().saturating_sub(settle) {
            self.residual += (measured[k] - predicted[k]).powi(2);
            self.measured += measured[k] * measured[k];
            self.mean += measured[k];
            self.count += 1.0;
        }
    }

    fn explained(&self) -> f64 {
        1.0 - self.residual / (self.measured - self.mean * self.mean / self.count)
    }
}

/// Fits each half of a log's flight and scores it on the other.
///
/// # Errors
/// As [`super::identify`]; or the flight is too short for two halves.
pub fn held_out(log: &FlightLog, request: &Request) -> Result<HeldOut, IdentifyError> {
    held_out_with(log, request, None)
}

/// The same with a thrust bench of one of the rotors.
///
/// # Errors
/// As [`held_out`].
pub fn held_out_with(log: &FlightLog, request: &Request, bench: Option<&Bench>) -> Result<HeldOut, IdentifyError> {
    let class = Class::of(request.mass_kg, request.arm_m);
    let (grids, airframe) = prepare(std::slice::from_ref(log), request, &class)?;
    let seconds = grids[0].airborne_s();
    let halves = Halves::of(&grids, &airframe.places, &class, request, bench).ok_or_else(|| {
        IdentifyError(format!(
            "{}: {seconds:.1} s in the air; two halves of at least 3 s are needed",
            log.name
        ))
    })?;
    Ok(halves.held_out(&log.name, seconds))
}

/// Channels of the scores.
const LIFT: &str = "vertical specific force";
const LIFT_WITHOUT_DRIFT: &str = "the same without drift";
const ACCELERATION: [&str; 3] = ["roll acceleration", "pitch acceleration", "yaw acceleration"];

/// What each half of the flights gives by itself, and how well it predicts the other.
pub(crate) struct Halves {
    pub(crate) fitted: [Fitted; 2],
    pub(crate) yaw: [Option<Yaw>; 2],
    pub(crate) excitation: [Excitation; 2],
    pub(crate) scores: Vec<Score>,
}

impl Halves {
    /// Each flight is cut in the middle; `None` where none is long enough.
    pub(crate) fn of(
        grids: &[Grid],
        places: &[Place],
        class: &Class,
        request: &Request,
        bench: Option<&Bench>,
    ) -> Option<Self> {
        let (first, second): (Vec<Grid>, Vec<Grid>) = grids.iter().filter_map(split).map(|[a, b]| (a, b)).unzip();
        let step_s = first.iter().map(|grid| grid.step_s).reduce(f64::max)?;
        let fast = first.iter().all(|grid| grid.fast);
        let mut lift = Band::of_lift(step_s, fast);
        // Above its low-pass an accelerometer shows nothing that could be predicted.
        for corner_hz in first.iter().filter_map(|grid| grid.accel_low_pass_hz) {
            lift.high_hz = lift.high_hz.min(corner_hz);
        }
        let channels: [(&'static str, Band); 5] = [
            (LIFT, lift),
            (LIFT_WITHOUT_DRIFT, Band { low_hz: 0.1, ..lift }),
            (ACCELERATION[0], Band::of_torque(step_s, fast)),
            (ACCELERATION[1], Band::of_torque(step_s, fast)),
            (ACCELERATION[2], Band::of_yaw(step_s, fast)),
        ];
        let mut sums = [[Sum::default(); 5]; 2];
        let [one, other] = [(&first, &second), (&second, &first)].map(|(learn, proof)| {
            let default = default_model(learn, class, request.arm_m);
            let calibrated = calibrate(learn, places, class, request, bench);
            for (sums, model) in sums.iter_mut().zip([&default, &calibrated.model]) {
                for grid in proof {
                    score(grid, places, model, &channels, sums);
                }
            }
            calibrated
        });
        let scores = channels
            .iter()
            .enumerate()
            .filter(|(i, _)| sums[0][*i].count > 0.0)
            .map(|(i, (channel, band))| Score {
                channel,
                band: *band,
                class_default: sums[0][i].explained(),
                calibrated: sums[1][i].explained(),
            })
            .collect();
        Some(Self {
            yaw: [one.yaw, other.yaw],
            fitted: [one.fitted, other.fitted],
            excitation: [Excitation::of(&first), Excitation::of(&second)],
            scores,
        })
    }

    /// As displayed, for a log with this many seconds in the air.
    pub(crate) fn held_out(&self, log: &str, seconds: f64) -> HeldOut {
        let [first, second] = &self.fitted;
        HeldOut {
            log: log.to_owned(),
            seconds,
            gain_ratio: [0, 1].map(|axis| second.gain[axis] / first.gain[axis]),
            scores: self.scores.clone(),
        }
    }

    /// R² of the specific force apart from its drift.
    pub(crate) fn lift(&self) -> Option<&Score> {
        self.score(LIFT_WITHOUT_DRIFT)
    }

    /// R² of the acceleration in roll, pitch or yaw.
    pub(crate) fn acceleration(&self, axis: usize) -> Option<&Score> {
        self.score(ACCELERATION[axis])
    }

    fn score(&self, channel: &str) -> Option<&Score> {
        self.scores.iter().find(|score| score.channel == channel)
    }
}

/// The time in the air, cut in the middle.
fn split(grid: &Grid) -> Option<[Grid; 2]> {
    let total: usize = grid.airborne.iter().map(ExactSizeIterator::len).sum();
    let mut seen = 0;
    let mut halves = [grid.clone(), grid.clone()];
    halves[0].airborne.clear();
    halves[1].airborne.clear();
    for part in &grid.airborne {
        let left = (total / 2).saturating_sub(seen).min(part.len());
        if left > 0 {
            halves[0].airborne.push(part.start..part.start + left);
        }
        if left < part.len() {
            halves[1].airborne.push(part.start + left..part.end);
        }
        seen += part.len();
    }
    for half in &mut halves {
        half.airborne.retain(|part| part.len() as f64 * grid.step_s > 1.0);
    }
    halves.iter().all(|half| half.airborne_s() >= 3.0).then_some(halves)
}

/// What some flights give.
struct Calibrated {
    model: Model,
    fitted: Fitted,
    /// Also where no propeller has it.
    yaw: Option<Yaw>,
}

fn calibrate(grids: &[Grid], places: &[Place], class: &Class, request: &Request, bench: Option<&Bench>) -> Calibrated {
    let arm_m = request.arm_m;
    let problem = |voltage_slope| fit::Problem {
        grids,
        places: Some(places),
        class: *class,
        voltage_slope,
        bench: None,
    };
    let mut fitted = fit::fit(&problem(class::VOLTAGE_SLOPE), arm_m);
    let mut voltage_slope = class::VOLTAGE_SLOPE;
    if grids.iter().all(|grid| grid.voltage.is_some()) {
        (voltage_slope, ..) = slow::voltage_slope(grids, &fitted.curve);
        fitted = fit::fit(&problem(voltage_slope), arm_m);
    }
    let excited = Excitation::of(grids).lift;
    let about = bench
        .and_then(|bench| bench::consult(bench, &fitted, (class, request.mass_kg), excited, &mut Vec::new()))
        .and_then(|about| about.prior());
    if about.is_some() {
        let with = fit::Problem {
            bench: about,
            ..problem(voltage_slope)
        };
        fitted = fit::fit(&with, arm_m);
    } else {
        (fitted, _) = fit::with_a_possible_slope(&problem(voltage_slope), arm_m, fitted);
    }
    // What no vehicle has, or slow outputs cannot tell, is not written, so it is not judged either: the class's value is
    // in its place.
    let slow_outputs = grids.iter().any(|grid| grid.slow_outputs.is_some());
    let of_class = fit::class_gain(class, arm_m);
    let gain = [0, 1].map(|axis| {
        if !slow_outputs && has_possible_gyration(fitted.gain[axis], arm_m) {
            fitted.gain[axis]
        } else {
            of_class[axis]
        }
    });
    let yaw = yaw::fit(grids, places, &fitted);
    let (yaw_gain, reaction_s) = yaw
        .filter(|yaw| has_possible_moment(yaw.gain, gain, arm_m))
        .map_or((default_yaw(class, arm_m), 0.0), |yaw| {
            (yaw.gain, if slow_outputs { 0.0 } else { yaw.reaction.value_s() })
        });
    let (lag_s, delay_s) = if slow_outputs {
        (class.lag_s, class.delay_s)
    } else {
        (fitted.lag_s, fitted.delay_s)
    };
    let model = Model {
        curve: fitted.curve,
        lag_s,
        delay_s,
        gain,
        yaw_gain,
        reaction_s,
        // Of several flights each would have its own.
        fall: match grids {
            [only] => slow::fall(only, &fitted.curve),
            _ => None,
        },
    };
    Calibrated { model, fitted, yaw }
}

/// c m/Jz by class.
pub(crate) fn default_yaw(class: &Class, arm_m: f64) -> f64 {
    let inertia: f64 = class.inertia_ratio.iter().sum::<f64>() * class::YAW_INERTIA_SHARE * arm_m * arm_m;
    class.moment_ratio_m / inertia
}

fn default_model(grids: &[Grid], class: &Class, arm_m: f64) -> Model {
    let (hover_duty, voltage) = fit::hover_point(grids);
    let mut curve = Curve::with_slope(hover_duty, 1.0, class.slope);
    if voltage.is_finite() {
        curve.voltage = voltage;
        curve.voltage_slope = class::VOLTAGE_SLOPE;
    }
    curve.hover = fit::hover_level(grids, curve);
    Model {
        curve,
        lag_s: class.lag_s,
        delay_s: class.delay_s,
        gain: fit::class_gain(class, arm_m),
        yaw_gain: default_yaw(class, arm_m),
        reaction_s: 0.0,
        fall: None,
    }
}

fn score(grid: &Grid, places: &[Place], model: &Model, channels: &[(&'static str, Band); 5], sums: &mut [Sum; 5]) {
    let step = grid.step_s;
    for part in &grid.airborne {
        let mut series = Series::new(grid, part, Some(places), &model.curve, model.lag_s, model.delay_s);
        if let Some(fall) = &model.fall {
            for (lift, row) in series.lift.iter_mut().zip(part.clone()) {
                *lift *= fall.factor(grid, row);
            }
        }
        if let Some(lift) = grid.lift() {
            for channel in 0..2 {
                let band = channels[channel].1;
                sums[channel].add(
                    &band.pass(&lift[part.clone()], step),
                    &band.pass(&series.lift, step),
                    band.settling(step).min(part.len() / 4),
                );
            }
        }
        let Some(rates) = &grid.rates else { continue };
        // Yaw torque at the rows, for the rotors' acceleration.
        let mut fast = vec![0.0; part.len()];
        if model.reaction_s != 0.0 {
            for (rotor, place) in places.iter().enumerate() {
                let thrust = lagged(grid, part, rotor, &model.curve, model.lag_s, model.delay_s);
                let slope = derivative(&thrust.mean, step);
                for (sum, slope) in fast.iter_mut().zip(slope) {
                    *sum += place.yaw_sign() * slope;
                }
            }
        }
        for axis in 0..3 {
            let band = channels[2 + axis].1;
            let rate = &rates[axis][part.clone()];
            let mut acceleration: Vec<f64> = rate.windows(2).map(|pair| (pair[1] - pair[0]) / step).collect();
            acceleration.push(acceleration.last().copied().unwrap_or(0.0));
            let predicted: Vec<f64> = (0..part.len())
                .map(|k| match axis {
                    2 => model.yaw_gain * (series.torque[2][k] + model.reaction_s * fast[k]),
                    _ => model.gain[axis] * series.torque[axis][k],
                })
                .collect();
            sums[2 + axis].add(
                &band.pass(&acceleration, step),
                &band.pass(&predicted, step),
                band.settling(step).min(part.len() / 4),
            );
        }
    }
}
