//! Import of a flight log into canonical form.

use crate::failure::Failure;
use rotortwin_jobs::LogImport as Job;
use rotortwin_scenario::VehicleDocuments;
use rotortwin_twin::identify::in_the_order_of;
use rotortwin_twin::log::{FlightLog, ReadOptions, RotorOrder};
use std::path::{Path, PathBuf};

/// An imported log.
#[derive(Debug)]
pub struct Imported {
    /// In canonical form.
    pub log: FlightLog,
    /// Its path.
    pub path: PathBuf,
}

/// Options for reading a log.
#[derive(Debug, Default)]
pub struct Reading<'a> {
    /// Mapping file that takes precedence over the built-in ones.
    pub mapping: Option<&'a Path>,
    /// For a simulated run, use the truth instead of the sensed values.
    pub truth: bool,
    /// Vehicle document to check the log against.
    pub vehicle: Option<&'a Path>,
    /// Accept the readable part of a file with a wrong checksum.
    pub damaged: bool,
}

/// Imports the job's file under `name`.
///
/// # Errors
/// The log cannot be used or stored.
pub fn import(job: &Job, name: &str) -> Result<Imported, Failure> {
    let reading = Reading {
        mapping: job.mapping.as_deref(),
        truth: job.truth,
        vehicle: job.vehicle.as_deref(),
        damaged: job.damaged,
    };
    let imported = || {
        let log = read(&job.file, &reading)?;
        let log = if job.align { log.aligned() } else { log };
        let log = match job.rate_hz {
            Some(rate_hz) => log.resampled(rate_hz)?,
            None => log,
        };
        let path = log.store(&job.out, name).map_err(|refusal| refusal.to_string())?;
        Ok(Imported { log, path })
    };
    imported().map_err(Failure::Input)
}

/// Reads a log, or a part of it.
///
/// # Errors
/// An error in it, or in what it is to be compared with.
pub fn read(file: &Path, reading: &Reading<'_>) -> Result<FlightLog, String> {
    let vehicle = reading
        .vehicle
        .map(|path| VehicleDocuments::load(path).map_err(|error| error.to_string()));
    let options = ReadOptions {
        mapping: reading.mapping.map(Path::to_path_buf),
        truth: reading.truth,
        accept_damaged: reading.damaged,
        ..ReadOptions::default()
    };
    let mut log = FlightLog::read_part_with(file, &options)?;
    if let Some((vehicle, path)) = vehicle.transpose()?.zip(reading.vehicle) {
        // The file keeps the autopilot's numbering; a comparison with a vehicle reorders it as done here.
        let ordered = in_the_order_of(log.clone(), &vehicle.vehicle);
        log.report
            .findings
            .extend(ordered.check_against_vehicle(&vehicle.vehicle));
        if let RotorOrder::Vehicle(note) = ordered.report.rotor_order {
            log.report.notes.push(note);
        }
        log.vehicle = Some(path.display().to_string());
    }
    Ok(log)
}

/// File names without extension; duplicates are prefixed with as many of their folders as necessary.
pub fn unique_names(files: &[PathBuf]) -> Vec<String> {
    let parts = |file: &Path, folders: usize| -> String {
        let stem = file
            .file_stem()
            .map_or_else(|| "log".to_owned(), |stem| stem.to_string_lossy().into_owned());
        let parents = file.ancestors().skip(1).filter_map(Path::file_name).take(folders);
        let mut names: Vec<String> = parents.map(|name| name.to_string_lossy().into_owned()).collect();
        names.reverse();
        names.push(stem);
        names.join("__")
    };
    let deepest = files.iter().map(|file| file.components().count()).max().unwrap_or(0);
    files
        .iter()
        .map(|file| {
            let alone = |folders: &usize| {
                let name = parts(file, *folders);
                files.iter().filter(|other| parts(other, *folders) == name).count() == 1
            };
            parts(file, (0..deepest).find(alone).unwrap_or(0))
        })
        .collect()
}
