//! The queue: submit, claim, end.
//!
//! A job is claimed with a token. Writes about a running job must present the token; a worker that was presumed dead, and whose job was
//! queued again, has a stale token, and its writes are rejected.
//!
//! Statements write before they read: in SQLite, two transactions that read before writing cannot both proceed, and in Postgres the written
//! row stays locked until the end, so that events are numbered without gaps.

use super::table::{Transaction, WHOLE, job_of, metrics_of, shown, verdict_of};
use super::{Job, NewJob, Outcome};
use crate::clock::now_ms;
use crate::jobs::database::Database;
use rotortwin_jobs::{QueueEvent, QueueEventKind, Status};
use sqlx::Row as _;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

/// None of our leases or pauses ends later than 20 s from now. A later one was written before the database's clock was set back, and must not
/// be waited for: such a claim counts as abandoned (its worker, if alive, renews it every 250 ms), such a pause as over.
const DUE: &str = "(j.not_before_ms <= @NOW OR j.not_before_ms > @NOW + 20000)";
/// An expired claim, or one from before the clock was set back ([`DUE`]).
///
/// A part handed to an external cluster ([`HANDED_OVER`]) keeps running there while its server is down, and that server takes it up again:
/// for ten minutes no other server does.
const ABANDONED: &str = "AND ((claim_until_ms < @NOW AND NOT (@HANDED_OVER AND claim_until_ms >= @NOW - 600000)) \
     OR claim_until_ms > @NOW + 20000)";
/// Parts whose attempt has a ticket, with which a node of an external cluster delivers.
const HANDED_OVER: &str = "(kind IN ('campaign-shard', 'blind-bench-shard') AND ticket IS NOT NULL)";

/// Which jobs a worker takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Takes {
    /// Any.
    All,
    /// Parts of other jobs.
    Parts,
    /// All but parts.
    AllButParts,
}

impl Takes {
    fn condition(self) -> &'static str {
        match self {
            Self::All => "",
            Self::Parts => "AND j.part_of IS NOT NULL",
            Self::AllButParts => "AND j.part_of IS NULL",
        }
    }
}

/// Which running jobs are queued again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Left {
    /// Those whose worker's lease has expired.
    Abandoned,
    /// All, because no other process can hold them.
    All,
    /// All except those running in an external cluster.
    AllButHandedOver,
}

impl Left {
    fn condition(self) -> String {
        match self {
            Self::Abandoned => ABANDONED.replace("@HANDED_OVER", HANDED_OVER),
            Self::All => String::new(),
            Self::AllButHandedOver => format!("AND NOT {HANDED_OVER}"),
        }
    }
}

/// Result of a submission.
#[derive(Debug)]
pub(crate) enum Submitted {
    /// A new job.
    New(Box<Job>),
    /// A duplicate submission under this key.
    Before(Box<Job>),
    /// A different submission exists under this key.
    Other,
    /// It reads the files of this job, which has been deleted meanwhile.
    InputGone(String),
}

/// Result of a deletion.
#[derive(Debug)]
pub(crate) enum Deleted {
    /// It and its parts were deleted; all their ids.
    Gone(Vec<String>),
    /// It has not ended, or does not exist.
    NotEnded,
    /// Its files are needed by this waiting or running job.
    Needed(Box<Job>),
}

/// Default limit of concurrently running jobs per tenant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FairShare {
    /// Maximum number of concurrently running jobs of one tenant.
    pub(crate) most_running: i64,
}

impl Database {
    /// Queues a job and its parts; they are durable when this returns.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn submit(&self, new: &NewJob) -> Result<Submitted, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let id = new_id();
        if !self.insert(&mut transaction, &id, new, None).await? {
            let text = format!("SELECT {WHOLE} FROM job WHERE tenant = $1 AND kind = $2 AND idempotency_key = $3");
            let row = sqlx::query(self.sql(&text))
                .bind(&new.tenant)
                .bind(new.kind.as_str())
                .bind(&new.idempotency_key)
                .fetch_one(&mut *transaction)
                .await?;
            let before = shown(&row)?;
            return Ok(if before.new.request_hash == new.request_hash {
                Submitted::Before(Box::new(before))
            } else {
                Submitted::Other
            });
        }
        for part in &new.parts {
            self.insert(&mut transaction, &new_id(), part, Some(&id)).await?;
        }
        // Inputs of a part are needed until the whole job has ended. In order, so that two submissions do not deadlock.
        let needs: BTreeSet<&String> = new
            .parts
            .iter()
            .flat_map(|part| &part.needs)
            .chain(&new.needs)
            .collect();
        for needed in needs {
            if !note_need(&mut transaction, &id, needed).await? {
                return Ok(Submitted::InputGone(needed.clone()));
            }
        }
        self.tell(&mut transaction, "").await?;
        let row = sqlx::query("SELECT * FROM job WHERE id = $1")
            .bind(&id)
            .fetch_one(&mut *transaction)
            .await?;
        let job = job_of(&row)?;
        transaction.commit().await?;
        for _ in 0..=new.parts.len() {
            self.hub.queue.notify_one();
        }
        Ok(Submitted::New(Box::new(job)))
    }

    /// `false`: one exists under this key.
    async fn insert(
        &self,
        transaction: &mut Transaction,
        id: &str,
        new: &NewJob,
        part_of: Option<&str>,
    ) -> Result<bool, sqlx::Error> {
        let inserted = sqlx::query(self.sql(
            "INSERT INTO job (id, kind, name, tenant, status, priority, spec, facts, parent, part_of, waits_for, idempotency_key, \
             request_hash, submitted_ms, wall_limit_ms, autopilot, upload_bytes, bytes) \
             VALUES ($1, $2, $3, $4, 'queued', $5, $6, $7, $8, $9, $10, $11, $12, @NOW, $13, $14, $15, $16) \
             ON CONFLICT (tenant, kind, idempotency_key) DO NOTHING",
        ))
        .bind(id)
        .bind(new.kind.as_str())
        .bind(&new.name)
        .bind(&new.tenant)
        .bind(new.priority)
        .bind(&new.spec)
        .bind(&new.facts)
        .bind(&new.parent)
        .bind(part_of)
        .bind(new.parts.len() as i64)
        .bind(&new.idempotency_key)
        .bind(&new.request_hash)
        .bind(new.wall_limit_ms)
        .bind(&new.autopilot)
        .bind(new.upload_bytes)
        .bind(new.upload_bytes)
        .execute(&mut **transaction)
        .await?
        .rows_affected();
        if inserted > 0 {
            self.note(transaction, id, &QueueEvent::Queued {}).await?;
        }
        Ok(inserted > 0)
    }

    /// Claims a queued job, if any: of the tenant with the fewest running jobs, then the highest priority, then the oldest. A job flown by an
    /// autopilot is only claimed by the worker that lists it, while no other run uses it. The token identifies the claim.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn claim(
        &self,
        worker: &str,
        lease: Duration,
        share: FairShare,
        takes: Takes,
    ) -> Result<Option<(Job, String)>, sqlx::Error> {
        let token = new_id();
        let mut transaction = self.pool.begin().await?;
        let row = sqlx::query(self.sql(
            "UPDATE job SET status = 'running', claim = $1, claim_until_ms = @NOW + $2, started_ms = @NOW, attempts = attempts + 1, \
             worker = $3 WHERE status = 'queued' AND id = (SELECT j.id FROM job j LEFT JOIN \
               (SELECT tenant, COUNT(*) AS running FROM job WHERE status = 'running' GROUP BY tenant) r ON r.tenant = j.tenant \
               WHERE j.status = 'queued' AND j.waits_for = 0 @TAKES AND @DUE AND COALESCE(r.running, 0) < $4 \
               AND (j.autopilot IS NULL OR (\
                 EXISTS (SELECT 1 FROM autopilot a WHERE a.name = j.autopilot AND a.worker = $5 AND a.until_ms > @NOW) \
                 AND NOT EXISTS (SELECT 1 FROM job b WHERE b.status = 'running' AND b.autopilot = j.autopilot))) \
               ORDER BY COALESCE(r.running, 0), j.priority DESC, j.id LIMIT 1 @SKIP) RETURNING *"
                .replace("@DUE", DUE)
                .replace("@TAKES", takes.condition())
                .as_str(),
        ))
        .bind(&token)
        .bind(lease.as_millis() as i64)
        .bind(worker)
        .bind(share.most_running)
        .bind(worker)
        .fetch_optional(&mut *transaction)
        .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let job = job_of(&row)?;
        if let Some(autopilot) = &job.new.autopilot
            && !self.has_alone(&mut transaction, autopilot, &job.id).await?
        {
            // Another worker was faster; the claim is rolled back.
            return Ok(None);
        }
        let started = QueueEvent::Started {
            attempt: Some(job.attempts),
            name: None,
            part: None,
            worker: Some(worker.to_owned()),
        };
        self.note(&mut transaction, &job.id, &started).await?;
        transaction.commit().await?;
        self.hub.wake(&job.id);
        if let Some(whole) = &job.part_of
            && let Err(error) = self.part_started(whole, &job).await
        {
            tracing::warn!(job = whole, %error, "the start of its first part cannot be written; the next part does it");
        }
        Ok(Some((job, token)))
    }

    /// Shows watchers of a job in parts that it runs ([`Self::note_start_of_whole`]).
    ///
    /// A separate transaction, for the reason given at [`Self::event_of_whole`].
    async fn part_started(&self, whole: &str, part: &Job) -> Result<(), sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let waits = sqlx::query("UPDATE job SET waits_for = waits_for WHERE id = $1 AND status = 'queued'")
            .bind(whole)
            .execute(&mut *transaction)
            .await?
            .rows_affected();
        if waits == 0 || !self.note_start_of_whole(&mut transaction, whole, part).await? {
            return Ok(());
        }
        transaction.commit().await?;
        self.hub.wake(whole);
        Ok(())
    }

    /// Adds `started` to the job that waits for this part, whose row the transaction has locked; `false`: another part was the first.
    async fn note_start_of_whole(
        &self,
        transaction: &mut Transaction,
        whole: &str,
        part: &Job,
    ) -> Result<bool, sqlx::Error> {
        let before = sqlx::query("SELECT 1 FROM job_event WHERE job_id = $1 AND kind = $2 LIMIT 1")
            .bind(whole)
            .bind(QueueEventKind::Started.as_str())
            .fetch_optional(&mut **transaction)
            .await?;
        if before.is_some() {
            return Ok(false);
        }
        let started = QueueEvent::Started {
            attempt: None,
            name: Some(part.new.name.clone()),
            part: Some(part.id.clone()),
            worker: part.worker.clone(),
        };
        self.note(transaction, whole, &started).await?;
        Ok(true)
    }

    /// Renews the claim. `None`: the claim is lost; otherwise whether cancellation was requested.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn heartbeat(&self, id: &str, token: &str, lease: Duration) -> Result<Option<bool>, sqlx::Error> {
        let row =
            sqlx::query(self.sql(
                "UPDATE job SET claim_until_ms = @NOW + $1 WHERE id = $2 AND claim = $3 RETURNING cancel_requested",
            ))
            .bind(lease.as_millis() as i64)
            .bind(id)
            .bind(token)
            .fetch_optional(&self.pool)
            .await?;
        row.map(|row| row.try_get::<i64, _>("cancel_requested").map(|wanted| wanted != 0))
            .transpose()
    }

    /// Adds an event of a claimed job; `false`: the claim is lost and nothing was added.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn event(&self, id: &str, token: &str, kind: &str, data: &str) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        if !holds(&mut transaction, id, token).await? {
            return Ok(false);
        }
        self.append(&mut transaction, id, kind, data).await?;
        transaction.commit().await?;
        self.hub.wake(id);
        Ok(true)
    }

    /// Adds an event of a claimed part to the job that waits for it; ignored if the claim is lost or that job has ended.
    ///
    /// A separate transaction that locks only the whole job's row: if it locked the part's too, it would deadlock with a cancellation that
    /// locks the whole and waits for the part.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn event_of_whole(
        &self,
        part: &str,
        token: &str,
        whole: &str,
        kind: &str,
        data: &str,
    ) -> Result<(), sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let waits = sqlx::query(
            "UPDATE job SET waits_for = waits_for WHERE id = $1 AND status = 'queued' \
             AND EXISTS (SELECT 1 FROM job p WHERE p.id = $2 AND p.claim = $3)",
        )
        .bind(whole)
        .bind(part)
        .bind(token)
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if waits == 0 {
            return Ok(());
        }
        self.append(&mut transaction, whole, kind, data).await?;
        transaction.commit().await?;
        self.hub.wake(whole);
        Ok(())
    }

    /// Stores how external peers join a claimed run; `false`: the claim is lost.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn set_ticket(&self, id: &str, token: &str, ticket: Option<&str>) -> Result<bool, sqlx::Error> {
        let written = sqlx::query("UPDATE job SET ticket = $1 WHERE id = $2 AND claim = $3")
            .bind(ticket)
            .bind(id)
            .bind(token)
            .execute(&self.pool)
            .await?
            .rows_affected();
        Ok(written > 0)
    }

    /// Ends a claimed job; `false`: the claim is lost and nothing was written.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn finish(&self, id: &str, token: &str, outcome: &Outcome) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let row = sqlx::query(self.sql(
            "UPDATE job SET status = $1, folder = $2, bytes = upload_bytes + $3, run_hash = $4, error = $5, result = $6, metrics = $7, \
             verdict = CASE kind WHEN 'run' THEN $8 END, finished_ms = @NOW, claim = NULL, claim_until_ms = NULL, ticket = NULL \
             WHERE id = $9 AND claim = $10 RETURNING *",
        ))
        .bind(outcome.status.as_str())
        .bind(&outcome.folder)
        .bind(outcome.bytes)
        .bind(&outcome.run_hash)
        .bind(&outcome.error)
        .bind(&outcome.result)
        .bind(outcome.result.as_deref().and_then(metrics_of))
        .bind(outcome.result.as_deref().and_then(verdict_of))
        .bind(id)
        .bind(token)
        .fetch_optional(&mut *transaction)
        .await?;
        let Some(row) = row else {
            return Ok(false);
        };
        let job = job_of(&row)?;
        self.note(&mut transaction, id, &ended(&job)).await?;
        let mut others = vec![id.to_owned()];
        if let Some(whole) = &job.part_of {
            others.extend(self.part_ended(&mut transaction, whole, &job).await?);
        }
        self.tell(&mut transaction, "").await?;
        transaction.commit().await?;
        for id in others {
            self.hub.wake(&id);
        }
        self.hub.queue.notify_one();
        Ok(true)
    }

    /// The whole job can start, or fails with its part; returns the jobs affected.
    async fn part_ended(
        &self,
        transaction: &mut Transaction,
        whole: &str,
        part: &Job,
    ) -> Result<Vec<String>, sqlx::Error> {
        if part.status == Status::Done {
            sqlx::query("UPDATE job SET waits_for = waits_for - 1 WHERE id = $1")
                .bind(whole)
                .execute(&mut **transaction)
                .await?;
            // Unless the database was away when the part was claimed, this is written already.
            self.note_start_of_whole(transaction, whole, part).await?;
            let done = QueueEvent::Part {
                name: part.new.name.clone(),
                part: part.id.clone(),
            };
            self.note(transaction, whole, &done).await?;
            return Ok(vec![whole.to_owned()]);
        }
        let why = format!(
            "its part {} ({}) {}: {}",
            part.new.name,
            part.id,
            if part.status == Status::Canceled {
                "was canceled"
            } else {
                "failed"
            },
            part.error.as_deref().unwrap_or("no reason is known")
        );
        let mut others = Vec::new();
        let row = sqlx::query(self.sql(
            "UPDATE job SET status = $1, error = $2, finished_ms = @NOW WHERE id = $3 AND status = 'queued' RETURNING *",
        ))
        .bind(part.status.as_str())
        .bind(&why)
        .bind(whole)
        .fetch_optional(&mut **transaction)
        .await?;
        if let Some(row) = row {
            self.note(transaction, whole, &ended(&job_of(&row)?)).await?;
            others.push(whole.to_owned());
            others.extend(self.cancel_parts(transaction, whole).await?);
        }
        Ok(others)
    }

    async fn cancel_parts(&self, transaction: &mut Transaction, whole: &str) -> Result<Vec<String>, sqlx::Error> {
        sqlx::query("UPDATE job SET cancel_requested = 1 WHERE part_of = $1 AND status IN ('queued', 'running')")
            .bind(whole)
            .execute(&mut **transaction)
            .await?;
        let rows = sqlx::query(self.sql(
            "UPDATE job SET status = 'canceled', finished_ms = @NOW, error = 'canceled with the whole' \
             WHERE part_of = $1 AND status = 'queued' RETURNING *",
        ))
        .bind(whole)
        .fetch_all(&mut **transaction)
        .await?;
        let mut ids = Vec::new();
        for row in rows {
            let job = job_of(&row)?;
            self.note(transaction, &job.id, &ended(&job)).await?;
            ids.push(job.id);
        }
        Ok(ids)
    }

    /// Returns a claimed job to the queue: it `failed` and is retried after a pause, or its worker is shutting down and another one starts it
    /// at once. `false`: the claim is lost.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn release(
        &self,
        id: &str,
        token: &str,
        why: &str,
        failed: Option<Duration>,
    ) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let written = sqlx::query(self.sql(
            "UPDATE job SET status = 'queued', claim = NULL, claim_until_ms = NULL, ticket = NULL, not_before_ms = @NOW + $1, \
             failures = failures + $2 WHERE id = $3 AND claim = $4",
        ))
        .bind(failed.unwrap_or_default().as_millis() as i64)
        .bind(i64::from(failed.is_some()))
        .bind(id)
        .bind(token)
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if written == 0 {
            return Ok(false);
        }
        let requeued = QueueEvent::Requeued { why: why.to_owned() };
        self.note(&mut transaction, id, &requeued).await?;
        self.tell(&mut transaction, "").await?;
        transaction.commit().await?;
        self.hub.wake(id);
        self.hub.queue.notify_one();
        Ok(true)
    }

    /// Queues every job of [`Left`] again. A job that was started `attempts` times has most likely killed its workers: it fails. Returns
    /// their ids and what they are now.
    ///
    /// Each in a separate transaction, and locked rows are left for the next time: a host that vanished during a transaction holds its rows
    /// until the database notices, which must not delay other jobs.
    ///
    /// # Errors
    /// The database; for a single job only if none could be queued.
    pub(crate) async fn requeue_abandoned(
        &self,
        left: Left,
        attempts: i64,
    ) -> Result<Vec<(String, Status)>, sqlx::Error> {
        let rows = sqlx::query(self.sql(&format!(
            "SELECT id FROM job WHERE status = 'running' {} ORDER BY id",
            left.condition()
        )))
        .fetch_all(&self.pool)
        .await?;
        let (mut ids, mut refused) = (Vec::new(), None);
        for row in rows {
            let id: String = row.try_get("id")?;
            match self.requeue_one(&id, left, attempts).await {
                Ok(Some(status)) => ids.push((id, status)),
                Ok(None) => {}
                Err(error) => {
                    tracing::warn!(job = id, %error, "an abandoned job cannot be queued now; trying again later");
                    refused = Some(error);
                }
            }
        }
        match refused {
            Some(error) if ids.is_empty() => Err(error),
            _ => Ok(ids),
        }
    }

    /// `false`: another process holds it, or has locked its row.
    async fn requeue_one(&self, id: &str, left: Left, attempts: i64) -> Result<Option<Status>, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let row = sqlx::query(self.sql(
            "UPDATE job SET status = CASE WHEN cancel_requested = 1 THEN 'canceled' WHEN attempts >= $1 THEN 'failed' ELSE 'queued' END, \
             error = CASE WHEN cancel_requested = 1 THEN 'canceled; its worker was gone' WHEN attempts >= $2 THEN \
               'its worker was gone at every attempt' ELSE error END, \
             finished_ms = CASE WHEN cancel_requested = 1 OR attempts >= $3 THEN @NOW ELSE NULL END, \
             claim = NULL, claim_until_ms = NULL, ticket = NULL \
             WHERE id = (SELECT j.id FROM job j WHERE j.id = $4 AND j.status = 'running' \
               @ABANDONED @SKIP) RETURNING *"
                .replace("@ABANDONED", &left.condition())
                .as_str(),
        ))
        .bind(attempts)
        .bind(attempts)
        .bind(attempts)
        .bind(id)
        .fetch_optional(&mut *transaction)
        .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let job = job_of(&row)?;
        let mut others = Vec::new();
        if job.status.is_final() {
            self.note(&mut transaction, id, &ended(&job)).await?;
            if let Some(whole) = &job.part_of {
                others.extend(self.part_ended(&mut transaction, whole, &job).await?);
            }
        } else {
            let requeued = QueueEvent::Requeued {
                why: "its worker is gone".to_owned(),
            };
            self.note(&mut transaction, id, &requeued).await?;
        }
        self.tell(&mut transaction, "").await?;
        transaction.commit().await?;
        self.hub.wake(id);
        for id in others {
            self.hub.wake(&id);
        }
        self.hub.queue.notify_one();
        Ok(Some(job.status))
    }

    /// Requests cancellation: a queued job is cancelled at once with its parts, a running one through its worker. `None`: unknown job.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn cancel(&self, id: &str) -> Result<Option<Job>, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let row = sqlx::query(self.sql(
            "UPDATE job SET status = 'canceled', cancel_requested = 1, finished_ms = @NOW, \
             error = CASE WHEN EXISTS (SELECT 1 FROM job AS part WHERE part.part_of = job.id AND part.started_ms IS NOT NULL) \
             THEN 'canceled while its parts were computed; what they had is not put together' \
             ELSE 'canceled before it began' END \
             WHERE id = $1 AND status = 'queued' RETURNING *",
        ))
        .bind(id)
        .fetch_optional(&mut *transaction)
        .await?;
        let mut others = Vec::new();
        if let Some(row) = row {
            let job = job_of(&row)?;
            self.note(&mut transaction, id, &ended(&job)).await?;
            others = self.cancel_parts(&mut transaction, id).await?;
            if let Some(whole) = &job.part_of {
                others.extend(self.part_ended(&mut transaction, whole, &job).await?);
            }
        } else {
            sqlx::query("UPDATE job SET cancel_requested = 1 WHERE id = $1 AND status = 'running'")
                .bind(id)
                .execute(&mut *transaction)
                .await?;
            self.tell(&mut transaction, id).await?;
        }
        transaction.commit().await?;
        self.hub.wake(id);
        for id in others {
            self.hub.wake(&id);
        }
        self.get(id).await
    }

    /// Deletes a job that has ended, and its parts, unless a waiting or running job reads its files.
    ///
    /// A submission of such a job locks the row of this one ([`note_need`]), as this does: one of the two comes first, and the other sees its
    /// effect.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn delete(&self, id: &str) -> Result<Deleted, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let held =
            sqlx::query("UPDATE job SET claim = claim WHERE id = $1 AND status IN ('done', 'failed', 'canceled')")
                .bind(id)
                .execute(&mut *transaction)
                .await?
                .rows_affected();
        if held == 0 {
            return Ok(Deleted::NotEnded);
        }
        let row = sqlx::query(
            "SELECT j.* FROM job_need n JOIN job j ON j.id = n.job_id \
             WHERE n.needs = $1 AND j.status IN ('queued', 'running') ORDER BY j.id LIMIT 1",
        )
        .bind(id)
        .fetch_optional(&mut *transaction)
        .await?;
        if let Some(row) = row {
            return Ok(Deleted::Needed(Box::new(job_of(&row)?)));
        }
        let rows = sqlx::query("DELETE FROM job WHERE id = $1 OR part_of = $2 RETURNING id")
            .bind(id)
            .bind(id)
            .fetch_all(&mut *transaction)
            .await?;
        let ids = rows
            .iter()
            .map(|row| row.try_get("id"))
            .collect::<Result<Vec<String>, _>>()?;
        self.tell(&mut transaction, id).await?;
        transaction.commit().await?;
        self.hub.wake(id);
        Ok(Deleted::Gone(ids))
    }
}

/// Records that a job reads the files of another one, whose row is locked until the transaction ends; `false`: that one is gone.
async fn note_need(transaction: &mut Transaction, id: &str, needed: &str) -> Result<bool, sqlx::Error> {
    let held = sqlx::query("UPDATE job SET claim = claim WHERE id = $1")
        .bind(needed)
        .execute(&mut **transaction)
        .await?
        .rows_affected();
    if held == 0 {
        return Ok(false);
    }
    sqlx::query("INSERT INTO job_need (job_id, needs) VALUES ($1, $2)")
        .bind(id)
        .bind(needed)
        .execute(&mut **transaction)
        .await?;
    Ok(true)
}

/// Whether the claim is still valid; the row is locked until the transaction ends.
pub(super) async fn holds(transaction: &mut Transaction, id: &str, token: &str) -> Result<bool, sqlx::Error> {
    let held = sqlx::query("UPDATE job SET claim = claim WHERE id = $1 AND claim = $2")
        .bind(id)
        .bind(token)
        .execute(&mut **transaction)
        .await?
        .rows_affected();
    Ok(held > 0)
}

fn ended(job: &Job) -> QueueEvent {
    QueueEvent::Ended {
        error: job.error.clone(),
        run_hash: job.run_hash.clone(),
        status: job.status,
    }
}

/// 12 hex digits of ms, 20 random ones: ids increase with time, also where the clock is set back.
pub(crate) fn new_id() -> String {
    static LAST_MS: AtomicI64 = AtomicI64::new(0);
    let now = now_ms();
    let ms = LAST_MS.fetch_max(now, Ordering::Relaxed).max(now);
    format!("{ms:012x}{:020x}", rand::random::<u128>() & ((1 << 80) - 1))
}
