//! `rotortwin board`: flight boards in the loop.

mod flash;

use crate::output;
use clap::{Parser, Subcommand};
use rotortwin_board::message::{CostUnit, Detectors, Options, Report};
use rotortwin_bridge::address::{AnyLine, BoardAddress, QEMU_PROGRAM};
use rotortwin_bridge::budget::{CYCLE_S, CycleBytes, LINES};
use rotortwin_bridge::line::Channel;
use rotortwin_bridge::session::{BoardLink, SessionOptions, SessionReport};
use rotortwin_flight::lockstep::{self, FlightEnd, NoObserver};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::setup::run_setup;
use rotortwin_runner::grid::Grid;
use rotortwin_scenario::Scenario;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin board`.
#[derive(Debug, Parser)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serial ports of this host, and the boards that have a program
    List,
    /// Identity and status of a board
    Info {
        /// serial:PORT[@BAUD], pty, qemu, qemu-uart, virtual[:KEY=NUMBER,...]
        board: BoardAddress,
    },
    /// Fly a scenario over a board and report on line and board: round trips, late steps, errors, bytes
    Doctor {
        /// serial:PORT[@BAUD], pty, qemu, qemu-uart, virtual[:KEY=NUMBER,...]
        board: BoardAddress,
        /// Scenario to fly
        #[arg(long, default_value = "reference-flight", value_parser = crate::named::scenario())]
        scenario: PathBuf,
        /// Length of the flight, s
        #[arg(
            long = "duration-s",
            visible_alias = "duration",
            value_name = "S",
            default_value_t = 10.0
        )]
        duration: f64,
    },
    /// Table 11: cost of a step by solution, counted on the board
    Measure {
        /// Board to measure on [default: qemu]
        board: Option<BoardAddress>,
        /// Scenario to fly
        #[arg(long, default_value = "reference-flight", value_parser = crate::named::scenario())]
        scenario: PathBuf,
        /// Length of the flight, s [default: the scenario's]
        #[arg(long = "duration-s", visible_alias = "duration", value_name = "S")]
        duration: Option<f64>,
        /// Exit code 1 if the longest step of control, residuals and network exceeds this
        #[arg(long = "cost-limit", visible_alias = "limit", value_name = "COUNT")]
        limit: Option<u32>,
    },
    /// Flash a program through PX4's boot loader: ours (target/firmware/pixhawk6c.px4), or PX4 to restore it
    Flash {
        /// The .px4 file
        file: PathBuf,
        /// Serial port of the boot loader [default: the USB port that identifies itself as a PX4 boot loader]
        #[arg(long)]
        port: Option<PathBuf>,
        /// How long to wait for the boot loader, s
        #[arg(long, value_name = "S", default_value_t = 30.0)]
        wait: f64,
    },
    /// Restart a board into its boot loader, to flash another program
    BootLoader {
        /// serial:PORT[@BAUD]
        board: BoardAddress,
    },
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let result = match &args.command {
        Command::List => list(),
        Command::Info { board } => info(board),
        Command::Doctor {
            board,
            scenario,
            duration,
        } => doctor(board, scenario, *duration),
        Command::Measure {
            board,
            scenario,
            duration,
            limit,
        } => {
            let emulator = BoardAddress::Qemu(QEMU_PROGRAM.into(), Channel::Semihosting);
            measure(board.as_ref().unwrap_or(&emulator), scenario, *duration, *limit)
        }
        Command::Flash { file, port, wait } => {
            let wait = std::time::Duration::try_from_secs_f64(*wait).unwrap_or_default();
            match flash::flash(file, port.as_deref(), wait) {
                Ok(()) => Ok(ExitCode::SUCCESS),
                Err((true, sentence)) => Err(Trouble::Input(sentence)),
                Err((false, sentence)) => Err(Trouble::Failed(sentence)),
            }
        }
        Command::BootLoader { board } => boot_loader(board),
    };
    match result {
        Ok(code) => code,
        Err(Trouble::Input(sentence)) => output::bad_input(sentence),
        Err(Trouble::Failed(sentence)) => output::failed(sentence),
    }
}

enum Trouble {
    Input(String),
    Failed(String),
}

fn link(address: &BoardAddress, options: SessionOptions) -> Result<BoardLink<AnyLine>, Trouble> {
    let line = address.open().map_err(Trouble::Input)?;
    Ok(BoardLink::new(line, &address.to_string(), options))
}

fn failed(error: impl std::fmt::Display) -> Trouble {
    Trouble::Failed(error.to_string())
}

fn list() -> Result<ExitCode, Trouble> {
    println!("Supported boards:");
    output::say("  pixhawk6c    Pixhawk 6C, STM32H743 at 480 MHz; firmware/pixhawk6c, docs/pil.md");
    output::say("  mps2-an500   emulated Cortex-M7 (qemu-system-arm); --controller qemu or qemu-uart");
    println!("  virtual      in this program; --controller pty or virtual");
    println!("Serial ports:");
    let ports = serial_ports();
    for port in &ports {
        output::say(format!(
            "  serial:/dev/{}  {}:{} {} {}",
            port.file_name().unwrap_or_default().to_string_lossy(),
            usb_word(port, "idVendor"),
            usb_word(port, "idProduct"),
            usb_word(port, "manufacturer"),
            usb_word(port, "product")
        ));
    }
    if ports.is_empty() {
        println!("  none (looked for /dev/ttyACM* and /dev/ttyUSB*)");
    }
    Ok(ExitCode::SUCCESS)
}

/// Folders of the USB serial ports in `/sys/class/tty`.
fn serial_ports() -> Vec<PathBuf> {
    let mut ports: Vec<PathBuf> = std::fs::read_dir("/sys/class/tty")
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.join("device/driver").exists())
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            name.starts_with("ttyACM") || name.starts_with("ttyUSB")
        })
        .collect();
    ports.sort();
    ports
}

/// USB description of the device behind a port.
fn usb_word(port: &Path, file: &str) -> String {
    ["device/..", "device/../.."]
        .iter()
        .find_map(|up| std::fs::read_to_string(port.join(up).join(file)).ok())
        .map(|text| text.trim().to_owned())
        .unwrap_or_else(|| "?".to_owned())
}

fn info(address: &BoardAddress) -> Result<ExitCode, Trouble> {
    let (name, report) = link(address, SessionOptions::default())?.inquire().map_err(failed)?;
    println!("{name}, link protocol {}", rotortwin_board::PROTOCOL_VERSION);
    print!("{}", output::fitted(&report_text(&report)));
    Ok(ExitCode::SUCCESS)
}

fn boot_loader(address: &BoardAddress) -> Result<ExitCode, Trouble> {
    link(address, SessionOptions::default())?
        .enter_boot_loader()
        .map_err(failed)?;
    output::say(
        "The board restarts into its boot loader; it stays there until it has been flashed or has lost its power.",
    );
    Ok(ExitCode::SUCCESS)
}

/// The scenario; if it is cut to a duration that its faults or dropped loads exceed, without them.
fn load(path: &Path, duration: Option<f64>) -> Result<Scenario, Trouble> {
    let input = |error: rotortwin_scenario::ConfigError| Trouble::Input(error.to_string());
    let Some(duration) = duration else {
        return Scenario::load(path).map_err(input);
    };
    let duration = format!("duration_s={duration:?}");
    Scenario::load_with(path, &[&duration])
        .or_else(|_| Scenario::load_with(path, &[&duration, "fault=[]", "load_drop=[]"]))
        .map_err(input)
}

/// Flies without a run folder.
fn fly(address: &BoardAddress, scenario: &Scenario, options: SessionOptions) -> Result<SessionReport, Trouble> {
    let mut simulation = scenario
        .simulation(scenario.seed())
        .map_err(|error| Trouble::Input(error.to_string()))?;
    let mut link = link(address, options)?;
    let setup = run_setup(scenario, &simulation, 1);
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut NoObserver);
    match outcome.end {
        FlightEnd::Done => Ok(link.report()),
        FlightEnd::Canceled => Err(failed("canceled")),
        FlightEnd::Failed(failure) => Err(failed(format!(
            "{}\n{}",
            failure.sentence,
            session_text(&link.report(), Some(address))
        ))),
    }
}

fn doctor(address: &BoardAddress, scenario: &Path, duration: f64) -> Result<ExitCode, Trouble> {
    let scenario = load(scenario, Some(duration))?;
    let mut options = SessionOptions {
        compare: true,
        ..SessionOptions::default()
    };
    options.board.residuals = address.baud().is_none();
    let rotors = scenario
        .simulation(scenario.seed())
        .map_err(|error| Trouble::Input(error.to_string()))?
        .rotor_count();
    let report = fly(address, &scenario, options)?;
    print!("{}", output::fitted(&session_text(&report, Some(address))));
    print!("{}", output::fitted(&histogram(&report.round_trip_s)));
    print!("{}", output::fitted(&budget_text(rotors)));
    let late = late_steps(&report);
    let mut advice = Vec::new();
    if let Some(baud) = address.baud() {
        let bytes = CycleBytes::new(rotors, false);
        if CycleBytes::time_s(bytes.up, bytes.down_window_end, baud) > CYCLE_S {
            advice.push("the line is too slow for 400 Hz in real time: raise the baud rate on both sides, or use USB");
        }
    }
    if report.line.crc_errors + report.line.garbage > 0 || report.retries > 0 {
        advice
            .push("frames were damaged or lost: look at plugs, ground and length of the cable, or lower the baud rate");
    }
    if late > 0 {
        advice.push("some steps took longer than 2.5 ms: fly at pace fast, or find out what delays them (USB hub, load of this host)");
    }
    if report.difference.is_some() {
        advice.push("board and host compute different bits: flash the program that belongs to this version");
    }
    if advice.is_empty() {
        println!("Nothing to change.");
    }
    for sentence in advice {
        output::say(format!("Advice: {sentence}."));
    }
    Ok(ExitCode::from(u8::from(report.difference.is_some())))
}

fn late_steps(report: &SessionReport) -> usize {
    report
        .round_trip_s
        .iter()
        .filter(|time| f64::from(**time) > CYCLE_S)
        .count()
}

/// Summary at the end of a session.
pub(crate) fn session_text(session: &SessionReport, address: Option<&BoardAddress>) -> String {
    let mut text = String::new();
    let mut line = |content: String| {
        text.push_str(&content);
        text.push('\n');
    };
    let place = address.map(|address| format!(" at {address}")).unwrap_or_default();
    line(format!("board {}{place}", session.board));
    line(format!(
        "  parameters  {} bytes, hash {:016x}, acknowledged",
        session.download.0, session.download.1
    ));
    let mut times = session.round_trip_s.clone();
    times.sort_by(f32::total_cmp);
    if let Some(last) = times.last() {
        let quantile = |share: f64| times[((times.len() - 1) as f64 * share) as usize] * 1e3;
        line(format!(
            "  round trip  median {:.3} ms, 99 % {:.3} ms, longest {:.3} ms; {} of {} steps later than 2.5 ms",
            quantile(0.5),
            quantile(0.99),
            last * 1e3,
            late_steps(session),
            times.len()
        ));
    }
    line(format!(
        "  line        {} retries, {} CRC errors and {} invalid fragments from the board",
        session.retries, session.line.crc_errors, session.line.garbage
    ));
    if let Some(report) = &session.report {
        text.push_str(&report_text(report));
    }
    if session.compared > 0 && session.difference.is_none() {
        let steps = session.compared;
        text.push_str(&format!(
            "  bits        {steps} steps compared with the host, all bits equal\n"
        ));
    }
    text
}

fn report_text(report: &Report) -> String {
    let mut text = String::new();
    let mut line = |content: String| {
        text.push_str(&content);
        text.push('\n');
    };
    let [frames, crc_errors, garbage] = report.line;
    line(format!(
        "  board       {frames} frames, {crc_errors} CRC errors, {garbage} invalid fragments, {} repeated requests; last start: {}",
        report.repeated,
        ["power or reset", "watchdog", "fault", "on request"]
            .get(usize::from(report.reset_cause))
            .unwrap_or(&"unknown")
    ));
    if report.fault != [0; 5] {
        let [pc, lr, cfsr, hfsr, bfar] = report.fault;
        line(format!(
            "  fault       PC {pc:#010x}, LR {lr:#010x}, CFSR {cfsr:#010x}, HFSR {hfsr:#010x}, BFAR {bfar:#010x}; \
             'llvm-addr2line -e' with the program's ELF file names the line"
        ));
    }
    if report.stack_size > 0 {
        line(format!(
            "  stack       {} bytes in flight, {} while parameters were taken in, of {}",
            report.stack_used, report.stack_before, report.stack_size
        ));
    }
    if report.steps > 0 && report.unit != CostUnit::Nothing {
        let [control, fdi, both] = &report.cost;
        for (name, cost) in [("control", control), ("FDI", fdi), ("step", both)] {
            line(format!(
                "  {name:<10}  at most {} {} (step {}), mean {:.0}{}",
                cost.max,
                unit_name(report.unit),
                cost.max_step,
                cost.sum as f64 / f64::from(report.steps),
                milliseconds(report, cost.max)
            ));
        }
    }
    text
}

fn unit_name(unit: CostUnit) -> &'static str {
    match unit {
        CostUnit::Nothing => "",
        CostUnit::Instructions => "instructions",
        CostUnit::Cycles => "cycles",
    }
}

/// Time and fraction of a 2.5 ms period, if the clock makes that meaningful.
fn milliseconds(report: &Report, cost: u32) -> String {
    if report.unit != CostUnit::Cycles || report.clock_hz == 0 {
        return String::new();
    }
    let seconds = f64::from(cost) / f64::from(report.clock_hz);
    format!(
        "; {:.4} ms, {:.2} % of 2.5 ms",
        seconds * 1e3,
        seconds / CYCLE_S * 100.0
    )
}

fn histogram(times: &[f32]) -> String {
    const EDGES_MS: [f32; 12] = [0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 2.5, 5.0, 10.0, f32::INFINITY];
    let mut text = String::new();
    let mut below = 0;
    for edge in EDGES_MS {
        let count = times.iter().filter(|time| **time * 1e3 <= edge).count();
        if count > below {
            let share = (count - below) as f64 / times.len() as f64;
            let bar = "#".repeat((share * 50.0).ceil() as usize);
            writeln!(text, "  up to {edge:>5} ms {:>7} {bar}", count - below).expect("text grows");
        }
        below = count;
    }
    text
}

/// Bytes of a cycle, and their share of line capacity.
fn budget_text(rotors: usize) -> String {
    let mut text = String::new();
    for (name, residuals) in [
        ("four numbers for all residuals", false),
        ("residuals of every rotor", true),
    ] {
        let bytes = CycleBytes::new(rotors, residuals);
        writeln!(
            text,
            "bytes of a cycle, {rotors} rotors, {name}: {} up; {} down, {} at a window's end, {} at most",
            bytes.up, bytes.down, bytes.down_window_end, bytes.down_worst
        )
        .expect("text grows");
        for (line, baud) in LINES {
            let ms = |down| CycleBytes::time_s(bytes.up, down, baud) * 1e3;
            writeln!(
                text,
                "  {line:<13} {:.2} ms; {:.2} ms at a window's end, {:.2} ms at most, of 2.5 ms",
                ms(bytes.down),
                ms(bytes.down_window_end),
                ms(bytes.down_worst)
            )
            .expect("text grows");
        }
    }
    text
}

/// Solution, and its detectors.
const SOLUTIONS: [(&str, Detectors); 5] = [
    ("residuals only", Detectors::NONE),
    (
        "T-test",
        Detectors {
            t_test: true,
            ..Detectors::NONE
        },
    ),
    (
        "NN",
        Detectors {
            network: true,
            ..Detectors::NONE
        },
    ),
    (
        "sequential",
        Detectors {
            sequential: true,
            ..Detectors::NONE
        },
    ),
    ("all three", Detectors::ALL),
];

fn measure(
    address: &BoardAddress,
    scenario: &Path,
    duration: Option<f64>,
    limit: Option<u32>,
) -> Result<ExitCode, Trouble> {
    let scenario = load(scenario, duration)?;
    let mut table = Grid::new([
        "solution",
        "max",
        "at step",
        "mean",
        "control max",
        "control mean",
        "FDI max",
        "FDI mean",
        "ms max",
        "paper, ms max (mean)",
    ])
    .numbers_from(1);
    let mut network_max = 0;
    let mut last = None;
    for (name, detectors) in SOLUTIONS {
        let options = SessionOptions {
            board: Options {
                detectors,
                ..Options::default()
            },
            ..SessionOptions::default()
        };
        let session = fly(address, &scenario, options)?;
        let report = session
            .report
            .ok_or_else(|| failed("the board gave no report at the end of the flight"))?;
        if report.unit == CostUnit::Nothing {
            return Err(Trouble::Input(format!(
                "{address}: this board counts nothing; expected qemu, or a board behind a serial port"
            )));
        }
        if name == "NN" {
            let [_, _, both] = &report.cost;
            network_max = both.max;
        }
        table.add_row(cost_row(name, &report));
        last = Some((session, report));
    }
    if let Some((session, report)) = last {
        print_costs(&scenario, &session, &report, &table);
    }
    match limit {
        Some(limit) if network_max > limit => Err(failed(format!(
            "control, residuals and network take {network_max} at most, allowed are {limit}"
        ))),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// Costs of a step with one of the [`SOLUTIONS`], next to those of the paper.
fn cost_row(name: &str, report: &Report) -> [String; 10] {
    let [control, fdi, both] = &report.cost;
    let mean = |sum: u64| format!("{:.0}", sum as f64 / f64::from(report.steps.max(1)));
    let time = if report.unit == CostUnit::Cycles && report.clock_hz > 0 {
        format!("{:.4}", f64::from(both.max) / f64::from(report.clock_hz) * 1e3)
    } else {
        "-".to_owned()
    };
    let paper = match name {
        "NN" => "0.1098 (0.0534)",
        "T-test" => "0.0813 (0.0741)",
        _ => "-",
    };
    [
        name.to_owned(),
        both.max.to_string(),
        both.max_step.to_string(),
        mean(both.sum),
        control.max.to_string(),
        mean(control.sum),
        fdi.max.to_string(),
        mean(fdi.sum),
        time,
        paper.to_owned(),
    ]
}

fn print_costs(scenario: &Scenario, session: &SessionReport, report: &Report, table: &Grid) {
    println!(
        "{}",
        output::fitted(&format!(
            "Table 11: {} a step on {}; {}, {} steps, seed {}",
            unit_name(report.unit),
            session.board,
            scenario.name(),
            report.steps,
            scenario.seed()
        ))
    );
    println!("{table}");
    println!(
        "{}",
        output::fitted(
            "The paper: STM32H743 at 480 MHz; 0.1098 ms are 52,700 cycles. Instructions are not cycles: no cache, no wait states."
        )
    );
    println!(
        "{}",
        output::fitted(&format!(
            "stack: {} bytes in flight, {} while parameters were taken in, of {}",
            report.stack_used, report.stack_before, report.stack_size
        ))
    );
}
