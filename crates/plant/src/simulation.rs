//! The simulation: one flight, stepped at 400 Hz.
//!
//! ```text
//!  loop:  sense() ─▶ SensedSample of step k ─▶ (controller) ─▶ advance(command) ─▶ step k + 1
//! ```
//!
//! A command is held over the step and acts immediately. Faults start at the step nearest to their time. Rigid body,
//! rotor thrusts and charge are integrated together by the classical Runge–Kutta method with one substep of 2.5 ms by
//! default, the battery voltage being solved at every stage; wind and disturbances are held over the step.
//!
//! Limits: no gyroscopic torque of the rotors, no link or computation delay; effects lift some of them, in a step of their own
//! (`effect_flight.rs`). A ground that carries the vehicle (`simulation/ground.rs`) has a step of its own as well.
//! Neither changes the bits or the speed of this one.

mod ground;
#[cfg(test)]
mod ground_tests;
#[cfg(test)]
mod motor_tests;
pub mod parts;

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::signals::{MotorCommand, NavState, Reference};
use serde::Serialize;

use crate::body::contact::Contact;
use crate::body::dynamics::{DynamicState, Dynamics};
use crate::body::environment::Environment;
use crate::body::rigid_body::{Quaternion, RigidBody, RigidBodyState};
use crate::config::SimulationConfig;
use crate::effect_flight::{EffectFlight, Loads, Plant};
use crate::effects::{Constants, EffectInstance, EffectSet};
use crate::error::{Refusal, SimulationError};
use crate::motors::Motors;
use crate::powertrain::battery::{Battery, BatteryOutput};
use crate::powertrain::faults::FaultSchedule;
use crate::powertrain::held::sum_of_powers;
use crate::powertrain::rotors::{Powertrain, RotorTruth};
use crate::sensing::readings::Readings;
use crate::sensing::sensors::{Accelerometer, SensorModel, SensorSuite};
use crate::state::PlantState;
use crate::trajectory::{ReferenceGenerator, ReferencePoint};
use crate::trim::trim;
use crate::vector::Vector3;
use crate::vehicle::mismatch::{MismatchDraw, Size};
use crate::{STEP_NS, STEP_S};

/// Input of controller and detector at the start of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SensedSample {
    /// Step number, from 0.
    pub step: u64,
    /// Simulated time of the step's start, ns.
    pub sim_time_ns: u64,
    /// Sensed state.
    pub nav: NavState,
    /// What to follow.
    pub reference: Reference,
    /// Sensed V_batt, V.
    pub battery_voltage: f32,
    /// Sensors whose sample was lost and whose last value is repeated: bit 0 position, 1 velocity, 2 attitude, 3 body rates,
    /// 4 battery voltage.
    pub stale_sensors: u32,
    /// Accelerometer, m/s², body: specific force; only after [`Simulation::record_accelerometer`].
    pub specific_force_m_s2: Option<[f32; 3]>,
}

/// The truth at the start of a step. Entries past the rotor count are 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct TruthSample {
    /// Step number, from 0.
    pub step: u64,
    /// Simulated time, ns.
    pub sim_time_ns: u64,
    /// p_F of the centre of mass, m, NED.
    pub position_ned_m: [f64; 3],
    /// ṗ_F, m/s, NED.
    pub velocity_ned_m_s: [f64; 3],
    /// η = (φ, θ, ψ), rad.
    pub attitude_rad: [f64; 3],
    /// ω, rad/s, body.
    pub body_rates_rad_s: [f64; 3],
    /// f_i, N.
    pub rotor_thrust_n: [f64; MAX_ROTORS],
    /// SoC, fraction.
    pub state_of_charge: f64,
    /// V_oc, V.
    pub open_circuit_voltage_v: f64,
    /// V_batt, V, without sensor error.
    pub battery_voltage_v: f64,
    /// i_batt, A, discharge positive.
    pub battery_current_a: f64,
    /// w, m/s, NED, over the coming step.
    pub wind_ned_m_s: [f64; 3],
    /// Rotors that are not healthy over the coming step: bit 0 is rotor 1.
    pub faulty_rotors: u32,
    /// 0 healthy, the rotor from 1 if exactly one is faulty, −1 if several are.
    pub fault_label: i32,
    /// Mounted blade: 0 nominal, otherwise 1 + its place in the alphabetical order of names.
    pub rotor_blade: [i32; MAX_ROTORS],
    /// Lost share of the thrust, fraction; 1 is a lost rotor, negative a rotor that gives more.
    pub rotor_thrust_loss: [f64; MAX_ROTORS],
}

impl TruthSample {
    /// Position, velocity, attitude and body rates, one after the other.
    #[inline]
    pub fn motion(&self) -> [f64; 12] {
        let mut motion = [0.0; 12];
        for (part, values) in motion.as_chunks_mut::<3>().0.iter_mut().zip([
            self.position_ned_m,
            self.velocity_ned_m_s,
            self.attitude_rad,
            self.body_rates_rad_s,
        ]) {
            *part = values;
        }
        motion
    }
}

/// The flight's effects on the vehicle that this flight drew; `None` for a flight without effects.
fn effects(
    config: &SimulationConfig,
    mismatch: &MismatchDraw,
    extra_linear_drag: f64,
    seed: u64,
) -> Result<Option<Box<EffectFlight>>, Refusal> {
    // The document's inertia and drag of the rotors act through the same hooks; what remains without a load has products of inertia.
    let rotors = &config.vehicle.rotors;
    let plain =
        rotors.reaction_s == 0.0 && rotors.drag_kg_s == 0.0 && rotors.motor.is_none() && config.loads.is_empty();
    if config.effects.is_empty() && plain {
        return Ok(None);
    }
    let mut constants = Constants::nominal(&config.vehicle);
    constants.mass_kg *= mismatch.mass;
    for axis in 0..3 {
        constants.inertia_body_kg_m2[axis][axis] *= mismatch.inertia[axis];
    }
    constants.centre_of_mass_m = mismatch.centre_of_mass_m;
    constants.thrust_lag_up_s *= mismatch.thrust_lag;
    constants.thrust_lag_down_s *= mismatch.thrust_lag;
    constants.linear_drag_kg_s += extra_linear_drag;
    for i in 0..constants.rotor_count {
        constants.moment_ratio_m[i] *= mismatch.moment_ratio;
        constants.rotor_gain[i] = mismatch.rotor_gain[i];
        constants.rotor_bias_n[i] = mismatch.rotor_bias_n[i];
    }
    let motors = Motors::new(&config.vehicle, &config.nominal_blade)?;
    if let Some(motors) = &motors {
        constants.hover_rotor_speed_rad_s = motors.hover_speed(constants.hover_thrust_n);
        refuse_other_lags(config, &constants, seed)?;
    }
    let set = EffectSet::new(&config.catalogue, &config.effects, &constants, seed)?;
    let loads = Loads::new(&config.loads, &constants);
    for (base, drop) in loads.bases().zip(config.loads.drops()) {
        EffectSet::new(&config.catalogue, &config.effects, base, seed)
            .map_err(|refusal| Refusal::new(format!("load_drop[{}]", drop.index), refusal.reason))?;
    }
    let ground = config.ground_down_m.unwrap_or(f64::INFINITY);
    Ok(Some(Box::new(EffectFlight::new(set, loads, motors, ground))))
}

/// Rejects effects on quantities that a motor does not have: a lag that differs with its direction, or one of the
/// thrust.
fn refuse_other_lags(config: &SimulationConfig, constants: &Constants, seed: u64) -> Result<(), Refusal> {
    for (index, effect) in config.effects.iter().enumerate() {
        let alone = EffectInstance {
            onset_s: None,
            ..effect.clone()
        };
        // One that needs another is refused or accepted with it below.
        let Ok(set) = EffectSet::new(&config.catalogue, &[alone], constants, seed) else {
            continue;
        };
        let changed = set.constants();
        if changed.thrust_lag_up_s != changed.thrust_lag_down_s || changed.speed_domain_share != 0.0 {
            let reason = format!(
                "`{}` changes the lag of Eq. 19, which `rotors.motor` of the vehicle replaces: expected a vehicle without it, or `motor-time-constant`",
                effect.effect
            );
            return Err(Refusal::new(format!("effect[{index}]"), reason));
        }
    }
    Ok(())
}

/// One flight.
#[derive(Debug, Clone)]
pub struct Simulation {
    rotor_count: usize,
    duration_steps: u64,
    substeps: u32,
    hover_duty: f32,
    mismatch: MismatchDraw,
    pub(crate) body: RigidBody,
    pub(crate) powertrain: Powertrain,
    pub(crate) battery: Battery,
    pub(crate) environment: Environment,
    faults: FaultSchedule,
    pub(crate) reference: ReferenceGenerator,
    pub(crate) sensors: SensorSuite,
    pub(crate) state: PlantState,
    truth: TruthSample,
    sensed: SensedSample,
    /// Step to which `sensed` belongs, if it has been measured.
    sensed_step: Option<u64>,
    accelerometer: Option<Accelerometer>,
    /// The step with effects, if the scenario has any.
    effects: Option<Box<EffectFlight>>,
    /// The ground, if it carries the vehicle.
    contact: Option<Box<Contact>>,
    parts: parts::Parts,
}

impl Simulation {
    /// The flight of `config` with the random numbers of `seed`, at step 0.
    ///
    /// # Errors
    /// The nominal vehicle cannot hover, it has no feet or does not stand, or the effects leave no vehicle of the one that this seed draws.
    pub fn new(config: &SimulationConfig, seed: u64) -> Result<Self, Refusal> {
        let vehicle = &config.vehicle;
        let magnitudes = config.mismatch.magnitudes(Size::of(vehicle));
        let mismatch = MismatchDraw::new(&magnitudes, seed);
        let trim = trim(config)?;
        let placements = vehicle.rotors.layout.placements();
        let rotors = placements
            .iter()
            .enumerate()
            .map(|(i, placement)| RotorTruth {
                blade: config.nominal_blade,
                gain: mismatch.rotor_gain[i],
                bias: mismatch.rotor_bias_n[i],
                thrust_loss: 0.0,
                moment_ratio_change: 0.0,
                torque_arm: placement.torque_arm(mismatch.centre_of_mass_m, mismatch.moment_ratio),
            })
            .collect();
        let body = &vehicle.body;
        let inertia = [0, 1, 2].map(|i| body.inertia_body_kg_m2[i] * mismatch.inertia[i]);
        let (position_ned, yaw) = config.trajectory.pose(0.0);
        let mut simulation = Self {
            rotor_count: placements.len(),
            duration_steps: config.duration_steps,
            substeps: config.integrator_substeps,
            hover_duty: trim.duty as f32,
            body: RigidBody::new(
                body.mass_kg * mismatch.mass,
                inertia,
                body.gravity_m_s2,
                body.linear_drag_kg_s + magnitudes.linear_drag_kg_s,
                body.angular_drag_nms,
            ),
            powertrain: Powertrain::new(rotors, vehicle.rotors.thrust_lag_s * mismatch.thrust_lag),
            battery: Battery::new(&vehicle.battery),
            environment: Environment::new(config.wind.as_ref(), magnitudes.disturbance(), seed),
            faults: FaultSchedule::new(config.faults.clone()),
            reference: ReferenceGenerator::new(config.trajectory.clone()),
            sensors: SensorSuite::new(
                &config.sensors,
                magnitudes.battery_voltage_noise_v,
                mismatch.battery_voltage_bias_v,
                &config.sensor_faults,
                seed,
            ),
            effects: effects(config, &mismatch, magnitudes.linear_drag_kg_s, seed)?,
            accelerometer: None,
            contact: ground::contact(config, &mismatch)?,
            parts: parts::Parts::default(),
            mismatch,
            state: PlantState {
                body: RigidBodyState {
                    position_ned,
                    velocity_ned: [0.0; 3],
                    ned_from_body: Quaternion::from_euler([0.0, 0.0, yaw]),
                    body_rates: [0.0; 3],
                },
                thrust: if config.starts_trimmed {
                    trim.thrust
                } else {
                    [0.0; MAX_ROTORS]
                },
                state_of_charge: config.state_of_charge,
            },
            truth: TruthSample::default(),
            sensed: SensedSample::default(),
            sensed_step: None,
        };
        simulation.faults.apply(0, &mut simulation.powertrain);
        simulation.record_faults();
        if let Some(model) = config.ground_contact.as_ref().filter(|_| config.starts_on_ground) {
            simulation.stand(model, position_ned, yaw)?;
        }
        if let Some(effects) = &mut simulation.effects {
            let plant = Plant {
                rotors: simulation.powertrain.rotors(),
                battery: &simulation.battery,
                around: simulation.environment.now(),
                contact: simulation.contact.as_deref(),
            };
            let duty = if config.starts_trimmed { trim.duty } else { 0.0 };
            effects.begin(&simulation.state, &plant, duty);
        }
        simulation.record_truth(0);
        Ok(simulation)
    }

    /// From now on samples carry the accelerometer, with a noise stream of its own: nothing else of the flight changes.
    pub fn record_accelerometer(&mut self, sensors: &SensorModel, seed: u64) {
        self.accelerometer = Some(Accelerometer::new(sensors, seed));
    }

    /// Specific force at the centre of mass, m/s², body, as a perfect accelerometer there has it; where a load has been dropped, at the
    /// place that was the centre of mass with it.
    pub fn specific_force(&self) -> Vector3 {
        if let Some(effects) = &self.effects {
            return effects.specific_force(self.state.body.body_rates);
        }
        let (total, torque) = self.powertrain.held().wrench(&self.state.thrust);
        let mut rate = self.body.rate(&self.state.body, total, torque, &self.around()).velocity;
        rate[2] -= self.body.gravity();
        self.state.body.ned_from_body.body_from_ned(rate)
    }

    /// Sensor readings at the start of the current step. Calling it again within the step gives the same sample.
    pub fn sense(&mut self) -> SensedSample {
        let step = self.truth.step;
        if self.sensed_step != Some(step) {
            let truth = &self.truth;
            let readings: Readings;
            let specific_force;
            if let Some(effects) = &mut self.effects {
                let says = effects.sense(&self.state);
                readings = [
                    says.position_ned,
                    says.velocity_ned,
                    says.attitude,
                    says.body_rates,
                    [says.battery_voltage, 0.0, 0.0],
                ];
                specific_force = Some(says.specific_force);
            } else {
                readings = [
                    truth.position_ned_m,
                    truth.velocity_ned_m_s,
                    truth.attitude_rad,
                    truth.body_rates_rad_s,
                    [truth.battery_voltage_v, 0.0, 0.0],
                ];
                specific_force = self.accelerometer.is_some().then(|| self.specific_force());
            }
            let (nav, battery_voltage, stale_sensors) = self.sensors.measure(step, &readings);
            let accelerometer = self.accelerometer.as_mut().zip(specific_force);
            self.sensed = SensedSample {
                step,
                sim_time_ns: self.truth.sim_time_ns,
                nav,
                reference: self.reference.now,
                battery_voltage,
                stale_sensors,
                specific_force_m_s2: accelerometer.map(|(sensor, force)| sensor.measure(force)),
            };
            self.sensed_step = Some(step);
        }
        self.sensed
    }

    /// The truth at the start of the current step.
    pub fn truth(&self) -> &TruthSample {
        &self.truth
    }

    /// Holds `command` over the current step and moves to the next. Duties outside \[0, 1\] are limited to it, as an ESC does.
    ///
    /// # Errors
    /// See [`SimulationError`]; the simulation then stays where it was found wrong and must not be used further.
    pub fn advance(&mut self, command: &MotorCommand) -> Result<(), SimulationError> {
        self.advance_duty(&command.duty.map(f64::from))
    }

    /// [`Simulation::advance`] with duties in f64.
    pub(crate) fn advance_duty(&mut self, duty: &[f64; MAX_ROTORS]) -> Result<(), SimulationError> {
        let step = self.truth.step;
        if self.done() {
            return Err(SimulationError::FlightOver { step });
        }
        let limited = self.limited(duty)?;
        // Every step is sensed, even if no reading is requested: the noise of a step belongs to that step.
        self.sense();
        if let Some(effects) = &mut self.effects {
            let plant = Plant {
                rotors: self.powertrain.rotors(),
                battery: &self.battery,
                around: self.environment.now(),
                contact: None,
            };
            let time_s = step as f64 * STEP_S;
            let substeps = if self.contact.is_some() {
                self.substeps.div_ceil(crate::PARTS_PER_STEP) * crate::PARTS_PER_STEP
            } else {
                self.substeps
            };
            let contact = self.contact.as_deref_mut();
            effects.advance(time_s, &mut self.state, &plant, contact, &limited, substeps);
        } else if self.contact.is_some() {
            self.powertrain.hold(&limited);
            let parts = self.ground_parts();
            self.integrate_parts(parts, STEP_S / f64::from(parts));
        } else {
            self.powertrain.hold(&limited);
            match self.rotor_count {
                ..=4 => self.integrate::<4>(),
                5..=6 => self.integrate::<6>(),
                7..=8 => self.integrate::<8>(),
                _ => self.integrate::<MAX_ROTORS>(),
            }
        }
        self.complete_step(step + 1)
    }

    /// The ESCs' output for the duties: limited to \[0, 1\], 0 without a battery.
    #[inline]
    fn limited(&self, duty: &[f64; MAX_ROTORS]) -> Result<[f64; MAX_ROTORS], SimulationError> {
        let mut limited = [0.0; MAX_ROTORS];
        for rotor in 0..self.rotor_count {
            if !duty[rotor].is_finite() {
                return Err(SimulationError::NonFiniteDuty {
                    step: self.truth.step,
                    rotor: rotor + 1,
                });
            }
            limited[rotor] = duty[rotor].clamp(0.0, 1.0);
        }
        if !self.battery.is_connected() {
            limited = [0.0; MAX_ROTORS];
        }
        Ok(limited)
    }

    /// Drops the loads of `step`.
    #[inline]
    fn drop_loads(&mut self, step: u64) {
        let Some(effects) = &mut self.effects else { return };
        let Some(shift) = effects.drop_loads(step, &mut self.state) else {
            return;
        };
        if let Some(contact) = &mut self.contact {
            contact.move_centre(shift);
        }
        let air = Plant {
            rotors: self.powertrain.rotors(),
            battery: &self.battery,
            around: self.environment.now(),
            contact: None,
        };
        effects.observe_on(&self.state, &air, self.contact.as_deref());
    }

    #[inline]
    fn cut_off_if_empty(&mut self) {
        if self.state.state_of_charge <= 0.0 {
            self.state.state_of_charge = 0.0;
            self.battery.disconnect();
        }
    }

    /// Adopts the integrated state as that of `step`, and brings everything else there.
    #[inline]
    fn complete_step(&mut self, step: u64) -> Result<(), SimulationError> {
        self.check_state(step)?;
        self.cut_off_if_empty();
        self.environment.advance();
        if self.faults.apply(step, &mut self.powertrain) {
            self.record_faults();
        }
        self.drop_loads(step);
        self.reference.advance(step);
        self.record_truth(step);
        Ok(())
    }

    /// True once the planned duration has been flown.
    pub fn done(&self) -> bool {
        self.truth.step >= self.duration_steps
    }

    /// Current step, from 0.
    pub fn step(&self) -> u64 {
        self.truth.step
    }

    /// Rotors of the vehicle.
    pub fn rotor_count(&self) -> usize {
        self.rotor_count
    }

    /// Duty, fraction, at which the nominal vehicle hovers at the initial charge: for `Controller::trim`.
    pub fn hover_duty(&self) -> f32 {
        self.hover_duty
    }

    /// How this flight's vehicle differs from its document.
    pub fn mismatch(&self) -> &MismatchDraw {
        &self.mismatch
    }

    /// Starts from another state.
    #[cfg(test)]
    pub(crate) fn set_state(&mut self, state: PlantState) {
        self.state = state;
        self.record_truth(0);
    }

    /// The integrated state.
    #[cfg(test)]
    pub(crate) fn state(&self) -> &PlantState {
        &self.state
    }

    /// [`Simulation::advance_duty`] in the widest arrays.
    #[cfg(test)]
    pub(crate) fn advance_padded(&mut self, duty: &[f64; MAX_ROTORS]) -> Result<(), SimulationError> {
        let rotor_count = std::mem::replace(&mut self.rotor_count, MAX_ROTORS);
        let mut padded = [0.0; MAX_ROTORS];
        padded[..rotor_count].copy_from_slice(&duty[..rotor_count]);
        let result = self.advance_duty(&padded);
        self.rotor_count = rotor_count;
        result
    }

    /// Gives the rotors other lift biases, N.
    #[cfg(test)]
    pub(crate) fn set_rotor_bias(&mut self, bias: &[f64]) {
        for (i, &bias) in bias.iter().enumerate() {
            self.powertrain.change(i, |rotor| rotor.bias = bias);
        }
    }

    /// One step of 2.5 ms for rotors padded to `N`.
    fn integrate<const N: usize>(&mut self) {
        let state = self.stepped::<N>(&self.dynamic_state());
        self.take_dynamic_state(&state);
    }

    #[inline]
    fn take_dynamic_state<const N: usize>(&mut self, state: &DynamicState<N>) {
        self.state.body = state.body;
        self.state.state_of_charge = state.state_of_charge;
        self.state.thrust[..N].copy_from_slice(&state.thrust);
    }

    /// `state` one step later, with the held command.
    #[inline]
    fn stepped<const N: usize>(&self, state: &DynamicState<N>) -> DynamicState<N> {
        let dynamics = Dynamics {
            body: &self.body,
            around: self.environment.now(),
            rotors: self.powertrain.held::<N>(),
            battery: self.battery.constants(),
            connected: self.battery.is_connected(),
        };
        let h = STEP_S / f64::from(self.substeps);
        let mut now = *state;
        for _ in 0..self.substeps {
            now = dynamics.step(&mut &self.battery, &now, h);
        }
        now
    }

    /// The integrated state, rotors padded to `N`.
    #[inline]
    pub(crate) fn dynamic_state<const N: usize>(&self) -> DynamicState<N> {
        let mut thrust = [0.0; N];
        thrust.copy_from_slice(&self.state.thrust[..N]);
        DynamicState {
            body: self.state.body,
            thrust,
            state_of_charge: self.state.state_of_charge,
        }
    }

    /// For [`crate::batch`], which keeps the state: `state` one step later under `duty`, which must be numbers.
    pub(crate) fn step_of<const N: usize>(&mut self, state: &DynamicState<N>, duty: &[f32; N]) -> DynamicState<N> {
        let mut limited = [0.0; MAX_ROTORS];
        for (limited, duty) in limited.iter_mut().zip(duty) {
            *limited = f64::from(*duty).clamp(0.0, 1.0);
        }
        self.powertrain.hold(&limited);
        self.stepped(state)
    }

    /// For [`crate::batch`]: moves everything but the state to the next step; true if a rotor has changed.
    ///
    /// * `reference`: that of the next step, if it is known from a flight with the same trajectory
    #[inline]
    pub(crate) fn advance_around(&mut self, reference: Option<&ReferencePoint>) -> bool {
        let step = self.truth.step + 1;
        self.environment.advance();
        let changed = self.faults.apply(step, &mut self.powertrain);
        if changed {
            self.record_faults();
        }
        match reference {
            Some(point) => self.reference.set_point(point),
            None => self.reference.advance(step),
        }
        self.truth.step = step;
        self.truth.sim_time_ns = step * STEP_NS;
        self.truth.wind_ned_m_s = self.environment.now().wind_ned;
        changed
    }

    /// For [`crate::batch`]: attitude, rad, and (V_oc, V_batt, i_batt) of a state.
    pub(crate) fn truth_of<const N: usize>(&self, state: &DynamicState<N>) -> (Vector3, Vector3) {
        let power = self.battery.power_coefficient() * sum_of_powers(&state.thrust);
        let output = self.battery.output(state.state_of_charge, power);
        let battery = [
            output.open_circuit_voltage,
            output.battery_voltage,
            output.battery_current,
        ];
        (state.body.ned_from_body.to_euler(), battery)
    }

    /// True if the step is not the plain one: effects, an accelerometer, or ground contact.
    pub(crate) fn is_extended(&self) -> bool {
        self.effects.is_some() || self.accelerometer.is_some() || self.contact.is_some()
    }

    /// Substeps of the integrator in a step.
    pub(crate) fn substeps(&self) -> u32 {
        self.substeps
    }

    /// Refuses a state that is not a number.
    #[inline]
    fn check_state(&self, step: u64) -> Result<(), SimulationError> {
        let PlantState {
            body,
            thrust,
            state_of_charge,
        } = &self.state;
        let sum = |v: &Vector3| v[0] + v[1] + v[2];
        let q = body.ned_from_body.0;
        // One NaN or infinity anywhere leaves no finite sum.
        let total = sum(&body.position_ned)
            + sum(&body.velocity_ned)
            + sum(&body.body_rates)
            + (q[0] + q[1] + q[2] + q[3])
            + thrust[..self.rotor_count].iter().sum::<f64>()
            + state_of_charge;
        if total.is_finite() {
            return Ok(());
        }
        let bad = |values: &[f64]| !values.iter().all(|x| x.is_finite());
        let quantity = if bad(thrust) {
            "a rotor thrust"
        } else if bad(&[*state_of_charge]) {
            "the state of charge"
        } else if bad(&body.body_rates) {
            "the body rates"
        } else if bad(&q) {
            "the attitude"
        } else if bad(&body.velocity_ned) {
            "the velocity"
        } else {
            "the position"
        };
        Err(SimulationError::NonFiniteState { step, quantity })
    }

    fn record_truth(&mut self, step: u64) {
        let PlantState {
            body,
            thrust,
            state_of_charge,
        } = &self.state;
        let BatteryOutput {
            open_circuit_voltage,
            battery_voltage,
            battery_current,
        } = match &self.effects {
            Some(effects) => effects.battery(),
            None => {
                let power = self.battery.power_coefficient() * sum_of_powers(thrust);
                self.battery.output(*state_of_charge, power)
            }
        };
        let truth = &mut self.truth;
        truth.step = step;
        truth.sim_time_ns = step * STEP_NS;
        truth.position_ned_m = body.position_ned;
        truth.velocity_ned_m_s = body.velocity_ned;
        truth.attitude_rad = body.ned_from_body.to_euler();
        truth.body_rates_rad_s = body.body_rates;
        truth.rotor_thrust_n = *thrust;
        truth.state_of_charge = *state_of_charge;
        truth.open_circuit_voltage_v = open_circuit_voltage;
        truth.battery_voltage_v = battery_voltage;
        truth.battery_current_a = battery_current;
        truth.wind_ned_m_s = match &self.effects {
            Some(effects) => effects.wind_ned(),
            None => self.environment.now().wind_ned,
        };
    }

    fn record_faults(&mut self) {
        let truth = &mut self.truth;
        truth.faulty_rotors = self.faults.faulty_rotors();
        truth.fault_label = match truth.faulty_rotors {
            0 => 0,
            mask if mask.is_power_of_two() => mask.trailing_zeros() as i32 + 1,
            _ => -1,
        };
        truth.rotor_blade = self.faults.blade_code;
        truth.rotor_thrust_loss = self.faults.thrust_loss;
    }
}
