//! Scratch: accuracy of training settings.
use rotortwin_campaign::cross_validation::{fold, paper_network};
use rotortwin_campaign::data_set::DataSet;
use rotortwin_campaign::learning::network::Activation;
use rotortwin_campaign::learning::optimiser::Optimiser;
use rotortwin_campaign::learning::samples::ZScore;
use rotortwin_campaign::learning::training::TrainingConfig;
use rotortwin_campaign::parallel::{available_threads, map_in_order};
use rotortwin_campaign::protocol::{Conduct, Course};
use rotortwin_campaign::windows::Collect;
use rotortwin_plant::Scenario;
use rotortwin_plant::scenario::NominalThrustModel as M;
use std::time::Instant;
fn main() {
    let base = Scenario::load("config/scenarios/reference-flight.toml").unwrap();
    let seed: u64 = std::env::args().nth(1).map_or(1, |s| s.parse().unwrap());
    let which = std::env::args().nth(2).unwrap_or_default();
    let collect = Collect { models: vec![M::Static, M::Lagged, M::Linear], calibration_s: [2.0, 10.0], attitude_errors: true };
    let data = DataSet::fly(&base, Conduct::STANDARD, seed, &collect, available_threads(), &|| ()).unwrap();
    println!("48 flights {:?} {} steps", data.wall, data.steps());
    for model in [M::Static, M::Linear, M::Lagged] {
        let mut c = rotortwin_campaign::scores::Confusion::new(6);
        let mut per = vec![];
        for course in Course::ALL {
            let mut cc = rotortwin_campaign::scores::Confusion::new(6);
            for (p, f) in &data.flights { if p.course != course { continue; }
                for (l, v) in f.labels.iter().zip(&f.of(model).t_test) { if *v != rotortwin_flight_core::fdi::FaultVerdict::NotReady { cc.add(*l, *v); } } }
            per.push(cc.accuracy()); c.merge(&cc);
        }
        println!("t-test {model:?} {:.4} {per:.4?} nf {:.4} uf {:.4} fr {:.4} fuf {:.4} opp {:.4}", c.accuracy(), c.share(0,0), c.share(0,7), c.fault_recall(), c.unknown_share(), c.opposite_share());
    }
    let run = |name: &str, model: M, cal: bool, config: TrainingConfig| {
        let start = Instant::now();
        let samples = data.residual_samples(model, cal);
        let folds = map_in_order(available_threads(), &Course::ALL, |c| fold(&samples, &config, 6, Some(*c), seed), &|| ());
        let tests: Vec<f64> = folds.iter().map(|f| 100.0 * f.test.accuracy()).collect();
        let mut all = rotortwin_campaign::scores::Confusion::new(6);
        folds.iter().for_each(|f| all.merge(&f.test));
        println!("{name:32} train {:.2} val {:.2} test {:.3} sd {:.2} folds {tests:.2?} nf {:.4} fr {:.4}  {:?}",
            100.0 * folds.iter().map(|f| f.training).sum::<f64>() / 4.0, 100.0 * folds.iter().map(|f| f.validation).sum::<f64>() / 4.0,
            rotortwin_campaign::scores::mean(&tests), rotortwin_campaign::scores::deviation(&tests), all.share(0,0), all.fault_recall(), start.elapsed());
    };
    let pf = paper_network(6, ZScore::PerFeature);
    if which.is_empty() {
    run("paper per-feature", M::Static, false, pf);
    run("paper pooled", M::Static, false, paper_network(6, ZScore::Pooled));
    run("linear pooled", M::Linear, false, paper_network(6, ZScore::Pooled));
    run("linear per-feature", M::Linear, false, pf);
    run("lag paper", M::Lagged, false, pf);
    run("lag cal paper", M::Lagged, true, pf);
    run("lag cal 30 epochs", M::Lagged, true, TrainingConfig { epochs: 30, ..pf });
    }
    for (lr, epochs, l2) in [(3e-3, 5, 1e-4), (3e-3, 15, 1e-5), (3e-3, 30, 0.0), (1e-2, 15, 0.0)] {
        run(&format!("lag cal adam {lr} {epochs} {l2}"), M::Lagged, true, TrainingConfig { epochs, optimiser: Optimiser::Adam { learning_rate: lr, l2 }, ..pf });
    }
    if which == "baseline" {
        let samples = data.tracking_error_samples();
        for (lr, epochs) in [(1e-3, 2), (1e-4, 20), (1e-5, 200)] {
            let config = TrainingConfig { hidden: 30, activation: Activation::Sigmoid, z_score: ZScore::PerFeature, optimiser: Optimiser::Sgdm { learning_rate: lr, momentum: 0.9, l2: 1e-4 }, epochs, batch: 32 };
            let start = Instant::now();
            let folds = map_in_order(available_threads(), &Course::ALL, |c| fold(&samples, &config, 6, Some(*c), seed), &|| ());
            println!("baseline {lr} {epochs} train {:?} test {:?} {:?}", folds.iter().map(|f| f.training).collect::<Vec<_>>(), folds.iter().map(|f| f.test.accuracy()).collect::<Vec<_>>(), start.elapsed());
        }
    }
}
