//! Execution of any job except flights: from its type to its typed result.

use crate::failure::Failure;
use crate::{
    Tell, blind, campaign, comparison, diagnosis, identification, improvement, log_example, log_import, named,
    next_flight, training, verification,
};
use rotortwin_campaign::study::Campaign;
use rotortwin_campaign::study::runner::RunEnd;
use rotortwin_campaign::study::summary::CampaignSummary;
use rotortwin_jobs::{Job, JobEvent, Progress};
use rotortwin_scenario::Classifier;
use rotortwin_twin::compare::Comparison;
use rotortwin_twin::diagnose::Diagnosis;
use rotortwin_twin::improve::Improvement;
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::next_flight::Proposal;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// Result of a job.
pub enum JobResult {
    /// Flights of some shards.
    Shards(campaign::ShardsFlown),
    /// Statistics of a campaign; `complete`: over all its flights.
    Campaign {
        /// Its summary.
        summary: Box<CampaignSummary>,
        /// It was not stopped.
        complete: bool,
    },
    /// A blind bench, or some of its cases.
    BlindBench(blind::Benched),
    /// A flight log, imported or made.
    Log {
        /// In canonical form.
        log: Box<FlightLog>,
        /// Its import report.
        account: PathBuf,
    },
    /// Models compared with flights.
    Comparison(Box<Comparison>),
    /// Missing effects of a model.
    Diagnosis(Box<Diagnosis>),
    /// Improvement of a model.
    Improvement(Box<Improvement>),
    /// A vehicle.
    Identification(Box<identification::Found>),
    /// What to fly next.
    NextFlight(Vec<Proposal>),
    /// A classifier, and its file.
    Training(Box<Classifier>, PathBuf),
    /// Two executions of one run.
    Verification(Box<verification::Verified>),
}

impl JobResult {
    /// Whether it is complete; a campaign can be stopped.
    pub const fn is_complete(&self) -> bool {
        match self {
            Self::Shards(shards) => shards.complete,
            Self::Campaign { complete, .. } => *complete,
            _ => true,
        }
    }

    /// As JSON, identical to the command's output.
    ///
    /// # Errors
    /// A file with the result cannot be read.
    pub fn json(&self) -> Result<String, Failure> {
        let written = |text: serde_json::Result<String>| text.map_err(Failure::failed);
        match self {
            Self::Shards(shards) => written(serde_json::to_string(shards)),
            Self::Campaign { summary, .. } => Ok(summary.json()),
            Self::BlindBench(blind::Benched::Part(done)) => written(serde_json::to_string(done)),
            Self::BlindBench(blind::Benched::Whole(sheet)) => {
                let value = serde_json::to_value(sheet).map_err(Failure::failed)?;
                Ok(format!("{value:#}"))
            }
            Self::Log { account, .. } => std::fs::read_to_string(account)
                .map_err(|error| Failure::failed(format!("{}: cannot be read: {error}", account.display()))),
            Self::Comparison(comparison) => Ok(rotortwin_twin::compare::files::json(comparison)),
            Self::Diagnosis(diagnosis) => Ok(diagnosis::json(diagnosis)),
            Self::Improvement(improvement) => Ok(improvement::json(improvement)),
            Self::Identification(found) => Ok(format!("{:#}", found.json())),
            Self::NextFlight(proposals) => Ok(next_flight::json(proposals)),
            Self::Training(classifier, file) => Ok(format!("{:#}", training::json(classifier, file))),
            Self::Verification(verified) => written(serde_json::to_string(&verified.verdict())),
        }
    }
}

/// Executes any job except flights, without interaction.
///
/// # Errors
/// It fails, with the reason.
pub fn perform(job: Job, tell: Tell<'_>) -> Result<JobResult, Failure> {
    Ok(match named::with_paths(job)? {
        Job::Run(_) => return Err(Failure::input("a flight is not a job of this kind")),
        Job::Campaign(job) => {
            let flights = Campaign::load(&job.campaign).map_err(Failure::input)?;
            for warning in flights.warnings() {
                tracing::warn!("{}: {warning}", job.campaign.display());
            }
            let prepared = campaign::prepare(&job, &flights)?;
            let stop = campaign::stop_flag().map_err(Failure::Failed)?;
            let flown = prepared.fly(&stop, tell)?;
            if job.shards.is_some() {
                JobResult::Shards(flown.of_shards())
            } else {
                let totals = campaign::sum_up(&flights, prepared.folder())?;
                JobResult::Campaign {
                    summary: Box::new(CampaignSummary::new(&flights, &totals)),
                    complete: flown.end == RunEnd::Complete,
                }
            }
        }
        Job::BlindBench(job) => JobResult::BlindBench(blind::prepare(&job, None)?.run(tell)?),
        Job::LogImport(job) => {
            let name = log_import::unique_names(std::slice::from_ref(&job.file)).remove(0);
            let imported = log_import::import(&job, &name)?;
            JobResult::Log {
                log: Box::new(imported.log),
                account: job.out.join(format!("{name}.import.json")),
            }
        }
        Job::LogExample(job) => JobResult::Log {
            log: Box::new(log_example::make(&job)?),
            account: job.out.join(format!("{}.import.json", log_example::NAME)),
        },
        Job::Comparison(job) => JobResult::Comparison(Box::new(comparison::compare(&job)?.comparison)),
        Job::Diagnosis(job) => JobResult::Diagnosis(Box::new(diagnosis::diagnose(&job, false, tell)?.diagnosis)),
        Job::Improvement(job) => {
            let improved = improvement::improve(&job, &mut improvement::Always, tell)?;
            JobResult::Improvement(Box::new(improved.improvement))
        }
        Job::Identification(job) => JobResult::Identification(Box::new(identification::identify(&job)?)),
        Job::NextFlight(job) => JobResult::NextFlight(next_flight::propose(&job)?.proposals),
        Job::Training(job) => {
            let prepared = training::prepare(&job)?;
            let (parts, done) = (prepared.parts().max(1), AtomicU64::new(0));
            let classifier = prepared.train(&|| {
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                tell(&JobEvent::Progress(Progress::Share {
                    share: done as f64 / parts as f64,
                    text: "flights and networks".to_owned(),
                }));
            })?;
            JobResult::Training(Box::new(classifier), job.out)
        }
        Job::Verification(job) => JobResult::Verification(Box::new(verification::verify(&job)?)),
    })
}
