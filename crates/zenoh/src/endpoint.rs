//! TCP between hosts (or on one): zenoh publish-subscribe, prost messages.
//!
//! ```text
//!  key (SPACE/v1/RUN/…)             from                 to                 payload
//!  sensors                          plant                controller         SensorFrame
//!  command                          controller           plant              MotorCommand
//!  steps                            plant                fdi                MeasuredSteps, every `fdi_batch` steps
//!  reports                          fdi                  plant              FdiReports, every `fdi_batch` steps
//!  join/ROLE, ready/ROLE            that peer            plant              Join, Ready
//!  setup/controller, setup/fdi      plant                that peer          Setup
//!  finish                           plant                peers              Finish
//!  alive/plant, …/controller, …/fdi that process         all                liveliness token
//! ```
//! Endpoints are configured explicitly, there is no discovery: either the plant listens and the peers connect to it (it routes
//! for them, no other program is needed), or all connect to a router. Scouting, gossip and the admin space are off.
//!
//! A message costs about as much as all the computation of a step, so the FDI engine does not get one per step: the plant, which has
//! both, forwards sensors and commands in lists of `fdi_batch` steps, and receives lists of reports.
//!
//! A process that dies closes its TCP connection; the router then withdraws its liveliness token, and the others know within
//! milliseconds. A host that vanishes without closing its connections is noticed after the lease of 2 s, or as silence.
//!
//! SPACE is `rotortwin` unless [`Security`] sets another; RUN is the run id in 16 hexadecimal digits.
//!
//! # Limits
//! Without [`Security`] no authentication and no encryption: listen on the loopback interface or in a trusted network. Several times
//! slower than shared memory.

use prost::Message;
use rotortwin_links::endpoint::{Delivery, Endpoint, Packet, malformed, slug};
use rotortwin_links::security::{Attachment, Runs, Security};
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_proto::{self as proto, Role, Setup, setup::Parameters};
use rotortwin_wire::convert::ConvertError;
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame};
use rotortwin_wire::link::{LinkError, role_name};
use std::collections::VecDeque;
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use zenoh::Wait as _;
use zenoh::config::EndPoint;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::SampleKind;

/// The name of this transport in errors.
const TRANSPORT: &str = "zenoh";

/// Maximum number of steps or reports in one list.
const LONGEST_LIST: usize = 64;

/// Maximum bytes of a message. The low-latency transport does not fragment messages; it closes the connection over one longer than a
/// batch of 65535 bytes. The largest Setup has 15 kB, the longest list 25 kB.
pub const LONGEST_MESSAGE: usize = 60_000;

/// Bytes of a connection's send buffer, as far as the kernel allows. 256 steps in lists of 1 to 32 have at most 200 kB.
const SEND_BUFFER: u32 = 2_000_000;

fn config(options: &ZenohOptions, runs: Runs) -> Result<zenoh::Config, LinkError> {
    let malformed = |reason: String| LinkError::Transport {
        transport: TRANSPORT,
        action: format!("reading the endpoint {:?}", options.endpoint),
        reason,
    };
    options
        .endpoint
        .parse::<EndPoint>()
        .map_err(|error| malformed(format!("{error}; expected something like \"tcp/127.0.0.1:7447\"")))?;
    let protocol = match options.endpoint.split_once('/') {
        Some((protocol @ ("tcp" | "tls"), _)) => protocol,
        _ => {
            return Err(malformed(
                "only \"tcp/address:port\" and \"tls/address:port\" are supported".to_owned(),
            ));
        }
    };
    match &options.security {
        Some(security) => security
            .check(&options.endpoint, &options.attachment)
            .map_err(malformed)?,
        None if protocol == "tls" => {
            return Err(malformed("tls needs the files of a certificate authority".to_owned()));
        }
        None => {}
    }
    let listens = options.attachment == Attachment::Listen;
    let (listen, connect) = if listens {
        (Some(&options.endpoint), None)
    } else {
        (None, Some(&options.endpoint))
    };
    let list = |endpoint: Option<&String>| endpoint.map_or_else(|| "[]".to_owned(), |it| format!("[{it:?}]"));
    let timeout = options.connect_timeout.as_millis().max(1);
    let mut config = zenoh::Config::default();
    let settings = [
        ("mode", if listens { "\"router\"" } else { "\"client\"" }.to_owned()),
        ("listen/endpoints", list(listen)),
        ("listen/exit_on_failure", "true".to_owned()),
        ("connect/endpoints", list(connect)),
        ("connect/timeout_ms", timeout.to_string()),
        ("connect/exit_on_failure", "true".to_owned()),
        // The other side may start slightly later.
        (
            "connect/retry",
            "{ period_init_ms: 20, period_max_ms: 200, period_increase_factor: 1.5 }".to_owned(),
        ),
        ("scouting/multicast/enabled", "false".to_owned()),
        // With scouting off there is nothing to wait for; the default is half a second.
        ("scouting/delay", "0".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        ("adminspace/enabled", "false".to_owned()),
        ("transport/link/protocols", format!("[{protocol:?}]")),
        ("transport/link/tx/lease", "2000".to_owned()),
        // A window of steps must fit. A sender whose buffer is full blocks inside zenoh, and if the receiver's host has vanished it
        // blocks forever: zenoh's low-latency transport notices the lease and then waits for the same sender.
        ("transport/link/tcp/so_sndbuf", SEND_BUFFER.to_string()),
        ("transport/link/tls/so_sndbuf", SEND_BUFFER.to_string()),
        // One thread less between us and the socket; with a router that does not support it, it is not used.
        ("transport/unicast/lowlatency", "true".to_owned()),
        ("transport/unicast/qos/enabled", "false".to_owned()),
    ];
    let secure = options
        .security
        .iter()
        .flat_map(|security| security.settings(&options.attachment, runs));
    for (key, value) in settings.into_iter().chain(secure) {
        config
            .insert_json5(key, &value)
            // The value may contain a password.
            .map_err(|error| failed(&format!("setting {key}"), error))?;
    }
    Ok(config)
}

/// Opens a session; the error message says as much as this side can know.
pub(crate) fn open(options: &ZenohOptions, runs: Runs) -> Result<zenoh::Session, LinkError> {
    zenoh::open(config(options, runs)?).wait().map_err(|error| {
        let action = match options.attachment {
            Attachment::Listen => format!("listening on {}", options.endpoint),
            Attachment::Connect => {
                format!(
                    "connecting to {} for {} ms",
                    options.endpoint,
                    options.connect_timeout.as_millis()
                )
            }
        };
        // zenoh's own text names zenoh's source files.
        tracing::debug!("{action}: {error}");
        let reason = match options.attachment {
            Attachment::Listen if options.security.is_some() => {
                "the address is not one of this host, or is in use, or the certificate, key or users file is invalid"
                    .to_owned()
            }
            Attachment::Listen => "the address is not one of this host, or is in use".to_owned(),
            Attachment::Connect => refusal(options),
        };
        failed(&action, reason)
    })
}

/// Why no connection was possible at the endpoint.
fn refusal(options: &ZenohOptions) -> String {
    let place = options.endpoint.split_once('/').map_or("", |(_, place)| place);
    let answers = place.to_socket_addrs().is_ok_and(|mut addresses| {
        addresses.any(|address| TcpStream::connect_timeout(&address, Duration::from_secs(1)).is_ok())
    });
    match &options.security {
        _ if !answers => "no response there".to_owned(),
        Some(security) => format!(
            "a process listens there, but one side rejects the other: this \
                 process {}; set ROTORTWIN_LOG=warn,zenoh=debug on both sides for details",
            security.shown()
        ),
        None => "a process listens there, but rejects this one, which presents no certificate and no user; \
                     expected a plant or router without access control, or config=FILE after the endpoint"
            .to_owned(),
    }
}

/// A zenoh router with our configuration, for runs whose processes all connect.
#[derive(Debug)]
pub struct ZenohRouter {
    session: zenoh::Session,
}

impl ZenohRouter {
    /// Listens on `endpoint` until it is dropped or closed.
    pub fn listen(endpoint: impl Into<String>, security: Option<Security>) -> Result<Self, LinkError> {
        let options = ZenohOptions {
            security,
            ..ZenohOptions::listen(endpoint)
        };
        Ok(Self {
            session: open(&options, Runs::All)?,
        })
    }

    /// Closes all connections in an orderly way.
    pub fn close(self) -> Result<(), LinkError> {
        self.session
            .close()
            .wait()
            .map_err(|error| failed("closing the router", error))
    }
}

pub(crate) fn failed(action: &str, reason: impl std::fmt::Display) -> LinkError {
    LinkError::Transport {
        transport: TRANSPORT,
        action: action.to_owned(),
        reason: reason.to_string(),
    }
}

/// Content of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    /// From a process claiming this role.
    Join(Role),
    Setup,
    /// The same.
    Ready(Role),
    Sensors,
    Command,
    Steps,
    Reports,
    Finish,
}

/// Filled by zenoh's threads, drained by ours.
#[derive(Debug, Default)]
struct Inbox {
    state: Mutex<InboxState>,
    arrival: Condvar,
}

#[derive(Debug, Default)]
struct InboxState {
    packets: VecDeque<(Topic, Vec<u8>)>,
    /// By [`slot`]: roles whose token was withdrawn.
    gone: [bool; 3],
    /// Something changed since the last wait.
    is_news: bool,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, InboxState> {
        // No code can panic while holding the lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut InboxState)) {
        let mut state = self.lock();
        change(&mut state);
        state.is_news = true;
        drop(state);
        self.arrival.notify_one();
    }
}

/// Array index of a role.
fn slot(role: Role) -> Option<usize> {
    match role {
        Role::Plant => Some(0),
        Role::Controller => Some(1),
        Role::Fdi => Some(2),
        Role::Unspecified => None,
    }
}

/// One process's session.
#[derive(Debug)]
pub struct ZenohEndpoint {
    role: Role,
    run_id: u64,
    options: ZenohOptions,
    prefix: String,
    inbox: Arc<Inbox>,
    /// For messages of this role in each step or batch.
    publisher: Publisher<'static>,
    /// Plant: for steps forwarded to the FDI engine.
    steps_publisher: Option<Publisher<'static>>,
    /// Rotors of the vehicle, from the Setup exchanged.
    rotor_count: usize,
    /// Steps in a list for the FDI engine, from the Setup exchanged.
    batch: u64,
    /// Plant: sensors waiting for their command.
    unanswered: Option<SensorFrame>,
    /// Plant: steps waiting to be forwarded.
    steps: Vec<proto::MeasuredStep>,
    /// FDI engine: reports waiting to be sent.
    reports: Vec<proto::FdiReport>,
    /// FDI engine and plant: remainder of the last list.
    decoded: VecDeque<Packet>,
    /// The last message of the hand-shake that could not be used, with the role that its key names.
    dropped: Option<(Role, String)>,
    subscribers: Vec<Subscriber<()>>,
    token: Option<LivelinessToken>,
    session: zenoh::Session,
}

impl ZenohEndpoint {
    /// Joins the network as `role` of the run `run_id`. Fails, naming the endpoint, if nothing answers there in time.
    pub fn new(role: Role, run_id: u64, options: ZenohOptions) -> Result<Self, LinkError> {
        let session = open(&options, Runs::One(run_id))?;
        let prefix = format!("{}/v1/{run_id:016x}", options.space());
        let inbox = Arc::new(Inbox::default());
        let own_setup = format!("setup/{}", slug(role));
        let (sends, receives): (&str, &[(&str, Topic)]) = match role {
            Role::Plant => (
                "sensors",
                &[
                    ("command", Topic::Command),
                    ("reports", Topic::Reports),
                    ("join/controller", Topic::Join(Role::Controller)),
                    ("join/fdi", Topic::Join(Role::Fdi)),
                    ("ready/controller", Topic::Ready(Role::Controller)),
                    ("ready/fdi", Topic::Ready(Role::Fdi)),
                ],
            ),
            Role::Controller => (
                "command",
                &[
                    ("sensors", Topic::Sensors),
                    (&own_setup, Topic::Setup),
                    ("finish", Topic::Finish),
                ],
            ),
            Role::Fdi => (
                "reports",
                &[
                    ("steps", Topic::Steps),
                    (&own_setup, Topic::Setup),
                    ("finish", Topic::Finish),
                ],
            ),
            Role::Unspecified => return Err(failed("creating an endpoint", "a role is needed")),
        };
        let mut subscribers = Vec::new();
        for &(key, topic) in receives {
            let inbox = Arc::clone(&inbox);
            let subscriber = session
                .declare_subscriber(format!("{prefix}/{key}"))
                .callback(move |sample| {
                    let bytes = sample.payload().to_bytes().into_owned();
                    inbox.change(|state| state.packets.push_back((topic, bytes)));
                })
                .wait()
                .map_err(|error| failed(&format!("subscribing to {key}"), error))?;
            subscribers.push(subscriber);
        }
        let lives = {
            let inbox = Arc::clone(&inbox);
            session
                .liveliness()
                .declare_subscriber(format!("{prefix}/alive/*"))
                .history(true)
                .callback(move |sample| {
                    let key = sample.key_expr().as_str();
                    let name = key.rsplit('/').next().unwrap_or(key);
                    let who = [Role::Plant, Role::Controller, Role::Fdi]
                        .into_iter()
                        .find(|role| slug(*role) == name);
                    if let Some(slot) = who.and_then(slot) {
                        inbox.change(|state| state.gone[slot] = sample.kind() == SampleKind::Delete);
                    }
                })
                .wait()
                .map_err(|error| failed("watching who is alive", error))?
        };
        subscribers.push(lives);
        let declare = |key: &str| {
            session
                .declare_publisher(format!("{prefix}/{key}"))
                .congestion_control(CongestionControl::Block)
                .priority(Priority::RealTime)
                .express(true)
                .wait()
                .map_err(|error| failed(&format!("publishing {key}"), error))
        };
        let publisher = declare(sends)?;
        let steps_publisher = (role == Role::Plant).then(|| declare("steps")).transpose()?;
        let token = session
            .liveliness()
            .declare_token(format!("{prefix}/alive/{}", slug(role)))
            .wait()
            .map_err(|error| failed("declaring the liveliness token", error))?;
        Ok(Self {
            role,
            run_id,
            options,
            prefix,
            inbox,
            publisher,
            steps_publisher,
            rotor_count: 0,
            batch: 1,
            unanswered: None,
            steps: Vec::new(),
            reports: Vec::new(),
            decoded: VecDeque::new(),
            dropped: None,
            subscribers,
            token: Some(token),
            session,
        })
    }

    fn put(&self, key: &str, bytes: Vec<u8>, congestion: CongestionControl) -> Result<Delivery, LinkError> {
        if bytes.len() > LONGEST_MESSAGE {
            let reason = format!("it has {} bytes, at most {LONGEST_MESSAGE} can be sent", bytes.len());
            return Err(failed(&format!("sending {key}"), reason));
        }
        self.session
            .put(format!("{}/{key}", self.prefix), bytes)
            .congestion_control(congestion)
            .priority(Priority::RealTime)
            .express(true)
            .wait()
            .map_err(|error| failed(&format!("sending {key}"), error))?;
        Ok(Delivery::Complete)
    }

    /// A message of the 400 Hz loop.
    fn publish(&self, bytes: Vec<u8>) -> Result<Delivery, LinkError> {
        publish(&self.publisher, bytes)
    }

    /// Plant: stores a step for the FDI engine once its command has arrived, and forwards a full list.
    fn pass_on(&mut self, command: &CommandFrame) -> Result<(), LinkError> {
        let Some(sensors) = self.unanswered else { return Ok(()) };
        if (sensors.stamp.run_id, sensors.stamp.step) != (command.stamp.run_id, command.stamp.step) {
            return Ok(());
        }
        self.unanswered = None;
        self.steps.push(proto::MeasuredStep {
            sensors: Some((&sensors).into()),
            command: Some(command.to_proto(self.rotor_count)),
        });
        if (sensors.stamp.step + 1).is_multiple_of(self.batch) || self.steps.len() >= LONGEST_LIST {
            self.flush()?;
        }
        Ok(())
    }

    /// Sends incomplete lists.
    fn flush(&mut self) -> Result<(), LinkError> {
        if let Some(publisher) = &self.steps_publisher
            && !self.steps.is_empty()
        {
            let steps = proto::MeasuredSteps {
                steps: std::mem::take(&mut self.steps),
            };
            publish(publisher, steps.encode_to_vec())?;
        }
        if !self.reports.is_empty() {
            let reports = proto::FdiReports {
                reports: std::mem::take(&mut self.reports),
            };
            self.publish(reports.encode_to_vec())?;
        }
        Ok(())
    }

    /// Decodes a message into `decoded`.
    fn decode(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LinkError> {
        let packet = match topic {
            Topic::Sensors => {
                let message: proto::SensorFrame = parse(bytes, "SensorFrame", Role::Plant)?;
                Packet::Sensors(sensors(&message)?)
            }
            Topic::Command => {
                let message: proto::MotorCommand = parse(bytes, "MotorCommand", Role::Controller)?;
                let command = command(&message, self.rotor_count)?;
                self.pass_on(&command)?;
                Packet::Command(command)
            }
            Topic::Steps => {
                let list: proto::MeasuredSteps = parse(bytes, "MeasuredSteps", Role::Plant)?;
                for step in list.steps {
                    let (Some(sent), Some(answer)) = (&step.sensors, &step.command) else {
                        let missing = ConvertError::Missing("MeasuredStep.sensors or MeasuredStep.command");
                        return Err(malformed(Role::Plant, None, &missing));
                    };
                    self.decoded.push_back(Packet::Sensors(sensors(sent)?));
                    self.decoded
                        .push_back(Packet::Command(command(answer, self.rotor_count)?));
                }
                return Ok(());
            }
            Topic::Reports => {
                let list: proto::FdiReports = parse(bytes, "FdiReports", Role::Fdi)?;
                for message in &list.reports {
                    let report = FdiReport::from_proto(message, self.rotor_count)
                        .map_err(|error| malformed(Role::Fdi, step(&message.stamp), &error))?;
                    self.decoded.push_back(Packet::Report(report));
                }
                return Ok(());
            }
            Topic::Join(role) => {
                let join: proto::Join = parse(bytes, "Join", role)?;
                own_role(role, join.role(), "Join.role")?;
                Packet::Join(join)
            }
            Topic::Setup => {
                let setup: Setup = parse(bytes, "Setup", Role::Plant)?;
                self.learn(&setup);
                Packet::Setup(Box::new(setup))
            }
            Topic::Ready(role) => {
                let ready: proto::Ready = parse(bytes, "Ready", role)?;
                own_role(role, ready.role(), "Ready.role")?;
                Packet::Ready(ready)
            }
            Topic::Finish => Packet::Finish(parse(bytes, "Finish", Role::Plant)?),
        };
        self.decoded.push_back(packet);
        Ok(())
    }

    fn learn(&mut self, setup: &Setup) {
        self.batch = u64::from(setup.fdi_batch).max(1);
        self.rotor_count = match &setup.parameters {
            Some(Parameters::Controller(parameters)) => parameters.rotors.len(),
            Some(Parameters::Fdi(parameters)) => parameters.rotors.len(),
            None => self.rotor_count,
        };
    }
}

fn publish(publisher: &Publisher<'static>, bytes: Vec<u8>) -> Result<Delivery, LinkError> {
    publisher
        .put(bytes)
        .wait()
        .map_err(|error| failed("sending a frame", error))?;
    Ok(Delivery::Complete)
}

/// Access control checks the key of a message, not its content.
fn own_role(key: Role, said: Role, field: &'static str) -> Result<(), LinkError> {
    if key == said {
        return Ok(());
    }
    let other = ConvertError::Malformed {
        message: field,
        reason: format!(
            "it claims to be from the {}, but came from the {}",
            role_name(said),
            role_name(key)
        ),
    };
    Err(malformed(key, None, &other))
}

fn sensors(message: &proto::SensorFrame) -> Result<SensorFrame, LinkError> {
    SensorFrame::try_from(message).map_err(|error| malformed(Role::Plant, step(&message.stamp), &error))
}

fn command(message: &proto::MotorCommand, rotor_count: usize) -> Result<CommandFrame, LinkError> {
    CommandFrame::from_proto(message, rotor_count)
        .map_err(|error| malformed(Role::Controller, step(&message.stamp), &error))
}

fn step(stamp: &Option<proto::Stamp>) -> Option<u64> {
    stamp.as_ref().map(|stamp| stamp.step)
}

fn parse<M: Message + Default>(bytes: &[u8], message: &'static str, sender: Role) -> Result<M, LinkError> {
    M::decode(bytes).map_err(|error| {
        malformed(
            sender,
            None,
            &ConvertError::Malformed {
                message,
                reason: error.to_string(),
            },
        )
    })
}

impl Endpoint for ZenohEndpoint {
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
        format!("zenoh at {}", self.options.endpoint)
    }

    fn send(&mut self, packet: &Packet) -> Result<Delivery, LinkError> {
        let block = CongestionControl::Block;
        match packet {
            Packet::Sensors(frame) => {
                self.unanswered = Some(*frame);
                self.publish(proto::SensorFrame::from(frame).encode_to_vec())
            }
            Packet::Command(frame) => self.publish(frame.to_proto(self.rotor_count).encode_to_vec()),
            Packet::Report(frame) => {
                self.reports.push(frame.to_proto(self.rotor_count));
                if self.reports.len() >= LONGEST_LIST {
                    self.flush()?;
                }
                Ok(Delivery::Complete)
            }
            Packet::Join(message) => {
                let key = format!("join/{}", slug(message.role()));
                self.put(&key, message.encode_to_vec(), block)
            }
            Packet::Ready(message) => {
                let key = format!("ready/{}", slug(message.role()));
                self.put(&key, message.encode_to_vec(), block)
            }
            Packet::Setup(message) => {
                self.learn(message);
                self.put(
                    &format!("setup/{}", slug(message.role())),
                    message.encode_to_vec(),
                    block,
                )
            }
            // The final message must not wait for a blocked peer.
            Packet::Finish(message) => self.put("finish", message.encode_to_vec(), CongestionControl::Drop),
        }
    }

    fn wake(&mut self, role: Role) -> Result<(), LinkError> {
        // Sending has woken it, unless the data are still collected in a list.
        match (self.role, role) {
            (Role::Plant, Role::Fdi) | (Role::Fdi, Role::Plant) => self.flush(),
            _ => Ok(()),
        }
    }

    fn poll(&mut self) -> Result<Option<Packet>, LinkError> {
        loop {
            if let Some(packet) = self.decoded.pop_front() {
                return Ok(Some(packet));
            }
            let next = self.inbox.lock().packets.pop_front();
            let Some((topic, bytes)) = next else { return Ok(None) };
            match (self.decode(topic, &bytes), topic) {
                (Ok(()), _) => {}
                // A malformed greeting must not end a run.
                (Err(error), Topic::Join(_) | Topic::Setup | Topic::Ready(_) | Topic::Finish) => {
                    tracing::warn!("a message of the hand-shake was dropped: {error}");
                    if let LinkError::Unreadable { role, reason } = error {
                        self.dropped = Some((role, reason));
                    }
                }
                (Err(error), _) => return Err(error),
            }
        }
    }

    fn dropped(&self, role: Role) -> Option<&str> {
        self.dropped
            .as_ref()
            .filter(|(sender, _)| *sender == role)
            .map(|(_, reason)| reason.as_str())
    }

    fn wait(&mut self, at_most: Duration) -> Result<(), LinkError> {
        let mut state = self.inbox.lock();
        if state.packets.is_empty() && !state.is_news {
            state = self
                .inbox
                .arrival
                .wait_timeout(state, at_most)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
        state.is_news = false;
        Ok(())
    }

    fn is_gone(&mut self, role: Role, _thorough: bool) -> bool {
        slot(role).is_some_and(|slot| self.inbox.lock().gone[slot])
    }
}

/// Closes in an orderly way: the others know immediately that this end is gone.
impl Drop for ZenohEndpoint {
    fn drop(&mut self) {
        if let Some(token) = self.token.take()
            && let Err(error) = token.undeclare().wait()
        {
            tracing::debug!("withdrawing the liveliness token: {error}");
        }
        for subscriber in self.subscribers.drain(..) {
            if let Err(error) = subscriber.undeclare().wait() {
                tracing::debug!("ending a subscription: {error}");
            }
        }
        if let Err(error) = self.session.close().wait() {
            tracing::debug!("closing the session: {error}");
        }
    }
}
