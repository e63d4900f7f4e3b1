//! Cascaded PID and control allocation (Table 5).
//!
//! ```text
//!  Reference ─▶ position ──▶ thrust and attitude ──▶ attitude ──▶ allocation ──▶ MotorCommand
//!                  ▲           setpoint  ▲              ▲             ▲
//!  NavState ───────┴─────────────────────┴──────────────┘             └── battery voltage (inverse map only)
//! ```
//!
//! One [`Controller::step`] per period, always with the same period: the outer loop turns the position error into an
//! acceleration, the acceleration into a collective thrust and a roll and pitch setpoint; the inner loop turns the
//! attitude error into an angular acceleration; the pseudo-inverse of the control effectiveness turns force and torques
//! into rotor thrusts, and these into duties.
//!
//! Choices that the paper leaves open: derivative action on measured velocity error and body rates; integrators updated after
//! their use; tilt limited to [`ControllerConfig::tilt_limit`]; no anti-windup, no feed-forward, no filter.
//!
//! Limits: no take-off or landing logic, no arming, no failsafe. Implausible inputs are not used: see
//! [`ControlOutput::input_rejected`]. Euler angles, hence not for flight near ±90° pitch.

mod allocation;
mod attitude;
pub mod lanes;
mod pid;
mod position;

#[cfg(test)]
mod closed_loop;

use crate::MAX_ROTORS;
use crate::elementary::{Elementary, Libm};
use crate::frames::{AttitudeSines, EulerAngles};
use crate::geometry::Geometry;
use crate::signals::{MotorCommand, NavState, Reference};
use crate::thrust_map::ThrustMap;
pub use pid::PidGains;
use pid::PidState;
use position::ThrustVector;

/// Inputs beyond this (m, m/s, rad, rad/s, V) are implausible and, like NaN, never reach the integrators.
pub const INPUT_LIMIT: f32 = 1e6;

/// Largest tilt limit, 80°: keeps the attitude setpoint away from the singularity of the Euler angles.
pub const MAX_TILT_LIMIT: f32 = 80.0 * core::f32::consts::PI / 180.0;

/// Largest control period, s.
pub const MAX_PERIOD: f32 = 1.0;

/// Largest gain: keeps the sums of a flight far from overflow with any inputs within [`INPUT_LIMIT`].
pub const MAX_GAIN: f32 = 1e6;

/// How a thrust is converted to a duty.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "one per controller, and nothing here allocates"
)]
pub enum ThrustToDuty {
    /// u = f / `full_thrust`, independent of the battery voltage; the z integrator absorbs the offset.
    Linear {
        /// Thrust at full duty, N: 12.0059 N in Table 5.
        full_thrust: f32,
    },
    /// Inverse of Eq. 19 at the measured battery voltage.
    InverseMap(ThrustMap),
}

/// Vehicle parameters and gains of a [`Controller`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerConfig {
    /// Rotor layout.
    pub geometry: Geometry,
    /// m, kg.
    pub mass: f32,
    /// J_x, J_y, J_z, kg·m², body.
    pub inertia_body: [f32; 3],
    /// g, m/s².
    pub gravity: f32,
    /// Time between two steps, s.
    pub period: f32,
    /// x, y, z of NED.
    pub position_gains: [PidGains; 3],
    /// Roll, pitch, yaw.
    pub attitude_gains: [PidGains; 3],
    /// Largest angle between the commanded thrust and the vertical, rad, up to [`MAX_TILT_LIMIT`]; 35° in the reference
    /// flights.
    pub tilt_limit: f32,
    /// How a thrust is converted to a duty.
    pub thrust_to_duty: ThrustToDuty,
}

impl ControllerConfig {
    /// Placeholder without a vehicle, to be filled with a configuration.
    pub const BLANK: Self = Self {
        geometry: Geometry::BLANK,
        mass: 0.0,
        inertia_body: [0.0; 3],
        gravity: 0.0,
        period: 0.0,
        position_gains: [PidGains::NONE; 3],
        attitude_gains: [PidGains::NONE; 3],
        tilt_limit: 0.0,
        thrust_to_duty: ThrustToDuty::Linear { full_thrust: 0.0 },
    };

    fn check(&self) -> Result<(), ControllerConfigError> {
        let positive = |value: f32, quantity| {
            if value > 0.0 && value.is_finite() {
                Ok(())
            } else {
                Err(ControllerConfigError::NotPositive { quantity })
            }
        };
        positive(self.mass, "mass")?;
        positive(self.inertia_body[0], "moment of inertia about x")?;
        positive(self.inertia_body[1], "moment of inertia about y")?;
        positive(self.inertia_body[2], "moment of inertia about z")?;
        positive(self.gravity, "gravity")?;
        positive(self.period, "control period")?;
        if self.period > MAX_PERIOD {
            return Err(ControllerConfigError::PeriodTooLong);
        }
        if !(self.tilt_limit > 0.0 && self.tilt_limit <= MAX_TILT_LIMIT) {
            return Err(ControllerConfigError::TiltLimitOutOfRange);
        }
        let loops = [
            (&self.position_gains, ["x", "y", "z"]),
            (&self.attitude_gains, ["roll", "pitch", "yaw"]),
        ];
        for (gains, names) in loops {
            for (k, axis) in gains.iter().zip(names) {
                for gain in [k.proportional, k.integral, k.derivative] {
                    if !(0.0..=MAX_GAIN).contains(&gain) {
                        return Err(ControllerConfigError::GainOutOfRange { axis });
                    }
                }
            }
        }

        let full_thrust = match self.thrust_to_duty {
            ThrustToDuty::Linear { full_thrust } => {
                positive(full_thrust, "thrust at full duty")?;
                full_thrust
            }
            // Depends on the voltage, which is not known yet.
            ThrustToDuty::InverseMap(_) => f32::INFINITY,
        };
        let hover_thrust = self.geometry.allocate([-self.mass * self.gravity, 0.0, 0.0, 0.0]);
        for rotor in 0..self.geometry.rotor_count() {
            if !(hover_thrust[rotor] > 0.0 && hover_thrust[rotor] < full_thrust) {
                return Err(ControllerConfigError::HoverOutOfReach { rotor });
            }
        }
        Ok(())
    }
}

/// Result of one control step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControlOutput {
    /// Duties to hold until the next step, fraction, always in \[0, 1\].
    pub command: MotorCommand,
    /// φ_ref, θ_ref, ψ_ref, rad.
    pub attitude_setpoint: EulerAngles,
    /// T, commanded collective thrust, N.
    pub collective_thrust: f32,
    /// Bit k (from 0) is set if the thrust demanded of rotor k was below 0 or above its thrust at full duty.
    pub saturated_rotors: u32,
    /// The state or the reference was implausible (NaN, infinite or beyond [`INPUT_LIMIT`]): the rest of this output repeats
    /// the last step's, and the integrators are unchanged.
    pub input_rejected: bool,
    /// The battery voltage was implausible and the last usable one replaced it. Only where [`ThrustToDuty::InverseMap`] needs
    /// a voltage; until there has been a usable one, the input is rejected.
    pub voltage_substituted: bool,
}

impl ControlOutput {
    const OFF: Self = Self {
        command: MotorCommand {
            duty: [0.0; MAX_ROTORS],
        },
        attitude_setpoint: EulerAngles {
            roll: 0.0,
            pitch: 0.0,
            yaw: 0.0,
        },
        collective_thrust: 0.0,
        saturated_rotors: 0,
        input_rejected: false,
        voltage_substituted: false,
    };
}

/// Cascaded PID controller with control allocation: position, attitude, pseudo-inverse.
///
/// ```
/// use rotortwin_flight_core::control::{Controller, ControllerConfig, PidGains, ThrustToDuty};
/// use rotortwin_flight_core::geometry::Geometry;
/// use rotortwin_flight_core::signals::{NavState, Reference};
///
/// let slow = PidGains { proportional: 4.98, integral: 2.08, derivative: 3.9 };
/// let fast = PidGains { proportional: 242.0, integral: 720.0, derivative: 27.0 };
/// let mut controller = Controller::new(ControllerConfig {
///     geometry: Geometry::regular(6, 0.275, 0.016, core::f32::consts::FRAC_PI_6)?,
///     mass: 1.55,
///     inertia_body: [0.0266, 0.0266, 0.0498],
///     gravity: 9.81,
///     period: 0.0025,
///     position_gains: [slow; 3],
///     attitude_gains: [fast, fast, slow],
///     tilt_limit: 0.61,
///     thrust_to_duty: ThrustToDuty::Linear { full_thrust: 12.0059 },
/// })?;
/// controller.trim(0.38, 16.3);
/// let output = controller.step(&NavState::default(), &Reference::default(), 16.3);
/// assert!((output.command.duty[0] - 0.38).abs() < 1e-6);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Controller {
    cfg: ControllerConfig,
    tilt_limit_tan: f32,
    position: PidState,
    attitude: PidState,
    last_output: ControlOutput,
    /// Last usable battery voltage, V; `None` before the first, and with a map that needs none.
    last_voltage: Option<f32>,
}

impl Controller {
    /// A controller without a vehicle: its commands are meaningless before [`Controller::configure`]. All bits are 0, so that it takes no
    /// space in a board's image.
    pub const BLANK: Self = Self {
        cfg: ControllerConfig::BLANK,
        tilt_limit_tan: 0.0,
        position: PidState::ZERO,
        attitude: PidState::ZERO,
        last_output: ControlOutput::OFF,
        last_voltage: None,
    };

    /// A controller at rest: integrators zero, motors off until the first accepted step.
    ///
    /// Returns a [`ControllerConfigError`] if the configuration is invalid.
    pub fn new(cfg: ControllerConfig) -> Result<Self, ControllerConfigError> {
        let mut controller = Self::BLANK;
        controller.configure(|own| {
            *own = cfg;
            Ok::<(), ControllerConfigError>(())
        })?;
        Ok(controller)
    }

    /// [`Controller::new`] in place, with the configuration that `fill` writes: a board has no room for a second one. `fill` must set every
    /// field, as the fields still hold the previous configuration. Do not use a controller whose configuration was rejected.
    pub fn configure<E: From<ControllerConfigError>>(
        &mut self,
        fill: impl FnOnce(&mut ControllerConfig) -> Result<(), E>,
    ) -> Result<(), E> {
        fill(&mut self.cfg)?;
        self.cfg.check()?;
        // Destructured, so that no field is forgotten.
        let Self {
            cfg,
            tilt_limit_tan,
            position,
            attitude,
            last_output,
            last_voltage,
        } = self;
        *tilt_limit_tan = libm::tan(f64::from(cfg.tilt_limit)) as f32;
        *position = PidState::ZERO;
        *attitude = PidState::ZERO;
        *last_output = ControlOutput::OFF;
        *last_voltage = None;
        Ok(())
    }

    /// Configuration passed to [`Controller::new`].
    #[inline]
    pub const fn config(&self) -> &ControllerConfig {
        &self.cfg
    }

    /// Presets the z integrator for a start in trimmed hover: level, at the reference, it commands `hover_duty` on
    /// average.
    ///
    /// Ki ∫e_z = g − T/m, where T is the total thrust that the controller's own map gives at that duty
    ///
    /// * `hover_duty`: fraction   * `battery_voltage`: V, used by [`ThrustToDuty::InverseMap`] only
    ///
    /// Also sets the command held if the very first input is rejected. Leaves the integrator unchanged if its gain is zero,
    /// and does nothing at all if a value is unusable (NaN, duty outside \[0, 1\], voltage too low).
    pub fn trim(&mut self, hover_duty: f32, battery_voltage: f32) {
        if !(0.0..=1.0).contains(&hover_duty) {
            return;
        }
        let rotor_count = self.cfg.geometry.rotor_count();
        let thrust = match &self.cfg.thrust_to_duty {
            ThrustToDuty::Linear { full_thrust } => hover_duty * full_thrust,
            ThrustToDuty::InverseMap(map) if is_voltage_usable(map, battery_voltage) => {
                self.last_voltage = Some(battery_voltage);
                map.thrust(hover_duty, battery_voltage)
            }
            ThrustToDuty::InverseMap(_) => return,
        };
        let collective_thrust = rotor_count as f32 * thrust;
        let gain = self.cfg.position_gains[2].integral;
        if gain > 0.0 {
            self.position.integral[2] = (self.cfg.gravity - collective_thrust / self.cfg.mass) / gain;
        }
        self.last_output = ControlOutput {
            collective_thrust,
            ..ControlOutput::default()
        };
        self.last_output.command.duty[..rotor_count].fill(hover_duty);
    }

    /// One control step; hold the command for one period.
    ///
    /// * `nav`: sensed state   * `reference`: what to follow   * `battery_voltage`: V, used by
    ///   [`ThrustToDuty::InverseMap`] only
    ///
    /// Never fails and never returns a duty outside \[0, 1\]; for implausible inputs see [`ControlOutput::input_rejected`].
    #[inline]
    pub fn step(&mut self, nav: &NavState, reference: &Reference, battery_voltage: f32) -> ControlOutput {
        let voltage_substituted = match &self.cfg.thrust_to_duty {
            ThrustToDuty::InverseMap(map) if is_voltage_usable(map, battery_voltage) => {
                self.last_voltage = Some(battery_voltage);
                false
            }
            ThrustToDuty::InverseMap(_) => true,
            ThrustToDuty::Linear { .. } => false,
        };
        let voltage_missing = voltage_substituted && self.last_voltage.is_none();
        if voltage_missing || !is_plausible(nav, reference) {
            return ControlOutput {
                input_rejected: true,
                ..self.last_output
            };
        }
        let cfg = &self.cfg;
        let sines = AttitudeSines::new(nav.attitude, &mut Libm);
        let loops = (&mut self.position, &mut self.attitude);
        let (vector, wrench) = control_law(cfg, self.tilt_limit_tan, loops, nav, &sines, reference, &mut Libm);
        // The linear map never stores a last voltage and does not read this one.
        let voltage = self.last_voltage.unwrap_or(battery_voltage);
        let (command, saturated_rotors) = allocation::duties(&cfg.geometry, &cfg.thrust_to_duty, wrench, voltage);
        self.last_output = ControlOutput {
            command,
            attitude_setpoint: vector.attitude_setpoint,
            collective_thrust: vector.collective_thrust,
            saturated_rotors,
            input_rejected: false,
            voltage_substituted,
        };
        self.last_output
    }
}

/// Both loops: thrust and attitude setpoints, and the wrench (Fz, Mx, My, Mz) that realises them, N and N·m.
#[inline(always)]
fn control_law(
    cfg: &ControllerConfig,
    tilt_limit_tan: f32,
    (position, attitude): (&mut PidState, &mut PidState),
    nav: &NavState,
    sines: &AttitudeSines,
    reference: &Reference,
    functions: &mut impl Elementary,
) -> (ThrustVector, [f32; 4]) {
    let acceleration = position::acceleration_setpoint(position, cfg, nav, reference);
    let vector = position::thrust_vector(cfg, tilt_limit_tan, acceleration, sines, reference.yaw, functions);
    let alpha = attitude::angular_acceleration_setpoint(attitude, cfg, nav, &vector.attitude_setpoint, functions);
    let wrench = [
        -vector.collective_thrust,
        cfg.inertia_body[0] * alpha[0],
        cfg.inertia_body[1] * alpha[1],
        cfg.inertia_body[2] * alpha[2],
    ];
    (vector, wrench)
}

/// True for a voltage at which the map gives any thrust. A zero, as from a failed sensor, would demand full duty.
#[inline]
fn is_voltage_usable(map: &ThrustMap, battery_voltage: f32) -> bool {
    battery_voltage > map.voltage_offset() && battery_voltage <= INPUT_LIMIT
}

/// True if every component is finite and within [`INPUT_LIMIT`].
#[inline(always)]
fn is_plausible(nav: &NavState, reference: &Reference) -> bool {
    // NaN compares false; no short circuit, so that the comparisons need no branches.
    let triple = |v: [f32; 3]| (v[0].abs() <= INPUT_LIMIT) & (v[1].abs() <= INPUT_LIMIT) & (v[2].abs() <= INPUT_LIMIT);
    let angles = [nav.attitude.roll, nav.attitude.pitch, nav.attitude.yaw];
    triple(nav.position_ned.to_array())
        & triple(nav.velocity_ned.to_array())
        & triple(angles)
        & triple(nav.body_rates.to_array())
        & triple(reference.position_ned.to_array())
        & triple(reference.velocity_ned.to_array())
        & (reference.yaw.abs() <= INPUT_LIMIT)
}

/// Why a controller configuration is rejected. Rotor indices count from 0; the text counts from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControllerConfigError {
    /// A quantity must be above zero and finite.
    NotPositive {
        /// Human-readable name.
        quantity: &'static str,
    },
    /// Above [`MAX_PERIOD`].
    PeriodTooLong,
    /// Not above 0, or above [`MAX_TILT_LIMIT`].
    TiltLimitOutOfRange,
    /// A gain is negative, NaN or above [`MAX_GAIN`].
    GainOutOfRange {
        /// Human-readable name.
        axis: &'static str,
    },
    /// In hover the allocation demands zero, negative or more than full-duty thrust from a rotor.
    HoverOutOfReach {
        /// Zero-based.
        rotor: usize,
    },
}

impl core::fmt::Display for ControllerConfigError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::NotPositive { quantity } => {
                write!(out, "the {quantity} must be a positive, finite number")
            }
            Self::PeriodTooLong => {
                write!(out, "the control period must be {MAX_PERIOD} s or less")
            }
            Self::TiltLimitOutOfRange => out.write_str("the tilt limit must be above 0 and at most 80 degrees"),
            Self::GainOutOfRange { axis } => {
                write!(out, "the gains of the {axis} axis must be numbers from 0 to {MAX_GAIN}")
            }
            Self::HoverOutOfReach { rotor } => {
                write!(out, "rotor {} cannot give the thrust that hover asks of it", rotor + 1)
            }
        }
    }
}

impl core::error::Error for ControllerConfigError {}

const _: () = assert!(MAX_ROTORS <= 32, "saturated_rotors has a bit for every rotor");
