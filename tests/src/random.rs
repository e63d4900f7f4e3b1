//! Seeded choices, so that a failing test can be repeated.

use std::time::Duration;

/// SplitMix64 (Steele, Lea, Flood 2014).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The same seed gives the same choices.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 random bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `end`, which is not 0. The bias is below `end`/2⁶⁴.
    pub const fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }

    /// A duration below `end`, to the microsecond.
    pub fn duration(&mut self, end: Duration) -> Duration {
        Duration::from_micros(
            self.below(
                u64::try_from(end.as_micros())
                    .expect("durations of tests are short")
                    .max(1),
            ),
        )
    }
}
