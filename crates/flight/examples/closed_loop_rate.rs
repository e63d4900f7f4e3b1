//! Closed-loop step rate of one core in one process: plant, sensors, controller, FDI, run hash.
//!
//! `cargo run --release -p rotortwin-flight --example closed_loop_rate -- SCENARIO SECONDS` prints one JSON object with steps per
//! CPU-second of this thread, in full and with parts left out, so that the cost of each part can be read off.

use rotortwin_flight::lockstep::{self, FlightEnd, NoObserver};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::setup;
use rotortwin_proto::{ControllerSetup, FdiSetup};
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame};
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::link::{ControllerPeer, FdiPeer};
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};

/// An FDI engine that does nothing: leaves the loop without FDI.
struct NoFdi;

impl FdiPeer for NoFdi {
    fn setup(&mut self, _: &FdiSetup) -> Result<(), String> {
        Ok(())
    }

    fn step(&mut self, sensors: &SensorFrame, _: &CommandFrame) -> FdiReport {
        FdiReport {
            stamp: sensors.stamp,
            ..FdiReport::default()
        }
    }
}

/// A controller that holds the hover duty: leaves the plant and the loop.
#[derive(Default)]
struct HoldDuty {
    command: CommandFrame,
}

impl ControllerPeer for HoldDuty {
    fn setup(&mut self, setup: &ControllerSetup) -> Result<(), String> {
        self.command.duty[..setup.rotors.len()].fill(setup.trim_duty);
        Ok(())
    }

    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame {
        CommandFrame {
            stamp: sensors.stamp,
            ..self.command
        }
    }
}

fn main() {
    let mut args = std::env::args().skip(1);
    let scenario = args.next().expect("first argument: a scenario file");
    let seconds: f64 = args
        .next()
        .map_or(2.0, |text| text.parse().expect("second argument: seconds of CPU time"));
    let scenario = Scenario::load(&scenario).expect("the scenario is good");
    let full = rate(&scenario, seconds, PidPeer::default, FdiEnginePeer::default);
    let without_fdi = rate(&scenario, seconds, PidPeer::default, || NoFdi);
    let plant_only = rate(&scenario, seconds, HoldDuty::default, || NoFdi);
    let ns = |rate: f64| 1e9 / rate;
    println!(
        "{{\"steps_per_cpu_s\":{full:.0},\"without_fdi\":{without_fdi:.0},\"plant_only\":{plant_only:.0},\
         \"ns_plant_and_loop\":{:.0},\"ns_controller\":{:.0},\"ns_fdi\":{:.0}}}",
        ns(plant_only),
        ns(without_fdi) - ns(plant_only),
        ns(full) - ns(without_fdi)
    );
}

/// Steps per CPU-second over flights with seeds 1, 2, … until `seconds` of CPU time are spent.
fn rate<C: ControllerPeer, F: FdiPeer>(
    scenario: &Scenario,
    seconds: f64,
    controller: fn() -> C,
    fdi: fn() -> F,
) -> f64 {
    let start = cpu_time_s();
    let mut steps = 0;
    for seed in 1.. {
        let mut simulation = scenario.simulation(seed).expect("the scenario is good");
        let setup = setup::run_setup(scenario, &simulation, 1);
        let mut link = InProcessLink::new(controller(), fdi());
        let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut NoObserver);
        if let FlightEnd::Failed(failure) = outcome.end {
            // Only the uncontrolled vehicle may leave the world; its steps still count.
            assert!(std::any::type_name::<C>().contains("HoldDuty"), "{}", failure.sentence);
        }
        steps += outcome.steps;
        if cpu_time_s() - start > seconds {
            break;
        }
    }
    steps as f64 / (cpu_time_s() - start)
}

/// CPU time of this thread, s.
fn cpu_time_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
