//! Prevents foreign web pages from using a server through the browser of an authorised user.
//!
//! A browser sends requests for every page that it shows, from the network position of its user. A server that listens to loopback and
//! needs no token would obey any page. So the following is checked first:
//!
//! | Check | Against | Answer |
//! |---|---|---|
//! | `Host` is a name of this server ([`HostNames`]) | a page whose own name was pointed at this host (DNS rebinding) | 421 |
//! | `Origin` and `Sec-Fetch-Site` of writes and WebSockets | requests of other pages | 403 |
//! | a body has a content type that no form can send | posts without a preflight | 415 |
//!
//! In addition, every response forbids what our own pages do not need: foreign scripts, framing, content type sniffing. Programs other
//! than browsers send no `Origin` and are not affected.

use crate::App;
use crate::problem::Problem;
use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

/// For our own pages: scripts, data and images of this server, images drawn by our scripts, and inline styles, which Swagger UI and our
/// page's templates need.
const PAGES: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self'; \
     connect-src 'self'; worker-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
);

/// For files of jobs. A report contains its scripts and data, possibly including names from a third-party log. It runs in an opaque
/// origin, without this server's, and can access nothing.
pub(crate) const FILES: HeaderValue = HeaderValue::from_static(
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; \
     font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
);

/// Content types that a form or a script of another page can send without a preflight.
const OF_FORMS: &[&str] = &["application/x-www-form-urlencoded", "multipart/form-data", "text/plain"];

/// Accepted host names of this server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum HostNames {
    /// Any: it listens to other hosts, where every request needs a token that browsers do not send automatically.
    Any,
    /// This host, and these names.
    Only(Vec<String>),
}

impl HostNames {
    /// For a server with this listening address, with additional names from its operator.
    ///
    /// # Errors
    /// A name is invalid.
    pub(crate) fn new(listen: SocketAddr, more: &[String]) -> Result<Self, String> {
        if more.is_empty() && !listen.ip().is_loopback() {
            return Ok(Self::Any);
        }
        let names = more.iter().map(|name| {
            let authority: Authority = name
                .parse()
                .ok()
                .filter(|_| !name.contains('@'))
                .ok_or_else(|| refused(name))?;
            if authority.port().is_some() || authority.host().is_empty() {
                return Err(refused(name));
            }
            Ok(plain(authority.host()))
        });
        Ok(Self::Only(names.collect::<Result<_, String>>()?))
    }

    fn includes(&self, host: &str) -> bool {
        match self {
            Self::Any => true,
            Self::Only(names) => {
                let host = plain(host);
                let address = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
                host == "localhost"
                    || host.ends_with(".localhost")
                    || address.is_ok_and(|address| address.is_loopback())
                    || names.contains(&host)
            }
        }
    }
}

fn refused(name: &str) -> String {
    format!("--allow-host {name}: expected a host name without a port, such as bench.example")
}

/// Normalises to lower case, without the trailing dot.
fn plain(host: &str) -> String {
    host.trim_end_matches('.').to_ascii_lowercase()
}

/// Rejects requests from foreign pages.
pub(crate) async fn guard(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let checked = check(&app.hosts, &app.config.cors_origins, &request);
    match checked {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// Adds security headers to every response.
pub(crate) async fn mark(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(PAGES);
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "same-origin"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

fn check(names: &HostNames, origins: &[String], request: &Request) -> Result<(), Problem> {
    // Probes address a container by IP, and get no information.
    if matches!(request.uri().path(), "/healthz" | "/readyz") && request.method() == Method::GET {
        return Ok(());
    }
    let host = host(request)?;
    if let Some(host) = host.as_ref().filter(|host| !names.includes(host.host())) {
        return Err(Problem::misdirected(format!(
            "'{}' is not a name of this server; expected localhost, or a name given with `--allow-host`",
            host.host()
        )));
    }
    let headers = request.headers();
    let reads = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if reads && !headers.contains_key(header::UPGRADE) {
        return Ok(());
    }
    check_origin(host.as_ref(), origins, headers)?;
    check_content_type(headers)
}

/// The host name in the request; `None`: HTTP/1.0 without one, which no browser sends.
fn host(request: &Request) -> Result<Option<Authority>, Problem> {
    let unreadable = || Problem::bad_request("expected one header `Host` with the name of this server");
    // An absolute URI in the request line takes precedence over the header (RFC 9112, 3.2.2).
    if let Some(authority) = request.uri().authority() {
        return Ok(Some(authority.clone()));
    }
    let mut hosts = request.headers().get_all(header::HOST).iter();
    match (hosts.next(), hosts.next()) {
        (None, _) if request.version() <= Version::HTTP_10 => Ok(None),
        (Some(host), None) => {
            let authority = host.to_str().ok().and_then(|text| text.parse().ok());
            authority.map(Some).ok_or_else(unreadable)
        }
        _ => Err(unreadable()),
    }
}

fn check_origin(host: Option<&Authority>, origins: &[String], headers: &HeaderMap) -> Result<(), Problem> {
    let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or("(unreadable)"));
    let origin = text("origin");
    if origin.is_some_and(|origin| origins.iter().any(|allowed| allowed == origin)) {
        return Ok(());
    }
    let foreign = |whose: &str| {
        Err(Problem::foreign_page(format!(
            "the request comes from {whose}; expected this server's own pages, a program, or an origin that `--cors-origin` names"
        )))
    };
    if let Some(origin) = origin {
        let authority = origin.split_once("://").map(|(_, authority)| authority);
        let own = host
            .zip(authority)
            .is_some_and(|(host, authority)| host.as_str().eq_ignore_ascii_case(authority));
        if !own {
            return foreign(&format!("a page of {origin}"));
        }
    }
    match text("sec-fetch-site") {
        None | Some("same-origin" | "none") => Ok(()),
        Some(_) => foreign("a page of another site"),
    }
}

fn check_content_type(headers: &HeaderMap) -> Result<(), Problem> {
    let empty = headers
        .get(header::CONTENT_LENGTH)
        .map_or(!headers.contains_key(header::TRANSFER_ENCODING), |length| length == "0");
    if empty {
        return Ok(());
    }
    let kind = headers
        .get(header::CONTENT_TYPE)
        .map(|value| value.to_str().unwrap_or_default());
    let essence = kind.map(|kind| kind.split(';').next().unwrap_or_default().trim().to_ascii_lowercase());
    match essence.as_deref() {
        Some(essence) if !essence.is_empty() && !OF_FORMS.contains(&essence) => Ok(()),
        _ => Err(Problem::unsupported(format!(
            "unsupported content type {}; expected one that describes the body, such as application/json, application/toml or \
             application/octet-stream",
            essence
                .filter(|essence| !essence.is_empty())
                .as_deref()
                .unwrap_or("nothing in particular")
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    fn status(names: &HostNames, method: &str, headers: &[(&str, &str)]) -> u16 {
        let mut request = Request::builder().method(method).uri("/api/v1/runs");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(Body::empty()).expect("a request");
        let origins = ["https://bench.example".to_owned()];
        check(names, &origins, &request).map_or_else(|problem| problem.status, |()| 200)
    }

    #[test]
    fn val_names_of_the_server() {
        let loopback: SocketAddr = "127.0.0.1:8400".parse().expect("an address");
        let here = HostNames::new(loopback, &["Bench.Example".to_owned()]).expect("names");
        for host in [
            "localhost",
            "LOCALHOST:9",
            "localhost.",
            "a.localhost",
            "127.0.0.1:8400",
            "127.9.9.9",
            "[::1]:8400",
            "bench.example:443",
        ] {
            assert_eq!(status(&here, "GET", &[("host", host)]), 200, "{host}");
        }
        for host in [
            "evil.example",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "10.0.0.1",
            "xlocalhost",
            "[::2]",
            "bench.example.evil",
        ] {
            assert_eq!(status(&here, "GET", &[("host", host)]), 421, "{host}");
        }
        assert_eq!(status(&here, "GET", &[]), 400, "HTTP/1.1 has a host");
        assert_eq!(
            status(&here, "GET", &[("host", "localhost"), ("host", "evil.example")]),
            400
        );
        let everywhere: SocketAddr = "0.0.0.0:8400".parse().expect("an address");
        let any = HostNames::new(everywhere, &[]).expect("names");
        assert_eq!(status(&any, "GET", &[("host", "anything.example")]), 200);
        let named = HostNames::new(everywhere, &["bench.example".to_owned()]).expect("names");
        assert_eq!(status(&named, "GET", &[("host", "anything.example")]), 421);
        for bad in ["", "bench.example:80", "user@bench", "a b", "https://bench.example"] {
            assert!(HostNames::new(loopback, &[bad.to_owned()]).is_err(), "{bad}");
        }
    }

    #[test]
    fn val_pages_of_others_change_nothing() {
        let loopback: SocketAddr = "127.0.0.1:8400".parse().expect("an address");
        let here = HostNames::new(loopback, &[]).expect("names");
        let host = ("host", "localhost:8400");
        for (origin, site, expected) in [
            (None, None, 200),
            (None, Some("same-origin"), 200),
            (None, Some("none"), 200),
            (None, Some("same-site"), 403),
            (None, Some("cross-site"), 403),
            (Some("http://localhost:8400"), Some("same-origin"), 200),
            (Some("http://localhost:8400"), None, 200),
            (Some("http://localhost:8400"), Some("cross-site"), 403),
            (Some("http://localhost:3000"), None, 403),
            (Some("http://evil.example"), None, 403),
            (Some("null"), None, 403),
            (Some("https://bench.example"), Some("cross-site"), 200),
        ] {
            let mut headers = vec![host];
            headers.extend(origin.map(|origin| ("origin", origin)));
            headers.extend(site.map(|site| ("sec-fetch-site", site)));
            for method in ["POST", "PUT", "DELETE"] {
                assert_eq!(
                    status(&here, method, &headers),
                    expected,
                    "{method} {origin:?} {site:?}"
                );
            }
            assert_eq!(
                status(&here, "GET", &headers),
                200,
                "{origin:?} {site:?}: read without leave, it stays unread"
            );
            headers.push(("upgrade", "websocket"));
            assert_eq!(
                status(&here, "GET", &headers),
                expected,
                "WebSocket {origin:?} {site:?}"
            );
        }
    }

    #[test]
    fn val_bodies_say_what_they_are() {
        let loopback: SocketAddr = "127.0.0.1:8400".parse().expect("an address");
        let here = HostNames::new(loopback, &[]).expect("names");
        for (kind, expected) in [
            (Some("application/json"), 200),
            (Some("application/toml; charset=utf-8"), 200),
            (Some("text/plain"), 415),
            (Some("Text/Plain;charset=UTF-8"), 415),
            (Some("application/x-www-form-urlencoded"), 415),
            (Some("multipart/form-data; boundary=x"), 415),
            (Some(""), 415),
            (None, 415),
        ] {
            for length in [("content-length", "7"), ("transfer-encoding", "chunked")] {
                let mut headers = vec![("host", "localhost"), length];
                headers.extend(kind.map(|kind| ("content-type", kind)));
                assert_eq!(status(&here, "POST", &headers), expected, "{kind:?}");
            }
            let headers = [("host", "localhost"), ("content-length", "0")];
            assert_eq!(status(&here, "POST", &headers), 200, "nothing to say of no body");
        }
    }
}
