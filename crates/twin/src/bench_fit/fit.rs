//! Nonlinear least squares with intervals, and the report of a fit.
//!
//! Least squares of [`crate::estimation`] with a finite-difference Jacobian on scaled parameters; covariance s² (JᵀJ)⁻¹; 95 % by the
//! normal quantile.
//! Residuals whose lag-one correlation leaves its own 95 % band are resampled in blocks instead (200 draws, fixed seed).

use crate::estimation::least_squares::{Control, LeastSquares, Minimum, Unknown, minimise};
use crate::estimation::normal::Normal;
use crate::estimation::parameters::QUANTILE_95;

/// Draws of the block bootstrap.
const DRAWS: usize = 200;

/// One fitted parameter.
#[derive(serde::Serialize, Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// Name with unit suffix.
    pub name: &'static str,
    /// Value.
    pub value: f64,
    /// 95 % interval.
    pub low: f64,
    /// 95 % interval.
    pub high: f64,
}

/// One structure fitted to the data.
#[derive(Debug, Clone)]
pub struct FittedModel {
    /// Short name.
    pub name: &'static str,
    /// Equation.
    pub equation: &'static str,
    /// Parameters.
    pub parameters: Vec<FittedParameter>,
    /// Root mean square of the residuals.
    pub rmse: f64,
    /// The same on points that the fit did not see.
    pub held_out_rmse: f64,
    /// Coefficient of determination.
    pub r2: f64,
    /// Akaike's criterion, corrected for the number of points.
    pub aicc: f64,
    /// Lag-one correlation of the residuals.
    pub correlation: f64,
    /// Where the intervals come from.
    pub intervals: &'static str,
    /// Fitted values, in the order of the data.
    pub fitted: Vec<f64>,
    /// Doubts, in sentences.
    pub notes: Vec<String>,
}

impl FittedModel {
    /// A parameter by name.
    pub fn parameter(&self, name: &str) -> Option<&FittedParameter> {
        self.parameters.iter().find(|p| p.name == name)
    }
}

/// Fitted data and curve: for tables and plots.
#[derive(Debug, Clone)]
pub struct Fit {
    /// "thrust", "battery", "lag".
    pub kind: &'static str,
    /// Files.
    pub files: Vec<String>,
    /// Abscissa of the plots.
    pub x_name: &'static str,
    /// Values of it.
    pub x: Vec<f64>,
    /// Ordinate.
    pub y_name: &'static str,
    /// Measured values.
    pub y: Vec<f64>,
    /// Structures, the best by AICc first.
    pub models: Vec<FittedModel>,
    /// What was done to the data, in sentences.
    pub notes: Vec<String>,
}

impl Fit {
    /// Orders the models by AICc.
    pub fn rank(mut self) -> Self {
        self.models.sort_by(|a, b| a.aicc.total_cmp(&b.aicc));
        self
    }
}

/// Which points a fit does not see, in ten rounds; below 30 points one by one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeldOut {
    /// Contiguous tenths: for series whose neighbours are alike.
    Blocks,
    /// Every tenth point: for a step, of which no tenth may be missing as a whole.
    Interleaved,
}

/// A structure to fit.
pub struct Structure<'a> {
    /// Short name.
    pub name: &'static str,
    /// Equation.
    pub equation: &'static str,
    /// Names with unit suffix.
    pub names: &'a [&'static str],
    /// Start values; their sizes scale the steps.
    pub start: Vec<f64>,
    /// Predicts every value from parameters.
    #[expect(clippy::type_complexity, reason = "a boxed closure is what it is")]
    pub predict: Box<dyn Fn(&[f64]) -> Vec<f64> + 'a>,
    /// Allowed ranges.
    pub bounds: Vec<[f64; 2]>,
}

/// How a fit proceeds and ends: start values may be far off, so it begins damped.
const CONTROL: Control = Control {
    steps: 200,
    dampings: 12,
    damping: 1e-3,
    least_fall: 0.0,
    least_share: 1e-12,
};

/// A structure on its data, its parameters over their start values; `weight` is 0 for points that are held out.
struct Scaled<'a> {
    structure: &'a Structure<'a>,
    y: &'a [f64],
    weight: &'a [f64],
    scale: &'a [f64],
}

impl Scaled<'_> {
    fn parameters(&self, at: &[f64]) -> Vec<f64> {
        let scaled = at.iter().zip(self.scale).zip(&self.structure.bounds);
        scaled.map(|((x, s), [low, high])| (x * s).clamp(*low, *high)).collect()
    }

    fn at(&self, parameters: &[f64]) -> Vec<f64> {
        parameters.iter().zip(self.scale).map(|(p, s)| p / s).collect()
    }

    fn unknowns(&self) -> Vec<Unknown> {
        let bounds = self.structure.bounds.iter().zip(self.scale);
        bounds
            .map(|([low, high], s)| Unknown::within(low / s, high / s))
            .collect()
    }

    fn minimise(&mut self, start: &[f64]) -> Result<Minimum, NotFinite> {
        let (unknowns, at) = (self.unknowns(), self.at(start));
        minimise(self, &unknowns, &at, &CONTROL)
    }

    fn weighted(&self, fitted: &[f64]) -> Result<f64, NotFinite> {
        let squares = fitted.iter().zip(self.y).zip(self.weight);
        let sum: f64 = squares.map(|((f, y), w)| w * (y - f) * (y - f)).sum();
        if sum.is_finite() { Ok(sum) } else { Err(NotFinite) }
    }
}

/// A structure that predicts no numbers at some parameters.
#[derive(Debug, Clone, Copy)]
struct NotFinite;

impl LeastSquares for Scaled<'_> {
    type Error = NotFinite;

    fn cost(&mut self, at: &[f64]) -> Result<f64, NotFinite> {
        self.weighted(&(self.structure.predict)(&self.parameters(at)))
    }

    fn linearise(&mut self, at: &[f64]) -> Result<Normal, NotFinite> {
        const STEP: f64 = 1e-6;
        let predict = &self.structure.predict;
        let n = at.len();
        let p = self.parameters(at);
        let base = predict(&p);
        let mut normal = Normal::zero(n);
        normal.square_sum = self.weighted(&base)?;
        let columns: Vec<Vec<f64>> = (0..n)
            .map(|k| {
                let mut moved = p.clone();
                moved[k] = p[k] + STEP * self.scale[k];
                let up = predict(&moved);
                moved[k] = p[k] - STEP * self.scale[k];
                let down = predict(&moved);
                up.iter().zip(&down).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
            })
            .collect();
        for i in 0..self.y.len() {
            let (r, weight) = (self.y[i] - base[i], self.weight[i]);
            for a in 0..n {
                normal.gradient[a] += weight * columns[a][i] * r;
                for b in 0..n {
                    *normal.matrix.at_mut(a, b) += weight * columns[a][i] * columns[b][i];
                }
            }
        }
        Ok(normal)
    }
}

fn lag_one(residuals: &[f64]) -> f64 {
    let square: f64 = residuals.iter().map(|r| r * r).sum();
    let cross: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
    if square > 0.0 { cross / square } else { 0.0 }
}

/// A small generator for the bootstrap (SplitMix64).
struct Draw(u64);

impl Draw {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }
}

/// Fits one structure; `None` if there are fewer than two points more than parameters, or the fit diverges.
pub fn fit(structure: &Structure<'_>, y: &[f64], held_out_by: HeldOut) -> Option<FittedModel> {
    let (count, n) = (y.len(), structure.start.len());
    if count < n + 2 {
        return None;
    }
    let all = vec![1.0; count];
    let scale: Vec<f64> = structure
        .start
        .iter()
        .map(|s| if *s == 0.0 { 1.0 } else { s.abs() })
        .collect();
    let mut whole = Scaled {
        structure,
        y,
        weight: &all,
        scale: &scale,
    };
    let minimum = whole.minimise(&structure.start).ok()?;
    let unknowns = whole.unknowns();
    let p = whole.parameters(&minimum.at);
    let fitted = (structure.predict)(&p);
    let residuals: Vec<f64> = y.iter().zip(&fitted).map(|(y, f)| y - f).collect();
    let sum: f64 = residuals.iter().map(|r| r * r).sum();
    let variance = sum / (count - n) as f64;
    let mut notes = Vec::new();
    let covariance = minimum.covariance(&unknowns);
    let deviation: Vec<f64> = (0..n)
        .map(|k| {
            let own = covariance.as_ref().map_or(f64::INFINITY, |c| c.at(k, k));
            (variance * own).sqrt() * scale[k]
        })
        .collect();
    let told = covariance.is_some();
    if !told {
        notes.push("the data do not determine all parameters separately: intervals are unbounded".to_owned());
    }
    for k in 0..n {
        if minimum.at[k] <= unknowns[k].low || minimum.at[k] >= unknowns[k].high {
            notes.push(format!("{} ended at its bound {}", structure.names[k], p[k]));
        }
    }
    let correlation = lag_one(&residuals);
    let mut intervals: Vec<[f64; 2]> = p
        .iter()
        .zip(&deviation)
        .map(|(p, d)| [p - QUANTILE_95 * d, p + QUANTILE_95 * d])
        .collect();
    let mut origin = "Gauss–Newton covariance";
    if told && count >= 60 && correlation.abs() > QUANTILE_95 / (count as f64).sqrt() {
        intervals = bootstrap(structure, &fitted, &residuals, &p, &scale)?;
        origin = "block bootstrap, 200 draws";
    }
    let folds = if count < 30 { count } else { 10 };
    let mut held_out = 0.0;
    for fold in 0..folds {
        let block = fold * count / folds..(fold + 1) * count / folds;
        let out = |i: usize| match held_out_by {
            HeldOut::Blocks => block.contains(&i),
            HeldOut::Interleaved => i % folds == fold,
        };
        let weight: Vec<f64> = (0..count).map(|i| f64::from(u8::from(!out(i)))).collect();
        let mut without = Scaled {
            structure,
            y,
            weight: &weight,
            scale: &scale,
        };
        let minimum = without.minimise(&p).ok()?;
        let without = (structure.predict)(&without.parameters(&minimum.at));
        held_out += (0..count)
            .filter(|i| out(*i))
            .map(|i| (y[i] - without[i]) * (y[i] - without[i]))
            .sum::<f64>();
    }
    let mean = y.iter().sum::<f64>() / count as f64;
    let total: f64 = y.iter().map(|y| (y - mean) * (y - mean)).sum();
    // One more parameter than the structure's: the variance.
    let (k, m) = ((n + 1) as f64, count as f64);
    let correction = if m - k - 1.0 > 0.0 {
        2.0 * k * (k + 1.0) / (m - k - 1.0)
    } else {
        f64::INFINITY
    };
    Some(FittedModel {
        name: structure.name,
        equation: structure.equation,
        parameters: (0..n)
            .map(|k| FittedParameter {
                name: structure.names[k],
                value: p[k],
                low: intervals[k][0],
                high: intervals[k][1],
            })
            .collect(),
        rmse: (sum / m).sqrt(),
        held_out_rmse: (held_out / m).sqrt(),
        r2: 1.0 - sum / total,
        aicc: m * (sum / m).max(f64::MIN_POSITIVE).ln() + 2.0 * k + correction,
        correlation,
        intervals: origin,
        fitted,
        notes,
    })
}

/// Refits on the fit plus residuals resampled in blocks of count^(1/3), at least 5.
fn bootstrap(
    structure: &Structure<'_>,
    fitted: &[f64],
    residuals: &[f64],
    p: &[f64],
    scale: &[f64],
) -> Option<Vec<[f64; 2]>> {
    let count = residuals.len();
    let block = ((count as f64).cbrt() as usize).max(5).min(count);
    let mut draw = Draw(1);
    let all = vec![1.0; count];
    let mut values: Vec<Vec<f64>> = vec![Vec::with_capacity(DRAWS); p.len()];
    for _ in 0..DRAWS {
        let mut y = Vec::with_capacity(count);
        while y.len() < count {
            let start = draw.below(count - block + 1);
            for i in 0..block.min(count - y.len()) {
                y.push(fitted[y.len()] + residuals[start + i]);
            }
        }
        let mut resampled = Scaled {
            structure,
            y: &y,
            weight: &all,
            scale,
        };
        let minimum = resampled.minimise(p).ok()?;
        for (k, value) in resampled.parameters(&minimum.at).into_iter().enumerate() {
            values[k].push(value);
        }
    }
    let intervals = values.into_iter().map(|mut values| {
        values.sort_by(f64::total_cmp);
        [values[DRAWS * 25 / 1000], values[DRAWS * 975 / 1000 - 1]]
    });
    Some(intervals.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> (Vec<f64>, Vec<f64>) {
        let x: Vec<f64> = (0..40).map(f64::from).collect();
        // A fixed pattern of errors ±0.1 without appreciable lag-one correlation.
        let signs = [1.0, -1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0];
        let y = x
            .iter()
            .enumerate()
            .map(|(i, x)| 2.0 + 0.5 * x + 0.1 * signs[i % 8])
            .collect();
        (x, y)
    }

    /// Against the closed form of a straight line.
    #[test]
    fn val_a_line_has_the_textbook_slope_and_error() {
        let (x, y) = line();
        let structure = Structure {
            name: "line",
            equation: "y = a + b x",
            names: &["a", "b"],
            start: vec![1.0, 1.0],
            predict: Box::new(|p| x.iter().map(|x| p[0] + p[1] * x).collect()),
            bounds: vec![[-1e9, 1e9]; 2],
        };
        let model = fit(&structure, &y, HeldOut::Blocks).unwrap();
        let n = x.len() as f64;
        let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
        let sxx: f64 = x.iter().map(|x| (x - mx) * (x - mx)).sum();
        let sxy: f64 = x.iter().zip(&y).map(|(x, y)| (x - mx) * (y - my)).sum();
        let slope = sxy / sxx;
        let sse: f64 = x.iter().zip(&y).map(|(x, y)| (y - my - slope * (x - mx)).powi(2)).sum();
        let error = (sse / (n - 2.0) / sxx).sqrt();
        let b = model.parameter("b").unwrap();
        assert!((b.value - slope).abs() < 1e-9);
        assert!(((b.high - b.low) / 2.0 - QUANTILE_95 * error).abs() < 1e-7);
    }

    #[test]
    fn scenario_parameters_that_the_data_cannot_tell_are_said_so() {
        let (x, y) = line();
        let structure = Structure {
            name: "twice",
            equation: "y = a + b + c x",
            names: &["a", "b", "c"],
            start: vec![1.0, 1.0, 1.0],
            predict: Box::new(|p| x.iter().map(|x| p[0] + p[1] + p[2] * x).collect()),
            bounds: vec![[-1e9, 1e9]; 3],
        };
        let model = fit(&structure, &y, HeldOut::Blocks).unwrap();
        assert!(model.notes[0].contains("do not determine"));
        assert!(model.parameters[0].high.is_infinite());
    }
}
