//! The HTTP server of rotortwin: accepts jobs, executes them, and exposes runs and results.
//!
//! ```text
//!  HTTP ─▶ routes ─▶ database (SQLite, Postgres) ◀─ workers ─▶ rotortwin fly ─▶ sim, controller, fdi
//!            │           ▲                │  │
//!            └── hub: "look again" ───────┘  └─▶ artifacts (folder, S3): jobs/ID/ATTEMPT/out/: report.html, telemetry.parquet, run.mcap, …
//! ```
//! A 202 response means that the job is durable; from then on it ends as done, failed or canceled, whatever fails in between. The state and
//! events of a job are read only from the database, so that they survive a restart and no event is missed.
//!
//! It only listens to other hosts with a certificate and a token ([`tokens`]).

mod access;
mod artifacts;
mod browsers;
mod bucket;
mod clock;
mod connections;
mod copies;
mod data_folder;
mod embedded;
pub mod fdi;
mod incoming;
mod jobs;
mod json_object;
mod library;
mod manual;
pub mod memory;
mod metrics;
mod problem;
mod pulse;
mod readers;
mod routes;
mod sessions;
mod tls;
pub mod tokens;
mod traces;
mod web;
mod worker;

use crate::access::Rate;
use crate::artifacts::Artifacts;
use crate::browsers::HostNames;
use crate::data_folder::DataFolder;
use crate::fdi::FdiSessions;
use crate::jobs::database::{Database, SERVER_CONNECTIONS, WORKER_CONNECTIONS};
use crate::jobs::queue::{FairShare, Left};
use crate::library::Library;
use crate::metrics::Metrics;
use crate::pulse::Pulse;
use crate::readers::Readers;
use crate::tls::TlsListener;
use crate::traces::Traces;
use crate::worker::ray::Ray;
use crate::worker::{Meeting, WorkerContext};
use rotortwin_jobs::SeatRole;
use rotortwin_process::LinkAddress;
use std::net::SocketAddr;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio_rustls::TlsAcceptor;

pub use bucket::Bucket;
pub use fdi::sessions::FdiLimits;
pub use problem::Problem;
pub use pulse::alive;
pub use routes::openapi_document;
pub use worker::ray::RayConfig;
pub use worker::{hold_within, limit_that_ended};

/// Plain files below a folder, in order: path and bytes of each.
///
/// # Errors
/// It cannot be read.
pub fn files_of(folder: &std::path::Path) -> std::io::Result<Vec<(String, u64)>> {
    let files = artifacts::files_below(folder)?;
    Ok(files.into_iter().map(|file| (file.path, file.size)).collect())
}

/// Maximum number of concurrent SQL queries.
const QUERIES_AT_ONCE: usize = 2;
/// Time for returning running jobs to the queue when the process ends.
const END_GRACE: Duration = Duration::from_secs(5);
/// Time for closing the database.
const CLOSE_GRACE: Duration = Duration::from_secs(2);

/// Settings of job execution and storage, common to servers and workers.
#[derive(Debug, Clone)]
pub struct WorkConfig {
    /// Database (SQLite), files or their cache; exclusive to one process.
    pub data: PathBuf,
    /// `postgres://…`; none: SQLite in the data folder.
    pub database_url: Option<String>,
    /// A folder or `s3://BUCKET[/PREFIX]` shared by all hosts; none: the data folder.
    pub artifacts: Option<String>,
    /// Maximum number of concurrent jobs.
    pub workers: usize,
    /// Maximum number of concurrent seats in other hosts' runs, and their roles.
    pub seats: usize,
    /// See `seats`.
    pub roles: Vec<SeatRole>,
    /// Maximum number of concurrently running jobs of one tenant.
    pub most_running: u32,
    /// Memory limit of each process of a job, bytes.
    pub job_memory: u64,
    /// Autopilots reachable from this host, which runs can name.
    pub autopilots: Vec<Autopilot>,
    /// The plants of runs over zenoh listen here: `tcp/10.0.0.2:0`.
    pub zenoh_listen: String,
    /// All processes of runs over zenoh connect to this router instead.
    pub zenoh_router: Option<String>,
    /// The `rotortwin` program.
    pub program: PathBuf,
    /// Display name of this process.
    pub name: String,
    /// A cluster for the parts of campaigns and blind benches; none: they are executed here.
    pub ray: Option<RayConfig>,
}

/// An autopilot on this host available for runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Autopilot {
    /// Name used by runs.
    pub name: String,
    /// `ardupilot`, `px4`, `betaflight`.
    pub protocol: String,
    /// True if it waits for the plant in each of its steps.
    pub lockstep: bool,
    /// Syntax as in `rotortwin fly --controller`.
    pub address: String,
    /// Syntax as in `rotortwin fly --pilot`; none: the protocol's default.
    pub pilot: Option<String>,
}

/// Additional settings of a server.
#[derive(Debug, Clone)]
pub struct ServeConfig {
    /// Listening address; other than loopback only with a certificate and a token.
    pub listen: SocketAddr,
    /// Certificate chain and private key (PEM): HTTPS.
    pub tls: Option<(PathBuf, PathBuf)>,
    /// Requests per second and tenant.
    pub rate: NonZeroU32,
    /// Maximum total file size per tenant, bytes.
    pub most_bytes: u64,
    /// Maximum size of an uploaded file, bytes.
    pub largest_upload: u64,
    /// Maximum duration of a flight, s of simulated time.
    pub longest_flight_s: f64,
    /// Accepted host names in addition to localhost; none: any, if it listens to other hosts.
    pub allowed_hosts: Vec<String>,
    /// Origins whose pages may use the API from a browser; none: only its own.
    pub cors_origins: Vec<String>,
    /// Scenarios and vehicles, laid out as `config/` of the project.
    pub library: PathBuf,
    /// Maximum number of waiting or running jobs per tenant.
    pub most_open: u32,
    /// Longest time of a query in SQL, whole seconds.
    pub query_time: Duration,
    /// Limits of the FDI service.
    pub fdi: FdiLimits,
    /// Link over which FDI sessions also accept measurements.
    pub fdi_link: Option<LinkAddress>,
    /// Other settings.
    pub work: WorkConfig,
}

/// Shared state of the routes.
#[derive(Debug)]
pub(crate) struct App {
    pub(crate) config: ServeConfig,
    /// Accepted host names.
    pub(crate) hosts: HostNames,
    /// The server's own library; [`App::library`] is a caller's view.
    pub(crate) shelf: Library,
    pub(crate) database: Database,
    pub(crate) artifacts: Artifacts,
    pub(crate) context: Arc<WorkerContext>,
    pub(crate) rate: Rate,
    pub(crate) fdi: FdiSessions,
    pub(crate) metrics: Metrics,
    /// Limits concurrent SQL queries.
    pub(crate) queries: tokio::sync::Semaphore,
    /// Limits concurrent reading of documents.
    pub(crate) readers: Readers,
}

impl App {
    /// The process is shutting down.
    pub(crate) fn is_ending(&self) -> bool {
        *self.context.ending.borrow()
    }
}

/// Executes jobs for the servers that share its database.
pub struct Worker {
    context: Arc<WorkerContext>,
    config: WorkConfig,
    _folder: DataFolder,
}

impl Worker {
    /// Opens data folder, database and artifact store. A SQLite database has no other users, so unfinished jobs in it are queued again.
    ///
    /// # Errors
    /// The message says what, where, and what was expected.
    pub async fn open(config: WorkConfig) -> Result<Self, String> {
        Self::open_with(config, WORKER_CONNECTIONS).await
    }

    async fn open_with(config: WorkConfig, most_connections: u32) -> Result<Self, String> {
        // For TLS to databases and buckets; an error means that one is already installed.
        let _chosen = rustls::crypto::ring::default_provider().install_default();
        let traces = Traces::from_environment(&config.name)?;
        let folder = DataFolder::open(&config.data)?;
        let database = match &config.database_url {
            Some(url) => Database::open_postgres(url, most_connections).await?,
            None => Database::open_file(&folder.database()).await?,
        };
        let (root, bucket) = match config.artifacts.as_deref() {
            None => (folder.path().to_owned(), None),
            Some(address) if address.contains("://") => (folder.path().join("cache"), Some(address)),
            Some(path) => (PathBuf::from(path), None),
        };
        let artifacts = Artifacts::open(&root, bucket)?;
        artifacts.ping().await.map_err(|error| {
            format!(
                "--artifacts {}: cannot be reached: {error}",
                config.artifacts.as_deref().unwrap_or("(data folder)")
            )
        })?;
        let ray = match &config.ray {
            None => None,
            Some(ray) => Some(Arc::new(Ray::open(ray.clone()).await?)),
        };
        let left = match (database.is_shared(), &ray) {
            (true, _) => Left::Abandoned,
            (false, None) => Left::All,
            (false, Some(_)) => Left::AllButHandedOver,
        };
        let queued = async {
            worker::requeue(&database, &artifacts, left).await?;
            if left == Left::AllButHandedOver {
                database.orphan_handed_over().await?;
            }
            Ok::<(), sqlx::Error>(())
        };
        queued
            .await
            .map_err(|error| format!("the queue cannot be read: {error}"))?;
        if !database.is_shared() {
            // Any earlier process that offered one here is gone.
            let withdrawn = database.withdraw_autopilots(None).await;
            withdrawn.map_err(|error| format!("the list of autopilots cannot be written: {error}"))?;
        }
        let context = Arc::new(WorkerContext {
            database,
            artifacts,
            autopilots: config.autopilots.clone(),
            pulse: Pulse::new(),
            program: config.program.clone(),
            name: config.name.clone(),
            share: FairShare {
                most_running: i64::from(config.most_running),
            },
            zenoh: match &config.zenoh_router {
                Some(router) => Meeting::Router(router.clone()),
                None => Meeting::Listen(config.zenoh_listen.clone()),
            },
            threads: (std::thread::available_parallelism().map_or(1, usize::from) / config.workers.max(1)).max(1),
            job_memory: config.job_memory,
            ending: watch::channel(false).0,
            traces,
            ray,
        });
        worker::offer_autopilots(&context)
            .await
            .map_err(|error| format!("the list of autopilots cannot be written: {error}"))?;
        Ok(Self {
            context,
            config,
            _folder: folder,
        })
    }

    fn start(&self) -> JoinSet<()> {
        let mut tasks = JoinSet::new();
        for _ in 0..self.config.workers {
            let context = Arc::clone(&self.context);
            tasks.spawn(async move { context.pulse.watched(worker::work(Arc::clone(&context))).await });
        }
        if let Some(ray) = &self.context.ray {
            for _ in 0..ray.config.parts {
                let (context, ray) = (Arc::clone(&self.context), Arc::clone(ray));
                tasks.spawn(async move {
                    context
                        .pulse
                        .watched(worker::ray::hand_over(Arc::clone(&context), ray))
                        .await
                });
            }
            tasks.spawn(worker::ray::look_after(Arc::clone(&self.context), Arc::clone(ray)));
        }
        for _ in 0..self.config.seats {
            tasks.spawn(worker::serve_seats(
                Arc::clone(&self.context),
                self.config.roles.clone(),
            ));
        }
        let (context, data) = (Arc::clone(&self.context), self.config.data.clone());
        tasks.spawn(async move { context.pulse.show(data, context.ending.subscribe()).await });
        tasks.spawn(worker::look_after_claims(Arc::clone(&self.context)));
        if !self.context.autopilots.is_empty() {
            tasks.spawn(worker::keep_offering(Arc::clone(&self.context)));
        }
        tasks
    }

    async fn end(&self, mut tasks: JoinSet<()>) {
        self.context.ending.send_replace(true);
        let all = async { while tasks.join_next().await.is_some() {} };
        if tokio::time::timeout(END_GRACE, all).await.is_err() {
            tracing::warn!("some jobs did not end in time; they will be started again");
        }
        // Do not wait for one that does not respond.
        if tokio::time::timeout(CLOSE_GRACE, self.context.database.close())
            .await
            .is_err()
        {
            tracing::warn!("the database connections were not closed in time");
        }
        self.context.traces.end().await;
    }

    /// Works until `stop` is ready; jobs still running then are returned to the queue.
    pub async fn run(self, stop: impl Future<Output = ()> + Send + 'static) {
        let tasks = self.start();
        stop.await;
        self.end(tasks).await;
    }
}

/// A server that listens and works.
pub struct Server {
    app: Arc<App>,
    worker: Worker,
    listener: TcpListener,
    acceptor: Option<TlsAcceptor>,
    address: SocketAddr,
}

impl Server {
    /// Opens folder, database and socket.
    ///
    /// # Errors
    /// The message says what, where, and what was expected.
    pub async fn open(config: ServeConfig) -> Result<Self, String> {
        let acceptor = match &config.tls {
            Some((certificate, key)) => Some(tls::acceptor(certificate, key)?),
            None => None,
        };
        let open = !config.listen.ip().is_loopback();
        if open && acceptor.is_none() {
            return Err(format!(
                "--listen {}: tokens would cross the network in the clear; expected --tls-cert and --tls-key, or a loopback address such as \
                 127.0.0.1:8400",
                config.listen
            ));
        }
        let hosts = HostNames::new(config.listen, &config.allowed_hosts)?;
        let shelf = Library::open(&config.library)?;
        let worker = Worker::open_with(config.work.clone(), SERVER_CONNECTIONS).await?;
        incoming::tidy(&worker.context.artifacts, &worker.context.database, &config.work.data).await?;
        let has_copies = config.work.artifacts.is_none();
        library::unused::tidy(&worker.context.database, &config.work.data, has_copies).await?;
        let has_tokens = worker.context.database.has_tokens().await;
        if open && !has_tokens.map_err(|error| format!("the tokens cannot be read: {error}"))? {
            return Err(format!(
                "--listen {}: other hosts could submit work without a token; make one with `rotortwin token create NAME`, or use a \
                 loopback address such as 127.0.0.1:8400",
                config.listen
            ));
        }
        let listener = TcpListener::bind(config.listen)
            .await
            .map_err(|error| format!("--listen {}: cannot listen there: {error}", config.listen))?;
        let address = listener
            .local_addr()
            .map_err(|error| format!("the address cannot be read: {error}"))?;
        if let Some(ray) = &worker.context.ray {
            let scheme = if acceptor.is_some() { "https" } else { "http" };
            ray.listens(&format!("{scheme}://{address}"), address.ip().is_unspecified())?;
        }
        let fdi = FdiSessions::open_with(config.fdi, config.fdi_link.as_ref())?;
        let app = Arc::new(App {
            rate: Rate::new(config.rate),
            config,
            hosts,
            shelf,
            database: worker.context.database.clone(),
            artifacts: worker.context.artifacts.clone(),
            context: Arc::clone(&worker.context),
            fdi,
            metrics: Metrics::new(),
            queries: tokio::sync::Semaphore::new(QUERIES_AT_ONCE),
            readers: Readers::new(),
        });
        Ok(Self {
            app,
            worker,
            listener,
            acceptor,
            address,
        })
    }

    /// URL of the server.
    pub fn url(&self) -> String {
        let scheme = if self.acceptor.is_some() { "https" } else { "http" };
        format!("{scheme}://{}", self.address)
    }

    /// Serves until `stop` is ready; jobs still running then are returned to the queue. Slow clients do not delay the shutdown.
    pub async fn run(self, stop: impl Future<Output = ()> + Send + 'static) {
        let tasks = self.worker.start();
        let context = Arc::clone(&self.worker.context);
        let ended = async move {
            stop.await;
            context.ending.send_replace(true);
        };
        let router = routes::router(Arc::clone(&self.app));
        tokio::spawn(ended);
        let ending = self.worker.context.ending.subscribe();
        match self.acceptor {
            None => connections::serve(self.listener, router, ending).await,
            Some(acceptor) => {
                let listener = TlsListener::new(self.listener, acceptor, self.address);
                connections::serve(listener, router, ending).await;
            }
        }
        self.worker.end(tasks).await;
    }
}
