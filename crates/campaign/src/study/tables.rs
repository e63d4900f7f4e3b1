//! The totals as tables, for terminal and report.
//!
//! Percentages with their 95 % interval; see [`super::intervals`] for its definition.

use super::document::Criteria;
use super::intervals::{poisson_rate, wilson};
use super::plan::Campaign;
use super::record::DETECTORS;
use super::score::severity_name;
use super::totals::{AxisTotals, DetectorTotals, GroupTotals, Totals};
use crate::result_table::ResultTable;

/// Display name of a detector.
pub fn title(detector: usize) -> &'static str {
    ["sequential", "network", "T-test"][detector]
}

const NONE: &str = "–";

/// A fraction as a percentage; never rounded up to 100.
pub fn percent(share: Option<f64>) -> String {
    match share {
        None => NONE.to_owned(),
        Some(share) if share >= 1.0 => "100".to_owned(),
        Some(share) => format!("{:.2}", (10_000.0 * share).floor() / 100.0),
    }
}

fn interval_percent(interval: Option<[f64; 2]>) -> String {
    interval.map_or_else(String::new, |[low, high]| {
        format!(" [{}, {}]", percent(Some(low)), percent(Some(high)))
    })
}

/// Seconds to the millisecond.
pub fn seconds(time: Option<f64>) -> String {
    time.map_or_else(|| NONE.to_owned(), |time| format!("{time:.3}"))
}

/// `24/24 [86.2, 100]`.
fn proportion(hits: u64, total: u64) -> String {
    if total == 0 {
        return NONE.to_owned();
    }
    format!("{hits}/{total}{}", interval_percent(wilson(hits as f64, total as f64)))
}

/// `0 in 2.7 h: < 1.1/h`, `3 in 10.0 h: 0.30/h [0.06, 0.88]`.
pub fn alarm_rate(totals: &DetectorTotals) -> String {
    let hours = totals.healthy_h();
    match poisson_rate(totals.false_alarm_events, hours) {
        None => NONE.to_owned(),
        Some([_, high]) if totals.false_alarm_events == 0 => format!("0 in {hours:.2} h: < {}/h", rate(high)),
        Some([low, high]) => format!(
            "{} in {hours:.2} h: {}/h [{}, {}]",
            totals.false_alarm_events,
            rate(totals.false_alarm_events as f64 / hours),
            rate(low),
            rate(high)
        ),
    }
}

fn rate(x: f64) -> String {
    match x {
        x if x >= 100.0 => format!("{x:.0}"),
        x if x >= 10.0 => format!("{x:.1}"),
        _ => format!("{x:.2}"),
    }
}

fn strings<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).into()
}

/// All tables, in the order of the report.
pub fn tables(campaign: &Campaign, totals: &Totals) -> Vec<ResultTable> {
    let criteria = &campaign.document().criteria;
    let mut tables = vec![windows(totals), faults(totals, criteria)];
    let mut axes: Vec<&AxisTotals> = totals.axes.iter().collect();
    // The folds of the protocol first.
    axes.sort_by_key(|axis| axis.axis != "trajectory");
    tables.extend(axes.into_iter().filter_map(|axis| by_axis(axis, totals, criteria)));
    tables.extend(by_severity(totals, criteria));
    tables.extend(operating_curve(totals));
    tables
}

/// Detectors with a verdict in any flight, by their names in tables: ours, then the user's own.
pub fn ready(totals: &Totals) -> impl Iterator<Item = (&str, &DetectorTotals)> {
    let ours = totals.detectors.iter().enumerate();
    let ours = ours.map(|(place, detector)| (title(place), detector));
    let own = totals.own.iter().map(|own| (own.name.as_str(), &own.totals));
    ours.chain(own).filter(|(_, detector)| detector.windows.total() > 0)
}

fn windows(totals: &Totals) -> ResultTable {
    let rows = ready(totals).map(|(name, detector)| {
        vec![
            name.to_owned(),
            percent(detector.windows.share()) + &interval_percent(detector.windows.interval()),
            percent(detector.healthy.share()),
            percent(detector.faulty.share()),
            detector.missed.to_string(),
            detector.wrong_rotor.to_string(),
            detector.unclear.to_string(),
            alarm_rate(detector),
        ]
    });
    let ours = (0..DETECTORS.len()).map(|place| (title(place), &totals.detectors[place]));
    let own = totals.own.iter().map(|own| (own.name.as_str(), &own.totals));
    let silent: Vec<&str> = ours
        .chain(own)
        .filter_map(|(name, detector)| (detector.windows.total() == 0).then_some(name))
        .collect();
    let mut notes = vec![
        "Right: share of the windows whose verdict is the truth, percent; its interval takes the windows of a flight as dependent".to_owned(),
        "False alarms: windows in a row with any verdict but healthy while no rotor is faulty; Poisson interval, one-sided for none".to_owned(),
    ];
    if !silent.is_empty() {
        notes.push(format!("Without a verdict in any flight: {}", silent.join(", ")));
    }
    for own in totals.own.iter().filter(|own| own.not_judged > 0) {
        notes.push(format!(
            "{} has not judged {} of {} flights: its figures are those of the others",
            own.name, own.not_judged, totals.flights
        ));
    }
    ResultTable {
        key: "windows",
        title: "Windows and false alarms".to_owned(),
        columns: strings([
            "detector",
            "right, %",
            "healthy",
            "faulty",
            "missed",
            "wrong rotor",
            "unclear",
            "false alarms",
        ]),
        rows: rows.collect(),
        notes,
    }
}

fn faults(totals: &Totals, criteria: &Criteria) -> ResultTable {
    let rows = ready(totals)
        .filter(|(_, detector)| detector.fault_flights > 0)
        .map(|(name, detector)| {
            let flights = detector.fault_flights;
            vec![
                name.to_owned(),
                proportion(detector.isolated.total(), flights),
                proportion(detector.isolated.within(criteria.isolate_within_s), flights),
                seconds(detector.detected.quantile_s(0.5)),
                seconds(detector.isolated.quantile_s(0.5)),
                seconds(detector.isolated.quantile_s(0.95)),
                seconds(detector.isolated.quantile_s(1.0)),
                proportion(detector.settled.total(), flights),
                seconds(detector.settled.quantile_s(1.0)),
                detector.wrong_rotor_flights.to_string(),
            ]
        });
    let mut notes = vec![
        "Delays in s from the onset to the end of the window: detected, any verdict but healthy; isolated, the first right one; settled, \
         right from then on to the end"
            .to_owned(),
    ];
    let own = totals.own.iter().map(|own| (own.name.as_str(), &own.loss_error));
    for (name, errors) in [("the sequential detector", &totals.loss_error)].into_iter().chain(own) {
        if let Some((count, mean, rms)) = errors.summary() {
            notes.push(format!(
                "Lost thrust at the end, estimate of {name} less truth, {count} flights with the right rotor named: mean {:+.1} mN, rms \
                 {:.1} mN; its interval of 95 % holds the truth in {}",
                1e3 * mean,
                1e3 * rms,
                proportion(errors.covered(), count)
            ));
        }
    }
    ResultTable {
        key: "faults",
        title: "Flights with a fault".to_owned(),
        columns: vec![
            "detector".to_owned(),
            "isolated".to_owned(),
            format!("within {} s", criteria.isolate_within_s),
            "detected, median".to_owned(),
            "isolated, median".to_owned(),
            "95 %".to_owned(),
            "worst".to_owned(),
            "settled".to_owned(),
            "worst".to_owned(),
            "wrong rotor in".to_owned(),
        ],
        rows: rows.collect(),
        notes,
    }
}

/// Headings of the columns of the user's own detectors.
fn own_columns(totals: &Totals) -> impl Iterator<Item = String> {
    totals.own.iter().map(|own| format!("{}, %", own.name))
}

fn by_axis(axis: &AxisTotals, totals: &Totals, criteria: &Criteria) -> Option<ResultTable> {
    let used: Vec<&GroupTotals> = axis.groups.iter().filter(|group| group.flights > 0).collect();
    if axis.overflown || used.len() < 2 {
        return None;
    }
    let rows = used.into_iter().map(|group| {
        let [sequential, network, t_test] = &group.detectors;
        let own = group.own.iter().map(|own| percent(own.windows.share()));
        let ours = vec![
            group.name.clone(),
            group.flights.to_string(),
            percent(sequential.windows.share()) + &interval_percent(sequential.windows.interval()),
            alarm_rate(sequential),
            match sequential.fault_flights {
                0 => NONE.to_owned(),
                flights => format!("{}/{flights}", sequential.isolated.within(criteria.isolate_within_s)),
            },
            seconds(sequential.isolated.quantile_s(0.5)),
            seconds(sequential.isolated.quantile_s(1.0)),
            percent(network.windows.share()),
            percent(t_test.windows.share()),
        ];
        ours.into_iter().chain(own).collect::<Vec<String>>()
    });
    let ours = vec![
        axis.axis.replace('_', " "),
        "flights".to_owned(),
        "sequential, %".to_owned(),
        "its false alarms".to_owned(),
        format!("isolated in {} s", criteria.isolate_within_s),
        "median, s".to_owned(),
        "worst, s".to_owned(),
        "network, %".to_owned(),
        "T-test, %".to_owned(),
    ];
    Some(ResultTable {
        key: "axis",
        title: format!("By {}", axis.axis.replace('_', " ")),
        columns: ours.into_iter().chain(own_columns(totals)).collect(),
        rows: rows.collect(),
        notes: Vec::new(),
    })
}

fn by_severity(totals: &Totals, criteria: &Criteria) -> Option<ResultTable> {
    let rows: Vec<Vec<String>> = totals
        .severities()
        .into_iter()
        .map(|bin| {
            let mut row = vec![severity_name(bin)];
            for detector in &totals.detectors {
                row.push(percent(detector.by_severity.get(&bin).and_then(|sums| sums.share())));
            }
            let [sequential, ..] = &totals.detectors;
            let (flights, delays) = sequential.delay_by_severity.get(&bin).cloned().unwrap_or_default();
            row.push(match flights {
                0 => NONE.to_owned(),
                _ => format!("{}/{flights}", delays.within(criteria.isolate_within_s)),
            });
            row.push(seconds(delays.quantile_s(0.5)));
            row.push(seconds(delays.quantile_s(1.0)));
            for own in &totals.own {
                row.push(percent(own.totals.by_severity.get(&bin).and_then(|sums| sums.share())));
            }
            row
        })
        .collect();
    let ours = vec![
        "lost share of the hover thrust".to_owned(),
        "sequential, %".to_owned(),
        "network, %".to_owned(),
        "T-test, %".to_owned(),
        format!("isolated in {} s", criteria.isolate_within_s),
        "median, s".to_owned(),
        "worst, s".to_owned(),
    ];
    (!rows.is_empty()).then(|| ResultTable {
        key: "severity",
        title: "By severity".to_owned(),
        columns: ours.into_iter().chain(own_columns(totals)).collect(),
        rows,
        notes: vec![
            "Shares: windows with this loss. Isolation, by the sequential detector: flights whose first fault is of this size".to_owned(),
        ],
    })
}

fn operating_curve(totals: &Totals) -> Option<ResultTable> {
    let bins: Vec<usize> = totals
        .severities()
        .into_iter()
        .filter(|bin| totals.curve.iter().any(|(_, d)| d.delay_by_severity.contains_key(bin)))
        .collect();
    let rows: Vec<Vec<String>> = totals
        .curve
        .iter()
        .map(|(level, detector)| {
            let mut row = vec![
                level.to_string(),
                alarm_rate(detector),
                percent(detector.windows.share()),
                detector.wrong_rotor_flights.to_string(),
            ];
            for bin in &bins {
                let (flights, delays) = detector.delay_by_severity.get(bin).cloned().unwrap_or_default();
                row.push(format!(
                    "{} ({}/{flights})",
                    seconds(delays.quantile_s(0.5)),
                    delays.total()
                ));
            }
            row
        })
        .collect();
    let mut columns = strings(["evidence, nats", "false alarms", "right, %", "wrong rotor in"]);
    columns.extend(bins.iter().map(|bin| format!("median s at {}", severity_name(*bin))));
    (!rows.is_empty()).then(|| ResultTable {
        key: "operating",
        title: "Operating curve of the sequential detector".to_owned(),
        columns,
        rows,
        notes: vec![
            "The same flights with other thresholds; delays to isolation by the size of the first fault, in brackets flights isolated".to_owned(),
        ],
    })
}

/// The worst flights, and those that did not reach their end; each with the command that repeats it.
pub fn listed_flights(campaign: &Campaign, totals: &Totals) -> Vec<ResultTable> {
    let all = campaign.command();
    let command = |flight: u64| format!("{all} --flight {flight}");
    let parameters = |listed: &super::totals::Listed| {
        let parts: Vec<String> = listed
            .parameters
            .iter()
            .map(|(axis, cell)| match cell.number() {
                Some(x) => format!("{axis} {}", round(x)),
                None => format!("{axis} {cell}"),
            })
            .collect();
        parts.join(", ")
    };
    let mut tables = Vec::new();
    if !totals.worst.is_empty() {
        tables.push(ResultTable {
            key: "worst",
            title: "Worst flights of the sequential detector".to_owned(),
            columns: strings([
                "flight",
                "not right",
                "false alarms",
                "isolated, s",
                "parameters",
                "fly it again",
            ]),
            rows: totals
                .worst
                .iter()
                .map(|listed| {
                    let score = &listed.score;
                    vec![
                        listed.flight.to_string(),
                        format!("{} of {}", score.windows - score.right, score.windows),
                        score.false_alarm_events.to_string(),
                        match (listed.faulty, score.isolated_after_s()) {
                            (true, None) => "never".to_owned(),
                            (_, delay) => seconds(delay),
                        },
                        parameters(listed),
                        command(listed.flight),
                    ]
                })
                .collect(),
            notes: Vec::new(),
        });
    }
    if !totals.unfinished.is_empty() {
        tables.push(ResultTable {
            key: "unfinished",
            title: "Flights that did not reach their end".to_owned(),
            columns: strings(["flight", "why", "parameters", "fly it again"]),
            rows: totals
                .unfinished
                .iter()
                .map(|listed| {
                    vec![
                        listed.flight.to_string(),
                        listed.reason.clone(),
                        parameters(listed),
                        command(listed.flight),
                    ]
                })
                .collect(),
            notes: vec![format!(
                "{} ended early, {} could not be flown; the first are listed, campaign.parquet has all",
                totals.failed, totals.refused
            )],
        });
    }
    tables
}

/// Four significant digits at most.
fn round(x: f64) -> String {
    if x == 0.0 || libm::fabs(x - libm::round(x)) < 1e-12 {
        return format!("{x}");
    }
    let decimals = (3 - libm::floor(libm::log10(x.abs())) as i32).clamp(0, 9);
    let text = format!("{x:.*}", usize::try_from(decimals).unwrap_or(0));
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_no_share_below_one_is_shown_as_hundred() {
        assert_eq!(percent(Some(0.999_999)), "99.99");
        assert_eq!(percent(Some(1.0)), "100");
        assert_eq!(percent(None), "–");
        assert_eq!(proportion(24, 24), "24/24 [86.20, 100]");
        assert_eq!(
            (round(0.123_456), round(45.0), round(1234.56)),
            ("0.1235".into(), "45".into(), "1235".into())
        );
    }
}
