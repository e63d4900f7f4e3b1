//! Pilot of an autopilot that only accepts sticks: an outer loop that controls position, velocity and yaw by tilt, throttle and yaw rate.
//!
//! ```text
//!  v_d = v_r + k_p (p_r − p)          a_d = k_v (v_d − v) + ∫ k_i (v_d − v)
//!  tilt ahead = atan(a_ahead / g)     tilt right = atan(a_right / g)     throttle = h (1 + a_up / g) / cos tilt
//! ```
//! with h, the hover throttle, found by integration. The autopilot levels itself (its ANGLE mode) and has no position estimate, so the
//! loop uses the plant's true position, velocity and attitude; the remaining tilt error is added to the commanded tilt.

use rotortwin_wire::autopilot::{Readings, Wanted};

const G: f64 = 9.81;
/// 1/s.
const POSITION_GAIN: f64 = 0.7;
/// 1/s.
const VELOCITY_GAIN: f64 = 1.6;
/// 1/s².
const VELOCITY_INTEGRAL: f64 = 0.2;
/// m/s; m/s².
const FASTEST_ASIDE: f64 = 3.0;
const FASTEST_UP: f64 = 1.0;
const HARDEST_ASIDE: f64 = 3.5;
const HARDEST_UP: f64 = 3.0;
/// Fraction of the tilt error that is added to the commanded tilt.
const TILT_GAIN: f64 = 1.0;
/// Tilt at full stick, rad: its `angle_limit` of 60°.
const TILT_AT_FULL_STICK: f64 = std::f64::consts::PI / 3.0;
/// Yaw rate at full stick, rad/s: its `yaw_rc_rate` and `yaw_srate` of 100 °/s, as set in our configuration.
const YAW_AT_FULL_STICK: f64 = 1.745;
/// Yaw rate per yaw error, 1/s, and its limit, rad/s.
const YAW_GAIN: f64 = 0.6;
const FASTEST_YAW: f64 = 0.4;
/// Initial throttle, and search range of the hover throttle, fractions.
const FIRST_THROTTLE: f64 = 0.12;
const THROTTLES: (f64, f64) = (0.08, 0.85);
/// Throttle per m/s of error, 1/s.
const THROTTLE_INTEGRAL: f64 = 0.12;
/// Rate at which the commanded height changes, m/s.
const CLIMB: f64 = 0.7;
const SINK: f64 = 0.5;
/// Its boot grace and more, s.
const BOOT_S: f64 = 7.0;
/// Time after which the arm switch is toggled again, s, and the limit for arming.
const ARM_AGAIN_S: f64 = 5.0;
const ARM_S: f64 = 60.0;
/// Maximum number of times that it may disarm by itself before the flight.
const MOST_DISARMED: u32 = 3;
/// The vehicle stands if it has been slower than this for this long, m/s and s, and this close to its earlier standing height, m.
const STILL_M_S: f64 = 0.05;
const STILL_S: f64 = 0.5;
const STANDS_M: f64 = 0.05;

/// Inputs of the pilot.
pub(super) struct Telling<'a> {
    /// Time since the last call, s.
    pub(super) dt_s: f64,
    /// The motors are turning.
    pub(super) armed: bool,
    pub(super) readings: &'a Readings,
    pub(super) wanted: &'a Wanted,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    #[default]
    Boot,
    Arm,
    Fly,
    Land,
    Landed,
}

/// See the module documentation.
#[derive(Debug, Default)]
pub(super) struct Sticks {
    stage: Stage,
    /// Time in the stage, s.
    time_s: f64,
    /// Down, m, NED: standing height, and current target.
    ground: f64,
    down: f64,
    /// Learned: accelerations to the north and east, m/s², and throttle.
    aside: [f64; 2],
    throttle: f64,
    still_s: f64,
    was_armed: bool,
    /// The flight has begun; how often it disarmed by itself before.
    in_flight: bool,
    disarmed: u32,
    words: Vec<String>,
}

impl Sticks {
    pub(super) fn flight_begins(&mut self) {
        self.in_flight = true;
    }

    pub(super) fn land(&mut self) {
        self.enter(Stage::Land);
        self.still_s = 0.0;
    }

    pub(super) fn landed(&self) -> bool {
        self.stage == Stage::Landed && !self.was_armed
    }

    pub(super) fn take_words(&mut self) -> Vec<String> {
        std::mem::take(&mut self.words)
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        self.time_s = 0.0;
    }

    /// Channels, µs: roll, pitch, throttle, yaw, arm switch, switch of the ANGLE mode.
    ///
    /// # Errors
    /// It does not arm, or does not stay armed.
    pub(super) fn step(&mut self, telling: &Telling<'_>) -> Result<[u16; 16], String> {
        self.time_s += telling.dt_s;
        match self.stage {
            Stage::Boot => {
                if self.time_s >= BOOT_S {
                    self.enter(Stage::Arm);
                }
            }
            Stage::Arm => self.arm(telling)?,
            Stage::Fly => {
                if self.was_armed && !telling.armed {
                    self.words.push("its motors stopped: it has disarmed itself".to_owned());
                    self.disarmed += 1;
                    if self.disarmed < MOST_DISARMED && !self.in_flight {
                        self.enter(Stage::Arm);
                    } else if !self.in_flight {
                        return Err(format!(
                            "Betaflight has disarmed itself {MOST_DISARMED} times before the flight; it prints the reasons once per second on its \
                             console"
                        ));
                    }
                }
            }
            Stage::Land => self.touch_down(telling),
            Stage::Landed => {}
        }
        self.was_armed = telling.armed;
        Ok(self.channels(telling))
    }

    fn arm(&mut self, telling: &Telling<'_>) -> Result<(), String> {
        if telling.armed {
            self.words.push("armed".to_owned());
            self.ground = telling.readings.position_ned_m[2];
            self.down = self.ground;
            self.aside = [0.0; 2];
            self.throttle = FIRST_THROTTLE;
            self.enter(Stage::Fly);
        } else if self.time_s > ARM_S {
            return Err(format!(
                "Betaflight does not arm: its motors have not turned {ARM_S} s after its arm switch (AUX1) was first moved; it prints the reasons once \
                 per second on its console"
            ));
        }
        Ok(())
    }

    fn touch_down(&mut self, telling: &Telling<'_>) {
        let readings = telling.readings;
        let v = readings.velocity_ned_m_s;
        let speed = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let stands = speed < STILL_M_S && readings.position_ned_m[2] > self.ground - STANDS_M;
        self.still_s = if stands { self.still_s + telling.dt_s } else { 0.0 };
        if self.still_s > STILL_S || !telling.armed {
            self.enter(Stage::Landed);
        }
    }

    fn channels(&mut self, telling: &Telling<'_>) -> [u16; 16] {
        let mut channels = [1500; 16];
        channels[2] = 1000;
        // The arm switch is released for a second before it is toggled again.
        let switched = match self.stage {
            Stage::Boot | Stage::Landed => false,
            Stage::Arm => self.time_s % ARM_AGAIN_S < ARM_AGAIN_S - 1.0,
            Stage::Fly | Stage::Land => true,
        };
        channels[4] = if switched { 2000 } else { 1000 };
        channels[5] = 2000;
        if matches!(self.stage, Stage::Fly | Stage::Land) {
            let [right, ahead, throttle, yaw] = self.hold(telling);
            let stick = |fraction: f64| (1500.0 + 500.0 * fraction.clamp(-1.0, 1.0)).round() as u16;
            channels[0] = stick(right / TILT_AT_FULL_STICK);
            channels[1] = stick(ahead / TILT_AT_FULL_STICK);
            channels[2] = (1000.0 + 1000.0 * throttle.clamp(0.0, 1.0)).round() as u16;
            channels[3] = stick(yaw / YAW_AT_FULL_STICK);
        }
        channels
    }

    /// Tilt to the right and forward, rad; throttle; yaw rate, rad/s.
    fn hold(&mut self, telling: &Telling<'_>) -> [f64; 4] {
        let (readings, wanted, dt_s) = (telling.readings, telling.wanted, telling.dt_s);
        let (position, velocity) = (readings.position_ned_m, readings.velocity_ned_m_s);
        let goal = match self.stage {
            // Continue below ground level until it stands.
            Stage::Land => self.down + SINK,
            _ => wanted.position_ned_m[2],
        };
        let (rate, most) = match self.stage {
            Stage::Land => (SINK, SINK * dt_s),
            _ => (CLIMB, CLIMB * dt_s),
        };
        let move_down = (goal - self.down).clamp(-most, most);
        // A distant height is approached at a limited rate; one that moves slower is followed.
        self.down += move_down;
        let down_rate = if move_down.abs() < most {
            wanted.velocity_ned_m_s[2]
        } else {
            rate * move_down.signum()
        };
        let [roll, pitch, yaw] = readings.attitude_rad;

        let mut acceleration = [0.0; 2];
        for i in 0..2 {
            let ahead = POSITION_GAIN * (wanted.position_ned_m[i] - position[i]);
            let desired = wanted.velocity_ned_m_s[i] + ahead.clamp(-FASTEST_ASIDE, FASTEST_ASIDE);
            let error = desired - velocity[i];
            self.aside[i] = (self.aside[i] + VELOCITY_INTEGRAL * error * dt_s).clamp(-HARDEST_ASIDE, HARDEST_ASIDE);
            // Standing on its feet it cannot respond.
            if self.ground - position[2] < STANDS_M {
                self.aside[i] = 0.0;
            }
            acceleration[i] = (VELOCITY_GAIN * error + self.aside[i]).clamp(-HARDEST_ASIDE, HARDEST_ASIDE);
        }
        let (sin, cos) = yaw.sin_cos();
        let ahead = (cos * acceleration[0] + sin * acceleration[1]) / G;
        let right = (cos * acceleration[1] - sin * acceleration[0]) / G;

        let error =
            down_rate + (POSITION_GAIN * (self.down - position[2])).clamp(-FASTEST_UP, FASTEST_UP) - velocity[2];
        self.throttle = (self.throttle - THROTTLE_INTEGRAL * error * dt_s).clamp(THROTTLES.0, THROTTLES.1);
        let up = (-VELOCITY_GAIN * error).clamp(-HARDEST_UP, HARDEST_UP) / G;
        let throttle = self.throttle * (1.0 + up) / (roll.cos() * pitch.cos()).max(0.5);

        let turn = (wanted.yaw_rad - yaw).sin().atan2((wanted.yaw_rad - yaw).cos());
        let turn = (YAW_GAIN * turn).clamp(-FASTEST_YAW, FASTEST_YAW);
        // Without drag, the accelerometer of a vehicle senses no tilt at all: its own estimate falls back to level within some seconds.
        let corrected = |wanted: f64, tilt: f64| wanted + TILT_GAIN * (wanted - tilt);
        [
            corrected(right.atan(), roll),
            corrected(ahead.atan(), -pitch),
            throttle,
            turn,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WANTED: Wanted = Wanted {
        position_ned_m: [0.0, 0.0, -2.0],
        velocity_ned_m_s: [0.0; 3],
        yaw_rad: 0.0,
    };

    /// Armed and in the air at 2 m.
    fn flying(readings: &Readings, wanted: &Wanted) -> [u16; 16] {
        let mut sticks = Sticks {
            stage: Stage::Fly,
            down: -2.0,
            throttle: 0.4,
            was_armed: true,
            ..Sticks::default()
        };
        let telling = Telling {
            dt_s: 0.02,
            armed: true,
            readings,
            wanted,
        };
        sticks.step(&telling).unwrap()
    }

    #[test]
    fn val_each_stick_goes_where_the_error_is() {
        let at = |position_ned_m: [f64; 3], yaw: f64| Readings {
            position_ned_m,
            attitude_rad: [0.0, 0.0, yaw],
            ..Readings::default()
        };
        let middle = flying(&at([0.0, 0.0, -2.0], 0.0), &WANTED);
        assert_eq!(middle[..6], [1500, 1500, 1400, 1500, 2000, 2000]);
        // Target to the north: nose down. To the east: right side down. Facing east, north is to the left.
        assert!(flying(&at([-1.0, 0.0, -2.0], 0.0), &WANTED)[1] > 1520);
        assert!(flying(&at([0.0, -1.0, -2.0], 0.0), &WANTED)[0] > 1520);
        let turned = flying(&at([-1.0, 0.0, -2.0], std::f64::consts::FRAC_PI_2), &WANTED);
        assert!(turned[0] < 1480 && turned[1].abs_diff(1500) < 3, "{turned:?}");
        // Nose to the right of the target: turn left.
        assert!(flying(&at([0.0, 0.0, -2.0], 0.3), &WANTED)[3] < 1460);
        assert!(
            flying(&at([0.0, 0.0, -2.0], -6.0), &WANTED)[3] < 1500,
            "the short way round"
        );
        // Too low: more throttle.
        assert!(flying(&at([0.0, 0.0, -1.5], 0.0), &WANTED)[2] > 1420);
    }

    #[test]
    fn val_it_waits_arms_and_says_why_it_gives_up() {
        let readings = Readings::default();
        let mut sticks = Sticks::default();
        let mut step = |armed| {
            let telling = Telling {
                dt_s: 0.02,
                armed,
                readings: &readings,
                wanted: &WANTED,
            };
            sticks.step(&telling)
        };
        let mut switched = 0;
        for _ in 0..340 {
            let channels = step(false).unwrap();
            assert_eq!((channels[2], channels[5]), (1000, 2000));
            switched += u32::from(channels[4] == 2000);
        }
        assert_eq!(switched, 0, "its boot grace");
        let mut said = None;
        for _ in 0..4000 {
            match step(false) {
                Ok(channels) => switched += u32::from(channels[4] == 2000),
                Err(sentence) => said = Some(sentence),
            }
        }
        assert!(switched > 2000, "{switched}");
        assert!(
            said.unwrap()
                .starts_with("Betaflight does not arm: its motors have not turned 60 s")
        );
    }
}
