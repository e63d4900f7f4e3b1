//! Python with the dependencies of the client's tests, in a virtual environment under `target/`.

use crate::skip::skip;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

/// `clients/python` of the project.
pub fn client_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../clients/python")
}

/// Where Python keeps what it has compiled (`PYTHONPYCACHEPREFIX`): not beside sources of this checkout, and once for all processes of the tests.
pub fn bytecode_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/bytecode")
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
    let made = by_uv(python, &folder, packages).or_else(|_| by_pip(python, &folder, packages));
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

/// Makes the environment with `uv`, which shares what it has downloaded among environments and takes a tenth of pip's time.
fn by_uv(python: &str, folder: &Path, packages: &[&str]) -> Result<(), String> {
    static INSTALLED: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    let uv = INSTALLED.get_or_init(installed_uv).clone()?;
    // The tests install wheels with the environment's own pip.
    run(Command::new(&uv)
        .args(["venv", "--quiet", "--clear", "--seed", "--python", python])
        .arg(folder))?;
    let install = ["pip", "install", "--quiet", "--python"];
    run(Command::new(&uv)
        .args(install)
        .arg(folder.join("bin/python"))
        .args(packages))
}

/// `uv` in an environment of its own; where it is depends on nothing that is installed on the machine.
fn installed_uv() -> Result<PathBuf, String> {
    let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
    let (folder, wanted) = (target.join("uv"), "uv==0.13.9");
    let lock = File::create(target.join("uv.lock")).map_err(|error| error.to_string())?;
    lock.lock().map_err(|error| error.to_string())?;
    let stamp = folder.join("complete.txt");
    if !std::fs::read_to_string(&stamp).is_ok_and(|there| there == wanted) {
        by_pip("python3", &folder, &[wanted])?;
        std::fs::write(&stamp, wanted).map_err(|error| error.to_string())?;
    }
    Ok(folder.join("bin/uv"))
}

/// Makes the environment with what Python itself brings.
fn by_pip(python: &str, folder: &Path, packages: &[&str]) -> Result<(), String> {
    run(Command::new(python).args(["-m", "venv", "--clear"]).arg(folder))?;
    let options = ["install", "--quiet", "--disable-pip-version-check", "--retries", "1"];
    run(Command::new(folder.join("bin/pip")).args(options).args(packages))
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
