//! Noise of the readings, estimated from the log itself, and the covariance of each channel that follows.
//!
//! The m-th difference of a smooth signal with white noise of standard deviation σ has the standard deviation σ √(2m
//! over m); the median of its absolute values is robust against steps, and the smallest of several orders against
//! motion. A column that is held or interpolated from a slower stream has the noise of its source
//! ([`super::series::SlowNoise`]): its rows look smooth but contain no more information. There are lower bounds:
//! quantisation, and a white disturbance of 0.33 % of the weight and 0.12 % of weight times arm in every step, which
//! every real flight has.

use rotortwin_plant::Vector3;
use rotortwin_plant::effects::Constants;

use super::channels::{CHANNELS, F, KA, KP, KV, M, V};
use super::series::Series;
use super::whiten::Covariance;

/// White disturbance force of a step per weight: 0.05 N on 15.2 N.
const FORCE_FLOOR: f64 = 0.0033;
/// White disturbance torque of a step per weight and arm: 5 mN·m on 4.18 N·m.
const TORQUE_FLOOR: f64 = 0.0012;
/// d ln f/d ln u of an ordinary thrust curve: how an error of a duty that was not logged shows in the thrust.
const TYPICAL_EXPONENT: f64 = 1.4;
/// 1/Φ⁻¹(3/4): deviation of a normal variable per median of its absolute value.
pub(crate) const DEVIATION_PER_MEDIAN: f64 = 1.482_602_218_505_602;

/// Standard deviations of the readings.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, utoipa::ToSchema)]
pub struct NoiseModel {
    /// m.
    #[schema(value_type = Option<f64>)]
    pub position_m: f64,
    /// m/s.
    #[schema(value_type = Option<f64>)]
    pub velocity_m_s: f64,
    /// rad.
    #[schema(value_type = Option<f64>)]
    pub attitude_rad: f64,
    /// rad/s.
    #[schema(value_type = Option<f64>)]
    pub rates_rad_s: f64,
    /// m/s², including the white disturbance force.
    #[schema(value_type = Option<f64>)]
    pub accel_m_s2: f64,
    /// V.
    #[schema(value_type = Option<f64>)]
    pub voltage_v: f64,
    /// Part of `accel_m_s2` that comes from readings of the voltage that are too coarse, m/s²; 0 where they are not.
    #[serde(skip)]
    pub supply_m_s2: f64,
    /// Corrections of an estimator's position relative to its velocity, a random walk, m/√s; 0 if every row is
    /// measured.
    #[serde(skip)]
    pub corrections_m_s05: f64,
    /// Corrections of an estimator's attitude relative to its rates, a random walk axis by axis, rad/√s; 0 if every row
    /// is measured.
    #[serde(skip)]
    pub corrections_rad_s05: Vector3,
    /// White disturbance of the angular acceleration in a step, rad/s², body.
    #[schema(value_type = Vec<Option<f64>>)]
    pub torque_floor_rad_s2: Vector3,
}

impl NoiseModel {
    /// Estimates the noise of a log of the nominal vehicle `c`.
    ///
    /// * `voltage_v`: of its readings · `supply_m_s2`: error of the specific force by readings that are too coarse, by the
    ///   noise of the specific force itself
    pub(crate) fn of(series: &Series, c: &Constants, voltage_v: f64, supply_m_s2: impl Fn(f64) -> Option<f64>) -> Self {
        let of = |x: &[Vector3], floor: f64| {
            let worst = (0..3)
                .map(|i| white_deviation(&x.iter().map(|v| v[i]).collect::<Vec<f64>>()))
                .fold(0.0, f64::max);
            worst.max(floor)
        };
        let arm = (0..c.rotor_count).map(|i| c.arm_length(i)).sum::<f64>() / c.rotor_count as f64;
        let slow = series.slow;
        // Thrust of a rotor per duty, at hover.
        let slope = TYPICAL_EXPONENT * c.hover_thrust_n / slow.mean_duty;
        let thrust = slope * slow.duty;
        let lever = |axis: usize| {
            (0..c.rotor_count)
                .map(|i| match axis {
                    0 => c.rotor_position_body[i][1].powi(2),
                    1 => c.rotor_position_body[i][0].powi(2),
                    _ => c.moment_ratio_m[i].powi(2),
                })
                .sum::<f64>()
                .sqrt()
        };
        let force = thrust * (c.rotor_count as f64).sqrt() / c.mass_kg;
        let torque = TORQUE_FLOOR * c.mass_kg * c.gravity_m_s2 * arm;
        let accel_m_s2 = of(&series.raw.accel, slow.accel.max(FORCE_FLOOR * c.gravity_m_s2)).hypot(force);
        let supply_m_s2 = supply_m_s2(accel_m_s2).unwrap_or(0.0);
        Self {
            position_m: of(&series.raw.position, slow.position.max(1e-5)),
            velocity_m_s: of(&series.raw.velocity, slow.velocity.max(1e-4)),
            attitude_rad: of(&series.raw.attitude, slow.attitude.max(1e-5)),
            rates_rad_s: of(&series.raw.rates, slow.rates.max(1e-4)),
            accel_m_s2: accel_m_s2.hypot(supply_m_s2),
            supply_m_s2,
            voltage_v: voltage_v.max(2e-3),
            corrections_m_s05: slow.corrections,
            corrections_rad_s05: slow.turns,
            torque_floor_rad_s2: [0, 1, 2].map(|i| torque.hypot(thrust * lever(i)) / c.inertia_body_kg_m2[i][i]),
        }
    }

    /// Covariance of each channel over steps of `step_s`.
    pub fn covariances(&self, step_s: f64) -> [Covariance; CHANNELS] {
        std::array::from_fn(|channel| match channel {
            F..KV => Covariance::white(self.accel_m_s2),
            KV..M => Covariance::of_difference(self.velocity_m_s, self.accel_m_s2, 0.0, step_s),
            M..KA => Covariance::of_difference(self.rates_rad_s, 0.0, self.torque_floor_rad_s2[channel - M], step_s),
            // A random walk of q √h in a step is q/√h of a rate.
            KA..KP => {
                let floor = self.corrections_rad_s05[channel - KA] / step_s.sqrt();
                Covariance::of_difference(self.attitude_rad, self.rates_rad_s, floor, step_s)
            }
            KP..V => {
                let floor = self.corrections_m_s05 / step_s.sqrt();
                Covariance::of_difference(self.position_m, self.velocity_m_s, floor, step_s)
            }
            _ => Covariance::white(self.voltage_v),
        })
    }
}

/// Deviation of the white noise on a smooth signal; 0 where there is nothing to estimate it from.
pub fn white_deviation(x: &[f64]) -> f64 {
    let mut difference = x.to_vec();
    let (mut best, mut binomial) = (f64::INFINITY, 1.0);
    for order in 1..=5_u32 {
        for k in 0..difference.len().saturating_sub(1) {
            difference[k] = difference[k + 1] - difference[k];
        }
        difference.pop();
        // (2m over m) from (2m−2 over m−1).
        let m = f64::from(order);
        binomial *= 2.0 * (2.0 * m - 1.0) / m;
        let mut size: Vec<f64> = difference.iter().map(|d| d.abs()).filter(|d| d.is_finite()).collect();
        if size.len() < 20 {
            break;
        }
        let deviation = DEVIATION_PER_MEDIAN * median(&mut size) / f64::sqrt(binomial);
        if order >= 2 {
            best = best.min(deviation);
        }
    }
    if best.is_finite() { best } else { 0.0 }
}

/// Median of a slice, which it reorders; 0 of nothing.
pub(crate) fn median(x: &mut [f64]) -> f64 {
    if x.is_empty() {
        return 0.0;
    }
    let middle = x.len() / 2;
    *x.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    #[test]
    fn val_white_noise_on_motion_is_measured() {
        let mut noise = NormalStream::new(3, "test");
        let x: Vec<f64> = (0..20_000)
            .map(|k| 2.0 * libm::sin(f64::from(k) * 0.0025 * 6.0) + 0.0078 * noise.sample())
            .collect();
        let found = white_deviation(&x);
        // Median of 20 000 correlated differences: about 1.5 %.
        assert!((found / 0.0078 - 1.0).abs() < 0.05, "{found}");
    }
}
