//! What a decision says beside its verdict: lost thrusts with their intervals, and the sets of rotors that come into question.

/// Most sets of rotors that are listed by name.
pub const MAX_HYPOTHESES: usize = 8;

/// Half the width of a 95 % interval in standard deviations.
const SIGMAS: f32 = 1.96;

/// Lost thrust of one rotor at hover, with its 95 % interval; all 0 if there is none to speak of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossEstimate {
    /// N, not negative.
    pub loss: f32,
    /// Lower end, N, not negative.
    pub low: f32,
    /// Upper end, N.
    pub high: f32,
    /// Thrust of the healthy rotor at hover, N: what shares are shares of.
    pub nominal: f32,
}

impl LossEstimate {
    /// * `loss`, `deviation`, `nominal`: N
    #[inline]
    pub(super) fn new(loss: f32, deviation: f32, nominal: f32) -> Self {
        let loss = loss.max(0.0);
        Self {
            loss,
            low: (loss - SIGMAS * deviation).max(0.0),
            high: loss + SIGMAS * deviation,
            nominal,
        }
    }

    /// Loss, lower and upper end as shares of the nominal thrust.
    #[inline]
    pub fn share(&self) -> [f32; 3] {
        if self.nominal > 0.0 {
            [self.loss, self.low, self.high].map(|thrust| thrust / self.nominal)
        } else {
            [0.0; 3]
        }
    }
}

/// Rotors that a decision is about. Sets of rotors are bit masks: bit 0 is rotor 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Suspects {
    /// One rotor, two of a pair, or all that an ambiguous verdict leaves open.
    pub rotors: u32,
    /// Sets that an ambiguous verdict leaves open, also those beyond [`MAX_HYPOTHESES`]; 0 for other verdicts.
    pub hypothesis_count: u16,
    /// The likeliest of them, likeliest first; 0 past the count.
    pub hypotheses: [u32; MAX_HYPOTHESES],
}

impl Suspects {
    /// The rotors of a verdict that leaves nothing open.
    #[inline]
    pub(super) fn certain(rotors: u32) -> Self {
        Self {
            rotors,
            ..Self::default()
        }
    }
}
