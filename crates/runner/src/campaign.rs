//! Execution of a campaign, of some of its shards, or of its evaluation.

use crate::Tell;
use crate::failure::Failure;
use rotortwin_campaign::parallel::available_threads;
use rotortwin_campaign::study::engine::{OneByOne, SideBySide};
use rotortwin_campaign::study::folder::{CampaignFolder, manifest, shards_of};
use rotortwin_campaign::study::plan::PlannedFlight;
use rotortwin_campaign::study::runner::{self, Plan, RunEnd, RunOptions};
use rotortwin_campaign::study::totals::Totals;
use rotortwin_campaign::study::{Campaign, results};
use rotortwin_jobs::{Campaign as Job, CheckedCampaign, CheckedFlight, JobEvent, Progress};
use rotortwin_scenario::Scenario;
use serde::Serialize;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// Flights ready to start.
#[derive(Debug)]
pub struct Prepared<'a> {
    campaign: &'a Campaign,
    folder: CampaignFolder,
    options: RunOptions,
    plan: Plan,
}

/// Result of flying.
#[derive(Debug)]
pub struct Flown {
    /// Complete, or stopped before.
    pub end: RunEnd,
    /// Flights flown now.
    pub flights: u64,
    /// Their steps.
    pub steps: u64,
    /// Number of threads.
    pub threads: NonZeroUsize,
    /// Start time.
    pub start: Instant,
}

impl Flown {
    /// For shards flown elsewhere.
    pub fn nothing() -> Self {
        Self {
            end: RunEnd::Complete,
            flights: 0,
            steps: 0,
            threads: NonZeroUsize::MIN,
            start: Instant::now(),
        }
    }

    /// The result of some shards, without evaluation.
    pub fn of_shards(&self) -> ShardsFlown {
        ShardsFlown {
            complete: self.end == RunEnd::Complete,
            flights: self.flights,
            steps: self.steps,
        }
    }
}

/// The result of some shards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ShardsFlown {
    /// Whether all requested shards exist.
    pub complete: bool,
    /// Flights flown now.
    pub flights: u64,
    /// Their steps.
    pub steps: u64,
}

/// What a campaign document says, for programs that distribute its shards.
///
/// # Errors
/// A file that it names cannot be read.
pub fn checked(campaign: &Campaign) -> Result<CheckedCampaign, Failure> {
    let absolute = |path: &Path| {
        std::path::absolute(path).map_err(|error| Failure::Failed(format!("{}: {error}", path.display())))
    };
    let document = campaign.document();
    Ok(CheckedCampaign {
        name: document.name.clone(),
        description: document.description.clone(),
        flights: campaign.flights(),
        shards: shards_of(campaign.flights()),
        seed: document.seed,
        campaign: absolute(campaign.path())?,
        files: (campaign.files().iter())
            .map(|path| absolute(path))
            .collect::<Result<_, Failure>>()?,
        manifest: manifest(campaign).map_err(Failure::Failed)?,
    })
}

/// One of its flights, for programs that fly it elsewhere.
///
/// # Errors
/// There is no such flight, or it cannot be flown.
pub fn checked_flight(campaign: &Campaign, index: u64) -> Result<CheckedFlight, Failure> {
    let (flight, scenario) = planned(campaign, index)?;
    Ok(CheckedFlight {
        flight: index,
        seed: flight.seed.to_string(),
        documents: scenario.documents().to_toml(),
    })
}

/// A flight and its scenario.
///
/// # Errors
/// There is no such flight, or it cannot be flown.
pub fn planned(campaign: &Campaign, index: u64) -> Result<(PlannedFlight, Scenario), Failure> {
    if index >= campaign.flights() {
        return Err(Failure::Input(format!(
            "--flight: expected a number from 0 to {}, got {index}",
            campaign.flights() - 1
        )));
    }
    let flight = campaign.flight(index).map_err(Failure::input)?;
    let scenario = campaign.scenario(&flight).map_err(Failure::input)?;
    Ok((flight, scenario))
}

/// Opens the folder of the campaign.
///
/// # Errors
/// It belongs to another campaign, or was started by another program.
pub fn prepare<'a>(job: &Job, campaign: &'a Campaign) -> Result<Prepared<'a>, Failure> {
    let folder = CampaignFolder::open(&job.out, campaign).map_err(|sentence| Failure::opening(&job.out, sentence))?;
    let place = folder.path().display().to_string();
    runner::check_same_program(campaign, &OneByOne, &folder, &place).map_err(Failure::Input)?;
    Ok(prepare_in(job, campaign, folder, BTreeSet::new()))
}

/// As [`prepare`], for shards that pass through a `folder` to an object store, which already has some of them (`elsewhere`).
pub fn prepare_in<'a>(
    job: &Job,
    campaign: &'a Campaign,
    folder: CampaignFolder,
    elsewhere: BTreeSet<u64>,
) -> Prepared<'a> {
    let options = RunOptions {
        threads: job.threads.unwrap_or_else(available_threads),
        limit: job.limit,
        shards: job.shards.clone(),
        elsewhere,
    };
    let plan = runner::plan(&folder, &options);
    Prepared {
        campaign,
        folder,
        options,
        plan,
    }
}

impl Prepared<'_> {
    /// Folder of the shards.
    pub fn folder(&self) -> &CampaignFolder {
        &self.folder
    }

    /// Number of requested flights.
    pub fn wanted(&self) -> u64 {
        self.plan.wanted_flights
    }

    /// Number of existing ones among them.
    pub fn present(&self) -> u64 {
        self.plan.present_flights
    }

    /// Flies the missing shards, until `stop` is set.
    ///
    /// # Errors
    /// A shard cannot be written.
    pub fn fly(&self, stop: &AtomicBool, tell: Tell<'_>) -> Result<Flown, Failure> {
        self.fly_and_keep(stop, tell, &|_shard| Ok(()))
    }

    /// As [`fly`](Self::fly); `keep` stores each shard as soon as it is in the folder.
    ///
    /// # Errors
    /// A shard cannot be written or stored.
    pub fn fly_and_keep(&self, stop: &AtomicBool, tell: Tell<'_>, keep: &runner::Keep<'_>) -> Result<Flown, Failure> {
        let (flights, steps) = (AtomicU64::new(0), AtomicU64::new(0));
        let (failed, alarms) = (AtomicU64::new(0), AtomicU64::new(0));
        let start = Instant::now();
        let progress = |done: runner::Progress| {
            let ended = flights.fetch_add(done.flights, Ordering::Relaxed) + done.flights;
            steps.fetch_add(done.steps, Ordering::Relaxed);
            let failed = failed.fetch_add(done.failed, Ordering::Relaxed) + done.failed;
            let false_alarms = alarms.fetch_add(done.false_alarms, Ordering::Relaxed) + done.false_alarms;
            tell(&JobEvent::Progress(Progress::Flights {
                failed,
                false_alarms,
                flights: self.present() + ended,
                of: self.wanted(),
            }));
        };
        let engine = SideBySide::default();
        let end = runner::run(
            self.campaign,
            &engine,
            &self.folder,
            &self.options,
            stop,
            &progress,
            keep,
        );
        let end = end.map_err(|sentence| Failure::writing(self.folder.path(), sentence))?;
        Ok(Flown {
            end,
            flights: flights.into_inner(),
            steps: steps.into_inner(),
            threads: self.options.threads,
            start,
        })
    }
}

/// Creates the results of the existing shards, with a report.
///
/// # Errors
/// They cannot be read or written.
pub fn sum_up(campaign: &Campaign, folder: &CampaignFolder) -> Result<Totals, Failure> {
    results::write_all(campaign, folder).map_err(|sentence| Failure::writing(folder.path(), sentence))
}

/// Default folder of a campaign.
pub fn folder_of(out: Option<&Path>, campaign: &Campaign) -> PathBuf {
    out.map_or_else(
        || Path::new("runs").join(format!("campaign-{}", campaign.document().name)),
        Path::to_path_buf,
    )
}

/// Set by SIGINT and SIGTERM; a second Ctrl-C ends the process at once.
///
/// # Errors
/// Signals cannot be caught.
pub fn stop_flag() -> Result<Arc<AtomicBool>, String> {
    let stop = Arc::new(AtomicBool::new(false));
    let caught = |error: std::io::Error| format!("signals cannot be caught: {error}");
    // In this order: on the first signal the flag is still unset.
    signal_hook::flag::register_conditional_default(signal_hook::consts::SIGINT, Arc::clone(&stop)).map_err(caught)?;
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(caught)?;
    }
    Ok(stop)
}
