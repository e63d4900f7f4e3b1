//! From evidence to verdicts: which set of rotors is named, what remains ambiguous, and what is absorbed into the model.

use super::axis_filter::{BIAS, GAIN, LAG, LevelProbe, STATES};
use super::defect::AXES;
use super::estimate::{LossEstimate, Suspects};
use super::observation::Observation;
use super::onset::{Evidence, FreeEvidence, LANES, Onset};
use super::sets::{Demands, SetFit, Sets};
use super::{KnownFault, Phase, SequentialDecision, SequentialDetector, limited, within};
use crate::MAX_ROTORS;
use crate::fdi::FaultVerdict;

/// A fault has healed if its loss recovers to within this fraction: a smaller remainder is indistinguishable from estimation error.
const HEALED_SHARE: f32 = 0.15;

/// A fault is about to heal if no more than this fraction of its loss would remain.
const HEALING_SHARE: f32 = 0.3;

/// Amount that noise alone leaves unexplained, nats: half a χ² with three degrees of freedom exceeds it once in 40,000.
const UNEXPLAINED_NATS: f32 = 12.0;

/// The same for a pair, which could explain much: half a χ² with two degrees of freedom exceeds it once in 400.
const UNEXPLAINED_BY_PAIR_NATS: f32 = 6.0;

/// Gain of a second rotor, nats, up to which a single one is absorbed as soon as it has settled.
const UNDISPUTED_NATS: f32 = 2.0;

/// Settling times for which a disputed single fault waits for more evidence before it is absorbed.
const DISPUTED_SETTLINGS: u32 = 4;

/// Rotors whose columns differ by less in every axis but yaw, levers taken out, share an axis.
const SAME_AXIS: f32 = 1e-3;

/// Squared relative model error of an axis that no manoeuvre has excited.
const MODEL_VARIANCE: f32 = 1e-4;

/// Summary of the evidence at the end of a window.
struct Finding {
    /// The set to name.
    named: Option<SetFit>,
    /// Several sets explain the evidence well.
    open: Option<Suspects>,
    /// Something needs an explanation.
    relevant: bool,
    probability: f32,
    /// Probability of a fault rather than none.
    probability_of_any: f32,
    /// Evidence for the best single rotor, nats.
    best: f32,
    /// What a second rotor adds to the one named, nats.
    gain_of_second: f32,
    /// Lead of the one named over pairs without it, nats.
    lead: f32,
}

impl SequentialDetector {
    /// Lost thrust of a fault that is part of the model, at hover, N.
    fn known_loss(&self, rotor: usize) -> f32 {
        self.watch.known[within(rotor)].fraction * self.tuning.hover_thrust[within(rotor)]
    }

    /// Bit i set: rotor i has a loss in the model.
    fn known_rotors(&self) -> u32 {
        let least = 0.5 * self.tuning.config.smallest_loss * self.tuning.mean_hover_thrust;
        (0..self.rotors())
            .filter(|&rotor| self.known_loss(rotor) > least)
            .fold(0, |mask, rotor| mask | 1 << rotor)
    }

    /// A rotor can regain what it lost; the upper limit is left open, as thrusts vary.
    fn least_change(&self, rotor: usize) -> f32 {
        -self.watch.known[within(rotor)].fraction * self.watch.thrust[within(rotor)]
    }

    /// A damaged propeller keeps changing. Complete healing is no likelier than an equal failure of the opposite rotor, which differs in
    /// the vertical force alone: no bonus for that.
    fn goes_on(&self, rotor: usize, change: f32) -> bool {
        self.known_rotors() >> rotor & 1 == 1 && change > (1.0 - HEALING_SHARE) * self.least_change(rotor)
    }

    /// Evidence for every rotor; unused entries hold the evidence for no loss.
    fn evidence(&self) -> [Evidence; MAX_ROTORS] {
        let mut evidence = [Evidence::NONE; MAX_ROTORS];
        let groups = evidence.as_chunks_mut::<LANES>().0.iter_mut();
        for (group, place) in groups.enumerate().take(self.rotors().div_ceil(LANES)) {
            let rotor = |k: usize| within(group * LANES + k);
            let column = core::array::from_fn(|axis| core::array::from_fn(|k| self.tuning.column[rotor(k)][axis]));
            let least = core::array::from_fn(|k| self.least_change(rotor(k)));
            *place = self.watch.onset.evidence(&column, &least);
        }
        evidence
    }

    /// After the last block of a window.
    pub fn decide(&mut self) {
        if self.phase != Phase::Watch {
            return;
        }
        let c = self.tuning.config;
        let known = self.known_rotors();
        let mut first = 0;
        let mut log_likelihood = [0.0; MAX_ROTORS];
        let evidence = self.evidence();
        let mut leading = evidence[0];
        for rotor in 0..self.rotors() {
            let evidence = evidence[rotor];
            log_likelihood[rotor] = evidence.log_likelihood;
            if self.goes_on(rotor, evidence.loss) {
                log_likelihood[rotor] += c.repeat_bonus;
            }
            if rotor == 0 || log_likelihood[rotor] > log_likelihood[within(first)] {
                first = rotor;
                leading = evidence;
            }
        }
        let first = within(first);
        let jump = self.watch.onset.jump_evidence();
        let push = self.watch.onset.push_evidence();
        self.watch.onset.set_leading(&leading, &jump, &push);
        self.watch.leading_rotor = first;
        let head_start = if self.goes_on(first, leading.loss) {
            c.repeat_bonus
        } else {
            0.0
        };
        let fit = self
            .watch
            .onset
            .fit(&leading, &self.tuning.column[first], &jump, &push, c.margin_to_isolate);
        let supported = head_start + fit.explained;
        let fits = fit.unexplained <= UNEXPLAINED_NATS.max(c.unexplained_share * fit.explained);
        let finding = self.weigh(known, first, &log_likelihood, &leading, &jump, &push, supported, fits);

        let unclear = 0.5 * c.evidence_to_isolate;
        self.watch.ambiguous_windows = if finding.relevant && finding.named.is_none() {
            self.watch.ambiguous_windows.saturating_add(1)
        } else {
            0
        };
        let undecided = self.watch.ambiguous_windows > self.tuning.ambiguity_windows;
        match (&finding.named, self.watch.decision.verdict) {
            (Some(set), _) => self.report(known, Some(set), finding.probability),
            (None, _) if undecided && let Some(open) = finding.open => {
                self.report_open(known, open, finding.probability_of_any);
            }
            (None, _) if known != 0 => self.report(known, None, 1.0),
            (None, FaultVerdict::Faulty { rotor })
                if log_likelihood
                    .get(usize::from(rotor))
                    .is_some_and(|nats| *nats >= unclear) => {}
            (None, FaultVerdict::FaultyPair { .. } | FaultVerdict::Ambiguous) if finding.best >= unclear => {}
            (None, _) if undecided => {
                // A fault, but of unknown type.
                self.report_none(FaultVerdict::Unknown, finding.probability_of_any);
            }
            (None, FaultVerdict::Unknown) if finding.best >= unclear => {}
            (None, _) => self.report_none(FaultVerdict::Healthy, 1.0 - finding.probability_of_any),
        }
        if supported < unclear
            && self.watch.decision.verdict == FaultVerdict::Healthy
            && jump.log_likelihood > c.evidence_to_isolate
            && self.watch.onset.jump_age(&jump) >= self.tuning.settling_blocks
        {
            self.absorb_jump(&jump);
            return;
        }
        self.watch.quiet = finding.best < unclear;
        if self.watch.quiet {
            self.adopt_time_constants();
            for axis in 0..AXES {
                self.watch.gain[axis] = self.watch.axis[axis].filter.state[GAIN];
                self.watch.gain_variance[axis] = self.watch.axis[axis].filter.covariance[GAIN][GAIN] + MODEL_VARIANCE;
            }
        }
        let strong = finding.best > c.evidence_to_absorb;
        self.watch.pending = strong && (finding.named.is_some() || finding.open.is_some() && undecided);
        if let Some(set) = finding.named.filter(|_| strong) {
            let age = self.watch.onset.age(&set.onset);
            let grows = set.loss[0] > 0.0;
            let rivalled = finding.gain_of_second > UNDISPUTED_NATS || finding.lead < 0.0;
            let disputed = !set.is_pair() && grows && rivalled;
            let settlings = if disputed { DISPUTED_SETTLINGS } else { 1 };
            if age >= settlings * self.tuning.settling_blocks {
                self.absorb(&set, finding.probability);
            }
        }
    }

    /// Compares sets of rotors.
    #[expect(clippy::too_many_arguments, reason = "everything that one window has worked out")]
    fn weigh(
        &self,
        known: u32,
        first: usize,
        log_likelihood: &[f32; MAX_ROTORS],
        leading: &Evidence,
        jump: &FreeEvidence,
        push: &FreeEvidence,
        supported: f32,
        fits: bool,
    ) -> Finding {
        let c = &self.tuning.config;
        let best = log_likelihood[within(first)];
        let mut next = 0.0f32;
        for rotor in 0..self.rotors() {
            if rotor != first {
                next = next.max(log_likelihood[rotor]);
            }
        }
        let smallest_loss = c.smallest_loss * self.tuning.mean_hover_thrust;
        let relevant = supported > c.evidence_to_isolate
            && (leading.loss > smallest_loss || (known >> first & 1 == 1 && leading.loss < 0.0));
        // Odds of any fault, and of this one.
        let odds_of_none = libm::expf((c.prior_log_odds - best.min(supported)).clamp(-80.0, 80.0));
        let odds_of_next = libm::expf((next - best).clamp(-80.0, 0.0));
        let mut finding = Finding {
            named: None,
            open: None,
            relevant,
            probability: 1.0 / (1.0 + odds_of_none + odds_of_next),
            probability_of_any: 1.0 / (1.0 + odds_of_none),
            best,
            gain_of_second: 0.0,
            lead: 0.0,
        };
        if push.log_likelihood + c.repeat_bonus < c.evidence_to_isolate {
            return finding;
        }

        let demands = Demands {
            margin: c.margin_to_isolate,
            second_rotor: c.evidence_for_second,
            smallest_loss,
            heals_at: core::array::from_fn(|rotor| {
                if known >> rotor & 1 == 1 {
                    (1.0 - HEALING_SHARE) * self.least_change(rotor)
                } else {
                    f32::INFINITY
                }
            }),
            repeat_bonus: c.repeat_bonus,
        };
        let onsets = self.onsets(first, leading, jump, push);
        let count = if onsets[0].is_close_to(&onsets[1]) { 1 } else { 2 };
        let observations = onsets.map(|onset| (onset, self.observation(&onset, jump, push)));
        let least = core::array::from_fn(|rotor| self.least_change(rotor));
        let sets = Sets::weigh(
            &observations[..count],
            self.rotors(),
            &self.tuning.column,
            &least,
            &demands,
        );

        let gain_of_second = sets.gain_of_second(first);
        let lead = sets.lead_over_other_pairs(first);
        finding.gain_of_second = gain_of_second;
        finding.lead = lead;
        if relevant
            && fits
            && best - next > c.margin_to_isolate
            && gain_of_second <= c.evidence_for_second
            && lead >= -c.handicap_of_pairs
        {
            // Odds of the named rotor while a pair of others remains possible.
            let odds_of_pair = libm::expf(-limited(lead + c.handicap_of_pairs, 0.0, 80.0));
            finding.probability = 1.0 / (1.0 + odds_of_none + odds_of_next + odds_of_pair);
            finding.named = Some(sets.single(first));
            return finding;
        }
        let pair = sets.best_pair();
        let alone = pair
            .members()
            .fold(0.0, |most: f32, (rotor, _)| most.max(sets.alone(rotor)));
        let pair_relevant = pair.log_likelihood > c.evidence_to_isolate
            && pair.log_likelihood - alone > c.evidence_for_second
            && pair.unexplained <= UNEXPLAINED_BY_PAIR_NATS;
        finding.relevant |= pair_relevant;
        let open = sets.open();
        let settled = self.watch.onset.age(&pair.onset) >= self.tuning.pair_blocks;
        if pair_relevant && settled && open.hypothesis_count == 1 && open.rotors == pair.mask() {
            finding.probability = 1.0 / (1.0 + odds_of_none);
            finding.named = Some(pair);
        } else if finding.relevant && open.hypothesis_count > 0 && pair.unexplained <= UNEXPLAINED_BY_PAIR_NATS {
            finding.open = Some(open);
        }
        finding
    }

    /// The times within blocks at which the best rotor, and a lasting wrench of any direction, set in.
    #[inline(never)]
    fn onsets(&self, first: usize, leading: &Evidence, jump: &FreeEvidence, push: &FreeEvidence) -> [Onset; 2] {
        // Several rotors are another direction than any one of them, and with it another time within the block.
        let pushed = self.watch.onset.observation(&Onset::at(push.index)).wrench;
        let directions = [
            (leading.index, self.tuning.column[within(first)]),
            (push.index, pushed.map(|wrench| -wrench)),
        ];
        directions.map(|(index, mut direction)| {
            let jumped = self.jumped(&Onset::at(index), jump, push);
            for axis in 0..AXES {
                if jumped[axis] {
                    direction[axis] = 0.0;
                }
            }
            self.watch.onset.between_blocks(index, &direction)
        })
    }

    /// The lost wrench observed since one onset time, without the axes that a jump explains better.
    #[inline(never)]
    fn observation(&self, onset: &Onset, jump: &FreeEvidence, push: &FreeEvidence) -> Observation {
        let mut observation = self.watch.onset.observation(onset);
        let jumped = self.jumped(onset, jump, push);
        for axis in 0..AXES {
            if jumped[axis] {
                observation.forget(axis);
            }
        }
        let centre = self.tuning.config.centre_of_mass_spread;
        observation.tolerant(&self.watch.gain, &self.watch.gain_variance, centre * centre)
    }

    /// Axes that a jump explains better than any lasting wrench since an onset time.
    fn jumped(&self, onset: &Onset, jump: &FreeEvidence, push: &FreeEvidence) -> [bool; AXES] {
        let of_any = self.watch.onset.free_fit(onset);
        core::array::from_fn(|axis| {
            jump.axis[axis] > push.axis[axis] && jump.axis[axis] > of_any[axis] + self.tuning.config.margin_to_isolate
        })
    }

    fn report_none(&mut self, verdict: FaultVerdict, probability: f32) {
        self.watch.decision = SequentialDecision {
            verdict,
            probability,
            thrust_loss: [LossEstimate::default(); 2],
            suspects: Suspects::default(),
        };
    }

    /// Reports what the model knows together with a change not yet absorbed.
    fn report(&mut self, known: u32, change: Option<&SetFit>, probability: f32) {
        let mask = known | change.map_or(0, SetFit::mask);
        let mut estimates = [LossEstimate::default(); 2];
        let mut probability = probability;
        let members = (0..self.rotors()).filter(|rotor| mask >> rotor & 1 == 1);
        let count = mask.count_ones();
        for (place, rotor) in members.enumerate() {
            let rotor = within(rotor);
            let fault = &self.watch.known[rotor];
            if known >> rotor & 1 == 1 {
                probability = probability.min(fault.probability);
            }
            let scale = self.tuning.hover_thrust[rotor] / self.working_thrust(rotor);
            let mut loss = self.known_loss(rotor);
            let mut variance = fault.deviation * fault.deviation;
            if let Some(set) = change
                && let Some((_, more)) = set.members().find(|member| member.0 == rotor)
            {
                let deviation = set.deviation(rotor) * scale;
                loss += more * scale;
                variance += deviation * deviation;
            }
            if let Some(estimate) = estimates.get_mut(place).filter(|_| count <= 2) {
                *estimate = LossEstimate::new(loss, variance, self.tuning.hover_thrust[rotor]);
            }
        }
        let open = self.with_those_on_the_same_axes(mask);
        if count <= 2 && open.hypothesis_count > 1 {
            self.report_open(0, open, probability);
            return;
        }
        let first = mask.trailing_zeros() as u8;
        let (verdict, suspects) = match count {
            1 => (FaultVerdict::Faulty { rotor: first }, Suspects::certain(mask)),
            2 => (
                FaultVerdict::FaultyPair {
                    first,
                    second: (31 - mask.leading_zeros()) as u8,
                },
                Suspects::certain(mask),
            ),
            _ => (FaultVerdict::Ambiguous, Suspects::one_set(mask)),
        };
        self.watch.decision = SequentialDecision {
            verdict,
            probability,
            thrust_loss: estimates,
            suspects,
        };
    }

    /// The set, and the sets in which a rotor is replaced by one that counter-rotates on its axis. Their columns differ in yaw alone, which the
    /// drag of a damaged blade changes by as much as its lost thrust does: the evidence of one is no evidence against the other.
    fn with_those_on_the_same_axes(&self, mask: u32) -> Suspects {
        let mut sets = Suspects::one_set(mask);
        for rotor in (0..self.rotors()).filter(|rotor| mask >> rotor & 1 == 1) {
            let own = &self.tuning.column[within(rotor)];
            let is_on_its_axis = |other: &usize| {
                let column = &self.tuning.column[within(*other)];
                let differ = |axis: usize| libm::fabsf(column[axis] - own[axis]) > SAME_AXIS;
                mask >> other & 1 == 0 && !(0..AXES - 1).any(differ)
            };
            for other in (0..self.rotors()).filter(is_on_its_axis) {
                for set in sets.hypotheses {
                    if set >> rotor & 1 == 1 {
                        sets.add(set & !(1 << rotor) | 1 << other);
                    }
                }
            }
        }
        sets
    }

    fn report_open(&mut self, known: u32, open: Suspects, probability: f32) {
        self.watch.decision = SequentialDecision {
            verdict: FaultVerdict::Ambiguous,
            probability,
            thrust_loss: [LossEstimate::default(); 2],
            suspects: open.with(known),
        };
    }

    /// Averaged thrust of a rotor, N, bounded below so that fractions of it stay meaningful.
    fn working_thrust(&self, rotor: usize) -> f32 {
        self.watch.thrust[within(rotor)].max(0.1 * self.tuning.mean_hover_thrust)
    }

    /// Undoes the effect of a momentum jump on the filters.
    fn absorb_jump(&mut self, jump: &FreeEvidence) {
        for axis in 0..AXES {
            let (size, error) = self.watch.onset.jump(jump, axis);
            let state = &mut self.watch.axis[axis];
            for i in 0..STATES {
                state.filter.state[i] += size * error[i];
            }
            state.probe = [LevelProbe::new(&state.filter); 2];
        }
        self.start_afresh();
    }

    /// Absorbs a change into the model; further changes are sought relative to it. The part of the lasting wrench that the losses do not
    /// explain remains as a bias.
    fn absorb(&mut self, set: &SetFit, probability: f32) {
        let seen = self.watch.onset.observation(&set.onset);
        for axis in 0..AXES {
            let explained: f32 = set
                .members()
                .map(|(rotor, loss)| -self.tuning.column[within(rotor)][axis] * loss)
                .sum();
            let error = &self.watch.onset.error(&set.onset, axis);
            let state = &mut self.watch.axis[axis];
            // An uninformative axis keeps its state except for what the losses explain.
            let informed = seen.variance[axis] < 1.0;
            let (lost, variance) = if informed {
                (seen.wrench[axis], seen.variance[axis])
            } else {
                (explained, 0.0)
            };
            // The remaining error keeps acting like a bias.
            let mut direction = *error;
            direction[BIAS] += 1.0;
            for i in 0..STATES {
                state.filter.state[i] += lost * error[i];
                for j in 0..STATES {
                    state.filter.covariance[i][j] += variance * direction[i] * direction[j];
                }
            }
            state.filter.state[BIAS] += lost - explained;
            state.probe = [LevelProbe::new(&state.filter); 2];
        }

        for (rotor, loss) in set.members() {
            let rotor = within(rotor);
            let thrust = self.working_thrust(rotor);
            let deviation = set.deviation(rotor) * self.tuning.hover_thrust[rotor] / thrust;
            let known = &mut self.watch.known[rotor];
            let before = known.fraction;
            let mut fraction = (before + loss / thrust).clamp(0.0, 1.0);
            if fraction < HEALED_SHARE * before {
                fraction = 0.0;
            }
            let earlier = if before > 0.0 { known.deviation } else { 0.0 };
            *known = KnownFault {
                fraction,
                deviation: libm::sqrtf(earlier * earlier + deviation * deviation),
                probability,
            };
            self.watch.loss_fraction[rotor] = fraction;
            let removed = (fraction - before) * self.watch.recent_thrust[rotor];
            let column = &self.tuning.column[rotor];
            self.meter.remove_wrench(&core::array::from_fn(|axis| {
                removed * column[axis] * self.tuning.arm[axis]
            }));
        }
        self.start_afresh();
    }

    fn start_afresh(&mut self) {
        self.watch.onset.clear();
        self.watch.pending = false;
        self.watch.quiet = true;
    }

    /// Moves the time constants to their estimates. Only while nothing stands out: [`super::onset`] undoes the effect of a fault on the
    /// filters exactly, but only as long as the model stays the same.
    fn adopt_time_constants(&mut self) {
        for axis in 0..AXES {
            let state = &mut self.watch.axis[axis].filter.state;
            self.meter.shift_time_constant(axis, state[LAG]);
            state[LAG] = 0.0;
        }
    }
}
