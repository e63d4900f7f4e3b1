//! Preset `faults`: damaged rotors of all kinds in the independent world, judged window by window by the detectors.
//!
//! ```text
//!  n, seed ─▶ FaultCase ─▶ flight (here) ─▶ log ─▶ `fdi-log LOG --model VEHICLE --windows --json` ─▶ windows ─▶ FaultRow ─▶ faults_sheet
//! ```
//! The detectors see the log and the vehicle document. Every case has the rotors' lift bias, the noise and the disturbances of the other
//! presets; the classes `five …` have five unknown effects of the catalogue, wind and gusts on top.
//!
//! Definitions. *Right*: the verdict names exactly the rotors that have lost at least [`SEEN`] of their thrust at that
//! time. *First*: end of the first correct window, counted from when a loss passes [`SEEN`]. *Settled*: end of the last
//! window that is not right before the end of the flight, or before the loss ends. *Announced*: see [`is_announced`].
//! *Inside*: the truth at that time lies in the 95 % interval of each named rotor, at the end of the flight; *windows
//! inside*, the same over all windows that name the rotors correctly, separately for those in which the loss changes.
//! *Isolated* ([`ISOLATED_S`]): of a ramp, the first correct window comes at most this long after the loss has passed the
//! detectable size: `smallest_loss` of the last window that announced one. *Load named*: a window has a `load` that
//! changed at that time; *false load*: at any other. *Healthy named*: a rotor without a loss is named, alone or in a
//! pair, with a probability of 0.95 or more. *False alarm*: a verdict other than healthy begins while nothing has
//! happened to any rotor or to the load, nor a quarter of a second before. *End*: the last verdict ([`End`]).

use super::cases::Preset;
use super::run::{Program, run_process};
use crate::catalogue::{self, KINDS, Place};
use crate::draw::{draw_effect, same_group};
use crate::error::{BlindError, Result};
use crate::flight::{FlightPlan, Row, fly};
use crate::hidden::{Hidden, Profile};
use crate::log_file;
use crate::random::Stream;
use crate::script::Script;
use crate::vehicle::Vehicle;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A loss below this share is not required to be found.
pub const SEEN: f64 = 0.02;
/// A verdict may be as old as a window and a bit when the truth changes, s.
const GRACE_S: f64 = 0.25;
/// Time within which a loss must be found, s.
pub(super) const WITHIN_S: f64 = 10.0;
/// Time after passing the announced size within which a ramp must be isolated, s.
pub(super) const ISOLATED_S: f64 = 2.0;
/// Largest error of the reported time of a load, s.
const SAME_CHANGE_S: f64 = 1.0;
/// A name with this probability is meant.
const SURE: f64 = 0.95;
/// Idling on the ground, s.
const IDLE_S: f64 = 15.0;
/// Shortest flight: a start on the ground, a calibration, an onset, and time to judge it, s.
pub const SHORTEST_S: f64 = 60.0;
/// Flights before a case that the pilot loses is given up.
const FLIGHTS: u64 = 4;

/// What kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "each is described by its words")]
pub enum Class {
    Healthy,
    Step,
    Ramp,
    Intermittent,
    Recovery,
    Gain,
    BladeDrag,
    TwoRotors,
    ThreeRotors,
    LoadDropped,
    FiveHealthy,
    FiveStep,
    GroundHealthy,
    GroundStep,
}

impl Class {
    /// Every class, in the order of the cases.
    pub const ALL: [Self; 14] = [
        Self::Healthy,
        Self::Step,
        Self::Ramp,
        Self::Intermittent,
        Self::Recovery,
        Self::Gain,
        Self::BladeDrag,
        Self::TwoRotors,
        Self::ThreeRotors,
        Self::LoadDropped,
        Self::FiveHealthy,
        Self::FiveStep,
        Self::GroundHealthy,
        Self::GroundStep,
    ];

    /// In a table.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Healthy => "healthy",
            Self::Step => "step",
            Self::Ramp => "ramp",
            Self::Intermittent => "intermittent",
            Self::Recovery => "recovery",
            Self::Gain => "gain",
            Self::BladeDrag => "step, blade drag",
            Self::TwoRotors => "two rotors",
            Self::ThreeRotors => "three rotors",
            Self::LoadDropped => "load dropped",
            Self::FiveHealthy => "five effects",
            Self::FiveStep => "five, step",
            Self::GroundHealthy => "from ground",
            Self::GroundStep => "from ground, step",
        }
    }
}

/// One case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FaultCase {
    /// From 0.
    pub index: usize,
    /// Kind of fault.
    pub class: Class,
    /// Vehicle document.
    pub vehicle: String,
    /// Built-in flight.
    pub flight: String,
    /// Seed of the flight.
    pub seed: u64,
    /// Length, s.
    pub duration_s: f64,
    /// On the ground at first, s.
    pub idle_s: Option<f64>,
    /// What is hidden: faults and, of some classes, effects.
    pub effects: Vec<Hidden>,
}

/// Losses of thrust at a time: rotor from 1, share of its thrust; gains are negative.
fn losses(effects: &[Hidden], time_s: f64) -> Vec<(usize, f64)> {
    let faults = effects.iter().filter(|effect| effect.id == "rotor-thrust-scale");
    faults
        .filter_map(|effect| {
            Some((
                effect.rotor?,
                -effect.parameters.get("share")? * effect.factor_at(time_s),
            ))
        })
        .filter(|(_, share)| *share != 0.0)
        .collect()
}

fn fault(rotor: usize, loss: f64, onset_s: f64, profile: Option<Profile>) -> Hidden {
    Hidden {
        id: "rotor-thrust-scale".to_owned(),
        rotor: Some(rotor),
        onset_s: Some(onset_s),
        profile,
        parameters: [("share".to_owned(), -loss)].into(),
    }
}

/// `n` cases of each class. Case k of a class depends on seed, class and k alone.
pub fn draw_cases(n: usize, seed: u64, duration_s: f64, vehicles: &[(String, usize)]) -> Vec<FaultCase> {
    (0..n * Class::ALL.len())
        .map(|index| {
            let (class, round) = (Class::ALL[index % Class::ALL.len()], index / Class::ALL.len());
            let mut random = Stream::new(seed, &format!("fault-{class:?}-{round}"));
            let (vehicle, rotors) = &vehicles[round % vehicles.len()];
            let ground = matches!(class, Class::GroundHealthy | Class::GroundStep);
            FaultCase {
                index,
                class,
                vehicle: vehicle.clone(),
                flight: ["hover", "waypoint"][round % 2].to_owned(),
                seed: seed.wrapping_mul(0x9e37_79b9).wrapping_add(index as u64 + 1) & 0xffff_ffff,
                duration_s,
                idle_s: ground.then_some(IDLE_S),
                effects: draw_effects(class, *rotors, duration_s, &mut random),
            }
        })
        .collect()
}

fn draw_effects(class: Class, rotors: usize, duration_s: f64, random: &mut Stream) -> Vec<Hidden> {
    let tenth = |value: f64| (10.0 * value).round() / 10.0;
    let rotor = 1 + random.below(rotors);
    let ground = if class == Class::GroundStep { IDLE_S + 4.0 } else { 0.0 };
    let onset_s = tenth(ground + random.between(15.0, 22.0));
    let loss = random.between(0.03, 0.2);
    let small = random.between(0.05, 0.1);
    let other = 1 + (rotor + random.below(rotors - 1)) % rotors;
    let profile = match class {
        Class::Ramp => Some(Profile::Ramp {
            ramp_s: [0.2, 1.0, 5.0, 20.0][random.below(4)],
        }),
        Class::Intermittent => Some(Profile::Intermittent {
            on_s: 0.5,
            every_s: 2.0,
        }),
        Class::Recovery => Some(Profile::Recovery { heals_after_s: 15.0 }),
        _ => None,
    };
    match class {
        Class::Healthy | Class::GroundHealthy => Vec::new(),
        Class::Step | Class::Ramp | Class::Intermittent | Class::Recovery => vec![fault(rotor, loss, onset_s, profile)],
        Class::GroundStep => vec![fault(rotor, small, onset_s, None)],
        Class::Gain => vec![fault(rotor, -small, onset_s, None)],
        Class::BladeDrag => {
            let mut drag = fault(rotor, 0.0, onset_s, None);
            drag.id = "rotor-moment-ratio".to_owned();
            drag.parameters
                .insert("share".to_owned(), [0.05, 0.1, 0.2, 0.3][random.below(4)]);
            vec![fault(rotor, loss, onset_s, None), drag]
        }
        Class::TwoRotors | Class::ThreeRotors => {
            let mut faults = vec![fault(rotor, loss, onset_s, None), fault(other, small, onset_s, None)];
            let third = (1..=rotors)
                .filter(|third| ![rotor, other].contains(third))
                .collect::<Vec<_>>();
            if class == Class::ThreeRotors {
                faults.push(fault(third[random.below(third.len())], small, onset_s, None));
            }
            faults
        }
        Class::LoadDropped => {
            let mut load = fault(1, 0.0, onset_s, None);
            (load.id, load.rotor) = ("mass".to_owned(), None);
            // 150 g of 1.55 kg and about.
            load.parameters.insert("share".to_owned(), -random.between(0.06, 0.12));
            vec![load]
        }
        Class::FiveHealthy => five_effects(rotors, random),
        Class::FiveStep => {
            let mut effects = five_effects(rotors, random);
            effects.push(fault(rotor, small, tenth(onset_s.min(0.5 * duration_s)), None));
            effects
        }
    }
}

/// Rows of the catalogue that five effects are drawn from. A new row would make every case of a seed another one, and the figures of
/// docs/detector.md are of these.
const ROWS_DRAWN: u8 = 56;

/// Wind with its rotor drag, gusts, and three more effects, none of which is a rotor's loss or a gross error.
fn five_effects(rotors: usize, random: &mut Stream) -> Vec<Hidden> {
    let kinds: Vec<_> = KINDS
        .iter()
        .filter(|kind| !matches!(kind.place, Place::Outside) && kind.companion.is_none() && kind.number != 35)
        .filter(|kind| kind.number <= ROWS_DRAWN)
        .filter(|kind| !["rotor-thrust-scale", "rotor-drag", "swapped-rotors", "reversed-spin"].contains(&kind.id))
        .collect();
    let mut effects = Vec::new();
    for id in ["wind", "gusts"] {
        if let Some(kind) = catalogue::kind(id) {
            for effect in draw_effect(kind, 1.0, rotors, random) {
                if !effects.iter().any(|other: &Hidden| other.id == effect.id) {
                    effects.push(effect);
                }
            }
        }
    }
    let mut drawn: Vec<&str> = Vec::new();
    while drawn.len() < 3 {
        let kind = kinds[random.below(kinds.len())];
        if !drawn.iter().any(|id| same_group(id, kind.id)) {
            drawn.push(kind.id);
            effects.extend(draw_effect(kind, 1.0, rotors, random));
        }
    }
    effects
}

/// Healthy flights of the vehicle of a case on `n` other days: its effects without those on rotors or load in the case,
/// weather drawn anew, kinds of flight in turn.
pub fn other_days(case: &FaultCase, n: usize) -> Vec<FaultCase> {
    let weather = |day: usize| {
        let mut random = Stream::new(case.seed, &format!("weather-{day}"));
        let drawn = ["wind", "gusts"].into_iter().filter_map(catalogue::kind);
        // The last of each is the effect itself; the ones it acts through belong to the vehicle.
        let drawn: Vec<Hidden> = drawn
            .filter_map(|kind| draw_effect(kind, 1.0, 1, &mut random).pop())
            .collect();
        drawn
    };
    let happens = |effect: &&Hidden| !["rotor-thrust-scale", "rotor-moment-ratio"].contains(&effect.id.as_str());
    (1..=n)
        .map(|day| {
            let today = weather(day);
            let mut effects: Vec<Hidden> = case.effects.iter().filter(happens).cloned().collect();
            for effect in &mut effects {
                if let Some(other) = today.iter().find(|other| other.id == effect.id) {
                    *effect = other.clone();
                }
            }
            FaultCase {
                flight: ["waypoint", "helix", "hover"][(day - 1) % 3].to_owned(),
                seed: Stream::new(case.seed, &format!("day-{day}")).below(1 << 31) as u64,
                effects,
                ..case.clone()
            }
        })
        .collect()
}

/// The last verdict compared with the rotors' actual losses or gains at that time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum End {
    /// The changed rotors, all and no others; healthy where none has changed.
    Right,
    /// Ambiguous, and one of the sets is the changed rotors.
    InSet,
    /// Unknown, or no verdict and why.
    Open,
    /// Healthy, and it is not.
    Missed,
    /// Other rotors, named or in sets.
    Wrong,
}

impl End {
    /// In progress.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Right => "correct",
            Self::InSet => "ambiguous",
            Self::Open => "open",
            Self::Missed => "missed",
            Self::Wrong => "wrong",
        }
    }
}

/// Windows in which the truth lay inside of the intervals, of all with intervals of the right rotors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WindowCount {
    /// Inside.
    pub inside: usize,
    /// Total number.
    pub of: usize,
}

impl WindowCount {
    fn add(&mut self, inside: bool) {
        self.inside += usize::from(inside);
        self.of += 1;
    }
}

/// What the detectors said of one case, scored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FaultRow {
    /// What was flown.
    pub case: FaultCase,
    /// Why there is no score; the rest is then empty.
    pub failure: Option<String>,
    /// First correct window after the loss has passed [`SEEN`], s.
    pub first_s: Option<f64>,
    /// From then on right to the end, s.
    pub settled_s: Option<f64>,
    /// Loss and interval of each rightly named rotor at the end hold the truth; `None`: the rotors are not named at the end.
    pub inside: Option<bool>,
    /// A rotor without a loss was named with a probability of 0.95 or more.
    pub healthy_named: bool,
    /// Alarms that began while no rotor had lost any thrust.
    pub false_alarms: usize,
    /// Time with a verdict in which no rotor had lost any thrust, s.
    pub healthy_s: f64,
    /// Time with a verdict, s.
    pub decided_s: f64,
    /// From the recovery to the first healthy verdict, s.
    pub released_s: Option<f64>,
    /// The loss was over before the end.
    pub recovers: bool,
    /// The last verdict; `None`: there is none.
    pub end: Option<End>,
    /// Of a single, sudden loss that was not found within [`WITHIN_S`]: that it might be missed was said ([`is_announced`]).
    #[serde(default)]
    pub announced: Option<bool>,
    /// For a ramp that passes the announced size: from then to the first correct window, s, negative before; infinite
    /// if there is none.
    #[serde(default)]
    pub past_announced_s: Option<f64>,
    /// From the change of a load to the window that names it, s, and whether its mass is inside.
    #[serde(default)]
    pub load_named_s: Option<f64>,
    /// See `load_named_s`.
    #[serde(default)]
    pub load_inside: Option<bool>,
    /// A load was named that did not change.
    #[serde(default)]
    pub false_load: bool,
    /// While the losses stand still.
    pub still: WindowCount,
    /// While a loss moves.
    pub moving: WindowCount,
}

/// A load that was named: when it changed and when it was named, s; interval of the mass, kg.
#[derive(Debug, Clone, Copy, PartialEq)]
struct NamedLoad {
    time_s: f64,
    named_s: f64,
    mass_kg: [f64; 2],
}

/// One window of the report.
#[derive(Debug, Clone)]
struct Window {
    time_s: f64,
    code: i32,
    probability: f64,
    /// Rotor, lower and upper end of the lost share.
    loss: Vec<(usize, f64, f64)>,
    /// Sets that an ambiguous verdict leaves open.
    sets: Vec<Vec<usize>>,
    /// Smallest lost share of each rotor that would be found; empty where nothing is promised.
    smallest: Vec<f64>,
    load: Option<NamedLoad>,
}

impl Window {
    fn read(value: &Value, start_s: f64) -> Option<Self> {
        let sequential = &value["sequential"];
        let loss = |loss: &Value| {
            let rotor = usize::try_from(loss["rotor"].as_u64()?).ok()?;
            Some((rotor, loss["share_low"].as_f64()?, loss["share_high"].as_f64()?))
        };
        let set = |set: &Value| -> Option<Vec<usize>> {
            let rotors = set
                .as_array()?
                .iter()
                .map(|rotor| usize::try_from(rotor.as_u64()?).ok());
            rotors.collect()
        };
        let load = &value["load"];
        let named = || {
            Some(NamedLoad {
                time_s: load["time_s"].as_f64()? + start_s,
                named_s: load["named_s"].as_f64()? + start_s,
                mass_kg: [load["mass_kg"]["low"].as_f64()?, load["mass_kg"]["high"].as_f64()?],
            })
        };
        Some(Self {
            load: named(),
            smallest: value["smallest_loss"]
                .as_array()
                .map_or_else(Vec::new, |all| all.iter().filter_map(Value::as_f64).collect()),
            sets: sequential["hypotheses"]
                .as_array()?
                .iter()
                .map(set)
                .collect::<Option<_>>()?,
            time_s: value["time_s"].as_f64()? + start_s,
            code: i32::try_from(sequential["code"].as_i64()?).ok()?,
            probability: sequential["probability"].as_f64()?,
            loss: sequential["thrust_loss"]
                .as_array()?
                .iter()
                .map(loss)
                .collect::<Option<_>>()?,
        })
    }

    fn named(&self) -> Vec<usize> {
        match usize::try_from(self.code) {
            Ok(code @ 1..100) => vec![code],
            Ok(code @ 100..) => vec![code / 100, code % 100],
            _ => Vec::new(),
        }
    }

    fn decided(&self) -> bool {
        !matches!(self.code, -2 | -4)
    }
}

/// Scores the report of the detectors.
///
/// # Errors
/// The report lacks a field.
pub fn score(case: &FaultCase, report: &str) -> std::result::Result<FaultRow, String> {
    let value: Value = serde_json::from_str(report).map_err(|error| format!("the report is no JSON: {error}"))?;
    let start_s = value["log"]["start_s"]
        .as_f64()
        .ok_or("the report has no log.start_s")?;
    let windows = value["windows"].as_array().ok_or("the report has no `windows`")?;
    let windows: Option<Vec<Window>> = windows.iter().map(|window| Window::read(window, start_s)).collect();
    let windows = windows.ok_or("a window of the report lacks time, code, probability or losses")?;
    let samples = value["detectors"]["window_samples"].as_f64();
    let window_s = samples.zip(value["judged_rate_hz"].as_f64()).map(|(n, hz)| n / hz);
    let window_s = window_s.ok_or("the report has no detectors.window_samples and judged_rate_hz")?;
    Ok(scored(case, &windows, window_s))
}

/// Rotors from 1 whose thrust has changed by at least [`SEEN`].
fn changed(effects: &[Hidden], time_s: f64) -> Vec<usize> {
    let mut rotors: Vec<usize> = losses(effects, time_s)
        .into_iter()
        .filter(|(_, loss)| loss.abs() >= SEEN)
        .map(|(rotor, _)| rotor)
        .collect();
    rotors.sort_unstable();
    rotors
}

/// The score of the last window with a verdict.
fn end_of(case: &FaultCase, windows: &[Window]) -> Option<End> {
    let last = windows.iter().rfind(|window| window.code != -2)?;
    let (now, before) = (
        changed(&case.effects, last.time_s),
        changed(&case.effects, last.time_s - GRACE_S),
    );
    let mut named = last.named();
    named.sort_unstable();
    let is = |set: &Vec<usize>| *set == now || *set == before;
    Some(match last.code {
        0 if now.is_empty() || before.is_empty() => End::Right,
        0 => End::Missed,
        -1 | -4 => End::Open,
        -3 if last.sets.iter().any(is) && !now.is_empty() => End::InSet,
        _ if !named.is_empty() && is(&named) => End::Right,
        _ => End::Wrong,
    })
}

/// Whether it was said that a loss of this rotor from `onset_s` on might be missed: the last window before had no verdict, or a smallest loss that
/// would be found which is above the loss; or most of the windows of [`WITHIN_S`] after it have no verdict.
fn is_announced(case: &FaultCase, all: &[Window], rotor: usize, onset_s: f64) -> bool {
    let later = losses(&case.effects, onset_s + WITHIN_S);
    let lost = later
        .iter()
        .find(|(other, _)| *other == rotor)
        .map_or(0.0, |loss| loss.1);
    let before = all.iter().rfind(|window| window.time_s < onset_s);
    let promised = before
        .filter(|window| window.decided())
        .and_then(|window| window.smallest.get(rotor - 1));
    let after = || {
        let asked = |window: &&Window| (onset_s..onset_s + WITHIN_S).contains(&window.time_s);
        all.iter().filter(asked)
    };
    let decided = after().filter(|window| window.decided()).count();
    match promised {
        Some(smallest) => *smallest >= lost || 2 * decided < after().count(),
        None => before.is_none_or(|window| !window.decided()),
    }
}

fn scored(case: &FaultCase, all: &[Window], window_s: f64) -> FaultRow {
    let windows: Vec<Window> = all.iter().filter(|window| window.decided()).cloned().collect();
    let windows = windows.as_slice();
    let lost = |time_s: f64| -> Vec<usize> {
        let seen = losses(&case.effects, time_s)
            .into_iter()
            .filter(|(_, loss)| *loss >= SEEN);
        let mut rotors: Vec<usize> = seen.map(|(rotor, _)| rotor).collect();
        rotors.sort_unstable();
        rotors
    };
    // A gain and a dropped load are not false alarms either.
    let any = |time_s: f64| {
        let has_changed = |effect: &Hidden| effect.onset_s.is_some_and(|onset_s| time_s >= onset_s);
        !losses(&case.effects, time_s).is_empty()
            || case.class == Class::LoadDropped && case.effects.iter().any(has_changed)
    };
    let steps = || (0..(case.duration_s / 0.01) as usize).map(|k| 0.01 * k as f64);
    let onset_s = steps().find(|time| !lost(*time).is_empty());
    let last_s = steps().rfind(|time| !lost(*time).is_empty());
    let recovers = case.class == Class::Recovery;
    let mut row = empty(case, None);
    row.recovers = recovers;
    row.end = end_of(case, all);
    let right = |window: &Window| {
        let mut named = window.named();
        named.sort_unstable();
        !named.is_empty() && (named == lost(window.time_s) || named == lost(window.time_s - GRACE_S))
    };
    if let (Some(onset_s), Some(last_s)) = (onset_s, last_s) {
        let during: Vec<&Window> = windows
            .iter()
            .filter(|window| window.time_s >= onset_s && window.time_s <= last_s + 0.01)
            .collect();
        row.first_s = during
            .iter()
            .find(|window| right(window))
            .map(|window| window.time_s - onset_s);
        // A smallest loss is that of a sudden one.
        let stands = losses(&case.effects, onset_s) == losses(&case.effects, onset_s + WITHIN_S);
        if let [rotor] = lost(onset_s)[..]
            && stands
            && row.first_s.is_none_or(|first_s| first_s > WITHIN_S)
        {
            row.announced = Some(is_announced(case, all, rotor, onset_s));
        }
        // An intermittent loss is not to be right while it is away.
        let asked = |window: &&&Window| !lost(window.time_s).is_empty();
        let judged: Vec<&&Window> = during.iter().filter(asked).collect();
        if judged.last().is_some_and(|window| right(window)) && case.class != Class::Intermittent {
            let wrong = judged.iter().rev().find(|window| !right(window));
            row.settled_s = Some(wrong.map_or(row.first_s.unwrap_or(0.0), |window| window.time_s - onset_s + window_s));
        }
        let holds = |window: &Window| {
            let truth = losses(&case.effects, window.time_s);
            let hold = |(rotor, low, high): &(usize, f64, f64)| {
                truth
                    .iter()
                    .any(|(lost, loss)| lost == rotor && (low..=high).contains(&loss))
            };
            !window.loss.is_empty() && window.loss.iter().all(hold)
        };
        row.inside = judged.last().filter(|window| right(window)).map(|last| holds(last));
        for window in judged.iter().filter(|window| right(window)) {
            let (now, before) = (
                losses(&case.effects, window.time_s),
                losses(&case.effects, window.time_s - GRACE_S),
            );
            let count = if now == before { &mut row.still } else { &mut row.moving };
            count.add(holds(window));
        }
        if recovers {
            let after = windows.iter().find(|window| window.time_s > last_s && window.code == 0);
            row.released_s = after.map(|window| window.time_s - last_s);
        }
    }
    if case.class == Class::Ramp
        && let [effect] = &case.effects[..]
        && let Some(rotor) = effect.rotor
    {
        row.past_announced_s = past_announced(case, all, rotor);
    }
    score_loads(&mut row, all);
    let mut alarmed = false;
    for window in windows {
        let now = losses(&case.effects, window.time_s);
        let before = losses(&case.effects, window.time_s - GRACE_S);
        let is_lost = |rotor: &usize| {
            now.iter()
                .chain(&before)
                .any(|(other, loss)| other == rotor && *loss > 0.0)
        };
        row.healthy_named |= window.probability >= SURE && window.named().iter().any(|rotor| !is_lost(rotor));
        let alarm = window.code != 0;
        row.decided_s += window_s;
        // Time after a recovery is scored by the release.
        let is_over = !any(window.time_s) && !any(window.time_s - GRACE_S);
        if is_over && last_s.is_none_or(|last_s| window.time_s < last_s) {
            row.healthy_s += window_s;
            row.false_alarms += usize::from(alarm && !alarmed);
        }
        alarmed = alarm;
    }
    row
}

fn empty(case: &FaultCase, failure: Option<String>) -> FaultRow {
    FaultRow {
        case: case.clone(),
        failure,
        first_s: None,
        settled_s: None,
        inside: None,
        healthy_named: false,
        false_alarms: 0,
        healthy_s: 0.0,
        decided_s: 0.0,
        released_s: None,
        recovers: false,
        end: None,
        announced: None,
        past_announced_s: None,
        load_named_s: None,
        load_inside: None,
        false_load: false,
        still: WindowCount::default(),
        moving: WindowCount::default(),
    }
}

/// From when a growing loss of a rotor passes the detectable size to the first window that names the rotor, s; infinite
/// without one, none if it does not pass it.
fn past_announced(case: &FaultCase, all: &[Window], rotor: usize) -> Option<f64> {
    let lost = |time_s: f64| {
        let of_rotor = losses(&case.effects, time_s)
            .into_iter()
            .find(|(other, _)| *other == rotor);
        of_rotor.map_or(0.0, |(_, loss)| loss)
    };
    let mut announced = None;
    let mut passed_s = None;
    for window in all {
        // Nothing is announced while something is wrong: the last size stands.
        announced = window.smallest.get(rotor - 1).copied().or(announced);
        if announced.is_some_and(|size| lost(window.time_s) >= size) {
            passed_s = Some(window.time_s);
            break;
        }
    }
    let passed_s = passed_s?;
    let is_right = |window: &&Window| window.named() == [rotor] && lost(window.time_s) > 0.0;
    let first = all.iter().find(is_right);
    Some(first.map_or(f64::INFINITY, |window| window.time_s - passed_s))
}

/// What was said of loads. The generator's vehicle has the mass of its document; of a load only the share of it is drawn.
fn score_loads(row: &mut FaultRow, all: &[Window]) {
    let truth = row
        .case
        .effects
        .iter()
        .find(|effect| effect.id == "mass" && effect.onset_s.is_some());
    let truth = truth.and_then(|effect| Some((effect.onset_s?, *effect.parameters.get("share")?)));
    let mass_kg = Vehicle::load(Path::new(&row.case.vehicle))
        .ok()
        .map(|vehicle| vehicle.mass);
    let mut last = None;
    for load in all.iter().filter_map(|window| window.load) {
        if last.replace(load.named_s) == Some(load.named_s) {
            continue;
        }
        match truth {
            Some((onset_s, share)) if (load.time_s - onset_s).abs() < SAME_CHANGE_S => {
                row.load_named_s.get_or_insert(load.named_s - onset_s);
                let [low, high] = load.mass_kg;
                let inside = mass_kg.map(|mass_kg| (low..=high).contains(&(share * mass_kg)));
                row.load_inside = row.load_inside.or(inside);
            }
            _ => row.false_load = true,
        }
    }
}

/// A bench of faults on disk; a stopped one resumes there.
pub struct FaultBench {
    /// Folder of the results.
    pub folder: PathBuf,
    /// Cases of each class.
    pub n: usize,
    /// Seed of the random draws.
    pub seed: u64,
    /// Vehicle documents, used in turn.
    pub vehicles: Vec<String>,
    /// Length of a flight, s.
    pub duration_s: f64,
    /// Judges: `{log}` and `{vehicle}` are replaced, the report comes out as JSON.
    pub detectors: Program,
    /// Keep the generated logs.
    pub keep_logs: bool,
}

impl FaultBench {
    /// Its cases.
    ///
    /// # Errors
    /// Nothing is requested, flights are too short, a vehicle cannot be read.
    pub fn cases(&self) -> Result<Vec<FaultCase>> {
        let refuse = |place: &str, reason: String| Err(BlindError::input(place, reason));
        if self.n == 0 {
            return refuse("n", "is 0; expected at least one case of each class".to_owned());
        }
        if !(SHORTEST_S..=3600.0).contains(&self.duration_s) {
            return refuse(
                "duration_s",
                format!("is {}; expected {SHORTEST_S} to 3600 s for faults", self.duration_s),
            );
        }
        let counted = self.vehicles.iter().map(|path| {
            let vehicle = Vehicle::load(Path::new(path))?;
            Ok((path.clone(), vehicle.rotors.len()))
        });
        Ok(draw_cases(
            self.n,
            self.seed,
            self.duration_s,
            &counted.collect::<Result<Vec<_>>>()?,
        ))
    }

    /// The row of a case that was scored before.
    fn row_of(&self, case: &FaultCase) -> Option<FaultRow> {
        let text = std::fs::read_to_string(self.path_of(case)).ok()?;
        let row: FaultRow = serde_json::from_str(&text).ok()?;
        (row.case == *case).then_some(row)
    }

    fn path_of(&self, case: &FaultCase) -> PathBuf {
        self.folder.join(format!("rows/fault-{:05}.json", case.index))
    }

    /// Number of cases that have a row.
    pub fn present(&self, cases: &[FaultCase]) -> usize {
        cases.iter().filter(|case| self.row_of(case).is_some()).count()
    }

    /// Flies and scores every case that has no row yet; `progress` is called after each with its row.
    ///
    /// # Errors
    /// The folder cannot be written, or belongs to another request.
    pub fn run(&self, cases: &[FaultCase], progress: &mut dyn FnMut(&FaultRow)) -> Result<Vec<FaultRow>> {
        for part in ["logs", "answers", "rows"] {
            let path = self.folder.join(part);
            std::fs::create_dir_all(&path).map_err(|source| BlindError::file("creating", path, source))?;
        }
        let mut rows = Vec::with_capacity(cases.len());
        for case in cases {
            let row = match self.row_of(case) {
                Some(row) => row,
                None => {
                    let path = self.path_of(case);
                    let row = self.judged(case)?;
                    let text = serde_json::to_string_pretty(&row)
                        .map_err(|error| BlindError::input(path.display().to_string(), error.to_string()))?;
                    std::fs::write(&path, text + "\n").map_err(|source| BlindError::file("writing", &path, source))?;
                    progress(&row);
                    row
                }
            };
            rows.push(row);
        }
        Ok(rows)
    }

    fn judged(&self, case: &FaultCase) -> Result<FaultRow> {
        let log = self.folder.join(format!("logs/fault-{:05}.parquet", case.index));
        let stem = self.folder.join(format!("answers/fault-{:05}", case.index));
        if let Err(error) = fly_case(case).and_then(|rows| log_file::write(&log, &rows)) {
            return match error {
                BlindError::FlightLost { .. } => Ok(empty(case, Some(format!("{error}, {FLIGHTS} times")))),
                other => Err(other),
            };
        }
        let replaced = |text: &String| {
            text.replace("{log}", &log.display().to_string())
                .replace("{vehicle}", &case.vehicle)
        };
        let program = Program {
            words: self.detectors.words.iter().map(replaced).collect(),
            ..self.detectors
        };
        let answer = stem.with_extension("json");
        let report = run_process(&program, &answer, &stem.with_extension("err"))
            .and_then(|()| std::fs::read_to_string(&answer).map_err(|error| error.to_string()))
            .and_then(|text| score(case, &text));
        for path in [Some(&answer), (!self.keep_logs).then_some(&log)].into_iter().flatten() {
            if let Err(source) = std::fs::remove_file(path) {
                return Err(BlindError::file("removing", path, source));
            }
        }
        Ok(report.unwrap_or_else(|reason| empty(case, Some(reason))))
    }
}

/// Flies a case; with another seed where the pilot loses it.
///
/// # Errors
/// The vehicle cannot be read, or every flight was lost.
pub fn fly_case(case: &FaultCase) -> Result<Vec<Row>> {
    let vehicle = Vehicle::load(Path::new(&case.vehicle))?;
    let mut attempt = 0;
    loop {
        let seed = case.seed ^ (attempt << 32);
        let script = Script::built_in(&case.flight, seed)
            .ok_or_else(|| BlindError::input("flight", format!("there is no `{}`", case.flight)))?;
        let script = if case.idle_s.is_some() {
            script.from_the_ground()
        } else {
            script
        };
        let plan = FlightPlan {
            effects: case.effects.clone(),
            idle_s: case.idle_s,
            ..FlightPlan::new(vehicle.clone(), script, case.duration_s, seed)
        };
        match fly(&plan) {
            Ok((rows, _)) => return Ok(rows),
            Err(BlindError::FlightLost { .. }) if attempt + 1 < FLIGHTS => attempt += 1,
            Err(error) => return Err(error),
        }
    }
}

/// What a report calls it.
pub const NAME: &str = Preset::Faults.name();

#[cfg(test)]
mod tests {
    use super::*;

    /// s of a window.
    const WINDOW_S: f64 = 0.0625;

    fn case(effects: Vec<Hidden>, class: Class) -> FaultCase {
        FaultCase {
            index: 0,
            class,
            vehicle: "f550.toml".to_owned(),
            flight: "hover".to_owned(),
            seed: 1,
            duration_s: 60.0,
            idle_s: None,
            effects,
        }
    }

    /// Windows from 10 s on with the values of a function: code, probability, lower and upper end.
    fn windows(say: impl Fn(f64) -> (i32, f64, f64, f64)) -> Vec<Window> {
        (160..960)
            .map(|k| {
                let time_s = WINDOW_S * f64::from(k);
                let (code, probability, low, high) = say(time_s);
                let rotor = usize::try_from(code).unwrap_or(0);
                let loss = if rotor > 0 {
                    vec![(rotor, low, high)]
                } else {
                    Vec::new()
                };
                Window {
                    time_s,
                    code,
                    probability,
                    loss,
                    sets: Vec::new(),
                    smallest: Vec::new(),
                    load: None,
                }
            })
            .collect()
    }

    #[test]
    fn val_a_step_named_late_and_once_wrongly() {
        let case = case(vec![fault(2, 0.1, 20.0, None)], Class::Step);
        let row = scored(
            &case,
            &windows(|t| match t {
                t if t < 12.0 => (0, 1.0, 0.0, 0.0),
                t if t < 13.0 => (5, 0.5, 0.01, 0.02),
                t if t < 21.0 => (0, 1.0, 0.0, 0.0),
                t if (30.0..31.0).contains(&t) => (3, 0.97, 0.08, 0.12),
                _ => (2, 0.99, 0.09, 0.11),
            }),
            WINDOW_S,
        );
        assert_eq!((row.false_alarms, row.healthy_named, row.inside), (1, true, Some(true)));
        assert_eq!((row.first_s, row.settled_s), (Some(1.0), Some(11.0)));
        assert!((row.healthy_s - 10.0).abs() < 0.1, "{}", row.healthy_s);
    }

    #[test]
    fn val_a_ramp_counts_from_the_size_that_is_asked_for() {
        let ramp = Some(Profile::Ramp { ramp_s: 20.0 });
        let case = case(vec![fault(4, 0.1, 20.0, ramp)], Class::Ramp);
        // 2 % at 24 s.
        let row = scored(
            &case,
            &windows(|t| {
                if t < 26.0 {
                    (0, 1.0, 0.0, 0.0)
                } else {
                    (4, 1.0, 0.02, 0.05)
                }
            }),
            WINDOW_S,
        );
        assert!((row.first_s.unwrap() - 2.0).abs() < 0.02, "{:?}", row.first_s);
        assert_eq!((row.inside, row.healthy_named), (Some(false), false));
    }

    #[test]
    fn val_a_ramp_is_isolated_from_the_announced_size_on() {
        // 10 % over 20 s from 20 s on: 3 % at 26 s.
        let ramp = Some(Profile::Ramp { ramp_s: 20.0 });
        let case = case(vec![fault(2, 0.1, 20.0, ramp)], Class::Ramp);
        let past = |named_s: f64, announced: f64| {
            let mut windows = windows(|t| {
                if t < named_s {
                    (0, 1.0, 0.0, 0.0)
                } else {
                    (2, 1.0, 0.0, 1.0)
                }
            });
            for window in &mut windows {
                window.smallest = if window.code == 0 {
                    vec![announced; 6]
                } else {
                    Vec::new()
                };
            }
            scored(&case, &windows, WINDOW_S).past_announced_s
        };
        assert!((past(27.0, 0.03).unwrap() - 1.0).abs() < 0.07, "{:?}", past(27.0, 0.03));
        assert!((past(25.0, 0.03).unwrap() + 1.0).abs() < 0.07, "{:?}", past(25.0, 0.03));
        assert_eq!(past(100.0, 0.03), Some(f64::INFINITY));
        assert_eq!(past(25.0, 0.11), None, "it was not to be seen");
    }

    #[test]
    fn val_a_load_is_named_at_its_time_and_a_false_one_is_not_it() {
        let mut load = fault(1, 0.0, 20.0, None);
        (load.id, load.rotor) = ("mass".to_owned(), None);
        load.parameters.insert("share".to_owned(), -0.1);
        let mut case = case(vec![load], Class::LoadDropped);
        case.vehicle = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml").to_owned();
        let row = |time_s: f64, mass_kg: [f64; 2]| {
            let mut windows = windows(|_| (0, 1.0, 0.0, 0.0));
            for window in windows.iter_mut().filter(|window| window.time_s >= 23.0) {
                window.load = Some(NamedLoad {
                    time_s,
                    named_s: 23.0,
                    mass_kg,
                });
            }
            let row = scored(&case, &windows, WINDOW_S);
            (row.load_named_s, row.load_inside, row.false_load)
        };
        assert_eq!(row(20.1, [-0.16, -0.15]), (Some(3.0), Some(true), false));
        assert_eq!(row(20.1, [0.15, 0.16]), (Some(3.0), Some(false), false));
        assert_eq!(row(14.0, [-0.16, -0.15]), (None, None, true));
    }

    #[test]
    fn val_a_miss_is_announced_where_less_was_promised() {
        let case = case(vec![fault(2, 0.1, 20.0, None)], Class::Step);
        let row = |smallest: &[f64], code: i32| {
            let mut windows = windows(|_| (0, 1.0, 0.0, 0.0));
            for window in &mut windows {
                window.smallest = smallest.to_vec();
                if window.time_s > 20.0 {
                    window.code = code;
                }
            }
            scored(&case, &windows, WINDOW_S).announced
        };
        assert_eq!(row(&[0.01, 0.11, 0.01], 0), Some(true), "11 % is promised, 10 % lost");
        assert_eq!(row(&[0.11, 0.01, 0.11], 0), Some(false), "1 % is promised");
        assert_eq!(row(&[0.11, 0.01, 0.11], -4), Some(true), "it cannot judge then");
        assert_eq!(row(&[], 0), Some(false), "nothing is said");
        assert_eq!(row(&[0.01; 3], 2), None, "found");
    }

    #[test]
    fn val_a_recovery_is_released() {
        let heals = Some(Profile::Recovery { heals_after_s: 15.0 });
        let case = case(vec![fault(1, 0.05, 20.0, heals)], Class::Recovery);
        let row = scored(
            &case,
            &windows(|t| {
                if (20.5..35.7).contains(&t) {
                    (1, 1.0, 0.04, 0.06)
                } else {
                    (0, 1.0, 0.0, 0.0)
                }
            }),
            WINDOW_S,
        );
        assert!((row.released_s.unwrap() - 0.75).abs() < 0.07, "{:?}", row.released_s);
        assert_eq!((row.inside, row.settled_s), (Some(true), row.first_s));
    }

    #[test]
    fn prop_cases_repeat_and_every_class_is_drawn_alike() {
        let vehicles = [("f550.toml".to_owned(), 6)];
        let cases = draw_cases(6, 3, 60.0, &vehicles);
        assert_eq!(cases[..28], draw_cases(2, 3, 60.0, &vehicles));
        for case in &cases {
            assert!(case.effects.iter().all(|effect| effect.check(6).is_ok()), "{case:?}");
            let lost = losses(&case.effects, 59.0).len();
            let expected = match case.class {
                Class::TwoRotors => 2,
                Class::ThreeRotors => 3,
                Class::Healthy | Class::FiveHealthy | Class::GroundHealthy | Class::LoadDropped | Class::Recovery => 0,
                // It may be away just then.
                Class::Intermittent => lost,
                _ => 1,
            };
            assert_eq!(lost, expected, "{case:?}");
        }
    }
}
