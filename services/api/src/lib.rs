//! The HTTP server of rotortwin: takes jobs from afar, flies them, and exposes runs and results.
//!
//! ```text
//!  HTTP ─▶ routes ─▶ store (SQLite) ◀─ workers ─▶ rotortwin fly ─▶ sim, controller, fdi
//!            │           ▲                │
//!            └── hub: "look again" ───────┘          runs/ID/ATTEMPT/: report.html, telemetry.parquet, run.mcap, summary.json
//! ```
//! An answer 202 means that the run is on disk; from then on it ends as done, failed or canceled, whatever dies in between. What is said
//! about a run (state, events) is read from the database alone, so that it survives a restart and nobody misses an event.
//!
//! Binds to loopback addresses only: it has no authentication yet.

mod clock;
mod data_folder;
mod hub;
mod library;
mod problem;
mod routes;
mod store;
mod worker;

use crate::data_folder::DataFolder;
use crate::hub::Hub;
use crate::library::Library;
use crate::store::Store;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;

pub use problem::Problem;
pub use routes::openapi_document;

/// Flights that were begun may take this long to be put back into the queue when the server ends.
const END_GRACE: Duration = Duration::from_secs(5);

/// What the server needs to know.
#[derive(Debug, Clone)]
pub struct ServeConfig {
    /// Where it listens; loopback only.
    pub listen: SocketAddr,
    /// Database and run folders; one server each.
    pub data: PathBuf,
    /// Scenarios and vehicles, laid out as `config/` of the project.
    pub library: PathBuf,
    /// Runs that are flown at the same time.
    pub workers: usize,
    /// The `rotortwin` program.
    pub program: PathBuf,
}

/// Everything that routes and workers share.
#[derive(Debug)]
pub(crate) struct App {
    pub(crate) config: ServeConfig,
    pub(crate) folder: DataFolder,
    pub(crate) library: Library,
    pub(crate) store: Store,
    pub(crate) hub: Arc<Hub>,
    /// Becomes true when the server ends.
    pub(crate) ending: watch::Sender<bool>,
}

/// A server that listens and works.
pub struct Server {
    app: Arc<App>,
    listener: TcpListener,
    address: SocketAddr,
}

impl Server {
    /// Opens folder, database and socket, and queues again what a server that died had begun.
    ///
    /// # Errors
    /// One sentence: what, where, what was expected.
    pub async fn open(config: ServeConfig) -> Result<Self, String> {
        if !config.listen.ip().is_loopback() {
            return Err(format!(
                "--listen {}: other hosts could submit work without a token; expected a loopback address such as 127.0.0.1:8400",
                config.listen
            ));
        }
        let library = Library::open(&config.library)?;
        let folder = DataFolder::open(&config.data)?;
        let store = Store::open(&folder.database_url())
            .await
            .map_err(|error| format!("{}: the database cannot be opened: {error}", folder.path().display()))?;
        let abandoned = store
            .requeue_abandoned(i64::MAX)
            .await
            .map_err(|error| format!("the queue cannot be read: {error}"))?;
        for id in &abandoned {
            tracing::info!(run = id, "a server that died had begun this run: queued again");
        }
        let listener = TcpListener::bind(config.listen)
            .await
            .map_err(|error| format!("--listen {}: cannot listen there: {error}", config.listen))?;
        let address = listener
            .local_addr()
            .map_err(|error| format!("the address cannot be read: {error}"))?;
        let app = Arc::new(App {
            config,
            folder,
            library,
            store,
            hub: Arc::new(Hub::default()),
            ending: watch::channel(false).0,
        });
        Ok(Self { app, listener, address })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `stop` is ready; runs that are flown then go back into the queue.
    ///
    /// # Errors
    /// The socket fails.
    pub async fn run(self, stop: impl Future<Output = ()> + Send + 'static) -> Result<(), String> {
        let mut workers = tokio::task::JoinSet::new();
        for _ in 0..self.app.config.workers {
            workers.spawn(worker::work(Arc::clone(&self.app)));
        }
        workers.spawn(worker::look_after_claims(Arc::clone(&self.app)));
        let app = Arc::clone(&self.app);
        let ended = async move {
            stop.await;
            app.ending.send_replace(true);
        };
        let served = axum::serve(self.listener, routes::router(Arc::clone(&self.app)))
            .with_graceful_shutdown(ended)
            .await
            .map_err(|error| format!("the server failed: {error}"));
        self.app.ending.send_replace(true);
        let all = async { while workers.join_next().await.is_some() {} };
        if tokio::time::timeout(END_GRACE, all).await.is_err() {
            tracing::warn!("some flights did not end in time; the next start flies them again");
        }
        self.app.store.close().await;
        served
    }
}
