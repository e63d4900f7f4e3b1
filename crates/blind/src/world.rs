//! The world of the generator: rigid body, rotors, battery, hidden effects. Shares no code with the product's plant.
//!
//! Integrator: five sub-steps per 2.5 ms; explicit midpoint rule on velocity and body rates, the exponential map on the rotation
//! matrix (Lie-group midpoint), trapezoidal rule on the rotor lag, semi-implicit Euler on the small oscillators. Frames: NED, FRD.
//! A white force and torque (`FORCE_FLOOR`, `TORQUE_FLOOR`, body frame, constant over a step) represents everything
//! unmodelled.

use crate::hidden::Active;
use crate::random::Stream;
use crate::vehicle::Vehicle;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Sub-steps per sample.
const SUBSTEPS: usize = 5;
/// White force and torque per sample, N and N m.
const FORCE_FLOOR: f64 = 0.05;
const TORQUE_FLOOR: f64 = 0.005;
/// c_L, N s²: thrust to speed, for every effect that reads a rotor speed.
const THRUST_COEFFICIENT: f64 = 8.2e-6;
/// Rotor radius for ground, ceiling and the induced velocity, m, and density of the air, kg/m³.
const ROTOR_RADIUS: f64 = 0.12;
const AIR_DENSITY: f64 = 1.225;

/// Feet: forward or back, left or right, and below the centre of mass, m; how deep the weight presses them, m; damping ratio; friction.
const FOOT: [f64; 2] = [0.15, FOOT_DEPTH];
/// Height of the centre of mass on the ground, m.
pub const FOOT_DEPTH: f64 = 0.12;
const FOOT_SINK: f64 = 0.002;
const FOOT_DAMPING: f64 = 0.7;
const FOOT_FRICTION: f64 = 0.6;
/// Slip at which friction is close to its maximum, m/s.
const FOOT_SLIP: f64 = 0.02;

/// Rotor state.
#[derive(Debug, Clone, Default)]
struct RotorState {
    /// N, after the lag, before aerodynamic gains.
    thrust: f64,
    /// N, static thrust with blade, bias and voltage of the last sub-step.
    target: f64,
    /// Duty after backlash.
    played_duty: f64,
    /// s left of a dropout.
    dropout: f64,
}

/// State of the world.
#[derive(Debug, Clone)]
pub struct World {
    vehicle: Vehicle,
    /// m, NED, centre of mass.
    pub position: Vector3<f64>,
    /// m/s, NED.
    pub velocity: Vector3<f64>,
    /// NED from body.
    pub attitude: Matrix3<f64>,
    /// rad/s, body.
    pub rates: Vector3<f64>,
    rotors: Vec<RotorState>,
    biases: Vec<f64>,
    state_of_charge: f64,
    pair_voltage: f64,
    /// V and A at the terminals.
    pub voltage: f64,
    /// A.
    pub current: f64,
    gust: Vector3<f64>,
    slung: [Vector3<f64>; 2],
    /// Of the sub-step before, m/s², down.
    vertical_acceleration: f64,
    slosh: [Vector3<f64>; 2],
    flex: [Vector3<f64>; 2],
    /// Duties in force from step k − 63 on, newest last; for the delay.
    past_duties: Vec<Vec<f64>>,
    tether_point: Vector3<f64>,
    time: f64,
    /// kg that have left.
    left: f64,
    /// s per sample.
    pub step: f64,
    floor: Stream,
    /// Times the white force and torque.
    floor_scale: f64,
    /// It has feet and a ground at height 0.
    stands: bool,
    gust_noise: Stream,
    dropout_noise: Stream,
}

/// What an inertial sensor feels at the end of a step.
#[derive(Debug, Clone, Copy, Default)]
pub struct StepEnd {
    /// Specific force, body, m/s², with the white force of the step that ends.
    pub specific_force: Vector3<f64>,
    /// Angular acceleration at that instant, body, rad/s².
    pub angular_acceleration: Vector3<f64>,
    /// Σf/(m g).
    pub load: f64,
}

/// Force and torque on the body at one instant.
struct Loads {
    force: Vector3<f64>,
    torque: Vector3<f64>,
    /// Torque of the rotors alone, before flexible arms.
    rotor_torque: Vector3<f64>,
}

impl World {
    /// Trimmed at a place: level, hover thrust on every rotor.
    pub fn new(
        vehicle: &Vehicle,
        start: Vector3<f64>,
        biases: Vec<f64>,
        state_of_charge: f64,
        seed: u64,
        step: f64,
    ) -> Self {
        let hover = vehicle.hover_thrust();
        let rotor = RotorState {
            thrust: hover,
            target: hover,
            ..RotorState::default()
        };
        let n = vehicle.rotors.len();
        let mut world = Self {
            vehicle: vehicle.clone(),
            position: start,
            velocity: Vector3::zeros(),
            attitude: Matrix3::identity(),
            rates: Vector3::zeros(),
            rotors: vec![rotor; n],
            biases,
            state_of_charge,
            pair_voltage: 0.0,
            voltage: 0.0,
            current: 0.0,
            gust: Vector3::zeros(),
            slung: [Vector3::zeros(); 2],
            vertical_acceleration: 0.0,
            slosh: [Vector3::zeros(); 2],
            flex: [Vector3::zeros(); 2],
            past_duties: Vec::new(),
            tether_point: start + Vector3::new(2.0, 1.0, 0.0),
            time: 0.0,
            left: 0.0,
            step,
            floor: Stream::new(seed, "floor"),
            floor_scale: 1.0,
            stands: false,
            gust_noise: Stream::new(seed, "gust"),
            dropout_noise: Stream::new(seed, "dropout"),
        };
        world.update_battery(&Active::none(n), 0.0);
        world
    }

    /// The same with a share of the white force and torque, the same draws.
    pub fn with_disturbance(mut self, share: f64) -> Self {
        self.floor_scale = share;
        self
    }

    /// The same on its feet on the ground, rotors at rest.
    pub fn on_the_ground(mut self) -> Self {
        self.stands = true;
        self.position.z = -FOOT_DEPTH + FOOT_SINK;
        for rotor in &mut self.rotors {
            *rotor = RotorState::default();
        }
        self
    }

    /// Force and torque of the ground on four feet, body: springs that the weight presses by [`FOOT_SINK`], dampers, friction of the slip.
    fn feet(
        &self,
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        attitude: &Matrix3<f64>,
        rates: Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let share = 0.25 * self.vehicle.mass;
        let stiffness = share * self.vehicle.gravity / FOOT_SINK;
        let damping = 2.0 * FOOT_DAMPING * (stiffness * share).sqrt();
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        for (x, y) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let foot = Vector3::new(x * FOOT[0], y * FOOT[0], FOOT[1]);
            let depth = (position + attitude * foot).z;
            if depth <= 0.0 {
                continue;
            }
            let speed = velocity + attitude * rates.cross(&foot);
            let normal = (stiffness * depth + damping * speed.z).max(0.0);
            let slip = Vector3::new(speed.x, speed.y, 0.0);
            let friction = FOOT_FRICTION * normal / slip.norm().hypot(FOOT_SLIP) * slip;
            let push = attitude.transpose() * (Vector3::new(0.0, 0.0, -normal) - friction);
            force += push;
            torque += foot.cross(&push);
        }
        (force, torque)
    }

    /// One step of 2.5 ms with these duties in force.
    pub fn step(&mut self, duties: &[f64], active: &Active) -> StepEnd {
        self.past_duties.push(duties.to_vec());
        if self.past_duties.len() > 64 {
            self.past_duties.remove(0);
        }
        let force_floor = self.floor_scale * FORCE_FLOOR * self.floor.normal3();
        let torque_floor = self.floor_scale * TORQUE_FLOOR * self.floor.normal3();
        let h = self.step / SUBSTEPS as f64;
        let inertia = self.inertia(active);
        let Some(inverse) = inertia.try_inverse() else {
            return StepEnd::default();
        };
        let gravity = Vector3::new(0.0, 0.0, self.vehicle.gravity);
        let mut end = StepEnd::default();
        let mut reaction = 0.0;
        let full = self.vehicle.mass * (1.0 + active.mass);
        for sub in 0..SUBSTEPS {
            // In the middle of the sub-step.
            let mass = full - self.left - 0.5 * h * active.mass_rate;
            self.left += h * active.mass_rate;
            self.update_battery(active, h);
            self.update_wind(active, h);
            let speeds_before: Vec<f64> = self.rotor_speeds();
            let half = self.advance_rotors(sub, active, h);
            self.slung[0] += 0.5 * h * self.slung[1];
            let speeds_after = self.rotor_speeds();
            reaction = (0..self.rotors.len())
                .map(|i| self.vehicle.rotors[i].yaw_sign * (speeds_after[i] - speeds_before[i]) / h)
                .sum::<f64>()
                * active.reaction;

            let loads = self.loads(active, &half, self.position, self.velocity, &self.attitude, self.rates);
            let acceleration =
                |loads: &Loads, attitude: &Matrix3<f64>| attitude * ((loads.force + force_floor) / mass) + gravity;
            let angular = |loads: &Loads, rates: &Vector3<f64>| {
                let torque = loads.torque + torque_floor + Vector3::new(0.0, 0.0, reaction);
                inverse * (torque - rates.cross(&(inertia * rates)))
            };
            let a1 = acceleration(&loads, &self.attitude);
            let w1 = angular(&loads, &self.rates);
            let velocity_half = self.velocity + 0.5 * h * a1;
            let rates_half = self.rates + 0.5 * h * w1;
            let attitude_half = self.attitude * Rotation3::new(0.5 * h * self.rates).into_inner();
            let position_half = self.position + 0.5 * h * self.velocity;
            let loads = self.loads(active, &half, position_half, velocity_half, &attitude_half, rates_half);
            let a2 = acceleration(&loads, &attitude_half);
            let w2 = angular(&loads, &rates_half);
            self.position += h * velocity_half;
            self.velocity += h * a2;
            self.attitude *= Rotation3::new(h * rates_half).into_inner();
            self.rates += h * w2;
            self.vertical_acceleration = a2.z;
            self.advance_oscillators(active, a2, loads.rotor_torque, h);
            self.time += h;
        }
        self.orthonormalise();
        // What is logged of this instant belongs to this instant, not to the middle or the start of the last sub-step.
        self.update_battery(active, 0.0);
        let thrusts: Vec<f64> = self.rotors.iter().map(|rotor| rotor.thrust).collect();
        let loads = self.loads(
            active,
            &thrusts,
            self.position,
            self.velocity,
            &self.attitude,
            self.rates,
        );
        end.specific_force = (loads.force + force_floor) / (full - self.left);
        let torque = loads.torque + torque_floor + Vector3::new(0.0, 0.0, reaction);
        end.angular_acceleration = inverse * (torque - self.rates.cross(&(inertia * self.rates)));
        end.load = thrusts.iter().sum::<f64>() / (self.vehicle.mass * self.vehicle.gravity);
        end
    }

    fn inertia(&self, active: &Active) -> Matrix3<f64> {
        let j: [f64; 3] = std::array::from_fn(|k| self.vehicle.inertia[k] * (1.0 + active.inertia[k]));
        // Entries of the tensor, as in the catalogue; not the integrals ∫xy dm with the opposite sign.
        let [xy, xz, yz] = [active.products.x, active.products.y, active.products.z];
        Matrix3::new(j[0], xy, xz, xy, j[1], yz, xz, yz, j[2])
    }

    fn rotor_speeds(&self) -> Vec<f64> {
        self.rotors
            .iter()
            .map(|rotor| (rotor.thrust.max(0.0) / THRUST_COEFFICIENT).sqrt())
            .collect()
    }

    /// Terminal voltage under the present rotor power, charge and warmth; advances charge and RC pair by `h`.
    fn update_battery(&mut self, active: &Active, h: f64) {
        let power: f64 = self
            .rotors
            .iter()
            .map(|rotor| {
                let f = rotor.thrust.max(0.0);
                self.vehicle.power_coefficient * f * f.sqrt()
            })
            .sum();
        let chart = &self.vehicle.open_circuit_voltage;
        let place = self.state_of_charge.clamp(0.0, 1.0) * (chart.len() - 1) as f64;
        let knot = (place as usize).min(chart.len() - 2);
        let open = chart[knot] + (chart[knot + 1] - chart[knot]) * (place - knot as f64) - self.pair_voltage;
        let mut resistance = self.vehicle.internal_resistance + active.internal_resistance;
        if active.cold_warming > 0.0 {
            resistance *= libm::exp(0.037 * active.cold_below * libm::exp(-self.time / active.cold_warming));
        }
        // V = V_oc − R P/V, by three Newton steps from V_oc.
        let mut voltage = open;
        for _ in 0..3 {
            voltage -=
                (voltage - open + resistance * power / voltage) / (1.0 - resistance * power / (voltage * voltage));
        }
        self.voltage = voltage;
        self.current = power / voltage;
        let capacity = 3600.0 * self.vehicle.capacity_ah * (1.0 + active.capacity);
        self.state_of_charge -= h * self.current / capacity;
        if active.pair_time > 0.0 {
            self.pair_voltage += h * (active.pair_resistance * self.current - self.pair_voltage) / active.pair_time;
        }
    }

    fn update_wind(&mut self, active: &Active, h: f64) {
        if active.gust_sigma > 0.0 {
            let decay = libm::exp(-h / active.gust_correlation);
            let push = active.gust_sigma * (1.0 - decay * decay).sqrt();
            self.gust = decay * self.gust + push * self.gust_noise.normal3();
        } else {
            self.gust = Vector3::zeros();
        }
    }

    /// Duty in force over a sub-step, as a mean over it, `delay` s late.
    fn delayed_duty(&self, rotor: usize, sub: usize, delay: f64) -> f64 {
        let newest = self.past_duties.len() - 1;
        let substeps = SUBSTEPS as f64;
        // The sub-step [sub, sub + 1) shifted back by the delay, in sub-steps from the start of the newest duty.
        let start = sub as f64 - delay / self.step * substeps;
        let block = (start / substeps).floor();
        let inside = start - block * substeps;
        let first_share = (substeps - inside).min(1.0);
        let duty = |offset: f64| {
            let index = newest as f64 + offset;
            self.past_duties[index.clamp(0.0, newest as f64) as usize][rotor]
        };
        let first = duty(block);
        if first_share >= 1.0 {
            first
        } else {
            first_share * first + (1.0 - first_share) * duty(block + 1.0)
        }
    }

    /// Static thrust under another law: T = f_h (T/f_h)^(1+e) (V₀/V)^e (V/V₀)^k with the slope's error e and the exponent k of the
    /// voltage, about hover and the resting voltage at half charge. By logarithms, another order of operations than the product's.
    fn thrust_by_law(&self, thrust: f64, active: &Active) -> f64 {
        if (active.curve_shape == 0.0 && active.voltage_exponent == 0.0) || thrust <= 0.0 {
            return thrust;
        }
        let slope = libm::log(thrust / self.vehicle.hover_thrust());
        let volts = libm::log(self.voltage / self.vehicle.resting_voltage());
        thrust * libm::exp(active.curve_shape * (slope - volts) + active.voltage_exponent * volts)
    }

    /// Advances the rotor thrusts by one sub-step and returns the thrusts at its middle.
    fn advance_rotors(&mut self, sub: usize, active: &Active, h: f64) -> Vec<f64> {
        let mut middle = Vec::with_capacity(self.rotors.len());
        for i in 0..self.rotors.len() {
            let mut duty = self.delayed_duty(i, sub, active.delay);
            if active.backlash > 0.0 {
                // Play operator: the effective duty follows only when the command leaves its band.
                let play = 0.5 * active.backlash;
                let held = if self.rotors[i].played_duty > 0.0 {
                    self.rotors[i].played_duty
                } else {
                    duty
                };
                duty = held.clamp(duty - play, duty + play);
                self.rotors[i].played_duty = duty;
            }
            duty = (duty - active.dead_zone).max(0.0);
            if active.saturation > 0.0 {
                duty = duty.min(active.saturation);
            }
            // Each rotor's own current, as in the catalogue: the drop grows with its own thrust.
            let own = self.rotors[i].thrust.max(0.0);
            let own_current = self.vehicle.power_coefficient * own * own.sqrt() / self.voltage;
            let voltage = self.voltage - active.esc_resistance * own_current;
            let mut gain = (1.0 + active.thrust_scale[i]) * (1.0 + active.thrust_scale_all);
            if active.fade_time > 0.0 {
                gain *= 1.0 - active.fade * (self.time / active.fade_time) * (self.time / active.fade_time);
            }
            if let Some((rotor, loss, interval)) = active.dropouts
                && rotor == i
            {
                self.rotors[i].dropout -= h;
                if self.dropout_noise.unit() < h / interval {
                    self.rotors[i].dropout = 0.06;
                }
                if self.rotors[i].dropout > 0.0 {
                    gain *= 1.0 - loss;
                }
            }
            let lift = self.thrust_by_law(self.vehicle.static_thrust(duty, voltage), active);
            let target = (lift * gain + self.biases[i]).max(0.0);
            let state = &mut self.rotors[i];
            let before = state.thrust;
            let direction = if target >= before { -1.0 } else { 1.0 };
            let lag = self.vehicle.thrust_lag * (1.0 + active.lag) * (1.0 + direction * active.lag_asymmetry);
            let after = if active.speed_lag > 0.0 {
                let (speed, goal) = (before.max(0.0).sqrt(), target.sqrt());
                let next = speed + (goal - speed) * h / (lag + 0.5 * h);
                let linear = before + (target - before) * h / (lag + 0.5 * h);
                active.speed_lag * next * next + (1.0 - active.speed_lag) * linear
            } else {
                // Trapezoidal rule with the target of this sub-step held.
                before + (target - before) * h / (lag + 0.5 * h)
            };
            state.target = target;
            state.thrust = after;
            middle.push(0.5 * (before + after));
        }
        middle
    }

    /// Force and torque on the body, body frame, without gravity.
    fn loads(
        &self,
        active: &Active,
        thrusts: &[f64],
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        attitude: &Matrix3<f64>,
        rates: Vector3<f64>,
    ) -> Loads {
        let n = thrusts.len();
        let air = attitude.transpose() * (velocity - active.wind - self.gust);
        let height = -position.z;
        let hover = self.vehicle.hover_thrust();
        // Momentum theory; rounded to 4.8 m/s it would hide a loss that is 2 % smaller than requested.
        let induced = (hover / (2.0 * AIR_DENSITY * std::f64::consts::PI * ROTOR_RADIUS * ROTOR_RADIUS)).sqrt();
        let down_earth = attitude.transpose() * Vector3::new(0.0, 0.0, 1.0);
        let mut force = Vector3::zeros();
        let mut torque = Vector3::zeros();
        let mut speed_ratio_sum = 0.0;
        for (i, rotor) in self.vehicle.rotors.iter().enumerate() {
            let longer = 1.0 + active.arm_share;
            let place = Vector3::new(longer * rotor.position.x, longer * rotor.position.y, rotor.position.z);
            let local = air + rates.cross(&place);
            let ratio = (thrusts[i].max(0.0) / hover).sqrt();
            speed_ratio_sum += ratio;
            let mut thrust = thrusts[i];
            thrust += active.translational_lift * (local.x * local.x + local.y * local.y);
            thrust += active.axial_inflow * ratio * local.z;
            if active.vortex_ring > 0.0 {
                let sink = (local.z / induced - 0.5).max(0.0);
                thrust *= 1.0 - (active.vortex_ring * sink * sink).min(0.6);
            }
            if active.ground_effect != 0.0 {
                let rotor_height = (height - place.dot(&down_earth)).max(0.1);
                let near = ROTOR_RADIUS / (4.0 * rotor_height);
                thrust *= 1.0 + active.ground_effect * (1.0 / (1.0 - near * near) - 1.0);
            }
            if active.ceiling_effect > 0.0 {
                let gap = (active.ceiling_height - height).max(0.0);
                let near = ROTOR_RADIUS / (gap + ROTOR_RADIUS);
                thrust *= 1.0 / (1.0 - (active.ceiling_effect * near * near).min(0.9));
            }
            let arm = place.xy().norm();
            if active.interference != 0.0 && arm > 0.0 {
                let behind = -(local.x * place.x + local.y * place.y) / arm;
                thrust *= 1.0 - active.interference * behind.max(0.0);
            }
            let radial = if arm > 0.0 { place / arm } else { Vector3::x() };
            let tangential = Vector3::z().cross(&radial);
            let axis = -Vector3::z() + active.tilt_tangential[i] * tangential + active.tilt_radial[i] * radial;
            let push = thrust * axis;
            force += push;
            torque += (place - active.centre).cross(&push);
            let yaw_sign = rotor.yaw_sign * (1.0 - 2.0 * active.reversed[i]);
            let own = 1.0 + active.rotor_moment_ratio[i];
            torque.z += yaw_sign * rotor.moment_ratio * (1.0 + active.moment_ratio) * own * thrust;
            torque.x += active.flapping * ratio * local.y;
            torque.y -= active.flapping * ratio * local.x;
            // Angular momentum of a rotor that turns counter-clockwise from above points up: −z.
            let momentum = -rotor.yaw_sign * active.gyroscopic * (thrusts[i].max(0.0) / THRUST_COEFFICIENT).sqrt();
            torque.x -= rates.y * momentum;
            torque.y += rates.x * momentum;
        }
        let rotor_torque = torque;
        if active.flex_share > 0.0 {
            torque += active.flex_share * (self.flex[0] - rotor_torque);
        }
        let level = Vector3::new(air.x, air.y, 0.0);
        // Of each drag, how much there is of it forward, sideways and down.
        let along = Vector3::new(1.0 + 0.5 * active.drag_share, 1.0 - 0.5 * active.drag_share, 1.0);
        let rotor_drag = -active.rotor_drag * speed_ratio_sum / n as f64 * level.component_mul(&along);
        force += rotor_drag;
        torque += Vector3::new(0.0, 0.0, -active.drag_height).cross(&rotor_drag);
        let speed = air.norm();
        let resistance = active.parasitic_drag * speed + active.linear_drag + self.vehicle.linear_drag;
        force -= resistance * air.component_mul(&along);
        if active.threshold_drag > 0.0 && speed > active.threshold_speed {
            let over = speed - active.threshold_speed;
            force -= active.threshold_drag * over * over * over / speed * air;
        }
        torque -= (active.rotational_damping + self.vehicle.angular_drag) * rates;
        torque.z -= active.yaw_damping * rates.z;

        let mut outside = Vector3::zeros();
        if active.wall != 0.0 {
            let (east, north) = libm::sincos(active.wall_azimuth);
            let gap = (active.wall_distance - north * position.x - east * position.y).max(0.0);
            let near = ROTOR_RADIUS / (gap + ROTOR_RADIUS);
            let pull = active.wall * near * near * thrusts.iter().sum::<f64>();
            outside += pull * Vector3::new(north, east, 0.0);
        }
        if active.slung_mass > 0.0 {
            // Cable angles q follow the vehicle's acceleration; the cable pulls the vehicle towards the load.
            let pull = active.slung_mass * self.vehicle.gravity;
            outside += pull * Vector3::new(self.slung[0].x, self.slung[0].y, 0.0);
            outside.z += active.slung_weight * (self.vehicle.gravity - self.vertical_acceleration);
        }
        if active.tether > 0.0 {
            let away = self.tether_point - position;
            let stretch = away.norm() - active.tether_slack;
            if stretch > 0.0 {
                outside += active.tether * stretch / away.norm() * away;
            }
        }
        force += attitude.transpose() * outside;
        if self.stands {
            let (push, twist) = self.feet(position, velocity, attitude, rates);
            force += push;
            torque += twist;
        }
        if active.slosh_mass > 0.0 {
            let w = std::f64::consts::TAU * active.slosh_frequency;
            let spring = w * w * self.slosh[0] + 2.0 * active.slosh_damping * w * self.slosh[1];
            force += active.slosh_mass * Vector3::new(spring.x, spring.y, 0.0);
        }
        if active.imbalance > 0.0 {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * active.imbalance_frequency * self.time);
            force += active.imbalance * Vector3::new(cos, sin, 0.0);
        }
        if active.stuck_moment != 0.0 {
            let yaw = libm::atan2(attitude[(1, 0)], attitude[(0, 0)]);
            torque.x += active.stuck_moment * if yaw >= 0.0 { 1.0 } else { -1.0 };
        }
        Loads {
            force,
            torque,
            rotor_torque,
        }
    }

    /// Slung load (in the middle of its drift) and sloshing tank, driven by the body's acceleration, and flexible arms, driven by the
    /// rotors' torque.
    fn advance_oscillators(&mut self, active: &Active, acceleration: Vector3<f64>, rotor_torque: Vector3<f64>, h: f64) {
        if active.slung_mass > 0.0 {
            let [angle, rate] = &mut self.slung;
            let mut drive = acceleration / active.slung_length;
            drive.z = 0.0;
            *rate += h * (-self.vehicle.gravity / active.slung_length * *angle - active.slung_damping * *rate - drive);
            *angle += 0.5 * h * *rate;
        }
        if active.slosh_mass > 0.0 {
            let w = std::f64::consts::TAU * active.slosh_frequency;
            let body = self.attitude.transpose() * (acceleration - Vector3::new(0.0, 0.0, self.vehicle.gravity));
            let [place, rate] = &mut self.slosh;
            *rate += h * (-w * w * *place - 2.0 * active.slosh_damping * w * *rate - Vector3::new(body.x, body.y, 0.0));
            *place += h * *rate;
        }
        if active.flex_share > 0.0 {
            let w = std::f64::consts::TAU * active.flex_frequency;
            let [angle, rate] = &mut self.flex;
            *rate += h * (w * w * (rotor_torque - *angle) - 2.0 * active.flex_damping * w * *rate);
            *angle += h * *rate;
        }
    }

    /// Gram–Schmidt on the rows: the exponential map keeps the matrix orthonormal but for rounding.
    fn orthonormalise(&mut self) {
        let x = self.attitude.column(0).into_owned();
        let x = x / x.norm();
        let y = self.attitude.column(1).into_owned();
        let y = y - x * x.dot(&y);
        let y = y / y.norm();
        self.attitude = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    }

    /// Roll, pitch, yaw, rad.
    pub fn euler(&self) -> Vector3<f64> {
        let r = &self.attitude;
        Vector3::new(
            libm::atan2(r[(2, 1)], r[(2, 2)]),
            libm::asin((-r[(2, 0)]).clamp(-1.0, 1.0)),
            libm::atan2(r[(1, 0)], r[(0, 0)]),
        )
    }
}
