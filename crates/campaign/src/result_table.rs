//! A table as people read it.

use serde::Serialize;

/// A table: a first column of names, then numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResultTable {
    /// `6`, `7`, …, `improved`.
    pub key: &'static str,
    /// Above it.
    pub title: String,
    /// Heads of the columns.
    pub columns: Vec<String>,
    /// Cells, as many in each row as there are columns.
    pub rows: Vec<Vec<String>>,
    /// Below it: what to know when reading it.
    pub notes: Vec<String>,
}
