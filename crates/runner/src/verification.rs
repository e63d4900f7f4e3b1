//! Replay of a recorded run.

use crate::failure::Failure;
use rotortwin_flight::lockstep::{self, FlightEnd, NoObserver};
use rotortwin_flight::pace::Pace;
use rotortwin_jobs::Verification as Job;
use rotortwin_plant::Simulation;
use rotortwin_scenario::{ConfigError, Documents, Scenario};
use rotortwin_sim::session;
use rotortwin_store::summary::{Status, Summary, load_summary};
use rotortwin_wire::peers;
use std::path::Path;

/// Two executions of one run.
#[derive(Debug)]
pub struct Verified {
    /// Summary of the first one.
    pub summary: Summary,
    /// Run hash of the second.
    pub hash: String,
}

impl Verified {
    /// Whether both have the same run hash.
    pub fn same(&self) -> bool {
        self.hash == self.summary.run_hash
    }

    /// Why the two may differ if a third-party controller flew the first one: ours flies the second. One sentence.
    pub fn note(&self) -> Option<String> {
        let controller = self.summary.controller.as_ref()?;
        if self.same() || session::was_flown_by_autopilot(&self.summary) || peers::is_our_controller(&controller.peer) {
            return None;
        }
        let version = controller.version.as_deref().map(|version| format!(" {version}"));
        Some(format!(
            "the run was flown by an external controller ({}{}), and the second time by our own, because the external one is not available here: the hashes do not \
             show whether the run is reproducible",
            controller.peer,
            version.unwrap_or_default()
        ))
    }

    /// As printed.
    pub fn verdict(&self) -> rotortwin_jobs::Verified {
        rotortwin_jobs::Verified {
            recorded: self.summary.run_hash.clone(),
            replayed: self.hash.clone(),
            same: self.same(),
            note: self.note(),
        }
    }
}

/// Repeats the recorded scenario in this process.
///
/// # Errors
/// The run was not completed or cannot be read, or it cannot be flown again.
pub fn verify(job: &Job) -> Result<Verified, Failure> {
    let run = job.run.as_path();
    let summary = load_summary(run).map_err(Failure::input)?;
    if summary.status != Status::Done {
        return Err(Failure::input(format!(
            "{} is a run that was {}; only a run that is done can be flown again and compared",
            run.display(),
            summary.status.as_str()
        )));
    }
    let (scenario, simulation) = prepare(run, &summary).map_err(Failure::input)?;
    let hash = if session::was_flown_by_autopilot(&summary) {
        let folder = if run.is_dir() { Some(run) } else { run.parent() };
        session::replay_autopilot(&scenario, simulation, summary.seed, folder.unwrap_or(Path::new("")))
    } else {
        replay(&scenario, simulation)
    };
    let hash = hash.map_err(Failure::Failed)?;
    Ok(Verified { summary, hash })
}

fn prepare(run: &Path, summary: &Summary) -> Result<(Scenario, Simulation), ConfigError> {
    let name = format!("{}, the recorded scenario", run.display());
    let scenario = Scenario::from_documents(&Documents::from_toml(&name, &summary.scenario.text)?)?;
    let simulation = scenario.simulation(summary.seed)?;
    Ok((scenario, simulation))
}

fn replay(scenario: &Scenario, mut simulation: Simulation) -> Result<String, String> {
    let setup = session::run_setup(scenario, &simulation, 1);
    let mut link = session::in_process_link();
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut NoObserver);
    match outcome.end {
        FlightEnd::Done => Ok(outcome.run_hash),
        FlightEnd::Canceled => Err("the replay was canceled".to_owned()),
        FlightEnd::Failed(failure) => Err(failure.sentence),
    }
}
