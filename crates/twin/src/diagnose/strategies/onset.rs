//! Onset time of an effect: its columns count only from a time on. Block boundaries first, then a quarter of a second.
//!
//! An effect from t₀ on has the column of the effect with the rows before t₀ at 0, up to the memory of the chain (one
//! lag, 0.05 s). For an effect that grows with the time since its onset, it is (t − t₀)/t of it: the column minus t₀
//! times the column over t.

use std::sync::Arc;

use rotortwin_plant::effects::{EffectDeclaration, Place, TrimChange};

use crate::diagnose::supply;
use crate::estimation::columns::Column;
use crate::estimation::dense::{Matrix, dot};
use crate::estimation::gram::mixed_dot;
use crate::estimation::linearisation::BLOCK_S;
use crate::estimation::normal::{Normal, Posterior, weigh};
use crate::estimation::problem::Problem;
use crate::predict::CHANNELS;

/// Gain of ln evidence from which an onset is accepted.
const ONSET_GAIN: f64 = 8.0;

/// The same for an effect that cannot set in: a density or a resistance is there from the start, so something else is
/// more likely to have begun. Odds of one in 10¹³.
const ONSET_GAIN_OF_LASTING: f64 = 38.0;

/// Gain of ln evidence from which an onset of a candidate is accepted. An unlogged supply sags over the flight, and an
/// effect that scales the lift of all rotors, or the weight, absorbs that from some time on: no gain proves such an
/// onset.
pub(crate) fn least_gain(problem: &Problem, candidate: usize) -> f64 {
    let declared = problem.library.candidates[candidate].declaration;
    if declared.may_set_in {
        ONSET_GAIN
    } else if scales_lift_over_weight(declared) && problem.logs.iter().all(supply::is_unknown) {
        f64::INFINITY
    } else {
        ONSET_GAIN_OF_LASTING
    }
}

/// True for what changes the ratio of lift to weight, as a sagging supply does: the law of the lift of all rotors, or
/// the weight.
fn scales_lift_over_weight(declared: &EffectDeclaration) -> bool {
    declared.places.contains(&Place::StaticLift) || declared.search.trim == Some(TrimChange::Weight)
}

/// Fine grid of the search, s.
const GRID_S: f64 = 0.25;

/// Candidates that explain more from a block boundary on than over the whole flight, with their evidence there, best first.
pub(crate) fn late_candidates(problem: &Problem, posterior: &Posterior) -> Vec<(usize, f64)> {
    if problem.logs.len() != 1 {
        return Vec::new();
    }
    let blocks = problem.logs[0].block_count();
    let mut tail = problem.normal(|_| false);
    let mut best = vec![f64::NEG_INFINITY; problem.library.candidates.len()];
    // The time is one of all cells.
    let price = (blocks as f64 * BLOCK_S / GRID_S).ln();
    for b in (1..blocks).rev() {
        let block = problem.normal(|i| i == b);
        tail.matrix.add(&block.matrix);
        for (sum, own) in tail.gradient.iter_mut().zip(&block.gradient) {
            *sum += own;
        }
        for (candidate, best) in best.iter_mut().enumerate() {
            let entry = &problem.library.candidates[candidate];
            let columns = problem.library.columns_of(candidate);
            if entry.is_log_fault() || columns.is_empty() || problem.active.iter().any(|a| a.candidate == candidate) {
                continue;
            }
            let places: Vec<usize> = columns.iter().map(|j| problem.nuisances() + j).collect();
            if let Some(evidence) = late_evidence(&tail, posterior, &places) {
                *best = best.max(evidence - price);
            }
        }
    }
    let mut order: Vec<(usize, f64)> = best.into_iter().enumerate().filter(|(_, e)| e.is_finite()).collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    order
}

/// ln Bayes factor of the columns `places`, cut off before the blocks of `tail`, with slabs of 1.
fn late_evidence(tail: &Normal, posterior: &Posterior, places: &[usize]) -> Option<f64> {
    let k = places.len();
    let mut h = Matrix::zero(k);
    let mut g = vec![0.0; k];
    for (a, &i) in places.iter().enumerate() {
        let row = tail.matrix.row(i);
        let spread = posterior.covariance.times(row);
        g[a] = tail.gradient[i] - dot(row, &posterior.mean);
        for (b, &j) in places.iter().enumerate() {
            let other = tail.matrix.row(j);
            *h.at_mut(a, b) = tail.matrix.at(i, j) - dot(other, &spread);
        }
    }
    for a in 0..k {
        let diagonal = h.at_mut(a, a);
        *diagonal = diagonal.max(0.0);
    }
    weigh(&h, &g, &vec![1.0; k]).map(|weighed| weighed.log_evidence)
}

/// Best onset of a candidate and its gain of ln evidence over an effect from the start; `None` if the start is best.
pub(crate) fn scan(problem: &Problem, candidate: usize) -> Option<(f64, f64)> {
    // Times of several logs have nothing in common.
    if problem.logs.len() != 1 {
        return None;
    }
    let log = &problem.logs[0];
    let series = log.predictor.series();
    let offset = problem.nuisances();
    let places: Vec<usize> = problem
        .library
        .columns_of(candidate)
        .iter()
        .map(|j| offset + j)
        .collect();
    let own = log.nuisance_count();
    let columns = &problem.linear[0].columns;
    let moved: Vec<&Column> = places.iter().map(|&i| &columns[i - offset + own]).collect();
    let total = problem.normal(|_| true);
    let mut prior = problem.deviations(&problem.active);
    for &i in &places {
        prior[i] = 1.0;
    }
    let grid = (GRID_S / series.step_s).round().max(1.0) as usize;
    let cells = series.len / grid;
    let size = problem.size();
    // Rows of the candidate from each cell to the end.
    let tails_of = |column: &Column| -> Vec<Vec<f64>> {
        let mut tail = vec![vec![0.0; size + 1]; cells + 1];
        for cell in (0..cells).rev() {
            let own = cell_row(problem, column, columns, cell * grid..(cell + 1) * grid);
            for i in 0..=size {
                tail[cell][i] = tail[cell + 1][i] + own[i];
            }
        }
        tail
    };
    let tails: Vec<Vec<Vec<f64>>> = moved.iter().map(|column| tails_of(column)).collect();
    // Of one that grows, the same of the column over the time, and the squares of that.
    let growth = match (
        moved.as_slice(),
        problem.library.candidates[candidate].declaration.search.grows,
    ) {
        ([only], true) => {
            let slope = over_time(only, series.step_s);
            let square = |cell: usize| square_of(problem, &slope, cell * grid..(cell + 1) * grid);
            let mut squares = vec![0.0; cells + 1];
            for cell in (0..cells).rev() {
                squares[cell] = squares[cell + 1] + square(cell);
            }
            Some((tails_of(&slope), squares))
        }
        _ => None,
    };
    // Products of two parameters of the candidate are in both rows with the same cells, so a tail is exact for them,
    // too.
    let evidence = |cell: usize| -> Option<f64> {
        let mut normal = Normal {
            matrix: total.matrix.clone(),
            gradient: total.gradient.clone(),
            square_sum: 0.0,
            samples: 0.0,
        };
        for (a, &i) in places.iter().enumerate() {
            let mut tail = tails[a][cell].clone();
            if let Some((slopes, squares)) = &growth {
                let since = (cell * grid) as f64 * series.step_s;
                let own = slopes[cell][i];
                for (tail, slope) in tail.iter_mut().zip(&slopes[cell]) {
                    *tail -= since * slope;
                }
                tail[i] += since * (since * squares[cell] - own);
            }
            for j in 0..size {
                *normal.matrix.at_mut(i, j) = tail[j];
                *normal.matrix.at_mut(j, i) = tail[j];
            }
            normal.gradient[i] = tail[size];
        }
        Posterior::log_evidence_of(&normal, &prior)
    };
    let first = evidence(0)?;
    let per_block = ((BLOCK_S / GRID_S).round() as usize).max(1);
    let coarse: Vec<(usize, f64)> = (per_block..cells.saturating_sub(per_block / 2))
        .step_by(per_block)
        .filter_map(|cell| Some((cell, evidence(cell)?)))
        .collect();
    let &(near, _) = coarse.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let range = near.saturating_sub(per_block).max(1)..(near + per_block).min(cells);
    let (cell, best) = range
        .filter_map(|cell| Some((cell, evidence(cell)?)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    // The time was chosen among all cells.
    let gain = best - first - (cells as f64).ln();
    (gain > 0.0).then(|| (series.time(cell * grid), gain))
}

/// A column over the time since the first row, 1/s; nothing in that row.
fn over_time(column: &Column, step_s: f64) -> Column {
    let over = |rows: &Vec<f32>| -> Vec<f32> {
        let each = rows.iter().enumerate();
        each.map(|(k, &x)| {
            if k == 0 {
                0.0
            } else {
                (f64::from(x) / (k as f64 * step_s)) as f32
            }
        })
        .collect()
    };
    Arc::new(std::array::from_fn(|channel| column[channel].as_ref().map(over)))
}

/// Square of a column over some rows.
fn square_of(problem: &Problem, column: &Column, rows: std::ops::Range<usize>) -> f64 {
    let of = |channel: usize| {
        let own = column[channel].as_ref()?;
        let square: f64 = own[rows.clone()].iter().map(|&x| f64::from(x) * f64::from(x)).sum();
        Some(problem.weights[0][channel] * square)
    };
    (0..CHANNELS).filter_map(of).sum()
}

/// Products of a column with every column and the residual over some rows; in the order of the problem, the residual last.
fn cell_row(problem: &Problem, column: &Column, columns: &[Column], rows: std::ops::Range<usize>) -> Vec<f64> {
    let residual = &problem.linear[0].residual;
    let weights = &problem.weights[0];
    let mut out = vec![0.0; problem.size() + 1];
    for channel in 0..CHANNELS {
        let Some(own) = &column[channel] else { continue };
        let own: Vec<f64> = own[rows.clone()]
            .iter()
            .map(|&x| weights[channel] * f64::from(x))
            .collect();
        for (i, other) in columns.iter().enumerate() {
            if let Some(other) = &other[channel] {
                out[problem.global(0, i)] += mixed_dot(&other[rows.clone()], &own);
            }
        }
        let r = &residual[channel][rows.clone()];
        out[problem.size()] += own.iter().zip(r).map(|(a, b)| a * b).sum::<f64>();
    }
    out
}
