//! Spectrum of a residual over that of its noise, on two halves of a flight: one chooses what to say, the other has to confirm it.
//!
//! Blocks of 5 s, alternately *shown* and *unseen*. Of each the mean counts as its slowest band, and the rest is windowed (Hann) and transformed
//! (Welch's method): P_j = |Σ w_k r_k e^{−2πijk/N}|²/Σ w_k², whose mean is the density S(f) of a stationary residual. The noise is white or a
//! first-order moving average, S_n(f) = c₀ + 2 c₁ cos 2πf h, so that S/S_n is 1 where there is nothing but noise, whatever a channel is the
//! difference of. Bands are a third of an octave.

use std::f64::consts::TAU;
use std::ops::Range;

use crate::predict::Covariance;

/// Length of a block, s.
pub(super) const BLOCK_S: f64 = 5.0;
/// Bands in an octave.
const PER_OCTAVE: f64 = 3.0;
/// Share of the excess over noise that a range of bands has to hold on the shown blocks, and on the unseen ones.
const HELD: f64 = 0.8;
const CONFIRMED: f64 = 0.6;
/// Deviations of a band's mean from 1, by the scatter of a periodogram, from which it is more than noise.
const LOUD: f64 = 5.0;
/// Of the noise, below which a band is too quiet for a sensor, and the bands in which it must be so: an octave.
const QUIET: f64 = 0.5;
const QUIET_BANDS: usize = 3;
/// Ratio of the loudest to the quietest band of a flat spectrum, and the independent frequencies of a band that is asked.
const FLAT: f64 = 2.0;
const WIDE: f64 = 6.0;
/// Width of a line over its frequency, and how far it stands out of its surroundings on the shown and on the unseen blocks.
const LINE_WIDTH: f64 = 0.2;
const LINE_STANDS_OUT: f64 = 6.0;
const LINE_CONFIRMED: f64 = 3.0;
/// Share of the excess that a line has to hold to be told.
const LINE_SHARE: f64 = 0.3;
/// Lowest frequency of a line, Hz: of slower ones a block holds too few periods.
const LOWEST_LINE_HZ: f64 = 0.8;

/// The periodograms of a residual and the density of its noise.
#[derive(Debug, Clone)]
pub(super) struct Spectrum {
    /// Hz between two frequencies.
    step_hz: f64,
    /// Mean square of the blocks' means over that of noise; shown and unseen.
    slow: [f64; 2],
    /// Mean square of the blocks' means.
    slow_square: [f64; 2],
    /// Density over that of noise, from the first frequency on.
    ratio: [Vec<f64>; 2],
    /// Density of the noise, unit² per sample.
    noise: Vec<f64>,
    noise_of_mean: f64,
    /// Number of blocks.
    blocks: [f64; 2],
    /// Frequencies per independent one: blocks are padded to a power of two.
    padded: f64,
    bands: Vec<Range<usize>>,
}

/// Where an error lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Band {
    pub(super) low_hz: f64,
    pub(super) high_hz: f64,
    /// Bands, the slowest being 0.
    first: usize,
    last: usize,
    /// True if it is the whole spectrum, and alike in all of it.
    pub(super) flat: bool,
}

/// In place, radix 2.
fn transform(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let mut length = 2;
    while length <= n {
        let half = length / 2;
        let factors: Vec<(f64, f64)> = (0..half)
            .map(|k| libm::sincos(-TAU * k as f64 / length as f64))
            .collect();
        for start in (0..n).step_by(length) {
            for (k, (sine, cosine)) in factors.iter().enumerate() {
                let (a, b) = (start + k, start + k + half);
                let (x, y) = (re[b] * cosine - im[b] * sine, re[b] * sine + im[b] * cosine);
                (re[b], im[b]) = (re[a] - x, im[a] - y);
                (re[a], im[a]) = (re[a] + x, im[a] + y);
            }
        }
        length *= 2;
    }
}

/// Rows of whole blocks in which everything counts, one after the other.
pub(super) fn whole_blocks(mask: &[bool], rows: usize) -> Vec<Range<usize>> {
    let (mut found, mut start) = (Vec::new(), 0);
    for k in 0..mask.len() {
        if !mask[k] {
            start = k + 1;
        } else if k + 1 == start + rows {
            found.push(start..k + 1);
            start = k + 1;
        }
    }
    found
}

impl Spectrum {
    /// `None` with fewer than two blocks of either half.
    pub(super) fn of(residual: &[f64], blocks: &[Range<usize>], covariance: Covariance, step_s: f64) -> Option<Self> {
        if blocks.len() < 4 {
            return None;
        }
        let rows = blocks[0].len();
        let size = rows.next_power_of_two();
        let step_hz = 1.0 / (size as f64 * step_s);
        let window: Vec<f64> = (0..rows)
            .map(|k| 0.5 - 0.5 * libm::cos(TAU * (k as f64 + 0.5) / rows as f64))
            .collect();
        let power: f64 = window.iter().map(|w| w * w).sum();
        let density = |j: usize| {
            let cosine = libm::cos(TAU * j as f64 / size as f64);
            (covariance.variance + 2.0 * covariance.lag_one * cosine).max(1e-12 * covariance.variance)
        };
        let noise: Vec<f64> = (1..=size / 2).map(density).collect();
        let noise_of_mean = covariance.deviation_of_mean(rows).max(f64::MIN_POSITIVE);
        let mut ratio = [vec![0.0; noise.len()], vec![0.0; noise.len()]];
        let (mut slow_square, mut count) = ([0.0; 2], [0.0; 2]);
        for (b, range) in blocks.iter().enumerate() {
            let half = b % 2;
            let own = &residual[range.clone()];
            let mean = own.iter().sum::<f64>() / rows as f64;
            slow_square[half] += mean * mean;
            count[half] += 1.0;
            let mut re: Vec<f64> = own.iter().zip(&window).map(|(r, w)| (r - mean) * w).collect();
            re.resize(size, 0.0);
            let mut im = vec![0.0; size];
            transform(&mut re, &mut im);
            for (j, sum) in ratio[half].iter_mut().enumerate() {
                let (x, y) = (re[j + 1], im[j + 1]);
                *sum += (x * x + y * y) / power / noise[j];
            }
        }
        for half in 0..2 {
            ratio[half].iter_mut().for_each(|sum| *sum /= count[half]);
            slow_square[half] /= count[half];
        }
        let slow = slow_square.map(|square| square / (noise_of_mean * noise_of_mean));
        let bands = bands(step_hz, noise.len(), rows as f64 * step_s);
        Some(Self {
            step_hz,
            slow,
            slow_square,
            ratio,
            noise,
            noise_of_mean,
            blocks: count,
            padded: size as f64 / rows as f64,
            bands,
        })
    }

    fn hz(&self, place: usize) -> f64 {
        (place + 1) as f64 * self.step_hz
    }

    /// Mean ratio of a band in a half, and its deviation from noise alone. The slowest band is that of the means.
    fn of_band(&self, band: usize, half: usize) -> (f64, f64) {
        let Some(range) = band.checked_sub(1).map(|b| self.bands[b].clone()) else {
            return (self.slow[half], (2.0 / self.blocks[half]).sqrt());
        };
        let count = range.len() as f64;
        let mean = self.ratio[half][range].iter().sum::<f64>() / count;
        // A Hann window makes three neighbours alike: of two frequencies one is independent.
        let independent = (count / self.padded / 1.5).max(1.0);
        (mean, (1.0 / (self.blocks[half] * independent)).sqrt())
    }

    /// Excess of a band over noise, in independent frequencies; 0 where it is not clearly more than noise.
    fn excess(&self, band: usize, half: usize) -> f64 {
        let (mean, deviation) = self.of_band(band, half);
        let count = band
            .checked_sub(1)
            .map_or(1.0, |b| self.bands[b].len() as f64 / self.padded);
        if mean - 1.0 > LOUD * deviation {
            (mean - 1.0) * count
        } else {
            0.0
        }
    }

    /// The shortest range of bands that holds most of the excess on the shown blocks, if it does so on the unseen ones.
    pub(super) fn range(&self) -> Option<Band> {
        if let Some(flat) = self.flat() {
            return Some(flat);
        }
        let count = self.bands.len() + 1;
        let of = |half: usize| -> Vec<f64> { (0..count).map(|band| self.excess(band, half)).collect() };
        let (shown, unseen) = (of(0), of(1));
        let all: f64 = shown.iter().sum();
        if all <= 0.0 {
            return None;
        }
        let held = |excess: &[f64], first: usize, last: usize| excess[first..=last].iter().sum::<f64>();
        let mut best: Option<(usize, usize)> = None;
        for first in 0..count {
            let Some(last) = (first..count).find(|&last| held(&shown, first, last) >= HELD * all) else {
                break;
            };
            if best.is_none_or(|(a, b)| last - first < b - a) {
                best = Some((first, last));
            }
        }
        let (first, last) = best?;
        let total: f64 = unseen.iter().sum();
        if total <= 0.0 || held(&unseen, first, last) < CONFIRMED * total {
            return None;
        }
        let (low_hz, high_hz) = (self.edges(first).0, self.edges(last).1);
        Some(Band {
            low_hz,
            high_hz,
            first,
            last,
            flat: false,
        })
    }

    /// The whole spectrum, if it is more than noise and alike everywhere, on both halves.
    fn flat(&self) -> Option<Band> {
        let wide = |band: &usize| self.bands[band - 1].len() as f64 >= WIDE * self.padded;
        let bands: Vec<usize> = (1..=self.bands.len()).filter(wide).collect();
        let alike = |half: usize| {
            let levels = bands.iter().map(|&band| self.of_band(band, half).0);
            let (least, most) = levels.fold((f64::INFINITY, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
            least > 1.0 && most < FLAT * least
        };
        let loud = |half: usize| bands.iter().any(|&band| self.excess(band, half) > 0.0);
        let last = self.bands.len();
        (0..2).all(|half| alike(half) && loud(half)).then(|| Band {
            low_hz: 0.0,
            high_hz: self.edges(last).1,
            first: 0,
            last,
            flat: true,
        })
    }

    /// Lower and upper end of a band, Hz.
    fn edges(&self, band: usize) -> (f64, f64) {
        match band.checked_sub(1).map(|b| &self.bands[b]) {
            None => (0.0, self.bands.first().map_or(0.0, |first| self.hz(first.start))),
            Some(range) => (self.hz(range.start), self.hz(range.end - 1)),
        }
    }

    /// Frequency from which on there is less than noise in every band, on both halves: what a low-pass leaves.
    pub(super) fn quiet_above_hz(&self) -> Option<f64> {
        let quiet = |band: usize| (0..2).all(|half| self.of_band(band, half).0 < QUIET);
        let count = self.bands.len() + 1;
        let first = (1..count).rev().take_while(|&band| quiet(band)).last()?;
        (count - first >= QUIET_BANDS).then(|| self.edges(first).0)
    }

    /// A line: its frequency and the width at half its height, Hz.
    pub(super) fn line(&self) -> Option<(f64, f64)> {
        let smooth = |half: usize| -> Vec<f64> {
            let own = &self.ratio[half];
            let reach = (1.5 * self.padded).round() as usize;
            let mean = |j: usize| {
                let range = j.saturating_sub(reach)..(j + reach + 1).min(own.len());
                own[range.clone()].iter().sum::<f64>() / range.len() as f64
            };
            (0..own.len()).map(mean).collect()
        };
        let (shown, unseen) = (smooth(0), smooth(1));
        let lowest = ((LOWEST_LINE_HZ / self.step_hz) as usize).min(shown.len());
        let peak = (lowest..shown.len()).max_by(|&a, &b| shown[a].total_cmp(&shown[b]))?;
        let above = |j: usize| shown[j] > 0.5 * shown[peak];
        let first = (0..=peak).rev().take_while(|&j| above(j)).last()?;
        let last = (peak..shown.len()).take_while(|&j| above(j)).last()?;
        let (hz, width) = (self.hz(peak), self.hz(last) - self.hz(first));
        // Window and smoothing alone make a line of four frequencies.
        if width > (LINE_WIDTH * hz).max(5.0 * self.padded * self.step_hz) {
            return None;
        }
        // Half an octave on either side, without the line itself and its skirts.
        let own = 3 * (last - first + 1) + 4 * self.padded as usize;
        let around = |all: &[f64]| -> Option<f64> {
            let (low, high) = (
                (peak as f64 / 1.4) as usize,
                ((peak as f64 * 1.4) as usize).min(all.len() - 1),
            );
            let mut others: Vec<f64> = (low..=high)
                .filter(|&j| j.abs_diff(peak) > own)
                .map(|j| all[j])
                .collect();
            (others.len() >= 4).then(|| crate::predict::noise::median(&mut others))
        };
        let height = |half: usize| self.ratio[half][first..=last].iter().sum::<f64>() / (last - first + 1) as f64;
        let stands_out = height(0) > LINE_STANDS_OUT * around(&shown)?.max(1.0);
        let confirmed = height(1) > LINE_CONFIRMED * around(&unseen)?.max(1.0);
        let total: f64 = (0..=self.bands.len()).map(|band| self.excess(band, 1)).sum();
        let own: f64 = self.ratio[1][first..=last]
            .iter()
            .map(|r| (r - 1.0) / self.padded)
            .sum();
        (stands_out && confirmed && own > LINE_SHARE * total).then_some((hz, width.max(self.padded * self.step_hz)))
    }

    /// Root mean squares on the unseen blocks of what lies in a range, and of the noise there; of all without one.
    ///
    /// * `integrated`: of the quantity whose rate of change the residual is, without its mean
    pub(super) fn size(&self, range: Option<&Band>, integrated: Option<f64>) -> (f64, f64) {
        let (first, last) = range.map_or((0, self.bands.len()), |range| (range.first, range.last));
        let places: Vec<usize> = (first.max(1)..=last)
            .flat_map(|band| self.bands[band - 1].clone())
            .collect();
        // Both ends of the spectrum of a real signal.
        let share = 2.0 / (2 * self.noise.len()) as f64;
        let factor = |j: usize| share * integrated.map_or(1.0, |step_s| self.integral(j, step_s));
        let with: f64 = places
            .iter()
            .map(|&j| self.ratio[1][j] * self.noise[j] * factor(j))
            .sum();
        let noise: f64 = places.iter().map(|&j| self.noise[j] * factor(j)).sum();
        let means = if first == 0 && integrated.is_none() {
            (self.slow_square[1], self.noise_of_mean * self.noise_of_mean)
        } else {
            (0.0, 0.0)
        };
        ((with + means.0).sqrt(), (noise + means.1).sqrt())
    }

    /// |h/(1 − e^{−iωh})|²: the sum over rows of a difference quotient.
    fn integral(&self, place: usize, step_s: f64) -> f64 {
        let cosine = libm::cos(TAU * self.hz(place) * step_s);
        step_s * step_s / (2.0 - 2.0 * cosine).max(1e-12)
    }

    /// Time over which the excess in a range stays alike, s: its autocorrelation, the transform of its density, falls to 1/e; at most half a block.
    pub(super) fn correlation_s(&self, range: &Band, integrated: Option<f64>) -> Option<f64> {
        let parts: Vec<(f64, f64)> = (range.first.max(1)..=range.last)
            .flat_map(|band| self.bands[band - 1].clone())
            .map(|j| {
                let excess = (self.ratio[1][j] - 1.0).max(0.0) * self.noise[j];
                (
                    self.hz(j),
                    excess * integrated.map_or(1.0, |step_s| self.integral(j, step_s)),
                )
            })
            .collect();
        let total: f64 = parts.iter().map(|part| part.1).sum();
        let alike = |lag_s: f64| parts.iter().map(|(hz, x)| x * libm::cos(TAU * hz * lag_s)).sum::<f64>() / total;
        let row_s = 0.5 / self.hz(self.noise.len() - 1);
        let mut lag_s = row_s;
        while total > 0.0 && lag_s < 0.5 * BLOCK_S {
            if alike(lag_s) < (-1.0_f64).exp() {
                return (lag_s > 2.0 * row_s).then_some(lag_s);
            }
            lag_s += row_s.max(0.02 * lag_s);
        }
        (total > 0.0).then_some(0.5 * BLOCK_S)
    }
}

/// A third of an octave each, from the reciprocal of a block on; at least one frequency.
fn bands(step_hz: f64, count: usize, block_s: f64) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let first = ((0.5 / block_s / step_hz).ceil() as usize).max(1) - 1;
    let mut start = first;
    let mut upper_hz = 1.5 / block_s;
    while start < count {
        let end = ((upper_hz / step_hz) as usize).clamp(start, count);
        if end > start {
            found.push(start..end);
            start = end;
        }
        upper_hz *= (1.0 / PER_OCTAVE).exp2();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    const STEP_S: f64 = 0.004;

    /// White noise of deviation 1 and what is added to it, of 90 s.
    fn of(add: impl Fn(f64) -> f64) -> Spectrum {
        let mut noise = NormalStream::new(3, "spectrum");
        let r: Vec<f64> = (0..22_500)
            .map(|k| noise.sample() + add(STEP_S * f64::from(k)))
            .collect();
        of_rows(&r)
    }

    fn of_rows(r: &[f64]) -> Spectrum {
        let blocks = whole_blocks(&vec![true; r.len()], 1250);
        Spectrum::of(r, &blocks, Covariance::white(1.0), STEP_S).unwrap()
    }

    #[test]
    fn val_noise_has_no_range_no_line_and_its_own_size() {
        let noise = of(|_| 0.0);
        assert_eq!(
            (noise.range(), noise.line(), noise.quiet_above_hz()),
            (None, None, None)
        );
        let (size, expected) = noise.size(None, None);
        assert!(
            (size - 1.0).abs() < 0.02 && (expected - 1.0).abs() < 0.01,
            "{size} {expected}"
        );
    }

    #[test]
    fn val_a_wave_is_a_line_of_its_amplitude() {
        let spectrum = of(|t| 0.5 * libm::sin(TAU * 83.3 * t));
        let (hz, width) = spectrum.line().unwrap();
        assert!((hz - 83.3).abs() < 0.2 && width < 1.0, "{hz} {width}");
        let range = spectrum.range().unwrap();
        assert!(range.low_hz < 83.0 && range.high_hz > 83.6 && range.high_hz < 1.4 * range.low_hz);
        // A range of some 20 of 125 Hz holds that share of the noise as well.
        let (size, noise) = spectrum.size(Some(&range), None);
        assert!(
            ((size * size - noise * noise).sqrt() - 0.5 / 2.0_f64.sqrt()).abs() < 0.03,
            "{size} {noise}"
        );
    }

    #[test]
    fn val_a_coloured_error_has_its_range_and_its_correlation_time() {
        let mut noise = NormalStream::new(5, "coloured");
        let mut state = 0.0;
        let keep = libm::exp(-STEP_S / 0.1);
        let r: Vec<f64> = (0..22_500)
            .map(|_| {
                state = keep * state + (1.0 - keep * keep).sqrt() * noise.sample();
                state + noise.sample()
            })
            .collect();
        let spectrum = of_rows(&r);
        let range = spectrum.range().unwrap();
        assert!(
            range.low_hz < 0.3 && range.high_hz > 1.5 && range.high_hz < 12.0 && !range.flat,
            "{range:?}"
        );
        let seconds = spectrum.correlation_s(&range, None).unwrap();
        assert!((0.06..0.2).contains(&seconds), "{seconds}");
        assert_eq!(spectrum.line(), None);
    }

    #[test]
    fn val_more_noise_than_assumed_is_flat() {
        let mut noise = NormalStream::new(6, "loud");
        let r: Vec<f64> = (0..22_500).map(|_| 1.6 * noise.sample()).collect();
        let range = of_rows(&r).range().unwrap();
        assert!(range.flat, "{range:?}");
    }

    #[test]
    fn val_a_low_pass_leaves_less_than_noise_above_its_corner() {
        let mut noise = NormalStream::new(7, "filtered");
        let mut state = 0.0;
        let keep = libm::exp(-TAU * 10.0 * STEP_S);
        let r: Vec<f64> = (0..22_500)
            .map(|_| {
                state = keep * state + (1.0 - keep) * noise.sample();
                state
            })
            .collect();
        let corner = of_rows(&r).quiet_above_hz().unwrap();
        assert!((8.0..16.0).contains(&corner), "{corner}");
    }

    #[test]
    fn prop_what_one_half_alone_has_is_not_said() {
        let spectrum = of(|t| {
            let shown = ((t / BLOCK_S) as usize).is_multiple_of(2);
            if shown { libm::sin(TAU * 20.0 * t) } else { 0.0 }
        });
        assert_eq!((spectrum.range(), spectrum.line()), (None, None));
    }
}
