//! Wall-clock time, for display and leases; no flight depends on it.

use std::time::{SystemTime, UNIX_EPOCH};

/// ms since 1970, UTC.
#[expect(clippy::disallowed_methods, reason = "for people and leases; a flight never sees it")]
pub(crate) fn now_ms() -> i64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| i64::try_from(since.as_millis()).unwrap_or(i64::MAX))
}
