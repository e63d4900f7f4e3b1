//! How a range of numbers looks in JSON.

use utoipa::ToSchema;

/// Numbers from `start` on, `end` no longer among them.
#[derive(ToSchema)]
#[expect(dead_code, reason = "for the OpenAPI document: serde writes a `Range` so")]
pub(crate) struct Span {
    start: u64,
    end: u64,
}
