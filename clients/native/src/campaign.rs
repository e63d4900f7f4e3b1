//! The flights of a campaign flown again, for detectors of Python's to judge: their scores become part of the campaign's folder.

use crate::columns::Recording;
use crate::interrupt::interruptible;
use crate::refusal::input;
use crate::scenario::find_named;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use rotortwin_campaign::study::folder::CampaignFolder;
use rotortwin_campaign::study::own::{FlownAgain, OwnScores, Recorder, fly_again};
use rotortwin_campaign::study::record::FlightRecord;
use rotortwin_campaign::study::summary::CampaignSummary;
use rotortwin_campaign::study::{Campaign, results};
use rotortwin_flight::sample::Sample;
use rotortwin_scenario::names::Kind;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// Flights held in memory at a time: some 10 MB each.
const FLIGHTS_OF_A_PART: usize = 8;

/// A flight: its number, its vehicle's rotors, and the recorded columns as bytes of doubles.
type Shown<'py> = (u64, usize, Bound<'py, PyDict>);

/// The flights in a campaign's folder, which stays locked, and detectors that judge them.
#[pyclass(module = "rotortwin._native")]
pub(crate) struct CampaignFlights {
    campaign: Campaign,
    folder: CampaignFolder,
    /// In the order of the names.
    scores: Vec<OwnScores>,
    /// Flown again, and perhaps not judged by all yet.
    shown: BTreeMap<u64, FlownAgain<()>>,
}

#[pymethods]
impl CampaignFlights {
    #[new]
    fn new(campaign: PathBuf, folder: PathBuf, names: Vec<String>) -> PyResult<Self> {
        let campaign = Campaign::load(&find_named(Kind::Campaign, campaign)?).map_err(input)?;
        let folder = CampaignFolder::open_present(&folder, &campaign).map_err(input)?;
        let scores = names
            .iter()
            .map(|name| OwnScores::new(name))
            .collect::<Result<_, _>>()
            .map_err(input)?;
        Ok(Self {
            campaign,
            folder,
            scores,
            shown: BTreeMap::new(),
        })
    }

    /// Parts of the shards that are there: shard, first of its flights, from 0.
    #[getter]
    fn parts(&self) -> Vec<(u64, usize)> {
        let shards = (0..self.folder.shard_count()).filter(|shard| self.folder.has_shard(*shard));
        shards
            .flat_map(|shard| {
                let range = self.folder.shard_range(shard);
                let flights = usize::try_from(range.end - range.start).unwrap_or(0);
                (0..flights).step_by(FLIGHTS_OF_A_PART).map(move |first| (shard, first))
            })
            .collect()
    }

    /// Flies a part again. Flights that were refused are left out.
    fn fly<'py>(
        &mut self,
        py: Python<'py>,
        shard: u64,
        first: usize,
        columns: Vec<String>,
    ) -> PyResult<Vec<Shown<'py>>> {
        let records = self.folder.read_shard(shard).map_err(input)?;
        let part: Vec<FlightRecord> = records.into_iter().skip(first).take(FLIGHTS_OF_A_PART).collect();
        let campaign = &self.campaign;
        let flown = interruptible(py, |stop| {
            part.into_par_iter()
                .map(|record| again(campaign, record, &columns, stop))
                .collect::<Result<Vec<_>, _>>()
        })?;
        self.shown.clear();
        let mut shown = Vec::new();
        for flight in flown.map_err(input)?.into_iter().flatten() {
            let (flight, recording) = flight.without_recording();
            let rotors = usize::try_from(flight.record.rotor_count).map_err(input)?;
            shown.push((flight.record.flight, rotors, recording.doubles(py)?));
            self.shown.insert(flight.record.flight, flight);
        }
        Ok(shown)
    }

    /// What a detector, by its place among the names, says in each step of a flight that was flown again: four bytes a verdict.
    fn judge(&mut self, flight: u64, detector: usize, verdicts: &[u8]) -> PyResult<()> {
        let shown = self
            .shown
            .get(&flight)
            .ok_or_else(|| input(format!("flight {flight} was not flown again just now")))?;
        let (numbers, _) = verdicts.as_chunks::<4>();
        let verdicts: Vec<i32> = numbers.iter().map(|number| i32::from_ne_bytes(*number)).collect();
        let scores = self
            .scores
            .get_mut(detector)
            .ok_or_else(|| input(format!("there is no detector {detector}")))?;
        let score = shown
            .score(&verdicts)
            .map_err(|reason| input(format!("{}: {reason}", scores.name)))?;
        scores.add(&shown.record, score, None);
        Ok(())
    }

    /// Keeps the scores and renews tables, report and summary; returns the summary's JSON.
    fn keep(&self, py: Python<'_>) -> PyResult<String> {
        let kept = interruptible(py, |_| {
            self.scores.iter().try_for_each(|scores| scores.write(&self.folder))?;
            results::write_all(&self.campaign, &self.folder)
        })?;
        let totals = kept.map_err(input)?;
        Ok(CampaignSummary::new(&self.campaign, &totals).json())
    }
}

struct Kept(Recording);

impl Recorder for Kept {
    fn sample(&mut self, sample: &Sample) {
        self.0.push(sample);
    }
}

fn again(
    campaign: &Campaign,
    record: FlightRecord,
    columns: &[String],
    stop: &AtomicBool,
) -> Result<Option<FlownAgain<Recording>>, String> {
    if stop.load(Ordering::Relaxed) {
        return Err("interrupted".to_owned());
    }
    let flown = fly_again(campaign, record, |scenario| {
        let rotor_count = scenario.vehicle().rotor_count();
        Recording::new(scenario, rotor_count, columns)
            .map(Kept)
            .map_err(|error| error.to_string())
    })?;
    Ok(flown.map(|flown| flown.map_recorded(|kept| kept.0)))
}
