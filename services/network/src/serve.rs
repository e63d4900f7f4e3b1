//! `rotortwin serve` and `rotortwin worker`: jobs over HTTP, and additional workers on other hosts.

use rotortwin_api::{Autopilot, FdiLimits, RayConfig, ServeConfig, Server, WorkConfig, Worker};
use rotortwin_cli::network::autopilot::ListedAutopilot;
use rotortwin_cli::network::serve::{Args, Executor, Role, WorkArgs, WorkerArgs};
use rotortwin_cli::output::{bad_input, failed, line};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

fn work_config(args: &WorkArgs, roles: &[Role], seats: usize) -> Result<WorkConfig, String> {
    let program =
        std::env::current_exe().map_err(|error| format!("the path of this program cannot be read: {error}"))?;
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    let does_jobs = roles.contains(&Role::Jobs);
    Ok(WorkConfig {
        data: args.data.clone(),
        database_url: args.database_url.clone(),
        artifacts: args.artifacts.clone(),
        workers: match args.workers {
            _ if !does_jobs => 0,
            Some(workers) => usize::from(workers),
            None => (cpus / 2).max(1),
        },
        seats,
        roles: roles.iter().filter_map(|role| role.seat()).collect(),
        most_running: args.tenant_running,
        job_memory: args.job_memory * 1_000_000,
        autopilots: args.autopilot.iter().map(listed).collect(),
        zenoh_listen: args.zenoh_listen.clone(),
        zenoh_router: args.zenoh_router.clone(),
        program,
        name: format!("{}-{}", rotortwin_links::host_name(), std::process::id()),
        ray: None,
    })
}

/// The cluster that runs the parts, if there is one.
fn ray_config(args: &Args) -> Result<Option<RayConfig>, String> {
    let Executor::Ray(url) = &args.executor else {
        return Ok(None);
    };
    let ray = &args.ray;
    if let Some(callback) = &ray.ray_callback {
        let is_url =
            reqwest::Url::parse(callback).is_ok_and(|url| matches!(url.scheme(), "http" | "https") && url.has_host());
        if !is_url {
            return Err(format!(
                "--ray-callback {callback}: expected an address such as https://bench.example:8443"
            ));
        }
    }
    Ok(Some(RayConfig {
        url: url.clone(),
        token: std::env::var(RAY_TOKEN).ok().filter(|token| !token.is_empty()),
        parts: usize::from(ray.ray_parts),
        cpus: ray.ray_cpus,
        memory: ray.ray_memory.map(|memory| memory * 1_000_000),
        resources: ray
            .ray_resource
            .iter()
            .map(|resource| (resource.name.clone(), resource.amount))
            .collect(),
        program: ray.ray_program.clone(),
        callback: ray.ray_callback.clone(),
        ca: ray.ray_ca.clone(),
    }))
}

fn listed(autopilot: &ListedAutopilot) -> Autopilot {
    Autopilot {
        name: autopilot.name.clone(),
        protocol: autopilot.address.protocol.name().to_owned(),
        lockstep: autopilot.address.protocol.lockstep(),
        address: autopilot.address.to_string(),
        pilot: autopilot.pilot.clone(),
    }
}

/// Two concurrent runs with one autopilot, or a listed one that no worker can reach, would be detected too late.
fn check_autopilots(work: &WorkConfig) -> Result<(), String> {
    for (place, one) in work.autopilots.iter().enumerate() {
        for other in &work.autopilots[..place] {
            if other.name == one.name || other.address == one.address {
                return Err(format!(
                    "--autopilot {}={}: {} is already configured; choose another name and another address",
                    one.name,
                    one.address,
                    if other.name == one.name {
                        &one.name
                    } else {
                        &one.address
                    }
                ));
            }
        }
    }
    if work.workers == 0 && !work.autopilots.is_empty() {
        return Err(
            "--autopilot: no worker here would fly with it; expected --workers of at least 1, and the role jobs"
                .to_owned(),
        );
    }
    Ok(())
}

/// A token for the Ray cluster.
const RAY_TOKEN: &str = "ROTORTWIN_RAY_TOKEN";

/// Folders of the documents that clients can name.
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
    let mut work = match work_config(&args.work, &[Role::Jobs], 0) {
        Ok(work) => work,
        Err(sentence) => return failed(sentence),
    };
    work.ray = match ray_config(args) {
        Ok(ray) => ray,
        Err(sentence) => return bad_input(sentence),
    };
    if let Err(sentence) = check_autopilots(&work) {
        return bad_input(sentence);
    }
    let library = match library(args) {
        Ok(library) => library,
        Err(error) => return failed(format!("the program's own configuration cannot be written: {error}")),
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
        query_time: Duration::from_secs(args.query_time),
        work,
        fdi: FdiLimits {
            sessions: usize::from(args.fdi_sessions),
            tenant_sessions: usize::from(args.tenant_fdi_sessions),
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
    let config = match work_config(&args.work, &args.roles, seats) {
        Ok(config) => config,
        Err(sentence) => return failed(sentence),
    };
    if let Err(sentence) = check_autopilots(&config) {
        return bad_input(sentence);
    }
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

/// Time for computing threads when the process ends.
const LAST_THREADS: Duration = Duration::from_millis(500);

pub(crate) fn in_runtime(future: impl Future<Output = ExitCode>) -> ExitCode {
    rotortwin_api::memory::keep_together();
    match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => {
            let code = runtime.block_on(future);
            // Threads that are still computing are not waited for.
            runtime.shutdown_timeout(LAST_THREADS);
            code
        }
        Err(error) => failed(format!("the threads cannot be started: {error}")),
    }
}

/// Ready once the process is asked to end. A second request ends it immediately; jobs in progress are restarted.
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
                eprintln!("Terminated by a second signal");
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
