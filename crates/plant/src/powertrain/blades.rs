//! Blades: the lift polynomial of Eq. 19 for each propeller that can be mounted (Table 1).
//!
//! A blade set is a document of its own (`config/blades/*.toml`), shared by vehicles. The torque-to-lift ratio c_D/c_L of a rotor is the
//! vehicle's, times a factor of the mounted blade: 1 unless its document says otherwise, as the paper gives none for damaged blades.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::error::{Refusal, in_range};

/// A blade that needs less or more torque for its lift than this, over the nominal one, is a slip of the pen.
const SMALLEST_MOMENT_RATIO_FACTOR: f64 = 0.5;
const LARGEST_MOMENT_RATIO_FACTOR: f64 = 3.0;

/// Lift of one blade type, static and at steady state.
///
/// f = (V − v₀)(a₀√u + a₁u + a₂u² + a₃u³)   (Eq. 19; u in percent, converted here), N
///
/// Fitted between 40 % and 95 % charge of a four-cell battery on one motor; outside that it extrapolates. Never negative: below
/// about 7 % duty, and below v₀, the lift is 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[doc(alias = "propeller")]
pub struct Blade {
    /// a₀ … a₃, N/V per √%, %, %², %³ of duty.
    pub coefficients: [f64; 4],
    /// v₀, V.
    pub voltage_offset_v: f64,
    /// Torque-to-lift ratio c_D/c_L with this blade, over that with the vehicle's nominal blade: 1 if it is not known to differ.
    #[serde(default = "same", skip_serializing_if = "is_same")]
    #[doc(alias = "torque ratio")]
    pub moment_ratio_factor: f64,
}

fn same() -> f64 {
    1.0
}

fn is_same(factor: &f64) -> bool {
    *factor == same()
}

impl Blade {
    /// The bracket of Eq. 19, clipped at 0: lift per volt above v₀, N/V. `duty` is a fraction.
    #[inline]
    pub fn lift_per_volt(&self, duty: f64) -> f64 {
        self.raw_lift_per_volt(duty).max(0.0)
    }

    /// The bracket of Eq. 19 as printed, negative at small duty, N/V. `duty` is a fraction.
    #[inline]
    pub fn raw_lift_per_volt(&self, duty: f64) -> f64 {
        let u = 100.0 * duty;
        let [a0, a1, a2, a3] = self.coefficients;
        a0 * u.sqrt() + u * (a1 + u * (a2 + u * a3))
    }

    /// Static lift, N, of `duty` (fraction) at the battery voltage `voltage`, V.
    #[inline]
    pub fn lift(&self, duty: f64, voltage: f64) -> f64 {
        (voltage - self.voltage_offset_v).max(0.0) * self.lift_per_volt(duty)
    }

    /// The duty (fraction) that lifts `thrust` N at `voltage` V, to the last bit of a bisection; `None` if full duty
    /// does not suffice or the lift cannot be inverted.
    pub fn duty(&self, thrust: f64, voltage: f64) -> Option<f64> {
        if !(thrust > 0.0 && thrust <= self.lift(1.0, voltage)) {
            return (thrust == 0.0).then_some(0.0);
        }
        // Eq. 19 rises for every u above its zero; below, the clipped lift is 0 and thus below `thrust`.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.lift(middle, voltage) < thrust {
                low = middle
            } else {
                high = middle
            }
        }
        Some(high)
    }
}

/// The blades that a vehicle's rotors can carry, by name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BladeSet {
    /// What was measured and where.
    pub description: String,
    /// Blade types by name; the order of names gives the codes of [`BladeSet::code`].
    pub blade: BTreeMap<String, Blade>,
}

impl BladeSet {
    /// Position of a blade in the alphabetical order of names, from 0. The mounted blade's code in the truth is this number
    /// plus 1, and 0 for the nominal blade.
    pub fn code(&self, name: &str) -> Option<i32> {
        self.blade
            .keys()
            .position(|key| key == name)
            .and_then(|i| i32::try_from(i).ok())
    }

    /// Names, in the order of [`BladeSet::code`].
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.blade.keys().map(String::as_str)
    }

    /// Refuses blades that Eq. 19 cannot describe.
    pub fn check(&self) -> Result<(), Refusal> {
        if self.blade.is_empty() {
            return Err(Refusal::new("blade", "expected at least one blade"));
        }
        for (name, blade) in &self.blade {
            for (i, &coefficient) in blade.coefficients.iter().enumerate() {
                in_range(
                    &format!("blade.{name}.coefficients[{i}]"),
                    coefficient,
                    -1.0,
                    1.0,
                    "N/V",
                )?;
            }
            in_range(
                &format!("blade.{name}.voltage_offset_v"),
                blade.voltage_offset_v,
                -50.0,
                50.0,
                "V",
            )?;
            in_range(
                &format!("blade.{name}.moment_ratio_factor"),
                blade.moment_ratio_factor,
                SMALLEST_MOMENT_RATIO_FACTOR,
                LARGEST_MOMENT_RATIO_FACTOR,
                "",
            )?;
            let rising = (10..=100).all(|percent| {
                let duty = f64::from(percent) / 100.0;
                blade.raw_lift_per_volt(duty) > blade.raw_lift_per_volt(duty - 0.01)
            });
            if !rising || blade.raw_lift_per_volt(1.0) <= 0.0 {
                let reason = "expected a lift that rises with duty from 10 % to 100 % (Eq. 19, duty in percent)";
                return Err(Refusal::new(format!("blade.{name}.coefficients"), reason));
            }
        }
        Ok(())
    }
}
