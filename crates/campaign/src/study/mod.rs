//! Campaigns: many flights of a document of grids and draws, on every core, crash-safe, with the statistics of the detectors.
//!
//! ```text
//!  document ─▶ plan ─▶ engine (one record per flight) ─▶ runner ─▶ folder: shards ─▶ totals ─▶ tables, report, summary
//! ```
//!
//! * [`document`]: the file. * [`plan`]: the parameters of flight i. * [`engine`], [`score`], [`record`]: its results.
//! * [`runner`], [`folder`]: threads, progress, shards on disk. * [`totals`], [`intervals`]: sums over records, in the order of the
//!   flights. * [`tables`], [`charts`], [`report`], [`results`]: for people and files.
//! * [`own`]: detectors of the user's own. [`features`]: windows of the flights, to train on. * [`log_score`]: the same counts for a log. [`merge`]: shards
//!   flown on other machines. [`hunt`]: flights where the detector fails, reduced to what matters.

pub mod cell;
pub mod document;
pub mod engine;
pub mod features;
pub mod folder;
pub mod hunt;
pub mod intervals;
pub mod log_score;
pub mod merge;
pub mod own;
pub mod plan;
pub mod record;
pub mod report;
pub mod results;
pub mod runner;
pub mod score;
pub mod summary;
pub mod tables;
pub mod totals;

pub use plan::Campaign;
