//! How evenly the rotors carried the vehicle: where the resultant of their thrusts acted, by the one curve that all of them have.

use super::curve::Curve;
use super::frames::Place;
use super::grid::Grid;

/// Shortest time in the air that shows it, s.
const SHORTEST_S: f64 = 10.0;

/// Distance of the resultant from the middle of the rotors, forward and to the right, in units of the arm: root mean square over the
/// flights. The mean torque about the centre of mass is that of the mean angular acceleration, none, so that the resultant acts there, or
/// rotors are unequal.
///
/// c = Σ T_i p_i / Σ T_i with mean thrusts T_i at positions p_i
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Balance {
    pub(crate) centre: [f64; 2],
}

impl Balance {
    /// Of all flights; `None` if one of them is too short.
    pub(crate) fn of(grids: &[Grid], places: &[Place], curve: &Curve) -> Option<Self> {
        let centres = grids
            .iter()
            .map(|grid| centre(grid, places, curve))
            .collect::<Option<Vec<_>>>()?;
        let flights = centres.len() as f64;
        (!centres.is_empty()).then(|| Self {
            centre: [0, 1].map(|axis| {
                let squares = centres.iter().map(|centre| centre[axis] * centre[axis]);
                (squares.sum::<f64>() / flights).sqrt()
            }),
        })
    }

    /// The weakness of a single rotor that would look like it, over its thrust.
    pub(crate) fn of_one_rotor(&self, rotors: usize) -> f64 {
        rotors as f64 * self.centre[0].hypot(self.centre[1])
    }
}

fn centre(grid: &Grid, places: &[Place], curve: &Curve) -> Option<[f64; 2]> {
    let (mut sums, mut total, mut rows) = ([0.0; 2], 0.0, 0_usize);
    for row in grid.airborne.iter().flat_map(Clone::clone) {
        let thrusts: Vec<f64> = grid.duty.iter().map(|duty| curve.shape(duty[row])).collect();
        let all: f64 = thrusts.iter().sum();
        if !all.is_finite() {
            continue;
        }
        for (thrust, place) in thrusts.iter().zip(places) {
            sums[0] += thrust * place.position[0];
            sums[1] += thrust * place.position[1];
        }
        total += all;
        rows += 1;
    }
    (rows as f64 * grid.step_s >= SHORTEST_S && total > 0.0).then(|| sums.map(|sum| sum / total))
}
