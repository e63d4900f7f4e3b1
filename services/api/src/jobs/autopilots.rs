//! Autopilots that operators have listed. A run names one; nobody opens a port by request.
//!
//! ```text
//!  serve, worker --autopilot NAME=ADDRESS ──offers, every few seconds──▶ autopilot (name, worker, until)
//!                                                                            ▲
//!  run with this autopilot: queued ──claim: that worker alone, one run at a time──┘
//! ```
//! The address stays with the process that lists it. A process that is gone offers nothing after its time is over, and another one that
//! lists the same name takes its place.

use crate::jobs::database::Database;
use crate::jobs::table::Transaction;
use sqlx::Row as _;
use std::time::Duration;

/// An autopilot as it is known to everybody.
#[derive(Debug, Clone)]
pub(crate) struct Listed {
    /// As runs name it.
    pub(crate) name: String,
    /// `ardupilot`, `px4`, `betaflight`.
    pub(crate) protocol: String,
    /// It waits for the plant in each of its steps.
    pub(crate) lockstep: bool,
    /// The process that lists it, or did.
    pub(crate) worker: String,
    /// That process is there.
    pub(crate) offered: bool,
    /// What it called itself in its last flight.
    pub(crate) version: Option<String>,
    /// End of that flight, ms since 1970.
    pub(crate) flown_ms: Option<i64>,
    /// The run that it flies, and whose it is.
    pub(crate) run: Option<(String, String)>,
}

impl Database {
    /// Says for some time that this worker can reach an autopilot; `false`: another one, which is there, says so.
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

    /// This worker offers nothing any more; no worker: nobody does, because nobody else is there.
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

    /// What an autopilot called itself in a flight that has just ended.
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

    /// Whether no other run has the autopilot; its row is held until the transaction ends, so that two that ask at once ask one after the
    /// other.
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
        // A statement of its own: it sees what the one that held the row before has written.
        let others =
            sqlx::query("SELECT COUNT(*) AS runs FROM job WHERE status = 'running' AND autopilot = $1 AND id <> $2")
                .bind(name)
                .bind(run)
                .fetch_one(&mut **transaction)
                .await?;
        Ok(others.try_get::<i64, _>("runs")? == 0)
    }
}
