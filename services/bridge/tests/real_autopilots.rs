//! The real autopilots, as their own published simulator builds. Each test is counted as skipped if its variable does not name the program:
//! `ROTORTWIN_ARDUCOPTER`, `ROTORTWIN_PX4` (`build/…/bin/px4`, with its `etc` next to `bin`), `ROTORTWIN_BETAFLIGHT`. They bind fixed ports, so there is one flight at a
//! time.
#![expect(clippy::unwrap_used, reason = "a flight that cannot begin has failed its test")]

mod autopilots;
#[path = "../../../tests/src/skip.rs"]
#[expect(unreachable_pub, reason = "it is a module of another crate, too")]
mod skip;

use autopilots::{HEIGHT_M, HEXAROTOR, Watch, scenario_of};
use rotortwin_bridge::autopilot::address::Protocol;
use rotortwin_bridge::autopilot::ardupilot::ArduPilot;
use rotortwin_bridge::autopilot::betaflight::Betaflight;
use rotortwin_bridge::autopilot::pilot::{self, Pilot, Piloted};
use rotortwin_bridge::autopilot::px4::Px4;
use rotortwin_bridge::autopilot::{OutputMap, Patience};
use rotortwin_flight::autopilot::{AutopilotOutcome, HandOver, fly};
use rotortwin_flight::lockstep::{FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::sample::Sample;
use rotortwin_flight::setup::run_setup;
use rotortwin_plant::sensing::instruments::InstrumentModel;
use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
use rotortwin_wire::autopilot::Autopilot;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Start of the fault and end of the flight, s after the hand-over.
const FAULT_S: f64 = 20.0;
const FLIGHT_S: f64 = 32.0;
/// Largest distance from the hover point before the fault, m. Betaflight is controlled by its sticks, and is not in lockstep: on a busy machine it drifts.
const ARDUPILOT_WITHIN_M: f64 = 0.3;
const PX4_WITHIN_M: f64 = 0.3;
const BETAFLIGHT_WITHIN_M: f64 = 2.0;

/// Ends its process; its last output is shown if the test fails.
struct Running(Child, PathBuf);

/// Number of lines shown.
const SHOWN: usize = 40;

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.0.kill());
        drop(self.0.wait());
        if std::thread::panicking() {
            let text = std::fs::read(&self.1).unwrap_or_default();
            let text = String::from_utf8_lossy(&text);
            let lines: Vec<&str> = text.lines().collect();
            eprintln!("the autopilot's console ends with");
            for line in &lines[lines.len().saturating_sub(SHOWN)..] {
                eprintln!("  {line}");
            }
        }
    }
}

/// A program, with a lock for exclusive use: every autopilot chooses its own ports.
struct Program(
    PathBuf,
    #[expect(dead_code, reason = "held while it flies")] MutexGuard<'static, ()>,
);

impl Deref for Program {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

/// The program named by a variable; otherwise the test is counted as skipped.
fn program(variable: &str) -> Option<Program> {
    static TURN: Mutex<()> = Mutex::new(());
    let named = std::env::var_os(variable).map(PathBuf::from);
    if named.is_none() {
        skip::skip(&format!("{variable} names no simulator build of the autopilot"));
    }
    named.map(|path| Program(path, TURN.lock().unwrap_or_else(PoisonError::into_inner)))
}

fn settings(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../config/autopilot-settings")
        .join(name)
}

fn start(program: &Path, args: &[&str], folder: &Path) -> Running {
    start_with(program, args, &[], folder)
}

fn start_with(program: &Path, args: &[&str], environment: &[(String, String)], folder: &Path) -> Running {
    let console = folder.join("console.txt");
    let log = std::fs::File::create(&console).unwrap();
    let child = Command::new(program)
        .args(args)
        .envs(environment.iter().cloned())
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(log.try_clone().unwrap())
        .stderr(log)
        .spawn()
        .unwrap();
    Running(child, console)
}

/// Records messages, and when a verdict was given.
struct Listener {
    watch: Watch,
    /// Damaged rotor, from 1; 0: none.
    rotor: i32,
    farthest_before_fault_m: f64,
    isolated_s: Option<f64>,
    alarmed: Option<f64>,
    chatty: bool,
}

impl FlightObserver for Listener {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        self.watch.sample(sample)?;
        let time_s = sample.sensors.stamp.sim_time_ns as f64 * 1e-9;
        if time_s < FAULT_S || self.rotor == 0 {
            self.farthest_before_fault_m = self.watch.farthest_m;
            if sample.report.sequential > 0 || sample.report.sequential == -1 {
                self.alarmed.get_or_insert(time_s);
            }
        } else if sample.report.sequential == self.rotor {
            self.isolated_s.get_or_insert(time_s);
        }
        if self.chatty && sample.sensors.stamp.step.is_multiple_of(1600) {
            eprintln!(
                "{time_s:6.1} s  p {:.2?}  duty {:.3?}  verdict {}",
                sample.truth.position_ned_m, sample.command.duty, sample.report.sequential
            );
        }
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }

    fn handed_over(&mut self, prelude_s: f64) {
        if self.chatty {
            eprintln!("hand-over after {prelude_s:.1} s");
        }
    }

    fn words(&mut self, plant_time_s: f64, text: String) {
        if self.chatty {
            eprintln!("{plant_time_s:7.1} s  {text}");
        }
    }
}

/// The vehicle: a hexarotor X, a quadrotor X, or an octorotor X.
#[derive(Clone, Copy)]
enum Layout {
    Hexa,
    Quad,
    Octo,
}

impl Layout {
    fn of<T>(self, [hexa, quad, octo]: [T; 3]) -> T {
        match self {
            Self::Hexa => hexa,
            Self::Quad => quad,
            Self::Octo => octo,
        }
    }

    fn vehicle(self) -> &'static str {
        self.of([HEXAROTOR, "quad-x-skids", "octo-x-skids"])
    }

    fn rotors(self) -> i32 {
        self.of([6, 4, 8])
    }
}

/// One flight to fly.
#[derive(Clone, Copy)]
struct Order {
    kind: AutopilotKind,
    duration_s: f64,
    /// Loses 10 % of its thrust at [`FAULT_S`], from 1; 0: none.
    rotor: i32,
    seed: u64,
    layout: Layout,
    chatty: bool,
}

/// A hover, optionally with a damaged propeller, and a landing.
fn flown<A: Autopilot>(order: Order, open: impl FnOnce(OutputMap, Patience) -> A) -> (Listener, AutopilotOutcome) {
    let fault = match order.rotor {
        0 => String::new(),
        rotor => format!("[[fault]]\ntime_s = {FAULT_S:?}\nrotor = {rotor}\nthrust_loss_percent = 10.0"),
    };
    let scenario = scenario_of(order.layout.vehicle(), order.duration_s, &fault);
    let (frame, rotor_of_channel) = AutopilotFrame::of_vehicle(order.kind, scenario.vehicle()).unwrap();
    let map = OutputMap {
        rotor_of_channel,
        pulse_min_us: frame.pulse.min_us,
        pulse_max_us: frame.pulse.max_us,
    };
    let patience = Patience {
        join: Duration::from_secs(60),
        step: Duration::from_secs(30),
        ..Patience::default()
    };
    let mut autopilot = open(map, patience);
    let mut simulation = scenario.simulation(order.seed).unwrap();
    let setup = run_setup(&scenario, &simulation, order.seed);
    let model = InstrumentModel::default();
    let mut listener = Listener {
        watch: Watch::default(),
        rotor: order.rotor,
        farthest_before_fault_m: 0.0,
        isolated_s: None,
        alarmed: None,
        chatty: order.chatty,
    };
    let outcome = fly(
        &mut simulation,
        &mut autopilot,
        &setup,
        (&model, order.seed),
        HandOver::default(),
        &mut listener,
    );
    (listener, outcome)
}

/// A flight that loses 10 % of the thrust of rotor 3.
fn third_rotor(kind: AutopilotKind) -> Order {
    Order {
        kind,
        duration_s: FLIGHT_S,
        rotor: 3,
        seed: 1,
        layout: Layout::Hexa,
        chatty: true,
    }
}

/// It hovered within `within_m` and landed, and the damage was isolated.
fn hovered_and_the_damage_was_isolated(within_m: f64, (listener, outcome): (Listener, AutopilotOutcome)) {
    assert_eq!(outcome.flight.end, FlightEnd::Done);
    eprintln!(
        "farthest from {HEIGHT_M} m: {:.3} m, with the fault {:.3} m; isolated at {:?} s; landed after {:?} s; {:?} wall",
        listener.farthest_before_fault_m,
        listener.watch.farthest_m,
        listener.isolated_s,
        outcome.landing_s,
        outcome.flight.wall
    );
    assert!(outcome.landing_s.is_some(), "it has not landed");
    assert_eq!(listener.alarmed, None, "an alarm while it was healthy");
    let isolated_s = listener.isolated_s.expect("the damage is isolated");
    assert!(isolated_s - FAULT_S < 6.0, "{isolated_s} s");
    assert!(
        listener.farthest_before_fault_m < within_m,
        "{} m",
        listener.farthest_before_fault_m
    );
}

fn flies_betaflight(layout: Layout) {
    let Some(program) = program("ROTORTWIN_BETAFLIGHT") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let lines = settings(layout.of([
        "betaflight-hex6x.cli.txt",
        "betaflight-quadx.cli.txt",
        "betaflight-octoflatx.cli.txt",
    ]));
    drop(
        start(&program, &["--config", lines.to_str().unwrap()], folder.path())
            .0
            .wait(),
    );
    let _running = start(&program, &[], folder.path());
    let address = std::env::var("ROTORTWIN_BETAFLIGHT_ADDRESS").unwrap_or_else(|_| "betaflight".to_owned());
    let order = Order {
        layout,
        ..third_rotor(AutopilotKind::Betaflight)
    };
    let flight = flown(order, |map, patience| {
        Betaflight::listen(&address.parse().unwrap(), true, map, patience).unwrap()
    });
    hovered_and_the_damage_was_isolated(BETAFLIGHT_WITHIN_M, flight);
}

#[test]
fn scenario_betaflight() {
    flies_betaflight(Layout::Hexa);
}

#[test]
fn scenario_betaflight_flies_a_quadrotor() {
    flies_betaflight(Layout::Quad);
}

#[test]
fn scenario_betaflight_flies_an_octorotor() {
    flies_betaflight(Layout::Octo);
}

/// `NAME=VALUE` of each line of a shell script.
fn environment(file: &Path) -> Vec<(String, String)> {
    let text = std::fs::read_to_string(file).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .filter_map(|line| line.split_once('='))
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .collect()
}

/// Autopilots that wait for the plant in each step, and take commands from our pilot.
#[derive(Clone, Copy)]
enum Lockstep {
    ArduCopter,
    Px4,
}

impl Lockstep {
    fn of<T>(self, [arducopter, px4]: [T; 2]) -> T {
        match self {
            Self::ArduCopter => arducopter,
            Self::Px4 => px4,
        }
    }

    /// The variable that names its program.
    fn variable(self) -> &'static str {
        self.of(["ROTORTWIN_ARDUCOPTER", "ROTORTWIN_PX4"])
    }

    fn within_m(self) -> f64 {
        self.of([ARDUPILOT_WITHIN_M, PX4_WITHIN_M])
    }

    fn third_rotor(self) -> Order {
        third_rotor(self.of([AutopilotKind::ArduPilot, AutopilotKind::Px4]))
    }

    fn piloted<A: Autopilot>(self, link: A) -> Piloted<A> {
        let protocol = self.of([Protocol::ArduPilot, Protocol::Px4]);
        let at = pilot::default_address(protocol).unwrap();
        Piloted::new(link, Some(Pilot::new(protocol, at, pilot::MEET).unwrap()))
    }

    /// One flight with a separate process in `folder`; it ends with the first value.
    fn fly(self, program: &Path, folder: &Path, order: Order) -> (Running, (Listener, AutopilotOutcome)) {
        let mut running = None;
        let flight = match self {
            Self::ArduCopter => flown(order, |map, patience| {
                let link = ArduPilot::listen("127.0.0.1:9002".parse().unwrap(), map, patience).unwrap();
                running = Some(start_arducopter(program, folder, order.layout));
                self.piloted(link)
            }),
            Self::Px4 => flown(order, |map, patience| {
                let link = Px4::listen("127.0.0.1:4560".parse().unwrap(), map, patience).unwrap();
                running = Some(start_px4(program, folder, order.layout));
                self.piloted(link)
            }),
        };
        (running.unwrap(), flight)
    }
}

fn start_arducopter(program: &Path, folder: &Path, layout: Layout) -> Running {
    let lines = settings(layout.of([
        "ardupilot-hexa-x.parm",
        "ardupilot-quad-x.parm",
        "ardupilot-octo-x.parm",
    ]));
    let args = [
        "--wipe",
        "--model",
        "JSON:127.0.0.1",
        "--home",
        "47.397742,8.545594,488,0",
        "-r",
        "1000",
        "--speedup",
        "20",
        "--defaults",
        lines.to_str().unwrap(),
    ];
    start(program, &args, folder)
}

fn start_px4(program: &Path, folder: &Path, layout: Layout) -> Running {
    let etc = program.with_file_name("../etc");
    let environment = environment(&settings(layout.of([
        "px4-hexa-x.env",
        "px4-quad-x.env",
        "px4-octo-x.env",
    ])));
    start_with(program, &["-d", etc.to_str().unwrap()], &environment, folder)
}

fn flies(autopilot: Lockstep, layout: Layout) {
    let Some(program) = program(autopilot.variable()) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let order = Order {
        layout,
        ..autopilot.third_rotor()
    };
    let (_running, flight) = autopilot.fly(&program, folder.path(), order);
    hovered_and_the_damage_was_isolated(autopilot.within_m(), flight);
}

#[test]
fn scenario_px4() {
    flies(Lockstep::Px4, Layout::Hexa);
}

#[test]
fn scenario_px4_flies_a_quadrotor() {
    flies(Lockstep::Px4, Layout::Quad);
}

#[test]
fn scenario_px4_flies_an_octorotor() {
    flies(Lockstep::Px4, Layout::Octo);
}

#[test]
fn scenario_arducopter() {
    flies(Lockstep::ArduCopter, Layout::Hexa);
}

#[test]
fn scenario_arducopter_flies_a_quadrotor() {
    flies(Lockstep::ArduCopter, Layout::Quad);
}

#[test]
fn scenario_arducopter_flies_an_octorotor() {
    flies(Lockstep::ArduCopter, Layout::Octo);
}

/// Each rotor and three seeds; one of them may be wrong.
fn each_rotor(autopilot: Lockstep, layout: Layout) {
    let rotors = layout.rotors();
    let program = program(autopilot.variable()).expect("asked for by name, it needs the program");
    let mut right = 0;
    eprintln!("rotor seed  isolated after  alarm before  farthest, with the fault  landed  wall");
    for (rotor, seed) in (1..=rotors).flat_map(|rotor| (1..=3).map(move |seed| (rotor, seed))) {
        let folder = tempfile::tempdir().unwrap();
        let order = Order {
            rotor,
            seed,
            layout,
            chatty: false,
            ..autopilot.third_rotor()
        };
        let (_running, (listener, outcome)) = autopilot.fly(&program, folder.path(), order);
        let delay_s = listener.isolated_s.map(|time_s| time_s - FAULT_S);
        let seconds = |time_s: Option<f64>| time_s.map_or("none".to_owned(), |time_s| format!("{time_s:.2} s"));
        eprintln!(
            "{rotor:5} {seed:4}  {:>14}  {:>12}  {:.3} m, {:.3} m  {:>6}  {:.0} s",
            seconds(delay_s),
            seconds(listener.alarmed),
            listener.farthest_before_fault_m,
            listener.watch.farthest_m,
            seconds(outcome.landing_s),
            outcome.flight.wall.as_secs_f64()
        );
        let good = outcome.flight.end == FlightEnd::Done
            && outcome.landing_s.is_some()
            && listener.alarmed.is_none()
            && listener.watch.verdict == rotor
            && delay_s.is_some_and(|delay_s| delay_s <= 3.0)
            && listener.farthest_before_fault_m < autopilot.within_m();
        right += u32::from(good);
    }
    let flights = 3 * rotors as u32;
    assert!(right + 1 >= flights, "{right} of {flights} flights were right");
}

#[test]
#[ignore = "eighteen flights, some minutes"]
fn scenario_px4_each_rotor() {
    each_rotor(Lockstep::Px4, Layout::Hexa);
}

#[test]
#[ignore = "twelve flights, some minutes"]
fn scenario_px4_each_rotor_of_a_quadrotor() {
    each_rotor(Lockstep::Px4, Layout::Quad);
}

#[test]
#[ignore = "twenty-four flights, some minutes"]
fn scenario_px4_each_rotor_of_an_octorotor() {
    each_rotor(Lockstep::Px4, Layout::Octo);
}

#[test]
#[ignore = "eighteen flights, some minutes"]
fn scenario_arducopter_each_rotor() {
    each_rotor(Lockstep::ArduCopter, Layout::Hexa);
}

#[test]
#[ignore = "twelve flights, some minutes"]
fn scenario_arducopter_each_rotor_of_a_quadrotor() {
    each_rotor(Lockstep::ArduCopter, Layout::Quad);
}

#[test]
#[ignore = "twenty-four flights, some minutes"]
fn scenario_arducopter_each_rotor_of_an_octorotor() {
    each_rotor(Lockstep::ArduCopter, Layout::Octo);
}

/// Healthy for `ROTORTWIN_HEALTHY_S` (1800) s.
fn healthy(autopilot: Lockstep) {
    let program = program(autopilot.variable()).expect("asked for by name, it needs the program");
    let duration_s = std::env::var("ROTORTWIN_HEALTHY_S").map_or(1800.0, |text| text.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let order = Order {
        duration_s,
        rotor: 0,
        chatty: false,
        ..autopilot.third_rotor()
    };
    let (_running, (listener, outcome)) = autopilot.fly(&program, folder.path(), order);
    eprintln!(
        "{duration_s} s: farthest {:.3} m, alarm {:?}, landed {:?}, {:?} wall",
        listener.farthest_before_fault_m, listener.alarmed, outcome.landing_s, outcome.flight.wall
    );
    assert_eq!(outcome.flight.end, FlightEnd::Done);
    assert!(outcome.landing_s.is_some(), "it has not landed");
    assert_eq!(listener.alarmed, None);
    assert!(
        listener.farthest_before_fault_m < autopilot.within_m(),
        "{} m",
        listener.farthest_before_fault_m
    );
}

#[test]
#[ignore = "half an hour of simulated time"]
fn scenario_px4_healthy() {
    healthy(Lockstep::Px4);
}

#[test]
#[ignore = "half an hour of simulated time"]
fn scenario_arducopter_healthy() {
    healthy(Lockstep::ArduCopter);
}
