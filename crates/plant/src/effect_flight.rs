//! One flight with effects: the step of the simulation in which the hooks of an [`EffectSet`] act.
//!
//! ```text
//!  duty ─▶ delay ─▶ command hooks ─▶ Eq. 19 ─▶ lift hooks ─▶ lag ─▶ thrust hooks ─▶ wrench hooks ─▶ rigid body
//!                                      ▲ V − R I_i: battery with its RC pair                            │
//!  readings ◀─ latencies ◀─ offsets, biases, scales ◀─ reading hooks ◀── true state, specific force ◀───┘
//! ```
//! With `[rotors.motor]` the way from command to thrust is that of ESC and motor, whose speeds are integrated (`powertrain/motor.rs`); lift
//! hooks then act on the lift at that speed, at once.
//!
//! Same integrator and step as the flight without effects; hooks of lift, thrust and wrench act at every stage, the own states of
//! effects move once a step. Accelerations that hooks see are those of the stage before. Full inertia tensor.
//!
//! A load that is dropped changes the vehicle on which the effects act. The sensors stay where they are: they measure the place that was
//! the centre of mass when the flight began.
//!
//! A flight in parts of 0.5 ms (an autopilot of its own clock) takes duties part by part, and everything that a step holds, wind, onsets
//! and the own states of effects, still once a step: five parts of the same duty are a step.

use rotortwin_flight_core::MAX_ROTORS;

use crate::body::contact::{Contact, around};
use crate::body::rigid_body::{Quaternion, RigidBodyRate, RigidBodyState, Surroundings};
use crate::effects::{Constants, EffectSet, Moment, Readings, Wrench};
use crate::motors::Motors;
use crate::powertrain::battery::{Battery, BatteryOutput};
use crate::powertrain::held::sum_of_powers;
use crate::powertrain::rotors::RotorTruth;
use crate::state::PlantState;
use crate::vector::{Vector3, cross};
use crate::vehicle::load::{LoadPlan, MassProperties};
use crate::{PART_S, PARTS_PER_STEP, STEP_S};

/// How far delays reach back, s: the longest accepted.
const LONGEST_DELAY_S: f64 = 2.0;

/// What the flight without effects gives to the step.
pub(crate) struct Plant<'a> {
    pub(crate) rotors: &'a [RotorTruth],
    pub(crate) battery: &'a Battery,
    pub(crate) around: &'a Surroundings,
    pub(crate) contact: Option<&'a Contact>,
}

/// Which part of which step.
pub(crate) struct Part {
    /// Begin of the step, s.
    pub(crate) step_begins_s: f64,
    /// Parts of the step that are done.
    pub(crate) done: u32,
    /// Runge–Kutta steps of the part.
    pub(crate) substeps: u32,
}

/// Values that are held over a step.
#[derive(Debug, Clone)]
struct Held {
    time_s: f64,
    /// As the controller sent it.
    commanded: [f64; MAX_ROTORS],
    /// Gain · bracket of Eq. 19, N/V.
    lift_per_volt: [f64; MAX_ROTORS],
    voltage_offset: [f64; MAX_ROTORS],
    bias: [f64; MAX_ROTORS],
    health: [f64; MAX_ROTORS],
    wind_ned: Vector3,
    /// Duty that acts, fraction.
    duty: [f64; MAX_ROTORS],
    /// Gain · c_L, N·s²; 0 without motors.
    lift_coefficient: [f64; MAX_ROTORS],
}

/// A state of the whole plant.
#[derive(Debug, Clone, Copy)]
struct Stage {
    body: RigidBodyState,
    /// N; follows from the speeds where there are motors.
    thrust: [f64; MAX_ROTORS],
    /// Ω of motors, rad/s; 0 without them.
    speed: [f64; MAX_ROTORS],
    charge: f64,
    rc_voltage: f64,
}

impl Stage {
    fn moved(&self, rate: &Rate, rotors: usize, h: f64) -> Self {
        let mut moved = Self {
            body: self.body.moved(&rate.body, h),
            charge: self.charge + h * rate.charge,
            rc_voltage: self.rc_voltage + h * rate.rc_voltage,
            ..*self
        };
        for i in 0..rotors {
            moved.thrust[i] += h * rate.thrust[i];
            moved.speed[i] += h * rate.speed[i];
        }
        moved
    }
}

/// Right-hand side.
struct Rate {
    body: RigidBodyRate,
    thrust: [f64; MAX_ROTORS],
    /// Ω', rad/s².
    speed: [f64; MAX_ROTORS],
    charge: f64,
    rc_voltage: f64,
}

/// What rotors contribute to a right-hand side.
struct RotorRate {
    thrust: [f64; MAX_ROTORS],
    speed: [f64; MAX_ROTORS],
    wrench: Wrench,
}

/// Inputs of hooks in addition to the state itself.
#[derive(Debug, Clone)]
struct Context {
    constants: Constants,
    /// z of the ground, m, NED; infinite without a ground.
    ground_down: f64,
    held: Held,
    /// Of the latest evaluation of the right-hand side.
    specific_force: Vector3,
    angular_acceleration: Vector3,
    battery: BatteryOutput,
}

/// What a moment borrows.
struct View {
    ned_from_body: [Vector3; 3],
    air_velocity_body: Vector3,
    speed_ratio: [f64; MAX_ROTORS],
    speed_rate: [f64; MAX_ROTORS],
}

impl Context {
    fn view(&self, body: &RigidBodyState, thrust: &[f64; MAX_ROTORS], thrust_rate: &[f64; MAX_ROTORS]) -> View {
        let r = rotation(body.ned_from_body);
        let air = [0, 1, 2].map(|i| body.velocity_ned[i] - self.held.wind_ned[i]);
        let per_hover = 1.0 / self.constants.hover_thrust_n;
        let speed_ratio: [f64; MAX_ROTORS] = std::array::from_fn(|i| (thrust[i].max(0.0) * per_hover).sqrt());
        View {
            ned_from_body: r,
            air_velocity_body: transposed(&r, air),
            speed_ratio,
            // Ω²/Ω_h² = f/f_h; a rotor near rest counts as turning at a thousandth of the hover speed.
            speed_rate: std::array::from_fn(|i| 0.5 * thrust_rate[i] * per_hover / speed_ratio[i].max(1e-3)),
        }
    }

    fn moment<'a>(&'a self, body: &RigidBodyState, thrust: &'a [f64; MAX_ROTORS], view: &'a View) -> Moment<'a> {
        let n = self.constants.rotor_count;
        Moment {
            time_s: self.held.time_s,
            step_s: STEP_S,
            position_ned: body.position_ned,
            velocity_ned: body.velocity_ned,
            air_velocity_body: view.air_velocity_body,
            body_rates: body.body_rates,
            angular_acceleration: self.angular_acceleration,
            specific_force: self.specific_force,
            ned_from_body: view.ned_from_body,
            height_above_ground: self.ground_down - body.position_ned[2],
            rotor_thrust: &thrust[..n],
            rotor_speed_ratio: &view.speed_ratio[..n],
            rotor_speed_rate: &view.speed_rate[..n],
            duty: &self.held.commanded[..n],
            battery_voltage: self.battery.battery_voltage,
            battery_current: self.battery.battery_current,
            constants: &self.constants,
        }
    }
}

/// Effects of one flight, and what the plant needs only for them.
#[derive(Debug, Clone)]
pub(crate) struct EffectFlight {
    set: EffectSet,
    loads: Loads,
    /// What faults have made of each rotor's c_D/c_L: a factor.
    moment_ratio_factor: [f64; MAX_ROTORS],
    context: Context,
    per_inertia: [Vector3; 3],
    /// v₁ of the RC pair, V.
    rc_voltage: f64,
    /// Rate of the result of [`EffectFlight::turning`], N/s.
    thrust_rate: [f64; MAX_ROTORS],
    /// ESCs and motors, if the vehicle has them in place of Eq. 19 and its lag.
    motors: Option<Motors>,
    /// One sample per step, or several once the flight proceeds in parts of a step.
    duties: Ring<[f64; MAX_ROTORS]>,
    readings: Ring<Readings>,
    /// What a step in parts began with, between its first part and its last.
    begun: Option<Box<Begun>>,
}

/// The loads of a flight.
#[derive(Debug, Clone, Default)]
pub(crate) struct Loads {
    /// Step of each drop, and the nominal vehicle from then on.
    bases: Vec<(u64, Constants)>,
    /// Drops so far.
    gone: usize,
    /// The place that the sensors measure, m, body, from the centre of mass; `None` until a load goes: the centre itself.
    measured_from_centre: Option<Vector3>,
}

impl Loads {
    /// Of a plan, on a vehicle that is `whole` before the first drop.
    pub(crate) fn new(plan: &LoadPlan, whole: &Constants) -> Self {
        let mut remaining = *whole;
        let mut bases = Vec::with_capacity(plan.drops().len());
        for drop in plan.drops() {
            remaining = without(&remaining, drop.mass, drop.position);
            bases.push((drop.step, remaining));
        }
        Self {
            bases,
            ..Self::default()
        }
    }

    /// The nominal vehicle after each drop, in the order of the plan.
    pub(crate) fn bases(&self) -> impl Iterator<Item = &Constants> {
        self.bases.iter().map(|(_, base)| base)
    }
}

/// A vehicle without a load of `mass` kg at `position`, m, body. The accelerometer stays in its place.
fn without(constants: &Constants, mass: f64, position: Vector3) -> Constants {
    let centre = constants.centre_of_mass_m;
    let before = MassProperties {
        mass: constants.mass_kg,
        centre,
        inertia: constants.inertia_body_kg_m2,
    };
    let after = before.without(mass, position);
    Constants {
        mass_kg: after.mass,
        centre_of_mass_m: after.centre,
        inertia_body_kg_m2: after.inertia,
        imu_lever_arm_m: [0, 1, 2].map(|i| constants.imu_lever_arm_m[i] + centre[i] - after.centre[i]),
        ..*constants
    }
}

/// What own states of effects move with: the instant that a step began at.
#[derive(Debug, Clone)]
struct Begun {
    body: RigidBodyState,
    thrust: [f64; MAX_ROTORS],
    turning: [f64; MAX_ROTORS],
    thrust_rate: [f64; MAX_ROTORS],
    context: Context,
}

/// The last samples of something, newest first.
#[derive(Debug, Clone)]
struct Ring<T> {
    samples: Vec<T>,
    newest: usize,
    /// Samples a step.
    per_step: u32,
}

impl<T: Copy> Ring<T> {
    /// One sample a step. Before the first there was `first` for ever.
    fn new(first: T) -> Self {
        Self {
            samples: vec![first; Self::length(1)],
            newest: 0,
            per_step: 1,
        }
    }

    /// Samples of the longest delay, and both ends of the interpolation.
    fn length(per_step: u32) -> usize {
        crate::nearest_step(LONGEST_DELAY_S) as usize * per_step as usize + 2
    }

    /// The same history with `per_step` samples a step, each held as long as before.
    fn at_rate(&self, per_step: u32) -> Self {
        let length = Self::length(per_step);
        let held = (per_step / self.per_step) as usize;
        let old = self.samples.len();
        Self {
            // The newest at the end.
            samples: (0..length)
                .rev()
                .map(|back| self.samples[(self.newest + old - (back / held).min(old - 1)) % old])
                .collect(),
            newest: length - 1,
            per_step,
        }
    }

    fn push(&mut self, sample: T) {
        self.newest = (self.newest + 1) % self.samples.len();
        self.samples[self.newest] = sample;
    }

    /// The samples on both sides of `age` s, the newer first, and the weight of the older.
    fn around(&self, age: f64) -> (&T, &T, f64) {
        let length = self.samples.len();
        let back = (age / STEP_S * f64::from(self.per_step)).clamp(0.0, (length - 2) as f64);
        let whole = back as usize;
        let at = |back: usize| &self.samples[(self.newest + length - back) % length];
        (at(whole), at(whole + 1), back - whole as f64)
    }
}

impl EffectFlight {
    /// A flight with `set` over a ground at `ground_down` m, NED; infinite for none.
    pub(crate) fn new(set: EffectSet, loads: Loads, motors: Option<Motors>, ground_down: f64) -> Self {
        let zero = [0.0; MAX_ROTORS];
        let mut flight = Self {
            context: Context {
                constants: *set.constants(),
                ground_down,
                held: Held {
                    time_s: 0.0,
                    commanded: zero,
                    lift_per_volt: zero,
                    voltage_offset: zero,
                    bias: zero,
                    health: zero,
                    wind_ned: [0.0; 3],
                    duty: zero,
                    lift_coefficient: zero,
                },
                specific_force: [0.0; 3],
                angular_acceleration: [0.0; 3],
                battery: BatteryOutput::default(),
            },
            set,
            loads,
            moment_ratio_factor: [1.0; MAX_ROTORS],
            per_inertia: [[0.0; 3]; 3],
            rc_voltage: 0.0,
            thrust_rate: zero,
            motors,
            duties: Ring::new(zero),
            readings: Ring::new(Readings::default()),
            begun: None,
        };
        flight.take_constants();
        flight
    }

    fn take_constants(&mut self) {
        self.context.constants = *self.set.constants();
        for (ratio, factor) in self
            .context
            .constants
            .moment_ratio_m
            .iter_mut()
            .zip(self.moment_ratio_factor)
        {
            *ratio *= factor;
        }
        let inertia = &self.context.constants.inertia_body_kg_m2;
        let j = nalgebra::Matrix3::from_fn(|row, column| inertia[row][column]);
        let inverse = j
            .try_inverse()
            .expect("the inertia was checked to be positive definite");
        self.per_inertia = [0, 1, 2].map(|row| [0, 1, 2].map(|column| inverse[(row, column)]));
        if let Some(motors) = &mut self.motors {
            motors.take(&self.context.constants);
        }
    }

    /// Voltages and current of the latest instant.
    pub(crate) fn battery(&self) -> BatteryOutput {
        self.context.battery
    }

    /// Wind with all that effects add, m/s, NED.
    pub(crate) fn wind_ned(&self) -> Vector3 {
        self.context.held.wind_ned
    }

    /// Specific force where it is measured, m/s², body, of the latest instant.
    pub(crate) fn specific_force(&self, body_rates: Vector3) -> Vector3 {
        let mut force = self.context.specific_force;
        if let Some(place) = self.loads.measured_from_centre {
            let turning = cross(self.context.angular_acceleration, place);
            let inwards = cross(body_rates, cross(body_rates, place));
            for i in 0..3 {
                force[i] += turning[i] + inwards[i];
            }
        }
        force
    }

    /// Position, m, and velocity, m/s, NED, of the place that the sensors measure: until a load goes, the centre of mass.
    pub(crate) fn measured_motion(&self, body: &RigidBodyState) -> (Vector3, Vector3) {
        let Some(place) = self.loads.measured_from_centre else {
            return (body.position_ned, body.velocity_ned);
        };
        let away = body.ned_from_body.ned_from_body(place);
        let turning = body.ned_from_body.ned_from_body(cross(body.body_rates, place));
        (
            [0, 1, 2].map(|i| body.position_ned[i] + away[i]),
            [0, 1, 2].map(|i| body.velocity_ned[i] + turning[i]),
        )
    }

    /// Drops the loads of `step`: the state becomes that of what remains. Returns how far the centre of mass has moved, m, body; `None`
    /// if nothing is dropped.
    pub(crate) fn drop_loads(&mut self, step: u64, state: &mut PlantState) -> Option<Vector3> {
        let mut moved: Option<Vector3> = None;
        while let Some((at, after)) = self.loads.bases.get(self.loads.gone).filter(|(at, _)| *at <= step) {
            debug_assert_eq!(*at, step, "every step is asked for");
            let (before, after) = (self.set.nominal().centre_of_mass_m, *after);
            self.loads.gone += 1;
            let shift = [0, 1, 2].map(|i| after.centre_of_mass_m[i] - before[i]);
            let body = &mut state.body;
            let away = body.ned_from_body.ned_from_body(shift);
            let turning = body.ned_from_body.ned_from_body(cross(body.body_rates, shift));
            for i in 0..3 {
                body.position_ned[i] += away[i];
                body.velocity_ned[i] += turning[i];
            }
            let measured = self.loads.measured_from_centre.unwrap_or_default();
            self.loads.measured_from_centre = Some([0, 1, 2].map(|i| measured[i] - shift[i]));
            let so_far = moved.unwrap_or_default();
            moved = Some([0, 1, 2].map(|i| so_far[i] + shift[i]));
            self.set.set_nominal(&after);
            self.take_constants();
        }
        moved
    }

    /// Before the first step: the duty has always been `duty`.
    pub(crate) fn begin(&mut self, state: &PlantState, plant: &Plant<'_>, duty: f64) {
        self.duties = Ring::new([duty; MAX_ROTORS]);
        if let Some(motors) = &mut self.motors {
            motors.begin(&state.thrust);
        }
        self.begin_step(0.0, state, plant, &[duty; MAX_ROTORS], 1);
        // Twice: at the first look hooks know no accelerations.
        self.observe(state, plant);
        self.observe(state, plant);
        let readings = self.true_readings(state);
        self.readings = Ring::new(readings);
    }

    /// Before the flight: effects with an onset do not act, whatever the time.
    pub(crate) fn hold_onsets(&mut self) {
        self.set.hold_onsets();
        self.take_constants();
    }

    /// The flight begins: onsets count from now on.
    pub(crate) fn release_onsets(&mut self) {
        self.set.release_onsets();
    }

    /// Id of an effect on the values or the timing of sensors, if there is one.
    pub(crate) fn of_readings(&self) -> Option<&'static str> {
        self.set.of_readings()
    }

    /// Begins the step at `time_s` with these duties, which are held over this many samples of their history: lets
    /// effects set in, and samples the wind, which is held over the step.
    fn begin_step(
        &mut self,
        time_s: f64,
        state: &PlantState,
        plant: &Plant<'_>,
        duty: &[f64; MAX_ROTORS],
        samples: u32,
    ) {
        let mut changed = self.set.begin(time_s);
        for (factor, rotor) in self.moment_ratio_factor.iter_mut().zip(plant.rotors) {
            let now = rotor.moment_ratio_factor();
            changed |= *factor != now;
            *factor = now;
        }
        if changed {
            self.take_constants();
        }
        self.context.held.time_s = time_s;
        self.context.held.commanded = *duty;
        let steady = self.context.constants.wind_ned_m_s;
        let mut wind = [0, 1, 2].map(|i| plant.around.wind_ned[i] + steady[i]);
        let view = self
            .context
            .view(&state.body, &self.turning(&state.thrust), &self.thrust_rate);
        let at = self.context.moment(&state.body, &state.thrust, &view);
        self.set.wind(&at, &mut wind);
        self.hold(state, plant, duty, samples);
        self.context.held.wind_ned = wind;
    }

    /// Takes duties that are held over this many samples of their history.
    fn hold(&mut self, state: &PlantState, plant: &Plant<'_>, duty: &[f64; MAX_ROTORS], samples: u32) {
        let n = self.context.constants.rotor_count;
        self.context.held.commanded = *duty;
        for _ in 0..samples {
            self.duties.push(*duty);
        }
        let (newer, older, weight) = self.duties.around(self.context.constants.command_delay_s);
        let mut acting: [f64; MAX_ROTORS] = std::array::from_fn(|i| (1.0 - weight) * newer[i] + weight * older[i]);
        let view = self
            .context
            .view(&state.body, &self.turning(&state.thrust), &self.thrust_rate);
        let at = self.context.moment(&state.body, &state.thrust, &view);
        self.set.command(&at, &mut acting[..n]);
        let Context { constants, held, .. } = &mut self.context;
        for (i, rotor) in plant.rotors.iter().enumerate() {
            let duty = constants.effective_duty(acting[i]).clamp(0.0, 1.0);
            held.lift_per_volt[i] = constants.rotor_gain[i] * rotor.blade.lift_per_volt(duty);
            held.voltage_offset[i] = rotor.blade.voltage_offset_v;
            held.bias[i] = if duty > 0.0 { constants.rotor_bias_n[i] } else { 0.0 };
            held.health[i] = 1.0 - rotor.thrust_loss;
            if let Some(motors) = &self.motors {
                held.duty[i] = duty;
                held.lift_coefficient[i] = constants.rotor_gain[i] * motors.lift_coefficient(i, &rotor.blade);
            }
        }
    }

    /// Thrusts of healthy rotors at the speeds of these, N: the basis of their speed ratios. Without motors the thrusts
    /// themselves.
    fn turning(&self, thrust: &[f64; MAX_ROTORS]) -> [f64; MAX_ROTORS] {
        self.motors.as_ref().map_or(*thrust, Motors::healthy_thrust)
    }

    /// Lift of motors at these speeds, N (Eq. 4), with the faults of each rotor.
    fn lift_at(&self, speed: &[f64; MAX_ROTORS]) -> [f64; MAX_ROTORS] {
        let held = &self.context.held;
        std::array::from_fn(|i| {
            held.health[i] * (held.lift_coefficient[i] * speed[i] * speed[i] + held.bias[i]).max(0.0)
        })
    }

    /// Voltages and current at a state; the RC pair is in series.
    fn voltages(&self, at: &Stage, battery: &Battery) -> BatteryOutput {
        let constants = &self.context.constants;
        if !battery.is_connected() {
            return battery.output(at.charge, 0.0);
        }
        let open = battery.open_circuit_voltage(at.charge + constants.charge_offset);
        let source = open - at.rc_voltage;
        if let Some(motors) = &self.motors {
            return motors.battery(open, source, constants, &self.context.held.duty, &at.speed);
        }
        let power = constants.power_coefficient_w_per_n15 * sum_of_powers(&at.thrust);
        let (square, drop) = (source * source, 4.0 * constants.internal_resistance_ohm * power);
        let (power, root) = if drop > square {
            (square / (4.0 * constants.internal_resistance_ohm), 0.0)
        } else {
            (power, (square - drop).sqrt())
        };
        let terminal = 0.5 * (source + root);
        BatteryOutput {
            open_circuit_voltage: open,
            battery_voltage: terminal,
            battery_current: power / terminal,
        }
    }

    /// Right-hand side of the whole plant; its by-products remain in the context for hooks and sensors.
    fn rate(&mut self, state: &Stage, plant: &Plant<'_>) -> Rate {
        let n = self.context.constants.rotor_count;
        let battery = self.voltages(state, plant.battery);
        self.context.battery = battery;
        let body = &state.body;
        if self.motors.is_some() {
            return self.rate_of_motors(state, plant);
        }
        let thrust = &state.thrust;
        let Context { constants, held, .. } = &self.context;
        let mut lift = [0.0; MAX_ROTORS];
        for i in 0..n {
            let mut voltage = battery.battery_voltage;
            if constants.esc_resistance_ohm != 0.0 && voltage > 0.0 {
                let f = thrust[i].max(0.0);
                let current = constants.power_coefficient_w_per_n15 * f * f.sqrt() / voltage;
                voltage -= constants.esc_resistance_ohm * current;
            }
            let raw = (voltage - held.voltage_offset[i]).max(0.0) * held.lift_per_volt[i] + held.bias[i];
            lift[i] = held.health[i] * raw.max(0.0);
        }
        let view = self.context.view(body, thrust, &self.thrust_rate);
        let at = self.context.moment(body, thrust, &view);
        self.set.static_lift(&at, &mut lift[..n]);
        let mut thrust_rate = [0.0; MAX_ROTORS];
        for i in 0..n {
            thrust_rate[i] = constants.thrust_rate(lift[i].max(0.0), thrust[i]);
        }
        let view = self.context.view(body, thrust, &thrust_rate);
        let at = self.context.moment(body, thrust, &view);
        let mut acting = *thrust;
        self.set.rotor_thrust(&at, &mut acting[..n]);
        let mut wrench: Wrench = constants.rotor_wrench(&acting[..n]);
        self.set.wrench(&at, &mut wrench);
        let of_rotors = RotorRate {
            thrust: thrust_rate,
            speed: [0.0; MAX_ROTORS],
            wrench,
        };
        self.thrust_rate = thrust_rate;
        self.rate_of_body(state, &view, &of_rotors, plant)
    }

    /// Right-hand side where motors turn the rotors.
    fn rate_of_motors(&mut self, state: &Stage, plant: &Plant<'_>) -> Rate {
        let motors = self.motors.as_ref().expect("asked for with motors only");
        let n = self.context.constants.rotor_count;
        let thrust = self.lift_at(&state.speed);
        let Context {
            constants,
            held,
            battery,
            ..
        } = &self.context;
        let speed_rate = motors.acceleration(constants, battery, &held.duty, &state.speed, &thrust);
        let (turning, turning_rate) = motors.healthy(&state.speed, &speed_rate);
        let view = self.context.view(&state.body, &turning, &turning_rate);
        let at = self.context.moment(&state.body, &thrust, &view);
        let mut acting = thrust;
        self.set.static_lift(&at, &mut acting[..n]);
        self.set.rotor_thrust(&at, &mut acting[..n]);
        let mut wrench: Wrench = constants.rotor_wrench(&acting[..n]);
        // A rotor that speeds up turns the vehicle the other way.
        let momentum: f64 = (0..n).map(|i| constants.rotor_spin[i] * speed_rate[i]).sum();
        wrench.torque_body[2] += motors.inertia() * momentum;
        self.set.wrench(&at, &mut wrench);
        let of_rotors = RotorRate {
            thrust: [0.0; MAX_ROTORS],
            speed: speed_rate,
            wrench,
        };
        self.thrust_rate = turning_rate;
        self.rate_of_body(state, &view, &of_rotors, plant)
    }

    /// What rotors do to the rest of the plant.
    fn rate_of_body(&mut self, state: &Stage, view: &View, rotors: &RotorRate, plant: &Plant<'_>) -> Rate {
        let body = &state.body;
        let Context { constants, battery, .. } = &self.context;
        let wrench = constants.closed(&rotors.wrench, view.air_velocity_body, body.body_rates);

        let around = around(plant.around, plant.contact, body);
        let disturbance = transposed(&view.ned_from_body, around.force_ned);
        let force = [0, 1, 2].map(|i| (wrench.force_body[i] + disturbance[i]) / constants.mass_kg);
        let j = &constants.inertia_body_kg_m2;
        let momentum = [0, 1, 2].map(|i| dot(j[i], body.body_rates));
        let gyroscopic = cross(body.body_rates, momentum);
        let torque = [0, 1, 2].map(|i| wrench.torque_body[i] + around.torque_body[i] - gyroscopic[i]);
        let spin_up = [0, 1, 2].map(|i| dot(self.per_inertia[i], torque));
        let mut velocity = [0, 1, 2].map(|i| dot(view.ned_from_body[i], force));
        velocity[2] += constants.gravity_m_s2;
        let rate = Rate {
            body: RigidBodyRate {
                position: body.velocity_ned,
                velocity,
                quaternion: body.ned_from_body.rate(body.body_rates),
                body_rates: spin_up,
            },
            thrust: rotors.thrust,
            speed: rotors.speed,
            charge: -battery.battery_current / (3600.0 * constants.capacity_ah),
            rc_voltage: (constants.rc_resistance_ohm * battery.battery_current - state.rc_voltage)
                / constants.rc_time_s,
        };
        self.context.specific_force = force;
        self.context.angular_acceleration = spin_up;
        rate
    }

    /// Looks at a state without moving it: accelerations, voltages and current of the instant.
    fn observe(&mut self, state: &PlantState, plant: &Plant<'_>) {
        self.rate(&self.stage(state), plant);
    }

    fn stage(&self, state: &PlantState) -> Stage {
        Stage {
            body: state.body,
            thrust: state.thrust,
            speed: self.motors.as_ref().map_or([0.0; MAX_ROTORS], |motors| motors.speed),
            charge: state.state_of_charge,
            rc_voltage: self.rc_voltage,
        }
    }

    /// One step of 2.5 ms from `time_s` with these duties, fractions in \[0, 1\]; `contact` is the ground, if it carries the vehicle.
    pub(crate) fn advance(
        &mut self,
        time_s: f64,
        state: &mut PlantState,
        air: &Plant<'_>,
        mut contact: Option<&mut Contact>,
        duty: &[f64; MAX_ROTORS],
        substeps: u32,
    ) {
        self.begin_step(time_s, state, air, duty, self.duties.per_step);
        let begun = self.begun(state);
        let h = STEP_S / f64::from(substeps);
        self.integrate(state, air, contact.as_deref_mut(), substeps, h);
        self.advance_own_states(&begun);
        self.observe_on(state, air, contact.as_deref());
    }

    /// One part of 0.5 ms with these duties.
    pub(crate) fn advance_part(
        &mut self,
        part: &Part,
        state: &mut PlantState,
        air: &Plant<'_>,
        mut contact: Option<&mut Contact>,
        duty: &[f64; MAX_ROTORS],
    ) {
        if self.duties.per_step != PARTS_PER_STEP {
            self.duties = self.duties.at_rate(PARTS_PER_STEP);
        }
        if part.done == 0 {
            self.begin_step(part.step_begins_s, state, air, duty, 1);
            self.begun = Some(Box::new(self.begun(state)));
        } else {
            self.hold(state, air, duty, 1);
        }
        let h = PART_S / f64::from(part.substeps);
        self.integrate(state, air, contact.as_deref_mut(), part.substeps, h);
        if part.done + 1 == PARTS_PER_STEP
            && let Some(begun) = self.begun.take()
        {
            self.advance_own_states(&begun);
        }
        self.observe_on(state, air, contact.as_deref());
    }

    fn begun(&self, state: &PlantState) -> Begun {
        Begun {
            body: state.body,
            thrust: state.thrust,
            turning: self.turning(&state.thrust),
            thrust_rate: self.thrust_rate,
            context: self.context.clone(),
        }
    }

    /// Own states of effects were held over the step and advance with the values from its beginning.
    fn advance_own_states(&mut self, begun: &Begun) {
        let view = begun.context.view(&begun.body, &begun.turning, &begun.thrust_rate);
        self.set
            .advance(&begun.context.moment(&begun.body, &begun.thrust, &view), STEP_S);
    }

    /// Looks at the state on the ground of the flight, if there is one.
    pub(crate) fn observe_on(&mut self, state: &PlantState, air: &Plant<'_>, contact: Option<&Contact>) {
        self.observe(state, &Plant { contact, ..*air });
    }

    /// This many Runge–Kutta steps of `h` s with the held inputs.
    fn integrate(
        &mut self,
        state: &mut PlantState,
        air: &Plant<'_>,
        mut contact: Option<&mut Contact>,
        substeps: u32,
        h: f64,
    ) {
        let n = self.context.constants.rotor_count;
        for _ in 0..substeps {
            let half = 0.5 * h;
            let s = self.stage(state);
            let plant = &Plant {
                contact: contact.as_deref(),
                ..*air
            };
            let k1 = self.rate(&s, plant);
            let k2 = self.rate(&s.moved(&k1, n, half), plant);
            let k3 = self.rate(&s.moved(&k2, n, half), plant);
            let k4 = self.rate(&s.moved(&k3, n, h), plant);
            let mean = |a: f64, b: f64, c: f64, d: f64| (a + 2.0 * (b + c) + d) * (1.0 / 6.0);
            for i in 0..n {
                state.thrust[i] += h * mean(k1.thrust[i], k2.thrust[i], k3.thrust[i], k4.thrust[i]);
            }
            if let Some(motors) = &mut self.motors {
                for i in 0..n {
                    let change = h * mean(k1.speed[i], k2.speed[i], k3.speed[i], k4.speed[i]);
                    motors.speed[i] = (motors.speed[i] + change).max(0.0);
                }
                let speed = motors.speed;
                state.thrust = self.lift_at(&speed);
            }
            state.state_of_charge += h * mean(k1.charge, k2.charge, k3.charge, k4.charge);
            self.rc_voltage += h * mean(k1.rc_voltage, k2.rc_voltage, k3.rc_voltage, k4.rc_voltage);
            let body = RigidBodyRate::runge_kutta_mean(&[k1.body, k2.body, k3.body, k4.body]);
            state.body = s.body.moved(&body, h);
            state.body.ned_from_body = state.body.ned_from_body.normalized();
            if let Some(contact) = &mut contact {
                contact.settle(&s.body, &state.body);
            }
        }
    }

    /// Readings of perfect sensors now.
    fn true_readings(&self, state: &PlantState) -> Readings {
        let (position_ned, velocity_ned) = self.measured_motion(&state.body);
        Readings {
            position_ned,
            velocity_ned,
            attitude: state.body.ned_from_body.to_euler(),
            body_rates: state.body.body_rates,
            specific_force: self.context.specific_force,
            battery_voltage: self.context.battery.battery_voltage,
        }
    }

    /// Readings of the sensors now, before their noise; once per step.
    pub(crate) fn sense(&mut self, state: &PlantState) -> Readings {
        let view = self
            .context
            .view(&state.body, &self.turning(&state.thrust), &self.thrust_rate);
        let at = self.context.moment(&state.body, &state.thrust, &view);
        let mut readings = self.true_readings(state);
        self.set.readings(&at, &mut readings);
        let constants = &self.context.constants;
        constants.corrupt(&mut readings, self.context.angular_acceleration);
        self.readings.push(readings);
        let late = |age: f64, pick: fn(&Readings) -> Vector3| {
            let (newer, older, weight) = self.readings.around(age);
            let (newer, older) = (pick(newer), pick(older));
            [0, 1, 2].map(|i| newer[i] + weight * (older[i] - newer[i]))
        };
        Readings {
            position_ned: late(constants.position_latency_s, |r| r.position_ned),
            velocity_ned: late(constants.velocity_latency_s, |r| r.velocity_ned),
            attitude: self.late_attitude(constants.attitude_latency_s),
            body_rates: late(constants.imu_latency_s, |r| r.body_rates),
            specific_force: late(constants.imu_latency_s, |r| r.specific_force),
            battery_voltage: readings.battery_voltage,
        }
    }

    /// Angles are interpolated on the short way round, so that a yaw that passes ±π stays one.
    fn late_attitude(&self, age: f64) -> Vector3 {
        let (newer, older, weight) = self.readings.around(age);
        [0, 1, 2].map(|i| {
            let away = older.attitude[i] - newer.attitude[i];
            let turn = 2.0 * std::f64::consts::PI;
            newer.attitude[i] + weight * (away - turn * libm::round(away / turn))
        })
    }
}

/// R of Eq. 2, rows first.
fn rotation(q: Quaternion) -> [Vector3; 3] {
    let [w, x, y, z] = q.0;
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

/// Rᵀ v.
fn transposed(r: &[Vector3; 3], v: Vector3) -> Vector3 {
    [0, 1, 2].map(|i| r[0][i] * v[0] + r[1][i] * v[1] + r[2][i] * v[2])
}

fn dot(a: Vector3, b: Vector3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
