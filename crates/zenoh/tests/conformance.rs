//! One conformance suite for every link between processes: iceoryx2, zenoh with the plant as hub, zenoh through a router.
//! The in-process link takes part where the property applies, and is the reference for the answers.
//!
//! The peers of these tests fold everything they have seen into everything they answer: the plant's digest of a run is correct
//! only if each step arrived exactly once and in order at both peers, and each answer came back bit for bit.

use rotortwin_links::endpoint::{Delivery, Endpoint, EndpointLink, Packet, PeerOptions, serve_controller, serve_fdi};
use rotortwin_links::iox2::{Iox2Endpoint, Iox2Options};
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_proto::{ControllerSetup, FdiSetup, Join, NetworkSetup, Ready, Role, Rotor, Setup};
use rotortwin_wire::frames::{CommandFrame, FdiReport, LossEstimate, MAX_HYPOTHESES, SensorFrame, Stamp};
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::link::{ControllerPeer, FdiPeer, LinkError, LinkTiming, PlantLink, RunSetup};
use rotortwin_zenoh::endpoint::ZenohEndpoint;
use std::fmt::Debug;
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Rotors of the test vehicle.
const ROTORS: usize = 6;

/// A killed or dropped peer must be reported within this time; measured are 5 ms (zenoh) to 60 ms (iceoryx2). The rest is
/// margin for a machine that is busy with other tests.
const DEATH_NOTICE: Duration = Duration::from_millis(900);

/// A time-out that must never expire in a test that expects none, even on a busy machine.
const PATIENT: LinkTiming = LinkTiming {
    join: Duration::from_secs(30),
    step: Duration::from_secs(30),
    fdi_window: 128,
    fdi_batch: 32,
};

/// Environment variable that makes [`child_process`] play a role.
const CHILD: &str = "ROTORTWIN_TEST_CHILD";

// Test peers.

/// Mixes a number into a state (splitmix64).
fn mix(state: u64, value: u64) -> u64 {
    let mut z = state
        .rotate_left(17)
        .wrapping_add(value)
        .wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn mix_floats(state: u64, values: &[f32]) -> u64 {
    values
        .iter()
        .fold(state, |state, value| mix(state, u64::from(value.to_bits())))
}

fn mix_sensors(state: u64, s: &SensorFrame) -> u64 {
    let state = mix(mix(mix(state, s.stamp.run_id), s.stamp.step), s.stamp.sim_time_ns);
    let state = mix_floats(state, &s.position_ned_m);
    let state = mix_floats(state, &s.velocity_ned_m_s);
    let state = mix_floats(state, &s.attitude_rad);
    let state = mix_floats(state, &s.body_rates_rad_s);
    let state = mix_floats(state, &s.reference_position_ned_m);
    let state = mix_floats(state, &s.reference_velocity_ned_m_s);
    mix_floats(state, &[s.reference_yaw_rad, s.battery_voltage_v])
}

fn mix_command(state: u64, c: &CommandFrame) -> u64 {
    let state = mix(
        mix(mix(state, c.stamp.run_id), c.stamp.step),
        u64::from(c.saturated_rotors),
    );
    mix_floats(mix_floats(state, &c.duty), &c.attitude_setpoint_rad)
}

fn mix_report(state: u64, r: &FdiReport) -> u64 {
    let state = mix(mix(state, r.stamp.run_id), r.stamp.step);
    let state = mix_floats(state, r.residuals_nms.as_flattened());
    let state = mix_floats(state, &r.wrench_residual);
    let state = [r.t_test, r.network, r.sequential]
        .iter()
        .fold(state, |state, &code| mix(state, code as u64));
    let state = mix_floats(state, &[r.sequential_probability]);
    let state = mix_floats(state, &r.thrust_loss.values());
    let state = mix_floats(state, &r.second_thrust_loss.values());
    [r.suspect_rotors, r.hypothesis_count, r.window_end]
        .iter()
        .chain(&r.hypothesis_rotors)
        .fold(state, |state, &word| mix(state, u64::from(word)))
}

/// A number from 0 to 1 derived from a state; sometimes a zero, of either sign.
fn fraction(state: u64) -> f32 {
    match state % 16 {
        0 => 0.0,
        1 => -0.0,
        _ => (state >> 40) as f32 / (1 << 24) as f32,
    }
}

/// Any number of moderate size, of either sign.
fn number(state: u64) -> f32 {
    (fraction(state) - 0.5) * 8.0 * if state % 32 < 16 { 1e-7 } else { 1.0 }
}

/// A loss inside its interval, including zeros of either sign.
fn loss(state: u64) -> LossEstimate {
    let part = |index| fraction(mix(state, index));
    let (low_n, share_low) = (part(0), part(1));
    let (loss_n, share) = (low_n + part(2), share_low + part(3));
    LossEstimate {
        loss_n,
        low_n,
        high_n: loss_n + part(4),
        share,
        share_low,
        share_high: share + part(5),
    }
}

/// The test plant's sensors in a step.
fn sensors(run_id: u64, step: u64) -> SensorFrame {
    let mut state = mix(7, step);
    let mut next = || {
        state = mix(state, 1);
        if state % 16 == 1 { -0.0 } else { number(state) }
    };
    SensorFrame {
        stamp: Stamp {
            run_id,
            step,
            sim_time_ns: step * 2_500_000,
        },
        position_ned_m: [next(), next(), next()],
        velocity_ned_m_s: [next(), next(), next()],
        attitude_rad: [next(), next(), next()],
        body_rates_rad_s: [next(), next(), next()],
        reference_position_ned_m: [next(), next(), next()],
        reference_velocity_ned_m_s: [next(), next(), next()],
        reference_yaw_rad: next(),
        battery_voltage_v: 14.0 + next(),
    }
}

/// Sleeps for a random time in random steps.
#[derive(Clone, Copy)]
struct Delays(Option<u64>);

impl Delays {
    const NONE: Self = Self(None);

    fn sleep(&mut self) {
        if let Some(state) = &mut self.0 {
            *state = mix(*state, 1);
            if *state % 5 == 0 {
                std::thread::sleep(Duration::from_micros((*state >> 8) % 400));
            }
        }
    }
}

/// Controller and FDI engine of these tests; both fold everything they see.
#[derive(Clone)]
struct Folding {
    state: u64,
    delays: Delays,
    refusal: Option<String>,
    /// Steps done, for the test to watch.
    done: Arc<AtomicU64>,
    /// Sleeps this long in this step.
    stall: Option<(u64, Duration)>,
    /// Extra time for each step.
    work: Duration,
    /// Answers this step with NaN.
    nan_at: Option<u64>,
    network_len: usize,
}

impl Folding {
    fn new() -> Self {
        Self {
            state: 1,
            delays: Delays::NONE,
            refusal: None,
            done: Arc::default(),
            stall: None,
            work: Duration::ZERO,
            nan_at: None,
            network_len: 0,
        }
    }

    fn begin_step(&mut self, step: u64) {
        self.delays.sleep();
        if !self.work.is_zero() {
            std::thread::sleep(self.work);
        }
        if let Some((at, time)) = self.stall
            && at == step
        {
            std::thread::sleep(time);
        }
        self.done.store(step + 1, Ordering::SeqCst);
    }

    fn accept(&self, rotors: usize) -> Result<(), String> {
        assert_eq!(rotors, ROTORS);
        let Some(refusal) = self.refusal.clone() else {
            return Ok(());
        };
        // The other peer joins meanwhile.
        std::thread::sleep(Duration::from_millis(400));
        Err(refusal)
    }
}

impl ControllerPeer for Folding {
    fn setup(&mut self, setup: &ControllerSetup) -> Result<(), String> {
        self.accept(setup.rotors.len())
    }

    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame {
        self.begin_step(sensors.stamp.step);
        self.state = mix_sensors(self.state, sensors);
        let mut command = CommandFrame {
            stamp: sensors.stamp,
            ..CommandFrame::default()
        };
        for (index, duty) in command.duty[..ROTORS].iter_mut().enumerate() {
            *duty = fraction(mix(self.state, index as u64));
        }
        command.attitude_setpoint_rad = [10, 11, 12].map(|index| number(mix(self.state, index)));
        command.saturated_rotors = (self.state >> 32) as u32;
        if self.nan_at == Some(sensors.stamp.step) {
            command.duty[2] = f32::NAN;
        }
        command
    }
}

impl FdiPeer for Folding {
    fn setup(&mut self, setup: &FdiSetup) -> Result<(), String> {
        self.network_len = setup.network.as_ref().map_or(0, |network| network.hidden_weights.len());
        self.accept(setup.rotors.len())
    }

    fn step(&mut self, sensors: &SensorFrame, command: &CommandFrame) -> FdiReport {
        assert_eq!(sensors.stamp, command.stamp, "the link pairs sensors and command");
        self.begin_step(sensors.stamp.step);
        self.state = mix_command(mix_sensors(self.state, sensors), command);
        let mut report = FdiReport {
            stamp: sensors.stamp,
            ..FdiReport::default()
        };
        for (index, value) in report.residuals_nms.as_flattened_mut()[..3 * ROTORS]
            .iter_mut()
            .enumerate()
        {
            *value = number(mix(self.state, index as u64));
        }
        report.wrench_residual = [60, 61, 62, 63].map(|index| number(mix(self.state, index)));
        let code = |index| (mix(self.state, index) % (ROTORS as u64 + 3)) as i32 - 2;
        (report.t_test, report.network, report.sequential) = (code(70), code(71), code(72));
        report.sequential_probability = fraction(mix(self.state, 73));
        report.thrust_loss = loss(mix(self.state, 74));
        report.second_thrust_loss = loss(mix(self.state, 75));
        report.suspect_rotors = (mix(self.state, 76) % (1 << ROTORS)) as u32;
        report.hypothesis_count = (mix(self.state, 77) % 20) as u32;
        for index in 0..MAX_HYPOTHESES.min(report.hypothesis_count as usize) {
            report.hypothesis_rotors[index] = 1 + (mix(self.state, 78 + index as u64) % ((1 << ROTORS) - 1)) as u32;
        }
        report.window_end = (self.state & 1) as u32;
        if self.nan_at == Some(sensors.stamp.step) {
            report.residuals_nms[1][2] = f32::INFINITY;
        }
        report
    }
}

fn run_setup(run_id: u64, step_count: u64) -> RunSetup {
    let rotors = vec![Rotor::default(); ROTORS];
    // As large as the largest possible network: more than one segment of any transport.
    let network = NetworkSetup {
        hidden_weights: vec![0.1; 48 * 48],
        ..NetworkSetup::default()
    };
    RunSetup {
        run_id,
        scenario: "conformance".to_owned(),
        model_hash: "0123456789abcdef".to_owned(),
        step_count,
        controller: ControllerSetup {
            rotors: rotors.clone(),
            ..ControllerSetup::default()
        },
        fdi: FdiSetup {
            rotors,
            network: Some(network),
            ..FdiSetup::default()
        },
    }
}

/// Flies `steps` steps and digests all answers. Notifies the peers of the result, as every plant does.
fn fly(link: &mut impl PlantLink, run_id: u64, steps: u64, mut delays: Delays) -> Result<u64, LinkError> {
    let mut digest = 3;
    let mut reports = 0;
    let mut attempt = || {
        link.open(&run_setup(run_id, steps))?;
        for step in 0..steps {
            delays.sleep();
            let frame = sensors(run_id, step);
            let command = link.exchange(&frame)?;
            assert_eq!(command.stamp, frame.stamp);
            digest = mix_command(digest, &command);
            while let Some(report) = link.next_report(false)? {
                assert_eq!(report.stamp.step, reports, "each report once and in order");
                reports += 1;
                digest = mix_report(digest, &report);
            }
        }
        while let Some(report) = link.next_report(true)? {
            assert_eq!(report.stamp.step, reports, "each report once and in order");
            reports += 1;
            digest = mix_report(digest, &report);
        }
        assert_eq!(reports, steps, "a report of each step");
        Ok(())
    };
    let result: Result<(), LinkError> = attempt();
    match &result {
        Ok(()) => link.finish(steps, None),
        Err(error) => link.finish(0, Some(&error.to_string())),
    }
    result.map(|()| digest)
}

/// Result of the same flight without any transport. Commands and reports interleave differently with a window, so they are
/// digested separately.
fn reference_digest(run_id: u64, steps: u64) -> u64 {
    fly_split(
        &mut InProcessLink::new(Folding::new(), Folding::new()),
        run_id,
        steps,
        Delays::NONE,
    )
    .expect("no transport")
}

/// As [`fly`], with a digest that does not depend on how far the FDI engine trails.
fn fly_split(link: &mut impl PlantLink, run_id: u64, steps: u64, delays: Delays) -> Result<u64, LinkError> {
    struct Split<'a, L> {
        link: &'a mut L,
        commands: u64,
        reports: u64,
    }
    impl<L: PlantLink> PlantLink for Split<'_, L> {
        fn open(&mut self, setup: &RunSetup) -> Result<(), LinkError> {
            self.link.open(setup)
        }
        fn exchange(&mut self, sensors: &SensorFrame) -> Result<CommandFrame, LinkError> {
            let command = self.link.exchange(sensors)?;
            self.commands = mix_command(self.commands, &command);
            Ok(command)
        }
        fn next_report(&mut self, wait: bool) -> Result<Option<FdiReport>, LinkError> {
            let report = self.link.next_report(wait)?;
            if let Some(report) = &report {
                self.reports = mix_report(self.reports, report);
            }
            Ok(report)
        }
        fn finish(&mut self, steps: u64, failure: Option<&str>) {
            self.link.finish(steps, failure);
        }
    }
    let mut split = Split {
        link,
        commands: 5,
        reports: 6,
    };
    fly(&mut split, run_id, steps, delays)?;
    Ok(mix(split.commands, split.reports))
}

// Transports.

/// A place where the processes of a run can meet.
trait Transport: Clone + Send + Sync + 'static {
    type End: Endpoint;
    /// Steps of the long run.
    const LONG_RUN: u64;
    /// A separate place for this test.
    fn create() -> Self;
    /// Another simultaneous run, in the same place if possible.
    fn second(&self) -> Self;
    fn end(&self, role: Role, run_id: u64) -> Result<Self::End, LinkError>;
    /// For a child process: `parse` returns the same place there.
    fn to_text(&self) -> String;
    fn parse(text: &str) -> Self;
    /// Fails if a run has left anything behind.
    fn assert_clean(&self) {}
}

#[derive(Clone)]
struct Iox2 {
    options: Iox2Options,
    _cleaner: Option<Arc<Cleaner>>,
}

/// Removes the files of a test at its end.
struct Cleaner(Iox2Options);

impl Drop for Cleaner {
    fn drop(&mut self) {
        for file in shared_memory_files(&self.0.prefix) {
            std::fs::remove_file(file).ok();
        }
        std::fs::remove_dir_all(&self.0.root).ok();
    }
}

/// A test that failed or was killed could not remove its files: removes those of dead processes.
fn remove_files_of_dead_tests() {
    for path in shared_memory_files("rtt") {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let process = name
            .trim_start_matches("rtt")
            .split('_')
            .next()
            .unwrap_or_default()
            .to_owned();
        if !process.is_empty() && !std::path::Path::new("/proc").join(process).exists() {
            std::fs::remove_file(&path)
                .or_else(|_| std::fs::remove_dir_all(&path))
                .ok();
        }
    }
}

fn shared_memory_files(prefix: &str) -> Vec<std::path::PathBuf> {
    std::fs::read_dir("/dev/shm")
        .expect("Linux has /dev/shm")
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            path.file_name()
                .is_some_and(|name| name.to_string_lossy().starts_with(prefix))
        })
        .collect()
}

impl Transport for Iox2 {
    type End = Iox2Endpoint;
    const LONG_RUN: u64 = 20_000;

    fn create() -> Self {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        remove_files_of_dead_tests();
        let name = format!("rtt{}_{}_", std::process::id(), COUNT.fetch_add(1, Ordering::SeqCst));
        let options = Iox2Options {
            root: format!("/dev/shm/{name}root").into(),
            prefix: name,
            spin: 0,
        };
        Self {
            _cleaner: Some(Arc::new(Cleaner(options.clone()))),
            options,
        }
    }
    fn second(&self) -> Self {
        self.clone()
    }
    fn end(&self, role: Role, run_id: u64) -> Result<Iox2Endpoint, LinkError> {
        Iox2Endpoint::new(role, run_id, self.options.clone())
    }
    fn to_text(&self) -> String {
        format!("{}|{}", self.options.root.display(), self.options.prefix)
    }
    fn parse(text: &str) -> Self {
        let (root, prefix) = text.split_once('|').expect("root|prefix");
        Self {
            options: Iox2Options {
                root: root.into(),
                prefix: prefix.to_owned(),
                spin: 0,
            },
            _cleaner: None,
        }
    }
    fn assert_clean(&self) {
        let left = shared_memory_files(&self.options.prefix);
        let left: Vec<_> = left
            .iter()
            .filter(|path| !path.is_dir() && !path.to_string_lossy().ends_with(".global_mgmt"))
            .collect();
        assert!(left.is_empty(), "left behind: {left:?}");
    }
}

#[derive(Clone)]
struct ZenohHub(String);

impl Transport for ZenohHub {
    type End = ZenohEndpoint;
    const LONG_RUN: u64 = 2_000;

    fn create() -> Self {
        Self(ZenohOptions::free_loopback_endpoint().expect("a port is free"))
    }
    fn second(&self) -> Self {
        Self::create()
    }
    fn end(&self, role: Role, run_id: u64) -> Result<ZenohEndpoint, LinkError> {
        let options = if role == Role::Plant {
            ZenohOptions::listen(&self.0)
        } else {
            ZenohOptions::connect(&self.0)
        };
        ZenohEndpoint::new(
            role,
            run_id,
            ZenohOptions {
                connect_timeout: PATIENT.join,
                ..options
            },
        )
    }
    fn to_text(&self) -> String {
        self.0.clone()
    }
    fn parse(text: &str) -> Self {
        Self(text.to_owned())
    }
}

#[derive(Clone)]
struct ZenohRouter {
    endpoint: String,
    _router: Option<zenoh::Session>,
}

impl Transport for ZenohRouter {
    type End = ZenohEndpoint;
    const LONG_RUN: u64 = 2_000;

    fn create() -> Self {
        let endpoint = ZenohOptions::free_loopback_endpoint().expect("a port is free");
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", "\"router\"".to_owned()),
            ("listen/endpoints", format!("[{endpoint:?}]")),
            ("scouting/multicast/enabled", "false".to_owned()),
            ("scouting/gossip/enabled", "false".to_owned()),
        ] {
            config.insert_json5(key, &value).expect("a valid setting");
        }
        let router = zenoh::Wait::wait(zenoh::open(config)).expect("the port is free");
        Self {
            endpoint,
            _router: Some(router),
        }
    }
    fn second(&self) -> Self {
        self.clone()
    }
    fn end(&self, role: Role, run_id: u64) -> Result<ZenohEndpoint, LinkError> {
        ZenohEndpoint::new(role, run_id, ZenohOptions::connect(&self.endpoint))
    }
    fn to_text(&self) -> String {
        self.endpoint.clone()
    }
    fn parse(text: &str) -> Self {
        Self {
            endpoint: text.to_owned(),
            _router: None,
        }
    }
}

// Running the three processes.

fn run_id() -> u64 {
    static COUNT: AtomicU64 = AtomicU64::new(1);
    (u64::from(std::process::id()) << 16) | COUNT.fetch_add(1, Ordering::SeqCst)
}

fn options(timing: &LinkTiming) -> PeerOptions {
    PeerOptions::new("conformance test", timing)
}

fn controller_thread<T: Transport>(
    place: &T,
    run_id: u64,
    timing: LinkTiming,
    mut peer: Folding,
) -> std::thread::JoinHandle<Result<u64, LinkError>> {
    let place = place.clone();
    std::thread::spawn(move || {
        let mut end = place.end(Role::Controller, run_id)?;
        serve_controller(&mut end, &mut peer, &options(&timing))
    })
}

fn fdi_thread<T: Transport>(
    place: &T,
    run_id: u64,
    timing: LinkTiming,
    mut peer: Folding,
) -> std::thread::JoinHandle<Result<u64, LinkError>> {
    let place = place.clone();
    std::thread::spawn(move || {
        let mut end = place.end(Role::Fdi, run_id)?;
        serve_fdi(&mut end, &mut peer, &options(&timing))
    })
}

/// Results of plant, controller and FDI engine.
type Outcome = (Result<u64, LinkError>, Result<u64, LinkError>, Result<u64, LinkError>);

/// A whole flight in three threads.
fn flight<T: Transport>(place: &T, steps: u64, timing: LinkTiming, controller: Folding, fdi: Folding) -> Outcome {
    flight_as(place, run_id(), steps, timing, controller, fdi, Delays::NONE)
}

fn flight_as<T: Transport>(
    place: &T,
    run_id: u64,
    steps: u64,
    timing: LinkTiming,
    controller: Folding,
    fdi: Folding,
    delays: Delays,
) -> Outcome {
    let controller = controller_thread(place, run_id, timing, controller);
    let fdi = fdi_thread(place, run_id, timing, fdi);
    let plant = place.end(Role::Plant, run_id).and_then(|end| {
        let mut link = EndpointLink::new(end, timing);
        fly_split(&mut link, run_id, steps, delays)
    });
    (
        plant,
        controller.join().expect("no panic"),
        fdi.join().expect("no panic"),
    )
}

fn window(fdi_window: u64, fdi_batch: u64) -> LinkTiming {
    LinkTiming {
        fdi_window,
        fdi_batch,
        ..PATIENT
    }
}

/// A controller without the checks of `serve_controller`: answers with `answer` until that returns false, then drops its end.
fn raw_controller<T: Transport>(
    place: &T,
    run_id: u64,
    mut answer: impl FnMut(&mut T::End, &SensorFrame, CommandFrame) -> bool + Send + 'static,
) -> std::thread::JoinHandle<()> {
    let place = place.clone();
    std::thread::spawn(move || {
        let mut end = place.end(Role::Controller, run_id).expect("the place exists");
        let mut peer = Folding::new();
        raw_join(&mut end);
        loop {
            match end.poll().expect("the link works") {
                Some(Packet::Sensors(frame)) => {
                    let frame = frame.canonical();
                    let command = ControllerPeer::step(&mut peer, &frame);
                    if !answer(&mut end, &frame, command) {
                        return;
                    }
                    end.wake(Role::Fdi).expect("the link works");
                    end.wake(Role::Plant).expect("the link works");
                }
                Some(Packet::Finish(_)) => return,
                Some(_) => {}
                None => end.wait(Duration::from_millis(20)).expect("the link works"),
            }
        }
    })
}

fn join_packet(end: &impl Endpoint, protocol_version: u32) -> Packet {
    Packet::Join(Join {
        run_id: end.run_id(),
        role: end.role().into(),
        protocol_version,
        program: "raw peer".to_owned(),
        host: "here".to_owned(),
        pid: std::process::id(),
        process_space: 0,
    })
}

/// Joins until a Setup arrives, and reports ready.
fn raw_join(end: &mut impl Endpoint) -> Setup {
    loop {
        end.send(&join_packet(end, rotortwin_wire::PROTOCOL_VERSION))
            .expect("the link works");
        end.wake(Role::Plant).expect("the link works");
        end.wait(Duration::from_millis(50)).expect("the link works");
        while let Some(packet) = end.poll().expect("the link works") {
            if let Packet::Setup(setup) = packet
                && setup.role() == end.role()
            {
                let ready = Ready {
                    run_id: end.run_id(),
                    role: end.role().into(),
                    refusal: String::new(),
                };
                end.send(&Packet::Ready(ready)).expect("the link works");
                end.wake(Role::Plant).expect("the link works");
                return *setup;
            }
        }
    }
}

/// The next packet accepted by `wanted`; other packets are dropped.
fn await_packet<R>(end: &mut impl Endpoint, wanted: impl Fn(Packet) -> Option<R>) -> R {
    let begin = Instant::now();
    loop {
        while let Some(packet) = end.poll().expect("the link works") {
            if let Some(found) = wanted(packet) {
                return found;
            }
        }
        assert!(begin.elapsed() < PATIENT.join, "the packet never came");
        end.wait(Duration::from_millis(20)).expect("the link works");
    }
}

// Child processes: this test binary, started again.

struct Killed(Child);

impl Killed {
    /// SIGKILL, without waiting for the child: it stays a zombie, as with a busy parent.
    fn kill(&mut self) {
        self.0.kill().expect("a child can be killed");
    }
}

impl Drop for Killed {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

fn spawn_child<T: Transport>(place: &T, role: Role, run_id: u64, folder: Option<&std::path::Path>) -> Killed {
    let mut command = Command::new(std::env::current_exe().expect("a test has a binary"));
    command
        .args(["child_process", "--exact", "--ignored", "--nocapture"])
        .env(
            CHILD,
            format!(
                "{};{};{};{run_id}",
                std::any::type_name::<T>(),
                place.to_text(),
                i32::from(role)
            ),
        );
    if let Some(folder) = folder {
        command.current_dir(folder);
    }
    command.stdout(std::process::Stdio::null());
    Killed(command.spawn().expect("the test binary starts"))
}

/// Plays a role for a test in another process. Not a test itself.
#[test]
#[ignore = "started by the tests that need a process to kill"]
fn child_process() {
    fn play<T: Transport>(place: &str, role: Role, run_id: u64) {
        let place = T::parse(place);
        let mut end = place.end(role, run_id).expect("the place exists");
        let options = options(&PATIENT);
        let result = match role {
            Role::Controller => serve_controller(&mut end, &mut Folding::new(), &options),
            Role::Fdi => serve_fdi(&mut end, &mut Folding::new(), &options),
            // Far longer than it will live.
            _ => fly(
                &mut EndpointLink::new(end, PATIENT),
                run_id,
                u64::MAX >> 24,
                Delays::NONE,
            ),
        };
        eprintln!("child: {result:?}");
    }
    let Ok(text) = std::env::var(CHILD) else { return };
    let mut parts = text.split(';');
    let mut next = || parts.next().expect("four parts");
    let (transport, place) = (next(), next());
    let role = Role::try_from(next().parse::<i32>().expect("a number")).expect("a role");
    let run_id = next().parse().expect("a number");
    match transport {
        name if name == std::any::type_name::<Iox2>() => play::<Iox2>(place, role, run_id),
        name if name == std::any::type_name::<ZenohHub>() => play::<ZenohHub>(place, role, run_id),
        name if name == std::any::type_name::<ZenohRouter>() => play::<ZenohRouter>(place, role, run_id),
        other => panic!("unknown transport {other}"),
    }
}

fn expect_err<T: Debug>(result: Result<T, LinkError>) -> LinkError {
    result.expect_err("this must fail")
}

// The suite.

/// A long flight: every step arrives once and in order at both peers, every answer bit for bit, for several windows.
fn every_step_once<T: Transport>() {
    let place = T::create();
    for (timing, steps) in [
        (window(128, 32), T::LONG_RUN),
        (window(0, 1), T::LONG_RUN / 10),
        (window(7, 3), 500),
        (window(256, 256), 700),
    ] {
        let run_id = run_id();
        let (plant, controller, fdi) = flight_as(
            &place,
            run_id,
            steps,
            timing,
            Folding::new(),
            Folding::new(),
            Delays::NONE,
        );
        assert_eq!(
            plant.expect("the flight succeeds"),
            reference_digest(run_id, steps),
            "{timing:?}"
        );
        assert_eq!(controller, Ok(steps));
        assert_eq!(fdi, Ok(steps));
    }
    place.assert_clean();
}

/// Random delays in all three do not change the results.
fn delays_change_nothing<T: Transport>() {
    let place = T::create();
    for seed in 0..4 {
        let run_id = run_id();
        let delayed = |salt| Folding {
            delays: Delays(Some(mix(seed, salt))),
            ..Folding::new()
        };
        let timing = [window(128, 32), window(0, 1), window(3, 2), window(16, 1)][seed as usize];
        let delays = Delays(Some(mix(seed, 3)));
        let (plant, controller, fdi) = flight_as(&place, run_id, 300, timing, delayed(1), delayed(2), delays);
        assert_eq!(
            plant.expect("the flight succeeds"),
            reference_digest(run_id, 300),
            "{timing:?}"
        );
        assert_eq!((controller, fdi), (Ok(300), Ok(300)));
    }
}

/// A rejection reaches the plant with its message; the other peer learns why the run failed.
fn refusals_reach_the_plant<T: Transport>() {
    let place = T::create();
    let refusing = || Folding {
        refusal: Some("rotor 3 is upside down".to_owned()),
        ..Folding::new()
    };
    let (plant, controller, fdi) = flight(&place, 10, PATIENT, refusing(), Folding::new());
    let error = expect_err(plant);
    assert_eq!(
        error,
        LinkError::Refused {
            role: Role::Controller,
            reason: "rotor 3 is upside down".to_owned()
        }
    );
    assert_eq!(controller, Err(error.clone()));
    assert_eq!(
        fdi,
        Err(LinkError::RunFailed {
            steps: 0,
            failure: error.to_string()
        })
    );

    let (plant, controller, fdi) = flight(&place, 10, PATIENT, Folding::new(), refusing());
    let error = expect_err(plant);
    assert_eq!(
        error.to_string(),
        "the FDI engine refused to start: rotor 3 is upside down"
    );
    assert_eq!(fdi, Err(error.clone()));
    assert_eq!(
        controller,
        Err(LinkError::RunFailed {
            steps: 0,
            failure: error.to_string()
        })
    );
}

/// Another protocol version is rejected by the plant and by a peer; both versions are named.
fn other_versions_are_refused<T: Transport>() {
    let place = T::create();
    let run = run_id();
    let stranger = {
        let place = place.clone();
        std::thread::spawn(move || {
            let mut end = place.end(Role::Controller, run).expect("the place exists");
            loop {
                end.send(&join_packet(&end, 99)).expect("the link works");
                end.wake(Role::Plant).expect("the link works");
                end.wait(Duration::from_millis(50)).expect("the link works");
                while let Some(packet) = end.poll().expect("the link works") {
                    if let Packet::Finish(finish) = packet {
                        return finish.failure;
                    }
                }
            }
        })
    };
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let error = expect_err(fly(&mut EndpointLink::new(plant, PATIENT), run, 10, Delays::NONE));
    let text = error.to_string();
    assert!(
        text.contains("controller") && text.contains("version 99") && text.contains("version 1"),
        "{text}"
    );
    assert_eq!(stranger.join().expect("no panic"), text, "the stranger hears why");

    let run = run_id();
    let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
    let mut plant = place.end(Role::Plant, run).expect("the place exists");
    await_packet(&mut plant, |packet| matches!(packet, Packet::Join(_)).then_some(()));
    let setup = Setup {
        run_id: run,
        role: Role::Fdi.into(),
        protocol_version: 2,
        ..Setup::default()
    };
    plant.send(&Packet::Setup(Box::new(setup))).expect("the link works");
    plant.wake(Role::Fdi).expect("the link works");
    let refusal = await_packet(&mut plant, |packet| {
        if let Packet::Ready(ready) = packet {
            Some(ready.refusal)
        } else {
            None
        }
    });
    assert!(
        refusal.contains("version 2") && refusal.contains("version 1"),
        "{refusal}"
    );
    assert_eq!(
        fdi.join().expect("no panic"),
        Err(LinkError::Refused {
            role: Role::Fdi,
            reason: refusal
        })
    );
}

/// A peer that never connects is named, with its expected address; the connected one is notified.
fn missing_peers_are_named<T: Transport>() {
    let place = T::create();
    let timing = LinkTiming {
        join: Duration::from_millis(700),
        ..PATIENT
    };
    let run = run_id();
    let controller = controller_thread(&place, run, PATIENT, Folding::new());
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let address = plant.address();
    let error = expect_err(fly(&mut EndpointLink::new(plant, timing), run, 10, Delays::NONE));
    assert_eq!(
        error,
        LinkError::PeerMissing {
            role: Role::Fdi,
            run_id: run,
            address,
            limit: timing.join,
            unused: None
        }
    );
    assert_eq!(
        controller.join().expect("no panic"),
        Err(LinkError::RunFailed {
            steps: 0,
            failure: error.to_string()
        })
    );
}

/// A peer that is alive but does not answer is named with its last step, its silence and the limit.
fn silent_peers_are_named<T: Transport>() {
    let place = T::create();
    let limit = Duration::from_millis(300);
    let stall = Some((20, Duration::from_millis(800)));
    let timing = LinkTiming {
        step: limit,
        ..window(4, 2)
    };

    let run = run_id();
    let controller = controller_thread(
        &place,
        run,
        PATIENT,
        Folding {
            stall,
            ..Folding::new()
        },
    );
    let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let error = expect_err(fly(&mut EndpointLink::new(plant, timing), run, 1000, Delays::NONE));
    let LinkError::PeerSilent {
        role: Role::Controller,
        last_step: Some(19),
        silence,
        limit: named,
        ..
    } = &error
    else {
        panic!("{error:?}")
    };
    assert!(
        *silence >= limit && *silence < DEATH_NOTICE && *named == limit,
        "{error}"
    );
    for peer in [controller, fdi] {
        let heard = expect_err(peer.join().expect("no panic"));
        assert_eq!(
            heard,
            LinkError::RunFailed {
                steps: 0,
                failure: error.to_string()
            }
        );
    }

    let run = run_id();
    let controller = controller_thread(&place, run, PATIENT, Folding::new());
    let fdi = fdi_thread(
        &place,
        run,
        PATIENT,
        Folding {
            stall,
            ..Folding::new()
        },
    );
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let error = expect_err(fly(&mut EndpointLink::new(plant, timing), run, 1000, Delays::NONE));
    let LinkError::PeerSilent {
        role: Role::Fdi,
        last_step: Some(19),
        silence,
        ..
    } = &error
    else {
        panic!("{error:?}")
    };
    assert!(*silence >= limit && *silence < DEATH_NOTICE, "{error}");
    for peer in [controller, fdi] {
        let heard = expect_err(peer.join().expect("no panic"));
        assert_eq!(
            heard,
            LinkError::RunFailed {
                steps: 0,
                failure: error.to_string()
            }
        );
    }
}

/// A plant that is alive but silent is named by both peers.
fn a_silent_plant_is_named<T: Transport>() {
    let place = T::create();
    let run = run_id();
    let timing = LinkTiming {
        join: Duration::from_millis(300),
        step: Duration::from_millis(100),
        ..PATIENT
    };
    let peers = [
        controller_thread(&place, run, timing, Folding::new()),
        fdi_thread(&place, run, timing, Folding::new()),
    ];
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let mut link = EndpointLink::new(plant, PATIENT);
    link.open(&run_setup(run, 100)).expect("both come");
    for peer in peers {
        let error = expect_err(peer.join().expect("no panic"));
        let LinkError::PeerSilent {
            role: Role::Plant,
            last_step: None,
            ..
        } = &error
        else {
            panic!("{error:?}")
        };
    }
}

/// A peer whose end disappears, in the same process, is named quickly, with its last step.
fn dropped_ends_are_named<T: Transport>() {
    let place = T::create();
    let run = run_id();
    let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
    let controller = raw_controller(&place, run, |end, frame, command| {
        frame.stamp.step < 50 && end.send(&Packet::Command(command)).is_ok()
    });
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let begin = Instant::now();
    let error = expect_err(fly(&mut EndpointLink::new(plant, PATIENT), run, 1000, Delays::NONE));
    let LinkError::PeerDied {
        role: Role::Controller,
        last_step: Some(49),
        silence,
        program,
    } = &error
    else {
        panic!("{error:?}")
    };
    assert!(*silence < DEATH_NOTICE && program.contains("raw peer"), "{error}");
    assert!(
        begin.elapsed() < PATIENT.step,
        "named by its death, not by the time-out"
    );
    controller.join().expect("no panic");
    let heard = expect_err(fdi.join().expect("no panic"));
    assert_eq!(
        heard,
        LinkError::RunFailed {
            steps: 0,
            failure: error.to_string()
        }
    );

    // A plant that is dropped in the middle of a run reports it itself.
    let run = run_id();
    let peers = [
        controller_thread(&place, run, PATIENT, Folding::new()),
        fdi_thread(&place, run, PATIENT, Folding::new()),
    ];
    let mut link = EndpointLink::new(place.end(Role::Plant, run).expect("the place exists"), PATIENT);
    link.open(&run_setup(run, 100)).expect("both come");
    for step in 0..5 {
        link.exchange(&sensors(run, step)).expect("the controller answers");
    }
    drop(link);
    for peer in peers {
        let LinkError::RunFailed { steps: 5, failure } = expect_err(peer.join().expect("no panic")) else {
            panic!("a last word was due")
        };
        assert!(failure.contains("gave up"), "{failure}");
    }
}

/// SIGKILL of the controller's, the FDI engine's or the plant's process: the others name it quickly, and the next run in the
/// same place is unaffected.
fn killed_processes_are_named_and_leave_nothing<T: Transport>() {
    let place = T::create();
    for role in [Role::Controller, Role::Fdi] {
        let run = run_id();
        let mut child = spawn_child(&place, role, run, None);
        let other = if role == Role::Controller {
            fdi_thread(&place, run, PATIENT, Folding::new())
        } else {
            controller_thread(&place, run, PATIENT, Folding::new())
        };
        let plant = place.end(Role::Plant, run).expect("the place exists");
        let mut link = EndpointLink::new(plant, PATIENT);
        link.open(&run_setup(run, 1 << 30)).expect("both come");
        let mut killed = None;
        let mut step = 0;
        let error = loop {
            if step == 300 {
                child.kill();
                killed = Some(Instant::now());
            }
            let result = link.exchange(&sensors(run, step)).and_then(|_| {
                while link.next_report(false)?.is_some() {}
                Ok(())
            });
            if let Err(error) = result {
                break error;
            }
            step += 1;
        };
        let noticed = killed.expect("it fails after the kill").elapsed();
        link.finish(step, Some(&error.to_string()));
        drop(link);
        let LinkError::PeerDied {
            role: named,
            last_step: Some(last),
            silence,
            program,
        } = &error
        else {
            panic!("{error:?}")
        };
        println!("{} named after {noticed:?}: {error}", std::any::type_name::<T>());
        assert_eq!(*named, role);
        assert!(program.contains(&child.0.id().to_string()), "{program}");
        assert!(*last + 128 >= 300 - 1 && *last <= step, "{error}, at step {step}");
        assert!(
            noticed < DEATH_NOTICE && *silence < DEATH_NOTICE,
            "after {noticed:?}: {error}"
        );
        let heard = expect_err(other.join().expect("no panic"));
        assert_eq!(
            heard,
            LinkError::RunFailed {
                steps: step,
                failure: error.to_string()
            }
        );
    }

    // The plant's process.
    let run = run_id();
    let watched = Folding::new();
    let done = Arc::clone(&watched.done);
    let mut child = spawn_child(&place, Role::Plant, run, None);
    let peers = [
        controller_thread(&place, run, PATIENT, watched),
        fdi_thread(&place, run, PATIENT, Folding::new()),
    ];
    let begin = Instant::now();
    while done.load(Ordering::SeqCst) < 300 {
        assert!(begin.elapsed() < PATIENT.join, "the plant flies");
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill();
    let killed = Instant::now();
    for peer in peers {
        let error = expect_err(peer.join().expect("no panic"));
        println!(
            "{} named after {:?}: {error}",
            std::any::type_name::<T>(),
            killed.elapsed()
        );
        let LinkError::PeerDied {
            role: Role::Plant,
            last_step: Some(_),
            ..
        } = &error
        else {
            panic!("{error:?}")
        };
        assert!(killed.elapsed() < DEATH_NOTICE, "after {:?}", killed.elapsed());
    }

    let run = run_id();
    let (plant, ..) = flight_as(&place, run, 300, PATIENT, Folding::new(), Folding::new(), Delays::NONE);
    assert_eq!(plant.expect("the flight succeeds"), reference_digest(run, 300));
    place.assert_clean();
}

/// Messages of another run and repetitions have no effect; a step from the future is an error that names the peer.
fn strays_are_ignored<T: Transport>() {
    let place = T::create();
    let run = run_id();
    let fdi = fdi_thread(&place, run, window(8, 4), Folding::new());
    let mut last: Option<CommandFrame> = None;
    let controller = raw_controller(&place, run, move |end, _, command| {
        let mut foreign = command;
        foreign.stamp.run_id ^= 1;
        foreign.duty = [1.0; 16];
        foreign.duty[ROTORS..].fill(0.0);
        let mut changed = command;
        changed.duty[0] = 0.123;
        let packets = [Some(foreign), last, Some(command), Some(command), Some(changed)];
        last = Some(command);
        for frame in packets.into_iter().flatten() {
            assert_eq!(end.send(&Packet::Command(frame)), Ok(Delivery::Complete));
        }
        true
    });
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let mut link = EndpointLink::new(plant, window(8, 4));
    let digest = fly_split(&mut link, run, 200, Delays::NONE);
    assert_eq!(digest.expect("the flight succeeds"), reference_digest(run, 200));
    drop(link);
    controller.join().expect("no panic");
    assert_eq!(fdi.join().expect("no panic"), Ok(200));

    // The same towards the peers: a plant that repeats messages and sends stray ones.
    let run = run_id();
    let peers = [
        controller_thread(&place, run, window(8, 4), Folding::new()),
        fdi_thread(&place, run, window(8, 4), Folding::new()),
    ];
    let end = place.end(Role::Plant, run).expect("the place exists");
    let mut straying = EndpointLink::new(Straying { end, last: None }, window(8, 4));
    let digest = fly_split(&mut straying, run, 200, Delays::NONE);
    assert_eq!(digest.expect("the flight succeeds"), reference_digest(run, 200));
    drop(straying);
    for peer in peers {
        assert_eq!(peer.join().expect("no panic"), Ok(200));
    }

    // A future step.
    let run = run_id();
    let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
    let controller = raw_controller(&place, run, |end, _, mut command| {
        command.stamp.step += u64::from(command.stamp.step == 7);
        end.send(&Packet::Command(command)).is_ok()
    });
    let plant = place.end(Role::Plant, run).expect("the place exists");
    let error = expect_err(fly(&mut EndpointLink::new(plant, PATIENT), run, 200, Delays::NONE));
    let LinkError::ProtocolViolation {
        role: Role::Controller,
        step: 8,
        ..
    } = &error
    else {
        panic!("{error:?}")
    };
    controller.join().expect("no panic");
    assert!(fdi.join().expect("no panic").is_err());
}

/// A controller that answers, but not this run or not this step, is not merely silent: the plant tells what came instead.
fn useless_answers_are_told<T: Transport>() {
    fn spoilt<T: Transport>(spoil: impl Fn(&mut CommandFrame) + Send + 'static) -> (u64, LinkError) {
        let place = T::create();
        let timing = LinkTiming {
            step: Duration::from_millis(300),
            ..window(4, 2)
        };
        let run = run_id();
        let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
        let controller = raw_controller(&place, run, move |end, _, mut command| {
            spoil(&mut command);
            end.send(&Packet::Command(command)).is_ok()
        });
        let plant = place.end(Role::Plant, run).expect("the place exists");
        let error = expect_err(fly(&mut EndpointLink::new(plant, timing), run, 100, Delays::NONE));
        controller.join().expect("no panic");
        assert!(fdi.join().expect("no panic").is_err());
        (run, error)
    }
    let told = |error: &LinkError| {
        let LinkError::PeerSilent {
            role: Role::Controller,
            last_step: Some(4),
            unused: Some(reason),
            ..
        } = error
        else {
            panic!("{error:?}")
        };
        assert!(error.to_string().ends_with(&format!("not used: {reason}")), "{error}");
        reason.clone()
    };
    let (run, error) = spoilt::<T>(|command| {
        if command.stamp.step > 4 {
            command.stamp.run_id = 0;
        }
    });
    let expected = format!("it names run 0000000000000000, this is run {run:016x}");
    assert_eq!(told(&error), expected);
    let (_, error) = spoilt::<T>(|command| command.stamp.step = command.stamp.step.min(4));
    assert_eq!(told(&error), "it answers step 4 again, step 5 is due");
}

/// Repeats every frame, and sends one from another run before it.
struct Straying<E> {
    end: E,
    last: Option<SensorFrame>,
}

impl<E: Endpoint> Endpoint for Straying<E> {
    fn role(&self) -> Role {
        self.end.role()
    }
    fn run_id(&self) -> u64 {
        self.end.run_id()
    }
    fn transport(&self) -> &'static str {
        self.end.transport()
    }
    fn address(&self) -> String {
        self.end.address()
    }
    fn send(&mut self, packet: &Packet) -> Result<Delivery, LinkError> {
        if let Packet::Sensors(frame) = packet {
            let mut foreign = *frame;
            foreign.stamp.run_id ^= 1;
            foreign.position_ned_m[0] += 1.0;
            self.end.send(&Packet::Sensors(foreign))?;
            if let Some(last) = self.last.replace(*frame) {
                self.end.send(&Packet::Sensors(last))?;
            }
            self.end.send(packet)?;
        }
        self.end.send(packet)
    }
    fn wake(&mut self, role: Role) -> Result<(), LinkError> {
        self.end.wake(role)
    }
    fn poll(&mut self) -> Result<Option<Packet>, LinkError> {
        self.end.poll()
    }
    fn wait(&mut self, at_most: Duration) -> Result<(), LinkError> {
        self.end.wait(at_most)
    }
    fn is_gone(&mut self, role: Role, thorough: bool) -> bool {
        self.end.is_gone(role, thorough)
    }
}

/// An impossible number is an error that names the peer, the step and the field.
fn nonsense_is_named<T: Transport>() {
    let place = T::create();
    let bad = || Folding {
        nan_at: Some(7),
        ..Folding::new()
    };
    let (plant, controller, fdi) = flight(&place, 100, window(0, 1), bad(), Folding::new());
    let error = expect_err(plant);
    let LinkError::ProtocolViolation {
        role: Role::Controller,
        step: 7,
        reason,
    } = &error
    else {
        panic!("{error:?}")
    };
    assert_eq!(reason, "MotorCommand.duty[2] is NaN, expected a finite number");
    assert_eq!(
        controller,
        Err(LinkError::RunFailed {
            steps: 0,
            failure: error.to_string()
        })
    );
    assert!(fdi.is_err());

    let (plant, _, fdi) = flight(&place, 100, window(0, 1), Folding::new(), bad());
    let error = expect_err(plant);
    let LinkError::ProtocolViolation {
        role: Role::Fdi,
        step: 7,
        reason,
    } = &error
    else {
        panic!("{error:?}")
    };
    assert!(reason.starts_with("FdiReport.residual_nms[5] is inf"), "{reason}");
    assert_eq!(
        fdi,
        Err(LinkError::RunFailed {
            steps: 0,
            failure: error.to_string()
        })
    );
}

/// The reason of a failure reaches both peers.
fn failures_reach_the_peers<T: Transport>() {
    let place = T::create();
    let run = run_id();
    let peers = [
        controller_thread(&place, run, PATIENT, Folding::new()),
        fdi_thread(&place, run, PATIENT, Folding::new()),
    ];
    let mut link = EndpointLink::new(place.end(Role::Plant, run).expect("the place exists"), PATIENT);
    link.open(&run_setup(run, 100)).expect("both come");
    for step in 0..5 {
        link.exchange(&sensors(run, step)).expect("the controller answers");
    }
    let begin = Instant::now();
    link.finish(5, Some("the vehicle hit the ground"));
    // The contract says 100 ms; the rest is margin for a busy machine.
    assert!(
        begin.elapsed() < Duration::from_millis(400),
        "finish blocked for {:?}",
        begin.elapsed()
    );
    for peer in peers {
        let expected = LinkError::RunFailed {
            steps: 5,
            failure: "the vehicle hit the ground".to_owned(),
        };
        assert_eq!(peer.join().expect("no panic"), Err(expected));
    }
}

/// Two simultaneous runs do not disturb each other.
fn two_runs_at_once<T: Transport>() {
    let places = [T::create(), T::create()];
    let shared = [places[0].clone(), places[0].second()];
    for pair in [places, shared] {
        let runs = pair.map(|place| {
            std::thread::spawn(move || {
                let run = run_id();
                let outcome = flight_as(&place, run, 400, PATIENT, Folding::new(), Folding::new(), Delays::NONE);
                assert_eq!(outcome.0.expect("the flight succeeds"), reference_digest(run, 400));
                assert_eq!((outcome.1, outcome.2), (Ok(400), Ok(400)));
            })
        });
        for run in runs {
            run.join().expect("no panic");
        }
    }
}

/// The plant never gets further ahead of the FDI engine than the window.
fn the_window_bounds_the_trail<T: Transport>() {
    let place = T::create();
    for (fdi_window, fdi_batch) in [(0, 1), (1, 1), (8, 4)] {
        let timing = window(fdi_window, fdi_batch);
        let run = run_id();
        let slow = Folding {
            work: Duration::from_micros(300),
            ..Folding::new()
        };
        let done = Arc::clone(&slow.done);
        let controller = controller_thread(&place, run, timing, Folding::new());
        let fdi = fdi_thread(&place, run, timing, slow);
        let mut link = EndpointLink::new(place.end(Role::Plant, run).expect("the place exists"), timing);
        link.open(&run_setup(run, 100)).expect("both come");
        let mut furthest = 0;
        for step in 0..100 {
            link.exchange(&sensors(run, step)).expect("the controller answers");
            while link.next_report(false).expect("the FDI engine answers").is_some() {}
            furthest = furthest.max(step + 1 - done.load(Ordering::SeqCst).min(step + 1));
        }
        while link.next_report(true).expect("the FDI engine answers").is_some() {}
        link.finish(100, None);
        assert!(
            furthest <= fdi_window,
            "{furthest} steps behind with a window of {fdi_window}"
        );
        assert_eq!(
            (controller.join().expect("no panic"), fdi.join().expect("no panic")),
            (Ok(100), Ok(100))
        );
    }
}

macro_rules! suite {
    ($module:ident, $transport:ty) => {
        mod $module {
            use super::*;

            #[test]
            fn scenario_every_step_once() {
                every_step_once::<$transport>();
            }
            #[test]
            fn scenario_delays_change_nothing() {
                delays_change_nothing::<$transport>();
            }
            #[test]
            fn scenario_refusals_reach_the_plant() {
                refusals_reach_the_plant::<$transport>();
            }
            #[test]
            fn scenario_other_versions_are_refused() {
                other_versions_are_refused::<$transport>();
            }
            #[test]
            fn scenario_missing_peers_are_named() {
                missing_peers_are_named::<$transport>();
            }
            #[test]
            fn scenario_silent_peers_are_named() {
                silent_peers_are_named::<$transport>();
            }
            #[test]
            fn scenario_a_silent_plant_is_named() {
                a_silent_plant_is_named::<$transport>();
            }
            #[test]
            fn scenario_dropped_ends_are_named() {
                dropped_ends_are_named::<$transport>();
            }
            #[test]
            fn scenario_killed_processes_are_named_and_leave_nothing() {
                killed_processes_are_named_and_leave_nothing::<$transport>();
            }
            #[test]
            fn scenario_strays_are_ignored() {
                strays_are_ignored::<$transport>();
            }
            #[test]
            fn scenario_nonsense_is_named() {
                nonsense_is_named::<$transport>();
            }
            #[test]
            fn scenario_failures_reach_the_peers() {
                failures_reach_the_peers::<$transport>();
            }
            #[test]
            fn scenario_two_runs_at_once() {
                two_runs_at_once::<$transport>();
            }
            #[test]
            fn scenario_useless_answers_are_told() {
                useless_answers_are_told::<$transport>();
            }
            #[test]
            fn scenario_the_window_bounds_the_trail() {
                the_window_bounds_the_trail::<$transport>();
            }
        }
    };
}

suite!(iceoryx2, Iox2);
suite!(zenoh_plant_is_hub, ZenohHub);
suite!(zenoh_through_a_router, ZenohRouter);

mod in_process {
    use super::*;

    #[test]
    fn scenario_repeats_itself_and_names_refusals_and_nonsense() {
        assert_eq!(reference_digest(1, 1000), reference_digest(1, 1000));
        assert_ne!(
            reference_digest(1, 1000),
            reference_digest(1, 999),
            "the digest sees each step"
        );

        let refusing = Folding {
            refusal: Some("no".to_owned()),
            ..Folding::new()
        };
        let error = expect_err(fly(
            &mut InProcessLink::new(Folding::new(), refusing),
            1,
            10,
            Delays::NONE,
        ));
        assert_eq!(
            error,
            LinkError::Refused {
                role: Role::Fdi,
                reason: "no".to_owned()
            }
        );

        let bad = Folding {
            nan_at: Some(7),
            ..Folding::new()
        };
        let error = expect_err(fly(&mut InProcessLink::new(bad, Folding::new()), 1, 10, Delays::NONE));
        let LinkError::ProtocolViolation {
            role: Role::Controller,
            step: 7,
            reason,
        } = &error
        else {
            panic!("{error:?}")
        };
        assert_eq!(reason, "MotorCommand.duty[2] is NaN, expected a finite number");
    }
}

/// Tests specific to iceoryx2.
mod iceoryx2_only {
    use super::*;

    /// By default iceoryx2 reads `config/iceoryx2.toml` in the current folder, and then finds no peers.
    #[test]
    fn regress_a_configuration_file_in_the_current_folder_is_not_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::create_dir(folder.path().join("config")).expect("a new folder");
        std::fs::write(
            folder.path().join("config/iceoryx2.toml"),
            "[global]\nprefix = \"elsewhere_\"\n",
        )
        .expect("a new file");
        let place = Iox2::create();
        let run = run_id();
        let _controller = spawn_child(&place, Role::Controller, run, Some(folder.path()));
        let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
        let mut link = EndpointLink::new(place.end(Role::Plant, run).expect("the place exists"), PATIENT);
        assert_eq!(
            fly_split(&mut link, run, 50, Delays::NONE),
            Ok(reference_digest(run, 50))
        );
        assert_eq!(fdi.join().expect("no panic"), Ok(50));
    }

    /// A second controller in the same run is rejected at startup, with a hint.
    #[test]
    fn scenario_a_second_controller_is_refused() {
        let place = Iox2::create();
        let run = run_id();
        let _first = place.end(Role::Controller, run).expect("the place exists");
        let error = expect_err(place.end(Role::Controller, run));
        assert!(error.to_string().contains("is another one already running?"), "{error}");
    }

    /// Killed repeatedly at random times: the next run always starts, and nothing accumulates.
    #[test]
    fn scenario_many_kills_leave_nothing() {
        let place = Iox2::create();
        let mut random = 11;
        for _ in 0..8 {
            random = mix(random, 1);
            let run = run_id();
            let mut child = spawn_child(&place, Role::Controller, run, None);
            // From before its first port to some time into the flight.
            std::thread::sleep(Duration::from_micros(random % 12_000));
            child.kill();
            drop(child);
        }
        let run = run_id();
        let (plant, ..) = flight_as(&place, run, 300, PATIENT, Folding::new(), Folding::new(), Delays::NONE);
        assert_eq!(plant.expect("the flight succeeds"), reference_digest(run, 300));
        place.assert_clean();
    }

    #[test]
    fn val_bad_places_are_named() {
        let options = Iox2Options {
            prefix: "no/slash".to_owned(),
            ..Iox2Options::default()
        };
        let error = expect_err(Iox2Endpoint::new(Role::Plant, 1, options));
        assert!(error.to_string().contains("no/slash"), "{error}");
        let options = Iox2Options {
            root: "/proc/nowhere".into(),
            ..Iox2Options::default()
        };
        let error = expect_err(Iox2Endpoint::new(Role::Plant, 1, options));
        assert!(error.to_string().contains("/proc/nowhere"), "{error}");
    }
}

/// Tests specific to zenoh.
mod zenoh_only {
    use super::*;

    #[test]
    fn val_unreachable_endpoints_are_named_in_time() {
        let endpoint = ZenohOptions::free_loopback_endpoint().expect("a port is free");
        let options = ZenohOptions {
            connect_timeout: Duration::from_millis(300),
            ..ZenohOptions::connect(&endpoint)
        };
        let begin = Instant::now();
        let error = expect_err(ZenohEndpoint::new(Role::Controller, 1, options));
        assert_eq!(
            error.to_string(),
            format!("zenoh: connecting to {endpoint} for 300 ms failed: no response there")
        );
        assert!(begin.elapsed() < Duration::from_secs(3), "after {:?}", begin.elapsed());
    }

    #[test]
    fn val_taken_ports_are_named() {
        let listener = std::net::TcpListener::bind(("127.0.0.1", 0)).expect("a port is free");
        let endpoint = format!("tcp/{}", listener.local_addr().expect("it is bound"));
        let begin = Instant::now();
        let error = expect_err(ZenohEndpoint::new(Role::Plant, 1, ZenohOptions::listen(&endpoint)));
        assert!(
            error
                .to_string()
                .starts_with(&format!("zenoh: listening on {endpoint} failed")),
            "{error}"
        );
        assert!(begin.elapsed() < Duration::from_secs(3), "after {:?}", begin.elapsed());
    }

    /// A client of the hub that is not one of our endpoints.
    fn foreign_session(place: &ZenohHub) -> zenoh::Session {
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", "\"client\"".to_owned()),
            ("connect/endpoints", format!("[{:?}]", place.0)),
            ("scouting/multicast/enabled", "false".to_owned()),
        ] {
            config.insert_json5(key, &value).expect("a valid setting");
        }
        zenoh::Wait::wait(zenoh::open(config)).expect("the plant listens")
    }

    #[test]
    fn scenario_an_answer_that_cannot_be_read_is_blamed_on_its_step() {
        let place = ZenohHub::create();
        let run = run_id();
        let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
        let own_place = place.clone();
        let mut foreign = None;
        let controller = raw_controller(&place, run, move |end, frame, command| {
            if frame.stamp.step < 7 {
                return end.send(&Packet::Command(command)).is_ok();
            }
            let session = foreign.get_or_insert_with(|| foreign_session(&own_place));
            let sent = session.put(format!("rotortwin/v1/{run:016x}/command"), vec![0xff_u8; 9]);
            zenoh::Wait::wait(sent).is_ok()
        });
        let plant = place.end(Role::Plant, run).expect("the place exists");
        let error = expect_err(fly(&mut EndpointLink::new(plant, PATIENT), run, 100, Delays::NONE));
        let LinkError::ProtocolViolation {
            role: Role::Controller,
            step: 7,
            reason,
        } = &error
        else {
            panic!("{error:?}")
        };
        assert!(reason.contains("MotorCommand"), "{reason}");
        controller.join().expect("no panic");
        assert!(fdi.join().expect("no panic").is_err());
    }

    #[test]
    fn scenario_a_request_to_join_in_another_role_is_told() {
        let place = ZenohHub::create();
        let run = run_id();
        let timing = LinkTiming {
            join: Duration::from_millis(900),
            ..PATIENT
        };
        let plant = place.end(Role::Plant, run).expect("the place exists");
        let fdi = fdi_thread(&place, run, PATIENT, Folding::new());
        let own_place = place.clone();
        let stranger = std::thread::spawn(move || {
            let session = foreign_session(&own_place);
            let join = Join {
                run_id: run,
                role: Role::Fdi.into(),
                protocol_version: rotortwin_wire::PROTOCOL_VERSION,
                ..Join::default()
            };
            let bytes = prost::Message::encode_to_vec(&join);
            for _ in 0..6 {
                let sent = session.put(format!("rotortwin/v1/{run:016x}/join/controller"), bytes.clone());
                zenoh::Wait::wait(sent).expect("the plant listens");
                std::thread::sleep(Duration::from_millis(100));
            }
        });
        let error = expect_err(fly(&mut EndpointLink::new(plant, timing), run, 10, Delays::NONE));
        let LinkError::PeerMissing {
            role: Role::Controller,
            unused: Some(reason),
            ..
        } = &error
        else {
            panic!("{error:?}")
        };
        assert!(
            reason.contains("it claims to be from the FDI engine, but came from the controller"),
            "{reason}"
        );
        stranger.join().expect("no panic");
        assert!(fdi.join().expect("no panic").is_err());
    }

    #[test]
    fn val_malformed_endpoints_are_named() {
        for endpoint in ["", "127.0.0.1:7447", "udp/127.0.0.1:7447", "tcp"] {
            let error = expect_err(ZenohEndpoint::new(Role::Plant, 1, ZenohOptions::listen(endpoint)));
            assert!(error.to_string().contains(&format!("{endpoint:?}")), "{error}");
        }
    }
}
