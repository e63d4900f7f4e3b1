//! How well the model has explained this flight so far, and thus what evidence against a rotor is worth.
//!
//! A vehicle that differs from the model, or weather that the calibration did not have, shows before it imitates a
//! loss: innovations e of the wrench filter are larger than their variance s predicts. The measure is their surprise q,
//! the mean of e²/s over four axes and four blocks (1 where the model holds; up to 3.7 within a minute in 179 of 180
//! flights of a known vehicle), and its maximum over the last minute. Surprise that a lasting loss explains, and that
//! of the second before it was found, does not count.

use std::collections::VecDeque;

/// Blocks per mean: a quarter of a second.
const BLOCKS: usize = 4;
/// Most recent blocks, which may belong to the fault about to be found: a second.
const LATEST: usize = 16;
/// Blocks that are remembered: a minute, and the latest.
const REMEMBERED: usize = 960 + LATEST;
/// The model has proved itself after this many blocks with verdicts, 5 s: a calibration seldom has the manoeuvres of
/// the flight.
const PROOF: usize = 80;
/// Largest surprise of a model that holds.
const MOST: f64 = 4.0;

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct Trust {
    /// The last blocks, fewer than [`BLOCKS`] at first.
    blocks: VecDeque<f64>,
    /// Means over the last blocks.
    past: VecDeque<f64>,
    /// Blocks with verdicts.
    decided: usize,
    /// Blocks since an episode began.
    episode: usize,
}

impl Trust {
    /// Starts from a calibration with these surprises.
    pub(super) fn calibrated(surprises: &[f64]) -> Self {
        let mut trust = Self::default();
        for surprise in surprises {
            trust.take(*surprise);
        }
        trust.decided = 0;
        trust
    }

    /// Adds the surprise of a block: mean of e²/s over the axes.
    pub(super) fn take(&mut self, surprise: f64) {
        self.blocks.push_back(surprise);
        self.decided += 1;
        self.episode += 1;
        if self.blocks.len() > BLOCKS {
            self.blocks.pop_front();
        }
        if self.blocks.len() == BLOCKS {
            self.past.push_back(self.now());
        }
        if self.past.len() > REMEMBERED {
            self.past.pop_front();
        }
    }

    /// Something was found.
    pub(super) fn begin(&mut self) {
        self.episode = 0;
    }

    /// What was found was a loss: the model did not fail.
    pub(super) fn dismiss_surprises(&mut self) {
        let kept = self.past.len().saturating_sub(self.episode + LATEST);
        self.past.truncate(kept);
    }

    /// What has been found for this many blocks was a load: the model did not fail.
    pub(super) fn forget(&mut self, blocks: usize) {
        let kept = self.past.len().saturating_sub(blocks + LATEST);
        self.past.truncate(kept);
    }

    /// Surprise of the last quarter of a second.
    pub(super) fn now(&self) -> f64 {
        self.blocks.iter().sum::<f64>() / self.blocks.len().max(1) as f64
    }

    /// The model has explained the flight since the calibration.
    pub(super) fn is_kept(&self) -> bool {
        self.worst() <= 1.0
    }

    /// The model had explained the flight until this many blocks ago.
    pub(super) fn is_kept_before(&self, blocks: usize) -> bool {
        let counted = self.past.len().saturating_sub(blocks + LATEST);
        self.past.range(..counted).all(|q| *q <= MOST)
    }

    /// The flight has been long enough to decide.
    pub(super) fn is_proven(&self) -> bool {
        self.decided >= PROOF
    }

    /// Largest surprise of the last minute relative to that of a model that holds.
    pub(super) fn worst(&self) -> f64 {
        let counted = self.past.len().saturating_sub(LATEST);
        self.past.range(..counted).fold(0.0, |most: f64, q| most.max(*q)) / MOST
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(trust: &mut Trust, blocks: usize, surprise: f64) {
        for _ in 0..blocks {
            trust.take(surprise);
        }
    }

    #[test]
    fn val_trust_is_proven_and_lost_for_a_minute() {
        let mut trust = Trust::calibrated(&[1.0; 80]);
        assert!(trust.is_kept() && !trust.is_proven());
        flown(&mut trust, PROOF, 1.0);
        assert!(trust.is_kept() && trust.is_proven());
        flown(&mut trust, BLOCKS, 8.0);
        assert!(trust.is_kept(), "that may be what is about to be found");
        flown(&mut trust, LATEST, 1.0);
        assert!(!trust.is_kept());
        assert!((trust.worst() - 2.0).abs() < 1e-9, "{}", trust.worst());
        flown(&mut trust, REMEMBERED, 1.0);
        assert!(trust.is_kept());
    }

    #[test]
    fn val_a_loss_is_no_failure_of_the_model() {
        let mut trust = Trust::calibrated(&[1.0; 80]);
        flown(&mut trust, PROOF, 1.0);
        for explained in [true, false] {
            flown(&mut trust, 8, 30.0);
            trust.begin();
            flown(&mut trust, 20, 5.0);
            if explained {
                trust.dismiss_surprises();
            }
            flown(&mut trust, LATEST, 1.0);
            assert_eq!(trust.is_kept(), explained);
        }
    }
}
