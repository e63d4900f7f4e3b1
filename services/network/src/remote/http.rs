//! Requests with retries: if the server is unreachable or answers "not now", they are repeated with increasing pauses.

use super::HERE;
use reqwest::header::{AUTHORIZATION, CONTENT_TYPE, HeaderValue, RETRY_AFTER};
use reqwest::{Certificate, Method, Response, StatusCode};
use rotortwin_cli::network::remote::ServerArgs;
use serde::Serialize;
use serde_json::Value;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::time::Instant;

/// How long a server that was reached before is retried.
const RETRY_TIMEOUT: Duration = Duration::from_secs(60);
/// How long one that was never reached is retried: most likely the address is wrong.
const FIRST_CONTACT_TIMEOUT: Duration = Duration::from_secs(3);
/// Time-out for a plain request.
const ANSWER: Duration = Duration::from_secs(30);
/// Upper bound of the retry delay that the server requests.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// Why it failed, one sentence.
#[derive(Debug)]
pub(crate) enum RemoteError {
    /// Exit code 2: the request was wrong, and nothing was done.
    BadInput(String),
    /// Exit code 1.
    Failed(String),
}

/// Pauses between attempts: 0.1 s, doubling up to 5 s, until a total time has passed.
#[derive(Debug)]
pub(crate) struct Patience {
    began: Instant,
    tries: u32,
}

impl Patience {
    pub(crate) fn new() -> Self {
        Self {
            began: Instant::now(),
            tries: 0,
        }
    }

    /// The next pause, `None` if it would end later than `limit` after the start; `asked`: the server's retry delay.
    fn next(&mut self, limit: Duration, asked: Option<Duration>) -> Option<Duration> {
        let own = Duration::from_millis(100 << self.tries.min(10)).min(Duration::from_secs(5));
        // Randomized, so that many clients of a restarted server do not all come back together.
        let own = own.mul_f64(rand::random_range(0.5..1.0));
        self.tries += 1;
        let pause = asked.map_or(own, |asked| asked.clamp(own, LONGEST_PAUSE));
        (self.began.elapsed() + pause <= limit).then_some(pause)
    }
}

/// Body of a request; cheap to clone, as it may be sent several times.
#[derive(Debug, Clone)]
enum Body {
    Json(Value),
    Bytes(Arc<Vec<u8>>),
}

/// A request.
#[derive(Debug, Clone)]
pub(crate) struct Ask {
    method: Method,
    path: String,
    body: Option<Body>,
    headers: Vec<(&'static str, String)>,
    limit: Duration,
    /// A refusal that, on a retry, means that the first attempt succeeded although its answer was lost.
    done_before: Option<StatusCode>,
}

impl Ask {
    pub(crate) fn get(path: impl Into<String>) -> Self {
        Self::new(Method::GET, path)
    }

    pub(crate) fn post(path: impl Into<String>) -> Self {
        Self::new(Method::POST, path)
    }

    pub(crate) fn delete(path: impl Into<String>) -> Self {
        let mut ask = Self::new(Method::DELETE, path);
        ask.done_before = Some(StatusCode::NOT_FOUND);
        ask
    }

    /// Cancels: 409 on a retry means that it has ended meanwhile.
    pub(crate) fn cancel(path: impl Into<String>) -> Self {
        let mut ask = Self::post(path);
        ask.done_before = Some(StatusCode::CONFLICT);
        ask
    }

    fn new(method: Method, path: impl Into<String>) -> Self {
        Self {
            method,
            path: path.into(),
            body: None,
            headers: Vec::new(),
            limit: ANSWER,
            done_before: None,
        }
    }

    /// A body that is one of [`rotortwin_jobs::submission`], so that a server of this version can read it.
    ///
    /// # Errors
    /// It cannot be written as JSON.
    pub(crate) fn json(mut self, body: &impl Serialize) -> Result<Self, RemoteError> {
        let body = serde_json::to_value(body)
            .map_err(|error| RemoteError::Failed(format!("the request cannot be written: {error}")))?;
        self.body = Some(Body::Json(body));
        Ok(self)
    }

    /// A file.
    pub(crate) fn bytes(mut self, body: Vec<u8>) -> Self {
        self.body = Some(Body::Bytes(Arc::new(body)));
        self
    }

    pub(crate) fn header(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.headers.push((name, value.into()));
        self
    }

    /// An idempotency key: only one job can be created with it, however often this is retried.
    pub(crate) fn once(self) -> Self {
        let key = format!("{:032x}", rand::random::<u128>());
        self.header("idempotency-key", key)
    }

    pub(crate) fn limit(mut self, limit: Duration) -> Self {
        self.limit = limit;
        self
    }
}

/// A server.
#[derive(Debug)]
pub(crate) struct Remote {
    http: reqwest::Client,
    url: String,
    token: Option<HeaderValue>,
    /// It has answered.
    reached: AtomicBool,
}

impl Remote {
    pub(crate) fn open(args: &ServerArgs) -> Result<Self, RemoteError> {
        let url = args.server.as_deref().unwrap_or(HERE).trim_end_matches('/').to_owned();
        let is_url =
            reqwest::Url::parse(&url).is_ok_and(|url| matches!(url.scheme(), "http" | "https") && url.has_host());
        if !is_url {
            return Err(RemoteError::BadInput(format!(
                "--server {url}: expected an address such as {HERE}"
            )));
        }
        // Another part of this program may have installed one already.
        if rustls::crypto::ring::default_provider().install_default().is_err() {
            tracing::debug!("TLS was set up before");
        }
        let mut http = reqwest::Client::builder().connect_timeout(Duration::from_secs(10));
        if let Some(path) = &args.ca {
            let bad = |words: String| RemoteError::BadInput(format!("--ca {}: {words}", path.display()));
            let pem = std::fs::read(path).map_err(|error| bad(format!("cannot be read: {error}")))?;
            let certificates = Certificate::from_pem_bundle(&pem)
                .ok()
                .filter(|certificates| !certificates.is_empty())
                .ok_or_else(|| bad("expected a certificate in PEM".to_owned()))?;
            http = http.tls_certs_only(certificates);
        } else if url.starts_with("http://") {
            // No certificates are needed, and a machine without any can still connect.
            http = http.tls_certs_only([]);
        }
        Ok(Self {
            http: http
                .build()
                .map_err(|error| RemoteError::Failed(format!("TLS cannot be set up: {}", causes(&error))))?,
            url,
            token: token(args)?,
            reached: AtomicBool::new(false),
        })
    }

    /// Its address.
    pub(crate) fn url(&self) -> &str {
        &self.url
    }

    /// One attempt, without retries: an answer of any status.
    pub(crate) async fn once(&self, ask: &Ask) -> Result<Response, String> {
        let mut request = self
            .http
            .request(ask.method.clone(), format!("{}{}", self.url, ask.path));
        if let Some(token) = &self.token {
            request = request.header(AUTHORIZATION, token);
        }
        for (name, value) in &ask.headers {
            request = request.header(*name, value);
        }
        request = match &ask.body {
            Some(Body::Json(body)) => request.json(body),
            Some(Body::Bytes(bytes)) => request
                .header(CONTENT_TYPE, "application/octet-stream")
                .body(bytes.as_ref().clone()),
            None => request,
        };
        match tokio::time::timeout(ask.limit, request.send()).await {
            Ok(answer) => {
                self.reached.fetch_or(answer.is_ok(), Ordering::Relaxed);
                answer.map_err(|error| causes(&error))
            }
            Err(_) => Err(format!("no answer within {} s", ask.limit.as_secs())),
        }
    }

    /// A successful answer.
    pub(crate) async fn call(&self, ask: &Ask) -> Result<Response, RemoteError> {
        let mut patience = Patience::new();
        loop {
            let pause = match self.once(ask).await {
                Ok(answer) if answer.status().is_success() => return Ok(answer),
                Ok(answer) if patience.tries > 0 && ask.done_before == Some(answer.status()) => return Ok(answer),
                Ok(answer) => self.pause_or_refusal(answer, &mut patience).await?,
                Err(words) => self.pause_or_loss(&words, &mut patience)?,
            };
            tokio::time::sleep(pause).await;
        }
    }

    /// The pause after an unsuccessful answer; permanent errors are returned.
    pub(crate) async fn pause_or_refusal(
        &self,
        answer: Response,
        patience: &mut Patience,
    ) -> Result<Duration, RemoteError> {
        let again = matches!(answer.status().as_u16(), 429 | 502 | 503 | 504);
        let asked = answer
            .headers()
            .get(RETRY_AFTER)
            .and_then(|value| value.to_str().ok()?.parse().ok())
            .map(Duration::from_secs);
        match patience.next(RETRY_TIMEOUT, asked).filter(|_| again) {
            Some(pause) => Ok(pause),
            None => Err(refusal(answer).await),
        }
    }

    /// The pause after a connection that failed or broke.
    pub(crate) fn pause_or_loss(&self, words: &str, patience: &mut Patience) -> Result<Duration, RemoteError> {
        // An untrusted certificate, or none: a retry does not help.
        let hopeless = words.contains("certificate") || words.contains("InvalidContentType");
        let limit = if self.reached.load(Ordering::Relaxed) {
            RETRY_TIMEOUT
        } else {
            FIRST_CONTACT_TIMEOUT
        };
        patience.next(limit, None).filter(|_| !hopeless).ok_or_else(|| {
            RemoteError::Failed(format!(
                "{} cannot be reached: {words}; expected a rotortwin server there",
                self.url
            ))
        })
    }

    /// An answer as JSON.
    pub(crate) async fn json(&self, ask: &Ask) -> Result<Value, RemoteError> {
        let mut patience = Patience::new();
        loop {
            match self.call(ask).await?.json().await {
                Ok(value) => return Ok(value),
                Err(error) if error.is_decode() => {
                    return Err(RemoteError::Failed(format!(
                        "{}{} does not return JSON; expected a rotortwin server there",
                        self.url, ask.path
                    )));
                }
                Err(error) => {
                    let pause = self.pause_or_loss(&causes(&error), &mut patience)?;
                    tokio::time::sleep(pause).await;
                }
            }
        }
    }
}

/// The message of a refusal.
async fn refusal(answer: Response) -> RemoteError {
    let (status, url) = (answer.status(), answer.url().clone());
    let text = answer.text().await.unwrap_or_default();
    let detail = serde_json::from_str::<Value>(&text)
        .ok()
        .and_then(|problem| problem["detail"].as_str().map(str::to_owned));
    let sentence =
        detail.unwrap_or_else(|| format!("{url} was answered with {status}; expected a rotortwin server there"));
    if status.is_client_error() {
        RemoteError::BadInput(sentence)
    } else {
        RemoteError::Failed(sentence)
    }
}

fn token(args: &ServerArgs) -> Result<Option<HeaderValue>, RemoteError> {
    let (name, text) = match &args.token_file {
        Some(path) => {
            let name = format!("--token-file {}", path.display());
            let text = std::fs::read_to_string(path)
                .map_err(|error| RemoteError::BadInput(format!("{name}: cannot be read: {error}")))?;
            (name, text)
        }
        None => match std::env::var("ROTORTWIN_TOKEN") {
            Ok(text) if !text.trim().is_empty() => ("ROTORTWIN_TOKEN".to_owned(), text),
            _ => return Ok(None),
        },
    };
    let mut value = HeaderValue::from_str(&format!("Bearer {}", text.trim()))
        .ok()
        .filter(|_| !text.trim().is_empty())
        .ok_or_else(|| RemoteError::BadInput(format!("{name}: expected a token, one line of ASCII")))?;
    value.set_sensitive(true);
    Ok(Some(value))
}

/// An error with its causes: the outer message alone says little.
pub(crate) fn causes(error: &reqwest::Error) -> String {
    let mut words = Vec::new();
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        words.push(error.to_string());
        cause = error.source();
    }
    words.dedup();
    words.pop().unwrap_or_else(|| error.to_string())
}
