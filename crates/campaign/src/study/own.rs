//! Detectors of the user's own, and the second look, over a whole campaign: each judges the flights that are there, and then has its rows, columns and scores beside
//! ours, counted in the same way ([`super::score`]).
//!
//! ```text
//!  folder ─▶ flights that are there ─▶ flown again, recorded ─▶ the detector's verdict in each step ─▶ DetectorScore ─▶ own/NAME.jsonl
//!                                                                                                                    └▶ tables, report, …
//! ```
//! A detector does not act on the vehicle, so that its verdicts after the flight are those it would have given during it; a flight that flown again
//! has another hash than its record is refused. Shards do not change: campaigns with and without such detectors are the same campaign. Flights
//! that are flown after a detector has judged have no verdicts of it until it judges again; the tables say so.

use super::document::Criteria;
use super::engine::{FlightScorer, fly_alone};
use super::folder::{CampaignFolder, write_whole};
use super::plan::Campaign;
use super::record::{FlightRecord, FlightStatus, LossAtEnd, score_columns};
use super::score::{DetectorScore, DetectorScorer, Verdict, WindowTruth};
use crate::table_file::TableFile;
use rotortwin_flight::lockstep::{FlightObserver, StopReason};
use rotortwin_flight::sample::Sample;
use rotortwin_scenario::Scenario;
use rotortwin_store::own_detector::{exists, plain_name};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Folder of the scores, a file for each detector.
const FOLDER: &str = "own";

/// A flight of the folder, flown again to be judged.
#[derive(Debug)]
pub struct FlownAgain<R> {
    /// What it was when the campaign flew it.
    pub record: FlightRecord,
    /// What the caller has recorded of it.
    pub recorded: R,
    /// Step and truth of each window.
    windows: Vec<(u64, WindowTruth)>,
    window_steps: u64,
}

/// Receives every sample of a flight.
pub trait Recorder {
    /// The next step.
    fn sample(&mut self, sample: &Sample);
}

/// Scores the flight as the campaign does, which ends it where the vehicle is lost.
struct Watching<R> {
    scorer: FlightScorer,
    recorder: R,
}

impl<R: Recorder> FlightObserver for Watching<R> {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        self.recorder.sample(sample);
        self.scorer.sample(sample)
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        self.scorer.stop_requested()
    }
}

/// Flies a recorded flight again; `None` if it was refused, as there is nothing to judge then.
///
/// # Errors
/// One sentence: it cannot be flown any more, or differs from its record.
pub fn fly_again<R: Recorder>(
    campaign: &Campaign,
    record: FlightRecord,
    recorder: impl FnOnce(&Scenario) -> Result<R, String>,
) -> Result<Option<FlownAgain<R>>, String> {
    if record.status == FlightStatus::Refused {
        return Ok(None);
    }
    let planned = campaign.flight(record.flight).map_err(|error| error.to_string())?;
    let scenario = campaign.scenario(&planned).map_err(|error| error.to_string())?;
    let criteria: &Criteria = &campaign.document().criteria;
    let mut watching = Watching {
        scorer: FlightScorer::new(&scenario, criteria, &[])?.keeping_windows(),
        recorder: recorder(&scenario)?,
    };
    let flown = fly_alone(&scenario, planned.seed, &mut watching);
    if flown.run_hash != record.run_hash {
        return Err(format!(
            "flight {}: flown again it has the hash {}, its record {}; expected the program, the vehicle and the blades that flew the campaign",
            record.flight, flown.run_hash, record.run_hash
        ));
    }
    Ok(Some(FlownAgain {
        record,
        recorded: watching.recorder,
        windows: watching.scorer.take_windows(),
        window_steps: u64::from(scenario.fdi_config().window_len),
    }))
}

impl<R> FlownAgain<R> {
    /// With what was recorded in another form.
    pub fn map_recorded<T>(self, change: impl FnOnce(R) -> T) -> FlownAgain<T> {
        FlownAgain {
            record: self.record,
            recorded: change(self.recorded),
            windows: self.windows,
            window_steps: self.window_steps,
        }
    }

    /// The flight, which can be scored, and what was recorded of it.
    pub fn without_recording(self) -> (FlownAgain<()>, R) {
        let mut recorded = None;
        let flight = self.map_recorded(|all| recorded = Some(all));
        (flight, recorded.expect("it was just put there"))
    }

    /// The score of a detector that says `verdicts`, one for each step; those at ends of windows count.
    ///
    /// # Errors
    /// One sentence: their number is not that of the steps, or there is no such verdict.
    pub fn score(&self, verdicts: &[i32]) -> Result<DetectorScore, String> {
        let record = &self.record;
        if verdicts.len() as u64 != record.steps {
            return Err(format!(
                "flight {}: expected {} verdicts, one for each step, got {}",
                record.flight,
                record.steps,
                verdicts.len()
            ));
        }
        let rotors = usize::try_from(record.rotor_count).expect("a few rotors");
        if let Some(impossible) = verdicts.iter().find(|verdict| !exists(**verdict, rotors)) {
            return Err(format!(
                "flight {}: expected 0, a rotor from 1 to {rotors}, 100 i + j for two of them, or −1 to −3, got {impossible}",
                record.flight
            ));
        }
        let mut scorer = DetectorScorer::new(self.window_steps);
        for (step, truth) in &self.windows {
            let said = usize::try_from(*step).ok().and_then(|step| verdicts.get(step));
            scorer.window(
                truth,
                Verdict::of_code(*said.expect("a window ends with a step of the flight")),
            );
        }
        Ok(scorer.finish())
    }
}

/// The score of one flight, in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Line {
    flight: u64,
    run_hash: String,
    score: DetectorScore,
    /// Of detectors that give a size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    loss: Option<LossAtEnd>,
}

/// First line of the file.
#[derive(Serialize, Deserialize)]
struct Head {
    detector: String,
}

/// What one detector scored in the flights that it has judged.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnScores {
    /// Name in tables.
    pub name: String,
    /// The same in small letters, digits and `_`: name of the file, and in the names of columns.
    plain: String,
    flights: BTreeMap<u64, Line>,
}

impl OwnScores {
    /// Of a detector that has judged nothing yet.
    ///
    /// # Errors
    /// In words: the name is empty, too long or that of one of ours.
    pub fn new(name: &str) -> Result<Self, String> {
        Ok(Self {
            name: name.trim().to_owned(),
            plain: plain_name(name.trim())?,
            flights: BTreeMap::new(),
        })
    }

    /// Beginning of the names of its columns.
    pub fn column(&self) -> String {
        format!("own_{}", self.plain)
    }

    /// Adds the score of a flight, and the loss that the detector names at its end, if it gives sizes.
    pub fn add(&mut self, record: &FlightRecord, score: DetectorScore, loss: Option<LossAtEnd>) {
        let line = Line {
            flight: record.flight,
            run_hash: record.run_hash.clone(),
            score,
            loss,
        };
        self.flights.insert(record.flight, line);
    }

    /// Of a flight, if it was judged as it is recorded.
    pub fn of(&self, record: &FlightRecord) -> Option<&DetectorScore> {
        self.line(record).map(|line| &line.score)
    }

    /// The loss at the end of such a flight.
    pub fn loss_of(&self, record: &FlightRecord) -> Option<LossAtEnd> {
        self.line(record)?.loss
    }

    fn line(&self, record: &FlightRecord) -> Option<&Line> {
        let line = self.flights.get(&record.flight)?;
        (line.run_hash == record.run_hash).then_some(line)
    }

    /// Its columns, `own_NAME_windows` and so on, after those of the flights.
    pub fn add_columns(&self, table: &mut TableFile, records: &[FlightRecord]) {
        score_columns(table, records, &self.column(), &|record| self.of(record));
    }

    fn path(&self, folder: &CampaignFolder) -> PathBuf {
        folder.path().join(FOLDER).join(format!("{}.jsonl", self.plain))
    }

    /// Replaces what the detector of this name said before.
    ///
    /// # Errors
    /// One sentence: the file cannot be written, or is that of a detector whose name differs in other characters than letters and digits.
    pub fn write(&self, folder: &CampaignFolder) -> Result<(), String> {
        let path = self.path(folder);
        if let Some(other) = read_all(folder)?
            .iter()
            .find(|other| other.plain == self.plain && other.name != self.name)
        {
            return Err(format!(
                "the scores of '{}' would replace those of '{}'; expected a name that differs in letters or digits",
                self.name, other.name
            ));
        }
        let head = Head {
            detector: self.name.clone(),
        };
        let mut text = serde_json::to_string(&head).expect("a text is JSON") + "\n";
        for line in self.flights.values() {
            text += &serde_json::to_string(line).expect("numbers and texts are JSON");
            text.push('\n');
        }
        let below = folder.path().join(FOLDER);
        std::fs::create_dir_all(&below).map_err(|error| format!("{}: cannot be created: {error}", below.display()))?;
        write_whole(&path, text.as_bytes())
    }
}

/// All detectors of the user's own that have judged this folder, by name of their file.
///
/// # Errors
/// One sentence: a file cannot be read.
pub fn read_all(folder: &CampaignFolder) -> Result<Vec<OwnScores>, String> {
    let below = folder.path().join(FOLDER);
    let entries = match std::fs::read_dir(&below) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(format!("{}: cannot be read: {error}", below.display())),
    };
    let mut paths: Vec<PathBuf> = entries
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "jsonl"))
        .collect();
    paths.sort();
    paths.into_iter().map(|path| read(&path)).collect()
}

/// Takes over the scores of another folder of the same campaign, of all detectors.
///
/// # Errors
/// One sentence: a file cannot be read or written, or both folders have scores of the same flight that differ.
pub fn take_in(into: &CampaignFolder, from: &CampaignFolder) -> Result<(), String> {
    let mut present = read_all(into)?;
    for theirs in read_all(from)? {
        let mut scores = match present.iter().position(|ours| ours.name == theirs.name) {
            Some(place) => present.swap_remove(place),
            None => OwnScores::new(&theirs.name)?,
        };
        let before = scores.flights.len();
        for (flight, line) in theirs.flights {
            let ours = scores.flights.entry(flight).or_insert_with(|| line.clone());
            if *ours != line {
                return Err(format!(
                    "{}: '{}' judged flight {flight} differently than in {}: the detector has changed in between, or is not the same each time; \
                     remove the scores of one of them ({FOLDER}/{}.jsonl)",
                    from.path().display(),
                    theirs.name,
                    into.path().display(),
                    theirs.plain
                ));
            }
        }
        if scores.flights.len() > before {
            scores.write(into)?;
        }
    }
    Ok(())
}

fn read(path: &std::path::Path) -> Result<OwnScores, String> {
    let refuse = |reason: String| {
        format!(
            "{}: {reason}; remove the file and have the detector judge the campaign again",
            path.display()
        )
    };
    let text = std::fs::read_to_string(path).map_err(|error| refuse(format!("cannot be read: {error}")))?;
    let mut lines = text.lines();
    let head: Head = serde_json::from_str(lines.next().unwrap_or(""))
        .map_err(|error| refuse(format!("line 1 is not the name of a detector: {error}")))?;
    let mut scores = OwnScores::new(&head.detector).map_err(refuse)?;
    for (place, line) in lines.enumerate() {
        let line: Line = serde_json::from_str(line)
            .map_err(|error| refuse(format!("line {} is not the score of a flight: {error}", place + 2)))?;
        scores.flights.insert(line.flight, line);
    }
    Ok(scores)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::engine::{SideBySide, fly};
    use crate::study::results;
    use rotortwin_store::query::TelemetryFile;

    const CAMPAIGN: &str = "name = \"own\"\ndescription = \"a test\"\nscenario = \"SCENARIOS/hover.toml\"\nseed = 3\nrepeats = 2\nset.duration_s = 14.0\n\
                            [[axis]]\nname = \"rotor\"\nkey = \"fault\"\nvalues = [[], [{ time_s = 12.0, rotor = 2, thrust_loss_percent = 8.0 }]]\n";

    /// What our detectors say in each step.
    #[derive(Default)]
    struct Ours {
        t_test: Vec<i32>,
        sequential: Vec<i32>,
    }

    impl Recorder for Ours {
        fn sample(&mut self, sample: &Sample) {
            self.t_test.push(sample.report.t_test);
            self.sequential.push(sample.report.sequential);
        }
    }

    /// A campaign of four flights, flown, in a folder.
    fn flown(work: &tempfile::TempDir) -> (Campaign, CampaignFolder, Vec<FlightRecord>) {
        let scenarios = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenarios");
        let text = CAMPAIGN.replace("SCENARIOS", scenarios);
        let campaign = Campaign::parse(&text, &work.path().join("own.toml")).expect("a good campaign");
        let folder = CampaignFolder::open(&work.path().join("out"), &campaign).expect("a new folder");
        let records = fly(&campaign, &SideBySide::default(), 0..campaign.flights());
        folder.write_shard(0, &records, &campaign).expect("written");
        (campaign, folder, records)
    }

    fn again(campaign: &Campaign, record: &FlightRecord) -> FlownAgain<Ours> {
        let again = fly_again(campaign, record.clone(), |_| Ok(Ours::default()));
        again.expect("the same flight").expect("it was not refused")
    }

    #[test]
    fn val_verdicts_of_ours_given_back_have_the_score_of_ours() {
        let work = tempfile::tempdir().expect("a folder");
        let (campaign, folder, records) = flown(&work);
        assert_eq!(records.len(), 4);
        let mut scores = OwnScores::new("My T-test").expect("a good name");
        for record in &records {
            let again = again(&campaign, record);
            let [sequential, _, t_test] = &record.detectors[..] else {
                panic!("three detectors")
            };
            assert_eq!(again.score(&again.recorded.sequential).expect("scored"), *sequential);
            let score = again.score(&again.recorded.t_test).expect("scored");
            assert_eq!(score, *t_test);
            scores.add(record, score, None);
        }
        scores.write(&folder).expect("written");
        assert_eq!(read_all(&folder).expect("read"), [scores]);

        let totals = results::write_all(&campaign, &folder).expect("written");
        let own = &totals.own[0];
        assert_eq!(
            (own.name.as_str(), own.column.as_str(), own.not_judged),
            ("My T-test", "own_my_t_test", 0)
        );
        assert_eq!(own.totals, totals.detectors[2]);
        for group in &totals.axes[0].groups {
            assert_eq!(group.own[0], group.detectors[2]);
        }
        let file = TelemetryFile::open(&folder.path().join(results::PARQUET_FILE)).expect("Parquet");
        let names: Vec<&str> = file.channels().iter().map(|channel| channel.name.as_str()).collect();
        for column in names.iter().filter(|name| name.starts_with("t_test_")) {
            let own = format!("own_my_{column}");
            assert!(names.contains(&own.as_str()), "{own} is missing");
        }
        let page = std::fs::read_to_string(folder.path().join(results::REPORT_FILE)).expect("written");
        let summary = std::fs::read_to_string(folder.path().join(results::SUMMARY_FILE)).expect("written");
        assert!(page.contains("My T-test") && summary.contains("\"own_my_t_test\""));
    }

    #[test]
    fn scenario_verdicts_that_do_not_fit_the_flight_are_refused() {
        let work = tempfile::tempdir().expect("a folder");
        let (campaign, folder, records) = flown(&work);
        let flight = again(&campaign, &records[0]);
        let refused = flight.score(&[0; 7]).expect_err("too few");
        assert_eq!(refused, "flight 0: expected 5600 verdicts, one for each step, got 7");
        let refused = flight.score(&[7; 5600]).expect_err("no such rotor");
        assert!(
            refused.contains("a rotor from 1 to 6") && refused.ends_with("got 7"),
            "{refused}"
        );
        let refused = OwnScores::new("sequential").expect_err("ours");
        assert!(refused.contains("a detector of this program"), "{refused}");

        let other = FlightRecord {
            run_hash: "0".repeat(32),
            ..records[0].clone()
        };
        let refused = fly_again(&campaign, other, |_| Ok(Ours::default())).map(drop);
        assert!(
            refused
                .expect_err("another flight")
                .starts_with("flight 0: flown again it has the hash ")
        );

        OwnScores::new("my one").expect("good").write(&folder).expect("written");
        let refused = OwnScores::new("my-one")
            .expect("good")
            .write(&folder)
            .expect_err("the same file");
        assert!(
            refused.contains("'my-one' would replace those of 'my one'"),
            "{refused}"
        );
    }

    #[test]
    fn val_scores_of_two_parts_are_one_whole_and_contradictions_are_named() {
        let work = tempfile::tempdir().expect("a folder");
        let (campaign, part, records) = flown(&work);
        let whole = CampaignFolder::open(&work.path().join("whole"), &campaign).expect("a new folder");
        let score = |record: &FlightRecord| again(&campaign, record).score(&[0; 5600]).expect("scored");
        let of = |records: &[FlightRecord]| {
            let mut scores = OwnScores::new("My own").expect("a good name");
            for record in records {
                scores.add(record, score(record), None);
            }
            scores
        };
        of(&records[..1]).write(&whole).expect("written");
        of(&records[1..]).write(&part).expect("written");
        take_in(&whole, &part).expect("they agree");
        assert_eq!(read_all(&whole).expect("read"), [of(&records)]);
        take_in(&whole, &part).expect("again");

        let mut other = OwnScores::new("My own").expect("a good name");
        // One of the two is healthy, and the other is not.
        other.add(&records[2], score(&records[1]), None);
        other.write(&part).expect("written");
        let refused = take_in(&whole, &part).expect_err("another score");
        assert!(refused.contains("'My own' judged flight 2 differently"), "{refused}");
    }

    /// A record of another flight than the judged one, or of one flown later, has no score, and the table says so.
    #[test]
    fn val_flights_that_were_not_judged_are_counted_not_guessed() {
        let work = tempfile::tempdir().expect("a folder");
        let (campaign, folder, records) = flown(&work);
        let mut scores = OwnScores::new("half").expect("a good name");
        for record in &records[..2] {
            let again = again(&campaign, record);
            scores.add(record, again.score(&again.recorded.t_test).expect("scored"), None);
        }
        scores.write(&folder).expect("written");
        let totals = results::collect(&campaign, &folder).expect("summed up");
        assert_eq!(totals.own[0].not_judged, 2);
        let tables = crate::study::tables::tables(&campaign, &totals);
        let notes = tables[0].notes.join("\n");
        assert!(notes.contains("half has not judged 2 of 4 flights"), "{notes}");
    }
}
