//! Whether a verdict means anything: is the vehicle flying, and does the model explain its motion?
//!
//! ```text
//!  Measurement ─▶ FlightWatch ──on the ground, just off it, upset──▶ the engine waits, and calibrates anew in the air
//!                                            └ in the air ─▶ FdiEngine ─▶ ModelCheck ──▶ verdict, or why there is none
//! ```
//! Separate from the engine: an engine returns what its model makes of any input, and a board has no room to spare.
//! Everything here is causal.
//!
//! * *Ground.* The support by anything other than the rotors, as a share of the weight: s = (g − T cos φ cos θ / m −
//!   v̇_D) / g, both accelerations through the same low-pass ([`SUPPORT_TIME`]). In flight s is an error of the model;
//!   on the ground it is the share carried by the ground. A rotor that loses thrust makes s negative, so a fault never
//!   looks like the ground.
//! * *Upset.* Tilt, and the tilt predicted over [`LOOK_AHEAD`] at the present rates, beyond 70°: thrust curve and lag
//!   were identified in calm air.
//! * *Model.* The wrench that lagged healthy rotors do not explain ([`super::second_look::SecondLook::unexplained`]),
//!   minus its mean in the calibration, minus the best loss of one or two rotors, each from 0 to all of its present
//!   thrust. The rest is compared with the hover thrust of a rotor and with the rest in the calibration.
//! * *Severity.* A loss whose whole interval is above the rotor's thrust is not a loss of a rotor.
//!
//! Limits: a vehicle on the ground whose rotors carry more than three quarters of the weight appears to fly after
//! [`LONGEST_LIGHT`]; one whose thrust is below 60 % of the model's appears to be on the ground. Gusts that rise and
//! fall at the speed of the calibration's are never too much: what they hide is not reported here.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::nominal_thrust::{FirstOrderLag, static_thrust};
#[cfg(doc)]
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;
use rotortwin_flight_core::fdi::{FdiConfig, FdiOutput, LossEstimate};
use rotortwin_flight_core::frames::{BodyToNed, Vec3};
use rotortwin_flight_core::signals::Measurement;

/// Low-pass of accelerations and thrusts, s: a few blocks of a noisy velocity.
const SUPPORT_TIME: f32 = 0.25;
/// Share of the weight supported by something else above which the vehicle is on the ground …
const STANDS_SUPPORT: f32 = 0.35;
/// … where its rotors carry less than this …
const STANDS_THRUST: f32 = 0.65;
/// … for this long, s.
const STANDS_TIME: f32 = 0.2;
/// … after an upset, s.
const STANDS_TIME_UPSET: f32 = 1.0;
/// … and where the whole flight shows that it is in the air: only the thrust of another vehicle's model lasts this long.
const STANDS_TIME_IN_THE_AIR: f32 = 5.0;
/// It flies if the rotors carry more than this, and anything else at most [`FLIES_SUPPORT`], for [`FLIES_TIME`].
const FLIES_THRUST: f32 = 0.75;
const FLIES_SUPPORT: f32 = 0.25;
const FLIES_TIME: f32 = 0.5;
/// Climb rate that proves that the vehicle has left the ground, m/s; without it, wait for [`LONGEST_LIGHT`].
const CLIMBS: f32 = 0.2;
/// Longest time on the ground with rotors that carry the vehicle, s.
const LONGEST_LIGHT: f32 = 5.0;
/// In the air before a calibration begins, s: ground effect and the transient of the take-off.
const CLEAR_TIME: f32 = 2.0;
/// Tilt beyond which the motion is not compared with the model, rad: 70°, as for the parts of a log.
pub(super) const MOST_TILT: f32 = 1.22;
/// Tilt of continued flight, rad: 60°.
const GOOD_TILT: f32 = 1.05;
/// Time over which the tilt is predicted at the present rates, s.
const LOOK_AHEAD: f32 = 0.25;
/// A reading beyond the tilt for fewer samples is a spike.
const UPSET_SAMPLES: u16 = 5;
/// After being upright for this long, an upset is over, s.
const UPRIGHT_TIME: f32 = 0.7;
/// Yaw counts less: rotors that change speed and the air drag of blades yaw the vehicle beyond the model.
const YAW_WEIGHT: f32 = 1.0 / 3.0;
/// Limit of the rest after the best loss: this many standard deviations of the rests in the calibration.
const MOST_DEVIATIONS: f32 = 8.0;
/// Below this share of the limit, for [`CALM_WINDOWS`], the model explains the motion again.
const CALM_SHARE: f32 = 0.6;
const CALM_WINDOWS: u16 = 8;
/// Unexplained for more consecutive windows than this, the filters have learnt something wrong: the calibration begins
/// again.
const SPOILT_WINDOWS: u16 = 16;

/// Loss of a rotor, of its thrust, beyond which the figure would mean nothing.
const MOST_SAID: f32 = 2.0;

/// Code of a verdict that would mean nothing, in JSON and in reports on logs; messages have [`NOT_READY`] and a note,
/// as their readers may be older.
pub const CANNOT_JUDGE: i32 = -4;

/// Why a verdict would mean nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacle {
    /// On the ground.
    Ground {
        /// Share of the weight that the rotors carry.
        carried: f32,
    },
    /// In the air for less than two seconds.
    TakeOff,
    /// Beyond 70° of tilt, or on the way into or out of it.
    Upset {
        /// Largest so far, rad.
        tilt: f32,
    },
    /// No loss of one or two rotors explains the motion.
    Unexplained {
        /// The rest, share of a rotor's hover thrust.
        left: f32,
    },
    /// Only the vertical force has changed, as if a load had been dropped or picked up.
    Load {
        /// Picked up, kg; negative: dropped.
        mass_kg: f32,
    },
    /// The engine has found something, but no loss of one to three rotors explains it, or too many do, or different
    /// ones from window to window.
    Unclear,
    /// The loss that would explain it exceeds the rotor's thrust.
    ImpossibleLoss {
        /// From 0.
        rotor: u8,
        /// Of its thrust.
        share: f32,
    },
}

impl std::fmt::Display for Obstacle {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Ground { carried } => write!(
                out,
                "on the ground: the rotors carry {:.0} % of the weight and the vehicle does not fall (in the air, another vehicle than the \
                 model's)",
                100.0 * carried
            ),
            Self::TakeOff => write!(out, "just off the ground: waiting for {CLEAR_TIME} s in the air"),
            Self::Upset { tilt } if tilt < MOST_TILT => write!(
                out,
                "sharp turn: at these rates the tilt changes by up to 70° within {LOOK_AHEAD} s, and the model is good for 70°"
            ),
            Self::Upset { tilt } => write!(
                out,
                "upset: tilted up to {:.0}°, the model is good for 70°",
                tilt.to_degrees()
            ),
            Self::Unexplained { left } => write!(
                out,
                "the model does not explain the motion: the part that no loss of one or two rotors explains is {:.1} times a rotor's thrust in hover",
                left
            ),
            Self::Load { mass_kg } => write!(
                out,
                "the vertical force alone has changed, as if {:.0} g had been {}; rotors are not judged at the same time",
                1000.0 * mass_kg.abs(),
                if mass_kg < 0.0 { "dropped" } else { "taken up" }
            ),
            Self::Unclear => write!(
                out,
                "something acts on the vehicle that no loss of one to three rotors explains, or that too many different rotors would explain"
            ),
            Self::ImpossibleLoss { rotor, share } => write!(
                out,
                "the model does not explain the motion: it would take {} rotor {}",
                if share < MOST_SAID {
                    format!("the loss of {:.0} % of the thrust of", 100.0 * share)
                } else {
                    "the loss of several times the thrust of".to_owned()
                },
                rotor + 1
            ),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Flight {
    Air,
    Ground,
    /// Remaining samples.
    TakeOff(u32),
    /// Samples upright so far; largest tilt, rad.
    Upset(u32, f32),
}

/// Distinguishes flight, ground and upset, sample by sample. Assumes flight until the first samples show otherwise.
#[derive(Clone, Debug)]
pub struct FlightWatch {
    config: FdiConfig,
    lag: FirstOrderLag<MAX_ROTORS>,
    thrust: [f32; MAX_ROTORS],
    /// Low-passed: downward velocity, m/s; acceleration due to the rotors, m/s²; thrust over weight.
    filtered: Option<[f32; 3]>,
    /// Samples so far.
    seen: u32,
    flight: Flight,
    /// Consecutive samples: on the ground, flying, tilted.
    standing: u32,
    flying: u32,
    tilted: u16,
    climbed: bool,
    carried: f32,
    /// The caller knows from the whole flight that it is in the air.
    in_the_air: bool,
}

impl FlightWatch {
    /// For the vehicle of an engine that has taken this configuration.
    pub fn new(config: &FdiConfig) -> Self {
        Self {
            config: *config,
            lag: FirstOrderLag::new(config.sequential.rotor_time_constant, config.period),
            thrust: [0.0; MAX_ROTORS],
            filtered: None,
            seen: 0,
            flight: Flight::Air,
            standing: 0,
            flying: 0,
            tilted: 0,
            climbed: false,
            carried: 0.0,
            in_the_air: false,
        }
    }

    /// For samples of which the caller knows that the vehicle is in the air, as from the parts of a whole log: closed
    /// throttles in a descent are then not taken for the ground, and a hard climb ends what was.
    #[must_use]
    pub fn in_the_air(self) -> Self {
        Self {
            in_the_air: true,
            ..self
        }
    }

    /// Restarts after a gap.
    pub fn restart(&mut self) {
        let in_the_air = self.in_the_air;
        *self = Self {
            in_the_air,
            ..Self::new(&self.config)
        };
    }

    /// Lagged thrust of every healthy rotor at the last sample, N.
    pub fn thrust(&self) -> &[f32; MAX_ROTORS] {
        &self.thrust
    }

    /// Processes one sample; returns the obstacle to a verdict on it. A sample that the engine would reject changes
    /// nothing.
    pub fn step(&mut self, input: &Measurement) -> Option<Obstacle> {
        let config = &self.config;
        let rotor_count = config.geometry.rotor_count();
        if is_plausible(input) {
            self.thrust = self.lag.step(&static_thrust(&config.thrust_map, rotor_count, input));
            let force_z = config.geometry.wrench_from_thrust(&self.thrust)[0];
            // cos φ cos θ.
            let cosine = BodyToNed::from_euler(input.nav.attitude)
                .to_ned(Vec3::new(0.0, 0.0, 1.0))
                .z;
            let speed = input.nav.velocity_ned.z;
            let weight = config.mass * config.gravity;
            let now = [
                speed,
                config.gravity + force_z * cosine / config.mass,
                -force_z / weight,
            ];
            let filtered = self.filtered.get_or_insert(now);
            // The low-pass of a derivative is the distance to the low-pass, over its time.
            let acceleration = (speed - filtered[0]) / SUPPORT_TIME;
            let support = (filtered[1] - acceleration) / config.gravity;
            for (old, new) in filtered.iter_mut().zip(now) {
                *old += (new - *old) * (config.period / SUPPORT_TIME);
            }
            self.carried = filtered[2];
            let [p, q, _] = input.nav.body_rates.to_array();
            let tilt = limited(cosine, -1.0, 1.0).acos();
            let ahead = tilt + LOOK_AHEAD * (p * p + q * q).sqrt();
            self.move_on(support, speed, tilt, ahead);
        }
        match self.flight {
            Flight::Air => None,
            Flight::Ground => Some(Obstacle::Ground { carried: self.carried }),
            Flight::TakeOff(_) => Some(Obstacle::TakeOff),
            Flight::Upset(_, tilt) => Some(Obstacle::Upset { tilt }),
        }
    }

    fn move_on(&mut self, support: f32, speed_down: f32, tilt: f32, ahead: f32) {
        let samples = |seconds: f32| (seconds / self.config.period).round() as u32;
        let count = |condition: bool, so_far: u32| if condition { so_far.saturating_add(1) } else { 0 };
        self.seen = self.seen.saturating_add(1);
        // The low-passes begin with no acceleration.
        let settled = self.seen > samples(2.0 * SUPPORT_TIME);
        let stands = support > STANDS_SUPPORT && self.carried < STANDS_THRUST;
        self.standing = count(settled && stands, self.standing);
        let alone = self.in_the_air || support.abs() < FLIES_SUPPORT;
        self.flying = count(self.carried > FLIES_THRUST && alone, self.flying);
        self.climbed = self.flying > 0 && (self.climbed || self.in_the_air || speed_down < -CLIMBS);
        self.tilted = if ahead > MOST_TILT {
            self.tilted.saturating_add(1)
        } else {
            0
        };
        let upset = self.tilted >= UPSET_SAMPLES;
        // In a tumble speeds come late, and rotors are idle: only what lasts is the ground.
        let upset_now = matches!(self.flight, Flight::Upset(..));
        let stands = self.standing
            >= samples(match (self.in_the_air, upset_now) {
                (true, _) => STANDS_TIME_IN_THE_AIR,
                (false, true) => STANDS_TIME_UPSET,
                (false, false) => STANDS_TIME,
            });
        let flies = self.flying >= samples(if self.climbed { FLIES_TIME } else { LONGEST_LIGHT });
        self.flight = match self.flight {
            _ if stands => Flight::Ground,
            Flight::Ground if flies => Flight::TakeOff(samples(CLEAR_TIME)),
            Flight::Ground => Flight::Ground,
            Flight::Upset(_, most) if ahead > GOOD_TILT => Flight::Upset(0, most.max(tilt)),
            Flight::Upset(upright, _) if upright >= samples(UPRIGHT_TIME) => Flight::Air,
            Flight::Upset(upright, most) => Flight::Upset(upright + 1, most),
            _ if upset => Flight::Upset(0, tilt),
            Flight::TakeOff(0) | Flight::Air => Flight::Air,
            Flight::TakeOff(left) => Flight::TakeOff(left - 1),
        };
    }
}

/// Decides whether the model explains the engine's input, window by window.
#[derive(Clone, Debug)]
pub struct ModelCheck {
    rotor_count: usize,
    /// Columns of F, each axis divided by its longest lever; yaw weighted.
    column: [[f32; 4]; MAX_ROTORS],
    scale: [f32; 4],
    /// Thrust of a rotor in hover, N.
    hover: f32,
    windows: f32,
    mean: [f32; 4],
    /// Mean square of the rest in the calibration, N².
    square: f32,
    /// The finding, until the motion is explained again.
    held: Option<Obstacle>,
    calm: u16,
    lasted: u16,
}

impl ModelCheck {
    /// For the vehicle of an engine that has taken this configuration.
    pub fn new(config: &FdiConfig) -> Self {
        let rotor_count = config.geometry.rotor_count();
        let f = config.geometry.effectiveness();
        let mut scale = [1.0; 4];
        for (axis, scale) in scale.iter_mut().enumerate() {
            let lever = f[axis][..rotor_count].iter().fold(0.0f32, |most, x| most.max(x.abs()));
            *scale = if axis == 3 { YAW_WEIGHT } else { 1.0 } / lever.max(1e-6);
        }
        Self {
            rotor_count,
            column: std::array::from_fn(|rotor| std::array::from_fn(|axis| f[axis][rotor] * scale[axis])),
            scale,
            hover: config.mass * config.gravity / rotor_count as f32,
            windows: 0.0,
            mean: [0.0; 4],
            square: 0.0,
            held: None,
            calm: 0,
            lasted: 0,
        }
    }

    /// Processes the window that ended; returns why its verdicts would mean nothing.
    ///
    /// * `unexplained`: wrench, N and N·m   * `thrust`: of every healthy rotor now, N   * `calibrating`: the engine still is
    pub fn window(
        &mut self,
        unexplained: &[f32; 4],
        thrust: &[f32; MAX_ROTORS],
        output: &FdiOutput,
        calibrating: bool,
    ) -> Option<Obstacle> {
        let mut wrench: [f32; 4] = std::array::from_fn(|axis| self.scale[axis] * unexplained[axis]);
        if calibrating {
            self.windows += 1.0;
            for axis in 0..4 {
                self.mean[axis] += (wrench[axis] - self.mean[axis]) / self.windows;
            }
        }
        for axis in 0..4 {
            wrench[axis] -= self.mean[axis];
        }
        let left = self.left(&wrench, thrust);
        if calibrating {
            self.square += (left * left - self.square) / self.windows;
            return None;
        }
        let most = self.hover.max(MOST_DEVIATIONS * self.square.sqrt());
        self.calm = if left < CALM_SHARE * most {
            self.calm.saturating_add(1)
        } else {
            0
        };
        if self.held.is_some() && self.calm >= CALM_WINDOWS {
            self.held = None;
            self.lasted = 0;
        }
        if left > most {
            self.held = Some(Obstacle::Unexplained {
                left: left / self.hover,
            });
        } else if self.held.is_none()
            && let Some(obstacle) = impossible(output)
        {
            // The filters have taken it in, or will.
            self.held = Some(obstacle);
            self.lasted = SPOILT_WINDOWS;
            self.calm = 0;
        }
        if self.held.is_some() {
            self.lasted = self.lasted.saturating_add(1);
        }
        self.held
    }

    /// The motion has been unexplained for so long that the engine has to restart once it is explained again.
    pub fn is_spoilt(&self) -> bool {
        self.lasted >= SPOILT_WINDOWS
    }

    /// Norm of the rest of a wrench after the best possible loss of up to two rotors, N.
    fn left(&self, wrench: &[f32; 4], thrust: &[f32; MAX_ROTORS]) -> f32 {
        let mut least = norm(wrench);
        for i in 0..self.rotor_count {
            for j in i..self.rotor_count {
                least = least.min(self.left_by(wrench, [i, j], [thrust[i], thrust[j]]));
            }
        }
        least
    }

    /// Losses of two rotors, in turn until they converge; of one if they are the same.
    fn left_by(&self, wrench: &[f32; 4], rotors: [usize; 2], most: [f32; 2]) -> f32 {
        let mut left = *wrench;
        let mut loss = [0.0; 2];
        let members = if rotors[0] == rotors[1] { 1 } else { 2 };
        for _ in 0..4 {
            for member in 0..members {
                let column = &self.column[rotors[member]];
                let square: f32 = column.iter().map(|x| x * x).sum();
                let along: f32 = column.iter().zip(&left).map(|(x, w)| x * w).sum();
                // A loss Δ makes the wrench −F Δ.
                let better = limited(loss[member] - along / square, 0.0, most[member].max(0.0));
                for axis in 0..4 {
                    left[axis] += column[axis] * (better - loss[member]);
                }
                loss[member] = better;
            }
        }
        norm(&left)
    }
}

/// A named loss whose whole interval exceeds the rotor's thrust.
fn impossible(output: &FdiOutput) -> Option<Obstacle> {
    let mut rotors = (0..MAX_ROTORS as u8).filter(|rotor| output.suspects.rotors >> rotor & 1 == 1);
    output.thrust_loss.iter().find_map(|loss: &LossEstimate| {
        let rotor = rotors.next()?;
        let [share, low, _] = loss.share();
        // NaN is no loss either.
        (low > 1.0 || low.is_nan()).then_some(Obstacle::ImpossibleLoss { rotor, share })
    })
}

/// No number that would corrupt a filter; the engine's own limits are the same or tighter.
fn is_plausible(input: &Measurement) -> bool {
    let nav = &input.nav;
    let [roll, pitch, yaw] = [nav.attitude.roll, nav.attitude.pitch, nav.attitude.yaw];
    let numbers = [
        nav.velocity_ned.to_array(),
        nav.body_rates.to_array(),
        [roll, pitch, yaw],
    ];
    numbers
        .as_flattened()
        .iter()
        .chain([&input.battery_voltage])
        .all(|x| x.abs() <= 1e3)
        && input.command.duty.iter().all(|duty| duty.is_finite())
}

fn norm(wrench: &[f32; 4]) -> f32 {
    wrench.iter().map(|x| x * x).sum::<f32>().sqrt()
}

fn limited(value: f32, low: f32, high: f32) -> f32 {
    value.max(low).min(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_flight_core::frames::EulerAngles;
    use rotortwin_flight_core::signals::{MotorCommand, NavState};
    use rotortwin_scenario::Scenario;

    fn config() -> FdiConfig {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenarios/hover.toml");
        Scenario::load(path).expect("it is shipped").fdi_config()
    }

    /// A duty at which the healthy rotors carry this share of the weight at 16 V.
    fn duty(config: &FdiConfig, share: f32) -> f32 {
        let wanted = share * config.mass * config.gravity / config.geometry.rotor_count() as f32;
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if config.thrust_map.thrust(middle, 16.0) < wanted {
                low = middle
            } else {
                high = middle
            }
        }
        low
    }

    fn sample(config: &FdiConfig, share: f32, speed_down: f32, roll: f32) -> Measurement {
        let mut command = [0.0; MAX_ROTORS];
        command[..config.geometry.rotor_count()].fill(duty(config, share));
        Measurement {
            nav: NavState {
                velocity_ned: Vec3::new(0.0, 0.0, speed_down),
                attitude: EulerAngles {
                    roll,
                    pitch: 0.0,
                    yaw: 0.0,
                },
                ..NavState::default()
            },
            command: MotorCommand { duty: command },
            battery_voltage: 16.0,
        }
    }

    /// The obstacle after this many seconds of samples; `at`: share of the weight, downward velocity, roll at a time.
    fn after(
        watch: &mut FlightWatch,
        config: &FdiConfig,
        seconds: f32,
        at: impl Fn(f32) -> (f32, f32, f32),
    ) -> Option<Obstacle> {
        let mut last = None;
        for step in 0..(seconds / config.period).round() as u32 {
            let (share, speed, roll) = at(step as f32 * config.period);
            last = watch.step(&sample(config, share, speed, roll));
        }
        last
    }

    #[test]
    fn val_idle_rotors_and_no_fall_are_the_ground_and_a_climb_ends_it() {
        let config = config();
        let mut watch = FlightWatch::new(&config);
        assert!(matches!(
            after(&mut watch, &config, 1.0, |_| (0.05, 0.0, 0.0)),
            Some(Obstacle::Ground { .. })
        ));
        // Light on its feet, but there.
        assert!(matches!(
            after(&mut watch, &config, 3.0, |_| (0.9, 0.0, 0.0)),
            Some(Obstacle::Ground { .. })
        ));
        // 0.3 m/s², then a steady climb.
        let climb = |t: f32| (if t < 2.0 { 1.03 } else { 1.0 }, -0.3 * t.min(2.0), 0.0);
        assert_eq!(after(&mut watch, &config, 2.4, climb), Some(Obstacle::TakeOff));
        assert_eq!(after(&mut watch, &config, 2.5, |_| (1.0, -0.6, 0.0)), None);
        assert!(matches!(
            after(&mut watch, &config, 0.8, |_| (0.1, 0.0, 0.0)),
            Some(Obstacle::Ground { .. })
        ));
    }

    #[test]
    fn val_neither_a_free_fall_nor_a_lost_rotor_is_the_ground() {
        let config = config();
        let g = config.gravity;
        let mut watch = FlightWatch::new(&config);
        assert_eq!(after(&mut watch, &config, 1.0, |t| (0.0, g * t, 0.0)), None);
        // The rotors are said to carry all of the weight and carry five sixths of it.
        let mut watch = FlightWatch::new(&config);
        assert_eq!(after(&mut watch, &config, 2.0, |t| (1.0, g / 6.0 * t, 0.0)), None);
    }

    /// A pilot closed the throttle for half a second in a descent; "on the ground" it was for the remaining 112 s.
    #[test]
    fn regress_closed_throttles_in_the_air_are_not_the_ground() {
        let config = config();
        let descent = |t: f32| (if t < 0.6 { 0.07 } else { 1.2 }, 5.0 - 0.1 * t, 0.0);
        let mut watch = FlightWatch::new(&config);
        assert!(matches!(
            after(&mut watch, &config, 3.0, descent),
            Some(Obstacle::Ground { .. })
        ));
        let mut watch = FlightWatch::new(&config).in_the_air();
        assert_eq!(after(&mut watch, &config, 3.0, descent), None);
        // Rotors that carry half of the weight for long are those of another model.
        assert!(matches!(
            after(&mut watch, &config, 8.0, |_| (0.5, 0.0, 0.0)),
            Some(Obstacle::Ground { .. })
        ));
        assert_eq!(
            after(&mut watch, &config, 1.5, |_| (1.2, 0.0, 0.0)),
            Some(Obstacle::TakeOff)
        );
    }

    #[test]
    fn val_an_upset_begins_before_70_degrees_and_ends_after_it() {
        let config = config();
        let mut watch = FlightWatch::new(&config);
        let hover = |_: f32| (1.0, 0.0, 0.0);
        assert_eq!(after(&mut watch, &config, 1.0, hover), None);
        let roll_rate = 3.0;
        let mut began = None;
        for step in 0..200 {
            let t = step as f32 * config.period;
            let mut tilted = sample(&config, 1.0, 0.0, roll_rate * t);
            tilted.nav.body_rates = Vec3::new(roll_rate, 0.0, 0.0);
            if began.is_none() && watch.step(&tilted).is_some() {
                began = Some(roll_rate * t);
            }
        }
        let began = began.expect("85° were passed");
        // A quarter of a second at 3 rad/s before 1.22 rad, and five samples.
        assert!((0.45..0.55).contains(&began), "{began}");
        assert!(matches!(
            after(&mut watch, &config, 0.5, hover),
            Some(Obstacle::Upset { .. })
        ));
        assert_eq!(after(&mut watch, &config, 0.5, hover), None);
    }

    fn output(loss: f32, low: f32) -> FdiOutput {
        let mut output = *rotortwin_flight_core::fdi::FdiEngine::new(config())
            .expect("shipped")
            .output();
        output.suspects.rotors = 0b100;
        output.thrust_loss[0] = LossEstimate {
            loss,
            low,
            high: loss + 0.1,
            nominal: 2.5,
        };
        output
    }

    fn calibrated(config: &FdiConfig) -> ModelCheck {
        let mut check = ModelCheck::new(config);
        for _ in 0..100 {
            assert_eq!(
                check.window(&[0.0; 4], &[2.5; MAX_ROTORS], &output(0.0, 0.0), true),
                None
            );
        }
        check
    }

    #[test]
    fn val_what_a_lost_rotor_does_is_explained_and_twice_as_much_is_not() {
        let config = config();
        let f = config.geometry.effectiveness();
        for (times, explained) in [(0.3, true), (1.0, true), (2.6, false)] {
            for rotor in 0..config.geometry.rotor_count() {
                let mut check = calibrated(&config);
                let residual: [f32; 4] = std::array::from_fn(|axis| -times * 2.5 * f[axis][rotor]);
                let found = check.window(&residual, &[2.5; MAX_ROTORS], &output(0.0, 0.0), false);
                assert_eq!(found.is_none(), explained, "{times} × rotor {rotor}: {found:?}");
            }
        }
        // A gain of the same size is not a loss.
        let mut check = calibrated(&config);
        let lift = [-1.5 * 2.5, 0.0, 0.0, 0.0];
        let found = check.window(&lift, &[2.5; MAX_ROTORS], &output(0.0, 0.0), false);
        assert!(matches!(found, Some(Obstacle::Unexplained { .. })), "{found:?}");
    }

    #[test]
    fn val_a_loss_of_more_than_all_is_said_to_be_none() {
        let config = config();
        let mut check = calibrated(&config);
        let mut window = |loss, low| check.window(&[0.0; 4], &[2.5; MAX_ROTORS], &output(loss, low), false);
        assert_eq!(window(2.6, 2.4), None, "all of it is inside of the interval");
        let found = window(147.0, 140.0).expect("5880 %");
        assert_eq!(
            found.to_string(),
            "the model does not explain the motion: it would take the loss of several times the thrust of rotor 3"
        );
        // It stays until the motion has been explained for half a second; then the calibration begins again.
        for _ in 0..7 {
            assert!(window(0.0, 0.0).is_some());
        }
        assert_eq!(window(0.0, 0.0), None);
    }
}
