//! A flight: a job like any other, whose process starts plant, controller and FDI engine, or waits for external ones or an autopilot.

use super::child::{self, Limits, Listener, Reason};
use super::{Ended, Meeting, WorkerContext, files_key, job_command};
use crate::jobs::{Job, Outcome};
use rotortwin_jobs::flight::{Controller, Flight, Link, Place};
use rotortwin_jobs::{AutopilotHere, FlightHere, Here, Invitation, JobFile, SeatRole, Status, Tickets};
use rotortwin_store::summary::{Status as FlightStatus, Summary, load_summary};
use rotortwin_wire::events::RunEvent;
use serde::Deserialize as _;
use serde_json::Value;
use std::path::Path;
use tokio::process::Command;

/// Live samples per second of simulated time; the flight itself limits the rate per second of wall clock.
const LIVE_HZ: f64 = 100.0;
/// Log of the flight's processes, next to its files.
const COMPLAINTS: &str = "fly.log";

pub(super) async fn fly(context: &WorkerContext, job: &Job, token: &str, spec: &Flight, folder: &Path) -> Ended {
    let out = context.artifacts.place(&files_key(job));
    let complaints = folder.join(COMPLAINTS);
    let child =
        command(context, spec, folder).and_then(|command| child::start(command, Limits::of(context, job), &complaints));
    let child = match child {
        Ok(child) => child,
        Err(error) => return Ended::Failed(format!("the flight could not be started: {error}")),
    };
    let mut issuer = TicketIssuer {
        context,
        job,
        token,
        spec,
        flown_s: 0.0,
    };
    let end = child::watch(context, job, token, child, &mut issuer).await;
    match end.reason {
        Reason::Lost => return Ended::Lost,
        Reason::WorkerEnds => return Ended::WorkerEnds,
        Reason::Itself | Reason::Canceled | Reason::TooLong => {}
    }
    let too_long = || {
        format!(
            "the limit of {} s of wall time was exceeded",
            job.new.wall_limit_ms / 1000
        )
    };
    let Ok(summary) = load_summary(&out) else {
        return match end.reason {
            Reason::Canceled => Ended::Outcome(Outcome {
                status: Status::Canceled,
                folder: None,
                bytes: 0,
                run_hash: None,
                error: Some(canceled_without_result(issuer.flown_s)),
                result: None,
            }),
            Reason::TooLong => Ended::Outcome(super::failed(job, too_long())),
            _ => Ended::Failed(format!(
                "the flight ended without a result: {}",
                child::last_words(&complaints)
            )),
        };
    };
    if let (FlightStatus::Failed, Some(failure)) = (summary.status, &summary.failure)
        && end.reason == Reason::Itself
        && job.failures + 1 < super::ATTEMPTS
        && failure.lost
        && is_worth_another_try(spec, &failure.peer)
    {
        return Ended::Failed(failure.sentence.clone());
    }
    let bytes = match context.artifacts.publish(&files_key(job)).await {
        Ok(bytes) => bytes,
        Err(error) => return Ended::Failed(format!("the flight's files cannot be kept: {error}")),
    };
    if let (Some(name), Some(controller)) = (spec.controller.autopilot(), &summary.controller) {
        // For display next to its name only.
        let noted = context
            .database
            .autopilot_flew(name, controller.version.as_deref())
            .await;
        if let Err(error) = noted {
            tracing::warn!(autopilot = name, %error, "its version cannot be noted");
        }
    }
    let mut outcome = outcome(&summary, files_key(job), bytes);
    if end.reason == Reason::TooLong {
        outcome.status = Status::Failed;
        outcome.error = Some(too_long());
        outcome.run_hash = None;
    }
    Ended::Outcome(outcome)
}

/// A flight whose processes had no time to write what they had.
///
/// * `flown_s`: simulated time of its last progress, s
fn canceled_without_result(flown_s: f64) -> String {
    if flown_s > 0.0 {
        format!("canceled after {flown_s:.1} s of flight, of which nothing is kept")
    } else {
        "canceled before it had flown".to_owned()
    }
}

/// One of our own processes is gone. The loss of a third-party one is a result.
fn is_worth_another_try(spec: &Flight, peer: &str) -> bool {
    match SeatRole::parse(peer) {
        Some(SeatRole::Controller) => matches!(spec.controller.place(), Some(Place::Beside | Place::Worker)),
        Some(SeatRole::Fdi) => spec.fdi != Place::External,
        None => matches!(peer, "plant" | "supervisor"),
    }
}

fn outcome(summary: &Summary, folder: String, bytes: u64) -> Outcome {
    let status = match summary.status {
        FlightStatus::Done => Status::Done,
        FlightStatus::Failed => Status::Failed,
        FlightStatus::Canceled => Status::Canceled,
    };
    Outcome {
        status,
        folder: Some(folder),
        bytes: i64::try_from(bytes).unwrap_or(i64::MAX),
        run_hash: Some(summary.run_hash.clone()).filter(|_| status == Status::Done),
        error: summary.failure.as_ref().map(|failure| failure.sentence.clone()),
        result: Some(summary.to_json()),
    }
}

fn command(context: &WorkerContext, spec: &Flight, folder: &Path) -> std::io::Result<Command> {
    let autopilot = match &spec.controller {
        Controller::Autopilot(name) => {
            let listed = context.autopilots.iter().find(|autopilot| autopilot.name == *name);
            let listed =
                listed.ok_or_else(|| std::io::Error::other(format!("no autopilot '{name}' is configured here")))?;
            Some(AutopilotHere {
                address: listed.address.clone(),
                pilot: listed.pilot.clone(),
            })
        }
        _ => None,
    };
    let meeting = match &context.zenoh {
        _ if spec.link != Link::Zenoh => None,
        Meeting::Listen(endpoint) => Some(rotortwin_jobs::Meeting::Listen(with_port(endpoint)?)),
        Meeting::Router(endpoint) => Some(rotortwin_jobs::Meeting::Connect(endpoint.clone())),
    };
    let file = JobFile {
        job: rotortwin_jobs::Job::Run(spec.clone()),
        here: Here {
            until_input_ends: true,
            flight: FlightHere {
                out: None,
                live_hz: Some(LIVE_HZ),
                meeting,
                autopilot,
            },
        },
    };
    job_command(&context.program, &file, folder)
}

/// Replaces port 0 of an endpoint by a currently free one. (If it is taken before the plant listens, the flight is retried.)
fn with_port(endpoint: &str) -> std::io::Result<String> {
    let Some(start) = endpoint.strip_suffix(":0") else {
        return Ok(endpoint.to_owned());
    };
    let host = start.split_once('/').map_or(start, |(_, host)| host);
    let port = std::net::TcpListener::bind(format!("{host}:0"))?.local_addr()?.port();
    Ok(format!("{start}:{port}"))
}

fn roles(spec: &Flight) -> impl Iterator<Item = (SeatRole, Place)> {
    let controller = spec.controller.place().map(|place| (SeatRole::Controller, place));
    controller.into_iter().chain([(SeatRole::Fdi, spec.fdi)])
}

/// Issues the tickets once the plant is waiting, and notes how far the flight is.
struct TicketIssuer<'a> {
    context: &'a WorkerContext,
    job: &'a Job,
    token: &'a str,
    spec: &'a Flight,
    /// Simulated time of the last progress, s.
    flown_s: f64,
}

impl Listener for TicketIssuer<'_> {
    async fn event(&mut self, _: &str, event: &Value) {
        if let Ok(RunEvent::Progress(progress)) = RunEvent::deserialize(event) {
            self.flown_s = progress.sim_time_s;
            return;
        }
        if let Ok(Invitation::Join(tickets)) = Invitation::deserialize(event) {
            self.hand_out(event, &tickets).await;
        }
    }
}

impl TicketIssuer<'_> {
    /// `event`: that of the `tickets`, which is stored as it is.
    async fn hand_out(&self, event: &Value, tickets: &Tickets) {
        let ticket = |role: SeatRole| {
            let ticket = tickets.peers.iter().find(|ticket| ticket.role == role)?;
            serde_json::to_string(ticket).ok()
        };
        let database = &self.context.database;
        let seats: Vec<(SeatRole, String)> = roles(self.spec)
            .filter(|(_, place)| *place == Place::Worker)
            .filter_map(|(role, _)| Some((role, ticket(role)?)))
            .collect();
        let written = match database
            .set_ticket(&self.job.id, self.token, Some(&event.to_string()))
            .await
        {
            Ok(held) if held && !seats.is_empty() => database.offer_seats(&self.job.id, self.token, &seats).await,
            other => other,
        };
        if let Err(error) = written {
            tracing::error!(job = self.job.id, %error, "the run's tickets cannot be written; no peer can join");
        }
    }
}
