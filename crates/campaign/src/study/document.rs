//! Campaign documents: a base scenario, the values set on it, and the axes that vary it.
//!
//! ```toml
//! name = "example"
//! description = "…"
//! scenario = "../scenarios/reference-flight.toml" # relative to this file
//! seed = 7
//! repeats = 5                                     # or: flights = 10000
//!
//! [set]                                           # on the base scenario, as it would stand there
//! duration_s = 90.0
//!
//! [[axis]]
//! name = "charge"
//! key = "initial.state_of_charge"                 # or keys = [...]: the same value at several places
//! values = [0.4, 1.0]                             # combined with the values of every other axis
//!
//! [[axis]]
//! name = "loss"
//! key = "fault[0].thrust_loss_percent"
//! log_uniform = [0.5, 20.0]                       # drawn anew for every flight
//! ```
//!
//! This module only reads and checks the form; [`Campaign`](super::plan::Campaign) interprets it.

use rotortwin_scenario::ConfigError;
use rotortwin_scenario::template::TomlFile;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

/// Maximum number of flights of a campaign.
pub const MAX_FLIGHTS: u64 = 100_000_000;

/// Maximum number of axes, and of values per axis.
const MAX_AXES: usize = 32;
const MAX_VALUES: usize = 100_000;

/// A campaign document as written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignDocument {
    /// Name shown to people; names the folder.
    pub name: String,
    /// What the campaign shows.
    pub description: String,
    /// Path of the base scenario, relative to the campaign document.
    pub scenario: String,
    /// Seed of all draws and of the flights' own seeds.
    #[serde(default = "one")]
    pub seed: u64,
    /// How often the product of the grids is flown, each time with new draws and seeds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeats: Option<u64>,
    /// Flights in all, in place of `repeats`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flights: Option<u64>,
    /// Values on the base scenario, as they would stand there.
    #[serde(default)]
    pub set: Table,
    /// What varies.
    #[serde(default)]
    pub axis: Vec<AxisDocument>,
    /// What counts as good.
    #[serde(default)]
    pub criteria: Criteria,
    /// Thresholds of the sequential detector that fly along.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operating_curve: Option<OperatingCurve>,
}

fn one() -> u64 {
    1
}

/// `[[axis]]`: where its value goes (`key`, `keys`, or implied), and exactly one source of values.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AxisDocument {
    /// Name of the column of the results.
    pub name: String,
    /// Dotted path in the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key: Option<String>,
    /// Dotted paths that all get the same value.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys: Vec<String>,
    /// A list of values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values: Option<Vec<Value>>,
    /// Whole numbers, both ends included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<[i64; 2]>,
    /// Drawn, every number alike.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uniform: Option<[f64; 2]>,
    /// Drawn, log-uniform.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_uniform: Option<[f64; 2]>,
    /// Rotors of the flight's vehicle, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotors: Option<bool>,
    /// Trajectories of the 48-flight protocol by name; the key is `trajectory`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub courses: Option<Vec<String>>,
    /// Named sets of keys.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub case: Vec<CaseDocument>,
    /// `each`: combined with every other axis; `any`: drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pick: Option<Pick>,
    /// Name of an axis before this one whose value must not be drawn again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other_than: Option<String>,
}

/// How an axis takes its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pick {
    /// Every value with every value of every other such axis.
    Each,
    /// One value drawn for each flight.
    Any,
}

/// `[[axis.case]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseDocument {
    /// Name in the results.
    pub name: String,
    /// What it sets on the scenario.
    #[serde(default)]
    pub set: Table,
}

/// `[criteria]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Criteria {
    /// A fault counts as isolated in time if its rotor is named within this time after the onset, s.
    pub isolate_within_s: f64,
    /// `--hunt`: a correct verdict later than this is a failure, s.
    pub late_after_s: f64,
    /// Largest tilt before a flight counts as lost, degrees.
    pub lost_tilt_deg: f64,
    /// Largest distance to the reference before a flight counts as lost, m.
    pub lost_distance_m: f64,
}

impl Default for Criteria {
    fn default() -> Self {
        Self {
            isolate_within_s: 10.0,
            late_after_s: 3.0,
            lost_tilt_deg: 90.0,
            lost_distance_m: 50.0,
        }
    }
}

/// `[operating_curve]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OperatingCurve {
    /// Evidence that it takes to name a rotor, nats: one more instance of the sequential detector in every flight for each.
    pub evidence_nats: Vec<f32>,
}

impl CampaignDocument {
    /// Reads the document of `file` and checks its form.
    pub fn read(file: &TomlFile) -> Result<Self, ConfigError> {
        let document: Self = file.parse()?;
        document.check().map_err(|(key, reason)| file.refuse(&key, reason))?;
        Ok(document)
    }

    fn check(&self) -> Result<(), (String, String)> {
        let refuse = |key: &str, reason: String| Err((key.to_owned(), reason));
        if !is_plain(&self.name) {
            let reason = format!(
                "expected a name of 1 to 64 letters, digits, '-', '_' and '.' that begins with a letter or digit, got {:?}",
                self.name
            );
            return refuse("name", reason);
        }
        // A seed passes through formats that store only 53 bits exactly.
        if self.seed >= 1 << 53 {
            return refuse("seed", format!("expected a whole number below 2^53, got {}", self.seed));
        }
        match (self.repeats, self.flights) {
            (Some(_), Some(_)) => return refuse("flights", "expected one of repeats and flights, got both".into()),
            (Some(0), None) => return refuse("repeats", "expected 1 or more, got 0".into()),
            (None, Some(count)) if count == 0 || count > MAX_FLIGHTS => {
                return refuse("flights", format!("expected 1 to {MAX_FLIGHTS}, got {count}"));
            }
            _ => {}
        }
        if self.axis.len() > MAX_AXES {
            return refuse(
                "axis",
                format!("expected at most {MAX_AXES} axes, got {}", self.axis.len()),
            );
        }
        for (i, axis) in self.axis.iter().enumerate() {
            axis.check(&self.axis[..i]).map_err(|(key, reason)| {
                (
                    format!("axis[{i}]{}{key}", if key.is_empty() { "" } else { "." }),
                    reason,
                )
            })?;
        }
        let criteria = &self.criteria;
        for (key, value, max) in [
            ("isolate_within_s", criteria.isolate_within_s, 86_400.0),
            ("late_after_s", criteria.late_after_s, 86_400.0),
            ("lost_tilt_deg", criteria.lost_tilt_deg, 180.0),
            ("lost_distance_m", criteria.lost_distance_m, 1e6),
        ] {
            if !(value > 0.0 && value <= max) {
                return refuse(
                    &format!("criteria.{key}"),
                    format!("expected a number above 0, at most {max}, got {value}"),
                );
            }
        }
        if let Some(curve) = &self.operating_curve {
            let levels = &curve.evidence_nats;
            let rising = levels.windows(2).all(|pair| pair[0] < pair[1]);
            if levels.is_empty() || levels.len() > 16 || !rising || !levels.iter().all(|x| (1.0..=1000.0).contains(x)) {
                return refuse(
                    "operating_curve.evidence_nats",
                    format!("expected 1 to 16 rising numbers from 1 to 1000, got {levels:?}"),
                );
            }
        }
        Ok(())
    }
}

/// True if usable as a folder name.
fn is_plain(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    name.len() <= 64 && name.starts_with(|c: char| c.is_ascii_alphanumeric()) && name.chars().all(plain)
}

impl AxisDocument {
    /// Every key that receives the value.
    pub fn all_keys(&self) -> Vec<String> {
        self.key.iter().chain(&self.keys).cloned().collect()
    }

    fn check(&self, before: &[Self]) -> Result<(), (String, String)> {
        let refuse = |key: &str, reason: &str| Err((key.to_owned(), reason.to_owned()));
        let column = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        if self.name.is_empty() || self.name.len() > 40 || !self.name.chars().all(column) {
            return refuse(
                "name",
                "expected a name of lower-case letters, digits and '_': it becomes a column",
            );
        }
        if super::cell::FIXED_COLUMNS.contains(&self.name.as_str()) || self.name.starts_with("param_") {
            return refuse("name", "this name is that of another column of the results");
        }
        if before.iter().any(|axis| axis.name == self.name) {
            return refuse("name", "another axis already has this name");
        }
        let sources = [
            self.values.is_some(),
            self.range.is_some(),
            self.uniform.is_some(),
            self.log_uniform.is_some(),
            self.rotors.is_some(),
            self.courses.is_some(),
            !self.case.is_empty(),
        ];
        if sources.iter().filter(|given| **given).count() != 1 {
            return refuse(
                "",
                "expected exactly one of values, range, uniform, log_uniform, rotors, courses, case",
            );
        }
        let own_keys = self.courses.is_some() || !self.case.is_empty();
        match (own_keys, self.key.is_some(), self.keys.is_empty()) {
            (true, false, true) | (false, true, true) | (false, false, false) => {}
            (true, ..) => {
                return refuse("key", "courses and cases define what they set: leave the key out");
            }
            (false, ..) => {
                return refuse(
                    "key",
                    "expected either key or keys: where the value goes in the scenario",
                );
            }
        }
        if (self.uniform.is_some() || self.log_uniform.is_some()) && self.pick.is_some() {
            return refuse("pick", "uniform and log_uniform are always drawn: leave it out");
        }
        self.check_values()?;
        let Some(other) = &self.other_than else { return Ok(()) };
        if !before.iter().any(|axis| axis.name == *other) {
            return refuse("other_than", "expected the name of an axis before this one");
        }
        let listed = self.values.is_some() || self.range.is_some() || self.rotors.is_some();
        if self.pick != Some(Pick::Any) || !listed {
            return refuse(
                "other_than",
                "only values, range or rotors with pick = \"any\" can differ from another axis",
            );
        }
        Ok(())
    }

    fn check_values(&self) -> Result<(), (String, String)> {
        let refuse = |key: &str, reason: String| Err((key.to_owned(), reason));
        if let Some(values) = &self.values
            && (values.is_empty() || values.len() > MAX_VALUES)
        {
            return refuse(
                "values",
                format!("expected 1 to {MAX_VALUES} values, got {}", values.len()),
            );
        }
        if let Some([first, last]) = self.range
            && (last < first || last.abs_diff(first) >= MAX_VALUES as u64)
        {
            return refuse(
                "range",
                format!("expected [first, last] with at most {MAX_VALUES} numbers, got [{first}, {last}]"),
            );
        }
        for (key, range, least) in [
            ("uniform", self.uniform, f64::NEG_INFINITY),
            ("log_uniform", self.log_uniform, 0.0),
        ] {
            if let Some([low, high]) = range
                && !(low > least && low <= high && high.is_finite())
            {
                let what = if key == "uniform" { "" } else { ", both above 0" };
                return refuse(
                    key,
                    format!("expected [low, high] with low ≤ high{what}, got [{low}, {high}]"),
                );
            }
        }
        if self.rotors == Some(false) {
            return refuse("rotors", "expected true, got false".into());
        }
        for (i, case) in self.case.iter().enumerate() {
            if case.name.is_empty() || self.case[..i].iter().any(|other| other.name == case.name) {
                return refuse(&format!("case[{i}].name"), "expected a unique name".into());
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "name = \"n\"\ndescription = \"d\"\nscenario = \"s.toml\"\n";

    fn refusal(rest: &str) -> String {
        let file = TomlFile::from_text("c.toml", &format!("{HEAD}{rest}")).expect("small");
        CampaignDocument::read(&file).expect_err("it is bad").to_string()
    }

    #[test]
    fn val_refusals_name_file_line_and_key() {
        let cases = [
            (
                "repeat = 3\n",
                "c.toml, line 4, key `repeat`: unknown key, expected one of name",
            ),
            (
                "repeats = 0\n",
                "c.toml, line 4, key `repeats`: expected 1 or more, got 0",
            ),
            (
                "repeats = 1\nflights = 2\n",
                "key `flights`: expected one of repeats and flights, got both",
            ),
            ("seed = -1\n", "key `seed`: expected"),
            (
                "[[axis]]\nname = \"a\"\nkey = \"seed\"\n",
                "c.toml, line 4, key `axis[0]`: expected exactly one of values",
            ),
            (
                "[[axis]]\nname = \"a\"\nvalues = [1]\n",
                "key `axis[0].key`: expected either key or keys",
            ),
            (
                "[[axis]]\nname = \"A b\"\nkey = \"x\"\nvalues = [1]\n",
                "line 5, key `axis[0].name`: expected a name of lower-case",
            ),
            (
                "[[axis]]\nname = \"seed\"\nkey = \"x\"\nvalues = [1]\n",
                "key `axis[0].name`: this name is that of another column",
            ),
            (
                "[[axis]]\nname = \"a\"\nkey = \"x\"\nuniform = [2.0, 1.0]\n",
                "key `axis[0].uniform`: expected [low, high] with low ≤ high",
            ),
            (
                "[[axis]]\nname = \"a\"\nkey = \"x\"\nlog_uniform = [0.0, 1.0]\n",
                "both above 0, got [0, 1]",
            ),
            (
                "[[axis]]\nname = \"a\"\nkey = \"x\"\nuniform = [0.0, 1.0]\npick = \"each\"\n",
                "key `axis[0].pick`: uniform and log_uniform",
            ),
            (
                "[[axis]]\nname = \"a\"\nkey = \"x\"\nrange = [5, 1]\n",
                "key `axis[0].range`: expected [first, last]",
            ),
            (
                "[[axis]]\nname = \"a\"\nkey = \"x\"\nrotors = true\npick = \"any\"\nother_than = \"b\"\n",
                "key `axis[0].other_than`: expected the name",
            ),
            (
                "[[axis]]\nname = \"a\"\ncourses = [\"hover\"]\nkey = \"x\"\n",
                "key `axis[0].key`: courses and cases define what they set",
            ),
            (
                "[criteria]\nisolate_within_s = 0.0\n",
                "key `criteria.isolate_within_s`: expected a number above 0",
            ),
            (
                "[operating_curve]\nevidence_nats = [20.0, 10.0]\n",
                "key `operating_curve.evidence_nats`: expected 1 to 16 rising",
            ),
        ];
        for (text, want) in cases {
            let got = refusal(text);
            assert!(
                got.starts_with("c.toml") && got.contains(want),
                "{text}\n got: {got}\nwant: {want}"
            );
        }
    }
}
