//! Commands of an autopilot, stored in the run folder: they allow a bit-identical replay of the run without the autopilot.
//!
//! `autopilot-commands.bin`, with the bytes of [`autopilot_commands`].

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_wire::autopilot::{Autopilot, AutopilotError, Identity, Readings, Wanted};
use rotortwin_wire::autopilot_commands::{self, CommandReader};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _};
use std::path::{Path, PathBuf};

/// Name of the file in the run folder.
pub const COMMANDS_FILE: &str = "autopilot-commands.bin";

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
        file.write_all(&autopilot_commands::header(autopilot.interval_parts(), rotors))
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
        self.file
            .write_all(&autopilot_commands::exchange(&duty[..self.rotors]))
            .map_err(|error| AutopilotError::wrong(format!("{}: cannot be written: {error}", self.path.display())))?;
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
    commands: CommandReader<BufReader<File>>,
    path: PathBuf,
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
        let commands = CommandReader::open(BufReader::new(file), rotors)
            .map_err(|clause| format!("{}: {clause}", path.display()))?;
        Ok(Self { commands, path })
    }
}

impl Autopilot for Recorded {
    fn interval_parts(&self) -> u32 {
        self.commands.interval_parts()
    }

    fn exchange(&mut self, _: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError> {
        self.commands
            .next_exchange()
            .map_err(|clause| AutopilotError::wrong(format!("{}: {clause}", self.path.display())))
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
