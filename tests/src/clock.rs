//! A wall clock that can be stepped, for processes started with it; the machine's clock is unchanged.

use crate::skip::skip;
use std::io::{Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The clock: a small library preloaded into a process (`clock.c`), and a file with the offset that it adds.
#[derive(Debug)]
pub struct Clock {
    library: PathBuf,
    step: PathBuf,
}

impl Clock {
    /// In a folder readable by every process of the test. `None`: there is no C compiler here, and a line says so.
    ///
    /// # Panics
    /// The folder cannot be written.
    pub fn new(folder: &Path) -> Option<Self> {
        let clock = Self {
            library: folder.join("clock.so"),
            step: folder.join("clock.step"),
        };
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/clock.c");
        let made = Command::new("cc")
            .args(["-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o"])
            .arg(&clock.library)
            .arg(source)
            .output();
        match made {
            Ok(output) => {
                let said = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "clock.c: {said}");
            }
            Err(error) => {
                skip(&format!("cc: {error}: clocks are not stepped"));
                return None;
            }
        }
        std::fs::write(&clock.step, 0_i64.to_ne_bytes()).expect("it can be written");
        Some(clock)
    }

    /// Environment of a process that is to use this clock.
    pub fn environment(&self) -> [(&'static str, String); 2] {
        [
            ("LD_PRELOAD", self.library.display().to_string()),
            ("CLOCK_STEP", self.step.display().to_string()),
        ]
    }

    /// Sets it ahead of the machine's clock by this many seconds.
    ///
    /// # Panics
    /// The file cannot be written.
    pub fn set_ahead(&self, seconds: i64) {
        // In place: the processes have these eight bytes in their memory.
        let mut file = std::fs::OpenOptions::new()
            .write(true)
            .open(&self.step)
            .expect("it is there");
        file.rewind()
            .and_then(|()| file.write_all(&seconds.to_ne_bytes()))
            .expect("it can be written");
    }
}
