//! Finds flights in which the sequential detector fails, with a seeded search, and shrinks them to the few parameters that matter.
//!
//! ```text
//!  draws of the campaign ─▶ fly ─▶ perturb the worst ─▶ fly ─▶ failures ─▶ shrink ─▶ scenario files
//! ```
//! *Failure*, the gravest that applies: a false alarm; a healthy rotor named; the fault never isolated; isolated later than
//! `criteria.late_after_s`. *Shrink*: axis by axis back to the base's value, and the seed to the base's, as long as the flight fails in
//! the same way; then every remaining number is moved towards the base's by bisection. The base is the campaign's scenario with
//! `[set]`. The same seed and budget find the same cases, with any number of threads and every engine; the flights of the search are flown
//! side by side where the engine supports it, those of the shrinking one by one, as each depends on the one before.
//!
//! Limits: the search knows nothing about the detector; failures not found within its budget may still exist.

use super::cell::Cell;
use super::document::Criteria;
use super::engine::{FlightEngine, fly_scenario, fly_scenarios};
use super::plan::{Campaign, Parameter, PlannedFlight, is_of_the_combination};
use super::record::{FlightRecord, FlightStatus};
use crate::parallel::map_in_order;
use rotortwin_plant::random::RandomStream;
use rotortwin_scenario::template::{set_value, value_at};
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use toml::{Table, Value};

/// Fraction of the budget spent near the worst flights.
const REFINED_SHARE: u64 = 3;
/// Number of flights to perturb.
const PARENTS: usize = 8;
/// Bisections towards the base's value.
const HALVINGS: usize = 6;
/// Passes over the axes.
const PASSES: usize = 3;

/// Failure modes of a detector, gravest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Failure {
    /// A verdict other than healthy while no rotor is faulty.
    FalseAlarm,
    /// A healthy rotor is named after the onset.
    WrongRotor,
    /// The fault is never isolated.
    Missed,
    /// It is isolated later than the criterion.
    Late,
}

impl Failure {
    /// Failure of the sequential detector in a flight; `None` if there is none, or the flight did not reach its end.
    pub fn of(record: &FlightRecord, criteria: &Criteria) -> Option<Self> {
        let score = record.detectors.first().filter(|score| score.is_ready())?;
        if record.status != FlightStatus::Done {
            return None;
        }
        if score.false_alarm_events > 0 {
            return Some(Self::FalseAlarm);
        }
        if score.wrong_rotor > 0 {
            return Some(Self::WrongRotor);
        }
        record.onset_loss_share?;
        match score.isolated_after_s() {
            None => Some(Self::Missed),
            Some(delay) if delay > criteria.late_after_s => Some(Self::Late),
            Some(_) => None,
        }
    }

    /// Name in file names.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::FalseAlarm => "false-alarm",
            Self::WrongRotor => "wrong-rotor",
            Self::Missed => "missed",
            Self::Late => "late",
        }
    }
}

/// Search options.
#[derive(Clone, Copy, Debug)]
pub struct HuntOptions {
    /// Seed of the search.
    pub seed: u64,
    /// Flights of the search, without those of the shrinking.
    pub budget: u64,
    /// Maximum number of cases to shrink.
    pub cases: usize,
    /// Threads.
    pub threads: NonZeroUsize,
}

/// A failing flight, shrunk.
#[derive(Clone, Debug)]
pub struct Case {
    /// Failure mode.
    pub failure: Failure,
    /// Description with numbers.
    pub words: String,
    /// Axes that must differ from the base, with their values.
    pub kept: Vec<(String, Cell)>,
    /// Whether the flight's own seed matters.
    pub own_seed: bool,
    /// Flights flown while shrinking.
    pub flights: u64,
    /// The scenario, paths relative to the campaign's base.
    pub scenario: Table,
}

/// Result of a hunt.
#[derive(Clone, Debug, Default)]
pub struct Hunt {
    /// Flights of the search that were flown.
    pub flights: u64,
    /// Of these, failures by kind.
    pub failures: Vec<(Failure, u64)>,
    /// Flights that did not reach their end; no verdict on the detector.
    pub unfinished: u64,
    /// Shrunk cases.
    pub cases: Vec<Case>,
    /// It was stopped before it had searched and shrunk everything.
    pub is_stopped: bool,
}

/// A flight of the search and its result.
struct Tried {
    flight: PlannedFlight,
    record: Option<FlightRecord>,
}

/// Searches and shrinks. `done` is called after every flight of the search; a stop ends it with the results so far.
pub fn hunt(
    campaign: &Campaign,
    engine: &dyn FlightEngine,
    options: &HuntOptions,
    stop: &AtomicBool,
    done: &(dyn Fn() + Sync),
) -> Hunt {
    let criteria = campaign.document().criteria;
    let fly = |flights: &[PlannedFlight]| fly_together(campaign, engine, flights, stop, done);
    let refined = options.budget / REFINED_SHARE;
    // Flight numbers beyond those of any campaign: independent draws.
    let first = (1u64 << 40) + (options.seed << 28);
    let drawn: Vec<PlannedFlight> = (first..first + (options.budget - refined))
        .filter_map(|i| campaign.flight(i).ok())
        .collect();
    let mut tried = try_all(drawn, options.threads, engine.lanes(), &fly);
    tried.sort_by(|a, b| badness(b, &criteria).total_cmp(&badness(a, &criteria)));
    let parents: Vec<PlannedFlight> = tried.iter().take(PARENTS).map(|tried| tried.flight.clone()).collect();
    if !parents.is_empty() {
        let mut random = RandomStream::new(options.seed, "hunt/moves");
        let moved: Vec<PlannedFlight> = (0..refined)
            .map(|i| campaign.neighbour(&parents[i as usize % parents.len()], &mut random))
            .collect();
        tried.extend(try_all(moved, options.threads, engine.lanes(), &fly));
    }
    let mut hunt = Hunt {
        flights: tried.len() as u64,
        ..Hunt::default()
    };
    let unfinished = |tried: &&Tried| {
        tried
            .record
            .as_ref()
            .is_none_or(|record| record.status != FlightStatus::Done)
    };
    hunt.unfinished = tried.iter().filter(unfinished).count() as u64;
    let mut found: Vec<(Failure, &PlannedFlight)> = tried
        .iter()
        .filter_map(|tried| Some((Failure::of(tried.record.as_ref()?, &criteria)?, &tried.flight)))
        .collect();
    for failure in [Failure::FalseAlarm, Failure::WrongRotor, Failure::Missed, Failure::Late] {
        let count = found.iter().filter(|(kind, _)| *kind == failure).count() as u64;
        if count > 0 {
            hunt.failures.push((failure, count));
        }
    }
    // One of each kind first, then the second of each, ….
    let mut order: Vec<(usize, Failure, &PlannedFlight)> = Vec::new();
    for (failure, flight) in found.drain(..) {
        let rank = order.iter().filter(|(_, kind, _)| *kind == failure).count();
        order.push((rank, failure, flight));
    }
    order.sort_by_key(|(rank, failure, _)| (*rank, *failure));
    let jobs: Vec<(Failure, &PlannedFlight)> = order.into_iter().take(options.cases).map(|(_, f, p)| (f, p)).collect();
    let shrunk = map_in_order(
        options.threads,
        &jobs,
        |(failure, flight)| {
            (!stop.load(Ordering::Relaxed)).then(|| Shrinker::new(campaign, engine, *failure).shrink(flight))?
        },
        &|| (),
    );
    let mut seen = BTreeSet::new();
    for case in shrunk.into_iter().flatten() {
        if seen.insert(toml::to_string(&case.scenario).unwrap_or_default()) {
            hunt.cases.push(case);
        }
    }
    hunt.is_stopped = stop.load(Ordering::Relaxed);
    hunt
}

/// Flies a group: a record for each flight that can be flown; `None` after a stop.
type Fly<'a> = dyn Fn(&[PlannedFlight]) -> Option<Vec<Option<FlightRecord>>> + Sync + 'a;

/// Flies as many at a time as the engine prefers.
fn try_all(flights: Vec<PlannedFlight>, threads: NonZeroUsize, lanes: usize, fly: &Fly<'_>) -> Vec<Tried> {
    let groups: Vec<&[PlannedFlight]> = flights.chunks(lanes.max(1)).collect();
    let records = map_in_order(threads, &groups, |group| fly(group), &|| ());
    let flown = groups
        .into_iter()
        .zip(records)
        .filter_map(|(group, records)| Some((group, records?)));
    flown
        .flat_map(|(group, records)| group.iter().cloned().zip(records))
        .map(|(flight, record)| Tried { flight, record })
        .collect()
}

/// A record for each flight; `None` for one that cannot be flown. After a stop nothing is flown.
fn fly_together(
    campaign: &Campaign,
    engine: &dyn FlightEngine,
    flights: &[PlannedFlight],
    stop: &AtomicBool,
    done: &(dyn Fn() + Sync),
) -> Option<Vec<Option<FlightRecord>>> {
    if stop.load(Ordering::Relaxed) {
        return None;
    }
    let mut records: Vec<Option<FlightRecord>> = flights.iter().map(|_| None).collect();
    let (places, scenarios): (Vec<usize>, Vec<_>) = flights
        .iter()
        .enumerate()
        .filter_map(|(place, flight)| Some((place, campaign.scenario(flight).ok()?)))
        .unzip();
    // A flight that cannot even be scored must not affect its neighbours.
    let flown = fly_scenarios(campaign, engine, scenarios.clone()).map_or_else(
        |_| {
            let alone = |scenario| fly_scenario(campaign, engine, scenario).ok();
            scenarios.into_iter().map(alone).collect()
        },
        |flown| flown.into_iter().map(Some).collect::<Vec<_>>(),
    );
    for (place, record) in places.into_iter().zip(flown) {
        records[place] = record;
    }
    flights.iter().for_each(|_| done());
    Some(records)
}

/// How near to a failure, or how grave: determines which flights are perturbed.
fn badness(tried: &Tried, criteria: &Criteria) -> f64 {
    let Some(record) = &tried.record else { return -1.0 };
    let Some(score) = record.detectors.first() else {
        return -1.0;
    };
    let late = match (record.onset_loss_share, score.isolated_after_s()) {
        (None, _) => 0.0,
        (Some(_), Some(delay)) => (delay / criteria.late_after_s).min(5.0),
        (Some(_), None) => 5.0,
    };
    10.0 * score.false_alarm_events as f64 + 10.0 * f64::from(u8::from(score.wrong_rotor > 0)) + late
}

/// Shrinks one failing flight.
struct Shrinker<'a> {
    campaign: &'a Campaign,
    engine: &'a dyn FlightEngine,
    failure: Failure,
    flights: u64,
}

impl<'a> Shrinker<'a> {
    fn new(campaign: &'a Campaign, engine: &'a dyn FlightEngine, failure: Failure) -> Self {
        Self {
            campaign,
            engine,
            failure,
            flights: 0,
        }
    }

    /// The record, if the flight still fails in the same way.
    fn fails(&mut self, table: &Table) -> Option<FlightRecord> {
        self.flights += 1;
        let scenario = match self.campaign.scenario_of(table) {
            Ok(scenario) => scenario,
            Err(error) => {
                debug_assert!(error.key().is_some() || is_of_the_combination(&error), "{error}");
                return None;
            }
        };
        let record = fly_scenario(self.campaign, self.engine, scenario).ok()?;
        (Failure::of(&record, &self.campaign.document().criteria) == Some(self.failure)).then_some(record)
    }

    fn table(&self, parameters: &[Parameter], seed: Option<u64>) -> Option<Table> {
        let mut table = self.campaign.base().clone();
        for (key, value) in parameters.iter().flat_map(|parameter| &parameter.set) {
            set_value(&mut table, key, value.clone()).ok()?;
        }
        if let Some(seed) = seed {
            table.insert("seed".to_owned(), Value::Integer(i64::try_from(seed).ok()?));
        }
        Some(table)
    }

    fn shrink(mut self, flight: &PlannedFlight) -> Option<Case> {
        let mut kept = flight.parameters.clone();
        let mut seed = Some(flight.seed);
        let mut best = self.fails(&self.table(&kept, seed)?)?;
        for _ in 0..PASSES {
            let before = kept.len() + usize::from(seed.is_some());
            if seed.is_some()
                && let Some(record) = self.table(&kept, None).and_then(|table| self.fails(&table))
            {
                (seed, best) = (None, record);
            }
            let mut place = 0;
            while place < kept.len() {
                let mut fewer = kept.clone();
                fewer.remove(place);
                match self.table(&fewer, seed).and_then(|table| self.fails(&table)) {
                    Some(record) => (kept, best) = (fewer, record),
                    None => place += 1,
                }
            }
            if kept.len() + usize::from(seed.is_some()) == before {
                break;
            }
        }
        for place in 0..kept.len() {
            if let Some(record) = self.move_to_base(&mut kept, place, seed) {
                best = record;
            }
        }
        let scenario = self.table(&kept, seed)?;
        Some(Case {
            failure: self.failure,
            words: words(self.failure, &best, &self.campaign.document().criteria),
            kept: kept
                .into_iter()
                .map(|parameter| (parameter.axis, parameter.cell))
                .collect(),
            own_seed: seed.is_some(),
            flights: self.flights,
            scenario,
        })
    }

    /// Moves one number as near to the base's as the failure persists, rounded to few digits.
    fn move_to_base(&mut self, kept: &mut [Parameter], place: usize, seed: Option<u64>) -> Option<FlightRecord> {
        let Cell::Number(failing) = kept[place].cell else {
            return None;
        };
        let (key, _) = kept[place].set.first()?;
        let base = value_at(self.campaign.base(), key);
        let base = base.and_then(|value| value.as_float().or(value.as_integer().map(|x| x as f64)));
        let mut record = None;
        let (mut bad, mut good) = (failing, base);
        let halvings = if base.is_some() { HALVINGS } else { 0 };
        for _ in 0..halvings {
            let Some(end) = good else { break };
            let middle = 0.5 * (bad + end);
            match self.with_number(kept, place, middle, seed) {
                Some(found) => (bad, record) = (middle, Some(found)),
                None => good = Some(middle),
            }
        }
        let few = rounded(bad);
        if few != bad
            && let Some(found) = self.with_number(kept, place, few, seed)
        {
            (bad, record) = (few, Some(found));
        }
        set_number(&mut kept[place], bad);
        record
    }

    fn with_number(&mut self, kept: &[Parameter], place: usize, x: f64, seed: Option<u64>) -> Option<FlightRecord> {
        let mut changed = kept.to_vec();
        set_number(&mut changed[place], x);
        let table = self.table(&changed, seed)?;
        self.fails(&table)
    }
}

fn set_number(parameter: &mut Parameter, x: f64) {
    parameter.cell = Cell::Number(x);
    for (_, value) in &mut parameter.set {
        *value = Value::Float(x);
    }
}

/// Rounds to three significant digits.
fn rounded(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}

fn words(failure: Failure, record: &FlightRecord, criteria: &Criteria) -> String {
    let Some(score) = record.detectors.first() else {
        return failure.as_str().to_owned();
    };
    match failure {
        Failure::FalseAlarm => format!(
            "{} false alarm(s), {} windows, while no rotor is faulty",
            score.false_alarm_events, score.false_alarm_windows
        ),
        Failure::WrongRotor => format!(
            "a healthy rotor is named in {} windows after the onset",
            score.wrong_rotor
        ),
        Failure::Missed => "the fault is never isolated".to_owned(),
        Failure::Late => format!(
            "the fault is isolated after {:.3} s, later than {} s",
            score.isolated_after_s().unwrap_or(f64::NAN),
            criteria.late_after_s
        ),
    }
}

/// Writes a case as a separate scenario; returns its path. Its paths are made relative to `folder`, which must exist.
pub fn write_case(campaign: &Campaign, case: &Case, number: usize, folder: &Path) -> Result<PathBuf, String> {
    let name = format!("{}-{}-{number}", campaign.document().name, case.failure.as_str());
    let mut table = case.scenario.clone();
    table.insert("name".to_owned(), Value::String(name.clone()));
    table.insert(
        "description".to_owned(),
        Value::String(format!("Sequential detector: {}", case.words)),
    );
    for key in ["vehicle", "fdi.network"] {
        if let Some(path) = value_at(&table, key).and_then(Value::as_str) {
            let target = campaign.directory().join(path);
            let path = relative(&target, folder).map_err(|error| format!("{}: {error}", target.display()))?;
            set_value(&mut table, key, Value::String(path))?;
        }
    }
    let kept: Vec<String> = case
        .kept
        .iter()
        .map(|(axis, cell)| format!("{axis} = {cell}"))
        .collect();
    let kept = match (kept.is_empty(), case.own_seed) {
        (true, false) => "nothing: the base itself fails".to_owned(),
        (true, true) => "the seed".to_owned(),
        (false, own_seed) => {
            kept.join(", ")
                + if own_seed {
                    ", and the seed"
                } else {
                    "; any seed will do"
                }
        }
    };
    let text = toml::to_string(&table).map_err(|error| error.to_string())?;
    let text = format!(
        "# Where the sequential detector fails: {}.\n# Found by: {} --hunt\n# What matters, against the base of that \
         campaign: {kept}.\n# See it: rotortwin fly THIS_FILE --link in-process\n\n{text}",
        case.words,
        campaign.command()
    );
    let path = folder.join(format!("{name}.toml"));
    super::folder::write_whole(&path, text.as_bytes())?;
    Ok(path)
}

/// `target` relative to `folder`; both must exist.
fn relative(target: &Path, folder: &Path) -> std::io::Result<String> {
    let (target, folder) = (target.canonicalize()?, folder.canonicalize()?);
    let shared = target
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let path: PathBuf = up.chain(target.components().skip(shared)).collect();
    Ok(path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::engine::{OneByOne, SideBySide};
    use rotortwin_scenario::Scenario;

    /// The detector is blind to tiny losses: 0.05 % is below what it ever reports, so it is missed whatever else is drawn.
    const BLIND: &str = "name = 'blind'\ndescription = 'd'\nscenario = 'SCENARIO'\nflights = 10\n\
        [set]\nduration_s = 14.0\nfault = [{ time_s = 11.0, rotor = 2, thrust_loss_percent = 20.0 }]\n\
        [[axis]]\nname = 'charge'\nkey = 'initial.state_of_charge'\nuniform = [0.5, 1.0]\n\
        [[axis]]\nname = 'rotor'\nkey = 'fault[0].rotor'\nrotors = true\npick = 'any'\n\
        [[axis]]\nname = 'loss'\nkey = 'fault[0].thrust_loss_percent'\nlog_uniform = [0.01, 20.0]\n";

    #[test]
    fn scenario_a_miss_is_shrunk_to_the_loss_alone() {
        let folder = tempfile::tempdir().expect("writable");
        let base = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios/hover.toml");
        let file = folder.path().join("blind.toml");
        std::fs::write(&file, BLIND.replace("SCENARIO", &base.display().to_string())).expect("writable");
        let campaign = Campaign::load(&file).expect("a good campaign");
        let options = HuntOptions {
            seed: 1,
            budget: 24,
            cases: 1,
            threads: NonZeroUsize::MIN,
        };
        let go = |engine: &dyn FlightEngine| hunt(&campaign, engine, &options, &AtomicBool::new(false), &|| ());
        let hunt = go(&OneByOne);
        assert_eq!(format!("{hunt:?}"), format!("{:?}", go(&SideBySide::default())));
        let case = hunt.cases.first().expect("small losses are missed");
        assert_eq!(case.failure, Failure::Missed);
        let names: Vec<&str> = case.kept.iter().map(|(axis, _)| axis.as_str()).collect();
        assert_eq!((names, case.own_seed), (vec!["loss"], false));
        let path = write_case(&campaign, case, 1, folder.path()).expect("written");
        let scenario = Scenario::load(&path).expect("a scenario that can be flown");
        let record = fly_scenario(&campaign, &OneByOne, scenario).expect("it flies");
        assert_eq!(
            Failure::of(&record, &campaign.document().criteria),
            Some(Failure::Missed)
        );
    }
}
