//! Parts that are done by a cluster of others: who looks after them, and who may deliver.
//!
//! Such an attempt has two secrets. Its claim is the server's that looks after it, as of every job; another server takes it up with a new
//! claim when that one is gone. Its ticket is the node's: it stays as long as the attempt, so that a node delivers whoever looks after it, and
//! is worth nothing once the attempt has ended, whatever ended it.

use super::Job;
use super::database::Database;
use super::queue::new_id;
use super::table::job_of;
use sqlx::Row as _;
use std::time::Duration;

/// Their attempt has a ticket.
const HANDED_OVER: &str =
    "j.status = 'running' AND j.kind IN ('campaign-shard', 'blind-bench-shard') AND j.ticket IS NOT NULL";

impl Database {
    /// The next part that is handed over, and that nobody looks after; it gets a new claim, its attempt stays.
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

    /// Whether somebody wants a claimed job stopped. `None`: the claim is lost.
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

    /// Gives a claimed part a ticket, and leaves it to whoever [adopts](Self::adopt) it; `false`: the claim is lost.
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

    /// Gives a part that waits for a place to somebody who has one: with a new ticket, and a claim that nobody holds, so that whoever looks after
    /// it stops doing so and somebody [adopts](Self::adopt) it. `false`: the claim is lost.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn pass_on(&self, id: &str, token: &str, ticket: &str) -> Result<bool, sqlx::Error> {
        let written = sqlx::query(self.sql(
            "UPDATE job SET ticket = $1, claim = $2, claim_until_ms = @NOW - 1 WHERE id = $3 AND claim = $4 AND status = 'running' \
             AND cancel_requested = 0",
        ))
        .bind(ticket)
        .bind(new_id())
        .bind(id)
        .bind(token)
        .execute(&self.pool)
        .await?
        .rows_affected();
        self.hub.queue.notify_one();
        Ok(written > 0)
    }

    /// Whoever has looked after parts that are handed over is gone: in a database that one process has, where it begins.
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

    /// A part whose attempt runs and is handed over, and its claim of this moment; `None`: that attempt is over.
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
