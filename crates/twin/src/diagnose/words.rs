//! Reasons in plain words: numbers with units, why an effect was named, why a rival lost.

use rotortwin_plant::effects::{
    ChannelGroup, Correction, CorrectionScale, EffectClass, ParameterDeclaration, catalogue,
};
use std::collections::BTreeSet;
use std::ops::Range;

use super::named::Quantity;
use super::result::{
    Calibration, Diagnosis, Finding, FlightWind, FlightsApart, HeldOutError, NotConsidered, Outcome, Reason, Rival,
    Verdict,
};
use super::state::Doubt;
use crate::estimation::candidates::Library;
use crate::estimation::parameters::{FittedParameter, QUANTILE_95, SMALLEST, number};
use crate::log::names::duty_rotor;
use crate::model::constants::Source;
use crate::predict::NAMES;
use crate::predict::channels::{F, KA, KV, M, TITLES, V, group};

/// The commonest reason for torques alone that nothing explains.
const BETWEEN_ROWS: &str = " A controller that runs faster than its log leaves such an error: what its outputs did between two rows is not in it; log them \
                            as fast as it runs, or their means over each row.";

/// What errors of kinematic channels alone mean.
const SENSORS_ALONE: &str = " These channels compare the log's sensors and its estimator with one another: forces and torques agree with the model, so no \
                             effect of the vehicle is reported as missing.";

/// What such errors mean where the log has nothing to compare forces and torques with.
const ESTIMATOR_ALONE: &str = " These channels compare the log's sensors and its estimator with one another, and the log has nothing to compare forces and \
                               torques of the model with: it says nothing about the vehicle's mass, inertia or air forces.";

/// Effects that a sentence names before it counts the rest.
const MOST_NAMED: usize = 3;

/// The name of an effect within a sentence: without its capital, unless that belongs to an abbreviation (`GPS delay`).
pub fn in_sentence(label: &str) -> String {
    let mut letters = label.chars();
    match (letters.next(), letters.next()) {
        (Some(first), Some(second)) if !second.is_uppercase() => {
            first.to_lowercase().chain(label.chars().skip(1)).collect()
        }
        _ => label.to_owned(),
    }
}

/// `k_d = 0.2530 ± 0.0020 N·s/m`, with half the width of the 95 % interval.
pub(crate) fn parameter(p: &FittedParameter) -> String {
    let unit = if p.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", p.unit)
    };
    if p.interval_95 > 0.0 && p.value.abs().max(p.interval_95) < SMALLEST {
        return format!("{} = {:.2e} ± {:.1e}{unit}", p.symbol, p.value, p.interval_95);
    }
    let digits = if p.interval_95 > 0.0 {
        (1 - p.interval_95.log10().floor() as i32).clamp(0, 8) as usize
    } else {
        4
    };
    format!("{} = {:.digits$} ± {:.digits$}{unit}", p.symbol, p.value, p.interval_95)
}

/// All parameters of a finding.
pub(crate) fn parameters(finding: &Finding) -> String {
    finding.parameters.iter().map(parameter).collect::<Vec<_>>().join(", ")
}

/// The parameters of a finding as its effect declares them; none of an effect that is not in the catalogue.
fn declared(finding: &Finding) -> impl Iterator<Item = (&FittedParameter, &'static ParameterDeclaration)> {
    let entry = catalogue().iter().find(|entry| entry.id == finding.instance.effect);
    finding
        .parameters
        .iter()
        .filter_map(move |p| Some((p, &entry?.parameters[entry?.parameter_index(&p.name)?])))
}

/// What the sizes of a finding say about the part that is another one, where its effect declares that.
fn about_the_part(finding: &Finding) -> Option<String> {
    let sets_in = finding.onset_s.is_some();
    declared(finding).find_map(|(p, declared)| Some(declared.tolerance?.words(p.value, p.interval_95, sets_in)))
}

/// How exact the constants of a model are taken to be: half widths of 95 % intervals.
pub(crate) fn assumed(library: &Library) -> String {
    let mut told: Vec<String> = Vec::new();
    for candidate in &library.candidates {
        let shares = candidate.parameters.iter().enumerate();
        for (i, p) in shares.filter(|(_, p)| p.corrects.is_some() && p.unit.is_empty()) {
            let named = candidate.constant.as_ref().filter(|(place, _)| *place == i);
            let name = match named {
                Some((_, constant)) => constant.name.clone(),
                None => in_sentence(candidate.declaration.name),
            };
            let one = format!("{name} {:.2} %", 100.0 * QUANTILE_95 * p.clutter);
            if !told.contains(&one) {
                told.push(one);
            }
        }
    }
    told.join("; ")
}

/// On what the size of an effect rests that is the error of a constant: a flight determines ratios of constants.
fn holds_if(finding: &Finding) -> Option<&'static str> {
    // What changes in flight changes by itself.
    if finding.onset_s.is_some() {
        return None;
    }
    declared(finding).find_map(|(_, declared)| condition_of(declared.corrects?.key))
}

/// Share of a constant up to which its error may be the file's, of which nobody said how exact it is.
const OF_ANY_FILE: f64 = 0.05;

/// What to do about small errors of constants, of which a flight alone cannot tell whether the vehicle or its file is off; else empty.
pub(crate) fn as_exact_as_the_file(diagnosis: &Diagnosis) -> String {
    let is_small = |finding: &&Finding| {
        let of_constant = |(p, declared): (&FittedParameter, &ParameterDeclaration)| {
            let is_share = |one: Correction| one.scale == CorrectionScale::Share;
            declared.corrects.is_some_and(is_share) && p.value.abs() - p.interval_95 < OF_ANY_FILE
        };
        finding.onset_s.is_none() && declared(finding).any(of_constant)
    };
    let small: Vec<String> = diagnosis
        .effects
        .iter()
        .filter(is_small)
        .map(|one| in_sentence(&one.label))
        .collect();
    if small.is_empty() {
        return String::new();
    }
    format!(
        " An error of a few per cent ({}) may be the vehicle file's: state how exact it is (`rotortwin vehicle tolerances`).",
        small.join(", ")
    )
}

/// How a rival fared.
fn fared(rival: &Rival) -> String {
    let gap = rival.evidence_gap;
    match &rival.outcome {
        Outcome::AsGood => "this flight fits it nearly as well".to_owned(),
        Outcome::TooSmallToTell => "what was found is smaller than what this flight shows for certain".to_owned(),
        Outcome::Implausible(Quantity { symbol, value, unit }) => format!(
            "it would need {symbol} = {}, outside of what real vehicles have",
            quantity(*value, unit)
        ),
        Outcome::Leaves(groups) => {
            let symbols: Vec<&str> = groups.iter().map(|group| group.symbol()).collect();
            format!(
                "it leaves the error in {} where it is (ln BF {gap:.1} worse)",
                symbols.join(", ")
            )
        }
        Outcome::OtherShape(told_by) => format!(
            "it shows in the same channels, but its shape over the flight fits worse by ln BF {gap:.1}; distinguished by: {told_by}"
        ),
    }
}

/// A number with its unit, if it has one.
pub(crate) fn quantity(value: f64, unit: &str) -> String {
    format!("{} {unit}", number(value)).trim_end().to_owned()
}

/// Why an effect was named.
fn why_found(finding: &Finding) -> String {
    let mut text = format!(
        "ln Bayes factor {:.0} against small errors of all other parameters; shows in {}",
        finding.ln_bayes_factor,
        finding.channels.join(", ")
    );
    if let (Some(minimum), Some(first)) = (finding.seen_from, finding.parameters.first()) {
        text += &format!("; detectable from {}", quantity(minimum, &first.unit));
    }
    if let Some(onset) = finding.onset_s {
        text += &format!("; it sets in at {onset:.1} s");
    }
    if let Some(part) = about_the_part(finding) {
        text += &format!("; {part}");
    }
    if finding.class == EffectClass::Noise {
        text += "; noise through the drag that was found, white once filtered, and no function of velocity or place";
    }
    text
}

/// Why an effect was not considered.
fn unconsidered(one: &NotConsidered) -> String {
    match &one.why {
        Reason::Columns(columns) => format!("no log has {}", listed(columns)),
        Reason::SlowCommand { hz, lag_s, faster } => format!(
            "commands have new values at {hz:.1} Hz, and a lag of {lag_s:.3} s requires {:.0} Hz; {faster}",
            (1.0 / lag_s).ceil()
        ),
        Reason::InTheModel => "already in the model; `rotortwin improve` fits its value".to_owned(),
        Reason::NothingToActThrough(needs) => {
            format!(
                "it acts only through one of {}, and the model has none of them",
                needs.join(", ")
            )
        }
        Reason::NothingNamed => "it is only searched for together with another effect, and none was named".to_owned(),
        Reason::Guessed(others) => format!(
            "a flight determines it only against the constants of {}, which are guesses",
            others.join(" and ")
        ),
        Reason::CovarianceOf(other) => format!("its covariance is nearly that of {other}, which is looked for instead"),
    }
}

/// Names of columns; a numbered row of them by its ends.
fn listed(columns: &[String]) -> String {
    let numbered = columns.iter().filter(|column| duty_rotor(column).is_some()).count();
    match columns {
        [.., last] if numbered > 2 => {
            let others = &columns[..columns.len() - numbered];
            let ends = format!("{} to {last}", columns[others.len()]);
            others.iter().cloned().chain([ends]).collect::<Vec<_>>().join(", ")
        }
        _ => columns.join(", "),
    }
}

/// Other explanations of an error that is not in the catalogue: the effects that could not be considered for lack of a
/// column or setting.
fn or_unconsidered(diagnosis: &Diagnosis) -> String {
    let would = diagnosis.not_considered.iter().filter(|one| {
        matches!(
            one.why,
            Reason::Columns(_) | Reason::SlowCommand { .. } | Reason::NothingToActThrough(_)
        )
    });
    let names: Vec<String> = would.map(|one| in_sentence(&one.label)).collect();
    match names.as_slice() {
        [] => String::new(),
        few if few.len() <= MOST_NAMED => format!(" Not considered: {}.", few.join(", ")),
        many => format!(
            " Not considered: {} and {} more.",
            many[..MOST_NAMED].join(", "),
            many.len() - MOST_NAMED
        ),
    }
}

/// A doubt, as a part of the unexplained rest.
pub(crate) fn doubt(doubt: &Doubt) -> String {
    match doubt {
        Doubt::StretchedClutter => "what only implausible parameters would explain".to_owned(),
        Doubt::ImpossibleSize(label) => {
            format!("what only an impossible size of {} would explain", in_sentence(label))
        }
        Doubt::ImpossibleConstant(constant) => format!("what only an impossible value of {constant} would explain"),
        Doubt::LookAlikes => "what three effects of one kind patch together".to_owned(),
        Doubt::HeldOutRises(quantity) => {
            format!("the {quantity} error on unseen blocks (it rises with what was found)")
        }
    }
}

/// An error on unseen blocks that is more than noise, as a part of the unexplained rest.
pub(crate) fn beyond_noise(error: &HeldOutError) -> String {
    let [left, noise] = [error.after, error.noise].map(|value| number(1e3 * value));
    format!(
        "the {} error on unseen blocks ({left} m{} where noise leaves {noise})",
        error.quantity, error.unit
    )
}

/// Errors on unseen blocks that small errors of the other constants explain, as the next sentence of a verdict.
pub(crate) fn small_errors(diagnosis: &Diagnosis) -> String {
    let excused = diagnosis.held_out.iter().filter(|error| error.is_excused());
    let parts: Vec<String> = excused
        .map(|error| {
            let [after, with] = [error.after, error.with_small_errors].map(|value| number(1e3 * value));
            let noise = number(1e3 * error.noise);
            format!(
                "{} {after} → {with} m{} where noise leaves {noise}",
                error.quantity, error.unit
            )
        })
        .collect();
    if parts.is_empty() {
        return String::new();
    }
    format!(
        " What is left is that of other constants which are off a little (within their intervals, or 2 % of a plausible size); with them: {}.",
        parts.join("; ")
    )
}

/// Puts the findings of a diagnosis into words: reasons first, the sentence last.
pub(crate) fn render(diagnosis: &mut Diagnosis) {
    for finding in diagnosis.effects.iter_mut().chain(&mut diagnosis.sensor_or_timing) {
        finding.reason = why_found(finding);
        for rival in finding.also_compatible.iter_mut().chain(&mut finding.lost) {
            rival.reason = fared(rival);
        }
    }
    for one in &mut diagnosis.not_considered {
        one.reason = unconsidered(one);
    }
    diagnosis.sentence = sentence(diagnosis) + &winds(&diagnosis.winds);
    if let Some(limit_s) = diagnosis.stopped_at_s {
        diagnosis.sentence = format!(
            "Stopped by the time limit of {limit_s:.0} s, before the search was complete. As far as it got: {}",
            diagnosis.sentence
        );
    }
}

/// True if one of the winds may be something else.
fn is_in_doubt(winds: &[FlightWind]) -> bool {
    winds.iter().any(|one| !one.distinguished)
}

/// ` Each flight has a wind of its own: a1 w_N = …, w_E = …; a2 ….`, as the next sentence of a verdict.
fn winds(winds: &[FlightWind]) -> String {
    if winds.is_empty() {
        return String::new();
    }
    let told: Vec<String> = winds
        .iter()
        .map(|one| {
            let values: Vec<String> = one.parameters.iter().map(parameter).collect();
            let or = if one.distinguished {
                ""
            } else {
                " (or sensors that are off in this flight alone: it turns too little to tell)"
            };
            format!("{} {}{or}", one.log, values.join(", "))
        })
        .collect();
    format!(" Each flight has a wind of its own: {}.", told.join("; "))
}

fn names(rivals: &[Rival]) -> String {
    if rivals.is_empty() {
        "none".into()
    } else {
        rivals
            .iter()
            .map(|r| in_sentence(&r.label))
            .collect::<Vec<_>>()
            .join(", ")
    }
}

/// `29.6 → 28.9 mN`.
fn from_to(error: &HeldOutError) -> String {
    let [before, after] = [error.before, error.after].map(|value| number(1e3 * value));
    format!("{before} → {after} m{}", error.unit)
}

/// Errors on unseen blocks that rise with what a sentence names, as its next sentence.
fn rising(diagnosis: &Diagnosis) -> String {
    let risen = diagnosis.held_out.iter().filter(|error| error.rises()).map(|error| {
        format!(
            "the {} error on unseen blocks rises with it ({})",
            error.quantity,
            from_to(error)
        )
    });
    let risen: Vec<String> = risen.collect();
    if risen.is_empty() {
        String::new()
    } else {
        format!(" Not confirmed: {}.", risen.join(", "))
    }
}

/// Effects with their sizes: `rotor drag, k_d = 0.2503 ± 0.0012 N·s/m; and …`.
fn named(findings: &[Finding]) -> String {
    let all: Vec<String> = findings
        .iter()
        .map(|f| {
            let onset = f.onset_s.map_or(String::new(), |t| format!(" from {t:.1} s on"));
            let constant = f.constant.as_ref().map_or(String::new(), |one| {
                format!(
                    " ({} {} ± {} where the model has {})",
                    one.name,
                    quantity(one.wanted, &one.unit),
                    quantity(one.interval_95, &one.unit),
                    quantity(one.value, &one.unit)
                )
            });
            let part = about_the_part(f).map_or(String::new(), |part| format!(" ({part})"));
            let condition = holds_if(f).map_or(String::new(), |others| format!(" if {others}"));
            format!(
                "{}, {}{onset}{constant}{part}{condition}",
                in_sentence(&f.label),
                parameters(f)
            )
        })
        .collect();
    all.join("; and ")
}

/// What some of the flights have: `a1 and a2 agree with the model`, `a3: missing mass, s = …`.
fn apart(one: &FlightsApart) -> String {
    let logs = one.logs.join(" and ");
    match &one.verdict {
        Verdict::CannotTell { group } => {
            format!("{logs}: one of {}, best fit {}", group.join(", "), named(&one.effects))
        }
        Verdict::LogFault { .. } => format!("{logs}: fault of the log, {}", named(&one.sensor_or_timing)),
        Verdict::Missing { .. } if one.sensor_or_timing.is_empty() => {
            format!("{logs}: missing {}", named(&one.effects))
        }
        Verdict::Missing { .. } => format!(
            "{logs}: missing {}, and fault of the log, {}",
            named(&one.effects),
            named(&one.sensor_or_timing)
        ),
        _ if one.logs.len() == 1 => format!("{logs} agrees with the model"),
        _ => format!("{logs} agree with the model"),
    }
}

/// What is unexplained, in words: the channels of a kind together, with their short names and the flights they are of, then whatever else.
fn in_plain(unexplained: &[String]) -> Vec<String> {
    // `fx`, of several logs `fx of NAME`.
    let channel_of = |one: &String| {
        let (name, log) = one
            .split_once(" of ")
            .map_or((one.as_str(), None), |(name, log)| (name, Some(log)));
        let channel = NAMES.iter().position(|known| *known == name)?;
        Some((channel, log.map(str::to_owned)))
    };
    let mut kinds: Vec<(ChannelGroup, BTreeSet<usize>, BTreeSet<String>)> = Vec::new();
    let mut others = Vec::new();
    for one in unexplained {
        let Some((channel, log)) = channel_of(one) else {
            others.push(one.clone());
            continue;
        };
        let kind = group(channel);
        let place = kinds
            .iter()
            .position(|(known, _, _)| *known == kind)
            .unwrap_or_else(|| {
                kinds.push((kind, BTreeSet::new(), BTreeSet::new()));
                kinds.len() - 1
            });
        kinds[place].1.insert(channel);
        kinds[place].2.extend(log);
    }
    let of_kind = |(kind, channels, logs): &(ChannelGroup, BTreeSet<usize>, BTreeSet<String>)| {
        let short: Vec<&str> = channels.iter().map(|channel| NAMES[*channel]).collect();
        let title = match (channels.first(), channels.len()) {
            (Some(only), 1) => TITLES[*only],
            _ => match kind {
                ChannelGroup::Force => "force",
                ChannelGroup::VelocityKinematics => "velocity",
                ChannelGroup::Moment => "moment",
                ChannelGroup::AttitudeKinematics => "attitude",
                ChannelGroup::PositionKinematics => "position",
                ChannelGroup::Voltage => "voltage",
            },
        };
        let of = match (logs.first(), logs.len()) {
            (Some(only), 1) => format!(" of {only}"),
            (_, 0) => String::new(),
            (_, several) => format!(" of {several} flights"),
        };
        format!("{title} ({}){of}", short.join(", "))
    };
    kinds.iter().map(of_kind).chain(others).collect()
}

/// `force (fx, fz) stays`, as what stays unexplained.
fn stay(unexplained: &[String]) -> String {
    let plain = in_plain(unexplained);
    let stay = if plain.len() == 1 { "stays" } else { "stay" };
    format!("{} {stay}", plain.join(", "))
}

/// What it means that only channels are unexplained that compare sensors with one another; empty if others are, too.
fn of_sensors(diagnosis: &Diagnosis) -> &'static str {
    // `fx`, of several logs `fx of NAME`.
    let place = |channel: &str| NAMES.iter().position(|one| Some(*one) == channel.split(' ').next());
    let tested = |range: Range<usize>| {
        let mut channels = diagnosis.goodness.channels.iter();
        channels.any(|one| place(&one.channel).is_some_and(|channel| range.contains(&channel)))
    };
    let of_sensors = |channel| (KV..M).contains(&channel) || (KA..V).contains(&channel);
    let mut unexplained = diagnosis.goodness.unexplained.iter();
    if !unexplained.all(|one| place(one).is_some_and(of_sensors)) {
        return "";
    }
    match (tested(F..KV), tested(M..KA)) {
        (true, true) if diagnosis.effects.is_empty() && diagnosis.sensor_or_timing.is_empty() => SENSORS_ALONE,
        (false, false) => ESTIMATOR_ALONE,
        _ => "",
    }
}

/// The verdict as a sentence.
fn sentence(diagnosis: &Diagnosis) -> String {
    let share = diagnosis.goodness.explained_share.map_or(String::new(), |share| {
        format!(" Explains {:.1} % of the excess error.", 100.0 * share.clamp(0.0, 1.0))
    });
    let small = small_errors(diagnosis);
    match &diagnosis.verdict {
        Verdict::Agrees => {
            let agrees =
                "The model agrees with this flight: no effect of the catalogue is missing at a size that would show.";
            format!("{agrees}{small}")
        }
        Verdict::NothingTestable => "Nothing of this log can be compared with the model.".into(),
        Verdict::PartlyMissing { .. } => partly_missing(diagnosis),
        Verdict::CalibrateFirst { .. } => calibrate_first(diagnosis),
        Verdict::OutsideCatalogue => outside_catalogue(diagnosis),
        Verdict::FlightsDiffer { changed } => flights_differ(diagnosis, *changed),
        Verdict::CannotTell { group } => format!(
            "This flight cannot distinguish {}: best fit {}.{share}{small}",
            group.join(" from "),
            named(&diagnosis.effects)
        ),
        Verdict::LogFault { .. } => format!(
            "The log is at fault, not the physics: {}.{share}{}{small} Also compatible: {}.",
            named(&diagnosis.sensor_or_timing),
            changed_errors(diagnosis),
            names(&rivals(diagnosis))
        ),
        Verdict::Missing { .. } => missing(diagnosis, &share, &small),
    }
}

/// Everything that was found, of the vehicle and of the log.
fn found(diagnosis: &Diagnosis) -> Vec<Finding> {
    let all = diagnosis.effects.iter().chain(&diagnosis.sensor_or_timing);
    all.cloned().collect()
}

/// What explains the flight nearly as well as what was found.
fn rivals(diagnosis: &Diagnosis) -> Vec<Rival> {
    let all = diagnosis.effects.iter().chain(&diagnosis.sensor_or_timing);
    all.flat_map(|one| one.also_compatible.clone()).collect()
}

/// Errors on unseen blocks that what was found changes.
fn changed_errors(diagnosis: &Diagnosis) -> String {
    let changes = |e: &&HeldOutError| (e.before - e.after).abs() > (0.01 * e.before).max(e.negligible());
    let changed = diagnosis.held_out.iter().filter(changes);
    changed
        .map(|e| format!(" Held-out {} error {}.", e.quantity, from_to(e)))
        .collect()
}

fn partly_missing(diagnosis: &Diagnosis) -> String {
    let falling = diagnosis.held_out.iter().filter(|e| e.falls()).map(|e| {
        format!(
            "{:.0} % of the {} error on unseen blocks explained ({})",
            100.0 * e.explained_share(),
            e.quantity,
            from_to(e)
        )
    });
    format!(
        "Missing, in part: {}; {}. The rest is real and not in the catalogue: {}. Until it is explained, regard the intervals as too narrow. \
         Also compatible: {}.",
        named(&diagnosis.effects),
        falling.collect::<Vec<_>>().join(", "),
        in_plain(&diagnosis.goodness.unexplained).join(", "),
        names(&rivals(diagnosis))
    )
}

fn calibrate_first(diagnosis: &Diagnosis) -> String {
    let blocking = || diagnosis.calibrate.iter().filter(|one| one.blocking);
    let constants: Vec<String> = blocking().map(Calibration::sentence).collect();
    let found = found(diagnosis);
    let part = if found.is_empty() {
        String::new()
    } else {
        format!(
            " A part of the error looks like {}, which cannot be confirmed before the guessed constants are known.",
            named(&found)
        )
    };
    let in_ratios = blocking().any(|one| !one.source.is_guess() && ratio_of(&one.key).is_some());
    let ratios = if in_ratios { RATIOS } else { "" };
    let unexplained = &diagnosis.goodness.unexplained;
    let rest = if unexplained.is_empty() {
        String::new()
    } else {
        format!(
            " Even with these values {} unexplained: they are provisional.",
            stay(unexplained)
        )
    };
    format!(
        "Calibrate first ({}): {}.{ratios}{part}{}{rest}",
        HOW_TO_CALIBRATE,
        constants.join("; and "),
        rising(diagnosis)
    )
}

fn outside_catalogue(diagnosis: &Diagnosis) -> String {
    let unexplained = &diagnosis.goodness.unexplained;
    let found = found(diagnosis);
    let part = if found.is_empty() {
        String::new()
    } else {
        format!(
            " A part looks like {}, which must not be trusted while the rest is unexplained.",
            named(&found)
        )
    };
    // `mx`, of several logs `mx of NAME`.
    let is_torque = |channel: &String| {
        let name = channel.split(' ').next();
        name.is_some_and(|name| ["mx", "my", "mz"].contains(&name))
    };
    let torques =
        unexplained.iter().all(is_torque) && found.iter().all(|finding| finding.channels.iter().all(is_torque));
    let outputs = if torques { BETWEEN_ROWS } else { "" };
    let sensors = of_sensors(diagnosis);
    format!(
        "The error is real and not, or not wholly, in the catalogue: {} unexplained.{sensors}{part}{}{outputs}{}",
        stay(unexplained),
        rising(diagnosis),
        or_unconsidered(diagnosis)
    )
}

fn flights_differ(diagnosis: &Diagnosis, changed: bool) -> String {
    let flights: Vec<String> = diagnosis.apart.iter().map(apart).collect();
    let why = if changed {
        "The vehicle or its sensors changed between them"
    } else {
        "The vehicle or its sensors changed between them, or an effect outside of the catalogue is in all of them"
    };
    format!(
        "These flights differ: nothing explains them together, but each alone is explained. {}. {why}.",
        flights.join("; ")
    )
}

fn missing(diagnosis: &Diagnosis, share: &str, small: &str) -> String {
    let fault = if diagnosis.sensor_or_timing.is_empty() {
        String::new()
    } else {
        format!(" And a fault of the log: {}.", named(&diagnosis.sensor_or_timing))
    };
    let missing = if diagnosis.effects.is_empty() {
        "the wind of each flight".to_owned()
    } else {
        named(&diagnosis.effects)
    };
    let rivals = rivals(diagnosis);
    // What a wind of a flight's own is also compatible with stands beside it.
    let compatible = if rivals.is_empty() && is_in_doubt(&diagnosis.winds) {
        String::new()
    } else {
        format!(" Also compatible: {}.", names(&rivals))
    };
    let changed = changed_errors(diagnosis);
    format!("Missing: {missing}.{share}{changed}{fault}{small}{compatible}")
}

impl Calibration {
    /// The guess, and the value that the flights indicate.
    pub fn sentence(&self) -> String {
        let what = match self.source {
            Source::Class => "is a guess of its class",
            Source::LogAndClass => "is known from its class as much as from a log",
            Source::Entered | Source::Stated | Source::Log | Source::Parameter | Source::Bench | Source::Assumed => {
                "is off"
            }
        };
        let number = |value: f64| quantity(value, &self.unit);
        let known = if self.high > self.low {
            format!(
                "{}, 95 % {} to {}",
                number(self.value),
                number(self.low),
                number(self.high)
            )
        } else {
            number(self.value)
        };
        let better = if self.better.is_empty() {
            String::new()
        } else {
            format!("; to determine it: {}", self.better)
        };
        let wants = format!("{} ± {}", number(self.wanted), number(self.wanted_interval_95));
        // No flight determines which part of a ratio is wrong, as long as neither has been weighed or measured.
        let Some(ratio) =
            ratio_of(&self.key).filter(|_| !self.source.is_guess() && self.value > 0.0 && self.wanted > 0.0)
        else {
            return format!("{} {what} ({known}), these flights indicate {wants}{better}", self.name);
        };
        let share = self.wanted / self.value;
        let factor = if ratio.below { 1.0 / share } else { share };
        let half_width = factor * self.wanted_interval_95 / self.wanted;
        format!(
            "{} {what}: these flights indicate {:.3} ± {:.3} times that of the model, which is {} of {wants} instead of {known} if {}{better}",
            ratio.name, factor, half_width, self.name, ratio.others
        )
    }
}

/// The quantity that a flight determines instead of one constant.
struct Ratio {
    name: &'static str,
    /// The constant is the denominator.
    below: bool,
    /// The condition under which the constant alone is wrong.
    others: &'static str,
}

/// The ratio in which a constant is reported: accelerometer and gyro measure forces over the mass and torques over the
/// inertia.
fn ratio_of(key: &str) -> Option<Ratio> {
    let (name, below, others) = match key {
        "body.mass_kg" => ("thrust over mass", true, "the thrust curve is right"),
        "rotors.thrust_level" => ("thrust over mass", false, "the mass is right"),
        "body.inertia_body_kg_m2[0]" => ("thrust times arm over roll inertia", true, "thrust and arms are right"),
        "body.inertia_body_kg_m2[1]" => ("thrust times arm over pitch inertia", true, "thrust and arms are right"),
        "body.inertia_body_kg_m2[2]" => (
            "rotor torque over yaw inertia",
            true,
            "thrust and torque ratio are right",
        ),
        _ => return None,
    };
    Some(Ratio { name, below, others })
}

/// The condition under which a flight determines a constant alone.
fn condition_of(key: &str) -> Option<&'static str> {
    ratio_of(key).map(|ratio| ratio.others).or(match key {
        "rotors.moment_ratio_m" => Some("the yaw inertia is right"),
        "rotors.arm_m" => Some("the inertias are right"),
        "body.centre_of_mass_m[0]" | "body.centre_of_mass_m[1]" => Some("all rotors are equally strong"),
        "battery.capacity_ah" => Some("the power of the rotors and the open-circuit voltage are right"),
        _ => None,
    })
}

/// What to do about ratios.
const RATIOS: &str = " A flight determines mass, thrust, arms and inertia only as ratios: weigh the vehicle and measure its arms before trusting its other constants.";

/// How to calibrate a vehicle, with the inputs required of the user.
const HOW_TO_CALIBRATE: &str =
    "`rotortwin vehicle from-log LOG… --mass KG --arm M --out NAME.toml`, or type what is known into the vehicle";

#[cfg(test)]
mod tests {
    use super::*;

    /// "kp_north of E8_log00, kp_east of E8_log00, …": twelve short names in the first sentence that a stranger read.
    #[test]
    fn regress_what_is_unexplained_is_told_by_kind_and_not_log_by_log() {
        let names = [
            "kp_north of a",
            "kp_down of a",
            "kp_north of b",
            "fz of a",
            "what nothing explains",
        ];
        let said = in_plain(&names.map(str::to_owned));
        let expected = [
            "position (kp_north, kp_down) of 2 flights",
            "vertical force (fz) of a",
            "what nothing explains",
        ];
        assert_eq!(said, expected);
        assert_eq!(stay(&["mx".to_owned()]), "roll moment (mx) stays");
        assert_eq!(
            stay(&["mx".to_owned(), "fz".to_owned()]),
            "roll moment (mx), vertical force (fz) stay"
        );
    }

    #[test]
    fn regress_an_inertia_of_a_rotor_is_no_row_of_zeros() {
        assert_eq!(number(1.43e-8), "1.430e-8");
        assert_eq!(number(0.07478), "0.07478");
        let inertia = FittedParameter {
            name: "inertia_kg_m2".to_owned(),
            symbol: "J_r".to_owned(),
            unit: "kg·m²".to_owned(),
            value: 1.43e-8,
            deviation: 1.5e-9,
            interval_95: 3e-9,
            plausible: true,
        };
        assert_eq!(parameter(&inertia), "J_r = 1.43e-8 ± 3.0e-9 kg·m²");
    }
}
