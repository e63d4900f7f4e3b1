//! Tables of the accuracy of the detectors on logs with known truth ([`rotortwin_runner::log_verdict::score`]).

use rotortwin_campaign::study::intervals::poisson_rate;
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_campaign::study::score::DetectorScore;
use rotortwin_runner::grid::Grid;
use rotortwin_runner::log_verdict::score::{DETECTORS, SEQUENTIAL};

/// The sequential detector, one line per log.
pub(super) fn by_log(names: &[String], scores: &[&LogScore]) -> Grid {
    let mut table = Grid::new([
        "log",
        "windows",
        "judged",
        "correct",
        "isolated",
        "settled",
        "false alarms",
        "inside",
    ])
    .numbers_from(1);
    for (name, log) in names.iter().zip(scores) {
        let score = &log.detectors[SEQUENTIAL].score;
        table.add_row([
            name.clone(),
            log.windows.to_string(),
            share(score.windows, log.windows),
            share(score.right, score.windows),
            delay(log, score.isolated_after_s()),
            delay(log, score.settled_after_s()),
            score.false_alarm_events.to_string(),
            share(log.inside, log.inside_of),
        ]);
    }
    table
}

/// Every detector over all logs.
pub(super) fn by_detector(scores: &[&LogScore]) -> Grid {
    let mut table = Grid::new([
        "detector",
        "windows",
        "judged",
        "correct",
        "isolated",
        "settled",
        "false alarms/h",
    ])
    .numbers_from(1);
    let damaged = scores.iter().filter(|score| score.onset_s.is_some()).count();
    let all = scores.iter().map(|log| log.windows).sum::<u64>();
    for (index, detector) in DETECTORS.iter().enumerate() {
        let of = |number: fn(&DetectorScore) -> u64| {
            scores
                .iter()
                .map(|log| number(&log.detectors[index].score))
                .sum::<u64>()
        };
        let windows = of(|score| score.windows);
        if windows == 0 {
            continue;
        }
        let delays = |delay: fn(&DetectorScore) -> Option<f64>| {
            let mut found: Vec<f64> = scores
                .iter()
                .filter_map(|log| delay(&log.detectors[index].score))
                .collect();
            found.sort_by(f64::total_cmp);
            match found.get(found.len().saturating_sub(1) / 2) {
                Some(median) => format!("{} of {damaged}, {median:.2} s", found.len()),
                None => format!("0 of {damaged}"),
            }
        };
        let events = of(|score| score.false_alarm_events);
        let hours = scores
            .iter()
            .map(|log| log.detectors[index].score.healthy_s())
            .sum::<f64>()
            / 3600.0;
        let rate = poisson_rate(events, hours).map_or_else(
            || "–".to_owned(),
            |[low, high]| format!("{} [{}, {}]", short(events as f64 / hours), short(low), short(high)),
        );
        table.add_row([
            (*detector).to_owned(),
            all.to_string(),
            share(windows, all),
            share(of(|score| score.right), windows),
            delays(DetectorScore::isolated_after_s),
            delays(DetectorScore::settled_after_s),
            rate,
        ]);
    }
    table
}

/// At least two digits.
fn short(rate: f64) -> String {
    match rate {
        0.0 => "0".to_owned(),
        rate if rate < 1.0 => format!("{rate:.3}"),
        rate if rate < 10.0 => format!("{rate:.1}"),
        rate => format!("{rate:.0}"),
    }
}

fn share(part: u64, of: u64) -> String {
    if of == 0 {
        "–".to_owned()
    } else {
        format!("{:.1} %", 100.0 * part as f64 / of as f64)
    }
}

fn delay(log: &LogScore, delay_s: Option<f64>) -> String {
    match (log.onset_s, delay_s) {
        (None, _) => "–".to_owned(),
        (Some(_), None) => "never".to_owned(),
        (Some(_), Some(delay_s)) => format!("{delay_s:.2} s"),
    }
}
