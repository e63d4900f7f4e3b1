//! The second look over the flights of a campaign: each is flown again and judged as a single run is, and the campaign has a row, columns and a
//! coverage of sizes more.
//!
//! ```text
//!  folder ─▶ flights without its verdict ─▶ flown again, same hash ─▶ second look in each step ─▶ own/second_look.jsonl ─▶ tables, report, …
//! ```
//! This takes about seven times as long as the campaign. Scores are kept while it goes on: a call that was stopped is resumed by the same call.

use crate::failure::Failure;
use rotortwin_campaign::parallel::map_in_order;
use rotortwin_campaign::study::Campaign;
use rotortwin_campaign::study::folder::CampaignFolder;
use rotortwin_campaign::study::own::{OwnScores, Recorder, fly_again, read_all};
use rotortwin_campaign::study::record::{FlightRecord, FlightStatus, LossAtEnd};
use rotortwin_campaign::study::score::DetectorScore;
use rotortwin_flight::sample::Sample;
use rotortwin_sim::second_look::{NAME, SecondLook};
use rotortwin_store::own_detector::{Detector, Seen};
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Scores of a folder are written no more often: the file is written as a whole.
const KEPT_EVERY: Duration = Duration::from_secs(10);

/// Judges the flights of the folder that have no verdict of the second look yet; false if `stop` was set before the last.
///
/// * `progress`: called with the number of flights that have been judged, now and before
///
/// # Errors
/// A shard cannot be read, a flight is another one when flown again, or the scores cannot be written.
pub fn judge(
    campaign: &Campaign,
    folder: &CampaignFolder,
    threads: NonZeroUsize,
    stop: &AtomicBool,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<bool, Failure> {
    let failed = |sentence: String| Failure::writing(folder.path(), sentence);
    let mut scores = scores_of(folder).map_err(failed)?;
    let ended = AtomicU64::new(0);
    let mut kept = Instant::now();
    for shard in (0..folder.shard_count()).filter(|shard| folder.has_shard(*shard)) {
        let records = folder.read_shard(shard).map_err(failed)?;
        let (waiting, done): (Vec<FlightRecord>, Vec<FlightRecord>) = (records.into_iter())
            .partition(|record| record.status != FlightStatus::Refused && scores.of(record).is_none());
        let more = |flights: u64| progress(ended.fetch_add(flights, Ordering::Relaxed) + flights);
        more(done.len() as u64);
        let judged = map_in_order(
            threads,
            &waiting,
            |record| {
                if stop.load(Ordering::Relaxed) {
                    Ok(None)
                } else {
                    judged(campaign, record)
                }
            },
            &|| more(1),
        );
        let mut not_judged = None;
        for (record, judged) in waiting.iter().zip(judged) {
            match judged {
                Ok(Some((score, loss))) => scores.add(record, score, loss),
                Ok(None) => {}
                Err(sentence) => not_judged = not_judged.or(Some(sentence)),
            }
        }
        let ends = not_judged.is_some() || stop.load(Ordering::Relaxed);
        if ends || kept.elapsed() > KEPT_EVERY {
            scores.write(folder).map_err(failed)?;
            kept = Instant::now();
        }
        if let Some(sentence) = not_judged {
            return Err(Failure::Failed(sentence));
        }
        if ends {
            return Ok(false);
        }
    }
    scores.write(folder).map_err(failed)?;
    Ok(true)
}

/// What the folder has of it already.
fn scores_of(folder: &CampaignFolder) -> Result<OwnScores, String> {
    let there = read_all(folder)?.into_iter().find(|scores| scores.name == NAME);
    there.map_or_else(|| OwnScores::new(NAME), Ok)
}

/// Its score of a flight, and the loss that it names at the end; `None` if it does not take the vehicle.
fn judged(campaign: &Campaign, record: &FlightRecord) -> Result<Option<(DetectorScore, Option<LossAtEnd>)>, String> {
    let flown = fly_again(campaign, record.clone(), |scenario| {
        let mut look = SecondLook::new(scenario);
        let rotors = scenario.vehicle().rotor_count();
        if let Some(look) = &mut look {
            look.begin(rotors);
        }
        Ok(Looking {
            look,
            rotors,
            seen: Seen::default(),
            verdicts: Vec::new(),
        })
    })?;
    let Some((flight, looking)) = flown.map(|flown| flown.without_recording()) else {
        return Ok(None);
    };
    let Some(look) = looking.look else {
        return Ok(None);
    };
    let said = look.statement().map(|statement| statement.severity.losses);
    let loss = match said.unwrap_or_default().as_slice() {
        [one] => Some(LossAtEnd {
            loss_n: one.loss_n,
            interval_n: one.interval_n,
        }),
        _ => None,
    };
    Ok(Some((flight.score(&looking.verdicts)?, loss)))
}

/// The second look, which judges a flight while it is flown again.
struct Looking {
    look: Option<SecondLook>,
    rotors: usize,
    seen: Seen,
    verdicts: Vec<i32>,
}

impl Recorder for Looking {
    fn sample(&mut self, sample: &Sample) {
        let Some(look) = &mut self.look else { return };
        let wide = |values: [f32; 3]| values.map(f64::from);
        let (sensors, seen) = (&sample.sensors, &mut self.seen);
        seen.time_s = sensors.stamp.sim_time_ns as f64 * 1e-9;
        seen.position_ned_m = wide(sensors.position_ned_m);
        seen.velocity_ned_m_s = wide(sensors.velocity_ned_m_s);
        seen.attitude_rad = wide(sensors.attitude_rad);
        seen.body_rates_rad_s = wide(sensors.body_rates_rad_s);
        seen.specific_force_m_s2 = sample.specific_force_m_s2.map_or([f64::NAN; 3], wide);
        seen.battery_voltage_v = f64::from(sensors.battery_voltage_v);
        seen.duty.clear();
        seen.duty
            .extend(sample.command.duty[..self.rotors].iter().copied().map(f64::from));
        self.verdicts.push(look.step(seen));
    }
}
