//! `rotortwin model detectors`: the same flights twice, with detectors that assume the plain vehicle and with detectors
//! that assume the model, while the plant has the model's effects in both.

use crate::output;
use clap::Parser;
use rotortwin_campaign::study::document::Criteria;
use rotortwin_campaign::study::engine::{FlightEngine as _, FlightScorer, OneByOne};
use rotortwin_campaign::study::intervals::{ClusterSums, poisson_rate};
use rotortwin_campaign::study::plan::PlannedFlight;
use rotortwin_campaign::study::record::{DETECTORS, FlightRecord};
use rotortwin_runner::grid::Grid;
use rotortwin_runner::versions::find;
use rotortwin_scenario::Scenario;
use rotortwin_twin::model::{ModelStore, ModelVersion};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin model detectors`.
#[derive(Debug, Parser)]
pub(crate) struct Args {
    /// Scenario to fly: a file or a name
    #[arg(value_parser = crate::named::scenario())]
    scenario: PathBuf,
    /// MODEL, MODEL@BRANCH, MODEL@v2, or a file: its effects are in the plant
    #[arg(long, value_name = "MODEL")]
    model: String,
    /// Number of flights; seeds count up from the scenario's
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    flights: u64,
}

/// Runs the command.
pub(crate) fn run(store: &ModelStore, args: &Args) -> ExitCode {
    let version = match find(store, &args.model) {
        Ok(version) => version,
        Err(error) => return output::told(&error.into()),
    };
    match compare(args, &version) {
        Ok(text) => {
            print!("{}", output::fitted(&text));
            ExitCode::SUCCESS
        }
        Err(sentence) => output::bad_input(sentence),
    }
}

fn compare(args: &Args, version: &ModelVersion) -> Result<String, String> {
    if args.flights == 0 {
        return Err("--flights: expected 1 or more, got 0".to_owned());
    }
    let base = Scenario::load(&args.scenario).map_err(|error| error.to_string())?;
    let told = |refusal: rotortwin_plant::error::Refusal| {
        format!("model {}, key `{}`: {}", args.model, refusal.key, refusal.reason)
    };
    let before = version
        .flown_in(&base)
        .map_err(|error| format!("with model {}: {error}", args.model))?;
    let vehicle = version.for_detectors().map_err(told)?;
    let after = before.clone().with_fdi_vehicle(vehicle.documents).map_err(told)?;
    let list = |labels: &[String]| {
        if labels.is_empty() {
            "nothing".to_owned()
        } else {
            labels.join(", ")
        }
    };
    let mut text = format!(
        "{} × {}, effects of {} in the plant; seeds {} to {}\nCarried      {}\nIgnored      {}\n",
        args.flights,
        base.name(),
        args.model,
        base.seed(),
        base.seed() + args.flights - 1,
        list(&vehicle.carried),
        list(&vehicle.not_carried)
    );
    let mut table = Grid::new([
        "detector",
        "assumes",
        "right without a fault",
        "right with a fault",
        "false alarms / h",
    ]);
    let sets = [
        ("the vehicle", fly(&before, args.flights)?),
        ("the model", fly(&after, args.flights)?),
    ];
    for (place, detector) in DETECTORS.iter().enumerate() {
        for (belief, records) in &sets {
            let (mut healthy, mut faulty) = (ClusterSums::default(), ClusterSums::default());
            let (mut events, mut hours) = (0, 0.0);
            for score in records.iter().filter_map(|record| record.detectors.get(place)) {
                let right = score.healthy_windows - score.false_alarm_windows;
                healthy.add(right, score.healthy_windows);
                faulty.add(score.right - right, score.windows - score.healthy_windows);
                events += score.false_alarm_events;
                hours += score.healthy_s() / 3600.0;
            }
            let rate = match poisson_rate(events, hours) {
                Some([low, high]) => format!("{:.1} [{low:.1}, {high:.1}]", events as f64 / hours),
                None => "–".to_owned(),
            };
            table.add_row([
                (*detector).to_owned(),
                (*belief).to_owned(),
                share(&healthy),
                share(&faulty),
                rate,
            ]);
        }
    }
    text.push_str(&format!(
        "{table}\nshares of windows and alarms per hour with 95 % intervals\n"
    ));
    for (belief, records) in &sets {
        for record in records.iter().filter(|record| !record.reason.is_empty()) {
            text.push_str(&format!(
                "Ended early  seed {}, detectors with {belief}: {}\n",
                record.seed, record.reason
            ));
        }
    }
    Ok(text)
}

fn share(sums: &ClusterSums) -> String {
    match (sums.share(), sums.interval()) {
        (Some(share), Some([low, high])) => format!("{:.1} % [{:.1}, {:.1}]", 100.0 * share, 100.0 * low, 100.0 * high),
        (Some(share), None) => format!("{:.1} %", 100.0 * share),
        _ => "–".to_owned(),
    }
}

fn fly(scenario: &Scenario, flights: u64) -> Result<Vec<FlightRecord>, String> {
    (0..flights)
        .map(|index| {
            let planned = PlannedFlight {
                index,
                seed: scenario.seed() + index,
                parameters: Vec::new(),
            };
            let mut scorers = [FlightScorer::new(scenario, &Criteria::default(), &[])?];
            let pair = [(scenario.clone(), planned.seed)];
            let flown = OneByOne
                .fly(&pair, &mut scorers)
                .pop()
                .ok_or("the engine flew nothing")?;
            let [scorer] = scorers;
            Ok(scorer.finish(&planned, scenario, flown))
        })
        .collect()
}
