//! Many runs side by side: one row per run, one column per number of its summary.

use super::jobs::Shared;
use crate::access::Caller;
use crate::jobs::Job;
use crate::jobs::store::Filter;
use crate::problem::Problem;
use axum::Json;
use axum::extract::Query;
use axum::extract::rejection::QueryRejection;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use rotortwin_jobs::{JobKind, Status};
use rotortwin_store::summary::Summary;
use serde::de::{IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer as _, Serialize};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;
use utoipa::openapi::{RefOr, Schema};
use utoipa::{IntoParams, PartialSchema as _, ToSchema};

/// Rows of a table, at most.
const MOST_ROWS: i64 = 20_000;
/// Columns of a table, at most.
const MOST_COLUMNS: usize = 200;
/// Names of columns are collected from this many runs.
const SAMPLE: usize = 50;
/// A run's summary, in the OpenAPI document.
const SUMMARY_SCHEMA: &str = "#/components/schemas/RunSummary";

/// Which runs, which columns.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct TableQuery {
    /// Values of the summary, separated by commas: `steps,detectors.sequential.delay_s`; without it, only the
    /// available columns.
    #[param(min_length = 1)]
    columns: Option<String>,
    /// Only runs of this scenario.
    name: Option<String>,
    /// Only runs forked from this one.
    parent: Option<String>,
    /// Only those in this state; by default `done`.
    status: Option<Status>,
    /// Maximum number of rows, 1 to 20000, latest first.
    #[param(minimum = 1, maximum = 20_000, default = 20_000)]
    limit: Option<i64>,
    /// `json` or `csv`; default `json`.
    #[param(inline)]
    format: Option<Format>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Format {
    Json,
    Csv,
}

/// A table: `rows[i][j]` belongs to `columns[j]`.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Table {
    columns: Vec<String>,
    /// Numbers, booleans, strings; null if a run has no value.
    #[schema(value_type = Vec<Vec<serde_json::Value>>)]
    rows: Vec<Vec<Value>>,
}

/// Compares runs: one row per run, with the requested values of its summary.
#[utoipa::path(get, path = "/api/v1/table", tag = "runs", operation_id = "compare_runs", params(TableQuery), responses(
    (status = 200, description = "the table; without `columns`, one row with the column names of the latest runs", body = Table),
    (status = 400, description = "invalid query", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "none of these runs has this column", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn table(
    app: Shared,
    caller: Caller,
    query: Result<Query<TableQuery>, QueryRejection>,
) -> Result<Response, Problem> {
    let Query(query) = query?;
    let limit = query.limit.unwrap_or(MOST_ROWS);
    let filter = Filter {
        kind: Some(JobKind::Run),
        tenant: caller.tenant_filter(),
        status: Some(query.status.unwrap_or(Status::Done)),
        name: query.name.as_deref(),
        parent: query.parent.as_deref(),
        ..Filter::default()
    };
    let Some(columns) = &query.columns else {
        let jobs = app.database.list_metrics(&filter, limit.min(SAMPLE as i64)).await?;
        let metrics = jobs.iter().filter_map(|job| job.metrics.as_deref());
        let names: BTreeSet<String> = metrics.flat_map(names_in).collect();
        let row = names.into_iter().map(Value::String).collect();
        return Ok(Json(Table {
            columns: Vec::new(),
            rows: vec![row],
        })
        .into_response());
    };
    let wanted: Vec<&str> = columns
        .split(',')
        .map(str::trim)
        .filter(|name| !name.is_empty())
        .collect();
    if wanted.is_empty() || wanted.len() > MOST_COLUMNS {
        return Err(Problem::bad_request(format!(
            "`columns` names {}; expected 1 to {MOST_COLUMNS}",
            wanted.len()
        )));
    }
    let jobs = app.database.list_metrics(&filter, limit).await?;
    refuse_unknown(&wanted, &jobs)?;
    let names: Vec<String> = ["id", "name", "vehicle", "seed", "run_hash"]
        .into_iter()
        .chain(wanted.iter().copied())
        .map(str::to_owned)
        .collect();
    let rows: Vec<Vec<Value>> = jobs
        .into_iter()
        .map(|job| {
            let facts: Value = serde_json::from_str(&job.new.facts).unwrap_or_default();
            let metrics = job.metrics.as_deref().unwrap_or("{}");
            let mut row = vec![
                Value::String(job.id),
                Value::String(job.new.name),
                facts["vehicle"].clone(),
                facts["seed"].clone(),
                job.run_hash.map_or(Value::Null, Value::String),
            ];
            row.extend(pick(metrics, &wanted));
            row
        })
        .collect();
    Ok(match query.format.unwrap_or(Format::Json) {
        Format::Json => Json(Table { columns: names, rows }).into_response(),
        Format::Csv => ([(header::CONTENT_TYPE, "text/csv")], csv(&names, &rows)).into_response(),
    })
}

/// A column is known if one of the runs has it, or if a summary can have it: some are null in many runs, such as the
/// delay of a detector where nothing was to be found.
///
/// # Errors
/// 422: a column that is none, with those there are.
fn refuse_unknown(wanted: &[&str], jobs: &[Job]) -> Result<(), Problem> {
    let mut unknown: BTreeSet<&str> = wanted
        .iter()
        .copied()
        .filter(|name| !a_summary_can_have(name))
        .collect();
    let metrics = || jobs.iter().filter_map(|job| job.metrics.as_deref());
    for text in metrics() {
        if unknown.is_empty() {
            return Ok(());
        }
        let names: Vec<&str> = unknown.iter().copied().collect();
        for (name, value) in names.iter().zip(pick(text, &names)) {
            if !value.is_null() {
                unknown.remove(name);
            }
        }
    }
    if unknown.is_empty() {
        return Ok(());
    }
    let there: BTreeSet<String> = metrics().take(SAMPLE).flat_map(names_in).collect();
    let there: Vec<String> = there.into_iter().collect();
    let unknown: Vec<String> = unknown.into_iter().map(|name| format!("'{name}'")).collect();
    Err(Problem::unprocessable(format!(
        "`columns`: no run has {}; expected some of {}",
        unknown.join(", "),
        if there.is_empty() {
            "the numbers of a run's summary".to_owned()
        } else {
            there.join(", ")
        }
    )))
}

/// Names of the numbers of a run.
fn names_in(metrics: &str) -> Vec<String> {
    serde_json::from_str::<serde_json::Map<String, Value>>(metrics)
        .map(|metrics| metrics.into_iter().map(|(name, _)| name).collect())
        .unwrap_or_default()
}

/// Whether the schema of a run's summary has a number, truth value or text at this path.
fn a_summary_can_have(path: &str) -> bool {
    // Of the schemas below it alone: the unit tests would else compile every route of the API.
    static DOCUMENT: LazyLock<Value> = LazyLock::new(|| {
        let mut schemas = vec![(Summary::name().into_owned(), Summary::schema())];
        Summary::schemas(&mut schemas);
        let schemas: BTreeMap<String, RefOr<Schema>> = schemas.into_iter().collect();
        json!({ "components": { "schemas": schemas } })
    });
    let steps: Vec<&str> = path.split('.').collect();
    leads_to_a_value(&DOCUMENT, &json!({ "$ref": SUMMARY_SCHEMA }), &steps)
}

fn leads_to_a_value(document: &Value, schema: &Value, path: &[&str]) -> bool {
    if let Some(target) = schema["$ref"].as_str() {
        let target = target.strip_prefix('#').and_then(|pointer| document.pointer(pointer));
        return target.is_some_and(|schema| leads_to_a_value(document, schema, path));
    }
    let any = ["oneOf", "anyOf", "allOf"]
        .iter()
        .filter_map(|key| schema[*key].as_array());
    if any.flatten().any(|schema| leads_to_a_value(document, schema, path)) {
        return true;
    }
    let Some((step, rest)) = path.split_first() else {
        let is = |kind: &str| match &schema["type"] {
            Value::Array(kinds) => kinds.iter().any(|it| it == kind),
            it => it == kind,
        };
        return ["number", "integer", "boolean", "string"].into_iter().any(is);
    };
    let below = match schema["properties"].get(step) {
        Some(property) => property,
        None if step.parse::<u64>().is_ok() && schema["items"].is_object() => &schema["items"],
        None if schema["additionalProperties"].is_object() => &schema["additionalProperties"],
        None => return false,
    };
    leads_to_a_value(document, below, rest)
}

/// The wanted entries of a flat JSON object, in their order; null for missing ones. Others are skipped, not parsed:
/// there are hundreds of entries, thousands of times.
fn pick(text: &str, wanted: &[&str]) -> Vec<Value> {
    struct Picker<'a>(&'a [&'a str]);
    impl<'de> Visitor<'de> for Picker<'_> {
        type Value = Vec<Value>;

        fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            formatter.write_str("an object")
        }

        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Vec<Value>, A::Error> {
            let mut found = vec![Value::Null; self.0.len()];
            while let Some(key) = map.next_key::<Cow<'de, str>>()? {
                match self.0.iter().position(|name| *name == key) {
                    Some(place) => found[place] = map.next_value()?,
                    None => {
                        map.next_value::<IgnoredAny>()?;
                    }
                }
            }
            Ok(found)
        }
    }
    let mut reader = serde_json::Deserializer::from_str(text);
    reader
        .deserialize_map(Picker(wanted))
        .unwrap_or_else(|_no_object| vec![Value::Null; wanted.len()])
}

fn csv(columns: &[String], rows: &[Vec<Value>]) -> String {
    let quoted = |text: &str| {
        if text.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", text.replace('"', "\"\""))
        } else {
            text.to_owned()
        }
    };
    let mut text = columns.iter().map(|name| quoted(name)).collect::<Vec<_>>().join(",");
    text.push('\n');
    for row in rows {
        let cells: Vec<String> = row
            .iter()
            .map(|value| match value {
                Value::Null => String::new(),
                Value::String(text) => quoted(text),
                other => other.to_string(),
            })
            .collect();
        text.push_str(&cells.join(","));
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_what_a_summary_can_have() {
        for there in [
            "steps",
            "tracking.position_rms_m",
            "tracking.position_rms_ned_m.2",
            "intervals.3.position_rms_m",
            "scenario.vehicle",
            "conditions.7",
        ] {
            assert!(a_summary_can_have(there), "{there}");
        }
        for none in [
            "nonsense",
            "",
            "steps.x",
            "tracking",
            "intervals",
            "intervals.x.scores",
            "tracking.position_rms_ned_m",
        ] {
            assert!(!a_summary_can_have(none), "{none}");
        }
    }

    #[test]
    fn val_wanted_entries_in_their_order() {
        let text = r#"{"a":1,"b.c":"x\u00e4","d":true,"e":2.5}"#;
        assert_eq!(
            pick(text, &["e", "none", "b.c"]),
            [json!(2.5), Value::Null, json!("xä")]
        );
        assert_eq!(pick("[]", &["a"]), [Value::Null]);
    }

    #[test]
    fn val_texts_are_quoted_as_rfc_4180_has_it() {
        let rows = vec![vec![json!("a,\"b\""), json!(1.5), Value::Null]];
        assert_eq!(
            csv(&["x".to_owned(), "y".to_owned(), "z".to_owned()], &rows),
            "x,y,z\n\"a,\"\"b\"\"\",1.5,\n"
        );
    }
}
