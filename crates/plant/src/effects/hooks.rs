//! The hooks of an effect: where the chain from command to reading lets effects act.
//!
//! ```text
//!  duty ─▶ command ─▶ Eq. 19 ─▶ static_lift ─▶ lag ─▶ rotor_thrust ─▶ wrench ─▶ rigid body ─▶ readings
//!            ▲ constants: dead zone, delay, gains …   constants: tilt, centre of mass …   ▲ constants: biases, latencies …
//!                              wind ─▶ air velocity
//! ```
//!
//! The same hooks serve two callers: the simulator, with the true state, and the twin, with the measured kinematics of a log. They
//! allocate nothing and cost about 100 ns a step, because the twin runs a pass over the log for each parameter.

use super::constants::Constants;
use super::readings::Readings;
use super::wrench::Wrench;
use crate::vector::Vector3;

/// What the vehicle is doing at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Moment<'a> {
    /// Since the start, s.
    pub time_s: f64,
    /// Length of the step, s.
    pub step_s: f64,
    /// Centre of mass, m, NED.
    pub position_ned: Vector3,
    /// m/s, NED.
    pub velocity_ned: Vector3,
    /// v_a = Rᵀ(v − w), m/s, body.
    pub air_velocity_body: Vector3,
    /// ω, rad/s, body.
    pub body_rates: Vector3,
    /// ω̇, rad/s², body. The simulator gives that of the instant before.
    pub angular_acceleration: Vector3,
    /// Rᵀ(v̇ − g e₃), m/s², body. The simulator gives that of the instant before.
    pub specific_force: Vector3,
    /// R of Eq. 2, rows first.
    pub ned_from_body: [Vector3; 3],
    /// z of the rotor plane over the ground, m; infinite where no ground is in reach.
    pub height_above_ground: f64,
    /// Thrust of each rotor after the lag, N.
    pub rotor_thrust: &'a [f64],
    /// Ω_i/Ω_h = √(f_i/f_h) of each rotor.
    pub rotor_speed_ratio: &'a [f64],
    /// Rate of the speed ratio, 1/s.
    pub rotor_speed_rate: &'a [f64],
    /// Duty commanded to each rotor, fraction, as the controller sent it.
    pub duty: &'a [f64],
    /// V at the terminals.
    pub battery_voltage: f64,
    /// A, discharge positive.
    pub battery_current: f64,
    /// The vehicle with all effects on its constants.
    pub constants: &'a Constants,
}

impl Moment<'_> {
    /// A NED vector in body axes.
    #[inline]
    pub fn body_from_ned(&self, v: Vector3) -> Vector3 {
        let r = &self.ned_from_body;
        [0, 1, 2].map(|i| r[0][i] * v[0] + r[1][i] * v[1] + r[2][i] * v[2])
    }

    /// v_i = v_a + ω × l_i: air velocity at rotor `i`, m/s, body.
    #[inline]
    pub fn rotor_air_velocity(&self, i: usize) -> Vector3 {
        let [p, q, r] = self.body_rates;
        let [x, y, z] = self.constants.rotor_position_body[i];
        let v = self.air_velocity_body;
        [v[0] + q * z - r * y, v[1] + r * x - p * z, v[2] + p * y - q * x]
    }

    /// Σ Ω_i/(n Ω_h): 1 in hover.
    #[inline]
    pub fn mean_speed_ratio(&self) -> f64 {
        self.rotor_speed_ratio.iter().sum::<f64>() / self.rotor_speed_ratio.len() as f64
    }
}

/// The hooks that an effect uses, so that callers skip the others.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Hooks(u16);

impl Hooks {
    /// None.
    pub const NONE: Self = Self(0);
    /// [`ActiveEffect::constants`].
    pub const CONSTANTS: Self = Self(1);
    /// The constants change with time: ask again at every step.
    pub const VARYING_CONSTANTS: Self = Self(1 | 2);
    /// [`ActiveEffect::wind`].
    pub const WIND: Self = Self(4);
    /// [`ActiveEffect::command`].
    pub const COMMAND: Self = Self(8);
    /// [`ActiveEffect::static_lift`].
    pub const STATIC_LIFT: Self = Self(16);
    /// [`ActiveEffect::rotor_thrust`].
    pub const ROTOR_THRUST: Self = Self(32);
    /// [`ActiveEffect::wrench`].
    pub const WRENCH: Self = Self(64);
    /// [`ActiveEffect::readings`].
    pub const READINGS: Self = Self(128);
    /// [`ActiveEffect::advance`].
    pub const ADVANCE: Self = Self(256);

    /// Both.
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// True if every hook of `other` is used.
    pub const fn uses(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// An effect at work. Every hook does nothing unless the effect says otherwise.
pub trait ActiveEffect: std::fmt::Debug + Send + Sync {
    /// The hooks in use; the others are not called.
    fn hooks(&self) -> Hooks;
    /// A copy with the same state.
    fn boxed_clone(&self) -> Box<dyn ActiveEffect>;
    /// Changes constants of the vehicle. Called when the effect sets in, and at every step for
    /// [`Hooks::VARYING_CONSTANTS`]; always on a fresh copy of the nominal vehicle, after the effects before it.
    fn constants(&self, _constants: &mut Constants) {}
    /// Adds to the wind over the coming step, m/s, NED.
    fn wind(&mut self, _at: &Moment<'_>, _wind_ned: &mut Vector3) {}
    /// Changes the duties, fractions, on their way to the rotors.
    fn command(&mut self, _at: &Moment<'_>, _duty: &mut [f64]) {}
    /// Changes the static lift, N, after Eq. 19 and before the lag.
    fn static_lift(&mut self, _at: &Moment<'_>, _lift: &mut [f64]) {}
    /// Changes the thrust, N, after the lag, as it acts on the body.
    fn rotor_thrust(&mut self, _at: &Moment<'_>, _thrust: &mut [f64]) {}
    /// Adds to force and torque on the body. Called once or several times a step: own states change in `advance` only.
    fn wrench(&mut self, _at: &Moment<'_>, _wrench: &mut Wrench) {}
    /// Changes the readings of the sensors, before their noise.
    fn readings(&mut self, _at: &Moment<'_>, _readings: &mut Readings) {}
    /// Moves own states over one step that begins at `at`.
    fn advance(&mut self, _at: &Moment<'_>, _step_s: f64) {}
}

impl Clone for Box<dyn ActiveEffect> {
    fn clone(&self) -> Self {
        self.boxed_clone()
    }
}
