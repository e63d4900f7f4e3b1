//! Details of a verdict: every remaining explanation, with its probability and sizes, and the rate of a named loss.
//!
//! Sizes of the named rotors are those of the filter that follows them; all others come from the lost wrench of this window alone
//! ([`super::sets::sizes`]), with the same allowance for a model that has failed.
//!
//! The rate is the slope of a straight line through the losses of the last windows, over the shortest of [`SPANS`] with
//! a significant slope:
//!
//! b = Σ (t − t̄)(δ − δ̄) / Σ (t − t̄)²,   var b = 12 σ²/(n T²)
//!
//! T: span, s; σ²: mean variance of the losses in it; n: number of [`CORRELATION_S`] in T, as errors of neighbouring
//! windows are nearly the same.

use std::collections::VecDeque;

/// Spans of the line, s.
const SPANS: [f64; 3] = [0.5, 2.0, 4.0];
/// Correlation time of the error of a loss, s.
const CORRELATION_S: f64 = 0.5;
/// A slope of this many standard deviations is a changing loss.
const MOVES_SIGMAS: f64 = 3.0;
/// Half the width of a 95 % interval in standard deviations.
pub(super) const SIGMAS: f64 = 1.96;

/// A quantity with its 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interval {
    /// Estimate.
    pub value: f32,
    /// Lower end.
    pub low: f32,
    /// Upper end.
    pub high: f32,
}

impl Interval {
    /// From mean and standard deviation, cut to what is possible.
    pub(super) fn of(mean: f64, deviation: f64, possible: [f64; 2]) -> Self {
        let [value, low, high] = [mean, mean - SIGMAS * deviation, mean + SIGMAS * deviation]
            .map(|x| x.clamp(possible[0], possible[1]) as f32);
        Self { value, low, high }
    }
}

/// Kind of explanation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExplanationKind {
    /// These rotors lost thrust.
    Loss,
    /// One rotor lost thrust, and its blade drags more.
    LossWithDrag,
    /// One rotor gives more thrust than the model says.
    Gain,
    /// A load was dropped or picked up.
    Load,
}

/// One of the remaining explanations.
#[derive(Clone, Debug, PartialEq)]
pub struct Explained {
    /// Its kind.
    pub kind: ExplanationKind,
    /// Bit i: rotor i, from 0; 0 of a load.
    pub rotors: u32,
    /// Of this explanation.
    pub probability: f32,
    /// Of each rotor, in the order of the bits: share of its thrust in hover that it lost; of a gain: that it gives more.
    pub shares: Vec<Interval>,
    /// Change of the drag of the blade over its lift, a share; of [`ExplanationKind::LossWithDrag`].
    pub drag: Option<Interval>,
    /// Picked up (dropped: negative), kg; of [`ExplanationKind::Load`].
    pub mass_kg: Option<Interval>,
}

/// Rate of the loss of a named rotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// It changes: otherwise the interval of the rate is that of a constant loss.
    pub moves: bool,
    /// Share per second; above 0: it grows.
    pub rate_1_s: Interval,
}

/// See the module.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Details {
    /// Likeliest first; empty while nothing is wrong, or without a verdict.
    pub explanations: Vec<Explained>,
    /// One entry per named rotor; empty until the name has persisted for half a second.
    pub motion: Vec<Motion>,
}

/// Losses of the last windows with the same name.
#[derive(Clone, Debug, Default)]
pub(super) struct Track {
    rotors: u32,
    /// Time, s, and share and standard deviation of each rotor.
    points: VecDeque<(f64, Vec<[f64; 2]>)>,
}

impl Track {
    /// Adds the losses of a window in which these rotors are named.
    pub(super) fn push(&mut self, rotors: u32, time_s: f64, losses: Vec<[f64; 2]>) {
        if self.rotors != rotors {
            self.clear();
            self.rotors = rotors;
        }
        self.points.push_back((time_s, losses));
        while self
            .points
            .front()
            .is_some_and(|(time, _)| time_s - time > SPANS[SPANS.len() - 1] + 1e-6)
        {
            self.points.pop_front();
        }
    }

    /// Nothing is named.
    pub(super) fn clear(&mut self) {
        self.points.clear();
        self.rotors = 0;
    }

    /// Rate of each named rotor's loss.
    ///
    /// * `relative`: standard deviation of the scale of a loss
    pub(super) fn motion(&self, relative: f64) -> Vec<Motion> {
        let Some((now, last)) = self.points.back() else {
            return Vec::new();
        };
        let one = |rotor: usize| {
            let mut found = None;
            for span in SPANS {
                let points: Vec<Point> = self
                    .points
                    .iter()
                    .filter(|(time, _)| now - time <= span + 1e-6)
                    .map(|(time, losses)| (time - now, losses[rotor]))
                    .collect();
                let lasts = points.first().map_or(0.0, |(time, _)| -time);
                if lasts < 0.9 * span {
                    break;
                }
                let motion = slope(&points, lasts, relative);
                found = Some(motion);
                if motion.moves {
                    break;
                }
            }
            found
        };
        (0..last.len()).map(one).collect::<Option<_>>().unwrap_or_default()
    }
}

/// Time, s; share and standard deviation.
type Point = (f64, [f64; 2]);

/// Of points over `span` s.
fn slope(points: &[Point], span: f64, relative: f64) -> Motion {
    let share = 1.0 / points.len() as f64;
    let mean = |of: &dyn Fn(&Point) -> f64| points.iter().map(of).sum::<f64>() * share;
    let (time, loss) = (mean(&|point| point.0), mean(&|point| point.1[0]));
    let along = mean(&|point| (point.0 - time) * (point.1[0] - loss));
    let square = mean(&|point| (point.0 - time).powi(2));
    let variance = mean(&|point| point.1[1].powi(2));
    let rate = along / square.max(1e-12);
    let independent = (span / CORRELATION_S).max(1.0);
    let deviation = (12.0 * variance / (independent * span * span)).sqrt();
    Motion {
        moves: rate.abs() > MOVES_SIGMAS * deviation,
        rate_1_s: Interval::of(
            rate,
            deviation.hypot(relative * rate),
            [f64::NEG_INFINITY, f64::INFINITY],
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Motion after windows of 62.5 ms with losses of this course and standard deviation.
    fn after(seconds: f64, deviation: f64, loss: impl Fn(f64) -> f64) -> Vec<Motion> {
        let mut track = Track::default();
        for k in 0..=(seconds * 16.0) as usize {
            let time = k as f64 / 16.0;
            track.push(4, time, vec![[loss(time), deviation]]);
        }
        track.motion(0.0)
    }

    #[test]
    fn val_a_ramp_has_its_rate_and_a_standing_loss_has_none() {
        for rate in [0.2, 0.02, -0.02] {
            let motion = after(5.0, 0.002, |t| 0.3 + rate * t)[0];
            assert!(
                motion.moves && (f64::from(motion.rate_1_s.value) - rate).abs() < 1e-4,
                "{rate}: {motion:?}"
            );
        }
        let still = after(5.0, 0.002, |_| 0.1)[0];
        assert!(
            !still.moves && still.rate_1_s.low < 0.0 && still.rate_1_s.high > 0.0,
            "{still:?}"
        );
        // Too slow for its errors: said as an interval that holds it.
        let slow = after(5.0, 0.01, |t| 0.1 + 0.001 * t)[0];
        assert!(!slow.moves && slow.rate_1_s.high > 0.001, "{slow:?}");
    }

    #[test]
    fn val_nothing_is_said_of_a_name_younger_than_half_a_second() {
        assert_eq!(after(0.3, 0.002, |t| t), []);
        assert_eq!(after(0.6, 0.002, |t| t).len(), 1);
        let mut track = Track::default();
        for k in 0..20 {
            track.push(1 + k / 16, f64::from(k) / 16.0, vec![[0.1, 0.001]]);
        }
        assert_eq!(track.motion(0.0), [], "another name begins anew");
    }
}
