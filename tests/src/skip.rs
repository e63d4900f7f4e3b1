//! Tests that cannot be fully executed here. Tests of other crates include this file by its path.

use std::io::Write as _;

/// Reports that a test could not be fully executed here, and why; `./test` counts these lines.
pub fn skip(reason: &str) {
    eprintln!("skipped: {reason}");
    let Some(log) = std::env::var_os("ROTORTWIN_SKIP_LOG") else {
        return;
    };
    let written = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(&log)
        .and_then(|mut file| file.write_all(format!("{reason}\n").as_bytes()));
    written.expect("the file named by ROTORTWIN_SKIP_LOG can be written");
}
