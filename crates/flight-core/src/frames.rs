//! Three-vectors tagged with their frame, Euler angles, and the maps between them.
//!
//! A [`Vec3<Ned>`] cannot be added to a [`Vec3<Body>`]; a [`BodyToNed`] is the only way across. What the types do *not*
//! protect: units (the name carries them), origin (a position and a velocity are both `Vec3<Ned>`), and time.

use crate::elementary::{Elementary, Libm};
use core::marker::PhantomData;
use core::ops::{Add, AddAssign, Mul, Neg, Sub};

/// World frame: x north, y east, z down; treated as inertial (R_E of §2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ned {}

/// Body frame: x forward, y right, z down; origin in the centre of mass (R_B of §2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {}

/// A vector of three `f32`, resolved in frame `F`.
///
/// ```
/// use rotortwin_flight_core::frames::{Body, Ned, Vec3};
/// let wind = Vec3::<Ned>::new(1.0, 0.0, 0.0);
/// assert_eq!((wind + wind).x, 2.0);
/// ```
/// Mixing frames does not compile:
/// ```compile_fail
/// use rotortwin_flight_core::frames::{Body, Ned, Vec3};
/// let _ = Vec3::<Ned>::new(1.0, 0.0, 0.0) + Vec3::<Body>::new(1.0, 0.0, 0.0);
/// ```
#[repr(C)]
pub struct Vec3<F> {
    /// First component: north or forward.
    pub x: f32,
    /// Second component: east or right.
    pub y: f32,
    /// Third component: down.
    pub z: f32,
    frame: PhantomData<F>,
}

impl<F> Vec3<F> {
    /// The null vector.
    pub const ZERO: Self = Self::new(0.0, 0.0, 0.0);

    /// A vector from its components.
    #[inline(always)]
    pub const fn new(x: f32, y: f32, z: f32) -> Self {
        Self {
            x,
            y,
            z,
            frame: PhantomData,
        }
    }

    /// A vector from an array in x, y, z order.
    #[inline(always)]
    pub const fn from_array(v: [f32; 3]) -> Self {
        Self::new(v[0], v[1], v[2])
    }

    /// The components in x, y, z order.
    #[inline(always)]
    pub const fn to_array(self) -> [f32; 3] {
        [self.x, self.y, self.z]
    }

    /// Scalar product.
    #[inline]
    pub fn dot(self, other: Self) -> f32 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Vector product, right-handed.
    #[inline]
    pub fn cross(self, other: Self) -> Self {
        Self::new(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }

    /// Euclidean length.
    #[inline]
    pub fn norm(self) -> f32 {
        libm::sqrtf(self.dot(self))
    }

    /// True if all components are finite.
    #[inline]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }
}

// Derives would require `F: Copy` and so on; a frame is a name, not a value.
impl<F> Clone for Vec3<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Vec3<F> {}
impl<F> PartialEq for Vec3<F> {
    fn eq(&self, other: &Self) -> bool {
        self.to_array() == other.to_array()
    }
}
impl<F> Default for Vec3<F> {
    fn default() -> Self {
        Self::ZERO
    }
}
impl<F> core::fmt::Debug for Vec3<F> {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(out, "({}, {}, {})", self.x, self.y, self.z)
    }
}
impl<F> Add for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}
impl<F> AddAssign for Vec3<F> {
    #[inline]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl<F> Sub for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self::new(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}
impl<F> Neg for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}
impl<F> Mul<f32> for Vec3<F> {
    type Output = Self;
    #[inline]
    fn mul(self, k: f32) -> Self {
        Self::new(self.x * k, self.y * k, self.z * k)
    }
}

/// Attitude of the body in NED as ZYX (yaw, then pitch, then roll) angles η = (φ, θ, ψ), rad.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[doc(alias = "rpy")]
pub struct EulerAngles {
    /// φ, rad.
    pub roll: f32,
    /// θ, rad.
    pub pitch: f32,
    /// ψ, rad, clockwise from north seen from above.
    pub yaw: f32,
}

/// Sine and cosine of each angle of an attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSines {
    /// sin φ, cos φ.
    pub roll: (f32, f32),
    /// sin θ, cos θ.
    pub pitch: (f32, f32),
    /// sin ψ, cos ψ.
    pub yaw: (f32, f32),
}

impl AttitudeSines {
    /// Sines and cosines of `attitude`.
    #[inline(always)]
    pub fn new(attitude: EulerAngles, functions: &mut impl Elementary) -> Self {
        Self {
            roll: functions.sin_cos(attitude.roll),
            pitch: functions.sin_cos(attitude.pitch),
            yaw: functions.sin_cos(attitude.yaw),
        }
    }
}

/// Rotation matrix R of Eq. 2: `v_ned = R · v_body`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyToNed {
    /// Rows of R.
    rows: [[f32; 3]; 3],
}

impl BodyToNed {
    /// R(η) of Eq. 2.
    #[inline]
    pub fn from_euler(attitude: EulerAngles) -> Self {
        Self::from_sines(&AttitudeSines::new(attitude, &mut Libm))
    }

    /// R(η) of Eq. 2.
    #[inline(always)]
    pub fn from_sines(sines: &AttitudeSines) -> Self {
        let (s_phi, c_phi) = sines.roll;
        let (s_theta, c_theta) = sines.pitch;
        let (s_psi, c_psi) = sines.yaw;
        Self {
            rows: [
                [
                    c_psi * c_theta,
                    c_psi * s_phi * s_theta - c_phi * s_psi,
                    s_phi * s_psi + c_phi * c_psi * s_theta,
                ],
                [
                    c_theta * s_psi,
                    c_phi * c_psi + s_phi * s_psi * s_theta,
                    c_phi * s_psi * s_theta - c_psi * s_phi,
                ],
                [-s_theta, c_theta * s_phi, c_phi * c_theta],
            ],
        }
    }

    /// R · v.
    #[inline(always)]
    pub fn to_ned(&self, v: Vec3<Body>) -> Vec3<Ned> {
        let r = &self.rows;
        Vec3::new(
            r[0][0] * v.x + r[0][1] * v.y + r[0][2] * v.z,
            r[1][0] * v.x + r[1][1] * v.y + r[1][2] * v.z,
            r[2][0] * v.x + r[2][1] * v.y + r[2][2] * v.z,
        )
    }

    /// Rᵀ · v.
    #[inline(always)]
    pub fn to_body(&self, v: Vec3<Ned>) -> Vec3<Body> {
        let r = &self.rows;
        Vec3::new(
            r[0][0] * v.x + r[1][0] * v.y + r[2][0] * v.z,
            r[0][1] * v.x + r[1][1] * v.y + r[2][1] * v.z,
            r[0][2] * v.x + r[1][2] * v.y + r[2][2] * v.z,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn prop_rotation_keeps_length_and_inverts(roll in -3.0f32..3.0, pitch in -1.5f32..1.5, yaw in -3.0f32..3.0,
                                                  x in -10.0f32..10.0, y in -10.0f32..10.0, z in -10.0f32..10.0) {
            let r = BodyToNed::from_euler(EulerAngles { roll, pitch, yaw });
            let v = Vec3::<Body>::new(x, y, z);
            let back = r.to_body(r.to_ned(v));
            // Nine f32 products of size 10: a few 1e-6 of rounding.
            prop_assert!((back - v).norm() < 1e-5);
            prop_assert!((r.to_ned(v).norm() - v.norm()).abs() < 1e-5);
        }
    }

    #[test]
    fn val_yaw_turns_forward_to_east() {
        let east = BodyToNed::from_euler(EulerAngles {
            roll: 0.0,
            pitch: 0.0,
            yaw: core::f32::consts::FRAC_PI_2,
        })
        .to_ned(Vec3::new(1.0, 0.0, 0.0));
        assert!((east - Vec3::new(0.0, 1.0, 0.0)).norm() < 1e-6);
    }
}
