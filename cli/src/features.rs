//! `rotortwin features`: the windows of a campaign's flights as a table, to train something on.

use crate::output;
use clap::{Parser, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget};
use rotortwin_campaign::parallel::available_threads;
use rotortwin_campaign::study::Campaign;
use rotortwin_campaign::study::features::{Wanted, write};
use rotortwin_runner::destination;
use rotortwin_scenario::settings::NominalThrustModel;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin features`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Campaign document, a file or a name
    #[arg(value_name = "CAMPAIGN", value_parser = crate::named::campaign())]
    campaign: PathBuf,
    /// Table to write (Parquet)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Network whose inputs are written
    #[arg(long, value_enum, default_value_t = Reader::Paper)]
    method: Reader,
    /// Only this many flights
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    limit: Option<u64>,
    /// Threads [default: as many as this process may use]
    #[arg(long = "jobs", value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// Print the result as JSON, nothing else
    #[arg(long)]
    json: bool,
}

/// Which network reads them, as `train --method`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Reader {
    /// Residuals without rotor lag
    Paper,
    /// Residuals with rotor lag, minus their mean over the calibration
    Improved,
}

/// Flies and writes; exit code 1 if nothing can be written, 2 for bad input.
pub(crate) fn run(args: &Args) -> ExitCode {
    let campaign = match Campaign::load(&args.campaign) {
        Ok(campaign) => campaign,
        Err(error) => return output::bad_input(error),
    };
    if let Err(sentence) = destination::writable_file(&args.out) {
        return output::bad_input(sentence);
    }
    let wanted = Wanted {
        model: match args.method {
            Reader::Paper => NominalThrustModel::Static,
            Reader::Improved => NominalThrustModel::Lagged,
        },
        self_calibrated: args.method == Reader::Improved,
        limit: args.limit,
        threads: args.threads.unwrap_or_else(available_threads),
    };
    let target = if args.json {
        ProgressDrawTarget::hidden()
    } else {
        ProgressDrawTarget::stderr()
    };
    let bar = ProgressBar::with_draw_target(Some(wanted.flights(&campaign)), target);
    let written = write(&campaign, &wanted, &args.out, &|| bar.inc(1));
    bar.finish_and_clear();
    let written = match written {
        Ok(written) => written,
        Err(sentence) => return output::failed(sentence),
    };
    if args.json {
        let json = serde_json::json!({
            "file": args.out, "flights": written.flights, "windows": written.windows,
            "left_out": written.left_out.iter().map(|(flight, why)| serde_json::json!({ "flight": flight, "why": why })).collect::<Vec<_>>(),
        });
        output::line(&format!("{json:#}"));
        return ExitCode::SUCCESS;
    }
    output::line(&format!(
        "{}\n{} windows of {} flights",
        args.out.display(),
        written.windows,
        written.flights
    ));
    if let Some((flight, why)) = written.left_out.first() {
        let count = written.left_out.len();
        output::line(&output::fitted(&format!(
            "{count} flights were left out, first flight {flight}: {why}"
        )));
    }
    ExitCode::SUCCESS
}
