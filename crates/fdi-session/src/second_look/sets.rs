//! Explanations of a lost wrench and their probabilities: nothing, rotors that lost or gained thrust, alone, in pairs
//! and threes, a changed load, and something else.
//!
//! Each explanation predicts a normal distribution of wrenches with the covariance
//!
//! C = diag V + s² Σ_i F_i F_iᵀ (rotors)   + s_z² e_z e_zᵀ + s_m² (e_roll e_rollᵀ + e_pitch e_pitchᵀ) (load)   + s_y² e_yaw e_yawᵀ (a blade that drags)   + s² (e_roll e_rollᵀ + e_pitch e_pitchᵀ) (the centre of mass)   + s² 1 (something else)
//!
//! so p(û | explanation) has a closed form, an explanation with more rotors is penalised for its freedom automatically
//! (Occam), and two that predict the same wrench are as likely as their priors. Of two coaxial rotors each may be the
//! other one with a blade that drags, so there the drag of a blade is free in every explanation. Losses and gains are
//! one-sided: the density is weighted with the posterior probability of the signs. V contains the filter's variance and
//! the model error in proportion to the wrench ([`GAIN_ERROR`]).

use super::meter::AXES;
use rotortwin_flight_core::MAX_ROTORS;

/// Error of each axis' gain: mass, inertia, moment ratio, levers.
const GAIN_ERROR: f64 = 0.03;
/// Smallest error of a lost wrench, share of a rotor's thrust in hover.
const FLOOR: f64 = 0.003;
/// Prior sizes of losses and gains, share of a rotor's hover thrust.
const LOSS: f64 = 0.12;
const GAIN: f64 = 0.08;
/// A changed load, in the same unit times the number of rotors.
const LOAD: f64 = 0.1;
/// Position of a load off the centre of mass: standard deviation of its lever over that of the rotors.
const BESIDE: f64 = 0.1;
/// Change of a blade's drag, share of the rotor's torque.
const DRAG: f64 = 0.2;
/// Roll and pitch moment alone.
const SHIFT: f64 = 0.15;
/// Something else.
const OTHER: f64 = 0.1;
/// Rotors whose columns differ by less in roll and pitch, levers taken out, share an axis.
const SAME_AXIS: f64 = 1e-3;

/// ln of the odds against each kind, relative to one rotor that lost thrust.
const AGAINST_NOTHING: f64 = 0.0;
const AGAINST_DRAG: f64 = 1.5;
const AGAINST_GAIN: f64 = 2.6;
const AGAINST_PAIR: f64 = 3.0;
const AGAINST_THREE: f64 = 4.8;
const AGAINST_LOAD: f64 = 2.0;
const AGAINST_BESIDE: f64 = 3.0;
const AGAINST_SHIFT: f64 = 2.5;
const AGAINST_OTHER: f64 = 6.0;

/// An explanation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Nothing is lost.
    Nothing,
    /// These rotors lost thrust.
    Losses,
    /// One rotor lost thrust, and its blade's drag changed.
    LossWithDrag,
    /// One rotor gives more.
    Gain,
    /// A load was dropped or picked up.
    Load,
    /// Roll and pitch moment alone, as of a battery that slipped.
    Shift,
    /// None of these.
    Other,
}

/// An explanation with its probability.
#[derive(Clone, Copy, Debug)]
pub(super) struct Explanation {
    pub kind: Kind,
    /// Bit i: rotor i, from 0.
    pub rotors: u32,
    pub probability: f64,
}

type Matrix = [[f64; AXES]; AXES];

/// Evaluates all explanations of a wrench, likeliest first.
///
/// * `column`: of each rotor, levers taken out   * `value`, `variance`: of the lost wrench at hover, N and N²   * `hover`: thrust of a rotor, N
pub(super) fn weigh(
    column: &[[f64; AXES]; MAX_ROTORS],
    rotor_count: usize,
    value: &[f64; AXES],
    variance: &[f64; AXES],
    hover: f64,
) -> Vec<Explanation> {
    let mut base = [[0.0; AXES]; AXES];
    for axis in 0..AXES {
        base[axis][axis] = error(value[axis], variance[axis], hover);
    }
    let mut found = Vec::new();
    let mut add = |kind, rotors: u32, against: f64, parts: &[([f64; AXES], f64)], one_sided: usize| {
        let log = log_density(&base, value, parts, one_sided) - against;
        found.push((kind, rotors, log));
    };
    let loss = |rotor: usize| loss(&column[rotor], hover);
    let unit = |axis: usize, size: f64| unit(axis, size, hover);
    add(Kind::Nothing, 0, AGAINST_NOTHING, &[], 0);
    let beside = |axis: usize| unit(axis, BESIDE * value[0].abs() / hover);
    let load = [unit(0, LOAD * rotor_count as f64), beside(1), beside(2)];
    add(Kind::Load, 0, AGAINST_LOAD, &load[..1], 0);
    add(Kind::Load, 0, AGAINST_BESIDE, &load, 0);
    add(Kind::Shift, 0, AGAINST_SHIFT, &[unit(1, SHIFT), unit(2, SHIFT)], 0);
    let free: [_; AXES] = std::array::from_fn(|axis| unit(axis, OTHER));
    add(Kind::Other, 0, AGAINST_OTHER, &free, 0);
    let shared: [bool; MAX_ROTORS] = std::array::from_fn(|rotor| shares_its_axis(column, rotor));
    let parts = |rotors: &[usize]| -> Vec<Part> {
        let on_shared_axes = rotors.iter().filter(|rotor| shared[**rotor]);
        let drags = on_shared_axes.map(|rotor| drag(&column[*rotor], hover));
        rotors.iter().map(|rotor| loss(*rotor)).chain(drags).collect()
    };
    for i in 0..rotor_count {
        let with_drag = [loss(i), drag(&column[i], hover)];
        if shared[i] {
            add(Kind::LossWithDrag, 1 << i, 0.0, &with_drag, 2);
        } else {
            add(Kind::Losses, 1 << i, 0.0, &with_drag[..1], 1);
            add(Kind::LossWithDrag, 1 << i, AGAINST_DRAG, &with_drag, 2);
        }
        add(Kind::Gain, 1 << i, AGAINST_GAIN, &[gain(&column[i], hover)], 1);
        for j in 0..i {
            let two = parts(&[j, i]);
            add(Kind::Losses, 1 << i | 1 << j, AGAINST_PAIR, &two, two.len());
            for k in 0..j {
                let rotors = 1 << i | 1 << j | 1 << k;
                let three = parts(&[k, j, i]);
                add(Kind::Losses, rotors, AGAINST_THREE, &three, three.len());
            }
        }
    }
    let most = found.iter().fold(f64::NEG_INFINITY, |a, b| a.max(b.2));
    let sum: f64 = found.iter().map(|entry| (entry.2 - most).exp()).sum();
    let mut found: Vec<Explanation> = found
        .into_iter()
        .map(|(kind, rotors, log)| Explanation {
            kind,
            rotors,
            probability: (log - most).exp() / sum,
        })
        .collect();
    // At the centre or off it: one load.
    if let Some(second) = found.iter().rposition(|e| e.kind == Kind::Load)
        && let beside = found.remove(second)
        && let Some(load) = found.iter_mut().find(|e| e.kind == Kind::Load)
    {
        load.probability += beside.probability;
    }
    found.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    found
}

/// Another rotor is above or below this one: their columns differ in yaw alone.
pub(super) fn shares_its_axis(column: &[[f64; AXES]; MAX_ROTORS], rotor: usize) -> bool {
    let own = &column[rotor];
    let is_on_it = |other: &[f64; AXES]| (0..AXES - 1).all(|axis| (other[axis] - own[axis]).abs() < SAME_AXIS);
    column.iter().filter(|other| is_on_it(other)).count() > 1
}

/// A direction in the space of wrenches, and the standard deviation along it, N.
type Part = ([f64; AXES], f64);

fn loss(column: &[f64; AXES], hover: f64) -> Part {
    (column.map(|x| -x), LOSS * hover)
}

fn gain(column: &[f64; AXES], hover: f64) -> Part {
    (*column, GAIN * hover)
}

/// In units of [`DRAG`] times a thrust, N.
fn drag(column: &[f64; AXES], hover: f64) -> Part {
    let yaw = std::array::from_fn(|axis| if axis == AXES - 1 { DRAG * column[axis] } else { 0.0 });
    (yaw, hover)
}

fn unit(axis: usize, size: f64, hover: f64) -> Part {
    (std::array::from_fn(|a| if a == axis { size } else { 0.0 }), hover)
}

/// Sizes of the parts of an explanation if it is true: mean and variance of each.
///
/// With C as in the module, a part x_k along d_k has the mean s_k² d_kᵀ C⁻¹ û and the variance s_k² − s_k⁴ d_kᵀ C⁻¹
/// d_k; the caller has to account for losses and gains being one-sided when it forms an interval. One entry per rotor,
/// N of thrust lost (gained); followed, for [`Kind::LossWithDrag`], by the additional torque of the blade over that of
/// its thrust, N; for [`Kind::Load`], by the downward force, N.
///
/// * `column`, `value`, `variance`, `hover`: as in [`weigh`]
pub(super) fn sizes(
    explanation: &Explanation,
    column: &[[f64; AXES]; MAX_ROTORS],
    value: &[f64; AXES],
    variance: &[f64; AXES],
    hover: f64,
) -> Vec<[f64; 2]> {
    let rotors = || (0..MAX_ROTORS).filter(|rotor| explanation.rotors >> rotor & 1 == 1);
    let mut parts: Vec<Part> = match explanation.kind {
        Kind::Gain => rotors().map(|rotor| gain(&column[rotor], hover)).collect(),
        Kind::Losses | Kind::LossWithDrag => rotors().map(|rotor| loss(&column[rotor], hover)).collect(),
        // The maximum number of rotors: nothing else is known of its size.
        Kind::Load => {
            let beside = |axis: usize| unit(axis, BESIDE * value[0].abs() / hover, hover);
            vec![unit(0, LOAD * MAX_ROTORS as f64, hover), beside(1), beside(2)]
        }
        Kind::Nothing | Kind::Shift | Kind::Other => Vec::new(),
    };
    let with_drag = |rotor: &usize| match explanation.kind {
        Kind::LossWithDrag => true,
        Kind::Losses => shares_its_axis(column, *rotor),
        _ => false,
    };
    parts.extend(rotors().filter(with_drag).map(|rotor| drag(&column[rotor], hover)));
    let mut c = [[0.0; AXES]; AXES];
    for axis in 0..AXES {
        c[axis][axis] = error(value[axis], variance[axis], hover);
    }
    for (direction, size) in &parts {
        for a in 0..AXES {
            for b in 0..AXES {
                c[a][b] += size * size * direction[a] * direction[b];
            }
        }
    }
    let (inverse, _) = inverse(&c);
    let weighted = times(&inverse, value);
    let of = |(direction, size): &Part| {
        let square = size * size;
        let variance = square - square * square * dot(direction, &times(&inverse, direction));
        [square * dot(direction, &weighted), variance.max(0.0)]
    };
    let mut sizes: Vec<[f64; 2]> = parts.iter().map(of).collect();
    if explanation.kind == Kind::Losses {
        sizes.truncate(explanation.rotors.count_ones() as usize);
    }
    let unit = match explanation.kind {
        Kind::LossWithDrag => DRAG,
        Kind::Load => LOAD * MAX_ROTORS as f64,
        _ => return sizes,
    };
    if explanation.kind == Kind::Load {
        // Its moments are not a size that is reported.
        sizes.truncate(1);
    }
    if let Some([mean, variance]) = sizes.last_mut() {
        (*mean, *variance) = (*mean * unit, *variance * unit * unit);
    }
    sizes
}

/// χ² of a lost wrench if nothing is lost; arguments as above.
pub(super) fn chi_square(value: &[f64; AXES], variance: &[f64; AXES], hover: f64) -> f64 {
    (0..AXES)
        .map(|axis| value[axis].powi(2) / error(value[axis], variance[axis], hover))
        .sum()
}

/// V of an axis, N².
fn error(value: f64, variance: f64, hover: f64) -> f64 {
    variance + (GAIN_ERROR * value).powi(2) + (FLOOR * hover).powi(2)
}

/// ln p of a wrench that is the sum of `base` noise and of parts, each with a direction and a standard deviation, the
/// first of which are one-sided.
fn log_density(base: &Matrix, value: &[f64; AXES], parts: &[([f64; AXES], f64)], one_sided: usize) -> f64 {
    let mut c = *base;
    for (direction, size) in parts {
        for a in 0..AXES {
            for b in 0..AXES {
                c[a][b] += size * size * direction[a] * direction[b];
            }
        }
    }
    let (inverse, log_determinant) = inverse(&c);
    let weighted = times(&inverse, value);
    let mut log = -0.5 * (dot(value, &weighted) + log_determinant);
    for (direction, size) in &parts[..one_sided] {
        let square = size * size;
        let mean = square * dot(direction, &weighted);
        let variance = square - square * square * dot(direction, &times(&inverse, direction));
        log += (2.0 * normal_below(mean / variance.max(1e-12).sqrt())).max(1e-30).ln();
    }
    log
}

fn dot(a: &[f64; AXES], b: &[f64; AXES]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn times(m: &Matrix, v: &[f64; AXES]) -> [f64; AXES] {
    std::array::from_fn(|a| dot(&m[a], v))
}

/// Of a positive definite matrix, by Gauss–Jordan; and ln of its determinant.
fn inverse(m: &Matrix) -> (Matrix, f64) {
    let (mut left, mut right, mut log) = (*m, [[0.0; AXES]; AXES], 0.0);
    for a in 0..AXES {
        right[a][a] = 1.0;
    }
    for k in 0..AXES {
        let pivot = left[k][k].max(1e-300);
        log += pivot.ln();
        for j in 0..AXES {
            left[k][j] /= pivot;
            right[k][j] /= pivot;
        }
        for i in 0..AXES {
            let factor = if i == k { 0.0 } else { left[i][k] };
            for j in 0..AXES {
                left[i][j] -= factor * left[k][j];
                right[i][j] -= factor * right[k][j];
            }
        }
    }
    (right, log)
}

/// Φ, to 2e-7 (Abramowitz and Stegun 7.1.26 is 1.5e-7 of erf).
fn normal_below(x: f64) -> f64 {
    let z = x.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let poly =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let above = 0.5 * poly * (-z * z).exp();
    if x > 0.0 { 1.0 - above } else { above }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A regular hexarotor: spins alternate, so opposite rotors have opposite spins.
    fn hexarotor() -> [[f64; AXES]; MAX_ROTORS] {
        std::array::from_fn(|rotor| {
            if rotor >= 6 {
                return [0.0; AXES];
            }
            let (sin, cos) = (std::f64::consts::PI * (rotor as f64 + 0.5) / 3.0).sin_cos();
            let spin = if rotor % 2 == 0 { 1.0 } else { -1.0 };
            [-1.0, -sin, cos, spin]
        })
    }

    /// Pairs on four arms, each counter-rotating.
    fn coaxial() -> [[f64; AXES]; MAX_ROTORS] {
        std::array::from_fn(|rotor| {
            if rotor >= 8 {
                return [0.0; AXES];
            }
            let (sin, cos) = (std::f64::consts::FRAC_PI_2 * ((rotor / 2) as f64 + 0.5)).sin_cos();
            let spin = if rotor % 4 == 0 || rotor % 4 == 3 { 1.0 } else { -1.0 };
            [-1.0, -sin, cos, spin]
        })
    }

    /// A blade that drags by twice its loss turns the vehicle like a loss of the rotor above or below it: neither
    /// excludes the other.
    #[test]
    fn val_of_two_rotors_on_one_axis_neither_is_named_before_its_loss_is_larger_than_drags_are() {
        let column = coaxial();
        assert!((0..8).all(|rotor| shares_its_axis(&column, rotor)) && !shares_its_axis(&hexarotor(), 0));
        let weighed = |lost: f64, drag: f64| {
            let mut value: [f64; AXES] = std::array::from_fn(|axis| -column[0][axis] * lost);
            value[AXES - 1] += column[0][AXES - 1] * drag;
            weigh(&column, 8, &value, &[1e-6; AXES], 1.0)
        };
        let told = |found: &[Explanation]| {
            [1, 2].map(|rotors| {
                let same = found.iter().filter(|e| e.rotors == rotors && e.kind != Kind::Gain);
                same.map(|e| e.probability).sum::<f64>()
            })
        };
        for (lost, drag) in [(0.05, 0.0), (0.1, 0.0), (0.05, 0.1), (0.1, 0.2), (0.15, 0.15)] {
            let [own, other] = told(&weighed(lost, drag));
            assert!(own.max(other) < 0.8 && own > 0.1, "{lost}, {drag}: {own}, {other}");
            assert!(own + other > 0.8, "{lost}, {drag}: {own}, {other}");
        }
        let [own, other] = told(&weighed(0.3, 0.0));
        assert!(own > 5.0 * other, "{own}, {other}");
    }

    /// What losses (negative: gains) of rotors make, weighed with a standard deviation of each axis.
    fn weighed(losses: &[(usize, f64)], deviation: [f64; AXES]) -> Vec<Explanation> {
        let column = hexarotor();
        let value = std::array::from_fn(|axis| losses.iter().map(|(rotor, loss)| -column[*rotor][axis] * loss).sum());
        weigh(&column, 6, &value, &deviation.map(|x| x * x), 1.0)
    }

    fn of(found: &[Explanation], kind: Kind, rotors: u32) -> f64 {
        let is = |e: &&Explanation| e.kind == kind && e.rotors == rotors;
        found.iter().filter(is).map(|e| e.probability).sum()
    }

    #[test]
    fn val_a_density_is_the_textbooks() {
        // One axis with noise 1 and a part of size 2 along it: N(0, 5); the other axes N(0, 1).
        let base: Matrix = std::array::from_fn(|a| std::array::from_fn(|b| f64::from(u8::from(a == b))));
        let log = log_density(&base, &[3.0, 0.0, 0.0, 0.0], &[([1.0, 0.0, 0.0, 0.0], 2.0)], 0);
        assert!((log + 0.5 * (9.0 / 5.0 + 5.0f64.ln())).abs() < 1e-9, "{log}");
        // One-sided: the size is N(4/5 · 3, 4/5) after it, positive with Φ(2.4/√0.8) = 0.99635.
        let one_sided = log_density(&base, &[3.0, 0.0, 0.0, 0.0], &[([1.0, 0.0, 0.0, 0.0], 2.0)], 1);
        assert!(
            (one_sided - log - (2.0 * 0.996_35f64).ln()).abs() < 1e-4,
            "{one_sided} {log}"
        );
        assert!((normal_below(1.959_964) - 0.975).abs() < 1e-6 && (normal_below(-1.0) - 0.158_655).abs() < 1e-6);
    }

    #[test]
    fn val_a_loss_is_named_and_a_gain_is_not_the_opposite_rotors_loss() {
        let known = [0.004; AXES];
        let found = weighed(&[(1, 0.1)], known);
        assert!(
            of(&found, Kind::Losses, 1 << 1) + of(&found, Kind::LossWithDrag, 1 << 1) > 0.95,
            "{:?}",
            &found[..3]
        );
        let found = weighed(&[(1, -0.08)], known);
        assert!(of(&found, Kind::Gain, 1 << 1) > 0.9, "{:?}", &found[..3]);
        // Where gusts hide the vertical force, both remain, and neither is sure.
        let found = weighed(&[(1, -0.08)], [0.5, 0.004, 0.004, 0.004]);
        let [opposite, gain] = [of(&found, Kind::Losses, 1 << 4), of(&found, Kind::Gain, 1 << 1)];
        assert!(opposite < 0.95 && gain > LEAST_LISTED, "{:?}", &found[..4]);
    }

    /// As listed by the second look.
    const LEAST_LISTED: f64 = 0.02;

    #[test]
    fn val_nothing_is_nothing_and_a_centred_force_is_a_load() {
        let found = weighed(&[], [0.002; AXES]);
        assert_eq!((found[0].kind, found[0].probability > 0.8), (Kind::Nothing, true));
        // Upwards: no loss makes it.
        let all: Vec<(usize, f64)> = (0..6).map(|rotor| (rotor, -0.1)).collect();
        let found = weighed(&all, [0.004; AXES]);
        assert_eq!(
            (found[0].kind, found[0].probability > 0.9),
            (Kind::Load, true),
            "{:?}",
            &found[..3]
        );
    }

    #[test]
    fn val_a_blade_that_drags_is_not_two_healthy_neighbours() {
        let column = hexarotor();
        let mut value: [f64; AXES] = std::array::from_fn(|axis| -column[2][axis] * 0.08);
        value[3] += column[2][3] * 0.2;
        let found = weigh(&column, 6, &value, &[1.6e-5; AXES], 1.0);
        let neighbours = of(&found, Kind::Losses, 0b1010);
        assert!(
            of(&found, Kind::LossWithDrag, 1 << 2) > 0.5 && neighbours < 0.45,
            "{:?}",
            &found[..4]
        );
    }

    /// Sizes of the explanation of a wrench caused by some losses, plus `more` on the axes, with an error of 0.4 % of a
    /// thrust.
    fn sized(kind: Kind, rotors: u32, losses: &[(usize, f64)], more: [f64; AXES]) -> Vec<[f64; 2]> {
        let column = hexarotor();
        let value = std::array::from_fn(|axis| {
            more[axis]
                - losses
                    .iter()
                    .map(|(rotor, loss)| column[*rotor][axis] * loss)
                    .sum::<f64>()
        });
        let explanation = Explanation {
            kind,
            rotors,
            probability: 1.0,
        };
        sizes(&explanation, &column, &value, &[1.6e-5; AXES], 1.0)
    }

    #[test]
    fn val_sizes_are_those_that_made_the_wrench() {
        let is = |[mean, variance]: [f64; 2], truth: f64| {
            assert!(
                (mean - truth).abs() < 1.96 * variance.sqrt(),
                "{mean} ± {}, {truth}",
                variance.sqrt()
            );
            assert!(variance.sqrt() < 0.02, "{}", variance.sqrt());
        };
        is(sized(Kind::Losses, 1 << 1, &[(1, 0.1)], [0.0; AXES])[0], 0.1);
        is(sized(Kind::Gain, 1 << 1, &[(1, -0.08)], [0.0; AXES])[0], 0.08);
        let pair = sized(Kind::Losses, 1 << 1 | 1 << 2, &[(1, 0.1), (2, 0.06)], [0.0; AXES]);
        is(pair[0], 0.1);
        is(pair[1], 0.06);
        // A blade with extra drag: torque of 20 % of the thrust's in addition to a loss of 8 %.
        let yaw = hexarotor()[2][3] * 0.2;
        let dragging = sized(Kind::LossWithDrag, 1 << 2, &[(2, 0.08)], [0.0, 0.0, 0.0, yaw]);
        is(dragging[0], 0.08);
        is(dragging[1], 0.2);
        is(sized(Kind::Load, 0, &[], [-0.6, 0.0, 0.0, 0.0])[0], -0.6);
    }

    #[test]
    fn prop_probabilities_sum_to_one_likeliest_first() {
        for k in 0..200 {
            let x = |place: usize| (f64::from(k * 7 + 13) * (place as f64 + 1.7)).sin();
            let value = std::array::from_fn(|axis| 0.1 * x(axis));
            let variance = std::array::from_fn(|axis| (1e-3 + 0.02 * x(axis + 4).abs()).powi(2));
            let found = weigh(&hexarotor(), 6, &value, &variance, 1.0);
            let sum: f64 = found.iter().map(|e| e.probability).sum();
            assert!((sum - 1.0).abs() < 1e-9 && found.is_sorted_by(|a, b| a.probability >= b.probability));
        }
    }
}
