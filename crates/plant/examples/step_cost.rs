//! Cost of the plant alone: nanoseconds per sense-and-advance step, hovering duty held, best of several flights.
use std::time::Instant;
use rotortwin_flight_core::signals::MotorCommand;
use rotortwin_plant::{Scenario, Simulation};

fn main() {
    let path = std::env::args().nth(1).expect("usage: step_cost SCENARIO");
    let scenario = Scenario::load(&path).unwrap_or_else(|e| panic!("{e}"));
    let mut best = [f64::INFINITY; 3];
    for round in 0..20 {
        let mut sim = Simulation::new(&scenario, round).expect("checked");
        let command = MotorCommand { duty: [sim.hover_duty(); 16] };
        let start = Instant::now();
        let mut check = 0.0;
        while !sim.done() {
            check += sim.sense().nav.position_ned.x;
            sim.advance(&command).expect("finite");
        }
        best[0] = best[0].min(start.elapsed().as_secs_f64() * 1e9 / sim.step_count() as f64);
        std::hint::black_box(check);
        let mut cfg = rotortwin_flight_core::control::Controller::new(scenario.controller_config()).expect("checked");
        let mut sim = Simulation::new(&scenario, round).expect("checked");
        let first = sim.sense();
        cfg.trim(sim.hover_duty(), first.battery_voltage);
        let start = Instant::now();
        while !sim.done() {
            let s = sim.sense();
            let out = cfg.step(&s.nav, &s.reference, s.battery_voltage);
            sim.advance(&out.command).expect("finite");
        }
        best[1] = best[1].min(start.elapsed().as_secs_f64() * 1e9 / sim.step_count() as f64);
        if round == 0 { println!("{:?}", sim.truth()); }
    }
    println!("open {:.0} ns, closed {:.0} ns", best[0], best[1]);
}
