//! The steps that all interacting multiple models share: filters of one process at several speeds, of which one is true
//! at a time, and the speed is a Markov chain (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33 (1988) 780).

/// Smallest probability of a speed.
const LEAST: f64 = 1e-9;

/// Before a step: probability of each speed, and of what it was before if it is this one now.
///
/// * `chance`: of changing from one speed to another
pub(super) fn predicted<const N: usize>(
    probability: &[f64; N],
    chance: impl Fn(usize, usize) -> f64,
) -> ([f64; N], [[f64; N]; N]) {
    let mut next = [0.0; N];
    let share = std::array::from_fn(|to| {
        let weight: [f64; N] = std::array::from_fn(|from| probability[from] * chance(from, to));
        next[to] = weight.iter().sum::<f64>().max(1e-12);
        weight.map(|weight| weight / next[to])
    });
    (next, share)
}

/// After it: probability of each speed.
///
/// * `log_likelihood`: of the measurement at each
pub(super) fn updated<const N: usize>(predicted: &[f64; N], log_likelihood: &[f64; N]) -> [f64; N] {
    let most = log_likelihood.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    let scaled: [f64; N] =
        std::array::from_fn(|speed| (predicted[speed] * (log_likelihood[speed] - most).exp()).max(LEAST));
    let sum: f64 = scaled.iter().sum();
    scaled.map(|p| p / sum)
}
