//! Rotor positions and the effect of each rotor on the vehicle (§2.2, §4.3).
//!
//! Everything that depends on the layout alone is computed here once, at construction: the control effectiveness of Eq. 36, its
//! pseudo-inverse for the allocation, and the decoupling bases of Eqs. 37–39 onto which the residual generators project.
//! [`crate::control`] and [`crate::fdi`] read it; neither knows an arm length.
//!
//! Limits: rotors push along −z of the body only (no tilt), any 4 to [`MAX_ROTORS`] of them, none on the z axis, coaxial ones only if they
//! counter-rotate: their columns then differ in yaw alone, by which faults of the two are told apart. A rotor's own z position is stored but has no effect: a vertical force has the same moment about the centre of mass at every
//! height (Eq. 5). Lift and drag of a rotor are proportional (Eq. 4), so that one number, the moment ratio, covers the drag.
//!
//! Corrections to the paper used here: the last entry of Eq. 36 is c_D/c_L, not c_L/c_D (only then Eq. 39 is in the
//! kernel).
//!
//! Glossary: *azimuth* θ, angle of the arm, clockwise from forward seen from above; *wrench axes*, the four components
//! (Fz, Mx, My, Mz) that vertical rotors can produce, in this order everywhere.

use crate::MAX_ROTORS;
use crate::frames::{Body, Vec3};
use crate::linear_algebra::{WRENCH_AXES, pseudo_inverse};

/// Fewest rotors that can command vertical force and three torques.
pub const MIN_ROTORS: usize = 4;

/// Rotors closer than this fraction of the longest arm count as coaxial, shorter arms as none: far above rounding, far below any
/// real propeller spacing.
const SAME_PLACE_SHARE: f64 = 1e-3;

/// Rotation sense of a rotor seen from above, (−1)^i of Eq. 5.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spin {
    /// Counter-clockwise: the reaction turns the nose to the right (+z). Rotor 1 of the paper.
    Ccw,
    /// Clockwise: the reaction turns the nose to the left (−z).
    Cw,
}

impl Spin {
    /// Sign of the reaction torque about body z, −(−1)^i: +1 for [`Spin::Ccw`], −1 for [`Spin::Cw`].
    #[inline]
    pub const fn yaw_sign(self) -> f32 {
        match self {
            Self::Ccw => 1.0,
            Self::Cw => -1.0,
        }
    }
}

/// One rotor with vertical thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotor {
    /// l_i, from the centre of mass to the hub, m, body. The z component has no effect (Eq. 5).
    pub position_body: Vec3<Body>,
    /// Rotation sense.
    pub spin: Spin,
    /// c_D/c_L, drag torque per thrust, m, above 0.
    #[doc(alias = "km")]
    pub moment_ratio: f32,
}

impl Rotor {
    /// Fills the unused tail of the per-rotor arrays.
    pub const ABSENT: Self = Self {
        position_body: Vec3::ZERO,
        spin: Spin::Ccw,
        moment_ratio: 0.0,
    };
}

/// Rotor layout with all derived quantities. A value of this type always passes the checks of [`GeometryError`].
///
/// ```
/// use rotortwin_flight_core::geometry::Geometry;
/// let hexa_x = Geometry::regular(6, 0.275, 0.016, core::f32::consts::FRAC_PI_6)?;
/// let hover = hexa_x.allocate([-15.2, 0.0, 0.0, 0.0]);
/// assert!((hover[0] - 15.2 / 6.0).abs() < 1e-5);
/// # Ok::<(), rotortwin_flight_core::geometry::GeometryError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    rotor_count: usize,
    rotors: [Rotor; MAX_ROTORS],
    /// Rows Fz, Mx, My, Mz of F.
    effectiveness: [[f32; MAX_ROTORS]; WRENCH_AXES],
    /// Entry \[axis\]\[rotor\] of F⁺, transposed so that the rotors are contiguous.
    allocation: [[f32; MAX_ROTORS]; WRENCH_AXES],
    /// v_i3, v_i4, v_i5 of every rotor.
    basis: [[[f32; WRENCH_AXES]; 3]; MAX_ROTORS],
}

impl Geometry {
    /// Placeholder without rotors, to be filled with a geometry.
    pub(crate) const BLANK: Self = Self {
        rotor_count: 0,
        rotors: [Rotor::ABSENT; MAX_ROTORS],
        effectiveness: [[0.0; MAX_ROTORS]; WRENCH_AXES],
        allocation: [[0.0; MAX_ROTORS]; WRENCH_AXES],
        basis: [[[0.0; WRENCH_AXES]; 3]; MAX_ROTORS],
    };

    /// Checks a layout and derives everything from it.
    ///
    /// Returns a [`GeometryError`] if the layout is invalid.
    pub fn new(rotors: &[Rotor]) -> Result<Self, GeometryError> {
        let mut geometry = Self::BLANK;
        geometry.set(rotors)?;
        Ok(geometry)
    }

    /// [`Geometry::new`] in place; a rejected layout changes nothing.
    #[inline(never)]
    pub fn set(&mut self, rotors: &[Rotor]) -> Result<(), GeometryError> {
        let rotor_count = rotors.len();
        if rotor_count < MIN_ROTORS {
            return Err(GeometryError::TooFewRotors { count: rotor_count });
        }
        if rotor_count > MAX_ROTORS {
            return Err(GeometryError::TooManyRotors { count: rotor_count });
        }
        for (rotor, r) in rotors.iter().enumerate() {
            if !r.position_body.is_finite() {
                return Err(GeometryError::PositionNotFinite { rotor });
            }
            if !(r.moment_ratio > 0.0 && r.moment_ratio.is_finite()) {
                return Err(GeometryError::MomentRatioNotPositive { rotor });
            }
        }
        check_spacing(rotors)?;

        let mut f = [[0.0; MAX_ROTORS]; WRENCH_AXES];
        for (i, rotor) in rotors.iter().enumerate() {
            let (x, y) = horizontal(rotor);
            let yaw_torque = yaw_torque(rotor);
            // Eq. 36, third to sixth entry, with l sinθ = y and l cosθ = x.
            for (row, entry) in f.iter_mut().zip([-1.0, -y, x, yaw_torque]) {
                row[i] = entry;
            }
        }
        let inverse = pseudo_inverse(&f, rotor_count).map_err(|row| GeometryError::AxisNotIndependent {
            axis: WrenchAxis::ALL[row],
        })?;
        self.rotor_count = rotor_count;
        self.rotors = [Rotor::ABSENT; MAX_ROTORS];
        self.rotors[..rotor_count].copy_from_slice(rotors);
        self.basis = [[[0.0; WRENCH_AXES]; 3]; MAX_ROTORS];
        for (rotor, basis) in rotors.iter().zip(&mut self.basis) {
            let (x, y) = horizontal(rotor);
            let arm_length = libm::hypot(x, y);
            let (cos_azimuth, sin_azimuth) = (x / arm_length, y / arm_length);
            // Eqs. 37–39.
            *basis = [
                [0.0, cos_azimuth, sin_azimuth, 0.0],
                [arm_length, -sin_azimuth, cos_azimuth, 0.0],
                [-yaw_torque(rotor), 0.0, 0.0, -1.0],
            ]
            .map(|v| v.map(|entry| entry as f32));
        }
        for (single, double) in [(&mut self.effectiveness, &f), (&mut self.allocation, &inverse)] {
            for (to, from) in single.as_flattened_mut().iter_mut().zip(double.as_flattened()) {
                *to = *from as f32;
            }
        }
        Ok(())
    }

    /// Regular polygon: θ_i = `offset` + 2π(i−1)/n, i = 1 … n, spins alternating from rotor 1 = [`Spin::Ccw`].
    ///
    /// * `arm_length`: l, m, above 0   * `moment_ratio`: c_D/c_L, m   * `offset`: rad; 0 for a plus layout, π/n for an
    ///   X layout
    ///
    /// With an odd `rotor_count` the last and the first rotor spin the same way.
    pub fn regular(rotor_count: usize, arm_length: f32, moment_ratio: f32, offset: f32) -> Result<Self, GeometryError> {
        if rotor_count > MAX_ROTORS {
            return Err(GeometryError::TooManyRotors { count: rotor_count });
        }
        let mut rotors = [Rotor::ABSENT; MAX_ROTORS];
        for (i, rotor) in rotors.iter_mut().take(rotor_count).enumerate() {
            let turn = i as f64 / rotor_count as f64;
            let azimuth = f64::from(offset) + core::f64::consts::TAU * turn;
            let l = f64::from(arm_length);
            *rotor = Rotor {
                position_body: Vec3::new((l * libm::cos(azimuth)) as f32, (l * libm::sin(azimuth)) as f32, 0.0),
                spin: if i % 2 == 0 { Spin::Ccw } else { Spin::Cw },
                moment_ratio,
            };
        }
        Self::new(&rotors[..rotor_count])
    }

    /// n_a, from 4 to [`MAX_ROTORS`]; clamped again, so that the compiler sees the bound and the step needs no index checks.
    #[inline(always)]
    pub const fn rotor_count(&self) -> usize {
        if self.rotor_count < MAX_ROTORS {
            self.rotor_count
        } else {
            MAX_ROTORS
        }
    }

    /// The rotors, in the order of their indices.
    #[inline]
    pub fn rotors(&self) -> &[Rotor] {
        &self.rotors[..self.rotor_count()]
    }

    /// Rows Fz, Mx, My, Mz of F (Eqs. 6, 36), one column per rotor; columns past the rotor count are 0. N and N·m per
    /// N.
    #[inline]
    pub const fn effectiveness(&self) -> &[[f32; MAX_ROTORS]; 4] {
        &self.effectiveness
    }

    /// Wrench of the given thrusts, (Fz, Mx, My, Mz) = F f (Eq. 6), N and N·m, body. Entries past the rotor count are
    /// not read.
    #[inline]
    pub fn wrench_from_thrust(&self, thrust: &[f32; MAX_ROTORS]) -> [f32; 4] {
        self.wrench_of(&thrust[..self.rotor_count()])
    }

    /// [`Geometry::wrench_from_thrust`] with exactly one thrust per rotor.
    #[inline(always)]
    pub(crate) fn wrench_of(&self, thrust: &[f32]) -> [f32; 4] {
        let mut wrench = [0.0; WRENCH_AXES];
        for k in 0..thrust.len() {
            for axis in 0..WRENCH_AXES {
                wrench[axis] += self.effectiveness[axis][k] * thrust[k];
            }
        }
        wrench
    }

    /// Minimum-norm thrusts that produce a wrench, f = F⁺ (Fz, Mx, My, Mz), N.
    ///
    /// * `wrench`: N and N·m, body; hover has Fz = −m g
    ///
    /// Not limited to a rotor's range: a thrust may be negative. Entries past the rotor count are 0.
    #[inline]
    pub fn allocate(&self, wrench: [f32; 4]) -> [f32; MAX_ROTORS] {
        let mut thrust = [0.0; MAX_ROTORS];
        self.allocate_to(wrench, &mut thrust[..self.rotor_count()]);
        thrust
    }

    /// [`Geometry::allocate`] with exactly one thrust per rotor.
    #[inline(always)]
    pub(crate) fn allocate_to(&self, wrench: [f32; 4], thrust: &mut [f32]) {
        let [fz, mx, my, mz] = &self.allocation;
        for k in 0..thrust.len() {
            thrust[k] = fz[k] * wrench[0] + mx[k] * wrench[1] + my[k] * wrench[2] + mz[k] * wrench[3];
        }
    }

    /// Rows v_i3, v_i4, v_i5 of Eqs. 37–39, restricted to (Fz, Mx, My, Mz), of rotor `rotor` (from 0).
    ///
    /// Together with e₁ and e₂ a basis of ker(F_iᵀ): what they project is blind to this rotor. Entries on Fz in m, on
    /// torques 1. A rotor past the rotor count has a basis of zeros; an index past [`MAX_ROTORS`] panics.
    #[inline]
    pub const fn decoupling_basis(&self, rotor: usize) -> &[[f32; 4]; 3] {
        &self.basis[rotor]
    }

    /// p_ik = V_iᵀF_k of Eq. 28, components 3, 4, 5: how 1 N on `source` drives the residual of `observer` (both from
    /// 0).
    ///
    /// Exactly zero for `observer == source`, and only then not all zero.
    #[inline]
    pub fn fault_coupling(&self, observer: usize, source: usize) -> [f32; 3] {
        if observer == source {
            return [0.0; 3];
        }
        let f = &self.effectiveness;
        self.basis[observer]
            .map(|v| v[0] * f[0][source] + v[1] * f[1][source] + v[2] * f[2][source] + v[3] * f[3][source])
    }
}

/// Reaction torque about body z per thrust, m.
fn yaw_torque(rotor: &Rotor) -> f64 {
    f64::from(rotor.spin.yaw_sign() * rotor.moment_ratio)
}

/// Hub position in the horizontal plane, m.
fn horizontal(rotor: &Rotor) -> (f64, f64) {
    (f64::from(rotor.position_body.x), f64::from(rotor.position_body.y))
}

fn check_spacing(rotors: &[Rotor]) -> Result<(), GeometryError> {
    let mut longest_arm = 0.0;
    for r in rotors {
        let (x, y) = horizontal(r);
        longest_arm = libm::fmax(longest_arm, libm::hypot(x, y));
    }
    let limit = SAME_PLACE_SHARE * longest_arm;
    for (rotor, r) in rotors.iter().enumerate() {
        let (x, y) = horizontal(r);
        if libm::hypot(x, y) <= limit {
            return Err(GeometryError::OnVerticalAxis { rotor });
        }
        // Columns of rotors at the same place that turn the same way are parallel: no residual tells them apart (§4.2).
        for (first, other) in rotors[..rotor].iter().enumerate() {
            let (other_x, other_y) = horizontal(other);
            if r.spin == other.spin && libm::hypot(x - other_x, y - other_y) <= limit {
                return Err(GeometryError::CoaxialSameSpin { first, second: rotor });
            }
        }
    }
    Ok(())
}

/// Axes that a layout of vertical rotors can command, in the order of the rows of F.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WrenchAxis {
    /// Fz.
    VerticalForce,
    /// Mx.
    Roll,
    /// My.
    Pitch,
    /// Mz.
    Yaw,
}

impl WrenchAxis {
    const ALL: [Self; WRENCH_AXES] = [Self::VerticalForce, Self::Roll, Self::Pitch, Self::Yaw];
}

/// Why a layout is rejected. Indices count from 0; the text counts from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeometryError {
    /// Fewer than [`MIN_ROTORS`].
    TooFewRotors {
        /// Count given.
        count: usize,
    },
    /// More than [`MAX_ROTORS`].
    TooManyRotors {
        /// Count given.
        count: usize,
    },
    /// A coordinate is NaN or infinite.
    PositionNotFinite {
        /// Zero-based.
        rotor: usize,
    },
    /// c_D/c_L is zero, negative, NaN or infinite.
    MomentRatioNotPositive {
        /// Zero-based.
        rotor: usize,
    },
    /// No arm, hence no azimuth, hence no basis of Eqs. 37–39.
    OnVerticalAxis {
        /// Zero-based.
        rotor: usize,
    },
    /// Two rotors one above the other that turn the same way.
    CoaxialSameSpin {
        /// Zero-based, the smaller index.
        first: usize,
        /// Zero-based.
        second: usize,
    },
    /// F (rows Fz, Mx, My, Mz) has a rank below 4.
    AxisNotIndependent {
        /// First axis that depends on the axes before it.
        axis: WrenchAxis,
    },
}

impl core::fmt::Display for GeometryError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::TooFewRotors { count } => write!(
                out,
                "a vehicle needs at least {MIN_ROTORS} rotors, but {count} are given"
            ),
            Self::TooManyRotors { count } => write!(
                out,
                "a vehicle may have at most {MAX_ROTORS} rotors, but {count} are given"
            ),
            Self::PositionNotFinite { rotor } => {
                write!(out, "the position of rotor {} is not a finite number", rotor + 1)
            }
            Self::MomentRatioNotPositive { rotor } => write!(
                out,
                "the moment ratio of rotor {} must be a positive length in metres",
                rotor + 1
            ),
            Self::OnVerticalAxis { rotor } => write!(
                out,
                "rotor {} sits on the vertical axis and so has no arm azimuth, which fault isolation needs",
                rotor + 1
            ),
            Self::CoaxialSameSpin { first, second } => write!(
                out,
                "rotors {} and {} are coaxial and turn the same way: faults of the two cannot be distinguished",
                first + 1,
                second + 1
            ),
            Self::AxisNotIndependent { axis } => out.write_str(match axis {
                WrenchAxis::VerticalForce => "the rotors cannot command a vertical force",
                WrenchAxis::Roll => "the rotors cannot command roll torque independently of the vertical force",
                WrenchAxis::Pitch => {
                    "the rotors cannot command pitch torque independently of the vertical force and roll torque"
                }
                WrenchAxis::Yaw => {
                    "the rotors cannot command yaw torque independently of the vertical force, roll and pitch torque"
                }
            }),
        }
    }
}

impl core::error::Error for GeometryError {}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;
    use proptest::prelude::*;
    use std::string::ToString;
    use std::vec::Vec;

    /// Relative to the larger of 1 and the entry: positions, moment ratio and results are each rounded to f32 (6e-8),
    /// and the pseudo-inverse of a well-conditioned layout passes relative errors on about once.
    const F32_TOLERANCE: f64 = 2e-7;

    fn assert_close(got: f32, want: &serde_json::Value, what: &str) {
        let want = want.as_f64().expect("a number");
        let error = (f64::from(got) - want).abs();
        assert!(
            error <= F32_TOLERANCE * want.abs().max(1.0),
            "{what}: {got} against {want}"
        );
    }

    #[test]
    fn val_reference_layouts() {
        let text = std::fs::read_to_string(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../tests/vectors/geometry.json"
        ))
        .expect("readable");
        let vectors: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let moment_ratio = vectors["kappa"].as_f64().expect("number") as f32;
        let arm_length = vectors["l"].as_f64().expect("number") as f32;
        for (name, n, offset) in [
            ("hexa_x", 6, PI / 6.0),
            ("hexa_plus", 6, 0.0),
            ("quad_x", 4, PI / 4.0),
            ("octo_x", 8, PI / 8.0),
        ] {
            let geometry = Geometry::regular(n, arm_length, moment_ratio, offset).expect("flyable");
            let want = &vectors[name];
            assert_eq!(geometry.rotor_count(), n);
            for i in 0..n {
                let spin = want["spin"][i].as_f64().expect("number") as f32;
                assert_eq!(geometry.rotors()[i].spin.yaw_sign(), -spin);
                for axis in 0..4 {
                    assert_close(geometry.effectiveness()[axis][i], &want["F"][axis + 2][i], "F");
                    let mut unit = [0.0; 4];
                    unit[axis] = 1.0;
                    let entry = geometry.allocate(unit)[i];
                    assert_close(entry, &want["Fred_pinv"][i][axis], "pinv");
                    for component in 0..3 {
                        let v = geometry.decoupling_basis(i)[component][axis];
                        assert_close(v, &want["V"][i][axis + 2][component + 2], "V");
                    }
                }
                for k in 0..n {
                    for (component, p) in geometry.fault_coupling(i, k).into_iter().enumerate() {
                        assert_close(p, &want["p"][i][k][component], "p");
                    }
                }
            }
        }
    }

    /// Any valid layout: an irregular ring with random spins.
    fn any_rotors() -> impl Strategy<Value = Vec<Rotor>> {
        let rotor = (0.1f32..1.0, -0.4f32..0.4, -0.1f32..0.1, any::<bool>(), 0.005f32..0.05);
        proptest::collection::vec(rotor, MIN_ROTORS..=MAX_ROTORS).prop_map(|list| {
            let n = list.len() as f32;
            let on_ring = |(i, (arm, jitter, z, cw, moment_ratio)): (usize, (f32, f32, f32, bool, f32))| {
                let azimuth = (i as f32 + jitter) * 2.0 * PI / n;
                Rotor {
                    position_body: Vec3::new(arm * libm::cosf(azimuth), arm * libm::sinf(azimuth), z),
                    spin: if cw { Spin::Cw } else { Spin::Ccw },
                    moment_ratio,
                }
            };
            list.into_iter().enumerate().map(on_ring).collect()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn prop_basis_is_blind_to_its_own_rotor_and_sees_every_other(rotors in any_rotors()) {
            let Ok(geometry) = Geometry::new(&rotors) else { return Ok(()) };
            for i in 0..rotors.len() {
                for k in 0..rotors.len() {
                    let p = geometry.fault_coupling(i, k);
                    if i == k {
                        prop_assert_eq!(p, [0.0; 3]);
                        // The stored vectors too, up to the rounding of three products below 1.
                        for v in geometry.decoupling_basis(i) {
                            let f: f32 = (0..4).map(|axis| v[axis] * geometry.effectiveness()[axis][i]).sum();
                            prop_assert!(f.abs() < 3e-7, "V{i} F{i} = {f}");
                        }
                    } else {
                        let size = p[0].abs() + p[1].abs() + p[2].abs();
                        // A millimetre of spacing leaves 1e-3 or so.
                        prop_assert!(size > 1e-4, "p[{i}][{k}] = {p:?}");
                    }
                }
            }
        }

        #[test]
        fn prop_allocation_gives_the_wrench_back(rotors in any_rotors(), fz in -40.0f32..0.0,
                                                 mx in -2.0f32..2.0, my in -2.0f32..2.0, mz in -0.2f32..0.2) {
            let Ok(geometry) = Geometry::new(&rotors) else { return Ok(()) };
            let thrust = geometry.allocate([fz, mx, my, mz]);
            let largest = thrust.iter().fold(1.0f32, |a, f| a.max(f.abs()));
            let wrench = geometry.wrench_from_thrust(&thrust);
            for (got, want) in wrench.into_iter().zip([fz, mx, my, mz]) {
                // 16 rounded thrusts, summed.
                prop_assert!((got - want).abs() < 4e-6 * largest, "{got} against {want}");
            }
            prop_assert!(thrust[rotors.len()..].iter().all(|f| *f == 0.0));
        }

        #[test]
        fn prop_height_of_a_rotor_has_no_effect(mut rotors in any_rotors(), z in -1.0f32..1.0) {
            let Ok(geometry) = Geometry::new(&rotors) else { return Ok(()) };
            rotors[0].position_body.z = z;
            let moved = Geometry::new(&rotors).expect("as flyable as before");
            prop_assert_eq!(geometry.effectiveness(), moved.effectiveness());
            prop_assert_eq!(geometry.decoupling_basis(0), moved.decoupling_basis(0));
        }
    }

    fn quad() -> [Rotor; 4] {
        let geometry = Geometry::regular(4, 0.2, 0.016, PI / 4.0).expect("flyable");
        core::array::from_fn(|i| geometry.rotors()[i])
    }

    #[test]
    fn val_refusals_name_the_reason() {
        let refusal = |rotors: &[Rotor]| Geometry::new(rotors).expect_err("refused");
        let mut six = [quad().as_slice(), quad().as_slice()].concat();
        six.truncate(6);
        let coaxial = refusal(&six);
        assert_eq!(coaxial, GeometryError::CoaxialSameSpin { first: 0, second: 4 });
        assert!(
            coaxial
                .to_string()
                .starts_with("rotors 1 and 5 are coaxial and turn the same way")
        );

        assert_eq!(refusal(&quad()[..3]), GeometryError::TooFewRotors { count: 3 });
        assert_eq!(
            Geometry::regular(17, 0.2, 0.016, 0.0),
            Err(GeometryError::TooManyRotors { count: 17 })
        );
        assert_eq!(
            Geometry::regular(0, 0.2, 0.016, 0.0),
            Err(GeometryError::TooFewRotors { count: 0 })
        );

        let mut rotors = quad();
        rotors[2].position_body.z = f32::NAN;
        assert_eq!(refusal(&rotors), GeometryError::PositionNotFinite { rotor: 2 });

        for bad in [0.0, -0.016, f32::NAN, f32::INFINITY] {
            let mut rotors = quad();
            rotors[3].moment_ratio = bad;
            assert_eq!(refusal(&rotors), GeometryError::MomentRatioNotPositive { rotor: 3 });
        }

        let centred = [
            quad().as_slice(),
            &[Rotor {
                position_body: Vec3::ZERO,
                ..quad()[0]
            }],
        ]
        .concat();
        assert_eq!(refusal(&centred), GeometryError::OnVerticalAxis { rotor: 4 });
        assert_eq!(
            Geometry::regular(6, 0.0, 0.016, 0.0),
            Err(GeometryError::OnVerticalAxis { rotor: 0 })
        );

        let one_way = quad().map(|r| Rotor { spin: Spin::Cw, ..r });
        assert_eq!(
            refusal(&one_way),
            GeometryError::AxisNotIndependent { axis: WrenchAxis::Yaw }
        );

        let in_line = [0.1f32, 0.2, -0.1, -0.3].map(|x| Rotor {
            position_body: Vec3::new(x, 0.7 * x, 0.0),
            ..quad()[0]
        });
        assert_eq!(
            refusal(&in_line),
            GeometryError::AxisNotIndependent {
                axis: WrenchAxis::Pitch
            }
        );
    }
}
