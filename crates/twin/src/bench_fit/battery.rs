//! Battery from voltage and current over time: open-circuit voltage, resistance, one RC pair.
//!
//! * resistance: V = E₀ − k q − R I, q the charge drawn in Ah
//! * curved: V = E₀ − k q − k₂ q² − R I
//! * resistance and RC pair: V = E₀ − k q − R I − v₁, v₁' = (R₁ I − v₁)/T₁
//!
//! Limits: E₀ − k q stands for the open-circuit voltage over the charge drawn in this file, not for the cell's chart;
//! no temperature. A current that does not vary cannot distinguish R from E₀; a current that only drifts cannot
//! distinguish R from k: both cases are reported.

use super::fit::{Fit, FittedModel, HeldOut, Structure, fit};
use super::table::{Role, Table};
use super::{FitError, refuse};

/// Fits one table.
pub fn fit_battery(table: &Table) -> Result<Fit, FitError> {
    let (time, voltage, current) = (
        table.require(Role::Time)?,
        table.require(Role::Voltage)?,
        table.require(Role::Current)?,
    );
    if time.len() < 12 {
        return refuse(format!(
            "{}: expected at least 12 samples, got {}",
            table.name,
            time.len()
        ));
    }
    let mean_current = current.iter().sum::<f64>() / current.len() as f64;
    let spread = (current.iter().map(|i| (i - mean_current).powi(2)).sum::<f64>() / current.len() as f64).sqrt();
    if mean_current <= 0.0 || spread < 0.01 * mean_current {
        return refuse(format!(
            "{}: the current ({mean_current:.2} A, deviation {spread:.3} A) does not vary enough to determine a resistance",
            table.name
        ));
    }
    // Charge drawn, Ah, by the trapezoidal rule.
    let mut charge = vec![0.0];
    for k in 1..time.len() {
        charge.push(charge[k - 1] + 0.5 * (current[k] + current[k - 1]) * (time[k] - time[k - 1]) / 3600.0);
    }
    let total = charge.last().copied().unwrap_or(0.0).max(1e-6);
    let top = voltage.iter().copied().fold(0.0, f64::max);
    let drop = (top - voltage.iter().copied().fold(f64::INFINITY, f64::min)).max(1e-3);
    let slope = drop / total;
    let resistance = drop / current.iter().copied().fold(1e-3, f64::max);
    let charge = &charge;
    let wide = [-1e3, 1e3];
    let structures = [
        Structure {
            name: "resistance",
            equation: "V = E0 - k q - R I",
            names: &["e0_v", "k_v_per_ah", "r_ohm"],
            start: vec![top, slope, resistance],
            predict: Box::new(move |p| {
                (0..time.len())
                    .map(|i| p[0] - p[1] * charge[i] - p[2] * current[i])
                    .collect()
            }),
            bounds: vec![wide, [-1e4, 1e4], [0.0, 10.0]],
        },
        Structure {
            name: "resistance, curved",
            equation: "V = E0 - k q - k2 q^2 - R I",
            names: &["e0_v", "k_v_per_ah", "k2_v_per_ah2", "r_ohm"],
            start: vec![top, slope, slope / total, resistance],
            predict: Box::new(move |p| {
                (0..time.len())
                    .map(|i| p[0] - charge[i] * (p[1] + p[2] * charge[i]) - p[3] * current[i])
                    .collect()
            }),
            bounds: vec![wide, [-1e4, 1e4], [-1e6, 1e6], [0.0, 10.0]],
        },
        Structure {
            name: "resistance and RC pair",
            equation: "V = E0 - k q - R I - v1, v1' = (R1 I - v1)/T1",
            names: &["e0_v", "k_v_per_ah", "r_ohm", "r1_ohm", "t1_s"],
            start: vec![top, slope, 0.7 * resistance, 0.3 * resistance, 10.0],
            predict: Box::new(move |p| with_pair(time, current, charge, p)),
            bounds: vec![wide, [-1e4, 1e4], [0.0, 10.0], [0.0, 10.0], [0.2, 600.0]],
        },
    ];
    let models: Vec<FittedModel> = structures
        .iter()
        .filter_map(|structure| fit(structure, voltage, HeldOut::Blocks))
        .collect();
    let mut notes = table.notes.clone();
    notes.push(format!(
        "{:.3} Ah drawn in {:.1} s",
        total,
        time[time.len() - 1] - time[0]
    ));
    Ok(Fit {
        kind: "battery",
        files: vec![table.name.clone()],
        x_name: "time, s",
        x: time.to_vec(),
        y_name: "voltage, V",
        y: voltage.to_vec(),
        models,
        notes,
    }
    .rank())
}

/// The pair relaxed at the first current, then stepped exactly for a current held over each interval.
fn with_pair(time: &[f64], current: &[f64], charge: &[f64], p: &[f64]) -> Vec<f64> {
    let (r1, t1) = (p[3], p[4].max(1e-3));
    let mut pair = 0.0;
    (0..time.len())
        .map(|i| {
            if i > 0 {
                let keep = (-(time[i] - time[i - 1]) / t1).exp();
                pair = r1 * current[i - 1] + keep * (pair - r1 * current[i - 1]);
            }
            p[0] - p[1] * charge[i] - p[2] * current[i] - pair
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_resistance_and_its_pair_are_found() {
        let time: Vec<f64> = (0..1200).map(|k| f64::from(k) * 0.1).collect();
        let current: Vec<f64> = time
            .iter()
            .map(|t| if (t / 20.0) as i64 % 2 == 0 { 5.0 } else { 15.0 })
            .collect();
        let mut charge = vec![0.0];
        for k in 1..time.len() {
            charge.push(charge[k - 1] + 0.5 * (current[k] + current[k - 1]) * 0.1 / 3600.0);
        }
        let mut voltage = with_pair(&time, &current, &charge, &[16.5, 0.6, 0.02, 0.012, 8.0]);
        for (k, v) in voltage.iter_mut().enumerate() {
            *v += [0.004, -0.004, -0.004, 0.004, 0.004, 0.004, -0.004, -0.004][k % 8];
        }
        let table = Table {
            name: "pack".to_owned(),
            time,
            current,
            voltage,
            ..Table::default()
        };
        let fit = fit_battery(&table).unwrap();
        let best = &fit.models[0];
        assert_eq!(best.name, "resistance and RC pair");
        // 4 mV of a fixed pattern against steps of 10 A.
        assert!((best.parameter("r_ohm").unwrap().value - 0.02).abs() < 4e-4);
        assert!((best.parameter("r1_ohm").unwrap().value - 0.012).abs() < 4e-4);
        assert!((best.parameter("t1_s").unwrap().value - 8.0).abs() < 0.8);
    }

    #[test]
    fn scenario_a_constant_current_is_refused() {
        let table = Table {
            name: "hover".to_owned(),
            time: (0..100).map(f64::from).collect(),
            current: vec![10.0; 100],
            voltage: vec![15.0; 100],
            ..Table::default()
        };
        assert!(
            fit_battery(&table)
                .unwrap_err()
                .to_string()
                .contains("does not vary enough")
        );
    }
}
