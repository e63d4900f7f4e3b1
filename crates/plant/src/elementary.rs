//! Elementary functions in `f64`, twice with the same bits: from `libm`, and without branches.
//!
//! [`BranchFree`] repeats the operations of `libm` 0.2 (fdlibm) in its order on the arguments that flights have, computing every case
//! and selecting one, so that compilers can lay flights side by side in vector registers. Arguments outside of that range raise a
//! flag, and the caller falls back on [`Libm`]. Tests compare the two bit by bit.

/// The functions that attitudes need.
pub(crate) trait Elementary {
    /// Angle of the point (x, y), rad.
    fn atan2(&mut self, y: f64, x: f64) -> f64;
    /// Angle of a sine, rad.
    fn asin(&mut self, x: f64) -> f64;
}

/// The crate `libm`.
pub(crate) struct Libm;

impl Elementary for Libm {
    #[inline]
    fn atan2(&mut self, y: f64, x: f64) -> f64 {
        libm::atan2(y, x)
    }

    #[inline]
    fn asin(&mut self, x: f64) -> f64 {
        libm::asin(x)
    }
}

/// See the module.
#[derive(Default)]
pub(crate) struct BranchFree {
    /// An argument was outside of the range: results have no meaning.
    pub(crate) outside: bool,
}

const PI: f64 = core::f64::consts::PI;
const PI_LO: f64 = 1.224_646_799_147_353_2e-16;

/// atan of 0.5, 1, 1.5, ∞: high and low parts.
const ATAN_HI: [f64; 4] = [
    4.636_476_090_008_061e-1,
    core::f64::consts::FRAC_PI_4,
    9.827_937_232_473_29e-1,
    core::f64::consts::FRAC_PI_2,
];
const ATAN_LO: [f64; 4] = [
    2.269_877_745_296_168_7e-17,
    3.061_616_997_868_383e-17,
    1.390_331_103_123_099_8e-17,
    6.123_233_995_736_766e-17,
];
const ATAN: [f64; 11] = [
    3.333_333_333_333_293e-1,
    -1.999_999_999_987_648_3e-1,
    1.428_571_427_250_346_6e-1,
    -1.111_111_040_546_235_6e-1,
    9.090_887_133_436_507e-2,
    -7.691_876_205_044_83e-2,
    6.661_073_137_387_531e-2,
    -5.833_570_133_790_573_5e-2,
    4.976_877_994_615_932e-2,
    -3.653_157_274_421_691_6e-2,
    1.628_582_011_536_578_2e-2,
];

/// Ratios up to this are in range.
const LARGEST_RATIO: f64 = 1e18;

#[expect(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "NaN fails the comparison and is outside"
)]
impl Elementary for BranchFree {
    #[inline(always)]
    fn atan2(&mut self, y: f64, x: f64) -> f64 {
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
        let s1 = z * (ATAN[0] + w * (ATAN[2] + w * (ATAN[4] + w * (ATAN[6] + w * (ATAN[8] + w * ATAN[10])))));
        let s2 = w * (ATAN[1] + w * (ATAN[3] + w * (ATAN[5] + w * (ATAN[7] + w * ATAN[9]))));
        let product = r * (s1 + s2);
        let reduced = hi - (product - lo - r);
        let angle = if t < 0.4375 { r - product } else { reduced };
        let angle = if x.is_sign_negative() {
            PI - (angle - PI_LO)
        } else {
            angle
        };
        angle.copysign(y)
    }

    #[inline(always)]
    fn asin(&mut self, x: f64) -> f64 {
        self.outside |= !(x.abs() < 0.5);
        let z = x * x;
        let p = z
            * (1.666_666_666_666_666_6e-1
                + z * (-3.255_658_186_224_009e-1
                    + z * (2.012_125_321_348_629_3e-1
                        + z * (-4.005_553_450_067_941e-2
                            + z * (7.915_349_942_898_145e-4 + z * 3.479_331_075_960_212e-5)))));
        let q = 1.0
            + z * (-2.403_394_911_734_414
                + z * (2.020_945_760_233_505_7 + z * (-6.882_839_716_054_533e-1 + z * 7.703_815_055_590_194e-2)));
        x + x * (p / q)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn same_atan2(y: f64, x: f64) -> Result<(), String> {
        let mut fast = BranchFree::default();
        let got = fast.atan2(y, x);
        let want = libm::atan2(y, x);
        if fast.outside || got.to_bits() == want.to_bits() {
            Ok(())
        } else {
            Err(format!("atan2({y:e}, {x:e}): {got:e} against {want:e}"))
        }
    }

    /// Numbers of every size near the borders between cases, then random bits.
    #[test]
    fn val_branch_free_functions_have_the_bits_of_libm() {
        let mut in_range = 0;
        for border in [0.4375, 0.6875, 1.1875, 2.4375, 1e-300, 1e-9, 1.0, 1e9] {
            for steps in -40i64..40 {
                let t = f64::from_bits((f64::to_bits(border) as i64 + steps) as u64);
                for (y, x) in [(t, 1.0), (-t, 1.0), (t, -1.0), (-t, -1.0), (t, 3.0), (1.0, t)] {
                    same_atan2(y, x).expect("same bits");
                }
            }
        }
        for (y, x) in [
            (0.0, 1.0),
            (-0.0, 1.0),
            (0.0, -1.0),
            (-0.0, -1.0),
            (0.0, 0.0),
            (1.0, 0.0),
        ] {
            same_atan2(y, x).expect("same bits");
        }
        let mut state = 1u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            state ^ (state >> 29)
        };
        for _ in 0..400_000 {
            // Within [-2, 2), then any size.
            let unit = |bits: u64| (bits as i64 as f64) / (1i64 << 62) as f64;
            let (a, b) = (random(), random());
            same_atan2(unit(a), unit(b)).expect("same bits");
            same_atan2(f64::from_bits(a), f64::from_bits(b)).expect("same bits");
            for x in [unit(a) * 0.25, f64::from_bits(b)] {
                let mut fast = BranchFree::default();
                let got = fast.asin(x);
                if !fast.outside {
                    in_range += 1;
                    assert_eq!(got.to_bits(), libm::asin(x).to_bits(), "asin({x:e})");
                }
            }
        }
        assert!(in_range > 400_000);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_attitudes_are_in_range(roll in -3.1f64..3.1, pitch in -0.52f64..0.52) {
            let mut fast = BranchFree::default();
            fast.atan2(libm::sin(roll), libm::cos(roll));
            fast.asin(libm::sin(pitch));
            prop_assert!(!fast.outside);
        }
    }
}
