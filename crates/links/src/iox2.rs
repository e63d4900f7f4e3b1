//! Shared memory between processes of one host: iceoryx2 publish-subscribe, one event service per process that waits.
//!
//! ```text
//!  service (rotortwin/{run_id}/…)   from                 to                 payload
//!  v1/sensors                       plant                controller, fdi    SensorFrame
//!  v1/command                       controller           plant, fdi         CommandFrame
//!  v1/report                        fdi                  plant              FdiReport
//!  to-plant, to-peers               peers / plant        plant / peers      one byte of kind, then the prost message
//!  wake/plant, …/controller, …/fdi  any other process    that process       event
//! ```
//! A process sleeps in `Listener::timed_wait` of its own event service; nothing spins unless [`Iox2Options::spin`] is set. Queues do
//! not overflow and publishers do not block: a full queue is reported as [`Delivery::Partial`].
//!
//! # Files
//! iceoryx2 keeps files in a root folder and segments in `/dev/shm`. The root is below `/dev/shm` too, so that neither can be lost
//! (or be private to a container) without the other. No configuration file is read and no signal handler is installed.
//!
//! Leftovers of killed processes are removed by the next start on the same root and prefix: by iceoryx2 itself where it can, and
//! completely by an end that finds itself alone there. Liveness is tracked by a file lock that every end holds shared while it
//! lives.
//!
//! # Limits
//! All processes of a run need the same user, `/dev/shm` and iceoryx2 release. There is no authentication below that: any process
//! with the user id can take part.

use crate::endpoint::{Delivery, Endpoint, MAX_FDI_WINDOW, Packet, slug};
use crate::shared_frame::{Named, SharedFrame};
use iceoryx2::node::NodeView as _;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe;
use prost::Message as _;
use rotortwin_proto::{Finish, Join, Ready, Role, Setup};
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame};
use rotortwin_wire::link::{LinkError, role_name};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use std::fs::File;
use std::path::PathBuf;
use std::sync::Once;
use std::time::{Duration, Instant};

/// The name of this transport in errors.
const TRANSPORT: &str = "iceoryx2";

/// Where iceoryx2 keeps its segments on Linux.
const SHARED_MEMORY: &str = "/dev/shm";

/// Free space required before a run. One run needs less than 1 MB; a full file system kills processes (SIGBUS).
const FREE_SPACE: u64 = 4 << 20;

/// Samples in a queue of the 400 Hz loop: the whole window, and a few for repetitions.
const QUEUE: usize = MAX_FDI_WINDOW as usize + 16;

/// Samples in a queue of the handshake.
const CONTROL_QUEUE: usize = 16;

/// Maximum bytes of a handshake message: the largest network is 13 kB. The memory is allocated from the start, because a segment
/// added later is lost, with the last messages in it, if its owner exits before every receiver has seen it.
const CONTROL_BYTES: usize = 32 << 10;

/// Suffixes of the names of iceoryx2's segments.
const SEGMENT_SUFFIXES: [&str; 5] = ["data", "dynamic", "connection", "event_mgmt", "global_mgmt"];

/// Age of a segment without a size from which on nobody is making it any more; that takes microseconds.
const HALF_MADE: Duration = Duration::from_secs(1);

/// How long to retry while another process creates or removes the same service.
const OPEN_RETRY: Duration = Duration::from_secs(1);

/// Event: a packet is in the inbox.
const PACKET: usize = 0;

/// Event: a notifier was dropped in an orderly way.
const LEFT: usize = 1;

/// Where the processes of a host meet, and how they wait.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Iox2Options {
    /// Folder for iceoryx2's files; the same for all processes of a run. Created if missing.
    pub root: PathBuf,
    /// Prefix of every file name, three characters or more; processes with different prefixes do not see each other.
    pub prefix: String,
    /// Number of inbox checks before going to sleep. 0 unless every process of the run has its own core, then about 200.
    pub spin: u32,
}

/// One place per user: `/dev/shm/rotortwin-{uid}`.
impl Default for Iox2Options {
    fn default() -> Self {
        let user = rustix::process::getuid().as_raw();
        Self {
            root: format!("{SHARED_MEMORY}/rotortwin-{user}").into(),
            prefix: format!("rt{user}_"),
            spin: 0,
        }
    }
}

impl Iox2Options {
    fn config(&self) -> Result<Config, LinkError> {
        let mut config = Config::default();
        let root = Path::new(self.files().as_os_str().as_encoded_bytes())
            .map_err(|error| failed(&format!("using the folder {}", self.root.display()), error))?;
        config.global.set_root_path(&root);
        config.global.prefix = FileName::new(self.prefix.as_bytes())
            .map_err(|error| failed(&format!("using the prefix {:?}", self.prefix), error))?;
        config.global.node.cleanup_dead_nodes_on_creation = true;
        config.global.node.cleanup_dead_nodes_on_destruction = true;
        config.global.service.cleanup_dead_nodes_on_open = true;
        Ok(config)
    }

    /// Folder that contains iceoryx2's own files only.
    fn files(&self) -> PathBuf {
        self.root.join("iceoryx2")
    }

    /// Removes leftovers of killed processes, if none is alive here. Every start does that too.
    pub fn tidy(&self) -> Result<(), LinkError> {
        self.enter().map(drop)
    }

    /// Takes the shared lock that marks the folder as in use, after removing leftovers if it was unused.
    fn enter(&self) -> Result<File, LinkError> {
        let problem = |error: std::io::Error| LinkError::Transport {
            transport: TRANSPORT,
            action: format!("using the folder {}", self.root.display()),
            reason: error.to_string(),
        };
        if self.prefix.len() < 3 {
            return Err(failed(
                &format!("using the prefix {:?}", self.prefix),
                "it needs at least three characters",
            ));
        }
        std::fs::create_dir_all(&self.root).map_err(problem)?;
        let lock = self.root.join("lock");
        let lock = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(lock)
            .map_err(problem)?;
        match flock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => self.remove_leftovers(),
            // In use, or another process is just tidying up.
            Err(Errno::WOULDBLOCK) => self.remove_half_made(),
            Err(error) => return Err(problem(error.into())),
        }
        // Between the two locks another process may find itself alone and tidy up: nothing of ours exists yet.
        flock(&lock, FlockOperation::LockShared).map_err(|error| problem(error.into()))?;
        std::fs::create_dir_all(self.prefixes()).map_err(problem)?;
        File::create(self.prefixes().join(&self.prefix)).map_err(problem)?;
        Ok(lock)
    }

    /// Folder with an empty file for every prefix used under this root.
    fn prefixes(&self) -> PathBuf {
        self.root.join("prefixes")
    }

    /// Removes segments that a killed process began and never finished: iceoryx2 waits without end for the size of each when it tidies up
    /// after dead nodes, as every new node does. Those that somebody may just be making are given their time.
    fn remove_half_made(&self) {
        let half_made = || -> Vec<(PathBuf, Duration)> {
            names(std::path::Path::new(SHARED_MEMORY))
                .into_iter()
                .filter(|name| is_segment(name, &self.prefix))
                .filter_map(|name| {
                    let path = PathBuf::from(SHARED_MEMORY).join(name);
                    let meta = std::fs::metadata(&path).ok().filter(|meta| meta.len() == 0)?;
                    Some((path, meta.modified().ok()?.elapsed().unwrap_or_default()))
                })
                .collect()
        };
        let begin = Instant::now();
        while begin.elapsed() < HALF_MADE && half_made().iter().any(|(_, age)| *age < HALF_MADE) {
            std::thread::sleep(Duration::from_millis(5));
        }
        for (path, _) in half_made().into_iter().filter(|(_, age)| *age >= HALF_MADE) {
            match std::fs::remove_file(&path) {
                Ok(()) => tracing::warn!("removed {}, which a killed process left half made", path.display()),
                Err(error) => tracing::warn!("removing {}: {error}", path.display()),
            }
        }
    }

    /// Removes the files of killed processes of any prefix. No process may be alive here.
    fn remove_leftovers(&self) {
        let remove_folder = |folder: PathBuf| match std::fs::remove_dir_all(&folder) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                tracing::warn!("removing {}: {error}", folder.display());
            }
            _ => {}
        };
        remove_folder(self.files());
        let mut prefixes = names(&self.prefixes());
        prefixes.push(self.prefix.clone());
        for name in names(std::path::Path::new(SHARED_MEMORY)) {
            if prefixes.iter().any(|prefix| is_segment(&name, prefix)) {
                let path = PathBuf::from(SHARED_MEMORY).join(name);
                match std::fs::remove_file(&path) {
                    Ok(()) => tracing::debug!("removed {} of a killed process", path.display()),
                    Err(error) => tracing::warn!("removing {}: {error}", path.display()),
                }
            }
        }
        remove_folder(self.prefixes());
    }
}

fn failed(action: &str, reason: impl std::fmt::Debug) -> LinkError {
    LinkError::Transport {
        transport: TRANSPORT,
        action: action.to_owned(),
        reason: format!("{reason:?}"),
    }
}

/// Retries operations that fail while another process creates or removes the same object.
fn retried<T, E: std::fmt::Debug>(
    action: impl Fn() -> String,
    mut attempt: impl FnMut() -> Result<T, E>,
) -> Result<T, LinkError> {
    let begin = Instant::now();
    loop {
        match attempt() {
            Ok(value) => return Ok(value),
            Err(error) if begin.elapsed() >= OPEN_RETRY => return Err(failed(&action(), error)),
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

/// The names in a folder; empty if it does not exist.
fn names(folder: &std::path::Path) -> Vec<String> {
    std::fs::read_dir(folder).map_or_else(
        |_| Vec::new(),
        |entries| {
            entries
                .flatten()
                .filter_map(|entry| entry.file_name().into_string().ok())
                .collect()
        },
    )
}

/// True for the name of a segment that iceoryx2 created under exactly this prefix: prefix, hash of 40 digits, identity, suffix.
/// (Another prefix may start with this one.)
fn is_segment(name: &str, prefix: &str) -> bool {
    let Some((stem, suffix)) = name.rsplit_once('.') else {
        return false;
    };
    let hash = stem
        .strip_prefix(prefix)
        .and_then(|rest| rest.split_once('_'))
        .map(|(hash, _)| hash);
    SEGMENT_SUFFIXES.contains(&suffix)
        && hash.is_some_and(|hash| hash.len() == 40 && hash.bytes().all(|digit| digit.is_ascii_hexdigit()))
}

/// Bytes available for shared memory.
fn free_space() -> Result<u64, LinkError> {
    let status = rustix::fs::statvfs(SHARED_MEMORY)
        .map_err(|error| failed(&format!("reading the free space of {SHARED_MEMORY}"), error))?;
    Ok(status.f_bavail * status.f_frsize)
}

/// A full `/dev/shm` causes SIGBUS, not an error: check first.
fn check_free_space(free: u64) -> Result<(), LinkError> {
    if free < FREE_SPACE {
        return Err(LinkError::Transport {
            transport: TRANSPORT,
            action: "starting".to_owned(),
            reason: format!(
                "{SHARED_MEMORY} has {} kB free and {} kB are needed; remove files from it or make it larger",
                free >> 10,
                FREE_SPACE >> 10
            ),
        });
    }
    Ok(())
}

type Service = ipc::Service;
type Topic<T> = publish_subscribe::PortFactory<Service, T, ()>;

/// One process's ports. Not `Send`: create it in the thread that uses it.
///
/// Fields are dropped in order: the notifiers inform the others before the ports are closed.
#[derive(Debug)]
pub struct Iox2Endpoint {
    role: Role,
    run_id: u64,
    options: Iox2Options,
    /// By [`slot`]: processes that this one may wake.
    notifiers: Notifiers,
    listener: Listener<Service>,
    sensors_out: Option<Publisher<Service, SharedFrame<SensorFrame>, ()>>,
    sensors_in: Option<Subscriber<Service, SharedFrame<SensorFrame>, ()>>,
    command_out: Option<Publisher<Service, SharedFrame<CommandFrame>, ()>>,
    command_in: Option<Subscriber<Service, SharedFrame<CommandFrame>, ()>>,
    report_out: Option<Publisher<Service, SharedFrame<FdiReport>, ()>>,
    report_in: Option<Subscriber<Service, SharedFrame<FdiReport>, ()>>,
    control_out: Publisher<Service, [u8], ()>,
    control_in: Subscriber<Service, [u8], ()>,
    /// The handshake is checked once after each sleep, not in each step.
    control_due: bool,
    sensors: Topic<SharedFrame<SensorFrame>>,
    command: Topic<SharedFrame<CommandFrame>>,
    report: Topic<SharedFrame<FdiReport>>,
    node: Node<Service>,
    /// Shared: marks the folder as in use.
    _lock: File,
}

/// By [`slot`].
type Notifiers = [Option<Notifier<Service>>; 3];
/// Out, in.
type ControlPorts = (Publisher<Service, [u8], ()>, Subscriber<Service, [u8], ()>);

/// Array index of a role.
fn slot(role: Role) -> Option<usize> {
    match role {
        Role::Plant => Some(0),
        Role::Controller => Some(1),
        Role::Fdi => Some(2),
        Role::Unspecified => None,
    }
}

fn node_name(run_id: u64, role: Role) -> String {
    format!("rotortwin/{run_id:016x}/{}", slug(role))
}

impl Iox2Endpoint {
    /// Creates the ports of `role` in the run `run_id`, after removing leftovers of killed processes.
    pub fn new(role: Role, run_id: u64, options: Iox2Options) -> Result<Self, LinkError> {
        static LOG_LEVEL: Once = Once::new();
        LOG_LEVEL.call_once(|| set_log_level_from_env_or(LogLevel::Fatal));
        if slot(role).is_none() {
            return Err(failed("creating an endpoint", "a role is needed"));
        }
        check_free_space(free_space()?)?;
        let config = options.config()?;
        let lock = options.enter()?;
        let node = node_of(role, run_id, &config, &options.root)?;

        let sensors: Topic<SharedFrame<SensorFrame>> = topic(&node, run_id, "v1/sensors", 2)?;
        let command: Topic<SharedFrame<CommandFrame>> = topic(&node, run_id, "v1/command", 2)?;
        let report: Topic<SharedFrame<FdiReport>> = topic(&node, run_id, "v1/report", 1)?;
        let is = |wanted: Role| role == wanted;
        let sensors_out = is(Role::Plant).then(|| publisher(&sensors, role)).transpose()?;
        let sensors_in = (!is(Role::Plant)).then(|| subscriber(&sensors, role)).transpose()?;
        let command_out = is(Role::Controller).then(|| publisher(&command, role)).transpose()?;
        let command_in = (!is(Role::Controller))
            .then(|| subscriber(&command, role))
            .transpose()?;
        let report_out = is(Role::Fdi).then(|| publisher(&report, role)).transpose()?;
        let report_in = is(Role::Plant).then(|| subscriber(&report, role)).transpose()?;

        let (control_out, control_in) = control_ports(&node, run_id, role)?;
        let (notifiers, listener) = wake_ports(&node, run_id, role)?;
        Ok(Self {
            role,
            run_id,
            options,
            notifiers,
            listener,
            sensors_out,
            sensors_in,
            command_out,
            command_in,
            report_out,
            report_in,
            control_out,
            control_in,
            control_due: true,
            sensors,
            command,
            report,
            node,
            _lock: lock,
        })
    }

    fn send_control(&mut self, kind: u8, body: &[u8]) -> Result<Delivery, LinkError> {
        let action = "sending a message of the hand-shake";
        let sample = self
            .control_out
            .loan_slice_uninit(body.len() + 1)
            .map_err(|error| failed(action, error))?;
        let sample = sample.write_from_fn(|index| if index == 0 { kind } else { body[index - 1] });
        let receivers = sample.send().map_err(|error| failed(action, error))?;
        Ok(if receivers == 0 {
            Delivery::Partial
        } else {
            Delivery::Complete
        })
    }

    fn poll_control(&mut self) -> Result<Option<Packet>, LinkError> {
        while let Some(sample) = self
            .control_in
            .receive()
            .map_err(|error| failed("receiving a message of the hand-shake", error))?
        {
            let Some((&kind, body)) = sample.payload().split_first() else {
                continue;
            };
            let packet = match kind {
                b'J' => Join::decode(body).map(Packet::Join),
                b'S' => Setup::decode(body).map(|setup| Packet::Setup(Box::new(setup))),
                b'R' => Ready::decode(body).map(Packet::Ready),
                b'F' => Finish::decode(body).map(Packet::Finish),
                _ => {
                    tracing::warn!("a message of unknown kind {kind} was dropped");
                    continue;
                }
            };
            match packet {
                Ok(packet) => return Ok(Some(packet)),
                Err(error) => tracing::warn!("a message of the hand-shake was dropped: {error}"),
            }
        }
        Ok(None)
    }

    /// True if a frame is in the inbox.
    fn has_frames(&self) -> bool {
        fn any<T: ZeroCopySend + std::fmt::Debug>(port: &Option<Subscriber<Service, T, ()>>) -> bool {
            port.as_ref().is_some_and(|port| port.has_samples().unwrap_or(false))
        }
        any(&self.command_in) || any(&self.sensors_in)
    }
}

fn service_name(run_id: u64, topic: &str) -> Result<ServiceName, LinkError> {
    let name = format!("rotortwin/{run_id:016x}/{topic}");
    ServiceName::new(&name).map_err(|error| failed(&format!("naming the service {name}"), error))
}

/// The node of `role` in the run; `root`: its folder.
fn node_of(role: Role, run_id: u64, config: &Config, root: &std::path::Path) -> Result<Node<Service>, LinkError> {
    let name = NodeName::new(&node_name(run_id, role)).map_err(|error| failed("naming the node", error))?;
    retried(
        || format!("creating the node in {}", root.display()),
        || {
            NodeBuilder::new()
                .config(config)
                .name(&name)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<Service>()
        },
    )
}

/// Ports of the hand-shake: to the plant from its peers, and back.
fn control_ports(node: &Node<Service>, run_id: u64, role: Role) -> Result<ControlPorts, LinkError> {
    let to_plant = control_topic(node, run_id, "to-plant", 2, 1)?;
    let to_peers = control_topic(node, run_id, "to-peers", 1, 2)?;
    let (outgoing, incoming) = if role == Role::Plant {
        (&to_peers, &to_plant)
    } else {
        (&to_plant, &to_peers)
    };
    let control_out = retried(
        || port_action("publisher", "hand-shake", role),
        || {
            outgoing
                .publisher_builder()
                .initial_max_slice_len(CONTROL_BYTES)
                .allocation_strategy(AllocationStrategy::Static)
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
        },
    )?;
    let control_in = retried(
        || port_action("subscriber", "hand-shake", role),
        || incoming.subscriber_builder().create(),
    )?;
    Ok((control_out, control_in))
}

/// Ports with which the processes of a run wake each other.
fn wake_ports(node: &Node<Service>, run_id: u64, role: Role) -> Result<(Notifiers, Listener<Service>), LinkError> {
    let mut notifiers = [None, None, None];
    let mut listener = None;
    for other in [Role::Plant, Role::Controller, Role::Fdi] {
        let name = service_name(run_id, &format!("wake/{}", slug(other)))?;
        let event = retried(
            || format!("opening {name}"),
            || {
                node.service_builder(&name)
                    .event()
                    .max_listeners(1)
                    .max_notifiers(2)
                    .max_nodes(4)
                    .event_id_max_value(LEFT)
                    .notifier_dropped_event(EventId::new(LEFT))
                    .open_or_create()
            },
        )?;
        if other == role {
            listener = Some(retried(
                || port_action("listener", "event", role),
                || event.listener_builder().create(),
            )?);
        } else if let Some(slot) = slot(other) {
            // The FDI engine sends nothing to the controller.
            if (role, other) != (Role::Fdi, Role::Controller) {
                let notifier = retried(
                    || port_action("notifier", "event", role),
                    || event.notifier_builder().default_event_id(EventId::new(PACKET)).create(),
                )?;
                notifiers[slot] = Some(notifier);
            }
        }
    }
    let listener = listener.ok_or_else(|| failed("creating an endpoint", "a role is needed"))?;
    Ok((notifiers, listener))
}

fn port_action(port: &str, topic: &str, role: Role) -> String {
    format!(
        "creating the {topic} {port} of the {} (is another one already running?)",
        role_name(role)
    )
}

fn topic<T: ZeroCopySend + std::fmt::Debug>(
    node: &Node<Service>,
    run_id: u64,
    topic: &str,
    receivers: usize,
) -> Result<Topic<T>, LinkError> {
    let name = service_name(run_id, topic)?;
    retried(
        || format!("opening {name}"),
        || {
            node.service_builder(&name)
                .publish_subscribe::<T>()
                .max_publishers(1)
                .max_subscribers(receivers)
                .max_nodes(4)
                .subscriber_max_buffer_size(QUEUE)
                .subscriber_max_borrowed_samples(1)
                .history_size(0)
                .enable_safe_overflow(false)
                .open_or_create()
        },
    )
}

fn control_topic(
    node: &Node<Service>,
    run_id: u64,
    topic: &str,
    senders: usize,
    receivers: usize,
) -> Result<Topic<[u8]>, LinkError> {
    let name = service_name(run_id, topic)?;
    retried(
        || format!("opening {name}"),
        || {
            node.service_builder(&name)
                .publish_subscribe::<[u8]>()
                .max_publishers(senders)
                .max_subscribers(receivers)
                .max_nodes(4)
                .subscriber_max_buffer_size(CONTROL_QUEUE)
                .subscriber_max_borrowed_samples(1)
                .history_size(0)
                .enable_safe_overflow(false)
                .open_or_create()
        },
    )
}

fn publisher<T: ZeroCopySend + std::fmt::Debug>(
    topic: &Topic<T>,
    role: Role,
) -> Result<Publisher<Service, T, ()>, LinkError> {
    retried(
        || port_action("publisher", std::any::type_name::<T>(), role),
        || {
            topic
                .publisher_builder()
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
        },
    )
}

fn subscriber<T: ZeroCopySend + std::fmt::Debug>(
    topic: &Topic<T>,
    role: Role,
) -> Result<Subscriber<Service, T, ()>, LinkError> {
    retried(
        || port_action("subscriber", std::any::type_name::<T>(), role),
        || topic.subscriber_builder().create(),
    )
}

/// Copies a frame to its receivers.
fn send_frame<T: Named>(
    port: &Option<Publisher<Service, SharedFrame<T>, ()>>,
    frame: &T,
    receivers: usize,
) -> Result<Delivery, LinkError> {
    let Some(port) = port else {
        return Err(failed("sending a frame", "this role does not send it"));
    };
    let reached = port
        .send_copy(SharedFrame(*frame))
        .map_err(|error| failed("sending a frame", error))?;
    Ok(if reached < receivers {
        Delivery::Partial
    } else {
        Delivery::Complete
    })
}

/// The oldest frame of a queue.
fn receive_frame<T: Named>(port: &Option<Subscriber<Service, SharedFrame<T>, ()>>) -> Result<Option<T>, LinkError> {
    match port {
        Some(port) => {
            let sample = port.receive().map_err(|error| failed("receiving a frame", error))?;
            Ok(sample.map(|sample| sample.payload().0))
        }
        None => Ok(None),
    }
}

impl Endpoint for Iox2Endpoint {
    fn role(&self) -> Role {
        self.role
    }

    fn run_id(&self) -> u64 {
        self.run_id
    }

    fn transport(&self) -> &'static str {
        TRANSPORT
    }

    fn address(&self) -> String {
        format!("iceoryx2 in {}", self.options.root.display())
    }

    #[inline]
    fn send(&mut self, packet: &Packet) -> Result<Delivery, LinkError> {
        match packet {
            Packet::Sensors(frame) => send_frame(&self.sensors_out, frame, 2),
            Packet::Command(frame) => send_frame(&self.command_out, frame, 2),
            Packet::Report(frame) => send_frame(&self.report_out, frame, 1),
            Packet::Join(message) => self.send_control(b'J', &message.encode_to_vec()),
            Packet::Setup(message) => self.send_control(b'S', &message.encode_to_vec()),
            Packet::Ready(message) => self.send_control(b'R', &message.encode_to_vec()),
            Packet::Finish(message) => self.send_control(b'F', &message.encode_to_vec()),
        }
    }

    #[inline]
    fn wake(&mut self, role: Role) -> Result<(), LinkError> {
        if let Some(notifier) = slot(role).and_then(|slot| self.notifiers[slot].as_ref()) {
            notifier.notify().map_err(|error| failed("waking a peer", error))?;
        }
        Ok(())
    }

    #[inline]
    fn poll(&mut self) -> Result<Option<Packet>, LinkError> {
        if self.control_due {
            match self.poll_control()? {
                Some(packet) => return Ok(Some(packet)),
                None => self.control_due = false,
            }
        }
        if let Some(frame) = receive_frame(&self.command_in)? {
            return Ok(Some(Packet::Command(frame)));
        }
        if let Some(frame) = receive_frame(&self.sensors_in)? {
            return Ok(Some(Packet::Sensors(frame)));
        }
        if let Some(frame) = receive_frame(&self.report_in)? {
            return Ok(Some(Packet::Report(frame)));
        }
        Ok(None)
    }

    #[inline]
    fn wait(&mut self, at_most: Duration) -> Result<(), LinkError> {
        self.control_due = true;
        for _ in 0..self.options.spin {
            if self.has_frames() {
                return Ok(());
            }
            std::hint::spin_loop();
        }
        match self.listener.timed_wait(|_| {}, at_most) {
            // A signal that the program handles: check and come back.
            Ok(_) | Err(iceoryx2::port::listener::ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(failed("waiting", error)),
        }
    }

    fn is_gone(&mut self, role: Role, thorough: bool) -> bool {
        let publishers = match role {
            Role::Plant => self.sensors.dynamic_config().number_of_publishers(),
            Role::Controller => self.command.dynamic_config().number_of_publishers(),
            Role::Fdi => self.report.dynamic_config().number_of_publishers(),
            Role::Unspecified => return false,
        };
        if publishers == 0 {
            // Its last messages may be waiting.
            self.control_due = true;
            return true;
        }
        if !thorough {
            return false;
        }
        // A process in another PID namespace: iceoryx2 checks a file lock.
        let wanted = node_name(self.run_id, role);
        let mut is_dead = false;
        let listed = Node::<Service>::list(self.node.config(), |state| {
            if let NodeState::Dead(node) = state
                && node
                    .details()
                    .as_ref()
                    .is_some_and(|details| details.name().as_str() == wanted)
            {
                is_dead = true;
                return CallbackProgression::Stop;
            }
            CallbackProgression::Continue
        });
        if let Err(error) = listed {
            tracing::debug!("listing the nodes: {error:?}");
        }
        self.control_due |= is_dead;
        is_dead
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_too_little_shared_memory_is_one_sentence() {
        assert_eq!(check_free_space(FREE_SPACE), Ok(()));
        let text = check_free_space(100 << 10).expect_err("100 kB are too few").to_string();
        assert_eq!(
            text,
            "iceoryx2: starting failed: /dev/shm has 100 kB free and 4096 kB are needed; remove files from it or make it larger"
        );
        assert!(free_space().is_ok_and(|free| free > 0));
    }

    /// Tidies until `file` is gone: a process being spawned by another test holds our locks until it executes its own program.
    fn until_gone(options: &Iox2Options, file: &std::path::Path) {
        let gone = (0..500).any(|_| {
            options.tidy().expect("a place that can be entered");
            std::thread::sleep(std::time::Duration::from_millis(10));
            !file.exists()
        });
        assert!(gone, "{} was not removed", file.display());
    }

    /// Removes only segments with our prefix, and only if no process is alive there.
    #[test]
    fn scenario_leftovers_are_removed_by_the_first_who_comes() {
        let prefix = format!("rttidy{}_", std::process::id());
        let options = Iox2Options {
            root: format!("{SHARED_MEMORY}/{prefix}root").into(),
            prefix,
            spin: 0,
        };
        let segment = |name: &str| PathBuf::from(SHARED_MEMORY).join(format!("{}{name}", options.prefix));
        let hash = "0123456789abcdef0123456789abcdef01234567";
        let stale = segment(&format!("{hash}_456.event_mgmt"));
        let others = [segment("notes.txt"), segment(&format!("more_{hash}_456.event_mgmt"))];
        let place = || {
            std::fs::write(&stale, "x").expect("a new file");
            others
                .iter()
                .for_each(|other| std::fs::write(other, "x").expect("a new file"));
            std::fs::create_dir_all(options.files().join("nodes")).expect("a new folder");
        };
        place();
        let first = options.enter().expect("an empty place");
        assert!(!stale.exists() && !options.files().exists() && others.iter().all(|other| other.exists()));
        place();
        let second = options.enter().expect("a shared place");
        assert!(stale.exists() && options.files().exists(), "somebody lives here");
        drop(first);
        drop(options.enter().expect("a shared place"));
        assert!(stale.exists(), "somebody still lives here");
        drop(second);
        // Left by a process with another prefix under this root.
        let elsewhere = Iox2Options {
            prefix: format!("{}else_", options.prefix),
            ..options.clone()
        };
        until_gone(&elsewhere, &stale);
        place();
        let stale_elsewhere = segment(&format!("else_{hash}_456.data"));
        std::fs::write(&stale_elsewhere, "x").expect("a new file");
        until_gone(&options, &stale_elsewhere);
        assert!(!stale.exists() && !options.files().exists() && others.iter().all(|other| other.exists()));
        others
            .iter()
            .for_each(|other| std::fs::remove_file(other).expect("it is there"));
        std::fs::remove_dir_all(&options.root).expect("it is there");
    }

    /// Found by a process that was killed while it made a connection: each node that came after it waited for ever, as long as any other lived.
    #[test]
    fn regress_a_segment_that_was_never_finished_is_removed_while_others_live() {
        let prefix = format!("rthalf{}_", std::process::id());
        let options = Iox2Options {
            root: format!("{SHARED_MEMORY}/{prefix}root").into(),
            prefix,
            spin: 0,
        };
        let lives = options.enter().expect("an empty place");
        let hash = "0123456789abcdef0123456789abcdef01234567";
        let segment = |name: &str| PathBuf::from(SHARED_MEMORY).join(format!("{}{hash}_{name}", options.prefix));
        let (half_made, whole) = (segment("1_2.connection"), segment("3_4.connection"));
        std::fs::write(&half_made, "").expect("a new file");
        std::fs::write(&whole, "x").expect("a new file");
        drop(options.enter().expect("a shared place"));
        assert!(!half_made.exists() && whole.exists());
        drop(lives);
        until_gone(&options, &whole);
        std::fs::remove_dir_all(&options.root).expect("it is there");
    }
}
