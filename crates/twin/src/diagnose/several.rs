//! Several flights: one vehicle and one wind for all of them; where nothing explains them so, what each has alone; and unless that
//! explains each without a wind, a wind of each.

use super::result::{Diagnosis, Verdict};
use super::{Options, air, apart, search_by};
use crate::log::FlightLog;
use crate::model::{ModelVersion, steady_wind};
use crate::predict::PredictError;
use std::cell::Cell;

/// Share of the progress at which the search in one wind ends, where others may follow.
const TOGETHER: f64 = 0.4;
/// Shares at which the searches over the single flights end, and those over groups of them.
const ALONE: f64 = 0.6;
const GROUPS: f64 = 0.7;

/// The search over several flights.
///
/// # Errors
/// One sentence: a log cannot be compared with the model, or the model's effects are not valid.
pub(super) fn diagnose_flights(
    logs: &[FlightLog],
    model: &ModelVersion,
    options: &Options<'_>,
) -> Result<Diagnosis, PredictError> {
    let all: Vec<&FlightLog> = logs.iter().collect();
    if logs.len() < 2 {
        return search_by(&all, model, options);
    }
    let start = (options.clock)();
    // `None` once the time is up: what the flights say together is the answer then.
    let further = |logs: &[&FlightLog], model: &ModelVersion, text: &str, from: f64, to: f64| {
        let left_s = options.time_limit_s - ((options.clock)() - start);
        if left_s <= 0.0 {
            return Ok(None);
        }
        let progress =
            |pass: &str, share: f64| (options.progress)(&format!("{text}: {pass}"), from + (to - from) * share);
        search_by(logs, model, &part(options, &progress, left_s)).map(Some)
    };
    let first = |text: &str, share: f64| (options.progress)(text, TOGETHER * share);
    let mut together = search_by(&all, model, &part(options, &first, options.time_limit_s))?;
    if !matches!(
        together.verdict,
        Verdict::OutsideCatalogue | Verdict::PartlyMissing { .. }
    ) {
        return Ok(together);
    }
    let is_over = Cell::new(false);
    let alone = |flights: &[usize]| {
        let of: Vec<&FlightLog> = flights.iter().map(|flight| &logs[*flight]).collect();
        let names: Vec<&str> = of.iter().map(|log| log.name.as_str()).collect();
        let (from, to) = if flights.len() > 1 {
            (ALONE, GROUPS)
        } else {
            let step = (ALONE - TOGETHER) / logs.len() as f64;
            let from = TOGETHER + step * flights[0] as f64;
            (from, from + step)
        };
        let found = further(&of, model, &format!("{} alone", names.join(" and ")), from, to)?;
        is_over.set(is_over.get() || found.is_none());
        Ok(found)
    };
    let groups = match apart::each_alone(logs.len(), &alone) {
        Ok(groups) => groups.unwrap_or_default(),
        Err(refused) => {
            let note = format!("flights not diagnosed one by one: {refused}");
            together.notes.push(note);
            Vec::new()
        }
    };
    // Where each flight is explained without a wind, none is to be looked for.
    let wind = steady_wind(&model.catalogue()?).map(|wind| wind.id);
    let blows = |group: &Diagnosis| wind.is_some_and(|wind| apart::speaks_of(group, wind));
    let may_blow = groups.is_empty() || groups.iter().any(blows);
    if may_blow && !model.wind_of_each_flight && !lacks_the_air(&together, wind) {
        let text = "each flight in a wind of its own";
        match further(&all, &model.with_own_winds(), text, GROUPS, 1.0) {
            Ok(None) => is_over.set(true),
            Ok(Some(in_winds)) => {
                let with_documents = model.with_documents(&options.effects);
                if let Some(found) = air::accepted(in_winds, &with_documents)? {
                    return Ok(found);
                }
            }
            // What the flights say in one wind is not lost for it.
            Err(refused) => {
                let note = format!("not tried with a wind of each flight's own: {refused}");
                together.notes.push(note);
            }
        }
    }
    if !groups.is_empty() {
        apart::tell(&mut together, groups);
    } else if is_over.get() {
        let note = "the time was up before each flight was diagnosed alone, and in a wind of its own";
        together.notes.push(note.to_owned());
    }
    Ok(together)
}

/// True if no flight has the columns that a wind shows in.
fn lacks_the_air(together: &Diagnosis, wind: Option<&str>) -> bool {
    let mut untested = together.not_considered.iter();
    untested.any(|one| Some(one.effect.as_str()) == wind && !one.columns.is_empty())
}

/// The options of one of several searches.
fn part<'a>(options: &Options<'a>, progress: &'a (dyn Fn(&str, f64) + Sync), time_limit_s: f64) -> Options<'a> {
    Options {
        effects: options.effects.clone(),
        baseline: Vec::new(),
        most_effects: options.most_effects,
        progress,
        clock: options.clock,
        time_limit_s,
    }
}
