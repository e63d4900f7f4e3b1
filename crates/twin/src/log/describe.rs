//! A log and its import in words.

use super::flight_parts::FlightParts;
use super::{FlightLog, names};
use std::fmt::Write as _;

/// Ranges of one column.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnRange {
    /// Name.
    pub column: String,
    /// Unit; empty for unknown columns.
    pub unit: &'static str,
    /// Rows with a value.
    pub values: usize,
    /// Smallest value; NaN if there is none.
    pub least: f64,
    /// Mean; NaN if there is none.
    pub mean: f64,
    /// Largest value; NaN if there is none.
    pub most: f64,
}

impl FlightLog {
    /// Range of every column, canonical ones first.
    pub fn ranges(&self) -> Vec<ColumnRange> {
        let describe = |(name, values): (&str, &[f64])| {
            let present = || values.iter().copied().filter(|value| !value.is_nan());
            let count = present().count();
            ColumnRange {
                column: name.to_owned(),
                unit: names::unit(name).unwrap_or_default(),
                values: count,
                least: present().fold(f64::NAN, f64::min),
                mean: present().sum::<f64>() / count as f64,
                most: present().fold(f64::NAN, f64::max),
            }
        };
        self.columns_in_order().into_iter().map(describe).collect()
    }

    /// One line: rows, time, rate, rotors; of what is no multirotor, what it is.
    pub fn headline(&self) -> String {
        let vehicle = match &self.report.other_vehicle {
            Some(other) => other.clone(),
            None => format!("{} rotors", self.rotor_count()),
        };
        format!(
            "{}: {} rows, {:.2} s at {:.4} Hz, {vehicle}, {} columns",
            self.name,
            self.time_s.len(),
            self.duration_s(),
            self.sample_rate_hz(),
            self.columns.len()
        )
    }

    /// The account of the import, a heading and its lines; nothing where there is nothing to say.
    pub fn account(&self) -> String {
        self.account_with(&self.flight_parts(None))
    }

    /// The same with parts of the flight that were found before.
    pub fn account_with(&self, flight_parts: &FlightParts) -> String {
        /// More gaps than this are counted, not listed.
        const LISTED: usize = 5;
        let report = &self.report;
        let mut text = String::new();
        let mut section = |heading: &str, lines: Vec<String>| {
            for (index, line) in lines.into_iter().enumerate() {
                let heading = if index == 0 { heading } else { "" };
                // Writing to a string cannot fail.
                let _ok = writeln!(text, "{heading:<13}{line}");
            }
        };
        section("Findings", report.findings.iter().map(ToString::to_string).collect());
        let (parts, events) = flight_parts.lines(report.clock_start_s);
        section("Parts", parts);
        section("Events", events);
        let streams = report.streams.iter().map(|stream| {
            format!(
                "{} ({} samples, {:.2} Hz): {}",
                stream.name, stream.samples, stream.sample_rate_hz, stream.resampling
            )
        });
        section("Streams", streams.collect());
        section("Conversions", report.conversions.clone());
        let mut gaps: Vec<String> = report
            .gaps
            .iter()
            .take(LISTED)
            .map(|gap| format!("{:.3} s to {:.3} s", gap.start_s, gap.end_s))
            .collect();
        if report.gaps.len() > LISTED {
            gaps.push(format!("and {} more", report.gaps.len() - LISTED));
        }
        section("Gaps", gaps);
        let delays = report.delays.iter().map(|delay| {
            format!(
                "{} {:+.1} ms behind {} (1σ {:.1} ms, correlation {:.3}), {}",
                delay.signal,
                delay.delay_s * 1e3,
                delay.against,
                delay.uncertainty_s * 1e3,
                delay.correlation,
                if delay.applied { "taken out" } else { "left as it is" }
            )
        });
        section("Delays", delays.collect());
        let empty = report
            .missing_cells
            .iter()
            .map(|missing| format!("{}: {} of {} rows", missing.column, missing.cells, report.rows));
        section("Empty cells", empty.collect());
        let missing = report
            .missing
            .iter()
            .map(|missing| format!("{}: {}", missing.columns.join(", "), missing.rules_out));
        section("Missing", missing.collect());
        let unused: Vec<String> = report
            .unused_columns
            .iter()
            .map(|unused| unused.column.clone())
            .collect();
        if !unused.is_empty() {
            section("Not used", vec![unused.join(", ")]);
        }
        section("Notes", report.notes.clone());
        text
    }
}
