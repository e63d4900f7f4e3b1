//! A second look at the engine's findings: the current size of the loss, and its alternative explanations.
//!
//! ```text
//!  Measurement ─▶ Meter ─block─▶ WrenchFilter ─lost wrench, variance─┬─▶ sets: probabilities of explanations ─▶ name, sets, or nothing
//!  FdiOutput ────────────────────────────────────────────────────────┴─▶ severity of what is named
//! ```
//! In addition to the engine, like [`super::validity`]: the engine finds a fault within a window or two, with a step of
//! lost thrust as its only model of one, and its bits must not change; a board has no room for more. Nothing is decided
//! here before the engine has found something (except loads and slow losses). Then
//!
//! * severity comes from a lost wrench that may change (a ramp, a recovery), with the interval of the present, not of
//!   the moment of naming;
//! * a rotor is named only if nothing else makes the same wrench: a gain of the opposite rotor, a blade that drags, two
//!   small losses, three rotors, a changed load;
//! * a load that was dropped or picked up is reported as such ([`load`]), and becomes part of the model;
//! * what is named only briefly was a disturbance ([`settling`]), and evidence counts only as far as the model has
//!   explained the flight so far ([`trust`]);
//! * the details of a verdict are kept with it: kinds, probabilities and sizes of all explanations, and the rate of a
//!   loss ([`details`]).

mod details;
mod growth;
mod imm;
mod joint;
mod load;
pub(crate) mod meter;
mod sets;
mod settling;
mod trust;
mod wrench;

pub use details::{Details, Explained, ExplanationKind, Interval, Motion};
pub use load::LoadChange;

use super::validity::Obstacle;
use details::{SIGMAS, Track};
use growth::{GrowthWatch, Lone};
use joint::JointFilter;
use load::{Found, LoadWatch, Seen};
use meter::{AXES, Block, Meter};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::verdict_code::{AMBIGUOUS, HEALTHY, UNKNOWN};
use rotortwin_flight_core::fdi::{FaultVerdict, FdiConfig, FdiOutput};
use rotortwin_flight_core::signals::Measurement;
use rotortwin_wire::frames::{FdiReport, LossEstimate, MAX_HYPOTHESES};
use sets::{Explanation, Kind};
use settling::{Answer, Settling};
use std::collections::VecDeque;
use trust::Trust;
use wrench::{AtSpeed, WrenchFilter};

/// Model error of a severity: share of itself, and share of the rotor's hover thrust.
const MODEL_ERROR: f64 = 0.008;
const MODEL_FLOOR: f64 = 0.0005;
/// Blocks between two snapshots, and number of snapshots kept: a severity starts from the oldest.
const SNAPSHOT_BLOCKS: usize = 160;
const SNAPSHOTS: usize = 3;
/// Blocks kept while something is wrong: the snapshots remain, so that other rotors can be followed from before the
/// fault.
const LONGEST_HISTORY: usize = 960;
/// Sets of rotors followed at a time.
const TRACKED: usize = 3;
/// Prior of losses whose past is unknown, share.
const UNKNOWN_LOSS: f64 = 0.15;
/// A set that was named stays named down to this probability.
const STILL_NAMED: f64 = 0.4;
/// Largest probability of nothing or of unlisted causes with which sets of rotors are still reported.
const UNCLEAR: f64 = 0.1;
/// Windows within which a loss has to be found, 10 s.
const SEEN_WITHIN_WINDOWS: usize = 160;
/// A loss of this many standard deviations is found.
const SEEN_SIGMAS: f64 = 8.0;
/// Three rotors that make the wrench of a pair count as its alternative from this probability on; then the pair is
/// named only if it is certain.
const TWIN: f64 = 0.02;
const SURE: f64 = 0.95;
/// A name is certain only after this many windows: the first ones hardly distinguish a loss from its neighbours.
const SURE_WINDOWS: u32 = 8;
/// The same where the model has failed: 10 s.
const SURE_WINDOWS_CAREFUL: u32 = 160;
/// Upper limit of its probability until then.
const NOT_SURE: f64 = 0.94;
/// Once the model has proved itself, a name is reported immediately, and sets are reported at all, if χ² of the lost
/// wrench over the surprise of the last quarter of a second exceeds this.
const STRONG: f64 = 32.0;
const STRONG_SETS: f64 = 64.0;
/// χ² over surprise above which a rotor is watched for a loss that may grow too slowly for the engine.
const GROWN: f64 = 16.0;
/// If a name must persist before it is reported, its loss must be this many standard deviations.
const REAL_SIGMAS: f64 = 3.0;
/// Standard deviation of the slope of the thrust curve, in units of the error of the hover thrust: somewhere between 0
/// (the mass is wrong) and 1 (the thrust is wrong), 1/√3.
const SLOPE_ERROR: f64 = 0.577;
/// Standard deviation of the slope of a thrust curve that was learnt.
const LEARNT_ERROR: f64 = 0.04;
/// Share by which the force of a load may differ between the filter that starts before it and the present one.
const SAME_LOAD: f64 = 0.25;
/// Low-pass of the unexplained wrench, s: the same as the engine's residuals.
const UNEXPLAINED_TIME: f64 = 0.2;
/// Low-pass of each rotor's demand relative to that of all rotors, s.
const UNEVEN_TIME: f64 = 2.0;
/// Probability of nothing above which a fault is over, and below which it has returned.
const OVER: f64 = 0.7;
const BACK: f64 = 0.01;
/// Less probable explanations are not listed.
const LISTED: f64 = 0.02;
/// A single explanation above this probability is named.
const NAMED: f64 = 0.8;

/// See the module.
#[derive(Clone, Debug)]
pub struct SecondLook {
    rotor_count: usize,
    hover: f64,
    gravity: f64,
    hover_thrust: [f64; MAX_ROTORS],
    /// Columns of F, levers taken out.
    column: [[f64; AXES]; MAX_ROTORS],
    meter: Meter,
    filter: WrenchFilter,
    /// Filter as it was, and the blocks since.
    snapshots: VecDeque<(WrenchFilter, Vec<Block>)>,
    /// Follows the losses of the likeliest suspects.
    tracked: Vec<JointFilter>,
    /// N and N·m.
    unexplained: [f64; AXES],
    /// The set that was named last, and for how many consecutive windows.
    named: (u32, u32),
    /// The engine has found something, and whether it persists.
    alarm: Option<bool>,
    settling: Settling,
    trust: Trust,
    /// At the start of the present episode: factor of the variance of a severity, error of the hover thrust as a share
    /// of it.
    caution: [f64; 2],
    /// Smallest lost share of each rotor that would have been found then.
    least: Vec<f32>,
    has_slow_duties: bool,
    /// With these, the smallest losses of the last windows.
    seen_before: VecDeque<Vec<f32>>,
    /// The set that was named with certainty in the present episode.
    certain: u32,
    /// Standard deviation of the slope of a thrust curve that was learnt; 0 if it comes from a model.
    learnt_error: f64,
    /// Since the start, s.
    time_s: f64,
    track: Track,
    details: Details,
    load_watch: LoadWatch,
    growth_watch: GrowthWatch,
    /// The last load that was named.
    load: Option<LoadChange>,
    /// Of all rotors relative to hover, now.
    thrust: f64,
    /// Demand of each rotor relative to that of all, both relative to hover: mean and variance of the last seconds. The
    /// wrench filter knows the demand of all.
    uneven: [[f64; 2]; MAX_ROTORS],
}

/// Lost wrench, N and N², at the levers, and its explanations, likeliest first.
struct Weighed {
    value: [f64; AXES],
    variance: [f64; AXES],
    found: Vec<Explanation>,
}

impl SecondLook {
    /// For the vehicle of an engine that has taken this configuration.
    pub fn new(config: &FdiConfig) -> Self {
        let rotor_count = config.geometry.rotor_count();
        let f = config.geometry.effectiveness();
        let meter = Meter::new(config);
        let weight = f64::from(config.mass * config.gravity);
        let hover = weight / rotor_count as f64;
        let trim = config
            .geometry
            .allocate([-(config.mass * config.gravity), 0.0, 0.0, 0.0]);
        let mut hover_thrust = [hover; MAX_ROTORS];
        for rotor in 0..rotor_count {
            hover_thrust[rotor] = f64::from(trim[rotor]).max(0.1 * hover);
        }
        Self {
            rotor_count,
            hover,
            gravity: f64::from(config.gravity),
            hover_thrust,
            column: std::array::from_fn(|rotor| {
                std::array::from_fn(|axis| f64::from(f[axis][rotor]) / meter.arm[axis])
            }),
            filter: WrenchFilter::new(config, &meter.arm),
            meter,
            snapshots: VecDeque::new(),
            tracked: Vec::new(),
            unexplained: [0.0; AXES],
            named: (0, 0),
            alarm: None,
            settling: Settling::default(),
            trust: Trust::default(),
            caution: [1.0, 0.0],
            least: Vec::new(),
            has_slow_duties: false,
            seen_before: VecDeque::new(),
            certain: 0,
            learnt_error: 0.0,
            time_s: 0.0,
            track: Track::default(),
            details: Details::default(),
            load_watch: LoadWatch::default(),
            growth_watch: GrowthWatch::default(),
            load: None,
            thrust: 1.0,
            uneven: [[1.0, 0.0]; MAX_ROTORS],
        }
    }

    /// The same for a vehicle for which earlier flights left gusts and white forces of these levels, N²: no calibration
    /// is calmer than that.
    #[must_use]
    pub(crate) fn with_noise(mut self, least: [[f64; 2]; AXES]) -> Self {
        self.filter.least = least;
        self.learnt_error = LEARNT_ERROR;
        self
    }

    /// The same if the downward velocity is integrated from the specific force: its noise is that of a force, not of a
    /// velocity.
    #[must_use]
    pub(crate) fn by_force(mut self, by_force: bool) -> Self {
        self.filter.by_force = by_force;
        if by_force {
            self.filter.gust_time = self.filter.gust_time.max(wrench::LEAST_GUST_TIME);
        }
        self
    }

    /// The same if the duties come from a stream with this interval, s, longer than that of the samples.
    #[must_use]
    pub(crate) fn duties_every(mut self, interval_s: Option<f64>) -> Self {
        if let Some(interval_s) = interval_s {
            self.meter.take_duty_interval(interval_s);
            self.has_slow_duties = true;
        }
        self
    }

    /// Processes a sample that the engine has accepted.
    pub fn step(&mut self, input: &Measurement) {
        self.meter.step(input);
    }

    /// A sample was lost or rejected.
    pub fn hold(&mut self) {
        self.meter.hold();
    }

    /// After the last sample of a window.
    ///
    /// * `calibrating`: the engine learns the disturbances   * `decides`: it returns verdicts
    pub fn close(&mut self, calibrating: bool, decides: bool) {
        let Some(block) = self.meter.close() else {
            return;
        };
        let weight = (block.elapsed / UNEXPLAINED_TIME).min(1.0);
        for axis in 0..AXES {
            let force = block.defect[axis] * self.meter.arm[axis] / block.elapsed.max(1e-6);
            self.unexplained[axis] += (force - self.unexplained[axis]) * weight;
        }
        if calibrating {
            self.filter.calibrate(block);
        } else if decides {
            if !self.filter.is_ready() {
                self.trust = Trust::calibrated(&self.filter.start());
            }
            if self.filter.is_ready() {
                self.take(block);
            }
        }
    }

    /// Wrench that lagged healthy rotors do not explain, low-passed, N and N·m.
    pub fn unexplained(&self) -> [f32; 4] {
        self.unexplained.map(|x| x as f32)
    }

    fn take(&mut self, block: Block) {
        self.settling.pass(block.elapsed);
        self.time_s += block.elapsed;
        if let Some(load) = &mut self.load {
            load.since_s += block.elapsed;
        }
        let frozen = self.alarm.is_some();
        let full = self
            .snapshots
            .back()
            .is_none_or(|(_, since)| since.len() >= SNAPSHOT_BLOCKS);
        if full && !frozen {
            if self.snapshots.len() >= SNAPSHOTS {
                self.snapshots.pop_front();
            }
            self.snapshots
                .push_back((self.filter.clone(), Vec::with_capacity(SNAPSHOT_BLOCKS)));
        }
        let demand = self.demand(&block, u32::MAX);
        let weight = (block.elapsed / UNEVEN_TIME).min(1.0);
        self.thrust = demand / block.elapsed.max(1e-6);
        for rotor in 0..self.rotor_count {
            let off = self.demand(&block, 1 << rotor) / demand.max(1e-6) - self.uneven[rotor][0];
            let [mean, variance] = &mut self.uneven[rotor];
            *mean += off * weight;
            *variance += (off * off - *variance) * weight;
        }
        let surprise = self.filter.step(&block, demand);
        self.trust.take(surprise);
        let (phis, noise) = (self.filter.phis(&block), self.filter.noise());
        for tracked in &mut self.tracked {
            tracked.step(&block, &phis, &noise);
        }
        if let Some((_, since)) = self.snapshots.back_mut() {
            since.push(block);
        }
        if self.snapshots.iter().map(|(_, since)| since.len()).sum::<usize>() > LONGEST_HISTORY {
            self.snapshots.clear();
        }
    }

    /// ∫ of the demand of some rotors relative to hover, s.
    fn demand(&self, block: &Block, rotors: u32) -> f64 {
        let mut sums = [0.0; 2];
        for rotor in (0..self.rotor_count).filter(|rotor| rotors >> rotor & 1 == 1) {
            sums[0] += block.thrust[rotor];
            sums[1] += self.hover_thrust[rotor];
        }
        sums[0] / sums[1].max(1e-6)
    }

    /// Goes back to before the fault, and follows the losses of these rotors, which become the first of the tracked
    /// sets.
    fn track(&mut self, rotors: u32) {
        if let Some(place) = self.tracked.iter().position(|tracked| tracked.rotors == rotors) {
            self.tracked[..=place].rotate_right(1);
            return;
        }
        let with_drag = rotors.count_ones() == 1;
        let joint = match self.snapshots.front() {
            Some((start, _)) => {
                // A loss that was there before the oldest snapshot is no bias.
                let was_healthy = self.weighed_by(start).is_none_or(|then| nothing(&then.found) > OVER);
                let spread = if was_healthy { 0.0 } else { UNKNOWN_LOSS };
                let mut joint = JointFilter::new(rotors, with_drag, &start.healthy(was_healthy), spread, &self.column);
                for (filter, since) in &self.snapshots {
                    for block in since {
                        joint.step(block, &filter.phis(block), &filter.noise());
                    }
                }
                joint
            }
            None => JointFilter::new(
                rotors,
                with_drag,
                &self.filter.healthy(false),
                UNKNOWN_LOSS,
                &self.column,
            ),
        };
        self.tracked.truncate(TRACKED - 1);
        self.tracked.insert(0, joint);
    }

    /// The lost wrench over all speeds.
    fn lost(filter: &WrenchFilter) -> ([f64; AXES], [f64; AXES]) {
        let speeds = filter.lost();
        let mean = |of: &dyn Fn(&AtSpeed) -> f64| speeds.iter().map(|at| at.probability * of(at)).sum::<f64>();
        let value: [f64; AXES] = std::array::from_fn(|axis| mean(&|at| at.value[axis]));
        let variance =
            std::array::from_fn(|axis| mean(&|at| at.variance[axis] + (at.value[axis] - value[axis]).powi(2)));
        (value, variance)
    }

    /// The lost wrench with its explanations; nothing if it is not finite.
    fn weighed(&self) -> Option<Weighed> {
        self.weighed_by(&self.filter)
    }

    fn weighed_by(&self, filter: &WrenchFilter) -> Option<Weighed> {
        let (value, variance) = Self::lost(filter);
        let is_finite = value.iter().chain(&variance).all(|x| x.is_finite());
        is_finite.then(|| Weighed {
            found: sets::weigh(&self.column, self.rotor_count, &value, &variance, self.hover),
            value,
            variance,
        })
    }

    /// Lost share of each tracked rotor now, and its standard deviation, bounded below by the disturbance that the
    /// calibration saw: a changing loss follows a disturbance of the same speed, whatever the filter's own variance
    /// says. The variance is scaled by how much worse than allowed the model has been, and an error of the hover thrust
    /// is also an error of its slope.
    fn severity(&self) -> Vec<[f64; 2]> {
        let Some(tracked) = self.tracked.first() else {
            return Vec::new();
        };
        let noise = self.filter.noise();
        let factor = self.caution[0];
        let relative = self.relative_error();
        let rotors = (0..self.rotor_count).filter(|rotor| tracked.rotors >> rotor & 1 == 1);
        tracked
            .lost()
            .into_iter()
            .zip(rotors)
            .map(|([share, variance], rotor)| {
                let model = (relative * share).powi(2) + MODEL_FLOOR.powi(2);
                let information = self.information(rotor, &std::array::from_fn(|axis| noise[axis].gust));
                let disturbance = 1.0 / (information * self.hover_thrust[rotor].powi(2));
                [share, ((factor * variance).max(disturbance) + model).sqrt()]
            })
            .collect()
    }

    /// Standard deviation of the scale of a loss.
    fn relative_error(&self) -> f64 {
        MODEL_ERROR
            .hypot(SLOPE_ERROR * self.caution[1])
            .hypot(self.learnt_error)
    }

    /// Details of the last verdict; empty without one.
    pub fn details(&self) -> &Details {
        &self.details
    }

    /// The remaining explanations of these, with their current sizes.
    fn explained(
        &self,
        found: &[Explanation],
        value: &[f64; AXES],
        variance: &[f64; AXES],
        named: Option<&[[f64; 2]]>,
    ) -> Vec<Explained> {
        let noise = self.filter.noise();
        let variance = std::array::from_fn(|axis| (self.caution[0] * variance[axis]).max(noise[axis].gust));
        let relative = self.relative_error();
        let listed = found.iter().filter(|e| e.probability >= LISTED);
        let explained = |e: &Explanation| {
            let kind = match e.kind {
                Kind::Losses => ExplanationKind::Loss,
                Kind::LossWithDrag => ExplanationKind::LossWithDrag,
                Kind::Gain => ExplanationKind::Gain,
                Kind::Load => ExplanationKind::Load,
                Kind::Nothing | Kind::Shift | Kind::Other => return None,
            };
            let sizes = sets::sizes(e, &self.column, value, &variance, self.hover);
            let with_model = |mean: f64, variance: f64, uneven: f64| {
                (variance + (relative.powi(2) + uneven) * mean * mean + MODEL_FLOOR.powi(2)).sqrt()
            };
            let mass_kg = (kind == ExplanationKind::Load).then(|| {
                let [force, variance] = sizes[0];
                let mass = self.thrust / self.gravity;
                let deviation = (variance + (relative * force).powi(2)).sqrt() * mass;
                Interval::of(force * mass, deviation, [f64::NEG_INFINITY, f64::INFINITY])
            });
            let rotors: Vec<usize> = (0..self.rotor_count)
                .filter(|rotor| e.rotors >> rotor & 1 == 1)
                .collect();
            let mut shares: Vec<[f64; 2]> = rotors
                .iter()
                .zip(&sizes)
                .map(|(rotor, [size, variance])| {
                    let [demand, uneven] = self.uneven[*rotor];
                    let thrust = self.hover_thrust[*rotor] * demand.max(0.1);
                    let mean = size / thrust;
                    [mean, with_model(mean, variance / thrust.powi(2), uneven)]
                })
                .collect();
            let is_loss = matches!(kind, ExplanationKind::Loss | ExplanationKind::LossWithDrag);
            if let Some(followed) = named.filter(|_| is_loss && e.rotors == self.named.0) {
                shares = followed.to_vec();
            }
            // Torque in addition to that of the lost thrust, over the remaining thrust: (1 − δ)(1 + d) = 1 − δ + η.
            let drag = (kind == ExplanationKind::LossWithDrag).then(|| {
                let [demand, uneven] = self.uneven[rotors[0]];
                let left = self.hover_thrust[rotors[0]] * demand.max(0.1) * (1.0 - shares[0][0]).max(0.1);
                let [torque, variance] = sizes[1];
                let mean = torque / left;
                let deviation = with_model(mean, variance / left.powi(2), uneven);
                Interval::of(mean, deviation, [0.0, f64::INFINITY])
            });
            let most = if is_loss { 1.0 } else { f64::INFINITY };
            Some(Explained {
                kind,
                rotors: e.rotors,
                probability: e.probability as f32,
                shares: shares
                    .iter()
                    .map(|[share, deviation]| Interval::of(*share, *deviation, [0.0, most]))
                    .collect(),
                drag,
                mass_kg,
            })
        };
        listed.filter_map(explained).collect()
    }

    /// Of wrenches with a variance on each axis on the lost thrust of a rotor, 1/N²: Σ F_ai²/V_a.
    fn information(&self, rotor: usize, variance: &[f64; AXES]) -> f64 {
        (0..AXES)
            .map(|axis| self.column[rotor][axis].powi(2) / variance[axis])
            .sum()
    }

    /// Smallest lost share of each rotor that would be found within ten seconds now; empty without a verdict, or while
    /// something is wrong. With slow duties it is the largest of the last ten seconds: how much they leave open differs from
    /// moment to moment, and the next ten seconds will be as the last ones.
    pub fn smallest_loss(&self) -> Vec<f32> {
        let mut least = self.seen_from();
        for past in &self.seen_before {
            for (least, past) in least.iter_mut().zip(past) {
                *least = least.max(*past);
            }
        }
        least
    }

    /// The same of this window.
    fn seen_from(&self) -> Vec<f32> {
        if !self.filter.is_ready() || self.alarm == Some(true) {
            return Vec::new();
        }
        self.found_from()
    }

    fn remember_seen_from(&mut self) {
        if !self.has_slow_duties {
            return;
        }
        let now = self.seen_from();
        if now.is_empty() {
            return;
        }
        if self.seen_before.len() >= SEEN_WITHIN_WINDOWS {
            self.seen_before.pop_front();
        }
        self.seen_before.push_back(now);
    }

    /// The same, whether or not something is wrong.
    fn found_from(&self) -> Vec<f32> {
        let variance = self.filter.variance_of_a_sudden_loss();
        let sigmas = SEEN_SIGMAS * self.trust.worst().max(1.0).sqrt();
        (0..self.rotor_count)
            .map(|rotor| {
                let information = self.information(rotor, &variance);
                let seen = (sigmas / information.sqrt()).max(self.settling.size()[rotor]);
                (seen / self.hover_thrust[rotor]) as f32
            })
            .collect()
    }

    /// The engine's report after the second look, or why it means nothing.
    pub fn revise(&mut self, report: FdiReport, output: &FdiOutput) -> Result<FdiReport, Obstacle> {
        self.details = Details::default();
        if !self.filter.is_ready() {
            return Ok(report);
        }
        self.remember_seen_from();
        let mut weighed = self.weighed();
        if let Some(load) = weighed.as_ref().and_then(|weighed| self.changed_load(weighed)) {
            self.take_load(&load);
            weighed = self.weighed();
        }
        let by_engine = !matches!(output.sequential, FaultVerdict::NotReady | FaultVerdict::Healthy);
        let is_found = by_engine || self.has_grown(weighed.as_ref()) || self.is_told();
        if !is_found {
            if self.alarm.take().is_some() {
                self.end_episode();
                self.snapshots.clear();
                self.tracked.clear();
                self.track.clear();
                self.named = (0, 0);
            }
            return Ok(self.with_doubt(report, weighed.as_ref()));
        }
        let Some(Weighed { value, variance, found }) = weighed else {
            return Ok(report);
        };
        let nothing = nothing(&found);
        let is_there = match self.alarm {
            Some(true) => nothing < OVER,
            None | Some(false) => nothing < BACK,
        };
        self.alarm = Some(is_there);
        if is_there && !self.settling.is_open() {
            self.begin_episode();
        }
        let said = self.said(report, &found, nothing, value[0]);
        if !is_there {
            self.growth_watch.clear();
            self.track.clear();
            self.end_episode();
            return said;
        }
        match &said {
            Ok(said) if said.sequential == AMBIGUOUS => {
                self.track.clear();
                self.details.explanations = self.explained(&found, &value, &variance, None);
            }
            Ok(_) => {
                let followed = self.severity();
                self.details = Details {
                    explanations: self.explained(&found, &value, &variance, Some(&followed)),
                    motion: Vec::new(),
                };
                self.track.push(self.named.0, self.time_s, followed);
                self.details.motion = self.track.motion(self.relative_error());
            }
            Err(_) => self.track.clear(),
        }
        let evidence = sets::chi_square(&value, &variance, self.hover) / self.trust.now().max(1.0);
        let is_strong = evidence > STRONG && self.trust.is_proven();
        let answer = match &said {
            Ok(said) if said.sequential == AMBIGUOUS && is_strong && evidence > STRONG_SETS => Answer::Sets,
            Ok(said) if said.sequential != AMBIGUOUS && self.is_real(is_strong) => Answer::Name(said.suspect_rotors),
            _ => Answer::Neither,
        };
        match self.settling.take(answer, is_strong, &self.column, &value) {
            true => said,
            false => Err(said.err().unwrap_or(Obstacle::Unclear)),
        }
    }

    /// A load that was dropped or picked up, once it is certain.
    fn changed_load(&mut self, weighed: &Weighed) -> Option<Found> {
        let of = |value: &[f64; AXES], variance: &[f64; AXES], found: &[Explanation]| Seen {
            force: [value[0], variance[0]],
            probability: found
                .iter()
                .filter(|e| e.kind == Kind::Load)
                .map(|e| e.probability)
                .sum(),
        };
        let Weighed { value, variance, found } = weighed;
        let mut seen = of(value, variance, found);
        let [force, spread] = self.filter.vertical();
        if force.is_finite() && spread.is_finite() && force * force > spread {
            let (mut value, mut variance) = (*value, *variance);
            (value[0], variance[0]) = (force, spread);
            let found = sets::weigh(&self.column, self.rotor_count, &value, &variance, self.hover);
            let alone = of(&value, &variance, &found);
            if alone.probability > seen.probability {
                seen = alone;
            }
        }
        let is_trusted = self.trust.is_proven() && self.trust.is_kept_before(self.load_watch.windows());
        self.load_watch.take(seen, self.weight(), is_trusted)
    }

    /// A rotor was reported in this episode. Its loss then lasts until the lost wrench is gone: the engine weighs the
    /// change alone, and one that it has not made part of its model fades as its filters take the loss for a bias.
    fn is_told(&self) -> bool {
        self.alarm == Some(true) && self.settling.is_told() && (self.named.0 | self.certain) != 0
    }

    /// A healthy report whose probability is that of the lost wrench where a rotor explains it beyond doubt that has not
    /// lost thrust for long enough to be found.
    fn with_doubt(&self, report: FdiReport, weighed: Option<&Weighed>) -> FdiReport {
        let Some(weighed) = weighed.filter(|weighed| report.sequential == HEALTHY && self.is_large_loss(weighed))
        else {
            return report;
        };
        FdiReport {
            sequential_probability: report.sequential_probability.min(nothing(&weighed.found) as f32),
            ..report
        }
    }

    fn is_large_loss(&self, weighed: &Weighed) -> bool {
        self.lone_rotor(weighed).is_some_and(|lone| lone.is_large)
    }

    /// There is a loss that has grown too slowly for the engine.
    fn has_grown(&mut self, weighed: Option<&Weighed>) -> bool {
        if self.growth_watch.is_found() {
            return true;
        }
        let lone = weighed.and_then(|weighed| self.lone_rotor(weighed));
        self.growth_watch
            .take(lone, self.trust.is_proven() && self.trust.is_kept())
    }

    /// The rotor whose loss alone explains the lost wrench, beyond doubt.
    fn lone_rotor(&self, weighed: &Weighed) -> Option<Lone> {
        let Weighed { value, variance, found } = weighed;
        let evidence = sets::chi_square(value, variance, self.hover) / self.trust.now().max(1.0);
        if evidence < GROWN {
            return None;
        }
        let best = found.first()?;
        let is_loss = matches!(best.kind, Kind::Losses | Kind::LossWithDrag) && best.rotors.count_ones() == 1;
        let same = found.iter().filter(|e| e.rotors == best.rotors && e.kind != Kind::Gain);
        if !is_loss || same.map(|e| e.probability).sum::<f64>() < NAMED {
            return None;
        }
        let rotor = best.rotors.trailing_zeros() as usize;
        let lost = sets::sizes(best, &self.column, value, variance, self.hover)[0][0] / self.hover_thrust[rotor];
        let smallest = f64::from(*self.seen_from().get(rotor)?);
        Some(Lone {
            rotor: best.rotors,
            is_large: lost > smallest,
        })
    }

    fn weight(&self) -> f64 {
        self.hover * self.rotor_count as f64
    }

    /// Makes a load part of the model: the mass of the momentum, the weight, and the moment as a bias. What the engine
    /// found was not a rotor.
    fn take_load(&mut self, load: &Found) {
        let Some((filter, [force, variance], after_s)) = self.filter_with_load(load.windows) else {
            return;
        };
        // Else it changed at another time.
        if (force - load.force * self.thrust).abs() > SAME_LOAD * force.abs() {
            return;
        }
        let mass = force / self.gravity;
        let scale = MODEL_ERROR.hypot(filter.thrust_error()).hypot(self.learnt_error);
        let air = self.filter.noise()[0].gust * self.trust.worst().max(1.0);
        let deviation = (variance + air).sqrt().hypot(scale * force) / self.gravity;
        self.meter.take_load(mass);
        self.filter = filter;
        self.unexplained[0] -= force;
        self.trust.forget(load.windows);
        self.snapshots.clear();
        self.tracked.clear();
        self.track.clear();
        self.named = (0, 0);
        self.alarm = None;
        self.settling.dismiss();
        self.load_watch.clear();
        self.growth_watch.clear();
        self.load = Some(LoadChange {
            since_s: after_s,
            named_after_s: after_s,
            probability: load.probability as f32,
            mass_kg: Interval::of(mass, deviation, [f64::NEG_INFINITY, f64::INFINITY]),
        });
    }

    /// Goes back to this many windows before the load changed, and runs the filter to the present with a load; also
    /// returns the downward force of the load, N, with its variance, and the time since, s.
    fn filter_with_load(&self, windows: usize) -> Option<(WrenchFilter, [f64; 2], f64)> {
        let mut count = 0;
        let first = self.snapshots.iter().rposition(|(_, since)| {
            count += since.len();
            count > windows + load::EARLIER
        })?;
        let mut filter = self.snapshots[first].0.clone();
        let blocks: Vec<Block> = self
            .snapshots
            .range(first..)
            .flat_map(|(_, since)| since.iter().copied())
            .collect();
        let (before, since) = blocks.split_at(count - windows - load::EARLIER);
        for block in before {
            filter.step(block, self.demand(block, u32::MAX));
        }
        let force = filter.take_load(
            since,
            load::EARLIER + load::LATER,
            self.hover * self.rotor_count as f64,
            self.gravity,
        );
        let after_s = since[load::EARLIER..].iter().map(|block| block.elapsed).sum();
        Some((filter, force, after_s))
    }

    /// The last load that was dropped or picked up since the calibration.
    pub fn load(&self) -> Option<LoadChange> {
        self.load
    }

    fn begin_episode(&mut self) {
        let before = self.snapshots.front().map_or(&self.filter, |(filter, _)| filter);
        self.caution = [self.trust.worst().max(1.0), before.thrust_error()];
        self.least = self.found_from();
        self.certain = 0;
        self.settling.begin(self.trust.is_kept());
        self.trust.begin();
    }

    fn end_episode(&mut self) {
        if self.settling.over() {
            self.trust.dismiss_surprises();
        }
    }

    /// The loss of the named rotors exceeds its own error, where that is required.
    fn is_real(&self, is_strong: bool) -> bool {
        let is_asked = self.settling.is_careful() || !is_strong;
        let is_large = |[share, deviation]: &[f64; 2]| *share > REAL_SIGMAS * deviation;
        !is_asked || self.severity().first().is_some_and(is_large)
    }

    /// Not the rotors that were named with certainty in this episode, nor more or fewer of them: they do not heal at the
    /// moment at which others fail.
    fn is_another(&self, rotors: u32) -> bool {
        let both = self.certain & rotors;
        self.certain != 0 && both != self.certain && both != rotors
    }

    /// Two rotors, one of which has lost less than would have been found when the episode began: what the model lacks
    /// leaves such a remainder beside a large loss.
    fn is_doubtful_pair(&mut self, rotors: u32) -> bool {
        if rotors.count_ones() != 2 {
            return false;
        }
        self.track(rotors);
        let members = (0..self.rotor_count).filter(|rotor| rotors >> rotor & 1 == 1);
        let losses = self.severity();
        members
            .zip(&losses)
            .any(|(rotor, [share, _])| self.least.get(rotor).is_some_and(|least| *share < f64::from(*least)))
    }

    /// Result of this window alone.
    fn said(
        &mut self,
        report: FdiReport,
        found: &[Explanation],
        nothing: f64,
        force_down: f64,
    ) -> Result<FdiReport, Obstacle> {
        let mut said = with_sequential(report, UNKNOWN);
        let of = |is: &dyn Fn(&Explanation) -> bool| found.iter().filter(|e| is(e)).map(|e| e.probability).sum::<f64>();
        // The same rotors, whatever happened to them.
        let mut sets: Vec<(u32, f64)> = Vec::new();
        for e in found.iter().filter(|e| e.rotors != 0) {
            match sets.iter_mut().find(|set| set.0 == e.rotors) {
                Some(set) => set.1 += e.probability,
                None => sets.push((e.rotors, e.probability)),
            }
        }
        sets.sort_by(|a, b| b.1.total_cmp(&a.1));
        let any: f64 = sets.iter().map(|set| set.1).sum();
        if self.alarm != Some(true) {
            said.sequential = HEALTHY;
            said.sequential_probability = nothing as f32;
            return Ok(said);
        }
        let load = of(&|e| e.kind == Kind::Load);
        if load > 0.5 * (1.0 - nothing) {
            let force_down = force_down * self.thrust;
            return Err(if load::is_possible(force_down / self.weight()) {
                Obstacle::Load {
                    mass_kg: (force_down / self.gravity) as f32,
                }
            } else {
                Obstacle::Unclear
            });
        }
        if any < 0.5 * (1.0 - nothing) {
            return Err(Obstacle::Unclear);
        }
        let known = sets
            .iter()
            .find(|set| set.0 == self.named.0 && set.1 > STILL_NAMED * (1.0 - nothing));
        let (first, probability) = *known.unwrap_or(&sets[0]);
        let has_twins = first.count_ones() == 2 && of(&|e| e.rotors.count_ones() > 2) > TWIN;
        let shares_axes = (0..self.rotor_count)
            .filter(|rotor| first >> rotor & 1 == 1)
            .any(|rotor| sets::shares_its_axis(&self.column, rotor));
        let enough = match known {
            _ if has_twins => SURE,
            // Its name in an earlier window proves nothing against the rotor above or below it.
            _ if shares_axes => NAMED,
            Some(_) => STILL_NAMED,
            None => NAMED,
        };
        let gain = of(&|e| e.kind == Kind::Gain && e.rotors == first);
        let rotors: Vec<usize> = (0..self.rotor_count).filter(|rotor| first >> rotor & 1 == 1).collect();
        said.suspect_rotors = first;
        let is_named = probability > enough * (1.0 - nothing) && gain < 0.5 * probability && rotors.len() <= 2;
        if is_named && !self.is_another(first) && !self.is_doubtful_pair(first) {
            said.sequential = match rotors.as_slice() {
                [one] => *one as i32 + 1,
                [one, two] => 100 * (*one as i32 + 1) + *two as i32 + 1,
                _ => UNKNOWN,
            };
            let windows = if self.named.0 == first { self.named.1 + 1 } else { 1 };
            self.named = (first, windows);
            let enough_windows = if self.settling.is_careful() {
                SURE_WINDOWS_CAREFUL
            } else {
                SURE_WINDOWS
            };
            let most = if windows < enough_windows || has_twins {
                NOT_SURE
            } else {
                1.0
            };
            said.sequential_probability = probability.min(most) as f32;
            if probability.min(most) >= SURE {
                self.certain = first;
            }
            self.track(first);
            let losses = self.severity();
            for (place, ([share, deviation], rotor)) in losses.iter().zip(&rotors).enumerate() {
                let nominal = self.hover_thrust[*rotor];
                let [share, low, high] =
                    [*share, share - SIGMAS * deviation, share + SIGMAS * deviation].map(|x| x.max(0.0));
                let [loss_n, low_n, high_n] = [share, low, high].map(|x| (x * nominal) as f32);
                let loss = LossEstimate {
                    loss_n,
                    low_n,
                    high_n,
                    share: share as f32,
                    share_low: low as f32,
                    share_high: high as f32,
                };
                if place == 0 {
                    said.thrust_loss = loss;
                } else {
                    said.second_thrust_loss = loss;
                }
            }
            return Ok(said);
        }
        self.named = (0, 0);
        said.sequential = AMBIGUOUS;
        said.sequential_probability = (1.0 - nothing) as f32;
        let listed: Vec<&(u32, f64)> = sets
            .iter()
            .filter(|set| set.1 >= LISTED || set.0 == self.certain || is_named && set.0 & first == set.0)
            .collect();
        let rest = 1.0 - nothing - listed.iter().map(|set| set.1).sum::<f64>();
        if listed.len() > MAX_HYPOTHESES || nothing > UNCLEAR || rest > UNCLEAR {
            return Err(Obstacle::Unclear);
        }
        said.suspect_rotors = listed.iter().fold(0, |mask, set| mask | set.0);
        said.hypothesis_count = listed.len() as u32;
        for (slot, set) in said.hypothesis_rotors.iter_mut().zip(&listed) {
            *slot = set.0;
        }
        Ok(said)
    }
}

/// Probability that nothing is lost.
fn nothing(found: &[Explanation]) -> f64 {
    let nothing = found.iter().filter(|e| e.kind == Kind::Nothing);
    nothing.map(|e| e.probability).sum()
}

/// A report whose sequential detector returns only a code.
pub(crate) fn with_sequential(report: FdiReport, code: i32) -> FdiReport {
    FdiReport {
        sequential: code,
        sequential_probability: 0.0,
        thrust_loss: LossEstimate::default(),
        second_thrust_loss: LossEstimate::default(),
        suspect_rotors: 0,
        hypothesis_count: 0,
        hypothesis_rotors: [0; MAX_HYPOTHESES],
        ..report
    }
}
