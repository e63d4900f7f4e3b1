//! Address at which the processes of a run meet.

use crate::zenoh_config;
use rotortwin_links::security::{Attachment, Security};
use std::fmt;
use std::net::{TcpListener, TcpStream, ToSocketAddrs as _};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// Address at which the processes of a run meet, in its text form.
///
/// * `iceoryx2` or `iceoryx2:DOMAIN`: shared memory of this host. Runs in different domains do not see each other.
/// * `zenoh:listen=ENDPOINT`: the plant listens there and routes between its peers; they connect.
/// * `zenoh:connect=ENDPOINT`: all processes connect there: to the plant of the form above, or to a zenoh router.
///
/// An endpoint is zenoh's, e.g. `tcp/127.0.0.1:7447` or `tls/bench:7447`. A following `,config=FILE` names the file with
/// certificates, user and password: see [`zenoh_config`](crate::zenoh_config).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkAddress {
    /// Shared memory of this host.
    Iceoryx2 {
        /// 1 to 8 letters, digits, `-` and `_`.
        domain: String,
    },
    /// TCP; the plant listens.
    ZenohListen {
        /// zenoh endpoint.
        endpoint: String,
        /// Credentials.
        config: Option<PathBuf>,
    },
    /// TCP; all processes connect.
    ZenohConnect {
        /// zenoh endpoint.
        endpoint: String,
        /// Credentials.
        config: Option<PathBuf>,
    },
}

impl LinkAddress {
    /// `iceoryx2` or `zenoh`.
    pub fn transport(&self) -> &'static str {
        match self {
            Self::Iceoryx2 { .. } => "iceoryx2",
            Self::ZenohListen { .. } | Self::ZenohConnect { .. } => "zenoh",
        }
    }
}

/// Time allowed for an answer at the endpoint of a link.
const PROBE_TIMEOUT: Duration = Duration::from_secs(2);

impl LinkAddress {
    /// Checks that the plant can meet its peers here; an error message if not.
    ///
    /// Called before a run begins, so that a wrong endpoint costs nothing. Another process may still take the endpoint a moment
    /// later.
    pub fn probe(&self) -> Result<(), String> {
        self.security()?;
        match self {
            Self::Iceoryx2 { .. } => Ok(()),
            Self::ZenohListen { endpoint, .. } => match TcpListener::bind(host_and_port(endpoint)) {
                Ok(_) => Ok(()),
                Err(error) => Err(format!(
                    "cannot listen on {endpoint}: {error}; expected an address of this host and a free port"
                )),
            },
            Self::ZenohConnect { endpoint, .. } => {
                let refuse = |error: std::io::Error| {
                    format!("no response at {endpoint}: {error}; expected the endpoint of a zenoh router")
                };
                let mut last = std::io::Error::other("the name has no address");
                for address in host_and_port(endpoint).to_socket_addrs().map_err(refuse)? {
                    match TcpStream::connect_timeout(&address, PROBE_TIMEOUT) {
                        Ok(_) => return Ok(()),
                        Err(error) => last = error,
                    }
                }
                Err(refuse(last))
            }
        }
    }
}

impl LinkAddress {
    /// Credentials for this link; an error message if their file or its content is invalid. An endpoint `tls/…` without a file takes
    /// the one named by the environment.
    pub fn security(&self) -> Result<Option<Security>, String> {
        let (endpoint, config, attachment) = match self {
            Self::Iceoryx2 { .. } => return Ok(None),
            Self::ZenohListen { endpoint, config } => (endpoint, config, Attachment::Listen),
            Self::ZenohConnect { endpoint, config } => (endpoint, config, Attachment::Connect),
        };
        zenoh_config::security_for(endpoint, config.as_deref(), &attachment)
    }

    /// The same with this credentials file, unless it has one or needs none.
    #[must_use]
    pub fn with_config(mut self, file: PathBuf) -> Self {
        match &mut self {
            Self::ZenohListen { config, .. } | Self::ZenohConnect { config, .. } => {
                config.get_or_insert(file);
            }
            Self::Iceoryx2 { .. } => {}
        }
        self
    }
}

/// "127.0.0.1:7447" of "tcp/127.0.0.1:7447".
fn host_and_port(endpoint: &str) -> &str {
    endpoint.split_once('/').map_or(endpoint, |(_, rest)| rest)
}

impl LinkAddress {
    /// The address for peers of the plant: they connect where it listens. `host` replaces the plant's host if the plant
    /// listens on all of its addresses.
    #[must_use]
    pub fn for_peers(&self, host: &str) -> Self {
        match self {
            Self::ZenohListen { endpoint, config } => {
                let endpoint =
                    endpoint
                        .replacen("/0.0.0.0:", &format!("/{host}:"), 1)
                        .replacen("/[::]:", &format!("/{host}:"), 1);
                Self::ZenohConnect {
                    endpoint,
                    config: config.clone(),
                }
            }
            other => other.clone(),
        }
    }
}

/// Default domain.
pub(crate) const DEFAULT_DOMAIN: &str = "default";

/// Maximum characters of a domain: it is part of a socket path, which has at most 107 bytes.
const MAX_DOMAIN: usize = 8;

/// Invalid address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the link '{given}' is not understood: {reason}; expected iceoryx2, iceoryx2:DOMAIN, zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT with an endpoint such as tcp/127.0.0.1:7447 or tls/bench:7447,config=FILE"
)]
pub struct LinkAddressError {
    given: String,
    reason: &'static str,
}

impl FromStr for LinkAddress {
    type Err = LinkAddressError;

    fn from_str(given: &str) -> Result<Self, Self::Err> {
        let refuse = |reason| {
            Err(LinkAddressError {
                given: given.to_owned(),
                reason,
            })
        };
        let endpoint = |text: &str| {
            let (text, config) = match text.split_once(",config=") {
                Some((_, "")) => return Err("config= names no file"),
                Some((text, file)) => (text, Some(PathBuf::from(file))),
                None => (text, None),
            };
            let is_endpoint = text.split_once('/').is_some_and(|(protocol, rest)| {
                (protocol == "tcp" || protocol == "tls")
                    && rest
                        .rsplit_once(':')
                        .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
            });
            if is_endpoint {
                Ok((text.to_owned(), config))
            } else {
                Err("no tcp/HOST:PORT or tls/HOST:PORT endpoint")
            }
        };
        match given.split_once(':') {
            None if given == "iceoryx2" => Ok(Self::Iceoryx2 {
                domain: DEFAULT_DOMAIN.to_owned(),
            }),
            Some(("iceoryx2", domain)) => {
                let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
                if domain.is_empty() || domain.len() > MAX_DOMAIN || !domain.chars().all(plain) {
                    return refuse("a domain has 1 to 8 letters, digits, '-' and '_'");
                }
                Ok(Self::Iceoryx2 {
                    domain: domain.to_owned(),
                })
            }
            Some(("zenoh", rest)) => match rest.split_once('=') {
                Some(("listen", text)) => match endpoint(text) {
                    Ok((endpoint, config)) => Ok(Self::ZenohListen { endpoint, config }),
                    Err(reason) => refuse(reason),
                },
                Some(("connect", text)) => match endpoint(text) {
                    Ok((endpoint, config)) => Ok(Self::ZenohConnect { endpoint, config }),
                    Err(reason) => refuse(reason),
                },
                _ => refuse("zenoh needs listen= or connect="),
            },
            _ => refuse("no such link"),
        }
    }
}

impl fmt::Display for LinkAddress {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Iceoryx2 { domain } => write!(out, "iceoryx2:{domain}"),
            Self::ZenohListen { endpoint, config } => {
                write!(out, "zenoh:listen={endpoint}")?;
                write_config(out, config)
            }
            Self::ZenohConnect { endpoint, config } => {
                write!(out, "zenoh:connect={endpoint}")?;
                write_config(out, config)
            }
        }
    }
}

fn write_config(out: &mut fmt::Formatter<'_>, config: &Option<PathBuf>) -> fmt::Result {
    match config {
        Some(file) => write!(out, ",config={}", file.display()),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_addresses_round_trip() {
        for text in [
            "iceoryx2:default",
            "iceoryx2:bench_2",
            "zenoh:listen=tcp/127.0.0.1:7447",
            "zenoh:connect=tcp/[::1]:1",
            "zenoh:connect=tls/bench:7447",
            "zenoh:listen=tls/0.0.0.0:7447,config=/etc/rotortwin/a,b.toml",
        ] {
            assert_eq!(text.parse::<LinkAddress>().expect("well formed").to_string(), text);
        }
        assert_eq!(
            "iceoryx2".parse(),
            Ok(LinkAddress::Iceoryx2 {
                domain: "default".to_owned()
            })
        );
    }

    #[test]
    fn val_an_endpoint_is_tried_before_it_is_used() {
        let taken = TcpListener::bind("127.0.0.1:0").expect("a port is free");
        let port = taken.local_addr().expect("it is bound").port();
        let probe = |text: String| text.parse::<LinkAddress>().expect("well formed").probe();
        let listen = format!("zenoh:listen=tcp/127.0.0.1:{port}");
        assert!(probe(listen.clone()).is_err_and(|sentence| sentence.contains("cannot listen")));
        assert_eq!(probe(format!("zenoh:connect=tcp/127.0.0.1:{port}")), Ok(()));
        drop(taken);
        assert_eq!(probe(listen), Ok(()));
        let sentence = probe(format!("zenoh:connect=tcp/127.0.0.1:{port}")).expect_err("nobody listens any more");
        assert!(sentence.contains("no response at tcp/127.0.0.1"), "{sentence}");
    }

    #[test]
    fn val_peers_connect_where_the_plant_listens() {
        let peers = |text: &str| {
            text.parse::<LinkAddress>()
                .expect("well formed")
                .for_peers("bench-1")
                .to_string()
        };
        assert_eq!(
            peers("zenoh:listen=tcp/10.0.0.1:7447"),
            "zenoh:connect=tcp/10.0.0.1:7447"
        );
        assert_eq!(peers("zenoh:listen=tcp/0.0.0.0:7447"), "zenoh:connect=tcp/bench-1:7447");
        assert_eq!(peers("zenoh:listen=tcp/[::]:7447"), "zenoh:connect=tcp/bench-1:7447");
        assert_eq!(
            peers("zenoh:listen=tls/0.0.0.0:7447,config=z.toml"),
            "zenoh:connect=tls/bench-1:7447,config=z.toml"
        );
        assert_eq!(peers("iceoryx2:a"), "iceoryx2:a");
    }

    #[test]
    fn val_nonsense_is_refused_with_the_reason() {
        for (text, reason) in [
            ("", "no such link"),
            ("iceoryx", "no such link"),
            ("iceoryx2:", "a domain has"),
            ("iceoryx2:a/b", "a domain has"),
            ("iceoryx2:a-domain-too-long", "a domain has"),
            ("zenoh", "no such link"),
            ("zenoh:tcp/1.2.3.4:5", "needs listen= or connect="),
            ("zenoh:listen=1.2.3.4:5", "no tcp/HOST:PORT"),
            ("zenoh:connect=tcp/host:99999", "no tcp/HOST:PORT"),
            ("zenoh:connect=udp/host:1", "no tcp/HOST:PORT"),
            ("zenoh:connect=tls/host:1,config=", "names no file"),
            ("zenoh:connect=tls/host:1,key=a", "no tcp/HOST:PORT"),
        ] {
            let error = text.parse::<LinkAddress>().expect_err(text).to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }
}
