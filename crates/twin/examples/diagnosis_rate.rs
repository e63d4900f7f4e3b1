//! Times the diagnosis of logs: `cargo run --release -p rotortwin-twin --example diagnosis_rate -- LOG…`.

use std::path::Path;
use std::time::Instant;

use rotortwin_scenario::VehicleDocuments;
use rotortwin_twin::diagnose::{Options, diagnose};
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::model::ModelVersion;

fn main() {
    let documents = VehicleDocuments::load("config/vehicles/f550.toml").expect("run in the root of the repository");
    let model = ModelVersion::first("f550", documents);
    for path in std::env::args().skip(1) {
        let log = match FlightLog::read(Path::new(&path)) {
            Ok(log) => log,
            Err(error) => {
                println!("{path}: {error}");
                continue;
            }
        };
        let start = Instant::now();
        let options = Options {
            clock: &|| start.elapsed().as_secs_f64(),
            ..Options::default()
        };
        match diagnose(&[log], &model, &options) {
            Ok(d) => {
                println!(
                    "{path}: ranked {:.2} s, total {:.2} s",
                    d.timing.ranked_s, d.timing.total_s
                );
                println!("  {}", d.sentence);
                for row in d.ranking.iter().take(14) {
                    let values: Vec<String> = row
                        .parameters
                        .iter()
                        .map(|p| format!("{} {:.4} ± {:.4}", p.symbol, p.value, p.deviation))
                        .collect();
                    println!(
                        "    {:30} ln BF {:9.1}  {}",
                        row.label,
                        row.ln_bayes_factor,
                        values.join(", ")
                    );
                }
                println!(
                    "  share {:?} unexplained {:?}",
                    d.goodness.explained_share, d.goodness.unexplained
                );
            }
            Err(error) => println!("{path}: {error}"),
        }
    }
}
