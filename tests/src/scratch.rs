//! An isolated place for each test: a folder, and an exclusive shared-memory domain.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use tempfile::TempDir;

/// Where iceoryx2 keeps its segments on Linux.
const SHARED_MEMORY: &str = "/dev/shm";

/// iceoryx2 permanently keeps one file of 16 bytes per domain; every later run reuses it.
const KEPT: &str = ".global_mgmt";

/// Empty folders and files that remain in the folder of a domain.
const KEPT_IN_ROOT: [&str; 5] = ["lock", "prefixes", "iceoryx2", "iceoryx2/nodes", "iceoryx2/services"];

/// The root of the repository.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .canonicalize()
        .expect("the repository is where it was built")
}

/// A shipped scenario, by its file name without extension.
pub fn shipped_scenario(name: &str) -> PathBuf {
    repository().join("config/scenarios").join(format!("{name}.toml"))
}

/// A hover of 6 s in which the detectors calibrate until 4.75 s and rotor 3 loses a fifth of its thrust at 5 s: short, but every
/// part of the program produces output.
pub fn short_flight() -> String {
    hover(
        "short",
        6.0,
        "[fdi]\ncalibration_start_s = 0.75\ncalibration_end_s = 4.75\n",
    ) + "[[fault]]\ntime_s = 5.0\nrotor = 3\nthrust_loss_percent = 20.0\n"
}

/// Steps of [`short_flight`].
pub const SHORT_FLIGHT_STEPS: u64 = 2400;

/// A hover whose rotor 2 changes its blade repeatedly: each change is announced, which shows the progress of the flight.
pub fn announced_flight(duration_s: u32) -> String {
    let changes = (0..duration_s).step_by(5).zip(["b", "a"].into_iter().cycle());
    let faults: String = changes
        .map(|(second, blade)| {
            let time_s = if second == 0 { 0.1 } else { f64::from(second) };
            format!("[[fault]]\ntime_s = {time_s:?}\nrotor = 2\nblade = '{blade}'\n")
        })
        .collect();
    hover("announced", f64::from(duration_s), &faults)
}

/// A hover with additional scenario sections.
pub fn hover(name: &str, duration_s: f64, sections: &str) -> String {
    let vehicle = repository().join("config/vehicles/f550.toml");
    format!(
        "name = '{name}'\ndescription = 'hover of the system tests'\nvehicle = '{}'\nduration_s = {duration_s:?}\n\
         [trajectory]\nkind = 'hover'\nposition_ned_m = [0.0, 0.0, -5.0]\n{sections}",
        vehicle.display()
    )
}

/// The place of one test; removed on drop.
#[derive(Debug)]
pub struct Scratch {
    folder: TempDir,
    domain: String,
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl Scratch {
    /// A new place.
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Self {
            folder: tempfile::Builder::new()
                .prefix("rotortwin-test-")
                .tempdir()
                .expect("there is room for temporary files"),
            domain: short_name(u64::from(std::process::id()) << 10 | u64::from(number)),
        }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file into the folder.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("a file is in a folder")).expect("folders can be made here");
        std::fs::write(&path, content).expect("files can be written here");
        path
    }

    /// Names of everything in the folder, with the folders below it.
    pub fn listing(&self) -> Vec<PathBuf> {
        let mut found = files_below(self.folder());
        found.sort();
        found
    }

    /// Domain for runs over iceoryx2.
    pub fn domain(&self) -> &str {
        &self.domain
    }

    /// Current shared-memory objects of runs in this domain.
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        let is_kept = |path: &PathBuf| {
            let below_root = path
                .strip_prefix(self.root())
                .map(|path| path.to_string_lossy().into_owned());
            match below_root {
                Ok(name) => KEPT_IN_ROOT.contains(&name.as_str()) || name.starts_with("prefixes/"),
                Err(_) => path.to_string_lossy().ends_with(KEPT),
            }
        };
        let mut entries = self.segments();
        entries.extend(files_below(&self.root()));
        entries.retain(|path| !is_kept(path));
        entries
    }

    /// Name prefix of all shared-memory objects of this domain.
    fn prefix(&self) -> String {
        format!("rt{}_{}", rustix::process::getuid().as_raw(), self.domain)
    }

    /// Folder of this domain.
    fn root(&self) -> PathBuf {
        Path::new(SHARED_MEMORY).join(self.prefix())
    }

    /// Segments of this domain.
    fn segments(&self) -> Vec<PathBuf> {
        let prefix = format!("{}_", self.prefix());
        let entries = std::fs::read_dir(SHARED_MEMORY).expect("/dev/shm can be read");
        let ours = entries
            .flatten()
            .filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
        ours.map(|entry| entry.path()).collect()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        for path in self.segments() {
            drop(std::fs::remove_file(path));
        }
        drop(std::fs::remove_dir_all(self.root()));
    }
}

/// A number in few letters and digits.
fn short_name(mut number: u64) -> String {
    let mut name = String::from("t");
    while number > 0 {
        name.extend(char::from_digit(
            u32::try_from(number % 36).expect("it is below 36"),
            36,
        ));
        number /= 36;
    }
    name
}

/// Everything below a folder; files that disappear meanwhile are skipped.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(files_below(&path));
        }
        found.push(path);
    }
    found
}
