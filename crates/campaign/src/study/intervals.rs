//! 95 % intervals: proportions (Wilson), proportions of windows clustered by flight, rates of rare events (Poisson).

/// The 97.5 % quantile of the standard normal.
const Z: f64 = 1.959_963_984_540_054;

/// Wilson's interval for `hits` out of `total` independent trials (Wilson 1927); `None` for no trials.
pub fn wilson(hits: f64, total: f64) -> Option<[f64; 2]> {
    if total <= 0.0 {
        return None;
    }
    let p = hits / total;
    let z2 = Z * Z / total;
    let centre = (p + z2 / 2.0) / (1.0 + z2);
    let half = Z / (1.0 + z2) * (p * (1.0 - p) / total + z2 / (4.0 * total)).max(0.0).sqrt();
    Some([(centre - half).max(0.0), (centre + half).min(1.0)])
}

/// Sums over clusters of windows, one cluster per flight; integers, so that the order of addition does not matter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClusterSums {
    clusters: u64,
    hits: u64,
    total: u64,
    hits_squared: u128,
    hits_total: u128,
    total_squared: u128,
}

impl ClusterSums {
    /// Adds a flight with `hits` out of `total` windows; a flight without windows is ignored.
    pub fn add(&mut self, hits: u64, total: u64) {
        if total == 0 {
            return;
        }
        let (h, t) = (u128::from(hits), u128::from(total));
        self.clusters += 1;
        self.hits += hits;
        self.total += total;
        self.hits_squared += h * h;
        self.hits_total += h * t;
        self.total_squared += t * t;
    }

    /// Number of flights.
    pub fn clusters(&self) -> u64 {
        self.clusters
    }

    /// Windows hit.
    pub fn hits(&self) -> u64 {
        self.hits
    }

    /// Windows.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Fraction of all windows; `None` if there are none.
    pub fn share(&self) -> Option<f64> {
        (self.total > 0).then(|| self.hits as f64 / self.total as f64)
    }

    /// Interval of the proportion. The windows of a flight are not independent: with the variance of the ratio estimator over flights,
    /// n/(n − 1) Σ(h_i − p t_i)²/(Σt_i)², the windows count as p(1 − p)/variance independent ones, used in Wilson's interval. If all
    /// flights are equal (as without any error), every flight counts as one trial, which is conservative.
    pub fn interval(&self) -> Option<[f64; 2]> {
        let p = self.share()?;
        let n = self.clusters as f64;
        if self.clusters < 2 {
            return wilson(p * n, n);
        }
        let squares = self.hits_squared as f64 - 2.0 * p * self.hits_total as f64 + p * p * self.total_squared as f64;
        let total = self.total as f64;
        let variance = n / (n - 1.0) * squares.max(0.0) / (total * total);
        let spread = p * (1.0 - p);
        let trials = if spread > 0.0 && variance > 0.0 {
            (spread / variance).clamp(1.0, total)
        } else {
            n
        };
        wilson(p * trials, trials)
    }
}

/// Interval for the rate of events, per unit of `exposure`, from their count: Garwood's exact one (χ² quantiles), 2.5 % in both tails.
/// With no events: from 0 to the one-sided 95 % limit, 2.996/exposure. `None` for no exposure.
pub fn poisson_rate(count: u64, exposure: f64) -> Option<[f64; 2]> {
    if exposure <= 0.0 {
        return None;
    }
    if count == 0 {
        return Some([0.0, -libm::log(0.05) / exposure]);
    }
    let lower = inverse_gamma(count as f64, 0.025);
    let upper = inverse_gamma(count as f64 + 1.0, 0.975);
    Some([lower / exposure, upper / exposure])
}

/// x with P(shape, x) = probability, P the regularised lower incomplete gamma function.
fn inverse_gamma(shape: f64, probability: f64) -> f64 {
    let (mut low, mut high) = (0.0, shape + 10.0 * shape.sqrt() + 20.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if lower_gamma(shape, middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// P(shape, x): series below shape + 1, continued fraction above (Press et al., Numerical Recipes, §6.2).
fn lower_gamma(shape: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let scale = libm::exp(shape * libm::log(x) - x - libm::lgamma(shape));
    if x < shape + 1.0 {
        let (mut term, mut sum, mut a) = (1.0 / shape, 1.0 / shape, shape);
        for _ in 0..100_000 {
            a += 1.0;
            term *= x / a;
            sum += term;
            if term < sum * 1e-16 {
                break;
            }
        }
        return sum * scale;
    }
    let tiny = 1e-300;
    let mut b = x + 1.0 - shape;
    let mut c = 1.0 / tiny;
    let mut d = 1.0 / b;
    let mut fraction = d;
    for i in 1..100_000 {
        let i = f64::from(i);
        let a = -i * (i - shape);
        b += 2.0;
        d = a * d + b;
        d = if d.abs() < tiny { 1.0 / tiny } else { 1.0 / d };
        c = b + a / c;
        c = if c.abs() < tiny { tiny } else { c };
        fraction *= d * c;
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    1.0 - scale * fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables give four digits.
    const TABLE: f64 = 5e-4;

    #[test]
    fn val_wilson_against_published_numbers() {
        // Newcombe 1998, Table I (without continuity correction): 81/263, 15/148, 0/20, 1/29.
        for (hits, total, want) in [
            (81.0, 263.0, [0.2553, 0.3662]),
            (15.0, 148.0, [0.0624, 0.1605]),
            (0.0, 20.0, [0.0, 0.1611]),
            (1.0, 29.0, [0.0061, 0.1718]),
        ] {
            let got = wilson(hits, total).expect("trials");
            assert!(
                (got[0] - want[0]).abs() < TABLE && (got[1] - want[1]).abs() < TABLE,
                "{got:?} {want:?}"
            );
        }
        assert_eq!(wilson(0.0, 0.0), None);
    }

    #[test]
    fn val_poisson_against_published_numbers() {
        // Exact limits of a Poisson mean (Garwood 1936), from sums of Poisson probabilities in Python.
        for (count, want) in [
            (1, [0.0253, 5.5716]),
            (2, [0.2422, 7.2247]),
            (10, [4.7954, 18.3904]),
            (20, [12.2165, 30.8884]),
            (100, [81.3640, 121.6268]),
        ] {
            let got = poisson_rate(count, 1.0).expect("exposure");
            assert!(
                (got[0] - want[0]).abs() < TABLE && (got[1] - want[1]).abs() < TABLE,
                "{count}: {got:?}"
            );
        }
        let none = poisson_rate(0, 10.0).expect("exposure");
        assert!(none[0] == 0.0 && (none[1] - 0.299_573).abs() < 1e-6);
        assert_eq!(poisson_rate(3, 0.0), None);
    }

    #[test]
    fn val_clustered_interval_between_its_limits() {
        // Windows independent within flights: near Wilson over windows. All-or-nothing flights: Wilson over flights.
        let mut spread = ClusterSums::default();
        let mut lumped = ClusterSums::default();
        for flight in 0..200u64 {
            spread.add(if flight % 2 == 0 { 52 } else { 48 }, 100);
            lumped.add(if flight % 2 == 0 { 100 } else { 0 }, 100);
        }
        let width = |interval: [f64; 2]| interval[1] - interval[0];
        let windows = width(wilson(10_000.0, 20_000.0).expect("trials"));
        let flights = width(wilson(100.0, 200.0).expect("trials"));
        let got = width(spread.interval().expect("windows"));
        assert!((got / windows - 1.0).abs() < 0.05, "{got} {windows}");
        let got = width(lumped.interval().expect("windows"));
        assert!((got / flights - 1.0).abs() < 0.05, "{got} {flights}");
    }

    #[test]
    fn val_no_error_counts_flights_not_windows() {
        let mut sums = ClusterSums::default();
        (0..48).for_each(|_| sums.add(1280, 1280));
        assert_eq!(sums.interval(), wilson(48.0, 48.0));
        assert_eq!(sums.share(), Some(1.0));
        assert_eq!(ClusterSums::default().interval(), None);
    }
}
