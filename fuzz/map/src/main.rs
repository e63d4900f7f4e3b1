//! Untrusted tables: a mapping is drafted for any text, and the text read with the draft; after the mark follows a
//! mapping of the input's own, with which the table is read as well.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rotortwin_twin::log::{FlightLog, ReadOptions, draft};
use std::path::PathBuf;
use std::sync::LazyLock;

const MARK: &[u8] = b"#MAP#";

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = PathBuf::from(format!("/dev/shm/rotortwin-fuzz-map-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("memory can be written");
    folder
});

fn read_by(mapping: &[u8]) {
    let (file, map) = (FOLDER.join("table.csv"), FOLDER.join("map.toml"));
    std::fs::write(&map, mapping).expect("memory can be written");
    let options = ReadOptions {
        mapping: Some(map),
        ..ReadOptions::default()
    };
    if let Ok(log) = FlightLog::read_with(&file, &options) {
        assert!(log.duration_s() >= 0.0 && log.sample_rate_hz() > 0.0);
    }
}

fuzz_target!(|data: &[u8]| {
    let at = data.windows(MARK.len()).position(|five| five == MARK);
    let (table, mapping) = at.map_or((data, None), |at| (&data[..at], Some(&data[at + MARK.len()..])));
    let file = FOLDER.join("table.csv");
    std::fs::write(&file, table).expect("memory can be written");
    // A draft that the import would not take is refused by the draft itself.
    if let Ok(drafted) = draft(&file, table) {
        read_by(drafted.toml.as_bytes());
    }
    if let Some(mapping) = mapping {
        read_by(mapping);
    }
});
