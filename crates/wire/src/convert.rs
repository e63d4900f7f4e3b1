//! Conversion between native frames ([`crate::frames`]) and generated messages ([`crate::proto`]), with validation.
//!
//! Everything received from another process is checked here once: every number finite, every duty a fraction, every array of the
//! expected length. The error message names message, field, value and what was expected; no input causes a panic.
//!
//! Protobuf does not carry the sign of a zero in a scalar field (−0 equals the default and is omitted). Links of every kind
//! therefore deliver frames in their `canonical` form, with −0 replaced by +0: see [`SensorFrame::canonical`].

use crate::frames::{CommandFrame, FdiReport, LossEstimate, MAX_HYPOTHESES, SensorFrame, Stamp};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_flight_core::fdi::verdict_code::{AMBIGUOUS, HEALTHY, NOT_READY, UNKNOWN, named_rotors, of_pair};
use rotortwin_proto::{self as proto, verdict::Kind};

/// Why a message was rejected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConvertError {
    /// A field is absent.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A number is NaN or infinite.
    #[error("{field} is {value}, expected a finite number")]
    NotFinite {
        /// Message and field, with the index in an array.
        field: String,
        /// Value found.
        value: f32,
    },
    /// A number is outside its range.
    #[error("{field} is {value}, expected {expected}")]
    OutOfRange {
        /// Message and field, with the index in an array.
        field: String,
        /// Value found.
        value: f64,
        /// The range, human-readable.
        expected: &'static str,
    },
    /// An array has a wrong length.
    #[error("{field} has {found} entries, expected {expected}")]
    Length {
        /// Message and field.
        field: &'static str,
        /// Entries received.
        found: usize,
        /// Valid lengths, human-readable.
        expected: String,
    },
    /// Bytes that do not decode as this message.
    #[error("{message} cannot be decoded: {reason}")]
    Malformed {
        /// Message.
        message: &'static str,
        /// The decoder's message.
        reason: String,
    },
}

/// Fails on the first entry of `values` that is NaN or infinite.
fn finite(field: &str, values: &[f32]) -> Result<(), ConvertError> {
    // One branch-free pass for the good case: this runs in each step.
    if values.iter().all(|value| value.is_finite()) {
        return Ok(());
    }
    let (index, value) = values
        .iter()
        .enumerate()
        .find(|(_, value)| !value.is_finite())
        .expect("one of them is not finite");
    let field = if values.len() == 1 {
        field.to_owned()
    } else {
        format!("{field}[{index}]")
    };
    Err(ConvertError::NotFinite { field, value: *value })
}

/// Checks sensors received from the plant: every number finite.
pub fn check_sensors(frame: &SensorFrame) -> Result<(), ConvertError> {
    finite("SensorFrame.position_ned_m", &frame.position_ned_m)?;
    finite("SensorFrame.velocity_ned_m_s", &frame.velocity_ned_m_s)?;
    finite("SensorFrame.attitude_rad", &frame.attitude_rad)?;
    finite("SensorFrame.body_rates_rad_s", &frame.body_rates_rad_s)?;
    finite("SensorFrame.reference_position_ned_m", &frame.reference_position_ned_m)?;
    finite(
        "SensorFrame.reference_velocity_ned_m_s",
        &frame.reference_velocity_ned_m_s,
    )?;
    finite("SensorFrame.reference_yaw_rad", &[frame.reference_yaw_rad])?;
    finite("SensorFrame.battery_voltage_v", &[frame.battery_voltage_v])
}

/// Checks a command received from a controller: every duty a fraction, none for rotors that do not exist.
///
/// * `rotor_count`: of the vehicle, at most [`MAX_ROTORS`]
pub fn check_command(frame: &CommandFrame, rotor_count: usize) -> Result<(), ConvertError> {
    let rotor_count = rotor_count.min(MAX_ROTORS);
    let (present, absent) = frame.duty.split_at(rotor_count);
    if !present.iter().all(|duty| (0.0..=1.0).contains(duty)) {
        finite("MotorCommand.duty", present)?;
        for (index, &duty) in present.iter().enumerate() {
            if !(0.0..=1.0).contains(&duty) {
                return Err(ConvertError::OutOfRange {
                    field: format!("MotorCommand.duty[{index}]"),
                    value: f64::from(duty),
                    expected: "a fraction from 0 to 1",
                });
            }
        }
    }
    if let Some(index) = absent.iter().position(|&duty| duty != 0.0) {
        return Err(ConvertError::OutOfRange {
            field: format!("MotorCommand.duty[{}]", rotor_count + index),
            value: f64::from(absent[index]),
            expected: "0, because the vehicle has no such rotor",
        });
    }
    finite("MotorCommand.attitude_setpoint", &frame.attitude_setpoint_rad)
}

/// Checks a report received from an FDI engine: every number finite, every verdict a known one.
///
/// * `rotor_count`: of the vehicle, at most [`MAX_ROTORS`]
pub fn check_report(frame: &FdiReport, rotor_count: usize) -> Result<(), ConvertError> {
    finite("FdiReport.residual_nms", frame.residuals_nms.as_flattened())?;
    finite("FdiReport.wrench_residual", &frame.wrench_residual)?;
    check_loss("FdiReport.thrust_loss", &frame.thrust_loss)?;
    check_loss("FdiReport.second_thrust_loss", &frame.second_thrust_loss)?;
    if !(0.0..=1.0).contains(&frame.sequential_probability) {
        return Err(ConvertError::OutOfRange {
            field: "FdiReport.sequential_probability".to_owned(),
            value: f64::from(frame.sequential_probability),
            expected: "a fraction from 0 to 1",
        });
    }
    let highest = i32::try_from(rotor_count.min(MAX_ROTORS)).expect("MAX_ROTORS fits in i32");
    for (field, code) in [("t_test", frame.t_test), ("network", frame.network)] {
        if !(NOT_READY..=highest).contains(&code) {
            return Err(ConvertError::OutOfRange {
                field: format!("FdiReport.{field}"),
                value: f64::from(code),
                expected: "-2 (not ready), -1 (unknown), 0 (healthy) or the number of a rotor",
            });
        }
    }
    let code = frame.sequential;
    let is_of_the_vehicle = |rotor: u32| rotor <= highest.unsigned_abs();
    if FaultVerdict::of_code(code).is_none() || !named_rotors(code).all(is_of_the_vehicle) {
        return Err(ConvertError::OutOfRange {
            field: "FdiReport.sequential".to_owned(),
            value: f64::from(code),
            expected: "-3 (ambiguous), -2 (not ready), -1 (unknown), 0 (healthy), the number of a rotor, or of two as 100 i + j",
        });
    }
    let beyond = |mask: u32| mask >> rotor_count.min(MAX_ROTORS) != 0;
    if beyond(frame.suspect_rotors) {
        return Err(ConvertError::OutOfRange {
            field: "FdiReport.suspect_rotors".to_owned(),
            value: f64::from(frame.suspect_rotors),
            expected: "bits of rotors that the vehicle has",
        });
    }
    let listed = frame.hypothesis_count.min(MAX_HYPOTHESES as u32) as usize;
    for (index, &mask) in frame.hypothesis_rotors.iter().enumerate() {
        if (mask != 0) != (index < listed) || beyond(mask) {
            return Err(ConvertError::OutOfRange {
                field: format!("FdiReport.hypothesis_rotors[{index}]"),
                value: f64::from(mask),
                expected: "bits of rotors that the vehicle has, up to hypothesis_count",
            });
        }
    }
    Ok(())
}

fn check_loss(field: &'static str, loss: &LossEstimate) -> Result<(), ConvertError> {
    finite(field, &loss.values())?;
    let ordered = |low: f32, middle: f32, high: f32| 0.0 <= low && low <= middle && middle <= high;
    let without_interval = LossEstimate {
        loss_n: loss.loss_n,
        ..LossEstimate::default()
    };
    if *loss == without_interval {
        return Ok(());
    }
    if ordered(loss.low_n, loss.loss_n, loss.high_n) && ordered(loss.share_low, loss.share, loss.share_high) {
        return Ok(());
    }
    Err(ConvertError::OutOfRange {
        field: field.to_owned(),
        value: f64::from(loss.loss_n),
        expected: "a loss of 0 or more inside of its interval",
    })
}

/// Replaces −0 by +0.
#[inline]
fn plus_zero(values: &mut [f32]) {
    for value in values {
        *value += 0.0;
    }
}

impl SensorFrame {
    /// The same frame with every −0 replaced by +0, as every link delivers it.
    #[inline]
    #[must_use]
    pub fn canonical(mut self) -> Self {
        plus_zero(&mut self.position_ned_m);
        plus_zero(&mut self.velocity_ned_m_s);
        plus_zero(&mut self.attitude_rad);
        plus_zero(&mut self.body_rates_rad_s);
        plus_zero(&mut self.reference_position_ned_m);
        plus_zero(&mut self.reference_velocity_ned_m_s);
        self.reference_yaw_rad += 0.0;
        self.battery_voltage_v += 0.0;
        self
    }
}

impl CommandFrame {
    /// As [`SensorFrame::canonical`].
    #[inline]
    #[must_use]
    pub fn canonical(mut self) -> Self {
        plus_zero(&mut self.duty);
        plus_zero(&mut self.attitude_setpoint_rad);
        self
    }
}

impl FdiReport {
    /// As [`SensorFrame::canonical`].
    #[inline]
    #[must_use]
    pub fn canonical(mut self) -> Self {
        plus_zero(self.residuals_nms.as_flattened_mut());
        plus_zero(&mut self.wrench_residual);
        self.sequential_probability += 0.0;
        for loss in [&mut self.thrust_loss, &mut self.second_thrust_loss] {
            *loss = LossEstimate::from_values(loss.values().map(|value| value + 0.0));
        }
        self
    }
}

impl From<Stamp> for proto::Stamp {
    fn from(stamp: Stamp) -> Self {
        Self {
            run_id: stamp.run_id,
            step: stamp.step,
            sim_time_ns: stamp.sim_time_ns,
        }
    }
}

impl From<proto::Stamp> for Stamp {
    fn from(stamp: proto::Stamp) -> Self {
        Self {
            run_id: stamp.run_id,
            step: stamp.step,
            sim_time_ns: stamp.sim_time_ns,
        }
    }
}

fn ned(v: [f32; 3]) -> Option<proto::NedVector> {
    Some(proto::NedVector {
        north: v[0],
        east: v[1],
        down: v[2],
    })
}

fn ned_array(v: &Option<proto::NedVector>, field: &'static str) -> Result<[f32; 3], ConvertError> {
    let v = v.as_ref().ok_or(ConvertError::Missing(field))?;
    Ok([v.north, v.east, v.down])
}

fn euler(v: [f32; 3]) -> Option<proto::EulerAngles> {
    Some(proto::EulerAngles {
        roll_rad: v[0],
        pitch_rad: v[1],
        yaw_rad: v[2],
    })
}

impl From<&SensorFrame> for proto::SensorFrame {
    fn from(frame: &SensorFrame) -> Self {
        let rates = frame.body_rates_rad_s;
        Self {
            stamp: Some(frame.stamp.into()),
            nav: Some(proto::NavState {
                position_ned_m: ned(frame.position_ned_m),
                velocity_ned_m_s: ned(frame.velocity_ned_m_s),
                attitude: euler(frame.attitude_rad),
                body_rates_rad_s: Some(proto::BodyVector {
                    forward: rates[0],
                    right: rates[1],
                    down: rates[2],
                }),
            }),
            reference: Some(proto::Reference {
                position_ned_m: ned(frame.reference_position_ned_m),
                velocity_ned_m_s: ned(frame.reference_velocity_ned_m_s),
                yaw_rad: frame.reference_yaw_rad,
            }),
            battery_voltage_v: frame.battery_voltage_v,
        }
    }
}

impl TryFrom<&proto::SensorFrame> for SensorFrame {
    type Error = ConvertError;

    fn try_from(message: &proto::SensorFrame) -> Result<Self, ConvertError> {
        let nav = message.nav.as_ref().ok_or(ConvertError::Missing("SensorFrame.nav"))?;
        let reference = message
            .reference
            .as_ref()
            .ok_or(ConvertError::Missing("SensorFrame.reference"))?;
        let attitude = nav
            .attitude
            .as_ref()
            .ok_or(ConvertError::Missing("SensorFrame.nav.attitude"))?;
        let rates = nav
            .body_rates_rad_s
            .as_ref()
            .ok_or(ConvertError::Missing("SensorFrame.nav.body_rates_rad_s"))?;
        let frame = Self {
            stamp: message.stamp.ok_or(ConvertError::Missing("SensorFrame.stamp"))?.into(),
            position_ned_m: ned_array(&nav.position_ned_m, "SensorFrame.nav.position_ned_m")?,
            velocity_ned_m_s: ned_array(&nav.velocity_ned_m_s, "SensorFrame.nav.velocity_ned_m_s")?,
            attitude_rad: [attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rad],
            body_rates_rad_s: [rates.forward, rates.right, rates.down],
            reference_position_ned_m: ned_array(&reference.position_ned_m, "SensorFrame.reference.position_ned_m")?,
            reference_velocity_ned_m_s: ned_array(
                &reference.velocity_ned_m_s,
                "SensorFrame.reference.velocity_ned_m_s",
            )?,
            reference_yaw_rad: reference.yaw_rad,
            battery_voltage_v: message.battery_voltage_v,
        };
        check_sensors(&frame)?;
        Ok(frame)
    }
}

impl CommandFrame {
    /// The message with one duty for each of `rotor_count` rotors, at most [`MAX_ROTORS`].
    pub fn to_proto(&self, rotor_count: usize) -> proto::MotorCommand {
        proto::MotorCommand {
            stamp: Some(self.stamp.into()),
            duty: self.duty[..rotor_count.min(MAX_ROTORS)].to_vec(),
            attitude_setpoint: euler(self.attitude_setpoint_rad),
            saturated_rotors: self.saturated_rotors,
        }
    }

    /// From a message that must have one duty for each of `rotor_count` rotors.
    pub fn from_proto(message: &proto::MotorCommand, rotor_count: usize) -> Result<Self, ConvertError> {
        if message.duty.len() != rotor_count || rotor_count > MAX_ROTORS {
            return Err(ConvertError::Length {
                field: "MotorCommand.duty",
                found: message.duty.len(),
                expected: format!("one for each of the {rotor_count} rotors"),
            });
        }
        // For plots only: a controller without one omits it.
        let setpoint = message.attitude_setpoint.unwrap_or_default();
        let mut frame = Self {
            stamp: message.stamp.ok_or(ConvertError::Missing("MotorCommand.stamp"))?.into(),
            duty: [0.0; MAX_ROTORS],
            attitude_setpoint_rad: [setpoint.roll_rad, setpoint.pitch_rad, setpoint.yaw_rad],
            saturated_rotors: message.saturated_rotors,
        };
        frame.duty[..rotor_count].copy_from_slice(&message.duty);
        check_command(&frame, rotor_count)?;
        Ok(frame)
    }
}

/// The message of a verdict code; an unknown code becomes "unspecified", which every receiver rejects.
pub fn verdict_to_proto(code: i32) -> proto::Verdict {
    let kind = match FaultVerdict::of_code(code) {
        Some(FaultVerdict::Ambiguous) => Kind::Ambiguous,
        Some(FaultVerdict::NotReady) => Kind::NotReady,
        Some(FaultVerdict::Unknown) => Kind::Unknown,
        Some(FaultVerdict::Healthy) => Kind::Healthy,
        Some(FaultVerdict::Faulty { .. }) => Kind::Faulty,
        Some(FaultVerdict::FaultyPair { .. }) => Kind::FaultyPair,
        None => Kind::Unspecified,
    };
    let mut named = named_rotors(code);
    proto::Verdict {
        kind: kind.into(),
        rotor: named.next().unwrap_or(0),
        second_rotor: named.next().unwrap_or(0),
    }
}

/// The code of a verdict: −3 ambiguous, −2 not ready, −1 unknown fault, 0 healthy, i rotor i (from 1), 100 i + j rotors i and j.
///
/// * `field`: name for the error, with the message
pub fn verdict_from_proto(verdict: &Option<proto::Verdict>, field: &'static str) -> Result<i32, ConvertError> {
    let verdict = verdict.as_ref().ok_or(ConvertError::Missing(field))?;
    if verdict.kind() == Kind::FaultyPair {
        let small = |rotor: u32| i32::try_from(rotor).ok().filter(|rotor| (1..100).contains(rotor));
        return match (small(verdict.rotor), small(verdict.second_rotor)) {
            (Some(first), Some(second)) if first < second => Ok(of_pair(first, second)),
            _ => Err(ConvertError::OutOfRange {
                field: format!("{field}.second_rotor"),
                value: f64::from(verdict.second_rotor),
                expected: "the number of a rotor above `rotor` with KIND_FAULTY_PAIR",
            }),
        };
    }
    if verdict.second_rotor != 0 {
        return Err(ConvertError::OutOfRange {
            field: format!("{field}.second_rotor"),
            value: f64::from(verdict.second_rotor),
            expected: "0 unless the kind is KIND_FAULTY_PAIR",
        });
    }
    match (verdict.kind(), i32::try_from(verdict.rotor)) {
        (Kind::Ambiguous, Ok(0)) => Ok(AMBIGUOUS),
        (Kind::NotReady, Ok(0)) => Ok(NOT_READY),
        (Kind::Unknown, Ok(0)) => Ok(UNKNOWN),
        (Kind::Healthy, Ok(0)) => Ok(HEALTHY),
        (Kind::Faulty, Ok(rotor @ 1..100)) => Ok(rotor),
        (Kind::Faulty, _) => Err(ConvertError::OutOfRange {
            field: format!("{field}.rotor"),
            value: f64::from(verdict.rotor),
            expected: "the number of a rotor with KIND_FAULTY",
        }),
        (Kind::Unspecified, _) => Err(ConvertError::OutOfRange {
            field: format!("{field}.kind"),
            value: f64::from(verdict.kind),
            expected: "one of the verdicts that exist",
        }),
        (_, _) => Err(ConvertError::OutOfRange {
            field: format!("{field}.rotor"),
            value: f64::from(verdict.rotor),
            expected: "0 unless the kind is KIND_FAULTY",
        }),
    }
}

/// Absent if there is no interval.
fn interval_to_proto(loss: &LossEstimate) -> Option<proto::LossInterval> {
    let [_, interval @ ..] = loss.values();
    let [low_n, high_n, share, share_low, share_high] = interval;
    (interval != [0.0; 5]).then_some(proto::LossInterval {
        low_n,
        high_n,
        share,
        share_low,
        share_high,
    })
}

fn loss_from_proto(loss_n: f32, interval: Option<proto::LossInterval>) -> LossEstimate {
    let interval = interval.unwrap_or_default();
    LossEstimate {
        loss_n,
        low_n: interval.low_n,
        high_n: interval.high_n,
        share: interval.share,
        share_low: interval.share_low,
        share_high: interval.share_high,
    }
}

impl FdiReport {
    /// The message with three residuals for each of `rotor_count` rotors, at most [`MAX_ROTORS`].
    pub fn to_proto(&self, rotor_count: usize) -> proto::FdiReport {
        proto::FdiReport {
            stamp: Some(self.stamp.into()),
            residual_nms: self.residuals_nms[..rotor_count.min(MAX_ROTORS)]
                .as_flattened()
                .to_vec(),
            wrench_residual: self.wrench_residual.to_vec(),
            t_test: Some(verdict_to_proto(self.t_test)),
            network: Some(verdict_to_proto(self.network)),
            sequential: Some(verdict_to_proto(self.sequential)),
            sequential_probability: self.sequential_probability,
            window_end: self.window_end != 0,
            thrust_loss_n: self.thrust_loss.loss_n,
            thrust_loss_interval: interval_to_proto(&self.thrust_loss),
            second_thrust_loss_n: self.second_thrust_loss.loss_n,
            second_thrust_loss_interval: interval_to_proto(&self.second_thrust_loss),
            suspect_rotors: self.suspect_rotors,
            hypothesis_count: self.hypothesis_count,
            hypothesis_rotors: self.hypothesis_rotors[..(self.hypothesis_count as usize).min(MAX_HYPOTHESES)].to_vec(),
        }
    }

    /// From a message that must have three residuals for each of `rotor_count` rotors.
    pub fn from_proto(message: &proto::FdiReport, rotor_count: usize) -> Result<Self, ConvertError> {
        if rotor_count > MAX_ROTORS || message.residual_nms.len() != 3 * rotor_count {
            return Err(ConvertError::Length {
                field: "FdiReport.residual_nms",
                found: message.residual_nms.len(),
                expected: format!("three for each of the {rotor_count} rotors"),
            });
        }
        let wrench_residual =
            <[f32; 4]>::try_from(message.wrench_residual.as_slice()).map_err(|_wrong_length| ConvertError::Length {
                field: "FdiReport.wrench_residual",
                found: message.wrench_residual.len(),
                expected: "4".to_owned(),
            })?;
        let listed = message.hypothesis_rotors.len();
        if listed != (message.hypothesis_count as usize).min(MAX_HYPOTHESES) {
            return Err(ConvertError::Length {
                field: "FdiReport.hypothesis_rotors",
                found: listed,
                expected: format!("as many as hypothesis_count says, {MAX_HYPOTHESES} at most"),
            });
        }
        let mut hypothesis_rotors = [0; MAX_HYPOTHESES];
        hypothesis_rotors[..listed].copy_from_slice(&message.hypothesis_rotors);
        let mut frame = Self {
            stamp: message.stamp.ok_or(ConvertError::Missing("FdiReport.stamp"))?.into(),
            residuals_nms: [[0.0; 3]; MAX_ROTORS],
            wrench_residual,
            t_test: verdict_from_proto(&message.t_test, "FdiReport.t_test")?,
            network: verdict_from_proto(&message.network, "FdiReport.network")?,
            sequential: verdict_from_proto(&message.sequential, "FdiReport.sequential")?,
            sequential_probability: message.sequential_probability,
            thrust_loss: loss_from_proto(message.thrust_loss_n, message.thrust_loss_interval),
            second_thrust_loss: loss_from_proto(message.second_thrust_loss_n, message.second_thrust_loss_interval),
            suspect_rotors: message.suspect_rotors,
            hypothesis_count: message.hypothesis_count,
            hypothesis_rotors,
            window_end: u32::from(message.window_end),
        };
        frame.residuals_nms.as_flattened_mut()[..3 * rotor_count].copy_from_slice(&message.residual_nms);
        check_report(&frame, rotor_count)?;
        Ok(frame)
    }
}
