//! Output of a run: a self-describing folder that other programs can open.
//!
//! ```text
//! step by step                at the end of the run, done or failed
//! TelemetryRow ─▶ spool ─┬─▶ telemetry.parquet   every column in full        (parquet)
//!                        ├─▶ run.mcap            for Foxglove, Lichtblick    (mcap)
//!                        ├─▶ report.html         the paper's figures         (report)
//!                        ├─▶ figures/*.svg       the same for documents      (figures)
//!                        └─▶ summary.json        facts, verdict table        (analysis, summary)
//! ```
//!
//! [`streams`] creates the messages of `run.mcap`, which a flight can also publish live.
//!
//! [`query`] answers queries on `telemetry.parquet`: channels, an interval, as many rows as a plot needs.
//!
//! [`own_detector`] lets a detector of the user's own judge a run that is complete.
//!
//! [`RunFolder`] creates the folder, [`SpoolWriter`] appends the rows, [`finalise`] writes the rest. The crate knows no
//! link, no scenario and no clock: facts about those are passed in as text and numbers.

pub mod analysis;
pub mod column_file;
pub mod controllers;
pub mod error;
pub mod export;
pub mod figures;
pub mod files;
mod mcap;
pub mod own_detector;
mod parquet;
mod plots;
pub mod query;
mod report;
pub mod run_folder;
pub mod spool;
pub mod streams;
pub mod summary;
pub mod telemetry;
mod ulog;

pub use error::{Result, StoreError};
pub use run_folder::{Outputs, RunFolder, finalise};
pub use spool::{SpoolHeader, SpoolReader, SpoolWriter};
pub use summary::{Summary, load_summary};
pub use telemetry::{Column, Kind, TelemetryRow, TruthRow, telemetry_columns};

#[cfg(test)]
extern crate self as rotortwin_store;
#[cfg(test)]
#[path = "../tests/synthetic/mod.rs"]
#[expect(
    unreachable_pub,
    reason = "shared with the tests and examples, where it is a module of its own"
)]
mod synthetic;
