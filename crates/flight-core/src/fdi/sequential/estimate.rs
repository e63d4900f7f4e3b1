//! Details of a decision besides its verdict: lost thrusts with their intervals, and the sets of suspect rotors.

/// Maximum number of rotor sets listed.
pub const MAX_HYPOTHESES: usize = 8;

/// Half the width of a 95 % interval in standard deviations.
const SIGMAS: f32 = 1.96;

/// Standard deviation of an estimated loss due to model error, as a fraction of it, and its growth with the fraction lost, because a
/// controller reacts to a large loss within few blocks. Less of the growth covered every size and trajectory on the flights on which it was
/// chosen, but not losses of 20 % of a quadrotor on others (docs/decisions/0109).
const MODEL_ERROR: f32 = 0.01;
const MODEL_ERROR_GROWTH: f32 = 0.05;

/// Lost thrust of one rotor at hover, with its 95 % interval; all 0 if negligible.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossEstimate {
    /// N, not negative.
    pub loss: f32,
    /// Lower end, N, not negative.
    pub low: f32,
    /// Upper end, N.
    pub high: f32,
    /// Hover thrust of the healthy rotor, N: the reference for fractions.
    pub nominal: f32,
}

impl LossEstimate {
    pub(crate) const NONE: Self = Self {
        loss: 0.0,
        low: 0.0,
        high: 0.0,
        nominal: 0.0,
    };

    /// * `loss`, `nominal`: N   * `variance`: of the loss as the filters see it, N²
    #[inline]
    pub(super) fn new(loss: f32, variance: f32, nominal: f32) -> Self {
        let loss = loss.max(0.0);
        let model = loss * (MODEL_ERROR + MODEL_ERROR_GROWTH * (loss / nominal).min(1.0));
        let deviation = libm::sqrtf(variance + model * model);
        Self {
            loss,
            low: (loss - SIGMAS * deviation).max(0.0),
            high: loss + SIGMAS * deviation,
            nominal,
        }
    }

    /// Loss, lower and upper end as fractions of the nominal thrust.
    #[inline]
    pub fn share(&self) -> [f32; 3] {
        if self.nominal > 0.0 {
            [self.loss, self.low, self.high].map(|thrust| thrust / self.nominal)
        } else {
            [0.0; 3]
        }
    }
}

/// Rotors that a decision concerns. Sets of rotors are bit masks: bit 0 is rotor 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Suspects {
    /// One rotor, the two of a pair, or all candidates of an ambiguous verdict.
    pub rotors: u32,
    /// Number of sets that an ambiguous verdict leaves open, including those beyond [`MAX_HYPOTHESES`]; 0 for other verdicts.
    pub hypothesis_count: u16,
    /// The likeliest of them, in descending order; 0 past the count.
    pub hypotheses: [u32; MAX_HYPOTHESES],
}

impl Suspects {
    pub(crate) const NONE: Self = Self {
        rotors: 0,
        hypothesis_count: 0,
        hypotheses: [0; MAX_HYPOTHESES],
    };

    /// The rotors of an unambiguous verdict.
    #[inline]
    pub(super) fn certain(rotors: u32) -> Self {
        Self {
            rotors,
            ..Self::default()
        }
    }

    /// More rotors than a verdict can name.
    #[inline]
    pub(super) fn one_set(rotors: u32) -> Self {
        let mut hypotheses = [0; MAX_HYPOTHESES];
        hypotheses[0] = rotors;
        Self {
            rotors,
            hypothesis_count: 1,
            hypotheses,
        }
    }

    /// Adds a set, while there is room.
    pub(super) fn add(&mut self, rotors: u32) {
        self.rotors |= rotors;
        self.hypothesis_count += 1;
        if let Some(free) = self.hypotheses.iter_mut().find(|set| **set == 0) {
            *free = rotors;
        }
    }

    /// Adds rotors known to be faulty to every set.
    #[inline]
    #[must_use]
    pub(super) fn with(mut self, known: u32) -> Self {
        self.rotors |= known;
        for set in &mut self.hypotheses {
            if *set != 0 {
                *set |= known;
            }
        }
        self
    }
}
