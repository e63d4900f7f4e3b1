//! Static thrust of one rotor as a function of duty and battery voltage, and its inverse (§2.6, Table 1).
//!
//! [`crate::fdi`] uses the forward map as the nominal thrust of a healthy rotor, [`crate::control`] may use the inverse
//! to turn thrusts into duties.
//!
//! Eq. 19 is fitted with the duty in *percent*; the interface takes fractions. The conversion is done here and nowhere
//! else.
//!
//! Limits: fitted on one motor between 40 % and 95 % charge; it extrapolates elsewhere. Static: excludes the rotor lag.
//! Below a small duty (7.12 % with blade (a)) the fit turns negative; the thrust is 0 there, and the inverse never
//! returns a non-zero duty in that dead band.

use crate::elementary::square_root;

/// Intervals of the lookup table that provides the inverse's initial bracket.
const CELLS: usize = 64;

/// Points at which the constructor checks that the map is increasing.
const CHECK_POINTS: u16 = 2000;

/// Maximum number of refinements of the inverse. Newton's method takes one or two; where it would leave its bracket,
/// bisection takes over, and 24 halvings exhaust an `f32`.
const MAX_REFINEMENTS: u8 = 24;

/// Newton's method stops after a step in √u (0 to 10) of this size: the remaining error is about half its square, 1e-7.
const LAST_STEP: f32 = 5e-4;

/// How far Newton's method may leave its bracket: the ends are rounded, and the root may lie on one.
const BRACKET_SLACK: f32 = 1e-5;

/// Accepted range, N/V: far outside any rotor, and nothing overflows within.
const MAX_COEF: f32 = 1e6;
const MIN_FULL_SHAPE: f64 = 1e-6;

/// √u for u = 100 %.
const FULL_ROOT: f32 = 10.0;

/// Thrust map of Eq. 19.
///
/// f = (V − v₀)(a₀√u + a₁u + a₂u² + a₃u³), never negative
///
/// ```
/// use rotortwin_flight_core::thrust_map::ThrustMap;
/// let blade_a = ThrustMap::new([-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7], 5.2859)?;
/// let hover = blade_a.duty(2.53425, 16.0);
/// assert!((hover - 0.388166).abs() < 1e-6);
/// assert!((blade_a.thrust(hover, 16.0) - 2.53425).abs() < 1e-5);
/// # Ok::<(), rotortwin_flight_core::thrust_map::ThrustMapError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustMap {
    coef: [f32; 4],
    voltage_offset: f32,
    /// g at full duty: the largest thrust per volt above the offset.
    full_shape: f32,
    /// Table cells per unit of g.
    cells_per_shape: f32,
    /// √u at equal steps of g from 0 (end of the dead band) to `full_shape`.
    root_table: [f32; CELLS + 1],
}

impl ThrustMap {
    /// Placeholder without thrust, to be filled with a map.
    pub(crate) const BLANK: Self = Self {
        coef: [0.0; 4],
        voltage_offset: 0.0,
        full_shape: 0.0,
        cells_per_shape: 0.0,
        root_table: [0.0; CELLS + 1],
    };

    /// Checks the coefficients of one row of Table 1.
    ///
    /// * `coef`: a_L0 … a_L3, N/V for a duty in percent   * `voltage_offset`: v_L0, V, not negative
    ///
    /// Rejects out-of-range values and maps that are not strictly increasing from the end of their dead band to full
    /// duty.
    pub fn new(coef: [f32; 4], voltage_offset: f32) -> Result<Self, ThrustMapError> {
        if let Some(index) = coef.iter().position(|a| !(-MAX_COEF..=MAX_COEF).contains(a)) {
            return Err(ThrustMapError::CoefficientOutOfRange { index });
        }
        if !(voltage_offset >= 0.0 && voltage_offset.is_finite()) {
            return Err(ThrustMapError::VoltageOffsetNegative);
        }
        let full = shape_f64(&coef, f64::from(FULL_ROOT));
        if full < MIN_FULL_SHAPE {
            return Err(ThrustMapError::NoThrustAtFullDuty);
        }

        // Down from full duty: increasing all the way until the dead band, below which g is not positive.
        let root_at = |point: u16| f64::from(FULL_ROOT) * f64::from(point) / f64::from(CHECK_POINTS);
        let mut above = full;
        let mut dead_end = 0.0;
        for point in (0..CHECK_POINTS).rev() {
            let here = shape_f64(&coef, root_at(point));
            if here >= above {
                return Err(ThrustMapError::NotRising {
                    duty: (root_at(point) * root_at(point) / 100.0) as f32,
                });
            }
            if here <= 0.0 {
                dead_end = invert_f64(&coef, 0.0, root_at(point), root_at(point + 1));
                break;
            }
            above = here;
        }
        let root_table = core::array::from_fn(|cell| {
            let target = full * cell as f64 / CELLS as f64;
            invert_f64(&coef, target, dead_end, f64::from(FULL_ROOT)) as f32
        });
        Ok(Self {
            coef,
            voltage_offset,
            full_shape: full as f32,
            cells_per_shape: (CELLS as f64 / full) as f32,
            root_table,
        })
    }

    /// a_L0 … a_L3, N/V for a duty in percent.
    #[inline]
    pub const fn coef(&self) -> [f32; 4] {
        self.coef
    }

    /// v_L0, V.
    #[inline]
    pub const fn voltage_offset(&self) -> f32 {
        self.voltage_offset
    }

    /// Duty below which there is no thrust, fraction: 0.0712 with blade (a).
    #[inline]
    pub fn dead_band(&self) -> f32 {
        let root = self.root_table[0];
        root * root / 100.0
    }

    /// Thrust (lift) at a duty and a voltage, f̄ of Eq. 19, N, never negative.
    ///
    /// * `duty`: fraction, limited to \[0, 1\]   * `voltage`: battery terminals, V
    ///
    /// 0 in the dead band, below the voltage offset, and if either input is NaN.
    #[inline(always)]
    #[doc(alias = "lift")]
    pub fn thrust(&self, duty: f32, voltage: f32) -> f32 {
        let u = 100.0 * duty.clamp(0.0, 1.0);
        let root = square_root(u);
        let excess = voltage - self.voltage_offset;
        let thrust = positive_part(excess * self.shape(root, u));
        if excess > 0.0 { thrust } else { 0.0 }
    }

    /// Duty that gives a thrust at a voltage, the inverse of Eq. 19 on its rising branch, fraction in \[0, 1\].
    ///
    /// * `thrust`: N   * `voltage`: battery terminals, V
    ///
    /// 0 for a thrust of 0 or less, 1 for a thrust above that at full duty (so for any positive thrust at or below the
    /// voltage offset). NaN gives 0. Bounded work: at most 24 refinements.
    #[inline]
    pub fn duty(&self, thrust: f32, voltage: f32) -> f32 {
        let excess = voltage - self.voltage_offset;
        if thrust.is_nan() || excess.is_nan() || thrust <= 0.0 {
            return 0.0;
        }
        if thrust >= self.full_shape * excess {
            return 1.0;
        }
        // Both positive here, and target < full_shape.
        let target = thrust / excess;
        let position = target * self.cells_per_shape;
        let cell = (position as usize).min(CELLS - 1);
        let (mut low, mut high) = (self.root_table[cell], self.root_table[cell + 1]);
        let mut root = low + (position - cell as f32) * (high - low);
        for _ in 0..MAX_REFINEMENTS {
            let square = root * root;
            let error = self.shape(root, square) - target;
            if error > 0.0 {
                high = root;
            } else {
                low = root;
            }
            let newton = root - error / self.slope(root, square);
            if newton >= low - BRACKET_SLACK && newton <= high + BRACKET_SLACK {
                let step = newton - root;
                root = newton;
                if step.abs() <= LAST_STEP {
                    break;
                }
            } else {
                root = 0.5 * (low + high);
            }
        }
        (root * root / 100.0).clamp(0.0, 1.0)
    }

    /// g(√u) = a₀√u + a₁u + a₂u² + a₃u³, u in percent.
    #[inline(always)]
    fn shape(&self, root: f32, u: f32) -> f32 {
        let [a0, a1, a2, a3] = self.coef;
        a0 * root + u * (a1 + u * (a2 + u * a3))
    }

    /// dg/d√u.
    #[inline]
    fn slope(&self, root: f32, u: f32) -> f32 {
        let [a0, a1, a2, a3] = self.coef;
        a0 + root * (2.0 * a1 + u * (4.0 * a2 + u * (6.0 * a3)))
    }
}

/// max(0, x) that is 0 for NaN and never −0, identical on every target.
#[inline(always)]
fn positive_part(x: f32) -> f32 {
    if x > 0.0 { x } else { 0.0 }
}

fn shape_f64(coef: &[f32; 4], root: f64) -> f64 {
    let [a0, a1, a2, a3] = coef.map(f64::from);
    let u = root * root;
    a0 * root + u * (a1 + u * (a2 + u * a3))
}

/// Root √u of g = target in a bracket, by bisection to about the last bit.
fn invert_f64(coef: &[f32; 4], target: f64, low: f64, high: f64) -> f64 {
    let (mut low, mut high) = (low, high);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shape_f64(coef, middle) > target {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// Why a thrust map is rejected. Indices count from 0, as in Table 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ThrustMapError {
    /// A coefficient is NaN or beyond ±10⁶ N/V.
    CoefficientOutOfRange {
        /// Index in a_L0 … a_L3.
        index: usize,
    },
    /// v_L0 is negative, NaN or infinite.
    VoltageOffsetNegative,
    /// Less than a micronewton per volt at 100 % duty.
    NoThrustAtFullDuty,
    /// Thrust falls with increasing duty somewhere.
    NotRising {
        /// Duty at that point, fraction.
        duty: f32,
    },
}

impl core::fmt::Display for ThrustMapError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::CoefficientOutOfRange { index } => {
                write!(
                    out,
                    "coefficient a{index} of the thrust map must be a number within ±{MAX_COEF}"
                )
            }
            Self::VoltageOffsetNegative => {
                out.write_str("the voltage offset of the thrust map must be a voltage of 0 V or more")
            }
            Self::NoThrustAtFullDuty => out.write_str(
                "the thrust map gives no thrust at full duty (the coefficients belong to a duty in percent)",
            ),
            Self::NotRising { duty } => write!(
                out,
                "the thrust map does not rise at {:.1} % duty, so that a thrust has no unique duty",
                100.0 * duty
            ),
        }
    }
}

impl core::error::Error for ThrustMapError {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::string::{String, ToString};
    use std::vec::Vec;

    const BLADE_A: [f32; 4] = [-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7];
    const OFFSET_A: f32 = 5.2859;

    fn blade_a() -> ThrustMap {
        ThrustMap::new(BLADE_A, OFFSET_A).expect("Table 1")
    }

    fn rows(name: &str) -> Vec<Vec<String>> {
        let path = std::format!("{}/../../tests/vectors/{name}", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(path).expect("readable");
        let split = |line: &str| line.split(',').map(ToString::to_string).collect();
        text.lines().skip(1).map(split).collect()
    }

    fn number(text: &str) -> f64 {
        text.parse().expect("a number")
    }

    /// N: coefficients, inputs and each term are rounded to f32 (6e-8) and the terms cancel partly; they reach 14 N.
    const THRUST_TOLERANCE: f64 = 3e-6;

    #[test]
    fn val_thrust_of_all_blades() {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/vectors/params.json"))
            .expect("readable");
        let params: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let mut compared = 0;
        for row in rows("lift.csv") {
            let blade = &params["blades"][&row[0]];
            let value = |index: usize| blade[index].as_f64().expect("number") as f32;
            let map = ThrustMap::new(core::array::from_fn(value), value(4)).expect("Table 1");
            let (voltage, duty) = (number(&row[1]) as f32, number(&row[2]) as f32);
            let got = f64::from(map.thrust(duty, voltage));
            let want = number(&row[4]);
            assert!((got - want).abs() < THRUST_TOLERANCE, "{row:?}: {got}");
            compared += 1;
        }
        assert_eq!(compared, 264);
    }

    #[test]
    fn val_duty_inverts_eq_19() {
        // Fraction: the rounding of the thrust, 1e-7 of it, over a slope never below half the chord.
        const DUTY_TOLERANCE: f64 = 2e-7;
        for row in rows("lift_inverse.csv") {
            let got = blade_a().duty(number(&row[0]) as f32, number(&row[1]) as f32);
            let want = number(&row[2]);
            assert!((f64::from(got) - want).abs() < DUTY_TOLERANCE, "{row:?}: {got}");
        }
    }

    #[test]
    fn val_dead_band_of_blade_a() {
        assert!((blade_a().dead_band() - 0.071218).abs() < 1e-6);
        assert_eq!(blade_a().thrust(0.07, 16.0), 0.0);
        assert!(blade_a().thrust(0.072, 16.0) > 0.0);
        assert!(blade_a().duty(1e-6, 16.0) >= blade_a().dead_band());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn prop_duty_gives_the_thrust_back(thrust in 1e-3f32..9.0, voltage in 12.0f32..17.0, a1 in 0.0f32..1e-2,
                                           dead in prop::bool::ANY) {
            let coef = if dead { BLADE_A } else { [0.0, a1, 1e-4, -1e-7] };
            let map = ThrustMap::new(coef, OFFSET_A).expect("rising");
            let duty = map.duty(thrust, voltage);
            let back = map.thrust(duty, voltage);
            if thrust < map.thrust(1.0, voltage) {
                // Twice the rounding of the terms, which are at most a few times their sum except near the dead band.
                prop_assert!((back - thrust).abs() < 1e-6 * thrust.max(1.0), "{duty}: {back} against {thrust}");
            } else {
                prop_assert_eq!(duty, 1.0);
            }
        }

        #[test]
        fn prop_any_input_gives_a_duty_and_a_thrust(
            thrust in any::<f32>(), voltage in any::<f32>(), duty in any::<f32>(),
        ) {
            let u = blade_a().duty(thrust, voltage);
            prop_assert!((0.0..=1.0).contains(&u), "duty({thrust}, {voltage}) = {u}");
            let f = blade_a().thrust(duty, voltage);
            prop_assert!(f >= 0.0, "thrust({duty}, {voltage}) = {f}");
        }
    }

    #[test]
    fn val_edges() {
        let map = blade_a();
        assert_eq!(map.duty(0.0, 16.0), 0.0);
        assert_eq!(map.duty(-1.0, 16.0), 0.0);
        assert_eq!(map.duty(20.0, 16.0), 1.0);
        assert_eq!(map.duty(1.0, OFFSET_A), 1.0);
        assert_eq!(map.duty(1.0, 3.0), 1.0);
        assert_eq!(map.duty(f32::NAN, 16.0), 0.0);
        assert_eq!(map.duty(1.0, f32::NAN), 0.0);
        assert_eq!(map.thrust(f32::NAN, 16.0), 0.0);
        assert_eq!(map.thrust(0.5, 3.0), 0.0);
        assert_eq!(map.thrust(2.0, 16.0), map.thrust(1.0, 16.0));
    }

    #[test]
    fn val_refusals_name_the_reason() {
        let refusal = |coef, offset| ThrustMap::new(coef, offset).expect_err("refused");
        let mut coef = BLADE_A;
        coef[2] = f32::NAN;
        assert_eq!(
            refusal(coef, OFFSET_A),
            ThrustMapError::CoefficientOutOfRange { index: 2 }
        );
        assert_eq!(refusal(BLADE_A, -1.0), ThrustMapError::VoltageOffsetNegative);
        assert_eq!(refusal(BLADE_A, f32::NAN), ThrustMapError::VoltageOffsetNegative);
        assert_eq!(refusal([0.0; 4], OFFSET_A), ThrustMapError::NoThrustAtFullDuty);
        // Peaks at 50 % duty.
        let peaked = refusal([0.0, 1.2e-2, -1.0e-4, 0.0], OFFSET_A);
        assert!(matches!(peaked, ThrustMapError::NotRising { .. }), "{peaked:?}");
        assert!(peaked.to_string().contains("% duty"));
    }
}
