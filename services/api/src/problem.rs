//! Error responses: each is one `application/problem+json` object (RFC 9457), including those of the framework.

use axum::extract::rejection::{BytesRejection, JsonRejection, PathRejection, QueryRejection, StringRejection};
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use rotortwin_scenario::toml_document::reword;
use serde::{Deserialize, Serialize};
use std::error::Error;
use std::io::ErrorKind;
use utoipa::ToSchema;

/// Why a request was rejected (RFC 9457).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// Kind of problem: a stable identifier for programs, such as `/problems/not-found`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Kind of problem, in words.
    pub title: String,
    /// HTTP status.
    pub status: u16,
    /// One sentence: what, where, what was expected.
    pub detail: String,
    /// All errors of a document, starting with that of `detail`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub complaints: Vec<String>,
}

impl Problem {
    fn new(status: StatusCode, kind: &str, title: &str, detail: impl Into<String>) -> Self {
        Self {
            kind: format!("/problems/{kind}"),
            title: title.to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            complaints: Vec::new(),
        }
    }

    /// Errors of the framework, by status.
    fn of_rejection(status: StatusCode, detail: String) -> Self {
        match status {
            StatusCode::PAYLOAD_TOO_LARGE => Self::too_large(detail),
            StatusCode::UNSUPPORTED_MEDIA_TYPE => Self::unsupported(detail),
            StatusCode::UNPROCESSABLE_ENTITY => Self::unprocessable(detail),
            StatusCode::METHOD_NOT_ALLOWED => Self::method_not_allowed(detail),
            StatusCode::UPGRADE_REQUIRED => Self::new(status, "upgrade-required", "Upgrade Required", detail),
            _ => Self::bad_request(detail),
        }
    }

    /// Adds all errors of a document.
    #[must_use]
    pub(crate) fn with_complaints(mut self, complaints: Vec<String>) -> Self {
        self.complaints = complaints;
        self
    }

    /// 400: the request cannot be read.
    pub fn bad_request(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "bad-request", "Bad Request", detail)
    }

    /// 401: unauthenticated.
    pub fn unauthorized(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNAUTHORIZED, "unauthorized", "Unauthenticated", detail)
    }

    /// 403: not allowed.
    pub fn forbidden(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, "forbidden", "Forbidden", detail)
    }

    /// 404.
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", "Not Found", detail)
    }

    /// 405.
    pub fn method_not_allowed(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::METHOD_NOT_ALLOWED,
            "method-not-allowed",
            "Method Not Allowed",
            detail,
        )
    }

    /// 409.
    pub fn conflict(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, "conflict", "Conflict", detail)
    }

    /// 409: another job needs it.
    pub(crate) fn in_use(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, "in-use", "In use by another job", detail)
    }

    /// 410: it existed, and will not again.
    pub(crate) fn gone(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::GONE, "gone", "Gone", detail)
    }

    /// 412: `If-Match` or `If-None-Match` does not hold.
    pub fn precondition_failed(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::PRECONDITION_FAILED,
            "precondition-failed",
            "Precondition Failed",
            detail,
        )
    }

    /// 413: larger than the server's limit.
    pub fn too_large(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "too-large", "Content Too Large", detail)
    }

    /// 416: no byte of the file is in the range.
    pub fn range_not_satisfiable(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::RANGE_NOT_SATISFIABLE,
            "range-not-satisfiable",
            "Range Not Satisfiable",
            detail,
        )
    }

    /// 414: longer than the server's limit.
    pub(crate) fn uri_too_long(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::URI_TOO_LONG, "uri-too-long", "URI Too Long", detail)
    }

    /// 415: unsupported format of the body.
    pub fn unsupported(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "unsupported-media-type",
            "Unsupported Media Type",
            detail,
        )
    }

    /// 403: request from a page of another web site.
    pub(crate) fn foreign_page(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::FORBIDDEN,
            "foreign-page",
            "Request from Another Web Site",
            detail,
        )
    }

    /// 421: wrong host name.
    pub(crate) fn misdirected(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::MISDIRECTED_REQUEST,
            "misdirected",
            "Misdirected Request",
            detail,
        )
    }

    /// 422: readable but invalid.
    pub fn unprocessable(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::UNPROCESSABLE_ENTITY,
            "unprocessable",
            "Unprocessable Content",
            detail,
        )
    }

    /// 429: limit exceeded.
    pub fn too_many(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::TOO_MANY_REQUESTS, "too-many", "Too Many Requests", detail)
    }

    /// 431: more headers, or larger ones, than the server takes.
    pub(crate) fn headers_too_large(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE,
            "headers-too-large",
            "Request Header Fields Too Large",
            detail,
        )
    }

    /// 503: the server is shutting down, or its database does not respond.
    pub fn unavailable(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::SERVICE_UNAVAILABLE,
            "unavailable",
            "Service Unavailable",
            detail,
        )
    }

    /// 501: this server lacks a required program.
    pub(crate) fn not_implemented(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::NOT_IMPLEMENTED,
            "not-implemented",
            "Not Implemented",
            detail,
        )
    }

    /// 507: the disk of the data folder is full.
    pub fn disk_full(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::INSUFFICIENT_STORAGE,
            "disk-full",
            "Insufficient Storage",
            detail,
        )
    }

    /// 507 with this message if a file cannot be written because the disk is full, otherwise 500.
    pub(crate) fn unwritten(error: &(dyn Error + 'static), full: &str) -> Self {
        if is_full(error) {
            return Self::disk_full(full);
        }
        Self::internal(error)
    }

    /// A file of a job or library cannot be read or written: 507 if the disk is full, as bucket content is copied before it is read;
    /// otherwise 500.
    pub(crate) fn of_files(error: &(dyn Error + 'static)) -> Self {
        Self::unwritten(error, "no file can be written: the disk of the data folder is full")
    }

    /// 500; the cause is logged, not sent to the client.
    pub fn internal<C: std::fmt::Display + ?Sized>(cause: &C) -> Self {
        tracing::error!(%cause, "a request failed");
        Self::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "internal",
            "Internal Server Error",
            "internal error; see the log of the server",
        )
    }
}

/// Whether this error or one of its sources is a full disk or quota.
fn is_full(error: &(dyn Error + 'static)) -> bool {
    let mut next = Some(error);
    while let Some(error) = next {
        let io = error.downcast_ref::<std::io::Error>();
        if io.is_some_and(|io| matches!(io.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)) {
            return true;
        }
        // An I/O error reports the source of the wrapped error as its own, and so hides the wrapped one.
        next = match io.and_then(std::io::Error::get_ref) {
            Some(wrapped) => Some(wrapped),
            None => error.source(),
        };
    }
    false
}

/// Retry delay when the server or its database is temporarily unavailable, s.
const RETRY_S: u64 = 2;

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_string(&self).unwrap_or_default();
        let mut response = (status, [(header::CONTENT_TYPE, "application/problem+json")], body).into_response();
        if status == StatusCode::SERVICE_UNAVAILABLE {
            response.headers_mut().insert(header::RETRY_AFTER, RETRY_S.into());
        }
        response
    }
}

impl From<JsonRejection> for Problem {
    fn from(rejection: JsonRejection) -> Self {
        Self::of_rejection(rejection.status(), of_json(&rejection.body_text()))
    }
}

/// What is wrong with a body, from axum's text.
fn of_json(text: &str) -> String {
    const NO_JSON: &str = "Failed to parse the request body as JSON: ";
    const OTHER_TYPE: &str = "Failed to deserialize the JSON body into the target type: ";
    match (text.strip_prefix(OTHER_TYPE), text.strip_prefix(NO_JSON)) {
        (Some(rest), _) => of_serde("the body", rest),
        (None, Some(reason)) => format!("the body is not JSON: {reason}"),
        (None, None) => text.to_owned(),
    }
}

/// What is wrong in `what`, from `key[0].key: MESSAGE at line 1 column 9`, where key and place may be missing.
fn of_serde(what: &str, text: &str) -> String {
    /// Beginnings of serde's messages.
    const KINDS: [&str; 6] = [
        "invalid type: ",
        "invalid value: ",
        "invalid length ",
        "unknown field ",
        "unknown variant ",
        "missing field ",
    ];
    let Some(begin) = KINDS.iter().filter_map(|kind| text.find(kind)).min() else {
        return format!("{what}: {text}");
    };
    let (key, message) = text.split_at(begin);
    let key = key.trim_end_matches(": ");
    let (message, place) = match message.rsplit_once(" at line ") {
        Some((message, place)) => (message, format!(" (line {place})")),
        None => (message, String::new()),
    };
    let (named, reason) = reword(message);
    let key = Some(key).filter(|key| !key.is_empty() && *key != ".");
    // The path to a key that is unknown ends with it; that to a missing one leads to what it is missing in.
    let named = named.filter(|_| key.is_none() || !message.starts_with("unknown field"));
    let keys: Vec<&str> = [key, named].into_iter().flatten().collect();
    match keys.as_slice() {
        [] => format!("{what}: {reason}{place}"),
        keys => format!("{what}, `{}`: {reason}{place}", keys.join(".")),
    }
}

impl From<PathRejection> for Problem {
    fn from(rejection: PathRejection) -> Self {
        Self::bad_request(rejection.body_text())
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        let text = rejection.body_text();
        let rest = text.strip_prefix("Failed to deserialize query string: ");
        Self::bad_request(rest.map_or_else(|| text.clone(), |rest| of_serde("the query", rest)))
    }
}

impl From<BytesRejection> for Problem {
    fn from(rejection: BytesRejection) -> Self {
        Self::of_rejection(rejection.status(), rejection.body_text())
    }
}

impl From<StringRejection> for Problem {
    fn from(rejection: StringRejection) -> Self {
        Self::of_rejection(rejection.status(), rejection.body_text())
    }
}

impl From<WebSocketUpgradeRejection> for Problem {
    fn from(rejection: WebSocketUpgradeRejection) -> Self {
        let detail = format!("{}; expected a WebSocket", rejection.body_text());
        Self::of_rejection(rejection.status(), detail)
    }
}

/// Postgres: a text that it cannot hold. All that comes this far is UTF-8, which leaves the zero character.
const NO_TEXT: &str = "22021";

impl From<sqlx::Error> for Problem {
    fn from(error: sqlx::Error) -> Self {
        let text = error.to_string();
        if text.contains("disk is full") {
            return Self::disk_full("the database cannot grow: the disk of the data folder is full");
        }
        if error
            .as_database_error()
            .and_then(sqlx::error::DatabaseError::code)
            .as_deref()
            == Some(NO_TEXT)
        {
            return Self::bad_request("a text of the request has a zero character; expected none");
        }
        if text.contains("database is locked") {
            return Self::unavailable("the database is busy; retry later");
        }
        if is_away(&error) {
            tracing::warn!(%error, "the database is away");
            return Self::unavailable("the database does not respond; retry later");
        }
        Self::internal(&error)
    }
}

/// Whether a retry may succeed: the database is starting or stopping, unreachable, out of connections, or a possibly dead client holds a
/// row lock.
fn is_away(error: &sqlx::Error) -> bool {
    /// Postgres: shut down, crashed, starting; out of connections; a transaction or statement that took too long; a locked row;
    /// conflicting transactions.
    const PASSING: &[&str] = &[
        "57P01", "57P02", "57P03", "57P05", "53300", "25P03", "57014", "55P03", "40001", "40P01",
    ];
    match error {
        sqlx::Error::Io(_) | sqlx::Error::PoolTimedOut | sqlx::Error::PoolClosed | sqlx::Error::WorkerCrashed => true,
        sqlx::Error::Database(error) => error
            .code()
            .is_some_and(|code| PASSING.contains(&code.as_ref()) || code.starts_with("08")),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};
    use std::io;

    /// Every kind of problem: how it is made, its status, its type.
    fn all() -> Vec<(Problem, u16, &'static str)> {
        let rejection = |status| Problem::of_rejection(status, "why".to_owned());
        let full = io::Error::from(ErrorKind::StorageFull);
        vec![
            (Problem::bad_request("why"), 400, "bad-request"),
            (Problem::unauthorized("why"), 401, "unauthorized"),
            (Problem::forbidden("why"), 403, "forbidden"),
            (Problem::foreign_page("why"), 403, "foreign-page"),
            (Problem::not_found("why"), 404, "not-found"),
            (Problem::method_not_allowed("why"), 405, "method-not-allowed"),
            (Problem::conflict("why"), 409, "conflict"),
            (Problem::in_use("why"), 409, "in-use"),
            (Problem::gone("why"), 410, "gone"),
            (Problem::precondition_failed("why"), 412, "precondition-failed"),
            (Problem::too_large("why"), 413, "too-large"),
            (Problem::uri_too_long("why"), 414, "uri-too-long"),
            (Problem::unsupported("why"), 415, "unsupported-media-type"),
            (Problem::range_not_satisfiable("why"), 416, "range-not-satisfiable"),
            (Problem::misdirected("why"), 421, "misdirected"),
            (Problem::unprocessable("why"), 422, "unprocessable"),
            (rejection(StatusCode::UPGRADE_REQUIRED), 426, "upgrade-required"),
            (Problem::too_many("why"), 429, "too-many"),
            (Problem::headers_too_large("why"), 431, "headers-too-large"),
            (Problem::internal("why"), 500, "internal"),
            (Problem::not_implemented("why"), 501, "not-implemented"),
            (Problem::unavailable("why"), 503, "unavailable"),
            (Problem::disk_full("why"), 507, "disk-full"),
            // Those that choose one of the others.
            (rejection(StatusCode::PAYLOAD_TOO_LARGE), 413, "too-large"),
            (
                rejection(StatusCode::UNSUPPORTED_MEDIA_TYPE),
                415,
                "unsupported-media-type",
            ),
            (rejection(StatusCode::UNPROCESSABLE_ENTITY), 422, "unprocessable"),
            (rejection(StatusCode::METHOD_NOT_ALLOWED), 405, "method-not-allowed"),
            (rejection(StatusCode::BAD_REQUEST), 400, "bad-request"),
            (rejection(StatusCode::IM_A_TEAPOT), 400, "bad-request"),
            (Problem::of_files(&full), 507, "disk-full"),
            (
                Problem::of_files(&io::Error::from(ErrorKind::NotFound)),
                500,
                "internal",
            ),
            (Problem::from(sqlx::Error::PoolTimedOut), 503, "unavailable"),
            (Problem::from(sqlx::Error::RowNotFound), 500, "internal"),
        ]
    }

    #[test]
    fn val_the_type_of_a_problem_says_what_its_status_says() {
        let mut status_of = BTreeMap::new();
        for (problem, status, kind) in all() {
            assert_eq!(
                (problem.status, problem.kind.as_str()),
                (status, &*format!("/problems/{kind}"))
            );
            assert_eq!(
                *status_of.entry(kind).or_insert(status),
                status,
                "{kind}: one status for a type"
            );
            let response = problem.clone().into_response();
            assert_eq!(response.status().as_u16(), status, "{kind}");
            assert_eq!(
                response.headers()[header::CONTENT_TYPE],
                "application/problem+json",
                "{kind}"
            );
            let is_asked_to_wait = response.headers().contains_key(header::RETRY_AFTER);
            assert_eq!(is_asked_to_wait, status == 503, "{kind}");
        }
        // None is forgotten: each call of `new` above names its type.
        let source = include_str!("problem.rs")
            .split("#[cfg(test)]")
            .next()
            .unwrap_or_default();
        let calls = source.split("Self::new(").skip(1);
        let named: BTreeSet<&str> = calls.filter_map(|call| call.split('"').nth(1)).collect();
        assert_eq!(named, status_of.into_keys().collect::<BTreeSet<_>>());
    }

    #[test]
    fn val_refusals_of_a_body_name_no_type_of_rust() {
        let of = |rest: &str| {
            of_json(&format!(
                "Failed to deserialize the JSON body into the target type: {rest}"
            ))
        };
        for (said, expected) in [
            (
                "seed: invalid type: string \"x\", expected u64 at line 1 column 20",
                "the body, `seed`: expected a whole number, 0 or more, got string \"x\" (line 1 column 20)",
            ),
            (
                "unknown field `sede`, expected `seed` or `link` at line 1 column 7",
                "the body, `sede`: unknown key, expected one of seed, link (line 1 column 7)",
            ),
            (
                "missing field `flights` at line 1 column 2",
                "the body, `flights`: missing key (line 1 column 2)",
            ),
            (
                "invalid type: null, expected struct RunSubmission at line 1 column 4",
                "the body: expected names with values, got null (line 1 column 4)",
            ),
            (
                "flights.log: unknown field `log`, expected `logs` or `runs` at line 1 column 30",
                "the body, `flights.log`: unknown key, expected one of logs, runs (line 1 column 30)",
            ),
            (
                "model: missing field `vehicle` at line 1 column 30",
                "the body, `model.vehicle`: missing key (line 1 column 30)",
            ),
            ("anything else", "the body: anything else"),
        ] {
            assert_eq!(of(said), expected);
        }
        assert_eq!(
            of_json("Failed to parse the request body as JSON: EOF while parsing at line 1 column 2"),
            "the body is not JSON: EOF while parsing at line 1 column 2"
        );
    }
}
