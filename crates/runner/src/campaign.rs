//! Many flights of a campaign, or some of its shards, or the results of what is there.

use crate::Tell;
use crate::failure::Failure;
use rotortwin_campaign::parallel::available_threads;
use rotortwin_campaign::study::engine::{OneByOne, SideBySide};
use rotortwin_campaign::study::folder::{CampaignFolder, write_whole};
use rotortwin_campaign::study::runner::{self, Plan, RunEnd, RunOptions};
use rotortwin_campaign::study::totals::Totals;
use rotortwin_campaign::study::{Campaign, report, results};
use rotortwin_jobs::{Campaign as Job, JobEvent, Progress};
use serde::Serialize;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// Flights that can begin.
#[derive(Debug)]
pub struct Prepared<'a> {
    campaign: &'a Campaign,
    folder: CampaignFolder,
    options: RunOptions,
    plan: Plan,
}

/// How the flights went.
#[derive(Debug)]
pub struct Flown {
    /// All that were wanted, or stopped before.
    pub end: RunEnd,
    /// Flights that were flown now.
    pub flights: u64,
    /// Their steps.
    pub steps: u64,
    /// On so many threads.
    pub threads: NonZeroUsize,
    /// Since then.
    pub start: Instant,
}

impl Flown {
    /// What is there was flown elsewhere.
    pub fn nothing() -> Self {
        Self {
            end: RunEnd::Complete,
            flights: 0,
            steps: 0,
            threads: NonZeroUsize::MIN,
            start: Instant::now(),
        }
    }

    /// The result of some shards, which are left as they are.
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
    /// Whether all that were wanted are there.
    pub complete: bool,
    /// Flights that were flown now.
    pub flights: u64,
    /// Their steps.
    pub steps: u64,
}

/// Opens the folder of the campaign.
///
/// # Errors
/// It is another campaign's, or another program began it.
pub fn prepare<'a>(job: &Job, campaign: &'a Campaign) -> Result<Prepared<'a>, Failure> {
    let folder = CampaignFolder::open(&job.out, campaign).map_err(Failure::Input)?;
    let place = folder.path().display().to_string();
    runner::check_same_program(campaign, &OneByOne, &folder, &place).map_err(Failure::Input)?;
    Ok(prepare_in(job, campaign, folder, BTreeSet::new()))
}

/// As [`prepare`], where shards pass through a `folder` on their way to an object store, which has some of them already (`elsewhere`).
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
    /// Where the shards are.
    pub fn folder(&self) -> &CampaignFolder {
        &self.folder
    }

    /// Flights that are wanted.
    pub fn wanted(&self) -> u64 {
        self.plan.wanted_flights
    }

    /// Of these, there already.
    pub fn present(&self) -> u64 {
        self.plan.present_flights
    }

    /// Flies what is missing, until `stop` is set.
    ///
    /// # Errors
    /// A shard cannot be written.
    pub fn fly(&self, stop: &AtomicBool, tell: Tell<'_>) -> Result<Flown, Failure> {
        self.fly_and_keep(stop, tell, &|_shard| Ok(()))
    }

    /// As [`fly`](Self::fly); `keep` takes each shard to its place as soon as it is in the folder.
    ///
    /// # Errors
    /// A shard cannot be written or kept.
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

/// Makes the results of the shards that are there, with their report.
///
/// # Errors
/// They cannot be read or written.
pub fn sum_up(campaign: &Campaign, folder: &CampaignFolder) -> Result<Totals, Failure> {
    let summed_up = || {
        let totals = results::collect(campaign, folder)?;
        results::write_summary(campaign, folder, &totals)?;
        let page = report::render(campaign, &totals);
        write_whole(&folder.path().join(results::REPORT_FILE), page.as_bytes())?;
        Ok(totals)
    };
    summed_up().map_err(|sentence: String| Failure::writing(folder.path(), sentence))
}

/// Where a campaign is flown, if no folder is named.
pub fn folder_of(out: Option<&Path>, campaign: &Campaign) -> PathBuf {
    out.map_or_else(
        || Path::new("runs").join(format!("campaign-{}", campaign.document().name)),
        Path::to_path_buf,
    )
}

/// Set by Ctrl-C and by a polite end; the second Ctrl-C ends the process at once.
///
/// # Errors
/// Signals cannot be caught.
pub fn stop_flag() -> Result<Arc<AtomicBool>, String> {
    let stop = Arc::new(AtomicBool::new(false));
    let caught = |error: std::io::Error| format!("signals cannot be caught: {error}");
    // In this order: the first one finds the flag down.
    signal_hook::flag::register_conditional_default(signal_hook::consts::SIGINT, Arc::clone(&stop)).map_err(caught)?;
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(caught)?;
    }
    Ok(stop)
}
