//! Statistics of the flights of one vehicle: which rotor has lost thrust since when, and how certain that is.
//!
//! Flight t has commanded `d_t` (ln of thrust over hover's). A loss of rotor i to the fraction e⁻ˣ adds `x s_i`. The component common to all
//! rotors (battery, air, mass) is removed from both; `r_t` and `s_i` are the remainder, in a space of q dimensions (three for most vehicles):
//!
//! ```text
//! r_t = μ_g + b z_t + e_t,   e_t ~ N(0, σ²),   z_t: a ramp from 0 to 1 over the flights, or a step at one of them
//! ```
//! with a separate mean μ after every propeller replacement. Least squares give b with q dimensions and σ² with ν = q (flights − means − 1)
//! degrees of freedom. σ is the spread *between flights*: the spread within one is due to manoeuvres, which do not affect the mean, and wind,
//! which differs in the next. A set S of one or two rotors explains b by losses x_i ≥ 0; its likelihood is Student's t of the remainder,
//!
//! ```text
//! ln L_S = −(ν + q)/2 ln(1 + Z |b − Σ x_i s_i|²/(ν σ²)),   Z = Σ (z_t − mean)²
//! ```
//! and a pair pays for its additional parameter (Occam's factor under a uniform prior up to [`LARGEST_LOSS`]) and a prior of [`PAIR_PRIOR`].
//!
//! A step that the last flight alone shows may be a flight of another kind, or one in a gale: its own deviation, [`ODD_FLIGHT`], adds to the
//! error of b, σ²/Z + σ_o², in the t and in the likelihood.
//!
//! A claim is made only if the best rotor's t exceeds what one healthy vehicle in 1/[`FALSE_CLAIMS`] shows over all rotors and shapes
//! tried, and if the loss is at least [`LEAST_LOSS`]; a rotor is named if its sets have [`NAMED`] of the posterior. A named loss is
//! subtracted, and the remainder is searched again, without that rotor. A step that ends, because a propeller was
//! replaced without a record, is recognised as such as soon as its end explains more than chance does over all possible
//! ends.
//!
//! Limits: a thrust gain of a rotor looks like a loss of the opposite one (of six rotors), but propellers do not gain; equal losses of
//! opposite rotors change only the common component; flights are assumed independent and equally spaced.

use rotortwin_flight_core::fdi::student_t::{two_sided_critical_value, two_sided_p_value};

/// Minimum number of flights since a propeller replacement for a trend.
pub const LEAST_FLIGHTS: usize = 5;
/// Minimum number of flights before a step.
pub const LEAST_BEFORE: usize = 3;
/// Fraction of healthy histories with a claim, over all rotors and shapes tried, per evaluation.
pub const FALSE_CLAIMS: f64 = 1e-3;
/// Deviation σ_o of an odd flight (another kind of flight, a gale) from the others, in addition to the spread between these, ln of thrust: two ordinary
/// spreads (0.24 to 0.32 % on flights of the independent generator), as four hovers say little of how a helix differs from them.
pub const ODD_FLIGHT: f64 = 0.006;
/// A smaller loss is not worth reporting, fraction.
pub const LEAST_LOSS: f64 = 0.01;
/// Posterior above which a rotor is named.
pub const NAMED: f64 = 0.95;
/// Prior odds of a pair versus a single rotor.
const PAIR_PRIOR: f64 = 0.02;
/// Losses are assumed equally likely up to this x.
const LARGEST_LOSS: f64 = 0.3;
/// Lower bound of the spread between flights, ln of thrust.
const LEAST_SPREAD: f64 = 0.001;
/// Fraction of lasting losses that are reported as over.
const FALSE_ENDS: f64 = 0.01;
/// Minimum number of flights of a loss that is over, and after it.
const LEAST_EPISODE: usize = 2;
const LEAST_AFTER: usize = 2;
/// Number of sweeps in which named rotors choose their shapes given the others.
const SWEEPS: usize = 4;
/// Reference flights for the loss per flight.
pub const REFERENCE_FLIGHTS: usize = 3;

/// One flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// ln of commanded thrust over hover's, rotor by rotor.
    pub asked: Vec<f64>,
    /// Number of propeller replacements before it, of any rotor: flights with the same number share their mean.
    pub mount: usize,
}

/// Shape of a loss over time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Linear from flight to flight.
    Ramp,
    /// From this flight of the list on, zero-based.
    Step(usize),
    /// The same, up to before another one: it is over.
    Episode(usize, usize),
}

/// A rotor that has lost thrust.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// Zero-based.
    pub rotor: usize,
    /// Shape of the loss.
    pub shape: Shape,
    /// x over all flights of the list: the share lost is 1 − e⁻ˣ.
    pub total: f64,
    /// Half width of its 95 % interval.
    pub half_width: f64,
    /// Posterior that this rotor has lost thrust, given that one or two have.
    pub posterior: f64,
    /// Two-sided p of its t, before correction for multiple trials.
    pub p: f64,
}

/// Result of the statistics.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Named rotors, in the order in which they were found.
    pub named: Vec<Named>,
    /// Something has changed; these rotors (from 0) together have 95 % of the posterior, none of them alone.
    pub suspects: Vec<usize>,
    /// Spread between flights of the non-common component, ln of thrust.
    pub spread: f64,
    /// Degrees of freedom of the spread; 0 if there are too few flights.
    pub freedom: f64,
}

/// Signatures without the common component.
#[derive(Debug, Clone)]
pub struct Signatures {
    own: Vec<Vec<f64>>,
    rank: usize,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Subtracts the mean.
fn without_common(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|x| x - mean).collect()
}

/// `a − factor b`, in place.
fn take(a: &mut [f64], factor: f64, b: &[f64]) {
    for (x, y) in a.iter_mut().zip(b) {
        *x -= factor * y;
    }
}

impl Signatures {
    /// From the change of `asked` per x of each rotor.
    pub fn of(signatures: &[Vec<f64>]) -> Self {
        let own: Vec<Vec<f64>> = signatures.iter().map(|s| without_common(s)).collect();
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for one in &own {
            let mut rest = one.clone();
            for direction in &basis {
                let along = dot(&rest, direction);
                take(&mut rest, along, direction);
            }
            let length = dot(&rest, &rest).sqrt();
            // Changes of opposite rotors are equal up to sign, rounding and the curvature of the logarithm.
            if length > 0.05 {
                basis.push(rest.iter().map(|x| x / length).collect());
            }
        }
        Self { own, rank: basis.len() }
    }

    fn rotors(&self) -> usize {
        self.own.len()
    }

    /// Best-fitting x of a rotor for a change, if it alone has changed.
    pub fn loss(&self, rotor: usize, change: &[f64]) -> f64 {
        let own = &self.own[rotor];
        dot(own, &without_common(change)) / dot(own, own)
    }

    /// Standard deviation of [`Self::loss`] per spread.
    pub fn per_spread(&self, rotor: usize) -> f64 {
        1.0 / dot(&self.own[rotor], &self.own[rotor]).sqrt()
    }
}

/// Subtracts the mean of each mount.
fn centred(values: &[f64], flights: &[Flight]) -> Vec<f64> {
    let mut out = values.to_vec();
    let mut begin = 0;
    while begin < flights.len() {
        let mount = flights[begin].mount;
        let end = begin + flights[begin..].iter().take_while(|f| f.mount == mount).count();
        let mean = values[begin..end].iter().sum::<f64>() / (end - begin) as f64;
        for x in &mut out[begin..end] {
            *x -= mean;
        }
        begin = end;
    }
    out
}

fn mounts(flights: &[Flight]) -> usize {
    1 + flights.windows(2).filter(|pair| pair[0].mount != pair[1].mount).count()
}

/// A shape with the best-fitting unconstrained change.
struct Fit {
    shape: Shape,
    /// b.
    change: Vec<f64>,
    /// Z.
    weight: f64,
    /// Remaining sum of squares.
    rest: f64,
}

impl Shape {
    /// Only the last of so many flights shows it.
    fn is_of_the_last_flight(self, count: usize) -> bool {
        self == Self::Step(count - 1)
    }
}

impl Fit {
    /// Standard deviation of a component of b among so many flights.
    fn deviation(&self, spread: f64, count: usize) -> f64 {
        let odd = if self.shape.is_of_the_last_flight(count) {
            ODD_FLIGHT
        } else {
            0.0
        };
        (spread / self.weight.sqrt()).hypot(odd)
    }
}

/// z of each flight; 1 while the whole loss is there.
fn regressor(shape: Shape, count: usize) -> Vec<f64> {
    let of = |t: usize| match shape {
        Shape::Ramp => t as f64 / (count - 1) as f64,
        Shape::Step(at) => f64::from(u8::from(t >= at)),
        Shape::Episode(from, end) => f64::from(u8::from((from..end).contains(&t))),
    };
    (0..count).map(of).collect()
}

/// Rows, flight by flight, with each mount's mean subtracted.
fn rows_of(flights: &[Flight]) -> Vec<Vec<f64>> {
    let own: Vec<Vec<f64>> = flights.iter().map(|f| without_common(&f.asked)).collect();
    let rotors = own.first().map_or(0, Vec::len);
    let columns: Vec<Vec<f64>> = (0..rotors)
        .map(|i| centred(&own.iter().map(|row| row[i]).collect::<Vec<_>>(), flights))
        .collect();
    (0..flights.len())
        .map(|t| columns.iter().map(|c| c[t]).collect())
        .collect()
}

fn fit(shape: Shape, rows: &[Vec<f64>], flights: &[Flight]) -> Option<Fit> {
    let z = centred(&regressor(shape, flights.len()), flights);
    let weight = dot(&z, &z);
    // A step that coincides with a new propeller already has its own mean.
    if weight < 1e-9 {
        return None;
    }
    let rotors = rows.first()?.len();
    let change: Vec<f64> = (0..rotors)
        .map(|i| rows.iter().zip(&z).map(|(row, z)| row[i] * z).sum::<f64>() / weight)
        .collect();
    let all: f64 = rows.iter().map(|row| dot(row, row)).sum();
    let rest = (all - weight * dot(&change, &change)).max(0.0);
    Some(Fit {
        shape,
        change,
        weight,
        rest,
    })
}

/// A set of rotors with its losses and the logarithm of its weight.
struct Weighed {
    rotors: Vec<usize>,
    losses: Vec<f64>,
    log_weight: f64,
}

/// Losses of a set that explain a change; `None` if one of them is a gain.
fn solve(set: &[usize], change: &[f64], signatures: &Signatures) -> Option<Vec<f64>> {
    let own = |i: usize| &signatures.own[set[i]];
    let losses = match set.len() {
        1 => vec![dot(own(0), change) / dot(own(0), own(0))],
        _ => {
            let (aa, bb, ab) = (dot(own(0), own(0)), dot(own(1), own(1)), dot(own(0), own(1)));
            let determinant = aa * bb - ab * ab;
            if determinant < 1e-3 * aa * bb {
                return None;
            }
            let (a, b) = (dot(own(0), change), dot(own(1), change));
            vec![(bb * a - ab * b) / determinant, (aa * b - ab * a) / determinant]
        }
    };
    losses.iter().all(|x| *x > 0.0).then_some(losses)
}

/// `deviation`: of a component of the fit's change.
fn weigh(fit: &Fit, deviation: f64, freedom: f64, signatures: &Signatures, left: &[usize]) -> Vec<Weighed> {
    let singles = left.iter().map(|i| vec![*i]);
    let pairs = left
        .iter()
        .enumerate()
        .flat_map(|(k, i)| left[k + 1..].iter().map(move |j| vec![*i, *j]));
    let q = signatures.rank as f64;
    singles
        .chain(pairs)
        .filter_map(|rotors| {
            let losses = solve(&rotors, &fit.change, signatures)?;
            let mut rest = fit.change.clone();
            for (rotor, loss) in rotors.iter().zip(&losses) {
                take(&mut rest, *loss, &signatures.own[*rotor]);
            }
            let misfit = dot(&rest, &rest) / (deviation * deviation);
            let mut log_weight = -0.5 * (freedom + q) * (misfit / freedom).ln_1p();
            if rotors.len() > 1 {
                let known_to = deviation * signatures.per_spread(rotors[1]);
                let occam = ((2.0 * std::f64::consts::PI).sqrt() * known_to / LARGEST_LOSS).min(1.0);
                log_weight += (PAIR_PRIOR * occam).ln();
            }
            Some(Weighed {
                rotors,
                losses,
                log_weight,
            })
        })
        .collect()
}

/// Posterior of each rotor, and the likeliest set.
fn posterior(weighed: &[Weighed], rotors: usize) -> (Vec<f64>, Option<&Weighed>) {
    let best = weighed.iter().max_by(|a, b| a.log_weight.total_cmp(&b.log_weight));
    let top = best.map_or(0.0, |one| one.log_weight);
    let mut of = vec![0.0; rotors];
    let mut total = 0.0;
    for one in weighed {
        let weight = (one.log_weight - top).exp();
        total += weight;
        for rotor in &one.rotors {
            of[*rotor] += weight;
        }
    }
    if total > 0.0 {
        of.iter_mut().for_each(|p| *p /= total);
    }
    (of, best)
}

/// Evaluates a list of flights, earliest first.
pub fn assess(flights: &[Flight], signatures: &Signatures) -> Finding {
    let mut rows = rows_of(flights);
    let rotors = signatures.rotors();
    let mut left: Vec<usize> = (0..rotors).collect();
    let mut found = Finding {
        named: Vec::new(),
        suspects: Vec::new(),
        spread: 0.0,
        freedom: 0.0,
    };
    (found.spread, found.freedom) = plain_spread(&rows, flights, signatures, 0);
    let mut shapes: Vec<Shape> = (LEAST_BEFORE..flights.len()).map(Shape::Step).collect();
    if flights.len() >= LEAST_FLIGHTS {
        shapes.insert(0, Shape::Ramp);
    }
    while !left.is_empty() {
        let best = shapes
            .iter()
            .filter_map(|shape| fit(*shape, &rows, flights))
            .min_by(|a, b| a.rest.total_cmp(&b.rest));
        let Some(best) = best else { break };
        // Each loss subtracted has cost a degree of freedom.
        let freedom =
            signatures.rank as f64 * (flights.len() as f64 - mounts(flights) as f64 - 1.0) - found.named.len() as f64;
        if freedom < 1.0 {
            break;
        }
        let spread = (best.rest / freedom).sqrt().max(LEAST_SPREAD);
        let deviation = best.deviation(spread, flights.len());
        let t = |rotor: usize, loss: f64| loss / (deviation * signatures.per_spread(rotor));
        let weighed = weigh(&best, deviation, freedom, signatures, &left);
        let strongest = weighed
            .iter()
            .filter(|one| one.rotors.len() == 1)
            .map(|one| t(one.rotors[0], one.losses[0]))
            .fold(0.0, f64::max);
        let trials = (rotors * shapes.len()) as f64;
        if two_sided_p_value(strongest, freedom) / 2.0 * trials > FALSE_CLAIMS {
            break;
        }
        let (of, likeliest) = posterior(&weighed, rotors);
        let Some(likeliest) = likeliest else { break };
        if likeliest.losses.iter().all(|x| 1.0 - (-x).exp() < LEAST_LOSS) {
            break;
        }
        let z = centred(&regressor(best.shape, flights.len()), flights);
        let mut any = false;
        for (rotor, loss) in likeliest.rotors.iter().zip(&likeliest.losses) {
            if of[*rotor] < NAMED {
                continue;
            }
            any = true;
            left.retain(|other| other != rotor);
            for (row, z) in rows.iter_mut().zip(&z) {
                take(row, loss * z, &signatures.own[*rotor]);
            }
            found.named.push(Named {
                rotor: *rotor,
                shape: best.shape,
                total: *loss,
                half_width: 0.0,
                posterior: of[*rotor],
                p: 1.0,
            });
        }
        if !any {
            found.suspects = likeliest_union(weighed, &of);
            break;
        }
        refine(&mut found, &mut rows, flights, signatures, &shapes);
    }
    found
}

/// Refits the shape of each named rotor in turn, given the losses of the others; then the intervals from the remaining spread.
fn refine(found: &mut Finding, rows: &mut [Vec<f64>], flights: &[Flight], signatures: &Signatures, shapes: &[Shape]) {
    let count = flights.len();
    let regressor = |shape| centred(&regressor(shape, count), flights);
    let (spread, _) = plain_spread(rows, flights, signatures, found.named.len());
    for _ in 0..SWEEPS {
        for one in &mut found.named {
            let own = &signatures.own[one.rotor];
            for (row, z) in rows.iter_mut().zip(regressor(one.shape)) {
                take(row, -one.total * z, own);
            }
            let explained = |fit: &Fit| fit.weight * dot(own, &fit.change).max(0.0).powi(2) / dot(own, own);
            let best_of = |shapes: &[Shape]| {
                let fits = shapes.iter().filter_map(|shape| fit(*shape, rows, flights));
                fits.max_by(|a, b| explained(a).total_cmp(&explained(b)))
            };
            let lasting = best_of(shapes);
            let ends: Vec<Shape> = match lasting.as_ref().map(|fit| fit.shape) {
                Some(Shape::Step(from)) => (from + LEAST_EPISODE..(count + 1).saturating_sub(LEAST_AFTER))
                    .map(|end| Shape::Episode(from, end))
                    .collect(),
                _ => Vec::new(),
            };
            // What the best of so many ends explains by chance.
            let chance = 2.0 * (ends.len().max(1) as f64 / FALSE_ENDS).ln() * spread * spread;
            let over = best_of(&ends).filter(|over| {
                let by_step = lasting.as_ref().map_or(0.0, explained);
                explained(over) > by_step + chance
            });
            let best = over.or(lasting);
            if let Some(best) = best {
                one.shape = best.shape;
                one.total = signatures.loss(one.rotor, &best.change);
            }
            for (row, z) in rows.iter_mut().zip(regressor(one.shape)) {
                take(row, one.total * z, own);
            }
        }
    }
    (found.spread, found.freedom) = plain_spread(rows, flights, signatures, found.named.len());
    let wide = two_sided_critical_value(0.05, found.freedom).unwrap_or(f64::INFINITY);
    for one in &mut found.named {
        let z = regressor(one.shape);
        let odd = if one.shape.is_of_the_last_flight(count) {
            ODD_FLIGHT
        } else {
            0.0
        };
        let deviation = (found.spread / dot(&z, &z).sqrt()).hypot(odd);
        let known_to = deviation * signatures.per_spread(one.rotor);
        one.half_width = wide * known_to;
        one.p = two_sided_p_value(one.total / known_to, found.freedom);
    }
}

/// The smallest number of likeliest sets that together have [`NAMED`], as one list of rotors.
fn likeliest_union(mut weighed: Vec<Weighed>, of: &[f64]) -> Vec<usize> {
    weighed.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
    let top = weighed[0].log_weight;
    let total: f64 = weighed.iter().map(|one| (one.log_weight - top).exp()).sum();
    let mut sum = 0.0;
    let mut union = vec![false; of.len()];
    for one in &weighed {
        for rotor in &one.rotors {
            union[*rotor] = true;
        }
        sum += (one.log_weight - top).exp() / total;
        if sum >= NAMED {
            break;
        }
    }
    (0..of.len()).filter(|i| union[*i]).collect()
}

/// Spread about the means, without any change except those subtracted.
fn plain_spread(rows: &[Vec<f64>], flights: &[Flight], signatures: &Signatures, taken: usize) -> (f64, f64) {
    let freedom = signatures.rank as f64 * (flights.len() as f64 - mounts(flights) as f64) - taken as f64;
    if flights.is_empty() || freedom < 1.0 {
        return (0.0, 0.0);
    }
    let squares: f64 = rows.iter().map(|row| dot(row, row)).sum();
    ((squares / freedom).sqrt().max(LEAST_SPREAD), freedom)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic pseudo-random numbers, approximately standard normal (sum of 12 uniforms).
    struct Draw(u64);
    impl Draw {
        fn normal(&mut self) -> f64 {
            let mut uniform = || {
                self.0 = self
                    .0
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 11) as f64 / (1u64 << 53) as f64
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        }
    }

    /// P e_i of a flat hexarotor with minimum-norm allocation.
    fn hexarotor() -> Vec<Vec<f64>> {
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / 6.0;
        let spin = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        (0..6)
            .map(|i| {
                (0..6)
                    .map(|j| 1.0 / 6.0 + (angle(i) - angle(j)).cos() / 3.0 + spin(i) * spin(j) / 6.0)
                    .collect()
            })
            .collect()
    }

    /// Flights whose rotors have lost x(t, i), with a spread between flights and biases of 3 %.
    fn flown(count: usize, spread: f64, seed: u64, lost: impl Fn(usize, usize) -> f64) -> Vec<Flight> {
        let signatures = hexarotor();
        let mut draw = Draw(seed);
        let seen = |x: &[f64]| -> Vec<f64> { (0..6).map(|j| (0..6).map(|i| x[i] * signatures[i][j]).sum()).collect() };
        let bias: Vec<f64> = (0..6).map(|_| 0.03 * draw.normal()).collect();
        (0..count)
            .map(|t| {
                let x: Vec<f64> = (0..6).map(|i| bias[i] + lost(t, i) + spread * draw.normal()).collect();
                let common = 0.01 * draw.normal();
                Flight {
                    asked: seen(&x).iter().map(|d| d + common).collect(),
                    mount: 0,
                }
            })
            .collect()
    }

    #[test]
    fn val_a_ramp_is_named_with_an_interval_that_holds_it() {
        let signatures = Signatures::of(&hexarotor());
        assert_eq!(signatures.rank, 3);
        let mut inside = 0;
        for seed in 0..400 {
            let flights = flown(8, 0.003, 100 + seed, |t, i| if i == 2 { 0.01 * t as f64 } else { 0.0 });
            let found = assess(&flights, &signatures);
            assert_eq!(found.named.len(), 1, "seed {seed}: {found:?}");
            let one = &found.named[0];
            assert_eq!((one.rotor, one.shape), (2, Shape::Ramp), "seed {seed}");
            inside += usize::from((one.total - 0.07).abs() < one.half_width);
        }
        // 95 % of 400 are 380 ± 9 (two deviations).
        assert!((366..=394).contains(&inside), "{inside} of 400");
    }

    #[test]
    fn val_a_healthy_vehicle_with_unequal_rotors_gets_no_claim() {
        let signatures = Signatures::of(&hexarotor());
        let claims = (0..2000u64)
            .filter(|seed| {
                let found = assess(
                    &flown(4 + *seed as usize % 17, 0.003, 7000 + seed, |_, _| 0.0),
                    &signatures,
                );
                !found.named.is_empty() || !found.suspects.is_empty()
            })
            .count();
        // The design rate is one in a thousand.
        assert!(claims <= 6, "{claims} of 2000");
    }

    #[test]
    fn val_a_step_and_a_ramp_of_two_rotors_are_told_apart() {
        let signatures = Signatures::of(&hexarotor());
        for seed in 0..50 {
            let flights = flown(10, 0.002, 900 + seed, |t, i| match i {
                0 => 0.012 * t as f64,
                4 if t >= 6 => 0.05,
                _ => 0.0,
            });
            let found = assess(&flights, &signatures);
            let mut named: Vec<(usize, Shape)> = found.named.iter().map(|one| (one.rotor, one.shape)).collect();
            named.sort_by_key(|one| one.0);
            assert_eq!(named, [(0, Shape::Ramp), (4, Shape::Step(6))], "seed {seed}: {found:?}");
        }
    }

    /// Thirty real flights: rotor 4 "has had 6.3 % less thrust since flight 13", next to six last flights without any.
    #[test]
    fn regress_a_loss_that_is_over_is_told_with_its_end() {
        let signatures = Signatures::of(&hexarotor());
        for seed in 0..50 {
            let lost = |end: usize| move |t: usize, i: usize| if i == 3 && (12..end).contains(&t) { 0.06 } else { 0.0 };
            for (end, shape) in [(24, Shape::Episode(12, 24)), (30, Shape::Step(12))] {
                let found = assess(&flown(30, 0.004, 3000 + seed, lost(end)), &signatures);
                let shapes: Vec<(usize, Shape)> = found.named.iter().map(|one| (one.rotor, one.shape)).collect();
                assert_eq!(shapes, [(3, shape)], "seed {seed}: {found:?}");
                let named = &found.named[0];
                assert!(
                    (named.total - 0.06).abs() < 2.0 * named.half_width,
                    "seed {seed}: {named:?}"
                );
            }
        }
    }

    #[test]
    fn val_two_rotors_that_wear_alike_are_both_named() {
        let signatures = Signatures::of(&hexarotor());
        for seed in 0..50 {
            let flights = flown(8, 0.002, 300 + seed, |t, i| {
                if i == 1 || i == 2 { 0.01 * t as f64 } else { 0.0 }
            });
            let found = assess(&flights, &signatures);
            let mut named: Vec<usize> = found.named.iter().map(|one| one.rotor).collect();
            named.sort_unstable();
            assert_eq!(named, [1, 2], "seed {seed}: {found:?}");
        }
    }

    #[test]
    fn prop_a_new_propeller_is_no_change_of_the_others() {
        let signatures = Signatures::of(&hexarotor());
        // Rotor 3 is replaced before flight 6: its bias jumps by 4 %, and nothing else happens.
        let mut flights = flown(12, 0.002, 41, |t, i| if i == 3 && t >= 6 { -0.04 } else { 0.0 });
        let seen = assess(&flights, &signatures);
        assert!(
            !seen.named.is_empty() || !seen.suspects.is_empty(),
            "without the event it is a change"
        );
        for flight in &mut flights[6..] {
            flight.mount = 1;
        }
        let found = assess(&flights, &signatures);
        assert!(found.named.is_empty() && found.suspects.is_empty(), "{found:?}");
    }

    /// Normal flights with an occasional outlier of six spreads: a claim needs a second flight, or a loss far beyond any outlier.
    #[test]
    fn val_one_odd_flight_is_no_step_and_a_broken_tip_is() {
        let signatures = Signatures::of(&hexarotor());
        let said = |found: &Finding| !found.named.is_empty() || !found.suspects.is_empty();
        let odd = |seed| flown(7, 0.003, seed, |t, i| if i == 5 && t == 6 { 0.018 } else { 0.0 });
        let claims = (0..200)
            .filter(|seed| said(&assess(&odd(5000 + seed), &signatures)))
            .count();
        assert!(claims <= 10, "{claims} of 200");
        let broken = |seed| flown(7, 0.003, seed, |t, i| if i == 5 && t == 6 { 0.08 } else { 0.0 });
        let named = (0..200)
            .filter(|seed| {
                assess(&broken(6000 + seed), &signatures)
                    .named
                    .iter()
                    .any(|one| one.rotor == 5)
            })
            .count();
        assert!(named >= 190, "{named} of 200");
    }

    /// Five flights determine the spread by nine degrees of freedom: at a level of one in a million a loss had to be 15 deviations, and one of
    /// 8 % was missed.
    #[test]
    fn regress_a_loss_in_the_last_of_few_flights_is_named() {
        let signatures = Signatures::of(&hexarotor());
        let truth = -(1.0_f64 - 0.08).ln();
        for (count, least) in [(4, 170), (5, 195), (6, 198)] {
            let (mut named, mut inside) = (0, 0);
            for seed in 0..200 {
                let flights = flown(count, 0.003, 4000 + seed, |t, i| {
                    if i == 1 && t + 1 == count { truth } else { 0.0 }
                });
                let found = assess(&flights, &signatures);
                if let [one] = found.named.as_slice()
                    && one.rotor == 1
                {
                    named += 1;
                    inside += usize::from((one.total - truth).abs() < one.half_width);
                }
            }
            assert!(named >= least, "{named} of 200 after {count} flights");
            assert!(inside * 100 >= 95 * named, "{inside} of {named} after {count} flights");
        }
    }

    #[test]
    fn regress_too_few_flights_say_nothing() {
        let signatures = Signatures::of(&hexarotor());
        for count in 0..4 {
            let found = assess(
                &flown(count, 0.001, 5, |t, i| if i == 0 { 0.05 * t as f64 } else { 0.0 }),
                &signatures,
            );
            assert!(
                found.named.is_empty() && found.suspects.is_empty(),
                "{count} flights: {found:?}"
            );
        }
    }
}
