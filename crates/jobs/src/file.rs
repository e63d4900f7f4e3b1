//! A job as a file, for the process that executes it: `rotortwin job FILE`.
//!
//! ```json
//! {"version": 2, "job": {"job": "diagnosis", "logs": ["hover.parquet"], "model": "f550.toml", "models": "models"}}
//! ```
//! A worker writes one for each job. `here` contains what only the executing machine knows; keys omitted there default to those of the
//! command line.

use crate::Job;
use crate::error::NotUnderstood;
use crate::stored::StoredJob;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::PathBuf;
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// Version written.
const VERSION: u64 = 2;

/// A job, and the settings of the machine that executes it. Paths are relative to the folder in which the process is started.
#[derive(Debug, Clone, PartialEq)]
pub struct JobFile {
    /// The job.
    pub job: Job,
    /// Settings of the machine.
    pub here: Here,
}

/// Settings of the machine that executes a job.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = JobPlace)]
#[serde(deny_unknown_fields)]
pub struct Here {
    /// The process ends when its standard input is closed; the parent process holds it open.
    #[serde(default)]
    pub until_input_ends: bool,
    /// For a flight.
    #[serde(default)]
    pub flight: FlightHere,
}

/// What a flight requires from the host of the plant.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = FlightPlace)]
#[serde(deny_unknown_fields)]
pub struct FlightHere {
    /// Run folder to write; unset: `out`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub out: Option<PathBuf>,
    /// Telemetry samples to report per second of simulated time; unset: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub live_hz: Option<f64>,
    /// Endpoint at which processes on other hosts connect to the plant; unset: a free port of this host's loopback address.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub meeting: Option<Meeting>,
    /// Address of the autopilot named by the job.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub autopilot: Option<AutopilotHere>,
}

/// Meeting point of the processes of a flight that are not all on one host.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = FlightMeeting)]
#[serde(rename_all = "kebab-case")]
pub enum Meeting {
    /// The plant listens here: `tcp/10.0.0.2:7447`.
    Listen(String),
    /// All connect to this router: `tcp/router:7447`.
    Connect(String),
}

/// An autopilot that can be reached from here, as configured by its operator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = AutopilotPlace)]
pub struct AutopilotHere {
    /// `ardupilot:ADDR`, `px4:ADDR` or `betaflight:ADDR`.
    pub address: String,
    /// Its command address, or `none`; unset: the default of such an autopilot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pilot: Option<String>,
}

/// A job as a file, for `rotortwin job FILE`. Paths are relative to the working directory of the process.
#[derive(Serialize, ToSchema)]
struct Written<'a> {
    /// Version of this format: 2.
    version: u64,
    /// The job.
    #[schema(value_type = Job)]
    job: &'a Job,
    /// Settings of the machine that executes the job; defaults are those of the command line.
    #[schema(value_type = Option<Here>)]
    here: &'a Here,
}

impl PartialSchema for JobFile {
    fn schema() -> RefOr<Schema> {
        Written::schema()
    }
}

impl ToSchema for JobFile {
    fn name() -> Cow<'static, str> {
        "JobFile".into()
    }

    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        Written::schemas(schemas);
    }
}

/// The keys of the file besides the job.
#[derive(Deserialize)]
struct Beside {
    #[serde(default)]
    here: Here,
}

impl JobFile {
    /// As a JSON object.
    ///
    /// # Errors
    /// A path is not UTF-8.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(&Written {
            version: VERSION,
            job: &self.job,
            here: &self.here,
        })
    }

    /// Reads a file of any version up to this one's, or a row of the queue without inputs to be laid out.
    ///
    /// # Errors
    /// It is invalid, has a later version, or names inputs that only a worker can lay out.
    pub fn parse(text: &str) -> Result<Self, NotUnderstood> {
        let StoredJob { job, inputs } = StoredJob::parse(text)?;
        if let Some(input) = inputs.first() {
            return Err(NotUnderstood(format!(
                "it requires {} as input, which a worker copies from its server's files; expected a job without `inputs`, whose files exist",
                input.path
            )));
        }
        let Beside { here } = serde_json::from_str(text).map_err(|error| NotUnderstood(error.to_string()))?;
        Ok(Self { job, here })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, Verification};

    fn file() -> JobFile {
        JobFile {
            job: Job::Verification(Verification { run: "run".into() }),
            here: Here {
                until_input_ends: true,
                flight: FlightHere {
                    meeting: Some(Meeting::Connect("tcp/router:7447".to_owned())),
                    ..FlightHere::default()
                },
            },
        }
    }

    #[test]
    fn val_a_file_is_read_as_it_was_written() {
        assert_eq!(JobFile::parse(&file().to_json().unwrap()), Ok(file()));
        let by_hand = r#"{"version": 2, "job": {"job": "verification", "run": "run"}}"#;
        let here = Here::default();
        assert_eq!(JobFile::parse(by_hand), Ok(JobFile { here, ..file() }));
    }

    #[test]
    fn val_what_cannot_be_done_from_a_file_says_why() {
        let row = StoredJob {
            job: file().job,
            inputs: vec![Input::folder("run", "jobs/1/1/out")],
        };
        let text = file().to_json().unwrap();
        for (text, words) in [
            (row.to_json().unwrap(), "it requires run as input"),
            (text.replace("until_input_ends", "until"), "unknown field `until`"),
            (text.replace("\"version\": 2", "\"version\": 3"), "a later version"),
        ] {
            let error = JobFile::parse(&text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
