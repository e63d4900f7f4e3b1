//! Errors on held-out blocks: of which quantities, and whether they fall or rise by more than chance.

use serde::Serialize;
use utoipa::ToSchema;

use crate::predict::Predictor;
use crate::predict::channels::{F, KA, KV, M, V};

/// Share of the noise below which a change of the error is ignored: a log without noise leaves rounding errors, which
/// any fit changes.
const NEGLIGIBLE: f64 = 0.01;

/// The errors of one quantity on one block: means over 0.1 s, in the same order before and after.
pub(crate) type BlockErrors = Vec<f64>;

/// Σ of squares.
pub(crate) fn square(errors: &[f64]) -> f64 {
    errors.iter().map(|x| x * x).sum()
}

/// Quantities that are scored, with their units. The accelerometer gives the force; without one, it comes from the
/// derivative of the velocity.
pub(crate) const QUANTITIES: [(&str, &str); 4] = [
    ("force", "N"),
    ("torque", "N·m"),
    ("voltage", "V"),
    ("acceleration", "m/s²"),
];

/// Places of the force and of the voltage among them.
pub(crate) const FORCE: usize = 0;
pub(crate) const VOLTAGE: usize = 2;

/// The quantity that a channel belongs to, and the factor that converts its residual; `None` if it is not scored.
pub(crate) fn kind_of(predictor: &Predictor, channel: usize) -> Option<(usize, f64)> {
    let c = &predictor.nominal;
    match channel {
        F..KV => Some((0, c.mass_kg)),
        KV..M if !predictor.series().available.accel => Some((3, 1.0)),
        M..KA => Some((1, c.inertia_body_kg_m2[channel - M][channel - M])),
        V => Some((VOLTAGE, 1.0)),
        _ => None,
    }
}

/// Error on blocks that the fit did not see, smoothed over 0.1 s.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct HeldOutError {
    /// `force`, `torque`, `voltage`; `acceleration` (derivative of the velocity) if there is no accelerometer.
    pub quantity: String,
    /// Unit.
    pub unit: String,
    /// Without the effects found.
    #[schema(value_type = Option<f64>)]
    pub before: f64,
    /// With the effects found.
    #[schema(value_type = Option<f64>)]
    pub after: f64,
    /// Standard deviation of `after − before`, from the scatter over the blocks.
    #[schema(value_type = Option<f64>)]
    pub change_deviation: f64,
    /// Rise of the sum of squares over its deviation by chance, if the effects found are right: [`in_chance`].
    #[serde(skip)]
    pub rise_by_chance: f64,
    /// Mean of ln(mean square before / after) over the blocks, in its own standard deviations. Blocks of a fast flight and
    /// of a hover differ by factors in their errors, so that the scatter of the differences hides what holds on each block;
    /// 0 where there are too few blocks.
    #[serde(skip)]
    pub fall_on_each: f64,
    /// What noise alone leaves.
    #[schema(value_type = Option<f64>)]
    pub noise: f64,
    /// With the effects found and every other constant of the catalogue off by what any model of a real vehicle is off (2 % of a
    /// plausible size, the prior of the diagnosis), fitted on the same blocks. Where this is noise and `after` is not, nothing
    /// is missing in the catalogue; some constants are not quite right.
    #[schema(value_type = Option<f64>)]
    pub with_small_errors: f64,
    /// Standard deviation of `with_small_errors − before`.
    #[serde(skip)]
    pub small_errors_deviation: f64,
    /// As `rise_by_chance`.
    #[serde(skip)]
    pub small_errors_rise_by_chance: f64,
}

/// Change in standard deviations of the scatter over the blocks from which an error counts as risen or fallen: one in a thousand by chance.
const RISEN: f64 = 3.0;

/// Normal quantile of 99 %: a true effect may raise an error by more in one of a hundred flights.
const RISEN_BY_CHANCE: f64 = 2.326;

/// Least share of a mean square error that makes a part of it explained.
const WORTH_NAMING: f64 = 0.1;

/// Share of the noise above which an error is more than noise: more than twice its power.
const BEYOND_NOISE: f64 = 1.5;

/// Share of the noise above which no vehicle is known so little that its error would be explained.
const FAR_BEYOND_NOISE: f64 = 4.0;

impl HeldOutError {
    /// Change that is ignored.
    pub fn negligible(&self) -> f64 {
        NEGLIGIBLE * self.noise
    }

    /// True if much more than noise is left with the effects found, whatever small errors the other constants have.
    pub fn is_beyond_noise(&self) -> bool {
        self.after.min(self.with_small_errors) > BEYOND_NOISE * self.noise
    }

    /// The same by far: also for a vehicle whose constants are known within intervals only.
    pub(crate) fn is_far_beyond_noise(&self) -> bool {
        self.after.min(self.with_small_errors) > FAR_BEYOND_NOISE * self.noise
    }

    /// True if the effects found make the error larger: by more than a trace of the noise, and either by more than chance
    /// does with effects that are right, at a level of 1 %, or by more than the scatter between blocks. The scatter alone
    /// is no excuse: an effect that sets in on the last of n blocks changes one of them, which is one deviation of their
    /// scatter however large it is.
    ///
    /// And with small errors of all other constants, too: where one error has hidden another, the right size of one
    /// shows the other.
    pub fn rises(&self) -> bool {
        self.rises_to(self.after, self.change_deviation, self.rise_by_chance)
            && self.rises_to(
                self.with_small_errors,
                self.small_errors_deviation,
                self.small_errors_rise_by_chance,
            )
    }

    fn rises_to(&self, after: f64, deviation: f64, by_chance: f64) -> bool {
        let rise = after - self.before;
        rise > self.negligible() && (by_chance > RISEN_BY_CHANCE || rise > RISEN * deviation)
    }

    /// True if more than noise is left with the effects found, or it rises with them, and small errors of all other
    /// constants explain that.
    pub(crate) fn is_excused(&self) -> bool {
        let beyond = self.after > BEYOND_NOISE * self.noise && !self.is_beyond_noise();
        let rises = self.rises_to(self.after, self.change_deviation, self.rise_by_chance);
        let risen = self.after > self.noise && rises && !self.rises();
        beyond || risen
    }

    /// The same error with small errors of all other constants, as the one named `with` has them.
    pub(crate) fn with_small_errors(self, with: &Self) -> Self {
        Self {
            with_small_errors: with.after,
            small_errors_deviation: with.change_deviation,
            small_errors_rise_by_chance: with.rise_by_chance,
            ..self
        }
    }

    /// Share of the mean square that the effects found explain; below 0 where they make it worse.
    pub fn explained_share(&self) -> f64 {
        let ratio = self.after / self.before;
        if ratio.is_finite() { 1.0 - ratio * ratio } else { 0.0 }
    }

    /// True if the effects found make the error smaller by more than some deviations of its scatter over the blocks.
    /// One is a weak sign, but its absence in all quantities is a strong one.
    pub(crate) fn improves_by(&self, deviations: f64) -> bool {
        self.before - self.after > self.negligible().max(deviations * self.change_deviation)
    }

    /// True if the effects found make the error substantially smaller.
    pub fn is_smaller(&self) -> bool {
        self.before - self.after > self.negligible() && self.explained_share() > WORTH_NAMING
    }

    /// The same by more than the blocks scatter, in their differences or in their ratios.
    pub fn falls(&self) -> bool {
        self.is_smaller() && (self.before - self.after > RISEN * self.change_deviation || self.fall_on_each > RISEN)
    }
}

/// Root mean squares before and after, and the deviation of their difference by the scatter of the blocks' own differences.
pub(crate) fn change(
    quantity: &str,
    unit: &str,
    before: &[BlockErrors],
    after: &[BlockErrors],
    noise: f64,
) -> Option<HeldOutError> {
    let count: f64 = before.iter().map(|block| block.len() as f64).sum();
    if count == 0.0 {
        return None;
    }
    let squares: Vec<(f64, f64)> = before
        .iter()
        .zip(after)
        .filter(|(before, _)| !before.is_empty())
        .map(|(before, after)| (square(before), square(after)))
        .collect();
    let total = squares.iter().fold((0.0, 0.0), |(b, a), one| (b + one.0, a + one.1));
    let (old, new) = ((total.0 / count).sqrt(), (total.1 / count).sqrt());
    let blocks = squares.len() as f64;
    let mean = (total.1 - total.0) / blocks;
    let scatter: f64 = squares.iter().map(|(b, a)| (a - b - mean) * (a - b - mean)).sum();
    // Of a mean square over the blocks; a single block has no scatter.
    let variance = if blocks > 1.0 {
        scatter * blocks / (blocks - 1.0)
    } else {
        f64::INFINITY
    };
    let ratios: Vec<f64> = squares
        .iter()
        .filter(|(b, a)| *b > 0.0 && *a > 0.0)
        .map(|(b, a)| (b / a).ln())
        .collect();
    // d√x = dx/(2√x)
    let change_deviation = variance.sqrt() / count / (old + new).max(f64::MIN_POSITIVE);
    let rise_by_chance = in_chance(before, after, noise);
    Some(HeldOutError {
        quantity: quantity.to_owned(),
        unit: unit.to_owned(),
        before: old,
        after: new,
        change_deviation,
        rise_by_chance,
        with_small_errors: new,
        small_errors_deviation: change_deviation,
        small_errors_rise_by_chance: rise_by_chance,
        fall_on_each: in_deviations(&ratios),
        noise,
    })
}

/// Rise of the sum of squares over its deviation by chance, if what is left after is noise.
///
/// Errors before r and after r′ = r + d: Σ r′² − r² = 2 Σ r′ d − Σ d². If the model after is right, r′ is noise that knows nothing of d: the sum falls by
/// Σ d², by chance more or less with a deviation of 2 √(Σ σ² d²). Counted from no change at all, because the model after is nearly right at
/// most. σ² is that of the smaller error of the block, and at least that of noise.
fn in_chance(before: &[BlockErrors], after: &[BlockErrors], noise: f64) -> f64 {
    let (mut rise, mut variance) = (0.0, 0.0);
    for (before, after) in before.iter().zip(after) {
        let (old, new) = (square(before), square(after));
        let moved: f64 = before.iter().zip(after).map(|(b, a)| (a - b) * (a - b)).sum();
        let left = old.min(new) / before.len().max(1) as f64;
        rise += new - old;
        variance += 4.0 * left.max(noise * noise) * moved;
    }
    if variance > 0.0 { rise / variance.sqrt() } else { 0.0 }
}

/// A mean over its standard deviation by the scatter of the values; 0 for fewer than six.
fn in_deviations(values: &[f64]) -> f64 {
    /// Of fewer the deviation is hardly known: three of it are more than one in a hundred by chance.
    const FEWEST: usize = 6;
    if values.len() < FEWEST {
        return 0.0;
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let scatter = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (count - 1.0);
    mean / (scatter / count).sqrt().max(f64::MIN_POSITIVE)
}
