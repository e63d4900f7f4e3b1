//! Prediction errors of a channel: the part of a measured series that its own past and a model input do not predict.
//!
//! ```text
//! lift:  e = y − x − d,                 d⁺ = d + L2 e                                      (slow drift d: sag, wind, trim)
//! rate:  e = ω − ω̂,   ω̂⁺ = ω̂ + Δt (u + d) + L1 e,   d⁺ = d + (L2/Δt) e                  (d: unknown slow torque)
//! ```
//! Both are linear in (y, x) or (ω, u), so a sum of inputs can be filtered term by term. L1, L2 minimise the error:
//! with white errors that is maximum likelihood, which keeps noise that the controller feeds back from being mistaken
//! for torque.

/// Gains of a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gains {
    pub(crate) first: f64,
    pub(crate) second: f64,
}

/// e of the lift channel; with `measured` absent, what the input alone contributes (to be subtracted).
pub(crate) fn lift_errors(values: &[f64], gains: Gains, out: &mut Vec<f64>) {
    out.clear();
    let start = values.len().min(64);
    let mut drift = values[..start].iter().sum::<f64>() / start.max(1) as f64;
    out.extend(values.iter().map(|value| {
        let error = value - drift;
        drift += gains.second * error;
        error
    }));
}

/// e of a measured rate; the input enters with [`rate_input_errors`].
pub(crate) fn rate_errors(rate: &[f64], step_s: f64, gains: Gains, out: &mut Vec<f64>) {
    out.clear();
    let (mut state, mut torque) = (rate[0], 0.0);
    out.extend(rate.iter().map(|rate| {
        let error = rate - state;
        state += step_s * torque + gains.first * error;
        torque += gains.second / step_s * error;
        error
    }));
}

/// What an input contributes to e, to be added: the response of the same filter with nothing measured.
pub(crate) fn rate_input_errors(input: &[f64], step_s: f64, gains: Gains, out: &mut Vec<f64>) {
    out.clear();
    let (mut state, mut torque) = (0.0, 0.0);
    out.extend(input.iter().map(|input| {
        let error = -state;
        state += step_s * (input + torque) + gains.first * error;
        torque += gains.second / step_s * error;
        error
    }));
}

/// Gains that are tried for a rate.
pub(crate) fn rate_grid() -> impl Iterator<Item = Gains> {
    [0.01, 0.02, 0.04, 0.07, 0.12, 0.2, 0.3, 0.45, 0.65, 0.85, 1.0]
        .into_iter()
        .flat_map(|first: f64| {
            [0.003, 0.01, 0.03, 0.1, 0.25, 0.5].into_iter().map(move |share| Gains {
                first,
                second: share * first * first,
            })
        })
}

/// Gains that are tried for the lift.
pub(crate) fn lift_grid(step_s: f64) -> impl Iterator<Item = Gains> {
    // From a drift over a minute to one over a third of a second: coloured noise would ask for more, and leave only the fastest motion to
    // be explained. The accelerometer is not fed back, so that white errors matter less here than with the rates.
    let slowest = step_s / 60.0;
    let fastest = (3.0 * step_s).min(0.3);
    (0..10).map(move |i| Gains {
        first: 0.0,
        second: slowest * (fastest / slowest).powf(f64::from(i) / 9.0),
    })
}

/// Correlation of neighbouring samples.
pub(crate) fn neighbour_correlation(errors: &[f64]) -> f64 {
    let power: f64 = errors.iter().map(|e| e * e).sum();
    let product: f64 = errors.windows(2).map(|pair| pair[0] * pair[1]).sum();
    if power > 0.0 { product / power } else { 0.0 }
}
