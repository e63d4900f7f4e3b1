//! Writes fitted values into vehicle and blade documents: one value changed in place, comments kept, provenance next to
//! it.

use super::fit::FittedModel;
use super::{FitError, refuse};

/// Replaces `key = value` in a document's text and notes where the value comes from.
///
/// The line's own comment gives way to the provenance, which names the old value. Refuses a document without exactly one such key.
pub fn replace_value(document: &str, key: &str, value: f64, provenance: &str) -> Result<String, FitError> {
    let is_key = |line: &str| line.split_once('=').is_some_and(|(name, _)| name.trim() == key);
    let count = document.lines().filter(|line| is_key(line)).count();
    if count != 1 {
        return refuse(format!(
            "expected `{key} = …` once in the document, found it {count} times"
        ));
    }
    let mut out = String::with_capacity(document.len() + 80);
    for line in document.lines() {
        match line.split_once('=') {
            Some((name, rest)) if name.trim() == key => {
                let old = rest.split('#').next().unwrap_or("").trim();
                out += &format!("{name}= {value:?} # {provenance}; was {old}\n");
            }
            _ => {
                out += line;
                out.push('\n');
            }
        }
    }
    Ok(out)
}

/// Adds a blade with the coefficients of Eq. 19 to a blade document's text. Refuses a name that is there.
pub fn add_blade(document: &str, name: &str, model: &FittedModel, provenance: &str) -> Result<String, FitError> {
    if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_') {
        return refuse(format!("`{name}`: expected a blade name of letters, digits, - and _"));
    }
    let header = format!("[blade.{name}]");
    if document
        .lines()
        .any(|line| line.split('#').next().unwrap_or("").trim() == header)
    {
        return refuse(format!(
            "the document already has a blade `{name}`; choose another name"
        ));
    }
    let value = |parameter: &str| model.parameter(parameter).map(|p| p.value);
    let (Some(a0), Some(a1), Some(a2), Some(a3), Some(v0)) =
        (value("a0"), value("a1"), value("a2"), value("a3"), value("v0_v"))
    else {
        return refuse(format!(
            "a blade document takes Eq. 19, and the fit is of `{}`",
            model.name
        ));
    };
    Ok(format!(
        "{}\n\n{header} # {provenance}\ncoefficients = [{a0:e}, {a1:e}, {a2:e}, {a3:e}] # fit RMSE {:.2} mN\nvoltage_offset_v = {v0:?}\n",
        document.trim_end(),
        1e3 * model.rmse
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench_fit::FittedParameter;

    #[test]
    fn scenario_one_value_changes_and_nothing_else() {
        let document = "[rotors]\nthrust_lag_s = 0.05 # tau\nfull_thrust_n = 12.0\n";
        let changed = replace_value(document, "thrust_lag_s", 0.061, "fit lag of x.csv").unwrap();
        assert_eq!(
            changed,
            "[rotors]\nthrust_lag_s = 0.061 # fit lag of x.csv; was 0.05\nfull_thrust_n = 12.0\n"
        );
        assert!(
            replace_value(document, "absent", 1.0, "")
                .unwrap_err()
                .to_string()
                .contains("0 times")
        );
    }

    #[test]
    fn scenario_a_blade_is_added_once() {
        let model = FittedModel {
            name: "Eq. 19",
            equation: "",
            parameters: ["a0", "a1", "a2", "a3", "v0_v"]
                .map(|name| FittedParameter {
                    name,
                    value: 1.5,
                    low: 1.0,
                    high: 2.0,
                })
                .to_vec(),
            rmse: 0.01,
            held_out_rmse: 0.01,
            r2: 1.0,
            aicc: 0.0,
            correlation: 0.0,
            intervals: "",
            fitted: vec![],
            notes: vec![],
        };
        let document = "[blade.a]\nvoltage_offset_v = 5.0\n";
        let added = add_blade(document, "bench", &model, "fit thrust").unwrap();
        assert!(added.starts_with("[blade.a]") && added.contains("[blade.bench] # fit thrust"));
        assert!(
            add_blade(&added, "bench", &model, "")
                .unwrap_err()
                .to_string()
                .contains("already has a blade")
        );
        assert!(add_blade(document, "a b", &model, "").is_err());
    }
}
