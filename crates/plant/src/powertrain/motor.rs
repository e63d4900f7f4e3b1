//! ESC and brushless motor with the rotor's speed as a state (Eqs. 4 and 10 to 18): an option in place of Eq. 19 and its lag.
//!
//! ```text
//!  V_esc = u (V − R_esc I)                                     Eq. 10
//!  I = (V_esc − K Ω)/R_mot = (u V − K Ω)/(R_mot + u R_esc)     Eq. 13, the inductance left out as there
//!  J Ω' = K (I − I₀) − B Ω − c_D Ω²                            Eqs. 12 and 14
//!  f = c_L Ω²,   d = c_D Ω²                                    Eq. 4
//! ```
//!
//! The battery gives Σ u_i I_i: the ESC takes the current while it switches through, and the motor drives it on in between. A duty that
//! falls faster than the rotor brakes it and charges the battery, as the equations have it; ESCs without active braking do not.
//!
//! No measured c_L of the paper is published. It follows from the blade's Eq. 19 at hover, where both models agree; elsewhere they
//! differ by their shapes. c_D is the rotor's moment ratio times c_L.

use serde::{Deserialize, Serialize};

use crate::error::{Refusal, in_range};
use crate::powertrain::blades::Blade;

/// `[rotors.motor]` of a vehicle document.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorModel {
    /// K_v, min⁻¹/V. K_e = K_t = K = 60/(2π K_v).
    pub speed_constant_rpm_v: f64,
    /// R_mot, Ω.
    pub winding_resistance_ohm: f64,
    /// R_esc, Ω.
    pub esc_resistance_ohm: f64,
    /// I₀, A.
    pub idle_current_a: f64,
    /// B, N·m·s.
    #[serde(default)]
    pub viscous_friction_nms: f64,
    /// J of motor bell and propeller about their axis, kg·m².
    pub inertia_kg_m2: f64,
}

impl MotorModel {
    /// The motor of `f550-motors`: T-Motor Air Gear 350 with the T9545 (§3.1). The paper prints K_v only, in the motor's name.
    pub const AIR_GEAR_350: Self = Self {
        speed_constant_rpm_v: 920.0,
        winding_resistance_ohm: 0.205,
        esc_resistance_ohm: 0.0,
        idle_current_a: 0.05,
        viscous_friction_nms: 0.0,
        inertia_kg_m2: 3.4e-5,
    };

    pub(crate) fn check(&self) -> Result<(), Refusal> {
        in_range(
            "speed_constant_rpm_v",
            self.speed_constant_rpm_v,
            10.0,
            50_000.0,
            "min⁻¹/V",
        )?;
        in_range("winding_resistance_ohm", self.winding_resistance_ohm, 1e-3, 10.0, "Ω")?;
        in_range("esc_resistance_ohm", self.esc_resistance_ohm, 0.0, 1.0, "Ω")?;
        in_range("idle_current_a", self.idle_current_a, 0.0, 20.0, "A")?;
        in_range("viscous_friction_nms", self.viscous_friction_nms, 0.0, 1e-2, "N·m·s")?;
        in_range("inertia_kg_m2", self.inertia_kg_m2, 1e-10, 1.0, "kg·m²")
    }

    /// K, V·s = N·m/A.
    pub fn back_emf_v_s(&self) -> f64 {
        60.0 / (std::f64::consts::TAU * self.speed_constant_rpm_v)
    }

    /// The motor with more resistance at its ESC, Ω, and `times` its inertia.
    pub(crate) fn changed(&self, esc_resistance_ohm: f64, times: f64) -> Self {
        Self {
            esc_resistance_ohm: self.esc_resistance_ohm + esc_resistance_ohm,
            inertia_kg_m2: self.inertia_kg_m2 * times,
            ..*self
        }
    }

    /// I, A, at a duty (fraction), the battery voltage V and the speed Ω, rad/s (Eqs. 10 and 13).
    #[inline]
    pub fn current(&self, duty: f64, voltage: f64, speed: f64) -> f64 {
        (duty * voltage - self.back_emf_v_s() * speed) / self.resistance(duty)
    }

    /// R_mot + u R_esc, Ω.
    #[inline]
    fn resistance(&self, duty: f64) -> f64 {
        self.winding_resistance_ohm + duty * self.esc_resistance_ohm
    }

    /// Ω', rad/s², under the load torque d, N·m (Eq. 12). Friction stops a rotor and does not turn it backwards.
    #[inline]
    pub fn acceleration(&self, duty: f64, voltage: f64, speed: f64, load: f64) -> f64 {
        let current = self.current(duty, voltage, speed);
        let torque = self.back_emf_v_s() * (current - self.idle_current_a) - self.viscous_friction_nms * speed - load;
        if speed <= 0.0 {
            return torque.max(0.0) / self.inertia_kg_m2;
        }
        torque / self.inertia_kg_m2
    }

    /// Ω', rad/s², without current.
    pub(crate) fn running_down(&self, speed: f64, load: f64) -> f64 {
        if speed <= 0.0 {
            return 0.0;
        }
        let friction = self.back_emf_v_s() * self.idle_current_a + self.viscous_friction_nms * speed;
        -(friction + load) / self.inertia_kg_m2
    }

    /// Ω = g_speed(u, c_D, V), rad/s: the steady speed (Eqs. 15 to 17), 0 where the motor does not start. `drag` is c_D, N·m·s².
    pub fn steady_speed(&self, duty: f64, voltage: f64, drag: f64) -> f64 {
        let back_emf = self.back_emf_v_s();
        let resistance = self.resistance(duty);
        // c_D Ω² + p Ω − q = 0.
        let p = back_emf * back_emf / resistance + self.viscous_friction_nms;
        let q = back_emf * (duty * voltage / resistance - self.idle_current_a);
        if q <= 0.0 {
            return 0.0;
        }
        // The form that does not cancel where c_D is small.
        2.0 * q / (p + (p * p + 4.0 * drag * q).sqrt())
    }

    /// The speed at which this motor holds a load of `torque` N·m steadily; `None` where the voltage does not suffice.
    fn speed_under(&self, duty: f64, voltage: f64, torque: f64) -> Option<f64> {
        let back_emf = self.back_emf_v_s();
        let resistance = self.resistance(duty);
        let speed = (back_emf * (duty * voltage / resistance - self.idle_current_a) - torque)
            / (back_emf * back_emf / resistance + self.viscous_friction_nms);
        (speed > 0.0).then_some(speed)
    }

    /// c_L, N·s², with which the steady lift at this duty and voltage is that of the blade's Eq. 19; `None` where the motor cannot turn so.
    /// `moment_ratio` is c_D/c_L of the rotor with its nominal blade, m.
    pub fn lift_coefficient(&self, blade: &Blade, duty: f64, voltage: f64, moment_ratio: f64) -> Option<f64> {
        let lift = blade.lift(duty, voltage);
        let speed = self.speed_under(duty, voltage, moment_ratio * blade.moment_ratio_factor * lift)?;
        (lift > 0.0).then(|| lift / (speed * speed))
    }

    /// Time constant of the speed about a steady speed, s: J/(K²/R + B + 2 c_D Ω).
    pub fn time_constant_s(&self, duty: f64, speed: f64, drag: f64) -> f64 {
        let back_emf = self.back_emf_v_s();
        self.inertia_kg_m2
            / (back_emf * back_emf / self.resistance(duty) + self.viscous_friction_nms + 2.0 * drag * speed)
    }

    /// V at the terminals, V, of a battery with an inner voltage `source` and a resistance R_in, while it drives rotors of these duties and
    /// speeds: V = source − R_in Σ u_i I_i, which is linear in V.
    pub fn terminal_voltage(
        &self,
        source: f64,
        internal_resistance: f64,
        rotors: impl Iterator<Item = (f64, f64)>,
    ) -> f64 {
        let (mut driven, mut back) = (0.0, 0.0);
        for (duty, speed) in rotors {
            let per = duty / self.resistance(duty);
            driven += duty * per;
            back += per * self.back_emf_v_s() * speed;
        }
        (source + internal_resistance * back) / (1.0 + internal_resistance * driven)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blade a of Table 1.
    fn blade() -> Blade {
        Blade {
            coefficients: [-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7],
            voltage_offset_v: 5.2859,
            moment_ratio_factor: 1.0,
        }
    }

    fn motor() -> MotorModel {
        MotorModel {
            winding_resistance_ohm: 0.2,
            esc_resistance_ohm: 0.01,
            idle_current_a: 0.1,
            ..MotorModel::AIR_GEAR_350
        }
    }

    #[test]
    fn regress_the_motor_of_the_bench_is_the_shipped_one() {
        let shipped = crate::testing::vehicle("f550-motors").rotors.motor;
        assert_eq!(shipped, Some(MotorModel::AIR_GEAR_350));
    }

    #[test]
    fn val_the_steady_speed_is_the_root_of_eq_15() {
        let (motor, drag) = (motor(), 1.5e-7);
        for (duty, voltage) in [(0.1, 15.0), (0.4, 14.2), (1.0, 16.8)] {
            let speed = motor.steady_speed(duty, voltage, drag);
            let current = motor.current(duty, voltage, speed);
            // Eqs. 10 and 11 with the current as it is.
            let esc = duty * (voltage - 0.01 * current);
            let back_emf = 60.0 / (2.0 * std::f64::consts::PI * 920.0);
            assert!((esc - 0.2 * current - back_emf * speed).abs() < 1e-9);
            let eq_15 =
                drag * speed * speed + back_emf * back_emf / 0.2 * speed + back_emf * 0.1 - back_emf * esc / 0.2;
            assert!(eq_15.abs() < 1e-9, "{eq_15}");
            assert!(motor.acceleration(duty, voltage, speed, drag * speed * speed).abs() < 1e-5);
        }
        // I₀ < V_esc/R is demanded by the paper: below, the motor stands.
        assert!(motor.steady_speed(0.001, 15.0, drag).abs() < 1e-12);
    }

    #[test]
    fn prop_the_speed_rises_with_duty_and_voltage_and_falls_with_drag() {
        let motor = motor();
        for k in 1..50 {
            let duty = f64::from(k) / 50.0;
            let at = |duty, voltage, drag| motor.steady_speed(duty, voltage, drag);
            assert!(at(duty + 0.02, 15.0, 1.5e-7) > at(duty, 15.0, 1.5e-7));
            assert!(at(duty, 15.5, 1.5e-7) > at(duty, 15.0, 1.5e-7));
            assert!(at(duty, 15.0, 1.6e-7) < at(duty, 15.0, 1.5e-7));
        }
    }

    #[test]
    fn val_a_blade_lifts_at_hover_what_eq_19_says() {
        let (motor, blade, ratio) = (motor(), blade(), 0.016);
        let (duty, voltage) = (0.4, 15.5);
        let lift = motor.lift_coefficient(&blade, duty, voltage, ratio).unwrap();
        let speed = motor.steady_speed(duty, voltage, ratio * lift);
        assert!((lift * speed * speed - blade.lift(duty, voltage)).abs() < 1e-9);
        // More resistance than the voltage can overcome.
        let weak = MotorModel {
            winding_resistance_ohm: 9.0,
            ..motor
        };
        assert_eq!(weak.lift_coefficient(&blade, duty, voltage, ratio), None);
    }

    #[test]
    fn val_the_terminals_give_what_the_motors_take() {
        let motor = motor();
        let rotors = [(0.4, 500.0), (0.5, 480.0), (0.0, 100.0)];
        let voltage = motor.terminal_voltage(16.0, 0.02, rotors.into_iter());
        let taken: f64 = rotors
            .iter()
            .map(|&(u, speed)| u * motor.current(u, voltage, speed))
            .sum();
        assert!((voltage - (16.0 - 0.02 * taken)).abs() < 1e-12);
    }

    #[test]
    fn val_a_step_of_the_duty_is_answered_with_the_time_constant() {
        let (motor, drag) = (motor(), 1.5e-7);
        let (before, after) = (
            motor.steady_speed(0.40, 15.5, drag),
            motor.steady_speed(0.401, 15.5, drag),
        );
        let tau = motor.time_constant_s(0.4, before, drag);
        let (mut speed, h) = (before, 1e-5);
        for _ in 0..(tau / h).round() as usize {
            speed += h * motor.acceleration(0.401, 15.5, speed, drag * speed * speed);
        }
        let answered = (speed - before) / (after - before);
        assert!((answered - (1.0 - (-1.0f64).exp())).abs() < 0.005, "{answered}");
    }

    #[test]
    fn val_friction_does_not_turn_a_rotor_backwards() {
        let motor = motor();
        assert!(motor.acceleration(0.0, 15.0, 0.0, 0.0).abs() < 1e-12);
        assert!(motor.acceleration(0.0, 15.0, 100.0, 0.0) < 0.0, "it brakes");
    }
}
