//! Which channels a flight excites: where the vehicle moves by less than the noise of one reading, the controller's
//! response to that noise is mistaken for torque or thrust, however many rows there are.
//!
//! In a hover of our own controller the 0.1 s means of the rates have 0.2 to 0.9 of the gyro's noise; c/Jz then came out twice too large and
//! n = d ln thrust/d ln duty a quarter too small, each with an interval of a few per cent; on a helix with 1.2 in yaw and 0.95 in the vertical
//! force both were off by a tenth, on waypoints with 2.4 in yaw within 1 %. Flights of real vehicles have 10 and more in the
//! rates and 1.7 and more in the vertical specific force, which vibration makes noisy.

use super::grid::{Grid, mean_deviation};

/// Motion over noise from which a channel counts.
const EXCITED: f64 = 2.0;
/// Length of the means that separate motion from noise, s.
const MEAN_S: f64 = 0.1;
/// Median of the absolute value of a normal variable over its deviation.
const MEDIAN_OF_NORMAL: f64 = 0.6745;

/// What a flight excites: where it is false, a value is known no better than from its class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Excitation {
    /// Vertical specific force.
    pub(crate) lift: bool,
    /// Roll, pitch, yaw.
    pub(crate) rate: [bool; 3],
}

impl Excitation {
    /// Of all flights together; what is not logged counts as not excited.
    pub(crate) fn of(grids: &[Grid]) -> Self {
        let excites = |series: &dyn Fn(&Grid) -> Option<&[f64]>| motion_over_noise(grids, series) >= EXCITED;
        Self {
            lift: excites(&|grid| grid.accel[2].as_deref()),
            rate: [0, 1, 2].map(|axis| excites(&|grid| grid.rates.as_ref().map(|rates| rates[axis].as_slice()))),
        }
    }

    /// What it leaves to the class, for people.
    pub(crate) fn note(self) -> Option<String> {
        let named = [
            (self.lift, "thrust slope (vertical force)"),
            (self.rate[0], "roll inertia"),
            (self.rate[1], "pitch inertia"),
            (self.rate[2], "torque over thrust (yaw)"),
        ];
        let left: Vec<&str> = named
            .into_iter()
            .filter_map(|(told, name)| (!told).then_some(name))
            .collect();
        (!left.is_empty()).then(|| {
            format!(
                "the flight hardly moves beyond the noise of its sensors, so the controller's response to noise cannot be separated from the vehicle; \
                 known no better than by the class: {}",
                left.join(", ")
            )
        })
    }
}

/// Deviation of 0.1 s means in the air over that of the white noise of a reading; 0 where nothing was measured, infinite without noise.
fn motion_over_noise(grids: &[Grid], series: &dyn Fn(&Grid) -> Option<&[f64]>) -> f64 {
    let (mut means, mut thirds) = (Vec::new(), Vec::new());
    for grid in grids {
        let Some(values) = series(grid) else { return 0.0 };
        let rows = grid.rows_of(MEAN_S).max(1);
        for part in &grid.airborne {
            let values = &values[part.clone()];
            means.extend(
                values
                    .chunks_exact(rows)
                    .map(|all| all.iter().sum::<f64>() / rows as f64),
            );
            // Third differences leave the noise of smooth signals: variance 20 σ².
            thirds.extend(values.windows(4).map(|x| (x[3] - 3.0 * x[2] + 3.0 * x[1] - x[0]).abs()));
        }
    }
    means.retain(|x| x.is_finite());
    thirds.retain(|x| x.is_finite());
    if means.is_empty() || thirds.is_empty() {
        return 0.0;
    }
    let middle = thirds.len() / 2;
    let noise = *thirds.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN_OF_NORMAL / 20.0_f64.sqrt();
    mean_deviation(means.into_iter()).1 / noise
}
