//! Reasons in plain words: numbers with units, why an effect was named, why a rival lost.

use super::result::{Diagnosis, Finding, Rival, Verdict};
use crate::estimation::candidates::Candidate;
use crate::estimation::parameters::FittedParameter;

/// A value with three or four significant digits.
pub(crate) fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 8) as usize;
    format!("{value:.digits$}")
}

/// `k_d = 0.2530 ± 0.0020 N·s/m`, with half the width of the 95 % interval.
pub(crate) fn parameter(p: &FittedParameter) -> String {
    let unit = if p.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", p.unit)
    };
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

/// Why a rival lost against the winner.
pub(crate) fn why_lost(winner: &Candidate, rival: &Candidate, gap: f64, implausible: Option<String>) -> String {
    if let Some(value) = implausible {
        return format!("it would need {value}, outside of what real vehicles have");
    }
    let missing: Vec<&str> = winner
        .declaration
        .channels
        .iter()
        .filter(|channel| !rival.declaration.channels.contains(channel))
        .map(|channel| channel.symbol())
        .collect();
    if missing.is_empty() {
        let by = winner.declaration.excited_by;
        format!(
            "it shows in the same channels, but its shape over the flight fits worse by ln BF {gap:.1}; what tells them apart: {by}"
        )
    } else {
        format!(
            "it leaves the error in {} where it is (ln BF {gap:.1} worse)",
            missing.join(", ")
        )
    }
}

/// A number with its unit, if it has one.
pub(crate) fn quantity(value: f64, unit: &str) -> String {
    format!("{} {unit}", number(value)).trim_end().to_owned()
}

/// Why an effect was named.
pub(crate) fn why_found(finding: &Finding, minimum: Option<f64>) -> String {
    let mut text = format!(
        "ln Bayes factor {:.0} against small errors of all other parameters; shows in {}",
        finding.ln_bayes_factor,
        finding.channels.join(", ")
    );
    if let (Some(minimum), Some(first)) = (minimum, finding.parameters.first()) {
        text += &format!("; {} would have been seen", quantity(minimum, &first.unit));
    }
    if let Some(onset) = finding.onset_s {
        text += &format!("; it sets in at {onset:.1} s");
    }
    text
}

fn names(rivals: &[Rival]) -> String {
    if rivals.is_empty() {
        "none".into()
    } else {
        rivals
            .iter()
            .map(|r| r.label.to_lowercase())
            .collect::<Vec<_>>()
            .join(", ")
    }
}

/// The verdict as a sentence.
pub(crate) fn sentence(diagnosis: &Diagnosis) -> String {
    let share = diagnosis.goodness.explained_share.map_or(String::new(), |share| {
        format!(" Explains {:.1} % of the excess error.", 100.0 * share.clamp(0.0, 1.0))
    });
    let held_out: Vec<String> = diagnosis
        .held_out
        .iter()
        .filter(|e| (e.before - e.after).abs() > 0.01 * e.before)
        .map(|e| {
            format!(
                " Held-out {} error {} → {} m{}.",
                e.quantity,
                number(1e3 * e.before),
                number(1e3 * e.after),
                e.unit
            )
        })
        .collect();
    let named = |findings: &[Finding]| {
        findings
            .iter()
            .map(|f| {
                let onset = f.onset_s.map_or(String::new(), |t| format!(" from {t:.1} s on"));
                format!("{}, {}{onset}", f.label.to_lowercase(), parameters(f))
            })
            .collect::<Vec<_>>()
            .join("; and ")
    };
    let found: Vec<Finding> = diagnosis
        .effects
        .iter()
        .chain(&diagnosis.sensor_or_timing)
        .cloned()
        .collect();
    let rivals: Vec<Rival> = found.iter().flat_map(|f| f.also_compatible.clone()).collect();
    match &diagnosis.verdict {
        Verdict::Agrees => {
            "The model agrees with this flight: no effect of the catalogue is missing at a size that would show.".into()
        }
        Verdict::NothingTestable => "Nothing of this log can be held against the model.".into(),
        Verdict::OutsideCatalogue => {
            let unexplained = diagnosis.goodness.unexplained.join(", ");
            let part = if found.is_empty() {
                String::new()
            } else {
                format!(
                    " A part looks like {}, which must not be trusted while the rest is unexplained.",
                    named(&found)
                )
            };
            format!("The error is real and not, or not wholly, in the catalogue: {unexplained} stay unexplained.{part}")
        }
        Verdict::CannotTell { group } => format!(
            "This flight cannot tell {} apart: best fit {}.{share}",
            group.join(" from "),
            named(&diagnosis.effects)
        ),
        Verdict::LogFault { .. } => format!(
            "The log is at fault, not the physics: {}.{share}{} Also compatible: {}.",
            named(&diagnosis.sensor_or_timing),
            held_out.concat(),
            names(&rivals)
        ),
        Verdict::Missing { .. } => {
            let fault = if diagnosis.sensor_or_timing.is_empty() {
                String::new()
            } else {
                format!(" And a fault of the log: {}.", named(&diagnosis.sensor_or_timing))
            };
            format!(
                "Missing: {}.{share}{}{fault} Also compatible: {}.",
                named(&diagnosis.effects),
                held_out.concat(),
                names(&rivals)
            )
        }
    }
}
