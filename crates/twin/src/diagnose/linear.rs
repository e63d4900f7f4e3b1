//! Linearisation of a flight about a point: whitened residual, Jacobian columns by finite differences, normal matrices of 5 s blocks.
//!
//! A column is the change of the whitened prediction per plausible size, on smoothed kinematics; channels that an effect leaves alone
//! have none, and stages of the pass that it leaves alone are not run. Columns are f32: they are whitened and of order 1 to 10³.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use rotortwin_plant::effects::{EffectInstance, EffectSet, Hooks, ParameterKind};

use super::dense::Matrix;
use super::evidence::Normal;
use super::library::Library;
use crate::predict::{CHANNELS, PerChannel, PredictError, Prediction, Predictor, Source, Stages};

/// Length of a block, s.
pub(crate) const BLOCK_S: f64 = 5.0;
/// Deviation of a rotor's constant lift error over its hover thrust (U(±10.756 mN) on 2.534 N).
const BIAS_SHARE: f64 = 0.002_45;
/// Deviation of the charge at the start.
const CHARGE_DEVIATION: f64 = 0.25;
/// Step of the differences in plausible sizes.
const STEP: f64 = 0.02;

/// Step of the wind, m/s.
const WIND_STEP_M_S: f64 = 0.2;

/// One column: nothing where a channel is not touched.
pub(crate) type Column = Arc<[Option<Vec<f32>>; CHANNELS]>;

/// An effect at work in the fit, beyond those of the model.
#[derive(Debug, Clone)]
pub(crate) struct Active {
    pub(crate) candidate: usize,
    pub(crate) values: Vec<f64>,
    pub(crate) onset_s: Option<f64>,
}

/// One log under diagnosis.
#[derive(Debug, Clone)]
pub(crate) struct LogState {
    pub(crate) predictor: Predictor,
    pub(crate) nuisances: crate::predict::Nuisances,
}

impl LogState {
    /// Rotor biases and the charge; no charge without a voltage.
    pub(crate) fn nuisance_count(&self) -> usize {
        self.predictor.series().rotors + 1
    }

    /// Prior deviation of a nuisance in its own unit.
    pub(crate) fn nuisance_size(&self, which: usize) -> f64 {
        if which < self.predictor.series().rotors {
            BIAS_SHARE * self.predictor.nominal.hover_thrust_n
        } else {
            CHARGE_DEVIATION
        }
    }

    pub(crate) fn nuisance(&self, which: usize) -> f64 {
        if which < self.predictor.series().rotors {
            self.nuisances.rotor_bias_n[which]
        } else {
            self.nuisances.charge
        }
    }

    /// The nuisances as far as they are plausible: rotor biases within two deviations. Beyond, they stand in for an effect.
    pub(crate) fn plain_nuisances(&self) -> crate::predict::Nuisances {
        let mut plain = self.nuisances;
        for (i, bias) in plain
            .rotor_bias_n
            .iter_mut()
            .enumerate()
            .take(self.predictor.series().rotors)
        {
            let most = 2.0 * self.nuisance_size(i);
            *bias = bias.clamp(-most, most);
        }
        plain
    }

    pub(crate) fn set_nuisance(&mut self, which: usize, value: f64) {
        if which < self.predictor.series().rotors {
            self.nuisances.rotor_bias_n[which] = value;
        } else {
            self.nuisances.charge = value;
        }
    }
}

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

/// All results, or the first refusal in their order: which thread is first must not choose the sentence.
pub(crate) fn in_order<T: Send>(
    results: impl ParallelIterator<Item = Result<T, PredictError>>,
) -> Result<Vec<T>, PredictError> {
    results.collect::<Vec<_>>().into_iter().collect()
}

/// Instances of the active effects.
pub(crate) fn instances(library: &Library, active: &[Active]) -> Vec<EffectInstance> {
    active
        .iter()
        .filter_map(|a| library.candidates[a.candidate].instance(&a.values, a.onset_s))
        .collect()
}

/// Hooks of an effect alone; all if it sets in late, because then its constants are not there at the start.
fn hooks_of(predictor: &Predictor, instance: &EffectInstance) -> Result<Hooks, PredictError> {
    if instance.onset_s.is_some() {
        return Ok(Hooks::VARYING_CONSTANTS);
    }
    predictor.hooks_of(instance)
}

/// Base of a linearisation on smoothed kinematics.
pub(crate) struct Base {
    pub(crate) set: EffectSet,
    pub(crate) prediction: Prediction,
}

impl LogState {
    pub(crate) fn base(&self, library: &Library, active: &[Active]) -> Result<Base, PredictError> {
        let set = self
            .predictor
            .effect_set(&self.nuisances, &instances(library, active))?;
        let prediction = self.predictor.predict(&set, Source::Smooth, None);
        Ok(Base { set, prediction })
    }

    /// Whitened residual at a point.
    pub(crate) fn residual(&self, library: &Library, active: &[Active]) -> Result<PerChannel, PredictError> {
        let set = self
            .predictor
            .effect_set(&self.nuisances, &instances(library, active))?;
        Ok(self
            .predictor
            .whitened(&self.predictor.predict(&set, Source::Raw, None)))
    }

    fn column(&self, base: &Base, set: &EffectSet, hooks: Hooks, per: f64) -> Column {
        let stages = Stages::between(base.set.constants(), set.constants(), hooks);
        let moved = self
            .predictor
            .predict(set, Source::Smooth, Some((&base.prediction, stages)));
        Arc::new(std::array::from_fn(|channel| {
            let (a, b) = (&moved.channels[channel], &base.prediction.channels[channel]);
            if Arc::ptr_eq(a, b) || a == b {
                return None;
            }
            self.predictor
                .whitener(channel)
                .map(|whitener| whitener.difference(a, b, per))
        }))
    }

    /// Column of a nuisance, per prior deviation.
    pub(crate) fn nuisance_column(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
        which: usize,
    ) -> Result<Column, PredictError> {
        let mut moved = self.nuisances;
        let size = self.nuisance_size(which);
        let step = if which < self.predictor.series().rotors {
            0.5 * size
        } else {
            0.01 * size
        };
        if which < self.predictor.series().rotors {
            moved.rotor_bias_n[which] += step;
        } else {
            moved.charge += step;
        }
        let set = self.predictor.effect_set(&moved, &instances(library, active))?;
        Ok(self.column(base, &set, Hooks::CONSTANTS, size / step))
    }

    /// Columns of all nuisances.
    pub(crate) fn nuisance_columns(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
    ) -> Result<Vec<Column>, PredictError> {
        let column = |which| self.nuisance_column(library, active, base, which);
        in_order((0..self.nuisance_count()).into_par_iter().map(column))
    }

    /// Column of a parameter of a candidate, per plausible size, about the active effects.
    pub(crate) fn parameter_column(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
        candidate: usize,
        parameter: usize,
    ) -> Result<Column, PredictError> {
        let entry = &library.candidates[candidate];
        let declared = &entry.parameters[parameter];
        let mut moved = active.to_vec();
        let place = match moved.iter().position(|a| a.candidate == candidate) {
            Some(place) => place,
            None => {
                moved.push(Active {
                    candidate,
                    values: entry.neutral(),
                    onset_s: None,
                });
                moved.len() - 1
            }
        };
        let now = moved[place].values[parameter];
        let (low, high) = declared.accepted();
        let mut step = STEP * declared.size;
        if now + step > high || (now == 0.0 && declared.plausible_high <= 0.0) {
            step = -step;
        }
        if now + step < low {
            step = 0.5 * (low - now);
        }
        if step == 0.0 {
            return Ok(Arc::new(std::array::from_fn(|_| None)));
        }
        let mut made = self.stepped(library, &mut moved, place, parameter, (now, step));
        if made.is_err() {
            // At the border of what makes a vehicle only the other side is left.
            step = -step;
            made = self.stepped(library, &mut moved, place, parameter, (now, step));
        }
        let Some((set, hooks)) = made? else {
            return Ok(Arc::new(std::array::from_fn(|_| None)));
        };
        Ok(self.column(base, &set, hooks, declared.size / step))
    }

    /// The vehicle with one parameter of an effect at `now + step`; `None` if the effect then does nothing.
    fn stepped(
        &self,
        library: &Library,
        moved: &mut [Active],
        place: usize,
        parameter: usize,
        (now, step): (f64, f64),
    ) -> Result<Option<(EffectSet, Hooks)>, PredictError> {
        moved[place].values[parameter] = now + step;
        let entry = &library.candidates[moved[place].candidate];
        let Some(instance) = entry.instance(&moved[place].values, moved[place].onset_s) else {
            return Ok(None);
        };
        let hooks = hooks_of(&self.predictor, &instance)?;
        let set = self.predictor.effect_set(&self.nuisances, &instances(library, moved))?;
        Ok(Some((set, hooks)))
    }

    /// Column of a steady wind along an axis of NED, per 1 m/s: what a gust of that moment does.
    pub(crate) fn wind_column(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
        axis: usize,
    ) -> Result<Column, PredictError> {
        let mut wind = [0.0; 3];
        wind[axis] = WIND_STEP_M_S;
        let set = self
            .predictor
            .effect_set_in_wind(&self.nuisances, &instances(library, active), wind)?;
        Ok(self.column(base, &set, Hooks::NONE, 1.0 / WIND_STEP_M_S))
    }

    /// Column by a secant: from `base` to the point with `active`, whose last effect differs, times `per`.
    pub(crate) fn secant(
        &self,
        library: &Library,
        active: &[Active],
        base: &Base,
        per: f64,
    ) -> Result<Column, PredictError> {
        let instances = instances(library, active);
        let hooks = match instances.last() {
            Some(last) => hooks_of(&self.predictor, last)?,
            None => Hooks::NONE,
        };
        let set = self.predictor.effect_set(&self.nuisances, &instances)?;
        Ok(self.column(base, &set, hooks, per))
    }

    /// Linearises about the nuisances and active effects: every column anew.
    pub(crate) fn linearise(
        &self,
        library: &Library,
        active: &[Active],
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Linear, PredictError> {
        let done = AtomicUsize::new(0);
        let all_columns = || {
            let base = self.base(library, active)?;
            let mut columns = self.nuisance_columns(library, active, &base)?;
            columns.par_extend(library.columns.par_iter().map(|column| {
                let made = self.parameter_column(library, active, &base, column.candidate, column.parameter);
                let done = 1 + done.fetch_add(1, Ordering::Relaxed);
                if done.is_multiple_of(8) {
                    progress(done as f64 / library.columns.len() as f64);
                }
                // A step that makes no vehicle (together with the active effects) has no column: it cannot be tested here.
                made.unwrap_or_else(|_| Arc::new(std::array::from_fn(|_| None)))
            }));
            Ok::<_, PredictError>(columns)
        };
        let (columns, residual) = rayon::join(all_columns, || self.residual(library, active));
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
            .map(|channel| {
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
                            matrix: gram(&slices),
                            gradient: slices.iter().map(|c| mixed_dot(c, r)).collect(),
                            square_sum: r.iter().map(|x| x * x).sum(),
                            samples: rows.clone().filter(|&k| whitener.counts(k)).count() as f64,
                            columns: touching.clone(),
                        }
                    })
                    .collect()
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
    let size = normal.matrix.size;
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
                    normal.matrix.entries[i * size + j] += weight * product;
                    if i != j {
                        normal.matrix.entries[j * size + i] += weight * product;
                    }
                }
                normal.gradient[i] += weight * block.gradient[a];
            }
            normal.square_sum += weight * block.square_sum;
            normal.samples += block.samples;
        }
    }
}

/// An empty problem.
pub(crate) fn empty(size: usize) -> Normal {
    Normal {
        matrix: Matrix::zero(size),
        gradient: vec![0.0; size],
        square_sum: 0.0,
        samples: 0.0,
    }
}

/// Rows of the lower triangle of XᵀX of columns, f32 in chunks of 256 rows, sums in f64.
fn gram(columns: &[&[f32]]) -> Vec<f64> {
    let n = columns.len();
    let mut out = Vec::with_capacity(n * (n + 1) / 2);
    for i in 0..n {
        let (fours, rest) = columns[..=i].as_chunks::<4>();
        out.extend(fours.iter().flat_map(|&four| dot4(columns[i], four)));
        out.extend(rest.iter().map(|column| dot(columns[i], column)));
    }
    out
}

/// Scalar products of one column with four.
fn dot4(a: &[f32], b: [&[f32]; 4]) -> [f64; 4] {
    const CHUNK: usize = 256;
    let mut sums = [0.0_f64; 4];
    let mut start = 0;
    while start < a.len() {
        let end = (start + CHUNK).min(a.len());
        let x = &a[start..end];
        let y = b.map(|b| &b[start..end]);
        let mut lanes = [[0.0_f32; 8]; 4];
        let whole = x.len() / 8 * 8;
        let mut k = 0;
        while k < whole {
            let x8: &[f32; 8] = x[k..k + 8].try_into().expect("eight rows");
            for (lane, y) in lanes.iter_mut().zip(&y) {
                let y8: &[f32; 8] = y[k..k + 8].try_into().expect("eight rows");
                for i in 0..8 {
                    lane[i] += x8[i] * y8[i];
                }
            }
            k += 8;
        }
        for ((sum, lane), y) in sums.iter_mut().zip(&lanes).zip(&y) {
            let mut total: f64 = lane.iter().map(|&v| f64::from(v)).sum();
            for k in whole..x.len() {
                total += f64::from(x[k]) * f64::from(y[k]);
            }
            *sum += total;
        }
        start = end;
    }
    sums
}

/// Scalar product of two columns: f32 in chunks of 256 rows, the sum in f64.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    const CHUNK: usize = 256;
    let mut sum = 0.0;
    for (x, y) in a.chunks(CHUNK).zip(b.chunks(CHUNK)) {
        let mut lanes = [0.0_f32; 32];
        let (x32, x_rest) = x.as_chunks::<32>();
        let (y32, y_rest) = y.as_chunks::<32>();
        for (x, y) in x32.iter().zip(y32) {
            for i in 0..32 {
                lanes[i] += x[i] * y[i];
            }
        }
        sum += lanes.iter().map(|&v| f64::from(v)).sum::<f64>();
        sum += x_rest
            .iter()
            .zip(y_rest)
            .map(|(&x, &y)| f64::from(x) * f64::from(y))
            .sum::<f64>();
    }
    sum
}

/// Σ c r with the residual in f64.
pub(crate) fn mixed_dot(c: &[f32], r: &[f64]) -> f64 {
    let mut lanes = [0.0_f64; 8];
    let (c8, c_rest) = c.as_chunks::<8>();
    let (r8, r_rest) = r.as_chunks::<8>();
    for (c, r) in c8.iter().zip(r8) {
        for i in 0..8 {
            lanes[i] += f64::from(c[i]) * r[i];
        }
    }
    let rest: f64 = c_rest.iter().zip(r_rest).map(|(&c, r)| f64::from(c) * r).sum();
    lanes.iter().sum::<f64>() + rest
}

/// Product of two columns over channels with weights.
pub(crate) fn column_product(a: &Column, b: &Column, weights: &[f64; CHANNELS]) -> f64 {
    (0..CHANNELS)
        .filter_map(|channel| {
            let (x, y) = (a[channel].as_ref()?, b[channel].as_ref()?);
            Some(weights[channel] * dot(x, y))
        })
        .sum()
}

/// Product of a column with a residual over channels with weights.
pub(crate) fn residual_product(a: &Column, r: &PerChannel, weights: &[f64; CHANNELS]) -> f64 {
    (0..CHANNELS)
        .filter_map(|channel| Some(weights[channel] * mixed_dot(a[channel].as_ref()?, &r[channel])))
        .sum()
}

/// True if a parameter of the declaration has a column of its own.
pub(crate) fn is_size(library: &Library, candidate: usize, parameter: usize) -> bool {
    library.candidates[candidate].parameters[parameter].kind == ParameterKind::Size
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_gram_matrix_equals_plain_sums() {
        let columns: Vec<Vec<f32>> = (0..7)
            .map(|j| {
                (0..1001)
                    .map(|k| libm::sinf(0.37 * (j as f32 + 1.0) * k as f32))
                    .collect()
            })
            .collect();
        let slices: Vec<&[f32]> = columns.iter().map(Vec::as_slice).collect();
        let got = gram(&slices);
        for i in 0..7 {
            for j in 0..=i {
                let expected: f64 = columns[i]
                    .iter()
                    .zip(&columns[j])
                    .map(|(a, b)| f64::from(*a) * f64::from(*b))
                    .sum();
                // f32 sums over 32 terms a lane.
                assert!((got[i * (i + 1) / 2 + j] - expected).abs() < 1e-4, "{i} {j}");
            }
        }
    }
}
