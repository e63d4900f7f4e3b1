//! Documents referenced by a job: by path, or by the name shown by 'rotortwin list'.

use crate::failure::Failure;
use rotortwin_jobs::Job;
use rotortwin_scenario::names::{Kind, NameError, find, is_name};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// A path unchanged, a name as the path of its file.
///
/// # Errors
/// No document has this name.
pub fn resolved(kind: Kind, text: &OsStr) -> Result<PathBuf, NameError> {
    let path = Path::new(text);
    match text.to_str() {
        Some(name) if is_name(name) && !path.exists() => find(kind, name),
        // Paths may not be UTF-8.
        _ => Ok(path.to_owned()),
    }
}

/// The job with paths in place of names, as the command line does with its arguments.
pub(crate) fn with_paths(mut job: Job) -> Result<Job, Failure> {
    let set = |kind: Kind, path: &mut PathBuf| -> Result<(), Failure> {
        *path = resolved(kind, path.as_os_str()).map_err(Failure::input)?;
        Ok(())
    };
    match &mut job {
        Job::Campaign(campaign) => set(Kind::Campaign, &mut campaign.campaign)?,
        Job::BlindBench(bench) => {
            for vehicle in &mut bench.vehicles {
                let path = resolved(Kind::Vehicle, OsStr::new(vehicle)).map_err(Failure::input)?;
                *vehicle = path.display().to_string();
            }
        }
        Job::LogImport(import) => {
            import
                .vehicle
                .as_mut()
                .map_or(Ok(()), |path| set(Kind::Vehicle, path))?;
            import
                .mapping
                .as_mut()
                .map_or(Ok(()), |path| set(Kind::LogMapping, path))?;
        }
        Job::LogExample(example) => set(Kind::Vehicle, &mut example.vehicle)?,
        Job::Diagnosis(diagnosis) => {
            for path in &mut diagnosis.effects {
                set(Kind::Effect, path)?;
            }
        }
        Job::Training(training) => set(Kind::Scenario, &mut training.scenario)?,
        Job::Run(_)
        | Job::Comparison(_)
        | Job::Improvement(_)
        | Job::Identification(_)
        | Job::NextFlight(_)
        | Job::Verification(_) => {}
    }
    Ok(job)
}
