//! Which rotors explain a lost wrench: every single one and every pair, with losses that are possible.
//!
//! What the innovations say about a change at one moment is a wrench ŵ with a variance per axis ([`Observation`]). A set of rotors
//! explains it with losses Δ ≥ their least values, W = −Σ F_i Δ_i, and
//!
//! ln L(set)/L(nothing) = max_Δ Σ_a (W_a ŵ_a − ½ W_a²)/V_a
//!
//! V_a holds, beside the variance of ŵ_a, what the model itself is unsure of in proportion to the loss: the gain of the axis (as far as
//! the filters have not learnt it) and the centre of mass. So a large loss of one rotor is not taken for two because the inertia is
//! a few per cent off, and two are told apart as far as the model allows.
//!
//! Geometry decides what can be told. On a regular hexarotor, opposite rotors turn in opposite senses: equal losses of 1 and 4, of 2 and
//! 5, and of 3 and 6 are the same pure vertical force. On a quadrotor all pairs differ. Limits: sets of one and two rotors.

use super::defect::AXES;
use super::estimate::{MAX_HYPOTHESES, Suspects};
use crate::MAX_ROTORS;

/// Sets of one and of two rotors.
const SETS: usize = MAX_ROTORS * (MAX_ROTORS + 1) / 2;

/// Variance of an axis that says nothing, N².
const NOTHING_KNOWN: f32 = 1e9;

/// Gain over the better one of its rotors alone below which a pair says nothing of its own, nats.
const REDUNDANT_NATS: f32 = 2.0;

/// A lasting lost wrench as the innovations show it, levers taken out, N.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    pub wrench: [f32; AXES],
    pub variance: [f32; AXES],
}

impl Observation {
    /// * `score`, `information`: of every axis
    pub(super) fn new(score: &[f32; AXES], information: &[f32; AXES]) -> Self {
        let mut observation = Self {
            wrench: [0.0; AXES],
            variance: [NOTHING_KNOWN; AXES],
        };
        for axis in 0..AXES {
            if information[axis] * NOTHING_KNOWN > 1.0 {
                observation.wrench[axis] = score[axis] / information[axis];
                observation.variance[axis] = 1.0 / information[axis];
            }
        }
        observation
    }

    /// Takes an axis out.
    pub(super) fn forget(&mut self, axis: usize) {
        self.wrench[axis] = 0.0;
        self.variance[axis] = NOTHING_KNOWN;
    }

    /// Corrects for the learnt gains of the axes, and adds what is uncertain in proportion to the wrench.
    ///
    /// * `gain`, `gain_variance`: relative   * `centre_variance`: of the centre of mass, squared share of the longest lever
    #[must_use]
    pub(super) fn tolerant(mut self, gain: &[f32; AXES], gain_variance: &[f32; AXES], centre_variance: f32) -> Self {
        for axis in 0..AXES {
            let factor = 1.0 / (1.0 + gain[axis].clamp(-0.5, 0.5));
            self.wrench[axis] *= factor;
            self.variance[axis] *= factor * factor;
        }
        let vertical = self.wrench[0] * self.wrench[0];
        for axis in 0..AXES {
            self.variance[axis] += gain_variance[axis] * self.wrench[axis] * self.wrench[axis];
            if axis == 1 || axis == 2 {
                self.variance[axis] += centre_variance * vertical;
            }
        }
        self
    }

    /// ln of the likelihood ratio of the best wrench of any direction, nats.
    pub(super) fn free(&self) -> f32 {
        (0..AXES)
            .map(|axis| 0.5 * self.wrench[axis] * self.wrench[axis] / self.variance[axis])
            .sum()
    }
}

/// The best losses of one set of rotors.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SetFit {
    /// From 0; twice the same of a single rotor.
    pub rotors: [u8; 2],
    /// N, in the order of `rotors`; 0 in the second place of a single rotor.
    pub loss: [f32; 2],
    /// Of the two losses: first, second, both, N².
    pub covariance: [f32; 3],
    /// Nats.
    pub log_likelihood: f32,
    /// What any wrench could explain beyond it, nats.
    pub unexplained: f32,
    /// Moment of onset.
    pub index: usize,
}

impl SetFit {
    /// True of two rotors.
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
        (0..count).map(|member| (usize::from(self.rotors[member]), self.loss[member]))
    }

    /// Standard deviation of the loss of a member, N.
    pub(super) fn deviation(&self, rotor: usize) -> f32 {
        let member = usize::from(self.is_pair() && usize::from(self.rotors[1]) == rotor);
        libm::sqrtf(self.covariance[member].max(0.0))
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

    /// Two rotors; the best point of the quadrant of possible losses.
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

/// What is asked of a set before it is named.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demands {
    /// Lead over other sets of the same size, nats.
    pub margin: f32,
    /// What a second rotor must add, nats.
    pub second_rotor: f32,
    /// Losses below say nothing, N.
    pub smallest_loss: f32,
    /// Change of each rotor above which it goes on being faulty, N; infinite of those that are not known to be.
    pub heals_at: [f32; MAX_ROTORS],
    /// Head start of sets of rotors that go on being faulty, nats.
    pub repeat_bonus: f32,
}

/// Every set of one and two rotors, weighed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sets {
    fit: [SetFit; SETS],
    count: usize,
    rotor_count: usize,
}

impl Sets {
    /// * `observations`: for each moment of onset its place and what is seen   * `least`: smallest possible loss of each rotor, N
    pub(super) fn weigh(
        observations: &[(usize, Observation)],
        rotor_count: usize,
        column: &[[f32; AXES]; MAX_ROTORS],
        least: &[f32; MAX_ROTORS],
        demands: &Demands,
    ) -> Self {
        let mut sets = Self {
            fit: [SetFit::default(); SETS],
            count: rotor_count * (rotor_count + 1) / 2,
            rotor_count,
        };
        for (number, (index, observation)) in observations.iter().enumerate() {
            let free = observation.free();
            let mut place = 0;
            let mut keep = |mut fit: SetFit| {
                fit.index = *index;
                fit.unexplained = free - fit.log_likelihood;
                if fit.members().all(|(rotor, loss)| loss > demands.heals_at[rotor]) {
                    fit.log_likelihood += demands.repeat_bonus;
                }
                if number == 0 || fit.log_likelihood > sets.fit[place].log_likelihood {
                    sets.fit[place] = fit;
                }
                place += 1;
            };
            for rotor in 0..rotor_count {
                keep(SetFit::single(observation, rotor, &column[rotor], least[rotor]));
            }
            for second in 1..rotor_count {
                for first in 0..second {
                    let columns = [&column[first], &column[second]];
                    keep(SetFit::pair(
                        observation,
                        [first, second],
                        columns,
                        [least[first], least[second]],
                    ));
                }
            }
        }
        sets
    }

    fn pairs(&self) -> &[SetFit] {
        &self.fit[self.rotor_count..self.count]
    }

    /// The set of this one rotor.
    pub(super) fn single(&self, rotor: usize) -> &SetFit {
        &self.fit[rotor]
    }

    /// The likeliest pair.
    pub(super) fn best_pair(&self) -> &SetFit {
        best(self.pairs())
    }

    /// What the likeliest pair with this rotor explains beyond it alone, nats.
    pub(super) fn gain_of_second(&self, rotor: usize, smallest_loss: f32) -> f32 {
        let alone = self.single(rotor).log_likelihood;
        self.pairs()
            .iter()
            .filter(|fit| fit.mask() >> rotor & 1 == 1 && counts(fit, smallest_loss))
            .fold(0.0, |most: f32, fit| most.max(fit.log_likelihood - alone))
    }

    /// Lead of this rotor alone over the likeliest pair without it, nats.
    pub(super) fn lead_over_other_pairs(&self, rotor: usize, smallest_loss: f32) -> f32 {
        let alone = self.single(rotor).log_likelihood;
        self.pairs()
            .iter()
            .filter(|fit| fit.mask() >> rotor & 1 == 0 && counts(fit, smallest_loss))
            .fold(f32::INFINITY, |least: f32, fit| least.min(alone - fit.log_likelihood))
    }

    /// The sets that come about as close as the best one, likeliest first.
    pub(super) fn open(&self, demands: &Demands) -> Suspects {
        let most = best(&self.fit[..self.count]).log_likelihood;
        let alone = |rotor: u8| self.fit[usize::from(rotor)].log_likelihood;
        let mut suspects = Suspects::default();
        let mut listed = [(0u32, 0.0f32); MAX_HYPOTHESES];
        for fit in &self.fit[..self.count] {
            let within = if fit.is_pair() {
                let single = alone(fit.rotors[0]).max(alone(fit.rotors[1]));
                most - fit.log_likelihood <= demands.margin
                    && fit.log_likelihood - single >= REDUNDANT_NATS
                    && counts(fit, demands.smallest_loss)
            } else {
                most - fit.log_likelihood <= demands.second_rotor
            };
            if !within {
                continue;
            }
            suspects.rotors |= fit.mask();
            suspects.hypothesis_count += 1;
            let mut entry = (fit.mask(), fit.log_likelihood);
            for slot in &mut listed {
                if slot.0 == 0 || entry.1 > slot.1 {
                    core::mem::swap(slot, &mut entry);
                }
            }
        }
        suspects.hypotheses = listed.map(|(mask, _)| mask);
        suspects
    }
}

/// Both losses of a pair are large enough to speak of, or one comes back.
fn counts(fit: &SetFit, smallest_loss: f32) -> bool {
    fit.loss.iter().all(|loss| loss.abs() > smallest_loss)
}

fn best(fits: &[SetFit]) -> &SetFit {
    let mut best = &fits[0];
    for fit in fits {
        if fit.log_likelihood > best.log_likelihood {
            best = fit;
        }
    }
    best
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

    fn weigh(rotor_count: usize, losses: &[(usize, f32)]) -> Sets {
        let column = columns(rotor_count);
        let observation = seen(losses, &column);
        Sets::weigh(
            &[(0, observation)],
            rotor_count,
            &column,
            &[0.0; MAX_ROTORS],
            &demands(),
        )
    }

    #[test]
    fn val_losses_of_a_pair_come_back() {
        for rotor_count in [4, 6, 8] {
            for second in 1..rotor_count {
                // Not equal: equal losses of opposite rotors have twins.
                let sets = weigh(rotor_count, &[(0, 0.3), (second, 0.1)]);
                let pair = sets.best_pair();
                assert_eq!(pair.mask(), 1 | 1 << second);
                assert!(
                    (pair.loss[0] - 0.3).abs() < 1e-4 && (pair.loss[1] - 0.1).abs() < 1e-4,
                    "{pair:?}"
                );
                assert!(pair.unexplained.abs() < 1e-2);
                assert!(sets.gain_of_second(0, 3e-3) > 10.0);
            }
        }
    }

    #[test]
    fn val_geometry_decides_which_pairs_have_twins() {
        // Opposite rotors of a hexarotor turn against each other: three pairs with the same wrench. On an octorotor opposite ones turn
        // alike: 1 and 5 have the twin 3 and 7. A quadrotor's effectiveness can be inverted: no twins.
        for (rotor_count, opposite, twins) in [(4, 2, 1), (6, 3, 3), (8, 4, 2)] {
            let open = weigh(rotor_count, &[(0, 0.3), (opposite, 0.3)]).open(&demands());
            assert_eq!(open.hypothesis_count, twins, "{rotor_count}: {open:?}");
            assert!(open.hypotheses[..usize::from(twins)].contains(&(1 | 1 << opposite)));
        }
    }

    #[test]
    fn val_single_loss_needs_no_second_rotor() {
        for rotor_count in [4, 6, 8] {
            let sets = weigh(rotor_count, &[(1, 0.3)]);
            assert!((sets.single(1).loss[0] - 0.3).abs() < 1e-4);
            assert!(sets.gain_of_second(1, 3e-3) < 1e-2);
            assert!(sets.lead_over_other_pairs(1, 3e-3) > 10.0);
            assert_eq!(sets.open(&demands()).rotors, 1 << 1);
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
            Sets::weigh(&[(0, observation)], 6, &column, &[0.0; MAX_ROTORS], &demands()).gain_of_second(0, 3e-3)
        };
        assert!(gain_of_second(observation) > 10.0);
        assert!(gain_of_second(observation.tolerant(&[0.0; AXES], &[2.5e-3; AXES], 0.0)) < 2.0);
    }
}
