//! Seats of a run, taken by other hosts: its controller, its FDI engine.
//!
//! The worker of the run offers them once its plant listens; any `rotortwin worker --roles …` takes one and starts the process with the
//! ticket. A seat is valid as long as the attempt that offered it: when that ends, the process is ended too. A process that cannot reach the
//! plant's meeting point gives the seat back, for another host to try.

use crate::jobs::database::Database;
use crate::jobs::queue::{holds, new_id};
use rotortwin_jobs::SeatRole;
use sqlx::Row as _;

/// A seat that was taken.
#[derive(Debug, Clone)]
pub(crate) struct Seat {
    /// The run.
    pub(crate) job: String,
    /// What sits there.
    pub(crate) role: SeatRole,
    /// JSON ([`rotortwin_jobs::Ticket`]).
    pub(crate) ticket: String,
    /// Who took it: each time another.
    pub(crate) claim: String,
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
        seats: &[(SeatRole, String)],
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
                .bind(role.as_str())
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
    pub(crate) async fn take_seat(&self, roles: &[SeatRole]) -> Result<Option<Seat>, sqlx::Error> {
        for role in roles {
            let row = sqlx::query(self.sql(
                "UPDATE seat SET claim = $1 WHERE claim IS NULL AND (job_id, role) = (SELECT j.job_id, j.role FROM seat j \
                 WHERE j.role = $2 AND j.claim IS NULL AND EXISTS (SELECT 1 FROM job b WHERE b.id = j.job_id \
                 AND b.claim = j.attempt_claim AND b.status = 'running') ORDER BY j.job_id LIMIT 1 @SKIP) RETURNING *",
            ))
            .bind(new_id())
            .bind(role.as_str())
            .fetch_optional(&self.pool)
            .await?;
            if let Some(row) = row {
                return Ok(Some(Seat {
                    job: row.try_get("job_id")?,
                    role: *role,
                    ticket: row.try_get("ticket")?,
                    claim: row.try_get("claim")?,
                }));
            }
        }
        Ok(None)
    }

    /// True as long as the attempt that offered the seat runs, and nobody else has the seat.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn seat_is_wanted(&self, seat: &Seat) -> Result<bool, sqlx::Error> {
        let row = sqlx::query(
            "SELECT 1 FROM seat s JOIN job b ON b.id = s.job_id WHERE s.job_id = $1 AND s.role = $2 AND s.claim = $3 \
             AND b.claim = s.attempt_claim AND b.status = 'running'",
        )
        .bind(&seat.job)
        .bind(seat.role.as_str())
        .bind(&seat.claim)
        .fetch_optional(&self.pool)
        .await?;
        Ok(row.is_some())
    }

    /// Gives a seat back whose process never reached the plant: another host may.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn release_seat(&self, seat: &Seat) -> Result<(), sqlx::Error> {
        sqlx::query("UPDATE seat SET claim = NULL WHERE job_id = $1 AND role = $2 AND claim = $3")
            .bind(&seat.job)
            .bind(seat.role.as_str())
            .bind(&seat.claim)
            .execute(&self.pool)
            .await?;
        Ok(())
    }
}
