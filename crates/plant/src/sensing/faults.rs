//! Sensor faults: bias, stuck, dropout and delay of one sensor over an interval of the flight.
//!
//! Applied to the noisy reading in the order delay, bias, dropout, stuck. A dropout is not NaN: like an estimator, the
//! sensor keeps giving its last good value, and `SensedSample::stale_sensors` marks it; a stuck sensor also gives its
//! last value, without a mark.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::error::{Refusal, all_in_range, in_range};
use crate::random::RandomStream;
use crate::sensing::readings::{Readings, SENSORS, Sensor};
use crate::vector::Vector3;
use crate::{STEP_RATE_HZ, nearest_step};

/// Longest delay, s.
const MAX_DELAY_S: f64 = 1.0;

/// One `[[sensor_fault]]` of a scenario: exactly one of `bias_si`, `stuck`, `dropout_probability`, `delay_s`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFaultEntry {
    /// Onset, s.
    pub time_s: f64,
    /// End, s; the end of the flight if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_s: Option<f64>,
    /// Which sensor.
    pub sensor: Sensor,
    /// Added to the reading, in the sensor's unit (m, m/s, rad, rad/s, V); three numbers, one for the voltage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias_si: Option<Vec<f64>>,
    /// `true`: the reading at the onset is repeated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stuck: Option<bool>,
    /// Share of samples lost, drawn independently; the last good one is repeated and flagged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dropout_probability: Option<f64>,
    /// Age of the reading, s, in multiples of 2.5 ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_s: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Delay { steps: u64 },
    Bias(Vector3),
    Dropout { probability: f64 },
    Stuck,
}

impl Kind {
    /// Place in the order of application.
    fn order(&self) -> u8 {
        match self {
            Self::Delay { .. } => 0,
            Self::Bias(_) => 1,
            Self::Dropout { .. } => 2,
            Self::Stuck => 3,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct PlannedFault {
    sensor: Sensor,
    first_step: u64,
    end_step: u64,
    kind: Kind,
}

/// The checked sensor faults of a scenario, in the order of application.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SensorFaultPlan(Vec<PlannedFault>);

impl SensorFaultPlan {
    /// Checks all entries; `duration_steps` is the length of the flight.
    pub fn new(entries: &[SensorFaultEntry], duration_steps: u64) -> Result<Self, Refusal> {
        let mut plan: Vec<PlannedFault> = Vec::with_capacity(entries.len());
        for (i, entry) in entries.iter().enumerate() {
            let fault = entry
                .plan(duration_steps)
                .map_err(|r| r.under(&format!("sensor_fault[{i}]")))?;
            for earlier in plan.iter().filter(|other| other.sensor == fault.sensor) {
                let overlap = fault.first_step < earlier.end_step && earlier.first_step < fault.end_step;
                if overlap && earlier.kind.order() == fault.kind.order() {
                    let reason = "this sensor has a fault of the same kind at the same time: expected one at a time";
                    return Err(Refusal::new(format!("sensor_fault[{i}]"), reason));
                }
            }
            plan.push(fault);
        }
        for (i, fault) in plan.iter().enumerate() {
            let covered = plan.iter().any(|other| {
                let inside = other.first_step <= fault.first_step && fault.end_step <= other.end_step;
                other.kind == Kind::Stuck && fault.kind != Kind::Stuck && other.sensor == fault.sensor && inside
            });
            if covered {
                let reason = "this fault cannot have an effect: the sensor is stuck all the time";
                return Err(Refusal::new(format!("sensor_fault[{i}]"), reason));
            }
        }
        plan.sort_by_key(|fault| fault.kind.order());
        Ok(Self(plan))
    }
}

impl SensorFaultEntry {
    fn plan(&self, duration_steps: u64) -> Result<PlannedFault, Refusal> {
        let duration_s = duration_steps as f64 / STEP_RATE_HZ;
        in_range("time_s", self.time_s, 0.0, 1e6, "s")?;
        let first_step = nearest_step(self.time_s);
        if first_step >= duration_steps {
            let reason = format!("this fault cannot have an effect: the flight ends at {duration_s} s");
            return Err(Refusal::new("time_s", reason));
        }
        let end_step = match self.end_s {
            None => duration_steps,
            Some(end_s) => {
                in_range("end_s", end_s, 0.0, 1e6, "s")?;
                nearest_step(end_s)
            }
        };
        if end_step <= first_step {
            let reason = format!(
                "this fault cannot have an effect: expected an end after its onset at {} s",
                self.time_s
            );
            return Err(Refusal::new("end_s", reason));
        }
        Ok(PlannedFault {
            sensor: self.sensor,
            first_step,
            end_step,
            kind: self.kind(first_step)?,
        })
    }

    fn kind(&self, first_step: u64) -> Result<Kind, Refusal> {
        let kinds = (&self.bias_si, self.stuck, self.dropout_probability, self.delay_s);
        match kinds {
            (Some(bias), None, None, None) => {
                if bias.len() != self.sensor.width() {
                    let reason = format!(
                        "expected a list of {} for this sensor, got {}",
                        self.sensor.width(),
                        bias.len()
                    );
                    return Err(Refusal::new("bias_si", reason));
                }
                all_in_range("bias_si", bias, -1e6, 1e6, "")?;
                if bias.iter().all(|&b| b == 0.0) {
                    return Err(Refusal::new(
                        "bias_si",
                        "this fault cannot have an effect: the bias is 0",
                    ));
                }
                Ok(Kind::Bias(std::array::from_fn(|i| bias.get(i).copied().unwrap_or(0.0))))
            }
            (None, Some(true), None, None) => Ok(Kind::Stuck),
            (None, Some(false), None, None) => Err(Refusal::new(
                "stuck",
                "this fault cannot have an effect: expected true, got false",
            )),
            (None, None, Some(probability), None) => {
                in_range("dropout_probability", probability, 0.0, 1.0, "")?;
                if probability == 0.0 {
                    let reason = "this fault cannot have an effect: no sample is lost with probability 0";
                    return Err(Refusal::new("dropout_probability", reason));
                }
                if first_step == 0 && probability == 1.0 {
                    let reason = "expected an onset after 0: a sensor that never gave a value has none to hold";
                    return Err(Refusal::new("time_s", reason));
                }
                Ok(Kind::Dropout { probability })
            }
            (None, None, None, Some(delay_s)) => {
                in_range("delay_s", delay_s, 0.0, MAX_DELAY_S, "s")?;
                match nearest_step(delay_s) {
                    0 => Err(Refusal::new(
                        "delay_s",
                        "this fault cannot have an effect: less than half a step of 2.5 ms",
                    )),
                    steps => Ok(Kind::Delay { steps }),
                }
            }
            _ => Err(Refusal::new(
                "",
                "expected exactly one of bias_si, stuck, dropout_probability, delay_s",
            )),
        }
    }
}

/// A planned fault and its state.
#[derive(Debug, Clone)]
struct RunningFault {
    plan: PlannedFault,
    /// Delay: readings not yet given, newest last.
    history: VecDeque<Vector3>,
    /// Dropout and stuck: last value given before the loss.
    held: Vector3,
    losses: RandomStream,
}

/// The sensor faults of one flight.
#[derive(Debug, Clone)]
pub(crate) struct SensorFaultBank(Vec<RunningFault>);

impl SensorFaultBank {
    pub(crate) fn new(plan: &SensorFaultPlan, seed: u64) -> Self {
        let running = |(i, &plan): (usize, &PlannedFault)| RunningFault {
            plan,
            history: VecDeque::new(),
            held: [0.0; 3],
            losses: RandomStream::new(seed, &format!("sensor-fault/{i}")),
        };
        Self(plan.0.iter().enumerate().map(running).collect())
    }

    #[inline]
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Corrupts the readings of `step`; returns the bit mask of sensors whose value is held for want of a new one.
    pub(crate) fn corrupt(&mut self, step: u64, readings: &mut Readings) -> u32 {
        let mut stale = [false; SENSORS];
        for fault in &mut self.0 {
            let active = (fault.plan.first_step..fault.plan.end_step).contains(&step);
            let reading = &mut readings[fault.plan.sensor.index()];
            match fault.plan.kind {
                Kind::Delay { steps } => {
                    fault.history.push_back(*reading);
                    if fault.history.len() as u64 > steps + 1 {
                        fault.history.pop_front();
                    }
                    if active {
                        *reading = fault.history[0];
                    }
                }
                Kind::Bias(bias) => {
                    if active {
                        for (value, offset) in reading.iter_mut().zip(bias) {
                            *value += offset;
                        }
                    }
                }
                Kind::Dropout { probability } => {
                    // Drawn at every step, so that the pattern does not depend on the interval.
                    let lost = fault.losses.unit() < probability;
                    if active && lost && step > 0 {
                        *reading = fault.held;
                        stale[fault.plan.sensor.index()] = true;
                    }
                    fault.held = *reading;
                }
                Kind::Stuck => {
                    if step <= fault.plan.first_step {
                        fault.held = *reading;
                    } else if active {
                        *reading = fault.held;
                    }
                }
            }
        }
        (0..SENSORS).fold(0, |mask, i| mask | (u32::from(stale[i]) << i))
    }
}
