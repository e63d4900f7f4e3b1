//! The same code compiled for several instruction sets, the best of which is chosen at run time.
//!
//! Flights side by side ([`crate::batch`]) are plain loops over lanes that a compiler turns into vector instructions; the wider the
//! registers, the faster. Bits do not depend on the choice: no operation is contracted or reordered, on any of them.

/// Work that is worth compiling for wide registers. `run` must be `#[inline(always)]`, and so must everything it calls.
///
/// Input and output are plain data behind one reference each: two references that arrive as arguments cannot overlap,
/// which allows a compiler to keep several lanes in flight. A reference within them would hide that.
pub trait VectorWork {
    /// What it reads.
    type Input;
    /// What it writes.
    type Output;
    /// Whether registers of 512 bits are worth it. Rows of eight `f32` fill 256, and so may rows of `f64` that were written number by
    /// number just before: a load across many stores waits for them.
    const WIDE: bool;
    /// Does it.
    fn run(input: &Self::Input, output: &mut Self::Output);
}

/// Instruction sets that are distinguished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VectorUnit {
    /// What every processor of this architecture has.
    Baseline,
    /// x86-64 with AVX2: four `f64` at a time.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// x86-64 with AVX-512 F, DQ, BW and VL: eight `f64` at a time.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl VectorUnit {
    /// The best that this processor has.
    pub fn detect() -> Self {
        Self::available().last().copied().unwrap_or(Self::Baseline)
    }

    /// All that this processor has, the fastest last.
    pub fn available() -> &'static [Self] {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = std::arch::is_x86_feature_detected!("avx2");
            let avx512 = std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512dq")
                && std::arch::is_x86_feature_detected!("avx512bw")
                && std::arch::is_x86_feature_detected!("avx512vl");
            match (avx2, avx512) {
                (true, true) => &[Self::Baseline, Self::Avx2, Self::Avx512],
                (true, false) => &[Self::Baseline, Self::Avx2],
                _ => &[Self::Baseline],
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        &[Self::Baseline]
    }

    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "AVX-512",
        }
    }
}

/// Proof that this processor has an instruction set; the only way to run work on it.
#[derive(Debug, Clone, Copy)]
pub struct Dispatch(VectorUnit);

impl Default for Dispatch {
    fn default() -> Self {
        Self(VectorUnit::detect())
    }
}

impl Dispatch {
    /// For `unit`, if this processor has it.
    pub fn new(unit: VectorUnit) -> Option<Self> {
        VectorUnit::available().contains(&unit).then_some(Self(unit))
    }

    /// Which one.
    pub fn unit(self) -> VectorUnit {
        self.0
    }

    /// Runs `W` compiled for this instruction set.
    #[inline]
    #[cfg_attr(
        target_arch = "x86_64",
        expect(
            unsafe_code,
            reason = "a call into code for an instruction set that has been detected"
        )
    )]
    pub fn run<W: VectorWork>(self, input: &W::Input, output: &mut W::Output) {
        match self.0 {
            VectorUnit::Baseline => baseline::<W>(input, output),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a `Dispatch` is made by `detect` or by `new`, both of which ask the processor for exactly these features.
            VectorUnit::Avx512 if W::WIDE => unsafe { avx512::<W>(input, output) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above; AVX-512 is only available together with AVX2.
            VectorUnit::Avx2 | VectorUnit::Avx512 => unsafe { avx2::<W>(input, output) },
        }
    }
}

fn baseline<W: VectorWork>(input: &W::Input, output: &mut W::Output) {
    W::run(input, output);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<W: VectorWork>(input: &W::Input, output: &mut W::Output) {
    W::run(input, output);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512dq,avx512bw,avx512vl")]
fn avx512<W: VectorWork>(input: &W::Input, output: &mut W::Output) {
    W::run(input, output);
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Double;

    impl VectorWork for Double {
        type Input = [f64; 8];
        type Output = [f64; 8];
        const WIDE: bool = true;
        #[inline(always)]
        fn run(input: &[f64; 8], output: &mut [f64; 8]) {
            for lane in 0..8 {
                output[lane] = 2.0 * input[lane];
            }
        }
    }

    #[test]
    fn val_every_available_unit_runs() {
        assert_eq!(VectorUnit::available()[0], VectorUnit::Baseline);
        for unit in VectorUnit::available() {
            let mut doubled = [0.0; 8];
            Dispatch::new(*unit)
                .expect("available")
                .run::<Double>(&[1.5; 8], &mut doubled);
            assert_eq!(doubled, [3.0; 8]);
        }
        assert_eq!(Some(&Dispatch::default().unit()), VectorUnit::available().last());
    }
}
