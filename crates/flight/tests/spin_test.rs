//! Autopilots with swapped or reversed motors on the stand: each is identified, correct ones are not faulted.

use rotortwin_flight::conform::{SpinReport, spin_test};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::{Controller, ControllerConfig};
use rotortwin_flight_core::frames::{EulerAngles, Vec3};
use rotortwin_flight_core::geometry::{Geometry, Spin};
use rotortwin_flight_core::signals::{NavState, Reference};
use rotortwin_scenario::Scenario;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Identity, Readings, Wanted};
use std::collections::VecDeque;

fn scenario(vehicle: &str) -> Scenario {
    let text = format!(
        "name = 'stand'\ndescription = 'stand'\nvehicle = '../vehicles/{vehicle}.toml'\nduration_s = 5.0\n\
         [initial]\nstart = 'on-ground'\n[trajectory]\nkind = 'hover'\nposition_ned_m = [0.0, 0.0, -2.0]\n[ground]\ndown_m = 0.0\n[ground.contact]\n"
    );
    let folder = format!("{}/../../config/scenarios", env!("CARGO_MANIFEST_DIR"));
    Scenario::parse(&text, folder).expect("a good scenario")
}

/// Our PID in place of an autopilot, with its own assumptions about motor places and directions.
struct Believer {
    controller: Controller,
    wanted: Wanted,
    /// `order[i]`: our rotor that receives the duty meant for rotor i.
    order: Vec<usize>,
    /// Delay of its duties, in exchanges.
    late: usize,
    queue: VecDeque<[f64; MAX_ROTORS]>,
    /// Does not respond to tilts.
    numb: bool,
}

impl Believer {
    fn new(scenario: &Scenario, gain: f32, late: usize) -> Self {
        Self::with_spins(scenario, gain, late, &[])
    }

    /// Assumes that these rotors, from 0, turn the other way.
    fn with_spins(scenario: &Scenario, gain: f32, late: usize, reversed: &[usize]) -> Self {
        let mut config: ControllerConfig = scenario.controller_config();
        let mut rotors = config.geometry.rotors().to_vec();
        for &rotor in reversed {
            rotors[rotor].spin = if rotors[rotor].spin == Spin::Ccw {
                Spin::Cw
            } else {
                Spin::Ccw
            };
        }
        config.geometry = Geometry::new(&rotors).expect("it flies");
        for gains in &mut config.attitude_gains {
            gains.proportional *= gain;
            gains.derivative *= gain.sqrt();
        }
        Self {
            controller: Controller::new(config).expect("it flies"),
            wanted: Wanted::default(),
            order: (0..config.geometry.rotor_count()).collect(),
            late,
            queue: VecDeque::new(),
            numb: false,
        }
    }
}

impl Autopilot for Believer {
    fn interval_parts(&self) -> u32 {
        5
    }

    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        let single = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
        let rates = Vec3::from_array(readings.body_rates_rad_s.map(|x| x as f32));
        let [roll, pitch, yaw] = readings.attitude_rad.map(|x| x as f32);
        let nav = NavState {
            position_ned: single(readings.position_ned_m),
            velocity_ned: single(readings.velocity_ned_m_s),
            attitude: if self.numb {
                EulerAngles::default()
            } else {
                EulerAngles { roll, pitch, yaw }
            },
            body_rates: if self.numb { Vec3::from_array([0.0; 3]) } else { rates },
        };
        let reference = Reference {
            position_ned: single(self.wanted.position_ned_m),
            ..Reference::default()
        };
        let meant = self.controller.step(&nav, &reference, 15.5).command.duty;
        let mut duty = [0.0; MAX_ROTORS];
        for (place, &rotor) in self.order.iter().enumerate() {
            duty[rotor] = f64::from(meant[place]);
        }
        self.queue.push_back(duty);
        if self.queue.len() > self.late + 1 {
            self.queue.pop_front();
        }
        Ok(self.queue[0])
    }

    fn identity(&self) -> Identity {
        Identity {
            peer: "the believer".to_owned(),
            ..Identity::default()
        }
    }

    fn steer(&mut self, wanted: &Wanted) {
        self.wanted = *wanted;
    }
}

fn examine(
    autopilot: &mut Believer,
    scenario: &Scenario,
    seed: u64,
    rotor_of_channel: &[usize],
) -> Result<SpinReport, String> {
    spin_test(autopilot, scenario, seed, rotor_of_channel, &mut |_, _| {})
}

/// ArduPilot's hexa X, as our rotors from 0.
const CHANNELS: [usize; 6] = [1, 4, 5, 2, 0, 3];

#[test]
fn scenario_right_autopilots_are_not_blamed() {
    let scenario = scenario("f550-skids");
    for variation in 0..24_u64 {
        let gain = 0.4 + 0.05 * variation as f32;
        let mut autopilot = Believer::new(&scenario, gain, variation as usize % 5);
        let report = examine(&mut autopilot, &scenario, variation, &CHANNELS).expect("it answers");
        assert!(report.is_right(), "{variation}: {report:?}");
    }
}

#[test]
fn scenario_each_swapped_pair_is_named() {
    let scenario = scenario("f550-skids");
    for a in 0..6 {
        for b in 0..a {
            let mut autopilot = Believer::new(&scenario, 0.7, 2);
            autopilot.order.swap(a, b);
            let report = examine(&mut autopilot, &scenario, 1, &CHANNELS).expect("it answers");
            let wrong: Vec<(usize, usize)> = report
                .motors
                .iter()
                .filter(|motor| !motor.is_right())
                .map(|motor| (motor.rotor, motor.answers_as))
                .collect();
            let both = [(a + 1, b + 1), (b + 1, a + 1)];
            assert!(
                wrong.len() == 2 && both.iter().all(|pair| wrong.contains(pair)),
                "{a} {b}: {report:?}"
            );
            assert!(report.motors.iter().all(|motor| !motor.reversed), "{report:?}");
            let channel = report
                .motors
                .iter()
                .find(|motor| motor.rotor == a + 1)
                .map(|motor| motor.channel);
            assert_eq!(channel, CHANNELS.iter().position(|&rotor| rotor == a).map(|i| i + 1));
        }
    }
}

#[test]
fn scenario_reversed_motors_are_named() {
    let scenario = scenario("f550-skids");
    let cases: [&[usize]; 8] = [&[0], &[1], &[2], &[3], &[4], &[5], &[0, 3], &[0, 1, 2, 3, 4, 5]];
    for reversed in cases {
        let mut autopilot = Believer::with_spins(&scenario, 0.7, 1, reversed);
        let report = examine(&mut autopilot, &scenario, 1, &CHANNELS).expect("it answers");
        let mut named: Vec<usize> = report
            .motors
            .iter()
            .filter(|m| m.reversed)
            .map(|m| m.rotor - 1)
            .collect();
        named.sort_unstable();
        assert_eq!(named, reversed, "{report:?}");
        assert!(
            report.motors.iter().all(|motor| motor.rotor == motor.answers_as),
            "{report:?}"
        );
    }
}

#[test]
fn scenario_an_order_of_another_autopilot_is_named() {
    // Our rotors in the order of Betaflight's HEX6X, mistaken for ArduPilot's.
    let scenario = scenario("f550-skids");
    let betaflight = [2, 0, 3, 5, 1, 4];
    let mut autopilot = Believer::new(&scenario, 0.7, 1);
    for (channel, &meant) in betaflight.iter().enumerate() {
        autopilot.order[meant] = CHANNELS[channel];
    }
    let report = examine(&mut autopilot, &scenario, 1, &CHANNELS).expect("it answers");
    let seen: Vec<usize> = report.motors.iter().map(|motor| motor.answers_as - 1).collect();
    assert_eq!(seen, betaflight);
}

#[test]
fn scenario_an_autopilot_that_answers_nothing_is_said_so() {
    let scenario = scenario("f550-skids");
    let mut autopilot = Believer::new(&scenario, 1.0, 0);
    autopilot.numb = true;
    let sentence = examine(&mut autopilot, &scenario, 1, &CHANNELS).expect_err("nothing to see");
    assert!(sentence.contains("does not respond to a swing in roll"), "{sentence}");
}
