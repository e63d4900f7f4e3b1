//! Columns of a run's telemetry.

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use std::path::Path;

/// The named columns of `telemetry.parquet` in a run folder, one number per step.
pub fn columns<const N: usize>(run: &Path, names: [&str; N]) -> [Vec<f64>; N] {
    let file = std::fs::File::open(run.join("telemetry.parquet")).expect("it was written");
    let reader = SerializedFileReader::new(file).expect("it is Parquet");
    let mut columns = names.map(|_| Vec::new());
    for row in reader.get_row_iter(None).expect("it has rows") {
        let row = row.expect("it can be read");
        for (name, field) in row.get_column_iter() {
            if let Some(place) = names.iter().position(|wanted| wanted == name) {
                columns[place].push(match field {
                    Field::Double(value) => *value,
                    Field::Float(value) => f64::from(*value),
                    Field::Int(value) => f64::from(*value),
                    other => panic!("{name}: {other:?} is no number"),
                });
            }
        }
    }
    for (name, column) in names.iter().zip(&columns) {
        assert!(!column.is_empty(), "no column {name}");
    }
    columns
}
