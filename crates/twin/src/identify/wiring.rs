//! Which rotor each output drives, and how it turns, from the motion alone.
//!
//! For every order of the rotors on an even polygon (X, plus) and both spin senses: correlation ρ of the predicted
//! torque with the measured angular acceleration, roll, pitch and yaw; score = −Σ ln(1 − ρ²), a negative ρ subtracts.
//! With more than four rotors the mixer drives four directions only, so orders whose levers lie outside the directions
//! of the duties are excluded first.

use nalgebra::SMatrix;
use serde::Serialize;

use super::actuator::lagged;
use super::class::Class;
use super::curve::Curve;
use super::filters::Band;
use super::fit::hover_point;
use super::frames::{Place, rings};
use super::grid::Grid;

/// Most rotors that all orders are tried of.
const MOST: usize = 8;
/// Requirements for an answer: seconds in the air, score, distance to the next order.
pub(crate) const ENOUGH_S: f64 = 10.0;
const ENOUGH_SCORE: f64 = 0.3;
const ENOUGH_MARGIN: f64 = 0.1;
/// Share of the best order's score by which a stated one may be worse: a real frame is not a regular polygon.
const WORSE_SHARE: f64 = 0.1;
/// Share of a lever that must lie in the directions of the duties.
const IN_SPACE: f64 = 0.9;

/// The order that explains the motion best.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
#[schema(as = IdentifiedWiring)]
pub struct Wiring {
    /// `X` or `plus`.
    pub layout: &'static str,
    /// Place of each rotor, in the order of the outputs.
    #[serde(skip)]
    pub places: Vec<Place>,
    /// −Σ ln(1 − ρ²).
    pub score: f64,
    /// Margin to the next order.
    pub margin: f64,
    /// ρ of roll, pitch, yaw.
    pub correlation: [f64; 3],
    /// Orders that were scored.
    pub tried: usize,
    /// Seconds in the air.
    pub seconds: f64,
}

impl Wiring {
    /// Why there is no answer, if there is none.
    pub(crate) fn doubt(&self) -> Option<String> {
        if self.seconds < ENOUGH_S {
            return Some(format!("{:.1} s in the air, {ENOUGH_S} s are needed", self.seconds));
        }
        if self.score < ENOUGH_SCORE || self.margin < ENOUGH_MARGIN || self.correlation.iter().any(|rho| *rho <= 0.0) {
            return Some(format!(
                "the best order scores {:.2} ({ENOUGH_SCORE} are needed), {:.3} above the next ({ENOUGH_MARGIN}): too little motion",
                self.score, self.margin
            ));
        }
        None
    }
}

type Square = SMatrix<f64, MOST, MOST>;

/// Sums over the flight: thrust against thrust, thrust against acceleration, acceleration against itself.
#[derive(Default)]
struct Moments {
    thrust: Square,
    cross: [f64; MOST],
    power: f64,
}

impl Moments {
    fn add(&mut self, thrust: &[Vec<f64>], acceleration: &[f64], settle: usize) {
        for k in settle..acceleration.len().saturating_sub(settle) {
            for i in 0..thrust.len() {
                for j in 0..=i {
                    self.thrust[(i, j)] += thrust[i][k] * thrust[j][k];
                }
                self.cross[i] += thrust[i][k] * acceleration[k];
            }
            self.power += acceleration[k] * acceleration[k];
        }
    }

    fn mirror(&mut self) {
        for i in 0..MOST {
            for j in 0..i {
                self.thrust[(j, i)] = self.thrust[(i, j)];
            }
        }
    }

    fn correlation(&self, lever: &[f64]) -> f64 {
        let (mut cross, mut power) = (0.0, 0.0);
        for (i, a) in lever.iter().enumerate() {
            cross += a * self.cross[i];
            for (j, b) in lever.iter().enumerate() {
                power += a * b * self.thrust[(i, j)];
            }
        }
        let scale = (power * self.power).sqrt();
        if scale > 0.0 { cross / scale } else { 0.0 }
    }
}

/// What the motion says of the rotors' places.
pub(crate) struct Motion {
    /// The order that explains it best.
    pub(crate) best: Wiring,
    moments: [Moments; 3],
}

/// An order that somebody states, and the motion's own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contradiction {
    /// ρ of roll, pitch, yaw of the stated order.
    pub(crate) correlation: [f64; 3],
    /// −Σ ln(1 − ρ²) of the stated order.
    pub(crate) score: f64,
}

impl Motion {
    /// −Σ ln(1 − ρ²) of a stated order.
    pub(crate) fn score_of(&self, places: &[Place]) -> f64 {
        score(correlations(&self.moments, places))
    }

    /// The result for a stated order, if the motion clearly contradicts it: there was enough of it, and another order
    /// explains it better by more than two right ones differ. Which of the others is right need not be known for that.
    pub(crate) fn against(&self, stated: &[Place]) -> Option<Contradiction> {
        let correlation = correlations(&self.moments, stated);
        let score = score(correlation);
        let clear = ENOUGH_MARGIN.max(WORSE_SHARE * self.best.score);
        (self.best.seconds >= ENOUGH_S && self.best.score >= ENOUGH_SCORE && self.best.score - score > clear)
            .then_some(Contradiction { correlation, score })
    }
}

/// Correlations of the torques of rotors at these places with the angular acceleration.
fn correlations(moments: &[Moments; 3], places: &[Place]) -> [f64; 3] {
    let of = |axis: usize, value: &dyn Fn(&Place) -> f64| -> f64 {
        moments[axis].correlation(&places.iter().map(value).collect::<Vec<_>>())
    };
    [
        of(0, &|place| -place.position[1]),
        of(1, &|place| place.position[0]),
        of(2, &Place::yaw_sign),
    ]
}

fn score(correlation: [f64; 3]) -> f64 {
    correlation
        .iter()
        .map(|rho| -rho.signum() * (1.0 - rho * rho).max(1e-6).ln())
        .sum()
}

/// Tries all orders; `None` where rates are missing or there are too many rotors.
pub(crate) fn search(grids: &[Grid], class: &Class) -> Option<Motion> {
    let rotors = grids.first()?.duty.len();
    if !(4..=MOST).contains(&rotors) || rotors % 2 != 0 || grids.iter().any(|grid| grid.rates.is_none()) {
        return None;
    }
    let (hover_duty, _) = hover_point(grids);
    let curve = Curve::with_slope(hover_duty, super::grid::GRAVITY / rotors as f64, class.slope);
    let mut moments: [Moments; 3] = Default::default();
    let mut moved = Square::zeros();
    for grid in grids {
        let rates = grid.rates.as_ref()?;
        for part in &grid.airborne {
            let thrust: Vec<_> = (0..rotors)
                .map(|rotor| lagged(grid, part, rotor, &curve, class.lag_s, class.delay_s))
                .collect();
            let unlagged: Vec<Vec<f64>> = (0..rotors)
                .map(|rotor| {
                    part.clone()
                        .map(|k| curve.hover * curve.shape(grid.duty[rotor][k]))
                        .collect()
                })
                .collect();
            for axis in 0..3 {
                let band = if axis < 2 {
                    Band::of_torque(grid.step_s, grid.fast)
                } else {
                    Band::of_yaw(grid.step_s, grid.fast)
                };
                let rate = &rates[axis][part.clone()];
                let mut acceleration: Vec<f64> =
                    rate.windows(2).map(|pair| (pair[1] - pair[0]) / grid.step_s).collect();
                acceleration.push(acceleration.last().copied().unwrap_or(0.0));
                let acceleration = band.pass(&acceleration, grid.step_s);
                let inputs: Vec<Vec<f64>> = (0..rotors)
                    .map(|rotor| {
                        let values = if axis < 2 {
                            &thrust[rotor].mean
                        } else {
                            &unlagged[rotor]
                        };
                        band.pass(values, grid.step_s)
                    })
                    .collect();
                let settle = band.settling(grid.step_s);
                moments[axis].add(&inputs, &acceleration, settle);
            }
            let wide = Band {
                low_hz: 0.3,
                high_hz: 15.0_f64.min(0.4 / grid.step_s),
            };
            let wide: Vec<Vec<f64>> = unlagged.iter().map(|values| wide.pass(values, grid.step_s)).collect();
            for i in 0..rotors {
                for j in 0..rotors {
                    moved[(i, j)] += wide[i].iter().zip(&wide[j]).map(|(a, b)| a * b).sum::<f64>();
                }
            }
        }
    }
    for moments in &mut moments {
        moments.mirror();
    }
    let space = directions(&moved, rotors);
    let seconds = grids.iter().map(Grid::airborne_s).sum();
    let best = best(rotors, &moments, space.as_ref(), seconds)?;
    Some(Motion { best, moments })
}

/// Projector onto the four directions that the duties moved in, if there are only four.
fn directions(moved: &Square, rotors: usize) -> Option<Square> {
    if rotors == 4 {
        return None;
    }
    let eigen = moved.symmetric_eigen();
    let mut order: Vec<usize> = (0..MOST).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    if eigen.eigenvalues[order[4]] > 0.2 * eigen.eigenvalues[order[3]] {
        return None;
    }
    let mut projector = Square::zeros();
    for &i in &order[..4] {
        let vector = eigen.eigenvectors.column(i);
        projector += vector * vector.transpose();
    }
    Some(projector)
}

fn share_in(space: &Square, lever: &[f64]) -> f64 {
    let (mut inside, mut whole) = (0.0, 0.0);
    for (i, a) in lever.iter().enumerate() {
        whole += a * a;
        for (j, b) in lever.iter().enumerate() {
            inside += a * b * space[(i, j)];
        }
    }
    inside / whole
}

fn best(rotors: usize, moments: &[Moments; 3], space: Option<&Square>, seconds: f64) -> Option<Wiring> {
    let mut found: Option<Wiring> = None;
    let mut second = f64::NEG_INFINITY;
    let mut tried = 0;
    for ring in rings(rotors) {
        let places = &ring.places;
        let mut order: Vec<usize> = (0..rotors).collect();
        permutations(&mut order, 0, &mut |order| {
            let lever =
                |value: &dyn Fn(&Place) -> f64| -> Vec<f64> { order.iter().map(|i| value(&places[*i])).collect() };
            let roll = lever(&|place| -place.position[1]);
            let pitch = lever(&|place| place.position[0]);
            let yaw = lever(&Place::yaw_sign);
            if let Some(space) = space
                && [&roll, &pitch, &yaw]
                    .iter()
                    .any(|lever| share_in(space, lever) < IN_SPACE)
            {
                return;
            }
            let turned: Vec<f64> = yaw.iter().map(|sign| -sign).collect();
            for (sense, yaw) in [(1.0, &yaw), (-1.0, &turned)] {
                if sense < 0.0 && !ring.has_a_mirror {
                    continue;
                }
                tried += 1;
                let correlation = [
                    moments[0].correlation(&roll),
                    moments[1].correlation(&pitch),
                    moments[2].correlation(yaw),
                ];
                let score = score(correlation);
                if found.as_ref().is_none_or(|best| score > best.score) {
                    second = found.as_ref().map_or(second, |best| best.score);
                    let places = order
                        .iter()
                        .map(|i| {
                            let mut place = places[*i];
                            if sense < 0.0 {
                                place.spin = opposite(place.spin);
                            }
                            place
                        })
                        .collect();
                    found = Some(Wiring {
                        layout: ring.layout,
                        places,
                        score,
                        margin: 0.0,
                        correlation,
                        tried: 0,
                        seconds,
                    });
                } else {
                    second = second.max(score);
                }
            }
        });
    }
    found.map(|best| Wiring {
        margin: if second.is_finite() { best.score - second } else { 0.0 },
        tried,
        ..best
    })
}

fn opposite(spin: rotortwin_plant::vehicle::model::SpinDirection) -> rotortwin_plant::vehicle::model::SpinDirection {
    use rotortwin_plant::vehicle::model::SpinDirection::{Ccw, Cw};
    if spin == Ccw { Cw } else { Ccw }
}

fn permutations(order: &mut Vec<usize>, from: usize, visit: &mut impl FnMut(&[usize])) {
    if from + 1 >= order.len() {
        visit(order);
        return;
    }
    for i in from..order.len() {
        order.swap(from, i);
        permutations(order, from + 1, visit);
        order.swap(from, i);
    }
}
