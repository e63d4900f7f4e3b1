//! The parent process: its requests, and behaviour when it dies.
//!
//! The plant of a supervised run has a pipe from its supervisor on standard input. A line on it ends the run: `cancel`, or
//! `fail WHO SENTENCE` for something that only the supervisor could see. The end of the pipe means that the supervisor is dead,
//! however it died. The controller and the FDI engine have nothing to save: the kernel ends them with their parent.
//!
//! The plant must know why its peers died so suddenly. The kernel therefore also sends it a signal when its parent dies, before
//! it ends the peers: the plant was started first. The pipe alone would occasionally be read too late.

use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use std::io::BufRead as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Why this process should end its run early.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StopRequest {
    /// Cancelled by the user.
    Cancel,
    /// A failure observed by the supervisor.
    Fail {
        /// `controller` or `fdi`.
        peer: String,
        /// Error message.
        sentence: String,
    },
    /// The supervisor is dead.
    Orphaned,
}

/// Watches for requests to stop.
#[derive(Clone, Debug, Default)]
pub struct Supervisor {
    stop: Arc<AtomicBool>,
    /// The parent process is dead.
    orphaned: Arc<AtomicBool>,
    request: Arc<Mutex<Option<StopRequest>>>,
}

impl Supervisor {
    /// Turns SIGINT and SIGTERM into a request to stop; with `supervised` set also reads standard input for requests.
    pub fn watch(supervised: bool) -> std::io::Result<Self> {
        let supervisor = Self::default();
        signal_hook::flag::register(SIGTERM, Arc::clone(&supervisor.stop))?;
        signal_hook::flag::register(SIGINT, Arc::clone(&supervisor.stop))?;
        if supervised {
            // In this order: a thread that sees the request to stop sees the reason as well.
            signal_hook::flag::register(SIGUSR1, Arc::clone(&supervisor.orphaned))?;
            signal_hook::flag::register(SIGUSR1, Arc::clone(&supervisor.stop))?;
            rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::USR1))?;
            let reader = supervisor.clone();
            std::thread::Builder::new()
                .name("supervisor".to_owned())
                .spawn(move || reader.read_requests())?;
        }
        Ok(supervisor)
    }

    /// Makes the kernel end this process when its parent, the process with this id, dies.
    pub fn end_with_parent(parent_pid: u32) -> std::io::Result<()> {
        rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL))?;
        // It may have died before the line above.
        let parent = rustix::process::getppid().map(|pid| pid.as_raw_nonzero().get().unsigned_abs());
        if parent != Some(parent_pid) {
            return Err(std::io::Error::other(format!(
                "process {parent_pid}, which started this one, has exited"
            )));
        }
        Ok(())
    }

    fn read_requests(&self) {
        let mut line = String::new();
        let request = match std::io::stdin().lock().read_line(&mut line) {
            Ok(0) | Err(_) => StopRequest::Orphaned,
            Ok(_) => parse_request(line.trim_end()),
        };
        *self.request.lock().unwrap_or_else(PoisonError::into_inner) = Some(request);
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Set once there is a reason to stop, for interruptible waits.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }

    /// The reason to stop, if any. A signal without a reason is a cancellation.
    #[inline]
    pub fn stop_request(&self) -> Option<StopRequest> {
        if !self.stop.load(Ordering::Acquire) {
            return None;
        }
        if self.orphaned.load(Ordering::Relaxed) {
            return Some(StopRequest::Orphaned);
        }
        let request = self.request.lock().unwrap_or_else(PoisonError::into_inner);
        Some(request.clone().unwrap_or(StopRequest::Cancel))
    }
}

/// The line for `request`; none for [`StopRequest::Orphaned`], which is the end of the pipe.
pub fn request_line(request: &StopRequest) -> Option<String> {
    match request {
        StopRequest::Cancel => Some("cancel\n".to_owned()),
        StopRequest::Fail { peer, sentence } => Some(format!("fail {peer} {}\n", sentence.replace('\n', " "))),
        StopRequest::Orphaned => None,
    }
}

fn parse_request(line: &str) -> StopRequest {
    match line.strip_prefix("fail ").and_then(|rest| rest.split_once(' ')) {
        Some((peer, sentence)) => StopRequest::Fail {
            peer: peer.to_owned(),
            sentence: sentence.to_owned(),
        },
        None => StopRequest::Cancel,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_requests_survive_the_pipe() {
        for request in [
            StopRequest::Cancel,
            StopRequest::Fail {
                peer: "controller".to_owned(),
                sentence: "was killed by signal 9".to_owned(),
            },
        ] {
            let line = request_line(&request).expect("these two have lines");
            assert_eq!(parse_request(line.trim_end()), request);
        }
    }
}
