//! Parts executed by an external cluster: supervision and delivery.
//!
//! Such an attempt has two secrets. Its claim belongs to the supervising server, as for every job; another server takes over with a new
//! claim when that one is gone. Its ticket belongs to the node: it is valid for the whole attempt, so that a node can deliver whoever
//! supervises it, and becomes invalid once the attempt has ended, for any reason.

use super::Job;
use super::database::Database;
use super::queue::new_id;
use super::table::job_of;
use sqlx::Row as _;
use std::time::Duration;

/// Attempts with a ticket.
const HANDED_OVER: &str =
    "j.status = 'running' AND j.kind IN ('campaign-shard', 'blind-bench-shard') AND j.ticket IS NOT NULL";

impl Database {
    /// Adopts the next unsupervised part; it gets a new claim, its attempt is unchanged.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn adopt(&self, worker: &str, lease: Duration) -> Result<Option<(Job, String)>, sqlx::Error> {
        let token = new_id();
        let row = sqlx::query(self.sql(&format!(
            "UPDATE job SET claim = $1, claim_until_ms = @NOW + $2, worker = $3 WHERE status = 'running' AND id = (SELECT j.id FROM job j \
             WHERE {HANDED_OVER} AND (j.claim_until_ms < @NOW OR j.claim_until_ms > @NOW + 20000) ORDER BY j.id LIMIT 1 @SKIP) RETURNING *"
        )))
        .bind(&token)
        .bind(lease.as_millis() as i64)
        .bind(worker)
        .fetch_optional(&self.pool)
        .await?;
        row.map(|row| Ok((job_of(&row)?, token))).transpose()
    }

    /// Whether cancellation of a claimed job was requested. `None`: the claim is lost.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn wants_end(&self, id: &str, token: &str) -> Result<Option<bool>, sqlx::Error> {
        let row = sqlx::query("SELECT cancel_requested FROM job WHERE id = $1 AND claim = $2")
            .bind(id)
            .bind(token)
            .fetch_optional(&self.pool)
            .await?;
        row.map(|row| row.try_get::<i64, _>("cancel_requested").map(|wanted| wanted != 0))
            .transpose()
    }

    /// Gives a claimed part a ticket, and leaves it for [adoption](Self::adopt); `false`: the claim is lost.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn hand_on(&self, id: &str, token: &str, ticket: &str) -> Result<bool, sqlx::Error> {
        let written =
            sqlx::query(self.sql("UPDATE job SET ticket = $1, claim_until_ms = @NOW - 1 WHERE id = $2 AND claim = $3"))
                .bind(ticket)
                .bind(id)
                .bind(token)
                .execute(&self.pool)
                .await?
                .rows_affected();
        self.hub.queue.notify_one();
        Ok(written > 0)
    }

    /// Marks all handed-over parts as unsupervised: at the start of a process with exclusive use of the database.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn orphan_handed_over(&self) -> Result<(), sqlx::Error> {
        sqlx::query(self.sql(&format!(
            "UPDATE job SET claim_until_ms = @NOW - 1 WHERE id IN (SELECT j.id FROM job j WHERE {HANDED_OVER})"
        )))
        .execute(&self.pool)
        .await
        .map(drop)
    }

    /// A part whose running attempt is handed over, and its current claim; `None`: that attempt is over.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn handed_over(&self, id: &str, attempt: i64) -> Result<Option<(Job, String)>, sqlx::Error> {
        let row = sqlx::query(self.sql(&format!(
            "SELECT * FROM job j WHERE j.id = $1 AND j.attempts = $2 AND j.claim IS NOT NULL AND {HANDED_OVER}"
        )))
        .bind(id)
        .bind(attempt)
        .fetch_optional(&self.pool)
        .await?;
        row.map(|row| Ok((job_of(&row)?, row.try_get("claim")?))).transpose()
    }
}
