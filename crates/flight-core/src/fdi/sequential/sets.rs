//! Which rotors explain a lost wrench: every single one and every pair, with feasible losses.
//!
//! The innovations' evidence about a change at one time is a wrench ŵ with a variance per axis ([`Observation`]). A set of rotors
//! explains it with losses Δ ≥ their lower bounds, W = −Σ F_i Δ_i, and
//!
//! ln L(set)/L(nothing) = max_Δ Σ_a (W_a ŵ_a − ½ W_a²)/V_a
//!
//! V_a contains the variance of ŵ_a and the model uncertainty proportional to the loss: the gain of the axis (as far as the filters have
//! not learnt it) and the centre of mass. So a large loss of one rotor is not mistaken for two because the inertia is a few per cent off,
//! and two are distinguished as far as the model allows.
//!
//! Geometry limits what is distinguishable. On a regular hexarotor, opposite rotors turn in opposite senses: equal losses of 1 and 4, of
//! 2 and 5, and of 3 and 6 are the same pure vertical force. On a quadrotor all pairs differ. Limits: sets of one and two rotors.

use super::defect::AXES;
use super::estimate::{MAX_HYPOTHESES, Suspects};
use super::observation::{NOTHING_KNOWN, Observation};
use super::onset::Onset;
use super::within;
use crate::MAX_ROTORS;

/// Gain over the better of its two rotors below which a pair adds nothing, nats.
const REDUNDANT_NATS: f32 = 2.0;

/// The best-fitting losses of one set of rotors.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SetFit {
    /// Zero-based; both entries equal for a single rotor.
    pub rotors: [u8; 2],
    /// N, in the order of `rotors`; the second entry is 0 for a single rotor.
    pub loss: [f32; 2],
    /// Variance of the first loss, of the second, and their covariance, N².
    pub covariance: [f32; 3],
    /// Nats.
    pub log_likelihood: f32,
    /// Further gain that any wrench could explain, nats.
    pub unexplained: f32,
    pub onset: Onset,
}

impl SetFit {
    /// True for two rotors.
    pub(super) const fn is_pair(&self) -> bool {
        self.rotors[0] != self.rotors[1]
    }

    /// Bit i set: rotor i.
    pub(super) const fn mask(&self) -> u32 {
        1 << self.rotors[0] | 1 << self.rotors[1]
    }

    /// Rotor and loss of each member.
    pub(super) fn members(&self) -> impl Iterator<Item = (usize, f32)> {
        let count = if self.is_pair() { 2 } else { 1 };
        let rotors = self.rotors.map(|rotor| within(usize::from(rotor)));
        rotors.into_iter().zip(self.loss).take(count)
    }

    /// Standard deviation of the loss of a member, N.
    pub(super) fn deviation(&self, rotor: usize) -> f32 {
        let member = usize::from(self.is_pair() && usize::from(self.rotors[1]) == rotor);
        let of_onset = self.onset.relative_variance * self.loss[member] * self.loss[member];
        libm::sqrtf(self.covariance[member].max(0.0) + of_onset)
    }

    /// A single rotor.
    fn single(observation: &Observation, rotor: usize, column: &[f32; AXES], least: f32) -> Self {
        let [numerator, information] = project(observation, column);
        let loss = (numerator / information).max(least);
        Self {
            rotors: [rotor as u8; 2],
            loss: [loss, 0.0],
            covariance: [1.0 / information, 0.0, 0.0],
            log_likelihood: loss * (numerator - 0.5 * loss * information),
            ..Self::default()
        }
    }

    /// Two rotors; the optimum over the quadrant of feasible losses.
    fn pair(observation: &Observation, rotors: [usize; 2], columns: [&[f32; AXES]; 2], least: [f32; 2]) -> Self {
        let [n0, c00] = project(observation, columns[0]);
        let [n1, c11] = project(observation, columns[1]);
        let c01: f32 = (0..AXES)
            .map(|axis| columns[0][axis] * columns[1][axis] / observation.variance[axis])
            .sum();
        let determinant = (c00 * c11 - c01 * c01).max(1e-6 * c00 * c11);
        let value = |loss: [f32; 2]| {
            loss[0] * n0 + loss[1] * n1
                - 0.5 * (c00 * loss[0] * loss[0] + c11 * loss[1] * loss[1])
                - c01 * loss[0] * loss[1]
        };
        let inner = [(c11 * n0 - c01 * n1) / determinant, (c00 * n1 - c01 * n0) / determinant];
        let loss = if inner[0] >= least[0] && inner[1] >= least[1] {
            inner
        } else {
            let first = [((n0 - c01 * least[1]) / c00).max(least[0]), least[1]];
            let second = [least[0], ((n1 - c01 * least[0]) / c11).max(least[1])];
            if value(first) >= value(second) { first } else { second }
        };
        Self {
            rotors: rotors.map(|rotor| rotor as u8),
            loss,
            covariance: [c11 / determinant, c00 / determinant, -c01 / determinant],
            log_likelihood: value(loss),
            ..Self::default()
        }
    }
}

/// Σ −F ŵ/V and Σ F²/V.
#[inline]
fn project(observation: &Observation, column: &[f32; AXES]) -> [f32; 2] {
    let mut sums = [0.0, 1.0 / NOTHING_KNOWN];
    for axis in 0..AXES {
        let weighted = column[axis] / observation.variance[axis];
        sums[0] -= weighted * observation.wrench[axis];
        sums[1] += weighted * column[axis];
    }
    sums
}

/// Requirements on a set before it is named.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demands {
    /// Lead over other sets of the same size, nats.
    pub margin: f32,
    /// What a second rotor must add, nats.
    pub second_rotor: f32,
    /// Losses below this are ignored, N.
    pub smallest_loss: f32,
    /// Change of each rotor above which it is still faulty, N; infinite for rotors not known to be faulty.
    pub heals_at: [f32; MAX_ROTORS],
    /// Bonus of sets of rotors that remain faulty, nats.
    pub repeat_bonus: f32,
}

/// Every set of one and two rotors, evaluated.
///
/// Only the likelihood of each at its better onset time is stored; losses are recomputed on demand, which takes a twelfth of the memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sets<'a> {
    observations: &'a [(Onset, Observation)],
    rotor_count: usize,
    column: &'a [[f32; AXES]; MAX_ROTORS],
    least: &'a [f32; MAX_ROTORS],
    demands: &'a Demands,
    /// Nats; the pair (first, second) is at \[second\]\[first\], a single rotor on the diagonal.
    log_likelihood: [[f32; MAX_ROTORS]; MAX_ROTORS],
    /// Bit `first` of \[second\]: likelier at the last observation than at the earlier ones.
    at_last: [u32; MAX_ROTORS],
    /// Bit `first` of \[second\]: see [`counts`].
    counts: [u32; MAX_ROTORS],
}

impl<'a> Sets<'a> {
    /// * `observations`: one or two; the onset times with their observations   * `least`: smallest possible loss of each
    ///   rotor, N
    pub(super) fn weigh(
        observations: &'a [(Onset, Observation)],
        rotor_count: usize,
        column: &'a [[f32; AXES]; MAX_ROTORS],
        least: &'a [f32; MAX_ROTORS],
        demands: &'a Demands,
    ) -> Self {
        let rotor_count = rotor_count.min(MAX_ROTORS);
        let mut sets = Self {
            observations,
            rotor_count,
            column,
            least,
            demands,
            log_likelihood: [[0.0; MAX_ROTORS]; MAX_ROTORS],
            at_last: [0; MAX_ROTORS],
            counts: [0; MAX_ROTORS],
        };
        for (number, observation) in observations.iter().enumerate() {
            let free = observation.1.free();
            for second in 0..rotor_count {
                for first in 0..second + 1 {
                    let fit = sets.fit_to(observation, free, [first, second]);
                    if number == 0 || fit.log_likelihood > sets.log_likelihood[second][first] {
                        sets.log_likelihood[second][first] = fit.log_likelihood;
                        let set_bit =
                            |mask: &mut u32, bit: bool| *mask = *mask & !(1 << first) | u32::from(bit) << first;
                        set_bit(&mut sets.at_last[second], number > 0);
                        set_bit(&mut sets.counts[second], counts(&fit, demands.smallest_loss));
                    }
                }
            }
        }
        sets
    }

    /// The best-fitting losses of a set (both entries equal for a single rotor) at one onset time.
    #[inline(never)]
    fn fit_to(&self, (onset, observation): &(Onset, Observation), free: f32, rotors: [usize; 2]) -> SetFit {
        let (first, second) = (within(rotors[0]), within(rotors[1]));
        let mut fit = if first == second {
            SetFit::single(observation, first, &self.column[first], self.least[first])
        } else {
            let columns = [&self.column[first], &self.column[second]];
            SetFit::pair(
                observation,
                [first, second],
                columns,
                [self.least[first], self.least[second]],
            )
        };
        fit.onset = *onset;
        fit.unexplained = free - fit.log_likelihood;
        if fit
            .members()
            .all(|(rotor, loss)| loss > self.demands.heals_at[within(rotor)])
        {
            fit.log_likelihood += self.demands.repeat_bonus;
        }
        fit
    }

    /// The best-fitting losses of a set at its better onset time; zero without observations.
    fn fit(&self, first: usize, second: usize) -> SetFit {
        let (first, second) = (within(first), within(second));
        let observation = if self.at_last[second] >> first & 1 == 1 {
            self.observations.last()
        } else {
            self.observations.first()
        };
        observation.map_or_else(SetFit::default, |observation| {
            self.fit_to(observation, observation.1.free(), [first, second])
        })
    }

    /// Pairs with their likelihoods, nats, and whether they count.
    fn pairs(&self) -> impl Iterator<Item = (u32, f32, bool)> {
        let rows = self.log_likelihood.iter().zip(&self.counts).enumerate();
        rows.take(self.rotor_count).flat_map(|(second, (row, counts))| {
            row.iter().enumerate().take(second).map(move |(first, log_likelihood)| {
                (1 << first | 1 << second, *log_likelihood, counts >> first & 1 == 1)
            })
        })
    }

    /// Likelihood of this one rotor, nats.
    pub(super) fn alone(&self, rotor: usize) -> f32 {
        self.log_likelihood[within(rotor)][within(rotor)]
    }

    /// The set of this one rotor.
    pub(super) fn single(&self, rotor: usize) -> SetFit {
        self.fit(rotor, rotor)
    }

    /// The likeliest pair; ties go to the first.
    pub(super) fn best_pair(&self) -> SetFit {
        let (mut rotors, mut most) = (0b11, self.log_likelihood[1][0]);
        for (mask, log_likelihood, _) in self.pairs() {
            if log_likelihood > most {
                (rotors, most) = (mask, log_likelihood);
            }
        }
        let [first, second] = members(rotors);
        self.fit(first, second)
    }

    /// Gain of the likeliest pair with this rotor over this rotor alone, nats.
    pub(super) fn gain_of_second(&self, rotor: usize) -> f32 {
        let alone = self.alone(rotor);
        self.pairs()
            .filter(|(mask, _, counts)| mask >> rotor & 1 == 1 && *counts)
            .fold(0.0, |most: f32, (_, log_likelihood, _)| {
                most.max(log_likelihood - alone)
            })
    }

    /// Lead of this rotor alone over the likeliest pair without it, nats.
    pub(super) fn lead_over_other_pairs(&self, rotor: usize) -> f32 {
        let alone = self.alone(rotor);
        self.pairs()
            .filter(|(mask, _, counts)| mask >> rotor & 1 == 0 && *counts)
            .fold(f32::INFINITY, |least: f32, (_, log_likelihood, _)| {
                least.min(alone - log_likelihood)
            })
    }

    /// The sets about as likely as the best one, likeliest first.
    pub(super) fn open(&self) -> Suspects {
        let demands = self.demands;
        let singles = || (0..self.rotor_count).map(|rotor| (1 << rotor, self.alone(rotor)));
        let mut most = self.alone(0);
        for log_likelihood in singles().map(|set| set.1).chain(self.pairs().map(|pair| pair.1)) {
            if log_likelihood > most {
                most = log_likelihood;
            }
        }
        let mut suspects = Suspects::default();
        let mut listed = [(0u32, 0.0f32); MAX_HYPOTHESES];
        let mut list = |mask: u32, log_likelihood: f32| {
            suspects.rotors |= mask;
            suspects.hypothesis_count += 1;
            let mut entry = (mask, log_likelihood);
            for slot in &mut listed {
                if slot.0 == 0 || entry.1 > slot.1 {
                    core::mem::swap(slot, &mut entry);
                }
            }
        };
        for (mask, log_likelihood) in singles() {
            if most - log_likelihood <= demands.second_rotor {
                list(mask, log_likelihood);
            }
        }
        for (mask, log_likelihood, counts) in self.pairs() {
            let [first, second] = members(mask);
            let single = self.alone(first).max(self.alone(second));
            if most - log_likelihood <= demands.margin && log_likelihood - single >= REDUNDANT_NATS && counts {
                list(mask, log_likelihood);
            }
        }
        suspects.hypotheses = listed.map(|(mask, _)| mask);
        suspects
    }
}

/// The rotors of a mask of two.
fn members(mask: u32) -> [usize; 2] {
    [mask.trailing_zeros() as usize, 31 - mask.leading_zeros() as usize]
}

/// Both losses of a pair are significant, or one recovers.
fn counts(fit: &SetFit, smallest_loss: f32) -> bool {
    fit.loss.iter().all(|loss| loss.abs() > smallest_loss)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Geometry;

    const PI: f32 = core::f32::consts::PI;

    fn columns(rotor_count: usize) -> [[f32; AXES]; MAX_ROTORS] {
        let geometry = Geometry::regular(rotor_count, 0.275, 0.016, PI / rotor_count as f32).expect("regular");
        let arm = [1.0, 0.275, 0.275, 0.016];
        core::array::from_fn(|rotor| core::array::from_fn(|axis| geometry.effectiveness()[axis][rotor] / arm[axis]))
    }

    fn demands() -> Demands {
        Demands {
            margin: 6.0,
            second_rotor: 10.0,
            smallest_loss: 3e-3,
            heals_at: [f32::INFINITY; MAX_ROTORS],
            repeat_bonus: 10.0,
        }
    }

    fn seen(losses: &[(usize, f32)], column: &[[f32; AXES]; MAX_ROTORS]) -> Observation {
        Observation {
            wrench: core::array::from_fn(|axis| losses.iter().map(|(rotor, loss)| -column[*rotor][axis] * loss).sum()),
            variance: [1e-4; AXES],
        }
    }

    /// Evaluates what a vehicle with these losses shows, and returns the result of `of`.
    fn weigh<T>(rotor_count: usize, losses: &[(usize, f32)], of: impl Fn(&Sets<'_>) -> T) -> T {
        let column = columns(rotor_count);
        let observation = seen(losses, &column);
        let observations = [(Onset::at(0), observation)];
        of(&Sets::weigh(
            &observations,
            rotor_count,
            &column,
            &[0.0; MAX_ROTORS],
            &demands(),
        ))
    }

    #[test]
    fn val_losses_of_a_pair_come_back() {
        for rotor_count in [4, 6, 8] {
            for second in 1..rotor_count {
                // Unequal: equal losses of opposite rotors have equivalents.
                let (pair, gain) = weigh(rotor_count, &[(0, 0.3), (second, 0.1)], |sets| {
                    (sets.best_pair(), sets.gain_of_second(0))
                });
                assert_eq!(pair.mask(), 1 | 1 << second);
                assert!(
                    (pair.loss[0] - 0.3).abs() < 1e-4 && (pair.loss[1] - 0.1).abs() < 1e-4,
                    "{pair:?}"
                );
                assert!(pair.unexplained.abs() < 1e-2);
                assert!(gain > 10.0);
            }
        }
    }

    #[test]
    fn val_geometry_decides_which_pairs_have_twins() {
        // Opposite rotors of a hexarotor turn in opposite senses: three pairs with the same wrench. On an octorotor opposite ones turn in the
        // same sense: 1 and 5 are equivalent to 3 and 7. A quadrotor's effectiveness is invertible: no equivalents.
        for (rotor_count, opposite, twins) in [(4, 2, 1), (6, 3, 3), (8, 4, 2)] {
            let open = weigh(rotor_count, &[(0, 0.3), (opposite, 0.3)], |sets| sets.open());
            assert_eq!(open.hypothesis_count, twins, "{rotor_count}: {open:?}");
            assert!(open.hypotheses[..usize::from(twins)].contains(&(1 | 1 << opposite)));
        }
    }

    #[test]
    fn val_single_loss_needs_no_second_rotor() {
        for rotor_count in [4, 6, 8] {
            weigh(rotor_count, &[(1, 0.3)], |sets| {
                assert!((sets.single(1).loss[0] - 0.3).abs() < 1e-4);
                assert!(sets.gain_of_second(1) < 1e-2);
                assert!(sets.lead_over_other_pairs(1) > 10.0);
                assert_eq!(sets.open().rotors, 1 << 1);
            });
        }
    }

    #[test]
    fn val_gain_error_is_no_second_rotor() {
        let column = columns(6);
        let mut observation = seen(&[(0, 0.5)], &column);
        // Roll inertia 5 % off.
        observation.wrench[1] *= 1.05;
        observation.variance = [1e-6; AXES];
        let gain_of_second = |observation| {
            Sets::weigh(
                &[(Onset::at(0), observation)],
                6,
                &column,
                &[0.0; MAX_ROTORS],
                &demands(),
            )
            .gain_of_second(0)
        };
        assert!(gain_of_second(observation) > 10.0);
        assert!(gain_of_second(observation.tolerant(&[0.0; AXES], &[2.5e-3; AXES], 0.0)) < 2.0);
    }
}
