//! One flight: reference, pilot, world and sensors in a closed loop, and its log.
//!
//! Conventions of the log, the canonical ones: 400 Hz; row k has the state at t_k and the duty in force from t_k on; the
//! accelerometer of row k is the specific force at t_k; the first row is t_1 = 2.5 ms. The pilot sees
//! the measurements before any sensor fault; a sensor fault changes the log only. A latency delays truth and noise together.

use crate::catalogue::{self, Place};
use crate::error::{BlindError, Result};
use crate::hidden::{Active, Hidden};
use crate::pilot::{Pilot, Seen};
use crate::random::Stream;
use crate::script::{ReferenceWalk, Script};
use crate::vehicle::Vehicle;
use crate::world::{StepEnd, World};
use nalgebra::{Matrix3, Vector3};

/// s per row.
pub const STEP: f64 = 0.0025;
/// Standard deviations of Table 4: m, m/s, rad, rad/s, m/s²; and of the voltage, V.
const POSITION_NOISE: f64 = 7.848e-4;
const VELOCITY_NOISE: f64 = 0.0078;
const ATTITUDE_NOISE: f64 = 5.5192e-4;
const RATES_NOISE: f64 = 0.0055;
const ACCEL_NOISE: f64 = 0.0785;
const VOLTAGE_NOISE: f64 = 0.010;
/// Half width of the rotors' lift bias, N (RMSE of the fit of blade b, Table 1).
const LIFT_BIAS: f64 = 0.010_756;

/// Of rotors that idle on the ground.
const IDLE_DUTY: f64 = 0.08;

/// What is flown.
#[derive(Debug, Clone)]
pub struct FlightPlan {
    /// Nominal vehicle.
    pub vehicle: Vehicle,
    /// Reference.
    pub script: Script,
    /// s.
    pub duration: f64,
    /// Key of every random stream.
    pub seed: u64,
    /// What is hidden.
    pub effects: Vec<Hidden>,
    /// Small deviations of the other parameters, as effects; empty: none.
    pub clutter: Vec<Hidden>,
    /// Times Table 4.
    pub noise_scale: f64,
    /// Factor on the white force and torque that represent everything that is not modelled.
    pub disturbance: f64,
    /// Charge at the start; `None`: drawn from 50 to 100 %.
    pub state_of_charge: Option<f64>,
    /// Time on the ground with idling rotors before the script begins, s; `None`: in the air.
    pub idle_s: Option<f64>,
}

impl FlightPlan {
    /// A healthy flight in the air, with ordinary noise and a charge that is drawn.
    pub fn new(vehicle: Vehicle, script: Script, duration: f64, seed: u64) -> Self {
        Self {
            vehicle,
            script,
            duration,
            seed,
            effects: Vec::new(),
            clutter: Vec::new(),
            noise_scale: 1.0,
            disturbance: 1.0,
            state_of_charge: None,
            idle_s: None,
        }
    }
}

/// The truth, hidden from the diagnosis.
#[derive(Debug, Clone)]
pub struct Nuisances {
    /// N, one per rotor.
    pub lift_biases: Vec<f64>,
    /// Charge at the start.
    pub state_of_charge: f64,
}

/// One row of the log.
#[derive(Debug, Clone, Default)]
pub struct Row {
    /// s.
    pub time: f64,
    /// m, NED.
    pub position: Vector3<f64>,
    /// m/s, NED.
    pub velocity: Vector3<f64>,
    /// rad, yaw in (−π, π].
    pub euler: Vector3<f64>,
    /// rad/s.
    pub rates: Vector3<f64>,
    /// m/s².
    pub accel: Vector3<f64>,
    /// 0…1.
    pub duties: Vec<f64>,
    /// V.
    pub voltage: f64,
}

/// Truth of one sample: the state at t_k.
struct Truth {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    euler: Vector3<f64>,
    rates: Vector3<f64>,
    end: StepEnd,
    voltage: f64,
    current: f64,
}

/// Noise of one sample, drawn once and seen by pilot and log alike.
struct Noise {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    euler: Vector3<f64>,
    rates: Vector3<f64>,
    accel: Vector3<f64>,
    voltage: f64,
}

struct NoiseStreams([Stream; 6], f64);

impl NoiseStreams {
    fn new(seed: u64, scale: f64) -> Self {
        let names = ["position", "velocity", "attitude", "rates", "accel", "voltage"];
        Self(names.map(|name| Stream::new(seed, name)), scale)
    }

    fn draw(&mut self) -> Noise {
        let Self([p, v, e, w, a, volt], scale) = self;
        Noise {
            position: *scale * POSITION_NOISE * p.normal3(),
            velocity: *scale * VELOCITY_NOISE * v.normal3(),
            euler: *scale * ATTITUDE_NOISE * e.normal3(),
            rates: *scale * RATES_NOISE * w.normal3(),
            accel: *scale * ACCEL_NOISE * a.normal3(),
            voltage: *scale * VOLTAGE_NOISE * volt.normal(),
        }
    }
}

/// The nuisances of a seed.
pub fn draw_nuisances(seed: u64, rotors: usize, state_of_charge: Option<f64>) -> Nuisances {
    let mut bias = Stream::new(seed, "lift-bias");
    let mut charge = Stream::new(seed, "charge");
    Nuisances {
        lift_biases: (0..rotors).map(|_| bias.between(-LIFT_BIAS, LIFT_BIAS)).collect(),
        state_of_charge: state_of_charge.unwrap_or_else(|| charge.between(0.5, 1.0)),
    }
}

/// Flies a plan and returns the rows of its log.
pub fn fly(plan: &FlightPlan) -> Result<(Vec<Row>, Nuisances)> {
    let rotors = plan.vehicle.rotors.len();
    for effect in plan.effects.iter().chain(&plan.clutter) {
        effect.check(rotors)?;
    }
    let nuisances = draw_nuisances(plan.seed, rotors, plan.state_of_charge);
    let steps = (plan.duration / STEP).round() as usize;
    let mut pilot = Pilot::new(&plan.vehicle, STEP)
        .ok_or_else(|| BlindError::input("vehicle", "the rotors cannot produce thrust and three torques"))?;
    let start = Vector3::new(plan.script.start_north_m, 0.0, -plan.script.start_height_m);
    let biases = nuisances.lift_biases.clone();
    let mut world = World::new(&plan.vehicle, start, biases, nuisances.state_of_charge, plan.seed, STEP)
        .with_disturbance(plan.disturbance);
    if plan.idle_s.is_some() {
        world = world.on_the_ground();
    }
    let mut walk = ReferenceWalk::new(&plan.script, STEP);
    let mut streams = NoiseStreams::new(plan.seed, plan.noise_scale);

    let all: Vec<Hidden> = plan.effects.iter().chain(&plan.clutter).cloned().collect();
    let mut onsets: Vec<f64> = all.iter().filter_map(|effect| effect.onset_s).collect();
    onsets.sort_by(f64::total_cmp);
    let mut active = Active::at(0.0, &all, rotors);
    let mut truths: Vec<Truth> = Vec::with_capacity(steps);
    let mut noises: Vec<Noise> = Vec::with_capacity(steps);
    let mut commands: Vec<Vec<f64>> = Vec::with_capacity(steps);
    let mut actives: Vec<(usize, Active)> = vec![(0, active.clone())];
    let mut end = StepEnd::default();
    for k in 0..steps {
        let time = k as f64 * STEP;
        let moves = all
            .iter()
            .any(|effect| effect.profile.is_some() && effect.active_at(time));
        if moves || onsets.first().is_some_and(|&onset| time >= onset) {
            onsets.retain(|&onset| onset > time);
            active = Active::at(time, &all, rotors);
            actives.push((k, active.clone()));
        }
        let truth = Truth {
            position: world.position,
            velocity: world.velocity,
            euler: world.euler(),
            rates: world.rates,
            end,
            voltage: world.voltage,
            current: world.current,
        };
        let noise = streams.draw();
        let seen = Seen {
            position: truth.position + noise.position,
            velocity: truth.velocity + noise.velocity,
            euler: truth.euler + noise.euler,
            rates: truth.rates + noise.rates,
        };
        let mut duties = vec![0.0; rotors];
        if plan.idle_s.is_some_and(|idle| time < idle) {
            duties.fill(IDLE_DUTY);
        } else {
            pilot.command(&seen, &walk.advance(), &mut duties);
        }
        end = world.step(&duties, &active);
        let lost = if !world.position.norm().is_finite() || world.position.norm() > 500.0 {
            Some("the vehicle left the room")
        } else if world.position.z > 0.3 {
            Some("the vehicle went through the ground")
        } else if world.attitude[(2, 2)] < 0.2 {
            Some("the vehicle tipped over")
        } else {
            None
        };
        if let Some(reason) = lost {
            return Err(BlindError::FlightLost { time_s: time, reason });
        }
        truths.push(truth);
        noises.push(noise);
        commands.push(duties);
    }
    unwrap_yaw(&mut truths);
    let hover_current = plan.vehicle.hover_current();
    let rows = (1..steps)
        .map(|k| {
            let place = actives.partition_point(|(from, _)| *from <= k) - 1;
            logged(k, &truths, &noises, &commands, (&actives[place].1, hover_current))
        })
        .collect();
    Ok((rows, nuisances))
}

/// So that a latency interpolates headings across ±π.
fn unwrap_yaw(truths: &mut [Truth]) {
    let turn = std::f64::consts::TAU;
    let mut before = 0.0;
    for truth in truths {
        truth.euler.z -= turn * ((truth.euler.z - before) / turn).round();
        before = truth.euler.z;
    }
}

/// Truth `delay` s before sample k by linear interpolation, with the noise of the nearest sample.
fn late<'a>(
    k: usize,
    delay: f64,
    truths: &[Truth],
    noises: &'a [Noise],
    value: impl Fn(&Truth) -> Vector3<f64>,
    noise: impl Fn(&'a Noise) -> Vector3<f64>,
) -> Vector3<f64> {
    let place = (k as f64 - delay / STEP).max(1.0);
    let before = place as usize;
    let share = place - before as f64;
    let after = (before + 1).min(k.max(1));
    let nearest = place.round() as usize;
    (1.0 - share) * value(&truths[before]) + share * value(&truths[after]) + noise(&noises[nearest])
}

/// The heading of a magnetometer in a field of the vehicle's own (forward, right, over the earth's horizontal field), rad.
fn magnetic_heading(yaw: f64, own: [f64; 2]) -> f64 {
    let (east, north) = libm::sincos(yaw);
    libm::atan2(-(own[1] - east), north + own[0])
}

/// The row of sample k, including sensor faults; given the current that the vehicle draws in hover, A.
fn logged(
    k: usize,
    truths: &[Truth],
    noises: &[Noise],
    commands: &[Vec<f64>],
    (active, hover_current): (&Active, f64),
) -> Row {
    let get = |delay, value: fn(&Truth) -> Vector3<f64>, noise: fn(&Noise) -> Vector3<f64>| {
        late(k, delay, truths, noises, value, noise)
    };
    let none = |_: &Noise| Vector3::zeros();
    let truth = &truths[k];
    let turned = small_rotation(active.misalignment);

    let imu = active.imu_latency;
    let rates_true = get(imu, |t| t.rates, none);
    let alpha = get(imu, |t| t.end.angular_acceleration, none);
    let arm = active.lever_arm;
    let mut force =
        get(imu, |t| t.end.specific_force, none) + alpha.cross(&arm) + rates_true.cross(&rates_true.cross(&arm));
    force.z += active.vibration * truth.end.load * truth.end.load;
    let accel_noise = get(imu, |_| Vector3::zeros(), |n| n.accel);
    let accel = (1.0 + active.accel_scale) * (turned * force) + active.accel_bias + accel_noise;
    let rates_noise = get(imu, |_| Vector3::zeros(), |n| n.rates);
    let rates = (1.0 + active.gyro_scale) * (turned * rates_true) + active.gyro_bias + rates_noise;

    let mut euler = get(active.attitude_latency, |t| t.euler, |n| n.euler);
    euler.x += active.level_offset[0];
    euler.y += active.level_offset[1];
    if active.current_field != [0.0; 2] {
        let own = active.current_field.map(|share| share * truth.current / hover_current);
        // The magnetometer measures the true heading; estimator and noise are added.
        euler.z += magnetic_heading(truth.euler.z, own) - truth.euler.z;
    }
    euler.z += active.heading_offset;
    let turn = std::f64::consts::TAU;
    euler.z -= turn * (euler.z / turn).round();

    let mut duties = commands[k].clone();
    if let Some((first, second)) = active.swapped {
        duties.swap(first, second);
    }
    Row {
        time: k as f64 * STEP,
        position: get(active.position_latency, |t| t.position, |n| n.position),
        velocity: get(active.velocity_latency, |t| t.velocity, |n| n.velocity),
        euler,
        rates,
        accel,
        duties,
        voltage: (1.0 + active.voltage_gain) * truth.voltage + active.voltage_offset + noises[k].voltage,
    }
}

/// Measured = m × true added to true: the IMU is turned by a small angle.
fn small_rotation(m: Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() + m.cross_matrix()
}

/// Whether an effect makes the log wrong rather than the physics.
pub fn is_log_fault(effect: &Hidden) -> bool {
    catalogue::kind(&effect.id).is_some_and(|kind| kind.place == Place::Sensor)
}
