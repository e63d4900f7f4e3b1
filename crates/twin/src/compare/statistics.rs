//! Tests on whitened residuals: block means, Ljung–Box, correlation with inputs, binned means.

use serde::Serialize;
use utoipa::ToSchema;

/// Lags of the Ljung–Box test, samples.
const LJUNG_BOX_LAGS: usize = 20;

/// Sums of consecutive samples, each divided by the square root of its count, so that white noise of variance 1 gives variance 1.
/// A block counts if at least half of its samples do; others are NaN.
pub fn standardised_blocks(whitened: &[f64], mask: &[bool], length: usize) -> Vec<f64> {
    blocks(whitened, mask, length)
        .map(|(sum, count)| {
            if 2 * count >= length {
                sum / (count as f64).sqrt()
            } else {
                f64::NAN
            }
        })
        .collect()
}

/// Means of consecutive samples; NaN where less than half of a block counts.
pub fn block_means(values: &[f64], mask: &[bool], length: usize) -> Vec<f64> {
    blocks(values, mask, length)
        .map(|(sum, count)| {
            if 2 * count >= length {
                sum / count as f64
            } else {
                f64::NAN
            }
        })
        .collect()
}

fn blocks<'a>(values: &'a [f64], mask: &'a [bool], length: usize) -> impl Iterator<Item = (f64, usize)> + 'a {
    let length = length.max(1);
    values.chunks(length).zip(mask.chunks(length)).map(|(values, mask)| {
        values
            .iter()
            .zip(mask)
            .filter(|&(_, &counts)| counts)
            .fold((0.0, 0), |(sum, count), (value, _)| (sum + value, count + 1))
    })
}

/// Mean of the finite values, and how many there are.
pub fn finite_mean(values: impl IntoIterator<Item = f64>) -> (f64, usize) {
    let (sum, count) = values
        .into_iter()
        .filter(|value| value.is_finite())
        .fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    (if count == 0 { f64::NAN } else { sum / count as f64 }, count)
}

/// Mean square of the finite values, and how many there are.
pub fn mean_square(values: &[f64]) -> (f64, usize) {
    finite_mean(values.iter().map(|value| value * value))
}

/// Ljung–Box test of whiteness: Q = n(n+2) Σ ρ_l²/(n−l), chi-squared with as many degrees of freedom as lags.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct LjungBox {
    /// Degrees of freedom.
    pub lags: usize,
    /// Q.
    #[schema(value_type = Option<f64>)]
    pub statistic: f64,
    /// Probability of a larger Q by chance.
    #[schema(value_type = Option<f64>)]
    pub p_value: f64,
    /// Correlation of neighbouring samples.
    #[schema(value_type = Option<f64>)]
    pub lag_one: f64,
}

impl LjungBox {
    /// Of a whitened residual; masked samples count as 0.
    pub fn of(whitened: &[f64]) -> Self {
        let n = whitened.iter().filter(|w| **w != 0.0).count() as f64;
        let power: f64 = whitened.iter().map(|w| w * w).sum();
        let mut statistic = 0.0;
        let mut lag_one = 0.0;
        for lag in 1..=LJUNG_BOX_LAGS {
            let product: f64 = whitened
                .iter()
                .zip(&whitened[lag.min(whitened.len())..])
                .map(|(a, b)| a * b)
                .sum();
            let rho = if power > 0.0 { product / power } else { 0.0 };
            if lag == 1 {
                lag_one = rho;
            }
            statistic += rho * rho / (n - lag as f64).max(1.0);
        }
        statistic *= n * (n + 2.0);
        Self {
            lags: LJUNG_BOX_LAGS,
            statistic,
            p_value: chi_squared_tail(statistic, LJUNG_BOX_LAGS as f64),
            lag_one,
        }
    }
}

/// Probability that chi-squared with `freedom` degrees exceeds `value`; Wilson and Hilferty 1931, good to 1e-3 from 5 degrees on.
pub fn chi_squared_tail(value: f64, freedom: f64) -> f64 {
    if value <= 0.0 {
        return 1.0;
    }
    let spread = 2.0 / (9.0 * freedom);
    let z = (libm::cbrt(value / freedom) - (1.0 - spread)) / spread.sqrt();
    0.5 * libm::erfc(z / std::f64::consts::SQRT_2)
}

/// Largest correlation of a residual with an earlier input.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct InputTest {
    /// Name of the input.
    pub input: &'static str,
    /// Correlation coefficient at the lag where it is largest.
    #[schema(value_type = Option<f64>)]
    pub correlation: f64,
    /// Lag of the residual behind the input, s.
    pub lag_s: f64,
    /// Band that contains 99 % of unrelated series, at all lags together.
    #[schema(value_type = Option<f64>)]
    pub band_99: f64,
    /// Number of blocks.
    pub blocks: usize,
}

impl InputTest {
    /// Outside of the 99 % band.
    pub fn is_outside(&self) -> bool {
        self.correlation.abs() > self.band_99
    }

    /// Of blocks of a white residual with blocks of an input, at lags of 1 to `lags` blocks. The loop that flew the log feeds the
    /// residual back into later inputs, so only an input that came before a residual says anything about the model.
    pub fn of(input: &'static str, residual: &[f64], values: &[f64], lags: usize, block_s: f64) -> Option<Self> {
        let (mean_r, _) = finite_mean(residual.iter().copied());
        let (mean_x, _) = finite_mean(values.iter().copied());
        let mut best: Option<Self> = None;
        for lag in 1..=lags {
            let (mut rr, mut xx, mut rx, mut count) = (0.0, 0.0, 0.0, 0_usize);
            for (r, x) in residual.iter().skip(lag).zip(values) {
                let (r, x) = (r - mean_r, x - mean_x);
                if r.is_finite() && x.is_finite() {
                    rr += r * r;
                    xx += x * x;
                    rx += r * x;
                    count += 1;
                }
            }
            if count < 50 || rr <= 0.0 || xx <= 1e-12 * count as f64 {
                continue;
            }
            let correlation = rx / (rr * xx).sqrt();
            if best.as_ref().is_none_or(|b| correlation.abs() > b.correlation.abs()) {
                let band_99 = two_sided_quantile(0.01 / lags as f64) / (count as f64).sqrt();
                best = Some(Self {
                    input,
                    correlation,
                    lag_s: lag as f64 * block_s,
                    band_99,
                    blocks: count,
                });
            }
        }
        best
    }
}

/// z with P(|Z| > z) = `probability`, by bisection of the error function.
pub fn two_sided_quantile(probability: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if libm::erfc(middle / std::f64::consts::SQRT_2) > probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    #[test]
    fn val_tail_of_chi_squared() {
        // Tables: 95 % of 20 degrees below 31.410, 99 % below 37.566.
        assert!((chi_squared_tail(31.410, 20.0) - 0.05).abs() < 1e-3);
        assert!((chi_squared_tail(37.566, 20.0) - 0.01).abs() < 1e-3);
        assert!((two_sided_quantile(0.01) - 2.575_829).abs() < 1e-5);
    }

    #[test]
    fn val_white_noise_passes_and_a_delayed_input_is_found() {
        let (mut noise, mut drive) = (NormalStream::new(5, "noise"), NormalStream::new(6, "drive"));
        let white: Vec<f64> = (0..8000).map(|_| noise.sample()).collect();
        let input: Vec<f64> = (0..8000).map(|_| drive.sample()).collect();
        let mask = vec![true; 8000];
        assert!(LjungBox::of(&white).p_value > 1e-3);
        let (level, blocks) = mean_square(&standardised_blocks(&white, &mask, 100));
        // Deviation of the mean square of 80 blocks: √(2/80) = 0.16.
        assert!(blocks == 80 && (level - 1.0).abs() < 5.0 * 0.16, "{level}");
        assert!(!InputTest::of("x", &white, &input, 10, 0.05).unwrap().is_outside());
        let driven: Vec<f64> = (0..8000)
            .map(|k| white[k] + if k >= 3 { 0.3 * input[k - 3] } else { 0.0 })
            .collect();
        let found = InputTest::of("x", &driven, &input, 10, 0.05).unwrap();
        assert!(found.is_outside() && (found.lag_s - 0.15).abs() < 1e-9);
        // The feedback of a residual into later inputs is not counted against the model.
        let fed_back: Vec<f64> = (0..8000).map(|k| if k >= 3 { white[k - 3] } else { 0.0 }).collect();
        assert!(!InputTest::of("x", &white, &fed_back, 10, 0.05).unwrap().is_outside());
    }
}
