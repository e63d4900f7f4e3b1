//! Detects a load that was dropped or picked up: the vertical force changes suddenly, alone except for the moment of a
//! load beside the centre of mass, and stays changed.
//!
//! The engine knows only losses of rotors, and an upward force is not one, so it finds nothing when a load is dropped.
//! Here the explanations of the lost wrench are evaluated in every window in which the vertical force has changed.
//! Gusts, sharp turns and thrust curves that differ from the model imitate a load for up to two seconds, or grow
//! slowly. A load
//!
//! * is the explanation of [`HOLD`] consecutive windows ([`HOLD_CAREFUL`] where the model has failed), with up to
//!   [`MISSES`] exceptions in a row;
//! * was absent a second before the first of them, and almost complete a second after it: at least [`SUDDEN`] of the
//!   force is new;
//! * is the same in the last half second as in the one before.

use super::details::Interval;
use std::collections::VecDeque;

/// Probability above which a window is explained by a load.
const LIKELY: f64 = 0.75;
/// Windows of a load before it is named: 3 s; 6 s where the model has failed.
const HOLD: usize = 48;
const HOLD_CAREFUL: usize = 96;
/// Windows after which a load can no longer be named, a minute: nothing older is stored.
const LONGEST: usize = 960;
/// Consecutive windows that may disagree.
const MISSES: usize = 4;
/// Windows of an average, half a second.
const MEAN: usize = 8;
/// The force is free from this many windows before the first one with a load to this many after it.
pub(super) const EARLIER: usize = 6;
pub(super) const LATER: usize = 8;
/// Windows before the first one with a load from which the force before is taken, and the first of them: a load is
/// detectable only a few windows after the change.
const BEFORE: usize = 16;
/// Share of the force that has to be new.
const SUDDEN: f64 = 0.7;
/// Largest change of the force within a second, as a share of it.
const SOON: f64 = 0.3;
/// Share of the force, in addition to two standard deviations, by which it may differ from half a second before.
const STEADY: f64 = 0.08;
/// Smallest load, share of the mass.
const LEAST: f64 = 0.025;
/// Largest load that may be dropped, and picked up, shares of the mass: few vehicles carry more than their own weight,
/// and none can drop it.
const MOST_DROPPED: f64 = 0.7;
const MOST_TAKEN_UP: f64 = 1.0;

/// Whether a downward force of this share of the weight can be that of a load.
pub(super) fn is_possible(share: f64) -> bool {
    (-MOST_DROPPED..=MOST_TAKEN_UP).contains(&share)
}

/// A load that was dropped or picked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadChange {
    /// From the change to the end of this window, s.
    pub since_s: f64,
    /// From the change to the end of the window that named it, s.
    pub named_after_s: f64,
    /// Of a load, against all other explanations of the same wrench; of the window that named it.
    pub probability: f32,
    /// Picked up; negative: dropped; with its 95 % interval, kg.
    pub mass_kg: Interval,
}

impl LoadChange {
    /// True if it was named in this window.
    pub fn is_new(&self) -> bool {
        self.since_s <= self.named_after_s
    }
}

impl std::fmt::Display for LoadChange {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Interval { value, low, high } = self.mass_kg;
        let mut ends = [low, high].map(|kg| 1000.0 * kg * value.signum());
        ends.sort_by(f32::total_cmp);
        write!(
            out,
            "{:.0} g [{:.0}, {:.0}] were {} ({:.2})",
            1000.0 * value.abs(),
            ends[0],
            ends[1],
            if value < 0.0 { "dropped" } else { "taken up" },
            self.probability
        )
    }
}

/// Result of one window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Force down, and its variance, N.
    pub force: [f64; 2],
    /// Of a load.
    pub probability: f64,
}

/// A load that is present.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    /// Windows since it appeared or disappeared.
    pub windows: usize,
    /// Change of the downward force, N.
    pub force: f64,
    /// Mean of the last windows.
    pub probability: f64,
}

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct LoadWatch {
    /// Forces of the last windows without a load.
    before: VecDeque<f64>,
    /// Windows since the first one with a load.
    run: Vec<Seen>,
    misses: usize,
}

impl LoadWatch {
    /// Processes a window.
    ///
    /// * `weight`: of the model's vehicle, N   * `is_trusted`: the model has explained the flight so far
    pub(super) fn take(&mut self, seen: Seen, weight: f64, is_trusted: bool) -> Option<Found> {
        let share = seen.force[0] / weight;
        let is_load = seen.probability > LIKELY && share.abs() > LEAST && is_possible(share);
        if !is_load {
            self.misses += 1;
            if self.run.is_empty() || self.misses > MISSES {
                let past = std::mem::take(&mut self.run).into_iter().map(|seen| seen.force[0]);
                self.before.extend(past.chain([seen.force[0]]));
                let old = self.before.len().saturating_sub(BEFORE + MEAN);
                self.before.drain(..old);
                return None;
            }
        } else {
            self.misses = 0;
        }
        if self.run.len() >= LONGEST {
            return None;
        }
        self.run.push(seen);
        let hold = if is_trusted { HOLD } else { HOLD_CAREFUL };
        if !is_load || self.run.len() < hold || self.before.len() < MEAN {
            return None;
        }
        let mean = |seen: &[Seen]| seen.iter().map(|seen| seen.force[0]).sum::<f64>() / seen.len() as f64;
        let (rest, last) = self.run.split_at(self.run.len() - MEAN);
        let [now, earlier] = [mean(last), mean(&rest[rest.len() - MEAN..])];
        let long_ago = self.before.len().min(MEAN);
        let before = self.before.iter().take(long_ago).sum::<f64>() / long_ago as f64;
        let variance = seen.force[1];
        let is_steady = (now - earlier).abs() < STEADY * now.abs() + 2.0 * variance.sqrt();
        // Half of the first second is the filter's.
        let soon = mean(&self.run[MEAN..2 * MEAN]);
        let is_sudden = (now - before) * now > SUDDEN * now * now && (now - soon).abs() < SOON * now.abs();
        let probability = last.iter().map(|seen| seen.probability).sum::<f64>() / MEAN as f64;
        (is_steady && is_sudden && probability > LIKELY).then_some(Found {
            windows: self.run.len(),
            force: now - before,
            probability,
        })
    }

    /// Windows since the first one with a load; 0 without one.
    pub(super) fn windows(&self) -> usize {
        self.run.len()
    }

    /// A load was taken into account.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Window in which a load is found, with its force, of forces from window to window; a force of more than 0.3 N is explained by a load.
    fn found(is_trusted: bool, windows: usize, force: impl Fn(usize) -> f64) -> Option<(usize, Found)> {
        let mut watch = LoadWatch::default();
        (0..windows).find_map(|window| {
            let force = force(window);
            let seen = Seen {
                force: [force, 1e-4],
                probability: if force.abs() > 0.3 { 0.98 } else { 0.02 },
            };
            Some((window, watch.take(seen, 10.0, is_trusted)?))
        })
    }

    #[test]
    fn val_a_sudden_force_that_stays_is_a_load() {
        let step = |window: usize| if window < 100 { 0.05 } else { -1.0 };
        let (window, load) = found(true, 300, step).expect("a load");
        assert_eq!((window + 1 - 100, load.windows), (HOLD, HOLD));
        assert!((load.force + 1.05).abs() < 1e-9 && load.probability > 0.9, "{load:?}");
        let (window, _) = found(false, 300, step).expect("a load");
        assert_eq!(window + 1 - 100, HOLD_CAREFUL);
        // A window or two that say otherwise are noise.
        let noisy = |window: usize| if window.is_multiple_of(10) { 0.0 } else { step(window) };
        assert!(found(true, 300, noisy).is_some());
    }

    #[test]
    fn val_gusts_and_slow_errors_are_none() {
        // Gone after two seconds.
        assert_eq!(
            found(true, 300, |window| if (100..132).contains(&window) { 1.0 } else { 0.0 }),
            None
        );
        // Grows over ten seconds.
        assert_eq!(found(true, 300, |window| 0.006 * window as f64), None);
        // More than there is to be dropped: 8 N of 10.
        assert_eq!(found(true, 300, |window| if window < 100 { 0.0 } else { -8.0 }), None);
        // Present from the beginning: the calibration missed it, and its time is unknown.
        assert_eq!(found(true, 300, |_| 1.0), None);
    }
}
