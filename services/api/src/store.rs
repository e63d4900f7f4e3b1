//! Runs and events in the database: the only place with SQL.
//!
//! A run is claimed with a token. Whoever writes about a run that flies gives the token; a worker that was presumed dead, and whose run
//! was queued again, has a token that no longer fits, and its words change nothing.

use crate::clock::now_ms;
use serde::{Deserialize, Serialize};
use sqlx::any::{AnyPoolOptions, AnyRow};
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::{AnyPool, Row as _, SqlStr};
use std::time::Duration;
use utoipa::ToSchema;

/// How a run stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum RunStatus {
    /// Accepted; waits for a worker.
    Queued,
    /// A worker flies it.
    Running,
    /// All steps were flown.
    Done,
    /// It ended early; `error` says why.
    Failed,
    /// Somebody stopped it.
    Canceled,
}

impl RunStatus {
    /// As it stands in the database.
    pub(crate) const fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Canceled => "canceled",
        }
    }

    fn parse(text: &str) -> Self {
        match text {
            "queued" => Self::Queued,
            "running" => Self::Running,
            "done" => Self::Done,
            "canceled" => Self::Canceled,
            _ => Self::Failed,
        }
    }

    /// Nothing more will happen to it.
    pub(crate) const fn is_final(self) -> bool {
        matches!(self, Self::Done | Self::Failed | Self::Canceled)
    }
}

/// A run as the database has it.
#[derive(Debug, Clone)]
pub(crate) struct RunRow {
    /// Time-ordered.
    pub(crate) id: String,
    /// Of the scenario.
    pub(crate) name: String,
    /// Of the vehicle.
    pub(crate) vehicle: String,
    /// How it stands.
    pub(crate) status: RunStatus,
    /// Larger goes first.
    pub(crate) priority: i64,
    /// What is flown, in full (TOML).
    pub(crate) documents: String,
    /// Of all noise.
    pub(crate) seed: u64,
    /// `iceoryx2`, `zenoh`, `in-process`.
    pub(crate) link: String,
    /// `fast`, `real-time`.
    pub(crate) pace: String,
    /// The run that it was forked from.
    pub(crate) parent: Option<String>,
    /// Of the submitted body.
    pub(crate) request_hash: String,
    /// ms since 1970.
    pub(crate) submitted_ms: i64,
    /// First claim of the attempt that counts.
    pub(crate) started_ms: Option<i64>,
    /// End.
    pub(crate) finished_ms: Option<i64>,
    /// How often it was begun.
    pub(crate) attempts: i64,
    /// Somebody wants it stopped.
    pub(crate) cancel_requested: bool,
    /// Relative to the data folder.
    pub(crate) folder: Option<String>,
    /// Over all samples.
    pub(crate) run_hash: Option<String>,
    /// Why it failed.
    pub(crate) error: Option<String>,
    /// `summary.json`.
    pub(crate) summary: Option<String>,
}

/// What is known of a run when it is submitted.
#[derive(Debug, Clone)]
pub(crate) struct NewRun {
    /// Of the scenario.
    pub(crate) name: String,
    /// Of the vehicle.
    pub(crate) vehicle: String,
    /// Larger goes first.
    pub(crate) priority: i64,
    /// In full (TOML).
    pub(crate) documents: String,
    /// Of all noise.
    pub(crate) seed: u64,
    /// How the processes are connected.
    pub(crate) link: String,
    /// How fast.
    pub(crate) pace: String,
    /// The run that it is forked from.
    pub(crate) parent: Option<String>,
    /// The client's name for this submission.
    pub(crate) idempotency_key: Option<String>,
    /// Of the submitted body.
    pub(crate) request_hash: String,
}

/// One event of a run.
#[derive(Debug, Clone)]
pub(crate) struct EventRow {
    /// From 1, without gaps.
    pub(crate) seq: i64,
    /// What happened.
    pub(crate) kind: String,
    /// JSON.
    pub(crate) data: String,
}

/// What a worker says at the end.
#[derive(Debug, Clone)]
pub(crate) struct Outcome {
    /// A final status.
    pub(crate) status: RunStatus,
    /// Relative to the data folder.
    pub(crate) folder: String,
    /// Over all samples.
    pub(crate) run_hash: Option<String>,
    /// Why it failed.
    pub(crate) error: Option<String>,
    /// `summary.json`.
    pub(crate) summary: Option<String>,
}

/// Whether a submission made a run.
#[derive(Debug)]
pub(crate) enum Submitted {
    /// It did.
    New(RunRow),
    /// The same was submitted before under this key.
    Before(RunRow),
    /// Something else was.
    Other,
}

/// The database.
#[derive(Debug, Clone)]
pub(crate) struct Store {
    pool: AnyPool,
}

impl Store {
    /// Opens the database and brings it to the present schema.
    ///
    /// # Errors
    /// It cannot be opened or migrated.
    pub(crate) async fn open(url: &str) -> Result<Self, sqlx::Error> {
        sqlx::any::install_default_drivers();
        let pool = AnyPoolOptions::new()
            .max_connections(8)
            .acquire_timeout(Duration::from_secs(10))
            .after_connect(|connection, _| {
                Box::pin(async move {
                    use sqlx::Executor as _;
                    // An accepted run survives a power cut: FULL, not NORMAL.
                    let settings = "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA busy_timeout = 10000; \
                                    PRAGMA foreign_keys = ON;";
                    connection.execute(settings).await.map(|_| ())
                })
            })
            .connect(url)
            .await?;
        migrations()
            .run(&pool)
            .await
            .map_err(|error| sqlx::Error::Configuration(Box::new(error)))?;
        Ok(Self { pool })
    }

    /// Puts a run into the queue; it is on disk when this returns.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn submit(&self, new: NewRun) -> Result<Submitted, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let id = new_id();
        let inserted = sqlx::query(
            "INSERT INTO run (id, name, vehicle, status, priority, documents, seed, link, pace, parent, idempotency_key, \
             request_hash, submitted_ms) VALUES ($1, $2, $3, 'queued', $4, $5, $6, $7, $8, $9, $10, $11, $12) \
             ON CONFLICT (idempotency_key) DO NOTHING",
        )
        .bind(&id)
        .bind(new.name)
        .bind(new.vehicle)
        .bind(new.priority)
        .bind(new.documents)
        .bind(new.seed.to_string())
        .bind(new.link)
        .bind(new.pace)
        .bind(new.parent)
        .bind(&new.idempotency_key)
        .bind(&new.request_hash)
        .bind(now_ms())
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if inserted == 0 {
            let row = sqlx::query("SELECT * FROM run WHERE idempotency_key = $1")
                .bind(&new.idempotency_key)
                .fetch_one(&mut *transaction)
                .await?;
            let before = run_row(&row)?;
            return Ok(if before.request_hash == new.request_hash {
                Submitted::Before(before)
            } else {
                Submitted::Other
            });
        }
        append(&mut transaction, &id, "queued", "{}").await?;
        let row = sqlx::query("SELECT * FROM run WHERE id = $1")
            .bind(&id)
            .fetch_one(&mut *transaction)
            .await?;
        let row = run_row(&row)?;
        transaction.commit().await?;
        Ok(Submitted::New(row))
    }

    /// A run; `None`: there is none of this id.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn get(&self, id: &str) -> Result<Option<RunRow>, sqlx::Error> {
        let row = sqlx::query("SELECT * FROM run WHERE id = $1")
            .bind(id)
            .fetch_optional(&self.pool)
            .await?;
        row.as_ref().map(run_row).transpose()
    }

    /// Runs, latest first, older than `before`.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn list(
        &self,
        status: Option<RunStatus>,
        name: Option<&str>,
        before: Option<&str>,
        limit: i64,
    ) -> Result<Vec<RunRow>, sqlx::Error> {
        let rows = sqlx::query(
            "SELECT * FROM run WHERE ($1 = '' OR status = $1) AND ($2 = '' OR name = $2) AND ($3 = '' OR id < $3) \
             ORDER BY id DESC LIMIT $4",
        )
        .bind(status.map_or("", RunStatus::as_str))
        .bind(name.unwrap_or(""))
        .bind(before.unwrap_or(""))
        .bind(limit)
        .fetch_all(&self.pool)
        .await?;
        rows.iter().map(run_row).collect()
    }

    /// Number of runs of each status.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn count(&self) -> Result<Vec<(String, i64)>, sqlx::Error> {
        let rows = sqlx::query("SELECT status, COUNT(*) AS runs FROM run GROUP BY status ORDER BY status")
            .fetch_all(&self.pool)
            .await?;
        rows.iter()
            .map(|row| Ok((row.try_get("status")?, row.try_get("runs")?)))
            .collect()
    }

    /// Takes the most urgent queued run, if there is one; the token stands for the claim.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn claim(&self, lease: Duration) -> Result<Option<(RunRow, String)>, sqlx::Error> {
        let token = new_id();
        let mut transaction = self.pool.begin().await?;
        let row = sqlx::query(
            "UPDATE run SET status = 'running', claim = $1, claim_until_ms = $2, started_ms = $3, attempts = attempts + 1 \
             WHERE status = 'queued' AND id = \
             (SELECT id FROM run WHERE status = 'queued' ORDER BY priority DESC, id LIMIT 1) RETURNING *",
        )
        .bind(&token)
        .bind(now_ms() + lease.as_millis() as i64)
        .bind(now_ms())
        .fetch_optional(&mut *transaction)
        .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let row = run_row(&row)?;
        let data = serde_json::json!({ "attempt": row.attempts }).to_string();
        append(&mut transaction, &row.id, "started", &data).await?;
        transaction.commit().await?;
        Ok(Some((row, token)))
    }

    /// Says that the worker lives. `None`: the claim is lost; else whether somebody wants the run stopped.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn heartbeat(&self, id: &str, token: &str, lease: Duration) -> Result<Option<bool>, sqlx::Error> {
        let row =
            sqlx::query("UPDATE run SET claim_until_ms = $1 WHERE id = $2 AND claim = $3 RETURNING cancel_requested")
                .bind(now_ms() + lease.as_millis() as i64)
                .bind(id)
                .bind(token)
                .fetch_optional(&self.pool)
                .await?;
        row.map(|row| row.try_get::<i64, _>("cancel_requested").map(|wanted| wanted != 0))
            .transpose()
    }

    /// Adds an event of a claimed run; `false`: the claim is lost and nothing was added.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn event(&self, id: &str, token: &str, kind: &str, data: &str) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        // Writes first: two transactions that read before they write cannot both go on in SQLite.
        let held = sqlx::query("UPDATE run SET claim = claim WHERE id = $1 AND claim = $2")
            .bind(id)
            .bind(token)
            .execute(&mut *transaction)
            .await?
            .rows_affected();
        if held == 0 {
            return Ok(false);
        }
        append(&mut transaction, id, kind, data).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// Ends a claimed run; `false`: the claim is lost and nothing was written.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn finish(&self, id: &str, token: &str, outcome: &Outcome) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let written = sqlx::query(
            "UPDATE run SET status = $1, folder = $2, run_hash = $3, error = $4, summary = $5, finished_ms = $6, claim = NULL, \
             claim_until_ms = NULL WHERE id = $7 AND claim = $8",
        )
        .bind(outcome.status.as_str())
        .bind(&outcome.folder)
        .bind(&outcome.run_hash)
        .bind(&outcome.error)
        .bind(&outcome.summary)
        .bind(now_ms())
        .bind(id)
        .bind(token)
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if written == 0 {
            return Ok(false);
        }
        let data =
            serde_json::json!({ "status": outcome.status, "run_hash": outcome.run_hash, "error": outcome.error });
        append(&mut transaction, id, "ended", &data.to_string()).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// Puts a claimed run back into the queue; `false`: the claim is lost.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn release(&self, id: &str, token: &str, why: &str) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let written = sqlx::query(
            "UPDATE run SET status = 'queued', claim = NULL, claim_until_ms = NULL WHERE id = $1 AND claim = $2",
        )
        .bind(id)
        .bind(token)
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if written == 0 {
            return Ok(false);
        }
        let data = serde_json::json!({ "why": why }).to_string();
        append(&mut transaction, id, "requeued", &data).await?;
        transaction.commit().await?;
        Ok(true)
    }

    /// Queues again every run whose worker said nothing until `at_ms`; at the start of a server all of them (`i64::MAX`). Their ids.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn requeue_abandoned(&self, at_ms: i64) -> Result<Vec<String>, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let rows = sqlx::query(
            "UPDATE run SET status = 'queued', claim = NULL, claim_until_ms = NULL \
             WHERE status = 'running' AND claim_until_ms < $1 RETURNING id",
        )
        .bind(at_ms)
        .fetch_all(&mut *transaction)
        .await?;
        let mut ids = Vec::new();
        for row in rows {
            let id: String = row.try_get("id")?;
            append(&mut transaction, &id, "requeued", r#"{"why":"its worker is gone"}"#).await?;
            ids.push(id);
        }
        transaction.commit().await?;
        Ok(ids)
    }

    /// Wants a run stopped: a queued one is canceled at once, a running one is told to its worker. `None`: there is none.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn cancel(&self, id: &str) -> Result<Option<RunRow>, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let canceled = sqlx::query(
            "UPDATE run SET status = 'canceled', cancel_requested = 1, finished_ms = $1, error = 'canceled before it began' \
             WHERE id = $2 AND status = 'queued'",
        )
        .bind(now_ms())
        .bind(id)
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if canceled > 0 {
            append(&mut transaction, id, "ended", r#"{"status":"canceled"}"#).await?;
        } else {
            sqlx::query("UPDATE run SET cancel_requested = 1 WHERE id = $1 AND status = 'running'")
                .bind(id)
                .execute(&mut *transaction)
                .await?;
        }
        transaction.commit().await?;
        self.get(id).await
    }

    /// Deletes a run that has ended; `false`: it has not, or there is none.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn delete(&self, id: &str) -> Result<bool, sqlx::Error> {
        let deleted = sqlx::query("DELETE FROM run WHERE id = $1 AND status IN ('done', 'failed', 'canceled')")
            .bind(id)
            .execute(&self.pool)
            .await?
            .rows_affected();
        Ok(deleted > 0)
    }

    /// Events of a run after `seq`, in order, at most `limit`.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn events_after(&self, id: &str, seq: i64, limit: i64) -> Result<Vec<EventRow>, sqlx::Error> {
        let rows =
            sqlx::query("SELECT seq, kind, data FROM event WHERE run_id = $1 AND seq > $2 ORDER BY seq LIMIT $3")
                .bind(id)
                .bind(seq)
                .bind(limit)
                .fetch_all(&self.pool)
                .await?;
        rows.iter()
            .map(|row| {
                Ok(EventRow {
                    seq: row.try_get("seq")?,
                    kind: row.try_get("kind")?,
                    data: row.try_get("data")?,
                })
            })
            .collect()
    }

    /// Whether the database answers.
    ///
    /// # Errors
    /// It does not.
    pub(crate) async fn ping(&self) -> Result<(), sqlx::Error> {
        sqlx::query("SELECT 1").execute(&self.pool).await.map(|_| ())
    }

    /// Ends all connections.
    pub(crate) async fn close(&self) {
        self.pool.close().await;
    }
}

/// Every schema there has been, in order. A file that was released is never changed: another one follows it.
fn migrations() -> Migrator {
    let runs = SqlStr::from_static(include_str!("../migrations/0001_runs.sql"));
    Migrator::with_migrations(vec![Migration::new(
        1,
        "runs".into(),
        MigrationType::Simple,
        runs,
        false,
    )])
}

async fn append(
    transaction: &mut sqlx::Transaction<'_, sqlx::Any>,
    id: &str,
    kind: &str,
    data: &str,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "INSERT INTO event (run_id, seq, at_ms, kind, data) \
         SELECT $1, COALESCE(MAX(seq), 0) + 1, $2, $3, $4 FROM event WHERE run_id = $1",
    )
    .bind(id)
    .bind(now_ms())
    .bind(kind)
    .bind(data)
    .execute(&mut **transaction)
    .await
    .map(|_| ())
}

fn run_row(row: &AnyRow) -> Result<RunRow, sqlx::Error> {
    let seed: String = row.try_get("seed")?;
    let status: String = row.try_get("status")?;
    Ok(RunRow {
        id: row.try_get("id")?,
        name: row.try_get("name")?,
        vehicle: row.try_get("vehicle")?,
        status: RunStatus::parse(&status),
        priority: row.try_get("priority")?,
        documents: row.try_get("documents")?,
        seed: seed.parse().map_err(|error| sqlx::Error::Decode(Box::new(error)))?,
        link: row.try_get("link")?,
        pace: row.try_get("pace")?,
        parent: row.try_get("parent")?,
        request_hash: row.try_get("request_hash")?,
        submitted_ms: row.try_get("submitted_ms")?,
        started_ms: row.try_get("started_ms")?,
        finished_ms: row.try_get("finished_ms")?,
        attempts: row.try_get("attempts")?,
        cancel_requested: row.try_get::<i64, _>("cancel_requested")? != 0,
        folder: row.try_get("folder")?,
        run_hash: row.try_get("run_hash")?,
        error: row.try_get("error")?,
        summary: row.try_get("summary")?,
    })
}

/// 12 hex digits of ms, 20 random ones: later ids are larger.
fn new_id() -> String {
    format!("{:012x}{:020x}", now_ms(), rand::random::<u128>() & ((1 << 80) - 1))
}
