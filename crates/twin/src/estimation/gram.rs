//! Products of columns, of order 1 to 10³ and kept as f32: in chunks of f32, sums in f64.
//!
//! Sums run in a fixed order, so that the same columns have the same products on any number of cores.

use super::columns::Column;
use crate::predict::channels::{KA, M};
use crate::predict::{CHANNELS, PerChannel};

/// Rows of the lower triangle of XᵀX of columns, f32 in chunks of 256 rows, sums in f64.
pub(crate) fn gram(columns: &[&[f32]]) -> Vec<f64> {
    let n = columns.len();
    let mut out = Vec::with_capacity(n * (n + 1) / 2);
    for i in 0..n {
        let (fours, rest) = columns[..=i].as_chunks::<4>();
        out.extend(fours.iter().flat_map(|&four| dot4(columns[i], four)));
        out.extend(rest.iter().map(|column| dot(columns[i], column)));
    }
    out
}

/// The same with products in f64: the innovations of rates with little disturbance remember a torque for a second, and
/// columns that differ by little are then so large that sums in f32 are no longer positive.
pub(crate) fn gram_wide(columns: &[&[f32]]) -> Vec<f64> {
    let rows = |i: usize| columns[..=i].iter().map(move |column| dot_wide(columns[i], column));
    (0..columns.len()).flat_map(rows).collect()
}

/// Scalar product of two columns in f64.
fn dot_wide(a: &[f32], b: &[f32]) -> f64 {
    let mut lanes = [0.0_f64; 8];
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    for (a, b) in a8.iter().zip(b8) {
        for i in 0..8 {
            lanes[i] += f64::from(a[i]) * f64::from(b[i]);
        }
    }
    let rest: f64 = a_rest
        .iter()
        .zip(b_rest)
        .map(|(&a, &b)| f64::from(a) * f64::from(b))
        .sum();
    lanes.iter().sum::<f64>() + rest
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
            let product = if (M..KA).contains(&channel) {
                dot_wide(x, y)
            } else {
                dot(x, y)
            };
            Some(weights[channel] * product)
        })
        .sum()
}

/// Product of a column with a residual over channels with weights.
pub(crate) fn residual_product(a: &Column, r: &PerChannel, weights: &[f64; CHANNELS]) -> f64 {
    (0..CHANNELS)
        .filter_map(|channel| Some(weights[channel] * mixed_dot(a[channel].as_ref()?, &r[channel])))
        .sum()
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
