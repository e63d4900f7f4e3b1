//! `rotortwin campaign`: many flights of a campaign document, crash-safe, with statistics; one of them flown again; or merging of shards
//! flown elsewhere.

use crate::progress::{Lines, resumed_bar};
use crate::{network, output};
use clap::{Args as ClapArgs, Parser, Subcommand};
use indicatif::ProgressBar;
use rotortwin_campaign::parallel::available_threads;
use rotortwin_campaign::study::engine::SideBySide;
use rotortwin_campaign::study::folder::CampaignFolder;
use rotortwin_campaign::study::hunt::{self, HuntOptions};
use rotortwin_campaign::study::merge::take_in;
use rotortwin_campaign::study::runner::{Keep, RunEnd, missing as missing_shards};
use rotortwin_campaign::study::summary::CampaignSummary;
use rotortwin_campaign::study::totals::Totals;
use rotortwin_campaign::study::{Campaign, results, tables};
use rotortwin_flight::pace::Pace;
use rotortwin_jobs::{JobEvent, Progress};
use rotortwin_runner::campaign::{self as runner, Flown, folder_of};
use rotortwin_runner::failure::Failure;
use rotortwin_runner::second_look;
use rotortwin_sim::session::{self, SessionConfig};
use rotortwin_store::run_folder::RunFolder;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Arguments of `rotortwin campaign`.
#[derive(Debug, Parser)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Sub>,
    #[command(flatten)]
    flights: Option<FlightArgs>,
}

#[derive(Debug, Subcommand)]
enum Sub {
    /// Merge shards flown elsewhere (--shards): the result equals that of one machine, byte for byte
    Merge(MergeArgs),
}

/// Arguments of `rotortwin campaign merge`.
#[derive(Debug, ClapArgs)]
struct MergeArgs {
    /// Campaign: a file, or a name that 'rotortwin list campaigns' shows
    #[arg(value_parser = crate::named::campaign())]
    campaign: PathBuf,
    /// Folders with shards of it, or s3://BUCKET/PREFIX, in any order; a shard may be in several
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Folder of the result, or s3://BUCKET/PREFIX; a folder that already holds a part of it is resumed [default: runs/campaign-NAME]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the summary as JSON, nothing else
    #[arg(long)]
    json: bool,
}

/// Flights of a campaign.
#[derive(Debug, ClapArgs)]
pub struct FlightArgs {
    /// Campaign: a file, or a name that 'rotortwin list campaigns' shows
    #[arg(value_parser = crate::named::campaign())]
    pub campaign: PathBuf,
    /// Folder of the campaign; one that holds a part of it is resumed; with --shards also s3://BUCKET/PREFIX, with the credentials in
    /// AWS_… [default: runs/campaign-NAME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Threads [default: as many as this process may use]
    #[arg(long = "jobs", alias = "threads", value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// Stop after about this many flights of the campaign; the same command without it resumes
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    limit: Option<u64>,
    /// Fly only this flight and write a complete run folder [default of --out: runs/NAME-FLIGHT, with a number if that exists]
    #[arg(long, value_name = "NUMBER", conflicts_with = "limit")]
    flight: Option<u64>,
    /// Search for flights in which the sequential detector fails, and write each, reduced to what matters, as a scenario [default of --out:
    /// runs/hunt-NAME, with a number if that exists]
    #[arg(long, conflicts_with_all = ["flight", "limit"])]
    hunt: bool,
    /// --hunt: flights of the search
    #[arg(long = "hunt-budget", visible_alias = "budget", value_name = "COUNT", default_value_t = 300, requires = "hunt", value_parser = clap::value_parser!(u64).range(3..=1_000_000))]
    budget: u64,
    /// --hunt: seed of the search
    #[arg(long, value_name = "SEED", default_value_t = 1, requires = "hunt", value_parser = clap::value_parser!(u64).range(..1 << 20))]
    hunt_seed: u64,
    /// --hunt: maximum number of cases that are reduced
    #[arg(long = "hunt-cases", visible_alias = "cases", value_name = "COUNT", default_value_t = 4, requires = "hunt", value_parser = clap::value_parser!(u16).range(1..=1000))]
    cases: u16,
    /// Only read the file, check its flights and describe them; with --json the numbers of flights and shards. With --flight, describe that
    /// flight; with --json its seed and all documents of its scenario
    #[arg(long, conflicts_with_all = ["limit", "hunt"])]
    check: bool,
    /// Fly only these shards of 32 flights, FIRST..END, without merging them; 'rotortwin campaign merge' does that
    #[arg(long, value_name = "FIRST..END", value_parser = output::range, conflicts_with_all = ["flight", "limit", "hunt", "check"])]
    shards: Option<Range<u64>>,
    /// Fly each flight again and judge it by the second look, as single runs are: sizes of losses that grow, rotors that give more. It takes
    /// about seven times as long as the flights; those that it has judged are not judged again
    #[arg(long, conflicts_with_all = ["flight", "hunt", "check", "events"])]
    second_look: bool,
    /// Print the summary as JSON, nothing else
    #[arg(long)]
    pub json: bool,
    /// With --json: print progress as JSON lines first; end when standard input is closed
    #[arg(long, requires = "json", conflicts_with_all = ["flight", "hunt", "check"])]
    events: bool,
}

impl Args {
    /// True if one of its places is in an object store, which another program accesses.
    pub fn is_in_a_store(&self) -> bool {
        match (&self.command, &self.flights) {
            (Some(Sub::Merge(args)), _) => {
                let out = args.out.iter();
                out.chain(&args.folders).any(|place| address(place).is_some())
            }
            (None, Some(args)) => args.out.as_deref().and_then(address).is_some(),
            (None, None) => false,
        }
    }

    /// The campaign to fly; `None` for other actions.
    pub fn flights(&self) -> Option<&FlightArgs> {
        self.flights.as_ref()
    }
}

impl FlightArgs {
    /// The corresponding job.
    pub fn job(&self, campaign: &Campaign) -> rotortwin_jobs::Campaign {
        rotortwin_jobs::Campaign {
            campaign: self.campaign.clone(),
            out: folder_of(self.out.as_deref(), campaign),
            shards: self.shards.clone(),
            limit: self.limit,
            threads: self.threads,
        }
    }

    /// An option not available with a server.
    pub fn only_here(&self) -> Option<&'static str> {
        let options = [
            (self.threads.is_some(), "--jobs"),
            (self.limit.is_some(), "--limit"),
            (self.flight.is_some(), "--flight"),
            (self.hunt, "--hunt"),
            (self.check, "--check"),
            (self.shards.is_some(), "--shards"),
            (self.events, "--events"),
            (self.second_look, "--second-look"),
        ];
        options.into_iter().find_map(|(given, name)| given.then_some(name))
    }
}

/// Prints the results of a folder from another machine, as if flown here.
pub fn print_fetched(args: &FlightArgs, campaign: &Campaign, path: &Path) -> Result<(), String> {
    let folder = CampaignFolder::open(path, campaign)?;
    let totals = results::collect(campaign, &folder)?;
    let go_on = command_line(campaign, args.out.as_deref());
    let place = folder.path().display().to_string();
    print_text(campaign, &totals, &Flown::nothing(), &place, &go_on);
    Ok(())
}

/// `s3://BUCKET/PREFIX`, if it is not the path of a folder.
fn address(place: &Path) -> Option<&str> {
    place.to_str().filter(|text| text.starts_with("s3://"))
}

/// Operations that only a program with object store access supports.
pub trait Store {
    /// Flies shards of a campaign into an object store.
    ///
    /// # Errors
    /// The existing shards belong to another campaign, or the store does not respond.
    fn fly(&self, args: &FlightArgs, address: &str, campaign: &Campaign) -> Result<ExitCode, Failure>;

    /// Merges the shards at an address.
    ///
    /// # Errors
    /// The existing shards belong to another campaign, or the store does not respond.
    fn take_in(&self, into: &CampaignFolder, address: &str, campaign: &Campaign) -> Result<(), Failure>;

    /// Uploads the results of a whole campaign.
    ///
    /// # Errors
    /// The address holds results of another campaign or program, or the store does not respond.
    fn keep(&self, from: &CampaignFolder, address: &str, campaign: &Campaign) -> Result<(), Failure>;
}

/// Exit code 0 if every flight has been flown, 1 if something failed or was stopped, 2 for bad input.
///
/// * `store`: object store access; `None` in a program without it
pub fn run(args: &Args, store: Option<&dyn Store>) -> ExitCode {
    rotortwin_process::start_logging();
    match (&args.command, &args.flights) {
        (Some(Sub::Merge(args)), _) => merge(args, store),
        (None, Some(args)) => fly(args, store),
        (None, None) => output::bad_input("campaign: expected a campaign, or 'merge'; see 'rotortwin campaign --help'"),
    }
}

fn fly(args: &FlightArgs, store: Option<&dyn Store>) -> ExitCode {
    let campaign = match Campaign::load(&args.campaign) {
        Ok(campaign) => campaign,
        Err(error) => return output::bad_input(error),
    };
    for warning in campaign.warnings() {
        output::say_aside(format!("{}: {warning}", args.campaign.display()));
    }
    if args.check {
        return match args.flight {
            Some(index) => describe_one(&campaign, index, args.json),
            None => describe(&campaign, args.json),
        };
    }
    if let Some(address) = args.out.as_deref().and_then(address) {
        if args.shards.is_none() {
            return output::bad_input(format!(
                "--out {address}: an object store takes shards; expected --shards FIRST..END, and 'rotortwin campaign merge' for the whole"
            ));
        }
        if args.second_look {
            return output::bad_input(format!(
                "--second-look: its scores lie beside the shards in a folder, got --out {address}; merge the shards into a folder and judge them there"
            ));
        }
        let flown = match store {
            Some(store) => store.fly(args, address, &campaign),
            None => return network::hand_over(),
        };
        return flown.unwrap_or_else(|failure| output::told(&failure));
    }
    if args.hunt {
        return hunt(args, &campaign);
    }
    match args.flight {
        Some(index) => fly_one(args, &campaign, index),
        None => fly_all(args, &campaign),
    }
}

fn describe(campaign: &Campaign, json: bool) -> ExitCode {
    if json {
        return printed(runner::checked(campaign));
    }
    print!("{}", output::fitted(&described(campaign)));
    ExitCode::SUCCESS
}

/// Describes a flight without flying it.
fn describe_one(campaign: &Campaign, index: u64, json: bool) -> ExitCode {
    if json {
        return printed(runner::checked_flight(campaign, index));
    }
    let (flight, _) = match runner::planned(campaign, index) {
        Ok(planned) => planned,
        Err(failure) => return output::told(&failure),
    };
    let mut text = format!("{}: flight {index}, seed {}\n", campaign.document().name, flight.seed);
    for parameter in &flight.parameters {
        text += &format!("  {}: {}\n", parameter.axis, parameter.cell);
    }
    print!("{}", output::fitted(&text));
    ExitCode::SUCCESS
}

/// An answer as JSON.
fn printed(answer: Result<impl Serialize, Failure>) -> ExitCode {
    match answer.and_then(|answer| serde_json::to_string_pretty(&answer).map_err(Failure::failed)) {
        Ok(json) => {
            println!("{json}");
            ExitCode::SUCCESS
        }
        Err(failure) => output::told(&failure),
    }
}

fn described(campaign: &Campaign) -> String {
    let document = campaign.document();
    let mut text = format!(
        "{}: {}\n{} flights, seed {}\n",
        document.name,
        document.description,
        campaign.flights(),
        document.seed
    );
    for axis in campaign.axes() {
        text += &format!("  {}: {}\n", axis.name, axis.words());
    }
    text
}

/// Merges shards of other folders, and creates the results.
fn merge(args: &MergeArgs, store: Option<&dyn Store>) -> ExitCode {
    let mut places = args.folders.iter().chain(&args.out);
    if store.is_none() && places.any(|place| address(place).is_some()) {
        return network::hand_over();
    }
    let campaign = match Campaign::load(&args.campaign) {
        Ok(campaign) => campaign,
        Err(error) => return output::bad_input(error),
    };
    let merged = match (args.out.as_deref().and_then(address), store) {
        (Some(address), Some(store)) => merged_in_store(address, args, store, &campaign),
        _ => merged_in_folder(args, store, &campaign),
    };
    match merged {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => output::told(&failure),
    }
}

/// The results in a folder, of all shards or of those that there are.
fn merged_in_folder(args: &MergeArgs, store: Option<&dyn Store>, campaign: &Campaign) -> Result<(), Failure> {
    let folder = gathered(&folder_of(args.out.as_deref(), campaign), args, store, campaign)?;
    let go_on = command_line(campaign, Some(folder.path()));
    summed_up(campaign, &folder, &Flown::nothing(), args.json, &go_on)?;
    check_whole(&folder)
}

/// The results of all shards at an address, for queries where they lie; the shards stay where they are.
fn merged_in_store(address: &str, args: &MergeArgs, store: &dyn Store, campaign: &Campaign) -> Result<(), Failure> {
    let work = tempfile::Builder::new()
        .prefix("rotortwin-merge-")
        .tempdir()
        .map_err(|error| Failure::Failed(format!("a temporary folder for the results cannot be created: {error}")))?;
    let folder = gathered(&work.path().join("campaign"), args, Some(store), campaign)?;
    // Nothing is written over later, so that a part of the results has no place there.
    check_whole(&folder)?;
    let totals = runner::sum_up(campaign, &folder)?;
    store.keep(&folder, address, campaign)?;
    print_totals(campaign, &totals, &Flown::nothing(), args.json, address, "");
    Ok(())
}

/// The folder at `path` with the shards of all others.
fn gathered(
    path: &Path,
    args: &MergeArgs,
    store: Option<&dyn Store>,
    campaign: &Campaign,
) -> Result<CampaignFolder, Failure> {
    let folder = CampaignFolder::open(path, campaign).map_err(|sentence| Failure::opening(path, sentence))?;
    for other in &args.folders {
        match (address(other), store) {
            (Some(address), Some(store)) => store.take_in(&folder, address, campaign)?,
            _ => take_in(&folder, other, campaign).map(drop).map_err(Failure::Input)?,
        }
    }
    Ok(folder)
}

fn check_whole(folder: &CampaignFolder) -> Result<(), Failure> {
    let missing = missing_shards(folder, 0..folder.shard_count());
    if missing.is_empty() {
        return Ok(());
    }
    Err(Failure::Failed(format!(
        "{} of {} shards are missing: {}; fly them with --shards and merge again",
        missing.len(),
        folder.shard_count(),
        output::ranges(&missing)
    )))
}

fn fly_all(args: &FlightArgs, campaign: &Campaign) -> ExitCode {
    match flown_and_printed(args, campaign) {
        Ok(code) => code,
        Err(failure) => output::told(&failure),
    }
}

fn flown_and_printed(args: &FlightArgs, campaign: &Campaign) -> Result<ExitCode, Failure> {
    let prepared = runner::prepare(&args.job(campaign), campaign)?;
    let stop = runner::stop_flag().map_err(Failure::Failed)?;
    let flown = flown(args, &prepared, &stop, &|_shard| Ok(()))?;
    let folder = prepared.folder();
    let looked = !args.second_look || flown.end == RunEnd::Stopped || look_again(args, campaign, folder, &stop)?;
    if !looked {
        output::say_aside("stopped: the second look has not judged all flights; the same command goes on".to_owned());
    }
    let stopped = || ExitCode::from(rotortwin_process::EXIT_FAILED);
    if args.shards.is_some() {
        let code = said_of_shards(args, &flown, &folder.path().display().to_string());
        return Ok(if looked { code } else { stopped() });
    }
    let mut go_on = command_line(campaign, args.out.as_deref());
    if args.second_look {
        go_on += " --second-look";
    }
    summed_up(campaign, folder, &flown, args.json, &go_on)?;
    Ok(if looked { exit_code(&flown) } else { stopped() })
}

/// The second look judges the flights that are there; false if it was stopped.
fn look_again(
    args: &FlightArgs,
    campaign: &Campaign,
    folder: &CampaignFolder,
    stop: &AtomicBool,
) -> Result<bool, Failure> {
    let shards = (0..folder.shard_count()).filter(|shard| folder.has_shard(*shard));
    let flights = shards.map(|shard| {
        let range = folder.shard_range(shard);
        range.end - range.start
    });
    let bar = resumed_bar(
        "{bar:28.cyan/blue} {pos}/{len} flights, second look, {rate}, {left}",
        args.json,
        flights.sum(),
        0,
    );
    let threads = args.threads.unwrap_or_else(available_threads);
    let judged = second_look::judge(campaign, folder, threads, stop, &|done| bar.set_position(done));
    bar.finish_and_clear();
    judged
}

/// Flies shards, passes each to its place, and reports progress.
///
/// # Errors
/// A shard cannot be written or stored.
pub fn fly_shards(
    args: &FlightArgs,
    prepared: &runner::Prepared<'_>,
    address: &str,
    keep: &Keep<'_>,
) -> Result<ExitCode, Failure> {
    let stop = runner::stop_flag().map_err(Failure::Failed)?;
    let flown = flown(args, prepared, &stop, keep)?;
    Ok(said_of_shards(args, &flown, address))
}

fn said_of_shards(args: &FlightArgs, flown: &Flown, place: &str) -> ExitCode {
    if args.json {
        output::line(&serde_json::to_string(&flown.of_shards()).expect("numbers are JSON"));
    } else {
        output::line(&format!("{} flights flown; shards in {place}", flown.flights));
    }
    exit_code(flown)
}

fn exit_code(flown: &Flown) -> ExitCode {
    match flown.end {
        RunEnd::Complete => ExitCode::SUCCESS,
        RunEnd::Stopped => ExitCode::from(rotortwin_process::EXIT_FAILED),
    }
}

/// Flies the missing shards, with a progress bar or progress lines.
fn flown(
    args: &FlightArgs,
    prepared: &runner::Prepared<'_>,
    stop: &AtomicBool,
    keep: &Keep<'_>,
) -> Result<Flown, Failure> {
    if args.events {
        crate::fly::end_with_standard_input();
    }
    let bar = progress_bar(args.json, prepared.wanted(), prepared.present());
    let lines = args.events.then(Lines::new);
    let tell = |event: &JobEvent| {
        if let Some(lines) = &lines {
            lines.tell(event);
        }
        if let JobEvent::Progress(Progress::Flights {
            failed,
            false_alarms,
            flights,
            ..
        }) = event
        {
            bar.set_position(*flights);
            bar.set_message(if stop.load(Ordering::Relaxed) {
                "stopping once the parts in progress are complete; Ctrl-C again discards them".to_owned()
            } else {
                format!("{failed} failed, {false_alarms} false alarms")
            });
        }
    };
    let flown = prepared.fly_and_keep(stop, &tell, keep);
    bar.finish_and_clear();
    flown
}

/// A progress bar over flights, the first `present` of which already exist.
pub fn progress_bar(hidden: bool, wanted: u64, present: u64) -> ProgressBar {
    let template = "{bar:28.cyan/blue} {pos}/{len} flights, {rate}, {left}  {msg}";
    resumed_bar(template, hidden, wanted, present)
}

/// Creates and prints the results of the existing shards.
fn summed_up(
    campaign: &Campaign,
    folder: &CampaignFolder,
    flown: &Flown,
    json: bool,
    go_on: &str,
) -> Result<(), Failure> {
    let totals = runner::sum_up(campaign, folder)?;
    let place = folder.path().display().to_string();
    print_totals(campaign, &totals, flown, json, &place, go_on);
    Ok(())
}

fn print_totals(campaign: &Campaign, totals: &Totals, flown: &Flown, json: bool, place: &str, go_on: &str) {
    if json {
        println!("{}", CampaignSummary::new(campaign, totals).json());
    } else {
        print_text(campaign, totals, flown, place, go_on);
    }
}

/// * `place`: where the files are
/// * `go_on`: the command that continues, if some flights are missing
fn print_text(campaign: &Campaign, totals: &Totals, flown: &Flown, place: &str, go_on: &str) {
    let document = campaign.document();
    println!(
        "{}",
        output::fitted(&format!("{}: {}", document.name, document.description))
    );
    let flown_text = format!("{}\n", totals.in_words(campaign.flights()));
    println!("{}", output::fitted(&flown_text));
    let listed = tables::listed_flights(campaign, totals);
    for table in tables::tables(campaign, totals).into_iter().chain(listed) {
        println!("{}\n{}", output::fitted(&table.title), output::result_table(&table));
        for note in &table.notes {
            println!("{}", output::wrapped(note));
        }
        println!();
    }
    let files = [
        results::REPORT_FILE,
        results::PARQUET_FILE,
        results::CSV_FILE,
        results::SUMMARY_FILE,
    ]
    .join("  ");
    println!("Files        {place}\n             {files}");
    let wall = flown.start.elapsed().as_secs_f64();
    if flown.flights > 0 {
        let speed = format!(
            "Speed        {} flights in {wall:.1} s on {} threads: {:.1} flights/s, {:.2} M steps/s",
            flown.flights,
            flown.threads,
            flown.flights as f64 / wall,
            flown.steps as f64 / wall / 1e6
        );
        println!("{}", output::fitted(&speed));
    }
    if totals.flights < campaign.flights() {
        let why = match flown.end {
            RunEnd::Stopped => "Stopped",
            RunEnd::Complete => "Not all",
        };
        println!(
            "{why}: {} of {} flights are complete. To resume:",
            totals.flights,
            campaign.flights()
        );
        println!("{go_on}");
    }
}

/// The command that resumes, as typed.
fn command_line(campaign: &Campaign, out: Option<&Path>) -> String {
    let mut line = campaign.command();
    if let Some(out) = out {
        line += &format!(" --out {}", out.display());
    }
    line
}

fn fly_one(args: &FlightArgs, campaign: &Campaign, index: u64) -> ExitCode {
    let scenario = match runner::planned(campaign, index) {
        Ok((_, scenario)) => scenario,
        Err(failure) => return output::told(&failure),
    };
    let folder = args
        .out
        .clone()
        .map_or_else(|| output::next_free_folder(scenario.name()), Ok)
        .and_then(|path| RunFolder::create(&path).map_err(|error| error.to_string()));
    let folder = match folder {
        Ok(folder) => folder,
        Err(sentence) => return output::bad_input(sentence),
    };
    let config = SessionConfig {
        scenario_path: args.campaign.clone(),
        seed: scenario.seed(),
        link_name: "in-process".to_owned(),
        pace: Pace::Fast,
        run_id: 1,
        priority: None,
        live_hz: None,
    };
    let mut link = session::in_process_link();
    match session::fly(&scenario, &config, &mut link, &folder, &mut |_| (), &mut || None) {
        Ok(summary) => {
            if args.json {
                print!("{}", summary.to_json());
            } else {
                print!("{}", output::summary_text(&summary, Some(folder.path())));
            }
            output::exit_code(&summary)
        }
        Err(error) => output::failed(error),
    }
}

fn hunt(args: &FlightArgs, campaign: &Campaign) -> ExitCode {
    let name = format!("hunt-{}", campaign.document().name);
    let folder = args
        .out
        .clone()
        .map_or_else(|| output::next_free_folder(&name), Ok)
        .and_then(|path| RunFolder::create(&path).map_err(|error| error.to_string()));
    let folder = match folder {
        Ok(folder) => folder,
        Err(sentence) => return output::bad_input(sentence),
    };
    match hunt_into(args, campaign, folder.path()) {
        Ok(RunEnd::Complete) => ExitCode::SUCCESS,
        Ok(RunEnd::Stopped) => ExitCode::from(rotortwin_process::EXIT_FAILED),
        Err(sentence) => output::failed(sentence),
    }
}

fn hunt_into(args: &FlightArgs, campaign: &Campaign, folder: &Path) -> Result<RunEnd, String> {
    let stop = runner::stop_flag()?;
    let options = HuntOptions {
        seed: args.hunt_seed,
        budget: args.budget,
        cases: usize::from(args.cases),
        threads: args.threads.unwrap_or_else(available_threads),
    };
    let bar = progress_bar(args.json, args.budget, 0);
    let found = hunt::hunt(campaign, &SideBySide::default(), &options, &stop, &|| {
        bar.inc(1);
        if stop.load(Ordering::Relaxed) {
            bar.set_message("stopping once the flights in progress are complete; Ctrl-C again discards them");
        } else if bar.position() >= args.budget {
            bar.set_message("shrinking");
        }
    });
    bar.finish_and_clear();
    let end = if found.is_stopped {
        RunEnd::Stopped
    } else {
        RunEnd::Complete
    };
    let mut files = Vec::new();
    for (i, case) in found.cases.iter().enumerate() {
        files.push(hunt::write_case(campaign, case, i + 1, folder)?);
    }
    if args.json {
        let cases: Vec<_> = found
            .cases
            .iter()
            .zip(&files)
            .map(|(case, file)| {
                serde_json::json!({
                    "failure": case.failure.as_str(), "words": case.words, "kept": case.kept, "own_seed": case.own_seed, "file": file,
                })
            })
            .collect();
        let failures: Vec<_> = found
            .failures
            .iter()
            .map(|(failure, count)| (failure.as_str(), count))
            .collect();
        println!(
            "{:#}",
            serde_json::json!({ "flights": found.flights, "stopped": found.is_stopped, "failures": failures, "cases": cases })
        );
        return Ok(end);
    }
    let counts: Vec<String> = found
        .failures
        .iter()
        .map(|(failure, count)| format!("{count} {}", failure.as_str()))
        .collect();
    output::say(format!(
        "{} flights searched: {}; {} did not reach their end",
        found.flights,
        if counts.is_empty() {
            "no failure".to_owned()
        } else {
            counts.join(", ")
        },
        found.unfinished
    ));
    for (case, file) in found.cases.iter().zip(&files) {
        let kept: Vec<String> = case
            .kept
            .iter()
            .map(|(axis, cell)| format!("{axis} = {cell}"))
            .collect();
        output::say(format!("\n{}\n  {}", file.display(), case.words));
        output::say(format!(
            "  what matters: {}{} ({} flights to shrink)",
            if kept.is_empty() {
                "nothing but the base".to_owned()
            } else {
                kept.join(", ")
            },
            if case.own_seed { ", and the seed" } else { "" },
            case.flights
        ));
    }
    if found.is_stopped {
        let wanted = args.budget;
        output::say(format!(
            "\nStopped: {} of {wanted} flights were searched. A hunt does not resume: the same command begins again.",
            found.flights
        ));
    }
    Ok(end)
}
