//! `rotortwin fdi-log` and `rotortwin fdi-service`: the detectors on flights that somebody else flies.

use crate::grid::Grid;
use crate::output::{bad_input, failed, line};
use rotortwin_api::fdi::answers::{SequentialView, VerdictKind};
use rotortwin_api::fdi::log::{LogReport, judge_file};
use rotortwin_fdi::service::FdiSession;
use rotortwin_fdi::service::topic::{TopicService, is_session_name, measurement_topic, report_topic};
use rotortwin_links::topics::TopicSession;
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_process::LinkAddress;
use rotortwin_scenario::template::{TomlFile, set_value};
use rotortwin_scenario::{Classifier, DetectorSettings, Detectors, VehicleDocuments};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Which detectors.
#[derive(Debug, clap::Args)]
struct DetectorArgs {
    /// Vehicle, a file or a name: what the detectors take for healthy
    #[arg(long = "model", alias = "vehicle", value_name = "VEHICLE", value_parser = crate::named::vehicle())]
    vehicle: PathBuf,
    /// Classifier, a file or a name; without one the network gives no verdict
    #[arg(long, value_name = "CLASSIFIER", value_parser = crate::named::classifier())]
    classifier: Option<PathBuf>,
    /// A key of the [fdi] table of scenarios, such as calibration_end_s=5; by default as the classifier was trained
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl DetectorArgs {
    fn detectors(&self) -> Result<Detectors, String> {
        let vehicle = VehicleDocuments::load(&self.vehicle).map_err(|error| error.to_string())?;
        let classifier = self.classifier.as_deref().map(Classifier::read).transpose();
        let classifier = classifier.map_err(|error| error.to_string())?;
        Detectors::new(vehicle, &self.settings()?, classifier)
            .map_err(|refusal| format!("{}, `{}`: {}", self.vehicle.display(), refusal.key, refusal.reason))
    }

    fn settings(&self) -> Result<DetectorSettings, String> {
        let mut table = toml::Table::new();
        for setting in &self.set {
            let refuse = |reason: &str| format!("--set {setting}: {reason}");
            let (key, value) = setting.split_once('=').ok_or_else(|| refuse("expected KEY=VALUE"))?;
            let value = toml::from_str::<toml::Table>(&format!("value = {value}"))
                .ok()
                .and_then(|mut table| table.remove("value"))
                .unwrap_or_else(|| toml::Value::String(value.to_owned()));
            set_value(&mut table, key.trim(), value).map_err(|reason| refuse(&reason))?;
        }
        let text = toml::to_string(&table).map_err(|error| error.to_string())?;
        TomlFile::from_text("--set", &text)
            .and_then(|file| file.parse())
            .map_err(|error| format!("--set, key `{}`: {}", error.key().unwrap_or("?"), error.reason()))
    }
}

/// Arguments of `rotortwin fdi-log`.
#[derive(Debug, clap::Args)]
pub(crate) struct LogArgs {
    /// Canonical CSV or Parquet, run folder, or a log of an autopilot
    #[arg(value_name = "LOG")]
    log: PathBuf,
    #[command(flatten)]
    detectors: DetectorArgs,
    /// Print the whole report as JSON
    #[arg(long)]
    json: bool,
}

/// Judges a log; exit code 2 if it is none or lacks what every detector needs.
pub(crate) fn judge_log(args: &LogArgs) -> ExitCode {
    let judged = args
        .detectors
        .detectors()
        .and_then(|detectors| judge_file(&args.log, &detectors, None).map_err(|refusal| refusal.to_string()));
    let report = match judged {
        Ok(report) => report,
        Err(sentence) => return bad_input(sentence),
    };
    if args.json {
        match serde_json::to_string_pretty(&report) {
            Ok(text) => line(&text),
            Err(error) => return failed(error),
        }
    } else if report.final_window.is_some() {
        line(&text_of(&report));
    }
    match report.lacks.iter().find(|lack| lack.prevents_verdicts) {
        Some(lack) => bad_input(format!(
            "{}: the log lacks {}, which rules out {}",
            args.log.display(),
            lack.columns.join(", "),
            lack.rules_out
        )),
        None if report.final_window.is_none() => bad_input(format!(
            "{}: no step has a value in every channel that the detectors need; expected rows that hold velocity, attitude, body rates, \
             duties and voltage together",
            args.log.display()
        )),
        None => ExitCode::SUCCESS,
    }
}

fn text_of(report: &LogReport) -> String {
    let detectors = &report.detectors;
    let mut text = format!(
        "Log          {} rows, {:.2} s at {:.1} Hz\nVehicle      {} ({} rotors), classifier {}\nCalibration  until {} s; what is damaged by \
         then counts as healthy\nSteps        {} judged, {} lost, {} rejected; {:.1} s with a verdict\n\n",
        report.log.rows,
        report.log.duration_s,
        report.log.rate_hz,
        detectors.vehicle,
        detectors.rotor_count,
        detectors.classifier.as_deref().unwrap_or("none"),
        detectors.calibration_end_s,
        report.steps,
        report.lost_steps,
        report.rejected_steps,
        report.decided_s
    );
    let mut timeline = Grid::new(["time", "sequential detector", "probability"]).numbers([2]);
    for change in &report.timeline {
        timeline.add_row([
            format!("{:.3} s", change.time_s),
            verdict_text(&change.sequential),
            format!("{:.4}", change.sequential.probability),
        ]);
    }
    if let Some(last) = &report.final_window {
        timeline.add_row([
            "at the end".to_owned(),
            verdict_text(&last.sequential),
            format!("{:.4}", last.sequential.probability),
        ]);
    }
    text += &format!("{timeline}\n\n");
    let mut counts = Grid::new(["detector", "windows", "healthy", "alarmed", "alarms", "first alarm"]).numbers_from(1);
    for count in &report.counts {
        counts.add_row([
            count.detector.clone(),
            count.decided.to_string(),
            count.healthy.to_string(),
            count.alarmed.to_string(),
            count.alarms.to_string(),
            count
                .first_alarm_s
                .map_or("–".to_owned(), |time_s| format!("{time_s:.3} s")),
        ]);
    }
    text += &format!("{counts}\n");
    for lack in &report.lacks {
        text += &format!("\nNot said     {}", lack.rules_out);
    }
    for suspicion in &report.suspicions {
        text += &format!("\nSuspicious   {}", suspicion.finding);
    }
    for note in &report.notes {
        text += &format!("\nNote         {note}");
    }
    text.trim_end().to_owned()
}

fn verdict_text(view: &SequentialView) -> String {
    let losses = || -> Vec<String> {
        view.thrust_loss
            .iter()
            .map(|loss| {
                format!(
                    "rotor {} lost {:.1} % [{:.1}, {:.1}]",
                    loss.rotor,
                    100.0 * loss.share,
                    100.0 * loss.share_low,
                    100.0 * loss.share_high
                )
            })
            .collect()
    };
    match view.verdict.verdict {
        VerdictKind::NotReady => "calibrating".to_owned(),
        VerdictKind::Healthy => "healthy".to_owned(),
        VerdictKind::Unknown => "unknown fault".to_owned(),
        VerdictKind::Ambiguous => {
            let sets: Vec<String> = view
                .hypotheses
                .iter()
                .map(|set| set.iter().map(u32::to_string).collect::<Vec<_>>().join("+"))
                .collect();
            format!("ambiguous: rotors {}", sets.join(" or "))
        }
        VerdictKind::Faulty | VerdictKind::FaultyPair => losses().join(", "),
    }
}

/// Arguments of `rotortwin fdi-service`.
#[derive(Debug, clap::Args)]
pub(crate) struct ServiceArgs {
    /// Where measurements come from: zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT
    #[arg(long, value_name = "LINK")]
    link: LinkAddress,
    #[command(flatten)]
    detectors: DetectorArgs,
    /// Name of the session, part of its topics
    #[arg(long, value_name = "NAME", default_value = "default")]
    session: String,
}

/// Feeds one session from its topic until Ctrl-C or SIGTERM.
pub(crate) fn serve(args: &ServiceArgs) -> ExitCode {
    if !is_session_name(&args.session) {
        return bad_input(format!(
            "--session {}: expected 1 to 64 letters, digits, '-' and '_'",
            args.session
        ));
    }
    let options = match &args.link {
        LinkAddress::ZenohListen { endpoint, config: None } => ZenohOptions::listen(endpoint.clone()),
        LinkAddress::ZenohConnect { endpoint, config: None } => ZenohOptions::connect(endpoint.clone()),
        LinkAddress::ZenohListen { .. } | LinkAddress::ZenohConnect { .. } => {
            return bad_input(
                "--link: topics of FDI sessions have no access control yet; expected an endpoint without config=FILE, in a network that you \
                 trust",
            );
        }
        LinkAddress::Iceoryx2 { .. } => {
            return bad_input(
                "--link: measurements do not come over iceoryx2; expected zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT",
            );
        }
    };
    let session = args
        .detectors
        .detectors()
        .and_then(|detectors| FdiSession::new(*detectors.config(), 1).map_err(|error| error.to_string()));
    let session = match session {
        Ok(session) => Arc::new(Mutex::new(session)),
        Err(sentence) => return bad_input(sentence),
    };
    rotortwin_process::start_logging();
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        if let Err(error) = signal_hook::flag::register(signal, Arc::clone(&stop)) {
            return failed(format!("signals cannot be handled: {error}"));
        }
    }
    let topics = match TopicSession::open(&options) {
        Ok(topics) => topics,
        Err(error) => return bad_input(error),
    };
    let last = Mutex::new(None);
    let service = TopicService::start(&topics, &args.session, session, move |answer| match answer {
        Ok(answer) => {
            let mut last = last.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            for note in &answer.notes {
                line(&format!("note         {note}"));
            }
            for window in answer.windows.iter().filter(|_| !answer.repeated) {
                let view = SequentialView::of(&window.report);
                if last.as_ref() != Some(&view.verdict) {
                    let time_s = window.report.stamp.sim_time_ns as f64 * 1e-9;
                    line(&format!(
                        "t {time_s:>9.3} s  {} (probability {:.4})",
                        verdict_text(&view),
                        view.probability
                    ));
                    *last = Some(view.verdict);
                }
            }
        }
        Err(refusal) => line(&format!("refused      {refusal}")),
    });
    let _service = match service {
        Ok(service) => service,
        Err(error) => return bad_input(error),
    };
    line(&format!("Measurements {}", measurement_topic(&args.session)));
    line(&format!("Verdicts     {}", report_topic(&args.session)));
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    ExitCode::SUCCESS
}
