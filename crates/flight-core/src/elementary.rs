//! Elementary functions in `f32`, in two bit-identical implementations: from `libm`, and branch-free.
//!
//! On board and for a single flight, [`Libm`] is faster. [`BranchFree`] repeats the operations of `libm` 0.2 (fdlibm) in the same order
//! over the argument range that occurs in flight, computing every case and selecting one, so that a compiler can vectorise over
//! several flights. Arguments outside that range set a flag. Tests compare the two bit by bit.

use core::f64::consts::FRAC_PI_2;

#[cfg(not(target_os = "none"))]
extern crate std;

/// √x. IEEE 754 requires correct rounding, so every implementation gives the same bits: `libm` on a board; elsewhere the compiler's own, as
/// `libm`'s is an assembly instruction there, which prevents loops over flights from being vectorised.
#[inline(always)]
pub(crate) fn square_root(x: f32) -> f32 {
    #[cfg(target_os = "none")]
    return libm::sqrtf(x);
    #[cfg(not(target_os = "none"))]
    x.sqrt()
}

/// [`square_root`] in `f64`.
#[inline(always)]
fn square_root_f64(x: f64) -> f64 {
    #[cfg(target_os = "none")]
    return libm::sqrt(x);
    #[cfg(not(target_os = "none"))]
    x.sqrt()
}

/// `angle` wrapped into (−π, π], rad. For angles of a few turns; loses precision beyond 10⁴ rad.
#[inline]
fn wrap_angle(angle: f32) -> f32 {
    libm::atan2f(libm::sinf(angle), libm::cosf(angle))
}

/// The functions that the control and residual equations need.
pub trait Elementary {
    /// sin x and cos x.
    fn sin_cos(&mut self, x: f32) -> (f32, f32);
    /// Angle of a sine, rad.
    fn asin(&mut self, x: f32) -> f32;
    /// Angle of the point (x, y), rad.
    fn atan2(&mut self, y: f32, x: f32) -> f32;
    /// Wraps an angle into (−π, π], rad; unchanged if already within ±π.
    fn wrap_angle(&mut self, angle: f32) -> f32;
}

/// The crate `libm`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Libm;

impl Elementary for Libm {
    #[inline]
    fn sin_cos(&mut self, x: f32) -> (f32, f32) {
        libm::sincosf(x)
    }

    #[inline]
    fn asin(&mut self, x: f32) -> f32 {
        libm::asinf(x)
    }

    #[inline]
    fn atan2(&mut self, y: f32, x: f32) -> f32 {
        libm::atan2f(y, x)
    }

    #[inline]
    fn wrap_angle(&mut self, angle: f32) -> f32 {
        // No transcendental functions (and no rounding) when there is nothing to wrap.
        if angle.abs() <= PI { angle } else { wrap_angle(angle) }
    }
}

/// See the module documentation.
#[derive(Clone, Copy, Debug, Default)]
pub struct BranchFree {
    /// An argument was out of range: the results are meaningless.
    pub outside: bool,
}

/// Largest angle in range, rad: just below 9π/4, where `libm` switches method.
const LARGEST_ANGLE: f32 = 7.0;
/// Largest ratio in range of the two-argument arc tangent.
const LARGEST_RATIO: f32 = 1e7;

/// Boundaries between the octants of `libm`, which compares bit patterns.
const OCTANT: [f32; 4] = [
    f32::from_bits(0x3f49_0fda),
    f32::from_bits(0x4016_cbe3),
    f32::from_bits(0x407b_53d1),
    f32::from_bits(0x40af_eddf),
];

const PI: f32 = core::f32::consts::PI;
const PI_LO: f32 = f32::from_bits(0xb3bb_bd2e);
const ATAN_HI: [f32; 4] = [
    f32::from_bits(0x3eed_6338),
    f32::from_bits(0x3f49_0fda),
    f32::from_bits(0x3f7b_985e),
    f32::from_bits(0x3fc9_0fda),
];
const ATAN_LO: [f32; 4] = [
    f32::from_bits(0x31ac_3769),
    f32::from_bits(0x3322_2168),
    f32::from_bits(0x3314_0fb4),
    f32::from_bits(0x33a2_2168),
];
/// Coefficients of the arc tangent.
const ATAN: [f32; 5] = [
    f32::from_bits(0x3eaa_aaa9),
    f32::from_bits(0xbe4c_ca98),
    f32::from_bits(0x3e11_f50d),
    f32::from_bits(0xbdda_1247),
    f32::from_bits(0x3d7c_ac25),
];

/// Coefficients of the arc sine: three of the numerator, one of the denominator.
const ASIN: [f32; 4] = [
    f32::from_bits(0x3e2a_aa75),
    f32::from_bits(0xbd2f_13ba),
    f32::from_bits(0xbc0d_d36b),
    f32::from_bits(0xbf34_e5ae),
];

#[expect(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "NaN fails the comparison and is outside"
)]
impl Elementary for BranchFree {
    #[inline(always)]
    fn sin_cos(&mut self, x: f32) -> (f32, f32) {
        let size = x.abs();
        self.outside |= !(size <= LARGEST_ANGLE);
        let (first, second) = (size > OCTANT[0], size > OCTANT[1]);
        let (third, fourth) = (size > OCTANT[2], size > OCTANT[3]);
        let quarter = if fourth {
            4.0 * FRAC_PI_2
        } else if third {
            3.0 * FRAC_PI_2
        } else if second {
            2.0 * FRAC_PI_2
        } else if first {
            FRAC_PI_2
        } else {
            0.0
        };
        let y = f64::from(size) - quarter;
        let z = y * y;
        let w = z * z;
        let s = z * y;
        // k_sinf and k_cosf.
        let r = -0.000_198_393_348_360_966_32 + z * 2.718_311_493_989_822e-6;
        let sine = ((y + s * (-0.166_666_666_416_265_24 + z * 0.008_333_329_385_889_463)) + s * w * r) as f32;
        let r = -0.001_388_676_377_460_993 + z * 0.000_024_390_448_796_277_41;
        let cosine = (((1.0 + z * -0.499_999_997_251_031) + w * 0.041_666_623_323_739_06) + (w * z) * r) as f32;
        // Quarter-turn index 1 or 3: sine and cosine swap.
        let odd = (first & !second) | (third & !fourth);
        let (sin, cos) = if odd { (cosine, -sine) } else { (sine, cosine) };
        // Index 2 or 3: both change sign.
        let half_turn = second & !fourth;
        let (sin, cos) = if half_turn { (-sin, -cos) } else { (sin, cos) };
        (if x.is_sign_negative() { -sin } else { sin }, cos)
    }

    #[inline(always)]
    fn asin(&mut self, x: f32) -> f32 {
        let size = x.abs();
        self.outside |= !(size < 1.0);
        let large = size >= 0.5;
        let z = if large { (1.0 - size) * 0.5 } else { x * x };
        let p = z * (ASIN[0] + z * (ASIN[1] + z * ASIN[2]));
        let q = 1.0 + z * ASIN[3];
        let r = p / q;
        let s = square_root_f64(f64::from(z));
        let of_large = (FRAC_PI_2 - 2.0 * (s + s * f64::from(r))) as f32;
        if large { of_large.copysign(x) } else { x + x * r }
    }

    #[inline(always)]
    fn atan2(&mut self, y: f32, x: f32) -> f32 {
        let t = (y / x).abs();
        self.outside |= !(t < LARGEST_RATIO);
        let (numerator, denominator, hi, lo) = if t < 0.4375 {
            (t, 1.0, 0.0, 0.0)
        } else if t < 0.6875 {
            (2.0 * t - 1.0, 2.0 + t, ATAN_HI[0], ATAN_LO[0])
        } else if t < 1.1875 {
            (t - 1.0, t + 1.0, ATAN_HI[1], ATAN_LO[1])
        } else if t < 2.4375 {
            (t - 1.5, 1.0 + 1.5 * t, ATAN_HI[2], ATAN_LO[2])
        } else {
            (-1.0, t, ATAN_HI[3], ATAN_LO[3])
        };
        let r = numerator / denominator;
        let z = r * r;
        let w = z * z;
        let s1 = z * (ATAN[0] + w * (ATAN[2] + w * ATAN[4]));
        let s2 = w * (ATAN[1] + w * ATAN[3]);
        let product = r * (s1 + s2);
        let angle = if t < 0.4375 {
            r - product
        } else {
            hi - ((product - lo) - r)
        };
        let angle = if x.is_sign_negative() {
            PI - (angle - PI_LO)
        } else {
            angle
        };
        angle.copysign(y)
    }

    #[inline(always)]
    fn wrap_angle(&mut self, angle: f32) -> f32 {
        self.outside |= !(angle.abs() <= PI);
        angle
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the bits of both, or does nothing if the argument is out of range.
    fn compare(x: f32, y: f32) {
        let mut f = BranchFree::default();
        let (got, want) = (f.sin_cos(x), libm::sincosf(x));
        if !f.outside {
            assert_eq!(got.0.to_bits(), want.0.to_bits(), "sin({x:e})");
            assert_eq!(got.1.to_bits(), want.1.to_bits(), "cos({x:e})");
        }
        let mut f = BranchFree::default();
        let (got, want) = (f.asin(x), libm::asinf(x));
        assert!(
            f.outside || got.to_bits() == want.to_bits(),
            "asin({x:e}): {got:e} {want:e}"
        );
        let mut f = BranchFree::default();
        let (got, want) = (f.atan2(y, x), libm::atan2f(y, x));
        assert!(
            f.outside || got.to_bits() == want.to_bits(),
            "atan2({y:e}, {x:e}): {got:e} {want:e}"
        );
    }

    fn random(state: &mut u64) -> u32 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 32) as u32
    }

    #[test]
    fn val_branch_free_functions_have_the_bits_of_libm() {
        // Every 1009th bit pattern (a prime), and all patterns near the boundaries.
        for bits in (0..=u32::MAX).step_by(1009) {
            compare(f32::from_bits(bits), 0.37);
            compare(-0.61, f32::from_bits(bits));
        }
        let borders = OCTANT
            .into_iter()
            .chain([0.4375, 0.5, 0.6875, 1.0, 1.1875, 2.4375, 2.44e-4, 7.0, 0.0]);
        for border in borders {
            for steps in 0..200u32 {
                let near = f32::from_bits((border.to_bits() + steps).saturating_sub(100));
                for x in [near, -near] {
                    compare(x, 1.0);
                    compare(1.0, x);
                    compare(x, -x);
                }
            }
        }
        let mut state = 1;
        for _ in 0..1_000_000 {
            compare(f32::from_bits(random(&mut state)), f32::from_bits(random(&mut state)));
            let unit = |bits: u32| bits.cast_signed() as f32 / (1u32 << 29) as f32;
            compare(unit(random(&mut state)), unit(random(&mut state)));
        }
    }

    /// All 2³² arguments: takes a minute. Run by hand when `libm` changes.
    #[test]
    #[ignore = "takes a minute"]
    fn val_every_argument() {
        for bits in 0..=u32::MAX {
            compare(f32::from_bits(bits), 1.0);
            let x = f32::from_bits(bits);
            let (sin, cos) = libm::sincosf(x);
            assert!(
                x.is_nan()
                    || !x.is_finite()
                    || (sin.to_bits(), cos.to_bits()) == (libm::sinf(x).to_bits(), libm::cosf(x).to_bits())
            );
        }
    }

    #[test]
    fn val_flight_angles_are_in_range() {
        let mut f = BranchFree::default();
        f.sin_cos(PI);
        f.sin_cos(-PI);
        f.asin(0.99);
        f.atan2(0.5, 0.01);
        assert!(!f.outside);
        for bad in [f32::NAN, f32::INFINITY, 8.0] {
            let mut f = BranchFree::default();
            f.sin_cos(bad);
            assert!(f.outside);
        }
    }
}
