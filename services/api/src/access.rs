//! Authentication and authorisation.
//!
//! Until the first token is created, every client on this host has full access under the tenant `local`, and the server only listens
//! to loopback. From the first token on, every address under `/api/` needs `Authorization: Bearer TOKEN`, or a browser session
//! ([`crate::sessions`]).

use crate::App;
use crate::jobs::{Job, LOCAL_TENANT};
use crate::problem::Problem;
use crate::tokens::{Scope, Token};
use axum::extract::{FromRequestParts, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use governor::clock::{Clock as _, DefaultClock};
use governor::state::keyed::HashMapStateStore;
use governor::{Quota, RateLimiter};
use std::convert::Infallible;
use std::num::NonZeroU32;
use std::sync::Arc;

/// The authenticated caller.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Caller {
    /// Tenant.
    pub(crate) tenant: String,
    /// May see the jobs of all tenants.
    pub(crate) sees_all: bool,
    /// May make changes; to be checked where a GET does, as a WebSocket can.
    may_write: bool,
    /// There are other tenants: shared resources are divided.
    pub(crate) is_one_of_several: bool,
}

impl Caller {
    /// The only caller if no token is needed.
    pub(crate) fn local() -> Self {
        Self {
            tenant: LOCAL_TENANT.to_owned(),
            sees_all: true,
            may_write: true,
            is_one_of_several: false,
        }
    }

    /// Whether the caller may see a job. Other tenants' jobs appear not to exist.
    pub(crate) fn sees(&self, job: &Job) -> bool {
        self.sees_all || job.new.tenant == self.tenant
    }

    /// Rejects a read-only caller, where a GET changes or reveals more than usual; `why` is the reason.
    ///
    /// # Errors
    /// 403.
    pub(crate) fn must_write(&self, why: &str) -> Result<(), Problem> {
        if self.may_write {
            return Ok(());
        }
        Err(Problem::forbidden(format!(
            "{why}; expected a token with the scope `write`"
        )))
    }

    /// Tenant whose jobs a list shows; `None`: all.
    pub(crate) fn tenant_filter(&self) -> Option<&str> {
        (!self.sees_all).then_some(self.tenant.as_str())
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Caller {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        // Public resources show no jobs.
        Ok(parts.extensions.get::<Self>().cloned().unwrap_or(Self {
            tenant: String::new(),
            sees_all: false,
            may_write: false,
            is_one_of_several: true,
        }))
    }
}

/// Rate limit per tenant.
#[derive(Debug)]
pub(crate) struct Rate(RateLimiter<String, HashMapStateStore<String>, DefaultClock>);

impl Rate {
    /// This many per second, with bursts of twice as many.
    pub(crate) fn new(per_second: NonZeroU32) -> Self {
        let burst = per_second.saturating_mul(NonZeroU32::MIN.saturating_add(1));
        let quota = Quota::per_second(per_second).allow_burst(burst);
        Self(RateLimiter::hashmap_with_clock(quota, DefaultClock::default()))
    }

    fn check(&self, tenant: &str) -> Result<(), u64> {
        self.0
            .check_key(&tenant.to_owned())
            .map_err(|not_until| not_until.wait_time_from(DefaultClock::default().now()).as_secs() + 1)
    }
}

/// Lets authorised requests through.
pub(crate) async fn authorize(State(app): State<Arc<App>>, mut request: Request, next: Next) -> Response {
    let path = request.uri().path();
    // For watchdogs, the page, and clients about to sign in; they reveal no jobs.
    if crate::web::is_page(path)
        || path == "/api/v1/session"
        || path == "/api/v1/openapi.json"
        || path.starts_with("/api/v1/docs")
    {
        return next.run(request).await;
    }
    let caller = match caller(&app, request.method(), request.headers()).await {
        Ok(caller) => caller,
        Err(problem) => {
            let challenge = problem.status == 401;
            let mut response = problem.into_response();
            if challenge {
                response.headers_mut().insert(
                    header::WWW_AUTHENTICATE,
                    header::HeaderValue::from_static("Bearer realm=\"rotortwin\""),
                );
            }
            return response;
        }
    };
    if let Err(seconds) = app.rate.check(&caller.tenant) {
        let mut response = Problem::too_many(format!(
            "'{}' exceeds the request rate that the server allows; expected a pause of {seconds} s",
            caller.tenant
        ))
        .into_response();
        response.headers_mut().insert(header::RETRY_AFTER, seconds.into());
        return response;
    }
    request.extensions_mut().insert(caller);
    next.run(request).await
}

async fn caller(app: &App, method: &Method, headers: &HeaderMap) -> Result<Caller, Problem> {
    if !headers.contains_key(header::AUTHORIZATION) && !app.database.has_tokens().await? {
        return Ok(Caller::local());
    }
    let token = token(app, headers).await?;
    permit(&token, method)?;
    Ok(Caller {
        sees_all: token.scopes.contains(&Scope::Admin),
        may_write: permit(&token, &Method::POST).is_ok(),
        is_one_of_several: true,
        tenant: token.tenant,
    })
}

pub(crate) fn worthless() -> Problem {
    Problem::unauthorized("the token is unknown, revoked or has expired; `rotortwin token create` makes another one")
}

/// The token of a request, from its header or session.
///
/// # Errors
/// 401: none, or an invalid one.
pub(crate) async fn token(app: &App, headers: &HeaderMap) -> Result<Token, Problem> {
    let Some(value) = headers.get(header::AUTHORIZATION) else {
        let Some(secret) = crate::sessions::secret(headers) else {
            return Err(Problem::unauthorized(
                "expected a header `Authorization: Bearer TOKEN`, or a session (`POST /api/v1/session`)",
            ));
        };
        let token = app.database.token_of_session(secret).await?;
        return token
            .ok_or_else(|| Problem::unauthorized("the session is over, or its token is revoked or has expired"));
    };
    let text = value
        .to_str()
        .ok()
        .and_then(|text| text.split_once(' '))
        .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"))
        .map(|(_, token)| token.trim())
        .ok_or_else(|| Problem::unauthorized("expected a header `Authorization: Bearer TOKEN`"))?;
    app.database.token(text).await?.ok_or_else(worthless)
}

fn permit(token: &Token, method: &Method) -> Result<(), Problem> {
    let needed = if matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS) {
        Scope::Read
    } else {
        Scope::Write
    };
    if token.scopes.contains(&needed) || token.scopes.contains(&Scope::Admin) {
        return Ok(());
    }
    Err(Problem::forbidden(format!(
        "the token '{}' has no scope `{}`",
        token.name,
        needed.as_str()
    )))
}
