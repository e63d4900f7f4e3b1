//! `rotortwin effects`: the catalogue of effects, built-in and user-defined.

use crate::output;
use clap::{Parser, Subcommand};
use rotortwin_jobs::EffectPicture as Question;
use rotortwin_plant::effects::{Catalogue, EffectDeclaration, EffectDocument, ParameterKind, page};
use rotortwin_runner::grid::{Grid, fold};
use rotortwin_runner::{sandbox, text};
use rotortwin_scenario::{ConfigError, effect_documents};
use rotortwin_twin::sandbox::EffectPicture;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin effects`.
#[derive(Debug, Parser)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    /// Effect document of your own; may be given several times
    #[arg(long, value_name = "FILE", global = true, value_parser = crate::named::effect())]
    effects: Vec<PathBuf>,
    /// Print JSON
    #[arg(long, global = true)]
    json: bool,
    /// Print the page docs/effects.md
    #[arg(long, conflicts_with = "json")]
    page: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show an effect: equation, parameters, how to excite it, similar effects
    Show {
        /// Id of the effect
        id: String,
    },
    /// Plot how an effect changes a simulated flight, over the flight condition that excites it
    Plot(PlotArgs),
}

/// Which effect, on which vehicle.
#[derive(Debug, clap::Args)]
struct PlotArgs {
    /// Id of the effect; with the rotor where it has one: rotor-thrust-scale#3
    id: String,
    /// Vehicle or model: MODEL, MODEL@BRANCH, MODEL@v2, or a file
    #[arg(long, value_name = "MODEL", default_value = "f550")]
    model: String,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    models: PathBuf,
    /// Value of a parameter, such as drag_n_s_m=0.3 [default: the typical value]
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Manoeuvre to fly [default: the one that shows the effect best]
    #[arg(long, value_name = "NAME")]
    flight: Option<String>,
}

/// The built-in effects and those of the documents.
pub(crate) fn load(files: &[PathBuf]) -> Result<Catalogue, String> {
    let documents: Result<Vec<EffectDocument>, ConfigError> = files.iter().map(effect_documents::load).collect();
    let documents = documents.map_err(|error| error.to_string())?;
    Catalogue::with_documents(&documents).map_err(|refusal| format!("--effects: {}", refusal.reason))
}

/// Lists the catalogue, or shows one entry.
pub(crate) fn run(args: &Args) -> ExitCode {
    if args.page {
        print!("{}", page());
        return ExitCode::SUCCESS;
    }
    let catalogue = match load(&args.effects) {
        Ok(catalogue) => catalogue,
        Err(sentence) => return output::bad_input(sentence),
    };
    match &args.command {
        Some(Command::Show { id }) => match catalogue.find(id) {
            Some(entry) if args.json => print_json(serde_json::to_string_pretty(entry)),
            Some(entry) => {
                print!("{}", text(entry));
                ExitCode::SUCCESS
            }
            None => output::bad_input(format!(
                "unknown effect `{id}`; nearest: {}; 'rotortwin effects' lists all",
                catalogue.nearest(id)
            )),
        },
        Some(Command::Plot(plot)) => match plot.question(&args.effects).and_then(|question| sandbox::of(&question)) {
            Ok(picture) if args.json => print_json(serde_json::to_string(&picture)),
            Ok(picture) => {
                print!("{}", output::fitted(&picture_text(&picture)));
                ExitCode::SUCCESS
            }
            Err(sentence) => output::bad_input(sentence),
        },
        None if args.json => print_json(serde_json::to_string_pretty(catalogue.entries())),
        None => {
            println!("{}", table(&catalogue));
            ExitCode::SUCCESS
        }
    }
}

fn print_json(text: serde_json::Result<String>) -> ExitCode {
    match text {
        Ok(json) => {
            println!("{json}");
            ExitCode::SUCCESS
        }
        Err(error) => output::failed(error),
    }
}

impl PlotArgs {
    /// The question that they ask.
    fn question(&self, files: &[PathBuf]) -> Result<Question, String> {
        let pair = |setting: &String| {
            let (name, value) = setting
                .split_once('=')
                .ok_or_else(|| format!("--set {setting}: expected NAME=VALUE"))?;
            let number: f64 = value
                .parse()
                .map_err(|_not_a_number| format!("--set {setting}: expected a number, got `{value}`"))?;
            Ok((name.to_owned(), number))
        };
        Ok(Question {
            effect: self.id.clone(),
            model: self.model.clone(),
            models: self.models.clone(),
            parameters: self.set.iter().map(pair).collect::<Result<_, String>>()?,
            flight: self.flight.clone(),
            effects: files.to_vec(),
        })
    }
}

/// Each channel versus the condition that explains most of it.
fn picture_text(picture: &EffectPicture) -> String {
    let values: Vec<String> = picture
        .parameters
        .iter()
        .map(|(name, value)| format!("{name} = {value}"))
        .collect();
    let mut out = format!(
        "{}{}, {}\nFlight       {} ({:.0} s): {}\n",
        picture.effect,
        picture.rotor.map_or_else(String::new, |rotor| format!("#{rotor}")),
        values.join(", "),
        picture.flight,
        picture.duration_s,
        picture.description
    );
    if !picture.together_with.is_empty() {
        out += &format!("Together with {}\n", picture.together_with.join(", "));
    }
    if picture.random {
        out += "Random: what one flight with it leaves\n";
    }
    if picture.channels.is_empty() {
        out += "No manoeuvre of the simulator excites it visibly.\n";
    }
    for channel in &picture.channels {
        out += &format!(
            "\n{}: {:.3e} {} (root mean square of means over 0.25 s; noise {:.3e})\n",
            channel.channel, channel.rms, channel.unit, channel.noise
        );
        let Some(over) = channel.conditions.first() else {
            continue;
        };
        let mut table = Grid::new([
            format!("{}, {}", over.title, over.unit),
            format!("what it does, {}", channel.unit),
        ])
        .numbers([0, 1]);
        for (at, does) in over.at.iter().zip(&over.does) {
            table.add_row([format!("{at:.3}"), format!("{does:.4}")]);
        }
        out += &format!("{table}\n");
    }
    out
}

fn channels(entry: &EffectDeclaration) -> String {
    entry.channels.iter().map(|c| c.symbol()).collect::<Vec<_>>().join(" ")
}

/// Names that stand for all variants: sizes and units are shown by `effects show`.
fn table(catalogue: &Catalogue) -> Grid {
    let mut table = Grid::new(["row", "id", "name", "class", "shows in"]);
    for entry in catalogue.entries() {
        let rotor = if entry.per_rotor { ", per rotor" } else { "" };
        table.add_row([
            entry.catalogue_number.map_or("own".to_owned(), |n| n.to_string()),
            entry.id.to_owned(),
            entry.name.to_owned(),
            format!("{}{rotor}", entry.class.as_str()),
            channels(entry),
        ]);
    }
    table
}

fn text(entry: &EffectDeclaration) -> String {
    let rotor = if entry.per_rotor { ", one rotor" } else { "" };
    let places = entry.places.iter().map(|p| p.as_str()).collect::<Vec<_>>().join(", ");
    let mut out = format!(
        "{} — {}\n\n  {}\n\n  class         {}{rotor}\n  acts on       {places}\n  shows in      {}\n",
        entry.id,
        entry.name,
        entry.equation,
        entry.class.as_str(),
        channels(entry)
    );
    let width = text::width().unwrap_or(100);
    let mut line = |label: &str, value: &str| {
        if !value.is_empty() {
            let value = fold(value, width.saturating_sub(16)).replace('\n', "\n                ");
            out += &format!("  {label:<14}{value}\n");
        }
    };
    line("excited by", entry.excited_by);
    line("confused with", &entry.confused_with.join(", "));
    line("needs one of", &entry.needs.join(", "));
    line("source", entry.source);
    out += "\n";
    for p in entry.parameters {
        let shape = if p.kind == ParameterKind::Shape { " (shape)" } else { "" };
        let unit = if p.unit.is_empty() { "no unit" } else { p.unit };
        let meaning = fold(&format!("{}{shape}", p.meaning), width.saturating_sub(6));
        out += &format!("  {} ({}), {unit}\n", p.name, p.symbol);
        out += &format!("      {}\n", meaning.replace('\n', "\n      "));
        out += &format!(
            "      plausible {} to {}, typical {}\n",
            p.plausible_low, p.plausible_high, p.typical
        );
        out += &format!(
            "      standard deviation before a flight {}, of clutter {}\n",
            p.size, p.clutter
        );
    }
    out += &format!("\nIn a scenario or model:\n\n[[effect]]\neffect = \"{}\"\n", entry.id);
    if entry.per_rotor {
        out += "rotor = 1\n";
    }
    let values: Vec<String> = entry
        .parameters
        .iter()
        .map(|p| format!("{} = {}", p.name, p.typical))
        .collect();
    out += &format!("parameters = {{ {} }}\n", values.join(", "));
    out
}
