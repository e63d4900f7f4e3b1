//! Rows of version 1: a flight, or a command line. The options are those that the server wrote then, not today's, which may change.

use crate::campaign::Campaign;
use crate::error::NotUnderstood;
use crate::flight::Flight;
use crate::log::LogImport;
use crate::training::{Hyperparameters, Training};
use crate::twin::{Comparison, Diagnosis, Improvement};
use crate::{BlindBench, Input, Job};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::ops::Range;
use std::path::PathBuf;

/// Placeholder: the number of threads that the worker assigns to one job.
const THREADS: &str = "{threads}";

#[derive(Deserialize)]
struct Task {
    args: Vec<String>,
    inputs: Vec<Input>,
}

/// Reads a row of version 1: the job and its inputs.
pub(crate) fn read(value: Value) -> Result<(Job, Vec<Input>), NotUnderstood> {
    let told = |error: serde_json::Error| NotUnderstood(error.to_string());
    if value.get("documents").is_some() {
        let flight: Flight = serde_json::from_value(value).map_err(told)?;
        return Ok((Job::Run(flight), Vec::new()));
    }
    if value.get("args").is_none() {
        return Err(NotUnderstood("it is neither a flight nor a command".to_owned()));
    }
    let task: Task = serde_json::from_value(value).map_err(told)?;
    Ok((Words::parse(&task.args).job()?, task.inputs))
}

/// A parsed command line.
struct Words<'a> {
    all: &'a [String],
    /// Arguments before the first option.
    plain: Vec<&'a str>,
    /// Names without dashes, each with its arguments.
    options: Vec<(&'a str, Vec<&'a str>)>,
}

impl<'a> Words<'a> {
    fn parse(all: &'a [String]) -> Self {
        let (mut plain, mut options) = (Vec::new(), Vec::<(&str, Vec<&str>)>::new());
        for word in all {
            match (word.strip_prefix("--"), options.last_mut()) {
                (Some(option), _) => options.push(match option.split_once('=') {
                    Some((name, value)) => (name, vec![value]),
                    None => (option, Vec::new()),
                }),
                (None, None) => plain.push(word.as_str()),
                (None, Some((_, values))) => values.push(word),
            }
        }
        Self { all, plain, options }
    }

    fn refused(&self, reason: &str) -> NotUnderstood {
        NotUnderstood(format!("'{}': {reason}", self.all.join(" ")))
    }

    fn has(&self, option: &str) -> bool {
        self.options.iter().any(|(name, _)| *name == option)
    }

    /// All arguments of an option, over all its occurrences.
    fn all_of<T: From<&'a str>>(&self, option: &str) -> Vec<T> {
        let named = self.options.iter().filter(|(name, _)| *name == option);
        named.flat_map(|(_, values)| values).map(|word| T::from(word)).collect()
    }

    fn maybe(&self, option: &str) -> Option<&'a str> {
        self.all_of::<&str>(option).first().copied()
    }

    fn one(&self, option: &str) -> Result<&'a str, NotUnderstood> {
        self.maybe(option)
            .ok_or_else(|| self.refused(&format!("--{option} is missing")))
    }

    /// A number, or one of a list of names.
    fn value<T: DeserializeOwned>(&self, option: &str) -> Result<T, NotUnderstood> {
        let word = self.one(option)?;
        let number = serde_json::from_str(word);
        number
            .or_else(|_not_a_number| serde_json::from_value(Value::String(word.to_owned())))
            .map_err(|error| self.refused(&format!("--{option}: {error}")))
    }

    fn range(&self, option: &str) -> Result<Option<Range<u64>>, NotUnderstood> {
        let Some(word) = self.maybe(option) else {
            return Ok(None);
        };
        let range = word
            .split_once("..")
            .and_then(|(start, end)| Some(start.parse().ok()?..end.parse().ok()?));
        match range {
            Some(range) => Ok(Some(range)),
            None => Err(self.refused(&format!("--{option}: expected FIRST..END"))),
        }
    }

    /// Only the placeholder was ever written.
    fn check_threads(&self, option: &str) -> Result<(), NotUnderstood> {
        match self.maybe(option) {
            None | Some(THREADS) => Ok(()),
            Some(_) => Err(self.refused(&format!("--{option}: expected {THREADS}"))),
        }
    }

    fn paths(words: &[&str]) -> Vec<PathBuf> {
        words.iter().map(PathBuf::from).collect()
    }

    fn job(&self) -> Result<Job, NotUnderstood> {
        Ok(match self.plain.as_slice() {
            ["campaign", document] => {
                self.check_threads("threads")?;
                Job::Campaign(Campaign {
                    campaign: document.into(),
                    out: self.one("out")?.into(),
                    shards: self.range("shards")?,
                    limit: None,
                    threads: None,
                })
            }
            ["blind"] => {
                self.check_threads("jobs")?;
                let names = |option| self.one(option).map(|word| word.split(','));
                let presets: Result<_, _> = names("preset")?
                    .map(|name| serde_json::from_value(Value::String(name.to_owned())))
                    .collect();
                Job::BlindBench(BlindBench {
                    presets: presets.map_err(|error| self.refused(&error.to_string()))?,
                    n: self.value("n")?,
                    seed: self.value("seed")?,
                    vehicles: names("vehicles")?.map(str::to_owned).collect(),
                    duration_s: self.value("duration-s")?,
                    out: self.one("out")?.into(),
                    cases: self.range("cases")?,
                    processes: None,
                    keep_logs: false,
                })
            }
            ["compare", logs @ ..] => Job::Comparison(Comparison {
                logs: Self::paths(logs),
                model: self.all_of("model"),
                label: self.all_of("label"),
                models: "models".into(),
                out: Some(self.one("out")?.into()),
            }),
            ["diagnose", logs @ ..] => Job::Diagnosis(Diagnosis {
                logs: Self::paths(logs),
                model: self.one("model")?.to_owned(),
                models: "models".into(),
                effects: self.all_of("effects"),
                baseline: Vec::new(),
                out: Some(self.one("out")?.into()),
                time_limit_s: None,
            }),
            ["improve", logs @ ..] => Job::Improvement(Improvement {
                logs: Self::paths(logs),
                held_out: self.all_of("held-out"),
                model: self.one("model")?.to_owned(),
                models: self.one("models")?.into(),
                truth: None,
                out: Some(self.one("out")?.into()),
                final_version: Some(self.one("final")?.into()),
                time_limit_s: None,
            }),
            ["log", "import", file] => Job::LogImport(LogImport {
                file: file.into(),
                out: self.one("out")?.into(),
                damaged: self.has("damaged"),
                truth: false,
                vehicle: self.maybe("vehicle").map(PathBuf::from),
                mapping: None,
                rate_hz: self.has("rate").then(|| self.value("rate")).transpose()?,
                align: self.has("align"),
            }),
            ["train"] => {
                self.check_threads("threads")?;
                Job::Training(Training {
                    method: self.value("method")?,
                    scenario: self.one("scenario")?.into(),
                    seeds: self.value("seeds")?,
                    first_seed: self.value("first-seed")?,
                    out: self.one("out")?.into(),
                    threads: None,
                    hyperparameters: Hyperparameters::default(),
                })
            }
            _ => return Err(self.refused("no server has queued such a command")),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::training::Method;
    use crate::{Content, StoredJob, flight};
    use rotortwin_blind::bench::cases::Preset;
    use serde_json::json;

    fn job(args: &[&str]) -> Result<Job, NotUnderstood> {
        let row = json!({ "args": args, "inputs": [], "result": null, "discard": ["campaign.lock"] });
        StoredJob::parse(&row.to_string()).map(|stored| stored.job)
    }

    #[test]
    fn val_flights() {
        let row = r#"{"documents":"x = 1","seed":"18446744073709551615","link":"in-process","pace":"fast"}"#;
        let Job::Run(flight) = StoredJob::parse(row).unwrap().job else {
            panic!("a flight");
        };
        assert_eq!(
            (flight.documents.as_str(), flight.link),
            ("x = 1", flight::Link::InProcess)
        );
        assert_eq!(
            (flight.controller.clone(), flight.join_timeout_ms),
            (flight::Controller::Beside, 60_000)
        );
    }

    #[test]
    fn val_campaigns_and_their_parts() {
        let words = [
            "campaign",
            "library/campaigns/submitted-campaign.toml",
            "--out",
            "out",
            "--json",
            "--events",
            "--threads",
            "{threads}",
            "--shards",
            "3..6",
        ];
        let Job::Campaign(part) = job(&words).unwrap() else {
            panic!("a campaign");
        };
        assert_eq!((part.out, part.shards, part.threads), ("out".into(), Some(3..6), None));
        let Job::Campaign(whole) = job(&words[..8]).unwrap() else {
            panic!("a campaign");
        };
        assert_eq!(whole.shards, None);
        assert_eq!(
            whole.campaign,
            PathBuf::from("library/campaigns/submitted-campaign.toml")
        );
    }

    #[test]
    fn val_blind_benches() {
        let words = "blind --json --events --out out --jobs {threads} --preset mixed,null-hover --n 4 --seed 18446744073709551615 \
                     --vehicles config/vehicles/f550.toml,config/vehicles/mine.toml --duration-s 90 --cases 0..2";
        let Job::BlindBench(bench) = job(&words.split_whitespace().collect::<Vec<_>>()).unwrap() else {
            panic!("a bench");
        };
        assert_eq!(bench.presets, [Preset::Mixed, Preset::NullHover]);
        assert_eq!((bench.n, bench.seed, bench.cases), (4, u64::MAX, Some(0..2)));
        assert_eq!(bench.vehicles[1], "config/vehicles/mine.toml");
        assert!((bench.duration_s - 90.0).abs() < 1e-12);
    }

    #[test]
    fn val_the_twin() {
        let words = [
            "compare",
            "logs/1/a b.parquet@35:65",
            "runs/2",
            "--model",
            "version.toml",
            "--out",
            "out",
            "--json",
            "--label=x --y",
        ];
        let Job::Comparison(comparison) = job(&words).unwrap() else {
            panic!("a comparison");
        };
        assert_eq!(
            comparison.logs,
            [PathBuf::from("logs/1/a b.parquet@35:65"), "runs/2".into()]
        );
        assert_eq!(
            (comparison.model, comparison.label),
            (vec!["version.toml".to_owned()], vec!["x --y".to_owned()])
        );

        let words = "diagnose runs/2 --model library/vehicles/f550.toml --out out --json --events --effects effects/0.toml --effects effects/1.toml";
        let Job::Diagnosis(diagnosis) = job(&words.split(' ').collect::<Vec<_>>()).unwrap() else {
            panic!("a diagnosis");
        };
        assert_eq!(
            diagnosis.effects,
            [PathBuf::from("effects/0.toml"), "effects/1.toml".into()]
        );

        let words = "improve runs/2 --model version.toml --out out --json --events --yes --models out/models --final out/model.toml \
                     --held-out runs/3 runs/4@1:2";
        let Job::Improvement(improvement) = job(&words.split_whitespace().collect::<Vec<_>>()).unwrap() else {
            panic!("an improvement");
        };
        assert_eq!(improvement.held_out, [PathBuf::from("runs/3"), "runs/4@1:2".into()]);
        assert_eq!(
            (improvement.models, improvement.final_version),
            ("out/models".into(), Some("out/model.toml".into()))
        );
    }

    #[test]
    fn val_logs_and_training() {
        let words = "log import log.csv --out out --quiet --rate 200.5 --align --vehicle library/vehicles/f550.toml";
        let Job::LogImport(import) = job(&words.split(' ').collect::<Vec<_>>()).unwrap() else {
            panic!("an import");
        };
        assert_eq!(
            (import.rate_hz, import.align, import.damaged),
            (Some(200.5), true, false)
        );
        assert_eq!(import.vehicle, Some("library/vehicles/f550.toml".into()));

        let words = "train --out out/classifier.json --method improved --scenario library/scenarios/x.toml --seeds 5 --first-seed 7 \
                     --threads {threads} --json";
        let Job::Training(training) = job(&words.split_whitespace().collect::<Vec<_>>()).unwrap() else {
            panic!("a training");
        };
        assert_eq!(
            (training.method, training.seeds, training.first_seed),
            (Method::Improved, 5, 7)
        );
    }

    #[test]
    fn val_inputs_stay_and_unknown_words_are_refused() {
        let row = json!({ "args": ["compare", "runs/2", "--model", "v.toml", "--out", "out"], "result": null,
            "inputs": [{ "path": "runs/2", "content": { "folder": "jobs/2/1/out" } }, { "path": "out", "content": "parts" }] });
        let stored = StoredJob::parse(&row.to_string()).unwrap();
        assert_eq!(
            stored.inputs,
            [
                Input::folder("runs/2", "jobs/2/1/out"),
                Input {
                    path: "out".to_owned(),
                    content: Content::Parts
                }
            ]
        );
        for (words, reason) in [
            (&["fit", "thrust"][..], "no server has queued"),
            (&["diagnose", "x"], "--model is missing"),
            (
                &["campaign", "x", "--out", "out", "--threads", "8"],
                "expected {threads}",
            ),
            (&["campaign", "x", "--out", "out", "--shards", "8"], "FIRST..END"),
        ] {
            let error = job(words).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
