//! Names of the files in the folder of a run.

/// All columns of all steps.
pub const TELEMETRY_FILE: &str = "telemetry.parquet";
/// The run as streams.
pub const MCAP_FILE: &str = "run.mcap";
/// Facts and numbers.
pub const SUMMARY_FILE: &str = "summary.json";
/// What to look at first.
pub const REPORT_FILE: &str = "report.html";
/// Folder of the figures as SVG.
pub const FIGURES_FOLDER: &str = "figures";
/// Working file while the run goes on.
pub const SPOOL_FILE: &str = "telemetry.spool";
