//! Step rate of one core with plant and controller alone: no detectors, no run hash.
//!
//! `cargo run --release -p rotortwin-flight --example dynamics_rate -- SECONDS SCENARIO` flies a quadrotor's scenario in all lanes,
//! again and again for SECONDS of CPU time, on each vector unit of this machine. It prints one JSON object with steps per CPU-second of
//! this thread, and ends with an error if a flight strays from its reference: the rate would be that of a fall.

use rotortwin_flight::setup;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::control::lanes::{ControlRows, MeasuredRows, ReferenceRows, SineRows};
use rotortwin_plant::batch::{BatchSimulation, LANES};
use rotortwin_plant::vector_units::{Dispatch, VectorUnit, VectorWork};
use rotortwin_scenario::Scenario;
use rotortwin_wire::setup::controller_config;

const ROTORS: usize = 4;

/// Largest distance from the reference, m.
const ASTRAY_M: f32 = 0.2;

struct Inputs {
    controller: Controller,
    measured: MeasuredRows<LANES>,
    reference: ReferenceRows<LANES>,
}

struct Outputs {
    sines: SineRows<LANES>,
    control: ControlRows<ROTORS, LANES>,
}

/// The controllers of all lanes.
struct Control;

impl VectorWork for Control {
    type Input = Inputs;
    type Output = Outputs;
    const WIDE: bool = false;

    #[inline(always)]
    fn run(input: &Inputs, output: &mut Outputs) {
        output.sines.fill(&input.measured);
        output
            .control
            .step(&input.controller, &input.measured, &output.sines, &input.reference);
    }
}

fn main() -> Result<(), String> {
    let [seconds, path] = <[String; 2]>::try_from(std::env::args().skip(1).collect::<Vec<_>>())
        .map_err(|given| format!("expected SECONDS and SCENARIO, got {given:?}"))?;
    let seconds: f64 = seconds
        .parse()
        .map_err(|error| format!("expected seconds, got {seconds}: {error}"))?;
    let scenario = Scenario::load(&path).map_err(|error| error.to_string())?;
    let rates = VectorUnit::available()
        .iter()
        .map(|unit| {
            Ok((
                unit.name(),
                rate(&scenario, Dispatch::new(*unit).expect("available"), seconds)?,
            ))
        })
        .collect::<Result<Vec<_>, String>>()?;
    let best = rates.iter().map(|(_, rate)| *rate).fold(0.0, f64::max);
    let units: Vec<String> = rates
        .iter()
        .map(|(name, rate)| format!("\"{name}\":{rate:.0}"))
        .collect();
    println!("{{\"steps_per_cpu_s\":{best:.0},\"units\":{{{}}}}}", units.join(","));
    Ok(())
}

fn rate(scenario: &Scenario, dispatch: Dispatch, seconds: f64) -> Result<f64, String> {
    let (start, mut steps) = (cpu_time_s(), 0);
    while cpu_time_s() - start < seconds {
        steps += fly(scenario, dispatch)?;
    }
    Ok(steps as f64 / (cpu_time_s() - start))
}

/// One flight in each lane; the number of steps of all.
fn fly(scenario: &Scenario, dispatch: Dispatch) -> Result<u64, String> {
    let simulation = scenario.simulation(1).map_err(|error| error.to_string())?;
    let (config, trim) = controller_config(&setup::run_setup(scenario, &simulation, 1).controller)?;
    let mut controller = Controller::new(config).map_err(|error| error.to_string())?;
    let mut outputs = Box::new(Outputs {
        sines: SineRows::NONE,
        control: ControlRows::NONE,
    });
    let mut inputs = Box::new(Inputs {
        controller,
        measured: [[0.0; LANES]; 13],
        reference: [[0.0; LANES]; 7],
    });
    if let Some(trim) = trim {
        controller.trim(trim.duty, trim.battery_voltage);
    }
    let mut plant = BatchSimulation::<ROTORS>::new(dispatch, scenario.document().integrator_substeps);
    for lane in 0..LANES {
        let simulation = scenario.simulation(lane as u64).map_err(|error| error.to_string())?;
        outputs.control.seat(lane, &controller);
        plant
            .seat(lane, simulation)
            .map_err(|reason| format!("no lane: {reason:?}"))?;
    }
    let mut steps = 0;
    while !plant.simulation(0).is_some_and(rotortwin_plant::Simulation::done) {
        let sensed = plant.sense();
        inputs.measured = sensed.values;
        inputs.reference = sensed.reference;
        dispatch.run::<Control>(&inputs, &mut outputs);
        if outputs.control.outside != [0; LANES] || plant.advance(&outputs.control.duty) != 0 {
            return Err("a flight left what lanes can do".to_owned());
        }
        steps += LANES as u64;
    }
    let astray = (0..3).any(|axis| {
        (0..LANES).any(|lane| (inputs.measured[axis][lane] - inputs.reference[axis][lane]).abs() > ASTRAY_M)
    });
    if astray {
        return Err("a flight is more than 0.2 m from its reference: it does not hover".to_owned());
    }
    Ok(steps)
}

/// CPU time of this thread, s.
fn cpu_time_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
