//! Greedy regression of the residual on candidate terms, judged on blocks that the fit did not see.
//!
//! Residuals and terms are means over 0.1 s divided by the noise of such a mean. Products of all of them are kept for each 5 s block
//! ([`Gram`]), so that fits on some blocks and errors on others are small linear algebra. Each channel has an offset of its own, which
//! stands for the rotor biases.

use rayon::prelude::*;
use rotortwin_plant::effects::{Catalogue, EffectDocument, EffectInstance};

use super::candidate::Candidate;
use crate::estimation::columns::{LogState, in_order};
use crate::estimation::dense::Matrix;
use crate::estimation::nuisances::{self, Reach};
use crate::predict::{CHANNELS, Nuisances, PredictError, Predictor, Source};

/// Length of a mean, s.
const MEAN_S: f64 = 0.1;
/// Length of a block, s.
const BLOCK_S: f64 = 5.0;
/// Maximum number of terms.
const MOST_TERMS: usize = 3;
/// Share of the excess in the channels of a term that the term must remove on unseen blocks.
const LEAST_SHARE: f64 = 0.1;
/// Fall of chi² on unseen blocks that a term must bring: chance brings about 1.
const LEAST_FALL: f64 = 30.0;
/// Of terms within this share of the best, the earliest is chosen.
const NEARLY: f64 = 0.005;
/// Share of the initial failure that each further term must remove on unseen blocks.
const LEAST_OF_ALL: f64 = 0.02;
/// Excess of the means of a channel over noise, in variances, above which the channel fails.
const FAILS: f64 = 1.3;
/// Least share of its square that a term must have independently of the others.
const LEAST_OF_OWN: f64 = 1e-6;
/// Step of the difference quotient for the effect of a term, in the noise of one mean of the channel where it shows
/// most.
const STEP_NOISES: f64 = 10.0;

/// Residual of one log, in means.
pub(super) struct Regression {
    predictor: Predictor,
    fitted: Nuisances,
    /// First row of each mean.
    starts: Vec<usize>,
    rows: usize,
    /// Means of the residual over their noise, by channel; empty where there is none.
    residual: [Vec<f64>; CHANNELS],
    noise: [f64; CHANNELS],
}

impl Regression {
    pub(super) fn new(predictor: Predictor) -> Result<Self, PredictError> {
        let fitted = nuisances::fit(&LogState::new(predictor.clone()), &[], Reach::Plausible)?;
        let residuals = predictor.residuals(&fitted, &[])?;
        let step_s = predictor.series().step_s;
        let rows = ((MEAN_S / step_s).round() as usize).max(1);
        let covariances = predictor.noise().covariances(step_s);
        let noise = covariances.map(|covariance| covariance.deviation_of_mean(rows).max(f64::MIN_POSITIVE));
        let counts = |start: usize| {
            (0..CHANNELS).all(|channel| {
                let mask = &residuals.mask[channel];
                mask.is_empty() || mask[start..start + rows].iter().all(|&m| m)
            })
        };
        let starts: Vec<usize> = (0..predictor.series().len.saturating_sub(rows))
            .step_by(rows)
            .filter(|&start| counts(start))
            .collect();
        let residual = std::array::from_fn(|channel| {
            let raw = &residuals.raw[channel];
            if raw.is_empty() {
                return Vec::new();
            }
            starts
                .iter()
                .map(|&start| raw[start..start + rows].iter().sum::<f64>() / rows as f64 / noise[channel])
                .collect()
        });
        Ok(Self {
            predictor,
            fitted,
            starts,
            rows,
            residual,
            noise,
        })
    }

    pub(super) fn predictor(&self) -> &Predictor {
        &self.predictor
    }

    /// The middle of what is judged, s of the log.
    pub(super) fn middle_s(&self) -> Option<f64> {
        let series = self.predictor.series();
        let times = || self.starts.iter().map(|&start| series.time(start));
        (!self.starts.is_empty()).then(|| times().sum::<f64>() / self.starts.len() as f64)
    }

    /// Rows of a block.
    fn block_rows(&self) -> usize {
        (BLOCK_S / self.predictor.series().step_s).round() as usize
    }

    /// Blocks of this log, including those in which nothing counts.
    pub(super) fn block_count(&self) -> usize {
        self.starts.last().map_or(0, |last| last / self.block_rows() + 1)
    }

    /// Noise of a mean of a channel, in its unit; `None` where the log does not have it.
    pub(super) fn noise_of(&self, channel: usize) -> Option<f64> {
        (!self.residual[channel].is_empty()).then_some(self.noise[channel])
    }

    /// Passes block, channel and mean of every residual with some effects, in the unit of the channel, to the caller.
    ///
    /// # Errors
    /// The effects together yield an invalid vehicle.
    pub(super) fn squares(
        &self,
        catalogue: &Catalogue,
        effects: &[EffectInstance],
        mut tell: impl FnMut(usize, usize, f64),
    ) -> Result<(), PredictError> {
        let residuals = self
            .predictor
            .with_catalogue(catalogue)
            .residuals(&self.fitted, effects)?;
        for (channel, raw) in residuals.raw.iter().enumerate() {
            if self.residual[channel].is_empty() || raw.is_empty() {
                continue;
            }
            for &start in &self.starts {
                let mean = raw[start..start + self.rows].iter().sum::<f64>() / self.rows as f64;
                tell(start / self.block_rows(), channel, mean);
            }
        }
        Ok(())
    }

    /// Channels whose means vary more than their noise.
    pub(super) fn failing(&self) -> Vec<usize> {
        let fails = |channel: &usize| {
            let means = &self.residual[*channel];
            let n = means.len() as f64;
            let mean = means.iter().sum::<f64>() / n.max(1.0);
            means.iter().map(|r| (r - mean) * (r - mean)).sum::<f64>() > FAILS * n.max(1.0)
        };
        (0..CHANNELS).filter(fails).collect()
    }

    /// Squared amplitude of the residual at a frequency, and its variance, both summed over the log.
    pub(super) fn power_at(&self, channel: usize, hz: f64) -> (f64, f64) {
        let series = self.predictor.series();
        let means = &self.residual[channel];
        let n = means.len().max(1) as f64;
        let mean = means.iter().sum::<f64>() / n;
        let (mut sine, mut cosine, mut square) = (0.0, 0.0, 0.0);
        for (&start, r) in self.starts.iter().zip(means) {
            let (s, c) = libm::sincos(std::f64::consts::TAU * hz * series.time(start));
            sine += s * (r - mean);
            cosine += c * (r - mean);
            square += (r - mean) * (r - mean);
        }
        (2.0 * (sine * sine + cosine * cosine) / n, square)
    }

    /// Adds the products of this log: offsets, candidates, residual.
    pub(super) fn add_to(
        &self,
        gram: &mut Gram,
        candidates: &[Candidate],
        documents: &[EffectDocument],
        catalogue: &Catalogue,
    ) -> Result<(), PredictError> {
        debug_assert_eq!(candidates.len(), documents.len());
        let predictor = self.predictor.with_catalogue(catalogue);
        let base_set = predictor.effect_set(&self.fitted, &[])?;
        let base = predictor.predict(&base_set, Source::Smooth, None);
        let of = |document: &EffectDocument| -> Result<[Vec<f64>; CHANNELS], PredictError> {
            let column = |c: f64| -> Result<[Vec<f64>; CHANNELS], PredictError> {
                let instance = EffectInstance::new(&document.id, &[("c", c)]);
                let hooks = predictor.hooks_of(&instance)?;
                let set = predictor.effect_set(&self.fitted, &[instance])?;
                let stages = predictor.stages(base_set.constants(), set.constants(), hooks);
                let moved = predictor.predict(&set, Source::Smooth, Some((&base, stages)));
                Ok(std::array::from_fn(|channel| {
                    let (a, b) = (&moved.channels[channel], &base.channels[channel]);
                    if a == b || self.residual[channel].is_empty() {
                        return Vec::new();
                    }
                    self.starts
                        .iter()
                        .map(|&start| {
                            let sum: f64 = (start..start + self.rows).map(|k| a[k] - b[k]).sum();
                            sum / self.rows as f64 / self.noise[channel] / c
                        })
                        .collect()
                }))
            };
            // A tiny factor determines the size, a factor of that size the effect: readings are linear only over a
            // short range.
            let probe = column(1e-9)?;
            let largest =
                probe.iter().flatten().fold(
                    0.0_f64,
                    |most, x| if x.is_finite() { most.max(x.abs()) } else { f64::NAN },
                );
            if largest.is_finite() && largest > 0.0 {
                column((STEP_NOISES / largest).clamp(1e-9, 1e8))
            } else {
                Ok(std::array::from_fn(|_| Vec::new()))
            }
        };
        let columns: Vec<[Vec<f64>; CHANNELS]> = in_order(documents.par_iter().map(of))?;
        let block = self.block_rows();
        let blocks = self.block_count();
        let first = gram.blocks.len();
        gram.blocks.resize_with(first + blocks, || Block::new(gram.candidates));
        for (at, &start) in self.starts.iter().enumerate() {
            let into = &mut gram.blocks[first + start / block];
            for channel in 0..CHANNELS {
                let Some(&r) = self.residual[channel].get(at) else {
                    continue;
                };
                into.add(channel, r, |i| columns[i][channel].get(at).copied());
            }
        }
        Ok(())
    }
}

/// Products of one block, by channel.
#[derive(Debug, Clone)]
struct Block {
    channels: Vec<Products>,
}

/// Sums over the means of one channel of one block.
#[derive(Debug, Clone)]
struct Products {
    count: f64,
    residual: f64,
    square: f64,
    /// Σ x_i.
    sum: Vec<f64>,
    /// Σ x_i r.
    with_residual: Vec<f64>,
    /// Σ x_i x_j, whole matrix.
    matrix: Vec<f64>,
}

impl Block {
    fn new(candidates: usize) -> Self {
        let products = Products {
            count: 0.0,
            residual: 0.0,
            square: 0.0,
            sum: vec![0.0; candidates],
            with_residual: vec![0.0; candidates],
            matrix: Vec::new(),
        };
        Self {
            channels: vec![products; CHANNELS],
        }
    }

    fn add(&mut self, channel: usize, residual: f64, value: impl Fn(usize) -> Option<f64>) {
        let p = &mut self.channels[channel];
        p.count += 1.0;
        p.residual += residual;
        p.square += residual * residual;
        let n = p.sum.len();
        let present: Vec<(usize, f64)> = (0..n).filter_map(|i| value(i).map(|x| (i, x))).collect();
        if !present.is_empty() && p.matrix.is_empty() {
            p.matrix = vec![0.0; n * n];
        }
        for &(i, x) in &present {
            p.sum[i] += x;
            p.with_residual[i] += x * residual;
            for &(j, y) in &present {
                p.matrix[i * n + j] += x * y;
            }
        }
    }
}

/// Products of all logs, block by block.
#[derive(Debug, Clone)]
pub(super) struct Gram {
    candidates: usize,
    blocks: Vec<Block>,
}

/// What a fit does with the mean of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Offsets {
    /// Each channel has its own offset.
    Free,
    /// None, as in a model: for terms that are levels themselves.
    None,
}

/// A chosen term.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chosen {
    pub(super) candidate: usize,
    pub(super) factor: f64,
    pub(super) deviation: f64,
}

/// Sums over means of one channel: residual r and chosen terms x.
#[derive(Default)]
struct Sums {
    count: f64,
    r: f64,
    rr: f64,
    x: Vec<f64>,
    xr: Vec<f64>,
    xx: Vec<Vec<f64>>,
}

/// Factors of the chosen terms and offsets of the channels.
struct Fit {
    factors: Vec<f64>,
    offsets: [f64; CHANNELS],
}

impl Gram {
    pub(super) fn new(candidates: usize) -> Self {
        Self {
            candidates,
            blocks: Vec::new(),
        }
    }

    pub(super) fn touches(&self, candidate: usize, channel: usize) -> bool {
        let n = self.candidates;
        self.blocks.iter().any(|block| {
            let matrix = &block.channels[channel].matrix;
            !matrix.is_empty() && matrix[candidate * n + candidate] > 0.0
        })
    }

    /// Sums over some blocks of one channel.
    fn sums(&self, channel: usize, chosen: &[usize], counts: &dyn Fn(usize) -> bool) -> Sums {
        let n = self.candidates;
        let k = chosen.len();
        let mut all = Sums {
            x: vec![0.0; k],
            xr: vec![0.0; k],
            xx: vec![vec![0.0; k]; k],
            ..Sums::default()
        };
        let blocks = self.blocks.iter().enumerate().filter(|(b, _)| counts(*b));
        for p in blocks.map(|(_, block)| &block.channels[channel]) {
            all.count += p.count;
            all.r += p.residual;
            all.rr += p.square;
            for (a, &i) in chosen.iter().enumerate() {
                all.x[a] += p.sum[i];
                all.xr[a] += p.with_residual[i];
                if !p.matrix.is_empty() {
                    for (b, &j) in chosen.iter().enumerate() {
                        all.xx[a][b] += p.matrix[i * n + j];
                    }
                }
            }
        }
        all
    }

    /// Factors of terms from some blocks; `None` if these leave one undetermined.
    pub(super) fn factors(
        &self,
        chosen: &[usize],
        counts: &dyn Fn(usize) -> bool,
        offsets: Offsets,
    ) -> Option<Vec<f64>> {
        self.fit(chosen, counts, offsets).map(|fit| fit.factors)
    }

    fn fit(&self, chosen: &[usize], counts: &dyn Fn(usize) -> bool, offsets: Offsets) -> Option<Fit> {
        let k = chosen.len();
        let mut matrix = Matrix::zero(k);
        let mut gradient = vec![0.0; k];
        let mut means = Vec::new();
        for channel in 0..CHANNELS {
            let Sums {
                count, r, x, xr, xx, ..
            } = self.sums(channel, chosen, counts);
            if count < 1.0 {
                means.push((0.0, vec![0.0; k]));
                continue;
            }
            if offsets == Offsets::None {
                for a in 0..k {
                    for b in 0..k {
                        *matrix.at_mut(a, b) += xx[a][b];
                    }
                    gradient[a] += xr[a];
                }
                means.push((0.0, vec![0.0; k]));
                continue;
            }
            // The offset of the channel is eliminated: products about the means.
            for a in 0..k {
                for b in 0..k {
                    *matrix.at_mut(a, b) += xx[a][b] - x[a] * x[b] / count;
                }
                gradient[a] += xr[a] - x[a] * r / count;
            }
            means.push((r / count, x.iter().map(|x| x / count).collect()));
        }
        // None: a term that never varies, or that the others determine already.
        let factors = matrix.cholesky_above(LEAST_OF_OWN)?.solve(&gradient);
        let offsets = std::array::from_fn(|channel| {
            let (r, x) = &means[channel];
            r - factors.iter().zip(x).map(|(c, x)| c * x).sum::<f64>()
        });
        Some(Fit { factors, offsets })
    }

    /// chi² and count of the means of some channels on some blocks.
    fn error(&self, chosen: &[usize], fit: &Fit, counts: &dyn Fn(usize) -> bool, channels: &[usize]) -> (f64, f64) {
        let (mut chi2, mut n) = (0.0, 0.0);
        for &channel in channels {
            let Sums {
                count,
                r,
                rr,
                x,
                xr,
                xx,
            } = self.sums(channel, chosen, counts);
            let o = fit.offsets[channel];
            let c = &fit.factors;
            let mut sum = rr - 2.0 * o * r + o * o * count;
            for a in 0..chosen.len() {
                sum += -2.0 * c[a] * xr[a] + 2.0 * o * c[a] * x[a];
                for b in 0..chosen.len() {
                    sum += c[a] * c[b] * xx[a][b];
                }
            }
            chi2 += sum;
            n += count;
        }
        (chi2, n)
    }

    /// chi² on unseen blocks, both ways, of some channels.
    fn unseen(&self, chosen: &[usize], channels: &[usize]) -> Option<(f64, f64)> {
        let mut all = (0.0, 0.0);
        for parity in [0, 1] {
            let fitted = |b: usize| b % 2 == parity;
            let tested = |b: usize| b % 2 != parity;
            let fit = self.fit(chosen, &fitted, Offsets::Free)?;
            let (chi2, n) = self.error(chosen, &fit, &tested, channels);
            all = (all.0 + chi2, all.1 + n);
        }
        Some(all)
    }

    /// The term that explains most on unseen blocks in addition to those chosen, if it explains enough; none of the
    /// rejected ones.
    pub(super) fn next(&self, taken: &[usize], refused: &[usize]) -> Option<usize> {
        let all: Vec<usize> = (0..CHANNELS).collect();
        if taken.len() >= MOST_TERMS {
            return None;
        }
        let own_of = |i: usize| -> Vec<usize> { (0..CHANNELS).filter(|&channel| self.touches(i, channel)).collect() };
        let (before, _) = self.unseen(taken, &all)?;
        let with = |i: usize| -> Vec<usize> { taken.iter().copied().chain([i]).collect() };
        let falls: Vec<f64> = (0..self.candidates)
            .map(|i| {
                let usable = !taken.contains(&i) && !refused.contains(&i) && !own_of(i).is_empty();
                let after = usable.then(|| self.unseen(&with(i), &all)).flatten();
                after.map_or(0.0, |(after, _)| before - after)
            })
            .collect();
        let most = falls.iter().copied().fold(0.0, f64::max);
        let best = falls
            .iter()
            .position(|&fall| fall > 0.0 && fall >= (1.0 - NEARLY) * most)?;
        let own = own_of(best);
        let (start, n) = self.unseen(&[], &own)?;
        let (now, _) = self.unseen(taken, &own)?;
        let (after, _) = self.unseen(&with(best), &own)?;
        let least = (LEAST_SHARE * (now - n))
            .max(LEAST_OF_ALL * (start - n))
            .max(LEAST_FALL);
        (now - after >= least).then_some(best)
    }

    /// Terms with factors and deviations from all blocks.
    pub(super) fn fitted(&self, terms: &[usize], offsets: Offsets) -> Vec<Chosen> {
        let Some(fit) = self.fit(terms, &|_| true, offsets) else {
            return Vec::new();
        };
        let deviations = self.jackknife(terms, &fit.factors, offsets);
        terms
            .iter()
            .zip(fit.factors)
            .zip(deviations)
            .map(|((&candidate, factor), deviation)| Chosen {
                candidate,
                factor,
                deviation,
            })
            .collect()
    }

    /// Deviation of each factor from fits that leave out one block each.
    fn jackknife(&self, chosen: &[usize], whole: &[f64], offsets: Offsets) -> Vec<f64> {
        let n = self.blocks.len();
        let mut squares = vec![0.0; chosen.len()];
        for left_out in 0..n {
            if let Some(fit) = self.fit(chosen, &|b| b != left_out, offsets) {
                for ((square, c), whole) in squares.iter_mut().zip(fit.factors).zip(whole) {
                    *square += (c - whole) * (c - whole);
                }
            }
        }
        let share = (n as f64 - 1.0).max(0.0) / n.max(1) as f64;
        squares.into_iter().map(|square| (share * square).sqrt()).collect()
    }

    /// Correlation of the residual with a term over the channels that it acts on.
    pub(super) fn correlation(&self, candidate: usize) -> f64 {
        self.correlation_in(candidate, &(0..CHANNELS).collect::<Vec<_>>())
            .unwrap_or(0.0)
    }

    fn correlation_in(&self, candidate: usize, channels: &[usize]) -> Option<f64> {
        let (mut xr, mut xx, mut rr) = (0.0, 0.0, 0.0);
        for &channel in channels.iter().filter(|&&channel| self.touches(candidate, channel)) {
            let own = self.sums(channel, &[candidate], &|_| true);
            xr += own.xr[0] - own.x[0] * own.r / own.count;
            xx += own.xx[0][0] - own.x[0] * own.x[0] / own.count;
            rr += own.rr - own.r * own.r / own.count;
        }
        (xx * rr > 0.0).then(|| xr / (xx * rr).sqrt())
    }

    /// The candidate most correlated with a channel's residual, among those requested.
    pub(super) fn best_correlate(&self, channel: usize, asked: impl Fn(usize) -> bool) -> Option<(usize, f64)> {
        (0..self.candidates)
            .filter(|&i| asked(i))
            .filter_map(|i| Some((i, self.correlation_in(i, &[channel])?)))
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
    }
}
