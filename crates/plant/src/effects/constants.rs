//! Every constant of the chain that an effect may change, and the parts of the chain that use them.
//!
//! Neutral is the nominal vehicle: [`Constants::nominal`]. Sums over rotors run over the first [`Constants::rotor_count`] entries.
//! Where the vehicle document is silent on the rotors (radius, speed), F550 values are scaled by the hover thrust at equal disc
//! loading and tip speed.

use rotortwin_flight_core::MAX_ROTORS;

use super::readings::Readings;
use super::wrench::Wrench;
use crate::error::Refusal;
use crate::powertrain::battery::Battery;
use crate::vector::{Vector3, cross};
use crate::vehicle::model::{SpinDirection, VehicleModel};

/// Hover thrust of a rotor of the F550, N, to which the two figures below belong.
const F550_HOVER_THRUST_N: f64 = 1.55 * 9.81 / 6.0;
/// Rotor radius of the F550 (9.4 inch propeller), m.
const F550_ROTOR_RADIUS_M: f64 = 0.12;
/// c_L of the F550's rotors, N·s²: Ω_h = √(f_h/c_L) = 556 rad/s. Assumed; the paper gives none.
const F550_THRUST_COEFFICIENT: f64 = 8.2e-6;
/// Air density of the momentum theory, kg/m³.
const AIR_DENSITY: f64 = 1.225;

/// Constants of one vehicle, effects included.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Constants {
    /// Rotors in use; the entries behind are 0.
    pub rotor_count: usize,
    /// f_h: thrust of a rotor in hover of the nominal vehicle, N.
    pub hover_thrust_n: f64,
    /// Ω_h, rad/s.
    pub hover_rotor_speed_rad_s: f64,
    /// λ: yaw torque of a rotor over its drag torque, per rate of the logarithm of its thrust, s.
    pub rotor_reaction_s: f64,
    /// k_d of the document, kg/s: drag of all rotors across their axis at hover speed.
    pub rotor_drag_kg_s: f64,
    /// R, m.
    pub rotor_radius_m: f64,
    /// v_h = √(f_h/2ρπR²): induced velocity in hover, m/s.
    pub hover_induced_velocity_m_s: f64,

    /// m, kg.
    pub mass_kg: f64,
    /// g, m/s².
    pub gravity_m_s2: f64,
    /// J with products of inertia, kg·m², body.
    pub inertia_body_kg_m2: [Vector3; 3],
    /// Centre of mass minus the nominal one, m, body.
    pub centre_of_mass_m: Vector3,
    /// l_i from the nominal centre of mass, m, body.
    pub rotor_position_body: [Vector3; MAX_ROTORS],
    /// +1 counter-clockwise seen from above (yaw torque to the right), −1 clockwise.
    pub rotor_spin: [f64; MAX_ROTORS],
    /// c_D/c_L of each rotor, m.
    pub moment_ratio_m: [f64; MAX_ROTORS],
    /// t_a: tilt towards the tangent (clockwise seen from above), rad.
    pub rotor_tilt_tangential: [f64; MAX_ROTORS],
    /// t_b: tilt away from the centre, rad.
    pub rotor_tilt_radial: [f64; MAX_ROTORS],

    /// Factor on Eq. 19.
    pub rotor_gain: [f64; MAX_ROTORS],
    /// Added to the static lift while the duty is above 0, N.
    pub rotor_bias_n: [f64; MAX_ROTORS],
    /// τ while the thrust rises, s.
    pub thrust_lag_up_s: f64,
    /// τ while it falls, s.
    pub thrust_lag_down_s: f64,
    /// Share of the lag that acts on rotor speed instead of thrust: 0 thrust, 1 speed.
    pub speed_domain_share: f64,
    /// d: age of the command that acts, s.
    pub command_delay_s: f64,
    /// u₀: duty below which nothing turns, fraction.
    pub dead_zone: f64,
    /// u_max: duty above which nothing is gained, fraction; 1 if the ESC uses all of it.
    pub duty_limit: f64,
    /// Resistance of ESC and motor in series, Ω: the rotor sees V − R I_i.
    pub esc_resistance_ohm: f64,

    /// V₀: resting voltage of the nominal battery at half charge, V, to which laws of the voltage refer.
    pub reference_voltage_v: f64,
    /// R_in of the pack, Ω.
    pub internal_resistance_ohm: f64,
    /// R₁ of a Thevenin pair, Ω.
    pub rc_resistance_ohm: f64,
    /// T₁ = R₁C₁, s.
    pub rc_time_s: f64,
    /// Q, Ah.
    pub capacity_ah: f64,
    /// Added to the charge at the start, fraction.
    pub charge_offset: f64,
    /// k_P, W/N^1.5.
    pub power_coefficient_w_per_n15: f64,

    /// w without gusts, m/s, NED.
    pub wind_ned_m_s: Vector3,
    /// k_t of Eq. 1, kg/s.
    pub linear_drag_kg_s: f64,
    /// k_r of Eq. 1, N·m·s.
    pub angular_drag_nms: f64,
    /// k_z: damping of the yaw beyond k_r, N·m·s.
    pub yaw_drag_nms: f64,
    /// z_d: height of the drag centre over the centre of mass, m.
    pub drag_centre_height_m: f64,
    /// a: drag forward minus that sideways, over their mean.
    pub drag_anisotropy: f64,

    /// Accelerometer: added, m/s², body.
    pub accelerometer_bias_m_s2: Vector3,
    /// Accelerometer: (1 + s) is the factor.
    pub accelerometer_scale: f64,
    /// Gyroscope: added, rad/s, body.
    pub gyro_bias_rad_s: Vector3,
    /// Gyroscope: (1 + s) is the factor.
    pub gyro_scale: f64,
    /// m of a small rotation of the IMU: readings become a + m × a, rad.
    pub imu_misalignment_rad: Vector3,
    /// Accelerometer minus centre of mass, m, body.
    pub imu_lever_arm_m: Vector3,
    /// Added to roll and pitch, rad.
    pub level_offset_rad: [f64; 2],
    /// Added to yaw, rad.
    pub heading_offset_rad: f64,
    /// g of V_m = (1 + g) V + o.
    pub voltage_gain: f64,
    /// o, V.
    pub voltage_offset_v: f64,
    /// Age of accelerometer and gyroscope, s.
    pub imu_latency_s: f64,
    /// Age of the attitude, s.
    pub attitude_latency_s: f64,
    /// Age of the velocity, s.
    pub velocity_latency_s: f64,
    /// Age of the position, s.
    pub position_latency_s: f64,
}

/// Ω_h, rad/s, of a rotor that carries `hover_thrust_n`: tip speed and disc loading of the F550's.
pub fn hover_rotor_speed_rad_s(hover_thrust_n: f64) -> f64 {
    let scale = (hover_thrust_n / F550_HOVER_THRUST_N).sqrt();
    (F550_HOVER_THRUST_N / F550_THRUST_COEFFICIENT).sqrt() / scale
}

impl Constants {
    /// The vehicle as its document has it.
    pub fn nominal(vehicle: &VehicleModel) -> Self {
        let placements = vehicle.rotors.layout.placements();
        let count = placements.len();
        let hover_thrust = vehicle.body.mass_kg * vehicle.body.gravity_m_s2 / count as f64;
        let scale = (hover_thrust / F550_HOVER_THRUST_N).sqrt();
        let radius = vehicle.rotors.radius_m.unwrap_or(F550_ROTOR_RADIUS_M * scale);
        let zero = [0.0; MAX_ROTORS];
        let mut constants = Self {
            rotor_count: count,
            hover_thrust_n: hover_thrust,
            hover_rotor_speed_rad_s: (vehicle.rotors.hover_speed_rad_s)
                .unwrap_or_else(|| hover_rotor_speed_rad_s(hover_thrust)),
            rotor_reaction_s: vehicle.rotors.reaction_s,
            rotor_drag_kg_s: vehicle.rotors.drag_kg_s,
            rotor_radius_m: radius,
            hover_induced_velocity_m_s: (hover_thrust / (2.0 * AIR_DENSITY * std::f64::consts::PI * radius * radius))
                .sqrt(),
            mass_kg: vehicle.body.mass_kg,
            gravity_m_s2: vehicle.body.gravity_m_s2,
            inertia_body_kg_m2: [[0.0; 3]; 3],
            centre_of_mass_m: [0.0; 3],
            rotor_position_body: [[0.0; 3]; MAX_ROTORS],
            rotor_spin: zero,
            moment_ratio_m: zero,
            rotor_tilt_tangential: zero,
            rotor_tilt_radial: zero,
            rotor_gain: zero,
            rotor_bias_n: zero,
            thrust_lag_up_s: vehicle.rotors.thrust_lag_s,
            thrust_lag_down_s: vehicle.rotors.thrust_lag_s,
            speed_domain_share: 0.0,
            command_delay_s: 0.0,
            dead_zone: 0.0,
            duty_limit: 1.0,
            esc_resistance_ohm: 0.0,
            reference_voltage_v: Battery::new(&vehicle.battery).open_circuit_voltage(0.5),
            internal_resistance_ohm: vehicle.battery.internal_resistance_ohm,
            rc_resistance_ohm: 0.0,
            rc_time_s: 1.0,
            capacity_ah: vehicle.battery.capacity_ah,
            charge_offset: 0.0,
            power_coefficient_w_per_n15: vehicle.battery.power_coefficient_w_per_n15,
            wind_ned_m_s: [0.0; 3],
            linear_drag_kg_s: vehicle.body.linear_drag_kg_s,
            angular_drag_nms: vehicle.body.angular_drag_nms,
            yaw_drag_nms: 0.0,
            drag_centre_height_m: 0.0,
            drag_anisotropy: 0.0,
            accelerometer_bias_m_s2: [0.0; 3],
            accelerometer_scale: 0.0,
            gyro_bias_rad_s: [0.0; 3],
            gyro_scale: 0.0,
            imu_misalignment_rad: [0.0; 3],
            imu_lever_arm_m: [0.0; 3],
            level_offset_rad: [0.0; 2],
            heading_offset_rad: 0.0,
            voltage_gain: 0.0,
            voltage_offset_v: 0.0,
            imu_latency_s: 0.0,
            attitude_latency_s: 0.0,
            velocity_latency_s: 0.0,
            position_latency_s: 0.0,
        };
        for (axis, &j) in vehicle.body.inertia_body_kg_m2.iter().enumerate() {
            constants.inertia_body_kg_m2[axis][axis] = j;
        }
        for (i, placement) in placements.iter().enumerate() {
            constants.rotor_position_body[i] = placement.position_body;
            constants.rotor_spin[i] = if placement.spin == SpinDirection::Ccw {
                1.0
            } else {
                -1.0
            };
            constants.moment_ratio_m[i] = placement.moment_ratio;
            constants.rotor_gain[i] = 1.0;
        }
        constants
    }

    /// Duty that acts, fraction, from a commanded one: max(min(u, u_max) − u₀, 0).
    #[inline]
    pub fn effective_duty(&self, duty: f64) -> f64 {
        (duty.min(self.duty_limit) - self.dead_zone).max(0.0)
    }

    /// f' of a rotor, N/s, on its way from `thrust` to the static `lift`, N.
    ///
    /// (1 − s)(g − f)/τ + s · 2√f (√g − √f)/τ, the second term being the lag of the speed Ω = √(f/c_L).
    #[inline]
    pub fn thrust_rate(&self, lift: f64, thrust: f64) -> f64 {
        let lag = if lift > thrust {
            self.thrust_lag_up_s
        } else {
            self.thrust_lag_down_s
        };
        let linear = lift - thrust;
        if self.speed_domain_share == 0.0 {
            return linear / lag;
        }
        // A rotor at rest is started by a small thrust: √f alone would keep it at rest for ever.
        let root = thrust.max(1e-6 * self.hover_thrust_n).sqrt();
        let speed = 2.0 * root * (lift.max(0.0).sqrt() - root);
        ((1.0 - self.speed_domain_share) * linear + self.speed_domain_share * speed) / lag
    }

    /// Force and torque of the rotor thrusts about the centre of mass: Σ f_i n_i, Σ (l_i − c) × f_i n_i + s_i κ_i f_i e₃.
    ///
    /// n_i = −e₃ + t_a e_tan + t_b e_rad for small tilts: a positive radial tilt pushes outwards.
    #[inline]
    pub fn rotor_wrench(&self, thrust: &[f64]) -> Wrench {
        let mut sum = [0.0; 6];
        for (i, &f) in thrust.iter().enumerate().take(self.rotor_count) {
            add(&mut sum, &self.unit_wrench(i), f);
        }
        wrench_of(sum)
    }

    /// A wrench with its drag, and the linear and angular friction of Eq. 1, added to force and torque; the drag is (1 + a/2) times itself
    /// forward and (1 − a/2) times sideways, and acts `z_d` above the centre of mass.
    #[inline]
    pub fn closed(&self, wrench: &Wrench, air_velocity_body: Vector3, body_rates: Vector3) -> Wrench {
        let uneven = 0.5 * self.drag_anisotropy;
        let shape = [1.0 + uneven, 1.0 - uneven, 1.0];
        let drag = [0, 1, 2].map(|i| shape[i] * (wrench.drag_body[i] - self.linear_drag_kg_s * air_velocity_body[i]));
        let up = self.drag_centre_height_m;
        let mut torque = wrench.torque_body;
        // r × F with r = (0, 0, −z_d).
        torque[0] += up * drag[1];
        torque[1] -= up * drag[0];
        for i in 0..3 {
            torque[i] -= self.angular_drag_nms * body_rates[i];
        }
        torque[2] -= self.yaw_drag_nms * body_rates[2];
        Wrench {
            force_body: [0, 1, 2].map(|i| wrench.force_body[i] + drag[i]),
            torque_body: torque,
            drag_body: [0.0; 3],
        }
    }

    /// What [`Self::rotor_wrench`] needs of the vehicle, for many thrusts.
    pub fn allocation(&self) -> Allocation {
        let mut units = [[0.0; 6]; MAX_ROTORS];
        for (i, unit) in units.iter_mut().enumerate().take(self.rotor_count) {
            *unit = self.unit_wrench(i);
        }
        Allocation { units }
    }

    /// Force and torque of 1 N of rotor `i`.
    #[inline]
    fn unit_wrench(&self, i: usize) -> [f64; 6] {
        let c = self.centre_of_mass_m;
        let [x, y, z] = self.rotor_position_body[i];
        let [x, y, z] = [x - c[0], y - c[1], z - c[2]];
        let drag = self.rotor_spin[i] * self.moment_ratio_m[i];
        let (tangential, radial) = (self.rotor_tilt_tangential[i], self.rotor_tilt_radial[i]);
        if tangential == 0.0 && radial == 0.0 {
            return [0.0, 0.0, -1.0, -y, x, drag];
        }
        let [ex, ey] = self.rotor_direction(i);
        let (fx, fy) = (radial * ex - tangential * ey, radial * ey + tangential * ex);
        [fx, fy, -1.0, -y - z * fy, x + z * fx, drag + x * fy - y * fx]
    }

    /// Unit vector from the nominal centre to rotor `i` in the rotor plane; forward for a rotor at the centre.
    #[inline]
    pub fn rotor_direction(&self, i: usize) -> [f64; 2] {
        let [x, y, _] = self.rotor_position_body[i];
        let length = (x * x + y * y).sqrt();
        if length > 0.0 {
            [x / length, y / length]
        } else {
            [1.0, 0.0]
        }
    }

    /// True if the vehicle itself has an air force, through which a wind can act.
    pub fn has_drag(&self) -> bool {
        self.linear_drag_kg_s > 0.0 || self.rotor_drag_kg_s > 0.0
    }

    /// Distance of rotor `i` from the nominal centre in the rotor plane, m.
    #[inline]
    pub fn arm_length(&self, i: usize) -> f64 {
        let [x, y, _] = self.rotor_position_body[i];
        (x * x + y * y).sqrt()
    }

    /// True readings as the sensors give them: lever arm, misalignment, scale, bias, offsets. Latencies are the caller's.
    ///
    /// `angular_acceleration` in rad/s², body.
    pub fn corrupt(&self, readings: &mut Readings, angular_acceleration: Vector3) {
        let omega = readings.body_rates;
        let arm = self.imu_lever_arm_m;
        if arm != [0.0; 3] {
            let tangential = cross(angular_acceleration, arm);
            let centripetal = cross(omega, cross(omega, arm));
            for i in 0..3 {
                readings.specific_force[i] += tangential[i] + centripetal[i];
            }
        }
        let m = self.imu_misalignment_rad;
        if m != [0.0; 3] {
            for vector in [&mut readings.specific_force, &mut readings.body_rates] {
                let turned = cross(m, *vector);
                for i in 0..3 {
                    vector[i] += turned[i];
                }
            }
        }
        for i in 0..3 {
            readings.specific_force[i] =
                (1.0 + self.accelerometer_scale) * readings.specific_force[i] + self.accelerometer_bias_m_s2[i];
            readings.body_rates[i] = (1.0 + self.gyro_scale) * readings.body_rates[i] + self.gyro_bias_rad_s[i];
        }
        readings.attitude[0] += self.level_offset_rad[0];
        readings.attitude[1] += self.level_offset_rad[1];
        readings.attitude[2] += self.heading_offset_rad;
        readings.battery_voltage = (1.0 + self.voltage_gain) * readings.battery_voltage + self.voltage_offset_v;
    }

    /// The inverse of [`Self::corrupt`]: readings as the sensors would give them without their errors. The battery voltage stays.
    pub fn restore(&self, readings: &mut Readings, angular_acceleration: Vector3) {
        // (1 + [m]×)⁻¹ v = (v − m × v + m (m·v))/(1 + |m|²).
        let m = self.imu_misalignment_rad;
        let square = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
        let straight = |v: Vector3| {
            let (along, across) = (m[0] * v[0] + m[1] * v[1] + m[2] * v[2], cross(m, v));
            [0, 1, 2].map(|i| (v[i] - across[i] + m[i] * along) / (1.0 + square))
        };
        for i in 0..3 {
            readings.specific_force[i] =
                (readings.specific_force[i] - self.accelerometer_bias_m_s2[i]) / (1.0 + self.accelerometer_scale);
            readings.body_rates[i] = (readings.body_rates[i] - self.gyro_bias_rad_s[i]) / (1.0 + self.gyro_scale);
        }
        if m != [0.0; 3] {
            readings.specific_force = straight(readings.specific_force);
            readings.body_rates = straight(readings.body_rates);
        }
        let arm = self.imu_lever_arm_m;
        if arm != [0.0; 3] {
            let omega = readings.body_rates;
            let tangential = cross(angular_acceleration, arm);
            let centripetal = cross(omega, cross(omega, arm));
            for i in 0..3 {
                readings.specific_force[i] -= tangential[i] + centripetal[i];
            }
        }
        readings.attitude[0] -= self.level_offset_rad[0];
        readings.attitude[1] -= self.level_offset_rad[1];
        readings.attitude[2] -= self.heading_offset_rad;
    }

    /// True if the inertial sensors and the attitude read the truth; their latencies excluded.
    pub fn sensors_are_exact(&self) -> bool {
        self.accelerometer_bias_m_s2 == [0.0; 3]
            && self.accelerometer_scale == 0.0
            && self.gyro_bias_rad_s == [0.0; 3]
            && self.gyro_scale == 0.0
            && self.imu_misalignment_rad == [0.0; 3]
            && self.imu_lever_arm_m == [0.0; 3]
            && self.level_offset_rad == [0.0; 2]
            && self.heading_offset_rad == 0.0
    }

    /// Refuses constants with which no vehicle can exist.
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        let refuse = |reason: String| Err(Refusal::new("", reason));
        if !(self.mass_kg.is_finite() && self.mass_kg > 0.0) {
            return refuse(format!(
                "expected a mass above 0, the effects together make it {} kg",
                self.mass_kg
            ));
        }
        let j = nalgebra::Matrix3::from_fn(|row, column| self.inertia_body_kg_m2[row][column]);
        if j.cholesky().is_none() {
            return refuse("expected an inertia that is positive definite, the effects together make it none".into());
        }
        for (name, lag) in [("up", self.thrust_lag_up_s), ("down", self.thrust_lag_down_s)] {
            // Below 5 ms a step of 2.5 ms would not resolve the lag.
            if !(0.005..=1.0).contains(&lag) {
                return refuse(format!(
                    "expected a lag from 0.005 to 1 s, the effects together make it {lag} s ({name})"
                ));
            }
        }
        if !(self.linear_drag_kg_s >= 0.0 && self.linear_drag_kg_s.is_finite()) {
            return refuse(format!(
                "expected a linear drag of 0 or more, the effects together make it {} kg/s",
                self.linear_drag_kg_s
            ));
        }
        if !(-2.0..=2.0).contains(&self.drag_anisotropy) {
            return refuse(format!(
                "expected a drag of 0 or more forward and sideways, so a difference of 2 times their mean or less; the effects together \
                 make it {}",
                self.drag_anisotropy
            ));
        }
        if !(self.capacity_ah > 0.0 && self.capacity_ah.is_finite()) {
            return refuse(format!(
                "expected a capacity above 0, the effects together make it {} Ah",
                self.capacity_ah
            ));
        }
        if !(0.0..=10.0).contains(&self.internal_resistance_ohm) || !(0.0..=10.0).contains(&self.rc_resistance_ohm) {
            return refuse(
                "expected resistances of the battery from 0 to 10 Ω, the effects together leave that range".into(),
            );
        }
        if !(0.0..=1.0).contains(&self.speed_domain_share) {
            return refuse(format!(
                "expected a share of the speed-domain lag from 0 to 1, got {}",
                self.speed_domain_share
            ));
        }
        if !(self.duty_limit > self.dead_zone && self.duty_limit <= 1.0 && self.dead_zone >= 0.0) {
            return refuse("expected a dead zone below the saturation of the duty, both from 0 to 1".into());
        }
        let latencies = [
            self.command_delay_s,
            self.imu_latency_s,
            self.attitude_latency_s,
            self.velocity_latency_s,
            self.position_latency_s,
        ];
        if let Some(bad) = latencies.iter().find(|d| !(0.0..=2.0).contains(*d)) {
            return refuse(format!(
                "expected delays from 0 to 2 s, the effects together make one {bad} s"
            ));
        }
        Ok(())
    }
}

/// Force and torque that each rotor produces per 1 N.
#[derive(Debug, Clone, Copy)]
pub struct Allocation {
    units: [[f64; 6]; MAX_ROTORS],
}

impl Allocation {
    /// See [`Constants::rotor_wrench`].
    #[inline]
    pub fn wrench(&self, thrust: &[f64]) -> Wrench {
        let mut sum = [0.0; 6];
        for (unit, &f) in self.units.iter().zip(thrust) {
            add(&mut sum, unit, f);
        }
        wrench_of(sum)
    }
}

#[inline]
fn add(sum: &mut [f64; 6], unit: &[f64; 6], f: f64) {
    for (sum, unit) in sum.iter_mut().zip(unit) {
        *sum += unit * f;
    }
}

#[inline]
fn wrench_of([x, y, z, roll, pitch, yaw]: [f64; 6]) -> Wrench {
    Wrench {
        force_body: [x, y, z],
        torque_body: [roll, pitch, yaw],
        ..Wrench::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::vehicle;

    #[test]
    fn prop_restoring_undoes_what_sensors_do() {
        let constants = Constants {
            accelerometer_bias_m_s2: [0.2, -0.1, 0.3],
            accelerometer_scale: 0.03,
            gyro_bias_rad_s: [0.01, -0.02, 0.005],
            gyro_scale: -0.02,
            imu_misalignment_rad: [0.02, -0.05, 0.03],
            imu_lever_arm_m: [0.05, -0.02, 0.01],
            level_offset_rad: [0.02, -0.01],
            heading_offset_rad: 0.1,
            ..Constants::nominal(&vehicle("f550"))
        };
        let truth = Readings {
            position_ned: [1.0, 2.0, -3.0],
            velocity_ned: [0.5, -0.25, 0.125],
            attitude: [0.1, -0.2, 1.5],
            body_rates: [1.5, -0.7, 0.3],
            specific_force: [0.4, -0.6, -11.0],
            battery_voltage: 11.1,
        };
        let turning = [12.0, -7.0, 3.0];
        let mut read = truth;
        constants.corrupt(&mut read, turning);
        constants.restore(&mut read, turning);
        let pairs = [
            (read.attitude, truth.attitude),
            (read.body_rates, truth.body_rates),
            (read.specific_force, truth.specific_force),
        ];
        for (read, truth) in pairs {
            for i in 0..3 {
                // Rounding of a dozen operations.
                assert!((read[i] - truth[i]).abs() < 1e-13, "{read:?} against {truth:?}");
            }
        }
    }
}
