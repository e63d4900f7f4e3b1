//! The signal of the flight that a residual, or its size, follows: a straight line over it, fitted on one half of the blocks and tested on the other.

use super::spectrum::BLOCK_S;
use super::{Follows, Residual};
use crate::compare::conditions::Condition;

/// Lengths of a mean of the residual and of its size, s.
const MEAN_S: f64 = 0.1;
const SIZE_S: f64 = 0.5;
/// Least share on unseen blocks that is told, and of the best by which an earlier signal is preferred.
const WORTH_TELLING: f64 = 0.1;
const SIZE_WORTH_TELLING: f64 = 0.2;
const NEARLY: f64 = 0.9;
/// Least number of means on either half.
const FEWEST: usize = 20;

/// A regressor by its name.
struct Signal<'a> {
    name: String,
    values: std::borrow::Cow<'a, [f64]>,
    /// The rate of change of the prediction.
    is_rate: bool,
}

/// Share of the square about the mean that lines explain on the half that they were not fitted on, and the mean slope of both.
fn unseen(points: &[(usize, f64, f64)]) -> Option<(f64, f64)> {
    let (mut before, mut after, mut slopes) = (0.0, 0.0, 0.0);
    for half in [0, 1] {
        let fit: Vec<_> = points.iter().filter(|p| p.0 % 2 == half).collect();
        let test: Vec<_> = points.iter().filter(|p| p.0 % 2 != half).collect();
        if fit.len() < FEWEST || test.len() < FEWEST {
            return None;
        }
        let n = fit.len() as f64;
        let (mx, my) = (
            fit.iter().map(|p| p.1).sum::<f64>() / n,
            fit.iter().map(|p| p.2).sum::<f64>() / n,
        );
        let xx: f64 = fit.iter().map(|p| (p.1 - mx) * (p.1 - mx)).sum();
        let xy: f64 = fit.iter().map(|p| (p.1 - mx) * (p.2 - my)).sum();
        if xx <= 1e-12 * n * (1.0 + mx * mx) {
            return None;
        }
        let slope = xy / xx;
        slopes += 0.5 * slope;
        before += test.iter().map(|p| (p.2 - my) * (p.2 - my)).sum::<f64>();
        after += test
            .iter()
            .map(|p| (p.2 - my - slope * (p.1 - mx)).powi(2))
            .sum::<f64>();
    }
    (before > 0.0).then(|| (1.0 - after / before, slopes))
}

/// The signals of a flight, the simplest first, and the time.
fn signals<'a>(residual: &Residual<'_>, conditions: &'a [Condition]) -> Vec<Signal<'a>> {
    let mut all: Vec<Signal<'a>> = conditions
        .iter()
        .map(|one| Signal {
            name: one.title.to_owned(),
            values: one.values.as_slice().into(),
            is_rate: false,
        })
        .collect();
    all.extend(
        conditions
            .iter()
            .filter(|one| one.values.iter().any(|&x| x < 0.0))
            .map(|one| Signal {
                name: format!("magnitude of the {}", one.title),
                values: one.values.iter().map(|x| x.abs()).collect(),
                is_rate: false,
            }),
    );
    all.push(Signal {
        name: "time".to_owned(),
        values: (0..residual.rows.len()).map(|k| k as f64 * residual.step_s).collect(),
        is_rate: false,
    });
    all
}

/// The best of some signals for means of `values` over a time.
fn best(
    residual: &Residual<'_>,
    all: &[Signal<'_>],
    values: &[(usize, f64)],
    mean_s: f64,
    least: f64,
) -> Option<Follows> {
    let count = residual.rows_of(mean_s);
    let block = residual.rows_of(BLOCK_S);
    let shares: Vec<Option<(f64, f64)>> = all
        .iter()
        .map(|signal| {
            let points: Vec<(usize, f64, f64)> = values
                .iter()
                .map(|&(start, y)| {
                    let x = signal.values[start..start + count].iter().sum::<f64>() / count as f64;
                    (start / block, x, y)
                })
                .filter(|(_, x, _)| x.is_finite())
                .collect();
            unseen(&points)
        })
        .collect();
    let most = shares.iter().flatten().map(|share| share.0).fold(0.0, f64::max);
    if most < least {
        return None;
    }
    let place = shares
        .iter()
        .position(|share| share.is_some_and(|(share, _)| share >= NEARLY * most))?;
    let (r_squared, slope) = shares[place]?;
    Some(Follows {
        signal: all[place].name.clone(),
        r_squared,
        // r = −τ dp/dt
        late_s: (all[place].is_rate && slope < 0.0).then_some(-slope),
    })
}

/// What the residual itself follows.
///
/// * `predicted`: what the model predicts of the channel
pub(super) fn mean(residual: &Residual<'_>, conditions: &[Condition], predicted: &[f64]) -> Option<Follows> {
    let mut all = signals(residual, conditions);
    let reach = (residual.rows_of(MEAN_S) / 4).max(1);
    let last = predicted.len().saturating_sub(1);
    let rate = |k: usize| {
        let (a, b) = (k.saturating_sub(reach), (k + reach).min(last));
        (predicted[b] - predicted[a]) / ((b - a).max(1) as f64 * residual.step_s)
    };
    all.push(Signal {
        name: "what the model predicts for it".to_owned(),
        values: predicted.into(),
        is_rate: false,
    });
    all.push(Signal {
        name: "rate of change of what the model predicts for it".to_owned(),
        values: (0..predicted.len()).map(rate).collect(),
        is_rate: true,
    });
    best(
        residual,
        &all,
        &residual.means(MEAN_S, residual.rows),
        MEAN_S,
        WORTH_TELLING,
    )
}

/// What the size of the residual follows.
pub(super) fn size(residual: &Residual<'_>, conditions: &[Condition]) -> Option<Follows> {
    let squares: Vec<f64> = residual.rows.iter().map(|r| r * r).collect();
    let mut sizes = residual.means(SIZE_S, &squares);
    sizes
        .iter_mut()
        .for_each(|(_, square)| *square = square.max(f64::MIN_POSITIVE).ln());
    best(
        residual,
        &signals(residual, conditions),
        &sizes,
        SIZE_S,
        SIZE_WORTH_TELLING,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_plant::random::NormalStream;

    const STEP_S: f64 = 0.01;

    fn told(of: impl Fn(f64, f64) -> f64) -> (Option<Follows>, Option<Follows>) {
        let mut noise = NormalStream::new(8, "follow");
        let rows: Vec<f64> = (0..9000).map(|k| of(STEP_S * f64::from(k), noise.sample())).collect();
        let wave = |period_s: f64| -> Vec<f64> {
            (0..9000)
                .map(|k| 3.0 * libm::sin(std::f64::consts::TAU * STEP_S * f64::from(k) / period_s))
                .collect()
        };
        let condition = |title, period_s| Condition {
            name: title,
            title,
            unit: "m/s",
            values: wave(period_s),
        };
        let conditions = [condition("forward speed", 7.0), condition("climb rate", 3.1)];
        let residual = Residual {
            channel: 0,
            rows: &rows,
            mask: &vec![true; 9000],
            step_s: STEP_S,
            start_s: 0.0,
            noise: &|_| 1.0,
        };
        (mean(&residual, &conditions, &wave(1.7)), size(&residual, &conditions))
    }

    fn sine(t: f64, period_s: f64) -> f64 {
        libm::sin(std::f64::consts::TAU * t / period_s)
    }

    #[test]
    fn val_a_residual_follows_its_signal_and_noise_none() {
        let (follows, _) = told(|t, n| n + sine(t, 7.0));
        assert_eq!(follows.unwrap().signal, "forward speed");
        assert_eq!(told(|_, n| n), (None, None));
    }

    #[test]
    fn val_a_late_column_follows_the_rate_of_its_prediction() {
        let rate = |t: f64| 3.0 * std::f64::consts::TAU / 1.7 * libm::cos(std::f64::consts::TAU * t / 1.7);
        let follows = told(|t, n| 0.1 * n - 0.02 * rate(t)).0.unwrap();
        let late = follows.late_s.unwrap();
        assert!((late - 0.02).abs() < 0.001, "{follows:?}");
    }

    #[test]
    fn val_a_size_that_grows_with_a_signal_follows_it() {
        let (follows, size) = told(|t, n| n * (1.0 + 4.0 * sine(t, 7.0).abs()));
        assert_eq!(follows, None);
        assert_eq!(size.unwrap().signal, "magnitude of the forward speed");
    }
}
