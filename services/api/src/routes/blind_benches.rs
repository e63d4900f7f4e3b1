//! Blind benches: submit. The cases are executed in parts by all workers, and then merged.

use super::documents::checked_name;
use super::facts::{BlindBenchFacts, BlindBenchPartFacts, JobFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, OUT, laid_out, submit_in_parts};
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::library::Library;
use crate::problem::Problem;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_blind::bench::run::Request;
use rotortwin_blind::error::BlindError;
use rotortwin_blind::vehicle::Vehicle;
use rotortwin_jobs::submission::{BenchVehicle, BlindBenchSubmission};
use rotortwin_jobs::{BlindBench, Input, JobKind, StoredJob};
use rotortwin_scenario::toml_document::{to_text, too_much};
use std::collections::BTreeSet;
use std::ops::Range;

super::collection!(
    blind_benches,
    rotortwin_jobs::JobKind::BlindBench,
    BlindBenchResult,
    "blind bench",
    "/api/v1/blind-benches",
    "/api/v1/blind-benches/{id}",
    "/api/v1/blind-benches/{id}/cancel",
    "/api/v1/blind-benches/{id}/events",
    "/api/v1/blind-benches/{id}/artifacts",
    "/api/v1/blind-benches/{id}/artifacts/{*path}"
);

/// A bench has at most this many cases: about a day of one core.
const MOST_CASES: usize = 10_000;
/// A bench has at most this many vehicles.
const MOST_VEHICLES: usize = 32;
/// Where a job finds the library: rows name their vehicle like a bench that runs next to `config/`.
const LAID_OUT: &str = "config";
/// Taken where no vehicle is named, as by the command.
const USUAL_VEHICLE: &str = "f550";

/// Submits a blind bench.
#[utoipa::path(post, path = "/api/v1/blind-benches", tag = "blind_benches", operation_id = "submit_blind_bench", request_body = BlindBenchSubmission,
    params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing blind bench")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the blind bench"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "vehicle not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the blind bench cannot be run with these settings", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "quota of queued jobs exceeded", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<JsonObject<BlindBenchSubmission>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&body);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::BlindBench, &headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    let terms = Terms {
        priority: body.priority,
        max_wall_s: body.max_wall_s,
    };
    terms.check()?;
    let vehicles = chosen(&body.vehicles)?;
    let request = checked(&body, &vehicles, app.config.longest_flight_s)?;
    let library = app.library(&caller).await?;
    let files = app.readers.read(|| own_files(&library, &vehicles)).await?;
    // The folder with the vehicles that came along lives until the library has been copied.
    let (library, _folder) = if files.is_empty() {
        (library, None)
    } else {
        let (library, folder) = library
            .with_files(&app.config.work.data, &files)
            .map_err(|error| Problem::unwritten(&error, "the vehicles cannot be written: the disk is full"))?;
        (library, Some(folder))
    };
    let all_readable = || {
        let mut names = vehicles.iter().map(|vehicle| &vehicle.vehicle);
        names.try_for_each(|name| readable(&library, name))
    };
    app.readers.read(all_readable).await?;
    let input = Input {
        path: LAID_OUT.to_owned(),
        ..laid_out(&app, &library).await?
    };
    let name = body
        .presets
        .iter()
        .map(|preset| preset.name())
        .collect::<Vec<_>>()
        .join(",");
    let cases = request.case_count();
    let draft = |part: Option<&Range<u64>>| {
        let (kind, name, facts) = match part {
            None => {
                let named = vehicles.iter().map(|vehicle| vehicle.vehicle.clone()).collect();
                let facts = BlindBenchFacts {
                    cases,
                    presets: body.presets.clone(),
                    n: body.n,
                    seed: body.seed,
                    vehicles: named,
                    duration_s: body.duration_s,
                    parts: None,
                };
                (JobKind::BlindBench, name.clone(), JobFacts::BlindBench(facts))
            }
            Some(part) => {
                let facts = BlindBenchPartFacts {
                    first_case: part.start,
                    cases: part.end - part.start,
                };
                (
                    JobKind::BlindBenchShard,
                    format!("{name} {}..{}", part.start, part.end),
                    JobFacts::BlindBenchPart(facts),
                )
            }
        };
        Draft {
            kind,
            name,
            facts,
            stored: stored(&input, &request, part),
            terms,
        }
    };
    submit_in_parts(&app, &caller, &headers, &body, cases as u64, draft).await
}

/// The requested vehicles, each once by its name.
fn chosen(asked: &[BenchVehicle]) -> Result<Vec<BenchVehicle>, Problem> {
    if asked.len() > MOST_VEHICLES {
        return Err(Problem::unprocessable(format!(
            "{} `vehicles`; expected at most {MOST_VEHICLES}",
            asked.len()
        )));
    }
    let mut names = BTreeSet::new();
    for vehicle in asked {
        if !names.insert(&vehicle.vehicle) {
            return Err(Problem::unprocessable(format!(
                "`vehicles` name '{}' twice; expected each once",
                vehicle.vehicle
            )));
        }
        if vehicle.text.is_some() {
            checked_name(&vehicle.vehicle)?;
        } else if vehicle.blades.is_some() {
            return Err(Problem::unprocessable(format!(
                "vehicle '{}' has `blades` and no `text`; expected both, or the name alone",
                vehicle.vehicle
            )));
        }
    }
    if asked.is_empty() {
        return Ok(vec![BenchVehicle {
            vehicle: USUAL_VEHICLE.to_owned(),
            text: None,
            blades: None,
        }]);
    }
    Ok(asked.to_vec())
}

/// The request of the bench, with the paths of the vehicles as they are laid out.
fn checked(body: &BlindBenchSubmission, vehicles: &[BenchVehicle], longest_s: f64) -> Result<Request, Problem> {
    let path = |vehicle: &BenchVehicle| format!("{LAID_OUT}/vehicles/{}.toml", vehicle.vehicle);
    let request = Request {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        presets: body.presets.clone(),
        n: body.n,
        seed: body.seed,
        vehicles: vehicles.iter().map(path).collect(),
        duration_s: body.duration_s,
    };
    request.check().map_err(|error| match error {
        BlindError::Input { place, reason } => Problem::unprocessable(format!("`{place}`: {reason}")),
        other => Problem::internal(&other),
    })?;
    if request.duration_s > longest_s {
        return Err(Problem::unprocessable(format!(
            "the flights take {} s of simulated time; this server flies at most {longest_s} s (`--longest-flight`)",
            request.duration_s
        )));
    }
    let cases = request.case_count();
    if cases > MOST_CASES {
        return Err(Problem::unprocessable(format!(
            "`n` times the number of `presets` is {cases}; expected at most {MOST_CASES} cases"
        )));
    }
    Ok(request)
}

/// Files that vehicles bring along, each with its path in the library. A vehicle that brings no blades names some of the library.
fn own_files(library: &Library, vehicles: &[BenchVehicle]) -> Result<Vec<(String, String)>, Problem> {
    let mut files = Vec::new();
    for vehicle in vehicles {
        let (name, Some(text)) = (&vehicle.vehicle, &vehicle.text) else {
            continue;
        };
        let text = match &vehicle.blades {
            None => {
                library.parse_vehicle(text)?;
                text.clone()
            }
            Some(blades) => {
                let file = format!("{name}.toml");
                files.push((format!("blades/{file}"), blades.clone()));
                with_blades(text, name, &format!("../blades/{file}"))?
            }
        };
        files.push((format!("vehicles/{name}.toml"), text));
    }
    Ok(files)
}

/// The vehicle with another path of its blades.
fn with_blades(text: &str, name: &str, path: &str) -> Result<String, Problem> {
    if let Some(reason) = too_much(text) {
        return Err(Problem::unprocessable(format!("vehicle '{name}': {reason}")));
    }
    let mut document: toml::Table = toml::from_str(text)
        .map_err(|error| Problem::unprocessable(format!("vehicle '{name}' is not valid TOML: {}", error.message())))?;
    let rotors = document.get_mut("rotors").and_then(toml::Value::as_table_mut);
    let rotors =
        rotors.ok_or_else(|| Problem::unprocessable(format!("vehicle '{name}', key `rotors`: expected a table")))?;
    rotors.insert("blades".to_owned(), path.into());
    to_text(&toml::Value::Table(document)).ok_or_else(|| {
        Problem::unprocessable(format!(
            "vehicle '{name}' is too large; expected shorter keys of tables"
        ))
    })
}

/// Whether the diagnosis and the independent simulator, each with a reader of its own, can read a vehicle.
fn readable(library: &Library, name: &str) -> Result<(), Problem> {
    library.vehicle_documents(name)?;
    Vehicle::load(&library.root().join("vehicles").join(format!("{name}.toml")))
        .map(|_| ())
        .map_err(|error| library.refusal(&error))
}

fn stored(library: &Input, request: &Request, part: Option<&Range<u64>>) -> StoredJob {
    let mut inputs = vec![library.clone()];
    // A bench continues where its files end: with the rows of all parts there is only the score to be made.
    inputs.extend(part.is_none().then(|| Input::parts(OUT)));
    StoredJob {
        job: rotortwin_jobs::Job::BlindBench(BlindBench {
            presets: request.presets.clone(),
            n: request.n,
            seed: request.seed,
            vehicles: request.vehicles.clone(),
            duration_s: request.duration_s,
            out: OUT.into(),
            cases: part.cloned(),
            processes: None,
            keep_logs: false,
        }),
        inputs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn submission(body: serde_json::Value) -> Result<BlindBenchSubmission, serde_json::Error> {
        serde_json::from_value(body)
    }

    fn refusal(body: serde_json::Value) -> String {
        let body = submission(body).unwrap();
        let vehicles = match chosen(&body.vehicles) {
            Ok(vehicles) => vehicles,
            Err(problem) => return problem.detail,
        };
        checked(&body, &vehicles, 600.0).unwrap_err().detail
    }

    #[test]
    fn val_what_cannot_be_run_is_said_in_one_sentence() {
        for (body, words) in [
            (json!({ "n": 0 }), "`n`: is 0; expected at least one"),
            (json!({ "n": 1, "presets": [] }), "`presets`: is empty"),
            (
                json!({ "n": 5001, "presets": ["null", "pairs"] }),
                "is 10002; expected at most 10000 cases",
            ),
            (
                json!({ "n": u64::MAX, "presets": ["null", "pairs"] }),
                "expected at most 10000",
            ),
            (json!({ "n": 1, "duration_s": 0.5 }), "expected 1 to 3600 s"),
            (json!({ "n": 1, "duration_s": 601.0 }), "at most 600 s"),
            (
                json!({ "n": 1, "vehicles": [{ "vehicle": "a", "blades": "" }] }),
                "no `text`",
            ),
            (
                json!({ "n": 1, "vehicles": [{ "vehicle": "../a", "text": "" }] }),
                "not a valid document name",
            ),
            (
                json!({ "n": 1, "vehicles": [{ "vehicle": "a" }, { "vehicle": "a" }] }),
                "twice",
            ),
        ] {
            let detail = refusal(body);
            assert!(detail.contains(words), "{detail}");
        }
        let unknown = submission(json!({ "n": 1, "presets": ["nonsense"] }))
            .unwrap_err()
            .to_string();
        assert!(
            unknown.contains("unknown variant `nonsense`") && unknown.contains("`mixed`"),
            "{unknown}"
        );
    }

    #[test]
    fn val_parts_and_whole_ask_for_the_same_bench() {
        let body = submission(json!({ "n": 4, "seed": 7, "presets": ["pairs", "null-hover"] })).unwrap();
        let request = checked(&body, &chosen(&body.vehicles).unwrap(), 600.0).unwrap();
        assert_eq!(request.vehicles, ["config/vehicles/f550.toml"]);
        let library = Input::folder(LAID_OUT, "library/0");
        let bench = |part| match stored(&library, &request, part) {
            StoredJob {
                job: rotortwin_jobs::Job::BlindBench(bench),
                inputs,
            } => (bench, inputs.len()),
            other => panic!("no bench: {other:?}"),
        };
        let ((whole, inputs), (part, inputs_of_part)) = (bench(None), bench(Some(&(2..5))));
        let asked = BlindBench {
            presets: request.presets.clone(),
            n: request.n,
            seed: request.seed,
            vehicles: request.vehicles.clone(),
            duration_s: request.duration_s,
            ..whole.clone()
        };
        assert_eq!(whole, asked);
        let cases = Some(2..5);
        assert_eq!(part, BlindBench { cases, ..asked });
        assert_eq!((whole.cases, inputs, inputs_of_part), (None, 2, 1));
    }

    #[test]
    fn val_a_vehicle_gets_the_blades_that_came_with_it() {
        let text = with_blades(
            "name = 'a'\n[rotors]\nblades = '/etc/hostname'\nn = 6",
            "a",
            "../blades/a.toml",
        )
        .unwrap();
        assert!(
            text.contains("../blades/a.toml") && !text.contains("hostname"),
            "{text}"
        );
        assert_eq!(with_blades("rotors = 3", "a", "x").unwrap_err().status, 422);
        assert_eq!(with_blades("[", "a", "x").unwrap_err().status, 422);
    }
}
