//! Autopilots listed by operators. A run names one; a request never opens a port.
//!
//! ```text
//!  serve, worker --autopilot NAME=ADDRESS ──offers, every few seconds──▶ autopilot (name, worker, until)
//!                                                                            ▲
//!  run with this autopilot: queued ──claim: that worker alone, one run at a time──┘
//! ```
//! The address stays with the listing process. When a process is gone, its offer expires, and another one that lists the same name
//! takes its place.

use crate::jobs::database::Database;
use crate::jobs::table::Transaction;
use sqlx::Row as _;
use std::time::Duration;

/// A listed autopilot, as visible to all clients.
#[derive(Debug, Clone)]
pub(crate) struct Listed {
    /// Name used by runs.
    pub(crate) name: String,
    /// `ardupilot`, `px4`, `betaflight`.
    pub(crate) protocol: String,
    /// True if it waits for the plant in each of its steps.
    pub(crate) lockstep: bool,
    /// The process that lists it, or last listed it.
    pub(crate) worker: String,
    /// That process is alive.
    pub(crate) offered: bool,
    /// Version reported in its last flight.
    pub(crate) version: Option<String>,
    /// End of that flight, ms since 1970.
    pub(crate) flown_ms: Option<i64>,
    /// The run that it is flying, and its tenant.
    pub(crate) run: Option<(String, String)>,
}

impl Database {
    /// Offers an autopilot reachable from this worker for a limited time; `false` if another live worker offers it.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn offer_autopilot(
        &self,
        worker: &str,
        autopilot: &crate::Autopilot,
        lease: Duration,
    ) -> Result<bool, sqlx::Error> {
        let written = sqlx::query(self.sql(
            "INSERT INTO autopilot (name, protocol, lockstep, worker, until_ms) VALUES ($1, $2, $3, $4, @NOW + $5) \
             ON CONFLICT (name) DO UPDATE SET protocol = excluded.protocol, lockstep = excluded.lockstep, worker = excluded.worker, \
             until_ms = excluded.until_ms WHERE autopilot.worker = excluded.worker OR autopilot.until_ms < @NOW",
        ))
        .bind(&autopilot.name)
        .bind(&autopilot.protocol)
        .bind(i64::from(autopilot.lockstep))
        .bind(worker)
        .bind(lease.as_millis() as i64)
        .execute(&self.pool)
        .await?
        .rows_affected();
        Ok(written > 0)
    }

    /// Withdraws the offers of this worker; `None`: of all, because no other process exists.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn withdraw_autopilots(&self, worker: Option<&str>) -> Result<(), sqlx::Error> {
        let query = match worker {
            Some(worker) => sqlx::query("UPDATE autopilot SET until_ms = 0 WHERE worker = $1").bind(worker.to_owned()),
            None => sqlx::query("UPDATE autopilot SET until_ms = 0"),
        };
        query.execute(&self.pool).await.map(|_| ())
    }

    /// Every autopilot that was ever listed, by name.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn autopilots(&self) -> Result<Vec<Listed>, sqlx::Error> {
        let rows = sqlx::query(self.sql(
            "SELECT a.name, a.protocol, a.lockstep, a.worker, a.version, a.flown_ms, \
             CAST(CASE WHEN a.until_ms > @NOW THEN 1 ELSE 0 END AS BIGINT) AS offered, b.id AS run, b.tenant AS tenant FROM autopilot a \
             LEFT JOIN job b ON b.autopilot = a.name AND b.status = 'running' ORDER BY a.name",
        ))
        .fetch_all(&self.pool)
        .await?;
        rows.iter()
            .map(|row| {
                let run: Option<String> = row.try_get("run")?;
                let tenant: Option<String> = row.try_get("tenant")?;
                Ok(Listed {
                    name: row.try_get("name")?,
                    protocol: row.try_get("protocol")?,
                    lockstep: row.try_get::<i64, _>("lockstep")? != 0,
                    worker: row.try_get("worker")?,
                    offered: row.try_get::<i64, _>("offered")? != 0,
                    version: row.try_get("version")?,
                    flown_ms: row.try_get("flown_ms")?,
                    run: run.zip(tenant),
                })
            })
            .collect()
    }

    /// Records the version reported by an autopilot in a flight that has just ended.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn autopilot_flew(&self, name: &str, version: Option<&str>) -> Result<(), sqlx::Error> {
        sqlx::query(self.sql("UPDATE autopilot SET version = $1, flown_ms = @NOW WHERE name = $2"))
            .bind(version.map(str::to_owned))
            .bind(name)
            .execute(&self.pool)
            .await
            .map(|_| ())
    }

    /// Whether no other run uses the autopilot; its row is locked until the transaction ends, so that simultaneous requests are
    /// serialised.
    pub(super) async fn has_alone(
        &self,
        transaction: &mut Transaction,
        name: &str,
        run: &str,
    ) -> Result<bool, sqlx::Error> {
        sqlx::query("UPDATE autopilot SET name = name WHERE name = $1")
            .bind(name)
            .execute(&mut **transaction)
            .await?;
        // A separate statement: it sees what the previous holder of the row has written.
        let others =
            sqlx::query("SELECT COUNT(*) AS runs FROM job WHERE status = 'running' AND autopilot = $1 AND id <> $2")
                .bind(name)
                .bind(run)
                .fetch_one(&mut **transaction)
                .await?;
        Ok(others.try_get::<i64, _>("runs")? == 0)
    }
}
