//! Which motor responds to which tilt: an autopilot on a test stand.
//!
//! ```text
//!  arms, climbs along a pole (only the total thrust moves it) ─▶ is rocked in roll, pitch, yaw, 4 s each ─▶ which duties respond
//! ```
//! Like tilting a vehicle by hand to see whether the right motors speed up: the attitude is imposed, whatever the autopilot does, so that
//! one with swapped motors is not lost before it has been tested. Instrument readings are consistent with that motion.
//!
//! The response to a swing A sin ωt is −(k A sin ωt + d A ω cos ωt), distributed over the motors according to the autopilot's mixer. The
//! share in roll and pitch shows where the mixer places each motor, that in yaw how it assumes the motor to turn.

use super::motors::{LEFT, Swings, judge};
pub use super::motors::{MotorVerdict, SpinReport};
use super::response::{Airframe, Duties, length};
use crate::autopilot::sensed;
use nalgebra::{Matrix3, Vector3};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::PARTS_PER_STEP;
use rotortwin_plant::body::rigid_body::Quaternion;
use rotortwin_plant::sensing::instruments::{InstrumentModel, Instruments, Scene};
use rotortwin_plant::simulation::parts::PART_NS;
use rotortwin_scenario::Scenario;
use rotortwin_wire::autopilot::{Autopilot, Readings, Wanted};

/// Simulated time within which it must hover near the first point, s.
const CLIMB_S: f64 = 600.0;
/// Hover criterion: distance m, speed m/s, duration s.
const NEAR_M: f64 = 0.5;
const STILL_M_S: f64 = 0.3;
const HOVER_S: f64 = 2.0;
/// Each axis: duration, s; amplitude, rad; period, s, short enough that integrators do not dominate. The first two periods are ignored.
/// The pole refuses what an autopilot asks for, so that its integrators wind up: five periods of each axis, not more.
const ROCK_S: f64 = 4.0;
const SWING_RAD: [f64; 3] = [0.08, 0.08, 0.15];
const PERIOD_S: f64 = 0.8;
/// Duties within this of their limits answer nothing.
const AT_LIMIT: f64 = 0.02;
/// Pause between two axes, s.
const REST_S: f64 = 1.5;
/// Longest landing, s.
const LAND_S: f64 = 60.0;

/// Puts an autopilot on the stand. `rotor_of_channel` is the table under test; `say` receives the autopilot's messages with the time, s.
///
/// # Errors
/// The autopilot is lost or does not climb, or its responses do not show which motors are wrong, or whether any is.
pub fn spin_test(
    autopilot: &mut impl Autopilot,
    scenario: &Scenario,
    seed: u64,
    rotor_of_channel: &[usize],
    say: &mut dyn FnMut(f64, String),
) -> Result<SpinReport, String> {
    let mut stand = Stand::new(scenario, seed)?;
    let result = stand.test(autopilot, rotor_of_channel, say);
    autopilot.finish();
    result
}

/// The vehicle on its pole.
struct Stand {
    airframe: Airframe,
    instruments: Instruments,
    voltage_v: f64,
    parts: u64,
    parts_left: u32,
    duty: [f64; MAX_ROTORS],
    /// Thrust as an acceleration, after the rotor lag, m/s².
    lift: f64,
    down_m: f64,
    speed_down: f64,
    acceleration_down: f64,
    ground_m: f64,
    first: [f64; 3],
    attitude: [f64; 3],
    rates: [f64; 3],
}

impl Stand {
    fn new(scenario: &Scenario, seed: u64) -> Result<Self, String> {
        let simulation = scenario.simulation(seed).map_err(|error| error.to_string())?;
        let model: InstrumentModel = scenario.document().instruments.clone().unwrap_or_default();
        let truth = simulation.truth();
        let ground_m = truth.position_ned_m[2];
        Ok(Self {
            airframe: Airframe::new(scenario, simulation.hover_duty(), truth.battery_voltage_v as f32),
            instruments: Instruments::new(&model, seed),
            voltage_v: truth.battery_voltage_v,
            parts: 0,
            parts_left: 0,
            duty: [0.0; MAX_ROTORS],
            lift: 0.0,
            down_m: ground_m,
            speed_down: 0.0,
            acceleration_down: 0.0,
            ground_m,
            first: simulation.first_point(),
            attitude: [0.0; 3],
            rates: [0.0; 3],
        })
    }

    fn time_s(&self) -> f64 {
        self.parts as f64 * PART_NS as f64 * 1e-9
    }

    fn readings(&mut self) -> Readings {
        let position = [self.first[0], self.first[1], self.down_m];
        let velocity = [0.0, 0.0, self.speed_down];
        let ned_from_body = Quaternion::from_euler(self.attitude);
        let specific_force_ned = [0.0, 0.0, self.acceleration_down - self.airframe.gravity];
        let sample = self.instruments.measure(&Scene {
            time_ns: self.parts * PART_NS,
            position_ned: position,
            velocity_ned: velocity,
            body_rates: self.rates,
            specific_force: ned_from_body.body_from_ned(specific_force_ned),
            magnetic_field: ned_from_body.body_from_ned(self.instruments.magnetic_field_ned()),
            distance: f64::INFINITY,
        });
        Readings {
            battery_voltage_v: self.voltage_v,
            battery_current_a: 0.0,
            position_ned_m: position,
            velocity_ned_m_s: velocity,
            attitude_rad: self.attitude,
            ..sensed(&sample)
        }
    }

    /// Advances by 2.5 ms at a given attitude and rate.
    fn step(
        &mut self,
        autopilot: &mut impl Autopilot,
        (attitude, rates): ([f64; 3], [f64; 3]),
        say: &mut dyn FnMut(f64, String),
    ) -> Result<(), String> {
        const DT: f64 = PART_NS as f64 * 1e-9;
        (self.attitude, self.rates) = (attitude, rates);
        autopilot.steer(&Wanted {
            position_ned_m: self.first,
            ..Wanted::default()
        });
        for _ in 0..PARTS_PER_STEP {
            if self.parts_left == 0 {
                let readings = self.readings();
                let asked = autopilot.exchange(&readings);
                while let Some(text) = autopilot.words() {
                    say(self.time_s(), text);
                }
                self.duty = asked.map_err(|error| error.sentence)?;
                self.parts_left = autopilot.interval_parts().max(1);
            }
            self.parts_left -= 1;
            let tilt = self.attitude[0].cos() * self.attitude[1].cos();
            let share = DT / (DT + self.airframe.lag_s);
            // Linear around hover, zero at zero duty.
            let wanted = if self.duty.iter().all(|duty| *duty == 0.0) {
                0.0
            } else {
                (self.airframe.lift(&self.duty) * self.airframe.gravity).max(0.0)
            };
            self.lift += share * (wanted - self.lift);
            self.acceleration_down = self.airframe.gravity - self.lift * tilt;
            self.speed_down += DT * self.acceleration_down;
            self.down_m += DT * self.speed_down;
            if self.down_m >= self.ground_m {
                (self.down_m, self.speed_down) = (self.ground_m, 0.0);
                self.acceleration_down = self.acceleration_down.min(0.0);
            }
            self.parts += 1;
        }
        Ok(())
    }

    fn test(
        &mut self,
        autopilot: &mut impl Autopilot,
        rotor_of_channel: &[usize],
        say: &mut dyn FnMut(f64, String),
    ) -> Result<SpinReport, String> {
        self.climb(autopilot, say)?;
        autopilot.flight_begins();
        let mut swings = Swings::default();
        for axis in 0..3 {
            (swings.shares[axis], swings.at_limit[axis]) = self.rock(autopilot, axis, say)?;
            for _ in 0..(REST_S * 400.0) as u32 {
                self.step(autopilot, Default::default(), say)?;
            }
        }
        self.land(autopilot, say);
        judge(&self.airframe, &swings, rotor_of_channel, autopilot.identity().peer)
    }

    fn climb(&mut self, autopilot: &mut impl Autopilot, say: &mut dyn FnMut(f64, String)) -> Result<(), String> {
        let mut still_s = 0.0;
        while still_s < HOVER_S {
            self.step(autopilot, Default::default(), say)?;
            let away = (self.down_m - self.first[2]).abs();
            let near = away < NEAR_M && self.speed_down.abs() < STILL_M_S && self.down_m < self.ground_m;
            still_s = if near { still_s + 0.0025 } else { 0.0 };
            if self.time_s() > CLIMB_S {
                return Err(format!(
                    "{} did not come to rest near the first point in {CLIMB_S} s of simulated time: it is {away:.1} m away at {:.1} m/s",
                    autopilot.identity().peer,
                    self.speed_down
                ));
            }
        }
        Ok(())
    }

    /// Rocks about one axis, and returns each rotor's share of the opposing response, and the share of the samples with a motor at its limit.
    fn rock(
        &mut self,
        autopilot: &mut impl Autopilot,
        axis: usize,
        say: &mut dyn FnMut(f64, String),
    ) -> Result<(Duties, f64), String> {
        let omega = std::f64::consts::TAU / PERIOD_S;
        let angle = |time_s: f64| SWING_RAD[axis] * (0.5 * time_s / PERIOD_S).min(1.0) * (omega * time_s).sin();
        let steps = (ROCK_S * 400.0) as u32;
        let rotors = self.airframe.rotor_count();
        // duty = mean + sine sin ωt + cosine cos ωt by least squares: of all samples, and of those without a duty at its limit.
        let mut sums = [(Matrix3::zeros(), [Vector3::zeros(); MAX_ROTORS]); 2];
        let (mut looked, mut free) = (0.0, 0.0);
        for step in 0..steps {
            let time_s = f64::from(step) / 400.0;
            let (mut attitude, mut rates) = ([0.0; 3], [0.0; 3]);
            attitude[axis] = angle(time_s);
            rates[axis] =
                (angle(time_s + 1e-4) - angle((time_s - 1e-4).max(0.0))) / if time_s > 0.0 { 2e-4 } else { 1e-4 };
            self.step(autopilot, (attitude, rates), say)?;
            if time_s < 2.0 * PERIOD_S {
                continue;
            }
            let row = Vector3::new(1.0, (omega * time_s).sin(), (omega * time_s).cos());
            let range = AT_LIMIT..=1.0 - AT_LIMIT;
            let is_free = self.duty[..rotors].iter().all(|duty| range.contains(duty));
            looked += 1.0;
            free += f64::from(u8::from(is_free));
            for (normal, right) in &mut sums[..1 + usize::from(is_free)] {
                *normal += row * row.transpose();
                for (sum, duty) in right.iter_mut().zip(&self.duty) {
                    *sum += row * *duty;
                }
            }
        }
        // An autopilot whose motors are reversed drives them to their limits by itself.
        let (normal, right) = sums[usize::from(free >= LEFT * looked)];
        let inverse = normal.try_inverse().ok_or("the swing is too short")?;
        let answers = right.map(|sum| inverse * sum);
        let [sine, cosine] = [1, 2].map(|place| answers.map(|answer| -answer[place]));
        // The phase at which the response is largest, within a quarter turn of one that opposes both angle and rate.
        let (ss, cc) = (length(&sine).powi(2), length(&cosine).powi(2));
        let sc: f64 = sine.iter().zip(&cosine).map(|(s, c)| s * c).sum();
        let mut phase = 0.5 * (2.0 * sc).atan2(ss - cc);
        if phase < -std::f64::consts::FRAC_PI_4 {
            phase += std::f64::consts::PI;
        }
        let shares = std::array::from_fn(|i| sine[i] * phase.cos() + cosine[i] * phase.sin());
        Ok((shares, 1.0 - free / looked))
    }

    /// The outcome of the landing does not matter.
    fn land(&mut self, autopilot: &mut impl Autopilot, say: &mut dyn FnMut(f64, String)) {
        if !autopilot.flight_ends() {
            return;
        }
        for _ in 0..(LAND_S * 400.0) as u32 {
            if autopilot.landed() || self.step(autopilot, Default::default(), say).is_err() {
                return;
            }
        }
    }
}
