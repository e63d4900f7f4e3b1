//! Many rows to one score sheet: shares with intervals, medians, the confusion matrix.

use super::cases::Preset;
use super::score::{Outcome, Row, label};
use serde::Serialize;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// A fraction with its 95 % interval (Wilson).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
#[schema(as = BlindShare)]
pub struct Share {
    /// How many.
    pub count: usize,
    /// Denominator.
    pub of: usize,
    /// `count/of`.
    pub share: f64,
    /// Interval.
    pub low: f64,
    /// Interval.
    pub high: f64,
}

impl Share {
    /// `count` of `of`; nothing of nothing is 0 with the interval 0 to 1.
    pub fn new(count: usize, of: usize) -> Self {
        if of == 0 {
            return Self {
                count,
                of,
                share: 0.0,
                low: 0.0,
                high: 1.0,
            };
        }
        let (n, p, z) = (of as f64, count as f64 / of as f64, 1.959_963_985);
        let centre = p + z * z / (2.0 * n);
        let spread = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        let scale = 1.0 + z * z / n;
        Self {
            count,
            of,
            share: p,
            low: ((centre - spread) / scale).max(0.0),
            high: ((centre + spread) / scale).min(1.0),
        }
    }

    /// `97.5 % (39/40; 87.1–99.6)`.
    pub fn text(&self) -> String {
        if self.of == 0 {
            return "–".to_owned();
        }
        format!(
            "{:.1} % ({}/{}; {:.1}–{:.1})",
            100.0 * self.share,
            self.count,
            self.of,
            100.0 * self.low,
            100.0 * self.high
        )
    }
}

/// Figures for one set of rows.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = BlindGroup)]
pub struct Group {
    /// Preset and flight.
    pub name: String,
    /// Number of cases.
    pub cases: usize,
    /// Exactly right, or correctly reported as not testable.
    pub right_or_not_testable: Share,
    /// First name correct, of the cases where something is hidden.
    pub top1: Share,
    /// All hidden effects were named.
    pub all_found: Share,
    /// Exactly the hidden set was named.
    pub exact: Share,
    /// Hidden effect inside the named group, of the cases where an effect of the catalogue was named.
    pub in_group: Share,
    /// Correctly reported as not testable.
    pub not_testable: Share,
    /// Nothing named although it should have been detectable.
    pub missed: Share,
    /// Wrong, not flagged as uncertain.
    pub confidently_wrong: Share,
    /// Wrong, flagged as uncertain.
    pub wrong_flagged: Share,
    /// False alarms, of the cases with nothing hidden.
    pub false_alarms: Share,
    /// Of the cases outside the catalogue.
    pub flagged: Share,
    /// No answer.
    pub failed: Share,
    /// Relative parameter error of correctly named effects: median and 90th percentile.
    pub parameter_error: Option<[f64; 2]>,
    /// 95 % intervals that contain the truth.
    pub coverage: Share,
    /// Onsets correct within 1 s.
    pub onset_within_1_s: Share,
    /// χ² per residual after the named effects were added: median and worst, over correct answers; that of the oracle
    /// is 1.
    pub chi2_after: Option<[f64; 2]>,
    /// Seconds per diagnosis: median and worst.
    pub seconds: [f64; 2],
}

/// The score sheet.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = BlindSheet)]
pub struct Sheet {
    /// One per preset and flight, then one per preset.
    pub groups: Vec<Group>,
    /// (truth, named, cases), wrong answers and misses first.
    pub confusion: Vec<(String, String, usize)>,
}

/// Value at a share of a sorted copy; `None` for no values.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    Some(sorted[(share * last as f64).round() as usize])
}

fn group(name: String, rows: &[&Row]) -> Group {
    let count = |wanted: &dyn Fn(&&&Row) -> bool| rows.iter().filter(|row| wanted(row)).count();
    let all = rows.len();
    let hidden = count(&|row| !row.case.effects.is_empty() && row.case.preset != Preset::Outside);
    let null = count(&|row| row.case.effects.is_empty());
    let outside = count(&|row| row.case.preset == Preset::Outside);
    let named =
        count(&|row| !row.named.is_empty() && !row.case.effects.is_empty() && row.case.preset != Preset::Outside);
    let outcome = |wanted: Outcome| count(&|row| row.outcome == wanted);
    let inside = |row: &Row| !row.case.effects.is_empty() && row.case.preset != Preset::Outside;
    let errors: Vec<f64> = rows
        .iter()
        .flat_map(|row| row.parameter_errors.iter().copied())
        .collect();
    let covered: Vec<bool> = rows.iter().flat_map(|row| row.covered.iter().copied()).collect();
    let onsets: Vec<f64> = rows.iter().filter_map(|row| row.onset_error_s).collect();
    let with_onset = count(&|row| row.case.effects.iter().any(|effect| effect.onset_s.is_some()));
    let chi2: Vec<f64> = rows
        .iter()
        .filter(|row| row.outcome == Outcome::Right)
        .filter_map(|row| row.chi2.map(|pair| pair[1]))
        .collect();
    let seconds: Vec<f64> = rows.iter().map(|row| row.seconds).collect();
    Group {
        name,
        cases: all,
        right_or_not_testable: Share::new(
            count(&|row| matches!(row.outcome, Outcome::Right | Outcome::NotTestable | Outcome::Flagged)),
            all,
        ),
        top1: Share::new(count(&|row| inside(row) && row.top1), hidden),
        all_found: Share::new(count(&|row| inside(row) && row.all_found), hidden),
        exact: Share::new(count(&|row| inside(row) && row.outcome == Outcome::Right), hidden),
        in_group: Share::new(
            count(&|row| inside(row) && !row.named.is_empty() && row.in_group),
            named,
        ),
        not_testable: Share::new(outcome(Outcome::NotTestable), hidden),
        missed: Share::new(outcome(Outcome::Missed), all - null),
        confidently_wrong: Share::new(outcome(Outcome::ConfidentlyWrong), all),
        wrong_flagged: Share::new(outcome(Outcome::WrongFlagged), all),
        false_alarms: Share::new(outcome(Outcome::FalseAlarm), null),
        flagged: Share::new(outcome(Outcome::Flagged), outside),
        failed: Share::new(outcome(Outcome::Failed), all),
        parameter_error: quantile(&errors, 0.5).zip(quantile(&errors, 0.9)).map(|(a, b)| [a, b]),
        coverage: Share::new(covered.iter().filter(|covered| **covered).count(), covered.len()),
        onset_within_1_s: Share::new(onsets.iter().filter(|error| error.abs() <= 1.0).count(), with_onset),
        chi2_after: quantile(&chi2, 0.5).zip(quantile(&chi2, 1.0)).map(|(a, b)| [a, b]),
        seconds: [
            quantile(&seconds, 0.5).unwrap_or(0.0),
            quantile(&seconds, 1.0).unwrap_or(0.0),
        ],
    }
}

/// Row and column of the confusion matrix in which a case is counted: hidden effect, named effect.
pub fn cell(row: &Row) -> (String, String) {
    let strip = |text: &str| {
        let ids: Vec<String> = text
            .split(" + ")
            .map(|part| label(part.split(' ').next().unwrap_or(""), None))
            .collect();
        if text.is_empty() {
            "nothing".to_owned()
        } else {
            ids.join(" + ")
        }
    };
    let named = match row.outcome {
        Outcome::Failed => "no answer".to_owned(),
        Outcome::NotFlown => "no flight".to_owned(),
        Outcome::Flagged | Outcome::WrongFlagged if row.named.is_empty() => "outside the catalogue".to_owned(),
        Outcome::Flagged => format!("outside the catalogue, besides {}", strip(&row.named)),
        Outcome::NotTestable if row.named.is_empty() => "not testable".to_owned(),
        _ => strip(&row.named),
    };
    (strip(&row.truth), named)
}

/// Sums up the rows.
pub fn sum_up(rows: &[Row]) -> Sheet {
    let mut presets: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.outcome != Outcome::NotFlown) {
        presets.entry(row.case.preset.name()).or_default().push(row);
    }
    let mut groups = Vec::new();
    for (preset, all) in presets {
        let mut flights: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
        for &row in &all {
            flights.entry(&row.case.flight).or_default().push(row);
        }
        // A single kind of flight is the whole preset.
        if flights.len() > 1 {
            groups.extend(
                flights
                    .iter()
                    .map(|(flight, rows)| group(format!("{preset}, {flight}"), rows)),
            );
        }
        groups.push(group(format!("{preset}, all"), &all));
    }
    let mut confusion: BTreeMap<(bool, String, String), usize> = BTreeMap::new();
    for row in rows {
        let right = matches!(row.outcome, Outcome::Right | Outcome::Flagged);
        let (hidden, named) = cell(row);
        *confusion.entry((right, hidden, named)).or_default() += 1;
    }
    Sheet {
        groups,
        confusion: confusion
            .into_iter()
            .map(|((_, truth, named), n)| (truth, named, n))
            .collect(),
    }
}

/// The sheet as text for a terminal.
pub fn text(sheet: &Sheet) -> String {
    let mut out = String::new();
    for group in &sheet.groups {
        out += &format!("{} ({} cases)\n", group.name, group.cases);
        let mut line = |name: &str, share: &Share| {
            if share.of > 0 {
                out += &format!("  {name:<34}{}\n", share.text());
            }
        };
        line("right, or correctly not testable", &group.right_or_not_testable);
        line("first name right", &group.top1);
        line("all found", &group.all_found);
        line("exactly the hidden set", &group.exact);
        line("within the named group", &group.in_group);
        line("correctly not testable", &group.not_testable);
        line("missed", &group.missed);
        line("confidently wrong", &group.confidently_wrong);
        line("wrong, flagged", &group.wrong_flagged);
        line("false alarms", &group.false_alarms);
        line("outside, and said so", &group.flagged);
        line("no answer", &group.failed);
        line("95 % intervals that cover", &group.coverage);
        line("onset within 1 s", &group.onset_within_1_s);
        if let Some([median, p90]) = group.parameter_error {
            out += &format!(
                "  {:<34}{:.2} % median, {:.2} % at 90 %\n",
                "parameter error",
                100.0 * median,
                100.0 * p90
            );
        }
        if let Some([median, worst]) = group.chi2_after {
            out += &format!(
                "  {:<34}{median:.4} median, {worst:.4} worst\n",
                "chi2/N of right answers"
            );
        }
        out += &format!(
            "  {:<34}{:.2} median, {:.2} worst\n",
            "seconds", group.seconds[0], group.seconds[1]
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::cases::Case;

    /// Wilson 1927, checked by hand for 0 of 18 and 39 of 40.
    #[test]
    fn val_wilson_interval() {
        let none = Share::new(0, 18);
        assert!(none.low.abs() < 1e-12 && (none.high - 0.1759).abs() < 1e-4);
        let most = Share::new(39, 40);
        assert!((most.low - 0.8712).abs() < 1e-4 && (most.high - 0.9956).abs() < 1e-4);
    }

    #[test]
    fn prop_a_case_that_could_not_be_flown_counts_nowhere() {
        let case = Case {
            index: 0,
            preset: Preset::Helix,
            vehicle: String::new(),
            flight: "helix".to_owned(),
            seed: 1,
            scale: 1.0,
            clutter: false,
            disturbance: 1.0,
            effects: Vec::new(),
        };
        let failed = crate::bench::score::failed(&case, "no answer".to_owned(), 0.0);
        let lost = Row {
            outcome: Outcome::NotFlown,
            ..failed.clone()
        };
        let cases = |rows: &[Row]| sum_up(rows).groups.last().map(|group| group.cases);
        assert_eq!(cases(&[failed.clone(), lost.clone()]), Some(1));
        assert_eq!(cases(&[lost]), None);
        // One kind of flight is the whole preset; two have a line each, and the sum.
        let mut elsewhere = failed.clone();
        elsewhere.case.flight = "hover".to_owned();
        let names = |rows: &[Row]| -> Vec<String> { sum_up(rows).groups.into_iter().map(|g| g.name).collect() };
        assert_eq!(names(std::slice::from_ref(&failed)), ["helix, all"]);
        assert_eq!(
            names(&[failed, elsewhere]),
            ["helix, helix", "helix, hover", "helix, all"]
        );
    }

    #[test]
    fn val_quantiles() {
        assert_eq!(quantile(&[3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
