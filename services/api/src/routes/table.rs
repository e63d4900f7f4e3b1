//! Many runs side by side: one row a run, one column a number of its summary.

use super::jobs::Shared;
use crate::access::Caller;
use crate::jobs::store::Filter;
use crate::jobs::{JobKind, Status};
use crate::problem::Problem;
use axum::Json;
use axum::extract::Query;
use axum::extract::rejection::QueryRejection;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::de::{IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer as _, Serialize};
use serde_json::Value;
use std::borrow::Cow;
use std::collections::BTreeSet;
use utoipa::{IntoParams, ToSchema};

/// Rows of a table, at most.
const MOST_ROWS: i64 = 20_000;
/// Columns of a table, at most.
const MOST_COLUMNS: usize = 200;

/// Which runs, which columns.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct TableQuery {
    /// Numbers of the summary, separated by commas: `steps,detectors.sequential.delay_s`; without it only what columns there are.
    columns: Option<String>,
    /// Only runs of this scenario.
    name: Option<String>,
    /// Only runs forked from this one.
    parent: Option<String>,
    /// Only those in this state; by default those that are done.
    status: Option<Status>,
    /// Rows, 1 to 20000, the latest first.
    #[param(minimum = 1, maximum = 20_000, default = 20_000)]
    limit: Option<i64>,
    /// `json` or `csv`.
    #[param(inline, default = "json")]
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
    /// Numbers, truth values, texts; null where a run has none.
    #[schema(value_type = Vec<Vec<serde_json::Value>>)]
    rows: Vec<Vec<Value>>,
}

/// Compares runs: a row for each, with the requested numbers of its summary.
#[utoipa::path(get, path = "/api/v1/table", tag = "runs", operation_id = "compare_runs", params(TableQuery), responses(
    (status = 200, description = "the table; without `columns`, one row: the names of the columns of the latest runs", body = Table),
    (status = 400, description = "a query that is none", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn table(
    app: Shared,
    caller: Caller,
    query: Result<Query<TableQuery>, QueryRejection>,
) -> Result<Response, Problem> {
    let Query(query) = query?;
    let limit = query.limit.unwrap_or(MOST_ROWS);
    if !(1..=MOST_ROWS).contains(&limit) {
        return Err(Problem::bad_request(format!(
            "`limit` is {limit}; expected 1 to {MOST_ROWS}"
        )));
    }
    let filter = Filter {
        kind: Some(JobKind::Run),
        tenant: caller.tenant_filter(),
        status: Some(query.status.unwrap_or(Status::Done)),
        name: query.name.as_deref(),
        parent: query.parent.as_deref(),
        ..Filter::default()
    };
    let Some(columns) = &query.columns else {
        /// Names are collected from so many runs.
        const SAMPLE: i64 = 50;
        let jobs = app.database.list_metrics(&filter, SAMPLE.min(limit)).await?;
        let names: BTreeSet<String> = jobs
            .iter()
            .filter_map(|job| job.metrics.as_deref())
            .filter_map(|text| serde_json::from_str::<serde_json::Map<String, Value>>(text).ok())
            .flat_map(|metrics| metrics.into_iter().map(|(name, _)| name))
            .collect();
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

/// The wanted entries of a flat JSON object, in their order; null for what is not there. What is not wanted is skipped, not read: there are
/// hundreds of entries, thousands of times.
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
    use serde_json::json;

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
