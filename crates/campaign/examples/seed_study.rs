//! Performance of the evaluators on one scenario over many seeds: delays, false alarms, correct windows, with their spread.
//!
//! `cargo run --release -p rotortwin-campaign --example seed_study -- SCENARIO [FLIGHTS]` flies seeds 1, 2, … and prints one table.
//! A window is correct if its verdict matches the truth at its end; windows before an evaluator is calibrated do not count.

use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, StopReason};
use rotortwin_flight::pace::Pace;
use rotortwin_flight::sample::Sample;
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::FdiReport;
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};

/// Extracts one evaluator's verdict from a report.
type Verdict = fn(&FdiReport) -> i32;

const EVALUATORS: [(&str, Verdict); 3] = [
    ("T-test", |r| r.t_test),
    ("sequential", |r| r.sequential),
    ("network", |r| r.network),
];

/// Results of one evaluator in one flight.
#[derive(Clone, Copy, Default)]
struct Score {
    windows: u64,
    right: u64,
    healthy_windows: u64,
    alarms: u64,
    alarming: bool,
    first_right_s: Option<f64>,
}

#[derive(Default)]
struct Study {
    scores: [Score; 3],
    onset_s: Option<f64>,
}

impl FlightObserver for Study {
    fn sample(&mut self, sample: &Sample) -> Result<(), String> {
        let label = sample.truth.fault_label;
        let now_s = sample.sensors.stamp.sim_time_ns as f64 * 1e-9;
        if label != 0 && self.onset_s.is_none() {
            self.onset_s = Some(now_s);
        }
        if sample.report.window_end == 0 {
            return Ok(());
        }
        for (score, (_, verdict)) in self.scores.iter_mut().zip(EVALUATORS) {
            let verdict = verdict(&sample.report);
            if verdict == -2 {
                continue;
            }
            score.windows += 1;
            score.right += u64::from(verdict == label);
            if label == 0 {
                score.healthy_windows += 1;
                score.alarms += u64::from(verdict != 0 && !score.alarming);
                score.alarming = verdict != 0;
            } else if verdict == label && score.first_right_s.is_none() {
                score.first_right_s = self.onset_s.map(|onset| now_s + rotortwin_plant::STEP_S - onset);
            }
        }
        Ok(())
    }

    fn stop_requested(&mut self) -> Option<StopReason> {
        None
    }
}

fn main() {
    let mut args = std::env::args().skip(1);
    let path = args.next().expect("first argument: a scenario file");
    let flights: u64 = args
        .next()
        .map_or(100, |text| text.parse().expect("second argument: number of flights"));
    let scenario = Scenario::load(&path).expect("the scenario is good");
    let half = flights / 2;
    let studies: Vec<Study> = std::thread::scope(|scope| {
        let parts = [1..=half, half + 1..=flights]
            .map(|seeds| scope.spawn(|| seeds.map(|seed| fly(&scenario, seed)).collect::<Vec<_>>()));
        parts
            .into_iter()
            .flat_map(|part| part.join().expect("a flight does not panic"))
            .collect()
    });
    println!("{}, seeds 1 to {flights}", scenario.name());
    println!(
        "evaluator    correct windows  flights isolated   delay median / worst   false alarms (healthy hours; per hour, 95 %)"
    );
    for (index, (name, _)) in EVALUATORS.into_iter().enumerate() {
        let scores: Vec<Score> = studies.iter().map(|study| study.scores[index]).collect();
        println!("{name:<12} {}", line(&scores));
    }
}

fn fly(scenario: &Scenario, seed: u64) -> Study {
    let mut simulation = scenario.simulation(seed).expect("the scenario is good");
    let setup = rotortwin_flight::setup::run_setup(scenario, &simulation, 1);
    let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
    let mut study = Study::default();
    let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut study);
    if let FlightEnd::Failed(failure) = outcome.end {
        panic!("seed {seed}: {}", failure.sentence);
    }
    study
}

fn line(scores: &[Score]) -> String {
    let sum = |of: fn(&Score) -> u64| scores.iter().map(of).sum::<u64>();
    let (windows, right) = (sum(|s| s.windows), sum(|s| s.right));
    if windows == 0 {
        return "not ready in any flight".to_owned();
    }
    let mut delays: Vec<f64> = scores.iter().filter_map(|score| score.first_right_s).collect();
    delays.sort_by(f64::total_cmp);
    let delay = match delays.last() {
        Some(worst) => format!("{:.4} / {worst:.4} s", delays[delays.len() / 2]),
        None => "–".to_owned(),
    };
    let hours = sum(|s| s.healthy_windows) as f64 * 0.0625 / 3600.0;
    let alarms = sum(|s| s.alarms);
    // Upper limit of a Poisson rate; with no events, the rule of three.
    let upper = if alarms == 0 {
        3.0
    } else {
        alarms as f64 + 1.96 * (alarms as f64).sqrt() + 1.92
    } / hours;
    format!(
        "{:>9.3} %      {:>3} of {:<3}         {delay:<20}   {alarms} ({hours:.2} h; ≤ {upper:.1}/h)",
        100.0 * right as f64 / windows as f64,
        delays.len(),
        scores.len()
    )
}
