//! Arguments of `rotortwin serve` and `rotortwin worker`; executed by `rotortwin-network`.

use super::autopilot::ListedAutopilot;
use clap::{Parser, ValueEnum};
use rotortwin_jobs::SeatRole;
use rotortwin_process::LinkAddress;
use std::net::SocketAddr;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::str::FromStr;

/// Where jobs and their files are, and how many are done at the same time.
#[derive(Debug, Parser)]
pub struct WorkArgs {
    /// Data folder of this process: database, and files or copies of them
    #[arg(long, value_name = "DIR", default_value = "data")]
    pub data: PathBuf,
    /// Files of jobs: a folder that all hosts share, or s3://BUCKET[/PREFIX] with the credentials in AWS_… [default: the data folder]
    #[arg(long, value_name = "WHERE", env = "ROTORTWIN_ARTIFACTS")]
    pub artifacts: Option<String>,
    /// postgres://USER:PASSWORD@HOST/DATABASE, shared by servers and workers [default: SQLite in the data folder]
    #[arg(long, value_name = "URL", env = "DATABASE_URL", hide_env_values = true)]
    pub database_url: Option<String>,
    /// Number of jobs executed at the same time [default: half of the CPUs]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=256))]
    pub workers: Option<u16>,
    /// Maximum number of jobs of one tenant executed at the same time
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..))]
    pub tenant_running: u32,
    /// Memory limit of each process of a job, MB
    #[arg(long, value_name = "MB", default_value_t = 4000, value_parser = clap::value_parser!(u64).range(64..=1_000_000))]
    pub job_memory: u64,
    /// An autopilot on this host that runs can name, such as bench-1=ardupilot:127.0.0.1:9002; ,pilot=ADDR|none as 'rotortwin fly --pilot';
    /// may be given several times
    #[arg(long, value_name = "NAME=ADDRESS[,pilot=ADDR|none]")]
    pub autopilot: Vec<ListedAutopilot>,
    /// Runs over zenoh: their plants listen here; port 0: a free one
    #[arg(
        long,
        value_name = "ENDPOINT",
        default_value = "tcp/127.0.0.1:0",
        conflicts_with = "zenoh_router"
    )]
    pub zenoh_listen: String,
    /// Runs over zenoh: all processes connect to this router, e.g. tcp/router:7447
    #[arg(long, value_name = "ENDPOINT", env = "ROTORTWIN_ZENOH_ROUTER")]
    pub zenoh_router: Option<String>,
}

/// Executor of the parts of jobs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Executor {
    /// The server's own workers.
    Embedded,
    /// A Ray cluster, by the address of its dashboard.
    Ray(String),
}

impl FromStr for Executor {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "embedded" {
            return Ok(Self::Embedded);
        }
        let url = text.strip_prefix("ray=").map(|url| url.trim_end_matches('/'));
        let url = url.filter(|url| url.starts_with("http://") || url.starts_with("https://"));
        url.map(|url| Self::Ray(url.to_owned())).ok_or_else(|| {
            "expected embedded, or ray=URL with the address of Ray's dashboard, such as ray=http://HEAD:8265".to_owned()
        })
    }
}

/// An amount of a Ray cluster resource: `NAME=AMOUNT`.
#[derive(Debug, Clone, PartialEq)]
pub struct Resource {
    /// Its name in the cluster.
    pub name: String,
    /// Amount.
    pub amount: f64,
}

impl FromStr for Resource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let split = text.split_once('=').filter(|(name, _)| !name.is_empty());
        let amount = split.and_then(|(_, amount)| amount.parse::<f64>().ok());
        match (split, amount.filter(|amount| *amount > 0.0 && amount.is_finite())) {
            (Some((name, _)), Some(amount)) => Ok(Self {
                name: name.to_owned(),
                amount,
            }),
            _ => Err("expected NAME=AMOUNT, such as flights=1".to_owned()),
        }
    }
}

fn cpus(text: &str) -> Result<f64, String> {
    let cpus = text.parse::<f64>().ok();
    cpus.filter(|cpus| (0.01..=1024.0).contains(cpus))
        .ok_or_else(|| "expected a number from 0.01 to 1024".to_owned())
}

/// What parts take of a Ray cluster, and how its nodes find rotortwin and this server.
#[derive(Debug, Parser)]
pub struct RayArgs {
    /// Ray: number of parts submitted at the same time; queued parts make a cluster scale up
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub ray_parts: u16,
    /// Ray: CPUs per part, and its threads
    #[arg(long, value_name = "N", default_value = "1", value_parser = cpus)]
    pub ray_cpus: f64,
    /// Ray: memory reserved per part, MB [default: none]
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub ray_memory: Option<u64>,
    /// Ray: custom resource of a part, by a name that the cluster knows; may be given several times
    #[arg(long, value_name = "NAME=AMOUNT")]
    pub ray_resource: Vec<Resource>,
    /// Ray: path of the program on the nodes
    #[arg(long, value_name = "PROGRAM", default_value = "rotortwin")]
    pub ray_program: String,
    /// Ray: how the nodes reach this server, such as https://bench.example:8443 [default: where it listens]
    #[arg(long, value_name = "URL")]
    pub ray_callback: Option<String>,
    /// Ray: certificates by which the nodes verify this server (PEM) [default: their own trusted certificates]
    #[arg(long, value_name = "FILE")]
    pub ray_ca: Option<PathBuf>,
}

/// Arguments of `rotortwin serve`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Address to listen on; other than loopback only with a certificate and a token; port 0: a free one
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8400")]
    pub listen: SocketAddr,
    /// Certificate chain (PEM): HTTPS
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    pub tls_cert: Option<PathBuf>,
    /// Private key of the certificate (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    pub tls_key: Option<PathBuf>,
    /// Maximum requests per second of a tenant
    #[arg(
        long = "tenant-rate",
        visible_alias = "rate",
        value_name = "N",
        default_value = "2000"
    )]
    pub rate: NonZeroU32,
    /// Maximum size of the files of a tenant, GB
    #[arg(long, value_name = "GB", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub tenant_gigabytes: u64,
    /// Maximum size of a flight log, MB
    #[arg(long, value_name = "MB", default_value_t = 512, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub largest_upload: u64,
    /// Maximum length of a flight, s of simulated time
    #[arg(long, value_name = "S", default_value_t = 3600, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub longest_flight: u32,
    /// Host name accepted in addition to localhost, e.g. bench.example [default: any, if it listens to other hosts]
    #[arg(long, value_name = "NAME")]
    pub allow_host: Vec<String>,
    /// Pages of this origin may use the API from a browser, e.g. https://bench.example
    #[arg(long, value_name = "ORIGIN")]
    pub cors_origin: Vec<String>,
    /// Scenarios and vehicles that clients can name, laid out as config/ [default: config, if it is there, else the program's own]
    #[arg(long, value_name = "DIR")]
    pub library: Option<PathBuf>,
    /// Maximum number of queued and running jobs of one tenant
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..))]
    pub tenant_jobs: u32,
    /// Where jobs and their files are.
    #[command(flatten)]
    pub work: WorkArgs,
    /// Time limit of an SQL query, s
    #[arg(long = "query-time-limit", visible_alias = "query-time", value_name = "S", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub query_time: u64,
    /// Maximum number of open FDI sessions
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    pub fdi_sessions: u16,
    /// Maximum number of open FDI sessions of one tenant; a server without tokens has a single tenant
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    pub tenant_fdi_sessions: u16,
    /// Idle time after which an FDI session ends, s
    #[arg(long, value_name = "S", default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub fdi_idle: u64,
    /// FDI sessions also take measurements over zenoh: zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT
    #[arg(long, value_name = "LINK")]
    pub fdi_link: Option<LinkAddress>,
    /// Executor of the parts of campaigns and blind benches: the workers of this server, or a Ray cluster, by the address of its dashboard, such as
    /// ray=http://HEAD:8265 (a token of the cluster in ROTORTWIN_RAY_TOKEN); its nodes need rotortwin of the same version
    #[arg(long, value_name = "embedded|ray=URL", default_value = "embedded")]
    pub executor: Executor,
    /// What a part takes of the Ray cluster.
    #[command(flatten)]
    pub ray: RayArgs,
    /// Print the OpenAPI document and exit
    #[arg(long)]
    pub openapi: bool,
}

/// What a worker does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Role {
    /// Jobs: flights with their plants, campaigns, diagnoses
    Jobs,
    /// Controllers of runs that are flown elsewhere
    Controller,
    /// FDI engines of runs that are flown elsewhere
    Fdi,
}

impl Role {
    /// The seat in a run's offer, if any.
    pub const fn seat(self) -> Option<SeatRole> {
        match self {
            Self::Jobs => None,
            Self::Controller => Some(SeatRole::Controller),
            Self::Fdi => Some(SeatRole::Fdi),
        }
    }
}

/// Arguments of `rotortwin worker`.
#[derive(Debug, Parser)]
pub struct WorkerArgs {
    /// Roles of the worker
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "jobs",
        value_name = "ROLES"
    )]
    pub roles: Vec<Role>,
    /// Number of controllers and FDI engines that run at the same time
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=256))]
    pub seats: u16,
    /// Where jobs and their files are.
    #[command(flatten)]
    pub work: WorkArgs,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_executors_and_resources_are_read_or_refused() {
        let ray = Executor::Ray("http://head:8265".to_owned());
        assert_eq!("ray=http://head:8265/".parse(), Ok(ray));
        assert_eq!("embedded".parse(), Ok(Executor::Embedded));
        for bad in [
            "",
            "ray",
            "ray=",
            "ray=head:8265",
            "ray=ray://head:10001",
            "dask=http://a",
        ] {
            let refusal = bad.parse::<Executor>().unwrap_err();
            assert!(refusal.contains("expected embedded, or ray=URL"), "{bad}: {refusal}");
        }
        let resource = "flights=0.5".parse::<Resource>().unwrap();
        assert_eq!((resource.name.as_str(), resource.amount), ("flights", 0.5));
        for bad in [
            "flights",
            "=1",
            "flights=",
            "flights=-1",
            "flights=0",
            "flights=inf",
            "flights=nan",
        ] {
            assert!(bad.parse::<Resource>().is_err(), "{bad}");
        }
        assert!(cpus("0").is_err() && cpus("2").is_ok());
    }
}
