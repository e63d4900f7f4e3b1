//! Where the vehicle is, sample by sample: in the air, on the ground, or upset. Detectors judge in the air only.
//!
//! * *Ground.* What carries the weight beside the rotors, as a share of it: s = (g − T cos φ cos θ / m − v̇_D) / g, both accelerations through
//!   the same low-pass ([`SUPPORT_TIME`]). In flight s is an error of the model; on the ground it is the share that the ground carries.
//!   A rotor that loses thrust makes s negative, so that a fault never looks like the ground.
//! * *Upset.* Tilt, and where it will be in [`LOOK_AHEAD`] at the present rates, beyond 70°: thrust curve and lag were found in calm air.
//!
//! A vehicle is in the air until the first samples say otherwise; nothing here knows what comes later.
//!
//! Limits: a vehicle that stands with its rotors carrying more than three quarters of the weight looks as if it flew after
//! [`LONGEST_LIGHT`]; one whose thrust is below 60 % of what the model says looks as if it stood.

use super::FdiConfig;
use super::nominal_thrust::{FirstOrderLag, static_thrust};
use crate::MAX_ROTORS;
use crate::frames::{BodyToNed, Vec3};
use crate::signals::Measurement;

/// Low-pass of accelerations and thrusts, s: a few blocks of a noisy velocity.
const SUPPORT_TIME: f32 = 0.25;
/// Share of the weight that something else carries, from which on the vehicle stands …
const STANDS_SUPPORT: f32 = 0.35;
/// … where its rotors carry less than this …
const STANDS_THRUST: f32 = 0.65;
/// … for so long, s.
const STANDS_TIME: f32 = 0.2;
/// … after an upset, s.
const STANDS_TIME_UPSET: f32 = 1.0;
/// It flies where the rotors carry more than this, and nothing else more than [`FLIES_SUPPORT`], for [`FLIES_TIME`].
const FLIES_THRUST: f32 = 0.75;
const FLIES_SUPPORT: f32 = 0.25;
const FLIES_TIME: f32 = 0.5;
/// Climb that shows that the ground is left, m/s; without it [`LONGEST_LIGHT`] is waited for.
const CLIMBS: f32 = 0.2;
/// Longest time on the ground with rotors that carry the vehicle, s.
const LONGEST_LIGHT: f32 = 5.0;
/// In the air before a calibration begins, s: ground effect and the transient of the take-off.
pub const CLEAR_TIME: f32 = 2.0;
/// Tilt beyond which the model is not judged by, rad: 70°, as for the parts of a log.
pub const MOST_TILT: f32 = 1.22;
/// Tilt of a flight that goes on, rad: 60°.
const GOOD_TILT: f32 = 1.05;
/// A tilt is foreseen at the present rates over this time, s.
const LOOK_AHEAD: f32 = 0.25;
/// A reading beyond the tilt for fewer samples is a spike.
const UPSET_SAMPLES: u16 = 5;
/// Upright for so long, an upset is over, s.
const UPRIGHT_TIME: f32 = 0.7;

/// Where a vehicle is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlightPhase {
    /// In the air.
    Air,
    /// On the ground.
    Ground {
        /// Share of the weight that the rotors carry.
        carried: f32,
    },
    /// In the air for less than [`CLEAR_TIME`].
    TakeOff,
    /// Beyond 70° of tilt, or on the way there or back.
    Upset {
        /// Largest so far, rad.
        tilt: f32,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Flight {
    Air,
    Ground,
    /// Samples left.
    TakeOff(u32),
    /// Samples upright so far; largest tilt, rad.
    Upset(u32, f32),
}

/// See the module.
#[derive(Clone, Debug)]
pub struct FlightWatch {
    config: FdiConfig,
    lag: FirstOrderLag<MAX_ROTORS>,
    thrust: [f32; MAX_ROTORS],
    /// Low-passed: speed down, m/s; acceleration that the rotors make, m/s²; thrust over weight.
    filtered: Option<[f32; 3]>,
    /// Samples so far.
    seen: u32,
    flight: Flight,
    /// Samples in a row: standing, flying, tilted.
    standing: u32,
    flying: u32,
    tilted: u16,
    climbed: bool,
    carried: f32,
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
        }
    }

    /// Begins again, after a gap.
    pub fn restart(&mut self) {
        *self = Self::new(&self.config);
    }

    /// Lagged thrust of every healthy rotor at the last sample, N.
    pub fn thrust(&self) -> &[f32; MAX_ROTORS] {
        &self.thrust
    }

    /// Takes in one sample; where the vehicle is. A sample that the engine would reject changes nothing.
    pub fn step(&mut self, input: &Measurement) -> FlightPhase {
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
            let tilt = libm::acosf(cosine.clamp(-1.0, 1.0));
            let ahead = tilt + LOOK_AHEAD * libm::sqrtf(p * p + q * q);
            self.move_on(support, speed, tilt, ahead);
        }
        match self.flight {
            Flight::Air => FlightPhase::Air,
            Flight::Ground => FlightPhase::Ground { carried: self.carried },
            Flight::TakeOff(_) => FlightPhase::TakeOff,
            Flight::Upset(_, tilt) => FlightPhase::Upset { tilt },
        }
    }

    fn move_on(&mut self, support: f32, speed_down: f32, tilt: f32, ahead: f32) {
        let samples = |seconds: f32| libm::roundf(seconds / self.config.period) as u32;
        let count = |condition: bool, so_far: u32| if condition { so_far.saturating_add(1) } else { 0 };
        self.seen = self.seen.saturating_add(1);
        // The low-passes begin with no acceleration.
        let settled = self.seen > samples(2.0 * SUPPORT_TIME);
        let stands = support > STANDS_SUPPORT && self.carried < STANDS_THRUST;
        self.standing = count(settled && stands, self.standing);
        self.flying = count(
            self.carried > FLIES_THRUST && support.abs() < FLIES_SUPPORT,
            self.flying,
        );
        self.climbed = self.flying > 0 && (self.climbed || speed_down < -CLIMBS);
        self.tilted = if ahead > MOST_TILT {
            self.tilted.saturating_add(1)
        } else {
            0
        };
        let upset = self.tilted >= UPSET_SAMPLES;
        // In a tumble speeds come late, and rotors are idle: only what lasts is the ground.
        let upset_now = matches!(self.flight, Flight::Upset(..));
        let stands = self.standing >= samples(if upset_now { STANDS_TIME_UPSET } else { STANDS_TIME });
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

/// No number that spoils a filter; the engine's own limits are the same or tighter.
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
