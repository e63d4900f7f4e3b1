//! Connections: accepted, served with time-outs, and closed when the process ends.
//!
//! | Client | Closed |
//! |---|---|
//! | sends no complete head | after [`HEAD`], including the idle time between two requests |
//! | sends a body and stalls | after [`BODY_PAUSE`] without a byte (a layer of the router) |
//! | does not read its response | after [`UNREAD`] without progress |
//! | has not finished when the process ends | after [`LAST_ANSWERS`] |
//!
//! Streams (events, WebSockets) end with the process, or when the reader disconnects; they may be silent.
//!
//! A head that is too large is answered by [`fit`], with a document that says so. hyper, which parses it before, has limits of its own: a
//! target of 65,534 bytes, [`MOST_PARSED`] headers and 400 KiB in all, beyond which the answer is the status alone.

use crate::problem::Problem;
use axum::Router;
use axum::extract::Request;
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use axum::serve::Listener;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::pin::pin;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio_io_timeout::TimeoutStream;

/// Timeout for the head of a request.
const HEAD: Duration = Duration::from_secs(15);
/// Timeout between two parts of a body.
pub(crate) const BODY_PAUSE: Duration = Duration::from_secs(30);
/// Timeout for a response that cannot be sent.
const UNREAD: Duration = Duration::from_secs(60);
/// Time for pending responses when the process ends.
const LAST_ANSWERS: Duration = Duration::from_secs(5);

/// Longest path and query of a request, bytes.
const LONGEST_TARGET: usize = 32 << 10;
/// Most headers of a request, and their size together, bytes.
const MOST_HEADERS: usize = 100;
const LARGEST_HEADERS: usize = 64 << 10;
/// Headers that are parsed, so that more than [`MOST_HEADERS`] are refused here.
const MOST_PARSED: usize = 500;

/// Refuses a head that is too large.
pub(crate) async fn fit(request: Request, next: Next) -> Response {
    match check_size(&request) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

fn check_size(request: &Request) -> Result<(), Problem> {
    let target = request.uri().path_and_query().map_or(0, |target| target.as_str().len());
    if target > LONGEST_TARGET {
        return Err(Problem::uri_too_long(format!(
            "path and query have {target} bytes; expected at most {LONGEST_TARGET}"
        )));
    }
    let headers = request.headers();
    // Its id, which is ours if the client gave none, does not count.
    let count = headers.len() - usize::from(headers.contains_key("x-request-id"));
    if count > MOST_HEADERS {
        return Err(Problem::headers_too_large(format!(
            "the request has {count} headers; expected at most {MOST_HEADERS}"
        )));
    }
    // With colon, space and end of line.
    let size: usize = headers
        .iter()
        .map(|(name, value)| name.as_str().len() + value.len() + 4)
        .sum();
    if size > LARGEST_HEADERS {
        return Err(Problem::headers_too_large(format!(
            "the headers of the request have {size} bytes; expected at most {LARGEST_HEADERS}"
        )));
    }
    Ok(())
}

/// Serves until `ending` becomes true, then completes pending requests for a while.
pub(crate) async fn serve<L: Listener>(mut listener: L, router: Router, mut ending: watch::Receiver<bool>) {
    let mut connections = JoinSet::new();
    loop {
        tokio::select! {
            (stream, _) = listener.accept() => {
                connections.spawn(one(stream, router.clone(), ending.clone()));
            }
            // So that finished ones do not accumulate.
            Some(_) = connections.join_next() => {}
            () = ends(&mut ending) => break,
        }
    }
    drop(listener);
    let all = async { while connections.join_next().await.is_some() {} };
    if tokio::time::timeout(LAST_ANSWERS, all).await.is_err() {
        tracing::warn!(
            connections = connections.len(),
            "some clients took too long; their connections were closed"
        );
        connections.shutdown().await;
    }
}

/// Ready once the process ends.
async fn ends(ending: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone.
    drop(ending.wait_for(|ends| *ends).await);
}

async fn one<S>(stream: S, router: Router, mut ending: watch::Receiver<bool>)
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(UNREAD));
    let mut connection = pin!(
        http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD)
            .max_headers(MOST_PARSED)
            .serve_connection(TokioIo::new(Box::pin(stream)), TowerToHyperService::new(router))
            .with_upgrades()
    );
    let mut told = false;
    loop {
        tokio::select! {
            ended = connection.as_mut() => {
                if let Err(error) = ended {
                    tracing::debug!(%error, "a connection broke off");
                }
                return;
            }
            () = ends(&mut ending), if !told => {
                told = true;
                connection.as_mut().graceful_shutdown();
            }
        }
    }
}
