//! A table for display.

use serde::Serialize;

/// A table: a first column of names, then numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResultTable {
    /// `6`, `7`, …, `improved`.
    pub key: &'static str,
    /// Title.
    pub title: String,
    /// Column headers.
    pub columns: Vec<String>,
    /// Cells, one per column in each row.
    pub rows: Vec<Vec<String>>,
    /// Notes below the table.
    pub notes: Vec<String>,
}
