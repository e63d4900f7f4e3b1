//! `report.html` and `improvement.json` of an improvement, and numbers as its texts show them.

use std::path::Path;

use rotortwin_page::Report;

use super::{Improvement, OnLog, ParameterValue};

/// Quantities of the waterfall, in addition to open loop.
pub const QUANTITIES: [&str; 3] = ["force", "torque", "voltage"];
/// Horizon of the open-loop plot, s.
pub const HORIZON_S: f64 = 1.0;

/// Writes both files into a folder.
///
/// # Errors
/// One sentence with the path.
pub fn write(folder: &Path, improvement: &Improvement) -> Result<(), String> {
    let json = serde_json::to_string_pretty(improvement).expect("text and numbers are JSON");
    let fail = |path: &Path, error: std::io::Error| format!("cannot write {}: {error}", path.display());
    std::fs::create_dir_all(folder).map_err(|error| fail(folder, error))?;
    for (name, content) in [("improvement.json", json + "\n"), ("report.html", render(improvement))] {
        let path = folder.join(name);
        std::fs::write(&path, content).map_err(|error| fail(&path, error))?;
    }
    Ok(())
}

/// As [`quantity`], of a parameter in a model.
pub fn value_text(p: &ParameterValue) -> String {
    quantity(&p.symbol, p.value, p.interval_95, &p.unit)
}

/// Below, a number is written with a power of ten.
const SMALLEST: f64 = 1e-4;

/// `k_d = 0.2530 ± 0.0020 N·s/m`, with the half width of the 95 % interval.
pub fn quantity(symbol: &str, value: f64, interval_95: f64, unit: &str) -> String {
    let digits = if interval_95 > 0.0 {
        (1 - interval_95.log10().floor() as i32).clamp(0, 8) as usize
    } else {
        4
    };
    let unit = if unit.is_empty() {
        String::new()
    } else {
        format!(" {unit}")
    };
    if interval_95 > 0.0 && value.abs().max(interval_95) < SMALLEST {
        return format!("{symbol} = {value:.2e} ± {interval_95:.1e}{unit}");
    }
    format!("{symbol} = {value:.digits$} ± {interval_95:.digits$}{unit}")
}

/// Three significant digits.
pub fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    if value.abs() < SMALLEST {
        return format!("{value:.2e}");
    }
    let decimals = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.decimals$}")
}

/// Open-loop position error after [`HORIZON_S`], m.
pub fn open_loop_m(log: &OnLog) -> Option<f64> {
    log.open_loop
        .iter()
        .find(|open| (open.horizon_s - HORIZON_S).abs() < 1e-9)
        .map(|open| open.position_m)
        .filter(|error| error.is_finite())
}

/// The page.
///
/// # Panics
/// Never: text and numbers are JSON.
pub fn render(improvement: &Improvement) -> String {
    let names: Vec<&str> = improvement.fitted.iter().map(|log| log.name.as_str()).collect();
    let steps = improvement.rows.iter().map(|row| {
        let added = row.added.as_deref().unwrap_or("the vehicle as given");
        let values: Vec<String> = row.parameters.iter().map(value_text).collect();
        format!("{}: {added} {}", row.version, values.join(", "))
    });
    let last = improvement
        .diagnosis
        .as_ref()
        .map(|diagnosis| diagnosis.sentence.clone());
    let lines = [improvement.reason.clone()].into_iter().chain(steps).chain(last);
    Report {
        kind: "improvement",
        title: &format!("Improvement · {}", names.join(", ")),
        summary: &lines.collect::<Vec<_>>().join("\n"),
        program: improvement.tool,
        data: improvement,
    }
    .render()
    .expect("text and numbers are JSON")
}
