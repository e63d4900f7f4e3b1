//! One session: the FDI engine of a run, and the rules for its input.
//!
//! The engine knows neither time nor gaps: it takes one sample every 2.5 ms. The session ensures that. A chunk of
//! samples is accepted or rejected as a whole, with one error message; a rejected chunk changes nothing.
//!
//! * *Order.* Each chunk gives its first step and continues where the last one ended. The last chunks ([`REMEMBERED`])
//!   may be sent again: the answer is the same and nothing is counted twice.
//! * *Numbers.* What a link of a run rejects is rejected here: NaN and infinity, a duty outside 0 to 1, a wrong number
//!   of rotors. Finite numbers that no flight can have (1000 m/s) go to the engine, which rejects and counts them, as
//!   in a run.
//! * *Rate.* If samples have a time, each interval must be between half and one and a half periods, and the mean of a
//!   hundred within 2 % of the period.
//! * *Gaps* are rejected unless the chunk says that the samples in between are lost. Over up to [`LONGEST_BRIDGE`]
//!   steps the engine coasts, as over a rejected sample; after a longer gap it restarts with a calibration, and the
//!   answer says so: *damage present by then counts as healthy*.
//! * *Validity* ([`super::validity`]). On the ground, for two seconds after it, and in an upset the engine is not fed
//!   (in a sharp turn that may become one it is, without verdicts); after that it restarts in the air. There, and where
//!   no possible loss explains the motion, windows are not ready and give the reason ([`Window::obstacle`]).
//!
//! Same samples, same bits: between gaps and in the air a session is the engine of a run, fed the same numbers.
//!
//! Glossary: *window*, 25 samples (a setting) with one verdict; *chunk*, the samples of one message.

use super::evidence::{Evidence, NetworkOverTime};
use super::learnt::{Corrected, Learner, Learnt};
use super::second_look::{Details, LoadChange, SecondLook, with_sequential};
use super::validity::{FlightWatch, MOST_TILT, ModelCheck, Obstacle};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;
use rotortwin_flight_core::fdi::window::{Baseline, WrenchStatistics};
use rotortwin_flight_core::fdi::{FdiConfig, FdiConfigError, FdiEngine, FdiOutput, Residuals};
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::signals::{Measurement, MotorCommand, NavState};
use rotortwin_wire::frames::{FdiReport, Stamp};
use rotortwin_wire::peers::report;
use std::collections::VecDeque;
use std::hash::Hasher as _;
use xxhash_rust::xxh3::Xxh3;

/// Maximum number of samples in a chunk: ten seconds.
pub const LONGEST_CHUNK: usize = 4000;
/// Chunks that may be sent again.
pub const REMEMBERED: usize = 8;
/// Steps over which the engine coasts; 20 ms, a few rotor time constants less than the window it would spoil. The same
/// time at other sampling rates.
pub const LONGEST_BRIDGE: u64 = 8;
const LONGEST_BRIDGE_S: f64 = 0.02;
/// Largest step number.
pub const LAST_STEP: u64 = 1 << 40;
/// Number of intervals over which the mean rate is computed.
const RATE_SAMPLES: u32 = 100;
/// The mean interval may differ from the period by this share: clocks differ by 1e-4, the next common rates by a fifth.
const RATE_TOLERANCE: f64 = 0.02;

/// One sample of a flight: the sensed state, the duty held from now on, the voltage; SI, NED and FRD.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// North, east, down, m.
    pub position_ned_m: [f32; 3],
    /// North, east, down, m/s.
    pub velocity_ned_m_s: [f32; 3],
    /// Roll, pitch, yaw (ZYX), rad, body in NED.
    pub attitude_rad: [f32; 3],
    /// p, q, r, rad/s, FRD.
    pub body_rates_rad_s: [f32; 3],
    /// Duty of each rotor over this step, fraction; 0 past the rotor count.
    pub duty: [f32; MAX_ROTORS],
    /// Voltage at the battery's terminals, V.
    pub battery_voltage_v: f32,
    /// Time of the sample, s, by any clock; without it the rate is not checked.
    pub time_s: Option<f64>,
}

impl Sample {
    /// The engine's input.
    #[inline]
    pub fn measurement(&self) -> Measurement {
        // +0 for −0, as every link of a run hands numbers over.
        let plus = |values: [f32; 3]| values.map(|value| value + 0.0);
        let [roll, pitch, yaw] = plus(self.attitude_rad);
        Measurement {
            nav: NavState {
                position_ned: Vec3::from_array(plus(self.position_ned_m)),
                velocity_ned: Vec3::from_array(plus(self.velocity_ned_m_s)),
                attitude: EulerAngles { roll, pitch, yaw },
                body_rates: Vec3::from_array(plus(self.body_rates_rad_s)),
            },
            command: MotorCommand {
                duty: self.duty.map(|duty| duty + 0.0),
            },
            battery_voltage: self.battery_voltage_v + 0.0,
        }
    }

    /// The first unacceptable number: field, value, what was expected.
    fn fault(&self, rotor_count: usize) -> Option<(String, f64, &'static str)> {
        let fields: [(&str, &[f32]); 5] = [
            ("position_ned_m", &self.position_ned_m),
            ("velocity_ned_m_s", &self.velocity_ned_m_s),
            ("attitude_rad", &self.attitude_rad),
            ("body_rates_rad_s", &self.body_rates_rad_s),
            ("battery_voltage_v", std::slice::from_ref(&self.battery_voltage_v)),
        ];
        for (field, values) in fields {
            if let Some(index) = values.iter().position(|value| !value.is_finite()) {
                let name = if values.len() == 1 {
                    field.to_owned()
                } else {
                    format!("{field}[{index}]")
                };
                return Some((name, f64::from(values[index]), "a finite number"));
            }
        }
        let (used, unused) = self.duty.split_at(rotor_count.min(MAX_ROTORS));
        if let Some(rotor) = used.iter().position(|duty| !(0.0..=1.0).contains(duty)) {
            return Some((
                format!("duty[{rotor}]"),
                f64::from(used[rotor]),
                "a fraction from 0 to 1",
            ));
        }
        if let Some(rotor) = unused.iter().position(|duty| *duty != 0.0) {
            let (index, value) = (rotor_count + rotor, f64::from(unused[rotor]));
            return Some((
                format!("duty[{index}]"),
                value,
                "nothing, because the vehicle has no such rotor",
            ));
        }
        self.time_s
            .filter(|time_s| !time_s.is_finite())
            .map(|time_s| ("time_s".to_owned(), time_s, "a finite number"))
    }

    fn hash_into(&self, hasher: &mut Xxh3) {
        let numbers = [
            self.position_ned_m,
            self.velocity_ned_m_s,
            self.attitude_rad,
            self.body_rates_rad_s,
        ];
        for value in numbers.as_flattened().iter().chain(&self.duty) {
            hasher.write_u32(value.to_bits());
        }
        hasher.write_u32(self.battery_voltage_v.to_bits());
        hasher.write_u64(self.time_s.map_or(u64::MAX, f64::to_bits));
    }
}

/// Consecutive samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chunk {
    /// Step of the first sample.
    pub first_step: u64,
    /// The samples between the last chunk and this one are permanently lost.
    pub after_gap: bool,
    /// In order, one per step.
    pub samples: Vec<Sample>,
}

impl Chunk {
    fn fingerprint(&self) -> u64 {
        let mut hasher = Xxh3::new();
        hasher.write_u64(self.first_step);
        for sample in &self.samples {
            sample.hash_into(&mut hasher);
        }
        hasher.finish()
    }
}

/// State of the detectors' calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Calibration {
    /// The sensor noise is being measured; no verdicts.
    Noise,
    /// Gust levels and mean residuals are being learnt; no verdicts, except those of a classifier that does not
    /// calibrate itself.
    Disturbances,
    /// There are verdicts.
    Done,
}

/// Result of a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Residuals and verdicts of the window's last step, as a run records them; `run_id` is the session's number, the time counts
    /// from the session's first step. The sequential verdict and its losses are those of the second look ([`super::second_look`]).
    pub report: FdiReport,
    /// The same before the second look, as a run would record it.
    pub engine: FdiReport,
    /// Probability that the network gives to healthy, rotor 1, rotor 2, …; empty without a verdict.
    pub class_probability: Vec<f32>,
    /// Output over time of a network that calibrates itself ([`super::evidence`]).
    pub network_over_time: NetworkOverTime,
    /// Mean of the 4-axis residual over the window, the network's input before the projection: down kg·m/s, roll, pitch and yaw kg·m²/s; 0 of a window that
    /// the engine was not fed.
    pub residual_mean: [f32; 4],
    /// Valid at this step.
    pub calibration: Calibration,
    /// Why there are no verdicts; absent while the detectors calibrate themselves.
    pub obstacle: Option<Obstacle>,
    /// Step at which its calibration began.
    pub calibrated_from: u64,
    /// Smallest lost share of each rotor's thrust that would be found within ten seconds now; empty without a verdict, and while something is
    /// wrong.
    pub smallest_loss: Vec<f32>,
    /// Details of a verdict other than healthy: explanations, and the rate of the loss; otherwise empty.
    pub details: Details,
    /// The last load that was dropped or picked up since the calibration; rotors are judged with it from the first
    /// window that has it.
    pub load: Option<LoadChange>,
}

/// Result of a chunk.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// First step of the chunk.
    pub first_step: u64,
    /// Expected first step of the next chunk.
    pub next_step: u64,
    /// Windows that ended in the chunk, in order.
    pub windows: Vec<Window>,
    /// Other events, one sentence each.
    pub notes: Vec<String>,
    /// The chunk had been accepted before; this is the answer that it got then.
    pub repeated: bool,
}

/// Why a chunk is rejected; none of it counts.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// No samples, or too many.
    #[error("the chunk has {found} samples, expected 1 to {LONGEST_CHUNK}")]
    Size {
        /// Samples received.
        found: usize,
    },
    /// Too large a step number.
    #[error("first_step is {found}, expected 0 to {LAST_STEP}")]
    Step {
        /// Received.
        found: u64,
    },
    /// Samples are missing and not declared as lost.
    #[error(
        "the chunk begins with step {found}, expected step {expected}: {} steps are missing; send them, or declare them lost (after_gap)",
        found - expected
    )]
    Gap {
        /// Expected step.
        expected: u64,
        /// Received step.
        found: u64,
    },
    /// Steps that were accepted before, with other numbers, or too long ago.
    #[error(
        "the chunk begins with step {found}, which was received before; expected step {expected}, or an exact repetition of a recent chunk"
    )]
    Past {
        /// Expected step.
        expected: u64,
        /// Received step.
        found: u64,
    },
    /// An impossible number.
    #[error("step {step} (sample {sample} of the chunk): {field} is {value}, expected {expected}")]
    Number {
        /// Step number.
        step: u64,
        /// Sample of the chunk, from 1.
        sample: usize,
        /// The field.
        field: String,
        /// What it holds.
        value: f64,
        /// The range, in words.
        expected: &'static str,
    },
    /// Time goes back, does not advance, or jumps.
    #[error(
        "step {step} (sample {sample} of the chunk): time_s is {interval_s:.6} s after the sample before, expected {period_s} s ± 50 %"
    )]
    Interval {
        /// Step number.
        step: u64,
        /// Sample of the chunk, from 1.
        sample: usize,
        /// Since the previous sample, s.
        interval_s: f64,
        /// Expected, s.
        period_s: f64,
    },
    /// The samples have a different rate.
    #[error(
        "the samples up to step {step} are {interval_s:.6} s apart in the mean of 100, expected {period_s} s within 2 %"
    )]
    Rate {
        /// Last of the hundred.
        step: u64,
        /// Mean interval, s.
        interval_s: f64,
        /// Expected, s.
        period_s: f64,
    },
}

/// A report whose verdicts would mean nothing; the residuals stay.
fn without_verdict(report: FdiReport) -> FdiReport {
    FdiReport {
        t_test: NOT_READY,
        network: NOT_READY,
        ..with_sequential(report, NOT_READY)
    }
}

/// A report whose losses are limited to the whole thrust of a rotor.
fn possible(mut report: FdiReport) -> FdiReport {
    for loss in [&mut report.thrust_loss, &mut report.second_thrust_loss] {
        *loss = loss.limited();
    }
    report
}

/// Watches the times of consecutive samples.
#[derive(Clone, Copy, Debug, Default)]
struct RateCheck {
    last_s: Option<f64>,
    /// Start of the hundred, and intervals since.
    anchor: Option<(f64, u32)>,
}

impl RateCheck {
    fn take(&mut self, time_s: Option<f64>, period_s: f64, step: u64, sample: usize) -> Result<(), Refusal> {
        let Some(time_s) = time_s else {
            *self = Self::default();
            return Ok(());
        };
        if let Some(last_s) = self.last_s {
            let interval_s = time_s - last_s;
            if !(0.5 * period_s..=1.5 * period_s).contains(&interval_s) {
                return Err(Refusal::Interval {
                    step,
                    sample,
                    interval_s,
                    period_s,
                });
            }
        }
        self.last_s = Some(time_s);
        let (start_s, intervals) = self.anchor.map_or((time_s, 0), |(start, count)| (start, count + 1));
        self.anchor = Some((start_s, intervals));
        if intervals == RATE_SAMPLES {
            let interval_s = (time_s - start_s) / f64::from(RATE_SAMPLES);
            if (interval_s / period_s - 1.0).abs() > RATE_TOLERANCE {
                return Err(Refusal::Rate {
                    step,
                    interval_s,
                    period_s,
                });
            }
            self.anchor = Some((time_s, 0));
        }
        Ok(())
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub struct FdiSession {
    number: u64,
    engine: Box<FdiEngine>,
    /// Content of the engine's own window and baseline, for the network's probabilities.
    window: WrenchStatistics,
    baseline: Baseline,
    flight: FlightWatch,
    check: ModelCheck,
    look: SecondLook,
    /// Of a network that calibrates itself.
    evidence: Option<Box<Evidence>>,
    /// What earlier flights said of the vehicle.
    corrected: Option<Box<Corrected>>,
    /// Learns from this flight.
    learner: Option<Box<Learner>>,
    /// See [`FdiSession::by_force`].
    by_force: bool,
    /// See [`FdiSession::duties_every`].
    duty_interval_s: Option<f64>,
    /// The reason why the engine is not fed, and steps since it began.
    paused: Option<(Obstacle, u64)>,
    /// A sharp turn within this window.
    turning: Option<Obstacle>,
    /// The obstacle at the last window.
    obstacle: Option<Obstacle>,
    calibration_steps: [u64; 2],
    /// First step ever, once there is one.
    origin: Option<u64>,
    next_step: u64,
    /// Step from which the calibration counts.
    started: u64,
    rate: RateCheck,
    remembered: VecDeque<(u64, Answer)>,
    last: Option<Window>,
    samples: u64,
    bridged_steps: u64,
    restarts: u64,
    rejected_before: u64,
    paused_steps: u64,
}

impl FdiSession {
    /// * `number`: not 0; goes into the stamps of the reports
    ///
    /// # Errors
    /// The engine rejects its configuration.
    pub fn new(config: FdiConfig, number: u64) -> Result<Self, FdiConfigError> {
        let engine = Box::new(FdiEngine::new(config)?);
        let steps = |seconds: f32| (seconds / config.period).round() as u32;
        let [start, end] = [config.t_test.baseline_start, config.t_test.baseline_end].map(steps);
        Ok(Self {
            number,
            engine,
            window: WrenchStatistics::default(),
            baseline: Baseline::new(start, end),
            flight: FlightWatch::new(&config),
            check: ModelCheck::new(&config),
            look: SecondLook::new(&config),
            evidence: Evidence::new(&config).map(Box::new),
            corrected: None,
            learner: None,
            by_force: false,
            duty_interval_s: None,
            paused: None,
            turning: None,
            obstacle: None,
            calibration_steps: [u64::from(start), u64::from(end)],
            origin: None,
            next_step: 0,
            started: 0,
            rate: RateCheck::default(),
            remembered: VecDeque::new(),
            last: None,
            samples: 0,
            bridged_steps: 0,
            restarts: 0,
            rejected_before: 0,
            paused_steps: 0,
        })
    }

    /// For a vehicle about which earlier flights have revealed more than its model; call before the first chunk.
    ///
    /// # Errors
    /// As [`FdiSession::new`].
    pub fn with_learnt(config: &FdiConfig, number: u64, learnt: &Learnt) -> Result<Self, FdiConfigError> {
        let config = learnt.config(config);
        let mut session = Self::new(config, number)?;
        session.corrected = Some(Box::new(Corrected::new(learnt.clone(), &config)));
        session.look = session.look.with_noise(learnt.least_noise());
        Ok(session)
    }

    /// The same for samples whose downward velocity is integrated from the specific force along the rotors' axis.
    #[must_use]
    pub fn by_force(mut self) -> Self {
        self.by_force = true;
        self.look = self.look.by_force(true);
        self
    }

    /// The same for samples whose duties lie on straight lines between those of a stream with this interval, s, which is
    /// longer than that of the samples; before the first chunk. What the duties did in between is then a white force.
    #[must_use]
    pub fn duties_every(mut self, interval_s: f64) -> Self {
        self.duty_interval_s = Some(interval_s);
        self.look = self.look.duties_every(Some(interval_s));
        self
    }

    /// The same for samples that are all of a flight in the air, as their caller knows from the whole log.
    #[must_use]
    pub fn in_the_air(mut self) -> Self {
        self.flight = self.flight.in_the_air();
        self
    }

    /// The same, for a healthy flight that a learner learns from.
    #[must_use]
    pub fn that_learns(mut self, learner: Learner) -> Self {
        self.learner = Some(Box::new(learner.and_a_flight(self.engine.config())));
        self
    }

    /// The learner, with everything that was fed to it.
    pub fn into_learner(self) -> Option<Learner> {
        self.learner.map(|learner| *learner)
    }

    /// Rotors of the vehicle.
    pub fn rotor_count(&self) -> usize {
        self.engine.config().geometry.rotor_count()
    }

    /// Time between two samples, s.
    pub fn period_s(&self) -> f64 {
        // 0.0025 in f32 is not 0.0025 in f64; steps are whole tens of microseconds.
        (f64::from(self.engine.config().period) * 1e8).round() / 1e8
    }

    /// Samples of a window.
    pub fn window_samples(&self) -> u16 {
        self.engine.config().window_len
    }

    /// First step of the session; `None` before its first chunk.
    pub fn origin(&self) -> Option<u64> {
        self.origin
    }

    /// Expected first step of the next chunk; any before the first chunk.
    pub fn next_step(&self) -> u64 {
        self.next_step
    }

    /// The last window.
    pub fn last(&self) -> Option<&Window> {
        self.last.as_ref()
    }

    /// Samples taken.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Samples that the engine rejected (no flight can have them).
    pub fn rejected_samples(&self) -> u64 {
        self.rejected_before
    }

    /// Number of lost steps over which the engine extrapolated.
    pub fn bridged_steps(&self) -> u64 {
        self.bridged_steps
    }

    /// Restarted calibrations: after gaps, pauses, and motions that the model does not explain.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Steps that the engine was not fed: on the ground, just off it, upset.
    pub fn paused_steps(&self) -> u64 {
        self.paused_steps
    }

    /// The present obstacle to verdicts.
    pub fn obstacle(&self) -> Option<Obstacle> {
        self.paused.map_or(self.obstacle, |(obstacle, _)| Some(obstacle))
    }

    /// State of the calibration.
    pub fn calibration(&self) -> Calibration {
        if self.paused.is_some() {
            return Calibration::Noise;
        }
        let since = self.next_step - self.started;
        match self.calibration_steps {
            [start, _] if since < start => Calibration::Noise,
            [_, end] if since < end => Calibration::Disturbances,
            _ => Calibration::Done,
        }
    }

    /// Step at which verdicts start, unless a gap is too long.
    pub fn verdicts_from_step(&self) -> u64 {
        self.started + self.calibration_steps[1]
    }

    /// Processes a chunk.
    ///
    /// # Errors
    /// One error message; none of the chunk counts.
    pub fn feed(&mut self, chunk: &Chunk) -> Result<Answer, Refusal> {
        let found = chunk.samples.len();
        if found == 0 || found > LONGEST_CHUNK {
            return Err(Refusal::Size { found });
        }
        if chunk.first_step > LAST_STEP {
            return Err(Refusal::Step {
                found: chunk.first_step,
            });
        }
        let fingerprint = chunk.fingerprint();
        let same = |(other, answer): &&(u64, Answer)| *other == fingerprint && answer.first_step == chunk.first_step;
        if let Some((_, answer)) = self.remembered.iter().find(same) {
            return Ok(Answer {
                repeated: true,
                ..answer.clone()
            });
        }
        let lost = self.lost_steps(chunk)?;
        // Nothing is changed before everything has been looked at.
        let mut rate = if lost == 0 { self.rate } else { RateCheck::default() };
        let (period_s, rotor_count) = (self.period_s(), self.rotor_count());
        for (index, sample) in chunk.samples.iter().enumerate() {
            let (step, number) = (chunk.first_step + index as u64, index + 1);
            if let Some((field, value, expected)) = sample.fault(rotor_count) {
                return Err(Refusal::Number {
                    step,
                    sample: number,
                    field,
                    value,
                    expected,
                });
            }
            rate.take(sample.time_s, period_s, step, number)?;
        }
        self.rate = rate;
        let answer = self.take(chunk, lost);
        self.remembered.push_back((fingerprint, answer.clone()));
        if self.remembered.len() > REMEMBERED {
            self.remembered.pop_front();
        }
        Ok(answer)
    }

    /// Steps lost before a chunk.
    fn lost_steps(&self, chunk: &Chunk) -> Result<u64, Refusal> {
        let (expected, found) = (self.next_step, chunk.first_step);
        match self.origin {
            None => Ok(0),
            Some(_) if found < expected => Err(Refusal::Past { expected, found }),
            Some(_) if found > expected && !chunk.after_gap => Err(Refusal::Gap { expected, found }),
            Some(_) => Ok(found - expected),
        }
    }

    fn take(&mut self, chunk: &Chunk, lost: u64) -> Answer {
        let mut notes = Vec::new();
        let mut windows = Vec::new();
        if self.origin.is_none() {
            self.origin = Some(chunk.first_step);
            self.started = chunk.first_step;
            self.next_step = chunk.first_step;
        }
        if lost as f64 * self.period_s() > LONGEST_BRIDGE_S {
            self.flight.restart();
            self.paused = None;
            self.restart(chunk.first_step);
            notes.push(format!(
                "{lost} steps were lost before step {}: the calibration began again, verdicts come from step {}; what is damaged by \
                 then counts as healthy",
                chunk.first_step,
                self.verdicts_from_step()
            ));
        } else if lost > 0 {
            self.bridged_steps += lost;
            notes.push(format!(
                "{lost} steps were lost before step {}: the engine extrapolated over them",
                chunk.first_step
            ));
            let nothing = Measurement {
                battery_voltage: f32::NAN,
                ..Measurement::default()
            };
            for _ in 0..lost {
                self.engine.step(&nothing);
                self.hold();
                self.next_step += 1;
            }
        }
        for sample in &chunk.samples {
            if let Some(window) = self.step(sample, &mut notes) {
                windows.push(window);
            }
        }
        self.samples += chunk.samples.len() as u64;
        if let Some(window) = windows.last() {
            self.last = Some(window.clone());
        }
        Answer {
            first_step: chunk.first_step,
            next_step: self.next_step,
            windows,
            notes,
            repeated: false,
        }
    }

    /// A sample was lost or rejected.
    fn hold(&mut self) {
        self.look.hold();
        if let Some(learner) = &mut self.learner {
            learner.hold();
        }
    }

    fn restart(&mut self, step: u64) {
        let config = *self.engine.config();
        *self.engine = FdiEngine::new(config).expect("it was taken before");
        self.window.clear();
        let [start, end] = self.calibration_steps.map(|steps| steps as u32);
        self.baseline = Baseline::new(start, end);
        self.check = ModelCheck::new(&config);
        self.look = SecondLook::new(&config)
            .by_force(self.by_force)
            .duties_every(self.duty_interval_s);
        if let Some(evidence) = &mut self.evidence {
            evidence.restart();
        }
        if let Some(corrected) = &mut self.corrected {
            self.look = self.look.clone().with_noise(corrected.noise());
            corrected.begin();
        }
        if let Some(learner) = &mut self.learner {
            learner.begin();
        }
        self.turning = None;
        self.obstacle = None;
        self.started = step;
        self.next_step = step;
        self.restarts += 1;
    }

    #[inline]
    fn step(&mut self, sample: &Sample, notes: &mut Vec<String>) -> Option<Window> {
        let measurement = match &mut self.corrected {
            Some(corrected) => corrected.of(&sample.measurement()),
            None => sample.measurement(),
        };
        match self.flight.step(&measurement) {
            // Tilted further soon, at these rates. Most often it is a sharp turn: the engine goes on, and begins again only if it was an upset.
            Some(obstacle @ Obstacle::Upset { tilt }) if tilt < MOST_TILT && self.paused.is_none() => {
                self.turning = Some(obstacle);
            }
            Some(obstacle) => return self.pause(obstacle, notes),
            None => {}
        }
        if let Some((obstacle, _)) = self.paused.take() {
            self.restart(self.next_step);
            notes.push(format!(
                "step {}: in the air again ({obstacle}); the calibration began again, verdicts come from step {}; what is damaged by then counts \
                 as healthy",
                self.next_step,
                self.verdicts_from_step()
            ));
        }
        let rejected = self.engine_rejections();
        let step = self.next_step;
        let output = self.engine.step(&measurement);
        self.next_step += 1;
        if output.rejected_samples > rejected {
            self.rejected_before += 1;
            self.hold();
            return None;
        }
        self.look.step(&measurement);
        if let Some(learner) = &mut self.learner {
            learner.step(&measurement);
        }
        let calibrated = self.baseline.mean();
        self.baseline.push(&output.wrench_residual);
        self.window.push(&output.wrench_residual);
        if !output.window_end {
            return None;
        }
        let class_probability = self.class_probability(calibrated);
        let residual_mean = self.window.mean();
        let calibration = self.calibration();
        self.window.clear();
        self.look.close(
            calibration == Calibration::Disturbances,
            calibration == Calibration::Done,
        );
        let spoilt = self.check.is_spoilt();
        if calibration != Calibration::Noise {
            let calibrating = calibration != Calibration::Done;
            let before = self.obstacle;
            self.obstacle = self
                .check
                .window(&self.look.unexplained(), self.flight.thrust(), &output, calibrating);
            if let (None, Some(obstacle)) = (before, self.obstacle) {
                notes.push(format!("step {step}: no verdicts: {obstacle}"));
            }
        }
        if let Some(learner) = &mut self.learner {
            let counts = calibration != Calibration::Noise && self.obstacle.or(self.turning).is_none();
            learner.close(counts);
        }
        let engine = report(self.stamp(step), &output).canonical();
        let looked = self.look.revise(engine, &output);
        let load = self.look.load();
        if let Some(load) = load.filter(LoadChange::is_new) {
            notes.push(format!(
                "step {step}: {load}; rotors are judged with the new weight from here on"
            ));
        }
        let obstacle = self.obstacle.or(self.turning.take()).or(looked.err());
        let report = possible(looked.unwrap_or(engine));
        let (smallest_loss, details) = if obstacle.is_none() {
            (self.look.smallest_loss(), self.look.details().clone())
        } else {
            (Vec::new(), Details::default())
        };
        let network_over_time = self.network_over_time(&residual_mean, calibration, obstacle.is_some());
        let window = Window {
            engine,
            report: obstacle.map_or(report, |_| without_verdict(report)),
            class_probability: if obstacle.is_none() {
                class_probability
            } else {
                Vec::new()
            },
            network_over_time,
            residual_mean,
            calibration,
            obstacle,
            calibrated_from: self.started,
            smallest_loss,
            details,
            load,
        };
        if spoilt && self.obstacle.is_none() {
            self.restart(self.next_step);
            notes.push(format!(
                "step {}: the model explains the motion again; the calibration began again, verdicts come from step {}; what is damaged by then \
                 counts as healthy",
                self.next_step,
                self.verdicts_from_step()
            ));
        }
        Some(window)
    }

    /// A step with which the engine is not fed; at the end of each window, the reason.
    fn pause(&mut self, obstacle: Obstacle, notes: &mut Vec<String>) -> Option<Window> {
        let step = self.next_step;
        self.next_step += 1;
        self.paused_steps += 1;
        if self.paused.is_none() {
            notes.push(format!("step {step}: the detectors wait: {obstacle}"));
        }
        let since = self.paused.map_or(0, |(_, since)| since) + 1;
        self.paused = Some((obstacle, since));
        since.is_multiple_of(u64::from(self.window_samples())).then(|| {
            let empty = report(self.stamp(step), self.engine.output()).canonical();
            let empty = FdiReport {
                window_end: 1,
                ..without_verdict(empty)
            };
            Window {
                report: empty,
                engine: empty,
                class_probability: Vec::new(),
                network_over_time: NetworkOverTime::NOT_READY,
                residual_mean: [0.0; 4],
                calibration: Calibration::Noise,
                obstacle: Some(obstacle),
                calibrated_from: self.started,
                smallest_loss: Vec::new(),
                details: Details::default(),
                load: None,
            }
        })
    }

    fn engine_rejections(&self) -> u32 {
        self.engine.output().rejected_samples
    }

    fn stamp(&self, step: u64) -> Stamp {
        let since = step - self.origin.unwrap_or(step);
        Stamp {
            run_id: self.number,
            step,
            sim_time_ns: since * (self.period_s() * 1e9).round() as u64,
        }
    }

    /// The network's probabilities for the window that ends, with the same recursions as the engine; `calibrated` as of
    /// before the last sample.
    fn class_probability(&self, calibrated: Option<[f32; 4]>) -> Vec<f32> {
        let config = self.engine.config();
        let Some(network) = &config.network else {
            return Vec::new();
        };
        let offset = if network.self_calibrated() {
            calibrated.and_then(|_| self.baseline.mean())
        } else {
            Some([0.0; 4])
        };
        let Some(offset) = offset else {
            return Vec::new();
        };
        let mut mean = self.window.mean();
        for axis in 0..4 {
            mean[axis] -= offset[axis];
        }
        let probability = network.class_probabilities(&Residuals::from_wrench(&config.geometry, &mean));
        probability[..=network.rotor_count()].to_vec()
    }

    /// The network's output over time, with the window that ends.
    fn network_over_time(
        &mut self,
        residual_mean: &[f32; 4],
        calibration: Calibration,
        is_obstructed: bool,
    ) -> NetworkOverTime {
        let Some(evidence) = &mut self.evidence else {
            return NetworkOverTime::NOT_READY;
        };
        match calibration {
            Calibration::Noise => {}
            Calibration::Disturbances => evidence.calibrate(residual_mean),
            Calibration::Done if is_obstructed => evidence.hold(),
            Calibration::Done => return evidence.window(residual_mean),
        }
        NetworkOverTime::NOT_READY
    }

    /// The engine's last output.
    pub fn output(&self) -> &FdiOutput {
        self.engine.output()
    }
}
