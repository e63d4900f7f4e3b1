//! What a thrust bench, or a datasheet table at one voltage, contributes to the identification of a rotor in flight.
//!
//! ```text
//! bench_fit::Table ─▶ thrust over duty about the flight's mean duty: α, β of the curve ─▶ prior of the fit instead of the class's
//!                  ─▶ torque over thrust · power over thrust^1.5 · exponent of the voltage (where the bench has several)
//! ```
//! The curve is T = T_h (z + α (z² − z) + β (√z − z)), z = u/u_h ([`super::curve`]): linear in T_h, T_h α, T_h β, so
//! weighted least squares; the voltage sag along the throttle is corrected by (V/V̄)^s. The level is not used: the
//! flight determines it, with the entered mass.
//!
//! As a prior with its own covariance the bench is combined with the flight by inverse variance. Where they differ by
//! more than three standard deviations nothing is averaged: the flight's values stay, and the note gives both. In a
//! flight with hardly any motion, only the bench determines the shape.

use std::path::PathBuf;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::IdentifyError;
use super::class::{self, Class};
use super::fit::{ALPHA, BETA, Fitted, ShapePrior};
use super::grid::mean_deviation;
use crate::Z95;
use crate::bench_fit::thrust::fit_thrust;
use crate::bench_fit::{Mapping, Table, table::Role};

/// Fewest points of thrust.
const FEWEST: usize = 5;
/// Points reach at least so far below and above the flight's mean duty, relative.
const REACHES: [f64; 2] = [0.85, 1.15];
/// Deviations of α and β that no bench removes: another copy of the propeller, the arm below it, the ESC's own range.
const SHAPE_DEVIATION: f64 = 0.04;
/// The same of the logarithms of torque over thrust and of the power coefficient.
const RATIO_DEVIATION: f64 = 0.05;
/// Bench over flight at the mean duty, beyond which it is another rotor, or another range of pulses.
const SAME_ROTOR: std::ops::Range<f64> = 0.7..1.4;
/// Ratio of bench to flight that differs from 1 enough to be reported.
const WORTH_A_WORD: f64 = 0.1;
/// Deviations beyond which nothing is averaged.
const APART: f64 = 3.0;
/// Points that are used for ratios: at least this share of the largest thrust.
const LOADED: f64 = 0.2;
/// A voltage that runs with the duty says nothing of the voltage.
const ALONG_THE_DUTY: f64 = 0.9;
/// How much the bench's shape outweighs a flight that hardly moves.
const ALONE: f64 = 1e3;

/// Measurements of one rotor on a bench.
#[derive(Debug, Clone)]
pub struct Bench {
    /// Files.
    pub name: String,
    duty: Vec<f64>,
    thrust: Vec<f64>,
    /// Empty where unknown; as those below.
    voltage: Vec<f64>,
    torque: Vec<f64>,
    power: Vec<f64>,
    /// d ln T/d ln V and its deviation, where the bench ran at several voltages.
    exponent: Option<(f64, f64)>,
    /// What was done, in sentences.
    pub notes: Vec<String>,
}

/// What it says about one mean duty.
#[derive(Debug, Clone)]
pub(crate) struct About {
    /// α, β.
    shape: Vector2<f64>,
    covariance: Matrix2<f64>,
    /// n and its deviation.
    pub(crate) slope: f64,
    pub(crate) slope_deviation: f64,
    /// At the duty, N, and at this voltage, V.
    thrust_n: f64,
    voltage: Option<f64>,
    /// Value and deviation of the logarithm.
    pub(crate) moment_ratio: Option<(f64, f64)>,
    pub(crate) power: Option<(f64, f64)>,
    /// Value and deviation.
    pub(crate) exponent: Option<(f64, f64)>,
    /// The flight has no say in the shape: it hardly moves.
    pub(crate) alone: bool,
}

fn variance_of_slope(covariance: [[f64; 2]; 2]) -> f64 {
    covariance[0][0] + 0.25 * covariance[1][1] - covariance[0][1]
}

impl Bench {
    /// Reads tables of one rotor, each as `rotortwin fit thrust` does.
    ///
    /// # Errors
    /// A file cannot be read, has no commands or no thrust, or too few points: one sentence.
    pub fn read(files: &[PathBuf]) -> Result<Self, IdentifyError> {
        let tables = files
            .iter()
            .map(|file| Table::read(file, &Mapping::default()))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|refusal| IdentifyError(refusal.0))?;
        Self::of_tables(&tables)
    }

    /// The same of tables.
    ///
    /// # Errors
    /// As [`Bench::read`].
    pub fn of_tables(tables: &[Table]) -> Result<Self, IdentifyError> {
        let tables: Vec<Table> = tables.iter().map(Table::without_stalls).collect();
        let tables = &tables[..];
        let refused = |refusal: crate::bench_fit::FitError| IdentifyError(refusal.0);
        let name = tables
            .iter()
            .map(|table| table.name.clone())
            .collect::<Vec<_>>()
            .join(", ");
        let mut bench = Self {
            name: name.clone(),
            duty: Vec::new(),
            thrust: Vec::new(),
            voltage: Vec::new(),
            torque: Vec::new(),
            power: Vec::new(),
            exponent: None,
            notes: Vec::new(),
        };
        let all = |column: fn(&Table) -> &Vec<f64>| tables.iter().all(|table| !column(table).is_empty());
        let has_voltage = all(|table| &table.voltage);
        let has_torque = all(|table| &table.torque);
        let has_power = all(|table| &table.power);
        let has_current = all(|table| &table.current);
        for table in tables {
            bench.duty.extend(table.require(Role::Command).map_err(refused)?);
            bench.thrust.extend(table.require(Role::Thrust).map_err(refused)?);
            if has_voltage {
                bench.voltage.extend(&table.voltage);
            }
            if has_torque {
                bench.torque.extend(&table.torque);
            }
            if has_power {
                bench.power.extend(&table.power);
            } else if has_voltage && has_current {
                bench.power.extend(
                    table
                        .voltage
                        .iter()
                        .zip(&table.current)
                        .map(|(volts, amps)| volts * amps),
                );
            }
            bench
                .notes
                .extend(table.notes.iter().map(|note| format!("{}: {note}", table.name)));
        }
        let points = bench.thrust.iter().filter(|thrust| **thrust > 0.0).count();
        if points < FEWEST {
            return Err(IdentifyError(format!(
                "{name}: expected at least {FEWEST} points with thrust, got {points}"
            )));
        }
        if has_voltage && correlation(&bench.duty, &bench.voltage).abs() < ALONG_THE_DUTY {
            let fit = fit_thrust(tables).map_err(refused)?;
            let exponent = fit.models.iter().find_map(|model| model.parameter("n"));
            bench.exponent = exponent
                .filter(|n| n.low.is_finite() && n.high.is_finite())
                .map(|n| (n.value, ((n.high - n.low) / (2.0 * Z95)).max(0.03)));
        }
        Ok(bench)
    }

    /// About the mean duty of a flight; the error says why the bench is not informative there.
    pub(crate) fn about(&self, hover_duty: f64) -> Result<About, String> {
        let used: Vec<usize> = (0..self.thrust.len())
            .filter(|k| self.thrust[*k] > 0.0 && self.duty[*k] > 0.02)
            .collect();
        let low = used.iter().map(|k| self.duty[*k]).fold(f64::INFINITY, f64::min);
        let high = used.iter().map(|k| self.duty[*k]).fold(0.0, f64::max);
        if used.len() < FEWEST || low > REACHES[0] * hover_duty || high < REACHES[1] * hover_duty {
            return Err(format!(
                "its {} points of thrust have duties from {low:.2} to {high:.2}, and the mean duty in the air is {hover_duty:.2}",
                used.len()
            ));
        }
        let exponent = self
            .exponent
            .unwrap_or((class::VOLTAGE_SLOPE, class::VOLTAGE_SLOPE_DEVIATION));
        let (level, shape, mut covariance) = self.shape(&used, hover_duty, exponent.0)?;
        // What the sag of the voltage leaves open.
        let moved = self.shape(&used, hover_duty, exponent.0 + exponent.1)?.1 - shape;
        covariance += moved * moved.transpose() + Matrix2::identity() * SHAPE_DEVIATION.powi(2);
        let top = used.iter().map(|k| self.thrust[*k]).fold(0.0, f64::max);
        let loaded: Vec<usize> = used.into_iter().filter(|k| self.thrust[*k] >= LOADED * top).collect();
        let ratio_to = |column: &[f64], power: f64| -> Option<(f64, f64)> {
            if column.is_empty() {
                return None;
            }
            let pairs = loaded.iter().map(|k| (self.thrust[*k].powf(power), column[*k].abs()));
            let (xx, xy) = pairs
                .clone()
                .fold((0.0, 0.0), |(xx, xy), (x, y)| (xx + x * x, xy + x * y));
            let ratio = xy / xx;
            let scatter = mean_deviation(pairs.map(|(x, y)| y / (ratio * x))).1;
            (ratio > 0.0 && scatter.is_finite()).then(|| (ratio, scatter.hypot(RATIO_DEVIATION)))
        };
        let slope_variance = variance_of_slope([
            [covariance[(0, 0)], covariance[(0, 1)]],
            [covariance[(1, 0)], covariance[(1, 1)]],
        ]);
        Ok(About {
            shape,
            covariance,
            slope: 1.0 + shape[0] - 0.5 * shape[1],
            slope_deviation: slope_variance.sqrt(),
            thrust_n: level,
            voltage: (!self.voltage.is_empty()).then(|| mean_deviation(self.voltage.iter().copied()).0),
            moment_ratio: ratio_to(&self.torque, 1.0),
            power: ratio_to(&self.power, 1.5),
            exponent: self.exponent,
            alone: false,
        })
    }

    /// T_h at the mean voltage, α and β, and the covariance of these two.
    fn shape(
        &self,
        used: &[usize],
        hover_duty: f64,
        exponent: f64,
    ) -> Result<(f64, Vector2<f64>, Matrix2<f64>), String> {
        let mean_voltage = mean_deviation(used.iter().filter_map(|k| self.voltage.get(*k).copied())).0;
        let top = used.iter().map(|k| self.thrust[*k]).fold(0.0, f64::max);
        let rows: Vec<(Vector3<f64>, f64)> = used
            .iter()
            .map(|k| {
                let factor = self
                    .voltage
                    .get(*k)
                    .map_or(1.0, |volts| (volts / mean_voltage).powf(exponent));
                let (z, thrust) = (self.duty[*k] / hover_duty, self.thrust[*k] / factor);
                let deviation = 0.02 * thrust + 0.005 * top;
                (Vector3::new(z, z * z - z, z.sqrt() - z) / deviation, thrust / deviation)
            })
            .collect();
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (row, thrust) in &rows {
            normal += row * row.transpose();
            right += row * *thrust;
        }
        let inverse = normal
            .try_inverse()
            .ok_or_else(|| "its points do not determine a curve".to_owned())?;
        let found = inverse * right;
        let freedom = (rows.len() as f64 - 3.0).max(1.0);
        let power = rows
            .iter()
            .map(|(row, thrust)| (thrust - row.dot(&found)).powi(2))
            .sum::<f64>()
            / freedom;
        let level = found[0];
        if level.is_nan() || level <= 0.0 {
            return Err(format!("its curve has {level:.2} N at the mean duty in the air"));
        }
        let (alpha, beta) = (found[1] / level, found[2] / level);
        let jacobian = nalgebra::Matrix2x3::new(-alpha / level, 1.0 / level, 0.0, -beta / level, 0.0, 1.0 / level);
        let covariance = jacobian * (inverse * power) * jacobian.transpose();
        Ok((level, Vector2::new(alpha, beta), covariance))
    }
}

impl About {
    /// For the fit; `None` if the covariance has no inverse.
    pub(crate) fn prior(&self) -> Option<ShapePrior> {
        let information = self.covariance.try_inverse()? * if self.alone { ALONE } else { 1.0 };
        Some(ShapePrior {
            shape: [self.shape[0], self.shape[1]],
            information: [
                [information[(0, 0)], information[(0, 1)]],
                [information[(1, 0)], information[(1, 1)]],
            ],
        })
    }
}

/// The bench's values for this flight, if it is of the same rotor and does not contradict it; the notes state the
/// result.
pub(crate) fn consult(
    bench: &Bench,
    flown: &Fitted,
    (class, mass_kg): (&Class, f64),
    excited: bool,
    notes: &mut Vec<String>,
) -> Option<About> {
    let mut about = match bench.about(flown.curve.hover_duty) {
        Ok(about) => about,
        Err(reason) => {
            notes.push(format!("bench {}: {reason}: it is not used", bench.name));
            return None;
        }
    };
    let has_voltage = flown.curve.voltage_slope != 0.0;
    let exponent = about.exponent.map_or(class::VOLTAGE_SLOPE, |(n, _)| n);
    let at_the_flights = match about.voltage.filter(|_| has_voltage) {
        Some(volts) => (flown.curve.voltage / volts).powf(exponent),
        None => 1.0,
    };
    let needed = flown.curve.hover * mass_kg;
    let ratio = about.thrust_n * at_the_flights / needed;
    if (ratio - 1.0).abs() > WORTH_A_WORD {
        let same = SAME_ROTOR.contains(&ratio);
        notes.push(format!(
            "bench {}: {:.2} N at the mean duty in the air, where the flight with the entered mass has {needed:.2} N, {ratio:.2} times: another propeller, voltage, unit or range of \
             pulses{}",
            bench.name,
            about.thrust_n * at_the_flights,
            if same { "; only the shape of its curve is taken" } else { "? It is not used" }
        ));
        if !same {
            return None;
        }
        // Ratios are of the propeller, and this may be another.
        (about.moment_ratio, about.power, about.exponent) = (None, None, None);
    }
    about.alone = !excited;
    if excited {
        let block = [[ALPHA, ALPHA], [ALPHA, BETA], [BETA, ALPHA], [BETA, BETA]].map(|[i, j]| flown.covariance[(i, j)]);
        let variance = variance_of_slope([[block[0], block[1]], [block[2], block[3]]]);
        // The flight alone, without the class that is in it.
        let prior = class::SLOPE_PRIOR_VARIANCE;
        let information = 1.0 / variance - 1.0 / prior;
        if information > 0.1 / prior {
            let slope = (flown.curve.slope() / variance - class.slope / prior) / information;
            let apart = (slope - about.slope).abs() / (1.0 / information).sqrt().hypot(about.slope_deviation);
            if apart > APART {
                notes.push(format!(
                    "bench {}: n = d ln thrust/d ln duty is {:.2} ± {:.2} there and {slope:.2} ± {:.2} in the air, {apart:.0} deviations apart: not averaged, the flight's is \
                     taken",
                    bench.name,
                    about.slope,
                    Z95 * about.slope_deviation,
                    Z95 / information.sqrt()
                ));
                return None;
            }
        }
    }
    Some(about)
}

/// Two estimates of one thing by inverse variance; `None` where they lie more than three deviations apart.
pub(crate) fn together((a, a_deviation): (f64, f64), (b, b_deviation): (f64, f64)) -> Option<(f64, f64)> {
    if (a - b).abs() > APART * a_deviation.hypot(b_deviation) {
        return None;
    }
    let (x, y) = (a_deviation.powi(-2), b_deviation.powi(-2));
    Some(((a * x + b * y) / (x + y), 1.0 / (x + y).sqrt()))
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let ((mean_a, deviation_a), (mean_b, deviation_b)) =
        (mean_deviation(a.iter().copied()), mean_deviation(b.iter().copied()));
    let both = mean_deviation(a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b))).0;
    let size = deviation_a * deviation_b;
    // A voltage that does not vary runs along with everything.
    if size > 1e-12 { both / size } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// T = 6 (0.4 z + 0.6 z²), z = u/0.4, at 16 V less 1.5 V at full throttle; 1.6 as exponent.
    fn table(full_v: f64) -> Table {
        let duty: Vec<f64> = (1..=10).map(|k| 0.1 * f64::from(k)).collect();
        let voltage: Vec<f64> = duty.iter().map(|u| full_v - 1.5 * u * u).collect();
        let thrust: Vec<f64> = duty
            .iter()
            .zip(&voltage)
            .map(|(u, v)| 6.0 * (0.4 * u / 0.4 + 0.6 * (u / 0.4).powi(2)) * (v / 15.5_f64).powf(1.6))
            .collect();
        Table {
            name: "made.csv".to_owned(),
            torque: thrust.iter().map(|t| 0.015 * t).collect(),
            power: thrust.iter().map(|t| 9.0 * t.powf(1.5)).collect(),
            command: duty,
            thrust,
            voltage,
            ..Table::default()
        }
    }

    #[test]
    fn val_a_bench_tells_slope_torque_power_and_the_law_of_the_voltage() {
        let bench = Bench::of_tables(&[table(16.0), table(14.0)]).unwrap();
        let about = bench.about(0.4).unwrap();
        let (n, deviation) = about.exponent.unwrap();
        assert!((n - 1.6).abs() < 0.05 && deviation < 0.1, "{n} {deviation}");
        // d ln T/d ln u = 0.4 + 2 · 0.6 at z = 1.
        assert!((about.slope - 1.6).abs() < 0.03, "{}", about.slope);
        assert!(
            (0.03..0.1).contains(&about.slope_deviation),
            "{}",
            about.slope_deviation
        );
        let (ratio, _) = about.moment_ratio.unwrap();
        assert!((ratio - 0.015).abs() < 1e-6);
        assert!((about.power.unwrap().0 - 9.0).abs() < 1e-6);
        assert!(bench.about(0.95).unwrap_err().contains("mean duty in the air is 0.95"));
    }

    #[test]
    fn val_one_voltage_leaves_its_law_open() {
        let about = Bench::of_tables(&[table(16.0)]).unwrap().about(0.4).unwrap();
        assert!(about.exponent.is_none());
        assert!(
            (about.slope - 1.6).abs() < 2.0 * about.slope_deviation,
            "{}",
            about.slope
        );
    }

    #[test]
    fn val_what_lies_apart_is_not_averaged() {
        assert!(together((1.0, 0.1), (1.6, 0.1)).is_none());
        let (value, deviation) = together((1.0, 0.1), (1.2, 0.2)).unwrap();
        assert!((value - 1.04).abs() < 1e-9 && (deviation - 0.089_443).abs() < 1e-6);
    }
}
