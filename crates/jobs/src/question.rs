//! Questions: what a caller waits for. They are answered at once by a process of their own, within limits, and are never queued.
//!
//! ```json
//! {"question": "log-verdict", "logs": ["hover.parquet"], "model": "f550", "models": "models"}
//! ```
//! A server writes one to the standard input of `rotortwin job -`. Both are of one build, so that a question has no version. A command line
//! builds the same types from its arguments, and answers them itself.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// All kinds of questions. In JSON, `question` says which.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "question", rename_all = "kebab-case")]
pub enum Question {
    /// What the detectors say of flight logs.
    LogVerdict(LogVerdict),
    /// What an effect does to a flight.
    EffectPicture(EffectPicture),
    /// A draft of the mapping of a table.
    MappingDraft(MappingDraft),
    /// A log over time.
    LogOverTime(LogOverTime),
    /// What a campaign document says, if it can be flown.
    CampaignCheck(CampaignCheck),
    /// SQL over results.
    Sql(SqlQuestion),
}

impl Question {
    /// As a JSON object.
    ///
    /// # Errors
    /// A path is not UTF-8.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }

    /// Reads a question; `None` if the text is another kind of document.
    ///
    /// # Errors
    /// It is a question, and an invalid one.
    pub fn parse(text: &str) -> Option<serde_json::Result<Self>> {
        /// The key that makes it a question.
        #[derive(Deserialize)]
        struct Kind {
            #[serde(rename = "question")]
            _question: String,
        }
        serde_json::from_str::<Kind>(text).ok()?;
        Some(serde_json::from_str(text))
    }
}

/// Runs the detectors on flight logs, and scores them where the truth is known.
///
/// Logs are of any source, or run folders; `LOG@35:65` selects only these seconds, `LOG@NAME` a segment, `LOG@order:2-1-…` other columns as
/// rotors 1, 2, …
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogVerdict {
    /// The logs.
    pub logs: Vec<PathBuf>,
    /// Healthy vehicle assumed by the detectors, named as on the command line.
    pub model: String,
    /// Folder of the models.
    pub models: PathBuf,
    /// File of the classifier; without one the network gives no verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classifier: Option<PathBuf>,
    /// `KEY=VALUE` of the `[fdi]` table of scenarios.
    #[serde(default)]
    pub settings: Vec<String>,
    /// Healthy flights of the same vehicle, from which the detectors learn deviations from the model.
    #[serde(default)]
    pub healthy: Vec<PathBuf>,
    /// The true damage, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<LogTruth>,
    /// The report has every window of all detectors.
    #[serde(default)]
    pub windows: bool,
    /// The report has trajectory, parts, motor outputs and vibration, for plotting.
    #[serde(default)]
    pub flight: bool,
    /// The model compared with each flight over time, for a page.
    #[serde(default)]
    pub over_time: bool,
    /// Maximum number of cells of a log's table; absent: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub most_cells: Option<usize>,
}

/// Source of the true damage of logs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LogTruth {
    /// A CSV file with the columns `time_s,rotor,loss` and, for several logs, `log`.
    File(PathBuf),
    /// The content of such a file.
    Rows(String),
    /// A column of each log: 0 healthy, the damaged rotor, −1 several.
    Column(String),
}

/// How an effect of the catalogue changes a simulated flight of a vehicle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectPicture {
    /// Id of the effect; with the rotor where it has one: `rotor-thrust-scale#3`.
    pub effect: String,
    /// The vehicle or model, named as on the command line.
    pub model: String,
    /// Folder of the models.
    pub models: PathBuf,
    /// Values of its parameters; the others have typical values.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
    /// Name of the manoeuvre; absent: the one that shows the effect best.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flight: Option<String>,
    /// Effect documents of the caller.
    #[serde(default)]
    pub effects: Vec<PathBuf>,
}

/// What the columns of a third-party table may be.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MappingDraft {
    /// The table, a CSV with any columns.
    pub file: PathBuf,
}

/// Trajectory, parts, motor outputs and vibration of a log or a run folder.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogOverTime {
    /// The log.
    pub file: PathBuf,
}

/// A campaign document, read and tried without flying it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignCheck {
    /// The document.
    pub file: PathBuf,
    /// One of its flights; absent: the campaign as a whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flight: Option<u64>,
}

/// A campaign that can be flown, for programs that distribute its shards.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CheckedCampaign {
    /// Its name.
    pub name: String,
    /// Its description.
    pub description: String,
    /// Number of flights.
    pub flights: u64,
    /// Number of shards.
    pub shards: u64,
    /// Seed of all flights.
    pub seed: u64,
    /// Absolute path of the document.
    pub campaign: PathBuf,
    /// Absolute paths of all files that it needs, itself included.
    pub files: Vec<PathBuf>,
    /// Manifest of a folder of its shards (JSON).
    pub manifest: String,
}

/// A flight of a campaign, for programs that fly it elsewhere.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CheckedFlight {
    /// Its number.
    pub flight: u64,
    /// Its seed, in digits: readers of JSON may lose some of its 64 bits.
    pub seed: String,
    /// All documents of its scenario (TOML).
    pub documents: String,
}

/// One SELECT in DuckDB's SQL over Parquet files.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SqlQuestion {
    /// The statement.
    pub sql: String,
    /// Folders with results, each with its name in the column `folder`.
    pub sources: Vec<(String, String)>,
    /// Maximum number of rows; absent: all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<u64>,
    /// Maximum size of the result, bytes; absent: any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub most_bytes: Option<u64>,
    /// Memory limit of the query, MB.
    pub memory_mb: u64,
    /// Size limit of the temporary folder, MB.
    pub most_spilled_mb: u64,
    /// Time limit, s.
    pub time_s: u64,
    /// Threads; absent: as many as the process may use.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<u16>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_question_is_read_as_it_was_written() {
        let verdict = LogVerdict {
            logs: vec!["hover.parquet@5:30".into()],
            model: "f550".to_owned(),
            models: "models".into(),
            truth: Some(LogTruth::Rows("time_s,rotor,loss\n3,1,0.1\n".to_owned())),
            most_cells: Some(9),
            ..LogVerdict::default()
        };
        let picture = EffectPicture {
            effect: "rotor-drag".to_owned(),
            parameters: BTreeMap::from([("drag_n_s_m".to_owned(), 0.3)]),
            ..EffectPicture::default()
        };
        let sql = SqlQuestion {
            sql: "-- a dash\nSELECT '\u{e9}'".to_owned(),
            sources: vec![("id".to_owned(), "jobs/1".to_owned())],
            ..SqlQuestion::default()
        };
        for question in [
            Question::LogVerdict(verdict),
            Question::EffectPicture(picture),
            Question::MappingDraft(MappingDraft { file: "a.csv".into() }),
            Question::LogOverTime(LogOverTime { file: "a.ulg".into() }),
            Question::CampaignCheck(CampaignCheck {
                file: "wide.toml".into(),
                flight: Some(7),
            }),
            Question::Sql(sql),
        ] {
            let text = question.to_json().unwrap();
            assert_eq!(Question::parse(&text).expect("a question").unwrap(), question, "{text}");
        }
    }

    #[test]
    fn val_another_document_is_no_question_and_an_unknown_key_is_refused() {
        assert!(Question::parse(r#"{"version": 2, "job": {}}"#).is_none());
        assert!(Question::parse("no JSON").is_none());
        for (text, words) in [
            (r#"{"question": "weather"}"#, "unknown variant `weather`"),
            (
                r#"{"question": "mapping-draft", "file": "a", "files": []}"#,
                "unknown field `files`",
            ),
        ] {
            let error = Question::parse(text).expect("a question").unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
