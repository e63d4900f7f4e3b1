//! `report.html` of a run: the components of the web page, the summary, and the telemetry as the server returns it, decimated to lowest
//! and highest samples, so that no spike disappears.

use crate::error::{Result, StoreError};
use crate::plots::{Plots, Sample, normal_grid, normal_line};
use crate::query::{Query, TelemetryFile};
use crate::summary::{Evaluator, OwnDetector, Score, Summary};
use rotortwin_flight_core::fdi::verdict_code::HEALTHY;
use rotortwin_page::{Report, rounded};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Rows of the embedded telemetry.
const POINTS: usize = 1600;
/// Channels of the plots.
const CHANNELS: [&str; 26] = [
    "fault_label",
    "verdict_sequential",
    "verdict_t_test",
    "verdict_network",
    "sequential_probability",
    "thrust_loss_share",
    "thrust_loss_share_low",
    "thrust_loss_share_high",
    "second_thrust_loss_share",
    "duty_*",
    "residual_*_nms",
    "battery_voltage_v",
    "true_open_circuit_voltage_v",
    "true_state_of_charge",
    "reference_north_m",
    "reference_east_m",
    "reference_down_m",
    "reference_yaw_rad",
    "roll_setpoint_rad",
    "pitch_setpoint_rad",
    "true_position_north_m",
    "true_position_east_m",
    "true_position_down_m",
    "true_roll_rad",
    "true_pitch_rad",
    "true_yaw_rad",
];

/// Embedded data of the page.
#[derive(Serialize)]
struct Inside<'a> {
    summary: &'a Summary,
    telemetry: Option<Telemetry>,
    normal: Option<NormalPlot>,
}

/// Samples by channel, as the server returns them.
#[derive(Serialize)]
struct Telemetry {
    data: BTreeMap<String, Vec<Option<f64>>>,
    units: BTreeMap<String, String>,
}

/// Quantiles of a residual against those of a normal distribution, without a fault and with the first one.
#[derive(Serialize)]
struct NormalPlot {
    rotor: usize,
    z: Vec<f64>,
    panels: Vec<NormalPanel>,
}

#[derive(Serialize)]
struct NormalPanel {
    title: String,
    /// Components arm, lever, yaw.
    lines: Vec<Line>,
}

#[derive(Serialize)]
struct Line {
    quantiles: Vec<Option<f64>>,
    reference: [f64; 2],
}

/// The page; `plots` and `telemetry` are absent if no step was recorded.
///
/// # Errors
/// The telemetry cannot be read.
pub(crate) fn render(summary: &Summary, plots: Option<&Plots>, telemetry: Option<&Path>) -> Result<String> {
    let inside = Inside {
        summary,
        telemetry: telemetry
            .map(|path| samples(path, &summary.own_detectors))
            .transpose()?,
        normal: plots.and_then(|plots| normal(summary, plots)),
    };
    let page = Report {
        kind: "run",
        title: &format!("{} · {}", summary.scenario.name, summary.run),
        summary: &words(summary),
        program: &summary.program_version,
        data: &inside,
    };
    Ok(page.render().expect("text and numbers are JSON"))
}

fn samples(path: &Path, own: &[OwnDetector]) -> Result<Telemetry> {
    let failed = |source| StoreError::Report {
        path: path.to_owned(),
        source: Box::new(source),
    };
    let mut query = Query::of(CHANNELS);
    query
        .channels
        .extend(own.iter().map(|detector| detector.column.clone()));
    query.points = POINTS;
    let table = TelemetryFile::open(path)
        .and_then(|file| file.query(&query))
        .map_err(failed)?;
    let mut found = Telemetry {
        data: BTreeMap::new(),
        units: BTreeMap::new(),
    };
    for column in table.columns {
        let values = column.values.into_iter().map(rounded).collect();
        found.units.insert(column.channel.name.clone(), column.channel.unit);
        found.data.insert(column.channel.name, values);
    }
    Ok(found)
}

/// Summary of the run in a few lines.
fn words(summary: &Summary) -> String {
    let mut lines = vec![format!(
        "{}: {} after {} steps, {:.2} s simulated; run hash {}",
        summary.scenario.name,
        summary.status.as_str(),
        summary.steps,
        summary.simulated_s,
        summary.run_hash
    )];
    lines.extend(summary.failure.as_ref().map(|failure| failure.sentence.clone()));
    for (place, interval) in summary.intervals.iter().enumerate() {
        let ours = Evaluator::ALL.map(|evaluator| {
            if summary.is_absent(evaluator) && evaluator == Evaluator::Network {
                return "no network loaded".to_owned();
            }
            achievement(evaluator.title(), interval.scores.of(evaluator))
        });
        let own = summary.own_detectors.iter().filter_map(|detector| {
            let score = detector.scores.get(place)?;
            Some(achievement(&detector.name, score))
        });
        let all: Vec<String> = ours.into_iter().chain(own).collect();
        lines.push(format!(
            "{} s to {} s, {}: {}",
            interval.start_s,
            interval.end_s,
            interval.description,
            all.join("; ")
        ));
    }
    lines.join("\n")
}

/// Performance of a detector in an interval.
fn achievement(name: &str, score: &Score) -> String {
    let share = score.share_right.map_or_else(
        || "no verdict".to_owned(),
        // Never 100 % unless it is.
        |share| format!("{:.1} % of the windows right", (1000.0 * share).floor() / 10.0),
    );
    let delay = score
        .isolated_after_s
        .map_or_else(String::new, |delay| format!(", rotor named after {delay:.2} s"));
    let alarms = match score.false_alarm_events {
        0 => String::new(),
        count => format!(", {count} false alarms"),
    };
    format!("{name} {share}{delay}{alarms}")
}

fn normal(summary: &Summary, plots: &Plots) -> Option<NormalPlot> {
    let grid = normal_grid();
    let panel = |title: String, sample: &Sample| {
        let lines = (0..3).map(|component| {
            let line = normal_line(&sample.sorted(plots.second_residual, component), &grid)?;
            Some(Line {
                quantiles: line.quantiles.iter().map(|value| rounded(f64::from(*value))).collect(),
                reference: line.reference,
            })
        });
        let lines: Option<Vec<Line>> = lines.collect();
        Some(NormalPanel { title, lines: lines? })
    };
    let mut faults = summary
        .intervals
        .iter()
        .filter(|interval| interval.fault_label != HEALTHY);
    let fault = faults.next().map(|interval| interval.description.clone());
    let panels = [
        panel("healthy".to_owned(), &plots.healthy),
        panel(fault.unwrap_or_default(), &plots.faulty),
    ];
    let panels: Vec<NormalPanel> = panels.into_iter().flatten().collect();
    (!panels.is_empty()).then_some(NormalPlot {
        rotor: if plots.second_residual { 2 } else { 1 },
        z: grid,
        panels,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_text_of_the_user_cannot_break_the_page() {
        let mut summary = Summary::default();
        summary.scenario.name = "</script><b>\"&".to_owned();
        let page = render(&summary, None, None).unwrap();
        assert!(!page.contains("</script><b>"));
        assert!(page.contains("<title>&lt;/script&gt;&lt;b&gt;\"&amp;"));
        assert!(page.contains("\\u003c/script>\\u003cb>\\\"&"));
    }
}
