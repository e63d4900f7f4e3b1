//! Seats of a run, taken by other hosts: its controller, its FDI engine.
//!
//! The worker of the run offers them once its plant listens; any `rotortwin worker --roles …` takes one and starts the process with the
//! ticket. A seat is valid as long as the attempt that offered it: when that ends, the process finds no peer and exits too.

use crate::jobs::database::Database;
use crate::jobs::queue::{holds, new_id};
use sqlx::Row as _;

/// A seat that was taken.
#[derive(Debug, Clone)]
pub(crate) struct Seat {
    /// The run.
    pub(crate) job: String,
    /// `controller` or `fdi`.
    pub(crate) role: String,
    /// JSON.
    pub(crate) ticket: String,
}

impl Database {
    /// Offers seats of a claimed run; `false`: the claim is lost.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn offer_seats(
        &self,
        job: &str,
        token: &str,
        seats: &[(&str, String)],
    ) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        if !holds(&mut transaction, job, token).await? {
            return Ok(false);
        }
        sqlx::query("DELETE FROM seat WHERE job_id = $1")
            .bind(job)
            .execute(&mut *transaction)
            .await?;
        for (role, ticket) in seats {
            sqlx::query("INSERT INTO seat (job_id, role, attempt_claim, ticket) VALUES ($1, $2, $3, $4)")
                .bind(job)
                .bind(*role)
                .bind(token)
                .bind(ticket)
                .execute(&mut *transaction)
                .await?;
        }
        self.tell(&mut transaction, "").await?;
        transaction.commit().await?;
        self.hub.queue.notify_one();
        Ok(true)
    }

    /// Takes a free seat with one of these roles, if there is one whose attempt is still running.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn take_seat(&self, roles: &[String]) -> Result<Option<Seat>, sqlx::Error> {
        for role in roles {
            let row = sqlx::query(self.sql(
                "UPDATE seat SET claim = $1 WHERE claim IS NULL AND (job_id, role) = (SELECT j.job_id, j.role FROM seat j \
                 WHERE j.role = $2 AND j.claim IS NULL AND EXISTS (SELECT 1 FROM job b WHERE b.id = j.job_id \
                 AND b.claim = j.attempt_claim AND b.status = 'running') ORDER BY j.job_id LIMIT 1 @SKIP) RETURNING *",
            ))
            .bind(new_id())
            .bind(role)
            .fetch_optional(&self.pool)
            .await?;
            if let Some(row) = row {
                return Ok(Some(Seat {
                    job: row.try_get("job_id")?,
                    role: row.try_get("role")?,
                    ticket: row.try_get("ticket")?,
                }));
            }
        }
        Ok(None)
    }
}
