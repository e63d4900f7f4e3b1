//! Detects a loss that grows too slowly for the engine, whose filters take a ramp of a few tenths of a per cent per
//! second for a drifting bias.
//!
//! The lost wrench here has no onset time, so the explanations of a window are independent of how fast it arose. A loss
//! that the engine has not found counts as found once one rotor alone has explained the wrench for [`HOLD`] consecutive
//! windows ([`HOLD_CAREFUL`] where the model has failed), with up to [`MISSES`] exceptions in a row, and it is larger
//! than a sudden loss would have to be. It stays found until nothing is lost any more.

/// Explanation of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lone {
    /// Bit i: rotor i, from 0.
    pub rotor: u32,
    /// Larger than the detectable size of a sudden loss.
    pub is_large: bool,
}

/// Windows with the same rotor before it is found: 1 s; 10 s where the model has failed.
const HOLD: usize = 16;
const HOLD_CAREFUL: usize = 160;
/// Consecutive windows that may disagree.
const MISSES: usize = 4;

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct GrowthWatch {
    /// Bit i: rotor i, from 0.
    rotor: u32,
    windows: usize,
    misses: usize,
    is_found: bool,
}

impl GrowthWatch {
    /// Processes a window; returns whether there is a loss.
    ///
    /// * `lone`: the rotor that alone explains the wrench   * `is_trusted`: the model has explained the flight so far
    pub(super) fn take(&mut self, lone: Option<Lone>, is_trusted: bool) -> bool {
        let Some(lone) = lone else {
            self.misses += 1;
            if self.misses > MISSES {
                self.clear();
            }
            return self.is_found;
        };
        if lone.rotor != self.rotor {
            *self = Self {
                rotor: lone.rotor,
                ..Self::default()
            };
        }
        self.misses = 0;
        self.windows += 1;
        let hold = if is_trusted { HOLD } else { HOLD_CAREFUL };
        self.is_found |= lone.is_large && self.windows >= hold;
        self.is_found
    }

    /// A loss was found in this way, and persists.
    pub(super) fn is_found(&self) -> bool {
        self.is_found
    }

    /// Nothing is lost, or something else has happened.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lone(rotor: u32) -> Option<Lone> {
        Some(Lone { rotor, is_large: true })
    }

    /// Window in which a loss is found.
    fn found(is_trusted: bool, windows: usize, lone: impl Fn(usize) -> Option<Lone>) -> Option<usize> {
        let mut watch = GrowthWatch::default();
        (0..windows).find(|window| watch.take(lone(*window), is_trusted))
    }

    #[test]
    fn val_one_rotor_for_long_is_a_loss() {
        let grows = |window: usize| lone(4).filter(|_| window >= 100);
        assert_eq!(found(true, 400, grows), Some(100 + HOLD - 1));
        assert_eq!(found(false, 400, grows), Some(100 + HOLD_CAREFUL - 1));
        // A window or two that say otherwise are noise.
        assert!(found(true, 400, |window| grows(window).filter(|_| !window.is_multiple_of(10))).is_some());
        // Clear for long, and large at last.
        let slow = |window: usize| {
            Some(Lone {
                rotor: 4,
                is_large: window >= 200,
            })
        };
        assert_eq!(found(true, 400, slow), Some(200));
    }

    #[test]
    fn val_one_after_the_other_and_what_ends_are_none() {
        assert_eq!(found(true, 400, |window| lone(1 << (window / (HOLD - 1) % 6))), None);
        assert_eq!(
            found(true, 400, |window| lone(4).filter(|_| window % HOLD > MISSES)),
            None
        );
        let mut watch = GrowthWatch::default();
        assert!((0..HOLD).fold(false, |_, _| watch.take(lone(4), true)));
        watch.clear();
        assert!(!watch.is_found() && !watch.take(lone(4), true));
    }
}
