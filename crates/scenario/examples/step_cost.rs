//! Cost of one 2.5 ms step on one core: plant and sensors alone, with the controller, with controller and detectors.
//!
//! `cargo run --release -p rotortwin-scenario --example step_cost config/scenarios/reference-flight.toml`
//!
//! Best of several flights, to suppress the influence of other load on the machine.

use std::time::Instant;

use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::fdi::FdiEngine;
use rotortwin_flight_core::signals::{Measurement, MotorCommand};
use rotortwin_scenario::{ConfigError, Scenario};

const FLIGHTS: u64 = 15;

/// Which parts of the loop run.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Loop {
    Plant,
    Controller,
    Detectors,
}

/// Nanoseconds per step of one flight.
fn flight(scenario: &Scenario, seed: u64, parts: Loop) -> Result<f64, ConfigError> {
    let mut sim = scenario.simulation(seed)?;
    let mut controller = Controller::new(scenario.controller_config()).expect("checked with the scenario");
    let mut fdi = FdiEngine::new(scenario.fdi_config()).expect("checked with the scenario");
    controller.trim(sim.hover_duty(), sim.sense().battery_voltage);
    let mut command = MotorCommand {
        duty: [sim.hover_duty(); _],
    };
    let start = Instant::now();
    let mut windows = 0;
    while !sim.done() {
        let sample = sim.sense();
        if parts >= Loop::Controller {
            command = controller
                .step(&sample.nav, &sample.reference, sample.battery_voltage)
                .command;
        }
        if parts >= Loop::Detectors {
            let measurement = Measurement {
                nav: sample.nav,
                command,
                battery_voltage: sample.battery_voltage,
            };
            windows += u64::from(fdi.step(&measurement).window_end);
        }
        sim.advance(&command)
            .expect("the controller keeps the vehicle in the air");
    }
    std::hint::black_box(windows);
    Ok(start.elapsed().as_secs_f64() * 1e9 / sim.step() as f64)
}

fn main() -> Result<(), ConfigError> {
    let path = std::env::args().nth(1).expect("usage: step_cost SCENARIO");
    let scenario = Scenario::load(path)?;
    for (name, parts) in [
        ("plant and sensors", Loop::Plant),
        ("+ controller", Loop::Controller),
        ("+ detectors", Loop::Detectors),
    ] {
        let mut best = f64::INFINITY;
        for seed in 0..FLIGHTS {
            best = best.min(flight(&scenario, seed, parts)?);
        }
        println!("{name:20} {best:6.0} ns a step, {:5.2} M steps/s", 1e3 / best);
    }
    Ok(())
}
