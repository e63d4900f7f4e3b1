//! Closed-loop step rate of one core with flights side by side, compared with one flight after another, in alternation.
//!
//! `cargo run --release -p rotortwin-flight --example batch_rate -- FLIGHTS SCENARIO…` flies each scenario with seeds 1 to FLIGHTS:
//! plant, sensors, controller, FDI with all three evaluators, run hash. It prints one JSON object with steps per CPU-second of this
//! thread, and ends with an error if any run hash differs.

use rotortwin_flight::batch::{BatchFlight, fly_batch};
use rotortwin_flight::lockstep::{self, NoObserver};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::setup;
use rotortwin_plant::vector_units::{Dispatch, VectorUnit};
use rotortwin_scenario::Scenario;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};

fn main() -> Result<(), String> {
    let mut args = std::env::args().skip(1);
    let flights: u64 = args
        .next()
        .map_or(16, |text| text.parse().expect("first argument: flights per scenario"));
    let scenarios: Vec<Scenario> = args
        .map(|path| Scenario::load(&path).map_err(|error| error.to_string()))
        .collect::<Result<_, _>>()?;
    let jobs: Vec<BatchFlight<'_>> = scenarios
        .iter()
        .flat_map(|scenario| (1..=flights).map(move |seed| BatchFlight { scenario, seed }))
        .collect();

    let start = cpu_time_s();
    let mut hashes = Vec::new();
    let mut steps = 0;
    for job in &jobs {
        let mut simulation = job.scenario.simulation(job.seed).map_err(|error| error.to_string())?;
        let setup = setup::run_setup(job.scenario, &simulation, 1);
        let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
        let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut NoObserver);
        steps += outcome.steps;
        hashes.push(outcome.run_hash);
    }
    let single = steps as f64 / (cpu_time_s() - start);

    let mut rates = Vec::new();
    let mut alone = 0;
    for unit in VectorUnit::available() {
        let dispatch = Dispatch::new(*unit).expect("available");
        let start = cpu_time_s();
        let (outcomes, report) = fly_batch(&jobs, dispatch, |_| NoObserver)?;
        let batch_steps: u64 = outcomes.iter().map(|outcome| outcome.outcome.steps).sum();
        rates.push((unit.name(), batch_steps as f64 / (cpu_time_s() - start)));
        alone = report.alone.values().sum();
        for (i, (outcome, hash)) in outcomes.iter().zip(&hashes).enumerate() {
            if outcome.outcome.run_hash != *hash {
                return Err(format!("flight {i} has another run hash on {}", unit.name()));
            }
        }
    }
    let best = rates.last().expect("the baseline is always there");
    let units: Vec<String> = rates
        .iter()
        .map(|(name, rate)| format!("\"{name}\":{rate:.0}"))
        .collect();
    println!(
        "{{\"flights\":{},\"steps\":{steps},\"flown_alone\":{alone},\"single_steps_per_cpu_s\":{single:.0},\
         \"batch_steps_per_cpu_s\":{:.0},\"ratio\":{:.3},\"units\":{{{}}}}}",
        jobs.len(),
        best.1,
        best.1 / single,
        units.join(",")
    );
    Ok(())
}

/// CPU time of this thread, s.
fn cpu_time_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
