//! `rotortwin spin-test`: an autopilot on a stand; which of its motors is swapped or reversed.

use crate::output;
use crate::trial::Trial;
use clap::Parser;
use rotortwin_bridge::autopilot::address::AutopilotAddress;
use rotortwin_flight::conform::{MotorVerdict, SpinReport, spin_test};
use rotortwin_runner::autopilot::{self, OpenedAutopilot, PilotChoice, Waits};
use rotortwin_scenario::Scenario;
use rotortwin_scenario::autopilot_frame::AutopilotFrame;
use rotortwin_wire::autopilot::Autopilot;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin spin-test`.
#[derive(Debug, Parser)]
pub struct Args {
    /// The autopilot's simulator build, which is waited for: ardupilot[:ADDR][@rc=US/US/…], px4[:ADDR], betaflight[:ADDR][@SPEED]
    autopilot: AutopilotAddress,
    /// Scenario whose vehicle is put on the test stand: a file, or a name that 'rotortwin list scenarios' shows; it begins on the ground
    #[arg(long, value_parser = crate::named::scenario(), default_value = "autopilot-hover")]
    scenario: PathBuf,
    /// Where the autopilot accepts MAVLink commands, as with 'rotortwin fly'; none: another program makes it climb to the first point
    #[arg(long, value_name = "ADDR|none")]
    pilot: Option<PilotChoice>,
    #[command(flatten)]
    trial: Trial,
    /// Print the report as JSON, nothing else
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let scenario = match Scenario::load(&args.scenario) {
        Ok(scenario) => scenario,
        Err(error) => return output::bad_input(error),
    };
    // The same limits as a flight with this autopilot.
    let waits = Waits {
        join: args.trial.join(),
        step: args.trial.step(),
    };
    let opened = match autopilot::open_autopilot(&args.autopilot, args.pilot, waits, &scenario, args.trial.seed) {
        Ok(opened) => opened,
        Err(refused) => return output::told(&refused.into_failure(&args.scenario)),
    };
    let tested = match opened {
        OpenedAutopilot::ArduPilot(mut link, _supervisor) => test(&mut *link, args, &scenario),
        OpenedAutopilot::Px4(mut link, _supervisor) => test(&mut *link, args, &scenario),
        OpenedAutopilot::Betaflight(mut link, _supervisor) => test(&mut *link, args, &scenario),
    };
    match tested {
        Ok(report) if args.json => {
            output::line(&serde_json::to_string_pretty(&report).unwrap_or_default());
            exit_code(&report)
        }
        Ok(report) => {
            print!("{}", output::fitted(&text(&report)));
            exit_code(&report)
        }
        Err(sentence) => output::failed(sentence),
    }
}

fn exit_code(report: &SpinReport) -> ExitCode {
    if report.is_right() {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(rotortwin_process::EXIT_FAILED)
    }
}

fn test(autopilot: &mut impl Autopilot, args: &Args, scenario: &Scenario) -> Result<SpinReport, String> {
    let kind = autopilot::autopilot_kind(args.autopilot.protocol);
    let (frame, rotor_of_channel) = AutopilotFrame::of_vehicle(kind, scenario.vehicle())?;
    output::say_aside(format!(
        "On the test stand: {} with the outputs of {}; waiting for {}",
        scenario.vehicle().name,
        frame.name,
        args.autopilot
    ));
    let quiet = args.json;
    let mut say = |time_s: f64, text: String| {
        if !quiet {
            eprintln!("plant {time_s:5.1} s  autopilot   {text}");
        }
    };
    spin_test(autopilot, scenario, args.trial.seed, &rotor_of_channel, &mut say)
}

/// Human-readable report.
fn text(report: &SpinReport) -> String {
    let place = |rotor: usize| report.motors.iter().find(|motor| motor.rotor == rotor);
    let mut text = format!("{}\n", report.peer);
    for motor in &report.motors {
        text.push_str(&format!(
            "channel {:>2}  rotor {}  {:>4.0}° {}  {}\n",
            motor.channel,
            motor.rotor,
            motor.azimuth_deg,
            if motor.turns_ccw { "CCW" } else { "CW " },
            verdict(motor, place(motor.answers_as))
        ));
    }
    let [roll, pitch, yaw] = report.cosines;
    text.push_str(&format!(
        "answers against a swing compared with the vehicle, cosines: roll {roll:.2}, pitch {pitch:.2}, yaw {yaw:.2}\n"
    ));
    text.push_str(if report.is_right() {
        "All motors are correct\n"
    } else {
        "Some motors are wrong\n"
    });
    text
}

fn verdict(motor: &MotorVerdict, place: Option<&MotorVerdict>) -> String {
    let mut words = Vec::new();
    if let Some(place) = place.filter(|place| place.rotor != motor.rotor) {
        let swapped = place.answers_as == motor.rotor;
        words.push(format!(
            "answers as the motor at {:.0}°: {} channel {}",
            place.azimuth_deg,
            if swapped { "swapped with" } else { "in the place of" },
            place.channel
        ));
    }
    if motor.reversed {
        words.push("reversed: the autopilot assumes the opposite spin".to_owned());
    }
    if words.is_empty() {
        "ok".to_owned()
    } else {
        words.join("; ")
    }
}
