//! Effects that could not be considered, because of the logs or the model, each with the column or setting that would
//! change that.
//!
//! This differs from an effect that was considered and does not show, for which a larger size, or another manoeuvre,
//! would help ([`super::ranking::detectable`]).

use rotortwin_plant::effects::{ChannelGroup, EffectClass, EffectDeclaration, Requirement, Strategy};

use super::result::{Diagnosis, NotConsidered, Reason};
use crate::estimation::columns::LogState;
use crate::estimation::problem::Problem;
use crate::log::names;
use crate::predict::channels::group;
use crate::predict::{CHANNELS, Drive, Predictor};

/// Every effect that could not be considered, in the order of the catalogue. Nuisances are fitted, not considered.
pub(crate) fn not_considered(problem: &Problem, diagnosis: &Diagnosis) -> Vec<NotConsidered> {
    let Some(first) = problem.logs.first() else {
        return Vec::new();
    };
    let found = diagnosis.effects.iter().chain(&diagnosis.sensor_or_timing);
    let found: Vec<&str> = found.map(|finding| finding.instance.effect.as_str()).collect();
    let entries = first.predictor.catalogue().entries().iter().copied();
    let possible = entries.filter(|entry| entry.class != EffectClass::Nuisance && !found.contains(&entry.id));
    possible
        .filter_map(|entry| {
            let reason = reason(problem, diagnosis, entry)?;
            Some(NotConsidered {
                effect: entry.id.to_owned(),
                label: entry.name.to_owned(),
                columns: match &reason {
                    Reason::Columns(columns) => columns.clone(),
                    _ => Vec::new(),
                },
                setting: match &reason {
                    Reason::Columns(_) | Reason::CovarianceOf(_) => None,
                    Reason::SlowCommand { faster, .. } => Some((*faster).to_owned()),
                    Reason::Guessed(_) => Some("a vehicle whose inertia was measured".to_owned()),
                    Reason::InTheModel => Some(format!("a model without {}", entry.id)),
                    Reason::NothingToActThrough(needs) => Some(format!("a model with one of {}", needs.join(", "))),
                    Reason::NothingNamed => Some("a flight on which another effect is named".to_owned()),
                },
                reason: String::new(),
                why: reason,
            })
        })
        .collect()
}

/// Why an effect was not considered; `None` if it was.
fn reason(problem: &Problem, diagnosis: &Diagnosis, entry: &EffectDeclaration) -> Option<Reason> {
    let mut candidates = problem.library.candidates.iter();
    let noise = entry.class == EffectClass::Noise;
    let absent = candidates.all(|candidate| candidate.declaration.id != entry.id);
    let in_the_model = |log: &LogState| log.predictor.model().iter().any(|one| one.effect == entry.id);
    if !noise && absent && problem.logs.iter().any(in_the_model) {
        return Some(Reason::InTheModel);
    }
    if !noise && absent && !entry.search.unless_guessed.is_empty() {
        return Some(Reason::Guessed(entry.search.unless_guessed));
    }
    if let Strategy::CovarianceOf(other) = entry.search.strategy {
        return Some(Reason::CovarianceOf(other));
    }
    if let Some(slow) = slow_command(problem, entry) {
        return Some(slow);
    }
    let columns = missing(problem, diagnosis, entry);
    if !columns.is_empty() {
        return Some(Reason::Columns(columns));
    }
    if entry.search.strategy != Strategy::Covariance {
        return None;
    }
    if !acts(problem, entry) {
        return Some(Reason::NothingToActThrough(entry.needs));
    }
    // Where nothing is left, there are none of a size that shows.
    let left = !diagnosis.goodness.unexplained.is_empty();
    (left && problem.active.is_empty()).then_some(Reason::NothingNamed)
}

/// That an effect needs more samples of the command than any log has, if so.
fn slow_command(problem: &Problem, entry: &EffectDeclaration) -> Option<Reason> {
    let needed = Requirement::FrequentCommand;
    let logs = || problem.logs.iter().map(|log| &log.predictor);
    if !entry.search.requires.contains(&needed) || logs().any(|predictor| holds(predictor, needed)) {
        return None;
    }
    let slow = |predictor: &Predictor| predictor.series().slow;
    let best = logs().min_by(|a, b| slow(a).command_s.total_cmp(&slow(b).command_s))?;
    Some(Reason::SlowCommand {
        hz: 1.0 / slow(best).command_s,
        lag_s: best.nominal.thrust_lag_up_s,
        faster: slow(best).faster_command,
    })
}

/// Columns that an effect lacks in every log.
fn missing(problem: &Problem, diagnosis: &Diagnosis, entry: &EffectDeclaration) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for requirement in entry.search.requires {
        let logs = problem.logs.iter();
        let mut have = logs.map(|log| holds(&log.predictor, *requirement));
        let assumed = || problem.logs.iter().any(|log| log.predictor.series().available.position);
        // Without a height the ground is assumed at the origin of NED: enough to find an effect of it, not to rule one
        // out.
        let testable = || diagnosis.not_testable.iter().all(|row| row.effect != entry.id);
        let taken = *requirement == Requirement::HeightAboveGround && assumed() && testable();
        if !have.any(|holds| holds) && !taken {
            all.extend(columns_of(problem, *requirement));
        }
    }
    if !all.is_empty() {
        return all;
    }
    if !silent(problem, entry) {
        return all;
    }
    // Nothing of it shows in the channels that there are: one of the others would be needed.
    let absent = |wanted: &ChannelGroup| {
        let channels = (0..CHANNELS).filter(|&channel| group(channel) == *wanted);
        let mut tested = channels.flat_map(|channel| problem.logs.iter().map(move |log| log.predictor.has(channel)));
        !tested.any(|has| has)
    };
    let groups = entry.channels.iter().filter(|group| absent(group));
    groups
        .map(|group| columns_behind(problem, *group))
        .find(|columns| !columns.is_empty())
        .unwrap_or_default()
}

/// True if an effect shows in no channel of any log, in addition to what was named.
fn silent(problem: &Problem, entry: &EffectDeclaration) -> bool {
    if matches!(entry.search.strategy, Strategy::Wiring(_)) {
        // The wiring test looks at the torques.
        let torque = |channel: &usize| group(*channel) == ChannelGroup::Moment;
        let mut torques = (0..CHANNELS).filter(torque);
        return !torques.any(|channel| problem.logs.iter().any(|log| log.predictor.has(channel)));
    }
    let candidates = problem.library.candidates.iter().enumerate();
    let own = candidates.filter(|(_, candidate)| candidate.declaration.id == entry.id);
    own.flat_map(|(place, _)| problem.library.columns_of(place)).all(|j| {
        problem.linear.iter().zip(&problem.logs).all(|(linear, log)| {
            let column = &linear.columns[log.nuisance_count() + j];
            column.iter().all(Option::is_none)
        })
    })
}

/// True if an effect through which this one acts is at work, or the vehicle has a drag of its own.
fn acts(problem: &Problem, entry: &EffectDeclaration) -> bool {
    let named = |candidate: usize| problem.library.candidates[candidate].declaration.id;
    problem
        .active
        .iter()
        .any(|active| entry.needs.contains(&named(active.candidate)))
        || problem.logs.iter().any(|log| {
            let model = log.predictor.model().iter();
            let mut effects = model.map(|instance| instance.effect.as_str());
            effects.any(|effect| entry.needs.contains(&effect)) || log.predictor.nominal.has_drag()
        })
}

/// True if a log contains what is required.
pub(crate) fn holds(predictor: &Predictor, requirement: Requirement) -> bool {
    let series = predictor.series();
    let have = series.available;
    match requirement {
        Requirement::Duty => series.drive == Drive::Duty,
        Requirement::Command => matches!(series.drive, Drive::Duty | Drive::Wrench),
        Requirement::FrequentCommand => {
            !matches!(series.drive, Drive::Duty | Drive::Wrench)
                || series.slow.command_s <= predictor.nominal.thrust_lag_up_s
        }
        Requirement::HeightAboveGround => have.height_above_ground,
        Requirement::Position => have.position,
        Requirement::AirVelocity => have.velocity && have.attitude,
        Requirement::BatteryVoltage => have.voltage,
    }
}

fn columns_of(problem: &Problem, requirement: Requirement) -> Vec<String> {
    let texts = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let columns = match requirement {
        Requirement::Duty | Requirement::Command | Requirement::FrequentCommand => duties(problem),
        Requirement::HeightAboveGround => texts(&[names::HEIGHT_ABOVE_GROUND]),
        Requirement::Position => texts(&names::POSITION),
        Requirement::AirVelocity => [names::VELOCITY, names::ATTITUDE]
            .iter()
            .flat_map(|n| texts(n))
            .collect(),
        Requirement::BatteryVoltage => texts(&[names::BATTERY_VOLTAGE]),
    };
    absent(problem, columns)
}

/// The inputs of the residuals of a group of channels, as far as no log has them.
fn columns_behind(problem: &Problem, group: ChannelGroup) -> Vec<String> {
    let texts = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let both = |a: &[&str], b: &[&str]| [texts(a), texts(b)].concat();
    let columns = match group {
        ChannelGroup::Force => [texts(&names::ACCEL), duties(problem)].concat(),
        ChannelGroup::Moment => [texts(&names::RATES), duties(problem)].concat(),
        ChannelGroup::VelocityKinematics => both(&names::VELOCITY, &names::ATTITUDE),
        ChannelGroup::AttitudeKinematics => both(&names::ATTITUDE, &names::RATES),
        ChannelGroup::PositionKinematics => both(&names::POSITION, &names::VELOCITY),
        ChannelGroup::Voltage => [vec![names::BATTERY_VOLTAGE.to_owned()], duties(problem)].concat(),
    };
    absent(problem, columns)
}

fn duties(problem: &Problem) -> Vec<String> {
    let rotors = problem.logs.first().map_or(0, |log| log.predictor.series().rotors);
    (1..=rotors).map(names::duty).collect()
}

/// Those columns that no log has. If the rotors are driven by something else (rotor speeds, a wrench), the duties are
/// still absent.
fn absent(problem: &Problem, columns: Vec<String>) -> Vec<String> {
    let has = |predictor: &Predictor, column: &str| {
        let series = predictor.series();
        let have = series.available;
        let among = |there: bool, names: &[&str]| there && names.contains(&column);
        among(have.position, &names::POSITION)
            || among(have.velocity, &names::VELOCITY)
            || among(have.attitude, &names::ATTITUDE)
            || among(have.rates, &names::RATES)
            || among(have.accel, &names::ACCEL)
            || among(have.voltage, &[names::BATTERY_VOLTAGE])
            || among(have.height_above_ground, &[names::HEIGHT_ABOVE_GROUND])
            || (series.drive == Drive::Duty && names::duty_rotor(column).is_some())
    };
    columns
        .into_iter()
        .filter(|column| !problem.logs.iter().any(|log| has(&log.predictor, column)))
        .collect()
}
