//! `rotortwin serve` and `rotortwin worker`: jobs over HTTP, and more hands for them on other hosts.

use crate::output::{bad_input, failed, line};
use clap::{Parser, ValueEnum};
use rotortwin_api::{FdiLimits, ServeConfig, Server, WorkConfig, Worker};
use rotortwin_process::LinkAddress;
use std::net::SocketAddr;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Where jobs and their files are, and how many are done at the same time.
#[derive(Debug, Parser)]
struct WorkArgs {
    /// Folder of this process: database, files or copies of them
    #[arg(long, value_name = "DIR", default_value = "data")]
    data: PathBuf,
    /// Files of jobs: a folder that all hosts share, or s3://BUCKET[/PREFIX] with the credentials in AWS_… [default: the data folder]
    #[arg(long, value_name = "WHERE", env = "ROTORTWIN_ARTIFACTS")]
    artifacts: Option<String>,
    /// postgres://USER:PASSWORD@HOST/DATABASE, shared by servers and workers [default: SQLite in the data folder]
    #[arg(long, value_name = "URL", env = "DATABASE_URL", hide_env_values = true)]
    database_url: Option<String>,
    /// Jobs that are done at the same time [default: half of the CPUs]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=256))]
    workers: Option<u16>,
    /// Jobs of one tenant that are done at the same time, at most
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..))]
    tenant_running: u32,
    /// Memory that each process of a job may take, MB
    #[arg(long, value_name = "MB", default_value_t = 4000, value_parser = clap::value_parser!(u64).range(64..=1_000_000))]
    job_memory: u64,
    /// Runs over zenoh: their plants listen here; port 0: a free one
    #[arg(
        long,
        value_name = "ENDPOINT",
        default_value = "tcp/127.0.0.1:0",
        conflicts_with = "zenoh_router"
    )]
    zenoh_listen: String,
    /// Runs over zenoh: all processes connect to this router, e.g. tcp/router:7447
    #[arg(long, value_name = "ENDPOINT", env = "ROTORTWIN_ZENOH_ROUTER")]
    zenoh_router: Option<String>,
}

impl WorkArgs {
    fn config(&self, roles: &[Role], seats: usize) -> Result<WorkConfig, String> {
        let program =
            std::env::current_exe().map_err(|error| format!("the path of this program cannot be read: {error}"))?;
        let cpus = std::thread::available_parallelism().map_or(1, usize::from);
        let does_jobs = roles.contains(&Role::Jobs);
        Ok(WorkConfig {
            data: self.data.clone(),
            database_url: self.database_url.clone(),
            artifacts: self.artifacts.clone(),
            workers: match self.workers {
                _ if !does_jobs => 0,
                Some(workers) => usize::from(workers),
                None => (cpus / 2).max(1),
            },
            seats,
            roles: roles.iter().filter_map(|role| role.seat()).map(str::to_owned).collect(),
            most_running: self.tenant_running,
            job_memory: self.job_memory * 1_000_000,
            zenoh_listen: self.zenoh_listen.clone(),
            zenoh_router: self.zenoh_router.clone(),
            program,
            name: format!("{}-{}", rotortwin_links::host_name(), std::process::id()),
        })
    }
}

/// Arguments of `rotortwin serve`.
#[derive(Debug, Parser)]
pub(crate) struct Args {
    /// Address to listen on; other than loopback only with a certificate and a token; port 0: a free one
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8400")]
    listen: SocketAddr,
    /// Certificate chain (PEM): HTTPS
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// Private key of the certificate (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// Requests of a tenant per second, at most
    #[arg(long, value_name = "N", default_value = "2000")]
    rate: NonZeroU32,
    /// Files of a tenant, GB, at most
    #[arg(long, value_name = "GB", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    tenant_gigabytes: u64,
    /// Largest flight log that is taken, MB
    #[arg(long, value_name = "MB", default_value_t = 512, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    largest_upload: u64,
    /// Longest flight that is taken, s of simulated time
    #[arg(long, value_name = "S", default_value_t = 3600, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    longest_flight: u32,
    /// Name by which the server may be called, beside localhost, e.g. bench.example [default: any, if it listens to other hosts]
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,
    /// Pages of this origin may use the API from a browser, e.g. https://bench.example
    #[arg(long, value_name = "ORIGIN")]
    cors_origin: Vec<String>,
    /// Scenarios and vehicles that clients can name, laid out as config/ [default: config, if it is there, else the program's own]
    #[arg(long, value_name = "DIR")]
    library: Option<PathBuf>,
    /// Jobs of one tenant that wait or run, at most
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..))]
    tenant_jobs: u32,
    #[command(flatten)]
    work: WorkArgs,
    /// FDI sessions that are open at the same time
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    fdi_sessions: u16,
    /// An FDI session ends when nothing is asked of it for so long, s
    #[arg(long, value_name = "S", default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    fdi_idle: u64,
    /// FDI sessions also take measurements over zenoh: zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT
    #[arg(long, value_name = "LINK")]
    fdi_link: Option<LinkAddress>,
    /// Print the OpenAPI document and end
    #[arg(long)]
    openapi: bool,
}

/// What a worker does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Role {
    /// Jobs: flights with their plants, campaigns, diagnoses
    Jobs,
    /// Controllers of runs that are flown elsewhere
    Controller,
    /// FDI engines of runs that are flown elsewhere
    Fdi,
}

impl Role {
    fn seat(self) -> Option<&'static str> {
        match self {
            Self::Jobs => None,
            Self::Controller => Some("controller"),
            Self::Fdi => Some("fdi"),
        }
    }
}

/// Arguments of `rotortwin worker`.
#[derive(Debug, Parser)]
pub(crate) struct WorkerArgs {
    /// What it does
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "jobs",
        value_name = "ROLES"
    )]
    roles: Vec<Role>,
    /// Controllers and FDI engines that run at the same time
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=256))]
    seats: u16,
    #[command(flatten)]
    work: WorkArgs,
}

/// Where what clients can name lies.
fn library(args: &Args) -> std::io::Result<PathBuf> {
    if let Some(library) = &args.library {
        return Ok(library.clone());
    }
    let here = PathBuf::from("config");
    if here.join("scenarios").is_dir() {
        Ok(here)
    } else {
        rotortwin_scenario::shipped::folder()
    }
}

/// Serves until Ctrl-C or SIGTERM.
pub(crate) fn run(args: &Args) -> ExitCode {
    if args.openapi {
        print!("{}", rotortwin_api::openapi_document());
        return ExitCode::SUCCESS;
    }
    rotortwin_process::start_logging();
    let work = match args.work.config(&[Role::Jobs], 0) {
        Ok(work) => work,
        Err(sentence) => return failed(sentence),
    };
    let library = match library(args) {
        Ok(library) => library,
        Err(error) => return failed(format!("the program's own configuration cannot be laid out: {error}")),
    };
    let config = ServeConfig {
        listen: args.listen,
        tls: args.tls_cert.clone().zip(args.tls_key.clone()),
        rate: args.rate,
        most_bytes: args.tenant_gigabytes * 1_000_000_000,
        largest_upload: args.largest_upload * 1_000_000,
        longest_flight_s: f64::from(args.longest_flight),
        allowed_hosts: args.allow_host.clone(),
        cors_origins: args.cors_origin.clone(),
        library,
        most_open: args.tenant_jobs,
        work,
        fdi: FdiLimits {
            sessions: usize::from(args.fdi_sessions),
            idle: Duration::from_secs(args.fdi_idle),
        },
        fdi_link: args.fdi_link.clone(),
    };
    in_runtime(async {
        let server = match Server::open(config).await {
            Ok(server) => server,
            Err(sentence) => return bad_input(sentence),
        };
        line(&format!("Serving      {}", server.url()));
        server.run(stopped()).await;
        ExitCode::SUCCESS
    })
}

/// Works until Ctrl-C or SIGTERM.
pub(crate) fn work(args: &WorkerArgs) -> ExitCode {
    rotortwin_process::start_logging();
    if args.work.database_url.is_none() {
        return bad_input(
            "a worker takes jobs from a database that it shares with a server; expected DATABASE_URL or --database-url postgres://…",
        );
    }
    let seats = if args.roles.iter().any(|role| role.seat().is_some()) {
        usize::from(args.seats)
    } else {
        0
    };
    let config = match args.work.config(&args.roles, seats) {
        Ok(config) => config,
        Err(sentence) => return failed(sentence),
    };
    in_runtime(async {
        let name = config.name.clone();
        let worker = match Worker::open(config).await {
            Ok(worker) => worker,
            Err(sentence) => return bad_input(sentence),
        };
        line(&format!("Working      {name}"));
        worker.run(stopped()).await;
        ExitCode::SUCCESS
    })
}

/// Threads that compute may take this long when the process ends.
const LAST_THREADS: Duration = Duration::from_millis(500);

pub(crate) fn in_runtime(future: impl Future<Output = ExitCode>) -> ExitCode {
    match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => {
            let code = runtime.block_on(future);
            // What still computes is not waited for.
            runtime.shutdown_timeout(LAST_THREADS);
            code
        }
        Err(error) => failed(format!("the threads cannot be started: {error}")),
    }
}

/// Ready once somebody wants the process to end. If he wants it a second time, it ends at once; jobs that it has begun are begun again.
async fn stopped() {
    use tokio::signal::unix::{Signal, SignalKind, signal};
    async fn either(terminate: &mut Signal) {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminate.recv() => {}
        }
    }
    match signal(SignalKind::terminate()) {
        Ok(mut terminate) => {
            either(&mut terminate).await;
            tokio::spawn(async move {
                either(&mut terminate).await;
                eprintln!("Ended at once by a second signal");
                std::process::exit(1);
            });
        }
        Err(error) => {
            tracing::warn!(%error, "SIGTERM cannot be handled");
            if let Err(error) = tokio::signal::ctrl_c().await {
                tracing::warn!(%error, "Ctrl-C cannot be handled");
            }
        }
    }
}
