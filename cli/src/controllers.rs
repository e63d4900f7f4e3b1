//! `rotortwin controllers`: one scenario, several controllers, one table.
//!
//! Each flight is a separate `rotortwin fly`, so that flying, waiting and recording are identical. The table is computed by
//! [`rotortwin_store::controllers`], which servers use for their runs, too.

use crate::fly::Foreign;
use crate::output;
use clap::Parser;
use rotortwin_runner::destination::ResultFolder;
use rotortwin_runner::grid::{Grid, fold};
use rotortwin_scenario::Scenario;
use rotortwin_scenario::scenario_document::Start;
use rotortwin_store::controllers::{ControllerRow, Spread, WITHIN_M, differences};
use rotortwin_store::summary::{Status, load_summary};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Common start if an autopilot is included: it is handed over at rest at the first point.
const AT_THE_FIRST_POINT: &str = "initial.start=\"trimmed\"";

/// Arguments of `rotortwin controllers`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Scenario that each of them flies: a file, or a name that 'rotortwin list scenarios' shows
    #[arg(value_parser = crate::named::scenario(), requires = "controller", required_unless_present = "runs")]
    scenario: Option<PathBuf>,
    /// Controllers that fly in turn: own; external (join over zenoh with the printed command); a board or an autopilot as with
    /// 'rotortwin fly --controller'
    #[arg(long, value_name = "WHO", requires = "scenario")]
    controller: Vec<Who>,
    /// Compare these recorded flights instead
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["scenario", "controller", "set", "seed", "pilot", "out"])]
    runs: Vec<PathBuf>,
    /// Set a key of the scenario, such as 'fault=[{time_s=20.0, rotor=3, thrust_loss_percent=10.0}]'; may be given several times
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of all noise and random draws [default: the scenario's]
    #[arg(long)]
    seed: Option<u64>,
    /// Where autopilots accept commands, as with 'rotortwin fly --pilot'
    #[arg(long, value_name = "ADDR|none")]
    pilot: Option<String>,
    /// Longest wait for a controller to join, ms
    #[arg(long, value_name = "MS", default_value_t = 600_000, value_parser = clap::value_parser!(u64).range(1..=3_600_000))]
    join_timeout: u64,
    /// Longest wait for a reply, ms
    #[arg(long, value_name = "MS", default_value_t = 5_000, value_parser = clap::value_parser!(u64).range(1..=3_600_000))]
    step_timeout: u64,
    /// A vehicle has recovered from a fault when it stays this close to its reference, m
    #[arg(long, value_name = "M", default_value_t = WITHIN_M, value_parser = distance)]
    within: f64,
    /// Folder for the run folders; must not exist or be empty [default: runs/controllers, with a number if that exists]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the table as JSON, nothing else
    #[arg(long)]
    json: bool,
}

fn distance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(distance) if distance > 0.0 && distance.is_finite() => Ok(distance),
        _ => Err("expected a distance above 0 m".to_owned()),
    }
}

/// A controller.
#[derive(Clone, Debug)]
enum Who {
    Own,
    External,
    Foreign(Foreign, String),
}

impl std::str::FromStr for Who {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "own" => Ok(Self::Own),
            "external" => Ok(Self::External),
            _ => text
                .parse()
                .map(|foreign| Self::Foreign(foreign, text.to_owned()))
                .map_err(|sentence: String| format!("{sentence}; or own, external")),
        }
    }
}

impl Who {
    fn name(&self) -> &str {
        match self {
            Self::Own => "own",
            Self::External => "external",
            Self::Foreign(_, text) => text,
        }
    }

    fn is_autopilot(&self) -> bool {
        matches!(self, Self::Foreign(Foreign::Autopilot(_), _))
    }

    /// Corresponding arguments of `rotortwin fly`.
    fn words(&self) -> Vec<&str> {
        match self {
            Self::Own => vec!["--link", "in-process"],
            Self::External => vec!["--link", "zenoh", "--external", "controller"],
            Self::Foreign(_, text) => vec!["--controller", text],
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    let folders = match &args.scenario {
        None => args.runs.clone(),
        Some(scenario) => match fly_all(args, scenario) {
            Ok(folders) => folders,
            Err(code) => return code,
        },
    };
    let mut rows = Vec::new();
    for folder in &folders {
        let summary = match load_summary(folder) {
            Ok(summary) => summary,
            Err(error) => return output::bad_input(error),
        };
        match ControllerRow::of_folder(folder, &summary, args.within) {
            Ok(row) => rows.push(row),
            Err(error) => return output::failed(error),
        }
    }
    let differences = differences(&rows);
    if args.json {
        let all = serde_json::json!({ "within_m": args.within, "rows": rows, "differences": differences });
        output::line(&serde_json::to_string_pretty(&all).unwrap_or_default());
    } else {
        let names = if args.controller.is_empty() {
            folders.iter().map(|folder| folder_name(folder)).collect()
        } else {
            args.controller.iter().map(|who| who.name().to_owned()).collect()
        };
        println!("{}", table(&rows, names, args.within));
        for difference in &differences {
            print!("{}", output::fitted(&format!("Careful: {difference}\n")));
        }
    }
    if rows.iter().all(|row| row.status == Status::Done.as_str()) {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(rotortwin_process::EXIT_FAILED)
    }
}

fn folder_name(folder: &Path) -> String {
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    name.to_string_lossy().into_owned()
}

/// Flies the scenario with each controller; returns the folders of the runs.
fn fly_all(args: &Args, path: &Path) -> Result<Vec<PathBuf>, ExitCode> {
    let set: Vec<&str> = args.set.iter().map(String::as_str).collect();
    let scenario = Scenario::load_with(path, &set).map_err(output::bad_input)?;
    let program = std::env::current_exe()
        .map_err(|error| output::failed(format!("the path of this program cannot be read: {error}")))?;
    let level = scenario.document().initial.start == Start::OnGround && args.controller.iter().any(Who::is_autopilot);
    let all = args
        .out
        .clone()
        .map_or_else(free_folder, Ok)
        .map_err(output::bad_input)?;
    let kept = ResultFolder::create(&all).map_err(output::bad_input)?.keep();
    let mut folders = Vec::new();
    for (place, who) in args.controller.iter().enumerate() {
        let plain = who.name().replace(|c: char| !c.is_ascii_alphanumeric(), "-");
        let out = kept.path().join(format!("{}-{plain}", place + 1));
        let mut command = Command::new(&program);
        command.arg("fly").arg(path).arg("--out").arg(&out).args(who.words());
        for set in &args.set {
            command.args(["--set", set]);
        }
        if level && !who.is_autopilot() {
            command.args(["--set", AT_THE_FIRST_POINT]);
        }
        if let Some(seed) = args.seed {
            command.args(["--seed", &seed.to_string()]);
        }
        if let (true, Some(pilot)) = (who.is_autopilot(), &args.pilot) {
            command.args(["--pilot", pilot]);
        }
        if !matches!(who, Who::Own) {
            command.args(["--join-timeout", &args.join_timeout.to_string()]);
            command.args(["--step-timeout", &args.step_timeout.to_string()]);
        }
        if args.json {
            command.arg("--json");
        } else {
            eprintln!("Flight {} of {}: {}", place + 1, args.controller.len(), who.name());
        }
        let ended = command.stdout(Stdio::null()).status();
        let ended = ended.map_err(|error| output::failed(format!("the flight cannot be started: {error}")))?;
        // Failed flights are in the table; one that never started has already printed the reason.
        if load_summary(&out).is_err() {
            let code = ended.code().and_then(|code| u8::try_from(code).ok());
            return Err(ExitCode::from(code.unwrap_or(rotortwin_process::EXIT_FAILED)));
        }
        folders.push(out);
    }
    if level && !args.json {
        output::say_aside(
            "Controllers other than autopilots start in the air, trimmed at the first point, where autopilots are handed over",
        );
    }
    Ok(folders)
}

/// `runs/controllers`, or the first of `runs/controllers-2`, … that does not exist.
fn free_folder() -> Result<PathBuf, String> {
    let base = Path::new("runs").join("controllers");
    std::iter::once(base.clone())
        .chain((2..10_000).map(|number| base.with_file_name(format!("controllers-{number}"))))
        .find(|path| !path.exists())
        .ok_or_else(|| {
            format!(
                "{} and 9998 numbered ones exist; name a folder with --out",
                base.display()
            )
        })
}

/// One column per flight.
fn table(rows: &[ControllerRow], names: Vec<String>, within_m: f64) -> Grid {
    let mut grid = Grid::new(std::iter::once(String::new()).chain(names)).numbers_from(1);
    let mut add = |what: &str, of: &dyn Fn(&ControllerRow) -> Option<String>| {
        let cells = rows.iter().map(|row| of(row).unwrap_or_else(|| "–".to_owned()));
        grid.add_row(std::iter::once(what.to_owned()).chain(cells));
    };
    let seconds = |time: Option<f64>| time.map(|time| format!("{time:.2} s"));
    let spread = |of: Option<Spread>, unit: &str, largest: bool| {
        of.map(|of| format!("{:.3} {unit}", if largest { of.max } else { of.rms }))
    };
    add("flown by", &|row| Some(words_on_lines(&row.controller)));
    add("version", &|row| row.version.as_deref().map(words_on_lines));
    add("lockstep", &|row| {
        row.lockstep.map(|yes| if yes { "yes" } else { "no" }.to_owned())
    });
    add("ended as", &|row| Some(row.status.clone()));
    add("position error, rms", &|row| spread(row.position_m, "m", false));
    add("position error, largest", &|row| spread(row.position_m, "m", true));
    add("yaw error, rms", &|row| spread(row.yaw_deg, "°", false));
    add("yaw error, largest", &|row| spread(row.yaw_deg, "°", true));
    add("roll and pitch against set-point, rms", &|row| {
        spread(row.roll_pitch_deg, "°", false)
    });
    add("roll and pitch against set-point, largest", &|row| {
        spread(row.roll_pitch_deg, "°", true)
    });
    add("tilt, largest", &|row| spread(row.tilt_deg, "°", true));
    add("energy", &|row| row.energy_wh.map(|energy| format!("{energy:.3} Wh")));
    add("false alarms", &|row| Some(row.false_alarms.to_string()));
    if let Some(fault) = rows.iter().find_map(|row| row.fault.as_ref()) {
        add(
            &format!("{} from {:.2} s on: detected after", fault.description, fault.onset_s),
            &|row| row.fault.as_ref().and_then(|fault| seconds(fault.detected_after_s)),
        );
        add("isolated after", &|row| {
            row.fault.as_ref().and_then(|fault| seconds(fault.isolated_after_s))
        });
        add("right at the end", &|row| {
            let right = row.fault.as_ref()?.right_at_end;
            Some(if right { "yes" } else { "no" }.to_owned())
        });
        add("farthest from the reference", &|row| {
            row.fault.as_ref().map(|fault| format!("{:.3} m", fault.farthest_m))
        });
        add(&format!("within {within_m} m again after"), &|row| {
            row.fault.as_ref().and_then(|fault| seconds(fault.recovered_after_s))
        });
    }
    grid
}

/// The table never wraps numbers; these are words.
fn words_on_lines(text: &str) -> String {
    fold(text, 20)
}
