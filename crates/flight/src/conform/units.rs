//! Does a controller with these gains fly, and if not, in which unit would it?
//!
//! The linearised vehicle around hover: ṗ = v, v̇ = (−gθ, gφ, −a_up), η̇ = ω, ω̇ = α, with (a_up, α) following G·(p, v, η, ω) with the lag
//! of the rotors and the delay of the controller. G is measured. It contains gains only: no integrators, no limits, no noise.

use super::response::{Airframe, MOTION, PITCH, ROLL, UP};
use super::{Fault, Suspicion};
use std::collections::VecDeque;

/// Accelerations per unit of each motion value.
pub(super) type Gains = [[f64; MOTION]; 4];

const STEP_S: f64 = 1.0 / 400.0;
/// Initial offsets that it must recover from, m and rad.
const OFFSET_M: f64 = 0.3;
const OFFSET_RAD: f64 = 0.1;
/// Time limit, s, and the fraction of the offset to reach.
const TIME_S: f64 = 10.0;
const LEFT: f64 = 0.35;

/// Degrees in a radian.
const DEG: f64 = 180.0 / std::f64::consts::PI;

/// Σ over offsets of ∫ (|p|/0.3 m)² + (|η|/0.1 rad)² dt, s; `None` if it does not recover from one of them.
pub(super) fn cost(airframe: &Airframe, gains: &Gains, delay_steps: usize) -> Option<f64> {
    (0..6).try_fold(0.0, |sum, which| {
        let start = if which < 3 { which } else { which + 3 };
        one_cost(airframe, gains, delay_steps, start).map(|cost| sum + cost)
    })
}

fn one_cost(airframe: &Airframe, gains: &Gains, delay_steps: usize, start: usize) -> Option<f64> {
    let share = if airframe.lag_s > 0.0 {
        1.0 - (-STEP_S / airframe.lag_s).exp()
    } else {
        1.0
    };
    let mut x = [0.0; MOTION];
    x[start] = if start < 3 { OFFSET_M } else { OFFSET_RAD };
    let mut held = [0.0; 4];
    let mut queue = VecDeque::from(vec![[0.0; 4]; delay_steps]);
    let (mut cost, mut late) = (0.0, 0.0_f64);
    let steps = (TIME_S / STEP_S) as usize;
    for step in 0..steps {
        queue.push_back(gains.map(|row| row.iter().zip(&x).map(|(gain, x)| gain * x).sum::<f64>()));
        let command = queue.pop_front()?;
        for axis in 0..4 {
            held[axis] += share * (command[axis] - held[axis]);
        }
        let g = airframe.gravity;
        let acceleration = [-g * x[7], g * x[6], -held[UP]];
        for i in 0..3 {
            x[3 + i] += STEP_S * acceleration[i];
            x[i] += STEP_S * x[3 + i];
            x[9 + i] += STEP_S * held[ROLL + i];
            x[6 + i] += STEP_S * x[9 + i];
        }
        let size = (0..3)
            .map(|i| (x[i] / OFFSET_M).powi(2) + (x[6 + i] / OFFSET_RAD).powi(2))
            .sum::<f64>();
        if size.is_nan() || size > 1e4 {
            return None;
        }
        cost += STEP_S * size;
        if step + 400 >= steps {
            late = late.max(size);
        }
    }
    (late.sqrt() < LEFT).then_some(cost)
}

/// A change of units or fields that a controller may have made by mistake.
struct Candidate {
    fault: Fault,
    fields: &'static str,
    inputs: &'static [usize],
    /// Factor on those columns that undoes it.
    repair: f64,
    words: &'static str,
}

const POSITION: &[usize] = &[0, 1, 2];
const VELOCITY: &[usize] = &[3, 4, 5];
const BOTH: &[usize] = &[0, 1, 2, 3, 4, 5];
const ATTITUDE: &[usize] = &[6, 7, 8];
const RATES: &[usize] = &[9, 10, 11];
const ANGULAR: &[usize] = &[6, 7, 8, 9, 10, 11];

/// Too weak by a factor: it reads a value in the large unit as one in the small unit. Too strong: it converts, but its gains expect the
/// original.
fn candidates() -> Vec<Candidate> {
    let angles: [(&str, &[usize]); 5] = [
        ("attitude_rad", ATTITUDE),
        ("body_rates_rad_s", RATES),
        ("attitude_rad and body_rates_rad_s", ANGULAR),
        ("attitude_rad.yaw", &[8]),
        ("body_rates_rad_s.r", &[11]),
    ];
    let lengths: [(&str, &[usize]); 4] = [
        ("position_ned_m", POSITION),
        ("velocity_ned_m_s", VELOCITY),
        ("position_ned_m and velocity_ned_m_s", BOTH),
        ("position_ned_m.down", &[2]),
    ];
    let mut all = Vec::new();
    let mut add = |fields, inputs, repair, words| {
        all.push(Candidate {
            fault: Fault::Unit,
            fields,
            inputs,
            repair,
            words,
        });
    };
    for (fields, inputs) in angles {
        add(
            fields,
            inputs,
            DEG,
            "radians are taken for degrees: its answer is 57.3 times too weak",
        );
        add(
            fields,
            inputs,
            1.0 / DEG,
            "it computes in degrees, but its gains require radians: its answer is 57.3 times too strong",
        );
    }
    for (fields, inputs) in lengths {
        add(
            fields,
            inputs,
            100.0,
            "metres are taken for centimetres: its answer is 100 times too weak",
        );
        add(
            fields,
            inputs,
            0.01,
            "it computes in centimetres, but its gains require metres: its answer is 100 times too strong",
        );
        add(
            fields,
            inputs,
            1000.0,
            "metres are taken for millimetres: its answer is 1000 times too weak",
        );
        add(
            fields,
            inputs,
            0.001,
            "it computes in millimetres, but its gains require metres: its answer is 1000 times too strong",
        );
    }
    all
}

/// The change of units or fields that best explains gains that do not fly.
pub(super) fn suspect(airframe: &Airframe, gains: &Gains, delay_steps: usize) -> Option<Suspicion> {
    let mut found: Vec<(f64, Fault, String, String)> = Vec::new();
    for candidate in candidates() {
        let mut repaired = *gains;
        for row in &mut repaired {
            for &input in candidate.inputs {
                row[input] *= candidate.repair;
            }
        }
        if let Some(cost) = cost(airframe, &repaired, delay_steps) {
            found.push((
                cost,
                candidate.fault,
                candidate.fields.to_owned(),
                candidate.words.to_owned(),
            ));
        }
    }
    for (fields, first, second) in [
        ("attitude_rad and body_rates_rad_s", ATTITUDE, RATES),
        ("position_ned_m and velocity_ned_m_s", POSITION, VELOCITY),
    ] {
        let mut repaired = *gains;
        for row in &mut repaired {
            for (&a, &b) in first.iter().zip(second) {
                row.swap(a, b);
            }
        }
        if let Some(cost) = cost(airframe, &repaired, delay_steps) {
            let words = "each is read in place of the other".to_owned();
            found.push((cost, Fault::Field, fields.to_owned(), words));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (best, fault, field, words) = found.first()?.clone();
    let others = found
        .iter()
        .skip(1)
        .take_while(|other| other.0 < 1.05 * best)
        .map(|other| format!("{}: {}", other.2, other.3))
        .collect();
    Some(Suspicion {
        fault,
        field,
        sentence: words,
        evidence: format!(
            "with the gains as measured {}; with this undone the same gains bring it back from 0.3 m and 6° in {TIME_S:.0} s",
            stiffness(gains)
        ),
        others,
    })
}

/// Measured pitch gains as natural frequency and damping, human-readable.
fn stiffness(gains: &Gains) -> String {
    let (k, d) = (-gains[PITCH][7], -gains[PITCH][10]);
    if k > 0.0 && d > 0.0 {
        format!(
            "pitch would swing at {:.2} rad/s with a damping of {:.2}, and the vehicle does not come back",
            k.sqrt(),
            d / (2.0 * k.sqrt())
        )
    } else {
        "the vehicle does not come back".to_owned()
    }
}
