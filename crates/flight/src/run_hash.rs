//! One hash over all samples of a run.
//!
//! XXH3-128 over the little-endian bytes of every signal of every step, in the order of [`RunHasher::update`]. Anything that identifies
//! an execution rather than its result (run id, wall-clock times, link) is excluded, so the same scenario and seed always give the same
//! hash, in-process, over iceoryx2 and over zenoh. It detects differences; it is not a signature against forgery.

use crate::sample::Sample;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::{FdiReport, MAX_HYPOTHESES};
use xxhash_rust::xxh3::Xxh3;

/// Maximum bytes per step, with 16 rotors: 16 (truth header), 141 signals of 4 bytes, 31 of 8, see [`RunHasher::update_step`].
const STEP_CAPACITY: usize = 1024;

/// Bytes hashed at a time: several steps, as the hash copies its input in smaller pieces.
const CAPACITY: usize = 4096;

/// Content hash of a document: 32 hexadecimal digits.
pub fn content_hash(bytes: &[u8]) -> String {
    format!("{:032x}", xxhash_rust::xxh3::xxh3_128(bytes))
}

/// Content hash of the vehicle and the blades flown.
pub fn model_hash(scenario: &Scenario) -> String {
    let documents = scenario.documents();
    let json =
        serde_json::to_vec(&(&documents.vehicle, &documents.blades)).expect("documents of text and numbers are JSON");
    content_hash(&json)
}

/// Hashes a stream of samples.
#[derive(Clone)]
pub struct RunHasher {
    state: Xxh3,
    rotor_count: usize,
    /// Steps not yet added to the state.
    waiting: StepBytes,
}

impl RunHasher {
    /// An empty hash for a vehicle with `rotor_count` rotors.
    pub fn new(rotor_count: usize) -> Self {
        assert!(rotor_count <= MAX_ROTORS, "a vehicle has at most {MAX_ROTORS} rotors");
        Self {
            state: Xxh3::new(),
            rotor_count,
            waiting: StepBytes::new(),
        }
    }

    /// Adds one step.
    pub fn update(&mut self, sample: &Sample) {
        let n = self.rotor_count;
        let (sensors, truth) = (&sample.sensors, &sample.truth);
        self.update_step(&HashedStep {
            step: sensors.stamp.step,
            sim_time_ns: sensors.stamp.sim_time_ns,
            sensed: &sensors.numbers(),
            duty: &sample.command.duty[..n],
            attitude_setpoint_rad: &sample.command.attitude_setpoint_rad,
            saturated_rotors: sample.command.saturated_rotors,
            residuals: sample.report.residuals_nms[..n].as_flattened(),
            wrench_residual: &sample.report.wrench_residual,
            verdicts: &VerdictBytes::of(&sample.report),
            window_end: sample.report.window_end,
            motion: &truth.motion(),
            rotor_thrust_n: &truth.rotor_thrust_n[..n],
            battery: &[truth.state_of_charge, truth.battery_voltage_v, truth.battery_current_a],
            faulty_rotors: truth.faulty_rotors,
        });
    }

    /// Adds one step: the single definition of what is hashed, and in which order.
    #[inline]
    pub(crate) fn update_step(&mut self, s: &HashedStep<'_>) {
        let bytes = &mut self.waiting;
        bytes.u64(s.step);
        bytes.u64(s.sim_time_ns);
        bytes.f32s(s.sensed);

        bytes.f32s(s.duty);
        bytes.f32s(s.attitude_setpoint_rad);
        bytes.u32(s.saturated_rotors);

        bytes.f32s(s.residuals);
        bytes.f32s(s.wrench_residual);
        bytes.put(&s.verdicts.0);
        bytes.u32(s.window_end);

        bytes.f64s(s.motion);
        bytes.f64s(s.rotor_thrust_n);
        bytes.f64s(s.battery);
        bytes.u32(s.faulty_rotors);
        if bytes.len > CAPACITY - STEP_CAPACITY {
            self.state.update(bytes.filled());
            bytes.len = 0;
        }
    }

    /// The hash of everything added so far: 32 hexadecimal digits.
    pub fn digest(&self) -> String {
        let mut state = self.state.clone();
        state.update(self.waiting.filled());
        format!("{:032x}", state.digest128())
    }
}

/// Hashed content of one step.
pub(crate) struct HashedStep<'a> {
    pub(crate) step: u64,
    pub(crate) sim_time_ns: u64,
    /// Position, velocity, attitude, body rates; reference position and velocity; reference yaw; battery voltage.
    pub(crate) sensed: &'a [f32; 20],
    pub(crate) duty: &'a [f32],
    pub(crate) attitude_setpoint_rad: &'a [f32; 3],
    pub(crate) saturated_rotors: u32,
    pub(crate) residuals: &'a [f32],
    pub(crate) wrench_residual: &'a [f32; 4],
    pub(crate) verdicts: &'a VerdictBytes,
    pub(crate) window_end: u32,
    /// Position, velocity, attitude, body rates.
    pub(crate) motion: &'a [f64; 12],
    pub(crate) rotor_thrust_n: &'a [f64],
    /// State of charge, voltage, current.
    pub(crate) battery: &'a [f64; 3],
    pub(crate) faulty_rotors: u32,
}

/// Hashed part of a report other than its residuals: verdicts, probability, losses, suspects. Constant over the steps of a window.
#[derive(Clone)]
pub(crate) struct VerdictBytes([u8; 4 * VERDICT_WORDS]);

/// Three verdicts, a probability, two estimates, and the suspects.
const VERDICT_WORDS: usize = 3 + 1 + 2 * 6 + 2 + MAX_HYPOTHESES;

impl VerdictBytes {
    pub(crate) fn of(report: &FdiReport) -> Self {
        let verdicts = [report.t_test, report.network, report.sequential].map(i32::cast_unsigned);
        let losses = [report.thrust_loss.values(), report.second_thrust_loss.values()];
        let words = verdicts
            .into_iter()
            .chain([report.sequential_probability.to_bits()])
            .chain(losses.as_flattened().iter().map(|loss| loss.to_bits()))
            .chain([report.suspect_rotors, report.hypothesis_count])
            .chain(report.hypothesis_rotors);
        let mut bytes = [0; 4 * VERDICT_WORDS];
        for (place, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        Self(bytes)
    }
}

/// Serialised signals of several steps.
#[derive(Clone)]
struct StepBytes {
    buffer: [u8; CAPACITY],
    len: usize,
}

impl StepBytes {
    #[inline]
    fn new() -> Self {
        Self {
            buffer: [0; CAPACITY],
            len: 0,
        }
    }

    #[inline]
    fn put<const N: usize>(&mut self, bytes: &[u8; N]) {
        self.buffer[self.len..self.len + N].copy_from_slice(bytes);
        self.len += N;
    }

    #[inline]
    fn u32(&mut self, value: u32) {
        self.put(&value.to_le_bytes());
    }

    #[inline]
    fn u64(&mut self, value: u64) {
        self.put(&value.to_le_bytes());
    }

    #[inline]
    fn f32s(&mut self, values: &[f32]) {
        let end = self.len + 4 * values.len();
        let places = self.buffer[self.len..end].as_chunks_mut::<4>().0;
        for (place, value) in places.iter_mut().zip(values) {
            *place = value.to_le_bytes();
        }
        self.len = end;
    }

    #[inline]
    fn f64s(&mut self, values: &[f64]) {
        let end = self.len + 8 * values.len();
        let places = self.buffer[self.len..end].as_chunks_mut::<8>().0;
        for (place, value) in places.iter_mut().zip(values) {
            *place = value.to_le_bytes();
        }
        self.len = end;
    }

    #[inline]
    fn filled(&self) -> &[u8] {
        &self.buffer[..self.len]
    }
}
