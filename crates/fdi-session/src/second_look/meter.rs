//! Momentum that healthy rotors do not explain, block by block.
//!
//! The same quantity as in the engine (`rotortwin_flight_core::fdi::sequential`), but without the losses that the
//! engine already knows: here a loss stays visible as long as it lasts. Axes F_z, M_x, M_y, M_z, each divided by its
//! longest lever, so that all are thrusts at a rotor. A block is a window of the engine; means over a block are
//! compared with those of the previous block.
//!
//! *Duties of a slow stream.* Between two samples Δ apart the duties went somewhere that the log does not hold. If they
//! made their change at any moment of the interval, equally likely, the impulse along the straight line between the
//! samples is off by a deviation of ΔF Δ/√12. With the change dF of each step dt along that line, its variance per step is
//!
//! ```text
//!  dF² Δ³/(12 dt)      (over the interval: ΔF² Δ²/12)
//! ```
//! and acts as a white force ([`Block::untold`]): large in a manoeuvre, small in a hover.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::FdiConfig;
use rotortwin_flight_core::fdi::nominal_thrust::static_thrust;
use rotortwin_flight_core::fdi::residual::{BodyMomentum, RigidBody};
use rotortwin_flight_core::frames::{BodyToNed, Vec3};
use rotortwin_flight_core::signals::{Measurement, NavState};

/// F_z, M_x, M_y, M_z.
pub(crate) const AXES: usize = 4;

/// Integrals in addition to the defect: wrench (4), its sensitivity to ln τ (4), vertical path, time, gyroscopic torque
/// (3), air (4 of roll and of pitch), thrust of every rotor.
const INTEGRALS: usize = THRUST + MAX_ROTORS;
const PATH: usize = 8;
const TIME: usize = 9;
const GYROSCOPIC: usize = 10;
const AIR: usize = 13;
const THRUST: usize = AIR + 2 * AIRS;

/// Signals per axis with which the force of the air changes.
pub(crate) const AIRS: usize = 4;

/// Places of the heading's among them.
const HEADING: usize = 2;

/// Standard deviations of what these make of a moment, share of a rotor's hover thrust at the levers: of 1 m/s, of
/// 1 rad/s, of a steady wind from each side.
pub(crate) fn air_spread(axis: usize) -> [f64; AIRS] {
    match axis {
        1 | 2 => [0.02, 0.05, 0.1, 0.1],
        _ => [0.0; AIRS],
    }
}

/// Axes of the two momenta whose product makes the gyroscopic torque about each body axis.
const OTHER_AXES: [[usize; 2]; 3] = [[2, 3], [3, 1], [1, 2]];

/// Result of one block of samples; of each quantity the change of its mean since the previous block.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Block {
    /// Momentum defect, N·s.
    pub defect: [f64; AXES],
    /// Time between the middles of the two blocks, s.
    pub elapsed: f64,
    /// ∫ lagged wrench, the vertical one without the weight, N·s.
    pub wrench: [f64; AXES],
    /// ∫ sensitivity of the lagged wrench to ln τ, N·s.
    pub lag_slope: [f64; AXES],
    /// ∫ vertical speed, m.
    pub path: f64,
    /// ∫ downward specific force along the rotors' axis, m/s: the negative defect per kg of mass missing from the
    /// model.
    pub specific: f64,
    /// ∫ √(J_b² + J_c²) ω_b ω_c of roll, pitch and yaw over the levers, N·s.
    pub gyroscopic: [f64; 3],
    /// ∫ of the signals with which the roll and pitch moments of the air change ([`air_of`]): m, rad, s, s.
    air: [[f64; AIRS]; 2],
    /// ∫ lagged thrust of each rotor if it were healthy, N·s.
    pub thrust: [f64; MAX_ROTORS],
    /// Variance of the impulse that slow duties leave open, (N·s)².
    pub untold: [f64; AXES],
    /// Mean square of the difference of neighbouring defects, (N·s)²: twice the noise of a sample.
    pub roughness: [f64; AXES],
    /// Samples.
    pub samples: f64,
}

impl Block {
    /// Momentum defect of an axis, N·s, and the variance of the impulse that slow duties leave open, (N·s)².
    pub(crate) fn measured(&self, axis: usize) -> [f64; 2] {
        [self.defect[axis], self.untold[axis]]
    }

    /// ∫ of the signals with which the moment of the air about an axis changes; 0 of the other axes.
    pub(crate) fn air_of(&self, axis: usize) -> [f64; AIRS] {
        match axis {
            1 | 2 => self.air[axis - 1],
            _ => [0.0; AIRS],
        }
    }

    /// ∫ cos ψ, ∫ sin ψ, s.
    pub(crate) fn heading(&self) -> [f64; 2] {
        [self.air[0][HEADING], self.air[0][HEADING + 1]]
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Lag {
    state: f64,
    /// ∂state/∂ln τ.
    slope: f64,
}

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct Meter {
    config: FdiConfig,
    body: RigidBody,
    period: f64,
    weight: f64,
    pub arm: [f64; AXES],
    gyroscopic_weight: [f64; 3],
    /// 1 − e^(−dt/τ), and its derivative with respect to ln τ; the same of the mean over a step.
    end: [f64; 2],
    mean: [f64; 2],
    lag: Option<[Lag; MAX_ROTORS]>,
    /// Δ³/(12 dt) of the duties' stream, s²; 0 if every sample has its own.
    untold_per_square: f64,
    /// Steady-state wrench at the last sample, over the levers, and sum of the squares of its changes, N².
    asked: Option<[f64; AXES]>,
    asked_changes: [f64; AXES],
    accounted: [f64; AXES],
    rate: [f64; AXES],
    last_drift: [f64; AXES],
    last_defect: Option<[f64; AXES]>,
    /// Vertical speed without specific force: integral, rate and its value at the last sample; and mean of its difference to the true one.
    coasting: [f64; 3],
    specific_sum: f64,
    integral_rate: [f64; INTEGRALS],
    integral: [f64; INTEGRALS],
    integral_sum: [f64; INTEGRALS],
    defect_sum: [f64; AXES],
    roughness: [f64; AXES],
    samples: f64,
}

impl Meter {
    pub(crate) fn new(config: &FdiConfig) -> Self {
        let n = config.geometry.rotor_count();
        let f = config.geometry.effectiveness();
        let arm: [f64; AXES] = std::array::from_fn(|axis| {
            f64::from(f[axis][..n].iter().fold(0.0f32, |most, x| most.max(x.abs()))).max(1e-6)
        });
        let x = f64::from(config.period) / f64::from(config.sequential.rotor_time_constant);
        let (decay, a) = ((-x).exp(), -(-x).exp_m1());
        Self {
            config: *config,
            body: RigidBody {
                mass: config.mass,
                inertia_body: config.inertia_body,
                gravity: config.gravity,
                linear_drag: config.linear_drag,
                angular_drag: config.angular_drag,
            },
            period: f64::from(config.period),
            weight: f64::from(config.mass) * f64::from(config.gravity),
            arm,
            gyroscopic_weight: std::array::from_fn(|k| {
                let [b, c] = OTHER_AXES[k].map(|axis| 1.0 / f64::from(config.inertia_body[axis - 1]));
                b.hypot(c) / arm[k + 1]
            }),
            end: [a, -x * decay],
            mean: [1.0 - a / x, (x * decay - a) / x],
            lag: None,
            untold_per_square: 0.0,
            asked: None,
            asked_changes: [0.0; AXES],
            accounted: [0.0; AXES],
            rate: [0.0; AXES],
            last_drift: [0.0; AXES],
            last_defect: None,
            coasting: [0.0; 3],
            specific_sum: 0.0,
            integral_rate: [0.0; INTEGRALS],
            integral: [0.0; INTEGRALS],
            integral_sum: [0.0; INTEGRALS],
            defect_sum: [0.0; AXES],
            roughness: [0.0; AXES],
            samples: 0.0,
        }
    }

    /// The duties come from a stream with this interval, s, longer than that of the samples.
    pub(crate) fn take_duty_interval(&mut self, interval_s: f64) {
        self.untold_per_square = interval_s.powi(3) / (12.0 * self.period);
    }

    /// Processes one sample that the engine has accepted.
    pub(crate) fn step(&mut self, input: &Measurement) {
        let n = self.config.geometry.rotor_count();
        let body = BodyMomentum::from_nav(&self.body, &input.nav);
        let (momentum, drift) = (body.momentum.map(f64::from), body.drift.map(f64::from));
        let speed = f64::from(body.vertical_speed);
        let pull = (drift[0] + f64::from(self.body.linear_drag) * speed) / f64::from(self.body.mass);
        let goal = static_thrust(&self.config.thrust_map, n, input).map(f64::from);
        self.take_asked(&goal);
        let lag = self.lag.get_or_insert_with(|| {
            (self.accounted, self.last_drift) = (momentum, drift);
            self.coasting = [speed, pull, pull];
            goal.map(|state| Lag { state, slope: 0.0 })
        });
        // The step before this sample: the drift was held, now its other end is known.
        let mut defect = [0.0; AXES];
        for axis in 0..AXES {
            self.accounted[axis] += 0.5 * self.period * (drift[axis] - self.last_drift[axis]);
            defect[axis] = (momentum[axis] - self.accounted[axis]) / self.arm[axis];
            self.defect_sum[axis] += defect[axis];
            if let Some(last) = self.last_defect {
                self.roughness[axis] += (defect[axis] - last[axis]).powi(2);
            }
        }
        self.coasting[0] += 0.5 * self.period * (pull - self.coasting[2]);
        self.specific_sum += speed - self.coasting[0];
        (self.coasting[1], self.coasting[2]) = (pull, pull);
        (self.last_drift, self.last_defect) = (drift, Some(defect));
        self.samples += 1.0;
        for k in 0..INTEGRALS {
            self.integral_sum[k] += self.integral[k];
        }
        // The step after it.
        let f = self.config.geometry.effectiveness();
        let (mut wrench, mut slope) = ([0.0; AXES], [0.0; AXES]);
        for rotor in 0..n {
            let lag = &mut lag[rotor];
            let gap = goal[rotor] - lag.state;
            let thrust = lag.state + gap * self.mean[0];
            let sensitivity = lag.slope * (1.0 - self.mean[0]) + gap * self.mean[1];
            lag.slope += gap * self.end[1] - lag.slope * self.end[0];
            lag.state += gap * self.end[0];
            self.integral_rate[THRUST + rotor] = thrust;
            for axis in 0..AXES {
                wrench[axis] += f64::from(f[axis][rotor]) * thrust;
                slope[axis] += f64::from(f[axis][rotor]) * sensitivity;
            }
        }
        for axis in 0..AXES {
            self.rate[axis] = drift[axis] + wrench[axis];
            self.integral_rate[axis] = wrench[axis] / self.arm[axis];
            self.integral_rate[AXES + axis] = slope[axis] / self.arm[axis];
        }
        self.integral_rate[0] += self.weight;
        self.integral_rate[PATH] = f64::from(body.vertical_speed);
        self.integral_rate[TIME] = 1.0;
        for k in 0..3 {
            let [b, c] = OTHER_AXES[k];
            self.integral_rate[GYROSCOPIC + k] = self.gyroscopic_weight[k] * momentum[b] * momentum[c];
        }
        for (to, signal) in self.integral_rate[AIR..]
            .iter_mut()
            .zip(air_of(&input.nav).as_flattened())
        {
            *to = *signal;
        }
        self.hold();
    }

    /// Counts the change of the wrench that the duties ask for.
    fn take_asked(&mut self, goal: &[f64; MAX_ROTORS]) {
        if self.untold_per_square == 0.0 {
            return;
        }
        let (f, n) = (self.config.geometry.effectiveness(), self.config.geometry.rotor_count());
        let asked: [f64; AXES] = std::array::from_fn(|axis| {
            let force: f64 = (0..n).map(|rotor| f64::from(f[axis][rotor]) * goal[rotor]).sum();
            force / self.arm[axis]
        });
        if let Some(before) = self.asked.replace(asked) {
            for axis in 0..AXES {
                self.asked_changes[axis] += (asked[axis] - before[axis]).powi(2);
            }
        }
    }

    /// The vehicle is heavier by this, kg, as of the middle of the last block, at which the next one starts. The effect
    /// of a load on the gyroscopic torque is ignored: its inertia is unknown.
    pub(crate) fn take_load(&mut self, mass: f64) {
        let weight = mass * f64::from(self.config.gravity);
        self.body.mass += mass as f32;
        self.weight += weight;
        self.accounted[0] += mass * self.coasting[0];
        self.last_drift[0] += mass * self.coasting[2];
        self.rate[0] += mass * self.coasting[1];
        self.integral[0] += weight / self.arm[0] * self.integral[TIME];
        self.integral_rate[0] += weight / self.arm[0];
    }

    /// One step at the rates of the last one: also for a lost or rejected sample.
    pub(crate) fn hold(&mut self) {
        self.coasting[0] += self.period * self.coasting[1];
        for axis in 0..AXES {
            self.accounted[axis] += self.period * self.rate[axis];
        }
        for k in 0..INTEGRALS {
            self.integral[k] += self.period * self.integral_rate[k];
        }
    }

    /// Means since the last block; `None` without a sample in between, in which case the block continues.
    pub(crate) fn close(&mut self) -> Option<Block> {
        if self.samples < 1.0 {
            return None;
        }
        let share = 1.0 / self.samples;
        let means = self.integral_sum.map(|sum| sum * share);
        for k in 0..INTEGRALS {
            self.integral[k] -= means[k];
        }
        let defect = self.defect_sum.map(|sum| sum * share);
        for axis in 0..AXES {
            self.accounted[axis] += defect[axis] * self.arm[axis];
            if let Some(last) = &mut self.last_defect {
                last[axis] -= defect[axis];
            }
        }
        let specific = self.specific_sum * share;
        self.coasting[0] += specific;
        self.specific_sum = 0.0;
        let block = Block {
            defect,
            elapsed: means[TIME],
            wrench: std::array::from_fn(|axis| means[axis]),
            lag_slope: std::array::from_fn(|axis| means[AXES + axis]),
            path: means[PATH],
            specific,
            gyroscopic: std::array::from_fn(|k| means[GYROSCOPIC + k]),
            air: std::array::from_fn(|axis| std::array::from_fn(|k| means[AIR + AIRS * axis + k])),
            thrust: std::array::from_fn(|rotor| means[THRUST + rotor]),
            untold: self.asked_changes.map(|sum| sum * self.untold_per_square),
            roughness: self.roughness.map(|sum| sum * share),
            samples: self.samples,
        };
        self.integral_sum = [0.0; INTEGRALS];
        self.defect_sum = [0.0; AXES];
        self.roughness = [0.0; AXES];
        self.asked_changes = [0.0; AXES];
        self.samples = 0.0;
        Some(block)
    }
}

/// Signals with which the roll and pitch moments of the air change, for a wind that stays the same over ground:
///
/// ```text
///  M_x: speed to the right, p, cos ψ, sin ψ     M_y: speed forward, q, cos ψ, sin ψ
/// ```
/// Flapping blades turn the vehicle in proportion to the airspeed in their disk (Hoffmann, Huang, Waslander and Tomlin,
/// AIAA 2007-6461), and rotors that climb lose lift, so that rates are damped. Without the rates, a speed would have to
/// explain the damping.
fn air_of(nav: &NavState) -> [[f64; AIRS]; 2] {
    let velocity = nav.velocity_ned;
    let body = BodyToNed::from_euler(nav.attitude).to_body(Vec3::new(velocity.x, velocity.y, 0.0));
    let (sin, cos) = f64::from(nav.attitude.yaw).sin_cos();
    let [p, q, _] = nav.body_rates.to_array().map(f64::from);
    [[f64::from(body.y), p, cos, sin], [f64::from(body.x), q, cos, sin]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_flight_core::signals::MotorCommand;
    use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};

    #[test]
    fn val_what_slow_duties_leave_open_is_that_of_a_change_at_any_moment_between_them() {
        let vehicle = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml");
        let documents = VehicleDocuments::load(vehicle).expect("shipped");
        let detectors = Detectors::new(documents, &DetectorSettings::default(), None).expect("a good configuration");
        let config = detectors.config();
        let at = |duty: f32| Measurement {
            command: MotorCommand {
                duty: std::array::from_fn(|rotor| if rotor < 6 { duty } else { 0.0 }),
            },
            battery_voltage: 16.0,
            ..Measurement::default()
        };
        let (from, to, steps) = (0.4, 0.404, 40_u8);
        let untold = |interval_s: Option<f64>| {
            let mut meter = Meter::new(config);
            if let Some(interval_s) = interval_s {
                meter.take_duty_interval(interval_s);
            }
            for step in 0..=steps {
                meter.step(&at(from + (to - from) * f32::from(step) / f32::from(steps)));
            }
            meter.close().expect("samples").untold
        };
        let force = |duty: f32| -> f64 {
            static_thrust(&config.thrust_map, 6, &at(duty))
                .map(f64::from)
                .iter()
                .sum()
        };
        let interval_s = f64::from(config.period) * f64::from(steps);
        let wanted = ((force(to) - force(from)) * interval_s).powi(2) / 12.0;
        let [vertical, moments @ ..] = untold(Some(interval_s));
        assert!((vertical - wanted).abs() < 0.01 * wanted, "{vertical} {wanted}");
        assert!(moments.iter().all(|moment| *moment < 1e-6 * wanted), "{moments:?}");
        assert_eq!(untold(None), [0.0; AXES]);
    }
}
