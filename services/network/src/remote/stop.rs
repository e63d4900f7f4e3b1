//! Ctrl-C and SIGTERM as a future.

use super::RemoteError;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Both signals, from its creation on.
pub(super) struct Stop {
    interrupt: Signal,
    terminate: Signal,
}

impl Stop {
    pub(super) fn new() -> Result<Self, RemoteError> {
        let told = |error| RemoteError::Failed(format!("Ctrl-C cannot be handled: {error}"));
        Ok(Self {
            interrupt: signal(SignalKind::interrupt()).map_err(told)?,
            terminate: signal(SignalKind::terminate()).map_err(told)?,
        })
    }

    /// The next of them.
    pub(super) async fn wanted(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}
