//! Thrust of a rotor over duty and voltage, about the hover.
//!
//! ```text
//! T/T_h = z + α (z² − z) + β (√z − z),   z = u/u_h,   times 1 + s (V/V̄ − 1)
//! ```
//! so that T = T_h at the hover duty and n = d ln T/d ln u = 1 + α − β/2 there. All three terms are terms of Eq. 19, and the law of
//! the voltage is its V − v0 with v0 = V̄ (1 − 1/s).

use rotortwin_plant::powertrain::blades::Blade;

/// A thrust curve, per mass of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Curve {
    /// u_h.
    pub(crate) hover_duty: f64,
    /// T_h/m, m/s², of one rotor.
    pub(crate) hover: f64,
    pub(crate) alpha: f64,
    pub(crate) beta: f64,
    /// s = d ln T/d ln V; 0 where the log has no voltage.
    pub(crate) voltage_slope: f64,
    /// V̄.
    pub(crate) voltage: f64,
}

impl Curve {
    /// A power law about the hover, as α alone.
    pub(crate) fn with_slope(hover_duty: f64, hover: f64, slope: f64) -> Self {
        Self {
            hover_duty,
            hover,
            alpha: slope - 1.0,
            beta: 0.0,
            voltage_slope: 0.0,
            voltage: 1.0,
        }
    }

    /// n.
    pub(crate) fn slope(&self) -> f64 {
        1.0 + self.alpha - 0.5 * self.beta
    }

    /// T/T_h at the mean voltage; never negative.
    pub(crate) fn shape(&self, duty: f64) -> f64 {
        let z = duty.max(0.0) / self.hover_duty;
        (z + self.alpha * (z * z - z) + self.beta * (z.sqrt() - z)).max(0.0)
    }

    /// Factor of a voltage.
    pub(crate) fn voltage_factor(&self, volts: f64) -> f64 {
        if self.voltage_slope == 0.0 || !volts.is_finite() {
            return 1.0;
        }
        1.0 + self.voltage_slope * (volts / self.voltage - 1.0)
    }

    /// The same as a blade of Eq. 19 that lifts `hover_n` N at hover and `voltage` V; where the shape would fall towards full duty, a
    /// power law of the same slope is written.
    pub(crate) fn blade(&self, hover_n: f64, voltage: f64, voltage_slope: f64) -> Blade {
        // v0 of the flight code is not negative: a weaker effect than proportional is written as proportional.
        let offset = voltage * (1.0 - 1.0 / voltage_slope.max(1.0));
        let per_volt = hover_n / (voltage - offset);
        let percent = 100.0 * self.hover_duty;
        let mut root = self.beta;
        let mut linear = 1.0 - self.alpha - self.beta;
        let mut square = self.alpha;
        let mut cube = 0.0;
        let rises = |root: f64, linear: f64, square: f64, cube: f64| {
            (9..=100).all(|p| {
                let z = f64::from(p) / percent;
                0.5 * root / z.sqrt() + linear + 2.0 * square * z + 3.0 * cube * z * z > 0.0
            })
        };
        if !rises(root, linear, square, cube) {
            let n = self.slope().clamp(0.6, 2.9);
            (root, linear, square, cube) = if n < 1.0 {
                (2.0 * (1.0 - n), 2.0 * n - 1.0, 0.0, 0.0)
            } else if n < 2.0 {
                (0.0, 2.0 - n, n - 1.0, 0.0)
            } else {
                (0.0, 0.0, 3.0 - n, n - 2.0)
            };
        }
        Blade {
            coefficients: [
                per_volt * root / percent.sqrt(),
                per_volt * linear / percent,
                per_volt * square / (percent * percent),
                per_volt * cube / percent.powi(3),
            ],
            voltage_offset_v: offset,
            moment_ratio_factor: 1.0,
        }
    }
}
