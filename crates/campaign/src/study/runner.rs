//! Flies the missing flights of a campaign's folder, on every core, with bounded memory.
//!
//! Threads take the flights in order, a few at a time; a shard is written as soon as its last flight has ended. Only the shards in
//! progress are in memory. After a stop no further shard is started, and those in progress are completed: no flight is lost.

use super::engine::{FlightEngine, fly};
use super::folder::{CampaignFolder, SHARD_FLIGHTS};
use super::plan::Campaign;
use super::record::{FlightRecord, FlightStatus};
use super::score::DetectorScore;
use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Run options.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Threads.
    pub threads: NonZeroUsize,
    /// Fly only the shards that start before this flight.
    pub limit: Option<u64>,
    /// Fly only these shards; the others are flown elsewhere.
    pub shards: Option<std::ops::Range<u64>>,
    /// Shards that exist in an object store rather than in the folder.
    pub elsewhere: BTreeSet<u64>,
}

/// Progress report, sent after every few flights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Flights just ended.
    pub flights: u64,
    /// Their steps.
    pub steps: u64,
    /// Of these, flights that failed or could not be flown.
    pub failed: u64,
    /// False alarms of the sequential detector in them.
    pub false_alarms: u64,
}

/// How the run of the command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunEnd {
    /// All requested flights exist.
    Complete,
    /// It was stopped.
    Stopped,
}

/// Requested and existing shards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Missing shards, in order.
    pub missing: Vec<u64>,
    /// Number of requested flights.
    pub wanted_flights: u64,
    /// Number of existing ones among them.
    pub present_flights: u64,
}

/// The missing shards of a range, in order.
pub fn missing(folder: &CampaignFolder, shards: std::ops::Range<u64>) -> Vec<u64> {
    shards.filter(|shard| !folder.has_shard(*shard)).collect()
}

/// The plan for these options.
pub fn plan(folder: &CampaignFolder, options: &RunOptions) -> Plan {
    let all = folder.shard_count();
    let end = options
        .limit
        .map_or(all, |limit| all.min(limit.div_ceil(SHARD_FLIGHTS)));
    let asked = options.shards.clone().unwrap_or(0..all);
    let shards = asked.start.min(end)..asked.end.min(end);
    let size = |shard: u64| folder.shard_range(shard).end - folder.shard_range(shard).start;
    let mut missing = missing(folder, shards.clone());
    missing.retain(|shard| !options.elsewhere.contains(shard));
    let wanted: u64 = shards.map(size).sum();
    Plan {
        present_flights: wanted - missing.iter().map(|shard| size(*shard)).sum::<u64>(),
        wanted_flights: wanted,
        missing,
    }
}

/// Reads the existing shards, and repeats a flight of the first and of the last one: a program with different results must not continue,
/// nor a campaign with a shard that only its end would find damaged.
///
/// # Errors
/// A shard cannot be read, or the results differ: the message names `place`, where the shards are.
pub fn check_same_program(
    campaign: &Campaign,
    engine: &dyn FlightEngine,
    folder: &CampaignFolder,
    place: &str,
) -> Result<(), String> {
    let present: Vec<u64> = (0..folder.shard_count())
        .filter(|shard| folder.has_shard(*shard))
        .collect();
    for (index, shard) in present.iter().enumerate() {
        let records = folder.read_shard(*shard)?;
        let is_an_end = index == 0 || index + 1 == present.len();
        let Some(before) = records.first().filter(|_| is_an_end) else {
            continue;
        };
        let now = fly(campaign, engine, before.flight..before.flight + 1);
        if now.first() != Some(before) {
            return Err(format!(
                "{place}: this program gives another result for flight {} than the one that started the campaign; choose another folder with --out",
                before.flight
            ));
        }
    }
    Ok(())
}

/// A shard in progress: groups by index, and how many are outstanding.
struct Open {
    groups: BTreeMap<u64, Vec<FlightRecord>>,
    missing: u64,
}

/// Called for a shard once it is in the folder. An error aborts the run.
pub type Keep<'a> = dyn Fn(u64) -> Result<(), String> + Sync + 'a;

/// Flies the missing shards. `progress` and `keep` are called from any thread.
pub fn run(
    campaign: &Campaign,
    engine: &dyn FlightEngine,
    folder: &CampaignFolder,
    options: &RunOptions,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
    keep: &Keep<'_>,
) -> Result<RunEnd, String> {
    let missing = plan(folder, options).missing;
    let lanes = (engine.lanes() as u64).clamp(1, SHARD_FLIGHTS);
    let groups_per_shard = SHARD_FLIGHTS.div_ceil(lanes) as usize;
    let jobs = missing.len() * groups_per_shard;
    let next = AtomicUsize::new(0);
    let open: Mutex<BTreeMap<u64, Open>> = Mutex::default();
    let failure: Mutex<Option<String>> = Mutex::default();
    let halted = AtomicBool::new(false);
    let written = AtomicUsize::new(0);
    let worker = || {
        while !halted.load(Ordering::Relaxed) {
            let wanted = |job: usize| {
                let begins_a_shard = job.is_multiple_of(groups_per_shard);
                job < jobs && !(begins_a_shard && stop.load(Ordering::Relaxed))
            };
            let taken = next.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |job| {
                wanted(job).then_some(job + 1)
            });
            let Ok(job) = taken else { return };
            let shard = missing[job / groups_per_shard];
            let whole = folder.shard_range(shard);
            let group = (job % groups_per_shard) as u64;
            let range =
                (whole.start + group * lanes).min(whole.end)..(whole.start + (group + 1) * lanes).min(whole.end);
            let records = if range.is_empty() {
                Vec::new()
            } else {
                fly_guarded(campaign, engine, range)
            };
            progress(progress_of(&records));
            let done = {
                let mut open = open.lock().unwrap_or_else(PoisonError::into_inner);
                let entry = open.entry(shard).or_insert_with(|| Open {
                    groups: BTreeMap::new(),
                    missing: groups_per_shard as u64,
                });
                entry.groups.insert(group, records);
                entry.missing -= 1;
                if entry.missing == 0 { open.remove(&shard) } else { None }
            };
            if let Some(done) = done {
                let records: Vec<FlightRecord> = done.groups.into_values().flatten().collect();
                let kept = folder.write_shard(shard, &records, campaign);
                match kept.and_then(|()| keep(shard)) {
                    Ok(()) => {
                        written.fetch_add(1, Ordering::Relaxed);
                    }
                    Err(sentence) => {
                        failure
                            .lock()
                            .unwrap_or_else(PoisonError::into_inner)
                            .get_or_insert(sentence);
                        halted.store(true, Ordering::Relaxed);
                    }
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..options.threads.get().min(jobs.max(1)) {
            scope.spawn(worker);
        }
        worker();
    });
    if let Some(sentence) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(sentence);
    }
    let complete = written.into_inner() == missing.len();
    Ok(if complete { RunEnd::Complete } else { RunEnd::Stopped })
}

fn progress_of(records: &[FlightRecord]) -> Progress {
    let sequential = |record: &FlightRecord| {
        record
            .detectors
            .first()
            .map_or(0, |score: &DetectorScore| score.false_alarm_events)
    };
    Progress {
        flights: records.len() as u64,
        steps: records.iter().map(|record| record.steps).sum(),
        failed: records
            .iter()
            .filter(|record| record.status != FlightStatus::Done)
            .count() as u64,
        false_alarms: records.iter().map(sequential).sum(),
    }
}

/// If the program itself fails on a flight, the record says so, without taking thousands of others with it.
fn fly_guarded(campaign: &Campaign, engine: &dyn FlightEngine, range: std::ops::Range<u64>) -> Vec<FlightRecord> {
    if let Ok(records) = catch_unwind(AssertUnwindSafe(|| fly(campaign, engine, range.clone()))) {
        return records;
    }
    // Find the one responsible.
    range
        .flat_map(|index| {
            catch_unwind(AssertUnwindSafe(|| fly(campaign, engine, index..index + 1))).unwrap_or_else(|panic| {
                let why = panic
                    .downcast_ref::<String>()
                    .map(String::as_str)
                    .or_else(|| panic.downcast_ref::<&str>().copied())
                    .unwrap_or("no message");
                vec![super::engine::failed_record(
                    campaign,
                    index,
                    format!("the program failed on this flight: {why}"),
                )]
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::engine::{OneByOne, SideBySide};
    use std::path::Path;

    fn campaign() -> Campaign {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/campaigns/wide-draw.toml");
        Campaign::load(&path).expect("a good campaign")
    }

    #[test]
    fn prop_every_part_gives_the_flights_of_the_whole() {
        let campaign = campaign();
        let whole = fly(&campaign, &OneByOne, 7..11);
        for (i, record) in whole.iter().enumerate() {
            let index = 7 + i as u64;
            assert_eq!((record.flight, &record.reason), (index, &String::new()));
            assert_eq!(fly(&campaign, &OneByOne, index..index + 1).first(), Some(record));
            let read: FlightRecord = serde_json::from_str(&record.to_json()).expect("it was written so");
            assert_eq!(read, *record);
        }
    }

    /// Flights side by side have the same scores as flights one after another, including those that no lane accepts or that are lost.
    #[test]
    fn prop_side_by_side_gives_the_records_of_one_by_one() {
        for file in ["wide-draw", "quad-lag", "octo-lag", "detector-gain-errors"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../config/campaigns/{file}.toml"));
            let campaign = Campaign::load(&path).expect("a good campaign");
            let flights = if file == "wide-draw" { 0..19 } else { 40..44 };
            let (one, many) = (
                fly(&campaign, &OneByOne, flights.clone()),
                fly(&campaign, &SideBySide::default(), flights),
            );
            for (one, many) in one.iter().zip(&many) {
                assert_eq!(one.reason, "", "{file}");
                assert_eq!(one, many, "{file}");
            }
        }
    }

    #[test]
    fn val_draws_are_in_their_ranges_and_differ() {
        let campaign = campaign();
        let flights: Vec<_> = (0..200).map(|i| campaign.flight(i).expect("a good draw")).collect();
        let column = |axis: usize| {
            flights
                .iter()
                .filter_map(move |flight| flight.parameters[axis].cell.number())
        };
        let place = |name: &str| {
            campaign
                .axes()
                .iter()
                .position(|axis| axis.name == name)
                .expect("an axis")
        };
        for (name, low, high) in [("charge", 0.3, 1.0), ("loss_percent", 1.0, 30.0), ("rotor", 1.0, 6.0)] {
            let values: Vec<f64> = column(place(name)).collect();
            assert!(
                values.len() == 200 && values.iter().all(|x| (low..=high).contains(x)),
                "{name}"
            );
        }
        // Half of the factors below the geometric mean: 100 ± 4.2 standard deviations of a binomial.
        let small = column(place("loss_percent")).filter(|x| *x < libm::sqrt(30.0)).count();
        assert!((70..=130).contains(&small), "{small}");
        let mut seeds: Vec<u64> = flights.iter().map(|flight| flight.seed).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 200);
    }
}
