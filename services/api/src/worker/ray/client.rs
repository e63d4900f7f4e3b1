//! The part of Ray's job submission API used here (`/api/version`, `/api/jobs/…` of its dashboard; checked in Ray 2.60).
//!
//! Undocumented behaviour: a submission with an existing id is answered with 500, whose text says "already exists"; rejections of its agent
//! are a 500 as well, with the status 400 in the text.

use super::config::RayConfig;
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::{Method, StatusCode};
use serde::Deserialize;
use serde_json::{Value, json};
use std::error::Error;
use std::time::Duration;

/// Timeout of any response; Ray itself waits for its agents up to 10 s.
const ANSWER: Duration = Duration::from_secs(12);
/// Timeout of a connection.
const CONNECT: Duration = Duration::from_secs(5);
/// Maximum size of a response, bytes; messages contain at most 20,000 characters of a log.
const LONGEST: usize = 1 << 20;

/// Why Ray did not execute a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum RayError {
    /// Unreachable, internal error, or token rejected: a retry may succeed.
    Away(String),
    /// Rejected.
    Refused(String),
}

/// Status of a submission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum RayStatus {
    Pending,
    Running,
    Stopped,
    Succeeded,
    Failed,
}

/// A submission.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(super) struct RayJob {
    pub(super) status: RayStatus,
    #[serde(default)]
    pub(super) message: Option<String>,
    #[serde(default)]
    pub(super) error_type: Option<String>,
    #[serde(default)]
    pub(super) driver_exit_code: Option<i32>,
    /// Agent of the node on which it runs: `http://10.0.0.3:52365`.
    #[serde(default)]
    pub(super) driver_agent_http_address: Option<String>,
}

impl RayJob {
    /// Address of its node.
    pub(super) fn node(&self) -> &str {
        let address = self.driver_agent_http_address.as_deref().unwrap_or_default();
        let host = address.trim_start_matches("http://").rsplit_once(':');
        host.map_or("that it has not named", |(host, _)| host)
    }
}

/// A cluster, over HTTP.
#[derive(Debug, Clone)]
pub(super) struct Client {
    http: reqwest::Client,
    url: String,
}

impl Client {
    /// # Errors
    /// The configuration is invalid.
    pub(super) fn new(config: &RayConfig) -> Result<Self, String> {
        let bad = |why: String| format!("--executor ray={}: {why}", config.url);
        let is_url = reqwest::Url::parse(&config.url)
            .is_ok_and(|url| matches!(url.scheme(), "http" | "https") && url.has_host());
        if !is_url {
            return Err(bad(
                "expected the address of Ray's dashboard, such as http://HEAD:8265".to_owned()
            ));
        }
        let mut headers = HeaderMap::new();
        if let Some(token) = &config.token {
            let mut value = HeaderValue::from_str(&format!("Bearer {token}"))
                .map_err(|error| bad(format!("ROTORTWIN_RAY_TOKEN: no token: {error}")))?;
            value.set_sensitive(true);
            headers.insert(AUTHORIZATION, value);
        }
        let mut http = reqwest::Client::builder()
            .connect_timeout(CONNECT)
            .timeout(ANSWER)
            .redirect(reqwest::redirect::Policy::none())
            .no_proxy()
            .default_headers(headers);
        if config.url.starts_with("http://") {
            // No certificates are needed, and this also works on a machine without any.
            http = http.tls_certs_only([]);
        }
        Ok(Self {
            http: http.build().map_err(|error| bad(causes(&error)))?,
            url: config.url.clone(),
        })
    }

    async fn ask(&self, method: Method, path: &str, body: Option<&Value>) -> Result<(StatusCode, String), RayError> {
        let mut request = self.http.request(method, format!("{}{path}", self.url));
        if let Some(body) = body {
            request = request.json(body);
        }
        let away = |error: reqwest::Error| {
            RayError::Away(if error.is_timeout() {
                format!("no answer within {} s", ANSWER.as_secs())
            } else {
                causes(&error)
            })
        };
        let mut answer = request.send().await.map_err(away)?;
        let status = answer.status();
        let mut bytes = Vec::new();
        while let Some(piece) = answer.chunk().await.map_err(away)? {
            bytes.extend_from_slice(&piece);
            if bytes.len() > LONGEST {
                return Err(RayError::Refused(format!("its response has more than {LONGEST} bytes")));
            }
        }
        Ok((status, String::from_utf8_lossy(&bytes).into_owned()))
    }

    /// Version of the cluster.
    pub(super) async fn version(&self) -> Result<String, RayError> {
        let (status, text) = self.ask(Method::GET, "/api/version", None).await?;
        let answer: Value = serde_json::from_str(&text).unwrap_or_default();
        match (status, answer["ray_version"].as_str()) {
            (StatusCode::OK, Some(version)) => Ok(version.to_owned()),
            (StatusCode::OK | StatusCode::NOT_FOUND | StatusCode::METHOD_NOT_ALLOWED, _) => Err(RayError::Refused(
                "the responder is not the dashboard of a Ray cluster; expected an address such as http://HEAD:8265"
                    .to_owned(),
            )),
            // Waiting does not help here; this is called when a server starts.
            (StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN, _) => Err(RayError::Refused(format!(
                "{}; expected a token of this cluster in ROTORTWIN_RAY_TOKEN",
                told(status, &text)
            ))),
            _ => Err(unexpected(status, &text)),
        }
    }

    /// Status of a submission; `None`: unknown id.
    pub(super) async fn job(&self, id: &str) -> Result<Option<RayJob>, RayError> {
        let (status, text) = self.ask(Method::GET, &format!("/api/jobs/{id}"), None).await?;
        match status {
            StatusCode::OK => serde_json::from_str(&text)
                .map(Some)
                .map_err(|error| RayError::Refused(format!("its response about {id} cannot be read: {error}"))),
            StatusCode::NOT_FOUND => Ok(None),
            _ => Err(unexpected(status, &text)),
        }
    }

    /// Submits; an existing submission counts as success.
    pub(super) async fn submit(
        &self,
        config: &RayConfig,
        id: &str,
        entrypoint: &str,
        variables: &Value,
    ) -> Result<(), RayError> {
        let mut body = json!({
            "submission_id": id, "entrypoint": entrypoint, "runtime_env": { "env_vars": variables },
            "entrypoint_num_cpus": config.cpus, "metadata": { "program": "rotortwin" },
        });
        if let Some(memory) = config.memory {
            body["entrypoint_memory"] = memory.into();
        }
        if !config.resources.is_empty() {
            body["entrypoint_resources"] = json!(config.resources);
        }
        let (status, text) = self.ask(Method::POST, "/api/jobs/", Some(&body)).await?;
        if status == StatusCode::OK || text.contains("already exists") {
            return Ok(());
        }
        Err(unexpected(status, &text))
    }

    /// Stops a submission; an unknown or ended one counts as success.
    pub(super) async fn stop(&self, id: &str) -> Result<(), RayError> {
        let (status, text) = self.ask(Method::POST, &format!("/api/jobs/{id}/stop"), None).await?;
        match status {
            StatusCode::OK | StatusCode::NOT_FOUND => Ok(()),
            _ => Err(unexpected(status, &text)),
        }
    }
}

/// Short form of a response.
fn told(status: StatusCode, text: &str) -> String {
    // The last line of a traceback is the message.
    let why: String = text
        .lines()
        .rev()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("nothing")
        .chars()
        .take(300)
        .collect();
    format!("it answered {} ({why})", status.as_u16())
}

fn unexpected(status: StatusCode, text: &str) -> RayError {
    let told = told(status, text);
    let token = matches!(status, StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN);
    if token || status.is_server_error() && !text.contains("status code 400") {
        RayError::Away(told)
    } else {
        RayError::Refused(told)
    }
}

/// An error with its sources.
fn causes(error: &dyn Error) -> String {
    let (mut words, mut next) = (error.to_string(), error.source());
    while let Some(cause) = next {
        words += &format!(": {cause}");
        next = cause.source();
    }
    words
}
