//! The body of a request that is a JSON object.

use crate::problem::Problem;
use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{FromRequest, Request};
use serde::de::DeserializeOwned;

/// As [`Json`], but only accepts an object: serde also accepts an array for a struct, with its items in field order.
pub(crate) struct JsonObject<T>(pub(crate) T);

impl<T, S> FromRequest<S> for JsonObject<T>
where
    T: DeserializeOwned,
    S: Send + Sync,
{
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let (parts, body) = request.into_parts();
        let whole = Bytes::from_request(Request::from_parts(parts.clone(), body), state).await?;
        let is_array = whole.trim_ascii_start().first() == Some(&b'[');
        let Json(value) = Json::<T>::from_request(Request::from_parts(parts, Body::from(whole)), state).await?;
        if is_array {
            return Err(Problem::unprocessable(
                "the body is an array; expected one JSON object, with the names given in the OpenAPI document",
            ));
        }
        Ok(Self(value))
    }
}
