//! The flights of a campaign: those with windows in a cell of the confusion matrix, and each as a run.
//!
//! ```text
//!  confusion matrix ─ truth, verdict ─▶ GET  …/flights              rows of the shards with windows there
//!                                       POST …/flights/{n}/run ───▶ a run with the seed and scenario of flight n: the same run hash
//! ```

use super::facts::CampaignFacts;
use super::jobs::{self, Shared};
use super::runs::Run;
use super::tasks::{LIBRARY, done};
use super::{campaigns, submissions};
use crate::App;
use crate::access::Caller;
use crate::jobs::Job;
use crate::jobs::store::Filter;
use crate::library::Library;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::Response;
use rotortwin_campaign::study::cell::Cell;
use rotortwin_campaign::study::folder::{SHARD_FLIGHTS, read_records, shard_number};
use rotortwin_campaign::study::record::{DETECTORS, FlightRecord, FlightStatus};
use rotortwin_jobs::{CheckedFlight, Content, JobKind, StoredJob};
use rotortwin_scenario::{Documents, Scenario};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::{IntoParams, ToSchema};

/// Maximum number of flights that a page examines: a rare cell of a large campaign would keep the caller waiting.
const MOST_LOOKED_AT: u64 = 20_000;
/// Runs of one campaign that a page can name.
const MOST_RUNS: i64 = 20_000;

/// Maximum number of verdicts on a page: more than exist for eight rotors.
const MOST_VERDICTS: usize = 100;

/// A detector of a campaign.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[schema(as = CampaignDetector)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Detector {
    /// The sequential detector.
    #[default]
    Sequential,
    /// The network of the scenario.
    Network,
    /// The paper's T-test.
    TTest,
}

impl Detector {
    /// Its place in the scores of a flight.
    fn place(self) -> usize {
        let name = match self {
            Self::Sequential => "sequential",
            Self::Network => "network",
            Self::TTest => "t_test",
        };
        DETECTORS.iter().position(|one| *one == name).unwrap_or_default()
    }
}

/// Which flights.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct FlightsQuery {
    /// Whose verdicts; `sequential` without it.
    #[param(inline)]
    detector: Option<Detector>,
    /// Only flights with windows of this truth: 0 healthy, a rotor from 1, −1 several rotors.
    truth: Option<i32>,
    /// Only flights with windows of one of these verdicts, separated by commas: 0 healthy, a rotor from 1, 100 i + j two rotors, −1 unknown
    /// fault, −3 ambiguous.
    #[param(pattern = "^ *-?[0-9]{1,9} *(, *-?[0-9]{1,9} *){0,99}$")]
    verdict: Option<String>,
    /// Only flights with this outcome.
    status: Option<FlightStatus>,
    /// `next` of the previous page.
    #[param(minimum = 0)]
    cursor: Option<u64>,
    /// Items per page, 1 to 1000.
    #[param(minimum = 1, maximum = 1000, default = 50)]
    limit: Option<i64>,
}

/// Value on one axis.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct FlightParameter {
    /// Name of the axis.
    axis: String,
    /// Number or text.
    value: Cell,
}

/// A flight of a campaign.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct CampaignFlight {
    /// Index of the flight, from 0.
    flight: u64,
    /// Seed of all noise, in decimal digits because it does not fit a JavaScript number.
    seed: String,
    /// Values in the order of the axes.
    parameters: Vec<FlightParameter>,
    /// How it ended.
    status: FlightStatus,
    /// Why it was not flown to its end; absent if it was.
    reason: Option<String>,
    /// Hash over all samples, equal to that of the run of the same flight.
    run_hash: String,
    /// Rotors that were faulty at any time, from 1.
    faulty_rotors: Vec<u32>,
    /// First onset of a fault, s; absent if no rotor was faulty at any time.
    fault_onset_s: Option<f64>,
    /// Windows of the detector with this truth and verdict.
    windows: u64,
    /// Final verdict; −2 if the detector was never ready.
    verdict_at_end: i32,
    /// Detection delay: from the onset to its first verdict other than healthy, s.
    detected_after_s: Option<f64>,
    /// Isolation delay: from the onset to its first correct verdict, s.
    isolated_after_s: Option<f64>,
    /// False alarms; consecutive windows count once.
    false_alarm_events: u64,
    /// Id of the run if this flight was flown as one; absent if it was not, or not by the caller's tenant.
    run: Option<String>,
}

/// A page of flights, in their order.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct CampaignFlightPage {
    /// May hold fewer than `limit`, or none, if few of 20,000 flights match.
    items: Vec<CampaignFlight>,
    /// `cursor` of the next page; absent on the last one.
    next: Option<String>,
}

/// What a flight must have to be listed.
struct Wanted {
    place: usize,
    truth: Option<i32>,
    verdicts: Option<Vec<i32>>,
    status: Option<FlightStatus>,
}

impl Wanted {
    fn of(query: &FlightsQuery) -> Result<Self, Problem> {
        let verdicts = query.verdict.as_deref().map(|text| {
            let codes = text.split(',').map(|code| code.trim().parse().ok());
            let codes = codes.collect::<Option<Vec<i32>>>();
            codes.filter(|codes| codes.len() <= MOST_VERDICTS).ok_or_else(|| {
                Problem::bad_request(format!(
                    "`verdict` is '{text}'; expected 1 to {MOST_VERDICTS} codes of verdicts, separated by commas, such as 3 or 102,103"
                ))
            })
        });
        Ok(Self {
            place: query.detector.unwrap_or_default().place(),
            truth: query.truth,
            verdicts: verdicts.transpose()?,
            status: query.status,
        })
    }

    /// The flight as it is listed; `None`: it is not.
    fn row(&self, record: FlightRecord) -> Option<CampaignFlight> {
        let score = record.detectors.get(self.place)?;
        let in_cell = |truth: i32, verdict: i32| {
            self.truth.is_none_or(|wanted| wanted == truth)
                && self.verdicts.as_ref().is_none_or(|wanted| wanted.contains(&verdict))
        };
        let cells = score.confusion.iter();
        let windows = cells
            .filter(|(truth, verdict, _)| in_cell(*truth, *verdict))
            .map(|(_, _, count)| count)
            .sum();
        let asks_for_a_cell = self.truth.is_some() || self.verdicts.is_some();
        if asks_for_a_cell && windows == 0 || self.status.is_some_and(|wanted| wanted != record.status) {
            return None;
        }
        Some(CampaignFlight {
            flight: record.flight,
            seed: record.seed.to_string(),
            status: record.status,
            reason: Some(record.reason).filter(|reason| !reason.is_empty()),
            faulty_rotors: (1..=32)
                .filter(|rotor| record.faulty_rotors >> (rotor - 1) & 1 == 1)
                .collect(),
            fault_onset_s: record.fault_onset_s,
            windows,
            verdict_at_end: score.final_verdict,
            detected_after_s: score.detected_after_s(),
            isolated_after_s: score.isolated_after_s(),
            false_alarm_events: score.false_alarm_events,
            parameters: record
                .parameters
                .into_iter()
                .map(|(axis, value)| FlightParameter { axis, value })
                .collect(),
            run_hash: record.run_hash,
            run: None,
        })
    }
}

/// Flights of a campaign that is done: all of them, or those with windows in a cell of a detector's confusion matrix.
#[utoipa::path(get, path = "/api/v1/campaigns/{id}/flights", tag = "campaigns", operation_id = "campaign_flights", params(("id" = String, Path), FlightsQuery), responses(
    (status = 200, description = "one page of the list", body = CampaignFlightPage),
    (status = 400, description = "invalid filter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "campaign not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn list(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    query: Result<Query<FlightsQuery>, QueryRejection>,
) -> Result<Json<CampaignFlightPage>, Problem> {
    let Path(id) = id?;
    let Query(query) = query?;
    let limit = usize::try_from(query.limit.unwrap_or(50)).unwrap_or(usize::MAX);
    let wanted = Wanted::of(&query)?;
    let campaign = done(&app, &caller, JobKind::Campaign, &id).await?;
    let (mut items, next) = page_of(&app, &campaign, wanted, query.cursor.unwrap_or(0), limit).await?;
    let runs = runs_of(&app, &caller, &id).await?;
    for item in &mut items {
        item.run = runs.get(&key(&id, item.flight)).cloned();
    }
    Ok(Json(CampaignFlightPage {
        items,
        next: next.map(|flight| flight.to_string()),
    }))
}

/// Flights from `first` on, and where the next page begins.
async fn page_of(
    app: &App,
    campaign: &Job,
    wanted: Wanted,
    first: u64,
    limit: usize,
) -> Result<(Vec<CampaignFlight>, Option<u64>), Problem> {
    let folder = campaign.folder.as_deref().unwrap_or_default();
    let files = app.artifacts.list(folder).await;
    let files = files.map_err(|error| Problem::of_files(&error))?;
    let mut shards: Vec<(u64, String)> = files
        .into_iter()
        .filter_map(|file| Some((shard_number(&file.path)?, file.path)))
        .filter(|(shard, _)| (shard + 1).saturating_mul(SHARD_FLIGHTS) > first)
        .collect();
    shards.sort_unstable();
    let mut items = Vec::new();
    for (shard, name) in shards {
        if shard.saturating_mul(SHARD_FLIGHTS) >= first.saturating_add(MOST_LOOKED_AT) {
            return Ok((items, Some(shard * SHARD_FLIGHTS)));
        }
        let file = app.artifacts.file(folder, &name).await;
        let file = file
            .map_err(|error| Problem::of_files(&error))?
            .ok_or_else(|| Problem::not_found(format!("{name} of the campaign was deleted")))?;
        let records = tokio::task::spawn_blocking(move || {
            let file = std::fs::File::open(file).map_err(|error| error.to_string())?;
            read_records(file)
        });
        let records = records.await.map_err(|error| Problem::internal(&error))?;
        let records = records.map_err(|reason| Problem::internal(&format!("{name}: {reason}")))?;
        for record in records.into_iter().filter(|record| record.flight >= first) {
            let flight = record.flight;
            let Some(row) = wanted.row(record) else { continue };
            if items.len() == limit {
                return Ok((items, Some(flight)));
            }
            items.push(row);
        }
    }
    Ok((items, None))
}

/// Ids of the runs that flights of a campaign were flown as, by their keys.
async fn runs_of(app: &App, caller: &Caller, campaign: &str) -> Result<BTreeMap<String, String>, Problem> {
    let filter = Filter {
        kind: Some(JobKind::Run),
        tenant: Some(&caller.tenant),
        parent: Some(campaign),
        ..Filter::default()
    };
    let runs = app.database.list(&filter, MOST_RUNS).await?;
    let keyed = runs
        .into_iter()
        .filter_map(|run| Some((run.new.idempotency_key?, run.id)));
    Ok(keyed.collect())
}

/// The key under which the run of a flight is submitted: requested twice, it is the same run.
fn key(campaign: &str, flight: u64) -> String {
    format!("campaigns/{campaign}/flights/{flight}")
}

/// Submits a flight of a campaign as a run, with its seed and scenario: the run hash is that of the flight. `parent` of the run is the campaign.
///
/// A repeated request returns the existing run.
#[utoipa::path(post, path = "/api/v1/campaigns/{id}/flights/{flight}/run", tag = "campaigns", operation_id = "fly_campaign_flight",
    params(("id" = String, Path), ("flight" = u64, Path, description = "number of the flight, from 0")), responses(
    (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = Run,
     headers(("Location" = String, description = "URL of the run"))),
    (status = 200, description = "the existing run", body = Run),
    (status = 400, description = "invalid flight number", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "campaign or flight not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "a different run was submitted under the key of this flight", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the scenario cannot be flown", body = Problem, content_type = "application/problem+json"),
    (status = 429, description = "quota of queued jobs exceeded", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn fly(
    app: Shared,
    caller: Caller,
    path: Result<Path<(String, u64)>, PathRejection>,
) -> Result<Response, Problem> {
    let Path((id, flight)) = path?;
    let job = jobs::find(&app, &caller, JobKind::Campaign, Ok(Path(id.clone()))).await?;
    let key = key(&id, flight);
    let hash = jobs::request_hash(&key);
    let headers = HeaderMap::from_iter([(
        HeaderName::from_static("idempotency-key"),
        HeaderValue::from_str(&key).map_err(|error| Problem::bad_request(error.to_string()))?,
    )]);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Run, &headers, &hash, Run::from).await? {
        return Ok(answer);
    }
    let (scenario, seed) = flight_of(&app, &job, flight).await?;
    submissions::again(&app, &caller, &headers, hash, &scenario, seed, job.id).await
}

/// Scenario and seed of a flight, of the documents that the campaign was submitted with.
async fn flight_of(app: &App, job: &Job, flight: u64) -> Result<(Scenario, u64), Problem> {
    let (text, library) = submitted(app, job).await?;
    let facts: CampaignFacts = serde_json::from_str(&job.new.facts).map_err(|error| other_version(&error))?;
    if flight >= facts.flights {
        return Err(Problem::not_found(format!(
            "flight {flight} not found in this campaign; expected 0 to {}",
            facts.flights.saturating_sub(1)
        )));
    }
    let planned = campaigns::check::<CheckedFlight>(app, &library, &text, Some(flight)).await;
    let planned = planned.map_err(|mut problem| {
        if problem.status == StatusCode::UNPROCESSABLE_ENTITY.as_u16() {
            problem.detail = format!("flight {flight} cannot be flown: {}", problem.detail);
        }
        problem
    })?;
    let read = || {
        Documents::from_toml("the flight", &planned.documents)
            .and_then(|documents| Scenario::from_documents(&documents))
    };
    let scenario = app
        .readers
        .read(read)
        .await
        .map_err(|error| Problem::internal(&error))?;
    let seed = planned.seed.parse().map_err(|error| Problem::internal(&error))?;
    Ok((scenario, seed))
}

/// Text and library of an accepted campaign.
async fn submitted(app: &App, job: &Job) -> Result<(String, Library), Problem> {
    let stored = StoredJob::parse(&job.new.spec).map_err(|error| other_version(&error))?;
    let rotortwin_jobs::Job::Campaign(spec) = stored.job else {
        return Err(other_version(&"it is none"));
    };
    let (mut text, mut library) = (None, None);
    for input in stored.inputs {
        match input.content {
            Content::Text(content) if spec.campaign == std::path::Path::new(&input.path) => text = Some(content),
            Content::Folder(key) if input.path == LIBRARY => library = Some(key),
            _ => {}
        }
    }
    let (Some(text), Some(library)) = (text, library) else {
        return Err(other_version(&"its documents are kept elsewhere"));
    };
    // With a bucket the documents are fetched to where copies are kept; else they are there.
    let files = app.artifacts.list(&library).await;
    let files = files.map_err(|error| Problem::of_files(&error))?;
    if files.is_empty() {
        return Err(Problem::not_found("the documents of the campaign were deleted"));
    }
    for file in files {
        let copy = app.artifacts.file(&library, &file.path).await;
        copy.map_err(|error| Problem::of_files(&error))?;
    }
    let library = Library::open(&app.artifacts.place(&library)).map_err(|error| Problem::internal(&error))?;
    Ok((text, library))
}

fn other_version(what: &dyn std::fmt::Display) -> Problem {
    Problem::unprocessable(format!(
        "this version cannot read the campaign, which another version accepted: {what}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_campaign::study::score::DetectorScore;

    fn record(confusion: Vec<(i32, i32, u64)>) -> FlightRecord {
        let score = DetectorScore {
            confusion,
            ..DetectorScore::default()
        };
        FlightRecord {
            flight: 7,
            seed: u64::MAX,
            parameters: vec![("rotor".to_owned(), Cell::Integer(3))],
            status: FlightStatus::Done,
            reason: String::new(),
            run_hash: "h".to_owned(),
            steps: 1,
            rotor_count: 6,
            fault_onset_s: Some(1.0),
            faulty_rotors: 0b100_100,
            onset_loss_share: None,
            final_loss_share: None,
            thrust_loss_n: None,
            thrust_loss_low_n: None,
            thrust_loss_high_n: None,
            true_thrust_loss_n: None,
            detectors: vec![score.clone(), DetectorScore::default(), score],
            curve: Vec::new(),
        }
    }

    fn wanted(truth: Option<i32>, verdicts: Option<Vec<i32>>, status: Option<FlightStatus>) -> Wanted {
        Wanted {
            place: 0,
            truth,
            verdicts,
            status,
        }
    }

    #[test]
    fn val_a_flight_is_listed_where_it_has_windows() {
        let counts = vec![(0, 0, 10), (0, 3, 2), (3, 3, 5), (3, 102, 1), (3, 104, 1)];
        let windows = |wanted: Wanted| wanted.row(record(counts.clone())).map(|row| row.windows);
        assert_eq!(windows(wanted(None, None, None)), Some(19));
        assert_eq!(windows(wanted(Some(3), None, None)), Some(7));
        assert_eq!(windows(wanted(None, Some(vec![3]), None)), Some(7));
        assert_eq!(windows(wanted(Some(0), Some(vec![3]), None)), Some(2));
        assert_eq!(windows(wanted(Some(3), Some(vec![102, 104]), None)), Some(2));
        assert_eq!(windows(wanted(Some(0), Some(vec![5]), None)), None);
        assert_eq!(windows(wanted(None, None, Some(FlightStatus::Failed))), None);
    }

    #[test]
    fn val_seeds_and_rotors_are_told_whole() {
        let row = wanted(None, None, None).row(record(Vec::new())).expect("listed");
        assert_eq!(
            (row.seed.as_str(), row.faulty_rotors),
            ("18446744073709551615", vec![3, 6])
        );
        assert_eq!(row.reason, None);
    }

    #[test]
    fn val_detectors_have_the_places_of_the_record() {
        let places = [Detector::Sequential, Detector::Network, Detector::TTest].map(Detector::place);
        assert_eq!(
            places.map(|place| DETECTORS[place]),
            ["sequential", "network", "t_test"]
        );
    }
}
