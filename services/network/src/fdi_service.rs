//! `rotortwin fdi-service`: the detectors on measurements received over zenoh.

use rotortwin_cli::fdi_service::ServiceArgs;
use rotortwin_cli::output::{bad_input, failed, line};
use rotortwin_fdi_session::FdiSession;
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_process::LinkAddress;
use rotortwin_verdicts::view::SequentialView;
use rotortwin_zenoh::fdi_topic::{TopicService, is_session_name, measurement_topic, report_topic};
use rotortwin_zenoh::topics::TopicSession;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Feeds one session from its topic until Ctrl-C or SIGTERM.
pub(crate) fn run(args: &ServiceArgs) -> ExitCode {
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
                "--link: topics of FDI sessions have no access control yet; expected an endpoint without config=FILE, on a trusted \
                 network",
            );
        }
        LinkAddress::Iceoryx2 { .. } => {
            return bad_input(
                "--link: measurements do not come over iceoryx2; expected zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT",
            );
        }
    };
    let session = args.detectors.detectors().and_then(|(detectors, note)| {
        let session = FdiSession::new(*detectors.config(), 1).map_err(|error| error.to_string())?;
        Ok((session, note))
    });
    let session = match session {
        Ok((session, note)) => {
            if let Some(note) = note {
                line(&format!("Note         {note}"));
            }
            Arc::new(Mutex::new(session))
        }
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
                let view = SequentialView::in_window(window);
                if last.as_ref() != Some(&view.verdict) {
                    let time_s = window.report.stamp.sim_time_ns as f64 * 1e-9;
                    let said = match &window.obstacle {
                        Some(obstacle) => format!("cannot judge: {obstacle}"),
                        None => format!("{} (probability {:.4})", view.sentence, view.probability),
                    };
                    line(&format!("t {time_s:>9.3} s  {said}"));
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
