//! Many flights, and learning from them.
//!
//! * [`study`]: campaigns of grids and draws, with the statistics of the detectors.
//! * [`paper`]: the paper's data set, its tables, trained classifiers.
//! * [`learning`]: training in f64.
//! * [`parallel`]: uses every core, with bit-identical results. * [`table_file`], [`result_table`]: tables for programs
//!   and for people.

pub mod learning;
pub mod paper;
pub mod parallel;
pub mod result_table;
pub mod study;
pub mod table_file;
