//! How a range of numbers looks in JSON.

use utoipa::ToSchema;

/// Range from `start` to `end`, exclusive.
#[derive(ToSchema)]
#[expect(dead_code, reason = "for the OpenAPI document: serde writes a `Range` so")]
pub(crate) struct Span {
    start: u64,
    end: u64,
}
