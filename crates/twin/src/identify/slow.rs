//! Slow quantities: drag, the voltage law, the battery.

use super::class;
use super::curve::Curve;
use super::filters::Band;
use super::grid::{GRAVITY, Grid, mean_deviation};
use crate::Z95;
use crate::model::constants::Source;

/// What a log reveals about the drag over the mass, 1/s.
pub(crate) enum Drag {
    /// Value and deviation.
    Measured(f64, f64),
    /// The same if it explains little of the force along the body, and the reason in words: an upper bound of the drag.
    Weak(f64, f64, String),
    /// Why it could not be determined.
    Untold(String),
}

/// Fewest parts of a flight whose scatter bounds the drag.
const FEWEST_PARTS: usize = 6;

/// The velocity at row `k` in body axes, m/s; NED, and roll, pitch, yaw.
fn in_body_axes(velocity: &[Vec<f64>; 3], attitude: &[Vec<f64>; 3], k: usize) -> [f64; 3] {
    let [roll, pitch, yaw] = [attitude[0][k], attitude[1][k], attitude[2][k]];
    let v = [velocity[0][k], velocity[1][k], velocity[2][k]];
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    [
        cp * cy * v[0] + cp * sy * v[1] - sp * v[2],
        (sr * sp * cy - cr * sy) * v[0] + (sr * sp * sy + cr * cy) * v[1] + sr * cp * v[2],
        (cr * sp * cy + sr * sy) * v[0] + (cr * sp * sy - sr * cy) * v[1] + cr * cp * v[2],
    ]
}

/// k/m from force along the body over speed, below 1 Hz.
pub(crate) fn drag(grids: &[Grid]) -> Drag {
    const FASTEST_HZ: f64 = 1.0;
    let mut fits = Vec::new();
    let mut reason = String::new();
    for grid in grids {
        let ([Some(ax), Some(ay), _], Some(velocity), Some(attitude)) = (&grid.accel, &grid.velocity, &grid.attitude)
        else {
            let lacking = [
                (grid.accel[0].is_none() || grid.accel[1].is_none(), "accelerometer"),
                (grid.velocity.is_none(), "velocity"),
                (grid.attitude.is_none(), "attitude"),
            ];
            let names: Vec<&str> = lacking
                .iter()
                .filter(|(lacks, _)| *lacks)
                .map(|(_, name)| *name)
                .collect();
            reason = format!("no {} in the log", names.join(" and no "));
            continue;
        };
        let low = Band {
            low_hz: 0.0,
            high_hz: FASTEST_HZ,
        };
        for axis in 0..2 {
            let accel = if axis == 0 { ax } else { ay };
            let mut parts: Vec<[f64; 5]> = Vec::new();
            for part in grid.pieces(6.0) {
                let v: Vec<f64> = part
                    .clone()
                    .map(|k| in_body_axes(velocity, attitude, k)[axis])
                    .collect();
                let a = &accel[part.clone()];
                if v.iter().chain(a).any(|x| !x.is_finite()) {
                    continue;
                }
                let (v, a) = (low.pass(&v, grid.step_s), low.pass(a, grid.step_s));
                let n = v.len() as f64;
                parts.push([
                    n,
                    v.iter().sum(),
                    a.iter().sum(),
                    v.iter().map(|x| x * x).sum(),
                    v.iter().zip(&a).map(|(x, y)| x * y).sum(),
                ]);
                parts.last_mut().expect("just pushed")[0] = n;
                fits.push((axis, grid.name.clone(), v, a));
            }
        }
    }
    if fits.is_empty() {
        return Drag::Untold(reason);
    }
    // Both axes share k; each has its own offset.
    let (mut kept, mut weak) = (Vec::new(), Vec::new());
    // The reason comes from the axis with the faster motion.
    let mut fastest = 0.0;
    for axis in 0..2 {
        let of = || fits.iter().filter(move |(a, ..)| *a == axis);
        let (mean_v, speed) = mean_deviation(of().flat_map(|(_, _, v, _)| v.iter().copied()));
        let (mean_a, force) = mean_deviation(of().flat_map(|(_, _, _, a)| a.iter().copied()));
        let slower = speed < fastest;
        fastest = speed.max(fastest);
        if (speed.is_nan() || speed < 1.0) && slower {
            continue;
        }
        if speed.is_nan() || speed < 1.0 {
            reason = format!("the speed along the body varies by {speed:.2} m/s; 1 m/s is needed");
            continue;
        }
        let sums: Vec<(f64, f64)> = of()
            .map(|(_, _, v, a)| {
                v.iter().zip(a).fold((0.0, 0.0), |(xx, xy), (v, a)| {
                    (xx + (v - mean_v).powi(2), xy + (v - mean_v) * (a - mean_a))
                })
            })
            .collect();
        let (xx, xy) = sums.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        let k = -xy / xx;
        let count: usize = of().map(|(_, _, v, _)| v.len()).sum();
        // A force in the direction of motion is not a drag.
        let explained = if k > 0.0 {
            k * k * xx / (count as f64 * force * force)
        } else {
            0.0
        };
        let n = sums.len() as f64;
        let meat: f64 = sums.iter().map(|(pxx, pxy)| (pxy + k * pxx).powi(2)).sum();
        let deviation = (meat * n / (n - 1.0).max(1.0)).sqrt() / xx;
        if explained < 0.6 {
            reason = format!(
                "drag explains {:.0} % of the force along the body; 60 % are needed",
                100.0 * explained
            );
            if sums.len() >= FEWEST_PARTS {
                weak.push((k, deviation));
            }
            continue;
        }
        kept.push((k, deviation));
    }
    match (joined(&kept), joined(&weak)) {
        (Some((k, deviation)), _) => Drag::Measured(k, deviation),
        (None, Some((k, deviation))) => Drag::Weak(k, deviation, reason),
        (None, None) => Drag::Untold(reason),
    }
}

/// k/m along the rotors' axis, 1/s, and its deviation: the deficit of the lift against the thrust curve as the vehicle
/// climbs, below 1 Hz. None if it hardly climbs. It includes the inflow of a climb, which reduces thrust in the same
/// way.
pub(crate) fn drag_in_climbs(grids: &[Grid], curve: &Curve) -> Option<(f64, f64)> {
    const SLOWEST_M_S: f64 = 0.3;
    let low = Band {
        low_hz: 0.0,
        high_hz: 1.0,
    };
    // By piece: each has its own offset, because the level of the thrust drifts slowly. In addition to the speed, the
    // commanded lift is a regressor: otherwise a small error in the slope of the curve would be taken for drag, as a
    // climb commands more. Sums of u², u·l, l², u·m, l·m.
    let mut sums: Vec<[f64; 5]> = Vec::new();
    let mut count = 0.0;
    for grid in grids {
        let (Some(lift), Some(velocity), Some(attitude)) = (grid.lift(), &grid.velocity, &grid.attitude) else {
            return None;
        };
        for piece in grid.pieces(6.0) {
            let up = |k: usize| -in_body_axes(velocity, attitude, k)[2];
            let commanded = |k: usize| {
                let voltage = grid
                    .voltage
                    .as_ref()
                    .map_or(1.0, |volts| curve.voltage_factor(volts[k]));
                let sum: f64 = grid.duty.iter().map(|duty| curve.shape(duty[k])).sum();
                curve.hover * voltage * sum
            };
            let mut columns = [
                piece.clone().map(up).collect::<Vec<f64>>(),
                piece.clone().map(commanded).collect(),
                piece.clone().map(|k| lift[k] - commanded(k)).collect(),
            ];
            if columns.iter().flatten().any(|x| !x.is_finite()) {
                continue;
            }
            for column in &mut columns {
                *column = low.pass(column, grid.step_s);
                let mean = column.iter().sum::<f64>() / column.len() as f64;
                column.iter_mut().for_each(|x| *x -= mean);
            }
            let [u, l, m] = &columns;
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            sums.push([dot(u, u), dot(u, l), dot(l, l), dot(u, m), dot(l, m)]);
            count += u.len() as f64;
        }
    }
    let [uu, ul, ll, um, lm] = sums
        .iter()
        .fold([0.0; 5], |all, piece| core::array::from_fn(|i| all[i] + piece[i]));
    if sums.len() < FEWEST_PARTS || (uu / count).sqrt() < SLOWEST_M_S {
        return None;
    }
    // The part of the speed that is not explained by the commanded lift.
    let share = ul / ll.max(f64::MIN_POSITIVE);
    let own = uu - share * ul;
    if own < 0.1 * uu {
        return None;
    }
    let k = -(um - share * lm) / own;
    let slope = (lm + k * ul) / ll.max(f64::MIN_POSITIVE);
    let n = sums.len() as f64;
    let meat: f64 = sums
        .iter()
        .map(|[uu, ul, ll, um, lm]| (um - share * lm + k * (uu - share * ul) - slope * (ul - share * ll)).powi(2))
        .sum();
    Some((k, (meat * n / (n - 1.0)).sqrt() / own))
}

/// Weighted mean of values with deviations, and its deviation: no less than the distance between them.
fn joined(values: &[(f64, f64)]) -> Option<(f64, f64)> {
    if values.is_empty() {
        return None;
    }
    let weight: f64 = values.iter().map(|(_, d)| 1.0 / (d * d)).sum();
    let mean = values.iter().map(|(x, d)| x / (d * d)).sum::<f64>() / weight;
    let apart = values.iter().map(|(x, _)| (x - mean).abs()).fold(0.0, f64::max);
    Some((mean, (1.0 / weight).sqrt().max(apart)))
}

/// ln of measured over modelled lift at the mean voltage, by blocks: the rows of the block, and that.
fn levels(grid: &Grid, curve: &Curve, block_s: f64) -> Vec<(std::ops::Range<usize>, f64)> {
    let Some(lift) = grid.lift() else { return Vec::new() };
    let flat = Curve {
        voltage_slope: 0.0,
        ..*curve
    };
    let blocks = grid.pieces(block_s).into_iter().map(|block| {
        let mean = |value: &dyn Fn(usize) -> f64| mean_deviation(block.clone().map(value)).0;
        let model = mean(&|k| flat.hover * grid.duty.iter().map(|d| flat.shape(d[k])).sum::<f64>());
        let level = (mean(&|k| lift[k]) / model).ln();
        (block, level)
    });
    blocks.filter(|(_, level)| level.is_finite()).collect()
}

/// Flights passed together that are not of one vehicle, or not with the same propellers or load: at the same duty and
/// voltage one has much more thrust over its mass than another.
pub(crate) fn unlike(grids: &[Grid], curve: &Curve) -> Option<String> {
    const BLOCK_S: f64 = 2.0;
    /// Logarithm: differences between pilots, temperatures and batteries are smaller.
    const UNLIKE: f64 = 0.15;
    let mean_level = |grid: &Grid| {
        let logs = levels(grid, curve, BLOCK_S).into_iter().map(|(rows, level)| {
            let volts = grid
                .voltage
                .as_ref()
                .map(|voltage| mean_deviation(voltage[rows].iter().copied()).0);
            level - volts.map_or(0.0, |volts| curve.voltage_factor(volts).ln())
        });
        mean_deviation(logs.filter(|level| level.is_finite())).0
    };
    let means: Vec<(&str, f64)> = grids
        .iter()
        .map(|grid| (grid.name.as_str(), mean_level(grid)))
        .filter(|(_, level)| level.is_finite())
        .collect();
    let least = means.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let most = means.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (most.1 - least.1 > UNLIKE).then(|| {
        format!(
            "at the same duty and voltage {} has {:.0} % more thrust over its mass than {}: another vehicle, other propellers or another load? One vehicle \
             is fitted to both",
            most.0,
            100.0 * ((most.1 - least.1).exp() - 1.0),
            least.0
        )
    })
}

/// Decline of the thrust over time if no voltage was logged: most likely a supply that empties.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fall {
    /// −d ln T/dt, 1/s.
    pub(crate) per_s: f64,
    pub(crate) deviation: f64,
    /// Time on the grid at which the thrust equals that of the curve, s: one log only.
    pub(crate) from_s: f64,
}

impl Fall {
    /// Factor on the thrust of the curve at a row.
    pub(crate) fn factor(&self, grid: &Grid, row: usize) -> f64 {
        (-self.per_s * (row as f64 * grid.step_s - self.from_s)).exp()
    }
}

/// Level and slope of points by least squares, about their mean time.
fn line(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let (mean_t, _) = mean_deviation(points.iter().map(|p| p.0));
    let (mean_y, _) = mean_deviation(points.iter().map(|p| p.1));
    let tt: f64 = points.iter().map(|p| (p.0 - mean_t).powi(2)).sum();
    let slope = points.iter().map(|p| (p.0 - mean_t) * (p.1 - mean_y)).sum::<f64>() / tt;
    (mean_t, mean_y, slope)
}

/// The decline of the thrust of one log without a voltage; `None` if there is none: it must be three deviations from 0,
/// and what one half of the flight gives must predict the other half better than a constant level does, both ways.
pub(crate) fn fall(grid: &Grid, curve: &Curve) -> Option<Fall> {
    const BLOCK_S: f64 = 1.0;
    const FEWEST: usize = 8;
    const CERTAIN: f64 = 3.0;
    if grid.voltage.is_some() {
        return None;
    }
    let blocks = levels(grid, curve, BLOCK_S);
    let points: Vec<(f64, f64)> = blocks
        .iter()
        .map(|(block, level)| (0.5 * (block.start + block.end) as f64 * grid.step_s, *level))
        .collect();
    if points.len() < FEWEST {
        return None;
    }
    let (mean_t, mean_y, slope) = line(&points);
    let errors: Vec<f64> = points.iter().map(|(t, y)| y - mean_y - slope * (t - mean_t)).collect();
    let rho = super::observer::neighbour_correlation(&errors).clamp(0.0, 0.9);
    let variance = errors.iter().map(|e| e * e).sum::<f64>() / (points.len() as f64 - 2.0);
    let tt: f64 = points.iter().map(|p| (p.0 - mean_t).powi(2)).sum();
    let deviation = (variance / tt * (1.0 + rho) / (1.0 - rho)).sqrt();
    let (first, second) = points.split_at(points.len() / 2);
    let proves = |learn: &[(f64, f64)], proof: &[(f64, f64)]| {
        let (t, y, k) = line(learn);
        let square = |of: &dyn Fn(f64) -> f64| proof.iter().map(|(at, level)| (level - of(*at)).powi(2)).sum::<f64>();
        square(&|at| y + k * (at - t)) < square(&|_| y)
    };
    let shows = -slope > CERTAIN * deviation && proves(first, second) && proves(second, first);
    shows.then_some(Fall {
        per_s: -slope,
        deviation,
        from_s: mean_t,
    })
}

/// s = d ln T/d ln V, with deviation, including the class default, and the source that dominates.
pub(crate) fn voltage_slope(grids: &[Grid], curve: &Curve) -> (f64, f64, Source) {
    const BLOCK_S: f64 = 2.0;
    let default = (class::VOLTAGE_SLOPE, class::VOLTAGE_SLOPE_DEVIATION, Source::Class);
    let mut points: Vec<(f64, f64)> = Vec::new();
    for grid in grids {
        let Some(voltage) = &grid.voltage else { continue };
        for (block, level) in levels(grid, curve, BLOCK_S) {
            let volts = mean_deviation(block.map(|k| voltage[k])).0.ln();
            if volts.is_finite() {
                points.push((volts, level));
            }
        }
    }
    if points.len() < 6 {
        return default;
    }
    let (mean_x, deviation_x) = mean_deviation(points.iter().map(|p| p.0));
    if deviation_x < 0.005 {
        return default;
    }
    let mean_y = mean_deviation(points.iter().map(|p| p.1)).0;
    let xx: f64 = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
    let s = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum::<f64>() / xx;
    let errors: Vec<f64> = points.iter().map(|p| p.1 - mean_y - s * (p.0 - mean_x)).collect();
    let rho = super::observer::neighbour_correlation(&errors).clamp(0.0, 0.9);
    let variance = errors.iter().map(|e| e * e).sum::<f64>() / (points.len() as f64 - 2.0);
    // Neighbours are correlated: fewer independent points. And voltage varies with time, as any other drift does.
    let deviation = (variance / xx * (1.0 + rho) / (1.0 - rho)).sqrt().hypot(0.1);
    let prior = class::VOLTAGE_SLOPE_DEVIATION;
    if deviation_x > ENOUGH_DISCHARGE
        && s.abs() < Z95 * deviation.min(NO_SLOPE_DEVIATION)
        && s + Z95 * deviation < class::VOLTAGE_SLOPE - prior
    {
        // No contribution of the class: speeds are controlled, or the autopilot compensates for the battery.
        return (s, deviation, Source::Log);
    }
    // Outside the range of motors, some other drift is included, and neither of the two is trusted alone.
    let beyond = (s - class::VOLTAGE_SLOPE).abs();
    let deviation = if beyond > 2.0 * prior {
        deviation.max(0.5 * beyond)
    } else {
        deviation
    };
    let (a, b) = (1.0 / (deviation * deviation), 1.0 / (prior * prior));
    let combined = (a * s + b * class::VOLTAGE_SLOPE) / (a + b);
    let source = match a / b {
        share if share > LOG_DECIDES => Source::Log,
        share if share > LOG_COUNTS => Source::LogAndClass,
        _ => Source::Class,
    };
    (combined, (1.0 / (a + b)).sqrt(), source)
}

/// Deviation of ln V from which a flight may show that the thrust does not follow the voltage at all.
const ENOUGH_DISCHARGE: f64 = 0.02;
/// Deviation of s about 0 if a governor or the autopilot keeps the thrust constant.
const NO_SLOPE_DEVIATION: f64 = 0.15;

/// Information of the log over that of the class from which the log alone decides.
const LOG_DECIDES: f64 = 3.0;
const LOG_COUNTS: f64 = 0.05;

/// What the log reveals about the battery.
#[derive(Debug, Clone, Default)]
pub(crate) struct Battery {
    pub(crate) cells: Option<u32>,
    /// Ω, with deviation.
    pub(crate) resistance: Option<(f64, f64)>,
    /// Electrical power in the air over Σ T^1.5, with relative deviation; W/(m/s²)^1.5 of thrust over mass.
    pub(crate) power: Option<(f64, f64)>,
    /// Highest voltage at rest or at the start, means over a second, V.
    pub(crate) start_v: Option<f64>,
}

pub(crate) fn battery(grids: &[Grid], curve: &Curve) -> Battery {
    let mut found = Battery::default();
    let (mut resistances, mut powers) = (Vec::new(), Vec::new());
    for grid in grids {
        let Some(voltage) = &grid.voltage else { continue };
        let rest = grid
            .airborne
            .first()
            .map_or(grid.rows, |part| part.start)
            .min(grid.rows);
        // For a log that begins in the air, the highest of the whole flight: no cell has more when it is charged.
        let first = if rest < grid.rows_of(1.0) { grid.rows } else { rest };
        // Means over a second: braking motors push the voltage up for a moment.
        let start = voltage[..first]
            .chunks(grid.rows_of(1.0))
            .map(|second| mean_deviation(second.iter().copied().filter(|v| v.is_finite())).0)
            .filter(|mean| mean.is_finite())
            .fold(0.0, f64::max);
        if start > 2.0 {
            found.start_v = Some(found.start_v.map_or(start, |v: f64| v.max(start)));
        }
        let Some(current) = &grid.current else { continue };
        // Medians over a second suppress the smear of the sensor's delay.
        let block = grid.rows_of(1.0);
        let mut rows: Vec<[f64; 3]> = Vec::new();
        let mut charge = 0.0;
        for start in (0..grid.rows.saturating_sub(block)).step_by(block) {
            let (v, _) = mean_deviation(voltage[start..start + block].iter().copied());
            let (i, spread) = mean_deviation(current[start..start + block].iter().copied());
            if v.is_finite() && i.is_finite() {
                charge += i * block as f64 * grid.step_s / 3600.0;
                if spread < 0.3 * i.abs() + 0.5 {
                    rows.push([v, i, charge]);
                }
            }
        }
        resistances.extend(resistance(&rows));
        let (mut power, mut ideal, mut parts) = (0.0, 0.0, Vec::new());
        for part in grid.pieces(4.0) {
            let p: f64 = part.clone().map(|k| voltage[k] * current[k]).sum();
            let q: f64 = part
                .clone()
                .map(|k| {
                    let factor = curve.voltage_factor(voltage[k]);
                    grid.duty
                        .iter()
                        .map(|d| (curve.hover * curve.shape(d[k]) * factor).powf(1.5))
                        .sum::<f64>()
                })
                .sum();
            if p.is_finite() && p > 0.0 {
                power += p;
                ideal += q;
                parts.push(p / q);
            }
        }
        if parts.len() >= 3 {
            let (mean, deviation) = mean_deviation(parts.iter().copied());
            let value = power / ideal;
            powers.push((value, value * (deviation / mean).hypot(POWER_SCALE)));
        }
    }
    found.resistance = pooled(&resistances, CURRENT_SCALE);
    found.power = pooled(&powers, POWER_SCALE).map(|(value, deviation)| (value, deviation / value));
    found.cells = found.start_v.and_then(cells);
    found
}

/// A value of several flights and its deviation, by the inverse variances; wider by the flights' own spread where that is more than their
/// deviations (the scale factor of the Particle Data Group), and never below the error that all share, `common` of the value.
fn pooled(flights: &[(f64, f64)], common: f64) -> Option<(f64, f64)> {
    if let [] | [_] = flights {
        return flights.first().copied();
    }
    let weight: f64 = flights.iter().map(|(_, deviation)| deviation.powi(-2)).sum();
    let mean = flights
        .iter()
        .map(|(value, deviation)| value / deviation.powi(2))
        .sum::<f64>()
        / weight;
    let chi2: f64 = flights
        .iter()
        .map(|(value, deviation)| ((value - mean) / deviation).powi(2))
        .sum();
    let scale = (chi2 / (flights.len() as f64 - 1.0)).max(1.0).sqrt();
    Some((mean, (scale / weight.sqrt()).max(common * mean)))
}

/// Cells in series: the only number whose cell voltage at the start is that of a charged or storage LiPo.
fn cells(start_v: f64) -> Option<u32> {
    let fits: Vec<u32> = (1..=14)
        .filter(|cells| (3.75..=4.25).contains(&(start_v / f64::from(*cells))))
        .collect();
    match fits.as_slice() {
        [one] => Some(*one),
        // A full pack of fewer cells is commoner than a half-empty one of more.
        [first, ..] => Some(*first),
        // A cell that is charged to more than usual, or nearly empty; none has more than 4.35 V.
        [] => (1..=14).find(|cells| (3.2..=4.36).contains(&(start_v / f64::from(*cells)))),
    }
}

/// Deviation of a current sensor's scale: what remains after a power module's own calibration. The resistance is wrong
/// by the same factor, and no residual of the fit below reveals it, nor that noise of the current flattens the slope.
const CURRENT_SCALE: f64 = 0.02;

/// Error of the electrical power that flights of one vehicle share, relative.
const POWER_SCALE: f64 = 0.03;

/// R of V = V0 − R I − k Q, where the current varies; Ω with its deviation.
fn resistance(rows: &[[f64; 3]]) -> Option<(f64, f64)> {
    use nalgebra::{Matrix3, Vector3};
    if rows.len() < 20 {
        return None;
    }
    let (_, spread) = mean_deviation(rows.iter().map(|r| r[1]));
    let (mean, _) = mean_deviation(rows.iter().map(|r| r[1]));
    if spread < 0.05 * mean {
        return None;
    }
    let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
    for [v, i, q] in rows {
        let x = Vector3::new(1.0, -i, -q);
        h += x * x.transpose();
        g += x * *v;
    }
    let inverse = h.try_inverse()?;
    let theta = inverse * g;
    let errors: Vec<f64> = rows
        .iter()
        .map(|[v, i, q]| v - theta[0] + theta[1] * i + theta[2] * q)
        .collect();
    let rho = super::observer::neighbour_correlation(&errors).clamp(0.0, 0.9);
    let variance = errors.iter().map(|e| e * e).sum::<f64>() / (rows.len() as f64 - 3.0);
    let deviation = (inverse[(1, 1)] * variance * (1.0 + rho) / (1.0 - rho)).sqrt();
    (theta[1] > 2.0 * deviation && theta[1] < 1.0).then_some((theta[1], deviation.hypot(CURRENT_SCALE * theta[1])))
}

/// Open-circuit voltage of a LiPo cell at 0 %, 5 % … 100 % charge, V: a common chart.
pub(crate) const CELL_CHART: [f64; 21] = [
    3.27, 3.61, 3.69, 3.71, 3.73, 3.75, 3.77, 3.79, 3.80, 3.82, 3.84, 3.85, 3.87, 3.91, 3.95, 3.98, 4.02, 4.08, 4.11,
    4.15, 4.20,
];

/// Lift over the vehicle's mass in level flight differs from g by this factor if the accelerometer is wrong.
pub(crate) fn level_over_gravity(curve: &Curve, rotors: usize) -> f64 {
    curve.hover * rotors as f64 / GRAVITY
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_no_cell_has_more_than_a_charged_one() {
        // "3 cells (log)" of a pack of four at the end of a flight, 13.45 V.
        for (volts, expected) in [
            (13.45, 4),
            (12.6, 3),
            (16.6, 4),
            (11.1, 3),
            (3.7, 1),
            (25.0, 6),
            (13.05, 3),
        ] {
            assert_eq!(cells(volts), Some(expected), "{volts} V");
        }
    }

    /// The last flight alone was taken: the order of the logs changed the vehicle by 44 %.
    #[test]
    fn regress_flights_are_pooled_in_any_order_and_their_spread_counts() {
        assert_eq!(pooled(&[], 0.02), None);
        assert_eq!(pooled(&[(0.03, 0.001)], 0.02), Some((0.03, 0.001)));
        let (value, deviation) = pooled(&[(0.031, 0.001), (0.040, 0.001)], 0.02).unwrap();
        let (turned, _) = pooled(&[(0.040, 0.001), (0.031, 0.001)], 0.02).unwrap();
        assert!((value - 0.0355).abs() < 1e-9 && (value - turned).abs() < 1e-12);
        assert!(
            (value - 1.96 * deviation) < 0.031 && 0.040 < value + 1.96 * deviation,
            "{deviation}"
        );
        let (_, alike) = pooled(&[(0.03, 0.001), (0.03, 0.001), (0.03, 0.001)], 0.02).unwrap();
        assert!(
            (alike - 0.0006).abs() < 1e-9,
            "{alike}: not below the scale of the sensor"
        );
    }

    #[test]
    fn val_the_scale_of_the_current_sensor_is_within_the_interval_of_the_resistance() {
        let truth = 0.010;
        for scale in [0.97, 1.0, 1.03] {
            let mut charge = 0.0;
            let rows: Vec<[f64; 3]> = (0..80)
                .map(|second| {
                    let current = 20.0 + 8.0 * (0.3 * f64::from(second)).sin();
                    charge += current / 3600.0;
                    [16.4 - truth * current - 0.4 * charge, scale * current, scale * charge]
                })
                .collect();
            let (value, deviation) = resistance(&rows).unwrap();
            assert!(
                (value - truth).abs() < 1.96 * deviation,
                "scale {scale}: {value} ± {deviation}"
            );
            assert!(deviation < 0.03 * truth, "scale {scale}: {value} ± {deviation}");
        }
    }
}
