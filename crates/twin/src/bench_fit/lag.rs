//! Motor lag from steps of the thrust.
//!
//! * first order: f = f₀ + (f₁ − f₀)(1 − exp(−(t − t₀)/τ))
//! * second order: two equal lags, 1 − (1 + (t − t₀)/τ₂) exp(−(t − t₀)/τ₂)
//! * first order seen through the averaging of a slow load cell: the mean of the first-order step over one sampling interval
//!
//! With a command column t₀ is the step of the command and a delay is fitted in addition to τ; without one t₀ is
//! fitted, and a delay cannot be distinguished from it. Steps up and down are fitted separately, which shows an
//! asymmetry. Limits: each step is assumed to start and end at rest.

use super::fit::{Fit, FittedModel, HeldOut, Structure, fit};
use super::table::{Role, Table};
use super::{FitError, refuse};

/// s before and after a step that are used.
const BEFORE: f64 = 0.4;
const AFTER: f64 = 0.8;
/// Least change over 0.15 s, as a share of the whole range, that counts as a step.
const LEAST_STEP: f64 = 0.3;

/// One step: its samples, time from a first guess of the start.
#[derive(Debug, Clone)]
struct Step {
    time: Vec<f64>,
    thrust: Vec<f64>,
    /// Time of the command's step on the same axis, where there is one.
    command: Option<f64>,
    at: f64,
    rises: bool,
}

/// Finds the steps of a table.
fn find_steps(table: &Table) -> Result<Vec<Step>, FitError> {
    let (time, thrust) = (table.require(Role::Time)?, table.require(Role::Thrust)?);
    let low = thrust.iter().copied().fold(f64::INFINITY, f64::min);
    let high = thrust.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = LEAST_STEP * (high - low);
    let mut steps: Vec<Step> = Vec::new();
    let mut k = 0;
    while k < time.len() {
        let ahead = time.partition_point(|t| *t <= time[k] + 0.15).min(time.len()) - 1;
        let change = thrust[ahead] - thrust[k];
        if change.abs() < least {
            k += 1;
            continue;
        }
        // The start is where the steepest rise of this window begins.
        let steepest = (k..ahead)
            .max_by(|&a, &b| {
                (thrust[a + 1] - thrust[a])
                    .abs()
                    .total_cmp(&(thrust[b + 1] - thrust[b]).abs())
            })
            .unwrap_or(k);
        let at = time[steepest];
        let (from, to) = (
            time.partition_point(|t| *t < at - BEFORE),
            time.partition_point(|t| *t <= at + AFTER),
        );
        let command = (!table.command.is_empty()).then(|| {
            (from + 1..to)
                .max_by(|&a, &b| {
                    let jump = |i: usize| (table.command[i] - table.command[i - 1]).abs();
                    jump(a).total_cmp(&jump(b))
                })
                .map_or(0.0, |i| time[i] - at)
        });
        if to - from >= 12 {
            steps.push(Step {
                time: time[from..to].iter().map(|t| t - at).collect(),
                thrust: thrust[from..to].to_vec(),
                command,
                at,
                rises: change > 0.0,
            });
        }
        k = to;
    }
    if steps.is_empty() {
        return refuse(format!(
            "{}: found no step: expected a change of {LEAST_STEP} of the whole range within 0.15 s, with 12 samples around it",
            table.name
        ));
    }
    Ok(steps)
}

fn first_order(since: f64, lag: f64) -> f64 {
    if since <= 0.0 { 0.0 } else { 1.0 - (-since / lag).exp() }
}

fn second_order(since: f64, lag: f64) -> f64 {
    if since <= 0.0 {
        0.0
    } else {
        1.0 - (1.0 + since / lag) * (-since / lag).exp()
    }
}

/// Mean of the first-order step over the interval that ends now.
fn averaged(since: f64, lag: f64, interval: f64) -> f64 {
    // ∫ (1 − e^{−t/τ}) dt from 0 to t.
    let area = |t: f64| {
        if t <= 0.0 {
            0.0
        } else {
            t - lag * (1.0 - (-t / lag).exp())
        }
    };
    (area(since) - area(since - interval)) / interval
}

/// Fits every step of the tables; one result per step, in the order of the files.
pub fn fit_lag(tables: &[Table]) -> Result<Vec<Fit>, FitError> {
    let mut fits = Vec::new();
    for table in tables {
        for step in find_steps(table)? {
            fits.push(fit_step(table, &step));
        }
    }
    Ok(fits)
}

/// The lag over several steps with fits of the first order: their mean in a model of random effects, and its 95 % interval.
///
/// ```text
///  τ_k = τ + d_k + e_k      e_k: error of the fit, s_k from its interval; d_k: steps differ, variance D (DerSimonian and Laird 1986)
///  w_k = 1/(s_k² + D)       τ = Σ w_k τ_k / Σ w_k       ± 1.96 / √Σ w_k
/// ```
/// Steps up and down of one motor differ by more than their intervals: weighted by these alone, the mean would be that of the one with the smallest
/// interval. `None` without a bounded interval.
pub fn pooled_lag(fits: &[Fit]) -> Option<[f64; 3]> {
    let lags: Vec<(f64, f64)> = fits
        .iter()
        .filter_map(|fit| {
            let p = fit
                .models
                .iter()
                .find(|model| model.name == "first order")?
                .parameter("tau_s")?;
            let half = 0.5 * (p.high - p.low);
            (half.is_finite() && half > 0.0).then_some((p.value, (half / crate::Z95).powi(2)))
        })
        .collect();
    pooled(&lags)
}

/// Mean and 95 % interval of values with variances, which differ by more than that.
fn pooled(values: &[(f64, f64)]) -> Option<[f64; 3]> {
    let mean_of = |between: f64| {
        let weight: f64 = values.iter().map(|(_, variance)| 1.0 / (variance + between)).sum();
        let sum: f64 = values
            .iter()
            .map(|(value, variance)| value / (variance + between))
            .sum();
        (sum / weight, weight)
    };
    if values.is_empty() {
        return None;
    }
    let (mean, weight) = mean_of(0.0);
    let misfit: f64 = values
        .iter()
        .map(|(value, variance)| (value - mean).powi(2) / variance)
        .sum();
    let squares: f64 = values.iter().map(|(_, variance)| variance.powi(-2)).sum();
    let free = weight - squares / weight;
    let between = if free > 0.0 {
        ((misfit - (values.len() as f64 - 1.0)) / free).max(0.0)
    } else {
        0.0
    };
    let (mean, weight) = mean_of(between);
    let half = crate::Z95 / weight.sqrt();
    Some([mean, mean - half, mean + half])
}

fn fit_step(table: &Table, step: &Step) -> Fit {
    let (t, y) = (&step.time, &step.thrust);
    let first: f64 = y[..4].iter().sum::<f64>() / 4.0;
    let last: f64 = y[y.len() - 4..].iter().sum::<f64>() / 4.0;
    let interval = (t[t.len() - 1] - t[0]) / (t.len() - 1) as f64;
    let known = step.command;
    // With a command the start parameter is the delay after it; without, the start itself.
    let names: &[&str] = if known.is_some() {
        &["f0_n", "f1_n", "delay_s", "tau_s"]
    } else {
        &["f0_n", "f1_n", "start_s", "tau_s"]
    };
    let zero = known.unwrap_or(0.0);
    let reach = 0.5 * (last - first).abs() + 1e-9;
    let bounds = vec![
        [first - reach, first + reach],
        [last - reach, last + reach],
        if known.is_some() { [0.0, 0.2] } else { [-0.15, 0.15] },
        [1e-3, 1.0],
    ];
    let start = vec![first, last, 0.01, 0.05];
    type Shape = Box<dyn Fn(f64, f64) -> f64>;
    let shapes: [(&'static str, &'static str, Shape); 3] = [
        ("first order", "f0 + (f1 - f0)(1 - exp(-t/tau))", Box::new(first_order)),
        (
            "second order",
            "f0 + (f1 - f0)(1 - (1 + t/tau) exp(-t/tau))",
            Box::new(second_order),
        ),
        (
            "first order, averaged",
            "mean of the first-order step over one sampling interval",
            Box::new(move |since, lag| averaged(since, lag, interval)),
        ),
    ];
    let models: Vec<FittedModel> = shapes
        .iter()
        .filter_map(|(name, equation, shape)| {
            let structure = Structure {
                name,
                equation,
                names,
                start: start.clone(),
                predict: Box::new(move |p| {
                    t.iter()
                        .map(|t| p[0] + (p[1] - p[0]) * shape(t - zero - p[2], p[3]))
                        .collect()
                }),
                bounds: bounds.clone(),
            };
            fit(&structure, y, HeldOut::Interleaved)
        })
        .collect();
    let mut notes = table.notes.clone();
    let direction = if step.rises { "up" } else { "down" };
    notes.push(format!(
        "step {direction} at {:.3} s; samples {:.1} ms apart",
        step.at,
        1e3 * interval
    ));
    if known.is_none() {
        notes.push("no command column: a delay cannot be separated from the start of the step".to_owned());
    }
    if interval > 0.01 {
        notes.push(format!(
            "{:.0} Hz resolve lags of 50 ms and less poorly: {:.1} samples and fewer",
            1.0 / interval,
            0.05 / interval
        ));
    }
    Fit {
        kind: "lag",
        files: vec![table.name.clone()],
        x_name: "time from the step, s",
        x: t.clone(),
        y_name: "thrust, N",
        y: y.clone(),
        models,
        notes,
    }
    .rank()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_mean_of_steps_that_differ_is_between_them() {
        // One value, and equal ones: as the errors say. Worked out by hand.
        assert_eq!(pooled(&[]), None);
        let [mean, low, high] = pooled(&[(0.04, 1e-6), (0.04, 1e-6)]).unwrap();
        assert!((mean - 0.04).abs() < 1e-12 && (high - low - 2.0 * 1.96 * 0.001 / 2f64.sqrt()).abs() < 1e-5);
        // 44 ± 7 and 38 ± 3.5 ms beside 19 ± 0.5: their inverse variances alone give 19.5. Q = 158, D = 0.01427².
        let ms = |half: f64| (half / 1.96e3_f64).powi(2);
        let [mean, low, high] = pooled(&[(0.044, ms(7.0)), (0.038, ms(3.5)), (0.019, ms(0.5))]).unwrap();
        assert!(
            (mean - 0.033437).abs() < 1e-6 && (low - 0.017088).abs() < 1e-6 && (high - 0.049786).abs() < 1e-6,
            "{mean} {low} {high}"
        );
    }

    #[test]
    fn val_a_lag_of_50_ms_and_a_delay_of_8_ms_are_found() {
        let time: Vec<f64> = (0..800).map(|k| f64::from(k) * 0.0025).collect();
        let table = Table {
            name: "step".to_owned(),
            thrust: time
                .iter()
                .enumerate()
                .map(|(k, t)| 1.0 + 4.0 * first_order(t - 1.008, 0.05) + if k % 2 == 0 { 0.01 } else { -0.01 })
                .collect(),
            command: time.iter().map(|t| if *t >= 1.0 { 0.6 } else { 0.2 }).collect(),
            time,
            ..Table::default()
        };
        let fits = fit_lag(&[table]).unwrap();
        assert_eq!(fits.len(), 1);
        let best = fits[0].models.iter().find(|model| model.name == "first order").unwrap();
        let tau = best.parameter("tau_s").unwrap();
        let delay = best.parameter("delay_s").unwrap();
        // The pattern of errors is within 0.25 % of the step.
        assert!((tau.value - 0.05).abs() < 5e-4, "{tau:?}");
        assert!((delay.value - 0.008).abs() < 5e-4, "{delay:?}");
        assert_ne!(fits[0].models[0].name, "second order");
    }

    #[test]
    fn scenario_no_step_is_said_so() {
        let table = Table {
            name: "flat".to_owned(),
            time: (0..100).map(|k| f64::from(k) * 0.1).collect(),
            thrust: (0..100).map(|k| f64::from(k) * 0.01).collect(),
            ..Table::default()
        };
        assert!(fit_lag(&[table]).unwrap_err().to_string().contains("found no step"));
    }
}
