//! Two duties that are exchanged: the vehicle turns better by the duties with two of them in each other's place.
//!
//! The import refuses an order of the rotors whose correlation with the motion is clearly smaller than another's. Two
//! neighbours in a calm flight differ by less than that, and a healthy vehicle is then judged healthy, and a loss is
//! named at the wrong rotor. So here each window is a witness. With the changes Δu and Δω from window to window of the
//! duties and of what they turn ([`TurnChanges`]),
//!
//! ```text
//!  e_a = Δω_a − b_a Σ_i F_a,order(i) Δu_i      b_a ≥ 0, least squares      l = −½ Σ_a (ln σ_a² + e_a²/σ_a²)     σ_a² = ⟨e_a²⟩
//!  z = Σ (l − l₀) / deviation of that sum      l₀: in the order of the log       (Vuong 1989; sums of five windows as samples)
//! ```
//! In 44 logs of the independent generator (hover, helix, waypoints; 400 to 50 Hz; wind, gusts, flapping blades, wrong
//! inertia) the largest z of an exchange was −2.2 in the right order, and 2.2 to 9.6 with two neighbours exchanged.
//!
//! Limits: one exchange, not any other permutation, which the import tries; at least [`LEAST_HZ`] duties, as slower ones
//! have no phase relation with the motion that they damp.

use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_twin::log::{FlightLog, RotorOrder, SensorRate, TurnChanges, stated_order};

/// Windows of a sample, and fewest samples.
const WINDOWS: usize = 5;
const FEWEST: usize = 20;
/// z and nats from which an exchange is certain.
const CERTAIN: f64 = 3.5;
const LEAST_NATS: f64 = 25.0;
/// Slowest duties that say something of their order, Hz.
const LEAST_HZ: f64 = 40.0;
const AXES: usize = 3;

/// Why a log is not judged: two duties are exchanged, one sentence.
pub(crate) fn refusal(log: &FlightLog, vehicle: &VehicleModel) -> Option<String> {
    let is_slow = |rate: SensorRate| rate.source_hz < LEAST_HZ;
    if log.report.rotor_order == RotorOrder::Stated || log.duty_rate().is_none_or(is_slow) {
        return None;
    }
    let changes = log.turn_changes(vehicle.rotors.thrust_lag_s)?;
    if changes.turn.len() < WINDOWS * FEWEST {
        return None;
    }
    let arms = vehicle.rotors.layout.torque_arms();
    let as_logged = likelihoods(&changes, &arms);
    let mut best: Option<([usize; 2], [f64; 2])> = None;
    for first in 0..arms.len() {
        for second in first + 1..arms.len() {
            let mut exchanged = arms.clone();
            exchanged.swap(first, second);
            let evidence = evidence(&likelihoods(&changes, &exchanged), &as_logged);
            if best.is_none_or(|(_, most)| evidence[0] > most[0]) {
                best = Some(([first, second], evidence));
            }
        }
    }
    let ([first, second], [z, nats]) = best?;
    (z > CERTAIN && nats > LEAST_NATS).then(|| {
        let own: Vec<usize> = (0..arms.len()).collect();
        let mut exchanged = own.clone();
        exchanged.swap(first, second);
        format!(
            "{}: the vehicle turns as if duty_{} and duty_{} were exchanged ({z:.1} standard deviations, {nats:.0} nats), and a loss would be named \
             at the wrong rotor; expected the duties in the order of the model's rotors: `@{}` behind the log's name reads it so, `@{}` as it is",
            log.name,
            first + 1,
            second + 1,
            stated_order(&exchanged),
            stated_order(&own)
        )
    })
}

/// Mean of the difference over its deviation, and the difference, nats.
fn evidence(exchanged: &[f64], as_logged: &[f64]) -> [f64; 2] {
    let differences: Vec<f64> = exchanged
        .iter()
        .zip(as_logged)
        .map(|(one, other)| one - other)
        .collect();
    let samples: Vec<f64> = differences
        .chunks_exact(WINDOWS)
        .map(|chunk| chunk.iter().sum())
        .collect();
    let sum: f64 = samples.iter().sum();
    let count = samples.len() as f64;
    let square: f64 = samples.iter().map(|sample| (sample - sum / count).powi(2)).sum();
    [sum / square.sqrt().max(f64::MIN_POSITIVE), sum]
}

/// Of each window, ln likelihood up to a constant.
///
/// * `arms`: of the rotor that each duty drives, per newton about each axis
fn likelihoods(changes: &TurnChanges, arms: &[[f64; AXES]]) -> Vec<f64> {
    let mut sums = vec![0.0; changes.turn.len()];
    for axis in 0..AXES {
        let torque = |duty: &Vec<f64>| duty.iter().zip(arms).map(|(duty, arm)| arm[axis] * duty).sum::<f64>();
        let torques: Vec<f64> = changes.duty.iter().map(torque).collect();
        let pairs = || {
            torques
                .iter()
                .zip(&changes.turn)
                .map(|(torque, turn)| (*torque, turn[axis]))
        };
        let power: f64 = pairs().map(|(torque, _)| torque * torque).sum();
        let cross: f64 = pairs().map(|(torque, turn)| torque * turn).sum();
        let gain = (cross / power.max(f64::MIN_POSITIVE)).max(0.0);
        let errors: Vec<f64> = pairs().map(|(torque, turn)| turn - gain * torque).collect();
        let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
        let square = square.max(f64::MIN_POSITIVE);
        for (sum, e) in sums.iter_mut().zip(&errors) {
            *sum -= 0.5 * (square.ln() + e * e / square);
        }
    }
    sums
}
