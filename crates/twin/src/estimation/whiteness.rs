//! Is the rest white? Sums of a whitened residual by channel, and the trust that follows from them.
//!
//! Means over 0.25 s of white noise have the variance of the noise over their length. Slow model errors stand out in them a
//! hundredfold. The noise level is taken from the median of the whitened residual, so that a wrong noise model does not count as
//! physics.

use super::problem::{Problem, fitted_residual, in_pairs};
use crate::predict::noise::{DEVIATION_PER_MEDIAN, median};
use crate::predict::{CHANNELS, PerChannel, Predictor};

/// Length of a mean, s.
const MEAN_S: f64 = 0.25;

/// Normal score above which a channel is not explained.
pub(crate) const UNEXPLAINED_SCORE: f64 = 6.0;

/// Smallest noise level, relative to the assumed one: a simulated battery without noise is not known better than its
/// floor.
const LEAST_LEVEL: f64 = 0.5;

/// Sums of one channel.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ChannelFit {
    /// chi² per sample.
    pub(crate) chi2: f64,
    /// Σ of squared, normalised means.
    pub(crate) slow: f64,
    /// Number of means.
    pub(crate) means: f64,
    /// Noise level from the median.
    pub(crate) level: f64,
}

impl ChannelFit {
    pub(crate) fn score(&self) -> f64 {
        (self.slow - self.means) / (2.0 * self.means).max(1.0).sqrt()
    }
}

/// Fit of each channel of a whitened residual.
pub(crate) fn channel_fits(predictor: &Predictor, residual: &PerChannel) -> [Option<ChannelFit>; CHANNELS] {
    let rows = (MEAN_S / predictor.series().step_s).round().max(2.0) as usize;
    std::array::from_fn(|channel| {
        let whitener = predictor.whitener(channel)?;
        let r = &residual[channel];
        let mut sizes: Vec<f64> = (0..r.len())
            .filter(|&k| whitener.counts(k))
            .map(|k| r[k].abs())
            .collect();
        let samples = sizes.len() as f64;
        // Errors of such a reading persist, which their noise includes: that of a single row is smaller.
        let least = if predictor.has_persistent_errors(channel) {
            1.0
        } else {
            LEAST_LEVEL
        };
        let level = (DEVIATION_PER_MEDIAN * median(&mut sizes)).max(least);
        let mut fit = ChannelFit {
            chi2: r.iter().map(|x| x * x).sum::<f64>() / samples.max(1.0),
            level,
            ..ChannelFit::default()
        };
        for start in (0..r.len()).step_by(rows) {
            let end = (start + rows).min(r.len());
            let count = (start..end).filter(|&k| whitener.counts(k)).count();
            if 2 * count < rows {
                continue;
            }
            let sum: f64 = r[start..end].iter().sum();
            fit.slow += sum * sum / (count as f64 * level * level);
            fit.means += 1.0;
        }
        Some(fit)
    })
}

/// Trust in each channel, from what the whole library cannot explain: 1, or less if the noise is larger or slower than assumed.
pub(crate) fn weights(fits: &[Option<ChannelFit>; CHANNELS]) -> [f64; CHANNELS] {
    std::array::from_fn(|channel| match &fits[channel] {
        Some(fit) if fit.means > 8.0 => {
            let slow = fit.slow / fit.means;
            // White noise scatters by √(2/n): only a clear excess counts.
            let allowance = 1.0 + 4.0 * (2.0 / fit.means).sqrt();
            let slow = if slow > allowance { slow } else { 1.0 };
            let level = if fit.level > 1.02 { fit.level } else { 1.0 };
            1.0 / (level * level * slow)
        }
        _ => 1.0,
    })
}

/// Fits of all logs once the linear parameters took `mean`, with the noise that was assumed.
pub(crate) fn fits(problem: &Problem, mean: &[f64]) -> Vec<[Option<ChannelFit>; CHANNELS]> {
    in_pairs(&problem.logs, |l, log| {
        assumed_fits(&log.predictor, fitted_residual(problem, l, mean))
    })
}

/// Fit of each channel of a whitened residual with the noise that was assumed.
pub(crate) fn assumed_fits(predictor: &Predictor, mut residual: PerChannel) -> [Option<ChannelFit>; CHANNELS] {
    for (channel, own) in residual.iter_mut().enumerate() {
        if let Some(assumed) = predictor.as_assumed(channel, own) {
            *own = assumed;
        }
    }
    channel_fits(predictor, &residual)
}

/// True if a channel is not white.
pub(crate) fn coloured(fits: &[[Option<ChannelFit>; CHANNELS]]) -> bool {
    let mut all = fits.iter().flatten().flatten();
    all.any(|fit| fit.score() > UNEXPLAINED_SCORE)
}
