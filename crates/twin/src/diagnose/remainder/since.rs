//! A single change in time: a step of the mean of a residual, or of its size.
//!
//! Two levels before and after a time t. Both and t come from the shown blocks of 5 s; the unseen ones have to confirm them: the levels explain a share
//! of the square there, and differ there by several deviations of the scatter of the blocks. If t is in an unseen block, that one is not asked,
//! because the shown ones say only that it is there. Then t is sought again on all blocks, near by.

use super::spectrum::BLOCK_S;
use super::{RemainderOnset, Residual};
use crate::predict::UNITS;

/// Length of a mean, s.
const MEAN_S: f64 = 0.5;
/// Least share of the square on unseen blocks that two levels explain.
const EXPLAINED: f64 = 0.25;
/// Least difference of the levels on unseen blocks, in deviations of the scatter of the blocks' means.
const DEVIATIONS: f64 = 4.0;
/// Least ratio of two sizes.
const GROWN: f64 = 1.5;
/// Least blocks of either half on either side, and least unseen ones in all.
const FEWEST: usize = 1;
const FEWEST_UNSEEN: f64 = 3.0;

/// One value at a time.
#[derive(Debug, Clone, Copy)]
struct Point {
    time_s: f64,
    block: usize,
    value: f64,
}

/// A step, s, and the levels on its sides.
struct Step {
    at_s: f64,
    before: f64,
    after: f64,
}

/// The step of the mean, or else that of the size.
pub(super) fn onset(residual: &Residual<'_>) -> Option<RemainderOnset> {
    let points = |values: Vec<(usize, f64)>| -> Vec<Point> {
        let of = |(start, value): (usize, f64)| {
            let time_s = start as f64 * residual.step_s;
            Point {
                time_s,
                block: (time_s / BLOCK_S) as usize,
                value,
            }
        };
        values.into_iter().map(of).collect()
    };
    let unit = UNITS[residual.channel];
    if let Some(step) = step(&points(residual.means(MEAN_S, residual.rows))) {
        return Some(RemainderOnset {
            at_s: residual.start_s + step.at_s,
            of_mean: true,
            before: step.before,
            after: step.after,
            unit,
        });
    }
    let squares: Vec<f64> = residual.rows.iter().map(|r| r * r).collect();
    let mut sizes = residual.means(MEAN_S, &squares);
    sizes
        .iter_mut()
        .for_each(|(_, square)| *square = square.max(f64::MIN_POSITIVE).ln());
    let step = step(&points(sizes))?;
    let [before, after] = [step.before, step.after].map(|level| (0.5 * level).exp());
    (before.max(after) > GROWN * before.min(after)).then_some(RemainderOnset {
        at_s: residual.start_s + step.at_s,
        of_mean: false,
        before,
        after,
        unit,
    })
}

fn mean(points: &[&Point]) -> f64 {
    points.iter().map(|p| p.value).sum::<f64>() / points.len().max(1) as f64
}

/// The time among some at which two levels explain most, with the levels.
fn best(points: &[&Point], times: impl Iterator<Item = f64>) -> Option<Step> {
    let of = |at_s: f64| {
        let (before, after): (Vec<&Point>, Vec<&Point>) = points.iter().copied().partition(|p| p.time_s < at_s);
        let (a, b) = (mean(&before), mean(&after));
        let gain = before.len() as f64 * after.len() as f64 / points.len() as f64 * (a - b) * (a - b);
        (
            gain,
            Step {
                at_s,
                before: a,
                after: b,
            },
        )
    };
    times.map(of).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, step)| step)
}

/// A step that the unseen blocks confirm.
fn step(points: &[Point]) -> Option<Step> {
    let (shown, unseen): (Vec<&Point>, Vec<&Point>) = points.iter().partition(|p| p.block % 2 == 0);
    let last = points.last()?.block;
    // Enough blocks of either half on either side.
    let least = 2 * FEWEST;
    let times = points
        .iter()
        .filter(|p| p.block >= least && p.block + least <= last + 1)
        .map(|p| p.time_s);
    let found = best(&shown, times)?;
    // Between the last shown point before it and the first one after it, t may be anywhere.
    let gap = |p: &&Point| {
        let ends = |before: bool| {
            shown
                .iter()
                .filter(move |q| (q.time_s < found.at_s) == before)
                .map(|q| q.time_s)
        };
        let (from, to) = (
            ends(true).fold(f64::NEG_INFINITY, f64::max),
            ends(false).fold(f64::INFINITY, f64::min),
        );
        p.time_s > from && p.time_s < to
    };
    let unseen: Vec<&Point> = unseen.into_iter().filter(|p| !gap(p)).collect();
    let level = |p: &&Point| {
        if p.time_s < found.at_s {
            found.before
        } else {
            found.after
        }
    };
    let all = mean(&shown);
    let square = |of: &dyn Fn(&&Point) -> f64| unseen.iter().map(|p| (p.value - of(p)).powi(2)).sum::<f64>();
    if square(&level) > (1.0 - EXPLAINED) * square(&|_| all) {
        return None;
    }
    let sides = [true, false].map(|before| {
        let own: Vec<&Point> = unseen
            .iter()
            .copied()
            .filter(|p| (p.time_s < found.at_s) == before)
            .collect();
        let mut blocks: Vec<usize> = own.iter().map(|p| p.block).collect();
        blocks.dedup();
        let means: Vec<f64> = blocks
            .iter()
            .map(|&b| mean(&own.iter().copied().filter(|p| p.block == b).collect::<Vec<_>>()))
            .collect();
        let count = means.len() as f64;
        let level = means.iter().sum::<f64>() / count.max(1.0);
        let scatter = means.iter().map(|m| (m - level) * (m - level)).sum::<f64>();
        (count, level, scatter)
    });
    let [(n, a, first), (m, b, second)] = sides;
    if n < FEWEST as f64 || m < FEWEST as f64 || n + m < FEWEST_UNSEEN {
        return None;
    }
    let variance = (first + second) / (n + m - 2.0) * (1.0 / n + 1.0 / m);
    if (a - b).abs() < DEVIATIONS * variance.sqrt() || (a - b) * (found.before - found.after) <= 0.0 {
        return None;
    }
    let everything: Vec<&Point> = points.iter().collect();
    let near = points
        .iter()
        .map(|p| p.time_s)
        .filter(|t| (t - found.at_s).abs() <= BLOCK_S);
    best(&everything, near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    fn found(of: impl Fn(f64, f64) -> f64) -> Option<RemainderOnset> {
        let mut noise = NormalStream::new(4, "since");
        let rows: Vec<f64> = (0..9000).map(|k| of(0.01 * f64::from(k), noise.sample())).collect();
        onset(&Residual {
            channel: 0,
            rows: &rows,
            mask: &vec![true; rows.len()],
            step_s: 0.01,
            start_s: 0.0,
            noise: &|_| 1.0,
        })
    }

    #[test]
    fn val_a_step_of_the_mean_has_its_time_and_its_levels() {
        let step = found(|t, n| n + if t < 33.0 { 0.0 } else { 0.8 }).unwrap();
        assert!(step.of_mean && (step.at_s - 33.0).abs() <= 0.5, "{step:?}");
        assert!(step.before.abs() < 0.1 && (step.after - 0.8).abs() < 0.1, "{step:?}");
    }

    #[test]
    fn val_a_size_that_grows_at_once_has_its_time() {
        let step = found(|t, n| n * if t < 47.0 { 1.0 } else { 3.0 }).unwrap();
        assert!(!step.of_mean && (step.at_s - 47.0).abs() <= 0.5, "{step:?}");
        assert!((step.after / step.before - 3.0).abs() < 0.4, "{step:?}");
    }

    #[test]
    fn prop_neither_noise_nor_a_wave_nor_one_block_is_a_step() {
        assert_eq!(found(|_, n| n), None);
        assert_eq!(found(|t, n| n + libm::sin(0.7 * t)), None);
        assert_eq!(
            found(|t, n| n + if (40.0..45.0).contains(&t) { 3.0 } else { 0.0 }),
            None
        );
    }
}
