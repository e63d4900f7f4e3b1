//! Python with the dependencies of the client's tests, in a virtual environment under `target/`.

use crate::skip::skip;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// `clients/python` of the project.
pub fn client_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../clients/python")
}

/// The program folder of a virtual environment under `target/` with these packages. `None`: it cannot be created here, and a line
/// says why.
///
/// # Panics
/// The folder `target` cannot be written.
pub fn environment(name: &str, packages: &[&str]) -> Option<PathBuf> {
    environment_of("python3", name, packages)
}

/// [`environment`] of the client with its test dependencies, including DuckDB and PyArrow.
///
/// # Panics
/// The folder `target` cannot be written.
pub fn client_environment() -> Option<PathBuf> {
    environment(
        "python-client",
        &["--editable", &format!("{}[test]", client_folder().display())],
    )
}

/// [`environment`] of a specific Python.
///
/// # Panics
/// The folder `target` cannot be written.
pub fn environment_of(python: &str, name: &str, packages: &[&str]) -> Option<PathBuf> {
    let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
    let folder = target.join(name);
    std::fs::create_dir_all(&target).expect("target/ can be made");
    // Several tests may need it at the same time.
    let lock = File::create(target.join(format!("{name}.lock"))).expect("target/ can be written");
    lock.lock().expect("it can be locked");
    let project = std::fs::read_to_string(client_folder().join("pyproject.toml")).expect("it is there");
    let wanted = project + &packages.join("\n");
    let stamp = folder.join("complete.txt");
    if std::fs::read_to_string(&stamp).is_ok_and(|there| there == wanted) {
        return Some(folder.join("bin"));
    }
    let made = run(Command::new(python).args(["-m", "venv", "--clear"]).arg(&folder)).and_then(|()| {
        let options = ["install", "--quiet", "--disable-pip-version-check", "--retries", "1"];
        run(Command::new(folder.join("bin/pip")).args(options).args(packages))
    });
    match made {
        Ok(()) => {
            std::fs::write(&stamp, wanted).expect("it can be written");
            Some(folder.join("bin"))
        }
        Err(words) => {
            skip(&format!(
                "{name}: {words}; expected Python 3.10 with venv, and a package index"
            ));
            None
        }
    }
}

fn run(command: &mut Command) -> Result<(), String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let Output { status, stdout, stderr } = command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("{name}: {error}"))?;
    if status.success() {
        return Ok(());
    }
    let words = [stdout, stderr]
        .map(|text| String::from_utf8_lossy(&text).trim().to_owned())
        .join(" ");
    let last = words
        .lines()
        .rev()
        .find(|line| !line.trim().is_empty())
        .unwrap_or_default()
        .to_owned();
    Err(format!("{name} ended with {status}: {last}"))
}
