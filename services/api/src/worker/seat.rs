//! A seat: `rotortwin controller` or `rotortwin fdi` for a run that is flown on another host.

use super::WorkerContext;
use super::child::{BAD_INPUT, last_words, signal, without_secrets};
use crate::jobs::seats::Seat;
use rotortwin_jobs::Ticket;
use rustix::process::Signal;
use std::process::Stdio;
use std::time::Duration;
use tokio::process::Command;

/// Time for a process to exit after a request.
const GRACE: Duration = Duration::from_secs(1);
/// Time between two questions whether the attempt still runs.
const ASK: Duration = Duration::from_secs(2);
/// Time that a host leaves to others after it could not reach a plant.
const LEAVE_TO_OTHERS: Duration = Duration::from_secs(3);

/// Starts the process and waits for its end. However it ends, the plant notices and reports which peer is missing.
pub(super) async fn serve(context: &WorkerContext, seat: &Seat) {
    let Ok(ticket) = serde_json::from_str::<Ticket>(&seat.ticket) else {
        tracing::error!(run = seat.job, "its ticket cannot be read");
        return;
    };
    let role = seat.role.as_str();
    let complaints = context
        .artifacts
        .place(&format!("seats/{}-{role}-{}.log", seat.job, seat.claim));
    let child = complaints
        .parent()
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| std::fs::File::create(&complaints))
        .and_then(|file| {
            let mut command = Command::new(&context.program);
            without_secrets(&mut command);
            command
                .arg(role)
                .args(["--link", &ticket.link])
                .args(["--run-id", &ticket.run_id])
                // As long as the plant waits for all its peers: they may come one after the other.
                .args(["--join-timeout", &ticket.join_timeout_ms.to_string()])
                .args(["--step-timeout", &ticket.step_timeout_ms.to_string()])
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(file)
                .process_group(0)
                .kill_on_drop(true)
                .spawn()
        });
    let mut child = match child {
        Ok(child) => child,
        Err(error) => {
            tracing::error!(run = seat.job, role, %error, "a seat was claimed, but its process cannot be started");
            return;
        }
    };
    tracing::info!(run = seat.job, role, "seat taken");
    let mut ending = context.ending.subscribe();
    let over = async {
        tokio::select! {
            () = ends(&mut ending) => {}
            () = unwanted(context, seat) => {}
        }
    };
    let ended = tokio::select! {
        ended = child.wait() => ended,
        () = over => {
            signal(&child, Signal::TERM, false);
            match tokio::time::timeout(GRACE, child.wait()).await {
                Ok(ended) => ended,
                Err(_) => child.kill().await.and(child.wait().await),
            }
        }
    };
    match ended {
        Ok(status) if status.success() => tracing::info!(run = seat.job, role, "seat left"),
        Ok(status) => {
            tracing::warn!(run = seat.job, role, %status, why = last_words(&complaints), "seat left early");
            // It could not reach the meeting point that its address names: another host may.
            if status.code() == Some(BAD_INPUT) {
                if let Err(error) = context.database.release_seat(seat).await {
                    tracing::error!(run = seat.job, role, %error, "a seat cannot be given back");
                }
                tokio::select! {
                    () = ends(&mut ending) => {}
                    () = tokio::time::sleep(LEAVE_TO_OTHERS) => {}
                }
            }
        }
        Err(error) => {
            tracing::error!(run = seat.job, role, %error, "waiting for the process of a seat failed")
        }
    }
    if let Err(error) = std::fs::remove_file(&complaints) {
        tracing::debug!(%error, "a seat's log cannot be removed");
    }
}

/// Ready once the attempt that offered the seat is over.
async fn unwanted(context: &WorkerContext, seat: &Seat) {
    loop {
        tokio::time::sleep(ASK).await;
        // A database that is away says nothing about the run.
        if let Ok(false) = context.database.seat_is_wanted(seat).await {
            return;
        }
    }
}

/// Ready once the process ends.
async fn ends(ending: &mut tokio::sync::watch::Receiver<bool>) {
    while !*ending.borrow_and_update() {
        if ending.changed().await.is_err() {
            return;
        }
    }
}
