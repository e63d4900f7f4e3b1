//! Residual generators (§4): the part of the measured motion that the nominal thrust does not explain.
//!
//! ```text
//!  NavState ─▶ BodyMomentum{momentum, drift} ─┐
//!  duty, V ──▶ nominal wrench F f̄ ────────────┴▶ WrenchObserver ─▶ wrench residual (4) ─▶ Residuals (3 n_a)
//! ```
//!
//! The paper runs one observer per rotor, three kept components each (Eqs. 31–32):
//!
//! r_i = Φ_i(y) − z_i,   ż_i = g̃_i(y) + V_iᵀ F f̄ + H r_i,   Φ_i = V_iᵀ col(m Rᵀṗ_F, J ω)
//!
//! With H = h I, all of them are projections V_iᵀ of one 4-axis observer (F_z, M_x, M_y, M_z): 3 n_a numbers of rank 4. The engine
//! runs that one, [`WrenchObserver`]; [`ObserverBank`] is the paper's form, kept for verification.
//!
//! Discretisation: explicit Euler at the sampling rate, z₀ = Φ(y₀), z_{k+1} = z_k + dt (g̃(y_k) + Vᵀ F f̄_k + h r_k).
//!
//! Corrections to the paper used here: the velocity in Φ is Rᵀṗ_F and enters the lever row with the mass (Eq. 40 prints neither),
//! the drag constant in g̃ is k_t (printed k_i), the sum may run over all rotors as p_ii = 0.
//!
//! Steady state: a lost thrust Δf on rotor k drives r_i to p_ik (−Δf)/h.

use super::window::dot;
use crate::MAX_ROTORS;
use crate::elementary::Libm;
use crate::frames::{AttitudeSines, BodyToNed};
use crate::geometry::Geometry;
use crate::signals::NavState;

/// Rigid-body parameters (Eq. 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidBody {
    /// m, kg.
    pub mass: f32,
    /// Diagonal of J, kg·m², body.
    pub inertia_body: [f32; 3],
    /// g, m/s².
    pub gravity: f32,
    /// k_t, N·s/m.
    pub linear_drag: f32,
    /// k_r, N·m·s.
    pub angular_drag: f32,
}

/// Momentum along the four axes that rotors act on, and its rate without rotors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyMomentum {
    /// (m v_z, J_x p, J_y q, J_z r), kg·m/s and kg·m²/s, body.
    pub momentum: [f32; 4],
    /// g̃ on the same axes: gravity, drag, Coriolis and gyroscopic terms, N and N·m, body.
    pub drift: [f32; 4],
    /// v_z = e₃ᵀRᵀṗ_F, m/s, body.
    pub vertical_speed: f32,
}

impl BodyMomentum {
    /// Φ and g̃ of Eqs. 30–32 before the projection V_i.
    #[inline]
    pub fn from_nav(body: &RigidBody, nav: &NavState) -> Self {
        Self::from_sines(body, nav, &AttitudeSines::new(nav.attitude, &mut Libm))
    }

    /// [`BodyMomentum::from_nav`] with precomputed sines and cosines of the attitude.
    #[inline(always)]
    pub fn from_sines(body: &RigidBody, nav: &NavState, sines: &AttitudeSines) -> Self {
        let ned_from_body = BodyToNed::from_sines(sines);
        let v = ned_from_body.to_body(nav.velocity_ned);
        let gravity_z = ned_from_body
            .to_body(crate::frames::Vec3::new(0.0, 0.0, body.gravity))
            .z;
        let [p, q, r] = nav.body_rates.to_array();
        let [jx, jy, jz] = body.inertia_body;
        let m = body.mass;
        Self {
            momentum: [m * v.z, jx * p, jy * q, jz * r],
            drift: [
                m * (q * v.x - p * v.y) - body.linear_drag * v.z + m * gravity_z,
                (jy - jz) * q * r - body.angular_drag * p,
                (jz - jx) * r * p - body.angular_drag * q,
                (jx - jy) * p * q - body.angular_drag * r,
            ],
            vertical_speed: v.z,
        }
    }
}

/// Observer of the 4-axis momentum; its residual is the low-pass filtered unexplained wrench, divided by h.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrenchObserver {
    pub(super) gain: f32,
    pub(super) period: f32,
    pub(super) state: Option<[f32; 4]>,
    /// Rate of the last accepted sample, held while samples are rejected.
    pub(super) rate: [f32; 4],
}

impl WrenchObserver {
    /// * `gain`: h, 1/s   * `period`: dt, s
    pub const fn new(gain: f32, period: f32) -> Self {
        Self {
            gain,
            period,
            state: None,
            rate: [0.0; 4],
        }
    }

    /// r_k = Φ(y_k) − z_k, then z_{k+1}. kg·m/s and kg·m²/s.
    ///
    /// * `body`: of this sample   * `wrench`: F f̄, mean over the step that starts here
    #[inline]
    pub fn step(&mut self, body: &BodyMomentum, wrench: &[f32; 4]) -> [f32; 4] {
        let state = self.state.get_or_insert(body.momentum);
        observe(self.gain, self.period, state, &mut self.rate, body, wrench)
    }

    /// Advances by one step without a measurement: the last rate is held.
    #[inline]
    pub fn coast(&mut self) {
        if let Some(state) = &mut self.state {
            for axis in 0..4 {
                state[axis] += self.period * self.rate[axis];
            }
        }
    }
}

/// One step of a [`WrenchObserver`].
#[inline(always)]
pub(super) fn observe(
    gain: f32,
    period: f32,
    state: &mut [f32; 4],
    rate: &mut [f32; 4],
    body: &BodyMomentum,
    wrench: &[f32; 4],
) -> [f32; 4] {
    let mut residual = [0.0; 4];
    for axis in 0..4 {
        residual[axis] = body.momentum[axis] - state[axis];
        rate[axis] = body.drift[axis] + wrench[axis] + gain * residual[axis];
        state[axis] += period * rate[axis];
    }
    residual
}

/// The scalar residuals of all rotors, kg·m²/s (yaw and arm) and kg·m²/s (lever).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residuals {
    /// Per rotor: arm (v_i3), lever (v_i4), yaw (v_i5) of Eqs. 37–39; 0 past the rotor count.
    pub component: [[f32; 3]; MAX_ROTORS],
}

impl Residuals {
    pub(crate) const NONE: Self = Self {
        component: [[0.0; 3]; MAX_ROTORS],
    };

    /// r_i = V_iᵀ r for every rotor.
    #[inline]
    pub fn from_wrench(geometry: &Geometry, wrench_residual: &[f32; 4]) -> Self {
        let mut component = [[0.0; 3]; MAX_ROTORS];
        for (i, r) in component.iter_mut().enumerate().take(geometry.rotor_count()) {
            for (c, v) in r.iter_mut().zip(geometry.decoupling_basis(i)) {
                *c = dot(v, wrench_residual);
            }
        }
        Self { component }
    }
}

/// The paper's bank: one observer per rotor, with three components kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverBank {
    gain: f32,
    period: f32,
    state: Option<[[f32; 3]; MAX_ROTORS]>,
}

impl ObserverBank {
    /// * `gain`: h of H_i = h I₃, 1/s   * `period`: dt, s
    pub const fn new(gain: f32, period: f32) -> Self {
        Self {
            gain,
            period,
            state: None,
        }
    }

    /// r_k of every rotor, then z_{k+1}.
    ///
    /// * `thrust`: f̄, mean over the step that starts here, N
    pub fn step(&mut self, geometry: &Geometry, body: &BodyMomentum, thrust: &[f32; MAX_ROTORS]) -> Residuals {
        let phi = Residuals::from_wrench(geometry, &body.momentum);
        let drift = Residuals::from_wrench(geometry, &body.drift);
        let state = self.state.get_or_insert(phi.component);
        let mut residuals = Residuals::default();
        for i in 0..geometry.rotor_count() {
            for c in 0..3 {
                // Σ p_ik f̄_k; k = i adds nothing.
                let mut coupled = 0.0;
                for k in 0..geometry.rotor_count() {
                    coupled += geometry.fault_coupling(i, k)[c] * thrust[k];
                }
                let r = phi.component[i][c] - state[i][c];
                residuals.component[i][c] = r;
                state[i][c] += self.period * (drift.component[i][c] + coupled + self.gain * r);
            }
        }
        residuals
    }
}

#[cfg(test)]
mod tests {
    use super::super::nominal_thrust::{NominalThrust, NominalWrench, static_thrust};
    use super::super::test_vectors::{self, PERIOD};
    use super::*;
    use crate::signals::{Measurement, MotorCommand};
    use proptest::prelude::*;
    use std::vec::Vec;

    const GAIN: f32 = 5.0;

    /// kg·m²/s. The state is a momentum of up to 1 kg·m/s rounded to f32 (6e-8) at each of 600 steps, all but the last 80 of which
    /// h = 5/s forgets; the input file itself is rounded to f32. A blade-b fault is 4e-3 to 8e-3.
    const VECTOR_TOLERANCE: f64 = 2e-6;

    fn run(model: NominalThrust) -> Vec<Residuals> {
        let geometry = test_vectors::hexa_x();
        let map = test_vectors::blade_a();
        let body = test_vectors::body();
        let mut observer = WrenchObserver::new(GAIN, PERIOD);
        let mut nominal = NominalWrench::new(model, PERIOD);
        test_vectors::residual_input()
            .iter()
            .map(|sample| {
                let wrench = geometry.wrench_from_thrust(&static_thrust(&map, 6, sample));
                let wrench = nominal.step(&geometry, sample, &wrench);
                let r = observer.step(&BodyMomentum::from_nav(&body, &sample.nav), &wrench);
                Residuals::from_wrench(&geometry, &r)
            })
            .collect()
    }

    fn compare(file: &str, model: NominalThrust) {
        let got = run(model);
        let mut worst = 0.0f64;
        let mut rows = 0;
        for row in test_vectors::csv(file) {
            let k = row[0] as usize;
            for i in 0..6 {
                for c in 0..3 {
                    let error = f64::from(got[k].component[i][c]) - row[1 + 3 * i + c];
                    worst = worst.max(error.abs());
                }
            }
            rows += 1;
        }
        assert!(rows > 20);
        assert!(worst < VECTOR_TOLERANCE, "{file}: {worst:e}");
    }

    #[test]
    fn val_reference_residuals_paper() {
        compare("resid_paper.csv", NominalThrust::Static);
    }

    #[test]
    fn val_reference_residuals_uncompensated() {
        compare(
            "resid_uncompensated.csv",
            NominalThrust::Linear { full_thrust: 12.0059 },
        );
    }

    #[test]
    fn val_reference_residuals_lagged() {
        compare("resid_lag.csv", NominalThrust::Lagged { time_constant: 0.05 });
    }

    /// A vehicle in exact hover balance except for a lost thrust: the residual must settle at p_ik (−Δf)/h.
    #[test]
    fn val_steady_state_of_a_fault() {
        let geometry = test_vectors::hexa_x();
        // Blade b on motor 3 at hover: vectors/README gives r1 → (4.4716e-3, 7.7450e-3, 0) for this loss.
        let want = [4.4716e-3, 7.7450e-3, 0.0];
        let coupling = geometry.fault_coupling(0, 2);
        let loss = -want[0] * GAIN / coupling[0];
        assert!((0.08..0.1).contains(&loss), "{loss}");
        let mut thrust = [0.0; MAX_ROTORS];
        thrust[..6].fill(2.5);
        let nominal = geometry.wrench_from_thrust(&thrust);
        thrust[2] -= loss;
        let actual = geometry.wrench_from_thrust(&thrust);
        let mut observer = WrenchObserver::new(GAIN, PERIOD);
        let mut body = BodyMomentum {
            drift: nominal.map(|w| -w),
            ..BodyMomentum::default()
        };
        let mut last = [0.0; 4];
        for _ in 0..4000 {
            last = observer.step(&body, &nominal);
            for axis in 0..4 {
                body.momentum[axis] += PERIOD * (body.drift[axis] + actual[axis]);
            }
        }
        let r = Residuals::from_wrench(&geometry, &last);
        for c in 0..3 {
            // Five digits are given; momentum grows to 1 kg·m/s, rounded to f32.
            assert!((r.component[0][c] - want[c]).abs() < 3e-6, "{:?}", r.component[0]);
        }
        for c in 0..3 {
            assert!(r.component[2][c].abs() < 3e-6, "{:?}", r.component[2]);
        }
    }

    fn motion() -> impl Strategy<Value = Vec<Measurement>> {
        let nav = (
            proptest::array::uniform3(-5.0f32..5.0),
            proptest::array::uniform3(-0.5f32..0.5),
            proptest::array::uniform3(-2.0f32..2.0),
            proptest::array::uniform16(0.2f32..0.6),
        )
            .prop_map(|(v, eta, w, duty)| Measurement {
                nav: NavState {
                    velocity_ned: crate::frames::Vec3::from_array(v),
                    attitude: crate::frames::EulerAngles {
                        roll: eta[0],
                        pitch: eta[1],
                        yaw: eta[2],
                    },
                    body_rates: crate::frames::Vec3::from_array(w),
                    ..NavState::default()
                },
                command: MotorCommand { duty },
                battery_voltage: 16.0,
            });
        proptest::collection::vec(nav, 2..40)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn prop_bank_and_wrench_form_agree(samples in motion(), count in 4usize..=16) {
            let geometry = Geometry::regular(count, 0.3, 0.016, 0.2).expect("regular");
            let map = test_vectors::blade_a();
            let body = test_vectors::body();
            let mut wrench_observer = WrenchObserver::new(GAIN, PERIOD);
            let mut bank = ObserverBank::new(GAIN, PERIOD);
            for sample in &samples {
                let thrust = static_thrust(&map, count, sample);
                let momentum = BodyMomentum::from_nav(&body, &sample.nav);
                let wrench = geometry.wrench_from_thrust(&thrust);
                let one = Residuals::from_wrench(&geometry, &wrench_observer.step(&momentum, &wrench));
                let other = bank.step(&geometry, &momentum, &thrust);
                for i in 0..count {
                    for c in 0..3 {
                        // Residuals of size 10 here (the motion does not match this vehicle); 40 steps of rounding.
                        prop_assert!((one.component[i][c] - other.component[i][c]).abs() < 5e-5);
                    }
                }
            }
        }

        #[test]
        fn prop_loss_on_a_rotor_leaves_its_own_residual_alone(
            samples in motion(), count in 4usize..=16, rotor in 0usize..16, loss in 0.01f32..1.0,
        ) {
            let rotor = rotor % count;
            let geometry = Geometry::regular(count, 0.3, 0.016, 0.2).expect("regular");
            let map = test_vectors::blade_a();
            let body = test_vectors::body();
            let mut healthy = WrenchObserver::new(GAIN, PERIOD);
            let mut faulty = WrenchObserver::new(GAIN, PERIOD);
            let mut lost = [0.0; MAX_ROTORS];
            lost[rotor] = loss;
            // Linearity: the momentum that the loss adds is what it adds to the residual through Eq. 35.
            let mut extra = [0.0f32; 4];
            let lost_wrench = geometry.wrench_from_thrust(&lost);
            let mut moved = 0.0f32;
            for sample in &samples {
                let wrench = geometry.wrench_from_thrust(&static_thrust(&map, count, sample));
                let momentum = BodyMomentum::from_nav(&body, &sample.nav);
                let mut with_loss = momentum;
                for axis in 0..4 {
                    with_loss.momentum[axis] += extra[axis];
                    extra[axis] -= PERIOD * lost_wrench[axis];
                }
                let one = Residuals::from_wrench(&geometry, &healthy.step(&momentum, &wrench));
                let other = Residuals::from_wrench(&geometry, &faulty.step(&with_loss, &wrench));
                for c in 0..3 {
                    prop_assert!((one.component[rotor][c] - other.component[rotor][c]).abs() < 1e-5);
                }
                let next = (rotor + 1) % count;
                moved = (one.component[next][0] - other.component[next][0]).abs()
                    + (one.component[next][1] - other.component[next][1]).abs();
            }
            // The neighbouring rotor's residual does react: p has at least 0.3·sin 22° m of arm over 2.5 ms and more.
            prop_assert!(moved > 0.5 * PERIOD * loss * 0.1);
        }
    }
}
