//! One flight with an autopilot that has its own clock, in place of the controller.
//!
//! ```text
//!  prelude:  instruments ─▶ exchange ─▶ parts of 0.5 ms …  until it holds still near the first point: hand-over
//!  flight:   the same, plus for each step of 2.5 ms: sense, detectors with each rotor's mean duty of the step, hash, observer
//!  landing:  as the prelude, if we command the autopilot; not hashed
//! ```
//! Arming and climb may take any time; trajectory, faults and calibration count from the hand-over, which is step 0. Detectors, hash
//! and telemetry run at 400 Hz whatever the autopilot's rate. The FDI engine runs in this process.

use crate::lockstep::{Failure, FlightEnd, FlightObserver, FlightOutcome, StopReason};
use crate::run_hash::RunHasher;
use crate::sample::Sample;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::PARTS_PER_STEP;
use rotortwin_plant::Simulation;
use rotortwin_plant::body::ground::GroundEvent;
use rotortwin_plant::sensing::instruments::{InstrumentModel, InstrumentSample, Instruments};
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Fix, Readings, Wanted};
use rotortwin_wire::convert;
use rotortwin_wire::frames::{CommandFrame, SensorFrame, Stamp};
use rotortwin_wire::link::{FdiPeer, RunSetup};
use rotortwin_wire::peers::FdiEnginePeer;
use std::time::Instant;

/// Conditions for starting the flight, and a time limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandOver {
    /// Largest distance from the first point of the trajectory, m.
    pub radius_m: f64,
    /// Largest speed, m/s.
    pub speed_m_s: f64,
    /// How long both must hold, s of simulated time.
    pub hold_s: f64,
    /// Longest prelude, s of simulated time.
    pub limit_s: f64,
}

impl Default for HandOver {
    fn default() -> Self {
        Self {
            radius_m: 0.5,
            speed_m_s: 0.3,
            hold_s: 2.0,
            limit_s: 600.0,
        }
    }
}

/// Longest landing, s of simulated time.
const LONGEST_LANDING_S: f64 = 120.0;

/// Outcome specific to a flight with an autopilot.
#[derive(Clone, Debug)]
pub struct AutopilotOutcome {
    /// As for any flight.
    pub flight: FlightOutcome,
    /// Simulated time before the hand-over, s.
    pub prelude_s: f64,
    /// Simulated time from the last step until it stood with its motors off, s; `None`: it was not commanded to land, or did not
    /// land.
    pub landing_s: Option<f64>,
}

/// Flies `simulation`, which starts on the ground, to its end with an autopilot.
pub fn fly(
    simulation: &mut Simulation,
    autopilot: &mut impl Autopilot,
    setup: &RunSetup,
    instruments: (&InstrumentModel, u64),
    hand_over: HandOver,
    observer: &mut impl FlightObserver,
) -> AutopilotOutcome {
    let mut flight = Flight {
        run_id: setup.run_id,
        instruments: Instruments::new(instruments.0, instruments.1),
        parts_left: 0,
        duty: [0.0; MAX_ROTORS],
        hasher: RunHasher::new(simulation.rotor_count()),
        steps: 0,
        prelude_ns: 0,
        landing_s: None,
    };
    let start = Instant::now();
    let end = match flight.run(simulation, autopilot, setup, hand_over, observer) {
        Ok(()) => FlightEnd::Done,
        Err(StopReason::Canceled) => FlightEnd::Canceled,
        Err(StopReason::Failed(failure)) => match observer.stop_requested() {
            Some(StopReason::Canceled) => FlightEnd::Canceled,
            Some(StopReason::Failed(reason)) => FlightEnd::Failed(reason),
            None => FlightEnd::Failed(failure),
        },
    };
    autopilot.finish();
    AutopilotOutcome {
        flight: FlightOutcome {
            end,
            steps: flight.steps,
            run_hash: flight.hasher.digest(),
            wall: start.elapsed(),
            real_time: None,
        },
        prelude_s: flight.prelude_ns as f64 * 1e-9,
        landing_s: flight.landing_s,
    }
}

struct Flight {
    run_id: u64,
    instruments: Instruments,
    /// Parts until the next exchange.
    parts_left: u32,
    duty: [f64; MAX_ROTORS],
    hasher: RunHasher,
    steps: u64,
    prelude_ns: u64,
    landing_s: Option<f64>,
}

impl Flight {
    fn run(
        &mut self,
        simulation: &mut Simulation,
        autopilot: &mut impl Autopilot,
        setup: &RunSetup,
        hand_over: HandOver,
        observer: &mut impl FlightObserver,
    ) -> Result<(), StopReason> {
        let refused = |peer: &str, sentence: String| StopReason::Failed(Failure::of(peer, sentence));
        let mut fdi = FdiEnginePeer::default();
        fdi.setup(&setup.fdi).map_err(|sentence| refused("fdi", sentence))?;
        simulation
            .begin_prelude()
            .map_err(|refusal| refused("plant", refusal.to_string()))?;
        self.prelude(simulation, autopilot, hand_over, observer)?;
        simulation.hand_over();
        autopilot.flight_begins();
        observer.handed_over(self.prelude_ns as f64 * 1e-9);
        while !simulation.done() {
            stop_if_asked(observer)?;
            self.step(simulation, autopilot, &mut fdi, observer)?;
        }
        if autopilot.flight_ends() {
            self.landing(simulation, autopilot, observer)?;
        }
        Ok(())
    }

    /// After the last step. A completed flight stays completed whatever happens during the landing, unless it is cancelled.
    fn landing(
        &mut self,
        simulation: &mut Simulation,
        autopilot: &mut impl Autopilot,
        observer: &mut impl FlightObserver,
    ) -> Result<(), StopReason> {
        simulation.begin_landing();
        let begun_ns = simulation.elapsed_ns();
        loop {
            stop_if_asked(observer)?;
            let since_s = (simulation.elapsed_ns() - begun_ns) as f64 * 1e-9;
            let plant_time_s = simulation.elapsed_ns() as f64 * 1e-9;
            if autopilot.landed() && simulation.on_ground() {
                self.landing_s = Some(since_s);
                let p = simulation.truth().position_ned_m;
                // Who lies there already has not landed now.
                let what = if since_s > 0.0 {
                    format!("landed, motors off, {since_s:.1} s after the last step")
                } else {
                    "on the ground with its motors off before the last step".to_owned()
                };
                let text = format!("{what}, {:.1} m north and {:.1} m east of the origin", p[0], p[1]);
                observer.words(plant_time_s, text);
                return Ok(());
            }
            if since_s > LONGEST_LANDING_S {
                let sentence = format!("it had not landed {LONGEST_LANDING_S} s after the last step");
                observer.words(plant_time_s, sentence);
                return Ok(());
            }
            for _ in 0..PARTS_PER_STEP {
                match self.part(simulation, autopilot) {
                    Ok(()) => {}
                    Err(StopReason::Canceled) => return Err(StopReason::Canceled),
                    Err(StopReason::Failed(failure)) => {
                        observer.words(plant_time_s, format!("the landing ended early: {}", failure.sentence));
                        return Ok(());
                    }
                }
            }
            report_mishaps(simulation, observer);
            pass_on_words(simulation, autopilot, observer);
        }
    }

    fn prelude(
        &mut self,
        simulation: &mut Simulation,
        autopilot: &mut impl Autopilot,
        hand_over: HandOver,
        observer: &mut impl FlightObserver,
    ) -> Result<(), StopReason> {
        let (mut still_ns, mut last_ns) = (0, 0);
        autopilot.steer(&Wanted {
            position_ned_m: simulation.first_point(),
            velocity_ned_m_s: [0.0; 3],
            yaw_rad: simulation.first_yaw(),
        });
        loop {
            stop_if_asked(observer)?;
            for _ in 0..PARTS_PER_STEP {
                let parts = self.part(simulation, autopilot);
                if parts.is_err() {
                    pass_on_words(simulation, autopilot, observer);
                }
                parts?;
            }
            // It would lie there, armed again and again, until the time is over.
            if report_mishaps(simulation, observer) {
                let sentence = format!(
                    "{} tipped over {:.1} s after the plant began, before the first point of the trajectory",
                    autopilot.identity().peer,
                    simulation.elapsed_ns() as f64 * 1e-9
                );
                return Err(StopReason::Failed(Failure::of("controller", sentence)));
            }
            pass_on_words(simulation, autopilot, observer);
            self.prelude_ns = simulation.elapsed_ns();
            let away = distance_and_speed(simulation);
            let near = away.0 < hand_over.radius_m && away.1 < hand_over.speed_m_s && !simulation.on_ground();
            still_ns = if near {
                still_ns + (self.prelude_ns - last_ns)
            } else {
                0
            };
            last_ns = self.prelude_ns;
            if still_ns as f64 * 1e-9 >= hand_over.hold_s {
                return Ok(());
            }
            if self.prelude_ns as f64 * 1e-9 > hand_over.limit_s {
                let sentence = format!(
                    "{} did not come to rest within {} m of the first point of the trajectory in {} s of simulated time: it is {:.1} m \
                     away at {:.1} m/s{}",
                    autopilot.identity().peer,
                    hand_over.radius_m,
                    hand_over.limit_s,
                    away.0,
                    away.1,
                    if simulation.on_ground() { ", on the ground" } else { "" }
                );
                return Err(StopReason::Failed(Failure::of("controller", sentence)));
            }
        }
    }

    fn step(
        &mut self,
        simulation: &mut Simulation,
        autopilot: &mut impl Autopilot,
        fdi: &mut FdiEnginePeer,
        observer: &mut impl FlightObserver,
    ) -> Result<(), StopReason> {
        let sensed = simulation.sense();
        let stamp = Stamp {
            run_id: self.run_id,
            step: sensed.step,
            sim_time_ns: sensed.sim_time_ns,
        };
        let sensors = SensorFrame::new(stamp, &sensed.nav, &sensed.reference, sensed.battery_voltage).canonical();
        let truth = *simulation.truth();
        autopilot.steer(&Wanted {
            position_ned_m: sensed.reference.position_ned.to_array().map(f64::from),
            velocity_ned_m_s: sensed.reference.velocity_ned.to_array().map(f64::from),
            yaw_rad: f64::from(sensed.reference.yaw),
        });
        let mut sum = [0.0; MAX_ROTORS];
        for _ in 0..PARTS_PER_STEP {
            self.part(simulation, autopilot)?;
            for (sum, duty) in sum.iter_mut().zip(&self.duty) {
                *sum += duty;
            }
        }
        let command = CommandFrame {
            stamp,
            duty: sum.map(|duty| (duty / f64::from(PARTS_PER_STEP)) as f32),
            ..CommandFrame::default()
        }
        .canonical();
        let rotors = simulation.rotor_count();
        let protocol_violation =
            |peer: &str, error: convert::ConvertError| StopReason::Failed(Failure::of(peer, error.to_string()));
        convert::check_sensors(&sensors).map_err(|error| protocol_violation("plant", error))?;
        convert::check_command(&command, rotors).map_err(|error| protocol_violation("controller", error))?;
        let mut report = fdi.step(&sensors, &command).canonical();
        report.stamp = stamp;
        convert::check_report(&report, rotors).map_err(|error| protocol_violation("fdi", error))?;
        report_mishaps(simulation, observer);
        pass_on_words(simulation, autopilot, observer);
        let sample = Sample {
            sensors,
            command,
            report,
            truth,
            specific_force_m_s2: sensed.specific_force_m_s2,
        };
        self.hasher.update(&sample);
        self.steps += 1;
        observer
            .sample(&sample)
            .map_err(|sentence| StopReason::Failed(Failure::of("plant", sentence)))
    }

    /// Advances by 0.5 ms, with an exchange when one is due.
    fn part(&mut self, simulation: &mut Simulation, autopilot: &mut impl Autopilot) -> Result<(), StopReason> {
        if self.parts_left == 0 {
            self.duty = autopilot.exchange(&self.readings(simulation))?;
            self.parts_left = autopilot.interval_parts().max(1);
        }
        self.parts_left -= 1;
        simulation.advance_part(&self.duty)?;
        Ok(())
    }

    fn readings(&mut self, simulation: &Simulation) -> Readings {
        let truth = simulation.truth();
        Readings {
            battery_voltage_v: truth.battery_voltage_v,
            battery_current_a: truth.battery_current_a,
            position_ned_m: truth.position_ned_m,
            velocity_ned_m_s: truth.velocity_ned_m_s,
            attitude_rad: truth.attitude_rad,
            ..sensed(&simulation.measure(&mut self.instruments))
        }
    }
}

/// Instrument readings as an autopilot receives them; they omit the battery and the true motion.
pub(crate) fn sensed(sample: &InstrumentSample) -> Readings {
    Readings {
        time_ns: sample.time_ns,
        specific_force_m_s2: sample.specific_force_m_s2,
        body_rates_rad_s: sample.body_rates_rad_s,
        magnetic_field_gauss: sample.magnetic_field_gauss,
        pressure_hpa: sample.pressure_hpa,
        pressure_altitude_m: sample.pressure_altitude_m,
        temperature_c: sample.temperature_c,
        gps: sample.gps.map(|fix| Fix {
            latitude_deg: fix.latitude_deg,
            longitude_deg: fix.longitude_deg,
            altitude_m: fix.altitude_m,
            velocity_ned_m_s: fix.velocity_ned_m_s,
        }),
        range_m: sample.range_m,
        ..Readings::default()
    }
}

fn stop_if_asked(observer: &mut impl FlightObserver) -> Result<(), StopReason> {
    observer.stop_requested().map_or(Ok(()), Err)
}

/// True if it has tipped over.
fn report_mishaps(simulation: &mut Simulation, observer: &mut impl FlightObserver) -> bool {
    let time_s = simulation.truth().sim_time_ns as f64 * 1e-9;
    let mut tipped_over = false;
    for event in simulation.take_ground_events() {
        tipped_over |= matches!(event, GroundEvent::TipOver { .. });
        observer.mishap(time_s, event);
    }
    tipped_over
}

fn pass_on_words(simulation: &Simulation, autopilot: &mut impl Autopilot, observer: &mut impl FlightObserver) {
    while let Some(text) = autopilot.words() {
        observer.words(simulation.elapsed_ns() as f64 * 1e-9, text);
    }
}

/// Distance from the first point of the trajectory, m, and speed, m/s.
fn distance_and_speed(simulation: &Simulation) -> (f64, f64) {
    let truth = simulation.truth();
    let first = simulation.first_point();
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let away = [0, 1, 2].map(|i| truth.position_ned_m[i] - first[i]);
    (length(away), length(truth.velocity_ned_m_s))
}

impl From<AutopilotError> for StopReason {
    fn from(error: AutopilotError) -> Self {
        if error.stopped {
            return Self::Canceled;
        }
        let failure = Failure::of("controller", error.sentence);
        Self::Failed(Failure {
            silence: error.silence,
            lost: error.lost,
            ..failure
        })
    }
}
