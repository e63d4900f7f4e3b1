//! Rows of [`super::faults`] to tables of at most 80 columns, and to `score.json`.

use super::faults::{Class, End, FaultRow, ISOLATED_S, NAME, WITHIN_S, WindowCount};
use super::sheet::Share;
use crate::error::{BlindError, Result};
use serde::Serialize;
use std::path::Path;

/// Figures of one class.
#[derive(Debug, Clone, Serialize)]
pub struct ClassSheet {
    /// Kind of fault.
    pub class: Class,
    /// Flights that were judged.
    pub flights: usize,
    /// Flights that the pilot lost, or that have no report.
    pub failed: usize,
    /// The right rotors within 10 s.
    pub found: Share,
    /// First correct window: median and worst, s.
    pub first_s: Option<[f64; 2]>,
    /// Right for good: share of the flights, and median and worst, s.
    pub settled: Share,
    /// See `settled`.
    pub settled_s: Option<[f64; 2]>,
    /// Truth inside the interval, of flights that name the right rotors at the end.
    pub inside: Share,
    /// Flights in which a healthy rotor was named with a probability of 0.95 or more.
    pub healthy_named: Share,
    /// Recoveries that were released within 1 s.
    pub released: Share,
    /// Single, sudden losses that were not found within 10 s, and were said to be too small to be seen, or "cannot judge".
    pub announced: Share,
    /// Ramps that pass the announced size, isolated within 2 s of it.
    pub isolated: Share,
    /// Loads that changed, named within 10 s.
    pub load_named: Share,
    /// Their masses inside of the interval.
    pub load_inside: Share,
    /// Flights in which a load was named that did not change.
    pub false_load: Share,
    /// Alarms without a loss.
    pub false_alarms: usize,
    /// Hours with a verdict and without a loss.
    pub healthy_h: f64,
    /// Share of the flying time that was judged.
    pub decided: f64,
    /// Last verdicts: right, in a set, open, missed, wrong.
    pub ends: [usize; 5],
    /// Windows inside while the losses stand still.
    pub still: WindowCount,
    /// Windows inside while a loss moves.
    pub moving: WindowCount,
}

/// Figures of every class.
pub fn sum_up(rows: &[FaultRow]) -> Vec<ClassSheet> {
    Class::ALL
        .iter()
        .map(|class| {
            let of_class: Vec<&FaultRow> = rows.iter().filter(|row| row.case.class == *class).collect();
            let judged: Vec<&FaultRow> = of_class.iter().copied().filter(|row| row.failure.is_none()).collect();
            let has_loss = !matches!(
                class,
                Class::Healthy | Class::FiveHealthy | Class::GroundHealthy | Class::LoadDropped | Class::Gain
            );
            let asked = if has_loss { judged.len() } else { 0 };
            let count = |is: &dyn Fn(&FaultRow) -> bool| judged.iter().filter(|row| is(row)).count();
            let all_s: f64 = judged.iter().map(|row| row.case.duration_s).sum();
            let windows = |of: &dyn Fn(&FaultRow) -> WindowCount| {
                judged
                    .iter()
                    .map(|row| of(row))
                    .fold(WindowCount::default(), |sum, count| WindowCount {
                        inside: sum.inside + count.inside,
                        of: sum.of + count.of,
                    })
            };
            ClassSheet {
                ends: [End::Right, End::InSet, End::Open, End::Missed, End::Wrong]
                    .map(|end| count(&|row| row.end == Some(end))),
                still: windows(&|row| row.still),
                moving: windows(&|row| row.moving),
                class: *class,
                flights: judged.len(),
                failed: of_class.len() - judged.len(),
                found: Share::new(count(&|row| row.first_s.is_some_and(|s| s <= WITHIN_S)), asked),
                first_s: median_and_worst(judged.iter().filter_map(|row| row.first_s)),
                settled: Share::new(
                    count(&|row| row.settled_s.is_some()),
                    if *class == Class::Intermittent { 0 } else { asked },
                ),
                settled_s: median_and_worst(judged.iter().filter_map(|row| row.settled_s)),
                inside: Share::new(
                    count(&|row| row.inside == Some(true)),
                    count(&|row| row.inside.is_some()),
                ),
                healthy_named: Share::new(count(&|row| row.healthy_named), judged.len()),
                released: Share::new(
                    count(&|row| row.released_s.is_some_and(|s| s <= 1.0)),
                    count(&|row| row.recovers && row.first_s.is_some()),
                ),
                announced: Share::new(
                    count(&|row| row.announced == Some(true)),
                    count(&|row| row.announced.is_some()),
                ),
                isolated: Share::new(
                    count(&|row| row.past_announced_s.is_some_and(|s| s <= ISOLATED_S)),
                    count(&|row| row.past_announced_s.is_some()),
                ),
                load_named: Share::new(
                    count(&|row| row.load_named_s.is_some_and(|s| s <= WITHIN_S)),
                    if *class == Class::LoadDropped { judged.len() } else { 0 },
                ),
                load_inside: Share::new(
                    count(&|row| row.load_inside == Some(true)),
                    count(&|row| row.load_inside.is_some()),
                ),
                false_load: Share::new(count(&|row| row.false_load), judged.len()),
                false_alarms: judged.iter().map(|row| row.false_alarms).sum(),
                healthy_h: judged.iter().map(|row| row.healthy_s).sum::<f64>() / 3600.0,
                decided: if all_s > 0.0 {
                    judged.iter().map(|row| row.decided_s).sum::<f64>() / all_s
                } else {
                    0.0
                },
            }
        })
        .collect()
}

fn median_and_worst(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let last = *values.last()?;
    Some([values[values.len() / 2], last])
}

/// `12/14 [60, 96]`, in per cent.
fn share(share: &Share) -> String {
    if share.of == 0 {
        return "–".to_owned();
    }
    format!(
        "{}/{} [{:.0}, {:.0}]",
        share.count,
        share.of,
        100.0 * share.low,
        100.0 * share.high
    )
}

/// Windows inside, in per cent.
fn of_windows(count: WindowCount) -> String {
    if count.of == 0 {
        return "–".to_owned();
    }
    format!("{:.0} %", 100.0 * count.inside as f64 / count.of as f64)
}

fn pair(pair: Option<[f64; 2]>) -> String {
    pair.map_or("–".to_owned(), |[median, worst]| format!("{median:.2} / {worst:.0}"))
}

/// 95 % interval of a rate for this many events in this many hours, 1/h: Byar's approximation of the exact limits.
fn rate(events: usize, hours: f64) -> [f64; 2] {
    let limit =
        |count: f64, side: f64| count * (1.0 - 1.0 / (9.0 * count) + side * 1.96 / (3.0 * count.sqrt())).powi(3);
    let low = if events == 0 { 0.0 } else { limit(events as f64, -1.0) };
    let high = if events == 0 {
        3.689
    } else {
        limit(events as f64 + 1.0, 1.0)
    };
    [low / hours, high / hours]
}

/// The tables, of classes that were flown.
pub fn text(sheets: &[ClassSheet]) -> String {
    let flown: Vec<&ClassSheet> = sheets.iter().filter(|sheet| sheet.flights + sheet.failed > 0).collect();
    let sheets = flown.as_slice();
    let mut text = format!(
        "{:<17}{:>3}  {:<17}{:<13}{:<16}{}\n",
        "fault", "n", "found in 10 s", "first, s", "settled", "settled, s"
    );
    for sheet in sheets {
        text += &format!(
            "{:<17}{:>3}  {:<17}{:<13}{:<16}{}\n",
            sheet.class.words(),
            sheet.flights,
            share(&sheet.found),
            pair(sheet.first_s),
            share(&sheet.settled),
            pair(sheet.settled_s)
        );
    }
    text += &format!(
        "\n{:<18}{:<17}{:<17}{:<8}{:<8}{}\n",
        "fault", "truth inside", "healthy named", "alarms", "hours", "judged"
    );
    for sheet in sheets {
        text += &format!(
            "{:<18}{:<17}{:<17}{:<8}{:<8.3}{:.0} %\n",
            sheet.class.words(),
            share(&sheet.inside),
            share(&sheet.healthy_named),
            sheet.false_alarms,
            sheet.healthy_h,
            100.0 * sheet.decided
        );
    }
    text += &format!(
        "\n{:<18}{:>6}{:>8}{:>6}{:>8}{:>7}   {:<15}{}\n",
        "at the end", "right", "in set", "open", "missed", "wrong", "inside: still", "moving"
    );
    for sheet in sheets {
        let [right, in_set, open, missed, wrong] = sheet.ends;
        text += &format!(
            "{:<18}{right:>6}{in_set:>8}{open:>6}{missed:>8}{wrong:>7}   {:<15}{}\n",
            sheet.class.words(),
            of_windows(sheet.still),
            of_windows(sheet.moving)
        );
    }
    let (alarms, hours) = sheets.iter().fold((0, 0.0), |(alarms, hours), sheet| {
        (alarms + sheet.false_alarms, hours + sheet.healthy_h)
    });
    if hours > 0.0 {
        let [low, high] = rate(alarms, hours);
        text += &format!(
            "\nFalse alarms     {alarms} in {hours:.2} h without a loss: {:.1}/h [{low:.1}, {high:.1}]\n",
            alarms as f64 / hours
        );
    }
    for sheet in sheets.iter().filter(|sheet| sheet.released.of > 0) {
        text += &format!(
            "Released in 1 s  {} of recoveries that were found\n",
            share(&sheet.released)
        );
    }
    for sheet in sheets.iter().filter(|sheet| sheet.isolated.of > 0) {
        text += &format!(
            "Isolated in 2 s  {} of ramps that pass the announced size\n",
            share(&sheet.isolated)
        );
    }
    for sheet in sheets.iter().filter(|sheet| sheet.load_named.of > 0) {
        text += &format!(
            "Loads            {} named in 10 s, mass inside {}\n",
            share(&sheet.load_named),
            share(&sheet.load_inside)
        );
    }
    let false_load = sheets.iter().fold([0, 0], |sum, sheet| {
        [sum[0] + sheet.false_load.count, sum[1] + sheet.false_load.of]
    });
    text += &format!(
        "Loads, false     in {} flights\n",
        share(&Share::new(false_load[0], false_load[1]))
    );
    let announced = sheets.iter().fold([0, 0], |sum, sheet| {
        [sum[0] + sheet.announced.count, sum[1] + sheet.announced.of]
    });
    if announced[1] > 0 {
        text += &format!(
            "Misses predicted {} of single steps not found in 10 s\n",
            share(&Share::new(announced[0], announced[1]))
        );
    }
    let failed: usize = sheets.iter().map(|sheet| sheet.failed).sum();
    if failed > 0 {
        text += &format!("No score         {failed} flights: lost by the pilot, or without a report\n");
    }
    text + "Shares with Wilson's 95 % interval in per cent; times are median / worst, from a\nloss of 2 % on; inside: windows whose interval holds the loss, still and moving.\n"
}

/// Writes `score.json`.
///
/// # Errors
/// The file cannot be written.
pub fn write(folder: &Path, seed: u64, rows: &[FaultRow], sheets: &[ClassSheet]) -> Result<()> {
    let path = folder.join("score.json");
    let json = serde_json::json!({ "preset": NAME, "seed": seed, "classes": sheets, "rows": rows });
    std::fs::write(&path, format!("{json:#}\n")).map_err(|source| BlindError::file("writing", path, source))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_tables_fit_a_terminal() {
        let sheet = |class| ClassSheet {
            class,
            flights: 100,
            failed: 1,
            found: Share::new(100, 100),
            first_s: Some([10.25, 30.5]),
            settled: Share::new(99, 100),
            settled_s: Some([10.25, 30.5]),
            inside: Share::new(100, 100),
            healthy_named: Share::new(100, 100),
            released: Share::new(100, 100),
            announced: Share::new(99, 100),
            isolated: Share::new(99, 100),
            load_named: Share::new(100, 100),
            load_inside: Share::new(100, 100),
            false_load: Share::new(0, 100),
            false_alarms: 1234,
            healthy_h: 12.345,
            decided: 0.87,
            ends: [100, 0, 0, 0, 100],
            still: WindowCount { inside: 10, of: 10 },
            moving: WindowCount { inside: 0, of: 10 },
        };
        let text = text(&Class::ALL.map(sheet));
        for line in text.lines() {
            assert!(line.chars().count() <= 80, "{} columns: {line}", line.chars().count());
        }
    }

    #[test]
    fn val_rates_have_the_limits_of_poisson() {
        // Exact: 3 events, 0.619 to 8.767; none, 3.689.
        let [low, high] = rate(3, 1.0);
        assert!(
            (low - 0.619).abs() < 0.03 && (high - 8.767).abs() < 0.03,
            "{low} {high}"
        );
        assert_eq!(rate(0, 2.0), [0.0, 3.689 / 2.0]);
    }
}
