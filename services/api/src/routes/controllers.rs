//! Controllers compared: runs of one scenario with different controllers, one row each.

use super::jobs::Shared;
use super::telemetry::{blocking, file_of, names};
use crate::access::Caller;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query};
use rotortwin_store::Summary;
use rotortwin_store::controllers::{ControllerRow, WITHIN_M, differences};
use rotortwin_store::files::TELEMETRY_FILE;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Rows of one table.
const MOST_RUNS: usize = 100;

/// Which runs.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct ComparedRuns {
    /// Comma-separated ids, at most 100.
    runs: String,
    /// A vehicle has recovered from a fault when it stays this close to its reference, m; default 0.5.
    #[param(exclusive_minimum = 0)]
    within_m: Option<f64>,
}

/// Controllers compared, one row per run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ComparedControllers {
    /// Bound that defines recovery, m.
    within_m: f64,
    /// In the order in which the runs were named.
    rows: Vec<ControllerRow>,
    /// How the runs differ apart from their controllers, one sentence each; empty: they can be compared.
    differences: Vec<String>,
}

/// Compares controllers on runs that have ended: tracking, energy, response to the fault, and its detection. The same numbers as
/// `rotortwin controllers`.
#[utoipa::path(get, path = "/api/v1/controllers", tag = "runs", operation_id = "compare_controllers", params(ComparedRuns), responses(
    (status = 200, description = "the table", body = ComparedControllers),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found, or its files were deleted", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "one of the runs has not ended", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "too many runs, or invalid bound", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn compare(
    app: Shared,
    caller: Caller,
    query: Result<Query<ComparedRuns>, QueryRejection>,
) -> Result<Json<ComparedControllers>, Problem> {
    let Query(query) = query?;
    let within_m = query.within_m.unwrap_or(WITHIN_M);
    if !(within_m > 0.0 && within_m.is_finite()) {
        return Err(Problem::unprocessable(format!(
            "`within_m` is {within_m}; expected a distance above 0 m"
        )));
    }
    let ids = names(&query.runs);
    if ids.is_empty() || ids.len() > MOST_RUNS {
        return Err(Problem::unprocessable(format!(
            "`runs` names {} runs; expected 1 to {MOST_RUNS}",
            ids.len()
        )));
    }
    let mut runs = Vec::with_capacity(ids.len());
    for id in ids {
        let run = super::runs::find(&app, &caller, Ok(Path(id))).await?;
        let summary = run
            .result
            .as_deref()
            .and_then(|text| serde_json::from_str::<Summary>(text).ok());
        let Some(summary) = summary else {
            return Err(if run.status.is_final() {
                Problem::not_found(format!("run {} ended without a summary", run.id))
            } else {
                Problem::conflict(format!(
                    "run {} is {}; expected one that has ended",
                    run.id,
                    run.status.as_str()
                ))
            });
        };
        let telemetry = match summary.steps {
            0 => None,
            _ => Some(file_of(&app, &run, TELEMETRY_FILE).await?),
        };
        runs.push((run.id, summary, telemetry));
    }
    let rows = blocking(move || {
        runs.into_iter()
            .map(|(id, summary, telemetry)| ControllerRow::new(id, &summary, telemetry.as_deref(), within_m))
            .collect::<Result<Vec<_>, _>>()
    });
    let rows = rows.await?;
    Ok(Json(ComparedControllers {
        within_m,
        differences: differences(&rows),
        rows,
    }))
}
