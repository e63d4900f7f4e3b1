//! Static thrust over duty and voltage: Eq. 19 and its rivals.
//!
//! * Eq. 19: f = (V − v₀)(a₀√u + a₁u + a₂u² + a₃u³), u in percent
//! * quadratic with V^n: f = (V/V̄)ⁿ (c₀ + c₁u + c₂u²), u from 0 to 1
//! * power law: f = k u^p (V/V̄)ⁿ
//! * quadratic, affine: in duty alone
//!
//! V̄ is the mean voltage of the data. The voltage terms need voltages that differ: with less than 3 % of spread they are not fitted.

use super::fit::{Fit, FittedModel, HeldOut, Structure, fit};
use super::table::{Role, Table};
use super::{FitError, refuse};

/// Spread of the voltage, as a share of its mean, below which no voltage dependence is fitted.
const LEAST_SPREAD: f64 = 0.03;

/// Largest thrust over the lowest, turned round, below which the load cell counts downwards.
const DOWNWARDS: f64 = 0.1;

/// Fits thrust over duty (and voltage) of one blade to one or several tables.
pub fn fit_thrust(tables: &[Table]) -> Result<Fit, FitError> {
    let tables: Vec<Table> = tables.iter().map(Table::without_stalls).collect();
    let tables = &tables[..];
    let (mut duty, mut voltage, mut thrust) = (Vec::new(), Vec::new(), Vec::new());
    let mut notes = Vec::new();
    let all_with_voltage = tables.iter().all(|table| !table.voltage.is_empty());
    for table in tables {
        duty.extend_from_slice(table.require(Role::Command)?);
        thrust.extend_from_slice(table.require(Role::Thrust)?);
        if all_with_voltage {
            voltage.extend_from_slice(&table.voltage);
        }
        notes.extend(table.notes.iter().map(|note| format!("{}: {note}", table.name)));
    }
    let count = thrust.len();
    if count < 6 {
        return refuse(format!("expected at least 6 points of thrust, got {count}"));
    }
    let top = thrust.iter().copied().fold(0.0, f64::max);
    let bottom = thrust.iter().copied().fold(0.0, f64::min);
    // Beside a load cell's noise about 0.
    if top <= DOWNWARDS * -bottom || top <= 0.0 {
        return refuse(format!(
            "expected positive thrusts, got {bottom:.1} to {top:.1} N: if the load cell counts downwards, --map thrust=COLUMN:-N reverses it (or -kg, -g)"
        ));
    }
    let mean = voltage.iter().sum::<f64>() / voltage.len().max(1) as f64;
    let spread = voltage.iter().fold(0.0_f64, |s, v| s.max((v - mean).abs())) / mean.max(1e-9);
    let with_voltage = !voltage.is_empty() && spread >= LEAST_SPREAD;
    if !with_voltage {
        notes.push(if voltage.is_empty() {
            "no voltage column: no dependence on the voltage is fitted".to_owned()
        } else {
            format!(
                "the voltage varies by {:.1} % only: no dependence on it is fitted",
                100.0 * spread
            )
        });
    }
    let structures = structures(&duty, with_voltage.then_some(voltage.as_slice()), mean, top);
    let models: Vec<FittedModel> = structures
        .iter()
        .filter_map(|structure| fit(structure, &thrust, HeldOut::Blocks))
        .collect();
    if models.is_empty() {
        return refuse(format!("{count} points are too few for any of the structures"));
    }
    let fit = Fit {
        kind: "thrust",
        files: tables.iter().map(|table| table.name.clone()).collect(),
        x_name: "duty",
        x: duty.clone(),
        y_name: "thrust, N",
        y: thrust.clone(),
        models,
        notes,
    };
    Ok(fit.rank())
}

fn quadratic(p: &[f64], u: f64) -> f64 {
    p[0] + u * (p[1] + p[2] * u)
}

/// Eq. 19 with its coefficients and v0, duty from 0 to 1.
fn eq19(p: &[f64], u: f64, v: f64) -> f64 {
    let percent = 100.0 * u.max(0.0);
    (v - p[4]) * (p[0] * percent.sqrt() + percent * (p[1] + percent * (p[2] + percent * p[3])))
}

/// The rivals; `top` is the largest thrust, `mean` the mean voltage.
fn structures<'a>(duty: &'a [f64], voltage: Option<&'a [f64]>, mean: f64, top: f64) -> Vec<Structure<'a>> {
    let wide = [-1e6, 1e6];
    let mut all = vec![
        Structure {
            name: "affine",
            equation: "f = c0 + c1 u",
            names: &["c0_n", "c1_n"],
            start: vec![0.1 * top, top],
            predict: Box::new(|p| duty.iter().map(|u| p[0] + p[1] * u).collect()),
            bounds: vec![wide; 2],
        },
        Structure {
            name: "quadratic",
            equation: "f = c0 + c1 u + c2 u^2",
            names: &["c0_n", "c1_n", "c2_n"],
            start: vec![0.1 * top, top, top],
            predict: Box::new(|p| duty.iter().map(|u| quadratic(p, *u)).collect()),
            bounds: vec![wide; 3],
        },
    ];
    let Some(voltage) = voltage else {
        return all;
    };
    let points = move || duty.iter().copied().zip(voltage.iter().copied());
    let least = voltage.iter().copied().fold(mean, f64::min);
    let size = top / mean;
    all.push(Structure {
        name: "quadratic, V^n",
        equation: "f = (V/Vm)^n (c0 + c1 u + c2 u^2)",
        names: &["c0_n", "c1_n", "c2_n", "n"],
        start: vec![0.1 * top, top, top, 1.5],
        predict: Box::new(move |p| points().map(|(u, v)| (v / mean).powf(p[3]) * quadratic(p, u)).collect()),
        bounds: vec![wide, wide, wide, [-2.0, 6.0]],
    });
    all.push(Structure {
        name: "power law",
        equation: "f = k u^p (V/Vm)^n",
        names: &["k_n", "p", "n"],
        start: vec![top, 1.5, 1.5],
        predict: Box::new(move |p| {
            points()
                .map(|(u, v)| p[0] * u.max(1e-9).powf(p[1]) * (v / mean).powf(p[2]))
                .collect()
        }),
        bounds: vec![[0.0, 1e6], [0.1, 6.0], [-2.0, 6.0]],
    });
    all.push(Structure {
        name: "Eq. 19",
        equation: "f = (V - v0)(a0 sqrt(u) + a1 u + a2 u^2 + a3 u^3), u in percent",
        names: &["a0", "a1", "a2", "a3", "v0_v"],
        start: vec![-0.05 * size, 0.01 * size, 1e-4 * size, -1e-7 * size, 0.3 * mean],
        predict: Box::new(move |p| points().map(|(u, v)| eq19(p, u, v)).collect()),
        bounds: vec![wide, wide, wide, wide, [-20.0 * mean, 0.95 * least]],
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of Table 1's blade (a) at three voltages, without noise: Eq. 19 must win and find its coefficients.
    #[test]
    fn val_blade_a_is_found_again() {
        let truth = [-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7, 5.2859];
        let mut table = Table {
            name: "blade a".to_owned(),
            ..Table::default()
        };
        for v in [14.8, 15.6, 16.6] {
            for k in 4..=20 {
                let u = f64::from(k) * 0.05;
                table.command.push(u);
                table.voltage.push(v);
                // A pattern of ±5 mN in place of the noise of a load cell.
                table
                    .thrust
                    .push(eq19(&truth, u, v) + if k % 2 == 0 { 0.005 } else { -0.005 });
            }
        }
        let fit = fit_thrust(&[table]).unwrap();
        assert_eq!(fit.models[0].name, "Eq. 19");
        let v0 = fit.models[0].parameter("v0_v").unwrap();
        assert!((v0.low..=v0.high).contains(&5.2859), "{v0:?}");
        assert!(fit.models[0].rmse < 0.0055);
    }

    #[test]
    fn scenario_a_constant_voltage_gives_no_exponent() {
        let table = Table {
            name: "one voltage".to_owned(),
            command: (1..=12).map(|k| f64::from(k) / 12.0).collect(),
            thrust: (1..=12).map(|k| f64::from(k * k) / 20.0).collect(),
            voltage: vec![15.0; 12],
            ..Table::default()
        };
        let fit = fit_thrust(&[table]).unwrap();
        assert!(fit.notes.iter().any(|note| note.contains("no dependence")));
        assert!(fit.models.iter().all(|model| model.parameter("n").is_none()));
    }
}
