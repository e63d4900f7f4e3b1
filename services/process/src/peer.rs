//! Command-line arguments of a controller or FDI process, and how it serves a run.

use crate::address::DEFAULT_DOMAIN;
use crate::priority::{self, DEFAULT_PRIORITY, parse_priority};
use crate::{EXIT_BAD_INPUT, EXIT_FAILED, LinkAddress, Supervisor, complain};
use clap::Args;
use rotortwin_links::endpoint::{Endpoint, PeerOptions, serve_controller, serve_fdi};
use rotortwin_links::iox2::{Iox2Endpoint, Iox2Options};
use rotortwin_links::zenoh::{self, ZenohOptions};
use rotortwin_proto::Role;
use rotortwin_wire::link::{ControllerPeer, FdiPeer, LinkError, LinkTiming};
use std::process::ExitCode;
use std::time::Duration;

/// Which run, where, how long to wait.
#[derive(Clone, Debug, Args)]
pub struct PeerArgs {
    /// Link to the plant: iceoryx2, iceoryx2:DOMAIN or zenoh:connect=ENDPOINT[,config=FILE]
    #[arg(long)]
    pub link: LinkAddress,
    /// Run to join, as `rotortwin fly --external` prints it
    #[arg(long, value_name = "HEX", value_parser = parse_run_id)]
    pub run_id: u64,
    /// Longest wait for the plant, ms
    #[arg(long, value_name = "MS", default_value_t = 10_000)]
    pub join_timeout: u64,
    /// Longest wait of the plant for the reply to one step, ms; the plant itself may be silent for one and a half times as long
    #[arg(long, value_name = "MS", default_value_t = 5_000)]
    pub step_timeout: u64,
    /// Run on this CPU
    #[arg(long, value_name = "CPU")]
    pub cpu: Option<usize>,
    /// Real-time priority, 1 to 99, and all memory locked
    #[arg(long, value_name = "1-99", num_args = 0..=1, require_equals = true, default_missing_value = DEFAULT_PRIORITY, value_parser = parse_priority)]
    pub priority: Option<u8>,
    /// Exit with this parent process
    #[arg(long, hide = true)]
    pub supervisor_pid: Option<u32>,
}

impl PeerArgs {
    /// Serves one run as its controller; the number of steps if it succeeded.
    pub fn serve_controller(&self, program: &str, controller: &mut impl ControllerPeer) -> ExitCode {
        self.serve(program, Role::Controller, |endpoint, options| match endpoint {
            AnyEndpoint::Iox2(mut endpoint) => serve_controller(endpoint.as_mut(), controller, options),
            AnyEndpoint::Zenoh(mut endpoint) => serve_controller(&mut endpoint, controller, options),
        })
    }

    /// Serves one run as its FDI engine.
    pub fn serve_fdi(&self, program: &str, fdi: &mut impl FdiPeer) -> ExitCode {
        self.serve(program, Role::Fdi, |endpoint, options| match endpoint {
            AnyEndpoint::Iox2(mut endpoint) => serve_fdi(endpoint.as_mut(), fdi, options),
            AnyEndpoint::Zenoh(mut endpoint) => serve_fdi(&mut endpoint, fdi, options),
        })
    }

    fn serve(
        &self,
        program: &str,
        role: Role,
        serve: impl FnOnce(AnyEndpoint, &PeerOptions) -> Result<u64, LinkError>,
    ) -> ExitCode {
        crate::start_logging();
        if let Err(sentence) = self.settle() {
            return complain(program, sentence, EXIT_BAD_INPUT);
        }
        let endpoint = match AnyEndpoint::open(&self.link, role, self.run_id, self.timing().join) {
            Ok(endpoint) => endpoint,
            Err(error) => return complain(program, error, EXIT_BAD_INPUT),
        };
        let options = PeerOptions::new(format!("{program} {}", env!("CARGO_PKG_VERSION")), &self.timing());
        match serve(endpoint, &options) {
            Ok(steps) => {
                tracing::info!(steps, "the run is over");
                ExitCode::SUCCESS
            }
            Err(error) => complain(program, error, EXIT_FAILED),
        }
    }

    fn settle(&self) -> Result<(), String> {
        if let Some(pid) = self.supervisor_pid {
            Supervisor::end_with_parent(pid).map_err(|error| error.to_string())?;
        }
        self.cpu.map_or(Ok(()), pin_to_cpu)?;
        // Before the link starts threads, which inherit it.
        self.priority
            .map_or(Ok(()), priority::take)
            .map_err(|error| error.to_string())
    }

    fn timing(&self) -> LinkTiming {
        LinkTiming {
            join: Duration::from_millis(self.join_timeout),
            step: Duration::from_millis(self.step_timeout),
            ..LinkTiming::default()
        }
    }
}

/// Pins this process to one CPU.
pub fn pin_to_cpu(cpu: usize) -> Result<(), String> {
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    let mut set = rustix::thread::CpuSet::new();
    if cpu < rustix::thread::CpuSet::MAX_CPU {
        set.set(cpu);
    }
    rustix::thread::sched_setaffinity(None, &set)
        .map_err(|error| format!("cannot run on CPU {cpu}, this machine offers {cpus}: {error}"))
}

/// A printed run id: up to 16 hexadecimal digits, not 0.
pub fn parse_run_id(text: &str) -> Result<u64, String> {
    match u64::from_str_radix(text, 16) {
        Ok(run_id) if run_id != 0 => Ok(run_id),
        _ => Err("expected up to 16 hexadecimal digits, not all 0".to_owned()),
    }
}

/// Where the processes of a domain meet.
fn iox2_options(domain: &str) -> Iox2Options {
    let mut options = Iox2Options::default();
    if domain != DEFAULT_DOMAIN {
        // Domains sharing a folder would remove each other's dead processes there, but not their resources elsewhere.
        options.root = options.root.with_file_name(format!("{}{domain}", options.prefix));
    }
    options.prefix.push_str(&format!("{domain}_"));
    options
}

/// One process's end of any link between processes.
pub enum AnyEndpoint {
    /// Shared memory.
    Iox2(Box<Iox2Endpoint>),
    /// TCP.
    Zenoh(Box<dyn Endpoint + Send>),
}

impl AnyEndpoint {
    /// Opens the end of `role` at `address`; tries to connect for up to `limit`.
    pub fn open(address: &LinkAddress, role: Role, run_id: u64, limit: Duration) -> Result<Self, LinkError> {
        let security = address.security().map_err(|reason| LinkError::Transport {
            transport: address.transport(),
            action: "reading the credentials".to_owned(),
            reason,
        })?;
        let options = match address {
            LinkAddress::Iceoryx2 { domain } => {
                return Iox2Endpoint::new(role, run_id, iox2_options(domain))
                    .map(|endpoint| Self::Iox2(Box::new(endpoint)));
            }
            LinkAddress::ZenohListen { endpoint, .. } => ZenohOptions::listen(endpoint.clone()),
            LinkAddress::ZenohConnect { endpoint, .. } => ZenohOptions {
                connect_timeout: limit,
                ..ZenohOptions::connect(endpoint.clone())
            },
        };
        zenoh::open(role, run_id, ZenohOptions { security, ..options }).map(Self::Zenoh)
    }

    /// Removes leftovers of killed processes from shared memory.
    pub fn tidy(address: &LinkAddress) {
        if let LinkAddress::Iceoryx2 { domain } = address
            && let Err(error) = iox2_options(domain).tidy()
        {
            tracing::warn!(%error, "shared memory of killed processes remains until the next run");
        }
    }
}
