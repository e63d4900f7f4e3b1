//! One group of lanes: the closed loop of up to [`LANES`] flights that share the configurations of their peers.

use super::{BatchOutcome, GroupKey, RUN_ID, Waiting};
use crate::lockstep::{Failure, FlightEnd, FlightObserver, FlightOutcome, StopReason};
use crate::run_hash::{HashedStep, RunHasher, VerdictBytes};
use crate::sample::Sample;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::control::lanes::{ControlRows, MeasuredRows, ReferenceRows, SineRows};
use rotortwin_flight_core::fdi::FdiEngine;
use rotortwin_flight_core::fdi::lanes::FdiRows;
use rotortwin_plant::Simulation;
use rotortwin_plant::batch::{BatchSimulation, LANES, NoLane, SensedRows};
use rotortwin_plant::vector_units::{Dispatch, VectorWork};
use rotortwin_wire::convert::check_report;
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame, Stamp};
use rotortwin_wire::peers::report;
use std::time::Instant;

/// Far above any residual of a flight; projections of it are still finite.
const LARGEST_RESIDUAL: f32 = 1e30;

/// A flight that has left its lane.
#[expect(clippy::large_enum_variant, reason = "one for each flight that ends, read at once")]
pub(super) enum Left<O> {
    /// Ended as `lockstep::fly` would have ended it.
    Ended { index: usize, outcome: BatchOutcome<O> },
    /// Cannot continue in lanes; its observer has seen this many samples.
    Lost { index: usize, observer: O, seen: u64 },
}

/// State of one lane's flight.
struct Rider<O> {
    index: usize,
    engine: Box<FdiEngine>,
    hasher: RunHasher,
    /// Verdicts of the last window, and their hashed form.
    report: FdiReport,
    verdicts: VerdictBytes,
    observer: O,
    steps: u64,
    start: Instant,
}

impl<O> Rider<O> {
    /// Stores new verdicts.
    fn report(&mut self, report: FdiReport) {
        self.report = report.canonical();
        self.verdicts = VerdictBytes::of(&self.report);
    }
}

/// Peers' inputs in canonical form, with −0 replaced by +0.
struct PeerInputs {
    controller: Controller,
    engine: Box<FdiEngine>,
    sensed: SensedRows,
}

/// Outputs of the peers.
struct PeerOutputs<const N: usize> {
    measured: MeasuredRows<LANES>,
    references: ReferenceRows<LANES>,
    sines: SineRows<LANES>,
    control: ControlRows<N, LANES>,
    fdi: FdiRows<N, LANES>,
}

/// Computes canonical inputs, sines, and the controllers.
struct Control<const N: usize>;

impl<const N: usize> VectorWork for Control<N> {
    type Input = PeerInputs;
    type Output = PeerOutputs<N>;
    const WIDE: bool = false;

    #[inline(always)]
    fn run(input: &PeerInputs, output: &mut PeerOutputs<N>) {
        for row in 0..input.sensed.values.len() {
            for lane in 0..LANES {
                output.measured[row][lane] = input.sensed.values[row][lane] + 0.0;
            }
        }
        for row in 0..input.sensed.reference.len() {
            for lane in 0..LANES {
                output.references[row][lane] = input.sensed.reference[row][lane] + 0.0;
            }
        }
        output.sines.fill(&output.measured);
        output
            .control
            .step(&input.controller, &output.measured, &output.sines, &output.references);
    }
}

/// Per-sample part of the FDI engines.
struct Diagnose<const N: usize>;

impl<const N: usize> VectorWork for Diagnose<N> {
    type Input = PeerInputs;
    type Output = PeerOutputs<N>;
    const WIDE: bool = false;

    #[inline(always)]
    fn run(input: &PeerInputs, output: &mut PeerOutputs<N>) {
        output
            .fdi
            .step(&input.engine, &output.measured, &output.sines, &output.control.duty);
    }
}

/// See the module documentation.
pub(super) struct LaneGroup<const N: usize, O> {
    dispatch: Dispatch,
    plant: BatchSimulation<N>,
    inputs: Box<PeerInputs>,
    outputs: Box<PeerOutputs<N>>,
    riders: [Option<Rider<O>>; LANES],
    samples: Vec<Sample>,
}

impl<const N: usize, O: FlightObserver> LaneGroup<N, O> {
    pub(super) fn new(key: &GroupKey, dispatch: Dispatch) -> Result<Self, String> {
        let blank = Sample {
            sensors: SensorFrame::default(),
            command: CommandFrame::default(),
            report: FdiReport::default(),
            truth: rotortwin_plant::TruthSample::default(),
            specific_force_m_s2: None,
        };
        Ok(Self {
            dispatch,
            plant: BatchSimulation::new(dispatch, key.substeps),
            inputs: Box::new(PeerInputs {
                controller: Controller::new(key.controller).map_err(|error| error.to_string())?,
                engine: Box::new(FdiEngine::new(key.fdi).map_err(|error| error.to_string())?),
                sensed: SensedRows {
                    values: [[0.0; LANES]; 13],
                    reference: [[0.0; LANES]; 7],
                },
            }),
            outputs: Box::new(PeerOutputs {
                measured: [[0.0; LANES]; 13],
                references: [[0.0; LANES]; 7],
                sines: SineRows::NONE,
                control: ControlRows::NONE,
                fdi: FdiRows::NONE,
            }),
            riders: [const { None }; LANES],
            samples: vec![blank; LANES],
        })
    }

    pub(super) fn free_lane(&self) -> Option<usize> {
        self.riders.iter().position(Option::is_none)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.riders.iter().all(Option::is_none)
    }

    pub(super) fn check(&self, simulation: &Simulation) -> Result<(), NoLane> {
        self.plant.check(simulation)
    }

    /// Assigns a checked flight to a free lane.
    pub(super) fn seat(&mut self, lane: usize, waiting: Waiting<O>) -> Result<(), String> {
        let mut controller = self.inputs.controller;
        if let Some(trim) = waiting.trim {
            controller.trim(trim.duty, trim.battery_voltage);
        }
        self.outputs.control.seat(lane, &controller);
        self.plant
            .seat(lane, waiting.simulation)
            .map_err(|reason| format!("a checked flight was refused a lane: {reason:?}"))?;
        self.riders[lane] = Some(Rider {
            index: waiting.index,
            engine: self.inputs.engine.clone(),
            hasher: RunHasher::new(N),
            report: FdiReport::default(),
            verdicts: VerdictBytes::of(&FdiReport::default()),
            observer: waiting.observer,
            steps: 0,
            start: Instant::now(),
        });
        Ok(())
    }

    /// One step of every lane.
    pub(super) fn step(&mut self, leave: &mut impl FnMut(Left<O>) -> Result<(), String>) -> Result<(), String> {
        for lane in 0..LANES {
            let Some(rider) = &mut self.riders[lane] else { continue };
            let reason = rider.observer.stop_requested();
            if let Some(reason) = reason {
                self.end(lane, end_of(reason), leave)?;
            } else if self.plant.simulation(lane).is_some_and(Simulation::done) {
                self.end(lane, FlightEnd::Done, leave)?;
            }
        }
        self.inputs.sensed.clone_from(self.plant.sense());
        self.dispatch.run::<Control<N>>(&self.inputs, &mut self.outputs);
        let mut lost = 0u32;
        for lane in 0..LANES {
            let out = &mut *self.outputs;
            if out.control.outside[lane] != 0
                && self.riders[lane].is_some()
                && !out
                    .control
                    .step_alone(&self.inputs.controller, lane, &out.measured, &out.references)
            {
                lost |= 1 << lane;
            }
        }
        self.dispatch.run::<Diagnose<N>>(&self.inputs, &mut self.outputs);
        for lane in 0..LANES {
            if self.riders[lane].is_some() && !self.complete(lane) {
                lost |= 1 << lane;
            }
        }
        lost |= self.plant.advance(&self.outputs.control.duty);
        for lane in 0..LANES {
            if lost & (1 << lane) != 0 {
                self.lose(lane, leave)?;
            } else {
                self.hand_over(lane, leave)?;
            }
        }
        Ok(())
    }

    /// Runs the engine at block and window ends, hashes this step, and passes on its sample if observed; false if the lane cannot
    /// continue.
    #[inline]
    fn complete(&mut self, lane: usize) -> bool {
        let (Some(rider), Some(simulation)) = (&mut self.riders[lane], self.plant.simulation(lane)) else {
            return true;
        };
        let out = &mut *self.outputs;
        let truth = simulation.truth();
        let stamp = Stamp {
            run_id: RUN_ID,
            step: truth.step,
            sim_time_ns: truth.sim_time_ns,
        };
        let duty = column(&out.control.duty, lane);
        let setpoint = canonical(column(&out.control.attitude_setpoint, lane));
        let saturated_rotors = out.control.saturated_rotors[lane];
        let window_end = if rider.steps == 0 {
            // An engine initialises its observers from the first sample.
            let sensors = sensor_frame(&self.inputs.sensed, lane, stamp).canonical();
            let command = command_frame(stamp, &duty, setpoint, saturated_rotors);
            let output = rider.engine.step(&command.measurement(&sensors));
            if output.rejected_samples > 0 || !out.fdi.seat(lane, &rider.engine) {
                return false;
            }
            rider.report(report(stamp, &output));
            out.fdi.set_output(lane, &output);
            output.window_end
        } else {
            if out.fdi.outside[lane] != 0 {
                return false;
            }
            let window_end = out.fdi.close(lane, &mut rider.engine);
            if window_end {
                rider.report(report(stamp, &out.fdi.output(lane, &rider.engine)));
                // The link's own check of new verdicts: it would reject the report, and the flight would fail.
                if check_report(&rider.report, N).is_err() {
                    return false;
                }
            }
            window_end
        };
        let (mut residuals, wrench_residual) = out.fdi.residuals_of(lane);
        if !wrench_residual.iter().all(|r| r.abs() < LARGEST_RESIDUAL) {
            return false;
        }
        for residual in residuals.as_flattened_mut() {
            *residual += 0.0;
        }
        let wrench_residual = canonical(wrench_residual);
        let motion = self.plant.motion(lane);
        let sensed = &self.inputs.sensed;
        let mut heard = [0.0; 20];
        for k in 0..12 {
            heard[k] = sensed.values[k][lane];
        }
        for k in 0..7 {
            heard[12 + k] = sensed.reference[k][lane];
        }
        heard[19] = sensed.values[12][lane];
        rider.hasher.update_step(&HashedStep {
            step: stamp.step,
            sim_time_ns: stamp.sim_time_ns,
            sensed: &heard,
            duty: &duty,
            attitude_setpoint_rad: &setpoint,
            saturated_rotors,
            residuals: residuals.as_flattened(),
            wrench_residual: &wrench_residual,
            verdicts: &rider.verdicts,
            window_end: u32::from(window_end),
            motion: &motion.motion,
            rotor_thrust_n: &motion.rotor_thrust_n,
            battery: &motion.battery,
            faulty_rotors: truth.faulty_rotors,
        });
        if O::SEES_SAMPLES {
            let sample = &mut self.samples[lane];
            sample.sensors = sensor_frame(sensed, lane, stamp);
            sample.command = command_frame(stamp, &duty, setpoint, saturated_rotors);
            sample.report = FdiReport {
                stamp,
                wrench_residual,
                window_end: u32::from(window_end),
                ..rider.report
            };
            sample.report.residuals_nms[..N].copy_from_slice(&residuals);
            if let Some(truth) = self.plant.truth(lane) {
                sample.truth = truth;
            }
        }
        true
    }

    #[inline]
    fn hand_over(&mut self, lane: usize, leave: &mut impl FnMut(Left<O>) -> Result<(), String>) -> Result<(), String> {
        let Some(rider) = &mut self.riders[lane] else {
            return Ok(());
        };
        rider.steps += 1;
        if !O::SEES_SAMPLES {
            return Ok(());
        }
        match rider.observer.sample(&self.samples[lane]) {
            Ok(()) => Ok(()),
            Err(sentence) => {
                let failed = StopReason::Failed(Failure::of("plant", sentence));
                // The observer knows why it asked to stop, as in `lockstep::fly`.
                let reason = rider.observer.stop_requested().unwrap_or(failed);
                self.end(lane, end_of(reason), leave)
            }
        }
    }

    fn end(
        &mut self,
        lane: usize,
        end: FlightEnd,
        leave: &mut impl FnMut(Left<O>) -> Result<(), String>,
    ) -> Result<(), String> {
        self.plant.clear(lane);
        let Some(rider) = self.riders[lane].take() else {
            return Ok(());
        };
        leave(Left::Ended {
            index: rider.index,
            outcome: BatchOutcome {
                outcome: FlightOutcome {
                    end,
                    steps: rider.steps,
                    run_hash: rider.hasher.digest(),
                    wall: rider.start.elapsed(),
                    real_time: None,
                },
                observer: rider.observer,
            },
        })
    }

    #[cold]
    fn lose(&mut self, lane: usize, leave: &mut impl FnMut(Left<O>) -> Result<(), String>) -> Result<(), String> {
        self.plant.clear(lane);
        let Some(rider) = self.riders[lane].take() else {
            return Ok(());
        };
        leave(Left::Lost {
            index: rider.index,
            observer: rider.observer,
            seen: rider.steps,
        })
    }
}

fn end_of(reason: StopReason) -> FlightEnd {
    match reason {
        StopReason::Canceled => FlightEnd::Canceled,
        StopReason::Failed(failure) => FlightEnd::Failed(failure),
    }
}

/// One lane of several rows.
#[inline]
fn column<const K: usize>(rows: &[[f32; LANES]; K], lane: usize) -> [f32; K] {
    let mut values = [0.0; K];
    for i in 0..K {
        values[i] = rows[i][lane];
    }
    values
}

/// −0 becomes +0.
#[inline]
fn canonical<const K: usize>(mut values: [f32; K]) -> [f32; K] {
    for value in &mut values {
        *value += 0.0;
    }
    values
}

fn command_frame(stamp: Stamp, duty: &[f32], attitude_setpoint_rad: [f32; 3], saturated_rotors: u32) -> CommandFrame {
    let mut command = CommandFrame {
        stamp,
        attitude_setpoint_rad,
        saturated_rotors,
        ..CommandFrame::default()
    };
    command.duty[..duty.len()].copy_from_slice(duty);
    command
}

fn sensor_frame(sensed: &SensedRows, lane: usize, stamp: Stamp) -> SensorFrame {
    let v = |row: usize| [0, 1, 2].map(|axis| sensed.values[3 * row + axis][lane]);
    let r = |row: usize| [0, 1, 2].map(|axis| sensed.reference[3 * row + axis][lane]);
    SensorFrame {
        stamp,
        position_ned_m: v(0),
        velocity_ned_m_s: v(1),
        attitude_rad: v(2),
        body_rates_rad_s: v(3),
        reference_position_ned_m: r(0),
        reference_velocity_ned_m_s: r(1),
        reference_yaw_rad: sensed.reference[6][lane],
        battery_voltage_v: sensed.values[12][lane],
    }
}
