//! Hypotheses "a rotor changed its thrust by Δ at that time", for every rotor, any Δ and a set of onset times at once.
//!
//! Generalised likelihood ratio of a change in a linear system (Willsky and Jones): the filters of [`super::axis_filter`] do not model
//! the change, so their innovations carry its known signature. Per onset time and axis, three things are kept: the error that a unit
//! of lost thrust leaves in the filter's states (which determines the signature of the next innovation), the correlation of innovations
//! with signatures (score), and the energy of the signatures (information). A loss Δ on rotor i enters axis a with −F_ai Δ; so for
//! every rotor
//!
//! N = −Σ_a F_ai score_a,  C = Σ_a F_ai² information_a,   Δ̂ = N/C,   ln L(Δ)/L(0) = Δ N − ½ Δ² C
//!
//! An alternative hypothesis is a *jump* of the momentum itself, of any size on every axis: a sensor shift, a knock, or a brief model
//! error in a hard manoeuvre. Its signature is that of an impulse; whatever it explains better is not a lost thrust.
//!
//! The onset times are starts of blocks: the newest few, and increasingly sparse before, a fixed number, spaced about evenly in the
//! logarithm of their age. Which of them is likeliest is enough to find a change, but not to size it: a change that
//! set in half a block from the supposed time is off by a tenth, for good, as the filters forget. So the onset is then placed
//! between two neighbouring ones ([`OnsetHypotheses::between_blocks`]). Limits: one change at a time; a change is a step through the rotor lag.

use super::axis_filter::{DEFECT, GUST, Innovation, STATES};
use super::defect::AXES;
use super::observation::Observation;

/// Rotors evaluated at a time: as many `f32` as fit any vector register.
pub(super) const LANES: usize = 4;

/// Onset times under test.
const MOMENTS: usize = 18;

/// Newest onset times, of which none is dropped: a fault that is found at once has its neighbours.
const NEWEST: usize = 5;

/// Blocks after which a step has settled through the rotor lag.
const SETTLED: usize = 16;

/// Keeps the division finite while there is no information yet, 1/N².
const LEAST_INFORMATION: f32 = 1e-9;

/// Onset of a hypothesis that there is not; four years of blocks away.
const NO_BLOCK: u32 = u32::MAX;

/// Signatures of two moments whose 1 − r², with the correlation r, is smaller are the same one to an `f32`.
const LEAST_INDEPENDENCE: f32 = 1e-4;

/// A later onset time must be likelier by this much to be preferred, nats: within the first window, a small early fault and a large
/// late one look alike.
const LATER_MARGIN: f32 = 2.0;

/// Inputs of one block to every signature; the axes are contiguous for vector registers.
struct BlockRows {
    phi: [[f32; AXES]; STATES],
    gain: [[f32; AXES]; STATES],
    value: [f32; AXES],
    evidence: [f32; AXES],
    correlation: f32,
}

/// One signature on every axis.
#[derive(Clone, Copy, Debug, Default)]
struct Signature {
    /// True state minus estimated state per unit of the hypothesised change; one row per state, one column per axis.
    error: [[f32; AXES]; STATES],
    score: [f32; AXES],
    information: [f32; AXES],
}

impl Signature {
    const BLANK: Self = Self {
        error: [[0.0; AXES]; STATES],
        score: [0.0; AXES],
        information: [0.0; AXES],
    };

    /// [`free_fit`] of this signature.
    #[inline]
    fn free_fit(&self) -> [f32; AXES] {
        free_fit(&self.score, &self.information)
    }

    /// Updates with the innovations of one block.
    ///
    /// * `input`: what the hypothesis adds to the defect in this block, per unit
    ///
    /// Returns the signature of the block's innovations.
    #[inline]
    fn update(&mut self, input: f32, block: &BlockRows) -> [f32; AXES] {
        let mut signature = self.error[DEFECT];
        for axis in 0..AXES {
            signature[axis] += input;
        }
        for j in 1..STATES {
            for axis in 0..AXES {
                signature[axis] += block.phi[j][axis] * self.error[j][axis];
            }
        }
        self.error[DEFECT] = signature;
        for axis in 0..AXES {
            self.error[GUST][axis] *= block.correlation;
            let weighted = signature[axis] * block.evidence[axis];
            self.score[axis] += weighted * block.value[axis];
            self.information[axis] += weighted * signature[axis];
        }
        for j in 0..STATES {
            for axis in 0..AXES {
                self.error[j][axis] -= block.gain[j][axis] * signature[axis];
            }
        }
        signature
    }

    /// N and C of the module documentation, for a wrench of a direction.
    #[inline]
    fn along(&self, direction: &[f32; AXES]) -> [f32; 2] {
        let mut sums = [0.0, LEAST_INFORMATION];
        for axis in 0..AXES {
            sums[0] -= direction[axis] * self.score[axis];
            sums[1] += direction[axis] * direction[axis] * self.information[axis];
        }
        sums
    }

    /// Error of one axis.
    fn error_of(&self, axis: usize) -> [f32; STATES] {
        let mut error = [0.0; STATES];
        for j in 0..STATES {
            error[j] = self.error[j][axis.min(AXES - 1)];
        }
        error
    }
}

/// ln of the likelihood ratio of every axis, each at its best size, nats.
#[inline]
fn free_fit(score: &[f32; AXES], information: &[f32; AXES]) -> [f32; AXES] {
    let mut fit = [0.0; AXES];
    for axis in 0..AXES {
        fit[axis] = 0.5 * score[axis] * score[axis] / information[axis].max(LEAST_INFORMATION);
    }
    fit
}

/// One onset time.
#[derive(Clone, Copy, Debug, Default)]
struct Moment {
    /// First block in which a change can appear.
    block: u32,
    /// Per unit of wrench lost since then.
    loss: Signature,
    /// Per unit of instantaneous momentum.
    jump: Signature,
    /// Σ of the products of this loss's signatures and those of the moment before, weighted like the information.
    shared: [f32; AXES],
}

impl Moment {
    const BLANK: Self = Self {
        block: 0,
        loss: Signature::BLANK,
        jump: Signature::BLANK,
        shared: [0.0; AXES],
    };
}

/// An onset time, which may lie between two moments under test.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Onset {
    /// Index of the moment at or before it.
    pub index: usize,
    /// Part of the way to the next moment, 0 to 1.
    later: f32,
    /// Squared relative standard deviation of a loss of that time, from not knowing the time any better.
    pub relative_variance: f32,
}

impl Onset {
    /// At one of the moments under test.
    pub(super) const fn at(index: usize) -> Self {
        Self {
            index,
            later: 0.0,
            relative_variance: 0.0,
        }
    }

    /// True if sizes for the two times differ by half a per cent at most.
    pub(super) fn is_close_to(&self, other: &Self) -> bool {
        self.index == other.index && (self.later - other.later).abs() < 0.03
    }
}

/// Combined evidence of all onset times about one rotor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence {
    /// ln of the likelihood ratio against no change, at the best onset time and size, nats.
    pub log_likelihood: f32,
    /// Δ̂, N; negative if thrust recovered.
    pub loss: f32,
    /// Index of the onset time.
    pub index: usize,
}

impl Evidence {
    pub(super) const NONE: Self = Self {
        log_likelihood: 0.0,
        loss: 0.0,
        index: 0,
    };
}

/// Combined evidence of all onset times for an effect of arbitrary size on every axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct FreeEvidence {
    /// ln of the likelihood ratio against nothing, at the best onset time and sizes, nats.
    pub log_likelihood: f32,
    /// The same per axis.
    pub axis: [f32; AXES],
    /// Index of the onset time.
    pub index: usize,
}

/// How well a loss of one rotor fits the innovations; axes that a jump explains better do not count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    /// Log likelihood gained by the loss, nats.
    pub explained: f32,
    /// Further gain from lasting forces and torques of any direction, nats.
    pub unexplained: f32,
}

/// See the module documentation.
#[derive(Clone, Copy, Debug)]
pub(super) struct OnsetHypotheses {
    moment: [Moment; MOMENTS],
    count: usize,
    /// Onsets of the best loss, jump and push, which thinning leaves alone.
    leading: [u32; 3],
    block: u32,
    /// Change of the mean momentum per unit of lost wrench, block by block after the onset, s.
    response: [f32; SETTLED],
}

impl OnsetHypotheses {
    /// Before [`OnsetHypotheses::configure`].
    pub(super) const BLANK: Self = Self {
        moment: [Moment::BLANK; MOMENTS],
        count: 0,
        // All bits 0, as of everything before it is configured: a board has no room for an image of it in flash.
        leading: [0; 3],
        block: 0,
        response: [0.0; SETTLED],
    };

    /// * `block_period`: s   * `time_constant`: τ of the rotors, s
    pub(super) fn configure(&mut self, block_period: f32, time_constant: f32) {
        // The lost thrust is 1 − e^(−t/τ) after an onset at the start of a block, its integral t − τ(1 − e^(−t/τ)), of which each
        // block sees its mean.
        let (length, tau) = (f64::from(block_period), f64::from(time_constant));
        let mean = |block: usize| {
            let (start, end) = (block as f64 * length, (block + 1) as f64 * length);
            0.5 * (start + end) - tau + tau * tau / length * (libm::exp(-start / tau) - libm::exp(-end / tau))
        };
        // Moments past the count are never read.
        let Self {
            moment: _,
            count,
            leading,
            block: now,
            response,
        } = self;
        *count = 0;
        *leading = [NO_BLOCK; 3];
        *now = 0;
        let mut before = 0.0;
        for (block, entry) in response.iter_mut().enumerate() {
            let here = mean(block);
            *entry = (here - before) as f32;
            before = here;
        }
    }

    /// The onset time at an index, as stored in evidence.
    #[inline(always)]
    fn at(&self, index: usize) -> &Moment {
        &self.moment[index.min(MOMENTS - 1)]
    }

    /// Restarts: the model has changed.
    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds the current block as an onset time, then processes its innovations.
    ///
    /// * `evidence`: weight of each axis, 1/S or less   * `correlation`: of the gusts from block to block
    /// * `elapsed`: of the block, s   * `extra`: lost thrust beyond a step, share, see
    ///   [`super::SequentialDetector`]
    pub(super) fn update(
        &mut self,
        phi: &[[f32; STATES]; AXES],
        innovation: &[Innovation; AXES],
        evidence: &[f32; AXES],
        correlation: f32,
        elapsed: f32,
        extra: f32,
    ) {
        self.open();
        let mut block = BlockRows {
            phi: [[0.0; AXES]; STATES],
            gain: [[0.0; AXES]; STATES],
            value: [0.0; AXES],
            evidence: *evidence,
            correlation,
        };
        for axis in 0..AXES {
            block.value[axis] = innovation[axis].value;
            for j in 0..STATES {
                block.phi[j][axis] = phi[axis][j];
                block.gain[j][axis] = innovation[axis].gain[j];
            }
        }
        let mut before = [0.0; AXES];
        for moment in self.moment.iter_mut().take(self.count) {
            let age = self.block.wrapping_sub(moment.block) as usize;
            let input = self.response.get(age).copied().unwrap_or(elapsed);
            let signature = moment.loss.update(input + extra * elapsed, &block);
            for axis in 0..AXES {
                moment.shared[axis] += evidence[axis] * signature[axis] * before[axis];
            }
            before = signature;
            let impulse = if age == 0 { 1.0 } else { 0.0 };
            moment.jump.update(impulse, &block);
        }
        self.block = self.block.wrapping_add(1);
    }

    /// True for the onsets of the leading hypotheses, and for the neighbours of lasting ones, from which the time within a block is found.
    fn leads(&self, block: u32) -> bool {
        let [loss, jump, push] = self.leading;
        loss.abs_diff(block) <= 1 || push.abs_diff(block) <= 1 || jump == block
    }

    /// Makes room, and adds the current block.
    fn open(&mut self) {
        if self.count >= MOMENTS {
            // Drop the one whose neighbours are closest to each other relative to their age.
            let mut drop = 1;
            let mut least = f32::INFINITY;
            for m in 1..MOMENTS - NEWEST {
                let gap = self.moment[m + 1].block.wrapping_sub(self.moment[m - 1].block) as f32;
                let age = self.block.wrapping_sub(self.moment[m].block) as f32;
                if gap < least * (age + 1.0) && !self.leads(self.moment[m].block) {
                    least = gap / (age + 1.0);
                    drop = m;
                }
            }
            for m in drop..MOMENTS - 1 {
                self.moment[m] = self.moment[m + 1];
            }
            self.count = MOMENTS - 1;
        }
        if let Some(moment) = self.moment.get_mut(self.count) {
            *moment = Moment {
                block: self.block,
                ..Moment::BLANK
            };
        }
        self.count += 1;
    }

    /// Best onset time and size of a change of each of several rotors, evaluated together.
    ///
    /// * `column`: F of the rotors, divided by the levers; one row per axis   * `least`: smallest possible Δ of each, N: a rotor cannot
    ///   regain more than it lost
    #[inline]
    pub(super) fn evidence(&self, column: &[[f32; LANES]; AXES], least: &[f32; LANES]) -> [Evidence; LANES] {
        let (mut best, mut best_loss, mut best_index) = ([0.0; LANES], [0.0; LANES], [0u32; LANES]);
        // From the oldest to the newest.
        for (index, moment) in self.moment.iter().take(self.count).enumerate() {
            let lead = if index == 0 { 0.0 } else { LATER_MARGIN };
            let mut numerator = [0.0; LANES];
            let mut information = [LEAST_INFORMATION; LANES];
            for axis in 0..AXES {
                for k in 0..LANES {
                    numerator[k] -= column[axis][k] * moment.loss.score[axis];
                    information[k] += column[axis][k] * column[axis][k] * moment.loss.information[axis];
                }
            }
            for k in 0..LANES {
                let loss = (numerator[k] / information[k]).max(least[k]);
                let log_likelihood = loss * (numerator[k] - 0.5 * loss * information[k]);
                let better = log_likelihood > best[k] + lead;
                best[k] = if better { log_likelihood } else { best[k] };
                best_loss[k] = if better { loss } else { best_loss[k] };
                best_index[k] = if better { index as u32 } else { best_index[k] };
            }
        }
        core::array::from_fn(|k| Evidence {
            log_likelihood: best[k],
            loss: best_loss[k],
            index: best_index[k] as usize,
        })
    }

    /// Best onset time and sizes of a jump.
    pub(super) fn jump_evidence(&self) -> FreeEvidence {
        self.free_evidence(|moment| &moment.jump)
    }

    /// Best onset time and sizes of a lasting force and torque of any direction.
    pub(super) fn push_evidence(&self) -> FreeEvidence {
        self.free_evidence(|moment| &moment.loss)
    }

    fn free_evidence(&self, of: impl Fn(&Moment) -> &Signature) -> FreeEvidence {
        let mut best = FreeEvidence {
            log_likelihood: 0.0,
            axis: [0.0; AXES],
            index: 0,
        };
        for (index, moment) in self.moment.iter().take(self.count).enumerate() {
            let axis = of(moment).free_fit();
            let log_likelihood = axis.iter().sum();
            if log_likelihood > best.log_likelihood {
                best = FreeEvidence {
                    log_likelihood,
                    axis,
                    index,
                };
            }
        }
        best
    }

    /// How well a loss fits, axis by axis.
    ///
    /// * `margin`: a jump claims an axis that it explains better than the loss by this, nats, and better than any lasting push
    pub(super) fn fit(
        &self,
        loss: &Evidence,
        column: &[f32; AXES],
        jump: &FreeEvidence,
        push: &FreeEvidence,
        margin: f32,
    ) -> Fit {
        let supposed = &self.at(loss.index).loss;
        let of_any = supposed.free_fit();
        let mut fit = Fit {
            explained: 0.0,
            unexplained: 0.0,
        };
        for axis in 0..AXES {
            let lost = -column[axis] * loss.loss;
            let of_loss = lost * (supposed.score[axis] - 0.5 * lost * supposed.information[axis]);
            let jumped = jump.axis[axis] > push.axis[axis];
            if !jumped || jump.axis[axis] <= of_loss + margin {
                fit.explained += of_loss;
            }
            if !jumped || jump.axis[axis] <= of_any[axis] + margin {
                fit.unexplained += of_any[axis] - of_loss;
            }
        }
        fit
    }

    /// Blocks since the onset of a jump.
    pub(super) fn jump_age(&self, evidence: &FreeEvidence) -> u32 {
        self.block.wrapping_sub(self.at(evidence.index).block)
    }

    /// Size of a jump on one axis, N·s, and the errors of that axis's filter per unit.
    pub(super) fn jump(&self, evidence: &FreeEvidence, axis: usize) -> (f32, [f32; STATES]) {
        let jump = &self.at(evidence.index).jump;
        let size = jump.score[axis] / jump.information[axis].max(LEAST_INFORMATION);
        (size, jump.error_of(axis))
    }

    /// Sets the leading hypotheses.
    pub(super) fn set_leading(&mut self, loss: &Evidence, jump: &FreeEvidence, push: &FreeEvidence) {
        self.leading = [loss.index, jump.index, push.index].map(|index| self.at(index).block);
    }

    /// Blocks since an onset time.
    pub(super) fn age(&self, onset: &Onset) -> u32 {
        self.block.wrapping_sub(self.at(onset.index).block)
    }

    /// The likeliest onset between a moment under test and those next to it, for a lost wrench of this direction and any size.
    ///
    /// The signature of an onset between two neighbouring blocks is interpolated, S = (1 − f) S₁ + f S₂: exact once a step has settled
    /// through the rotor lag, and to a hundredth of a block before. So the losses Δ (1 − f) and Δ f that set in at both moments are fitted,
    /// and f follows. With T = S₂ − S₁, I = Σ S², X = Σ S T and K = Σ T², and f beforehand uniform over one block,
    ///
    /// var Δ̂ = 1/(I − X²/(K + 12/Δ̂²)).
    ///
    /// * `direction`: of the wrench, levers divided out; a column of F for the loss of one rotor
    #[inline(never)]
    pub(super) fn between_blocks(&self, index: usize, direction: &[f32; AXES]) -> Onset {
        let mut onset = Onset::at(index);
        let mut most = f32::NEG_INFINITY;
        for first in [index.wrapping_sub(1), index] {
            let Some(fit) = self.fit_between(first, direction) else {
                continue;
            };
            if fit.log_likelihood > most {
                most = fit.log_likelihood;
                onset = fit.onset;
            }
        }
        if most == f32::NEG_INFINITY {
            onset.relative_variance = self.variance_among(index, direction);
        }
        onset
    }

    /// Squared relative deviation of a loss whose onset lies anywhere from the moment before to the one after: a third of the square of
    /// half the difference of the losses there. For an onset whose neighbouring blocks are no longer kept.
    fn variance_among(&self, index: usize, direction: &[f32; AXES]) -> f32 {
        let loss_at = |index: usize| {
            let [numerator, information] = self.at(index).loss.along(direction);
            numerator / information
        };
        let last = self.count.saturating_sub(1);
        let (before, after) = (loss_at(index.saturating_sub(1)), loss_at((index + 1).min(last)));
        let here = loss_at(index);
        let half = 0.5 * (after - before);
        (half * half / 3.0 / (here * here).max(f32::MIN_POSITIVE)).min(1.0)
    }

    /// [`OnsetHypotheses::between_blocks`] between a moment and the next; none where these are not neighbours.
    fn fit_between(&self, first: usize, direction: &[f32; AXES]) -> Option<FitBetween> {
        let early = self.moment.get(first)?;
        let late = self
            .moment
            .get(first.wrapping_add(1))
            .filter(|_| first.wrapping_add(1) < self.count)?;
        if late.block.wrapping_sub(early.block) != 1 {
            return None;
        }
        let [of_early, of_late] = [early, late].map(|moment| moment.loss.along(direction));
        let (numerator, information) = ([of_early[0], of_late[0]], [of_early[1], of_late[1]]);
        let mut shared = 0.0;
        for axis in 0..AXES {
            shared += direction[axis] * direction[axis] * late.shared[axis];
        }
        let determinant = information[0] * information[1] - shared * shared;
        // The later of the two has seen nothing yet, or both look alike.
        if determinant <= LEAST_INDEPENDENCE * information[0] * information[1] {
            return None;
        }
        let parts = [
            (information[1] * numerator[0] - shared * numerator[1]) / determinant,
            (information[0] * numerator[1] - shared * numerator[0]) / determinant,
        ];
        let later = if parts[0] * parts[1] > 0.0 {
            parts[1] / (parts[0] + parts[1])
        } else if numerator[1] * numerator[1] * information[0] > numerator[0] * numerator[0] * information[1] {
            1.0
        } else {
            0.0
        };
        let mix = |of: [f32; 2]| of[0] + later * (of[1] - of[0]);
        let across = [
            information[0] + later * (shared - information[0]),
            shared + later * (information[1] - shared),
        ];
        let (along, numerator) = (mix(across).max(LEAST_INFORMATION), mix(numerator));
        let loss = numerator / along;
        let (mixed, slope) = (across[1] - across[0], information[0] - 2.0 * shared + information[1]);
        let explained = mixed * mixed / (slope + 12.0 / (loss * loss).max(f32::MIN_POSITIVE));
        let variance = 1.0 / (along - explained).max(LEAST_INDEPENDENCE * along) - 1.0 / along;
        Some(FitBetween {
            onset: Onset {
                index: first,
                later,
                relative_variance: variance / (loss * loss).max(f32::MIN_POSITIVE),
            },
            log_likelihood: 0.5 * numerator * loss,
        })
    }

    /// The lost wrench that the innovations show since an onset time.
    pub(super) fn observation(&self, onset: &Onset) -> Observation {
        let [score, information] = self.loss_since(onset);
        Observation::new(&score, &information)
    }

    /// ln of the likelihood ratio of every axis, each at its best size, nats.
    pub(super) fn free_fit(&self, onset: &Onset) -> [f32; AXES] {
        let [score, information] = self.loss_since(onset);
        free_fit(&score, &information)
    }

    /// Score and information of a loss since an onset time.
    fn loss_since(&self, onset: &Onset) -> [[f32; AXES]; 2] {
        let (early, late) = (self.at(onset.index), self.at(onset.index.wrapping_add(1)));
        let (of_early, of_late) = (1.0 - onset.later, onset.later);
        let mut sums = [early.loss.score, early.loss.information];
        if of_late > 0.0 {
            for axis in 0..AXES {
                sums[0][axis] = of_early * early.loss.score[axis] + of_late * late.loss.score[axis];
                sums[1][axis] = of_early * of_early * early.loss.information[axis]
                    + 2.0 * of_early * of_late * late.shared[axis]
                    + of_late * of_late * late.loss.information[axis];
            }
        }
        sums
    }

    /// Error of one axis filter per unit of wrench lost since an onset time.
    pub(super) fn error(&self, onset: &Onset, axis: usize) -> [f32; STATES] {
        let mut error = self.at(onset.index).loss.error_of(axis);
        if onset.later > 0.0 {
            let late = self.at(onset.index.wrapping_add(1)).loss.error_of(axis);
            for j in 0..STATES {
                error[j] += onset.later * (late[j] - error[j]);
            }
        }
        error
    }
}

/// See [`OnsetHypotheses::fit_between`].
struct FitBetween {
    onset: Onset,
    /// Nats.
    log_likelihood: f32,
}

#[cfg(test)]
mod tests {
    use super::super::axis_filter::{AxisFilter, Disturbance};
    use super::*;
    use std::vec::Vec;

    const BLOCK: f32 = 0.03125;

    fn disturbance() -> Disturbance {
        Disturbance {
            correlation: 0.985,
            variance: 2.5e-7,
            momentum_noise: 1e-10,
            drift: 1e-10,
            measurement: 2e-8,
        }
    }

    fn fresh() -> OnsetHypotheses {
        let mut hypotheses = OnsetHypotheses::BLANK;
        hypotheses.configure(BLOCK, 0.05);
        hypotheses
    }

    /// Evidence for one rotor, in the last lane.
    fn evidence_of(hypotheses: &OnsetHypotheses, column: &[f32; AXES]) -> Evidence {
        let mut columns = [[0.0; LANES]; AXES];
        for axis in 0..AXES {
            columns[axis][LANES - 1] = column[axis];
        }
        hypotheses.evidence(&columns, &[0.0; LANES])[LANES - 1]
    }

    /// [`run_from`] the start of block 100.
    fn run(column: &[f32; AXES], loss: f32, blocks: u32) -> OnsetHypotheses {
        run_from(0.0, column, loss, blocks)
    }

    /// Runs one filter per axis over noiseless defects with a loss from a part of block 100 on.
    fn run_from(part: f32, column: &[f32; AXES], loss: f32, blocks: u32) -> OnsetHypotheses {
        let d = disturbance();
        let mut hypotheses = fresh();
        let mut filter = [AxisFilter::new(&[1e-6, 2.5e-7, 0.01, 0.0, 0.0, 0.0, 0.0]); AXES];
        let phi = [[0.0, BLOCK, BLOCK, 0.0, 0.0, 0.0, 0.0]; AXES];
        for block in 0..blocks {
            let mut innovation = [Innovation::default(); AXES];
            let since = |start: u32| match block.checked_sub(start) {
                None => 0.0,
                Some(age) if (age as usize) < SETTLED => hypotheses.response[age as usize],
                Some(_) => BLOCK,
            };
            let input = (1.0 - part) * since(100) + part * since(101);
            for axis in 0..AXES {
                filter[axis].predict(&phi[axis], &d);
                innovation[axis] = filter[axis].update(-column[axis] * loss * input, d.measurement);
            }
            let weight = innovation.map(|i| i.information);
            hypotheses.update(&phi, &innovation, &weight, d.correlation, BLOCK, 0.0);
            let evidence = evidence_of(&hypotheses, column);
            let (jump, push) = (hypotheses.jump_evidence(), hypotheses.push_evidence());
            hypotheses.set_leading(&evidence, &jump, &push);
        }
        hypotheses
    }

    #[test]
    fn val_size_and_onset_are_found() {
        let column = [-1.0, -0.5, 0.866, 1.0];
        for blocks in [104, 110, 130] {
            let hypotheses = run(&column, 0.09, blocks);
            let evidence = evidence_of(&hypotheses, &column);
            assert!((evidence.loss / 0.09 - 1.0).abs() < 1e-3, "{evidence:?}");
            assert_eq!(hypotheses.age(&Onset::at(evidence.index)), blocks - 100);
            assert!(evidence.log_likelihood > 100.0);
            // ½ Δ² C with a perfect fit.
            let seen = hypotheses.observation(&Onset::at(evidence.index));
            let information: f32 = (0..AXES).map(|a| column[a] * column[a] / seen.variance[a]).sum();
            let want = 0.5 * 0.09 * 0.09 * information;
            assert!((evidence.log_likelihood / want - 1.0).abs() < 1e-3);
            // A rotor on the other side would have to gain thrust.
            let opposite = [-1.0, 0.5, -0.866, -1.0];
            assert!(evidence_of(&hypotheses, &opposite).log_likelihood < 0.5 * evidence.log_likelihood);
        }
    }

    #[test]
    fn val_an_onset_within_a_block_is_found() {
        let column = [-1.0, -0.5, 0.866, 1.0];
        for part in [0.2, 0.5, 0.8] {
            let hypotheses = run_from(part, &column, 0.09, 130);
            let index = evidence_of(&hypotheses, &column).index;
            let onset = hypotheses.between_blocks(index, &column);
            assert_eq!(hypotheses.age(&onset), 30);
            assert!((onset.later - part).abs() < 0.01, "{onset:?}");
            let seen = hypotheses.observation(&onset);
            for axis in 0..AXES {
                assert!(
                    (seen.wrench[axis] / (-0.09 * column[axis]) - 1.0).abs() < 3e-3,
                    "{seen:?}"
                );
            }
        }
    }

    #[test]
    fn val_loss_and_jump_are_told_apart() {
        let column = [-1.0, -0.5, 0.866, 1.0];
        let loss = run(&column, 0.09, 110);
        let (as_loss, as_jump) = (
            evidence_of(&loss, &column).log_likelihood,
            loss.jump_evidence().log_likelihood,
        );
        assert!(as_loss > 1.3 * as_jump, "{as_loss} {as_jump}");

        let d = disturbance();
        let mut jump = fresh();
        let mut filter = [AxisFilter::new(&[1e-6, 2.5e-7, 0.01, 0.0, 0.0, 0.0, 0.0]); AXES];
        let phi = [[0.0, BLOCK, BLOCK, 0.0, 0.0, 0.0, 0.0]; AXES];
        for block in 0..110 {
            let mut innovation = [Innovation::default(); AXES];
            for axis in 0..AXES {
                filter[axis].predict(&phi[axis], &d);
                let defect = if block == 100 { column[axis] * -2e-3 } else { 0.0 };
                innovation[axis] = filter[axis].update(defect, d.measurement);
            }
            let weight = innovation.map(|i| i.information);
            jump.update(&phi, &innovation, &weight, d.correlation, BLOCK, 0.0);
        }
        let evidence = jump.jump_evidence();
        assert!(evidence.log_likelihood > 1.5 * evidence_of(&jump, &column).log_likelihood);
        assert_eq!(jump.jump_age(&evidence), 10);
        assert!((jump.jump(&evidence, 0).0 / 2e-3 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn val_nothing_is_found_where_nothing_is() {
        let evidence = evidence_of(&run(&[-1.0, -0.5, 0.866, 1.0], 0.0, 200), &[-1.0, -0.5, 0.866, 1.0]);
        assert_eq!(evidence.log_likelihood, 0.0);
    }

    #[test]
    fn val_moments_thin_out_with_age() {
        let mut hypotheses = fresh();
        let phi = [[0.0; STATES]; AXES];
        for _ in 0..5000 {
            hypotheses.update(&phi, &[Innovation::default(); AXES], &[0.0; AXES], 1.0, BLOCK, 0.0);
        }
        let age: Vec<u32> = hypotheses.moment.iter().map(|m| 4999 - m.block).collect();
        assert!(age.windows(2).all(|pair| pair[0] > pair[1]));
        assert_eq!(age[MOMENTS - 1], 0);
        assert!(age[MOMENTS - 4] < 8, "{age:?}");
        assert!(age[2] > 500, "{age:?}");
    }
}
