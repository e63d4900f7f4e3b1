//! The zenoh-independent part of links over zenoh: endpoints, and the hook that opens such a link.
//!
//! zenoh takes as long to compile as everything else that a flight over shared memory needs, so it lives in its own crate, `rotortwin-zenoh`.
//! A program with that crate registers it with [`provide`]; in others, [`open`] returns an error that names a suitable program.

use crate::endpoint::Endpoint;
use crate::security::{Attachment, DEFAULT_SPACE, Security};
use rotortwin_proto::Role;
use rotortwin_wire::link::LinkError;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Opens the end of a role in a run.
pub type Opener = fn(Role, u64, ZenohOptions) -> Result<Box<dyn Endpoint + Send>, LinkError>;

static OPENER: OnceLock<Opener> = OnceLock::new();

/// Registers `opener` for links over zenoh; the first registration wins.
pub fn provide(opener: Opener) {
    OPENER.get_or_init(|| opener);
}

/// True if this program supports zenoh.
pub fn is_provided() -> bool {
    OPENER.get().is_some()
}

/// Opens the end of `role` in the run `run_id`.
///
/// # Errors
/// This program does not support zenoh, or the opener's error.
pub fn open(role: Role, run_id: u64, options: ZenohOptions) -> Result<Box<dyn Endpoint + Send>, LinkError> {
    match OPENER.get() {
        Some(open) => open(role, run_id, options),
        None => Err(LinkError::Transport {
            transport: "zenoh",
            action: format!("opening {}", options.endpoint),
            reason:
                "this program was built without zenoh; expected a link over iceoryx2, or the program rotortwin-network"
                    .to_owned(),
        }),
    }
}

/// Where the processes of a run meet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ZenohOptions {
    /// "tcp/address:port" or "tls/address:port", the same for all processes of a run.
    pub endpoint: String,
    /// How this process uses it.
    pub attachment: Attachment,
    /// How long a connecting process retries.
    pub connect_timeout: Duration,
    /// Credentials; `None`: every client that reaches the endpoint is admitted.
    pub security: Option<Security>,
}

impl ZenohOptions {
    /// Listens on `endpoint`.
    pub fn listen(endpoint: impl Into<String>) -> Self {
        Self {
            endpoint: endpoint.into(),
            attachment: Attachment::Listen,
            connect_timeout: Duration::from_secs(5),
            security: None,
        }
    }

    /// Connects to `endpoint`, for up to 5 s.
    pub fn connect(endpoint: impl Into<String>) -> Self {
        Self {
            attachment: Attachment::Connect,
            ..Self::listen(endpoint)
        }
    }

    /// "tcp/127.0.0.1:port" with a port that was free a moment ago, below the range that the kernel uses for outgoing connections.
    pub fn free_loopback_endpoint() -> std::io::Result<String> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let mut last = std::io::Error::other("no port tried");
        for _ in 0..100 {
            let count = NEXT.fetch_add(1, Ordering::Relaxed);
            let spread = std::process::id().wrapping_add(count).wrapping_mul(0x9e37_79b9) >> 18;
            let port = 16_000 + u16::try_from(spread).expect("14 bits");
            match std::net::TcpListener::bind(("127.0.0.1", port)) {
                Ok(listener) => return Ok(format!("tcp/{}", listener.local_addr()?)),
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    /// First part of all keys.
    pub fn space(&self) -> &str {
        self.security
            .as_ref()
            .map_or(DEFAULT_SPACE, |security| security.space.as_str())
    }
}
