//! Confirmation of proposed terms by prediction: each is kept only if the model with it predicts held-out blocks
//! better, by the errors that a comparison shows.
//!
//! The regression gives every channel an offset of its own. A model has none, so a term whose mean the offset absorbed
//! makes a prediction worse: such a term is detected here, and not proposed. Factors come from the even blocks for the
//! odd ones, and vice versa. A term is kept if the error of a quantity or channel falls by more than its blocks
//! scatter, and that of no quantity or channel rises. With a factor that is the same on all blocks, half of that
//! scatter is sufficient.

use rotortwin_plant::effects::{Catalogue, EffectDocument, EffectInstance};

use super::regression::{Gram, Offsets, Regression};
use crate::estimation::parameters::QUANTILE_95;
use crate::estimation::unseen::{BlockErrors, HeldOutError, QUANTITIES, change, kind_of, square};
use crate::predict::{CHANNELS, NAMES, PredictError};

/// Terms that may be refused before the search ends.
const MOST_REFUSED: usize = 10;

/// Deviations over the blocks from which a factor is not chance.
const CERTAIN: f64 = 5.0;
/// Deviations of the blocks' scatter by which an error must fall even then.
const LEAST_DEVIATIONS: f64 = 1.5;

/// What was proved.
pub(super) struct Proved {
    /// Candidates that hold, in the order in which they were taken.
    pub(super) kept: Vec<usize>,
    /// Share of the excess error in the channels of each term that it and those before it remove.
    pub(super) shares: Vec<f64>,
    /// Errors of the quantities without and with all that is kept.
    pub(super) held_out: Vec<HeldOutError>,
}

/// Errors of each channel on each block, of the logs one after the other.
type Blocks = [Vec<BlockErrors>; CHANNELS];

/// What a proof works on.
pub(super) struct Proof<'a> {
    pub(super) regressions: &'a [Regression],
    pub(super) gram: &'a Gram,
    /// A document for each candidate, with the factor `c`.
    pub(super) documents: &'a [EffectDocument],
    pub(super) catalogue: &'a Catalogue,
    /// Candidates that shift a mean: the thrust, and where and how it turns the vehicle.
    pub(super) levels: &'a [usize],
}

impl Proof<'_> {
    /// Levels first, then the terms that the regression selects, one after the other: those that hold.
    ///
    /// # Errors
    /// The terms together yield an invalid vehicle.
    pub(super) fn run(&self) -> Result<Proved, PredictError> {
        let nothing = self.blocks(&[])?.unwrap_or_default();
        let mut proved = Proved {
            kept: Vec::new(),
            shares: Vec::new(),
            held_out: Vec::new(),
        };
        let mut before = nothing.clone();
        for &level in self.levels {
            self.keep_if_it_holds(level, &nothing, &mut before, &mut proved)?;
        }
        let levels = proved.kept.len();
        let mut refused = self.levels.to_vec();
        while refused.len() < self.levels.len() + MOST_REFUSED {
            // The offsets of the regression represent the levels.
            let Some(term) = self.gram.next(&proved.kept[levels..], &refused) else {
                break;
            };
            if !self.keep_if_it_holds(term, &nothing, &mut before, &mut proved)? {
                refused.push(term);
            }
        }
        self.without_trifles(&nothing, proved)
    }

    /// Drops the terms that a later one has left without a size: a term that may be 0 is not a finding.
    fn without_trifles(&self, nothing: &Blocks, proved: Proved) -> Result<Proved, PredictError> {
        let mut kept = proved.kept.clone();
        loop {
            let fitted = self.gram.fitted(&kept, self.offsets(&kept));
            let Some(place) = fitted
                .iter()
                .position(|one| one.factor.abs() < QUANTILE_95 * one.deviation)
            else {
                break;
            };
            kept.remove(place);
        }
        if kept == proved.kept {
            return Ok(proved);
        }
        let mut rest = Proved {
            kept: Vec::new(),
            shares: Vec::new(),
            held_out: Vec::new(),
        };
        for end in 1..=kept.len() {
            let Some(after) = self.blocks(&kept[..end])? else {
                return Ok(rest);
            };
            let channels = self.of_channels(nothing, &after);
            let quantities = self.of_quantities(nothing, &after);
            if channels.iter().chain(&quantities).any(HeldOutError::rises) {
                return Ok(rest);
            }
            rest.shares.push(self.share(kept[end - 1], nothing, &after));
            rest.kept = kept[..end].to_vec();
            rest.held_out = quantities;
        }
        Ok(rest)
    }

    /// Accepts a term if the model that contains it, in addition to what is kept, predicts unseen blocks better.
    fn keep_if_it_holds(
        &self,
        term: usize,
        nothing: &Blocks,
        before: &mut Blocks,
        proved: &mut Proved,
    ) -> Result<bool, PredictError> {
        let trial: Vec<usize> = proved.kept.iter().copied().chain([term]).collect();
        let Some(after) = self.blocks(&trial)? else {
            return Ok(false);
        };
        let channels = self.of_channels(before, &after);
        let quantities = self.of_quantities(before, &after);
        let all = || channels.iter().chain(&quantities);
        // The trend of a supply shows at the ends of a flight, so its blocks scatter as much as they gain. It is
        // accepted if its factor is the same on all of them.
        let certain = self.is_certain(&trial);
        let falls = |error: &HeldOutError| {
            error.falls()
                || (certain
                    && error.is_smaller()
                    && error.before - error.after > LEAST_DEVIATIONS * error.change_deviation)
        };
        if !all().any(falls) || all().any(HeldOutError::rises) {
            return Ok(false);
        }
        proved.shares.push(self.share(term, nothing, &after));
        proved.kept = trial;
        proved.held_out = self.of_quantities(nothing, &after);
        *before = after;
        Ok(true)
    }

    /// True if the factor of the last term is clearly none by chance, over the blocks left out one by one.
    fn is_certain(&self, terms: &[usize]) -> bool {
        let fitted = self.gram.fitted(terms, self.offsets(terms));
        fitted
            .last()
            .is_some_and(|last| last.factor.abs() > CERTAIN * last.deviation && last.deviation > 0.0)
    }

    /// With a level among the terms, no offset replaces it.
    pub(super) fn offsets(&self, terms: &[usize]) -> Offsets {
        if terms.iter().any(|term| self.levels.contains(term)) {
            Offsets::None
        } else {
            Offsets::Free
        }
    }

    /// The errors on every block, by the factors of the blocks of the other parity. `None` where those leave a factor open.
    fn blocks(&self, terms: &[usize]) -> Result<Option<Blocks>, PredictError> {
        let mut all: Blocks = Default::default();
        for parity in [0, 1] {
            let factors = if terms.is_empty() {
                Vec::new()
            } else {
                match self
                    .gram
                    .factors(terms, &|block| block % 2 == parity, self.offsets(terms))
                {
                    Some(factors) => factors,
                    None => return Ok(None),
                }
            };
            let instances: Vec<EffectInstance> = terms
                .iter()
                .zip(&factors)
                .map(|(&term, &factor)| EffectInstance::new(&self.documents[term].id, &[("c", factor)]))
                .collect();
            let mut first = 0;
            for regression in self.regressions {
                let count = regression.block_count();
                for blocks in &mut all {
                    blocks.resize(first + count, BlockErrors::new());
                }
                regression.squares(self.catalogue, &instances, |block, channel, mean| {
                    if (first + block) % 2 != parity {
                        all[channel][first + block].push(mean);
                    }
                })?;
                first += count;
            }
        }
        Ok(Some(all))
    }

    /// Mean square of what noise alone leaves of a channel, over the logs that have it.
    fn noise_square(&self, channel: usize) -> Option<f64> {
        let of = |r: &Regression| r.noise_of(channel);
        let all: Vec<f64> = self.regressions.iter().filter_map(of).map(|n| n * n).collect();
        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    }

    fn of_channels(&self, before: &Blocks, after: &Blocks) -> Vec<HeldOutError> {
        (0..CHANNELS)
            .filter_map(|channel| {
                let noise = self.noise_square(channel)?.sqrt();
                change(NAMES[channel], "", &before[channel], &after[channel], noise)
            })
            .collect()
    }

    fn of_quantities(&self, before: &Blocks, after: &Blocks) -> Vec<HeldOutError> {
        let Some(first) = self.regressions.first() else {
            return Vec::new();
        };
        let joined = |blocks: &Blocks, kind: usize| -> Vec<BlockErrors> {
            let mut joined = vec![BlockErrors::new(); blocks[0].len()];
            for channel in 0..CHANNELS {
                if let Some((_, scale)) = kind_of(first.predictor(), channel).filter(|(of, _)| *of == kind) {
                    for (all, own) in joined.iter_mut().zip(&blocks[channel]) {
                        all.extend(own.iter().map(|x| scale * x));
                    }
                }
            }
            joined
        };
        QUANTITIES
            .iter()
            .enumerate()
            .filter_map(|(kind, (quantity, unit))| {
                let own = (0..CHANNELS).filter_map(|channel| {
                    let (of, scale) = kind_of(first.predictor(), channel)?;
                    (of == kind).then_some(scale * scale * self.noise_square(channel)?)
                });
                let noises: Vec<f64> = own.collect();
                let noise = (noises.iter().sum::<f64>() / noises.len().max(1) as f64).sqrt();
                change(quantity, unit, &joined(before, kind), &joined(after, kind), noise)
            })
            .collect()
    }

    /// Share of the excess over noise that is gone, over the channels that a term acts on.
    fn share(&self, term: usize, before: &Blocks, after: &Blocks) -> f64 {
        let (mut old, mut new) = (0.0, 0.0);
        for channel in (0..CHANNELS).filter(|&channel| self.gram.touches(term, channel)) {
            let Some(noise) = self.noise_square(channel) else {
                continue;
            };
            let excess = |blocks: &Blocks| {
                blocks[channel]
                    .iter()
                    .map(|block| square(block) / noise - block.len() as f64)
                    .sum::<f64>()
            };
            old += excess(before);
            new += excess(after);
        }
        if old > 0.0 {
            (1.0 - new / old).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}
