//! Rows of the job table, and the events that accompany their updates.

use super::{Job, NewJob};
use crate::jobs::database::Database;
use rotortwin_jobs::{JobKind, QueueEvent, Status};
use sqlx::Row as _;
use sqlx::any::AnyRow;

/// Columns for lists: without specification and result, which are long.
pub(super) const SHORT: &str = "id, kind, name, tenant, status, priority, '' AS spec, facts, parent, part_of, waits_for, idempotency_key, \
     request_hash, submitted_ms, started_ms, finished_ms, attempts, failures, wall_limit_ms, worker, cancel_requested, NULL AS ticket, folder, \
     bytes, run_hash, error, NULL AS result, NULL AS metrics, autopilot, upload_bytes, \
     verdict, @BEGUN AS begun_ms";

/// Columns of a whole row, for readers.
pub(super) const WHOLE: &str = "job.*, @BEGUN AS begun_ms";

pub(super) use super::timed::Transaction;

pub(super) fn job_of(row: &AnyRow) -> Result<Job, sqlx::Error> {
    let (kind, status): (String, String) = (row.try_get("kind")?, row.try_get("status")?);
    let unknown = || sqlx::Error::Decode(format!("this version does not know jobs of kind '{kind}'").into());
    Ok(Job {
        id: row.try_get("id")?,
        status: Status::parse(&status),
        new: NewJob {
            kind: JobKind::parse(&kind).ok_or_else(unknown)?,
            name: row.try_get("name")?,
            tenant: row.try_get("tenant")?,
            priority: row.try_get("priority")?,
            spec: row.try_get("spec")?,
            facts: row.try_get("facts")?,
            parent: row.try_get("parent")?,
            idempotency_key: row.try_get("idempotency_key")?,
            request_hash: row.try_get("request_hash")?,
            wall_limit_ms: row.try_get("wall_limit_ms")?,
            autopilot: row.try_get("autopilot")?,
            needs: Vec::new(),
            upload_bytes: row.try_get("upload_bytes")?,
            parts: Vec::new(),
        },
        part_of: row.try_get("part_of")?,
        waits_for: row.try_get("waits_for")?,
        submitted_ms: row.try_get("submitted_ms")?,
        started_ms: row.try_get("started_ms")?,
        finished_ms: row.try_get("finished_ms")?,
        attempts: row.try_get("attempts")?,
        failures: row.try_get("failures")?,
        worker: row.try_get("worker")?,
        cancel_requested: row.try_get::<i64, _>("cancel_requested")? != 0,
        ticket: row.try_get("ticket")?,
        folder: row.try_get("folder")?,
        bytes: row.try_get("bytes")?,
        run_hash: row.try_get("run_hash")?,
        error: row.try_get("error")?,
        result: row.try_get("result")?,
        metrics: row.try_get("metrics")?,
        verdict: row
            .try_get::<Option<i64>, _>("verdict")?
            .and_then(|code| i32::try_from(code).ok()),
    })
}

/// As [`job_of`], for readers: a job in parts runs from the start of its first part, although nobody has claimed the job itself.
pub(super) fn shown(row: &AnyRow) -> Result<Job, sqlx::Error> {
    let mut job = job_of(row)?;
    if let Some(begun_ms) = row.try_get::<Option<i64>, _>("begun_ms")? {
        job.started_ms = Some(begun_ms);
        if job.status == Status::Queued {
            job.status = Status::Running;
        }
    }
    Ok(job)
}

impl Database {
    /// Adds an event of the queue itself, as [`append`](Self::append).
    pub(super) async fn note(
        &self,
        transaction: &mut Transaction,
        id: &str,
        event: &QueueEvent,
    ) -> Result<(), sqlx::Error> {
        let data = event.data().map_err(|error| sqlx::Error::Encode(error.into()))?;
        self.append(transaction, id, event.kind().as_str(), &data).await
    }

    /// Adds an event to a job whose row this transaction has written and therefore locked: numbers have no gaps.
    pub(super) async fn append(
        &self,
        transaction: &mut Transaction,
        id: &str,
        kind: &str,
        data: &str,
    ) -> Result<(), sqlx::Error> {
        sqlx::query(self.sql(
            "INSERT INTO job_event (job_id, seq, at_ms, kind, data) \
             SELECT $1, COALESCE(MAX(seq), 0) + 1, @NOW, $2, $3 FROM job_event WHERE job_id = $4",
        ))
        .bind(id)
        .bind(kind)
        .bind(data)
        .bind(id)
        .execute(&mut **transaction)
        .await?;
        self.tell(transaction, id).await
    }
}

/// Final verdict of the sequential detector, from the result of a run; the migration that added the column does the same in SQL.
pub(super) fn verdict_of(result: &str) -> Option<i64> {
    let result: serde_json::Value = serde_json::from_str(result).ok()?;
    let last = result["intervals"].as_array()?.last()?;
    last["scores"]["sequential"]["verdict_at_end"].as_i64()
}

/// The numbers, booleans and short texts of a result, flattened: `detectors.sequential.delay_s`.
pub(super) fn metrics_of(result: &str) -> Option<String> {
    /// Maximum number kept.
    const MOST: usize = 400;
    fn walk(path: &str, value: &serde_json::Value, into: &mut serde_json::Map<String, serde_json::Value>) {
        use serde_json::Value;
        if into.len() >= MOST {
            return;
        }
        match value {
            Value::Object(entries) => {
                for (key, value) in entries {
                    let path = if path.is_empty() {
                        key.clone()
                    } else {
                        format!("{path}.{key}")
                    };
                    walk(&path, value, into);
                }
            }
            Value::Array(values) if values.len() <= 16 => {
                for (index, value) in values.iter().enumerate() {
                    walk(&format!("{path}.{index}"), value, into);
                }
            }
            Value::Number(_) | Value::Bool(_) => {
                into.insert(path.to_owned(), value.clone());
            }
            Value::String(text) if text.len() <= 64 => {
                into.insert(path.to_owned(), value.clone());
            }
            Value::Null | Value::Array(_) | Value::String(_) => {}
        }
    }
    let value = serde_json::from_str(result).ok()?;
    let mut flat = serde_json::Map::new();
    walk("", &value, &mut flat);
    serde_json::to_string(&flat).ok()
}
