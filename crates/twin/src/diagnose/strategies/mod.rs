//! How starting points of fits are found: one file per search strategy.

pub(crate) mod along;
pub(crate) mod battery;
pub(crate) mod covariance;
pub(crate) mod cut;
pub(crate) mod discrete;
mod gust_filter;
pub(crate) mod onset;
mod shapes;
mod slow_voltage;
pub(crate) mod start;
pub(crate) mod trials;
mod variants;
