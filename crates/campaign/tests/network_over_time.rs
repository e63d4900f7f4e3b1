//! The improved network over time on the paper's protocol, compared with the same network window by window.

use rotortwin_campaign::paper::data_set::DataSet;
use rotortwin_campaign::paper::protocol::{Conduct, Course};
use rotortwin_campaign::paper::scores::Confusion;
use rotortwin_campaign::paper::windows::Collect;
use rotortwin_campaign::parallel::available_threads;
use rotortwin_fdi_session::evidence::Evidence;
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::settings::NominalThrustModel;

/// Accuracy over all windows after the calibration, with the shipped improved classifier (trained on seed 1): `ROTORTWIN_PROTOCOL_SEEDS` data sets from `ROTORTWIN_PROTOCOL_SEED` on.
#[test]
#[ignore = "a measurement: cargo test --release -p rotortwin-campaign --test network_over_time -- --ignored --nocapture"]
fn bench_protocol_over_time() {
    let number = |name: &str, default: u64| std::env::var(name).map_or(default, |text| text.parse().expect("a number"));
    let (first, seeds) = (
        number("ROTORTWIN_PROTOCOL_SEED", 101),
        number("ROTORTWIN_PROTOCOL_SEEDS", 3),
    );
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../config/scenarios/lag-aware-reference-flight.toml"
    );
    let base = Scenario::load(path).expect("shipped");
    let config = base.fdi_config();
    let network = config.network.expect("it has one");
    let collect = Collect {
        models: vec![NominalThrustModel::Lagged],
        calibration_s: [2.0, 10.0],
        attitude_errors: false,
    };
    let mut scores = [(); 4].map(|()| [Confusion::new(6), Confusion::new(6)]);
    let mut false_alarms = [0; 2];
    let mut healthy_windows = 0;
    for seed in first..first + seeds {
        let data = DataSet::fly(&base, Conduct::STANDARD, seed, &collect, available_threads(), &|| ()).expect("flown");
        for (plan, flight) in &data.flights {
            let windows = flight.of(NominalThrustModel::Lagged);
            let mut evidence = Evidence::new(&config).expect("it calibrates itself");
            let mut alarmed = [false; 2];
            for (i, label) in flight.labels.iter().enumerate() {
                let end_s = (i + 1) as f64 * 0.0625;
                if windows.t_test[i] == FaultVerdict::NotReady {
                    if (2.0..10.0).contains(&end_s) {
                        evidence.calibrate(&windows.mean[i]);
                    }
                    continue;
                }
                let alone = network.evaluate(&windows.network_input(&data.geometry, i, true));
                let over_time = match evidence.window(&windows.mean[i]).code {
                    0 => FaultVerdict::Healthy,
                    rotor => FaultVerdict::Faulty {
                        rotor: (rotor - 1) as u8,
                    },
                };
                healthy_windows += usize::from(*label == 0);
                for (which, verdict) in [alone, over_time].into_iter().enumerate() {
                    scores[plan.course.index()][which].add(*label, verdict);
                    let alarm = *label == 0 && verdict != FaultVerdict::Healthy;
                    false_alarms[which] += usize::from(alarm && !alarmed[which]);
                    alarmed[which] = alarm;
                }
            }
        }
    }
    println!(
        "{seeds} data sets from seed {first}, {:.2} h healthy",
        healthy_windows as f64 * 0.0625 / 3600.0
    );
    for (which, name) in ["each window alone", "over time"].into_iter().enumerate() {
        let mut all = Confusion::new(6);
        let by_course: Vec<String> = Course::ALL
            .iter()
            .map(|course| {
                let own = &scores[course.index()][which];
                all.merge(own);
                format!("{} {:.2} %", course.name(), 100.0 * own.accuracy())
            })
            .collect();
        println!(
            "  {name}: {:.2} % right ({}), {} false alarms",
            100.0 * all.accuracy(),
            by_course.join(", "),
            false_alarms[which]
        );
    }
}
