//! One answer against one truth.

use super::answer::{Answer, Finding, Verdict};
use super::cases::{Case, Preset};
use crate::catalogue;
use crate::draw::same_group;
use crate::hidden::Hidden;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Outcome of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[schema(as = BlindOutcome)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// Exactly the hidden effects, or rightly none.
    Right,
    /// The hidden effects and more, or an effect of the right one's named group.
    InGroup,
    /// Nothing named, and the answer said that this size would not show in this flight.
    NotTestable,
    /// Outside the catalogue, and said so.
    Flagged,
    /// Nothing named although the answer claims that the size would have shown.
    Missed,
    /// A wrong name, with a doubt attached: an ambiguity, or "not all of it is in the catalogue".
    WrongFlagged,
    /// A wrong name without a doubt.
    ConfidentlyWrong,
    /// Something named where nothing is hidden.
    FalseAlarm,
    /// No answer: the diagnosis failed.
    Failed,
    /// No log: with this effect every flight was lost. Counts nowhere.
    NotFlown,
}

/// The score of one case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The case.
    pub case: Case,
    /// What became of it.
    pub outcome: Outcome,
    /// The first named effect is the hidden one (for two: one of them).
    pub top1: bool,
    /// Every hidden effect is named.
    pub all_found: bool,
    /// A named effect or one of its stated alternatives is the hidden one, or nothing is hidden and nothing named.
    pub in_group: bool,
    /// Hidden effects in words.
    pub truth: String,
    /// Named effects in words.
    pub named: String,
    /// ln Bayes factor of the first named effect.
    pub evidence: Option<f64>,
    /// Largest relative error of the parameters of each correctly named effect.
    pub parameter_errors: Vec<f64>,
    /// Whether the 95 % interval of each such parameter covers the truth.
    pub covered: Vec<bool>,
    /// s, of the onset.
    pub onset_error_s: Option<f64>,
    /// χ² per residual, before and after the named effects were added.
    pub chi2: Option<[f64; 2]>,
    /// s that the diagnosis took.
    pub seconds: f64,
    /// Why there is no answer.
    pub failure: Option<String>,
}

/// `id` or `id 3` for rotor 3.
pub fn label(id: &str, rotor: Option<usize>) -> String {
    rotor.map_or_else(|| id.to_owned(), |rotor| format!("{id} {rotor}"))
}

fn is(finding: &Finding, hidden: &Hidden) -> bool {
    // Two swapped motors may be reported from either end.
    if finding.id == "swapped-rotors" && hidden.id == finding.id {
        let partner = hidden.parameters.get("partner").map(|p| *p as usize);
        return finding.rotor == hidden.rotor || finding.rotor == partner;
    }
    finding.id == hidden.id && finding.rotor == hidden.rotor
}

fn names_as_alternative(finding: &Finding, hidden: &Hidden) -> bool {
    finding.also.iter().any(|text| {
        *text == hidden.id
            || hidden
                .rotor
                .is_some_and(|rotor| *text == format!("{}:{rotor}", hidden.id))
    })
}

/// Scores an answer.
pub fn score(case: &Case, answer: &Answer, seconds: f64) -> Row {
    let hidden = &case.effects;
    let found = &answer.findings;
    let outside = case.preset == Preset::Outside;
    let exact = hidden.len() == found.len() && hidden.iter().all(|h| found.iter().any(|f| is(f, h)));
    let all_found = hidden.iter().all(|h| found.iter().any(|f| is(f, h)));
    let in_group = if hidden.is_empty() {
        found.is_empty()
    } else {
        hidden
            .iter()
            .all(|h| found.iter().any(|f| is(f, h) || names_as_alternative(f, h)))
    };
    // A companion is hidden only so that the effect of the case does something; finding it alone is a part of the truth.
    let top1 = found.first().is_some_and(|f| hidden.iter().any(|h| is(f, h)));
    let doubtful = matches!(answer.verdict, Verdict::Ambiguous | Verdict::Outside);
    let outcome = match (hidden.is_empty(), found.is_empty(), outside) {
        (true, true, _) if answer.verdict == Verdict::Agrees => Outcome::Right,
        (true, _, _) => Outcome::FalseAlarm,
        (false, _, true) if answer.verdict == Verdict::Outside => Outcome::Flagged,
        (false, true, true) => Outcome::Missed,
        (false, false, true) if doubtful => Outcome::WrongFlagged,
        (false, false, true) => Outcome::ConfidentlyWrong,
        (false, true, false) if answer.verdict == Verdict::Outside => Outcome::WrongFlagged,
        (false, true, false) if would_not_show(hidden, answer) => Outcome::NotTestable,
        (false, true, false) => Outcome::Missed,
        (false, false, false) if exact => Outcome::Right,
        (false, false, false) if in_group => Outcome::InGroup,
        (false, false, false) if found.iter().all(|f| hidden.iter().any(|h| is(f, h))) => {
            // A part of the truth and nothing wrong: the rest was too small to show, or missed.
            let rest: Vec<Hidden> = hidden
                .iter()
                .filter(|h| !found.iter().any(|f| is(f, h)))
                .cloned()
                .collect();
            if would_not_show(&rest, answer) {
                Outcome::NotTestable
            } else {
                Outcome::Missed
            }
        }
        (false, false, false) if doubtful => Outcome::WrongFlagged,
        (false, false, false) => Outcome::ConfidentlyWrong,
    };
    let (mut parameter_errors, mut covered) = (Vec::new(), Vec::new());
    for h in hidden {
        if let Some(f) = found.iter().find(|f| is(f, h)) {
            compare_parameters(h, f, &mut parameter_errors, &mut covered);
        }
    }
    let onset_error_s = hidden.iter().find_map(|h| {
        let onset = h.onset_s?;
        let f = found.iter().find(|f| is(f, h))?;
        Some(f.onset_s.unwrap_or(0.0) - onset)
    });
    let list = |labels: Vec<String>| labels.join(" + ");
    Row {
        case: case.clone(),
        outcome,
        top1,
        all_found,
        in_group,
        truth: list(hidden.iter().map(|h| label(&h.id, h.rotor)).collect()),
        named: list(found.iter().map(|f| label(&f.id, f.rotor)).collect()),
        evidence: found.first().and_then(|f| f.evidence),
        parameter_errors,
        covered,
        onset_error_s,
        chi2: answer.chi2,
        seconds,
        failure: None,
    }
}

/// The row of a case whose diagnosis gave no answer.
pub fn failed(case: &Case, reason: String, seconds: f64) -> Row {
    let labels: Vec<String> = case.effects.iter().map(|h| label(&h.id, h.rotor)).collect();
    Row {
        case: case.clone(),
        outcome: Outcome::Failed,
        top1: false,
        all_found: false,
        in_group: false,
        truth: labels.join(" + "),
        named: String::new(),
        evidence: None,
        parameter_errors: vec![],
        covered: vec![],
        onset_error_s: None,
        chi2: None,
        seconds,
        failure: Some(reason),
    }
}

/// Whether the answer itself states that none of these effects is detectable: every size of each is below the smallest
/// detectable one.
fn would_not_show(hidden: &[Hidden], answer: &Answer) -> bool {
    hidden.iter().all(|h| {
        let Some(kind) = catalogue::kind(&h.id) else {
            return false;
        };
        // A kind without a size to scale (the lag in the speed domain) has its share instead.
        let scaled = kind.parameters.iter().any(|p| p.scales);
        let mut sizes = kind
            .parameters
            .iter()
            .filter(|p| if scaled { p.scales } else { p.name == "share" })
            .peekable();
        sizes.peek().is_some()
            && sizes.all(|p| {
                let size = h.parameters.get(p.name).map_or(0.0, |size| size.abs());
                let keyed = h
                    .rotor
                    .and_then(|rotor| answer.smallest.get(&format!("{}:{rotor}/{}", h.id, p.name)));
                let smallest = keyed.or_else(|| answer.smallest.get(&format!("{}/{}", h.id, p.name)));
                smallest.is_some_and(|smallest| size < *smallest)
            })
    })
}

/// Relative error of the whole effect (of the vector, where it has several sizes) and coverage of each size.
fn compare_parameters(hidden: &Hidden, finding: &Finding, errors: &mut Vec<f64>, covered: &mut Vec<bool>) {
    let Some(kind) = catalogue::kind(&hidden.id) else {
        return;
    };
    let (mut error, mut size) = (0.0, 0.0);
    for parameter in kind.parameters.iter().filter(|p| p.scales) {
        let Some(&truth) = hidden.parameters.get(parameter.name) else {
            continue;
        };
        size += truth * truth;
        match finding.parameters.get(parameter.name) {
            Some(estimate) => {
                error += (estimate.value - truth) * (estimate.value - truth);
                covered.push((estimate.low..=estimate.high).contains(&truth));
            }
            None => error += truth * truth,
        }
    }
    if size > 0.0 && !finding.parameters.is_empty() {
        errors.push((error / size).sqrt());
    }
}

/// Whether a wrong name is at least of the truth's physical group; for the confusion matrix.
pub fn near(row: &Row) -> bool {
    row.case.effects.iter().any(|h| {
        row.named
            .split(" + ")
            .any(|named| same_group(named.split(' ').next().unwrap_or(""), &h.id))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::answer::Estimate;

    fn case(effects: &[&str]) -> Case {
        Case {
            index: 0,
            preset: Preset::Singles,
            vehicle: String::new(),
            flight: "excitation".to_owned(),
            seed: 1,
            scale: 1.0,
            clutter: false,
            disturbance: 1.0,
            effects: effects.iter().map(|text| Hidden::parse(text).unwrap()).collect(),
        }
    }

    fn answer(verdict: Verdict, named: &[&str]) -> Answer {
        let findings = named
            .iter()
            .map(|id| Finding {
                id: (*id).to_owned(),
                ..Finding::default()
            })
            .collect();
        Answer {
            verdict,
            findings,
            smallest: Default::default(),
            chi2: None,
        }
    }

    #[test]
    fn scenario_outcomes() {
        let drag = "rotor-drag:drag_n_s_m=0.25";
        let outcome = |hidden: &[&str], answer: &Answer| score(&case(hidden), answer, 0.0).outcome;
        assert_eq!(
            outcome(&[drag], &answer(Verdict::Named, &["rotor-drag"])),
            Outcome::Right
        );
        assert_eq!(
            outcome(&[drag], &answer(Verdict::Named, &["mass"])),
            Outcome::ConfidentlyWrong
        );
        assert_eq!(
            outcome(&[drag], &answer(Verdict::Outside, &["mass"])),
            Outcome::WrongFlagged
        );
        assert_eq!(outcome(&[drag], &answer(Verdict::Agrees, &[])), Outcome::Missed);
        assert_eq!(outcome(&[], &answer(Verdict::Agrees, &[])), Outcome::Right);
        assert_eq!(outcome(&[], &answer(Verdict::Named, &["mass"])), Outcome::FalseAlarm);
        assert_eq!(outcome(&[], &answer(Verdict::Outside, &[])), Outcome::FalseAlarm);
        assert_eq!(
            outcome(&[drag, "mass"], &answer(Verdict::Named, &["mass", "rotor-drag"])),
            Outcome::Right
        );
        assert_eq!(
            outcome(&[drag, "mass"], &answer(Verdict::Named, &["mass"])),
            Outcome::Missed
        );
        let mut alternatives = answer(Verdict::Ambiguous, &["linear-friction"]);
        alternatives.findings[0].also = vec!["rotor-drag".to_owned()];
        assert_eq!(outcome(&[drag], &alternatives), Outcome::InGroup);
        let mut blind = answer(Verdict::Agrees, &[]);
        blind.smallest.insert("rotor-drag/drag_n_s_m".to_owned(), 0.3);
        assert_eq!(outcome(&[drag], &blind), Outcome::NotTestable);
        blind.smallest.insert("rotor-drag/drag_n_s_m".to_owned(), 0.2);
        assert_eq!(outcome(&[drag], &blind), Outcome::Missed);
    }

    #[test]
    fn val_parameter_error_and_coverage() {
        let mut named = answer(Verdict::Named, &["rotor-drag"]);
        let estimate = Estimate {
            value: 0.26,
            low: 0.255,
            high: 0.265,
        };
        named.findings[0].parameters.insert("drag_n_s_m".to_owned(), estimate);
        let row = score(&case(&["rotor-drag:drag_n_s_m=0.25"]), &named, 0.0);
        assert!((row.parameter_errors[0] - 0.04).abs() < 1e-12);
        assert_eq!(row.covered, [false]);
    }
}
