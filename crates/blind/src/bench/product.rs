//! The product's own diagnosis, read from its JSON (`rotortwin diagnose … --json`) into an [`Answer`].
//!
//! Only the fields that the score needs are read, by name; a missing one is an error that names it, never a guess.

use super::answer::{Answer, Estimate, Finding, Verdict};
use serde_json::Value;
use std::collections::BTreeMap;

/// A field that must be there.
fn field<'a>(value: &'a Value, name: &str) -> Result<&'a Value, String> {
    value.get(name).ok_or_else(|| format!("the diagnosis has no `{name}`"))
}

fn list<'a>(value: &'a Value, name: &str) -> Result<&'a Vec<Value>, String> {
    field(value, name)?
        .as_array()
        .ok_or_else(|| format!("`{name}` of the diagnosis is not a list"))
}

fn text(value: &Value, name: &str) -> Result<String, String> {
    let text = field(value, name)?
        .as_str()
        .ok_or_else(|| format!("`{name}` of the diagnosis is not text"))?;
    Ok(text.to_owned())
}

fn number(value: &Value, name: &str) -> Result<f64, String> {
    field(value, name)?
        .as_f64()
        .ok_or_else(|| format!("`{name}` of the diagnosis is not a number"))
}

fn rotor(value: &Value) -> Option<usize> {
    value.get("rotor").and_then(Value::as_u64).map(|rotor| rotor as usize)
}

/// `id`, or `id:3` for rotor 3.
fn key(id: &str, rotor: Option<usize>) -> String {
    rotor.map_or_else(|| id.to_owned(), |rotor| format!("{id}:{rotor}"))
}

fn finding(value: &Value) -> Result<Finding, String> {
    let instance = field(value, "instance")?;
    let mut parameters = BTreeMap::new();
    for parameter in list(value, "parameters")? {
        let (centre, half) = (number(parameter, "value")?, number(parameter, "interval_95")?);
        let estimate = Estimate {
            value: centre,
            low: centre - half,
            high: centre + half,
        };
        parameters.insert(text(parameter, "name")?, estimate);
    }
    let also = list(value, "also_compatible")?
        .iter()
        .map(|rival| Ok(key(&text(rival, "effect")?, rotor(rival))))
        .collect::<Result<Vec<_>, String>>()?;
    Ok(Finding {
        id: text(instance, "effect")?,
        rotor: rotor(instance),
        parameters,
        evidence: Some(number(value, "ln_bayes_factor")?),
        onset_s: value.get("onset_s").and_then(Value::as_f64),
        also,
    })
}

/// Reads the output of a diagnosis in the product's form or, where it has no `goodness`, in this crate's own.
pub fn read_either(json: &str) -> Result<Answer, String> {
    let value: Value = serde_json::from_str(json).map_err(|error| format!("the answer is not JSON: {error}"))?;
    if value.get("goodness").is_some() {
        read_diagnosis(json)
    } else {
        super::run::read_plain(json)
    }
}

/// Reads the JSON of a diagnosis.
pub fn read_diagnosis(json: &str) -> Result<Answer, String> {
    let value: Value = serde_json::from_str(json).map_err(|error| format!("the diagnosis is not JSON: {error}"))?;
    let mut findings = Vec::new();
    for part in ["effects", "sensor_or_timing"] {
        for item in list(&value, part)? {
            findings.push(finding(item)?);
        }
    }
    let evidence = |finding: &Finding| finding.evidence.unwrap_or(0.0);
    findings.sort_by(|a, b| evidence(b).total_cmp(&evidence(a)));
    let verdict = field(&value, "verdict")?;
    let doubt = findings.iter().any(|finding| !finding.also.is_empty());
    let verdict = match text(verdict, "kind")?.as_str() {
        "agrees" | "nothing-testable" => Verdict::Agrees,
        "cannot-tell" => {
            // The group's other members are alternatives of the named effect.
            for id in list(verdict, "group")?.iter().filter_map(Value::as_str) {
                if let Some(first) = findings.first_mut() {
                    first.also.push(id.to_owned());
                }
            }
            Verdict::Ambiguous
        }
        // Said to be real and not wholly in the catalogue; or nothing is claimed, because a constant is a guess.
        "outside-catalogue" | "partly-missing" | "calibrate-first" | "flights-differ" => Verdict::Outside,
        "missing" | "log-fault" if doubt => Verdict::Ambiguous,
        "missing" | "log-fault" => Verdict::Named,
        other => return Err(format!("the diagnosis has the unknown verdict `{other}`")),
    };
    let mut smallest = BTreeMap::new();
    for part in ["detectable", "not_testable"] {
        for item in list(&value, part)? {
            let size = item
                .get("minimum_size")
                .and_then(Value::as_f64)
                .unwrap_or(f64::INFINITY);
            let name = format!(
                "{}/{}",
                key(&text(item, "effect")?, rotor(item)),
                text(item, "parameter")?
            );
            smallest.insert(name, size);
        }
    }
    Ok(Answer {
        verdict,
        findings,
        smallest,
        chi2: mean_chi2(&value)?,
    })
}

/// χ² per residual over all channels, before and after the named effects were added.
fn mean_chi2(value: &Value) -> Result<Option<[f64; 2]>, String> {
    let channels = list(field(value, "goodness")?, "channels")?;
    let mut sums = [0.0, 0.0];
    for channel in channels {
        sums[0] += number(channel, "chi2_before")?;
        sums[1] += number(channel, "chi2_after")?;
    }
    let count = channels.len() as f64;
    Ok((count > 0.0).then(|| sums.map(|sum| sum / count)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIAGNOSIS: &str = r#"{
        "verdict": { "kind": "missing", "effects": ["rotor-drag"] },
        "effects": [{
            "instance": { "effect": "rotor-drag", "parameters": { "drag_n_s_m": 0.25 } },
            "parameters": [{ "name": "drag_n_s_m", "value": 0.25, "interval_95": 0.01 }],
            "ln_bayes_factor": 812.0, "onset_s": null,
            "also_compatible": [{ "effect": "rotor-tilt-radial", "rotor": 2 }]
        }],
        "sensor_or_timing": [],
        "not_testable": [{ "effect": "vortex-ring", "rotor": null, "parameter": "loss", "minimum_size": null }],
        "detectable": [{ "effect": "mass", "rotor": null, "parameter": "share", "minimum_size": 0.018 }],
        "goodness": { "channels": [{ "chi2_before": 4.0, "chi2_after": 1.0 }, { "chi2_before": 2.0, "chi2_after": 1.0 }] }
    }"#;

    #[test]
    fn scenario_a_diagnosis_becomes_an_answer() {
        let answer = read_diagnosis(DIAGNOSIS).unwrap();
        assert_eq!(answer.verdict, Verdict::Ambiguous);
        assert_eq!(answer.findings[0].also, ["rotor-tilt-radial:2"]);
        assert_eq!(answer.smallest["mass/share"], 0.018);
        assert!(answer.smallest["vortex-ring/loss"].is_infinite());
        assert_eq!(answer.chi2, Some([3.0, 1.0]));
        assert_eq!(read_either(DIAGNOSIS).unwrap(), answer);
        let plain = serde_json::json!({ "verdict": "agrees", "findings": [] }).to_string();
        assert_eq!(read_either(&plain).unwrap().verdict, Verdict::Agrees);
    }

    #[test]
    fn scenario_a_missing_field_is_named() {
        let broken = DIAGNOSIS.replace("ln_bayes_factor", "evidence");
        assert_eq!(
            read_diagnosis(&broken).unwrap_err(),
            "the diagnosis has no `ln_bayes_factor`"
        );
        let unknown = DIAGNOSIS.replace("\"missing\"", "\"maybe\"");
        assert!(read_diagnosis(&unknown).unwrap_err().contains("unknown verdict"));
    }
}
