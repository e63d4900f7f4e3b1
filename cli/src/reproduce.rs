//! `rotortwin reproduce`: the paper's tables and figures.

use crate::output;
use clap::{Parser, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rotortwin_campaign::learning::training::Overrides;
use rotortwin_campaign::paper::classifiers;
use rotortwin_campaign::paper::cross_validation::Fold;
use rotortwin_campaign::paper::protocol::Course;
use rotortwin_campaign::paper::reproduction::bench;
use rotortwin_campaign::paper::reproduction::parameters::{self, CHARGES, LiftCurve};
use rotortwin_campaign::paper::reproduction::report::{Figure, PageFacts, render};
use rotortwin_campaign::paper::reproduction::tables::tables as tables_of_flights;
use rotortwin_campaign::paper::reproduction::{self, Item, Method, Options, Reproduction};
use rotortwin_campaign::parallel::available_threads;
use rotortwin_campaign::result_table::ResultTable;
use rotortwin_flight::pace::Pace;
use rotortwin_jobs::training::Hyperparameters;
use rotortwin_runner::destination;
use rotortwin_runner::failure::Failure;
use rotortwin_runner::training::{self, BASE_SCENARIO, save_classifier};
use rotortwin_scenario::Scenario;
use rotortwin_scenario::names::{self, Kind};
use rotortwin_sim::session::{self, SessionConfig};
use rotortwin_store::figures::{self, Line};
use rotortwin_store::run_folder::RunFolder;
use rotortwin_store::summary::Status;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Options that `reproduce` and `train` share.
#[derive(Debug, Parser)]
pub(crate) struct Common {
    /// Scenario that gives vehicle, controller, sensors and detector settings
    #[arg(long, value_name = "SCENARIO", default_value = BASE_SCENARIO, value_parser = crate::named::scenario())]
    pub(crate) scenario: PathBuf,
    /// Number of data sets (one per seed)
    #[arg(long, value_name = "COUNT", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) seeds: u16,
    /// First seed; the others follow
    #[arg(long, value_name = "SEED", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 53))]
    pub(crate) first_seed: u64,
    /// Threads [default: as many as this process may use]
    #[arg(long = "jobs", alias = "threads", value_name = "COUNT")]
    pub(crate) threads: Option<NonZeroUsize>,
    /// Print the result as JSON, nothing else
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `rotortwin reproduce`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Only this table; may be given several times [default: all tables and figures]
    #[arg(long, value_enum, value_name = "TABLE")]
    table: Vec<TableArg>,
    /// Only this figure, 3 to 5 or 7 to 17; may be given several times (2 and 6 are photographs)
    #[arg(long, value_name = "FIGURE", value_parser = figure_number)]
    figure: Vec<u8>,
    /// Folder to write; must not exist or be empty [default: runs/reproduce, with a number if that exists]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Epochs of the network of [32]; its learning rate is 2e-3 over this (the paper: 2000, which takes minutes per seed)
    #[arg(long, value_name = "EPOCHS", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    tracking_epochs: u32,
    /// Write the paper's network, trained on all trajectories, as a classifier file
    #[arg(long, value_name = "FILE")]
    save_classifier: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

/// A table of the paper, or the one beyond it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum TableArg {
    /// Lift of the blades
    #[value(name = "1")]
    Table1,
    /// Hexarotor and battery
    #[value(name = "2")]
    Table2,
    /// Fault signatures
    #[value(name = "3")]
    Table3,
    /// Sensor noise
    #[value(name = "4")]
    Table4,
    /// Control and FDI
    #[value(name = "5")]
    Table5,
    /// Eq. 19 from one discharging flight (§2.6)
    #[value(name = "eq19")]
    Equation19,
    /// Cross-validation of the network
    #[value(name = "6")]
    Table6,
    /// Its confusion matrix
    #[value(name = "7")]
    Table7,
    /// The network without battery compensation
    #[value(name = "8")]
    Table8,
    /// The T-test
    #[value(name = "9")]
    Table9,
    /// The network of [32] on tracking errors
    #[value(name = "10")]
    Table10,
    /// Beyond the paper
    Improved,
}

impl TableArg {
    /// A table of flights; the others are of settings.
    fn item(self) -> Option<Item> {
        Some(match self {
            Self::Table1 | Self::Table2 | Self::Table3 | Self::Table4 | Self::Table5 | Self::Equation19 => return None,
            Self::Table6 => Item::Table6,
            Self::Table7 => Item::Table7,
            Self::Table8 => Item::Table8,
            Self::Table9 => Item::Table9,
            Self::Table10 => Item::Table10,
            Self::Improved => Item::Improved,
        })
    }

    /// Number of a table of settings.
    fn settings(self) -> Option<u8> {
        match self {
            Self::Table1 => Some(1),
            Self::Table2 => Some(2),
            Self::Table3 => Some(3),
            Self::Table4 => Some(4),
            Self::Table5 => Some(5),
            _ => None,
        }
    }

    /// Name on the command line.
    fn key(self) -> String {
        if self == Self::Equation19 {
            return "eq19".to_owned();
        }
        match (self.settings(), self.item()) {
            (Some(number), _) => number.to_string(),
            (None, item) => item.map_or("", Item::key).to_owned(),
        }
    }
}

impl Common {
    fn options(&self) -> Options {
        Options {
            items: BTreeSet::new(),
            methods: BTreeSet::new(),
            seeds: (self.first_seed..).take(usize::from(self.seeds)).collect(),
            threads: self.threads.unwrap_or_else(available_threads),
            tracking_epochs: 20,
            overrides: Overrides::default(),
        }
    }

    /// The command recorded in a classifier's file.
    fn train_command(&self) -> String {
        let method = rotortwin_jobs::training::Method::Paper;
        training::command_line(method, &self.command_line(), &Hyperparameters::default())
    }

    /// The arguments that determine the results, as typed.
    fn command_line(&self) -> String {
        training::data_set(u32::from(self.seeds), self.first_seed, &self.scenario)
    }

    /// A bar over flights and networks; none with --json.
    pub(crate) fn progress(&self, jobs: u64) -> ProgressBar {
        let target = if self.json {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr()
        };
        let bar = ProgressBar::with_draw_target(Some(jobs), target);
        let style = ProgressStyle::with_template("{bar:28.cyan/blue} {percent:>3} %  {msg}")
            .expect("the template is well formed");
        bar.set_style(style.progress_chars("━╸─"));
        bar.set_message("flights and networks");
        bar
    }
}

/// Reproduces the requested results; exit code 0 if everything was written, 1 if it failed, 2 for bad input.
pub fn run(args: &Args) -> ExitCode {
    rotortwin_process::start_logging();
    let base = match Scenario::load_without_classifier(&args.common.scenario) {
        Ok(base) => base,
        Err(error) => return output::bad_input(error),
    };
    if let Some(Err(sentence)) = args.save_classifier.as_deref().map(destination::writable_file) {
        return output::bad_input(sentence);
    }
    let folder = match args
        .out
        .clone()
        .map_or_else(|| output::next_free_folder("reproduce"), Ok)
        .and_then(|path| destination::ResultFolder::create(&path))
    {
        Ok(folder) => folder.keep(),
        Err(sentence) => return output::bad_input(sentence),
    };
    match reproduce(args, &base, folder.path()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => output::told(&Failure::writing(folder.path(), sentence)),
    }
}

fn reproduce(args: &Args, base: &Scenario, folder: &Path) -> Result<(), String> {
    let start = Instant::now();
    let everything = args.table.is_empty() && args.figure.is_empty();
    let figures: BTreeSet<u8> = if everything {
        DRAWABLE.into_iter().flatten().collect()
    } else {
        args.figure.iter().copied().collect()
    };
    let mut options = Options {
        tracking_epochs: args.tracking_epochs,
        ..args.common.options()
    };
    options.items = if everything {
        Item::ALL.into()
    } else {
        args.table.iter().filter_map(|table| table.item()).collect()
    };
    let of_settings: BTreeSet<u8> = if everything {
        (1..=5).collect()
    } else {
        args.table.iter().filter_map(|table| table.settings()).collect()
    };
    if figures.iter().any(|figure| *figure > LAST_BLADE_FIGURE) {
        options.methods.extend([Method::Paper, Method::UncompensatedPooled]);
    }
    if args.save_classifier.is_some() {
        options.methods.insert(Method::Paper);
    }
    if options.items.is_empty() && options.methods.is_empty() {
        // Settings and blades need no flight.
        options.seeds.clear();
    }
    let rotor_count = base.fdi_config().geometry.rotor_count();
    let bar = args.common.progress(options.jobs(rotor_count));
    let result = reproduction::run(base, &options, &|| bar.inc(1))?;
    bar.set_message("reference flight and files");

    let mut tables: Vec<ResultTable> = parameters::tables(base, of_settings);
    tables.extend(parameters::charge_against_damage(base).filter(|_| figures.contains(&8)));
    if everything || args.table.contains(&TableArg::Equation19) {
        tables.push(equation_19(args.common.first_seed)?);
    }
    tables.extend(tables_of_flights(&result));
    let mut files = write_numbers(&result, folder)?;
    let mut drawn = draw_bench(base, &figures, folder)?;
    drawn.extend(draw_blades(base, &figures, folder)?);
    drawn.extend(draw_figures(args, base, &result, &figures, folder)?);
    files.extend(drawn.iter().map(|figure| figure.file.clone()));
    if let Some(path) = &args.save_classifier {
        let seed = args.common.first_seed;
        let command = args.common.train_command();
        save_classifier(base, &result, Method::Paper, seed, &command, path)?;
        files.push(path.clone());
    }
    let facts = PageFacts {
        command: command_line(args),
        program: format!("rotortwin {}", env!("CARGO_PKG_VERSION")),
        files: ["numbers", "confusions", "windows"]
            .map(|name| format!("{name}.parquet"))
            .into_iter()
            .filter(|file| folder.join(file).exists())
            .collect(),
    };
    let figures: Vec<Figure> = drawn.into_iter().map(|drawn| drawn.figure).collect();
    let report = folder.join("report.html");
    write(&report, &render(&result, &tables, &figures, &facts))?;
    files.insert(0, report);
    bar.finish_and_clear();
    if args.common.json {
        print_json(&result, &tables, &files, start);
    } else {
        print_text(&result, &tables, &files, start);
    }
    Ok(())
}

/// Eq. 19 from a flight on the motors of `f550-motors`.
fn equation_19(seed: u64) -> Result<ResultTable, String> {
    let vehicle = names::find(Kind::Vehicle, "f550-motors").map_err(|error| error.to_string())?;
    let vehicle = vehicle
        .canonicalize()
        .map_err(|error| format!("{}: {error}", vehicle.display()))?;
    let flight = bench::discharging_flight(&vehicle)?;
    let identified = bench::identify(&flight, seed)?;
    Ok(bench::table(&flight, &identified))
}

/// As typed.
fn command_line(args: &Args) -> String {
    let mut line = "rotortwin reproduce".to_owned();
    for table in &args.table {
        line += &format!(" --table {}", table.key());
    }
    for figure in &args.figure {
        line += &format!(" --figure {figure}");
    }
    line += &args.common.command_line();
    if args.tracking_epochs != 20 {
        line += &format!(" --tracking-epochs {}", args.tracking_epochs);
    }
    line
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: cannot write the file: {error}", path.display()))
}

/// Every number as CSV and Parquet; every window as Parquet only.
fn write_numbers(result: &Reproduction, folder: &Path) -> Result<Vec<PathBuf>, String> {
    let mut files = Vec::new();
    if result.seeds.is_empty() {
        return Ok(files);
    }
    for (name, table) in [("numbers", result.numbers()), ("confusions", result.confusions())] {
        let csv = folder.join(format!("{name}.csv"));
        let parquet = folder.join(format!("{name}.parquet"));
        table.write_csv(&csv).map_err(|error| error.to_string())?;
        table.write_parquet(&parquet).map_err(|error| error.to_string())?;
        files.extend([csv, parquet]);
    }
    if let Some(windows) = result.windows() {
        let parquet = folder.join("windows.parquet");
        windows.write_parquet(&parquet).map_err(|error| error.to_string())?;
        files.push(parquet);
    }
    Ok(files)
}

/// A figure and its location.
struct Drawn {
    figure: Figure,
    file: PathBuf,
}

/// The two flights of the figures.
const FLIGHTS: [(&str, Method); 2] = [
    ("reference-flight", Method::Paper),
    ("reference-flight-without-battery-model", Method::UncompensatedPooled),
];

/// Numbers, index in [`FLIGHTS`], file in its folder, title, explanation.
const FIGURES: [(&[u8], usize, &str, &str, &str); 9] = [
    (
        &[9],
        0,
        "figure-09-position.svg",
        "Position",
        "Reference against the true state.",
    ),
    (
        &[10],
        0,
        "figure-10-attitude.svg",
        "Attitude",
        "Reference against the true state.",
    ),
    (
        &[11],
        0,
        "figure-11-battery.svg",
        "Charge and voltage",
        "Both fall through the flight.",
    ),
    (
        &[12],
        0,
        "figure-12-residuals.svg",
        "Residuals",
        "With battery compensation. Residual 3 does not see a fault of rotor 3.",
    ),
    (
        &[13],
        0,
        "figure-13-normal-plot.svg",
        "Normal plot",
        "With battery compensation: a fault shifts the mean of the arm component.",
    ),
    (
        &[14, 17],
        0,
        "figure-14-verdicts.svg",
        "Verdicts",
        "Network and T-test with battery compensation.",
    ),
    (
        &[15],
        1,
        "figure-12-residuals.svg",
        "Residuals without battery compensation",
        "Far from zero from the start.",
    ),
    (
        &[16],
        1,
        "figure-13-normal-plot.svg",
        "Normal plot without battery compensation",
        "Offsets that no fault has made.",
    ),
    (
        &[14, 17],
        1,
        "figure-14-verdicts.svg",
        "Verdicts without battery compensation",
        "Network (one z-score for all features, as in Table 8) and T-test. The sequential detector has its own model and is not affected.",
    ),
];

/// The figures of the bench and its blades need no flight; this is the last of them.
const LAST_BLADE_FIGURE: u8 = 8;
/// Figures that can be drawn; 2 and 6 are photographs, 1 is a circuit.
const DRAWABLE: [std::ops::RangeInclusive<u8>; 2] = [3..=5, 7..=17];
/// Colours of the blades, in the order of their names.
const BLADE_COLOURS: [&str; 4] = ["#1f6fd1", "#18794e", "#c0262d", "#b87400"];

/// The number of a figure that can be drawn.
fn figure_number(text: &str) -> Result<u8, String> {
    match text.parse() {
        Ok(2 | 6) => Err(format!(
            "figure {text} of the paper is a photograph: expected 3 to 5 or 7 to 17"
        )),
        Ok(number) if DRAWABLE.iter().any(|range| range.contains(&number)) => Ok(number),
        _ => Err("expected 3 to 5 or 7 to 17".to_owned()),
    }
}

/// Figures 3 to 5: what the paper's bench shows, computed.
fn draw_bench(base: &Scenario, wanted: &BTreeSet<u8>, folder: &Path) -> Result<Vec<Drawn>, String> {
    let figures = bench::figures(base).into_iter();
    figures
        .filter(|figure| wanted.contains(&figure.number))
        .map(|figure| {
            let line = |curve: bench::BenchCurve| Line {
                name: curve.name,
                colour: BLADE_COLOURS[curve.group % BLADE_COLOURS.len()],
                dashed: false,
                points: curve.points,
            };
            let lines: Vec<Line> = figure.curves.into_iter().map(line).collect();
            let svg = figures::lines(figure.title, figure.labels[0], figure.labels[1], &lines);
            drawn(figure.number, "bench", figure.title, figure.about, svg, folder)
        })
        .collect()
}

/// A figure that no run has drawn, written to `figure-NUMBER-WHAT.svg`.
fn drawn(number: u8, what: &str, title: &str, about: &str, svg: String, folder: &Path) -> Result<Drawn, String> {
    let file = folder.join(format!("figure-{number:02}-{what}.svg"));
    write(&file, &svg)?;
    Ok(Drawn {
        figure: Figure {
            label: format!("Fig. {number}"),
            title: title.to_owned(),
            about: about.to_owned(),
            svg,
            report: None,
        },
        file,
    })
}

/// Figures 7 and 8: lift over duty of the healthy blade, and of all.
fn draw_blades(base: &Scenario, wanted: &BTreeSet<u8>, folder: &Path) -> Result<Vec<Drawn>, String> {
    let curves = parameters::lift_curves(base);
    let nominal = &base.vehicle().rotors.nominal_blade;
    let figures = [
        (
            7,
            "Lift over duty, healthy blade",
            "The same duty lifts less on a discharged battery.",
            curves
                .iter()
                .filter(|curve| curve.blade == *nominal)
                .collect::<Vec<_>>(),
        ),
        (
            8,
            "Lift over duty, all blades",
            "What the charge takes outweighs what a chipped blade takes: every dashed line (discharged) is below every solid one.",
            curves.iter().collect(),
        ),
    ];
    figures
        .into_iter()
        .filter(|figure| wanted.contains(&figure.0))
        .map(|(number, title, about, curves)| {
            let lines: Vec<Line> = curves.into_iter().map(|curve| line_of(base, curve)).collect();
            let svg = figures::lines(title, "duty, %", "lift, N", &lines);
            drawn(number, "lift", title, about, svg, folder)
        })
        .collect()
}

fn line_of(base: &Scenario, curve: &LiftCurve) -> Line {
    let place = base.blades().names().position(|name| name == curve.blade).unwrap_or(0);
    Line {
        name: format!(
            "blade {} at {:.0} % charge, {:.2} V",
            curve.blade,
            100.0 * curve.charge,
            curve.voltage_v
        ),
        colour: BLADE_COLOURS[place % BLADE_COLOURS.len()],
        dashed: curve.charge < CHARGES[0],
        points: curve.points.clone(),
    }
}

/// Flies the reference flight, as often as the requested figures need, and collects its figures.
fn draw_figures(
    args: &Args,
    base: &Scenario,
    result: &Reproduction,
    wanted: &BTreeSet<u8>,
    folder: &Path,
) -> Result<Vec<Drawn>, String> {
    let is_wanted = |numbers: &[u8]| numbers.iter().any(|number| wanted.contains(number));
    for (place, (name, method)) in FLIGHTS.into_iter().enumerate() {
        if FIGURES.iter().any(|figure| figure.1 == place && is_wanted(figure.0)) {
            fly_reference(args, base, result, method, &folder.join(name))?;
        }
    }
    FIGURES
        .iter()
        .filter(|figure| is_wanted(figure.0))
        .map(|(numbers, place, file, title, about)| {
            let (name, _) = FLIGHTS[*place];
            let file = folder.join(name).join("figures").join(file);
            let svg = std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
            let numbers: Vec<String> = numbers.iter().map(u8::to_string).collect();
            Ok(Drawn {
                figure: Figure {
                    label: format!("Fig. {}", numbers.join(" and ")),
                    title: (*title).to_owned(),
                    about: (*about).to_owned(),
                    svg,
                    report: Some(format!("{name}/report.html")),
                },
                file,
            })
        })
        .collect()
}

/// One run folder of the base scenario with a network that has not seen its trajectory.
fn fly_reference(
    args: &Args,
    base: &Scenario,
    result: &Reproduction,
    method: Method,
    folder: &Path,
) -> Result<(), String> {
    let seed = args.common.first_seed;
    let flown = &base.document().trajectory;
    let held_out = Course::ALL.into_iter().find(|course| course.trajectory() == *flown);
    let own: Option<Fold> = match held_out {
        Some(_) => None,
        None => classifiers::train(result, method, seed, None),
    };
    let first = result.seeds.first().ok_or("there is no seed")?;
    let fold = match (held_out, &own) {
        (Some(course), _) => &first.networks[&method][course.index()],
        (None, Some(fold)) => fold,
        (None, None) => return Err("no flights were kept to train on".to_owned()),
    };
    let command = command_line(args);
    let tested = classifiers::cross_validation(result, method);
    let classifier = classifiers::classifier_file(base, result, method, seed, fold, &command, tested)
        .ok_or("no flights were kept to train on")?;
    let scenario = classifiers::with_classifier(base, classifier, "(trained by rotortwin reproduce)")
        .map_err(|error| error.to_string())?;
    let config = SessionConfig {
        scenario_path: args.common.scenario.clone(),
        seed: scenario.seed(),
        link_name: "in-process".to_owned(),
        pace: Pace::Fast,
        run_id: 1,
        priority: None,
        live_hz: None,
    };
    let folder = RunFolder::create(folder).map_err(|error| error.to_string())?;
    let mut link = session::in_process_link();
    let summary = session::fly(&scenario, &config, &mut link, &folder, &mut |_| (), &mut || None)
        .map_err(|error| error.to_string())?;
    match (summary.status, summary.failure) {
        (Status::Done, _) => Ok(()),
        (_, Some(failure)) => Err(failure.sentence),
        (_, None) => Err("the reference flight was not finished".to_owned()),
    }
}

fn print_json(result: &Reproduction, tables: &[ResultTable], files: &[PathBuf], start: Instant) {
    let seeds: Vec<_> = result
        .seeds
        .iter()
        .map(|seed| {
            serde_json::json!({
                "seed": seed.seed,
                "data_hash": seed.data_hash,
                "flights": seed.flights,
                "steps": seed.steps,
                "generation_s": seed.generation.as_secs_f64(),
                "wall_s": seed.wall.as_secs_f64(),
            })
        })
        .collect();
    let json = serde_json::json!({
        "vehicle": result.vehicle,
        "model_hash": result.model_hash,
        "seeds": seeds,
        "tables": tables,
        "files": files,
        "wall_s": start.elapsed().as_secs_f64(),
    });
    println!("{json:#}");
}

fn print_text(result: &Reproduction, tables: &[ResultTable], files: &[PathBuf], start: Instant) {
    for table in tables {
        println!("{}\n{}", output::fitted(&table.title), output::result_table(table));
        for note in &table.notes {
            println!("{}", output::wrapped(note));
        }
        println!();
    }
    for (i, file) in files.iter().enumerate() {
        println!(
            "{}{}",
            if i == 0 { "Files        " } else { "             " },
            file.display()
        );
    }
    let flights: usize = result.seeds.iter().map(|seed| seed.flights).sum();
    let generation: f64 = result.seeds.iter().map(|seed| seed.generation.as_secs_f64()).sum();
    let seeds = result.seeds.len();
    if flights == 0 {
        return;
    }
    println!(
        "{}",
        output::fitted(&format!(
            "Speed        {seeds} {}, {flights} flights in {:.1} s on {} threads; a data set takes {:.2} s",
            if seeds == 1 { "seed" } else { "seeds" },
            start.elapsed().as_secs_f64(),
            result.options.threads,
            generation / seeds as f64
        ))
    );
}
