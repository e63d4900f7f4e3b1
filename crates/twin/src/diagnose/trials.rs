//! Starts of the non-linear fits where the linear ranking about zero does not reach: effects whose shape is unknown, delays of several
//! samples, and effects that act only through another one.
//!
//! * A shape (where a wall stands, how long a rope is) has no column while its effect has no size. Its range is searched on a grid;
//!   each point has a column of its own.
//! * A delay of several samples of a noisy command is not its derivative: a secant over the delay is its column.
//! * Wind does nothing without drag. Drag and wind together are bilinear, thus linear in (k, k w): the columns of the wind are taken
//!   where the drag is at its typical size.
//!
//! The evidence of such columns A on top of the library X with posterior (m, C) under spikes is that of h = AᵀA − AᵀX C XᵀA and
//! g = Aᵀ(r − X m) with slabs of 1.

use rotortwin_plant::effects::ParameterKind;

use super::dense::Matrix;
use super::evidence::{Posterior, sure_size};
use super::fit::{Problem, fitted_residual};
use super::goodness::channel_fits;
use super::linear::{Active, Base, Column, column_product, residual_product};
use super::ranking::Scored;
use crate::predict::channels::{F, KA, KV, M};

/// A start of a fit.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    /// Effects that it opens, a companion first.
    pub(crate) open: Vec<Active>,
    /// ln Bayes factor by linear algebra.
    pub(crate) log_bayes_factor: f64,
    /// Charge offset at the start, if not the present one.
    pub(crate) charge: Option<f64>,
}

/// Trials of this round, and the smallest size that shows whatever the shape is, by candidate.
#[derive(Debug, Default)]
pub(crate) struct Trials {
    pub(crate) starts: Vec<Trial>,
    pub(crate) worst_minimum: Vec<(usize, f64)>,
}

/// Gaps between the flight and a wall or ceiling that are tried, m; the last alone says what would show.
const GAPS_M: [f64; 4] = [0.05, 0.3, 0.8, 2.5];
/// Normal score of a channel from which the shapes of its effects are searched.
const SEARCHED_SCORE: f64 = 3.0;

/// Shapes of a candidate that are tried. With `all` false only those that say what would show.
fn shapes(problem: &Problem, candidate: usize, all: bool) -> Vec<Vec<f64>> {
    let entry = &problem.library.candidates[candidate];
    let base = entry.neutral();
    let place = |name: &str| entry.declaration.parameter_index(name);
    let gaps = if all { &GAPS_M[..] } else { &GAPS_M[3..] };
    let positions = problem
        .logs
        .iter()
        .flat_map(|log| log.predictor.series().smooth.position.iter());
    let farthest = |along: &dyn Fn(&[f64; 3]) -> f64| positions.clone().map(along).fold(0.0, f64::max);
    let mut found = Vec::new();
    match entry.declaration.id {
        "ceiling-effect" => {
            let Some(height) = place("height_m") else { return found };
            let top = farthest(&|p| -p[2]);
            for gap in gaps {
                let mut values = base.clone();
                values[height] = entry.clamped(height, top + gap);
                found.push(values);
            }
        }
        "wall-effect" => {
            let (Some(distance), Some(azimuth)) = (place("distance_m"), place("azimuth_rad")) else {
                return found;
            };
            let directions = if all { 8 } else { 4 };
            for i in 0..directions {
                let angle = -3.0 + std::f64::consts::TAU * f64::from(i) / f64::from(directions);
                let (sin, cos) = libm::sincos(angle);
                let reach = farthest(&|p| cos * p[0] + sin * p[1]);
                for gap in gaps {
                    let mut values = base.clone();
                    values[azimuth] = angle;
                    values[distance] = entry.clamped(distance, reach + gap);
                    found.push(values);
                }
            }
        }
        _ => {
            let shape = |name: &str| place(name).map(|i| (i, entry.parameters[i]));
            for (i, p) in ["length_m", "frequency_hz"].iter().filter_map(|name| shape(name)) {
                if !all {
                    continue;
                }
                let ratio = p.plausible_high / p.plausible_low;
                for step in 0..5 {
                    let mut values = base.clone();
                    values[i] = p.plausible_low * libm::pow(ratio, (f64::from(step) + 0.5) / 5.0);
                    found.push(values);
                }
            }
        }
    }
    found
}

/// Largest normal score of the force and torque channels with the mean of the clutter.
fn searched(problem: &Problem, posterior: &Posterior) -> bool {
    problem.logs.iter().enumerate().any(|(l, log)| {
        let fits = channel_fits(&log.predictor, &fitted_residual(problem, l, &posterior.mean));
        (F..KV)
            .chain(M..KA)
            .any(|c| fits[c].is_some_and(|fit| fit.score() > SEARCHED_SCORE))
    })
}

/// Trial columns with their evidence.
struct Evidence {
    log_bayes_factor: f64,
    estimate: Vec<f64>,
    information: f64,
}

fn evidence(problem: &Problem, posterior: &Posterior, columns: &[Vec<Column>]) -> Option<Evidence> {
    // columns[log][a]
    let k = columns[0].len();
    let size = problem.size();
    let mut h = Matrix::zero(k);
    let mut g = vec![0.0; k];
    let mut cross = vec![vec![0.0; size]; k];
    for (l, own) in columns.iter().enumerate() {
        let (linear, weights) = (&problem.linear[l], &problem.weights[l]);
        for (a, column) in own.iter().enumerate() {
            g[a] += residual_product(column, &linear.residual, weights);
            for (b, other) in own.iter().enumerate() {
                *h.at_mut(a, b) += column_product(column, other, weights);
            }
            for (i, other) in linear.columns.iter().enumerate() {
                cross[a][problem.global(l, i)] += column_product(column, other, weights);
            }
        }
    }
    for a in 0..k {
        g[a] -= cross[a].iter().zip(&posterior.mean).map(|(c, m)| c * m).sum::<f64>();
        let spread = posterior.covariance.times(&cross[a]);
        for b in 0..k {
            *h.at_mut(a, b) -= cross[b].iter().zip(&spread).map(|(c, s)| c * s).sum::<f64>();
        }
    }
    for a in 0..k {
        let diagonal = h.at_mut(a, a);
        *diagonal = diagonal.max(0.0);
    }
    let factor = h.clone().plus_diagonal(&vec![1.0; k]).cholesky()?;
    let estimate = factor.solve(&g);
    let fit: f64 = estimate.iter().zip(&g).map(|(m, g)| m * g).sum();
    Some(Evidence {
        log_bayes_factor: 0.5 * fit - 0.5 * factor.log_determinant(),
        estimate,
        information: h.at(0, 0),
    })
}

/// Columns of the sizes of a candidate by a secant of `step` sizes about `values`, beside the active effects and `with`.
fn columns(
    problem: &Problem,
    bases: &[Base],
    with: &[Active],
    candidate: usize,
    values: &[f64],
    step: f64,
) -> Option<Vec<Vec<Column>>> {
    let entry = &problem.library.candidates[candidate];
    let mut all = Vec::new();
    for (log, base) in problem.logs.iter().zip(bases) {
        let mut active = problem.active.clone();
        active.extend_from_slice(with);
        let mut own = Vec::new();
        for (i, p) in entry.parameters.iter().enumerate() {
            if p.kind != ParameterKind::Size || entry.columns[i].is_none() {
                continue;
            }
            let mut moved = values.to_vec();
            let (low, high) = p.accepted();
            let change = if step * p.size > high || step * p.size < low {
                -step * p.size
            } else {
                step * p.size
            };
            moved[i] += change;
            let mut active = active.clone();
            active.push(Active {
                candidate,
                values: moved,
                onset_s: None,
            });
            own.push(log.secant(&problem.library, &active, base, p.size / change).ok()?);
        }
        all.push(own);
    }
    Some(all)
}

fn size_places(problem: &Problem, candidate: usize) -> Vec<usize> {
    let entry = &problem.library.candidates[candidate];
    (0..entry.columns.len())
        .filter(|&i| entry.columns[i].is_some() && entry.parameters[i].kind == ParameterKind::Size)
        .collect()
}

/// Values of a candidate at the estimate (in plausible sizes) of its sizes.
fn values_at(problem: &Problem, candidate: usize, base: &[f64], estimate: &[f64]) -> Vec<f64> {
    let entry = &problem.library.candidates[candidate];
    let mut values = base.to_vec();
    for (&i, e) in size_places(problem, candidate).iter().zip(estimate) {
        let size = entry.parameters[i].size;
        values[i] = entry.clamped(i, values[i] + e * size);
    }
    values
}

fn bases(problem: &Problem, with: &[Active]) -> Option<Vec<Base>> {
    let mut active = problem.active.clone();
    active.extend_from_slice(with);
    problem
        .logs
        .iter()
        .map(|log| log.base(&problem.library, &active).ok())
        .collect()
}

/// All trials of a round.
pub(crate) fn trials(problem: &Problem, posterior: &Posterior, threshold: f64) -> Trials {
    let mut trials = Trials::default();
    let Some(present) = bases(problem, &[]) else {
        return trials;
    };
    let all = searched(problem, posterior);
    let free = |c: usize| problem.active.iter().all(|a| a.candidate != c);
    for candidate in (0..problem.library.candidates.len()).filter(|&c| free(c)) {
        let entry = &problem.library.candidates[candidate];
        let declaration = entry.declaration;
        if size_places(problem, candidate).is_empty() {
            continue;
        }
        let variants: Vec<(Vec<f64>, f64)> = if ["command-delay", "imu-latency"].contains(&declaration.id) {
            [0.5, 1.0, 1.5].iter().map(|&step| (entry.neutral(), step)).collect()
        } else {
            shapes(problem, candidate, all).into_iter().map(|v| (v, 0.1)).collect()
        };
        let mut best: Option<Trial> = None;
        let mut worst: f64 = 0.0;
        for (base, step) in &variants {
            let Some(own) = columns(problem, &present, &[], candidate, base, *step) else {
                continue;
            };
            let Some(found) = evidence(problem, posterior, &own) else {
                continue;
            };
            worst = worst.max(sure_size(found.information, 0.02, threshold));
            let values = values_at(problem, candidate, base, &found.estimate);
            if best
                .as_ref()
                .is_none_or(|b| found.log_bayes_factor > b.log_bayes_factor)
            {
                best = Some(Trial {
                    open: vec![Active {
                        candidate,
                        values,
                        onset_s: None,
                    }],
                    log_bayes_factor: found.log_bayes_factor,
                    charge: None,
                });
            }
        }
        if matches!(declaration.id, "ceiling-effect" | "wall-effect") && worst > 0.0 {
            trials.worst_minimum.push((candidate, worst));
        }
        trials.starts.extend(best);
        trials
            .starts
            .extend(composites(problem, posterior, &present, candidate));
    }
    trials
        .starts
        .sort_by(|a, b| b.log_bayes_factor.total_cmp(&a.log_bayes_factor));
    trials
}

/// An effect that does nothing alone, with each of the effects through which it can act.
fn composites(problem: &Problem, posterior: &Posterior, present: &[Base], candidate: usize) -> Vec<Trial> {
    let entry = &problem.library.candidates[candidate];
    let silent = problem.linear.iter().zip(&problem.logs).all(|(linear, log)| {
        let own = log.nuisance_count();
        let columns = problem.library.columns_of(candidate);
        columns
            .iter()
            .all(|&j| linear.columns[own + j].iter().all(Option::is_none))
    });
    if entry.declaration.needs.is_empty() || !silent {
        return Vec::new();
    }
    let mut found = Vec::new();
    for (companion, other) in problem.library.candidates.iter().enumerate() {
        if !entry.declaration.needs.contains(&other.declaration.id) {
            continue;
        }
        let places = size_places(problem, companion);
        let mut typical = other.neutral();
        for &i in &places {
            typical[i] = other.parameters[i].size;
        }
        let with = [Active {
            candidate: companion,
            values: typical,
            onset_s: None,
        }];
        let Some(beside) = bases(problem, &with) else {
            continue;
        };
        let (Some(first), Some(second)) = (
            columns(problem, present, &[], companion, &other.neutral(), 0.1),
            columns(problem, &beside, &with, candidate, &entry.neutral(), 0.1),
        ) else {
            continue;
        };
        let own: Vec<Vec<Column>> = first
            .into_iter()
            .zip(second)
            .map(|(a, b)| a.into_iter().chain(b).collect())
            .collect();
        let Some(result) = evidence(problem, posterior, &own) else {
            continue;
        };
        let (a, b) = result.estimate.split_at(places.len());
        // k = a k_typical, k w = b k_typical w_size.
        let scale = if a[0].abs() > 0.05 { 1.0 / a[0] } else { 0.0 };
        let b: Vec<f64> = b.iter().map(|b| b * scale).collect();
        found.push(Trial {
            open: vec![
                Active {
                    candidate: companion,
                    values: values_at(problem, companion, &other.neutral(), a),
                    onset_s: None,
                },
                Active {
                    candidate,
                    values: values_at(problem, candidate, &entry.neutral(), &b),
                    onset_s: None,
                },
            ],
            log_bayes_factor: result.log_bayes_factor,
            charge: None,
        });
    }
    found
}

/// The plain trial of a candidate at its linear estimate.
pub(crate) fn plain(problem: &Problem, one: &Scored) -> Trial {
    let candidate = &problem.library.candidates[one.candidate];
    let mut values = candidate.neutral();
    for (a, &j) in problem.library.columns_of(one.candidate).iter().enumerate() {
        let column = &problem.library.columns[j];
        let value = values[column.parameter] + one.opened.estimate[a] * column.size;
        values[column.parameter] = candidate.clamped(column.parameter, value);
    }
    Trial {
        open: vec![Active {
            candidate: one.candidate,
            values,
            onset_s: None,
        }],
        log_bayes_factor: one.opened.log_bayes_factor,
        charge: None,
    }
}
