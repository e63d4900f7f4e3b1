//! Commands of an autopilot, stored in the run folder: they allow a bit-identical replay of the run without the autopilot.
//!
//! `autopilot-commands.bin`, little endian: the eight bytes `RTCMD 1\n`, u32 parts of 0.5 ms per exchange, u32 rotors, then for each
//! exchange, prelude included, the duty of each rotor as f64.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Identity, Readings, Wanted};
use std::fs::File;
use std::io::{BufReader, BufWriter, ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Name of the file in the run folder.
pub const COMMANDS_FILE: &str = "autopilot-commands.bin";
const MAGIC: [u8; 8] = *b"RTCMD 1\n";

/// An autopilot whose commands are recorded.
pub struct Recording<'a, A> {
    autopilot: &'a mut A,
    file: BufWriter<File>,
    path: PathBuf,
    rotors: usize,
}

impl<'a, A: Autopilot> Recording<'a, A> {
    /// Starts the file in `folder`.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn new(autopilot: &'a mut A, folder: &Path, rotors: usize) -> Result<Self, String> {
        let path = folder.join(COMMANDS_FILE);
        let unwritable = |error: std::io::Error| format!("{}: cannot be written: {error}", path.display());
        let mut file = BufWriter::new(File::create(&path).map_err(unwritable)?);
        let counts = [autopilot.interval_parts(), rotors as u32].map(u32::to_le_bytes);
        file.write_all(&MAGIC)
            .and_then(|()| file.write_all(counts.as_flattened()))
            .map_err(unwritable)?;
        Ok(Self {
            autopilot,
            file,
            rotors,
            path,
        })
    }

    /// Completes the file.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn close(mut self) -> Result<(), String> {
        let path = self.path.display().to_string();
        self.file
            .flush()
            .map_err(|error| format!("{path}: cannot be written: {error}"))
    }
}

impl<A: Autopilot> Autopilot for Recording<'_, A> {
    fn interval_parts(&self) -> u32 {
        self.autopilot.interval_parts()
    }

    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        let duty = self.autopilot.exchange(readings)?;
        for duty in &duty[..self.rotors] {
            self.file.write_all(&duty.to_le_bytes()).map_err(|error| {
                AutopilotError::wrong(format!("{}: cannot be written: {error}", self.path.display()))
            })?;
        }
        Ok(duty)
    }

    fn identity(&self) -> Identity {
        self.autopilot.identity()
    }

    fn steer(&mut self, wanted: &Wanted) {
        self.autopilot.steer(wanted);
    }

    fn words(&mut self) -> Option<String> {
        self.autopilot.words()
    }

    fn flight_begins(&mut self) {
        self.autopilot.flight_begins();
    }

    fn flight_ends(&mut self) -> bool {
        self.autopilot.flight_ends()
    }

    fn landed(&self) -> bool {
        self.autopilot.landed()
    }

    fn finish(&mut self) {
        self.autopilot.finish();
    }
}

/// Replays the recorded commands in place of the autopilot.
pub struct Recorded {
    file: BufReader<File>,
    path: PathBuf,
    interval_parts: u32,
    rotors: usize,
    exchanges: u64,
}

impl Recorded {
    /// Opens the file of a run folder, for a vehicle with `rotors` rotors.
    ///
    /// # Errors
    /// There is none, or it belongs to another format or vehicle.
    pub fn open(folder: &Path, rotors: usize) -> Result<Self, String> {
        let path = folder.join(COMMANDS_FILE);
        let file = File::open(&path).map_err(|error| {
            format!(
                "{}: the commands of the autopilot that flew this run cannot be read: {error}",
                path.display()
            )
        })?;
        let mut file = BufReader::new(file);
        let mut header = [0; 16];
        let whole = file.read_exact(&mut header).is_ok();
        let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let (interval_parts, count) = (word(8), word(12));
        if !whole || header[..8] != MAGIC || interval_parts == 0 || count as usize != rotors {
            return Err(format!(
                "{}: expected commands of an autopilot for {rotors} rotors",
                path.display()
            ));
        }
        Ok(Self {
            file,
            path,
            interval_parts,
            rotors,
            exchanges: 0,
        })
    }
}

impl Autopilot for Recorded {
    fn interval_parts(&self) -> u32 {
        self.interval_parts
    }

    fn exchange(&mut self, _: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        let mut duty = [0.0; MAX_ROTORS];
        for duty in &mut duty[..self.rotors] {
            let mut bytes = [0; 8];
            self.file.read_exact(&mut bytes).map_err(|error| {
                let path = self.path.display();
                AutopilotError::wrong(match error.kind() {
                    ErrorKind::UnexpectedEof => format!("{path}: ends after {} exchanges", self.exchanges),
                    _ => format!("{path}: cannot be read after {} exchanges: {error}", self.exchanges),
                })
            })?;
            *duty = f64::from_le_bytes(bytes);
        }
        self.exchanges += 1;
        Ok(duty)
    }

    fn identity(&self) -> Identity {
        Identity {
            peer: format!("the recorded commands in {}", self.path.display()),
            version: None,
            lockstep: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Counting(f64);

    impl Autopilot for Counting {
        fn interval_parts(&self) -> u32 {
            2
        }
        fn exchange(&mut self, _: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
            self.0 += 0.125;
            Ok([self.0; MAX_ROTORS])
        }
        fn identity(&self) -> Identity {
            Identity::default()
        }
    }

    #[test]
    fn val_what_was_sent_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut autopilot = Counting(0.0);
        let mut recording = Recording::new(&mut autopilot, folder.path(), 6).unwrap();
        let sent: Vec<_> = (0..3)
            .map(|_| recording.exchange(&Readings::default()).unwrap())
            .collect();
        recording.close().unwrap();
        let mut recorded = Recorded::open(folder.path(), 6).unwrap();
        assert_eq!(recorded.interval_parts(), 2);
        for duty in sent {
            assert_eq!(recorded.exchange(&Readings::default()).unwrap()[..6], duty[..6]);
        }
        let end = recorded.exchange(&Readings::default()).unwrap_err().sentence;
        assert!(end.ends_with("ends after 3 exchanges"), "{end}");
        assert!(Recorded::open(folder.path(), 4).is_err());
    }

    #[test]
    fn val_other_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let said = |folder: &Path| Recorded::open(folder, 6).err().unwrap();
        assert!(said(folder.path()).contains("the commands of the autopilot that flew this run cannot be read"));
        std::fs::write(folder.path().join(COMMANDS_FILE), b"short").unwrap();
        assert!(said(folder.path()).ends_with("expected commands of an autopilot for 6 rotors"));
    }
}
