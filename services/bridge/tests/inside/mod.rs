//! Internals of a scripted ArduPilot or PX4: its motor numbering, and a small pilot with our own PID.

use super::autopilots::HEIGHT_M;
use rotortwin_bridge::autopilot::Patience;
use rotortwin_flight::conform::SpinReport;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::geometry::{Geometry, Spin};
use rotortwin_flight_core::signals::{NavState, Reference};
use rotortwin_scenario::Scenario;
use std::time::Duration;

/// Our rotor, from 1, for each channel of ArduPilot and PX4, from their own frame tables.
pub(crate) fn channels(scenario: &Scenario) -> &'static [usize] {
    match scenario.vehicle().rotors.layout.placements().len() {
        4 => &[1, 3, 4, 2],
        8 => &[1, 5, 2, 4, 8, 6, 7, 3],
        _ => &[2, 5, 6, 3, 1, 4],
    }
}

/// Time-outs short enough for a test.
pub(crate) fn patience() -> Patience {
    Patience {
        join: Duration::from_secs(5),
        step: Duration::from_millis(2500),
        ..Patience::default()
    }
}

/// Channel, our rotor, and the one whose place it is taken for, of each motor that is not right.
pub(crate) fn wrong(report: &SpinReport) -> Vec<[usize; 3]> {
    let wrong = report.motors.iter().filter(|motor| !motor.is_right());
    wrong
        .map(|motor| [motor.channel, motor.rotor, motor.answers_as])
        .collect()
}

/// The pilot and controller inside of a scripted autopilot: waits, arms, climbs at 1 m/s to the hover point, and holds.
pub(crate) struct Pilot {
    controller: Controller,
    duty: [f32; MAX_ROTORS],
    next_s: f64,
    /// Time of arming, s of its own clock.
    arms_s: f64,
}

impl Pilot {
    pub(crate) fn new(scenario: &Scenario, arms_s: f64) -> Self {
        Self::with_spins(scenario, arms_s, &[])
    }

    /// It takes the rotors of `reversed`, from 1, to turn the other way.
    pub(crate) fn with_spins(scenario: &Scenario, arms_s: f64, reversed: &[usize]) -> Self {
        let mut config = scenario.controller_config();
        let mut rotors = config.geometry.rotors().to_vec();
        for &rotor in reversed {
            let spin = &mut rotors[rotor - 1].spin;
            *spin = if *spin == Spin::Ccw { Spin::Cw } else { Spin::Ccw };
        }
        config.geometry = Geometry::new(&rotors).expect("a geometry that flies");
        Self {
            controller: Controller::new(config).expect("a good controller"),
            duty: [0.0; MAX_ROTORS],
            next_s: arms_s,
            arms_s,
        }
    }

    /// Duties by rotor at `time_s`; 0 before it arms.
    pub(crate) fn duties(
        &mut self,
        time_s: f64,
        position: [f64; 3],
        velocity: [f64; 3],
        attitude: [f64; 3],
        rates: [f64; 3],
    ) -> [f32; MAX_ROTORS] {
        // flight-core's controller runs in steps of 2.5 ms.
        while time_s >= self.next_s {
            self.next_s += 0.0025;
            let single = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
            let height = (0.179 + (time_s - self.arms_s)).min(HEIGHT_M);
            let nav = NavState {
                position_ned: single(position),
                velocity_ned: single(velocity),
                attitude: EulerAngles {
                    roll: attitude[0] as f32,
                    pitch: attitude[1] as f32,
                    yaw: attitude[2] as f32,
                },
                body_rates: Vec3::from_array(rates.map(|x| x as f32)),
            };
            let reference = Reference {
                position_ned: single([0.0, 0.0, -height]),
                velocity_ned: single([0.0, 0.0, if height < HEIGHT_M { -1.0 } else { 0.0 }]),
                yaw: 0.0,
            };
            self.duty = self.controller.step(&nav, &reference, 15.5).command.duty;
        }
        self.duty
    }
}
