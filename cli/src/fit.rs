//! `rotortwin fit`: vehicle constants from bench measurements.

use crate::output;
use clap::{Args as ClapArgs, Parser, Subcommand};
use rotortwin_runner::destination::writable_file;
use rotortwin_twin::bench_fit::{Fit, FitError, Mapping, Table, battery, lag, report, thrust, write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin fit`.
#[derive(Debug, Parser)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Thrust over duty and voltage: Eq. 19 and alternatives; several files of one blade together
    Thrust {
        #[command(flatten)]
        input: Input,
        /// Blade document to which the blade of Eq. 19 is added
        #[arg(long, value_name = "BLADES.toml", requires = "blade")]
        write: Option<PathBuf>,
        /// Name of the new blade
        #[arg(long)]
        blade: Option<String>,
    },
    /// Battery from voltage and current over time: open-circuit voltage, resistance, RC pair
    Battery {
        #[command(flatten)]
        input: Input,
        /// Vehicle document in which the resistance is set
        #[arg(long, value_name = "VEHICLE.toml")]
        write: Option<PathBuf>,
    },
    /// Motor time constant from steps of the thrust
    Lag {
        #[command(flatten)]
        input: Input,
        /// Vehicle document in which the lag is set
        #[arg(long, value_name = "VEHICLE.toml")]
        write: Option<PathBuf>,
    },
}

#[derive(Debug, ClapArgs)]
struct Input {
    /// CSV files of a test stand, or a text log of ArduPilot with --message
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Column of a quantity, by header or number: time=1:s, thrust=2:kg (-kg reverses the sign), voltage=Volt:cV
    #[arg(long = "map", value_name = "ROLE=COLUMN[:UNIT]")]
    map: Vec<String>,
    /// Message of a text log of ArduPilot
    #[arg(long)]
    message: Option<String>,
    /// Time between rows if there is no time column, s
    #[arg(long, value_name = "S")]
    period_s: Option<f64>,
    /// Pulse width at duty 0 and at duty 1, e.g. 1050:1950
    #[arg(long, value_name = "ZERO:ONE")]
    pulse: Option<String>,
    /// Times to use, s, e.g. 10:70
    #[arg(long, value_name = "FROM:TO")]
    window_s: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Report with plots to write (.html, self-contained)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

impl Input {
    fn tables(&self) -> Result<Vec<Table>, FitError> {
        let pair = |name: &str, text: &Option<String>| {
            let Some(text) = text else {
                return Ok(None);
            };
            let numbers: Vec<f64> = text.split(':').filter_map(|part| part.parse().ok()).collect();
            match numbers.as_slice() {
                [a, b] => Ok(Some([*a, *b])),
                _ => Err(FitError(format!(
                    "--{name} {text}: expected two numbers with a colon between"
                ))),
            }
        };
        let mut mapping = Mapping {
            message: self.message.clone(),
            period_s: self.period_s,
            pulse_us: pair("pulse", &self.pulse)?,
            window_s: pair("window-s", &self.window_s)?,
            ..Mapping::default()
        };
        if self
            .period_s
            .is_some_and(|period| !(period > 0.0 && period.is_finite()))
        {
            return Err(FitError("--period-s: expected a time above 0".to_owned()));
        }
        for text in &self.map {
            mapping.add(text)?;
        }
        self.files.iter().map(|path| Table::read(path, &mapping)).collect()
    }

    fn show(&self, title: &str, fits: &[Fit]) -> anyhow::Result<()> {
        if let Some(path) = &self.report {
            std::fs::write(path, report::html(title, fits))?;
        }
        let text = if self.json {
            report::json(fits)
        } else {
            report::text(fits)
        };
        print!("{}", if self.json { text } else { output::fitted(&text) });
        Ok(())
    }

    /// Looks at what is to be written before the work: nothing computed is lost.
    fn check_destinations(&self, target: Option<&Path>) -> Result<(), FitError> {
        if let Some(report) = &self.report {
            writable_file(report).map_err(FitError)?;
        }
        match target {
            Some(path) if !path.is_file() => Err(FitError(format!(
                "--write {}: file not found; expected the document that receives the value",
                path.display()
            ))),
            Some(path) => writable_file(path).map_err(FitError),
            None => Ok(()),
        }
    }

    /// Where a written value comes from.
    fn provenance(&self, what: &str) -> String {
        let names: Vec<String> = self
            .files
            .iter()
            .map(|path| {
                path.file_name()
                    .unwrap_or(path.as_os_str())
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        format!("rotortwin fit {what} {}", names.join(" "))
    }
}

/// Fits and shows; exit code 2 for bad input.
pub(crate) fn run(args: &Args) -> ExitCode {
    let result = match &args.what {
        What::Thrust { input, write, blade } => fit_thrust(input, write.as_deref(), blade.as_deref()),
        What::Battery { input, write } => fit_battery(input, write.as_deref()),
        What::Lag { input, write } => fit_lag(input, write.as_deref()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<FitError>() => output::bad_input(error),
        Err(error) => output::failed(error),
    }
}

fn update(path: &Path, change: impl Fn(&str) -> Result<String, FitError>) -> anyhow::Result<()> {
    let text = std::fs::read_to_string(path).map_err(|error| FitError(format!("{}: {error}", path.display())))?;
    let changed = change(&text).map_err(|error| FitError(format!("{}: {error}", path.display())))?;
    std::fs::write(path, changed)?;
    eprintln!("{} written", path.display());
    Ok(())
}

fn fit_thrust(input: &Input, target: Option<&Path>, blade: Option<&str>) -> anyhow::Result<()> {
    input.check_destinations(target)?;
    let fit = thrust::fit_thrust(&input.tables()?)?;
    input.show("Thrust over duty and voltage", std::slice::from_ref(&fit))?;
    if let (Some(path), Some(blade)) = (target, blade) {
        let model =
            fit.models.iter().find(|model| model.name == "Eq. 19").ok_or_else(|| {
                FitError("Eq. 19 was not fitted: it needs thrusts at voltages that differ".to_owned())
            })?;
        update(path, |text| {
            write::add_blade(text, blade, model, &input.provenance("thrust"))
        })?;
    }
    Ok(())
}

fn fit_battery(input: &Input, target: Option<&Path>) -> anyhow::Result<()> {
    input.check_destinations(target)?;
    let fits = input
        .tables()?
        .iter()
        .map(battery::fit_battery)
        .collect::<Result<Vec<_>, _>>()?;
    input.show("Battery", &fits)?;
    if let Some(path) = target {
        let [fit] = fits.as_slice() else {
            return Err(FitError("--write takes the fit of one file".to_owned()).into());
        };
        let resistance = fit
            .models
            .first()
            .and_then(|model| Some((model.name, model.parameter("r_ohm")?)))
            .filter(|(_, p)| p.low.is_finite())
            .ok_or_else(|| FitError("the data do not bound the resistance: nothing was written".to_owned()))?;
        let (name, p) = resistance;
        let provenance = format!(
            "{} ({name}; 95 %: {:.5} to {:.5})",
            input.provenance("battery"),
            p.low,
            p.high
        );
        update(path, |text| {
            write::replace_value(text, "internal_resistance_ohm", p.value, &provenance)
        })?;
    }
    Ok(())
}

fn fit_lag(input: &Input, target: Option<&Path>) -> anyhow::Result<()> {
    input.check_destinations(target)?;
    let fits = lag::fit_lag(&input.tables()?)?;
    input.show("Motor lag", &fits)?;
    let pooled = lag::pooled_lag(&fits);
    if let (Some([value, low, high]), false) = (pooled, input.json) {
        println!("first order over all steps: tau {value:.4} s [{low:.4} … {high:.4}]");
    }
    if let Some(path) = target {
        let [value, low, high] =
            pooled.ok_or_else(|| FitError("the data do not bound the lag: nothing was written".to_owned()))?;
        let provenance = format!(
            "{} (first order, {} steps; 95 %: {low:.4} to {high:.4})",
            input.provenance("lag"),
            fits.len()
        );
        update(path, |text| {
            write::replace_value(text, "thrust_lag_s", value, &provenance)
        })?;
    }
    Ok(())
}
