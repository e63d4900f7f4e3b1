//! Lines of a flight against those of healthy flights: which rotor vibrates more than before.
//!
//! ```text
//! x_r = ln(amplitude/Ω²) of rotor r,  less its mean over the healthy flights,  less the median over the rotors (the whole vehicle)
//! nothing: x ~ t_ν(0, S),   grown by g ~ |N(0, 1)|: x ~ ∫ t_ν(g, S) p(g) dg,   S² = s² (1 + 1/K) + v
//! ```
//! with s pooled over rotors and K healthy flights, ν = (K − 1)(n − 1), and v the variance of the flight's own lines.
//! One half of the prior is for no change of any rotor.

use rotortwin_flight_core::fdi::student_t::two_sided_critical_value;

/// Level of the intervals.
const OUTSIDE: f64 = 0.05;
/// Least spread of ln amplitude: no two flights are known to shake more alike.
const LEAST_SPREAD: f64 = 0.10;
/// Standard deviation of ln growth of a rotor that has changed.
const GROWTH: f64 = 1.0;
/// Steps of the integral over the growth, and how far it goes in [`GROWTH`].
const STEPS: usize = 400;
const FAR: f64 = 5.0;
/// A rotor whose line is below this share of the strongest one may be no more than that one's blur.
const LEAST_OF_STRONGEST: f64 = 0.2;

/// ln of a rotor's line over Ω² and its variance, in one flight.
pub(super) type Level = (f64, f64);

/// What has become of a rotor's line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    /// ln of the growth.
    pub(super) growth: f64,
    /// Half of its 95 % interval.
    pub(super) half: f64,
    /// Posterior probability that it has grown.
    pub(super) posterior: f64,
}

/// Mean and variance per rotor of several flights combined; `None` for a rotor that some flight cannot distinguish.
pub(super) fn together(flights: &[Vec<Option<Level>>]) -> Vec<Option<Level>> {
    let count = flights.len() as f64;
    (0..flights[0].len())
        .map(|rotor| {
            let levels: Option<Vec<Level>> = flights.iter().map(|flight| flight[rotor]).collect();
            levels.map(|l| {
                (
                    l.iter().map(|x| x.0).sum::<f64>() / count,
                    l.iter().map(|x| x.1).sum::<f64>() / (count * count),
                )
            })
        })
        .collect()
}

/// Change of `flown` relative to `healthy`, rotor by rotor.
///
/// Rotors that some flight cannot distinguish have none.
pub(super) fn changes(flown: &[Option<Level>], healthy: &[Vec<Option<Level>>]) -> Vec<Option<Change>> {
    let flights = healthy.len() as f64;
    let rotors: Vec<usize> = (0..flown.len())
        .filter(|r| flown[*r].is_some() && healthy.iter().all(|h| h[*r].is_some()))
        .collect();
    if rotors.len() < 2 {
        return vec![None; flown.len()];
    }
    let value = |levels: &[Option<Level>], r: usize| levels[r].map_or(f64::NAN, |level| level.0);
    let mean: Vec<f64> = rotors
        .iter()
        .map(|r| healthy.iter().map(|h| value(h, *r)).sum::<f64>() / flights)
        .collect();
    let less_common = |levels: &[Option<Level>]| -> Vec<f64> {
        let own: Vec<f64> = rotors.iter().zip(&mean).map(|(r, m)| value(levels, *r) - m).collect();
        let common = median(&own);
        own.iter().map(|x| x - common).collect()
    };
    let squares: f64 = healthy.iter().flat_map(|h| less_common(h)).map(|x| x * x).sum();
    let freedom = (flights - 1.0) * (rotors.len() - 1) as f64;
    let spread = (squares / freedom).sqrt().max(LEAST_SPREAD);
    let strongest = rotors
        .iter()
        .map(|r| value(flown, *r))
        .fold(f64::NEG_INFINITY, f64::max);
    let prior = 0.5 / rotors.len() as f64;
    let mut found = vec![None; flown.len()];
    for (r, x) in rotors.iter().zip(less_common(flown)) {
        let variance = spread * spread * (1.0 + 1.0 / flights) + flown[*r].map_or(0.0, |level| level.1);
        let odds = prior / (1.0 - prior) * factor(x, variance, freedom);
        let blurred = value(flown, *r) < strongest + LEAST_OF_STRONGEST.ln();
        found[*r] = Some(Change {
            growth: x,
            half: variance.sqrt() * two_sided_critical_value(OUTSIDE, freedom).unwrap_or(f64::INFINITY),
            posterior: if blurred { 0.0 } else { odds / (1.0 + odds) },
        });
    }
    found
}

/// What has changed in the level of a vehicle as a whole.
pub(super) fn whole(flown: Level, healthy: &[Level]) -> Change {
    let flights = healthy.len() as f64;
    let mean = healthy.iter().map(|level| level.0).sum::<f64>() / flights;
    let squares: f64 = healthy.iter().map(|level| (level.0 - mean).powi(2)).sum();
    let spread = (squares / (flights - 1.0)).sqrt().max(LEAST_SPREAD);
    let variance = spread * spread * (1.0 + 1.0 / flights) + flown.1;
    let odds = factor(flown.0 - mean, variance, flights - 1.0);
    Change {
        growth: flown.0 - mean,
        half: variance.sqrt() * two_sided_critical_value(OUTSIDE, flights - 1.0).unwrap_or(f64::INFINITY),
        posterior: odds / (1.0 + odds),
    }
}

/// Bayes factor of a growth against none.
fn factor(x: f64, variance: f64, freedom: f64) -> f64 {
    let kernel = |z: f64| (1.0 + z * z / (freedom * variance)).powf(-0.5 * (freedom + 1.0));
    let step = FAR * GROWTH / STEPS as f64;
    let density = |g: f64| (2.0 / std::f64::consts::PI).sqrt() / GROWTH * (-0.5 * (g / GROWTH).powi(2)).exp();
    let grown: f64 = (0..STEPS)
        .map(|k| (k as f64 + 0.5) * step)
        .map(|g| kernel(x - g) * density(g) * step)
        .sum();
    grown / kernel(x)
}

/// Of an even number the lower middle: of four rotors two may have grown.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[(sorted.len() - 1) / 2]
}
