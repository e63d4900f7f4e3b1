//! Open-loop prediction: from the measured state at some instant the model flies on alone, with the logged commands and voltage,
//! and is compared with the measurement 0.1, 0.5, 1 and 5 s later.
//!
//! The rigid body is integrated with the log's step (semi-implicit Euler, the thrust of each step as its mean); wind, rotor thrust
//! and wrench effects see the predicted motion. The lag of the rotors runs along the whole log, so that the thrust at the start is
//! that of the model and not a guess. Initial states are smoothed measurements (0.15 s): their noise alone gives an error that
//! grows with the horizon, which the row of the best model shows.
//!
//! Limits: effects on the static lift that depend on the motion see the measured motion; a divergent prediction is cut at 1000 m/s.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::Vector3;
use rotortwin_plant::effects::{Constants, EffectSet, Hooks, Moment};
use serde::Serialize;
use utoipa::ToSchema;

use crate::predict::Source;
use crate::predict::vectors::{cross, inverted, rotation, times, to_body};
use crate::predict::{Drive, Nuisances, PredictError, Predictor};

/// Horizons, s.
pub const HORIZONS_S: [f64; 4] = [0.1, 0.5, 1.0, 5.0];
/// Time between two starts, s.
const START_EVERY_S: f64 = 1.0;
/// Speed at which a prediction is given up, m/s.
const DIVERGED_M_S: f64 = 1e3;

/// Error after one horizon, root mean square over all starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct OpenLoopError {
    /// s.
    pub horizon_s: f64,
    /// Starts.
    pub starts: usize,
    /// m.
    #[schema(value_type = Option<f64>)]
    pub position_m: f64,
    /// m/s.
    #[schema(value_type = Option<f64>)]
    pub velocity_m_s: f64,
    /// Angle between predicted and measured attitude, rad.
    #[schema(value_type = Option<f64>)]
    pub attitude_rad: f64,
}

#[derive(Clone, Copy)]
struct State {
    position: Vector3,
    velocity: Vector3,
    attitude: [Vector3; 3],
    rates: Vector3,
}

/// Open-loop errors of the predictor's model; empty where the log lacks what a start needs.
///
/// # Errors
/// The model's effects together yield an invalid vehicle.
pub fn errors(predictor: &Predictor, nuisances: &Nuisances) -> Result<Vec<OpenLoopError>, PredictError> {
    let series = predictor.series();
    let have = series.available;
    if !(have.velocity && have.attitude && have.rates) || series.drive == Drive::None {
        return Ok(Vec::new());
    }
    let mut set = predictor.effect_set(nuisances, &[])?;
    let prediction = predictor.predict(&set, Source::Smooth, None);
    let weight = predictor.nominal.mass_kg * predictor.nominal.gravity_m_s2;
    let flying = series.flying(&prediction.thrust, weight);
    let every = ((START_EVERY_S / series.step_s).round() as usize).max(1);
    let steps = HORIZONS_S.map(|horizon| (horizon / series.step_s).round() as usize);
    let mut sums = [[0.0; 3]; HORIZONS_S.len()];
    let mut counts = [0_usize; HORIZONS_S.len()];
    let advancing = set.hooks().uses(Hooks::ADVANCE);
    for k in 0..series.len {
        set.begin(series.time(k));
        if k % every == 0 && flying[k] {
            let last = (k..series.len).take_while(|&j| flying[j]).last().unwrap_or(k);
            let mut state = State {
                position: series.smooth.position.get(k).copied().unwrap_or([0.0; 3]),
                velocity: series.smooth.velocity[k],
                attitude: rotation(series.smooth.attitude[k]),
                rates: series.smooth.rates[k],
            };
            let mut own = set.clone();
            let mut next = 0;
            for j in k..k + steps[HORIZONS_S.len() - 1] {
                if j >= last {
                    break;
                }
                state = flown(&mut own, predictor, &prediction.thrust, j, state);
                if !(state.velocity.iter().all(|v| v.abs() < DIVERGED_M_S)) {
                    state.velocity = state.velocity.map(|v| {
                        if v.is_finite() {
                            v.clamp(-DIVERGED_M_S, DIVERGED_M_S)
                        } else {
                            DIVERGED_M_S
                        }
                    });
                }
                if j + 1 - k == steps[next] {
                    let at = j + 1;
                    let smooth = &series.smooth;
                    let square = |a: Vector3, b: Vector3| (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum::<f64>();
                    if have.position {
                        sums[next][0] += square(state.position, smooth.position[at]);
                    }
                    sums[next][1] += square(state.velocity, smooth.velocity[at]);
                    sums[next][2] += angle_between(&state.attitude, &rotation(smooth.attitude[at])).powi(2);
                    counts[next] += 1;
                    next += 1;
                    if next == steps.len() {
                        break;
                    }
                }
            }
        }
        if advancing {
            let c = *set.constants();
            let state = State {
                position: series.smooth.position.get(k).copied().unwrap_or([0.0; 3]),
                velocity: series.smooth.velocity[k],
                attitude: rotation(series.smooth.attitude[k]),
                rates: series.smooth.rates[k],
            };
            let accel = series.smooth.accel.get(k).copied().unwrap_or([0.0; 3]);
            let spin_up = series.smooth.angular_acceleration[k];
            with_moment(predictor, &c, &prediction.thrust, k, &state, accel, spin_up, |at| {
                set.advance(at, series.step_s)
            });
        }
    }
    let root = |sum: f64, count: usize| {
        if count == 0 {
            f64::NAN
        } else {
            (sum / count as f64).sqrt()
        }
    };
    Ok(HORIZONS_S
        .iter()
        .zip(sums)
        .zip(counts)
        .filter(|(_, count)| *count > 0)
        .map(|((&horizon_s, sum), starts)| OpenLoopError {
            horizon_s,
            starts,
            position_m: if have.position { root(sum[0], starts) } else { f64::NAN },
            velocity_m_s: root(sum[1], starts),
            attitude_rad: root(sum[2], starts),
        })
        .collect())
}

#[expect(clippy::too_many_arguments, reason = "a moment is a long row of columns")]
fn with_moment<T>(
    predictor: &Predictor,
    constants: &Constants,
    thrust: &[f64],
    k: usize,
    state: &State,
    specific_force: Vector3,
    angular_acceleration: Vector3,
    act: impl FnOnce(&Moment<'_>) -> T,
) -> T {
    let series = predictor.series();
    let n = series.rotors;
    let (mut mean, mut ratio, mut rate) = ([0.0; MAX_ROTORS], [0.0; MAX_ROTORS], [0.0; MAX_ROTORS]);
    let after = (k + 1).min(series.len - 1);
    for i in 0..n {
        let (f, g) = (thrust[k * n + i], thrust[after * n + i]);
        mean[i] = 0.5 * (f + g);
        let speed = |f: f64| (f.max(0.0) / constants.hover_thrust_n).sqrt();
        ratio[i] = 0.5 * (speed(f) + speed(g));
        rate[i] = (speed(g) - speed(f)) / series.step_s;
    }
    let wind = constants.wind_ned_m_s;
    let relative = [0, 1, 2].map(|i| state.velocity[i] - wind[i]);
    act(&Moment {
        time_s: series.time(k),
        step_s: series.step_s,
        position_ned: state.position,
        velocity_ned: state.velocity,
        air_velocity_body: to_body(&state.attitude, relative),
        body_rates: state.rates,
        angular_acceleration,
        specific_force,
        ned_from_body: state.attitude,
        height_above_ground: series.height[k],
        rotor_thrust: &mean[..n],
        rotor_speed_ratio: &ratio[..n],
        rotor_speed_rate: &rate[..n],
        duty: &series.input[k * n..(k + 1) * n],
        battery_voltage: series.voltage.get(k).copied().unwrap_or(0.0),
        battery_current: 0.0,
        constants,
    })
}

/// The state one step later.
fn flown(set: &mut EffectSet, predictor: &Predictor, thrust: &[f64], k: usize, state: State) -> State {
    let series = predictor.series();
    let (n, step) = (series.rotors, series.step_s);
    set.begin(series.time(k));
    let c = *set.constants();
    let accel = series.smooth.accel.get(k).copied().unwrap_or([0.0; 3]);
    let spin_up = series.smooth.angular_acceleration[k];
    let wrench = with_moment(predictor, &c, thrust, k, &state, accel, spin_up, |at| {
        let mut at = *at;
        let mut wind = c.wind_ned_m_s;
        set.wind(&at, &mut wind);
        at.air_velocity_body = to_body(&at.ned_from_body, [0, 1, 2].map(|i| at.velocity_ned[i] - wind[i]));
        let mut f = [0.0; MAX_ROTORS];
        f[..n].copy_from_slice(at.rotor_thrust);
        set.rotor_thrust(&at, &mut f[..n]);
        let mut wrench = c.rotor_wrench(&f[..n]);
        set.wrench(&at, &mut wrench);
        set.advance(&at, step);
        c.closed(&wrench, at.air_velocity_body, at.body_rates)
    });
    let momentum = times(&c.inertia_body_kg_m2, state.rates);
    let gyroscopic = cross(state.rates, momentum);
    let net = [0, 1, 2].map(|i| wrench.torque_body[i] - gyroscopic[i]);
    let spin_up = times(&inverted(&c.inertia_body_kg_m2), net);
    let specific = wrench.force_body.map(|force| force / c.mass_kg);
    let mut acceleration = times(&state.attitude, specific);
    acceleration[2] += c.gravity_m_s2;
    let rates = [0, 1, 2].map(|i| state.rates[i] + step * spin_up[i]);
    let middle = [0, 1, 2].map(|i| 0.5 * (state.rates[i] + rates[i]));
    let velocity = [0, 1, 2].map(|i| state.velocity[i] + step * acceleration[i]);
    State {
        position: [0, 1, 2].map(|i| state.position[i] + 0.5 * step * (state.velocity[i] + velocity[i])),
        velocity,
        attitude: turned(&state.attitude, middle, step),
        rates,
    }
}

/// R exp([ω h]×), by Rodrigues' formula.
fn turned(r: &[Vector3; 3], omega: Vector3, step: f64) -> [Vector3; 3] {
    let angle = omega.map(|w| w * step);
    let size = (angle[0] * angle[0] + angle[1] * angle[1] + angle[2] * angle[2]).sqrt();
    let (a, b) = if size < 1e-9 {
        (1.0, 0.5)
    } else {
        (libm::sin(size) / size, (1.0 - libm::cos(size)) / (size * size))
    };
    let [x, y, z] = angle;
    let e = [
        [1.0 - b * (y * y + z * z), -a * z + b * x * y, a * y + b * x * z],
        [a * z + b * x * y, 1.0 - b * (x * x + z * z), -a * x + b * y * z],
        [-a * y + b * x * z, a * x + b * y * z, 1.0 - b * (x * x + y * y)],
    ];
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|m| r[i][m] * e[m][j]).sum()))
}

/// Angle of the rotation from one attitude to the other, rad.
fn angle_between(a: &[Vector3; 3], b: &[Vector3; 3]) -> f64 {
    let trace: f64 = (0..3).map(|i| (0..3).map(|j| a[i][j] * b[i][j]).sum::<f64>()).sum();
    libm::acos((0.5 * (trace - 1.0)).clamp(-1.0, 1.0))
}
