//! Records samples of a flight to the telemetry spool, and emits events for a supervisor.

use crate::conditions::ConditionSchedule;
use crate::live::LiveSampler;
use rotortwin_flight::lockstep::{FlightObserver, StopReason};
use rotortwin_flight::sample::Sample;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::body::ground::GroundEvent;
use rotortwin_store::StoreError;
use rotortwin_store::spool::SpoolWriter;
use rotortwin_store::telemetry::{TelemetryRow, TruthRow};
use rotortwin_wire::events::{Change, Mishap, Progress, RunEvent};
use std::time::{Duration, Instant};

/// Wall-clock time between two progress events.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// Steps between readings of the wall clock: a reading costs a tenth of a step.
const STEPS_PER_CLOCK_READING: u64 = 64;

/// Number of windows for which a rotor must have been named before the size of its loss is reported. With realistic mismatch and an onset in
/// a turn, the 95 % interval contains the truth in 48 of 100 first windows, and reaches its final coverage from the eighth on
/// (docs/detector.md).
const WINDOWS_OF_A_SIZE: u32 = 8;

/// Records a flight and reports its progress.
pub struct Recorder<'a> {
    spool: SpoolWriter,
    step_count: u64,
    conditions: ConditionSchedule,
    row: TelemetryRow,
    emit: &'a mut dyn FnMut(RunEvent),
    stop: &'a mut dyn FnMut() -> Option<StopReason>,
    last_progress: Instant,
    last_label: i32,
    last_sequential: Option<i32>,
    /// Windows since the last change of the verdict.
    named_windows: u32,
    live: Option<LiveSampler>,
    rotor_count: usize,
}

impl<'a> Recorder<'a> {
    /// A recorder into `spool`; `emit` receives the events, `stop` returns whether the run should end early.
    pub fn new(
        spool: SpoolWriter,
        step_count: u64,
        conditions: ConditionSchedule,
        emit: &'a mut dyn FnMut(RunEvent),
        stop: &'a mut dyn FnMut() -> Option<StopReason>,
    ) -> Self {
        Self {
            spool,
            step_count,
            conditions,
            row: TelemetryRow::default(),
            emit,
            stop,
            last_progress: Instant::now(),
            last_label: 0,
            last_sequential: None,
            named_windows: 0,
            live: None,
            rotor_count: 0,
        }
    }

    /// Also emits samples: `rate_hz` per second of simulated time.
    pub fn with_live(mut self, rate_hz: f64, rotor_count: usize) -> Self {
        self.live = Some(LiveSampler::new(rate_hz, rotor_count));
        self.rotor_count = rotor_count;
        self
    }

    /// Completes the spool.
    pub fn finish(self) -> Result<u64, StoreError> {
        self.spool.finish()
    }

    fn report_changes(&mut self, sample: &Sample) {
        let sim_time_s = sample.sensors.stamp.sim_time_ns as f64 * 1e-9;
        while let Some(mass_kg) = self.conditions.next_load(sample.sensors.stamp.step) {
            (self.emit)(RunEvent::Change(Change::Load { sim_time_s, mass_kg }));
        }
        let label = sample.truth.fault_label;
        if label != self.last_label {
            self.last_label = label;
            (self.emit)(RunEvent::Change(Change::Truth {
                sim_time_s,
                fault_label: label,
            }));
        }
        let sequential = sample.report.sequential;
        if self.last_sequential != Some(sequential) {
            self.last_sequential = Some(sequential);
            (self.emit)(RunEvent::Change(Change::Verdict {
                sim_time_s,
                sequential,
                probability: sample.report.sequential_probability,
                suspect_rotors: sample.report.suspect_rotors,
            }));
            self.named_windows = 0;
        }
        if sample.report.window_end == 0 || sequential <= 0 {
            return;
        }
        self.named_windows = self.named_windows.saturating_add(1);
        if self.named_windows == WINDOWS_OF_A_SIZE {
            let loss = &sample.report.thrust_loss;
            (self.emit)(RunEvent::Change(Change::Severity {
                sim_time_s,
                sequential,
                thrust_loss_n: loss.loss_n,
                thrust_loss_low_n: loss.low_n,
                thrust_loss_high_n: loss.high_n,
            }));
        }
    }

    fn report_progress(&mut self, sample: &Sample) -> Result<(), String> {
        let step = sample.sensors.stamp.step + 1;
        let last = step == self.step_count;
        if !last && (!step.is_multiple_of(STEPS_PER_CLOCK_READING) || self.last_progress.elapsed() < PROGRESS_INTERVAL)
        {
            return Ok(());
        }
        self.last_progress = Instant::now();
        // Rows reported to a supervisor survive this process.
        self.spool.flush().map_err(|error| error.to_string())?;
        (self.emit)(RunEvent::Progress(Progress {
            step,
            step_count: self.step_count,
            sim_time_s: sample.sensors.stamp.sim_time_ns as f64 * 1e-9,
            battery_voltage_v: sample.sensors.battery_voltage_v,
            state_of_charge: sample.truth.state_of_charge,
            fault_label: sample.truth.fault_label,
            t_test: sample.report.t_test,
            network: sample.report.network,
            sequential: sample.report.sequential,
        }));
        Ok(())
    }
}

impl FlightObserver for Recorder<'_> {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        let conditions = self.conditions.at(sample.sensors.stamp.step);
        fill_row(&mut self.row, sample, conditions);
        self.spool.push(&self.row).map_err(|error| error.to_string())?;
        if let Some(event) = self
            .live
            .as_mut()
            .and_then(|live| live.sample(&self.row, self.rotor_count))
        {
            (self.emit)(event);
        }
        self.report_changes(sample);
        self.report_progress(sample)
    }

    #[inline]
    fn stop_requested(&mut self) -> Option<StopReason> {
        (self.stop)()
    }

    fn mishap(&mut self, sim_time_s: f64, event: GroundEvent) {
        let mishap = match event {
            GroundEvent::HardLanding { speed_m_s } => Mishap::HardLanding { speed_m_s },
            GroundEvent::TipOver { tilt_rad } => Mishap::TipOver { tilt_rad },
            GroundEvent::RotorStrike { rotor } => Mishap::RotorStrike { rotor: rotor + 1 },
        };
        (self.emit)(RunEvent::Change(Change::Ground { sim_time_s, mishap }));
    }

    fn handed_over(&mut self, prelude_s: f64) {
        (self.emit)(RunEvent::Change(Change::HandOver { prelude_s }));
    }

    fn words(&mut self, plant_time_s: f64, text: String) {
        (self.emit)(RunEvent::Change(Change::Words { plant_time_s, text }));
    }
}

/// One sample as a row of telemetry; the conditions are [`ConditionSchedule::at`] its step.
pub fn fill_row(row: &mut TelemetryRow, sample: &Sample, (rotor_condition, sensor_faults): ([i32; MAX_ROTORS], u32)) {
    let Sample {
        sensors,
        command,
        report,
        truth,
        specific_force_m_s2,
    } = sample;
    *row = TelemetryRow {
        step: sensors.stamp.step,
        sim_time_ns: sensors.stamp.sim_time_ns,
        position_ned_m: sensors.position_ned_m,
        velocity_ned_m_s: sensors.velocity_ned_m_s,
        attitude_rad: sensors.attitude_rad,
        body_rates_rad_s: sensors.body_rates_rad_s,
        specific_force_m_s2: specific_force_m_s2.unwrap_or([f32::NAN; 3]),
        duty: command.duty,
        battery_voltage_v: sensors.battery_voltage_v,
        battery_current_a: truth.battery_current_a,
        reference_position_ned_m: sensors.reference_position_ned_m,
        reference_velocity_ned_m_s: sensors.reference_velocity_ned_m_s,
        reference_yaw_rad: sensors.reference_yaw_rad,
        truth: TruthRow {
            position_ned_m: truth.position_ned_m,
            velocity_ned_m_s: truth.velocity_ned_m_s,
            attitude_rad: truth.attitude_rad,
            body_rates_rad_s: truth.body_rates_rad_s,
            thrust_n: truth.rotor_thrust_n,
            state_of_charge: truth.state_of_charge,
            open_circuit_voltage_v: truth.open_circuit_voltage_v,
            battery_voltage_v: truth.battery_voltage_v,
            wind_ned_m_s: truth.wind_ned_m_s,
        },
        fault_label: truth.fault_label,
        faulty_rotors: truth.faulty_rotors,
        rotor_condition,
        sensor_faults,
        attitude_setpoint_rad: command.attitude_setpoint_rad,
        saturated_rotors: command.saturated_rotors,
        residuals_nms: report.residuals_nms,
        wrench_residual: report.wrench_residual,
        t_test: report.t_test,
        network: report.network,
        sequential: report.sequential,
        sequential_probability: report.sequential_probability,
        thrust_loss: report.thrust_loss.values(),
        second_thrust_loss: report.second_thrust_loss.values(),
        suspect_rotors: report.suspect_rotors,
        hypothesis_count: report.hypothesis_count,
        window_end: report.window_end != 0,
    };
}
