//! Rigid body: six degrees of freedom in NED and body axes (Eqs. 1–3).
//!
//! m p̈ = −k_t (ṗ − w) + m g e₃ + R F + d,   J ω̇ = −k_r ω − ω × J ω + τ + t
//!
//! with the wind w, and d, t the disturbance force (NED) and torque (body) of the environment; without them this is Eq. 1. The
//! attitude is a unit quaternion, so that no angle is singular and the right-hand side has no trigonometry; Euler angles are
//! computed at output only. J is diagonal. The ground, where a scenario has one, acts through d and t ([`super::ground`]).

use crate::elementary::{Elementary, Libm};
use crate::vector::{Vector3, cross};

/// Attitude as a Hamilton quaternion (w, x, y, z); rotates body vectors to NED.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quaternion(pub [f64; 4]);

impl Quaternion {
    /// Body axes along NED.
    pub const IDENTITY: Self = Self([1.0, 0.0, 0.0, 0.0]);

    /// From ZYX Euler angles (roll, pitch, yaw), rad.
    pub fn from_euler(euler: Vector3) -> Self {
        let [(sr, cr), (sp, cp), (sy, cy)] = euler.map(|angle| libm::sincos(0.5 * angle));
        Self([
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ])
    }

    /// ZYX Euler angles (roll, pitch, yaw), rad; roll and yaw in (−π, π], pitch in \[−π/2, π/2\].
    pub fn to_euler(self) -> Vector3 {
        self.to_euler_with(&mut Libm)
    }

    /// [`Quaternion::to_euler`] with other elementary functions.
    #[inline(always)]
    pub(crate) fn to_euler_with(self, functions: &mut impl Elementary) -> Vector3 {
        let [w, x, y, z] = self.0;
        [
            functions.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            functions.asin((2.0 * (w * y - z * x)).clamp(-1.0, 1.0)),
            functions.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ]
    }

    /// R e₃: the body's down axis in NED.
    #[inline(always)]
    pub fn down_axis(self) -> Vector3 {
        let [w, x, y, z] = self.0;
        [
            2.0 * (x * z + w * y),
            2.0 * (y * z - w * x),
            1.0 - 2.0 * (x * x + y * y),
        ]
    }

    /// R v: a body vector in NED.
    pub(crate) fn ned_from_body(self, v: Vector3) -> Vector3 {
        let [w, x, y, z] = self.0;
        let u = [x, y, z];
        let once = cross(u, v);
        let twice = cross(u, once);
        [0, 1, 2].map(|i| v[i] + 2.0 * (w * once[i] + twice[i]))
    }

    /// Rᵀ v: a NED vector in body axes.
    pub fn body_from_ned(self, v: Vector3) -> Vector3 {
        let [w, x, y, z] = self.0;
        let u = [-x, -y, -z];
        let once = cross(u, v);
        let twice = cross(u, once);
        [0, 1, 2].map(|i| v[i] + 2.0 * (w * once[i] + twice[i]))
    }

    /// q̇ = ½ q ⊗ (0, ω), ω in body axes, rad/s.
    #[inline(always)]
    pub(crate) fn rate(self, body_rates: Vector3) -> [f64; 4] {
        let [w, x, y, z] = self.0;
        let (p, q, r) = (0.5 * body_rates[0], 0.5 * body_rates[1], 0.5 * body_rates[2]);
        [
            -x * p - y * q - z * r,
            w * p + y * r - z * q,
            w * q + z * p - x * r,
            w * r + x * q - y * p,
        ]
    }

    /// Scaled back to length 1; NaN stays NaN.
    #[inline(always)]
    pub(crate) fn normalized(self) -> Self {
        let [w, x, y, z] = self.0;
        let scale = 1.0 / (w * w + x * x + y * y + z * z).sqrt();
        Self([w * scale, x * scale, y * scale, z * scale])
    }
}

/// State of the rigid body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBodyState {
    /// p_F of the centre of mass, m, NED.
    pub position_ned: Vector3,
    /// ṗ_F, m/s, NED.
    pub velocity_ned: Vector3,
    /// R of Eq. 2.
    pub ned_from_body: Quaternion,
    /// ω, rad/s, body.
    pub body_rates: Vector3,
}

/// Time derivative of a [`RigidBodyState`]; ṗ is the state's own velocity.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RigidBodyRate {
    pub(crate) position: Vector3,
    pub(crate) velocity: Vector3,
    pub(crate) quaternion: [f64; 4],
    pub(crate) body_rates: Vector3,
}

/// What acts on the body besides the rotors; constant over one step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Surroundings {
    /// w, m/s, NED.
    pub wind_ned: Vector3,
    /// Disturbance force d, N, NED.
    pub force_ned: Vector3,
    /// Disturbance torque t, N·m, body.
    pub torque_body: Vector3,
}

/// Mass properties and friction, with the divisions done once.
#[derive(Debug, Clone, Copy)]
pub struct RigidBody {
    per_mass: f64,
    gravity: f64,
    linear_drag: f64,
    angular_drag: f64,
    inertia: Vector3,
    per_inertia: Vector3,
}

impl RigidBody {
    /// Mass kg, diagonal of J kg·m², g m/s², k_t kg/s, k_r N·m·s; all checked by the caller to be finite, mass and J above 0.
    pub fn new(mass: f64, inertia: Vector3, gravity: f64, linear_drag: f64, angular_drag: f64) -> Self {
        Self {
            per_mass: 1.0 / mass,
            gravity,
            linear_drag,
            angular_drag,
            inertia,
            per_inertia: inertia.map(|j| 1.0 / j),
        }
    }

    /// g, m/s².
    pub(crate) fn gravity(&self) -> f64 {
        self.gravity
    }

    /// (1/m, g, k_t, k_r), J and 1/J.
    pub(crate) fn parts(&self) -> ([f64; 4], Vector3, Vector3) {
        (
            [self.per_mass, self.gravity, self.linear_drag, self.angular_drag],
            self.inertia,
            self.per_inertia,
        )
    }

    /// From the result of [`RigidBody::parts`].
    #[inline(always)]
    pub(crate) fn from_parts(
        [per_mass, gravity, linear_drag, angular_drag]: [f64; 4],
        inertia: Vector3,
        per_inertia: Vector3,
    ) -> Self {
        Self {
            per_mass,
            gravity,
            linear_drag,
            angular_drag,
            inertia,
            per_inertia,
        }
    }

    /// Right-hand side of Eq. 1 for a rotor force of `thrust` N along −e₃ and a rotor torque in N·m, body.
    #[inline(always)]
    pub(crate) fn rate(
        &self,
        s: &RigidBodyState,
        thrust: f64,
        torque: Vector3,
        around: &Surroundings,
    ) -> RigidBodyRate {
        let down = s.ned_from_body.down_axis();
        let force = |i: usize| {
            around.force_ned[i] - self.linear_drag * (s.velocity_ned[i] - around.wind_ned[i]) - thrust * down[i]
        };
        let omega = s.body_rates;
        let momentum = [
            self.inertia[0] * omega[0],
            self.inertia[1] * omega[1],
            self.inertia[2] * omega[2],
        ];
        let gyroscopic = cross(omega, momentum);
        let spin_up = |i: usize| {
            (torque[i] + around.torque_body[i] - self.angular_drag * omega[i] - gyroscopic[i]) * self.per_inertia[i]
        };
        RigidBodyRate {
            position: s.velocity_ned,
            velocity: [
                force(0) * self.per_mass,
                force(1) * self.per_mass,
                force(2) * self.per_mass + self.gravity,
            ],
            quaternion: s.ned_from_body.rate(omega),
            body_rates: [spin_up(0), spin_up(1), spin_up(2)],
        }
    }
}

impl RigidBodyState {
    /// `self + h · rate`; the quaternion is not normalised.
    #[inline(always)]
    pub(crate) fn moved(&self, rate: &RigidBodyRate, h: f64) -> Self {
        let add = |a: Vector3, b: Vector3| [a[0] + h * b[0], a[1] + h * b[1], a[2] + h * b[2]];
        let (q, dq) = (self.ned_from_body.0, rate.quaternion);
        Self {
            position_ned: add(self.position_ned, rate.position),
            velocity_ned: add(self.velocity_ned, rate.velocity),
            ned_from_body: Quaternion([q[0] + h * dq[0], q[1] + h * dq[1], q[2] + h * dq[2], q[3] + h * dq[3]]),
            body_rates: add(self.body_rates, rate.body_rates),
        }
    }
}

impl RigidBodyRate {
    /// The mean (k₁ + 2 k₂ + 2 k₃ + k₄)/6 of the classical Runge–Kutta method.
    #[inline(always)]
    pub(crate) fn runge_kutta_mean(k: &[Self; 4]) -> Self {
        let [a, b, c, d] = k;
        Self {
            position: mean(&a.position, &b.position, &c.position, &d.position),
            velocity: mean(&a.velocity, &b.velocity, &c.velocity, &d.velocity),
            quaternion: mean(&a.quaternion, &b.quaternion, &c.quaternion, &d.quaternion),
            body_rates: mean(&a.body_rates, &b.body_rates, &c.body_rates, &d.body_rates),
        }
    }
}

#[inline(always)]
fn mean<const K: usize>(a: &[f64; K], b: &[f64; K], c: &[f64; K], d: &[f64; K]) -> [f64; K] {
    let mut mean = [0.0; K];
    for i in 0..K {
        mean[i] = (a[i] + 2.0 * (b[i] + c[i]) + d[i]) * (1.0 / 6.0);
    }
    mean
}
