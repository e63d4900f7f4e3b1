//! Flights with a board in the loop: virtual lines of all kinds, a pseudo-terminal, the emulated Cortex-M7.

#[expect(unreachable_pub, reason = "public in the crate that the file is of")]
#[path = "../../../tests/src/skip.rs"]
mod skip;

use rotortwin_board::message::{Detectors, Options};
use rotortwin_bridge::address::BoardAddress;
use rotortwin_bridge::line::{Channel, FileLine, Line};
use rotortwin_bridge::session::{BoardLink, SessionOptions, SessionReport};
use rotortwin_bridge::virtual_line::{LineModel, Unplugged, VirtualLine};
use rotortwin_flight::lockstep::{self, FlightEnd, FlightOutcome, NoObserver};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::setup::run_setup;
use rotortwin_scenario::Scenario;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::link::{LinkError, PlantLink, RunSetup};
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};
use std::path::PathBuf;
use std::time::Duration;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// An unmodified scenario of the repository.
fn whole(file: &str) -> Scenario {
    Scenario::load(root().join("config/scenarios").join(file)).expect("valid")
}

/// The beginning of the reference flight, before its faults.
fn beginning(duration_s: f64) -> Scenario {
    let duration = format!("duration_s={duration_s:?}");
    let path = root().join("config/scenarios/reference-flight.toml");
    Scenario::load_with(path, &[&duration, "fault=[]"]).expect("valid")
}

fn fly(scenario: &Scenario, link: &mut impl PlantLink) -> FlightOutcome {
    let mut simulation = scenario.simulation(1).expect("flyable");
    let setup = run_setup(scenario, &simulation, 7);
    lockstep::fly(&mut simulation, link, &setup, Pace::Fast, &mut NoObserver)
}

fn host_hash(scenario: &Scenario) -> String {
    let outcome = fly(
        scenario,
        &mut InProcessLink::new(PidPeer::default(), FdiEnginePeer::default()),
    );
    assert_eq!(outcome.end, FlightEnd::Done);
    outcome.run_hash
}

fn comparing() -> SessionOptions {
    SessionOptions {
        compare: true,
        ..SessionOptions::default()
    }
}

fn over<L: Line>(scenario: &Scenario, line: L, options: SessionOptions) -> (FlightOutcome, SessionReport) {
    let mut link = BoardLink::new(line, "test", options);
    let outcome = fly(scenario, &mut link);
    (outcome, link.report())
}

fn assert_same(scenario: &Scenario, (outcome, report): &(FlightOutcome, SessionReport)) {
    if let Some(difference) = &report.difference {
        panic!("{difference}");
    }
    assert_eq!(outcome.end, FlightEnd::Done);
    assert_eq!(report.compared, scenario.duration_steps());
    assert_eq!(outcome.run_hash, host_hash(scenario));
}

#[test]
fn val_virtual_board_flies_the_reference_flight_bit_for_bit() {
    let scenario = whole("reference-flight.toml");
    let flown = over(&scenario, VirtualLine::new(LineModel::default()), comparing());
    assert_same(&scenario, &flown);
    assert_eq!(flown.1.retries, 0);
}

#[test]
fn val_four_numbers_carry_all_residuals_and_other_vehicles_fly() {
    for file in [
        "octo-helix-loss.toml",
        "quad-hover-chip.toml",
        "realistic-reference-flight.toml",
    ] {
        let scenario = whole(file);
        let mut options = comparing();
        options.board.residuals = false;
        let flown = over(&scenario, VirtualLine::new(LineModel::default()), options);
        assert_same(&scenario, &flown);
    }
}

#[test]
fn scenario_fdi_engine_on_the_host() {
    let scenario = beginning(12.0);
    let mut options = comparing();
    options.board = Options {
        fdi: false,
        ..Options::default()
    };
    assert_same(
        &scenario,
        &over(&scenario, VirtualLine::new(LineModel::default()), options),
    );
}

#[test]
fn scenario_bad_lines_slow_the_run_and_change_nothing() {
    let scenario = beginning(2.0);
    let lines = [
        LineModel {
            corruption: 0.01,
            ..LineModel::default()
        },
        LineModel {
            loss: 0.01,
            ..LineModel::default()
        },
        LineModel {
            duplication: 0.01,
            ..LineModel::default()
        },
        LineModel {
            burst: 1e-4,
            burst_length: 60,
            ..LineModel::default()
        },
        LineModel {
            latency_s: 0.012,
            jitter_s: 0.03,
            loss: 1e-3,
            ..LineModel::default()
        },
        LineModel {
            unplugged: vec![Unplugged {
                at_s: 0.5,
                for_s: 1.5,
                power: false,
            }],
            ..LineModel::default()
        },
    ];
    for (seed, model) in (1..).zip(lines) {
        let model = LineModel { seed, ..model };
        let first = over(&scenario, VirtualLine::new(model.clone()), comparing());
        assert_same(&scenario, &first);
        // Each of them had an effect; duplicated bytes break frames, too.
        assert!(first.1.retries > 0, "{model:?}");
        // The same seed, the same disturbances.
        let again = over(&scenario, VirtualLine::new(model), comparing());
        assert_eq!(first.1.round_trip_s, again.1.round_trip_s);
    }
}

#[test]
fn scenario_lost_board_is_named() {
    let scenario = beginning(2.0);
    let unplugged = |for_s, power| LineModel {
        unplugged: vec![Unplugged {
            at_s: 0.5,
            for_s,
            power,
        }],
        ..LineModel::default()
    };
    for (model, expected) in [
        (unplugged(1e9, false), "did not answer after step"),
        (unplugged(0.2, true), "the board has restarted"),
    ] {
        let (outcome, _) = over(&scenario, VirtualLine::new(model), SessionOptions::default());
        let FlightEnd::Failed(failure) = outcome.end else {
            panic!("{:?}", outcome.end)
        };
        assert_eq!(failure.peer, "controller");
        assert!(failure.sentence.contains(expected), "{}", failure.sentence);
        assert!(failure.sentence.contains("virtual 0.1.0"), "{}", failure.sentence);
        assert!(outcome.steps > 10);
    }
    let nobody = LineModel {
        loss: 0.999_999,
        ..LineModel::default()
    };
    let (outcome, _) = over(&scenario, VirtualLine::new(nobody), SessionOptions::default());
    let FlightEnd::Failed(failure) = outcome.end else {
        panic!("{:?}", outcome.end)
    };
    assert!(failure.sentence.contains("did not join"), "{}", failure.sentence);
}

fn setup(scenario: &Scenario) -> RunSetup {
    let simulation = scenario.simulation(1).expect("flyable");
    run_setup(scenario, &simulation, 7)
}

/// Modifies the payload of one kind of frame on its way to the board, and corrects the CRC.
struct Meddler {
    line: VirtualLine,
    kind: u8,
    version: Option<u8>,
}

impl Line for Meddler {
    fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        use rotortwin_board::frame::{Decoder, Header, MAX_ENCODED, encode_header};
        let mut decoder = Decoder::default();
        for byte in bytes {
            let Some((header, payload)) = decoder.push(*byte) else {
                continue;
            };
            let mut payload = payload.to_vec();
            let mut version = header.version;
            if header.kind == self.kind {
                match self.version {
                    Some(other) => version = other,
                    None => *payload.last_mut().expect("has a payload") ^= 1,
                }
            }
            let mut out = [0; MAX_ENCODED];
            let length = encode_header(Header { version, ..header }, &payload, &mut out);
            self.line.send(&out[..length])?;
        }
        Ok(())
    }
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> Result<usize, String> {
        self.line.receive(buffer, wait)
    }
    fn now(&self) -> Duration {
        self.line.now()
    }
    fn retry(&self) -> Duration {
        self.line.retry()
    }
}

fn refusal(line: impl Line, setup: &RunSetup) -> String {
    let mut link = BoardLink::new(line, "test", SessionOptions::default());
    match link.open(setup) {
        Err(LinkError::Refused { reason, .. }) => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn val_versions_and_hashes_that_differ_are_refused_with_both_values() {
    let setup = setup(&beginning(2.0));
    let meddler = |kind, version| Meddler {
        line: VirtualLine::new(LineModel::default()),
        kind,
        version,
    };
    let sentence = refusal(meddler(rotortwin_board::message::kind::HELLO, Some(9)), &setup);
    assert!(
        sentence.contains("version 9") && sentence.contains("version 2"),
        "{sentence}"
    );
    let sentence = refusal(meddler(rotortwin_board::message::kind::CHUNK, None), &setup);
    assert!(
        sentence.contains("have the hash") && sentence.contains("announced was"),
        "{sentence}"
    );
}

#[test]
fn val_parameters_that_do_not_fly_are_refused_by_the_board() {
    let mut setup = setup(&beginning(2.0));
    setup.controller.body.as_mut().expect("there").mass_kg = 100.0;
    let sentence = refusal(VirtualLine::new(LineModel::default()), &setup);
    assert!(sentence.contains("hover"), "{sentence}");
}

#[test]
fn scenario_pseudo_terminal() {
    let scenario = beginning(12.0);
    assert_same(
        &scenario,
        &over(&scenario, FileLine::pty().expect("a terminal"), comparing()),
    );
}

/// Memory of the emulated board's linker script, bytes.
const EMULATED_RAM: u32 = 256 * 1024;
/// Static data and stack together, bytes.
const RAM_LIMIT: u32 = 64 * 1024;
/// Instructions of a step with all three detectors: a tenth of the cycles that a board has at 400 Hz and 480 MHz.
const ALL_DETECTORS_LIMIT: u32 = 120_000;
/// The goal for control, residuals and network, instructions.
const NETWORK_LIMIT: u32 = 15_000;

/// The emulated board's program, if it was built and the emulator is installed; otherwise the test is counted as
/// skipped.
fn emulated(channel: Channel) -> Option<FileLine> {
    let program = root().join(rotortwin_bridge::address::QEMU_PROGRAM);
    let emulator = std::process::Command::new("qemu-system-arm").arg("--version").output();
    let missing = if !program.is_file() {
        "its program was not built (cargo xtask firmware)"
    } else if emulator.is_err() {
        "qemu-system-arm is not installed"
    } else {
        return Some(FileLine::qemu(&program, channel).expect("the emulator comes up"));
    };
    skip::skip(&format!("{channel:?} to the emulated board: {missing}"));
    None
}

#[test]
fn scenario_emulated_board_flies_the_reference_flight_bit_for_bit() {
    let Some(line) = emulated(Channel::Semihosting) else {
        return;
    };
    let scenario = whole("reference-flight.toml");
    let flown = over(&scenario, line, comparing());
    assert_same(&scenario, &flown);
    let report = flown.1.report.expect("a report at the end");
    assert_eq!(u64::from(report.steps), scenario.duration_steps());
    // Everything that is not stack is static.
    let fixed = EMULATED_RAM - report.stack_size;
    for (when, stack) in [
        ("in flight", report.stack_used),
        ("during the download", report.stack_before),
    ] {
        assert!(stack > 0, "{when}");
        assert!(
            fixed + stack <= RAM_LIMIT,
            "{fixed} static and {stack} bytes of stack {when}"
        );
    }
    // The emulator counts exactly, and the same in every run.
    let [control, _, all] = &report.cost;
    assert!(
        control.max > 0 && control.max < ALL_DETECTORS_LIMIT && all.max < ALL_DETECTORS_LIMIT,
        "{:?}",
        report.cost
    );
}

#[test]
fn val_network_on_the_emulated_board_takes_15_000_instructions_at_most() {
    let Some(line) = emulated(Channel::Semihosting) else {
        return;
    };
    let scenario = beginning(30.0);
    let mut options = SessionOptions::default();
    options.board.detectors = Detectors {
        network: true,
        ..Detectors::NONE
    };
    let (outcome, report) = over(&scenario, line, options);
    assert_eq!(outcome.end, FlightEnd::Done);
    let [_, _, all] = &report.report.expect("a report at the end").cost;
    assert!(all.max > 1000 && all.max <= NETWORK_LIMIT, "{all:?}");
}

#[test]
fn scenario_emulated_board_over_its_uart() {
    let Some(line) = emulated(Channel::Uart) else { return };
    let scenario = beginning(2.0);
    assert_same(&scenario, &over(&scenario, line, comparing()));
}

#[test]
fn val_addresses() {
    for text in ["serial:/dev/ttyUSB0@2000000", "pty", "qemu", "qemu-uart"] {
        let address: BoardAddress = text.parse().expect(text);
        assert_eq!(address.to_string(), text);
    }
    for text in [
        "",
        "serial:",
        "serial:/dev/x@1",
        "usb",
        "virtual:loss=2",
        "virtual:colour=1",
        "pty:x",
    ] {
        let error = text.parse::<BoardAddress>().expect_err(text);
        assert!(error.contains("expected"), "{error}");
    }
}
