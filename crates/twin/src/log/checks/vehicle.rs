//! Does the log belong to the vehicle file: number and order of the rotors.
//!
//! The torque that the duties make under the vehicle's geometry must turn the vehicle as its gyroscope says ([`TurnChanges`]).
//! Every order of the rotors is tried (transpositions only, above eight rotors); another order that fits clearly better than the
//! file's is a finding.

use super::turns::TurnChanges;
use crate::log::findings::{Finding, FindingKind};
use crate::log::{FlightLog, SensorRate, rotor_order};
use rotortwin_plant::vehicle::model::VehicleModel;

/// Fewer windows say nothing.
const FEWEST_WINDOWS: usize = 60;
/// Every order is tried up to this many rotors (8! = 40 320).
const MOST_ROTORS: usize = 8;
/// Mean squared correlation from which an order is accepted, if the file's order has clearly less: by this much in a
/// short log, by less in one with many windows, as chance decreases with their square root.
const BELIEVED: f64 = 0.25;
const CLEARLY: f64 = 0.2;
const CLEARLY_AT_LEAST: f64 = 0.06;
const WINDOWS_OF_CLEARLY: f64 = 100.0;

/// Sums over all windows: duties with duties, duties with angular acceleration.
struct Moments {
    duty_duty: Vec<Vec<f64>>,
    duty_turn: Vec<[f64; 3]>,
    turn_turn: [f64; 3],
    windows: usize,
}

impl FlightLog {
    /// Evidence against this log being of this vehicle; empty if there is none.
    ///
    /// * `vehicle`: a vehicle document, not yet flown with
    pub fn check_against_vehicle(&self, vehicle: &VehicleModel) -> Vec<Finding> {
        let rotors = self.rotor_count();
        let expected = vehicle.rotor_count();
        if rotors == 0 {
            return Vec::new();
        }
        if rotors != expected {
            let detail = format!(
                "the log has {rotors} rotors, the vehicle '{}' has {expected}",
                vehicle.name
            );
            let kind = FindingKind::RotorCount;
            return vec![Finding { kind, detail }];
        }
        // What is pushed about on the ground turns by other hands than its rotors'.
        if self.flight_parts(None).no_flight().is_some() {
            return Vec::new();
        }
        // Commands at a low rate have no phase relation with the motion that they damp: some correct logs fit another
        // order better.
        let rate = self.duty_rate().filter(SensorRate::is_slower);
        if rate.is_some_and(|rate| rate.source_hz < LEAST_TO_CONTRADICT_HZ) {
            return Vec::new();
        }
        let arms = vehicle.rotors.layout.torque_arms();
        let Some(moments) = self
            .turn_changes(vehicle.rotors.thrust_lag_s)
            .and_then(|changes| Moments::of(&changes, rotors))
        else {
            return Vec::new();
        };
        let order: Vec<usize> = (0..rotors).collect();
        let as_is = moments.score(&arms, &order);
        let (best, best_score) = moments.best(&arms, order);
        if best_score < BELIEVED || best_score - as_is < moments.clearly() {
            return Vec::new();
        }
        // Columns by rotor, as a reader states them.
        let own: Vec<usize> = (0..rotors).collect();
        let columns: Vec<usize> = own
            .iter()
            .filter_map(|rotor| best.iter().position(|to| to == rotor))
            .collect();
        let moved: Vec<String> = best
            .iter()
            .enumerate()
            .filter(|(column, rotor)| column != *rotor)
            .map(|(column, rotor)| format!("duty_{} drives rotor {}", column + 1, rotor + 1))
            .collect();
        vec![Finding {
            kind: FindingKind::SwappedMotors,
            detail: format!(
                "the vehicle turns as if {} (correlation² {best_score:.2}, in the file's order {as_is:.2}); `@{}` behind the log's name reads it \
                 in that order, `@{}` as it is",
                moved.join(", "),
                rotor_order::stated(&columns),
                rotor_order::stated(&own)
            ),
        }]
    }
}

/// Motor outputs that come more slowly than this contradict no order of the motors. ArduPilot writes 10 Hz.
pub(crate) const LEAST_TO_CONTRADICT_HZ: f64 = 9.0;

/// Power of a torque over that of duties that have nothing to do with each other, below which it is rounding: single precision leaves 1e-14.
const LEAST_POWER: f64 = 1e-9;

impl Moments {
    /// `None`: too few windows.
    fn of(changes: &TurnChanges, rotors: usize) -> Option<Self> {
        let windows = changes.turn.len();
        let mut moments = Self {
            duty_duty: vec![vec![0.0; rotors]; rotors],
            duty_turn: vec![[0.0; 3]; rotors],
            turn_turn: [0.0; 3],
            windows,
        };
        for (duty, turn) in changes.duty.iter().zip(&changes.turn) {
            for i in 0..rotors {
                for j in 0..rotors {
                    moments.duty_duty[i][j] += duty[i] * duty[j];
                }
                for axis in 0..3 {
                    moments.duty_turn[i][axis] += duty[i] * turn[axis];
                }
            }
            for axis in 0..3 {
                moments.turn_turn[axis] += turn[axis] * turn[axis];
            }
        }
        (windows >= FEWEST_WINDOWS).then_some(moments)
    }

    /// By how much another order must fit better.
    fn clearly(&self) -> f64 {
        (CLEARLY * (WINDOWS_OF_CLEARLY / self.windows as f64).sqrt()).clamp(CLEARLY_AT_LEAST, CLEARLY)
    }

    /// Mean over the axes of the signed squared correlation; `order[column]` is the rotor that the column drives.
    fn score(&self, arms: &[[f64; 3]], order: &[usize]) -> f64 {
        let mut sum = 0.0;
        for axis in 0..3 {
            let (mut cross, mut power, mut unrelated) = (0.0, 0.0, 0.0);
            for (i, rotor) in order.iter().enumerate() {
                let arm = arms[*rotor][axis];
                cross += arm * self.duty_turn[i][axis];
                unrelated += arm * arm * self.duty_duty[i][i];
                for (j, other) in order.iter().enumerate() {
                    power += arm * arms[*other][axis] * self.duty_duty[i][j];
                }
            }
            let scale = power * self.turn_turn[axis];
            // An exact allocation leaves the duties of six rotors in a space of four dimensions: in another order they
            // may produce no torque at all, and only rounding remains.
            if scale > 0.0 && power > LEAST_POWER * unrelated {
                sum += (cross * cross.abs() / scale).clamp(-1.0, 1.0);
            }
        }
        sum / 3.0
    }

    /// The order that fits best, and how well.
    fn best(&self, arms: &[[f64; 3]], order: Vec<usize>) -> (Vec<usize>, f64) {
        let mut best = (order.clone(), self.score(arms, &order));
        let mut consider = |order: &[usize]| {
            let score = self.score(arms, order);
            if score > best.1 {
                best = (order.to_vec(), score);
            }
        };
        if order.len() <= MOST_ROTORS {
            permutations(order, &mut consider);
        } else {
            for i in 0..order.len() {
                for j in 0..i {
                    let mut swapped = order.clone();
                    swapped.swap(i, j);
                    consider(&swapped);
                }
            }
        }
        best
    }
}

/// Heap's algorithm.
fn permutations(mut order: Vec<usize>, visit: &mut impl FnMut(&[usize])) {
    let mut counters = vec![0; order.len()];
    visit(&order);
    let mut index = 1;
    while index < order.len() {
        if counters[index] < index {
            let other = if index % 2 == 0 { 0 } else { counters[index] };
            order.swap(other, index);
            visit(&order);
            counters[index] += 1;
            index = 1;
        } else {
            counters[index] = 0;
            index += 1;
        }
    }
}
