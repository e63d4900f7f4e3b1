//! Where a wall stands: the start of its fit, moved from the next point of a coarse grid.

use super::evidence::Posterior;
use super::fit::Problem;
use super::trials::{SECANT, Trial, Variant, reach, values_at, weighed};

/// First and last turn and first factor of the gap of a compass search, and its most steps.
const TURN_RAD: f64 = 0.2;
const LEAST_TURN_RAD: f64 = 0.01;
const WIDENED: f64 = 2.0;
const MOST_COMPASS_STEPS: usize = 24;

/// Moves the start of a wall to where it stands by a compass search over gap and azimuth, the strength following linearly: strength
/// and gap belong to each other along a bent valley that a Gauss–Newton fit from the next point of a coarse grid does not follow.
pub(super) fn sharpen(problem: &Problem, posterior: &Posterior, start: &mut Trial) {
    let [one] = start.open.as_slice() else { return };
    let (candidate, entry) = (one.candidate, &problem.library.candidates[one.candidate]);
    let place = |name: &str| entry.declaration.parameter_index(name);
    let ("wall-effect", Some(distance), Some(azimuth)) =
        (entry.declaration.id, place("distance_m"), place("azimuth_rad"))
    else {
        return;
    };
    let (mut angle, mut gap) = (
        one.values[azimuth],
        (one.values[distance] - reach(problem, one.values[azimuth])).max(0.01),
    );
    let (mut turn, mut factor) = (TURN_RAD, WIDENED);
    for _ in 0..MOST_COMPASS_STEPS {
        let around = [
            (angle + turn, gap),
            (angle - turn, gap),
            (angle, gap * factor),
            (angle, gap / factor),
        ];
        let variants: Vec<Variant> = around
            .iter()
            .map(|&(angle, gap)| {
                let mut values = entry.neutral();
                values[azimuth] = angle;
                values[distance] = entry.clamped(distance, reach(problem, angle) + gap);
                Variant {
                    candidate,
                    values,
                    step: SECANT,
                    companion: None,
                }
            })
            .collect();
        let found = weighed(problem, posterior, &variants).into_iter();
        let best = (0..around.len())
            .zip(found)
            .filter_map(|(i, found)| Some((i, found?)))
            .max_by(|a, b| a.1.log_bayes_factor.total_cmp(&b.1.log_bayes_factor))
            .filter(|(_, found)| found.log_bayes_factor > start.log_bayes_factor);
        if let Some((i, found)) = best {
            (angle, gap) = around[i];
            start.log_bayes_factor = found.log_bayes_factor;
            start.open[0].values = values_at(problem, candidate, &variants[i].values, &found.estimate);
        } else {
            turn *= 0.5;
            factor = factor.sqrt();
            if turn < LEAST_TURN_RAD {
                return;
            }
        }
    }
}
