//! Student's t distribution: two-sided p-value and critical value.
//!
//! Used at construction to turn a significance level into a threshold for [`super::t_test`]; nothing here runs in a step. In
//! `f64`, because the levels of Table 5 (1e-10) are beyond what an `f32` tail can resolve.
//!
//! Method: the two-sided p-value is the regularised incomplete beta function I_x(ν/2, ½) at x = ν/(ν + t²), by its continued
//! fraction (modified Lentz). About 1e-12 relative for 1 ≤ ν ≤ 10⁴ and p ≥ 1e-300.

/// Smallest allowed magnitude of a partial denominator of the continued fraction.
const TINY: f64 = 1e-300;

/// Relative change at which the continued fraction has converged.
const CONVERGED: f64 = 1e-15;

/// Maximum number of terms of the continued fraction; fewer than 200 are needed for ν ≤ 10⁴.
const MAX_TERMS: u32 = 1000;

/// Probability of |T| at least |t|, p = P(|T| ≥ |t|), two-sided.
///
/// * `t`: statistic; an infinite one gives 0, NaN gives NaN   * `degrees_of_freedom`: ν, at least 1
pub fn two_sided_p_value(t: f64, degrees_of_freedom: f64) -> f64 {
    if t.is_nan() || degrees_of_freedom.is_nan() {
        return f64::NAN;
    }
    let t_squared = t * t;
    if t_squared.is_infinite() {
        return 0.0;
    }
    // 1 − x is formed directly: a subtraction would lose digits for a small t.
    let sum = degrees_of_freedom + t_squared;
    incomplete_beta(0.5 * degrees_of_freedom, 0.5, degrees_of_freedom / sum, t_squared / sum)
}

/// t > 0 with `two_sided_p_value(t, ν) = significance`.
///
/// * `significance`: α, in (0, 1)   * `degrees_of_freedom`: ν, at least 1
///
/// None outside of these ranges, and where t would not be finite.
pub fn two_sided_critical_value(significance: f64, degrees_of_freedom: f64) -> Option<f64> {
    // Written so that NaN is rejected, too.
    let in_range =
        significance > 0.0 && significance < 1.0 && degrees_of_freedom >= 1.0 && degrees_of_freedom.is_finite();
    if !in_range {
        return None;
    }
    let mut low = 0.0;
    let mut high = 1.0;
    while two_sided_p_value(high, degrees_of_freedom) > significance {
        low = high;
        high *= 2.0;
        if high > 1e150 {
            return None;
        }
    }
    // 60 halvings shrink the interval below one unit in the last place.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if two_sided_p_value(middle, degrees_of_freedom) > significance {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// Regularised incomplete beta function I_x(a, b), with `y` = 1 − x.
fn incomplete_beta(a: f64, b: f64, x: f64, y: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if y <= 0.0 {
        return 1.0;
    }
    let log_front = libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b) + a * libm::log(x) + b * libm::log(y);
    let front = libm::exp(log_front);
    if x < (a + 1.0) / (a + b + 2.0) {
        front * beta_fraction(a, b, x) / a
    } else {
        1.0 - front * beta_fraction(b, a, y) / b
    }
}

/// Continued fraction of the incomplete beta function, modified Lentz.
fn beta_fraction(a: f64, b: f64, x: f64) -> f64 {
    let away_from_zero = |v: f64| if v.abs() < TINY { TINY } else { v };
    let mut c = 1.0;
    let mut d = 1.0 / away_from_zero(1.0 - (a + b) * x / (a + 1.0));
    let mut fraction = d;
    for term in 1..=MAX_TERMS {
        let m = f64::from(term);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / away_from_zero(1.0 + even * d);
        c = away_from_zero(1.0 + even / c);
        fraction *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / away_from_zero(1.0 + odd * d);
        c = away_from_zero(1.0 + odd / c);
        let factor = d * c;
        fraction *= factor;
        if (factor - 1.0).abs() < CONVERGED {
            break;
        }
    }
    fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Relative; tolerance of the reference vectors.
    const VECTOR_TOLERANCE: f64 = 1e-9;

    #[test]
    fn val_reference_p_and_critical_values() {
        let vectors = super::super::test_vectors::json("ttest.json");
        for case in vectors["cases"].as_array().expect("array") {
            let t = case["t"].as_f64().expect("number");
            let want = case["p"].as_f64().expect("number");
            let got = two_sided_p_value(t, 24.0);
            assert!(
                (got - want).abs() <= VECTOR_TOLERANCE * want,
                "{got:e} against {want:e}"
            );
        }
        for (alpha, key) in [(1e-10, "df24_1e-10"), (1e-8, "df24_1e-8")] {
            let want = vectors["tcrit"][key].as_f64().expect("number");
            let got = two_sided_critical_value(alpha, 24.0).expect("in range");
            assert!((got - want).abs() <= VECTOR_TOLERANCE * want);
        }
    }

    #[test]
    fn val_closed_forms() {
        // ν = 1 is the Cauchy distribution, ν = 2 has p = 1 − t/√(2 + t²).
        for t in [1e-6, 0.1, 1.0, 10.0, 1e4] {
            let cauchy = 1.0 - 2.0 / core::f64::consts::PI * libm::atan(t);
            assert!((two_sided_p_value(t, 1.0) - cauchy).abs() < 1e-13);
            let two = 1.0 - t / libm::sqrt(2.0 + t * t);
            assert!((two_sided_p_value(t, 2.0) - two).abs() < 1e-13);
        }
    }

    #[test]
    fn val_edges() {
        assert_eq!(two_sided_p_value(0.0, 24.0), 1.0);
        assert_eq!(two_sided_p_value(f64::INFINITY, 24.0), 0.0);
        assert!(two_sided_p_value(f64::NAN, 24.0).is_nan());
        for alpha in [0.0, 1.0, -1.0, f64::NAN] {
            assert_eq!(two_sided_critical_value(alpha, 24.0), None);
        }
        assert_eq!(two_sided_critical_value(0.01, 0.5), None);
        assert_eq!(two_sided_critical_value(1e-300, 1.0), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_critical_value_inverts_p_value(exponent in -20.0f64..-0.01, dof in 1u32..500) {
            let alpha = libm::pow(10.0, exponent);
            if let Some(t) = two_sided_critical_value(alpha, f64::from(dof)) {
                let back = two_sided_p_value(t, f64::from(dof));
                // Bisection ends at one unit in the last place of t; the tail amplifies it by up to ν + 1.
                prop_assert!((back - alpha).abs() <= 1e-9 * alpha, "{} {}", back, alpha);
            }
        }
    }
}
