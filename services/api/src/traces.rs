//! Spans of requests and attempts over OTLP/HTTP, if configured.
//!
//! ```text
//!  client ─ traceparent ─▶ request ─▶ `traceparent` in the job's spec ─▶ queue ─▶ attempt
//!                             └──────────── exporter thread ◀────────────────────────┘
//! ```
//! Off unless `OTEL_EXPORTER_OTLP_ENDPOINT` or `OTEL_EXPORTER_OTLP_TRACES_ENDPOINT` is set; then requests run no code of this module.
//! The other OpenTelemetry variables (headers, time-outs, sampler, batches, resource) are interpreted by its SDK.
//!
//! Spans wait in a bounded queue and are dropped if it is full: an unavailable collector costs spans, never jobs. A streaming request
//! (events, live samples) has a span until its headers are sent. An attempt whose worker is killed leaves none.

use crate::App;
use crate::jobs::{Job, NewJob};
use axum::extract::{MatchedPath, Request, State};
use axum::http::HeaderMap;
use axum::middleware::Next;
use axum::response::Response;
use opentelemetry::propagation::{Extractor, TextMapPropagator as _};
use opentelemetry::trace::{FutureExt as _, SpanKind, Status, TraceContextExt as _, Tracer as _, TracerProvider as _};
use opentelemetry::{Context, KeyValue};
use opentelemetry_otlp::SpanExporter as OtlpExporter;
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::error::OTelSdkResult;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::{SdkTracer, SdkTracerProvider, SpanData, SpanExporter};
use serde::Deserialize;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Time for exporting the remaining queue when the process ends.
const LAST_SPANS: Duration = Duration::from_secs(2);
/// W3C Trace Context, as a header and in the spec of a job.
const TRACEPARENT: &str = "traceparent";

/// Span exporter; `None` unless configured.
#[derive(Debug, Clone, Default)]
pub(crate) struct Traces(Option<Exporting>);

#[derive(Debug, Clone)]
struct Exporting {
    provider: SdkTracerProvider,
    tracer: SdkTracer,
}

fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|text| !text.trim().is_empty())
}

impl Traces {
    /// From the environment. `instance`: display name of this process.
    ///
    /// # Errors
    /// The message names the variable, and what was expected.
    pub(crate) fn from_environment(instance: &str) -> Result<Self, String> {
        let [endpoint, protocol] = ["ENDPOINT", "PROTOCOL"].map(|what| {
            [
                format!("OTEL_EXPORTER_OTLP_TRACES_{what}"),
                format!("OTEL_EXPORTER_OTLP_{what}"),
            ]
            .into_iter()
            .find_map(|name| variable(&name).map(|text| (name, text)))
        });
        let Some((name, endpoint)) = endpoint else {
            return Ok(Self::default());
        };
        let is = |name: &str, word: &str| variable(name).is_some_and(|text| text.eq_ignore_ascii_case(word));
        if is("OTEL_SDK_DISABLED", "true") || is("OTEL_TRACES_EXPORTER", "none") {
            return Ok(Self::default());
        }
        if let Some((name, protocol)) = protocol
            && protocol != "http/protobuf"
        {
            return Err(format!(
                "{name}={protocol}: spans are sent as OTLP over HTTP; expected http/protobuf"
            ));
        }
        let exporter = OtlpExporter::builder().with_http().build().map_err(|error| {
            format!("{name}={endpoint}: {error}; expected an address such as http://127.0.0.1:4318")
        })?;
        let detected = Resource::builder()
            .with_attribute(KeyValue::new("service.version", env!("CARGO_PKG_VERSION")))
            .with_attribute(KeyValue::new("service.instance.id", instance.to_owned()))
            .build();
        let named = detected
            .get(&"service.name".into())
            .is_some_and(|name| !name.as_str().starts_with("unknown_service"));
        let resource = if named {
            detected
        } else {
            let all = detected
                .iter()
                .map(|(key, value)| KeyValue::new(key.clone(), value.clone()));
            Resource::builder_empty()
                .with_attributes(all)
                .with_service_name("rotortwin")
                .build()
        };
        let provider = SdkTracerProvider::builder()
            .with_resource(resource)
            .with_batch_exporter(Outspoken {
                inner: exporter,
                endpoint,
                fails: AtomicBool::new(false),
            })
            .build();
        let tracer = provider.tracer("rotortwin");
        Ok(Self(Some(Exporting { provider, tracer })))
    }

    /// True if spans are exported.
    pub(crate) fn are_on(&self) -> bool {
        self.0.is_some()
    }

    /// Exports the remaining spans, and ends. Waits for a collector, but not long.
    pub(crate) async fn end(&self) {
        let Some(Exporting { provider, .. }) = self.0.clone() else {
            return;
        };
        let ended = tokio::task::spawn_blocking(move || provider.shutdown_with_timeout(LAST_SPANS)).await;
        if !matches!(ended, Ok(Ok(()))) {
            tracing::warn!("the last spans were not exported in time");
        }
    }

    /// A job continues the trace of the request that created it.
    pub(crate) fn carry(&self, new: &mut NewJob) {
        if !self.are_on() {
            return;
        }
        let mut carrier = HashMap::new();
        TraceContextPropagator::new().inject(&mut carrier);
        let Some(traceparent) = carrier.remove(TRACEPARENT) else {
            return;
        };
        for job in std::iter::once(&mut new.spec).chain(new.parts.iter_mut().map(|part| &mut part.spec)) {
            // Hexadecimal digits and dashes: nothing to escape. The spec is a JSON object with keys.
            if let Some(rest) = job.strip_prefix('{') {
                *job = format!("{{\"{TRACEPARENT}\":\"{traceparent}\",{rest}");
            }
        }
    }

    /// Starts the span of an attempt.
    pub(crate) fn attempt(&self, job: &Job, worker: &str) -> Attempt {
        let Some(Exporting { tracer, .. }) = &self.0 else {
            return Attempt(None);
        };
        let parent = TraceContextPropagator::new().extract_with_context(&Context::new(), &Carried::of(&job.new.spec));
        let attributes = [
            KeyValue::new("rotortwin.job.id", job.id.clone()),
            KeyValue::new("rotortwin.job.kind", job.new.kind.as_str()),
            KeyValue::new("rotortwin.job.name", job.new.name.clone()),
            KeyValue::new("rotortwin.job.attempt", job.attempts),
            KeyValue::new("rotortwin.tenant", job.new.tenant.clone()),
            KeyValue::new("rotortwin.worker", worker.to_owned()),
        ];
        let builder = tracer
            .span_builder(format!("attempt {}", job.new.kind.as_str()))
            .with_kind(SpanKind::Consumer)
            .with_attributes(attributes);
        let span = tracer.build_with_context(builder, &parent);
        Attempt(Some(parent.with_span(span)))
    }
}

/// The span of an attempt.
pub(crate) struct Attempt(Option<Context>);

impl Attempt {
    /// Ends the span; `error`: why the attempt failed.
    pub(crate) fn end(self, outcome: &'static str, error: Option<&str>) {
        let Some(context) = self.0 else { return };
        let span = context.span();
        span.set_attribute(KeyValue::new("rotortwin.outcome", outcome));
        if let Some(error) = error {
            span.set_status(Status::error(error.to_owned()));
        }
        span.end();
    }
}

/// A span around a request; it continues the client's trace, if given.
pub(crate) async fn request(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let Some(Exporting { tracer, .. }) = &app.context.traces.0 else {
        return next.run(request).await;
    };
    let context = begun(tracer, &request);
    let response = next.run(request).with_context(context.clone()).await;
    let span = context.span();
    let status = response.status();
    span.set_attribute(KeyValue::new("http.response.status_code", i64::from(status.as_u16())));
    if status.is_server_error() {
        span.set_status(Status::error(""));
    }
    span.end();
    response
}

/// The span of a request, with attributes named by OpenTelemetry's HTTP conventions.
fn begun(tracer: &SdkTracer, request: &Request) -> Context {
    let headers = Headers(request.headers());
    let parent = TraceContextPropagator::new().extract_with_context(&Context::new(), &headers);
    let method = request.method().to_string();
    let route = request.extensions().get::<MatchedPath>().map(MatchedPath::as_str);
    let id = headers.get("x-request-id").unwrap_or_default().to_owned();
    let mut attributes = vec![
        KeyValue::new("http.request.method", method.clone()),
        KeyValue::new("url.path", request.uri().path().to_owned()),
        KeyValue::new("http.request.header.x-request-id", id),
    ];
    attributes.extend(route.map(|route| KeyValue::new("http.route", route.to_owned())));
    let name = route.map_or_else(|| method.clone(), |route| format!("{method} {route}"));
    let builder = tracer
        .span_builder(name)
        .with_kind(SpanKind::Server)
        .with_attributes(attributes);
    parent.with_span(tracer.build_with_context(builder, &parent))
}

struct Headers<'a>(&'a HeaderMap);

impl Extractor for Headers<'_> {
    fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key).and_then(|value| value.to_str().ok())
    }

    fn keys(&self) -> Vec<&str> {
        self.0.keys().map(axum::http::HeaderName::as_str).collect()
    }
}

/// Trace context in a job's spec.
#[derive(Deserialize)]
struct Carried {
    traceparent: Option<String>,
}

impl Carried {
    fn of(spec: &str) -> Self {
        serde_json::from_str(spec).unwrap_or(Self { traceparent: None })
    }
}

impl Extractor for Carried {
    fn get(&self, key: &str) -> Option<&str> {
        self.traceparent.as_deref().filter(|_| key == TRACEPARENT)
    }

    fn keys(&self) -> Vec<&str> {
        vec![TRACEPARENT]
    }
}

/// Reports once that a collector rejects spans, and once that it accepts them again.
#[derive(Debug)]
struct Outspoken {
    inner: OtlpExporter,
    endpoint: String,
    fails: AtomicBool,
}

impl SpanExporter for Outspoken {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        let count = batch.len();
        let exported = self.inner.export(batch).await;
        let failed_before = self.fails.swap(exported.is_err(), Ordering::Relaxed);
        match (&exported, failed_before) {
            (Err(error), false) => {
                tracing::warn!(endpoint = self.endpoint, spans = count, %error, "spans are lost until the collector accepts them");
            }
            (Ok(()), true) => tracing::warn!(endpoint = self.endpoint, "the collector takes spans again"),
            _ => {}
        }
        exported
    }

    fn shutdown_with_timeout(&self, timeout: Duration) -> OTelSdkResult {
        self.inner.shutdown_with_timeout(timeout)
    }

    fn force_flush(&self) -> OTelSdkResult {
        self.inner.force_flush()
    }

    fn set_resource(&mut self, resource: &Resource) {
        self.inner.set_resource(resource);
    }
}
