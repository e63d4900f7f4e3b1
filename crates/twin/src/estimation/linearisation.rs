//! Linearisation of a flight about a point: whitened residual, columns of all nuisances and of the library, normal matrices of 5 s
//! blocks.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::candidates::Library;
use super::columns::{Active, Column, LogState, instances};
use super::gram::{gram, gram_wide, mixed_dot};
use super::normal::Normal;
use crate::predict::channels::{KA, M};
use crate::predict::{CHANNELS, PerChannel, PredictError};

/// Length of a block, s.
pub(crate) const BLOCK_S: f64 = 5.0;

/// The flight linearised about a point.
#[derive(Debug, Clone)]
pub(crate) struct Linear {
    /// Whitened residual.
    pub(crate) residual: PerChannel,
    /// Nuisances first, then the library.
    pub(crate) columns: Vec<Column>,
    /// By channel, then block.
    pub(crate) blocks: Vec<Vec<ChannelNormal>>,
}

/// Normal matrix of one channel in one block, over the columns that touch the channel.
#[derive(Debug, Clone)]
pub(crate) struct ChannelNormal {
    pub(crate) columns: Vec<usize>,
    /// Rows of the lower triangle, one after the other.
    pub(crate) matrix: Vec<f64>,
    pub(crate) gradient: Vec<f64>,
    pub(crate) square_sum: f64,
    pub(crate) samples: f64,
}

impl LogState {
    /// Linearises about the nuisances and active effects: every column anew.
    pub(crate) fn linearise(
        &self,
        library: &Library,
        active: &[Active],
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Linear, PredictError> {
        let done = AtomicUsize::new(0);
        let effects = instances(library, active);
        let all_columns = || {
            let base = self.base(&effects)?;
            let mut columns = self.nuisance_columns(&effects, &base)?;
            columns.par_extend(library.columns.par_iter().map(|column| {
                let made = self.parameter_column(library, active, &base, column.candidate, column.parameter);
                let done = 1 + done.fetch_add(1, Ordering::Relaxed);
                if done.is_multiple_of(8) {
                    progress(done as f64 / library.columns.len() as f64);
                }
                // A step that yields an invalid configuration (together with the active effects) has no column: it cannot be tested here.
                made.unwrap_or_else(|_| Arc::new(std::array::from_fn(|_| None)))
            }));
            Ok::<_, PredictError>(columns)
        };
        let (columns, residual) = rayon::join(all_columns, || self.residual(&effects));
        let (columns, residual) = (columns?, residual?);
        let blocks = self.blocks(&columns, &residual);
        Ok(Linear {
            residual,
            columns,
            blocks,
        })
    }

    /// Rows of block `b`.
    pub(crate) fn block_range(&self, b: usize) -> std::ops::Range<usize> {
        let series = self.predictor.series();
        let rows = (BLOCK_S / series.step_s).round() as usize;
        let first = b * rows;
        let count = self.block_count();
        let last = if b + 1 == count { series.len } else { first + rows };
        first..last.min(series.len)
    }

    /// Number of blocks; a rest shorter than half a block belongs to the last.
    pub(crate) fn block_count(&self) -> usize {
        let series = self.predictor.series();
        let rows = BLOCK_S / series.step_s;
        ((series.len as f64 / rows).round() as usize).max(1)
    }

    pub(crate) fn blocks(&self, columns: &[Column], residual: &PerChannel) -> Vec<Vec<ChannelNormal>> {
        (0..CHANNELS)
            .into_par_iter()
            .map(|channel| self.channel_blocks(channel, columns, residual))
            .collect()
    }

    /// The same of one channel.
    pub(crate) fn channel_blocks(
        &self,
        channel: usize,
        columns: &[Column],
        residual: &PerChannel,
    ) -> Vec<ChannelNormal> {
        let Some(whitener) = self.predictor.whitener(channel) else {
            return Vec::new();
        };
        let touching: Vec<usize> = (0..columns.len()).filter(|&j| columns[j][channel].is_some()).collect();
        (0..self.block_count())
            .into_par_iter()
            .map(|b| {
                let rows = self.block_range(b);
                let slices: Vec<&[f32]> = touching
                    .iter()
                    .filter_map(|&j| columns[j][channel].as_ref())
                    .map(|column| &column[rows.clone()])
                    .collect();
                let r = &residual[channel][rows.clone()];
                ChannelNormal {
                    matrix: if (M..KA).contains(&channel) {
                        gram_wide(&slices)
                    } else {
                        gram(&slices)
                    },
                    gradient: slices.iter().map(|c| mixed_dot(c, r)).collect(),
                    square_sum: r.iter().map(|x| x * x).sum(),
                    samples: rows.clone().filter(|&k| whitener.counts(k)).count() as f64,
                    columns: touching.clone(),
                }
            })
            .collect()
    }
}

/// Σ of blocks with a weight per channel. `global` maps local columns to the problem's; `size` is that of the problem.
pub(crate) fn accumulate(
    normal: &mut Normal,
    linear: &Linear,
    weights: &[f64; CHANNELS],
    global: impl Fn(usize) -> usize,
    take: impl Fn(usize) -> bool,
) {
    for (channel, blocks) in linear.blocks.iter().enumerate() {
        let weight = weights[channel];
        for (b, block) in blocks.iter().enumerate() {
            if !take(b) {
                continue;
            }
            let places: Vec<usize> = block.columns.iter().map(|&j| global(j)).collect();
            let mut triangle = block.matrix.as_slice();
            for (a, &i) in places.iter().enumerate() {
                let row;
                (row, triangle) = triangle.split_at(a + 1);
                for (&j, product) in places.iter().zip(row) {
                    *normal.matrix.at_mut(i, j) += weight * product;
                    if i != j {
                        *normal.matrix.at_mut(j, i) += weight * product;
                    }
                }
                normal.gradient[i] += weight * block.gradient[a];
            }
            normal.square_sum += weight * block.square_sum;
            normal.samples += block.samples;
        }
    }
}
