//! Request durations by route, for Prometheus.

use crate::App;
use axum::extract::{MatchedPath, Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::Response;
use prometheus_client::encoding::{EncodeLabelSet, text};
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};
use std::sync::Arc;
use std::time::Instant;

/// Upper bounds of the histogram buckets, s.
const CLASSES_S: [f64; 11] = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];

/// Kind of a request, without client-chosen parts such as ids or names.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Kind {
    method: String,
    /// As in the API document; `page` for all others.
    route: String,
    status: u16,
}

/// Requests since the server started.
#[derive(Debug)]
pub(crate) struct Metrics {
    registry: Registry,
    requests: Family<Kind, Histogram>,
}

impl Metrics {
    pub(crate) fn new() -> Self {
        let requests = Family::<Kind, Histogram>::new_with_constructor(|| Histogram::new(CLASSES_S));
        let mut registry = Registry::with_prefix("rotortwin");
        registry.register_with_unit(
            "request_duration",
            "Time to the head of the answer",
            Unit::Seconds,
            requests.clone(),
        );
        Self { registry, requests }
    }

    /// In the text format of OpenMetrics, without its last line.
    pub(crate) fn text(&self) -> Result<String, std::fmt::Error> {
        let mut words = String::new();
        text::encode_registry(&mut words, &self.registry)?;
        Ok(words)
    }
}

/// Notes how long a request took.
pub(crate) async fn measure(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    // A caller may send any method.
    let known = [
        Method::GET,
        Method::POST,
        Method::PUT,
        Method::DELETE,
        Method::HEAD,
        Method::OPTIONS,
    ];
    let method = request.method();
    let method = if known.contains(method) {
        method.as_str()
    } else {
        "other"
    }
    .to_owned();
    let route = request.extensions().get::<MatchedPath>();
    let route = route.map_or("page", MatchedPath::as_str).to_owned();
    let begun = Instant::now();
    let answer = next.run(request).await;
    let status = answer.status().as_u16();
    let kind = Kind { method, route, status };
    app.metrics
        .requests
        .get_or_create(&kind)
        .observe(begun.elapsed().as_secs_f64());
    answer
}
