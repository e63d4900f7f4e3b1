//! Onset time of an effect: its columns count only from a time on. Block boundaries first, then a quarter and a twentieth of a second.
//!
//! An effect from t₀ on has the column of the effect with the rows before t₀ at 0, up to the memory of the chain (one
//! lag, 0.05 s) and, where whitening remembers, with the correction of [`super::cut`]. For an effect that grows with the
//! time since its onset, it is (t − t₀)/t of it: the column minus t₀ times the column over t.

use std::sync::Arc;

use rotortwin_plant::effects::{EffectDeclaration, Place, TrimChange};

use super::cut::{Cuts, Memories};
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

/// Cells of the search, s: a pulse of a filter that forgets is as short as its memory, and beside it there is nothing to find.
const GRID_S: f64 = 0.05;

/// Cells of the coarser grid on which the time is first sought between two blocks.
const COARSE: usize = 5;

/// Rows at which an effect may begin: the grid, and the blocks. Of several logs there are none.
pub(crate) fn cuts(problem: &Problem) -> Option<Cuts> {
    let [log] = problem.logs.as_slice() else { return None };
    let series = log.predictor.series();
    let cells = (0..series.len).step_by(grid_rows(problem));
    let blocks = (0..log.block_count()).map(|b| log.block_range(b).start);
    Some(Cuts::new(problem, cells.chain(blocks).collect()))
}

/// Rows of a step of the grid.
fn grid_rows(problem: &Problem) -> usize {
    let step_s = problem.logs[0].predictor.series().step_s;
    (GRID_S / step_s).round().max(1.0) as usize
}

/// Candidates that explain more from a block boundary on than over the whole flight, with their evidence there, best first.
pub(crate) fn late_candidates(problem: &Problem, posterior: &Posterior, cuts: &Cuts) -> Vec<(usize, f64)> {
    let log = &problem.logs[0];
    let blocks = log.block_count();
    let own = log.nuisance_count();
    let size = problem.size();
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
        let place = cuts.place(log.block_range(b).start);
        for (candidate, best) in best.iter_mut().enumerate() {
            let entry = &problem.library.candidates[candidate];
            let columns = problem.library.columns_of(candidate);
            if entry.is_log_fault() || columns.is_empty() || problem.active.iter().any(|a| a.candidate == candidate) {
                continue;
            }
            let mut rows = Vec::with_capacity(columns.len());
            let mut both = Matrix::zero(columns.len());
            for (a, &j) in columns.iter().enumerate() {
                let i = problem.nuisances() + j;
                for (b, &other) in columns.iter().enumerate() {
                    *both.at_mut(a, b) = tail.matrix.at(i, problem.nuisances() + other)
                        + cuts.of_both(place, cuts.of(own + j), cuts.of(own + other));
                }
                let mut row = tail.matrix.row(i).to_vec();
                row.push(tail.gradient[i]);
                cuts.correct(problem, place, cuts.of(own + j), &mut row);
                rows.push(row);
            }
            if let Some(evidence) = late_evidence(&rows, both, posterior, size) {
                *best = best.max(evidence - price);
            }
        }
    }
    let mut order: Vec<(usize, f64)> = best.into_iter().enumerate().filter(|(_, e)| e.is_finite()).collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    order
}

/// ln Bayes factor of columns that are cut off, with slabs of 1.
///
/// * `rows`: their products with all columns and the residual
/// * `both`: those with one another
fn late_evidence(rows: &[Vec<f64>], both: Matrix, posterior: &Posterior, size: usize) -> Option<f64> {
    let k = rows.len();
    let mut h = both;
    let mut g = vec![0.0; k];
    for (a, row) in rows.iter().enumerate() {
        let (row, residual) = (&row[..size], row[size]);
        let spread = posterior.covariance.times(row);
        g[a] = residual - dot(row, &posterior.mean);
        for (b, other) in rows.iter().enumerate() {
            *h.at_mut(a, b) -= dot(&other[..size], &spread);
        }
    }
    for a in 0..k {
        let diagonal = h.at_mut(a, a);
        *diagonal = diagonal.max(0.0);
    }
    weigh(&h, &g, &vec![1.0; k]).map(|weighed| weighed.log_evidence)
}

/// A column of a candidate from each cell of the grid to the end.
struct Tails {
    /// By cell: products with all columns and the residual, as if whitening forgot nothing.
    rows: Vec<Vec<f64>>,
    memories: Memories,
}

impl Tails {
    fn of(problem: &Problem, cuts: &Cuts, column: &Column, cells: usize) -> Self {
        let grid = grid_rows(problem);
        let size = problem.size();
        let columns = &problem.linear[0].columns;
        let mut rows = vec![vec![0.0; size + 1]; cells + 1];
        for cell in (0..cells).rev() {
            let own = cell_row(problem, column, columns, cell * grid..(cell + 1) * grid);
            for i in 0..=size {
                rows[cell][i] = rows[cell + 1][i] + own[i];
            }
        }
        Self {
            rows,
            memories: cuts.memories(problem, column),
        }
    }

    /// The products of the column that begins with a cell.
    fn row(&self, problem: &Problem, cuts: &Cuts, cell: usize) -> Vec<f64> {
        let mut row = self.rows[cell].clone();
        let place = cuts.place(cell * grid_rows(problem));
        cuts.correct(problem, place, &self.memories, &mut row);
        row
    }
}

/// A candidate that grows with the time since its onset: its column over the time, and Σ of the squares of that from each cell on.
struct Growth {
    slope: Tails,
    squares: Vec<f64>,
}

impl Growth {
    fn of(problem: &Problem, cuts: &Cuts, column: &Column, cells: usize) -> Self {
        let grid = grid_rows(problem);
        let slope = over_time(problem, column);
        let mut squares = vec![0.0; cells + 1];
        for cell in (0..cells).rev() {
            squares[cell] = squares[cell + 1] + square_of(problem, &slope, cell * grid..(cell + 1) * grid);
        }
        Self {
            slope: Tails::of(problem, cuts, &slope, cells),
            squares,
        }
    }
}

/// The columns of a candidate, cut at every cell.
struct Scan<'a> {
    problem: &'a Problem,
    cuts: &'a Cuts,
    /// Their places among all unknowns.
    places: Vec<usize>,
    tails: Vec<Tails>,
    growth: Option<Growth>,
    total: Normal,
    prior: Vec<f64>,
}

impl<'a> Scan<'a> {
    fn new(problem: &'a Problem, cuts: &'a Cuts, candidate: usize, cells: usize) -> Self {
        let (offset, own) = (problem.nuisances(), problem.logs[0].nuisance_count());
        let of = problem.library.columns_of(candidate);
        let places: Vec<usize> = of.iter().map(|j| offset + j).collect();
        let columns: Vec<&Column> = of.iter().map(|j| &problem.linear[0].columns[own + j]).collect();
        let growth = match (
            columns.as_slice(),
            problem.library.candidates[candidate].declaration.search.grows,
        ) {
            ([only], true) => Some(Growth::of(problem, cuts, only, cells)),
            _ => None,
        };
        let mut prior = problem.deviations(&problem.active);
        for &i in &places {
            prior[i] = 1.0;
        }
        Self {
            tails: columns.iter().map(|one| Tails::of(problem, cuts, one, cells)).collect(),
            total: problem.normal(|_| true),
            problem,
            cuts,
            places,
            growth,
            prior,
        }
    }

    /// ln Bayes factor of the candidate from a cell on, in addition to all that is in the posterior.
    fn in_addition(&self, cell: usize, posterior: &Posterior) -> Option<f64> {
        let (problem, cuts) = (self.problem, self.cuts);
        let place = cuts.place(cell * grid_rows(problem));
        let rows: Vec<Vec<f64>> = self.tails.iter().map(|one| one.row(problem, cuts, cell)).collect();
        let mut both = Matrix::zero(rows.len());
        for (a, one) in self.tails.iter().enumerate() {
            for (b, &j) in self.places.iter().enumerate() {
                *both.at_mut(a, b) = one.rows[cell][j] + cuts.of_both(place, &one.memories, &self.tails[b].memories);
            }
        }
        late_evidence(&rows, both, posterior, problem.size())
    }

    /// ln evidence with the candidate from a cell on.
    fn evidence(&self, cell: usize) -> Option<f64> {
        let (problem, cuts) = (self.problem, self.cuts);
        let size = problem.size();
        let place = cuts.place(cell * grid_rows(problem));
        let mut normal = Normal {
            matrix: self.total.matrix.clone(),
            gradient: self.total.gradient.clone(),
            square_sum: 0.0,
            samples: 0.0,
        };
        for (a, &i) in self.places.iter().enumerate() {
            let mut row = self.tails[a].row(problem, cuts, cell);
            if let Some(growth) = &self.growth {
                let since = (cell * grid_rows(problem)) as f64 * problem.logs[0].predictor.series().step_s;
                let slopes = growth.slope.row(problem, cuts, cell);
                for (own, slope) in row.iter_mut().zip(&slopes) {
                    *own -= since * slope;
                }
            }
            for j in 0..size {
                *normal.matrix.at_mut(i, j) = row[j];
                *normal.matrix.at_mut(j, i) = row[j];
            }
            normal.gradient[i] = row[size];
        }
        // Both are cut.
        for (a, &i) in self.places.iter().enumerate() {
            for (b, &j) in self.places.iter().enumerate() {
                let both = cuts.of_both(place, &self.tails[a].memories, &self.tails[b].memories);
                *normal.matrix.at_mut(i, j) = self.tails[a].rows[cell][j] + both;
            }
        }
        if let (Some(growth), [i], [own]) = (&self.growth, self.places.as_slice(), self.tails.as_slice()) {
            let since = (cell * grid_rows(problem)) as f64 * problem.logs[0].predictor.series().step_s;
            let slope = &growth.slope;
            let mixed = slope.rows[cell][*i] + cuts.of_both(place, &slope.memories, &own.memories);
            let square = growth.squares[cell] + cuts.of_both(place, &slope.memories, &slope.memories);
            *normal.matrix.at_mut(*i, *i) += since * (since * square - 2.0 * mixed);
        }
        Posterior::log_evidence_of(&normal, &self.prior)
    }
}

/// Best onset of a candidate and its gain of ln evidence over an effect from the start; `None` if the start is best.
///
/// A filter that forgets sees a pulse at the onset, and nothing of it from a boundary of a block: beside the best of these, the cell is tried from
/// which on the candidate explains most in addition to `posterior`.
pub(crate) fn scan(problem: &Problem, posterior: &Posterior, candidate: usize, cuts: &Cuts) -> Option<(f64, f64)> {
    let series = problem.logs[0].predictor.series();
    let grid = grid_rows(problem);
    let cells = series.len / grid;
    let scan = Scan::new(problem, cuts, candidate, cells);
    let first = scan.evidence(0)?;
    let per_block = ((BLOCK_S / (grid as f64 * series.step_s)).round() as usize).max(1);
    let coarse: Vec<(usize, f64)> = (per_block..cells.saturating_sub(per_block / 2))
        .step_by(per_block)
        .filter_map(|cell| Some((cell, scan.evidence(cell)?)))
        .collect();
    let &(near, _) = coarse.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let pulse = (1..cells)
        .filter_map(|cell| Some((cell, scan.in_addition(cell, posterior)?)))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let about = |cell: usize, reach: usize| cell.saturating_sub(reach).max(1)..(cell + reach).min(cells);
    let best_of = |all: &mut dyn Iterator<Item = usize>| {
        all.filter_map(|cell| Some((cell, scan.evidence(cell)?)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
    };
    let (between, _) = best_of(&mut about(near, per_block).step_by(COARSE))?;
    let pulse = pulse.map_or(0..0, |(cell, _)| about(cell, COARSE));
    let (cell, best) = best_of(&mut about(between, COARSE).chain(pulse))?;
    // The time was chosen among all cells.
    let gain = best - first - (cells as f64).ln();
    (gain > 0.0).then(|| (series.time(cell * grid), gain))
}

/// A column over the time since the first row, 1/s; nothing in that row.
fn over_time(problem: &Problem, column: &Column) -> Column {
    let predictor = &problem.logs[0].predictor;
    let step_s = predictor.series().step_s;
    let over = |channel: usize, rows: &Vec<f32>| -> Vec<f32> {
        let remembering = predictor.whitener(channel).filter(|one| one.remembers());
        let mut wide: Vec<f64> = rows.iter().map(|&x| f64::from(x)).collect();
        if let Some(whitener) = remembering {
            whitener.undo(&mut wide);
        }
        for (k, x) in wide.iter_mut().enumerate() {
            *x = if k == 0 { 0.0 } else { *x / (k as f64 * step_s) };
        }
        if let Some(whitener) = remembering {
            whitener.apply(&mut wide);
        }
        wide.into_iter().map(|x| x as f32).collect()
    };
    Arc::new(std::array::from_fn(|channel| {
        column[channel].as_ref().map(|rows| over(channel, rows))
    }))
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
