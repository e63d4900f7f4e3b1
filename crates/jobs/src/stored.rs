//! A job as a row of the queue, in every form written by any version of rotortwin.
//!
//! | Version | Row | Written by |
//! |---|---|---|
//! | 1 | a flight's fields, or `args` of a command with its `inputs` | rotortwin before jobs had types |
//! | 2 | `{"version": 2, "job": …, "inputs": …}` | this one |
//!
//! All queued rows can be read; only the newest form is written. A new field of a job gets a default (`#[serde(default)]`); anything that
//! changes the meaning of a row gets a new version here.

use crate::error::NotUnderstood;
use crate::{Input, Job, version_1};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Version written.
const VERSION: u64 = 2;

/// A job with its inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredJob {
    /// The job, executed in its own folder. Paths are relative to that folder; its files go to `out` there.
    pub job: Job,
    /// Inputs to lay out there first.
    pub inputs: Vec<Input>,
}

#[derive(Serialize)]
struct Written<'a> {
    version: u64,
    job: &'a Job,
    inputs: &'a [Input],
}

/// Other keys, such as that of a trace, belong to other components.
#[derive(Deserialize)]
struct Read {
    job: Job,
    #[serde(default)]
    inputs: Vec<Input>,
}

impl StoredJob {
    /// A job without inputs.
    pub const fn alone(job: Job) -> Self {
        Self {
            job,
            inputs: Vec::new(),
        }
    }

    /// As a row: a JSON object.
    ///
    /// # Errors
    /// A path is not UTF-8.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string(&Written {
            version: VERSION,
            job: &self.job,
            inputs: &self.inputs,
        })
    }

    /// Reads a row of any version up to this one's.
    ///
    /// # Errors
    /// It is invalid or has a later version.
    pub fn parse(text: &str) -> Result<Self, NotUnderstood> {
        let told = |error: serde_json::Error| NotUnderstood(error.to_string());
        let value: Value = serde_json::from_str(text).map_err(told)?;
        match value.get("version").map(Value::as_u64) {
            None => version_1::read(value).map(|(job, inputs)| Self { job, inputs }),
            Some(Some(VERSION)) => {
                let Read { job, inputs } = serde_json::from_value(value).map_err(told)?;
                Ok(Self { job, inputs })
            }
            Some(version) => Err(NotUnderstood(format!(
                "it has version {}; expected at most {VERSION}: it was queued by a later version",
                version.map_or_else(|| "?".to_owned(), |version| version.to_string())
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Diagnosis;

    fn job() -> StoredJob {
        StoredJob {
            job: Job::Diagnosis(Diagnosis {
                logs: vec!["logs/1/flight.parquet@35:65".into()],
                model: "version.toml".to_owned(),
                models: "models".into(),
                effects: Vec::new(),
                baseline: Vec::new(),
                out: Some("out".into()),
                time_limit_s: None,
            }),
            inputs: vec![Input::text("version.toml", "name = 'x'")],
        }
    }

    #[test]
    fn val_a_row_is_read_as_it_was_written() {
        let text = job().to_json().unwrap();
        assert_eq!(StoredJob::parse(&text), Ok(job()));
        // A trace inserts its own key first.
        let traced = text.replacen('{', "{\"traceparent\":\"00-1\",", 1);
        assert_eq!(StoredJob::parse(&traced), Ok(job()));
    }

    #[test]
    fn val_rows_that_cannot_be_read_say_why() {
        let text = job().to_json().unwrap();
        for (row, words) in [
            (text.replace("\"version\":2", "\"version\":3"), "a later version"),
            (text.replace("\"version\":2", "\"version\":\"x\""), "version ?"),
            (text.replace("diagnosis", "horoscope"), "unknown variant `horoscope`"),
            ("[".to_owned(), "EOF"),
            ("{}".to_owned(), "neither a flight nor a command"),
        ] {
            let error = StoredJob::parse(&row).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
