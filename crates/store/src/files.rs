//! Names of the files in the folder of a run.

/// All columns of all steps.
pub const TELEMETRY_FILE: &str = "telemetry.parquet";
/// The run as streams.
pub const MCAP_FILE: &str = "run.mcap";
/// Facts and statistics.
pub const SUMMARY_FILE: &str = "summary.json";
/// The report.
pub const REPORT_FILE: &str = "report.html";
/// Folder of the figures as SVG.
pub const FIGURES_FOLDER: &str = "figures";
/// Working file during the run.
pub const SPOOL_FILE: &str = "telemetry.spool";
