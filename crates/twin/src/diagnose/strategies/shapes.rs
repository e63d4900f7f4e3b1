//! Shapes of effects that have no column while their effect has no size: where a wall stands, how long a rope is. Their range is searched
//! on a grid; each point has a column of its own. A wall is moved further from the next point of the grid.

use rotortwin_plant::effects::{Shapes, Strategy};

use super::start::Trial;
use super::variants::{Variant, values_at, weighed};
use crate::estimation::normal::Posterior;
use crate::estimation::problem::Problem;

/// Gaps between the flight and a wall or ceiling that are tried, m; the last is used only for the detectable size.
const GAPS_M: [f64; 4] = [0.05, 0.3, 0.8, 2.5];

/// Steps over the range of a shape.
const RANGE_STEPS: i32 = 5;

/// Length of the secant of a shape, plausible sizes.
pub(crate) const SECANT: f64 = 0.1;

/// How far the flights went along a direction, m.
fn farthest(problem: &Problem, along: impl Fn(&[f64; 3]) -> f64) -> f64 {
    let positions = problem
        .logs
        .iter()
        .flat_map(|log| log.predictor.series().smooth.position.iter());
    positions.map(along).fold(0.0, f64::max)
}

/// How far they went towards a wall at an azimuth, m.
pub(crate) fn reach(problem: &Problem, azimuth: f64) -> f64 {
    let (sin, cos) = libm::sincos(azimuth);
    farthest(problem, |p| cos * p[0] + sin * p[1])
}

/// Shapes of a candidate that are tried. With `all` false only those needed for the detectable size.
pub(crate) fn shapes(problem: &Problem, candidate: usize, covered: Shapes, all: bool) -> Vec<Vec<f64>> {
    let entry = &problem.library.candidates[candidate];
    let base = entry.neutral();
    let place = |name: &str| entry.declaration.parameter_index(name);
    let gaps = if all { &GAPS_M[..] } else { &GAPS_M[3..] };
    let mut found = Vec::new();
    match covered {
        Shapes::Above { height } => {
            let Some(height) = place(height) else { return found };
            let top = farthest(problem, |p| -p[2]);
            for gap in gaps {
                let mut values = base.clone();
                values[height] = entry.clamped(height, top + gap);
                found.push(values);
            }
        }
        Shapes::Beside { distance, azimuth } => {
            let (Some(distance), Some(azimuth)) = (place(distance), place(azimuth)) else {
                return found;
            };
            let directions = if all { 8 } else { 4 };
            for i in 0..directions {
                let angle = -3.0 + std::f64::consts::TAU * f64::from(i) / f64::from(directions);
                let reach = reach(problem, angle);
                for gap in gaps {
                    let mut values = base.clone();
                    values[azimuth] = angle;
                    values[distance] = entry.clamped(distance, reach + gap);
                    found.push(values);
                }
            }
        }
        Shapes::Range(names) => {
            if !all {
                return found;
            }
            for i in names.iter().filter_map(|name| place(name)) {
                let p = &entry.parameters[i];
                let ratio = p.plausible_high / p.plausible_low;
                for step in 0..RANGE_STEPS {
                    let mut values = base.clone();
                    let share = (f64::from(step) + 0.5) / f64::from(RANGE_STEPS);
                    values[i] = p.plausible_low * libm::pow(ratio, share);
                    found.push(values);
                }
            }
        }
    }
    found
}

/// First and last turn and first factor of the gap of a compass search, and its most steps.
const TURN_RAD: f64 = 0.2;

const LEAST_TURN_RAD: f64 = 0.01;

const WIDENED: f64 = 2.0;

const MOST_COMPASS_STEPS: usize = 24;

/// Moves the start of a wall to its place by a compass search over gap and azimuth, the strength following linearly:
/// strength and gap lie along a curved valley that a Gauss–Newton fit from the next point of a coarse grid does not
/// follow.
pub(crate) fn sharpen(problem: &Problem, posterior: &Posterior, start: &mut Trial) {
    let [one] = start.open.as_slice() else { return };
    let (candidate, entry) = (one.candidate, &problem.library.candidates[one.candidate]);
    let place = |name: &str| entry.declaration.parameter_index(name);
    let Strategy::Shapes(Shapes::Beside { distance, azimuth }) = entry.declaration.search.strategy else {
        return;
    };
    let (Some(distance), Some(azimuth)) = (place(distance), place(azimuth)) else {
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
