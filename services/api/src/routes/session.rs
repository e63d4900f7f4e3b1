//! Signing in and out with a browser.

use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use crate::sessions::{cookie, secret};
use crate::tokens::{Scope, Token};
use axum::Json;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// No token is longer; ours have some 50 characters.
const LONGEST_TOKEN: usize = 200;

/// A token to sign in with.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SignIn {
    /// As printed by `rotortwin token create`.
    #[schema(max_length = 200)]
    token: String,
}

/// The caller, and whether authentication is required.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SignedIn {
    /// True if every request needs a token.
    needs_token: bool,
    /// The caller is known.
    signed_in: bool,
    /// Its tenant.
    tenant: Option<String>,
    /// `read`, `write`, `admin`.
    #[schema(value_type = Vec<String>)]
    scopes: Vec<Scope>,
}

impl SignedIn {
    fn of(token: &Token) -> Self {
        Self {
            needs_token: true,
            signed_in: true,
            tenant: Some(token.tenant.clone()),
            scopes: token.scopes.clone(),
        }
    }

    fn nobody() -> Self {
        Self {
            needs_token: true,
            signed_in: false,
            tenant: None,
            scopes: Vec::new(),
        }
    }

    /// Where nobody needs a token.
    fn local() -> Self {
        Self {
            needs_token: false,
            signed_in: true,
            tenant: Some(Caller::local().tenant),
            scopes: Scope::ALL.to_vec(),
        }
    }
}

/// Identity of the caller, and whether a token is needed; open to all.
#[utoipa::path(get, path = "/api/v1/session", tag = "server", operation_id = "get_session", responses(
    (status = 200, description = "the caller", body = SignedIn)
))]
pub(crate) async fn get(app: Shared, headers: HeaderMap) -> Result<Json<SignedIn>, Problem> {
    if !app.database.has_tokens().await? {
        return Ok(Json(SignedIn::local()));
    }
    let token = crate::access::token(&app, &headers).await;
    Ok(Json(
        token.map_or_else(|_| SignedIn::nobody(), |token| SignedIn::of(&token)),
    ))
}

/// Signs in: exchanges a token for a cookie, which browsers also send with event streams and WebSockets.
#[utoipa::path(post, path = "/api/v1/session", tag = "server", operation_id = "sign_in", request_body = SignIn, responses(
    (status = 200, description = "signed in", body = SignedIn, headers(("Set-Cookie" = Option<String>, description = "the session"))),
    (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "invalid body", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn sign_in(app: Shared, body: Result<JsonObject<SignIn>, Problem>) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    if body.token.chars().count() > LONGEST_TOKEN {
        return Err(Problem::unprocessable(format!(
            "`token` has more than {LONGEST_TOKEN} characters; expected one that `rotortwin token create` printed"
        )));
    }
    if !app.database.has_tokens().await? {
        return Ok(Json(SignedIn::local()).into_response());
    }
    let token = app
        .database
        .token(body.token.trim())
        .await?
        .ok_or_else(crate::access::worthless)?;
    let secret = app.database.begin_session(&token).await?;
    let set = (header::SET_COOKIE, cookie(Some(&secret), has_tls(&app)));
    Ok(([set], Json(SignedIn::of(&token))).into_response())
}

/// Signs out: ends the session on the server and in the browser.
#[utoipa::path(delete, path = "/api/v1/session", tag = "server", operation_id = "sign_out", responses(
    (status = 204, description = "nobody is signed in")
))]
pub(crate) async fn sign_out(app: Shared, headers: HeaderMap) -> Result<Response, Problem> {
    if let Some(secret) = secret(&headers) {
        app.database.end_session(secret).await?;
    }
    let set = (header::SET_COOKIE, cookie(None, has_tls(&app)));
    Ok((StatusCode::NO_CONTENT, [set]).into_response())
}

fn has_tls(app: &App) -> bool {
    app.config.tls.is_some()
}
