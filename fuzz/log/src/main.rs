//! Untrusted flight logs: any file through the reader, and the result through the first operations on it.
//!
//! The side file follows the mark.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rotortwin_twin::log::{FlightLog, ReadOptions};
use std::path::PathBuf;
use std::sync::LazyLock;

const MARK: &[u8] = b"#SIDE#";

static FILE: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = PathBuf::from(format!("/dev/shm/rotortwin-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("memory can be written");
    folder.join("log.csv")
});

fuzz_target!(|data: &[u8]| {
    let at = data.windows(MARK.len()).position(|six| six == MARK);
    let (log, side) = at.map_or((data, None), |at| (&data[..at], Some(&data[at + MARK.len()..])));
    std::fs::write(&*FILE, log).expect("memory can be written");
    let beside = FILE.with_extension("toml");
    match side {
        Some(side) => std::fs::write(&beside, side).expect("memory can be written"),
        None if beside.exists() => std::fs::remove_file(&beside).expect("memory can be written"),
        None => {}
    }
    if let Ok(log) = FlightLog::read_with(&FILE, &ReadOptions::default()) {
        assert!(log.duration_s() >= 0.0 && log.sample_rate_hz() > 0.0);
        drop((log.headline(), log.account(), log.ranges()));
        drop(log.slice(0.0, 1.0));
        // As a comparison does.
        if log.duration_s() < 1e4 {
            drop(log.resampled(100.0));
        }
    }
});
