//! The database: SQLite in the data folder, or a Postgres shared by several servers and workers. One set of statements serves both; the
//! differences are defined here.

use crate::data_folder::OWN_FILE;
use crate::jobs::hub::Hub;
use crate::jobs::timed::{TimedPool, Transaction};
use sqlx::any::AnyPoolOptions;
use sqlx::migrate::{Migrate as _, Migration, MigrationType, Migrator};
use sqlx::postgres::{PgListener, PgNotification};
use sqlx::{AssertSqlSafe, SqlStr};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Postgres: notification channel for job changes; the payload is a job's id, or empty for the queue.
pub(crate) const CHANNEL: &str = "rotortwin_job";

/// Postgres: live samples, `ID LINE`.
const LIVE_CHANNEL: &str = "rotortwin_live";
/// Connections of a server, in addition to the listening one.
pub(crate) const SERVER_CONNECTIONS: u32 = 10;
/// Connections of a worker, independent of its number of concurrent jobs, in addition to the listening one.
pub(crate) const WORKER_CONNECTIONS: u32 = 3;
/// Postgres limits notifications to 8000 bytes.
const LONGEST_NOTICE: usize = 7900;

/// Timeout for the health check of a returned connection.
const RETURN: Duration = Duration::from_secs(2);
/// Idle time after which a listening connection is checked.
const QUIET: Duration = Duration::from_secs(20);
/// Timeout for connecting.
const CONNECT: Duration = Duration::from_secs(10);
/// Idle time after which connections are closed.
const IDLE: Duration = Duration::from_secs(60);
/// Settings of each connection to Postgres.
///
/// * A statement waits 5 s for a locked row, and takes 15 s at most.
/// * A transaction idle for 5 s is rolled back, and its rows are unlocked: ours send all their statements at once, so an idle client is
///   gone.
/// * A vanished host is detected after 10 s of silence and 3 probes 3 s apart, and undeliverable data after 10 s.
///
/// (Durability of accepted jobs needs nothing here: `synchronous_commit` is on by default.)
const POSTGRES_SETTINGS: &str = "SET lock_timeout = '5s'; SET statement_timeout = '15s'; SET idle_in_transaction_session_timeout = '5s'; \
     SET tcp_keepalives_idle = 10; SET tcp_keepalives_interval = 3; SET tcp_keepalives_count = 3; SET tcp_user_timeout = '10s'; \
     SET client_min_messages = warning;";

/// Settings of each connection to SQLite.
///
/// * An accepted job survives a power failure: FULL, not NORMAL.
/// * 256 KiB of pages are cached. By default each connection has 2 MiB of its own, which fill over hours as the database grows: a server
///   whose memory grows by megabytes an hour, for copies of what the kernel caches once.
const SQLITE_SETTINGS: &str = "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA busy_timeout = 10000; PRAGMA foreign_keys = ON; \
     PRAGMA cache_size = -256;";

/// Start of the first part of a row of `job`: of a part that is started again, its last start. NULL if it has no parts, or none has been
/// started.
const BEGUN: &str = "CASE WHEN job.kind IN ('campaign', 'blind-bench') THEN \
     (SELECT MIN(p.started_ms) FROM job p WHERE p.part_of = job.id) END";

/// Database type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dialect {
    Sqlite,
    Postgres,
}

/// The database, open.
#[derive(Debug, Clone)]
pub(crate) struct Database {
    pub(crate) pool: TimedPool,
    dialect: Dialect,
    /// Waiting tasks of this process.
    pub(crate) hub: Arc<Hub>,
}

impl Database {
    /// Opens SQLite in a file, and migrates it to the current schema; a backup is kept next to it.
    ///
    /// # Errors
    /// One sentence.
    pub(crate) async fn open_file(path: &Path) -> Result<Self, String> {
        let told =
            |error: &dyn std::fmt::Display| format!("{}: the database cannot be opened: {error}", path.display());
        // The accompanying files inherit its permissions.
        std::fs::File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(OWN_FILE)
            .open(path)
            .map_err(|error| told(&error))?;
        let url = format!("sqlite://{}?mode=rwc", path.display());
        let database = Self::connect(&url, Dialect::Sqlite, SERVER_CONNECTIONS)
            .await
            .map_err(|error| told(&error))?;
        database.back_up(path).await.map_err(|error| told(&error))?;
        database.migrate().await.map_err(|error| told(&error))?;
        Ok(database)
    }

    /// Connects to Postgres, and migrates it to the current schema.
    ///
    /// # Errors
    /// The message does not contain the password.
    pub(crate) async fn open_postgres(url: &str, most_connections: u32) -> Result<Self, String> {
        if !(url.starts_with("postgres://") || url.starts_with("postgresql://")) {
            return Err("DATABASE_URL: expected postgres://USER:PASSWORD@HOST/DATABASE; without it SQLite in the data folder is used".to_owned());
        }
        let shown = url.rsplit('@').next().unwrap_or_default();
        let told =
            |error: &dyn std::fmt::Display| format!("DATABASE_URL: the database at {shown} cannot be used: {error}");
        let database = Self::connect(url, Dialect::Postgres, most_connections)
            .await
            .map_err(|error| told(&error))?;
        database.migrate().await.map_err(|error| told(&error))?;
        let hub = Arc::clone(&database.hub);
        tokio::spawn(listen(url.to_owned(), hub));
        Ok(database)
    }

    async fn connect(url: &str, dialect: Dialect, most_connections: u32) -> Result<Self, sqlx::Error> {
        sqlx::any::install_default_drivers();
        let pool = AnyPoolOptions::new()
            .max_connections(most_connections)
            .idle_timeout(IDLE)
            .acquire_timeout(Duration::from_secs(10))
            .after_connect(move |connection, _| {
                Box::pin(async move {
                    use sqlx::Executor as _;
                    let settings = match dialect {
                        Dialect::Sqlite => SQLITE_SETTINGS,
                        Dialect::Postgres => POSTGRES_SETTINGS,
                    };
                    connection.execute(settings).await.map(|_| ())
                })
            })
            .after_release(|connection, _| {
                Box::pin(async {
                    let clean = tokio::time::timeout(RETURN, is_clean(connection)).await;
                    // On error it is closed immediately.
                    clean.unwrap_or_else(|_| Err(sqlx::Error::PoolTimedOut))
                })
            })
            .connect(url)
            .await?;
        Ok(Self {
            pool: TimedPool::new(pool),
            dialect,
            hub: Arc::new(Hub::default()),
        })
    }

    async fn migrate(&self) -> Result<(), sqlx::Error> {
        migrations(self.dialect)
            .run(self.pool.untimed())
            .await
            .map_err(|error| sqlx::Error::Configuration(Box::new(error)))
    }

    /// Copies a database with an older schema to `NAME.before-VERSION`.
    async fn back_up(&self, path: &Path) -> Result<(), sqlx::Error> {
        let mut connection = self.pool.untimed().acquire().await?;
        connection
            .ensure_migrations_table("_sqlx_migrations")
            .await
            .map_err(|error| sqlx::Error::Configuration(Box::new(error)))?;
        let applied = connection
            .list_applied_migrations("_sqlx_migrations")
            .await
            .map_err(|error| sqlx::Error::Configuration(Box::new(error)))?;
        let pending = migrations(self.dialect)
            .iter()
            .map(|migration| migration.version)
            .find(|version| applied.iter().all(|old| old.version != *version));
        let Some(version) = pending.filter(|_| !applied.is_empty()) else {
            return Ok(());
        };
        let copy = format!("{}.before-{version}", path.display());
        if Path::new(&copy).exists() {
            return Ok(());
        }
        tracing::info!(copy, "the database has an older schema: it is copied, then changed");
        sqlx::query("VACUUM INTO $1")
            .bind(copy)
            .execute(&mut *connection)
            .await
            .map(|_| ())
    }

    /// Translates a statement with `@NOW` (ms since 1970 by the database's clock, so that hosts need not agree), `@SKIP` (skip rows just
    /// locked by others), `@OPEN` (the smallest id of a transaction writing now or later) and `@VEHICLE` (the vehicle of a job in lists)
    /// to this database's dialect; `@BEGUN` is when the first part of a job in parts was started.
    pub(crate) fn sql(&self, text: &str) -> AssertSqlSafe<String> {
        let (now, skip, open, vehicle) = match self.dialect {
            // Writing transactions are serialised: all have the id 0.
            Dialect::Sqlite => (
                "CAST(unixepoch('subsec') * 1000 AS INTEGER)",
                "",
                "1",
                "json_extract(facts, '$.vehicle')",
            ),
            Dialect::Postgres => (
                "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT)",
                "FOR UPDATE OF j SKIP LOCKED",
                "CAST(pg_snapshot_xmin(pg_current_snapshot())::text AS BIGINT)",
                "CAST(facts AS json) ->> 'vehicle'",
            ),
        };
        AssertSqlSafe(
            text.replace("@NOW", now)
                .replace("@SKIP", skip)
                .replace("@OPEN", open)
                .replace("@VEHICLE", vehicle)
                .replace("@BEGUN", BEGUN),
        )
    }

    /// Notifies other processes, once the transaction is committed, of a changed job, or of the queue (no id).
    pub(super) async fn tell(&self, transaction: &mut Transaction, id: &str) -> Result<(), sqlx::Error> {
        if self.dialect == Dialect::Postgres {
            sqlx::query("SELECT pg_notify($1, $2)")
                .bind(CHANNEL)
                .bind(id)
                .execute(&mut **transaction)
                .await?;
        }
        Ok(())
    }

    /// Sends a live sample to servers in other processes; losing one does not matter.
    pub(crate) async fn tell_live(&self, id: &str, line: &str) {
        if line.len() + id.len() >= LONGEST_NOTICE {
            return;
        }
        let told = sqlx::query("SELECT pg_notify($1, $2)")
            .bind(LIVE_CHANNEL)
            .bind(format!("{id} {line}"))
            .execute(&self.pool)
            .await;
        if let Err(error) = told {
            tracing::debug!(%error, "a live sample cannot be published");
        }
    }

    /// Whether other processes write here too.
    pub(crate) fn is_shared(&self) -> bool {
        self.dialect == Dialect::Postgres
    }

    /// Whether it responds.
    ///
    /// # Errors
    /// It does not.
    pub(crate) async fn ping(&self) -> Result<(), sqlx::Error> {
        sqlx::query("SELECT 1").execute(&self.pool).await.map(|_| ())
    }

    /// Closes all connections.
    pub(crate) async fn close(&self) {
        self.pool.untimed().close().await;
    }
}

/// Whether a connection can be reused. One on which a statement was abandoned still owes its response: it is pinged, which is processed
/// after that. SQLite ends a transaction by itself when the disk is full; sqlx then fails to roll it back, and would continue in a
/// transaction that never ends and locks everyone else out.
async fn is_clean(connection: &mut sqlx::AnyConnection) -> Result<bool, sqlx::Error> {
    use sqlx::Connection as _;
    // A rollback started when the transaction was dropped precedes this.
    connection.ping().await?;
    let is_clean = !connection.is_in_transaction();
    if !is_clean {
        tracing::warn!("a connection to the database is stuck in a transaction: it is closed");
    }
    Ok(is_clean)
}

/// Forwards notifications from other processes, as long as the process lives; those missed while disconnected are compensated by waking all.
async fn listen(url: String, hub: Arc<Hub>) {
    loop {
        let connected = tokio::time::timeout(CONNECT, PgListener::connect(&url)).await;
        match connected.unwrap_or(Err(sqlx::Error::PoolTimedOut)) {
            Ok(mut listener) => {
                if let Err(error) = listener.listen_all([CHANNEL, LIVE_CHANNEL]).await {
                    tracing::warn!(%error, "notifications of other processes cannot be received");
                }
                hub.wake_all();
                while let Some(notice) = next_notice(&mut listener).await {
                    if notice.channel() == LIVE_CHANNEL {
                        if let Some((id, line)) = notice.payload().split_once(' ') {
                            hub.live.take(id, line);
                        }
                        continue;
                    }
                    match notice.payload() {
                        "" => hub.queue.notify_one(),
                        id => hub.wake(id),
                    }
                }
            }
            Err(error) => tracing::warn!(%error, "notifications of other processes cannot be received"),
        }
        tokio::time::sleep(Duration::from_secs(1)).await;
    }
}

/// The next notification; `None`: the connection is lost. A silent connection is checked.
async fn next_notice(listener: &mut PgListener) -> Option<PgNotification> {
    loop {
        match tokio::time::timeout(QUIET, listener.try_recv()).await {
            Ok(heard) => return heard.ok().flatten(),
            Err(_) => {
                let asked = sqlx::query::<sqlx::Postgres>("SELECT 1").execute(&mut *listener);
                if !matches!(tokio::time::timeout(RETURN, asked).await, Ok(Ok(_))) {
                    return None;
                }
            }
        }
    }
}

/// All schema versions, in order. A released file is never changed; add another one.
fn migrations(dialect: Dialect) -> Migrator {
    let files: &[(i64, &'static str, &'static str)] = match dialect {
        Dialect::Sqlite => &[
            (1, "runs", include_str!("../../migrations/sqlite/0001_runs.sql")),
            (2, "jobs", include_str!("../../migrations/sqlite/0002_jobs.sql")),
            (
                3,
                "job_indices",
                include_str!("../../migrations/sqlite/0003_job_indices.sql"),
            ),
            (
                4,
                "documents",
                include_str!("../../migrations/sqlite/0004_documents.sql"),
            ),
            (5, "models", include_str!("../../migrations/sqlite/0005_models.sql")),
            (
                6,
                "events_in_order",
                include_str!("../../migrations/sqlite/0006_events_in_order.sql"),
            ),
            (
                7,
                "autopilots",
                include_str!("../../migrations/sqlite/0007_autopilots.sql"),
            ),
            (
                8,
                "needs_and_uploads",
                include_str!("../../migrations/sqlite/0008_needs_and_uploads.sql"),
            ),
            (9, "verdict", include_str!("../../migrations/sqlite/0009_verdict.sql")),
        ],
        Dialect::Postgres => &[
            (1, "jobs", include_str!("../../migrations/postgres/0001_jobs.sql")),
            (
                2,
                "job_indices",
                include_str!("../../migrations/postgres/0002_job_indices.sql"),
            ),
            (
                3,
                "documents",
                include_str!("../../migrations/postgres/0003_documents.sql"),
            ),
            (4, "models", include_str!("../../migrations/postgres/0004_models.sql")),
            (
                5,
                "events_in_order",
                include_str!("../../migrations/postgres/0005_events_in_order.sql"),
            ),
            (
                6,
                "autopilots",
                include_str!("../../migrations/postgres/0006_autopilots.sql"),
            ),
            (
                7,
                "needs_and_uploads",
                include_str!("../../migrations/postgres/0007_needs_and_uploads.sql"),
            ),
            (8, "verdict", include_str!("../../migrations/postgres/0008_verdict.sql")),
        ],
    };
    Migrator::with_migrations(
        files
            .iter()
            .map(|(version, name, text)| {
                Migration::new(
                    *version,
                    (*name).into(),
                    MigrationType::Simple,
                    SqlStr::from_static(text),
                    false,
                )
            })
            .collect(),
    )
}
