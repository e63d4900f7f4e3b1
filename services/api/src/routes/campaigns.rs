//! Campaigns: submit. A large one is flown in parts by all workers, which are then merged.
//!
//! A few lines can mean hundreds of millions of values, so a process of its own reads the document and tries its flights before it is accepted
//! (`rotortwin campaign FILE --check --json`), and again for the run of one of its flights (`--flight N`).

use super::facts::{CampaignFacts, CampaignPartFacts, JobFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, LIBRARY, OUT, laid_out, submit_in_parts};
use crate::App;
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::library::Library;
use crate::library::own::LARGEST_DOCUMENT;
use crate::problem::Problem;
use crate::worker::answer::{MEMORY_OPTION, Patience, answered_within};
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_campaign::study::folder::SHARD_FLIGHTS;
use rotortwin_jobs::submission::CampaignSubmission;
use rotortwin_jobs::{CampaignCheck, CheckedCampaign, Input, JobKind, Question, StoredJob};
use rotortwin_scenario::toml_document::to_text;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ops::Range;
use std::time::Duration;

super::collection!(
    campaigns,
    rotortwin_jobs::JobKind::Campaign,
    CampaignResult,
    "campaign",
    "/api/v1/campaigns",
    "/api/v1/campaigns/{id}",
    "/api/v1/campaigns/{id}/cancel",
    "/api/v1/campaigns/{id}/events",
    "/api/v1/campaigns/{id}/artifacts",
    "/api/v1/campaigns/{id}/artifacts/{*path}"
);

/// The file of a campaign that came as a text.
const SUBMITTED: &str = "submitted-campaign.toml";
/// Longest time that it takes to read a campaign and to try its flights.
const CHECK_TIMEOUT: Duration = Duration::from_secs(60);
/// Memory for this, bytes.
const CHECK_MEMORY: u64 = 256_000_000;

/// Submits a campaign.
#[utoipa::path(post, path = "/api/v1/campaigns", tag = "campaigns", operation_id = "submit_campaign", request_body = CampaignSubmission,
    params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing campaign")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the campaign"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "campaign not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the campaign cannot be flown", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "quota of queued jobs exceeded", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<JsonObject<CampaignSubmission>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&body);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Campaign, &headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    let library = app.library(&caller).await?;
    let named = || find(&library, body.campaign.as_deref(), body.text.clone());
    let text = app.readers.read(named).await?;
    let terms = Terms {
        priority: body.priority,
        max_wall_s: body.max_wall_s,
    };
    accept(
        &app,
        &caller,
        &headers,
        &body,
        library,
        text,
        body.classifier.as_deref(),
        terms,
    )
    .await
}

/// Checks a campaign, divides it into parts, and puts it into the queue.
///
/// # Errors
/// 400, 404, 409, 422, 429, 503, 507.
#[expect(
    clippy::too_many_arguments,
    reason = "all that is known of a campaign when it is accepted"
)]
pub(super) async fn accept(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    body: &impl Serialize,
    library: Library,
    text: String,
    classifier: Option<&str>,
    terms: Terms,
) -> Result<Response, Problem> {
    terms.check()?;
    // The folder with the classifier lives until the library has been read.
    let (library, document, _folder) = match classifier {
        None => (library, text, None),
        Some(id) => {
            let file = super::tasks::trained(app, caller, id).await?;
            let name = format!("trained-{id}.json");
            let (library, folder) = std::fs::read_to_string(&file)
                .map(|text| vec![(format!("classifiers/{name}"), text)])
                .and_then(|files| library.with_files(&app.config.work.data, &files))
                .map_err(|error| Problem::of_files(&error))?;
            let text = app.readers.read(|| with_network(&text, &name)).await?;
            (library, text, Some(folder))
        }
    };
    let CheckedCampaign {
        name, flights, seed, ..
    } = check(app, &library, &document, None).await?;
    let input = laid_out(app, &library).await?;
    let draft = |shards: Option<&Range<u64>>| {
        let (kind, name, facts) = match shards {
            None => {
                let facts = CampaignFacts {
                    flights,
                    seed,
                    classifier: classifier.map(str::to_owned),
                    parts: None,
                };
                (JobKind::Campaign, name.clone(), JobFacts::Campaign(facts))
            }
            Some(part) => {
                let first = part.start * SHARD_FLIGHTS;
                let facts = CampaignPartFacts {
                    first_flight: first,
                    flights: (part.end * SHARD_FLIGHTS).min(flights) - first,
                };
                (
                    JobKind::CampaignShard,
                    format!("{name} {}..{}", part.start, part.end),
                    JobFacts::CampaignPart(facts),
                )
            }
        };
        Draft {
            kind,
            name,
            facts,
            stored: stored(&input, &document, shards),
            terms,
        }
    };
    submit_in_parts(app, caller, headers, body, flights.div_ceil(SHARD_FLIGHTS), draft).await
}

/// The campaign with a classifier of the library in every flight.
fn with_network(text: &str, name: &str) -> Result<String, Problem> {
    let mut document: toml::Table = toml::from_str(text)
        .map_err(|error| Problem::unprocessable(format!("the campaign is not valid TOML: {}", error.message())))?;
    let mut table = &mut document;
    for key in ["set", "fdi"] {
        table = table
            .entry(key)
            .or_insert_with(|| toml::Value::Table(toml::Table::new()))
            .as_table_mut()
            .ok_or_else(|| Problem::unprocessable(format!("the campaign's `{key}`: expected a table")))?;
    }
    table.insert("network".to_owned(), format!("../classifiers/{name}").into());
    to_text(&toml::Value::Table(document)).ok_or_else(|| {
        Problem::unprocessable("the campaign is too large with a classifier; expected shorter keys of tables")
    })
}

/// The text of a campaign that names nothing outside of the library.
fn find(library: &Library, campaign: Option<&str>, text: Option<String>) -> Result<String, Problem> {
    let text = match (campaign, text) {
        (Some(name), None) => library.text("campaigns", name)?,
        (None, Some(text)) if text.len() > LARGEST_DOCUMENT => {
            return Err(Problem::too_large(format!(
                "`text` has {} bytes; expected a campaign of at most {LARGEST_DOCUMENT}",
                text.len()
            )));
        }
        (None, Some(text)) => text,
        _ => {
            return Err(Problem::unprocessable(
                "expected either `campaign`, the name of one of the server's campaigns, or `text`, a campaign document",
            ));
        }
    };
    let table: toml::Table = toml::from_str(&text)
        .map_err(|error| Problem::unprocessable(format!("the campaign is not valid TOML: {}", error.message())))?;
    Library::check_paths(&table)?;
    Ok(text)
}

/// Reads and tries a campaign as if it were in the library, in a process of its own, and returns what that says of it, or of one `flight`.
///
/// # Errors
/// 422: it cannot be flown, or takes too long or too much memory to be tried. 503, 507.
pub(super) async fn check<T: DeserializeOwned>(
    app: &App,
    library: &Library,
    text: &str,
    flight: Option<u64>,
) -> Result<T, Problem> {
    let path = format!("campaigns/{SUBMITTED}");
    let files = vec![(path.clone(), text.to_owned())];
    let (source, data) = (library.clone(), app.config.work.data.clone());
    // The folder is there until the process has ended.
    let (copy, _folder) = tokio::task::spawn_blocking(move || source.with_files(&data, &files))
        .await
        .map_err(|error| Problem::internal(&error))?
        .map_err(|error| Problem::of_files(&error))?;
    let question = Question::CampaignCheck(CampaignCheck {
        file: copy.root().join(&path),
        flight,
    });
    let memory = CHECK_MEMORY.min(app.config.work.job_memory);
    let patience = Patience {
        memory,
        wall: CHECK_TIMEOUT,
    };
    let for_callers = |sentence: &str| {
        let sentence = copy.without_root(&sentence);
        match memory {
            // No setting of the operator.
            CHECK_MEMORY => sentence.replace(MEMORY_OPTION, "; expected fewer keys or values"),
            _ => sentence,
        }
    };
    let text = answered_within(app, &question, patience, for_callers).await?;
    serde_json::from_str(&text).map_err(|error| Problem::internal(&error))
}

fn stored(library: &Input, text: &str, shards: Option<&Range<u64>>) -> StoredJob {
    let file = format!("{LIBRARY}/campaigns/{SUBMITTED}");
    let mut inputs = vec![library.clone(), Input::text(file.clone(), text)];
    // The shards of the parts stay: from them alone a client can print the tables and continue.
    inputs.extend(shards.is_none().then(|| Input::parts(OUT)));
    StoredJob {
        job: rotortwin_jobs::Job::Campaign(rotortwin_jobs::Campaign {
            campaign: file.into(),
            out: OUT.into(),
            shards: shards.cloned(),
            limit: None,
            threads: None,
        }),
        inputs,
    }
}
