//! Read access to jobs and events.

use super::table::{SHORT, WHOLE, job_of, shown};
use super::{Event, EventPlace, Job, PlacedEvent};
use crate::jobs::database::Database;
use rotortwin_jobs::{JobKind, Status};
use sqlx::Row as _;

/// Filter of a job list.
#[derive(Debug, Clone, Default)]
pub(crate) struct Filter<'a> {
    /// Only this kind; by default every kind except parts of other jobs.
    pub(crate) kind: Option<JobKind>,
    /// Only of this tenant.
    pub(crate) tenant: Option<&'a str>,
    /// Only in this state.
    pub(crate) status: Option<Status>,
    /// Only of this name.
    pub(crate) name: Option<&'a str>,
    /// Only those forked from this one.
    pub(crate) parent: Option<&'a str>,
    /// Only of this vehicle.
    pub(crate) vehicle: Option<&'a str>,
    /// Only runs that the sequential detector ended with this verdict.
    pub(crate) verdict: Option<i32>,
    /// Only those submitted then or later, ms since 1970.
    pub(crate) from_ms: Option<i64>,
    /// Only those submitted before, ms since 1970.
    pub(crate) to_ms: Option<i64>,
    /// Only older ones.
    pub(crate) before: Option<&'a str>,
}

/// The status of a row of `job` as it is told: a job in parts is running from the start of its first part.
const TOLD_STATUS: &str = "CASE WHEN status = 'queued' AND @BEGUN IS NOT NULL THEN 'running' ELSE status END AS status";

impl Database {
    /// A job; `None` if the id is unknown.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn get(&self, id: &str) -> Result<Option<Job>, sqlx::Error> {
        let row = sqlx::query(self.sql(&format!("SELECT {WHOLE} FROM job WHERE id = $1")))
            .bind(id)
            .fetch_optional(&self.pool)
            .await?;
        row.as_ref().map(shown).transpose()
    }

    /// The job that a tenant has submitted under a key; `None` if there is none.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn by_key(&self, tenant: &str, kind: JobKind, key: &str) -> Result<Option<Job>, sqlx::Error> {
        let text = format!("SELECT {WHOLE} FROM job WHERE tenant = $1 AND kind = $2 AND idempotency_key = $3");
        let row = sqlx::query(self.sql(&text))
            .bind(tenant)
            .bind(kind.as_str())
            .bind(key)
            .fetch_optional(&self.pool)
            .await?;
        row.as_ref().map(shown).transpose()
    }

    /// Whether a job references an uploaded file by this key.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn names_upload(&self, key: &str) -> Result<bool, sqlx::Error> {
        let row = sqlx::query("SELECT id FROM job WHERE kind = 'log' AND facts LIKE $1 LIMIT 1")
            .bind(format!("%\"{key}\"%"))
            .fetch_optional(&self.pool)
            .await?;
        Ok(row.is_some())
    }

    /// Jobs, latest first, without specification and result.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn list(&self, filter: &Filter<'_>, limit: i64) -> Result<Vec<Job>, sqlx::Error> {
        self.select(SHORT, filter, limit).await?.iter().map(shown).collect()
    }

    /// Jobs, latest first, with the numbers of their results.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn list_metrics(&self, filter: &Filter<'_>, limit: i64) -> Result<Vec<Job>, sqlx::Error> {
        let columns = SHORT.replace("NULL AS metrics", "metrics");
        self.select(&columns, filter, limit).await?.iter().map(shown).collect()
    }

    async fn select(
        &self,
        columns: &str,
        filter: &Filter<'_>,
        limit: i64,
    ) -> Result<Vec<sqlx::any::AnyRow>, sqlx::Error> {
        // Only the conditions in use, so that the database can use its indices.
        let mut conditions = vec!["part_of IS NULL".to_owned()];
        let mut values: Vec<&str> = Vec::new();
        // Numbers need no bind parameter.
        conditions.extend(filter.from_ms.map(|at| format!("submitted_ms >= {at}")));
        conditions.extend(filter.to_ms.map(|at| format!("submitted_ms < {at}")));
        conditions.extend(filter.verdict.map(|code| format!("verdict = {code}")));
        // As [`shown`]. Jobs of other kinds have no parts, and an index for their state.
        let in_parts = matches!(filter.kind, None | Some(JobKind::Campaign | JobKind::BlindBench));
        let (condition, status) = match filter.status {
            Some(Status::Queued) if in_parts => (Some("status = 'queued' AND @BEGUN IS NULL"), None),
            Some(Status::Running) if in_parts => (
                Some("(status = 'running' OR (status = 'queued' AND @BEGUN IS NOT NULL))"),
                None,
            ),
            status => (None, status),
        };
        conditions.extend(condition.map(str::to_owned));
        for (condition, value) in [
            ("kind =", filter.kind.map(JobKind::as_str)),
            ("tenant =", filter.tenant),
            ("status =", status.map(Status::as_str)),
            ("name =", filter.name),
            ("parent =", filter.parent),
            ("@VEHICLE =", filter.vehicle),
            ("id <", filter.before),
        ] {
            if let Some(value) = value {
                values.push(value);
                conditions.push(format!("{condition} ${}", values.len()));
            }
        }
        let text = format!(
            "SELECT {columns} FROM job WHERE {} ORDER BY id DESC LIMIT {limit}",
            conditions.join(" AND ")
        );
        let mut query = sqlx::query(self.sql(&text));
        for value in values {
            query = query.bind(value.to_owned());
        }
        query.fetch_all(&self.pool).await
    }

    /// Parts of a job, in order.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn parts(&self, id: &str) -> Result<Vec<Job>, sqlx::Error> {
        let text = format!("SELECT {SHORT} FROM job WHERE part_of = $1 ORDER BY id");
        let rows = sqlx::query(self.sql(&text)).bind(id).fetch_all(&self.pool).await?;
        rows.iter().map(job_of).collect()
    }

    /// Releases the files of the parts of a job; returns their former keys.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn forget_files_of_parts(&self, id: &str) -> Result<Vec<String>, sqlx::Error> {
        let keys = self
            .parts(id)
            .await?
            .into_iter()
            .filter_map(|part| part.folder)
            .collect();
        sqlx::query("UPDATE job SET folder = NULL, bytes = 0 WHERE part_of = $1")
            .bind(id)
            .execute(&self.pool)
            .await?;
        Ok(keys)
    }

    /// Number of jobs of each kind and status.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn count(&self) -> Result<Vec<(String, String, i64)>, sqlx::Error> {
        let rows = sqlx::query(self.sql(&format!(
            "SELECT kind, {TOLD_STATUS}, COUNT(*) AS jobs FROM job GROUP BY 1, 2 ORDER BY 1, 2"
        )));
        let rows = rows.fetch_all(&self.pool).await?;
        rows.iter()
            .map(|row| Ok((row.try_get("kind")?, row.try_get("status")?, row.try_get("jobs")?)))
            .collect()
    }

    /// How long the job has waited that has been waiting longest to start, ms by the database's clock. Jobs waiting for their parts do not count.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn age_of_oldest_queued(&self) -> Result<Option<i64>, sqlx::Error> {
        let row = sqlx::query(
            self.sql("SELECT @NOW - MIN(submitted_ms) AS age FROM job WHERE status = 'queued' AND waits_for = 0"),
        );
        row.fetch_one(&self.pool).await?.try_get("age")
    }

    /// Number of waiting and running jobs by tenant and state.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn count_open_by_tenant(&self) -> Result<Vec<(String, String, i64)>, sqlx::Error> {
        let rows = sqlx::query(self.sql(&format!(
            "SELECT tenant, {TOLD_STATUS}, COUNT(*) AS jobs FROM job WHERE status IN ('queued', 'running') GROUP BY 1, 2 ORDER BY 1, 2"
        )));
        let rows = rows.fetch_all(&self.pool).await?;
        rows.iter()
            .map(|row| Ok((row.try_get("tenant")?, row.try_get("status")?, row.try_get("jobs")?)))
            .collect()
    }

    /// Resources used by a tenant: waiting or running jobs, and bytes of files.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn account(&self, tenant: &str) -> Result<(i64, i64), sqlx::Error> {
        let row = sqlx::query(
            "SELECT CAST(COALESCE(SUM(CASE WHEN status IN ('queued', 'running') THEN 1 ELSE 0 END), 0) AS BIGINT) AS open, \
             CAST(COALESCE(SUM(bytes), 0) AS BIGINT) AS bytes FROM job WHERE tenant = $1",
        )
        .bind(tenant)
        .fetch_one(&self.pool)
        .await?;
        Ok((row.try_get("open")?, row.try_get("bytes")?))
    }

    /// Events of all jobs except parts, optionally of one tenant, after a position, in order, at most `limit`.
    ///
    /// Only events that no open transaction can still precede: see the schema.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn all_events_after(
        &self,
        tenant: Option<&str>,
        place: EventPlace,
        progress: bool,
        limit: i64,
    ) -> Result<Vec<PlacedEvent>, sqlx::Error> {
        let mut conditions = String::new();
        if !progress {
            conditions += " AND e.kind <> 'progress'";
        }
        if tenant.is_some() {
            conditions += " AND j.tenant = $3";
        }
        let text = format!(
            "SELECT e.written, e.position, e.job_id, e.seq, e.kind, e.data, j.kind AS job_kind FROM job_event e \
             JOIN job j ON j.id = e.job_id WHERE (e.written, e.position) > ($1, $2) AND e.written < @OPEN AND j.part_of IS NULL{conditions} \
             ORDER BY e.written, e.position LIMIT {limit}"
        );
        let mut query = sqlx::query(self.sql(&text)).bind(place.written).bind(place.position);
        if let Some(tenant) = tenant {
            query = query.bind(tenant.to_owned());
        }
        let rows = query.fetch_all(&self.pool).await?;
        rows.iter()
            .map(|row| {
                let kind: String = row.try_get("job_kind")?;
                let unknown =
                    || sqlx::Error::Decode(format!("this version does not know jobs of kind '{kind}'").into());
                Ok(PlacedEvent {
                    place: EventPlace {
                        written: row.try_get("written")?,
                        position: row.try_get("position")?,
                    },
                    job: row.try_get("job_id")?,
                    job_kind: JobKind::parse(&kind).ok_or_else(unknown)?,
                    event: Event {
                        seq: row.try_get("seq")?,
                        kind: row.try_get("kind")?,
                        data: row.try_get("data")?,
                    },
                })
            })
            .collect()
    }

    /// The position that all future events follow.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn last_place(&self) -> Result<EventPlace, sqlx::Error> {
        // Two columns of one row: the settled part ends where the first open transaction begins.
        let row = sqlx::query(self.sql(
            "SELECT CAST(@OPEN AS BIGINT) - 1 AS written, CAST(COALESCE((SELECT MAX(position) FROM job_event), 0) AS BIGINT) AS position",
        ))
        .fetch_one(&self.pool)
        .await?;
        Ok(EventPlace {
            written: row.try_get("written")?,
            position: row.try_get("position")?,
        })
    }

    /// Events of a job after `seq`, in order, at most `limit`.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn events_after(&self, id: &str, seq: i64, limit: i64) -> Result<Vec<Event>, sqlx::Error> {
        let rows =
            sqlx::query("SELECT seq, kind, data FROM job_event WHERE job_id = $1 AND seq > $2 ORDER BY seq LIMIT $3")
                .bind(id)
                .bind(seq)
                .bind(limit)
                .fetch_all(&self.pool)
                .await?;
        rows.iter()
            .map(|row| {
                Ok(Event {
                    seq: row.try_get("seq")?,
                    kind: row.try_get("kind")?,
                    data: row.try_get("data")?,
                })
            })
            .collect()
    }
}
