//! One hash over all samples of a run.
//!
//! XXH3-128 over the little-endian bytes of every signal of every step, in the order of [`RunHasher::update`]. What identifies an
//! execution rather than its result (run id, wall-clock times, link) stays out, so the same scenario and seed give the same hash
//! in-process, over iceoryx2, over zenoh and again tomorrow. It detects differences; it is not a signature against forgery.

use crate::flight::Sample;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::Scenario;
use xxhash_rust::xxh3::Xxh3;

/// Bytes of one step at most: 3 × 8 (truth header) + 4-byte and 8-byte signals, see `update`.
const CAPACITY: usize = 2048;

/// Content hash of a document: 32 hexadecimal digits.
pub fn content_hash(bytes: &[u8]) -> String {
    format!("{:032x}", xxhash_rust::xxh3::xxh3_128(bytes))
}

/// Content hash of the vehicle and the blades that are flown.
pub fn model_hash(scenario: &Scenario) -> String {
    let documents = scenario.documents();
    let json =
        serde_json::to_vec(&(&documents.vehicle, &documents.blades)).expect("documents of text and numbers are JSON");
    content_hash(&json)
}

/// Streams samples into a hash.
#[derive(Clone)]
pub struct RunHasher {
    state: Xxh3,
    rotor_count: usize,
    bytes: StepBytes,
}

impl RunHasher {
    /// A hash over no samples yet, of a vehicle with `rotor_count` rotors.
    pub fn new(rotor_count: usize) -> Self {
        assert!(rotor_count <= MAX_ROTORS, "a vehicle has at most {MAX_ROTORS} rotors");
        Self {
            state: Xxh3::new(),
            rotor_count,
            bytes: StepBytes::new(),
        }
    }

    /// Adds one step.
    pub fn update(&mut self, sample: &Sample) {
        let n = self.rotor_count;
        let bytes = &mut self.bytes;
        bytes.len = 0;
        bytes.u64(sample.sensors.stamp.step);
        bytes.u64(sample.sensors.stamp.sim_time_ns);

        let sensors = &sample.sensors;
        bytes.f32s(&sensors.position_ned_m);
        bytes.f32s(&sensors.velocity_ned_m_s);
        bytes.f32s(&sensors.attitude_rad);
        bytes.f32s(&sensors.body_rates_rad_s);
        bytes.f32s(&sensors.reference_position_ned_m);
        bytes.f32s(&sensors.reference_velocity_ned_m_s);
        bytes.f32s(&[sensors.reference_yaw_rad, sensors.battery_voltage_v]);

        let command = &sample.command;
        bytes.f32s(&command.duty[..n]);
        bytes.f32s(&command.attitude_setpoint_rad);
        bytes.u32(command.saturated_rotors);

        let report = &sample.report;
        for residual in &report.residuals_nms[..n] {
            bytes.f32s(residual);
        }
        bytes.f32s(&report.wrench_residual);
        for code in [report.t_test, report.network, report.sequential] {
            bytes.u32(code.cast_unsigned());
        }
        bytes.f32s(&[report.sequential_probability]);
        bytes.f32s(&report.thrust_loss.values());
        bytes.f32s(&report.second_thrust_loss.values());
        bytes.u32(report.suspect_rotors);
        bytes.u32(report.hypothesis_count);
        for rotors in report.hypothesis_rotors {
            bytes.u32(rotors);
        }
        bytes.u32(report.window_end);

        let truth = &sample.truth;
        bytes.f64s(&truth.position_ned_m);
        bytes.f64s(&truth.velocity_ned_m_s);
        bytes.f64s(&truth.attitude_rad);
        bytes.f64s(&truth.body_rates_rad_s);
        bytes.f64s(&truth.rotor_thrust_n[..n]);
        bytes.f64s(&[truth.state_of_charge, truth.battery_voltage_v, truth.battery_current_a]);
        bytes.u32(truth.faulty_rotors);
        self.state.update(self.bytes.filled());
    }

    /// The hash of everything added so far: 32 hexadecimal digits.
    pub fn digest(&self) -> String {
        format!("{:032x}", self.state.digest128())
    }
}

/// The signals of one step, laid out byte by byte.
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
    fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        self.buffer[self.len..self.len + N].copy_from_slice(&bytes);
        self.len += N;
    }

    #[inline]
    fn u32(&mut self, value: u32) {
        self.put(value.to_le_bytes());
    }

    #[inline]
    fn u64(&mut self, value: u64) {
        self.put(value.to_le_bytes());
    }

    #[inline]
    fn f32s(&mut self, values: &[f32]) {
        for value in values {
            self.put(value.to_le_bytes());
        }
    }

    #[inline]
    fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.put(value.to_le_bytes());
        }
    }

    #[inline]
    fn filled(&self) -> &[u8] {
        &self.buffer[..self.len]
    }
}
